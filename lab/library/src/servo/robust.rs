//! The design that holds for all plants that the recording leaves possible.
//!
//! # How it works
//! Each candidate of a family of laws ([`Family`]; the tunings of [`super::predictor`] go from a few rad/s of
//! bandwidth to beyond the first mode) must
//!
//! 1. be stable by the eigenvalues of the sampled loop on every member of a set: gain -50 % to +50 %, a
//!    period more of delay, more mass, and modes moved by three standard deviations (never less than
//!    [`LEAST_FREQUENCY_SPREAD`] and [`LEAST_DAMPING_SPREAD`], since a stated deviation can be too small
//!    where a model lacks something);
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
//! condition costs is found by leaving it out, and told.

use super::loop_margins::phase_margin_deg;
use super::model::{LinearModel, ModeModel, SampledModel};
use super::moving_mode::MovingMode;
use super::plant_set::PlantVariation;
use super::predictor::{
    Assessment, Demands, PredictorDesign, PredictorTuning, STATES, frequency_response,
};
use super::recording::ServoRecording;
use crate::parallel;
use nalgebra::{Complex, SMatrix, SVector};
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

/// Margins that a controller usually keeps: the largest sensitivity, ...
pub const USUAL_PEAK: f64 = 1.8;
/// ... the gain margin, dB, ...
pub const USUAL_GAIN_MARGIN_DB: f64 = 8.0;
/// ... and the phase margin, degrees (a peak of 1.8 alone leaves 7.0 dB and 32 degrees).
pub const USUAL_PHASE_MARGIN_DEG: f64 = 35.0;
/// The usual margins are kept where the cost stays below this factor.
const COST_OF_USUAL: f64 = 4.0 / 3.0;

/// Shares of what is commanded that act where the drive stands at a limit for part of a cycle.
const LIMIT_SHARES: [f64; 5] = [0.6, 0.35, 0.2, 0.1, 0.05];

/// Laws among which a scan chooses: each by its tuning, a few numbers.
pub trait Family: Sync {
    /// What one of them is tuned by.
    type Tuning: Clone + Send + Sync;

    /// What closes the loop; none where the tuning gives no linear law.
    fn law(&self, tuning: &Self::Tuning) -> Option<PredictorDesign>;

    /// Laws that have to be stable beside it, where it is one end of what a nonlinearity makes of it.
    fn beside(&self, _tuning: &Self::Tuning) -> Vec<PredictorDesign> {
        Vec::new()
    }

    /// Whether its gains have a place in the tick's integers.
    fn fits(&self, tuning: &Self::Tuning, law: &PredictorDesign) -> bool;

    /// The tunings of the grid.
    fn grid(&self, demands: &Demands) -> Vec<Self::Tuning>;

    /// Numbers of a tuning that are moved between the points of the grid.
    fn numbers(&self) -> usize;

    /// A tuning with one of its numbers multiplied.
    fn stepped(&self, tuning: &Self::Tuning, number: usize, by: f64) -> Self::Tuning;
}

/// The predictors of a model.
struct Predictors<'a>(&'a LinearModel);

impl Family for Predictors<'_> {
    type Tuning = PredictorTuning;

    fn law(&self, tuning: &PredictorTuning) -> Option<PredictorDesign> {
        Some(PredictorDesign::of_loop(self.0, tuning))
    }

    fn fits(&self, _tuning: &PredictorTuning, law: &PredictorDesign) -> bool {
        law.quantised().is_ok()
    }

    fn grid(&self, demands: &Demands) -> Vec<PredictorTuning> {
        let noise_um = demands.sensor_noise_um;
        let mut tunings = Vec::new();
        for effort_weight in [0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e4] {
            for change in [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0] {
                for force in [0.1, 1.0, 10.0] {
                    for slope in [0.0, 0.05, 0.2] {
                        tunings.push(PredictorTuning {
                            effort_weight,
                            unknown_change_um: change * noise_um,
                            unknown_slope_change_um: slope * change * noise_um,
                            force_noise_um: force * noise_um,
                            sensor_noise_um: noise_um,
                            fast_noise_um: 0.0,
                        });
                    }
                }
            }
        }
        tunings
    }

    fn numbers(&self) -> usize {
        5
    }

    fn stepped(&self, tuning: &PredictorTuning, number: usize, by: f64) -> PredictorTuning {
        let mut out = *tuning;
        match number {
            0 => out.effort_weight *= by,
            1 => {
                out.unknown_change_um *= by;
                out.unknown_slope_change_um *= by;
            }
            2 => out.unknown_slope_change_um *= by,
            3 => out.force_noise_um *= by,
            _ if out.fast_noise_um > 0.0 => out.fast_noise_um *= by,
            // A noise about half the sampling rate that is not there yet begins at the sensor's.
            _ => out.fast_noise_um = by * out.sensor_noise_um,
        }
        out
    }
}

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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModeSpread {
    /// Of the frequency.
    pub frequency: f64,
    /// Of the damping ratio.
    pub damping: f64,
}

impl ModeSpread {
    /// From relative standard deviations.
    #[must_use]
    pub fn of(frequency_std: f64, damping_std: f64) -> Self {
        Self {
            frequency: (3.0 * frequency_std).clamp(LEAST_FREQUENCY_SPREAD, 0.5),
            damping: (3.0 * damping_std).clamp(LEAST_DAMPING_SPREAD, 0.9),
        }
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
    /// Delay of the drive that the actuator is known to have and the observer does not carry, s.
    pub delay_s: f64,
    /// The recording, if it is at hand.
    pub recording: Option<&'a ServoRecording>,
    /// Share of its frequency by which the first mode moves to either side; zero where nobody said that it
    /// does. Beside it the spread of [`Task::first`] has to be as large.
    pub mode_moves: f64,
    /// What is asked.
    pub demands: Demands,
}

/// Which condition a candidate breaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Broken {
    /// Unstable on a member of the set.
    Member(&'static str),
    /// The peak of the sensitivity.
    Sensitivity,
    /// On a member of the set it may go on swinging between the limits of the drive.
    Limit(&'static str),
    /// A missing response that is not excluded, at this frequency.
    Unknown {
        /// Hz.
        hz: f64,
    },
    /// Nothing but that a gain has no place in the tick's integers.
    Integers,
}

/// A candidate with what it is worth.
#[derive(Clone, Debug)]
pub struct Candidate<T = PredictorTuning> {
    /// Its tuning.
    pub tuning: T,
    /// Noise passed on, um RMS.
    pub noise_um: f64,
    /// Model error let through at the highest frequency, um RMS.
    pub disturbance_um: f64,
    /// The same at a tenth of it.
    pub slow_um: f64,
    /// Largest sensitivity.
    pub sensitivity_peak: f64,
    /// The factor by which a reference is at most too large or too small where the first mode moves; one
    /// where it does not.
    pub reference_deviation: f64,
    /// The first condition that it breaks; none for a good one. Conditions in the order of the module's text.
    pub broken: Option<Broken>,
    /// Largest `|K S| W` and where, Hz.
    pub unknown: (f64, f64),
    /// Its gains have a place in the tick's integers.
    pub fits: bool,
    /// Gain margin upwards, as a factor; infinite where the phase never reaches -180 degrees.
    pub gain_margin: f64,
    /// Phase margin, degrees; infinite where the open loop stays below one.
    pub phase_margin_deg: f64,
}

/// A factor in decibels.
#[must_use]
pub fn decibels(factor: f64) -> f64 {
    20.0 * factor.log10()
}

impl<T> Candidate<T> {
    /// Expected error, um RMS.
    #[must_use]
    pub fn expected_um(&self) -> f64 {
        self.noise_um.hypot(self.disturbance_um).hypot(self.slow_um)
    }

    /// What the choice goes by, the less the better: the expected error, and the reference's deviation where
    /// the mode moves.
    #[must_use]
    pub fn cost_um(&self) -> f64 {
        self.expected_um() * self.reference_deviation
    }

    /// Whether it keeps the margins that a controller usually keeps.
    #[must_use]
    pub fn keeps_usual_margins(&self) -> bool {
        self.sensitivity_peak <= USUAL_PEAK
            && decibels(self.gain_margin) >= USUAL_GAIN_MARGIN_DB
            && self.phase_margin_deg >= USUAL_PHASE_MARGIN_DEG
    }
}

/// Whether a candidate breaks nothing and keeps the usual margins.
fn holds_with_usual_margins<T>(candidate: &Candidate<T>) -> bool {
    holds(candidate) && candidate.keeps_usual_margins()
}

/// Whether a candidate breaks nothing.
fn holds<T>(candidate: &Candidate<T>) -> bool {
    candidate.broken.is_none()
}

/// Whether it breaks at most the condition on what the recording does not exclude.
fn holds_if_recorded<T>(candidate: &Candidate<T>) -> bool {
    candidate.fits && matches!(candidate.broken, None | Some(Broken::Unknown { .. }))
}

/// Outcome of a scan.
#[derive(Clone, Debug)]
pub struct Scan<T = PredictorTuning> {
    /// All candidates, by [`Candidate::cost_um`].
    pub candidates: Vec<Candidate<T>>,
}

impl<T> Scan<T> {
    /// The best of those that break nothing.
    #[must_use]
    pub fn best(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds(c))
    }

    /// The best of those that also keep the usual margins.
    #[must_use]
    pub fn best_with_usual_margins(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds_with_usual_margins(c))
    }

    /// The one that a design takes: with the usual margins, where they are wanted and cheap.
    #[must_use]
    pub fn chosen(&self, usual_margins: bool) -> Option<&Candidate<T>> {
        let best = self.best()?;
        let usual = self
            .best_with_usual_margins()
            .filter(|usual| usual_margins && usual.cost_um() < COST_OF_USUAL * best.cost_um());
        Some(usual.unwrap_or(best))
    }

    /// The best of those that only the tick's integers keep from being taken.
    #[must_use]
    pub fn best_in_other_integers(&self) -> Option<&Candidate<T>> {
        self.candidates
            .iter()
            .find(|c| c.broken == Some(Broken::Integers))
    }

    /// The best of those that break at most the condition on what the recording does not exclude.
    #[must_use]
    pub fn best_if_recorded(&self) -> Option<&Candidate<T>> {
        self.candidates.iter().find(|c| holds_if_recorded(c))
    }
}

/// Frequencies at which a loop is looked at, Hz: even steps up to half the sampling rate, and close together
/// about every mode.
#[must_use]
pub fn frequency_grid_hz(linear: &LinearModel) -> Vec<f64> {
    let highest = 0.5 / linear.period_s;
    let mut grid: Vec<f64> = (1..400).map(|i| highest * f64::from(i) / 400.0).collect();
    grid.extend((0..24).map(|i| 0.5 * 1.2_f64.powi(i)));
    for mode in std::iter::once(linear.first_mode).chain(linear.second_mode.map(|(_, m)| m)) {
        let hz = mode.natural_frequency_rad_s / TAU;
        grid.extend(
            (-12..=12).map(|i| hz * (1.0 + 0.5 * mode.damping_ratio.min(0.1) * f64::from(i))),
        );
    }
    grid.retain(|hz| *hz > 0.0 && *hz < highest);
    grid.sort_by(f64::total_cmp);
    grid
}

/// Answer of a law's drive to the reading at a frequency, sign such that the loop is `1 + P K`.
#[must_use]
pub fn law_response(design: &PredictorDesign, hz: f64) -> Complex<f64> {
    let law = &design.a - &design.l * design.c.transpose() - &design.b * design.k.transpose();
    LawMatrices::of(&law, design).response(hz)
}

/// The law with the sizes known to the compiler: a scan takes some hundred thousand of its responses.
struct LawMatrices {
    a: SMatrix<f64, STATES, STATES>,
    l: SVector<Complex<f64>, STATES>,
    k: SVector<Complex<f64>, STATES>,
    period_s: f64,
}

impl LawMatrices {
    fn of(law: &nalgebra::DMatrix<f64>, design: &PredictorDesign) -> Self {
        let complex = |v: f64| Complex::new(v, 0.0);
        Self {
            a: SMatrix::from_fn(|i, j| law[(i, j)]),
            l: SVector::from_fn(|i, _| complex(design.l[i])),
            k: SVector::from_fn(|i, _| complex(design.k[i])),
            period_s: design.period_s,
        }
    }

    fn response(&self, hz: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, TAU * hz * self.period_s);
        let matrix = SMatrix::<Complex<f64>, STATES, STATES>::from_fn(|i, j| {
            if i == j {
                z - self.a[(i, j)]
            } else {
                Complex::new(-self.a[(i, j)], 0.0)
            }
        });
        matrix
            .lu()
            .solve(&self.l)
            .map_or(Complex::new(f64::NAN, f64::NAN), |x| {
                self.k.iter().zip(x.iter()).map(|(k, x)| k * x).sum()
            })
    }
}

/// What is the same for all candidates.
struct Conditions {
    grid_hz: Vec<f64>,
    plant: Vec<Complex<f64>>,
    unknown: Vec<f64>,
    nominal: SampledModel,
    members: Vec<(&'static str, SampledModel)>,
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
        let grid_hz = frequency_grid_hz(&self.linear);
        let nominal = PlantVariation {
            gain: gain_ratio,
            delay_s: self.delay_s,
            ..PlantVariation::NONE
        }
        .sampled(&self.linear);
        let moved = |mode: ModeModel, frequency: f64, damping: f64| ModeModel {
            natural_frequency_rad_s: mode.natural_frequency_rad_s * frequency,
            damping_ratio: mode.damping_ratio * damping,
        };
        let mut members = vec![("nominal", nominal.clone())];
        let mut add = |name, variation: PlantVariation, linear: &LinearModel| {
            let late = PlantVariation {
                gain: variation.gain * gain_ratio,
                delay_s: variation.delay_s + self.delay_s,
                ..variation
            };
            members.push((name, late.sampled(linear)));
        };
        add(
            "half the gain",
            PlantVariation {
                gain: 0.5,
                ..PlantVariation::NONE
            },
            &self.linear,
        );
        add(
            "one and a half times the gain",
            PlantVariation {
                gain: 1.5,
                ..PlantVariation::NONE
            },
            &self.linear,
        );
        add(
            "a period more of delay",
            PlantVariation {
                delay_s: self.linear.period_s,
                ..PlantVariation::NONE
            },
            &self.linear,
        );
        add(
            "twice the mass",
            PlantVariation {
                mass_ratio: 2.0,
                ..PlantVariation::NONE
            },
            &self.linear,
        );
        add(
            "1.4 times the mass",
            PlantVariation {
                mass_ratio: 1.4,
                ..PlantVariation::NONE
            },
            &self.linear,
        );
        for up in [-1.0, 1.0] {
            for gain in [1.0 / GAIN_SPREAD, GAIN_SPREAD] {
                let spread = self.first;
                let first_mode = moved(
                    self.linear.first_mode,
                    1.0 + up * spread.frequency,
                    1.0 - spread.damping,
                );
                add(
                    "the first mode moved",
                    PlantVariation {
                        gain,
                        ..PlantVariation::NONE
                    },
                    &LinearModel {
                        first_mode,
                        ..self.linear
                    },
                );
                if let (Some((share, mode)), Some(spread)) = (self.linear.second_mode, self.second)
                {
                    let second_mode = Some((
                        share,
                        moved(mode, 1.0 + up * spread.frequency, 1.0 - spread.damping),
                    ));
                    add(
                        "the second mode moved",
                        PlantVariation {
                            gain,
                            ..PlantVariation::NONE
                        },
                        &LinearModel {
                            second_mode,
                            ..self.linear
                        },
                    );
                }
            }
        }
        Conditions {
            plant: grid_hz
                .iter()
                .map(|hz| frequency_response(&nominal, TAU * hz))
                .collect(),
            unknown: grid_hz.iter().map(|hz| self.unknown_at(*hz)).collect(),
            grid_hz,
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
        Scan { candidates }
    }

    /// The grid of the predictors alone.
    #[must_use]
    pub fn coarse_scan(&self) -> Scan {
        Scan {
            candidates: grid(&Predictors(&self.linear), &self.conditions()),
        }
    }

    /// A candidate as the file of a design keeps it.
    #[must_use]
    pub fn assessment(&self, candidate: &Candidate) -> Assessment {
        let Assessment { margins, .. } =
            super::predictor::assess(&self.linear, &candidate.tuning, &self.demands);
        Assessment {
            tuning: candidate.tuning,
            noise_um: candidate.noise_um,
            disturbance_um: candidate.disturbance_um,
            margins,
            accepted: candidate.broken.is_none(),
        }
    }
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
        out.broken = Some(Broken::Member("nominal"));
        return out;
    };
    let beside = family.beside(tuning);
    let unstable = conditions.members.iter().find(|(_, plant)| {
        std::iter::once(&design).chain(&beside).any(|law| {
            let radius = law.spectral_radius(plant, 1.0, 0);
            radius.is_nan() || radius >= 1.0
        })
    });
    if let Some((name, _)) = unstable {
        out.broken = Some(Broken::Member(name));
        return out;
    }
    let law = &design.a - &design.l * design.c.transpose() - &design.b * design.k.transpose();
    let law = LawMatrices::of(&law, &design);
    let one = Complex::new(1.0, 0.0);
    let highest_hz = 0.5 / conditions.nominal.period_s;
    let (mut noise_power, mut last_hz, mut peak) = (0.0, 0.0, 0.0f64);
    let mut open = Vec::with_capacity(conditions.grid_hz.len());
    for (i, hz) in conditions.grid_hz.iter().enumerate() {
        let (k, p) = (law.response(*hz), conditions.plant[i]);
        let s = one / (one + p * k);
        open.push(p * k);
        let answer = k * s;
        noise_power += (p * answer).norm_sqr() * (hz - last_hz) / highest_hz;
        last_hz = *hz;
        peak = peak.max(s.norm());
        let unknown = answer.norm() * conditions.unknown[i];
        if unknown > out.unknown.0 || unknown.is_nan() {
            out.unknown = (unknown, *hz);
        }
    }
    out.noise_um = noise_power.sqrt() * conditions.demands.sensor_noise_um;
    let let_through = |reference_hz: f64| {
        let harmonics = [(1.0, 1.0), (2.0, 0.5), (3.0, 0.33), (5.0, 0.2)];
        let power: f64 = harmonics
            .iter()
            .map(|(harmonic, share)| {
                let hz = reference_hz * harmonic;
                let p = frequency_response(&conditions.nominal, TAU * hz);
                ((p / (one + p * law.response(hz))).norm()
                    * share
                    * conditions.demands.model_error_um)
                    .powi(2)
            })
            .sum();
        power.sqrt()
    };
    out.disturbance_um = let_through(conditions.demands.reference_hz);
    out.slow_um = let_through(0.1 * conditions.demands.reference_hz);
    out.sensitivity_peak = peak;
    out.gain_margin = gain_margin(&open);
    out.phase_margin_deg = phase_margin_deg(&open).unwrap_or(f64::INFINITY);
    if let Some(moving) = &conditions.moving {
        out.reference_deviation = moving.deviation(|hz| law.response(hz));
    }
    let swings = || {
        let swings_on = |plant: &SampledModel| {
            LIMIT_SHARES
                .iter()
                .any(|share| design.at_a_limit(*share).spectral_radius(plant, 1.0, 0) >= 1.0)
        };
        conditions
            .members
            .iter()
            .find(|(_, plant)| swings_on(plant))
            .map(|(name, _)| *name)
    };
    out.fits = family.fits(tuning, &design);
    out.broken = if peak.is_nan() || peak > conditions.demands.sensitivity_peak {
        Some(Broken::Sensitivity)
    } else if let Some(name) = swings() {
        Some(Broken::Limit(name))
    } else if out.unknown.0.is_nan() || out.unknown.0 > 1.0 {
        Some(Broken::Unknown { hz: out.unknown.1 })
    } else if !out.fits {
        Some(Broken::Integers)
    } else {
        None
    };
    out
}

/// The least factor that brings a crossing of the negative real axis to -1; infinite without one inside it.
fn gain_margin(open: &[Complex<f64>]) -> f64 {
    let crossings = open.windows(2).filter_map(|pair| {
        let (a, b) = (pair[0], pair[1]);
        let crosses = (a.im < 0.0) != (b.im < 0.0);
        let at = a.re + (b.re - a.re) * a.im / (a.im - b.im);
        (crosses && at < 0.0 && at > -1.0).then(|| -1.0 / at)
    });
    crossings.fold(f64::INFINITY, f64::min)
}

/// Whether a mode is inside what a loop with this sampling period, s, sees.
#[must_use]
pub fn within_nyquist(mode: &ModeModel, period_s: f64) -> bool {
    mode.natural_frequency_rad_s * period_s < PI
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
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
    fn margins_of_an_open_loop_are_those_of_its_crossings() {
        // An integrator with a delay of a sample and a half at this gain: w = k at gain 1, phase -90 - 1.5
        // w T.
        let gain = 2000.0;
        let open: Vec<Complex<f64>> = (1..4000)
            .map(|i| {
                let w = 10.0 * f64::from(i);
                Complex::from_polar(gain / w, -PI / 2.0 - 1.5 * w * SAMPLING_PERIOD_S)
            })
            .collect();
        // -180 degrees at w = pi / (3 T).
        let expected = PI / (3.0 * SAMPLING_PERIOD_S) / gain;
        assert!(
            (gain_margin(&open) / expected - 1.0).abs() < 1e-3,
            "{} {expected}",
            gain_margin(&open)
        );
        let phase = phase_margin_deg(&open).unwrap();
        assert!(
            (phase - (90.0 - (1.5 * gain * SAMPLING_PERIOD_S).to_degrees())).abs() < 0.1,
            "{phase}"
        );
    }

    #[test]
    fn the_usual_margins_are_kept_where_they_cost_less_than_a_third() {
        let candidate = |error_um: f64, sensitivity_peak: f64| Candidate {
            tuning: (),
            noise_um: error_um,
            disturbance_um: 0.0,
            slow_um: 0.0,
            sensitivity_peak,
            reference_deviation: 1.0,
            broken: None,
            unknown: (0.0, 0.0),
            fits: true,
            gain_margin: 3.0,
            phase_margin_deg: 40.0,
        };
        let taken = |usual_um: f64, wanted: bool| {
            let scan = Scan {
                candidates: vec![candidate(0.006, 2.4), candidate(usual_um, 1.7)],
            };
            scan.chosen(wanted).unwrap().sensitivity_peak
        };
        assert_eq!(
            [
                taken(0.0079, true),
                taken(0.0081, true),
                taken(0.0079, false)
            ],
            [1.7, 2.4, 2.4]
        );
        let small = Candidate {
            gain_margin: 2.4,
            ..candidate(0.006, 1.7)
        };
        assert!(
            !small.keeps_usual_margins()
                && !Candidate {
                    phase_margin_deg: 34.0,
                    ..candidate(0.006, 1.7)
                }
                .keeps_usual_margins()
        );
    }

    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn a_refined_tuning_is_better_than_every_point_of_the_scan_and_as_stable() {
        let spread = ModeSpread {
            frequency: 0.02,
            damping: 0.2,
        };
        let task = Task {
            linear: linear(false),
            first: spread,
            second: Some(spread),
            delay_s: 0.0,
            recording: None,
            mode_moves: 0.0,
            demands: Demands::default(),
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
        for (gain, extra_delay) in [(0.5, 0), (1.0, 0), (1.5, 0), (1.0, 1)] {
            assert!(
                law.spectral_radius(&plant, gain, extra_delay) < 1.0,
                "{gain} {extra_delay}"
            );
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
}
