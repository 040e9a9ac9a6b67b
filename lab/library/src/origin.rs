//! What a model keeps of its records, and what later work takes over from there: how recordings are read and
//! in which state a simulation begins, unless somebody specifies it.

use crate::dataset::timing::Timing;
use crate::dataset::{Dataset, Record, Role};
use crate::identification::fit::counted_residual;
use crate::identification::linearisation::raw_residual;
use crate::identification::nuisance_terms::{OwnMotions, Samples};
use crate::parallel;
use crate::replay::{files, whole};
use crate::statistics::{extremes, rms};
use hysteron_sim::chain::{Identified, InitialState, Model};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::origin::{RecordStart, Recorded};
use std::path::Path;
use std::sync::Arc;

/// Samples from which the state at the beginning of a long file is estimated.
const START_SAMPLES: usize = 200_000;
/// Share of the samples that judged which a band holds.
const IN_BAND: f64 = 0.95;
/// A drive begins as a record does where it is nearer to that than this share of the range of drives.
const AS_RECORDED: f64 = 1e-3;

/// Notes in a fitted model what it was fitted to, and how well it meets the records that judge.
pub fn note_origin(model: &mut Model, dataset: &Dataset, fitted: &[usize]) {
    let held_out = dataset.with_role(Role::Validate);
    let judges = if held_out.is_empty() {
        fitted
    } else {
        &held_out
    };
    let left: Vec<f64> =
        parallel::map(judges, |i| counted_residual(model, &dataset.records[*i])).concat();
    let error_um = rms(&left);
    let seen = || {
        let counts = |(i, r): &(usize, &Record)| fitted.contains(i) || r.role == Role::Validate;
        dataset
            .records
            .iter()
            .enumerate()
            .filter(counts)
            .map(|(_, r)| r)
    };
    let most = |of: &dyn Fn(&Record) -> f64| seen().map(of).fold(f64::NEG_INFINITY, f64::max);
    let slope = |r: &Record| {
        let steps = r.drive_v.windows(2).map(|w| (w[1] - w[0]).abs());
        steps.fold(0.0, f64::max) * r.sample_rate_hz
    };
    let recorded = Recorded {
        data_set: dataset.name.clone(),
        fitted_on: String::new(),
        sample_rate_hz: most(&|r| r.sample_rate_hz),
        hold_before_sample: dataset.timing == Timing::HoldBeforeSample,
        intersample: seen().next().map_or(Intersample::Hold, |r| r.intersample),
        sensor_lsb_um: dataset.sensor_lsb_um,
        starts: parallel::map(&files(dataset), |records| {
            start_of(model, &whole(dataset, records))
        }),
    };
    let (seconds, slope_max_v_s) = (most(&|r| r.window.end as f64 * r.dt_s()), most(&slope));
    let low_v = -most(&|r| -extremes(&r.drive_v[..r.window.end]).0);
    let high_v = most(&|r| extremes(&r.drive_v[..r.window.end]).1);
    let known = Arc::make_mut(model.identified.get_or_insert_default());
    *known = Identified {
        values: std::mem::take(&mut known.values),
        factor: std::mem::take(&mut known.factor),
        error_um,
        band_95: times_error(left, error_um),
        seconds,
        low_v,
        high_v,
        slope_max_v_s,
        recorded,
    };
}

/// Times the error within which so many residuals lie that a band holds them.
fn times_error(mut left: Vec<f64>, error_um: f64) -> f64 {
    left.iter_mut().for_each(|e| *e = e.abs());
    left.sort_by(f64::total_cmp);
    let at = ((IN_BAND * left.len() as f64).ceil() as usize).clamp(1, left.len().max(1)) - 1;
    match left.get(at) {
        Some(within_um) if error_um > 0.0 => within_um / error_um,
        _ => crate::prediction::BAND_95,
    }
}

/// How a file begins beside a model, as far as its readings show it.
pub fn start_of(model: &Model, whole: &Record) -> RecordStart {
    let mut samples = Samples::counted(whole);
    if samples.count() > START_SAMPLES {
        let apart = samples.count().div_ceil(START_SAMPLES);
        samples = Samples::Some(samples.iter().step_by(apart).collect());
    }
    let left = raw_residual(&model.before_rounding(), whole, &samples);
    let (offset_um, motions) = OwnMotions::of(model, whole).amplitudes(whole, &samples, &left);
    RecordStart {
        file: whole.name.clone(),
        drive_v: whole.drive_v.first().copied().unwrap_or_default(),
        state: whole.initial_state,
        offset_is_fitted: whole.offset_is_fitted,
        offset_um,
        motions,
    }
}

/// How the records of a model were read; none for a model that was written by hand.
fn recorded(model: &Model) -> Option<&Recorded> {
    model.identified.as_deref().map(|known| &known.recorded)
}

/// The way from the files of a model to its records, in words.
#[must_use]
pub fn way_in_words(recorded: &Recorded) -> String {
    match recorded.intersample {
        Intersample::Hold => timing_of(recorded).name().to_owned(),
        other => format!("a drive that is {} between samples", other.name()),
    }
}

/// When the drive of a row acts in the files.
#[must_use]
pub fn timing_of(recorded: &Recorded) -> Timing {
    if recorded.hold_before_sample {
        Timing::HoldBeforeSample
    } else {
        Timing::HoldAfterSample
    }
}

/// The start of the file that a drive is, by its name and its first value.
fn start_by_name<'m>(model: &'m Model, file: &str, first_v: f64) -> Option<&'m RecordStart> {
    let near_v = AS_RECORDED * (model.drive_max_v - model.drive_min_v);
    let name = Path::new(file).file_name()?.to_string_lossy();
    recorded(model)?
        .starts
        .iter()
        .find(|start| *name == *start.file && (start.drive_v - first_v).abs() <= near_v)
}

/// The data set as the records of a model were read, in all that nobody specified of it; none where nothing
/// changes.
#[must_use]
pub fn read_as_recorded(model: &Model, dataset: &Dataset) -> Option<Dataset> {
    let recorded = recorded(model)?;
    let mut out = dataset.clone();
    if dataset.timing_is_assumed {
        if recorded.hold_before_sample {
            out = out.in_own_rows();
        } else if dataset.intersample_is_assumed && recorded.intersample != Intersample::Hold {
            out = out.running_on(recorded.intersample);
        }
    }
    let mut changed = Vec::new();
    if dataset.timing_is_assumed && !out.timing_is_assumed {
        changed.push(way_in_words(recorded));
    }
    if out.sensor_lsb_um.is_none() && recorded.sensor_lsb_um.is_some() {
        out.sensor_lsb_um = recorded.sensor_lsb_um;
        changed.push("the sensor's step".into());
    }
    let (mut states, mut offsets) = (false, false);
    for record in &mut out.records {
        let first_v = record.drive_v.first().copied().unwrap_or_default();
        let Some(start) = start_by_name(model, &record.source, first_v) else {
            continue;
        };
        if record.state_is_assumed && record.initial_state != start.state {
            (record.initial_state, states) = (start.state, true);
        }
        if start.offset_is_fitted && !record.offset_is_fitted {
            (record.offset_is_fitted, offsets) = (true, true);
        }
    }
    changed.extend(states.then(|| "an estimated state at the beginning".to_owned()));
    changed.extend(offsets.then(|| "a constant of the sensor".to_owned()));
    if changed.is_empty() {
        return None;
    }
    out.notes.push(format!(
        "read as the records of the model: {}. To override: --timing, --intersample, or dataset.toml",
        changed.join(", ")
    ));
    Some(out)
}

/// How a simulation begins.
#[derive(Clone, Debug, PartialEq)]
pub enum Initial {
    /// As the records of the model.
    AsRecorded,
    /// In this state, the sensor's zero where the model has it.
    State(InitialState),
}

impl Initial {
    /// The start of a drive whose first sample is `first_v`; `file` is what it is called. In words as well.
    #[must_use]
    pub fn start(&self, model: &Model, file: &str, first_v: f64) -> (RecordStart, String) {
        let starts = recorded(model).map_or(&[][..], |recorded| &recorded.starts);
        match (self, start_by_name(model, file, first_v), starts.first()) {
            (Self::State(state), ..) => (
                RecordStart::resting(*state, first_v),
                format!("begins {}", state.name()),
            ),
            (Self::AsRecorded, Some(start), _) => (
                start.clone(),
                format!("begins as that record did: {}", in_words(start)),
            ),
            (Self::AsRecorded, None, Some(start)) => {
                let start = RecordStart {
                    motions: Vec::new(),
                    drive_v: first_v,
                    state: match start.state {
                        InitialState::Virgin => InitialState::Virgin,
                        _ => InitialState::Settled,
                    },
                    ..start.clone()
                };
                let words = in_words(&start);
                (start, format!("begins as the model's records did: {words}"))
            }
            (Self::AsRecorded, None, None) => (
                RecordStart::resting(InitialState::Virgin, first_v),
                "begins virgin; the model does not say how its records began".into(),
            ),
        }
    }
}

fn in_words(start: &RecordStart) -> String {
    let state = match start.state {
        InitialState::Virgin => "virgin",
        InitialState::Settled => "settled at the first drive",
        InitialState::Unknown => "in the estimated state",
    };
    if start.offset_um == 0.0 {
        state.into()
    } else {
        format!("{state}, with a constant of {:.6} um", start.offset_um)
    }
}
