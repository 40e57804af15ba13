//! Disabled, enabled or lock-step: the control tick as the board's interrupt runs it.
//!
//! [`Supervisor::tick`] samples, decides by its state, runs the one controller and commands.
//! It runs in the highest-priority interrupt, for the timer and in lock-step alike, and
//! does not block, allocate, log or loop. The main loop reaches [`Supervisor`] through short
//! locks: a controller is prepared outside and handed over by exchanging two references.

use crate::control::Controller;
use crate::fault::{Fault, Reaction};
use crate::link::{
    Interlocks, Mode, RawSample, Refusal, RunStatus, SensorReport, TELEMETRY_QUEUE,
    TelemetrySample, TickReply,
};
use crate::phase::Phase;
use crate::signals::{Measurement, Saturation};
use crate::supervisor::board::Board;
use crate::supervisor::controller_slot::{ControllerSlot, MonitoredController};
use crate::supervisor::enabling::{EnableInputs, InputHealth, SafetyLimits};
use crate::supervisor::sensing::{Calibration, Sensing};
use crate::supervisor::soft_start::SoftStart;
use crate::supervisor::state::State;
use heapless::Deque;

/// The controller's tick, its command written into the reply. Not inlined, or the compiler makes a copy for each mode.
#[inline(never)]
fn run(controller: &mut Controller<'_, f32>, measured: &Measurement<f32>, result: &mut TickReply) {
    let command = controller.tick(measured);
    result.tick = command.tick;
    result.torque = command.torque;
    result.saturation = command.saturation;
    result.fault = command.fault;
}

/// Carries out the reaction to a fault: off in this tick, anything else from the next one on.
#[cold]
fn react(run: &mut MonitoredController<'_>, fault: Fault, result: &mut TickReply) {
    run.controller.react(fault);
    if matches!(fault.reaction(), Reaction::Hold | Reaction::Stop) {
        run.monitors.stop();
    }
    if let Some(latched) = run.controller.fault() {
        result.torque = [0.0; 2];
        result.fault = Some(latched);
    }
}

/// A tick of a run, upon what is sensed and the `fault` that was found: the reaction to that, the
/// controller, and then its monitors. The torques to command, N m, and whether the brakes open.
#[inline]
fn go_on(
    placed: &mut MonitoredController<'_>,
    start: &mut SoftStart,
    (fault, sensing): (Option<Fault>, &Sensing),
    result: &mut TickReply,
) -> ([f32; 2], bool) {
    if !start.is_over() {
        let torque = raise(placed, start, (fault, sensing), result);
        return (torque, start.is_over());
    }
    if let Some(fault) = fault {
        react(placed, fault, result);
    }
    let measured = sensing.measurement();
    run(&mut placed.controller, &measured, result);
    monitor(placed, sensing, result);
    (result.torque, false)
}

/// Looks at how a run goes.
#[inline]
fn monitor(run: &mut MonitoredController<'_>, sensing: &Sensing, result: &mut TickReply) {
    let deviation = run.controller.deviation();
    if let Some(fault) = run.monitors.tick(sensing, &deviation) {
        react(run, fault, result);
    }
}

/// A tick in which brakes still hold the arm: the controller's first, whose torques are raised.
/// What is to be commanded. Any fault is off: the arm stands on its brakes. The monitors begin when
/// the brakes open.
#[cold]
#[inline(never)]
fn raise(
    placed: &mut MonitoredController<'_>,
    start: &mut SoftStart,
    (fault, sensing): (Option<Fault>, &Sensing),
    result: &mut TickReply,
) -> [f32; 2] {
    if let Some(fault) = fault {
        placed.controller.trip(fault);
        result.torque = [0.0; 2];
        result.fault = placed.controller.fault();
    } else if start.is_new() {
        run(&mut placed.controller, &sensing.measurement(), result);
    }
    let torque = start.advance(result.torque);
    if start.is_over() && result.fault.is_none() {
        monitor(placed, sensing, result);
    }
    torque
}

/// Which ticks go into the telemetry, and those that the main loop has not taken yet.
#[derive(Debug, Default)]
struct Stream {
    samples: Deque<TelemetrySample, TELEMETRY_QUEUE>,
    /// Ticks from sample to sample; 0 for none.
    every: u16,
    /// Ticks until the next sample.
    left: u16,
}

impl Stream {
    /// Whether this tick is one.
    #[inline]
    fn is_due(&mut self) -> bool {
        if self.every == 0 {
            return false;
        }
        if self.left > 1 {
            self.left -= 1;
            return false;
        }
        self.left = self.every;
        true
    }
}

/// What a [`Supervisor`] is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorStatus {
    /// Disabled, enabled, or in lock-step.
    pub mode: Mode,
    /// Tick of the table; 0 when none runs.
    pub tick: u32,
    /// The latched fault, or the one for which an enabled arm has left its table, if any.
    pub fault: Option<Fault>,
    /// The run of an enabled arm.
    pub run: Option<RunStatus>,
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
/// #     monitors: MonitorParameters::NONE,
/// # };
/// use flexor::fault::Fault;
/// use flexor::link::RawSample;
/// use flexor::supervisor::{
///     Calibration, ControllerSlot, MemoryBoard, MonitorParameters, Monitors, SafetyLimits,
///     Supervisor,
/// };
///
/// let calibration = Calibration {
///     encoder_rad: [1e-3; 2],
///     home_rad: [0.0; 2],
///     force_n: (0.01, 2048.0),
///     slope_rad: (1e-4, 2048.0),
///     moment_nm_rad: 2.6,
///     range: (16, 4079),
/// };
/// let limits = SafetyLimits {
///     start_rad: [0.01; 3],
///     start_motor_rad: [0.01; 2],
///     soft_start_ticks: 0,
///     link_timeout_ticks: 100,
/// };
/// let sample = RawSample { force: 2048, strain: 2048, fresh: true, ..RawSample::default() };
/// let mut board = MemoryBoard::new(sample);
/// let (mut running, mut next) = (None, None);
/// let slot = ControllerSlot::new(&mut running);
/// let mut supervisor = Supervisor::new(&mut board, slot, &limits, &calibration, 1000);
///
/// // `parameters` are for a feedforward of 5 N m and -0.5 N m, which `image` holds.
/// let table = Table::open(&image)?;
/// let mut prepared = ControllerSlot::new(&mut next);
/// let monitors = Monitors::new(&MonitorParameters::NONE, &calibration, 1000);
/// prepared.put(parameters.controller(&table)?, monitors);
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
    /// The control period in ticks of the stopwatch, 0 for unknown.
    period_ticks_hw: u32,
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
    stream: Stream,
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
            period_ticks_hw: board.period_ticks_hw(),
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
            stream: Stream::default(),
        }
    }

    /// The oldest sample of the telemetry, which the main loop is to take within a few ticks: what then has
    /// no room is left out.
    #[inline]
    pub fn take_telemetry(&mut self) -> Option<TelemetrySample> {
        self.stream.samples.pop_front()
    }

    /// Puts every so many ticks of an enabled arm into the telemetry, from the next one on; 0 for none.
    pub fn stream(&mut self, every_ticks: u16) {
        self.stream.every = every_ticks;
        self.stream.left = 0;
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
        let enabled = matches!(self.state, State::Enabled { .. });
        match &mut self.state {
            State::LockStep { inbox } => {
                board.off();
                // The host gives the pace.
                if timer {
                    board.run_timer(false);
                }
                if let Some((sequence, measured)) = inbox
                    && let Some(placed) = self.slot.controller()
                {
                    self.outbox.sequence = *sequence;
                    run(&mut placed.controller, measured, &mut self.outbox);
                    *inbox = None;
                }
            }
            State::Disabled => {
                board.off();
                if !timer {
                    board.run_timer(true);
                }
            }
            State::Enabled {
                monitor,
                late,
                start,
            } => {
                if !timer {
                    board.run_timer(true);
                }
                if let Some(placed) = self.slot.controller() {
                    let health = InputHealth {
                        interlocks: self.interlocks,
                        fresh: raw.fresh,
                        in_range: self.sensing.in_range(),
                    };
                    let fault = monitor.tick(&health, *late, begun);
                    let (sensing, outbox) = (&self.sensing, &mut self.outbox);
                    let (torque, opens) = go_on(placed, start, (fault, sensing), outbox);
                    if self.outbox.fault.is_some() {
                        board.off();
                        self.fault = self.outbox.fault;
                        self.state.disable();
                    } else {
                        board.command(torque);
                        if opens {
                            board.release_brakes();
                        }
                        *late = board.timer_due();
                    }
                } else {
                    board.off();
                }
            }
        }
        if enabled && self.stream.is_due() {
            self.sample();
        }
        let ticks_hw = board.stopwatch().wrapping_sub(begun);
        self.ticks_hw_max = self.ticks_hw_max.max(ticks_hw);
        self.outbox.ticks_hw = ticks_hw;
    }

    /// Copies this tick into the telemetry; where nobody takes it in time it is left out.
    #[inline(never)]
    fn sample(&mut self) {
        let Some(controller) = self.slot.look() else {
            return;
        };
        let _ = self.stream.samples.push_back(TelemetrySample {
            tick: self.ticks_total,
            table_tick: self.outbox.tick,
            phase: controller.phase(),
            begun: controller.begun(),
            open: match &self.state {
                State::Enabled { start, .. } => start.is_over(),
                _ => false,
            },
            fault: self.fault.or(controller.retract_cause()),
            raw: self.sensing.raw(),
            torque: self.outbox.torque,
            saturation: self.outbox.saturation,
            force_integral: controller.force_integral(),
        });
    }

    /// Enables the drives from the next tick on and runs the `prepared` controller, which
    /// it takes in exchange for the one before. The caller has made the checks of
    /// [`check_enable`](crate::supervisor::check_enable). With an empty slot the drives stay
    /// off.
    ///
    /// # Errors
    /// [`Refusal::Busy`] unless disabled; nothing is exchanged then.
    pub fn enable(&mut self, prepared: &mut ControllerSlot<'a>) -> Result<(), Refusal> {
        self.state.enable(&self.limits, self.period_ticks_hw)?;
        self.slot.exchange(prepared);
        // Until the first tick the status must not show where the run before ended.
        self.outbox.tick = 0;
        Ok(())
    }

    /// Goes over to the `prepared` controller's table on an enabled arm that stands, from the next
    /// tick on, without a step in the torques: see [`Controller::go_on_from`]. The controller before
    /// is given in exchange. The caller has looked whether the arm stands where the table begins.
    ///
    /// # Errors
    /// [`Refusal::Busy`] unless an enabled arm stands; nothing is exchanged then.
    pub fn go_on(&mut self, prepared: &mut ControllerSlot<'a>) -> Result<(), Refusal> {
        let State::Enabled { .. } = self.state else {
            return Err(Refusal::Busy);
        };
        let goes = match (self.slot.look(), prepared.controller()) {
            (Some(before), Some(next)) => next.controller.go_on_from(before),
            _ => false,
        };
        if !goes {
            return Err(Refusal::Busy);
        }
        self.slot.exchange(prepared);
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

    /// The run of an enabled arm, if its law has a motion around it.
    ///
    /// # Errors
    /// [`Refusal::NotEnabled`], [`Refusal::NoMotion`].
    fn motion(&mut self) -> Result<&mut MonitoredController<'a>, Refusal> {
        let State::Enabled { .. } = self.state else {
            return Err(Refusal::NotEnabled);
        };
        let placed = self.slot.controller().ok_or(Refusal::NotEnabled)?;
        if placed.controller.has_motion() {
            Ok(placed)
        } else {
            Err(Refusal::NoMotion)
        }
    }

    /// Ends an enabled arm's run by the operator's wish: see [`Controller::retract`].
    ///
    /// # Errors
    /// [`Refusal::NotEnabled`]; [`Refusal::NoMotion`] with the paper's law.
    pub fn retract(&mut self) -> Result<(), Refusal> {
        let placed = self.motion()?;
        placed.controller.retract(None);
        // The table asks for nothing any more that the arm could be off; that it comes to rest is.
        placed.monitors.stop();
        Ok(())
    }

    /// Lets an enabled arm's table stand, or go on: see [`Controller::pause`].
    ///
    /// # Errors
    /// [`Refusal::NotEnabled`]; [`Refusal::NoMotion`] with the paper's law; [`Refusal::RunOver`]
    /// where the arm stands or is about to.
    pub fn pause(&mut self, paused: bool) -> Result<(), Refusal> {
        let controller = &mut self.motion()?.controller;
        let phase = controller.phase();
        if phase.stands() || phase == Phase::Retract {
            return Err(Refusal::RunOver);
        }
        controller.pause(paused);
        Ok(())
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

    /// Why an enabled arm has left its table, drives on.
    fn given_up_for(&self) -> Option<Fault> {
        match self.state {
            State::Enabled { .. } => self.controller()?.retract_cause(),
            State::Disabled | State::LockStep { .. } => None,
        }
    }

    /// Where an enabled arm's run is.
    fn run(&self) -> Option<RunStatus> {
        let State::Enabled { .. } = self.state else {
            return None;
        };
        self.controller().map(|controller| RunStatus {
            phase: controller.phase(),
            ticks: controller.ticks(),
            paused: controller.paused(),
            motion: controller.has_motion(),
        })
    }

    /// What it is doing.
    pub fn status(&self) -> SupervisorStatus {
        SupervisorStatus {
            mode: self.state.mode(),
            tick: match self.state {
                State::Disabled => 0,
                State::Enabled { .. } | State::LockStep { .. } => self.outbox.tick,
            },
            fault: self.fault.or(self.given_up_for()),
            run: self.run(),
            ticks_total: self.ticks_total,
            ticks_hw_max: self.ticks_hw_max,
        }
    }
}

#[cfg(test)]
#[path = "supervisor_tests.rs"]
mod tests;
