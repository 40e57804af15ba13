//! The microcontroller as seen from the host: the firmware's image in QEMU, or a real board
//! on a serial port, that answers the requests of [`flexor::link`].
//!
//! Under QEMU the firmware's stopwatch counts instructions: `-icount shift=0` lets an
//! instruction take 1 ns of the emulated time, and QEMU's timers count nanoseconds.

use defmt_decoder::{Locations, Table as LogTable};
use flexor::link::Refusal;
use flexor::link::{
    BAUD, FRAME_MAX, FrameErrors, Identity, LogEntry, Receiver, Reply, Request, Setup, StartReason,
    Status, encode,
};
use flexor::link::{SensorReport, TickReply};
use flexor::signals::Measurement;
use flexor::table::{Slot, TableIdentity};
use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// QEMU's board with the firmware's microcontroller.
const MACHINE: &str = "olimex-stm32-h405";

/// Addresses of table slots A and B, as in `memory.x`.
pub const SLOT_ADDRESSES: [u32; 2] = [0x0802_0000, 0x0804_0000];

/// Bytes of a table slot, as in `memory.x`.
pub const SLOT_BYTES: usize = 128 * 1024;

/// Where `cargo xtask firmware` leaves the image, seen from the project's top folder.
pub const DEFAULT_ELF: &str = "target/firmware/thumbv7em-none-eabihf/release/firmware";

/// Longest wait for a reply from QEMU. It answers within milliseconds and starts within a
/// second; the rest is for machines with much else to do.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Why a microcontroller could not be talked to.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// There is no image.
    #[error("{}: no firmware image: {source}; `cargo xtask firmware` builds it in {DEFAULT_ELF}", path.display())]
    NoImage {
        /// Where it was looked for.
        path: PathBuf,
        /// Why it cannot be read.
        source: io::Error,
    },
    /// The image does not say how its log is to be read.
    #[error("{}: {message}", path.display())]
    NoLogTable {
        /// The image.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A slot is too small.
    #[error("the table has {bytes} bytes, a slot takes {SLOT_BYTES}: a shorter task is accepted")]
    TableTooLong {
        /// Its length.
        bytes: usize,
    },
    /// QEMU cannot be started.
    #[error("cannot start {program}: {source}; `cargo xtask setup` installs QEMU")]
    Start {
        /// What was to be started.
        program: String,
        /// Why not.
        source: io::Error,
    },
    /// The serial port cannot be opened.
    #[error("cannot open serial port {port}: {source}")]
    Port {
        /// Its name.
        port: String,
        /// Why not.
        source: serialport::Error,
    },
    /// A board does not answer.
    #[error(
        "{port}: no answer at {BAUD} baud within {:.1} s{}: is the board powered and flashed, and are transmit and receive the right way round?",
        timeout.as_secs_f64(), received_words(*received, *dropped)
    )]
    Silent {
        /// The serial port.
        port: String,
        /// How long was waited.
        timeout: Duration,
        /// Bytes that came all the same.
        received: u64,
        /// Frames that came and could not be read.
        dropped: FrameErrors,
    },
    /// The microcontroller has started again.
    #[error(
        "the microcontroller has started again while its {awaited} was awaited: {}",
        describe_start(start)
    )]
    Restarted {
        /// What was awaited.
        awaited: &'static str,
        /// Why it started.
        start: StartReason,
    },
    /// The line broke, or no answer came in time.
    #[error("the link to the microcontroller failed while waiting for its {awaited}: {source}")]
    Line {
        /// What was awaited.
        awaited: &'static str,
        /// Why.
        source: io::Error,
    },
    /// An answer, but not to the question.
    #[error("the microcontroller answered {found} where its {awaited} was expected")]
    Unexpected {
        /// What was awaited.
        awaited: &'static str,
        /// What came.
        found: String,
    },
    /// The microcontroller does not want to.
    #[error("the microcontroller refused: {0}")]
    Refused(Refusal),
    /// A file for QEMU cannot be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
}

/// What came instead of an answer, in words.
fn received_words(received: u64, dropped: FrameErrors) -> String {
    let FrameErrors {
        oversized,
        stuffing,
        version,
        crc,
        message,
    } = dropped;
    if version > 0 {
        return format!(
            " ({version} messages of another protocol version than {} came: the board's firmware is of another version)",
            flexor::link::VERSION
        );
    }
    let bad = u64::from(oversized) + u64::from(stuffing) + u64::from(crc) + u64::from(message);
    match received {
        0 => String::new(),
        _ => format!(" ({received} bytes came, {bad} unreadable messages among them)"),
    }
}

/// Why the microcontroller started, in words.
pub fn describe_start(start: &StartReason) -> String {
    match start {
        StartReason::Normal => "power, reset or a debugger".into(),
        StartReason::Panic { line, file } => {
            format!("a panic in line {line} of the file whose name has the CRC-32 {file:#010x}")
        }
        StartReason::HardFault { pc, status } => {
            format!("a HardFault at {pc:#010x}, fault status {status:#010x}")
        }
        StartReason::Watchdog => "the watchdog was not fed".into(),
        StartReason::StackOverflow { status } => {
            format!("the stack was full, fault status {status:#010x}")
        }
    }
}

/// The line to the microcontroller.
trait SerialLine: Read + Write {}
impl<T: Read + Write> SerialLine for T {}

/// QEMU with the firmware; ends with the value.
struct Emulator {
    child: Child,
    folder: PathBuf,
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // Both may have gone already; then there is nothing to do.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Reads the log: the symbols in the image, and who is told.
pub struct Logs {
    table: LogTable,
    locations: Option<Locations>,
    sink: Box<dyn FnMut(&str)>,
}

impl Logs {
    /// Reads the symbols in the image `elf`; `sink` is given every line.
    ///
    /// # Errors
    /// [`TargetError::NoImage`], [`TargetError::NoLogTable`].
    pub fn new(elf: &Path, sink: impl FnMut(&str) + 'static) -> Result<Self, TargetError> {
        let path = || elf.to_path_buf();
        // A device might never end.
        let read = || match std::fs::metadata(elf)?.is_file() {
            true => std::fs::read(elf),
            false => Err(io::Error::other("not a file")),
        };
        let bytes = read().map_err(|source| TargetError::NoImage {
            path: path(),
            source,
        })?;
        let message = |message: String| TargetError::NoLogTable {
            path: path(),
            message,
        };
        let table = LogTable::parse(&bytes)
            .map_err(|error| message(format!("not a firmware image: {error}")))?
            .ok_or_else(|| message("not an image with a log".into()))?;
        // Without debug information there are no places, and nothing else is missing.
        let locations = table
            .get_locations(&bytes)
            .ok()
            .filter(|locations| table.indices().all(|i| locations.contains_key(&(i as u64))));
        Ok(Self {
            table,
            locations,
            sink: Box::new(sink),
        })
    }

    fn write_log(&mut self, entry: &LogEntry) {
        let line = match self.table.decode(entry) {
            Ok((frame, _)) => {
                let level = frame.level().map_or("", |level| level.as_str());
                let place = self.locations.as_ref().and_then(|l| l.get(&frame.index()));
                let place = place.map_or(String::new(), |place| {
                    let file = place.file.file_name().unwrap_or_default().display();
                    format!(" ({file}:{})", place.line)
                });
                format!("{level} {}{place}", frame.display_message())
            }
            // The board runs another image than the one whose symbols these are.
            Err(_) => format!("not to be read with this image's symbols: {entry:02x?}"),
        };
        (self.sink)(&line);
    }
}

/// How to start the emulator.
#[derive(Clone, Copy, Debug)]
pub struct Emulation<'a> {
    /// The firmware's image.
    pub elf: &'a Path,
    /// A table for slot B.
    pub table_b: Option<&'a [u8]>,
    /// A file to which QEMU writes every access to a peripheral that it does not have: what
    /// the firmware does to drives and watchdog.
    pub accesses: Option<&'a Path>,
}

/// The line, its frames and the log on it.
struct Link {
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
    logs: Option<Logs>,
}

impl Link {
    fn new(
        line: impl SerialLine + 'static,
        port: Option<String>,
        timeout: Duration,
        logs: Option<Logs>,
    ) -> Self {
        Self {
            line: Box::new(line),
            port,
            timeout,
            receiver: Receiver::new(),
            received: 0,
            waiting: VecDeque::new(),
            logs,
        }
    }

    fn ask(&mut self, request: &Request, awaited: &'static str) -> Result<Reply, TargetError> {
        self.send(request, awaited)?;
        self.reply(awaited)
    }

    fn send(&mut self, request: &Request, awaited: &'static str) -> Result<(), TargetError> {
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(request, &mut buffer).map_err(|error| TargetError::Line {
            awaited,
            source: io::Error::other(error),
        })?;
        self.write(frame, awaited)
    }

    fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), TargetError> {
        self.line
            .write_all(bytes)
            .map_err(|source| self.failure(awaited, source))
    }

    /// The next reply; what is logged before it goes to the log.
    fn reply(&mut self, awaited: &'static str) -> Result<Reply, TargetError> {
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

    fn identity(reply: &Reply) -> Result<Identity, TargetError> {
        match reply {
            Reply::Identity(identity) => Ok(*identity),
            other => Err(unexpected("identity", other)),
        }
    }
}

/// A microcontroller that answers requests.
pub struct Target {
    link: Link,
    identity: Identity,
    /// True when its stopwatch counts instructions.
    counts_instructions: bool,
    _emulator: Option<Emulator>,
}

impl Target {
    /// Starts QEMU with the firmware's image.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn emulated(emulation: &Emulation, logs: Option<Logs>) -> Result<Self, TargetError> {
        let Emulation {
            elf,
            table_b,
            accesses,
        } = *emulation;
        // QEMU's own message for a missing image does not say how to get one.
        std::fs::metadata(elf).map_err(|source| TargetError::NoImage {
            path: elf.to_path_buf(),
            source,
        })?;
        let folder = scratch_folder()?;
        let write = |path: PathBuf, source| TargetError::Write { path, source };
        let socket = folder.join("link");
        let listener =
            UnixListener::bind(&socket).map_err(|source| write(socket.clone(), source))?;
        let mut arguments: Vec<OsString> = ["-M", MACHINE, "-nographic", "-monitor", "none"]
            .map(Into::into)
            .to_vec();
        arguments.extend(["-icount", "shift=0", "-kernel"].map(Into::into));
        arguments.push(elf.into());
        arguments.push("-serial".into());
        arguments.push(with_path("unix:", &socket));
        if let Some(file) = accesses {
            arguments.extend(["-d", "unimp", "-D"].map(Into::into));
            arguments.push(file.into());
        }
        if let Some(table) = table_b {
            if table.len() > SLOT_BYTES {
                return Err(TargetError::TableTooLong { bytes: table.len() });
            }
            let file = folder.join("table_b.bin");
            std::fs::write(&file, table).map_err(|source| write(file.clone(), source))?;
            let mut device = with_path("loader,file=", &file);
            device.push(format!(",addr={:#x},force-raw=on", SLOT_ADDRESSES[1]));
            arguments.push("-device".into());
            arguments.push(device);
            // The loader takes no more than the machine's RAM, of which this board states none.
            arguments.extend(["-m", "1M"].map(Into::into));
        }
        let program = "qemu-system-arm";
        let child = std::process::Command::new(program)
            .args(arguments)
            .stdin(Stdio::null())
            .spawn()
            .map_err(|source| TargetError::Start {
                program: program.to_owned(),
                source,
            })?;
        let mut emulator = Emulator { child, folder };
        let line = accept(&listener, &mut emulator.child).map_err(|source| TargetError::Line {
            awaited: "connection",
            source,
        })?;
        let mut link = Link::new(line, None, TIMEOUT, logs);
        // Bytes before the firmware's first are lost: it introduces itself.
        let identity = Link::identity(&link.reply("identity")?)?;
        Ok(Self {
            link,
            identity,
            counts_instructions: true,
            _emulator: Some(emulator),
        })
    }

    /// Opens a real board's serial port and asks who is there. From then on the board may
    /// take `timeout` to answer.
    ///
    /// # Errors
    /// [`TargetError::Silent`] if nobody answers; else other [`TargetError`]s.
    pub fn on_port(port: &str, timeout: Duration, logs: Option<Logs>) -> Result<Self, TargetError> {
        let line = serialport::new(port, BAUD)
            .timeout(timeout)
            .open()
            .map_err(|source| TargetError::Port {
                port: port.to_owned(),
                source,
            })?;
        let mut link = Link::new(line, Some(port.to_owned()), timeout, logs);
        link.write(&[0], "identity")?; // ends what a broken run left
        // A board that has just started introduces itself once more by itself. The status
        // comes after both, and after what a broken run may have left unread.
        let mut reply = link.ask(&Request::Hello, "identity")?;
        let mut identity = Link::identity(&reply);
        link.send(&Request::Status, "status")?;
        while !matches!(reply, Reply::Status(_)) {
            if let Reply::Identity(found) = reply {
                identity = Ok(found);
            }
            reply = link.reply("status")?;
        }
        let identity = identity?;
        Ok(Self {
            link,
            identity,
            counts_instructions: false,
            _emulator: None,
        })
    }

    /// Who the microcontroller is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// How the microcontroller is.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn status(&mut self) -> Result<Status, TargetError> {
        match self.ask(&Request::Status, "status")? {
            Reply::Status(status) => Ok(status),
            other => Err(unexpected("status", &other)),
        }
    }

    /// What its sensors and interlocks say.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn sensors(&mut self) -> Result<SensorReport, TargetError> {
        match self.ask(&Request::Sensors, "sensors")? {
            Reply::Sensors(report) => Ok(report),
            other => Err(unexpected("sensors", &other)),
        }
    }

    /// Enables the drives and runs a slot's table, or without a slot slot A's, or slot B's
    /// where A has none that is usable. Says which runs. From now on the microcontroller must
    /// be asked for something every 100 ms, or it stops by itself.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if it is not enabled; else other [`TargetError`]s, after
    /// which it may be enabled.
    pub fn enable(&mut self, slot: Option<Slot>) -> Result<(Slot, TableIdentity), TargetError> {
        match self.ask(&Request::Enable { slot }, "consent to enable")? {
            Reply::Enabled { slot, table } => Ok((slot, table)),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent to enable", &other)),
        }
    }

    /// Switches the drives off, and ends lock-step. Passes over answers to earlier requests,
    /// so that it may follow any error.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn disable(&mut self) -> Result<(), TargetError> {
        let awaited = "consent to disable";
        let mut reply = self.ask(&Request::Disable, awaited)?;
        // An earlier request's answer is one message, and perhaps an identity after it.
        for _ in 0..4 {
            if reply == Reply::Done {
                return Ok(());
            }
            reply = self.reply(awaited)?;
        }
        Err(unexpected(awaited, &reply))
    }

    /// Tells that the arm stands at its home pose.
    ///
    /// # Errors
    /// [`TargetError::Refused`] unless disabled; else other [`TargetError`]s.
    pub fn home(&mut self) -> Result<(), TargetError> {
        match self.ask(&Request::Home, "consent")? {
            Reply::Done => Ok(()),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Lets the microcontroller forget its latched fault.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn acknowledge(&mut self) -> Result<(), TargetError> {
        match self.ask(&Request::Acknowledge, "consent")? {
            Reply::Done => Ok(()),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Begins lock-step with the table in a slot, and says which that is.
    ///
    /// # Errors
    /// [`TargetError::Refused`] if the microcontroller cannot; else other [`TargetError`]s.
    pub fn start(&mut self, slot: Slot, setup: &Setup) -> Result<TableIdentity, TargetError> {
        let setup = *setup;
        match self.ask(&Request::StartLockStep { slot, setup }, "consent")? {
            Reply::LockStep(table) => Ok(table),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// One tick.
    ///
    /// # Errors
    /// [`TargetError`].
    pub fn tick(
        &mut self,
        sequence: u32,
        measured: &Measurement<f32>,
    ) -> Result<TickReply, TargetError> {
        let measured = *measured;
        match self.ask(&Request::Measured { sequence, measured }, "command")? {
            Reply::Command(reply) if reply.sequence == sequence => Ok(reply),
            Reply::Refused(refusal) => Err(TargetError::Refused(refusal)),
            other => Err(unexpected("command", &other)),
        }
    }

    /// Sends a request and returns the reply.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn ask(&mut self, request: &Request, awaited: &'static str) -> Result<Reply, TargetError> {
        self.link.ask(request, awaited)
    }

    /// Sends bytes as they are: for tests of the other end.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), TargetError> {
        self.link.write(bytes, awaited)
    }

    /// The next reply, to a request that was written as bytes.
    ///
    /// # Errors
    /// [`TargetError::Line`].
    pub fn reply(&mut self, awaited: &'static str) -> Result<Reply, TargetError> {
        self.link.reply(awaited)
    }

    /// Instructions for stopwatch counts; `None` on hardware, whose stopwatch counts time.
    pub fn instructions(&self, counts: u32) -> Option<u32> {
        let nops = u64::from(self.identity.counts_per_1000_nops);
        if !self.counts_instructions || nops == 0 {
            return None;
        }
        u32::try_from((u64::from(counts) * 1000 + nops / 2) / nops).ok()
    }

    /// Core cycles for stopwatch counts; `None` in the emulator, which does not know them.
    /// The stopwatch counts them, or a timer's clock where the core has no such counter.
    pub fn cycles(&self, counts: u32) -> Option<u32> {
        let Identity {
            core_hz,
            stopwatch_hz,
            ..
        } = self.identity;
        if self.counts_instructions {
            return None;
        }
        let cycles = u64::from(counts) * u64::from(core_hz) / u64::from(stopwatch_hz.max(1));
        u32::try_from(cycles).ok()
    }
}

fn unexpected(awaited: &'static str, found: &Reply) -> TargetError {
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

/// `prefix` and a path.
fn with_path(prefix: &str, path: &Path) -> OsString {
    let mut text = OsString::from(prefix);
    text.push(path);
    text
}

/// A new folder of this process's own.
fn scratch_folder() -> Result<PathBuf, TargetError> {
    use std::sync::atomic::{AtomicU32, Ordering};
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let path = std::env::temp_dir().join(format!("flexor-pil-{}-{number}", std::process::id()));
    match std::fs::create_dir(&path) {
        Ok(()) => Ok(path),
        Err(source) => Err(TargetError::Write { path, source }),
    }
}

/// QEMU's connection; an error if it ends or stays silent instead.
fn accept(listener: &UnixListener, child: &mut Child) -> io::Result<UnixStream> {
    listener.set_nonblocking(true)?;
    let begun = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false)?;
                stream.set_read_timeout(Some(TIMEOUT))?;
                return Ok(stream);
            }
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => return Err(error),
            Err(_) => {}
        }
        if let Some(status) = child.try_wait()? {
            return Err(io::Error::other(format!("QEMU ended with {status}")));
        }
        if begun.elapsed() > TIMEOUT {
            return Err(io::ErrorKind::TimedOut.into());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
