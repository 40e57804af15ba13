//! Around the controller: when it may drive the arm, and the tick as a board runs it.
//!
//! | file | responsible for |
//! |---|---|
//! | `supervisor` | the modes, and the body of the control interrupt |
//! | `enabling` | when the drives may be enabled, and when they must not stay so |
//! | `sensing` | from encoder and converter counts to a measurement |
//! | `board` | what the tick needs from a board |

mod board;
mod enabling;
mod sensing;
#[allow(clippy::module_inception)]
mod supervisor;

pub use board::*;
pub use enabling::*;
pub use sensing::*;
pub use supervisor::*;
