//! Every number of the default board, each with where it comes from.

use flexor::link::BAUD;
use flexor::supervisor::{Calibration, DriveScale, SafetyLimits};

// --- Clocks ------------------------------------------------------------------------

/// Crystal, Hz: 8 MHz, as on the Olimex STM32-H405.
pub const CRYSTAL_HZ: u32 = 8_000_000;
/// Internal oscillator, Hz (reference manual RM0090, 7.2.2), good to 1 %.
pub const INTERNAL_HZ: u32 = 16_000_000;
/// Core clock with PLL, Hz: the part's maximum.
pub const CORE_PLL_HZ: u32 = 168_000_000;
/// Clock of APB1 with PLL, Hz: its maximum. Its timers, TIM2 to TIM5, get twice that.
pub const APB1_PLL_HZ: u32 = CORE_PLL_HZ / 4;
/// Clock of APB2 with PLL, Hz: its maximum. USART1 and the converters get it.
pub const APB2_PLL_HZ: u32 = CORE_PLL_HZ / 2;
/// Polls after which the crystal counts as dead. A poll takes at least 5 cycles of the
/// internal oscillator's 16 MHz, so this is 60 ms or more; crystals start within 10 ms.
pub const CRYSTAL_POLLS: u32 = 200_000;
/// Polls after which the PLL counts as not locking: 3 ms; it locks within 0.3 ms
/// (datasheet, table 36).
pub const PLL_POLLS: u32 = 10_000;

// --- Control period ---------------------------------------------------------------------

/// Control rate, Hz. 84 MHz and 16 MHz are both multiples of it, so that it is exact
/// with the PLL and without.
pub const TICK_RATE_HZ: u32 = 5_000;
/// Timer counts from the converter's trigger to the tick. Two channels take 84 cycles of
/// sampling and 12 of conversion each, at APB2's clock over 4: 2 * 96 * 4 = 768 counts
/// of the timer, whose clock equals APB2's with the PLL and without; a quarter more for
/// safety. 11.4 us at 84 MHz.
pub const CONVERSION_LEAD_COUNTS: u32 = 960;

// --- Link ------------------------------------------------------------------------------

/// Bytes of the receive queue: two of the longest frames.
pub const RECEIVE_QUEUE: usize = 512;
/// Bytes of the transmit queue: two of the longest frames, and the one place that the
/// queue keeps free.
pub const TRANSMIT_QUEUE: usize = 512;

// --- Watchdog ----------------------------------------------------------------------------

/// Time until the watchdog resets, ms. It has steps of 8 ms and rounds up, to 56 ms, by a
/// clock of nominally 32 kHz that is 17 to 47 kHz over parts and temperature: 38 to 105 ms.
/// The longest that the main loop is away is to open two tables, some 7 cycles a byte: two full
/// slots (256 KiB) take 11 ms at 168 MHz. At 16 MHz, crystal and PLL both broken, it is 4 ms for
/// two tables of the demo's 4.5 KB, and more than 40 KB each could outlast the watchdog.
pub const WATCHDOG_MS: u32 = 50;

/// Core cycles after which the main loop wakes at the latest, to feed the watchdog: 10 ms
/// at 16 MHz, 1 ms at 168 MHz.
pub const WAKE_CYCLES: u32 = INTERNAL_HZ / 100;

// --- Sensors ---------------------------------------------------------------------------

/// Encoder lines a motor turn.
const ENCODER_LINES: f32 = 4096.0;
/// Counts a motor turn: both edges of both tracks.
const ENCODER_COUNTS: f32 = 4.0 * ENCODER_LINES;
/// Motor turns a joint turn. A geared motor passes 65,536 / 16,384 = 4 turns before
/// the count wraps; a tick sees a fraction of a turn.
const GEAR: f32 = 1.0;
/// Joint angle a count, rad.
const ENCODER_RAD: f32 = core::f32::consts::TAU / (ENCODER_COUNTS * GEAR);
/// Force a converter count, N: the amplifier maps -20 to 20 N onto 0 to 3.3 V, 12 bits.
const FORCE_N: f32 = 40.0 / 4096.0;
/// Root slope a converter count, rad: the bridge amplifier maps -0.5 to 0.5 rad onto 0 to 3.3 V.
const SLOPE_RAD: f32 = 1.0 / 4096.0;
/// Converter count of half the range: no force, no bending.
const HALF_RANGE: f32 = 2048.0;

/// How counts become SI values.
pub const CALIBRATION: Calibration = Calibration {
    encoder_rad: [ENCODER_RAD, ENCODER_RAD],
    // At its home stops the arm hangs straight down.
    home_rad: [core::f32::consts::FRAC_PI_2, 0.0],
    force_n: (FORCE_N, HALF_RANGE),
    slope_rad: (SLOPE_RAD, HALF_RANGE),
    // 13 mV from either rail, where an amplifier of single supply still gets, is 16 counts.
    range: (16, 4079),
};

// --- Drives ------------------------------------------------------------------------------

/// Torques at the ends of the drives' analog range, N m: a current-controlled drive
/// that takes -10 to 10 V behind a level shifter from 0 to 3.3 V.
const DRIVE_FULL_SCALE_NM: [f32; 2] = [40.0, 4.0];
/// Largest torques that the drives can be asked for, N m. The converter's output buffer ends
/// 0.2 V from either rail (datasheet, DAC characteristics): 1.45 V of 1.65 V. The law's own limits are
/// never wider when the arm is enabled.
pub const DRIVE_LIMIT_NM: [f64; 2] = {
    let usable = 1.45 / 1.65;
    [
        usable * DRIVE_FULL_SCALE_NM[0] as f64,
        usable * DRIVE_FULL_SCALE_NM[1] as f64,
    ]
};
/// Count of the digital-analog converter (12 bits) that commands no torque.
pub const DAC_ZERO: u16 = 2048;
/// How the drives' torques become counts.
pub const DRIVES: [DriveScale; 2] = [
    DriveScale {
        zero: DAC_ZERO,
        full_scale_nm: DRIVE_FULL_SCALE_NM[0],
    },
    DriveScale {
        zero: DAC_ZERO,
        full_scale_nm: DRIVE_FULL_SCALE_NM[1],
    },
];

// --- Safety ----------------------------------------------------------------------------

/// Limits for enabling and for staying enabled.
pub const SAFETY: SafetyLimits = SafetyLimits {
    // The law corrects force, not position: 0.01 rad at either joint is 5 mm at the tip.
    start_rad: [0.01, 0.01, 0.02],
    // 100 ms: a host that asks for the status 50 times a second may miss four.
    link_timeout_ticks: TICK_RATE_HZ / 10,
};

const _: () = {
    // TIM2's clock and APB2's are equal with the PLL and without.
    let [fast, slow] = [APB2_PLL_HZ, INTERNAL_HZ];
    assert!(2 * APB1_PLL_HZ == APB2_PLL_HZ);
    assert!(fast.is_multiple_of(TICK_RATE_HZ) && slow.is_multiple_of(TICK_RATE_HZ));
    assert!(fast.is_multiple_of(BAUD) && slow.is_multiple_of(BAUD));
};
