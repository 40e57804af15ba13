//! The arm as numbers, and its equations of motion.

pub mod arm_model;
pub mod dynamics;
