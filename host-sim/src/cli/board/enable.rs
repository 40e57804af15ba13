//! `flexor board enable`: runs a table and attends to it until it is over.

use super::identity::table_words;
use super::{failed, fault_json};
use crate::cli::signals::stop_flag;
use crate::cli::{BoardError, CliError, print, say};
use crate::files::export;
use crate::target::{Target, TargetError};
use flexor::fault::Fault;
use flexor::link::Mode;
use flexor::table::{Slot, TableIdentity};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Between two requests to an enabled arm: 50 a second, where it stops after 100 ms without.
const KEEP_ALIVE: Duration = Duration::from_millis(20);

/// How an enabled run ended.
enum End {
    Completed,
    Interrupted,
    Fault(Fault),
    Disabled,
}

/// Enables, keeps the link alive, and disables, whatever happens in between.
pub(super) fn enable(
    board: &mut Target,
    slot: Option<Slot>,
    json: bool,
    bar: &ProgressBar,
) -> Result<(), CliError> {
    let stop = stop_flag()?;
    let granted = match board.enable(slot) {
        Err(error @ TargetError::Refused(_)) => {
            // For what it has logged of that; the refusal is known without.
            let _ = board.status();
            return Err(failed(error));
        }
        other => other,
    };
    let ended = granted
        .map_err(failed)
        .and_then(|(slot, table)| attend(board, slot, table, json, stop, bar));
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
    let (outcome, fault, result) = match end {
        End::Completed => ("completed", None, Ok(())),
        End::Interrupted => (
            "interrupted",
            None,
            Err(BoardError::Interrupted { tick, ticks }),
        ),
        End::Fault(fault) => (
            "fault",
            Some(fault),
            Err(BoardError::Fault { fault, tick, ticks }),
        ),
        End::Disabled => ("disabled", None, Err(BoardError::Disabled { tick, ticks })),
    };
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

/// Keeps the link of an enabled arm alive until it is over: slot, table, how it ended, and the
/// last tick that was seen.
fn attend(
    board: &mut Target,
    slot: Slot,
    table: TableIdentity,
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
    let mut tick = 0;
    loop {
        let status = board.status().map_err(failed)?;
        tick = tick.max(status.tick);
        bar.set_position(tick.into());
        let end = match (status.fault, status.mode) {
            (Some(fault), _) => Some(End::Fault(fault)),
            (None, Mode::Enabled) if tick >= table.ticks => Some(End::Completed),
            (None, Mode::Enabled) => stop.load(Ordering::Relaxed).then_some(End::Interrupted),
            (None, _) => Some(End::Disabled),
        };
        if let Some(end) = end {
            return Ok((slot, table, end, tick));
        }
        std::thread::sleep(KEEP_ALIVE);
    }
}
