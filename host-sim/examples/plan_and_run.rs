//! From an arm and a task to a simulated run, in five steps:
//! `cargo run --release --example plan_and_run`.

use flexor::control::LawParameters;
use flexor_sim::files::config::{DEFAULT_ARM, PAPER_CONTROLLER, parse_arm, parse_controller};
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::path::{LinePath, Profile};
use flexor_sim::planner::plan::PlanOptions;
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit;
use flexor_sim::planner::task::{Ends, Task, Travel, Window};
use flexor_sim::planner::tip_force::SurfaceFriction;
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::closed_loop::{RunOptions, Simulation};
use flexor_sim::simulation::start::Start;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // 1. The paper's arm and its task: 0.5 m along a table in 2 s, pressing with 2 N.
    let arm = parse_arm("arm.toml", DEFAULT_ARM)?.arm;
    let task = Task {
        path: LinePath {
            from: [0.7, 0.05],
            to: [0.2, 0.05],
            duration: 2.0,
            profile: Profile::Poly11,
        },
        travel: Travel::Line,
        normal_force: 2.0.into(),
        direction: None,
        friction: SurfaceFriction::default(),
        pre_actuation: Window::Fixed(0.0),
        post_actuation: Window::Fixed(0.0),
        ends: Ends::Spectral,
    };

    // 2. The plan: what the joints, the link and the drives have to do.
    let plan = plan(&arm, &task, &PlanOptions::default())?;
    let [torque1, torque2] = plan.peaks.torque;
    println!("planned torques up to {torque1:.2} and {torque2:.3} N m");

    // 3. The table from which the controller reads the plan, tick by tick.
    let table = table_fit::fit_table(&plan)?;
    println!("its table has {} bytes", table.image.len());

    // 4. The arm that it will meet: a link that is a tenth softer, in a finer model.
    let plant = PlantParameters {
        elements: 8,
        bending_stiffness_scale: 0.9,
        ..PlantParameters::default()
    };

    // 5. The firmware's controller on this arm, without feedback and with it.
    let tuned = parse_controller("controller.toml", PAPER_CONTROLLER)?;
    for (name, law) in [
        ("feedforward alone", LawParameters::FEEDFORWARD),
        ("with feedback", tuned),
    ] {
        let options = RunOptions {
            law,
            limits: default_limits(&plan),
            plant,
            start: Start::Equilibrium,
        };
        let mut simulation = Simulation::<f32>::new(&plan, &table.image, &options)?;
        let run = simulation.run(|step| {
            // What happens at every tick can be looked at; here, once every half second.
            if step.tick % 2500 == 0 {
                let force = step.row.reading.force;
                println!("  t = {:.1} s: contact force {force:.4} N", step.row.t);
            }
        });
        println!(
            "{name}: force error {:.4} N rms, {:?}",
            run.summary.force_error_rms, run.summary.outcome
        );
    }
    Ok(())
}
