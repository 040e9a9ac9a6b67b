//! A prior model on other data: which of its values have changed, and what it lacks here.
//!
//! All its values are held, and moves are tried beside it: an effect added, the values of one effect freed,
//! the whole displacement scaled. A new fit of everything frees all effects at once, which is as many moves.
//! So the simplest models that the data cannot reject are those that need least, and a model that belongs to
//! the data needs nothing.

use super::judgement::Judged;
use super::pool::{Entry, Move, Pool};
use super::selection::{rejects, select};
use super::study::Study;
use crate::error::Result;
use crate::identification::finer_hysteresis::main_effect;
use crate::identification::held_values::{as_free_as, holding};
use crate::identification::linearisation::{Rows, measured};
use crate::identification::nuisance_terms::{columns, orthonormalised, project_out_of};
use crate::outcome::ChangedValue;
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::Place;

/// What a comparison with a prior model came to.
pub struct Compared<'s, 'a> {
    /// The model as it was handed in.
    pub base: Judged,
    /// The same effects, all values fitted again.
    pub refitted: Judged,
    /// The data do not reject the model as it is.
    pub at_home: bool,
    /// Everything that was tried.
    pub pool: Pool<'s, 'a>,
    /// Keys of the simplest that the data cannot reject.
    pub minimal: Vec<String>,
}

/// Tries moves beside a prior model.
///
/// # Errors
/// A candidate that gives something that is no number.
pub fn compare<'s, 'a>(study: &'s Study<'a>, base: Judged) -> Result<Compared<'s, 'a>> {
    study
        .watch
        .event(&WatchEvent::Doing("fitting the model to this recording"));
    let refitted = study.thoroughly(&base.model);
    let mut pool = Pool::of(study, &holding(&base.model, |_, _| true));
    pool.entries.values_mut().for_each(|root| root.held = true);
    let at_home = !rejects(study, &base, &refitted);
    if !at_home && !study.watch.stopped() {
        let all = refitted
            .model
            .effects
            .iter()
            .map(|e| Move::Freed(e.id.clone()))
            .collect();
        pool.keep(Entry {
            extended: true,
            ..Entry::new(
                study,
                all,
                study.judged_quickly(refitted.model.clone()),
                true,
            )
        });
        tell(&mut pool, &base.model)?;
    }
    let minimal = if at_home {
        Vec::new()
    } else {
        select(&mut pool)
    };
    Ok(Compared {
        base,
        refitted,
        at_home,
        pool,
        minimal,
    })
}

/// Extends the best models move by move, until the simplest that are kept have been extended as well and so
/// have those with one move less.
fn tell(pool: &mut Pool, prior: &Model) -> Result<()> {
    for moves in 0..pool.study.policy.story_max {
        let of_level = |(_, e): &(&String, &Entry)| e.held && !e.extended && e.moves.len() == moves;
        let ranked = pool.ranked();
        let parents: Vec<String> = ranked
            .into_iter()
            .filter(of_level)
            .take(pool.study.policy.width)
            .map(|(k, _)| k.clone())
            .collect();
        extend(pool, &parents, prior)?;
        let level = select(pool)
            .first()
            .map_or(usize::MAX, |k| pool.entries[k].moves.len());
        if level <= moves || pool.study.watch.stopped() {
            break;
        }
    }
    // What stands beside a first move may as well stand beside the second: each is dropped, and all is tried
    // in its place.
    let minimal: Vec<Vec<Move>> = select(pool)
        .iter()
        .map(|k| pool.entries[k].moves.clone())
        .collect();
    let one_less: Vec<String> = pool
        .entries
        .iter()
        .filter(|(_, e)| e.held && !e.extended)
        .filter(|(_, e)| {
            minimal
                .iter()
                .any(|m| m.len() == e.moves.len() + 1 && e.moves.iter().all(|one| m.contains(one)))
        })
        .map(|(k, _)| k.clone())
        .collect();
    extend(pool, &one_less, prior)
}

/// Every move beside some models.
fn extend(pool: &mut Pool, keys: &[String], prior: &Model) -> Result<()> {
    for key in keys {
        let entry = pool.entries[key].clone();
        for tried in try_all(pool.study, &entry, prior)? {
            pool.keep(tried);
        }
        if let Some(entry) = pool.entries.get_mut(key) {
            entry.extended = true;
        }
    }
    Ok(())
}

/// Every move beside a model whose values are held but those of its own moves.
fn try_all(study: &Study, entry: &Entry, prior: &Model) -> Result<Vec<Entry>> {
    let model = &entry.judged.model;
    let candidates = study.candidates_for(model);
    let screening = study.score_each(&holding(model, |_, _| true), &candidates)?;
    let mut trials: Vec<(Move, Model)> = Vec::new();
    for score in &screening.scores {
        let guesses = if score.effect.declaration().starts_combine {
            1
        } else {
            study.policy.guesses
        };
        let begun = score
            .starts
            .iter()
            .take(guesses)
            .map(|start| study.with(model, &[(score.effect.clone(), start.clone())]));
        trials.extend(begun.map(|begin| (Move::Added(score.id.clone()), begin)));
    }
    let is_moved = |id: &str| entry.moves.iter().any(|m| m.effect() == id);
    for e in prior.effects.iter().filter(|e| !is_moved(&e.id)) {
        let begin = if e.effect.declaration().is_main() {
            scaled(study, model)
        } else {
            freed(model, prior, &e.id)
        };
        trials.push((Move::Freed(e.id.clone()), begin));
    }
    let fitted = parallel::map(&trials, |(by, begin)| {
        study.watch.event(&WatchEvent::Fitting {
            effect: by.effect(),
        });
        let moves = entry.moves.iter().cloned().chain([by.clone()]).collect();
        Entry {
            held: true,
            ..Entry::new(study, moves, study.for_comparison(begin), true)
        }
    });
    Ok(fitted)
}

/// The model with the values of one effect as free as they were.
fn freed(model: &Model, prior: &Model, id: &str) -> Model {
    let mut out = model.clone();
    if let (Some(effect), Some(there)) = (
        out.effects.iter_mut().find(|e| e.id == id),
        prior.effect(id),
    ) {
        effect
            .parameters
            .iter_mut()
            .zip(&there.parameters)
            .for_each(|(value, there)| value.parameter.fixed = there.parameter.fixed);
    }
    out
}

/// A model of the pool with all values as free as they are in the prior model.
#[must_use]
pub fn all_free(model: &Model, prior: &Model) -> Model {
    as_free_as(model.clone(), prior)
}

/// The values of a move that differ between the prior model and another.
#[must_use]
pub fn changes(study: &Study, id: &str, before: &Model, after: &Model) -> Vec<ChangedValue> {
    let (Some(a), Some(b)) = (before.effect(id), after.effect(id)) else {
        return Vec::new();
    };
    if main_effect(before).is_some_and(|main| main.id == id) {
        let differs = a
            .parameters
            .iter()
            .zip(&b.parameters)
            .filter(|(x, y)| x.value != y.value);
        let largest = differs.max_by(|(x, _), (y, _)| x.value.abs().total_cmp(&y.value.abs()));
        return largest
            .map(|(x, y)| ChangedValue {
                effect: id.into(),
                parameter: "scale".into(),
                from: 1.0,
                to: y.value / x.value,
            })
            .into_iter()
            .collect();
    }
    let differs = |x: f64, y: f64| (x - y).abs() > study.policy.same_value * x.abs().max(y.abs());
    let pairs = a
        .parameters
        .iter()
        .zip(&b.parameters)
        .filter(|(x, y)| !x.parameter.fixed && differs(x.value, y.value));
    pairs
        .map(|(x, y)| ChangedValue {
            effect: id.into(),
            parameter: x.parameter.name.clone(),
            from: x.value,
            to: y.value,
        })
        .collect()
}

/// The model with its hysteresis times the factor that the data ask for.
fn scaled(study: &Study, model: &Model) -> Model {
    let rows = Rows::thinned(
        study.dataset,
        &study.split.identify,
        study.policy.search_samples,
    );
    let (mut along, mut power) = (0.0, 0.0);
    for (i, samples) in &rows.records {
        let record = &study.dataset.records[*i];
        let own = orthonormalised(&columns(model, record, samples));
        let mut modelled = samples.of(&model.simulate(&record.drive()));
        let mut found = measured(record, samples);
        project_out_of(&own, &mut modelled);
        project_out_of(&own, &mut found);
        along += modelled.dot(&found);
        power += modelled.norm_squared();
    }
    let factor = if power > 0.0 { along / power } else { 1.0 };
    let mut out = model.clone();
    // Coefficients in um and gains are in proportion to the displacement; thresholds and shapes are not.
    let of_loops = |e: &&mut EffectInstance| e.effect.declaration().place == Place::Hysteresis;
    for value in out
        .effects
        .iter_mut()
        .filter(of_loops)
        .flat_map(|e| &mut e.parameters)
    {
        if value.parameter.unit == "um" || value.parameter.unit == "um/V" {
            value.value *= factor;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Dataset, Record, Role};
    use crate::diagnosis::policy::Policy;
    use crate::identification::noise_floor::noise_floor;
    use crate::model_file::effects_named;
    use crate::watch::Unwatched;
    use hysteron_sim::noise::WhiteNoise;

    #[test]
    fn a_stage_that_moves_further_needs_one_factor() {
        let record = |name: &str, role: Role, seed: u64, hz: f64| {
            let drive_v: Vec<f64> = (0..3000)
                .map(|k| 50.0 - 50.0 * (hz * 0.006 * f64::from(k)).cos())
                .collect();
            let mut noise = WhiteNoise::new(0.002, seed);
            let before_v = std::iter::once(0.0).chain(drive_v.iter().copied());
            let read_um = before_v
                .take(3000)
                .map(|v| 0.12 * v + noise.next_um())
                .collect();
            Record::new(name, 1000.0, drive_v, read_um).with_role(role)
        };
        let records = vec![
            record("fitted", Role::Identify, 1, 1.0),
            record("judging", Role::Validate, 2, 0.7),
            Record::new("rest", 1000.0, vec![0.0; 2000], {
                let mut noise = WhiteNoise::new(0.002, 3);
                (0..2000).map(|_| noise.next_um()).collect()
            })
            .with_role(Role::Noise),
        ];
        let dataset = Dataset::new("d", 0.0, 100.0, records).unwrap();
        let (floor, policy) = (noise_floor(&dataset), Policy::default());
        let study = Study::new(&dataset, Vec::new(), &floor, policy, &Unwatched);
        let with_gain = |gain: f64| {
            let mut model = Model::new(0.0, 100.0);
            let effect = effects_named("gain").unwrap().remove(0);
            model.add(EffectInstance::new(effect, &dataset.overview(), &[gain]));
            study.judged(model)
        };
        let found = compare(&study, with_gain(0.1)).unwrap();
        assert!(!found.at_home);
        let simplest = &found.pool.entries[&found.minimal[0]];
        assert_eq!(simplest.moves, [Move::Freed("gain".into())]);
        let changed = changes(&study, "gain", &found.base.model, &simplest.judged.model);
        assert_eq!(changed.len(), 1);
        assert!((changed[0].to - 1.2).abs() < 1e-3, "{changed:?}");
        assert!(compare(&study, with_gain(0.12)).unwrap().at_home);
    }
}
