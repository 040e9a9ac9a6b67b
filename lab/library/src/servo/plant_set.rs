//! Plants that are not the model: other mass, gain, delay, modes, as sampled systems for the eigenvalues of a
//! loop.

use super::model::{LinearModel, ModeModel, SampledModel};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::{LN_2, SQRT_2};
use std::fmt;

/// Masses over the model's up to which a design holds: the largest for which some tuning does.
pub const HELD_MASSES: [f64; 3] = [2.0, SQRT_2, 1.189_207_115_002_721];
/// Factor between the gains that are tried: nothing resonates with a gain.
pub const GAIN_STEP: f64 = 1.05;
/// Periods between the delays that are tried.
pub const DELAY_STEP: f64 = 0.1;
/// A mode is moved by its damping ratio, half of the width of its resonance, but not by less than this share
/// of its frequency, ...
const LEAST_MODE_STEP: f64 = 0.005;
/// ... nor by more.
const MOST_MODE_STEP: f64 = 0.025;

/// Values from near `from` to `to`, each at most the factor `step` from the next; the last of them stands in
/// front, since most loops that are unstable are so there.
pub(super) fn row(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let whole = (to / from).ln();
    // What is a whole number of steps stays so, whatever the rounding.
    let count = (whole / step.ln() - 1e-9).abs().ceil().max(1.0) as i32;
    std::iter::once(count)
        .chain(1..count)
        .map(move |i| from * (whole * f64::from(i) / f64::from(count)).exp())
}

/// By how much a mode is moved between two plants of a set, relative to its frequency.
pub(super) fn mode_step(mode: &ModeModel) -> f64 {
    mode.damping_ratio.clamp(LEAST_MODE_STEP, MOST_MODE_STEP)
}

/// Factor between the masses that are tried: it moves no mode by more than [`mode_step`], and each of
/// [`HELD_MASSES`] is a power of it.
pub(super) fn mass_step(linear: &LinearModel) -> f64 {
    let heaviest = linear.with_mass_ratio(HELD_MASSES[0]);
    let second = heaviest.second_mode.iter().map(|(_, mode)| mode);
    let step = second
        .chain([&heaviest.first_mode])
        .map(mode_step)
        .fold(f64::INFINITY, f64::min);
    let quarters = (0.25 * LN_2 / (2.0 * step.ln_1p())).ceil();
    (0.25 * LN_2 / quarters).exp()
}

/// What a plant of a set has that the model has not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlantName {
    /// Nothing.
    Model,
    /// So many times something of the model's.
    Times(f64, &'static str),
    /// So many periods more of delay.
    Delayed(f64),
}

impl fmt::Display for PlantName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Model => write!(f, "on the model itself"),
            Self::Times(factor, of) => write!(f, "with {factor:.2} times {of}"),
            Self::Delayed(periods) => write!(f, "with {periods:.1} periods more of delay"),
        }
    }
}

/// How a plant differs from a linear model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlantVariation {
    /// Gain over the model's, 1.
    pub gain: f64,
    /// Moving mass over the model's, 1: the known modes become slower and less damped.
    pub mass_ratio: f64,
    /// Additional delay of the drive, s.
    pub delay_s: f64,
    /// A mode that the model does not have, with its share of the static displacement.
    pub mode: Option<(f64, ModeModel)>,
}

impl PlantVariation {
    /// As the model has it.
    pub const NONE: Self = Self {
        gain: 1.0,
        mass_ratio: 1.0,
        delay_s: 0.0,
        mode: None,
    };

    /// With this gain over the model's.
    #[must_use]
    pub const fn with_gain(gain: f64) -> Self {
        Self { gain, ..Self::NONE }
    }

    /// With this moving mass over the model's.
    #[must_use]
    pub const fn with_mass_ratio(mass_ratio: f64) -> Self {
        Self {
            mass_ratio,
            ..Self::NONE
        }
    }

    /// With this much more delay, s.
    #[must_use]
    pub const fn with_delay_s(delay_s: f64) -> Self {
        Self {
            delay_s,
            ..Self::NONE
        }
    }

    /// The varied plant, sampled with its drive held; a delay that is no multiple of the period is exact.
    #[must_use]
    pub fn sampled(&self, linear: &LinearModel) -> SampledModel {
        let period_s = linear.period_s;
        let mut system = linear
            .with_mass_ratio(self.mass_ratio)
            .continuous_with(self.mode);
        system.b *= self.gain;
        let whole = (self.delay_s / period_s).floor().max(0.0);
        let rest_s = (self.delay_s - whole * period_s).max(0.0);
        let whole = whole as usize;
        let (phi, _) = system.held_matrices(period_s);
        let n = phi.nrows();
        // Within a period the drive of the period before acts for `rest_s`, then the present one.
        let (later, now) = system.held_matrices(period_s - rest_s);
        let (_, early) = system.held_matrices(rest_s);
        let before = &later * early;
        if self.delay_s <= 0.0 {
            return SampledModel {
                a: phi,
                b: now,
                c: system.c,
                period_s,
            };
        }
        // States: the plant's, then the drives that are on their way, newest first.
        let size = n + whole + 1;
        let mut a = DMatrix::zeros(size, size);
        let mut b = DVector::zeros(size);
        let mut c = DVector::zeros(size);
        a.view_mut((0, 0), (n, n)).copy_from(&phi);
        a.view_mut((0, n + whole), (n, 1)).copy_from(&before);
        if whole == 0 {
            b.view_mut((0, 0), (n, 1)).copy_from(&now);
        } else {
            a.view_mut((0, n + whole - 1), (n, 1)).copy_from(&now);
        }
        b[n] = 1.0;
        for i in 1..=whole {
            a[(n + i, n + i - 1)] = 1.0;
        }
        c.view_mut((0, 0), (n, 1)).copy_from(&system.c);
        SampledModel { a, b, c, period_s }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
    use super::*;

    fn linear() -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 4000.0,
                damping_ratio: 0.2,
            },
            second_mode: None,
            amplifier_bandwidth_hz: Some(5000.0),
            sensor_bandwidth_hz: Some(8000.0),
            period_s: 5e-5,
        }
    }

    fn step_answer(model: &SampledModel, ticks: usize) -> Vec<f64> {
        let mut x = DVector::zeros(model.b.len());
        (0..ticks)
            .map(|_| {
                x = &model.a * &x + &model.b;
                model.c.dot(&x)
            })
            .collect()
    }

    /// Delayed by fractions, seen on a grid ten times as fine with the drive held over ten of its steps.
    #[test]
    fn a_delay_within_a_period_is_the_one_of_a_finer_grid() {
        let fine = LinearModel {
            period_s: SAMPLING_PERIOD_S / 10.0,
            ..linear()
        }
        .sampled();
        for tenths in [3usize, 10, 17, 20] {
            let delayed = PlantVariation::with_delay_s(SAMPLING_PERIOD_S * tenths as f64 / 10.0)
                .sampled(&linear());
            let late = step_answer(&delayed, 30);
            let at_once = step_answer(&fine, 300);
            for (k, y) in late.iter().enumerate() {
                let steps = 10 * (k + 1);
                let expected = if steps > tenths {
                    at_once[steps - tenths - 1]
                } else {
                    0.0
                };
                assert!((y - expected).abs() < 1e-9, "{tenths} {k}: {y} {expected}");
            }
        }
    }

    #[test]
    fn an_unknown_mode_takes_its_share_from_the_first_one() {
        let mode = ModeModel {
            natural_frequency_rad_s: 30_000.0,
            damping_ratio: 0.3,
        };
        let varied = PlantVariation {
            gain: 1.3,
            mode: Some((0.1, mode)),
            ..PlantVariation::NONE
        }
        .sampled(&linear());
        let at_rest = step_answer(&varied, 3000).pop().unwrap();
        assert!((at_rest - 1.3).abs() < 1e-9, "{at_rest}");
        assert_eq!(
            PlantVariation::NONE.sampled(&linear()).a,
            linear().sampled().a
        );
    }
}
