//! The last gate before the drives: torque-rate limit, torque limit, finite check.
//!
//! Whatever comes in, the torques that leave are finite and within the limits. A
//! limit in action is reported as [`Saturation`] so that the integrator upstream can
//! stop; an undefined torque is a [`Fault`], latched by the controller.

use crate::fault::Fault;
use crate::number::{Scalar, SiScalar};
use crate::signals::Saturation;
use serde::{Deserialize, Serialize};

/// Limits per joint, f64 SI.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LimitParameters {
    /// Largest torque magnitude, N m.
    pub torque_nm: [f64; 2],
    /// Largest torque rate magnitude, N m/s.
    pub torque_rate_nm_s: [f64; 2],
}

impl LimitParameters {
    /// These limits, the torques no larger than `torque_nm`: what the drives can give. The
    /// law then learns of every limit from the limiter, and its integral does not wind up
    /// against one that it cannot see.
    #[must_use]
    pub fn at_most(&self, torque_nm: [f64; 2]) -> Self {
        Self {
            torque_nm: [0, 1].map(|i| self.torque_nm[i].min(torque_nm[i])),
            ..*self
        }
    }
}

/// The limits in the tick's number type.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct TorqueLimiter<T: Scalar> {
    torque: [T; 2],
    step: [T; 2],
}

impl<T: SiScalar<Format = ()>> TorqueLimiter<T> {
    /// The limits at `tick_rate_hz`, in floating point.
    pub fn new(limits: &LimitParameters, tick_rate_hz: u32) -> Self {
        Self::in_formats(limits, tick_rate_hz, [(); 2])
    }
}

impl<T: SiScalar> TorqueLimiter<T> {
    /// The limits at `tick_rate_hz`, for torques of the given formats. Limits beyond a
    /// format's range are at its end; one that is negative or NaN is 0.
    pub fn in_formats(limits: &LimitParameters, tick_rate_hz: u32, torque: [T::Format; 2]) -> Self {
        let rate = f64::from(tick_rate_hz);
        let limit = |si: f64, format| T::from_si(if si > 0.0 { si } else { 0.0 }, format);
        Self {
            torque: [0, 1].map(|i| limit(limits.torque_nm[i], torque[i])),
            step: [0, 1].map(|i| limit(limits.torque_rate_nm_s[i] / rate, torque[i])),
        }
    }
}

impl<T: Scalar> TorqueLimiter<T> {
    /// True when [`limit`](Self::limit) would leave `wanted` as it is, short of the limits
    /// themselves: a few comparisons, which nothing passes that is not finite.
    #[inline]
    pub fn permits(&self, previous: [T; 2], wanted: [T; 2]) -> bool {
        (0..2).all(|joint| {
            let step = wanted[joint].minus(previous[joint], &mut T::SaturationCount::default());
            wanted[joint].is_within(self.torque[joint]) && step.is_within(self.step[joint])
        })
    }

    /// Brings `wanted` within the rate limit around `previous` (where there is one)
    /// and the torque limit. Says for each joint how it was limited.
    ///
    /// # Errors
    /// [`Fault::TorqueNotFinite`] if the result is not finite; no torque must be
    /// given then.
    #[inline]
    pub fn limit(
        &self,
        previous: Option<[T; 2]>,
        wanted: [T; 2],
    ) -> Result<([T; 2], [Saturation; 2]), Fault> {
        let mut given = wanted;
        let mut saturation = [Saturation::None; 2];
        for joint in 0..2 {
            let (mut low, mut high) = (self.torque[joint].negative(), self.torque[joint]);
            if let Some(previous) = previous {
                // The previous torque was within its limit, so low stays below high.
                // A sum that saturates lies beyond the torque limit, so it need not be counted.
                let step = self.step[joint];
                let count = &mut T::SaturationCount::default();
                low = low.larger(previous[joint].minus(step, count));
                high = high.smaller(previous[joint].plus(step, count));
            }
            if wanted[joint] < low {
                (given[joint], saturation[joint]) = (low, Saturation::Lower);
            } else if wanted[joint] > high {
                (given[joint], saturation[joint]) = (high, Saturation::Upper);
            }
        }
        if T::all_finite(given) {
            Ok((given, saturation))
        } else {
            Err(Fault::TorqueNotFinite)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn limiter() -> TorqueLimiter<f32> {
        let limits = LimitParameters {
            torque_nm: [20.0, 2.0],
            torque_rate_nm_s: [1000.0, 500.0],
        };
        TorqueLimiter::new(&limits, 1000)
    }

    #[test]
    fn limits_are_reported_on_their_side() {
        let (torque, saturation) = limiter().limit(None, [25.0, -3.0]).unwrap();
        assert_eq!(torque, [20.0, -2.0]);
        assert_eq!(saturation, [Saturation::Upper, Saturation::Lower]);
        let (torque, saturation) = limiter().limit(Some([0.0, 0.0]), [0.5, 0.7]).unwrap();
        assert_eq!(torque, [0.5, 0.5]);
        assert_eq!(saturation, [Saturation::None, Saturation::Upper]);
    }

    #[test]
    fn a_limit_that_is_none_lets_no_torque_pass() {
        for none in [-1.0, f64::NAN, f64::NEG_INFINITY, -0.0] {
            let limits = LimitParameters {
                torque_nm: [none; 2],
                torque_rate_nm_s: [1e3; 2],
            };
            let limiter = TorqueLimiter::<f32>::new(&limits, 1000);
            assert!(!limiter.permits([0.0; 2], [0.1, -0.1]));
            assert_eq!(limiter.limit(None, [0.1, -0.1]).unwrap().0, [0.0; 2]);
            let limits = LimitParameters {
                torque_nm: [20.0; 2],
                torque_rate_nm_s: [none; 2],
            };
            let limiter = TorqueLimiter::<f32>::new(&limits, 1000);
            let (torque, _) = limiter.limit(Some([1.0; 2]), [5.0, -5.0]).unwrap();
            assert_eq!(torque, [1.0; 2]);
        }
    }

    #[test]
    fn the_drives_limits_are_the_narrower_ones_only() {
        let limits = LimitParameters {
            torque_nm: [20.0, 2.0],
            torque_rate_nm_s: [1e3, 1e2],
        };
        let narrow = limits.at_most([35.0, 1.5]);
        assert_eq!(narrow.torque_nm, [20.0, 1.5]);
        assert_eq!(narrow.torque_rate_nm_s, limits.torque_rate_nm_s);
    }

    proptest! {
        #[test]
        fn whatever_leaves_is_finite_and_within_limits(
            a: f32, b: f32, p in -20.0..20.0_f32, q in -2.0..2.0_f32,
        ) {
            match limiter().limit(Some([p, q]), [a, b]) {
                Ok((torque, _)) => {
                    prop_assert!(torque[0].abs() <= 20.0 && torque[1].abs() <= 2.0);
                    prop_assert!((torque[0] - p).abs() <= 1.000_01 && (torque[1] - q).abs() <= 0.500_01);
                }
                Err(fault) => {
                    prop_assert_eq!(fault, Fault::TorqueNotFinite);
                    prop_assert!(a.is_nan() || b.is_nan());
                }
            }
        }
    }
}
