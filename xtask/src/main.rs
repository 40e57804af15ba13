//! Flexor's chores. Each job of continuous integration is one verb.

mod browser;
mod budget;
mod ci;
mod firmware;
mod image;
mod inputs;
mod limits;
mod pil;
mod replay;
mod setup;

use anyhow::{Context, Result, ensure};
use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Flexor's chores.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Find or install the Cortex-M target and QEMU 10.
    Setup {
        /// Take the target from Debian's archive (xtask/setup-thumb.sh) without asking
        /// rustup's servers.
        #[arg(long)]
        debian: bool,
    },
    /// Plan a table and build the firmware's image around it, its arm, its gains and its board;
    /// without files the demo's. Prints the image's path.
    #[command(
        after_help = "Example: cargo xtask firmware --arm my_arm.toml --task my_task.toml --controller my_gains.toml"
    )]
    Firmware(inputs::Files),
    /// Build the image, as `firmware` does, and write it and its table to a board (needs
    /// probe-rs); or write a table alone.
    #[command(
        after_help = "Examples: cargo xtask flash --arm my_arm.toml --task my_task.toml\n          cargo xtask flash --table out/plan/table.bin --slot b"
    )]
    Flash(firmware::FlashOptions),
    /// Build the image and run `flexor pil` with it: QEMU, or a board, in the loop, every
    /// command compared bit by bit.
    #[command(disable_help_flag = true)]
    Pil(pil::Options),
    /// Hold flash, RAM, stack and instructions per tick against the limits in
    /// firmware/budget.toml, and check that the tick cannot panic.
    Budget(budget::Options),
    /// Replay the demo on Cortex-M0 and M3 in QEMU, in fixed point and in emulated f32, and
    /// hold what it takes against firmware/replay/budget.toml.
    Replay(replay::Options),
    /// Use the pages in Chromium or Chrome, without a window: charts, arm, table, phone widths, dark
    /// mode, contrast. Skipped, with a word, where there is no such browser; nothing is downloaded.
    Browser,
    /// Run every test, those with the image in QEMU included.
    Test,
    /// Everything that continuous integration checks.
    Ci,
}

fn main() -> Result<()> {
    match Arguments::parse().verb {
        Verb::Setup { debian } => setup::setup(debian),
        Verb::Firmware(files) => {
            println!("{}", firmware::build_with(&files)?.display());
            Ok(())
        }
        Verb::Flash(options) => firmware::flash(&options),
        Verb::Pil(options) => pil::pil(&options),
        Verb::Budget(options) => budget::budget(&options),
        Verb::Replay(options) => replay::run_verb(&options),
        Verb::Browser => browser::browser(),
        Verb::Test => ci::test(),
        Verb::Ci => ci::ci(),
    }
}

/// The project's top folder.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map(Path::to_path_buf)
        .unwrap_or_default()
}

/// Says on standard error what is being done.
fn announce(what: &str) {
    eprintln!("xtask: {what}");
}

/// A command as one would type it.
fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let words: Vec<_> = words.map(|word| word.to_string_lossy()).collect();
    words.join(" ")
}

/// Says what is run, and runs it to its end.
fn run(command: &mut Command) -> Result<()> {
    announce(&shown(command));
    let status = command
        .status()
        .with_context(|| format!("cannot start {}", command.get_program().display()))?;
    ensure!(status.success(), "{} ended with {status}", shown(command));
    Ok(())
}

/// Says what is run, runs it to its end, and returns its standard output.
fn output_or_error(command: &mut Command) -> Result<String> {
    announce(&shown(command));
    let output = command
        .stderr(Stdio::inherit())
        .output()
        .with_context(|| format!("cannot start {}", command.get_program().display()))?;
    let status = output.status;
    ensure!(status.success(), "{} ended with {status}", shown(command));
    Ok(String::from_utf8(output.stdout)?)
}

/// A command's standard output; `None` if it cannot be run or fails.
fn output(command: &mut Command) -> Option<String> {
    let output = command.output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
