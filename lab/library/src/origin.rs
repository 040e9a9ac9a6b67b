//! What a model keeps of its records, and what later work takes over from there: how recordings are read and
//! in which state a simulation begins, unless somebody specifies it.

use crate::dataset::timing::Timing;
use crate::dataset::{Dataset, PlayedDrive, Record, Role};
use crate::error::{Error, Result};
use crate::identification::fit::rms_over;
use crate::identification::linearisation::raw_residual;
use crate::identification::nuisance_terms::{OwnAmounts, Samples};
use crate::parallel;
use crate::phrases::nm;
use crate::prediction::{BAND_95, Prediction, calibrated, constant_moves_um, predict};
use crate::replay::{files, whole};
use crate::statistics::extremes;
use hysteron_sim::chain::{Drive, Identified, InitialState, Model};
use hysteron_sim::effect::FreeMotion;
use hysteron_sim::intersample::Intersample;
use hysteron_sim::physics::{OffsetAtRest, RecordStart, Recorded};
use std::path::Path;
use std::sync::Arc;

/// Samples from which the state at the beginning of a long file is estimated.
const START_SAMPLES: usize = 200_000;
/// A servo runs at this rate, Hz.
const USUAL_RATE_HZ: f64 = 20_000.0;
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
    let error_um = rms_over(model, dataset, judges);
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
    let seconds = most(&|r| r.drive_v.len() as f64 * r.dt_s());
    let slope_max_v_s = most(&slope);
    let low_v = -most(&|r| -extremes(&r.drive_v[..r.window.end]).0);
    let high_v = most(&|r| extremes(&r.drive_v[..r.window.end]).1);
    let known = Arc::make_mut(model.identified.get_or_insert_default());
    *known = Identified {
        values: std::mem::take(&mut known.values),
        factor: std::mem::take(&mut known.factor),
        error_um,
        band_95: BAND_95,
        spread_share: 1.0,
        seconds,
        low_v,
        high_v,
        slope_max_v_s,
        recorded,
    };
    if let Some([share, times]) = calibrated(model, dataset, judges) {
        let known = Arc::make_mut(model.identified.get_or_insert_default());
        (known.spread_share, known.band_95) = (share, times);
    }
    // Drives that are none of the files begin with the constant of the first one.
    if let Some(first) = files(dataset).first() {
        let whole = whole(dataset, first);
        let (_, weights) = start_and_weights(model, &whole);
        let moves_um = constant_moves_um(model, &whole, &weights);
        let known = Arc::make_mut(model.identified.get_or_insert_default());
        if let Some(at_rest) = &mut known.recorded.starts[0].at_rest {
            at_rest.moves_um = moves_um;
        }
    }
}

/// How a file begins beside a model, as far as its readings show it.
pub fn start_of(model: &Model, whole: &Record) -> RecordStart {
    start_and_weights(model, whole).0
}

/// How a file begins beside a model, and which samples make its constant, with their weights.
fn start_and_weights(model: &Model, whole: &Record) -> (RecordStart, Vec<(usize, f64)>) {
    let mut samples = Samples::counted(whole);
    if samples.count() > START_SAMPLES {
        let apart = samples.count().div_ceil(START_SAMPLES);
        samples = Samples::Some(samples.iter().step_by(apart).collect());
    }
    let left = raw_residual(&model.before_rounding(), whole, &samples);
    let own = OwnAmounts::of(model, whole, &samples, &left);
    let weights = samples
        .iter()
        .zip(own.at_rest_weights.iter().copied())
        .collect();
    let start = RecordStart {
        file: whole.name.clone(),
        drive_v: whole.drive_v.first().copied().unwrap_or_default(),
        state: whole.initial_state,
        offset_is_fitted: whole.offset_is_fitted,
        offset_um: own.constant_um,
        at_rest: whole.offset_is_fitted.then_some(OffsetAtRest {
            offset_um: own.constant_at_rest_um,
            std_um: own.at_rest_std_um,
            moves_um: Vec::new(),
        }),
        motions: own.motions,
    };
    (start, weights)
}

/// The model with the date of its fit, where none is noted.
#[must_use]
pub fn dated(model: &Model, today: String) -> Model {
    let mut out = model.clone();
    if let Some(known) = &mut out.identified {
        let recorded = &mut Arc::make_mut(known).recorded;
        if recorded.fitted_on.is_empty() {
            recorded.fitted_on = today;
        }
    }
    out
}

/// How the records of a model were read; none for a model that was written by hand.
fn recorded(model: &Model) -> Option<&Recorded> {
    model.identified.as_deref().map(|known| &known.recorded)
}

/// Sampling rate of the records of a model, or the usual one of servos where it does not know that, Hz.
#[must_use]
pub fn sample_rate_hz(model: &Model) -> f64 {
    let known = recorded(model).map(|recorded| recorded.sample_rate_hz);
    known.filter(|rate| *rate > 0.0).unwrap_or(USUAL_RATE_HZ)
}

/// When the drives of files act and what they do between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// When the drive of a row acts.
    pub timing: Timing,
    /// What it does between samples.
    pub intersample: Intersample,
    /// Somebody specified it.
    specified: bool,
}

impl Way {
    /// The way that somebody specified, else that of the records of a model. One that is specified only in
    /// part is the usual one in the rest.
    #[must_use]
    pub fn told(model: &Model, timing: Option<Timing>, intersample: Option<Intersample>) -> Self {
        let specified = timing.is_some() || intersample.is_some();
        let known = recorded(model).filter(|_| !specified);
        Self {
            timing: timing.or(known.map(timing_of)).unwrap_or_default(),
            intersample: intersample
                .or(known.map(|k| k.intersample))
                .unwrap_or_default(),
            specified,
        }
    }

    /// In words, with where it comes from.
    #[must_use]
    pub fn in_words(self) -> String {
        let source = if self.specified {
            "as specified"
        } else {
            "as the model's records"
        };
        match self.intersample {
            Intersample::Hold => format!("{} ({source})", self.timing.name()),
            other => format!(
                "a drive that is {} between samples ({source})",
                other.name()
            ),
        }
    }

    /// The drive that acts from each sample on: the last value of a file whose rows act before stays.
    fn acting(self, drive_v: &[f64]) -> Vec<f64> {
        match self.timing {
            Timing::HoldAfterSample => drive_v.to_vec(),
            Timing::HoldBeforeSample => {
                let later = drive_v.iter().skip(1).chain(drive_v.last());
                later.copied().collect()
            }
        }
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

/// Whether a drive begins where a record does.
fn near(model: &Model, recorded_v: f64, first_v: f64) -> bool {
    (recorded_v - first_v).abs() <= near_v(model)
}

/// A drive begins where a record does if it is nearer to it than this, V.
#[must_use]
pub fn near_v(model: &Model) -> f64 {
    AS_RECORDED * (model.drive_max_v - model.drive_min_v)
}

/// The start of the file that a drive is, by its name and its first value.
fn start_by_name<'m>(model: &'m Model, file: &str, first_v: f64) -> Option<&'m RecordStart> {
    let name = Path::new(file).file_name()?.to_string_lossy();
    let starts = &recorded(model)?.starts;
    starts
        .iter()
        .find(|start| *name == *start.file && near(model, start.drive_v, first_v))
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
        changed.push(Way::told(model, None, None).in_words());
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
#[derive(Clone, Debug)]
pub enum Initial {
    /// As the records of the model.
    AsRecorded,
    /// In this state, the sensor's zero where the model has it.
    State(InitialState),
    /// As a recording did.
    As(RecordStart),
}

impl Initial {
    /// A state in which a simulation can begin, by its name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        InitialState::named(name)
            .filter(|state| *state != InitialState::Unknown)
            .map(Self::State)
    }

    /// As a recording that was read: as the model knows it by its name, or as its readings show.
    ///
    /// # Errors
    /// It has no readings.
    pub fn like(model: &Model, file: &PlayedDrive, way: Way) -> Result<Self> {
        let drive_v = way.acting(&file.drive_v);
        let first_v = drive_v.first().copied().unwrap_or_default();
        if let Some(start) = start_by_name(model, &file.file, first_v) {
            return Ok(Self::As(start.clone()));
        }
        let Some(reading_um) = &file.reading_um else {
            return Err(Error::new(
                &file.file,
                "has no readings; expected a recording, whose readings show the state in which it begins",
            ));
        };
        let whole = Record {
            window: way.timing as usize..drive_v.len(),
            intersample: way.intersample,
            force_n: file.force_n.clone(),
            auxiliary: file.auxiliary.clone(),
            ..Record::new(&file.file, file.sample_rate_hz, drive_v, reading_um.clone())
        };
        Ok(Self::As(start_of(model, &whole)))
    }

    /// Predicts the reading under the drive of a file, as its rows have it; `place` is what the drive is called
    /// in messages. Says in words how it begins.
    ///
    /// # Errors
    /// As [`crate::simulate`].
    pub fn predict(
        &self,
        model: &Model,
        file: &str,
        drive: &Drive,
        way: Way,
        place: &str,
    ) -> Result<(Prediction, String)> {
        let acting_v = way.acting(drive.drive_v);
        let first_v = acting_v.first().copied().unwrap_or(model.drive_min_v);
        let (start, words) = self.start(model, file, first_v);
        let acting = Drive {
            drive_v: &acting_v,
            intersample: way.intersample,
            ..*drive
        };
        let predicted = predict(model, &acting, &start, place)?;
        let half_um = predicted
            .half_band_um
            .as_ref()
            .and_then(|half| half.first());
        let words = match half_um {
            Some(half_um) if start.file.is_empty() => format!(
                "{words}; its position there is known to +-{} nm",
                nm(*half_um)
            ),
            _ => words,
        };
        Ok((predicted, words))
    }

    /// The start that an export carries, and how near a drive has to begin to it for its motions to be there,
    /// V: one that was asked for is there for any.
    #[must_use]
    pub fn to_carry(&self, model: &Model) -> (RecordStart, f64) {
        let first = recorded(model).and_then(|recorded| recorded.starts.first());
        match (self, first) {
            (Self::State(state), _) => (RecordStart::resting(*state, 0.0), 0.0),
            (Self::As(start), _) => (start.clone(), f64::MAX),
            (Self::AsRecorded, Some(start)) => (near_or_at_rest(start), near_v(model)),
            (Self::AsRecorded, None) => (RecordStart::resting(InitialState::Virgin, 0.0), 0.0),
        }
    }

    /// The start of a drive with this first value; `file` is what it is called. In words as well.
    #[must_use]
    pub fn start(&self, model: &Model, file: &str, first_v: f64) -> (RecordStart, String) {
        let first = recorded(model).and_then(|recorded| recorded.starts.first());
        let known = start_by_name(model, file, first_v)
            .or(first.filter(|start| near(model, start.drive_v, first_v)));
        match (self, known, first) {
            (Self::State(state), ..) => (
                RecordStart::resting(*state, first_v),
                format!("begins {}", state.name()),
            ),
            (Self::As(start), ..) | (_, Some(start), _) => (
                start.clone(),
                format!("begins as {} did: {}", start.file, in_words(start)),
            ),
            (_, None, Some(start)) => {
                let start = at_rest(start, first_v);
                let words = format!("begins {}", in_words(&start));
                (start, words)
            }
            (_, None, None) => (
                RecordStart::resting(InitialState::Virgin, first_v),
                "begins virgin; the model does not say how its records began".into(),
            ),
        }
    }
}

/// A start whose constant is that at rest: what the record has beside it is a motion that stands still, which
/// like all motions is there for drives that begin as the record does.
fn near_or_at_rest(start: &RecordStart) -> RecordStart {
    let mut out = start.clone();
    if let Some(at_rest) = &start.at_rest {
        let stands = FreeMotion {
            decay_per_s: 0.0,
            frequency_rad_s: 0.0,
        };
        out.motions
            .push((stands, [start.offset_um - at_rest.offset_um, 0.0]));
        out.offset_um = at_rest.offset_um;
    }
    out
}

/// The start of a record with nothing moving, for a drive that begins elsewhere.
fn at_rest(start: &RecordStart, first_v: f64) -> RecordStart {
    RecordStart {
        file: String::new(),
        offset_um: (start.at_rest.as_ref()).map_or(start.offset_um, |rest| rest.offset_um),
        motions: Vec::new(),
        drive_v: first_v,
        state: match start.state {
            InitialState::Virgin => InitialState::Virgin,
            _ => InitialState::Settled,
        },
        ..start.clone()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model_file::effect_named;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::Overview;

    /// A spring that a recorded force deflects.
    fn loaded() -> Model {
        let mut model = Model::new(0.0, 100.0);
        let overview = Overview::without_data(0.0, 100.0);
        for (id, values) in [("gain", [0.1]), ("load_force", [0.2])] {
            let effect = effect_named(id).expect("a built-in effect");
            model.add(EffectInstance::new(effect, &overview, &values));
        }
        model
    }

    #[test]
    fn a_recorded_force_acts_in_the_simulation_and_in_its_start() {
        let model = loaded();
        let force_n: Vec<f64> = (0..400).map(|k| (k as f64 / 40.0).sin()).collect();
        let mut played = PlayedDrive {
            file: "a".into(),
            sample_rate_hz: 1e3,
            drive_v: vec![0.0; 400],
            force_n: Some(force_n),
            ..PlayedDrive::default()
        };
        let reads_um = model.simulate(&played.rows()).into_iter();
        let read_um: Vec<f64> = reads_um.map(|um| um + 0.5).collect();
        played.reading_um = Some(read_um.clone());
        let way = Way::told(&model, None, None);
        let like = Initial::like(&model, &played, way).expect("a recording");
        let predicted = |played: &PlayedDrive| {
            like.predict(&model, "a", &played.rows(), way, "a")
                .expect("a drive inside the range")
                .0
        };
        let with = predicted(&played);
        for (um, read_um) in with.reading_um.iter().zip(&read_um) {
            assert!((um - read_um).abs() < 1e-9, "{um} for {read_um}");
        }
        assert!(!with.remarks.iter().any(|note| note.contains("force")));
        played.force_n = None;
        let without = predicted(&played);
        assert!(without.remarks.iter().any(|note| note.contains("force")));
    }
}
