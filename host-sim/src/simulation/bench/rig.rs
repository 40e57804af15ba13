//! What is around a board in memory: its sensors, its drives, its lines, and the faults of them.

use crate::plant::bench::{Channels, CompliantReading, Drive, DriveParameters, Sensors};
use crate::simulation::bench::arm::{BenchArm, BenchBoard};
use crate::simulation::bench::injection::{FaultKind, Injection, TimedFault};
use flexor::control::Controller;
use flexor::fault::Fault;
use flexor::link::{Interlocks, RawSample};
use flexor::phase::Phase;
use flexor::signals::Saturation;
use flexor::supervisor::{DriveScale, MemoryBoard, Supervisor};

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
pub(super) const PERIOD_TICKS_HW: u32 = 1000;

/// A board in memory between the sensors and the drives of an arm.
pub(super) struct Rig {
    /// The board: what its tick reads and writes.
    pub(super) board: MemoryBoard,
    channels: Channels,
    scales: [DriveScale; 2],
    sensors: Sensors,
    drives: [Drive; 2],
    /// The arm's own faults, by the path's time, and others, by the time since enabling.
    injections: [Injection; 2],
    /// The latest counts, of a tick that was lost as well.
    sample: RawSample,
    /// What the drives have been giving, N m.
    target: [f64; 2],
}

impl Rig {
    /// Before an arm that reads `first` and stands at its home pose by the encoders. The drives have
    /// been commanded `planned` (N m) for long; `late` are faults by the time since enabling.
    pub(super) fn new(
        arm: &BenchArm,
        board: &BenchBoard,
        late: &[TimedFault],
        (first, planned): (&CompliantReading, [f64; 2]),
        tick_rate_hz: u32,
    ) -> Self {
        let period_s = 1.0 / f64::from(tick_rate_hz);
        let channels = board.channels;
        let mut sensors = Sensors::new(&arm.sensors, period_s, &first.stimulus(), arm.seed);
        let begin = sensors.sample(&first.stimulus(), &channels);
        let sample = RawSample {
            encoder: [0; 2],
            ..begin
        };
        let mut memory = MemoryBoard::new(sample);
        memory.period_ticks_hw = PERIOD_TICKS_HW;
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
            board: memory,
            channels,
            scales: board.drives,
            sensors,
            drives,
            injections: [
                Injection::new(&arm.faults, &channels, period_s, arm.seed),
                Injection::new(late, &channels, period_s, arm.seed.wrapping_add(1)),
            ],
            sample,
            target: planned,
        }
    }

    /// Moves the arm by hand from its home pose to where it reads `first`.
    pub(super) fn move_by_hand(
        &mut self,
        supervisor: &mut Supervisor<'_>,
        (arm, first): (&BenchArm, &CompliantReading),
    ) {
        let turned = [0, 1].map(|i| {
            let channel = &self.channels.encoder[i];
            let angle = first.motor_angle[i] + arm.sensors.homing_rad[i];
            (angle - channel.home_rad) / channel.rad_per_count
        });
        let furthest = turned.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let moves = (furthest / HAND_COUNTS).ceil().max(1.0) as u32;
        for i in 1..=moves {
            let share = f64::from(i) / f64::from(moves);
            self.board.sample.encoder = turned.map(|counts| (counts * share).round() as i64 as u16);
            supervisor.tick(&mut self.board);
        }
        self.sample = self.board.sample;
    }

    /// What the drives tend to until the next tick, N m.
    pub(super) fn target(&self) -> [f64; 2] {
        self.target
    }

    /// Brings the arm, as `reading` says, to the board's inputs, faults in it: at the path's time and at
    /// the time since enabling, s. False where the board loses this tick, and its inputs stay as they were.
    pub(super) fn sense(&mut self, times_s: [f64; 2], reading: &CompliantReading) -> bool {
        let sensed = self.sensors.sample(&reading.stimulus(), &self.channels);
        self.inject(times_s, sensed)
    }

    /// As [`sense`](Self::sense) where the arm stands on its brakes: the counts before.
    pub(super) fn hold(&mut self, times_s: [f64; 2]) -> bool {
        self.inject(times_s, self.sample)
    }

    fn inject(&mut self, times_s: [f64; 2], sensed: RawSample) -> bool {
        let mut sample = sensed;
        for (injection, t_s) in self.injections.iter_mut().zip(times_s) {
            injection.advance(t_s, &sample, self.target);
            sample = injection.sample(sample);
        }
        self.sample = sample;
        self.board.elapse(PERIOD_TICKS_HW);
        if self.injections.iter().any(Injection::loses_tick) {
            return false;
        }
        self.board.sample = sample;
        self.board.interlocks = Interlocks {
            estop_released: !self.has(FaultKind::EmergencyStop),
            drives_ok: !self.has(FaultKind::DriveFault),
        };
        self.board.timer_due = self.has(FaultKind::TickOverrun);
        true
    }

    /// Whether a fault of this kind acts.
    pub(super) fn has(&self, kind: FaultKind) -> bool {
        self.injections.iter().any(|injection| injection.has(kind))
    }

    /// Makes the drives' torques of what the board has commanded; what the tick gave.
    pub(super) fn give(&mut self, supervisor: &Supervisor<'_>) -> BoardTick {
        let reply = supervisor.last_reply();
        let controller = supervisor.controller();
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
        let injected = self.injections[0].torque(target);
        self.target = self.injections[1].torque(injected);
        BoardTick {
            sample: self.sample,
            torque: command.map_or([0.0; 2], |torque| torque.map(f64::from)),
            saturation,
            fault: (supervisor.status().fault).or(controller.and_then(Controller::retract_cause)),
            phase: controller.map_or(Phase::Hold, Controller::phase),
            begun: controller.is_some_and(Controller::begun),
            integral: controller.map_or(0.0, |controller| f64::from(controller.force_integral())),
            target: self.target,
        }
    }
}
