//! Resonances that a residual shows: where a mode is looked for first.
//!
//! A mode of a stage is narrow (a damping ratio of one part in a hundred is usual), so that no grid of start
//! values meets it by chance. Peaks of the residual's spectrum that stand out of their neighbourhood give its
//! frequency, and their width its damping.

use crate::identification::noise_floor::periodogram;
use hysteron_sim::effect::Resonance;

/// Most resonances that are tried.
const MOST: usize = 4;
/// Power of a peak over the median of its neighbourhood.
const STANDS_OUT: f64 = 12.0;
/// The neighbourhood reaches this far to both sides, as a share of the frequency.
const NEIGHBOURHOOD: f64 = 0.35;
/// The spectrum is averaged over this share of the frequency: lines of a periodic drive are narrower, modes
/// are not.
const AVERAGED: f64 = 0.01;
/// Damping ratios that a peak may show.
const DAMPING: (f64, f64) = (0.004, 0.3);

/// Resonances in residuals, the strongest first; each with the rate at which it was sampled, Hz.
#[must_use]
pub fn resonances(residuals: &[(&[f64], f64)]) -> Vec<Resonance> {
    let mut found: Vec<(f64, Resonance)> = residuals
        .iter()
        .flat_map(|(residual, rate_hz)| peaks(residual, *rate_hz))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut out: Vec<Resonance> = Vec::new();
    for (_, r) in found {
        let known = |o: &Resonance| {
            (o.natural_frequency_rad_s / r.natural_frequency_rad_s)
                .ln()
                .abs()
                < 0.05
        };
        if out.len() < MOST && !out.iter().any(known) {
            out.push(r);
        }
    }
    out
}

fn peaks(residual: &[f64], rate_hz: f64) -> Vec<(f64, Resonance)> {
    if residual.len() < 256 {
        return Vec::new();
    }
    let power = periodogram(residual);
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(power.iter().scan(0.0, |sum, p| {
            *sum += p;
            Some(*sum)
        }))
        .collect();
    let mean = |bin: usize, reach: usize| {
        let (from, to) = (
            bin.saturating_sub(reach).max(1),
            (bin + reach + 1).min(power.len()),
        );
        (sums[to] - sums[from]) / (to - from).max(1) as f64
    };
    let smooth: Vec<f64> = (0..power.len())
        .map(|bin| mean(bin, (AVERAGED * bin as f64) as usize))
        .collect();
    let bin_hz = rate_hz / residual.len() as f64;
    let mut out = Vec::new();
    // Below some tens of bins a peak has no shape.
    for bin in 40..power.len().saturating_sub(2) {
        let reach = (NEIGHBOURHOOD * bin as f64) as usize;
        let (from, to) = (bin - reach, (bin + reach + 1).min(power.len()));
        if smooth[from..to].iter().any(|p| *p > smooth[bin]) {
            continue;
        }
        let mut around: Vec<f64> = smooth[from..to].to_vec();
        around.sort_by(f64::total_cmp);
        let base = around[around.len() / 2];
        if smooth[bin] < STANDS_OUT * base {
            continue;
        }
        // Half the power to both sides.
        let half = base + 0.5 * (smooth[bin] - base);
        let below = (from..bin)
            .rev()
            .find(|b| smooth[*b] < half)
            .unwrap_or(from);
        let above = (bin..to).find(|b| smooth[*b] < half).unwrap_or(to - 1);
        let damping_ratio =
            ((above - below) as f64 / (2.0 * bin as f64)).clamp(DAMPING.0, DAMPING.1);
        let natural_frequency_rad_s = std::f64::consts::TAU * bin as f64 * bin_hz;
        out.push((
            smooth[bin] * (above - below) as f64,
            Resonance {
                natural_frequency_rad_s,
                damping_ratio,
            },
        ));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    #[test]
    fn a_ring_in_noise_is_found_and_noise_alone_is_none() {
        let (w, xi, rate_hz) = (4618.0, 0.014, 10_000.0);
        let mut noise = WhiteNoise::new(0.002, 3);
        let quiet: Vec<f64> = (0..20_000).map(|_| noise.next_um()).collect();
        let ring = |k: usize| (-xi * w * k as f64 / rate_hz).exp() * (w * k as f64 / rate_hz).cos();
        let ringing: Vec<f64> = quiet
            .iter()
            .enumerate()
            .map(|(k, n)| n + 0.3 * ring(k))
            .collect();
        let found = resonances(&[(&ringing, rate_hz)]);
        assert!(
            (found[0].natural_frequency_rad_s / w - 1.0).abs() < 0.01,
            "{found:?}"
        );
        assert!((0.007..0.04).contains(&found[0].damping_ratio), "{found:?}");
        assert!(resonances(&[(&quiet, rate_hz)]).is_empty());
    }
}
