//! At which frequencies a residual lives: averaged periodograms (Welch 1967), thinned on a logarithmic axis.

use nalgebra::Complex;
use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// One-sided amplitude density.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spectrum {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// Amplitude density, unit of the signal per root Hz.
    pub density: Vec<f64>,
}

/// Longest stretch that is transformed at once; a longer record is averaged over overlapping stretches.
const LONGEST_SEGMENT: usize = 8192;
/// Points left per decade of frequency.
const POINTS_PER_DECADE: f64 = 80.0;

/// Amplitude density of `signal`, mean removed: Hann windows, half overlapped. Empty for fewer than 16
/// samples.
pub fn amplitude_density(signal: &[f64], sample_rate_hz: f64) -> Spectrum {
    if signal.len() < 16 || sample_rate_hz.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return Spectrum::default();
    }
    let length = if signal.len() < LONGEST_SEGMENT {
        signal.len() & !1
    } else {
        LONGEST_SEGMENT
    };
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    let window: Vec<f64> = (0..length)
        .map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos())
        .collect();
    let window_power: f64 = window.iter().map(|w| w * w).sum();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let (mut input, mut output) = (transform.make_input_vec(), transform.make_output_vec());
    let mut power = vec![0.0; output.len()];
    let mut segments = 0.0;
    for start in (0..=signal.len() - length).step_by(length / 2) {
        for i in 0..length {
            input[i] = (signal[start + i] - mean) * window[i];
        }
        // The buffers come from the transform itself, so their lengths fit.
        if transform.process(&mut input, &mut output).is_err() {
            return Spectrum::default();
        }
        for (sum, bin) in power.iter_mut().zip(&output) {
            *sum += bin.norm_sqr();
        }
        segments += 1.0;
    }
    let scale = 2.0 / (window_power * sample_rate_hz * segments);
    let bin_hz = sample_rate_hz / length as f64;
    let mut spectrum = Spectrum::default();
    let mut bin = 1;
    while bin < power.len() {
        let wide = (bin as f64 * 10f64.powf(1.0 / POINTS_PER_DECADE)) as usize;
        let end = wide.max(bin + 1).min(power.len());
        let mean_power = power[bin..end].iter().sum::<f64>() / (end - bin) as f64;
        spectrum
            .frequency_hz
            .push(bin_hz * (bin + end - 1) as f64 / 2.0);
        spectrum.density.push((mean_power * scale).sqrt());
        bin = end;
    }
    spectrum
}

/// The lines of a signal up to half the sampling rate, as they stand.
pub(crate) fn lines(mut signal: Vec<f64>, planner: &mut RealFftPlanner<f64>) -> Vec<Complex<f64>> {
    let plan = planner.plan_fft_forward(signal.len());
    let mut lines = plan.make_output_vec();
    // Input and output have the lengths that the plan asks for.
    let _ = plan.process(&mut signal, &mut lines);
    lines
        .into_iter()
        .map(|c| Complex::new(c.re, c.im))
        .collect()
}

/// How much a signal, its mean removed, resembles itself later: one at no lag, by whole samples. Each lag is
/// weighed by the samples that it compares.
#[must_use]
pub fn autocorrelation(signal: &[f64]) -> Vec<f64> {
    let n = signal.len();
    let mean = signal.iter().sum::<f64>() / n.max(1) as f64;
    let length = (2 * n).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, backward) = (
        planner.plan_fft_forward(length),
        planner.plan_fft_inverse(length),
    );
    let mut padded: Vec<f64> = signal
        .iter()
        .map(|v| v - mean)
        .chain(std::iter::repeat(0.0))
        .take(length)
        .collect();
    let mut transformed = forward.make_output_vec();
    if forward.process(&mut padded, &mut transformed).is_err() {
        return Vec::new();
    }
    transformed
        .iter_mut()
        .for_each(|c| *c = (*c * c.conj()).re.into());
    if backward.process(&mut transformed, &mut padded).is_err() || padded[0] <= 0.0 {
        return Vec::new();
    }
    let power = padded[0] / n as f64;
    (0..n)
        .map(|lag| padded[lag] / (n - lag) as f64 / power)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_carries_the_power_of_a_line() {
        // Parseval: an amplitude of 2 at 1 kHz has a mean square of 2, all of it near 1 kHz.
        let rate = 20_000.0;
        let signal: Vec<f64> = (0..40_000)
            .map(|i| 3.0 + 2.0 * (TAU * 1000.0 * f64::from(i) / rate).sin())
            .collect();
        let spectrum = amplitude_density(&signal, rate);
        let peak = (0..spectrum.density.len())
            .max_by(|&a, &b| spectrum.density[a].total_cmp(&spectrum.density[b]))
            .unwrap();
        assert!((spectrum.frequency_hz[peak] / 1000.0 - 1.0).abs() < 0.03);
        let mut power = 0.0;
        for i in 1..spectrum.density.len() - 1 {
            let width = (spectrum.frequency_hz[i + 1] - spectrum.frequency_hz[i - 1]) / 2.0;
            power += spectrum.density[i].powi(2) * width;
        }
        assert!((power / 2.0 - 1.0).abs() < 0.1, "{power}");
    }

    #[test]
    fn a_sine_resembles_itself_after_a_period() {
        let like = autocorrelation(
            &(0..5000)
                .map(|k| (TAU * k as f64 / 100.0).sin())
                .collect::<Vec<_>>(),
        );
        assert!(
            (like[0] - 1.0).abs() < 1e-9
                && (like[100] - 1.0).abs() < 1e-2
                && (like[50] + 1.0).abs() < 1e-2
        );
    }

    #[test]
    fn too_little_data_gives_nothing() {
        assert_eq!(amplitude_density(&[1.0; 15], 1e4), Spectrum::default());
        assert_eq!(
            amplitude_density(&[1.0; 100], f64::NAN),
            Spectrum::default()
        );
    }
}
