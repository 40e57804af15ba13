//! What an image is built for: arm, task and gains, by default those in examples/.

use anyhow::{Context, Result, ensure};
use clap::Args;
use flexor::supervisor::{ControllerParameters, check_torque_bound};
use flexor::table::Table;
use flexor_sim::files::config;
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::{Plan, PlanOptions, plan};
use flexor_sim::planner::table_fit::{EncodedTable, fit_table};
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::closed_loop::RunOptions;
use flexor_sim::simulation::start::Start;
use flexor_sim::target::SLOT_BYTES;
use std::path::PathBuf;

/// The control rate of the firmware's timer, Hz: `TICK_RATE_HZ` of
/// `firmware/src/board/stm32f405/constants.rs`.
pub(crate) const TICK_RATE_HZ: u32 = 5000;

/// The files that an image is built from.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Files {
    /// The arm; without it examples/arm.toml.
    #[arg(long, value_name = "FILE")]
    arm: Option<PathBuf>,
    /// The task, whose table goes into slot A; without it examples/task.toml.
    #[arg(long, value_name = "FILE")]
    task: Option<PathBuf>,
    /// Gains; without it examples/controller.toml.
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
}

/// A plan, its table, and what the image is set up with for it.
pub(crate) struct Demo {
    /// The plan.
    pub(crate) plan: Plan,
    /// Its table.
    pub(crate) table: EncodedTable,
    /// Arm, gains and limits.
    pub(crate) setup: ControllerParameters,
}

/// The example task, planned.
pub(crate) fn demo() -> Result<Demo> {
    plan_files(&Files::default())
}

/// The files' task, planned for the files' arm at the firmware's control rate.
pub(crate) fn plan_files(files: &Files) -> Result<Demo> {
    let arm = config::load(files.arm.as_deref(), config::DEFAULT_ARM, config::parse_arm)?;
    let law = config::load(
        files.controller.as_deref(),
        config::DEFAULT_CONTROLLER,
        config::parse_controller,
    )?;
    let task = config::load(
        files.task.as_deref(),
        config::DEFAULT_TASK,
        config::parse_task,
    )?;
    let options = PlanOptions {
        elements: arm.elements,
        tick_rate_hz: TICK_RATE_HZ,
        ..PlanOptions::default()
    };
    let plan = plan(&arm.arm, &task, &options)?;
    let limits = arm.limits.unwrap_or_else(|| default_limits(&plan));
    let table = fit_table(&plan)?;
    // As the board does before it enables, where the drives may allow less.
    check_torque_bound(Table::open(&table.image)?.torque_bound(), &limits)
        .context("limits.torque_Nm: a longer duration_s may need less")?;
    let bytes = table.image.len();
    ensure!(
        bytes <= SLOT_BYTES,
        "the table has {bytes} bytes, a slot takes {SLOT_BYTES}: a shorter duration_s is accepted"
    );
    let setup = ControllerParameters {
        arm: arm.arm,
        law,
        limits,
    };
    Ok(Demo { plan, table, setup })
}

/// How the demo runs: against an arm of a tenth less stiffness, so that the feedback
/// has work to do.
pub(crate) fn options(setup: &ControllerParameters) -> RunOptions {
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn example(name: &str) -> Option<PathBuf> {
        Some(crate::root().join("examples").join(name))
    }

    #[test]
    fn without_files_it_is_the_examples() {
        let default = demo().unwrap();
        let files = Files {
            arm: example("arm.toml"),
            task: example("task.toml"),
            controller: example("controller.toml"),
        };
        let named = plan_files(&files).unwrap();
        assert_eq!(default.setup, named.setup);
        assert!(default.table.image == named.table.image);
        assert_eq!(default.plan.tick_rate_hz, TICK_RATE_HZ);
    }

    /// The message for files of which one is `text`.
    fn refusal(name: &str, text: &str, files: fn(PathBuf) -> Files) -> String {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(name);
        std::fs::write(&file, text).unwrap();
        let Err(error) = plan_files(&files(file)) else {
            panic!("{name} was accepted");
        };
        format!("{error:#}")
    }

    #[test]
    fn bad_files_and_tables_that_do_not_fit_are_named() {
        let task = |task: PathBuf| Files {
            task: Some(task),
            ..Files::default()
        };
        let arm = |arm: PathBuf| Files {
            arm: Some(arm),
            ..Files::default()
        };
        let bad = config::DEFAULT_TASK.replacen("duration_s = 2.0", "duration_s = -2.0", 1);
        let words = refusal("bad_task.toml", &bad, task);
        assert!(
            words.contains("bad_task.toml") && words.contains("duration_s = -2"),
            "{words}"
        );
        let limits = "[limits]\ntorque_Nm = [5.0, 1.0]\ntorque_rate_Nm_s = [1e4, 1e4]\n";
        let weak = format!("{}\n{limits}", config::DEFAULT_ARM);
        let words = refusal("weak_arm.toml", &weak, arm);
        assert!(
            words.contains("limits.torque_Nm") && words.contains("allow [5.0, 1.0]"),
            "{words}"
        );
        let missing = plan_files(&arm(Path::new("/nowhere/arm.toml").into()));
        let words = missing.err().unwrap().to_string();
        assert!(words.contains("/nowhere/arm.toml"), "{words}");
    }

    #[test]
    fn the_rate_is_the_firmwares() {
        let file = crate::root().join("firmware/src/board/stm32f405/constants.rs");
        let text = std::fs::read_to_string(file).unwrap();
        let stated = text
            .lines()
            .find_map(|line| line.strip_prefix("pub const TICK_RATE_HZ: u32 = "))
            .unwrap();
        let digits = stated.trim_end_matches(';').replace('_', "");
        assert_eq!(digits.parse(), Ok(TICK_RATE_HZ));
    }
}
