//! The design that holds for all plants that the recording leaves possible.
//!
//! # How it works
//! Each candidate of a family of laws ([`Family`]; the tunings of [`super::predictor`] go from a few rad/s of
//! bandwidth to beyond the first mode) must
//!
//! 1. be stable by the eigenvalues of the sampled loop on every member of a set: gain -50 % to +50 %, up to
//!    a period more of delay, up to twice the mass, and modes moved by up to three standard deviations
//!    (never less than [`LEAST_FREQUENCY_SPREAD`] and [`LEAST_DAMPING_SPREAD`], since a stated deviation can
//!    be too small where a model lacks something). A resonance that moves can make a loop unstable on its
//!    way and stable again at the end of it, so each range is a row of members ([`super::plant_set`]);
//! 2. keep its largest sensitivity;
//! 3. stay stable on every member where the drive stands at a limit for part of a cycle
//!    ([`PredictorDesign::at_a_limit`]): what throws it to a limit must not keep it there;
//! 4. stay stable with any linear response added that the recording does not exclude: `|K S| W <= 1` at every
//!    frequency up to half the sampling rate (small gain, so whatever the phase and the number of modes),
//!    where `K S` is the answer of the drive to the reading and `W` the largest missing response: the
//! recording's level ([`ServoRecording`]), at most the peak of an unknown mode ([`UNKNOWN_MODE_PEAK`]),
//! times the spread of the gain.
//!
//! Of those that do, and whose gains have a place in the tick's integers, the one with the least expected
//! error is taken, among those with the usual margins ([`Candidate::keeps_usual_margins`]) where that costs
//! less than a third of the error: noise passed on, and the error of the hysteresis model at the highest
//! frequency of references and at a tenth of it (times what a reference becomes at worst where the order
//! lets the first mode move: [`MovingMode`]). From there the tuning is refined between the points of the
//! scan, with the fast noise of [`PredictorTuning::fast_noise_um`] as one number more. What the fourth
//! condition costs is found by leaving it out, and told. Where the mass alone keeps every candidate from
//! being taken the range of the mass becomes smaller ([`HELD_MASSES`]), and the design reports it.
use super::assessment::{Assessment, assess};
use super::candidate::{
    Broken, Candidate, Family, Scan, holds, holds_if_recorded, holds_with_usual_margins,
};
use super::law::PredictorDesign;
use super::model::{LinearModel, ModeModel, SampledModel};
use super::moving_mode::MovingMode;
use super::plant_set::{
    DELAY_STEP, GAIN_STEP, HELD_MASSES, PlantName, PlantVariation, mass_step, mode_step, row,
};
use super::predictor::Predictors;
use super::recording::ServoRecording;
use super::sampled_loop::{
    FrequencyGrid, LawResponse, LoopResponse, SampledLoop, let_through_um, plant_responses,
};
use super::tuning::{Demands, PredictorTuning};
use crate::parallel;
use nalgebra::Complex;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Peak of an unknown mode over the static displacement: 5 % of the motion at a damping ratio of 0.015 (2 %
/// at 0.006).
pub const UNKNOWN_MODE_PEAK: f64 = 0.05 / (2.0 * 0.015);
/// Spread of the gain that the fourth condition carries along.
pub const GAIN_SPREAD: f64 = 1.2;
/// A frequency is never taken to be known better than this.
pub const LEAST_FREQUENCY_SPREAD: f64 = 0.02;
/// A damping ratio is never taken to be known better than this.
pub const LEAST_DAMPING_SPREAD: f64 = 0.2;

/// Factor of the first steps from a candidate to a better one.
const FIRST_STEP: f64 = 3.0;
/// Below this factor no smaller steps are tried.
const LAST_STEP: f64 = 1.2;
/// Steps at most.
const MOST_STEPS: usize = 40;
/// A step must bring the cost below this share.
const LEAST_GAIN: f64 = 0.995;

/// How a plant of another mass is called.
const MASS: &str = "the mass";

/// Shares of what is commanded that act where the drive stands at a limit for part of a cycle.
const LIMIT_SHARES: [f64; 5] = [0.6, 0.35, 0.2, 0.1, 0.05];

/// One law that is there already.
struct Fixed<'a>(&'a PredictorDesign);

impl Family for Fixed<'_> {
    type Tuning = ();

    fn law(&self, (): &()) -> Option<PredictorDesign> {
        Some(self.0.clone())
    }

    fn fits(&self, (): &(), _law: &PredictorDesign) -> bool {
        true
    }

    fn grid(&self, _demands: &Demands) -> Vec<()> {
        vec![()]
    }

    fn numbers(&self) -> usize {
        0
    }

    fn stepped(&self, (): &(), _number: usize, _by: f64) {}
}

/// How well the values of a mode are known: relative spreads that are reckoned with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeSpread {
    /// Of the frequency.
    pub frequency: f64,
    /// Of the damping ratio.
    pub damping: f64,
}

impl ModeSpread {
    /// From relative standard deviations.
    #[must_use]
    pub fn from_deviations(frequency_std: f64, damping_std: f64) -> Self {
        Self {
            frequency: (3.0 * frequency_std).clamp(LEAST_FREQUENCY_SPREAD, 0.5),
            damping: (3.0 * damping_std).clamp(LEAST_DAMPING_SPREAD, 0.9),
        }
    }
    /// A mode over its frequencies, least damped, each with its frequency over the mode's.
    fn moved(&self, mode: ModeModel) -> impl Iterator<Item = (f64, ModeModel)> {
        let damping_ratio = mode.damping_ratio * (1.0 - self.damping);
        let step = 1.0
            + mode_step(&ModeModel {
                damping_ratio,
                ..mode
            });
        let [low, high] = [-1.0, 1.0].map(|way| 1.0 + way * self.frequency);
        row(1.0, low, step)
            .chain(row(1.0, high, step))
            .map(move |factor| {
                let natural_frequency_rad_s = factor * mode.natural_frequency_rad_s;
                (
                    factor,
                    ModeModel {
                        natural_frequency_rad_s,
                        damping_ratio,
                    },
                )
            })
    }
}

/// What a design is made for.
pub struct Task<'a> {
    /// Dynamics of the observer.
    pub linear: LinearModel,
    /// Spread of the first mode.
    pub first: ModeSpread,
    /// Spread of the second one, if there is one.
    pub second: Option<ModeSpread>,
    /// A second mode that the model has and the observer does not carry: the loop has to hold with it too.
    pub left_out: Option<(f64, ModeModel)>,
    /// Delay of the drive that the actuator is known to have and the observer does not carry, s.
    pub delay_s: f64,
    /// The recording, if it is at hand.
    pub recording: Option<&'a ServoRecording>,
    /// Share of its frequency by which the first mode moves to either side; zero where nobody said that it
    /// does. Beside it the spread of [`Task::first`] has to be as large.
    pub mode_moves: f64,
    /// Mass over the model's up to which the loop has to hold. A scan of which no tuning does looks for
    /// less.
    pub mass_to: f64,
    /// What is asked.
    pub demands: Demands,
}

/// What is the same for all candidates.
struct Conditions {
    grid: FrequencyGrid,
    plant: Vec<Complex<f64>>,
    unknown: Vec<f64>,
    nominal: SampledModel,
    members: Vec<(PlantName, SampledModel)>,
    moving: Option<MovingMode>,
    demands: Demands,
}

/// Largest missing response that any servo is held against at a frequency, with the first mode at `first_hz`,
/// um/um. Below that nothing resonates; there the model's own error counts.
#[must_use]
pub fn most_reckoned_with(first_hz: f64, hz: f64) -> f64 {
    if hz < 0.9 * first_hz {
        0.2
    } else {
        UNKNOWN_MODE_PEAK
    }
}

impl Task<'_> {
    /// Largest missing response that has to be reckoned with at a frequency, um/um.
    #[must_use]
    pub fn unknown_at(&self, hz: f64) -> f64 {
        let first_hz = self.linear.first_mode.natural_frequency_rad_s / TAU;
        let most = most_reckoned_with(first_hz, hz);
        let assumed = if hz < 0.9 * first_hz { 0.0 } else { most };
        let level = self
            .recording
            .and_then(|r| r.level_at(hz))
            .map_or(assumed, |level| level.min(most));
        GAIN_SPREAD * level
    }

    fn conditions(&self) -> Conditions {
        self.conditions_at(1.0)
    }

    /// With all plants at this gain over the one that the law inverts.
    fn conditions_at(&self, gain_ratio: f64) -> Conditions {
        let grid = FrequencyGrid::about_modes(&self.linear);
        let on = |variation: PlantVariation, linear: &LinearModel| {
            PlantVariation {
                gain: variation.gain * gain_ratio,
                delay_s: variation.delay_s + self.delay_s,
                ..variation
            }
            .sampled(linear)
        };
        let nominal = on(PlantVariation::NONE, &self.linear);
        let mut members = Vec::new();
        let mut add = |name: PlantName, variation: PlantVariation, linear: &LinearModel| {
            members.push((name, on(variation, linear)));
        };
        let with_second = self.left_out.map(|second| LinearModel {
            second_mode: Some(second),
            ..self.linear
        });
        for linear in std::iter::once(self.linear).chain(with_second) {
            add(PlantName::Model, PlantVariation::NONE, &linear);
            for gain in row(1.0, 0.5, GAIN_STEP).chain(row(1.0, 1.5, GAIN_STEP)) {
                let name = PlantName::Times(gain, "the gain");
                add(name, PlantVariation::with_gain(gain), &linear);
            }
            for tenths in [10, 5, 1, 2, 3, 4, 6, 7, 8, 9] {
                let periods = DELAY_STEP * f64::from(tenths);
                let variation = PlantVariation::with_delay_s(periods * linear.period_s);
                add(PlantName::Delayed(periods), variation, &linear);
            }
            for mass in row(1.0, self.mass_to, mass_step(&linear)) {
                let variation = PlantVariation::with_mass_ratio(mass);
                add(PlantName::Times(mass, MASS), variation, &linear);
            }
        }
        for gain in [1.0 / GAIN_SPREAD, GAIN_SPREAD].map(PlantVariation::with_gain) {
            for (factor, first_mode) in self.first.moved(self.linear.first_mode) {
                let linear = LinearModel {
                    first_mode,
                    ..self.linear
                };
                let name = PlantName::Times(factor, "the frequency of the first mode");
                add(name, gain, &linear);
            }
            if let (Some((share, mode)), Some(spread)) = (self.linear.second_mode, self.second) {
                for (factor, mode) in spread.moved(mode) {
                    let linear = LinearModel {
                        second_mode: Some((share, mode)),
                        ..self.linear
                    };
                    let name = PlantName::Times(factor, "the frequency of the second mode");
                    add(name, gain, &linear);
                }
            }
        }
        Conditions {
            plant: plant_responses(&nominal, 1.0, &grid),
            unknown: grid.hz.iter().map(|hz| self.unknown_at(*hz)).collect(),
            grid,
            moving: (self.mode_moves > 0.0).then(|| {
                let feedforward = PredictorDesign::new(&self.linear, &PredictorTuning::START);
                MovingMode::new(&self.linear, &feedforward, self.mode_moves, self.delay_s)
            }),
            nominal,
            members,
            demands: self.demands,
        }
    }

    /// Judges one tuning.
    #[must_use]
    pub fn judge(&self, tuning: &PredictorTuning) -> Candidate {
        judge(&Predictors(&self.linear), tuning, &self.conditions())
    }

    /// Judges a law that is there already, on an actuator with this gain over the one that the law inverts;
    /// and on how many plants.
    #[must_use]
    pub fn judge_law(&self, law: &PredictorDesign, gain_ratio: f64) -> (Candidate<()>, usize) {
        let conditions = self.conditions_at(gain_ratio);
        (
            judge(&Fixed(law), &(), &conditions),
            conditions.members.len(),
        )
    }

    /// Judges the predictors of a grid, and those between its points that are better than the best of them.
    #[must_use]
    pub fn scan(&self) -> Scan {
        self.scan_of(&Predictors(&self.linear))
    }

    /// The same for the laws of a family.
    #[must_use]
    pub fn scan_of<F: Family>(&self, family: &F) -> Scan<F::Tuning> {
        let scan = self.scan_at_mass(family);
        if !mass_is_in_the_way(&scan) {
            return scan;
        }
        let less = HELD_MASSES.into_iter().filter(|m| *m < self.mass_to);
        less.map(|mass_to| Task { mass_to, ..*self }.scan_at_mass(family))
            .find(|scan| scan.best().is_some())
            .unwrap_or(scan)
    }

    /// A scan whose tunings have to hold for all of [`Task::mass_to`].
    fn scan_at_mass<F: Family>(&self, family: &F) -> Scan<F::Tuning> {
        let conditions = self.conditions();
        let mut candidates = grid(family, &conditions);
        // The best that holds, the one that a better recording would allow, and the one with the usual
        // margins.
        let usual = self
            .demands
            .usual_margins
            .then_some(holds_with_usual_margins as fn(&Candidate<F::Tuning>) -> bool);
        for good in [
            holds as fn(&Candidate<F::Tuning>) -> bool,
            holds_if_recorded,
        ]
        .into_iter()
        .chain(usual)
        {
            if let Some(best) = candidates.iter().find(|c| good(c)).cloned() {
                candidates.extend(refined(family, best, good, &conditions));
                candidates.sort_by(|x, y| x.cost_um().total_cmp(&y.cost_um()));
            }
        }
        Scan {
            candidates,
            mass_to: self.mass_to,
        }
    }

    /// The grid of the predictors alone.
    #[must_use]
    pub fn coarse_scan(&self) -> Scan {
        Scan {
            candidates: grid(&Predictors(&self.linear), &self.conditions()),
            mass_to: self.mass_to,
        }
    }

    /// A candidate as the file of a design keeps it.
    #[must_use]
    pub fn assessment(&self, candidate: &Candidate) -> Assessment {
        let law = PredictorDesign::without_feedforward(&self.linear, &candidate.tuning);
        let Assessment { margins, .. } =
            assess(candidate.tuning, &law, &self.linear, &self.demands);
        Assessment {
            tuning: candidate.tuning,
            noise_um: candidate.noise_um,
            disturbance_um: candidate.disturbance_um,
            margins,
            accepted: candidate.broken.is_none(),
        }
    }
}

/// Whether no candidate holds, whatever a recording would exclude, and some fail with more mass.
fn mass_is_in_the_way<T>(scan: &Scan<T>) -> bool {
    let with_mass = |name: &PlantName| matches!(name, PlantName::Times(_, of) if *of == MASS);
    scan.best_if_recorded().is_none()
        && scan.candidates.iter().any(|c| {
            matches!(&c.broken, Some(Broken::Member(name) | Broken::Limit(name)) if with_mass(name))
        })
}

fn grid<F: Family>(family: &F, conditions: &Conditions) -> Vec<Candidate<F::Tuning>> {
    let tunings = family.grid(&conditions.demands);
    let mut candidates = parallel::map(&tunings, |tuning| judge(family, tuning, conditions));
    candidates.sort_by(|x, y| x.cost_um().total_cmp(&y.cost_um()));
    candidates
}

/// Goes from a good candidate to better ones, one or two numbers of the tuning at a time (along an edge of
/// what is allowed two have to move together) and in ever smaller steps; all good ones on the way.
fn refined<F: Family>(
    family: &F,
    start: Candidate<F::Tuning>,
    good: fn(&Candidate<F::Tuning>) -> bool,
    conditions: &Conditions,
) -> Vec<Candidate<F::Tuning>> {
    let (mut here, mut factor) = (start, FIRST_STEP);
    let mut found = Vec::new();
    for _ in 0..MOST_STEPS {
        let mut near = Vec::new();
        for first in 0..family.numbers() {
            for by in [factor, 1.0 / factor] {
                let one = family.stepped(&here.tuning, first, by);
                near.push(one.clone());
                for second in 0..first {
                    near.extend([factor, 1.0 / factor].map(|by| family.stepped(&one, second, by)));
                }
            }
        }
        let judged = parallel::map(&near, |tuning| judge(family, tuning, conditions));
        let better: Vec<Candidate<F::Tuning>> = judged
            .into_iter()
            .filter(|c| good(c) && c.cost_um() < LEAST_GAIN * here.cost_um())
            .collect();
        match better
            .iter()
            .min_by(|x, y| x.cost_um().total_cmp(&y.cost_um()))
        {
            Some(best) => here = best.clone(),
            None if factor < LAST_STEP => break,
            None => factor = factor.sqrt(),
        }
        found.extend(better);
    }
    found
}
fn judge<F: Family>(
    family: &F,
    tuning: &F::Tuning,
    conditions: &Conditions,
) -> Candidate<F::Tuning> {
    let mut out = Candidate {
        tuning: tuning.clone(),
        noise_um: f64::INFINITY,
        disturbance_um: f64::INFINITY,
        slow_um: f64::INFINITY,
        sensitivity_peak: f64::INFINITY,
        reference_deviation: 1.0,
        broken: None,
        unknown: (0.0, 0.0),
        fits: false,
        gain_margin: 0.0,
        phase_margin_deg: 0.0,
    };
    let Some(design) = family.law(tuning) else {
        out.broken = Some(Broken::Member(PlantName::Model));
        return out;
    };
    let beside = family.beside(tuning);
    let unstable = conditions.members.iter().find(|(_, plant)| {
        let laws = || std::iter::once(&design).chain(&beside);
        !laws().all(|law| SampledLoop::new(law, plant).is_stable())
    });
    if let Some((name, _)) = unstable {
        out.broken = Some(Broken::Member(*name));
        return out;
    }
    let (law, demands) = (LawResponse::new(&design), &conditions.demands);
    let response = LoopResponse::new(&conditions.grid, &conditions.plant, &law);
    for (point, missing) in response.points.iter().zip(&conditions.unknown) {
        let unknown = point.answer.norm() * missing;
        if unknown > out.unknown.0 || unknown.is_nan() {
            out.unknown = (unknown, point.hz);
        }
    }
    let let_through =
        |hz: f64| let_through_um(&conditions.nominal, &law, hz, demands.model_error_um);
    out.noise_um = response.noise_transmission() * demands.sensor_noise_um;
    out.disturbance_um = let_through(demands.reference_hz);
    out.slow_um = let_through(0.1 * demands.reference_hz);
    out.sensitivity_peak = response.sensitivity_peak().0;
    out.gain_margin = response.gain_margin().unwrap_or(f64::INFINITY);
    out.phase_margin_deg = response.phase_margin_deg().unwrap_or(f64::INFINITY);
    if let Some(moving) = &conditions.moving {
        out.reference_deviation = moving.deviation(|hz| law.at(hz));
    }
    out.fits = family.fits(tuning, &design);
    out.broken = first_broken(&out, &design, conditions);
    out
}

/// The first condition that a stable candidate breaks, in the order of the module's text.
fn first_broken<T>(
    out: &Candidate<T>,
    law: &PredictorDesign,
    conditions: &Conditions,
) -> Option<Broken> {
    let peak = out.sensitivity_peak;
    if peak.is_nan() || peak > conditions.demands.sensitivity_peak {
        return Some(Broken::Sensitivity);
    }
    let limited = LIMIT_SHARES.map(|share| law.at_a_limit(share));
    let swings_on = |plant: &SampledModel| {
        let mut laws = limited.iter();
        laws.any(|law| !SampledLoop::new(law, plant).is_stable())
    };
    if let Some((name, _)) = conditions.members.iter().find(|(_, p)| swings_on(p)) {
        Some(Broken::Limit(*name))
    } else if out.unknown.0.is_nan() || out.unknown.0 > 1.0 {
        Some(Broken::Unknown { hz: out.unknown.1 })
    } else if !out.fits {
        Some(Broken::Integers)
    } else {
        None
    }
}

/// Whether a mode is inside what a loop with this sampling period, s, sees.
#[must_use]
pub fn within_nyquist(mode: &ModeModel, period_s: f64) -> bool {
    mode.natural_frequency_rad_s * period_s < PI
}

#[cfg(test)]
mod tests {
    use super::super::sampled_loop::{frequency_response, law_response};
    use super::*;

    fn linear(lags: bool) -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: TAU * 900.0,
                damping_ratio: 0.3,
            },
            second_mode: Some((
                0.03,
                ModeModel {
                    natural_frequency_rad_s: TAU * 4300.0,
                    damping_ratio: 0.02,
                },
            )),
            amplifier_bandwidth_hz: lags.then_some(5000.0),
            sensor_bandwidth_hz: lags.then_some(9000.0),
            period_s: 5e-5,
        }
    }

    #[test]
    fn noise_near_half_the_sampling_rate_quietens_the_law_there_and_takes_a_free_state() {
        let quiet = PredictorTuning {
            fast_noise_um: 0.01,
            ..PredictorTuning::START
        };
        let at = |lags: bool, tuning: &PredictorTuning, hz: f64| {
            law_response(&PredictorDesign::new(&linear(lags), tuning), hz).norm()
        };
        for hz in [9_000.0, 9_900.0] {
            let (with, without) = (
                at(false, &quiet, hz),
                at(false, &PredictorTuning::START, hz),
            );
            assert!(with < 0.5 * without, "{hz} Hz: {with} {without}");
        }
        let (with, without) = (
            at(false, &quiet, 100.0),
            at(false, &PredictorTuning::START, 100.0),
        );
        assert!(
            with > 0.5 * without,
            "what is slow is followed: {with} {without}"
        );
        assert!(
            PredictorDesign::new(&linear(false), &quiet)
                .quantised()
                .is_ok()
        );
        // Two modes and two lags: all states are taken.
        let (full, plain) = (
            PredictorDesign::new(&linear(true), &quiet),
            PredictorDesign::new(&linear(true), &PredictorTuning::START),
        );
        assert_eq!((full.l, full.a), (plain.l, plain.a));
    }

    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn a_refined_tuning_is_better_than_every_point_of_the_scan_and_as_stable() {
        let task = Task {
            linear: linear(false),
            ..with_two_modes()
        };
        let scan = task.scan();
        let best = scan.best().expect("some hold");
        let coarse = task.coarse_scan();
        let scanned = coarse.best().expect("some hold");
        assert!(
            best.expected_um() < 0.98 * scanned.expected_um(),
            "{} {}",
            best.expected_um(),
            scanned.expected_um()
        );
        // By the eigenvalues of the loop itself, beside how the candidates are judged.
        let law = PredictorDesign::new(&task.linear, &best.tuning);
        let plant = task.linear.sampled();
        for variation in [
            PlantVariation::NONE,
            PlantVariation::with_gain(0.5),
            PlantVariation::with_gain(1.5),
            PlantVariation::with_delay_s(task.linear.period_s),
        ] {
            let varied = variation.sampled(&task.linear);
            assert!(SampledLoop::new(&law, &varied).is_stable(), "{variation:?}");
        }
        // And by the small gain of a mode that nothing excludes: at every frequency from the first mode to
        // half the sampling rate.
        for hz in (1000..10_000).step_by(37).map(f64::from) {
            let p = frequency_response(&plant, TAU * hz);
            let k = law_response(&law, hz);
            let answer = (k / (Complex::new(1.0, 0.0) + p * k)).norm();
            assert!(
                answer * GAIN_SPREAD * UNKNOWN_MODE_PEAK < 1.05,
                "{hz} Hz: {answer}"
            );
        }
    }

    #[test]
    fn a_second_mode_that_the_observer_lacks_is_among_the_plants() {
        let task = with_two_modes();
        let (law, light) = (
            PredictorDesign::new(&linear(false), &PredictorTuning::START),
            ModeModel {
                natural_frequency_rad_s: TAU * 2500.0,
                damping_ratio: 0.003,
            },
        );
        let alone = Task {
            linear: linear(false),
            mass_to: 1.01,
            ..task
        };
        let beside = Task {
            left_out: Some((0.2, light)),
            ..alone
        };
        let broken = |task: &Task<'_>| task.judge_law(&law, 1.0).0.broken;
        assert!(!matches!(broken(&alone), Some(Broken::Member(_))));
        assert_eq!(broken(&beside), Some(Broken::Member(PlantName::Model)));
    }

    /// A stage whose second mode passes the first one's place on the loop as the mass grows.
    fn with_two_modes() -> Task<'static> {
        let spread = ModeSpread {
            frequency: 0.02,
            damping: 0.2,
        };
        Task {
            linear: LinearModel {
                first_mode: ModeModel {
                    natural_frequency_rad_s: 4398.0,
                    damping_ratio: 0.03,
                },
                second_mode: Some((
                    0.0827,
                    ModeModel {
                        natural_frequency_rad_s: 11_942.0,
                        damping_ratio: 0.0217,
                    },
                )),
                amplifier_bandwidth_hz: Some(5719.0),
                sensor_bandwidth_hz: None,
                period_s: 5e-5,
            },
            first: spread,
            second: Some(spread),
            left_out: None,
            delay_s: 0.0,
            recording: None,
            mode_moves: 0.0,
            mass_to: HELD_MASSES[0],
            demands: Demands::default(),
        }
    }

    /// Stable with 1.4 and with twice the mass of [`with_two_modes`], not between.
    const UNSTABLE_BETWEEN: PredictorTuning = PredictorTuning {
        effort_weight: 0.173_205,
        unknown_change_um: 0.000_156_367,
        unknown_slope_change_um: 0.0,
        force_noise_um: 0.000_173_742,
        sensor_noise_um: 0.003_009_29,
        fast_noise_um: 0.001_737_42,
    };

    struct One<'a>(Predictors<'a>);

    impl Family for One<'_> {
        type Tuning = PredictorTuning;

        fn law(&self, tuning: &PredictorTuning) -> Option<PredictorDesign> {
            self.0.law(tuning)
        }

        fn fits(&self, _tuning: &PredictorTuning, _law: &PredictorDesign) -> bool {
            true
        }

        fn grid(&self, _demands: &Demands) -> Vec<PredictorTuning> {
            vec![UNSTABLE_BETWEEN]
        }

        fn numbers(&self) -> usize {
            0
        }

        fn stepped(&self, tuning: &PredictorTuning, _number: usize, _by: f64) -> PredictorTuning {
            *tuning
        }
    }

    #[test]
    fn a_loop_that_is_unstable_between_two_masses_is_not_taken() {
        let task = with_two_modes();
        let law = PredictorDesign::new(&task.linear, &UNSTABLE_BETWEEN);
        let stable = |mass: f64| {
            let plant = PlantVariation::with_mass_ratio(mass).sampled(&task.linear);
            SampledLoop::new(&law, &plant).is_stable()
        };
        assert_eq!([1.0, 1.4, 1.7, 2.0].map(stable), [true, true, false, true]);
        let (found, _) = task.judge_law(&law, 1.0);
        let Some(Broken::Member(PlantName::Times(mass, MASS))) = found.broken else {
            panic!("{:?}", found.broken);
        };
        assert!(!stable(mass) && (1.4..2.0).contains(&mass), "{mass}");
    }

    #[test]
    fn a_scan_that_no_tuning_passes_at_twice_the_mass_promises_less() {
        let task = with_two_modes();
        let family = One(Predictors(&task.linear));
        // A recording that excludes every other mode: the mass alone is in the way.
        let recording = ServoRecording {
            frequency_hz: (0..=100).map(|k| 100.0 * f64::from(k)).collect(),
            level: vec![1e-4; 101],
            ..ServoRecording::default()
        };
        let task = Task {
            recording: Some(&recording),
            ..task
        };
        let scan = task.scan_of(&family);
        assert_eq!(scan.mass_to, HELD_MASSES[1]);
        assert_eq!(scan.candidates[0].broken, None);
    }
}
