//! The board and the arm in lock-step: from counts to counts, along a plan.
//!
//! ```text
//! plant -> sensors -> counts -> Supervisor (sensing, monitor, controller, limits) -> counts
//!       -> drives -> plant
//! ```
//!
//! The middle is [`flexor::supervisor::Supervisor`] itself, on a board in memory: what a
//! microcontroller runs, in f32. No stage that a board has is left out; what a perfect board
//! would do is [`crate::simulation::closed_loop`].
//!
//! | file | responsible for |
//! |---|---|
//! | `arm` | one arm on the bench, and the board before it |
//! | `bench` | several of them, tick by tick |
//! | `rig` | what is around a board: sensors, drives, lines, faults |
//! | `lane` | one board in the loop |
//! | `virtual_board` | one that answers the link's requests, as a board on a cable |
//! | `injection` | faults at given times |
//! | `recorded` | a run as a board tells it |
//! | `figures`, `log` | what comes of a run: its figures alone, or everything |
//!
//! **Words.** A *lane* is one of the arms that advance side by side
//! ([`crate::plant::bench::lanes`]). *Along* is the place along the planned surface.

mod arm;
#[expect(clippy::module_inception, reason = "the wing's main file has its name")]
mod bench;
mod figures;
mod injection;
mod lane;
mod log;
mod recorded;
mod rig;
mod virtual_board;

pub use arm::{ArmKind, BenchArm, BenchBoard, BenchError, Course};
pub use bench::{BenchRow, BenchTask, Then, refusal, run};
pub use figures::{FIGURES, FailureLimits, Figure, RunFigures};
pub use injection::{
    AnalogChannel, AnalogFault, FAULT_NAMES, FaultKind, FaultName, TimedFault, WISH_NAMES,
};
pub use log::BenchLog;
pub use recorded::RecordedRun;
pub use virtual_board::{VirtualBoard, VirtualPlaces, VirtualSetting};
