//! Disabled, enabled or lock-step: the control tick as the board's interrupt runs it.
//!
//! [`Supervisor::tick`] samples, decides by its state, runs the one controller and commands.
//! It runs in the highest-priority interrupt, for the timer and in lock-step alike, and
//! does not block, allocate, log or loop. The main loop reaches [`Supervisor`] through short
//! locks: a controller is prepared outside and handed over by exchanging two references.

use crate::control::Controller;
use crate::fault::Fault;
use crate::link::{Interlocks, Mode, RawSample, Refusal, SensorReport, TickReply};
use crate::signals::{Measurement, Saturation};
use crate::supervisor::board::Board;
use crate::supervisor::controller_slot::ControllerSlot;
use crate::supervisor::enabling::{EnableInputs, InputHealth, SafetyLimits};
use crate::supervisor::sensing::{Calibration, Sensing};
use crate::supervisor::state::State;

/// The controller's tick, its command written into the reply. Not inlined, or the compiler
/// makes a copy for each mode.
#[inline(never)]
fn run(controller: &mut Controller<'_, f32>, measured: &Measurement<f32>, result: &mut TickReply) {
    let command = controller.tick(measured);
    result.tick = command.tick;
    result.torque = command.torque;
    result.saturation = command.saturation;
    result.fault = command.fault;
}

/// What a [`Supervisor`] is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorStatus {
    /// Disabled, enabled, or in lock-step.
    pub mode: Mode,
    /// Tick of the table; 0 when none runs.
    pub tick: u32,
    /// The latched fault, if any.
    pub fault: Option<Fault>,
    /// Ticks since start, of the timer and in lock-step; wraps.
    pub ticks_total: u32,
    /// Longest tick since start, ticks of the stopwatch.
    pub ticks_hw_max: u32,
}

/// What the tick and the main loop share.
///
/// ```
/// # use flexor::control::{LawParameters, LimitParameters};
/// # use flexor::model::ArmParameters;
/// # use flexor::signals::Reference;
/// # use flexor::supervisor::ControllerParameters;
/// # use flexor::table::{Header, Piece, Table, TableWriter, image_bytes};
/// # let arm = ArmParameters::PAPER;
/// # let pieces = [Piece { ticks: 10, segments: 1 }];
/// # let header = Header {
/// #     arm_fingerprint: arm.fingerprint(),
/// #     task_fingerprint: 0,
/// #     tick_rate_hz: 1000,
/// #     ticks: 10,
/// #     first_tick: 0,
/// #     scaling: [20; 8],
/// # };
/// # let mut image = vec![0; image_bytes(&pieces)];
/// # let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
/// # for _ in 0..4 {
/// #     writer.row(&Reference { torque: [5.0, -0.5], ..Reference::default() })?;
/// # }
/// # writer.finish()?;
/// # let parameters = ControllerParameters {
/// #     arm,
/// #     law: LawParameters::FEEDFORWARD,
/// #     limits: LimitParameters { torque_nm: [20.0, 2.0], torque_rate_nm_s: [1e4, 1e3] },
/// # };
/// use flexor::fault::Fault;
/// use flexor::link::RawSample;
/// use flexor::supervisor::{Calibration, ControllerSlot, MemoryBoard, SafetyLimits, Supervisor};
///
/// let calibration = Calibration {
///     encoder_rad: [1e-3; 2],
///     home_rad: [0.0; 2],
///     force_n: (0.01, 2048.0),
///     slope_rad: (1e-4, 2048.0),
///     moment_nm_rad: 2.6,
///     range: (16, 4079),
/// };
/// let limits = SafetyLimits { start_rad: [0.01; 3], link_timeout_ticks: 100 };
/// let sample = RawSample { force: 2048, strain: 2048, fresh: true, ..RawSample::default() };
/// let mut board = MemoryBoard::new(sample);
/// let (mut running, mut next) = (None, None);
/// let slot = ControllerSlot::new(&mut running);
/// let mut supervisor = Supervisor::new(&mut board, slot, &limits, &calibration, 1000);
///
/// // `parameters` are for a feedforward of 5 N m and -0.5 N m, which `image` holds.
/// let table = Table::open(&image)?;
/// let mut prepared = ControllerSlot::new(&mut next);
/// prepared.put(parameters.controller(&table)?);
/// supervisor.enable(&mut prepared)?;
/// supervisor.tick(&mut board);
/// let torque = board.torque.expect("the drives are on");
/// assert!((torque[0] - 5.0).abs() < 1e-5 && (torque[1] + 0.5).abs() < 1e-5);
///
/// // The next tick after the emergency stop switches off, and says why.
/// board.interlocks.estop_released = false;
/// supervisor.tick(&mut board);
/// assert_eq!(board.torque, None);
/// assert_eq!(supervisor.status().fault, Some(Fault::EmergencyStop));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Supervisor<'a> {
    state: State,
    slot: ControllerSlot<'a>,
    limits: SafetyLimits,
    sensing: Sensing,
    /// The latched fault.
    fault: Option<Fault>,
    /// Where the joints are is known.
    homed: bool,
    interlocks: Interlocks,
    /// What the last tick gave.
    outbox: TickReply,
    ticks_total: u32,
    ticks_hw_max: u32,
    /// Ticks when the main loop last looked.
    ticks_seen: u32,
}

impl<'a> Supervisor<'a> {
    /// Disabled and not homed. The tick's controllers will be in `slot`.
    pub fn new(
        board: &mut impl Board,
        slot: ControllerSlot<'a>,
        limits: &SafetyLimits,
        calibration: &Calibration,
        tick_rate_hz: u32,
    ) -> Self {
        // Of before the first tick's conversions, so not fresh at any of them.
        let first = RawSample {
            fresh: false,
            ..board.sample()
        };
        Self {
            state: State::Disabled,
            slot,
            limits: *limits,
            sensing: Sensing::new(calibration, tick_rate_hz, &first),
            fault: None,
            homed: false,
            interlocks: Interlocks {
                estop_released: false,
                drives_ok: false,
            },
            outbox: TickReply {
                sequence: 0,
                tick: 0,
                torque: [0.0; 2],
                saturation: [Saturation::None; 2],
                fault: None,
                ticks_hw: 0,
            },
            ticks_total: 0,
            ticks_hw_max: 0,
            ticks_seen: 0,
        }
    }

    /// One control tick.
    #[inline]
    pub fn tick(&mut self, board: &mut impl Board) {
        let begun = board.stopwatch();
        let timer = board.acknowledge_timer();
        let raw = board.sample();
        self.sensing.update(&raw);
        self.interlocks = board.interlocks();
        self.ticks_total = self.ticks_total.wrapping_add(1);
        match &mut self.state {
            State::LockStep { inbox } => {
                board.off();
                // The host gives the pace.
                if timer {
                    board.run_timer(false);
                }
                if let Some((sequence, measured)) = inbox
                    && let Some(controller) = self.slot.controller()
                {
                    self.outbox.sequence = *sequence;
                    run(controller, measured, &mut self.outbox);
                    *inbox = None;
                }
            }
            State::Disabled => {
                board.off();
                if !timer {
                    board.run_timer(true);
                }
            }
            State::Enabled { monitor, late } => {
                if !timer {
                    board.run_timer(true);
                }
                if let Some(controller) = self.slot.controller() {
                    let health = InputHealth {
                        interlocks: self.interlocks,
                        fresh: raw.fresh,
                        in_range: self.sensing.in_range(),
                    };
                    if let Some(fault) = monitor.tick(&health, *late) {
                        controller.trip(fault);
                    }
                    run(controller, &self.sensing.measurement(), &mut self.outbox);
                    if self.outbox.fault.is_some() {
                        board.off();
                        self.fault = self.outbox.fault;
                        self.state.disable();
                    } else {
                        board.command(self.outbox.torque);
                        *late = board.timer_due();
                    }
                } else {
                    board.off();
                }
            }
        }
        let ticks_hw = board.stopwatch().wrapping_sub(begun);
        self.ticks_hw_max = self.ticks_hw_max.max(ticks_hw);
        self.outbox.ticks_hw = ticks_hw;
    }

    /// Enables the drives from the next tick on and runs the `prepared` controller, which
    /// it takes in exchange for the one before. The caller has made the checks of
    /// [`check_enable`](crate::supervisor::check_enable). With an empty slot the drives stay
    /// off.
    ///
    /// # Errors
    /// [`Refusal::Busy`] unless disabled; nothing is exchanged then.
    pub fn enable(&mut self, prepared: &mut ControllerSlot<'a>) -> Result<(), Refusal> {
        self.state.enable(&self.limits)?;
        self.slot.exchange(prepared);
        // Until the first tick the status must not show where the run before ended.
        self.outbox.tick = 0;
        Ok(())
    }

    /// Drives off from the next tick on; ends lock-step too.
    pub fn disable(&mut self) {
        self.state.disable();
    }

    /// From the next tick on the host's measurements run the `prepared` controller. The
    /// encoders may turn unseen between two of its ticks: the arm is no longer homed.
    ///
    /// # Errors
    /// [`Refusal::Busy`] if enabled; nothing is exchanged then.
    pub fn start_lock_step(&mut self, prepared: &mut ControllerSlot<'a>) -> Result<(), Refusal> {
        self.state.start_lock_step()?;
        self.slot.exchange(prepared);
        self.homed = false;
        self.outbox.tick = 0;
        Ok(())
    }

    /// Back to the timer and the sensors, disabled.
    ///
    /// # Errors
    /// [`Refusal::NotInLockStep`] unless in lock-step.
    pub fn stop_lock_step(&mut self) -> Result<(), Refusal> {
        self.state.stop_lock_step()
    }

    /// Leaves a measurement for the next tick; false when not in lock-step.
    pub fn post_measurement(&mut self, sequence: u32, measured: Measurement<f32>) -> bool {
        let State::LockStep { inbox } = &mut self.state else {
            return false;
        };
        *inbox = Some((sequence, measured));
        true
    }

    /// The controller that runs, or ran last, for whoever logs its state; `None` before the first.
    pub fn controller(&self) -> Option<&Controller<'a, f32>> {
        self.slot.look()
    }

    /// What the last tick gave.
    pub fn last_reply(&self) -> TickReply {
        self.outbox
    }

    /// True when the tick runs as it should: since the last call it has, or the host gives
    /// the pace.
    pub fn tick_advanced(&mut self) -> bool {
        let before = core::mem::replace(&mut self.ticks_seen, self.ticks_total);
        before != self.ticks_total || matches!(self.state, State::LockStep { .. })
    }

    /// Ends an enabled arm's run by the operator's wish: see [`Controller::retract`].
    pub fn retract(&mut self) {
        if let State::Enabled { .. } = self.state
            && let Some(controller) = self.slot.controller()
        {
            controller.retract(None);
        }
    }

    /// Lets an enabled arm's table stand, or go on: see [`Controller::pause`].
    pub fn pause(&mut self, paused: bool) {
        if let State::Enabled { .. } = self.state
            && let Some(controller) = self.slot.controller()
        {
            controller.pause(paused);
        }
    }

    /// The host has been heard.
    pub fn link_alive(&mut self) {
        if let State::Enabled { monitor, .. } = &mut self.state {
            monitor.link_alive();
        }
    }

    /// The arm stands at its home pose.
    ///
    /// # Errors
    /// [`Refusal::Busy`] unless disabled.
    pub fn home(&mut self) -> Result<(), Refusal> {
        if !matches!(self.state, State::Disabled) {
            return Err(Refusal::Busy);
        }
        self.sensing.home();
        self.homed = true;
        Ok(())
    }

    /// Forgets the latched fault. A cause that still stands refuses the next enabling.
    pub fn acknowledge(&mut self) {
        self.fault = None;
    }

    /// What [`crate::supervisor::enabling::check_enable`] wants to know.
    pub fn enable_inputs(&self) -> EnableInputs {
        EnableInputs {
            latched: self.fault,
            homed: self.homed,
            health: InputHealth {
                interlocks: self.interlocks,
                fresh: self.sensing.raw().fresh,
                in_range: self.sensing.in_range(),
            },
            measured: self.sensing.measurement(),
        }
    }

    /// What the last tick sampled. Before the first tick: the sample at start, and nothing
    /// fresh, released or ok.
    pub fn sensors(&self) -> SensorReport {
        SensorReport {
            raw: self.sensing.raw(),
            measured: self.sensing.measurement(),
            interlocks: self.interlocks,
            in_range: self.sensing.in_range(),
            homed: self.homed,
        }
    }

    /// What it is doing.
    pub fn status(&self) -> SupervisorStatus {
        SupervisorStatus {
            mode: self.state.mode(),
            tick: match self.state {
                State::Disabled => 0,
                State::Enabled { .. } | State::LockStep { .. } => self.outbox.tick,
            },
            fault: self.fault,
            ticks_total: self.ticks_total,
            ticks_hw_max: self.ticks_hw_max,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::control::{LawParameters, LimitParameters};
    use crate::link::RawSample;
    use crate::model::ArmParameters;
    use crate::signals::Reference;
    use crate::supervisor::MemoryBoard;
    use crate::table::{Header, Piece, Table, TableWriter, image_bytes};
    use std::boxed::Box;

    const RATE_HZ: u32 = 1000;
    const TORQUE: [f64; 2] = [5.0, -0.5];
    const LIMITS: SafetyLimits = SafetyLimits {
        start_rad: [0.01; 3],
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
        Controller::new(&table, &arm, &LawParameters::FEEDFORWARD, &limits).unwrap()
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
            let slot = || ControllerSlot::new(Box::leak(Box::new(None)));
            let supervisor = Supervisor::new(&mut board, slot(), &LIMITS, &CALIBRATION, RATE_HZ);
            let mut prepared = slot();
            prepared.put(controller());
            Self {
                board,
                supervisor,
                prepared,
            }
        }

        fn enabled() -> Self {
            let mut rig = Self::new();
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
    fn it_starts_disabled_with_drives_off() {
        let mut rig = Rig::new();
        rig.board.torque = Some([1.0; 2]);
        rig.tick();
        assert_eq!(rig.torque(), None);
        let expected = SupervisorStatus {
            mode: Mode::Disabled,
            tick: 0,
            fault: None,
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
        let causes: [(Fault, Cause); 7] = [
            (Fault::EmergencyStop, |rig| {
                rig.board.interlocks.estop_released = false;
            }),
            (Fault::Drive, |rig| {
                rig.board.interlocks.drives_ok = false;
            }),
            (Fault::SensorsStale, |rig| {
                rig.board.sample.fresh = false;
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
        rig.prepared.put(controller());
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
}
