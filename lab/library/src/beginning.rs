//! The state in which a tape begins, where nobody specified it.
//!
//! A tape whose drive begins standing still at its lower end is explained from rest: no free motion of creep or drift is estimated, so that slow motion has to
//! be in the model. The same effects from an unknown state check this. Where they leave much less, something was still going on at the first sample; the
//! explanation is then repeated from an unknown state, and the one with the smaller error stays.

use crate::dataset::{Dataset, Role};
use crate::error::Result;
use crate::explain::Explanation;
use crate::identification::fit::{Effort, fit_rows, rms_over};
use crate::identification::linearisation::Rows;
use crate::watch::{Event, Watch};
use hysteron_sim::chain::InitialState;

/// Rest at the beginning is doubted where an unknown state leaves less than this share of the error.
const DOUBTED: f64 = 0.8;
/// Samples of the fit that checks it: the model is there already.
const SAMPLES: usize = 50_000;

/// An explanation and, where it is of another data set than the one given, that data set.
type Found = (Explanation, Option<Dataset>);

/// Explains a data set; where its state at the beginning is assumed and an unknown one leaves much less, once more with that.
pub(crate) fn explained(dataset: &Dataset, watch: &dyn Watch, explain: impl Fn(&Dataset) -> Result<Found>) -> Result<Found> {
    let from_rest = explain(dataset)?;
    let assumed = |data: &Dataset| data.records.iter().any(|r| r.state_is_assumed && r.initial_state == InitialState::Settled);
    let data = from_rest.1.as_ref().unwrap_or(dataset);
    if !assumed(data) || from_rest.0.stopped || watch.searched_enough() || watch.stopped() {
        return Ok(from_rest);
    }
    watch.event(&Event::Doing("checking that the tape begins at rest"));
    let as_found_um = judged_um(&from_rest.0, data);
    let mut unknown = with_unknown_beginning(data);
    let rows = Rows::thinned(&unknown, &from_rest.0.split.identify, SAMPLES);
    let refitted = fit_rows(&from_rest.0.model, &unknown, &rows, Effort::default()).model;
    let unknown_um = rms_over(&refitted, &unknown, judging(&from_rest.0));
    if unknown_um > DOUBTED * as_found_um {
        return Ok(from_rest);
    }
    watch.event(&Event::Doing("once more, from an unknown state"));
    unknown.notes.push(format!(
        "the tape does not begin at rest: from an unknown state the error is {:.2} nm instead of {:.2} nm, so that state is estimated",
        1e3 * unknown_um,
        1e3 * as_found_um
    ));
    let (other, timed) = explain(&unknown)?;
    let other_data = timed.unwrap_or(unknown);
    Ok(if judged_um(&other, &other_data) < DOUBTED * as_found_um { (other, Some(other_data)) } else { from_rest })
}

fn judging(found: &Explanation) -> &[usize] {
    if found.split.validate.is_empty() { &found.split.identify } else { &found.split.validate }
}

fn judged_um(found: &Explanation, dataset: &Dataset) -> f64 {
    rms_over(&found.model, dataset, judging(found))
}

fn with_unknown_beginning(dataset: &Dataset) -> Dataset {
    let mut out = dataset.clone();
    for record in out.records.iter_mut().filter(|r| r.state_is_assumed && r.role != Role::Noise) {
        record.initial_state = InitialState::Unknown;
    }
    out
}
