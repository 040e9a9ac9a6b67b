//! Do the readings follow the drive of their own row?
//!
//! Where a program writes a voltage, waits and reads, the reading of a row belongs to the drive of that row, and not to the one before. A straight stage shows that
//! by itself when a recording is read; loops hide it. A search that is not told then makes up for the period by a mode, as fast as the recording can show
//! or beside a true one, or finds nothing that does. So modes that were added are asked for: without one of them, or without those that are too fast,
//! and with the drive of the own row, the same effects do as well. Where the search met nothing, the same effects are asked as they are;
//! a model from elsewhere is asked before anything of it is fitted, since a fit to another logger's rows would tell other values of a mode.

use super::judgement::Judged;
use super::study::{FAR_BEHIND, Study};
use crate::error::Result;
use crate::parallel;
use crate::watch::Event;

/// A mode above this share of half the sampling rate is as fast as the recording can show.
const AS_FAST_AS_CAN_BE_SHOWN: f64 = 0.6;
/// The model without it does as well where its rank is worse by no more than this: some per cent of the error.
const AS_WELL: f64 = 0.03;
/// Where nothing met the noise, the other timing is said where its rank is better by so much.
const MUCH_BETTER: f64 = 0.2;
/// The same of a model from elsewhere as it is: half of the error, as a logarithm.
const LEAVES_HALF: f64 = std::f64::consts::LN_2;
/// What is worse by more than this than what was found does not come to it, however long it is fitted.
const MAY_COME_TO_IT: f64 = 0.5;
/// What is behind by more than this where it went as far as it goes does not come to it either, if its effects begin again.
const MAY_COME_TO_IT_BEGUN_AGAIN: f64 = 0.1;

/// Readings that follow the drive of their own row.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnRow {
    /// Effects that are then not needed.
    pub not_needed: Vec<String>,
    /// Error with them and the timing that was said, um.
    pub as_said_um: f64,
    /// Error without them and with the drive of the own row, um.
    pub own_row_um: f64,
}

/// Asks a model for the modes among the effects that were added to it, and a model that explains too little as it is; nothing where the drive of the row
/// before does better.
///
/// # Errors
/// As [`Study::begun_again`].
pub fn compare(study: &Study, found: &Judged, added: &[String]) -> Result<Option<OwnRow>> {
    if !study.dataset.timing_is_assumed {
        return Ok(None);
    }
    let unexplained = study.floor_um.is_some() && !found.within(study.policy.explained, &study.floors_um, &study.split);
    let as_it_is = (unexplained && !added.is_empty()).then(Vec::new);
    let asked: Vec<Vec<&String>> = modes_to_do_without(study, found, added).into_iter().chain(as_it_is).collect();
    if asked.is_empty() || study.watch.stopped() {
        return Ok(None);
    }
    study.watch.event(&Event::Doing("asking whether the readings follow the drive of their own row"));
    let shifted = study.dataset.in_own_rows();
    let other = study.of(&shifted);
    let fitted = parallel::map(&asked, |modes| {
        let begin = modes.iter().fold(found.model.clone(), |model, id| study.without(&model, id));
        other.quickly_within(&begin, study.merit(found), FAR_BEHIND)
    });
    let best = fitted.into_iter().zip(&asked).min_by(|a, b| other.merit(&a.0).total_cmp(&other.merit(&b.0)));
    let Some((without, modes)) = best.filter(|(one, _)| other.merit(one) < study.merit(found) + MAY_COME_TO_IT) else { return Ok(None) };
    let most = study.merit(found) + if modes.is_empty() { -MUCH_BETTER } else { AS_WELL };
    let fitted = other.for_comparison(&without.model);
    if other.merit(&fitted) > most + MAY_COME_TO_IT_BEGUN_AGAIN {
        return Ok(None);
    }
    let without = other.judged(other.begun_again(&fitted)?.model);
    let gone = |id: &&String| found.model.effect(id).is_some() && without.model.effect(id).is_none();
    Ok((other.merit(&without) <= most).then(|| OwnRow {
        not_needed: added.iter().filter(gone).cloned().collect(),
        as_said_um: found.error_um(),
        own_row_um: without.error_um(),
    }))
}

/// Asks a model from elsewhere as it is, before anything of it is fitted: with the drive of the own row it leaves less than half.
#[must_use]
pub fn of_a_model(study: &Study, as_said: &Judged) -> Option<OwnRow> {
    if !study.dataset.timing_is_assumed || study.watch.stopped() {
        return None;
    }
    let timed = study.dataset.in_own_rows();
    let other = study.of(&timed);
    let own_row = other.judged(as_said.model.clone());
    let less = study.merit(as_said) - other.merit(&own_row);
    (less > LEAVES_HALF).then(|| OwnRow { not_needed: Vec::new(), as_said_um: as_said.error_um(), own_row_um: own_row.error_um() })
}

/// Which of the added modes may stand for a period: all that are as fast as can be shown together, and each alone.
fn modes_to_do_without<'a>(study: &Study, found: &Judged, added: &'a [String]) -> Vec<Vec<&'a String>> {
    let fastest_hz = study.dataset.records.iter().map(|r| r.sample_rate_hz).fold(0.0, f64::max);
    let limit_rad_s = AS_FAST_AS_CAN_BE_SHOWN * std::f64::consts::PI * fastest_hz;
    let swings_above = |id: &str, limit_rad_s: f64| {
        let motions = found.model.effect(id).map_or_else(Vec::new, |e| e.effect.free_motions(&found.model, &e.values()));
        motions.iter().any(|motion| motion.frequency_rad_s > limit_rad_s)
    };
    let too_fast: Vec<&String> = added.iter().filter(|id| swings_above(id, limit_rad_s)).collect();
    let mut out: Vec<Vec<&String>> = added.iter().filter(|id| swings_above(id, 0.0)).map(|id| vec![id]).collect();
    if too_fast.len() > 1 {
        out.push(too_fast);
    }
    out
}
