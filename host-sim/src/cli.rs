//! The command line: reads files, calls the library, writes results.
//!
//! Exit codes: 0 the work was done (also when a simulated controller fails: that is a
//! result); 1 it could not be done (output not writable, a simulation that stopped
//! early); 2 the command line or a file is at fault.

mod accuracy;
mod board;
mod demo;
mod gains;
mod plan;
mod run;

use self::run::{Simulation, SimulationArgs};
use crate::accuracy::AccuracyError;
use crate::closed_loop::{Outcome, Run, RunError};
use crate::config::{self, ArmConfig, ConfigError};
use crate::export;
use crate::knots::EncodeError;
use crate::message::{Short, enough, near};
use crate::pil::{self, PilError, PilRun};
use crate::plan::{PlanError, Task};
use crate::processor::{Processor, ProcessorError};
use crate::ranges::RangeError;
use crate::report;
use crate::stability::StabilityError;
use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};
use shared::law::LawParameters;
use shared::link::Setup;
use shared::table::TableError;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Plans an elastic arm's motion along a surface and simulates it under the firmware's
/// own controller.
#[derive(Parser)]
#[command(
    name = "host-sim",
    version,
    after_help = "Without a command: demo.\n\nExample: host-sim run --task examples/task_fast.toml --bending-stiffness-scale 0.9 --out out/soft"
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Runs the paper's task in all its cases and writes a report.
    #[command(
        after_help = "Example: host-sim demo --out out/demo\n\nFour cases run the task as it is, with feedforward, feedback or both; the fifth runs its path in a fifth of the time, with pre- and post-actuation. The plants have the plan's number of elements. `host-sim run` runs one case, with all options."
    )]
    Demo(demo::DemoArgs),
    /// Plans a task: joint angles, deflection and feedforward torques, and the table.
    #[command(
        after_help = "Example: host-sim plan --arm examples/arm.toml --task examples/task_fast.toml --out out/plan\n\nWrites plan.csv, table.bin and summary.json."
    )]
    Plan(plan::PlanArgs),
    /// Plans a task and runs the controller on it against a simulated arm.
    #[command(
        after_help = "Example: host-sim run --task examples/task_fast.toml --plant examples/plant_soft.toml --out out/run\n\nWrites run.csv, plan.csv, table.bin, summary.json, figures and report.html."
    )]
    Run(run::RunArgs),
    /// Says whether gains are stable over the whole motion, and with what margin.
    #[command(
        after_help = "Example: host-sim gains --controller examples/controller.toml --out out/gains\n\nWrites report.html, figures and summary.json. `host-sim gains tune` finds gains."
    )]
    Gains(Box<gains::GainsArgs>),
    /// Compares the controller's number types with f64.
    #[command(
        after_help = "Example: host-sim accuracy --out out/accuracy\n\nThe task in closed loop, random and adversarial measurements. Writes summary.json, accuracy.csv, figures and report.html."
    )]
    Accuracy(accuracy::AccuracyArgs),
    /// As run, with the firmware's image in QEMU, or a board on a serial port, as the
    /// controller; every command is compared bit by bit with the simulator's own.
    #[command(
        after_help = "Example: host-sim pil --task examples/task_fast.toml --plant examples/plant_soft.toml --out out/pil\n\n`cargo xtask setup` installs QEMU, `cargo xtask firmware` builds the image. Writes what run writes. The firmware's log goes to standard error. Exit code 1 if a command differs."
    )]
    Pil(PilArgs),
    /// Talks to a board on a serial port, or to the firmware's image in QEMU: who it is, what
    /// its sensors say, arm, disarm.
    #[command(
        after_help = "Example: host-sim board sensors --port /dev/ttyUSB0 --follow\n\nWithout --port the image in QEMU, whose stop reads as pressed. The firmware's log goes to standard error. Exit codes: 0 done; 1 refused, failed, or stopped before the table's end; 2 command line, port or image at fault."
    )]
    Board(board::BoardArgs),
}

/// Files and places that every command takes.
#[derive(Args)]
struct Common {
    /// The arm; without it the paper's [examples/arm.toml]
    #[arg(long, value_name = "FILE")]
    arm: Option<PathBuf>,
    /// The task; without it the paper's [examples/task.toml]
    #[arg(long, value_name = "FILE")]
    task: Option<PathBuf>,
    /// Control rate, Hz
    #[arg(long, value_name = "HZ", default_value_t = config::DEFAULT_TICK_RATE_HZ,
          value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    tick_rate_hz: u32,
    /// Equations to plan with: all of them, or as the paper prints them
    #[arg(long, value_enum, default_value_t = ModelArg::Exact)]
    model: ModelArg,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct PilArgs {
    #[command(flatten)]
    simulation: SimulationArgs,
    #[command(flatten)]
    connection: board::ConnectionArgs,
    /// After the run compare this many measurements of arbitrary bits
    #[arg(long, value_name = "N", default_value_t = 0)]
    random: u32,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/pil")]
    out: PathBuf,
}

#[derive(Clone, Copy, ValueEnum)]
enum ModelArg {
    Exact,
    AsPrinted,
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
enum CliError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("limits.torque_Nm[{}] = {}; accepted: from {} on, as the planned torque of joint {joint} reaches {} N m at t = {t_s:.4} s; a longer duration_s may need less", joint - 1, Short(*limit_nm), enough(*torque_nm), near(*torque_nm))]
    Limit {
        joint: usize,
        t_s: f64,
        torque_nm: f64,
        limit_nm: f64,
    },
    #[error("{}: {source}", file.display())]
    Table { file: PathBuf, source: TableError },
    #[error("{}: the table has {found}, this task has {expected}: plan it again", file.display())]
    OtherTask {
        file: PathBuf,
        found: String,
        expected: String,
    },
    #[error("{}: cannot be read: {cause}", file.display())]
    Unreadable { file: PathBuf, cause: io::Error },
    #[error("{}: cannot be written: {cause}", file.display())]
    Unwritable { file: PathBuf, cause: io::Error },
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Range(#[from] RangeError),
    #[error(transparent)]
    Report(#[from] report::ReportError),
    #[error(transparent)]
    Stability(#[from] StabilityError),
    #[error("--at {}; accepted: a time of the plan from {} to {} s", Short(*at_s), Short(*start_s), Short(*end_s))]
    At { at_s: f64, start_s: f64, end_s: f64 },
    #[error("--map {gain} {gain}; accepted: two different gains")]
    Map { gain: String },
    #[error("{what} has no effect {beside}")]
    NoEffect {
        what: &'static str,
        beside: &'static str,
    },
    #[error(
        "demo's fast case, the task in a fifth of its duration_s, cannot be planned: {0}; `host-sim run` runs a task as it is"
    )]
    Fast(Box<CliError>),
    #[error("{what} {}; accepted: from 0 to {}", Short(*value), Short(*most))]
    Margin {
        what: &'static str,
        value: f64,
        most: f64,
    },
    #[error(transparent)]
    Encode(#[from] EncodeError),
    #[error("the simulation stopped at t = {t_s:.4} s: {}; the results up to there are in {}", outcome.name(), out.display())]
    Stopped {
        t_s: f64,
        outcome: Outcome,
        out: PathBuf,
    },
    #[error(transparent)]
    Pil(#[from] PilError),
    #[error(transparent)]
    Board(#[from] board::BoardError),
    #[error(
        "{differing} of {ticks} commands differ from the simulator's, the first at tick {first}"
    )]
    Differs {
        differing: usize,
        ticks: usize,
        first: usize,
    },
    #[error(
        "{differing} of {count} commands for arbitrary measurements differ from the simulator's"
    )]
    RandomDiffers { differing: u32, count: u32 },
    #[error("standard output: {0}")]
    Stdout(io::Error),
}

impl From<AccuracyError> for CliError {
    fn from(error: AccuracyError) -> Self {
        match error {
            AccuracyError::Range(error) => Self::Range(error),
            AccuracyError::Run(error) => Self::Run(error),
        }
    }
}

impl CliError {
    /// 2 where the user's input is at fault, 1 elsewhere.
    fn exit_code(&self) -> u8 {
        match self {
            Self::Config(_)
            | Self::Plan(_)
            | Self::Limit { .. }
            | Self::Table { .. }
            | Self::OtherTask { .. }
            | Self::Unreadable { .. }
            | Self::At { .. }
            | Self::Map { .. }
            | Self::NoEffect { .. }
            | Self::Margin { .. }
            | Self::Range(_)
            | Self::Encode(EncodeError::Inexact { .. })
            | Self::Run(_)
            | Self::Pil(
                PilError::TickRate { .. }
                | PilError::OtherTable { .. }
                | PilError::Run(_)
                | PilError::Processor(
                    ProcessorError::NoImage { .. }
                    | ProcessorError::NoLogTable { .. }
                    | ProcessorError::TableTooLong { .. }
                    | ProcessorError::Port { .. }
                    | ProcessorError::Refused(_),
                ),
            ) => 2,
            Self::Board(error) => error.exit_code(),
            // No gains found, or the optimiser's failure, is none of the user's.
            Self::Stability(StabilityError::NotTuned { .. } | StabilityError::Optimiser(_)) => 1,
            Self::Stability(_) => 2,
            Self::Unwritable { .. }
            | Self::Report(_)
            | Self::Encode(EncodeError::Format(_))
            | Self::Stopped { .. }
            | Self::Pil(_)
            | Self::Differs { .. }
            | Self::RandomDiffers { .. }
            | Self::Stdout(_) => 1,
            Self::Fast(error) => error.exit_code(),
        }
    }
}

/// Runs the process's command line; its exit code.
pub fn main() -> u8 {
    run(std::env::args_os())
}

/// Runs a command line, the program's name first; the exit code. Ends the process where
/// the command line is not understood, or asks for help.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let result = match Cli::parse_from(arguments).command {
        None => {
            // As if typed, so that the defaults have one place.
            match Cli::parse_from(["host-sim", "demo"]).command {
                Some(Command::Demo(args)) => demo::demo(&args),
                _ => Ok(()),
            }
        }
        Some(Command::Demo(args)) => demo::demo(&args),
        Some(Command::Plan(args)) => plan::plan_command(&args),
        Some(Command::Run(args)) => run::run_command(&args),
        Some(Command::Gains(args)) => gains::command(&args),
        Some(Command::Accuracy(args)) => accuracy::accuracy(&args),
        Some(Command::Pil(args)) => pil_command(&args),
        Some(Command::Board(args)) => board::board(&args),
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

/// Writes a line to standard error; if nobody is there to read it, that is no failure.
fn say(line: impl std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// A progress bar on standard error, where that is a terminal; `words` follow its numbers.
fn progress_bar(length: u64, words: &str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template(&format!("{{bar:30}} {{pos}}/{{len}} {words}"))
    {
        bar.set_style(style);
    }
    bar
}

impl Common {
    fn load(&self) -> Result<(ArmConfig, Task), CliError> {
        let arm = config::load(self.arm.as_deref(), config::DEFAULT_ARM, config::parse_arm)?;
        let task = config::load(
            self.task.as_deref(),
            config::DEFAULT_TASK,
            config::parse_task,
        )?;
        Ok((arm, task))
    }
}

/// Writes files into a folder, making it first.
struct Output<'a> {
    folder: &'a Path,
}

impl<'a> Output<'a> {
    fn new(folder: &'a Path) -> Result<Self, CliError> {
        std::fs::create_dir_all(folder).map_err(|cause| CliError::Unwritable {
            file: folder.to_path_buf(),
            cause: match cause.kind() {
                // "File exists" would not say what is wrong with that.
                io::ErrorKind::AlreadyExists => io::ErrorKind::NotADirectory.into(),
                _ => cause,
            },
        })?;
        Ok(Self { folder })
    }

    fn write(
        &self,
        name: &str,
        content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), CliError> {
        let file = self.folder.join(name);
        let write = || {
            let mut writer = BufWriter::new(File::create(&file)?);
            content(&mut writer)?;
            writer.flush()
        };
        write().map_err(|cause| CliError::Unwritable {
            file: file.clone(),
            cause,
        })
    }

    fn json(&self, name: &str, value: &Value) -> Result<(), CliError> {
        self.write(name, |w| writeln!(w, "{value:#}"))
    }
}

/// Prints a line to standard output.
fn print(text: impl std::fmt::Display) -> Result<(), CliError> {
    writeln!(io::stdout(), "{text}").map_err(CliError::Stdout)
}

/// Longest wait of `pil` for a board's answer. A run is not lost to a hiccup of the line.
const PORT_PATIENCE: Duration = Duration::from_secs(10);

fn pil_command(args: &PilArgs) -> Result<(), CliError> {
    let simulation = args.simulation.prepare()?;
    let Simulation {
        planned, options, ..
    } = &simulation;
    let (plan, image) = (&planned.plan, &planned.table.image);
    let output = Output::new(&args.out)?;
    // Before the run: a board that lacks the table wants this file.
    output.write("table.bin", |w| w.write_all(image))?;

    let progress = ProgressBar::new(plan.points.len() as u64 + u64::from(args.random));
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} ticks, {eta} left") {
        progress.set_style(style);
    }
    let mut processor = args
        .connection
        .open(Some(image), PORT_PATIENCE, &progress)
        .map_err(PilError::from)?;
    let pil = pil::run(&mut processor, plan, image, options, |_| progress.inc(1))?;
    let setup = Setup {
        arm: plan.model.arm,
        law: options.law,
        limits: options.limits,
    };
    let random_differing = match args.random {
        0 => 0,
        // Any seed; this one, so that a difference comes again.
        count => pil::compare_any(&mut processor, image, &setup, count, 1, |_| progress.inc(1))?,
    };
    progress.finish_and_clear();

    let mut facts = pil_facts(&processor, &pil);
    if args.random > 0 {
        facts.push((
            "arbitrary measurements".into(),
            format!("{}, {random_differing} commands differ", args.random),
        ));
    }
    let mut keys = pil_json(&processor, &pil);
    keys.extend(export::object([
        ("random_measurements", json!(args.random)),
        ("random_differing", json!(random_differing)),
    ]));
    simulation.report(
        &output,
        &pil.run,
        "Flexor: processor in the loop",
        keys,
        facts,
        args.simulation.common.json,
    )?;
    if let Some(first) = pil.first_difference {
        return Err(CliError::Differs {
            differing: pil.differing_commands,
            ticks: pil.ticks,
            first,
        });
    }
    if random_differing > 0 {
        return Err(CliError::RandomDiffers {
            differing: random_differing,
            count: args.random,
        });
    }
    simulation.judge(&pil.run, &output)
}

/// What a processor in the loop adds to the summary.
fn pil_json(processor: &Processor, pil: &PilRun) -> Map<String, Value> {
    let spread = pil.counts_spread();
    let [min, median, max] = spread.map(|counts| processor.instructions(counts));
    let (version, git) = board::firmware(processor.identity());
    let [cycles_min, cycles_median, cycles_max] = spread.map(|counts| processor.cycles(counts));
    export::object([
        ("differing_commands", json!(pil.differing_commands)),
        ("first_difference", json!(pil.first_difference)),
        ("instructions_min", json!(min)),
        ("instructions_median", json!(median)),
        ("instructions_max", json!(max)),
        ("cycles_min", json!(cycles_min)),
        ("cycles_median", json!(cycles_median)),
        ("cycles_max", json!(cycles_max)),
        ("wall_s", json!(pil.wall_s)),
        ("slot", json!(format!("{:?}", pil.slot))),
        ("firmware_version", json!(version)),
        ("firmware_git", json!(git)),
        ("stack_bytes", json!(pil.status.stack_bytes)),
    ])
}

/// The same as facts for a reader.
fn pil_facts(processor: &Processor, pil: &PilRun) -> Vec<(String, String)> {
    let identity = processor.identity();
    let (version, git) = board::firmware(identity);
    let spread = pil.counts_spread();
    let [min, median, max] = spread.map(|c| processor.instructions(c).or(processor.cycles(c)));
    let unit = match processor.instructions(0) {
        Some(_) => "instructions a tick",
        None => "cycles a tick",
    };
    let number = |n: Option<u32>| n.map_or("?".into(), |n| n.to_string());
    [
        (
            "firmware",
            format!(
                "{version} ({git}), clock {:?}, started: {:?}, table in slot {:?}",
                identity.clock, identity.start, pil.slot
            ),
        ),
        (
            "compared",
            match pil.first_difference {
                None => format!("{} commands, every bit the same", pil.ticks),
                Some(first) => format!(
                    "{} of {} commands differ, the first at tick {first}",
                    pil.differing_commands, pil.ticks
                ),
            },
        ),
        (
            unit,
            format!(
                "{} least, {} median, {} most",
                number(min),
                number(median),
                number(max)
            ),
        ),
        (
            "firmware's stack",
            format!("{} bytes at the deepest", pil.status.stack_bytes),
        ),
        ("took", format!("{:.1} s", pil.wall_s)),
    ]
    .map(|(name, fact)| (name.to_string(), fact))
    .to_vec()
}

fn controller(file: Option<&Path>) -> Result<LawParameters, CliError> {
    Ok(config::load(
        file,
        config::DEFAULT_CONTROLLER,
        config::parse_controller,
    )?)
}

/// Prints names and facts in two columns.
fn print_facts(facts: &[(String, String)]) -> Result<(), CliError> {
    let width = facts.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    facts
        .iter()
        .try_for_each(|(name, fact)| print(format_args!("{name:width$}  {fact}")))
}

/// The table of results: errors of contact force and tip position.
fn results<'a>(runs: impl IntoIterator<Item = (&'a str, &'a str, &'a Run)>) -> comfy_table::Table {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::ASCII_MARKDOWN);
    table.set_header([
        "case",
        "plant",
        "force rms, N",
        "max, N",
        "tip rms, m",
        "max, m",
        "outcome",
    ]);
    for (case, plant, run) in runs {
        let s = &run.summary;
        let numbers = [
            s.force_error_rms,
            s.force_error_max,
            s.tip_error_rms,
            s.tip_error_max,
        ];
        let mut row = vec![case.to_string(), plant.to_string()];
        row.extend(numbers.map(|x| format!("{x:.2e}")));
        row.push(s.outcome.name().to_string());
        table.add_row(row);
    }
    for column in 2..6 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(comfy_table::CellAlignment::Right);
        }
    }
    table
}
