//! The sine that the control tick uses.
//!
//! libm's `sinf` reduces its argument in f64, which a Cortex-M4F has to emulate
//! (some 1,200 instructions). This one stays in the scalar's own arithmetic: the
//! argument is brought to `[-pi/2, pi/2]`, then an odd polynomial of degree 9 is
//! evaluated. Its coefficients minimise the largest absolute error with the leading one
//! fixed at 1 (Remez): 4.62e-9 in exact arithmetic.
//!
//! Floating point reduces the argument by subtracting a multiple of pi in two parts
//! (Cody and Waite). In fixed point an angle's integers wrap where the angle does, half a
//! turn being 2^31, so that reduction is exact and costs nothing; the same polynomial takes
//! half turns there.
//!
//! **Largest error** against the exact sine: 1.3e-7 in `f32` (one unit in the last
//! place of 1 is 1.2e-7) and 5e-9 in `f64`, for arguments up to [`ARGUMENT_MAX_RAD`] in
//! magnitude; in fixed point 3e-8, for every angle. The tests scan the ranges.

use crate::number::scalar::{Constant, Scalar};
use core::f64::consts::PI;

/// Largest argument magnitude, in radians, for which the stated error holds in floating
/// point. Beyond it the result loses accuracy but stays within [-1, 1], for whatever bits.
pub const ARGUMENT_MAX_RAD: f64 = 1000.0;

/// Coefficients of x^3, x^5, x^7, x^9; that of x is 1.
const RADIANS: [Constant; 4] = [
    Constant::new(-0.166_666_570_965_143_42, -2),
    Constant::new(0.008_333_017_291_768_292, -2),
    Constant::new(-0.000_198_066_152_144_423_22, -2),
    Constant::new(2.600_054_793_371_227e-6, -2),
];

/// The same for an argument in half turns, of y, y^3, ..., y^9: up to 5.2, exponent 3.
const HALF_TURNS: [Constant; 5] = {
    let square = PI * PI;
    let [c3, c5, c7, c9] = RADIANS;
    let mut power = PI;
    let mut constants = [Constant::new(power, 3); 5];
    power *= square;
    constants[1] = Constant::new(c3.value * power, 3);
    power *= square;
    constants[2] = Constant::new(c5.value * power, 3);
    power *= square;
    constants[3] = Constant::new(c7.value * power, 3);
    power *= square;
    constants[4] = Constant::new(c9.value * power, 3);
    constants
};

/// Sine of a float in [-pi/2, pi/2].
#[inline]
pub(super) fn of_radians<T: Scalar>(x: T) -> T {
    let square = x.times_in_range::<1>(x);
    let [c3, c5, c7, c9] = RADIANS.map(T::constant);
    let mut sum = c9.times_in_range::<1>(square).plus_in_range(c7);
    sum = sum.times_in_range::<1>(square).plus_in_range(c5);
    sum = sum.times_in_range::<1>(square).plus_in_range(c3);
    let sum = sum.times_in_range::<1>(square);
    x.plus_in_range(x.times_in_range::<1>(sum))
}

/// Sine of `y` half turns, in [-1/2, 1/2] and of exponent 0: of exponent 1.
#[inline]
pub(super) fn of_half_turns<T: Scalar>(y: T) -> T {
    let square = y.times_in_range::<2>(y); // up to 1/4: exponent -1
    let [c1, c3, c5, c7, c9] = HALF_TURNS.map(T::constant);
    let mut sum = c9.times_in_range::<0>(square).plus_in_range(c7);
    sum = sum.times_in_range::<0>(square).plus_in_range(c5);
    sum = sum.times_in_range::<0>(square).plus_in_range(c3);
    sum = sum.times_in_range::<0>(square).plus_in_range(c1);
    y.times_in_range::<3>(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::SiScalar;

    /// Scans `count` arguments over +-`range` and returns the largest error.
    fn largest_error<T: SiScalar<Format = ()>>(range: f64, count: i32) -> f64 {
        let mut worst = 0.0_f64;
        for i in -count..=count {
            let x = T::from_si(range * f64::from(i) / f64::from(count), ());
            let error = (x.sine().to_si(()) - libm::sin(x.to_si(()))).abs();
            worst = worst.max(error);
        }
        worst
    }

    #[test]
    fn error_is_within_the_stated_bounds_over_the_whole_range() {
        for range in [0.01, 1.6, 3.2, 7.0, ARGUMENT_MAX_RAD] {
            let single = largest_error::<f32>(range, 2_000_003);
            assert!(single <= 1.3e-7, "f32 over +-{range}: {single:e}");
            let double = largest_error::<f64>(range, 2_000_003);
            assert!(double <= 5e-9, "f64 over +-{range}: {double:e}");
        }
    }

    #[test]
    fn every_f32_of_the_first_quadrant_is_within_the_stated_bound() {
        // All floats in [0.5, pi/2]; below 0.5 the spacing only shrinks (scanned above).
        let mut worst = 0.0_f64;
        let (low, high) = (0.5_f32.to_bits(), core::f32::consts::FRAC_PI_2.to_bits());
        for bits in low..=high {
            let x = f32::from_bits(bits);
            let error = (f64::from(x.sine()) - libm::sin(f64::from(x))).abs();
            worst = worst.max(error);
        }
        assert!(worst <= 1.3e-7, "{worst:e}");
    }

    #[test]
    fn no_bits_take_it_beyond_one() {
        // An odd step: every exponent, NaN and the infinities, and all sorts of fractions.
        for bits in (0..=u32::MAX).step_by(10_007) {
            let x = f32::from_bits(bits);
            let s = x.sine();
            assert!(s.abs() <= 1.0 + f32::EPSILON, "sin({x:e}) = {s}");
            let x = f64::from_bits(u64::from(bits) << 32);
            let s = x.sine();
            assert!(s.abs() <= 1.0 + 5e-9, "sin({x:e}) = {s}");
        }
    }
}
