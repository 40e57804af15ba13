//! Builds the one ELF that is flashed and that QEMU boots: image, setup and table.

use crate::demo::Demo;
use crate::setup::{TARGET, Toolchain};
use crate::{demo, output, root, run};
use anyhow::{Context, Result};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// cargo's folder for everything built.
fn target_folder() -> PathBuf {
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
fn write<'p>(path: &'p Path, bytes: &[u8]) -> Result<&'p Path> {
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
    let folder = target_folder().join("firmware").join(TARGET);
    Ok(folder.join("release/firmware"))
}

/// Lints the image's sources.
pub(crate) fn clippy() -> Result<()> {
    run(cargo("clippy")?.args(["--", "-D", "warnings"]))
}

/// Builds the image and writes it, table included, to a board.
pub(crate) fn flash() -> Result<()> {
    let elf = build()?;
    run(Command::new("probe-rs")
        .args(["download", "--chip", "STM32F405RGTx", "--verify"])
        .arg(elf))
    .context("probe-rs comes with `cargo install probe-rs-tools`")
}
