//! The line to a microcontroller: bytes in both directions.

use super::error::TargetError;
use flexor::link::BAUD;
use std::io::{Read, Write};
use std::time::Duration;

/// The line to the microcontroller.
pub(super) trait SerialLine: Read + Write {}
impl<T: Read + Write> SerialLine for T {}

/// Opens a real board's serial port.
///
/// # Errors
/// [`TargetError::Port`].
pub(super) fn open_port(
    port: &str,
    timeout: Duration,
) -> Result<impl SerialLine + 'static, TargetError> {
    serialport::new(port, BAUD)
        .timeout(timeout)
        .open()
        .map_err(|source| TargetError::Port {
            port: port.to_owned(),
            source,
        })
}
