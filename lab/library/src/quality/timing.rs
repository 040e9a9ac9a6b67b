//! Do the readings respond to the drive of the same row (`hold_before_sample`)?
//!
//! A logger that writes, waits and reads records each displacement one sample early. A straight stage shows
//! that by itself when a recording is read ([`crate::dataset`]); loops hide it. A fit may then hide the offset in a spurious mode.
//! At the end of a search the model is refitted with the timing of the same row and without each mode that
//! was added; where nothing reached the noise, also as it is. A prior model is tried before anything of it is
//! fitted: a fit to another logger's rows would find other values of a mode.

use super::subject::{Moment, Subject};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::{FAR_BEHIND, Study};
use crate::error::Result;
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::delay;

/// A mode above this share of half the sampling rate is as fast as the recording can show.
const AS_FAST_AS_CAN_BE_SHOWN: f64 = 0.6;
/// The model without it does as well where its rank is worse by no more than this: some per cent of the
/// error.
const AS_WELL: f64 = 0.03;
/// Where no model reached the noise, the other timing is taken where its cost is lower by so much.
const MUCH_BETTER: f64 = 0.2;
/// The same of a prior model as it is: half of the error, as a logarithm.
const LEAVES_HALF: f64 = std::f64::consts::LN_2;
/// What is worse by more than this than what was found does not come to it, however long it is fitted.
const MAY_COME_TO_IT: f64 = 0.5;
/// What is behind by more than this where it went as far as it goes does not come to it either, if its
/// effects begin again.
const MAY_COME_TO_IT_BEGUN_AGAIN: f64 = 0.1;

/// Tries the other timing beside a model, where nobody specified one.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    if !subject.dataset.timing_is_assumed {
        return Vec::new();
    }
    match subject.moment {
        Moment::PriorModel(study, model) => of_a_prior_model(study, model).into_iter().collect(),
        // An effect of the user's that gives no number with the other timing shows nothing about it.
        Moment::End(end) => compare(end.study, end.last, end.added)
            .ok()
            .flatten()
            .into_iter()
            .collect(),
        _ => Vec::new(),
    }
}

fn issue(not_needed: Vec<String>, assumed_um: f64, same_sample_um: f64) -> Issue {
    Issue::of_all(
        Severity::Blocks,
        IssueKind::SameSampleTiming {
            not_needed,
            assumed_um,
            same_sample_um,
        },
    )
}

/// Tries a model without the modes among the effects that were added to it, and a model that explains too
/// little as it is; nothing where the drive of the row before does better.
///
/// # Errors
/// As [`Study::begun_again`].
fn compare(study: &Study, found: &Judged, added: &[String]) -> Result<Option<Issue>> {
    if has_the_period(&found.model) {
        return Ok(None);
    }
    let unexplained = study.floor_um.is_some()
        && !found.within(study.policy.explained, &study.floors_um, &study.split);
    let as_it_is = (unexplained && !added.is_empty()).then(Vec::new);
    let asked: Vec<Vec<&String>> = modes_to_do_without(study, found, added)
        .into_iter()
        .chain(as_it_is)
        .collect();
    if asked.is_empty() || study.watch.stopped() {
        return Ok(None);
    }
    study
        .watch
        .event(&WatchEvent::Doing("trying the timing of the same row"));
    let shifted = study.dataset.in_own_rows();
    let other = study.of(&shifted);
    let fitted = parallel::map(&asked, |modes| {
        let begin = modes
            .iter()
            .fold(found.model.clone(), |model, id| study.without(&model, id));
        other.quickly_within(&begin, study.merit(found), FAR_BEHIND)
    });
    let best = fitted
        .into_iter()
        .zip(&asked)
        .min_by(|a, b| other.merit(&a.0).total_cmp(&other.merit(&b.0)));
    let Some((without, modes)) =
        best.filter(|(one, _)| other.merit(one) < study.merit(found) + MAY_COME_TO_IT)
    else {
        return Ok(None);
    };
    let most = study.merit(found)
        + if modes.is_empty() {
            -MUCH_BETTER
        } else {
            AS_WELL
        };
    let fitted = other.for_comparison(&without.model);
    if other.merit(&fitted) > most + MAY_COME_TO_IT_BEGUN_AGAIN {
        return Ok(None);
    }
    let without = other.judged(other.begun_again(&fitted)?.model);
    let gone =
        |id: &&String| found.model.effect(id).is_some() && without.model.effect(id).is_none();
    Ok((other.merit(&without) <= most).then(|| {
        issue(
            added.iter().filter(gone).cloned().collect(),
            found.error_um(),
            without.error_um(),
        )
    }))
}

/// The drive of the same row is the drive of the row before with a period less of delay. A model that delays
/// it chose that already.
fn has_the_period(model: &Model) -> bool {
    model
        .effect(delay::ID)
        .is_some_and(|e| e.values().iter().any(|delay_s| *delay_s > 0.0))
}

/// A prior model as it is, before anything of it is fitted: with the drive of the same row it leaves less
/// than half.
fn of_a_prior_model(study: &Study, assumed: &Judged) -> Option<Issue> {
    if study.watch.stopped() {
        return None;
    }
    let timed = study.dataset.in_own_rows();
    let other = study.of(&timed);
    let same_row = other.judged(assumed.model.clone());
    let less = study.merit(assumed) - other.merit(&same_row);
    (less > LEAVES_HALF).then(|| issue(Vec::new(), assumed.error_um(), same_row.error_um()))
}

/// Which of the added modes may stand for a period: all that are as fast as can be shown together, and each
/// alone.
fn modes_to_do_without<'a>(
    study: &Study,
    found: &Judged,
    added: &'a [String],
) -> Vec<Vec<&'a String>> {
    let fastest_hz = study
        .dataset
        .records
        .iter()
        .map(|r| r.sample_rate_hz)
        .fold(0.0, f64::max);
    let limit_rad_s = AS_FAST_AS_CAN_BE_SHOWN * std::f64::consts::PI * fastest_hz;
    let swings_above = |id: &str, limit_rad_s: f64| {
        let motions = found.model.effect(id).map_or_else(Vec::new, |e| {
            e.effect.free_motions(&found.model, &e.values())
        });
        motions
            .iter()
            .any(|motion| motion.frequency_rad_s > limit_rad_s)
    };
    let too_fast: Vec<&String> = added
        .iter()
        .filter(|id| swings_above(id, limit_rad_s))
        .collect();
    let mut out: Vec<Vec<&String>> = added
        .iter()
        .filter(|id| swings_above(id, 0.0))
        .map(|id| vec![id])
        .collect();
    if too_fast.len() > 1 {
        out.push(too_fast);
    }
    out
}
