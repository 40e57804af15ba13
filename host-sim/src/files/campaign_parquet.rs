//! The runs of a campaign as Parquet, with the columns of the CSV: what pandas, Polars and others
//! read without parsing numbers.
//!
//! One row group, not compressed: drawn values and figures have random last digits.

use super::campaign_rows::columns;
use crate::campaign::record::{CampaignRecords, RunFigures, RunRecord};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{
    BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type, Int64Type,
};
use parquet::errors::Result;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use std::io::{self, Write};
use std::sync::Arc;

/// The schema: 64-bit unsigned numbers, doubles, a text, a truth value and a 32-bit unsigned
/// number, none of which may be missing.
fn schema(parameters: &[String]) -> Result<Type> {
    let unsigned = |bits| Some(LogicalType::integer(bits, false));
    let names = columns(parameters);
    let last = names.len() - 1;
    let ending = 2 + parameters.len();
    let fields = names.iter().enumerate().map(|(place, name)| {
        let (physical, logical) = match place {
            0 | 1 => (Physical::INT64, unsigned(64)),
            place if place == ending => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            place if place == ending + 1 => (Physical::BOOLEAN, None),
            place if place == last => (Physical::INT32, unsigned(32)),
            _ => (Physical::DOUBLE, None),
        };
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    });
    Type::group_type_builder("run")
        .with_fields(fields.collect::<Result<_>>()?)
        .build()
}

/// Writes the next column.
pub(super) fn put<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, impl Write + Send>,
    values: impl Iterator<Item = T::T>,
) -> Result<()> {
    let values: Vec<T::T> = values.collect();
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(&values, None, None)?;
        column.close()?;
    }
    Ok(())
}

/// Writes all runs.
///
/// # Errors
/// The writer's.
pub fn rows_parquet(records: &CampaignRecords, writer: impl Write + Send) -> io::Result<()> {
    write(records, writer).map_err(io::Error::other)
}

fn write(records: &CampaignRecords, writer: impl Write + Send) -> Result<()> {
    let schema = Arc::new(schema(&records.parameters)?);
    let mut file = SerializedFileWriter::new(writer, schema, Arc::default())?;
    let mut group = file.next_row_group()?;
    let runs = || records.runs.iter();
    let figures = || runs().map(|run: &RunRecord| &run.figures);
    // The format has signed numbers, of which the schema says that they are not.
    put::<Int64Type>(&mut group, runs().map(|run| run.run.cast_signed()))?;
    put::<Int64Type>(&mut group, runs().map(|run| run.seed.cast_signed()))?;
    for parameter in 0..records.parameters.len() {
        put::<DoubleType>(&mut group, runs().map(|run| run.drawn[parameter]))?;
    }
    put::<ByteArrayType>(
        &mut group,
        figures().map(|f| ByteArray::from(f.outcome.name())),
    )?;
    put::<BoolType>(&mut group, figures().map(|f| f.outcome.failed()))?;
    for (_, value) in RunFigures::COLUMNS {
        put::<DoubleType>(&mut group, figures().map(value))?;
    }
    put::<Int32Type>(&mut group, figures().map(|f| f.limited_ticks.cast_signed()))?;
    group.close()?;
    file.close()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::record::FIGURES;
    use crate::campaign::record::RunOutcome;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    fn records() -> CampaignRecords {
        let run = |run, outcome, value: f64| RunRecord {
            run,
            seed: u64::MAX - run,
            drawn: vec![value, -value],
            figures: RunFigures::from_columns(
                outcome,
                std::array::from_fn(|i| value * i as f64),
                u32::MAX,
            ),
        };
        CampaignRecords {
            parameters: vec!["arm.link1.mass_kg".into(), "contact.damping_Ns_m".into()],
            runs: vec![
                run(0, RunOutcome::Completed, 0.1),
                run(1, RunOutcome::Diverged, f64::NAN),
                run(9, RunOutcome::ForceOff, 1e300),
            ],
        }
    }

    #[test]
    fn another_reader_finds_every_value_in_its_column() {
        let records = records();
        let mut bytes = vec![];
        rows_parquet(&records, &mut bytes).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        let rows = reader.get_row_iter(None).unwrap();
        let mut count = 0;
        for (row, record) in rows.zip(&records.runs) {
            count += 1;
            let row = row.unwrap();
            let cells: Vec<(&String, &Field)> = row.get_column_iter().collect();
            let names: Vec<&String> = cells.iter().map(|(name, _)| *name).collect();
            assert_eq!(
                names,
                columns(&records.parameters).iter().collect::<Vec<_>>()
            );
            let double = |value: f64, field: &Field| match field {
                Field::Double(found) => found.to_bits() == value.to_bits(),
                _ => false,
            };
            assert_eq!(cells[0].1, &Field::ULong(record.run));
            assert_eq!(cells[1].1, &Field::ULong(record.seed));
            assert!(double(record.drawn[0], cells[2].1) && double(record.drawn[1], cells[3].1));
            let outcome = record.figures.outcome;
            assert_eq!(cells[4].1, &Field::Str(outcome.name().into()));
            assert_eq!(cells[5].1, &Field::Bool(outcome.failed()));
            for ((_, value), (_, field)) in RunFigures::COLUMNS.iter().zip(&cells[6..]) {
                assert!(double(value(&record.figures), field), "{field}");
            }
            assert_eq!(
                cells[6 + FIGURES].1,
                &Field::UInt(record.figures.limited_ticks)
            );
        }
        assert_eq!(count, 3);
    }

    #[test]
    fn a_campaign_without_runs_is_a_file_too() {
        let mut bytes = vec![];
        rows_parquet(&CampaignRecords::default(), &mut bytes).unwrap();
        let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
        assert_eq!(reader.metadata().file_metadata().num_rows(), 0);
    }
}
