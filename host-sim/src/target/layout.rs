//! What is known of the firmware's image without running it: where it is built, and where
//! tables lie in the flash.

/// Addresses of table slots A and B, as in `memory.x`.
pub const SLOT_ADDRESSES: [u32; 2] = [0x0802_0000, 0x0804_0000];

/// Bytes of a table slot, as in `memory.x`.
pub const SLOT_BYTES: usize = 128 * 1024;

/// Where `cargo xtask firmware` leaves the image, seen from the project's top folder.
pub const DEFAULT_ELF: &str = "target/firmware/thumbv7em-none-eabihf/release/firmware";
