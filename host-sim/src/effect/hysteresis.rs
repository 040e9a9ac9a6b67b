//! Rate-independent hysteresis with memory: the classical Preisach model and, with the initial ascending curve, the one-sided model.
//!
//! The stage holds the surfaces of [`crate::hysteresis_surface`]. `initial_curve`, `rate_dependence` and `bipolar` are properties of
//! this stage: it reads their values from the model.

use super::play_operators::PlayOperators;
use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage, bipolar, rate_dependence};
use crate::chain::Model;
use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces, loop_terms};

/// Classical Preisach hysteresis in polynomial surfaces.
pub struct Hysteresis {
    /// Degree of the loop surface `G`.
    pub degree: usize,
}

impl Default for Hysteresis {
    /// Degree 4, as in the thesis (Ch. 4, Eq. 15).
    fn default() -> Self {
        Self { degree: 4 }
    }
}

/// Number of coefficients of a loop surface.
#[must_use]
pub fn coefficient_count(degree: usize) -> usize {
    degree * (degree + 1) / 2
}

/// Degree of a loop surface with so many coefficients.
#[must_use]
pub fn degree_of(coefficients: usize) -> usize {
    (1..).find(|d| coefficient_count(*d) >= coefficients).unwrap_or(1)
}

struct HysteresisStage {
    operator: OneSidedHysteresis,
    plays: Option<PlayOperators>,
    lower_limit_v: f64,
    range_v: f64,
    rate: Option<rate_dependence::RateLaw>,
    last_drive_v: f64,
    output_um: f64,
    dt_s: f64,
    /// Intervals in a sampling period, and how many have passed since the drive changed.
    substeps: usize,
    unchanged: usize,
}

impl Stage for HysteresisStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        if input == self.last_drive_v {
            self.unchanged += 1;
            // A held drive has the rate of its sample until the next one.
            if self.rate.is_none() || self.unchanged < self.substeps {
                return self.output_um;
            }
        }
        // Over a held sample the rate is that of successive samples; a drive that moves inside a period has its own.
        let intervals = if self.unchanged + 1 >= self.substeps { self.substeps } else { 1 };
        if input != self.last_drive_v {
            self.unchanged = 0;
        }
        self.output_um = self.rate_independent(input);
        if let Some(law) = &self.rate {
            let rate_v_s = (input - self.last_drive_v).abs() / (self.dt_s * intervals as f64);
            self.output_um = law.apply(self.output_um, self.curve_at_maximum_um(), rate_v_s);
        }
        self.last_drive_v = input;
        self.output_um
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.last_drive_v = input;
        self.unchanged = self.substeps;
        self.output_um = self.rate_independent(input);
        self.output_um
    }
}

impl HysteresisStage {
    fn rate_independent(&mut self, drive_v: f64) -> f64 {
        let x = (drive_v - self.lower_limit_v) / self.range_v;
        self.operator.step(drive_v) + self.plays.as_mut().map_or(0.0, |plays| plays.step(x))
    }

    /// Where the initial ascending curve was left, or is.
    fn curve_at_maximum_um(&self) -> f64 {
        let maximum = self.operator.stack().global_maximum();
        self.operator.initial_curve_at_maximum() + self.plays.as_ref().map_or(0.0, |plays| plays.initial_ascending_curve(maximum))
    }
}

impl Effect for Hysteresis {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "hysteresis".into(),
            physics: "Domain switching makes the displacement depend on the extrema of the drive so far: loops that close and nest.".into(),
            reference: "thesis Ch. 4, Eqs. 12-15 with F(M) = G(M, 0); Mayergoyz, Mathematical Models of Hysteresis (1991)".into(),
            place: Place::Hysteresis,
            modifies: None,
            experiment: "slow triangles of several heights with nested reversals".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        loop_terms(self.degree).map(|(i, j)| Parameter::linear(format!("g_{i}_{j}_um"), "um", -1e6, 1e6, step)).collect()
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        // A loop of 15 % of the range, as piezo stacks have: on the way down from x less is lost at first than near zero.
        let mut values = vec![0.0; coefficient_count(self.degree)];
        let scale = overview.gain_um_v * overview.drive_range_v();
        values[0] = scale;
        if self.degree > 1 {
            values[1] = 0.12 * scale;
            values[2] = -0.12 * scale;
        }
        vec![values]
    }
    fn stage<'a>(&self, model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        let remnant = model.values("initial_curve").unwrap_or_default();
        let surfaces = Surfaces::from_legendre(degree_of(values.len()), values, &remnant);
        let lower_limit_v = bipolar::lower_limit_v(model);
        let range_v = model.drive_max_v - lower_limit_v;
        Some(Box::new(HysteresisStage {
            operator: OneSidedHysteresis::virgin(surfaces, lower_limit_v, range_v),
            plays: PlayOperators::of(model),
            lower_limit_v,
            range_v,
            rate: rate_dependence::RateLaw::of(model),
            last_drive_v: lower_limit_v,
            output_um: 0.0,
            dt_s: setting.dt_s,
            substeps: setting.substeps,
            unchanged: setting.substeps,
        }))
    }
}
