//! The controller: what becomes of a setpoint and a measurement.
//!
//! | file | responsible for |
//! |---|---|
//! | `law` | which law acts |
//! | `feedback` | what the controller wants of a law |
//! | `paper` | the paper's law (eq. 18-20) |
//! | `hybrid` | the hybrid law: joint 1 holds the place, joint 2 makes the force |
//! | `hybrid_coefficients` | what its coefficients are after rounding |
//! | `hybrid_parameters` | its gains, as a file gives them |
//! | `motion` | its course: free, approach, contact, follow, lost, retract, hold, park |
//! | `motion_forces` | the forces by which it tells contact from none |
//! | `handover` | from one table to the next without a step |
//! | `motion_parameters` | its thresholds, speeds and times |
//! | `progress` | how far the table goes on in a tick |
//! | `slowed` | joint 1's torque where the table goes slower than planned |
//! | `filter` | the low-pass of both |
//! | `limiter` | torque limits and the finite check behind everything |
//! | `controller` | the one `tick` that joins cursor, law and limiter |

mod controller;
mod feedback;
mod filter;
mod handover;
mod hybrid;
mod hybrid_coefficients;
mod hybrid_parameters;
#[cfg(test)]
mod hybrid_tests;
mod law;
mod limiter;
mod motion;
mod motion_forces;
mod motion_parameters;
#[cfg(test)]
mod motion_tests;
mod paper;
mod progress;
mod slowed;
#[cfg(test)]
mod slowed_tests;

pub use controller::{Coefficients, Command, Controller, Mismatch};
pub use feedback::Coefficient;
pub use hybrid::{HybridDemand, HybridLaw, HybridState, RATE_MAX_RAD_S};
pub use hybrid_parameters::{FreeParameters, HybridParameters};
pub use law::{Law, LawParameters};
pub use limiter::{LimitParameters, TorqueLimiter};
pub use motion_parameters::MotionParameters;
pub use paper::{
    ForceProjection, PaperDemand, PaperLaw, PaperParameters, PaperState, SlopeRateFeedback,
};
