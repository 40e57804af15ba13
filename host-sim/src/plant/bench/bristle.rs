//! Dry friction with pre-sliding: the law that surface and joint friction share.
//!
//! A bristle of stiffness `k` deflects by `x`; its force is the friction. With `v` the sliding
//! rate and `g(v) >= 0` the largest force that friction can give,
//!
//! ```text
//! r  = k x / g(v), held within +-1        the share of the friction that is used
//! F  = g(v) r                             against the motion
//! x' = v - alpha(r, v) |v| r              stuck: x' = v, elastic; sliding: x' = 0
//! alpha = (|r| - 1/2) / (1 - 1/2), held within 0 and 1, where x and v have the same sign; 0 elsewhere
//! g(v) = level (1 + excess / (1 + (v / v_s)^2))
//! ```
//!
//! It is Dahl's bristle (1968) in the elasto-plastic form of Dupont, Hayward, Armstrong and
//! Altpeter (IEEE TAC 47, 2002), with the Stribeck curve that Hess and Soom (1990) use for its lack
//! of a transcendental function.
//!
//! **Why not LuGre.** LuGre (Canudas de Wit and others, 1995) is Dahl's bristle with a damper of
//! its own and a Stribeck curve. The curve is here. The damper is not: it makes friction lose its
//! passivity unless it is made to vanish with speed, and it brings a rate `sigma_1 / m` that an
//! explicit step must follow on a root that hardly has inertia. Stuck, the arm rings on the
//! bristle and its own modal damping damps it.
//!
//! **Why elasto-plastic.** Plain Dahl and LuGre creep under any alternating load, however small
//! beside the friction: a controller's noise would let a stuck arm wander off. Below half the
//! breakaway the bristle here is a spring, and what is stuck stays.
//!
//! **Energy.** With `W = k x^2 / 2`, `F v - W' >= 0` for every `x`, `v` and `g`, also where
//! `g` changes with time as the surface's normal force does, because `k` does not: a bristle whose
//! *stiffness* follows the normal force, as in the usual normalised form `mu f z`, makes energy
//! when it is deflected under a low force and let go under a high one.

use crate::plant::bench::lanes::Lanes;

/// A bristle's constants.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bristle<T> {
    /// Stiffness k, force (or torque) a displacement.
    pub(super) stiffness: T,
    /// Breakaway over sliding friction, less 1.
    pub(super) excess: T,
    /// 1 / v_s, the reciprocal of the rate at which half the excess is gone.
    pub(super) slowness: T,
}

impl<T: Lanes> Bristle<T> {
    /// Friction force, against the motion, and the bristle's rate x', for its deflection `x`, a
    /// sliding rate and the friction's `level` (not negative) when sliding fast.
    #[inline]
    pub(super) fn friction(&self, x: T, rate: T, level: T) -> (T, T) {
        // Not zero, so that no friction is 0 / tiny and not 0 / 0.
        let tiny = T::from_f64(f64::MIN_POSITIVE);
        let relative = rate * self.slowness;
        let largest = level * (T::ONE + self.excess / (T::ONE + relative * relative));
        let share = (self.stiffness * x / (largest + tiny)).within(T::ONE);
        let two = T::from_f64(2.0);
        let plastic = (two * share.absolute() - T::ONE)
            .larger(T::ZERO)
            .smaller(T::ONE);
        // Same sign: sliding on; otherwise the bristle is being relieved.
        let on = T::ZERO.below(x * rate);
        let plastic = T::select(on, plastic, T::ZERO);
        (largest * share, rate - plastic * rate.absolute() * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BRISTLE: Bristle<f64> = Bristle {
        stiffness: 50.0,
        excess: 0.4,
        slowness: 100.0,
    };

    /// Friction while `x` is taken along the displacements `path`, in small steps.
    fn along(path: &[f64], level: f64) -> Vec<f64> {
        let (mut x, mut forces) = (0.0, vec![]);
        for step in path {
            let parts = 1000;
            let h = step / f64::from(parts);
            for _ in 0..parts {
                // Rates so low that the Stribeck curve is at its top; time drops out.
                x += BRISTLE.friction(x, 1e-9 * h.signum(), level).1 * h.abs() * 1e9;
            }
            forces.push(BRISTLE.friction(x, 1e-9 * step.signum(), level).0);
        }
        forces
    }

    #[test]
    fn it_is_a_spring_up_to_half_the_breakaway_and_then_slides() {
        let level = 0.05;
        let breakaway = 1.4 * level;
        let half = 0.5 * breakaway / BRISTLE.stiffness;
        let forces = along(&[half, 20.0 * half, -half, half], level);
        assert!((forces[0] - 0.5 * breakaway).abs() < 1e-12);
        assert!((forces[1] - breakaway).abs() < 1e-6 * breakaway);
        // Relieved by half, and back again.
        assert!((forces[2] - 0.5 * breakaway).abs() < 1e-6);
        assert!((forces[3] - breakaway).abs() < 0.2 * breakaway);
    }

    #[test]
    fn the_stribeck_curve_goes_from_breakaway_to_the_level() {
        let at = |rate: f64| BRISTLE.friction(1.0, rate, 0.05).0;
        assert!((at(0.0) - 0.07).abs() < 1e-15);
        assert!((at(0.01) - 0.06).abs() < 1e-15);
        assert!((at(10.0) - 0.05).abs() < 1e-7);
    }

    #[test]
    fn a_stuck_bristle_does_not_creep_under_an_alternating_load() {
        // A displacement that swings within the spring's range for a thousand periods.
        let level = 0.05;
        let swing = 0.2 * 1.4 * level / BRISTLE.stiffness;
        let path: Vec<f64> = (0..2000)
            .map(|i| if i % 2 == 0 { swing } else { -swing })
            .collect();
        assert!(along(&path, level).last().unwrap().abs() < 1e-12);
    }

    proptest! {
        /// F v >= W' for every state, under any friction level.
        #[test]
        fn friction_never_makes_energy(
            x in -1.0..1.0_f64, rate in -10.0..10.0_f64, level in 0.0..2.0_f64,
            small in -12..1_i32,
        ) {
            let x = x * power_of_ten(small);
            let (force, x_rate) = BRISTLE.friction(x, rate, level);
            let stored = BRISTLE.stiffness * x * x_rate;
            let scale = (force * rate).abs() + stored.abs();
            prop_assert!(force * rate - stored >= -1e-14 * scale);
            prop_assert!(force.abs() <= 1.4 * level * (1.0 + 1e-15));
        }
    }

    /// 10^n for an integer.
    fn power_of_ten(n: i32) -> f64 {
        10.0_f64.powi(n)
    }
}
