//! Which program a board is asked to run.

use crate::link::report::Identity;
use crate::table::Slot;
use serde::{Deserialize, Serialize};

/// Everything that decides what an enabled arm does, by checksums: a host says with them what it means
/// to run, and a board that has anything else refuses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Program {
    /// CRC-32 in the table's header.
    pub table_crc: u32,
    /// Fingerprint of the task that it was planned for.
    pub task_fingerprint: u32,
    /// CRC-32 of the setup: arm, law, limits, monitors ([`Setup::crc`](crate::link::Setup::crc)).
    pub setup_crc: u32,
}

impl Program {
    /// What a board with this identity would run from a slot; `None` where it has no usable table there,
    /// or no setup.
    pub fn of(identity: &Identity, slot: Slot) -> Option<Self> {
        let table = match slot {
            Slot::A => identity.slots[0],
            Slot::B => identity.slots[1],
        };
        let (table, setup_crc) = (table.ok()?, identity.setup_crc?);
        Some(Self {
            table_crc: table.crc,
            task_fingerprint: table.task_fingerprint,
            setup_crc,
        })
    }
}
