//! Small statistics of signals.

/// Root mean square.
#[must_use]
pub fn rms(signal: &[f64]) -> f64 {
    if signal.is_empty() {
        return 0.0;
    }
    (signal.iter().map(|v| v * v).sum::<f64>() / signal.len() as f64).sqrt()
}

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
