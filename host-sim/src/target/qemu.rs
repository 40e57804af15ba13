//! The firmware's image in the emulator QEMU, whose serial line is a TCP connection on this
//! machine.
//!
//! The firmware's stopwatch counts instructions there: `-icount shift=0` lets an instruction
//! take 1 ns of the emulated time, and QEMU's timers count nanoseconds.

use super::error::TargetError;
use super::layout::{SLOT_ADDRESSES, SLOT_BYTES};
use std::ffi::OsString;
use std::io::{self, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempPath;

/// The emulator.
const PROGRAM: &str = "qemu-system-arm";

/// QEMU's board with the firmware's microcontroller.
const MACHINE: &str = "olimex-stm32-h405";

/// Longest wait for a reply from QEMU. It answers within milliseconds and starts within a
/// second; the rest is for machines with much else to do.
pub(super) const TIMEOUT: Duration = Duration::from_secs(60);

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

/// QEMU with the firmware; ends with the value.
pub(super) struct Emulator {
    child: Child,
    /// Slot B's table, which QEMU reads while it starts.
    table_b: Option<TempPath>,
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // It may have gone already; then there is nothing to do.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Emulator {
    /// Starts QEMU; the emulator, and the firmware's serial line.
    ///
    /// # Errors
    /// [`TargetError`].
    pub(super) fn start(emulation: &Emulation) -> Result<(Self, TcpStream), TargetError> {
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
        let failed = |source| TargetError::Line {
            awaited: "connection",
            source,
        };
        // QEMU calls and this listens, on whichever port is free: nobody can take it in between.
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(failed)?;
        let port = listener.local_addr().map_err(failed)?.port();
        let mut command = Command::new(PROGRAM);
        command
            .args(["-M", MACHINE, "-nographic", "-monitor", "none"])
            .args(["-icount", "shift=0", "-kernel"])
            .arg(elf)
            .args(["-serial", &format!("tcp:127.0.0.1:{port},nodelay=on")]);
        if let Some(file) = accesses {
            command.args(["-d", "unimp", "-D"]).arg(file);
        }
        let table_b = table_b.map(table_file).transpose()?;
        if let Some(file) = &table_b {
            let mut device = OsString::from("loader,file=");
            device.push(file);
            device.push(format!(",addr={:#x},force-raw=on", SLOT_ADDRESSES[1]));
            command.arg("-device").arg(device);
            // The loader takes no more than the machine's RAM, of which this board states none.
            command.args(["-m", "1M"]);
        }
        let child = command
            .stdin(Stdio::null())
            .spawn()
            .map_err(|source| TargetError::Start {
                program: PROGRAM.to_owned(),
                source,
            })?;
        let mut emulator = Self { child, table_b };
        let line = accept(&listener, &mut emulator.child).map_err(failed)?;
        Ok((emulator, line))
    }

    /// To be called once the firmware runs: removes what QEMU needed to start.
    pub(super) fn started(&mut self) {
        self.table_b = None;
    }
}

/// A temporary file with a table, removed with the value.
fn table_file(table: &[u8]) -> Result<TempPath, TargetError> {
    if table.len() > SLOT_BYTES {
        return Err(TargetError::TableTooLong { bytes: table.len() });
    }
    let failed = |source| TargetError::Write {
        path: std::env::temp_dir(),
        source,
    };
    let mut file = tempfile::Builder::new()
        .prefix("flexor-table-")
        .suffix(".bin")
        .tempfile()
        .map_err(failed)?;
    file.write_all(table).map_err(failed)?;
    Ok(file.into_temp_path())
}

/// QEMU's connection; an error if it ends or stays silent instead.
fn accept(listener: &TcpListener, child: &mut Child) -> io::Result<TcpStream> {
    listener.set_nonblocking(true)?;
    let begun = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false)?;
                // Every request waits for its reply: none may wait for more to send.
                stream.set_nodelay(true)?;
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
