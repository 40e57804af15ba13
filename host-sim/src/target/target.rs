//! The microcontroller as seen from the host: the firmware's image in QEMU, or a real board
//! on a serial port, that answers the requests of [`flexor::link`].

use super::error::TargetError;
use super::line::{SerialLine, open_port};
use super::log::Logs;
use super::qemu::{Emulation, Emulator, TIMEOUT};
use super::session::{Session, unexpected};
use super::virtual_within::LineWithin;
use flexor::link::{
    ClockSource, Identity, Obstacles, Program, Reply, Request, SensorReport, Setup, Status,
    TelemetrySample, TickReply,
};
use flexor::signals::Measurement;
use flexor::table::{Slot, TableIdentity};
use std::time::Duration;

/// A microcontroller that answers requests.
pub struct Target {
    session: Session,
    identity: Identity,
    /// True when its stopwatch counts instructions.
    counts_instructions: bool,
    _emulator: Option<Emulator>,
}

impl Target {
    /// Starts QEMU with the firmware's image.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn emulated(emulation: &Emulation, logs: Option<Logs>) -> Result<Self, TargetError> {
        let (mut emulator, line) = Emulator::start(emulation)?;
        let mut session = Session::new(Box::new(line), None, TIMEOUT, logs);
        // Bytes before the firmware's first are lost: it introduces itself.
        let identity = Session::identity(&session.reply("identity")?)?;
        emulator.started();
        Ok(Self {
            session,
            identity,
            counts_instructions: true,
            _emulator: Some(emulator),
        })
    }

    /// Opens a real board's serial port and asks who is there. From then on the board may
    /// take `timeout` to answer.
    ///
    /// # Errors
    /// [`TargetError::Silent`] if nobody answers; else other [`TargetError`]s.
    pub fn on_port(port: &str, timeout: Duration, logs: Option<Logs>) -> Result<Self, TargetError> {
        Self::on_line(open_port(port, timeout)?, port, timeout, logs)
    }

    /// Asks who is on the `line` of a virtual board within the process.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn within(line: LineWithin, timeout: Duration) -> Result<Self, TargetError> {
        Self::on_line(Box::new(line), "virtual board", timeout, None)
    }

    /// Asks who is on a line, of the port so called.
    fn on_line(
        line: Box<dyn SerialLine>,
        port: &str,
        timeout: Duration,
        logs: Option<Logs>,
    ) -> Result<Self, TargetError> {
        let mut session = Session::new(line, Some(port.to_owned()), timeout, logs);
        session.write(&[0], "identity")?; // ends what a broken run left
        // A board that has just started introduces itself once more by itself. The status
        // comes after both, and after what a broken run may have left unread.
        let mut reply = session.ask(&Request::Hello, "identity")?;
        let mut identity = Session::identity(&reply);
        session.send(&Request::Status, "status")?;
        while !matches!(reply, Reply::Status(_)) {
            if let Reply::Identity(found) = reply {
                identity = Ok(found);
            }
            reply = session.reply("status")?;
        }
        let identity = identity?;
        Ok(Self {
            session,
            identity,
            counts_instructions: false,
            _emulator: None,
        })
    }

    /// Lets time pass; on a virtual board within the process its own.
    ///
    /// # Errors
    /// [`TargetError`] where such a board has ended.
    pub fn pass(&mut self, time: Duration) -> Result<(), TargetError> {
        self.session.pass(time)
    }

    /// Whether it is a virtual board.
    pub fn is_virtual(&self) -> bool {
        self.identity.clock == ClockSource::Simulated
    }

    /// Who the microcontroller is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// How the microcontroller is.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn status(&mut self) -> Result<Status, TargetError> {
        match self.ask(&Request::Status, "status")? {
            Reply::Status(status) => Ok(status),
            other => Err(unexpected("status", &other)),
        }
    }

    /// What its sensors and interlocks say.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn sensors(&mut self) -> Result<SensorReport, TargetError> {
        match self.ask(&Request::Sensors, "sensors")? {
            Reply::Sensors(report) => Ok(report),
            other => Err(unexpected("sensors", &other)),
        }
    }

    /// Enables the drives and runs a slot's table, or without a slot slot A's, or slot B's
    /// where A has none that is usable, where that is `program`. Says which runs. From now on the
    /// microcontroller must be [kept alive](Self::keep_alive) with `session` every 100 ms, or it stops
    /// by itself.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if it is not enabled; else other [`TargetError`]s, after
    /// which it may be enabled.
    pub fn enable(
        &mut self,
        slot: Option<Slot>,
        program: Program,
        session: u32,
    ) -> Result<(Slot, TableIdentity), TargetError> {
        let enable = Request::Enable {
            slot,
            program,
            session,
        };
        match self.ask(&enable, "consent to enable")? {
            Reply::Enabled { slot, table } => Ok((slot, table)),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent to enable", &other)),
        }
    }

    /// Keeps an arm enabled that `session` has enabled, and asks how it is.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if another session has enabled it; else other [`TargetError`]s.
    pub fn keep_alive(&mut self, session: u32) -> Result<Status, TargetError> {
        match self.ask(&Request::KeepAlive { session }, "status")? {
            Reply::Status(status) => Ok(status),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("status", &other)),
        }
    }

    /// Everything that is in the way of enabling a slot's table, and of `program` where one is meant.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn check(
        &mut self,
        slot: Option<Slot>,
        program: Option<Program>,
    ) -> Result<Obstacles, TargetError> {
        match self.ask(&Request::Check { slot, program }, "obstacles")? {
            Reply::Obstacles(obstacles) => Ok(obstacles),
            other => Err(unexpected("obstacles", &other)),
        }
    }

    /// Lets it send every so many ticks of an enabled arm; 0 for none.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn stream(&mut self, every_ticks: u16) -> Result<(), TargetError> {
        self.done(&Request::Stream { every_ticks })
    }

    /// The telemetry that has come since the last call, in order; read with the answers.
    pub fn take_telemetry(&mut self) -> Vec<TelemetrySample> {
        self.session.take_telemetry()
    }

    /// Switches the drives off, and ends lock-step. Passes over answers to earlier requests,
    /// so that it may follow any error.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn disable(&mut self) -> Result<(), TargetError> {
        let awaited = "consent to disable";
        let mut reply = self.ask(&Request::Disable, awaited)?;
        // An earlier request's answer is one message, and perhaps an identity after it.
        for _ in 0..4 {
            if reply == Reply::Done {
                return Ok(());
            }
            reply = self.reply(awaited)?;
        }
        Err(unexpected(awaited, &reply))
    }

    /// Tells that the arm stands at its home pose.
    ///
    /// # Errors
    /// [`TargetError::Refused`] unless disabled; else other [`TargetError`]s.
    pub fn home(&mut self) -> Result<(), TargetError> {
        match self.ask(&Request::Home, "consent")? {
            Reply::Done => Ok(()),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Lets the table stand where it is (`true`), or go on.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if there is no run that can; else other [`TargetError`]s.
    pub fn pause(&mut self, paused: bool) -> Result<(), TargetError> {
        self.done(if paused {
            &Request::Pause
        } else {
            &Request::Resume
        })
    }

    /// Ends the run: the tip is lifted off the surface, and the arm stands with its drives on.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if there is no run, or its law cannot; else other
    /// [`TargetError`]s.
    pub fn retract(&mut self) -> Result<(), TargetError> {
        self.done(&Request::Retract)
    }

    /// A request that is answered by its being done.
    fn done(&mut self, request: &Request) -> Result<(), TargetError> {
        match self.ask(request, "consent")? {
            Reply::Done => Ok(()),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Lets the microcontroller forget its latched fault.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn acknowledge(&mut self) -> Result<(), TargetError> {
        match self.ask(&Request::Acknowledge, "consent")? {
            Reply::Done => Ok(()),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Begins lock-step with the table in a slot, and says which that is.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if the microcontroller cannot; else other [`TargetError`]s.
    pub fn start(&mut self, slot: Slot, setup: &Setup) -> Result<TableIdentity, TargetError> {
        let setup = *setup;
        match self.ask(&Request::StartLockStep { slot, setup }, "consent")? {
            Reply::LockStep(table) => Ok(table),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// One tick.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn tick(
        &mut self,
        sequence: u32,
        measured: &Measurement<f32>,
    ) -> Result<TickReply, TargetError> {
        let measured = *measured;
        match self.ask(&Request::Measured { sequence, measured }, "command")? {
            Reply::Command(reply) if reply.sequence == sequence => Ok(reply),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("command", &other)),
        }
    }

    /// Sends a request and returns the reply.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn ask(&mut self, request: &Request, awaited: &'static str) -> Result<Reply, TargetError> {
        self.session.ask(request, awaited)
    }

    /// Sends bytes as they are: for tests of the other end.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), TargetError> {
        self.session.write(bytes, awaited)
    }

    /// The next reply, to a request that was written as bytes.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn reply(&mut self, awaited: &'static str) -> Result<Reply, TargetError> {
        self.session.reply(awaited)
    }

    /// Instructions for ticks of the stopwatch; `None` on hardware, whose stopwatch counts time.
    pub fn instructions(&self, ticks_hw: u32) -> Option<u32> {
        let nops = u64::from(self.identity.ticks_hw_per_1000_nops);
        if !self.counts_instructions || nops == 0 {
            return None;
        }
        u32::try_from((u64::from(ticks_hw) * 1000 + nops / 2) / nops).ok()
    }

    /// Core cycles for ticks of the stopwatch; `None` in the emulator, which does not know them.
    /// The stopwatch counts them, or a timer's clock where the core has no such counter.
    pub fn cycles(&self, ticks_hw: u32) -> Option<u32> {
        let Identity {
            core_hz,
            stopwatch_hz,
            ..
        } = self.identity;
        if self.counts_instructions || self.is_virtual() {
            return None;
        }
        let cycles = u64::from(ticks_hw) * u64::from(core_hz) / u64::from(stopwatch_hz.max(1));
        u32::try_from(cycles).ok()
    }
}
