//! The arm: its data, its kinematics and its elastic link.

mod arm;
mod beam;

pub use arm::*;
pub use beam::*;
