//! `flexor board identity`: who a microcontroller is.

use crate::cli::connection::firmware_version;
use crate::files::export;
use crate::target::describe_start;
use flexor::link::{ClockSource, Identity, StartReason};
use flexor::table::{SlotError, TableIdentity};
use serde_json::{Map, Value, json};

/// The identity as flat JSON.
pub(super) fn json(identity: &Identity) -> Map<String, Value> {
    let (version, git) = firmware_version(identity);
    let hex = |number: u32| json!(format!("{number:#010x}"));
    let slot = |slot: &Result<TableIdentity, SlotError>| match slot {
        Ok(table) => json!({
            "table_crc": hex(table.crc),
            "table_task": hex(table.task_fingerprint),
            "arm_fingerprint": hex(table.arm_fingerprint),
            "ticks": table.ticks,
        }),
        Err(error) => json!({ "error": error.words() }),
    };
    let start = match identity.start {
        StartReason::Normal => "normal",
        StartReason::Panic { .. } => "panic",
        StartReason::HardFault { .. } => "hard_fault",
        StartReason::Watchdog => "watchdog",
        StartReason::StackOverflow { .. } => "stack_overflow",
    };
    export::object([
        ("firmware_version", json!(version)),
        ("firmware_git", json!(git)),
        ("protocol_version", json!(flexor::link::VERSION)),
        ("started", json!(start)),
        ("started_by", json!(describe_start(&identity.start))),
        ("clock", json!(clock(identity.clock).0)),
        ("core_Hz", json!(identity.core_hz)),
        ("stopwatch_Hz", json!(identity.stopwatch_hz)),
        ("tick_rate_Hz", json!(identity.tick_rate_hz)),
        ("arm_fingerprint", json!(identity.arm_fingerprint.map(hex))),
        ("slot_a", slot(&identity.slots[0])),
        ("slot_b", slot(&identity.slots[1])),
    ])
}

/// A clock's name and description.
fn clock(source: ClockSource) -> (&'static str, &'static str) {
    match source {
        ClockSource::Crystal => ("crystal", "crystal and PLL"),
        ClockSource::InternalPll => (
            "internal_pll",
            "internal oscillator and PLL: the crystal did not start",
        ),
        ClockSource::Internal => (
            "internal",
            "internal oscillator alone: neither crystal nor PLL started",
        ),
        ClockSource::Simulated => ("simulated", "none: a virtual board"),
    }
}

/// The same as facts for a reader.
pub(super) fn facts(identity: &Identity) -> Vec<(&'static str, String)> {
    let (version, git) = firmware_version(identity);
    let slot = |slot: &Result<TableIdentity, SlotError>| match slot {
        Ok(table) => table_words(table, identity.tick_rate_hz),
        Err(error) => error.to_string(),
    };
    vec![
        ("firmware", format!("{version}, commit {git}")),
        ("protocol", format!("version {}", flexor::link::VERSION)),
        ("started by", describe_start(&identity.start)),
        (
            "core clock",
            format!(
                "{} MHz, {}",
                f64::from(identity.core_hz) / 1e6,
                clock(identity.clock).1
            ),
        ),
        ("control rate", format!("{} Hz", identity.tick_rate_hz)),
        (
            "arm",
            match identity.arm_fingerprint {
                Some(fingerprint) => format!("fingerprint {fingerprint:#010x}"),
                None => "the setup in the image is damaged: flash it again".into(),
            },
        ),
        ("slot A", slot(&identity.slots[0])),
        ("slot B", slot(&identity.slots[1])),
    ]
}

/// Which table, and how long it takes.
pub(super) fn table_words(table: &TableIdentity, tick_rate_hz: u32) -> String {
    let seconds = f64::from(table.ticks) / f64::from(tick_rate_hz.max(1));
    format!(
        "table {:#010x}, {} ticks, {seconds:.3} s, task {:#010x}",
        table.crc, table.ticks, table.task_fingerprint
    )
}
