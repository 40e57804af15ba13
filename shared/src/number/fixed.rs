//! The fixed-point scalar: [`Fixed`], a fraction in [-1, 1) with 31 bits after the point,
//! and what [`Scalar`] needs around it.
//!
//! All of a tick is 32-bit integer arithmetic but for the sums of 64 bits in which filters
//! and integral remember; nothing is divided, and no float operation is reachable. The
//! only product is `high_product`, the upper half of 32 by 32 bits: one instruction on a
//! Cortex-M3, some twenty on a Cortex-M0, which has no long multiply.
//!
//! **Rounding.** Products round down: the result of a product with `up` is too small by 0
//! to 2^up units. Sums do not round. Whole signals are rounded to nearest only where they
//! are made from f64 or from a table.
//!
//! The functions that take or give f64 are for the host; a microcontroller gets its
//! coefficients as [`crate::control::Coefficients`] and calls none of them.
//!
//! Glossary: a format's *exponent* E says that 1 stands for 2^E in the signal's unit; a
//! *unit* is the last bit, 2^(E - 31); *up* is the left shift after a product.

use crate::number::bits::Bits;
use crate::number::scalar::{Constant, Scalar, SiScalar, TableScalar};
use crate::number::sine;
use fixed::types::I1F31;
use serde::{Deserialize, Serialize};

/// A fraction in [-1, 1), 31 bits after the point. Its own operators do not saturate and
/// are not used: [`Scalar`]'s methods are.
pub type Fixed = I1F31;

/// The number with these bits.
#[inline]
const fn of(bits: i32) -> Fixed {
    I1F31::from_bits(bits)
}

/// The number's bits.
#[inline]
const fn bits(number: Fixed) -> i32 {
    number.to_bits()
}

/// What 1 stands for: two to this power, in the signal's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Exponent(pub i8);

impl Exponent {
    /// The smallest exponent whose format holds +-`magnitude`; saturates at +-60.
    pub fn holding(magnitude: f64) -> Self {
        let mut exponent = -60_i8;
        while exponent < 60 && !(magnitude < libm::ldexp(1.0, i32::from(exponent))) {
            exponent += 1;
        }
        Self(exponent)
    }

    /// What 1 stands for.
    pub fn range(self) -> f64 {
        libm::ldexp(1.0, i32::from(self.0))
    }

    /// What the last bit stands for.
    pub fn unit(self) -> f64 {
        libm::ldexp(1.0, i32::from(self.0) - 31)
    }
}

/// A constant factor: `high_product` with the mantissa, then a left shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShiftedGain {
    mantissa: i32,
    up: Bits,
}

impl ShiftedGain {
    /// The factor `ratio` between the numbers, with as small a shift as it allows.
    fn new(ratio: f64) -> Self {
        let mut up = 0_u8;
        let mut scaled = ratio * 4_294_967_296.0;
        while up < 31 && !(libm::fabs(scaled) <= 2_147_483_647.0) {
            scaled *= 0.5;
            up += 1;
        }
        Self {
            mantissa: libm::rint(scaled) as i32,
            up: Bits::at_most(up),
        }
    }

    fn ratio(self) -> f64 {
        libm::ldexp(f64::from(self.mantissa), i32::from(self.up) - 32)
    }

    /// The left shift: a product is exact to 2^`up` units of the result.
    pub fn up(self) -> u8 {
        self.up.into()
    }
}

/// How a table column's integers become control points and the splines' values the signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ColumnScale {
    /// Right shift of the integers, at least 2: a spline's coefficients are up to 4.4
    /// times as large as its control points, and those up to 2^30.
    down: Bits,
    /// Left shift of the values.
    up: Bits,
    /// True for angles: the integers are divided by pi besides.
    angle: bool,
}

/// 1 divided by an integer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reciprocal {
    mantissa: i32,
    /// Left shift that brings the integer to 2^30 or more.
    up: u8,
}

/// True on ARMv6-M, the one Cortex-M architecture without exclusive accesses, and without
/// long multiplication.
const NARROW: bool = cfg!(all(target_arch = "arm", not(target_has_atomic = "32")));

/// a b / 2^32, rounded down.
#[inline]
fn high_product(a: i32, b: i32) -> i32 {
    if NARROW {
        high_product_of_halves(a, b)
    } else {
        ((i64::from(a) * i64::from(b)) >> 32) as i32
    }
}

/// `high_product` of 16-bit halves: four short multiplications where the compiler would
/// call a 64-bit one.
#[inline]
fn high_product_of_halves(a: i32, b: i32) -> i32 {
    let (a_high, a_low) = (a >> 16, a & 0xffff);
    let (b_high, b_low) = (b >> 16, b & 0xffff);
    let low = (a_low as u32).wrapping_mul(b_low as u32) >> 16;
    // Below 2^31 in magnitude: 2^15 (2^16 - 1) + 2^16 - 1.
    let middle = a_high.wrapping_mul(b_low).wrapping_add(low as i32);
    let other = a_low.wrapping_mul(b_high).wrapping_add(middle & 0xffff);
    a_high
        .wrapping_mul(b_high)
        .wrapping_add(middle >> 16)
        .wrapping_add(other >> 16)
}

/// a b.
#[inline]
fn product(a: i32, b: i32) -> i64 {
    if NARROW {
        let low = a.wrapping_mul(b).cast_unsigned();
        i64::from(high_product_of_halves(a, b)) << 32 | i64::from(low)
    } else {
        i64::from(a) * i64::from(b)
    }
}

/// What the last bit of an angle stands for: half a turn is 2^31.
pub const RADIANS_PER_UNIT: f64 = core::f64::consts::PI / 2_147_483_648.0;

/// Counts a saturation; the counter itself stays at its end.
#[inline]
fn count_saturation(count: &mut u32) {
    *count = count.saturating_add(1);
}

/// `x` times 2^`up`; saturates.
#[inline]
fn shifted(x: i32, up: Bits, count: &mut u32) -> Fixed {
    let up = up.count();
    let result = x.wrapping_shl(up);
    if result.wrapping_shr(up) == x {
        of(result)
    } else {
        count_saturation(count);
        of(if x < 0 { i32::MIN } else { i32::MAX })
    }
}

/// The exact sum, or the end of the range that is nearest to it.
#[inline]
fn in_range((sum, overflown): (i32, bool), count: &mut u32) -> Fixed {
    if overflown {
        count_saturation(count);
        // The wrapped sum has the wrong sign.
        of(if sum < 0 { i32::MAX } else { i32::MIN })
    } else {
        of(sum)
    }
}

/// Sums have twice a number's bits: 62 after the point, one more before it.
const SUM_POINT: u32 = 31;
/// A sum's end of range in its upper word: there its number is at the end of its own.
const SUM_TOP: i32 = 1 << 30;

/// The end of the range that is nearest to a sum beyond it. Few sums are: out of line, the others
/// take an addition and a branch to see that they are not.
#[cold]
#[inline(never)]
fn held_sum(sum: i64, count: &mut u32) -> i64 {
    count_saturation(count);
    let end = i64::from(SUM_TOP) << 32;
    if sum < 0 { -end } else { end - 1 }
}

impl Scalar for Fixed {
    type Gain = ShiftedGain;
    type Alpha = i32;
    type Shift = Bits;
    type Sum = i64;
    type SaturationCount = u32;

    const ZERO: Self = of(0);
    const UNKNOWN: Self = of(i32::MIN);

    #[inline]
    fn constant(constant: Constant) -> Self {
        of(constant.bits)
    }

    #[inline]
    fn plus(self, other: Self, count: &mut u32) -> Self {
        in_range(bits(self).overflowing_add(bits(other)), count)
    }

    #[inline]
    fn minus(self, other: Self, count: &mut u32) -> Self {
        in_range(bits(self).overflowing_sub(bits(other)), count)
    }

    #[inline]
    fn plus_in_range(self, other: Self) -> Self {
        debug_assert!(bits(self).checked_add(bits(other)).is_some());
        of(bits(self).wrapping_add(bits(other)))
    }

    #[inline]
    fn minus_in_range(self, other: Self) -> Self {
        debug_assert!(bits(self).checked_sub(bits(other)).is_some());
        of(bits(self).wrapping_sub(bits(other)))
    }

    #[inline]
    fn negative(self) -> Self {
        of(bits(self).saturating_neg())
    }

    #[inline]
    fn half(self) -> Self {
        of(bits(self) >> 1)
    }

    #[inline]
    fn scaled(self, gain: ShiftedGain, count: &mut u32) -> Self {
        shifted(high_product(bits(self), gain.mantissa), gain.up, count)
    }

    #[inline]
    fn times(self, other: Self, shift: Bits, count: &mut u32) -> Self {
        shifted(high_product(bits(self), bits(other)), shift, count)
    }

    fn over(self, other: Self, shift: Bits, count: &mut u32) -> Self {
        // times() gives the product's upper 32 bits, shifted up.
        let dividend = i64::from(bits(self)) << (32 - shift.count());
        if bits(other) == 0 {
            return Self::ZERO;
        }
        let quotient = dividend.saturating_div(i64::from(bits(other)));
        i32::try_from(quotient).map_or_else(
            |_| {
                count_saturation(count);
                of(if quotient > 0 { i32::MAX } else { i32::MIN })
            },
            of,
        )
    }

    #[inline]
    fn times_in_range<const UP: u32>(self, other: Self) -> Self {
        let high = high_product(bits(self), bits(other));
        let result = high.wrapping_shl(UP);
        debug_assert!(result.wrapping_shr(UP) == high);
        of(result)
    }

    #[inline]
    fn sum(self) -> i64 {
        i64::from(bits(self)) << SUM_POINT
    }

    #[inline]
    fn of_sum(sum: i64) -> Self {
        of((sum >> SUM_POINT) as i32)
    }

    #[inline]
    fn times_alpha(self, alpha: i32) -> i64 {
        product(bits(self), alpha)
    }

    #[inline]
    fn accumulated(sum: i64, more: i64, count: &mut u32) -> i64 {
        // Both are at most 2^62 in magnitude, and one of them less.
        debug_assert!(sum.checked_add(more).is_some());
        let sum = sum.wrapping_add(more);
        // From -SUM_TOP to below SUM_TOP.
        let top = (sum >> 32) as i32;
        if top.wrapping_add(SUM_TOP) >= 0 {
            sum
        } else {
            held_sum(sum, count)
        }
    }

    #[inline]
    fn angle_minus(self, other: Self) -> Self {
        of(bits(self).wrapping_sub(bits(other)))
    }

    #[inline]
    fn sine(self) -> Self {
        let angle = bits(self);
        // Beyond a quarter turn: sin(a) = sin(half a turn - a).
        let quarter = 1 << 30;
        let beyond = angle.wrapping_add(quarter) < 0;
        sine::of_half_turns(of(if beyond {
            i32::MIN.wrapping_sub(angle)
        } else {
            angle
        }))
    }

    #[inline]
    fn fine(self, shift: Bits, count: &mut u32) -> Self {
        shifted(bits(self), shift, count)
    }

    #[inline]
    fn is_known(self) -> bool {
        bits(self) != i32::MIN
    }

    #[inline]
    fn all_finite<const N: usize>(_values: [Self; N]) -> bool {
        true
    }

    #[inline]
    fn is_within(self, limit: Self) -> bool {
        bits(self).unsigned_abs() < bits(limit).cast_unsigned()
    }
}

impl SiScalar for Fixed {
    type Format = Exponent;
    const SINE: Exponent = Exponent(1);

    fn from_si(value: f64, format: Exponent) -> Self {
        // `as` saturates, and NaN gives 0.
        of(libm::rint(value / format.unit()) as i32)
    }

    fn to_si(self, format: Exponent) -> f64 {
        f64::from(bits(self)) * format.unit()
    }

    fn from_rad(value: f64) -> Self {
        // The low bits alone: what is above them is whole turns. NaN gives 0.
        of(libm::rint(value / RADIANS_PER_UNIT) as i64 as i32)
    }

    fn to_rad(self) -> f64 {
        f64::from(bits(self)) * RADIANS_PER_UNIT
    }

    fn gain(value: f64, from: Exponent, to: Exponent) -> ShiftedGain {
        ShiftedGain::new(value * from.range() / to.range())
    }

    fn angle_gain(value: f64, to: Exponent) -> ShiftedGain {
        ShiftedGain::new(value * core::f64::consts::PI / to.range())
    }

    fn fine_shift(largest: f64) -> Bits {
        let turned = Exponent::holding(largest / core::f64::consts::PI);
        Bits::at_most((-i32::from(turned.0)).clamp(0, 30) as u8)
    }

    fn fine_gain(value: f64, shift: Bits, to: Exponent) -> ShiftedGain {
        Self::angle_gain(libm::ldexp(value, -i32::from(shift)), to)
    }

    fn fine_gain_value(gain: ShiftedGain, shift: Bits, to: Exponent) -> f64 {
        libm::ldexp(Self::angle_gain_value(gain, to), i32::from(shift))
    }

    fn angle_gain_value(gain: ShiftedGain, to: Exponent) -> f64 {
        gain.ratio() * to.range() / core::f64::consts::PI
    }

    fn gain_value(gain: ShiftedGain, from: Exponent, to: Exponent) -> f64 {
        gain.ratio() * to.range() / from.range()
    }

    fn alpha(value: f64) -> i32 {
        libm::rint(value * 2_147_483_648.0) as i32
    }

    fn alpha_value(alpha: i32) -> f64 {
        f64::from(alpha) / 2_147_483_648.0
    }

    fn shift(a: Exponent, b: Exponent, to: Exponent) -> Bits {
        let up = i32::from(a.0) + i32::from(b.0) + 1 - i32::from(to.0);
        Bits::at_most(up.clamp(0, 31) as u8)
    }
}

impl TableScalar for Fixed {
    type ColumnScale = ColumnScale;
    type Reciprocal = Reciprocal;

    #[inline]
    fn column_scale(scaling: i8, format: Exponent) -> Option<ColumnScale> {
        let net = 31 - i32::from(format.0) - i32::from(scaling);
        // Values are up to 2^30 units of the table.
        (net <= 0).then_some(ColumnScale {
            down: Bits::at_most((-net).clamp(2, 31) as u8),
            up: Bits::at_most((net + 2).clamp(0, 31) as u8),
            angle: false,
        })
    }

    #[inline]
    fn angle_column_scale(scaling: i8) -> Option<ColumnScale> {
        Self::angle_term_scale(scaling, scaling)
    }

    #[inline]
    fn angle_term_scale(scaling: i8, common: i8) -> Option<ColumnScale> {
        // Values are up to 2^30 units of the table, a third of that in half turns.
        let net = 31 - i32::from(common);
        let more = i32::from(scaling) - i32::from(common);
        (net <= 31).then_some(ColumnScale {
            down: Bits::at_most((more - net.min(0)).clamp(0, 31) as u8),
            up: Bits::at_most(net.clamp(0, 31) as u8),
            angle: true,
        })
    }

    #[inline]
    fn control_point(raw: i32, column_scale: ColumnScale) -> Self {
        if column_scale.angle {
            // Up to 2^30 / pi.
            const PER_PI: i32 = Constant::new(2.0 * core::f64::consts::FRAC_1_PI, 0).bits;
            return of(high_product(raw, PER_PI) >> column_scale.down.count());
        }
        // To nearest.
        of((raw.wrapping_shr(column_scale.down.count() - 1) + 1) >> 1)
    }

    #[inline]
    fn from_spline(value: Self, column_scale: ColumnScale) -> Self {
        of(bits(value).wrapping_shl(column_scale.up.count()))
    }

    #[inline]
    fn reciprocal_of(value: u32) -> Reciprocal {
        let value = value.clamp(1, 1 << 24);
        let up = value.leading_zeros() - 1;
        let value = value << up;
        // 2^61 / value. Fifteen bits by a short division, which cores have or which is
        // cheap; the others by Newton's method, which from below stays below.
        let guess = (1 << 31) / ((value >> 15) + 1);
        let rest = (1 << 46) - u64::from(value) * u64::from(guess);
        let mantissa = (guess << 15) + ((u64::from(guess) * rest) >> 31) as u32;
        Reciprocal {
            // A unit less, so that a fraction is below 1.
            mantissa: (mantissa - 1).cast_signed(),
            up: up as u8,
        }
    }

    #[inline]
    fn fraction(part: u32, reciprocal: Reciprocal) -> Self {
        let part = part.wrapping_shl(reciprocal.up.into()).cast_signed();
        of(high_product(part, reciprocal.mantissa).wrapping_shl(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_sine_is_within_its_bound_for_every_angle() {
        let all = (0..2_000_003_i64).map(|i| (i * 4_294_967_296 / 2_000_003 - (1 << 31)) as i32);
        let edges = [i32::MIN, i32::MAX, 0, -1, 1 << 30, -(1 << 30)];
        for angle in all.chain(
            edges
                .iter()
                .flat_map(|e| (-3..=3).map(|d| e.wrapping_add(d))),
        ) {
            let sine = of(angle).sine().to_si(Fixed::SINE);
            let error = sine - libm::sin(of(angle).to_rad());
            assert!(error.abs() <= 3e-8, "{angle}: {error:e}");
        }
    }

    #[test]
    fn angles_lose_whole_turns_alone() {
        for turns in -3..=3 {
            for angle in [-3.1, -1.5, 0.0, 0.3, 1.57, 3.1] {
                let wound = angle + f64::from(turns) * core::f64::consts::TAU;
                assert!((Fixed::from_rad(wound).to_rad() - angle).abs() < 2e-9);
            }
        }
    }

    #[test]
    fn exponents_hold_their_magnitude_and_no_more_than_needed() {
        for (magnitude, exponent) in [(0.3, -1), (0.5, 0), (0.99, 0), (1.0, 1), (11.0, 4)] {
            assert_eq!(Exponent::holding(magnitude), Exponent(exponent));
        }
        assert_eq!(Exponent::holding(f64::NAN), Exponent(60));
    }

    #[test]
    fn fractions_are_below_one_and_exact_to_2_to_the_minus_27() {
        for whole in (1..5000).chain([
            9999,
            32_767,
            65_535,
            65_537,
            9_999_999,
            (1 << 24) - 1,
            1 << 24,
        ]) {
            let reciprocal = Fixed::reciprocal_of(whole);
            for part in [0, 1, whole / 3, whole / 2, whole - 1, whole] {
                let is = Fixed::fraction(part, reciprocal).to_si(Exponent(0));
                let should = f64::from(part) / f64::from(whole);
                assert!((is - should).abs() < 7.4e-9 && is < 1.0, "{part}/{whole}");
            }
        }
    }

    #[test]
    fn a_sum_forgets_nothing_in_ten_million_ticks() {
        // A constant, an alternating and a tiny signal: what 32 bits would have lost.
        for signal in [[123_456, 123_456], [-7, 8], [3, 3]] {
            let alpha = Fixed::alpha(4e-4);
            let mut sum = of(0).sum();
            let mut count = 0;
            for tick in 0..10_000_000_usize {
                let more = of(signal[tick % 2]).times_alpha(alpha);
                sum = Fixed::accumulated(sum, more, &mut count);
            }
            let added = i64::from(signal[0]) + i64::from(signal[1]);
            assert_eq!(sum, added * 5_000_000 * i64::from(alpha));
            assert_eq!(count, 0);
        }
    }

    proptest! {
        #[test]
        fn products_of_halves_are_those_of_whole_words(a: i32, b: i32) {
            let exact = i64::from(a) * i64::from(b);
            prop_assert_eq!(high_product(a, b), (exact >> 32) as i32);
            prop_assert_eq!(high_product_of_halves(a, b), (exact >> 32) as i32);
            prop_assert_eq!(product(a, b), exact);
        }

        #[test]
        fn saturating_operations_are_the_clamped_exact_ones_and_count(a: i32, b: i32, up in 0..20_u8) {
            let (x, y) = (of(a), of(b));
            let check = |result: Fixed, exact: i64, count: u32| {
                let clamped = exact.clamp(i32::MIN.into(), i32::MAX.into());
                (i64::from(bits(result)), count) == (clamped, u32::from(clamped != exact))
            };
            let mut count = 0;
            let sum = x.plus(y, &mut count);
            prop_assert!(check(sum, i64::from(a) + i64::from(b), count));
            count = 0;
            let difference = x.minus(y, &mut count);
            prop_assert!(check(difference, i64::from(a) - i64::from(b), count));
            count = 0;
            let times = x.times(y, Bits::at_most(up), &mut count);
            let high = (i64::from(a) * i64::from(b)) >> 32;
            prop_assert!(check(times, high << up, count));
        }

        #[test]
        fn gains_are_exact_to_their_last_bit(value in -1e4..1e4_f64, from in -8..8_i8, to in -8..8_i8) {
            let (from, to) = (Exponent(from), Exponent(to));
            let gain = Fixed::gain(value, from, to);
            let is = Fixed::gain_value(gain, from, to);
            let unit = libm::ldexp(1.0, i32::from(gain.up()) - 32) * to.range() / from.range();
            prop_assert!((is - value).abs() <= 0.5 * unit);
            prop_assert!((is - value).abs() <= 1e-8 * value.abs() || gain.up() == 0);
        }

        #[test]
        fn saturation_is_monotone(a: i32, b: i32, c: i32, up in 0..20_u8) {
            let (low, high) = (of(a.min(b)), of(a.max(b)));
            let c = of(c);
            let mut count = 0;
            prop_assert!(low.plus(c, &mut count) <= high.plus(c, &mut count));
            prop_assert!(low.minus(c, &mut count) <= high.minus(c, &mut count));
            let c = of(bits(c).saturating_abs());
            let up = Bits::at_most(up);
            prop_assert!(low.times(c, up, &mut count) <= high.times(c, up, &mut count));
        }
    }
}
