//! Numbers in which several plants advance at once: what the simulated bench's equations ask
//! of a number beyond [`Real`].
//!
//! The equations are written once, over [`Lanes`]. In `f64` they are one plant; in
//! [`F64x4`](crate::plant::bench::F64x4) four, each in a lane of its own. A lane's bits are those that `f64` gives: both run
//! the same source, whose operations are IEEE's in either type, and nothing in it branches on a
//! value. Where the physics has cases (contact or none, sticking or sliding) both are computed
//! and one is taken, by [`Lanes::select`].

use crate::model::dual::Dual;
use flexor::number::Real;

/// A number with one or more lanes, comparison lane by lane, and choice without a branch.
pub trait Lanes: Real {
    /// Number of lanes.
    const LANES: usize;

    /// Truth, lane by lane.
    type Mask: Copy;

    /// The number whose lanes are `value(lane)`.
    fn from_lanes(value: impl FnMut(usize) -> f64) -> Self;

    /// The value in `lane`, which is below [`LANES`](Self::LANES).
    fn lane(self, lane: usize) -> f64;

    /// Where `self < other`; false where either is NaN.
    fn below(self, other: Self) -> Self::Mask;

    /// `yes` where `mask` holds, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// |self|, sign bit cleared.
    fn absolute(self) -> Self;

    /// The smaller one; `self` where they are equal or either is NaN.
    #[inline]
    fn smaller(self, other: Self) -> Self {
        Self::select(other.below(self), other, self)
    }

    /// The larger one; `self` where they are equal or either is NaN.
    #[inline]
    fn larger(self, other: Self) -> Self {
        Self::select(self.below(other), other, self)
    }

    /// The nearest value within +-`bound`; NaN stays NaN.
    #[inline]
    fn within(self, bound: Self) -> Self {
        self.smaller(bound).larger(-bound)
    }

    /// Sine and cosine of an angle in radians, lane by lane the same bits in every type.
    ///
    /// The argument is brought to +-pi/4 by subtracting a multiple of pi/2 in three parts
    /// (Cody and Waite), then fdlibm's two polynomials are evaluated. Within one unit in the
    /// last place of 1 for arguments up to [`ANGLE_MAX_RAD`]; beyond, accuracy is lost.
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }
}

/// Largest magnitude, rad, of an argument that [`Lanes::sin_cos`] answers exactly.
pub const ANGLE_MAX_RAD: f64 = 1e5;

/// The integer nearest to `x`, for magnitudes below 2^51: adding 1.5 2^52 leaves no bits for a
/// fraction.
#[inline]
pub(super) fn nearest<T: Lanes>(x: T) -> T {
    let shift = T::from_f64(6_755_399_441_055_744.0);
    (x + shift) - shift
}

/// `c[0] + x (c[1] + x (...))`.
#[inline]
fn horner<T: Lanes>(x: T, coefficients: &[f64]) -> T {
    coefficients
        .iter()
        .rev()
        .fold(T::ZERO, |sum, c| sum * x + T::from_f64(*c))
}

/// See [`Lanes::sin_cos`].
#[inline]
fn sin_cos<T: Lanes>(angle: T) -> (T, T) {
    let c = T::from_f64;
    let turns = nearest(angle * c(core::f64::consts::FRAC_2_PI));
    // pi/2 in three parts; the first two have 33 bits, so that their products are exact.
    let x = ((angle - turns * c(1.570_796_326_734_125_6)) - turns * c(6.077_100_506_303_966e-11))
        - turns * c(2.022_266_248_795_950_7e-21);
    let square = x * x;
    let sine = x + x
        * square
        * horner(
            square,
            &[
                -1.666_666_666_666_663_2e-1,
                8.333_333_333_322_49e-3,
                -1.984_126_982_985_795e-4,
                2.755_731_370_707_007e-6,
                -2.505_076_025_340_686_3e-8,
                1.589_690_995_211_55e-10,
            ],
        );
    let half = c(0.5) * square;
    let cosine = (T::ONE - half)
        + square
            * square
            * horner(
                square,
                &[
                    4.166_666_666_666_66e-2,
                    -1.388_888_888_887_411e-3,
                    2.480_158_728_947_673e-5,
                    -2.755_731_435_139_066_3e-7,
                    2.087_572_321_298_175e-9,
                    -1.135_964_755_778_819_5e-11,
                ],
            );
    // The quarter turn, -2 to 2: odd ones swap sine and cosine.
    let quarter = turns - c(4.0) * nearest(turns * c(0.25));
    let whole = quarter.absolute();
    let odd = (whole - T::ONE).absolute().below(c(0.5));
    let back = c(1.5).below(whole);
    let (first, second) = (T::select(odd, cosine, sine), T::select(odd, sine, cosine));
    let negative_sine = T::select(odd, quarter, T::select(back, -T::ONE, T::ONE));
    let negative_cosine = T::select(odd, -quarter, T::select(back, -T::ONE, T::ONE));
    (first * negative_sine, second * negative_cosine)
}

impl Lanes for f64 {
    const LANES: usize = 1;
    type Mask = bool;

    #[inline]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        value(0)
    }

    #[inline]
    fn lane(self, _: usize) -> f64 {
        self
    }

    #[inline]
    fn below(self, other: Self) -> bool {
        self < other
    }

    #[inline]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }

    #[inline]
    fn absolute(self) -> Self {
        self.abs()
    }
}

impl<const N: usize> Lanes for Dual<N> {
    const LANES: usize = 1;
    type Mask = bool;

    #[inline]
    fn from_lanes(mut value: impl FnMut(usize) -> f64) -> Self {
        Self::from_f64(value(0))
    }

    #[inline]
    fn lane(self, _: usize) -> f64 {
        self.value()
    }

    #[inline]
    fn below(self, other: Self) -> bool {
        self < other
    }

    #[inline]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }

    #[inline]
    fn absolute(self) -> Self {
        Real::magnitude(self)
    }

    /// The quarter turns that an argument is brought down by have no derivative.
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        (Real::sin(self), Real::cos(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sine_and_cosine_are_libms_to_a_unit_in_the_last_place() {
        let mut worst = 0.0_f64;
        for range in [1.0, 10.0, ANGLE_MAX_RAD] {
            for i in -100_003..=100_003 {
                let x = range * f64::from(i) / 100_003.0;
                let (s, c) = Lanes::sin_cos(x);
                worst = worst.max((s - Real::sin(x)).abs());
                worst = worst.max((c - Real::cos(x)).abs());
            }
        }
        assert!(worst <= f64::EPSILON, "{worst:e}");
    }

    proptest! {
        #[test]
        fn limits_hold_and_nan_stays(x in -10.0..10.0_f64, bound in 0.0..5.0_f64) {
            let limited = x.within(bound);
            prop_assert!(limited.abs() <= bound && (x.abs() > bound || limited == x));
            prop_assert!(f64::NAN.within(bound).is_nan());
            prop_assert_eq!(x.smaller(bound), x.min(bound));
            prop_assert_eq!(x.larger(bound), x.max(bound));
        }
    }
}
