//! The command `board`: the requests that an operator makes of a microcontroller.
//!
//! The board keeps the arm safe by itself: it enables the drives only when everything is in
//! order, stops at every fault, and 100 ms after the last request. Whatever happens to this
//! process, the drives go off; that it disables as well only makes it sooner.

mod enable;
mod identity;
mod run;
mod sensors;

use super::connection::ConnectionArgs;
use super::{BoardError, CliError, print, print_facts};
use crate::files::export;
use crate::target::Target;
use clap::{Args, Subcommand, ValueEnum};
use flexor::fault::Fault;
use flexor::link::{Mode, RunStatus, Status};
use flexor::table::Slot;
use indicatif::{ProgressBar, ProgressDrawTarget};
use serde_json::{Map, Value, json};
use std::time::Duration;

#[derive(Args)]
pub(super) struct BoardArgs {
    #[command(flatten)]
    connection: ConnectionArgs,
    /// Longest wait for a board's answer, s
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = timeout, global = true)]
    timeout_s: f64,
    /// Print JSON instead of text: one object, or one a line
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Who it is: version, clock, why it started, the tables in both slots
    #[command(after_help = "Example: flexor board identity --port /dev/ttyUSB0")]
    Identity,
    /// How it is: mode, fault, longest tick, stack, what was lost on the link
    #[command(after_help = "Example: flexor board status --port /dev/ttyUSB0 --json")]
    Status,
    /// What sensors and interlocks say: counts, and SI values made of them
    #[command(
        after_help = "Example: flexor board sensors --port /dev/ttyUSB0 --follow\n\nNothing moves: the drives are as they were."
    )]
    Sensors {
        /// Ten times a second until Ctrl-C
        #[arg(long)]
        follow: bool,
    },
    /// Enables the drives and runs a table; disables at its end, at a fault, on Ctrl-C and at
    /// any error. With the hybrid law the arm is first brought to stand
    #[command(
        after_help = "Example: flexor board enable --port /dev/ttyUSB0 --slot b\n\nTHE ARM MOVES. The board refuses while a fault is latched, the stop is pressed, a drive reports a fault, or the arm is away from the table's first row. Exit code 0 when the table was run to its end."
    )]
    Enable {
        /// Run this slot's table and no other; without it slot A's, or slot B's where slot A
        /// has none that is usable
        #[arg(long, value_enum)]
        slot: Option<SlotArg>,
    },
    /// Says everything that is in the way of enabling, at once; enables nothing
    #[command(
        after_help = "Example: flexor board check --port /dev/ttyUSB0\n\nExit code 0 where nothing is in the way, else 1."
    )]
    Check {
        /// With this slot's table; without it slot A's, or slot B's where slot A has none that is usable
        #[arg(long, value_enum)]
        slot: Option<SlotArg>,
    },
    /// Enables, attends and records, as `enable`, and writes what `flexor run` writes
    #[command(
        after_help = "Example: flexor board run --virtual --scenario examples/scenarios/approach.toml --out out/board\n\nWith --port THE ARM MOVES. The board must have the table and the settings that these files make. Writes run.csv, plan.csv, table.bin, summary.json, figures and report.html, of what the board's sensors say. Exit code 0 only for a run that is completed."
    )]
    Run(Box<run::RunArgs>),
    /// Says that the arm stands at its home pose, from which the encoders count
    #[command(
        after_help = "Example: flexor board home --port /dev/ttyUSB0\n\nWanted before enabling, once after every start and after every pil. Nothing moves."
    )]
    Home,
    /// Lets the table stand where it is, without leaving the surface; not with the paper's law
    #[command(after_help = "Example: flexor board pause --port /dev/ttyUSB0")]
    Pause,
    /// Lets a table that stands go on
    #[command(after_help = "Example: flexor board resume --port /dev/ttyUSB0")]
    Resume,
    /// Ends the run: the table stops, the force is taken away, the tip lifted off, and the arm
    /// stands with its drives on until it is disabled; not with the paper's law
    #[command(after_help = "Example: flexor board retract --port /dev/ttyUSB0")]
    Retract,
    /// Drives off
    #[command(after_help = "Example: flexor board disable --port /dev/ttyUSB0")]
    Disable,
    /// Forget the latched fault, so that it may be enabled again
    #[command(after_help = "Example: flexor board acknowledge --port /dev/ttyUSB0")]
    Acknowledge,
}

#[derive(Clone, Copy, ValueEnum)]
enum SlotArg {
    A,
    B,
}

impl From<SlotArg> for Slot {
    fn from(slot: SlotArg) -> Self {
        match slot {
            SlotArg::A => Self::A,
            SlotArg::B => Self::B,
        }
    }
}

/// A wait of the command line, s.
fn timeout(text: &str) -> Result<f64, String> {
    const ACCEPTED: std::ops::RangeInclusive<f64> = 0.01..=600.0;
    match text.parse() {
        Ok(seconds) if ACCEPTED.contains(&seconds) => Ok(seconds),
        _ => Err("a number of seconds from 0.01 to 600 is accepted".into()),
    }
}

/// Any of this module's errors as the command line's.
fn failed(error: impl Into<BoardError>) -> CliError {
    CliError::Board(error.into())
}

/// Makes the request.
pub(super) fn board(args: &BoardArgs) -> Result<(), CliError> {
    // The one thing on the terminal that the log must not run into.
    let bar = match &args.verb {
        Verb::Enable { .. } | Verb::Run(_) => ProgressBar::new(0),
        Verb::Sensors { follow: true } if !args.json => {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::stdout())
        }
        _ => ProgressBar::hidden(),
    };
    if let Verb::Run(run) = &args.verb {
        return run::run(run, args, &bar);
    }
    let timeout = Duration::from_secs_f64(args.timeout_s);
    let mut target = args.connection.open(None, timeout, &bar).map_err(failed)?;
    let board = &mut target;
    match args.verb {
        // On a board of its own, above.
        Verb::Run(_) => Ok(()),
        Verb::Identity => {
            let identity = *board.identity();
            // The log of its start comes before the answer to a further request.
            board.status().map_err(failed)?;
            let facts = identity::facts(&identity);
            show(args.json, identity::json(&identity), facts)
        }
        Verb::Status => status(board, args.json),
        Verb::Sensors { follow: true } => sensors::follow(board, args.json, &bar),
        Verb::Sensors { follow: false } => {
            let report = board.sensors().map_err(failed)?;
            show(args.json, sensors::json(&report), sensors::facts(&report))
        }
        Verb::Enable { slot } => enable::enable(board, slot.map(Into::into), args.json, &bar),
        Verb::Check { slot } => check(board, slot.map(Into::into), args.json),
        Verb::Disable => {
            board
                .disable()
                .map_err(BoardError::NotDisabled)
                .map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Home => {
            board.home().map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Pause | Verb::Resume => {
            let paused = matches!(args.verb, Verb::Pause);
            board.pause(paused).map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Retract => {
            board.retract().map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Acknowledge => {
            board.acknowledge().map_err(failed)?;
            standing(board, args.json)
        }
    }
}

/// Tells what is in the way of enabling.
fn check(board: &mut Target, slot: Option<Slot>, json: bool) -> Result<(), CliError> {
    let obstacles = board.check(slot, None).map_err(failed)?;
    let words: Vec<String> = obstacles.iter().map(ToString::to_string).collect();
    if json {
        let keys = export::object([
            ("may_enable", json!(words.is_empty())),
            ("obstacles", json!(words)),
        ]);
        print(Value::Object(keys))?;
    } else if words.is_empty() {
        print("nothing is in the way of enabling")?;
    } else {
        words.iter().try_for_each(print)?;
    }
    match words.len() {
        0 => Ok(()),
        count => Err(failed(BoardError::Obstacles { count })),
    }
}

/// Prints one or the other.
fn show(
    json: bool,
    keys: Map<String, Value>,
    facts: Vec<(&'static str, String)>,
) -> Result<(), CliError> {
    if json {
        return print(Value::Object(keys));
    }
    let facts: Vec<_> = facts
        .into_iter()
        .map(|(name, fact)| (name.to_owned(), fact))
        .collect();
    print_facts(&facts)
}

/// A mode's name.
fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Disabled => "disabled",
        Mode::Enabled => "enabled",
        Mode::LockStep => "lock_step",
    }
}

/// A fault in words.
fn fault_words(fault: Option<Fault>) -> String {
    fault.map_or("none".into(), |fault| {
        format!("{} ({fault}), latched", fault.number())
    })
}

/// A fault's name and number as JSON.
fn fault_json(fault: Option<Fault>) -> [(&'static str, Value); 2] {
    [
        ("fault", json!(fault.map(Fault::name))),
        ("fault_number", json!(fault.map(Fault::number))),
    ]
}

/// Where an enabled arm's run is, as JSON; null where there is none.
fn run_json(run: Option<RunStatus>) -> [(&'static str, Value); 3] {
    [
        ("phase", json!(run.map(|run| run.phase.name()))),
        ("ticks", json!(run.map(|run| run.ticks))),
        ("paused", json!(run.map(|run| run.paused))),
    ]
}

/// The same in words.
fn run_words(status: &Status) -> String {
    status.run.map_or("none".into(), |run| {
        let (phase, paused) = (run.phase, if run.paused { ", paused" } else { "" });
        format!("{phase}{paused}, tick {} of {}", status.tick, run.ticks)
    })
}

fn status(board: &mut Target, json: bool) -> Result<(), CliError> {
    let status = board.status().map_err(failed)?;
    let errors = status.frame_errors;
    let ticks_hw = status.ticks_hw_max;
    let (instructions, cycles) = (board.instructions(ticks_hw), board.cycles(ticks_hw));
    let longest = match (instructions, cycles) {
        (Some(count), _) => format!("{count} instructions"),
        (None, Some(count)) => format!("{count} cycles"),
        (None, None) => format!("{ticks_hw} ticks of the stopwatch"),
    };
    let mut keys = export::object([("mode", json!(mode(status.mode)))]);
    keys.extend(export::object(fault_json(status.fault)));
    keys.extend(export::object(run_json(status.run)));
    keys.extend(export::object([
        ("tick", json!(status.tick)),
        ("ticks_total", json!(status.ticks_total)),
        ("tick_max_instructions", json!(instructions)),
        ("tick_max_cycles", json!(cycles)),
        ("stack_bytes", json!(status.stack_bytes)),
        ("frames_oversized", json!(errors.oversized)),
        ("frames_not_cobs", json!(errors.stuffing)),
        ("frames_other_version", json!(errors.version)),
        ("frames_wrong_crc", json!(errors.crc)),
        ("frames_unknown", json!(errors.message)),
        ("bytes_lost", json!(status.bytes_lost)),
        ("logs_lost", json!(status.logs_lost)),
    ]));
    let facts = vec![
        ("mode", mode(status.mode).to_owned()),
        ("fault", fault_words(status.fault)),
        ("run", run_words(&status)),
        ("tick of the table", status.tick.to_string()),
        ("ticks since start", status.ticks_total.to_string()),
        ("longest tick", longest),
        ("deepest stack", format!("{} bytes", status.stack_bytes)),
        (
            "frames dropped",
            format!(
                "{} too long, {} not COBS, {} of another version, {} with a wrong CRC, {} unknown",
                errors.oversized, errors.stuffing, errors.version, errors.crc, errors.message
            ),
        ),
        ("bytes lost", status.bytes_lost.to_string()),
        ("log entries lost", status.logs_lost.to_string()),
    ];
    show(json, keys, facts)
}

/// Prints what became of the mode and the fault.
fn standing(board: &mut Target, json: bool) -> Result<(), CliError> {
    let status = board.status().map_err(failed)?;
    let mut keys = export::object([("mode", json!(mode(status.mode)))]);
    keys.extend(export::object(fault_json(status.fault)));
    keys.extend(export::object(run_json(status.run)));
    let facts = vec![
        ("mode", mode(status.mode).to_owned()),
        ("fault", fault_words(status.fault)),
        ("run", run_words(&status)),
    ];
    show(json, keys, facts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timeout_is_a_sensible_number_of_seconds() {
        assert_eq!(timeout("0.5"), Ok(0.5));
        for bad in ["0", "-1", "nan", "inf", "1e9", "soon"] {
            assert!(timeout(bad).is_err(), "{bad}");
        }
    }
}
