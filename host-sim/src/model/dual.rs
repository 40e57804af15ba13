//! Dual numbers as a scalar of the model: a value and its derivatives by `N` variables, so that the one
//! set of equations gives its own exact derivatives.
//!
//! Their sine, cosine and angle are those of the `libm` crate, and products are not fused: a derivative
//! is the same on every host.

use flexor::number::Real;
use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A value and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize = 1> {
    value: f64,
    slopes: [f64; N],
}

impl<const N: usize> Default for Dual<N> {
    fn default() -> Self {
        Self::ZERO
    }
}

impl Dual {
    /// `value` with the derivative `slope`.
    pub fn new(value: f64, slope: f64) -> Self {
        Self::with_slopes(value, [slope])
    }

    /// The derivative.
    pub fn slope(self) -> f64 {
        self.slopes[0]
    }
}

impl<const N: usize> Dual<N> {
    /// `value` with the derivatives `slopes`.
    #[inline]
    pub fn with_slopes(value: f64, slopes: [f64; N]) -> Self {
        Self { value, slopes }
    }

    /// The value.
    #[inline]
    pub fn value(self) -> f64 {
        self.value
    }

    /// The derivatives.
    #[inline]
    pub fn slopes(&self) -> &[f64; N] {
        &self.slopes
    }

    /// A function of this number with the given value and derivative.
    #[inline]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self {
            value,
            slopes: self.slopes.map(|slope| slope * derivative),
        }
    }

    /// A function of two numbers with the given value and partial derivatives.
    #[inline]
    fn chain2(self, other: Self, value: f64, by: [f64; 2]) -> Self {
        let slopes = core::array::from_fn(|i| self.slopes[i] * by[0] + other.slopes[i] * by[1]);
        Self { value, slopes }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        let slopes = core::array::from_fn(|i| self.slopes[i] + other.slopes[i]);
        Self::with_slopes(self.value + other.value, slopes)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        let slopes = core::array::from_fn(|i| self.slopes[i] - other.slopes[i]);
        Self::with_slopes(self.value - other.value, slopes)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.chain2(other, self.value * other.value, [other.value, self.value])
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        let ratio = self.value / other.value;
        let inverse = 1.0 / other.value;
        self.chain2(other, ratio, [inverse, -ratio * inverse])
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> AddAssign for Dual<N> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> SubAssign for Dual<N> {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

/// By the value alone: a branch is taken as without the derivative.
impl<const N: usize> PartialOrd for Dual<N> {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Real for Dual<N> {
    const ZERO: Self = Self {
        value: 0.0,
        slopes: [0.0; N],
    };
    const ONE: Self = Self {
        value: 1.0,
        slopes: [0.0; N],
    };

    #[inline]
    fn from_f64(value: f64) -> Self {
        Self::with_slopes(value, [0.0; N])
    }

    /// The value; the derivative is lost.
    #[inline]
    fn to_f64(self) -> f64 {
        self.value
    }

    #[inline]
    fn from_i32(value: i32) -> Self {
        Self::from_f64(f64::from(value))
    }

    #[inline]
    fn reciprocal_of(value: u32) -> Self {
        Self::from_f64(f64::reciprocal_of(value))
    }

    /// Of value and derivatives.
    #[inline]
    fn is_finite(self) -> bool {
        self.value.is_finite() && self.slopes.iter().all(|slope| slope.is_finite())
    }

    #[inline]
    fn scaled(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }

    #[inline]
    fn sqrt(self) -> Self {
        let root = libm::sqrt(self.value);
        self.chain(root, 0.5 / root)
    }

    #[inline]
    fn sin(self) -> Self {
        let (sine, cosine) = libm::sincos(self.value);
        self.chain(sine, cosine)
    }

    #[inline]
    fn cos(self) -> Self {
        let (sine, cosine) = libm::sincos(self.value);
        self.chain(cosine, -sine)
    }

    #[inline]
    fn atan2(self, x: Self) -> Self {
        let (y, square) = (self, self.value * self.value + x.value * x.value);
        let angle = libm::atan2(y.value, x.value);
        y.chain2(x, angle, [x.value / square, -y.value / square])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_operation_has_its_derivative(x in -2.0..2.0_f64, y in 0.3..2.0_f64) {
            let (a, b) = (Dual::new(x, 1.0), Dual::from_f64(y));
            let close = |d: Dual, value: f64, slope: f64| {
                (d.value() - value).abs() < 1e-14 && (d.slope() - slope).abs() < 1e-13
            };
            prop_assert!(close(a + b, x + y, 1.0) && close(b - a, y - x, -1.0));
            prop_assert!(close(a * a, x * x, 2.0 * x) && close(a / b, x / y, 1.0 / y));
            prop_assert!(close(b / (a + b + b), y / (x + y + y), -y / ((x + y + y) * (x + y + y))) || (x + y + y).abs() < 0.3);
            prop_assert!(close(-a, -x, -1.0) && close(a.scaled(y), x * y, y));
            prop_assert!(close(a.sin(), x.sin(), x.cos()) && close(a.cos(), x.cos(), -x.sin()));
            let r2 = x * x + y * y;
            prop_assert!(close(a.atan2(b), x.atan2(y), y / r2));
            let positive = Dual::new(y, 1.0);
            prop_assert!(close(positive.sqrt(), y.sqrt(), 0.5 / y.sqrt()));
            let mut sum = a;
            sum += positive;
            sum -= b;
            prop_assert!(close(sum, x, 2.0));
            prop_assert!((a < b) == (x < y));
        }

        #[test]
        fn derivatives_by_several_variables_are_those_by_each(x in -2.0..2.0_f64, y in 0.3..2.0_f64) {
            let both = |x: Dual<2>, y: Dual<2>| (x * y + x.sin()).atan2(y) / (y + Dual::ONE);
            let one = |x: Dual, y: Dual| (x * y + x.sin()).atan2(y) / (y + Dual::ONE);
            let found = both(Dual::with_slopes(x, [1.0, 0.0]), Dual::with_slopes(y, [0.0, 1.0]));
            let by_x = one(Dual::new(x, 1.0), Dual::from_f64(y));
            let by_y = one(Dual::from_f64(x), Dual::new(y, 1.0));
            prop_assert_eq!(found.value(), by_x.value());
            prop_assert_eq!(found.slopes(), &[by_x.slope(), by_y.slope()]);
        }
    }
}
