//! The request handler of [`flexor::supervisor`] on this board: what it has besides its tick.

use crate::board::Clocks;
use crate::board::constants::{CALIBRATION, DRIVE_LIMIT_NM, SAFETY, TICK_RATE_HZ};
use crate::{flash_slots, identity, log, stack};
use flexor::link::{FRAME_MAX, FrameErrors, Reply, StartReason, encode};
use flexor::supervisor::{
    BoardConstants, BoardFacts, BoardHealth, ControllerSlot, Event, RequestHandler, Services,
    Supervisor,
};
use flexor::table::{Slot, SlotError, Table};
use rtic::Mutex;

static CONSTANTS: BoardConstants = BoardConstants {
    calibration: CALIBRATION,
    safety: SAFETY,
    drive_limit_nm: DRIVE_LIMIT_NM,
    tick_rate_hz: TICK_RATE_HZ,
};

/// The handler with the image's setup.
pub fn handler(
    clocks: &Clocks,
    ticks_hw_per_1000_nops: u32,
    start: StartReason,
    prepared: ControllerSlot<'static>,
) -> RequestHandler<'static> {
    let facts = BoardFacts {
        version: identity::VERSION,
        git: identity::GIT,
        modified: identity::MODIFIED,
        core_hz: clocks.core_hz,
        stopwatch_hz: clocks.stopwatch_hz,
        ticks_hw_per_1000_nops,
        clock: clocks.source,
        start,
    };
    RequestHandler::new(flash_slots::setup().as_ref(), &CONSTANTS, facts, prepared)
}

/// What this board has: flash, stack, log, and the tick's interrupt, which `pend` requests.
pub struct Here<P: Fn()> {
    /// Requests the tick's interrupt, and lets it be taken.
    pub pend: P,
    /// Frames that were dropped since start.
    pub frames: FrameErrors,
    /// Bytes that overran the line or the receive queue.
    pub bytes_lost: u32,
}

impl<P: Fn()> Services<'static> for Here<P> {
    fn open(&self, slot: Slot, arm_fingerprint: Option<u32>) -> Result<Table<'static>, SlotError> {
        flash_slots::open(slot, arm_fingerprint)
    }

    fn request_tick<M: Mutex<T = Supervisor<'static>>>(&mut self, _: &mut M) {
        (self.pend)();
    }

    fn health(&self) -> BoardHealth {
        BoardHealth {
            stack_bytes: stack::deepest(),
            frame_errors: self.frames,
            bytes_lost: self.bytes_lost,
            logs_lost: log::lost(),
        }
    }

    fn note(&mut self, event: &Event) {
        match event {
            Event::Identified(start, clock) => defmt::info!("start: {}, clock: {}", start, clock),
            Event::SlotOpened(slot, Ok(table)) => defmt::info!(
                "slot {}: table {=u32:#x}, task {=u32:#x}",
                slot,
                table.crc,
                table.task_fingerprint
            ),
            Event::SlotOpened(slot, Err(error)) => {
                defmt::info!("slot {}: no usable table, {}", slot, error);
            }
            Event::Enabled(slot, table) => {
                defmt::info!("enabled, slot {}: table {=u32:#x}", slot, table.crc);
            }
            Event::Refused(refusal) => defmt::warn!("refused: {}", refusal),
        }
    }
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
