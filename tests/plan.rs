//! The planner against independent solutions, and against itself where there are none.

// Tests may compare with the platform's functions.
#![allow(clippy::disallowed_methods)]

use flexor::model::{ArmParameters, Elbow};
use flexor_sim::planner::path::{LinePath, Profile};
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::task::{Ends, Equations, PlanError, Remedy, Task, Travel, Window};
use flexor_sim::planner::tip_force::{ForceProfile, NormalForce, SurfaceFriction};
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::start::{Start, plant_for};
use flexor_tests::{RefTable, fast_task, paper_arm, paper_task};
use proptest::prelude::*;
use std::cell::RefCell;

/// Compares a plan with a reference file: angles and deflections to 2e-6, torques to
/// 5e-6 N m.
fn assert_equals_reference(file: &str, arm: &ArmParameters, task: &Task) {
    assert_equals(file, arm, task, 3, [2e-6, 5e-6, 5e-6]);
}

/// The same with the given number of elements and bounds for angles and deflections,
/// slope rate (rad/s) and torques (N m).
fn assert_equals(file: &str, arm: &ArmParameters, task: &Task, elements: usize, bounds: [f64; 3]) {
    let options = PlanOptions {
        elements,
        ..PlanOptions::default()
    };
    // The reference solutions begin and end in a resting shape.
    let task = Task {
        ends: Ends::Dirichlet,
        ..task.clone()
    };
    let plan = plan(arm, &task, &options).unwrap();
    let reference = RefTable::read(file);
    let column = |name| reference.column(name);
    let (theta10, tau1) = (column("theta10_rad"), column("tau1_Nm"));
    let (w0, rate) = (column("w0"), column("root_slope_rate_rad_s"));
    let mut sampler = plan.sampler();
    assert!(reference.rows.len() > 40);
    for row in &reference.rows {
        let t = row[0];
        let point = sampler.at(t);
        let w = sampler.deflection();
        let near = |found: f64, column: usize, bound: f64| {
            let error = (found - row[column]).abs();
            assert!(
                error <= bound,
                "{file}, t = {t}, column {column}: off by {error:e}"
            );
        };
        for joint in 0..2 {
            near(point.joint.angle[joint], theta10 + joint, bounds[0]);
            near(point.torque[joint], tau1 + joint, bounds[2]);
        }
        for i in 0..2 * elements {
            near(w[i], w0 + i, bounds[0]);
        }
        near(point.root_slope_rate, rate, bounds[1]);
    }
}

#[test]
fn the_papers_task_elbow_down() {
    assert_equals_reference("plan_paper_tf2.csv", &paper_arm(), &paper_task());
}

#[test]
fn the_papers_task_elbow_up() {
    let arm = ArmParameters {
        elbow: Elbow::Up,
        ..paper_arm()
    };
    assert_equals_reference("plan_paper_tf2_elbow_up.csv", &arm, &paper_task());
}

#[test]
fn the_fast_task_with_pre_actuation() {
    assert_equals_reference("plan_fast_tf0.4_pre0.3.csv", &paper_arm(), &fast_task(0.3));
}

/// Solutions with 64-bit mantissas, by another program, in steps of a third of those
/// that changed nothing any more. Thin layers at the ends included: with 12 elements tau1
/// swings through 24 N m within the last 0.1 ms.
#[test]
fn other_numbers_of_elements_and_tasks() {
    let tight = [1e-9, 1e-6, 1e-6];
    let fast = Task {
        post_actuation: Window::Fixed(0.0),
        ..fast_task(0.3)
    };
    let mut short = paper_task();
    short.path.duration = 1.0;
    let weightless = ArmParameters {
        gravity_m_s2: [0.0, 0.0],
        ..paper_arm()
    };
    let up = ArmParameters {
        elbow: Elbow::Up,
        ..paper_arm()
    };
    assert_equals(
        "plan_2_elements_no_gravity.csv",
        &weightless,
        &short,
        2,
        tight,
    );
    assert_equals("plan_5_elements_elbow_up.csv", &up, &paper_task(), 5, tight);
    assert_equals("plan_8_elements_fast.csv", &paper_arm(), &fast, 8, tight);
    let loose = [1e-9, 1e-5, 1.5e-5];
    assert_equals(
        "plan_12_elements.csv",
        &paper_arm(),
        &paper_task(),
        12,
        loose,
    );
}

/// Drives a plant of the plan's own model with the plan's torques, continuously, from
/// the plan's first state; the largest errors of contact force (N) and tip (m).
fn replay(plan: &Plan) -> [f64; 2] {
    let parameters = PlantParameters {
        elements: plan.model.elements,
        ..PlantParameters::default()
    };
    let mut plant = plant_for(plan, &parameters, Start::PlanMoving).unwrap();
    let sampler = RefCell::new(plan.sampler());
    let begin = plan.time(0);
    let mut worst = [0.0_f64; 2];
    for point in &plan.points {
        let reading = plant.read(point.torque);
        worst[0] = worst[0].max((reading.force - point.force.normal).abs());
        let tip = point.tip.position;
        worst[1] = worst[1].max((reading.tip[0] - tip[0]).hypot(reading.tip[1] - tip[1]));
        plant.advance_with(|t| sampler.borrow_mut().at(begin + t).torque);
    }
    worst
}

#[test]
fn the_plant_follows_the_plan_of_every_number_of_elements() {
    // Inverse and forward dynamics, boundary-value problem and integration must all be
    // right for this, and they share only the model's matrices.
    let arms = [
        paper_arm(),
        ArmParameters {
            elbow: Elbow::Up,
            ..paper_arm()
        },
        ArmParameters {
            gravity_m_s2: [0.0, 0.0],
            ..paper_arm()
        },
        ArmParameters {
            gravity_m_s2: [3.0, -5.0],
            root_inertia_kgm2: 5e-5,
            tip_mass_kg: 0.05,
            ..paper_arm()
        },
    ];
    for (i, arm) in arms.iter().enumerate() {
        for elements in [1, 2, 3, 5, 8, 12] {
            let mut task = fast_task(0.3);
            task.path.duration = 0.5;
            let options = PlanOptions {
                elements,
                ..PlanOptions::default()
            };
            let plan = plan(arm, &task, &options)
                .unwrap_or_else(|error| panic!("arm {i}, {elements} elements: {error}"));
            let [force, tip] = replay(&plan);
            // With root inertia and 12 elements what is left of the tip's motion in its
            // equation, 1 - <rho B> M^-1 E, is 9e-8: rounding is seen in the torque.
            let ill = elements == 12 && arm.root_inertia_kgm2 > 0.0;
            let bound = if ill { 3e-2 } else { 2e-5 };
            assert!(
                force < bound && tip < bound,
                "arm {i}, {elements} elements: force off by {force:e} N, tip by {tip:e} m"
            );
        }
    }
}

#[test]
fn the_error_estimate_covers_the_error() {
    for task in [paper_task(), fast_task(0.0), fast_task(0.3)] {
        for elements in [2, 3, 5, 8] {
            let options = PlanOptions {
                elements,
                ..PlanOptions::default()
            };
            let coarse = PlanOptions {
                tolerance: 1e-6,
                ..options
            };
            let fine = PlanOptions {
                tolerance: 2e-9,
                ..options
            };
            let [coarse, fine] = [coarse, fine].map(|o| plan(&paper_arm(), &task, &o).unwrap());
            let differences = coarse.deflection.iter().zip(&fine.deflection);
            let error = differences.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let estimate = coarse.error_estimate();
            assert!(estimate <= 1e-6);
            assert!(
                error <= 1.5 * estimate,
                "{elements}: {error:e} against {estimate:e}"
            );
        }
    }
}

#[test]
fn the_torques_satisfy_all_equations() {
    let plan = plan(&paper_arm(), &fast_task(0.3), &PlanOptions::default()).unwrap();
    let mut sampler = plan.sampler();
    for i in 0..200 {
        let point = sampler.at(-0.3 + 0.005 * f64::from(i));
        // The equation is collocated; between the points its rows, some 100 1/s^2 in size,
        // are met to the accuracy of the second derivative.
        assert!(sampler.residual(point.t).iter().all(|x| x.abs() < 1e-4));
    }
}

#[test]
fn leaving_terms_out_as_printed_costs_accuracy() {
    let options = PlanOptions {
        equations: Equations::AsPrinted,
        ..PlanOptions::default()
    };
    let printed = plan(&paper_arm(), &paper_task(), &options).unwrap();
    let exact = plan(&paper_arm(), &paper_task(), &PlanOptions::default()).unwrap();
    let pairs = printed.points.iter().zip(&exact.points);
    let difference = pairs
        .map(|(a, b)| (a.torque[1] - b.torque[1]).abs())
        .fold(0.0, f64::max);
    assert!((0.005..0.1).contains(&difference), "{difference} N m");
    assert_eq!(exact.points.len(), printed.points.len());
}

#[test]
fn automatic_windows_start_and_end_at_rest() {
    let auto = Window::Auto { tolerance: 1e-6 };
    let task = Task {
        pre_actuation: auto,
        post_actuation: auto,
        ..fast_task(0.0)
    };
    let arm = paper_arm();
    let without = plan(&arm, &fast_task(0.0), &PlanOptions::default()).unwrap();
    let with = plan(&arm, &task, &PlanOptions::default()).unwrap();
    // The slowest zeros are near 42 and -37 1/s: a third of a second each.
    assert!(
        (0.25..0.45).contains(&-with.points[0].t),
        "{}",
        with.points[0].t
    );
    let last = with.points.len() - 1;
    for (i, j) in [(0, 0), (last, without.points.len() - 1)] {
        let (with, without) = (with.points[i], without.points[j]);
        let ratio = (with.root_slope_rate / without.root_slope_rate).abs();
        assert!(
            without.root_slope_rate.abs() > 0.5,
            "{}",
            without.root_slope_rate
        );
        assert!(ratio < 1e-5, "{ratio:e}");
    }
}

#[test]
fn paths_that_cannot_be_followed_are_refused_with_time_and_point() {
    let refused = |from, to| {
        let mut task = paper_task();
        task.path.from = from;
        task.path.to = to;
        match plan(&paper_arm(), &task, &PlanOptions::default()) {
            Err(PlanError::Path {
                t_s,
                point_m,
                source,
            }) => (t_s, point_m, source.to_string()),
            other => panic!("{from:?} to {to:?}: {other:?}"),
        }
    };
    let (t, point, why) = refused([1.2, 0.05], [0.2, 0.05]);
    assert!(
        t == 0.0 && point == [1.2, 0.05] && why.contains("unreachable"),
        "{why}"
    );
    let (t, _, why) = refused([0.7, 0.05], [1.2, 0.05]);
    assert!(t == 2.0 && why.contains("unreachable"), "{why}");
    // Through the hole around joint 1: the ends are fine, the middle is not.
    let (t, point, why) = refused([0.7, 0.0], [-0.7, 0.0]);
    assert!((t - 1.0).abs() < 1e-9 && point[0].abs() < 1e-9 && why.contains("unreachable"));
    // Along the edge of that hole: the arm folds and the elbow could flip.
    let (_, _, why) = refused([0.7, 0.05005], [-0.7, 0.05005]);
    assert!(why.contains("singular"), "{why}");
}

#[test]
fn a_tip_that_swings_freely_is_planned_with() {
    // From some 7e-6 kg m^2 on a pair of zeros has gone from either sign to a decaying oscillation: 5 grow
    // and 7 decay. Torques do not jump there.
    let peak = |tip_inertia_kgm2: f64| {
        let arm = ArmParameters {
            tip_inertia_kgm2,
            ..paper_arm()
        };
        let plan = plan(&arm, &fast_task(0.3), &PlanOptions::default()).unwrap();
        let [force, tip] = replay(&plan);
        assert!(force < 1e-5 && tip < 1e-8, "{force:e} {tip:e}");
        plan.peaks.torque[0]
    };
    let without = peak(0.0);
    for inertia in [5e-6, 1e-5, 5e-5, 1e-3] {
        let with = peak(inertia);
        assert!(
            (with / without - 1.0).abs() < 0.1,
            "{inertia}: {with} {without}"
        );
    }
}

#[test]
fn angles_are_continuous_where_the_arm_points_backwards() {
    // Straight down through the negative a1 axis, where atan2 jumps.
    for (from, to) in [([-0.6, -0.2], [-0.6, 0.2]), ([-0.6, 0.2], [-0.6, -0.2])] {
        let mut task = paper_task();
        task.path.from = from;
        task.path.to = to;
        let plan = plan(&paper_arm(), &task, &PlanOptions::default()).unwrap();
        for pair in plan.points.windows(2) {
            for joint in 0..2 {
                let step = pair[1].joint.angle[joint] - pair[0].joint.angle[joint];
                assert!(step.abs() < 1e-3, "{step} at {}", pair[0].t);
            }
        }
        let [force, tip] = replay(&plan);
        assert!(force < 1e-5 && tip < 1e-8, "{force:e} {tip:e}");
    }
}

#[test]
fn the_cost_is_linear_in_the_duration() {
    let intervals = |duration: f64| {
        let mut task = paper_task();
        task.path.duration = duration;
        plan(&paper_arm(), &task, &PlanOptions::default())
            .unwrap()
            .effort()
            .0 as f64
    };
    let (short, long) = (intervals(2.0), intervals(40.0));
    assert!(
        long < 20.0 * short,
        "{short} intervals for 2 s, {long} for 40 s"
    );
}

proptest! {
    // Always the same cases: a rare one shall not stop somebody else's change.
    #![proptest_config(ProptestConfig {
        cases: 24,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    /// Any arm and task either has a plan that its own plant follows, or is refused.
    #[test]
    fn any_task_is_planned_right_or_refused(
        r1 in 0.2..1.0_f64, r2 in 0.2..1.0_f64, m1 in 0.5..20.0_f64, m2 in 0.05..1.0_f64,
        slenderness in 0.5..4.0_f64, damping in 0.0..0.2_f64, up: bool, gravity: bool, elements in 1..7_usize,
        from in (-0.9..0.9_f64, -0.9..0.9_f64), way in (-0.4..0.4_f64, -0.4..0.4_f64),
        duration in 0.5..3.0_f64, force in 0.0..3.0_f64,
    ) {
        let arm = ArmParameters {
            link1_length_m: r1,
            link1_mass_kg: m1,
            link2_length_m: r2,
            link2_mass_kg: m2,
            // Stiff enough not to sag by more than some 0.3 rad under itself and the force.
            bending_stiffness_nm2: slenderness * (m2 * 9.81 + force) * r2 * r2,
            damping_ratio: damping,
            gravity_m_s2: [0.0, if gravity { 9.81 } else { 0.0 }],
            elbow: if up { Elbow::Up } else { Elbow::Down },
            ..paper_arm()
        };
        let reach = r1 + r2;
        let from = [from.0 * reach, from.1 * reach];
        let task = Task {
            path: LinePath {
                from,
                to: [from[0] + way.0 * reach, from[1] + way.1 * reach],
                duration,
                profile: Profile::Poly11,
            },
            travel: Travel::Line,
            normal_force: force.into(),
            direction: None,
            friction: SurfaceFriction::default(),
            pre_actuation: Window::Fixed(0.2),
            post_actuation: Window::Fixed(0.1),
            ends: Ends::default(),
        };
        let options = PlanOptions { elements, tick_rate_hz: 1000, ..PlanOptions::default() };
        match plan(&arm, &task, &options) {
            Err(error) => prop_assert!(!error.to_string().is_empty()),
            Ok(plan) => {
                let [force_error, tip] = replay(&plan);
                let scale = 1.0 + plan.peaks.torque[0];
                prop_assert!(force_error < 1e-4 * scale, "{force_error:e} N");
                prop_assert!(tip < 1e-5, "{tip:e} m");
            }
        }
    }
}

/// A table is told by what was planned, not by how the task says it.
#[test]
fn the_tasks_fingerprint_tells_plans_apart() {
    let of = |arm: &ArmParameters, task: &Task, options: &PlanOptions| {
        plan(arm, task, options).unwrap().task_fingerprint()
    };
    let (arm, task, options) = (paper_arm(), paper_task(), PlanOptions::default());
    let with = |change: &dyn Fn(&mut Task)| {
        let mut task = task.clone();
        change(&mut task);
        of(&arm, &task, &options)
    };
    let up = ArmParameters {
        elbow: Elbow::Up,
        ..arm
    };
    let profile = |force: f64| {
        let way_points = [[0.0, 2.0], [0.5, force]];
        NormalForce::Along(ForceProfile::new(&way_points, 0.5).unwrap())
    };
    let mut seen = vec![
        of(&arm, &task, &options),
        of(&up, &task, &options),
        of(
            &arm,
            &task,
            &PlanOptions {
                elements: 2,
                ..options
            },
        ),
        of(
            &arm,
            &task,
            &PlanOptions {
                tick_rate_hz: 4000,
                ..options
            },
        ),
        of(
            &arm,
            &task,
            &PlanOptions {
                equations: Equations::AsPrinted,
                ..options
            },
        ),
        with(&|task| task.path.from[0] += 1e-12),
        with(&|task| task.path.from[1] -= 1e-12),
        with(&|task| task.path.to[0] += 1e-12),
        with(&|task| task.path.to[1] -= 1e-12),
        with(&|task| core::mem::swap(&mut task.path.from, &mut task.path.to)),
        with(&|task| task.path.duration -= 1e-12),
        with(&|task| task.normal_force = (2.0 + 1e-12).into()),
        with(&|task| task.friction.coefficient = 0.1),
        with(&|task| {
            task.friction.coefficient = 0.1;
            task.friction.way_m *= 0.5;
        }),
        with(&|task| task.normal_force = profile(2.0)),
        with(&|task| task.normal_force = profile(2.0 + 1e-12)),
        with(&|task| task.direction = Some([0.0, -1.0])),
        with(&|task| task.pre_actuation = Window::Fixed(0.1)),
        with(&|task| task.post_actuation = Window::Fixed(0.1)),
    ];
    let all = seen.len();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), all);

    // Another arm has its own fingerprint, and the same task.
    let heavier = ArmParameters {
        link1_mass_kg: 9.0,
        ..arm
    };
    assert_eq!(of(&heavier, &task, &options), of(&arm, &task, &options));
    // The same motion in other words.
    let same = of(&arm, &task, &options);
    assert_eq!(with(&|task| task.direction = Some([0.3, 2.0])), same);
    assert_eq!(with(&|task| task.pre_actuation = Window::Fixed(-0.0)), same);
    let auto = with(&|task| task.pre_actuation = Window::Auto { tolerance: 1e-6 });
    let derived = Task {
        pre_actuation: Window::Auto { tolerance: 1e-6 },
        ..task.clone()
    };
    let ticks = plan(&arm, &derived, &options).unwrap().pre_ticks;
    let window = Window::Fixed(f64::from(ticks) / f64::from(options.tick_rate_hz));
    assert_eq!(with(&|task| task.pre_actuation = window), auto);
}

/// The faster the motion, the farther the link bends, without bound before 0.065 s: no method finds
/// what is not there, and past a right angle the equations mean nothing. The message says so, and
/// which duration there is a plan for.
#[test]
fn a_motion_that_bends_the_link_without_bound_is_told_with_the_duration_that_does_not() {
    const AUTO: Window = Window::Auto { tolerance: 1e-6 };
    let within = |duration: f64| {
        let mut task = paper_task();
        task.path.duration = duration;
        (task.pre_actuation, task.post_actuation) = (AUTO, AUTO);
        plan(&paper_arm(), &task, &PlanOptions::default())
    };
    let slope = |plan: &Plan| {
        let slopes = plan.points.iter().map(|point| point.root_slope.abs());
        slopes.fold(0.0, f64::max)
    };
    let [slow, fast] = [0.2, 0.12].map(|duration| slope(&within(duration).unwrap()));
    assert!(slow < fast && fast < 1.5, "{slow} {fast}");
    for duration in [0.06, 0.05, 0.02] {
        let error = within(duration).unwrap_err();
        let PlanError::Deflection {
            remedy:
                Remedy::Duration {
                    accepted_s,
                    slope_rad,
                    ..
                },
            ..
        } = error
        else {
            panic!("{duration} s: {error}");
        };
        assert!(error.to_string().contains("bend without bound"), "{error}");
        // What is advised is true, and not much longer than it must be.
        assert_eq!(slope(&within(accepted_s).unwrap()), slope_rad);
        assert!(within(0.85 * accepted_s).is_err(), "{accepted_s} s");
    }
}

/// Where rounding is the cause, that is said, and neither force nor duration blamed.
#[test]
fn too_many_elements_are_told_to_be_too_many() {
    let hub = |root_inertia_kgm2, elements| {
        let arm = ArmParameters {
            root_inertia_kgm2,
            ..paper_arm()
        };
        let options = PlanOptions {
            elements,
            ..PlanOptions::default()
        };
        let task = Task {
            ends: Ends::Dirichlet,
            ..paper_task()
        };
        plan(&arm, &task, &options)
    };
    for (inertia, elements) in [(0.05, 8), (0.2, 8)] {
        let words = hub(inertia, elements).unwrap_err().to_string();
        let cause = format!("link2.elements = {elements} are too many");
        assert!(words.contains(&cause), "{words}");
        assert!(
            !words.contains("force") && !words.contains("tip_inertia"),
            "{words}"
        );
        hub(inertia, 3).unwrap();
    }
}
