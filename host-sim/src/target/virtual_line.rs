//! The line of a virtual board: frames in and out of it, as bytes of a clock that is the board's own.

use crate::simulation::bench::{BenchError, VirtualBoard};
use flexor::link::{FRAME_MAX, Receiver, Reply, Request, encode};
use flexor::supervisor::BoardHealth;
use std::collections::VecDeque;

/// Bytes that wait to be sent at most, with an answer yet to come: as much as a board's queue takes.
const QUEUE_BYTES: usize = 1024;

/// One end of a line at a virtual board.
pub(super) struct VirtualLine {
    receiver: Receiver,
    /// Bytes that wait until the line has time for them.
    queue: VecDeque<u8>,
    /// Bytes that the line carries in a control period; infinite for as many as there are.
    bytes_per_tick: f64,
    /// Share of a byte's time that is left.
    credit: f64,
    /// Bytes that have passed the line.
    pub(super) sent: VecDeque<u8>,
}

impl VirtualLine {
    /// A line that carries so many bytes in a control period.
    pub(super) fn new(bytes_per_tick: f64) -> Self {
        Self {
            receiver: Receiver::new(),
            queue: VecDeque::new(),
            bytes_per_tick,
            credit: 0.0,
            sent: VecDeque::new(),
        }
    }

    /// Bytes from the host: each request that they end is answered at once. True where one of them asked
    /// for telemetry.
    ///
    /// # Errors
    /// The board's.
    pub(super) fn receive(
        &mut self,
        bytes: &[u8],
        board: &mut VirtualBoard<'_>,
    ) -> Result<bool, BenchError> {
        let mut streams = false;
        for byte in bytes {
            if let Some(request) = self.receiver.push(*byte) {
                streams |= matches!(request, Request::Stream { .. });
                board.set_health(BoardHealth {
                    frame_errors: self.receiver.errors(),
                    ..BoardHealth::default()
                });
                if let Some(reply) = board.answer(&request)? {
                    self.send(&reply);
                }
            }
        }
        Ok(streams)
    }

    /// Whether an answer would still fit behind one more message.
    pub(super) fn has_room(&self) -> bool {
        self.bytes_per_tick.is_infinite() || self.queue.len() + 2 * FRAME_MAX <= QUEUE_BYTES
    }

    /// Sends a message.
    pub(super) fn send(&mut self, reply: &Reply) {
        // No message is longer than a frame.
        if let Ok(frame) = encode(reply, &mut [0; FRAME_MAX]) {
            self.queue.extend(frame);
        }
        if self.bytes_per_tick.is_infinite() {
            self.sent.append(&mut self.queue);
        }
    }

    /// Lets a control period pass, at the board and on its line.
    pub(super) fn pass(&mut self, board: &mut VirtualBoard<'_>) {
        board.tick();
        self.tick();
        self.take_telemetry(board);
    }

    /// Sends the telemetry that there is room for, answers before it.
    pub(super) fn take_telemetry(&mut self, board: &mut VirtualBoard<'_>) {
        while self.has_room()
            && let Some(sample) = board.telemetry()
        {
            self.send(&Reply::Telemetry(sample));
        }
    }

    /// A control period has passed.
    pub(super) fn tick(&mut self) {
        self.credit = (self.credit + self.bytes_per_tick).min(self.bytes_per_tick + 1.0);
        while self.credit >= 1.0
            && let Some(byte) = self.queue.pop_front()
        {
            self.credit -= 1.0;
            self.sent.push_back(byte);
        }
    }
}
