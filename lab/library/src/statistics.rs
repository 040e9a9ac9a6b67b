//! Small statistics of signals.

pub use crate::identification::fit::rms;

/// Largest absolute value.
#[must_use]
pub fn largest(signal: &[f64]) -> f64 {
    signal.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Least and largest value; infinite the wrong way round without any.
#[must_use]
pub fn extremes(signal: &[f64]) -> (f64, f64) {
    signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
}

/// Largest less least value.
#[must_use]
pub fn peak_to_peak(signal: &[f64]) -> f64 {
    let (low, high) = extremes(signal);
    high - low
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
