//! Variables of a file in which they nest: numbers, text, structs, cells; as named columns.
//!
//! Logs keep a signal's name, its unit and its numbers as fields of one struct (`Name`, `Unit`, `Data` of
//! ControlDesk; `label`, `values` of Simulink): the column is then called by that name.

use crate::dataset::table::Table;
use crate::error::{Error, Result};

/// One variable.
#[derive(Clone, Debug)]
pub enum Tree {
    /// Numbers, column by column.
    Numbers { shape: Vec<usize>, values: Vec<f64> },
    /// Text.
    Text(String),
    /// Cells.
    Cells(Vec<Tree>),
    /// Elements of an array of structs, each with its fields.
    Structs(Vec<Vec<(String, Tree)>>),
    /// Something that is not read, and what it is.
    Unread(String),
}

/// Most columns of one array; an array that is wider has no samples in its rows.
const COLUMNS_MAX: usize = 64;
/// Fields that hold the numbers of a signal.
const DATA: [&str; 4] = ["data", "values", "value", "samples"];
/// Fields that hold its name.
const NAME: [&str; 4] = ["name", "label", "signalname", "signal_name"];
/// Fields that hold its unit.
const UNIT: [&str; 2] = ["unit", "units"];

/// Columns of variables.
///
/// # Errors
/// Where none of them is an array of numbers; what was not read is then named.
pub fn table(place: &str, variables: Vec<(String, Tree)>) -> Result<Table> {
    let mut arrays: Vec<(Vec<String>, String, Vec<f64>)> = Vec::new();
    let mut unread = Vec::new();
    for (name, tree) in variables {
        collect(&mut vec![name], tree, &mut arrays, &mut unread);
    }
    // The last part of a path is enough where no other column has it.
    let last = |path: &[String]| path.last().cloned().unwrap_or_default();
    let leaves: Vec<String> = arrays.iter().map(|(path, ..)| last(path)).collect();
    let named = arrays
        .into_iter()
        .enumerate()
        .map(|(i, (path, unit, values))| {
            let alone = leaves.iter().filter(|leaf| **leaf == leaves[i]).count() == 1;
            let name = if alone {
                leaves[i].clone()
            } else {
                path.join(".")
            };
            (
                if unit.is_empty() {
                    name
                } else {
                    format!("{name} [{unit}]")
                },
                values,
            )
        });
    let table = Table::from_arrays(place, named.collect());
    if unread.is_empty() {
        return table;
    }
    match table {
        Ok(mut table) => {
            table.notes.push(format!("not read: {}", unread.join(", ")));
            Ok(table)
        }
        Err(error) => Err(Error::new(
            "",
            format!(
                "{error}; not read: {}; in MATLAB save numbers: t = ts.Time; y = ts.Data; save('record.mat', 't', 'y')",
                unread.join(", ")
            ),
        )),
    }
}

fn collect(
    path: &mut Vec<String>,
    tree: Tree,
    arrays: &mut Vec<(Vec<String>, String, Vec<f64>)>,
    unread: &mut Vec<String>,
) {
    match tree {
        Tree::Numbers { shape, values } => push_columns(path, "", &shape, values, arrays),
        Tree::Text(_) => {}
        Tree::Unread(what) => unread.push(format!("`{}` ({what})", path.join("."))),
        Tree::Cells(cells) => {
            for (i, cell) in cells.into_iter().enumerate() {
                within(path, format!("{{{}}}", i + 1), |path| {
                    collect(path, cell, arrays, unread)
                });
            }
        }
        Tree::Structs(elements) => {
            let several = elements.len() > 1;
            for (i, fields) in elements.into_iter().enumerate() {
                if several {
                    within(path, format!("({})", i + 1), |path| {
                        collect_struct(path, fields, arrays, unread)
                    });
                } else {
                    collect_struct(path, fields, arrays, unread);
                }
            }
        }
    }
}

fn within(path: &mut Vec<String>, part: String, then: impl FnOnce(&mut Vec<String>)) {
    // An index belongs to the name before it.
    if part.starts_with(['(', '{']) {
        let before = path.last().cloned().unwrap_or_default();
        if let Some(last) = path.last_mut() {
            last.push_str(&part);
        }
        then(path);
        if let Some(last) = path.last_mut() {
            *last = before;
        }
    } else {
        path.push(part);
        then(path);
        path.pop();
    }
}

fn collect_struct(
    path: &mut Vec<String>,
    fields: Vec<(String, Tree)>,
    arrays: &mut Vec<(Vec<String>, String, Vec<f64>)>,
    unread: &mut Vec<String>,
) {
    let text_of = |keys: &[&str]| {
        keys.iter().find_map(|key| {
            fields.iter().find_map(|(field, tree)| match tree {
                Tree::Text(text) if field.eq_ignore_ascii_case(key) && !text.trim().is_empty() => {
                    Some(text.trim().to_owned())
                }
                _ => None,
            })
        })
    };
    let (name, unit) = (text_of(&NAME), text_of(&UNIT).unwrap_or_default());
    for (field, tree) in fields {
        let is_data = DATA.iter().any(|key| field.eq_ignore_ascii_case(key));
        match tree {
            Tree::Numbers { shape, values } if is_data => match &name {
                Some(name) => within(path, name.clone(), |path| {
                    push_columns(path, &unit, &shape, values, arrays)
                }),
                None => push_columns(path, &unit, &shape, values, arrays),
            },
            tree => within(path, field, |path| collect(path, tree, arrays, unread)),
        }
    }
}

/// One column of a vector, several of a matrix; sides of length one do not count.
fn push_columns(
    path: &[String],
    unit: &str,
    shape: &[usize],
    values: Vec<f64>,
    arrays: &mut Vec<(Vec<String>, String, Vec<f64>)>,
) {
    let sides: Vec<usize> = shape.iter().copied().filter(|side| *side != 1).collect();
    let mut push = |index: Option<usize>, values: Vec<f64>| {
        let mut path = path.to_vec();
        if let (Some(index), Some(last)) = (index, path.last_mut()) {
            last.push_str(&format!("({index})"));
        }
        arrays.push((path, unit.to_owned(), values));
    };
    match sides[..] {
        [rows, width] if rows >= width && width <= COLUMNS_MAX && rows > 0 => {
            for c in 0..width {
                push(Some(c + 1), values[c * rows..(c + 1) * rows].to_vec());
            }
        }
        [width, rows] if rows > width && width <= COLUMNS_MAX => {
            for c in 0..width {
                push(
                    Some(c + 1),
                    (0..rows).map(|r| values[r * width + c]).collect(),
                );
            }
        }
        [] | [_] => push(None, values),
        _ => {}
    }
}
