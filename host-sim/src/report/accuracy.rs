//! The report of the number types' accuracy: figures as SVG files and a page.

use super::figures::{accuracy_figures, number};
use super::{ReportError, write_file};
use crate::analysis::fixed_point::accuracy::{Accuracy, Errors};
use minijinja::{Environment, Value, context};
use serde::Serialize;
use std::path::Path;

/// The page's template; it escapes all text by itself.
const TEMPLATE: &str = include_str!("accuracy.html");

/// A row of the table of results.
#[derive(Serialize)]
struct Row {
    number: &'static str,
    trial: &'static str,
    values: [String; 6],
}

/// Writes `accuracy_time.svg` and `accuracy_histogram.svg` into `folder`, and the page
/// with them, a table and the `notes`, pairs of a name and a fact.
///
/// # Errors
/// [`ReportError`].
pub fn write_accuracy(
    folder: &Path,
    page: &Path,
    accuracies: &[Accuracy],
    notes: &[(String, String)],
) -> Result<(), ReportError> {
    let figures = accuracy_figures(accuracies)?;
    for figure in &figures {
        write_file(&folder.join(format!("{}.svg", figure.name)), &figure.svg)?;
    }
    let figures: Vec<Value> = figures
        .into_iter()
        .map(|figure| {
            // In HTML the elements need no name space, and so the page no address.
            let svg = figure
                .svg
                .replacen(r#" xmlns="http://www.w3.org/2000/svg""#, "", 1);
            context! {
                name => figure.name,
                caption => figure.caption,
                svg => Value::from_safe_string(svg),
            }
        })
        .collect();
    let rows: Vec<Row> = accuracies.iter().flat_map(rows).collect();
    let failed = |error: minijinja::Error| ReportError::Page {
        path: page.to_path_buf(),
        reason: error.to_string(),
    };
    let mut environment = Environment::new();
    // The name's ending turns escaping on.
    environment
        .add_template("accuracy.html", TEMPLATE)
        .map_err(failed)?;
    let text = environment
        .get_template("accuracy.html")
        .and_then(|template| template.render(context! { rows, notes, figures }))
        .map_err(failed)?;
    write_file(page, &text)
}

fn rows(a: &Accuracy) -> [Row; 4] {
    let row = |trial, errors: &Errors, closed: bool| {
        let only = |value| if closed { number(value) } else { String::new() };
        Row {
            number: a.number,
            trial,
            values: [
                number(errors.rms_nm),
                number(errors.max_nm),
                only(a.force_difference_max_n),
                only(a.effective_bits),
                errors.saturations.to_string(),
                errors.ticks.to_string(),
            ],
        }
    };
    [
        row("closed loop", &a.closed_loop, true),
        row("random", &a.random, false),
        row("adversarial", &a.adversarial, false),
        row("the same, f64", &a.adversarial_f64, false),
    ]
}
