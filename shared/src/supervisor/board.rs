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

    /// Drives disabled, torques zero, brakes closed.
    fn off(&mut self);

    /// Opens both brakes, which stay open until [`off`](Self::off). A board without brakes does
    /// nothing.
    fn release_brakes(&mut self);

    /// Clears the control timer's request; true if there was one, false if the interrupt was
    /// requested by software alone.
    fn acknowledge_timer(&mut self) -> bool;

    /// True when the control timer has asked again already: the tick took too long.
    fn timer_due(&self) -> bool;

    /// Starts the control timer with a whole period before it, or stops it.
    fn run_timer(&mut self, run: bool);

    /// A free-running counter for measuring short times; wraps.
    fn stopwatch(&self) -> u32;

    /// The control period in ticks of the stopwatch, by which ticks that did not take place are
    /// found out; 0 where that is not known, and they are not.
    fn period_ticks_hw(&self) -> u32;
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
    /// The count for a torque, N m, rounded to the nearest; the end of the range for what is
    /// beyond.
    #[inline]
    pub fn count(&self, torque: f32) -> u16 {
        let zero = f32::from(self.zero);
        // The half is what rounds: float to integer cuts off. It also saturates, and makes 0 of
        // NaN, which the controller never gives.
        let count = (zero + 0.5) + torque * (zero / self.full_scale_nm);
        (count as i32).clamp(0, i32::from(self.zero) * 2 - 1) as u16
    }

    /// The torque that a drive makes of a count, N m.
    #[inline]
    pub fn torque(&self, count: u16) -> f32 {
        let zero = f32::from(self.zero);
        (f32::from(count) - zero) * (self.full_scale_nm / zero)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
            (0.0097, 2048),
            (0.0098, 2049),
            (-0.0097, 2048),
            (-0.0098, 2047),
            (39.97, 4094),
            (39.972, 4095),
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

    proptest! {
        /// A torque within the range comes back within half a step, whichever way the drive
        /// turns, and a count comes back as itself.
        #[test]
        fn the_drive_gives_the_nearest_torque_that_it_can(
            bits in 8_u32..=16,
            full_scale_nm in 1e-3..1e4_f32,
            reversed: bool,
            share in -1.0..1.0_f32,
            count: u16,
        ) {
            let scale = DriveScale {
                zero: 1 << (bits - 1),
                full_scale_nm: if reversed { -full_scale_nm } else { full_scale_nm },
            };
            let step = full_scale_nm / f32::from(scale.zero);
            // The last step of the positive end cannot be told in the count.
            let sign = full_scale_nm.copysign(scale.full_scale_nm) / full_scale_nm;
            let torque = sign * (share * full_scale_nm).min(full_scale_nm - step);
            let given = scale.torque(scale.count(torque));
            let rounding = 4.0 * f32::EPSILON * full_scale_nm;
            prop_assert!((given - torque).abs() <= 0.5 * step + rounding, "{torque} {given}");
            let count = count & (2 * u32::from(scale.zero) - 1) as u16;
            prop_assert_eq!(scale.count(scale.torque(count)), count);
        }
    }
}
