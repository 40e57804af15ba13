//! A [`Board`] that is nothing but values in memory: what the sensors say is written into it,
//! what the drives are told is read from it.
//!
//! Public and not only for tests, because a simulator that is to run the whole firmware
//! logic (sensing, fault monitor, modes) needs just this between its plant and
//! [`Supervisor::tick`](crate::supervisor::Supervisor::tick). It needs no allocation, so it
//! is here and not in the host's package.

use crate::link::{Interlocks, RawSample};
use crate::supervisor::board::Board;
use core::cell::Cell;

/// A board in memory. All values may be changed between two ticks.
///
/// While [`timer_running`](Self::timer_running) every tick counts as one of the timer's;
/// else as requested by software, as in lock-step.
#[derive(Clone, Debug)]
pub struct MemoryBoard {
    /// What encoders and converters read.
    pub sample: RawSample,
    /// What the emergency stop and the drives' fault lines read.
    pub interlocks: Interlocks,
    /// Torques (tau1, tau2) that the enabled drives were last commanded, N m; `None` when
    /// they are disabled.
    pub torque: Option<[f32; 2]>,
    /// The brakes are open.
    pub brakes_released: bool,
    /// The control timer runs.
    pub timer_running: bool,
    /// The next tick is due before this one has ended.
    pub timer_due: bool,
    /// What the stopwatch advances by from one reading to the next.
    pub stopwatch_step: u32,
    /// The control period in ticks of the stopwatch; 0, at first, is none.
    pub period_ticks_hw: u32,
    stopwatch: Cell<u32>,
}

impl MemoryBoard {
    /// A board in good order whose sensors read `sample`: stop released, drives ok and
    /// disabled, brakes closed, timer running.
    pub fn new(sample: RawSample) -> Self {
        Self {
            sample,
            interlocks: Interlocks {
                estop_released: true,
                drives_ok: true,
            },
            torque: None,
            brakes_released: false,
            timer_running: true,
            timer_due: false,
            stopwatch_step: 1,
            period_ticks_hw: 0,
            stopwatch: Cell::new(0),
        }
    }

    /// Lets the stopwatch run on by `ticks_hw`.
    pub fn elapse(&mut self, ticks_hw: u32) {
        self.stopwatch
            .set(self.stopwatch.get().wrapping_add(ticks_hw));
    }
}

impl Board for MemoryBoard {
    fn sample(&mut self) -> RawSample {
        self.sample
    }

    fn interlocks(&self) -> Interlocks {
        self.interlocks
    }

    fn command(&mut self, torque: [f32; 2]) {
        self.torque = Some(torque);
    }

    fn off(&mut self) {
        self.torque = None;
        self.brakes_released = false;
    }

    fn release_brakes(&mut self) {
        self.brakes_released = true;
    }

    fn acknowledge_timer(&mut self) -> bool {
        self.timer_running
    }

    fn timer_due(&self) -> bool {
        self.timer_due
    }

    fn run_timer(&mut self, run: bool) {
        self.timer_running = run;
    }

    fn stopwatch(&self) -> u32 {
        let now = self.stopwatch.get().wrapping_add(self.stopwatch_step);
        self.stopwatch.set(now);
        now
    }

    fn period_ticks_hw(&self) -> u32 {
        self.period_ticks_hw
    }
}
