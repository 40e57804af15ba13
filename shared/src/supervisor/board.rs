//! What the control tick needs from a board, as small traits. A port to another
//! microcontroller implements these and nothing else.
//!
//! No function of these waits for anything, and none can fail: what is not there is
//! reported as not fresh, not well, not released.

use crate::link::{Interlocks, RawSample};

/// Encoders and converters.
pub trait Sensors {
    /// The latest counts. Never waits: what has not been converted is not `fresh`.
    fn sample(&mut self) -> RawSample;
}

/// How a torque becomes the count of a converter that commands a drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveScale {
    /// Count of no torque, half the converter's range.
    pub zero: u16,
    /// Torque that the whole range stands for to either side, N m; negative where the drive
    /// turns against the angle.
    pub full_scale_nm: f32,
}

impl DriveScale {
    /// The count for a torque, N m, rounded down; the end of the range for what is beyond.
    #[inline]
    pub fn count(&self, torque: f32) -> u16 {
        let zero = f32::from(self.zero);
        let count = zero + torque * (zero / self.full_scale_nm);
        // Float to integer saturates, and makes 0 of NaN, which the controller never gives.
        (count as i32).clamp(0, i32::from(self.zero) * 2 - 1) as u16
    }
}

/// The two current-controlled drives.
pub trait Drives {
    /// Enables the drives and commands torques, N m. Values beyond what the drives take
    /// are cut off.
    fn command(&mut self, torque: [f32; 2]);

    /// Torques zero, drives disabled.
    fn off(&mut self);
}

/// Emergency stop and drive fault inputs.
pub trait Inputs {
    /// Their state now.
    fn interlocks(&self) -> Interlocks;
}

/// The control period's timer, whose interrupt runs the tick.
pub trait Timebase {
    /// Clears the timer's request; true if there was one (and the interrupt was not
    /// requested by software alone).
    fn acknowledge(&mut self) -> bool;

    /// True when the timer has asked again already.
    fn due(&self) -> bool;

    /// Starts or stops the timer.
    fn run(&mut self, run: bool);
}

/// A free-running counter for measuring short times.
pub trait Stopwatch {
    /// Counts, wrapping.
    fn counts(&self) -> u32;
}

/// All that the tick's interrupt uses.
#[derive(Debug)]
pub struct TickBoard<S, D, T, W> {
    /// Encoders and converters.
    pub sensors: S,
    /// Torque commands, enable lines and the inputs beside them.
    pub drives: D,
    /// The control period.
    pub timebase: T,
    /// Measures the tick.
    pub stopwatch: W,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torques_become_counts_on_their_side_of_zero() {
        let scale = DriveScale {
            zero: 2048,
            full_scale_nm: 40.0,
        };
        for (torque, count) in [
            (0.0, 2048),
            (10.0, 2560),
            (-10.0, 1536),
            (39.99, 4095),
            (-40.0, 0),
            (40.0, 4095),
            (1e9, 4095),
            (f32::NEG_INFINITY, 0),
        ] {
            assert_eq!(scale.count(torque), count, "{torque}");
        }
        let reversed = DriveScale {
            full_scale_nm: -40.0,
            ..scale
        };
        assert_eq!(reversed.count(10.0), 1536);
    }
}
