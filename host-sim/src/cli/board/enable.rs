//! `flexor board enable`: runs a table and attends to it until it is over.

use super::identity::table_words;
use super::{failed, fault_json};
use crate::cli::signals::stop_flag;
use crate::cli::{BoardError, CliError, print, say};
use crate::files::export;
use crate::target::{Target, TargetError};
use flexor::fault::Fault;
use flexor::link::{Mode, Program, Status};
use flexor::table::{Slot, TableIdentity};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Between two requests to an enabled arm: 50 a second, where it stops after 100 ms without.
const KEEP_ALIVE: Duration = Duration::from_millis(20);

/// Longest wait for an arm that was asked to retract: the examples' gains take 2 s.
const RETRACT_MAX: Duration = Duration::from_secs(10);

/// How an enabled run ended.
#[derive(Clone, Copy, Debug)]
enum End {
    Completed,
    Interrupted,
    /// By another's request.
    Retracted,
    Fault(Fault),
    Disabled,
}

/// A number for this session that no other is likely to have.
pub(super) fn session() -> u32 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let nanoseconds = since.map_or(0, |since| since.as_nanos());
    (nanoseconds ^ (nanoseconds >> 32)) as u32 ^ std::process::id().rotate_left(16)
}

/// What the board has said that it has in a slot, or without one in the first that is usable. Where
/// there is none the board says why when it refuses.
fn meant(board: &Target, slot: Option<Slot>) -> Program {
    let identity = board.identity();
    let slots = slot.as_ref().map_or(&Slot::ALL[..], core::slice::from_ref);
    let mut programs = slots.iter().filter_map(|slot| Program::of(identity, *slot));
    programs.next().unwrap_or_default()
}

/// Enables, keeps the link alive, and disables, whatever happens in between.
pub(super) fn enable(
    board: &mut Target,
    slot: Option<Slot>,
    json: bool,
    bar: &ProgressBar,
) -> Result<(), CliError> {
    let stop = stop_flag()?;
    let session = session();
    let program = meant(board, slot);
    let granted = match board.enable(slot, program, session) {
        Err(error @ TargetError::Refused(_)) => {
            // For what it has logged of that; the refusal is known without.
            let _ = board.status();
            return Err(failed(error));
        }
        other => other,
    };
    let ended = granted
        .map_err(failed)
        .and_then(|(slot, table)| attend(board, (slot, table, session), json, stop, bar));
    let disabled = board.disable();
    bar.finish_and_clear();
    let (slot, table, end, tick) = match (ended, disabled) {
        (Ok(ended), Ok(())) => ended,
        (ended, Err(error)) => {
            if let Err(error) = ended {
                say(format_args!("error: {error}"));
            }
            return Err(failed(BoardError::NotDisabled(error)));
        }
        (Err(error), Ok(())) => {
            say("disabled");
            return Err(error);
        }
    };
    let ticks = table.ticks;
    let (outcome, fault, result) = judged(end, tick, ticks);
    if json {
        let mut keys = export::object([("outcome", json!(outcome))]);
        keys.extend(export::object(fault_json(fault)));
        keys.extend(export::object([
            ("slot", json!(format!("{slot:?}"))),
            ("table_crc", json!(format!("{:#010x}", table.crc))),
            (
                "table_task",
                json!(format!("{:#010x}", table.task_fingerprint)),
            ),
            ("tick", json!(tick)),
            ("ticks", json!(ticks)),
        ]));
        print(Value::Object(keys))?;
    } else if result.is_ok() {
        print(format_args!("completed, disabled"))?;
    }
    result.map_err(failed)
}

/// What an end after so many of the table's ticks is called, the fault that it was for, and how the
/// command ends.
fn judged(
    end: End,
    tick: u32,
    ticks: u32,
) -> (&'static str, Option<Fault>, Result<(), BoardError>) {
    match end {
        End::Completed => ("completed", None, Ok(())),
        End::Interrupted => (
            "interrupted",
            None,
            Err(BoardError::Interrupted { tick, ticks }),
        ),
        End::Retracted => (
            "retracted",
            None,
            Err(BoardError::Retracted { tick, ticks }),
        ),
        End::Fault(fault) => (
            "fault",
            Some(fault),
            Err(BoardError::Fault { fault, tick, ticks }),
        ),
        End::Disabled => ("disabled", None, Err(BoardError::Disabled { tick, ticks })),
    }
}

/// Keeps the link of an enabled arm alive until it is over: slot, table, how it ended, and the
/// last tick that was seen.
fn attend(
    board: &mut Target,
    (slot, table, session): (Slot, TableIdentity, u32),
    json: bool,
    stop: &AtomicBool,
    bar: &ProgressBar,
) -> Result<(Slot, TableIdentity, End, u32), CliError> {
    if !json {
        let words = table_words(&table, board.identity().tick_rate_hz);
        print(format_args!("enabled, slot {slot:?}: {words}"))?;
    }
    bar.set_length(table.ticks.into());
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} ticks, {eta} left") {
        bar.set_style(style);
    }
    let mut run = Attended {
        ticks: table.ticks,
        tick: 0,
        stood: false,
        retracted: None,
    };
    loop {
        let status = board.keep_alive(session).map_err(failed)?;
        let stop = stop.swap(false, Ordering::Relaxed);
        let end = run.look(&status, stop);
        bar.set_position(run.tick.into());
        if let Some(end) = end {
            return Ok((slot, table, end, run.tick));
        }
        if stop {
            bar.suspend(|| say("ending the run; once more to disable at once"));
            match board.retract() {
                // It has come to an end by itself meanwhile, which the next status says.
                Ok(()) | Err(TargetError::Refused(_)) => run.retracted = Some(Instant::now()),
                Err(error) => return Err(failed(error)),
            }
        }
        board.pass(KEEP_ALIVE).map_err(failed)?;
    }
}

/// A run that is attended to.
struct Attended {
    /// Ticks of the table.
    ticks: u32,
    /// The last that was seen.
    tick: u32,
    /// The arm stood when it was looked at before.
    stood: bool,
    /// When it was asked to retract.
    retracted: Option<Instant>,
}

impl Attended {
    /// Looks at the status, and at whether the operator wants it to `stop`: how the run has ended,
    /// if it has. With a law that has a motion it has when the arm stands, whatever it stands for;
    /// to disable it before would drop it.
    fn look(&mut self, status: &Status, stop: bool) -> Option<End> {
        self.tick = self.tick.max(status.tick);
        let completed = self.tick >= self.ticks;
        let fault = status.fault.map(End::Fault);
        if status.mode != Mode::Enabled {
            return Some(fault.unwrap_or(End::Disabled));
        }
        let Some(run) = status.run.filter(|run| run.motion) else {
            let completed = completed.then_some(End::Completed);
            return fault.or(completed).or(stop.then_some(End::Interrupted));
        };
        let late = |since: Instant| stop || since.elapsed() > RETRACT_MAX;
        if self.retracted.is_some_and(late) {
            return Some(fault.unwrap_or(End::Interrupted));
        }
        // Before its first tick an arm stands, too; two looks are many ticks apart.
        let stood = core::mem::replace(&mut self.stood, run.phase.stands());
        if !(stood && self.stood) {
            return None;
        }
        Some(match fault {
            Some(fault) => fault,
            None if self.retracted.is_some() => End::Interrupted,
            None if completed => End::Completed,
            None => End::Retracted,
        })
    }
}
