//! The exact twin of the fixed-point scalar: the same formats and the same saturations,
//! but f64 between them. What the fixed-point tick differs from it by is rounding alone,
//! also when signals saturate.

use flexor::number::fixed::{Exponent, Fixed};
use flexor::number::{Constant, Scalar, SiScalar, TableScalar};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A fraction of its format's range, not rounded, but held within [-1, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub struct Exact(f64);

/// `value`, within [-1, 1]; counts when it was not. The largest fixed-point number is a
/// unit short of 1.
fn held(value: f64, count: &mut u32) -> f64 {
    if value.abs() >= 1.0 {
        *count = count.saturating_add(1);
    }
    value.clamp(-1.0, 1.0)
}

impl Scalar for Exact {
    type Gain = f64;
    type Alpha = f64;
    type Shift = f64;
    type Sum = f64;
    type SaturationCount = u32;

    const ZERO: Self = Self(0.0);
    const UNKNOWN: Self = Self(f64::NAN);

    fn constant(constant: Constant) -> Self {
        // The exponent is in the bits.
        let ratio = f64::from(constant.bits) / 2_147_483_648.0 / constant.value;
        Self(constant.value * libm::exp2(libm::log2(ratio).round()))
    }

    fn plus(self, other: Self, count: &mut u32) -> Self {
        Self(held(self.0 + other.0, count))
    }

    fn minus(self, other: Self, count: &mut u32) -> Self {
        Self(held(self.0 - other.0, count))
    }

    fn plus_in_range(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }

    fn minus_in_range(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }

    fn negative(self) -> Self {
        Self(-self.0)
    }

    fn half(self) -> Self {
        Self(0.5 * self.0)
    }

    fn scaled(self, gain: f64, count: &mut u32) -> Self {
        Self(held(self.0 * gain, count))
    }

    fn times(self, other: Self, shift: f64, count: &mut u32) -> Self {
        Self(held(self.0 * other.0 * shift, count))
    }

    fn over(self, other: Self, shift: f64, count: &mut u32) -> Self {
        if other.0 == 0.0 {
            Self(0.0)
        } else {
            Self(held(self.0 / (other.0 * shift), count))
        }
    }

    fn times_in_range<const UP: u32>(self, other: Self) -> Self {
        Self(self.0 * other.0 * libm::ldexp(1.0, UP as i32 - 1))
    }

    fn sum(self) -> f64 {
        self.0
    }

    fn of_sum(sum: f64) -> Self {
        Self(sum)
    }

    fn times_alpha(self, alpha: f64) -> f64 {
        self.0 * alpha
    }

    fn accumulated(sum: f64, more: f64, count: &mut u32) -> f64 {
        held(sum + more, count)
    }

    fn angle_minus(self, other: Self) -> Self {
        // Wraps where the integers do: from 1, half a turn, to -1.
        let difference = self.0 - other.0;
        Self(difference - 2.0 * libm::floor(0.5 * difference + 0.5))
    }

    fn fine(self, shift: f64, count: &mut u32) -> Self {
        Self(held(self.0 * shift, count))
    }

    fn sine(self) -> Self {
        Self(0.5 * Scalar::sine(PI * self.0))
    }

    fn is_known(self) -> bool {
        !self.0.is_nan()
    }

    fn all_finite<const N: usize>(values: [Self; N]) -> bool {
        values.iter().all(|value| value.0.is_finite())
    }

    fn is_within(self, limit: Self) -> bool {
        self.0.abs() < limit.0
    }
}

impl SiScalar for Exact {
    type Format = Exponent;
    const SINE: Exponent = Fixed::SINE;

    fn from_si(value: f64, format: Exponent) -> Self {
        Self((value / format.range()).clamp(-1.0, 1.0))
    }

    fn to_si(self, format: Exponent) -> f64 {
        self.0 * format.range()
    }

    fn gain(value: f64, from: Exponent, to: Exponent) -> f64 {
        value * from.range() / to.range()
    }

    fn angle_gain(value: f64, to: Exponent) -> f64 {
        value * PI / to.range()
    }

    fn fine_shift(largest: f64) -> f64 {
        libm::ldexp(1.0, i32::from(Fixed::fine_shift(largest)))
    }

    fn fine_gain(value: f64, shift: f64, to: Exponent) -> f64 {
        Self::angle_gain(value / shift, to)
    }

    fn fine_gain_value(gain: f64, shift: f64, to: Exponent) -> f64 {
        shift * Self::angle_gain_value(gain, to)
    }

    fn angle_gain_value(gain: f64, to: Exponent) -> f64 {
        gain * to.range() / PI
    }

    fn gain_value(gain: f64, from: Exponent, to: Exponent) -> f64 {
        gain * to.range() / from.range()
    }

    fn alpha(value: f64) -> f64 {
        value
    }

    fn alpha_value(alpha: f64) -> f64 {
        alpha
    }

    fn shift(a: Exponent, b: Exponent, to: Exponent) -> f64 {
        a.range() * b.range() / to.range()
    }

    fn from_rad(value: f64) -> Self {
        Self(value / PI)
    }

    fn to_rad(self) -> f64 {
        self.0 * PI
    }
}

impl TableScalar for Exact {
    type ColumnScale = f64;
    type Reciprocal = f64;

    fn column_scale(scaling: i8, format: Exponent) -> Option<f64> {
        Fixed::column_scale(scaling, format)
            .map(|_| libm::ldexp(1.0, -i32::from(scaling)) / format.range())
    }

    fn angle_column_scale(scaling: i8) -> Option<f64> {
        Some(libm::ldexp(1.0, -i32::from(scaling)) / PI)
    }

    fn angle_term_scale(scaling: i8, _: i8) -> Option<f64> {
        Self::angle_column_scale(scaling)
    }

    fn control_point(raw: i32, column_scale: f64) -> Self {
        Self(f64::from(raw) * column_scale)
    }

    fn from_spline(value: Self, _: f64) -> Self {
        value
    }

    fn reciprocal_of(value: u32) -> f64 {
        1.0 / f64::from(value)
    }

    fn fraction(part: u32, reciprocal: f64) -> Self {
        Self(f64::from(part) * reciprocal)
    }
}
