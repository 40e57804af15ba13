//! The runs of a campaign as CSV, one row a run: written as they end, read back bit by bit.
//!
//! Columns: `run`, `seed`, every drawn parameter by its dotted key, `outcome`, `failed`, the
//! figures with their units, `limited_ticks`. Numbers have the fewest digits that tell them from
//! their neighbours.

use crate::campaign::record::{CampaignRecords, RunFigures, RunOutcome, RunRecord};
use crate::text::{Shortest, one_line};
use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;
use std::str::FromStr;

/// Columns before the parameters.
const HEAD: [&str; 2] = ["run", "seed"];

/// Columns between the parameters and the figures.
const ENDING: [&str; 2] = ["outcome", "failed"];

/// The last column.
const LAST: &str = "limited_ticks";

/// Columns that every campaign has.
const FIXED: usize = HEAD.len() + ENDING.len() + RunFigures::COLUMNS.len() + 1;

/// The names of the columns, in order.
pub fn columns(parameters: &[String]) -> Vec<String> {
    let figures = RunFigures::COLUMNS.map(|(name, _)| name);
    let own = |names: &[&str]| -> Vec<String> { names.iter().map(ToString::to_string).collect() };
    [
        own(&HEAD),
        parameters.to_vec(),
        own(&ENDING),
        own(&figures),
        own(&[LAST]),
    ]
    .concat()
}

/// Writes runs one by one.
#[derive(Debug)]
pub struct RowWriter<W: Write>(csv::Writer<W>);

impl<W: Write> RowWriter<W> {
    /// A writer of a new file, which begins with the names of the columns.
    ///
    /// # Errors
    /// The writer's.
    pub fn new(writer: W, parameters: &[String]) -> io::Result<Self> {
        let mut rows = Self::resumed(writer);
        rows.0.write_record(columns(parameters))?;
        Ok(rows)
    }

    /// A writer at the end of a file that has the names of the columns, and whole rows.
    pub fn resumed(writer: W) -> Self {
        Self(csv::Writer::from_writer(writer))
    }

    /// Adds a run.
    ///
    /// # Errors
    /// The writer's.
    pub fn write(&mut self, record: &RunRecord) -> io::Result<()> {
        let RunRecord {
            run,
            seed,
            drawn,
            figures,
        } = record;
        let number = |value: f64| Shortest(value).to_string();
        let mut row = vec![run.to_string(), seed.to_string()];
        row.extend(drawn.iter().copied().map(number));
        row.push(figures.outcome.name().into());
        row.push(figures.outcome.failed().to_string());
        row.extend(RunFigures::COLUMNS.map(|(_, value)| number(value(figures))));
        row.push(figures.limited_ticks.to_string());
        Ok(self.0.write_record(&row)?)
    }

    /// Hands all rows to the writer below, and flushes it.
    ///
    /// # Errors
    /// The writer's.
    pub fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Writes all runs.
///
/// # Errors
/// The writer's.
pub fn rows_csv(records: &CampaignRecords, writer: impl Write) -> io::Result<()> {
    let mut rows = RowWriter::new(writer, &records.parameters)?;
    records.runs.iter().try_for_each(|run| rows.write(run))?;
    rows.flush()
}

/// What is wrong with a file of runs.
#[derive(Debug, thiserror::Error)]
pub enum RowsError {
    /// It cannot be read.
    #[error("{file}: cannot be read: {cause}")]
    Unreadable {
        /// The file.
        file: String,
        /// Why.
        cause: io::Error,
    },
    /// The first line does not name the columns of a campaign's runs.
    #[error("{file}: line 1, column {column} is {found:?}; accepted: {expected}")]
    Header {
        /// The file.
        file: String,
        /// The column's number, from 1.
        column: usize,
        /// Its name.
        found: String,
        /// The name that it should have.
        expected: String,
    },
    /// A row has too few or too many cells.
    #[error("{file}: line {line} has {found} columns; accepted: {expected}, as line 1 has")]
    Cells {
        /// The file.
        file: String,
        /// The line's number, from 1.
        line: u64,
        /// How many it has.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A cell's text is not what its column has.
    #[error("{file}: line {line}, column {column} = {text:?}; accepted: {accepted}")]
    Value {
        /// The file.
        file: String,
        /// The line's number, from 1.
        line: u64,
        /// The column's name.
        column: String,
        /// The text.
        text: String,
        /// What would be right.
        accepted: String,
    },
}

/// What a file that may have been cut off holds.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeRows {
    /// Its whole rows.
    pub records: CampaignRecords,
    /// Length of the file up to the last whole row's end, in bytes, from which it can be
    /// continued by [`RowWriter::resumed`]; 0 where not even the names of the columns are whole.
    pub bytes: u64,
}

/// Reads a whole file of runs; they may stand in any order.
///
/// # Errors
/// [`RowsError`]: one line that names the file, the line and the column.
pub fn read_rows(file: &Path) -> Result<CampaignRecords, RowsError> {
    let name = file.display().to_string();
    match std::fs::read_to_string(file) {
        Ok(text) => parse_rows(&name, &text),
        Err(cause) => Err(RowsError::Unreadable { file: name, cause }),
    }
}

/// Reads a file of runs whose writer may have been killed: what follows the last line's end is
/// left out.
///
/// # Errors
/// [`RowsError`], on any other line.
pub fn read_rows_lenient(file: &Path) -> Result<WholeRows, RowsError> {
    let name = file.display().to_string();
    let unreadable = |cause| RowsError::Unreadable {
        file: name.clone(),
        cause,
    };
    let mut bytes = std::fs::read(file).map_err(unreadable)?;
    bytes.truncate(
        bytes
            .iter()
            .rposition(|byte| *byte == b'\n')
            .map_or(0, |at| at + 1),
    );
    let whole = bytes.len() as u64;
    let records = if bytes.is_empty() {
        CampaignRecords::default()
    } else {
        let invalid = |cause| io::Error::new(io::ErrorKind::InvalidData, cause);
        let text = String::from_utf8(bytes)
            .map_err(invalid)
            .map_err(unreadable)?;
        parse_rows(&name, &text)?
    };
    Ok(WholeRows {
        records,
        bytes: whole,
    })
}

/// Reads the text of a file of runs; `file` is its name for messages.
///
/// # Errors
/// [`RowsError`].
pub fn parse_rows(file: &str, text: &str) -> Result<CampaignRecords, RowsError> {
    let unreadable = |error: csv::Error| RowsError::Unreadable {
        file: file.into(),
        cause: error.into(),
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(text.as_bytes());
    let mut lines = reader.records();
    let header = lines.next().transpose().map_err(unreadable)?;
    let header: Vec<String> = header.iter().flatten().map(Into::into).collect();
    let parameters = parameters_of(file, &header)?;
    let mut seen = BTreeSet::new();
    let mut runs = vec![];
    for record in lines {
        let record = record.map_err(unreadable)?;
        let row = Row {
            file,
            line: record.position().map_or(0, csv::Position::line),
            header: &header,
            cells: record.iter().collect(),
        };
        let run = row.record(parameters.len())?;
        if !seen.insert(run.run) {
            return Err(row.error(0, "every run once".into()));
        }
        runs.push(run);
    }
    runs.sort_by_key(|record| record.run);
    Ok(CampaignRecords { parameters, runs })
}

/// The parameters among the names of the columns.
fn parameters_of(file: &str, header: &[String]) -> Result<Vec<String>, RowsError> {
    let count = header.len().saturating_sub(FIXED);
    let parameters: Vec<String> = header
        .iter()
        .skip(HEAD.len())
        .take(count)
        .cloned()
        .collect();
    let expected = columns(&parameters);
    let off = (0..expected.len()).find(|i| header.get(*i) != Some(&expected[*i]));
    match off {
        None => Ok(parameters),
        Some(i) => Err(RowsError::Header {
            file: file.into(),
            column: i + 1,
            found: one_line(header.get(i).map_or("", String::as_str), 40),
            expected: expected[i].clone(),
        }),
    }
}

/// A line of the file.
struct Row<'a> {
    file: &'a str,
    line: u64,
    header: &'a [String],
    cells: Vec<&'a str>,
}

impl Row<'_> {
    /// The cell in this column is not what is accepted.
    fn error(&self, column: usize, accepted: String) -> RowsError {
        RowsError::Value {
            file: self.file.into(),
            line: self.line,
            column: self.header[column].clone(),
            text: one_line(self.cells[column], 40),
            accepted,
        }
    }

    fn parse<T: FromStr>(&self, column: usize, accepted: &str) -> Result<T, RowsError> {
        let cell = self.cells[column].parse();
        cell.map_err(|_| self.error(column, accepted.into()))
    }

    /// The run, with so many parameters.
    fn record(&self, parameters: usize) -> Result<RunRecord, RowsError> {
        if self.cells.len() != self.header.len() {
            return Err(RowsError::Cells {
                file: self.file.into(),
                line: self.line,
                found: self.cells.len(),
                expected: self.header.len(),
            });
        }
        let whole = "a whole number from 0 on";
        let number = |column| self.parse(column, "a number");
        let ending = HEAD.len() + parameters;
        let outcome = RunOutcome::from_name(self.cells[ending])
            .ok_or_else(|| self.error(ending, "completed, or how a run failed".into()))?;
        let failed: bool = self.parse(ending + 1, "true or false")?;
        if failed != outcome.failed() {
            let accepted = format!("{}, as the outcome is {}", !failed, outcome.name());
            return Err(self.error(ending + 1, accepted));
        }
        let figures = ending + ENDING.len();
        let mut values = [0.0; RunFigures::COLUMNS.len()];
        for (i, value) in values.iter_mut().enumerate() {
            *value = number(figures + i)?;
        }
        let limited_ticks = self.parse(figures + values.len(), whole)?;
        Ok(RunRecord {
            run: self.parse(0, whole)?,
            seed: self.parse(1, whole)?,
            drawn: (HEAD.len()..ending).map(number).collect::<Result<_, _>>()?,
            figures: RunFigures::from_columns(outcome, values, limited_ticks),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::FIGURES;
    use flexor::fault::Fault;
    use proptest::prelude::*;

    fn csv_of(records: &CampaignRecords) -> String {
        let mut text = vec![];
        rows_csv(records, &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    /// The values with their bits, which NaN has, too.
    fn bits(records: &CampaignRecords) -> Vec<Vec<u64>> {
        let of = |record: &RunRecord| {
            let figures = RunFigures::COLUMNS.map(|(_, value)| value(&record.figures).to_bits());
            let drawn = record.drawn.iter().map(|value| value.to_bits());
            let own = [record.run, record.seed, record.figures.limited_ticks.into()];
            drawn.chain(figures).chain(own).collect()
        };
        records.runs.iter().map(of).collect()
    }

    fn example() -> CampaignRecords {
        let run = |run, outcome, value: f64| RunRecord {
            run,
            seed: u64::MAX - run,
            drawn: vec![value, -1.0 / value],
            figures: RunFigures::from_columns(outcome, [value; FIGURES], 3),
        };
        CampaignRecords {
            parameters: vec!["arm.\"a, b\"".into(), "contact.stiffness_N_m".into()],
            runs: vec![
                run(2, RunOutcome::Completed, 0.1),
                run(5, RunOutcome::Diverged, f64::NAN),
                run(7, RunOutcome::Fault(Fault::SensorRange), f64::INFINITY),
            ],
        }
    }

    proptest! {
        #[test]
        fn runs_come_back_bit_by_bit(
            runs in prop::collection::vec((any::<u64>(), any::<[f64; FIGURES]>(), 0..4_usize), 0..20),
        ) {
            let outcomes = [
                RunOutcome::Completed,
                RunOutcome::TipOffPath,
                RunOutcome::ForceOff,
                RunOutcome::Fault(Fault::TickOverrun),
            ];
            // One NaN only has a text.
            let plain = |x: f64| if x.is_nan() { f64::NAN } else { x };
            let runs = (0..).zip(runs).map(|(run, (seed, values, outcome))| RunRecord {
                run,
                seed,
                drawn: values.iter().rev().copied().map(plain).collect(),
                figures: RunFigures::from_columns(outcomes[outcome], values.map(plain), seed as u32),
            });
            let records = CampaignRecords {
                parameters: (0..FIGURES).map(|i| format!("p.{i}")).collect(),
                runs: runs.collect(),
            };
            let back = parse_rows("runs.csv", &csv_of(&records)).unwrap();
            prop_assert_eq!(&back.parameters, &records.parameters);
            prop_assert_eq!(bits(&back), bits(&records));
            let outcomes = |r: &CampaignRecords| -> Vec<RunOutcome> {
                r.runs.iter().map(|run| run.figures.outcome).collect()
            };
            prop_assert_eq!(outcomes(&back), outcomes(&records));
        }
    }

    #[test]
    fn a_row_names_its_columns_and_units() {
        let text = csv_of(&example());
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "run,seed,\"arm.\"\"a, b\"\"\",contact.stiffness_N_m,outcome,failed,\
             force_error_rms_N,force_error_max_N,along_error_rms_m,along_error_max_m,\
             contact_lost_s,contact_lost_longest_s,force_max_N,torque1_max_Nm,torque2_max_Nm,\
             ended_s,approach_force_max_N,touched_s,begun_s,before_losses,after_force_max_N,\
             after_way_m,after_speed_m_s,parked_off_m,limited_ticks"
        );
        assert_eq!(
            lines[1],
            "2,18446744073709551613,0.1,-10,completed,false,\
             0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,0.1,3"
        );
        assert!(lines[3].contains(",sensor_range,true,inf,"), "{}", lines[3]);
    }

    #[test]
    fn rows_in_any_order_are_read_sorted() {
        let text = csv_of(&example());
        let mut lines: Vec<&str> = text.lines().collect();
        lines[1..].reverse();
        let back = parse_rows("f", &lines.join("\n")).unwrap();
        assert_eq!(bits(&back), bits(&example()));
    }

    #[test]
    fn errors_name_line_and_column() {
        let text = csv_of(&example());
        let refused = |from: &str, to: &str| {
            let changed = text.replacen(from, to, 1);
            assert_ne!(changed, text, "{from}");
            let error = parse_rows("out/runs.csv", &changed)
                .unwrap_err()
                .to_string();
            assert!(!error.contains('\n'), "{error}");
            error
        };
        assert_eq!(
            refused("\n5,", "\n5x,"),
            "out/runs.csv: line 3, column run = \"5x\"; accepted: a whole number from 0 on"
        );
        assert_eq!(
            refused(",-10,", ",ten,"),
            "out/runs.csv: line 2, column contact.stiffness_N_m = \"ten\"; accepted: a number"
        );
        assert_eq!(
            refused("diverged", "exploded"),
            "out/runs.csv: line 3, column outcome = \"exploded\"; accepted: completed, or how a run failed"
        );
        assert_eq!(
            refused("diverged,true", "diverged,false"),
            "out/runs.csv: line 3, column failed = \"false\"; accepted: true, as the outcome is diverged"
        );
        assert_eq!(
            refused("\n7,", "\n5,"),
            "out/runs.csv: line 4, column run = \"5\"; accepted: every run once"
        );
        assert_eq!(
            refused("completed,", ""),
            "out/runs.csv: line 2 has 24 columns; accepted: 25, as line 1 has"
        );
        assert_eq!(
            refused("force_max_N", "force_max"),
            "out/runs.csv: line 1, column 13 is \"force_max\"; accepted: force_max_N"
        );
        assert_eq!(
            refused(&text, ""),
            "out/runs.csv: line 1, column 1 is \"\"; accepted: run"
        );
    }

    #[test]
    fn a_file_that_was_cut_off_anywhere_can_be_continued() {
        let records = example();
        let text = csv_of(&records);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("runs.csv");
        for cut in 0..=text.len() {
            std::fs::write(&file, &text[..cut]).unwrap();
            let whole = read_rows_lenient(&file).unwrap();
            let kept = &text[..whole.bytes as usize];
            let lines = text[..cut].matches('\n').count();
            assert_eq!(whole.records.runs.len(), lines.saturating_sub(1), "{cut}");
            // The missing runs are written behind what is whole.
            let mut again = kept.as_bytes().to_vec();
            let mut rows = match whole.bytes {
                0 => RowWriter::new(&mut again, &records.parameters).unwrap(),
                _ => RowWriter::resumed(&mut again),
            };
            for run in &records.runs[whole.records.runs.len()..] {
                rows.write(run).unwrap();
            }
            rows.flush().unwrap();
            drop(rows);
            assert_eq!(again, text.as_bytes(), "{cut}");
        }
        // Nothing else is let through.
        std::fs::write(&file, text.replacen("0.1", "O.1", 1)).unwrap();
        assert!(read_rows_lenient(&file).is_err());
        assert!(read_rows(&file).is_err());
        let missing = read_rows(&folder.path().join("no.csv"))
            .unwrap_err()
            .to_string();
        assert!(missing.contains("no.csv: cannot be read: "), "{missing}");
    }
}
