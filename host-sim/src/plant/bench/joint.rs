//! The joints: friction with pre-sliding, cogging, rotor inertia, and gear play.
//!
//! ```text
//! motor torque   tau_m = tau - F(rate) - viscous rate + cogging sin(periods angle + phase)
//! without play   tau_m acts on the link, its reaction on what carries the motor
//! with play      J psi'' = tau_m - tau_g,  tau_g acts on the link
//!                tau_g = press(delta - play/2) - press(-delta - play/2),  delta = psi - link angle
//! ```
//!
//! F is the bristle of [`crate::plant::bench::bristle`], `press` the one-sided spring and damper of
//! [`crate::plant::bench::contact`]: a gear's teeth push and never pull, so play creates no energy.
//! Angle and rate are the motor's, at the joint's side of the gear, against what carries it.
//!
//! **Rotor and gear.** A rotor of inertia `I` behind a gear of ratio `G` is `G^2 I` at the joint.
//! At joint 1 that is added to link 1's inertia, at joint 2 to the root's, which turns with the
//! root's tangent. Motor 2 sits on link 1: for a direct drive (G = 1) this is exact; for a gear the
//! rotor's own spin is `theta10' + G m2'` and the coupling `(1 - G) theta10''` is left out.
//!
//! **Play needs a coordinate of its own**, the rotor's angle `psi` (joint 2: absolute, as its
//! root's), with the reflected rotor inertia as its mass: without a rotor there is nothing that
//! could move in the play. That inertia is then no longer added to the link.

use crate::plant::bench::bristle::Bristle;
use crate::plant::bench::contact::{excess, pressing};
use crate::plant::bench::lanes::Lanes;

/// Friction of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointFriction {
    /// Coulomb friction when turning fast, N m.
    pub coulomb_nm: f64,
    /// Torque at which it breaks away, N m; no less than `coulomb_nm`.
    pub breakaway_nm: f64,
    /// Rate at which half the difference of the two is gone, rad/s, positive.
    pub stribeck_rad_s: f64,
    /// Viscous friction, N m s/rad.
    pub viscous_nms_rad: f64,
    /// Angle by which the bristle gives under the Coulomb friction, rad, positive.
    pub pre_sliding_rad: f64,
}

impl Default for JointFriction {
    /// No friction.
    fn default() -> Self {
        Self {
            coulomb_nm: 0.0,
            breakaway_nm: 0.0,
            stribeck_rad_s: 0.05,
            viscous_nms_rad: 0.0,
            pre_sliding_rad: 1e-3,
        }
    }
}

/// Torque of the magnets on the slots: `amplitude_nm sin(periods angle + phase_rad)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cogging {
    /// Amplitude, N m.
    pub amplitude_nm: f64,
    /// Periods a turn of the joint.
    pub periods: f64,
    /// Phase at angle 0, rad.
    pub phase_rad: f64,
}

impl Default for Cogging {
    /// None; 42 periods a turn.
    fn default() -> Self {
        Self {
            amplitude_nm: 0.0,
            periods: 42.0,
            phase_rad: 0.0,
        }
    }
}

/// Play between motor and link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GearPlay {
    /// Free angle from flank to flank, at the joint's side, rad.
    pub play_rad: f64,
    /// Stiffness of the flanks, N m/rad, positive.
    pub stiffness_nm_rad: f64,
    /// Their damping, N m s/rad.
    pub damping_nms_rad: f64,
}

/// What lies between a drive's torque and its link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointParameters {
    /// Friction.
    pub friction: JointFriction,
    /// Cogging.
    pub cogging: Cogging,
    /// Inertia of the rotor about its own axis, kg m^2.
    pub rotor_inertia_kgm2: f64,
    /// Rotor turns a joint turn.
    pub gear_ratio: f64,
    /// Play; `None` for none.
    pub play: Option<GearPlay>,
}

impl Default for JointParameters {
    /// An ideal direct drive.
    fn default() -> Self {
        Self {
            friction: JointFriction::default(),
            cogging: Cogging::default(),
            rotor_inertia_kgm2: 0.0,
            gear_ratio: 1.0,
            play: None,
        }
    }
}

impl JointParameters {
    /// Inertia of the rotor at the joint's side of the gear, kg m^2.
    pub fn reflected_inertia_kgm2(&self) -> f64 {
        self.rotor_inertia_kgm2 * self.gear_ratio * self.gear_ratio
    }

    /// Stiffness of the friction's bristle, N m/rad.
    pub(super) fn bristle_stiffness(&self) -> f64 {
        self.friction.coulomb_nm / self.friction.pre_sliding_rad
    }

    /// Cogging torque, N m, at a motor angle, rad.
    pub(super) fn cogging(&self, angle: f64) -> f64 {
        let c = &self.cogging;
        c.amplitude_nm * Lanes::sin_cos(c.periods * angle + c.phase_rad).0
    }

    /// How far the rotor is ahead of the link, rad, when it gives the link `torque` (N m) at rest;
    /// 0 without play.
    pub(super) fn lead(&self, torque: f64) -> f64 {
        self.play.map_or(0.0, |gear| {
            let flank = if torque == 0.0 {
                0.0
            } else {
                0.5 * gear.play_rad
            };
            flank.copysign(torque) + torque / gear.stiffness_nm_rad
        })
    }
}

/// A joint's constants, in lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint<T> {
    bristle: Bristle<T>,
    coulomb: T,
    viscous: T,
    /// Amplitude, periods and phase; left out where no lane has any.
    cogging: Option<[T; 3]>,
    /// Half the play, stiffness and damping of the gear, and the rotor's inertia.
    pub(super) gear: Option<[T; 4]>,
}

impl<T: Lanes> Joint<T> {
    /// One joint a lane; all of them with play, or none.
    pub(super) fn new<'a>(parameters: impl Fn(usize) -> &'a JointParameters) -> Self {
        let lanes =
            |value: &dyn Fn(&JointParameters) -> f64| T::from_lanes(|i| value(parameters(i)));
        let cogs = (0..T::LANES).any(|i| parameters(i).cogging.amplitude_nm != 0.0);
        let plays = (0..T::LANES).any(|i| parameters(i).play.is_some());
        let gear =
            |value: fn(&GearPlay) -> f64| lanes(&|j| j.play.as_ref().map_or(f64::NAN, value));
        Self {
            bristle: Bristle {
                stiffness: lanes(&JointParameters::bristle_stiffness),
                excess: lanes(&|j| excess(j.friction.coulomb_nm, j.friction.breakaway_nm)),
                slowness: lanes(&|j| 1.0 / j.friction.stribeck_rad_s),
            },
            coulomb: lanes(&|j| j.friction.coulomb_nm),
            viscous: lanes(&|j| j.friction.viscous_nms_rad),
            cogging: cogs.then(|| {
                [
                    lanes(&|j| j.cogging.amplitude_nm),
                    lanes(&|j| j.cogging.periods),
                    lanes(&|j| j.cogging.phase_rad),
                ]
            }),
            gear: plays.then(|| {
                [
                    gear(|g| 0.5 * g.play_rad),
                    gear(|g| g.stiffness_nm_rad),
                    gear(|g| g.damping_nms_rad),
                    lanes(&JointParameters::reflected_inertia_kgm2),
                ]
            }),
        }
    }

    /// Torque of the motor after friction and cogging, N m, with the drive giving `torque`, at an
    /// angle and rate of the motor and a deflection of the bristle (rad); and the bristle's rate.
    #[inline]
    pub(super) fn motor(&self, torque: T, angle: T, rate: T, bristle: T) -> (T, T) {
        let (friction, bristle_rate) = self.bristle.friction(bristle, rate, self.coulomb);
        let mut given = torque - friction - self.viscous * rate;
        if let Some([amplitude, periods, phase]) = self.cogging {
            given += amplitude * (periods * angle + phase).sin_cos().0;
        }
        (given, bristle_rate)
    }
}

/// Torque of the gear on the link, N m, with the rotor ahead of it by an angle (rad) that grows
/// at a rate (rad/s); `gear` as in [`Joint::gear`].
#[inline]
pub(super) fn gear_torque<T: Lanes>(gear: [T; 4], ahead: T, rate: T) -> T {
    let [half, stiffness, damping, _] = gear;
    pressing(ahead - half, rate, stiffness, damping)
        - pressing(-ahead - half, -rate, stiffness, damping)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::bench::runge_kutta::RungeKutta;
    use proptest::prelude::*;

    const STICKY: JointParameters = JointParameters {
        friction: JointFriction {
            coulomb_nm: 0.05,
            breakaway_nm: 0.08,
            stribeck_rad_s: 0.05,
            viscous_nms_rad: 0.01,
            pre_sliding_rad: 1e-3,
        },
        cogging: Cogging {
            amplitude_nm: 0.0,
            periods: 42.0,
            phase_rad: 0.0,
        },
        rotor_inertia_kgm2: 1e-5,
        gear_ratio: 10.0,
        play: None,
    };

    /// A rotor of 1e-3 kg m^2 under a torque of time: angle, rate and bristle at the end.
    fn turn(joint: &JointParameters, torque: impl Fn(f64) -> f64, seconds: f64) -> [f64; 3] {
        let joint = Joint::<f64>::new(|_| joint);
        let (h, mut state) = (2e-5, [0.0; 3]);
        let mut method = RungeKutta::new(3);
        for step in 0..(seconds / h) as u32 {
            let t = f64::from(step) * h;
            method.step(&mut state, h, |share, s, slope| {
                let (given, bristle) = joint.motor(torque(t + share * h), s[0], s[1], s[2]);
                slope[0] = s[1];
                slope[1] = given / 1e-3;
                slope[2] = bristle;
            });
        }
        state
    }

    #[test]
    fn it_holds_up_to_the_breakaway_and_then_turns_with_coulomb_and_viscous_friction() {
        // A slow ramp to nine tenths of the breakaway: held by the bristle, which gives a little
        // more than a spring would.
        let held = turn(&STICKY, |t| 0.072 * t.min(1.0), 2.0);
        let spring = 0.072 / STICKY.bristle_stiffness();
        assert!(held[1].abs() < 1e-4, "{held:?}");
        assert!((held[2] / spring - 1.0).abs() < 1e-3, "{held:?}");
        assert!(held[0] >= held[2] && held[0] < 1.5 * spring, "{held:?}");
        // Beyond the breakaway it turns; in the end the torque is coulomb + viscous rate.
        let turning = turn(&STICKY, |t| 0.1 * t.min(1.0), 3.0);
        let exact = (0.1 - 0.05) / 0.01;
        assert!((turning[1] - exact).abs() < 1e-3 * exact, "{turning:?}");
    }

    #[test]
    fn rotor_inertia_is_reflected_by_the_ratio_squared() {
        assert!((STICKY.reflected_inertia_kgm2() - 1e-3).abs() < 1e-18);
    }

    #[test]
    fn cogging_has_its_periods_and_does_no_work_a_turn() {
        let joint = JointParameters {
            cogging: Cogging {
                amplitude_nm: 0.1,
                periods: 42.0,
                phase_rad: 0.3,
            },
            ..JointParameters::default()
        };
        let lanes = Joint::<f64>::new(|_| &joint);
        let turn = core::f64::consts::TAU;
        let torque = |angle: f64| lanes.motor(0.0, angle, 0.0, 0.0).0;
        let count = 42 * 64;
        let work: f64 = (0..count)
            .map(|i| torque(turn * f64::from(i) / f64::from(count)))
            .sum();
        assert!(work.abs() < 1e-10);
        assert!((torque(0.2) - torque(0.2 + turn / 42.0)).abs() < 1e-12);
        assert!((torque(0.2) - joint.cogging(0.2)).abs() < 1e-16);
    }

    #[test]
    fn in_the_play_nothing_is_transmitted_and_on_the_flanks_a_spring() {
        let joint = JointParameters {
            play: Some(GearPlay {
                play_rad: 2e-3,
                stiffness_nm_rad: 500.0,
                damping_nms_rad: 0.1,
            }),
            ..STICKY
        };
        let gear = Joint::<f64>::new(|_| &joint).gear.unwrap();
        assert_eq!(gear_torque(gear, 0.9e-3, 5.0), 0.0);
        assert_eq!(gear_torque(gear, -0.9e-3, -5.0), 0.0);
        assert!((gear_torque(gear, 1.2e-3, 0.0) - 0.1).abs() < 1e-12);
        assert!((gear_torque(gear, -1.2e-3, 0.0) + 0.1).abs() < 1e-12);
        // Flanks never pull, however fast they part.
        assert_eq!(gear_torque(gear, 1.2e-3, -5.0), 0.0);
        for torque in [0.2, -0.3, 0.0] {
            assert!((gear_torque(gear, joint.lead(torque), 0.0) - torque).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn friction_and_play_never_make_energy(
            angle in -0.01..0.01_f64, rate in -20.0..20.0_f64, bristle in -3e-3..3e-3_f64,
        ) {
            let joint = Joint::<f64>::new(|_| &STICKY);
            let (given, bristle_rate) = joint.motor(0.0, angle, rate, bristle);
            let stored = STICKY.bristle_stiffness() * bristle * bristle_rate;
            prop_assert!(-given * rate - stored >= -1e-12);

            let play = GearPlay { play_rad: 2e-3, stiffness_nm_rad: 500.0, damping_nms_rad: 0.1 };
            let geared = JointParameters { play: Some(play), ..STICKY };
            let gear = Joint::<f64>::new(|_| &geared).gear.unwrap();
            let torque = gear_torque(gear, angle, rate);
            let spring = gear_torque([gear[0], gear[1], 0.0, gear[3]], angle, 0.0);
            prop_assert!((torque - spring) * rate >= -1e-12);
            prop_assert!(torque * angle >= 0.0);
        }
    }
}
