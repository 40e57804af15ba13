//! The plant against an independent simulation.

use flexor_sim::files::config;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::PlanOptions;
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::task::{Ends, Task, Window};
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::closed_loop::{Outcome, RunOptions, Simulation};
use flexor_sim::simulation::start::{Start, plant_for};
use flexor_tests::{RefTable, paper_arm, paper_task, planned};
use std::cell::RefCell;

#[test]
fn a_softer_plant_under_continuous_feedforward_equals_the_reference() {
    // 2 kHz makes the reference's rows, 2.5 ms apart, whole ticks.
    let options = PlanOptions {
        tick_rate_hz: 2000,
        ..PlanOptions::default()
    };
    // The reference begins and ends in a resting shape.
    let task = Task {
        ends: Ends::Dirichlet,
        ..paper_task()
    };
    let plan = plan(&paper_arm(), &task, &options).unwrap();
    let parameters = PlantParameters {
        elements: 3,
        bending_stiffness_scale: 0.9,
        ..PlantParameters::default()
    };
    let mut plant = plant_for(&plan, &parameters, Start::PlanAtRest).unwrap();
    let reference = RefTable::read("forward_ff_only_plant_EI_x0.9.csv");
    let sampler = RefCell::new(plan.sampler());
    let mut rows = reference.rows.iter().peekable();
    for tick in 0..=plan.ticks {
        let t = plan.time(tick);
        if let Some(row) = rows.next_if(|row| (row[0] - t).abs() < 1e-9) {
            let reading = plant.read(sampler.borrow_mut().at(t).torque);
            for (name, found, bound) in [
                ("f2_N", reading.force, 1e-4),
                ("x1_m", reading.tip[0], 1e-7),
                ("x2_m", reading.tip[1], 1e-10),
                ("root_slope_rad", reading.root_slope, 1e-6),
                ("root_slope_rate_rad_s", reading.root_slope_rate, 1e-4),
            ] {
                let error = (found - row[reference.column(name)]).abs();
                assert!(error <= bound, "t = {t}: {name} off by {error:e}");
            }
        }
        plant.advance_with(|t| sampler.borrow_mut().at(t).torque);
        assert!(plant.constraint().abs() < 1e-12, "{:e}", plant.constraint());
    }
    assert!(
        rows.next().is_none(),
        "not all rows of the reference were reached"
    );
}

#[test]
fn friction_on_a_bare_root_is_integrated_as_finely_as_it_needs() {
    // At rest 0.05 N m of Coulomb friction over 0.01 rad/s damp a root that has next to no
    // inertia: far faster than the highest mode. With the modes' step the run ends at 1.4 N and
    // loses contact. The right value is that of steps halved until nothing changes: 128, 256 and
    // 512 a control period give 0.0320 to 0.0325 N.
    let task = Task {
        pre_actuation: Window::Fixed(0.3),
        post_actuation: Window::Fixed(0.3),
        ..paper_task()
    };
    let (plan, table) = planned(&paper_arm(), &task);
    let options = RunOptions {
        law: config::parse_controller("example", config::PAPER_CONTROLLER).unwrap(),
        limits: default_limits(&plan),
        plant: PlantParameters {
            coulomb_friction_nm: [0.0, 0.05],
            ..PlantParameters::default()
        },
        start: Start::Equilibrium,
    };
    let mut simulation = Simulation::<f32>::new(&plan, &table.image, &options).unwrap();
    let summary = simulation.run(|_| {}).summary;
    assert_eq!(summary.outcome, Outcome::Completed);
    let rms = summary.force_error_rms;
    assert!((rms / 0.0322 - 1.0).abs() < 0.05, "{rms} N");
}
