//! `flexor board run`: enables, attends, and records what the board tells, as `flexor run` does of the
//! bench.

use super::enable::{self, Attendance};
use super::{BoardArgs, SlotArg, failed};
use crate::cli::bench::Bench;
use crate::cli::provenance::Provenance;
use crate::cli::virtual_board::VirtualArmArgs;
use crate::cli::{CliError, Common, ModelArg, Output, say};
use crate::files::export;
use crate::simulation::bench::{BenchArm, RecordedRun, VirtualSetting};
use crate::simulation::closed_loop::Outcome;
use crate::target::{Target, start_within};
use clap::Args;
use indicatif::ProgressBar;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(Args)]
pub(super) struct RunArgs {
    /// A virtual board, as of `flexor virtual-board`, within this process, as fast as it can; it is
    /// homed first
    #[arg(long = "virtual")]
    is_virtual: bool,
    /// The arm; without it the scenario's, or the paper's [examples/arm.toml]
    #[arg(long, value_name = "FILE")]
    arm: Option<PathBuf>,
    /// The task; without it the scenario's, or the paper's [examples/task.toml]
    #[arg(long, value_name = "FILE")]
    task: Option<PathBuf>,
    /// The board; without it the scenario's, or the default one [boards/stm32f405.toml]
    #[arg(long, value_name = "FILE")]
    board: Option<PathBuf>,
    #[command(flatten)]
    bench: VirtualArmArgs,
    /// Run this slot's table and no other; without it the one that has the task's
    #[arg(long, value_enum)]
    slot: Option<SlotArg>,
    /// Control periods from record to record; without it 1 of a virtual board, and 5 over a line, which
    /// has no time for more
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    every: Option<u16>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/board")]
    out: PathBuf,
}

/// Control periods from record to record over a line of 1 Mbaud.
const EVERY_ON_A_LINE: u16 = 5;

/// Runs on the board that the arguments name, and writes the results.
pub(super) fn run(args: &RunArgs, board: &BoardArgs, bar: &ProgressBar) -> Result<(), CliError> {
    if args.is_virtual && board.connection.is_named() {
        return Err(CliError::NoEffect {
            what: "--port",
            beside: "beside --virtual: leave one of them out",
        });
    }
    if !args.is_virtual && !args.bench.fault.is_empty() {
        return Err(CliError::NoEffect {
            what: "--fault",
            beside: "without --virtual: only a virtual board can be given faults",
        });
    }
    let common = Common {
        arm: args.arm.clone(),
        task: args.task.clone(),
        board: args.board.clone(),
        tick_rate_hz: None,
        model: ModelArg::Exact,
        json: board.json,
    };
    let inputs = common.inputs().map(|input| input.map(Path::to_path_buf));
    let inputs: Vec<_> = inputs.iter().map(Option::as_deref).collect();
    let output = Output::open(&args.out, inputs)?;
    let (bench, arm) = args.bench.prepare(&common)?;
    bench.say_note();
    let timeout = Duration::from_secs_f64(board.timeout_s);
    if args.is_virtual {
        return within(args, (&bench, &arm), timeout, output, (board.json, bar));
    }
    let opened = board.connection.open(None, timeout, bar);
    let mut target = opened.map_err(failed)?;
    record(args, &mut target, &bench, output, (board.json, bar))
}

/// On a virtual board within the process.
fn within(
    args: &RunArgs,
    (bench, arm): (&Bench, &BenchArm),
    timeout: Duration,
    output: Output,
    shown: (bool, &ProgressBar),
) -> Result<(), CliError> {
    let setting = VirtualSetting::new(bench.task(), arm, args.bench.fault.clone(), 1.0);
    std::thread::scope(|scope| {
        let (line, thread) = start_within(scope, &setting, timeout);
        let recorded = Target::within(line, timeout)
            .and_then(|mut target| target.home().map(|()| target))
            .map_err(failed)
            .and_then(|mut target| record(args, &mut target, bench, output, shown));
        // Without its line the board ends; why it has ended before is what went wrong.
        match thread.join() {
            Ok(Err(error)) => Err(error.into()),
            _ => recorded,
        }
    })
}

/// Enables, attends, records and writes.
fn record(
    args: &RunArgs,
    board: &mut Target,
    bench: &Bench,
    output: Output,
    (json, bar): (bool, &ProgressBar),
) -> Result<(), CliError> {
    let task = bench.task();
    let every = args.every.unwrap_or(match args.is_virtual {
        true => 1,
        false => EVERY_ON_A_LINE,
    });
    let program = task
        .program()
        .map_err(crate::simulation::bench::BenchError::from)?;
    let sensors = board.sensors().map_err(failed)?;
    board.stream(every).map_err(failed)?;
    let mut recorded = RecordedRun::new(&task, &sensors, every);
    let attendance = Attendance {
        slot: args
            .slot
            .map(Into::into)
            .or_else(|| enable::slot_of(board, &program)),
        program,
        quiet: json,
    };
    let ended = enable::attended(board, &attendance, bar, |samples| {
        samples.iter().for_each(|sample| recorded.add(sample));
    })?;
    // Whoever comes next has the line to itself.
    board.stream(0).map_err(failed)?;
    let (gaps, missing) = recorded.gaps();
    if gaps > 0 {
        say(format_args!(
            "warning: the record has {gaps} gaps, {missing} samples are missing; a larger --every than {every} asks less of the line"
        ));
    }
    let (run, rows, figures) = recorded.finish();
    if rows.is_empty() {
        ended.result?;
        return Err(CliError::NotCompleted {
            outcome: Outcome::NotBegun,
            out: args.out.clone(),
        });
    }
    let keys = export::object([
        ("ended", json!(ended.outcome)),
        ("telemetry_every_ticks", json!(every)),
        ("telemetry_gaps", json!(gaps)),
        ("telemetry_missing", json!(missing)),
    ]);
    let facts = vec![(
        "recorded".into(),
        format!("every {every} ticks, {missing} samples missing"),
    )];
    bench.write(
        output,
        ("Flexor: board run", &made_from(args, bench)),
        (keys, facts),
        (&run, &rows, &figures),
        (json, None),
    )?;
    ended.result?;
    match figures.outcome {
        Outcome::Completed => Ok(()),
        outcome => Err(CliError::NotCompleted {
            outcome,
            out: args.out.clone(),
        }),
    }
}

/// What a run was made from; a board's arm is not known.
fn made_from(args: &RunArgs, bench: &Bench) -> Provenance {
    let made = Provenance::of_inputs(&bench.inputs).gains(&bench.law);
    match args.is_virtual {
        true => made.plant(&bench.config.scenario.middle().plant),
        false => made,
    }
}
