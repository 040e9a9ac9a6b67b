//! Arrow IPC files, which Feather is.

use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result};
use arrow_array::{Array, ArrayRef};
use arrow_buffer::{ArrowNativeType, Buffer, ScalarBuffer};
use arrow_ipc::convert::try_fb_to_schema;
use arrow_ipc::reader::{FileDecoder, read_footer_length};
use arrow_ipc::{Block, CompressionType, Footer, Message, root_as_footer, root_as_message};
use arrow_schema::{DataType, TimeUnit};
use std::sync::Arc;

/// Most columns that are read.
const COLUMNS_MAX: usize = 256;
/// Length of the footer and the format's name, at the end of a file.
const TRAILER_BYTES: usize = 10;
/// What stands before a message of the present format: a mark and the length.
const MARK: [u8; 4] = [0xff; 4];
/// LZ4 packs a run of equal bytes into one for each 255 of them.
const LZ4_RATIO_MAX: usize = 256;

/// Reads all columns of numbers.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| {
        Error::new(
            place,
            format!("cannot be read as Arrow: {e}; is it cut off or damaged?"),
        )
    };
    let end = bytes
        .len()
        .checked_sub(TRAILER_BYTES)
        .ok_or_else(|| fail(&"its end is missing"))?;
    let trailer: [u8; TRAILER_BYTES] = bytes[end..]
        .try_into()
        .map_err(|_| fail(&"its end is missing"))?;
    let footer_bytes = read_footer_length(trailer).map_err(|e| fail(&e))?;
    let begin = end
        .checked_sub(footer_bytes)
        .ok_or_else(|| fail(&"its footer is longer than the file"))?;
    let footer = root_as_footer(&bytes[begin..end]).map_err(|e| fail(&e))?;
    let schema = Arc::new(
        try_fb_to_schema(footer.schema().ok_or_else(|| fail(&"it has no schema"))?)
            .map_err(|e| fail(&e))?,
    );
    if schema.fields().len() > COLUMNS_MAX {
        return Err(Error::new(
            place,
            format!(
                "has {} columns; expected at most {COLUMNS_MAX}",
                schema.fields().len()
            ),
        ));
    }
    let (numbers, aside): (Vec<usize>, Vec<usize>) =
        (0..schema.fields().len()).partition(|c| instant_s(schema.field(*c).data_type()).is_some());
    let decoder =
        FileDecoder::new(Arc::clone(&schema), footer.version()).with_projection(numbers.clone());
    let file = Buffer::from(bytes);
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); numbers.len()];
    for block in batches(&footer) {
        let data = block_of(&file, block).ok_or_else(|| fail(&"a batch lies outside the file"))?;
        let message = message_of(&data).ok_or_else(|| fail(&"a batch has no description"))?;
        may_be_unpacked(
            place,
            &message,
            &data[usize::try_from(block.metaDataLength())
                .unwrap_or(usize::MAX)
                .min(data.len())..],
        )?;
        let Some(batch) = decoder
            .read_record_batch(block, &data)
            .map_err(|e| fail(&e))?
        else {
            continue;
        };
        for ((values, array), c) in columns.iter_mut().zip(batch.columns()).zip(&numbers) {
            if let Some(row) = (0..array.len()).find(|row| array.is_null(*row)) {
                let (name, row) = (schema.field(*c).name(), values.len() + row + 1);
                return Err(Error::new(
                    place,
                    format!(
                        "column `{name}` has no number in row {row}; expected a number in each"
                    ),
                ));
            }
            append(array, values);
        }
    }
    let mut table = Table {
        place: place.to_owned(),
        ..Table::default()
    };
    for (c, mut values) in numbers.into_iter().zip(columns) {
        let field = schema.field(c);
        // A time that is a time of day is counted from its first instant.
        let unit = instant_s(field.data_type()).flatten().map(|factor| {
            let first = values.first().copied().unwrap_or(0.0);
            values.iter_mut().for_each(|v| *v = (*v - first) * factor);
            "s".to_owned()
        });
        let column = Column::new(c + 1, field.name(), values);
        table.columns.push(Column {
            unit: unit.or(column.unit.clone()),
            ..column
        });
    }
    if !aside.is_empty() {
        let names: Vec<String> = aside
            .iter()
            .map(|c| format!("`{}`", schema.field(*c).name()))
            .collect();
        table.notes.push(format!(
            "columns that hold no numbers are left aside: {}",
            names.join(", ")
        ));
    }
    Ok(table)
}

fn batches<'a>(footer: &Footer<'a>) -> impl Iterator<Item = &'a Block> {
    footer.recordBatches().into_iter().flatten()
}

/// The part of the file that a block describes.
fn block_of(file: &Buffer, block: &Block) -> Option<Buffer> {
    let (offset, head) = (
        usize::try_from(block.offset()).ok()?,
        usize::try_from(block.metaDataLength()).ok()?,
    );
    let length = usize::try_from(block.bodyLength())
        .ok()?
        .checked_add(head)?;
    (offset.checked_add(length)? <= file.len()).then(|| file.slice_with_length(offset, length))
}

fn message_of(data: &[u8]) -> Option<Message<'_>> {
    let begin = if data.starts_with(&MARK) { 8 } else { 4 };
    root_as_message(data.get(begin..)?).ok()
}

/// The decoder reserves as much as a packed buffer claims to be: a damaged file must not ask for more than
/// there can be.
fn may_be_unpacked(place: &str, message: &Message, body: &[u8]) -> Result<()> {
    let Some(batch) = message.header_as_record_batch() else {
        return Ok(());
    };
    let Some(compression) = batch.compression() else {
        return Ok(());
    };
    if compression.codec() != CompressionType::LZ4_FRAME {
        return Err(Error::new(
            place,
            "is compressed by Zstandard; expected LZ4 or no compression",
        ));
    }
    for buffer in batch.buffers().into_iter().flatten() {
        let part = usize::try_from(buffer.offset())
            .ok()
            .zip(usize::try_from(buffer.length()).ok());
        let packed =
            part.and_then(|(offset, length)| body.get(offset..offset.checked_add(length)?));
        let claimed = packed
            .and_then(|packed| packed.first_chunk())
            .map(|head| i64::from_le_bytes(*head));
        let most = packed.map_or(0, |packed| packed.len().saturating_mul(LZ4_RATIO_MAX));
        // -1 marks a buffer that is not packed.
        if claimed.is_some_and(|claimed| {
            claimed != -1 && usize::try_from(claimed).map_or(true, |claimed| claimed > most)
        }) {
            return Err(Error::new(
                place,
                "cannot be read as Arrow: a packed column has an impossible length; is it damaged?",
            ));
        }
    }
    Ok(())
}

/// Whether a column holds numbers, and if these are instants the seconds of one count.
fn instant_s(kind: &DataType) -> Option<Option<f64>> {
    use DataType as D;
    match kind {
        D::Int8
        | D::Int16
        | D::Int32
        | D::Int64
        | D::UInt8
        | D::UInt16
        | D::UInt32
        | D::UInt64
        | D::Float32
        | D::Float64 => Some(None),
        D::Timestamp(unit, _) | D::Time32(unit) | D::Time64(unit) | D::Duration(unit) => {
            Some(Some(match unit {
                TimeUnit::Second => 1.0,
                TimeUnit::Millisecond => 1e-3,
                TimeUnit::Microsecond => 1e-6,
                TimeUnit::Nanosecond => 1e-9,
            }))
        }
        _ => None,
    }
}

fn append(array: &ArrayRef, values: &mut Vec<f64>) {
    use DataType as D;
    match array.data_type() {
        D::Int8 => widen::<i8>(array, values, f64::from),
        D::Int16 => widen::<i16>(array, values, f64::from),
        D::Int32 | D::Time32(_) => widen::<i32>(array, values, f64::from),
        D::UInt8 => widen::<u8>(array, values, f64::from),
        D::UInt16 => widen::<u16>(array, values, f64::from),
        D::UInt32 => widen::<u32>(array, values, f64::from),
        D::UInt64 => widen::<u64>(array, values, |v| v as f64),
        D::Float32 => widen::<f32>(array, values, f64::from),
        D::Float64 => widen::<f64>(array, values, |v| v),
        // Whole numbers and instants of 64 bits: nothing else is asked for.
        _ => widen::<i64>(array, values, |v| v as f64),
    }
}

fn widen<T: ArrowNativeType>(array: &ArrayRef, values: &mut Vec<f64>, wide: impl Fn(T) -> f64) {
    let data = array.to_data();
    if let Some(buffer) = data.buffers().first() {
        values.extend(
            ScalarBuffer::<T>::new(buffer.clone(), data.offset(), data.len())
                .iter()
                .map(|v| wide(*v)),
        );
    }
}
