//! The command `demo`: the paper's task in all its cases.

use super::plan::Planned;
use super::provenance::{Provenance, with_timing};
use super::{
    CliError, Common, Output, gains, pages, paper_law, print, print_facts, progress_bar, results,
};
use crate::files::{config, export};
use crate::simulation::cases;
use crate::simulation::cases::{CASES, PLANTS};
use crate::simulation::closed_loop::{Run, RunOptions, Simulation};
use clap::Args;
use flexor::control::LawParameters;
use indicatif::ProgressBar;
use serde_json::{Map, Value, json};
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Args)]
pub(super) struct DemoArgs {
    #[command(flatten)]
    common: Common,
    /// Gains; without it those of examples/controller_paper.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
}

/// Plans, runs all cases, and writes and prints what came of it.
pub(super) fn demo(args: &DemoArgs) -> Result<(), CliError> {
    let inputs = args.common.inputs();
    let inputs = inputs.into_iter().chain([args.controller.as_deref()]);
    let output = Output::open(&args.out, inputs)?;
    let (arm, task) = args.common.load_on_surface("`flexor demo`")?;
    let law = paper_law("demo", args.controller.as_deref())?;
    if !law.feedforward {
        return Err(CliError::NoEffect {
            what: "feedforward = false in --controller",
            beside: "in demo, whose cases say which part of the law acts: true is accepted",
        });
    }
    let since = Instant::now();
    let planned = [
        args.common.plan(&arm, &task)?,
        args.common
            .plan(&arm, &cases::fast(&task))
            .map_err(|error| CliError::Fast(error.into()))?,
    ];
    gains::warn(&planned[0].plan, &cases::plant(arm.elements, 1.0), &law);
    let law = law.into();
    let made = Provenance::of(&args.common)?
        .profile(&task)
        .file(
            "controller",
            args.controller.as_deref(),
            config::PAPER_CONTROLLER,
        )?
        .gains(&law);
    for (planned, name) in planned.iter().zip(["", "_fast"]) {
        let (plan, image) = (&planned.plan, &planned.table.image);
        output.write(&format!("plan{name}.csv"), |w| export::plan_csv(plan, w))?;
        output.write(&format!("table{name}.bin"), |w| w.write_all(image))?;
    }

    let progress = progress_bar((CASES.len() * PLANTS.len()) as u64, "{msg}");
    let runs = run_cases(&output, arm.elements, (&law, &made), &planned, &progress)?;
    progress.set_message("report");
    let summary = made.summary(summary_json(&runs, &planned));
    output.json("summary.json", &summary)?;
    let place = write_page(&output, &runs, &planned, &made)?;
    output.commit()?;
    progress.finish_and_clear();

    if args.common.json {
        let seconds = since.elapsed().as_secs_f64();
        let mut timing = planned[0].timing();
        timing.extend(export::object([("demo_s", json!(seconds))]));
        return print(with_timing(&summary, timing));
    }
    print_facts(&planned[0].facts())?;
    print_facts(&[planned[0].took()])?;
    print("")?;
    print(results(
        runs.iter().map(|demo| (demo.case, demo.plant, &demo.run)),
    ))?;
    print(format_args!(
        "\n{} runs in {:.1} s. {place}",
        runs.len(),
        since.elapsed().as_secs_f64()
    ))
}

/// Writes figures and page; says where they will be.
fn write_page(
    output: &Output,
    runs: &[DemoRun],
    planned: &[Planned; 2],
    made: &Provenance,
) -> Result<String, CliError> {
    let runs = runs.iter();
    let cases: Vec<pages::CaseRun> = runs
        .map(|demo| {
            (
                demo.case,
                demo.plant,
                &planned[demo.planned].plan,
                &demo.run,
            )
        })
        .collect();
    let fast = planned[1].facts().into_iter();
    let fast = fast.map(|(name, fact)| (format!("fast: {name}"), fact));
    let facts: Vec<(String, String)> = planned[0].facts().into_iter().chain(fast).collect();
    // The one in which something happens: the paper's law on another arm than the planned one.
    let shown = { cases.iter() }.position(|(case, plant, ..)| (*case, *plant) == SHOWN);
    let page = pages::RunsContent {
        title: "Flexor: the paper's manipulation",
        cases: &cases,
        shown: shown.unwrap_or_default(),
        facts: &facts,
        provenance: &made.facts(),
    };
    pages::runs(output, &page)
}

/// Case and plant that the page begins with.
const SHOWN: (&str, &str) = ("proposed", "stiffness_x0.9");

/// A case's run on a plant.
struct DemoRun {
    case: &'static str,
    plant: &'static str,
    /// Which plan was run: the task's, or the fast one's.
    planned: usize,
    run: Run,
}

/// Runs every case on every plant and writes each run into a folder of its own.
fn run_cases(
    output: &Output,
    elements: usize,
    (law, made): (&LawParameters, &Provenance),
    planned: &[Planned; 2],
    progress: &ProgressBar,
) -> Result<Vec<DemoRun>, CliError> {
    let mut runs = Vec::new();
    for case in &CASES {
        for (plant, scale) in PLANTS {
            progress.set_message(format!("{}, {plant}", case.name));
            let used = usize::from(case.fast);
            let options = RunOptions {
                law: case.mode.of(law),
                limits: planned[used].limits,
                plant: cases::plant(elements, scale),
                start: case.start,
            };
            let (plan, image) = (&planned[used].plan, &planned[used].table.image);
            let run = Simulation::<f32>::new(plan, image, &options)?.run(|_| {});
            let name = |file: &str| format!("{}_{plant}/{file}", case.name);
            output.write(&name("run.csv"), |w| export::run_csv(&run, w))?;
            let mut summary = export::summary_json(&run.summary);
            summary.extend(planned[used].json());
            let of_case = made.clone().gains(&options.law).plant(&options.plant);
            output.json(&name("summary.json"), &of_case.summary(summary))?;
            runs.push(DemoRun {
                case: case.name,
                plant,
                planned: used,
                run,
            });
            progress.inc(1);
        }
    }
    Ok(runs)
}

/// All runs' errors, and both plans' figures.
fn summary_json(runs: &[DemoRun], planned: &[Planned; 2]) -> Map<String, Value> {
    let entry = |demo: &DemoRun| {
        let names = [("case", json!(demo.case)), ("plant", json!(demo.plant))];
        let mut entry = export::object(names);
        entry.extend(export::errors_json(&demo.run.summary));
        Value::Object(entry)
    };
    let list: Vec<Value> = runs.iter().map(entry).collect();
    export::object([
        ("cases", json!(list)),
        ("plan", json!(planned[0].json())),
        ("plan_fast", json!(planned[1].json())),
    ])
}
