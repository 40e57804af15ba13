//! Builds the image and runs `flexor pil` with it.

use crate::{firmware, root};
use anyhow::{Result, ensure};
use clap::Args;
use std::ffi::OsString;

/// Options of the verb `pil`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Options of `flexor pil`. Without any: the examples' task and their fast one, each
    /// against an arm of a tenth less stiffness, and 2,000 measurements of arbitrary bits.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Runs it and fails on any differing bit.
pub(crate) fn pil(options: &Options) -> Result<()> {
    if !options.arguments.is_empty() {
        return flexor(options.arguments.clone());
    }
    let out = root().join("out/pil");
    for (task, random) in [("task.toml", "0"), ("task_fast.toml", "2000")] {
        // The softer plant gives the feedback work to do.
        let mut arguments: Vec<OsString> = ["--bending-stiffness-scale", "0.9", "--random", random]
            .map(Into::into)
            .to_vec();
        arguments.extend(["--task".into(), root().join("examples").join(task).into()]);
        arguments.extend(["--out".into(), out.join(task).with_extension("").into()]);
        flexor(arguments)?;
    }
    Ok(())
}

/// `flexor pil` with the image that is built from these sources, unless another is named.
fn flexor(arguments: Vec<OsString>) -> Result<()> {
    let mut line: Vec<OsString> = vec!["flexor".into(), "pil".into()];
    let named = |a: &OsString| a == "--elf" || a.to_string_lossy().starts_with("--elf=");
    if !arguments.iter().any(named) {
        line.extend(["--elf".into(), firmware::build()?.into()]);
    }
    line.extend(arguments);
    let code = flexor_sim::cli::run(line);
    ensure!(code == 0, "flexor pil ended with exit code {code}");
    Ok(())
}
