//! The arm on its task at an instant: the tip exactly where it shall be, whatever the link's shape, and
//! the forces that this takes.
//!
//! A bent link's chord is shorter, so the joint angles that hold the tip, their rates and accelerations
//! depend on the deflection and its rates.

use crate::model::arm_model::ArmModel;
use crate::model::bending::{Bent, EndAngle, Nodal};
use crate::model::chord::{inverse_motion, lift};
use crate::model::configuration::Configuration;
use crate::model::link::LinkModel;
use crate::model::link_dynamics::required_bare;
use flexor::model::{JointMotion, KinematicsError};
use flexor::number::Real;

/// What a task prescribes at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Reference {
    /// The tip's position, velocity and acceleration, m, m/s, m/s^2, inertial axes.
    Tip([[f64; 2]; 3]),
    /// The motion of link 1 and of link 2's chord.
    Joints(JointMotion<f64>),
}

impl Reference {
    /// With the joints told where the link's shape has no part in them.
    pub(crate) fn resolved(self, model: &ArmModel) -> Result<Self, KinematicsError> {
        match (self, model.link.kind.model) {
            (Self::Tip(tip), LinkModel::Linear) => {
                let chord = [model.arm.link2_length_m, 0.0, 0.0];
                inverse_motion(&model.arm, chord, tip).map(Self::Joints)
            }
            (reference, _) => Ok(reference),
        }
    }
}

/// The arm at an instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instant<T> {
    /// Motion of link 1 and of link 2's chord.
    pub(crate) joint: JointMotion<T>,
    /// Length of the chord, m, its rate and acceleration.
    pub(crate) chord: [T; 3],
    /// Link 2's section at joint 2.
    pub(crate) root: EndAngle<T>,
    /// The torques that the motion takes, N m.
    pub(crate) torque: [T; 2],
}

/// Memory for what an arm's motion takes.
#[derive(Clone, Debug)]
pub(crate) struct Servo<T> {
    bent: Bent<T>,
    /// What is left of the elastic equations.
    residual: Vec<T>,
}

impl<T: Real> Servo<T> {
    /// For `model`'s arm.
    pub(crate) fn new(model: &ArmModel) -> Self {
        Self {
            bent: Bent::empty(&model.link),
            residual: vec![T::ZERO; model.dof()],
        }
    }

    /// `model`'s arm as `reference` prescribes, pressing with `force` (N, inertial axes), with the link's
    /// unknowns, rates and accelerations `nodal`.
    ///
    /// # Errors
    /// [`KinematicsError`] where the tip is out of reach with the link so bent.
    pub(crate) fn follow(
        &mut self,
        model: &ArmModel,
        reference: &Reference,
        force: [f64; 2],
        nodal: &impl Nodal<T>,
    ) -> Result<Instant<T>, KinematicsError> {
        let bent = &mut self.bent;
        bent.bend(&model.link, nodal);
        let joint = match reference {
            Reference::Tip(tip) => inverse_motion(&model.arm, bent.chord, *tip)?,
            Reference::Joints(joint) => lift(joint),
        };
        let configuration = Configuration::new(model, joint.angle);
        let force = force.map(T::from_f64);
        let elastic = &mut self.residual;
        let found = required_bare(model, bent, &joint, &configuration, force, elastic);
        elastic[0] -= found.root * found.bare[1];
        Ok(Instant {
            joint,
            chord: bent.chord,
            root: bent.root,
            torque: found.torque(),
        })
    }

    /// What the instant last followed has left of the elastic equations: nothing for a motion that the
    /// torques sustain. Moments for slopes, N m, forces for deflections, N.
    pub(crate) fn residual(&self) -> &[T] {
        &self.residual
    }
}
