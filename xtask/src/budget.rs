//! What the firmware takes, held against `firmware/budget.toml`, and the tick on cores
//! without floating point, against `firmware/replay/budget.toml`.

use crate::image::{check_panic_free, check_stack_below_data, listing, masked_instructions, sizes};
use crate::limits::{self, Figures};
use crate::setup::Toolchain;
use crate::{announce, firmware, output_or_error, pil, replay, root};
use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::Value;
use std::path::Path;

/// Options of the verb `budget`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Write what was measured into the files, as the figures of the compiler in use.
    #[arg(long)]
    update: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Builds, measures, compares.
pub(crate) fn budget(options: &Options) -> Result<()> {
    let compiler = Toolchain::wanted()?.version()?;
    let image = measure()?;
    let without_fpu = replay::measure()?;
    let mut excess = vec![];
    for (file, figures) in [
        ("firmware/budget.toml", &image),
        ("firmware/replay/budget.toml", &without_fpu),
    ] {
        let verdict = limits::hold(&root().join(file), figures, &compiler, options.update)?;
        if !options.json {
            verdict.lines.iter().for_each(|line| println!("{line}"));
        }
        excess.extend(verdict.excess);
    }
    if options.json {
        let all: Figures = image.into_iter().chain(without_fpu.clone()).collect();
        println!("{}", serde_json::to_string_pretty(&all)?);
    } else {
        println!("no panic is reachable from the tick; an overflowing stack meets no variable");
        println!("{}", replay::EQUAL);
    }
    excess.extend(replay::too_slow(&without_fpu));
    ensure!(excess.is_empty(), "over budget: {}", excess.join("; "));
    Ok(())
}

/// What the default image takes on the examples' task, against an arm of a tenth less
/// stiffness, so that the feedback has work to do.
fn measure() -> Result<Figures> {
    let elf = firmware::build()?;
    announce("reading sizes, panics and interrupt locks from the image");
    let listing = listing(&elf)?;
    check_panic_free(&listing)?;
    check_stack_below_data(&elf)?;
    let sizes = sizes(&elf)?;
    let [hybrid, paper] = pil::GAINS.map(|gains| run(&elf, gains));
    let (hybrid, paper) = (hybrid?, paper?);
    ensure!(
        hybrid["slot"] == "A",
        "the image's own table is not in slot A, but in {}",
        hybrid["slot"]
    );
    let figure = |run: &Value, key: &str| {
        let value = run[key].as_u64();
        value.with_context(|| format!("flexor pil found no {key}: {}", run[key]))
    };
    // The law that needs more of it.
    let stack = figure(&hybrid, "stack_bytes")?.max(figure(&paper, "stack_bytes")?);
    let (median, most) = ("instructions_median", "instructions_max");
    Ok([
        ("flash_bytes", sizes.flash),
        ("ram_bytes", sizes.ram),
        ("stack_bytes", stack),
        ("tick_instructions_median", figure(&paper, median)?),
        ("tick_instructions_max", figure(&paper, most)?),
        ("hybrid_tick_instructions_median", figure(&hybrid, median)?),
        ("hybrid_tick_instructions_max", figure(&hybrid, most)?),
        ("masked_instructions_max", masked_instructions(&listing)?),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into())
}

/// Runs the image in QEMU with gains of the examples; the summary.
fn run(elf: &Path, gains: &str) -> Result<Value> {
    let mut flexor = pil::flexor(Some(elf));
    flexor.args(["--json", "--start", "equilibrium"]);
    flexor.args(["--bending-stiffness-scale", "0.9"]);
    let examples = root().join("examples");
    flexor.arg("--task").arg(examples.join("task.toml"));
    flexor.arg("--controller").arg(examples.join(gains));
    flexor
        .arg("--out")
        .arg(firmware::target_folder().join("budget"));
    Ok(serde_json::from_str(&output_or_error(&mut flexor)?)?)
}
