//! The wire between host and microcontroller.
//!
//! | file | responsible for |
//! |---|---|
//! | `message` | the messages, byte by byte |
//! | `frame` | their frames on a byte stream: COBS and CRC |

mod frame;
mod message;

pub use frame::*;
pub use message::*;
