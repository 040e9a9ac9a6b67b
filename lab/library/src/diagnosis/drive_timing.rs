//! Do the readings follow the drive of their own row?
//!
//! Where a program writes a voltage, waits and reads, the reading of a row belongs to the drive of that row, and not to the one before. A straight stage shows that
//! by itself when a recording is read; loops hide it. A search that is not told then makes up for the period by a mode as fast as
//! the recording can show at all. So a mode near half the sampling rate that was added is asked for: without it, and with the drive of the own row, the same
//! effects do as well.

use super::judgement::Judged;
use super::study::Study;
use crate::dataset::Dataset;
use crate::watch::Event;

/// A mode above this share of half the sampling rate is as fast as the recording can show.
const AS_FAST_AS_CAN_BE_SHOWN: f64 = 0.6;
/// The model without it does as well where its rank is worse by no more than this: some per cent of the error.
const AS_WELL: f64 = 0.03;

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

/// Asks a model for the modes among the effects that were added to it; nothing where none is that fast, or where it is needed.
#[must_use]
pub fn compare(study: &Study, found: &Judged, added: &[String]) -> Option<OwnRow> {
    let fastest_hz = study.dataset.records.iter().map(|r| r.sample_rate_hz).fold(0.0, f64::max);
    let limit_rad_s = AS_FAST_AS_CAN_BE_SHOWN * std::f64::consts::PI * fastest_hz;
    let too_fast = |id: &&String| {
        let motions = found.model.effect(id).map_or_else(Vec::new, |e| e.effect.free_motions(&found.model, &e.values()));
        motions.iter().any(|motion| motion.frequency_rad_s > limit_rad_s)
    };
    let modes: Vec<&String> = added.iter().filter(too_fast).collect();
    if modes.is_empty() || study.watch.stopped() {
        return None;
    }
    study.watch.event(&Event::Doing("asking whether the readings follow the drive of their own row"));
    let bare = modes.iter().fold(found.model.clone(), |model, id| study.without(&model, id));
    let shifted = drive_of_the_own_row(study.dataset);
    let other = study.of(&shifted);
    let without = other.judged(other.for_comparison(&other.quickly(&bare).model).model);
    let gone = |id: &&String| found.model.effect(id).is_some() && without.model.effect(id).is_none();
    (other.merit(&without) <= study.merit(found) + AS_WELL).then(|| OwnRow {
        not_needed: added.iter().filter(gone).cloned().collect(),
        as_said_um: found.error_um(),
        own_row_um: without.error_um(),
    })
}

/// The same readings, each with the drive of its own row.
fn drive_of_the_own_row(dataset: &Dataset) -> Dataset {
    let mut out = dataset.clone();
    for record in &mut out.records {
        let last = record.drive_v.last().copied();
        record.drive_v = record.drive_v[1..].iter().copied().chain(last).collect();
    }
    out
}
