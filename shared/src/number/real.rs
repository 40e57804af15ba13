//! What model, planning and simulation compute with: floating point with the functions
//! of the `libm` crate, so that a result is the same on every host.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A real number: the field's operations, comparison, conversion, and the functions that
/// kinematics and simulation need.
pub trait Real:
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
    + Div<Output = Self>
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

    /// False for NaN and the infinities.
    fn is_finite(self) -> bool;

    /// `factor` times this value. What carries derivatives knows that a constant has none.
    #[inline]
    fn scaled(self, factor: f64) -> Self {
        Self::from_f64(factor) * self
    }

    /// |self|.
    fn magnitude(self) -> Self {
        if self < Self::ZERO { -self } else { self }
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
        impl Real for $float {
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
            fn is_finite(self) -> bool {
                $float::is_finite(self)
            }

            #[inline]
            fn magnitude(self) -> Self {
                self.abs()
            }

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
    fn limiting_keeps_nan_visible() {
        assert_eq!(3.0_f32.limited(-1.0, 1.0), 1.0);
        assert_eq!((-3.0_f32).limited(-1.0, 1.0), -1.0);
        assert!(f32::NAN.limited(-1.0, 1.0).is_nan());
    }
}
