//! The supervisor, before a board in memory.

extern crate std;
use super::*;
use crate::control::{HybridParameters, LawParameters, LimitParameters};
use crate::link::{RawSample, TELEMETRY_QUEUE};
use crate::model::ArmParameters;
use crate::signals::Reference;
use crate::supervisor::{MemoryBoard, MonitorParameters, Monitors};
use crate::table::{Header, Piece, Table, TableWriter, image_bytes};
use std::boxed::Box;

const RATE_HZ: u32 = 1000;
const TORQUE: [f64; 2] = [5.0, -0.5];
/// The control period by the board's stopwatch.
const PERIOD_TICKS_HW: u32 = 1000;
const LIMITS: SafetyLimits = SafetyLimits {
    start_rad: [0.01; 3],
    start_motor_rad: [0.01; 2],
    soft_start_ticks: 0,
    link_timeout_ticks: 20,
};
const CALIBRATION: Calibration = Calibration {
    encoder_rad: [1e-3; 2],
    home_rad: [0.5, -0.5],
    force_n: (0.01, 2048.0),
    slope_rad: (1e-3, 2048.0),
    moment_nm_rad: 2.6,
    range: (16, 4079),
};

struct Rig {
    board: MemoryBoard,
    supervisor: Supervisor<'static>,
    prepared: ControllerSlot<'static>,
}

/// A controller that gives [`TORQUE`] at every tick.
fn controller() -> Controller<'static, f32> {
    controller_with(&LawParameters::FEEDFORWARD)
}

/// A controller with a law, whose table has [`TORQUE`] at every tick and presses on nothing.
fn controller_with(law: &LawParameters) -> Controller<'static, f32> {
    let arm = ArmParameters::PAPER;
    let header = Header {
        arm_fingerprint: arm.fingerprint(),
        task_fingerprint: 0,
        tick_rate_hz: RATE_HZ,
        ticks: 100,
        first_tick: 0,
        scaling: [20; 8],
    };
    let pieces = [Piece {
        ticks: 100,
        segments: 1,
    }];
    let image = Box::leak(std::vec![0; image_bytes(&pieces)].into_boxed_slice());
    let mut writer = TableWriter::new(image, &header, &pieces).unwrap();
    let row = Reference {
        torque: TORQUE,
        ..Reference::default()
    };
    for _ in 0..pieces[0].rows() {
        writer.row(&row).unwrap();
    }
    writer.finish().unwrap();
    let limits = LimitParameters {
        torque_nm: [20.0, 2.0],
        torque_rate_nm_s: [1e6; 2],
    };
    let table = Table::open(image).unwrap();
    Controller::new(&table, &arm, law, &limits).unwrap()
}

fn silent() -> Monitors {
    Monitors::new(&MonitorParameters::NONE, &CALIBRATION, RATE_HZ)
}

/// True for the table's torques, but for the spline's rounding.
fn planned(torque: [f32; 2]) -> bool {
    (0..2).all(|i| (f64::from(torque[i]) - TORQUE[i]).abs() < 1e-5)
}

impl Rig {
    fn new() -> Self {
        let mut board = MemoryBoard::new(RawSample {
            force: 2048,
            strain: 2048,
            fresh: true,
            ..RawSample::default()
        });
        board.stopwatch_step = 7;
        board.period_ticks_hw = PERIOD_TICKS_HW;
        let slot = || ControllerSlot::new(Box::leak(Box::new(None)));
        let supervisor = Supervisor::new(&mut board, slot(), &LIMITS, &CALIBRATION, RATE_HZ);
        let mut prepared = slot();
        prepared.put(controller(), silent());
        Self {
            board,
            supervisor,
            prepared,
        }
    }

    fn enabled() -> Self {
        Self::enabled_within(0)
    }

    /// Enabled with a soft start of so many ticks, the first of which has passed.
    fn enabled_within(soft_start_ticks: u32) -> Self {
        let mut rig = Self::new();
        rig.supervisor.limits.soft_start_ticks = soft_start_ticks;
        rig.tick();
        rig.supervisor.enable(&mut rig.prepared).unwrap();
        rig.tick();
        rig
    }

    fn tick(&mut self) {
        self.supervisor.tick(&mut self.board);
    }

    fn torque(&self) -> Option<[f32; 2]> {
        self.board.torque
    }
}

#[test]
fn brakes_hold_the_arm_until_its_torques_are_there() {
    const TICKS: u32 = 10;
    let mut rig = Rig::enabled_within(TICKS);
    let mut before = [0.0; 2];
    for tick in 1..=TICKS {
        let torque = rig.torque().unwrap();
        for joint in 0..2 {
            let step = f64::from((torque[joint] - before[joint]).abs());
            let most = TORQUE[joint].abs() / f64::from(TICKS);
            assert!((step - most).abs() < 1e-5, "{tick}: {torque:?}");
        }
        before = torque;
        assert_eq!(rig.board.brakes_released, tick == TICKS);
        // The table waits.
        assert_eq!(rig.supervisor.status().tick, 0);
        rig.tick();
    }
    assert!(rig.torque().is_some_and(planned));
    assert_eq!(rig.supervisor.status().tick, 1);
    rig.supervisor.disable();
    rig.tick();
    assert_eq!((rig.torque(), rig.board.brakes_released), (None, false));
}

#[test]
fn without_a_soft_start_the_first_tick_opens_the_brakes_with_the_whole_torque() {
    for ticks in [0, 1] {
        let rig = Rig::enabled_within(ticks);
        assert!(rig.board.brakes_released && rig.torque().is_some_and(planned));
    }
}

#[test]
fn a_fault_while_torques_are_raised_leaves_the_brakes_closed() {
    let hybrid = HybridParameters::PAPER_ARM_HUB.into();
    for law in [LawParameters::FEEDFORWARD, hybrid] {
        for fails_at in 0..4 {
            let mut rig = Rig::new();
            rig.prepared.put(controller_with(&law), silent());
            rig.supervisor.limits.soft_start_ticks = 5;
            rig.tick();
            rig.supervisor.enable(&mut rig.prepared).unwrap();
            for _ in 0..fails_at {
                rig.tick();
                assert!(rig.torque().is_some() && !rig.board.brakes_released);
            }
            // Which with the hybrid law is a retract once the arm moves.
            rig.board.sample.strain = 0;
            rig.tick();
            assert_eq!((rig.torque(), rig.board.brakes_released), (None, false));
            let status = rig.supervisor.status();
            assert_eq!(status.fault, Some(Fault::SensorRange));
            assert_eq!(status.mode, Mode::Disabled);
        }
    }
}

#[test]
fn brakes_are_closed_whenever_the_drives_are_off() {
    let mut rig = Rig::enabled_within(3);
    // Any order of what a host and the inputs may do.
    let mut x = 1_u32;
    for _ in 0..3000 {
        x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        match x >> 28 {
            0 => rig.supervisor.disable(),
            1 => rig.board.interlocks.estop_released = false,
            2 => {
                rig.board.interlocks.estop_released = true;
                rig.supervisor.acknowledge();
            }
            3 | 4 => {
                rig.prepared.put(controller(), silent());
                let _ = rig.supervisor.enable(&mut rig.prepared);
            }
            5 => {
                rig.prepared.put(controller(), silent());
                let _ = rig.supervisor.start_lock_step(&mut rig.prepared);
            }
            _ => {}
        }
        rig.supervisor.link_alive();
        rig.tick();
        assert!(rig.torque().is_some() || !rig.board.brakes_released);
    }
}

#[test]
fn an_operator_pauses_resumes_and_ends_a_run_that_can() {
    let mut rig = Rig::new();
    let hybrid = HybridParameters::PAPER_ARM_HUB.into();
    rig.prepared.put(controller_with(&hybrid), silent());
    let not_enabled = Err(Refusal::NotEnabled);
    assert_eq!(rig.supervisor.pause(true), not_enabled);
    assert_eq!(rig.supervisor.retract(), not_enabled);
    rig.tick();
    rig.supervisor.enable(&mut rig.prepared).unwrap();
    let run = |rig: &Rig| rig.supervisor.status().run.unwrap();
    for _ in 0..10 {
        rig.supervisor.link_alive();
        rig.tick();
    }
    let before = run(&rig);
    assert_eq!((before.phase, before.ticks), (Phase::Free, 100));
    assert!(before.motion && !before.paused);
    // The table comes to a stop, and goes on.
    let ticks = |rig: &mut Rig| {
        for _ in 0..2000 {
            rig.supervisor.link_alive();
            rig.tick();
        }
        rig.supervisor.status().tick
    };
    rig.supervisor.pause(true).unwrap();
    assert!(run(&rig).paused);
    let stopped = ticks(&mut rig);
    assert!(stopped < 100 && ticks(&mut rig) == stopped, "{stopped}");
    rig.supervisor.pause(false).unwrap();
    assert!(!run(&rig).paused);
    for _ in 0..40 {
        rig.supervisor.link_alive();
        rig.tick();
    }
    assert!(rig.supervisor.status().tick > stopped);
    assert_eq!(rig.supervisor.retract(), Ok(()));
    assert_eq!(run(&rig).phase, Phase::Retract);
    assert_eq!(rig.supervisor.pause(true), Err(Refusal::RunOver));
    assert_eq!(
        rig.supervisor.retract(),
        Ok(()),
        "once more changes nothing"
    );
    ticks(&mut rig);
    assert_eq!(run(&rig).phase, Phase::Hold);
    assert_eq!(rig.supervisor.pause(false), Err(Refusal::RunOver));
    assert!(rig.torque().is_some(), "it stands with its drives on");
    rig.supervisor.disable();
    assert_eq!(rig.supervisor.retract(), not_enabled);
    assert_eq!(rig.supervisor.status().run, None);
}

#[test]
fn the_papers_law_can_neither_pause_nor_retract() {
    let mut rig = Rig::enabled();
    let run = rig.supervisor.status().run.unwrap();
    assert_eq!((run.phase, run.motion), (Phase::Follow, false));
    assert_eq!(rig.supervisor.pause(true), Err(Refusal::NoMotion));
    assert_eq!(rig.supervisor.retract(), Err(Refusal::NoMotion));
    rig.tick();
    assert_eq!(rig.supervisor.status().tick, 1);
}

#[test]
fn it_starts_disabled_with_drives_off() {
    let mut rig = Rig::new();
    rig.board.torque = Some([1.0; 2]);
    rig.tick();
    assert_eq!(rig.torque(), None);
    let expected = SupervisorStatus {
        mode: Mode::Disabled,
        tick: 0,
        fault: None,
        run: None,
        ticks_total: 1,
        ticks_hw_max: 7,
    };
    assert_eq!(rig.supervisor.status(), expected);
    let inputs = rig.supervisor.enable_inputs();
    assert_eq!((inputs.latched, inputs.homed), (None, false));
    assert_eq!(inputs.health.fault(), None);
    assert!((inputs.measured.angle[0] - 0.5).abs() < 1e-6);
}

#[test]
fn homed_is_what_was_said_and_lock_step_forgets_it() {
    let mut rig = Rig::new();
    rig.board.sample.encoder = [300, 0];
    rig.tick();
    assert!((rig.supervisor.enable_inputs().measured.angle[0] - 0.8).abs() < 1e-6);
    rig.supervisor.home().unwrap();
    assert!(rig.supervisor.enable_inputs().homed && rig.supervisor.sensors().homed);
    assert!((rig.supervisor.enable_inputs().measured.angle[0] - 0.5).abs() < 1e-6);
    rig.supervisor.enable(&mut rig.prepared).unwrap();
    assert_eq!(rig.supervisor.home(), Err(Refusal::Busy));
    rig.supervisor.disable();
    assert!(rig.supervisor.enable_inputs().homed);
    rig.supervisor.start_lock_step(&mut rig.prepared).unwrap();
    assert_eq!(rig.supervisor.home(), Err(Refusal::Busy));
    rig.supervisor.disable();
    assert!(!rig.supervisor.enable_inputs().homed);
}

#[test]
fn enabled_it_commands_and_disabled_it_stops() {
    let mut rig = Rig::enabled();
    assert!(rig.torque().is_some_and(planned));
    rig.tick();
    assert_eq!(rig.supervisor.status().tick, 1);
    rig.supervisor.disable();
    rig.tick();
    assert_eq!(rig.torque(), None);
}

#[test]
fn every_cause_stops_an_enabled_arm_at_once_and_is_latched() {
    type Cause = fn(&mut Rig);
    let causes: [(Fault, Cause); 8] = [
        (Fault::EmergencyStop, |rig| {
            rig.board.interlocks.estop_released = false;
        }),
        (Fault::Drive, |rig| {
            rig.board.interlocks.drives_ok = false;
        }),
        (Fault::SensorsStale, |rig| {
            rig.board.sample.fresh = false;
            rig.tick();
            assert!(rig.torque().is_some(), "one conversion may be missing");
        }),
        (Fault::TicksLost, |rig| {
            rig.board.elapse(PERIOD_TICKS_HW + PERIOD_TICKS_HW / 2);
        }),
        (Fault::SensorRange, |rig| {
            rig.board.sample.strain = 4095;
        }),
        (Fault::TickOverrun, |rig| {
            // The tick that is late is found out at its end, so the next one stops.
            rig.board.timer_due = true;
            rig.tick();
            assert!(rig.torque().is_some());
        }),
        (Fault::LinkTimeout, |rig| {
            for _ in 1..LIMITS.link_timeout_ticks {
                rig.tick();
                assert!(rig.torque().is_some());
            }
        }),
        (Fault::MeasurementNotFinite, |rig| {
            rig.supervisor.sensing = Sensing::new(
                &Calibration {
                    force_n: (f32::INFINITY, 0.0),
                    ..CALIBRATION
                },
                RATE_HZ,
                &rig.board.sample,
            );
        }),
    ];
    for (fault, cause) in causes {
        let mut rig = Rig::enabled();
        cause(&mut rig);
        rig.tick();
        assert_eq!(rig.torque(), None, "{fault}");
        let status = rig.supervisor.status();
        assert_eq!((status.mode, status.fault), (Mode::Disabled, Some(fault)));
        assert_eq!(rig.supervisor.enable_inputs().latched, Some(fault));
        rig.tick();
        assert_eq!(rig.torque(), None);
        rig.supervisor.acknowledge();
        assert_eq!(rig.supervisor.enable_inputs().latched, None);
    }
}

#[test]
fn sensors_and_interlocks_are_reported_in_every_mode() {
    let mut rig = Rig::new();
    let report = rig.supervisor.sensors();
    assert!(!report.raw.fresh && !report.interlocks.estop_released);
    let modes: [fn(&mut Rig); 3] = [
        |_| {},
        |rig| rig.supervisor.enable(&mut rig.prepared).unwrap(),
        |rig| {
            rig.supervisor.disable();
            rig.supervisor.start_lock_step(&mut rig.prepared).unwrap();
        },
    ];
    for (i, mode) in modes.into_iter().enumerate() {
        mode(&mut rig);
        let count = 2100 + i as u16;
        rig.board.sample = RawSample {
            encoder: [count, 1],
            force: 2148,
            strain: count,
            fresh: i != 0,
        };
        rig.board.interlocks = Interlocks {
            estop_released: true,
            drives_ok: i != 2,
        };
        rig.tick();
        let report = rig.supervisor.sensors();
        assert_eq!(report.raw, rig.board.sample);
        assert_eq!(report.interlocks, rig.board.interlocks);
        assert!((report.measured.force - 1.0).abs() < 1e-6);
        let slope = (f32::from(count) - 2048.0) * 1e-3;
        assert!((report.measured.root_slope - slope).abs() < 1e-6);
        assert_eq!(rig.supervisor.enable_inputs().health.fresh, i != 0);
    }
}

#[test]
fn enabled_again_it_reports_the_tables_first_tick_at_once() {
    let mut rig = Rig::enabled();
    rig.tick();
    rig.tick();
    assert_eq!(rig.supervisor.status().tick, 2);
    rig.supervisor.disable();
    rig.tick();
    rig.prepared.put(controller(), silent());
    rig.supervisor.enable(&mut rig.prepared).unwrap();
    assert_eq!(rig.supervisor.status().tick, 0);
    rig.tick();
    assert_eq!(rig.supervisor.status().tick, 0);
}

#[test]
fn what_the_state_does_not_allow_is_refused_and_changes_nothing() {
    let mut rig = Rig::enabled();
    // The slot that came back is empty: taken again, it would switch the drives off.
    assert_eq!(rig.supervisor.enable(&mut rig.prepared), Err(Refusal::Busy));
    assert_eq!(
        rig.supervisor.start_lock_step(&mut rig.prepared),
        Err(Refusal::Busy)
    );
    assert_eq!(rig.supervisor.stop_lock_step(), Err(Refusal::NotInLockStep));
    rig.tick();
    assert!(rig.torque().is_some_and(planned));
    assert_eq!(rig.supervisor.status().tick, 1);
}

#[test]
fn telemetry_is_of_every_so_many_ticks_of_an_enabled_arm_and_its_gaps_tell() {
    let mut rig = Rig::enabled();
    rig.supervisor.stream(1);
    let size = TELEMETRY_QUEUE as u32;
    (0..size + 3).for_each(|_| rig.tick());
    let waiting = core::iter::from_fn(|| rig.supervisor.take_telemetry());
    let first = waiting.last().unwrap();
    rig.tick();
    let next = rig.supervisor.take_telemetry().unwrap();
    assert_eq!(next.tick - first.tick, 4);
}

#[test]
fn requests_keep_an_enabled_arm_going() {
    let mut rig = Rig::enabled();
    for _ in 0..5 * LIMITS.link_timeout_ticks {
        rig.supervisor.link_alive();
        rig.tick();
    }
    assert!(rig.torque().is_some());
}

#[test]
fn in_lock_step_the_host_gives_the_pace_and_the_drives_stay_off() {
    let mut rig = Rig::new();
    assert!(!rig.supervisor.post_measurement(1, Measurement::default()));
    rig.supervisor.start_lock_step(&mut rig.prepared).unwrap();
    // The timer's last tick; it rests from then on.
    rig.tick();
    assert!(!rig.board.timer_running);
    // Neither stop nor stale sensors matter to a tick that drives nothing.
    rig.board.interlocks.estop_released = false;
    rig.board.sample.fresh = false;
    for sequence in 7..10 {
        assert!(
            rig.supervisor
                .post_measurement(sequence, Measurement::default())
        );
        rig.tick();
        let reply = rig.supervisor.last_reply();
        assert_eq!((reply.sequence, reply.tick), (sequence, sequence - 7));
        assert!(planned(reply.torque) && reply.ticks_hw == 7);
        assert_eq!(rig.torque(), None);
        assert!(rig.supervisor.tick_advanced());
    }
    rig.supervisor.disable();
    rig.tick();
    assert!(rig.board.timer_running);
    assert!(rig.supervisor.tick_advanced());
    assert!(!rig.supervisor.tick_advanced(), "no tick since");
}
