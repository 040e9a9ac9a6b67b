//! The typed outcome of what a run found (`hysteron.diagnosis/1`).

use super::findings::{Weighed, unlikely};
use super::judgement::Judged;
use super::pool::Entry;
use super::residual_map::{drive_features, residual_by_feature};
use super::screening::{CandidateScore, Screening};
use super::study::Study;
use super::verdict::Facts;
use super::verdict::Reason;
use super::words;
use crate::dataset::Dataset;
use crate::dataset::drive_variety::DriveVariety;
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::reading_grid::{grid_by_chance, rounding_noise};
use crate::identification::noise_floor::NoiseFloor;
use crate::outcome::{
    CandidateFigures, Cell, ChangedValue, Diagnosis, Evidence, Finding, KeptModel, RecordCells,
    Remainder, Residuals, Standing, Verdict,
};
use hysteron_sim::effect::by_id;
use std::collections::BTreeSet;

/// What a diagnosis is put together from.
pub struct Found<'a> {
    /// The model that was started from.
    pub first: &'a Judged,
    /// The model at the end.
    pub last: &'a Judged,
    /// The model that has the named effects and nothing else.
    pub named: &'a Judged,
    /// What the simplest kept models have.
    pub weighed: &'a [Weighed],
    /// What survives its test and is no name.
    pub open: &'a [Weighed],
    /// All of that is no name because the data fix none of its values.
    pub values_open: bool,
    /// The simplest kept models.
    pub models: &'a [KeptModel],
    /// The same as they are in the pool.
    pub simplest: &'a [Entry],
    /// Values that have changed.
    pub changed: &'a [ChangedValue],
    /// What was tried alone beside a prior model.
    pub tried: &'a [Entry],
    /// Candidates beside the start, where nothing is in all simplest models.
    pub beside_start: Option<&'a Screening>,
    /// The effect that the readings themselves show: they are whole steps of a converter.
    pub quantised: Option<&'a str>,
    /// How other loops than those at the start are described.
    pub loops: &'a [String],
    /// What is wrong with the recording.
    pub issues: Vec<Issue>,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// The search ended when its time was over.
    pub out_of_time: bool,
    /// Two effects that no drive distinguishes, and by how much they differ on the best, um.
    pub in_vain: Option<(&'a [String; 2], f64)>,
}

/// Puts what was found into one of the five words.
#[must_use]
pub fn diagnosis(mut found: Found, floor: &NoiseFloor, study: &Study) -> Diagnosis {
    let (policy, dataset) = (&study.policy, study.dataset);
    // Where only a lower bound of the noise is known, a model that leaves no more than that leaves nothing.
    let bound = vec![floor.at_least_um; dataset.records.len()];
    let at_the_bound =
        floor.rms_um.is_none() && found.last.within(policy.explained, &bound, &study.split);
    let floors_um = if at_the_bound {
        &bound
    } else {
        &floor.of_records_um
    };
    let within = |times: f64| found.last.within(times, floors_um, &study.split);
    // What rounding makes of readings at rest, on one code or between two, may be more than what it leaves of
    // readings that move.
    let is_rounding = floor
        .reading_step_um
        .zip(floor.rms_um)
        .is_some_and(|(step_um, rms_um)| rms_um < policy.mostly_rounding * rounding_noise(step_um));
    let below = !at_the_bound
        && !is_rounding
        && within(
            policy
                .contradiction
                .min(1.0 - policy.floor_z * floor.relative_std())
                .max(0.0),
        );
    // A finding stands beside an issue that blocks where it lowers the error by more than what the issue
    // suggests.
    let blocked = found.issues.iter().find_map(reason_beside);
    let blocks = found
        .issues
        .iter()
        .filter(|i| i.severity == Severity::Blocks);
    let least_fall_um = blocks
        .map(|i| i.effect_um().unwrap_or(f64::INFINITY))
        .fold(0.0, f64::max);
    let stands = |w: &&Weighed| blocked.is_none() || w.fall_um() > least_fall_um;
    let mut findings: Vec<Finding> = found
        .weighed
        .iter()
        .filter(stands)
        .map(Weighed::finding)
        .collect();
    if let Some(id) = found.quantised.filter(|_| blocked.is_none()) {
        findings.push(Finding {
            effects: vec![id.into()],
            or_other_values_of: Vec::new(),
            evidence: Evidence::Readings,
        });
    }
    let is_excluded = |id: &str| {
        found.first.model.effect(id).is_none() && found.last.model.ruled_out_because(id).is_some()
    };
    let facts = Facts {
        blocked,
        stopped: found.stopped,
        out_of_time: found.out_of_time,
        noise_known: floor.rms_um.is_some() || at_the_bound,
        below_the_noise: below,
        explained: within(policy.explained),
        at_the_noise: within(study.as_the_noise()),
        explained_by_names: found
            .named
            .within(policy.explained, floors_um, &study.split),
        excluded: found.last.model.effects.iter().any(|e| is_excluded(&e.id)),
        named: !findings.is_empty(),
        either_or: findings
            .iter()
            .any(|f| f.effects.len() + f.or_other_values_of.len() > 1),
        other_values_only: findings.iter().all(|f| f.effects.is_empty()),
        open: !found.open.is_empty(),
        values_open: found.values_open,
        one_motion: DriveVariety::of(dataset, &study.split.both()).one_motion(),
    };
    let (verdict, reason, no_names) = (facts.verdict(), facts.reason(), facts.names_nothing());
    let open: Vec<Finding> = found.open.iter().map(Weighed::finding).collect();
    let new = |judged: &Judged| {
        let mut ids = judged.model.effect_ids();
        ids.retain(|id| {
            found.first.model.effect(id).is_none() && Some(id.as_str()) != found.quantised
        });
        ids
    };
    // What was not searched to its end is ahead as a whole, the alternatives to it unweighed.
    let so_far: Vec<String> = if no_names
        && (found.stopped || found.out_of_time || findings.is_empty() && open.is_empty())
    {
        new(found.last)
    } else {
        let names = findings.iter().filter(|_| no_names).chain(&open);
        let all = |f: &Finding| [&f.effects[..], &f.or_other_values_of].concat();
        let mut seen = BTreeSet::new();
        let ids = names.flat_map(all);
        ids.filter(|id| seen.insert(id.clone())).collect()
    };
    if no_names {
        findings.clear();
    }
    let named: Vec<String> = if verdict == Verdict::AtFloor {
        Vec::new()
    } else {
        findings.iter().flat_map(about).cloned().collect()
    };
    // What describes the loops of the named more finely belongs to them.
    let mut also_in_the_model = new(found.last);
    let describes = |id: &String| {
        found.named.model.effect(id).is_some()
            && by_id(id).is_some_and(|e| !e.declaration().candidate)
    };
    also_in_the_model
        .retain(|id| !no_names && !named.contains(id) && !so_far.contains(id) && !describes(id));
    let rms_um = found.last.error_um();
    let issues = std::mem::take(&mut found.issues);
    let mut out = Diagnosis {
        schema: "hysteron.diagnosis/1",
        verdict,
        reason,
        sentence: String::new(),
        named,
        so_far,
        also_in_the_model,
        findings,
        remainder: Remainder {
            rms_um,
            times_noise: floor.rms_um.map(|floor_um| rms_um / floor_um),
        },
        changed: found.changed.to_vec(),
        issues,
        models: found.models.to_vec(),
        loops: found.loops.to_vec(),
        noise_floor_um: floor.rms_um,
        floor_basis: floor.basis.clone(),
        floor_estimates: floor.estimates.clone(),
        residual_rms_um: Residuals::of(found.first),
        residual_rms_named_um: Residuals::of(found.named),
        residual_rms_after_um: Residuals::of(found.last),
        candidates: candidate_figures(&found, floor, study),
        where_it_fails: cells(found.first, dataset),
    };
    if let Some((between, separation_um)) = found.in_vain {
        for (at, id) in between.iter().enumerate() {
            let none = words::no_drive_decides(&between[1 - at], separation_um);
            out.candidates
                .iter_mut()
                .filter(|c| c.effect == *id)
                .for_each(|c| c.next_experiment.clone_from(&none));
        }
    }
    out.sentence = words::sentence(&out, [found.first, found.named], dataset, study);
    out
}

/// The reason for which nothing can be decided beside an issue.
fn reason_beside(issue: &Issue) -> Option<Reason> {
    let reason = match issue.kind {
        IssueKind::NotAnswered { .. } | IssueKind::NothingInCommon { .. } => Reason::NotAnswered,
        IssueKind::InitialState { .. } => Reason::InitialState,
        IssueKind::SameSampleTiming { .. } => Reason::SameSampleTiming,
        IssueKind::RunsOnBetweenSamples { .. } => Reason::RunsOnBetweenSamples,
        _ => return None,
    };
    (issue.severity == Severity::Blocks).then_some(reason)
}

/// The effects that a finding is about: those that are missing, or else those that have other values.
fn about(finding: &Finding) -> &[String] {
    if finding.effects.is_empty() {
        &finding.or_other_values_of
    } else {
        &finding.effects
    }
}

fn candidate_figures(found: &Found, floor: &NoiseFloor, study: &Study) -> Vec<CandidateFigures> {
    let mut out: Vec<CandidateFigures> = Vec::new();
    for weighed in found.weighed {
        if let Some(screening) = &weighed.screening {
            out.extend(
                screening
                    .scores
                    .iter()
                    .map(|score| of_a_slot(score, screening, weighed, found, study)),
            );
        }
    }
    out.extend(
        found
            .tried
            .iter()
            .filter_map(|entry| of_a_trial(entry, found)),
    );
    if let Some(screening) = found.beside_start.filter(|_| out.is_empty()) {
        let before = found.first.validate_rms_um;
        out.extend(
            screening
                .scores
                .iter()
                .map(|score| plain(score, screening, before, None, study)),
        );
    }
    out.extend(of_the_readings(found, floor));
    // What is named first, then what else was examined, by what it explains; each once.
    let place = |c: &CandidateFigures| match c.standing {
        Standing::Named => 0,
        Standing::Alternative => 1,
        Standing::InTheReadings => 2,
        _ => 3,
    };
    out.sort_by(|a, b| {
        place(a)
            .cmp(&place(b))
            .then(b.explained_share.total_cmp(&a.explained_share))
            .then_with(|| a.effect.cmp(&b.effect))
    });
    let mut seen: Vec<String> = Vec::new();
    out.retain(|c| {
        let new = !seen.contains(&c.effect);
        seen.push(c.effect.clone());
        new
    });
    out
}

fn plain(
    score: &CandidateScore,
    screening: &Screening,
    before_um: Option<f64>,
    in_place_of: Option<String>,
    study: &Study,
) -> CandidateFigures {
    let evidence = score.evidence.as_ref();
    let p_value = evidence.map(|e| e.p_adjusted);
    let alike = screening
        .scores
        .iter()
        .filter(|o| o.id != score.id && screening.similarity(o, score) > study.policy.alike);
    CandidateFigures {
        effect: score.id.clone(),
        in_place_of,
        explained_share: score.share,
        explained_share_interval: evidence.map_or((0.0, 1.0), |e| e.share_interval),
        stability: evidence.map_or(0.0, |e| e.stability),
        p_value,
        validate_rms_before_um: before_um,
        validate_rms_after_um: None,
        identify_rms_after_um: None,
        confusable_with: alike.map(|o| o.id.clone()).collect(),
        next_experiment: score.effect.declaration().experiment,
        standing: if p_value.is_some_and(|p| p > study.policy.family_wise) {
            Standing::NotInTheResidual
        } else {
            Standing::NotFitted
        },
        unlikely_because: None,
    }
}

/// A candidate in the place of what the simplest kept models have.
fn of_a_slot(
    score: &CandidateScore,
    screening: &Screening,
    weighed: &Weighed,
    found: &Found,
    study: &Study,
) -> CandidateFigures {
    let effects = weighed.slot.effects();
    let mut out = plain(
        score,
        screening,
        weighed.without.validate_rms_um,
        effects.first().cloned(),
        study,
    );
    if let Some(entry) = found
        .simplest
        .iter()
        .find(|e| effects.contains(&score.id) && e.added().contains(&score.id))
    {
        out.standing = if effects.len() > 1 {
            Standing::Alternative
        } else {
            Standing::Named
        };
        out.validate_rms_after_um = entry.judged.validate_rms_um;
        out.identify_rms_after_um = Some(entry.judged.identify_rms_um);
        out.p_value = None;
        out.unlikely_because = unlikely(&entry.judged.model, &score.id);
        out.confusable_with
            .extend(effects.iter().filter(|id| **id != score.id).cloned());
        out.confusable_with.sort();
        out.confusable_with.dedup();
    } else if found.last.model.effect(&score.id).is_some()
        && found.first.model.effect(&score.id).is_none()
    {
        out.unlikely_because = unlikely(&found.last.model, &score.id);
        let excluded = found.last.model.ruled_out_because(&score.id).is_some();
        out.standing = if excluded {
            Standing::Excluded
        } else {
            Standing::LowersErrors
        };
    }
    out
}

/// What was tried alone beside a prior model.
fn of_a_trial(entry: &Entry, found: &Found) -> Option<CandidateFigures> {
    let id = entry.added().first()?.clone();
    let square = |j: &Judged| j.identify_rms_um * j.identify_rms_um;
    let removable = (square(found.first) - square(found.last)).max(f64::MIN_POSITIVE);
    let share = ((square(found.first) - square(&entry.judged)) / removable).clamp(0.0, 1.0);
    let slot: Vec<String> = found
        .weighed
        .iter()
        .map(|w| w.slot.effects())
        .find(|effects| effects.contains(&id))
        .unwrap_or_default();
    Some(CandidateFigures {
        effect: id.clone(),
        in_place_of: Some(slot.first().unwrap_or(&id).clone()),
        explained_share: share,
        explained_share_interval: (share, share),
        stability: 0.0,
        p_value: None,
        validate_rms_before_um: found.first.validate_rms_um,
        validate_rms_after_um: entry.judged.validate_rms_um,
        identify_rms_after_um: Some(entry.judged.identify_rms_um),
        confusable_with: slot.iter().filter(|other| **other != id).cloned().collect(),
        next_experiment: by_id(&id).map_or_else(String::new, |e| e.declaration().experiment),
        standing: match slot.len() {
            0 if entry.is_excluded() => Standing::Excluded,
            0 => Standing::Rejected,
            1 => Standing::Named,
            _ => Standing::Alternative,
        },
        unlikely_because: unlikely(&entry.judged.model, &id),
    })
}

/// The converter, which the readings show and no residual does: the share is that of the noise.
fn of_the_readings(found: &Found, floor: &NoiseFloor) -> Option<CandidateFigures> {
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
        p_value: Some(grid_by_chance()),
        validate_rms_before_um: found.first.validate_rms_um,
        validate_rms_after_um: found.last.validate_rms_um,
        identify_rms_after_um: Some(found.last.identify_rms_um),
        confusable_with: Vec::new(),
        next_experiment: quantisation.declaration().experiment,
        standing: Standing::InTheReadings,
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
            record
                .counted()
                .zip(residual)
                .for_each(|(k, left)| full[k] = *left);
            let found = residual_by_feature(
                &record.drive_v,
                &full,
                record.sample_rate_hz,
                record.window.clone(),
                range_v,
            );
            let cells = drive_features(range_v.0, range_v.1)
                .into_iter()
                .zip(found)
                .filter_map(|(feature, cell)| {
                    cell.map(|c| Cell {
                        feature: format!("{} {}", feature.group, feature.label),
                        rms_um: c.rms,
                        samples: c.samples,
                    })
                })
                .collect();
            RecordCells {
                record: record.name.clone(),
                cells,
            }
        })
        .collect()
}
