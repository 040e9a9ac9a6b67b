//! Rate dependence of the hysteresis: the loops widen with the speed of the drive.
//!
//! The thesis makes every coefficient of `F` and `G` a polynomial of the input rate (Ch. 4, Eqs. 16-17). What the data usually show is
//! one factor for all of `G` and one for all of `F`: `f = (1 + c v) F(M) - (1 + g v + h v^2) sum G`, with the rate `v` in units of
//! 10^4 V/s. The rate is that of successive drive samples, `|u[k] - u[k-1]| / T`.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// Scaling of the hysteresis with the rate of the drive; the hysteresis stage applies it.
pub struct RateDependence;

/// Rate in which the coefficients are expressed, V/s.
const UNIT_RATE_V_S: f64 = 1e4;

/// How the rate acts on the output of the rate-independent operator.
#[derive(Clone, Copy, Debug)]
pub struct RateLaw {
    loop_linear: f64,
    loop_quadratic: f64,
    curve_linear: f64,
}

impl RateLaw {
    /// The law in `model`, if it has one.
    #[must_use]
    pub fn of(model: &Model) -> Option<Self> {
        let values = model.values("rate_dependence")?;
        Some(Self { loop_linear: values[0], loop_quadratic: values[1], curve_linear: values[2] })
    }

    /// Output at the present rate, from the rate-independent output and `F(M_max)`.
    #[must_use]
    pub fn apply(&self, rate_independent: f64, curve: f64, rate_v_s: f64) -> f64 {
        let v = rate_v_s / UNIT_RATE_V_S;
        let lost = curve - rate_independent;
        curve * (1.0 + self.curve_linear * v) - lost * (1.0 + v * (self.loop_linear + v * self.loop_quadratic))
    }
}

impl Effect for RateDependence {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "rate_dependence".into(),
            physics: "Domains need time to switch: the loops are wider the faster the drive moves.".into(),
            reference: "thesis Ch. 4, Eqs. 16-17".into(),
            place: Place::Hysteresis,
            modifies: Some("hysteresis"),
            experiment: "the same triangles at slopes from 100 to 35000 V/s".into(),
            candidate: true,
            one_sided: false,
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
        vec![vec![0.02 * UNIT_RATE_V_S / overview.slope_max_v_s.max(1.0), 0.0, 0.0]]
    }
    fn stage<'a>(&self, _model: &Model, _values: &[f64], _setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        None
    }
}
