//! The tick's signals: their formats in fixed point, and counters of their saturations.

use crate::table::Reference;
use serde::{Deserialize, Serialize};

/// A format for each kind of signal. In floating point formats are nothing; in fixed point
/// they come from a range analysis on the host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Formats<F> {
    /// Torques of joint 1 and joint 2, N m.
    pub torque: [F; 2],
    /// Forces: reference, measured, error, integral, correction, N.
    pub force: F,
    /// Angles and their differences, rad.
    pub angle: F,
    /// Root slope, rad.
    pub root_slope: F,
    /// Root slope rates: reference, measured, deviation, rad/s.
    pub slope_rate: F,
    /// Levers that make torques of forces, m.
    pub lever: F,
}

impl<F: Copy> Formats<F> {
    /// The formats of a table's columns.
    pub fn reference(&self) -> Reference<F> {
        Reference {
            torque: self.torque,
            force: self.force,
            angle: [self.angle; 2],
            root_slope: self.root_slope,
            root_slope_rate: self.slope_rate,
            normal_angle: self.angle,
        }
    }
}

/// How often each signal has saturated since the start: it left its format's range and was
/// held at the end of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Saturations<C> {
    /// Force error and filtered force error.
    pub force: C,
    /// The law's integral.
    pub integral: C,
    /// The force that feedback asks for.
    pub correction: C,
    /// Angles from the surface normal.
    pub angle: C,
    /// Deviation of the root slope rate.
    pub slope_rate: C,
    /// Torques before the limits.
    pub torque: [C; 2],
}

impl Saturations<u32> {
    /// The signals' names and counts.
    pub fn entries(&self) -> [(&'static str, u32); 7] {
        [
            ("force", self.force),
            ("integral", self.integral),
            ("correction", self.correction),
            ("angle", self.angle),
            ("slope_rate", self.slope_rate),
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
