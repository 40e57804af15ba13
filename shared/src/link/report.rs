//! What the microcontroller tells about itself: who it is, how it is, what its sensors say.

use crate::fault::Fault;
use crate::link::frame::FrameErrors;
use crate::phase::Phase;
use crate::signals::{Measurement, Saturation};
use crate::table::{SlotError, TableIdentity};
use serde::{Deserialize, Serialize};

/// Where the core's clock comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ClockSource {
    /// Crystal and PLL, as designed.
    Crystal,
    /// Internal oscillator and PLL: the crystal did not start; times are good to 1 %.
    InternalPll,
    /// Internal oscillator alone: the PLL did not lock either.
    Internal,
    /// None: a board that is simulated.
    Simulated,
}

/// Why the microcontroller started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StartReason {
    /// Power, reset line, or a debugger.
    Normal,
    /// A panic.
    Panic {
        /// Line of the source file.
        line: u32,
        /// CRC-32 of the file's name.
        file: u32,
    },
    /// A HardFault.
    HardFault {
        /// Program counter at the fault.
        pc: u32,
        /// Configurable fault status register.
        status: u32,
    },
    /// The watchdog was not fed.
    Watchdog,
    /// The stack was full.
    StackOverflow {
        /// Configurable fault status register.
        status: u32,
    },
}

/// Who the microcontroller is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The firmware's version: major, minor, patch.
    pub version: [u16; 3],
    /// First 4 bytes of the firmware's git commit; 0 when built outside a repository.
    pub git: [u8; 4],
    /// True when the sources differed from that commit.
    pub modified: bool,
    /// Fingerprint of the arm in the image; `None` if that part is damaged.
    pub arm_fingerprint: Option<u32>,
    /// CRC-32 of the setup in the image; `None` if it is damaged.
    pub setup_crc: Option<u32>,
    /// The tables in slots A and B, judged by themselves and against that arm.
    pub slots: [Result<TableIdentity, SlotError>; 2],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Core clock, Hz.
    pub core_hz: u32,
    /// Stopwatch rate on hardware, Hz.
    pub stopwatch_hz: u32,
    /// Ticks of the stopwatch that 1,000 `nop` instructions took at start; makes instructions of
    /// counts under an emulator that counts instructions.
    pub ticks_hw_per_1000_nops: u32,
    /// Where the clock comes from.
    pub clock: ClockSource,
    /// Why it started.
    pub start: StartReason,
}

/// How the microcontroller is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// What it is doing.
    pub mode: Mode,
    /// Tick of the table; 0 when none runs.
    pub tick: u32,
    /// Latched fault, if any, or what an enabled arm's run was given up for with the drives on.
    pub fault: Option<Fault>,
    /// The run of an enabled arm; `None` in other modes.
    pub run: Option<RunStatus>,
    /// Ticks since start, of the timer and in lock-step.
    pub ticks_total: u32,
    /// Longest tick since start, ticks of the stopwatch.
    pub ticks_hw_max: u32,
    /// Deepest stack since start, bytes.
    pub stack_bytes: u32,
    /// Frames that were dropped.
    pub frame_errors: FrameErrors,
    /// Bytes lost because the receive queue was full or the line overran.
    pub bytes_lost: u32,
    /// Log entries lost because nobody read the log in time.
    pub logs_lost: u32,
}

/// Where an enabled arm's run is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunStatus {
    /// Where it is, from approach to hold; always `Follow` with the paper's law.
    pub phase: Phase,
    /// Ticks that the table has.
    pub ticks: u32,
    /// The table stands by the operator's wish.
    pub paused: bool,
    /// The law has a motion around it, which can pause and retract: the paper's has none.
    pub motion: bool,
}

/// What the microcontroller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Drives off.
    Disabled,
    /// Drives on, running the table.
    Enabled,
    /// Drives off, ticking for the host.
    LockStep,
}

/// The result of one tick in lock-step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TickReply {
    /// That of the measurement.
    pub sequence: u32,
    /// Tick of the table.
    pub tick: u32,
    /// Torques, N m.
    pub torque: [f32; 2],
    /// How each was limited.
    pub saturation: [Saturation; 2],
    /// Latched fault, if any.
    pub fault: Option<Fault>,
    /// Ticks of the stopwatch that the tick took: interrupt handler, sensors and all.
    pub ticks_hw: u32,
}

/// What the last tick found at the board's inputs, in any mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorReport {
    /// Counts, and whether the conversions were new.
    pub raw: RawSample,
    /// What they mean; `drive` is always [`Saturation::None`], as no drive says that it limits.
    pub measured: Measurement<f32>,
    /// Emergency stop and drives.
    pub interlocks: Interlocks,
    /// Both converters are off their rails.
    pub in_range: bool,
    /// The arm has been said to stand at its home pose; the angles count from there, and
    /// before from where it stood at start.
    pub homed: bool,
}

/// The digital inputs that keep the drives off. Wired so that a broken wire reads as bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Interlocks {
    /// The emergency stop is released.
    pub estop_released: bool,
    /// Both drives report to be ok.
    pub drives_ok: bool,
}

/// Counts of one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RawSample {
    /// Encoders of motor 1 and 2.
    pub encoder: [u16; 2],
    /// Converter at the tip-force cell.
    pub force: u16,
    /// Converter at the root strain gauge.
    pub strain: u16,
    /// True when both conversions are new since the last sample.
    pub fresh: bool,
}
