//! The tick's signals: their formats in fixed point, and counters of their saturations.

use crate::number::SiScalar;
use serde::{Deserialize, Serialize};

/// A format for each kind of signal. In floating point formats are nothing; in fixed point
/// they come from a range analysis on the host. Angles have none: see
/// [`crate::number::Scalar::angle_minus`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Formats<F> {
    /// Torques of joint 1 and joint 2, N m.
    pub torque: [F; 2],
    /// Forces: setpoint, measured, error, integral, correction, N.
    pub force: F,
    /// Root slope, rad.
    pub root_slope: F,
    /// Root slope rates: setpoint, measured, deviation, rad/s.
    pub slope_rate: F,
    /// Moment arms, which make torques of forces, m.
    pub moment_arm: F,
}

/// How often each signal has saturated since the start: it left its format's range and was
/// held at the end of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SaturationCounts<C> {
    /// Force error and filtered force error.
    pub force: C,
    /// The law's integral.
    pub integral: C,
    /// The force that feedback asks for, u of eq. 18.
    pub force_correction: C,
    /// Deviation of the root slope rate.
    pub slope_rate: C,
    /// Deviations of the motors' rates, and the integral of joint 1's, of the hybrid law.
    pub motor: C,
    /// Torques before the limits.
    pub torque: [C; 2],
}

impl SaturationCounts<u32> {
    /// The signals' names and counts.
    pub fn entries(&self) -> [(&'static str, u32); 7] {
        [
            ("force", self.force),
            ("integral", self.integral),
            ("force_correction", self.force_correction),
            ("slope_rate", self.slope_rate),
            ("motor", self.motor),
            ("torque1", self.torque[0]),
            ("torque2", self.torque[1]),
        ]
    }

    /// All of them together; stays at the largest number.
    pub fn total(&self) -> u32 {
        let counts = self.entries().map(|(_, count)| count);
        counts.into_iter().fold(0, u32::saturating_add)
    }
}

/// Columns of a table, in the order of [`Reference::from_columns`].
pub const COLUMNS: usize = 8;

/// What the paper's control law reads of the plan at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint<T> {
    /// Feedforward torques (tau1, tau2) to hold during the tick, N m.
    pub torque: [T; 2],
    /// Contact force along the surface normal, pressing positive, N.
    pub force: T,
    /// Rate of link 2's slope at its root against the chord, rad/s.
    pub root_slope_rate: T,
    /// Direction of the surface normal, from a1 towards a2, rad; a tip that presses
    /// pushes along it. pi/2 is straight down.
    pub normal_angle: T,
}

/// What the hybrid control law reads of the plan at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseSetpoint<T> {
    /// Feedforward torques (tau1, tau2) to hold during the tick, N m.
    pub torque: [T; 2],
    /// Contact force along the surface normal, pressing positive, N.
    pub force: T,
    /// Angles of the motors (m1, m2), rad: `theta10`, and that of link 2's root tangent against
    /// link 1, `theta20 - theta10 + w'(0)`.
    pub motor: [T; 2],
    /// s2: joint 2's torque of a unit force along the surface normal, m.
    pub moment_arm: T,
}

/// The plan's values at one tick, all columns of a table's row: the law's [`Setpoint`] and
/// what enabling, logs and tests want beside it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reference<T> {
    /// Feedforward torques (tau1, tau2) to hold during the tick, N m.
    pub torque: [T; 2],
    /// Contact force along the surface normal, pressing positive, N.
    pub force: T,
    /// Angles (theta10, theta20), rad.
    pub angle: [T; 2],
    /// Slope of link 2 at its root against the chord, w'(0), rad.
    pub root_slope: T,
    /// Its rate, rad/s.
    pub root_slope_rate: T,
    /// Direction of the surface normal, from a1 towards a2, rad; a tip that presses
    /// pushes along it. pi/2 is straight down.
    pub normal_angle: T,
}

impl<T: Copy> Reference<T> {
    /// The reference with the given column values.
    #[inline]
    pub const fn from_columns(columns: [T; COLUMNS]) -> Self {
        let [
            torque1,
            torque2,
            force,
            angle1,
            angle2,
            root_slope,
            root_slope_rate,
            normal_angle,
        ] = columns;
        Self {
            torque: [torque1, torque2],
            force,
            angle: [angle1, angle2],
            root_slope,
            root_slope_rate,
            normal_angle,
        }
    }

    /// The part that the paper's control law reads.
    #[inline]
    pub const fn setpoint(&self) -> Setpoint<T> {
        Setpoint {
            torque: self.torque,
            force: self.force,
            root_slope_rate: self.root_slope_rate,
            normal_angle: self.normal_angle,
        }
    }

    /// The values in the order of the table's columns.
    pub fn columns(&self) -> [T; COLUMNS] {
        [
            self.torque[0],
            self.torque[1],
            self.force,
            self.angle[0],
            self.angle[1],
            self.root_slope,
            self.root_slope_rate,
            self.normal_angle,
        ]
    }
}

/// Whether, and on which side, a torque is being limited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Saturation {
    /// Not at a limit.
    #[default]
    None,
    /// More torque (towards +) was asked for than is given.
    Upper,
    /// Less torque (towards -) was asked for than is given.
    Lower,
}

impl Saturation {
    /// This limit, or the `other` where this one is not active.
    #[inline]
    pub fn or(self, other: Self) -> Self {
        if self == Self::None { other } else { self }
    }
}

/// What the sensors say at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measurement<T> {
    /// Angles (theta10, theta20) of link 1 and of link 2's chord, rad.
    pub angle: [T; 2],
    /// Slope of link 2 at its root against the chord, w'(0), rad.
    pub root_slope: T,
    /// Its rate, rad/s.
    pub root_slope_rate: T,
    /// Contact force along the surface normal, pressing positive, N.
    pub force: T,
    /// Angles of the motors, rad: link 1's, which is theta10, and that of link 2's root tangent
    /// against link 1, theta20 + w'(0) - theta10.
    pub motor: [T; 2],
    /// Bending moment at link 2's root, N m: the drive's torque less what friction and the
    /// inertia at the root take of it.
    pub root_moment: T,
    /// What the two drives report about the torque they could not give.
    pub drive: [Saturation; 2],
}

/// How far what is measured is from the plan, as the law in use sees it: what monitors look at. What
/// a law does not know is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation<T> {
    /// Motors' angles less the planned ones, rad.
    pub angle: [T; 2],
    /// Contact force less the planned one, N; zero where no force is made.
    pub force: T,
    /// Root moment that the law wants less the measured one, N m.
    pub root_moment: T,
    /// Root moment less that of the plan and of the measured force's deviation from it,
    /// `M - tau2_d - s2 (f - f_d)`, N m: at rest zero but for friction and the plan's own errors,
    /// whatever the force is, unless gauge and force cell contradict each other.
    pub balance: T,
}

impl<T: SiScalar> Measurement<T> {
    /// The measurement in the tick's number type; saturates at the formats' ranges, and
    /// angles lose whole turns, in fixed point.
    pub fn from_si(si: &Measurement<f64>, formats: &Formats<T::Format>) -> Self {
        Self {
            angle: si.angle.map(T::from_rad),
            root_slope: T::from_si(si.root_slope, formats.root_slope),
            root_slope_rate: T::from_si(si.root_slope_rate, formats.slope_rate),
            force: T::from_si(si.force, formats.force),
            motor: si.motor.map(T::from_rad),
            root_moment: T::from_si(si.root_moment, formats.torque[1]),
            drive: si.drive,
        }
    }

    /// The measurement in SI units.
    pub fn to_si(&self, formats: &Formats<T::Format>) -> Measurement<f64> {
        Measurement {
            angle: self.angle.map(T::to_rad),
            root_slope: self.root_slope.to_si(formats.root_slope),
            root_slope_rate: self.root_slope_rate.to_si(formats.slope_rate),
            force: self.force.to_si(formats.force),
            motor: self.motor.map(T::to_rad),
            root_moment: self.root_moment.to_si(formats.torque[1]),
            drive: self.drive,
        }
    }
}
