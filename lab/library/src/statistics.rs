//! Small statistics of signals.

/// Inner product, with four partial sums so that the compiler can vectorise it.
#[must_use]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let mut lanes = [0.0; 4];
    let mut chunks_a = a.chunks_exact(4);
    let mut chunks_b = b.chunks_exact(4);
    for (x, y) in (&mut chunks_a).zip(&mut chunks_b) {
        for i in 0..4 {
            lanes[i] += x[i] * y[i];
        }
    }
    let tail: f64 = chunks_a
        .remainder()
        .iter()
        .zip(chunks_b.remainder())
        .map(|(x, y)| x * y)
        .sum();
    lanes[0] + lanes[1] + lanes[2] + lanes[3] + tail
}

/// Root mean square of a slice.
#[must_use]
pub fn rms(values: &[f64]) -> f64 {
    if values.is_empty() {
        0.0
    } else {
        (dot(values, values) / values.len() as f64).sqrt()
    }
}

/// Largest absolute value.
#[must_use]
pub fn largest(signal: &[f64]) -> f64 {
    signal.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// Least and largest value; infinite the wrong way round without any. Zero has no sign: a file's `-0.0` would
/// be printed as a limit of "-0".
#[must_use]
pub fn extremes(signal: &[f64]) -> (f64, f64) {
    let (low, high) = signal
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(*v), high.max(*v))
        });
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
    if signal.is_empty() {
        0.0
    } else {
        signal.iter().sum::<f64>() / signal.len() as f64
    }
}

/// RMS about the mean.
#[must_use]
pub fn rms_about_mean(signal: &[f64]) -> f64 {
    let mean = mean(signal);
    rms(&signal.iter().map(|x| x - mean).collect::<Vec<f64>>())
}

/// RMS of what has a pattern in a signal whose steps from sample to sample are these: what is random has
/// steps of the root of two times its size, a pattern next to none.
#[must_use]
pub fn pattern_rms(signal: &[f64], steps: &[f64]) -> f64 {
    (rms(signal).powi(2) - 0.5 * rms(steps).powi(2))
        .max(0.0)
        .sqrt()
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
    fn noise_has_no_pattern_and_a_wave_is_one() {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.1, 5);
        let wave = |k: usize| (0.01 * k as f64).sin();
        let (mut alone, mut on_a_wave) = (Vec::new(), Vec::new());
        for k in 0..20_000 {
            let random = noise.next_um();
            alone.push(random);
            on_a_wave.push(wave(k) + random);
        }
        let pattern = |signal: &[f64]| {
            pattern_rms(
                signal,
                &signal.windows(2).map(|w| w[1] - w[0]).collect::<Vec<_>>(),
            )
        };
        assert!(pattern(&alone) < 0.015, "{}", pattern(&alone));
        assert!(
            (pattern(&on_a_wave) / 0.5_f64.sqrt() - 1.0).abs() < 0.01,
            "{}",
            pattern(&on_a_wave)
        );
    }

    #[test]
    fn zero_has_no_sign_as_a_limit() {
        let (low, high) = extremes(&[-60.0, -0.0, -3.0]);
        assert_eq!(format!("{low} to {high} V"), "-60 to 0 V");
        assert_eq!(extremes(&[]), (f64::INFINITY, f64::NEG_INFINITY));
    }
}
