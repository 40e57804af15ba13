//! Finds or installs what the firmware needs beyond a host toolchain: a Rust toolchain
//! with the Cortex-M4F, M3 and M0 targets, the linker flip-link, QEMU 10 and an ARM
//! disassembler.

use crate::{announce, output, root, run};
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::process::Command;

/// The firmware's target.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// All targets: the firmware's, and those of the cores without floating point.
const TARGETS: [&str; 3] = [TARGET, "thumbv7m-none-eabi", "thumbv6m-none-eabi"];

/// Toolchain that `setup-thumb.sh` makes.
const DEBIAN_TOOLCHAIN: &str = "thumb";

/// A cargo for building firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Toolchain {
    /// The one in use has the target.
    Current,
    /// That of `setup-thumb.sh`.
    Debian,
}

impl Toolchain {
    /// The first that is there.
    pub(crate) fn find() -> Option<Self> {
        [Self::Current, Self::Debian]
            .into_iter()
            .find(|t| TARGETS.into_iter().all(|target| t.has_target(target)))
    }

    /// The first that is there.
    ///
    /// # Errors
    /// If none is: how to get one.
    pub(crate) fn wanted() -> Result<Self> {
        Self::find().with_context(|| {
            let targets = TARGETS.join(", ");
            format!("no toolchain has {targets}: run `cargo xtask setup`")
        })
    }

    /// What its compiler calls itself: figures of code hold for that one.
    pub(crate) fn version(self) -> Result<String> {
        output(self.command("rustc").arg("--version")).context("rustc does not tell its version")
    }

    /// `program` of this toolchain.
    pub(crate) fn command(self, program: &str) -> Command {
        let mut command = Command::new(program);
        if self == Self::Debian {
            command.env("RUSTUP_TOOLCHAIN", DEBIAN_TOOLCHAIN);
        }
        command
    }

    fn has_target(self, target: &str) -> bool {
        let mut rustc = self.command("rustc");
        // Only look: rustup must not download a toolchain of that name.
        rustc.env("RUSTUP_AUTO_INSTALL", "0");
        rustc.args(["--print", "target-libdir", "--target", target]);
        output(&mut rustc).is_some_and(|folder| {
            let core = Path::new(&folder)
                .read_dir()
                .into_iter()
                .flatten()
                .flatten();
            core.into_iter()
                .any(|file| file.file_name().to_string_lossy().starts_with("libcore-"))
        })
    }
}

/// Major version of the QEMU in the path.
fn qemu_version() -> Option<u32> {
    let text = output(Command::new("qemu-system-arm").arg("--version"))?;
    let version = text.strip_prefix("QEMU emulator version ")?;
    version.split('.').next()?.parse().ok()
}

/// Whether the firmware's linker is in the path.
fn has_linker() -> bool {
    output(Command::new("flip-link").arg("--help")).is_some()
}

/// What is not there.
pub(crate) fn missing() -> Vec<&'static str> {
    let mut missing = Vec::new();
    if Toolchain::find().is_none() {
        missing.extend(TARGETS);
    }
    if !has_linker() {
        missing.push("flip-link");
    }
    if qemu_version().is_none_or(|version| version < 10) {
        missing.push("qemu-system-arm 10");
    }
    if output(Command::new("arm-none-eabi-objdump").arg("--version")).is_none() {
        missing.push("arm-none-eabi-objdump");
    }
    missing
}

/// Installs what is missing. `debian` does not ask rustup's servers.
pub(crate) fn setup(debian: bool) -> Result<()> {
    announce("looking for the Cortex-M targets, flip-link, QEMU 10 and arm-none-eabi-objdump");
    if Toolchain::find().is_none() && !debian {
        // Fails where rustup has nothing to download from; the script is next.
        let _ = run(Command::new("rustup").args(["target", "add"]).args(TARGETS));
    }
    if !has_linker() {
        // Where cargo puts what it installs, which is in the path with cargo itself.
        run(Command::new("cargo").args(["install", "--locked", "flip-link@^0.1.12"]))?;
    }
    let absent = missing();
    if !absent.is_empty() {
        announce(&format!("missing: {}", absent.join(", ")));
        if output(Command::new("apt-get").arg("--version")).is_none() {
            bail!(
                "install {} and run this again; without rustup's servers or Debian there is no \
                 way to do it here",
                absent.join(", ")
            );
        }
        let mut script = Command::new("bash");
        script.arg(root().join("xtask/setup-thumb.sh"));
        if Toolchain::find().is_some() {
            script.arg("--no-toolchain");
        }
        run(script.arg("--qemu"))?;
    }
    let absent = missing();
    if !absent.is_empty() {
        bail!("still missing after set-up: {}", absent.join(", "));
    }
    println!(
        "{} ({:?} toolchain), flip-link, QEMU {} and arm-none-eabi-objdump are there",
        TARGETS.join(", "),
        Toolchain::find(),
        qemu_version().unwrap_or_default()
    );
    Ok(())
}
