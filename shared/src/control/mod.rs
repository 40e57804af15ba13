//! The controller: what becomes of a setpoint and a measurement.
//!
//! | file | responsible for |
//! |---|---|
//! | `law` | the control law (eq. 18-20) |
//! | `limiter` | torque limits and the finite check behind everything |
//! | `controller` | the one `tick` that joins cursor, law and limiter |

mod controller;
mod law;
mod limiter;

pub use controller::{Coefficients, Command, Controller, Mismatch};
pub use law::{
    Coefficient, ForceProjection, Law, LawParameters, LawState, SlopeRateFeedback, TorqueDemand,
};
pub use limiter::{LimitParameters, TorqueLimiter};
