//! Does the drive run on between its samples?
//!
//! A converter holds its output, a measured drive does not. All that a stage adds to a held drive (loops, creep, lags) comes later; a drive that runs on is half a period
//! earlier at every frequency, which nothing in the library makes up for. So a model with a mode is fitted once more with each other way of the drive, where nobody
//! specified one, and what leaves much less is taken.

use super::judgement::Judged;
use super::study::{FAR_BEHIND, Study};
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::effect::vibration;
use hysteron_sim::intersample::Intersample;

/// The drive runs on where the rank of the same effects is better by so much: half of the error goes, as a logarithm, where it is what was missing; a quarter is beyond what a
/// mode makes up for elsewhere.
const MUCH_BETTER: f64 = 0.25;

/// A drive that runs on between its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct RunsOn {
    /// What it does.
    pub intersample: Intersample,
    /// Error with a held drive, um.
    pub held_um: f64,
    /// Error with this one, um.
    pub runs_on_um: f64,
}

/// Fits a model with a mode once more with a drive that runs on, where nobody specified when it acts.
#[must_use]
pub fn compare(study: &Study, found: &Judged) -> Option<RunsOn> {
    let held = study.dataset.records.iter().all(|record| record.intersample == Intersample::Hold);
    if !study.dataset.timing_is_assumed || !held || found.model.effect(vibration::ID).is_none() || study.watch.stopped() {
        return None;
    }
    study.watch.event(&Event::Doing("asking whether the drive runs on between its samples"));
    let ways = [Intersample::Linear, Intersample::BandLimited];
    let fitted = parallel::map(&ways, |way| {
        let dataset = study.dataset.running_on(*way);
        let other = study.of(&dataset);
        let quick = other.quickly_within(&found.model, study.merit(found), FAR_BEHIND);
        let judged = other.judged(quick.model);
        (other.merit(&judged), judged.error_um())
    });
    let (way, (merit, runs_on_um)) = ways.into_iter().zip(fitted).min_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    (study.merit(found) - merit > MUCH_BETTER).then(|| RunsOn { intersample: way, held_um: found.error_um(), runs_on_um })
}
