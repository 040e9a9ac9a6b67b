//! What a record shows of the dynamics, whatever the model: the frequency response with its coherence, and
//! the correlations of a residual.
//!
//! The response is that of Welch's averaged cross spectra (Hann windows, half overlapped): the best linear
//! approximation for the drive of the record. The coherence is the share of the reading's power that this
//! linear part explains; loops and noise lower it.

use crate::statistics::mean;
use nalgebra::Complex;
use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// A frequency response, thinned to even steps of the logarithm of frequency.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Response {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// Magnitude, unit of the reading by that of the drive.
    pub gain: Vec<f64>,
    /// Phase, degrees, without jumps of a turn.
    pub phase_deg: Vec<f64>,
    /// Coherence, 0 to 1.
    pub coherence: Vec<f64>,
}

/// Longest stretch that is transformed at once.
const LONGEST_SEGMENT: usize = 8192;
/// Stretches that are averaged at least: of one alone the coherence is one whatever the noise.
const SEGMENTS_MIN: usize = 8;
/// Points left per decade of frequency.
const POINTS_PER_DECADE: f64 = 60.0;
/// A drive shows the response at a frequency where its power there is this share of its largest at least.
const DRIVEN: f64 = 1e-9;

/// The response of readings to a drive at the same even steps; empty for less than a few hundred samples.
#[must_use]
pub fn frequency_response(drive: &[f64], reading: &[f64], sample_rate_hz: f64) -> Response {
    let n = drive.len().min(reading.len());
    let most = 2 * n / (SEGMENTS_MIN + 1);
    let length = (1..=13)
        .rev()
        .map(|k| 1_usize << k)
        .find(|length| *length <= most)
        .unwrap_or(0)
        .min(LONGEST_SEGMENT);
    if length < 64 || sample_rate_hz.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return Response::default();
    }
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let window: Vec<f64> = (0..length)
        .map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos())
        .collect();
    let bins = length / 2 + 1;
    let (mut uu, mut yy, mut uy) = (
        vec![0.0; bins],
        vec![0.0; bins],
        vec![Complex::new(0.0, 0.0); bins],
    );
    let spectrum = |signal: &[f64]| {
        let middle = mean(signal);
        let mut input: Vec<f64> = signal
            .iter()
            .zip(&window)
            .map(|(v, w)| (v - middle) * w)
            .collect();
        let mut output = transform.make_output_vec();
        // The buffers have the lengths of the transform.
        transform
            .process(&mut input, &mut output)
            .ok()
            .map(|()| output)
    };
    for start in (0..=n - length).step_by(length / 2) {
        let (Some(u), Some(y)) = (
            spectrum(&drive[start..start + length]),
            spectrum(&reading[start..start + length]),
        ) else {
            continue;
        };
        for k in 0..bins {
            let (u, y) = (
                Complex::new(u[k].re, u[k].im),
                Complex::new(y[k].re, y[k].im),
            );
            uu[k] += u.norm_sqr();
            yy[k] += y.norm_sqr();
            uy[k] += u.conj() * y;
        }
    }
    let strongest = uu.iter().skip(1).copied().fold(0.0, f64::max);
    let mut out = Response::default();
    let mut bin = 1;
    while bin < bins {
        let wide = (bin as f64 * 10f64.powf(1.0 / POINTS_PER_DECADE)) as usize;
        let end = wide.max(bin + 1).min(bins);
        let over = |values: &[f64]| values[bin..end].iter().sum::<f64>();
        let (power, of_reading) = (over(&uu), over(&yy));
        let both: Complex<f64> = uy[bin..end].iter().sum();
        if power > DRIVEN * strongest * (end - bin) as f64 && of_reading > 0.0 {
            out.frequency_hz
                .push(sample_rate_hz / length as f64 * (bin + end - 1) as f64 / 2.0);
            out.gain.push(both.norm() / power);
            let phase = both.arg().to_degrees();
            let before = out.phase_deg.last().copied().unwrap_or(0.0);
            out.phase_deg
                .push(phase - 360.0 * ((phase - before) / 360.0).round());
            out.coherence
                .push((both.norm_sqr() / (power * of_reading)).min(1.0));
        }
        bin = end;
    }
    out
}

/// Correlations of a residual with itself and with the drive.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Correlations {
    /// Lags, s; the drive leads at positive ones.
    pub lag_s: Vec<f64>,
    /// With itself, from lag zero on, where it is one.
    pub auto: Vec<f64>,
    /// With the drive, at the same lags.
    pub cross: Vec<f64>,
    /// 99 % of white noise stays within this, on either side.
    pub auto_bound: f64,
    /// The same of the cross correlation of a residual that has nothing of the drive.
    pub cross_bound: f64,
}

/// Standard deviations on either side of 99 % of a normal value.
const BOUND_99: f64 = 2.576;
/// Lags that are shown.
const LAGS: usize = 60;

/// Correlations over the first lags; empty for a residual or a drive that stands still.
#[must_use]
pub fn correlations(residual: &[f64], drive: &[f64], sample_rate_hz: f64) -> Correlations {
    let n = residual.len().min(drive.len());
    let lags = LAGS.min(n / 4);
    let centred = |signal: &[f64]| -> Vec<f64> {
        let middle = mean(signal);
        signal.iter().map(|v| v - middle).collect()
    };
    let (e, u) = (centred(&residual[..n]), centred(&drive[..n]));
    let along =
        |a: &[f64], b: &[f64], lag: usize| a[lag..].iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let (ee, uu) = (along(&e, &e, 0), along(&u, &u, 0));
    if lags == 0 || ee <= 0.0 || uu <= 0.0 {
        return Correlations::default();
    }
    let auto: Vec<f64> = (0..lags).map(|lag| along(&e, &e, lag) / ee).collect();
    let of_drive: Vec<f64> = (0..lags).map(|lag| along(&u, &u, lag) / uu).collect();
    // Both coloured, they are alike by chance as often as their correlations overlap (Bartlett).
    let overlap = 1.0
        + 2.0
            * auto
                .iter()
                .zip(&of_drive)
                .skip(1)
                .map(|(a, b)| a * b)
                .sum::<f64>();
    Correlations {
        lag_s: (0..lags).map(|lag| lag as f64 / sample_rate_hz).collect(),
        cross: (0..lags)
            .map(|lag| along(&e, &u, lag) / (ee * uu).sqrt())
            .collect(),
        auto,
        auto_bound: BOUND_99 / (n as f64).sqrt(),
        cross_bound: BOUND_99 * (overlap.max(1.0) / n as f64).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    fn white(samples: usize, seed: u64) -> Vec<f64> {
        let mut noise = WhiteNoise::new(1.0, seed);
        (0..samples).map(|_| noise.next_um()).collect()
    }

    #[test]
    fn a_lag_has_its_gain_its_phase_and_its_coherence() {
        let (rate_hz, corner_hz) = (10_000.0, 200.0);
        let (u, noise) = (white(60_000, 1), white(60_000, 2));
        let left = (-TAU * corner_hz / rate_hz).exp();
        let mut y = 0.0;
        let clean: Vec<f64> = u
            .iter()
            .map(|u| {
                let now = y;
                y = left * y + (1.0 - left) * 3.0 * u;
                now
            })
            .collect();
        let noisy: Vec<f64> = clean
            .iter()
            .zip(&noise)
            .map(|(y, n)| y + 0.05 * n)
            .collect();
        let found = frequency_response(&u, &noisy, rate_hz);
        let at = |hz: f64| found.frequency_hz.iter().position(|f| *f > hz).unwrap();
        let low = at(20.0);
        assert!(
            (found.gain[low] / 3.0 - 1.0).abs() < 0.05 && found.coherence[low] > 0.97,
            "{} {}",
            found.gain[low],
            found.coherence[low]
        );
        let corner = at(200.0);
        assert!(
            (found.gain[corner] / 3.0 - std::f64::consts::FRAC_1_SQRT_2).abs() < 0.05,
            "{}",
            found.gain[corner]
        );
        // Half a turn by the corner's 45 degrees, and what one period of waiting adds.
        let expected = -45.0 - 360.0 * found.frequency_hz[corner] / rate_hz * 0.5;
        assert!(
            (found.phase_deg[corner] - expected).abs() < 5.0,
            "{} {expected}",
            found.phase_deg[corner]
        );
        let without = frequency_response(&u, &noise, rate_hz);
        assert!(
            mean(&without.coherence) < 0.2,
            "{}",
            mean(&without.coherence)
        );
    }

    #[test]
    fn white_noise_stays_within_the_bounds_and_a_missing_lag_does_not() {
        let (e, u) = (white(8000, 3), white(8000, 4));
        let found = correlations(&e, &u, 1000.0);
        let outside =
            |values: &[f64], bound: f64| values.iter().filter(|v| v.abs() > bound).count();
        assert!(
            outside(&found.auto[1..], found.auto_bound) <= 3
                && outside(&found.cross, found.cross_bound) <= 3,
            "{found:?}"
        );
        let missing: Vec<f64> = (0..8000)
            .map(|k| e[k] + if k > 2 { 0.3 * u[k - 3] } else { 0.0 })
            .collect();
        let found = correlations(&missing, &u, 1000.0);
        assert!(
            found.cross[3] > 4.0 * found.cross_bound
                && outside(&found.cross, found.cross_bound) <= 4,
            "{:?}",
            found.cross
        );
    }
}
