//! Disarmed, armed or lock-step: the control tick as the board's interrupt runs it.
//!
//! [`Control::tick`] samples, decides by [`Mode`], runs the one controller and commands.
//! It runs in the highest-priority interrupt, for the timer and in lock-step alike, and
//! does not block, allocate, log or loop. The main loop reaches [`Control`] through short
//! locks: a controller is prepared outside and handed over by exchanging two references.

use crate::board::{Drives, Inputs, Sensors, Stopwatch, TickBoard, Timebase};
use crate::controller::Controller;
use crate::guard::{Fault, Limiting};
use crate::law::Measurement;
use crate::safety::{Interlocks, SafetyLimits, Watch};
use crate::sensing::{Calibration, Sensing};
use serde::{Deserialize, Serialize};

/// What the microcontroller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Drives off.
    Disarmed,
    /// Drives on, running the table.
    Armed,
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
    pub limiting: [Limiting; 2],
    /// Latched fault, if any.
    pub fault: Option<Fault>,
    /// Stopwatch counts that the tick took: interrupt handler, sensors and all.
    pub counts: u32,
}

/// A place for a controller. There are two, the tick's and the one in which the main loop
/// prepares the next.
pub type Prepared<'a> = Option<Controller<'a, f32>>;

/// The controller's tick, less the parts of its command that nobody reads here. The table
/// columns behind those then need not be evaluated. Not inlined, or the compiler makes a
/// copy for each mode.
#[inline(never)]
fn run(controller: &mut Controller<'_, f32>, measured: &Measurement<f32>, result: &mut TickReply) {
    let command = controller.tick(measured);
    result.tick = command.tick;
    result.torque = command.torque;
    result.limiting = command.limiting;
    result.fault = command.fault;
}

/// What the tick and the main loop share.
#[derive(Debug)]
pub struct Control<'a> {
    mode: Mode,
    controller: &'a mut Prepared<'a>,
    limits: SafetyLimits,
    sensing: Sensing,
    watch: Watch,
    fault: Option<Fault>,
    /// What the sensors said last.
    measured: Measurement<f32>,
    /// Whether that was new at the last tick.
    fresh: bool,
    interlocks: Interlocks,
    /// A measurement from the host.
    inbox: Measurement<f32>,
    inbox_full: bool,
    /// What the last tick gave, and the sequence number of the measurement in the inbox.
    outbox: TickReply,
    ticks_total: u32,
    counts_max: u32,
    late: bool,
    /// Ticks when the main loop last looked.
    ticks_seen: u32,
}

impl<'a> Control<'a> {
    /// Disarmed, at the home pose. `place` is where the controllers will be.
    pub fn new<S: Sensors, D, T, W>(
        board: &mut TickBoard<S, D, T, W>,
        place: &'a mut Prepared<'a>,
        limits: &SafetyLimits,
        calibration: &Calibration,
        tick_rate_hz: u32,
    ) -> Self {
        let first = board.sensors.sample();
        *place = None;
        Self {
            mode: Mode::Disarmed,
            controller: place,
            limits: *limits,
            sensing: Sensing::new(calibration, tick_rate_hz, &first),
            watch: Watch::new(limits),
            fault: None,
            measured: Measurement::default(),
            fresh: false,
            interlocks: Interlocks {
                stop_released: false,
                drives_well: false,
            },
            inbox: Measurement::default(),
            inbox_full: false,
            outbox: TickReply {
                sequence: 0,
                tick: 0,
                torque: [0.0; 2],
                limiting: [Limiting::No; 2],
                fault: None,
                counts: 0,
            },
            ticks_total: 0,
            counts_max: 0,
            late: false,
            ticks_seen: 0,
        }
    }

    /// One control tick.
    #[inline]
    pub fn tick<S, D, T, W>(&mut self, board: &mut TickBoard<S, D, T, W>)
    where
        S: Sensors,
        D: Drives + Inputs,
        T: Timebase,
        W: Stopwatch,
    {
        let begun = board.stopwatch.counts();
        let timer = board.timebase.acknowledge();
        let raw = board.sensors.sample();
        self.measured = self.sensing.measure(&raw);
        self.fresh = raw.fresh;
        self.interlocks = board.drives.interlocks();
        self.ticks_total = self.ticks_total.wrapping_add(1);
        let lock_step = self.mode == Mode::LockStep;
        if lock_step == timer {
            // In lock-step the host gives the pace, else the timer.
            board.timebase.run(!lock_step);
        }
        let input = match self.mode {
            Mode::Disarmed => None,
            Mode::Armed => Some(&self.measured),
            Mode::LockStep => core::mem::take(&mut self.inbox_full).then_some(&self.inbox),
        };
        let mut torque = None;
        if let (Some(input), Some(controller)) = (input, self.controller.as_mut()) {
            if !lock_step
                && let Some(fault) = self.watch.tick(self.interlocks, raw.fresh, self.late)
            {
                controller.trip(fault);
            }
            run(controller, input, &mut self.outbox);
            if !lock_step {
                torque = Some(self.outbox.torque);
                if self.outbox.fault.is_some() {
                    torque = None;
                    self.fault = self.outbox.fault;
                    self.mode = Mode::Disarmed;
                }
            }
        }
        match torque {
            Some(torque) => board.drives.command(torque),
            None => board.drives.off(),
        }
        self.late = board.timebase.due();
        let counts = board.stopwatch.counts().wrapping_sub(begun);
        self.counts_max = self.counts_max.max(counts);
        self.outbox.counts = counts;
    }

    /// Enables the drives from the next tick on and runs the `prepared` controller, which
    /// it takes in exchange for the one before. The caller has checked that it may.
    pub fn arm(&mut self, prepared: &mut &'a mut Prepared<'a>) {
        core::mem::swap(&mut self.controller, prepared);
        self.watch = Watch::new(&self.limits);
        self.late = false;
        self.mode = Mode::Armed;
    }

    /// Drives off from the next tick on; ends lock-step too.
    pub fn disarm(&mut self) {
        self.mode = Mode::Disarmed;
    }

    /// From the next tick on the host's measurements run the `prepared` controller.
    pub fn start_lock_step(&mut self, prepared: &mut &'a mut Prepared<'a>) {
        core::mem::swap(&mut self.controller, prepared);
        self.inbox_full = false;
        self.mode = Mode::LockStep;
    }

    /// Leaves a measurement for the next tick; false when not in lock-step.
    pub fn put(&mut self, sequence: u32, measured: Measurement<f32>) -> bool {
        let running = self.mode == Mode::LockStep;
        if running {
            self.inbox = measured;
            self.inbox_full = true;
            self.outbox.sequence = sequence;
        }
        running
    }

    /// What the last tick gave.
    pub fn result(&self) -> TickReply {
        self.outbox
    }

    /// True when the tick runs as it should: since the last call it has, or the host gives
    /// the pace.
    pub fn alive(&mut self) -> bool {
        let before = core::mem::replace(&mut self.ticks_seen, self.ticks_total);
        before != self.ticks_total || self.mode == Mode::LockStep
    }

    /// The host has been heard.
    pub fn heard(&mut self) {
        self.watch.heard();
    }

    /// Forgets the latched fault.
    pub fn acknowledge(&mut self) {
        self.fault = None;
    }

    /// What [`crate::safety::may_arm`] wants to know: latched fault, interlocks, and what the
    /// sensors say, if that is new.
    pub fn standing(&self) -> (Option<Fault>, Interlocks, Option<Measurement<f32>>) {
        (
            self.fault,
            self.interlocks,
            self.fresh.then_some(self.measured),
        )
    }

    /// Mode, tick of the table, latched fault, ticks since start, longest tick in
    /// stopwatch counts.
    pub fn report(&self) -> (Mode, u32, Option<Fault>, u32, u32) {
        let tick = match self.mode {
            Mode::Disarmed => 0,
            Mode::Armed | Mode::LockStep => self.outbox.tick,
        };
        (
            self.mode,
            tick,
            self.fault,
            self.ticks_total,
            self.counts_max,
        )
    }
}
