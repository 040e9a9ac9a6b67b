//! What of a signal is random: without drift, lines, and what follows a measured force. All kinds of evidence
//! for the noise use it, so that they mean the same.

use crate::identification::fit::{dot, rms};
use realfft::RealFftPlanner;

/// Taps of the force response that are removed, at most this many seconds.
const FORCE_MEMORY_S: f64 = 0.004;
/// Lines that are removed at most.
const LINES_MAX: usize = 6;

/// Adds to orthonormal columns what others have beside them: Gram-Schmidt, twice for accuracy; columns that
/// depend on earlier ones are left out.
fn add_orthonormal(basis: &mut Vec<Vec<f64>>, columns: impl IntoIterator<Item = Vec<f64>>) {
    for mut column in columns {
        let before = dot(&column, &column).sqrt();
        project_out(basis, &mut column);
        project_out(basis, &mut column);
        let norm = dot(&column, &column).sqrt();
        if norm > 1e-7 * before && norm > 0.0 {
            column.iter_mut().for_each(|v| *v /= norm);
            basis.push(column);
        }
    }
}

/// Removes from `column` what lies in the span of orthonormal columns.
fn project_out(orthonormal: &[Vec<f64>], column: &mut [f64]) {
    for base in orthonormal {
        let along = dot(base, column);
        for (c, b) in column.iter_mut().zip(base) {
            *c -= along * b;
        }
    }
}

/// Constant, slope, and two powers more over the length of a signal.
fn drift_columns(samples: usize) -> Vec<Vec<f64>> {
    let x = |k: usize| 2.0 * k as f64 / samples.max(2) as f64 - 1.0;
    (0..4)
        .map(|power| (0..samples).map(|k| x(k).powi(power)).collect())
        .collect()
}

/// RMS of what is random in `signal`, which begins at sample `from` of a record with this force.
pub(super) fn random_part(
    signal: &[f64],
    sample_rate_hz: f64,
    force_n: Option<(&[f64], usize)>,
) -> f64 {
    random(signal, sample_rate_hz, force_n).rms
}

/// The same in a part of a signal whose lines are known: a part may be too short to show them.
pub(super) fn random_part_beside_lines(
    signal: &[f64],
    sample_rate_hz: f64,
    lines_hz: &[f64],
) -> f64 {
    let mut columns = drift_columns(signal.len());
    columns.extend(
        lines_hz
            .iter()
            .flat_map(|hz| line_columns(*hz, signal.len(), sample_rate_hz)),
    );
    beside(signal, sample_rate_hz, columns).rms
}

/// Frequencies of the lines that a signal shows beside its drift, the strongest first.
pub(super) fn lines_hz(signal: &[f64], sample_rate_hz: f64) -> Vec<f64> {
    beside(signal, sample_rate_hz, drift_columns(signal.len())).lines_hz
}

/// What is random in `signal`, and the lines beside it.
pub(super) fn random(
    signal: &[f64],
    sample_rate_hz: f64,
    force_n: Option<(&[f64], usize)>,
) -> Beside {
    let n = signal.len();
    let mut columns = drift_columns(n);
    if let Some((force_n, from)) = force_n.filter(|(f, _)| f.iter().any(|v| *v != f[0])) {
        let taps = ((FORCE_MEMORY_S * sample_rate_hz) as usize)
            .clamp(2, 80)
            .min(n / 20 + 1);
        for lag in 0..taps {
            columns.push(
                (from..from + n)
                    .map(|k| force_n[k.saturating_sub(lag + 1)])
                    .collect(),
            );
        }
    }
    beside(signal, sample_rate_hz, columns)
}

/// Sine and cosine of a line.
fn line_columns(frequency_hz: f64, samples: usize, sample_rate_hz: f64) -> [Vec<f64>; 2] {
    let phase = |k: usize| std::f64::consts::TAU * frequency_hz * k as f64 / sample_rate_hz;
    [
        (0..samples).map(|k| phase(k).sin()).collect(),
        (0..samples).map(|k| phase(k).cos()).collect(),
    ]
}

/// What a signal has beside some columns and lines.
pub(super) struct Beside {
    pub residual: Vec<f64>,
    /// Its RMS, which counts what was removed.
    pub rms: f64,
    /// The lines that were removed, the strongest first.
    pub lines_hz: Vec<f64>,
}

fn beside(signal: &[f64], sample_rate_hz: f64, columns: Vec<Vec<f64>>) -> Beside {
    let n = signal.len();
    let mut basis = Vec::new();
    add_orthonormal(&mut basis, columns);
    let mut residual = signal.to_vec();
    project_out(&basis, &mut residual);
    let mut lines_hz = Vec::new();
    // Lines one after the other: each where the periodogram stands out of what noise can do.
    while lines_hz.len() < LINES_MAX
        && let Some(frequency_hz) = strongest_line(&residual, sample_rate_hz)
    {
        // Beside the drift, which has taken its part of the line already.
        let known = basis.len();
        add_orthonormal(&mut basis, line_columns(frequency_hz, n, sample_rate_hz));
        project_out(&basis[known..], &mut residual);
        lines_hz.push(frequency_hz);
    }
    let rms = rms(&residual) * (n as f64 / n.saturating_sub(basis.len()).max(1) as f64).sqrt();
    Beside {
        residual,
        rms,
        lines_hz,
    }
}

/// How often a line's frequency is refined: to one part in 10^5 of the resolution. Of a line a thousand times
/// as strong as the noise as much as the noise is left, since the drift beside which it is looked for has
/// taken a part of it.
const REFINED: usize = 20;
/// Lines beside one that hold part of it where its frequency lies between two.
const LEAKS_TO: usize = 3;

/// Median of the lines around one, from those at five eighths of its frequency to those at eight fifths, of
/// twelve on each side at least.
fn median_around(power: &[f64], bin: usize) -> f64 {
    let from = (bin * 5 / 8).min(bin.saturating_sub(12)).max(1);
    let to = (bin * 8 / 5).max(bin + 12).min(power.len() - 1);
    let mut around: Vec<f64> = (from..=to)
        .filter(|other| other.abs_diff(bin) > LEAKS_TO)
        .map(|other| power[other])
        .collect();
    around.sort_by(f64::total_cmp);
    around.get(around.len() / 2).copied().unwrap_or(0.0)
}

/// Frequency of a line that noise would show less than once in 10^4 records.
fn strongest_line(values: &[f64], sample_rate_hz: f64) -> Option<f64> {
    let n = values.len();
    let power = periodogram(values);
    let mut sorted: Vec<f64> = power[1..].to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().filter(|m| *m > 0.0)?;
    // Exponentially distributed ordinates: the mean is the median over ln 2.
    let limit = median / std::f64::consts::LN_2 * (power.len() as f64 * 1e4).ln();
    // Noise that rises towards slow lines stands out of the median of all, and not of that of its neighbours.
    let stands_out =
        |bin: usize| power[bin] > limit && power[bin] > limit / median * median_around(&power, bin);
    let candidates = (1..power.len()).filter(|bin| stands_out(*bin));
    let bin = candidates.max_by(|a, b| power[*a].total_cmp(&power[*b]))?;
    // Refine between bins by the strongest projection.
    let resolution = sample_rate_hz / n as f64;
    let strength = |f: f64| {
        let (mut s, mut c) = (0.0, 0.0);
        for (k, v) in values.iter().enumerate() {
            let (sin, cos) = (std::f64::consts::TAU * f * k as f64 / sample_rate_hz).sin_cos();
            s += v * sin;
            c += v * cos;
        }
        s * s + c * c
    };
    let with_strength = |f: f64| (f, strength(f));
    let mut best = with_strength(bin as f64 * resolution);
    let mut width = 0.5 * resolution;
    for _ in 0..REFINED {
        let beside = [best.0 - width, best.0 + width].map(with_strength);
        best = beside.into_iter().fold(
            best,
            |best, other| if other.1 > best.1 { other } else { best },
        );
        width *= 0.6;
    }
    Some(best.0)
}

/// Power at the bins of a discrete Fourier transform.
#[must_use]
pub fn periodogram(values: &[f64]) -> Vec<f64> {
    let mut planner = RealFftPlanner::<f64>::new();
    let transform = planner.plan_fft_forward(values.len());
    let mut input = values.to_vec();
    let mut output = transform.make_output_vec();
    if transform.process(&mut input, &mut output).is_err() {
        return Vec::new();
    }
    output
        .iter()
        .map(|c| c.norm_sqr() / values.len() as f64)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hum_and_drift_are_not_noise() {
        let mut noise = hysteron_sim::noise::WhiteNoise::new(0.01, 7);
        let y: Vec<f64> = (0..5000)
            .map(|k| noise.next_um() + 0.05 * (k as f64 * 0.3143).sin() + 1e-5 * k as f64)
            .collect();
        assert!((random_part(&y, 1000.0, None) / 0.01 - 1.0).abs() < 0.03);
    }
}
