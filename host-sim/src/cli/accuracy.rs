//! The command `accuracy`.

use super::provenance::{Provenance, with_timing};
use super::{CliError, Common, Output, controller, pages, print, print_facts, progress_bar};
use crate::analysis::fixed_point::accuracy::{Accuracy, Errors};
use crate::analysis::fixed_point::range::Analysis;
use crate::analysis::fixed_point::{accuracy, range};
use crate::files::config::PAPER_CONTROLLER;
use crate::files::export;
use crate::simulation::cases;
use crate::simulation::closed_loop::RunOptions;
use crate::simulation::start::Start;
use crate::text::four_digits;
use clap::Args;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct AccuracyArgs {
    #[command(flatten)]
    common: Common,
    /// Gains; without it those of examples/controller_paper.toml
    #[arg(long, value_name = "FILE")]
    controller: Option<PathBuf>,
    /// Largest torque error, N m, that is accepted of joint 1 and of joint 2 in closed loop, of either
    /// number type; without it the bounds alone are held. The plant is the demo's soft one
    #[arg(long, value_names = ["JOINT1", "JOINT2"], num_args = 2, allow_negative_numbers = true)]
    limit: Vec<f64>,
    /// Folder for the results; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/accuracy")]
    out: PathBuf,
}

/// Measures f32 and fixed point against f64 and reports. A number type that is less exact than
/// stated is a failure.
pub(super) fn accuracy(args: &AccuracyArgs) -> Result<(), CliError> {
    let limit_nm = args.limit_nm()?;
    let inputs = args.common.inputs();
    let inputs = inputs.into_iter().chain([args.controller.as_deref()]);
    let output = Output::open(&args.out, inputs)?;
    let (arm, task) = args.common.load_on_surface("`flexor accuracy`")?;
    let law = controller(args.controller.as_deref(), PAPER_CONTROLLER)?;
    let planned = args.common.plan(&arm, &task)?;
    // The demo's soft plant, started as planned: the feedback has work to do.
    let options = RunOptions {
        law,
        limits: planned.limits,
        plant: cases::plant(arm.elements, 0.9),
        start: Start::PlanAtRest,
    };
    let (plan, image) = (&planned.plan, &planned.table.image);
    let analysis = range::analyse(plan, image, &law, &planned.limits)?;
    let progress = progress_bar(accuracy::effort(plan), "ticks, {eta} left");
    let accuracies = accuracy::measure(plan, image, &options, &|| progress.inc(1))?;
    progress.finish_and_clear();

    let judged = limit_nm.map(|limit_nm| judge(&accuracies, limit_nm));
    let judged = judged.unwrap_or_default();
    let mut excess: Vec<String> = accuracies.iter().flat_map(Accuracy::excess).collect();
    excess.extend(judged.iter().filter_map(Judged::excess));
    let made = Provenance::of(&args.common)?
        .profile(&task)
        .file("controller", args.controller.as_deref(), PAPER_CONTROLLER)?
        .gains(&law)
        .plant(&options.plant);
    let summary = made.summary(summary_keys(&accuracies, &analysis, &judged, &excess));
    output.json("summary.json", &summary)?;
    output.write("accuracy.csv", |w| trace_csv(&accuracies, w))?;
    let facts = format_facts(&analysis);
    let page = pages::AccuracyContent {
        accuracies: &accuracies,
        excess: &excess,
        limit_nm,
        facts: &facts,
        provenance: &made.facts(),
    };
    let place = pages::accuracy(&output, &page)?;
    output.commit()?;
    if args.common.json {
        print(with_timing(&summary, planned.timing()))?;
    } else {
        print(table(&accuracies))?;
        print("")?;
        if !judged.is_empty() {
            print_facts(&judged.iter().map(Judged::fact).collect::<Vec<_>>())?;
            print("")?;
        }
        print_facts(&facts)?;
        print(format_args!("\n{place}"))?;
    }
    if excess.is_empty() {
        Ok(())
    } else {
        Err(CliError::Verdict(excess.join("; ")))
    }
}

/// What the summary says: each number type, the formats, the limits that were asked for, and what is
/// above its bound or limit.
fn summary_keys(
    accuracies: &[Accuracy],
    analysis: &Analysis,
    judged: &[Judged],
    excess: &[String],
) -> Map<String, Value> {
    let mut summary: Map<String, Value> = accuracies
        .iter()
        .map(|a| (a.number.to_string(), Value::Object(entry(a))))
        .collect();
    summary.extend(export::object([
        ("formats", Value::Object(formats_json(analysis))),
        ("fixed_torque_error_bound_Nm", json!(analysis.torque_error)),
        ("fixed_run_error_bound_Nm", json!(analysis.run_error)),
    ]));
    if !judged.is_empty() {
        let list: Vec<Value> = judged.iter().map(Judged::json).collect();
        summary.insert("limits".into(), json!(list));
    }
    summary.extend(export::object([
        ("excess", json!(excess)),
        ("holds", json!(excess.is_empty())),
    ]));
    summary
}

impl AccuracyArgs {
    /// The limits, if any are asked for.
    fn limit_nm(&self) -> Result<Option<[f64; 2]>, CliError> {
        let [first, second] = self.limit[..] else {
            return Ok(None);
        };
        match first > 0.0 && second > 0.0 && first.max(second).is_finite() {
            true => Ok(Some([first, second])),
            false => Err(CliError::AccuracyLimit { first, second }),
        }
    }
}

/// A joint's largest torque error in closed loop, held against its limit.
struct Judged {
    number: &'static str,
    /// 1 or 2.
    joint: usize,
    limit_nm: f64,
    error_nm: f64,
}

/// Every number type's joints against their limits.
fn judge(accuracies: &[Accuracy], limit_nm: [f64; 2]) -> Vec<Judged> {
    let of = |a: &Accuracy, joint: usize| Judged {
        number: a.number,
        joint: joint + 1,
        limit_nm: limit_nm[joint],
        error_nm: a.closed_loop.joint_max_nm[joint],
    };
    let all = accuracies.iter();
    all.flat_map(|a| [0, 1].map(|joint| of(a, joint))).collect()
}

impl Judged {
    /// Not a number does not hold.
    fn holds(&self) -> bool {
        self.error_nm <= self.limit_nm
    }

    fn json(&self) -> Value {
        Value::Object(export::object([
            ("number", json!(self.number)),
            ("joint", json!(self.joint)),
            ("limit_Nm", json!(self.limit_nm)),
            ("torque_error_max_Nm", json!(self.error_nm)),
            ("holds", json!(self.holds())),
        ]))
    }

    fn fact(&self) -> (String, String) {
        let words = if self.holds() {
            "holds"
        } else {
            "does NOT hold"
        };
        (
            format!("{}, joint {}", self.number, self.joint),
            format!(
                "{words}: {:.1e} of {:.1e} N m",
                self.error_nm, self.limit_nm
            ),
        )
    }

    fn excess(&self) -> Option<String> {
        let Self { number, joint, .. } = self;
        (!self.holds()).then(|| {
            format!(
                "{number}, closed loop: torque {joint} is off by {:.1e} N m, --limit is {:.1e}",
                self.error_nm, self.limit_nm
            )
        })
    }
}

/// What `--json` says of a number type.
fn entry(a: &Accuracy) -> Map<String, Value> {
    let trial = |errors: &Errors| {
        Value::Object(export::object([
            ("torque_error_rms_Nm", json!(errors.rms_nm)),
            ("torque_error_max_Nm", json!(errors.max_nm)),
            ("joint_error_max_Nm", json!(errors.joint_max_nm)),
            ("joint_error_bound_Nm", json!(bounds(errors))),
            ("saturations", json!(errors.saturations)),
            ("parted_ticks", json!(errors.parted)),
            ("ticks", json!(errors.ticks)),
        ]))
    };
    export::object([
        ("torque_error_rms_Nm", json!(a.closed_loop.rms_nm)),
        ("torque_error_max_Nm", json!(a.closed_loop.max_nm)),
        ("joint_error_max_Nm", json!(a.closed_loop.joint_max_nm)),
        ("joint_error_bound_Nm", json!(bounds(&a.closed_loop))),
        ("force_difference_max_N", json!(a.force_difference_max_n)),
        ("saturations", json!(a.closed_loop.saturations)),
        ("effective_bits", json!(a.effective_bits)),
        ("random", trial(&a.random)),
        ("adversarial", trial(&a.adversarial)),
        ("adversarial_f64", trial(&a.adversarial_f64)),
    ])
}

/// What the joints' errors may be, N m, where there is a bound.
fn bounds(errors: &Errors) -> Option<[f64; 2]> {
    let bounds = errors.bound_nm;
    bounds
        .iter()
        .all(|bound| bound.is_finite())
        .then_some(bounds)
}

/// The results as a table for a terminal.
fn table(accuracies: &[Accuracy]) -> comfy_table::Table {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::ASCII_MARKDOWN);
    table.set_header([
        "number",
        "trial",
        "torque error rms, N m",
        "max, N m",
        "joints, N m",
        "bounds, N m",
        "saturations",
        "ticks",
    ]);
    for a in accuracies {
        let pair = |[first, second]: [f64; 2]| format!("{first:.1e}, {second:.1e}");
        for (trial, errors) in a.trials() {
            table.add_row([
                a.number.to_string(),
                trial.to_string(),
                format!("{:.2e}", errors.rms_nm),
                format!("{:.2e}", errors.max_nm),
                pair(errors.joint_max_nm),
                bounds(errors).map_or_else(String::new, pair),
                errors.saturations.to_string(),
                errors.ticks.to_string(),
            ]);
        }
    }
    table
}

/// Ranges and formats for `--json`.
fn formats_json(analysis: &Analysis) -> Map<String, Value> {
    let signal = |s: &range::Signal| {
        Value::Object(export::object([
            ("unit", json!(s.unit)),
            ("admissible", json!(s.admissible)),
            ("range", json!(s.exponent.range())),
            ("resolution", json!(s.exponent.unit())),
        ]))
    };
    let entries = analysis.signals.iter();
    entries.map(|s| (s.name.to_string(), signal(s))).collect()
}

/// Ranges and formats for a reader.
pub(super) fn format_facts(analysis: &Analysis) -> Vec<(String, String)> {
    let mut facts: Vec<_> = analysis
        .signals
        .iter()
        .map(|s| {
            (
                format!("fixed point: {}", s.name),
                format!(
                    "up to {:.4} {unit}; format to {} {unit} in steps of {:.1e}",
                    s.admissible,
                    four_digits(s.exponent.range()),
                    s.exponent.unit(),
                    unit = s.unit
                ),
            )
        })
        .collect();
    let [first, second] = analysis.torque_error;
    facts.push((
        "fixed point: error bound".into(),
        format!("{first:.1e} and {second:.1e} N m a tick"),
    ));
    let [first, second] = analysis.run_error;
    facts.push((
        "fixed point: bound of a run".into(),
        format!("{first:.1e} and {second:.1e} N m"),
    ));
    facts
}

/// Torque errors in closed loop, one row a tick.
fn trace_csv(accuracies: &[Accuracy], writer: impl std::io::Write) -> std::io::Result<()> {
    let mut csv = csv::Writer::from_writer(writer);
    let mut header = vec!["t_s".to_string()];
    for a in accuracies {
        header.extend([1, 2].map(|joint| format!("{}_tau{joint}_error_Nm", a.number)));
    }
    csv.write_record(&header)?;
    let ticks = accuracies.iter().map(|a| a.trace.len()).min().unwrap_or(0);
    for tick in 0..ticks {
        let mut row = vec![accuracies[0].trace[tick].0.to_string()];
        for a in accuracies {
            row.extend(a.trace[tick].1.map(|error| error.to_string()));
        }
        csv.write_record(&row)?;
    }
    csv.flush()
}
