//! The simulated arm.

pub mod integrator;
#[allow(clippy::module_inception)]
mod plant;

pub use plant::*;
