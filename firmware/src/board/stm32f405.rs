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
//! | PC8, PC9 | drive 1, 2 well | input, high is well; pull-down |
//! | PC10 | emergency stop | input, high is released (normally closed contact); pull-down |
//!
//! Registers are written through the peripheral access crate and not through the HAL:
//! the HAL's drivers want its clock set-up, which waits for crystal and PLL without
//! end, and a board with a dead crystal (and QEMU, whose RCC never reports ready) must
//! come up all the same.
//!
//! QEMU's `olimex-stm32-h405` has USART1 and TIM2 to TIM5 (without encoder mode); GPIO,
//! converters and watchdog read 0. Zero means: stop pressed, drives unwell, no new
//! conversion, so the arm cannot be armed there.

use super::constants::{
    BAUD, CONVERSION_LEAD_COUNTS, CORE_PLL_HZ, CRYSTAL_HZ, CRYSTAL_POLLS, DAC_ZERO,
    DRIVE_FULL_SCALE_NM, FLASH_WAIT_STATES, INTERNAL_HZ, PLL_INPUT_HZ, PLL_N, PLL_POLLS, PLL_Q,
    TICK_RATE_HZ, WATCHDOG_COUNTS,
};
use shared::board::{Drives, Inputs, Sensors, Stopwatch, Timebase};
use shared::link::ClockSource;
use shared::safety::Interlocks;
use shared::sensing::RawSample;
use stm32f4::stm32f405 as pac;

/// The clocks as they came up.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    /// Where they come from.
    pub source: ClockSource,
    /// Core clock, Hz.
    pub core_hz: u32,
    /// Clock of TIM2 to TIM5, Hz.
    pub timer_hz: u32,
    /// Clock of APB2, which USART1 and the converters get, Hz.
    pub apb2_hz: u32,
}

impl Clocks {
    /// Brings the clocks up: crystal and PLL, else internal oscillator and PLL, else the
    /// internal oscillator alone.
    pub fn start(rcc: &pac::RCC, flash: &pac::FLASH) -> Self {
        rcc.cr().modify(|_, w| w.hseon().on());
        let crystal = poll(CRYSTAL_POLLS, || rcc.cr().read().hserdy().is_ready());
        if !crystal {
            rcc.cr().modify(|_, w| w.hseon().off());
        }
        let input_hz = if crystal { CRYSTAL_HZ } else { INTERNAL_HZ };
        // SAFETY: M, N and Q are within their fields and the PLL's limits (constants).
        rcc.pllcfgr().write(|w| unsafe {
            w.pllm().bits((input_hz / PLL_INPUT_HZ) as u8);
            w.plln().bits(PLL_N);
            w.pllp().div2();
            w.pllq().bits(PLL_Q);
            w.pllsrc().bit(crystal)
        });
        rcc.cr().modify(|_, w| w.pllon().on());
        if !poll(PLL_POLLS, || rcc.cr().read().pllrdy().is_ready()) {
            rcc.cr().modify(|_, w| w.pllon().off());
            return Self {
                source: ClockSource::Internal,
                core_hz: INTERNAL_HZ,
                timer_hz: INTERNAL_HZ,
                apb2_hz: INTERNAL_HZ,
            };
        }
        // SAFETY: a documented number of wait states.
        flash.acr().write(|w| unsafe {
            w.latency().bits(FLASH_WAIT_STATES);
            w.prften().set_bit();
            w.icen().set_bit();
            w.dcen().set_bit()
        });
        // APB1 at most 42 MHz: 168 / 4; its timers get twice that. APB2: 168 / 2.
        rcc.cfgr()
            .modify(|_, w| w.ppre1().div4().ppre2().div2().sw().pll());
        poll(PLL_POLLS, || rcc.cfgr().read().sws().is_pll());
        Self {
            source: if crystal {
                ClockSource::Crystal
            } else {
                ClockSource::InternalPll
            },
            core_hz: CORE_PLL_HZ,
            timer_hz: CORE_PLL_HZ / 2,
            apb2_hz: CORE_PLL_HZ / 2,
        }
    }
}

/// Polls `ready` at most `count` times.
fn poll(count: u32, ready: impl Fn() -> bool) -> bool {
    (0..count).any(|_| ready())
}

/// Peripherals, set up.
pub struct Board {
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

impl Board {
    /// Sets everything up, drives off first.
    pub fn new(device: pac::Peripherals) -> Self {
        let p = device;
        let rcc = &p.RCC;
        rcc.ahb1enr().modify(|_, w| {
            w.gpioaen()
                .enabled()
                .gpioben()
                .enabled()
                .gpiocen()
                .enabled()
        });
        rcc.apb1enr().modify(|_, w| {
            w.tim2en().enabled().tim3en().enabled().tim4en().enabled();
            w.tim5en().enabled().dacen().enabled()
        });
        rcc.apb2enr()
            .modify(|_, w| w.usart1en().enabled().adc1en().enabled());

        let mut drives = Dac {
            dac: p.DAC,
            gpioc: p.GPIOC,
        };
        drives.set_up(&p.GPIOA);
        // Without this the timers would run on while a debugger holds the core.
        p.DBGMCU
            .apb1_fz()
            .modify(|_, w| w.dbg_tim2_stop().set_bit().dbg_iwdg_stop().set_bit());

        let watchdog_reset = rcc.csr().read().wdgrstf().bit_is_set();
        rcc.csr().modify(|_, w| w.rmvf().set_bit());
        let clocks = Clocks::start(rcc, &p.FLASH);
        let sensors = EncodersAndAdc::new(
            p.TIM3,
            p.TIM4,
            p.ADC1,
            &p.ADC_COMMON,
            &p.GPIOA,
            &p.GPIOB,
            &drives.gpioc,
        );
        let tick = TickBoard {
            sensors,
            drives,
            timebase: Tim2::new(p.TIM2, clocks.timer_hz),
            stopwatch: Tim5::new(p.TIM5),
        };
        Self {
            tick,
            serial: Serial::new(p.USART1, &p.GPIOA, clocks.apb2_hz),
            watchdog: Watchdog(p.IWDG),
            clocks,
            watchdog_reset,
        }
    }
}

/// What the tick's interrupt uses.
pub type TickBoard = shared::board::TickBoard<EncodersAndAdc, Dac, Tim2, Tim5>;

/// Two quadrature encoders on TIM3 and TIM4; injected conversions of ADC1 on PC0 and PC1,
/// started by TIM2 ahead of the tick.
pub struct EncodersAndAdc {
    tim3: pac::TIM3,
    tim4: pac::TIM4,
    adc: pac::ADC1,
}

impl EncodersAndAdc {
    fn new(
        tim3: pac::TIM3,
        tim4: pac::TIM4,
        adc: pac::ADC1,
        common: &pac::ADC_COMMON,
        gpioa: &pac::GPIOA,
        gpiob: &pac::GPIOB,
        gpioc: &pac::GPIOC,
    ) -> Self {
        // PA6, PA7 and PB6, PB7: alternate function 2 (TIM3, TIM4), pull-up.
        gpioa
            .moder()
            .modify(|_, w| w.moder6().alternate().moder7().alternate());
        gpioa
            .pupdr()
            .modify(|_, w| w.pupdr6().pull_up().pupdr7().pull_up());
        gpioa.afrl().modify(|_, w| w.afrl6().af2().afrl7().af2());
        gpiob
            .moder()
            .modify(|_, w| w.moder6().alternate().moder7().alternate());
        gpiob
            .pupdr()
            .modify(|_, w| w.pupdr6().pull_up().pupdr7().pull_up());
        gpiob.afrl().modify(|_, w| w.afrl6().af2().afrl7().af2());
        // TIM3 and TIM4 are of one kind, yet of two types: the macro saves a copy.
        macro_rules! encoder {
            ($tim:expr) => {
                // Filter 3: eight samples of the timer clock, 0.1 us.
                // SAFETY: 3 is a value of the 4-bit filter field.
                $tim.ccmr1_input().write(|w| unsafe {
                    w.cc1s().ti1().cc2s().ti2().ic1f().bits(3).ic2f().bits(3)
                });
                $tim.smcr().write(|w| w.sms().encoder_mode_3());
                // SAFETY: the whole 16-bit range.
                $tim.arr().write(|w| unsafe { w.bits(0xffff) });
                $tim.cr1().write(|w| w.cen().enabled());
            };
        }
        encoder!(tim3);
        encoder!(tim4);

        // PC0, PC1: analog.
        gpioc
            .moder()
            .modify(|_, w| w.moder0().analog().moder1().analog());
        common.ccr().write(|w| w.adcpre().div4());
        adc.smpr1()
            .write(|w| w.smp10().cycles84().smp11().cycles84());
        adc.cr1().write(|w| w.scan().enabled());
        // A sequence of two is read from JSQ3 and JSQ4 (RM0090, 13.13.12): force, strain.
        // SAFETY: length 2 is coded 1; channels 10 and 11 exist.
        adc.jsqr()
            .write(|w| unsafe { w.jl().bits(1).jsq3().bits(10).jsq4().bits(11) });
        adc.cr2().write(|w| {
            w.jextsel().tim2cc1().jexten().rising_edge();
            w.adon().enabled()
        });
        Self { tim3, tim4, adc }
    }
}

impl Sensors for EncodersAndAdc {
    #[inline]
    fn sample(&mut self) -> RawSample {
        let fresh = self.adc.sr().read().jeoc().bit_is_set();
        // SAFETY: writing 0 clears a flag and 1 leaves it; this clears JEOC (bit 2).
        self.adc.sr().write(|w| unsafe { w.bits(!(1 << 2)) });
        RawSample {
            encoder: [
                self.tim3.cnt().read().bits() as u16,
                self.tim4.cnt().read().bits() as u16,
            ],
            force: self.adc.jdr1().read().bits() as u16,
            strain: self.adc.jdr2().read().bits() as u16,
            fresh,
        }
    }
}

/// Both channels of the DAC, the enable lines, and the inputs beside them.
pub struct Dac {
    dac: pac::DAC,
    gpioc: pac::GPIOC,
}

impl Dac {
    fn set_up(&mut self, gpioa: &pac::GPIOA) {
        self.off();
        // Outputs PC6, PC7; inputs PC8 to PC10 with pull-down.
        self.gpioc.moder().modify(|_, w| {
            w.moder6().output().moder7().output();
            w.moder8().input().moder9().input().moder10().input()
        });
        self.gpioc.pupdr().modify(|_, w| {
            w.pupdr8()
                .pull_down()
                .pupdr9()
                .pull_down()
                .pupdr10()
                .pull_down()
        });
        gpioa
            .moder()
            .modify(|_, w| w.moder4().analog().moder5().analog());
        self.dac.cr().write(|w| w.en1().enabled().en2().enabled());
        self.off();
    }

    #[inline]
    fn write(&self, counts: [u16; 2]) {
        // SAFETY: the callers give 12-bit numbers, and the fields are all there is.
        self.dac
            .dhr12rd()
            .write(|w| unsafe { w.bits(u32::from(counts[0]) | u32::from(counts[1]) << 16) });
    }
}

impl Drives for Dac {
    #[inline]
    fn command(&mut self, torque: [f32; 2]) {
        let counts = [0, 1].map(|i| {
            let span = f32::from(DAC_ZERO);
            let count = span + torque[i] * (span / DRIVE_FULL_SCALE_NM[i]);
            // Float to integer saturates; half a count is a 4000th of full scale.
            (count as u16).min(2 * DAC_ZERO - 1)
        });
        self.write(counts);
        self.gpioc
            .bsrr()
            .write(|w| w.bs6().set_bit().bs7().set_bit());
    }

    #[inline]
    fn off(&mut self) {
        self.gpioc
            .bsrr()
            .write(|w| w.br6().set_bit().br7().set_bit());
        self.write([DAC_ZERO; 2]);
    }
}

impl Inputs for Dac {
    #[inline]
    fn interlocks(&self) -> Interlocks {
        let port = self.gpioc.idr().read();
        Interlocks {
            stop_released: port.idr10().bit_is_set(),
            drives_well: port.idr8().bit_is_set() && port.idr9().bit_is_set(),
        }
    }
}

/// Drives off, from wherever the processor is, whoever owns the port: for the panic and
/// fault handlers.
pub fn emergency_off() {
    // SAFETY: the handlers never return, so nothing else uses these ports any more; both
    // writes are single stores without a read before.
    let p = unsafe { pac::Peripherals::steal() };
    Dac {
        dac: p.DAC,
        gpioc: p.GPIOC,
    }
    .off();
}

/// The control period's timer. Its compare channel 1 starts the converter ahead of the
/// period's end.
pub struct Tim2(pac::TIM2);

impl Tim2 {
    fn new(tim: pac::TIM2, timer_hz: u32) -> Self {
        let period = timer_hz / TICK_RATE_HZ;
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
}

impl Timebase for Tim2 {
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

/// The stopwatch: a 32-bit timer at the full timer clock. Not the core's cycle counter:
/// QEMU has none. Under `-icount shift=0` QEMU's timer counts once an instruction.
pub struct Tim5(pac::TIM5);

impl Tim5 {
    fn new(tim: pac::TIM5) -> Self {
        // SAFETY: 32-bit register, any value is valid.
        tim.arr().write(|w| unsafe { w.bits(u32::MAX) });
        tim.cr1().write(|w| w.cen().enabled());
        Self(tim)
    }
}

impl Stopwatch for Tim5 {
    #[inline]
    fn counts(&self) -> u32 {
        self.0.cnt().read().bits()
    }
}

/// The link's line, USART1.
pub struct Serial(pac::USART1);

impl Serial {
    fn new(usart: pac::USART1, gpioa: &pac::GPIOA, clock_hz: u32) -> Self {
        // PA9, PA10: alternate function 7. The pull-up keeps an open line quiet.
        gpioa
            .moder()
            .modify(|_, w| w.moder9().alternate().moder10().alternate());
        gpioa.afrh().modify(|_, w| w.afrh9().af7().afrh10().af7());
        gpioa.pupdr().modify(|_, w| w.pupdr10().pull_up());
        // SAFETY: 16 or 84: within the register's 16 bits, and mantissa not 0.
        usart
            .brr()
            .write(|w| unsafe { w.bits((clock_hz / BAUD) as u16) });
        usart.cr1().write(|w| {
            w.ue().enabled().te().enabled().re().enabled();
            w.rxneie().enabled()
        });
        Self(usart)
    }

    /// A received byte, if there is one, and whether bytes before it were lost.
    #[inline]
    pub fn receive(&mut self) -> Option<(u8, bool)> {
        let status = self.0.sr().read();
        // Reading the data clears the overrun as well.
        status
            .rxne()
            .bit_is_set()
            .then(|| (self.0.dr().read().bits() as u8, status.ore().bit_is_set()))
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
pub struct Watchdog(pac::IWDG);

impl Watchdog {
    /// Starts it; it cannot be stopped. Does not wait for the registers to be taken over:
    /// until then the reset values hold, 512 ms.
    pub fn start(&mut self) {
        self.0.kr().write(|w| w.key().start());
        self.0.kr().write(|w| w.key().unlock());
        self.0.pr().write(|w| w.pr().divide_by4());
        // SAFETY: within 12 bits.
        self.0
            .rlr()
            .write(|w| unsafe { w.rl().bits(WATCHDOG_COUNTS) });
    }

    /// Another 50 ms.
    pub fn feed(&mut self) {
        self.0.kr().write(|w| w.key().feed());
    }
}
