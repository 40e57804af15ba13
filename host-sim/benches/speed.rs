//! How long planning, simulating and examining the paper's task takes: `cargo bench`.

use flexor_sim::analysis::stability::linear::{Linear, OperatingPoint};
use flexor_sim::analysis::stability::path::Report;
use flexor_sim::files::config;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::{Plan, PlanOptions, plan};
use flexor_sim::planner::table_fit;
use flexor_sim::plant::PlantParameters;
use flexor_sim::plant::spread::PlantVariant;
use flexor_sim::simulation::cases;
use flexor_sim::simulation::closed_loop::{RunOptions, Simulation};
use flexor_sim::simulation::start::{Start, plant_for};

fn main() {
    divan::main();
}

fn paper(duration: f64) -> Plan {
    let arm = config::parse_arm("example", config::DEFAULT_ARM)
        .expect("valid")
        .arm;
    let mut task = config::parse_task("example", config::DEFAULT_TASK).expect("valid");
    task.path.duration = duration;
    plan(&arm, &task, &PlanOptions::default()).expect("a plan")
}

/// The whole plan at 5 kHz rows, for the paper's duration of 2 s and longer ones.
#[divan::bench(args = [2.0, 4.0, 8.0])]
fn plan_the_papers_path(duration: f64) -> Plan {
    paper(divan::black_box(duration))
}

/// The plan's table image, with its accuracy measured.
#[divan::bench]
fn encode_the_table(bencher: divan::Bencher<'_, '_>) {
    let plan = paper(2.0);
    bencher.bench(|| table_fit::fit_table(&plan));
}

/// The plant alone: 2 s at 5 kHz ticks, single thread.
#[divan::bench(args = [3, 8])]
fn simulate_2_s(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let plan = paper(2.0);
    let parameters = PlantParameters {
        elements,
        ..PlantParameters::default()
    };
    bencher.bench(|| {
        let mut plant = plant_for(&plan, &parameters, Start::PlanAtRest).expect("a plant");
        for point in &plan.points {
            plant.advance(point.torque);
        }
        plant
    });
}

/// Plant, measurement, controller in f32 and log: 2 s at 5 kHz ticks, single thread.
#[divan::bench(args = [3, 8])]
fn run_2_s_in_closed_loop(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let plan = paper(2.0);
    let image = table_fit::fit_table(&plan).expect("a table").image;
    let law = config::parse_controller("example", config::DEFAULT_CONTROLLER).expect("valid");
    let options = RunOptions {
        law,
        limits: default_limits(&plan),
        plant: cases::plant(elements, 0.9),
        start: Start::PlanAtRest,
    };
    bencher.bench(|| {
        let mut simulation = Simulation::<f32>::new(&plan, &image, &options).expect("a simulation");
        simulation.run(|_| {})
    });
}

/// Linearisation of the 3-element plant at one point, by dual numbers.
#[divan::bench]
fn linearise_at_a_point(bencher: divan::Bencher<'_, '_>) {
    let plan = paper(2.0);
    let variant = PlantVariant::planned(&plan.model, plan.tick_rate_hz);
    let point = OperatingPoint::new(&plan, &mut plan.sampler(), &variant, 0.7).expect("a point");
    bencher.bench(|| Linear::new(&variant, &point));
}

/// The stability report of `flexor gains`: 50 points, the planned arm with all margins
/// and 27 plants around it with their least ones, on all cores.
#[divan::bench]
fn report_stability_over_50_points_and_27_plants(bencher: divan::Bencher<'_, '_>) {
    let plan = paper(2.0);
    let law = config::parse_controller("example", config::DEFAULT_CONTROLLER).expect("valid");
    let spread = config::parse_spread("example", config::DEFAULT_SPREAD).expect("valid");
    let plant = cases::plant(3, 1.0);
    bencher.bench(|| Report::new(&plan, &plant, &spread, &law, 50, &|| ()));
}
