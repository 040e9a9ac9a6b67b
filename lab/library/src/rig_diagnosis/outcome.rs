//! What a search in a rig comes to: verdict, findings and values.

use super::finder::{Added, RigPool, names};
use super::fit::RigFit;
use super::recordings::mean_square;
use crate::diagnosis::confidence_set::Fate;
use crate::diagnosis::verdict::{Facts, Reason, Verdict};
use crate::outcome::{Evidence, Finding, KeptModel, Remainder, Residuals};
use crate::stepping::Measured;
use hysteron_sim::rig_effects::RIG_EFFECTS;
use hysteron_sim::stick_slip::StickSlipActuator;
use serde::Serialize;

/// Name of the figures in files.
pub const SCHEMA: &str = "hysteron.rig_diagnosis/1";
/// A value is open where it differs from the start's by fewer standard deviations.
const VALUE_OPEN_Z: f64 = 2.0;

/// A value of an effect that was added.
#[derive(Clone, Debug, Serialize)]
pub struct RigValue {
    /// The effect.
    pub effect: &'static str,
    /// Its parameter.
    pub parameter: &'static str,
    /// The parameter's unit.
    pub unit: &'static str,
    /// Its value in the start.
    pub from: f64,
    /// Its value on these recordings.
    pub to: Measured,
}

/// An effect beside the simplest models.
#[derive(Clone, Debug, Serialize)]
pub struct RigCandidate {
    /// The effect.
    pub effect: &'static str,
    /// Its physics.
    pub sentence: &'static str,
    /// Errors of the start with this effect alone; none where the start is at the noise already.
    pub alone: Option<Residuals>,
    /// Its physics excludes the values that the fit takes alone.
    pub is_excluded: bool,
}

/// Errors of a reading.
#[derive(Clone, Debug, Serialize)]
pub struct ReadingErrors {
    /// The record.
    pub record: String,
    /// `slider` or `platform`.
    pub signal: &'static str,
    /// It only judges.
    pub held_out: bool,
    /// Noise of the sensor, um RMS.
    pub noise_um: Option<f64>,
    /// Error of the start, um RMS.
    pub before_um: f64,
    /// Error of the model at the end, um RMS.
    pub after_um: f64,
}

/// What a model of a rig misses.
#[derive(Clone, Debug, Serialize)]
pub struct RigDiagnosis {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// The data set.
    pub name: String,
    /// The word.
    pub verdict: Verdict,
    /// Why nothing, or not all, can be decided.
    pub reason: Option<Reason>,
    /// The same in a sentence.
    pub sentence: String,
    /// What is missing, one entry for each effect.
    pub findings: Vec<Finding>,
    /// What was ahead and is no name.
    pub so_far: Vec<String>,
    /// Values of the model at the end that differ from the start.
    pub values: Vec<RigValue>,
    /// Noise of the slider's sensor, um RMS.
    pub noise_floor_um: Option<f64>,
    /// Errors of the start.
    pub residual_rms_um: Residuals,
    /// Errors of the model at the end.
    pub residual_rms_after_um: Residuals,
    /// What that model leaves.
    pub remainder: Remainder,
    /// The simplest models that the data cannot reject, the best first.
    pub models: Vec<KeptModel>,
    /// Every reading.
    pub readings: Vec<ReadingErrors>,
    /// All effects.
    pub candidates: Vec<RigCandidate>,
    /// What was assumed.
    pub notes: Vec<String>,
    /// The rig with the values of the model at the end.
    #[serde(skip)]
    pub rig: StickSlipActuator,
}

/// The effects of the best model, each with those that do as well in its place, where all other simplest
/// models differ from it in one place; else none for what they do not share.
fn alternatives(simplest: &[Added]) -> Vec<(usize, Vec<usize>)> {
    let Some((best, others)) = simplest.split_first() else {
        return Vec::new();
    };
    let mut out: Vec<(usize, Vec<usize>)> = best.iter().map(|nth| (*nth, vec![*nth])).collect();
    for other in others {
        let gone: Vec<usize> = best
            .iter()
            .copied()
            .filter(|nth| !other.contains(nth))
            .collect();
        let come = other.iter().filter(|nth| !best.contains(nth));
        for (_, either) in out.iter_mut().filter(|(nth, _)| gone.contains(nth)) {
            if gone.len() == 1 {
                either.extend(come.clone());
            } else {
                either.clear();
            }
        }
    }
    out
}

/// The test of one finding: evidence, and whether the data reject doing without.
fn tested(pool: &RigPool, best: &Added, either: &[usize]) -> Option<(Evidence, bool)> {
    let without = pool.best_without(either, best.len())?;
    let fates = pool.fates(&[without, best]);
    let errors = |added: &Added| pool.data.errors(&pool.entries[added].residuals);
    let (rejected, standard_errors) = match fates[0] {
        Fate::Rejected(by) => (true, by),
        Fate::Kept => (false, 0.0),
    };
    let evidence = Evidence::Models {
        without: errors(without),
        with: errors(best),
        standard_errors,
    };
    Some((evidence, rejected))
}

/// The values of the effects of a model.
fn values(pool: &RigPool, best: &Added, fit: &RigFit) -> Vec<RigValue> {
    let measured = if best.is_empty() {
        Vec::new()
    } else {
        fit.values(&pool.entries[best].values)
    };
    (best.iter())
        .flat_map(|nth| {
            RIG_EFFECTS[*nth]
                .parameters
                .iter()
                .map(move |p| (RIG_EFFECTS[*nth].id, p))
        })
        .zip(measured)
        .map(|((effect, parameter), (_, to))| RigValue {
            effect,
            parameter: parameter.name,
            unit: parameter.unit,
            from: parameter.value(&pool.start.effects),
            to,
        })
        .collect()
}

/// Reads the outcome off a pool.
#[must_use]
pub fn report(pool: &RigPool, simplest: &[Added]) -> RigDiagnosis {
    let start = &pool.entries[&Vec::new()];
    let best = simplest.first().cloned().unwrap_or_default();
    let end = &pool.entries[&best];
    let fit = RigFit::new(pool.data, pool.start, &best).with_contact();
    let values = values(pool, &best, &fit);
    let is_open = |effect: usize| {
        let strength = values
            .iter()
            .find(|value| value.effect == RIG_EFFECTS[effect].id);
        strength.is_none_or(|v| (v.to.value - v.from).abs() <= VALUE_OPEN_Z * v.to.std)
    };
    let (mut findings, mut so_far) = (Vec::new(), Vec::new());
    let mut values_open = !best.is_empty();
    for (effect, either) in alternatives(simplest) {
        let test = tested(pool, &best, &either).filter(|(_, rejected)| *rejected);
        let few = (1..=pool.policy.alternatives_max).contains(&either.len());
        values_open &= is_open(effect);
        match test {
            Some((evidence, _)) if few && !is_open(effect) => findings.push(Finding {
                effects: names(&either),
                or_other_values_of: Vec::new(),
                evidence,
            }),
            _ => so_far.push(RIG_EFFECTS[effect].id.to_owned()),
        }
    }
    let facts = facts(pool, end, &findings, &so_far, values_open);
    if facts.names_nothing() {
        so_far = findings
            .drain(..)
            .flat_map(|finding| finding.effects)
            .chain(so_far)
            .collect();
    }
    let after = pool.data.errors(&end.residuals);
    let rms_um = after.validate.unwrap_or(after.identify);
    let noise_floor_um = pool
        .data
        .readings
        .first()
        .and_then(|reading| reading.noise_um);
    let times_noise = noise_floor_um.map(|um| rms_um / um);
    let mut this = RigDiagnosis {
        schema: SCHEMA,
        name: pool.data.name.clone(),
        verdict: facts.verdict(),
        reason: facts.reason(),
        sentence: String::new(),
        findings,
        so_far,
        values,
        noise_floor_um,
        residual_rms_um: pool.data.errors(&start.residuals),
        residual_rms_after_um: after,
        remainder: Remainder {
            rms_um,
            times_noise,
        },
        models: simplest.iter().map(|added| kept(pool, added)).collect(),
        readings: readings(pool, &best),
        candidates: candidates(pool),
        notes: pool.data.notes.clone(),
        rig: fit.rig(&end.values),
    };
    this.sentence = sentence(&this);
    this
}

fn facts(
    pool: &RigPool,
    end: &super::finder::Entry,
    findings: &[Finding],
    so_far: &[String],
    values_open: bool,
) -> Facts {
    let policy = pool.policy;
    let times: Vec<f64> = (0..pool.data.readings.len())
        .map(|r| end.losses.mean(r).sqrt())
        .collect();
    let noise_known = pool
        .data
        .readings
        .iter()
        .all(|reading| reading.noise_um.is_some());
    let within = |bound: f64| noise_known && times.iter().all(|times| *times < bound);
    let at_the_noise = pool.is_at_the_noise(end);
    Facts {
        stopped: pool.was_stopped(),
        out_of_time: pool.out_of_time,
        noise_known,
        below_the_noise: within(policy.contradiction),
        explained: within(policy.explained.max(pool.data.as_the_noise(policy))),
        at_the_noise,
        explained_by_names: at_the_noise && so_far.is_empty(),
        named: !findings.is_empty(),
        either_or: findings.iter().any(|finding| finding.effects.len() > 1),
        open: !so_far.is_empty(),
        values_open,
        ..Facts::default()
    }
}

fn kept(pool: &RigPool, added: &Added) -> KeptModel {
    KeptModel {
        effects: names(added),
        rms_um: pool.data.errors(&pool.entries[added].residuals),
    }
}

fn readings(pool: &RigPool, best: &Added) -> Vec<ReadingErrors> {
    let [before, after] = [&Vec::new(), best].map(|added| &pool.entries[added].residuals);
    let all = pool.data.readings.iter().enumerate();
    all.map(|(nth, reading)| ReadingErrors {
        record: reading.record.clone(),
        signal: if reading.is_platform {
            "platform"
        } else {
            "slider"
        },
        held_out: reading.held_out,
        noise_um: reading.noise_um,
        before_um: mean_square(&before[nth]).sqrt(),
        after_um: mean_square(&after[nth]).sqrt(),
    })
    .collect()
}

fn candidates(pool: &RigPool) -> Vec<RigCandidate> {
    let alone = |nth: usize| pool.entries.get(&vec![nth]);
    let all = RIG_EFFECTS.iter().enumerate();
    all.map(|(nth, effect)| RigCandidate {
        effect: effect.id,
        sentence: effect.sentence,
        alone: alone(nth).map(|entry| pool.data.errors(&entry.residuals)),
        is_excluded: alone(nth).is_some_and(|entry| entry.is_excluded),
    })
    .collect()
}

fn sentence(found: &RigDiagnosis) -> String {
    let nm = |um: f64| format!("{:.3} nm", 1e3 * um);
    let error = nm(found.remainder.rms_um);
    let noise = found.noise_floor_um.map_or_else(|| "unknown".into(), nm);
    let names: Vec<String> = (found.findings.iter())
        .map(|finding| finding.effects.join(" or ").replace('_', " "))
        .collect();
    let so_far = found.so_far.join(", ").replace('_', " ");
    let ahead = if so_far.is_empty() {
        String::new()
    } else {
        format!("; ahead: {so_far}")
    };
    let before = found.residual_rms_um;
    let before = nm(before.validate.unwrap_or(before.identify));
    let named = names.join("; ");
    match (found.verdict, found.reason) {
        (Verdict::AtFloor, _) => {
            format!("nothing is missing: the error of {error} is at the noise ({noise})")
        }
        (Verdict::Named | Verdict::Ambiguous, None) => {
            format!(
                "missing: {named}. The error falls from {before} to {error}; noise {noise}{ahead}"
            )
        }
        (Verdict::Named | Verdict::Ambiguous, Some(reason)) => {
            format!(
                "missing: {named}. The error falls from {before} to {error}; {}{ahead}",
                why(reason)
            )
        }
        (Verdict::Unexplained, _) => {
            format!("the error of {error} is above the noise ({noise}), and no effect explains it")
        }
        (Verdict::Undecidable, reason) => {
            let why = reason.map_or("nothing decides", why);
            format!("undecidable: {why}; error {error}{ahead}")
        }
    }
}

fn why(reason: Reason) -> &'static str {
    match reason {
        Reason::NoiseUnknown => "no rest of the drive shows the noise",
        Reason::BelowTheNoise => "the error is below the noise that the rests show",
        Reason::Stopped => "the search was stopped",
        Reason::OutOfTime => "the time was over before the search was",
        Reason::ValuesOpen => "the data fix no value of what lowers the error",
        Reason::ManyAlternatives => "more effects do as well than can be distinguished",
        _ => "the recording forbids an answer",
    }
}
