//! Replays recorded measurements through the control tick of `shared` on cores without
//! floating point, with each law, and counts instructions. Runs in QEMU and talks to `cargo xtask
//! replay` through files (semihosting), of which each law has its own ([`LAWS`]):
//!
//! - in, measurements: eight words a tick, the bits of theta10, theta20, root slope,
//!   its rate, force, both motor angles, root moment;
//! - out, commands: four words first (counts of 100,000 `nop`s, bytes of a
//!   controller, bytes of stack that a tick takes, runs a count is for), then four words a
//!   tick: the bits of both torques, limits and fault, ticks of the stopwatch.
//!
//! The stopwatch, SysTick, is coarse: one count is 40 to 62 instructions. Each tick is
//! therefore run several times over on copies of the controller, and copying without the
//! tick is counted too and subtracted.

#![no_std]

use core::ffi::CStr;
use core::hint::black_box;
use core::panic::PanicInfo;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{ExceptionFrame, exception};
use flexor::control::{Coefficients, Controller};
use flexor::fault::Fault;
use flexor::number::TableScalar;
use flexor::number::fixed::Fixed;
use flexor::signals::{Measurement, Saturation};
use flexor::table::Table;
use semihosting::fs::File;
use semihosting::io::{Read, Write};
use semihosting::process::exit;

static TABLE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/table.bin"));

/// The files of the laws: measurements and commands.
const LAWS: [(&CStr, &CStr); 2] = [
    (c"paper.measurements.bin", c"paper.commands.bin"),
    (c"hybrid.measurements.bin", c"hybrid.commands.bin"),
];

/// Runs of each tick that are counted together.
const RUNS: u32 = 8;
/// Ticks read and written at once.
const BATCH: usize = 64;
const MEASUREMENT_BYTES: usize = 32;
const COMMAND_BYTES: usize = 16;

/// A number as a word.
pub trait Bits: TableScalar {
    /// The number with these bits.
    fn of_bits(bits: u32) -> Self;
    /// Its bits.
    fn bits(self) -> u32;
}

impl Bits for Fixed {
    fn of_bits(bits: u32) -> Self {
        Self::from_bits(bits.cast_signed())
    }
    fn bits(self) -> u32 {
        self.to_bits().cast_unsigned()
    }
}

impl Bits for f32 {
    fn of_bits(bits: u32) -> Self {
        Self::from_bits(bits)
    }
    fn bits(self) -> u32 {
        self.to_bits()
    }
}

/// What a tick gives to a drive.
struct Output<T> {
    torque: [T; 2],
    saturation: [Saturation; 2],
    fault: Option<Fault>,
}

/// The tick as firmware calls it. Not inlined: it is this function's size that
/// `cargo xtask replay` states.
#[inline(never)]
fn flexor_tick<T: TableScalar>(
    controller: &mut Controller<'static, T>,
    measured: &Measurement<T>,
    output: &mut Output<T>,
) {
    let command = controller.tick(measured);
    output.torque = command.torque;
    output.saturation = command.saturation;
    output.fault = command.fault;
}

/// Counts since another reading, which must be less than a round of the counter ago.
fn since(start: u32) -> u32 {
    start.wrapping_sub(SYST::get_current()) & 0x00ff_ffff
}

/// 1,000 `nop`s. A function of its own, as branches across so many reach too far.
#[inline(never)]
fn nops() {
    // SAFETY: assembles to 1,000 nops and nothing else.
    unsafe { core::arch::asm!(".rept 1000", "nop", ".endr", options(nomem, nostack)) };
}

/// What calling it costs.
#[inline(never)]
fn no_nops() {
    // SAFETY: assembles to nothing.
    unsafe { core::arch::asm!("", options(nomem, nostack)) };
}

/// Counts of 100,000 `nop`s.
fn calibrate() -> u32 {
    let count = |call: fn()| {
        let start = SYST::get_current();
        for _ in 0..100 {
            black_box(call)();
        }
        since(start)
    };
    count(nops) - count(no_nops)
}

/// Stack that `call` takes, bytes, up to 3 KiB.
fn stack_of(call: impl FnOnce()) -> u32 {
    const MARK: u32 = 0x5a5a_a5a5;
    const DEPTH: u32 = 3072;
    // A little below this function's own frame, which may still grow.
    let top = cortex_m::register::msp::read() - 64;
    for address in (top - DEPTH..top).step_by(4) {
        // SAFETY: RAM below the stack in use, 4-byte aligned as the stack pointer is; no
        // interrupt is enabled, so nobody uses it, and the static data end far below.
        unsafe { (address as *mut u32).write_volatile(MARK) };
    }
    call();
    let used = (top - DEPTH..top).step_by(4).find(|address| {
        // SAFETY: as above.
        unsafe { (*address as *const u32).read_volatile() != MARK }
    });
    used.map_or(0, |lowest| top + 64 - lowest)
}

/// Replays everything, each law with its coefficients, and ends the emulation.
pub fn replay<T: Bits>(coefficients: [&[u8]; 2]) -> ! {
    let done = start_stopwatch().is_some()
        && LAWS
            .into_iter()
            .zip(coefficients)
            .all(|(files, coefficients)| run::<T>(coefficients, files).is_some());
    exit(if done { 0 } else { 3 })
}

fn start_stopwatch() -> Option<()> {
    let mut systick = cortex_m::Peripherals::take()?.SYST;
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(0x00ff_ffff);
    systick.clear_current();
    systick.enable_counter();
    Some(())
}

/// A measurement as the host wrote it: eight numbers' bits.
fn measurement<T: Bits>(bytes: &[u8; MEASUREMENT_BYTES]) -> Measurement<T> {
    let (words, _) = bytes.as_chunks::<4>();
    let word = |i: usize| T::of_bits(words.get(i).map_or(0, |bytes| u32::from_le_bytes(*bytes)));
    Measurement {
        angle: [word(0), word(1)],
        root_slope: word(2),
        root_slope_rate: word(3),
        force: word(4),
        motor: [word(5), word(6)],
        root_moment: word(7),
        drive: [Saturation::None; 2],
    }
}

/// What the host reads of a tick: both torques' bits, saturations and fault, instructions.
fn answer<T: Bits>(output: &Output<T>, counts: u32) -> [u32; 4] {
    let side = |saturation| match saturation {
        Saturation::None => 0,
        Saturation::Upper => 1,
        Saturation::Lower => 2,
    };
    let [first, second] = output.saturation.map(side);
    let fault = output.fault.map_or(0, Fault::number);
    let state = u32::from_le_bytes([first, second, fault, 0]);
    [
        output.torque[0].bits(),
        output.torque[1].bits(),
        state,
        counts,
    ]
}

/// Replays one law. Not inlined, or the image has it twice.
#[inline(never)]
fn run<T: Bits>(coefficients: &[u8], (measurements, commands): (&CStr, &CStr)) -> Option<()> {
    let coefficients: Coefficients<T> = postcard::from_bytes(coefficients).ok()?;
    let table = Table::open(TABLE).ok()?;
    let mut controller = Controller::with(&table, &coefficients).ok()?;
    let mut output = Output {
        torque: [T::ZERO; 2],
        saturation: [Saturation::None; 2],
        fault: None,
    };
    let mut input = File::open(measurements).ok()?;
    let mut commands = File::create(commands).ok()?;
    let stack = stack_of(|| flexor_tick(&mut controller, &Measurement::default(), &mut output));
    controller.restart();
    let size = size_of::<Controller<T>>() as u32;
    for word in [calibrate(), size, stack, RUNS] {
        commands.write_all(&word.to_le_bytes()).ok()?;
    }

    let mut measurements = [0; BATCH * MEASUREMENT_BYTES];
    let mut answers = [0; BATCH * COMMAND_BYTES];
    loop {
        let length = input.read(&mut measurements).ok()?;
        if length == 0 {
            return Some(());
        }
        let (batch, _) = measurements.get(..length)?.as_chunks::<MEASUREMENT_BYTES>();
        let (places, _) = answers.as_chunks_mut::<COMMAND_BYTES>();
        for (bytes, place) in batch.iter().zip(places) {
            let measured = measurement(bytes);
            let start = SYST::get_current();
            for _ in 0..RUNS {
                let mut copy = controller.clone();
                flexor_tick(black_box(&mut copy), &measured, black_box(&mut output));
            }
            let both = since(start);
            let start = SYST::get_current();
            for _ in 0..RUNS {
                let mut copy = controller.clone();
                black_box(&mut copy);
                black_box(&mut output);
            }
            let counts = both.saturating_sub(since(start));
            flexor_tick(&mut controller, &measured, &mut output);
            let words = answer(&output, counts);
            let (place, _) = place.as_chunks_mut::<4>();
            for (place, word) in place.iter_mut().zip(words) {
                *place = word.to_le_bytes();
            }
        }
        let written = batch.len() * COMMAND_BYTES;
        commands.write_all(answers.get(..written)?).ok()?;
    }
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    exit(101)
}

// SAFETY: it only ends the run.
#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    exit(102)
}
