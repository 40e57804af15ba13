//! What continuous integration does, and what it stands on.

use crate::{browser, budget, firmware, pil, replay, root, run, setup};
use anyhow::Result;
use std::process::Command;

fn cargo(arguments: &[&str]) -> Result<()> {
    run(Command::new("cargo").current_dir(root()).args(arguments))
}

/// Every host test, and those that need the image in QEMU. Installs what these need, and
/// fails where that cannot be had: nothing is skipped.
pub(crate) fn test() -> Result<()> {
    if !setup::missing().is_empty() {
        setup::setup(false)?;
    }
    cargo(&["test", "--workspace"])?;
    let elf = firmware::build()?;
    let mut tests = Command::new("cargo");
    tests
        .current_dir(root())
        .args([
            "test",
            "--package",
            "flexor-tests",
            "--test",
            "firmware",
            "--test",
            "pil",
            "--package",
            "flexor-sim",
            "--test",
            "board",
            "--",
            "--ignored",
        ])
        .env("FLEXOR_ELF", elf);
    run(&mut tests)
}

/// Checks the host's library with each of its optional parts alone, and with none: in each no
/// warning.
fn features() -> Result<()> {
    for feature in ["", "bench", "campaign", "cli", "report", "tune", "target"] {
        run(Command::new("cargo")
            .current_dir(root())
            .args(["clippy", "--package", "flexor-sim", "--no-default-features"])
            .args(["--features", feature, "--", "-D", "warnings"]))?;
    }
    Ok(())
}

/// Formats, lints, tests, bit identity, budget.
pub(crate) fn ci() -> Result<()> {
    cargo(&["fmt", "--all", "--check"])?;
    run(Command::new("cargo")
        .current_dir(root().join("firmware"))
        .args(["fmt", "--all", "--check"]))?;
    cargo(&[
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ])?;
    features()?;
    firmware::clippy()?;
    replay::clippy()?;
    test()?;
    browser::browser()?;
    pil::pil(&pil::Options::default())?;
    budget::budget(&budget::Options::default())
}
