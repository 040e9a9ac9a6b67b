//! PIDSMOC and PIDSMC + alpha-beta tuned by one optimiser under one set of margins, so that their order is that of the schemes and not of
//! somebody's gains.
//!
//! # How it works
//! A compass search over the logarithms of the gains from those of the thesis, the same number of evaluations for both. It first goes,
//! by eigenvalues alone, to where the margins hold: the sampled loop on the nominal model decays within 5 ms with the gain 50 % lower and
//! higher, with and without twice the moving mass. Then an evaluation is what a commissioning engineer would try: the integer servo
//! follows 10 Hz and 100 Hz on the bare bench, and the geometric mean of both RMS errors counts; what does not keep the margins is not
//! tried.

use crate::bench_runs::{SUBSTEPS, sine_reference_um, without_model};
use hysteron::servo::design::{Scheme, ServoDesign, thesis_scheme};
use hysteron::servo::model::NominalModel;
use hysteron::servo::thesis_schemes::{AlphaBeta, ControllerGains, Estimator, ObserverGains, ReachingGains, SlidingModeLaw};
use hysteron_core::servo_tick::ServoTick;
use hysteron_sim::bench::{Bench, Plant, Variant};
use hysteron_sim::closed_loop::Experiment;
use hysteron_sim::waveform::samples_in;

/// Evaluations of each search.
pub const EVALUATIONS: usize = 220;
/// Steps of the search in the logarithm of a gain, from the first to the last.
const STEPS: [f64; 4] = [0.7, 0.35, 0.18, 0.09];

/// Largest sampled eigenvalue that is accepted in any case of the margins: what disturbs the loop decays within 5 ms. With less damping the
/// lag of small hysteresis loops, which the linear plant does not have, makes it ring under load.
const LARGEST_EIGENVALUE: f64 = 0.99;
/// Largest eigenvalues at which the search by eigenvalues alone hands over: at the edge of the margins, further in, as far in as it gets.
const ENTRIES: [f64; 3] = [0.989, 0.98, 0.0];

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// PIDSMO and PIDSMC.
    Pidsmoc,
    /// PIDSMC with the continuous alpha-beta filter.
    PidsmcAlphaBeta,
}

impl Family {
    fn start(self) -> Vec<f64> {
        let controller = |g: ControllerGains| [g.m, g.p, g.i];
        match self {
            Self::Pidsmoc => {
                let o = ObserverGains::THESIS_PIDSMOC;
                controller(ControllerGains::THESIS_PIDSMOC).into_iter().chain([o.p, o.i, o.d]).collect()
            }
            Self::PidsmcAlphaBeta => {
                let f = AlphaBeta::THESIS_CHAPTER_7;
                controller(ControllerGains::THESIS_CHAPTER_7).into_iter().chain([f.natural_frequency_rad_s, f.damping_ratio]).collect()
            }
        }
    }

    fn scheme(self, gains: &[f64]) -> Option<Scheme> {
        let [m, p, i, rest @ ..] = gains else { return None };
        let controller = ControllerGains { m: *m, p: *p, i: *i, ..ControllerGains::THESIS_PIDSMOC };
        let estimator = match (self, rest) {
            (Self::Pidsmoc, [p, i, d]) => Estimator::Pidsmo(ObserverGains { p: *p, i: *i, d: *d }),
            (Self::PidsmcAlphaBeta, [w, xi]) => {
                Estimator::AlphaBeta(AlphaBeta { damping_ratio: *xi, natural_frequency_rad_s: *w, discrete: false })
            }
            _ => return None,
        };
        Some(Scheme::SlidingMode { nominal: NominalModel::THESIS, estimator, controller, reaching: ReachingGains::Pid })
    }
}

/// Largest sampled eigenvalue with the gain as it is, 50 % lower and 50 % higher, each without and with the mass doubled.
#[must_use]
pub fn worst_eigenvalue(scheme: &Scheme, delayed: bool) -> Option<f64> {
    let Scheme::SlidingMode { nominal, estimator, controller, reaching } = scheme else { return None };
    let law = SlidingModeLaw::new(nominal, estimator, controller, reaching);
    let mut worst: f64 = 0.0;
    for mass_ratio in [1.0_f64, 2.0] {
        for gain in [0.5, 1.0, 1.5] {
            let plant = NominalModel {
                natural_frequency_rad_s: nominal.natural_frequency_rad_s / mass_ratio.sqrt(),
                damping_ratio: nominal.damping_ratio / mass_ratio.sqrt(),
                gain_um_v: gain * nominal.gain_um_v,
            };
            let poles = law.closed_loop(&plant, usize::from(delayed)).complex_eigenvalues();
            worst = poles.iter().map(|z| z.norm()).fold(worst, f64::max);
        }
    }
    Some(worst)
}

/// A conditioned bench on which gains are tried.
struct Trial<'a> {
    bench: &'a Bench,
    plant: Plant,
    servo: ServoTick,
    zero_um: f64,
    references: [(Vec<f64>, usize); 2],
    delayed: bool,
}

impl<'a> Trial<'a> {
    fn new(bench: &'a Bench, delayed: bool) -> Option<Self> {
        let design = without_model(bench, thesis_scheme("pidsmoc")?);
        let parameters = design.parameters(bench.converter_scale().parameters()).ok()?;
        let (plant, servo, zero_um) = Self::experiment(bench).conditioned(ServoTick::new(parameters));
        // Half a second in which the reference grows, then two periods at 10 Hz or twenty at 100 Hz.
        let references = [10.0, 100.0].map(|hz| {
            let (mut reference, from) = sine_reference_um(bench, hz, 5.0);
            reference.truncate(from + samples_in(bench.converters.sample_rate_hz, 0.2));
            (reference, from)
        });
        Some(Self { bench, plant, servo, zero_um, references, delayed })
    }

    fn experiment(bench: &Bench) -> Experiment<'_> {
        Experiment { substeps: SUBSTEPS, ..Experiment::new(bench, Variant::PLAIN, 7) }
    }

    /// Logarithm of the product of both RMS errors, or nothing where the margins do not hold or the gains do not fit the tick.
    fn score(&self, scheme: &Scheme) -> Option<f64> {
        if worst_eigenvalue(scheme, self.delayed)? > LARGEST_EIGENVALUE {
            return None;
        }
        let design = ServoDesign { delayed: self.delayed, ..without_model(self.bench, scheme.clone()) };
        let mut servo = self.servo.clone();
        servo.swap(design.parameters(self.bench.converter_scale().zeroed_at(self.zero_um).parameters()).ok()?);
        let mut sum = 0.0;
        for (reference, from) in &self.references {
            let trace = Self::experiment(self.bench).follow_from(self.plant.clone(), servo.clone(), self.zero_um, reference);
            sum += trace.sensor_error(*from).rms_um.ln();
        }
        sum.is_finite().then_some(sum)
    }
}

/// Compass search over the logarithms of `gains`: every gain up and down in turn, with steps that shrink when nothing is gained, until
/// the score is below `enough` or the evaluations are used up. Candidates without a score are not taken.
fn search(gains: &mut Vec<f64>, evaluations: usize, enough: f64, score: impl Fn(&[f64]) -> Option<f64>) -> Option<f64> {
    let mut best = score(gains);
    let mut left = evaluations;
    for step in STEPS {
        loop {
            let before = best;
            for k in 0..gains.len() {
                for direction in [1.0, -1.0] {
                    if left == 0 || best.is_some_and(|b| b < enough) {
                        return best;
                    }
                    left -= 1;
                    let mut moved = gains.clone();
                    moved[k] *= f64::exp(direction * step);
                    let found = score(&moved);
                    if found.is_some_and(|f| best.is_none_or(|b| f < b)) {
                        (best, *gains) = (found, moved);
                        break;
                    }
                }
            }
            let gained = before.zip(best).map_or(best.is_some(), |(b, a)| b - a > 1e-4 * b.abs());
            if !gained {
                break;
            }
        }
    }
    best
}

/// Tunes one of the two; `delayed` as on the target, or as the thesis ran it.
#[must_use]
pub fn tune(bench: &Bench, family: Family, delayed: bool) -> Option<ServoDesign> {
    let trial = Trial::new(bench, delayed)?;
    let found = ENTRIES.into_iter().filter_map(|enough| {
        let mut gains = family.start();
        // Into the region where the margins hold, by eigenvalues alone; then by what the bench shows.
        search(&mut gains, 4 * EVALUATIONS, enough, |g| worst_eigenvalue(&family.scheme(g)?, delayed))
            .filter(|radius| *radius < LARGEST_EIGENVALUE)?;
        let score = search(&mut gains, EVALUATIONS, f64::NEG_INFINITY, |g| trial.score(&family.scheme(g)?))?;
        Some((score, gains))
    });
    let (_, gains) = found.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(ServoDesign { delayed, ..without_model(bench, family.scheme(&gains)?) })
}
