//! Frames of messages on a byte stream.
//!
//! # Frame
//!
//! ```text
//! COBS( version u8 | message | CRC-32 u32 little-endian ) 0x00
//! ```
//!
//! COBS (consistent overhead byte stuffing) removes all zero bytes, so a zero ends a
//! frame and only that; after garbage the next zero resynchronises. An empty frame (two
//! zeros in a row) is ignored, and may be sent to end garbage. The CRC is ISO-HDLC, over
//! version and message. A decoded frame has at most [`PAYLOAD_MAX`] bytes. Frames that are
//! too long, not COBS, of another version, with a wrong CRC or without a known message are
//! dropped and counted ([`FrameErrors`]); they are not answered.

use crate::CRC32;
use postcard::ser_flavors::{Cobs, Slice, crc::CrcModifier};
use serde::{Deserialize, Serialize};

/// Version of the protocol, first byte of every frame.
pub const VERSION: u8 = 6;

/// Most bytes of a frame before COBS: version, message, CRC. COBS adds one byte to each 254 begun
/// of that, and the end one more.
pub const PAYLOAD_MAX: usize = 381;

/// Most bytes of a frame on the line.
pub const FRAME_MAX: usize = PAYLOAD_MAX + PAYLOAD_MAX.div_ceil(254) + 1;

/// Frames that were dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameErrors {
    /// Longer than [`FRAME_MAX`].
    pub oversized: u32,
    /// Not COBS.
    pub stuffing: u32,
    /// Of another protocol version.
    pub version: u32,
    /// Too short, or with a wrong CRC.
    pub crc: u32,
    /// No known message.
    pub message: u32,
}

/// A message does not fit a frame. No message of this module does that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameTooLong;

impl core::fmt::Display for FrameTooLong {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "message is longer than {PAYLOAD_MAX} bytes")
    }
}

impl core::error::Error for FrameTooLong {}

/// Writes a message's frame, ending zero included, and returns its bytes.
///
/// ```
/// use flexor::link::{FRAME_MAX, Request, encode};
///
/// let mut buffer = [0; FRAME_MAX];
/// let frame = encode(&Request::Status, &mut buffer)?;
/// // Version, request 1, and four bytes of CRC; a code byte of COBS before, a zero behind.
/// assert_eq!(frame.len(), 8);
/// assert_eq!(frame.iter().position(|byte| *byte == 0), Some(7));
/// # Ok::<(), flexor::link::FrameTooLong>(())
/// ```
///
/// # Errors
/// [`FrameTooLong`].
pub fn encode<'b, M: Serialize>(
    message: &M,
    buffer: &'b mut [u8; FRAME_MAX],
) -> Result<&'b [u8], FrameTooLong> {
    let stuffing = Cobs::try_new(Slice::new(buffer)).map_err(|_| FrameTooLong)?;
    postcard::serialize_with_flavor(
        &(VERSION, message),
        CrcModifier::new(stuffing, CRC32.digest()),
    )
    .map(|bytes| &*bytes)
    .map_err(|_| FrameTooLong)
}

/// Finds messages in a byte stream.
///
/// ```
/// use flexor::link::{FRAME_MAX, Receiver, Request, encode};
///
/// let mut buffer = [0; FRAME_MAX];
/// let frame = encode(&Request::Home, &mut buffer)?;
/// let mut receiver = Receiver::new();
/// // The end of a frame whose beginning was missed, then a whole one.
/// let found: Vec<Request> = [17, 4, 0]
///     .iter()
///     .chain(frame)
///     .filter_map(|byte| receiver.push(*byte))
///     .collect();
/// assert_eq!(found, [Request::Home]);
/// assert_eq!(receiver.errors().stuffing, 1);
/// # Ok::<(), flexor::link::FrameTooLong>(())
/// ```
#[derive(Clone, Debug)]
pub struct Receiver {
    buffer: [u8; FRAME_MAX],
    length: usize,
    errors: FrameErrors,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// A receiver at the beginning of a frame.
    pub const fn new() -> Self {
        Self {
            buffer: [0; FRAME_MAX],
            length: 0,
            errors: FrameErrors {
                oversized: 0,
                stuffing: 0,
                version: 0,
                crc: 0,
                message: 0,
            },
        }
    }

    /// Frames dropped so far.
    pub fn errors(&self) -> FrameErrors {
        self.errors
    }

    /// Takes a byte; returns a message when the byte ends a good frame.
    pub fn push<'a, M: Deserialize<'a>>(&'a mut self, byte: u8) -> Option<M> {
        if byte != 0 {
            if let Some(place) = self.buffer.get_mut(self.length) {
                *place = byte;
            }
            // One past the buffer remembers that the frame is too long.
            self.length = (self.length + 1).min(FRAME_MAX + 1);
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if length == 0 {
            return None;
        }
        match Self::decode(self.buffer.get_mut(..length)) {
            Ok(message) => Some(message),
            Err(counter) => {
                let count = counter(&mut self.errors);
                *count = count.saturating_add(1);
                None
            }
        }
    }

    /// The message of a whole frame, or which error to count.
    fn decode<'a, M: Deserialize<'a>>(
        frame: Option<&'a mut [u8]>,
    ) -> Result<M, fn(&mut FrameErrors) -> &mut u32> {
        let frame = frame.ok_or((|e| &mut e.oversized) as fn(&mut FrameErrors) -> &mut u32)?;
        let length = cobs::decode_in_place(frame)
            .map_err(|_| (|e| &mut e.stuffing) as fn(&mut FrameErrors) -> &mut u32)?;
        let payload: &'a [u8] = frame.get(..length).unwrap_or_default();
        let (body, crc) = payload
            .split_last_chunk::<4>()
            .ok_or((|e| &mut e.crc) as fn(&mut FrameErrors) -> &mut u32)?;
        if CRC32.checksum(body) != u32::from_le_bytes(*crc) {
            return Err(|e| &mut e.crc);
        }
        match body.split_first() {
            Some((&VERSION, message)) => match postcard::take_from_bytes(message) {
                Ok((message, [])) => Ok(message),
                _ => Err(|e| &mut e.message),
            },
            _ => Err(|e| &mut e.version),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::link::Request;
    use crate::link::testing::{SETUP, dropped, feed, frame, raw_frame};
    use crate::table::Slot;
    use proptest::prelude::*;

    #[test]
    fn each_kind_of_bad_frame_has_its_counter() {
        let mut receiver = Receiver::new();
        let mut expect = FrameErrors::default();
        let mut check = |bytes: &[u8], count: fn(&mut FrameErrors) -> &mut u32| {
            *count(&mut expect) += 1;
            assert!(feed(&mut receiver, bytes).is_empty());
            assert_eq!(receiver.errors(), expect);
            let arm = Request::Check {
                slot: None,
                program: None,
            };
            assert_eq!(feed(&mut receiver, &frame(&arm)), [arm]);
        };
        let mut long = std::vec![1; FRAME_MAX + 1];
        long.push(0);
        check(&long, |e| &mut e.oversized);
        check(&[9, 1, 0], |e| &mut e.stuffing);
        check(&[3, 1, 2, 0], |e| &mut e.crc);
        check(&raw_frame(&[VERSION + 1, 0]), |e| &mut e.version);
        check(&raw_frame(&[VERSION - 1, 0]), |e| &mut e.version);
        check(&raw_frame(&[VERSION, 99]), |e| &mut e.message);
        check(&raw_frame(&[VERSION, 0, 0]), |e| &mut e.message); // a byte too many
        check(&raw_frame(&[VERSION, 7, 1]), |e| &mut e.message); // too few
        check(&raw_frame(&[]), |e| &mut e.version);
    }

    #[test]
    fn empty_frames_are_not_errors() {
        let mut receiver = Receiver::new();
        assert!(feed(&mut receiver, &[0; 10]).is_empty());
        assert_eq!(receiver.errors(), FrameErrors::default());
    }

    proptest! {
        #[test]
        fn after_any_bytes_the_next_good_frame_is_understood(
            noise in prop::collection::vec(any::<u8>(), 0..2000),
        ) {
            let mut receiver = Receiver::new();
            let zeros = noise.iter().filter(|b| **b == 0).count() as u32;
            let from_noise = feed(&mut receiver, &noise).len() as u32;
            prop_assert!(dropped(receiver.errors()) + from_noise <= zeros);
            receiver.push::<Request>(0);
            prop_assert_eq!(feed(&mut receiver, &frame(&Request::Status)), [Request::Status]);
        }

        #[test]
        fn a_truncated_frame_is_counted_and_harms_only_itself(keep in 1..100_usize) {
            let whole = frame(&Request::StartLockStep { slot: Slot::A, setup: SETUP });
            let mut receiver = Receiver::new();
            prop_assert!(feed(&mut receiver, &whole[..keep.min(whole.len() - 2)]).is_empty());
            prop_assert!(feed(&mut receiver, &[0]).is_empty());
            prop_assert_eq!(dropped(receiver.errors()), 1);
            prop_assert_eq!(feed(&mut receiver, &frame(&Request::Disable)), [Request::Disable]);
        }

        #[test]
        fn a_changed_byte_never_passes(at: prop::sample::Index, change in 1..=255_u8) {
            let mut bytes = frame(&Request::StartLockStep { slot: Slot::A, setup: SETUP });
            let end = bytes.len() - 1;
            bytes[at.index(end)] ^= change;
            prop_assert!(feed(&mut Receiver::new(), &bytes).is_empty());
        }

        #[test]
        fn any_body_with_a_good_crc_is_survived(body in prop::collection::vec(any::<u8>(), 0..200)) {
            let mut receiver = Receiver::new();
            let got = feed(&mut receiver, &raw_frame(&body)).len() as u32;
            prop_assert_eq!(got + dropped(receiver.errors()), 1);
        }

        #[test]
        fn a_flood_of_good_frames_is_answered_one_by_one(count in 1..300_usize) {
            let mut receiver = Receiver::new();
            let bytes = frame(&Request::Status).repeat(count);
            prop_assert_eq!(feed(&mut receiver, &bytes).len(), count);
            prop_assert_eq!(receiver.errors(), FrameErrors::default());
        }
    }
}
