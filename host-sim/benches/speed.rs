//! How long planning, simulating and examining the paper's task takes: `cargo bench`.

use flexor_sim::analysis::stability::linear::{Linear, OperatingPoint};
use flexor_sim::analysis::stability::path::Report;
use flexor_sim::campaign::setup::BenchSetup;
use flexor_sim::files::config;
use flexor_sim::model::configuration::Surface;
use flexor_sim::model::geometric_stiffness::GeometricStiffness;
use flexor_sim::model::link::{LinkKind, LinkModel};
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::monitors::default_monitors;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit;
use flexor_sim::plant::PlantParameters;
use flexor_sim::plant::bench::lanes::Lanes;
use flexor_sim::plant::bench::{
    CompliantArm, CompliantParameters, CompliantPlant, F64x4, SurfaceFeature, SurfaceProfile,
};
use flexor_sim::plant::spread::PlantVariant;
use flexor_sim::simulation::bench::{self, BenchBoard, BenchTask, FailureLimits};
use flexor_sim::simulation::cases;
use flexor_sim::simulation::closed_loop::{RunOptions, Simulation};
use flexor_sim::simulation::start::{Start, plant_for};

fn main() {
    divan::main();
}

fn paper(duration: f64) -> Plan {
    paper_with(duration, &PlanOptions::default())
}

fn paper_with(duration: f64, options: &PlanOptions) -> Plan {
    let arm = config::parse_arm("example", config::DEFAULT_ARM)
        .expect("valid")
        .arm;
    let mut task = config::parse_task("example", config::DEFAULT_TASK).expect("valid");
    task.path.duration = duration;
    plan(&arm, &task, options).expect("a plan")
}

/// With the geometrically exact link in `elements` elements.
fn geometric(elements: usize) -> PlanOptions {
    PlanOptions {
        elements,
        link: LinkKind {
            model: LinkModel::Geometric,
            ..LinkKind::default()
        },
        ..PlanOptions::default()
    }
}

/// The plan for 2 s with the geometrically exact link.
#[divan::bench(args = [3, 4, 8])]
fn plan_the_papers_path_geometrically(elements: usize) -> Plan {
    paper_with(2.0, &geometric(divan::black_box(elements)))
}

/// The plant with the geometrically exact link alone: 2 s at 5 kHz ticks, single thread.
#[divan::bench(args = [3, 4, 8])]
fn simulate_2_s_geometrically(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let plan = paper_with(2.0, &geometric(3));
    let parameters = PlantParameters {
        elements,
        ..PlantParameters::default()
    };
    bencher.bench(|| {
        let mut plant = plant_for(&plan, &parameters, Start::Equilibrium).expect("a plant");
        for point in &plan.points {
            plant.advance(point.torque);
        }
        plant
    });
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

/// One second of the bench's plant at 5 kHz ticks, in as many lanes as `T` has, on an ideal
/// contact, single thread. Lanes by time (s) are plants in real time.
#[divan::bench(types = [f64, F64x4], args = [3, 4, 8, 12])]
fn bench_plant_1_s<T: Lanes>(bencher: divan::Bencher<'_, '_>, elements: usize) {
    compliant::<T>(bencher, &paper(2.0), elements, &ideal(2e4));
}

/// The same with the geometrically exact link.
#[divan::bench(types = [f64, F64x4], args = [3, 4, 8])]
fn bench_plant_1_s_geometrically<T: Lanes>(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let plan = paper_with(2.0, &geometric(3));
    compliant::<T>(bencher, &plan, elements, &ideal(2e4));
}

/// The same with eight elements on contacts of other stiffness, N/m.
#[divan::bench(types = [f64, F64x4], args = [2e3, 2e4, 1e5, 1e6])]
fn bench_plant_1_s_by_stiffness<T: Lanes>(bencher: divan::Bencher<'_, '_>, stiffness: f64) {
    compliant::<T>(bencher, &paper(2.0), 8, &ideal(stiffness));
}

/// The same with everything on: friction, cogging, rotors, lag, waviness, a hole, geometric
/// stiffness.
#[divan::bench(types = [f64, F64x4], args = [4, 8])]
fn bench_plant_1_s_with_everything<T: Lanes>(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let mut parameters = ideal(2e4);
    parameters.contact.friction = 0.3;
    parameters.contact.friction_at_rest = 0.35;
    parameters.geometric_stiffness = GeometricStiffness::Full;
    parameters.surface.waviness_m = 1e-4;
    parameters.surface.features = vec![SurfaceFeature::Hole {
        from_m: 0.4,
        to_m: 0.41,
        depth_m: 1e-3,
        wall_m: 1e-3,
    }];
    for (joint, drive) in parameters.joints.iter_mut().zip(&mut parameters.drives) {
        joint.friction.coulomb_nm = 0.05;
        joint.friction.breakaway_nm = 0.06;
        joint.cogging.amplitude_nm = 0.01;
        joint.rotor_inertia_kgm2 = 3e-5;
        drive.bandwidth_hz = Some(300.0);
    }
    compliant::<T>(bencher, &paper(2.0), elements, &parameters);
}

/// The paper's surface with a contact of `stiffness` N/m.
fn ideal(stiffness: f64) -> CompliantParameters {
    let surface = Surface {
        normal: [0.0, 1.0],
        offset_m: 0.05,
    };
    let mut parameters = CompliantParameters::ideal(SurfaceProfile::flat(surface));
    parameters.contact.stiffness_n_m = stiffness;
    parameters
}

fn compliant<T: Lanes>(
    bencher: divan::Bencher<'_, '_>,
    plan: &Plan,
    elements: usize,
    parameters: &CompliantParameters,
) {
    let model = parameters
        .model(&plan.model.arm, elements, plan.model.link.kind)
        .expect("a model");
    let start = parameters
        .rest(&model, 0.7, plan.points[0].force.normal)
        .expect("a start");
    let arm = CompliantArm {
        model: &model,
        parameters,
        start: &start,
    };
    let arms = vec![arm; T::LANES];
    let plant = CompliantPlant::<T>::new(&arms, 2e-4, &[]).expect("a plant");
    bencher
        .with_inputs(|| plant.clone())
        .bench_values(|mut plant| {
            for point in plan.points.iter().take(5000) {
                plant.advance(point.torque.map(T::from_f64));
            }
            plant
        });
}

/// What a campaign does with as many arms as `T` has lanes for 2 s at 5 kHz ticks, one core: eight
/// elements on an ideal contact, sensors, counts, supervisor, drives. Lanes by time (s) times 2 s
/// are times real time.
#[divan::bench(types = [f64, F64x4])]
fn campaign_2_s<T: Lanes>(bencher: divan::Bencher<'_, '_>) {
    let plan = paper(2.0);
    let image = table_fit::fit_table(&plan).expect("a table").image;
    let law = config::parse_controller("example", config::PAPER_CONTROLLER).expect("valid");
    let board = config::parse_board("example", config::DEFAULT_BOARD).expect("valid");
    let task = BenchTask {
        plan: &plan,
        image: &image,
        law: &law,
        limits: &default_limits(&plan),
        monitors: &default_monitors(&plan, &law),
        board: &BenchBoard::from(&board.parameters),
        failure: &FailureLimits::default(),
        then: None,
    };
    let mut setup = BenchSetup::default();
    setup.plant.elements = 8;
    let arms = vec![setup.on_bench(&plan, 1).expect("an arm"); T::LANES];
    bencher.bench(|| bench::run::<T>(&task, &arms, |_, _, _| ()));
}

/// Plant, measurement, controller in f32 and log: 2 s at 5 kHz ticks, single thread.
#[divan::bench(args = [3, 8])]
fn run_2_s_in_closed_loop(bencher: divan::Bencher<'_, '_>, elements: usize) {
    let plan = paper(2.0);
    let image = table_fit::fit_table(&plan).expect("a table").image;
    let law = config::parse_controller("example", config::PAPER_CONTROLLER).expect("valid");
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
    let law = config::parse_controller("example", config::PAPER_CONTROLLER).expect("valid");
    let spread = config::parse_spread("example", config::DEFAULT_SPREAD).expect("valid");
    let plant = cases::plant(3, 1.0);
    let law = law.paper().expect("the example is the paper's law");
    bencher.bench(|| Report::new(&plan, &plant, &spread, law, 50, &|| ()));
}
