//! The firmware's image in QEMU, or a board on a serial line.

mod error;
mod layout;
mod line;
mod log;
pub mod pil;
mod qemu;
mod session;
#[allow(clippy::module_inception)]
mod target;

pub use error::{TargetError, describe_start};
pub use layout::{DEFAULT_ELF, SLOT_ADDRESSES, SLOT_BYTES};
pub use line::BAUD;
pub use log::Logs;
pub use qemu::Emulation;
pub use target::Target;
