//! Rate dependence of the hysteresis: the loops widen with the speed of the drive.
//!
//! The thesis makes every coefficient of `F` and `G` a polynomial of the input rate (Ch. 4,
//! Eqs. 16-17). What the data usually show is one factor for all of `G` and one for all of `F`:
//! `f = (1 + c v) F(M) - (1 + g v + h v^2) sum G`, with the rate `v` in units of 10^4 V/s. The
//! rate is that of successive drive samples, `|u[k] - u[k-1]| / T`.

use super::rate_dependent_surfaces::RateOrders;
use crate::block::Rate;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "rate_dependence";

/// Scaling of the hysteresis with the rate of the drive; the hysteresis stage applies it.
pub struct RateDependence;

/// Rate in which the coefficients are expressed, V/s.
const UNIT_RATE_V_S: f64 = 1e4;

/// How the rate acts on the output of the rate-independent operator.
#[derive(Clone, Copy, Debug, Default)]
pub struct RateLaw {
    loop_linear: f64,
    loop_quadratic: f64,
    curve_linear: f64,
}

impl RateLaw {
    /// The law in `model`, if it has one.
    #[must_use]
    pub fn from_model(model: &Model) -> Option<Self> {
        let values = model.values(ID)?;
        Some(Self {
            loop_linear: values[0],
            loop_quadratic: values[1],
            curve_linear: values[2],
        })
    }

    /// The law over intervals of this length, so many in a sampling period, beside the powers of the rate.
    pub(super) fn as_block(&self, dt_s: f64, substeps: usize, orders: Option<&RateOrders>) -> Rate {
        let Self {
            loop_linear,
            loop_quadratic,
            curve_linear,
        } = *self;
        Rate {
            loop_linear,
            loop_quadratic,
            curve_linear,
            dt_s,
            substeps,
            orders: orders.map_or_else(Vec::new, RateOrders::surfaces),
            orders_at: orders.map_or(1.0, |orders| orders.reference_rate_v_s() / UNIT_RATE_V_S),
        }
    }

    /// Output at the present rate, from the rate-independent output and `F(M_max)`.
    #[must_use]
    pub fn apply(&self, rate_independent: f64, curve: f64, rate_v_s: f64) -> f64 {
        let v = rate_v_s / UNIT_RATE_V_S;
        let lost = curve - rate_independent;
        curve * (1.0 + self.curve_linear * v)
            - lost * (1.0 + v * (self.loop_linear + v * self.loop_quadratic))
    }
}

impl Effect for RateDependence {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Domains need time to switch: the loops are wider the faster the drive moves."
                .into(),
            reference: "thesis Ch. 4, Eqs. 16-17".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "the same triangles at slopes from 100 to 35000 V/s".into(),
            fitting_rank: 5,
            beside: Some(id::HYSTERESIS),
            needs_several_speeds: true,
            picture: Picture {
                against: Against::Rate,
                caption: "An error that grows with the rate of the drive and changes sign with it.",
            },
            planted: Planted::InPairs,
            equations: r"Behind `hysteresis` and `play_operators`, with `v = |x[k] - x[k-1]| / T / (10^4 V/s)` and the output `y` so far:

`y = F(M_1) (1 + curve_linear v) - (F(M_1) - y) (1 + loop_linear v + loop_quadratic v^2)`, where `M_1` is the largest input so far.

In `n` sub-intervals `v` is that of whole periods while the drive steps from sample to sample: the counter `c` of sub-intervals without change is `n` at first. A change of `x` takes
`T` times `n` where `c + 1 >= n`, times 1 otherwise, and sets `c` to 0. Without change `c` grows by one, and the output is computed anew, with `v = 0`, from `c >= n` on; before that it stays. At rest the law does not act.",
            // 18 ns, and 4 ns of `hysteresis` (`benchmarks/results/speed.csv`).
            lasts_steps: Some(4),
            ..Declaration::at(Place::Hysteresis)
        }
    }

    fn parameters(&self, _overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear("loop_linear", "1/(10^4 V/s)", -5.0, 5.0, 0.01),
            Parameter::linear("loop_quadratic", "1/(10^4 V/s)^2", -5.0, 5.0, 0.01).fixed(),
            Parameter::linear("curve_linear", "1/(10^4 V/s)", -5.0, 5.0, 0.01).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![
            0.02 * UNIT_RATE_V_S / overview.slope_max_v_s.max(1.0),
            0.0,
            0.0,
        ]]
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.03 * case.strength, 0.0, 0.0])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, EffectInstance, InitialState, Model};
    use crate::effect::{Overview, by_id};

    /// A held drive has the speed of its samples, however finely the chain is stepped between them.
    #[test]
    fn the_rate_is_that_of_samples_at_any_step() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut model = Model::new(0.0, 80.0);
        for (id, values) in [
            ("hysteresis", &[10.0, 1.2, -1.2][..]),
            ("rate_dependence", &[0.3, 0.0, 0.1][..]),
        ] {
            model.add(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        }
        let drive_v: Vec<f64> = (0..200)
            .map(|k| 40.0 - 40.0 * (0.07 * f64::from(k)).cos())
            .map(|u| (u / 3.0).round() * 3.0)
            .collect();
        let drive = Drive::held(&drive_v, 5e-5, InitialState::Virgin);
        let coarse = model.simulate(&drive);
        for substeps in [2, 4, 7] {
            let fine = model.simulate_finely(&drive, substeps);
            // A sample that repeats the one before is at rest; between its sub-intervals and a whole period
            // there is no difference at the end.
            assert!(
                coarse.iter().zip(&fine).all(|(a, b)| (a - b).abs() < 1e-12),
                "{substeps}"
            );
        }
    }
}
