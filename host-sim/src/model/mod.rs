//! The arm as numbers, and its equations of motion.

pub mod arm_model;
pub mod configuration;
pub mod dynamics;
pub mod forward;
pub mod geometric_stiffness;
pub mod printed;
