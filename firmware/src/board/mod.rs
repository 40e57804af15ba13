//! The boards. One implements the traits of [`flexor::supervisor`]; to port to another
//! microcontroller, write a module like [`stm32f405`], its constants file, and a
//! `memory.x`, and choose it here.

pub mod stm32f405;

/// The board that the image is for.
pub use stm32f405::constants;
pub use stm32f405::{Board, Clocks, Serial, TickBoard, Watchdog, emergency_off};
