//! Which effect is missing in which channel or mode.
//!
//! Every candidate is an effect in a channel or mode. All are scored by the same rule: the fall of the
//! error on held-out records. The linearised fall of all candidates decides which are fitted; the fitted
//! fall decides which joins. When none lowers the error any more, every effect is taken out once, and
//! everything else is tried in its place. An effect without which the error is no larger is removed. An
//! effect that another one replaces as well is reported with an "or".
//!
//! Where a model of the measured responses has more effects than a search adds one by one, the search begins
//! with all of these (`all_responses`) and does not test them.

use super::all_responses::{from_least_to_most_drive, responses_beyond};
use super::fit::{Problem, STRETCHES, Signals, rms};
use super::recordings::AxesData;
use super::residual_spectra::ResidualSpectra;
use super::structure::{AxisEffect, Described, Free};
use crate::dataset::Role;
use crate::identification::budget::Budget;
use crate::identification::nuisance_terms::transposed_times;
use crate::identification::work::Stage;
use crate::least_squares::Problem as _;
use crate::least_squares::damped_solution;
use crate::parallel;
use crate::watch::{Watch, WatchEvent};
use nalgebra::{DMatrix, DVector};

/// Thresholds of the search.
#[derive(Clone, Copy, Debug)]
pub struct AxesPolicy {
    /// A fall of the error counts when chance gives it with a smaller probability: three standard errors.
    pub p_value: f64,
    /// And when the RMS error changes by such a share: less is of no use to a reader of the model.
    pub least_share: f64,
    /// An error of so many times the noise is the noise: the scatter of few periods shows it no better.
    pub at_the_noise: f64,
    /// Candidates that are fitted in a step, the best by their linearised falls.
    pub fitted: usize,
    /// Most effects of a model.
    pub effects_max: usize,
}

impl Default for AxesPolicy {
    fn default() -> Self {
        Self {
            p_value: 1.35e-3,
            least_share: 0.01,
            at_the_noise: 1.02,
            fitted: 4,
            effects_max: 60,
        }
    }
}

/// An effect that joined.
#[derive(Clone, Debug)]
pub struct Joined {
    /// The effect in its channel.
    pub effect: AxisEffect,
    /// In words, with the values of that step.
    pub named: String,
    /// Held-out error before, weighted RMS: in times the noise where the records show it.
    pub before: f64,
    /// And after.
    pub after: f64,
}

/// An effect of the final model with what the data say about it.
#[derive(Clone, Debug)]
pub struct AxisFinding {
    /// The effect in its channel.
    pub effect: AxisEffect,
    /// In words.
    pub named: String,
    /// Held-out error without it, everything else fitted again.
    pub without: f64,
    /// Effects that do as well in its place: it is one of all these.
    pub or: Vec<(AxisEffect, String)>,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct AxesFound {
    /// The model.
    pub model: Described,
    /// Modes of the measured responses that it began with, which are not tested.
    pub modes_at_first: usize,
    /// How it grew.
    pub steps: Vec<Joined>,
    /// Its effects.
    pub findings: Vec<AxisFinding>,
    /// Effects of the model that nothing was tried in the place of, in words: the budget ended before.
    pub untested: Vec<String>,
    /// The caller wanted the best so far.
    pub stopped: bool,
    /// The budget ended before nothing more was found.
    pub ended_early: bool,
    /// Held-out error, weighted RMS: in times the noise where the records show it.
    pub error: f64,
    /// That error on the records that were fitted.
    pub fitted_error: f64,
    /// Whether errors are in times the noise.
    pub in_times_the_noise: bool,
    /// RMS of every sensor's error on the held-out records, in its unit.
    pub held_out_rms: Vec<f64>,
    /// RMS of every sensor's reading.
    pub reading_rms: Vec<f64>,
}

/// A candidate with a first guess.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    effect: AxisEffect,
    guess: [f64; 2],
}

/// An effect that joins, the model with it, fitted, and what judges that.
type FittedEffect = (AxisEffect, Described, Vec<f64>);

/// A candidate with its linearised fall and the values there.
struct Scored {
    candidate: Candidate,
    predicted: f64,
    start: Described,
}

/// Frequencies of a scan for a mode stand apart by this share: about the width of a mode with the smaller
/// damping ratio of the scan.
const SCAN_APART: f64 = 0.03;
const SCAN_DAMPING: [f64; 2] = [0.015, 0.08];
/// Lowest frequency of a scan, in turns of the record, and highest, of the sampling rate.
const SCAN_FROM_TURNS: f64 = 8.0;
const SCAN_TO: f64 = 0.45;
/// Motions within which friction may build up, of the reach of the mode.
const FRICTION_BENDS: [f64; 3] = [0.02, 0.08, 0.3];
/// Steps of a fit during the search, and of the last one.
const STEPS_OF_SEARCH: usize = 6;
const STEPS_OF_LAST: usize = 20;
/// A step that lowers the squares by less ends a fit: during the search half of what matters, and at the end
/// nothing that a reader sees.
const FALL_OF_SEARCH: f64 = 1e-2;
const FALL_OF_LAST: f64 = 1e-4;

/// Finds the effects of a data set, beside those of a model to start from: all of them, or the best so far where
/// the budget or the caller ends it.
#[must_use]
pub fn find(
    data: &AxesData,
    start: &Described,
    policy: &AxesPolicy,
    watch: &dyn Watch,
) -> AxesFound {
    let budget = Budget::of_time(watch);
    let problem = Problem::new(data).within(budget.clone());
    let beyond = || responses_beyond(&problem, policy.effects_max);
    let responses = start.effects.is_empty().then(beyond).flatten();
    let few = responses.is_some().then(|| from_least_to_most_drive(data));
    let start = responses.as_ref().unwrap_or(start);
    let raced = Problem::new(few.as_ref().unwrap_or(data)).within(budget.clone());
    let search = Search {
        problem: &raced,
        policy,
        watch,
        budget: &budget,
    };
    budget.work.enter(Stage::Search);
    let mut model = raced.fit(start, STEPS_OF_LAST, FALL_OF_LAST);
    let given = model.effects.len();
    let mut judged = raced.judged(&model.stage);
    let mut steps = Vec::new();
    let mut ended_early = false;
    while model.effects.len() < given + policy.effects_max && !search.at_the_noise(&judged) {
        ended_early = search.is_over();
        if ended_early {
            break;
        }
        let names: Vec<String> = steps
            .iter()
            .map(|step: &Joined| step.named.clone())
            .collect();
        let joined = search.step(&model, &judged, &names);
        if joined.is_empty() {
            ended_early = search.is_over();
            break;
        }
        for (effect, next, next_judged) in joined {
            steps.push(Joined {
                effect,
                named: effect.named(&next.stage, data),
                before: rms(&judged),
                after: rms(&next_judged),
            });
            (model, judged) = (next, next_judged);
        }
    }
    budget.work.enter(Stage::Closure);
    model = raced.fit(&model, STEPS_OF_LAST, FALL_OF_LAST);
    budget.work.enter(Stage::Ablation);
    let (mut model, findings, untested) = search.question(model, given);
    if few.is_some() {
        budget.work.enter(Stage::Report);
        model = problem.fit(&model, STEPS_OF_LAST, FALL_OF_LAST);
    }
    let judged = problem.judged(&model.stage);
    AxesFound {
        modes_at_first: responses.map_or(0, |model| model.stage.modes.len()),
        steps,
        findings,
        untested,
        stopped: budget.is_stopped(),
        ended_early,
        error: rms(&judged),
        fitted_error: problem.cost(&model.stage, Role::Identify).sqrt(),
        in_times_the_noise: problem.noise_known,
        held_out_rms: problem.errors(&model.stage, Role::Validate),
        reading_rms: problem.scales.reading_rms.clone(),
        model,
    }
}

/// Share of all flips of signs that lower the sum of the differences no less. Stretches of several records at
/// the same place count together, so that all flips can be tried.
fn by_chance(better: &[f64], worse: &[f64]) -> f64 {
    let mut differences = [0.0; STRETCHES];
    worse
        .iter()
        .zip(better)
        .enumerate()
        .for_each(|(n, (w, b))| differences[n % STRETCHES] += w - b);
    let observed: f64 = differences.iter().sum();
    // One flip after the other, in the order of Gray's code. What rounding leaves of a sum is no fall.
    let least = observed - 1e-9 * differences.iter().map(|d| d.abs()).sum::<f64>();
    let mut sum = observed;
    let mut as_low = 1_u32;
    for n in 1_u32..1 << STRETCHES {
        let flipped = n.trailing_zeros() as usize;
        sum -= 2.0 * differences[flipped];
        differences[flipped] = -differences[flipped];
        as_low += u32::from(sum >= least);
    }
    f64::from(as_low) / f64::from(1_u32 << STRETCHES)
}

struct Search<'p> {
    problem: &'p Problem<'p>,
    policy: &'p AxesPolicy,
    watch: &'p dyn Watch,
    budget: &'p Budget<'p>,
}

impl Search<'_> {
    fn is_over(&self) -> bool {
        self.budget.is_stopped() || self.budget.is_over()
    }

    fn at_the_noise(&self, judged: &[f64]) -> bool {
        self.problem.noise_known && rms(judged) < self.policy.at_the_noise
    }

    /// Whether `better` has a smaller error than `worse`, beyond chance and by a share that matters. Chance
    /// is judged by flipping signs: a beat of two drives makes the errors of a few stretches a hundred
    /// times those of the others, which no standard error describes.
    fn is_better(&self, better: &[f64], worse: &[f64]) -> bool {
        rms(better) < (1.0 - self.policy.least_share) * rms(worse)
            && by_chance(better, worse) < self.policy.p_value
    }

    /// The candidate that lowers the held-out error most, fitted; where none does, two that do together; else
    /// nothing.
    fn step(&self, model: &Described, judged: &[f64], beside: &[String]) -> Vec<FittedEffect> {
        let candidates = self.candidates(model);
        self.watch.event(&WatchEvent::Scoring {
            candidates: candidates.len(),
            beside,
        });
        let fitted = self.fitted(self.scored(model, &candidates), self.policy.fitted);
        if let Some(one) = self.lowest(fitted.clone(), judged) {
            return vec![one];
        }
        let mut lowest: Option<[FittedEffect; 2]> = None;
        for first in fitted {
            if self.is_over() {
                break;
            }
            let candidates = self.candidates(&first.1);
            let second = self.fitted(self.scored(&first.1, &candidates), self.policy.fitted);
            let falls = |other: &FittedEffect| {
                (lowest.as_ref()).is_none_or(|pair| rms(&other.2) < rms(&pair[1].2))
            };
            if let Some(second) = self.lowest(second, judged).filter(falls) {
                lowest = Some([first, second]);
            }
        }
        lowest.map_or_else(Vec::new, Vec::from)
    }

    /// Of effects whose model is better than what is judged: the one with the fewest numbers of those that are
    /// as good as the best.
    fn lowest(&self, fitted: Vec<FittedEffect>, judged: &[f64]) -> Option<FittedEffect> {
        let better: Vec<_> = fitted
            .into_iter()
            .filter(|(_, _, with)| self.is_better(with, judged))
            .collect();
        let lowest = better
            .iter()
            .min_by(|a, b| rms(&a.2).total_cmp(&rms(&b.2)))?
            .2
            .clone();
        let as_good = better
            .into_iter()
            .filter(|(_, _, with)| !self.is_better(&lowest, with));
        as_good.min_by(|a, b| {
            (a.1.parameters(), rms(&a.2))
                .partial_cmp(&(b.1.parameters(), rms(&b.2)))
                .unwrap_or(std::cmp::Ordering::Equal)
        })
    }

    /// The best candidates by their linearised falls, fitted, with what judges them.
    fn fitted(&self, scored: Vec<Scored>, count: usize) -> Vec<FittedEffect> {
        let best: Vec<Scored> = scored.into_iter().take(count).collect();
        self.budget.while_it_lasts(&best, |scored| {
            let fitted = self
                .problem
                .fit(&scored.start, STEPS_OF_SEARCH, FALL_OF_SEARCH);
            let judged = self.problem.judged(&fitted.stage);
            (scored.candidate.effect, fitted, judged)
        })
    }

    /// Takes every effect out once: removes those without which the error is no larger, and finds what does
    /// as well in the place of the others. Then come, in words, those that the budget did not reach: a fit that
    /// it ends says nothing.
    fn question(
        &self,
        mut model: Described,
        given: usize,
    ) -> (Described, Vec<AxisFinding>, Vec<String>) {
        loop {
            let judged = self.problem.judged(&model.stage);
            let effects: Vec<AxisEffect> = model.effects[given..].to_vec();
            let without = self.budget.while_it_lasts(&effects, |effect| {
                let fitted =
                    self.problem
                        .fit(&model.without(*effect), STEPS_OF_SEARCH, FALL_OF_SEARCH);
                let without = self.problem.judged(&fitted.stage);
                (fitted, without)
            });
            let is_over = self.is_over();
            // The one that is missed least goes first: another one may take its place.
            let idle = without
                .iter()
                .filter(|(_, without)| !self.is_better(&judged, without));
            let idle = idle.min_by(|a, b| rms(&a.1).total_cmp(&rms(&b.1)));
            if let Some((fitted, _)) = idle.filter(|_| !is_over) {
                model = fitted.clone();
                continue;
            }
            let (mut findings, mut untested) = (Vec::new(), Vec::new());
            // What is missed most comes first: little does as well, and the budget may end.
            let missed = |n: &usize| without.get(*n).map_or(0.0, |(_, without)| rms(without));
            let mut order: Vec<usize> = (0..effects.len()).collect();
            order.sort_by(|a, b| missed(b).total_cmp(&missed(a)));
            for n in order {
                let effect = &effects[n];
                let named = effect.named(&model.stage, self.problem.data);
                let tested = without.get(n).filter(|_| !self.is_over());
                let instead = tested.map(|(fitted, without)| {
                    (rms(without), self.instead(*effect, &judged, &model, fitted))
                });
                match instead.filter(|_| !self.is_over()) {
                    Some((without, or)) => findings.push(AxisFinding {
                        effect: *effect,
                        named,
                        without,
                        or,
                    }),
                    None => untested.push(named),
                }
            }
            return (model, findings, untested);
        }
    }

    /// Single effects that do as well as `effect` beside the rest of the model.
    fn instead(
        &self,
        effect: AxisEffect,
        judged: &[f64],
        model: &Described,
        without: &Described,
    ) -> Vec<(AxisEffect, String)> {
        // Another mode that the same drive moves at the same sensor is the same effect.
        let same = |other: AxisEffect| match (effect, other) {
            (
                AxisEffect::Vibration { drive, sensor, .. },
                AxisEffect::Vibration {
                    drive: d,
                    sensor: s,
                    ..
                },
            ) => (drive, sensor) == (d, s),
            _ => effect == other,
        };
        // Where a mode goes, what stands on it goes too: no single effect replaces all of them.
        if model.effects.len() != without.effects.len() + 1 {
            return Vec::new();
        }
        let candidates: Vec<Candidate> = self
            .candidates(without)
            .into_iter()
            .filter(|candidate| !same(candidate.effect))
            .collect();
        let fitted = self.fitted(self.scored(without, &candidates), self.policy.fitted);
        // What needs more numbers for the same error is no explanation beside this one.
        let simple = fitted
            .into_iter()
            .filter(|(_, fitted, _)| fitted.parameters() <= model.parameters());
        let as_good = simple.filter(|(_, _, with)| !self.is_better(judged, with));
        as_good
            .map(|(other, fitted, _)| (other, other.named(&fitted.stage, self.problem.data)))
            .collect()
    }

    /// Every effect in every channel and mode where it is not yet.
    fn candidates(&self, model: &Described) -> Vec<Candidate> {
        let (drives, sensors, modes) = (
            model.stage.drives.len(),
            model.stage.sensors.len(),
            model.stage.modes.len(),
        );
        let mut effects = Vec::new();
        for drive in 0..drives {
            effects.extend([
                AxisEffect::Hysteresis { drive },
                AxisEffect::Creep { drive },
                AxisEffect::Delay { drive },
            ]);
            effects.extend((0..sensors).map(|sensor| AxisEffect::Feedthrough { drive, sensor }));
            let moves = |mode: usize| model.stage.modes[mode].of_drives[drive] != 0.0;
            effects.extend(
                (0..modes)
                    .filter(|mode| !moves(*mode))
                    .map(|mode| AxisEffect::DriveCoupling { drive, mode }),
            );
        }
        for sensor in 0..sensors {
            effects.push(AxisEffect::SensorBandwidth { sensor });
            let sees = |mode: usize| model.stage.modes[mode].of_sensors[sensor] != 0.0;
            effects.extend(
                (0..modes)
                    .filter(|mode| !sees(*mode))
                    .map(|mode| AxisEffect::SensorCoupling { mode, sensor }),
            );
        }
        effects.extend((0..modes).map(|mode| AxisEffect::NonlinearStiffness { mode }));
        let reach = self.problem.scales.reach();
        let mut out: Vec<Candidate> = effects
            .into_iter()
            .map(|effect| Candidate {
                effect,
                guess: [0.0; 2],
            })
            .collect();
        for mode in 0..modes {
            out.extend(FRICTION_BENDS.map(|share| Candidate {
                effect: AxisEffect::Friction { mode },
                guess: [share * reach, 0.0],
            }));
        }
        let signals = self.problem.simulate(&model.stage);
        for drive in 0..drives {
            let reach = self.problem.extension_reach(&model.stage, &signals, drive);
            let of_actuator = [
                AxisEffect::ActuatorHysteresis { drive },
                AxisEffect::ActuatorSoftening { drive },
            ];
            let candidate = |effect| Candidate {
                effect,
                guess: [reach, 0.0],
            };
            out.extend(
                of_actuator
                    .map(candidate)
                    .into_iter()
                    .filter(|_| reach > 0.0),
            );
        }
        out.retain(|candidate| !model.effects.contains(&candidate.effect));
        out.extend(self.modes_in_the_residual(model, &signals));
        out
    }

    /// For every drive and sensor the frequency and damping at which one more mode follows the residual best.
    fn modes_in_the_residual(&self, model: &Described, signals: &Signals) -> Vec<Candidate> {
        let problem = self.problem;
        let residual = problem.residual(signals, Role::Identify);
        let (drives, sensors) = (model.stage.drives.len(), model.stage.sensors.len());
        let scales = &problem.scales;
        let (from_hz, to_hz) = (SCAN_FROM_TURNS / scales.duration_s, SCAN_TO / scales.dt_s);
        let count = ((to_hz / from_hz).ln() / SCAN_APART).ceil().max(1.0) as usize;
        let frequency_hz = |f: usize| from_hz * (SCAN_APART * f as f64).exp();
        let tried: Vec<(usize, usize, f64)> = (0..drives)
            .flat_map(|drive| {
                (0..count).flat_map(move |f| SCAN_DAMPING.map(|damping| (drive, f, damping)))
            })
            .collect();
        let mode = model.stage.modes.len();
        // Of each: by how much it lowers the squares of every sensor.
        let spectra = ResidualSpectra::from_residual(problem, signals, &residual);
        let falls = parallel::map(&tried, |(drive, f, damping)| {
            spectra.falls_by_mode(*drive, frequency_hz(*f), *damping)
        });
        let pairs: Vec<(usize, usize)> = (0..drives)
            .flat_map(|drive| (0..sensors).map(move |sensor| (drive, sensor)))
            .collect();
        let candidate = |(drive, sensor): &(usize, usize)| {
            let of_drive = tried.iter().zip(&falls).filter(|((d, _, _), _)| d == drive);
            let ((_, f, damping), _) =
                of_drive.max_by(|a, b| a.1[*sensor].total_cmp(&b.1[*sensor]))?;
            let guess = spectra.refined(*drive, *sensor, [frequency_hz(*f), *damping], SCAN_APART);
            Some(Candidate {
                effect: AxisEffect::Vibration {
                    mode,
                    drive: *drive,
                    sensor: *sensor,
                },
                guess,
            })
        };
        parallel::map(&pairs, candidate)
            .into_iter()
            .flatten()
            .collect()
    }

    /// Candidates by the held-out error that their linearised fits predict, the best first; of each effect
    /// its best guess.
    fn scored(&self, model: &Described, candidates: &[Candidate]) -> Vec<Scored> {
        let roles = [Role::Identify, Role::Validate];
        let problem = self.problem;
        let rows = problem.linearised(model, &roles);
        let signals = problem.simulate(&model.stage);
        let own = model.free();
        let gram_of_own = transposed_times(&rows[0].columns, &rows[0].columns);
        let score = |candidate: &Candidate| -> Option<Scored> {
            if !problem.goes_on() {
                return None;
            }
            let with = model.with(candidate.effect, candidate.guess, &problem.scales);
            // At first the shape of what does nothing has no derivative.
            let shapes = |free: &Free| {
                matches!(
                    free,
                    Free::LogFrequency(_)
                        | Free::LogDamping(_)
                        | Free::LogFrictionBend(_)
                        | Free::LogHalfAt(_)
                        | Free::Compliance(_)
                )
            };
            let new: Vec<Free> = with
                .free_of(candidate.effect)
                .into_iter()
                .filter(|free| !shapes(free))
                .collect();
            let columns = problem.columns_beside(&with, &signals, &new, &roles);
            let solved = Linearised::new(
                &gram_of_own,
                &rows[0].columns,
                &columns[0],
                &rows[0].residual,
            );
            let step = damped_solution(&solved.gram, &solved.against, 1e-9)?;
            let left = &rows[1].residual
                - &rows[1].columns * step.rows(0, own.len())
                - &columns[1] * step.rows(own.len(), new.len());
            let mut start = with;
            for (free, by) in new.iter().zip(step.rows(own.len(), new.len()).iter()) {
                let value = free.get(&start.stage) + by;
                free.set(&mut start.stage, value);
            }
            Some(Scored {
                candidate: *candidate,
                predicted: left.norm_squared(),
                start,
            })
        };
        let mut scored: Vec<Scored> = parallel::map(candidates, score)
            .into_iter()
            .flatten()
            .collect();
        scored.sort_by(|a, b| a.predicted.total_cmp(&b.predicted));
        let mut seen = Vec::new();
        scored.retain(|scored| {
            let new = !seen.contains(&scored.candidate.effect);
            seen.push(scored.candidate.effect);
            new
        });
        scored
    }
}

/// Normal equations of the columns of a model and those of a candidate.
struct Linearised {
    gram: DMatrix<f64>,
    against: DVector<f64>,
}

impl Linearised {
    fn new(
        gram_of_own: &DMatrix<f64>,
        own: &DMatrix<f64>,
        new: &DMatrix<f64>,
        residual: &DVector<f64>,
    ) -> Self {
        let (p, c) = (own.ncols(), new.ncols());
        let mut gram = DMatrix::zeros(p + c, p + c);
        gram.view_mut((0, 0), (p, p)).copy_from(gram_of_own);
        let across = transposed_times(own, new);
        gram.view_mut((0, p), (p, c)).copy_from(&across);
        gram.view_mut((p, 0), (c, p)).copy_from(&across.transpose());
        gram.view_mut((p, p), (c, c))
            .copy_from(&transposed_times(new, new));
        let mut against = DVector::zeros(p + c);
        against.rows_mut(0, p).copy_from(&own.tr_mul(residual));
        against.rows_mut(p, c).copy_from(&new.tr_mul(residual));
        Self { gram, against }
    }
}
