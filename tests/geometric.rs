//! The geometrically exact link: its plans against an independent solution, in a plant of their own, and at
//! their limits.

// Tests may compare with the platform's functions.
#![allow(clippy::disallowed_methods)]

use flexor::model::{ArmParameters, Elbow};
use flexor_sim::model::configuration::{State, Surface};
use flexor_sim::model::energy::energy;
use flexor_sim::model::link::{LinkDamping, LinkKind, LinkModel};
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::task::{Ends, Task, Window};
use flexor_sim::plant::{Plant, PlantParameters};
use flexor_sim::simulation::start::{Start, plant_for};
use flexor_tests::{RefTable, fast_task, paper_arm, paper_task};
use std::cell::RefCell;

const MODAL: LinkDamping = LinkDamping::Modal;
/// The time that the reference has.
const BENDING: LinkDamping = LinkDamping::Bending {
    time_s: Some(0.0029),
};
const AUTO: Window = Window::Auto { tolerance: 1e-6 };

fn options(elements: usize, damping: LinkDamping) -> PlanOptions {
    PlanOptions {
        elements,
        link: LinkKind {
            model: LinkModel::Geometric,
            damping,
        },
        ..PlanOptions::default()
    }
}

fn geometric(arm: &ArmParameters, task: &Task, elements: usize, damping: LinkDamping) -> Plan {
    plan(arm, task, &options(elements, damping)).unwrap()
}

/// The paper's fast task with windows of 0.3 s before and after.
fn fast() -> Task {
    Task {
        post_actuation: Window::Fixed(0.3),
        ..fast_task(0.3)
    }
}

fn slow() -> Task {
    Task {
        pre_actuation: Window::Fixed(0.3),
        post_actuation: Window::Fixed(0.3),
        ..paper_task()
    }
}

/// A solution by another program (numpy, with its own shape functions' integrals, differences in steps
/// of 1 and 2 ms, and a complex step for derivatives). `bounds` are those of tau1 and tau2, N m.
fn assert_equals_reference(
    name: &str,
    task: &Task,
    elements: usize,
    damping: LinkDamping,
    bounds: [f64; 2],
) {
    let plan = geometric(&paper_arm(), task, elements, damping);
    let reference = RefTable::read(&format!("geometric/plan_{name}.csv"));
    let column = |name| reference.column(name);
    let columns = [
        "theta10_rad",
        "theta20_rad",
        "chord_m",
        "root_slope_rad",
        "root_slope_rate_rad_s",
        "tau1_Nm",
        "tau2_Nm",
    ]
    .map(column);
    let bounds = [1e-9, 1e-9, 1e-9, 1e-9, 1e-6, bounds[0], bounds[1]];
    let mut sampler = plan.sampler();
    assert!(reference.rows.len() > 40);
    for row in &reference.rows {
        let point = sampler.at(row[0]);
        let found = [
            point.joint.angle[0],
            point.joint.angle[1],
            point.chord_m,
            point.root_slope,
            point.root_slope_rate,
            point.torque[0],
            point.torque[1],
        ];
        for (i, found) in found.into_iter().enumerate() {
            let error = (found - row[columns[i]]).abs();
            assert!(
                error <= bounds[i],
                "{name}, t = {}, column {i}: off by {error:e}",
                row[0]
            );
        }
    }
}

#[test]
fn plans_are_those_of_an_independent_program() {
    for (elements, damping, name) in [
        (3, MODAL, "modal"),
        (3, BENDING, "bending"),
        (4, MODAL, "modal"),
        (4, BENDING, "bending"),
    ] {
        let name = format!("tf0.4_pre0.3_{elements}el_{name}");
        assert_equals_reference(&name, &fast(), elements, damping, [2e-6, 1e-7]);
    }
    for elements in [6, 8] {
        // The reference's own mesh error: 2.7e-6 and 4.4e-5 N m.
        let name = format!("tf0.4_pre0.3_{elements}el_bending");
        assert_equals_reference(&name, &fast(), elements, BENDING, [1e-4, 1e-7]);
    }
    let held = Task {
        ends: Ends::Dirichlet,
        ..paper_task()
    };
    for (damping, name) in [(MODAL, "modal"), (BENDING, "bending")] {
        let with = format!("tf2_pre0.3_3el_{name}");
        assert_equals_reference(&with, &slow(), 3, damping, [2e-6, 1e-7]);
        // These two have a mesh error of their own at the ends, where there are layers.
        let without = format!("tf2_nopre_3el_{name}");
        assert_equals_reference(&without, &held, 3, damping, [5e-5, 5e-7]);
    }
}

/// Drives a plant of `elements` with the plan's torques, continuously, from `start`; errors of the contact
/// force (largest and rms, N) and of the tip (largest, m).
fn drive(plan: &Plan, parameters: &PlantParameters, start: Start) -> [f64; 3] {
    let mut plant = plant_for(plan, parameters, start).unwrap();
    let sampler = RefCell::new(plan.sampler());
    let begin = plan.time(0);
    let mut worst = [0.0_f64; 3];
    for point in &plan.points {
        let reading = plant.read(point.torque);
        let error = reading.force - point.force.normal;
        worst[0] = worst[0].max(error.abs());
        worst[1] += error * error;
        let tip = point.tip.position;
        worst[2] = worst[2].max((reading.tip[0] - tip[0]).hypot(reading.tip[1] - tip[1]));
        plant.advance_with(|t| sampler.borrow_mut().at(begin + t).torque);
    }
    worst[1] = (worst[1] / plan.points.len() as f64).sqrt();
    worst
}

fn own(elements: usize) -> PlantParameters {
    PlantParameters {
        elements,
        ..PlantParameters::default()
    }
}

#[test]
fn the_plant_follows_the_plan() {
    let whole = ArmParameters {
        elbow: Elbow::Up,
        gravity_m_s2: [3.0, -5.0],
        root_inertia_kgm2: 5e-5,
        tip_mass_kg: 0.03,
        tip_inertia_kgm2: 2e-6,
        ..paper_arm()
    };
    // The last stands on its head, where every error grows.
    for (arm, elements, damping, bounds) in [
        (paper_arm(), 3, MODAL, [1e-6, 1e-8]),
        (paper_arm(), 4, MODAL, [1e-6, 1e-8]),
        (paper_arm(), 3, BENDING, [1e-6, 1e-8]),
        (whole, 3, MODAL, [2e-5, 1e-7]),
    ] {
        let plan = geometric(&arm, &fast(), elements, damping);
        let [force, _, tip] = drive(&plan, &own(elements), Start::PlanMoving);
        assert!(
            force < bounds[0] && tip < bounds[1],
            "{elements} {damping:?}: {force:e} N, {tip:e} m"
        );
    }
}

#[test]
fn a_linear_plan_misses_where_the_link_really_bends() {
    // Exudyn, an independent geometrically exact code, shows 0.493 N rms and 22.08 mm.
    let linear = PlanOptions {
        elements: 3,
        link: LinkKind {
            model: LinkModel::Linear,
            damping: BENDING,
        },
        ..PlanOptions::default()
    };
    let linear = plan(&paper_arm(), &fast(), &linear).unwrap();
    let mut plant = own(4);
    plant.link_model = Some(LinkModel::Geometric);
    let [_, force, tip] = drive(&linear, &plant, Start::Equilibrium);
    assert!((force / 0.493 - 1.0).abs() < 0.03, "{force} N");
    assert!((tip / 22.08e-3 - 1.0).abs() < 0.03, "{tip} m");
    // The exact plan does not.
    let exact = geometric(&paper_arm(), &fast(), 4, BENDING);
    let [_, force, tip] = drive(&exact, &own(4), Start::Equilibrium);
    assert!(force < 1e-3 && tip < 1e-4, "{force} N {tip} m");
}

#[test]
fn plans_begin_and_end_at_rest_whatever_the_elements_and_inertias() {
    let task = Task {
        pre_actuation: AUTO,
        post_actuation: AUTO,
        ..fast_task(0.3)
    };
    for model in [LinkModel::Linear, LinkModel::Geometric] {
        let mut peaks: Vec<f64> = Vec::new();
        for (elements, root_inertia_kgm2, tip_inertia_kgm2) in [
            (3, 0.0, 0.0),
            (6, 0.0, 0.0),
            (10, 0.0, 0.0),
            (3, 1e-2, 0.0),
            (6, 1e-2, 0.0),
            (3, 0.0, 1e-3),
            (4, 1e-4, 1e-4),
            (3, 0.0, 1e-5),
        ] {
            let arm = ArmParameters {
                root_inertia_kgm2,
                tip_inertia_kgm2,
                ..paper_arm()
            };
            let link = LinkKind {
                model,
                damping: MODAL,
            };
            let options = PlanOptions {
                elements,
                link,
                ..PlanOptions::default()
            };
            let what = format!(
                "{model:?}, {elements} elements, {root_inertia_kgm2} {tip_inertia_kgm2} kg m^2"
            );
            let plan =
                plan(&arm, &task, &options).unwrap_or_else(|error| panic!("{what}: {error}"));
            let last = plan.points.len() - 1;
            for (i, j) in [(0, 1), (1, 2), (last, last - 1), (last - 1, last - 2)] {
                let step = plan.points[i].torque[1] - plan.points[j].torque[1];
                assert!(
                    step.abs() < 1e-5,
                    "{what}: {step:e} N m at {}",
                    plan.points[i].t
                );
            }
            if root_inertia_kgm2 == 0.0 && tip_inertia_kgm2 == 0.0 {
                peaks.push(plan.peaks.torque[0]);
            }
        }
        for peak in &peaks {
            assert!((peak / peaks[0] - 1.0).abs() < 1e-3, "{peaks:?}");
        }
    }
}

#[test]
fn links_that_bend_too_far_are_refused_by_time_and_place() {
    let soft = ArmParameters {
        bending_stiffness_nm2: 0.02,
        ..paper_arm()
    };
    let refused = plan(&soft, &slow(), &options(3, MODAL)).unwrap_err();
    let words = refused.to_string();
    assert!(
        words.contains("72 degrees") && words.contains("t = "),
        "{words}"
    );
    // A third of the paper's stiffness bends twice as far, and is planned.
    let softer = ArmParameters {
        bending_stiffness_nm2: 0.16,
        ..paper_arm()
    };
    let plan = geometric(&softer, &slow(), 3, MODAL);
    let steepest = plan
        .points
        .iter()
        .fold(0.0_f64, |m, p| m.max(p.root_slope.abs()));
    assert!((0.35..1.2).contains(&steepest), "{steepest} rad");
    let [force, _, tip] = drive(&plan, &own(3), Start::PlanMoving);
    assert!(force < 1e-5 && tip < 1e-8, "{force:e} N, {tip:e} m");
}

#[test]
fn a_point_that_only_a_straight_link_reaches_is_refused() {
    let mut task = slow();
    // 1.05 m away is the stretched arm; the bent link's chord is 2.5 mm shorter.
    task.path.from = [1.0485, 0.05];
    task.path.to = [0.9, 0.05];
    let refused = plan(&paper_arm(), &task, &options(3, MODAL)).unwrap_err();
    let words = refused.to_string();
    assert!(
        words.contains("unreachable") && words.contains("1.0485"),
        "{words}"
    );
}

#[test]
fn free_motion_keeps_its_energy() {
    let arm = ArmParameters {
        damping_ratio: 0.0,
        root_inertia_kgm2: 2e-5,
        tip_mass_kg: 0.03,
        tip_inertia_kgm2: 3e-5,
        ..paper_arm()
    };
    let drift = |substeps| {
        let parameters = PlantParameters {
            elements: 3,
            link_model: Some(LinkModel::Geometric),
            substeps: Some(substeps),
            ..PlantParameters::default()
        };
        let model = parameters.model(&arm, LinkKind::default()).unwrap();
        let surface = Surface {
            normal: [0.0, 1.0],
            offset_m: 0.05,
        };
        let angle = model.kinematics.inverse([0.6, 0.05], arm.elbow).unwrap();
        let mut state = [angle.to_vec(), vec![1.0, 0.5]].concat();
        // Slopes of some 0.3 rad in the two lowest modes, let go.
        state.extend((0..6).map(|i| [0.012, 1e-3, 0.0, 0.0, 0.0, 0.0][i]));
        state.extend([0.0; 6]);
        let mut plant =
            Plant::new(model.clone(), &parameters, surface, 2e-4, state.clone()).unwrap();
        plant.set_state(&state);
        let begin = energy(&model, State(plant.state()));
        let mut worst = 0.0_f64;
        for _ in 0..5000 {
            plant.advance([0.0; 2]);
            worst = worst.max((energy(&model, State(plant.state())) - begin).abs());
            assert!(plant.constraint().abs() < 1e-12);
        }
        worst / begin.abs()
    };
    let [coarse, fine] = [1, 4].map(drift);
    assert!(
        fine < 1e-9 && fine < 0.1 * coarse.max(1e-11),
        "{coarse:e} {fine:e}"
    );
}
