//! TDMS, the format of LabVIEW and of National Instruments' loggers.
//!
//! National Instruments, *TDMS File Format Internal Structure*, 2023. Segments of metadata and raw data
//! follow each other; a channel keeps the layout of the segment before where a new one does not change it.

use super::bytes::{Bytes, FileKind};
use crate::dataset::table::Table;
use crate::error::{Error, Result};
use std::collections::BTreeMap;

const META: u32 = 1 << 1;
const NEW_LIST: u32 = 1 << 2;
const RAW: u32 = 1 << 3;
const INTERLEAVED: u32 = 1 << 5;
const BIG_ENDIAN: u32 = 1 << 6;
const DAQMX: u32 = 1 << 7;

const STRING: u32 = 0x20;
const TIMESTAMP: u32 = 0x44;

/// What a property is.
#[derive(Clone, Debug)]
enum Property {
    Number(f64),
    Text(String),
    Other,
}

#[derive(Clone, Copy, Debug)]
struct Layout {
    kind: FileKind,
    values: usize,
}

#[derive(Clone, Debug, Default)]
struct Channel {
    layout: Option<Layout>,
    properties: BTreeMap<String, Property>,
    values: Vec<f64>,
}

/// Reads all channels of numbers.
pub fn read(place: &str, bytes: &[u8]) -> Result<Table> {
    let mut file = Bytes::new(place, bytes, false);
    let mut channels: BTreeMap<String, Channel> = BTreeMap::new();
    let mut names: Vec<String> = Vec::new();
    let mut active: Vec<String> = Vec::new();
    while file.left() > 0 {
        let start = file.at();
        let tag = file.take(4, "the tag of a segment")?;
        if tag != b"TDSm" {
            return Err(Error::new(
                place,
                format!(
                    "byte {start}: no segment of TDMS begins here (expected \"TDSm\"); is the file damaged?"
                ),
            ));
        }
        let flags = file.u32("the flags of a segment")?;
        let mut segment = file.in_order(flags & BIG_ENDIAN != 0);
        segment.u32("the version")?;
        let next = segment.u64("the offset of the next segment")?;
        let raw = segment.u64("the offset of the raw data")?;
        // A segment that was being written when the program ended reaches to the end.
        let size = if next == u64::MAX {
            segment.left()
        } else {
            usize::try_from(next).unwrap_or(usize::MAX)
        };
        file = segment;
        let content = file.take(size, "a segment")?;
        let Some(raw) = usize::try_from(raw)
            .ok()
            .filter(|raw| *raw <= content.len())
        else {
            return Err(Error::new(
                place,
                format!(
                    "byte {start}: the raw data of a segment begin behind its end; is the file damaged?"
                ),
            ));
        };
        let big_endian = flags & BIG_ENDIAN != 0;
        if flags & META != 0 {
            if flags & NEW_LIST != 0 {
                active.clear();
            }
            let inside = format!("{place}: metadata of the segment at byte {start}");
            metadata(
                Bytes::new(&inside, &content[..raw], big_endian),
                &mut channels,
                &mut names,
                &mut active,
            )?;
        }
        if flags & RAW != 0 && raw < content.len() {
            if flags & DAQMX != 0 {
                return Err(Error::new(
                    place,
                    format!(
                        "byte {start}: raw data of DAQmx are not read; expected numbers, export them as such"
                    ),
                ));
            }
            raw_data(place, start, &content[raw..], flags, &active, &mut channels)?;
        }
    }
    let mut table_rate = None;
    let mut arrays = Vec::new();
    for name in names {
        let Some(channel) = channels
            .remove(&name)
            .filter(|channel| !channel.values.is_empty())
        else {
            continue;
        };
        let number = |key: &str| match channel.properties.get(key) {
            Some(Property::Number(value)) => Some(*value),
            _ => None,
        };
        if let Some(step_s) = number("wf_increment").filter(|step| *step > 0.0) {
            table_rate = Some(1.0 / step_s);
        }
        let unit = ["unit_string", "NI_UnitDescription", "Unit"]
            .iter()
            .find_map(|key| match channel.properties.get(*key) {
                Some(Property::Text(text)) if !text.is_empty() => Some(text.clone()),
                _ => None,
            });
        let short = name
            .rsplit("'/'")
            .next()
            .unwrap_or(&name)
            .trim_matches(['/', '\''])
            .to_owned();
        let called = unit.map_or(short.clone(), |unit| format!("{short} [{unit}]"));
        arrays.push((called, scaled(place, &short, &channel)?));
    }
    let mut table = Table::from_arrays(place, arrays)?;
    table.sample_rate_hz = table.sample_rate_hz.or(table_rate);
    Ok(table)
}

fn string(file: &mut Bytes, what: &str) -> Result<String> {
    let length = file.u32(what)? as usize;
    Ok(String::from_utf8_lossy(file.take(length, what)?).into_owned())
}

fn kind_of(code: u32) -> Option<FileKind> {
    Some(match code {
        1 => FileKind::I8,
        2 => FileKind::I16,
        3 => FileKind::I32,
        4 => FileKind::I64,
        5 | 0x21 => FileKind::U8,
        6 => FileKind::U16,
        7 => FileKind::U32,
        8 => FileKind::U64,
        9 | 0x19 => FileKind::F32,
        10 | 0x1a => FileKind::F64,
        _ => return None,
    })
}

fn metadata(
    mut file: Bytes,
    channels: &mut BTreeMap<String, Channel>,
    names: &mut Vec<String>,
    active: &mut Vec<String>,
) -> Result<()> {
    for _ in 0..file.u32("the number of objects")? {
        let path = string(&mut file, "the path of an object")?;
        if !channels.contains_key(&path) {
            names.push(path.clone());
        }
        let channel = channels.entry(path.clone()).or_default();
        let index = file.u32("the index of raw data")?;
        match index {
            u32::MAX => active.retain(|other| *other != path),
            0 => {
                if channel.layout.is_none() {
                    return file
                        .wrong(format!("{path} refers to the layout of an earlier segment, and this is the first; is the file damaged?"));
                }
                if !active.contains(&path) {
                    active.push(path.clone());
                }
            }
            0x1269 | 0x1369 => {
                return file.wrong(format!(
                    "{path} holds raw data of DAQmx, which are not read; export numbers"
                ));
            }
            _ => {
                let code = file.u32("the type of raw data")?;
                let dimension = file.u32("the dimension of raw data")?;
                let values = file.u64("the number of values")?;
                if dimension != 1 {
                    return file.wrong(format!(
                        "{path} has dimension {dimension}; expected 1, is the file damaged?"
                    ));
                }
                if code == STRING {
                    file.u64("the size of strings")?;
                }
                let Some(kind) = kind_of(code) else {
                    return file.wrong(format!("{path} holds values of type {code:#x}; expected numbers, export it without such channels"));
                };
                let values = usize::try_from(values).unwrap_or(usize::MAX);
                channel.layout = Some(Layout { kind, values });
                if !active.contains(&path) {
                    active.push(path.clone());
                }
            }
        }
        for _ in 0..file.u32("the number of properties")? {
            let name = string(&mut file, "the name of a property")?;
            let value = property(&mut file)?;
            channel.properties.insert(name, value);
        }
    }
    Ok(())
}

fn property(file: &mut Bytes) -> Result<Property> {
    let code = file.u32("the type of a property")?;
    match (code, kind_of(code)) {
        (STRING, _) => Ok(Property::Text(string(file, "a property")?)),
        (TIMESTAMP, _) => file.take(16, "a time").map(|_| Property::Other),
        (_, Some(kind)) => {
            let big_endian = file.is_big_endian();
            Ok(Property::Number(
                kind.number(file.take(kind.size(), "a property")?, big_endian),
            ))
        }
        (0x0008_000c, _) => file.take(8, "a property").map(|_| Property::Other),
        (0x0010_000d, _) => file.take(16, "a property").map(|_| Property::Other),
        (0, _) => Ok(Property::Other),
        _ => file.wrong(format!(
            "a property of the unknown type {code:#x}; is the file damaged?"
        )),
    }
}

/// The values of one segment: chunks of all channels one after the other, or of one value of each.
fn raw_data(
    place: &str,
    start: usize,
    raw: &[u8],
    flags: u32,
    active: &[String],
    channels: &mut BTreeMap<String, Channel>,
) -> Result<()> {
    let layouts: Vec<(&String, Layout)> = active
        .iter()
        .filter_map(|path| Some((path, channels.get(path)?.layout?)))
        .collect();
    let big_endian = flags & BIG_ENDIAN != 0;
    let size_of = |layout: &Layout| layout.values.checked_mul(layout.kind.size());
    let chunk = layouts.iter().try_fold(0_usize, |sum, (_, layout)| {
        sum.checked_add(size_of(layout)?)
    });
    let Some(chunk) = chunk.filter(|chunk| *chunk > 0) else {
        return Err(Error::new(
            place,
            format!(
                "byte {start}: a segment holds raw data, but no channel says how many; is the file damaged?"
            ),
        ));
    };
    let layouts: Vec<(String, Layout)> = layouts
        .into_iter()
        .map(|(path, layout)| (path.clone(), layout))
        .collect();
    if !raw.len().is_multiple_of(chunk) && flags & INTERLEAVED == 0 {
        return Err(Error::new(
            place,
            format!(
                "byte {start}: a segment has {} bytes of raw data; expected whole chunks of {chunk}, is the file cut off?",
                raw.len()
            ),
        ));
    }
    if flags & INTERLEAVED != 0 {
        let row: usize = layouts.iter().map(|(_, layout)| layout.kind.size()).sum();
        for values in raw.chunks_exact(row) {
            let mut at = 0;
            for (path, layout) in &layouts {
                let size = layout.kind.size();
                let number = layout.kind.number(&values[at..at + size], big_endian);
                channels
                    .entry(path.clone())
                    .or_default()
                    .values
                    .push(number);
                at += size;
            }
        }
        return Ok(());
    }
    for chunk in raw.chunks_exact(chunk) {
        let mut at = 0;
        for (path, layout) in &layouts {
            let size = layout.values * layout.kind.size();
            channels
                .entry(path.clone())
                .or_default()
                .values
                .extend(layout.kind.numbers(&chunk[at..at + size], big_endian));
            at += size;
        }
    }
    Ok(())
}

/// Values with the scales that the channel declares: straight lines and polynomials.
fn scaled(place: &str, name: &str, channel: &Channel) -> Result<Vec<f64>> {
    let number = |key: String| match channel.properties.get(&key) {
        Some(Property::Number(value)) => Some(*value),
        _ => None,
    };
    let mut values = channel.values.clone();
    let is_unscaled = matches!(channel.properties.get("NI_Scaling_Status"), Some(Property::Text(text)) if text == "unscaled");
    let scales = number("NI_Number_Of_Scales".into())
        .filter(|_| is_unscaled)
        .unwrap_or(0.0)
        .clamp(0.0, 16.0) as usize;
    for i in 0..scales {
        let Some(Property::Text(kind)) =
            channel.properties.get(&format!("NI_Scale[{i}]_Scale_Type"))
        else {
            continue;
        };
        let coefficients: Vec<f64> = match kind.as_str() {
            "Linear" => ["Linear_Y_Intercept", "Linear_Slope"]
                .iter()
                .filter_map(|key| number(format!("NI_Scale[{i}]_{key}")))
                .collect(),
            "Polynomial" => {
                let size = number(format!("NI_Scale[{i}]_Polynomial_Coefficients_Size"))
                    .unwrap_or(4.0)
                    .clamp(0.0, 32.0) as usize;
                (0..size)
                    .filter_map(|c| number(format!("NI_Scale[{i}]_Polynomial_Coefficients[{c}]")))
                    .collect()
            }
            _ => {
                return Err(Error::new(
                    place,
                    format!(
                        "channel `{name}` has a scale of kind {kind}; expected Linear or Polynomial"
                    ),
                ));
            }
        };
        for value in &mut values {
            *value = coefficients
                .iter()
                .rev()
                .fold(0.0, |sum, c| sum * *value + c);
        }
    }
    Ok(values)
}
