//! What a diagnosis may cost: steps of simulation, which end it at the same place on every machine, and below
//! that the time that the caller gives.

use super::work::{Stage, Work};
use crate::watch::{Watch, WatchEvent};

/// What is done between two looks at the budget: enough for the cores of a desk.
const AT_ONCE: usize = 4;
/// Share of the budget that a search may take.
pub const SEARCH_ENDS_AT: f64 = 0.5;
/// The share that is used when other effects were tried in the place of what it found. At 0.8 nothing is left for
/// the tests of two stages with costly forces, which end undecided; at 0.65 both are named right.
const CLOSURE_ENDS_AT: f64 = 0.65;
/// The shares of steps and of time that are used when searches did without what would be named. In the rest
/// come evidence, the last fit and the checks that need a model.
const TESTS_END_AT: [f64; 2] = [0.9, 0.8];
/// Share of the time after which a fit for the report goes no further.
const FITS_END_AT: f64 = 0.95;

/// The budget of one diagnosis; clones share it.
#[derive(Clone)]
pub struct Budget<'w> {
    /// What was simulated.
    pub work: Work,
    most_steps: f64,
    watch: &'w dyn Watch,
    /// Share of the caller's time that was over when it began.
    over_before: f64,
}

impl<'w> Budget<'w> {
    /// A budget from now on.
    #[must_use]
    pub fn new(most_steps: f64, watch: &'w dyn Watch) -> Self {
        Self {
            work: Work::default(),
            most_steps,
            watch,
            over_before: watch.time_used().min(1.0),
        }
    }

    /// A budget that only the caller's time ends.
    #[must_use]
    pub fn of_time(watch: &'w dyn Watch) -> Self {
        Self::new(f64::INFINITY, watch)
    }

    /// The share of the caller's time that is used since it began.
    fn time_used(&self) -> f64 {
        let left = 1.0 - self.over_before;
        if left > 0.0 {
            (self.watch.time_used() - self.over_before) / left
        } else {
            1.0
        }
    }

    /// The shares of steps and of time at which the present stage ends.
    fn stage_ends_at(&self) -> [f64; 2] {
        match self.work.stage() {
            Stage::Start | Stage::Search | Stage::BeginningAgain => [SEARCH_ENDS_AT; 2],
            Stage::Closure => [CLOSURE_ENDS_AT; 2],
            Stage::Ablation => TESTS_END_AT,
            Stage::Report => [FITS_END_AT; 2],
        }
    }

    /// Whether the present stage has had its share of steps or of time. Asked between fits: what is simulated
    /// by then is the same in every run. Reports how much of the whole is used.
    #[must_use]
    pub fn is_over(&self) -> bool {
        let (used, ends_at) = ([self.of_steps(), self.time_used()], self.stage_ends_at());
        self.watch.event(&WatchEvent::Used {
            share: used[0].max(used[1]).clamp(0.0, 1.0),
        });
        used[0] >= ends_at[0] || used[1] >= ends_at[1]
    }

    /// What `f` makes of items, a few at once, until the present stage has had its share.
    pub fn while_it_lasts<T: Sync, R: Send + Sync>(
        &self,
        items: &[T],
        f: impl Fn(&T) -> R + Sync + Send,
    ) -> Vec<R> {
        items
            .chunks(AT_ONCE)
            .take_while(|_| !self.is_over())
            .flat_map(|few| crate::parallel::map(few, &f))
            .collect()
    }

    /// Whether the caller wants the best so far.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.watch.stopped()
    }

    /// Whether steps end it before the caller's time does.
    #[must_use]
    pub fn ends_by_steps(&self) -> bool {
        self.of_steps() >= self.time_used()
    }

    /// The share of the steps that is used.
    fn of_steps(&self) -> f64 {
        self.work.steps() as f64 / self.most_steps
    }

    /// Whether the caller's time for the present stage is over: asked within fits as well.
    #[must_use]
    pub fn time_is_over(&self) -> bool {
        self.time_used() >= self.stage_ends_at()[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Record;
    use crate::watch::Unwatched;
    use hysteron_sim::chain::{EffectInstance, Model};
    use hysteron_sim::effect::{Overview, by_id};

    /// Counts so many steps of a gain.
    fn spend(work: &Work, steps: usize) {
        let mut model = Model::new(0.0, 1.0);
        let overview = Overview::without_data(0.0, 1.0);
        model.add(EffectInstance::new(by_id("gain").unwrap(), &overview, &[]));
        let drive_v = vec![0.0; steps];
        work.simulated(
            &model,
            [&Record::new("r", 1000.0, drive_v.clone(), drive_v)],
        );
    }

    #[test]
    fn a_stage_ends_with_its_share_of_the_steps() {
        let budget = Budget::new(1000.0, &Unwatched);
        budget.work.enter(Stage::Search);
        spend(&budget.work, 499);
        assert!(!budget.is_over());
        spend(&budget.work, 1);
        assert!(budget.is_over() && !budget.time_is_over() && budget.ends_by_steps());
        budget.work.enter(Stage::Closure);
        assert!(!budget.is_over());
        spend(&budget.work, 150);
        assert!(budget.is_over());
        budget.work.enter(Stage::Ablation);
        assert!(!budget.is_over());
        spend(&budget.work, 250);
        assert!(budget.is_over());
        assert_eq!(budget.work.of_stage(Stage::Ablation), [250, 0, 0]);
    }

    /// So much of the caller's time is over, whatever was simulated.
    struct TimeUsed(f64);

    impl Watch for TimeUsed {
        fn event(&self, _event: &WatchEvent<'_>) {}
        fn time_used(&self) -> f64 {
            self.0
        }
    }

    #[test]
    fn a_second_run_has_the_rest_of_the_time() {
        let second = |over_before: f64, now: f64| {
            let watch = TimeUsed(now);
            let budget = Budget {
                over_before,
                ..Budget::new(1e9, &watch)
            };
            budget.is_over() && !budget.ends_by_steps()
        };
        assert!(second(0.0, 0.5) && !second(0.4, 0.6) && second(0.4, 0.8));
        assert!(second(1.0, 1.0));
    }
}
