//! One board with its sensors and drives: the supervisor in the loop, and the faults around it.

use crate::plant::bench::{Channels, CompliantReading, Drive, DriveParameters, Sensors};
use crate::simulation::bench::arm::{BenchArm, BenchBoard};
use crate::simulation::bench::injection::{FaultKind, Injection};
use flexor::control::Controller;
use flexor::fault::Fault;
use flexor::link::{Interlocks, RawSample, Refusal};
use flexor::phase::Phase;
use flexor::signals::Saturation;
use flexor::supervisor::{
    Calibration, ControllerSlot, DriveScale, MemoryBoard, MonitorParameters, MonitoredController,
    Monitors, StartPose, Supervisor, check_enable,
};

/// What a tick of the board gave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BoardTick {
    /// The counts that it read.
    pub(super) sample: RawSample,
    /// Torques that it commanded, N m; 0 with the drives off.
    pub(super) torque: [f64; 2],
    /// How they were limited, by the board or by the drives, which do not tell it.
    pub(super) saturation: [Saturation; 2],
    /// The latched fault, or what the run was given up for with the drives on.
    pub(super) fault: Option<Fault>,
    /// Where the run is.
    pub(super) phase: Phase,
    /// Whether the table has begun.
    pub(super) begun: bool,
    /// What the law's integral holds, N.
    pub(super) integral: f64,
    /// What the drives tend to until the next tick, N m.
    pub(super) target: [f64; 2],
}

/// Counts that an encoder may pass from one tick to the next while the arm is moved by hand.
const HAND_COUNTS: f64 = 8192.0;

/// What the board's stopwatch counts in a control period.
const PERIOD_TICKS_HW: u32 = 1000;

/// A board, homed and enabled, in the loop.
pub(super) struct Lane<'a> {
    supervisor: Supervisor<'a>,
    /// Where the next controller is made.
    prepared: ControllerSlot<'a>,
    calibration: Calibration,
    board: MemoryBoard,
    channels: Channels,
    scales: [DriveScale; 2],
    sensors: Sensors,
    drives: [Drive; 2],
    injection: Injection,
    /// What the drives have been giving, N m.
    target: [f64; 2],
    refusal: Option<Refusal>,
}

/// Homes a board at its home pose, from where the arm is moved by hand to where it stands.
fn home(
    supervisor: &mut Supervisor<'_>,
    memory: &mut MemoryBoard,
    channels: &Channels,
    (arm, first): (&BenchArm, &CompliantReading),
) {
    // At its home pose the encoders count 0; from there it is moved by hand.
    supervisor.tick(memory);
    let homed = supervisor.home();
    debug_assert!(homed.is_ok(), "a disabled board can be homed");
    let turned = [0, 1].map(|i| {
        let channel = &channels.encoder[i];
        let angle = first.motor_angle[i] + arm.sensors.homing_rad[i];
        (angle - channel.home_rad) / channel.rad_per_count
    });
    let furthest = turned.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let moves = (furthest / HAND_COUNTS).ceil().max(1.0) as u32;
    for i in 1..=moves {
        let share = f64::from(i) / f64::from(moves);
        memory.sample.encoder = turned.map(|counts| (counts * share).round() as i64 as u16);
        supervisor.tick(memory);
    }
}

impl<'a> Lane<'a> {
    /// A board before the arm, which reads `first`: homed, moved to its start, enabled with
    /// what is `placed`. `places` are where the supervisor keeps its controllers. The drives have been
    /// commanded `planned` (N m) for long; the table begins at `start`. Whether the arm is near
    /// enough to that, which a board's link asks before it enables, is told and enables all the
    /// same: what a campaign draws may be farther off, and is to be judged by how it runs.
    pub(super) fn new(
        arm: &BenchArm,
        board: &BenchBoard,
        (placed, places): (
            MonitoredController<'a>,
            &'a mut [Option<MonitoredController<'a>>; 2],
        ),
        first: &CompliantReading,
        (planned, start): ([f64; 2], &StartPose),
        tick_rate_hz: u32,
    ) -> Self {
        let period_s = 1.0 / f64::from(tick_rate_hz);
        let channels = board.channels;
        let mut sensors = Sensors::new(&arm.sensors, period_s, &first.stimulus(), arm.seed);
        let begin = sensors.sample(&first.stimulus(), &channels);
        let mut memory = MemoryBoard::new(RawSample {
            encoder: [0; 2],
            ..begin
        });
        memory.period_ticks_hw = PERIOD_TICKS_HW;
        let [running, next] = places;
        let slot = ControllerSlot::new(running);
        let mut supervisor = Supervisor::new(
            &mut memory,
            slot,
            &board.safety,
            &board.calibration,
            tick_rate_hz,
        );
        home(&mut supervisor, &mut memory, &channels, (arm, first));
        let refusal = check_enable(&board.safety, &supervisor.enable_inputs(), start);
        let mut prepared = ControllerSlot::new(next);
        prepared.put(placed.controller, placed.monitors);
        let enabled = supervisor.enable(&mut prepared);
        debug_assert!(enabled.is_ok(), "a disabled board can be enabled");
        let drives = [0, 1].map(|i| {
            let parameters = DriveParameters {
                limit_nm: arm.parameters.drives[i]
                    .limit_nm
                    .min(board.drive_limit_nm[i]),
                ..arm.parameters.drives[i]
            };
            Drive::new(&parameters, planned[i], arm.seed, 21 + i as u64)
        });
        Self {
            supervisor,
            prepared,
            calibration: board.calibration,
            board: memory,
            channels,
            scales: board.drives,
            sensors,
            drives,
            injection: Injection::new(&arm.faults, &channels, period_s, arm.seed),
            target: planned,
            refusal: refusal.err(),
        }
    }

    /// Why a board would not have been enabled where the arm stands; it is, all the same.
    pub(super) fn refusal(&self) -> Option<Refusal> {
        self.refusal
    }

    /// Whether the arm stands with its drives on, and could go over to another table.
    pub(super) fn stands(&self) -> bool {
        self.board.torque.is_some()
            && (self.supervisor.controller()).is_some_and(|controller| controller.phase().stands())
    }

    /// Goes over to the table of `controller`, with these thresholds of its monitors; whether it does.
    pub(super) fn go_on(
        &mut self,
        controller: Controller<'a, f32>,
        monitors: &MonitorParameters,
        tick_rate_hz: u32,
    ) -> bool {
        let monitors = Monitors::new(monitors, &self.calibration, tick_rate_hz);
        self.prepared.put(controller, monitors);
        self.supervisor.go_on(&mut self.prepared).is_ok()
    }

    /// The tick at `t_s` (s) with the arm as `reading` says.
    pub(super) fn tick(&mut self, t_s: f64, reading: &CompliantReading) -> BoardTick {
        let sensed = self.sensors.sample(&reading.stimulus(), &self.channels);
        self.injection.advance(t_s, &sensed, self.target);
        let sample = self.injection.sample(sensed);
        self.board.elapse(PERIOD_TICKS_HW);
        if !self.injection.loses_tick() {
            self.board.sample = sample;
            self.board.interlocks = Interlocks {
                estop_released: !self.injection.has(FaultKind::EmergencyStop),
                drives_ok: !self.injection.has(FaultKind::DriveFault),
            };
            self.board.timer_due = self.injection.has(FaultKind::TickOverrun);
            if !self.injection.has(FaultKind::LinkLost) {
                self.supervisor.link_alive();
            }
            // Asked at every tick; where there is nothing to pause or to end it is refused.
            let _ = self.supervisor.pause(self.injection.has(FaultKind::Pause));
            if self.injection.has(FaultKind::Retract) {
                let _ = self.supervisor.retract();
            }
            self.supervisor.tick(&mut self.board);
        }
        let reply = self.supervisor.last_reply();
        let controller = self.supervisor.controller();
        let command = self.board.torque;
        // A drive that is disabled gives no torque; one that is enabled what its count says.
        let torque = [0, 1].map(|i| {
            command.map_or(0.0, |torque| {
                let scale = &self.scales[i];
                f64::from(scale.torque(scale.count(torque[i])))
            })
        });
        let asked = [0, 1].map(|i| self.drives[i].command(torque[i]));
        let (target, saturation) = match command {
            Some(_) => (
                asked.map(|(target, _)| target),
                [0, 1].map(|i| reply.saturation[i].or(asked[i].1)),
            ),
            None => ([0.0; 2], [Saturation::None; 2]),
        };
        self.target = self.injection.torque(target);
        BoardTick {
            sample,
            torque: command.map_or([0.0; 2], |torque| torque.map(f64::from)),
            saturation,
            fault: (self.supervisor.status().fault)
                .or(controller.and_then(Controller::retract_cause)),
            phase: controller.map_or(Phase::Hold, Controller::phase),
            begun: controller.is_some_and(Controller::begun),
            integral: controller.map_or(0.0, |controller| f64::from(controller.force_integral())),
            target: self.target,
        }
    }
}
