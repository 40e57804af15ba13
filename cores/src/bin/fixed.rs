//! The replay in fixed point.

#![no_std]
#![no_main]

use shared::fixed_point::Fixed;

#[cortex_m_rt::entry]
fn main() -> ! {
    cores::replay::<Fixed>(include_bytes!(concat!(env!("OUT_DIR"), "/fixed.bin")))
}
