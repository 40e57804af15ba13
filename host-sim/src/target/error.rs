//! Why a microcontroller could not be talked to.

use super::layout::{DEFAULT_ELF, SLOT_BYTES};
use flexor::link::{BAUD, FrameErrors, Refusal, StartReason};
use std::io;
use std::path::PathBuf;
use std::time::Duration;

/// Why a microcontroller could not be talked to.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// There is no image.
    #[error("{}: no firmware image: {source}; `cargo xtask firmware` builds it in {DEFAULT_ELF}", path.display())]
    NoImage {
        /// Where it was looked for.
        path: PathBuf,
        /// Why it cannot be read.
        source: io::Error,
    },
    /// The image does not say how its log is to be read.
    #[error("{}: {message}", path.display())]
    NoLogTable {
        /// The image.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A slot is too small.
    #[error("the table has {bytes} bytes, a slot takes {SLOT_BYTES}: a shorter task is accepted")]
    TableTooLong {
        /// Its length.
        bytes: usize,
    },
    /// QEMU cannot be started.
    #[error("cannot start {program}: {source}; `cargo xtask setup` installs QEMU")]
    Start {
        /// What was to be started.
        program: String,
        /// Why not.
        source: io::Error,
    },
    /// The serial port cannot be opened.
    #[error("cannot open serial port {port}: {source}")]
    Port {
        /// Its name.
        port: String,
        /// Why not.
        source: serialport::Error,
    },
    /// There is nobody at the address.
    #[error(
        "cannot connect to {port}: {source}; accepted: tcp://HOST:PORT of a `flexor virtual-board --listen HOST:PORT` that runs"
    )]
    Address {
        /// Its name.
        port: String,
        /// Why not.
        source: io::Error,
    },
    /// A board does not answer.
    #[error(
        "{port}: no answer at {BAUD} baud within {:.1} s{}: is the board powered and flashed, and are transmit and receive the right way round?",
        timeout.as_secs_f64(), received_words(*received, *dropped)
    )]
    Silent {
        /// The serial port.
        port: String,
        /// How long was waited.
        timeout: Duration,
        /// Bytes that came all the same.
        received: u64,
        /// Frames that came and could not be read.
        dropped: FrameErrors,
    },
    /// The microcontroller has started again.
    #[error(
        "the microcontroller has started again while its {awaited} was awaited: {}",
        describe_start(start)
    )]
    Restarted {
        /// What was awaited.
        awaited: &'static str,
        /// Why it started.
        start: StartReason,
    },
    /// The line broke, or no answer came in time.
    #[error("the link to the microcontroller failed while waiting for its {awaited}: {source}")]
    Line {
        /// What was awaited.
        awaited: &'static str,
        /// Why.
        source: io::Error,
    },
    /// An answer, but not to the question.
    #[error("the microcontroller answered {found} where its {awaited} was expected")]
    Unexpected {
        /// What was awaited.
        awaited: &'static str,
        /// What came.
        found: String,
    },
    /// The microcontroller does not want to.
    #[error("the microcontroller refused: {0}")]
    Refused(Refusal),
    /// A file for QEMU cannot be written.
    #[error("cannot write into {}: {source}", path.display())]
    Write {
        /// The folder.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
}

/// What came instead of an answer, in words.
fn received_words(received: u64, dropped: FrameErrors) -> String {
    let FrameErrors {
        oversized,
        stuffing,
        version,
        crc,
        message,
    } = dropped;
    if version > 0 {
        return format!(
            " ({version} messages of another protocol version than {} came: the board's firmware is of another version)",
            flexor::link::VERSION
        );
    }
    let bad = u64::from(oversized) + u64::from(stuffing) + u64::from(crc) + u64::from(message);
    match received {
        0 => String::new(),
        _ => format!(" ({received} bytes came, {bad} unreadable messages among them)"),
    }
}

/// Why the microcontroller started, in words.
pub fn describe_start(start: &StartReason) -> String {
    match start {
        StartReason::Normal => "power, reset or a debugger".into(),
        StartReason::Panic { line, file } => {
            format!("a panic in line {line} of the file whose name has the CRC-32 {file:#010x}")
        }
        StartReason::HardFault { pc, status } => {
            format!("a HardFault at {pc:#010x}, fault status {status:#010x}")
        }
        StartReason::Watchdog => "the watchdog was not fed".into(),
        StartReason::StackOverflow { status } => {
            format!("the stack was full, fault status {status:#010x}")
        }
    }
}
