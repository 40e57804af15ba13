//! Around the controller: when it may drive the arm, and the tick as a board runs it.
//!
//! | file | responsible for |
//! |---|---|
//! | `supervisor` | the body of the control interrupt, and what the main loop asks of it |
//! | `state` | disabled, enabled, lock-step: what each carries, and every transition |
//! | `controller_slot` | where controllers live, and how the next one is handed over |
//! | `enabling` | when the drives may be enabled, and when they must not stay so |
//! | `monitors` | what of an enabled arm's motion and sensors cannot be |
//! | `sensing` | from encoder and converter counts to a measurement |
//! | `requests` | what a board's main loop does with the host's requests |
//! | `parameters` | what a controller is made from, and its form on the wire |
//! | `board` | what the tick needs from a board |
//! | `board_parameters` | what a board is like, and what follows from it |
//! | `memory_board` | a board that is values in memory, for tests and simulators |

mod board;
mod board_parameters;
mod controller_slot;
mod enabling;
mod memory_board;
mod monitors;
mod parameters;
mod requests;
mod sensing;
mod soft_start;
mod state;
#[expect(clippy::module_inception, reason = "the wing's main file has its name")]
mod supervisor;

pub use board::{Board, DriveScale};
pub use board_parameters::{BoardParameters, ConverterScale};
pub use controller_slot::{ControllerSlot, MonitoredController};
pub use enabling::{
    EnableInputs, FaultMonitor, InputHealth, SafetyLimits, StartPose, check_enable,
    check_torque_bound, each_obstacle, select_table,
};
pub use memory_board::MemoryBoard;
pub use monitors::{MonitorParameters, Monitors};
pub use parameters::ControllerParameters;
pub use requests::{BoardConstants, BoardFacts, BoardHealth, Event, RequestHandler, Services};
/// What is reached under a lock, and what is one's own anyhow.
pub use rtic_core::{Exclusive, Mutex};
pub use sensing::{Calibration, Sensing};
pub use supervisor::{Supervisor, SupervisorStatus};
