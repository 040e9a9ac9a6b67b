//! MATLAB's format of versions 5 to 7, with compression, structs and cells (Simulink logs, ControlDesk).
//!
//! MathWorks, *MAT-File Format*, R2019b, Ch. 1. Crates that read it leave structs and cells out, where logs
//! keep their signals.

use super::bytes::{Bytes, FileKind};
use super::named_arrays::Tree;
use super::packed::Room;
use crate::dataset::table::Table;
use crate::error::{Error, Result};
use std::io::Read;

const HEADER: usize = 128;
/// Deepest nesting of structs and cells.
const DEPTH_MAX: usize = 24;

const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;

/// Whether the bytes begin as such a file does.
pub fn is_matlab5(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB 5.0")
        || (bytes.len() >= HEADER
            && matches!(&bytes[124..128], [0, 1, b'I', b'M'] | [1, 0, b'M', b'I']))
}

/// Reads all variables.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let big_endian = match bytes.get(126..128) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => {
            return Err(Error::new(
                place,
                "byte 126: no mark of the byte order; expected a MATLAB file of version 5 to 7, is it cut off?",
            ));
        }
    };
    let mut file = Bytes::new(place, bytes, big_endian);
    file.take(HEADER, "the header")?;
    let (mut variables, mut room) = (Vec::new(), Room::of_file(bytes.len()));
    while file.left() > 0 {
        let at = file.at();
        let (kind, data) = element(&mut file)?;
        let (name, tree) = match kind {
            MI_COMPRESSED => {
                let mut inflated = Vec::new();
                let broken = |e| {
                    Error::new(
                        place,
                        format!(
                            "byte {at}: a compressed variable cannot be read ({e}); is the file damaged?"
                        ),
                    )
                };
                flate2::read::ZlibDecoder::new(data)
                    .take(room.limit())
                    .read_to_end(&mut inflated)
                    .map_err(broken)?;
                let inside = format!("{place}: the compressed variable at byte {at}");
                room.take(&inside, inflated.len() as u64)?;
                let mut variable = Bytes::new(&inside, &inflated, big_endian);
                match element(&mut variable)? {
                    (MI_MATRIX, data) => {
                        matrix(Bytes::new(&inside, data, big_endian), big_endian, 0)?
                    }
                    (other, _) => {
                        return variable
                            .wrong(format!("an element of type {other}; expected a variable"));
                    }
                }
            }
            MI_MATRIX => matrix(Bytes::new(place, data, big_endian), big_endian, 0)?,
            // Data that MATLAB keeps for itself.
            _ => continue,
        };
        variables.push((name, tree));
    }
    super::named_arrays::table(place, variables)
}

/// Type and data of the next element.
fn element<'a>(file: &mut Bytes<'a>) -> Result<(u32, &'a [u8])> {
    let tag = file.u32("a tag")?;
    if tag >> 16 != 0 {
        // Up to four bytes stand in the tag itself.
        let (kind, size) = (tag & 0xffff, (tag >> 16) as usize);
        if size > 4 {
            return file.wrong(format!(
                "a short element of {size} bytes; expected at most 4, is the file damaged?"
            ));
        }
        return Ok((kind, &file.take(4, "a short element")?[..size]));
    }
    let size = file.u32("the size of an element")? as usize;
    if !(1..=18).contains(&tag) {
        return file.wrong(format!(
            "an element of the unknown type {tag}; is the file damaged?"
        ));
    }
    let data = file.take(size, "an element")?;
    if tag != MI_COMPRESSED {
        file.take(((8 - size % 8) % 8).min(file.left()), "padding")?;
    }
    Ok((tag, data))
}

fn kind_of(file: &Bytes, mi: u32) -> Result<FileKind> {
    Ok(match mi {
        1 => FileKind::I8,
        2 | 16 => FileKind::U8,
        3 => FileKind::I16,
        4 | 17 => FileKind::U16,
        5 => FileKind::I32,
        6 | 18 => FileKind::U32,
        7 => FileKind::F32,
        9 => FileKind::F64,
        12 => FileKind::I64,
        13 => FileKind::U64,
        _ => {
            return file.wrong(format!(
                "numbers of the unknown type {mi}; is the file damaged?"
            ));
        }
    })
}

/// The next element as numbers.
fn numbers(file: &mut Bytes, big_endian: bool) -> Result<Vec<f64>> {
    let (mi, data) = element(file)?;
    Ok(kind_of(file, mi)?.numbers(data, big_endian))
}

/// The next element as text.
fn text(file: &mut Bytes, big_endian: bool) -> Result<String> {
    let (mi, data) = element(file)?;
    Ok(match mi {
        1 | 2 | 16 => String::from_utf8_lossy(data).into_owned(),
        _ => {
            let units: Vec<u16> = kind_of(file, mi)?
                .numbers(data, big_endian)
                .iter()
                .map(|v| *v as u16)
                .collect();
            String::from_utf16_lossy(&units)
        }
    })
}

/// Name and content of a variable.
fn matrix(mut file: Bytes, big_endian: bool, depth: usize) -> Result<(String, Tree)> {
    if depth > DEPTH_MAX {
        return file.wrong(format!(
            "structs and cells are nested more than {DEPTH_MAX} deep"
        ));
    }
    if file.left() == 0 {
        return Ok((
            String::new(),
            Tree::Numbers {
                shape: vec![0, 0],
                values: Vec::new(),
            },
        ));
    }
    let flags = numbers(&mut file, big_endian)?;
    let class = flags.first().map_or(0, |v| *v as u32 & 0xff);
    if class == 17 {
        let name = text(&mut file, big_endian)?;
        return Ok((
            name,
            Tree::Unread("an object of MATLAB (timeseries, Dataset?)".into()),
        ));
    }
    let shape: Vec<usize> = numbers(&mut file, big_endian)?
        .iter()
        .map(|v| v.max(0.0) as usize)
        .collect();
    let name = text(&mut file, big_endian)?;
    let count = shape
        .iter()
        .try_fold(1_usize, |n, side| n.checked_mul(*side))
        .unwrap_or(usize::MAX);
    let tree = match class {
        1 => {
            let mut cells = Vec::new();
            for _ in 0..count {
                cells.push(child(&mut file, big_endian, depth)?);
            }
            Tree::Cells(cells)
        }
        2 | 3 => {
            if class == 3 {
                text(&mut file, big_endian)?;
            }
            let length = numbers(&mut file, big_endian)?
                .first()
                .map_or(0, |v| v.max(0.0) as usize);
            let (_, names) = element(&mut file)?;
            if length == 0 && !names.is_empty() {
                return file.wrong("names of fields without a length; is the file damaged?");
            }
            let name = |bytes: &[u8]| {
                String::from_utf8_lossy(bytes.split(|b| *b == 0).next().unwrap_or_default())
                    .into_owned()
            };
            let fields: Vec<String> = names.chunks(length.max(1)).map(name).collect();
            let mut elements = Vec::new();
            // A struct without fields has no data, however many elements it promises.
            for _ in 0..if fields.is_empty() { 0 } else { count } {
                let mut element = Vec::new();
                for field in &fields {
                    element.push((field.clone(), child(&mut file, big_endian, depth)?));
                }
                elements.push(element);
            }
            Tree::Structs(elements)
        }
        4 => Tree::Text(text(&mut file, big_endian)?),
        6..=15 => {
            let values = numbers(&mut file, big_endian)?;
            if values.len() != count {
                return file.wrong(format!(
                    "`{name}` has shape {shape:?}, but {} numbers; is the file damaged?",
                    values.len()
                ));
            }
            Tree::Numbers { shape, values }
        }
        5 => Tree::Unread("a sparse matrix".into()),
        16 => Tree::Unread("a function".into()),
        _ => {
            return file.wrong(format!(
                "`{name}` is of the unknown class {class}; is the file damaged?"
            ));
        }
    };
    Ok((name, tree))
}

fn child(file: &mut Bytes, big_endian: bool, depth: usize) -> Result<Tree> {
    match element(file)? {
        (MI_MATRIX, data) => Ok(matrix(Bytes::new(file.place, data, big_endian), big_endian, depth + 1)?.1),
        (other, _) => file.wrong(format!("an element of type {other} in a struct or cell; expected a matrix, is the file damaged?")),
    }
}
