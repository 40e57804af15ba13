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
//! and the variant's fields; a [`Fault`](crate::fault::Fault) as its number, u8. Slots are 0 (A) and 1 (B).
//!
//! | request | bytes |
//! |---|---|
//! | 0 hello | `00` |
//! | 1 status | `01` |
//! | 2 enable | `02`, slot as option, program: table's CRC u32, task fingerprint u32, setup's CRC u32, session u32, all varints |
//! | 3 disable | `03` |
//! | 4 acknowledge | `04` |
//! | 5 start lock-step | `05`, slot, [`Setup`] |
//! | 6 stop lock-step | `06` |
//! | 7 measured | `07`, sequence varint, measurement |
//! | 8 sensors | `08` |
//! | 9 home | `09` |
//! | 10 pause | `0a` |
//! | 11 resume | `0b` |
//! | 12 retract | `0c` |
//! | 13 keep alive | `0d`, session u32 varint |
//! | 14 stream | `0e`, every so many ticks u16 varint, 0 for none |
//! | 15 check | `0f`, slot as option, program as option |
//!
//! A [`Measurement`] is 34 bytes: angle 2 x f32, root slope f32, root slope rate f32, force
//! f32, motor angle 2 x f32, root moment f32, drive 2 x ([`Saturation`](crate::signals::Saturation): 0 none, 1 upper, 2 lower).
//!
//! A [`Setup`] is the arm, 11 x f64 and elbow (0 down, 1 up); the law; and the limits, torque
//! 2 x f64, torque rate 2 x f64. All SI, in the order of
//! [`ArmParameters`](crate::model::ArmParameters), [`LawSetup`](crate::link::LawSetup) and
//! [`LimitSetup`](crate::link::LimitSetup). It has 191 bytes with the paper's law, 8 more for each
//! filter corner that is given, and 290 with the hybrid law.
//!
//! | law | bytes |
//! |---|---|
//! | paper | `00`, `K_DF`, `K_PF`, `K_IF`, `K_w` f64, force filter option of f64, slope rate filter option of f64, force projection as printed bool (else the Jacobian's transpose), slope rate feedback as printed bool (else of the deviation), feedforward bool |
//! | hybrid | `01`, f32 each: joint stiffness 2, joint damping 2, rate filter 2, joint 1's integral, its limit, force integral, torque loop, torque correction's limit, section: frequency, damping, from the angle 2, from the force 2; in the air: stiffness, damping, torque loop, section's frequency, damping, from the angle 2; motion: settling, approach's speed and limit, contact on and off, force ramp, lost, stop, lifting's speed and way |
//!
//! | reply | bytes |
//! |---|---|
//! | 0 identity | `00`, [`Identity`]: firmware version 3 x u16 (varints), git 4 x u8, modified bool, arm fingerprint u32 as option, setup's CRC u32 as option, slots 2 x result of (table, [`SlotError`](crate::table::SlotError)), tick rate, core clock, stopwatch rate, ticks of the stopwatch per 1,000 nops (u32, varints), [`ClockSource`](crate::link::ClockSource), [`StartReason`](crate::link::StartReason) |
//! | 1 status | `01`, [`Status`]: [`Mode`](crate::link::Mode), tick u32, fault as option, [`RunStatus`](crate::link::RunStatus) as option ([`Phase`](crate::phase::Phase) u8, ticks of the table varint, paused bool, motion bool), ticks since start, longest tick, stack (u32), [`FrameErrors`](crate::link::FrameErrors) 5 x u32, bytes lost, log entries lost (u32), all varints |
//! | 2 done | `02` |
//! | 3 refused | `03`, [`Refusal`] |
//! | 4 command | `04`, sequence varint, tick varint, torque 2 x f32, saturation 2 x u8, fault number u8 as option, ticks of the stopwatch varint |
//! | 5 lock-step | `05`, table: CRC u32, arm fingerprint u32, task fingerprint u32, ticks u32, varints |
//! | 6 log | `06`, number of bytes u8 (as varint), and those: one entry of defmt's raw encoding (wire format 4), read with the symbols of the ELF |
//! | 7 enabled | `07`, slot, table as above |
//! | 9 telemetry | `09`, [`TelemetrySample`]: tick, tick of the table (u32, varints), [`Phase`](crate::phase::Phase) u8, begun, brakes open (bools), fault as option, counts: encoders 2 x u16, force u16, strain u16 (varints), fresh bool; torque 2 x f32, saturation 2 x u8, force integral f32 |
//! | 10 obstacles | `0a`, number u8, and those: [`Refusal`] |
//! | 8 sensors | `08`, counts: encoders 2 x u16, force u16, strain u16 (varints), fresh bool; measurement; stop released, drives ok, converters off their rails, homed: bools |
//!
//! # Enabling
//!
//! After a start, and after lock-step, the positions of the joints are not known: *home* says
//! that the arm stands at its home pose, and without it *enable* is refused.
//! *enable* without a slot takes slot A's table, or slot B's where A has none that is usable;
//! with a slot, that slot's and no other. It names the [`Program`] that is meant, table and settings, and
//! is refused where another is found. *enabled* names what runs from now on. *check* tells everything
//! that is in the way at once, and enables nothing.
//!
//! *enable* begins a session, by a number that the host chooses. *keep alive* with that number
//! keeps the arm going, and 100 ms without one stop it; it is answered by a status. No other request
//! does: a host that only looks does not keep an arm enabled whose own host has gone. At the
//! table's end the tick stays at the table's number of ticks and the last torques hold
//! until the host disables.
//!
//! # Telemetry
//!
//! After *stream* an enabled arm's board sends a *telemetry* message every so many ticks, by itself and
//! between answers, until the next *stream* or the next start. What the line has no time for is left
//! out: the ticks in the samples tell.
//!
//! # Pause, resume, retract
//!
//! With the hybrid law *pause* lets the table stand where it is, without leaving the surface, and
//! *resume* lets it go on. *retract* ends the run: the table comes to a stop, the force is taken away,
//! the tip lifted off, and the arm stands with its drives on until the host disables; *status* says
//! in its phase when it does. All three are refused when not enabled and with the paper's law, the
//! first two also when the run is over or being ended; a second *retract* changes nothing.
//!
//! # Lock-step
//!
//! Between start and stop the microcontroller's timer rests and every *measured* request
//! runs one control tick, in the same interrupt that the timer runs it in, with the
//! host's measurement in place of the sensors'. The drives stay disabled. The sequence
//! number comes back unchanged.

use crate::link::program::Program;
use crate::link::refusal::Refusal;
use crate::link::report::{Identity, SensorReport, Status, TickReply};
use crate::link::setup::Setup;
use crate::link::telemetry::TelemetrySample;
use crate::signals::Measurement;
use crate::table::{Slot, TableIdentity};
use serde::{Deserialize, Serialize};

/// What the host may ask for.
// There is one at a time, on the stack, and no box without an allocator.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// Who are you? Answered by [`Reply::Identity`].
    Hello,
    /// How are you? Answered by [`Reply::Status`].
    Status,
    /// Enable the drives and run a table from its first tick. Answered by
    /// [`Reply::Enabled`].
    Enable {
        /// Where the table is; `None` for slot A, or slot B where A has none that is usable.
        slot: Option<Slot>,
        /// What is meant to be there.
        program: Program,
        /// A number of the host's, by which it keeps the arm enabled.
        session: u32,
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
    /// Let the table stand where it is, without leaving the surface.
    Pause,
    /// Let a table that stands go on.
    Resume,
    /// End the run: the table stops, the force is taken away, the tip is lifted off, and the arm
    /// stands with its drives on.
    Retract,
    /// Keeps an arm that this session enabled from stopping with
    /// [`Fault::LinkTimeout`](crate::fault::Fault::LinkTimeout). Answered by [`Reply::Status`].
    KeepAlive {
        /// The session's number.
        session: u32,
    },
    /// Send telemetry of an enabled arm.
    Stream {
        /// Ticks from sample to sample; 0 for none.
        every_ticks: u16,
    },
    /// What is in the way of enabling? Answered by [`Reply::Obstacles`].
    Check {
        /// Where the table is, as of [`Enable`](Self::Enable).
        slot: Option<Slot>,
        /// What is meant to be there, if anything is.
        program: Option<Program>,
    },
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
    /// Not an answer: a tick of an enabled arm.
    Telemetry(TelemetrySample),
    /// Everything that is in the way of enabling; nothing if it is empty.
    Obstacles(Obstacles),
}

/// Most obstacles to enabling at once.
pub const OBSTACLES_MAX: usize = 10;

/// What is in the way of enabling.
pub type Obstacles = heapless::Vec<Refusal, OBSTACLES_MAX>;

/// Most bytes of a log entry.
pub const LOG_MAX: usize = 48;

/// An entry of the log in defmt's raw encoding.
pub type LogEntry = heapless::Vec<u8, LOG_MAX>;

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::fault::Fault;
    use crate::link::testing::{SETUP, TABLE, feed, frame, raw_frame, replies};
    use crate::link::{
        ClockSource, FrameErrors, Interlocks, Mode, RawSample, Receiver, RunStatus, StartReason,
        VERSION,
    };
    use crate::phase::Phase;
    use crate::signals::Saturation;
    use crate::table::SlotError;
    use proptest::prelude::*;

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
                motor: [1.0, -3.5],
                root_moment: 1.25,
                drive: [Saturation::Upper, Saturation::Lower],
            },
        };
        let mut body = std::vec![VERSION, 7, 0xac, 0x02];
        for bits in [0x3f80_0000_u32, 0xc000_0000, 0x3f00_0000, 0xff80_0001, 1] {
            body.extend(bits.to_le_bytes());
        }
        for value in [1.0_f32, -3.5, 1.25] {
            body.extend(value.to_le_bytes());
        }
        body.extend([1, 2]);
        assert_eq!(frame(&measured), raw_frame(&body));
        let command = Reply::Command(TickReply {
            sequence: 1,
            tick: 10_000,
            torque: [-0.0, 1.5],
            saturation: [Saturation::None, Saturation::Upper],
            fault: Some(Fault::LinkTimeout),
            ticks_hw: 128,
        });
        let body = [
            VERSION, 4, 1, 0x90, 0x4e, 0, 0, 0, 0x80, 0, 0, 0xc0, 0x3f, 0, 1, 1, 20, 0x80, 1,
        ];
        assert_eq!(frame(&command), raw_frame(&body));
        let begun = Reply::LockStep(TABLE);
        let body = [VERSION, 5, 0xb4, 0x24, 1, 0xac, 0x02, 0x90, 0x4e];
        assert_eq!(frame(&begun), raw_frame(&body));
        let entry = Reply::Log([7, 0, 255].into_iter().collect());
        assert_eq!(frame(&entry), raw_frame(&[VERSION, 6, 3, 7, 0, 255]));
    }

    #[test]
    fn enabling_and_its_answer_name_the_slot() {
        let program = Program {
            table_crc: 1,
            task_fingerprint: 300,
            setup_crc: 2,
        };
        for (slot, bytes) in [
            (None, &[VERSION, 2, 0, 1, 0xac, 0x02, 2, 3][..]),
            (Some(Slot::A), &[VERSION, 2, 1, 0, 1, 0xac, 0x02, 2, 3]),
            (Some(Slot::B), &[VERSION, 2, 1, 1, 1, 0xac, 0x02, 2, 3]),
        ] {
            let session = 3;
            let enable = Request::Enable {
                slot,
                program,
                session,
            };
            assert_eq!(frame(&enable), raw_frame(bytes));
        }
        let keep = Request::KeepAlive { session: 300 };
        assert_eq!(frame(&keep), raw_frame(&[VERSION, 13, 0xac, 0x02]));
        let check = Request::Check {
            slot: Some(Slot::B),
            program: Some(program),
        };
        let body = [VERSION, 15, 1, 1, 1, 1, 0xac, 0x02, 2];
        assert_eq!(frame(&check), raw_frame(&body));
        let obstacles = [Refusal::NotHomed, Refusal::Latched(Fault::Drive)];
        let reply = Reply::Obstacles(obstacles.into_iter().collect());
        assert_eq!(frame(&reply), raw_frame(&[VERSION, 10, 2, 8, 5, 17]));
        // The request of version 1, which had no slot.
        let mut receiver = Receiver::new();
        assert!(feed(&mut receiver, &raw_frame(&[VERSION, 2])).is_empty());
        assert_eq!(receiver.errors().message, 1);
        let enabled = Reply::Enabled {
            slot: Slot::B,
            table: TABLE,
        };
        let body = [VERSION, 7, 1, 0xb4, 0x24, 1, 0xac, 0x02, 0x90, 0x4e];
        assert_eq!(frame(&enabled), raw_frame(&body));
    }

    #[test]
    fn what_an_operator_does_with_a_run_is_as_documented() {
        for (request, number) in [
            (Request::Pause, 10),
            (Request::Resume, 11),
            (Request::Retract, 12),
        ] {
            assert_eq!(frame(&request), raw_frame(&[VERSION, number]));
            let got = feed(&mut Receiver::new(), &frame(&request));
            assert_eq!(got, [request]);
        }
        let status = Reply::Status(Status {
            mode: Mode::Enabled,
            tick: 300,
            fault: None,
            run: Some(RunStatus {
                phase: Phase::Retract,
                ticks: 10_000,
                paused: true,
                motion: true,
            }),
            ticks_total: 1,
            ticks_hw_max: 2,
            stack_bytes: 3,
            frame_errors: FrameErrors::default(),
            bytes_lost: 4,
            logs_lost: 5,
        });
        let body = [
            VERSION, 1, 1, 0xac, 0x02, 0, 1, 5, 0x90, 0x4e, 1, 1, 1, 2, 3, 0, 0, 0, 0, 0, 4, 5,
        ];
        assert_eq!(frame(&status), raw_frame(&body));
        assert_eq!(replies(&frame(&status)), [status]);
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
                motor: [1.0, -2.5],
                root_moment: -0.25,
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
        for value in [1.0_f32, -2.0, 0.5, 0.0, 1.5, 1.0, -2.5, -0.25] {
            body.extend(value.to_le_bytes());
        }
        body.extend([0, 0, 1, 0, 0, 1]);
        assert_eq!(frame(&report), raw_frame(&body));
        assert_eq!(replies(&frame(&report)), [report]);
    }

    #[test]
    fn telemetry_is_as_documented() {
        let stream = Request::Stream { every_ticks: 300 };
        assert_eq!(frame(&stream), raw_frame(&[VERSION, 14, 0xac, 0x02]));
        let sample = Reply::Telemetry(TelemetrySample {
            tick: 300,
            table_tick: 2,
            phase: Phase::Follow,
            begun: true,
            open: true,
            fault: Some(Fault::NoContact),
            raw: RawSample {
                encoder: [1, 2],
                force: 3,
                strain: 4,
                fresh: true,
            },
            torque: [1.0, -2.0],
            saturation: [Saturation::Upper, Saturation::None],
            force_integral: 0.5,
        });
        let mut body = std::vec![VERSION, 9, 0xac, 0x02, 2, 3, 1, 1, 1, 32, 1, 2, 3, 4, 1];
        body.extend([1.0_f32, -2.0].map(f32::to_le_bytes).concat());
        body.extend([1, 0]);
        body.extend(0.5_f32.to_le_bytes());
        assert_eq!(frame(&sample), raw_frame(&body));
        assert_eq!(replies(&frame(&sample)), [sample]);
        // 40 bytes at most but for the longest run: at 1 Mbaud 2.5 kHz.
        assert!(frame(&sample_at_most()).len() <= 48);
    }

    /// The longest telemetry message.
    fn sample_at_most() -> Reply {
        Reply::Telemetry(TelemetrySample {
            tick: u32::MAX,
            table_tick: 1_000_000,
            phase: Phase::Park,
            begun: true,
            open: true,
            fault: Some(Fault::NoContact),
            raw: RawSample {
                encoder: [u16::MAX; 2],
                force: 4095,
                strain: 4095,
                fresh: true,
            },
            torque: [1.0; 2],
            saturation: [Saturation::None; 2],
            force_integral: 0.5,
        })
    }

    #[test]
    fn the_identity_is_as_documented() {
        let identity = Reply::Identity(Identity {
            version: [0, 1, 300],
            git: [0xde, 0xad, 0, 1],
            modified: true,
            arm_fingerprint: Some(1),
            setup_crc: Some(300),
            slots: [Ok(TABLE), Err(SlotError::Crc)],
            tick_rate_hz: 5000,
            core_hz: 128,
            stopwatch_hz: 64,
            ticks_hw_per_1000_nops: 0,
            clock: ClockSource::InternalPll,
            start: StartReason::Panic { line: 2, file: 3 },
        });
        let body = [
            VERSION, 0, 0, 1, 0xac, 0x02, 0xde, 0xad, 0, 1, 1, 1, 1, 1, 0xac, 0x02, 0, 0xb4, 0x24,
            1, 0xac, 0x02, 0x90, 0x4e, 1, 3, 0x88, 0x27, 0x80, 1, 64, 0, 1, 1, 2, 3,
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
        assert_eq!(bytes.len(), 191 + 16 + 4);
        assert_eq!(Setup::decode(bytes), Some(SETUP));
        let status = Reply::Status(Status {
            mode: Mode::LockStep,
            tick: u32::MAX,
            fault: Some(Fault::Drive),
            run: Some(RunStatus {
                phase: Phase::Park,
                ticks: u32::MAX,
                paused: true,
                motion: true,
            }),
            ticks_total: u32::MAX,
            ticks_hw_max: u32::MAX,
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

    proptest! {
        #[test]
        fn every_measurement_keeps_its_bits(
            sequence: u32, bits: [u32; 8], drive in prop::array::uniform2(0..3_u8),
        ) {
            let drive = drive.map(|d| match d {
                0 => Saturation::None,
                1 => Saturation::Upper,
                _ => Saturation::Lower,
            });
            let [a, b, c, d, e, f, g, h] = bits.map(f32::from_bits);
            let sent = Request::Measured { sequence, measured: Measurement {
                angle: [a, b], root_slope: c, root_slope_rate: d, force: e, motor: [f, g],
                root_moment: h, drive,
            }};
            let got = feed(&mut Receiver::new(), &frame(&sent));
            prop_assert_eq!(got.len(), 1);
            let Request::Measured { sequence: s, measured: m } = got[0] else { panic!() };
            prop_assert_eq!(s, sequence);
            prop_assert_eq!(m.drive, drive);
            let back = [
                m.angle[0], m.angle[1], m.root_slope, m.root_slope_rate, m.force,
                m.motor[0], m.motor[1], m.root_moment,
            ];
            prop_assert_eq!(back.map(f32::to_bits), bits);
        }

    }
}
