//! From one table to the next without a step in the torques.
//!
//! The new plan's torques, and what the law makes of where the arm stands, are not what was given last.
//! The difference is added to the new plan's torques and fades: the first torque is the last one, but for a
//! tick of the law's integrals.

use crate::control::filter::low_pass;
use crate::control::hybrid::{HybridLaw, HybridState};
use crate::number::Scalar;
use crate::signals::{Measurement, PoseSetpoint, SaturationCounts};

/// What differs from the plan's torques after another table's run.
#[derive(Clone, Copy, Debug)]
pub(super) enum Handover<T: Scalar> {
    /// Nothing.
    None,
    /// Given last, N m: what differs is known at the first tick.
    From([T; 2]),
    /// What is left of it, N m, and for so many ticks.
    Fading([T::Sum; 2], u32),
}

impl<T: Scalar> Handover<T> {
    /// After these torques, N m.
    pub(super) fn from(torque: [T; 2]) -> Self {
        Self::From(torque)
    }

    /// Whether nothing is left.
    pub(super) fn is_over(&self) -> bool {
        matches!(self, Self::None)
    }

    /// Adds what is left to the setpoint's torques, and lets it fade. `memory` is as the law's update will find it.
    #[cold]
    #[inline(never)]
    pub(super) fn tick(
        &mut self,
        law: &HybridLaw<T>,
        memory: &HybridState<T>,
        (setpoint, measured): (&mut PoseSetpoint<T>, &Measurement<T>),
        saturations: &mut SaturationCounts<T::SaturationCount>,
    ) {
        let (left, ticks) = match self {
            Self::None => return,
            Self::From(before) => {
                let now = law.at_rest(memory, (setpoint, measured), saturations);
                let left = [0, 1].map(|j| {
                    let count = &mut saturations.torque[j];
                    before[j].minus(now[j], count).sum()
                });
                (left, law.motion.fade_ticks)
            }
            Self::Fading(left, ticks) => {
                for (left, count) in left.iter_mut().zip(&mut saturations.torque) {
                    low_pass(left, Some(law.motion.fade), T::ZERO, count);
                }
                (*left, *ticks - 1)
            }
        };
        for (j, left) in left.iter().enumerate() {
            let torque = &mut setpoint.torque[j];
            *torque = torque.plus(T::of_sum(*left), &mut saturations.torque[j]);
        }
        *self = match ticks {
            0 => Self::None,
            _ => Self::Fading(left, ticks),
        };
    }
}
