//! What remains of a panic or a fault: the drives are switched off first, the reason goes
//! into RAM that the reset does not clear, and the next start reports it.

use crate::board::emergency_off;
use core::arch::naked_asm;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::SCB;
use flexor::link::StartReason;

const PANIC: u32 = 0x504e_4943;
const FAULT: u32 = 0x4641_4c54;
const STACK: u32 = 0x5354_4143;

/// Kind, two values, and their check word. Random after power-up, which the check word
/// tells.
// SAFETY: atomics may hold any bits, so this section's lack of initialisation is harmless.
#[unsafe(link_section = ".uninit.crash_record")]
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
        STACK if valid => StartReason::StackOverflow { status: b },
        _ if watchdog_reset => StartReason::Watchdog,
        _ => StartReason::Normal,
    }
}

/// An exception or interrupt that nothing expects: the non-maskable interrupt, say.
// SAFETY: touches nothing that the interrupted code uses; it does not return.
#[cortex_m_rt::exception]
unsafe fn DefaultHandler(_number: i16) -> ! {
    panic!("unexpected exception")
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

/// The vector's target. Not cortex-m-rt's trampoline, for that goes on with the stack as
/// it is: after an overflow the handler's first push would lock the core up.
///
/// # Safety
/// For the hardware to call.
// SAFETY: the name that cortex-m-rt's vector table has for the handler.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
unsafe extern "C" fn hard_fault_entry() -> ! {
    naked_asm!(
        "mrs r0, msp", // the frame that the hardware pushed
        "ldr r1, =_fault_stack_start",
        "mov sp, r1",
        "b {handler}",
        handler = sym hard_fault,
    )
}

/// Goes on with a HardFault on a stack of its own, with interrupts held off by priority.
extern "C" fn hard_fault(frame: *const u32) -> ! {
    /// Place of the program counter in the frame: after r0 to r3, r12 and lr.
    const PC: usize = 6;
    /// Bytes that an instruction may push at once: all registers that a function saves, 9 of
    /// the core's and 16 of the floating-point unit's, and some. Where such a push goes beyond
    /// the stack's end, the frame, being smaller, may still fit above it.
    const LARGEST_PUSH: usize = 128;
    // SAFETY: the linker defines both; only their addresses are used.
    unsafe extern "C" {
        static _stack_end: u32;
        static _stack_start: u32;
    }
    emergency_off();
    // SAFETY: a read without side effects of a register that always exists.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    let stack = (&raw const _stack_end).addr() + LARGEST_PUSH..(&raw const _stack_start).addr();
    if stack.contains(&frame.addr()) {
        // SAFETY: within the stack, where the hardware has just written it.
        let pc = unsafe { frame.add(PC).read() };
        reset(FAULT, pc, status)
    }
    reset(STACK, 0, status)
}
