//! HDF5, and MATLAB 7.3, which is HDF5 with the classes of its variables as attributes and cells as
//! references.

use super::bytes::FileKind;
use super::named_arrays::{Tree, table};
use crate::dataset::table::Table;
use crate::error::{Error, Result};
use hdf5_reader::group::Group;
use hdf5_reader::{Attribute, Dataset, Datatype, Hdf5File, OpenOptions};
use std::collections::BTreeMap;

/// Deepest nesting of groups and references.
const DEPTH_MAX: usize = 24;
/// Most objects that are visited: groups may refer to each other.
const OBJECTS_MAX: usize = 20_000;
/// Most bytes that one array may have.
const ARRAY_MAX: usize = 1 << 31;
/// Attributes of the file, of a group or of a data set that hold its sampling rate in Hz or its period in s.
const SAMPLING: [&str; 3] = ["sample_rate_hz", "fs", "dt"];
/// Where MATLAB keeps what cells and arrays of structs refer to.
const REFERENCES: &str = "#refs#";

/// Reads all data sets of numbers, in all groups.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let fail = |e: &dyn std::fmt::Display| {
        Error::new(
            place,
            format!("cannot be read as HDF5: {e}; is it cut off or damaged?"),
        )
    };
    // What is compressed may be much longer than the file, but not without end.
    let most = bytes.len().saturating_mul(1100).min(ARRAY_MAX);
    let options = OpenOptions::default()
        .with_max_read_bytes(most)
        .with_max_chunk_bytes(most);
    let file = Hdf5File::from_bytes_with_options(bytes, options).map_err(|e| fail(&e))?;
    let root = file.root_group().map_err(|e| fail(&e))?;
    let (groups, datasets) = root.members().map_err(|e| fail(&e))?;
    let mut reader = Reader {
        place,
        referred: BTreeMap::new(),
        visited: 0,
    };
    let (hidden, groups): (Vec<Group>, Vec<Group>) = groups
        .into_iter()
        .partition(|group| group.name().starts_with('#'));
    for group in hidden.iter().filter(|group| group.name() == REFERENCES) {
        let (groups, datasets) = group.members().map_err(|e| fail(&e))?;
        reader
            .referred
            .extend(groups.into_iter().map(|g| (g.address(), Object::Group(g))));
        reader.referred.extend(
            datasets
                .into_iter()
                .map(|d| (d.address(), Object::Dataset(Box::new(d)))),
        );
    }
    let mut variables = sampling(|key| root.attribute(key).ok());
    for dataset in &datasets {
        variables.push((dataset.name().to_owned(), reader.dataset(dataset, 0)?));
    }
    for group in &groups {
        variables.push((group.name().to_owned(), reader.group(group, 0)?));
    }
    table(place, variables)
}

/// What attributes say of the sampling, as numbers alone.
fn sampling(attribute: impl Fn(&str) -> Option<Attribute>) -> Vec<(String, Tree)> {
    let number = |key: &&str| {
        let value = attribute(key)?.read_as_f64().ok()?;
        Some((
            (*key).to_owned(),
            Tree::Numbers {
                shape: Vec::new(),
                values: vec![value],
            },
        ))
    };
    SAMPLING.iter().filter_map(number).collect()
}

enum Object {
    Group(Group),
    Dataset(Box<Dataset>),
}

struct Reader<'a> {
    place: &'a str,
    referred: BTreeMap<u64, Object>,
    visited: usize,
}

impl Reader<'_> {
    fn fail(&self, name: &str, what: impl std::fmt::Display) -> Error {
        Error::new(
            self.place,
            format!("`{name}` cannot be read: {what}; is the file cut off or damaged?"),
        )
    }

    fn visit(&mut self, name: &str, depth: usize) -> Result<()> {
        self.visited += 1;
        if depth > DEPTH_MAX || self.visited > OBJECTS_MAX {
            return Err(self.fail(name, "groups are nested too deep, or refer to each other"));
        }
        Ok(())
    }

    /// A group is a struct; one whose fields are references of the same number is an array of structs.
    fn group(&mut self, group: &Group, depth: usize) -> Result<Tree> {
        self.visit(group.name(), depth)?;
        let (groups, datasets) = group.members().map_err(|e| self.fail(group.name(), e))?;
        let rates = sampling(|key| group.attribute(key).ok());
        let mut fields = Vec::new();
        for dataset in &datasets {
            fields.push((dataset.name().to_owned(), self.dataset(dataset, depth + 1)?));
        }
        for group in &groups {
            fields.push((group.name().to_owned(), self.group(group, depth + 1)?));
        }
        let lengths: Vec<Option<usize>> = fields
            .iter()
            .map(|(_, tree)| match tree {
                Tree::Cells(cells) => Some(cells.len()),
                _ => None,
            })
            .collect();
        let count = lengths
            .first()
            .copied()
            .flatten()
            .filter(|n| *n > 0 && lengths.iter().all(|length| *length == Some(*n)));
        let Some(count) = count else {
            fields.extend(rates);
            return Ok(Tree::Structs(vec![fields]));
        };
        let mut elements: Vec<Vec<(String, Tree)>> = (0..count).map(|_| Vec::new()).collect();
        for (field, tree) in fields {
            if let Tree::Cells(cells) = tree {
                elements
                    .iter_mut()
                    .zip(cells)
                    .for_each(|(element, cell)| element.push((field.clone(), cell)));
            }
        }
        Ok(Tree::Structs(elements))
    }

    fn dataset(&mut self, dataset: &Dataset, depth: usize) -> Result<Tree> {
        let name = dataset.name();
        self.visit(name, depth)?;
        let attribute = |key: &str| {
            dataset
                .attribute(key)
                .ok()
                .and_then(|a| a.read_string().ok())
        };
        let class = attribute("MATLAB_class").unwrap_or_default();
        let kind = match dataset.dtype() {
            Datatype::FixedPoint { size, signed, .. } => match (size, signed) {
                (1, true) => FileKind::I8,
                (1, false) => FileKind::U8,
                (2, true) => FileKind::I16,
                (2, false) => FileKind::U16,
                (4, true) => FileKind::I32,
                (4, false) => FileKind::U32,
                (8, true) => FileKind::I64,
                (8, false) => FileKind::U64,
                _ => return Ok(Tree::Unread(format!("whole numbers of {size} bytes"))),
            },
            Datatype::FloatingPoint { size: 4, .. } => FileKind::F32,
            Datatype::FloatingPoint { size: 8, .. } => FileKind::F64,
            Datatype::Reference { .. } => return self.referred(dataset, depth),
            Datatype::Compound { .. } => return Ok(Tree::Unread("rows of several fields".into())),
            Datatype::String { .. } | Datatype::VarLen { .. } => {
                return Ok(dataset
                    .read_string()
                    .map_or_else(|_| Tree::Unread("text".into()), Tree::Text));
            }
            _ => return Ok(Tree::Unread("no numbers".into())),
        };
        let is_empty = dataset.attribute("MATLAB_empty").is_ok();
        if is_empty {
            return Ok(Tree::Text(String::new()));
        }
        let bytes = dataset
            .read_native_bytes()
            .map_err(|e| self.fail(name, e))?;
        let values = kind.numbers(&bytes, cfg!(target_endian = "big"));
        if class == "char" {
            let units: Vec<u16> = values.iter().map(|v| *v as u16).collect();
            return Ok(Tree::Text(String::from_utf16_lossy(&units)));
        }
        // Rows of HDF5 are columns of MATLAB.
        let shape = dataset
            .shape()
            .iter()
            .rev()
            .map(|side| *side as usize)
            .collect();
        let numbers = Tree::Numbers { shape, values };
        let unit = ["units", "unit", "Unit"]
            .iter()
            .find_map(|key| attribute(key))
            .filter(|unit| !unit.is_empty());
        let mut fields = sampling(|key| dataset.attribute(key).ok());
        fields.extend(unit.map(|unit| ("unit".to_owned(), Tree::Text(unit))));
        if fields.is_empty() {
            return Ok(numbers);
        }
        fields.push(("data".into(), numbers));
        Ok(Tree::Structs(vec![fields]))
    }

    /// What the references of a cell array, or of one field of an array of structs, refer to.
    fn referred(&mut self, dataset: &Dataset, depth: usize) -> Result<Tree> {
        let name = dataset.name();
        let bytes = dataset.read_raw_bytes().map_err(|e| self.fail(name, e))?;
        if bytes.len() > 8 * OBJECTS_MAX {
            return Err(self.fail(name, "too many references"));
        }
        let mut cells = Vec::new();
        for address in bytes
            .chunks_exact(8)
            .map(|b| u64::from_le_bytes(b.try_into().unwrap_or([0; 8])))
        {
            // Taken out while it is read: what refers to itself is then found missing, not read without end.
            let Some(object) = self.referred.remove(&address) else {
                cells.push(Tree::Unread("a reference to nothing".into()));
                continue;
            };
            let tree = match &object {
                Object::Group(group) => self.group(group, depth + 1),
                Object::Dataset(dataset) => self.dataset(dataset, depth + 1),
            };
            self.referred.insert(address, object);
            cells.push(tree?);
        }
        Ok(Tree::Cells(cells))
    }
}
