//! The report of the number types' accuracy: figures as SVG files and a page.

use super::figures::{accuracy_figures, number};
use super::{ReportError, page};
use crate::analysis::fixed_point::accuracy::{Accuracy, Errors};
use minijinja::context;
use serde::Serialize;
use std::path::Path;

/// A row of the table of results.
#[derive(Serialize)]
struct Row {
    number: &'static str,
    trial: &'static str,
    values: [String; 6],
}

/// Writes `accuracy_time.svg` and `accuracy_histogram.svg` into `folder`, and to `file`
/// the page with them, a table and the `notes`, pairs of a name and a fact.
///
/// # Errors
/// [`ReportError`].
pub fn write_accuracy(
    folder: &Path,
    file: &Path,
    accuracies: &[Accuracy],
    notes: &[(String, String)],
) -> Result<(), ReportError> {
    let figures = accuracy_figures(accuracies)?;
    page::write_svgs(folder, &figures)?;
    let values = context! {
        title => "Flexor: accuracy of the number types against f64",
        rows => accuracies.iter().flat_map(rows).collect::<Vec<Row>>(),
        figures => page::embedded(figures),
        notes,
    };
    page::write(file, "accuracy.html", &values)
}

/// A number type's rows of the table.
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
