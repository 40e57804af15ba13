//! The line to a microcontroller: bytes in both directions.

use super::error::TargetError;
use flexor::link::BAUD;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// The line to the microcontroller.
pub(super) trait SerialLine: Read + Write {
    /// Lets time pass.
    ///
    /// # Errors
    /// The line's, where the time is its own.
    fn pass(&mut self, time: Duration) -> io::Result<()> {
        std::thread::sleep(time);
        Ok(())
    }
}

impl SerialLine for TcpStream {}
impl SerialLine for Box<dyn serialport::SerialPort> {}

/// The host and port of a port's name that means TCP: `tcp://HOST:PORT` or `tcp:HOST:PORT`.
fn tcp_address(port: &str) -> Option<&str> {
    let address = port.strip_prefix("tcp:")?;
    Some(address.strip_prefix("//").unwrap_or(address))
}

/// Opens a real board's serial port, or a connection to one that is served over TCP.
///
/// # Errors
/// [`TargetError::Port`], [`TargetError::Address`].
pub(super) fn open_port(port: &str, timeout: Duration) -> Result<Box<dyn SerialLine>, TargetError> {
    if let Some(address) = tcp_address(port) {
        let connected = connect(address, timeout);
        return match connected {
            Ok(stream) => Ok(Box::new(stream)),
            Err(source) => Err(TargetError::Address {
                port: port.to_owned(),
                source,
            }),
        };
    }
    let opened = serialport::new(port, BAUD).timeout(timeout).open();
    match opened {
        Ok(line) => Ok(Box::new(line)),
        Err(source) => Err(TargetError::Port {
            port: port.to_owned(),
            source,
        }),
    }
}

/// Connects to the first of an address's meanings that answers.
fn connect(address: &str, timeout: Duration) -> io::Result<TcpStream> {
    let mut failure = io::Error::other("no such host");
    for meant in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&meant, timeout) {
            Ok(stream) => {
                // Every request waits for its reply: none may wait for more to send.
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(timeout))?;
                return Ok(stream);
            }
            Err(error) => failure = error,
        }
    }
    Err(failure)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_told_from_a_device() {
        assert_eq!(tcp_address("tcp://localhost:1"), Some("localhost:1"));
        assert_eq!(tcp_address("tcp:[::1]:2"), Some("[::1]:2"));
        assert_eq!(tcp_address("/dev/ttyUSB0"), None);
        assert_eq!(tcp_address("COM3"), None);
    }
}
