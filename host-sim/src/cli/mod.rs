//! The command line: reads files, calls the library, writes results.
//!
//! Exit codes: 0 the work was done (also when a simulated controller fails: that is a
//! result); 1 it could not be done (output not writable, a simulation that stopped
//! early); 2 the command line or a file is at fault; 3 the work was done, and its outcome is
//! not the one that was asked for (`--require-completed`); 130 ended by a signal.

mod accuracy;
mod bench;
#[cfg(feature = "target")]
mod board;
mod campaign;
#[cfg(feature = "target")]
mod connection;
mod demo;
mod error;
mod folder;
mod gains;
mod output;
mod own_gains;
#[cfg_attr(not(feature = "report"), path = "no_pages.rs")]
mod pages;
#[cfg(feature = "target")]
mod pil;
mod plan;
mod provenance;
mod run;
mod shell;
mod signals;
#[cfg(feature = "target")]
mod virtual_board;

#[cfg(feature = "target")]
use self::error::BoardError;
use self::error::CliError;
use self::folder::Output;
use self::output::{print, print_facts, progress_bar, results, say};
use crate::files::config;
use crate::files::config::{ArmConfig, BoardConfig};
use crate::model::arm_model::ArmModel;
use crate::planner::task::{PlanError, Task, Travel};
use clap::{Args, Parser, Subcommand, ValueEnum};
use flexor::control::{LawParameters, PaperParameters};
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// Plans an elastic arm's motion along a surface and simulates it under the firmware's
/// own controller.
#[derive(Parser)]
#[command(
    name = "flexor",
    version,
    after_help = "Without a command: demo.\n\nExample: flexor run --task examples/task_fast.toml --bending-stiffness-scale 0.9 --out out/soft"
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Runs the paper's task in all its cases and writes a report.
    #[command(
        after_help = "Example: flexor demo --out out/demo\n\nFour cases run the task as it is, with feedforward, feedback or both; the fifth runs its path in a fifth of the time, with pre- and post-actuation. The plants have the plan's number of elements. `flexor run` runs one case, with all options."
    )]
    Demo(demo::DemoArgs),
    /// Plans a task: joint angles, deflection and feedforward torques, and the table.
    #[command(
        after_help = "Example: flexor plan --arm examples/arm.toml --task examples/task_fast.toml --out out/plan\n\nWrites plan.csv, table.bin, summary.json, a figure and report.html."
    )]
    Plan(plan::PlanArgs),
    /// Plans a task and runs the controller on it against a simulated arm.
    #[command(
        after_help = "Example: flexor run --task examples/task_fast.toml --plant examples/plant_soft.toml --out out/run\n\nWrites run.csv, plan.csv, table.bin, summary.json, figures and report.html."
    )]
    Run(run::RunArgs),
    /// Runs the controller on thousands of arms as they are, and says how many fail, and why.
    #[command(
        after_help = "Example: flexor campaign --scenario examples/scenarios/bench.toml --runs 1000 --seed 1 --out out/campaign\n\nWrites runs.csv, runs.parquet, campaign.json, summary.json, figures and report.html. Exit code 3 if a limit of the scenario's [verdict] does not hold. An interrupted campaign goes on where it was, with the same results."
    )]
    Campaign(Box<campaign::CampaignArgs>),
    /// Says whether gains are stable over the whole motion, and with what margin.
    #[command(
        after_help = "Example: flexor gains --controller examples/controller_paper.toml --out out/gains\n\nWrites report.html, figures and summary.json. `flexor gains tune` finds gains."
    )]
    Gains(Box<gains::GainsArgs>),
    /// Compares the controller's number types with f64.
    #[command(
        after_help = "Example: flexor accuracy --out out/accuracy\n\nThe task in closed loop, random and adversarial measurements. Writes summary.json, accuracy.csv, figures and report.html."
    )]
    Accuracy(accuracy::AccuracyArgs),
    #[cfg(feature = "target")]
    /// As run, with the firmware's image in QEMU, or a board on a serial port, as the
    /// controller; every command is compared bit by bit with the simulator's own.
    #[command(
        after_help = "Example: flexor pil --task examples/task_fast.toml --plant examples/plant_soft.toml --out out/pil\n\n`cargo xtask setup` installs QEMU, `cargo xtask firmware` builds the image. Writes what run writes. The firmware's log goes to standard error. Exit code 1 if a command differs."
    )]
    Pil(pil::PilArgs),
    #[cfg(feature = "target")]
    /// Talks to a board on a serial port, or to the firmware's image in QEMU: who it is, what
    /// its sensors say, enable, disable.
    #[command(
        after_help = "Example: flexor board sensors --port /dev/ttyUSB0 --follow\n\nWithout --port the image in QEMU, whose stop reads as pressed. The firmware's log goes to standard error. Exit codes: 0 done; 1 refused, failed, or stopped before the table's end; 2 command line, port or image at fault."
    )]
    Board(board::BoardArgs),
    /// Prints what a shell needs to complete this program's commands and options.
    #[command(
        after_help = "Example: flexor completions bash > ~/.local/share/bash-completion/completions/flexor"
    )]
    Completions(shell::CompletionsArgs),
    /// Writes manual pages, one a command.
    #[command(after_help = "Example: flexor man --out ~/.local/share/man/man1")]
    Man(shell::ManArgs),
    #[cfg(feature = "target")]
    /// A board before a simulated arm, for `flexor board` and other programs: the firmware's own
    /// supervisor and answers, on a pseudo-terminal or on TCP. Prints where, and runs until Ctrl-C.
    #[command(
        after_help = "Example: flexor virtual-board --scenario examples/scenarios/approach.toml --listen 127.0.0.1:7070\n\nThen, from another terminal: flexor board home --port tcp://127.0.0.1:7070, and flexor board enable. Home puts the arm to where the scenario starts."
    )]
    VirtualBoard(Box<virtual_board::VirtualBoardArgs>),
}

/// Files and places that every command takes.
#[derive(Args, Clone, Default)]
struct Common {
    /// The arm; without it the paper's [examples/arm.toml]
    #[arg(long, value_name = "FILE")]
    arm: Option<PathBuf>,
    /// The task; without it the paper's [examples/task.toml]
    #[arg(long, value_name = "FILE")]
    task: Option<PathBuf>,
    /// The board, whose control rate the plan has and whose drives must give its torques;
    /// without it the rate is that of the default one [boards/stm32f405.toml]
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
    /// Control rate, Hz; without it the board's
    #[arg(long, value_name = "HZ",
          value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    tick_rate_hz: Option<u32>,
    /// Equations to plan with: all of them, or as the paper prints them
    #[arg(long, value_enum, default_value_t = ModelArg::Exact)]
    model: ModelArg,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum ModelArg {
    #[default]
    Exact,
    AsPrinted,
}

/// Runs the process's command line; its exit code.
pub fn main() -> u8 {
    run(std::env::args_os())
}

/// Runs a command line, the program's name first; the exit code. Ends the process where
/// the command line is not understood, or asks for help.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    provenance::remember(&arguments);
    let result = match Cli::parse_from(arguments).command {
        None => {
            // As if typed, so that the defaults have one place.
            match Cli::parse_from(["flexor", "demo"]).command {
                Some(Command::Demo(args)) => demo::demo(&args),
                _ => Ok(()),
            }
        }
        Some(Command::Demo(args)) => demo::demo(&args),
        Some(Command::Plan(args)) => plan::plan_command(&args),
        Some(Command::Run(args)) => run::run_command(&args),
        Some(Command::Campaign(args)) => campaign::campaign(&args),
        Some(Command::Gains(args)) => gains::command(&args),
        Some(Command::Accuracy(args)) => accuracy::accuracy(&args),
        #[cfg(feature = "target")]
        Some(Command::Pil(args)) => pil::pil_command(&args),
        #[cfg(feature = "target")]
        Some(Command::Board(args)) => board::board(&args),
        Some(Command::Completions(args)) => shell::completions(&args),
        Some(Command::Man(args)) => shell::man(&args),
        #[cfg(feature = "target")]
        Some(Command::VirtualBoard(args)) => virtual_board::virtual_board(&args),
    };
    match result {
        Ok(()) => 0,
        // A reader that has seen enough, such as head(1), is no failure.
        Err(CliError::Stdout(e)) if e.kind() == io::ErrorKind::BrokenPipe => 0,
        Err(error) => {
            say(format_args!("error: {error}"));
            error.exit_code()
        }
    }
}

impl Common {
    /// The files that are read.
    fn inputs(&self) -> [Option<&Path>; 3] {
        [&self.arm, &self.task, &self.board].map(|file| file.as_deref())
    }

    fn load(&self) -> Result<(ArmConfig, Task), CliError> {
        let arm = config::load(self.arm.as_deref(), config::DEFAULT_ARM, config::parse_arm)?;
        let of_move = config::load(
            self.task.as_deref(),
            config::DEFAULT_TASK,
            config::parse_move,
        )?;
        let task = match of_move {
            Some(of_move) => {
                let model = ArmModel::of_kind(&arm.arm, arm.elements, arm.link);
                of_move.task(&model.map_err(PlanError::from)?)?
            }
            None => config::load(
                self.task.as_deref(),
                config::DEFAULT_TASK,
                config::parse_task,
            )?,
        };
        Ok((arm, task))
    }

    /// As [`load`](Self::load), for `what`, which knows no move through the air.
    fn load_on_surface(&self, what: &'static str) -> Result<(ArmConfig, Task), CliError> {
        let (arm, task) = self.load()?;
        match task.travel {
            Travel::Line => Ok((arm, task)),
            Travel::Joints(_) => Err(CliError::Move { what }),
        }
    }

    /// The board: the file's, or without one the default.
    fn board(&self) -> Result<BoardConfig, CliError> {
        Ok(config::load(
            self.board.as_deref(),
            config::DEFAULT_BOARD,
            config::parse_board,
        )?)
    }
}

/// As [`controller`], for `command`, which knows the paper's law alone.
fn paper_law(command: &'static str, file: Option<&Path>) -> Result<PaperParameters, CliError> {
    let law = controller(file, config::PAPER_CONTROLLER)?;
    law.paper().copied().ok_or(CliError::PaperLawOnly {
        command,
        law: law.name(),
    })
}

/// Gains and options of the law: the file's, or without one those of the example `default`.
fn controller(file: Option<&Path>, default: &str) -> Result<LawParameters, CliError> {
    Ok(config::load(file, default, config::parse_controller)?)
}
