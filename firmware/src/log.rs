//! defmt's logger. Entries wait in a ring until the main loop sends them over the link,
//! which is the same line in the emulator and on a board: no probe is needed, and none
//! can block. What does not fit is dropped whole and counted.
//!
//! Only code below the tick logs. An interrupt that logs while the code below it does is
//! not mixed in: its entry is dropped.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize, Ordering::Relaxed};
use flexor::link::{LOG_MAX, LogEntry};

/// Bytes of the ring: a start's entries and a few more.
const SIZE: usize = 256;

/// Entries, each a length and its bytes. Indices run on and wrap with the ring.
static RING: [AtomicU8; SIZE] = [const { AtomicU8::new(0) }; SIZE];
/// Where the oldest entry begins. Only [`take`] moves it.
static FIRST: AtomicUsize = AtomicUsize::new(0);
/// Where the newest whole entry ends. Only the logger moves it.
static END: AtomicUsize = AtomicUsize::new(0);
/// Where the entry that is being written has got to.
static NEXT: AtomicUsize = AtomicUsize::new(0);
/// The entry that is being written does not fit.
static TOO_LONG: AtomicBool = AtomicBool::new(false);
/// Entries begun and not ended: 2 when an interrupt logs within another entry.
static DEPTH: AtomicUsize = AtomicUsize::new(0);
static LOST: AtomicU32 = AtomicU32::new(0);

#[defmt::global_logger]
struct Logger;

// SAFETY: interrupts nest, so acquire and release do too, and only the outermost pair,
// DEPTH 1, touches the ring. Loads and stores of one core need no stronger order.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        if DEPTH.fetch_add(1, Relaxed) == 0 {
            NEXT.store(END.load(Relaxed), Relaxed);
            TOO_LONG.store(false, Relaxed);
            put(0); // the length's place
        }
    }

    unsafe fn write(bytes: &[u8]) {
        if DEPTH.load(Relaxed) == 1 {
            // The raw encoding has no state.
            defmt::Encoder::new().write(bytes, |raw| raw.iter().for_each(|byte| put(*byte)));
        }
    }

    unsafe fn release() {
        if DEPTH.fetch_sub(1, Relaxed) != 1 || TOO_LONG.load(Relaxed) {
            LOST.fetch_add(1, Relaxed);
            return;
        }
        let (end, next) = (END.load(Relaxed), NEXT.load(Relaxed));
        RING[end % SIZE].store(next.wrapping_sub(end + 1) as u8, Relaxed);
        END.store(next, Relaxed);
    }

    unsafe fn flush() {}
}

fn put(byte: u8) {
    let at = NEXT.load(Relaxed);
    let entry = at.wrapping_sub(END.load(Relaxed));
    let waiting = at.wrapping_sub(FIRST.load(Relaxed));
    if entry > LOG_MAX || waiting >= SIZE {
        TOO_LONG.store(true, Relaxed);
    } else {
        RING[at % SIZE].store(byte, Relaxed);
        NEXT.store(at.wrapping_add(1), Relaxed);
    }
}

/// Takes the oldest entry out. For the main loop alone.
pub fn take() -> Option<LogEntry> {
    let first = FIRST.load(Relaxed);
    if first == END.load(Relaxed) {
        return None;
    }
    let byte = |i: usize| RING[first.wrapping_add(i) % SIZE].load(Relaxed);
    let length = usize::from(byte(0));
    let entry = (1..=length).map(byte).take(LOG_MAX).collect();
    FIRST.store(first.wrapping_add(1 + length), Relaxed);
    Some(entry)
}

/// Entries lost since start.
pub fn lost() -> u32 {
    LOST.load(Relaxed)
}
