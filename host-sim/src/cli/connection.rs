//! Where the microcontroller is: options of all commands that talk to one.

use super::say;
use crate::target::{DEFAULT_ELF, Emulation, Logs, Target, TargetError};
use clap::Args;
use flexor::link::Identity;
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::time::Duration;

/// Where the microcontroller is.
#[derive(Args)]
pub(super) struct ConnectionArgs {
    /// The firmware's image: what QEMU boots, and the log's symbols
    #[arg(long, value_name = "FILE", default_value = DEFAULT_ELF, global = true)]
    elf: PathBuf,
    /// A board on this serial port instead of QEMU, or at tcp://HOST:PORT
    #[arg(long, value_name = "PORT", global = true)]
    port: Option<String>,
}

impl ConnectionArgs {
    /// Whether a board is named.
    pub(super) fn is_named(&self) -> bool {
        self.port.is_some()
    }

    /// Opens the port, or starts QEMU with a table in slot B. The firmware's log goes to
    /// standard error, past the bar. A board may take `timeout` to answer.
    pub(super) fn open(
        &self,
        table_b: Option<&[u8]>,
        timeout: Duration,
        bar: &ProgressBar,
    ) -> Result<Target, TargetError> {
        let bar = bar.clone();
        let logs = Logs::new(&self.elf, move |line| {
            bar.suspend(|| say(format_args!("firmware: {line}")));
        });
        match &self.port {
            // A board can do without the image; its log cannot be read then.
            Some(port) => {
                let (logs, none) = match logs {
                    Ok(logs) => (Some(logs), None),
                    Err(error) => (None, Some(error)),
                };
                let target = Target::on_port(port, timeout, logs);
                // A virtual board has no log.
                let silent = target.as_ref().map(Target::is_virtual).unwrap_or(false);
                if let (Some(error), false) = (none, silent) {
                    say(format_args!("no log: {error}"));
                }
                target
            }
            None => {
                let emulation = Emulation {
                    elf: &self.elf,
                    table_b,
                    accesses: None,
                };
                Target::emulated(&emulation, Some(logs?))
            }
        }
    }
}

/// The firmware's version and commit: `0.1.0`, `1234abcd`, with `+` where sources were
/// changed.
pub(super) fn firmware_version(identity: &Identity) -> (String, String) {
    let [major, minor, patch] = identity.version;
    let git = u32::from_be_bytes(identity.git);
    let changed = if identity.modified { "+" } else { "" };
    (
        format!("{major}.{minor}.{patch}"),
        format!("{git:08x}{changed}"),
    )
}
