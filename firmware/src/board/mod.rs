//! What the firmware needs from a board, as small traits. To port to another
//! microcontroller, write a module like [`stm32f405`] that implements them, its
//! constants file, and a `memory.x`.

pub mod constants;
pub mod stm32f405;

use shared::safety::Interlocks;
use shared::sensing::RawSample;

/// Encoders and converters.
pub trait Sensors {
    /// The latest counts. Never waits: what has not been converted is not `fresh`.
    fn sample(&mut self) -> RawSample;
}

/// The two current-controlled drives.
pub trait Drives {
    /// Enables the drives and commands torques, N m. Values beyond what the drives take
    /// are cut off.
    fn command(&mut self, torque: [f32; 2]);

    /// Torques zero, drives disabled.
    fn off(&mut self);
}

/// Emergency stop and drive fault inputs.
pub trait Inputs {
    /// Their state now.
    fn interlocks(&self) -> Interlocks;
}

/// The control period's timer, whose interrupt runs the tick.
pub trait Timebase {
    /// Clears the timer's request; true if there was one (and the interrupt was not
    /// requested by software alone).
    fn acknowledge(&mut self) -> bool;

    /// True when the timer has asked again already.
    fn due(&self) -> bool;

    /// Starts or stops the timer.
    fn run(&mut self, run: bool);
}

/// A free-running counter for measuring short times.
pub trait Stopwatch {
    /// Counts, wrapping.
    fn counts(&self) -> u32;
}
