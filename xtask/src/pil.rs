//! Builds the image and runs `flexor pil` with it.

use crate::{announce, firmware, root, run};
use anyhow::Result;
use clap::Args;
use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

/// Options of the verb `pil`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Options of `flexor pil`. Without any: the examples' task and their fast one, with either
    /// law, against an arm of a tenth less stiffness, and 2,000 measurements of arbitrary bits.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Runs it and fails on any differing bit.
pub(crate) fn pil(options: &Options) -> Result<()> {
    if !options.arguments.is_empty() {
        let named = |a: &OsString| a == "--elf" || a.to_string_lossy().starts_with("--elf=");
        // The image that is built from these sources, unless another is named.
        let elf = match options.arguments.iter().any(named) {
            true => None,
            false => Some(firmware::build()?),
        };
        return run(flexor(elf.as_deref()).args(&options.arguments));
    }
    let elf = firmware::build()?;
    let out = root().join("out/pil");
    let examples = root().join("examples");
    for (task, random) in [("task.toml", "0"), ("task_fast.toml", "2000")] {
        for gains in GAINS {
            announce(&format!(
                "processor in the loop, examples/{task}, examples/{gains}"
            ));
            let name = format!("{task}_{gains}").replace(".toml", "");
            // The softer plant gives the feedback work to do.
            run(flexor(Some(&elf))
                .args(["--bending-stiffness-scale", "0.9", "--random", random])
                .arg("--task")
                .arg(examples.join(task))
                .arg("--controller")
                .arg(examples.join(gains))
                .arg("--out")
                .arg(out.join(name)))?;
        }
    }
    Ok(())
}

/// Gains of either law, the image's own first.
pub(crate) const GAINS: [&str; 2] = ["controller.toml", "controller_paper.toml"];

/// `flexor pil`, built where it is not, with an image or without one named.
pub(crate) fn flexor(elf: Option<&Path>) -> Command {
    let mut command = Command::new("cargo");
    let manifest = root().join("Cargo.toml");
    command.args(["run", "--release", "--package", "flexor-sim"]);
    command.arg("--manifest-path").arg(manifest);
    command.args(["--bin", "flexor", "--", "pil"]);
    if let Some(elf) = elf {
        command.arg("--elf").arg(elf);
    }
    command
}
