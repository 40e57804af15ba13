//! The command `pil`: `run` with the firmware as the controller.

use super::connection::{ConnectionArgs, firmware_version};
use super::run::{RunReport, Simulation, SimulationArgs};
use super::signals::stop_flag;
use super::{CliError, Output, progress_bar};
use crate::files::export;
use crate::target::pil::{PilError, PilRun};
use crate::target::{Target, pil};
use clap::Args;
use flexor::supervisor::{ControllerParameters, MonitorParameters};
use serde_json::{Map, Value, json};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

#[derive(Args)]
pub(super) struct PilArgs {
    #[command(flatten)]
    simulation: SimulationArgs,
    #[command(flatten)]
    connection: ConnectionArgs,
    /// After the run compare this many measurements of arbitrary bits
    #[arg(long, value_name = "N", default_value_t = 0)]
    random: u32,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/pil")]
    out: PathBuf,
}

/// Longest wait of `pil` for a board's answer. A run is not lost to a hiccup of the line.
const PORT_PATIENCE: Duration = Duration::from_secs(10);

/// Runs the task with the firmware, compares its commands, and reports.
pub(super) fn pil_command(args: &PilArgs) -> Result<(), CliError> {
    let output = Output::open(&args.out, args.simulation.inputs())?;
    let simulation = args.simulation.prepare()?;
    let compared = compare(args, &simulation)?;
    let Compared {
        target,
        pil,
        random_differing,
    } = &compared;
    let mut facts = pil_facts(target, pil);
    if args.random > 0 {
        facts.push((
            "arbitrary measurements".into(),
            format!("{}, {random_differing} commands differ", args.random),
        ));
    }
    let mut keys = pil_json(target, pil);
    keys.extend(export::object([
        ("random_measurements", json!(args.random)),
        ("random_differing", json!(random_differing)),
    ]));
    let timing = export::object([("wall_s", json!(pil.wall_s))]);
    let report = RunReport {
        run: &pil.run,
        title: "Flexor: processor in the loop",
        keys,
        facts,
        timing: (timing, ("took".into(), format!("{:.1} s", pil.wall_s))),
        json: args.simulation.common.json,
    };
    simulation.report(output, report)?;
    if let Some(first) = pil.first_difference {
        return Err(CliError::Differs {
            differing: pil.differing_commands,
            ticks: pil.ticks,
            first,
        });
    }
    if *random_differing > 0 {
        return Err(CliError::RandomDiffers {
            differing: *random_differing,
            count: args.random,
        });
    }
    simulation.judge(&pil.run, &args.out)
}

/// What the comparison found.
struct Compared {
    target: Target,
    pil: PilRun,
    /// Commands that differ for arbitrary measurements.
    random_differing: u32,
}

/// Runs the task, then the arbitrary measurements, until a signal.
fn compare(args: &PilArgs, simulation: &Simulation) -> Result<Compared, CliError> {
    let Simulation {
        planned, options, ..
    } = simulation;
    let (plan, image) = (&planned.plan, &planned.table.image);
    let stop = stop_flag()?;
    let all = plan.points.len() + args.random as usize;
    let progress = progress_bar(all as u64, "ticks, {eta} left");
    let go_on = || {
        progress.inc(1);
        match stop.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    };
    let run = || -> Result<_, PilError> {
        let mut target = args
            .connection
            .open(Some(image), PORT_PATIENCE, &progress)?;
        let pil = pil::run(&mut target, plan, image, options, |_| go_on())?;
        let setup = ControllerParameters {
            arm: plan.model.arm,
            law: options.law.without_settling(),
            limits: options.limits,
            monitors: MonitorParameters::NONE,
        };
        let random_differing = match args.random {
            0 => 0,
            // Any seed; this one, so that a difference comes again.
            count => pil::compare_any(&mut target, image, &setup, count, 1, |_| go_on())?,
        };
        Ok(Compared {
            target,
            pil,
            random_differing,
        })
    };
    let compared = run().map_err(|error| match error {
        // The signal's end of QEMU, which gets it from the terminal too.
        PilError::Target(_) if stop.load(Ordering::Relaxed) => PilError::Interrupted {
            done: progress.position() as usize,
            all,
        },
        error => error,
    });
    progress.finish_and_clear();
    Ok(compared?)
}

/// What a processor in the loop adds to the summary.
fn pil_json(target: &Target, pil: &PilRun) -> Map<String, Value> {
    let spread = pil.counts_spread();
    let [min, median, max] = spread.map(|ticks_hw| target.instructions(ticks_hw));
    let (version, git) = firmware_version(target.identity());
    let [cycles_min, cycles_median, cycles_max] = spread.map(|ticks_hw| target.cycles(ticks_hw));
    export::object([
        ("differing_commands", json!(pil.differing_commands)),
        ("first_difference", json!(pil.first_difference)),
        ("instructions_min", json!(min)),
        ("instructions_median", json!(median)),
        ("instructions_max", json!(max)),
        ("cycles_min", json!(cycles_min)),
        ("cycles_median", json!(cycles_median)),
        ("cycles_max", json!(cycles_max)),
        ("slot", json!(format!("{:?}", pil.slot))),
        ("firmware_version", json!(version)),
        ("firmware_git", json!(git)),
        ("stack_bytes", json!(pil.status.stack_bytes)),
    ])
}

/// The same as facts for a reader.
fn pil_facts(target: &Target, pil: &PilRun) -> Vec<(String, String)> {
    let identity = target.identity();
    let (version, git) = firmware_version(identity);
    let spread = pil.counts_spread();
    let [min, median, max] = spread.map(|c| target.instructions(c).or(target.cycles(c)));
    let unit = match target.instructions(0) {
        Some(_) => "instructions a tick",
        None => "cycles a tick",
    };
    let number = |n: Option<u32>| n.map_or("?".into(), |n| n.to_string());
    [
        (
            "firmware",
            format!(
                "{version} ({git}), clock {:?}, started: {:?}, table in slot {:?}",
                identity.clock, identity.start, pil.slot
            ),
        ),
        (
            "compared",
            match pil.first_difference {
                None => format!("{} commands, every bit the same", pil.ticks),
                Some(first) => format!(
                    "{} of {} commands differ, the first at tick {first}",
                    pil.differing_commands, pil.ticks
                ),
            },
        ),
        (
            unit,
            format!(
                "{} least, {} median, {} most",
                number(min),
                number(median),
                number(max)
            ),
        ),
        (
            "firmware's stack",
            format!("{} bytes at the deepest", pil.status.stack_bytes),
        ),
    ]
    .map(|(name, fact)| (name.to_string(), fact))
    .to_vec()
}
