//! The initial ascending curve: the first rise to a new maximum leaves a remnant that no later loop removes.

use crate::hysteresis_surface::Surfaces;
use crate::physics::*;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = id::INITIAL_CURVE;

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

impl Effect for InitialCurve {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The first rise to a voltage never reached before switches domains that do not switch back: displacement remains."
            .into(),
            reference: "thesis Ch. 4, Eqs. 1, 10, 12-14".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "slow triangles of growing height from the virgin state".into(),
            fitting_rank: 2,
            starts_combine: true,
            beside: Some(id::HYSTERESIS),
            picture: Picture {
                against: Against::Drive,
                caption: "An error that depends on the branch: first rise, later rises and falls go different ways at the same voltage.",
            },
            equations: r"`R(X) = X sum r_k_um P_k(X)` in the `F` of `hysteresis`, with the same `X` and `P_k`.",
            opening: Opening::OfModified,
            ..Declaration::at(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        (0..self.terms)
            .map(|k| Parameter::linear(format!("r_{k}_um"), "um", -1e6, 1e6, step))
            .collect()
    }

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

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        (count > 0).then(|| Arc::new(Self { terms: count }) as Arc<dyn Effect>)
    }

    fn doubt(&self, model: &Model, values: &[f64]) -> Option<Doubt> {
        let share = share_that_stays(model, values)?;
        (share < crate::loop_opening::OF_DOMAINS).then(|| {
            Doubt::Unlikely(format!(
                "what stays of the first rise is {:.2} % of the height of the loops, of domains some per cent; what else goes slowly on its own way may look so",
                100.0 * share
            ))
        })
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(case.stage.remnant_um.clone())
    }
}

/// Inputs at which what stays is looked at.
const BRANCH: u32 = 200;

/// Share of the height of the loops of a model that stays after the first rise, of an initial curve of these
/// values at most.
fn share_that_stays(model: &Model, remnant: &[f64]) -> Option<f64> {
    model.effect(id::HYSTERESIS)?;
    let (_, height_um) = crate::loop_opening::widest_opening_and_height_um(model);
    let stays = Surfaces::from_legendre(1, &[], remnant);
    let most_um = (0..=BRANCH)
        .map(|k| {
            stays
                .initial_ascending_curve(f64::from(k) / f64::from(BRANCH))
                .abs()
        })
        .fold(0.0, f64::max);
    Some(most_um / height_um)
}
