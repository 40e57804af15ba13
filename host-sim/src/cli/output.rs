//! What commands print: facts and tables to standard output, warnings and progress to standard
//! error. Files are `folder.rs`'s.

use super::CliError;
use crate::simulation::closed_loop::Run;
use crate::text::three_digits;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{self, Write};

/// Prints a line to standard output.
pub(super) fn print(text: impl std::fmt::Display) -> Result<(), CliError> {
    writeln!(io::stdout(), "{text}").map_err(CliError::Stdout)
}

/// Writes a line to standard error; if nobody is there to read it, that is no failure.
pub(super) fn say(line: impl std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// A progress bar on standard error, where that is a terminal; `words` follow its numbers.
pub(super) fn progress_bar(length: u64, words: &str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template(&format!("{{bar:30}} {{pos}}/{{len}} {words}"))
    {
        bar.set_style(style);
    }
    bar
}

/// Prints names and facts in two columns.
pub(super) fn print_facts(facts: &[(String, String)]) -> Result<(), CliError> {
    let width = facts.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    facts
        .iter()
        .try_for_each(|(name, fact)| print(format_args!("{name:width$}  {fact}")))
}

/// The table of results: errors of contact force and tip position.
pub(super) fn results<'a>(
    runs: impl IntoIterator<Item = (&'a str, &'a str, &'a Run)>,
) -> comfy_table::Table {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::ASCII_MARKDOWN);
    table.set_header([
        "case",
        "plant",
        "force rms, N",
        "max, N",
        "tip rms, mm",
        "max, mm",
        "outcome",
    ]);
    for (case, plant, run) in runs {
        let s = &run.summary;
        let numbers = [
            s.force_error_rms,
            s.force_error_max,
            1e3 * s.tip_error_rms,
            1e3 * s.tip_error_max,
        ];
        let mut row = vec![case.to_string(), plant.to_string()];
        row.extend(numbers.map(three_digits));
        row.push(s.outcome.name().to_string());
        table.add_row(row);
    }
    for column in 2..6 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(comfy_table::CellAlignment::Right);
        }
    }
    table
}
