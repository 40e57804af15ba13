//! The arm: its physical data, its kinematics (eq. 12-13) and its fingerprint.
//!
//! Because the elastic deflection is measured from the chord of link 2, the tip
//! obeys rigid two-link kinematics whatever the elastic state (see the crate's
//! conventions): `x = r1 e(theta10) + r2 e(theta20)` with `e(a) = (cos a, sin a)`.
//!
//! Glossary: *elbow* is joint 2; it is *down* when `theta10 > theta20` (link 1
//! hangs below the line to the tip, stable under gravity) and *up* otherwise (an
//! inverted pendulum). *Chord* is the straight line from joint 2 to the tip.

use crate::CRC32;
use crate::number::Real;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Which of the two inverse-kinematics solutions the arm uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Elbow {
    /// `theta10 > theta20`: sin(theta21) < 0.
    Down,
    /// `theta10 < theta20`: sin(theta21) > 0.
    Up,
}

/// Physical data of the arm, in f64 SI units: what `arm.toml` says.
///
/// ```
/// use flexor::model::ArmParameters;
///
/// let heavier = ArmParameters { tip_mass_kg: 0.1, ..ArmParameters::PAPER };
/// // Another arm: tables that were planned for the paper's do not fit it.
/// assert_ne!(heavier.fingerprint(), ArmParameters::PAPER.fingerprint());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArmParameters {
    /// Length r1 of link 1, joint 1 to joint 2, m.
    pub link1_length_m: f64,
    /// Mass of link 1, a uniform rigid rod, kg.
    pub link1_mass_kg: f64,
    /// Length r2 of link 2's chord, joint 2 to tip, m.
    pub link2_length_m: f64,
    /// Mass of link 2, a uniform elastic beam, kg.
    pub link2_mass_kg: f64,
    /// Bending stiffness EI of link 2, N m^2.
    pub bending_stiffness_nm2: f64,
    /// Damping ratio of every elastic mode of link 2.
    pub damping_ratio: f64,
    /// Inertia that turns with link 2's root tangent (hub and rotor), kg m^2.
    pub root_inertia_kgm2: f64,
    /// Point mass at the tip, kg.
    pub tip_mass_kg: f64,
    /// Inertia of the tip body about the tip, turning with the tip's tangent, kg m^2.
    pub tip_inertia_kgm2: f64,
    /// Gravity in the inertial axes (a1, a2), m/s^2; a2 points down.
    pub gravity_m_s2: [f64; 2],
    /// The inverse-kinematics solution in use.
    pub elbow: Elbow,
}

impl ArmParameters {
    /// The paper's arm (Table 1), elbow down.
    pub const PAPER: Self = Self {
        link1_length_m: 0.5,
        link1_mass_kg: 8.0,
        link2_length_m: 0.55,
        link2_mass_kg: 0.24,
        bending_stiffness_nm2: 0.48,
        damping_ratio: 0.05,
        root_inertia_kgm2: 0.0,
        tip_mass_kg: 0.0,
        tip_inertia_kgm2: 0.0,
        gravity_m_s2: [0.0, 9.81],
        elbow: Elbow::Down,
    };

    /// Moment at link 2's root per slope there, 3 EI / r2, N m/rad, of a cantilever that a force
    /// at its tip bends: the scale between a root gauge's moment and its equivalent slope.
    pub const fn moment_per_root_slope(&self) -> f64 {
        3.0 * self.bending_stiffness_nm2 / self.link2_length_m
    }

    /// [`fingerprint`] of the physical data in the order of the fields, without the elbow (a
    /// posture, not a part).
    ///
    /// A table carries the fingerprint of the arm it was planned for; a controller
    /// refuses a table with another arm's.
    pub fn fingerprint(&self) -> u32 {
        let values = [
            self.link1_length_m,
            self.link1_mass_kg,
            self.link2_length_m,
            self.link2_mass_kg,
            self.bending_stiffness_nm2,
            self.damping_ratio,
            self.root_inertia_kgm2,
            self.tip_mass_kg,
            self.tip_inertia_kgm2,
            self.gravity_m_s2[0],
            self.gravity_m_s2[1],
        ];
        fingerprint("flexor arm 1", &values)
    }
}

/// CRC-32 (ISO-HDLC) over a tag that says what the values are, and the values as little-endian
/// f64. It tells by mistake alike things apart, not by intent.
pub fn fingerprint(tag: &str, values: &[f64]) -> u32 {
    let mut digest = CRC32.digest();
    digest.update(tag.as_bytes());
    for value in values {
        // -0.0 and 0.0 are the same.
        digest.update(&(value + 0.0).to_le_bytes());
    }
    digest.finalize()
}

/// Why a tip position has no usable joint angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum KinematicsError {
    /// The point is farther from joint 1 than the stretched arm or nearer than the
    /// folded one.
    Unreachable {
        /// Distance of the point from joint 1, m.
        distance_m: f64,
        /// Nearest and farthest distance that the arm reaches, m.
        reach_m: [f64; 2],
    },
    /// The arm is stretched or folded there to within [`SINGULARITY_MARGIN`]: joint
    /// rates are unbounded and the elbow could flip.
    Singular {
        /// |sin(theta21)| at the point.
        sine_of_elbow: f64,
    },
}

impl fmt::Display for KinematicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreachable {
                distance_m,
                reach_m,
            } => write!(
                f,
                "unreachable: {distance_m:.6} m from joint 1, the arm reaches {:.6} to {:.6} m",
                reach_m[0], reach_m[1]
            ),
            Self::Singular { sine_of_elbow } => write!(
                f,
                "singular: the arm is stretched or folded (|sin theta21| = {sine_of_elbow:.2e}, at least {SINGULARITY_MARGIN} is needed) and its elbow could flip"
            ),
        }
    }
}

impl core::error::Error for KinematicsError {}

/// Smallest |sin(theta21)| that [`Kinematics::inverse`] accepts. At 0.01 the tip's
/// speed is magnified a hundredfold in the joints and 1 mm of path error is 2 mm
/// from the reach's edge for arms of half a metre.
pub const SINGULARITY_MARGIN: f64 = 0.01;

/// Angles of the two links and their first two time derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointMotion<T> {
    /// (theta10, theta20), rad.
    pub angle: [T; 2],
    /// Their rates, rad/s.
    pub rate: [T; 2],
    /// Their accelerations, rad/s^2.
    pub acceleration: [T; 2],
}

/// Two-link kinematics (eq. 12-13).
///
/// ```
/// use flexor::model::{ArmParameters, Kinematics};
///
/// let arm = ArmParameters::PAPER;
/// let kinematics = Kinematics::<f64>::new(&arm);
/// // Where the paper's path begins, m from joint 1: to the right, and down.
/// let angle = kinematics.inverse([0.7, 0.05], arm.elbow)?;
/// let tip = kinematics.forward(angle);
/// assert!((tip[0] - 0.7).abs() < 1e-12 && (tip[1] - 0.05).abs() < 1e-12);
/// // The arm is 1.05 m long.
/// assert!(kinematics.inverse([1.2, 0.0], arm.elbow).is_err());
/// # Ok::<(), flexor::model::KinematicsError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics<T> {
    /// Length r1 of link 1, m.
    pub link1_length: T,
    /// Length r2 of link 2's chord, m.
    pub link2_length: T,
}

impl<T: Real> Kinematics<T> {
    /// The kinematics of `arm`.
    pub fn new(arm: &ArmParameters) -> Self {
        Self {
            link1_length: T::from_f64(arm.link1_length_m),
            link2_length: T::from_f64(arm.link2_length_m),
        }
    }

    /// Tip position (x1, x2), m, for the angles (theta10, theta20), rad (eq. 12).
    pub fn forward(&self, angle: [T; 2]) -> [T; 2] {
        [
            self.link1_length * angle[0].cos() + self.link2_length * angle[1].cos(),
            self.link1_length * angle[0].sin() + self.link2_length * angle[1].sin(),
        ]
    }

    /// Jacobian d(x1, x2)/d(theta10, theta20), row by row, m/rad.
    pub fn jacobian(&self, angle: [T; 2]) -> [[T; 2]; 2] {
        let (r1, r2) = (self.link1_length, self.link2_length);
        [
            [-r1 * angle[0].sin(), -r2 * angle[1].sin()],
            [r1 * angle[0].cos(), r2 * angle[1].cos()],
        ]
    }

    /// Angles (theta10, theta20), rad, that put the tip at `tip` (m) with the given
    /// elbow (eq. 13). theta10 - theta20 lies in (-pi, pi); neither angle is
    /// brought to a principal range.
    ///
    /// # Errors
    /// [`KinematicsError`] where the arm does not reach or is singular.
    pub fn inverse(&self, tip: [T; 2], elbow: Elbow) -> Result<[T; 2], KinematicsError> {
        let (r1, r2) = (self.link1_length, self.link2_length);
        let square = tip[0] * tip[0] + tip[1] * tip[1];
        let two = T::ONE + T::ONE;
        let cosine = (square - r1 * r1 - r2 * r2) / (two * r1 * r2);
        let sine_squared = T::ONE - cosine * cosine;
        if !(sine_squared >= T::ZERO) {
            return Err(KinematicsError::Unreachable {
                distance_m: square.sqrt().to_f64(),
                reach_m: [(r1 - r2).magnitude().to_f64(), (r1 + r2).to_f64()],
            });
        }
        let sine = sine_squared.sqrt();
        if sine < T::from_f64(SINGULARITY_MARGIN) {
            return Err(KinematicsError::Singular {
                sine_of_elbow: sine.to_f64(),
            });
        }
        let sine = match elbow {
            Elbow::Down => -sine,
            Elbow::Up => sine,
        };
        let theta10 = tip[1].atan2(tip[0]) - (r2 * sine).atan2(r1 + r2 * cosine);
        Ok([theta10, theta10 + sine.atan2(cosine)])
    }

    /// Joint motion that gives the tip the position `tip`, `velocity` and
    /// `acceleration` (m, m/s, m/s^2; eq. 13 and its two derivatives).
    ///
    /// # Errors
    /// As [`inverse`](Self::inverse).
    pub fn inverse_motion(
        &self,
        tip: [T; 2],
        velocity: [T; 2],
        acceleration: [T; 2],
        elbow: Elbow,
    ) -> Result<JointMotion<T>, KinematicsError> {
        let angle = self.inverse(tip, elbow)?;
        let e1 = [angle[0].cos(), angle[0].sin()];
        let e2 = [angle[1].cos(), angle[1].sin()];
        let (r1, r2) = (self.link1_length, self.link2_length);
        let sine = e1[0] * e2[1] - e1[1] * e2[0]; // sin(theta21)
        // J (d1, d2) = v, solved with e2 . n1 = sin(theta21) = -e1 . n2.
        let solve = |v: [T; 2]| {
            [
                (v[0] * e2[0] + v[1] * e2[1]) / (r1 * sine),
                -(v[0] * e1[0] + v[1] * e1[1]) / (r2 * sine),
            ]
        };
        let rate = solve(velocity);
        let centripetal = [r1 * rate[0] * rate[0], r2 * rate[1] * rate[1]];
        let acceleration = solve([
            acceleration[0] + centripetal[0] * e1[0] + centripetal[1] * e2[0],
            acceleration[1] + centripetal[0] * e1[1] + centripetal[1] * e2[1],
        ]);
        Ok(JointMotion {
            angle,
            rate,
            acceleration,
        })
    }

    /// Position, velocity and acceleration of the tip (m, m/s, m/s^2, inertial axes) with the joint
    /// motion `joint`: eq. 12 and its two derivatives.
    pub fn forward_motion(&self, joint: &JointMotion<T>) -> [[T; 2]; 3] {
        let jacobian = self.jacobian(joint.angle);
        let by = |rate: [T; 2]| jacobian.map(|row| row[0] * rate[0] + row[1] * rate[1]);
        let [first, second] = joint.rate.map(|rate| rate * rate);
        let (sum, [e1, e2]) = (
            by(joint.acceleration),
            joint.angle.map(|angle| [angle.cos(), angle.sin()]),
        );
        let (r1, r2) = (self.link1_length, self.link2_length);
        [
            self.forward(joint.angle),
            by(joint.rate),
            [0, 1].map(|i| sum[i] - r1 * first * e1[i] - r2 * second * e2[i]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ARM: Kinematics<f64> = Kinematics {
        link1_length: 0.5,
        link2_length: 0.55,
    };

    #[test]
    fn the_papers_start_has_the_reference_angles() {
        let down = ARM.inverse([0.7, 0.05], Elbow::Down).unwrap();
        assert!((down[0] - 0.964_440_896).abs() < 1e-9);
        assert!((down[1] + 0.715_663_886).abs() < 1e-9);
        let up = ARM.inverse([0.7, 0.05], Elbow::Up).unwrap();
        assert!((up[0] + 0.821_825_966).abs() < 1e-9);
        assert!((up[1] - 0.858_278_815).abs() < 1e-9);
    }

    #[test]
    fn points_out_of_reach_and_singular_points_are_refused() {
        assert!(matches!(
            ARM.inverse([1.2, 0.0], Elbow::Up),
            Err(KinematicsError::Unreachable { .. })
        ));
        assert!(matches!(
            ARM.inverse([0.01, 0.0], Elbow::Up),
            Err(KinematicsError::Unreachable { .. })
        ));
        assert!(matches!(
            ARM.inverse([1.05 - 1e-9, 0.0], Elbow::Down),
            Err(KinematicsError::Singular { .. })
        ));
        assert!(ARM.inverse([f64::NAN, 0.0], Elbow::Down).is_err());
    }

    proptest! {
        #[test]
        fn inverse_undoes_forward(theta10 in -3.0..3.0_f64, elbow in 0.02..3.1_f64, down: bool) {
            let theta20 = if down { theta10 - elbow } else { theta10 + elbow };
            let tip = ARM.forward([theta10, theta20]);
            let side = if down { Elbow::Down } else { Elbow::Up };
            let found = ARM.inverse(tip, side).unwrap();
            for (a, b) in found.into_iter().zip([theta10, theta20]) {
                let turn = core::f64::consts::TAU;
                let difference = (a - b) - turn * libm::round((a - b) / turn);
                // The elbow's cosine is flat where the arm stretches: errors grow as 1/sin.
                prop_assert!(difference.abs() < 1e-12 / libm::sin(elbow).abs());
            }
        }

        #[test]
        fn motion_agrees_with_the_jacobian_and_differences(
            x in 0.3..0.7_f64, y in -0.3..0.3_f64,
            vx in -1.0..1.0_f64, vy in -1.0..1.0_f64, ax in -5.0..5.0_f64, ay in -5.0..5.0_f64,
        ) {
            let at = |t: f64| ARM.inverse(
                [x + vx * t + 0.5 * ax * t * t, y + vy * t + 0.5 * ay * t * t], Elbow::Down).unwrap();
            let m = ARM.inverse_motion([x, y], [vx, vy], [ax, ay], Elbow::Down).unwrap();
            let j = ARM.jacobian(m.angle);
            prop_assert!((j[0][0] * m.rate[0] + j[0][1] * m.rate[1] - vx).abs() < 1e-12);
            prop_assert!((j[1][0] * m.rate[0] + j[1][1] * m.rate[1] - vy).abs() < 1e-12);
            // And back.
            let back = ARM.forward_motion(&m);
            for (found, given) in back.into_iter().flatten().zip([x, y, vx, vy, ax, ay]) {
                prop_assert!((found - given).abs() < 1e-11);
            }
            let h = 1e-4;
            for i in 0..2 {
                let second = (at(h)[i] - 2.0 * at(0.0)[i] + at(-h)[i]) / (h * h);
                prop_assert!((second - m.acceleration[i]).abs() < 1e-3 * (1.0 + second.abs()));
            }
        }
    }

    #[test]
    fn the_fingerprint_tells_arms_apart_and_ignores_posture() {
        let arm = ArmParameters::PAPER;
        let mut other = arm;
        other.elbow = Elbow::Up;
        other.root_inertia_kgm2 = -0.0;
        assert_eq!(arm.fingerprint(), other.fingerprint());
        other.link2_mass_kg = 0.2400000001;
        assert_ne!(arm.fingerprint(), other.fingerprint());
    }
}
