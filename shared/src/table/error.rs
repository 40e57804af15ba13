//! Why an image is not a usable table.

use crate::table::layout::{MAGIC, VERSION};
use core::fmt;

/// Why an image is not a usable table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableError {
    /// Shorter than its header or than its header says, or followed by other bytes.
    Length {
        /// Bytes that the image should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// Does not begin with [`MAGIC`]; erased flash, for one.
    Magic {
        /// What it begins with.
        found: [u8; 4],
    },
    /// Another format version.
    Version {
        /// The image's version.
        found: u16,
    },
    /// Checksum does not match: corrupted.
    Crc {
        /// Checksum in the header.
        stored: u32,
        /// Checksum of the bytes.
        computed: u32,
    },
    /// A field of the header, or of a piece, has a value that no writer produces.
    Field {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        found: i64,
        /// The least and the largest that are accepted.
        accepted: [i64; 2],
    },
    /// Planned for another arm.
    Fingerprint {
        /// The arm at hand.
        expected: u32,
        /// The table's arm.
        found: u32,
    },
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { expected, found } => write!(
                f,
                "table image has {found} bytes where {expected} are expected: truncated or not a table"
            ),
            Self::Magic { found } => {
                write!(
                    f,
                    "table image begins with {found:02x?}, expected {MAGIC:02x?} (\"FLXT\")"
                )
            }
            Self::Version { found } => {
                write!(
                    f,
                    "table format version is {found}, this program reads {VERSION}"
                )
            }
            Self::Crc { stored, computed } => write!(
                f,
                "table checksum is {stored:#010x}, its bytes give {computed:#010x}: corrupted"
            ),
            Self::Field {
                name,
                found,
                accepted: [least, most],
            } => {
                write!(f, "table field '{name}' is {found}, {least} ")?;
                if most > least {
                    write!(f, "to {most} ")?;
                }
                f.write_str("is accepted: corrupted or not a table")
            }
            Self::Fingerprint { expected, found } => write!(
                f,
                "table was planned for arm {found:#010x}, this arm is {expected:#010x}: plan it again"
            ),
        }
    }
}

impl core::error::Error for TableError {}
