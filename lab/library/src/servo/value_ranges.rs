//! Ranges of the values in a servo file: what no actuator and no tuning has is refused before a loop is
//! judged with it.
//!
//! An observer for a sensor without noise, or for a mode of a negative frequency, has eigenvalues too, and
//! they look like any others.

use super::design::{DesignBasis, Scheme, ServoDesign};
use super::gain_adaptation::{FARTHEST, LARGEST_STEP};
use super::model::ActuatorModel;
use super::sensor_lag::LARGEST_LAG_PERIODS;
use super::tuning::{Demands, PredictorTuning};
use std::ops::RangeInclusive;

/// A value with its name in the file, and where it may lie.
type Bounded<'a> = (&'a str, f64, RangeInclusive<f64>);

/// Smallest value of what must be above zero, in its unit.
const ABOVE_ZERO: f64 = 1e-12;
/// Largest displacement that is spoken of, um.
const FARTHEST_UM: f64 = 1e6;

fn of_tuning(t: &PredictorTuning) -> Vec<Bounded<'static>> {
    vec![
        ("effort_weight", t.effort_weight, ABOVE_ZERO..=1e12),
        (
            "unknown_change_um",
            t.unknown_change_um,
            ABOVE_ZERO..=FARTHEST_UM,
        ),
        (
            "unknown_slope_change_um",
            t.unknown_slope_change_um,
            0.0..=FARTHEST_UM,
        ),
        ("force_noise_um", t.force_noise_um, 0.0..=FARTHEST_UM),
        (
            "sensor_noise_um",
            t.sensor_noise_um,
            ABOVE_ZERO..=FARTHEST_UM,
        ),
        ("fast_noise_um", t.fast_noise_um, 0.0..=FARTHEST_UM),
    ]
}

fn of_model(m: &ActuatorModel) -> Vec<Bounded<'static>> {
    let mut out = vec![
        ("drive_min_v", m.drive_min_v, -1e5..=1e5),
        (
            "drive_max_v",
            m.drive_max_v,
            m.drive_min_v + ABOVE_ZERO..=1e5,
        ),
    ];
    out.extend(m.g_um.iter().flatten().chain(&m.r_um).map(|c| {
        (
            "a coefficient of the hysteresis",
            *c,
            -FARTHEST_UM..=FARTHEST_UM,
        )
    }));
    let second = m.linear.second_mode;
    out.extend(second.map(|(share, _)| ("the share of the second mode", share, -1.0..=1.0)));
    for mode in std::iter::once(m.linear.first_mode).chain(second.map(|(_, mode)| mode)) {
        out.push((
            "natural_frequency_rad_s",
            mode.natural_frequency_rad_s,
            1.0..=1e7,
        ));
        out.push(("damping_ratio", mode.damping_ratio, 0.0..=100.0));
    }
    out.extend(
        m.linear
            .amplifier_bandwidth_hz
            .map(|hz| ("amplifier_bandwidth_hz", hz, 1e-3..=1e9)),
    );
    out.extend(
        m.linear
            .sensor_bandwidth_hz
            .map(|hz| ("sensor_bandwidth_hz", hz, 1e-3..=1e9)),
    );
    out.push(("period_s", m.linear.period_s, 1e-6..=1e-2));
    for term in &m.creep {
        out.push(("share of a creep term", term.share, -10.0..=10.0));
        out.push((
            "time_constant_s of a creep term",
            term.time_constant_s,
            1e-9..=1e9,
        ));
        out.push((
            "threshold_um of a creep term",
            term.threshold_um,
            0.0..=FARTHEST_UM,
        ));
    }
    if let Some(pair) = &m.creep_pair {
        out.push(("share of creep_pair", pair.share, -10.0..=10.0));
        out.push((
            "velocity_share of creep_pair",
            pair.velocity_share,
            -10.0..=10.0,
        ));
        out.push((
            "natural_frequency_rad_s of creep_pair",
            pair.natural_frequency_rad_s,
            1e-9..=1e5,
        ));
        out.push((
            "damping_ratio of creep_pair",
            pair.damping_ratio,
            0.0..=100.0,
        ));
    }
    out
}

fn of_basis(basis: &DesignBasis) -> Vec<Bounded<'static>> {
    let Demands {
        reference_hz,
        model_error_um,
        sensor_noise_um,
        sensitivity_peak,
        ..
    } = basis.demands;
    let mut values = vec![
        ("reference_hz of the basis", reference_hz, ABOVE_ZERO..=1e6),
        (
            "model_error_um of the basis",
            model_error_um,
            0.0..=FARTHEST_UM,
        ),
        (
            "sensor_noise_um of the basis",
            sensor_noise_um,
            ABOVE_ZERO..=FARTHEST_UM,
        ),
        (
            "sensitivity_peak of the basis",
            sensitivity_peak,
            1.0..=100.0,
        ),
        ("delay_s of the basis", basis.delay_s, 0.0..=1.0),
    ];
    for spread in std::iter::once(basis.first).chain(basis.second) {
        values.extend([
            ("frequency of a spread", spread.frequency, 0.0..=0.99),
            ("damping of a spread", spread.damping, 0.0..=0.99),
        ]);
    }
    values
}

impl ServoDesign {
    /// The first value that no servo has, with what was expected; `None` where all can be.
    pub(super) fn impossible_value(&self) -> Option<String> {
        let mut values = of_model(&self.model);
        if let Scheme::Predictor { tuning, .. } = &self.scheme {
            values.extend(of_tuning(tuning));
        }
        if let Some(basis) = &self.basis {
            values.extend(of_basis(basis));
        }
        values.extend(self.sensor_noise_um.map(|noise_um| {
            (
                "sensor_noise_um of the servo",
                noise_um,
                ABOVE_ZERO..=FARTHEST_UM,
            )
        }));
        values.extend(self.sensor_lag_s.map(|lag_s| {
            (
                "sensor_lag_s of the servo",
                lag_s,
                0.0..=LARGEST_LAG_PERIODS * self.period_s(),
            )
        }));
        if let Some(a) = &self.adaptation {
            values.extend([
                (
                    "farthest of the adaptation",
                    a.farthest,
                    ABOVE_ZERO..=FARTHEST,
                ),
                (
                    "most_step of the adaptation",
                    a.most_step,
                    ABOVE_ZERO..=LARGEST_STEP,
                ),
                (
                    "error_limit_um of the adaptation",
                    a.error_limit_um,
                    ABOVE_ZERO..=FARTHEST_UM,
                ),
                (
                    "least_motion_um of the adaptation",
                    a.least_motion_um,
                    ABOVE_ZERO..=FARTHEST_UM,
                ),
            ]);
        }
        let outside = values
            .into_iter()
            .find(|(_, value, range)| !range.contains(value));
        outside.map(|(name, value, range)| {
            format!(
                "{name} = {value}; expected {:e} to {:e}",
                range.start(),
                range.end()
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::model::{CreepTerm, LinearModel, ModeModel};

    fn design() -> ServoDesign {
        let first_mode = ModeModel {
            natural_frequency_rad_s: 5000.0,
            damping_ratio: 0.3,
        };
        let linear = LinearModel {
            first_mode,
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: Some(1e4),
            period_s: 5e-5,
        };
        let creep = vec![CreepTerm::linear(0.01, 0.1)];
        let model = ActuatorModel {
            drive_min_v: 0.0,
            drive_max_v: 80.0,
            g_um: vec![vec![10.0]],
            r_um: vec![0.1],
            linear,
            creep,
            creep_pair: None,
        };
        ServoDesign::new(
            Scheme::Predictor {
                tuning: PredictorTuning::START,
                hysteresis_inverse: true,
            },
            &model,
            true,
        )
    }

    /// Sets the value of a key.
    type Set = fn(&mut ServoDesign, f64);

    #[test]
    fn every_value_that_cannot_be_is_named() {
        assert_eq!(design().impossible_value(), None);
        let broken: [(&str, Set); 8] = [
            ("drive_max_v", |d, v| d.model.drive_max_v = v),
            ("natural_frequency_rad_s", |d, v| {
                d.model.linear.first_mode.natural_frequency_rad_s = v
            }),
            ("damping_ratio", |d, v| {
                d.model.linear.first_mode.damping_ratio = v
            }),
            ("sensor_lag_s", |d, v| d.sensor_lag_s = Some(v)),
            ("sensor_bandwidth_hz", |d, v| {
                d.model.linear.sensor_bandwidth_hz = Some(v)
            }),
            ("time_constant_s", |d, v| {
                d.model.creep[0].time_constant_s = v
            }),
            ("sensor_noise_um", |d, v| {
                d.scheme = Scheme::Predictor {
                    tuning: PredictorTuning {
                        sensor_noise_um: v,
                        ..PredictorTuning::START
                    },
                    hysteresis_inverse: true,
                };
            }),
            ("fast_noise_um", |d, v| {
                d.scheme = Scheme::Predictor {
                    tuning: PredictorTuning {
                        fast_noise_um: v,
                        ..PredictorTuning::START
                    },
                    hysteresis_inverse: true,
                };
            }),
        ];
        for (name, set) in broken {
            for value in [f64::NAN, f64::INFINITY, -1.0, 1e30] {
                let mut design = design();
                set(&mut design, value);
                assert!(
                    design
                        .impossible_value()
                        .is_some_and(|said| said.contains(name)),
                    "{name} = {value}"
                );
            }
        }
    }
}
