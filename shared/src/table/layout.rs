//! Sizes and marks of a table image.

use crate::signals::COLUMNS;

/// Bytes of one row.
pub const ROW_BYTES: usize = 4 * COLUMNS;
/// Bytes before the list of pieces.
pub const HEADER_BYTES: usize = 52;
/// Bytes of a piece's entry.
pub const PIECE_BYTES: usize = 8;
/// Most pieces of a table.
pub const PIECES_MAX: usize = 64;
/// Format version that this crate writes and reads.
pub const VERSION: u16 = 2;
/// First bytes of every image.
pub const MAGIC: [u8; 4] = *b"FLXT";
/// Largest magnitude of a stored integer: a bit is left free so that sums of two
/// cannot overflow.
pub const RAW_MAX: i32 = 1 << 30;
