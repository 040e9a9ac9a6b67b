//! XLSX: the first sheet that holds columns of numbers, read as text would be.

use super::hints::Hints;
use super::{delimited, packed};
use crate::dataset::table::Table;
use crate::error::{Error, Result};
use calamine::{Cell, Data, DataRef, Range, Reader, Xlsx, XlsxError, open_workbook_from_rs};
use std::io::Cursor;

/// Most cells of a sheet that are read: a single cell far away makes a sheet long and wide.
const CELLS_MAX: u64 = 50_000_000;

/// Reads a workbook.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| {
        Error::new(
            place,
            format!("cannot be read as XLSX: {e}; is it cut off or damaged?"),
        )
    };
    packed::check_archive(place, bytes)?;
    let mut book: Xlsx<_> = open_workbook_from_rs(Cursor::new(bytes)).map_err(|e| fail(&e))?;
    let names = book.sheet_names();
    let mut first_error = None;
    for name in &names {
        let inside = format!("{place}: sheet `{name}`");
        let sheet = cells_of(&mut book, name, &inside)?;
        // Rows keep their numbers: what stands above the first one that is used is empty.
        let above = sheet
            .start()
            .map_or(0, |(row, _)| (row as usize).min(10_000));
        let mut text = "\n".repeat(above);
        for row in sheet.rows() {
            let cells: Vec<String> = row.iter().map(cell).collect();
            text.push_str(&cells.join("\t"));
            text.push('\n');
        }
        match delimited::read(&inside, text.as_bytes(), Hints::default()) {
            Ok(mut table) => {
                if names.len() > 1 {
                    table
                        .notes
                        .push(format!("sheet `{name}` is read, of {}", names.len()));
                }
                return Ok(Table {
                    place: place.to_owned(),
                    ..table
                });
            }
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    Err(first_error
        .unwrap_or_else(|| Error::new(place, "has no sheet; expected one with columns of numbers")))
}

/// The cells of a sheet, laid out; nothing where it is a chart.
fn cells_of(book: &mut Xlsx<Cursor<&[u8]>>, name: &str, inside: &str) -> Result<Range<Data>> {
    let fail = |e: XlsxError| {
        Error::new(
            inside,
            format!("cannot be read as XLSX: {e}; is it cut off or damaged?"),
        )
    };
    let mut reader = match book.worksheet_cells_reader(name) {
        Ok(reader) => reader,
        Err(XlsxError::NotAWorksheet(_)) => return Ok(Range::default()),
        Err(e) => return Err(fail(e)),
    };
    let (mut cells, mut first, mut last) = (Vec::new(), (u32::MAX, u32::MAX), (0, 0));
    while let Some(cell) = reader.next_cell().map_err(fail)? {
        if matches!(cell.get_value(), DataRef::Empty) {
            continue;
        }
        let (row, column) = cell.get_position();
        first = (first.0.min(row), first.1.min(column));
        last = (last.0.max(row), last.1.max(column));
        let (rows, width) = (last.0 - first.0 + 1, last.1 - first.1 + 1);
        // Rows and columns between are laid out as well, and a cell may come twice.
        let spans = u64::from(rows) * u64::from(width);
        if spans.max(cells.len() as u64) > CELLS_MAX {
            return Err(Error::new(
                inside,
                format!(
                    "spans {rows} rows of {width} cells; expected at most {CELLS_MAX} cells, remove what stands far away"
                ),
            ));
        }
        cells.push(Cell::new(
            (row, column),
            Data::from(cell.get_value().clone()),
        ));
    }
    Ok(Range::from_sparse(cells))
}

/// A cell as a text file would have it.
fn cell(data: &Data) -> String {
    match data {
        Data::Float(value) => format!("{value}"),
        Data::Int(value) => format!("{value}"),
        // A time of day, as a share of the day.
        Data::DateTime(time) => format!("{}", time.as_f64() * 86_400.0),
        other => other.to_string().replace(['\t', '\n', '\r'], " "),
    }
}
