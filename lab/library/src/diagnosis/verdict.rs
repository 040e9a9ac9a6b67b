//! Five words for what came out, and the figures behind them (`hysteron.diagnosis/1`).

use super::decision::Decision;
use super::drive_timing::OwnRow;
use super::elsewhere::{ChangedValue, Elsewhere, Hypothesis};
use super::feedback::Feedback;
use super::initial_states::{OffZero, OtherStates};
use super::judgement::{Judged, Split, improvement};
use super::policy::Policy;
use super::reduction::Supported;
use super::residual_map::{drive_features, residual_by_feature};
use super::unanswered::Unanswered;
use super::words;
use crate::dataset::Dataset;
use crate::dataset::reading_grid::{grid_by_chance, rounding_noise};
use crate::dataset::reading_limits::ReadingLimit;
use crate::identification::finer_hysteresis::{description, main_effect};
use crate::identification::noise_floor::{FloorEstimate, NoiseFloor};
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{by_id, delay, gain};
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
    /// The added effect in whose place it was looked at; its own name for that one itself.
    pub in_place_of: Option<String>,
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
    /// Held-out error without it.
    pub validate_rms_before_um: Option<f64>,
    /// Held-out error with it, fitted again; for those that were fitted.
    pub validate_rms_after_um: Option<f64>,
    /// Fitted error with it.
    pub identify_rms_after_um: Option<f64>,
    /// Candidates whose signature looks the same on this data, or that do as well in its place.
    pub confusable_with: Vec<String>,
    /// The experiment that shows it best.
    pub next_experiment: String,
    /// The rule that admitted or refused it.
    pub decision: Decision,
    /// What speaks against this reading of the data, from its physics.
    pub unlikely_because: Option<String>,
}

/// Errors on fitted and held-out records.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Residuals {
    /// Fitted.
    pub identify: f64,
    /// Held out.
    pub validate: Option<f64>,
}

impl Residuals {
    /// Of a judged model.
    #[must_use]
    pub fn of(judged: &Judged) -> Self {
        Self { identify: judged.identify_rms_um, validate: judged.validate_rms_um }
    }
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

/// One finding: what was added, with what the data cannot tell from it, likeliest first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The effects; more than one where the data cannot tell them apart.
    pub effects: Vec<String>,
    /// The rule by which it was admitted.
    pub decision: Decision,
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
    /// What was found, one entry for each missing effect.
    pub findings: Vec<Finding>,
    /// How the loops of the model at the end are described, where they are not of the structure that was started from, and how others are that
    /// meet the data as well.
    pub loops: Vec<String>,
    /// Effects that are there but have other values than in the model that was handed in.
    pub changed: Vec<ChangedValue>,
    /// What is wrong with the recording itself, or left open by it, in sentences.
    pub recording: Vec<String>,
    /// Floor used.
    pub noise_floor_um: Option<f64>,
    /// What it rests on.
    pub floor_basis: String,
    /// All estimates of the floor.
    pub floor_estimates: Vec<FloorEstimate>,
    /// The error is below the floor: one of them is wrong.
    pub below_the_floor: bool,
    /// Errors of the model that was diagnosed.
    pub residual_rms_um: Residuals,
    /// Errors after adding what is named, or the best that is known.
    pub residual_rms_after_um: Residuals,
    /// Candidates, best first.
    pub candidates: Vec<CandidateFigures>,
    /// What was added and taken back again, with the rule.
    pub taken_back: Vec<(String, Decision)>,
    /// Where the diagnosed model fails.
    #[serde(rename = "where")]
    pub where_it_fails: Vec<RecordCells>,
}

impl CandidateFigures {
    /// The p-value, where the candidate was weighed against chance: beside a model from elsewhere the errors alone decide, and nothing is resampled.
    #[must_use]
    pub fn p_weighed(&self) -> Option<f64> {
        let (least, most) = self.explained_share_interval;
        (least < most || self.p_value < 1.0).then_some(self.p_value)
    }
}

impl Diagnosis {
    /// Two effects differ by no more than this, in um, on the best of the drives that the data allow: none is proposed to tell them apart.
    pub(crate) fn decided_by_no_drive(&mut self, between: &[String; 2], separation_um: f64) {
        for (at, id) in between.iter().enumerate() {
            let other = words::spoken(&between[1 - at]);
            for candidate in self.candidates.iter_mut().filter(|c| c.effect == *id) {
                candidate.next_experiment = format!(
                    "no drive within the limits of this data tells it from {other}: on the best the two differ by {:.2} nm",
                    1e3 * separation_um
                );
            }
        }
    }
}

/// What a diagnosis is put together from.
pub struct Found<'a> {
    /// The model that was started from.
    pub first: &'a Judged,
    /// The model at the end.
    pub last: &'a Judged,
    /// What was added and stays.
    pub supported: &'a [Supported],
    /// What was taken back.
    pub taken_back: &'a [(String, Decision)],
    /// The comparison with a model from elsewhere.
    pub elsewhere: Option<&'a Elsewhere>,
    /// Candidates beside the model at the end, where nothing was added.
    pub beside_start: Option<&'a super::screening::Screening>,
    /// The effect that the readings themselves show: they are whole steps of a converter.
    pub quantised: Option<&'a str>,
    /// How other loops are described that meet the data as well as those of the model at the end.
    pub loops_alike: &'a [String],
    /// Where the readings end.
    pub reading_limits: &'a [ReadingLimit],
    /// Records that do not begin in the state that was said.
    pub other_states: Option<&'a OtherStates>,
    /// Records whose sensor stands off its zero.
    pub off_zero: Option<&'a OffZero>,
    /// The readings follow the drive of their own row.
    pub own_row: Option<&'a OwnRow>,
    /// Records whose readings do not answer the drive.
    pub unanswered: &'a [Unanswered],
    /// Records whose drive follows the noise of the readings.
    pub feedback: &'a [Feedback],
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// The search ended when its time was over.
    pub out_of_time: bool,
}

impl Found<'_> {
    /// Nothing can be decided before something else is said of how the data were recorded.
    #[must_use]
    pub fn recorded_otherwise(&self) -> bool {
        self.other_states.is_some() || self.off_zero.is_some() || self.own_row.is_some() || !self.unanswered.is_empty()
    }

    /// Effects that the last model has more than the first, where nothing was weighed because the search was stopped.
    #[must_use]
    pub fn unweighed(&self) -> Vec<String> {
        if !self.stopped || !self.supported.is_empty() {
            return Vec::new();
        }
        let new = |id: &String| self.first.model.effect(id).is_none() && self.quantised != Some(id.as_str());
        self.last.model.effect_ids().into_iter().filter(new).collect()
    }
}

/// Puts what was found into one of the five words.
#[must_use]
pub fn diagnose(found: &Found, floor: &NoiseFloor, dataset: &Dataset, split: &Split, policy: &Policy) -> Diagnosis {
    // What is missing in a recording that was made otherwise is not known before it is said how it was made.
    let findings = if found.recorded_otherwise() { Vec::new() } else { findings(found, floor, split, policy) };
    let named: Vec<String> = findings.iter().flat_map(|f| f.effects.iter().cloned()).collect();
    let ambiguous = findings.iter().any(|f| f.effects.len() > 1);
    // Where only a lower bound of the noise is known, a model that leaves no more than that leaves nothing.
    let bound = vec![floor.at_least_um; dataset.records.len()];
    let leaves_the_bound = floor.rms_um.is_none() && found.last.within(policy.explained, &bound, split);
    let floors_um = if leaves_the_bound { &bound } else { &floor.of_records_um };
    let within = |times: f64| found.last.within(times, floors_um, split);
    // What rounding makes of readings at rest, on one code or between two, may be more than what it leaves of readings that move.
    let is_rounding =
        floor.reading_step_um.zip(floor.rms_um).is_some_and(|(step_um, rms_um)| rms_um < policy.mostly_rounding * rounding_noise(step_um));
    let contradiction =
        !leaves_the_bound && !is_rounding && within(policy.contradiction.min(1.0 - policy.floor_z * floor.relative_std()).max(0.0));
    let as_the_noise = policy.at_floor + policy.floor_z * floor.relative_std();
    // A search that was stopped has added what nobody weighed.
    let unweighed = found.unweighed();
    // What one that had no more time has not found may be in the library all the same.
    let cut_short = found.out_of_time && !within(policy.explained.max(as_the_noise));
    let decidable =
        (floor.rms_um.is_some() || leaves_the_bound) && !contradiction && unweighed.is_empty() && !found.recorded_otherwise() && !cut_short;
    let told = findings.iter().any(|f| matches!(f.decision, Decision::ExplainsAlone { .. }));
    let something_else_acts = found.supported.iter().any(|s| is_none_of_its_names(s, found));
    let one_or_all = if ambiguous { Verdict::Ambiguous } else { Verdict::Named };
    let (verdict, named) = match decidable {
        // What a recording has and a model from elsewhere has not is known however much that model leaves at home.
        _ if told => (one_or_all, named),
        false => (Verdict::Undecidable, named),
        true if named.is_empty() && within(as_the_noise) && !something_else_acts => (Verdict::AtFloor, Vec::new()),
        true if named.is_empty() || !within(policy.explained.max(as_the_noise)) => (Verdict::Unexplained, Vec::new()),
        true => (one_or_all, named),
    };
    let timing = timing_left_open(found, &named, dataset);
    let mut out = Diagnosis {
        schema: "hysteron.diagnosis/1",
        verdict,
        sentence: String::new(),
        named,
        findings,
        loops: other_loops(found),
        changed: found.elsewhere.map_or_else(Vec::new, Elsewhere::changed),
        recording: of_the_recording(found).chain(timing.clone()).collect(),
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        floor_estimates: floor.estimates.clone(),
        below_the_floor: contradiction,
        residual_rms_um: Residuals::of(found.first),
        residual_rms_after_um: Residuals::of(found.last),
        candidates: candidate_figures(found, floor, policy),
        taken_back: found.taken_back.to_vec(),
        where_it_fails: cells(found.first, dataset),
    };
    out.sentence = words::sentence(&out, found, floor, policy);
    out.sentence.extend(timing.map(|timing| format!(" Mind that {timing}.")));
    out
}

/// How the loops at the end are described, and those that do as well, where they are of another structure than at the start. In the place of a gain
/// loops are an effect that was added, and named as one.
fn other_loops(found: &Found) -> Vec<String> {
    let structure = |judged: &Judged| main_effect(&judged.model).map(|e| e.id.clone());
    if found.first.model.effect(gain::ID).is_some() || structure(found.first) == structure(found.last) {
        return Vec::new();
    }
    std::iter::once(description(&found.last.model)).chain(found.loops_alike.iter().cloned()).collect()
}

/// What is wrong with the recording itself, in sentences.
fn of_the_recording(found: &Found) -> impl Iterator<Item = String> {
    let ends = found.reading_limits.iter().map(words::reading_limit);
    let states = found.other_states.map(words::other_states);
    let loops = found.feedback.iter().map(words::followed_reading);
    let states = states.into_iter().chain(found.off_zero.map(words::off_zero));
    let own_row = found.own_row.map(words::own_row);
    let unanswered = found.unanswered.iter().map(words::unanswered);
    ends.chain(states).chain(own_row).chain(unanswered).chain(loops)
}

/// From where a delay counts that was found although nobody said when the drive of a row acts.
fn timing_left_open(found: &Found, named: &[String], dataset: &Dataset) -> Option<String> {
    let delayed = found.supported.iter().any(|s| s.id == delay::ID) || named.iter().any(|id| id == delay::ID);
    (dataset.timing_is_assumed && found.own_row.is_none() && delayed).then(|| words::delay_counts_from(dataset))
}

/// What was found, the likeliest reading of each first.
fn findings(found: &Found, floor: &NoiseFloor, split: &Split, policy: &Policy) -> Vec<Finding> {
    let far_above = floor.rms_um.is_some() && !found.last.within(policy.near_the_noise, &floor.of_records_um, split);
    let falls_from = |before: &Judged| improvement(before, found.last, split).record_relative > policy.finding_far_above;
    let worth_a_name = |s: &Supported| !far_above || (falls_from(found.first) && falls_from(&s.without));
    let mut out: Vec<Finding> = Vec::new();
    if let Some(elsewhere) = found.elsewhere {
        for (tried, alternatives) in elsewhere.story.iter().zip(&elsewhere.alternatives) {
            if !matches!(tried.hypothesis, Hypothesis::Missing(_)) {
                continue;
            }
            let others = alternatives.iter().filter(|t| matches!(t.hypothesis, Hypothesis::Missing(_)));
            let id = |t: &super::elsewhere::Tried| t.hypothesis.effect(&elsewhere.base.model);
            let effects = std::iter::once(tried).chain(others).map(id).collect();
            out.push(Finding { effects, decision: Decision::ExplainsAlone { share: elsewhere.explained_share } });
        }
    }
    for s in found.supported.iter().filter(|s| s.decision.admits() && worth_a_name(s) && !is_none_of_its_names(s, found)) {
        if out.iter().any(|f| f.effects.contains(&s.id)) {
            continue;
        }
        let mut effects = s.names();
        // A reading that its physics makes unlikely stands behind one that nothing speaks against.
        effects.sort_by_key(|id| unlikely(model_with(s, id, found), id).is_some());
        out.push(Finding { effects, decision: s.decision });
    }
    if let Some(id) = found.quantised {
        out.push(Finding { effects: vec![id.into()], decision: Decision::ReadingsShowIt });
    }
    out
}

/// The model that has an effect: the one at the end, or one with a rival in the place of what was added.
fn model_with<'a>(s: &'a Supported, id: &str, found: &'a Found) -> &'a Model {
    s.rivals.iter().find(|r| r.id == id).map_or(&found.last.model, |r| &r.judged.model)
}

/// An effect lowers the errors, and neither it nor what does as well in its place is what it is called.
fn is_none_of_its_names(s: &Supported, found: &Found) -> bool {
    s.decision.admits() && s.names().iter().all(|id| model_with(s, id, found).ruled_out_because(id).is_some())
}

/// What the physics of an effect says against its values in a model.
fn unlikely(model: &Model, id: &str) -> Option<String> {
    let e = model.effect(id)?;
    model.ruled_out_because(id).or_else(|| e.effect.unlikely_because(model, &e.values()))
}

fn candidate_figures(found: &Found, floor: &NoiseFloor, policy: &Policy) -> Vec<CandidateFigures> {
    let mut out: Vec<CandidateFigures> = Vec::new();
    for s in found.supported {
        out.extend(figures_of(s, found, policy));
    }
    // Every added effect first, then what else was looked at, by what it explains.
    let (mut added, mut others): (Vec<_>, Vec<_>) = out.into_iter().partition(|c| c.in_place_of.as_deref() == Some(&c.effect));
    others.sort_by(|a, b| b.decision.admits().cmp(&a.decision.admits()).then(b.explained_share.total_cmp(&a.explained_share)));
    let mut seen: Vec<String> = added.iter().map(|c| c.effect.clone()).collect();
    others.retain(|c| {
        let new = !seen.contains(&c.effect);
        seen.push(c.effect.clone());
        new
    });
    if let Some(elsewhere) = found.elsewhere.filter(|e| !e.at_home) {
        added.splice(0..0, hypothesis_figures(elsewhere));
    }
    added.extend(others);
    added.extend(rounding_figures(found, floor));
    if let Some(screening) = found.beside_start.filter(|_| found.supported.is_empty()) {
        let before = found.first.validate_rms_um;
        for score in &screening.scores {
            if !added.iter().any(|c| c.effect == score.id) {
                added.push(plain_figures(score, screening, before, None, policy));
            }
        }
    }
    added
}

fn plain_figures(
    score: &super::screening::Score,
    screening: &super::screening::Screening,
    before: Option<f64>,
    in_place_of: Option<String>,
    policy: &Policy,
) -> CandidateFigures {
    let evidence = score.evidence.as_ref();
    let p = evidence.map_or(1.0, |e| e.p_adjusted);
    let alike = screening.scores.iter().filter(|o| o.id != score.id && screening.similarity(o, score) > policy.alike);
    CandidateFigures {
        effect: score.id.clone(),
        in_place_of,
        explained_share: score.share,
        explained_share_interval: evidence.map_or((0.0, 1.0), |e| e.share_interval),
        stability: evidence.map_or(0.0, |e| e.stability),
        p_value: p,
        p_value_alone: evidence.map_or(1.0, |e| e.p_value),
        validate_rms_before_um: before,
        validate_rms_after_um: None,
        identify_rms_after_um: None,
        confusable_with: alike.map(|o| o.id.clone()).collect(),
        next_experiment: score.effect.declaration().experiment,
        decision: if p > policy.false_discovery_rate { Decision::NotInTheResidual { p } } else { Decision::NotTried },
        unlikely_because: None,
    }
}

/// An added effect, its rivals, and the rest of what was scored in its place.
fn figures_of(s: &Supported, found: &Found, policy: &Policy) -> Vec<CandidateFigures> {
    let names = s.names();
    let before = s.without.validate_rms_um;
    let mut out = Vec::new();
    for score in &s.screening.scores {
        let mut figures = plain_figures(score, &s.screening, before, Some(s.id.clone()), policy);
        let rival = s.rivals.iter().find(|r| r.id == score.id);
        if score.id == s.id {
            figures.decision = if is_none_of_its_names(s, found) { Decision::RuledOut } else { s.decision };
            figures.validate_rms_after_um = found.last.validate_rms_um;
            figures.identify_rms_after_um = Some(found.last.identify_rms_um);
            figures.unlikely_because = unlikely(&found.last.model, &s.id);
        } else if let Some(rival) = rival {
            figures.decision = rival.decision;
            figures.validate_rms_after_um = rival.judged.validate_rms_um;
            figures.identify_rms_after_um = Some(rival.judged.identify_rms_um);
            figures.unlikely_because = unlikely(&rival.judged.model, &rival.id);
        }
        if names.contains(&score.id) {
            for id in &names {
                if *id != score.id && !figures.confusable_with.contains(id) {
                    figures.confusable_with.push(id.clone());
                }
            }
        }
        out.push(figures);
    }
    out
}

/// What was tried alone beside a model from elsewhere.
fn hypothesis_figures(elsewhere: &Elsewhere) -> Vec<CandidateFigures> {
    let id_of = |t: &super::elsewhere::Tried| t.hypothesis.effect(&elsewhere.base.model);
    let told: Vec<String> = elsewhere.story.iter().map(id_of).collect();
    let tied: Vec<String> = elsewhere.alternatives.iter().flatten().map(id_of).collect();
    let square = |j: &Judged| j.identify_rms_um * j.identify_rms_um;
    let removable = (square(&elsewhere.base) - square(&elsewhere.refitted)).max(f64::MIN_POSITIVE);
    let missing = elsewhere.tried.iter().filter(|t| matches!(t.hypothesis, Hypothesis::Missing(_)));
    missing
        .map(|t| {
            let id = t.hypothesis.effect(&elsewhere.base.model);
            let share = ((square(&elsewhere.base) - square(&t.judged)) / removable).clamp(0.0, 1.0);
            let story = told.contains(&id);
            let beside = story || tied.contains(&id);
            // Those of the same step of the story.
            let steps = told.iter().zip(&elsewhere.alternatives).map(|(told, tied)| (told, tied.iter().map(id_of).collect::<Vec<_>>()));
            let of_its_step = steps.filter(|(told, tied)| **told == id || tied.contains(&id));
            let mut others: Vec<String> = of_its_step.flat_map(|(told, tied)| std::iter::once(told.clone()).chain(tied)).collect();
            others.retain(|o| *o != id);
            CandidateFigures {
                effect: id.clone(),
                in_place_of: Some(id.clone()),
                explained_share: share,
                explained_share_interval: (share, share),
                stability: if story { 1.0 } else { 0.0 },
                p_value: 1.0,
                p_value_alone: 1.0,
                validate_rms_before_um: elsewhere.base.validate_rms_um,
                validate_rms_after_um: t.judged.validate_rms_um,
                identify_rms_after_um: Some(t.judged.identify_rms_um),
                confusable_with: others,
                next_experiment: by_id(&id).map_or_else(String::new, |e| e.declaration().experiment),
                decision: if story {
                    Decision::ExplainsAlone { share }
                } else if beside {
                    Decision::NotToldApart
                } else {
                    Decision::AnotherLeavesLess
                },
                unlikely_because: unlikely(&t.judged.model, &id),
            }
        })
        .collect()
}

/// The converter, which the readings show and no residual does: the share is that of the noise.
fn rounding_figures(found: &Found, floor: &NoiseFloor) -> Option<CandidateFigures> {
    let (step_um, floor_um) = (floor.reading_step_um?, floor.rms_um?);
    let quantisation = found.quantised.and_then(by_id)?;
    let id = quantisation.declaration().id;
    let share = (rounding_noise(step_um) / floor_um).powi(2).min(1.0);
    Some(CandidateFigures {
        effect: id.clone(),
        in_place_of: Some(id),
        explained_share: share,
        explained_share_interval: (share, share),
        stability: 1.0,
        p_value: grid_by_chance(),
        p_value_alone: grid_by_chance(),
        validate_rms_before_um: found.first.validate_rms_um,
        validate_rms_after_um: found.last.validate_rms_um,
        identify_rms_after_um: Some(found.last.identify_rms_um),
        confusable_with: Vec::new(),
        next_experiment: quantisation.declaration().experiment,
        decision: Decision::ReadingsShowIt,
        unlikely_because: None,
    })
}

fn cells(judged: &Judged, dataset: &Dataset) -> Vec<RecordCells> {
    let range_v = (dataset.drive_min_v, dataset.drive_max_v);
    dataset
        .records
        .iter()
        .zip(&judged.residuals)
        .filter(|(_, residual)| !residual.is_empty())
        .map(|(record, residual)| {
            let mut full = vec![f64::NAN; record.drive_v.len()];
            record.counted().zip(residual).for_each(|(k, left)| full[k] = *left);
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
