//! The feedforward over the reference window: the inverse of a sampled model, as far as a few taps go.

use super::model::SampledModel;
use super::quantise::OF_OUTPUT_ROW_MOST;
use super::sampled_loop::frequency_response;
use super::window_fit::{self, taps_response};
use nalgebra::Complex;

/// Taps whose magnitudes sum to less have a place in the tick, with room for a gain that is corrected.
const LARGEST_TAPS: f64 = 0.8 * OF_OUTPUT_ROW_MOST;
/// Where the band in which a feedforward is the model's inverse may end, Hz, where it cannot be that up to
/// [`window_fit::BAND_HZ`].
const NARROWER_BANDS_HZ: [f64; 7] = [800.0, 700.0, 600.0, 500.0, 400.0, 300.0, 200.0];
/// A reference is reckoned with as evenly up to here, Hz, and from here on as one of steps.
const EVENLY_TO_HZ: f64 = 100.0;

/// Feedforward over the reference window for the period that begins one tick after now: the inverse of a
/// sampled model.
///
/// Where two modes share the motion nothing moves between them at one frequency, and no inverse of a few taps
/// follows there: one that was fitted to that frequency would be thousands of times too large and wrong
/// everywhere. The band then ends in front of it: of the narrower ones whose taps the tick has room for, the
/// one that leaves least of a reference is taken. A mode so slow that none fits is followed as far as the
/// taps go.
#[must_use]
pub fn feedforward(model: &SampledModel) -> Vec<f64> {
    let inverse =
        |w: f64| Complex::from_polar(1.0, w * model.period_s) / frequency_response(model, w);
    let fits = |taps: &Vec<f64>| taps.iter().map(|tap| tap.abs()).sum::<f64>() < LARGEST_TAPS;
    let whole = window_fit::fit(model.period_s, inverse);
    if fits(&whole) {
        return whole;
    }
    let left = |taps: &Vec<f64>| -> f64 {
        let of_band = (1..=90).map(|i| 0.1 * window_fit::BAND_HZ / 9.0 * f64::from(i));
        of_band
            .map(|hz| {
                (missed_of_reference(model, taps, hz) * EVENLY_TO_HZ / hz.max(EVENLY_TO_HZ)).powi(2)
            })
            .sum()
    };
    let narrower = |weight: f64| {
        let fitted = NARROWER_BANDS_HZ
            .iter()
            .map(|band_hz| window_fit::fit_in(model.period_s, *band_hz, weight, inverse));
        fitted
            .filter(fits)
            .min_by(|a, b| left(a).total_cmp(&left(b)))
    };
    // The more weight, the smaller the taps: the last come down to the constant alone.
    let found =
        (0..12).find_map(|nth| narrower(if nth == 0 { 0.0 } else { 1e-3 * 4f64.powi(nth) }));
    found.unwrap_or(whole)
}

/// Share of a reference at a frequency, Hz, that a feedforward alone misses on the model that it was made
/// for.
#[must_use]
pub fn missed_of_reference(model: &SampledModel, taps: &[f64], hz: f64) -> f64 {
    let omega = std::f64::consts::TAU * hz;
    (frequency_response(model, omega) * taps_response(taps, model.period_s, hz) - 1.0).norm()
}

#[cfg(test)]
mod tests {
    use super::super::model::{LinearModel, ModeModel};
    use super::*;

    /// Two light modes: nothing moves between them at 745 Hz, and the feedforward follows slower references
    /// all the same.
    #[test]
    fn a_feedforward_fits_where_nothing_moves_between_two_modes_and_where_the_mode_is_slow() {
        let of = |second: bool, first_hz: f64| LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: std::f64::consts::TAU * first_hz,
                damping_ratio: 0.02,
            },
            second_mode: second.then_some((
                0.1,
                ModeModel {
                    natural_frequency_rad_s: 5654.9,
                    damping_ratio: 0.02,
                },
            )),
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        };
        for (linear, hz, most) in [
            (of(true, 380.0), 20.0, 1e-3),
            (of(true, 380.0), 150.0, 0.01),
            (of(false, 150.0), 20.0, 5e-3),
        ] {
            let model = linear.sampled();
            let taps = feedforward(&model);
            assert!(taps.iter().map(|t| t.abs()).sum::<f64>() < LARGEST_TAPS);
            let missed = missed_of_reference(&model, &taps, hz);
            assert!(missed < most, "{linear:?} {hz} Hz: {missed}");
        }
    }
}
