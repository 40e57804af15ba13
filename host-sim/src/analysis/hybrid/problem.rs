//! What gains are to be found for, and what they scale with.

use super::HybridError;
use super::closed::Noise;
use super::plant::{LoopPlant, LoopPose, SampledPlant};
use super::spread::LoopSpread;
use crate::analysis::stability::eigenvalues;
use flexor::control::MotionParameters;
use flexor::model::ArmParameters;

/// What gains are to be found for.
#[derive(Clone, Debug)]
pub struct Problem<'a> {
    /// The arm that is planned for.
    pub arm: &'a ArmParameters,
    /// Poses of its plan.
    pub poses: &'a [LoopPose],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
    /// Arms that must be held.
    pub spread: LoopSpread,
    /// What disturbs them.
    pub noise: Noise,
    /// Largest planned torque of joint 1, N m: what its drive has to give at the least.
    pub joint1_torque_nm: f64,
    /// Thresholds of the motion around the law.
    pub motion: MotionParameters,
}

/// What an arm's gains scale with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scales {
    /// Of the contact mode without feedback, rad/s.
    pub(super) frequency: f64,
    /// `3 EI / r2`, N m/rad.
    pub(super) stiffness: f64,
    /// Moment of the planned force at the root of a link along the surface, N m.
    pub(super) moment_nm: f64,
}

impl Scales {
    pub(super) fn new(problem: &Problem<'_>) -> Result<Self, HybridError> {
        let arm = problem.arm;
        let pose = &problem.poses[0];
        let heavy = LoopPlant {
            root_inertia_kgm2: problem.spread.root_inertia_kgm2[1],
            ..problem.spread.middle(arm)
        };
        let plant = SampledPlant::new(arm, &heavy, pose, problem.tick_rate_hz, false)?;
        let rate = f64::from(problem.tick_rate_hz);
        let modes = eigenvalues(plant.phi).into_iter().filter(|z| z.im > 1e-9);
        let frequency = modes
            .map(|z| {
                let decay = libm::log(libm::hypot(z.re, z.im));
                rate * libm::hypot(decay, libm::atan2(z.im, z.re))
            })
            .fold(f64::INFINITY, f64::min);
        Ok(Self {
            frequency: frequency.min(0.3 * rate),
            stiffness: 3.0 * arm.bending_stiffness_nm2 / arm.link2_length_m,
            moment_nm: arm.link2_length_m * pose.force_n,
        })
    }
}
