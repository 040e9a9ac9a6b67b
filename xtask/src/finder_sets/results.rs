//! Results: one CSV for each label, one row for each case.

use super::answer::FinderAnswer;
use crate::cost::Cost;
use crate::workspace::root;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

const HEADER: &str = "set,case,truth,verdict,reason,said,issues,before_nm,after_nm,noise_nm,ends_nm,seconds,processor_s,mark,names";
const FOLDER: &str = "benchmarks/results";

/// One run.
#[derive(Clone, Debug, Default)]
pub struct ResultRow {
    /// The set.
    pub set: String,
    /// The case within it.
    pub case: String,
    /// What is true.
    pub truth: String,
    /// The verdict's word, or `refused`.
    pub verdict: String,
    /// Why it is undecidable.
    pub reason: String,
    /// What is named; `+` between findings, `|` where it is an "or", `*` behind changed values.
    pub said: String,
    /// Kinds of issues.
    pub issues: String,
    /// Error of the first model, um.
    pub before_um: Option<f64>,
    /// Error of the last model, um.
    pub after_um: Option<f64>,
    /// Noise, um.
    pub noise_um: Option<f64>,
    /// Geometric mean of fitted and held-out error, um.
    pub ends_um: Option<f64>,
    /// Seconds.
    pub seconds: f64,
    /// Seconds of all processors.
    pub processor_s: f64,
    /// How the answer compares with what is true.
    pub mark: String,
    /// What is named in an order that says nothing.
    pub names: String,
}

impl ResultRow {
    /// Takes an answer over.
    pub fn fill(&mut self, answer: &FinderAnswer, cost: Cost) {
        self.verdict.clone_from(&answer.verdict);
        self.reason.clone_from(&answer.reason);
        self.said = answer.said();
        self.issues = answer.issues.join("+");
        (self.before_um, self.after_um, self.noise_um) =
            (answer.before_um, answer.after_um, answer.noise_um);
        (self.seconds, self.processor_s) = (cost.seconds, cost.processor_s);
    }

    /// For the terminal.
    pub fn line(&self) -> String {
        format!(
            "{:<12} {:<34} {:<10} {:<13} {:<40} {:>6.1} s",
            self.set, self.case, self.mark, self.verdict, self.said, self.seconds
        )
    }

    fn csv(&self) -> String {
        let nm = |um: Option<f64>| um.map_or_else(String::new, |um| format!("{:.4}", 1e3 * um));
        let mut out = format!(
            "{},{},{},{},{},{},{}",
            self.set, self.case, self.truth, self.verdict, self.reason, self.said, self.issues
        );
        for um in [self.before_um, self.after_um, self.noise_um, self.ends_um] {
            let _ = write!(out, ",{}", nm(um));
        }
        let _ = write!(
            out,
            ",{:.2},{:.2},{},{}",
            self.seconds, self.processor_s, self.mark, self.names
        );
        out
    }

    fn parsed(line: &str) -> Option<Self> {
        let fields: Vec<&str> = line.split(',').collect();
        let [
            set,
            case,
            truth,
            verdict,
            reason,
            said,
            issues,
            before,
            after,
            noise,
            ends,
            seconds,
            processor_s,
            mark,
            names,
        ] = fields[..]
        else {
            return None;
        };
        let um = |text: &str| text.parse::<f64>().ok().map(|nm| 1e-3 * nm);
        Some(Self {
            set: set.into(),
            case: case.into(),
            truth: truth.into(),
            verdict: verdict.into(),
            reason: reason.into(),
            said: said.into(),
            issues: issues.into(),
            before_um: um(before),
            after_um: um(after),
            noise_um: um(noise),
            ends_um: um(ends),
            seconds: seconds.parse().ok()?,
            processor_s: processor_s.parse().ok()?,
            mark: mark.into(),
            names: names.into(),
        })
    }
}

/// The rows of one label.
pub struct Results {
    /// The label.
    pub label: String,
    path: PathBuf,
    /// All rows.
    pub rows: Vec<ResultRow>,
}

impl Results {
    /// Reads what is there.
    pub fn open(label: &str) -> Result<Self, String> {
        Self::at(
            label,
            root().join(FOLDER).join(format!("finder_{label}.csv")),
        )
    }

    /// The same of another file.
    pub fn at(label: &str, path: PathBuf) -> Result<Self, String> {
        let mut rows = Vec::new();
        if path.exists() {
            let text =
                std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            for (at, line) in text.lines().enumerate().skip(1) {
                let row = ResultRow::parsed(line);
                rows.push(row.ok_or_else(|| {
                    format!(
                        "{}, row {}: expected the columns {HEADER}",
                        path.display(),
                        at + 1
                    )
                })?);
            }
        }
        Ok(Self {
            label: label.into(),
            path,
            rows,
        })
    }

    /// Every label that has results.
    pub fn all() -> Result<Vec<Self>, String> {
        let entries = std::fs::read_dir(root().join(FOLDER))
            .map(|e| e.flatten().collect())
            .unwrap_or_else(|_| Vec::new());
        let name = |entry: &std::fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
        let mut labels: Vec<String> = entries
            .iter()
            .filter_map(|e| {
                Some(
                    name(e)
                        .strip_prefix("finder_")?
                        .strip_suffix(".csv")?
                        .to_owned(),
                )
            })
            .collect();
        labels.sort();
        labels.iter().map(|label| Self::open(label)).collect()
    }

    /// Whether a case was run.
    pub fn has(&self, set: &str, case: &str) -> bool {
        self.rows.iter().any(|r| r.set == set && r.case == case)
    }

    /// What was named in a case.
    pub fn names_of(&self, set: &str, case: &str) -> Option<String> {
        self.rows
            .iter()
            .find(|r| r.set == set && r.case == case)
            .map(|r| r.names.clone())
    }

    /// Adds a row, in the file at once.
    pub fn append(&mut self, row: ResultRow) -> Result<(), String> {
        let told = |e: std::io::Error| format!("{}: {e}", self.path.display());
        std::fs::create_dir_all(root().join(FOLDER)).map_err(told)?;
        let is_new = !self.path.exists();
        let mut file = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&self.path)
            .map_err(told)?;
        let header = if is_new {
            format!("{HEADER}\n")
        } else {
            String::new()
        };
        file.write_all(format!("{header}{}\n", row.csv()).as_bytes())
            .map_err(told)?;
        self.rows.push(row);
        Ok(())
    }
}
