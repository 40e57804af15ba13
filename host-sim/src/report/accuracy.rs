//! The page of the number types' accuracy, and its figures as SVG files.

use super::figures::{accuracy_figures, number};
use super::page::{Explored, Verdict};
use super::series::Panel;
use super::{ReportError, page};
use crate::analysis::fixed_point::accuracy::{Accuracy, Errors};
use minijinja::context;
use serde::Serialize;
use std::path::Path;

/// What the page on accuracy shows.
#[derive(Clone, Copy, Debug)]
pub struct AccuracyPage<'a> {
    /// The number types.
    pub accuracies: &'a [Accuracy],
    /// Whether they are as exact as is asked for.
    pub verdict: &'a Verdict,
    /// What was asked for of each joint's torque in closed loop, N m, if anything.
    pub limit_nm: Option<[f64; 2]>,
    /// Names and facts.
    pub notes: &'a [(String, String)],
    /// What it was made from: names and facts.
    pub provenance: &'a [(String, String)],
}

/// A row of the table of results: a joint in a trial.
#[derive(Serialize)]
struct Row {
    number: &'static str,
    trial: &'static str,
    joint: usize,
    largest: String,
    bound: String,
    /// Nothing where there is no bound.
    holds: Option<bool>,
    saturations: u32,
    ticks: usize,
}

/// A row of the table of the closed loop.
#[derive(Serialize)]
struct Whole {
    number: &'static str,
    values: [String; 4],
}

/// Writes `accuracy_time.svg` and `accuracy_histogram.svg` into `dir`, and report.html with them, the
/// verdict, tables and charts. All text is escaped, and the page needs nothing but itself.
///
/// # Errors
/// [`ReportError`].
pub fn write_accuracy(dir: &Path, content: &AccuracyPage<'_>) -> Result<(), ReportError> {
    let accuracies = content.accuracies;
    let mut figures = accuracy_figures(accuracies)?;
    page::write_svgs(dir, &figures)?;
    // The charts show the first one as well.
    let histogram = figures.split_off(1);
    let values = context! {
        title => "Flexor: accuracy of the number types against f64",
        verdict => content.verdict,
        limits => content.limit_nm.map(|limit| limits(accuracies, limit)),
        rows => accuracies.iter().flat_map(rows).collect::<Vec<Row>>(),
        wholes => accuracies.iter().map(whole).collect::<Vec<Whole>>(),
        figures => page::embedded(histogram),
        stills => page::embedded(figures),
        notes => content.notes,
        provenance => content.provenance,
    };
    let explored = [explored(accuracies)];
    page::write(
        &dir.join("report.html"),
        "accuracy.html",
        values,
        Some((&explored, 0)),
    )
}

/// A number type's rows: a joint in a trial each.
fn rows(a: &Accuracy) -> Vec<Row> {
    let row = |trial, errors: &Errors, joint: usize| {
        let (largest, bound) = (errors.joint_max_nm[joint], errors.bound_nm[joint]);
        Row {
            number: a.number,
            trial,
            joint: joint + 1,
            largest: number(largest),
            bound: match bound.is_finite() {
                true => number(bound),
                false => String::new(),
            },
            holds: bound.is_finite().then_some(largest <= bound),
            saturations: errors.saturations,
            ticks: errors.ticks,
        }
    };
    let trials = a.trials().into_iter();
    trials
        .flat_map(|(trial, errors)| [0, 1].map(|joint| row(trial, errors, joint)))
        .collect()
}

fn whole(a: &Accuracy) -> Whole {
    Whole {
        number: a.number,
        values: [
            a.closed_loop.rms_nm,
            a.closed_loop.max_nm,
            a.force_difference_max_n,
            a.effective_bits,
        ]
        .map(number),
    }
}

/// Rows of the table of what was asked for: number type, joint, limit, error, whether it holds.
fn limits(
    accuracies: &[Accuracy],
    limit_nm: [f64; 2],
) -> Vec<(&'static str, usize, String, String, bool)> {
    let row = |a: &Accuracy, joint: usize| {
        let (is, limit) = (a.closed_loop.joint_max_nm[joint], limit_nm[joint]);
        (a.number, joint + 1, number(limit), number(is), is <= limit)
    };
    let all = accuracies.iter();
    all.flat_map(|a| [0, 1].map(|joint| row(a, joint)))
        .collect()
}

/// The torque errors in closed loop.
fn explored(accuracies: &[Accuracy]) -> Explored {
    let styles = ["0", "1"];
    let panels = [0, 1].map(|joint| {
        let title = ["torque 1 error", "torque 2 error"][joint];
        let panel = Panel::new(title, "\u{b5}N m", 0.01, [-1000.0, 1000.0]);
        let types = accuracies.iter().zip(styles);
        types.fold(panel, |panel, (a, style)| {
            let step = match a.trace[..] {
                [(first, _), (second, _), ..] => second - first,
                _ => 1.0,
            };
            let points = a.trace.iter().map(|(t, e)| [*t, 1e6 * e[joint]]);
            panel.with(a.number, style, step, points)
        })
    });
    Explored {
        name: "closed loop".into(),
        motion: None,
        panels: panels.into(),
    }
}
