//! The simulated arm, one physical law a file. It knows the model and nothing of the planner.
//!
//! Two plants: [`Plant`], its tip held on a rigid surface, which stability is proved for, and
//! the one in `bench`, with contact, friction, drives and sensors as they are.

#[cfg(feature = "bench")]
pub mod bench;
mod bent_rest;
mod friction;
pub mod integrator;
mod parameters;
#[expect(clippy::module_inception, reason = "the wing's main file has its name")]
mod plant;
pub mod spread;

pub use parameters::PlantParameters;
pub use plant::{
    Plant, PlantError, Reading, SUBSTEPS_MAX, derivative, resting_state, resting_state_under,
    state_of,
};
