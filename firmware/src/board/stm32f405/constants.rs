//! Every number of this chip's board, each with where it comes from. Those that planner and
//! simulator must know, too, are in the board file, by default `boards/stm32f405.toml`.

use flexor::link::BAUD;
use flexor::supervisor::{BoardParameters, Calibration, DriveScale, SafetyLimits};

// --- The board file -----------------------------------------------------------------------

/// What the board file says. All that follows from it is computed when the image is built.
#[allow(
    clippy::approx_constant,
    reason = "the file's numbers are the user's: a quarter turn may be one"
)]
const BOARD: BoardParameters = include!(concat!(env!("OUT_DIR"), "/board.rs"));
/// How counts become SI values.
pub const CALIBRATION: Calibration = BOARD.calibration();
/// How the drives' torques become counts.
pub const DRIVES: [DriveScale; 2] = BOARD.drives();
/// Count of the digital-analog converter that commands no torque.
pub const DAC_ZERO: u16 = DRIVES[0].zero;
/// Largest torques that the drives can be asked for, N m.
pub const DRIVE_LIMIT_NM: [f64; 2] = BOARD.drive_limit_nm();
/// Limits for enabling and for staying enabled.
pub const SAFETY: SafetyLimits = BOARD.safety();
/// Control rate, Hz.
pub const TICK_RATE_HZ: u32 = BOARD.tick_rate_hz;

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

/// Timer counts from the converter's trigger to the tick. Two channels take 84 cycles of
/// sampling and 12 of conversion each, at APB2's clock over 4: 2 * 96 * 4 = 768 counts
/// of the timer, whose clock equals APB2's with the PLL and without; a quarter more for
/// safety. 11.4 us at 84 MHz.
pub const CONVERSION_LEAD_COUNTS: u32 = 960;

// --- Link ------------------------------------------------------------------------------

/// Bytes of the receive queue: two of the longest frames.
pub const RECEIVE_QUEUE: usize = 1024;
/// Bytes of the transmit queue: two of the longest frames, and the one place that the
/// queue keeps free.
pub const TRANSMIT_QUEUE: usize = 1024;

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

// --- What the board file must fit --------------------------------------------------------------

/// Bits of the converters, to either side.
const CONVERTER_BITS: u32 = 12;

const _: () = {
    // TIM2's clock and APB2's are equal with the PLL and without.
    let [fast, slow] = [APB2_PLL_HZ, INTERNAL_HZ];
    assert!(2 * APB1_PLL_HZ == APB2_PLL_HZ);
    assert!(
        fast.is_multiple_of(TICK_RATE_HZ) && slow.is_multiple_of(TICK_RATE_HZ),
        "tick_rate_Hz of the board file must divide 84 MHz and 16 MHz"
    );
    assert!(
        slow / TICK_RATE_HZ > CONVERSION_LEAD_COUNTS,
        "tick_rate_Hz of the board file leaves no time for the conversions"
    );
    assert!(
        BOARD.converter_bits == CONVERTER_BITS && BOARD.drive_bits == CONVERTER_BITS,
        "converter.bits and drives.bits of the board file must be 12"
    );
    assert!(fast.is_multiple_of(BAUD) && slow.is_multiple_of(BAUD));
};
