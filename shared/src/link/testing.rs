//! What the link's tests share.

extern crate std;

use crate::CRC32;
use crate::link::{
    FRAME_MAX, FrameErrors, LawSetup, LimitSetup, MonitorSetup, PaperSetup, Receiver, Reply,
    Request, Setup, encode,
};
use crate::model::ArmParameters;
use crate::table::TableIdentity;
use serde::Serialize;
use std::vec::Vec;

/// A setup of the paper's law, with every filter.
pub(super) const SETUP: Setup = Setup {
    arm: ArmParameters::PAPER,
    law: LawSetup::Paper(PaperSetup {
        force_derivative_s: 0.0,
        force_proportional: 0.0,
        force_integral_per_s: 0.0,
        slope_rate_nms_rad: 0.0,
        force_filter_hz: Some(50.0),
        slope_rate_filter_hz: Some(20.0),
        force_projection_as_printed: false,
        slope_rate_feedback_as_printed: false,
        feedforward: true,
    }),
    limits: LimitSetup {
        torque_nm: [20.0, 2.0],
        torque_rate_nm_s: [1e3, 1e2],
    },
    monitors: MonitorSetup {
        path_rad: [0.03, 0.2],
        speed_rad_s: [2.0, 3.0],
        force_n: 1.0,
        root_moment_nm: 0.2,
        balance_nm: [0.5, 0.4],
    },
};

/// A table's identity.
pub(super) const TABLE: TableIdentity = TableIdentity {
    crc: 0x1234,
    arm_fingerprint: 1,
    task_fingerprint: 300,
    ticks: 10_000,
};

/// A message's frame.
pub(super) fn frame<M: Serialize>(message: &M) -> Vec<u8> {
    encode(message, &mut [0; FRAME_MAX]).unwrap().to_vec()
}

/// A frame around any payload, with a good CRC.
pub(super) fn raw_frame(body: &[u8]) -> Vec<u8> {
    let mut payload = body.to_vec();
    payload.extend(CRC32.checksum(body).to_le_bytes());
    let mut bytes = std::vec![0; cobs::max_encoding_length(payload.len())];
    let length = cobs::encode(&payload, &mut bytes);
    bytes.truncate(length);
    bytes.push(0);
    bytes
}

/// The requests in a stream of bytes.
pub(super) fn feed(receiver: &mut Receiver, bytes: &[u8]) -> Vec<Request> {
    bytes.iter().filter_map(|b| receiver.push(*b)).collect()
}

/// The replies in a stream of bytes.
pub(super) fn replies(bytes: &[u8]) -> Vec<Reply> {
    let mut receiver = Receiver::new();
    bytes.iter().filter_map(|b| receiver.push(*b)).collect()
}

/// Frames dropped, for whatever reason.
pub(super) fn dropped(errors: FrameErrors) -> u32 {
    errors.oversized + errors.stuffing + errors.version + errors.crc + errors.message
}
