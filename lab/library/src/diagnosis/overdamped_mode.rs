//! A first mode that does not swing is a lag.
//!
//! Of a slow lag and a mode a search may fit the first mode to the lag and a second one to the mode: a sum of the two, where they stand one behind the other. It
//! then adds what makes up for the difference, and no exchange of one effect comes back. So the model is tried with the second mode in the place of the
//! first, and a lag with the first one's slow pole, if none that is there takes it up.

use super::judgement::Judged;
use super::study::Study;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{amplifier_bandwidth, by_id, second_mode, sensor_bandwidth, vibration};
use std::f64::consts::TAU;

/// A damping ratio at which a mode neither rings nor resonates, and is no filter of an order that is built.
const OVERDAMPED: f64 = 1.5;

/// The model with a lag for an overdamped first mode where that does as well, and what it adds to the start.
#[must_use]
pub fn as_a_lag(study: &Study, judged: Judged, added: Vec<String>) -> (Judged, Vec<String>) {
    let Some((mode, lag_hz)) = mode_and_lag(&judged.model, &added) else { return (judged, added) };
    let lags = [sensor_bandwidth::ID, amplifier_bandwidth::ID].into_iter().filter(|id| judged.model.effect(id).is_none());
    let begun = |lag: Option<&str>| match lag.and_then(by_id) {
        Some(lag) => study.with(&mode, &[(lag, vec![lag_hz])]),
        None => mode.clone(),
    };
    let ways: Vec<Option<&str>> = std::iter::once(None).chain(lags.map(Some)).collect();
    let fitted = crate::parallel::map(&ways, |lag| study.for_comparison(&begun(*lag)));
    // With none more it is the simpler one.
    let as_well = study.merit(&judged) + study.policy.least_gain;
    let found = ways.into_iter().zip(fitted).find(|(_, one)| study.merit(one) < as_well);
    let Some((lag, one)) = found else { return (judged, added) };
    let kept = added.into_iter().filter(|id| one.model.effect(id).is_some());
    let added = kept.chain(lag.map(String::from)).collect();
    (one, added)
}

/// The model with its second mode in the place of the first, which is overdamped, and the bandwidth of that one's slow pole, Hz.
fn mode_and_lag(model: &Model, added: &[String]) -> Option<(Model, f64)> {
    let (first, second) = (model.values(vibration::ID)?, model.values(second_mode::ID)?);
    if first[1] < OVERDAMPED || !added.iter().any(|id| id == second_mode::ID) {
        return None;
    }
    let mut out = model.clone();
    out.effects.retain(|e| e.id != second_mode::ID);
    let mode = out.effects.iter_mut().find(|e| e.id == vibration::ID)?;
    mode.parameters[0].value = second[1];
    mode.parameters[1].value = second[2];
    let slow_pole_rad_s = first[0] * (first[1] - (first[1] * first[1] - 1.0).sqrt());
    Some((out, slow_pole_rad_s / TAU))
}
