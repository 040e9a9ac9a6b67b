//! Does a record begin in the state that was said?
//!
//! A record that is said to begin virgin or settled is simulated from there: no constant, no slow motion of its own is estimated. Where it was
//! driven before, what is left of that looks like creep, drift or a missing initial curve to a search, which would name one. The simpler story is
//! asked first: the very same effects, with the states of all records unknown, meet the noise, and no single effect does as well from the states that were
//! said.
//!
//! The zero of a sensor is one more thing that a record is said to begin with: of one that is said to begin virgin no constant is estimated. Where a sensor stands a
//! few nanometres off, a drift that comes at once to its end is what a search finds; a constant, which is less, is asked for in its place.
//!
//! A state that nobody knows leaves creep and modes free, but not what loops remember: that is known once the drive has been through its range, and said
//! where much of a record comes before.

use super::judgement::{Judged, Split};
use super::study::Study;
use crate::dataset::{Dataset, Record};
use crate::identification::finer_hysteresis::with_the_structure_of;
use crate::identification::fit::rms;
use crate::parallel;
use crate::statistics::extremes;
use crate::watch::Event;
use hysteron_sim::chain::{InitialState, Model};
use hysteron_sim::effect::thermal_drift;

/// States are suspected where the error without them is below this share of that with them.
const SUSPECTED: f64 = 0.8;

/// Effects that are tried in the place of other states, and how much worse one may be: some per cent of the error.
const ONES_TRIED: usize = 3;
const AS_WELL: f64 = 0.1;
/// What a constant of each record brings, as a logarithm, where a model that misses the noise comes to it with them: where one is left just above it anything that is
/// free brings it there.
const BROUGHT_BY_CONSTANTS: f64 = 0.1;
/// A quick fit that is behind by more does not come to it.
const MAY_COME_TO_IT: f64 = 0.5;

/// Records whose readings stand off by a constant although that was said to be zero.
#[derive(Clone, Debug, PartialEq)]
pub struct OffZero {
    /// Their names.
    pub records: Vec<String>,
    /// The largest error of these records as that was said, um.
    pub as_said_um: f64,
    /// The largest error of them with one each, um.
    pub fitted_um: f64,
}

/// Asks whether a constant of each record, where none was said, brings the effects of a model to the noise which does not meet it, or does as well as a drift that
/// was added; nothing where it does not. Loops that stand in for the constant make place for those that were begun with.
#[must_use]
pub fn off_zero(study: &Study, begun: &Judged, found: &Judged, added: &[String]) -> Option<OffZero> {
    let said: Vec<usize> = study.split.both().into_iter().filter(|i| !study.dataset.records[*i].offset_is_fitted).collect();
    let explains = |judged: &Judged| judged.within(study.policy.explained, &study.floors_um, &study.split);
    let drifts = added.iter().any(|id| id == thermal_drift::ID);
    let misses = study.floor_um.is_some() && !explains(found);
    if said.is_empty() || !(drifts || misses) || study.watch.stopped() {
        return None;
    }
    study.watch.event(&Event::Doing("asking whether a sensor's zero is off"));
    let mut free = study.dataset.clone();
    free.records.iter_mut().for_each(|record| record.offset_is_fitted = true);
    let other = study.of(&free);
    let as_it_is = study.without(&found.model, thermal_drift::ID);
    let with_its_loops = with_the_structure_of(&as_it_is, &begun.model);
    let tried: Vec<Model> = std::iter::once(as_it_is).chain(with_its_loops).collect();
    let quick = parallel::map(&tried, |model| other.quickly(model)).into_iter().min_by(|a, b| other.merit(a).total_cmp(&other.merit(b)))?;
    if other.merit(&quick) > study.merit(found) + MAY_COME_TO_IT {
        return None;
    }
    let without = other.judged(other.for_comparison(&quick.model).model);
    let brings_it_there = explains(&without) && other.merit(&without) < study.merit(found) - BROUGHT_BY_CONSTANTS;
    if study.told_apart(&without, found) || (misses && !brings_it_there) {
        return None;
    }
    let as_said = study.judged(without.model.clone());
    let largest = |judged: &Judged| said.iter().map(|i| rms(&judged.residuals[*i])).fold(0.0, f64::max);
    Some(OffZero {
        records: said.iter().map(|i| study.dataset.records[*i].name.clone()).collect(),
        as_said_um: largest(&as_said),
        fitted_um: largest(&without),
    })
}

/// Records that do not begin in the state that was said.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherStates {
    /// Their names.
    pub records: Vec<String>,
    /// The largest error of these records as they are said to begin, um.
    pub as_said_um: f64,
    /// The largest error of them with states unknown and the same effects, um.
    pub unknown_um: f64,
}

/// Asks the states of all records, given a fitted model; nothing where it meets the noise as it is, where no noise is known or where other states do not
/// bring the same effects down to it.
#[must_use]
pub fn compare(study: &Study, fitted: &Judged) -> Option<OtherStates> {
    let explains = |judged: &Judged| judged.within(study.policy.explained, &study.floors_um, &study.split);
    let both = study.split.both();
    let said = |i: &usize| study.dataset.records[*i].initial_state != InitialState::Unknown;
    if study.floor_um.is_none() || explains(fitted) || !both.iter().any(said) || study.watch.stopped() {
        return None;
    }
    study.watch.event(&Event::Doing("asking the states in which records begin"));
    let unsaid = unknown_states(study.dataset);
    let other = study.of(&unsaid);
    let lower = |before: &Judged, after: &Judged| other.merit(after) < study.merit(before) + SUSPECTED.ln();
    let quick = other.quickly(&fitted.model);
    if !lower(fitted, &quick) {
        return None;
    }
    let without = other.judged(other.for_comparison(&quick.model).model);
    if !explains(&without) || !lower(fitted, &without) || one_effect_does_as_well(study, fitted, other.merit(&without)) {
        return None;
    }
    // Those that the model so found does not meet from where they are said to begin.
    let as_said = study.judged(without.model.clone());
    let misses = |i: &&usize| rms(&as_said.residuals[**i]) > study.policy.explained * rms(&without.residuals[**i]);
    let missed: Vec<usize> = both.iter().filter(|i| said(i)).filter(misses).copied().collect();
    let largest = |judged: &Judged| missed.iter().map(|i| rms(&judged.residuals[*i])).fold(0.0, f64::max);
    (!missed.is_empty()).then(|| OtherStates {
        records: missed.iter().map(|i| study.dataset.records[*i].name.clone()).collect(),
        as_said_um: largest(&as_said),
        unknown_um: largest(&without),
    })
}

/// Whether one effect more, from the states that were said, comes as near to the noise as unknown states of all records do, which are many more values: a
/// drift is met by them too.
fn one_effect_does_as_well(study: &Study, fitted: &Judged, unknown: f64) -> bool {
    let Ok(screening) = study.score(&fitted.model) else { return false };
    let tried = parallel::map(&screening.scores[..screening.scores.len().min(ONES_TRIED)], |score| {
        let begin = study.with(&fitted.model, &[(score.effect.clone(), score.starts[0].clone())]);
        study.merit(&study.for_comparison(&study.quickly(&begin).model))
    });
    tried.into_iter().any(|merit| merit < unknown + AS_WELL)
}

/// The same data, nothing known of how its records begin.
fn unknown_states(dataset: &Dataset) -> Dataset {
    let mut out = dataset.clone();
    for record in &mut out.records {
        record.initial_state = InitialState::Unknown;
        record.offset_is_fitted = true;
    }
    out
}

/// Share of a range at whose end a drive that is so near counts as being there.
const AT_AN_END: f64 = 0.02;
/// Share of a window in which loops still remember what was before the record that is worth a word.
const REMEMBERED: f64 = 0.1;

/// When the drive of a record has first been through its whole range, in s from its first sample, where the record begins inside that range in a state that nobody
/// knows and much of its window comes before: until then its loops remember what no sample shows (wiping out, thesis Ch. 4).
fn remembers_until_s(record: &Record) -> Option<f64> {
    let (low, high) = extremes(&record.drive_v);
    let near = AT_AN_END * (high - low);
    let (bottom, top) = (low + near, high - near);
    if record.initial_state != InitialState::Unknown || record.drive_v[0] <= bottom || record.drive_v[0] >= top {
        return None;
    }
    let first = |there: &dyn Fn(f64) -> bool| record.drive_v.iter().position(|v| there(*v));
    let swept = first(&|v| v <= bottom)?.max(first(&|v| v >= top)?);
    let remembered = swept.saturating_sub(record.window.start) as f64;
    (remembered > REMEMBERED * record.window.len() as f64).then(|| swept as f64 * record.dt_s())
}

/// Of each record that judges or is fitted, in words, how long its loops remember what was before it, where that is long.
#[must_use]
pub fn remembered(dataset: &Dataset, split: &Split) -> Vec<String> {
    let records = split.both().into_iter().map(|i| &dataset.records[i]);
    let said = |record: &Record| {
        let until_s = remembers_until_s(record)?;
        Some(format!(
            "{} begins inside the range of its drive in a state that nobody knows, and has been through all of it after {until_s:.3} s: until then its loops remember what \
             was before, which no model here does; begin a recording with a cycle over the whole range, or leave that time out (from_s in dataset.toml)",
            record.name
        ))
    };
    records.filter_map(said).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_remember_what_was_before_until_the_range_has_been_swept() {
        let record = |corners: &[f64], state| {
            let line = |w: &[f64]| {
                let (from, to) = (w[0], w[1]);
                (0..100).map(move |k| from + (to - from) * f64::from(k) / 100.0)
            };
            let drive: Vec<f64> = corners.windows(2).flat_map(line).collect();
            let mut record = Record::new("r", 1000.0, drive.clone(), drive);
            record.initial_state = state;
            record
        };
        let (unknown, virgin) = (InitialState::Unknown, InitialState::Virgin);
        let growing = [5.0, 6.0, 4.0, 8.0, 2.0, 10.0, 0.0, 5.0];
        let until_s = remembers_until_s(&record(&growing, unknown)).unwrap();
        assert!((0.59..0.6).contains(&until_s), "{until_s}");
        // From an end, from a state that is known, behind a sweep.
        assert_eq!(remembers_until_s(&record(&[0.0, 6.0, 4.0, 8.0, 2.0, 10.0], unknown)), None);
        assert_eq!(remembers_until_s(&record(&growing, virgin)), None);
        let mut swept_before = record(&growing, unknown);
        swept_before.window.start = 600;
        assert_eq!(remembers_until_s(&swept_before), None);
    }
}
