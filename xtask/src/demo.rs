//! What the default image is built for: the examples' arm, task and gains.

use anyhow::Result;
use host_sim::cases;
use host_sim::closed_loop::RunOptions;
use host_sim::config;
use host_sim::knots::{EncodedTable, encode};
use host_sim::plan::{Plan, PlanOptions, plan};
use host_sim::plant::{PlantParameters, Start};
use shared::link::Setup;

/// A plan, its table, and what the image is set up with for it.
pub(crate) struct Demo {
    /// The plan.
    pub(crate) plan: Plan,
    /// Its table.
    pub(crate) table: EncodedTable,
    /// Arm, gains and limits.
    pub(crate) setup: Setup,
}

/// The example task, planned.
pub(crate) fn demo() -> Result<Demo> {
    let arm = config::parse_arm("examples/arm.toml", config::DEFAULT_ARM)?;
    let law = config::parse_controller("examples/controller.toml", config::DEFAULT_CONTROLLER)?;
    let task = config::parse_task("examples/task.toml", config::DEFAULT_TASK)?;
    let options = PlanOptions {
        elements: arm.elements,
        ..PlanOptions::default()
    };
    let plan = plan(&arm.arm, &task, &options)?;
    let setup = Setup {
        arm: arm.arm,
        law,
        limits: arm.limits.unwrap_or_else(|| cases::default_limits(&plan)),
    };
    let table = encode(&plan)?;
    Ok(Demo { plan, table, setup })
}

/// How the demo runs: against an arm of a tenth less stiffness, so that the feedback
/// has work to do.
pub(crate) fn options(setup: &Setup) -> RunOptions {
    RunOptions {
        law: setup.law,
        limits: setup.limits,
        plant: PlantParameters {
            bending_stiffness_scale: 0.9,
            ..PlantParameters::default()
        },
        start: Start::Equilibrium,
    }
}
