//! Small statistics of signals.

pub use crate::identification::fit::rms;

/// Largest absolute value.
#[must_use]
pub fn largest(signal: &[f64]) -> f64 {
    signal.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Mean value.
#[must_use]
pub fn mean(signal: &[f64]) -> f64 {
    if signal.is_empty() { 0.0 } else { signal.iter().sum::<f64>() / signal.len() as f64 }
}

/// Element by element, `a - b`.
#[must_use]
pub fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}
