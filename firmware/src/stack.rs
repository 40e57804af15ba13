//! How deep the stack has been: painted at start, the paint looked for later.

const PAINT: u32 = 0x5aa5_c33c;

/// Words just below the stack pointer that are left alone while painting: the frame of
/// the painting function itself.
const MARGIN_WORDS: usize = 32;

// SAFETY: the linker defines both, at the ends of the stack.
unsafe extern "C" {
    static mut _stack_end: u32;
    static _stack_start: u32;
}

/// Paints the unused stack. To be called once, at start.
pub fn paint() {
    let end = (&raw mut _stack_end).addr();
    let free = (cortex_m::register::msp::read() as usize - end) / 4 - MARGIN_WORDS;
    for i in 0..free {
        // SAFETY: from the stack's lowest address to well below the stack pointer; nothing
        // lives there, and no interrupt is enabled yet.
        unsafe { (&raw mut _stack_end).add(i).write_volatile(PAINT) };
    }
}

/// Deepest stack since [`paint`], bytes.
pub fn deepest() -> u32 {
    let length = (&raw const _stack_start).addr() - (&raw const _stack_end).addr();
    let untouched = (0..length / 4)
        .take_while(|i| {
            // SAFETY: within the stack's region, aligned; a volatile read of memory that
            // this function does not use.
            unsafe { (&raw const _stack_end).add(*i).read_volatile() == PAINT }
        })
        .count();
    (length - 4 * untouched) as u32
}
