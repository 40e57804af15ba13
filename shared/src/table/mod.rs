//! The feedforward table.
//!
//! | file | responsible for |
//! |---|---|
//! | `format` | the image: header, pieces, rows, checksum; the table that is read in place |
//! | `layout` | its sizes and marks |
//! | `error` | why an image is not a usable table |
//! | `writer` | writing an image |
//! | `cursor` | streaming a table, one tick after the other |
//! | `slot` | the places in flash where a table may lie |

mod cursor;
mod error;
mod format;
mod layout;
mod slot;
mod writer;

pub use cursor::Cursor;
pub(crate) use cursor::Links;
pub use error::TableError;
pub use format::{Header, Piece, Table};
pub use layout::{HEADER_BYTES, MAGIC, PIECE_BYTES, PIECES_MAX, RAW_MAX, ROW_BYTES, VERSION};
pub use slot::{Slot, SlotError, TableIdentity, open_slot};
pub use writer::{TableWriter, image_bytes, scaling_for};
