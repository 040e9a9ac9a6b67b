//! What the data cannot tell about a model, whatever the fit says.

use super::uncertainty::estimate_uncertainty;
use crate::dataset::Dataset;
use crate::dataset::drive_variety::DriveVariety;
use crate::origin::note_origin;
use hysteron_sim::chain::Model;
use serde::Serialize;

/// Something that the data leave open.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "what")]
pub enum CannotIdentify {
    /// None of the values of an effect.
    AnyOf {
        /// The effect.
        effect: String,
    },
    /// Some of the values of an effect.
    SomeOf {
        /// The effect.
        effect: String,
        /// The parameters.
        parameters: Vec<String>,
    },
    /// The drive always turns at the same two voltages: nested reversals are a guess.
    MinorLoops,
    /// The drive moves at one speed only, or at few that are much alike: loops at other speeds are a guess.
    RateDependence {
        /// That speed in the fastest record, V/s.
        speed_v_s: f64,
        /// That speed in the slowest record, V/s.
        slowest_v_s: f64,
    },
}

/// Fills in the standard deviations of a fitted model and says what the data leave open.
#[must_use]
pub fn identifiability(
    model: &mut Model,
    dataset: &Dataset,
    records: &[usize],
) -> Vec<CannotIdentify> {
    model.identified = None;
    let mut by_effect: Vec<(String, Vec<String>)> = Vec::new();
    for u in estimate_uncertainty(model, dataset, records) {
        match by_effect.iter_mut().find(|(effect, _)| *effect == u.effect) {
            Some((_, names)) => names.push(u.parameter),
            None => by_effect.push((u.effect, vec![u.parameter])),
        }
    }
    let mut out: Vec<CannotIdentify> = by_effect
        .into_iter()
        .map(|(effect, parameters)| {
            let free = model.effect(&effect).map_or(0, |e| {
                e.parameters.iter().filter(|p| !p.parameter.fixed).count()
            });
            if parameters.len() == free {
                CannotIdentify::AnyOf { effect }
            } else {
                CannotIdentify::SomeOf { effect, parameters }
            }
        })
        .collect();
    note_origin(model, dataset, records);
    let seen = DriveVariety::of(dataset, records);
    if seen.one_loop() {
        out.push(CannotIdentify::MinorLoops);
    }
    if seen.one_speed() && !seen.varied_within_a_record() {
        out.push(CannotIdentify::RateDependence {
            speed_v_s: seen.speed_max_v_s,
            slowest_v_s: seen.speed_min_v_s.min(seen.speed_max_v_s),
        });
    }
    out
}
