//! The arm as numbers, and its equations of motion.

pub mod arm_model;
pub(crate) mod bending;
pub mod bent_forward;
pub mod chord;
pub mod configuration;
pub mod dual;
pub mod dynamics;
pub mod energy;
pub mod forward;
pub(crate) mod gauss;
pub mod geometric_stiffness;
pub mod link;
pub(crate) mod link_dynamics;
#[cfg(test)]
mod link_tests;
pub mod printed;
pub(crate) mod rest;
pub(crate) mod servo;
pub(crate) mod unknowns;
