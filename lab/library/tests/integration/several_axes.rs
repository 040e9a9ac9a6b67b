//! Stages of three drives and three sensors whose truth is known. `hysteron axes score` runs more of them.

use hysteron::several_axes::finder::{AxesFound, AxesPolicy, find};
use hysteron::several_axes::planted::{AxisPlant, planted_stage};
use hysteron::several_axes::structure::Described;
use hysteron::{Unwatched, Watch, WatchEvent};
use std::sync::atomic::{AtomicUsize, Ordering};

#[test]
fn what_was_planted_is_named_in_its_channel() {
    for (plant, seed) in [
        // Beside five effects only two together lower the error of this one.
        (AxisPlant::Coupling, 3),
        (AxisPlant::ModeOfOneDrive, 1),
        (AxisPlant::Friction, 1),
        (AxisPlant::ActuatorHysteresis, 1),
    ] {
        let judged = planted_stage(plant, seed).search(&AxesPolicy::default(), &Unwatched);
        assert!(
            judged.named,
            "{plant:?}: {} is not among {:?}",
            judged.truth, judged.found
        );
        assert!(judged.wrong.is_empty(), "{plant:?}: {:?}", judged.wrong);
        // The noise is 1 % of the readings, of a mean of four periods.
        assert!(
            judged.times_noise < 1.1,
            "{plant:?}: {}",
            judged.times_noise
        );
    }
}

/// So much of the time is used, or the key is pressed, once candidates were scored so many times.
struct EndsAfter {
    scorings: AtomicUsize,
    most: usize,
    share: f64,
    stops: bool,
}

impl EndsAfter {
    fn is_reached(&self) -> bool {
        self.scorings.load(Ordering::Relaxed) >= self.most
    }
}

impl Watch for EndsAfter {
    fn event(&self, event: &WatchEvent<'_>) {
        let is_scoring = matches!(event, WatchEvent::Scoring { .. });
        self.scorings
            .fetch_add(usize::from(is_scoring), Ordering::Relaxed);
    }
    fn stopped(&self) -> bool {
        self.stops && self.is_reached()
    }
    fn time_used(&self) -> f64 {
        if self.is_reached() { self.share } else { 0.0 }
    }
}

fn found_until(share: f64, stops: bool) -> AxesFound {
    let stage = planted_stage(AxisPlant::Coupling, 1);
    let watch = EndsAfter {
        scorings: AtomicUsize::new(0),
        most: 3,
        share,
        stops,
    };
    let start = Described::empty(&stage.data);
    find(&stage.data, &start, &AxesPolicy::default(), &watch)
}

#[test]
fn a_search_that_is_ended_gives_the_best_so_far_and_names_what_it_tested() {
    // Time for the tests is left: what is there by then is tested.
    let tested = found_until(0.6, false);
    assert!(tested.ended_early && !tested.stopped);
    assert!(!tested.findings.is_empty() && tested.untested.is_empty());
    let stopped = found_until(0.0, true);
    assert!(stopped.stopped);
    for found in [found_until(0.85, false), stopped] {
        assert!(found.ended_early && found.findings.is_empty());
        assert_eq!(found.untested.len(), found.model.effects.len());
        assert!(!found.steps.is_empty() && found.error < found.steps[0].before);
    }
}
