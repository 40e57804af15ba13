//! What the supervisor is doing, and how one state becomes another.
//!
//! A state carries what only it needs, so that nothing of a run before can be met in the next
//! one. What outlives states (latched fault, homing, sensing) is the
//! [`Supervisor`](crate::supervisor::Supervisor)'s.

use crate::link::{Mode, Refusal};
use crate::signals::Measurement;
use crate::supervisor::enabling::{FaultMonitor, SafetyLimits};
use crate::supervisor::soft_start::SoftStart;

/// The supervisor's state.
///
/// ```text
///                      start
///                        |
///                        v
///        (1)       +----------+       (4)
///   +--------------| Disabled |--------------+
///   |              +----------+              |
///   |                ^      ^                |
///   v   (2) (3)      |      |      (5)       v
/// +---------+        |      |        +----------+ ---+
/// | Enabled |--------+      +--------| LockStep |    | (4)
/// +---------+                        +----------+ <--+
/// ```
///
/// | | from | to | cause | method |
/// |---|---|---|---|---|
/// | 1 | disabled | enabled | the host enables, all checks passed | [`enable`](Self::enable) |
/// | 2 | enabled | disabled | the host disables | [`disable`](Self::disable) |
/// | 3 | enabled | disabled | the controller gives up, or the monitor finds a fault; the fault is latched | [`disable`](Self::disable) |
/// | 4 | disabled, lock-step | lock-step, from the table's first tick | the host starts lock-step | [`start_lock_step`](Self::start_lock_step) |
/// | 5 | lock-step | disabled | the host stops lock-step, or disables | [`stop_lock_step`](Self::stop_lock_step), [`disable`](Self::disable) |
///
/// Every other wish is refused: [`Refusal::Busy`], [`Refusal::NotInLockStep`].
// With a tag of its own: in a gap of the payload's values, where the compiler would put it, it
// takes the tick ten instructions more to tell the states apart.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub(super) enum State {
    /// Drives off: the host's measurements run the table, and the timer rests.
    LockStep {
        /// The host's measurement that the next tick is to take, and its sequence number;
        /// `None` once it is taken.
        inbox: Option<(u32, Measurement<f32>)>,
    },
    /// Drives off.
    Disabled,
    /// Drives on: the timer's ticks run the table with what the sensors say.
    Enabled {
        /// Looks for faults at every tick.
        monitor: FaultMonitor,
        /// The last tick was not over when the next one was due.
        late: bool,
        /// How far the first torques have been raised; until they are, brakes hold the arm.
        start: SoftStart,
    },
}

impl State {
    /// What the host is told.
    pub(super) fn mode(&self) -> Mode {
        match self {
            Self::Disabled => Mode::Disabled,
            Self::Enabled { .. } => Mode::Enabled,
            Self::LockStep { .. } => Mode::LockStep,
        }
    }

    /// Transition 1.
    ///
    /// # Errors
    /// [`Refusal::Busy`] unless disabled.
    pub(super) fn enable(
        &mut self,
        limits: &SafetyLimits,
        period_ticks_hw: u32,
    ) -> Result<(), Refusal> {
        if !matches!(self, Self::Disabled) {
            return Err(Refusal::Busy);
        }
        *self = Self::Enabled {
            monitor: FaultMonitor::new(limits, period_ticks_hw),
            late: false,
            start: SoftStart::new(limits.soft_start_ticks),
        };
        Ok(())
    }

    /// Transition 4.
    ///
    /// # Errors
    /// [`Refusal::Busy`] if enabled.
    pub(super) fn start_lock_step(&mut self) -> Result<(), Refusal> {
        if matches!(self, Self::Enabled { .. }) {
            return Err(Refusal::Busy);
        }
        *self = Self::LockStep { inbox: None };
        Ok(())
    }

    /// Transition 5.
    ///
    /// # Errors
    /// [`Refusal::NotInLockStep`] unless in lock-step.
    pub(super) fn stop_lock_step(&mut self) -> Result<(), Refusal> {
        if !matches!(self, Self::LockStep { .. }) {
            return Err(Refusal::NotInLockStep);
        }
        *self = Self::Disabled;
        Ok(())
    }

    /// Transitions 2, 3 and 5; nothing when disabled already.
    pub(super) fn disable(&mut self) {
        *self = Self::Disabled;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: SafetyLimits = SafetyLimits {
        start_rad: [0.01; 3],
        start_motor_rad: [0.01; 2],
        soft_start_ticks: 0,
        link_timeout_ticks: 20,
    };

    #[test]
    fn transitions_are_those_of_the_drawing() {
        type Wish = fn(&mut State) -> Result<(), Refusal>;
        let wishes: [Wish; 4] = [
            |state| state.enable(&LIMITS, 0),
            State::start_lock_step,
            State::stop_lock_step,
            |state| {
                state.disable();
                Ok(())
            },
        ];
        let begin = |mode| {
            let mut state = State::Disabled;
            match mode {
                Mode::Disabled => {}
                Mode::Enabled => state.enable(&LIMITS, 0).unwrap(),
                Mode::LockStep => state.start_lock_step().unwrap(),
            }
            assert_eq!(state.mode(), mode);
            state
        };
        use Mode::{Disabled, Enabled, LockStep};
        let (busy, not_in_lock_step) = (Err(Refusal::Busy), Err(Refusal::NotInLockStep));
        // Enable, start lock-step, stop lock-step, disable.
        for (from, expected) in [
            (
                Disabled,
                [Ok(Enabled), Ok(LockStep), not_in_lock_step, Ok(Disabled)],
            ),
            (Enabled, [busy, busy, not_in_lock_step, Ok(Disabled)]),
            (LockStep, [busy, Ok(LockStep), Ok(Disabled), Ok(Disabled)]),
        ] {
            for (wish, expected) in wishes.into_iter().zip(expected) {
                let mut state = begin(from);
                assert_eq!(wish(&mut state).map(|()| state.mode()), expected);
                if expected.is_err() {
                    assert_eq!(state.mode(), from);
                }
            }
        }
    }

    #[test]
    fn lock_step_that_begins_again_forgets_the_measurement_before() {
        let mut state = State::LockStep {
            inbox: Some((1, Measurement::default())),
        };
        state.start_lock_step().unwrap();
        assert!(matches!(state, State::LockStep { inbox: None }));
    }
}
