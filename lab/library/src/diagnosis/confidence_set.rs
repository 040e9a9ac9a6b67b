//! Which of several models the data cannot reject, by their losses alone.
//!
//! # How it works
//! A model's losses are its mean squares by block of every judged record. Models are compared two by two on
//! each record and on the weighted mean of all. Of two models the one with the larger loss is rejected where
//! the difference exceeds a margin that matters by more than chance brings: the difference in standard errors
//! against the largest that a moving-block bootstrap gives over all pairs and records, at 5 % family-wise. The
//! worst goes first, and the rest is compared again until none is rejected: the *model confidence set*
//! (Hansen, Lunde and Nason, Econometrica 79, 2011).

use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeSet;

/// Mean squares of a model by block, of every judged record.
#[derive(Clone, Debug, PartialEq)]
pub struct Losses(pub Vec<Vec<f64>>);

impl Losses {
    /// The mean square on a record.
    #[must_use]
    pub fn mean(&self, record: usize) -> f64 {
        let blocks = &self.0[record];
        blocks.iter().sum::<f64>() / blocks.len().max(1) as f64
    }
}

/// Whether a model stays, and by how many standard errors beyond the margin it is rejected where it does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// The data cannot reject it.
    Kept,
    /// Another one does better by more than the margin, by so many standard errors.
    Rejected(f64),
}

/// How losses are compared: units, weights and margins by record.
pub struct Scale {
    /// Weight of each record in the whole.
    pub weights: Vec<f64>,
    /// Which records are held out.
    pub held_out: Vec<bool>,
    /// Mean square of the best model on each record, um^2, not below its noise.
    pub unit_um2: Vec<f64>,
    /// Differences below this many units do not matter, by record.
    pub margin: Vec<f64>,
    /// Held-out errors that differ by less than this share do not differ.
    pub same_held_out: f64,
    /// A mean square below this share of another needs no test.
    pub beyond_chance: f64,
}

/// Resamples of the blocks.
const RESAMPLES: usize = 400;
/// Neighbouring blocks that are drawn together: what rings beyond one block is not cut.
const DRAWN_TOGETHER: usize = 3;

/// The confidence set of models by their losses: a function of these alone. `size` is the probability that
/// anything is rejected where nothing differs, over all models and records together.
#[must_use]
pub fn confidence_set(losses: &[&Losses], scale: &Scale, size: f64, seed: u64) -> Vec<Fate> {
    Compared::of(scale, losses, seed).eliminated(size)
}

/// Losses in units of the best, with their resamples.
struct Compared {
    /// By what they are compared (each record, then all), by model.
    means: Vec<Vec<f64>>,
    /// The same of each resample.
    resampled: Vec<Vec<Vec<f64>>>,
    /// The weighted mean of the held-out records, by model.
    held_out: Vec<f64>,
    margins: Vec<f64>,
    same_held_out: f64,
    beyond_chance: f64,
}

impl Compared {
    fn of(scale: &Scale, losses: &[&Losses], seed: u64) -> Self {
        let (records, models) = (scale.weights.len(), losses.len());
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let mut means = vec![vec![0.0; models]; records + 1];
        let mut resampled = vec![vec![vec![0.0; models]; RESAMPLES]; records + 1];
        let mut held_out = vec![0.0; models];
        for r in 0..records {
            let count = losses[0].0[r].len();
            let drawn = draws(count, &mut random);
            let blocks =
                DMatrix::from_fn(count, models, |b, m| losses[m].0[r][b] / scale.unit_um2[r]);
            let of_draws = drawn * &blocks;
            for m in 0..models {
                means[r][m] = blocks.column(m).mean();
                means[records][m] += scale.weights[r] * means[r][m];
                held_out[m] += if scale.held_out[r] {
                    scale.weights[r] * means[r][m]
                } else {
                    0.0
                };
                for t in 0..RESAMPLES {
                    resampled[r][t][m] = of_draws[(t, m)];
                    resampled[records][t][m] += scale.weights[r] * of_draws[(t, m)];
                }
            }
        }
        let all = scale
            .weights
            .iter()
            .zip(&scale.margin)
            .map(|(w, m)| w * m)
            .sum();
        Self {
            means,
            resampled,
            held_out,
            margins: scale.margin.iter().copied().chain([all]).collect(),
            same_held_out: scale.same_held_out,
            beyond_chance: scale.beyond_chance,
        }
    }

    /// By how many standard errors one model is worse than another beyond the margin, and the same of every
    /// resample beside its own mean. On one record alone a model counts as worse only if it is also worse
    /// on the mean of all, and the other is not worse on the held-out records.
    fn worse(&self, one: usize, other: usize) -> (f64, Vec<f64>) {
        let all = self.means.len() - 1;
        let mut most = f64::NEG_INFINITY;
        let mut by_chance = vec![f64::NEG_INFINITY; RESAMPLES];
        let in_all = self.means[all][one] - self.means[all][other];
        let holds = self.held_out[other] <= (1.0 + self.same_held_out) * self.held_out[one];
        // Of a few events, as of a ring behind each of some steps, resamples say little; an error that
        // doubles needs no test.
        if self.means[all][other] < self.beyond_chance * self.means[all][one] {
            most = f64::INFINITY;
        }
        for k in 0..=all {
            let by = self.means[k][one] - self.means[k][other];
            let resampled: Vec<f64> = self.resampled[k]
                .iter()
                .map(|m| m[one] - m[other] - by)
                .collect();
            let error = (resampled.iter().map(|d| d * d).sum::<f64>() / RESAMPLES as f64).sqrt();
            if error <= 0.0 {
                continue;
            }
            if k == all || (in_all > 0.0 && holds) {
                most = most.max((by - self.margins[k]) / error);
            }
            by_chance
                .iter_mut()
                .zip(resampled)
                .for_each(|(m, d)| *m = m.max(d / error));
        }
        (most, by_chance)
    }

    /// Rejects the worst until none is worse than another by more than chance.
    fn eliminated(&self, size: f64) -> Vec<Fate> {
        let models = self.means[0].len();
        let pairs: Vec<Vec<(f64, Vec<f64>)>> = (0..models)
            .map(|one| (0..models).map(|other| self.worse(one, other)).collect())
            .collect();
        let mut out = vec![Fate::Kept; models];
        let mut left: BTreeSet<usize> = (0..models).collect();
        loop {
            let worst_of = |one: &usize| {
                left.iter()
                    .filter(|o| *o != one)
                    .map(|o| pairs[*one][*o].0)
                    .fold(f64::NEG_INFINITY, f64::max)
            };
            let mut by_chance: Vec<f64> = vec![f64::NEG_INFINITY; RESAMPLES];
            for (one, other) in left
                .iter()
                .flat_map(|a| left.iter().map(move |b| (*a, *b)))
                .filter(|(a, b)| a != b)
            {
                by_chance
                    .iter_mut()
                    .zip(&pairs[one][other].1)
                    .for_each(|(m, d)| *m = m.max(*d));
            }
            by_chance.sort_by(f64::total_cmp);
            let critical = by_chance[((1.0 - size) * RESAMPLES as f64) as usize];
            let Some((worst, by)) = left
                .iter()
                .map(|one| (*one, worst_of(one)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
            else {
                break;
            };
            if by <= critical {
                break;
            }
            left.remove(&worst);
            out[worst] = Fate::Rejected(by);
        }
        out
    }
}

/// How often each block is drawn in every resample: neighbours together, around the end to the beginning.
fn draws(count: usize, random: &mut Pcg64Mcg) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(RESAMPLES, count);
    let together = DRAWN_TOGETHER.min(count.max(1));
    for t in 0..RESAMPLES {
        let mut drawn = 0;
        while drawn < count {
            let from = random.random_range(0..count);
            for k in 0..together.min(count - drawn) {
                out[(t, (from + k) % count)] += 1.0 / count as f64;
                drawn += 1;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One fitted record rejects no model in favour of another that is worse on held-out records.
    #[test]
    fn what_a_fitted_record_shows_alone_must_hold_out() {
        let scale = Scale {
            weights: vec![1.0 / 3.0, 2.0 / 3.0],
            held_out: vec![false, true],
            unit_um2: vec![1.0; 2],
            margin: vec![1.0; 2],
            same_held_out: 0.04,
            beyond_chance: 0.25,
        };
        let blocks = |level: f64| {
            (0..60)
                .map(|b| level * (1.0 + 0.1 * f64::from(b % 7)))
                .collect::<Vec<f64>>()
        };
        let without = Losses(vec![blocks(3.6), blocks(1.0)]);
        let fates = |held_out: f64| {
            let with = Losses(vec![blocks(1.0), blocks(held_out)]);
            confidence_set(&[&without, &with], &scale, 0.05, 1)
        };
        assert!(matches!(fates(1.0)[..], [Fate::Rejected(_), Fate::Kept]));
        assert_eq!(fates(1.1), [Fate::Kept; 2]);
    }

    fn scale(records: usize, margin: f64) -> Scale {
        Scale {
            weights: vec![1.0 / records as f64; records],
            held_out: vec![false; records],
            unit_um2: vec![1.0; records],
            margin: vec![margin; records],
            same_held_out: 0.04,
            beyond_chance: 0.25,
        }
    }

    /// Mean squares by block around a level, each block off by chance.
    fn around(level: f64, random: &mut Pcg64Mcg) -> Losses {
        Losses(vec![
            (0..60)
                .map(|_| level * (1.0 + 0.3 * (random.random::<f64>() - 0.5)))
                .collect(),
        ])
    }

    /// About as often as the size allows, and not never.
    #[test]
    fn equal_models_are_rejected_as_often_as_the_size_allows() {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        for models in [2, 6, 12] {
            let sets: Vec<Vec<Losses>> = (0..60)
                .map(|_| (0..models).map(|_| around(1.0, &mut random)).collect())
                .collect();
            let rejecting = |size: f64| {
                let rejects = |(seed, losses): &(usize, &Vec<Losses>)| {
                    let all: Vec<&Losses> = losses.iter().collect();
                    let fates = confidence_set(&all, &scale(1, 0.0), size, *seed as u64);
                    fates.iter().any(|fate| *fate != Fate::Kept)
                };
                sets.iter().enumerate().filter(rejects).count()
            };
            let (few, half) = (rejecting(0.05), rejecting(0.5));
            assert!(few <= 9, "{few} of 60 sets of {models}");
            assert!((20..=46).contains(&half), "{half} of 60 sets of {models}");
        }
    }

    #[test]
    fn a_mean_square_is_that_of_its_record() {
        let losses = Losses(vec![vec![1.0, 2.0, 6.0], vec![4.0], Vec::new()]);
        assert_eq!([0, 1, 2].map(|record| losses.mean(record)), [3.0, 4.0, 0.0]);
    }

    /// By how many standard errors one model is worse than another, beyond the margin, where blocks are
    /// independent.
    fn textbook(bad: &Losses, good: &Losses, scale: &Scale) -> f64 {
        let (mut by, mut variance) = (0.0, 0.0);
        for (r, weight) in scale.weights.iter().enumerate() {
            let pairs = bad.0[r].iter().zip(&good.0[r]);
            let unit = scale.unit_um2[r];
            let each: Vec<f64> = pairs.map(|(bad, good)| (bad - good) / unit).collect();
            let count = each.len() as f64;
            let mean = each.iter().sum::<f64>() / count;
            let scatter = each.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / count;
            by += weight * (mean - scale.margin[r]);
            variance += weight * weight * scatter / count;
        }
        by / variance.sqrt()
    }

    /// By the textbook's standard error, where blocks are independent: records count by their weights, in
    /// their units and with their margins.
    #[test]
    fn standard_errors_beyond_the_margin_are_those_of_independent_blocks() {
        let mut random = Pcg64Mcg::seed_from_u64(9);
        let (units, margins, weights) = ([4.0, 0.5], [0.1, 0.2], [0.25, 0.75]);
        let mut of = |levels: [f64; 2]| {
            let record = |(level, unit): (f64, f64)| {
                let of_one = around(level, &mut random).0.remove(0);
                of_one.into_iter().map(|loss| unit * loss).collect()
            };
            Losses(levels.into_iter().zip(units).map(record).collect())
        };
        let (good, bad) = (of([1.0, 1.0]), of([1.5, 1.6]));
        let scale = Scale {
            weights: weights.to_vec(),
            unit_um2: units.to_vec(),
            margin: margins.to_vec(),
            ..scale(2, 0.0)
        };
        let expected = textbook(&bad, &good, &scale);
        let Fate::Rejected(found) = confidence_set(&[&good, &bad], &scale, 0.05, 1)[1] else {
            panic!("kept");
        };
        assert!((found / expected - 1.0).abs() < 0.25, "{found} {expected}");
    }

    /// One record alone speaks against no model that is the better one on all, and only for one that holds
    /// out within the share that does not matter.
    #[test]
    fn one_record_alone_rejects_within_what_all_and_the_held_out_ones_bear() {
        let scale = Scale {
            weights: vec![1.0 / 3.0, 2.0 / 3.0],
            held_out: vec![false, true],
            margin: vec![0.0, 0.1],
            ..scale(2, 0.0)
        };
        let wavy = |level: f64, wave: f64| -> Vec<f64> {
            (0..60)
                .map(|b| level * (1.0 + 1e-3 * (wave * f64::from(b)).sin()))
                .collect()
        };
        let fates = |fitted: [f64; 2], held_out: [f64; 2]| {
            let losses = [0, 1].map(|m| {
                Losses(vec![
                    wavy(fitted[m], 1.0 + m as f64),
                    wavy(held_out[m], 4.0 + m as f64),
                ])
            });
            confidence_set(&losses.each_ref(), &scale, 0.05, 1)
        };
        assert_eq!(fates([1.05, 1.0], [1.0, 1.03]), [Fate::Kept; 2]);
        // On all it is worse by 0.02 to 0.07, which is within the margin there.
        for (fitted, held_out) in [([1.1, 1.0], [1.0, 1.02]), ([1.2, 1.0], [1.0, 1.03])] {
            assert!(matches!(
                fates(fitted, held_out)[..],
                [Fate::Rejected(_), Fate::Kept]
            ));
        }
        assert_eq!(fates([1.13, 1.0], [1.0, 1.05]), [Fate::Kept; 2]);
    }

    /// Models whose errors on all records are the same, to the last bit.
    #[test]
    fn records_that_contradict_each_other_reject_nothing() {
        let blocks = |level: f64, step: usize| -> Vec<f64> {
            let wave = |b| [0.25, -0.25, 0.0][b % step];
            (0..60).map(|b| level + wave(b)).collect()
        };
        let one = Losses(vec![blocks(2.0, 2), blocks(1.0, 2)]);
        let other = Losses(vec![blocks(1.0, 3), blocks(2.0, 3)]);
        let fates = confidence_set(&[&one, &other], &scale(2, 0.1), 0.05, 1);
        assert_eq!(fates, [Fate::Kept; 2]);
    }

    /// Of losses without any chance there is no standard error, and four times the error is not yet beyond
    /// chance.
    #[test]
    fn what_needs_no_test_lies_beyond_the_share_and_not_at_it() {
        // Shares of 64 blocks add up to one without rounding.
        let of = |level: f64| Losses(vec![vec![level; 64]]);
        let fates = |level: f64| confidence_set(&[&of(level), &of(1.0)], &scale(1, 0.0), 0.05, 1);
        assert_eq!(fates(4.0), [Fate::Kept; 2]);
        assert_eq!(fates(4.25), [Fate::Rejected(f64::INFINITY), Fate::Kept]);
    }

    #[test]
    fn the_unit_of_a_record_changes_no_bit() {
        let mut random = Pcg64Mcg::seed_from_u64(13);
        let losses = [1.0, 1.3].map(|level| around(level, &mut random));
        let in_unit = |unit: f64| {
            let scaled = losses.each_ref().map(|of_model| {
                let blocks = of_model.0[0].iter().map(|loss| unit * loss).collect();
                Losses(vec![blocks])
            });
            let scale = Scale {
                unit_um2: vec![unit],
                ..scale(1, 0.1)
            };
            confidence_set(&scaled.each_ref(), &scale, 0.05, 1)
        };
        assert!(matches!(in_unit(1.0)[1], Fate::Rejected(by) if by.is_finite()));
        assert_eq!(in_unit(0.125), in_unit(1.0));
    }

    /// A held-out record on which the other model is worse silences single records, and not the mean of all:
    /// by the textbook's standard error, with weights and margins.
    #[test]
    fn the_mean_of_all_records_counts_where_no_single_one_does() {
        let mut random = Pcg64Mcg::seed_from_u64(12);
        let (weights, margins) = ([0.4, 0.6], [0.05, 0.2]);
        let mut of = |levels: [f64; 2]| {
            Losses(
                levels
                    .map(|level| around(level, &mut random).0.remove(0))
                    .into(),
            )
        };
        let (bad, good) = (of([2.0, 1.0]), of([1.0, 1.1]));
        let scale = Scale {
            weights: weights.to_vec(),
            held_out: vec![false, true],
            margin: margins.to_vec(),
            ..scale(2, 0.0)
        };
        let expected = textbook(&bad, &good, &scale);
        let Fate::Rejected(found) = confidence_set(&[&bad, &good], &scale, 0.05, 1)[0] else {
            panic!("kept");
        };
        assert!((found / expected - 1.0).abs() < 0.25, "{found} {expected}");
    }

    #[test]
    fn resamples_draw_neighbours_together_and_each_block_as_often() {
        let mut random = Pcg64Mcg::seed_from_u64(10);
        for count in [1, 2, 3, 7, 60] {
            let drawn = draws(count, &mut random);
            for row in drawn.row_iter() {
                assert!((row.sum() - 1.0).abs() < 1e-12, "{count}");
            }
            // 400 resamples: some per cent.
            for column in drawn.column_iter() {
                let share = column.mean() * count as f64;
                assert!((share - 1.0).abs() < 0.2, "{count}: {share}");
            }
        }
        let drawn = draws(60, &mut random);
        let is_drawn = |t: usize, k: usize| drawn[(t, k % 60)] > 0.0;
        let with_a_neighbour = (0..RESAMPLES)
            .flat_map(|t| (0..60).map(move |k| (t, k)))
            .all(|(t, k)| !is_drawn(t, k) || is_drawn(t, k + 1) || is_drawn(t, k + 59));
        assert!(with_a_neighbour);
        assert!((0..RESAMPLES).any(|t| (0..60).any(|k| !is_drawn(t, k))));
    }

    #[test]
    fn a_model_beyond_the_margin_is_rejected_whatever_stands_beside_it() {
        let mut random = Pcg64Mcg::seed_from_u64(8);
        let levels = [1.0, 1.02, 1.3, 5.0];
        let losses = levels.map(|level| around(level, &mut random));
        let fates = confidence_set(&losses.each_ref(), &scale(1, 0.1), 0.05, 1);
        assert_eq!(fates[..2], [Fate::Kept; 2], "{fates:?}");
        assert!(
            matches!(fates[2], Fate::Rejected(by) if by.is_finite()),
            "{fates:?}"
        );
        assert_eq!(fates[3], Fate::Rejected(f64::INFINITY));
        // The same whatever the order.
        let [a, b, c, d] = &losses;
        let turned = confidence_set(&[d, c, b, a], &scale(1, 0.1), 0.05, 1);
        assert_eq!(turned.iter().rev().copied().collect::<Vec<_>>(), fates);
        assert_eq!(confidence_set(&[a], &scale(1, 0.1), 0.05, 1), [Fate::Kept]);
    }

    /// What is on the readings.
    #[derive(Clone, Copy, Debug)]
    enum Noise {
        White,
        OneOverF,
        Quantised,
        Hum,
    }

    const SAMPLES: usize = 3000;

    fn normal(random: &mut Pcg64Mcg) -> f64 {
        let [a, b] = [random.random::<f64>(), random.random::<f64>()];
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    /// A sine of so many cycles in the record.
    fn sine(cycles: f64, phase: f64) -> impl Fn(usize) -> f64 {
        let step = std::f64::consts::TAU * cycles / SAMPLES as f64;
        move |k| (step * k as f64 + phase).sin()
    }

    impl Noise {
        /// Readings of a slow motion with this noise, less the motion; RMS of about one.
        fn of_a_record(self, random: &mut Pcg64Mcg) -> Vec<f64> {
            let phase = std::f64::consts::TAU * random.random::<f64>();
            match self {
                Self::White => (0..SAMPLES).map(|_| normal(random)).collect(),
                Self::OneOverF => {
                    // Relaxations an octave apart, of equal variance: 1/f from one cycle in two records on.
                    let mut states = [0.0f64; 12];
                    states.iter_mut().for_each(|x| *x = normal(random));
                    (0..SAMPLES)
                        .map(|_| {
                            for (octave, state) in states.iter_mut().enumerate() {
                                let keeps = (-(0.5f64.powi(octave as i32))).exp();
                                *state =
                                    keeps * *state + (1.0 - keeps * keeps).sqrt() * normal(random);
                            }
                            states.iter().sum::<f64>() / 12f64.sqrt()
                        })
                        .collect()
                }
                Self::Quantised => {
                    // Steps of three times the noise's standard deviation.
                    let motion = sine(2.0 + 3.0 * random.random::<f64>(), phase);
                    (0..SAMPLES)
                        .map(|k| {
                            let (is_um, step_um) = (20.0 * motion(k), 2.5);
                            ((is_um + 0.8 * normal(random)) / step_um).round() * step_um - is_um
                        })
                        .collect()
                }
                Self::Hum => {
                    let hum = sine(150.0 * (1.0 + 0.01 * normal(random)), phase);
                    (0..SAMPLES)
                        .map(|k| 0.7 * normal(random) + hum(k))
                        .collect()
                }
            }
        }
    }

    /// In how many of so many cases anything is rejected of models that are equally good: what they miss is a
    /// sine of another frequency each, of `missed` times the noise. A fitted and a held-out record differ in
    /// their noise by up to a quarter, as repeats do.
    fn rejections(noise: Noise, models: usize, missed: f64, margin: f64, cases: u64) -> usize {
        let mut random = Pcg64Mcg::seed_from_u64(11);
        let mut case = |seed: u64| {
            let mut losses = vec![Losses(Vec::new()); models];
            for _ in 0..2 {
                let level = 0.8 + 0.45 * random.random::<f64>();
                let noise = noise.of_a_record(&mut random);
                for of_model in &mut losses {
                    let cycles = 100f64.powf(random.random::<f64>());
                    let misses = sine(cycles, std::f64::consts::TAU * random.random::<f64>());
                    let left: Vec<f64> = (0..SAMPLES)
                        .map(|k| level * noise[k] + missed * 2f64.sqrt() * misses(k))
                        .collect();
                    let mean = left.iter().sum::<f64>() / SAMPLES as f64;
                    let block = |b: &[f64]| {
                        b.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / b.len() as f64
                    };
                    of_model
                        .0
                        .push(left.chunks(SAMPLES / 60).map(block).collect());
                }
            }
            let scale = Scale {
                weights: vec![1.0 / 3.0, 2.0 / 3.0],
                held_out: vec![false, true],
                ..scale(2, margin)
            };
            let all: Vec<&Losses> = losses.iter().collect();
            let fates = confidence_set(&all, &scale, 0.05, seed);
            fates.iter().any(|fate| *fate != Fate::Kept)
        };
        (0..cases).filter(|seed| case(*seed)).count()
    }

    /// Wrong rejections of so many cases with the margin that a search has above this noise, and without any;
    /// printed and held against the 5 % that are promised.
    fn print_rejections(missed: f64, models: usize, cases: u64) {
        let remains = missed * missed / (1.0 + missed * missed);
        for noise in [Noise::White, Noise::OneOverF, Noise::Quantised, Noise::Hum] {
            let of = |margin| rejections(noise, models, missed, margin, cases);
            let used = of(0.04 * (1.0 - remains) + remains);
            println!(
                "{noise:?}, {models} models that miss {missed} of the noise: {used} of {cases}, without a margin {}",
                of(0.0)
            );
            assert!(20 * used as u64 <= cases, "{noise:?}: {used} of {cases}");
        }
    }

    #[test]
    fn equally_good_models_are_rejected_in_few_cases_of_any_noise() {
        print_rejections(0.2, 5, 60);
    }

    mod long {
        #[test]
        #[ignore = "500 cases of each noise, for cargo xtask full"]
        fn equally_good_models_are_rejected_in_few_of_500_cases_of_any_noise() {
            for missed in [0.1, 0.2, 0.3] {
                super::print_rejections(missed, 2, 500);
                super::print_rejections(missed, 5, 500);
            }
        }
    }
}
