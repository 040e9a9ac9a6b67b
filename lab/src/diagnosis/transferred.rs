//! A model that was identified on other data: what has changed, or what did this actuator always have that the new recording shows?
//!
//! The values of such a model are knowledge. Fitting them again to the new recording would let them take up a missing effect, so every
//! candidate whose signature is in the residual beside what the model's own values could do is first fitted *alone*, with all other values
//! held. One effect that explains most of what a new fit of everything could
//! remove is the simpler story, and it is told first; then everything is fitted together. A model that was identified on the very data
//! it is diagnosed on gains nothing by a new fit, and none of this applies.

use super::growth::{Growth, Round, Step, Workbench};
use super::refit::{Finalist, Judged, Trial, judge, refit};
use super::screening::{Score, screen};
use crate::fit::{Effort, fit};
use hysteron_sim::chain::Model;

/// A new fit that lowers the error by less than this share finds the model at home.
const AT_HOME: f64 = 0.05;
/// Least share of what a new fit removes that one effect must explain by itself.
const EXPLAINS_ALONE: f64 = 0.5;
/// Largest p-value of a candidate that is tried alone, after control of false discoveries.
const SIGNIFICANT: f64 = 0.05;
/// One effect must come this near to a new fit of everything: where it does not, the values have changed, not what is missing.
const NEAR_REFIT: f64 = 4.0;
/// Two effects whose errors differ by less than this share are not told apart.
const ALIKE: f64 = 0.1;
/// An effect with one value more must lower the error to this share of a simpler one's: it also takes up what the held values miss.
const WORTH_ONE_VALUE: f64 = 0.5;

impl Workbench<'_> {
    /// Grows a model that came from elsewhere.
    #[must_use]
    pub fn grow_transferred(&self, model: Model) -> Growth {
        let base = judge(model, self.dataset, &self.split);
        let mut growth = Growth::from_base(base.clone());
        (self.progress)("fitting the model to this recording");
        let refitted = self.fitted(&base.model);
        if refitted.identify_rms_um > (1.0 - AT_HOME) * base.identify_rms_um {
            return self.grow_on(growth);
        }
        let Some((round, best)) = self.round_alone(&base, &refitted) else {
            growth.steps.push(again(refitted));
            return self.grow_on(growth);
        };
        let declaration = round.screening.scores[best.score].effect.declaration();
        let why =
            format!("{} With all other values held as they were identified elsewhere, it explains most of the error", declaration.physics);
        growth.steps.push(Step { added: Some(best.id.clone()), removed: Vec::new(), why, judged: best.judged.clone(), round: Some(round) });
        growth.transferred = true;
        growth.steps.push(again(self.fitted(&best.judged.model)));
        // Without a floor nothing says where to stop, and the question was what the new recording has.
        if self.floor_um.is_some() { self.grow_on(growth) } else { growth }
    }

    fn fitted(&self, model: &Model) -> Judged {
        judge(fit(model, self.dataset, &self.split.identify, Effort::default()).model, self.dataset, &self.split)
    }

    /// All candidates, each fitted alone; the best, if it explains enough by itself.
    fn round_alone(&self, base: &Judged, refitted: &Judged) -> Option<(Round, Finalist)> {
        let candidates = self.candidates_for(&base.model);
        (self.progress)(&format!("trying {} candidate effects alone", candidates.len()));
        let screening = screen(&base.model, &self.overview, self.dataset, &self.split.identify, &candidates, self.floor_um, 900);
        let alone = |(i, score): (usize, &Score)| {
            (self.progress)(&format!("fitting {} alone", score.id));
            refit(base, score, i, &self.overview, self.dataset, &self.split, self.floor_um, Trial::ALONE)
        };
        // What the model's own values could do is no evidence of an effect: its signature must be in the residual beside that.
        let in_residual = screening.scores.iter().enumerate().filter(|(_, score)| score.p_adjusted <= SIGNIFICANT);
        let mut finalists: Vec<Finalist> = in_residual.map(alone).collect();
        let cost = |f: &Finalist| f.judged.identify_rms_um / WORTH_ONE_VALUE.powi(values_of(&f.judged.model, &f.id) as i32 - 1);
        finalists.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        let best = finalists.first()?.clone();
        let square = |judged: &Judged| judged.identify_rms_um * judged.identify_rms_um;
        let removable = square(base) - square(refitted);
        let stands_back = best.judged.identify_rms_um > NEAR_REFIT * refitted.identify_rms_um;
        if stands_back || square(base) - square(&best.judged) < EXPLAINS_ALONE * removable {
            return None;
        }
        // What even the best leaves to a new fit is owed to the values held; a difference below that decides nothing.
        let left_by_best = (square(&best.judged) - square(refitted)).max(0.0);
        let tied = finalists
            .iter()
            .filter(|f| cost(f) <= (1.0 + ALIKE) * cost(&best) || cost(f) * cost(f) - cost(&best) * cost(&best) <= left_by_best)
            .map(|f| f.id.clone())
            .collect();
        Some((Round::decided(screening, finalists, tied), best))
    }
}

/// Values of an effect that are estimated.
fn values_of(model: &Model, id: &str) -> usize {
    model.effect(id).map_or(0, |e| e.parameters.iter().filter(|p| !p.parameter.fixed).count())
}

fn again(judged: Judged) -> Step {
    Step::without_effect("all values fitted again, to this recording".into(), judged)
}
