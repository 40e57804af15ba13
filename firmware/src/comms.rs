//! Answers the host's requests, in the main loop.

use crate::board::constants::{SAFETY, TICK_RATE_HZ};
use crate::board::stm32f405::Clocks;
use crate::control::Control;
use crate::{identity, slots, stack};
use rtic::Mutex;
use shared::controller::Controller;
use shared::link::{
    ClockSource, FRAME_MAX, FrameErrors, Identity, Mode, Reply, Request, Setup, Slot, SlotError,
    StartReason, Status, TableIdentity, encode,
};
use shared::safety::{Refusal, may_arm};
use shared::table::Table;

/// What the main loop knows.
pub struct Comms {
    setup: Option<Setup>,
    clock: ClockSource,
    timer_hz: u32,
    counts_per_1000_nops: u32,
    start: StartReason,
}

impl Comms {
    /// Reads the image's setup.
    pub fn new(clocks: &Clocks, counts_per_1000_nops: u32, start: StartReason) -> Self {
        defmt::info!("start: {}, clock: {}", start, clocks.source);
        Self {
            setup: slots::setup(),
            clock: clocks.source,
            timer_hz: clocks.timer_hz,
            counts_per_1000_nops,
            start,
        }
    }

    /// Who this is; opens both slots.
    pub fn identity(&self) -> Reply {
        let arm_fingerprint = self.setup.map(|setup| setup.arm.fingerprint());
        // Without an arm no table fits; 0 stands for it as good as any number.
        let slots = Slot::ALL.map(|slot| {
            let table = slots::open(slot, arm_fingerprint.unwrap_or(0));
            if let Err(error) = table {
                defmt::info!("slot {}: no usable table, {}", slot, error);
            }
            table.map(|table| TableIdentity::from(&table))
        });
        Reply::Identity(Identity {
            git: identity::GIT,
            modified: identity::MODIFIED,
            arm_fingerprint,
            slots,
            tick_rate_hz: TICK_RATE_HZ,
            stopwatch_hz: self.timer_hz,
            counts_per_1000_nops: self.counts_per_1000_nops,
            clock: self.clock,
            start: self.start,
        })
    }

    /// Does what is asked and says so. `pend` requests the tick's interrupt.
    pub fn answer(
        &self,
        request: &Request,
        control: &mut impl Mutex<T = Control>,
        lost: (FrameErrors, u32),
        pend: impl Fn(),
    ) -> Reply {
        control.lock(Control::heard);
        let done = match *request {
            Request::Hello => return self.identity(),
            Request::Status => return status(control, lost),
            Request::Arm => self.arm(control),
            Request::Disarm => {
                control.lock(Control::disarm);
                // If the timer rested for lock-step, this tick starts it again.
                pend();
                Ok(())
            }
            Request::Acknowledge => {
                control.lock(Control::acknowledge);
                Ok(())
            }
            Request::StartLockStep { slot, setup } => start_lock_step(slot, &setup, control),
            Request::StopLockStep => {
                let running = control.lock(|c| c.report().0 == Mode::LockStep);
                if running {
                    control.lock(Control::disarm);
                    pend();
                    Ok(())
                } else {
                    Err(Refusal::NotInLockStep)
                }
            }
            Request::Measured { sequence, measured } => {
                if control.lock(|c| c.put(sequence, measured)) {
                    // The tick comes at once, being of higher priority.
                    pend();
                    return Reply::Command(control.lock(|c| c.result()));
                }
                Err(Refusal::NotInLockStep)
            }
        };
        match done {
            Ok(()) => Reply::Done,
            Err(refusal) => {
                defmt::warn!("refused: {}", refusal);
                Reply::Refused(refusal)
            }
        }
    }

    /// The slots' preferred usable table.
    fn table(&self, setup: &Setup) -> Result<Table<'static>, Refusal> {
        let fingerprint = setup.arm.fingerprint();
        slots::open(Slot::A, fingerprint)
            .or_else(|a| slots::open(Slot::B, fingerprint).map_err(|b| Refusal::NoTable(a, b)))
    }

    fn arm(&self, control: &mut impl Mutex<T = Control>) -> Result<(), Refusal> {
        if control.lock(|c| c.report().0) != Mode::Disarmed {
            return Err(Refusal::Busy);
        }
        let setup = self.setup.ok_or(Refusal::NoSetup)?;
        let table = self.table(&setup)?;
        let first_row = table.cursor().reference();
        let (latched, interlocks, measured) = control.lock(|c| c.standing());
        may_arm(&SAFETY, latched, interlocks, measured.as_ref(), &first_row)?;
        let controller = controller(&table, &setup)?;
        control.lock(|c| c.arm(controller));
        Ok(())
    }
}

fn controller(table: &Table<'static>, setup: &Setup) -> Result<Controller<'static, f32>, Refusal> {
    Controller::new(table, &setup.arm, &setup.law, &setup.limits)
        .map_err(|error| Refusal::Table(error.into()))
}

fn start_lock_step(
    slot: Slot,
    setup: &Setup,
    control: &mut impl Mutex<T = Control>,
) -> Result<(), Refusal> {
    if control.lock(|c| c.report().0) == Mode::Armed {
        return Err(Refusal::Busy);
    }
    let table: Result<_, SlotError> = slots::open(slot, setup.arm.fingerprint());
    let controller = controller(&table.map_err(Refusal::Table)?, setup)?;
    control.lock(|c| c.start_lock_step(controller));
    Ok(())
}

fn status(control: &mut impl Mutex<T = Control>, lost: (FrameErrors, u32)) -> Reply {
    let (mode, tick, fault, ticks_total, counts_max) = control.lock(|c| c.report());
    Reply::Status(Status {
        mode,
        tick,
        fault,
        ticks_total,
        counts_max,
        stack_bytes: stack::deepest(),
        frame_errors: lost.0,
        bytes_lost: lost.1,
    })
}

/// Hands a reply's frame to `put`, byte by byte.
pub fn send(reply: &Reply, mut put: impl FnMut(u8)) {
    let mut buffer = [0; FRAME_MAX];
    // No reply is longer than a frame (tested in shared).
    if let Ok(frame) = encode(reply, &mut buffer) {
        for byte in frame {
            put(*byte);
        }
    }
}
