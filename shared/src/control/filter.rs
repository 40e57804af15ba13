//! The first-order low-pass that the laws share.

use crate::number::Scalar;

/// Coefficient of a first-order low-pass with a corner, by backward Euler: omega T / (1 + omega T).
pub(super) fn filter_alpha(corner_hz: f64, rate_hz: f64) -> f64 {
    let angle = core::f64::consts::TAU * corner_hz / rate_hz;
    angle / (1.0 + angle)
}

/// Passes `input` through a first-order low-pass: its output. The memory is the output
/// without rounding, so that no input is too small to move it. Without a filter, without
/// `alpha`, it is the input.
#[inline]
pub(super) fn low_pass<T: Scalar>(
    memory: &mut T::Sum,
    alpha: Option<T::Alpha>,
    input: T,
    count: &mut T::SaturationCount,
) -> T {
    match alpha {
        Some(alpha) => {
            let step = input.minus(T::of_sum(*memory), count).times_alpha(alpha);
            *memory = T::accumulated(*memory, step, count);
            T::of_sum(*memory)
        }
        None => {
            *memory = input.sum();
            input
        }
    }
}
