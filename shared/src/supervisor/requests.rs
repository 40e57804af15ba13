//! Answers the host's requests: what a board's main loop does with each of them.
//!
//! [`RequestHandler`] is the same on a microcontroller and on a board that is simulated. What only
//! the board has, its table slots, its log and its tick's interrupt, it is given as [`Services`]. It
//! reaches the [`Supervisor`] through short locks, as the tick comes in between: making a
//! controller, which takes long, holds none.

use crate::link::{
    ClockSource, FrameErrors, Identity, Mode, Obstacles, Program, Refusal, Reply, Request, Setup,
    StartReason, Status,
};
use crate::supervisor::controller_slot::ControllerSlot;
use crate::supervisor::enabling::{
    SafetyLimits, StartPose, check_enable, check_torque_bound, each_obstacle, select_table,
};
use crate::supervisor::monitors::Monitors;
use crate::supervisor::parameters::ControllerParameters;
use crate::supervisor::sensing::Calibration;
use crate::supervisor::supervisor::{Supervisor, SupervisorStatus};
use crate::table::{Slot, SlotError, Table, TableIdentity};
use rtic_core::Mutex;

/// What of a board's constants enabling asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardConstants {
    /// How counts become SI values.
    pub calibration: Calibration,
    /// Limits for enabling.
    pub safety: SafetyLimits,
    /// Largest torques that the drives can be asked for, N m.
    pub drive_limit_nm: [f64; 2],
    /// Control rate, Hz.
    pub tick_rate_hz: u32,
}

/// Who a board is, apart from its arm and its tables: that part of its [`Identity`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardFacts {
    /// The firmware's version: major, minor, patch.
    pub version: [u16; 3],
    /// First 4 bytes of its git commit; 0 where that is not known.
    pub git: [u8; 4],
    /// True when the sources differed from that commit.
    pub modified: bool,
    /// Core clock, Hz.
    pub core_hz: u32,
    /// Stopwatch rate, Hz.
    pub stopwatch_hz: u32,
    /// Ticks of the stopwatch that 1,000 `nop` instructions took at start.
    pub ticks_hw_per_1000_nops: u32,
    /// Where the clock comes from.
    pub clock: ClockSource,
    /// Why it started.
    pub start: StartReason,
}

/// What of a board's state the supervisor does not know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardHealth {
    /// Deepest stack since start, bytes.
    pub stack_bytes: u32,
    /// Frames that were dropped.
    pub frame_errors: FrameErrors,
    /// Received bytes that overran the line or a queue.
    pub bytes_lost: u32,
    /// Log entries lost because nobody read the log in time.
    pub logs_lost: u32,
}

/// What is worth a line in the board's log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// Asked who it is: why it started, and its clock.
    Identified(StartReason, ClockSource),
    /// What was found in a slot when asked who it is.
    SlotOpened(Slot, Result<TableIdentity, SlotError>),
    /// The drives were enabled with this table.
    Enabled(Slot, TableIdentity),
    /// A request was refused.
    Refused(Refusal),
}

/// What only the board has that answers requests. `'a` is how long its tables stay where they are.
pub trait Services<'a> {
    /// Opens a slot's table, all checks made, for the arm with this fingerprint; without one every
    /// table is refused.
    ///
    /// # Errors
    /// The first [`SlotError`] that applies.
    fn open(&self, slot: Slot, arm_fingerprint: Option<u32>) -> Result<Table<'a>, SlotError>;

    /// Runs the supervisor's tick once, as if the timer had asked for it: on a microcontroller its
    /// interrupt is requested, and has been taken when this returns.
    fn request_tick<M: Mutex<T = Supervisor<'a>>>(&mut self, supervisor: &mut M);

    /// Stack, line and log.
    fn health(&self) -> BoardHealth;

    /// Puts an event into the log.
    fn note(&mut self, event: &Event);
}

/// Answers requests, in the main loop.
#[derive(Debug)]
pub struct RequestHandler<'a> {
    parameters: Option<ControllerParameters>,
    /// CRC of the setup that they were made from.
    setup_crc: Option<u32>,
    /// Who enabled.
    session: u32,
    constants: &'a BoardConstants,
    facts: BoardFacts,
    /// Where the next controller is made, apart from the tick's.
    prepared: ControllerSlot<'a>,
}

impl<'a> RequestHandler<'a> {
    /// A handler for a board with this setup in its image, `None` where that is damaged. Controllers
    /// are made in `prepared`.
    pub fn new(
        setup: Option<&Setup>,
        constants: &'a BoardConstants,
        facts: BoardFacts,
        prepared: ControllerSlot<'a>,
    ) -> Self {
        Self {
            parameters: setup.map(ControllerParameters::from),
            setup_crc: setup.map(Setup::crc),
            session: 0,
            constants,
            facts,
            prepared,
        }
    }

    /// Who this is; opens both slots.
    pub fn identity(&self, services: &mut impl Services<'a>) -> Reply {
        let facts = &self.facts;
        services.note(&Event::Identified(facts.start, facts.clock));
        let arm_fingerprint = self.parameters.map(|own| own.arm.fingerprint());
        // Without an arm every table is refused.
        let slots = Slot::ALL.map(|slot| {
            let table = services.open(slot, arm_fingerprint);
            let table = table.map(|table| TableIdentity::from(&table));
            services.note(&Event::SlotOpened(slot, table));
            table
        });
        Reply::Identity(Identity {
            version: facts.version,
            git: facts.git,
            modified: facts.modified,
            arm_fingerprint,
            setup_crc: self.setup_crc,
            slots,
            tick_rate_hz: self.constants.tick_rate_hz,
            core_hz: facts.core_hz,
            stopwatch_hz: facts.stopwatch_hz,
            ticks_hw_per_1000_nops: facts.ticks_hw_per_1000_nops,
            clock: facts.clock,
            start: facts.start,
        })
    }

    /// Executes a request and returns its reply.
    pub fn answer(
        &mut self,
        request: &Request,
        supervisor: &mut impl Mutex<T = Supervisor<'a>>,
        services: &mut impl Services<'a>,
    ) -> Reply {
        let done = match *request {
            Request::Hello => return self.identity(services),
            Request::Status => return status(supervisor, services.health()),
            Request::Sensors => return Reply::Sensors(supervisor.lock(|s| s.sensors())),
            Request::KeepAlive { session } if session == self.session => {
                supervisor.lock(Supervisor::link_alive);
                return status(supervisor, services.health());
            }
            Request::KeepAlive { .. } => Err(Refusal::OtherSession),
            Request::Check { slot, program } => {
                return Reply::Obstacles(self.obstacles(slot, program, supervisor, services));
            }
            Request::Stream { every_ticks } => {
                supervisor.lock(|s| s.stream(every_ticks));
                Ok(())
            }
            Request::Enable {
                slot,
                program,
                session,
            } => match self.enable((slot, program, session), supervisor, services) {
                Ok(enabled) => return enabled,
                Err(refusal) => Err(refusal),
            },
            Request::Disable => {
                supervisor.lock(Supervisor::disable);
                // If the timer rested for lock-step, this tick starts it again.
                services.request_tick(supervisor);
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
                match self.start_lock_step(slot, &setup, supervisor, services) {
                    Ok(table) => return Reply::LockStep(table),
                    Err(refusal) => Err(refusal),
                }
            }
            Request::StopLockStep => supervisor
                .lock(Supervisor::stop_lock_step)
                .map(|()| services.request_tick(supervisor)),
            Request::Measured { sequence, measured } => {
                if supervisor.lock(|s| s.post_measurement(sequence, measured)) {
                    // The tick comes at once, being of higher priority.
                    services.request_tick(supervisor);
                    return Reply::Command(supervisor.lock(|s| s.last_reply()));
                }
                Err(Refusal::NotInLockStep)
            }
        };
        match done {
            Ok(()) => Reply::Done,
            Err(refusal) => {
                services.note(&Event::Refused(refusal));
                Reply::Refused(refusal)
            }
        }
    }

    fn enable(
        &mut self,
        (slot, named, session): (Option<Slot>, Program, u32),
        supervisor: &mut impl Mutex<T = Supervisor<'a>>,
        services: &mut impl Services<'a>,
    ) -> Result<Reply, Refusal> {
        if supervisor.lock(|s| s.status().mode) != Mode::Disabled {
            return Err(Refusal::Busy);
        }
        let mut parameters = self.parameters.ok_or(Refusal::NoSetup)?;
        parameters.limits = parameters.limits.at_most(self.constants.drive_limit_nm);
        let fingerprint = Some(parameters.arm.fingerprint());
        let (slot, table) = select_table(slot, |slot| services.open(slot, fingerprint))?;
        self.check_program(&table, Some(named))?;
        let start = StartPose::new(&parameters.law, &parameters.arm, &table.cursor().row());
        let inputs = supervisor.lock(|s| s.enable_inputs());
        check_enable(&self.constants.safety, &inputs, &start)?;
        check_torque_bound(table.torque_bound(), &parameters.limits)?;
        self.prepare(&table, &parameters)?;
        supervisor.lock(|s| s.enable(&mut self.prepared))?;
        self.session = session;
        let table = TableIdentity::from(&table);
        services.note(&Event::Enabled(slot, table));
        Ok(Reply::Enabled { slot, table })
    }

    /// Whether this table with this image's settings is what the host has named.
    fn check_program(&self, table: &Table<'a>, named: Option<Program>) -> Result<(), Refusal> {
        let found = Program {
            table_crc: table.crc(),
            task_fingerprint: table.header().task_fingerprint,
            setup_crc: self.setup_crc.unwrap_or_default(),
        };
        match named {
            Some(named) if named != found => Err(Refusal::OtherProgram { found, named }),
            _ => Ok(()),
        }
    }

    /// Everything that [`enable`](Self::enable) would refuse for.
    fn obstacles(
        &self,
        slot: Option<Slot>,
        named: Option<Program>,
        supervisor: &mut impl Mutex<T = Supervisor<'a>>,
        services: &impl Services<'a>,
    ) -> Obstacles {
        let mut found = Obstacles::new();
        // There are no more than there is room for: one of each kind.
        let mut tell = |refusal| {
            let _ = found.push(refusal);
        };
        if supervisor.lock(|s| s.status().mode) != Mode::Disabled {
            tell(Refusal::Busy);
        }
        let mut start = None;
        if let Some(parameters) = &self.parameters {
            let fingerprint = Some(parameters.arm.fingerprint());
            match select_table(slot, |slot| services.open(slot, fingerprint)) {
                Ok((_, table)) => {
                    if let Err(refusal) = self.check_program(&table, named) {
                        tell(refusal);
                    }
                    let limits = parameters.limits.at_most(self.constants.drive_limit_nm);
                    if let Err(refusal) = check_torque_bound(table.torque_bound(), &limits) {
                        tell(refusal);
                    }
                    start = Some(StartPose::new(
                        &parameters.law,
                        &parameters.arm,
                        &table.cursor().row(),
                    ));
                }
                Err(refusal) => tell(refusal),
            }
        } else {
            tell(Refusal::NoSetup);
        }
        let inputs = supervisor.lock(|s| s.enable_inputs());
        each_obstacle(&self.constants.safety, &inputs, start.as_ref(), tell);
        found
    }

    fn start_lock_step(
        &mut self,
        slot: Slot,
        setup: &Setup,
        supervisor: &mut impl Mutex<T = Supervisor<'a>>,
        services: &impl Services<'a>,
    ) -> Result<TableIdentity, Refusal> {
        if supervisor.lock(|s| s.status().mode) == Mode::Enabled {
            return Err(Refusal::Busy);
        }
        let parameters = ControllerParameters::from(setup);
        let fingerprint = Some(parameters.arm.fingerprint());
        let table = services.open(slot, fingerprint).map_err(Refusal::Table)?;
        self.prepare(&table, &parameters)?;
        supervisor.lock(|s| s.start_lock_step(&mut self.prepared))?;
        Ok(TableIdentity::from(&table))
    }

    /// Makes the next controller, with no lock held.
    fn prepare(
        &mut self,
        table: &Table<'a>,
        parameters: &ControllerParameters,
    ) -> Result<(), Refusal> {
        let controller = parameters
            .controller(table)
            .map_err(|error| Refusal::Table(error.into()))?;
        let BoardConstants {
            calibration,
            tick_rate_hz,
            ..
        } = self.constants;
        let monitors = Monitors::new(&parameters.monitors, calibration, *tick_rate_hz);
        self.prepared.put(controller, monitors);
        Ok(())
    }
}

/// How the board is: the supervisor's status, and what only the board knows.
fn status<'a>(supervisor: &mut impl Mutex<T = Supervisor<'a>>, health: BoardHealth) -> Reply {
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
        stack_bytes: health.stack_bytes,
        frame_errors: health.frame_errors,
        bytes_lost: health.bytes_lost,
        logs_lost: health.logs_lost,
    })
}
