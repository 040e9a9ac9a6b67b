//! PI and PID with a notch, seen as a law of the predictor's form: for the eigenvalues and margins of the
//! sampled loop, and for tuning under the margins that every design keeps. What runs in the tick is
//! [`super::thesis_schemes::regulator`].

use super::assessment::{Assessment, best_of};
use super::candidate::Family;
use super::law::{PredictorDesign, STATES};
use super::model::{LinearModel, SAMPLING_PERIOD_S};
use super::quantise::Unit;
use super::thesis_schemes::{Feedforward, Notch, PidGains, regulator};
use super::tuning::Demands;
use nalgebra::{DMatrix, DVector};

/// The regulator in f64. States: output, last error, two of the notch, integral.
#[must_use]
pub fn law(gains: &PidGains, notch: Option<&Notch>) -> PredictorDesign {
    let (output, last_error, notch_1, notch_2, integral) = (0, 1, 2, 3, STATES - 1);
    let [n0, n1, n2, d1, d2] = notch.map_or([1.0, 0.0, 0.0, 0.0, 0.0], Notch::coefficients);
    let t = SAMPLING_PERIOD_S;
    let mut a = DMatrix::zeros(STATES, STATES);
    let (mut l, mut k) = (DVector::zeros(STATES), DVector::zeros(STATES));
    // r = (P + D / T + I T) e - D / T e[k-1] + J; the notch in transposed direct form: out = n0 r + s1.
    let direct = gains.p + gains.d / t + gains.i * t;
    for (row, of_r, of_output) in [(output, n0, 0.0), (notch_1, n1, d1), (notch_2, n2, d2)] {
        let weight = of_r + of_output * n0;
        l[row] = weight * direct;
        a[(row, last_error)] = -weight * gains.d / t;
        a[(row, integral)] = weight;
        a[(row, notch_1)] = if row == output { 1.0 } else { of_output };
    }
    a[(notch_1, notch_2)] = 1.0;
    l[last_error] = 1.0;
    a[(integral, integral)] = 1.0;
    l[integral] = gains.i * t;
    k[output] = 1.0;
    PredictorDesign {
        a,
        b: DVector::zeros(STATES),
        c: DVector::zeros(STATES),
        l,
        k,
        feedforward: Vec::new(),
        period_s: t,
    }
}

/// A notch at the most lightly damped mode of a model, its poles critically damped.
#[must_use]
pub fn notch_for(linear: &LinearModel) -> Notch {
    let mode = linear.second_mode.map_or(linear.first_mode, |(_, second)| {
        if second.damping_ratio < linear.first_mode.damping_ratio {
            second
        } else {
            linear.first_mode
        }
    });
    Notch {
        frequency_hz: mode.natural_frequency_rad_s / std::f64::consts::TAU,
        zero_damping_ratio: mode.damping_ratio,
        pole_damping_ratio: 1.0,
    }
}

/// The PI with the smallest expected error of those that keep the margins; its output is um of
/// force-equivalent displacement.
#[must_use]
pub fn tune(
    linear: &LinearModel,
    demands: &Demands,
    notch: Option<&Notch>,
) -> Option<Assessment<PidGains>> {
    let mut candidates = Vec::new();
    for step in 0..24 {
        for p in [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.4] {
            candidates.push(PidGains {
                p,
                i: 50.0 * 1.25_f64.powi(step),
                d: 0.0,
            });
        }
    }
    best_of(&candidates, |gains| law(gains, notch), linear, demands)
}

/// PID on the tracking error, in um of force-equivalent displacement.
pub struct Regulators;

impl Family for Regulators {
    type Tuning = PidGains;

    fn law(&self, gains: &PidGains) -> Option<PredictorDesign> {
        Some(law(gains, None))
    }

    fn fits(&self, gains: &PidGains, _law: &PredictorDesign) -> bool {
        regulator(gains, &Feedforward::default(), None, Unit::Micrometre).is_ok()
    }

    fn grid(&self, _demands: &Demands) -> Vec<PidGains> {
        let mut out = Vec::new();
        for step in 0..32 {
            for p in [0.01, 0.1, 0.3, 0.6, 1.0] {
                for d in [0.0, 1e-5, 1e-4] {
                    out.push(PidGains {
                        p,
                        i: 1.5 * 1.3_f64.powi(step),
                        d,
                    });
                }
            }
        }
        out
    }

    fn numbers(&self) -> usize {
        3
    }

    fn stepped(&self, gains: &PidGains, number: usize, by: f64) -> PidGains {
        let mut out = *gains;
        match number {
            0 => out.p *= by,
            1 => out.i *= by,
            _ => out.d *= by,
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::ModeModel;
    use super::*;

    /// The law is the difference equation of the regulator with its notch, written the other way.
    #[test]
    fn the_law_is_the_regulator() {
        let gains = PidGains {
            p: 0.3,
            i: 900.0,
            d: 2e-5,
        };
        let notch = Notch {
            frequency_hz: 3000.0,
            zero_damping_ratio: 0.05,
            pole_damping_ratio: 0.8,
        };
        let design = law(&gains, Some(&notch));
        let n = notch.coefficients();
        let (mut z, mut integral, mut last, mut memory) =
            (DVector::zeros(STATES), 0.0, 0.0, [0.0; 4]);
        for tick in 0..200 {
            let e = (f64::from(tick) * 0.13).sin();
            z = &design.a * &z + &design.l * e;
            integral += gains.i * SAMPLING_PERIOD_S * e;
            let r = gains.p * e + gains.d / SAMPLING_PERIOD_S * (e - last) + integral;
            last = e;
            let y = n[0] * r
                + n[1] * memory[0]
                + n[2] * memory[1]
                + n[3] * memory[2]
                + n[4] * memory[3];
            memory = [r, memory[0], y, memory[2]];
            assert!((design.k.dot(&z) - y).abs() < 1e-12, "{tick}");
        }
    }

    #[test]
    fn a_notch_lets_the_integral_gain_rise() {
        let linear = LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: 3000.0,
                damping_ratio: 0.02,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        };
        let demands = Demands {
            sensitivity_peak: 4.0,
            ..Demands::default()
        };
        let without = tune(&linear, &demands, None).unwrap().tuning;
        let with = tune(&linear, &demands, Some(&notch_for(&linear))).map_or(0.0, |t| t.tuning.i);
        assert!(with > without.i, "{with} {}", without.i);
    }
}
