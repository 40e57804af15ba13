//! The tick's arithmetic in floating point: what [`Scalar`] asks for is the type's own.

use super::real::Real;
use super::sine;
use crate::number::scalar::{Constant, Scalar, SiScalar, TableScalar};
use core::ops::Add;

macro_rules! float {
    ($float:ident) => {
        impl Scalar for $float {
            type Gain = Self;
            type Alpha = Self;
            type Shift = ();
            type Sum = Self;
            type SaturationCount = ();

            const ZERO: Self = 0.0;
            const UNKNOWN: Self = Self::NAN;

            #[inline]
            fn constant(constant: Constant) -> Self {
                <Self as Real>::from_f64(constant.value)
            }

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
            fn over(self, other: Self, (): (), (): &mut ()) -> Self {
                if other == 0.0 { 0.0 } else { self / other }
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
            fn times_alpha(self, alpha: Self) -> Self {
                self * alpha
            }

            #[inline]
            fn accumulated(sum: Self, more: Self, (): &mut ()) -> Self {
                sum + more
            }

            #[inline]
            fn angle_minus(self, other: Self) -> Self {
                self - other
            }

            #[inline]
            fn sine(self) -> Self {
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
                sine::of_radians(Self::from_bits(bits & !(1 << (SIGN - 1))))
            }

            #[inline]
            fn fine(self, (): (), (): &mut ()) -> Self {
                self
            }

            #[inline]
            fn is_known(self) -> bool {
                !self.is_nan()
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

        impl SiScalar for $float {
            type Format = ();
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
            fn from_rad(value: f64) -> Self {
                <Self as Real>::from_f64(value)
            }

            #[inline]
            fn to_rad(self) -> f64 {
                <Self as Real>::to_f64(self)
            }

            fn gain(value: f64, (): (), (): ()) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn angle_gain(value: f64, (): ()) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn fine_shift(_: f64) {}

            fn fine_gain(value: f64, (): (), (): ()) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn fine_gain_value(gain: Self, (): (), (): ()) -> f64 {
                <Self as Real>::to_f64(gain)
            }

            fn angle_gain_value(gain: Self, (): ()) -> f64 {
                <Self as Real>::to_f64(gain)
            }

            fn gain_value(gain: Self, (): (), (): ()) -> f64 {
                <Self as Real>::to_f64(gain)
            }

            fn alpha(value: f64) -> Self {
                <Self as Real>::from_f64(value)
            }

            fn alpha_value(alpha: Self) -> f64 {
                <Self as Real>::to_f64(alpha)
            }

            fn shift((): (), (): (), (): ()) {}
        }

        impl TableScalar for $float {
            type ColumnScale = Self;
            type Reciprocal = Self;

            #[inline]
            fn column_scale(scaling: i8, (): ()) -> Option<Self> {
                Some(<Self as Real>::from_f64(libm::ldexp(
                    1.0,
                    -i32::from(scaling),
                )))
            }

            #[inline]
            fn angle_column_scale(scaling: i8) -> Option<Self> {
                Self::column_scale(scaling, ())
            }

            #[inline]
            fn angle_term_scale(scaling: i8, _: i8) -> Option<Self> {
                Self::column_scale(scaling, ())
            }

            #[inline]
            fn control_point(raw: i32, column_scale: Self) -> Self {
                // A power of two, so nothing is lost.
                <Self as Real>::from_i32(raw) * column_scale
            }

            #[inline]
            fn from_spline(value: Self, _: Self) -> Self {
                value
            }

            #[inline]
            fn reciprocal_of(value: u32) -> Self {
                <Self as Real>::reciprocal_of(value)
            }

            #[inline]
            fn fraction(part: u32, reciprocal: Self) -> Self {
                <Self as Real>::from_i32(part.cast_signed()) * reciprocal
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
