//! From encoder and converter counts to a [`Measurement`]: the one place where motor
//! angles become the model's angles.
//!
//! **Joint 2.** Motor 2 sits on link 1 and turns the *root tangent* of link 2, not its
//! chord. Its angle is therefore `theta21 + w'(0)`, and
//! `theta20 = theta10 + motor2 - w'(0)` with the root slope `w'(0)` from the strain
//! gauge.
//!
//! **Encoders** count 16 bits and wrap. The position is extended by the signed
//! difference from tick to tick, right as long as less than 32,768 counts pass in one.
//! They are incremental: they know the angles when the arm has stood at its *home* pose once
//! and [`Sensing::home`] was told.
//!
//! **Rails.** A converter near the end of its range says that a wire is broken, or that more
//! is measured than fits; either way the value must not be used.
//!
//! **Root moment.** A gauge measures the bending moment. The board counts it as the slope that a
//! tip force's moment gives the planned link, r2 / (3 EI) a newton metre; [`Calibration::for_arm`]
//! makes that a moment again. Both are scales of the one calibration, by a known weight, so that
//! the real link's stiffness is in neither.
//!
//! **Slope rate.** The backward difference of the root slope. A step of the converter
//! shows in it as `step * rate`; the law's slope rate filter is what tames that.

use crate::link::RawSample;
use crate::model::ArmParameters;
use crate::signals::{Measurement, Saturation};

/// How counts become SI values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Joint angle a count, rad; negative where the encoder counts against the angle.
    pub encoder_rad: [f32; 2],
    /// Motor angles at the home pose, rad.
    pub home_rad: [f32; 2],
    /// Contact force a count, N, and count without force.
    pub force_n: (f32, f32),
    /// Root slope a count, rad, and count of the straight link.
    pub slope_rad: (f32, f32),
    /// Root moment that a root slope stands for, N m/rad; 0, and moments read 0, until the arm
    /// is known: [`for_arm`](Self::for_arm).
    pub moment_nm_rad: f32,
    /// Least and largest converter count that is off the rails.
    pub range: (u16, u16),
}

impl Calibration {
    /// The same on a board that moves `arm`: root moments read in N m, 3 EI / r2 a radian.
    #[must_use]
    pub fn for_arm(mut self, arm: &ArmParameters) -> Self {
        self.moment_nm_rad = arm.moment_per_root_slope() as f32;
        self
    }
}

/// Follows the counts, in integers, and turns them into measurements where one is wanted.
#[derive(Clone, Debug)]
pub struct Sensing {
    calibration: Calibration,
    /// Root slope rate a count from tick to tick, rad/s.
    slope_rate: f32,
    /// Positions at home.
    home: [i32; 2],
    /// Positions, whose low 16 bits are the encoders' counts.
    position: [i32; 2],
    force: u16,
    strain: u16,
    strain_before: u16,
    fresh: bool,
}

impl Sensing {
    /// Begins where `first` was sampled, and takes that for the home pose until
    /// [`home`](Self::home).
    pub fn new(calibration: &Calibration, tick_rate_hz: u32, first: &RawSample) -> Self {
        let home = first.encoder.map(i32::from);
        Self {
            calibration: *calibration,
            slope_rate: calibration.slope_rad.0 * tick_rate_hz as f32,
            home,
            position: home,
            force: first.force,
            strain: first.strain,
            strain_before: first.strain,
            fresh: first.fresh,
        }
    }

    /// Follows the counts to a new sample; call it once a tick, whether a measurement is
    /// wanted or not.
    #[inline]
    pub fn update(&mut self, raw: &RawSample) {
        for i in 0..2 {
            let step = raw.encoder[i].wrapping_sub(self.position[i] as u16);
            self.position[i] = self.position[i].wrapping_add(i32::from(step.cast_signed()));
        }
        self.strain_before = self.strain;
        self.strain = raw.strain;
        self.force = raw.force;
        self.fresh = raw.fresh;
    }

    /// The arm stands at its home pose: its motor angles are
    /// [`Calibration::home_rad`] where the latest sample was taken.
    pub fn home(&mut self) {
        self.home = self.position;
    }

    /// True when both converters are off their rails.
    #[inline]
    pub fn in_range(&self) -> bool {
        let (least, largest) = self.calibration.range;
        let within = |count| (least <= count) & (count <= largest);
        // Without branches: main loop and tick hold interrupts off meanwhile.
        within(self.force) & within(self.strain)
    }

    /// The encoders' positions, counts from where the board started.
    #[inline]
    pub fn position(&self) -> [i32; 2] {
        self.position
    }

    /// The latest sample.
    #[inline]
    pub fn raw(&self) -> RawSample {
        RawSample {
            encoder: self.position.map(|position| position as u16),
            force: self.force,
            strain: self.strain,
            fresh: self.fresh,
        }
    }

    /// What the latest sample means.
    #[inline]
    pub fn measurement(&self) -> Measurement<f32> {
        let c = &self.calibration;
        let motor = [0, 1].map(|i| {
            let counts = self.position[i].wrapping_sub(self.home[i]);
            c.home_rad[i] + counts as f32 * c.encoder_rad[i]
        });
        let root_slope = (f32::from(self.strain) - c.slope_rad.1) * c.slope_rad.0;
        let stretch = i32::from(self.strain) - i32::from(self.strain_before);
        Measurement {
            angle: [motor[0], motor[0] + motor[1] - root_slope],
            root_slope,
            root_slope_rate: stretch as f32 * self.slope_rate,
            force: (f32::from(self.force) - c.force_n.1) * c.force_n.0,
            motor,
            root_moment: root_slope * c.moment_nm_rad,
            drive: [Saturation::None; 2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CALIBRATION: Calibration = Calibration {
        encoder_rad: [1e-3, -2e-3],
        home_rad: [0.5, -1.0],
        force_n: (0.01, 2048.0),
        slope_rad: (0.001, 2000.0),
        moment_nm_rad: 2.5,
        range: (16, 4079),
    };

    #[test]
    fn counts_become_the_models_quantities() {
        let first = RawSample {
            encoder: [65_530, 7],
            force: 2148,
            strain: 2100,
            fresh: true,
        };
        let mut sensing = Sensing::new(&CALIBRATION, 1000, &first);
        sensing.update(&first);
        let m = sensing.measurement();
        assert!((m.angle[0] - 0.5).abs() < 1e-6);
        // theta20 = theta10 + motor2 - w'(0)
        assert!((m.angle[1] - (0.5 - 1.0 - 0.1)).abs() < 1e-6);
        assert!((m.force - 1.0).abs() < 1e-6 && m.root_slope_rate == 0.0);
        assert!((m.motor[0] - 0.5).abs() < 1e-6 && (m.motor[1] + 1.0).abs() < 1e-6);
        assert!((m.root_moment - 2.5 * 0.1).abs() < 1e-6);
        sensing.update(&RawSample {
            encoder: [4, 65_533], // +10 and -10, both over the wrap
            strain: 2110,
            ..first
        });
        let m = sensing.measurement();
        assert!((m.angle[0] - 0.51).abs() < 1e-6);
        assert!((m.angle[1] - (0.51 - 0.98 - 0.11)).abs() < 1e-6);
        assert!((m.root_slope_rate - 10.0).abs() < 1e-3);
    }

    #[test]
    fn a_moment_is_read_in_the_planned_arms_scale() {
        let arm = ArmParameters::PAPER;
        let calibration = CALIBRATION.for_arm(&arm);
        let first = RawSample {
            strain: 2100,
            ..RawSample::default()
        };
        let m = Sensing::new(&calibration, 1000, &first).measurement();
        // A force across the tip of 3 EI w'(0) / r2^2 bends a cantilever by w'(0) against its
        // chord at the root.
        let force = 3.0 * arm.bending_stiffness_nm2 * 0.1 / libm::pow(arm.link2_length_m, 2.0);
        assert!((f64::from(m.root_moment) - force * arm.link2_length_m).abs() < 1e-6);
    }

    #[test]
    fn home_is_where_the_arm_is_said_to_stand() {
        let mut sensing = Sensing::new(&CALIBRATION, 1000, &RawSample::default());
        let raw = RawSample {
            encoder: [1000, 500],
            strain: 2000,
            ..RawSample::default()
        };
        sensing.update(&raw);
        assert!((sensing.measurement().angle[0] - 1.5).abs() < 1e-6);
        sensing.home();
        let m = sensing.measurement();
        assert!((m.angle[0] - 0.5).abs() < 1e-6 && (m.angle[1] + 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_converter_at_either_rail_is_out_of_range() {
        let mut sensing = Sensing::new(&CALIBRATION, 1000, &RawSample::default());
        for (force, strain, expected) in [
            (2048, 2048, true),
            (16, 4079, true),
            (15, 2048, false),
            (2048, 15, false),
            (4080, 2048, false),
            (2048, 4095, false),
        ] {
            sensing.update(&RawSample {
                force,
                strain,
                ..RawSample::default()
            });
            assert_eq!(sensing.in_range(), expected, "{force} {strain}");
        }
    }

    proptest! {
        #[test]
        fn positions_follow_any_motion(steps in proptest::collection::vec(-32_767..32_767_i32, 1..200)) {
            let mut sensing = Sensing::new(&CALIBRATION, 5000, &RawSample::default());
            let mut position = 0_i32;
            for step in steps {
                position += step;
                let raw = RawSample { encoder: [position as u16, 0], ..RawSample::default() };
                sensing.update(&raw);
                prop_assert_eq!(sensing.position, [position, 0]);
            }
        }
    }
}
