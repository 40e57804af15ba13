//! How many times faster than real time a campaign's arms advance on one core, over the number of
//! elements and the contact's stiffness, one at a time and four side by side, with everything that
//! a board does in the loop: `cargo run --release --example bench_speed -- docs/bench_speed.svg`.

use flexor_sim::campaign::setup::BenchSetup;
use flexor_sim::files::config::{
    DEFAULT_ARM, DEFAULT_BOARD, DEFAULT_TASK, PAPER_CONTROLLER, parse_arm, parse_board,
    parse_controller, parse_task,
};
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::monitors::default_monitors;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit::fit_table;
use flexor_sim::plant::bench::F64x4;
use flexor_sim::plant::bench::lanes::Lanes;
use flexor_sim::simulation::bench::{self, BenchBoard, BenchTask, FailureLimits};
use plotters::prelude::*;
use std::time::Instant;

/// Arms in one go, whatever the lanes.
const ARMS: usize = 4;

/// Runs of which the fastest counts.
const TRIES: usize = 5;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let arm = parse_arm("arm.toml", DEFAULT_ARM)?.arm;
    let task = parse_task("task.toml", DEFAULT_TASK)?;
    let law = parse_controller("controller.toml", PAPER_CONTROLLER)?;
    let plan = plan(&arm, &task, &PlanOptions::default())?;
    let image = fit_table(&plan)?.image;
    let board = BenchBoard::from(&parse_board("board.toml", DEFAULT_BOARD)?.parameters);
    let task = BenchTask {
        plan: &plan,
        image: &image,
        law: &law,
        limits: &default_limits(&plan),
        monitors: &default_monitors(&plan, &law),
        board: &board,
        failure: &FailureLimits::default(),
        then: None,
    };
    let setup = |elements: f64, stiffness_n_m: f64| {
        let mut setup = BenchSetup::default();
        setup.plant.elements = elements as usize;
        setup.compliant.contact.stiffness_n_m = stiffness_n_m;
        setup
    };
    let elements = [2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0];
    let stiffness = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6];
    let over_elements = measure(&task, &elements, |x| setup(x, 2e4), "elements, 2e4 N/m")?;
    let over_stiffness = measure(&task, &stiffness, |x| setup(8.0, x), "N/m, 8 elements")?;
    if let Some(file) = std::env::args().nth(1) {
        draw(&file, &over_elements, &over_stiffness)?;
    }
    Ok(())
}

/// What was measured at an abscissa: times real time one at a time, and side by side.
type Point = (f64, [f64; 2]);

fn measure(
    task: &BenchTask<'_>,
    at: &[f64],
    setup: impl Fn(f64) -> BenchSetup,
    what: &str,
) -> Result<Vec<Point>> {
    println!("{what:>20}  one at a time  four side by side, times real time");
    at.iter()
        .map(|x| {
            let setup = setup(*x);
            let speeds = [speed::<f64>(task, &setup)?, speed::<F64x4>(task, &setup)?];
            println!("{x:>20}  {:13.0}  {:17.0}", speeds[0], speeds[1]);
            Ok((*x, speeds))
        })
        .collect()
}

/// Simulated time of all arms over the time that it takes.
fn speed<T: Lanes>(task: &BenchTask<'_>, setup: &BenchSetup) -> Result<f64> {
    let plan: &Plan = task.plan;
    let arms = vec![setup.on_bench(plan, 1)?; ARMS];
    let mut least_s = f64::INFINITY;
    for _ in 0..TRIES {
        let since = Instant::now();
        for some in arms.chunks(T::LANES) {
            std::hint::black_box(bench::run::<T>(task, some, |_, _, _| ())?);
        }
        least_s = least_s.min(since.elapsed().as_secs_f64());
    }
    let simulated_s = ARMS as f64 * plan.points.len() as f64 / f64::from(plan.tick_rate_hz);
    Ok(simulated_s / least_s)
}

fn draw(file: &str, over_elements: &[Point], over_stiffness: &[Point]) -> Result<()> {
    let root = SVGBackend::new(file, (900, 380)).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(450);
    let top = 1.1 * over_elements.iter().fold(0.0_f64, |m, p| m.max(p.1[1]));
    let mut chart = ChartBuilder::on(&left)
        .caption("contact of 2e4 N/m", ("sans-serif", 15))
        .margin(12)
        .x_label_area_size(38)
        .y_label_area_size(52)
        .build_cartesian_2d(1.0..13.0, 0.0..top)?;
    chart
        .configure_mesh()
        .x_desc("elements of link 2")
        .y_desc("times real time, one core")
        .light_line_style(TRANSPARENT)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .draw()?;
    for (i, (colour, name)) in SERIES.iter().enumerate() {
        let points = over_elements.iter().map(|p| (p.0, p.1[i]));
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)).point_size(3))?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .border_style(BLACK.mix(0.3))
        .background_style(WHITE)
        .draw()?;
    let top = 1.1 * over_stiffness.iter().fold(0.0_f64, |m, p| m.max(p.1[1]));
    let mut chart = ChartBuilder::on(&right)
        .caption("8 elements", ("sans-serif", 15))
        .margin(12)
        .x_label_area_size(38)
        .y_label_area_size(52)
        .build_cartesian_2d((8e2..1.2e6).log_scale(), 0.0..top)?;
    chart
        .configure_mesh()
        .x_desc("stiffness of the contact, N/m")
        .light_line_style(TRANSPARENT)
        .x_label_formatter(&|x| format!("{x:.0e}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .draw()?;
    for (i, (colour, _)) in SERIES.iter().enumerate() {
        let points = over_stiffness.iter().map(|p| (p.0, p.1[i]));
        chart.draw_series(LineSeries::new(points, colour.stroke_width(2)).point_size(3))?;
    }
    root.present()?;
    Ok(())
}

/// Colours (Okabe and Ito) and names of the two ways.
const SERIES: [(RGBColor, &str); 2] = [
    (RGBColor(213, 94, 0), "one at a time"),
    (RGBColor(0, 114, 178), "four side by side"),
];
