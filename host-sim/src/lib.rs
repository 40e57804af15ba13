//! Flexor on the host: plans an elastic arm's motion along a surface and runs the
//! firmware's own controller against a simulated arm.
//!
//! Data flows one way, and a wing knows only those before it:
//!
//! | wing | responsible for |
//! |---|---|
//! | [`model`] | the arm as numbers, link 2 in modal coordinates; the equations of motion |
//! | [`planner`] | from a task to joint motion, deflection, torques and the feedforward table |
//! | [`plant`] | the simulated arm; it knows the model and nothing of the planner |
//! | [`simulation`] | controller and plant in lock-step |
//! | [`analysis`] | stability and tuning; range analysis and accuracy of the number types |
//! | `campaign` | many runs of a scenario: their records, statistics and verdict |
//! | [`target`] | the firmware's image in QEMU, or a board: requests, answers, comparison |
//! | [`files`] | the user's files, checked; results as CSV and JSON |
//! | `report` | pictures and a page |
//! | `cli` | the command line |
//!
//! The features `campaign` (many runs on the bench), `report` (pictures and pages), `tune` (the
//! search for gains), `target` and `cli` can each be left out with what they need; `files` writes
//! results with `export`, and the analysis of stability is there with `stability`, which those who
//! need them switch on.

// Tests may compare with the platform's functions.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod analysis;
#[cfg(feature = "campaign")]
pub mod campaign;
#[cfg(feature = "cli")]
pub mod cli;
pub mod files;
pub mod model;
pub mod planner;
pub mod plant;
#[cfg(feature = "report")]
pub mod report;
pub mod simulation;
pub mod target;
#[cfg(test)]
mod testing;
mod text;
