//! What the control tick needs from a board: the one trait [`Board`].
//!
//! A port to another microcontroller implements it and nothing else. There are two: the
//! STM32F405 of the firmware, and [`MemoryBoard`](crate::supervisor::MemoryBoard), which is
//! nothing but values in memory.

use crate::link::{Interlocks, RawSample};

/// Everything that the tick's interrupt uses: sensors, drives, the control period's timer
/// and a stopwatch.
///
/// No method waits for anything, and none can fail: what is not there is reported as not
/// fresh, not ok, not released.
pub trait Board {
    /// The latest counts of encoders and converters. Never waits: what has not been converted
    /// since the call before is not `fresh`.
    fn sample(&mut self) -> RawSample;

    /// State of the emergency stop and of the drives' fault lines now.
    fn interlocks(&self) -> Interlocks;

    /// Enables both drives and commands torques (tau1, tau2), N m. Values beyond what the
    /// drives take are cut off.
    fn command(&mut self, torque: [f32; 2]);

    /// Drives disabled, torques zero.
    fn off(&mut self);

    /// Clears the control timer's request; true if there was one, false if the interrupt was
    /// requested by software alone.
    fn acknowledge_timer(&mut self) -> bool;

    /// True when the control timer has asked again already: the tick took too long.
    fn timer_due(&self) -> bool;

    /// Starts the control timer with a whole period before it, or stops it.
    fn run_timer(&mut self, run: bool);

    /// A free-running counter for measuring short times; wraps.
    fn stopwatch(&self) -> u32;
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
