//! Where a run is: names that commands, logs and links carry.

use core::fmt;
use serde::{Deserialize, Serialize};

/// Where a run is, from approach to hold. The paper's law knows `Follow` alone. Numbers are stable:
/// logs carry them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Phase {
    /// Follows a table that presses on nothing, in the air.
    Free,
    /// Moves towards the surface.
    Approach,
    /// On the surface: the force rises to the plan's, and the law settles.
    Contact,
    /// Follows the table.
    #[default]
    Follow,
    /// Has lost contact.
    Lost,
    /// Stops, takes the force away and lifts the tip off.
    Retract,
    /// Stands where a run was left, drives on.
    Hold,
    /// Stands where a move through the air was to end, drives on.
    Park,
}

impl Phase {
    /// Stable number, from 0 for free to 7 for park.
    pub fn number(self) -> u8 {
        self as u8
    }

    /// Whether the arm stands, and another table may begin.
    pub fn stands(self) -> bool {
        matches!(self, Self::Hold | Self::Park)
    }

    /// Stable name in snake case, as logs and summaries show it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Approach => "approach",
            Self::Contact => "contact",
            Self::Follow => "follow",
            Self::Lost => "lost",
            Self::Retract => "retract",
            Self::Hold => "hold",
            Self::Park => "park",
        }
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
