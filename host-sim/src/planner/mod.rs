//! From a task to joint motion, deflection, torques and their table.

mod attempt;
pub mod collocation;
mod elastic_bvp;
mod feasible;
pub mod free_move;
#[cfg(test)]
mod free_move_tests;
pub mod limits;
pub mod monitors;
pub mod path;
pub mod plan;
pub mod planning;
pub mod table_fit;
pub mod task;
pub mod tip_force;
mod zeros;
