//! The force that a plan gives the tip: one that changes along the path, and friction.

// Tests may compare with the platform's functions.
#![allow(clippy::disallowed_methods)]

use flexor::control::PaperParameters;
use flexor::model::ArmParameters;
use flexor::table::Table;
use flexor_sim::files::config::{load, parse_task};
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit::fit_table;
use flexor_sim::planner::task::{PlanError, Task};
use flexor_sim::planner::tip_force::{ForceProfile, NormalForce, SurfaceFriction};
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::bench;
use flexor_sim::simulation::closed_loop::{Outcome, RunOptions, Simulation};
use flexor_sim::simulation::start::{Start, plant_for};
use flexor_tests::{
    OnBench, example, fast_task, folder, paper_arm, paper_law, paper_task, planned,
};
use proptest::prelude::*;
use std::cell::RefCell;
use std::slice;

/// `task` with friction in its plan.
fn with_friction(task: Task, coefficient: f64) -> Task {
    let friction = SurfaceFriction {
        coefficient,
        ..SurfaceFriction::default()
    };
    Task { friction, ..task }
}

fn crc(image: &[u8]) -> u32 {
    crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(image)
}

/// No friction and none that is said are the same, to the tables' last bit.
#[test]
fn without_friction_the_tables_are_what_they_were() {
    for name in ["task.toml", "task_fast.toml", "task_bench.toml"] {
        let text = std::fs::read_to_string(example(name)).unwrap();
        let more = "[surface]\nfriction = 0.0\nfriction_way_m = 0.01\n";
        let [without, with] = [text.clone(), format!("{text}\n{more}")].map(|text| {
            let task = parse_task(name, &text).unwrap();
            crc(&planned(&paper_arm(), &task).1.image)
        });
        assert_eq!(without, with, "{name}");
    }
}

#[test]
fn friction_is_another_task_and_another_table() {
    let plans = [0.0, 0.1, 0.15].map(|mu| planned(&paper_arm(), &with_friction(paper_task(), mu)));
    for (i, (plan, table)) in plans.iter().enumerate() {
        for (other, other_table) in &plans[..i] {
            assert_ne!(plan.task_fingerprint(), other.task_fingerprint());
            assert_ne!(table.image, other_table.image);
        }
    }
}

/// At rest at the path's end, without gravity, the torques are the transposed Jacobian's of the
/// force with its friction, and link 2 is a beam with a moment at its end.
#[test]
fn at_the_end_joints_and_link_carry_the_friction() {
    let arm = ArmParameters {
        gravity_m_s2: [0.0; 2],
        ..paper_arm()
    };
    let (mu, force) = (0.2, 2.0);
    let mut task = with_friction(fast_task(0.6), mu);
    // Along any line, in either direction.
    for (from, to) in [
        ([0.7, 0.05], [0.2, 0.05]),
        ([0.2, 0.05], [0.7, 0.05]),
        ([0.3, 0.4], [0.7, 0.2]),
    ] {
        (task.path.from, task.path.to) = (from, to);
        let plan = plan(&arm, &task, &PlanOptions::default()).unwrap();
        let way: [f64; 2] = [to[0] - from[0], to[1] - from[1]];
        let length = way[0].hypot(way[1]);
        let normal = plan.surface.normal;
        let pressed = [0, 1].map(|i| force * (normal[i] + mu * way[i] / length));
        for (point, friction) in [
            (plan.points[0], 0.0),
            (plan.points[plan.points.len() - 1], 1.0),
        ] {
            assert!((point.force.along - friction * mu * force).abs() < 1e-12);
            let pressed = if friction > 0.0 {
                pressed
            } else {
                normal.map(|n| n * force)
            };
            let moment = |angle: f64, length: f64| {
                length * (angle.cos() * pressed[1] - angle.sin() * pressed[0])
            };
            let [link1, link2] = point.joint.angle;
            let tau2 = moment(link2, arm.link2_length_m);
            let tau1 = moment(link1, arm.link1_length_m) + tau2;
            assert!((point.torque[1] - tau2).abs() < 1e-5, "{point:?} {tau2}");
            assert!((point.torque[0] - tau1).abs() < 1e-5, "{point:?} {tau1}");
            let slope = tau2 * arm.link2_length_m / (3.0 * arm.bending_stiffness_nm2);
            assert!((point.root_slope - slope).abs() < 1e-5, "{point:?} {slope}");
        }
    }
}

#[test]
fn with_friction_the_torques_satisfy_all_equations() {
    let task = with_friction(fast_task(0.3), 0.3);
    let plan = plan(&paper_arm(), &task, &PlanOptions::default()).unwrap();
    let mut sampler = plan.sampler();
    for i in 0..200 {
        let point = sampler.at(-0.3 + 0.005 * f64::from(i));
        assert!(sampler.residual(point.t).iter().all(|x| x.abs() < 1e-4));
    }
}

/// A surface with friction whose plan knows of `mu`, run with feedforward alone: force error, rms
/// and largest, N, and largest error along the surface, mm.
fn open_loop(task: &str, mu: f64) -> [f64; 3] {
    let file = example("scenarios/nominal.toml");
    let task = format!("task={:?}", example(task).display().to_string());
    let sets = [
        task.as_str(),
        "contact.friction=0.15",
        "plant.elements=3",
        "drive1.delay_ticks=0",
        "drive2.delay_ticks=0",
        "drive1.bandwidth_Hz=1e5",
        "drive2.bandwidth_Hz=1e5",
        "plant.root_inertia_kgm2=0",
    ];
    let mut bench = OnBench::paper(&file, &sets);
    bench.law = PaperParameters::FEEDFORWARD.into();
    let task = with_friction(bench.plan.task.clone(), mu);
    bench.plan = plan(&bench.plan.model.arm, &task, &PlanOptions::default()).unwrap();
    bench.image = fit_table(&bench.plan).unwrap().image;
    let arm = bench
        .config
        .scenario
        .middle()
        .on_bench(&bench.plan, 1)
        .unwrap();
    let figures = bench::run::<f64>(&bench.task(), slice::from_ref(&arm), |_, _, _| {}).unwrap()[0];
    assert_eq!(figures.outcome, Outcome::Completed);
    [
        figures.force_error_rms_n,
        figures.force_error_max_n,
        1e3 * figures.along_error_max_m,
    ]
}

/// The bench's friction is a bristle that knows nothing of the plan's.
#[test]
fn feedforward_that_knows_the_friction_keeps_force_and_place() {
    for task in ["task_bench.toml", "task_fast.toml"] {
        let (known, unknown) = (open_loop(task, 0.15), open_loop(task, 0.0));
        let [rms, largest, along_mm] = known;
        assert!(
            rms < 0.03 && largest < 0.15 && along_mm < 0.5,
            "{task} {known:?}"
        );
        let [rms, largest, along_mm] = unknown;
        assert!(
            rms > 0.3 && largest > 0.5 && along_mm > 4.0,
            "{task} {unknown:?}"
        );
    }
}

/// |c2/s2| of the paper's path is up to 1.42, where link 2 is at 55 degrees to the surface.
#[test]
fn friction_that_jams_the_tip_is_refused_with_the_friction_that_does_not() {
    let planned = |mu| -> Result<Plan, PlanError> {
        plan(
            &paper_arm(),
            &with_friction(paper_task(), mu),
            &PlanOptions::default(),
        )
    };
    let (ratio, _) = planned(0.0).unwrap().lever_ratio_max();
    assert!((ratio - 1.423).abs() < 1e-3, "{ratio}");
    assert!(planned(0.999 / ratio).is_ok());
    let refusal = planned(1.001 / ratio).unwrap_err();
    let PlanError::Jams { lever_ratio, .. } = refusal else {
        panic!("{refusal}");
    };
    assert!((lever_ratio - ratio).abs() < 1e-4);
    let message = refusal.to_string();
    for words in [
        "surface.friction = 0.703",
        "|c2/s2| = 1.423",
        "below 1, a friction below 0.7027",
        "below 0.55, 0.3865",
    ] {
        assert!(message.contains(words), "{message}");
    }
}

fn profile(way_points: &[[f64; 2]]) -> ForceProfile {
    let length = way_points[way_points.len() - 1][0];
    ForceProfile::new(way_points, length).unwrap()
}

fn ramp() -> Task {
    let file = example("task_force_ramp.toml");
    load(Some(&file), "", parse_task).unwrap()
}

#[test]
fn a_force_of_equal_slopes_is_a_straight_line() {
    let profile = profile(&[[0.0, 1.0], [0.1, 1.5], [0.4, 3.0], [0.5, 3.5]]);
    for i in 0..=100 {
        let way = 0.005 * f64::from(i);
        assert!((profile.at(way) - (1.0 + 5.0 * way)).abs() < 1e-14, "{way}");
    }
    // Beyond its ends it stays what it is there.
    assert_eq!([profile.at(-0.1), profile.at(0.6)], [1.0, 3.5]);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// It passes through its way-points, is twice continuously differentiable there, and between two
    /// of them it neither turns nor leaves their range.
    #[test]
    fn a_force_profile_is_smooth_and_keeps_between_its_way_points(
        steps in prop::collection::vec((0.02..1.0_f64, prop_oneof![Just(0.0), 0.0..10.0_f64]), 2..12),
    ) {
        let mut way = 0.0;
        let way_points: Vec<[f64; 2]> = steps
            .iter()
            .map(|(step, force)| {
                let point = [way, *force];
                way += step;
                point
            })
            .collect();
        let profile = profile(&way_points);
        prop_assert!(profile.way_points().eq(way_points.iter().copied()));
        for pair in way_points.windows(2) {
            let ([from, low], [to, high]) = (pair[0], pair[1]);
            prop_assert!((profile.at(from) - low).abs() < 1e-12);
            let step = (to - from) / 64.0;
            for i in 0..64 {
                let [a, b] = [i, i + 1].map(|i| profile.at(from + step * f64::from(i)));
                prop_assert!((b - a) * (high - low) >= -1e-12, "{a} {b} in {pair:?}");
                prop_assert!(a >= low.min(high) - 1e-12 && a <= low.max(high) + 1e-12);
            }
        }
        for three in way_points.windows(3) {
            let [before, at, after] = [three[0][0], three[1][0], three[2][0]];
            let h = 1e-4 * (at - before).min(after - at);
            // From both sides: f(at +- k h) to the third order.
            let derivatives = |side: f64| {
                let [f0, f1, f2, f3] =
                    [0.0, 1.0, 2.0, 3.0].map(|k| profile.at(at + side * k * h));
                let first = (-11.0 * f0 + 18.0 * f1 - 9.0 * f2 + 2.0 * f3) / (6.0 * h);
                let second = (2.0 * f0 - 5.0 * f1 + 4.0 * f2 - f3) / (h * h);
                [side * first, second]
            };
            let [left, right] = [-1.0, 1.0].map(derivatives);
            let scale = 10.0 / (at - before).min(after - at);
            prop_assert!((left[0] - right[0]).abs() < 1e-6 * scale, "{left:?} {right:?}");
            let scale = scale / (at - before).min(after - at);
            prop_assert!((left[1] - right[1]).abs() < 1e-3 * scale, "{left:?} {right:?}");

        }
    }
}

/// What the controller reads at every tick is the profile at the place of the tip.
#[test]
fn the_tables_force_is_the_profile() {
    for task in [ramp(), with_friction(ramp(), 0.15)] {
        let NormalForce::Along(profile) = task.normal_force.clone() else {
            panic!("a profile");
        };
        let (plan, table) = planned(&paper_arm(), &task);
        let mut cursor = Table::open(&table.image).unwrap().cursor::<f32>();
        let mut range = [f64::INFINITY, 0.0_f64];
        for point in &plan.points {
            let row = cursor.row();
            let expected = profile.at(0.7 - point.tip.position[0]);
            assert!((f64::from(row.force) - expected).abs() < 1e-5, "{point:?}");
            assert!((point.force.normal - expected).abs() < 1e-12, "{point:?}");
            range = [range[0].min(expected), range[1].max(expected)];
            cursor.advance();
        }
        assert!((range[0] - 1.0).abs() < 1e-12 && (range[1] - 3.0).abs() < 1e-9);
    }
}

/// A plant of the plan's own model under the plan's torques alone, continuously: its force is the
/// profile, which it knows nothing of.
#[test]
fn the_torques_make_the_force_that_the_profile_asks_for() {
    let mut fast = ramp();
    fast.path.duration = 0.4;
    for task in [ramp(), fast] {
        let plan = plan(&paper_arm(), &task, &PlanOptions::default()).unwrap();
        let parameters = PlantParameters {
            elements: 3,
            ..PlantParameters::default()
        };
        let mut plant = plant_for(&plan, &parameters, Start::PlanMoving).unwrap();
        let sampler = RefCell::new(plan.sampler());
        let begin = plan.time(0);
        for point in &plan.points {
            let force = plant.read(point.torque).force;
            let error = (force - point.force.normal).abs();
            assert!(error < 2e-5, "{error:e} N at {point:?}");
            plant.advance_with(|t| sampler.borrow_mut().at(begin + t).torque);
        }
    }
}

#[test]
fn the_closed_loop_follows_the_profile() {
    // In the ideal world, another stiffness of the link apart.
    let (plan, table) = planned(&paper_arm(), &ramp());
    let error = |scale| {
        let options = RunOptions {
            law: paper_law().into(),
            limits: default_limits(&plan),
            plant: PlantParameters {
                elements: 3,
                bending_stiffness_scale: scale,
                ..PlantParameters::default()
            },
            start: Start::Equilibrium,
        };
        let mut simulation = Simulation::<f32>::new(&plan, &table.image, &options).unwrap();
        simulation.run(|_| {}).summary.force_error_max
    };
    assert!(error(1.0) < 1e-3, "{}", error(1.0));
    assert!(error(0.9) < 0.1, "{}", error(0.9));
    // And on the bench.
    let file = example("scenarios/nominal.toml");
    let force = |task: &str| {
        let task = format!("task={:?}", example(task).display().to_string());
        let runs = OnBench::new(&file, &[&task]).runs(1, &[0, 1, 2]);
        runs.iter()
            .for_each(|run| assert_eq!(run.figures.outcome, Outcome::Completed));
        runs[0].figures.force_error_rms_n
    };
    let [ramp, constant] = ["task_force_ramp.toml", "task_bench.toml"].map(force);
    assert!(ramp < 1.2 * constant && ramp < 0.04, "{ramp} {constant}");
}

#[test]
fn bad_profiles_are_refused_with_what_is_accepted() {
    let folder = folder();
    let task = folder.join("task.toml");
    let ramp = std::fs::read_to_string(example("task_force_ramp.toml")).unwrap();
    let head = &ramp[..ramp.find("profile_m_N").unwrap()];
    let read = |force: &str| {
        std::fs::write(&task, format!("{head}{force}\n")).unwrap();
        let read = load(Some(&task), "", parse_task);
        read.map(|task| task.normal_force)
            .map_err(|error| error.to_string())
    };
    for (force, words) in [
        (
            "",
            "force.normal_N: missing; accepted: a force in N from 0 to 1e6, or force.profile_m_N or force.profile_csv",
        ),
        (
            "normal_N = 2.0\nprofile_m_N = [[0.0, 1.0], [0.5, 2.0]]",
            "more than one of normal_N, profile_m_N and profile_csv",
        ),
        (
            "profile_m_N = 3",
            "force.profile_m_N = 3; accepted: way-points [place in m",
        ),
        (
            "profile_m_N = [[0.0, 1.0]]",
            "1 way-points; accepted: 2 to 1000",
        ),
        ("profile_m_N = [[0.0, 1.0], [0.5]]", "profile_m_N"),
        (
            "profile_m_N = [[0.0, 1.0], [0.5, -2.0]]",
            "way-point 2 has a force of -2 N; accepted: a force in N from 0 to 1e6",
        ),
        (
            "profile_m_N = [[0.0, 1.0], [0.5, nan]]",
            "way-point 2 has a force of",
        ),
        (
            "profile_m_N = [[0.0, 1.0], [0.3, 2.0], [0.3, 1.0], [0.5, 1.0]]",
            "way-point 3 is at 0.3 m, the one before it at 0.3 m; accepted: rising places, more than 5e-7 m apart",
        ),
        (
            "profile_m_N = [[-inf, 1.0], [0.5, 2.0]]",
            "reach from -inf to 0.5 m",
        ),
        (
            "profile_m_N = [[0.0, 1.0], [0.4, 2.0]]",
            "reach from 0 to 0.4 m; accepted: from 0 to the path's length, 0.5 m",
        ),
        (
            "profile_m_N = [[0.1, 1.0], [0.5, 2.0]]",
            "reach from 0.1 to 0.5 m",
        ),
        ("profile_csv = \"none.csv\"", "none.csv: cannot be read"),
    ] {
        let message = read(force).unwrap_err();
        assert!(message.contains(words), "{force}: {message}");
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    let csv = folder.join("force.csv");
    let read_csv = |text: &str| {
        std::fs::write(&csv, text).unwrap();
        read("profile_csv = \"force.csv\"")
    };
    for (text, words) in [
        ("", "line 1: \"\"; accepted: s_m,force_N"),
        ("0,1\n0.5,2\n", "line 1: \"0,1\"; accepted: s_m,force_N"),
        (
            "s_m,force_N\n0,1\n\n0.5;2\n",
            "line 4: \"0.5;2\"; accepted: a way in m, a comma, a force in N",
        ),
        ("s_m,force_N\n0,1\n0.5,2,3\n", "line 3"),
        (
            "s_m,force_N\n0,1\n0.2,1\n0.1,2\n",
            "force.csv: way-point 3 is at 0.1 m",
        ),
    ] {
        let message = read_csv(text).unwrap_err();
        assert!(
            message.contains(words) && message.contains("force.csv"),
            "{message}"
        );
        assert_eq!(message.lines().count(), 1, "{message}");
    }
    // The same way-points are the same profile.
    let of_file =
        read_csv("# a comment\ns_m, force_N\r\n0.0,1\n0.1, 1\n0.2,3.0\n\n0.3,3\n0.5,2\n").unwrap();
    assert_eq!(of_file, self::ramp().normal_force);
}

/// A measured profile has hundreds of way-points.
#[test]
fn a_profile_of_many_way_points_has_a_plan() {
    let way_points: Vec<[f64; 2]> = (0..=250)
        .map(|i| 0.002 * f64::from(i))
        .map(|way| [way, 2.0 + (12.0 * way).sin()])
        .collect();
    let task = Task {
        normal_force: NormalForce::Along(profile(&way_points)),
        ..ramp()
    };
    let (planned, table) = planned(&paper_arm(), &task);
    assert!(
        planned.error_estimate() < 1e-6,
        "{}",
        planned.error_estimate()
    );
    // A table for a board is that of a smooth force, not one with a knot at each way-point.
    assert!(table.image.len() < 20_000, "{}", table.image.len());
}
