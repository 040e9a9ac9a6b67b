//! Five words for what came out, and the figures behind them (`hysteron.diagnosis/1`).

use super::growth::{EXPLAINED, Growth, nm};
use crate::dataset::Dataset;
use crate::dataset::reading_grid::{grid_by_chance, rounding_noise_um};
use crate::floor::NoiseFloor;
use serde::Serialize;

/// The verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing is missing that the data could show.
    AtFloor,
    /// These effects are missing.
    Named,
    /// One of these is missing; the data cannot tell which.
    Ambiguous,
    /// Something is missing that no known effect explains.
    Unexplained,
    /// Without a noise floor nobody can say whether anything is missing.
    Undecidable,
}

impl Verdict {
    /// The word in files.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Verdict::AtFloor => "at_floor",
            Verdict::Named => "named",
            Verdict::Ambiguous => "ambiguous",
            Verdict::Unexplained => "unexplained",
            Verdict::Undecidable => "undecidable",
        }
    }
}

/// One candidate in the file.
#[derive(Clone, Debug, Serialize)]
pub struct CandidateFigures {
    /// The effect.
    pub effect: String,
    /// Share of the residual above the floor that its signature explains.
    pub explained_share: f64,
    /// 90 % interval of it.
    pub explained_share_interval: (f64, f64),
    /// Share of the resampled blocks in which it explains most of all candidates.
    pub stability: f64,
    /// p-value after control of false discoveries.
    pub p_value: f64,
    /// p-value of the candidate alone.
    pub p_value_alone: f64,
    /// Held-out error before.
    pub validate_rms_before_um: Option<f64>,
    /// Held-out error after adding it and fitting again; for finalists.
    pub validate_rms_after_um: Option<f64>,
    /// Fitted error after adding it.
    pub identify_rms_after_um: Option<f64>,
    /// Candidates whose signature looks the same on this data.
    pub confusable_with: Vec<String>,
    /// The experiment that shows it best.
    pub next_experiment: String,
}

/// Errors on fitted and held-out records.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Residuals {
    /// Fitted.
    pub identify: f64,
    /// Held out.
    pub validate: Option<f64>,
}

/// Residual in one cell of the map.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// What the samples have in common.
    pub feature: String,
    /// Residual there.
    pub rms_um: f64,
    /// How many samples.
    pub samples: usize,
}

/// Where a record fails.
#[derive(Clone, Debug, Serialize)]
pub struct RecordCells {
    /// The record.
    pub record: String,
    /// Its cells.
    pub cells: Vec<Cell>,
}

/// The diagnosis as it is written.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// `hysteron.diagnosis/1`.
    pub schema: &'static str,
    /// The word.
    pub verdict: Verdict,
    /// The same in a sentence.
    pub sentence: String,
    /// Effects that the verdict is about.
    pub named: Vec<String>,
    /// Floor used.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All estimates of the floor.
    pub floor_estimates: Vec<crate::floor::FloorEstimate>,
    /// Errors of the model that was diagnosed.
    pub residual_rms_um: Residuals,
    /// Errors after adding what is named, or the best that is known.
    pub residual_rms_after_um: Residuals,
    /// Candidates, best first.
    pub candidates: Vec<CandidateFigures>,
    /// Where the diagnosed model fails.
    #[serde(rename = "where")]
    pub where_it_fails: Vec<RecordCells>,
}

/// Held-out error within this of the floor counts as the floor.
const AT_FLOOR: f64 = 1.03;
/// Signatures more alike than this are confusable.
const ALIKE: f64 = 0.9;

/// Puts a growth into words.
#[must_use]
pub fn diagnose(growth: &Growth, floor: &NoiseFloor, dataset: &Dataset) -> Diagnosis {
    let first = &growth.steps[0].judged;
    let last = growth.last();
    let findings = growth.findings();
    let named: Vec<String> = findings.concat();
    let ambiguous = findings.iter().any(|f| f.len() > 1);
    let error = |j: &super::refit::Judged| j.validate_rms_um.unwrap_or(j.identify_rms_um);
    let within = |times: f64, floor_um: f64| error(last).max(last.identify_rms_um) <= times * floor_um;
    let (verdict, named) = match floor.rms_um {
        None => (Verdict::Undecidable, if growth.transferred && ambiguous { named } else { growth.added() }),
        Some(floor_um) if named.is_empty() && within(AT_FLOOR, floor_um) => (Verdict::AtFloor, Vec::new()),
        Some(floor_um) if named.is_empty() || !within(EXPLAINED, floor_um) => (Verdict::Unexplained, Vec::new()),
        Some(_) => (if ambiguous { Verdict::Ambiguous } else { Verdict::Named }, named),
    };
    let sentence = sentence(verdict, &named, growth, floor);
    Diagnosis {
        schema: "hysteron.diagnosis/1",
        verdict,
        sentence,
        named,
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        floor_estimates: floor.estimates.clone(),
        residual_rms_um: Residuals { identify: first.identify_rms_um, validate: first.validate_rms_um },
        residual_rms_after_um: Residuals { identify: last.identify_rms_um, validate: last.validate_rms_um },
        candidates: candidate_figures(growth).into_iter().chain(rounding_figures(growth, floor)).collect(),
        where_it_fails: cells(first, dataset),
    }
}

fn candidate_figures(growth: &Growth) -> Vec<CandidateFigures> {
    let Some(round) = growth.rounds().find(|r| !r.tied.is_empty()).or(growth.rounds().next()) else { return Vec::new() };
    let scores = &round.screening.scores;
    let mut order: Vec<usize> = round.finalists.iter().map(|f| f.score).collect();
    // The accepted ones first, then the other finalists, then the rest by what they explain.
    order.sort_by_key(|i| !round.tied.contains(&scores[*i].id));
    order.extend((0..scores.len()).filter(|i| !round.finalists.iter().any(|f| f.score == *i)));
    let before = growth.steps[0].judged.validate_rms_um;
    order
        .into_iter()
        .map(|i| {
            let score = &scores[i];
            let finalist = round.finalists.iter().find(|f| f.score == i);
            let mut confusable: Vec<String> =
                scores.iter().filter(|s| s.id != score.id && s.similarity(score) > ALIKE).map(|s| s.id.clone()).collect();
            for id in &round.tied {
                if round.tied.contains(&score.id) && *id != score.id && !confusable.contains(id) {
                    confusable.push(id.clone());
                }
            }
            CandidateFigures {
                effect: score.id.clone(),
                explained_share: score.share,
                explained_share_interval: score.share_interval,
                stability: score.stability,
                p_value: score.p_adjusted,
                p_value_alone: score.p_value,
                validate_rms_before_um: before,
                validate_rms_after_um: finalist.and_then(|f| f.judged.validate_rms_um),
                identify_rms_after_um: finalist.map(|f| f.judged.identify_rms_um),
                confusable_with: confusable,
                next_experiment: score.effect.declaration().experiment,
            }
        })
        .collect()
}

/// The converter, which the readings show and no residual does: the share is that of the noise.
fn rounding_figures(growth: &Growth, floor: &NoiseFloor) -> Option<CandidateFigures> {
    let (step_um, floor_um) = (floor.reading_step_um?, floor.rms_um?);
    let quantisation = hysteron_sim::effect::by_id("quantisation").filter(|_| growth.added().iter().any(|id| id == "quantisation"))?;
    let share = (rounding_noise_um(step_um) / floor_um).powi(2).min(1.0);
    let (before, last) = (&growth.steps[0].judged, growth.last());
    Some(CandidateFigures {
        effect: "quantisation".into(),
        explained_share: share,
        explained_share_interval: (share, share),
        stability: 1.0,
        p_value: grid_by_chance(),
        p_value_alone: grid_by_chance(),
        validate_rms_before_um: before.validate_rms_um,
        validate_rms_after_um: last.validate_rms_um,
        identify_rms_after_um: Some(last.identify_rms_um),
        confusable_with: Vec::new(),
        next_experiment: quantisation.declaration().experiment,
    })
}

fn words(id: &str) -> String {
    id.replace('_', " ")
}

fn list(ids: &[String], joint: &str) -> String {
    match ids {
        [] => String::new(),
        [one] => words(one),
        [head @ .., last] => format!("{} {joint} {}", head.iter().map(|i| words(i)).collect::<Vec<_>>().join(", "), words(last)),
    }
}

fn sentence(verdict: Verdict, named: &[String], growth: &Growth, floor: &NoiseFloor) -> String {
    let floor_nm = floor.rms_um.map(nm).unwrap_or_default();
    let (first, last) = (&growth.steps[0].judged, growth.last());
    // Where the fitted records are met worse than the held-out ones, they are what is spoken of.
    let fitted_is_worse = verdict == Verdict::Unexplained && last.validate_rms_um.is_some_and(|v| v < last.identify_rms_um);
    let error = |j: &super::refit::Judged| if fitted_is_worse { j.identify_rms_um } else { j.validate_rms_um.unwrap_or(j.identify_rms_um) };
    let (before, after) = (error(first), error(last));
    let which = if fitted_is_worse {
        "error on the fitted records"
    } else if first.validate_rms_um.is_none() {
        "error"
    } else {
        "held-out error"
    };
    match verdict {
        Verdict::AtFloor if before > EXPLAINED * after => {
            format!(
                "Nothing is missing that this data could show, but the values are others: fitted again to it, the same effects bring the {which} \
                 from {} to {} nm; the noise is {floor_nm} nm.",
                nm(before),
                nm(after)
            )
        }
        Verdict::AtFloor => {
            format!("Nothing is missing that this data could show: the {which} is {} nm, the noise {floor_nm} nm.", nm(after))
        }
        Verdict::Named if named == ["quantisation"] => {
            let step_um = floor.reading_step_um.unwrap_or(0.0);
            format!(
                "Quantisation is missing: the readings are whole steps of {} nm, which make {} of the {floor_nm} nm of noise. Nothing else is \
                 missing that this data could show: the {which} is {} nm.",
                nm(step_um),
                nm(rounding_noise_um(step_um)),
                nm(after)
            )
        }
        Verdict::Named => {
            let (verb, adding) = if named.len() == 1 { ("is", "adding it") } else { ("are", "adding them") };
            format!(
                "{} {verb} missing: {adding} brings the {which} from {} to {} nm; the noise is {floor_nm} nm.",
                capital(&list(named, "and")),
                nm(before),
                nm(after)
            )
        }
        Verdict::Ambiguous => {
            let findings = growth.findings();
            let (said, adding) = match findings.as_slice() {
                [_] => ("this data cannot tell which is missing. Either brings", "about "),
                _ => ("are missing; where it says `or`, this data cannot tell which. Together they bring", ""),
            };
            let joint = if findings.len() == 1 { ": " } else { " " };
            let parts: Vec<String> = findings.iter().map(|f| list(f, "or")).collect();
            format!(
                "{}{joint}{said} the {which} from {} to {adding}{} nm; the noise is {floor_nm} nm.",
                capital(&parts.join("; and ")),
                nm(before),
                nm(after)
            )
        }
        Verdict::Unexplained => {
            let best = growth.added();
            let known = if best.is_empty() {
                "no known effect explains any of it".to_string()
            } else {
                format!("the best that is known ({}) leaves {} nm", list(&best, "and"), nm(after))
            };
            format!(
                "Something is missing that the library does not know: the {which} is {} nm, the noise {floor_nm} nm, and {known}.",
                nm(before)
            )
        }
        Verdict::Undecidable => {
            let best = growth.added();
            if growth.transferred && !best.is_empty() {
                let others = if named.len() > 1 {
                    format!("this data cannot tell {} apart", list(named, "and"))
                } else {
                    format!("no other effect does as well: this data can tell {} from the others", words(&best[0]))
                };
                let alone = growth.steps[1].judged.identify_rms_um;
                return format!(
                    "{} is missing in this recording: with all values held as they were identified elsewhere, it alone brings the error from {} \
                     to {} nm; {others}. The noise is unknown, so nobody can say whether more is missing.",
                    capital(&list(named, "or")),
                    nm(before),
                    nm(alone)
                );
            }
            let gained = if best.is_empty() && before > EXPLAINED * after {
                format!(
                    "fitted again to this data, the same effects bring the {which} from {} to {} nm, and no other lowers it",
                    nm(before),
                    nm(after)
                )
            } else if best.is_empty() {
                "no effect lowers the held-out error".to_string()
            } else {
                let (verb, which) =
                    (if best.len() == 1 { "lowers" } else { "lower" }, if first_is_held_out(growth) { "held-out error" } else { "error" });
                format!("{} {verb} the {which} from {} to {} nm", list(&best, "and"), nm(before), nm(after))
            };
            format!(
                "Without repeats, periods or a record at rest the noise is unknown, so nobody can say whether more is missing; {gained}."
            )
        }
    }
}

fn first_is_held_out(growth: &Growth) -> bool {
    growth.steps[0].judged.validate_rms_um.is_some()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().collect::<String>() + letters.as_str())
}

fn cells(judged: &super::refit::Judged, dataset: &Dataset) -> Vec<RecordCells> {
    use crate::report::features::{drive_features, residual_by_feature};
    let range_v = (dataset.drive_min_v, dataset.drive_max_v);
    dataset
        .records
        .iter()
        .zip(&judged.residuals)
        .filter(|(_, residual)| !residual.is_empty())
        .map(|(record, residual)| {
            let mut full = vec![f64::NAN; record.drive_v.len()];
            full[record.window.clone()].copy_from_slice(residual);
            let found = residual_by_feature(&record.drive_v, &full, record.sample_rate_hz, record.window.clone(), range_v);
            let cells = drive_features(range_v.0, range_v.1)
                .into_iter()
                .zip(found)
                .filter_map(|(feature, cell)| {
                    cell.map(|c| Cell { feature: format!("{} {}", feature.group, feature.label), rms_um: c.rms, samples: c.samples })
                })
                .collect();
            RecordCells { record: record.name.clone(), cells }
        })
        .collect()
}
