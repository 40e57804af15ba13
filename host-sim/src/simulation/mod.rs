//! Controller and plant in lock-step.

pub mod cases;
pub mod closed_loop;
pub mod start;
