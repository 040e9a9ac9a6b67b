//! Text in columns: CSV of every habit, exports of loggers and oscilloscopes.
//!
//! The rows of numbers are found from the end of the file, where no header is; what stands above them is read
//! as a header.

use super::dialect::{Separator, number, separator_of};
use super::header::{self, Header, HeaderLine};
use super::hints::{FORMATS, Hints};
use super::text_encoding::decode;
use crate::dataset::table::{Column, Table};
use crate::error::{Error, Result};

/// Lines that are looked at to see how a text writes its numbers.
const SAMPLE: usize = 101;
/// A column of numbers has one in at least this share of the rows: of two channels, one may be shorter.
const NUMBERS_MIN: f64 = 0.25;
/// As many lines of numbers alone above the rows are no header.
const NUMBERS_ABOVE_MAX: usize = 3;

/// How the rows of a text are made.
struct Form {
    separator: Separator,
    /// Cells of a row.
    width: usize,
    /// Cells that hold numbers.
    numbers: Vec<usize>,
    /// Cells that hold text.
    texts: Vec<usize>,
}

/// Reads text in columns.
///
/// # Errors
/// No text, no rows of numbers, rows that are ragged or hold text or NaN: with the row, counted from 1, and
/// the column.
pub fn read(place: &str, bytes: &[u8], hints: Hints) -> Result<Table> {
    let (mut text, assumed) = decode(place, bytes, FORMATS)?;
    if !text.contains('\n') {
        // Ends of lines as old Macintoshes wrote them.
        text = text.replace('\r', "\n").into();
    }
    let lines: Vec<HeaderLine> = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line))
        .skip(hints.skip_rows)
        .collect();
    let mut filled: Vec<HeaderLine> = lines
        .iter()
        .copied()
        .filter(|(_, line)| !line.trim().is_empty())
        .collect();
    if filled.is_empty() {
        let all = text.lines().count();
        return Err(Error::new(
            place,
            match hints.skip_rows {
                0 => "is empty; expected rows of numbers".to_owned(),
                skipped => format!(
                    "has {all} lines, of which the first {skipped} are to be skipped; expected rows of numbers behind them"
                ),
            },
        ));
    }
    let form = Form::of(&filled).ok_or_else(|| {
        let (line, text) = filled[filled.len() - 1];
        let shown: String = text.chars().take(40).collect();
        Error::new(
            place,
            format!(
                "has no rows of numbers (row {line}: \"{shown}\"); expected columns of numbers"
            ),
        )
    })?;
    let cut = if text.ends_with(['\n', '\r']) {
        None
    } else {
        form.cut_off(&filled)
    };
    if cut.is_some() {
        filled.pop();
    }
    // LabVIEW says where its headers end, and has numbers in them.
    let header_end = filled
        .iter()
        .rposition(|(_, line)| line.starts_with("***End_of_Header***"))
        .map_or(0, |at| at + 1);
    let first = filled[header_end..]
        .iter()
        .position(|(_, line)| form.is_row(line))
        .map_or(filled.len(), |at| at + header_end);
    form.refuse_other_notation(
        place,
        &filled[header_end.min(first)..first],
        filled.get(first).copied(),
    )?;
    let header = header::read(
        place,
        &filled[..first],
        form.separator,
        form.width,
        &form.numbers,
    )?;
    let mut table = rows(place, &filled[first..], &form, &header)?;
    table.notes.extend(assumed);
    table.notes.extend(cut.map(|line| {
        format!("row {line} is the last and has no line end: it may be cut off, and is left aside")
    }));
    table.notes.extend(form.texts.iter().map(|&c| {
        let name = header
            .names
            .get(c)
            .filter(|n| !n.is_empty())
            .map_or_else(String::new, |n| format!(" `{n}`"));
        format!("column {}{name} holds no numbers and is left aside", c + 1)
    }));
    table.sample_rate_hz = header.step_s.map(|step_s| 1.0 / step_s);
    if let (Some((start_s, step_s)), Some(count)) = (header.count, table.columns.first_mut()) {
        count
            .values
            .iter_mut()
            .for_each(|v| *v = start_s + *v * step_s);
        (count.name, count.unit) = ("time".into(), Some("s".into()));
    }
    table.finite()
}

impl Form {
    /// The form of most of the rows in the last three quarters.
    fn of(lines: &[HeaderLine]) -> Option<Self> {
        let late = &lines[lines.len() / 4..];
        let sample: Vec<&str> = (0..late.len().min(SAMPLE))
            .map(|i| late[i * late.len() / late.len().min(SAMPLE)].1)
            .collect();
        let separator = separator_of(&sample);
        let rows: Vec<Vec<&str>> = sample.iter().map(|line| separator.cells(line)).collect();
        let widths: Vec<usize> = rows.iter().map(Vec::len).collect();
        let as_wide = |width: usize| widths.iter().filter(|w| **w == width).count();
        let width = widths.iter().copied().max_by_key(|w| (as_wide(*w), *w))?;
        let share = |what: &dyn Fn(&str) -> bool, c: usize| {
            rows.iter()
                .filter(|row| row.get(c).is_some_and(|cell| what(cell)))
                .count() as f64
                / rows.len() as f64
        };
        let numbers: Vec<usize> = (0..width)
            .filter(|&c| share(&|cell| number(cell, separator).is_some(), c) >= NUMBERS_MIN)
            .collect();
        let texts = (0..width)
            .filter(|c| !numbers.contains(c) && share(&|cell| !cell.is_empty(), *c) >= 0.5)
            .collect();
        (!numbers.is_empty()).then_some(Self {
            separator,
            width,
            numbers,
            texts,
        })
    }

    /// The last row of a text that ends without a line end, where it has too few cells, or its last number
    /// fewer characters than that of an earlier row: what a file that was cut off leaves looks like another
    /// number.
    fn cut_off(&self, lines: &[HeaderLine]) -> Option<usize> {
        let ((line, last), before) = lines.split_last()?;
        let cells = self.separator.cells(last);
        let needed = self.numbers.last().map_or(0, |last| last + 1);
        if cells.len() < needed {
            // Words that somebody wrote below the numbers are no row.
            let begins_a_number = |cell: &str| {
                cell.is_empty()
                    || cell
                        .trim_start_matches('"')
                        .starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
            };
            return cells
                .iter()
                .enumerate()
                .all(|(c, cell)| !self.numbers.contains(&c) || begins_a_number(cell))
                .then_some(*line);
        }
        let length = |line: &str| {
            self.separator
                .cells(line)
                .get(self.width - 1)
                .map(|cell| cell.len())
        };
        let longest = before
            .iter()
            .rev()
            .take(SAMPLE)
            .filter_map(|(_, line)| length(line))
            .max()?;
        (self.numbers.last() == Some(&(self.width - 1)) && length(last)? < longest).then_some(*line)
    }

    /// Rows that are written in another way than the rest stand in front of it like a header, and would be
    /// lost with it.
    fn refuse_other_notation(
        &self,
        place: &str,
        above: &[HeaderLine],
        first_row: Option<HeaderLine>,
    ) -> Result<()> {
        let numbers_in = |text: &str| {
            let separator = separator_of(&[text]);
            let cells = separator.cells(text);
            let filled = cells.iter().filter(|cell| !cell.is_empty());
            if filled.clone().all(|cell| number(cell, separator).is_some()) {
                filled.count()
            } else {
                0
            }
        };
        let of_numbers: Vec<HeaderLine> = above
            .iter()
            .copied()
            .filter(|(_, text)| numbers_in(text) >= 2)
            .collect();
        let is_row = of_numbers.last().is_some_and(|(_, text)| {
            numbers_in(text) == self.numbers.len() && self.numbers.len() > 1
        });
        match (of_numbers.first(), first_row) {
            (Some((line, text)), Some((row, other)))
                if is_row || of_numbers.len() >= NUMBERS_ABOVE_MAX =>
            {
                let shown = |text: &str| text.chars().take(40).collect::<String>();
                Err(Error::new(
                    place,
                    format!(
                        "row {line} (\"{}\") is written in another way than row {row} (\"{}\") and the rows that follow; expected one decimal \
                         sign, one separator and as many columns throughout, or --skip-rows {} where what stands above is none of the record",
                        shown(text),
                        shown(other),
                        row - 1
                    ),
                ))
            }
            _ => Ok(()),
        }
    }

    fn is_row(&self, line: &str) -> bool {
        let cells = self.separator.cells(line);
        self.numbers.iter().all(|&c| {
            cells
                .get(c)
                .is_some_and(|cell| number(cell, self.separator).is_some())
        })
    }
}

fn rows(place: &str, lines: &[HeaderLine], form: &Form, header: &Header) -> Result<Table> {
    let mut table = Table {
        place: place.to_owned(),
        ..Table::default()
    };
    table.columns = form
        .numbers
        .iter()
        .map(|&c| column(c, header, lines.len()))
        .collect();
    // Where a column ended before the others.
    let mut ended: Vec<Option<usize>> = vec![None; form.numbers.len()];
    let (mut with_point, mut with_comma) = (None, None);
    // The first value that is not finite, how many rows more hold one, and the last of them.
    let mut not_finite: Option<(String, usize, usize)> = None;
    let mut row = 0;
    for &(line, text) in lines {
        if text.starts_with(['#', '%']) {
            continue;
        }
        let wrong = |what: String| Err(Error::new(place, format!("row {line}{what}")));
        let cells = form.separator.cells(text);
        if cells.iter().all(|cell| cell.is_empty()) {
            continue;
        }
        let needed = form.numbers.last().map_or(0, |last| last + 1);
        if cells.len() < needed || cells.iter().skip(form.width).any(|cell| !cell.is_empty()) {
            return wrong(format!(
                ": {} cells; expected {} as in the other rows",
                cells.len(),
                form.width
            ));
        }
        for (i, &c) in form.numbers.iter().enumerate() {
            let (cell, column) = (cells[c], &mut table.columns[i]);
            if cell.is_empty() {
                ended[i].get_or_insert(line);
                continue;
            }
            if let Some(blank) = ended[i] {
                return Err(Error::new(
                    place,
                    format!(
                        "row {blank}, {} is blank; expected a number",
                        column.called()
                    ),
                ));
            }
            let Some(value) = number(cell, form.separator) else {
                return wrong(format!(", {}: \"{cell}\" is not a number", column.called()));
            };
            if !value.is_finite() {
                let first = || (format!("row {line}, {}: {cell}", column.called()), 0, line);
                let (_, more, last) = not_finite.get_or_insert_with(first);
                (*more, *last) = (*more + usize::from(*last != line), line);
            }
            if cell.contains('.') {
                with_point.get_or_insert(line);
            } else if cell.contains(',') {
                with_comma.get_or_insert(line);
            }
            column.values.push(value);
        }
        if let (Some(point), Some(comma)) = (with_point, with_comma) {
            let (first, other) = if point < comma {
                ("point", "comma")
            } else {
                ("comma", "point")
            };
            return wrong(format!(
                ": a decimal {other}, but row {} has a decimal {first}; expected one of them",
                point.min(comma)
            ));
        }
        if table.line_of(row) != line {
            table.lines.push((row, line));
        }
        row += 1;
    }
    if let Some((first, more, last)) = not_finite {
        let others = match more {
            0 => String::new(),
            1 => format!(", and in row {last}"),
            _ => format!(", and in {more} more rows up to row {last}"),
        };
        return Err(Error::new(
            place,
            format!("{first}{others}; expected a finite number"),
        ));
    }
    if with_comma.is_some() {
        table.notes.push(format!(
            "{} between columns, commas as decimal sign",
            form.separator.name()
        ));
    }
    Ok(table)
}

fn column(cell: usize, header: &Header, rows: usize) -> Column {
    let mut column = Column::new(cell + 1, &header.names[cell], Vec::with_capacity(rows));
    if let Some(unit) = &header.units[cell] {
        column.unit = Some(unit.clone());
        column.name.clone_from(&header.names[cell]);
    }
    column
}
