//! `flexor board enable`: runs a table and attends to it until it is over.

use super::identity::table_words;
use super::{failed, fault_json};
use crate::cli::signals::stop_flag;
use crate::cli::{BoardError, CliError, print, say};
use crate::files::export;
use crate::target::{Target, TargetError};
use flexor::fault::Fault;
use flexor::link::{Mode, Program, Status, TelemetrySample};
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

/// What is to be enabled, and how it is shown.
pub(super) struct Attendance {
    /// The slot; without one the first that has a usable table.
    pub(super) slot: Option<Slot>,
    /// What is meant to be there.
    pub(super) program: Program,
    /// Nothing is printed.
    pub(super) quiet: bool,
}

/// How an attended run has ended, disabled.
pub(super) struct Ended {
    /// What that is called.
    pub(super) outcome: &'static str,
    /// How the command ends.
    pub(super) result: Result<(), CliError>,
    fault: Option<Fault>,
    slot: Slot,
    table: TableIdentity,
    tick: u32,
}

/// The slot whose table a program's is.
pub(super) fn slot_of(board: &Target, program: &Program) -> Option<Slot> {
    let has = |slot: &Slot| Program::of(board.identity(), *slot).as_ref() == Some(program);
    Slot::ALL.into_iter().find(has)
}

/// Enables, keeps the link alive, and disables, whatever happens in between; tells how it ended.
pub(super) fn enable(
    board: &mut Target,
    slot: Option<Slot>,
    json: bool,
    bar: &ProgressBar,
) -> Result<(), CliError> {
    let attendance = Attendance {
        slot,
        program: meant(board, slot),
        quiet: json,
    };
    let Ended {
        outcome,
        result,
        fault,
        slot,
        table,
        tick,
    } = attended(board, &attendance, bar, |_| {})?;
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
            ("ticks", json!(table.ticks)),
        ]));
        print(Value::Object(keys))?;
    } else if result.is_ok() {
        print(format_args!("completed, disabled"))?;
    }
    result
}

/// Enables, keeps the link alive, and disables, whatever happens in between. `record` is given what
/// telemetry comes meanwhile.
///
/// # Errors
/// Where nothing was enabled, or it is not known how it ended.
pub(super) fn attended(
    board: &mut Target,
    attendance: &Attendance,
    bar: &ProgressBar,
    mut record: impl FnMut(&[TelemetrySample]),
) -> Result<Ended, CliError> {
    let stop = stop_flag()?;
    let session = session();
    let granted = match board.enable(attendance.slot, attendance.program, session) {
        Err(error @ TargetError::Refused(_)) => {
            // For what it has logged of that; the refusal is known without.
            let _ = board.status();
            return Err(failed(error));
        }
        other => other,
    };
    let ended = granted.map_err(failed).and_then(|(slot, table)| {
        let run = (slot, table, session);
        attend(board, run, attendance.quiet, (stop, bar), &mut record)
    });
    let disabled = board.disable();
    record(&board.take_telemetry());
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
    let (outcome, fault, result) = judged(end, tick, table.ticks);
    Ok(Ended {
        outcome,
        result: result.map_err(failed),
        fault,
        slot,
        table,
        tick,
    })
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
    quiet: bool,
    (stop, bar): (&AtomicBool, &ProgressBar),
    record: &mut impl FnMut(&[TelemetrySample]),
) -> Result<(Slot, TableIdentity, End, u32), CliError> {
    if !quiet {
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
        record(&board.take_telemetry());
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
