//! Parquet.

use super::zstandard_pages::ZstandardPages;
use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result};
use ::bytes::Bytes;
use parquet::basic::{Compression, ConvertedType, Type};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::DataType;
use parquet::file::reader::{FileReader, SerializedFileReader};
use std::sync::Arc;

/// Most columns that are read.
const COLUMNS_MAX: usize = 256;
/// Values that are read at once.
const BATCH: usize = 1 << 16;

/// Reads all columns of numbers.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| {
        Error::new(
            place,
            format!("cannot be read as Parquet: {e}; is it cut off or damaged?"),
        )
    };
    let bytes = Arc::new(Bytes::copy_from_slice(bytes));
    let file = SerializedFileReader::new(Bytes::clone(&bytes)).map_err(|e| fail(&e))?;
    let described = file.metadata().file_metadata().schema_descr_ptr();
    if described.num_columns() > COLUMNS_MAX {
        return Err(Error::new(
            place,
            format!(
                "has {} columns; expected at most {COLUMNS_MAX}",
                described.num_columns()
            ),
        ));
    }
    let mut table = Table {
        place: place.to_owned(),
        ..Table::default()
    };
    let mut aside = Vec::new();
    for c in 0..described.num_columns() {
        let column = described.column(c);
        let name = column.path().string();
        let is_number = matches!(
            column.physical_type(),
            Type::INT32 | Type::INT64 | Type::FLOAT | Type::DOUBLE
        );
        if !is_number || column.max_rep_level() > 0 {
            aside.push(format!("`{name}`"));
            continue;
        }
        let mut values: Vec<f64> = Vec::new();
        let mut rows = 0_usize;
        for group in 0..file.num_row_groups() {
            let group = file.get_row_group(group).map_err(|e| fail(&e))?;
            let rows_of_group = usize::try_from(group.metadata().num_rows()).unwrap_or(usize::MAX);
            rows = rows.saturating_add(rows_of_group);
            let wrong = |e: &dyn std::fmt::Display| fail(&format!("column `{name}`: {e}"));
            let chunk = group.metadata().column(c);
            if matches!(
                chunk.compression(),
                Compression::BROTLI(_) | Compression::LZO
            ) {
                let expected = "expected Snappy, gzip, Zstandard, LZ4 or no compression";
                return Err(Error::new(
                    place,
                    format!(
                        "column `{name}` is compressed by {:?}; {expected}",
                        chunk.compression()
                    ),
                ));
            }
            let reader = if matches!(chunk.compression(), Compression::ZSTD(_)) {
                ZstandardPages::of(&bytes, chunk, rows_of_group)
                    .map(|pages| get_column_reader(described.column(c), Box::new(pages)))
            } else {
                group.get_column_reader(c)
            };
            let read = match reader.map_err(|e| wrong(&e))? {
                ColumnReader::Int32ColumnReader(reader) => {
                    append(reader, &mut values, |v| f64::from(*v))
                }
                ColumnReader::Int64ColumnReader(reader) => {
                    append(reader, &mut values, |v| *v as f64)
                }
                ColumnReader::FloatColumnReader(reader) => {
                    append(reader, &mut values, |v| f64::from(*v))
                }
                ColumnReader::DoubleColumnReader(reader) => append(reader, &mut values, |v| *v),
                _ => Ok(()),
            };
            read.map_err(|e| wrong(&e))?;
        }
        if values.len() != rows {
            return Err(Error::new(
                place,
                format!(
                    "column `{name}` has {} numbers in {rows} rows; expected a number in each",
                    values.len()
                ),
            ));
        }
        // A decimal is a whole number of its last digits.
        if column.converted_type() == ConvertedType::DECIMAL {
            let digit = 10f64.powi(column.type_scale());
            values.iter_mut().for_each(|v| *v /= digit);
        }
        // A time that is a time of day is counted from its first instant.
        let mut column_read = Column::new(c + 1, &name, values);
        if let Some(factor) = timestamp_s(&column) {
            let first = column_read.values.first().copied().unwrap_or(0.0);
            column_read
                .values
                .iter_mut()
                .for_each(|v| *v = (*v - first) * factor);
            column_read.unit = Some("s".into());
        }
        table.columns.push(column_read);
    }
    if !aside.is_empty() {
        table.notes.push(format!(
            "columns that hold no numbers are left aside: {}",
            aside.join(", ")
        ));
    }
    Ok(table)
}

/// Seconds of one count, if a column holds instants.
fn timestamp_s(column: &parquet::schema::types::ColumnDescriptor) -> Option<f64> {
    use parquet::basic::{LogicalType, TimeUnit};
    match column.logical_type_ref()? {
        LogicalType::Timestamp(kind) | LogicalType::Time(kind) => Some(match kind.unit {
            TimeUnit::MILLIS => 1e-3,
            TimeUnit::MICROS => 1e-6,
            TimeUnit::NANOS => 1e-9,
        }),
        _ => None,
    }
}

fn append<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    values: &mut Vec<f64>,
    wide: impl Fn(&T::T) -> f64,
) -> std::result::Result<(), parquet::errors::ParquetError> {
    loop {
        let (mut levels, mut batch) = (Vec::new(), Vec::new());
        let (records, ..) = reader.read_records(BATCH, Some(&mut levels), None, &mut batch)?;
        values.extend(batch.iter().map(&wide));
        if records == 0 {
            return Ok(());
        }
    }
}
