//! The pool: every model that was fitted, by the moves that lead to it from the start.

use super::confidence_set::Losses;
use super::judgement::Judged;
use super::study::Study;
use crate::identification::{finer_creep, finer_hysteresis};
use crate::parallel;
use crate::watch::WatchEvent;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{LoopsTried, gain};
use std::collections::{BTreeMap, BTreeSet};

/// What distinguishes a model from the start.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Move {
    /// An effect was added.
    Added(String),
    /// An effect of the prior model took other values.
    Freed(String),
}

impl Move {
    /// The effect that it is about.
    #[must_use]
    pub fn effect(&self) -> &str {
        match self {
            Self::Added(id) | Self::Freed(id) => id,
        }
    }
}

/// A model that was fitted.
#[derive(Clone)]
pub struct Entry {
    /// How it differs from the start, in order. A finer description of loops or creep is no move of its own.
    pub moves: Vec<Move>,
    /// The model and its errors on the samples of the search.
    pub judged: Judged,
    /// What entries are ranked by ([`Study::merit`]), which is asked for often.
    pub merit: f64,
    /// An added effect is excluded by its own physics.
    pub(crate) excluded: bool,
    /// Its extensions were proposed.
    pub(crate) extended: bool,
    /// It was fitted far enough to be compared with others.
    pub(crate) compared: bool,
    /// It was fitted to its end.
    pub(crate) finished: bool,
    /// All values are held but those of its moves, as beside a prior model.
    pub(crate) held: bool,
    /// Its losses on all judged samples, once it was compared with others.
    pub(crate) losses: Option<Losses>,
    /// The same once it was fitted to all records.
    pub(crate) losses_fitted_to_all: Option<Losses>,
}

impl Entry {
    /// A fitted model; `compared` where its fit went far enough.
    #[must_use]
    pub fn new(study: &Study, mut moves: Vec<Move>, judged: Judged, compared: bool) -> Self {
        moves.sort();
        moves.dedup();
        let (merit, excluded) = (study.merit(&judged), excludes_one(&moves, &judged.model));
        Self {
            moves,
            merit,
            judged,
            excluded,
            extended: false,
            compared,
            finished: false,
            held: false,
            losses: None,
            losses_fitted_to_all: None,
        }
    }

    /// Effects that were added.
    #[must_use]
    pub fn added(&self) -> Vec<String> {
        let added = |m: &Move| {
            if let Move::Added(id) = m {
                Some(id.clone())
            } else {
                None
            }
        };
        self.moves.iter().filter_map(added).collect()
    }

    /// An effect that was added is not what its values say: its own physics excludes them.
    #[must_use]
    pub fn is_excluded(&self) -> bool {
        self.excluded
    }

    /// The same model fitted further.
    fn fitted_further(&mut self, study: &Study, judged: Judged) {
        (self.compared, self.merit, self.excluded) = (
            true,
            study.merit(&judged),
            excludes_one(&self.moves, &judged.model),
        );
        self.judged = judged;
    }
}

fn excludes_one(moves: &[Move], model: &Model) -> bool {
    moves.iter().any(|m| is_excluded(m, model))
}

/// A move adds an effect that its own physics excludes at its values.
fn is_excluded(of: &Move, model: &Model) -> bool {
    matches!(of, Move::Added(id) if model.ruled_out_because(id).is_some())
}

/// The moves by which effects are added.
#[must_use]
pub fn added(ids: &[String]) -> Vec<Move> {
    ids.iter().cloned().map(Move::Added).collect()
}

/// Every model that was fitted.
pub struct Pool<'s, 'a> {
    /// Data, candidates and thresholds.
    pub study: &'s Study<'a>,
    pub(crate) entries: BTreeMap<String, Entry>,
    /// Moves that lead to where the search begins: none, but behind a prior model.
    pub(crate) origin: Vec<Move>,
    /// Effects of models in whose place others were tried to the end.
    pub(super) exchanged: BTreeSet<(String, String)>,
}

/// Moves and descriptions of loops and creep: what an entry is known by.
#[must_use]
pub fn key(moves: &[Move], model: &Model) -> String {
    let creep = finer_creep::description(model).unwrap_or_default();
    let mut names: Vec<String> = moves
        .iter()
        .map(|m| match m {
            Move::Added(id) => id.clone(),
            Move::Freed(id) => format!("~{id}"),
        })
        .collect();
    names.sort();
    format!(
        "{}|{}|{creep}",
        names.join("+"),
        finer_hysteresis::description(model)
    )
}

impl<'s, 'a> Pool<'s, 'a> {
    /// A pool with its start.
    #[must_use]
    pub fn of(study: &'s Study<'a>, start: &Model) -> Self {
        let entry = Entry::new(study, Vec::new(), study.judged_quickly(start.clone()), true);
        Self {
            study,
            entries: BTreeMap::from([(key(&[], start), entry)]),
            origin: Vec::new(),
            exchanged: BTreeSet::new(),
        }
    }

    /// Where the search begins.
    #[must_use]
    pub fn start(&self) -> Option<&Entry> {
        self.entries.values().find(|e| e.moves == self.origin)
    }

    /// Merit of an entry, and a little for each move and each step of a finer description.
    #[must_use]
    pub fn rank(&self, entry: &Entry) -> f64 {
        let more = entry.moves.len() + Study::steps_finer(&entry.judged.model);
        entry.merit + self.study.policy.gain_per_effect * more as f64
    }

    /// All entries with their keys, best first.
    #[must_use]
    pub fn ranked(&self) -> Vec<(&String, &Entry)> {
        let mut out: Vec<(&String, &Entry)> = self.entries.iter().collect();
        out.sort_by(|a, b| {
            self.rank(a.1)
                .total_cmp(&self.rank(b.1))
                .then_with(|| a.0.cmp(b.0))
        });
        out
    }

    /// The best entry of which no effect is excluded by its own physics; without such an entry, the best.
    #[must_use]
    pub fn best(&self) -> &Entry {
        let ranked = self.ranked();
        ranked
            .iter()
            .find(|(_, e)| !e.is_excluded())
            .unwrap_or(&ranked[0])
            .1
    }

    /// Takes an entry in, unless the same was fitted better.
    pub fn keep(&mut self, entry: Entry) {
        if !entry.judged.identify_rms_um.is_finite() {
            return;
        }
        let best = self.rank(&entry) < self.rank(self.best());
        self.study.watch.event(&WatchEvent::Tried {
            added: &entry.added(),
            identify_rms_um: entry.judged.identify_rms_um,
            validate_rms_um: entry.judged.validate_rms_um,
            best,
        });
        let key = key(&entry.moves, &entry.judged.model);
        match self.entries.get(&key) {
            Some(known) if known.merit <= entry.merit => {}
            _ => {
                self.entries.insert(key, entry);
            }
        }
    }

    /// Fits entries as far as they can be compared. What a fit comes to is what counts, on held-out records
    /// too: a good error half way is chance.
    pub(crate) fn compare(&mut self, keys: &[String]) {
        let pending: Vec<&String> = keys
            .iter()
            .filter(|k| self.entries.get(*k).is_some_and(|e| !e.compared))
            .collect();
        let fitted = parallel::map(&pending, |k| {
            self.study.for_comparison(&self.entries[*k].judged.model)
        });
        for (key, judged) in pending.into_iter().zip(fitted) {
            let Some(entry) = self.entries.get_mut(key) else {
                continue;
            };
            entry.fitted_further(self.study, judged);
        }
    }

    /// Brings the best few as far as they can be compared, until those that are best have been. Where the
    /// best has an effect that its own physics excludes, the same without it joins.
    pub(crate) fn compare_best(&mut self) {
        loop {
            let best = self.ranked().into_iter().take(self.study.policy.width);
            let pending: Vec<String> = best
                .filter(|(_, e)| !e.compared)
                .map(|(k, _)| k.clone())
                .collect();
            self.compare(&pending);
            if pending.is_empty() && !self.clear_the_best_of_excluded() {
                return;
            }
        }
    }

    /// Whether the best had excluded effects, and the same without these was not known.
    fn clear_the_best_of_excluded(&mut self) -> bool {
        let (study, best) = (self.study, self.ranked()[0].1);
        if !best.excluded || best.held {
            return false;
        }
        let (mut moves, mut model) = (best.moves.clone(), best.judged.model.clone());
        moves.retain(|m| !is_excluded(m, &best.judged.model));
        for m in best.moves.iter().filter(|m| !moves.contains(m)) {
            model = study.without(&model, m.effect());
        }
        moves.retain(|m| model.effect(m.effect()).is_some());
        let is_new = !self.entries.contains_key(&key(&moves, &model));
        if is_new {
            self.keep(Entry::new(study, moves, study.quickly(&model), false));
        }
        is_new
    }

    /// An entry with loops of the other structures that are tried at this time, as far as the pool lacks them:
    /// key, moves, and the model at which a fit begins. Beside loops that were there from the beginning another
    /// structure is no effect more.
    pub(crate) fn with_other_structures(
        &self,
        entry: &Entry,
        at: LoopsTried,
    ) -> Vec<(String, Vec<Move>, Model)> {
        let starts_at_a_gain = self
            .start()
            .is_some_and(|start| start.judged.model.effect(gain::ID).is_some());
        let others =
            finer_hysteresis::of_other_structures(&entry.judged.model, &self.study.overview, at);
        let known_by = |begin: Model| {
            let kept = entry
                .moves
                .iter()
                .filter(|m| begin.effect(m.effect()).is_some());
            let loops = finer_hysteresis::structure(&begin).filter(|_| starts_at_a_gain);
            let mut moves: Vec<Move> = kept.cloned().chain(loops.map(Move::Added)).collect();
            moves.sort();
            (key(&moves, &begin), moves, begin)
        };
        let known = others.into_iter().map(known_by);
        known
            .filter(|(key, ..)| !self.entries.contains_key(key))
            .collect()
    }

    /// Fits an entry to its end, on all samples.
    pub(crate) fn finish(&mut self, key: &str) {
        let Some(entry) = self.entries.get_mut(key).filter(|e| !e.finished) else {
            return;
        };
        entry.finished = true;
        let whole = self.study.thoroughly(&entry.judged.model);
        if whole.identify_rms_um.is_finite() {
            let losses = Losses::of_judged(self.study, &whole);
            entry.fitted_further(self.study, self.study.judged_quickly(whole.model));
            entry.losses = Some(losses);
        }
    }

    /// Makes the losses known that entries have once they are fitted to all records.
    pub(crate) fn weigh_fitted_to_all(&mut self, keys: &[String]) {
        let study = self.study;
        self.make_losses(
            keys,
            |entry| &mut entry.losses_fitted_to_all,
            |model| Losses::of_judged(study, &study.fitted_to_all(&model)),
        );
    }

    /// Makes the losses of entries on all judged samples known.
    pub(crate) fn weigh(&mut self, keys: &[String]) {
        let study = self.study;
        self.make_losses(
            keys,
            |entry| &mut entry.losses,
            |model| Losses::of(study, model),
        );
    }

    /// Makes losses of entries where they are not known.
    fn make_losses(
        &mut self,
        keys: &[String],
        place: fn(&mut Entry) -> &mut Option<Losses>,
        of: impl Fn(Model) -> Losses + Sync + Send,
    ) {
        let mut pending: Vec<(&String, Model)> = Vec::new();
        for key in keys {
            if let Some(entry) = self.entries.get_mut(key)
                && place(entry).is_none()
            {
                pending.push((key, entry.judged.model.clone()));
            }
        }
        let losses = parallel::map(&pending, |(_, model)| of(model.clone()));
        for ((key, _), losses) in pending.into_iter().zip(losses) {
            if let Some(entry) = self.entries.get_mut(key) {
                *place(entry) = Some(losses);
            }
        }
    }
}
