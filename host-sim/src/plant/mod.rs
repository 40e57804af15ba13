//! The simulated arm, one physical law a file. It knows the model and nothing of the planner.

mod friction;
pub mod integrator;
mod parameters;
#[allow(clippy::module_inception)]
mod plant;
pub mod spread;

pub use parameters::PlantParameters;
pub use plant::*;
