//! XLSX: the first sheet that holds columns of numbers, read as text would be.

use super::{Hints, delimited};
use crate::dataset::table::Table;
use crate::error::{Error, Result};
use calamine::{Data, Reader, Xlsx, open_workbook_from_rs};

/// Most cells of a sheet that are read: an empty cell far away makes a sheet long and wide.
const CELLS_MAX: usize = 50_000_000;

/// Reads a workbook.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| {
        Error::new(
            place,
            format!("cannot be read as XLSX: {e}; is it cut off or damaged?"),
        )
    };
    let mut book: Xlsx<_> =
        open_workbook_from_rs(std::io::Cursor::new(bytes)).map_err(|e| fail(&e))?;
    let names = book.sheet_names();
    let mut first_error = None;
    for name in &names {
        let sheet = book
            .worksheet_range(name)
            .map_err(|e| fail(&format!("sheet `{name}`: {e}")))?;
        let (rows, width) = sheet.get_size();
        if rows.saturating_mul(width) > CELLS_MAX {
            return Err(Error::new(
                place,
                format!(
                    "sheet `{name}` spans {rows} rows of {width} cells; expected at most {CELLS_MAX} cells"
                ),
            ));
        }
        let inside = format!("{place}: sheet `{name}`");
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
