//! The two places in flash where a table may lie, and what is wrong with one.
//!
//! A slot is larger than its table; what follows the table is erased flash or the rest of
//! an older one, and is ignored.

use crate::table::error::TableError;
use crate::table::format::Table;
use serde::{Deserialize, Serialize};

/// A place for a table in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Slot {
    /// The first, preferred.
    A,
    /// The second, used when the first is not valid.
    B,
}

impl Slot {
    /// Both, in the order of preference.
    pub const ALL: [Self; 2] = [Self::A, Self::B];
}

/// Why a slot's table is not usable. Numbers (the variant's index) are stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SlotError {
    /// Shorter or longer than its header says, or than the slot.
    Length,
    /// Does not begin as a table; erased flash, for one.
    Magic,
    /// Another format version.
    Version,
    /// Checksum does not match.
    Crc,
    /// A header field is out of range.
    Field,
    /// Planned for another arm.
    Fingerprint,
    /// Planned for another tick rate than the timer's.
    TickRate,
}

impl SlotError {
    /// What is wrong, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Length => "has not the length that its header says",
            Self::Magic => "holds no table",
            Self::Version => "holds a table of another format version",
            Self::Crc => "holds a table with a wrong checksum",
            Self::Field => "holds a table with a header field out of range",
            Self::Fingerprint => "holds a table for another arm",
            Self::TickRate => "holds a table for another tick rate",
        }
    }
}

impl core::fmt::Display for SlotError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.words())
    }
}

impl core::error::Error for SlotError {}

impl From<TableError> for SlotError {
    fn from(error: TableError) -> Self {
        match error {
            TableError::Length { .. } => Self::Length,
            TableError::Magic { .. } => Self::Magic,
            TableError::Version { .. } => Self::Version,
            TableError::Crc { .. } => Self::Crc,
            TableError::Field { .. } => Self::Field,
            TableError::Fingerprint { .. } => Self::Fingerprint,
        }
    }
}

/// What identifies a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableIdentity {
    /// CRC-32 in the table's header.
    pub crc: u32,
    /// Fingerprint of the arm that it was planned for.
    pub arm_fingerprint: u32,
    /// Fingerprint of the task that it was planned for.
    pub task_fingerprint: u32,
    /// Control periods.
    pub ticks: u32,
}

impl From<&Table<'_>> for TableIdentity {
    fn from(table: &Table<'_>) -> Self {
        Self {
            crc: table.crc(),
            arm_fingerprint: table.header().arm_fingerprint,
            task_fingerprint: table.header().task_fingerprint,
            ticks: table.header().ticks,
        }
    }
}

/// Opens the table at the beginning of a slot's bytes, all checks made, for the arm with
/// this fingerprint and for this tick rate. Without an arm every table is refused. Nothing is
/// copied.
///
/// # Errors
/// The first [`SlotError`] that applies.
pub fn open_slot(
    region: &[u8],
    arm_fingerprint: Option<u32>,
    tick_rate_hz: u32,
) -> Result<Table<'_>, SlotError> {
    let length = Table::stated_bytes(region)?;
    let image = region.get(..length).ok_or(SlotError::Length)?;
    let table = Table::open(image)?;
    table.check_arm(arm_fingerprint.ok_or(SlotError::Fingerprint)?)?;
    if table.header().tick_rate_hz == tick_rate_hz {
        Ok(table)
    } else {
        Err(SlotError::TickRate)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::table::{Header, Piece, TableWriter, image_bytes};
    use std::vec::Vec;

    /// A slot of flash with a table for an arm, for 1,000 ticks a second.
    fn region(arm_fingerprint: u32) -> Vec<u8> {
        let pieces = [Piece {
            ticks: 10,
            segments: 1,
        }];
        let header = Header {
            arm_fingerprint,
            task_fingerprint: 9,
            tick_rate_hz: 1000,
            ticks: 10,
            first_tick: 0,
            scaling: [20; 8],
        };
        let mut image = std::vec![0; image_bytes(&pieces)];
        let mut writer = TableWriter::new(&mut image, &header, &pieces).unwrap();
        for _ in 0..pieces[0].rows() {
            writer.row(&Default::default()).unwrap();
        }
        writer.finish().unwrap();
        image.extend([0xff; 100]);
        image
    }

    #[test]
    fn a_table_is_for_its_arm_and_rate_only() {
        let slot = region(7);
        assert_eq!(open_slot(&slot, Some(7), 1000).unwrap().header().ticks, 10);
        let error = |fingerprint, rate| open_slot(&slot, fingerprint, rate).unwrap_err();
        assert_eq!(error(Some(8), 1000), SlotError::Fingerprint);
        assert_eq!(error(Some(7), 5000), SlotError::TickRate);
        assert_eq!(
            open_slot(&slot[1..], Some(7), 1000).unwrap_err(),
            SlotError::Magic
        );
        assert_eq!(
            open_slot(&slot[..50], Some(7), 1000).unwrap_err(),
            SlotError::Length
        );
    }

    #[test]
    fn without_an_arm_every_table_is_refused() {
        for fingerprint in [0, 7] {
            let error = open_slot(&region(fingerprint), None, 1000).unwrap_err();
            assert_eq!(error, SlotError::Fingerprint);
        }
        // What is wrong with the table itself comes first.
        assert_eq!(
            open_slot(&[0xff; 100], None, 1000).unwrap_err(),
            SlotError::Magic
        );
    }
}
