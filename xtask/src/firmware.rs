//! Builds the one ELF that is flashed and that QEMU boots: image, setup and table.

use crate::demo::Demo;
use crate::setup::{TARGET, Toolchain};
use crate::{demo, image, output, root, run};
use anyhow::{Context, Result};
use clap::Args;
use shared::table::Table;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// cargo's folder for everything built.
pub(crate) fn target_folder() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from)
}

/// cargo with `verb` for the firmware's image, told where its table is.
pub(crate) fn cargo(verb: &str) -> Result<Command> {
    let toolchain = Toolchain::find()
        .with_context(|| format!("no toolchain has {TARGET}: run `cargo xtask setup`"))?;
    let out = target_folder().join("firmware");
    fs::create_dir_all(&out)?;
    let Demo { table, setup, .. } = demo::demo()?;
    let mut buffer = [0; 256];
    let setup = setup.encode(&mut buffer)?;
    let mut command = toolchain.command("cargo");
    command
        .current_dir(root().join("firmware"))
        .args([verb, "--release", "--target-dir"])
        .arg(&out)
        .env("FLEXOR_TABLE", write(&out.join("table.bin"), &table.image)?)
        .env("FLEXOR_SETUP", write(&out.join("setup.bin"), setup)?)
        .env("FLEXOR_GIT", git());
    Ok(command)
}

/// Writes a file, but not when it is the same already: cargo goes by its time.
pub(crate) fn write<'p>(path: &'p Path, bytes: &[u8]) -> Result<&'p Path> {
    if fs::read(path).ok().as_deref() != Some(bytes) {
        fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(path)
}

/// The commit, eight hex digits, and `+` where the sources differ from it.
fn git() -> String {
    let git = |arguments: &[&str]| output(Command::new("git").current_dir(root()).args(arguments));
    let commit = git(&["rev-parse", "--short=8", "HEAD"]).unwrap_or_default();
    let clean = git(&["status", "--porcelain"]).is_some_and(|changes| changes.is_empty());
    let short = commit.get(..8).unwrap_or_default();
    format!("{short}{}", if clean { "" } else { "+" })
}

/// Builds the image; returns the ELF's path.
pub(crate) fn build() -> Result<PathBuf> {
    run(&mut cargo("build")?)?;
    Ok(elf())
}

/// The one ELF: `flash` writes it, `pil` boots it.
fn elf() -> PathBuf {
    let folder = target_folder().join("firmware").join(TARGET);
    folder.join("release/firmware")
}

/// Lints the image's sources.
pub(crate) fn clippy() -> Result<()> {
    run(cargo("clippy")?.args(["--", "-D", "warnings"]))
}

/// Options of the verb `flash`.
#[derive(Args)]
pub(crate) struct FlashOptions {
    /// Write this table image alone, into slot B (a file `table.bin` of host-sim).
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Only say what would be written, and by which command.
    #[arg(long)]
    list: bool,
}

/// Start of table slot B, as in `memory.x`.
const SLOT_B: &str = "0x08040000";

/// Builds the image and writes it, table included, to a board: the file that `pil` boots.
pub(crate) fn flash(options: &FlashOptions) -> Result<()> {
    let mut probe = Command::new("probe-rs");
    probe.args(["download", "--chip", "STM32F405RGTx", "--verify"]);
    let file = match &options.table {
        Some(table) => {
            let bytes =
                fs::read(table).with_context(|| format!("cannot read {}", table.display()))?;
            Table::open(&bytes).with_context(|| format!("{} is no table", table.display()))?;
            probe.args(["--binary-format", "bin", "--base-address", SLOT_B]);
            table.clone()
        }
        None => build()?,
    };
    probe.arg(&file);
    if options.list {
        let bytes = fs::read(&file)?;
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
        println!(
            "{}: {} bytes, CRC-32 {crc:#010x}",
            file.display(),
            bytes.len()
        );
        if options.table.is_none() {
            for (address, length) in image::segments(&bytes)? {
                println!("  {length:6} bytes to {address:#010x}");
            }
        }
        println!("{probe:?}");
        return Ok(());
    }
    run(&mut probe).context("probe-rs comes with `cargo install probe-rs-tools`")
}

#[cfg(test)]
mod tests {
    use super::*;
    use host_sim::pil::DEFAULT_ELF;

    #[test]
    fn what_is_flashed_is_what_pil_boots_by_itself() {
        let place = DEFAULT_ELF.strip_prefix("target/").unwrap();
        assert!(elf().ends_with(place));
    }

    #[test]
    fn slot_b_is_where_the_memory_map_has_it() {
        let map = fs::read_to_string(root().join("memory.x")).unwrap();
        assert!(map.contains(&format!("TABLE_B : ORIGIN = {SLOT_B}, LENGTH = 128K")));
    }
}
