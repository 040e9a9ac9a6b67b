//! A CSV of numbers with a header, whose first columns are time, drive and reading.

use std::fmt::Write as _;
use std::path::Path;

/// A table in memory.
#[derive(Clone, Debug)]
pub struct NumberTable {
    /// Names of the columns.
    pub header: String,
    /// Rows.
    pub rows: Vec<Vec<f64>>,
}

impl NumberTable {
    /// Reads one.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
        let mut lines = text.lines();
        let header = lines.next().unwrap_or_default().to_owned();
        let row = |(at, line): (usize, &str)| -> Result<Vec<f64>, String> {
            let values: Result<Vec<f64>, _> = line.split(',').map(|v| v.trim().parse()).collect();
            values.map_err(|e| format!("{}, row {}: {e}", path.display(), at + 2))
        };
        let rows = lines
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty())
            .map(row);
        Ok(Self {
            header,
            rows: rows.collect::<Result<_, _>>()?,
        })
    }

    /// The readings, third of the columns.
    pub fn readings_um(&self) -> Vec<f64> {
        self.rows.iter().map(|row| row[2]).collect()
    }

    /// The same table with other readings.
    pub fn with_readings(&self, readings_um: &[f64]) -> Self {
        let mut out = self.clone();
        out.rows
            .iter_mut()
            .zip(readings_um)
            .for_each(|(row, y)| row[2] = *y);
        out
    }

    /// Writes it with as many digits as read back the same.
    pub fn write(&self, path: &Path) -> Result<(), String> {
        let mut text = format!("{}\n", self.header);
        for row in &self.rows {
            for (i, value) in row.iter().enumerate() {
                let _ = write!(text, "{}{value}", if i == 0 { "" } else { "," });
            }
            text.push('\n');
        }
        super::context::write(path, &text)
    }
}
