//! The initial ascending curve: the first rise to a new maximum leaves a remnant that no later loop removes.

use super::{
    Against, Declaration, Effect, Estimation, Overview, Parameter, Physics, Picture, Place,
    Presentation, SearchHints, Setting, SimulatedStage, Stage, SyntheticCases,
};
use crate::chain::Model;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = "initial_curve";

/// Remnant `R(M)` of the one-sided model; the hysteresis stage adds it.
pub struct InitialCurve {
    /// Number of Legendre terms.
    pub terms: usize,
}

impl Default for InitialCurve {
    /// Four, as in the thesis (Ch. 4, Eq. 14).
    fn default() -> Self {
        Self { terms: 4 }
    }
}

impl Physics for InitialCurve {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The first rise to a voltage never reached before switches domains that do not switch back: displacement remains."
                .into(),
            reference: "thesis Ch. 4, Eqs. 1, 10, 12-14".into(),
            place: Place::Hysteresis,
            modifies: Some(super::hysteresis::ID),
            experiment: "slow triangles of growing height from the virgin state".into(),
            candidate: true,
            one_sided: false,
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        (0..self.terms)
            .map(|k| Parameter::linear(format!("r_{k}_um"), "um", -1e6, 1e6, step))
            .collect()
    }

    fn stage<'a>(
        &self,
        _model: &Model,
        _values: &[f64],
        _setting: &Setting<'a>,
    ) -> Option<Box<dyn Stage + 'a>> {
        None
    }

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        (count > 0).then(|| Arc::new(Self { terms: count }) as Arc<dyn Effect>)
    }
}

impl Estimation for InitialCurve {
    fn fitting_rank(&self) -> usize {
        2
    }
}

impl SearchHints for InitialCurve {
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        (0..self.terms)
            .map(|k| {
                (0..self.terms)
                    .map(|i| {
                        if i == k {
                            0.02 * overview.range_um
                        } else {
                            0.0
                        }
                    })
                    .collect()
            })
            .collect()
    }

    fn starts_combine(&self) -> bool {
        true
    }

    fn may_join(&self, model: &Model, _overview: &Overview) -> bool {
        model.effect(super::hysteresis::ID).is_some()
    }

    fn unlikely_because(&self, model: &Model, values: &[f64]) -> Option<String> {
        let share = super::hysteresis::share_that_stays(model, values)?;
        (share < super::loops::OF_DOMAINS).then(|| {
            format!(
                "what stays of the first rise is {:.2} % of the height of the loops, of domains some per cent; what else goes slowly on its own way may look so",
                100.0 * share
            )
        })
    }

    fn ruled_out_because(&self, model: &Model, _values: &[f64]) -> Option<String> {
        model
            .ruled_out_because(super::hysteresis::ID)
            .map(|_| "it belongs to loops, and there are none".into())
    }
}

impl Presentation for InitialCurve {
    fn equations(&self) -> &'static str {
        r"`R(X) = X sum r_k_um P_k(X)` in the `F` of `hysteresis`, with the same `X` and `P_k`."
    }

    fn picture(&self) -> Picture {
        Picture {
            against: Against::Drive,
            caption: "An error that depends on the branch: first rise, later rises and falls go different ways at the same voltage.",
        }
    }
}

impl SyntheticCases for InitialCurve {
    fn values_at(
        &self,
        _strength: f64,
        stage: &SimulatedStage,
        _random: &mut dyn FnMut() -> f64,
    ) -> Option<Vec<f64>> {
        Some(stage.remnant_um.clone())
    }
}
