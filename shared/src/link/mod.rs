//! The wire between host and microcontroller.
//!
//! | file | responsible for |
//! |---|---|
//! | `message` | the messages, byte by byte |
//! | `setup` | what a controller is made from, as the wire and the image carry it |
//! | `report` | what the microcontroller tells about itself |
//! | `program` | which table and settings it is asked to run |
//! | `telemetry` | what it streams while it runs |
//! | `refusal` | why it does not do what it was asked |
//! | `frame` | the messages' frames on a byte stream: COBS and CRC |
//!
//! A host that only talks needs this wing and nothing above it: the wire knows neither the
//! control law nor the supervisor. What it sends is defined here, but for plain data of the
//! wings below, which are on the wire **on purpose**, bytes fixed by this wing's tests:
//! [`Measurement`](crate::signals::Measurement) and
//! [`Saturation`](crate::signals::Saturation), [`Fault`](crate::fault::Fault),
//! [`ArmParameters`](crate::model::ArmParameters), and the table's
//! [`Slot`](crate::table::Slot), [`SlotError`](crate::table::SlotError) and
//! [`TableIdentity`](crate::table::TableIdentity). The supervisor, above, speaks of counts,
//! interlocks, modes and refusals in this wing's words.

mod frame;
mod message;
mod program;
mod refusal;
mod report;
mod setup;
mod telemetry;
#[cfg(test)]
mod testing;

pub use frame::{FRAME_MAX, FrameErrors, FrameTooLong, PAYLOAD_MAX, Receiver, VERSION, encode};
pub use message::{LOG_MAX, LogEntry, OBSTACLES_MAX, Obstacles, Reply, Request};
pub use program::Program;
pub use refusal::Refusal;
pub use report::{
    ClockSource, Identity, Interlocks, Mode, RawSample, RunStatus, SensorReport, StartReason,
    Status, TickReply,
};
pub use setup::{
    FreeSetup, HybridSetup, LawSetup, LimitSetup, MonitorSetup, MotionSetup, PaperSetup, Setup,
};

pub use telemetry::{TELEMETRY_QUEUE, TelemetrySample};

/// Baud rate of the line on a real board. It divides the 84 MHz and 16 MHz that clock the
/// STM32F405's USART1 without remainder, and USB bridges have it.
pub const BAUD: u32 = 1_000_000;
