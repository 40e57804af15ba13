//! What the control tick needs from a board, as small traits. A port to another
//! microcontroller implements these and nothing else.
//!
//! No function of these waits for anything, and none can fail: what is not there is
//! reported as not fresh, not well, not released.

use crate::safety::Interlocks;
use crate::sensing::RawSample;

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

/// All that the tick's interrupt uses.
#[derive(Debug)]
pub struct TickBoard<S, D, T, W> {
    /// Encoders and converters.
    pub sensors: S,
    /// Torque commands, enable lines and the inputs beside them.
    pub drives: D,
    /// The control period.
    pub timebase: T,
    /// Measures the tick.
    pub stopwatch: W,
}
