//! Which structure the loops have, asked once the effects are found: a few structures can draw the same loops, and what meets the data as well
//! as the one that was found is said beside it.

use super::judgement::Judged;
use super::study::Study;
use crate::identification::finer_hysteresis::{self, main_effect};
use crate::parallel;
use crate::watch::Event;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{gain, hysteresis};

/// A quick fit whose merit is worse by this much does not come to a tie, however long it is fitted.
const CLEARLY_BEHIND: f64 = 0.5;

/// How loops of other structures that meet the data as well as those of a model are described, best first.
#[must_use]
pub fn doing_as_well(study: &Study, start: &Model, found: &Judged) -> Vec<String> {
    let structure = |model: &Model| main_effect(model).map(|e| e.id.clone());
    let surfaces = found.model.effect(hysteresis::ID).is_some();
    // In the place of a gain loops are an effect that was added, with rivals as any.
    let added = start.effect(gain::ID).is_some();
    if surfaces || added || structure(&found.model) == structure(start) || study.watch.stopped() {
        return Vec::new();
    }
    study.watch.event(&Event::Doing("trying other structures of the loops"));
    let behind = |judged: &Judged| study.merit(judged) - study.merit(found) > CLEARLY_BEHIND;
    let fitted = parallel::map(&finer_hysteresis::of_other_structures(&found.model, &study.overview), |begin| {
        let quick = study.quickly(begin);
        (!behind(&quick)).then(|| study.judged(study.for_comparison(&quick.model).model))
    });
    let mut alike: Vec<Judged> = fitted.into_iter().flatten().filter(|judged| !study.told_apart(judged, found)).collect();
    alike.sort_by(|a, b| study.merit(a).total_cmp(&study.merit(b)));
    alike.iter().map(|other| finer_hysteresis::description(&other.model)).collect()
}
