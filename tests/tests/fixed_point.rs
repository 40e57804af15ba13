//! The tick in fixed point: how exact it is, and that nothing wraps.

use host_sim::accuracy::measure;
use host_sim::cases::{self, Mode};
use host_sim::closed_loop::RunOptions;
use host_sim::config;
use host_sim::plan::Plan;
use host_sim::plant::Start;
use host_sim::ranges;
use shared::law::LawParameters;
use tests::{paper_arm, paper_task, planned};

fn law() -> LawParameters {
    config::parse_controller("example", config::DEFAULT_CONTROLLER).unwrap()
}

fn options(plan: &Plan) -> RunOptions {
    RunOptions {
        law: Mode::Proposed.of(&law()),
        limits: cases::default_limits(plan),
        plant: cases::plant(plan.model.elements, 0.9),
        start: Start::PlanAtRest,
    }
}

#[test]
fn play() {
    let (plan, table) = planned(&paper_arm(), &paper_task());
    let options = options(&plan);
    let a = ranges::analyse(&plan, &table.image, &options.law, &options.limits).unwrap();
    println!("{a:#?}");
    for a in measure(&plan, &table.image, &options).unwrap() {
        println!(
            "{} {:?}\n{:?}\n{:?} df {} bits {}",
            a.number,
            a.closed_loop,
            a.random,
            a.adversarial,
            a.force_difference_max_n,
            a.effective_bits
        );
    }
}
