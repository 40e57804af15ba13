//! Processor in the loop: the firmware's image in QEMU, or a real board on a serial port,
//! ticks against the simulated plant, and each of its commands is compared bit by bit
//! with the in-process controller's.
//!
//! The firmware's own lock-step mode does this (see [`shared::link`]); there is no special
//! build. Under QEMU the firmware's stopwatch counts instructions: `-icount shift=0` lets
//! an instruction take 1 ns of the emulated time, and QEMU's timers count nanoseconds.

use crate::closed_loop::{Run, RunError, RunOptions, run_through};
use crate::plan::Plan;
use defmt_decoder::{Locations, Table as LogTable};
use shared::control::TickReply;
use shared::controller::{Command, Controller};
use shared::guard::Limiting;
use shared::law::Measurement;
use shared::link::{
    FRAME_MAX, Identity, LogEntry, Receiver, Reply, Request, Setup, Status, encode,
};
use shared::safety::Refusal;
use shared::slot::{Slot, TableIdentity};
use shared::table::{Table, TableError};
use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{self, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// QEMU's board with the firmware's microcontroller.
const MACHINE: &str = "olimex-stm32-h405";

/// Address of table slot B, as in `memory.x`.
const SLOT_B_ADDRESS: u32 = 0x0804_0000;

/// Bytes of a table slot, as in `memory.x`.
const SLOT_BYTES: usize = 128 * 1024;

/// Where `cargo xtask firmware` leaves the image, seen from the project's top folder.
pub const DEFAULT_ELF: &str = "target/firmware/thumbv7em-none-eabihf/release/firmware";

/// Baud rate of a real board's link.
pub const BAUD: u32 = 1_000_000;

/// Longest wait for a reply. QEMU answers within milliseconds and starts within a second;
/// the rest is for machines with much else to do.
const PATIENCE: Duration = Duration::from_secs(60);

/// Why a processor in the loop could not be run.
#[derive(Debug, thiserror::Error)]
pub enum PilError {
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
    /// The plan's rate is not the image's.
    #[error(
        "the plan has {plan_hz} ticks a second, the firmware's timer {firmware_hz}: plan with --tick-rate-hz {firmware_hz}"
    )]
    TickRate {
        /// The plan's, Hz.
        plan_hz: u32,
        /// The firmware's, Hz.
        firmware_hz: u32,
    },
    /// A slot is too small.
    #[error("the table has {bytes} bytes, a slot takes {SLOT_BYTES}: a shorter task is accepted")]
    TableTooLong {
        /// Its length.
        bytes: usize,
    },
    /// The task's table is in neither slot.
    #[error(
        "the microcontroller does not have this task's table (checksum {wanted:#010x}): slot A {a}, slot B {b}; `cargo xtask flash --table table.bin` writes the table in the output folder into slot B"
    )]
    OtherTable {
        /// Checksum of the task's.
        wanted: u32,
        /// What slot A has.
        a: String,
        /// What slot B has.
        b: String,
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
    /// The run could not start.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// The line to the microcontroller.
trait Line: Read + Write {}
impl<T: Read + Write> Line for T {}

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
    /// [`PilError::NoImage`], [`PilError::NoLogTable`].
    pub fn new(elf: &Path, sink: impl FnMut(&str) + 'static) -> Result<Self, PilError> {
        let path = || elf.to_path_buf();
        let bytes = std::fs::read(elf).map_err(|source| PilError::NoImage {
            path: path(),
            source,
        })?;
        let message = |message: String| PilError::NoLogTable {
            path: path(),
            message,
        };
        let table = LogTable::parse(&bytes)
            .map_err(|error| message(error.to_string()))?
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

    fn tell(&mut self, entry: &LogEntry) {
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
    line: Box<dyn Line>,
    receiver: Receiver,
    /// Replies that have been read with those before them.
    waiting: VecDeque<Reply>,
    logs: Option<Logs>,
}

impl Link {
    fn new(line: impl Line + 'static, logs: Option<Logs>) -> Self {
        Self {
            line: Box::new(line),
            receiver: Receiver::new(),
            waiting: VecDeque::new(),
            logs,
        }
    }

    fn ask(&mut self, request: &Request, awaited: &'static str) -> Result<Reply, PilError> {
        self.send(request, awaited)?;
        self.reply(awaited)
    }

    fn send(&mut self, request: &Request, awaited: &'static str) -> Result<(), PilError> {
        let mut buffer = [0; FRAME_MAX];
        let frame = encode(request, &mut buffer).map_err(|error| PilError::Line {
            awaited,
            source: io::Error::other(error),
        })?;
        self.write(frame, awaited)
    }

    fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), PilError> {
        self.line
            .write_all(bytes)
            .map_err(|source| PilError::Line { awaited, source })
    }

    /// The next reply; what is logged before it goes to the log.
    fn reply(&mut self, awaited: &'static str) -> Result<Reply, PilError> {
        let mut bytes = [0; FRAME_MAX];
        loop {
            if let Some(reply) = self.waiting.pop_front() {
                return Ok(reply);
            }
            let count = match self.line.read(&mut bytes) {
                Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
                other => other,
            }
            .map_err(|source| PilError::Line { awaited, source })?;
            for byte in &bytes[..count] {
                match self.receiver.push(*byte) {
                    Some(Reply::Log(entry)) => {
                        if let Some(logs) = &mut self.logs {
                            logs.tell(&entry);
                        }
                    }
                    reply => self.waiting.extend(reply),
                }
            }
        }
    }

    fn identity(reply: &Reply) -> Result<Identity, PilError> {
        match reply {
            Reply::Identity(identity) => Ok(*identity),
            other => Err(unexpected("identity", other)),
        }
    }
}

/// A microcontroller that answers requests.
pub struct Processor {
    link: Link,
    identity: Identity,
    /// True when its stopwatch counts instructions.
    counts_instructions: bool,
    _emulator: Option<Emulator>,
}

impl Processor {
    /// Starts QEMU with the firmware's image.
    ///
    /// # Errors
    /// [`PilError`].
    pub fn emulated(emulation: &Emulation, logs: Option<Logs>) -> Result<Self, PilError> {
        let Emulation {
            elf,
            table_b,
            accesses,
        } = *emulation;
        // QEMU's own message for a missing image does not say how to get one.
        std::fs::metadata(elf).map_err(|source| PilError::NoImage {
            path: elf.to_path_buf(),
            source,
        })?;
        let folder = scratch_folder()?;
        let write = |path: PathBuf, source| PilError::Write { path, source };
        let socket = folder.join("link");
        let listener =
            UnixListener::bind(&socket).map_err(|source| write(socket.clone(), source))?;
        let mut arguments: Vec<OsString> = ["-M", MACHINE, "-nographic", "-monitor", "none"]
            .map(Into::into)
            .to_vec();
        arguments.extend(["-icount", "shift=0", "-kernel"].map(Into::into));
        arguments.push(elf.into());
        arguments.push("-serial".into());
        arguments.push(joined("unix:", &socket));
        if let Some(file) = accesses {
            arguments.extend(["-d", "unimp", "-D"].map(Into::into));
            arguments.push(file.into());
        }
        if let Some(table) = table_b {
            if table.len() > SLOT_BYTES {
                return Err(PilError::TableTooLong { bytes: table.len() });
            }
            let file = folder.join("table_b.bin");
            std::fs::write(&file, table).map_err(|source| write(file.clone(), source))?;
            let mut device = joined("loader,file=", &file);
            device.push(format!(",addr={SLOT_B_ADDRESS:#x},force-raw=on"));
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
            .map_err(|source| PilError::Start {
                program: program.to_owned(),
                source,
            })?;
        let mut emulator = Emulator { child, folder };
        let line = accept(&listener, &mut emulator.child).map_err(|source| PilError::Line {
            awaited: "connection",
            source,
        })?;
        let mut link = Link::new(line, logs);
        // Bytes before the firmware's first are lost: it introduces itself.
        let identity = Link::identity(&link.reply("identity")?)?;
        Ok(Self {
            link,
            identity,
            counts_instructions: true,
            _emulator: Some(emulator),
        })
    }

    /// Opens a real board's serial port and asks who is there.
    ///
    /// # Errors
    /// [`PilError`].
    pub fn on_port(port: &str, logs: Option<Logs>) -> Result<Self, PilError> {
        let line = serialport::new(port, BAUD)
            .timeout(PATIENCE)
            .open()
            .map_err(|source| PilError::Port {
                port: port.to_owned(),
                source,
            })?;
        let mut link = Link::new(line, logs);
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
    /// [`PilError`].
    pub fn status(&mut self) -> Result<Status, PilError> {
        match self.ask(&Request::Status, "status")? {
            Reply::Status(status) => Ok(status),
            other => Err(unexpected("status", &other)),
        }
    }

    /// Begins lock-step with the table in a slot, and says which that is.
    ///
    /// # Errors
    /// [`PilError::Refused`] if the microcontroller cannot; else other [`PilError`]s.
    pub fn start(&mut self, slot: Slot, setup: &Setup) -> Result<TableIdentity, PilError> {
        let setup = *setup;
        match self.ask(&Request::StartLockStep { slot, setup }, "consent")? {
            Reply::LockStep(table) => Ok(table),
            Reply::Refused(refusal) => Err(PilError::Refused(refusal)),
            other => Err(unexpected("consent", &other)),
        }
    }

    /// Begins lock-step with the table `image` in the slot that has it.
    ///
    /// # Errors
    /// [`PilError::OtherTable`] if none has; else other [`PilError`]s.
    pub fn start_with(&mut self, image: &[u8], setup: &Setup) -> Result<Slot, PilError> {
        let table = Table::open(image).map_err(RunError::from)?;
        let (plan_hz, firmware_hz) = (table.header().tick_rate_hz, self.identity.tick_rate_hz);
        if plan_hz != firmware_hz {
            return Err(PilError::TickRate {
                plan_hz,
                firmware_hz,
            });
        }
        let wanted = TableIdentity::from(&table);
        let mut found = [String::new(), String::new()];
        for (slot, found) in Slot::ALL.into_iter().zip(&mut found) {
            *found = match self.start(slot, setup) {
                Ok(table) if table == wanted => return Ok(slot),
                Ok(other) => format!("holds {:#010x}", other.crc),
                Err(PilError::Refused(Refusal::Table(error))) => error.to_string(),
                Err(error) => return Err(error),
            };
        }
        let [a, b] = found;
        let wanted = wanted.crc;
        Err(PilError::OtherTable { wanted, a, b })
    }

    /// One tick.
    ///
    /// # Errors
    /// [`PilError`].
    pub fn tick(
        &mut self,
        sequence: u32,
        measured: &Measurement<f32>,
    ) -> Result<TickReply, PilError> {
        let measured = *measured;
        match self.ask(&Request::Measured { sequence, measured }, "command")? {
            Reply::Command(reply) if reply.sequence == sequence => Ok(reply),
            Reply::Refused(refusal) => Err(PilError::Refused(refusal)),
            other => Err(unexpected("command", &other)),
        }
    }

    /// Sends a request and returns the reply.
    ///
    /// # Errors
    /// [`PilError::Line`].
    pub fn ask(&mut self, request: &Request, awaited: &'static str) -> Result<Reply, PilError> {
        self.link.ask(request, awaited)
    }

    /// Sends bytes as they are: for tests of the other end.
    ///
    /// # Errors
    /// [`PilError::Line`].
    pub fn write(&mut self, bytes: &[u8], awaited: &'static str) -> Result<(), PilError> {
        self.link.write(bytes, awaited)
    }

    /// The next reply, to a request that was written as bytes.
    ///
    /// # Errors
    /// [`PilError::Line`].
    pub fn reply(&mut self, awaited: &'static str) -> Result<Reply, PilError> {
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

fn unexpected(awaited: &'static str, found: &Reply) -> PilError {
    PilError::Unexpected {
        awaited,
        found: format!("{found:?}"),
    }
}

/// `prefix` and a path.
fn joined(prefix: &str, path: &Path) -> OsString {
    let mut text = OsString::from(prefix);
    text.push(path);
    text
}

/// A new folder of this process's own.
fn scratch_folder() -> Result<PathBuf, PilError> {
    use std::sync::atomic::{AtomicU32, Ordering};
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let path = std::env::temp_dir().join(format!("flexor-pil-{}-{number}", std::process::id()));
    match std::fs::create_dir(&path) {
        Ok(()) => Ok(path),
        Err(source) => Err(PilError::Write { path, source }),
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
                stream.set_read_timeout(Some(PATIENCE))?;
                return Ok(stream);
            }
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => return Err(error),
            Err(_) => {}
        }
        if let Some(status) = child.try_wait()? {
            return Err(io::Error::other(format!("QEMU ended with {status}")));
        }
        if begun.elapsed() > PATIENCE {
            return Err(io::ErrorKind::TimedOut.into());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// What a run with a processor in the loop found.
#[derive(Clone, Debug)]
pub struct PilRun {
    /// The closed loop, with the processor's torques on the plant.
    pub run: Run,
    /// Slot that the table was in.
    pub slot: Slot,
    /// Ticks compared.
    pub ticks: usize,
    /// Ticks whose commands differ in at least one bit.
    pub differing_commands: usize,
    /// The first of them.
    pub first_difference: Option<usize>,
    /// Stopwatch counts of each tick.
    pub counts: Vec<u32>,
    /// Status at the end.
    pub status: Status,
    /// Time that the run took, s.
    pub wall_s: f64,
}

impl PilRun {
    /// Least, median and most counts of a tick.
    pub fn counts_spread(&self) -> [u32; 3] {
        let mut sorted = self.counts.clone();
        sorted.sort_unstable();
        let at = |i: usize| sorted.get(i).copied().unwrap_or(0);
        [
            at(0),
            at(sorted.len() / 2),
            at(sorted.len().saturating_sub(1)),
        ]
    }
}

/// True when the processor's command equals the in-process one in every bit.
fn same(reply: &TickReply, command: &Command<f32>) -> bool {
    reply.torque.map(f32::to_bits) == command.torque.map(f32::to_bits)
        && reply.tick == command.tick
        && reply.limiting == command.limiting
        && reply.fault == command.fault
}

/// Runs `plan` in closed loop: the plant gets the processor's torques, and the in-process
/// controller the same measurements. One of the processor's slots must hold `image`, the
/// plan's table. `progress` is told each tick.
///
/// # Errors
/// [`PilError`].
pub fn run(
    processor: &mut Processor,
    plan: &Plan,
    image: &[u8],
    options: &RunOptions,
    mut progress: impl FnMut(usize),
) -> Result<PilRun, PilError> {
    let setup = Setup {
        arm: plan.model.arm,
        law: options.law,
        limits: options.limits,
    };
    let slot = processor.start_with(image, &setup)?;
    let begun = Instant::now();
    let mut counts = Vec::with_capacity(plan.points.len());
    let mut differing_commands = 0;
    let mut first_difference = None;
    let mut failure = None;
    let run = run_through::<f32>(plan, image, options, |measured, command| {
        let tick = counts.len();
        match processor.tick(tick as u32, measured) {
            Ok(reply) => {
                if !same(&reply, &command) {
                    differing_commands += 1;
                    first_difference.get_or_insert(tick);
                }
                counts.push(reply.counts);
                progress(tick);
                Some(Command {
                    torque: reply.torque,
                    limiting: reply.limiting,
                    fault: reply.fault,
                    ..command
                })
            }
            Err(error) => {
                failure = Some(error);
                None
            }
        }
    })?;
    if let Some(error) = failure {
        return Err(error);
    }
    Ok(PilRun {
        ticks: counts.len(),
        run,
        slot,
        differing_commands,
        first_difference,
        counts,
        wall_s: begun.elapsed().as_secs_f64(),
        status: processor.status()?,
    })
}

/// Compares processor and in-process controller on `count` measurements of arbitrary bits:
/// normal ranges, limits, denormals, infinities and NaN. Both begin again after a fault.
/// Returns how many commands differ. `progress` is told each.
///
/// # Errors
/// [`PilError`].
pub fn compare_any(
    processor: &mut Processor,
    image: &[u8],
    setup: &Setup,
    count: u32,
    seed: u64,
    mut progress: impl FnMut(u32),
) -> Result<u32, PilError> {
    let table = Table::open(image).map_err(RunError::from)?;
    let new = || -> Result<_, TableError> {
        Controller::<f32>::new(&table, &setup.arm, &setup.law, &setup.limits)
    };
    let mut controller = new().map_err(RunError::from)?;
    let slot = processor.start_with(image, setup)?;
    let mut random = SplitMix(seed);
    let mut differing = 0;
    for sequence in 0..count {
        let measured = any_measurement(&mut random);
        let reply = processor.tick(sequence, &measured)?;
        let command = controller.tick(&measured);
        differing += u32::from(!same(&reply, &command));
        if command.fault.is_some() || reply.fault.is_some() {
            controller.restart();
            processor.start(slot, setup)?;
        }
        progress(sequence);
    }
    Ok(differing)
}

/// Steele, Lea and Flood's SplitMix64: the same numbers everywhere.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Mostly a plausible value in +-4; one in 64 a special one, one in 64 any bits at all.
fn any_value(random: &mut SplitMix) -> f32 {
    const SPECIAL: [u32; 12] = [
        0,
        0x8000_0000, // -0
        1,           // least denormal
        0x007f_ffff, // largest denormal
        0x0080_0000, // least normal
        0x7f7f_ffff, // largest
        0xff7f_ffff,
        0x7f80_0000, // infinities
        0xff80_0000,
        0x7fc0_0000, // NaN, quiet and signalling
        0x7f80_0001,
        0xffff_ffff,
    ];
    let bits = random.next();
    let low = bits as u32;
    match bits >> 58 {
        0 => f32::from_bits(SPECIAL[(low % 12) as usize]),
        1 => f32::from_bits(low),
        _ => (f64::from(low) / f64::from(u32::MAX) * 8.0 - 4.0) as f32,
    }
}

fn any_measurement(random: &mut SplitMix) -> Measurement<f32> {
    let drive = [(); 2].map(|()| match random.next() % 8 {
        0 => Limiting::FromAbove,
        1 => Limiting::FromBelow,
        _ => Limiting::No,
    });
    Measurement {
        angle: [any_value(random), any_value(random)],
        root_slope: any_value(random),
        root_slope_rate: any_value(random),
        force: any_value(random),
        drive,
    }
}
