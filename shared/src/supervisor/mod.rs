//! Around the controller: when it may drive the arm, and the tick as a board runs it.
//!
//! | file | responsible for |
//! |---|---|
//! | `supervisor` | the modes, and the body of the control interrupt |
//! | `arming` | when the drives may be enabled, and when they must not stay so |
//! | `sensing` | from encoder and converter counts to a measurement |
//! | `board` | what the tick needs from a board |

mod arming;
mod board;
mod sensing;
#[allow(clippy::module_inception)]
mod supervisor;

pub use arming::*;
pub use board::*;
pub use sensing::*;
pub use supervisor::*;
