//! Every threshold of the decision, with the reason for its value.

use crate::dataset::circumstances::SEARCHED_SAMPLES;
use crate::error::{Error, Result, line_of};
use serde::Deserialize;

/// When a search goes on, when an effect is admitted, when two explanations are distinguished.
///
/// ```
/// use hysteron::Policy;
///
/// let strict = Policy::from_toml("family_wise = 0.01", "policy.toml")?;
/// assert_eq!(strict, Policy { family_wise: 0.01, ..Policy::default() });
/// assert!(Policy::from_toml("family_wize = 0.01", "policy.toml").is_err());
/// assert!(Policy::from_toml("family_wise = 7", "policy.toml").is_err());
/// # Ok::<(), hysteron::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Policy {
    /// Steps of simulation that a search may take with all that is behind it: about 40 s of processor. A step
    /// took 3.5 to 4.9 ns in searches that used all of them.
    pub most_steps: f64,
    /// Samples of the fitted records that are simulated while searching, at most: every set of effects
    /// simulates them some thirty times. Longer records are searched on their beginnings and fitted whole at
    /// the end.
    pub walked_samples: usize,
    /// Samples of all fitted and judging records on which everything is decided, at most: with as many, an
    /// error is known to a thousandth. Of longer recordings the beginnings decide, and the last model is
    /// fitted to the whole.
    pub weighed_samples: usize,
    /// Samples on which sets of effects are compared while searching. Enough that the error of any set is
    /// known to about one part in a hundred, few enough that a set is fitted in a tenth of a second.
    pub search_samples: usize,
    /// Samples on which candidates are scored while searching: the products of a few hundred signatures with
    /// the residual need fewer.
    pub scoring_samples: usize,
    /// Samples on which the evidence for a name is weighed.
    pub evidence_samples: usize,
    /// Most samples that the last fit of a model takes; beyond, one in so many. Standard deviations fall with
    /// the root of their number, and at this many they are far below what the model itself leaves.
    pub fit_samples: usize,
    /// Models that are extended side by side.
    pub width: usize,
    /// Extensions of these that are fitted in one round.
    pub trials: usize,
    /// Most effects that are added.
    pub effects_max: usize,
    /// Rounds without a better model after which the search ends near the noise; two effects that only help
    /// together are proposed as a pair.
    pub rounds_without_gain: usize,
    /// The same far above the noise, or where nobody knows it: there several effects are missing, and each
    /// may need another beside it. A fourth such round lowers two of eight recorded sets, one
    /// from 18.4 / 34.0 to 14.7 / 22.6 nm.
    pub rounds_without_gain_far_above: usize,
    /// Weight of the held-out error beside the fitted one where models are ranked: what is only met where it
    /// was fitted is worth half.
    pub held_out_weight: f64,
    /// Least fall of the rank (a mean of the logarithms of fitted and held-out error) in a round after which
    /// the search goes on: an effect that brings less is removed in the end more often than not.
    pub least_gain: f64,
    /// An extension is not tried where the signatures promise that more than this share of the squares stays.
    pub promises_nothing: f64,
    /// The same at the noise, where all there is to be found is a small share: an effect is tried that
    /// explains so many times the square of the noise. By chance the best of a dozen candidates, each begun
    /// from several values, explains some ten.
    pub seen_in_the_noise: f64,
    /// The same for each effect more: of two models that differ by less, the simpler one is taken.
    pub gain_per_effect: f64,
    /// Probability that anything is rejected or named where nothing differs, over all models and candidates
    /// together.
    pub family_wise: f64,
    /// Two models whose mean squares differ by less than this share of the noise are equivalent: 2 % of the
    /// error.
    pub matters_at_noise: f64,
    /// The same as a share of what remains above the noise: what the library lacks is larger than any
    /// difference below.
    pub matters_of_remainder: f64,
    /// Models whose merit is worse by more than this and the margin are not compared by test: a fit that went
    /// as far as these does not come to it.
    pub in_contention: f64,
    /// An "or" of more effects than this names none of them: five delay a slow motion alike.
    pub alternatives_max: usize,
    /// Models with the same number of moves that are compared by test, at most.
    pub compared_of_a_level: usize,
    /// Simplest models around which moves are tried.
    pub closed_around: usize,
    /// The same over a whole run, at most.
    pub closures_max: usize,
    /// Others that are fitted in the place of an effect, at most.
    pub rivals: usize,
    /// What takes the place of an effect has a signature at least this similar to that of the effect. The
    /// search itself finds what acts in another way.
    pub rival_similarity: f64,
    /// Initial guesses from which the most promising effects are begun.
    pub guesses: usize,
    /// Moves of a simple explanation beside a prior model, at most.
    pub story_max: usize,
    /// A value that moves by less than this share has not changed.
    pub same_value: f64,
    /// An extension whose merit is worse by this much than that of what it extends is not tried again beside
    /// other loops. Without this and the next limit three of four altered recordings end higher from a gain,
    /// in 2.4 times the time.
    pub hopeless: f64,
    /// Effects that are proposed alone beside a model, at most.
    pub singles: usize,
    /// Candidates of which pairs are formed.
    pub paired: usize,
    /// Pairs that are proposed beside a model, at most.
    pub pairs: usize,
    /// A pair is worth a trial where it leaves less than this share of what the better of the two leaves
    /// alone.
    pub better_together: f64,
    /// A model with loops of another kind than the best has comes near it where its merit is worse by less
    /// than this.
    pub loops_come_near: f64,
    /// Seed of all resampling.
    pub seed: u64,
    /// Share by which fitted and held-out error fall where no chance brings that, whatever the signature: of
    /// a few events, as of a ring behind each of some steps, random signs say nothing.
    pub beyond_chance: f64,
    /// A model leaves nothing where its error is below this times the floor in every record.
    pub nothing_left: f64,
    /// A quickly fitted model will leave nothing where its error is below this times the floor.
    pub met: f64,
    /// A verdict explains a data set where fitted and held-out error are below this times the floor.
    pub explained: f64,
    /// A prior model whose residual after a simple explanation is below this times the noise level reached
    /// the noise on its own data: the search goes on.
    pub near_the_noise: f64,
    /// Errors within this of the floor, held out and fitted, count as the floor.
    pub at_floor: f64,
    /// Standard deviations of the floor itself by which they may be further from it: a short rest shows the
    /// noise to some per cent only. With two, 5 of 190 stages at the noise, each with half a second of rest,
    /// were diagnosed as unexplained.
    pub floor_z: f64,
    /// A floor below so many times what rounding leaves is rounding for the most part (half of its squares),
    /// and an error below it no contradiction.
    pub mostly_rounding: f64,
    /// An error below this share of the floor contradicts it.
    pub contradiction: f64,
    /// Signatures more alike than this are confusable.
    pub alike: f64,
    /// A competing model is examined where it explains this share of what the effect in its place does.
    pub rival: f64,
}

/// Thresholds that are shares or probabilities.
const SHARES: [&str; 8] = [
    "family_wise",
    "held_out_weight",
    "promises_nothing",
    "rival_similarity",
    "beyond_chance",
    "contradiction",
    "alike",
    "rival",
];

impl Default for Policy {
    fn default() -> Self {
        Self {
            most_steps: 1e10,
            walked_samples: SEARCHED_SAMPLES,
            weighed_samples: 1_500_000,
            search_samples: 16_000,
            scoring_samples: 8_000,
            evidence_samples: 24_000,
            fit_samples: 300_000,
            width: 2,
            trials: 5,
            effects_max: 7,
            rounds_without_gain: 1,
            rounds_without_gain_far_above: 4,
            held_out_weight: 2.0 / 3.0,
            least_gain: 0.04,
            promises_nothing: 0.99,
            seen_in_the_noise: 30.0,
            gain_per_effect: 0.005,
            family_wise: 0.05,
            matters_at_noise: 0.04,
            matters_of_remainder: 1.0,
            in_contention: 0.25,
            alternatives_max: 5,
            compared_of_a_level: 4,
            closed_around: 1,
            closures_max: 4,
            rivals: 3,
            rival_similarity: 0.6,
            guesses: 2,
            story_max: 3,
            same_value: 0.01,
            hopeless: 0.2,
            singles: 6,
            paired: 9,
            pairs: 3,
            better_together: 0.8,
            loops_come_near: 0.5,
            seed: 1000,
            beyond_chance: 0.5,
            nothing_left: 1.03,
            met: 1.05,
            explained: 1.15,
            near_the_noise: 4.0,
            at_floor: 1.03,
            floor_z: 3.0,
            mostly_rounding: 1.4,
            contradiction: 0.8,
            alike: 0.9,
            rival: 0.5,
        }
    }
}

impl Policy {
    /// Thresholds as TOML; a key that is left out keeps its value. `file_name` is for messages.
    ///
    /// # Errors
    /// A key that is no threshold, or a value of another kind, with its line; a value that is below zero, no
    /// number, or above one where it is a share.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Self> {
        let policy = toml::from_str(text).map_err(|e| {
            Error::new(
                format!("{file_name}: line {}", line_of(text, e.span())),
                e.message(),
            )
        })?;
        let table: toml::Table = toml::from_str(text).unwrap_or_default();
        for (key, value) in &table {
            let (highest, expected) = if SHARES.contains(&key.as_str()) {
                (1.0, "from 0 to 1")
            } else {
                (f64::INFINITY, "not below zero")
            };
            let number = value
                .as_float()
                .or_else(|| value.as_integer().map(|whole| whole as f64));
            if number.is_some_and(|number| !(0.0..=highest).contains(&number)) {
                return Err(Error::new(
                    file_name,
                    format!("{key} = {value}; expected a number {expected}"),
                ));
            }
        }
        Ok(policy)
    }
}
