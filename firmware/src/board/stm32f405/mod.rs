//! The default board: STM32F405RG.
//!
//! | pin | signal | |
//! |---|---|---|
//! | PA4, PA5 | torque command of drive 1, 2 | converter output, 0 to 3.3 V, 1.65 V is zero |
//! | PA6, PA7 | encoder 1, tracks A, B | TIM3, pull-up |
//! | PB6, PB7 | encoder 2, tracks A, B | TIM4, pull-up |
//! | PA9, PA10 | link, transmit and receive | USART1, 1 Mbaud, 8N1 |
//! | PC0 | tip-force cell | 0 to 3.3 V |
//! | PC1 | root strain gauge | 0 to 3.3 V |
//! | PC6, PC7 | enable of drive 1, 2 | output, high enables; external pull-down |
//! | PC11, PC12 | brake of joint 1, 2 | output, high opens; external pull-down |
//! | PC8, PC9 | drive 1, 2 ok | input, high is ok; pull-down |
//! | PC10 | emergency stop | input, high is released (normally closed contact); pull-down |
//!
//! The HAL sets up clocks, pins, encoders, torque outputs and watchdog. Registers are written
//! for what it does not have (the converter's injected sequence, the compare output that
//! starts it, the control timer's restart, the encoders' input filters, the way off for fault
//! handlers) and for USART1 (see [`Serial`]).
//!
//! QEMU's `olimex-stm32-h405` has USART1 and TIM2 to TIM5 (without encoder mode); GPIO,
//! converters, watchdog and cycle counter read 0. Zero means: stop pressed, drives not ok, no
//! new conversion, so the arm cannot be enabled there.

pub mod constants;

use constants::{
    APB1_PLL_HZ, APB2_PLL_HZ, CONVERSION_LEAD_COUNTS, CORE_PLL_HZ, CRYSTAL_HZ, CRYSTAL_POLLS,
    DAC_ZERO, DRIVES, PLL_POLLS, TICK_RATE_HZ, WATCHDOG_MS,
};
use core::ops::Deref;
use cortex_m::peripheral::{DCB, DWT};
use flexor::link::{BAUD, ClockSource, Interlocks, RawSample};
use flexor::supervisor::Board;
use stm32f4xx_hal::dac::{C1, C2, DacOut, DacPin};
use stm32f4xx_hal::gpio::outport::{OutPort, OutPort2};
use stm32f4xx_hal::gpio::{
    Analog, PA4, PA5, PC0, PC1, PC6, PC7, PC8, PC9, PC10, PC11, PC12, PinState, Pull, PushPull,
};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::qei::{self, Qei};
use stm32f4xx_hal::rcc::{BusClock, BusTimerClock, Config, Enable, Rcc};
use stm32f4xx_hal::serial::CommonPins;
use stm32f4xx_hal::timer::CPin;
use stm32f4xx_hal::watchdog::IndependentWatchdog;

/// The clocks as they came up.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    /// Where they come from.
    pub source: ClockSource,
    /// Core clock, Hz.
    pub core_hz: u32,
    /// What the stopwatch counts in a second.
    pub stopwatch_hz: u32,
}

/// Brings the clocks up: crystal and PLL, else internal oscillator and PLL, else the
/// internal oscillator alone.
///
/// The HAL waits for crystal and PLL without end. Both are therefore tried first, each with a
/// limit, and the HAL is asked only for what has just worked.
fn start_clocks(rcc: Rcc) -> (Rcc, ClockSource) {
    rcc.cr().modify(|_, w| w.hseon().on());
    let crystal = poll(CRYSTAL_POLLS, || rcc.cr().read().hserdy().is_ready());
    if !crystal {
        rcc.cr().modify(|_, w| w.hseon().off());
    }
    // With the settings that it has after reset, 16 MHz / 16 * 192: that it locks is all that
    // is asked. They can be changed only when it is off again.
    rcc.cr().modify(|_, w| w.pllon().on());
    let pll = poll(PLL_POLLS, || rcc.cr().read().pllrdy().is_ready());
    rcc.cr().modify(|_, w| w.pllon().off());
    poll(PLL_POLLS, || rcc.cr().read().pllrdy().is_not_ready());
    let (input, source) = match (crystal, pll) {
        (true, true) => (Config::hse(CRYSTAL_HZ.Hz()), ClockSource::Crystal),
        (false, true) => (Config::hsi(), ClockSource::InternalPll),
        (_, false) => return (rcc, ClockSource::Internal),
    };
    let config = input
        .sysclk(CORE_PLL_HZ.Hz())
        .pclk1(APB1_PLL_HZ.Hz())
        .pclk2(APB2_PLL_HZ.Hz());
    (rcc.freeze(config), source)
}

/// Polls `ready` at most `count` times.
fn poll(count: u32, ready: impl Fn() -> bool) -> bool {
    (0..count).any(|_| ready())
}

/// Everything on the board, set up.
pub struct Peripherals {
    /// What the tick's interrupt uses.
    pub tick: TickBoard,
    /// The link's line.
    pub serial: Serial,
    /// The watchdog; not started yet.
    pub watchdog: Watchdog,
    /// The clocks.
    pub clocks: Clocks,
    /// True when the watchdog was the reason for the last reset.
    pub watchdog_reset: bool,
}

impl Peripherals {
    /// Sets everything up, drives off first. The debug units are for the stopwatch.
    pub fn new(device: pac::Peripherals, dcb: &mut DCB, dwt: &mut DWT) -> Self {
        let p = device;
        let watchdog_reset = p.RCC.csr().read().wdgrstf().bit_is_set();
        p.RCC.csr().modify(|_, w| w.rmvf().set_bit());
        let mut rcc = p.RCC.constrain();
        let gpioa = p.GPIOA.split(&mut rcc);
        let gpiob = p.GPIOB.split(&mut rcc);
        let gpioc = p.GPIOC.split(&mut rcc);

        let drives = AnalogDrives::new(
            p.DAC,
            (gpioa.pa4, gpioa.pa5),
            (gpioc.pc6, gpioc.pc7),
            (gpioc.pc11, gpioc.pc12),
            (gpioc.pc8, gpioc.pc9),
            gpioc.pc10,
            &mut rcc,
        );

        // The control period does not run on while a debugger holds the core.
        p.DBGMCU
            .apb1_fz()
            .modify(|_, w| w.dbg_tim2_stop().set_bit());

        let (mut rcc, source) = start_clocks(rcc);
        // The encoders' outputs may be open collectors.
        let tracks1 = (
            gpioa.pa6.internal_resistor(Pull::Up),
            gpioa.pa7.internal_resistor(Pull::Up),
        );
        let tracks2 = (
            gpiob.pb6.internal_resistor(Pull::Up),
            gpiob.pb7.internal_resistor(Pull::Up),
        );
        let channels = (gpioc.pc0.into_analog(), gpioc.pc1.into_analog());
        let sensors = EncodersAndAdc {
            encoders: (
                encoder(p.TIM3, tracks1, &mut rcc),
                encoder(p.TIM4, tracks2, &mut rcc),
            ),
            converter: injected(p.ADC1, &p.ADC_COMMON, channels, &mut rcc),
        };
        let core_hz = rcc.clocks.sysclk().raw();
        let (stopwatch, stopwatch_hz) = Stopwatch::new(p.TIM5, dcb, dwt, &mut rcc);
        // The pull-up keeps an open line quiet.
        let line = (gpioa.pa9, gpioa.pa10.internal_resistor(Pull::Up));
        Self {
            tick: TickBoard {
                sensors,
                drives,
                timer: ControlTimer::new(p.TIM2, &mut rcc),
                stopwatch,
                period_ticks_hw: stopwatch_hz / TICK_RATE_HZ,
            },
            serial: Serial::new(p.USART1, line, &mut rcc),
            watchdog: Watchdog {
                watchdog: IndependentWatchdog::new(p.IWDG),
                debug: p.DBGMCU,
            },
            clocks: Clocks {
                source,
                core_hz,
                stopwatch_hz,
            },
            watchdog_reset,
        }
    }
}

/// What the tick's interrupt uses.
pub struct TickBoard {
    sensors: EncodersAndAdc,
    drives: AnalogDrives,
    timer: ControlTimer,
    stopwatch: Stopwatch,
    /// The control period in its ticks. Timer and stopwatch have one clock.
    period_ticks_hw: u32,
}

impl Board for TickBoard {
    #[inline]
    fn sample(&mut self) -> RawSample {
        self.sensors.sample()
    }

    #[inline]
    fn interlocks(&self) -> Interlocks {
        self.drives.interlocks()
    }

    #[inline]
    fn command(&mut self, torque: [f32; 2]) {
        self.drives.command(torque);
    }

    #[inline]
    fn off(&mut self) {
        emergency_off();
    }

    // Once a run.
    #[cold]
    #[inline(never)]
    fn release_brakes(&mut self) {
        self.drives.brakes.all_high();
    }

    #[inline]
    fn acknowledge_timer(&mut self) -> bool {
        self.timer.acknowledge()
    }

    #[inline]
    fn timer_due(&self) -> bool {
        self.timer.due()
    }

    // Called where lock-step begins and ends only: out of the way of every other tick.
    #[cold]
    #[inline(never)]
    fn run_timer(&mut self, run: bool) {
        self.timer.run(run);
    }

    #[inline]
    fn stopwatch(&self) -> u32 {
        self.stopwatch.ticks_hw()
    }

    #[inline]
    fn period_ticks_hw(&self) -> u32 {
        self.period_ticks_hw
    }
}

/// Two quadrature encoders on TIM3 and TIM4; injected conversions of ADC1 on PC0 and PC1,
/// started by TIM2 ahead of the tick.
struct EncodersAndAdc {
    encoders: (pac::TIM3, pac::TIM4),
    converter: pac::ADC1,
}

/// A timer that counts an encoder's edges.
fn encoder<T>(
    timer: T,
    tracks: (
        impl Into<<T as CPin<0>>::Ch<PushPull>>,
        impl Into<<T as CPin<1>>::Ch<PushPull>>,
    ),
    rcc: &mut Rcc,
) -> T
where
    T: qei::Instance + Deref<Target = pac::tim3::RegisterBlock>,
{
    // Out of the HAL's wrapper again, which has no filters.
    let (timer, _tracks) = Qei::new(timer, tracks, rcc).release();
    // An edge counts after eight equal samples of the timer clock, 0.1 us: longer than what
    // drives couple into the line, shorter than an edge at any speed.
    timer
        .ccmr1_input()
        .modify(|_, w| w.ic1f().fck_int_n8().ic2f().fck_int_n8());
    timer
}

/// The converter with its injected sequence: force, strain.
fn injected(
    converter: pac::ADC1,
    common: &pac::ADC_COMMON,
    _pins: (PC0<Analog>, PC1<Analog>),
    rcc: &mut Rcc,
) -> pac::ADC1 {
    pac::ADC1::enable(rcc);
    common.ccr().write(|w| w.adcpre().div4());
    converter
        .smpr1()
        .write(|w| w.smp10().cycles84().smp11().cycles84());
    converter.cr1().write(|w| w.scan().enabled());
    // A sequence of two is read from JSQ3 and JSQ4 (RM0090, 13.13.12): channels 10 and 11 are
    // PC0 and PC1.
    // SAFETY: length 2 is coded 1; channels 10 and 11 exist.
    converter
        .jsqr()
        .write(|w| unsafe { w.jl().bits(1).jsq3().bits(10).jsq4().bits(11) });
    converter.cr2().write(|w| {
        w.jextsel().tim2cc1().jexten().rising_edge();
        w.adon().enabled()
    });
    converter
}

impl EncodersAndAdc {
    #[inline]
    fn sample(&mut self) -> RawSample {
        let fresh = self.converter.sr().read().jeoc().bit_is_set();
        // SAFETY: writing 0 clears a flag and 1 leaves it; this clears JEOC (bit 2).
        self.converter.sr().write(|w| unsafe { w.bits(!(1 << 2)) });
        RawSample {
            encoder: [
                self.encoders.0.cnt().read().bits() as u16,
                self.encoders.1.cnt().read().bits() as u16,
            ],
            force: self.converter.jdr1().read().bits() as u16,
            strain: self.converter.jdr2().read().bits() as u16,
            fresh,
        }
    }
}

/// Pins of port C that enable drive 1 and 2.
const ENABLES: [u8; 2] = [6, 7];

/// Pins of port C that open the brakes of joint 1 and 2.
const BRAKES: [u8; 2] = [11, 12];

/// Two current-controlled drives: torque commands from the converter's channels, enable
/// lines, the brakes behind them, and the inputs beside them.
struct AnalogDrives {
    enables: OutPort2<'C', { ENABLES[0] }, { ENABLES[1] }>,
    brakes: OutPort2<'C', { BRAKES[0] }, { BRAKES[1] }>,
    torques: (C1, C2),
    drives_ok: (PC8, PC9),
    estop_released: PC10,
}

impl AnalogDrives {
    /// Drives off and brakes closed before the lines become outputs and the torque outputs leave
    /// their high impedance.
    fn new(
        dac: pac::DAC,
        outputs: (PA4, PA5),
        enables: (PC6, PC7),
        brakes: (PC11, PC12),
        drives_ok: (PC8, PC9),
        estop_released: PC10,
        rcc: &mut Rcc,
    ) -> Self {
        let outputs = (outputs.0.into_analog(), outputs.1.into_analog());
        let mut torques = dac.constrain(outputs, rcc);
        emergency_off();
        torques.0.enable();
        torques.1.enable();
        Self {
            enables: (
                enables.0.into_push_pull_output_in_state(PinState::Low),
                enables.1.into_push_pull_output_in_state(PinState::Low),
            )
                .outport(),
            brakes: (
                brakes.0.into_push_pull_output_in_state(PinState::Low),
                brakes.1.into_push_pull_output_in_state(PinState::Low),
            )
                .outport(),
            torques,
            drives_ok: (
                drives_ok.0.into_pull_down_input(),
                drives_ok.1.into_pull_down_input(),
            ),
            estop_released: estop_released.into_pull_down_input(),
        }
    }

    #[inline]
    fn command(&mut self, torque: [f32; 2]) {
        self.torques.0.set_value(DRIVES[0].count(torque[0]));
        self.torques.1.set_value(DRIVES[1].count(torque[1]));
        self.enables.all_high();
    }
    #[inline]
    fn interlocks(&self) -> Interlocks {
        Interlocks {
            estop_released: self.estop_released.is_high(),
            drives_ok: self.drives_ok.0.is_high() && self.drives_ok.1.is_high(),
        }
    }
}

/// Drives off: disabled and brakes closed, then commanded no torque. The one way off, for the tick and for the
/// panic and fault handlers, whoever owns the port.
#[inline]
pub fn emergency_off() {
    // SAFETY: a single store, in which zeros leave their pins alone.
    unsafe {
        (*pac::GPIOC::ptr()).bsrr().write(|w| {
            w.br(ENABLES[0]).set_bit().br(ENABLES[1]).set_bit();
            w.br(BRAKES[0]).set_bit().br(BRAKES[1]).set_bit()
        });
    }
    C1.set_value(DAC_ZERO);
    C2.set_value(DAC_ZERO);
}

/// The control period's timer, TIM2. Its compare channel 1 starts the converter ahead of the
/// period's end.
struct ControlTimer(pac::TIM2);

impl ControlTimer {
    fn new(tim: pac::TIM2, rcc: &mut Rcc) -> Self {
        pac::TIM2::enable(rcc);
        let period = pac::TIM2::timer_clock(&rcc.clocks).raw() / TICK_RATE_HZ;
        // SAFETY: 32-bit registers, any value is valid.
        tim.arr().write(|w| unsafe { w.bits(period - 1) });
        // SAFETY: as above.
        tim.ccr1()
            .write(|w| unsafe { w.bits(period - CONVERSION_LEAD_COUNTS) });
        // PWM mode 2: the channel rises when the count reaches CCR1.
        tim.ccmr1_output().write(|w| w.oc1m().pwm_mode2());
        tim.ccer().write(|w| w.cc1e().set_bit());
        tim.dier().write(|w| w.uie().enabled());
        let mut timer = Self(tim);
        timer.run(true);
        timer
    }

    #[inline]
    fn acknowledge(&mut self) -> bool {
        let due = self.due();
        if due {
            // SAFETY: writing 0 clears a flag and 1 leaves it; this clears the update flag.
            self.0.sr().write(|w| unsafe { w.bits(!1) });
        }
        due
    }

    #[inline]
    fn due(&self) -> bool {
        self.0.sr().read().uif().bit_is_set()
    }

    fn run(&mut self, run: bool) {
        // URS: the restart of the period below is no reason for an interrupt.
        self.0
            .cr1()
            .write(|w| w.cen().bit(run).urs().counter_only());
        if run {
            // A whole period from now on; QEMU's timer starts again by nothing else.
            self.0.egr().write(|w| w.ug().update());
        }
    }
}

/// The stopwatch: the core's cycle counter, or TIM5 where there is none. QEMU has none; under
/// `-icount shift=0` its timers count once an instruction.
struct Stopwatch {
    tim5: pac::TIM5,
    /// The core's counter counts.
    cycles: bool,
}

impl Stopwatch {
    /// Starts it; returns what it counts in a second, too.
    fn new(tim5: pac::TIM5, dcb: &mut DCB, dwt: &mut DWT, rcc: &mut Rcc) -> (Self, u32) {
        dcb.enable_trace();
        dwt.enable_cycle_counter();
        let begun = DWT::cycle_count();
        cortex_m::asm::delay(16);
        let cycles = DWT::cycle_count() != begun;
        pac::TIM5::enable(rcc);
        // SAFETY: 32-bit register, any value is valid.
        tim5.arr().write(|w| unsafe { w.bits(u32::MAX) });
        tim5.cr1().write(|w| w.cen().enabled());
        let hz = if cycles {
            rcc.clocks.sysclk()
        } else {
            pac::TIM5::timer_clock(&rcc.clocks)
        };
        (Self { tim5, cycles }, hz.raw())
    }

    #[inline]
    fn ticks_hw(&self) -> u32 {
        if self.cycles {
            DWT::cycle_count()
        } else {
            self.tim5.cnt().read().bits()
        }
    }
}

/// The link's line, USART1. Not the HAL's: that resets the peripheral by the clock
/// controller, which ends QEMU 10 with a segmentation fault for all that is on APB2.
pub struct Serial(pac::USART1);

impl Serial {
    fn new(
        usart: pac::USART1,
        line: (
            impl Into<<pac::USART1 as CommonPins>::Tx<PushPull>>,
            impl Into<<pac::USART1 as CommonPins>::Rx<PushPull>>,
        ),
        rcc: &mut Rcc,
    ) -> Self {
        let _alternate_function = (line.0.into(), line.1.into());
        pac::USART1::enable(rcc);
        let divider = pac::USART1::clock(&rcc.clocks).raw() / BAUD;
        // SAFETY: 16 or 84: within the register's 16 bits, and mantissa not 0.
        usart.brr().write(|w| unsafe { w.bits(divider as u16) });
        usart.cr1().write(|w| {
            w.ue().enabled().te().enabled().re().enabled();
            w.rxneie().enabled()
        });
        Self(usart)
    }

    /// A received byte, if there is one, and whether another was lost.
    #[inline]
    pub fn receive(&mut self) -> (Option<u8>, bool) {
        let status = self.0.sr().read();
        let (full, overrun) = (status.rxne().bit_is_set(), status.ore().bit_is_set());
        if !full && !overrun {
            return (None, false);
        }
        // Clears the overrun, too. That may come alone, when a byte arrives between the two
        // readings; unread it would interrupt without end.
        let byte = self.0.dr().read().bits() as u8;
        (full.then_some(byte), overrun)
    }

    /// True when a byte can be sent.
    #[inline]
    pub fn ready(&self) -> bool {
        self.0.sr().read().txe().bit_is_set()
    }

    /// Sends a byte; call it when [`ready`](Self::ready).
    #[inline]
    pub fn send(&mut self, byte: u8) {
        // SAFETY: 8 data bits, any value is valid.
        self.0.dr().write(|w| unsafe { w.bits(byte.into()) });
    }

    /// Whether to interrupt when a byte can be sent.
    #[inline]
    pub fn announce_ready(&mut self, announce: bool) {
        self.0.cr1().modify(|_, w| w.txeie().bit(announce));
    }
}

/// The independent watchdog.
pub struct Watchdog {
    watchdog: IndependentWatchdog,
    debug: pac::DBGMCU,
}

impl Watchdog {
    /// Starts it; it cannot be stopped.
    pub fn start(&mut self) {
        self.watchdog.start(WATCHDOG_MS.millis());
    }

    /// Another [`WATCHDOG_MS`].
    pub fn feed(&mut self) {
        self.watchdog.feed();
    }

    /// Whether it waits while a debugger holds the core. It must not when the drives are on:
    /// they hold their last torque then, until the watchdog resets.
    pub fn wait_for_debugger(&mut self, wait: bool) {
        self.watchdog.stop_on_debug(&self.debug, wait);
    }
}
