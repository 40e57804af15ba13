//! The scalar traits behind which the controller and the model are written once.
//!
//! - [`Scalar`] is what the control tick computes with: `f32`, `f64` and
//!   [`Fixed`](crate::number::fixed::Fixed). No roots, no transcendental function and no
//!   division, so that a tick costs no library call on a core with the number type's
//!   arithmetic.
//! - [`Real`] is what the model, planning and simulation compute with, in
//!   floating point. Its functions come from the `libm` crate and not from the
//!   platform, so a result is the same on every host.
//!
//! None of them offers a fused multiply-add: a result must not depend on whether
//! the core has one.
//!
//! # How one source serves floating and fixed point
//!
//! A fixed-point number is a fraction x in [-1, 1), and a signal's *format* says what 1
//! stands for: a power of two in the signal's unit. Where signals of different formats
//! meet, the source says so, and the float does nothing there:
//!
//! | in the source | in floating point | in fixed point |
//! |---|---|---|
//! | `a.plus(b, count)`, `minus` | sum, difference | saturates and counts |
//! | `a.plus_in_range(b)` | sum | sum that the formats keep in range: debug builds check |
//! | `a.times(b, shift, count)` | product | product of two signals in a third one's format; saturates and counts |
//! | `a.times_in_range::<UP>(b)` | product | product with known formats |
//! | `a.scaled(gain, count)` | product with a constant | the same with a change of format; saturates and counts |
//! | `sum` = [`Scalar::Sum`] | the type itself | 64 bits: constants times signals are added up without rounding |

use super::real::Real;
use core::fmt::Debug;
use core::ops::Add;
use serde::{Serialize, de::DeserializeOwned};

/// A constant of the source in every number type, prepared by the compiler.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    /// The value.
    pub value: f64,
    /// The value in units of `2^(exponent - 31)`, rounded.
    pub bits: i32,
}

impl Constant {
    /// `value` in the format whose 1 stands for `2^exponent`; saturates.
    pub const fn new(value: f64, exponent: i32) -> Self {
        let mut unit = 1.0 / (1_u64 << 31) as f64;
        let mut i = 0;
        while i < exponent {
            unit *= 2.0;
            i += 1;
        }
        while i > exponent {
            unit *= 0.5;
            i -= 1;
        }
        let scaled = value / unit;
        Self {
            value,
            bits: (if scaled < 0.0 {
                scaled - 0.5
            } else {
                scaled + 0.5
            }) as i32,
        }
    }
}

/// What the control tick computes with.
///
/// `PartialOrd` compares numbers of one format. Arithmetic that names a counter saturates
/// in fixed point and adds 1 to the counter when it does; in floating point it is plain.
pub trait Scalar:
    Copy + PartialOrd + Debug + Default + Send + Sync + Serialize + DeserializeOwned + 'static
{
    /// Where a signal's binary point is; nothing in floating point.
    type Format: Copy + Debug + Default + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// A constant that takes a signal of one format into another.
    type Gain: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// A constant from 0 to below 1 for [`weighted`](Self::weighted).
    type Weight: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// Where the binary point of two signals' product goes.
    type Shift: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// A constant that takes an angle into the sine's argument.
    type Turn: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// Sum of weighted signals, wide enough not to round.
    type Sum: Copy + Debug + Default + PartialOrd + Send + Sync;
    /// Counter of saturations; nothing in floating point.
    type Count: Copy + Debug + Default + PartialEq + Send + Sync;
    /// How a table column's integers become the column's signal.
    type Quantum: Copy + Debug + Default + PartialEq + Send + Sync;
    /// 1 divided by a positive integer.
    type Reciprocal: Copy + Debug + PartialEq + Send + Sync;

    /// 0.
    const ZERO: Self;
    /// Format of [`crate::number::sine::sin`]'s result.
    const SINE: Self::Format;

    /// The nearest number to `value`, in the signal's unit; saturates in fixed point. For
    /// configuration, not for the tick.
    fn from_si(value: f64, format: Self::Format) -> Self;
    /// The number in the signal's unit. For logs and tests.
    fn to_si(self, format: Self::Format) -> f64;
    /// The constant.
    fn constant(constant: Constant) -> Self;

    /// The constant `value` that takes a signal of format `from` into `to`.
    fn gain(value: f64, from: Self::Format, to: Self::Format) -> Self::Gain;
    /// What the gain is after rounding.
    fn gain_value(gain: Self::Gain, from: Self::Format, to: Self::Format) -> f64;
    /// The weight nearest to `value`, at least 0 and below 1.
    fn weight(value: f64) -> Self::Weight;
    /// What the weight is after rounding.
    fn weight_value(weight: Self::Weight) -> f64;
    /// What takes the product of a signal of format `a` and one of `b` into format `to`.
    fn shift(a: Self::Format, b: Self::Format, to: Self::Format) -> Self::Shift;
    /// What takes an angle of this format into the sine's argument.
    fn turn(format: Self::Format) -> Self::Turn;

    /// Sum; saturates.
    #[must_use]
    fn plus(self, other: Self, count: &mut Self::Count) -> Self;
    /// Difference; saturates.
    #[must_use]
    fn minus(self, other: Self, count: &mut Self::Count) -> Self;
    /// Sum that is known to stay in range.
    #[must_use]
    fn plus_in_range(self, other: Self) -> Self;
    /// Difference that is known to stay in range.
    #[must_use]
    fn minus_in_range(self, other: Self) -> Self;
    /// `-self`.
    #[must_use]
    fn negative(self) -> Self;
    /// Half.
    #[must_use]
    fn half(self) -> Self;
    /// Times a constant; saturates.
    #[must_use]
    fn scaled(self, gain: Self::Gain, count: &mut Self::Count) -> Self;
    /// Times another signal; saturates.
    #[must_use]
    fn times(self, other: Self, shift: Self::Shift, count: &mut Self::Count) -> Self;
    /// Times another number, known to stay in range. The result's exponent is the sum of
    /// the factors' plus 1 less `UP`.
    #[must_use]
    fn times_in_range<const UP: u32>(self, other: Self) -> Self;

    /// The number as a sum of its format.
    fn sum(self) -> Self::Sum;
    /// The sum, rounded down to the number's format.
    fn of_sum(sum: Self::Sum) -> Self;
    /// The exact product with a weight.
    fn weighted(self, weight: Self::Weight) -> Self::Sum;
    /// The sum of two; saturates at the number's range.
    #[must_use]
    fn accumulated(sum: Self::Sum, more: Self::Sum, count: &mut Self::Count) -> Self::Sum;

    /// An angle in [-pi/2, pi/2] with the sine of this one: radians, in the format of
    /// exponent 1.
    #[must_use]
    fn reduced(self, turn: Self::Turn) -> Self;

    /// How integers that are values times 2^`scaling` become a signal of `format`; `None`
    /// if they do not fit.
    fn quantum(scaling: i8, format: Self::Format) -> Option<Self::Quantum>;
    /// A table's integer, of magnitude up to [`crate::table::RAW_MAX`], as a knot.
    fn knot(raw: i32, quantum: Self::Quantum) -> Self;
    /// What a spline through knots gives, as the column's signal.
    #[must_use]
    fn spline_signal(self, quantum: Self::Quantum) -> Self;
    /// 1 / `value`, for 1 to 2^24.
    fn reciprocal_of(value: u32) -> Self::Reciprocal;
    /// `part` times a reciprocal, for a part up to the integer that it is the reciprocal of:
    /// a fraction in the format of exponent 0.
    fn fraction(part: u32, reciprocal: Self::Reciprocal) -> Self;

    /// True when none of `values` is NaN or infinite.
    fn all_finite<const N: usize>(values: [Self; N]) -> bool;
    /// True when the magnitude is below a positive limit; false for NaN and the infinities.
    fn is_within(self, limit: Self) -> bool;

    /// The larger of two; `self` if they do not compare.
    #[inline]
    #[must_use]
    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    /// The smaller of two; `self` if they do not compare.
    #[inline]
    #[must_use]
    fn smaller(self, other: Self) -> Self {
        if other < self { other } else { self }
    }
}

macro_rules! float {
    ($float:ident) => {
        impl Scalar for $float {
            type Format = ();
            type Gain = Self;
            type Weight = Self;
            type Shift = ();
            type Turn = ();
            type Sum = Self;
            type Count = ();
            type Quantum = Self;
            type Reciprocal = Self;

            const ZERO: Self = 0.0;
            const SINE: () = ();

            #[inline]
            fn from_si(value: f64, (): ()) -> Self {
                <Self as Real>::from_f64(value)
            }

            #[inline]
            fn to_si(self, (): ()) -> f64 {
                <Self as Real>::to_f64(self)
            }

            #[inline]
            fn constant(constant: Constant) -> Self {
                <Self as Real>::from_f64(constant.value)
            }

            fn gain(value: f64, (): (), (): ()) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn gain_value(gain: Self, (): (), (): ()) -> f64 {
                <Self as Real>::to_f64(gain)
            }

            fn weight(value: f64) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn weight_value(weight: Self) -> f64 {
                <Self as Real>::to_f64(weight)
            }

            fn shift((): (), (): (), (): ()) {}

            fn turn((): ()) {}

            #[inline]
            fn plus(self, other: Self, (): &mut ()) -> Self {
                self + other
            }

            #[inline]
            fn minus(self, other: Self, (): &mut ()) -> Self {
                self - other
            }

            #[inline]
            fn plus_in_range(self, other: Self) -> Self {
                self + other
            }

            #[inline]
            fn minus_in_range(self, other: Self) -> Self {
                self - other
            }

            #[inline]
            fn negative(self) -> Self {
                -self
            }

            #[inline]
            fn half(self) -> Self {
                self * 0.5
            }

            #[inline]
            fn scaled(self, gain: Self, (): &mut ()) -> Self {
                self * gain
            }

            #[inline]
            fn times(self, other: Self, (): (), (): &mut ()) -> Self {
                self * other
            }

            #[inline]
            fn times_in_range<const UP: u32>(self, other: Self) -> Self {
                self * other
            }

            #[inline]
            fn sum(self) -> Self {
                self
            }

            #[inline]
            fn of_sum(sum: Self) -> Self {
                sum
            }

            #[inline]
            fn weighted(self, weight: Self) -> Self {
                self * weight
            }

            #[inline]
            fn accumulated(sum: Self, more: Self, (): &mut ()) -> Self {
                sum + more
            }

            #[inline]
            fn reduced(self, (): ()) -> Self {
                // A float of this size has no fraction, so that adding it rounds to an integer,
                // whose lowest bit is then the sum's.
                const ROUNDER: $float = 1.5 / $float::EPSILON;
                const SIGN: u32 = 8 * size_of::<$float>() as u32 - 1;
                let sum = self * core::$float::consts::FRAC_1_PI + ROUNDER;
                let half_turns = sum - ROUNDER;
                let [first, second] = PI_PARTS.map(<Self as Real>::from_f64);
                let x = self - half_turns * first - half_turns * second;
                // An odd number of half turns changes the sign. The exponent's first bit is 0
                // in all that is below 2: clearing it bounds what is left of an angle that was
                // too large for the sum, and changes no other.
                let bits = x.to_bits() ^ (sum.to_bits() & 1) << SIGN;
                Self::from_bits(bits & !(1 << (SIGN - 1)))
            }

            #[inline]
            fn quantum(scaling: i8, (): ()) -> Option<Self> {
                Some(<Self as Real>::from_f64(libm::ldexp(
                    1.0,
                    -i32::from(scaling),
                )))
            }

            #[inline]
            fn knot(raw: i32, quantum: Self) -> Self {
                // A power of two, so nothing is lost.
                <Self as Real>::from_i32(raw) * quantum
            }

            #[inline]
            fn spline_signal(self, _quantum: Self) -> Self {
                self
            }

            #[inline]
            fn reciprocal_of(value: u32) -> Self {
                <Self as Real>::reciprocal_of(value)
            }

            #[inline]
            fn fraction(part: u32, reciprocal: Self) -> Self {
                <Self as Real>::from_i32(part.cast_signed()) * reciprocal
            }

            // Zero times such a value is NaN, and so is the sum: one comparison for all.
            #[inline]
            fn all_finite<const N: usize>(values: [Self; N]) -> bool {
                let zeros = values.map(|x| x * 0.0);
                zeros.into_iter().reduce(Add::add).unwrap_or(0.0) == 0.0
            }

            #[inline]
            fn is_within(self, limit: Self) -> bool {
                self.abs() < limit
            }
        }
    };
}

float!(f32);
float!(f64);

/// pi in two parts (Cody and Waite): the first has 15 significant bits, so that its products
/// with up to 2^9 half turns are exact in f32.
const PI_PARTS: [f64; 2] = [3.141_479_492_187_5, 1.131_614_022_932_384_6e-4];

#[cfg(test)]
mod tests {
    use super::*;

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
}
