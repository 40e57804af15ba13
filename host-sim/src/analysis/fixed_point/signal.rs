//! A signal's range and format in fixed point, and where it is in the list of all.

use flexor::number::fixed::Exponent;

/// A signal's range and format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Signal {
    /// Its name, as in [`flexor::signals::SaturationCounts::entries`] where it is there.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Largest admissible magnitude.
    pub admissible: f64,
    /// The format.
    pub exponent: Exponent,
}

/// Positions in the list of signals.
pub(super) const TORQUE2: usize = 1;
pub(super) const FORCE: usize = 2;
pub(super) const ROOT_SLOPE: usize = 3;
pub(super) const SLOPE_RATE: usize = 4;
pub(super) const MOMENT_ARM: usize = 5;
