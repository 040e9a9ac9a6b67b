//! What a diagnosis works on, and the moves by which models are made of it: effects added, taken away, begun
//! again, fitted.

use super::judgement::{Judged, Split, judge_fit, judge_rows};
use super::policy::Policy;
use super::screening::{CandidateScore, Screening, Weighing, screen, screen_some_and_all};
use super::searched_data::for_search;
use crate::dataset::Dataset;
use crate::error::Result;
use crate::identification::budget::Budget;
use crate::identification::fit::{Effort, Fit, FitProgress, fit_rows, fit_while, rms};
use crate::identification::held_values::{as_free_as, holding};
use crate::identification::linearisation::Rows;
use crate::identification::noise_floor::NoiseFloor;
use crate::identification::work::Purpose;
use crate::identification::{finer_creep, finer_hysteresis, finer_plays};
use crate::watch::{Watch, WatchEvent};
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::gain::Gain;
use hysteron_sim::effect::{Effect, LinesAtRest, Overview, Place};
use std::cell::Cell;
use std::sync::Arc;

/// Data, candidates and thresholds of one diagnosis.
pub struct Study<'a> {
    /// The data.
    pub dataset: &'a Dataset,
    /// What is known of them beforehand.
    pub overview: Overview,
    /// Fitted and held-out records.
    pub split: Split,
    /// Effects that may be added.
    pub candidates: Vec<Arc<dyn Effect>>,
    /// Noise floor over all records that judge, um.
    pub floor_um: Option<f64>,
    /// Noise floor of each record, um.
    pub floors_um: Vec<Option<f64>>,
    /// Lines that the readings show while the drive stands still.
    pub lines_at_rest: LinesAtRest,
    /// Standard deviation of the noise floor itself, relative.
    pub floor_relative_std: f64,
    /// The readings are whole steps of this, um.
    pub reading_step_um: Option<f64>,
    /// The noise is at least this, um, where no more is known of it.
    pub at_least_um: Option<f64>,
    /// Thresholds.
    pub policy: Policy,
    /// Told what is being done.
    pub watch: &'a dyn Watch,
    /// What all of it may cost.
    pub budget: Budget<'a>,
    /// The data on which a search runs: without what cannot matter there.
    searched: Dataset,
    /// Fitted samples while searching.
    quick: Rows,
    /// Judged samples while searching: the same, and as many of the held-out records.
    quick_judging: Rows,
    /// Fitted samples on which candidates are scored.
    scoring: Rows,
    /// The same of held-out records as well, where those say what is missing.
    scoring_all: Rows,
    /// The same where evidence is weighed.
    evidence: Rows,
    /// Fitted samples of a last fit.
    pub thorough: Rows,
    /// Judged samples of a last fit: all.
    pub all: Rows,
}

/// How far a fit goes to see whether a set of effects can compete.
const QUICK: Effort = Effort {
    iterations: 6,
    tolerance: 0.5,
    relative: 0.003,
    looks_again: false,
};
/// Steps after which a quick fit is looked at, and how far behind what it extends it may be then: of 369 such
/// fits on the recorded stage 75 ended so, a sixth of the time, and one of them would have come to a gain, of
/// 0.04.
const LOOKED_AT_AFTER: usize = 3;
const PLAINLY_BEHIND: f64 = 0.2;
/// A fit that two steps lowered by as much, as a logarithm, is on its way, and neither looked at nor ended.
const FALLS_FAST: f64 = 0.5;
/// The same where it is compared with one that is near the noise: from a hundred times as much a few steps
/// more bring it there, and a fit that ends early would be rejected by mistake.
const FALLS_TO_THE_NOISE: f64 = 0.1;
/// What is still so far behind once what was added was fitted by itself is not begun anywhere near where it
/// belongs.
const OUT_OF_REACH: f64 = 1.0;
/// What is so far behind half way through a quick fit is behind at its end.
pub const FAR_BEHIND: f64 = 1.0;
/// How far what is added is fitted by itself.
const FIRST: Effort = Effort {
    iterations: 3,
    tolerance: 0.5,
    relative: 0.01,
    looks_again: false,
};
/// How far what is only ranked: begun where its values are known, one step shows which brings most.
const RANKED: Effort = Effort {
    iterations: 1,
    ..FIRST
};
/// How far it goes before two sets are compared.
const COMPARING: Effort = Effort {
    iterations: 15,
    tolerance: 0.2,
    relative: 3e-4,
    looks_again: false,
};

/// How far a last fit goes where the model leaves many times the noise: the last hundredths of a per cent are
/// none of its knowledge.
const TO_THE_END_FAR_ABOVE: Effort = Effort {
    iterations: 30,
    tolerance: 0.05,
    relative: 2e-4,
    looks_again: false,
};

/// A model that leaves so many times as much of the held-out records has taken in what they would show.
pub const FAILS_HELD_OUT: f64 = 1.5;

/// Whether an effect is of a ceramic or of the amplifier in front of it.
fn is_of_a_ceramic(place: Place) -> bool {
    use Place::{
        AmplifierBandwidth, AmplifierSaturation, AmplifierSlew, Charge, Creep, Hysteresis,
    };
    matches!(
        place,
        AmplifierBandwidth | AmplifierSlew | AmplifierSaturation | Charge | Hysteresis | Creep
    )
}

/// A quick fit whose merit is worse by this much than that of a fit that went as far as it goes does not come
/// past it.
const CANNOT_CATCH_UP: f64 = 0.15;

impl<'a> Study<'a> {
    /// A study of a data set.
    #[must_use]
    pub fn new(
        dataset: &'a Dataset,
        candidates: Vec<Arc<dyn Effect>>,
        floor: &NoiseFloor,
        policy: Policy,
        watch: &'a dyn Watch,
    ) -> Self {
        let at_rest = (
            floor.rms_um,
            floor.of_records_um.as_slice(),
            &floor.lines_at_rest,
        );
        let budget = Budget::new(policy.most_steps, watch);
        let study = Self::with_floors(dataset, candidates, at_rest, policy, watch, budget);
        Self {
            floor_relative_std: floor.relative_std(),
            reading_step_um: floor.reading_step_um,
            at_least_um: floor.at_least_um,
            ..study
        }
    }

    /// The same study of the same readings with something else known of them.
    #[must_use]
    pub fn of<'b>(&'b self, dataset: &'b Dataset) -> Study<'b> {
        let at_rest = (
            self.floor_um,
            self.floors_um.as_slice(),
            &self.lines_at_rest,
        );
        Study::with_floors(
            dataset,
            self.candidates.clone(),
            at_rest,
            self.policy.clone(),
            self.watch,
            self.budget.clone(),
        )
    }

    fn with_floors(
        dataset: &'a Dataset,
        candidates: Vec<Arc<dyn Effect>>,
        (floor_um, floors_um, lines_at_rest): (Option<f64>, &[Option<f64>], &LinesAtRest),
        policy: Policy,
        watch: &'a dyn Watch,
        budget: Budget<'a>,
    ) -> Self {
        let counted = |rows: Rows, purpose: Purpose| rows.counted_by(budget.work.of(purpose));
        let split = Split::of(dataset);
        let searched = for_search(dataset, policy.walked_samples);
        let samples: usize = split
            .identify
            .iter()
            .map(|i| searched.records[*i].window.len())
            .sum();
        let stride = samples.div_ceil(policy.search_samples.max(1)).max(1);
        let stride_of_scoring = samples.div_ceil(policy.scoring_samples.max(1)).max(1);
        Self {
            overview: dataset.overview(),
            quick: counted(
                Rows::strided(&searched, &split.identify, stride),
                Purpose::Fit,
            ),
            quick_judging: counted(
                Rows::strided(&searched, &split.both(), stride),
                Purpose::Fit,
            ),
            scoring: counted(
                Rows::strided(&searched, &split.identify, stride_of_scoring),
                Purpose::Score,
            ),
            scoring_all: counted(
                Rows::strided(&searched, &split.both(), stride_of_scoring),
                Purpose::Score,
            ),
            evidence: counted(
                Rows::thinned(&searched, &split.identify, policy.evidence_samples),
                Purpose::Score,
            ),
            thorough: counted(
                Rows::thinned(dataset, &split.identify, policy.fit_samples),
                Purpose::Whole,
            ),
            all: counted(Rows::all(dataset, &split.both()), Purpose::Whole),
            budget,
            searched,
            dataset,
            split,
            candidates,
            floor_um,
            floors_um: floors_um.to_vec(),
            lines_at_rest: lines_at_rest.clone(),
            floor_relative_std: 0.0,
            reading_step_um: None,
            at_least_um: None,
            policy,
            watch,
        }
    }

    /// Records are so long that they were searched on their beginnings.
    #[must_use]
    pub fn searched_beginnings(&self) -> bool {
        let judged = |data: &Dataset| -> usize {
            self.split
                .both()
                .iter()
                .map(|i| data.records[*i].window.len())
                .sum()
        };
        judged(&self.searched) < judged(self.dataset)
    }

    /// Candidates that make sense beside a model.
    #[must_use]
    pub fn candidates_for(&self, model: &Model) -> Vec<Arc<dyn Effect>> {
        self.joining(model)
    }

    fn joining(&self, model: &Model) -> Vec<Arc<dyn Effect>> {
        let no_ceramic = self.dataset.units.exclude_a_ceramic();
        let joins = |effect: &&Arc<dyn Effect>| {
            let declaration = effect.declaration();
            model.effect(&declaration.id).is_none()
                && !(no_ceramic
                    && effect.declaration().definition.is_none()
                    && is_of_a_ceramic(declaration.place))
                && effect.may_join(model, &self.overview)
                && effect.speaks_for_it(model, &self.lines_at_rest)
                && !effect.starts(&self.overview).is_empty()
        };
        self.candidates.iter().filter(joins).cloned().collect()
    }

    /// Scores the candidates beside a model, for a search.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn score(&self, model: &Model) -> Result<Screening> {
        self.score_each(model, &self.candidates_for(model))
    }

    /// Scores these effects beside a model, for a search: on what it leaves of the fitted records, and on
    /// what it leaves of fitted and held-out records together, as if all were fitted.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn score_on_fitted_and_all(
        &self,
        model: &Model,
        effects: &[Arc<dyn Effect>],
    ) -> Result<[Screening; 2]> {
        let rows = [&self.scoring, &self.scoring_all];
        screen_some_and_all(
            model,
            &self.overview,
            &self.searched,
            rows,
            effects,
            self.floor_um,
        )
    }

    /// Whether a model leaves much more of the held-out records than of those that it was fitted to.
    #[must_use]
    pub fn fails_held_out(&self, judged: &Judged) -> bool {
        judged
            .validate_rms_um
            .is_some_and(|held_out_um| held_out_um > FAILS_HELD_OUT * judged.identify_rms_um)
    }

    /// Whether fitted records leave values of a model open that decide what it leaves of the held-out ones: far
    /// above the noise it leaves much more of these.
    #[must_use]
    pub fn leaves_values_open(&self, judged: &Judged) -> bool {
        self.far_above_the_noise(judged) && self.fails_held_out(judged)
    }

    /// Fits a model to the held-out records as well.
    #[must_use]
    pub fn fitted_to_all(&self, model: &Model) -> Judged {
        let goes_on = |_: &FitProgress| !self.budget.time_is_over();
        let rows = &self.quick_judging;
        let fit = fit_while(model, &self.searched, rows, COMPARING, goes_on);
        judge_fit(fit, rows, &self.searched, &self.split, rows)
    }

    /// Scores these effects beside a model, for a search.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn score_each(&self, model: &Model, effects: &[Arc<dyn Effect>]) -> Result<Screening> {
        screen(
            model,
            &self.overview,
            &self.searched,
            &self.scoring,
            effects,
            self.floor_um,
            Weighing::Quick,
        )
    }

    /// Scores candidates beside a model against chance.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn weigh(
        &self,
        model: &Model,
        candidates: &[Arc<dyn Effect>],
        seed: u64,
    ) -> Result<Screening> {
        screen(
            model,
            &self.overview,
            &self.searched,
            &self.evidence,
            candidates,
            self.floor_um,
            Weighing::AgainstChance(seed),
        )
    }

    /// A model with effects begun at these values.
    #[must_use]
    pub fn with(&self, model: &Model, effects: &[(Arc<dyn Effect>, Vec<f64>)]) -> Model {
        let mut out = model.clone();
        for (effect, start) in effects {
            out.add(EffectInstance::new(effect.clone(), &self.overview, start));
            if effect.declaration().definition.is_some() {
                out = self.first_value_first(&out, &effect.declaration().id);
            }
        }
        out
    }

    /// The model with the first value of a user's effect fitted before its others: begun far too small, its
    /// strength makes a fit of all values together send the others far away (a gap that a weak spring hardly
    /// shows).
    fn first_value_first(&self, model: &Model, id: &str) -> Model {
        let held = holding(model, |effect, place| effect == id && place > 0);
        as_free_as(
            fit_rows(&held, &self.searched, &self.quick, FIRST).model,
            model,
        )
    }

    /// Fits far enough to see which of several brings most.
    #[must_use]
    pub fn roughly(&self, model: &Model) -> Judged {
        self.fitted_quickly(model, RANKED)
    }

    /// Fits far enough to see whether it can compete.
    #[must_use]
    pub fn quickly(&self, model: &Model) -> Judged {
        self.quickly_within(model, f64::INFINITY, 0.0)
    }

    /// Fits far enough to be compared with another.
    #[must_use]
    pub fn for_comparison(&self, model: &Model) -> Judged {
        self.fitted_quickly(model, COMPARING)
    }

    /// Fits a model to which effects were added far enough to see whether it can compete with what it
    /// extends, whose merit is `of`, and no further where it plainly cannot.
    ///
    /// Effects that begin far too strong are fitted by themselves first: together with all others they draw
    /// those away from where they belong, and a fit of a few steps does not bring them back.
    #[must_use]
    pub fn quickly_beside(&self, begin: &Model, added: &[String], of: f64) -> Judged {
        let behind = |model: &Model| self.merit(&self.judged_quickly(model.clone())) - of;
        let mut begin = begin.clone();
        if !added.is_empty() && behind(&begin) > PLAINLY_BEHIND {
            let held = holding(&begin, |effect, _| !added.iter().any(|id| id == effect));
            let alone = self.judged_quickly(as_free_as(
                fit_rows(&held, &self.searched, &self.quick, FIRST).model,
                &begin,
            ));
            if self.merit(&alone) - of > OUT_OF_REACH {
                return alone;
            }
            begin = alone.model;
        }
        self.quickly_within(&begin, of, PLAINLY_BEHIND)
    }

    /// Fits as [`Self::quickly`], and no further where the model is behind a merit by so much once it no
    /// longer falls fast.
    #[must_use]
    pub fn quickly_within(&self, begin: &Model, of: f64, behind: f64) -> Judged {
        let looked_at = Cell::new(false);
        // At the noise all that an effect can bring is less than what ends a quick fit.
        let at_the_noise = self.merit_is_at_the_noise(of);
        let fast = if self.merit_is_within(self.policy.near_the_noise, of) {
            FALLS_TO_THE_NOISE
        } else {
            FALLS_FAST
        };
        let goes_on = |progress: &FitProgress| {
            if self.budget.time_is_over() {
                return false;
            }
            if progress.fell > fast {
                return true;
            }
            if progress.taken >= QUICK.iterations && !at_the_noise {
                return false;
            }
            // Beside nothing it is behind nothing, and held-out records are not simulated to find that.
            let is_looked_at =
                of.is_finite() && progress.taken >= LOOKED_AT_AFTER && !looked_at.replace(true);
            !is_looked_at || self.merit(&self.judged_quickly(progress.model.clone())) - of < behind
        };
        let effort = if at_the_noise {
            Effort {
                looks_again: true,
                ..COMPARING
            }
        } else {
            Effort {
                iterations: COMPARING.iterations,
                ..QUICK
            }
        };
        self.judged_as_fitted(fit_while(
            begin,
            &self.searched,
            &self.quick,
            effort,
            goes_on,
        ))
    }

    fn fitted_quickly(&self, model: &Model, effort: Effort) -> Judged {
        self.judged_as_fitted(fit_while(
            model,
            &self.searched,
            &self.quick,
            effort,
            |_| !self.budget.time_is_over(),
        ))
    }

    fn judged_as_fitted(&self, fit: Fit) -> Judged {
        judge_fit(
            fit,
            &self.quick,
            &self.searched,
            &self.split,
            &self.quick_judging,
        )
    }

    /// Fits as far as it goes, judged on all samples.
    #[must_use]
    pub fn thoroughly(&self, model: &Model) -> Judged {
        let far_above = self.far_above_the_noise(&self.judged_quickly(model.clone()));
        let effort = if far_above {
            TO_THE_END_FAR_ABOVE
        } else {
            Effort::default()
        };
        judge_fit(
            fit_while(model, self.dataset, &self.thorough, effort, |_| {
                !self.budget.time_is_over()
            }),
            &self.thorough,
            self.dataset,
            &self.split,
            &self.all,
        )
    }

    /// Judges a model as it is on all samples.
    #[must_use]
    pub fn judged(&self, model: Model) -> Judged {
        judge_rows(model, self.dataset, &self.split, &self.all)
    }

    /// Judges a model as it is on the samples of a search.
    #[must_use]
    pub fn judged_quickly(&self, model: Model) -> Judged {
        judge_rows(model, &self.searched, &self.split, &self.quick_judging)
    }

    /// What models are ranked by, the less the better: a mean of the logarithms of held-out and fitted error,
    /// in which the held-out one weighs more; every record counts alike, so that one which no model meets
    /// does not hide what the others say. What is below the noise is not better.
    #[must_use]
    pub fn merit(&self, judged: &Judged) -> f64 {
        self.merit_of(|i| rms(&judged.residuals[i]))
    }

    /// The merit of what leaves so much of each record.
    fn merit_of(&self, left_um: impl Fn(usize) -> f64) -> f64 {
        let least = |i: usize| self.floors_um[i].unwrap_or(0.0).max(1e-300);
        let mean = |records: &[usize]| {
            let mut each: Vec<f64> = records
                .iter()
                .map(|i| left_um(*i).max(least(*i)).ln())
                .collect();
            each.sort_by(f64::total_cmp);
            each.iter().sum::<f64>() / each.len().max(1) as f64
        };
        let fitted = mean(&self.split.identify);
        let weight = if self.split.validate.is_empty() {
            0.0
        } else {
            self.policy.held_out_weight
        };
        weight * mean(&self.split.validate) + (1.0 - weight) * fitted
    }

    /// Times the noise within which an error counts as the noise: the floor is known to some per cent only.
    #[must_use]
    pub fn as_the_noise(&self) -> f64 {
        self.policy.at_floor + self.policy.floor_z * self.floor_relative_std
    }

    /// Fitted and held-out records together are about at the floor, as far as a quick fit gets.
    #[must_use]
    pub fn met(&self, judged: &Judged) -> bool {
        judged.within(self.policy.met, &self.floors_um, &self.split)
    }

    /// Every judged record is at the floor.
    #[must_use]
    pub fn nothing_left(&self, judged: &Judged) -> bool {
        self.in_all_records(judged, |rms_um, floor_um| {
            rms_um < self.policy.nothing_left * floor_um
        })
    }

    /// Every judged record has a floor and this relation to it.
    fn in_all_records(&self, judged: &Judged, holds: impl Fn(f64, f64) -> bool) -> bool {
        let mut both = judged
            .residuals
            .iter()
            .zip(&self.floors_um)
            .filter(|(r, _)| !r.is_empty());
        both.all(|(r, floor)| floor.is_some_and(|floor_um| holds(rms(r), floor_um)))
    }

    /// The noise is known, and this merit is that of a model that leaves less than so many times as much.
    fn merit_is_within(&self, times: f64, merit: f64) -> bool {
        self.floor_um.is_some()
            && merit < self.merit_of(|i| self.floors_um[i].unwrap_or(0.0)) + times.ln()
    }

    /// This merit is that of a model at the noise: what else there is, is a small share of what is left,
    /// however plainly the data show it.
    #[must_use]
    pub fn merit_is_at_the_noise(&self, merit: f64) -> bool {
        self.merit_is_within(self.policy.explained, merit)
    }

    /// The noise is known, and an effect explains more of it than chance does.
    #[must_use]
    pub fn seen_in_the_noise(&self, score: &CandidateScore) -> bool {
        self.floor_um.is_some_and(|floor_um| {
            score.explained_um2 > self.policy.seen_in_the_noise * floor_um * floor_um
        })
    }

    /// The noise is known, and a model leaves not much more.
    #[must_use]
    pub fn near_the_noise(&self, judged: &Judged) -> bool {
        judged.within(self.policy.near_the_noise, &self.floors_um, &self.split)
    }

    /// The noise is known, and a model leaves much more.
    #[must_use]
    pub fn far_above_the_noise(&self, judged: &Judged) -> bool {
        self.floor_um.is_some() && !self.near_the_noise(judged)
    }

    /// A model without an effect and without what builds on it, other values as they are; a gain takes the
    /// place of the hysteresis.
    #[must_use]
    pub fn without(&self, model: &Model, id: &str) -> Model {
        let mut out = model.clone();
        out.effects.retain(|e| e.id != id);
        if !out.effects.iter().any(|e| e.effect.declaration().is_main()) {
            out.add(EffectInstance::new(Arc::new(Gain), &self.overview, &[]));
        }
        let place = |e: &EffectInstance| e.effect.declaration().place;
        let orphaned = |e: &EffectInstance| {
            let d = e.effect.declaration();
            // What modifies the effect that went stands in its place; a second mode without a first has no
            // meaning.
            d.modifies == Some(id) && model.effect(id).is_some_and(|of| place(of) == d.place)
        };
        let gone: Vec<String> = out
            .effects
            .iter()
            .filter(|e| orphaned(e))
            .map(|e| e.id.clone())
            .collect();
        out.effects.retain(|e| !gone.contains(&e.id));
        out
    }

    /// The model with an effect begun from the start that explains most of what the others leave; where half
    /// way it is far behind a merit, it is fitted no further.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn seated(
        &self,
        model: &Model,
        effect: &Arc<dyn Effect>,
        starts: usize,
        of: f64,
    ) -> Result<Judged> {
        let screening = screen(
            model,
            &self.overview,
            &self.searched,
            &self.scoring,
            std::slice::from_ref(effect),
            None,
            Weighing::Quick,
        )?;
        let begun = |start: &[f64]| self.with(model, &[(effect.clone(), start.to_vec())]);
        let trials: Vec<Model> = match screening.scores.first() {
            Some(score) => score
                .starts
                .iter()
                .take(if effect.declaration().starts_combine {
                    1
                } else {
                    starts
                })
                .map(|s| begun(s))
                .collect(),
            None => vec![begun(&[])],
        };
        let fitted =
            crate::parallel::map(&trials, |trial| self.quickly_within(trial, of, FAR_BEHIND));
        let best = fitted
            .into_iter()
            .min_by(|a, b| a.identify_rms_um.total_cmp(&b.identify_rms_um));
        Ok(best.unwrap_or_else(|| self.quickly(&begun(&[]))))
    }

    /// A model with an effect that was found beside it with all else held, and what that alone leaves: where the
    /// values of the model are knowledge, only the effect has to be found.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn found_alone(
        &self,
        model: &Model,
        effect: &Arc<dyn Effect>,
        starts: usize,
        of: f64,
    ) -> Result<(Model, Judged)> {
        let alone = self.seated(&holding(model, |_, _| true), effect, starts, of)?;
        let mut begun = model.clone();
        if let Some(found) = alone.model.effect(&effect.declaration().id) {
            begun.add(found.clone());
        }
        Ok((begun, alone))
    }

    /// The model with each effect that has several beginnings begun again beside the others: while something
    /// was missing, it may have settled far from where it belongs.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn begun_again(&self, judged: &Judged) -> Result<Judged> {
        let mut best = judged.clone();
        let several = |effect: &Arc<dyn Effect>| {
            !effect.declaration().starts_combine && effect.starts(&self.overview).len() > 1
        };
        let again: Vec<Arc<dyn Effect>> = judged
            .model
            .effects
            .iter()
            .map(|e| e.effect.clone())
            .filter(several)
            .collect();
        for effect in again.into_iter().take_while(|_| !self.watch.stopped()) {
            let id = effect.declaration().id;
            let builds_on = |e: &EffectInstance| {
                let d = e.effect.declaration();
                d.modifies == Some(&id) && d.place == effect.declaration().place
            };
            if best.model.effects.iter().any(builds_on) {
                continue;
            }
            self.watch.event(&WatchEvent::Fitting { effect: &id });
            let seated = self.seated(
                &self.without(&best.model, &id),
                &effect,
                1,
                self.merit(&best),
            )?;
            if self.merit(&seated) > self.merit(&best) + CANNOT_CATCH_UP {
                continue;
            }
            let seated = self.for_comparison(&seated.model);
            if self.merit(&seated) < self.merit(&best) - 1e-6 {
                best = seated;
            }
        }
        Ok(best)
    }

    /// Fits a list of effects, each begun from the start that explains most of what the others leave; then
    /// all together. Where the caller wants the best so far, the rest are begun as they come and fitted
    /// quickly.
    ///
    /// # Errors
    /// As [`screen`].
    pub fn build(&self, effects: &[Arc<dyn Effect>]) -> Result<Judged> {
        let mut order: Vec<Arc<dyn Effect>> = effects.to_vec();
        order.sort_by_key(|e| {
            (
                e.declaration().fitting_rank,
                e.declaration().place,
                e.declaration().id,
            )
        });
        let mut judged = self.one_after_the_other(&order)?;
        // An effect that was fitted before the others began again may stand in for what they lacked then, and
        // keeps them there: each in turn comes last, behind the others built without it.
        let seated = |e: &&Arc<dyn Effect>| {
            !e.declaration().is_main()
                && !e.declaration().starts_combine
                && e.starts(&self.overview).len() > 1
        };
        let in_turn: Vec<Arc<dyn Effect>> = order.iter().rev().filter(seated).cloned().collect();
        if in_turn.len() > 1 {
            for last in &in_turn {
                if self.watch.stopped() || !self.far_above_the_noise(&judged) {
                    break;
                }
                let id = last.declaration().id;
                let built_on = order
                    .iter()
                    .any(|e| e.declaration().modifies == Some(id.as_str()));
                if built_on {
                    continue;
                }
                let others: Vec<Arc<dyn Effect>> = order
                    .iter()
                    .filter(|e| e.declaration().id != id)
                    .cloned()
                    .collect();
                let rest = self.one_after_the_other(&others)?;
                let behind =
                    self.for_comparison(&self.seated(&rest.model, last, 3, f64::INFINITY)?.model);
                if self.merit(&behind) < self.merit(&judged) {
                    judged = behind;
                }
            }
        }
        if self.watch.stopped() {
            Ok(self.judged(judged.model))
        } else {
            Ok(self.thoroughly(&judged.model))
        }
    }

    /// Effects fitted one after the other, in this order, then all together, and begun again where that
    /// leaves more than the noise.
    fn one_after_the_other(&self, order: &[Arc<dyn Effect>]) -> Result<Judged> {
        let mut model = Model::new(self.dataset.drive_min_v, self.dataset.drive_max_v);
        if !order.iter().any(|e| e.declaration().is_main()) {
            model.add(EffectInstance::new(Arc::new(Gain), &self.overview, &[]));
        }
        let mut several = 0;
        for effect in order {
            self.watch.event(&WatchEvent::Fitting {
                effect: &effect.declaration().id,
            });
            let one_start =
                effect.declaration().starts_combine || effect.starts(&self.overview).len() <= 1;
            let plain = one_start || model.effects.is_empty() || self.watch.stopped();
            model = if plain {
                self.quickly(&self.with(&model, &[(effect.clone(), Vec::new())]))
                    .model
            } else {
                several += 1;
                self.seated(&model, effect, 3, f64::INFINITY)?.model
            };
        }
        self.watch
            .event(&WatchEvent::Doing("fitting all effects together"));
        let mut judged = self.for_comparison(&model);
        if !self.watch.stopped() && several > 0 && model.effects.len() > 2 && !self.met(&judged) {
            judged = self.begun_again(&judged)?;
        }
        Ok(judged)
    }

    /// Finer descriptions of the hysteresis of a model: surfaces of one degree more, play operators beside
    /// them.
    #[must_use]
    pub fn finer(&self, model: &Model) -> Vec<Model> {
        let ways = [
            finer_hysteresis::refined(model, &self.overview, 1),
            finer_hysteresis::with_play_operators(model, &self.overview),
        ];
        ways.into_iter().flatten().collect()
    }

    /// Finer descriptions of its play operators: more of them, or few at free thresholds.
    #[must_use]
    pub fn finer_plays(&self, model: &Model) -> Vec<Model> {
        [
            finer_plays::denser(model, &self.overview),
            finer_plays::freed(model, &self.overview),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Finer descriptions of its creep: more terms, or free time constants.
    #[must_use]
    pub fn finer_creep(&self, model: &Model) -> Vec<Model> {
        [
            finer_creep::denser(model, &self.overview),
            finer_creep::freed(model, &self.overview),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// By how many steps a model is described more finely than its effects are declared.
    #[must_use]
    pub fn steps_finer(model: &Model) -> usize {
        finer_hysteresis::steps_finer(model) + finer_creep::steps_finer(model)
    }
}
