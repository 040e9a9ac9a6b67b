//! Is the drive held between its samples?
//!
//! A converter holds its output, a measured drive runs on. All that a stage adds to a held drive (loops,
//! creep, lags) comes later; a drive that runs on is half a period earlier at every frequency, and nothing in
//! the library makes up for that. A search that begins with the wrong way takes up the half period with loops
//! and filters, and is long. So each way of the drive is tried, where nobody specified one: beside the first
//! fit with a mode, beside the first model of a search that has loops and a mode, and at its end where there
//! are no loops.

use super::subject::{Moment, Subject};
use crate::dataset::Dataset;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::{FAR_BEHIND, Study};
use crate::identification::finer_hysteresis::structure_beside_a_gain;
use crate::identification::fit::rms;
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::effect::{Effect, vibration};
use hysteron_sim::intersample::Intersample;
use std::sync::Arc;

/// Another way of the drive is taken where the rank of the same effects is better by so much, as a logarithm
/// of the error: a fifth of it goes. Of a Duffing oscillator whose drive is sampled at three times its
/// highest frequency a factor of 15 goes, of one with a hysteretic spring a factor of 9.
const MUCH_BETTER: f64 = 0.25;

/// Tries the other ways beside a model, where nobody specified when the drive acts.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    match subject.moment {
        Moment::FirstFit(study, fitted) if subject.dataset.timing_is_assumed => {
            with_a_mode(study, fitted)
                .and_then(|held| compare(study, &held))
                .into_iter()
                .collect()
        }
        Moment::LoopsAndMode(study, best) if subject.dataset.timing_is_assumed => {
            compare(study, best).into_iter().collect()
        }
        // With loops it was asked before, or they came near the noise at once.
        Moment::End(end)
            if subject.dataset.timing_is_assumed
                && structure_beside_a_gain(&end.last.model).is_none() =>
        {
            compare(end.study, end.last).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

/// The first fit with the mode that follows its residual best, where that mode explains much of it.
fn with_a_mode(study: &Study, fitted: &Judged) -> Option<Judged> {
    let of_a_mode = |effect: &Arc<dyn Effect>| effect.declaration().id == vibration::ID;
    let mode = study
        .candidates_for(&fitted.model)
        .into_iter()
        .find(of_a_mode)?;
    if study.watch.stopped() || !a_period_matters(study.dataset, &study.split.both(), fitted) {
        return None;
    }
    let screening = study.score_each(&fitted.model, &[mode]).ok()?;
    let score = screening.scores.first()?;
    let begin = study.with(
        &fitted.model,
        &[(score.effect.clone(), score.starts.first()?.clone())],
    );
    let held = study.quickly(&begin);
    // Where the drive of the same row does without a mode what the mode does, the rows are the question.
    let rows = study.dataset.in_own_rows();
    let of_same_row = study.of(&rows);
    let same_row = of_same_row.judged(of_same_row.quickly(&fitted.model).model);
    let mode_counts = study.merit(&held)
        < of_same_row
            .merit(&same_row)
            .min(study.merit(fitted) - MUCH_BETTER);
    mode_counts.then_some(held)
}

/// Half a period of the drive moves the reading by as much as a part of the error that matters.
fn a_period_matters(dataset: &Dataset, records: &[usize], fitted: &Judged) -> bool {
    let gain_um_v = dataset.overview().gain_um_v.abs();
    let moves_um = |i: &usize| {
        0.5 * gain_um_v
            * rms(&dataset.records[*i]
                .drive_v
                .windows(2)
                .map(|two| two[1] - two[0])
                .collect::<Vec<_>>())
    };
    let most_um = records.iter().map(moves_um).fold(0.0, f64::max);
    most_um > -(-MUCH_BETTER).exp_m1() * fitted.error_um()
}

fn compare(study: &Study, found: &Judged) -> Option<Issue> {
    if found.model.effect(vibration::ID).is_none() || study.watch.stopped() {
        return None;
    }
    study.watch.event(&WatchEvent::Doing(
        "trying a drive that is not held between its samples",
    ));
    let ways = [Intersample::Linear, Intersample::BandLimited];
    let fitted = parallel::map(&ways, |way| {
        let dataset = study.dataset.running_on(*way);
        let other = study.of(&dataset);
        let judged = other.judged(
            other
                .quickly_within(&found.model, study.merit(found), FAR_BEHIND)
                .model,
        );
        (other.merit(&judged), judged.error_um())
    });
    let (way, (merit, runs_on_um)) = ways
        .into_iter()
        .zip(fitted)
        .min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    let kind = IssueKind::RunsOnBetweenSamples {
        intersample: way.name().to_owned(),
        held_um: found.error_um(),
        runs_on_um,
    };
    (study.merit(found) - merit > MUCH_BETTER).then(|| Issue::of_all(Severity::Blocks, kind))
}
