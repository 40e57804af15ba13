//! The force that a plan gives the tip: friction that it counts on.

// Tests may compare with the platform's functions.
#![allow(clippy::disallowed_methods)]

use flexor::control::PaperParameters;
use flexor::model::ArmParameters;
use flexor_sim::planner::plan::{Plan, PlanOptions, plan};
use flexor_sim::planner::table_fit::fit_table;
use flexor_sim::planner::task::{PlanError, Task};
use flexor_sim::planner::tip_force::SurfaceFriction;
use flexor_sim::simulation::bench;
use flexor_sim::simulation::closed_loop::Outcome;
use flexor_tests::{OnBench, example, fast_task, paper_arm, paper_task, planned};
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

/// The tables' bits before there was friction in a plan.
#[test]
fn without_friction_the_tables_are_what_they_were() {
    for (name, was) in [
        ("task.toml", 0x5f67_86d9),
        ("task_fast.toml", 0xb6cd_6a85),
        ("task_bench.toml", 0xd24f_19c1),
    ] {
        let text = std::fs::read_to_string(example(name)).unwrap();
        for more in ["", "[surface]\nfriction = 0.0\nfriction_way_m = 0.01\n"] {
            let text = format!("{text}\n{more}");
            let task = flexor_sim::files::config::parse_task(name, &text).unwrap();
            let (_, table) = planned(&paper_arm(), &task);
            assert_eq!(crc(&table.image), was, "{name} {more}");
        }
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
        assert!(sampler.residual(&point).amax() < 1e-4);
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
    let task = with_friction(bench.plan.task, mu);
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
