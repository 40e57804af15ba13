//! The arm: its data, its kinematics and its elastic link.

mod arm;
mod beam;

pub use arm::{
    ArmParameters, Elbow, JointMotion, Kinematics, KinematicsError, SINGULARITY_MARGIN, fingerprint,
};
pub use beam::{Beam, BeamParameters, Modes};
