//! The scalar traits behind which the controller and the model are written once.
//!
//! - [`Scalar`] is what the control tick computes with: `f32`, `f64` and
//!   [`Fixed`](crate::number::fixed::Fixed). No roots, no transcendental function and, but at a
//!   change of state, no division, so that a tick costs no library call on a core with the number type's
//!   arithmetic. [`SiScalar`] adds what the host converts with, [`TableScalar`] how a table
//!   is read.
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
//! | `a.angle_minus(b)` | difference | wraps, as angles do |
//! | `a.fine(shift, count)` | the angle | the same in a finer format, in which a large one saturates and counts |
//! | `a.scaled(gain, count)` | product with a constant | the same with a change of format; saturates and counts |
//! | `sum` = [`Scalar::Sum`] | the type itself | 64 bits: constants times signals are added up without rounding |

use core::fmt::Debug;
use serde::{Serialize, de::DeserializeOwned};

/// A compile-time constant: its value in f64 and the nearest fixed-point fraction.
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

/// What the control tick computes with: arithmetic alone.
///
/// `PartialOrd` compares numbers of one format. Arithmetic that names a counter saturates
/// in fixed point and adds 1 to the counter when it does; in floating point it is plain.
pub trait Scalar:
    Copy + PartialOrd + Debug + Default + Send + Sync + Serialize + DeserializeOwned + 'static
{
    /// Constant factor that takes a signal of one format into another.
    type Gain: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// Coefficient of a filter, from -1 to below 1, for [`times_alpha`](Self::times_alpha).
    type Alpha: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// Left shift that brings the product of formats a and b into format c.
    type Shift: Copy + Debug + PartialEq + Send + Sync + Serialize + DeserializeOwned;
    /// Memory of a filter or an integral: products with a coefficient are added to it
    /// without rounding.
    type Sum: Copy + Debug + Default + PartialOrd + Send + Sync;
    /// Counter of saturations; nothing in floating point.
    type SaturationCount: Copy + Debug + Default + PartialEq + Send + Sync;

    /// 0.
    const ZERO: Self;
    /// What no torque is. A step from it is within no limit, or within one that holds back nothing.
    const UNKNOWN: Self;

    /// The constant.
    fn constant(constant: Constant) -> Self;

    /// Sum; saturates.
    #[must_use]
    fn plus(self, other: Self, count: &mut Self::SaturationCount) -> Self;
    /// Difference; saturates.
    #[must_use]
    fn minus(self, other: Self, count: &mut Self::SaturationCount) -> Self;
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
    fn scaled(self, gain: Self::Gain, count: &mut Self::SaturationCount) -> Self;
    /// Times another signal; saturates.
    #[must_use]
    fn times(self, other: Self, shift: Self::Shift, count: &mut Self::SaturationCount) -> Self;
    /// The signal that, [`times`](Self::times) the `other` with this shift, is this one; saturates,
    /// and is 0 where the other is. No tick needs it, only a change of state.
    #[must_use]
    fn over(self, other: Self, shift: Self::Shift, count: &mut Self::SaturationCount) -> Self;
    /// Times another number, known to stay in range. The result's exponent is the sum of
    /// the factors' plus 1 less `UP`.
    #[must_use]
    fn times_in_range<const UP: u32>(self, other: Self) -> Self;

    /// The number as a sum of its format.
    fn sum(self) -> Self::Sum;
    /// The sum, rounded down to the number's format.
    fn of_sum(sum: Self::Sum) -> Self;
    /// The exact product with a filter's coefficient.
    fn times_alpha(self, alpha: Self::Alpha) -> Self::Sum;
    /// The sum of two; saturates at the number's range.
    #[must_use]
    fn accumulated(sum: Self::Sum, more: Self::Sum, count: &mut Self::SaturationCount)
    -> Self::Sum;

    /// Difference of two angles. Radians in floating point; in fixed point 1 is half a turn,
    /// and a difference wraps where the angle does, so that none is out of range.
    #[must_use]
    fn angle_minus(self, other: Self) -> Self;
    /// Sine of an angle, in the format [`SiScalar::SINE`]; see [`crate::number::sine`].
    #[must_use]
    fn sine(self) -> Self;
    /// A small angle in the finer format of [`SiScalar::fine_shift`]: exact, or saturates.
    #[must_use]
    fn fine(self, shift: Self::Shift, count: &mut Self::SaturationCount) -> Self;

    /// False for [`UNKNOWN`](Self::UNKNOWN).
    fn is_known(self) -> bool;
    /// True when none of `values` is NaN or infinite.
    fn all_finite<const N: usize>(values: [Self; N]) -> bool;
    /// True when the magnitude is below a limit, which is not negative; false for NaN and
    /// the infinities.
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

/// A [`Scalar`] and the SI values that it stands for: what prepares coefficients and
/// converts signals, on the host or once at start. A tick calls none of it.
pub trait SiScalar: Scalar {
    /// Where a signal's binary point is; nothing in floating point.
    type Format: Copy + Debug + Default + PartialEq + Send + Sync + Serialize + DeserializeOwned;

    /// Format of [`Scalar::sine`].
    const SINE: Self::Format;

    /// The nearest number to `value`, in the signal's unit; saturates in fixed point.
    fn from_si(value: f64, format: Self::Format) -> Self;
    /// The number in the signal's unit.
    fn to_si(self, format: Self::Format) -> f64;
    /// The angle nearest to `value`, rad; whole turns are lost in fixed point.
    fn from_rad(value: f64) -> Self;
    /// The angle, rad; in fixed point the one within half a turn.
    fn to_rad(self) -> f64;

    /// The constant `value` that takes a signal of format `from` into `to`.
    fn gain(value: f64, from: Self::Format, to: Self::Format) -> Self::Gain;
    /// The constant `value`, in the unit of a signal of format `to` a radian, that takes an angle
    /// into that signal.
    fn angle_gain(value: f64, to: Self::Format) -> Self::Gain;
    /// What makes angles up to `largest` (rad) as fine as their format allows: a shift for
    /// [`Scalar::fine`].
    fn fine_shift(largest: f64) -> Self::Shift;
    /// As [`angle_gain`](Self::angle_gain), for an angle that was made fine by this shift.
    fn fine_gain(value: f64, shift: Self::Shift, to: Self::Format) -> Self::Gain;
    /// What the gain is after rounding.
    fn gain_value(gain: Self::Gain, from: Self::Format, to: Self::Format) -> f64;
    /// What a gain on angles is after rounding.
    fn angle_gain_value(gain: Self::Gain, to: Self::Format) -> f64;
    /// The same of a gain on fine angles.
    fn fine_gain_value(gain: Self::Gain, shift: Self::Shift, to: Self::Format) -> f64;
    /// The filter coefficient nearest to `value`, from -1 to below 1.
    fn alpha(value: f64) -> Self::Alpha;
    /// What the coefficient is after rounding.
    fn alpha_value(alpha: Self::Alpha) -> f64;
    /// What takes the product of a signal of format `a` and one of `b` into format `to`.
    fn shift(a: Self::Format, b: Self::Format, to: Self::Format) -> Self::Shift;
}

/// A [`Scalar`] that is read from a table's columns of integers.
pub trait TableScalar: SiScalar {
    /// How a table column's integers become the column's signal.
    type ColumnScale: Copy + Debug + Default + PartialEq + Send + Sync;
    /// 1 divided by a positive integer.
    type Reciprocal: Copy + Debug + PartialEq + Send + Sync;

    /// How integers that are values times 2^`scaling` become a signal of `format`; `None`
    /// if they do not fit.
    fn column_scale(scaling: i8, format: Self::Format) -> Option<Self::ColumnScale>;
    /// The same for a column of angles, rad.
    fn angle_column_scale(scaling: i8) -> Option<Self::ColumnScale>;
    /// The same for control points that are to be those of a column with the `common` scaling,
    /// which is no larger: such control points can be added up.
    fn angle_term_scale(scaling: i8, common: i8) -> Option<Self::ColumnScale>;
    /// A table's integer, of magnitude up to [`crate::table::RAW_MAX`], as a control point
    /// of the column's spline.
    fn control_point(raw: i32, column_scale: Self::ColumnScale) -> Self;
    /// The column's signal from the spline's value: what goes through its control points.
    fn from_spline(value: Self, column_scale: Self::ColumnScale) -> Self;
    /// 1 / `value`, for 1 to 2^24.
    fn reciprocal_of(value: u32) -> Self::Reciprocal;
    /// `part` times a reciprocal, for a part up to the integer that it is the reciprocal of:
    /// a fraction in the format of exponent 0.
    fn fraction(part: u32, reciprocal: Self::Reciprocal) -> Self;
}
