//! The sine that the control tick uses.
//!
//! libm's `sinf` reduces its argument in f64, which a Cortex-M4F has to emulate
//! (some 1,200 instructions). This one stays in the scalar's own arithmetic: the
//! argument is brought to `[-pi/2, pi/2]`, then an odd polynomial of degree 9 is
//! evaluated. Its coefficients minimise the largest absolute error with the leading one
//! fixed at 1 (Remez): 4.62e-9 in exact arithmetic.
//!
//! Floating point reduces the argument by subtracting a multiple of pi in two parts
//! (Cody and Waite). In fixed point the argument becomes a binary angle, whose integers
//! wrap where the angle does, so that reduction is exact and costs nothing.
//!
//! **Largest error** against the exact sine: 1.3e-7 in `f32` (one unit in the last
//! place of 1 is 1.2e-7) and 5e-9 in `f64`, for arguments up to [`ARGUMENT_MAX_RAD`] in
//! magnitude; in fixed point 4e-8 and an error of the argument of a few units in its last
//! place, for all arguments of the format. The tests scan the ranges.

use crate::number::scalar::{Constant, Scalar};

/// Largest argument magnitude, in radians, for which the stated error holds in floating
/// point. Beyond it the result loses accuracy but stays within [-1, 1], for whatever bits.
pub const ARGUMENT_MAX_RAD: f64 = 1000.0;

/// Exponent of the coefficients' format: they and the partial sums are below 1/4.
const EXPONENT: i32 = -2;

/// Coefficients of x^3, x^5, x^7, x^9.
const COEFFICIENTS: [Constant; 4] = [
    Constant::new(-0.166_666_570_965_143_42, EXPONENT),
    Constant::new(0.008_333_017_291_768_292, EXPONENT),
    Constant::new(-0.000_198_066_152_144_423_22, EXPONENT),
    Constant::new(2.600_054_793_371_227e-6, EXPONENT),
];

/// Sine of an angle in radians, in the format [`Scalar::SINE`]; `angle_scale` is that of the
/// angle's format. NaN and the infinities give no sensible value, but one within [-1, 1]
/// (the controller refuses both before they get here).
#[inline]
pub fn sin<T: Scalar>(angle: T, angle_scale: T::AngleScale) -> T {
    let x = angle.reduced(angle_scale); // up to pi/2: exponent 1
    let square = x.times_in_range::<1>(x); // up to 2.47: exponent 2
    let [c3, c5, c7, c9] = COEFFICIENTS.map(T::constant);
    let mut sum = c9.times_in_range::<3>(square).plus_in_range(c7);
    sum = sum.times_in_range::<3>(square).plus_in_range(c5);
    sum = sum.times_in_range::<3>(square).plus_in_range(c3);
    // Up to 0.42: exponent 0.
    let sum = sum.times_in_range::<1>(square);
    x.plus_in_range(x.times_in_range::<1>(sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::number::SiScalar;

    /// Scans `count` arguments over +-`range` and returns the largest error.
    fn largest_error<T: SiScalar<Format = (), AngleScale = ()>>(range: f64, count: i32) -> f64 {
        let mut worst = 0.0_f64;
        for i in -count..=count {
            let x = T::from_si(range * f64::from(i) / f64::from(count), ());
            let error = (sin(x, ()).to_si(()) - libm::sin(x.to_si(()))).abs();
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
            let error = (f64::from(sin(x, ())) - libm::sin(f64::from(x))).abs();
            worst = worst.max(error);
        }
        assert!(worst <= 1.3e-7, "{worst:e}");
    }

    #[test]
    fn no_bits_take_it_beyond_one() {
        // An odd step: every exponent, NaN and the infinities, and all sorts of fractions.
        for bits in (0..=u32::MAX).step_by(10_007) {
            let x = f32::from_bits(bits);
            let s = sin(x, ());
            assert!(s.abs() <= 1.0 + f32::EPSILON, "sin({x:e}) = {s}");
            let x = f64::from_bits(u64::from(bits) << 32);
            let s = sin(x, ());
            assert!(s.abs() <= 1.0 + 5e-9, "sin({x:e}) = {s}");
        }
    }
}
