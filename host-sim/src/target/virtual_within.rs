//! A virtual board within the process: its time passes when the host waits, and only then.
//!
//! The board lives in a thread of its own, and does what the host's end of the line asks of it, one
//! thing after the other: take bytes, or let time pass. So a run is the same every time, and takes as
//! long as computing it does.

use super::line::SerialLine;
use super::virtual_line::VirtualLine;
use crate::simulation::bench::{BenchError, VirtualBoard, VirtualPlaces, VirtualSetting};
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Duration;

/// What the host's end asks of the board.
enum Job {
    /// Take these bytes.
    Take(Vec<u8>),
    /// Let so many ticks pass.
    Pass(u64),
    /// Let ticks pass until something is sent, no more than so many.
    PassUntilSent(u64),
}

/// The host's end of the line.
pub struct LineWithin {
    jobs: Sender<Job>,
    sent: Receiver<Vec<u8>>,
    waiting: VecDeque<u8>,
    tick_rate_hz: f64,
    timeout: Duration,
}

/// Starts a board in `scope`. A read of its line gives up after `timeout` of the board's time. The board
/// ends when its line is dropped.
pub fn start_within<'scope, 'env>(
    scope: &'scope Scope<'scope, 'env>,
    setting: &'env VirtualSetting<'env>,
    timeout: Duration,
) -> (LineWithin, ScopedJoinHandle<'scope, Result<(), BenchError>>) {
    let (jobs, to_do) = channel();
    let (done, sent) = channel();
    let board = scope.spawn(move || run(setting, &to_do, &done));
    let line = LineWithin {
        jobs,
        sent,
        waiting: VecDeque::new(),
        tick_rate_hz: f64::from(setting.tick_rate_hz()),
        timeout,
    };
    (line, board)
}

/// The board's thread.
fn run(
    setting: &VirtualSetting<'_>,
    jobs: &Receiver<Job>,
    done: &Sender<Vec<u8>>,
) -> Result<(), BenchError> {
    let mut places: VirtualPlaces<'_> = [None, None];
    let mut board = VirtualBoard::new(setting, &mut places)?;
    let mut line = VirtualLine::new(f64::INFINITY);
    board.tick();
    while let Ok(job) = jobs.recv() {
        match job {
            Job::Take(bytes) => {
                line.receive(&bytes, &mut board)?;
            }
            Job::Pass(ticks) => (0..ticks).for_each(|_| line.pass(&mut board)),
            Job::PassUntilSent(ticks) => {
                for _ in 0..ticks {
                    if !line.sent.is_empty() {
                        break;
                    }
                    line.pass(&mut board);
                }
            }
        }
        if done.send(line.sent.drain(..).collect()).is_err() {
            break;
        }
    }
    Ok(())
}

impl LineWithin {
    fn ticks(&self, time: Duration) -> u64 {
        (time.as_secs_f64() * self.tick_rate_hz).round() as u64
    }

    fn ask(&mut self, job: Job) -> io::Result<()> {
        let ended = || io::Error::other("the virtual board has ended");
        self.jobs.send(job).map_err(|_| ended())?;
        self.waiting.extend(self.sent.recv().map_err(|_| ended())?);
        Ok(())
    }
}

impl Read for LineWithin {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.waiting.is_empty() {
            self.ask(Job::PassUntilSent(self.ticks(self.timeout)))?;
        }
        match self.waiting.read(buffer)? {
            0 => Err(io::ErrorKind::TimedOut.into()),
            count => Ok(count),
        }
    }
}

impl Write for LineWithin {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.ask(Job::Take(bytes.to_vec()))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl SerialLine for LineWithin {
    fn pass(&mut self, time: Duration) -> io::Result<()> {
        self.ask(Job::Pass(self.ticks(time)))
    }
}
