//! What an image is built for: board, arm, task and gains, by default those in boards/ and
//! examples/.

use crate::{announce, root};
use anyhow::{Context, Result, ensure};
use clap::Args;
use flexor::control::LimitParameters;
use flexor::supervisor::{BoardParameters, ControllerParameters, check_torque_bound};
use flexor::table::Table;
use flexor_sim::files::config::{self, BoardConfig};
use flexor_sim::planner::limits::default_limits;
use flexor_sim::planner::plan::{Plan, PlanOptions};
use flexor_sim::planner::planning::plan;
use flexor_sim::planner::table_fit::{EncodedTable, fit_table};
use flexor_sim::plant::PlantParameters;
use flexor_sim::simulation::closed_loop::RunOptions;
use flexor_sim::simulation::start::Start;
use flexor_sim::target::SLOT_BYTES;
use std::fs;
use std::path::PathBuf;

/// The files that an image is built from.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Files {
    /// The board; without it boards/stm32f405.toml.
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
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
    /// The board.
    pub(crate) board: BoardConfig,
}

impl Files {
    /// The board: the file's, or without one the default. The firmware must have it.
    pub(crate) fn board(&self) -> Result<BoardConfig> {
        let board = config::load(
            self.board.as_deref(),
            config::DEFAULT_BOARD,
            config::parse_board,
        )?;
        let boards = firmware_boards()?;
        let name = &board.name;
        ensure!(
            boards.contains(name),
            "name = {name:?}: no such board in firmware/src/board; accepted: {}",
            boards.join(", ")
        );
        Ok(board)
    }
}

/// Names of the boards that the firmware has sources for.
fn firmware_boards() -> Result<Vec<String>> {
    let folder = root().join("firmware/src/board");
    let entries = fs::read_dir(&folder);
    let entries = entries.with_context(|| format!("cannot read {}", folder.display()))?;
    let mut names = vec![];
    for entry in entries {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// The example task, planned.
pub(crate) fn demo() -> Result<Demo> {
    plan_files(&Files::default())
}

/// The files' task, planned for the files' arm at the board's control rate.
pub(crate) fn plan_files(files: &Files) -> Result<Demo> {
    let board = files.board()?;
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
        tick_rate_hz: board.parameters.tick_rate_hz,
        link: arm.link,
        ..PlanOptions::default()
    };
    let plan = plan(&arm.arm, &task, &options)?;
    let limits = arm.limits.unwrap_or_else(|| default_limits(&plan));
    let name = files.arm.as_ref().map(|file| file.display().to_string());
    let name = name.as_deref().unwrap_or("arm");
    let monitors = arm.monitors.checked(name, &plan, &law)?;
    let table = fit_table(&plan)?;
    check_torques(files, &board.parameters, &limits, &table.image)?;
    let bytes = table.image.len();
    ensure!(
        bytes <= SLOT_BYTES,
        "the table has {bytes} bytes, a slot takes {SLOT_BYTES}: a shorter duration_s is accepted"
    );
    // As `flexor` has them: the limits of a board that was named are in the settings' checksum.
    let limits = match &files.board {
        Some(_) => limits.at_most(board.parameters.drive_limit_nm()),
        None => limits,
    };
    let setup = ControllerParameters {
        arm: arm.arm,
        law,
        limits,
        monitors,
    };
    Ok(Demo {
        plan,
        table,
        setup,
        board,
    })
}

/// Checks as the board does before it enables: the arm's limits and, of a board that was named,
/// the drives' must bear the table. The default board may be the wrong one for an arm; then it is
/// only said.
fn check_torques(
    files: &Files,
    board: &BoardParameters,
    limits: &LimitParameters,
    image: &[u8],
) -> Result<()> {
    let bound = Table::open(image)?.torque_bound();
    check_torque_bound(bound, limits)
        .context("limits.torque_Nm: a longer duration_s may need less")?;
    let drives = check_torque_bound(bound, &limits.at_most(board.drive_limit_nm()));
    match (drives, &files.board) {
        (Ok(()), _) => Ok(()),
        (Err(refusal), Some(file)) => Err(refusal).with_context(|| {
            let file = file.display();
            format!("{file}: drives.full_scale_Nm: a longer duration_s may need less")
        }),
        (Err(refusal), None) => {
            announce(&format!("the board will not enable this arm: {refusal}"));
            Ok(())
        }
    }
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
        Some(root().join("examples").join(name))
    }

    #[test]
    fn without_files_it_is_the_examples() {
        let default = demo().unwrap();
        let files = Files {
            board: Some(root().join("boards/stm32f405.toml")),
            arm: example("arm.toml"),
            task: example("task.toml"),
            controller: example("controller.toml"),
        };
        let named = plan_files(&files).unwrap();
        assert_eq!(default.setup, named.setup);
        assert!(default.table.image == named.table.image);
        assert_eq!(default.board, named.board);
        assert_eq!(
            default.plan.tick_rate_hz,
            default.board.parameters.tick_rate_hz
        );
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
        let board = |board: PathBuf| Files {
            board: Some(board),
            ..Files::default()
        };
        let weak = config::DEFAULT_BOARD.replacen("[40.0, 4.0]", "[12.0, 4.0]", 1);
        let words = refusal("weak_board.toml", &weak, board);
        assert!(
            words.contains("weak_board.toml: drives.full_scale_Nm")
                && words.contains("allow [10.5454"),
            "{words}"
        );
        let name = r#"name = "stm32f405""#;
        let other = config::DEFAULT_BOARD.replacen(name, r#"name = "unheard_of""#, 1);
        let words = refusal("other_board.toml", &other, board);
        assert!(
            words.contains("name = \"unheard_of\"") && words.contains("accepted: stm32f405"),
            "{words}"
        );
        let missing = plan_files(&arm(Path::new("/nowhere/arm.toml").into()));
        let words = missing.err().unwrap().to_string();
        assert!(words.contains("/nowhere/arm.toml"), "{words}");
    }
}
