//! What an enabled arm's board streams while it runs.

use crate::fault::Fault;
use crate::link::report::RawSample;
use crate::phase::Phase;
use crate::signals::Saturation;
use serde::{Deserialize, Serialize};

/// Samples that may wait for the main loop.
pub const TELEMETRY_QUEUE: usize = 8;

/// One tick of an enabled arm: what it read, and what it commanded then. In counts, as the tick has them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TelemetrySample {
    /// Ticks since the board's start; wraps. A step of other than what was asked for is a gap.
    pub tick: u32,
    /// Tick of the table.
    pub table_tick: u32,
    /// Where the run is.
    pub phase: Phase,
    /// The table has begun.
    pub begun: bool,
    /// The first torques have been raised, and the brakes are open.
    pub open: bool,
    /// The latched fault, or the one for which the arm has left its table.
    pub fault: Option<Fault>,
    /// Encoders, force cell and strain gauge.
    pub raw: RawSample,
    /// Torques commanded, N m; 0 with the drives off.
    pub torque: [f32; 2],
    /// How they were limited.
    pub saturation: [Saturation; 2],
    /// What the law's integral of the force error holds, N.
    pub force_integral: f32,
}
