//! NumPy arrays: NPY (one array) and NPZ (several by name).

use super::packed::Room;
use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result};
use std::io::Read;

/// Most columns that a table of samples may have; more of one dimension than of the other are samples.
const COLUMNS_MAX: usize = 64;

/// One array: `(samples, columns)`, or `(columns, samples)` where that is the longer side.
pub fn read_npy(place: &str, bytes: &[u8]) -> Result<Table> {
    let file = npyz::NpyFile::new(bytes)
        .map_err(|e| Error::new(place, format!("cannot be read as NPY: {e}")))?;
    check_size(place, &file, bytes.len())?;
    let (shape, values) = f64_values(place, file)?;
    let [first, second] = shape[..] else {
        return Err(Error::new(
            place,
            format!("has shape {shape:?}; expected (samples, columns) with columns t, u, y"),
        ));
    };
    let mut table = Table {
        place: place.to_owned(),
        ..Table::default()
    };
    let (rows, width) = if second > COLUMNS_MAX && first <= COLUMNS_MAX {
        (second, first)
    } else {
        (first, second)
    };
    if width > COLUMNS_MAX {
        return Err(Error::new(
            place,
            format!("has shape {shape:?}; expected at most {COLUMNS_MAX} columns"),
        ));
    }
    let is_turned = rows != first;
    if is_turned {
        table
            .notes
            .push(format!("shape {shape:?}: rows are the columns"));
    }
    let at = |r: usize, c: usize| {
        if is_turned {
            values[c * rows + r]
        } else {
            values[r * width + c]
        }
    };
    table.columns = (0..width)
        .map(|c| Column::new(c + 1, "", (0..rows).map(|r| at(r, c)).collect()))
        .collect();
    table.finite()
}

/// Arrays by name; those of two dimensions give several columns.
pub fn read_npz(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| Error::new(place, format!("cannot be read as NPZ: {e}"));
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).map_err(|e| fail(&e))?;
    let (mut arrays, mut room) = (Vec::new(), Room::of_file(bytes.len()));
    for i in 0..archive.len() {
        let mut member = archive.by_index(i).map_err(|e| fail(&e))?;
        let file_name = member.name().map_err(|e| fail(&e))?.into_owned();
        let Some(name) = file_name.strip_suffix(".npy").map(str::to_owned) else {
            continue;
        };
        let mut content = Vec::new();
        member
            .by_ref()
            .take(room.limit())
            .read_to_end(&mut content)
            .map_err(|e| fail(&format!("array `{name}`: {e}")))?;
        let inside = format!("{place}: array `{name}`");
        room.take(&inside, content.len() as u64)?;
        let file = npyz::NpyFile::new(&content[..])
            .map_err(|e| Error::new(&inside, format!("cannot be read as NPY: {e}")))?;
        check_size(&inside, &file, content.len())?;
        if !is_number(&file) {
            continue;
        }
        let (shape, values) = f64_values(&inside, file)?;
        match shape[..] {
            [rows, width] if width > 1 && width <= COLUMNS_MAX && rows > width => {
                arrays.extend((0..width).map(|c| {
                    (
                        format!("{name}.{}", c + 1),
                        (0..rows).map(|r| values[r * width + c]).collect(),
                    )
                }));
            }
            [width, rows] if width > 1 && width <= COLUMNS_MAX => {
                arrays.extend((0..width).map(|c| {
                    (
                        format!("{name}.{}", c + 1),
                        values[c * rows..(c + 1) * rows].to_vec(),
                    )
                }));
            }
            _ => arrays.push((name, values)),
        }
    }
    arrays.sort_by(|a: &(String, Vec<f64>), b| a.0.cmp(&b.0));
    Table::from_arrays(place, arrays)
}

fn is_number<R: std::io::Read>(file: &npyz::NpyFile<R>) -> bool {
    let kind = file.dtype().descr();
    [
        "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1",
    ]
    .iter()
    .any(|known| kind.contains(known))
}

/// Refuses a header that promises more numbers than the file can hold, before memory is asked for.
fn check_size<R: std::io::Read>(place: &str, file: &npyz::NpyFile<R>, bytes: usize) -> Result<()> {
    let values = file
        .shape()
        .iter()
        .try_fold(1_u64, |n, side| n.checked_mul(*side));
    if values.is_none_or(|values| values > bytes as u64) {
        return Err(Error::new(
            place,
            format!(
                "promises an array of shape {:?}, more than the file holds; is it cut off?",
                file.shape()
            ),
        ));
    }
    Ok(())
}

fn f64_values<R: std::io::Read>(
    place: &str,
    file: npyz::NpyFile<R>,
) -> Result<(Vec<usize>, Vec<f64>)> {
    let shape: Vec<usize> = file.shape().iter().map(|n| *n as usize).collect();
    let order = file.order();
    let kind = file.dtype().descr();
    fn all<T: npyz::Deserialize, R: std::io::Read>(
        place: &str,
        file: npyz::NpyFile<R>,
        wide: impl Fn(T) -> f64,
    ) -> Result<Vec<f64>> {
        let values = file.into_vec::<T>().map_err(|e| {
            Error::new(place, format!("cannot be read as an array of numbers: {e}"))
        })?;
        Ok(values.into_iter().map(wide).collect())
    }
    let values = match kind.trim_matches(['\'', '"', '<', '>', '|', '=']) {
        "f4" => all::<f32, R>(place, file, f64::from)?,
        "i1" => all::<i8, R>(place, file, f64::from)?,
        "u1" => all::<u8, R>(place, file, f64::from)?,
        "i2" => all::<i16, R>(place, file, f64::from)?,
        "u2" => all::<u16, R>(place, file, f64::from)?,
        "i4" => all::<i32, R>(place, file, f64::from)?,
        "u4" => all::<u32, R>(place, file, f64::from)?,
        "i8" => all::<i64, R>(place, file, |v| v as f64)?,
        "u8" => all::<u64, R>(place, file, |v| v as f64)?,
        "b1" => all::<bool, R>(place, file, |v| f64::from(u8::from(v)))?,
        _ => all::<f64, R>(place, file, |v| v)?,
    };
    if order == npyz::Order::Fortran && shape.len() == 2 {
        let (rows, width) = (shape[0], shape[1]);
        let c_order = (0..rows * width)
            .map(|i| values[(i % width) * rows + i / width])
            .collect();
        return Ok((shape, c_order));
    }
    Ok((shape, values))
}
