//! Small statistics of signals.

pub use crate::identification::fit::rms;

/// Largest absolute value.
#[must_use]
pub fn largest(signal: &[f64]) -> f64 {
    signal.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Least and largest value; infinite the wrong way round without any. Zero has no sign: a file's `-0.0` would be told as a limit of "-0".
#[must_use]
pub fn extremes(signal: &[f64]) -> (f64, f64) {
    let (low, high) = signal.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    (low + 0.0, high + 0.0)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_sign_as_a_limit() {
        let (low, high) = extremes(&[-60.0, -0.0, -3.0]);
        assert_eq!(format!("{low} to {high} V"), "-60 to 0 V");
        assert_eq!(extremes(&[]), (f64::INFINITY, f64::NEG_INFINITY));
    }
}
