//! What a board is like, as its file says it, and what the tick is made from by it.
//!
//! The firmware's build, the planner and the simulator read one board file into
//! [`BoardParameters`]; all that follows from it is computed here, for all of them. The functions are
//! `const`, so that in the firmware it is computed when the image is built.

use crate::supervisor::board::DriveScale;
use crate::supervisor::enabling::SafetyLimits;
use crate::supervisor::sensing::Calibration;
use core::f64::consts::TAU;

/// A board's sensors, drives, rate and limits; f64, in the units of its file. Pairs are those of
/// joint 1 and 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardParameters {
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Encoder lines a motor turn.
    pub encoder_lines: [u32; 2],
    /// Motor turns a joint turn, positive.
    pub encoder_gear_ratio: [f64; 2],
    /// True where an encoder counts against the angle.
    pub encoder_reversed: [bool; 2],
    /// Motor angles at the home pose, rad.
    pub home_rad: [f64; 2],
    /// Contact force that the converter's range begins and ends with, N, of unlike signs; the
    /// positive one first where the amplifier inverts.
    pub force_range_n: [f64; 2],
    /// The same of the root gauge: equivalent root slope, rad.
    pub gauge_range_rad: [f64; 2],
    /// Bits of the sensors' converter, 8 to 16.
    pub converter_bits: u32,
    /// Counts from either end of the converter's range within which a wire counts as broken.
    pub rail_counts: u16,
    /// Torque at either end of a drive's range, N m, positive.
    pub drive_full_scale_nm: [f64; 2],
    /// True where a drive turns against the angle.
    pub drive_reversed: [bool; 2],
    /// Bits of the converters that command the drives, 8 to 16.
    pub drive_bits: u32,
    /// Share of the full scale that a drive can be asked for.
    pub drive_usable_share: f64,
    /// Largest deviation of theta10 and theta20 from the table's first row at enabling, rad.
    pub start_angle_rad: [f64; 2],
    /// Largest deviation of the root slope there, rad.
    pub start_slope_rad: f64,
    /// Largest deviation of the motors' angles there, rad, which the hybrid law asks instead.
    pub start_motor_rad: [f64; 2],
    /// Time in which the first torques are raised from nothing while brakes hold the arm, s; 0 for
    /// none.
    pub soft_start_s: f64,
    /// Time without a request after which an enabled arm stops, s.
    pub link_timeout_s: f64,
}

/// What a converter's counts stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConverterScale {
    /// Quantity a count, in N or rad; negative where the amplifier inverts.
    pub per_count: f64,
    /// Count of none, not always a whole one.
    pub zero_count: f64,
}

impl ConverterScale {
    /// For a converter of 2^`bits` counts whose range begins and ends with the values `range`.
    const fn new(range: [f64; 2], bits: u32) -> Self {
        let per_count = (range[1] - range[0]) / (count_max(bits) as f64 + 1.0);
        Self {
            per_count,
            zero_count: -range[0] / per_count,
        }
    }

    /// The value of a count.
    const fn value(&self, count: u16) -> f64 {
        (count as f64 - self.zero_count) * self.per_count
    }
}

/// Largest count of a converter; more than 16 bits are 16.
const fn count_max(bits: u32) -> u16 {
    let bits = if bits < 16 { bits } else { 16 };
    ((1_u32 << bits) - 1) as u16
}

impl BoardParameters {
    /// Joint angle that a count of each encoder stands for, rad; negative where it counts against
    /// the angle.
    pub const fn encoder_rad_per_count(&self) -> [f64; 2] {
        [self.rad_per_count(0), self.rad_per_count(1)]
    }

    const fn rad_per_count(&self, joint: usize) -> f64 {
        // Both edges of both tracks count.
        let counts = 4.0 * self.encoder_lines[joint] as f64 * self.encoder_gear_ratio[joint];
        if self.encoder_reversed[joint] {
            -TAU / counts
        } else {
            TAU / counts
        }
    }

    /// Contact force that the converter's counts stand for, N.
    pub const fn force_scale(&self) -> ConverterScale {
        ConverterScale::new(self.force_range_n, self.converter_bits)
    }

    /// Root slope that the converter's counts stand for, rad.
    pub const fn slope_scale(&self) -> ConverterScale {
        ConverterScale::new(self.gauge_range_rad, self.converter_bits)
    }

    /// Largest count of the sensors' converter.
    pub const fn converter_count_max(&self) -> u16 {
        count_max(self.converter_bits)
    }

    /// Least and largest count of the sensors' converter that is off the rails.
    const fn converter_range(&self) -> (u16, u16) {
        let largest = self.converter_count_max().saturating_sub(self.rail_counts);
        (self.rail_counts, largest)
    }

    /// How counts become SI values; for root moments see [`Calibration::for_arm`].
    pub const fn calibration(&self) -> Calibration {
        let encoder = self.encoder_rad_per_count();
        let (force, slope) = (self.force_scale(), self.slope_scale());
        Calibration {
            encoder_rad: [encoder[0] as f32, encoder[1] as f32],
            home_rad: [self.home_rad[0] as f32, self.home_rad[1] as f32],
            force_n: (force.per_count as f32, force.zero_count as f32),
            slope_rad: (slope.per_count as f32, slope.zero_count as f32),
            moment_nm_rad: 0.0,
            range: self.converter_range(),
        }
    }

    /// How the drives' torques become counts.
    pub const fn drives(&self) -> [DriveScale; 2] {
        [self.drive(0), self.drive(1)]
    }

    const fn drive(&self, joint: usize) -> DriveScale {
        let full_scale = self.drive_full_scale_nm[joint];
        DriveScale {
            zero: count_max(self.drive_bits) / 2 + 1,
            full_scale_nm: if self.drive_reversed[joint] {
                -full_scale as f32
            } else {
                full_scale as f32
            },
        }
    }

    /// Largest torques that the drives can be asked for, N m.
    pub const fn drive_limit_nm(&self) -> [f64; 2] {
        let [first, second] = self.drive_full_scale_nm;
        let share = self.drive_usable_share;
        [share * first, share * second]
    }

    /// Limits for enabling and for staying enabled. Times are rounded to whole ticks, the time-out
    /// to at least one.
    pub const fn safety(&self) -> SafetyLimits {
        let rate = self.tick_rate_hz as f64;
        let ticks = (self.link_timeout_s * rate + 0.5) as u32;
        SafetyLimits {
            start_rad: [
                self.start_angle_rad[0] as f32,
                self.start_angle_rad[1] as f32,
                self.start_slope_rad as f32,
            ],
            start_motor_rad: [
                self.start_motor_rad[0] as f32,
                self.start_motor_rad[1] as f32,
            ],
            soft_start_ticks: (self.soft_start_s * rate + 0.5) as u32,
            link_timeout_ticks: if ticks > 0 { ticks } else { 1 },
        }
    }

    /// This board with drives, force cell and gauge made to fit an arm that is not its own: each range
    /// doubled until one and a half times what is planned is within its usable part, and the gauge's
    /// halved while that is less than an eighth of it: a stiff link shows it little. `torque_nm` are the largest magnitudes of the planned torques (N m), `force_n` the
    /// largest force that the tip presses with (N), `slope_rad` the largest magnitude of the root
    /// slope (rad). Also whether anything was changed.
    ///
    /// For simulation: no wiring is changed by it.
    #[must_use]
    pub fn fitted(&self, torque_nm: [f64; 2], force_n: f64, slope_rad: f64) -> (Self, bool) {
        const RESERVE: f64 = 1.5;
        const LEAST_USE: f64 = 8.0;
        let mut fitted = *self;
        for (full_scale, planned) in fitted.drive_full_scale_nm.iter_mut().zip(torque_nm) {
            while *full_scale * self.drive_usable_share < RESERVE * planned.abs()
                && (2.0 * *full_scale).is_finite()
            {
                *full_scale *= 2.0;
            }
        }
        let slope = RESERVE * slope_rad.abs();
        fitted.force_range_n = self.widened(self.force_range_n, [0.0, RESERVE * force_n]);
        fitted.gauge_range_rad = self.widened(self.gauge_range_rad, [-slope, slope]);
        let least = |range: [f64; 2]| range[0].abs().min(range[1].abs());
        while slope > 0.0 && least(fitted.gauge_range_rad) > LEAST_USE * slope {
            fitted.gauge_range_rad = fitted.gauge_range_rad.map(|end| 0.5 * end);
        }
        (fitted, fitted != *self)
    }

    /// A sensor's range doubled until the values from `planned[0]` to `planned[1]` are off the
    /// converter's rails.
    fn widened(&self, mut range: [f64; 2], planned: [f64; 2]) -> [f64; 2] {
        let (least, largest) = self.converter_range();
        loop {
            let scale = ConverterScale::new(range, self.converter_bits);
            let ends = [scale.value(least), scale.value(largest)];
            let outside = |value: f64| value < ends[0].min(ends[1]) || value > ends[0].max(ends[1]);
            let wider = range.map(|end| 2.0 * end);
            if !planned.into_iter().any(outside) || !(wider[1] - wider[0]).is_finite() {
                return range;
            }
            range = wider;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::RawSample;
    use crate::supervisor::Sensing;
    use proptest::prelude::*;

    const BOARD: BoardParameters = BoardParameters {
        tick_rate_hz: 4000,
        encoder_lines: [1000, 2500],
        encoder_gear_ratio: [1.0, 50.0],
        encoder_reversed: [false, true],
        home_rad: [1.0, -0.5],
        force_range_n: [-10.0, 30.0],
        gauge_range_rad: [0.5, -0.5],
        converter_bits: 10,
        rail_counts: 8,
        drive_full_scale_nm: [40.0, 4.0],
        drive_reversed: [false, true],
        drive_bits: 12,
        drive_usable_share: 0.75,
        start_angle_rad: [0.01, 0.02],
        start_slope_rad: 0.03,
        start_motor_rad: [0.04, 0.05],
        soft_start_s: 0.05,
        link_timeout_s: 0.1,
    };

    #[test]
    fn every_number_of_the_board_arrives_where_it_belongs() {
        let c = BOARD.calibration();
        assert_eq!(
            c.encoder_rad,
            [(TAU / 4e3) as f32, (-TAU / (50.0 * 1e4)) as f32]
        );
        assert_eq!(c.home_rad, [1.0, -0.5]);
        // 40 N in 1024 counts, a quarter of them below none; an inverting amplifier.
        assert_eq!(c.force_n, (40.0 / 1024.0, 256.0));
        assert_eq!(c.slope_rad, (-1.0 / 1024.0, 512.0));
        assert_eq!(c.range, (8, 1015));
        let [first, second] = BOARD.drives();
        assert_eq!((first.zero, first.full_scale_nm), (2048, 40.0));
        assert_eq!((second.zero, second.full_scale_nm), (2048, -4.0));
        assert_eq!(BOARD.drive_limit_nm(), [30.0, 3.0]);
        let safety = BOARD.safety();
        assert_eq!(safety.start_rad, [0.01, 0.02, 0.03]);
        assert_eq!(safety.start_motor_rad, [0.04, 0.05]);
        assert_eq!(safety.link_timeout_ticks, 400);
        assert_eq!(safety.soft_start_ticks, 200);
        let never = BoardParameters {
            link_timeout_s: 0.0,
            ..BOARD
        };
        assert_eq!(never.safety().link_timeout_ticks, 1);
    }

    #[test]
    fn converters_of_sixteen_bits_fit_their_counts() {
        let fine = BoardParameters {
            converter_bits: 16,
            drive_bits: 16,
            ..BOARD
        };
        assert_eq!(fine.converter_count_max(), u16::MAX);
        assert_eq!(fine.calibration().range, (8, u16::MAX - 8));
        assert_eq!(fine.force_scale().zero_count, 16_384.0);
        let drive = fine.drives()[0];
        assert_eq!(drive.zero, 32_768);
        assert_eq!((drive.count(-40.0), drive.count(40.0)), (0, u16::MAX));
    }

    #[test]
    fn an_arm_of_the_boards_own_leaves_it_as_it_is() {
        // One and a half times these is just within 30 and 3 N m, and off the rails.
        assert_eq!(BOARD.fitted([20.0, -2.0], 19.0, 0.3), (BOARD, false));
        let (larger, enlarged) = BOARD.fitted([20.1, 7.9], 21.0, -0.34);
        assert!(enlarged);
        assert_eq!(larger.drive_full_scale_nm, [80.0, 16.0]);
        assert_eq!(larger.force_range_n, [-20.0, 60.0]);
        assert_eq!(larger.gauge_range_rad, [1.0, -1.0]);
        // A stiff link of which the gauge would see little.
        let (finer, changed) = BOARD.fitted([20.0, -2.0], 19.0, 0.02);
        assert!(changed);
        assert_eq!(
            finer.gauge_range_rad,
            BOARD.gauge_range_rad.map(|end| 0.25 * end)
        );
        // What is no number, or beyond any, ends.
        assert!(!BOARD.fitted([f64::NAN; 2], f64::NAN, f64::NAN).1);
        let (largest, _) = BOARD.fitted([f64::INFINITY; 2], f64::INFINITY, f64::INFINITY);
        assert!(largest.drive_full_scale_nm.iter().all(|x| x.is_finite()));
        assert!(largest.force_scale().per_count.is_finite());
    }

    proptest! {
        #[test]
        fn a_fitted_board_bears_the_plan_and_is_not_twice_too_large(
            torque in prop::array::uniform2(1e-6..1e5_f64),
            force in 1e-6..1e5_f64,
            slope in 1e-6..10.0_f64,
        ) {
            let (fitted, enlarged) = BOARD.fitted(torque, force, slope);
            prop_assert_eq!(enlarged, fitted != BOARD);
            for joint in 0..2 {
                let limit = fitted.drive_limit_nm()[joint];
                prop_assert!(limit >= 1.5 * torque[joint]);
                let grown = fitted.drive_full_scale_nm[joint] != BOARD.drive_full_scale_nm[joint];
                prop_assert!(!grown || limit < 3.0 * torque[joint]);
            }
            let seen = fitted.gauge_range_rad.map(f64::abs);
            prop_assert!(seen[0].min(seen[1]) <= 8.0 * 1.5 * slope);
            // Nothing but the ranges, which keep their zero.
            prop_assert_eq!(fitted.force_scale().zero_count, BOARD.force_scale().zero_count);
            prop_assert_eq!(fitted.slope_scale().zero_count, BOARD.slope_scale().zero_count);
            let mut sensing = Sensing::new(&fitted.calibration(), 4000, &RawSample::default());
            for (force, slope) in [(0.0, -1.5 * slope), (1.5 * force, 1.5 * slope)] {
                let count = |scale: ConverterScale, x: f64| {
                    (x / scale.per_count + scale.zero_count) as u16
                };
                sensing.update(&RawSample {
                    force: count(fitted.force_scale(), force),
                    strain: count(fitted.slope_scale(), slope),
                    ..RawSample::default()
                });
                prop_assert!(sensing.in_range());
            }
        }
    }
}
