//! The command line: reads files, calls the library, writes results.
//!
//! Exit codes: 0 the work was done (also when a simulated controller fails: that is a
//! result); 1 it could not be done (output not writable, a simulation that stopped
//! early); 2 the command line or a file is at fault.

mod accuracy;
mod board;
mod gains;

use crate::accuracy::{AccuracyError, run_fixed};
use crate::cases::{self, CASES, Mode, PLANTS};
use crate::closed_loop::{self, Outcome, Run, RunError, RunOptions};
use crate::config::{self, ArmConfig, ConfigError};
use crate::export;
use crate::knots::{self, EncodedTable};
use crate::pil::{self, PilError, PilRun};
use crate::plan::{self, Equations, Plan, PlanError, PlanOptions, Task};
use crate::plant::{PlantParameters, Start};
use crate::processor::{Processor, ProcessorError};
use crate::ranges::{self, RangeError};
use crate::report;
use crate::stability::StabilityError;
use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};
use shared::guard::LimitParameters;
use shared::law::LawParameters;
use shared::link::Setup;
use shared::table::{Table, TableError};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
        after_help = "Example: host-sim demo --out out/demo\n\nThe plants have the plan's number of elements. `host-sim run` has all plant options."
    )]
    Demo(DemoArgs),
    /// Plans a task: joint angles, deflection and feedforward torques, and the table.
    #[command(
        after_help = "Example: host-sim plan --arm examples/arm.toml --task examples/task_fast.toml --out out/plan\n\nWrites plan.csv, table.bin and summary.json."
    )]
    Plan(PlanArgs),
    /// Plans a task and runs the controller on it against a simulated arm.
    #[command(
        after_help = "Example: host-sim run --task examples/task_fast.toml --plant examples/plant_soft.toml --out out/run\n\nWrites run.csv, plan.csv, table.bin, summary.json, figures and report.html."
    )]
    Run(RunArgs),
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
struct DemoArgs {
    #[command(flatten)]
    common: Common,
    /// Gains; without it those of examples/controller.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
}

#[derive(Args)]
struct PlanArgs {
    #[command(flatten)]
    common: Common,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/plan")]
    out: PathBuf,
}

/// What is run: task, controller and plant.
#[derive(Args)]
struct SimulationArgs {
    #[command(flatten)]
    common: Common,
    /// Gains; without it those of examples/controller.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Which part of the law acts
    #[arg(long, value_enum, default_value_t = ModeArg::Proposed)]
    mode: ModeArg,
    /// How the plant differs from the planned arm; without it not at all, but for eight
    /// elements [examples/plant_soft.toml]
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Elements of the plant's link 2; before the plant file's
    #[arg(long, value_name = "N")]
    plant_elements: Option<u32>,
    /// Factor on the plant's bending stiffness; before the plant file's
    #[arg(long, value_name = "X")]
    bending_stiffness_scale: Option<f64>,
    /// State that the plant starts in; before the plant file's
    #[arg(long, value_enum)]
    start: Option<StartArg>,
    /// A table to run instead of the one that is planned; it must fit arm and task
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
}

#[derive(Args)]
struct RunArgs {
    #[command(flatten)]
    simulation: SimulationArgs,
    /// Number type that the controller computes in
    #[arg(long, value_enum, default_value_t = NumberArg::F32)]
    number: NumberArg,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/run")]
    out: PathBuf,
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

#[derive(Clone, Copy, ValueEnum)]
enum ModeArg {
    Proposed,
    Feedforward,
    Feedback,
}

#[derive(Clone, Copy, ValueEnum)]
enum StartArg {
    /// The plan's first shape with its elastic velocity
    PlanMoving,
    /// The plan's first shape at rest
    PlanAtRest,
    /// The plant's own equilibrium under the planned force
    Equilibrium,
}

#[derive(Clone, Copy, ValueEnum)]
enum NumberArg {
    F32,
    F64,
    /// Fixed point of 32 bits
    Fixed,
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
enum CliError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("planned torque of joint {joint} reaches {torque_nm:.4} N m; limits.torque_Nm[{}] = {limit_nm} is accepted from {torque_nm:.4} on, or plan a longer duration_s", joint - 1)]
    Limit {
        joint: usize,
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
    #[error("--at {at_s}: a time of the plan from {start_s} to {end_s} s is accepted")]
    At { at_s: f64, start_s: f64, end_s: f64 },
    #[error("{what} {value}: from 0 to {most} is accepted")]
    Margin {
        what: &'static str,
        value: f64,
        most: f64,
    },
    #[error("the plan does not fit the table format: {0}")]
    Encode(TableError),
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
            | Self::Margin { .. }
            | Self::Range(_)
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
            | Self::Encode(_)
            | Self::Stopped { .. }
            | Self::Pil(_)
            | Self::Differs { .. }
            | Self::RandomDiffers { .. }
            | Self::Stdout(_) => 1,
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
                Some(Command::Demo(args)) => demo(&args),
                _ => Ok(()),
            }
        }
        Some(Command::Demo(args)) => demo(&args),
        Some(Command::Plan(args)) => plan_command(&args),
        Some(Command::Run(args)) => run_command(&args),
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

/// What a reader should know before using a plan and its table.
fn doubts(plan: &Plan, table: &EncodedTable) -> Vec<String> {
    /// Share of a torque's peak that it may change by in the first or last control period;
    /// with up to 8 elements the paper's task stays below it.
    const JUMP: f64 = 0.03;
    /// The table's accuracy where the format is at its best, N m.
    const TABLE_NM: f64 = 1e-4;
    let mut doubts = Vec::new();
    let points = &plan.points;
    let last = points.len() - 1;
    for (end, window, i, j) in [
        ("starts", "pre_actuation_s", 0, 1),
        ("ends", "post_actuation_s", last - 1, last),
    ] {
        for joint in 0..2 {
            let jump = (points[i].torque[joint] - points[j].torque[joint]).abs();
            if jump > JUMP * plan.peaks.torque[joint] {
                doubts.push(format!(
                    "the plan {end} with a jump of torque tau{} by {jump:.3} N m within a control period, to bend the link at once; a longer {window}, for instance \"auto\", or fewer link2.elements avoid it",
                    joint + 1
                ));
            }
        }
    }
    let error_nm = table.torque_error_max_nm;
    if !(error_nm <= TABLE_NM) {
        doubts.push(format!(
            "the table reproduces the torque to {error_nm:.1e} N m only, {TABLE_NM:e} is usual: the motion has parts too fast for its knots"
        ));
    }
    doubts
}

/// A task planned and encoded, with how long that took.
struct Planned {
    plan: Plan,
    table: EncodedTable,
    plan_ms: f64,
    table_ms: f64,
    limits: LimitParameters,
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

    fn plan(&self, arm: &ArmConfig, task: &Task) -> Result<Planned, CliError> {
        let options = PlanOptions {
            elements: arm.elements,
            tick_rate_hz: self.tick_rate_hz,
            equations: match self.model {
                ModelArg::Exact => Equations::Exact,
                ModelArg::AsPrinted => Equations::AsPrinted,
            },
            ..PlanOptions::default()
        };
        let milliseconds = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let since = Instant::now();
        let plan = plan::plan(&arm.arm, task, &options)?;
        let plan_ms = milliseconds(since);
        let limits = match arm.limits {
            Some(limits) => {
                for (i, (torque_nm, limit_nm)) in plan
                    .peaks
                    .torque
                    .into_iter()
                    .zip(limits.torque_nm)
                    .enumerate()
                {
                    if torque_nm > limit_nm {
                        let joint = i + 1;
                        return Err(CliError::Limit {
                            joint,
                            torque_nm,
                            limit_nm,
                        });
                    }
                }
                limits
            }
            None => cases::default_limits(&plan),
        };
        let since = Instant::now();
        let table = knots::encode(&plan).map_err(CliError::Encode)?;
        for word in doubts(&plan, &table) {
            say(format_args!("warning: {word}"));
        }
        Ok(Planned {
            plan,
            table,
            plan_ms,
            table_ms: milliseconds(since),
            limits,
        })
    }
}

impl Planned {
    /// The plan's figures as flat JSON.
    fn json(&self) -> Map<String, Value> {
        let (intervals, iterations) = self.plan.effort();
        let peaks = &self.plan.peaks;
        let seconds = |ticks: u32| f64::from(ticks) / f64::from(self.plan.tick_rate_hz);
        export::object([
            ("plan_ms", json!(self.plan_ms)),
            ("table_ms", json!(self.table_ms)),
            ("table_bytes", json!(self.table.image.len())),
            (
                "table_torque_error_max_Nm",
                json!(self.table.torque_error_max_nm),
            ),
            (
                "table_angle_error_max_rad",
                json!(self.table.angle_error_max_rad),
            ),
            ("error_estimate", json!(self.plan.error_estimate())),
            ("mesh_intervals", json!(intervals)),
            ("newton_iterations", json!(iterations)),
            ("tick_rate_Hz", json!(self.plan.tick_rate_hz)),
            ("plan_ticks", json!(self.plan.ticks)),
            ("pre_actuation_s", json!(seconds(self.plan.pre_ticks))),
            ("elements", json!(self.plan.model.elements)),
            (
                "arm_fingerprint",
                json!(format!("{:#010x}", self.plan.model.arm.fingerprint())),
            ),
            ("planned_torque1_max_Nm", json!(peaks.torque[0])),
            ("planned_torque2_max_Nm", json!(peaks.torque[1])),
            ("planned_power1_max_W", json!(peaks.power[0])),
            ("planned_power2_max_W", json!(peaks.power[1])),
            (
                "initial_slope_rate_rad_s",
                json!(self.plan.points[0].root_slope_rate),
            ),
        ])
    }

    /// The plan's figures as facts for a reader.
    fn facts(&self) -> Vec<(String, String)> {
        let plan = &self.plan;
        let peaks = &plan.peaks;
        let end = plan.points[plan.points.len() - 1].t;
        let (intervals, iterations) = plan.effort();
        [
            ("motion", format!(
                "{:.4} to {end:.4} s, {} ticks at {} Hz", plan.points[0].t, plan.ticks, plan.tick_rate_hz)),
            ("planned in", format!(
                "{:.1} ms, {intervals} intervals, {iterations} Newton steps; the table in {:.1} ms",
                self.plan_ms, self.table_ms)),
            ("deflection error estimate", format!("{:.1e} rad, m", plan.error_estimate())),
            ("planned torque", format!("up to {:.4} and {:.4} N m", peaks.torque[0], peaks.torque[1])),
            ("planned power", format!("up to {:.3} and {:.3} W", peaks.power[0], peaks.power[1])),
            ("slope rate at the start", format!("{:.2e} rad/s", plan.points[0].root_slope_rate)),
            ("feedforward table", format!(
                "{} bytes, torque to {:.1e} N m", self.table.image.len(), self.table.torque_error_max_nm)),
        ]
        .map(|(name, fact)| (name.to_string(), fact))
        .to_vec()
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
            cause,
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

fn plan_command(args: &PlanArgs) -> Result<(), CliError> {
    let (arm, task) = args.common.load()?;
    let planned = args.common.plan(&arm, &task)?;
    let output = Output::new(&args.out)?;
    output.write("plan.csv", |w| export::plan_csv(&planned.plan, w))?;
    output.write("table.bin", |w| w.write_all(&planned.table.image))?;
    let summary = Value::Object(planned.json());
    output.json("summary.json", &summary)?;
    if args.common.json {
        return print(summary);
    }
    print_facts(&planned.facts())?;
    print(format_args!(
        "\nplan.csv, table.bin and summary.json are in {}",
        args.out.display()
    ))
}

fn run_command(args: &RunArgs) -> Result<(), CliError> {
    let simulation = args.simulation.prepare()?;
    let Simulation {
        planned, options, ..
    } = &simulation;
    let output = Output::new(&args.out)?;
    let (plan, image) = (&planned.plan, &planned.table.image);
    if simulation.mode != Mode::Feedforward {
        gains::warn(plan, &options.plant, &options.law);
    }
    let since = Instant::now();
    let (run, saturations) = match args.number {
        NumberArg::F32 => (closed_loop::run::<f32>(plan, image, options)?, None),
        NumberArg::F64 => (closed_loop::run::<f64>(plan, image, options)?, None),
        NumberArg::Fixed => {
            let (run, saturations) = run_fixed(plan, image, options, |_, _| {})?;
            (run, Some(saturations))
        }
    };
    let run_ms = since.elapsed().as_secs_f64() * 1e3;

    let mut keys = export::object([("run_ms", json!(run_ms))]);
    let fact = format!("{run_ms:.0} ms, plant with {} elements", run.elements);
    let mut facts = vec![("simulated in".into(), fact)];
    if let Some(saturations) = saturations {
        let total = saturations.total();
        keys.insert("saturations".into(), json!(total));
        for (signal, count) in saturations.entries() {
            keys.insert(format!("saturations_{signal}"), json!(count));
        }
        let analysis = ranges::analyse(plan, image, &options.law, &options.limits)?;
        facts.extend(accuracy::format_facts(&analysis));
        facts.push(("fixed point: saturations".into(), total.to_string()));
    }
    simulation.report(
        &output,
        &run,
        "Flexor: run",
        keys,
        facts,
        args.simulation.common.json,
    )?;
    simulation.judge(&run, &output)
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

/// What is to be run, planned.
struct Simulation {
    planned: Planned,
    options: RunOptions,
    mode: Mode,
}

impl Simulation {
    /// Writes the files of a run and prints its result. `keys` and `facts` are what is
    /// particular to it.
    fn report(
        &self,
        output: &Output,
        run: &Run,
        title: &str,
        keys: Map<String, Value>,
        facts: Vec<(String, String)>,
        json: bool,
    ) -> Result<(), CliError> {
        let Planned { plan, table, .. } = &self.planned;
        let mut summary = export::summary_json(&run.summary);
        summary.extend(self.planned.json());
        summary.extend(keys);
        summary.insert("plant_elements".into(), json!(run.elements));
        let summary = Value::Object(summary);
        output.write("plan.csv", |w| export::plan_csv(plan, w))?;
        output.write("table.bin", |w| w.write_all(&table.image))?;
        output.write("run.csv", |w| export::run_csv(run, w))?;
        output.json("summary.json", &summary)?;
        let name = match self.mode {
            Mode::Proposed => "proposed",
            Mode::Feedforward => "feedforward",
            Mode::Feedback => "feedback",
        };
        let cases = [report::Case {
            case: name,
            plant: "plant",
            plan,
            run,
        }];
        let mut all = self.planned.facts();
        all.extend(facts);
        let page = output.folder.join("report.html");
        report::write_figures(output.folder, &cases)?;
        report::write_html(&page, title, &cases, &all)?;
        if json {
            return print(&summary);
        }
        print_facts(&all)?;
        print("")?;
        print(results([(name, "plant", run)]))?;
        print(format_args!("\nThe report is {}", page.display()))
    }

    /// A run that could not go on to its end is a failure; a bad result is not.
    fn judge(&self, run: &Run, output: &Output) -> Result<(), CliError> {
        let outcome = run.summary.outcome;
        if outcome == Outcome::Diverged {
            let first = self.planned.plan.points[0].t;
            return Err(CliError::Stopped {
                t_s: run.rows.last().map_or(first, |row| row.t),
                outcome,
                out: output.folder.to_path_buf(),
            });
        }
        Ok(())
    }
}

impl SimulationArgs {
    /// Reads the files and plans.
    fn prepare(&self) -> Result<Simulation, CliError> {
        let (arm, task) = self.common.load()?;
        let law = controller(self.controller.as_deref())?;
        let (mut plant, mut start) = config::load(self.plant.as_deref(), "", config::parse_plant)?;
        self.adjust(&mut plant, &mut start)?;
        let mut planned = self.common.plan(&arm, &task)?;
        if let Some(file) = &self.table {
            planned.table.image = read_table(file, &planned.plan)?;
        }
        let mode = match self.mode {
            ModeArg::Proposed => Mode::Proposed,
            ModeArg::Feedforward => Mode::Feedforward,
            ModeArg::Feedback => Mode::Feedback,
        };
        let options = RunOptions {
            law: mode.of(&law),
            limits: planned.limits,
            plant,
            start,
        };
        Ok(Simulation {
            planned,
            options,
            mode,
        })
    }

    /// Puts what was said on the command line before what the plant file says.
    fn adjust(&self, plant: &mut PlantParameters, start: &mut Start) -> Result<(), CliError> {
        if let Some(elements) = self.plant_elements {
            config::check_option("elements", f64::from(elements))?;
            plant.elements = elements as usize;
        }
        if let Some(scale) = self.bending_stiffness_scale {
            let field = "bending_stiffness_scale";
            plant.bending_stiffness_scale = config::check_option(field, scale)?;
        }
        match self.start {
            Some(StartArg::PlanMoving) => *start = Start::PlanMoving,
            Some(StartArg::PlanAtRest) => *start = Start::PlanAtRest,
            Some(StartArg::Equilibrium) => *start = Start::Equilibrium,
            None => {}
        }
        Ok(())
    }
}

fn controller(file: Option<&Path>) -> Result<LawParameters, CliError> {
    Ok(config::load(
        file,
        config::DEFAULT_CONTROLLER,
        config::parse_controller,
    )?)
}

/// Bytes of a file that are read as a table.
const TABLE_BYTES_MAX: u64 = 64 << 20;

/// Reads a table image and makes sure that it is for the plan's arm, rate and length.
fn read_table(file: &Path, plan: &Plan) -> Result<Vec<u8>, CliError> {
    // More than any slot holds is no table; a device would never end.
    let mut image = Vec::new();
    File::open(file)
        .and_then(|opened| opened.take(TABLE_BYTES_MAX).read_to_end(&mut image))
        .map_err(|cause| CliError::Unreadable {
            file: file.to_path_buf(),
            cause,
        })?;
    let table = Table::open_for(&image, plan.model.arm.fingerprint()).map_err(|source| {
        CliError::Table {
            file: file.to_path_buf(),
            source,
        }
    })?;
    let header = table.header();
    let first_tick = -plan.pre_ticks.cast_signed();
    let is = (header.tick_rate_hz, header.ticks, header.first_tick);
    let should = (plan.tick_rate_hz, plan.ticks, first_tick);
    if is == should {
        return Ok(image);
    }
    let words = |(rate, ticks, first): (u32, u32, i32)| {
        format!("{ticks} ticks from tick {first} at {rate} Hz")
    };
    Err(CliError::OtherTask {
        file: file.to_path_buf(),
        found: words(is),
        expected: words(should),
    })
}

fn demo(args: &DemoArgs) -> Result<(), CliError> {
    let (arm, task) = args.common.load()?;
    let law = controller(args.controller.as_deref())?;
    let since = Instant::now();
    let planned = [
        args.common.plan(&arm, &task)?,
        args.common.plan(&arm, &cases::fast(&task))?,
    ];
    gains::warn(&planned[0].plan, &cases::plant(arm.elements, 1.0), &law);
    let output = Output::new(&args.out)?;
    output.write("plan.csv", |w| export::plan_csv(&planned[0].plan, w))?;
    output.write("plan_fast.csv", |w| export::plan_csv(&planned[1].plan, w))?;
    output.write("table.bin", |w| w.write_all(&planned[0].table.image))?;
    output.write("table_fast.bin", |w| w.write_all(&planned[1].table.image))?;

    let progress = ProgressBar::new((CASES.len() * PLANTS.len()) as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}") {
        progress.set_style(style);
    }
    let mut runs: Vec<(&str, &str, usize, Run)> = Vec::new();
    for case in &CASES {
        for (plant, scale) in PLANTS {
            progress.set_message(format!("{}, {plant}", case.name));
            let used = usize::from(case.fast);
            let options = RunOptions {
                law: case.mode.of(&law),
                limits: planned[used].limits,
                plant: cases::plant(arm.elements, scale),
                start: case.start,
            };
            let (plan, image) = (&planned[used].plan, &planned[used].table.image);
            let run = closed_loop::run::<f32>(plan, image, &options)?;
            let folder = args.out.join(format!("{}_{plant}", case.name));
            let folder = Output::new(&folder)?;
            folder.write("run.csv", |w| export::run_csv(&run, w))?;
            let mut summary = export::summary_json(&run.summary);
            summary.extend(planned[used].json());
            folder.json("summary.json", &Value::Object(summary))?;
            runs.push((case.name, plant, used, run));
            progress.inc(1);
        }
    }
    progress.set_message("report");
    let list: Vec<Value> = runs
        .iter()
        .map(|(case, plant, _, run)| {
            let mut entry = export::object([("case", json!(case)), ("plant", json!(plant))]);
            entry.extend(export::errors_json(&run.summary));
            Value::Object(entry)
        })
        .collect();
    let summary =
        json!({ "cases": list, "plan": planned[0].json(), "plan_fast": planned[1].json() });
    output.json("summary.json", &summary)?;
    let cases: Vec<report::Case> = runs
        .iter()
        .map(|(case, plant, used, run)| report::Case {
            case,
            plant,
            plan: &planned[*used].plan,
            run,
        })
        .collect();
    let mut facts = planned[0].facts();
    facts.extend(
        planned[1]
            .facts()
            .into_iter()
            .map(|(name, fact)| (format!("fast: {name}"), fact)),
    );
    report::write_figures(&args.out, &cases)?;
    let page = args.out.join("report.html");
    report::write_html(&page, "Flexor: the paper's manipulation", &cases, &facts)?;
    progress.finish_and_clear();

    if args.common.json {
        return print(&summary);
    }
    print_facts(&planned[0].facts())?;
    print("")?;
    print(results(
        runs.iter()
            .map(|(case, plant, _, run)| (*case, *plant, run)),
    ))?;
    print(format_args!(
        "\n{} runs in {:.1} s. The report is {}",
        runs.len(),
        since.elapsed().as_secs_f64(),
        page.display()
    ))
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
