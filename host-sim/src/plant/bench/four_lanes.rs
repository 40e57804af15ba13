//! Four `f64` side by side as a number: one lane a plant.

use crate::plant::bench::lanes::Lanes;
use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};
use flexor::number::Real;
use wide::f64x4;

/// Four numbers that are added, multiplied and compared at once.
///
/// Each lane's bits are those that `f64` gives: addition, multiplication, division and square root
/// are IEEE's, and nothing is contracted. As a [`PartialOrd`] it compares only what compares the
/// same in all lanes; code that runs in lanes asks [`Lanes::below`] instead.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct F64x4(f64x4);

impl F64x4 {
    /// Lane by lane.
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self(f64x4::from(self.0.to_array().map(f)))
    }
}

macro_rules! operator {
    ($($trait:ident $function:ident $operator:tt),*) => {$(
        impl $trait for F64x4 {
            type Output = Self;
            #[inline]
            fn $function(self, other: Self) -> Self {
                Self(self.0 $operator other.0)
            }
        }
    )*};
}

operator!(Add add +, Sub sub -, Mul mul *, Div div /);

impl Neg for F64x4 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl AddAssign for F64x4 {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for F64x4 {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl PartialOrd for F64x4 {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        let (a, b) = (self.0.to_array(), other.0.to_array());
        let first = a[0].partial_cmp(&b[0]);
        let same = a.iter().zip(&b).all(|(a, b)| a.partial_cmp(b) == first);
        first.filter(|_| same)
    }
}

impl Real for F64x4 {
    const ZERO: Self = Self(f64x4::new([0.0; 4]));
    const ONE: Self = Self(f64x4::new([1.0; 4]));

    #[inline]
    fn from_f64(value: f64) -> Self {
        Self(f64x4::splat(value))
    }

    /// The first lane.
    fn to_f64(self) -> f64 {
        self.lane(0)
    }

    fn from_i32(value: i32) -> Self {
        Self::from_f64(f64::from(value))
    }

    fn reciprocal_of(value: u32) -> Self {
        Self::from_f64(1.0 / f64::from(value))
    }

    /// True when every lane is.
    fn is_finite(self) -> bool {
        self.0.to_array().into_iter().all(f64::is_finite)
    }

    #[inline]
    fn magnitude(self) -> Self {
        self.absolute()
    }

    #[inline]
    fn limited(self, low: Self, high: Self) -> Self {
        let raised = Self::select(self.below(low), low, self);
        Self::select(high.below(self), high, raised)
    }

    #[inline]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    fn sin(self) -> Self {
        self.map(Real::sin)
    }

    fn cos(self) -> Self {
        self.map(Real::cos)
    }

    fn atan2(self, x: Self) -> Self {
        let x = x.0.to_array();
        Self::from_lanes(|i| Real::atan2(self.lane(i), x[i]))
    }
}

impl Lanes for F64x4 {
    const LANES: usize = 4;
    type Mask = f64x4;

    #[inline]
    fn from_lanes(value: impl FnMut(usize) -> f64) -> Self {
        Self(f64x4::from(core::array::from_fn(value)))
    }

    #[inline]
    fn lane(self, lane: usize) -> f64 {
        self.0.to_array()[lane]
    }

    #[inline]
    fn below(self, other: Self) -> f64x4 {
        self.0.simd_lt(other.0)
    }

    #[inline]
    fn select(mask: f64x4, yes: Self, no: Self) -> Self {
        Self(mask.select(yes.0, no.0))
    }

    #[inline]
    fn absolute(self) -> Self {
        Self(self.0.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every operation of the trait, lane by lane the bits of `f64`'s.
    fn agrees(a: [f64; 4], b: [f64; 4]) {
        let [x, y] = [a, b].map(|v| F64x4::from_lanes(|i| v[i]));
        let check = |found: F64x4, exact: &dyn Fn(f64, f64) -> f64| {
            for i in 0..4 {
                let exact = exact(a[i], b[i]);
                let same = found.lane(i).to_bits() == exact.to_bits()
                    || (found.lane(i).is_nan() && exact.is_nan());
                assert!(same, "{} {exact} of {} {}", found.lane(i), a[i], b[i]);
            }
        };
        check(x + y, &|a, b| a + b);
        check(x - y, &|a, b| a - b);
        check(x * y, &|a, b| a * b);
        check(x / y, &|a, b| a / b);
        check(-x, &|a, _| -a);
        check(x.absolute(), &|a, _| a.abs());
        check(Real::sqrt(x), &|a, _| a.sqrt());
        check(x.smaller(y), &|a, b| Lanes::smaller(a, b));
        check(x.larger(y), &|a, b| Lanes::larger(a, b));
        check(x.within(y), &|a, b| Lanes::within(a, b));
        check(F64x4::select(x.below(y), x, y), &|a, b| {
            if a < b { a } else { b }
        });
        check(x.limited(y, y + F64x4::ONE), &|a, b| a.limited(b, b + 1.0));
        check(Lanes::sin_cos(x).0, &|a, _| Lanes::sin_cos(a).0);
        check(Lanes::sin_cos(x).1, &|a, _| Lanes::sin_cos(a).1);
        check(Real::sin(x), &|a, _| Real::sin(a));
        check(Real::cos(x), &|a, _| Real::cos(a));
        check(Real::atan2(x, y), &|a, b| Real::atan2(a, b));
    }

    #[test]
    fn lanes_are_ordered_only_when_all_are() {
        let [a, b] = [[1.0, 2.0, 3.0, 4.0], [2.0, 3.0, 4.0, 5.0]]
            .map(|v: [f64; 4]| F64x4::from_lanes(|i| v[i]));
        assert_eq!(a.partial_cmp(&b), Some(Ordering::Less));
        assert_eq!(b.partial_cmp(&a), Some(Ordering::Greater));
        let mixed = F64x4::from_lanes(|i| if i == 0 { 9.0 } else { 0.0 });
        assert!(a.partial_cmp(&mixed).is_none());
    }

    proptest! {
        #[test]
        fn each_lane_has_the_bits_of_a_number_alone(
            a in proptest::array::uniform4(-1e3..1e3_f64),
            b in proptest::array::uniform4(-1e3..1e3_f64),
            wild in proptest::array::uniform4(any::<f64>()),
        ) {
            agrees(a, b);
            agrees(a, wild);
            agrees([0.0, -0.0, f64::INFINITY, f64::NAN], b);
        }
    }
}
