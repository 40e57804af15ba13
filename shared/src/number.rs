//! The scalar traits behind which the controller and the model are written once.
//!
//! - [`Number`] is what the control tick may use: ring operations, comparison and
//!   conversion. No roots, no transcendental function, and no division but that of 1 by
//!   an integer, so that it can
//!   be had in fixed point and costs no library call on a Cortex-M4F.
//! - [`Real`] adds what planning and simulation need. Its functions come from the
//!   `libm` crate and not from the platform, so a result is the same on every host.
//!
//! Neither trait offers a fused multiply-add: a result must not depend on whether
//! the core has one.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A scalar that the control tick can compute with.
pub trait Number:
    Copy
    + PartialOrd
    + Debug
    + Default
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The nearest value of this type. For configuration and constants, not for the tick.
    fn from_f64(value: f64) -> Self;

    /// This value in f64. For logs and tests.
    fn to_f64(self) -> f64;

    /// The nearest value to an integer; exact for magnitudes up to 2^24 in `f32`.
    fn from_i32(value: i32) -> Self;

    /// 1 / `value`, for a positive `value`.
    fn reciprocal_of(value: u32) -> Self;

    /// The nearest integer, halves away from zero; saturates, and NaN gives 0.
    fn round_to_i32(self) -> i32;

    /// False for NaN and the infinities.
    fn is_finite(self) -> bool;

    /// True when none of `values` is NaN or infinite. The difference of such a value from
    /// itself is not zero, which takes half the instructions of looking at each.
    #[inline]
    #[allow(clippy::eq_op)]
    fn all_finite<const N: usize>(values: [Self; N]) -> bool {
        let zeros = values.map(|x| x - x);
        zeros.into_iter().reduce(Add::add).unwrap_or(Self::ZERO) == Self::ZERO
    }

    /// |self|.
    fn magnitude(self) -> Self {
        if self < Self::ZERO { -self } else { self }
    }

    /// The larger of two; `self` if they do not compare.
    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    /// The smaller of two; `self` if they do not compare.
    fn smaller(self, other: Self) -> Self {
        if other < self { other } else { self }
    }

    /// The nearest value within `[low, high]`; NaN stays NaN.
    fn limited(self, low: Self, high: Self) -> Self {
        if self < low {
            low
        } else if self > high {
            high
        } else {
            self
        }
    }
}

/// A real number with the functions that kinematics and simulation need.
pub trait Real: Number + Div<Output = Self> {
    /// Square root.
    fn sqrt(self) -> Self;
    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Angle in (-pi, pi] of the point with ordinate `self` and abscissa `x`, in radians.
    fn atan2(self, x: Self) -> Self;
}

macro_rules! float {
    ($float:ident, $sqrt:path, $sin:path, $cos:path, $atan2:path) => {
        impl Number for $float {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            #[inline]
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_lossless,
                clippy::unnecessary_cast
            )]
            fn from_f64(value: f64) -> Self {
                value as $float
            }

            #[inline]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }

            #[inline]
            #[allow(clippy::cast_precision_loss, clippy::cast_lossless)]
            fn from_i32(value: i32) -> Self {
                value as $float
            }

            #[inline]
            #[allow(clippy::cast_precision_loss, clippy::cast_lossless)]
            fn reciprocal_of(value: u32) -> Self {
                1.0 / value as $float
            }

            #[inline]
            #[allow(clippy::cast_possible_truncation)]
            fn round_to_i32(self) -> i32 {
                (self + if self < 0.0 { -0.5 } else { 0.5 }) as i32
            }

            #[inline]
            fn is_finite(self) -> bool {
                $float::is_finite(self)
            }

            #[inline]
            fn magnitude(self) -> Self {
                self.abs()
            }
        }

        impl Real for $float {
            #[inline]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }

            #[inline]
            fn sin(self) -> Self {
                $sin(self)
            }

            #[inline]
            fn cos(self) -> Self {
                $cos(self)
            }

            #[inline]
            fn atan2(self, x: Self) -> Self {
                $atan2(self, x)
            }
        }
    };
}

float!(f32, libm::sqrtf, libm::sinf, libm::cosf, libm::atan2f);
float!(f64, libm::sqrt, libm::sin, libm::cos, libm::atan2);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_to_nearest_and_saturates() {
        assert_eq!(2.5_f32.round_to_i32(), 3);
        assert_eq!((-2.5_f64).round_to_i32(), -3);
        assert_eq!(0.49_f64.round_to_i32(), 0);
        assert_eq!(f32::INFINITY.round_to_i32(), i32::MAX);
        assert_eq!(f32::NAN.round_to_i32(), 0);
    }

    #[test]
    fn one_value_that_is_not_finite_shows_among_others() {
        assert!(f32::all_finite([f32::MAX, f32::MIN, 1e-45, -0.0]));
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for at in 0..3 {
                let mut values = [f32::MAX, -f32::MAX, 1.0];
                values[at] = bad;
                assert!(!f32::all_finite(values));
            }
        }
        assert!(!f32::all_finite([f32::INFINITY, f32::NEG_INFINITY]));
    }

    #[test]
    fn limiting_keeps_nan_visible() {
        assert_eq!(3.0_f32.limited(-1.0, 1.0), 1.0);
        assert_eq!((-3.0_f32).limited(-1.0, 1.0), -1.0);
        assert!(f32::NAN.limited(-1.0, 1.0).is_nan());
    }
}
