//! Coefficients over the reference window: least squares in the frequency domain over the band of the
//! reference.

use hysteron_core::reference_window::{PREVIEW_TICKS, WINDOW};
use nalgebra::{Complex, DMatrix, DVector};

/// Where the band of references ends that the fit follows exactly, Hz.
pub const BAND_HZ: f64 = 900.0;
/// Points of the grid within the band.
const BAND_POINTS: usize = 120;
/// Points above the band, up to half the sampling rate.
const UPPER_POINTS: usize = 120;
/// Weight above the band: keeps the coefficients small where no reference is.
const UPPER_WEIGHT: f64 = 1e-4;

/// Coefficients, oldest first, such that `sum f_i r[k + i - 7]` has the frequency response `target(omega)`
/// relative to `r[k]`.
#[must_use]
pub fn fit(period_s: f64, target: impl Fn(f64) -> Complex<f64>) -> Vec<f64> {
    fit_in(period_s, BAND_HZ, 0.0, target)
}

/// The same in a band that ends at `band_hz`, with a weight on the coefficients themselves that keeps them
/// small.
#[must_use]
pub fn fit_in(
    period_s: f64,
    band_hz: f64,
    held_down: f64,
    target: impl Fn(f64) -> Complex<f64>,
) -> Vec<f64> {
    let oldest = PREVIEW_TICKS as f64 + 1.0 - WINDOW as f64;
    let nyquist = std::f64::consts::PI / period_s;
    let band = std::f64::consts::TAU * band_hz;
    let mut rows: Vec<(f64, Complex<f64>, f64)> = Vec::new();
    for i in 0..BAND_POINTS {
        let omega = band * (i as f64 / (BAND_POINTS - 1) as f64);
        rows.push((omega, target(omega), 1.0));
    }
    for i in 1..=UPPER_POINTS {
        let omega = band + (nyquist - band) * i as f64 / UPPER_POINTS as f64;
        // Held at the value at the end of the band and fading.
        rows.push((
            omega,
            target(band) * (1.0 - i as f64 / UPPER_POINTS as f64),
            UPPER_WEIGHT,
        ));
    }
    // The constant counts most: a steady reference must be met to the last digit.
    rows.push((0.0, target(0.0), 1e3));
    let weighted = if held_down > 0.0 { WINDOW } else { 0 };
    let mut a = DMatrix::zeros(2 * rows.len() + weighted, WINDOW);
    let mut b = DVector::zeros(2 * rows.len() + weighted);
    for i in 0..weighted {
        a[(2 * rows.len() + i, i)] = held_down;
    }
    for (k, (omega, value, weight)) in rows.iter().enumerate() {
        for i in 0..WINDOW {
            let phase = omega * period_s * (i as f64 + oldest);
            a[(2 * k, i)] = weight * phase.cos();
            a[(2 * k + 1, i)] = weight * phase.sin();
        }
        b[2 * k] = weight * value.re;
        b[2 * k + 1] = weight * value.im;
    }
    a.svd(true, true)
        .solve(&b, 1e-13)
        .map(|v| v.as_slice().to_vec())
        .unwrap_or_else(|_| vec![0.0; WINDOW])
}

/// Response of taps over the reference window at a frequency, Hz: what acts, over the reference of the same
/// instant.
#[must_use]
pub fn taps_response(taps: &[f64], period_s: f64, hz: f64) -> Complex<f64> {
    // Computed at a tick, it acts one period later.
    let before = (WINDOW - PREVIEW_TICKS) as f64;
    let step = std::f64::consts::TAU * hz * period_s;
    taps.iter()
        .enumerate()
        .map(|(i, c)| Complex::from_polar(*c, step * (i as f64 - before)))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_derivative_is_right_in_the_band() {
        let period_s = 5e-5;
        let f = fit(period_s, |w| Complex::new(0.0, w * period_s));
        for hz in [1.0, 50.0, 150.0, 500.0] {
            let w = std::f64::consts::TAU * hz;
            let response: Complex<f64> = f
                .iter()
                .enumerate()
                .map(|(i, c)| Complex::from_polar(1.0, w * period_s * (i as f64 - 7.0)) * *c)
                .sum();
            // Of a 5 um reference: below 0.05 nm per sample, a tenth of what integers may differ from f64.
            let error_um = 5.0 * (response - Complex::new(0.0, w * period_s)).norm();
            assert!(error_um < 5e-5, "{hz} Hz: {error_um} um");
        }
    }
}
