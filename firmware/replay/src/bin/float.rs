//! The replay in f32, which these cores have to emulate.

#![no_std]
#![no_main]

#[cortex_m_rt::entry]
fn main() -> ! {
    flexor_replay::replay::<f32>([
        include_bytes!(concat!(env!("OUT_DIR"), "/paper_float.bin")),
        include_bytes!(concat!(env!("OUT_DIR"), "/hybrid_float.bin")),
    ])
}
