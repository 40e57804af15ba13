//! A virtual board for other processes: on a pseudo-terminal, or on TCP.
//!
//! Its time is the wall clock's, or so many times faster. A board that cannot keep up with that falls
//! behind and does not catch up: its ticks are late, and none is lost.

use super::virtual_line::VirtualLine;
use crate::simulation::bench::{BenchError, VirtualBoard, VirtualPlaces, VirtualSetting};
use flexor::link::BAUD;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Why a virtual board could not be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The arm cannot be simulated.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// There is no pseudo-terminal or no such address.
    #[error("cannot listen on {place}: {source}")]
    Listen {
        /// Where.
        place: String,
        /// Why not.
        source: io::Error,
    },
}

/// Where a virtual board listens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listen {
    /// On a pseudo-terminal of its own.
    Terminal,
    /// On this address; port 0 is any that is free.
    Tcp(SocketAddr),
}

/// Between two looks at the line, where nothing is to be done.
const REST: Duration = Duration::from_millis(1);

/// Longest time that is spent on ticks without a look at the line.
const AWAY: Duration = Duration::from_millis(2);

/// How far ticks may be behind; what is more is forgotten.
const BEHIND: Duration = Duration::from_millis(20);

/// Bytes that a client may leave unread before it is cut off.
const UNREAD_MAX: usize = 1 << 18;

/// Bytes of a port, in both directions, that gives none or takes none at once where it cannot.
trait Stream: Read + Write {}
impl<T: Read + Write> Stream for T {}

/// Somebody on the line.
struct Client {
    stream: Box<dyn Stream>,
    line: VirtualLine,
    gone: bool,
    /// It has asked for telemetry, and nobody after it.
    streams: bool,
}

/// Where clients come from.
enum Door {
    /// There is one, for good. The other end is kept open so that it does not hang up between two
    /// commands.
    #[cfg(unix)]
    Terminal {
        _other_end: serialport::TTYPort,
    },
    Tcp(TcpListener),
}

/// Serves a board until `stop`. `announce` is told where, once somebody may come: a device's path, or
/// `tcp://` and the address. `speed` times as fast as the wall clock.
///
/// Several clients may be connected by TCP; each gets the answers to its own requests.
///
/// # Errors
/// [`ServeError`].
pub fn serve(
    setting: &VirtualSetting<'_>,
    (listen, speed): (Listen, f64),
    stop: &AtomicBool,
    announce: impl FnOnce(&str),
) -> Result<(), ServeError> {
    let rate_hz = f64::from(setting.tick_rate_hz());
    // Ten bits a byte.
    let bytes_per_tick = f64::from(BAUD) / 10.0 / rate_hz;
    let mut clients = Vec::new();
    let door = open(listen, bytes_per_tick, &mut clients, announce)?;
    let mut places: VirtualPlaces<'_> = [None, None];
    let mut board = VirtualBoard::new(setting, &mut places)?;
    let period = Duration::from_secs_f64(1.0 / (rate_hz * speed));
    let mut due = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let looked = Instant::now();
        door.admit(bytes_per_tick, &mut clients);
        for i in 0..clients.len() {
            if clients[i].listen(&mut board)? {
                let streams = |(at, client): (usize, &mut Client)| client.streams = at == i;
                clients.iter_mut().enumerate().for_each(streams);
            }
        }
        due = due.max(looked.checked_sub(BEHIND).unwrap_or(looked));
        while due <= looked && looked.elapsed() < AWAY {
            board.tick();
            for client in &mut clients {
                client.line.tick();
                if client.streams {
                    client.line.take_telemetry(&mut board);
                }
            }
            due += period;
        }
        for client in &mut clients {
            client.speak();
        }
        clients.retain(|client| !client.gone);
        if due > looked {
            std::thread::sleep(
                REST.min(due.saturating_duration_since(Instant::now()))
                    .max(REST / 4),
            );
        }
    }
    Ok(())
}

/// Opens what clients come by.
fn open(
    listen: Listen,
    bytes_per_tick: f64,
    clients: &mut Vec<Client>,
    announce: impl FnOnce(&str),
) -> Result<Door, ServeError> {
    let failed = |place: &str| {
        let place = place.to_owned();
        move |source| ServeError::Listen { place, source }
    };
    match listen {
        #[cfg(unix)]
        Listen::Terminal => {
            use serialport::SerialPort;
            let place = "a pseudo-terminal";
            let pair = serialport::TTYPort::pair().map_err(io::Error::from);
            let (mut own, other) = pair.map_err(failed(place))?;
            own.set_timeout(Duration::ZERO)
                .map_err(io::Error::from)
                .map_err(failed(place))?;
            announce(&other.name().unwrap_or_default());
            clients.push(Client::new(own, bytes_per_tick));
            Ok(Door::Terminal { _other_end: other })
        }
        #[cfg(not(unix))]
        Listen::Terminal => {
            let _ = (bytes_per_tick, clients);
            let none = io::Error::other("this system has none; --listen 127.0.0.1:0 is accepted");
            Err(failed("a pseudo-terminal")(none))
        }
        Listen::Tcp(address) => {
            let place = address.to_string();
            let listener = TcpListener::bind(address).map_err(failed(&place))?;
            listener.set_nonblocking(true).map_err(failed(&place))?;
            let address = listener.local_addr().map_err(failed(&place))?;
            announce(&format!("tcp://{address}"));
            Ok(Door::Tcp(listener))
        }
    }
}

impl Door {
    /// Lets in whoever waits.
    fn admit(&self, bytes_per_tick: f64, clients: &mut Vec<Client>) {
        match self {
            #[cfg(unix)]
            Self::Terminal { .. } => {}
            Self::Tcp(listener) => {
                while let Ok((stream, _)) = listener.accept() {
                    let set = stream
                        .set_nonblocking(true)
                        .and_then(|()| stream.set_nodelay(true));
                    if set.is_ok() {
                        clients.push(Client::new(stream, bytes_per_tick));
                    }
                }
            }
        }
    }
}

/// Whether an error says no more than that there is nothing now.
fn nothing_now(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

impl Client {
    fn new(stream: impl Stream + 'static, bytes_per_tick: f64) -> Self {
        Self {
            stream: Box::new(stream),
            line: VirtualLine::new(bytes_per_tick),
            gone: false,
            streams: false,
        }
    }

    /// Hands what has come to the board; true where it asked for telemetry.
    fn listen(&mut self, board: &mut VirtualBoard<'_>) -> Result<bool, BenchError> {
        let mut bytes = [0; 512];
        match self.stream.read(&mut bytes) {
            Ok(0) => self.gone = true,
            Ok(count) => return self.line.receive(&bytes[..count], board),
            Err(error) => self.gone = !nothing_now(&error),
        }
        Ok(false)
    }

    /// Sends what has passed the line.
    fn speak(&mut self) {
        while !self.line.sent.is_empty() {
            let (bytes, _) = self.line.sent.as_slices();
            match self.stream.write(bytes) {
                Ok(count) if count > 0 => drop(self.line.sent.drain(..count)),
                Err(error) if nothing_now(&error) => {
                    // Nobody reads: as on a cable that nobody is on.
                    if self.line.sent.len() > UNREAD_MAX {
                        self.line.sent.clear();
                    }
                    return;
                }
                _ => {
                    self.gone = true;
                    return;
                }
            }
        }
    }
}
