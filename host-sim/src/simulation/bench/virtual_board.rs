//! A board that answers the link's requests, before an arm of the bench.
//!
//! [`VirtualBoard`] is what is at the other end of a cable: the firmware's own request handler and
//! supervisor, on a board in memory between the sensors and drives of a simulated arm. It knows no
//! clock: whoever has it calls [`VirtualBoard::tick`] once a control period, and hands it the requests.
//!
//! **Brakes and hands.** The arm's time stands still while its brakes are closed: before the drives have
//! taken over, and after they are off. *Home* is a pair of hands: it puts the arm to its home pose, and
//! then to where the scenario starts, everything as new, so that the next run is the run of
//! [`run`](crate::simulation::bench::run) with the same seed, count by count.

use crate::plant::bench::{CompliantPlant, CompliantReading};
use crate::simulation::bench::arm::{BenchArm, BenchBoard, BenchError, period_s, poses};
use crate::simulation::bench::bench::{BenchTask, diverged, path_s};
use crate::simulation::bench::injection::{FaultKind, TimedFault};
use crate::simulation::bench::rig::{PERIOD_TICKS_HW, Rig};
use flexor::control::Controller;
use flexor::link::{ClockSource, Mode, Reply, Request, Setup, StartReason, TelemetrySample};
use flexor::supervisor::{
    BoardConstants, BoardFacts, BoardHealth, ControllerSlot, Event, Exclusive, MemoryBoard,
    MonitoredController, Mutex, RequestHandler, SafetyLimits, Services, Supervisor,
};
use flexor::table::{Slot, SlotError, Table, open_slot};

/// What a virtual board is made of, and where.
pub struct VirtualSetting<'a> {
    task: BenchTask<'a>,
    arm: &'a BenchArm,
    board: BenchBoard,
    constants: BoardConstants,
    setup: Setup,
    faults: Vec<TimedFault>,
    /// The slots' bytes.
    slots: [&'a [u8]; 2],
}

impl<'a> VirtualSetting<'a> {
    /// A board whose image was built for the task's plan, with its table in slot A and nothing in slot
    /// B, before `arm`. `faults` are put into every run, by the time since enabling; those of the arm
    /// itself by the path's. `pace` is how many times faster than a real one it goes: its link's
    /// time-out is so many times longer, so that a host has as long as on a real board.
    pub fn new(task: BenchTask<'a>, arm: &'a BenchArm, faults: Vec<TimedFault>, pace: f64) -> Self {
        let real = task.board.safety;
        let safety = SafetyLimits {
            soft_start_ticks: task.board.soft_start_ticks,
            link_timeout_ticks: (f64::from(real.link_timeout_ticks) * pace.max(1.0)) as u32,
            ..real
        };
        // The gauge is calibrated in N m on the arm itself, by hanging a known weight from it.
        let calibration = task.board.calibration.for_arm(&arm.model.arm);
        Self {
            board: BenchBoard {
                calibration,
                ..*task.board
            },
            constants: BoardConstants {
                calibration,
                safety,
                drive_limit_nm: task.board.drive_limit_nm,
                tick_rate_hz: task.plan.tick_rate_hz,
            },
            setup: task.setup(),
            slots: [task.image, &ERASED],
            task,
            arm,
            faults,
        }
    }

    /// Control rate, Hz.
    pub fn tick_rate_hz(&self) -> u32 {
        self.constants.tick_rate_hz
    }
}

/// What is read of a slot in erased flash.
const ERASED: [u8; 64] = [0xff; 64];

/// Where the controllers of a virtual board live.
pub type VirtualPlaces<'a> = [Option<MonitoredController<'a>>; 2];

/// A run: ticks since enabling, ticks since the brakes opened, and the tick of those with which the
/// table began.
#[derive(Clone, Copy, Debug, Default)]
struct Course {
    ticks: usize,
    open: Option<usize>,
    begun: Option<usize>,
    paused: bool,
}

/// A board before a simulated arm, which answers requests.
pub struct VirtualBoard<'a> {
    setting: &'a VirtualSetting<'a>,
    plant: CompliantPlant<f64>,
    reading: CompliantReading,
    rig: Rig,
    supervisor: Supervisor<'a>,
    handler: RequestHandler<'a>,
    course: Option<Course>,
    health: BoardHealth,
}

impl<'a> VirtualBoard<'a> {
    /// A board that has just started, its arm at the home pose.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn new(
        setting: &'a VirtualSetting<'a>,
        places: &'a mut VirtualPlaces<'a>,
    ) -> Result<Self, BenchError> {
        let constants = &setting.constants;
        let (plant, reading, mut rig) = at_start(setting)?;
        let [running, next] = places;
        let supervisor = Supervisor::new(
            &mut rig.board,
            ControllerSlot::new(running),
            &constants.safety,
            &constants.calibration,
            constants.tick_rate_hz,
        );
        let stopwatch_hz = PERIOD_TICKS_HW * constants.tick_rate_hz;
        let facts = BoardFacts {
            version: version(),
            git: [0; 4],
            modified: false,
            core_hz: stopwatch_hz,
            stopwatch_hz,
            ticks_hw_per_1000_nops: 0,
            clock: ClockSource::Simulated,
            start: StartReason::Normal,
        };
        let prepared = ControllerSlot::new(next);
        Ok(Self {
            setting,
            plant,
            reading,
            rig,
            supervisor,
            handler: RequestHandler::new(Some(&setting.setup), constants, facts, prepared),
            course: None,
            health: BoardHealth::default(),
        })
    }

    /// The reply to a request; `None` while a fault keeps the board from hearing it.
    ///
    /// # Errors
    /// [`BenchError`] where the arm cannot be put to its start.
    pub fn answer(&mut self, request: &Request) -> Result<Option<Reply>, BenchError> {
        if self.rig.has(FaultKind::LinkLost) && self.mode() == Mode::Enabled {
            return Ok(None);
        }
        let homes = *request == Request::Home && self.mode() == Mode::Disabled;
        if homes {
            (self.plant, self.reading, self.rig) = at_start(self.setting)?;
            self.supervisor.tick(&mut self.rig.board);
        }
        let mut services = Shelf {
            slots: self.setting.slots,
            tick_rate_hz: self.setting.constants.tick_rate_hz,
            board: &mut self.rig.board,
            health: self.health,
        };
        let supervisor = &mut Exclusive(&mut self.supervisor);
        let reply = self.handler.answer(request, supervisor, &mut services);
        if homes {
            let at = (self.setting.arm, &self.reading);
            self.rig.move_by_hand(&mut self.supervisor, at);
        }
        Ok(Some(reply))
    }

    /// The oldest sample of the telemetry that waits.
    pub fn telemetry(&mut self) -> Option<TelemetrySample> {
        self.supervisor.take_telemetry()
    }

    /// What it is doing.
    pub fn mode(&self) -> Mode {
        self.supervisor.status().mode
    }

    /// How stack, line and log are, as [`Request::Status`] is answered from now on.
    pub fn set_health(&mut self, health: BoardHealth) {
        self.health = health;
    }

    /// The arm as it is.
    pub fn reading(&self) -> &CompliantReading {
        &self.reading
    }

    /// A control period: what the timer's interrupt does, and what the arm does until the next one.
    /// Nothing in lock-step, where the timer rests.
    pub fn tick(&mut self) {
        if !self.rig.board.timer_running {
            return;
        }
        if self.mode() != Mode::Enabled {
            self.course = None;
            self.supervisor.tick(&mut self.rig.board);
            return;
        }
        let mut course = self.course.unwrap_or_default();
        let runs = self.sense(&course);
        if runs {
            self.wish(&mut course);
            self.supervisor.tick(&mut self.rig.board);
        }
        let open = self.rig.board.brakes_released;
        // The brakes are closed: what the drives do on them moves nothing.
        if open {
            let given = self.rig.give(&self.supervisor);
            let now = *course.open.get_or_insert(0);
            if given.begun && course.begun.is_none() {
                course.begun = Some(now);
            }
            course.open = Some(now + 1);
        }
        course.ticks += 1;
        // Off: whatever comes next begins anew.
        self.course = self.rig.board.torque.is_some().then_some(course);
    }

    /// Lets the arm go on by a period, and the board see it; false where it loses this tick.
    fn sense(&mut self, course: &Course) -> bool {
        let task = &self.setting.task;
        let open = course.open.unwrap_or(0);
        let times_s = [
            path_s(task, course.begun, open),
            course.ticks as f64 * period_s(task.plan),
        ];
        if course.open.is_some() && !diverged(&self.reading) {
            self.plant.advance(self.rig.target());
            self.reading = self.plant.read();
        }
        if course.open.is_some() || course.ticks == 0 {
            return self.rig.sense(times_s, &self.reading);
        }
        self.rig.hold(times_s)
    }

    /// What a scenario's operator wants.
    fn wish(&mut self, course: &mut Course) {
        let paused = self.rig.has(FaultKind::Pause);
        // Where there is nothing to pause or to end it is refused.
        if paused != course.paused {
            let _ = self.supervisor.pause(paused);
            course.paused = paused;
        }
        if self.rig.has(FaultKind::Retract) {
            let _ = self.supervisor.retract();
        }
    }

    /// The controller that runs, or ran last.
    pub fn controller(&self) -> Option<&Controller<'a, f32>> {
        self.supervisor.controller()
    }
}

/// The arm where its scenario starts, and a board before it that has just started.
fn at_start(
    setting: &VirtualSetting<'_>,
) -> Result<(CompliantPlant<f64>, CompliantReading, Rig), BenchError> {
    let (plan, arm) = (setting.task.plan, setting.arm);
    let mut plant = CompliantPlant::<f64>::new(&[arm.lane()], period_s(plan), &poses(plan))?;
    let reading = plant.read();
    let at = (&reading, arm.held(plan));
    let rig = Rig::new(arm, &setting.board, &setting.faults, at, plan.tick_rate_hz);
    Ok((plant, reading, rig))
}

/// This package's version: major, minor, patch.
fn version() -> [u16; 3] {
    let mut parts = env!("CARGO_PKG_VERSION").split(['.', '-', '+']);
    [(); 3].map(|()| parts.next().and_then(|part| part.parse().ok()).unwrap_or(0))
}

/// What a virtual board has besides its tick.
struct Shelf<'b, 'a> {
    slots: [&'a [u8]; 2],
    tick_rate_hz: u32,
    board: &'b mut MemoryBoard,
    health: BoardHealth,
}

impl<'a> Services<'a> for Shelf<'_, 'a> {
    fn open(&self, slot: Slot, arm_fingerprint: Option<u32>) -> Result<Table<'a>, SlotError> {
        let bytes = match slot {
            Slot::A => self.slots[0],
            Slot::B => self.slots[1],
        };
        open_slot(bytes, arm_fingerprint, self.tick_rate_hz)
    }

    fn request_tick<M: Mutex<T = Supervisor<'a>>>(&mut self, supervisor: &mut M) {
        supervisor.lock(|supervisor| supervisor.tick(self.board));
    }

    fn health(&self) -> BoardHealth {
        self.health
    }

    /// It has no log: what it would say it answers.
    fn note(&mut self, _: &Event) {}
}
