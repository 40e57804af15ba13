//! By which forces the motion tells contact from none.

use crate::number::Scalar;

/// Forces that the motion counts with, N.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Forces<T> {
    /// Force from which on there is contact, and force below which there is none.
    pub(super) on: T,
    pub(super) off: T,
    /// Mean force at which the bounces of a touch are over.
    pub(super) pressing: T,
    /// What the wanted force changes in a tick.
    pub(super) step: T,
}

impl<T: Scalar> Forces<T> {
    /// Ticks in which there was contact, one after the other, with this one's force.
    pub(super) fn touched(&self, touching: u32, force: T) -> u32 {
        if force > self.on { touching + 1 } else { 0 }
    }

    /// Ticks in which there was none.
    pub(super) fn parted(&self, below: u32, force: T) -> u32 {
        if force > self.off { 0 } else { below + 1 }
    }
}

/// `value`, a step nearer to `target`.
pub(super) fn towards<T: Scalar>(value: T, target: T, step: T) -> T {
    let count = &mut T::SaturationCount::default();
    let missing = target.minus(value, count);
    if missing.is_within(step) {
        target
    } else if missing > T::ZERO {
        value.plus(step, count)
    } else {
        value.minus(step, count)
    }
}
