//! Is the drive held between its samples?
//!
//! A converter holds its output, a measured drive runs on. All that a stage adds to a held drive (loops,
//! creep, lags) comes later; a drive that runs on is half a period earlier at every frequency, and nothing in
//! the library makes up for that. At the end of a search a model with a mode is refitted with each other way
//! of the drive, where nobody specified one.

use super::{Issue, IssueKind, Moment, Severity, Subject};
use crate::diagnosis::judgement::Judged;
use crate::diagnosis::study::{FAR_BEHIND, Study};
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::effect::vibration;
use hysteron_sim::intersample::Intersample;

/// Another way of the drive is taken where the rank of the same effects is better by so much, as a logarithm
/// of the error: a fifth of it goes. Of a Duffing oscillator whose drive is sampled at three times its
/// highest frequency a factor of 15 goes, of one with a hysteretic spring a factor of 9.
const MUCH_BETTER: f64 = 0.25;

/// The way of this name.
pub(super) fn named(name: &str) -> Intersample {
    Intersample::NAMES.into_iter().find(|(known, _)| *known == name).map_or(Intersample::Hold, |(_, one)| one)
}

/// Tries the other ways beside a model, where nobody specified when the drive acts.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    match subject.moment {
        Moment::End(end) if subject.dataset.timing_is_assumed => compare(end.study, end.last).into_iter().collect(),
        _ => Vec::new(),
    }
}

fn compare(study: &Study, found: &Judged) -> Option<Issue> {
    if found.model.effect(vibration::ID).is_none() || study.watch.stopped() {
        return None;
    }
    study.watch.event(&WatchEvent::Doing("trying a drive that is not held between its samples"));
    let ways = [Intersample::Linear, Intersample::BandLimited];
    let fitted = parallel::map(&ways, |way| {
        let dataset = study.dataset.running_on(*way);
        let other = study.of(&dataset);
        let judged = other.judged(other.quickly_within(&found.model, study.merit(found), FAR_BEHIND).model);
        (other.merit(&judged), judged.error_um())
    });
    let (way, (merit, runs_on_um)) = ways.into_iter().zip(fitted).min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    let kind = IssueKind::RunsOnBetweenSamples { intersample: way.name().to_owned(), held_um: found.error_um(), runs_on_um };
    (study.merit(found) - merit > MUCH_BETTER).then(|| Issue::of_all(Severity::Blocks, kind))
}
