//! What remains of a panic or a fault: the drives are switched off first, the reason goes
//! into RAM that the reset does not clear, and the next start reports it.

use crate::board::stm32f405::emergency_off;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use shared::link::StartReason;

const PANIC: u32 = 0x504e_4943;
const FAULT: u32 = 0x4641_4c54;

/// Kind, two values, and their check word. Random after power-up, which the check word
/// tells.
// SAFETY: atomics may hold any bits, so this section's lack of initialisation is harmless.
#[unsafe(link_section = ".uninit.last_words")]
static WORDS: [AtomicU32; 4] = [const { AtomicU32::new(0) }; 4];

fn check(kind: u32, a: u32, b: u32) -> u32 {
    !(kind ^ a.rotate_left(8) ^ b.rotate_left(16))
}

/// Leaves the reason and starts again.
fn reset(kind: u32, a: u32, b: u32) -> ! {
    for (word, value) in WORDS.iter().zip([kind, a, b, check(kind, a, b)]) {
        word.store(value, Ordering::Relaxed);
    }
    SCB::sys_reset()
}

/// The reason for this start; forgets it.
pub fn take(watchdog_reset: bool) -> StartReason {
    let [kind, a, b, stored] = [0, 1, 2, 3].map(|i| WORDS[i].swap(0, Ordering::Relaxed));
    let valid = stored == check(kind, a, b);
    match kind {
        PANIC if valid => StartReason::Panic { line: a, file: b },
        FAULT if valid => StartReason::HardFault { pc: a, status: b },
        _ if watchdog_reset => StartReason::Watchdog,
        _ => StartReason::Normal,
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    emergency_off();
    let (line, file) = info.location().map_or((0, 0), |place| {
        let crc = crc::Crc::<u32, crc::NoTable>::new(&crc::CRC_32_ISO_HDLC);
        (place.line(), crc.checksum(place.file().as_bytes()))
    });
    reset(PANIC, line, file)
}

// SAFETY: touches nothing that the interrupted code may hold, and does not return.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    emergency_off();
    // SAFETY: a read without side effects of a register that always exists.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    reset(FAULT, frame.pc(), status)
}
