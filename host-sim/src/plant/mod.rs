//! The simulated arm, one physical law a file. It knows the model and nothing of the planner.

mod friction;
pub mod integrator;
mod parameters;
#[expect(clippy::module_inception, reason = "the wing's main file has its name")]
mod plant;
pub mod spread;

pub use parameters::PlantParameters;
pub use plant::{Plant, PlantError, Reading, SUBSTEPS_MAX, derivative, resting_state, state_of};
