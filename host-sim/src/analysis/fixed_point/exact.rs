//! The exact twin of the fixed-point scalar: the same formats and the same saturations,
//! but f64 between them. What the fixed-point tick differs from it by is rounding alone,
//! also when signals saturate.

use flexor::number::fixed::{Exponent, Fixed};
use flexor::number::{Constant, Scalar};
use serde::{Deserialize, Serialize};

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
    type Format = Exponent;
    type Gain = f64;
    type Weight = f64;
    type Shift = f64;
    type Turn = f64;
    type Sum = f64;
    type Count = u32;
    type Quantum = f64;
    type Reciprocal = f64;

    const ZERO: Self = Self(0.0);
    const SINE: Exponent = Fixed::SINE;

    fn from_si(value: f64, format: Exponent) -> Self {
        Self((value / format.range()).clamp(-1.0, 1.0))
    }

    fn to_si(self, format: Exponent) -> f64 {
        self.0 * format.range()
    }

    fn constant(constant: Constant) -> Self {
        // The exponent is in the bits.
        let ratio = f64::from(constant.bits) / 2_147_483_648.0 / constant.value;
        Self(constant.value * libm::exp2(libm::log2(ratio).round()))
    }

    fn gain(value: f64, from: Exponent, to: Exponent) -> f64 {
        value * from.range() / to.range()
    }

    fn gain_value(gain: f64, from: Exponent, to: Exponent) -> f64 {
        gain * to.range() / from.range()
    }

    fn weight(value: f64) -> f64 {
        value
    }

    fn weight_value(weight: f64) -> f64 {
        weight
    }

    fn shift(a: Exponent, b: Exponent, to: Exponent) -> f64 {
        a.range() * b.range() / to.range()
    }

    fn turn(format: Exponent) -> f64 {
        format.range()
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

    fn times_in_range<const UP: u32>(self, other: Self) -> Self {
        Self(self.0 * other.0 * libm::ldexp(1.0, UP as i32 - 1))
    }

    fn sum(self) -> f64 {
        self.0
    }

    fn of_sum(sum: f64) -> Self {
        Self(sum)
    }

    fn weighted(self, weight: f64) -> f64 {
        self.0 * weight
    }

    fn accumulated(sum: f64, more: f64, count: &mut u32) -> f64 {
        held(sum + more, count)
    }

    fn reduced(self, turn: f64) -> Self {
        Self(0.5 * Scalar::reduced(self.0 * turn, ()))
    }

    fn quantum(scaling: i8, format: Exponent) -> Option<f64> {
        Fixed::quantum(scaling, format)
            .map(|_| libm::ldexp(1.0, -i32::from(scaling)) / format.range())
    }

    fn knot(raw: i32, quantum: f64) -> Self {
        Self(f64::from(raw) * quantum)
    }

    fn spline_signal(self, _quantum: f64) -> Self {
        self
    }

    fn reciprocal_of(value: u32) -> f64 {
        1.0 / f64::from(value)
    }

    fn fraction(part: u32, reciprocal: f64) -> Self {
        Self(f64::from(part) * reciprocal)
    }

    fn all_finite<const N: usize>(values: [Self; N]) -> bool {
        values.iter().all(|value| value.0.is_finite())
    }

    fn is_within(self, limit: Self) -> bool {
        self.0.abs() < limit.0
    }
}
