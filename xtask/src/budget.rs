//! What the firmware takes, held against `firmware/budget.toml`, and the tick on cores
//! without floating point, against `firmware/replay/budget.toml`.

use crate::image::{
    MASKED_MAX, check_panic_free, check_stack_below_data, listing, masked_instructions, sizes,
};
use crate::inputs::Demo;
use crate::{firmware, inputs, replay, root};
use anyhow::{Context, Result, ensure};
use clap::Args;
use flexor::table::Slot;
use flexor_sim::target::{Emulation, Target, pil};
use serde::{Deserialize, Serialize};
use std::fs;

/// Options of the verb `budget`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// Write what was measured to the golden file.
    #[arg(long)]
    update: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What the default image takes on the paper's task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Budget {
    /// Image without table, bytes.
    flash_bytes: u64,
    /// Static data, bytes.
    ram_bytes: u64,
    /// Deepest stack, bytes.
    stack_bytes: u64,
    /// Instructions of a tick, median.
    tick_instructions_median: u64,
    /// The same, most.
    tick_instructions_max: u64,
    /// Most instructions with interrupts held off, outside the tick.
    masked_instructions_max: u64,
}

/// What may never be exceeded.
const BARS: Budget = Budget {
    flash_bytes: 64 * 1024,
    ram_bytes: 16 * 1024,
    stack_bytes: 4 * 1024,
    tick_instructions_median: 500,
    tick_instructions_max: 800,
    masked_instructions_max: MASKED_MAX,
};

/// Excess over the golden file that passes, percent: another compiler version makes a few
/// instructions more or less of the same source.
const TOLERANCE_PERCENT: u64 = 3;

impl Budget {
    fn entries(&self) -> [(&'static str, u64); 6] {
        [
            ("flash_bytes", self.flash_bytes),
            ("ram_bytes", self.ram_bytes),
            ("stack_bytes", self.stack_bytes),
            ("tick_instructions_median", self.tick_instructions_median),
            ("tick_instructions_max", self.tick_instructions_max),
            ("masked_instructions_max", self.masked_instructions_max),
        ]
    }

    /// What exceeds `limit` by more than so many percent.
    fn excess(&self, limit: &Self, percent: u64) -> Vec<String> {
        self.entries()
            .into_iter()
            .zip(limit.entries())
            .filter(|((_, is), (_, most))| is * 100 > most * (100 + percent))
            .map(|((name, is), (_, most))| format!("{name} is {is}, at most {most} was expected"))
            .collect()
    }
}

/// Builds, measures, compares.
pub(crate) fn budget(options: &Options) -> Result<()> {
    let elf = firmware::build()?;
    let listing = listing(&elf)?;
    check_panic_free(&listing)?;
    check_stack_below_data(&elf)?;
    let sizes = sizes(&elf)?;
    let Demo { plan, table, setup } = inputs::demo()?;
    let emulation = Emulation {
        elf: &elf,
        table_b: None,
        accesses: None,
    };
    let mut target = Target::emulated(&emulation, None)?;
    let options_of_run = inputs::options(&setup);
    let go_on = |_| std::ops::ControlFlow::Continue(());
    let run = pil::run(&mut target, &plan, &table.image, &options_of_run, go_on)?;
    ensure!(
        run.slot == Slot::A,
        "the image's own table is not in slot A"
    );
    let [_, median, max] = run
        .counts_spread()
        .map(|counts| target.instructions(counts));
    let none = "the firmware's stopwatch does not count";
    let measured = Budget {
        flash_bytes: sizes.flash,
        ram_bytes: sizes.ram,
        stack_bytes: run.status.stack_bytes.into(),
        tick_instructions_median: median.context(none)?.into(),
        tick_instructions_max: max.context(none)?.into(),
        masked_instructions_max: masked_instructions(&listing)?,
    };
    let without_fpu = replay::measure()?;
    if options.json {
        let mut all = serde_json::to_value(measured)?;
        if let Some(all) = all.as_object_mut() {
            for (name, value) in &without_fpu {
                all.insert(name.clone(), (*value).into());
            }
        }
        println!("{all:#}");
    } else {
        for ((name, is), (_, bar)) in measured.entries().into_iter().zip(BARS.entries()) {
            println!("{name:26} {is:6}  of {bar:6}");
        }
        println!("no panic is reachable from the tick; an overflowing stack meets no variable");
        replay::show(&without_fpu);
    }
    let golden = root().join("firmware/budget.toml");
    if options.update {
        let text = format!(
            "# Written by `cargo xtask budget --update`; what the default image takes.\n{}",
            toml::to_string(&measured)?
        );
        fs::write(&golden, text)?;
    }
    let text =
        fs::read_to_string(&golden).with_context(|| format!("cannot read {}", golden.display()))?;
    let mut excess = measured.excess(&toml::from_str(&text)?, TOLERANCE_PERCENT);
    excess.extend(measured.excess(&BARS, 0));
    excess.extend(replay::excess(&without_fpu, options.update)?);
    ensure!(
        excess.is_empty(),
        "over budget: {}; if that is meant, `cargo xtask budget --update`",
        excess.join("; ")
    );
    Ok(())
}
