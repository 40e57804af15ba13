//! The boards. Each implements [`flexor::supervisor::Board`]; to port to another
//! microcontroller, write a folder like [`stm32f405`], with its constants file, and a
//! `memory.x`, and choose it here.

pub mod stm32f405;

/// The board that the image is for.
pub use stm32f405::constants;
pub use stm32f405::{Clocks, Peripherals, Serial, TickBoard, Watchdog, emergency_off};
