//! Answers the host's requests, in the main loop.

use crate::board::Clocks;
use crate::board::constants::{CALIBRATION, DRIVE_LIMIT_NM, SAFETY, TICK_RATE_HZ};
use crate::{flash_slots, identity, log, stack};
use flexor::link::{
    FRAME_MAX, FrameErrors, Identity, Mode, Refusal, Reply, Request, Setup, StartReason, Status,
    encode,
};
use flexor::supervisor::{
    ControllerParameters, ControllerSlot, Monitors, StartPose, Supervisor, SupervisorStatus,
    check_enable, check_torque_bound, select_table,
};
use flexor::table::{Slot, Table, TableIdentity};
use rtic::Mutex;

/// What the line from the host has lost since start.
#[derive(Clone, Copy)]
pub struct LineErrors {
    /// Frames that were dropped.
    pub frames: FrameErrors,
    /// Bytes that overran the line or the receive queue.
    pub bytes_lost: u32,
}

/// State of the request handler, in the main loop at priority 0.
pub struct Comms {
    parameters: Option<ControllerParameters>,
    clocks: Clocks,
    ticks_hw_per_1000_nops: u32,
    start: StartReason,
    /// Where the next controller is made, apart from the tick's.
    prepared: ControllerSlot<'static>,
}

impl Comms {
    /// Reads the image's setup.
    pub fn new(
        clocks: &Clocks,
        ticks_hw_per_1000_nops: u32,
        start: StartReason,
        prepared: ControllerSlot<'static>,
    ) -> Self {
        Self {
            parameters: flash_slots::setup().map(|setup| ControllerParameters::from(&setup)),
            clocks: *clocks,
            ticks_hw_per_1000_nops,
            start,
            prepared,
        }
    }

    /// Who this is; opens both slots.
    pub fn identity(&self) -> Reply {
        defmt::info!("start: {}, clock: {}", self.start, self.clocks.source);
        let arm_fingerprint = self.parameters.map(|own| own.arm.fingerprint());
        // Without an arm every table is refused.
        let slots = Slot::ALL.map(|slot| {
            let table = flash_slots::open(slot, arm_fingerprint);
            match &table {
                Ok(table) => defmt::info!(
                    "slot {}: table {=u32:#x}, task {=u32:#x}",
                    slot,
                    table.crc(),
                    table.header().task_fingerprint
                ),
                Err(error) => defmt::info!("slot {}: no usable table, {}", slot, error),
            }
            table.map(|table| TableIdentity::from(&table))
        });
        Reply::Identity(Identity {
            version: identity::VERSION,
            git: identity::GIT,
            modified: identity::MODIFIED,
            arm_fingerprint,
            slots,
            tick_rate_hz: TICK_RATE_HZ,
            core_hz: self.clocks.core_hz,
            stopwatch_hz: self.clocks.stopwatch_hz,
            ticks_hw_per_1000_nops: self.ticks_hw_per_1000_nops,
            clock: self.clocks.source,
            start: self.start,
        })
    }

    /// Executes a request and returns its reply. `line` is what was lost so far;
    /// `pend` triggers the tick's interrupt.
    pub fn answer(
        &mut self,
        request: &Request,
        supervisor: &mut impl Mutex<T = Supervisor<'static>>,
        line: LineErrors,
        pend: impl Fn(),
    ) -> Reply {
        supervisor.lock(Supervisor::link_alive);
        let done = match *request {
            Request::Hello => return self.identity(),
            Request::Status => return status(supervisor, line),
            Request::Sensors => return Reply::Sensors(supervisor.lock(|s| s.sensors())),
            Request::Enable { slot } => match self.enable(slot, supervisor) {
                Ok((slot, table)) => return Reply::Enabled { slot, table },
                Err(refusal) => Err(refusal),
            },
            Request::Disable => {
                supervisor.lock(Supervisor::disable);
                // If the timer rested for lock-step, this tick starts it again.
                pend();
                Ok(())
            }
            Request::Acknowledge => {
                supervisor.lock(Supervisor::acknowledge);
                Ok(())
            }
            Request::Home => supervisor.lock(Supervisor::home),
            Request::Pause => supervisor.lock(|s| s.pause(true)),
            Request::Resume => supervisor.lock(|s| s.pause(false)),
            Request::Retract => supervisor.lock(Supervisor::retract),
            Request::StartLockStep { slot, setup } => {
                match self.start_lock_step(slot, &setup, supervisor) {
                    Ok(table) => return Reply::LockStep(table),
                    Err(refusal) => Err(refusal),
                }
            }
            Request::StopLockStep => supervisor.lock(Supervisor::stop_lock_step).map(|()| pend()),
            Request::Measured { sequence, measured } => {
                if supervisor.lock(|s| s.post_measurement(sequence, measured)) {
                    // The tick comes at once, being of higher priority.
                    pend();
                    return Reply::Command(supervisor.lock(|s| s.last_reply()));
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

    fn enable(
        &mut self,
        slot: Option<Slot>,
        supervisor: &mut impl Mutex<T = Supervisor<'static>>,
    ) -> Result<(Slot, TableIdentity), Refusal> {
        if supervisor.lock(|s| s.status().mode) != Mode::Disabled {
            return Err(Refusal::Busy);
        }
        let mut parameters = self.parameters.ok_or(Refusal::NoSetup)?;
        parameters.limits = parameters.limits.at_most(DRIVE_LIMIT_NM);
        let fingerprint = Some(parameters.arm.fingerprint());
        let (slot, table) = select_table(slot, |slot| flash_slots::open(slot, fingerprint))?;
        let start = StartPose::new(&parameters.law, &table.cursor().row());
        let inputs = supervisor.lock(|s| s.enable_inputs());
        check_enable(&SAFETY, &inputs, &start)?;
        check_torque_bound(table.torque_bound(), &parameters.limits)?;
        self.prepare(&table, &parameters)?;
        supervisor.lock(|s| s.enable(&mut self.prepared))?;
        defmt::info!("enabled, slot {}: table {=u32:#x}", slot, table.crc());
        Ok((slot, TableIdentity::from(&table)))
    }

    fn start_lock_step(
        &mut self,
        slot: Slot,
        setup: &Setup,
        supervisor: &mut impl Mutex<T = Supervisor<'static>>,
    ) -> Result<TableIdentity, Refusal> {
        if supervisor.lock(|s| s.status().mode) == Mode::Enabled {
            return Err(Refusal::Busy);
        }
        let parameters = ControllerParameters::from(setup);
        let fingerprint = Some(parameters.arm.fingerprint());
        let table = flash_slots::open(slot, fingerprint).map_err(Refusal::Table)?;
        self.prepare(&table, &parameters)?;
        supervisor.lock(|s| s.start_lock_step(&mut self.prepared))?;
        Ok(TableIdentity::from(&table))
    }

    /// Makes the next controller, with no lock held.
    fn prepare(
        &mut self,
        table: &Table<'static>,
        parameters: &ControllerParameters,
    ) -> Result<(), Refusal> {
        let controller = parameters
            .controller(table)
            .map_err(|error| Refusal::Table(error.into()))?;
        let monitors = Monitors::new(&parameters.monitors, &CALIBRATION, TICK_RATE_HZ);
        self.prepared.put(controller, monitors);
        Ok(())
    }
}

/// How the board is: the supervisor's status, and what only the board knows.
fn status(supervisor: &mut impl Mutex<T = Supervisor<'static>>, line: LineErrors) -> Reply {
    let SupervisorStatus {
        mode,
        tick,
        fault,
        run,
        ticks_total,
        ticks_hw_max,
    } = supervisor.lock(|s| s.status());
    Reply::Status(Status {
        mode,
        tick,
        fault,
        run,
        ticks_total,
        ticks_hw_max,
        stack_bytes: stack::deepest(),
        frame_errors: line.frames,
        bytes_lost: line.bytes_lost,
        logs_lost: log::lost(),
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
