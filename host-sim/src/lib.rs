//! Flexor on the host: plans an elastic arm's motion along a surface and runs the
//! firmware's own controller against a simulated arm.
//!
//! Data flows one way, and a module knows only those before it:
//!
//! | module | responsible for |
//! |---|---|
//! | [`config`] | the user's files, checked |
//! | [`model`] | the arm as numbers: rigid constants, link 2 in modal coordinates |
//! | [`dynamics`] | the equations of motion, forward and inverse |
//! | [`trajectory`] | where the tip shall be |
//! | [`collocation`] | boundary-value problems |
//! | [`plan`] | from a task to joint motion, deflection and torques |
//! | [`knots`] | from a plan to its feedforward table |
//! | [`integrator`] | one step of a Runge-Kutta method |
//! | [`plant`] | the simulated arm |
//! | [`closed_loop`] | controller and plant in lock-step |
//! | [`stability`] | the sampled loop along the path, margins, tuning |
//! | [`ranges`] | range analysis for fixed point |
//! | [`accuracy`] | how exact f32 and fixed point are |
//! | [`processor`] | the firmware's image in QEMU, or a board: requests and answers |
//! | [`pil`] | a processor in that loop |
//! | [`cases`] | the demo's cases |
//! | [`export`], [`report`] | results as CSV and JSON, pictures and a page |
//! | [`cli`] | the command line |

pub mod accuracy;
pub mod cases;
pub mod cli;
pub mod closed_loop;
pub mod collocation;
pub mod config;
pub mod dynamics;
pub mod export;
pub mod integrator;
pub mod knots;
mod message;
pub mod model;
pub mod pil;
pub mod plan;
pub mod plant;
pub mod processor;
pub mod ranges;
pub mod report;
pub mod stability;
#[cfg(test)]
mod testing;
pub mod trajectory;
