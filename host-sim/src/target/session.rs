//! Requests and replies on a line: frames, the log between them, and time-outs.

use super::error::TargetError;
use super::line::SerialLine;
use super::log::Logs;
use flexor::link::{FRAME_MAX, Identity, Receiver, Reply, Request, TelemetrySample, encode};
use std::collections::VecDeque;
use std::io;
use std::time::{Duration, Instant};

/// The line, its frames and the log on it.
pub(super) struct Session {
    line: Box<dyn SerialLine>,
    /// The serial port's name; `None` for QEMU.
    port: Option<String>,
    /// Longest wait for a reply.
    timeout: Duration,
    receiver: Receiver,
    /// Bytes received so far.
    received: u64,
    /// Replies that have been read with those before them.
    waiting: VecDeque<Reply>,
    /// Telemetry that has been read.
    telemetry: Vec<TelemetrySample>,
    logs: Option<Logs>,
}

impl Session {
    /// A session on a line, of the serial port so called, that waits for each reply so long.
    pub(super) fn new(
        line: Box<dyn SerialLine>,
        port: Option<String>,
        timeout: Duration,
        logs: Option<Logs>,
    ) -> Self {
        Self {
            line,
            port,
            timeout,
            receiver: Receiver::new(),
            received: 0,
            waiting: VecDeque::new(),
            telemetry: Vec::new(),
            logs,
        }
    }

    /// Sends a request and returns the next reply.
    pub(super) fn ask(
        &mut self,
        request: &Request,
        awaited: &'static str,
    ) -> Result<Reply, TargetError> {
        self.send(request, awaited)?;
        self.reply(awaited)
    }

    /// The telemetry that has come since the last call.
    pub(super) fn take_telemetry(&mut self) -> Vec<TelemetrySample> {
        core::mem::take(&mut self.telemetry)
    }

    /// Sends a request.
    pub(super) fn send(
        &mut self,
        request: &Request,
        awaited: &'static str,
    ) -> Result<(), TargetError> {
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(request, &mut buffer).map_err(|error| TargetError::Line {
            awaited,
            source: io::Error::other(error),
        })?;
        self.write(frame, awaited)
    }

    /// Sends bytes as they are.
    pub(super) fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), TargetError> {
        self.line
            .write_all(bytes)
            .map_err(|source| self.failure(awaited, source))
    }

    /// Lets time pass, on the line's clock.
    pub(super) fn pass(&mut self, time: Duration) -> Result<(), TargetError> {
        let passed = self.line.pass(time);
        passed.map_err(|source| self.failure("time", source))
    }

    /// The next reply; what is logged before it goes to the log.
    pub(super) fn reply(&mut self, awaited: &'static str) -> Result<Reply, TargetError> {
        let begun = Instant::now();
        let mut bytes = [0; FRAME_MAX];
        loop {
            if let Some(reply) = self.waiting.pop_front() {
                return Ok(reply);
            }
            // Bytes that are no reply, such as another device's, must not make this wait on.
            if begun.elapsed() > self.timeout {
                return Err(self.failure(awaited, io::ErrorKind::TimedOut.into()));
            }
            let count = match self.line.read(&mut bytes) {
                Ok(0) => return Err(self.failure(awaited, io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => count,
                // A signal; whoever is to heed it does so between two requests.
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(self.failure(awaited, error)),
            };
            self.received += count as u64;
            for byte in &bytes[..count] {
                match self.receiver.push(*byte) {
                    Some(Reply::Log(entry)) => {
                        if let Some(logs) = &mut self.logs {
                            logs.write_log(&entry);
                        }
                    }
                    Some(Reply::Telemetry(sample)) => self.telemetry.push(sample),
                    reply => self.waiting.extend(reply),
                }
            }
        }
    }

    /// The error for a line that gave `source`.
    fn failure(&self, awaited: &'static str, source: io::Error) -> TargetError {
        match &self.port {
            Some(port) if source.kind() == io::ErrorKind::TimedOut => TargetError::Silent {
                port: port.clone(),
                timeout: self.timeout,
                received: self.received,
                dropped: self.receiver.errors(),
            },
            _ => TargetError::Line { awaited, source },
        }
    }

    /// The identity that `reply` is.
    pub(super) fn identity(reply: &Reply) -> Result<Identity, TargetError> {
        match reply {
            Reply::Identity(identity) => Ok(*identity),
            other => Err(unexpected("identity", other)),
        }
    }
}

/// The error for a reply to another question than was asked.
pub(super) fn unexpected(awaited: &'static str, found: &Reply) -> TargetError {
    match found {
        Reply::Identity(Identity { start, .. }) => TargetError::Restarted {
            awaited,
            start: *start,
        },
        _ => TargetError::Unexpected {
            awaited,
            found: format!("{found:?}"),
        },
    }
}
