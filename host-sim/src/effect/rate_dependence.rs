//! Rate dependence of the hysteresis: the force-equivalent displacement depends on how fast the drive moves.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Scaling of the hysteresis with the rate of the drive; the hysteresis stage applies it.
pub struct RateDependence;

/// How the rate acts on the output of the rate-independent operator.
#[derive(Clone, Debug)]
pub struct RateLaw {
    coefficients: Vec<f64>,
    reference_v_s: f64,
}

impl RateLaw {
    /// The law in `model`, if it has one.
    #[must_use]
    pub fn of(model: &Model) -> Option<Self> {
        let values = model.values("rate_dependence")?;
        let (reference_v_s, coefficients) = values.split_last()?;
        Some(Self { coefficients: coefficients.to_vec(), reference_v_s: *reference_v_s })
    }

    /// Output at the present rate.
    pub fn apply(&mut self, rate_independent: f64, rate_v_s: f64) -> f64 {
        let s = rate_v_s / self.reference_v_s;
        let factor = self.coefficients.iter().rev().fold(0.0, |sum, c| (sum + c) * s);
        rate_independent * (1.0 + factor)
    }
}

impl Effect for RateDependence {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "rate_dependence".into(),
            physics: "Domains need time to switch: the faster the drive moves, the less of the hysteretic displacement follows.".into(),
            reference: "thesis Ch. 4, Eqs. 16-17".into(),
            place: Place::Hysteresis,
            modifies: Some("hysteresis"),
            experiment: "the same triangles at slopes from 100 to 35000 V/s".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, _overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::linear("rate_1", "1", -2.0, 2.0, 0.01), Parameter::logarithmic("reference_rate_v_s", "V/s", 1.0, 1e9).fixed()]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![-0.01, overview.slope_max_v_s.max(1.0)]]
    }
    fn stage<'a>(&self, _model: &Model, _values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        None
    }
}
