//! The firmware's image in QEMU, or a board on a serial line.

pub mod pil;
#[allow(clippy::module_inception)]
mod target;

pub use target::*;
