//! The tables in flash, read in place, and the setup in the image.

use crate::board::constants::TICK_RATE_HZ;
use flexor::link::Setup;
use flexor::table::{Slot, SlotError, Table, open_slot};

/// The setup that the image was built with.
static SETUP: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/setup.bin"));

const TABLE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/table.bin"));

/// The table that the image was built with, at the beginning of slot A. The firmware
/// reads the slot and never this name: another table may have been written there.
// SAFETY: the section lies in its own memory region, for nothing but this.
#[unsafe(link_section = ".table_a")]
#[used]
static TABLE_A: [u8; TABLE.len()] = {
    let mut bytes = [0; TABLE.len()];
    bytes.copy_from_slice(TABLE);
    bytes
};

/// The image's setup; `None` if it is damaged.
pub fn setup() -> Option<Setup> {
    Setup::decode(core::hint::black_box(SETUP))
}

/// A slot's bytes.
fn region(slot: Slot) -> &'static [u8] {
    // SAFETY: memory.x defines them; only their addresses are used.
    unsafe extern "C" {
        static _table_a_start: u8;
        static _table_a_length: u8;
        static _table_b_start: u8;
        static _table_b_length: u8;
    }
    let (start, length) = match slot {
        Slot::A => (&raw const _table_a_start, &raw const _table_a_length),
        Slot::B => (&raw const _table_b_start, &raw const _table_b_length),
    };
    // SAFETY: memory.x reserves these flash bytes for a table; they are readable, and
    // constant while the firmware runs, as it never writes flash.
    unsafe { core::slice::from_raw_parts(start, length.addr()) }
}

/// Opens a slot's table, all checks made, for the arm with this fingerprint; without one
/// every table is refused.
///
/// # Errors
/// The first [`SlotError`] that applies.
pub fn open(slot: Slot, arm_fingerprint: Option<u32>) -> Result<Table<'static>, SlotError> {
    open_slot(region(slot), arm_fingerprint, TICK_RATE_HZ)
}
