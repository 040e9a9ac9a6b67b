//! What stands above the numbers of a text: names, units, and what loggers and oscilloscopes say there about
//! time.

use super::dialect::{Separator, number};
use crate::dataset::units::{Quantity, is_unit, split_name};
use crate::error::{Error, Result};

/// A line with its number in the file, counted from 1.
pub type HeaderLine<'a> = (usize, &'a str);

/// What a header says.
#[derive(Clone, Debug, Default)]
pub struct Header {
    /// Names by cell of a row; empty where none is given.
    pub names: Vec<String>,
    /// Units by cell of a row, where a line of their own gives them.
    pub units: Vec<Option<String>>,
    /// Time between samples, s.
    pub step_s: Option<f64>,
    /// Time of the first sample, s, and step, where a column only counts samples (Rigol).
    pub count: Option<(f64, f64)>,
}

/// Keys behind which the time between samples stands.
const STEP_KEYS: [&str; 6] = [
    "sample interval",
    "sampleinterval",
    "delta_x",
    "delta x",
    "sampling interval",
    "sampling period",
];
/// Keys behind which the sampling rate stands.
const RATE_KEYS: [&str; 5] = [
    "sample rate",
    "samplerate",
    "sampling rate",
    "sampling frequency",
    "sample_rate_hz",
];

/// Reads the lines above the first row of numbers. `width` is the number of cells of a row, `numbers` are
/// those that hold numbers.
///
/// # Errors
/// A row of numbers with a word that is no number, and a header of another width.
pub fn read(
    place: &str,
    above: &[HeaderLine],
    separator: Separator,
    width: usize,
    numbers: &[usize],
) -> Result<Header> {
    let lines: Vec<HeaderLine> = above
        .iter()
        .copied()
        .filter(|(_, text)| !bare(text).is_empty())
        .collect();
    let mut header = Header {
        names: vec![String::new(); width],
        units: vec![None; width],
        ..Header::default()
    };
    for (_, text) in &lines {
        header.take_keys(&separator.cells(text), numbers);
    }
    refuse_damaged_row(place, &lines, separator, width, numbers)?;
    let mut upwards = lines
        .iter()
        .rev()
        .map(|(line, text)| (*line, cells_of(text, separator, width, numbers)));
    let Some((line, mut last)) = upwards.next() else {
        return Ok(header);
    };
    let mut names_line = line;
    let mut counts = last.clone();
    if is_units(&last, numbers) {
        for &c in numbers {
            header.units[c] = last
                .get(c)
                .map(|u| u.trim_matches(['[', ']', '(', ')', ' ']))
                .filter(|u| !u.is_empty())
                .map(str::to_owned);
        }
        let Some((line, names)) = upwards.next() else {
            return Ok(header);
        };
        counts = last;
        (names_line, last) = (line, names);
    }
    header.take_count(&last, &counts, separator);
    let filled = last.iter().filter(|cell| !cell.is_empty()).count();
    // LabVIEW's comments have a name and no cells; nor have start and increment, whatever empty cells stand
    // behind either line.
    if header.count.is_some()
        || last.len() == width
        || last.len() > width
            && last[width..]
                .iter()
                .all(|c| c.is_empty() || *c == "Comment")
    {
        for &c in numbers {
            header.names[c] = last.get(c).copied().unwrap_or_default().to_owned();
        }
        // A channel's own time is in the unit of the first.
        for &c in numbers
            .iter()
            .skip(1)
            .filter(|c| is_said_again(&header.names, numbers, **c))
        {
            header.units[c] = header.units[c]
                .take()
                .or_else(|| header.units[numbers[0]].clone());
        }
    } else if filled == numbers.len() && filled > 1 {
        let names = last.iter().filter(|cell| !cell.is_empty());
        for (&c, name) in numbers.iter().zip(names) {
            header.names[c] = (*name).to_owned();
        }
    } else if lines.len() == 1 && filled > 1 && last.iter().any(|cell| is_name_of_signal(cell)) {
        let hint = if width == 2 * filled && separator == Separator::Character(',') {
            "; decimal commas between commas? Expected semicolons between columns, or decimal points"
        } else {
            ""
        };
        return Err(Error::new(
            place,
            format!(
                "row {}: {width} cells under a header of {filled}{hint}",
                names_line + 1
            ),
        ));
    }
    Ok(header)
}

/// A line without what marks it as a comment.
fn bare(text: &str) -> &str {
    text.trim()
        .trim_start_matches(['#', '%', '!'])
        .trim_start_matches("//")
        .trim()
}

/// The cells of a header; one that writes its cells in another way than the rows is read in its own.
fn cells_of<'a>(
    text: &'a str,
    separator: Separator,
    width: usize,
    numbers: &[usize],
) -> Vec<&'a str> {
    let text = if text.trim_start().starts_with(['#', '%', '!', '/']) {
        bare(text)
    } else {
        text
    };
    let fits = |cells: &[&str]| {
        cells.len() == width || cells.iter().filter(|c| !c.is_empty()).count() == numbers.len()
    };
    let own = separator.cells(text);
    if fits(&own) {
        return own;
    }
    let others = [',', ';', '\t']
        .map(Separator::Character)
        .into_iter()
        .chain([Separator::Spaces]);
    others
        .map(|other| other.cells(text))
        .find(|cells| cells.len() > 1 && fits(cells))
        .unwrap_or(own)
}

fn is_units(cells: &[&str], numbers: &[usize]) -> bool {
    let found: Vec<&str> = numbers
        .iter()
        .filter_map(|&c| cells.get(c))
        .copied()
        .filter(|cell| !cell.is_empty())
        .collect();
    !found.is_empty()
        && found.iter().all(|cell| is_unit(cell))
        && (found.iter().any(|cell| cell.len() > 1) || !looks_like_names(&found))
}

/// `t`, `u`, `y`, `v`, `s` in one line may be names or units; where the time is called `t` they are names.
fn looks_like_names(cells: &[&str]) -> bool {
    cells.iter().any(|cell| cell.eq_ignore_ascii_case("t"))
}

/// Whether a column is called as the first one is.
fn is_said_again(names: &[String], numbers: &[usize], column: usize) -> bool {
    let first = numbers.first().map_or("", |&first| names[first].as_str());
    !first.is_empty() && names[column].eq_ignore_ascii_case(first)
}

fn is_name_of_signal(cell: &str) -> bool {
    let (name, unit) = split_name(cell);
    Quantity::ALL
        .iter()
        .any(|q| q.likeness(&name, unit.as_deref()) > 0)
}

/// The last line above the numbers may be a row of numbers of which one is damaged: that is no header.
fn refuse_damaged_row(
    place: &str,
    lines: &[HeaderLine],
    separator: Separator,
    width: usize,
    numbers: &[usize],
) -> Result<()> {
    let Some((line, text)) = lines.last() else {
        return Ok(());
    };
    let cells = separator.cells(text);
    if cells.len() != width || text.trim_start().starts_with(['#', '%']) {
        return Ok(());
    }
    let is_number = |c: &usize| number(cells[*c], separator).is_some();
    let no_number = numbers
        .iter()
        .find(|c| !is_number(c) && !cells[**c].is_empty());
    let above_is_header = lines.len() > 1 && {
        let above = separator.cells(lines[lines.len() - 2].1);
        above.len() == width
            && numbers
                .iter()
                .all(|&c| !above[c].is_empty() && number(above[c], separator).is_none())
    };
    match no_number {
        Some(&c)
            if numbers.iter().any(is_number)
                && (numbers.first().is_some_and(is_number) || above_is_header) =>
        {
            Err(Error::new(
                place,
                format!(
                    "row {line}, column {}: \"{}\" is not a number",
                    c + 1,
                    cells[c]
                ),
            ))
        }
        _ => Ok(()),
    }
}

impl Header {
    /// Keys and values of loggers and oscilloscopes.
    fn take_keys(&mut self, cells: &[&str], numbers: &[usize]) {
        let key = cells
            .first()
            .map(|cell| cell.trim_end_matches([':', '=']).trim().to_lowercase())
            .unwrap_or_default();
        let key = key.split(['(', '[']).next().unwrap_or_default().trim();
        let value = || {
            cells[1..]
                .iter()
                .find_map(|cell| number(cell, Separator::Character(';')))
        };
        if STEP_KEYS.contains(&key) {
            self.step_s = value().filter(|v| *v > 0.0);
        } else if RATE_KEYS.contains(&key) {
            self.step_s = value().filter(|v| *v > 0.0).map(|v| 1.0 / v);
        } else if key == "y_unit_label" {
            // LabVIEW: one label for each channel, in the cells in which the channels stand.
            for &c in numbers.iter().filter(|c| **c > 0) {
                self.units[c] = cells.get(c).filter(|u| is_unit(u)).map(|u| (*u).to_owned());
            }
        } else if key == "vertical units" {
            let units: Vec<(usize, &str)> = cells
                .iter()
                .copied()
                .enumerate()
                .skip(1)
                .filter(|(_, cell)| is_unit(cell))
                .collect();
            // Each stands over its channel, unless what is there holds no numbers; then they come in the
            // order of the channels.
            if units
                .iter()
                .all(|(c, _)| numbers.iter().skip(1).any(|number| number == c))
            {
                units
                    .iter()
                    .for_each(|(c, unit)| self.units[*c] = Some((*unit).to_owned()));
            } else {
                numbers
                    .iter()
                    .skip(1)
                    .zip(&units)
                    .for_each(|(c, (_, unit))| self.units[*c] = Some((*unit).to_owned()));
            }
        } else if key == "horizontal units"
            && let (Some(&c), Some(unit)) = (numbers.first(), cells.get(1).filter(|u| is_unit(u)))
        {
            self.units[c] = Some((*unit).to_owned());
        }
    }

    /// `X,CH1,CH2,Start,Increment` over `Sequence,Volt,Volt,-1e-3,1e-6`, with or without commas at their
    /// ends: the first column counts samples.
    fn take_count(&mut self, names: &[&str], second: &[&str], separator: Separator) {
        let below = |wanted: &str| {
            let at = names
                .iter()
                .position(|name| name.eq_ignore_ascii_case(wanted))?;
            second.get(at).and_then(|cell| number(cell, separator))
        };
        if let (Some(start), Some(increment)) = (
            below("start"),
            below("increment").filter(|step| *step > 0.0),
        ) {
            self.count = Some((start, increment));
        }
    }
}
