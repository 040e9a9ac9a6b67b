//! How a text writes its numbers: what stands between columns, and the decimal sign.

/// What stands between columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// A character; two of them have an empty cell between them.
    Character(char),
    /// Any run of spaces and tabs.
    Spaces,
}

impl Separator {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Character('\t') => "tabs",
            Self::Character(';') => "semicolons",
            Self::Character(',') => "commas",
            Self::Character(_) => "bars",
            Self::Spaces => "spaces",
        }
    }

    /// The cells of a line, without the quotes around them. Quoted cells may hold the separator.
    pub fn cells(self, line: &str) -> Vec<&str> {
        match self {
            Self::Spaces => line.split_whitespace().map(unquoted).collect(),
            Self::Character(separator) if !line.contains('"') => {
                line.split(separator).map(str::trim).collect()
            }
            Self::Character(separator) => {
                let (mut cells, mut start, mut quoted) = (Vec::new(), 0, false);
                for (at, c) in line.char_indices() {
                    if c == '"' {
                        quoted = !quoted;
                    } else if c == separator && !quoted {
                        cells.push(unquoted(&line[start..at]));
                        start = at + c.len_utf8();
                    }
                }
                cells.push(unquoted(&line[start..]));
                cells
            }
        }
    }
}

fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"')
        .and_then(|c| c.strip_suffix('"'))
        .unwrap_or(cell)
        .trim()
}

/// A number with a decimal point, or with a comma where commas do not separate columns; a time of day in
/// seconds.
pub fn number(cell: &str, separator: Separator) -> Option<f64> {
    if let Ok(value) = cell.parse() {
        return Some(value);
    }
    if cell.len() > 40 {
        return None;
    }
    if separator != Separator::Character(',') && cell.contains(',') && !cell.contains('.') {
        return cell.replacen(',', ".", 1).parse().ok();
    }
    if cell.contains(':') {
        return clock(cell);
    }
    // Fortran writes exponents with a D.
    if cell.contains(['d', 'D']) {
        cell.replace(['d', 'D'], "e").parse().ok()
    } else {
        None
    }
}

/// `12:34:56.789`, behind a date `2024-01-31` or not, as seconds (of the day, or since 1970).
fn clock(cell: &str) -> Option<f64> {
    let cell = cell.trim_end_matches('Z');
    let (date, time) = cell
        .split_once(['T', ' '])
        .map_or((None, cell), |(date, time)| (Some(date), time));
    let mut parts = time.split(':');
    let (hours, minutes) = (
        parts.next()?.parse::<u32>().ok()?,
        parts.next()?.parse::<u32>().ok()?,
    );
    let seconds: f64 = parts.next()?.replace(',', ".").parse().ok()?;
    if parts.next().is_some() || hours > 23 || minutes > 59 || !(0.0..61.0).contains(&seconds) {
        return None;
    }
    let days = match date {
        Some(date) => days_since_1970(date)?,
        None => 0,
    };
    Some(days as f64 * 86_400.0 + f64::from(hours * 3600 + minutes * 60) + seconds)
}

/// Days from 1970-01-01 to a date of the proleptic Gregorian calendar.
fn days_since_1970(date: &str) -> Option<i64> {
    let mut parts = date
        .split(['-', '/', '.'])
        .map(|part| part.parse::<i64>().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || !(1..=9999).contains(&year) {
        return None;
    }
    // Years begin in March, so that the leap day is the last.
    let (year, month) = if month > 2 {
        (year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let era = year.div_euclid(400);
    let year_of_era = year - era * 400;
    let day_of_year = (153 * month + 2) / 5 + day - 1;
    Some(
        era * 146_097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year
            - 719_468,
    )
}

/// Separators in the order in which they are tried; earlier ones win where both make numbers of everything.
const SEPARATORS: [Separator; 5] = [
    Separator::Character('\t'),
    Separator::Character(';'),
    Separator::Character(','),
    Separator::Character('|'),
    Separator::Spaces,
];

/// The separator that makes numbers of most cells of these lines.
pub fn separator_of(lines: &[&str]) -> Separator {
    let score = |separator: Separator| {
        let (mut whole, mut cells_of_numbers) = (0, 0);
        for line in lines {
            let cells = separator.cells(line);
            let filled = cells.iter().filter(|c| !c.is_empty()).count();
            let numbers = cells
                .iter()
                .filter(|c| number(c, separator).is_some())
                .count();
            whole += usize::from(numbers == filled && numbers >= 2);
            cells_of_numbers += if cells.len() > 1 { numbers } else { 0 };
        }
        (whole, cells_of_numbers)
    };
    // `max_by_key` keeps the last of equals.
    SEPARATORS
        .into_iter()
        .rev()
        .max_by_key(|s| score(*s))
        .unwrap_or(Separator::Character(','))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separators_and_decimal_signs() {
        for (line, separator, cells) in [
            ("0.1,2,3", Separator::Character(','), 3),
            ("0,1;2,5;3", Separator::Character(';'), 3),
            ("0,1\t2,5\t3", Separator::Character('\t'), 3),
            ("  0.1   2.5 3", Separator::Spaces, 3),
            ("0,1 2,5 3,0", Separator::Spaces, 3),
            ("0.1, 2.5, 3.0", Separator::Character(','), 3),
            ("1,2", Separator::Character(','), 2),
            (",,,-0.5,0.1,", Separator::Character(','), 6),
        ] {
            let found = separator_of(&[line]);
            assert_eq!(found, separator, "{line}");
            assert_eq!(found.cells(line).len(), cells, "{line}");
        }
        assert_eq!(Separator::Character(',').cells("\"a, b\",2"), ["a, b", "2"]);
    }

    #[test]
    fn numbers_of_other_habits() {
        let comma = Separator::Character(';');
        assert_eq!(number("1,5", comma), Some(1.5));
        assert_eq!(number("1.5D-03", comma), Some(1.5e-3));
        assert_eq!(number("1.234,5", comma), None);
        assert_eq!(number("1,5", Separator::Character(',')), None);
        assert_eq!(number("00:01:02.5", comma), Some(62.5));
        assert_eq!(number("1970-01-02T00:00:01", comma), Some(86_401.0));
        assert_eq!(number("2024-02-29 00:00:00", comma), Some(1_709_164_800.0));
        assert_eq!(number("12:99:00", comma), None);
    }
}
