//! The demo with the image in QEMU, or with a board, in the loop.

use crate::demo::Demo;
use crate::{demo, firmware};
use anyhow::{Result, ensure};
use clap::Args;
use host_sim::pil::{self, PilRun, Processor};
use serde::Serialize;
use shared::link::Slot;

/// Options of the verb `pil`.
#[derive(Args, Default)]
pub(crate) struct Options {
    /// A real board's serial port; without it QEMU runs the image.
    #[arg(long)]
    port: Option<String>,
    /// Travel the path in this time, s; the table is then in slot B.
    #[arg(long)]
    duration: Option<f64>,
    /// Also compare this many measurements of arbitrary bits.
    #[arg(long, default_value_t = 0)]
    random: u32,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    ticks: usize,
    differing_commands: usize,
    instructions_min: Option<u32>,
    instructions_median: Option<u32>,
    instructions_max: Option<u32>,
    wall_s: f64,
    outcome: &'static str,
    random_measurements: u32,
    random_differing: u32,
    stack_bytes: u32,
}

/// Runs it and fails on any differing bit.
pub(crate) fn pil(options: &Options) -> Result<()> {
    let Demo { plan, table, setup } = demo::demo(options.duration)?;
    let slot = if options.duration.is_some() {
        Slot::B
    } else {
        Slot::A
    };
    let table_b = (slot == Slot::B).then_some(&*table.image);
    let mut processor = match &options.port {
        Some(port) => Processor::on_port(port)?,
        None => Processor::emulated(&firmware::build()?, table_b)?,
    };
    if !options.json {
        println!("{:#?}", processor.identity());
    }
    let run = pil::run(
        &mut processor,
        slot,
        &plan,
        &table.image,
        &demo::options(&setup),
        |_| {},
    )?;
    let random_differing = pil::compare_any(
        &mut processor,
        slot,
        &table.image,
        &setup,
        options.random,
        1,
    )?;
    let report = report(&processor, &run, options.random, random_differing);
    if options.json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        println!("{:#?}", run.status);
        println!(
            "{} ticks, {} commands differ; outcome {}; force error at most {:.4} N; {:.1} s",
            run.ticks,
            run.differing_commands,
            report.outcome,
            run.run.summary.force_error_max,
            run.wall_s
        );
        if options.random > 0 {
            println!(
                "{} measurements of arbitrary bits, {random_differing} commands differ",
                options.random
            );
        }
        let [min, median, max] = run.counts_spread();
        match (
            report.instructions_min,
            report.instructions_median,
            report.instructions_max,
        ) {
            (Some(min), Some(median), Some(max)) => {
                println!("instructions a tick: {min} min, {median} median, {max} max");
            }
            _ => println!(
                "time of a tick: {:.2} us min, {:.2} us median, {:.2} us max",
                processor.seconds(min) * 1e6,
                processor.seconds(median) * 1e6,
                processor.seconds(max) * 1e6
            ),
        }
    }
    ensure!(
        run.differing_commands == 0 && random_differing == 0,
        "{} of {} commands differ, first at tick {:?}; of the random ones {random_differing}",
        run.differing_commands,
        run.ticks,
        run.first_difference
    );
    Ok(())
}

fn report(processor: &Processor, run: &PilRun, random: u32, random_differing: u32) -> Report {
    let [min, median, max] = run.counts_spread();
    Report {
        ticks: run.ticks,
        differing_commands: run.differing_commands,
        instructions_min: processor.instructions(min),
        instructions_median: processor.instructions(median),
        instructions_max: processor.instructions(max),
        wall_s: run.wall_s,
        outcome: run.run.summary.outcome.name(),
        random_measurements: random,
        random_differing,
        stack_bytes: run.status.stack_bytes,
    }
}
