//! Flexor on the host: plans an elastic arm's motion along a surface and runs the
//! firmware's own controller against a simulated arm.

pub mod closed_loop;
pub mod collocation;
pub mod dynamics;
pub mod integrator;
pub mod knots;
pub mod model;
pub mod plan;
pub mod plant;
pub mod report;
#[cfg(test)]
mod testing;
pub mod trajectory;
