//! Dual numbers as a scalar of the model: a value and its derivative by one variable,
//! so that the one set of equations gives its own exact derivatives.
//!
//! A type of its own around [`num_dual::Dual64`], because neither that type nor the
//! trait [`Real`] belongs to this crate, and because its sine, cosine and angle are the
//! platform's.

use flexor::number::Real;
use num_dual::{Dual64, DualNum};
use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// A value and its derivative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual(Dual64);

impl Default for Dual {
    fn default() -> Self {
        Self::ZERO
    }
}

impl Dual {
    /// `value` with the derivative `slope`.
    pub fn new(value: f64, slope: f64) -> Self {
        Self(Dual64::new(value, slope))
    }

    /// The value.
    pub fn value(self) -> f64 {
        self.0.re
    }

    /// The derivative.
    pub fn slope(self) -> f64 {
        self.0.eps
    }
}

macro_rules! operator {
    ($($trait:ident $method:ident),*) => {$(
        impl $trait for Dual {
            type Output = Self;
            #[inline]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    )*};
}

operator!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Dual {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl AddAssign for Dual {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl SubAssign for Dual {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        self.0 -= other.0;
    }
}

/// By the value alone: a branch is taken as without the derivative.
impl PartialOrd for Dual {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.0.re.partial_cmp(&other.0.re)
    }
}

impl Real for Dual {
    const ZERO: Self = Self(Dual64 { re: 0.0, eps: 0.0 });
    const ONE: Self = Self(Dual64 { re: 1.0, eps: 0.0 });

    #[inline]
    fn from_f64(value: f64) -> Self {
        Self::new(value, 0.0)
    }

    /// The value; the derivative is lost.
    #[inline]
    fn to_f64(self) -> f64 {
        self.0.re
    }

    #[inline]
    fn from_i32(value: i32) -> Self {
        Self::new(f64::from(value), 0.0)
    }

    #[inline]
    fn reciprocal_of(value: u32) -> Self {
        Self::new(f64::reciprocal_of(value), 0.0)
    }

    /// Of value and derivative.
    #[inline]
    fn is_finite(self) -> bool {
        self.0.re.is_finite() && self.0.eps.is_finite()
    }

    #[inline]
    fn sqrt(self) -> Self {
        Self(DualNum::sqrt(&self.0))
    }

    #[inline]
    fn sin(self) -> Self {
        let (sine, cosine) = libm::sincos(self.0.re);
        Self::new(sine, self.0.eps * cosine)
    }

    #[inline]
    fn cos(self) -> Self {
        let (sine, cosine) = libm::sincos(self.0.re);
        Self::new(cosine, self.0.eps * -sine)
    }

    #[inline]
    fn atan2(self, x: Self) -> Self {
        let (y, x) = (self.0, x.0);
        let slope = (x.re * y.eps - y.re * x.eps) / (x.re * x.re + y.re * y.re);
        Self::new(libm::atan2(y.re, x.re), slope)
    }
}

#[cfg(feature = "bench")]
impl crate::plant::bench::lanes::Lanes for Dual {
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
        self.magnitude()
    }

    /// The quarter turns that an argument is brought down by have no derivative.
    #[inline]
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
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
            prop_assert!(close(-a, -x, -1.0));
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
    }
}
