//! Flexor's firmware: the supervisor's tick, fed by a board or, in lock-step, by a host.
//!
//! | priority | what | where |
//! |---|---|---|
//! | 2, highest | the control tick (TIM2), or on the host's request | [`flexor::supervisor`] |
//! | 1 | bytes of the link (USART1) into and out of queues | `serial` |
//! | 0 | the main loop: requests, watchdog | [`comms`] |
//!
//! RTIC 2 schedules them: its priority ceilings prove at compile time that the tick
//! shares data with the main loop only under a lock, which in the tick itself never waits
//! and costs a dozen instructions. Locks in the main loop copy one small struct or exchange
//! two references; `cargo xtask budget` counts the instructions of every stretch with
//! interrupts held off.

#![no_std]
#![no_main]

mod board;
mod comms;
mod crash_record;
mod flash_slots;
mod identity;
mod log;
mod stack;

/// Ticks of the stopwatch that 1,000 `nop` instructions take, with no interrupt between.
fn calibrate(board: &impl flexor::supervisor::Board) -> u32 {
    let begun = board.stopwatch();
    // SAFETY: assembles to 1,000 nops and nothing else.
    unsafe { core::arch::asm!(".rept 1000", "nop", ".endr", options(nomem, nostack)) };
    let ticks_hw = board.stopwatch().wrapping_sub(begun);
    // Less what two readings of the stopwatch take by themselves.
    let begun = board.stopwatch();
    ticks_hw.wrapping_sub(board.stopwatch().wrapping_sub(begun))
}

#[rtic::app(device = stm32f4xx_hal::pac, peripherals = true)]
mod app {
    use crate::board::constants::{
        CALIBRATION, RECEIVE_QUEUE, SAFETY, TICK_RATE_HZ, TRANSMIT_QUEUE, WAKE_CYCLES,
    };
    use crate::board::{Peripherals, Serial, TickBoard, Watchdog};
    use crate::comms::Here;
    use crate::{calibrate, comms, crash_record, flash_slots, log, stack};
    use cortex_m::peripheral::syst::SystClkSource;
    use flexor::link::{FRAME_MAX, Mode, Receiver, Reply, Request};
    use flexor::supervisor::{ControllerSlot, MonitoredController, RequestHandler, Supervisor};
    use heapless::spsc::{Consumer, Producer, Queue};
    use stm32f4xx_hal::pac::Interrupt;

    #[shared]
    struct Shared {
        supervisor: Supervisor<'static>,
        /// Received bytes that were lost.
        bytes_lost: u32,
    }

    #[local]
    struct Local {
        board: TickBoard,
        serial: Serial,
        watchdog: Watchdog,
        requests: RequestHandler<'static>,
        received: Producer<'static, u8>,
        to_send: Consumer<'static, u8>,
        from_host: Consumer<'static, u8>,
        to_host: Producer<'static, u8>,
    }

    #[init(local = [
        receive: Queue<u8, RECEIVE_QUEUE> = Queue::new(),
        transmit: Queue<u8, TRANSMIT_QUEUE> = Queue::new(),
        running: Option<MonitoredController<'static>> = None,
        prepared: Option<MonitoredController<'static>> = None,
    ])]
    fn init(context: init::Context) -> (Shared, Local) {
        stack::paint();
        let mut core = context.core;
        let mut peripherals = Peripherals::new(context.device, &mut core.DCB, &mut core.DWT);
        let start = crash_record::take(peripherals.watchdog_reset);
        let nops = calibrate(&peripherals.tick);
        let prepared = ControllerSlot::new(context.local.prepared);
        let requests = comms::handler(&peripherals.clocks, nops, start, prepared);
        let mut watchdog = peripherals.watchdog;
        watchdog.start();
        let mut systick = core.SYST;
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(WAKE_CYCLES);
        systick.clear_current();
        systick.enable_counter();
        systick.enable_interrupt();
        let (received, from_host) = context.local.receive.split();
        let (to_host, to_send) = context.local.transmit.split();
        // Without a setup no table runs, and nothing reads the moment.
        let calibration =
            flash_slots::setup().map_or(CALIBRATION, |setup| CALIBRATION.for_arm(&setup.arm));
        let shared = Shared {
            supervisor: Supervisor::new(
                &mut peripherals.tick,
                ControllerSlot::new(context.local.running),
                &SAFETY,
                &calibration,
                TICK_RATE_HZ,
            ),
            bytes_lost: 0,
        };
        let local = Local {
            board: peripherals.tick,
            serial: peripherals.serial,
            watchdog,
            requests,
            received,
            to_send,
            from_host,
            to_host,
        };
        (shared, local)
    }

    /// The control tick.
    #[task(binds = TIM2, priority = 2, shared = [supervisor], local = [board])]
    fn tick(mut context: tick::Context) {
        let board = context.local.board;
        context
            .shared
            .supervisor
            .lock(|supervisor| supervisor.tick(board));
    }

    /// Moves bytes between the line and the queues.
    #[task(binds = USART1, priority = 1, shared = [bytes_lost], local = [serial, received, to_send])]
    fn serial(mut context: serial::Context) {
        let serial = context.local.serial;
        let (byte, overrun) = serial.receive();
        let full = byte.is_some_and(|byte| context.local.received.enqueue(byte).is_err());
        if overrun || full {
            let lost = u32::from(overrun) + u32::from(full);
            context
                .shared
                .bytes_lost
                .lock(|count| *count = count.saturating_add(lost));
        }
        if serial.ready() {
            let next = context.local.to_send.dequeue();
            if let Some(byte) = next {
                serial.send(byte);
            }
            serial.announce_ready(next.is_some());
        }
    }

    /// Ends the main loop's sleep, for the watchdog's sake: in lock-step nothing else may.
    #[task(binds = SysTick, priority = 1)]
    fn wake(_: wake::Context) {}

    /// Answers requests and feeds the watchdog.
    #[idle(shared = [supervisor, bytes_lost], local = [watchdog, requests, from_host, to_host])]
    fn idle(mut context: idle::Context) -> ! {
        let local = context.local;
        let supervisor = &mut context.shared.supervisor;
        // A reply that does not fit the queue is cut short: the host sees a bad frame,
        // and no host that waits for its answers gets there.
        let to_host = local.to_host;
        let send = |to_host: &mut Producer<'static, u8>, reply: &Reply| {
            comms::send(reply, |byte| {
                let _ = to_host.enqueue(byte);
            });
            rtic::pend(Interrupt::USART1);
        };
        let mut receiver = Receiver::new();
        let mut fault = None;
        let mut debuggable = false;
        // The host may have been listening before this started. What the line carried during
        // the reset must not spoil the first frame: a zero ends it.
        let _ = to_host.enqueue(0);
        let here = |frames, bytes_lost| Here {
            pend: || {
                rtic::pend(Interrupt::TIM2);
                // Taken before anything that follows.
                cortex_m::asm::dsb();
                cortex_m::asm::isb();
            },
            frames,
            bytes_lost,
        };
        let identity = local.requests.identity(&mut here(receiver.errors(), 0));
        send(to_host, &identity);
        loop {
            if supervisor.lock(Supervisor::tick_advanced) {
                local.watchdog.feed();
            }
            let status = supervisor.lock(|supervisor| supervisor.status());
            if debuggable != (status.mode != Mode::Enabled) {
                debuggable = !debuggable;
                local.watchdog.wait_for_debugger(debuggable);
            }
            if fault != status.fault {
                fault = status.fault;
                match fault {
                    Some(fault) => defmt::error!("stopped by {}, drives off", fault),
                    None => defmt::info!("fault acknowledged"),
                }
            }
            // Telemetry and log wait for the answers: a reply and one of them always fit together.
            while to_host.capacity() - to_host.len() >= 2 * FRAME_MAX
                && let Some(sample) = supervisor.lock(Supervisor::take_telemetry)
            {
                send(to_host, &Reply::Telemetry(sample));
            }
            if to_host.capacity() - to_host.len() >= 2 * FRAME_MAX
                && let Some(entry) = log::take()
            {
                send(to_host, &Reply::Log(entry));
            }
            let Some(byte) = local.from_host.dequeue() else {
                // With interrupts masked a request between the look and the sleep still
                // ends the sleep.
                cortex_m::interrupt::free(|_| {
                    if !local.from_host.ready() {
                        cortex_m::asm::wfi();
                    }
                });
                continue;
            };
            if let Some(request) = receiver.push::<Request>(byte) {
                let bytes_lost = context.shared.bytes_lost.lock(|count| *count);
                let mut services = here(receiver.errors(), bytes_lost);
                let reply = local.requests.answer(&request, supervisor, &mut services);
                send(to_host, &reply);
            }
        }
    }
}
