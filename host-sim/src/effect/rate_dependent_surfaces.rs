//! Rate-dependent hysteresis surfaces: every coefficient of `F` and `G` is a polynomial in the rate of the
//! drive (thesis Ch. 4, Eqs. 14, 16-18).
//!
//! The output is linear in the surfaces, so the model is the rate-independent operator beside one operator
//! for each power of the rate, all with the same memory, each weighted with its power of `|u[k] - u[k-1]| /
//! T`. Every surface vanishes on its diagonal (Ch. 4, 3.3), so that no reversal jumps at any rate. The
//! hysteresis stage adds them.
//!
//! The joint fit estimates all coefficients at once; the prior of every fit holds down those that the data do
//! not show, here at a fifth of the range. The printed procedure in two steps
//! is part of `hysteron reproduce 4`.

use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces};
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::RATE_DEPENDENT_SURFACES;

/// Degree of the loop surface of each power, and coefficients of its curve.
pub const DEGREE: usize = 3;
/// Coefficients of a loop surface of that degree.
pub const LOOP_TERMS: usize = crate::hysteresis_surface::coefficient_count(DEGREE);
/// Coefficients of the remnant of each power.
pub const CURVE_TERMS: usize = 3;
/// Coefficients of one power.
pub const TERMS: usize = LOOP_TERMS + CURVE_TERMS;

/// Surfaces in powers of the rate.
pub struct RateDependentSurfaces {
    /// Highest power; three in the thesis.
    pub orders: usize,
}

impl Default for RateDependentSurfaces {
    fn default() -> Self {
        Self { orders: 3 }
    }
}

/// The operators of the powers, from the first on.
#[derive(Clone, Debug)]
pub(super) struct RateOrders {
    operators: Vec<OneSidedHysteresis>,
    reference_rate_v_s: f64,
}

impl RateOrders {
    /// Of a model that has them.
    pub(super) fn from_model(model: &Model) -> Option<Self> {
        let values = model.values(ID)?;
        let (reference_rate_v_s, coefficients) = values.split_first()?;
        let operator = |terms: &[f64]| {
            let (loops, curve) = terms.split_at(LOOP_TERMS.min(terms.len()));
            OneSidedHysteresis::virgin(Surfaces::from_legendre(DEGREE, loops, curve), 0.0, 1.0)
        };
        Some(Self {
            operators: coefficients.chunks_exact(TERMS).map(operator).collect(),
            reference_rate_v_s: *reference_rate_v_s,
        })
    }

    /// The surfaces of each power.
    pub(super) fn surfaces(&self) -> Vec<Surfaces> {
        let of = |operator: &OneSidedHysteresis| operator.surfaces().clone();
        self.operators.iter().map(of).collect()
    }

    /// The rate at which the powers are one, V/s.
    pub(super) fn reference_rate_v_s(&self) -> f64 {
        self.reference_rate_v_s
    }

    /// The next input, in units of the drive range above the lower limit, at a rate; what the powers add, um.
    pub(super) fn step(&mut self, x: f64, rate_v_s: f64) -> f64 {
        let rate = rate_v_s / self.reference_rate_v_s;
        let (mut power, mut sum) = (1.0, 0.0);
        for operator in &mut self.operators {
            power *= rate;
            sum += power * operator.step(x);
        }
        sum
    }
}

impl Effect for RateDependentSurfaces {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Every coefficient of the loops and of the initial curve changes with the speed of the drive.".into(),
            reference: "thesis Ch. 4, Eqs. 14, 16-18".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "the same triangles at slopes from 100 to 35000 V/s".into(),
            fitting_rank: 5,
            beside: Some(id::HYSTERESIS),
            needs_several_speeds: true,
            picture: Picture {
                against: Against::Rate,
                caption: "An error that grows with the rate of the drive and differs from branch to branch.",
            },
            equations: r"Behind `hysteresis`, with `v = |x[k] - x[k-1]| / T / reference_rate_v_s`: to the output so far it adds `sum_p v^p y_p` over the powers `p` from 1 on. Each `y_p` is the output of the model of `hysteresis` and `initial_curve` for the same input, from the surfaces `g_i_j_rate_p_um` of degree 3 and `r_i_rate_p_um`.

In `n` sub-intervals `v` is counted as for `rate_dependence`.",
            ..Declaration::on_request(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.002 * overview.range_um.max(1e-6);
        let coefficient = |name: String| Parameter::linear(name, "um", -1e6, 1e6, step);
        let mut out = vec![Parameter::logarithmic("reference_rate_v_s", "V/s", 1e-9, 1e12).fixed()];
        for order in 1..=self.orders {
            let loops = crate::hysteresis_surface::loop_terms(DEGREE)
                .map(|(i, j)| format!("g_{i}_{j}_rate_{order}_um"));
            out.extend(
                loops
                    .chain((0..CURVE_TERMS).map(|k| format!("r_{k}_rate_{order}_um")))
                    .map(coefficient),
            );
        }
        out
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        // At the fastest drive the powers are one.
        vec![
            std::iter::once(overview.slope_max_v_s.max(1e-6))
                .chain(std::iter::repeat_n(0.0, TERMS * self.orders))
                .collect(),
        ]
    }

    fn with_parameters(&self, count: usize) -> Option<std::sync::Arc<dyn Effect>> {
        let coefficients = count.checked_sub(1)?;
        let whole = coefficients > 0 && coefficients.is_multiple_of(TERMS);
        whole.then(|| {
            std::sync::Arc::new(Self {
                orders: coefficients / TERMS,
            }) as std::sync::Arc<dyn Effect>
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::{Drive, InitialState};
    use crate::effect::model_of;
    use crate::rate_dependent_hysteresis::{RateDependentHysteresis, RateSurfaces};

    /// Oracle: the operators of the thesis' reproduction, one for each power of the rate.
    #[test]
    fn it_is_the_rate_dependent_model_of_the_thesis() {
        let overview = Overview {
            range_um: 10.0,
            ..Overview::without_data(0.0, 80.0)
        };
        let base = [10.0, 1.2, -1.2, 0.1, 0.05, -0.1, 0.02, 0.0, -0.03, 0.01];
        let by_rate: Vec<f64> = (0..3 * TERMS)
            .map(|k| 0.02 * ((7 * k % 5) as f64 - 2.0))
            .collect();
        let values: Vec<f64> = std::iter::once(5000.0)
            .chain(by_rate.iter().copied())
            .collect();
        let model = model_of(
            &overview,
            &[
                ("hysteresis", &base),
                ("initial_curve", &[0.3, -0.1, 0.02, 0.0]),
                (ID, &values),
            ],
        );
        let drive_v: Vec<f64> = (0..400)
            .map(|k| 40.0 - 40.0 * (0.05 * f64::from(k)).cos() * (0.013 * f64::from(k)).cos())
            .collect();
        let drive = Drive::held(&drive_v, 1e-3, InitialState::Virgin);
        let order = |terms: &[f64]| {
            Surfaces::from_legendre(DEGREE, &terms[..LOOP_TERMS], &terms[LOOP_TERMS..])
        };
        let orders = std::iter::once(Surfaces::from_legendre(4, &base, &[0.3, -0.1, 0.02, 0.0]))
            .chain(by_rate.chunks_exact(TERMS).map(order));
        let surfaces = RateSurfaces {
            orders: orders.collect(),
            reference_rate_v_s: 5000.0,
        };
        let mut oracle = RateDependentHysteresis::virgin(&surfaces, 0.0, 80.0, 1000.0);
        let expected: Vec<f64> = drive_v.iter().map(|u| oracle.step(*u)).collect();
        for (k, (got, wanted)) in model.simulate(&drive)[1..]
            .iter()
            .zip(&expected)
            .enumerate()
        {
            assert!((got - wanted).abs() < 1e-9, "{k}: {got} {wanted}");
        }
    }
}
