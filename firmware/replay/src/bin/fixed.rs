//! The replay in fixed point.

#![no_std]
#![no_main]

use flexor::number::fixed::Fixed;

#[cortex_m_rt::entry]
fn main() -> ! {
    flexor_replay::replay::<Fixed>([
        include_bytes!(concat!(env!("OUT_DIR"), "/paper_fixed.bin")),
        include_bytes!(concat!(env!("OUT_DIR"), "/hybrid_fixed.bin")),
    ])
}
