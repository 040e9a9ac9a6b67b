//! Replay: the saved model driven from the first sample of a file to its last, with one initial state and one
//! constant.
//!
//! The error of a record is that of its window, and a file may be several records. What a user of the model
//! sees is another figure: the error over the whole file. Where the two differ something slow is missing, or
//! a state that no sample shows. [`Replay::drift`] says which part of the error it is, and what to record.
//!
//! # How the cause is found
//! The residual of the replay is regressed, inside the windows that were judged, on each explanation alone: a
//! smooth trend in time, a constant of each window, and for each effect the free motions of its states, begun
//! anew in each window. The one that takes the largest share of the squares, less what as many columns of
//! noise would take, is the cause. Outside the windows the place says it: a rest, a beginning.

use crate::dataset::{Dataset, Record, Role};
use crate::identification::fit::{dot, residual, rms};
use crate::identification::nuisance_terms::{orthonormalised, project_out_of};
use crate::parallel;
use hysteron_sim::chain::{InitialState, Model};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::ops::Range;

/// A replay is as good as the judged error where it is below this multiple of it.
pub const AS_GOOD: f64 = 1.5;
/// An explanation is the cause where it takes this share of the squares at least.
const TAKES: f64 = 0.4;
/// Stretches that are left out together between two parts of a tape, at least; shorter ones are a sensor's
/// limit or a disturbance.
const PART_MIN: usize = 64;
/// Powers of time in a trend.
const TREND: usize = 4;

/// What the saved model makes of one file.
#[derive(Clone, Debug, Serialize)]
pub struct Replay {
    /// The file.
    pub file: String,
    /// The records that are parts of it, by position in the data set.
    #[serde(skip)]
    pub records: Vec<usize>,
    /// Samples.
    pub samples: usize,
    /// Error over the whole file, um.
    pub rms_um: f64,
    /// Largest error, um.
    pub max_um: f64,
    /// When it occurs, s from the first sample.
    pub max_at_s: f64,
    /// The error that was reported for its records: of those that are held out, or of all where none is, um.
    pub judged_um: f64,
    /// The state in which the replay begins.
    pub begins: &'static str,
    /// What the replay shows that the judged error does not.
    pub drift: Option<ReplayDrift>,
}

/// Why a replay is worse than the judged error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplayDrift {
    /// An effect of the model whose states drift, or `trend`, `offset`, `outside`, `unknown`.
    pub cause: String,
    /// Share of the squares that it takes.
    pub share: f64,
    /// In words, with what to record.
    pub sentence: String,
}

impl Replay {
    /// How many times the judged error the replay is.
    #[must_use]
    pub fn times_judged(&self) -> f64 {
        if self.judged_um > 0.0 {
            self.rms_um / self.judged_um
        } else {
            1.0
        }
    }

    /// One line for a screen.
    #[must_use]
    pub fn sentence(&self) -> String {
        let nm = |um: f64| words_nm(um);
        let figures = format!(
            "replay of {} from its first sample to its last ({}): {} nm RMS, largest {} nm at {:.3} s",
            self.file,
            self.begins,
            nm(self.rms_um),
            nm(self.max_um),
            self.max_at_s
        );
        match &self.drift {
            Some(drift) => format!(
                "{figures}; {:.1} times the judged error. {}",
                self.times_judged(),
                drift.sentence
            ),
            None => figures,
        }
    }
}

fn words_nm(um: f64) -> String {
    let nm = 1e3 * um;
    match nm.abs() {
        size if size >= 100.0 => format!("{nm:.0}"),
        size if size >= 10.0 => format!("{nm:.1}"),
        _ => format!("{nm:.2}"),
    }
}

/// The replays of a model over all files of a data set that are fitted or judge, in the order of their first
/// records.
/// ```
/// use hysteron::{Dataset, Record, Unwatched, effects_named, identify, replays};
///
/// let drive_v: Vec<f64> = (0..2000).map(|k| 5.0 - 5.0 * (0.1 * f64::from(k)).cos()).collect();
/// // A reading is taken before the drive of its row acts.
/// let reading_um: Vec<f64> = [0.0].into_iter().chain(drive_v.iter().map(|u| 0.1 * u)).take(2000).collect();
/// let record = Record::new("stage", 1000.0, drive_v, reading_um).from_virgin_state();
/// let dataset = Dataset::new("my stage", 0.0, 10.0, vec![record])?;
/// let model = identify(&dataset, &effects_named("gain")?, &Unwatched)?.model;
/// assert!(replays(&model, &dataset)[0].rms_um < 1e-9);
/// # Ok::<(), hysteron::Error>(())
/// ```
#[must_use]
pub fn replays(model: &Model, dataset: &Dataset) -> Vec<Replay> {
    let model = &*model.before_rounding();
    let files = files(dataset);
    parallel::map(&files, |records| replay(model, dataset, records))
}

/// Records by the file that they are parts of: those of one source with the same signals.
pub(crate) fn files(dataset: &Dataset) -> Vec<Vec<usize>> {
    let mut out: Vec<Vec<usize>> = Vec::new();
    let same = |a: &Record, b: &Record| {
        a.source == b.source
            && a.sample_rate_hz == b.sample_rate_hz
            && a.initial_state == b.initial_state
            && a.drive_v == b.drive_v
    };
    for (i, record) in dataset
        .records
        .iter()
        .enumerate()
        .filter(|(_, record)| record.role != Role::Noise)
    {
        match out
            .iter_mut()
            .find(|file| same(&dataset.records[file[0]], record))
        {
            Some(file) => file.push(i),
            None => out.push(vec![i]),
        }
    }
    out
}

/// The whole file of some records, with what counts nowhere left out of it.
pub(crate) fn whole(dataset: &Dataset, records: &[usize]) -> Record {
    let first = &dataset.records[records[0]];
    let name = first.source.rsplit(['/', '\\']).next().unwrap_or_default();
    let mut whole = Record {
        window: 0..first.drive_v.len(),
        left_out: Vec::new(),
        name: name.to_owned(),
        periods: None,
        ..first.clone()
    };
    // Readings that a data set leaves out or replaces are found again, where no record has its window too.
    if let Ok(checked) = Dataset::new(
        "",
        dataset.drive_min_v,
        dataset.drive_max_v,
        vec![whole.clone()],
    ) && let Some(record) = checked.records.into_iter().next()
    {
        whole = record;
    }
    let (mut seen, mut counts) = (
        vec![false; whole.drive_v.len()],
        vec![false; whole.drive_v.len()],
    );
    parts(dataset, records)
        .into_iter()
        .flatten()
        .for_each(|k| seen[k] = true);
    records
        .iter()
        .flat_map(|i| dataset.records[*i].counted())
        .for_each(|k| counts[k] = true);
    let bad: Vec<Range<usize>> = (0..seen.len())
        .filter(|k| seen[*k] && !counts[*k])
        .map(|k| k..k + 1)
        .collect();
    whole.leave_out(bad);
    whole
}

/// Windows of records that were judged, without what other records of the same tape have, in order.
fn parts(dataset: &Dataset, records: &[usize]) -> Vec<Range<usize>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for record in records.iter().map(|i| &dataset.records[*i]) {
        // Long stretches that are left out are other parts; short ones are a sensor's limit.
        let long = record
            .left_out_in_window()
            .filter(|range| range.len() >= PART_MIN);
        let mut start = record.window.start;
        for gap in long {
            out.push(start..gap.start);
            start = gap.end;
        }
        out.push(start..record.window.end);
    }
    out.retain(|part| !part.is_empty());
    out.sort_by_key(|part| part.start);
    out
}

fn replay(model: &Model, dataset: &Dataset, records: &[usize]) -> Replay {
    let whole = whole(dataset, records);
    let left = residual(model, &whole);
    let counted: Vec<usize> = whole.counted().collect();
    let values: Vec<f64> = counted.iter().map(|k| left[*k]).collect();
    let at = counted
        .iter()
        .copied()
        .max_by(|a, b| left[*a].abs().total_cmp(&left[*b].abs()))
        .unwrap_or(0);
    let judged_um = judged_um(model, dataset, records);
    let mut out = Replay {
        file: whole.name.clone(),
        records: records.to_vec(),
        samples: counted.len(),
        rms_um: rms(&values),
        max_um: left.get(at).map_or(0.0, |um| um.abs()),
        max_at_s: at as f64 * whole.dt_s(),
        judged_um,
        begins: match whole.initial_state {
            InitialState::Virgin => "from the virgin state",
            InitialState::Settled => "from rest",
            InitialState::Unknown => "from one estimated state",
        },
        drift: None,
    };
    if out.rms_um > AS_GOOD * judged_um {
        out.drift = Some(drift(model, &whole, &left, &parts(dataset, records), &out));
    }
    out
}

/// The error of the records of a file: of those that judge, or of all where none does.
fn judged_um(model: &Model, dataset: &Dataset, records: &[usize]) -> f64 {
    let judges: Vec<usize> = records
        .iter()
        .copied()
        .filter(|i| dataset.records[*i].role == Role::Validate)
        .collect();
    let judges = if judges.is_empty() { records } else { &judges };
    crate::identification::fit::rms_over(model, dataset, judges)
}

/// A way to explain what a replay leaves.
struct Explanation {
    cause: String,
    columns: DMatrix<f64>,
}

fn drift(
    model: &Model,
    whole: &Record,
    left: &[f64],
    parts: &[Range<usize>],
    replay: &Replay,
) -> ReplayDrift {
    let inside: Vec<usize> = parts
        .iter()
        .cloned()
        .flatten()
        .filter(|k| whole.counts(*k))
        .collect();
    let target = DVector::from_iterator(inside.len(), inside.iter().map(|k| left[*k]));
    if rms(target.as_slice()) < AS_GOOD * replay.judged_um {
        return outside(model, whole, parts, replay);
    }
    let squares = dot(target.as_slice(), target.as_slice());
    let least = replay.judged_um * replay.judged_um;
    let taken = |explanation: &Explanation| {
        let basis = orthonormalised(&explanation.columns);
        let mut rest = target.clone();
        project_out_of(&basis, &mut rest);
        // As many columns would take this much of noise.
        (squares - rest.norm_squared() - basis.ncols() as f64 * least) / squares
    };
    let all = explanations(model, whole, parts, &inside);
    let shares: Vec<f64> = all.iter().map(taken).collect();
    // The trend comes first: it has the fewest columns, and creep follows any trend.
    let best = match shares.first() {
        Some(share) if *share > TAKES => 0,
        _ => (0..all.len())
            .max_by(|a, b| shares[*a].total_cmp(&shares[*b]))
            .unwrap_or(0),
    };
    let (cause, share) = if shares[best] > TAKES {
        (all[best].cause.clone(), shares[best])
    } else {
        ("unknown".to_owned(), shares[best].max(0.0))
    };
    ReplayDrift {
        sentence: advice(model, whole, &cause, share),
        cause,
        share,
    }
}

/// The columns of each explanation at the samples that were judged.
fn explanations(
    model: &Model,
    whole: &Record,
    parts: &[Range<usize>],
    inside: &[usize],
) -> Vec<Explanation> {
    let rows = inside.len();
    let length = whole.drive_v.len() as f64;
    let trend = DMatrix::from_fn(rows, TREND, |row, power| {
        (inside[row] as f64 / length).powi(power as i32)
    });
    let offset = DMatrix::from_fn(rows, parts.len(), |row, part| {
        f64::from(parts[part].contains(&inside[row]))
    });
    let mut out = vec![
        Explanation {
            cause: "trend".into(),
            columns: trend,
        },
        Explanation {
            cause: "offset".into(),
            columns: offset,
        },
    ];
    for instance in &model.effects {
        let motions = instance.effect.free_motions(model, &instance.values());
        let slow: Vec<f64> = motions
            .iter()
            .filter(|m| m.frequency_rad_s == 0.0 && m.decay_per_s > 0.0)
            .map(|m| m.decay_per_s)
            .collect();
        if slow.is_empty() {
            continue;
        }
        let columns = DMatrix::from_fn(rows, slow.len() * parts.len(), |row, column| {
            let (part, k) = (&parts[column / slow.len()], inside[row]);
            let since_s = (k as f64 - part.start as f64) * whole.dt_s();
            if part.contains(&k) {
                (-slow[column % slow.len()] * since_s).exp()
            } else {
                0.0
            }
        });
        out.push(Explanation {
            cause: instance.id.clone(),
            columns,
        });
    }
    out
}

/// Where the error stands outside the windows that were judged.
fn outside(model: &Model, whole: &Record, parts: &[Range<usize>], replay: &Replay) -> ReplayDrift {
    let (first, last) = (
        parts.first().map_or(0, |p| p.start),
        parts.last().map_or(0, |p| p.end),
    );
    let at = (replay.max_at_s / whole.dt_s()).round() as usize;
    let place = if at < first {
        format!(
            "before {:.3} s, where the file begins and nothing is fitted",
            first as f64 * whole.dt_s()
        )
    } else if at >= last {
        format!(
            "after {:.3} s, where nothing is fitted",
            last as f64 * whole.dt_s()
        )
    } else {
        "between the parts that are fitted".to_owned()
    };
    let remembers = whole.initial_state == InitialState::Unknown
        && at < first
        && model
            .effects
            .iter()
            .any(|e| e.effect.declaration().is_main());
    let what = if remembers {
        "The loops remember what came before the first sample. Begin a recording at rest at the lowest drive, or with one cycle over the whole range."
    } else {
        "Judge this stretch too: name the file in a dataset.toml with the times (from_s, to_s) that matter to you."
    };
    ReplayDrift {
        cause: "outside".into(),
        share: 1.0,
        sentence: format!("The error stands {place}. {what}"),
    }
}

fn advice(model: &Model, whole: &Record, cause: &str, share: f64) -> String {
    let percent = 100.0 * share;
    let length_s = whole.drive_v.len() as f64 * whole.dt_s();
    match cause {
        "trend" => format!(
            "A slow trend that no effect of the model follows is {percent:.0} % of it: a thermal drift, or creep slower than the recording. Record {length_s:.0} s of rest \
             at constant drive before and after the motion, and the temperature."
        ),
        "offset" => format!(
            "A jump between the parts of the recording is {percent:.0} % of it. Look for a sensor or an amplifier that changed its zero."
        ),
        "unknown" => {
            "No single slow motion explains it: loops or dynamics differ between the parts. Record each kind of motion twice.".to_owned()
        }
        id => {
            let experiment = model.effect(id).map_or_else(String::new, |e| e.effect.declaration().experiment);
            format!("The states of {id} do not carry over from one part to the next: {percent:.0} % of it. Best shown by: {experiment}.")
        }
    }
}

/// What a screen says of replays: each that is worse than the judged error; one line for all others.
#[must_use]
pub fn lines(replays: &[Replay]) -> Vec<String> {
    let mut out: Vec<String> = replays
        .iter()
        .filter(|r| r.drift.is_some())
        .map(Replay::sentence)
        .collect();
    let good: Vec<&Replay> = replays.iter().filter(|r| r.drift.is_none()).collect();
    match good.as_slice() {
        [] => {}
        [one] => out.push(one.sentence()),
        several => {
            let worst = several
                .iter()
                .max_by(|a, b| a.max_um.total_cmp(&b.max_um))
                .map_or(0.0, |r| r.max_um);
            let squares: f64 = several
                .iter()
                .map(|r| r.rms_um * r.rms_um * r.samples as f64)
                .sum();
            let samples: usize = several.iter().map(|r| r.samples).sum();
            out.push(format!(
                "replay of {} files from their first samples to their last: {} nm RMS, largest {} nm",
                several.len(),
                words_nm((squares / samples.max(1) as f64).sqrt()),
                words_nm(worst)
            ));
        }
    }
    out
}
