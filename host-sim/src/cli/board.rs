//! The command `board`: the requests that an operator makes of a microcontroller.
//!
//! The board keeps the arm safe by itself: it enables the drives only when everything is in order, stops
//! at every fault, and 100 ms after the last request. Whatever happens to this process, the
//! drives go off; that it disables as well only makes it sooner.

use super::{CliError, print, print_facts, say};
use crate::files::export;
use crate::target::{DEFAULT_ELF, Emulation, Logs, Target, TargetError, describe_start};
use clap::{Args, Subcommand, ValueEnum};
use flexor::fault::Fault;
use flexor::link::{ClockSource, Identity, Mode, SensorReport, StartReason};
use flexor::table::{Slot, SlotError, TableIdentity};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Map, Value, json};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::{self, IsTerminal};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Between two requests to an enabled arm: 50 a second, where it stops after 100 ms without.
const KEEP_ALIVE: Duration = Duration::from_millis(20);

/// Between two records of `sensors --follow`.
const FOLLOW: Duration = Duration::from_millis(100);

/// Where the microcontroller is.
#[derive(Args)]
pub(super) struct ConnectionArgs {
    /// The firmware's image: what QEMU boots, and the log's symbols
    #[arg(long, value_name = "FILE", default_value = DEFAULT_ELF, global = true)]
    elf: PathBuf,
    /// A board on this serial port instead of QEMU
    #[arg(long, value_name = "PORT", global = true)]
    port: Option<String>,
}

impl ConnectionArgs {
    /// Opens the port, or starts QEMU with a table in slot B. The firmware's log goes to
    /// standard error, past the bar. A board may take `timeout` to answer.
    pub(super) fn open(
        &self,
        table_b: Option<&[u8]>,
        timeout: Duration,
        bar: &ProgressBar,
    ) -> Result<Target, TargetError> {
        let bar = bar.clone();
        let logs = Logs::new(&self.elf, move |line| {
            bar.suspend(|| say(format_args!("firmware: {line}")));
        });
        match &self.port {
            // A board can do without the image; its log cannot be read then.
            Some(port) => {
                if let Err(error) = &logs {
                    say(format_args!("no log: {error}"));
                }
                Target::on_port(port, timeout, logs.ok())
            }
            None => {
                let emulation = Emulation {
                    elf: &self.elf,
                    table_b,
                    accesses: None,
                };
                Target::emulated(&emulation, Some(logs?))
            }
        }
    }
}

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
    /// any error
    #[command(
        after_help = "Example: flexor board enable --port /dev/ttyUSB0 --slot b\n\nTHE ARM MOVES. The board refuses while a fault is latched, the stop is pressed, a drive is not well, or the arm is away from the table's first row. Exit code 0 when the table was run to its end."
    )]
    Enable {
        /// Run this slot's table and no other; without it slot A's, or slot B's where slot A
        /// has none that is usable
        #[arg(long, value_enum)]
        slot: Option<SlotArg>,
    },
    /// Says that the arm stands at its home pose, from which the encoders count
    #[command(
        after_help = "Example: flexor board home --port /dev/ttyUSB0\n\nWanted before enabling, once after every start and after every pil. Nothing moves."
    )]
    Home,
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

/// Why a request to the board came to nothing.
#[derive(Debug, thiserror::Error)]
pub(super) enum BoardError {
    #[error(transparent)]
    Target(#[from] TargetError),
    #[error(
        "stopped by fault {} ({fault}) after tick {tick} of {ticks}, drives off; it is latched until `flexor board acknowledge`",
        fault.number()
    )]
    Fault { fault: Fault, tick: u32, ticks: u32 },
    #[error("somebody else disabled it after tick {tick} of {ticks}")]
    Disabled { tick: u32, ticks: u32 },
    #[error("interrupted and disabled after tick {tick} of {ticks}")]
    Interrupted { tick: u32, ticks: u32 },
    #[error(
        "it did not confirm to be disabled ({0}); an enabled board stops by itself 100 ms after the last request"
    )]
    NotDisarmed(TargetError),
    #[error("signals cannot be caught, so it is not enabled: {0}")]
    Signals(io::Error),
}

impl BoardError {
    /// 2 where the command line is at fault, 1 elsewhere.
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Target(
                TargetError::NoImage { .. }
                | TargetError::NoLogTable { .. }
                | TargetError::Port { .. },
            ) => 2,
            _ => 1,
        }
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
        Verb::Enable { .. } => ProgressBar::new(0),
        Verb::Sensors { follow: true } if !args.json => {
            ProgressBar::with_draw_target(None, ProgressDrawTarget::stdout())
        }
        _ => ProgressBar::hidden(),
    };
    let timeout = Duration::from_secs_f64(args.timeout_s);
    let mut target = args.connection.open(None, timeout, &bar).map_err(failed)?;
    let board = &mut target;
    match args.verb {
        Verb::Identity => {
            let identity = *board.identity();
            // The log of its start comes before the answer to a further request.
            board.status().map_err(failed)?;
            let facts = identity_facts(&identity);
            show(args.json, identity_json(&identity), facts)
        }
        Verb::Status => status(board, args.json),
        Verb::Sensors { follow: true } => follow(board, args.json, &bar),
        Verb::Sensors { follow: false } => {
            let report = board.sensors().map_err(failed)?;
            show(args.json, sensors_json(&report), sensors_facts(&report))
        }
        Verb::Enable { slot } => enable(board, slot.map(Into::into), args.json, &bar),
        Verb::Disable => {
            board
                .disable()
                .map_err(BoardError::NotDisarmed)
                .map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Home => {
            board.home().map_err(failed)?;
            standing(board, args.json)
        }
        Verb::Acknowledge => {
            board.acknowledge().map_err(failed)?;
            standing(board, args.json)
        }
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

/// The firmware's version and commit: `0.1.0`, `1234abcd`, with `+` where sources were
/// changed.
pub(super) fn firmware(identity: &Identity) -> (String, String) {
    let [major, minor, patch] = identity.version;
    let git = u32::from_be_bytes(identity.git);
    let changed = if identity.modified { "+" } else { "" };
    (
        format!("{major}.{minor}.{patch}"),
        format!("{git:08x}{changed}"),
    )
}

fn identity_json(identity: &Identity) -> Map<String, Value> {
    let (version, git) = firmware(identity);
    let hex = |number: u32| json!(format!("{number:#010x}"));
    let slot = |slot: &Result<TableIdentity, SlotError>| match slot {
        Ok(table) => json!({
            "table_crc": hex(table.crc),
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
    }
}

fn identity_facts(identity: &Identity) -> Vec<(&'static str, String)> {
    let (version, git) = firmware(identity);
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
fn table_words(table: &TableIdentity, tick_rate_hz: u32) -> String {
    let seconds = f64::from(table.ticks) / f64::from(tick_rate_hz.max(1));
    format!(
        "table {:#010x}, {} ticks, {seconds:.3} s",
        table.crc, table.ticks
    )
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

fn status(board: &mut Target, json: bool) -> Result<(), CliError> {
    let status = board.status().map_err(failed)?;
    let errors = status.frame_errors;
    let counts = status.counts_max;
    let (instructions, cycles) = (board.instructions(counts), board.cycles(counts));
    let longest = match (instructions, cycles) {
        (Some(count), _) => format!("{count} instructions"),
        (None, Some(count)) => format!("{count} cycles"),
        (None, None) => format!("{counts} counts of the stopwatch"),
    };
    let mut keys = export::object([("mode", json!(mode(status.mode)))]);
    keys.extend(export::object(fault_json(status.fault)));
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
    let facts = vec![
        ("mode", mode(status.mode).to_owned()),
        ("fault", fault_words(status.fault)),
    ];
    show(json, keys, facts)
}

fn sensors_json(report: &SensorReport) -> Map<String, Value> {
    let SensorReport {
        raw,
        measured,
        interlocks,
        in_range,
        homed,
    } = report;
    export::object([
        ("encoder1_counts", json!(raw.encoder[0])),
        ("encoder2_counts", json!(raw.encoder[1])),
        ("force_counts", json!(raw.force)),
        ("strain_counts", json!(raw.strain)),
        ("fresh", json!(raw.fresh)),
        ("in_range", json!(in_range)),
        ("homed", json!(homed)),
        ("theta10_rad", json!(measured.angle[0])),
        ("theta20_rad", json!(measured.angle[1])),
        ("root_slope_rad", json!(measured.root_slope)),
        ("root_slope_rate_rad_s", json!(measured.root_slope_rate)),
        ("force_N", json!(measured.force)),
        ("estop_released", json!(interlocks.estop_released)),
        ("drives_ok", json!(interlocks.drives_ok)),
    ])
}

fn sensors_facts(report: &SensorReport) -> Vec<(&'static str, String)> {
    let SensorReport {
        raw,
        measured,
        interlocks,
        in_range,
        homed,
    } = report;
    let counts = |count: u16| format!("{count:8} counts");
    let rad = |angle: f32| format!("{angle:8.4} rad");
    vec![
        ("encoder 1", counts(raw.encoder[0])),
        ("encoder 2", counts(raw.encoder[1])),
        ("force cell", counts(raw.force)),
        ("strain gauge", counts(raw.strain)),
        (
            "conversions",
            match (raw.fresh, in_range) {
                (true, true) => "fresh".into(),
                (false, _) => "not fresh: force cell and strain gauge gave nothing new".into(),
                (true, false) => {
                    "force cell or strain gauge at its rail: a broken wire, or too much".into()
                }
            },
        ),
        (
            "positions",
            if *homed {
                "known".into()
            } else {
                "counted from where it stood at start: not homed".into()
            },
        ),
        ("theta10", rad(measured.angle[0])),
        ("theta20", rad(measured.angle[1])),
        ("root slope", rad(measured.root_slope)),
        (
            "root slope rate",
            format!("{:8.2} rad/s", measured.root_slope_rate),
        ),
        ("contact force", format!("{:8.3} N", measured.force)),
        (
            "emergency stop",
            if interlocks.estop_released {
                "released".into()
            } else {
                "pressed, or its wire is broken".into()
            },
        ),
        (
            "drives",
            if interlocks.drives_ok {
                "well".into()
            } else {
                "not well, or a wire is broken".into()
            },
        ),
    ]
}

/// Heads of [`sensors_line`]'s columns: names, units. 78 columns, for terminals of 80.
const SENSORS_HEAD: [&str; 2] = [
    " enc1  enc2 force strn theta10 theta20   slope    rate   force stop drives new",
    "              counts     rad     rad     rad   rad/s       N",
];

/// A number in a column; one too large for it, such as an encoder's that counts QEMU's time,
/// in powers of ten.
fn column(value: f32, width: usize, decimals: usize) -> String {
    let plain = format!("{value:width$.decimals$}");
    if plain.len() > width {
        return format!("{value:width$.0e}");
    }
    plain
}

/// The sensors in a line.
fn sensors_line(report: &SensorReport) -> String {
    let SensorReport {
        raw,
        measured: m,
        interlocks,
        in_range,
        ..
    } = report;
    let either = |good: bool, yes: &'static str, no: &'static str| if good { yes } else { no };
    format!(
        "{:5} {:5} {:5} {:4} {} {} {} {} {} {:4} {:6} {:3}",
        raw.encoder[0],
        raw.encoder[1],
        raw.force,
        raw.strain,
        column(m.angle[0], 7, 4),
        column(m.angle[1], 7, 4),
        column(m.root_slope, 7, 4),
        column(m.root_slope_rate, 7, 1),
        column(m.force, 7, 3),
        either(interlocks.estop_released, "free", "STOP"),
        either(interlocks.drives_ok, "well", "FAULTY"),
        either(raw.fresh, either(*in_range, "yes", "END"), "NO"),
    )
}

/// Set by Ctrl-C, a closed terminal, and kill(1).
fn stop_signals() -> Result<Arc<AtomicBool>, CliError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(BoardError::Signals)
            .map_err(failed)?;
    }
    Ok(stop)
}

/// Prints the sensors until a signal.
fn follow(board: &mut Target, json: bool, bar: &ProgressBar) -> Result<(), CliError> {
    let stop = stop_signals()?;
    let on_terminal = !json && io::stdout().is_terminal();
    if let Ok(style) = ProgressStyle::with_template("{msg}") {
        bar.set_style(style);
    }
    if !json {
        SENSORS_HEAD.iter().try_for_each(print)?;
    }
    let begun = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let report = match board.sensors() {
            Ok(report) => report,
            // The signal's end of QEMU, which gets it from the terminal too.
            Err(_) if stop.load(Ordering::Relaxed) => break,
            Err(error) => return Err(failed(error)),
        };
        if on_terminal {
            bar.set_message(sensors_line(&report));
        } else if json {
            let t_s = begun.elapsed().as_secs_f64();
            let mut keys = export::object([("t_s", json!(t_s))]);
            keys.extend(sensors_json(&report));
            print(Value::Object(keys))?;
        } else {
            print(sensors_line(&report))?;
        }
        std::thread::sleep(FOLLOW);
    }
    // The terminal's own "^C" has pushed the last record up, out of the bar's reach.
    bar.finish_and_clear();
    Ok(())
}

/// How an enabled run ended.
enum End {
    Completed,
    Interrupted,
    Fault(Fault),
    Disabled,
}

/// Enables, keeps the link alive, and disables, whatever happens in between.
fn enable(
    board: &mut Target,
    slot: Option<Slot>,
    json: bool,
    bar: &ProgressBar,
) -> Result<(), CliError> {
    let stop = stop_signals()?;
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
        .and_then(|(slot, table)| attend(board, slot, table, json, &stop, bar));
    let disabled = board.disable();
    bar.finish_and_clear();
    let (slot, table, end, tick) = match (ended, disabled) {
        (Ok(ended), Ok(())) => ended,
        (ended, Err(error)) => {
            if let Err(error) = ended {
                say(format_args!("error: {error}"));
            }
            return Err(failed(BoardError::NotDisarmed(error)));
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

#[cfg(test)]
mod tests {
    use super::*;
    use flexor::link::{Interlocks, RawSample};
    use flexor::signals::Measurement;

    #[test]
    fn the_widest_values_stay_below_their_heads_within_80_columns() {
        let report = SensorReport {
            raw: RawSample {
                encoder: [65_535; 2],
                force: 4095,
                strain: 4095,
                fresh: false,
            },
            measured: Measurement {
                angle: [-9.9999, -9635.25],
                root_slope: f32::NEG_INFINITY,
                root_slope_rate: -2500.0,
                force: -20.0,
                ..Measurement::default()
            },
            interlocks: Interlocks {
                estop_released: false,
                drives_ok: false,
            },
            in_range: true,
            homed: true,
        };
        let line = sensors_line(&report);
        assert_eq!(line.len(), SENSORS_HEAD[0].len());
        assert!(line.len() < 80);
        // Each value ends below the last letter of its head, or begins below the first.
        let ends = |text: &str| -> Vec<usize> {
            let bytes = text.as_bytes();
            let last = |i: &usize| bytes[*i] != b' ' && bytes.get(i + 1).is_none_or(|b| *b == b' ');
            (0..text.len()).filter(last).collect()
        };
        assert_eq!(ends(&line)[..9], ends(SENSORS_HEAD[0])[..9]);
    }

    #[test]
    fn a_timeout_is_a_sensible_number_of_seconds() {
        assert_eq!(timeout("0.5"), Ok(0.5));
        for bad in ["0", "-1", "nan", "inf", "1e9", "soon"] {
            assert!(timeout(bad).is_err(), "{bad}");
        }
    }
}
