//! What the simplest kept models have in common, and where they differ, with the evidence for each: the best
//! model without it, for which a search of its own looked, beside the one with it.

use super::confidence_set::{Fate, Losses};
use super::judgement::Judged;
use super::policy::Policy;
use super::pool::{Entry, Move, Pool};
use super::screening::Screening;
use super::selection::confidence_set_in;
use super::study::Study;
use crate::error::Result;
use crate::identification::identifiability::CannotIdentify;
use crate::outcome::{Evidence, Finding, Residuals};
use crate::parallel;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{Doubt, by_id};
use std::collections::BTreeSet;

/// One thing that the simplest kept models have: the same move in all, or in each one of these.
#[derive(Clone, Debug, PartialEq)]
pub struct Slot {
    /// The moves, likeliest first.
    pub moves: Vec<Move>,
}

impl Slot {
    /// The effects that it says are missing.
    #[must_use]
    pub fn effects(&self) -> Vec<String> {
        self.of(|m| matches!(m, Move::Added(_)))
    }

    /// The effects of the prior model of which it says that values have changed.
    #[must_use]
    pub fn other_values_of(&self) -> Vec<String> {
        self.of(|m| matches!(m, Move::Freed(_)))
    }

    fn of(&self, kind: impl Fn(&Move) -> bool) -> Vec<String> {
        self.moves
            .iter()
            .filter(|m| kind(m))
            .map(|m| m.effect().to_owned())
            .collect()
    }
}

/// A slot with what was weighed for it.
#[derive(Clone)]
pub struct Weighed {
    /// What the models have.
    pub slot: Slot,
    /// The best model without any of it.
    pub without: Judged,
    /// Candidates on the residual of that model; none beside a prior model.
    pub screening: Option<Screening>,
    /// What speaks for it.
    pub evidence: Evidence,
}

impl Weighed {
    /// As a finding.
    #[must_use]
    pub fn finding(&self) -> Finding {
        Finding {
            effects: self.slot.effects(),
            or_other_values_of: self.slot.other_values_of(),
            evidence: self.evidence,
        }
    }

    /// It is one effect of which the data fix no value, so that it may as well be something else.
    #[must_use]
    pub fn has_open_values(&self, cannot_identify: &[CannotIdentify]) -> bool {
        let finding = self.finding();
        let [effect] = finding.effects.as_slice() else {
            return false;
        };
        let is_open = |what: &CannotIdentify| matches!(what, CannotIdentify::AnyOf { effect: id } if id == effect);
        finding.or_other_values_of.is_empty() && cannot_identify.iter().any(is_open)
    }

    /// It is one effect that its own physics excludes at its values in the model at the end: there it acts for
    /// something else.
    #[must_use]
    pub fn is_ruled_out_in(&self, model: &Model) -> bool {
        let [Move::Added(id)] = self.slot.moves.as_slice() else {
            return false;
        };
        model.ruled_out_because(id).is_some()
    }

    /// By how much the error falls with it, um: the root of the difference of the mean squares, the larger of
    /// fitted and held-out records.
    #[must_use]
    pub fn fall_um(&self) -> f64 {
        let Evidence::Models { without, with, .. } = self.evidence else {
            return 0.0;
        };
        let fall = |before_um: f64, after_um: f64| {
            (before_um * before_um - after_um * after_um)
                .max(0.0)
                .sqrt()
        };
        let held_out = without
            .validate
            .zip(with.validate)
            .map_or(0.0, |(before_um, after_um)| fall(before_um, after_um));
        held_out.max(if without.validate.is_none() {
            fall(without.identify, with.identify)
        } else {
            0.0
        })
    }
}

/// What the simplest kept models, best first, have in common and where they differ.
#[must_use]
pub fn slots(minimal: &[&Entry]) -> Vec<Slot> {
    let Some((best, others)) = minimal.split_first() else {
        return Vec::new();
    };
    let mut out: Vec<Slot> = best
        .moves
        .iter()
        .map(|m| Slot {
            moves: vec![m.clone()],
        })
        .collect();
    for other in others {
        let place = |m: &Move, entry: &Entry| {
            entry
                .judged
                .model
                .effect(m.effect())
                .map(|e| e.effect.declaration().place)
        };
        let mut missing: Vec<usize> = (0..best.moves.len())
            .filter(|i| !other.moves.contains(&best.moves[*i]))
            .collect();
        let mut instead: Vec<&Move> = other
            .moves
            .iter()
            .filter(|m| !best.moves.contains(m))
            .collect();
        // Of several that differ, those that stand in the same order along the chain take each other's place.
        missing.sort_by_key(|i| place(&best.moves[*i], best));
        instead.sort_by_key(|m| place(m, other));
        for (i, by) in missing.into_iter().zip(instead) {
            if !out[i].moves.contains(by) {
                out[i].moves.push(by.clone());
            }
        }
    }
    out
}

/// What the physics of an effect says against its values in a model.
#[must_use]
pub fn unlikely(model: &Model, id: &str) -> Option<String> {
    let (Doubt::RuledOut(because) | Doubt::Unlikely(because)) = model.doubt(id)?;
    Some(because)
}

/// How far models are fitted before a test compares them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fits {
    /// As far as a search compares them.
    ForComparison,
    /// To their end: a good held-out error half way is chance.
    ToTheEnd,
}

impl Fits {
    /// Fits a model of a pool so far; whether it was there before.
    fn bring(self, pool: &mut Pool, key: &str) -> bool {
        let entry = &pool.entries[key];
        match self {
            Self::ToTheEnd if !entry.finished && !pool.study.budget.is_over() => pool.finish(key),
            _ if !entry.compared => pool.compare(&[key.to_owned()]),
            _ => return true,
        }
        false
    }
}

/// A slot that survives its test.
pub struct Tested {
    /// What is missing: one of these.
    pub slot: Slot,
    /// The key of the best model without any of it.
    without: String,
    /// By how many standard errors the data reject that model.
    standard_errors: f64,
    /// The keys of the models that do as well with an alternative.
    as_good: Vec<String>,
}

impl Tested {
    /// The merit of the best model without any of the slot.
    #[must_use]
    pub fn merit_without(&self, pool: &Pool) -> f64 {
        pool.entries[&self.without].merit
    }
}

/// Tests each slot of the simplest kept models. Put in the place of a slot's own effect in the best of them,
/// everything else the same, another effect is an alternative if the data do not reject the model that comes
/// of it. The slot is tested again without all its alternatives. Where a model without the slot is not
/// rejected and no single exchange explains it, nothing says which effect stands in for which: the slot is
/// left out.
#[must_use]
pub fn test_slots(pool: &mut Pool, minimal: &[String], fits: Fits) -> Vec<Tested> {
    let Some(best) = minimal.first() else {
        return Vec::new();
    };
    fits.bring(pool, best);
    let entries: Vec<&Entry> = minimal.iter().map(|k| &pool.entries[k]).collect();
    let each = slots(&entries).into_iter().zip(entries[0].moves.clone());
    let tested: Vec<Option<Tested>> = each
        .map(|(slot, own)| test(pool, slot, &own, best, fits))
        .collect();
    let ordered = |mut case: Tested| {
        case.slot.moves = likeliest_first(pool, &case, minimal);
        case
    };
    tested.into_iter().flatten().map(ordered).collect()
}

/// Tests a slot; `own` is its move in the best model.
fn test(pool: &mut Pool, mut slot: Slot, own: &Move, best: &str, fits: Fits) -> Option<Tested> {
    let mut as_good = Vec::new();
    loop {
        let without = best_without(pool, &slot, best, fits)?;
        if let Some(standard_errors) = rejected_by(pool, &without, best) {
            return Some(Tested {
                slot,
                without,
                standard_errors,
                as_good,
            });
        }
        let mut instead = pool.entries[&without].moves.clone();
        instead.retain(|m| !pool.entries[best].moves.contains(m));
        let before = as_good.len();
        for by in instead {
            let exchanged = exchange(pool, [best, &without], own, &by);
            if let Some(key) = &exchanged {
                fits.bring(pool, key);
            }
            // What denies a name takes its place: both are asked the same.
            let exchanged = exchanged.filter(|key| rejected_by(pool, key, best).is_none());
            slot.moves.extend(exchanged.is_some().then_some(by));
            as_good.extend(exchanged);
        }
        if as_good.len() == before {
            return None;
        }
    }
}

/// The key of the model with one move in the place of another, everything else the same, fitted as far as it
/// can be compared; where the pool lacks it, it begins at the values of another model that has this move.
fn exchange(pool: &mut Pool, [of, from]: [&str; 2], own: &Move, by: &Move) -> Option<String> {
    let (study, entry) = (pool.study, pool.entries[of].clone());
    let others = entry.moves.iter().filter(|m| *m != own).cloned();
    let mut moves: Vec<Move> = others.chain([by.clone()]).collect();
    moves.sort();
    let has_these = |(_, e): &(&String, &Entry)| e.moves == moves && !e.is_excluded();
    let known = pool
        .ranked()
        .into_iter()
        .find(has_these)
        .map(|(k, _)| k.clone());
    let key = match known {
        Some(key) => key,
        None if entry.held => return None,
        None => {
            let mut begin = study.without(&entry.judged.model, own.effect());
            begin.add(pool.entries[from].judged.model.effect(by.effect())?.clone());
            // What modifies the effect that leaves goes with it.
            if moves.iter().any(|m| begin.effect(m.effect()).is_none()) {
                return None;
            }
            let judged = study.for_comparison(&study.quickly(&begin).model);
            let exchanged = Entry::new(study, moves, judged, true);
            let key = super::pool::key(&exchanged.moves, &exchanged.judged.model);
            pool.keep(exchanged);
            key
        }
    };
    pool.compare(std::slice::from_ref(&key));
    pool.weigh(std::slice::from_ref(&key));
    let is_fitted = pool.entries.get(&key).is_some_and(|e| !e.is_excluded());
    is_fitted.then_some(key)
}

/// Ranks that differ by less are those of one error: a part in a thousand is left by fits, not by data.
const ALIKE: f64 = 1e-3;

/// The moves of a slot by what the physics says against them, then by the models that have them. Those that do
/// alike follow the chain, from the drive to the sensor.
fn likeliest_first(pool: &Pool, case: &Tested, minimal: &[String]) -> Vec<Move> {
    let models = minimal
        .iter()
        .chain(&case.as_good)
        .map(|k| &pool.entries[k]);
    let mut models: Vec<&Entry> = models.collect();
    models.sort_by(|a, b| pool.rank(a).total_cmp(&pool.rank(b)));
    let with = |m: &Move| models.iter().find(|e| e.moves.contains(m));
    let speaks_against = |m: &Move| {
        let model = with(m).map(|entry| &entry.judged.model);
        matches!(m, Move::Added(id) if model.is_some_and(|model| unlikely(model, id).is_some()))
    };
    let rank = |m: &Move| with(m).map_or(f64::INFINITY, |e| (pool.rank(e) / ALIKE).round());
    let place = |m: &Move| by_id(m.effect()).map(|effect| effect.declaration().place);
    let mut out = case.slot.moves.clone();
    out.sort_by(|a, b| {
        let ordered = speaks_against(a).cmp(&speaks_against(b));
        let ordered = ordered.then_with(|| rank(a).total_cmp(&rank(b)));
        ordered.then_with(|| place(a).cmp(&place(b)))
    });
    out
}

/// The best model of a pool that has nothing of a slot and no more moves than another: two effects in the
/// place of one do not deny it. It is fitted as far as it can be compared.
fn best_without(pool: &mut Pool, slot: &Slot, with: &str, fits: Fits) -> Option<String> {
    let size = pool.entries[with].moves.len();
    let lacks = |e: &Entry| slot.moves.iter().all(|m| !e.moves.contains(m));
    loop {
        let mut ranked = pool.ranked().into_iter();
        let best = ranked.find(|(_, e)| !e.is_excluded() && e.moves.len() <= size && lacks(e));
        let key = best?.0.clone();
        if fits.bring(pool, &key) {
            pool.weigh(&[key.clone(), with.to_owned()]);
            return Some(key);
        }
    }
}

/// By how many standard errors the data reject a model of a pool beside another; none where they do not, or
/// where it is better on the fitted or on the held-out records alone. Where fitted records leave values open,
/// held-out errors are chance: there it must be rejected as well once both are fitted to all records.
fn rejected_by(pool: &mut Pool, without: &str, with: &str) -> Option<f64> {
    let (study, pair) = (pool.study, [without, with]);
    let fate = |losses: [Option<&Losses>; 2]| {
        let [of_one, of_other] = losses;
        Some(confidence_set_in(study, &[of_one?, of_other?])[0])
    };
    let losses = pair.map(|key| pool.entries[key].losses.as_ref());
    let Some(Fate::Rejected(standard_errors)) = fate(losses) else {
        return None;
    };
    let errors = pair.map(|key| Residuals::of(&pool.entries[key].judged));
    if is_better_somewhere(errors, study.policy.matters_at_noise) {
        return None;
    }
    if study.leaves_values_open(&pool.entries[with].judged) {
        pool.weigh_fitted_to_all(&pair.map(str::to_owned));
        let losses = pair.map(|key| pool.entries[key].losses_fitted_to_all.as_ref());
        fate(losses).filter(|fate| *fate != Fate::Kept)?;
    }
    Some(standard_errors)
}

/// Weighs each slot of the simplest kept models that survives its test; the models that do as well with an
/// alternative join these.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn weigh(pool: &mut Pool, minimal: &mut Vec<String>) -> Result<Vec<Weighed>> {
    let cases = test_slots(pool, minimal, Fits::ToTheEnd);
    let study = pool.study;
    let weighed = parallel::map(&cases, |case| {
        let [without, with] = [&case.without, &minimal[0]].map(|key| &pool.entries[key]);
        with_evidence(study, case, [without, with])
    });
    let mut weighed: Vec<Weighed> = weighed.into_iter().collect::<Result<_>>()?;
    weighed.sort_by(|a, b| study.merit(&b.without).total_cmp(&study.merit(&a.without)));
    for key in cases.into_iter().flat_map(|case| case.as_good) {
        if !minimal.contains(&key) {
            minimal.push(key);
        }
    }
    Ok(weighed)
}

/// What is a name of what was weighed, and what stays open: what no search tried to do without, and what could
/// be more effects than say something. `ablated` holds what searches did without; none where all was tried in
/// the place of all.
#[must_use]
pub fn names_and_open(
    weighed: Vec<Weighed>,
    ablated: Option<&BTreeSet<Vec<String>>>,
    policy: &Policy,
) -> [Vec<Weighed>; 2] {
    let is_name = |w: &Weighed| {
        let effects = w.slot.effects();
        let did_without = |ids: &Vec<String>| ids.iter().all(|id| effects.contains(id));
        w.slot.moves.len() <= policy.alternatives_max
            && (effects.is_empty() || ablated.is_none_or(|each| each.iter().any(did_without)))
    };
    let (names, open) = weighed.into_iter().partition(is_name);
    [names, open]
}

fn with_evidence(study: &Study, case: &Tested, [without, with]: [&Entry; 2]) -> Result<Weighed> {
    let slot = case.slot.clone();
    let mut screening = None;
    if let Some(Move::Added(_)) = slot.moves.first().filter(|_| !with.held) {
        let model = &without.judged.model;
        let candidates = study.candidates_for(model);
        screening = Some(study.weigh(model, &candidates, study.policy.seed)?);
    }
    Ok(Weighed {
        slot,
        without: without.judged.clone(),
        screening,
        evidence: Evidence::Models {
            without: Residuals::of(&without.judged),
            with: Residuals::of(&with.judged),
            standard_errors: case.standard_errors,
        },
    })
}

/// Whether the first of two models is better on the fitted or on the held-out records alone, by more than a
/// share of the mean square.
fn is_better_somewhere([one, other]: [Residuals; 2], share: f64) -> bool {
    let better = |one: f64, other: f64| one * one * (1.0 + share) < other * other;
    let held_out = one.validate.zip(other.validate);
    better(one.identify, other.identify) || held_out.is_some_and(|(a, b)| better(a, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, Record, Role};
    use crate::diagnosis::pool::{added, key};
    use crate::identification::noise_floor::noise_floor;
    use crate::model_file::effects_named;
    use crate::watch::Unwatched;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::noise::WhiteNoise;

    /// A linear stage behind a lag of 40 Hz, which may be the amplifier's or the sensor's.
    fn lagging(name: &str, role: Role, hz: f64) -> Record {
        let drive_v: Vec<f64> = (0..3000_usize)
            .map(|k| 50.0 * (1.0 - (hz * 0.006 * k.saturating_sub(600) as f64).cos()))
            .collect();
        let (mut noise, mut lagged_um) = (WhiteNoise::new(0.002, 5), 0.0);
        let read_um = drive_v.iter().map(|v| {
            let read_um = lagged_um + noise.next_um();
            lagged_um += (0.09 * v - lagged_um) * 0.2;
            read_um
        });
        let read_um = read_um.collect();
        Record::new(name, 1000.0, drive_v, read_um).with_role(role)
    }

    #[test]
    fn what_does_as_well_in_the_place_of_an_effect_is_an_or() {
        let records = [
            lagging("fitted", Role::Identify, 1.0),
            lagging("judging", Role::Validate, 0.7),
        ];
        let dataset = Dataset::new("d", 0.0, 100.0, records.to_vec()).unwrap();
        let (floor, policy) = (noise_floor(&dataset), Policy::default());
        let study = Study::new(&dataset, Vec::new(), &floor, policy, &Unwatched);
        let with = |names: &str| {
            let mut model = Model::new(0.0, 100.0);
            for effect in effects_named(&format!("gain,{names}")).unwrap() {
                model.add(EffectInstance::new(effect, &dataset.overview(), &[]));
            }
            let ids: Vec<String> = names.split(',').map(str::to_owned).collect();
            Entry::new(&study, added(&ids), study.thoroughly(&model), true)
        };
        let mut gain = Model::new(0.0, 100.0);
        gain.add(EffectInstance::new(
            effects_named("gain").unwrap().remove(0),
            &dataset.overview(),
            &[],
        ));
        let mut pool = Pool::of(&study, &gain);
        let best = with("sensor_bandwidth,creep");
        let keys = [key(&best.moves, &best.judged.model)];
        let found = |pool: &mut Pool| -> Vec<Vec<String>> {
            let tested = test_slots(pool, &keys, Fits::ToTheEnd).into_iter();
            // Lags in front of a stage without loops and behind it do exactly as well.
            let sorted = |case: Tested| {
                let mut effects = case.slot.effects();
                effects.sort();
                effects
            };
            tested.map(sorted).collect()
        };
        pool.keep(best);
        pool.keep(with("sensor_bandwidth"));
        assert_eq!(found(&mut pool), [["sensor_bandwidth"]]);
        pool.keep(with("amplifier_bandwidth"));
        assert_eq!(
            found(&mut pool),
            [["amplifier_bandwidth", "sensor_bandwidth"]]
        );
        // A name is what a search tried to do without, and one of few.
        let names = |pool: &mut Pool, ablated: &[&str], most: usize| {
            let weighed = weigh(pool, &mut keys.to_vec()).unwrap();
            let ablated = ablated.iter().map(|id| vec![(*id).to_owned()]).collect();
            let policy = Policy {
                alternatives_max: most,
                ..Policy::default()
            };
            names_and_open(weighed, Some(&ablated), &policy).map(|each| each.len())
        };
        assert_eq!(names(&mut pool, &["sensor_bandwidth"], 2), [1, 0]);
        assert_eq!(names(&mut pool, &["sensor_bandwidth"], 1), [0, 1]);
        assert_eq!(names(&mut pool, &["creep"], 2), [0, 1]);
    }

    /// A stage whose gain a drive of 1 V does not fix, disturbed by 35 nm that no model has.
    #[test]
    fn held_out_errors_of_open_values_are_chance() {
        let record = |name: &str, role: Role, half_v: f64| {
            let rest = |k: usize| k.saturating_sub(600) as f64;
            let drive_v: Vec<f64> = (0..3000)
                .map(|k| half_v * (1.0 - (0.006 * rest(k)).cos()))
                .collect();
            let mut noise = WhiteNoise::new(0.002, 5);
            let read_um = (0..3000_usize).map(|k| {
                let disturbs_um = 0.05 * (0.31 * rest(k)).sin();
                0.09 * drive_v[k.saturating_sub(1)] + disturbs_um + noise.next_um()
            });
            let read_um = read_um.collect();
            Record::new(name, 1000.0, drive_v, read_um).with_role(role)
        };
        let records = [
            record("fitted", Role::Identify, 0.5),
            record("judging", Role::Validate, 50.0),
        ];
        let dataset = Dataset::new("d", 0.0, 100.0, records.to_vec()).unwrap();
        let (floor, policy) = (noise_floor(&dataset), Policy::default());
        let study = Study::new(&dataset, Vec::new(), &floor, policy, &Unwatched);
        let gain = |gain_um_v: f64| {
            let effect = effects_named("gain").unwrap().remove(0);
            let mut model = Model::new(0.0, 100.0);
            model.add(EffectInstance::new(
                effect,
                &dataset.overview(),
                &[gain_um_v],
            ));
            model
        };
        let mut pool = Pool::of(&study, &gain(0.12));
        let mut kept = |label: &str, gain_um_v: f64| {
            let moves = added(&[label.to_owned()]);
            let entry = Entry::new(&study, moves, study.judged_quickly(gain(gain_um_v)), true);
            let key = key(&entry.moves, &entry.judged.model);
            pool.keep(entry);
            pool.weigh(std::slice::from_ref(&key));
            key
        };
        let without = kept("delay", 0.12);
        let [lucky, met] = [kept("creep", 0.095), kept("friction", 0.09)];
        // Both are the same once they are fitted to all records.
        assert!(study.leaves_values_open(&pool.entries[&lucky].judged));
        assert_eq!(rejected_by(&mut pool, &without, &lucky), None);
        assert!(!study.leaves_values_open(&pool.entries[&met].judged));
        assert!(rejected_by(&mut pool, &without, &met).is_some());
    }

    #[test]
    fn an_effect_that_one_side_does_better_without_is_not_named() {
        let errors = |identify: f64, held_out: f64| Residuals {
            identify,
            validate: Some(held_out),
        };
        let denied = |without, with| is_better_somewhere([without, with], 0.04);
        assert!(denied(errors(29.0, 443.0), errors(76.6, 437.0)));
        assert!(denied(errors(39.0, 58.0), errors(11.0, 71.0)));
        assert!(!denied(errors(200.0, 210.0), errors(6.0, 6.1)));
        assert!(!denied(errors(2.0, 210.0), errors(2.01, 6.1)));
    }
}
