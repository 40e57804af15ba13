//! What the feedforward table commands against what was planned, at every tick and the last,
//! which is held after the end.

use flexor::model::{ArmParameters, Elbow};
use flexor::table::Table;
use flexor_sim::planner::path::{LinePath, Profile};
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit::{TORQUE_SHARE, TableFitError, fit_table};
use flexor_sim::planner::task::{Ends, Task, Travel, Window};
use flexor_sim::planner::tip_force::SurfaceFriction;
use flexor_tests::{paper_arm, paper_task, planned};
use proptest::prelude::*;

const AUTO: Window = Window::Auto { tolerance: 1e-6 };

/// Torques that the f32 controller reads at every tick, N m.
fn commands(image: &[u8]) -> Vec<[f64; 2]> {
    let table = Table::open(image).unwrap();
    let mut cursor = table.cursor::<f32>();
    (0..=table.header().ticks)
        .map(|_| {
            let torque = cursor.setpoint().torque.map(f64::from);
            cursor.advance();
            torque
        })
        .collect()
}

/// The larger of both joints' shares.
fn share(plan: &Plan, image: &[u8]) -> f64 {
    let [(a, _), (b, _)] = shares(plan, image);
    a.max(b)
}

/// Largest error of the table's commands in (tau1, tau2) as shares of the planned peaks, and
/// the ticks where: against the plan in the middle of a command's period, at its end for the
/// last; and against the plan's torques at the ticks alone, between which the command must be
/// but for their bend.
fn shares(plan: &Plan, image: &[u8]) -> [(f64, usize); 2] {
    let commands = commands(image);
    let points = &plan.points;
    assert_eq!(commands.len(), points.len());
    let last = points.len() - 1;
    let mut sampler = plan.sampler();
    let mut worst = [(0.0, 0); 2];
    for (tick, command) in commands.iter().enumerate() {
        let end = points[last].t;
        let middle = plan.time(tick as u32) + 0.5 / f64::from(plan.tick_rate_hz);
        let held = sampler.at(middle.min(end)).torque;
        for joint in 0..2 {
            let torque = |tick: usize| points[tick].torque[joint];
            let mut error = (command[joint] - held[joint]).abs();
            let mut range = [torque(tick); 2];
            if tick == last {
                error = error.max((command[joint] - torque(last)).abs());
            } else {
                let bends = tick.saturating_sub(1).max(1)..=(tick + 2).min(last - 1);
                let bend = bends
                    .map(|i| (torque(i - 1) - 2.0 * torque(i) + torque(i + 1)).abs())
                    .fold(0.0, f64::max);
                for i in tick.saturating_sub(1)..=(tick + 2).min(last) {
                    range[0] = torque(i).min(range[0]);
                    range[1] = torque(i).max(range[1]);
                }
                error = error.max(range[0] - bend - command[joint]);
                error = error.max(command[joint] - range[1] - bend);
            }
            let share = error / plan.peaks.torque[joint];
            if share > worst[joint].0 {
                worst[joint] = (share, tick);
            }
        }
    }
    worst
}

fn options(elements: usize, tick_rate_hz: u32) -> PlanOptions {
    PlanOptions {
        elements,
        tick_rate_hz,
        ..PlanOptions::default()
    }
}

/// The paper's arm with other inertias.
fn arm(root_inertia_kgm2: f64, tip_mass_kg: f64) -> ArmParameters {
    ArmParameters {
        root_inertia_kgm2,
        tip_mass_kg,
        ..paper_arm()
    }
}

/// The paper's task, from rest.
fn from_rest(post_actuation: Window) -> Task {
    Task {
        pre_actuation: AUTO,
        post_actuation,
        ..paper_task()
    }
}

/// The task along a2 = `height_m` from one a1 to another.
fn along(
    [from, to]: [f64; 2],
    height_m: f64,
    duration: f64,
    normal_force: f64,
    window: Window,
) -> Task {
    Task {
        path: LinePath {
            from: [from, height_m],
            to: [to, height_m],
            duration,
            profile: Profile::Poly11,
        },
        travel: Travel::Line,
        normal_force: normal_force.into(),
        direction: None,
        friction: SurfaceFriction::default(),
        pre_actuation: window,
        post_actuation: window,
        ends: Ends::Spectral,
    }
}

/// An arm of Gu and Petkov's link, with an invented carrier.
fn long_light_arm() -> ArmParameters {
    ArmParameters {
        link1_length_m: 0.5,
        link1_mass_kg: 5.0,
        link2_length_m: 1.0,
        link2_mass_kg: 0.54,
        bending_stiffness_nm2: 18.4,
        damping_ratio: 0.01,
        root_inertia_kgm2: 0.1,
        tip_mass_kg: 0.25,
        tip_inertia_kgm2: 0.0,
        gravity_m_s2: [0.0, 0.0],
        elbow: Elbow::Down,
    }
}

/// An arm of 0.44 m links, of which the second is a thin bar on a large rotor.
fn geared_arm() -> ArmParameters {
    ArmParameters {
        link1_length_m: 0.44,
        link1_mass_kg: 2.273,
        link2_length_m: 0.44,
        link2_mass_kg: 0.059_715,
        bending_stiffness_nm2: 14.074_335,
        damping_ratio: 0.02,
        root_inertia_kgm2: 0.37,
        tip_mass_kg: 0.0,
        ..paper_arm()
    }
}

/// What is commanded last is held after the end: with post-actuation the torques that carry
/// the resting arm. By hand: statics of the bent arm at the path's end under gravity and the
/// force, from another program's beam.
#[test]
fn the_last_command_carries_the_resting_arm() {
    let statics = [5.99059, 0.263_088];
    for (elements, root) in [(3, 0.0), (8, 1e-3), (12, 2e-5), (6, 1e-2)] {
        let plan = plan(&arm(root, 0.0), &from_rest(AUTO), &options(elements, 5000)).unwrap();
        let image = fit_table(&plan).unwrap().image;
        let last = commands(&image).pop().unwrap();
        for joint in 0..2 {
            let error = last[joint] - statics[joint];
            assert!(
                error.abs() <= TORQUE_SHARE * plan.peaks.torque[joint],
                "{elements} elements, root {root}: tau{} off by {error:e}",
                joint + 1
            );
        }
        assert!(share(&plan, &image) <= TORQUE_SHARE);
    }
}

#[test]
fn the_last_command_is_the_plans_last_torque_without_post_actuation_too() {
    let task = from_rest(Window::Fixed(0.0));
    let plan = plan(&arm(0.0, 0.05), &task, &options(8, 5000)).unwrap();
    let image = fit_table(&plan).unwrap().image;
    let last = commands(&image).pop().unwrap();
    let planned = plan.points.last().unwrap().torque;
    // By hand, as above; the link is not quite at rest.
    let statics = [5.64622, 0.107_837];
    for joint in 0..2 {
        let error = (last[joint] - planned[joint]).abs();
        assert!(error <= TORQUE_SHARE * plan.peaks.torque[joint]);
        assert!((last[joint] / statics[joint] - 1.0).abs() < 0.1, "{last:?}");
    }
    assert!(share(&plan, &image) <= TORQUE_SHARE);
}

/// Arms on large hubs, whose plans have parts of microseconds at their ends: no outlier takes
/// the digits of the motion, which commanded 0 N m where 1 N m was planned.
#[test]
fn stiff_layers_at_the_ends_leave_the_motion_its_digits() {
    for (arm, task, elements) in [
        (long_light_arm(), along([1.2, 0.8], 0.2, 2.0, 1.0, AUTO), 8),
        (geared_arm(), along([0.7, 0.4], 0.1, 2.0, 2.0, AUTO), 5),
    ] {
        let plan = plan(&arm, &task, &options(elements, 5000)).unwrap();
        let table = fit_table(&plan).unwrap();
        assert!(share(&plan, &table.image) <= 1e-6);
        let distinct: std::collections::BTreeSet<_> = commands(&table.image)
            .into_iter()
            .map(|torque| torque[0].to_bits())
            .collect();
        assert!(distinct.len() > 1000, "{} torques", distinct.len());
    }
}

/// A table is as good for a slow soft arm and for a heavy one as for the paper's.
#[test]
fn errors_are_shares_of_the_tasks_own_torques() {
    let soft = ArmParameters {
        bending_stiffness_nm2: 4.8e-5,
        gravity_m_s2: [0.0, 9.81e-4],
        ..paper_arm()
    };
    let path = [0.7, 0.2];
    let slow = along(path, 0.05, 200.0, 2e-4, Window::Fixed(0.0));
    let heavy = ArmParameters {
        link1_mass_kg: 8e3,
        link2_mass_kg: 240.0,
        bending_stiffness_nm2: 480.0,
        ..paper_arm()
    };
    let pressing = along(path, 0.05, 2.0, 2e3, Window::Fixed(0.0));
    let (_, paper) = planned(&paper_arm(), &paper_task());
    for (arm, task, rate) in [(soft, slow, 50), (heavy, pressing, 5000)] {
        let plan = plan(&arm, &task, &options(3, rate)).unwrap();
        let table = fit_table(&plan).unwrap();
        assert!(share(&plan, &table.image) <= 1e-6);
        assert!(table.torque_error_share <= 1e-6);
        let (bytes, usual) = (table.image.len(), paper.image.len());
        assert!(
            bytes.abs_diff(usual) <= usual / 5,
            "{bytes} bytes, the paper's {usual}"
        );
    }
}

/// Root inertia, a tip mass and no post-actuation: the plan swings through 600 N m within
/// the last periods, several times between two ticks.
#[test]
fn a_plan_too_fast_for_its_ticks_is_refused_with_figure_and_remedy() {
    let swinging = ArmParameters {
        bending_stiffness_nm2: 8.0,
        damping_ratio: 0.1,
        ..arm(6e-3, 0.2)
    };
    let mut task = from_rest(Window::Fixed(0.0));
    task.path.duration = 0.25;
    task.ends = Ends::Dirichlet;
    let fast = plan(&swinging, &task, &options(6, 5000)).unwrap();
    let error = fit_table(&fast).unwrap_err();
    let TableFitError::Inexact {
        error: off,
        accepted,
        ..
    } = error
    else {
        panic!("{error}");
    };
    assert!(off > 100.0 * accepted);
    let words = error.to_string();
    for word in ["torque tau1 (N m)", "is accepted", "post_actuation_s"] {
        assert!(words.contains(word), "no {word:?} in {words}");
    }
    // What the message advises helps.
    task.post_actuation = AUTO;
    let rests = plan(&swinging, &task, &options(6, 5000)).unwrap();
    assert!(fit_table(&rests).unwrap().torque_error_share <= TORQUE_SHARE);
}

prop_compose! {
    /// Arms like the paper's with a rotor or hub at the root and a mass at the tip, stiff
    /// enough for both; tasks with and without windows.
    fn tasks()(
        elements in 1..=12_usize,
        root in prop_oneof![Just(0.0), (-6.0..-2.0_f64).prop_map(|x| libm::pow(10.0, x))],
        tip in prop_oneof![Just(0.0), 0.0..0.3_f64],
        stiffness in 0.0..2.0_f64,
        damping in 0.0..0.2_f64,
        up: bool,
        gravity: bool,
        windows in prop::array::uniform2(prop_oneof![Just(Window::Fixed(0.0)), Just(AUTO), (0.0..0.3_f64).prop_map(Window::Fixed)]),
        duration in 0.2..2.0_f64,
        force in 0.0..5.0_f64,
        to in 0.15..0.9_f64,
        tick_rate_hz in prop_oneof![Just(1000_u32), Just(5000)],
    ) -> (ArmParameters, Task, PlanOptions) {
        let arm = ArmParameters {
            bending_stiffness_nm2: 0.48 * libm::pow(10.0, stiffness),
            damping_ratio: damping,
            root_inertia_kgm2: root,
            tip_mass_kg: tip,
            gravity_m_s2: [0.0, if gravity { 9.81 } else { 0.0 }],
            elbow: if up { Elbow::Up } else { Elbow::Down },
            ..paper_arm()
        };
        let task = Task {
            path: LinePath { from: [0.7, 0.05], to: [to, 0.05], duration, profile: Profile::Poly11 },
            travel: Travel::Line,
            normal_force: force.into(),
            direction: None,
            friction: SurfaceFriction::default(),
            pre_actuation: windows[0],
            post_actuation: windows[1],
            ends: Ends::Spectral,
        };
        (arm, task, options(elements, tick_rate_hz))
    }
}

proptest! {
    // Always the same cases: a rare one shall not stop somebody else's change.
    #![proptest_config(ProptestConfig {
        cases: 24,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        ..ProptestConfig::default()
    })]

    /// Every command, the last included, is what was planned, or there is no table.
    #[test]
    fn a_table_commands_the_plan_or_there_is_none((arm, task, options) in tasks()) {
        let planned = match plan(&arm, &task, &options) {
            Ok(planned) => planned,
            Err(error) => {
                prop_assert!(!error.to_string().is_empty());
                return Ok(());
            }
        };
        match fit_table(&planned) {
            Ok(table) => {
                let worst = shares(&planned, &table.image);
                for (share, tick) in worst {
                    prop_assert!(share <= TORQUE_SHARE, "{share:e} at tick {tick}");
                }
            }
            Err(error) => prop_assert!(error.to_string().contains("is accepted"), "{error}"),
        }
    }
}
