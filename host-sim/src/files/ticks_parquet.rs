//! Every tick of a run on the bench as Parquet, with the columns of its CSV: for runs by the
//! thousand, of which a CSV would be ten times as large.
//!
//! Time is a double; all else has single precision, more than any sensor has. Numbers stand one
//! after the other, without dictionaries and statistics: writing them then takes a fraction of the
//! run's own time.

use super::campaign_parquet::put;
use super::export::{bench_columns, bench_values};
use crate::simulation::bench::BenchRow;
use parquet::basic::{Compression, Encoding, Repetition, Type as Physical};
use parquet::data_type::{DoubleType, FloatType};
use parquet::errors::Result;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::io::{self, Write};
use std::sync::Arc;

/// Writes the ticks of a run.
///
/// # Errors
/// The writer's.
pub fn ticks_parquet(rows: &[BenchRow], writer: impl Write + Send) -> io::Result<()> {
    write(rows, writer).map_err(io::Error::other)
}

fn write(rows: &[BenchRow], writer: impl Write + Send) -> Result<()> {
    let fields = bench_columns().enumerate().map(|(place, name)| {
        let physical = if place == 0 {
            Physical::DOUBLE
        } else {
            Physical::FLOAT
        };
        Type::primitive_type_builder(name, physical)
            .with_repetition(Repetition::REQUIRED)
            .build()
            .map(Arc::new)
    });
    let schema = Type::group_type_builder("tick")
        .with_fields(fields.collect::<Result<_>>()?)
        .build()?;
    let values: Vec<_> = rows.iter().map(bench_values).collect();
    let plain = WriterProperties::builder()
        .set_dictionary_enabled(false)
        .set_encoding(Encoding::BYTE_STREAM_SPLIT)
        .set_compression(Compression::SNAPPY)
        .set_statistics_enabled(EnabledStatistics::None)
        .build();
    let mut file = SerializedFileWriter::new(writer, Arc::new(schema), Arc::new(plain))?;
    let mut group = file.next_row_group()?;
    for place in 0..bench_columns().count() {
        let column = values.iter().map(|row| row[place]);
        if place == 0 {
            put::<DoubleType>(&mut group, column)?;
        } else {
            put::<FloatType>(&mut group, column.map(|value| value as f32))?;
        }
    }
    group.close()?;
    file.close()?;
    Ok(())
}
