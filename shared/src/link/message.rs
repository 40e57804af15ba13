//! Messages between host and microcontroller.
//!
//! The host sends [`Request`]s; the microcontroller answers each with one [`Reply`]. By
//! itself it sends an [`Identity`] when it starts, and its log, a [`Reply::Log`] an entry,
//! between answers and never within a tick. The line is one byte stream in
//! each direction, 8 data bits, no parity, 1 stop bit.
//!
//! # Messages, byte by byte
//!
//! Messages are in postcard's format: fields in the order of their declaration without
//! padding or tags; u8, i8 and bool as one byte; u16, u32 as **varint** (7 bits a byte,
//! low first, high bit set on all but the last); f32, f64 as their IEEE bits, little-endian
//! (every NaN keeps its bits); arrays as their elements; an option as 0, or 1 and its value;
//! a result as 0 and its value, or 1 and its error; an enum as its variant's index (varint)
//! and the variant's fields; a [`Fault`] as its number, u8. Slots are 0 (A) and 1 (B).
//!
//! | request | bytes |
//! |---|---|
//! | 0 hello | `00` |
//! | 1 status | `01` |
//! | 2 enable | `02`, slot as option |
//! | 3 disable | `03` |
//! | 4 acknowledge | `04` |
//! | 5 start lock-step | `05`, slot, [`Setup`] |
//! | 6 stop lock-step | `06` |
//! | 7 measured | `07`, sequence varint, measurement |
//! | 8 sensors | `08` |
//! | 9 home | `09` |
//!
//! A [`Measurement`] is 22 bytes: angle 2 x f32, root slope f32, root slope rate f32, force
//! f32, drive 2 x ([`Saturation`](crate::signals::Saturation): 0 none, 1 upper, 2 lower).
//!
//! A [`Setup`] is 158 bytes, or 8 more for each filter corner that is given: arm 11 x
//! f64 and elbow (0 down, 1 up); law: `K_DF`, `K_PF`, `K_IF`, `K_w` f64, force filter
//! option of f64, slope rate filter option of f64, force projection (0 Jacobian
//! transpose, 1 as printed), slope rate feedback (0 deviation, 1 as printed), feedforward
//! bool; limits: torque 2 x f64, torque rate 2 x f64. All SI, in the order of
//! [`ArmParameters`], [`LawParameters`] and [`LimitParameters`].
//!
//! | reply | bytes |
//! |---|---|
//! | 0 identity | `00`, [`Identity`]: firmware version 3 x u16 (varints), git 4 x u8, modified bool, arm fingerprint u32 as option, slots 2 x result of (table, [`SlotError`]), tick rate, core clock, stopwatch rate, counts per 1,000 nops (u32, varints), [`ClockSource`], [`StartReason`] |
//! | 1 status | `01`, [`Status`]: [`Mode`], tick u32, fault as option, ticks since start, longest tick, stack (u32), [`FrameErrors`] 5 x u32, bytes lost, log entries lost (u32), all varints |
//! | 2 done | `02` |
//! | 3 refused | `03`, [`Refusal`] |
//! | 4 command | `04`, sequence varint, tick varint, torque 2 x f32, saturation 2 x u8, fault number u8 as option, stopwatch counts varint |
//! | 5 lock-step | `05`, table: CRC u32, arm fingerprint u32, ticks u32, varints |
//! | 6 log | `06`, number of bytes u8 (as varint), and those: one entry of defmt's raw encoding (wire format 4), read with the symbols of the ELF |
//! | 7 enabled | `07`, slot, table as above |
//! | 8 sensors | `08`, counts: encoders 2 x u16, force u16, strain u16 (varints), fresh bool; measurement; stop released, drives ok, converters off their rails, homed: bools |
//!
//! # Enabling
//!
//! After a start, and after lock-step, the positions of the joints are not known: *home* says
//! that the arm stands at its home pose, and without it *enable* is refused.
//! *enable* without a slot takes slot A's table, or slot B's where A has none that is usable;
//! with a slot, that slot's and no other. *enabled* names what runs from now on. Any request
//! keeps an enabled arm going, and 100 ms without one stop it; *status* is meant for that. At the
//! table's end the tick stays at the table's number of ticks and the last torques hold
//! until the host disables.
//!
//! # Lock-step
//!
//! Between start and stop the microcontroller's timer rests and every *measured* request
//! runs one control tick, in the same interrupt that the timer runs it in, with the
//! host's measurement in place of the sensors'. The drives stay disabled. The sequence
//! number comes back unchanged.

use super::frame::{FrameErrors, FrameTooLong};
use crate::CRC32;
use crate::control::{LawParameters, LimitParameters};
use crate::fault::Fault;
use crate::model::ArmParameters;
use crate::signals::{Measurement, Saturation};
use crate::table::{Slot, SlotError, TableIdentity};
use core::fmt;
use serde::{Deserialize, Serialize};

/// What a controller is made from, apart from its table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// The arm.
    pub arm: ArmParameters,
    /// Gains and options of the law.
    pub law: LawParameters,
    /// Torque limits.
    pub limits: LimitParameters,
}

impl Setup {
    /// Writes the setup with a CRC-32 behind it, as the firmware's image carries it, and
    /// returns the bytes written.
    ///
    /// # Errors
    /// [`FrameTooLong`] if the buffer is too short.
    pub fn encode<'b>(&self, buffer: &'b mut [u8]) -> Result<&'b [u8], FrameTooLong> {
        postcard::to_slice_crc32(self, buffer, CRC32.digest())
            .map(|bytes| &*bytes)
            .map_err(|_| FrameTooLong)
    }

    /// Reads what [`encode`](Self::encode) wrote; `None` if it is damaged.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        postcard::from_bytes_crc32(bytes, CRC32.digest()).ok()
    }
}

/// What the host may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// Who are you? Answered by [`Reply::Identity`].
    Hello,
    /// How are you? Answered by [`Reply::Status`]; keeps an enabled arm from stopping with
    /// [`Fault::LinkTimeout`].
    Status,
    /// Enable the drives and run a table from its first tick. Answered by
    /// [`Reply::Enabled`].
    Enable {
        /// Where the table is; `None` for slot A, or slot B where A has none that is usable.
        slot: Option<Slot>,
    },
    /// Drives off.
    Disable,
    /// Forget the latched fault. A cause that still stands refuses the next enabling.
    Acknowledge,
    /// Begin lock-step with this table and setup; begins again when already running.
    /// Answered by [`Reply::LockStep`].
    StartLockStep {
        /// Where the table is.
        slot: Slot,
        /// The controller's parameters.
        setup: Setup,
    },
    /// Back to the timer and the sensors, disabled.
    StopLockStep,
    /// One tick of lock-step; answered by [`Reply::Command`].
    Measured {
        /// Comes back with the command.
        sequence: u32,
        /// What the simulated sensors say.
        measured: Measurement<f32>,
    },
    /// What do the sensors and interlocks say? In any mode; answered by
    /// [`Reply::Sensors`].
    Sensors,
    /// The arm stands at its home pose, from which the encoders count. Wanted once after
    /// every start and every lock-step, before the drives can be enabled.
    Home,
}

/// What the microcontroller answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
// A log entry is no larger than an identity.
#[allow(clippy::large_enum_variant)]
pub enum Reply {
    /// Who it is.
    Identity(Identity),
    /// How it is.
    Status(Status),
    /// Done as asked.
    Done,
    /// Not done.
    Refused(Refusal),
    /// The tick's result.
    Command(TickReply),
    /// Lock-step has begun, with this table.
    LockStep(TableIdentity),
    /// Not an answer: an entry of the log.
    Log(LogEntry),
    /// The drives are enabled, and this table runs.
    Enabled {
        /// Where the table is.
        slot: Slot,
        /// Which it is.
        table: TableIdentity,
    },
    /// What the last tick found.
    Sensors(SensorReport),
}

/// Most bytes of a log entry.
pub const LOG_MAX: usize = 48;

/// An entry of the log in defmt's raw encoding.
pub type LogEntry = heapless::Vec<u8, LOG_MAX>;

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
    /// The tables in slots A and B, judged by themselves and against that arm.
    pub slots: [Result<TableIdentity, SlotError>; 2],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Core clock, Hz.
    pub core_hz: u32,
    /// Stopwatch rate on hardware, Hz.
    pub stopwatch_hz: u32,
    /// Stopwatch counts that 1,000 `nop` instructions took at start; makes instructions of
    /// counts under an emulator that counts instructions.
    pub counts_per_1000_nops: u32,
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
    /// Latched fault, if any.
    pub fault: Option<Fault>,
    /// Ticks since start, of the timer and in lock-step.
    pub ticks_total: u32,
    /// Longest tick since start, stopwatch counts.
    pub counts_max: u32,
    /// Deepest stack since start, bytes.
    pub stack_bytes: u32,
    /// Frames that were dropped.
    pub frame_errors: FrameErrors,
    /// Bytes lost because the receive queue was full or the line overran.
    pub bytes_lost: u32,
    /// Log entries lost because nobody read the log in time.
    pub logs_lost: u32,
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
    /// Stopwatch counts that the tick took: interrupt handler, sensors and all.
    pub counts: u32,
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

/// The digital inputs that guard the drives. Wired so that a broken wire reads as bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Interlocks {
    /// The emergency stop is released.
    pub estop_released: bool,
    /// Both drives report to be well.
    pub drives_ok: bool,
}

/// Why the microcontroller does not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Enabled, or in lock-step; the request needs a disabled arm.
    Busy,
    /// Not in lock-step; the request needs it.
    NotInLockStep,
    /// The slot's table is not usable.
    Table(SlotError),
    /// Neither slot's table is usable: slot A's reason, slot B's.
    NoTable(SlotError, SlotError),
    /// The setup in the firmware's image is damaged.
    NoSetup,
    /// A fault is latched; acknowledge it first.
    Latched(Fault),
    /// The cause of this fault is there.
    Cause(Fault),
    /// The arm is not where the table begins.
    AwayFromStart {
        /// Theta10, theta20, root slope less the table's, rad.
        deviation_rad: [f32; 3],
    },
    /// Where the joints are is not known; say so when the arm stands at its home pose.
    NotHomed,
    /// The table may ask for more torque than the limits and the drives allow.
    TooMuchTorque {
        /// Bound of the table's torques, N m.
        planned_nm: [f32; 2],
        /// What is allowed, N m.
        limit_nm: [f32; 2],
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("enabled or in lock-step: disable, or stop lock-step, first"),
            Self::NotInLockStep => f.write_str("not in lock-step: start it first"),
            Self::Table(error) => write!(f, "the slot {error}"),
            Self::NoTable(a, b) => write!(f, "no usable table: slot A {a}, slot B {b}"),
            Self::NoSetup => f.write_str("the setup in the image is damaged: flash it again"),
            Self::Latched(fault) => {
                write!(
                    f,
                    "fault {} ({fault}) is latched: acknowledge it first",
                    fault.number()
                )
            }
            Self::Cause(fault) => write!(
                f,
                "the cause of fault {} ({fault}) is there",
                fault.number()
            ),
            Self::AwayFromStart { deviation_rad } => write!(
                f,
                "the arm is {deviation_rad:?} rad (theta10, theta20, root slope) from the table's first row"
            ),
            Self::NotHomed => f.write_str(
                "the joints' positions are not known since start or lock-step: put the arm in its home pose and say so (home)",
            ),
            Self::TooMuchTorque {
                planned_nm,
                limit_nm,
            } => write!(
                f,
                "the table asks for up to {planned_nm:?} N m, the limits and the drives allow {limit_nm:?}"
            ),
        }
    }
}

impl core::error::Error for Refusal {}

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

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::link::message::{Interlocks, RawSample};
    use crate::link::{FRAME_MAX, Receiver, VERSION, encode};
    use crate::model::Elbow;
    use crate::signals::Saturation;
    use proptest::prelude::*;
    use std::vec::Vec;

    const SETUP: Setup = Setup {
        arm: ArmParameters {
            link1_length_m: 0.5,
            link1_mass_kg: 8.0,
            link2_length_m: 0.55,
            link2_mass_kg: 0.24,
            bending_stiffness_nm2: 0.48,
            damping_ratio: 0.05,
            root_inertia_kgm2: 0.0,
            tip_mass_kg: 0.0,
            tip_inertia_kgm2: 0.0,
            gravity_m_s2: [0.0, 9.81],
            elbow: Elbow::Up,
        },
        law: LawParameters {
            force_filter_hz: Some(50.0),
            slope_rate_filter_hz: Some(20.0),
            ..LawParameters::FEEDFORWARD
        },
        limits: LimitParameters {
            torque_nm: [20.0, 2.0],
            torque_rate_nm_s: [1e3, 1e2],
        },
    };

    const TABLE: TableIdentity = TableIdentity {
        crc: 0x1234,
        arm_fingerprint: 1,
        ticks: 10_000,
    };

    fn frame<M: Serialize>(message: &M) -> Vec<u8> {
        encode(message, &mut [0; FRAME_MAX]).unwrap().to_vec()
    }

    /// A frame around any payload, with a good CRC.
    fn raw_frame(body: &[u8]) -> Vec<u8> {
        let mut payload = body.to_vec();
        payload.extend(CRC32.checksum(body).to_le_bytes());
        let mut bytes = std::vec![0; cobs::max_encoding_length(payload.len())];
        let length = cobs::encode(&payload, &mut bytes);
        bytes.truncate(length);
        bytes.push(0);
        bytes
    }

    fn feed(receiver: &mut Receiver, bytes: &[u8]) -> Vec<Request> {
        bytes.iter().filter_map(|b| receiver.push(*b)).collect()
    }

    fn replies(bytes: &[u8]) -> Vec<Reply> {
        let mut receiver = Receiver::new();
        bytes.iter().filter_map(|b| receiver.push(*b)).collect()
    }

    fn dropped(errors: FrameErrors) -> u32 {
        errors.oversized + errors.stuffing + errors.version + errors.crc + errors.message
    }

    #[test]
    fn bytes_on_the_line_are_as_documented() {
        assert_eq!(frame(&Request::Hello), raw_frame(&[VERSION, 0]));
        let measured = Request::Measured {
            sequence: 300,
            measured: Measurement {
                angle: [1.0, -2.0],
                root_slope: 0.5,
                root_slope_rate: f32::from_bits(0xff80_0001),
                force: f32::from_bits(1),
                drive: [Saturation::Upper, Saturation::Lower],
            },
        };
        let mut body = std::vec![VERSION, 7, 0xac, 0x02];
        for bits in [0x3f80_0000_u32, 0xc000_0000, 0x3f00_0000, 0xff80_0001, 1] {
            body.extend(bits.to_le_bytes());
        }
        body.extend([1, 2]);
        assert_eq!(frame(&measured), raw_frame(&body));
        let command = Reply::Command(TickReply {
            sequence: 1,
            tick: 10_000,
            torque: [-0.0, 1.5],
            saturation: [Saturation::None, Saturation::Upper],
            fault: Some(Fault::LinkTimeout),
            counts: 128,
        });
        let body = [
            VERSION, 4, 1, 0x90, 0x4e, 0, 0, 0, 0x80, 0, 0, 0xc0, 0x3f, 0, 1, 1, 20, 0x80, 1,
        ];
        assert_eq!(frame(&command), raw_frame(&body));
        let begun = Reply::LockStep(TABLE);
        let body = [VERSION, 5, 0xb4, 0x24, 1, 0x90, 0x4e];
        assert_eq!(frame(&begun), raw_frame(&body));
        let entry = Reply::Log([7, 0, 255].into_iter().collect());
        assert_eq!(frame(&entry), raw_frame(&[VERSION, 6, 3, 7, 0, 255]));
    }

    #[test]
    fn arming_and_its_answer_name_the_slot() {
        for (slot, bytes) in [
            (None, &[VERSION, 2, 0][..]),
            (Some(Slot::A), &[VERSION, 2, 1, 0]),
            (Some(Slot::B), &[VERSION, 2, 1, 1]),
        ] {
            assert_eq!(frame(&Request::Enable { slot }), raw_frame(bytes));
        }
        // The request of version 1, which had no slot.
        let mut receiver = Receiver::new();
        assert!(feed(&mut receiver, &raw_frame(&[VERSION, 2])).is_empty());
        assert_eq!(receiver.errors().message, 1);
        let enabled = Reply::Enabled {
            slot: Slot::B,
            table: TABLE,
        };
        let body = [VERSION, 7, 1, 0xb4, 0x24, 1, 0x90, 0x4e];
        assert_eq!(frame(&enabled), raw_frame(&body));
    }

    #[test]
    fn sensors_and_interlocks_are_as_documented() {
        assert_eq!(frame(&Request::Sensors), raw_frame(&[VERSION, 8]));
        assert_eq!(frame(&Request::Home), raw_frame(&[VERSION, 9]));
        let report = Reply::Sensors(SensorReport {
            raw: RawSample {
                encoder: [1, 65_535],
                force: 4095,
                strain: 128,
                fresh: true,
            },
            measured: Measurement {
                angle: [1.0, -2.0],
                root_slope: 0.5,
                root_slope_rate: 0.0,
                force: 1.5,
                drive: [Saturation::None; 2],
            },
            interlocks: Interlocks {
                estop_released: true,
                drives_ok: false,
            },
            in_range: false,
            homed: true,
        });
        let mut body = std::vec![VERSION, 8, 1, 0xff, 0xff, 3, 0xff, 0x1f, 0x80, 1, 1];
        for value in [1.0_f32, -2.0, 0.5, 0.0, 1.5] {
            body.extend(value.to_le_bytes());
        }
        body.extend([0, 0, 1, 0, 0, 1]);
        assert_eq!(frame(&report), raw_frame(&body));
        assert_eq!(replies(&frame(&report)), [report]);
    }

    #[test]
    fn the_identity_is_as_documented() {
        let identity = Reply::Identity(Identity {
            version: [0, 1, 300],
            git: [0xde, 0xad, 0, 1],
            modified: true,
            arm_fingerprint: Some(1),
            slots: [Ok(TABLE), Err(SlotError::Crc)],
            tick_rate_hz: 5000,
            core_hz: 128,
            stopwatch_hz: 64,
            counts_per_1000_nops: 0,
            clock: ClockSource::InternalPll,
            start: StartReason::Panic { line: 2, file: 3 },
        });
        let body = [
            VERSION, 0, 0, 1, 0xac, 0x02, 0xde, 0xad, 0, 1, 1, 1, 1, 0, 0xb4, 0x24, 1, 0x90, 0x4e,
            1, 3, 0x88, 0x27, 0x80, 1, 64, 0, 1, 1, 2, 3,
        ];
        assert_eq!(frame(&identity), raw_frame(&body));
        assert_eq!(replies(&frame(&identity)), [identity]);
    }

    #[test]
    fn the_longest_messages_fit() {
        let start = Request::StartLockStep {
            slot: Slot::B,
            setup: SETUP,
        };
        assert_eq!(feed(&mut Receiver::new(), &frame(&start)), [start]);
        let mut buffer = [0; 256];
        let bytes = SETUP.encode(&mut buffer).unwrap();
        assert_eq!(bytes.len(), 158 + 16 + 4);
        assert_eq!(Setup::decode(bytes), Some(SETUP));
        let status = Reply::Status(Status {
            mode: Mode::LockStep,
            tick: u32::MAX,
            fault: Some(Fault::Drive),
            ticks_total: u32::MAX,
            counts_max: u32::MAX,
            stack_bytes: u32::MAX,
            frame_errors: FrameErrors {
                oversized: u32::MAX,
                stuffing: u32::MAX,
                version: u32::MAX,
                crc: u32::MAX,
                message: u32::MAX,
            },
            bytes_lost: u32::MAX,
            logs_lost: u32::MAX,
        });
        assert_eq!(replies(&frame(&status)), [status]);
    }

    #[test]
    fn each_kind_of_bad_frame_has_its_counter() {
        let mut receiver = Receiver::new();
        let mut expect = FrameErrors::default();
        let mut check = |bytes: &[u8], count: fn(&mut FrameErrors) -> &mut u32| {
            *count(&mut expect) += 1;
            assert!(feed(&mut receiver, bytes).is_empty());
            assert_eq!(receiver.errors(), expect);
            let arm = Request::Enable { slot: None };
            assert_eq!(feed(&mut receiver, &frame(&arm)), [arm]);
        };
        let mut long = std::vec![1; FRAME_MAX + 1];
        long.push(0);
        check(&long, |e| &mut e.oversized);
        check(&[9, 1, 0], |e| &mut e.stuffing);
        check(&[3, 1, 2, 0], |e| &mut e.crc);
        check(&raw_frame(&[VERSION + 1, 0]), |e| &mut e.version);
        check(&raw_frame(&[VERSION - 1, 0]), |e| &mut e.version);
        check(&raw_frame(&[VERSION, 99]), |e| &mut e.message);
        check(&raw_frame(&[VERSION, 0, 0]), |e| &mut e.message); // a byte too many
        check(&raw_frame(&[VERSION, 7, 1]), |e| &mut e.message); // too few
        check(&raw_frame(&[]), |e| &mut e.version);
    }

    #[test]
    fn empty_frames_are_not_errors() {
        let mut receiver = Receiver::new();
        assert!(feed(&mut receiver, &[0; 10]).is_empty());
        assert_eq!(receiver.errors(), FrameErrors::default());
    }

    proptest! {
        #[test]
        fn every_measurement_keeps_its_bits(
            sequence: u32, bits: [u32; 5], drive in prop::array::uniform2(0..3_u8),
        ) {
            let drive = drive.map(|d| match d {
                0 => Saturation::None,
                1 => Saturation::Upper,
                _ => Saturation::Lower,
            });
            let [a, b, c, d, e] = bits.map(f32::from_bits);
            let sent = Request::Measured { sequence, measured: Measurement {
                angle: [a, b], root_slope: c, root_slope_rate: d, force: e, drive,
            }};
            let got = feed(&mut Receiver::new(), &frame(&sent));
            prop_assert_eq!(got.len(), 1);
            let Request::Measured { sequence: s, measured: m } = got[0] else { panic!() };
            prop_assert_eq!(s, sequence);
            prop_assert_eq!(m.drive, drive);
            let back = [m.angle[0], m.angle[1], m.root_slope, m.root_slope_rate, m.force];
            prop_assert_eq!(back.map(f32::to_bits), bits);
        }

        #[test]
        fn after_any_bytes_the_next_good_frame_is_understood(
            noise in prop::collection::vec(any::<u8>(), 0..2000),
        ) {
            let mut receiver = Receiver::new();
            let zeros = noise.iter().filter(|b| **b == 0).count() as u32;
            let from_noise = feed(&mut receiver, &noise).len() as u32;
            prop_assert!(dropped(receiver.errors()) + from_noise <= zeros);
            receiver.push::<Request>(0);
            prop_assert_eq!(feed(&mut receiver, &frame(&Request::Status)), [Request::Status]);
        }

        #[test]
        fn a_truncated_frame_is_counted_and_harms_only_itself(keep in 1..100_usize) {
            let whole = frame(&Request::StartLockStep { slot: Slot::A, setup: SETUP });
            let mut receiver = Receiver::new();
            prop_assert!(feed(&mut receiver, &whole[..keep.min(whole.len() - 2)]).is_empty());
            prop_assert!(feed(&mut receiver, &[0]).is_empty());
            prop_assert_eq!(dropped(receiver.errors()), 1);
            prop_assert_eq!(feed(&mut receiver, &frame(&Request::Disable)), [Request::Disable]);
        }

        #[test]
        fn a_changed_byte_never_passes(at: prop::sample::Index, change in 1..=255_u8) {
            let mut bytes = frame(&Request::StartLockStep { slot: Slot::A, setup: SETUP });
            let end = bytes.len() - 1;
            bytes[at.index(end)] ^= change;
            prop_assert!(feed(&mut Receiver::new(), &bytes).is_empty());
        }

        #[test]
        fn any_body_with_a_good_crc_is_survived(body in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut receiver = Receiver::new();
            let got = feed(&mut receiver, &raw_frame(&body)).len() as u32;
            prop_assert_eq!(got + dropped(receiver.errors()), 1);
        }

        #[test]
        fn a_flood_of_good_frames_is_answered_one_by_one(count in 1..300_usize) {
            let mut receiver = Receiver::new();
            let bytes = frame(&Request::Status).repeat(count);
            prop_assert_eq!(feed(&mut receiver, &bytes).len(), count);
            prop_assert_eq!(receiver.errors(), FrameErrors::default());
        }
    }
}
