//! Gains of the hybrid law for the arm at hand, and the proof that they hold.
//!
//! The plant is the bench's own arm, frozen at rest at poses of the plan, with everything between a
//! command and a reading: drive lag, delay, compliant contact, friction of a given direction, and the
//! inertia at link 2's root as a range ([`plant`]). The law is [`flexor::control::HybridLaw`] itself
//! ([`closed`]). A [`LoopSpread`] says which arms must hold, a [`Proof`] whether they do and with
//! what margin, [`mod@design`] finds gains that do.
//!
//! Glossary: a *pole* is a rate, 1/s, stable with a negative real part; *hub* means the inertia that
//! turns with link 2's root, of rotor and hub; *stress* is a gain or a delay beyond what is there.

pub mod closed;
#[cfg(feature = "tune")]
pub mod design;
#[cfg(test)]
mod hybrid_tests;
pub mod plant;
#[cfg(feature = "tune")]
pub mod problem;
pub mod proof;
#[cfg(feature = "tune")]
mod search;
#[cfg(feature = "tune")]
pub mod sets;
pub mod spread;

pub use closed::{ClosedLoop, LinearHybrid, Noise, Stress};

#[cfg(feature = "tune")]
pub use design::{Design, Effort, design};
pub use plant::{LoopPlant, LoopPose, SampledPlant};
#[cfg(feature = "tune")]
pub use problem::Problem;
pub use proof::Proof;
pub use spread::{LoopSpread, NamedPlant};

use crate::model::arm_model::ModelError;
use crate::planner::plan::Plan;
use crate::text::Shortest;

/// Why there is no statement on a loop, or no gains.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HybridError {
    /// No model of a plant.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A plant's link has no resting shape.
    #[error(
        "at t = {t_s:.4} s link 2 of a plant of the spread has no resting shape under the planned force: it buckles; more stiffness or less force is accepted"
    )]
    Buckled {
        /// When, s.
        t_s: f64,
    },
    /// The equations have no finite derivative.
    #[error("at t = {t_s:.4} s the equations of motion have no finite derivatives")]
    NotFinite {
        /// When, s.
        t_s: f64,
    },
    /// Friction turns the force loop round, or nearly so.
    #[error(
        "friction = {}: {} times the largest tangent of link 2's slope to the surface is {product:.2}, and sliding friction multiplies the force loop's gain by 1/(1 - that); a friction up to {} is accepted, or a path on which link 2 lies flatter",
        Shortest(*friction),
        Shortest(*friction),
        Shortest(*accepted)
    )]
    Friction {
        /// The coefficient.
        friction: f64,
        /// It times the largest tangent.
        product: f64,
        /// What would do.
        accepted: f64,
    },
    /// A plan that presses nowhere, as a move through the air does.
    #[error(
        "gains are found along a surface, and this plan presses nowhere: a controller file (--controller) with those that `flexor gains design` finds for the arm's task is accepted"
    )]
    NoContact,
    /// No gains hold the spread.
    #[error("no gains were found that hold every arm of the spread: {worst}; {remedy}")]
    NotDesigned {
        /// The arm that is worst with the best gains.
        worst: String,
        /// What would make it easier.
        remedy: String,
    },
}

/// Poses of `plan` at which its loop is frozen: `points` (1 or more), its ends among them.
pub fn poses(plan: &Plan, points: usize) -> Vec<LoopPose> {
    let mut sampler = plan.sampler();
    let [start, end] = [plan.time(0), plan.time(plan.ticks)];
    let last = points.max(2) - 1;
    (0..points.max(1))
        .map(|i| {
            let t_s = start + (end - start) * i as f64 / last as f64;
            let point = sampler.at(t_s);
            LoopPose {
                t_s,
                angle: point.joint.angle,
                force_n: point.force.normal,
                normal_angle: plan.normal_angle(),
            }
        })
        .collect()
}

/// Friction times [`friction_leverage`] above which gains are refused: the force loop's gain is
/// then multiplied by more than 2.2.
pub const FRICTION_LEVERAGE_MAX: f64 = crate::planner::tip_force::FRICTION_SHARE_MAX;

/// The largest magnitude of c2/s2 over `poses`: the tangent of link 2's slope to the surface's
/// normal's cross direction. Friction mu multiplies the force loop's gain by up to
/// `1 / (1 - mu |c2/s2|)`.
pub fn friction_leverage(poses: &[LoopPose]) -> f64 {
    poses
        .iter()
        .map(|pose| {
            let (sine, cosine) = libm::sincos(pose.normal_angle - pose.angle[1]);
            (cosine / sine).abs()
        })
        .fold(0.0, f64::max)
}
