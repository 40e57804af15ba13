//! Where the tip or the joints shall be: a straight line of either, travelled from rest to rest.

use flexor::model::JointMotion;

/// Rest-to-rest profiles `s(x)`, `x` and `s` from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Profile {
    /// The paper's polynomial of degree 11, whose first five derivatives vanish at
    /// both ends.
    Poly11,
}

impl Profile {
    /// `s` and its first two derivatives at `x`, brought into [0, 1].
    pub fn at(self, x: f64) -> [f64; 3] {
        let x = x.clamp(0.0, 1.0);
        match self {
            Self::Poly11 => {
                /// Coefficients of x^6 to x^11.
                const C: [f64; 6] = [462.0, -1980.0, 3465.0, -3080.0, 1386.0, -252.0];
                // The sum of powers and its derivatives lose 4 digits towards x = 1, and
                // fast modes of the elastic link magnify that; so from the nearer end, and
                // the derivatives as 2772 (x (1 - x))^5 and its own.
                let near = x.min(1.0 - x);
                let near2 = near * near;
                let rising =
                    C.iter().rev().fold(0.0, |sum, c| sum * near + c) * (near2 * (near2 * near2));
                let both = x * (1.0 - x);
                let both2 = both * both;
                let both4 = both2 * both2;
                [
                    if x <= 0.5 { rising } else { 1.0 - rising },
                    2772.0 * (both * both4),
                    13860.0 * both4 * (1.0 - 2.0 * x),
                ]
            }
        }
    }
}

/// Position, velocity and acceleration of the tip, m, m/s, m/s^2, inertial axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TipMotion {
    /// Position.
    pub position: [f64; 2],
    /// Velocity.
    pub velocity: [f64; 2],
    /// Acceleration.
    pub acceleration: [f64; 2],
}

/// A straight line travelled in a given time, at rest before and after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinePath {
    /// Start, m.
    pub from: [f64; 2],
    /// End, m.
    pub to: [f64; 2],
    /// Time from start to end, s.
    pub duration: f64,
    /// How progress along it grows.
    pub profile: Profile,
}

impl LinePath {
    /// The tip's motion at time `t`, s after the start; at rest outside the duration.
    pub fn at(&self, t: f64) -> TipMotion {
        let [s, ds, dds] = self.profile.at(t / self.duration);
        let displacement = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        TipMotion {
            position: [
                self.from[0] + displacement[0] * s,
                self.from[1] + displacement[1] * s,
            ],
            velocity: displacement.map(|w| w * ds / self.duration),
            acceleration: displacement.map(|w| w * dds / (self.duration * self.duration)),
        }
    }

    /// Length of the line, m.
    pub fn length(&self) -> f64 {
        libm::hypot(self.to[0] - self.from[0], self.to[1] - self.from[1])
    }

    /// Its direction from start to end, a unit vector, inertial axes.
    pub fn direction(&self) -> [f64; 2] {
        let length = self.length();
        [0, 1].map(|i| (self.to[i] - self.from[i]) / length)
    }

    /// The point at a progress from 0 to 1, m.
    pub fn point(&self, progress: f64) -> [f64; 2] {
        [0, 1].map(|i| self.from[i] + progress * (self.to[i] - self.from[i]))
    }

    /// Progress, 0 to 1, at which the line is nearest to the origin (joint 1).
    pub fn nearest_progress(&self) -> f64 {
        let displacement = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let along = -(self.from[0] * displacement[0] + self.from[1] * displacement[1]);
        (along / (displacement[0] * displacement[0] + displacement[1] * displacement[1]))
            .clamp(0.0, 1.0)
    }

    /// Time, s, at which the given progress, 0 to 1, is reached.
    pub fn time_at_progress(&self, progress: f64) -> f64 {
        if progress <= 0.0 {
            return 0.0;
        }
        if progress >= 1.0 {
            return self.duration;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.profile.at(middle)[0] < progress {
                low = middle;
            } else {
                high = middle;
            }
        }
        high * self.duration
    }
}

/// The joints' way of a move through the air: each straight to its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointWay {
    /// Links' angles (theta10, theta20) at both ends, rad.
    pub ends: [[f64; 2]; 2],
}

impl JointWay {
    /// The joints' motion at `progress` and its first two derivatives, 1/s and 1/s^2.
    pub fn at(&self, [s, rate, acceleration]: [f64; 3]) -> JointMotion<f64> {
        let [from, to] = self.ends;
        let way = [to[0] - from[0], to[1] - from[1]];
        JointMotion {
            angle: [0, 1].map(|i| from[i] + way[i] * s),
            rate: way.map(|way| way * rate),
            acceleration: way.map(|way| way * acceleration),
        }
    }

    /// Whether nothing moves, to rounding.
    pub(super) fn is_point(&self) -> bool {
        /// Least angle that counts, rad.
        const LEAST_RAD: f64 = 1e-9;
        let [from, to] = self.ends;
        (0..2).all(|i| (to[i] - from[i]).abs() <= LEAST_RAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_profile_starts_and_ends_at_rest() {
        assert_eq!(Profile::Poly11.at(0.0), [0.0, 0.0, 0.0]);
        let [s, ds, dds] = Profile::Poly11.at(1.0);
        assert_eq!([s, ds, dds], [1.0, 0.0, 0.0]);
        assert_eq!(Profile::Poly11.at(-3.0), [0.0, 0.0, 0.0]);
    }

    proptest! {
        #[test]
        fn derivatives_are_derivatives_and_the_profile_is_symmetric(x in 0.01..0.99_f64) {
            let h = 1e-5;
            let at = |x| Profile::Poly11.at(x);
            prop_assert!(((at(x + h)[0] - at(x - h)[0]) / (2.0 * h) - at(x)[1]).abs() < 1e-7);
            prop_assert!(((at(x + h)[1] - at(x - h)[1]) / (2.0 * h) - at(x)[2]).abs() < 1e-6);
            prop_assert!((at(x)[0] + at(1.0 - x)[0] - 1.0).abs() < 1e-11);
        }

        #[test]
        fn times_and_progress_belong_together(progress in 0.001..0.999_f64) {
            let line = LinePath { from: [0.7, 0.05], to: [0.2, 0.05], duration: 2.0, profile: Profile::Poly11 };
            let t = line.time_at_progress(progress);
            prop_assert!((line.at(t).position[0] - (0.7 - 0.5 * progress)).abs() < 1e-12);
        }
    }
}
