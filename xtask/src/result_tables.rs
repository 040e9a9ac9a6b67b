//! Tables of the documents, made from `benchmarks/results/*.csv`.
//!
//! A page holds `<!-- table: NAME ARGUMENTS -->`, the table, and `<!-- end of table -->`. `cargo xtask
//! tables` writes what is between, and the check fails where it is stale.
//!
//! * `csv FILE [COLUMN ..]`: a results file, all columns or these;
//! * `finder SET ..`: cases of the finder's sets; `finder-counts SET ..`: how many of each mark;
//! * `chapters`: printed results of the thesis by chapter, met and missed.

use crate::finder_sets::results::{ResultRow, Results};
use crate::workspace::root;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const BEGIN: &str = "<!-- table: ";
const END: &str = "<!-- end of table -->";
/// The label whose results the documents show.
const LABEL: &str = "0_1_0";

/// Writes every table, or fails where one is not what the results give.
pub fn write() -> Result<(), String> {
    for (page, text) in pages()? {
        let fresh = with_tables(&page, &text)?;
        if fresh != text {
            std::fs::write(&page, fresh).map_err(|e| format!("{}: {e}", page.display()))?;
            println!("{}", page.display());
        }
    }
    Ok(())
}

/// Fails where a table is not what the results give.
pub fn check() -> Result<(), String> {
    for (page, text) in pages()? {
        if with_tables(&page, &text)? != text {
            return Err(format!(
                "{}: a table is not that of benchmarks/results; run `cargo xtask tables`",
                page.display()
            ));
        }
    }
    Ok(())
}

/// Pages with tables, and their texts.
fn pages() -> Result<Vec<(PathBuf, String)>, String> {
    let mut paths = vec![root().join("README.md")];
    for folder in ["docs/results", "docs/reference", "docs/guides"] {
        let entries =
            std::fs::read_dir(root().join(folder)).map_err(|e| format!("{folder}: {e}"))?;
        paths.extend(
            entries
                .flatten()
                .map(|entry| entry.path())
                .filter(|path| path.extension().is_some_and(|e| e == "md")),
        );
    }
    paths.sort();
    let with_table = |path: PathBuf| match std::fs::read_to_string(&path) {
        Ok(text) => text.contains(BEGIN).then_some(Ok((path, text))),
        Err(error) => Some(Err(format!("{}: {error}", path.display()))),
    };
    paths.into_iter().filter_map(with_table).collect()
}

fn with_tables(page: &Path, text: &str) -> Result<String, String> {
    let at = |message: String| format!("{}: {message}", page.display());
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once(BEGIN) {
        let (what, after) = after
            .split_once(" -->")
            .ok_or_else(|| at(format!("`{BEGIN}` has no end")))?;
        let (_, behind) = after
            .split_once(END)
            .ok_or_else(|| at(format!("table `{what}` has no `{END}`")))?;
        let _ = write!(
            out,
            "{before}{BEGIN}{what} -->\n\n{}\n{END}",
            table(what).map_err(at)?
        );
        rest = behind;
    }
    out.push_str(rest);
    Ok(out)
}

/// A table by its name.
fn table(what: &str) -> Result<String, String> {
    let mut words = what.split_whitespace();
    let name = words.next().unwrap_or_default();
    let arguments: Vec<&str> = words.collect();
    match name {
        "csv" => of_csv(
            arguments.first().ok_or("`csv` needs a file")?,
            &arguments[1..],
        ),
        "finder" => Ok(of_cases(&finder_rows(&arguments)?)),
        "finder-counts" => of_counts(&arguments),
        "chapters" => of_chapters(),
        other => Err(format!(
            "no table `{other}`; expected csv, finder, finder-counts or chapters"
        )),
    }
}

fn markdown(head: &[String], rows: &[Vec<String>]) -> String {
    let mut out = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for row in rows {
        let _ = writeln!(
            out,
            "| {} |",
            row.iter()
                .map(|cell| cell.replace('|', "/"))
                .collect::<Vec<_>>()
                .join(" | ")
        );
    }
    out
}

/// Rows of a file of results, header first; fields in quotes may hold commas.
fn read(file: &str) -> Result<Vec<Vec<String>>, String> {
    let path = root().join("benchmarks/results").join(file);
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text
        .lines()
        .filter(|line| !line.trim().is_empty() && !line.starts_with('#'))
        .map(fields)
        .collect())
}

fn fields(line: &str) -> Vec<String> {
    let (mut out, mut quoted) = (vec![String::new()], false);
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        let last = out.len() - 1;
        match c {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                out[last].push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => out.push(String::new()),
            c => out[last].push(c),
        }
    }
    out
}

fn of_csv(file: &str, columns: &[&str]) -> Result<String, String> {
    let rows = read(file)?;
    let (head, rows) = rows
        .split_first()
        .ok_or_else(|| format!("{file} is empty"))?;
    let places: Vec<usize> = if columns.is_empty() {
        (0..head.len()).collect()
    } else {
        let place = |name: &&str| {
            head.iter()
                .position(|h| h == name)
                .ok_or_else(|| format!("{file} has no column {name}"))
        };
        columns.iter().map(place).collect::<Result<_, _>>()?
    };
    let taken = |row: &Vec<String>| {
        places
            .iter()
            .map(|p| row.get(*p).cloned().unwrap_or_default())
            .collect::<Vec<_>>()
    };
    let head: Vec<String> = taken(head)
        .iter()
        .map(|name| name.replace('_', " "))
        .collect();
    Ok(markdown(&head, &rows.iter().map(taken).collect::<Vec<_>>()))
}

fn finder_rows(sets: &[&str]) -> Result<Vec<ResultRow>, String> {
    let rows = Results::open(LABEL)?.rows;
    Ok(sets
        .iter()
        .flat_map(|set| rows.iter().filter(move |row| row.set == *set).cloned())
        .collect())
}

fn nm(um: Option<f64>) -> String {
    um.map_or_else(String::new, |um| match 1e3 * um {
        nm if nm >= 100.0 => format!("{nm:.0}"),
        nm => format!("{nm:.1}"),
    })
}

/// What is named, in words.
fn said(row: &ResultRow) -> String {
    if row.said.is_empty() {
        return "nothing".into();
    }
    let one = |name: &str| match name.strip_suffix('*') {
        Some(values) => format!("other values of {}", values.replace('_', " ")),
        None => name.replace('_', " "),
    };
    let finding = |names: &str| names.split('|').map(one).collect::<Vec<_>>().join(" or ");
    row.said
        .split('+')
        .map(finding)
        .collect::<Vec<_>>()
        .join("; ")
}

/// Nothing is missing and nothing is named, although the error is above the noise.
fn nothing_to_name(row: &ResultRow) -> bool {
    row.truth == "nothing" && row.said.is_empty()
}

fn of_cases(rows: &[ResultRow]) -> String {
    let head = [
        "recording",
        "verdict",
        "reported",
        "error before, nm",
        "after",
        "mark",
    ]
    .map(String::from);
    let mark = |row: &ResultRow| match row.mark.as_str() {
        "in set" => "within an \"or\"".to_owned(),
        "long or" => "within a long \"or\"".to_owned(),
        "missed" if nothing_to_name(row) => "nothing named".into(),
        "missed" => "not named".into(),
        mark => mark.to_owned(),
    };
    let cells = |row: &ResultRow| {
        vec![
            row.case.replace('_', " "),
            format!("`{}`", row.verdict),
            said(row),
            nm(row.before_um),
            nm(row.after_um),
            mark(row),
        ]
    };
    markdown(&head, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn of_counts(sets: &[&str]) -> Result<String, String> {
    let head = [
        "set",
        "cases",
        "right",
        "within an \"or\"",
        "within a long one",
        "not named",
        "wrong \"or\"",
        "wrong",
    ]
    .map(String::from);
    let mut rows = Vec::new();
    for set in sets {
        let of_set = finder_rows(&[set])?;
        let mark = |row: &ResultRow| {
            if nothing_to_name(row) {
                "right".to_owned()
            } else {
                row.mark.clone()
            }
        };
        let count = |marks: &[&str]| {
            of_set
                .iter()
                .filter(|row| marks.contains(&mark(row).as_str()))
                .count()
                .to_string()
        };
        rows.push(vec![
            format!("`{set}`"),
            of_set.len().to_string(),
            count(&["right"]),
            count(&["in set"]),
            count(&["long or"]),
            count(&["missed", "absorbed"]),
            count(&["wrong or"]),
            count(&["wrong"]),
        ]);
    }
    Ok(markdown(&head, &rows))
}

fn of_chapters() -> Result<String, String> {
    let rows = read("reproduce.csv")?;
    let (head, rows) = rows.split_first().ok_or("reproduce.csv is empty")?;
    let met = head
        .iter()
        .position(|name| name == "met")
        .ok_or("reproduce.csv has no column met")?;
    let on_reference = head
        .iter()
        .position(|name| name == "met_on_reference")
        .ok_or("reproduce.csv has no column met_on_reference")?;
    let line = |name: &str, of: &[&Vec<String>]| {
        let count = |at: usize, word: &str| {
            of.iter()
                .filter(|row| row.get(at).is_some_and(|m| m == word))
                .count()
                .to_string()
        };
        vec![
            name.to_owned(),
            of.len().to_string(),
            count(met, "met"),
            count(met, "missed"),
            count(on_reference, "met"),
        ]
    };
    let subjects = [
        ("3", "3, stick-slip actuator"),
        ("4", "4, hysteresis and its inverse"),
        ("5", "5, hysteresis, vibration and creep together"),
        ("6", "6, PIDSM, PID, ideal sliding mode, boundary layer"),
        ("7", "7, observer and observer-controller"),
    ];
    let mut out: Vec<Vec<String>> = subjects
        .iter()
        .map(|(chapter, subject)| {
            let prefix = format!("ch{chapter}.");
            line(
                subject,
                &rows
                    .iter()
                    .filter(|row| row[0].starts_with(&prefix))
                    .collect::<Vec<_>>(),
            )
        })
        .collect();
    out.push(line("all", &rows.iter().collect::<Vec<_>>()));
    Ok(markdown(
        &[
            "chapter",
            "printed results",
            "met",
            "missed",
            "met on the reference bench",
        ]
        .map(String::from),
        &out,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quoted_field_may_hold_commas_and_quotes() {
        assert_eq!(fields("a,\"b, \"\"c\"\"\",d"), ["a", "b, \"c\"", "d"]);
    }

    #[test]
    fn what_is_outside_the_marks_stays() {
        let page = "before\n<!-- table: finder-counts no_such_set -->\nold\n<!-- end of table -->\nafter\n";
        let fresh = with_tables(Path::new("page.md"), page).unwrap();
        assert!(
            fresh.starts_with("before\n<!-- table: ")
                && fresh.ends_with("<!-- end of table -->\nafter\n"),
            "{fresh}"
        );
        assert!(
            !fresh.contains("old") && fresh.contains("| `no_such_set` | 0 |"),
            "{fresh}"
        );
        assert_eq!(with_tables(Path::new("page.md"), &fresh).unwrap(), fresh);
    }

    #[test]
    fn an_unknown_table_is_an_error_with_the_page() {
        let error = with_tables(
            Path::new("page.md"),
            "<!-- table: nonsense -->\n<!-- end of table -->",
        )
        .unwrap_err();
        assert!(
            error.contains("page.md") && error.contains("nonsense"),
            "{error}"
        );
    }
}
