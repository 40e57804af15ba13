//! The feedforward table.
//!
//! | file | responsible for |
//! |---|---|
//! | `format` | the image: header, pieces, rows, checksum; writer and reader |
//! | `cursor` | streaming it, one tick after the other |
//! | `slot` | the places in flash where a table may lie |

mod cursor;
mod format;
mod slot;

pub use cursor::Cursor;
pub use format::*;
pub use slot::*;
