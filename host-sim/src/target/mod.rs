//! The firmware's image in QEMU, a board on a serial line or on TCP, or a virtual one.

#[cfg(feature = "target")]
mod error;
mod layout;
#[cfg(feature = "target")]
mod line;
#[cfg(feature = "target")]
mod log;
#[cfg(feature = "target")]
pub mod pil;
#[cfg(feature = "target")]
mod qemu;
#[cfg(feature = "target")]
mod session;
#[cfg(feature = "target")]
#[expect(clippy::module_inception, reason = "the wing's main file has its name")]
mod target;
#[cfg(feature = "target")]
mod virtual_line;
#[cfg(feature = "target")]
mod virtual_server;
#[cfg(feature = "target")]
mod virtual_within;

#[cfg(feature = "target")]
pub use error::{TargetError, describe_start};
pub use layout::{DEFAULT_ELF, SLOT_ADDRESSES, SLOT_BYTES};
#[cfg(feature = "target")]
pub use log::Logs;
#[cfg(feature = "target")]
pub use qemu::Emulation;
#[cfg(feature = "target")]
pub use target::Target;
#[cfg(feature = "target")]
pub use virtual_server::{Listen, ServeError, serve};
#[cfg(feature = "target")]
pub use virtual_within::{LineWithin, start_within};
