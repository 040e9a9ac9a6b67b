//! The schemes that a design chooses among, under one set of margins, and what each does beside the predictor
//! on the same runs.

use super::candidate::{Candidate, Family};
use super::design::{Form, Scheme, ServoDesign};
use super::explanation::ScanWords;
use super::model::{ActuatorModel, NominalModel};
use super::reference::{PeriodicReference, Reference, ReferenceShape};
use super::regulator_loop::Regulators;
use super::robust::Task;
use super::scheme_choice::SchemeChoice;
use super::sliding_mode::{SlidingFamily, SlidingKind};
use super::thesis_conditions;
use super::thesis_schemes::PidGains;
use super::track::{Circumstances, track};
use super::tuning::Demands;
use hysteron_sim::chain::Model;
use serde::Serialize;

/// RMS and largest deviation of the largest loop from a straight line, um: what is left to the unknown input
/// where the hysteresis is not inverted.
#[must_use]
pub fn left_without_inverse_um(model: &ActuatorModel) -> (f64, f64) {
    const GRID: usize = 40;
    let (surfaces, travel_um) = (model.surfaces(), model.reach_um());
    let shares = || (0..=GRID).map(|k| k as f64 / GRID as f64);
    let rising = shares().map(|x| surfaces.loop_loss(x, 0.0) - travel_um * x);
    let falling = shares().map(|x| travel_um * (1.0 - x) - surfaces.loop_loss(1.0, x));
    let deviations: Vec<f64> = rising.chain(falling).collect();
    let mean = deviations.iter().sum::<f64>() / deviations.len() as f64;
    let rms = (deviations.iter().map(|d| (d - mean).powi(2)).sum::<f64>()
        / deviations.len() as f64)
        .sqrt();
    (rms, deviations.iter().map(|d| d.abs()).fold(0.0, f64::max))
}

/// What an inverted hysteresis leaves of itself at most, over its RMS error: three standard deviations.
pub(super) const LARGEST_OVER_RMS: f64 = 3.0;

/// Bound of the unknown input, V (Ch. 6, Eq. 13): the hysteresis that is not inverted, or the error of its
/// model, and the creep.
fn unknown_bound_v(model: &ActuatorModel, inverse: bool, demands: &Demands) -> f64 {
    let of_hysteresis_um = if inverse {
        LARGEST_OVER_RMS * demands.model_error_um
    } else {
        left_without_inverse_um(model).1
    };
    let creep: f64 = model.creep.iter().map(|term| term.share.abs()).sum();
    (of_hysteresis_um + creep * model.reach_um()) / model.mean_gain_um_v()
}

/// The mode and the mean gain of a model: what a sliding-mode law knows of it (Ch. 6, Eq. 3).
#[must_use]
pub fn nominal(model: &ActuatorModel) -> NominalModel {
    let mode = model.linear.first_mode;
    NominalModel {
        natural_frequency_rad_s: mode.natural_frequency_rad_s,
        damping_ratio: mode.damping_ratio,
        gain_um_v: model.mean_gain_um_v(),
    }
}

/// What a scan of one scheme chose; a trait object hides what it was tuned by.
pub(super) struct Chosen {
    /// The scheme with its gains.
    pub scheme: Scheme,
    /// Why, and what limits it.
    pub said: Vec<String>,
    /// Mass over the model's up to which it holds.
    pub mass_to: f64,
}

/// Scans a scheme other than the predictor; `explain` puts a scan's choice into words, or a refusal.
pub(super) fn choose(
    choice: SchemeChoice,
    inverse: bool,
    model: &ActuatorModel,
    task: &Task<'_>,
    words: &ScanWords<'_>,
) -> Result<Chosen, String> {
    let kind = match choice {
        SchemeChoice::Predictor => return Err("the predictor is designed by itself".into()),
        SchemeChoice::Pid => {
            let (chosen, mut said, mass_to) = scanned(&Regulators, task, words)?;
            let gains = chosen.tuning;
            said.push(format!(
                "P = {:.3}, I = {:.1} 1/s, D = {:.2e} s, in um of displacement per um of error.",
                gains.p, gains.i, gains.d
            ));
            let scheme = if inverse {
                Scheme::Feedforward {
                    gains,
                    notch: None,
                    creep_inverse: true,
                }
            } else {
                let per_um = 1.0 / model.mean_gain_um_v();
                Scheme::Pid {
                    gains: PidGains {
                        p: per_um * gains.p,
                        i: per_um * gains.i,
                        d: per_um * gains.d,
                    },
                    notch: None,
                }
            };
            return Ok(Chosen {
                scheme,
                said,
                mass_to,
            });
        }
        SchemeChoice::Pidsmoc => SlidingKind::Pidsmoc,
        SchemeChoice::PidsmcAlphaBeta => SlidingKind::PidsmcAlphaBeta,
        SchemeChoice::Smcbl => SlidingKind::BoundaryLayer,
    };
    let nominal = nominal(model);
    let family = SlidingFamily {
        kind,
        nominal,
        unknown_bound_v: unknown_bound_v(model, inverse, &task.demands),
    };
    let (chosen, mut said, mass_to) = scanned(&family, task, words)?;
    let (estimator, controller, reaching) = family.gains(&chosen.tuning);
    said.extend(thesis_conditions::gains_in_words(
        &nominal,
        &estimator,
        &controller,
        &reaching,
        task.demands.reference_hz,
    ));
    let form = Form::Predictor {
        hysteresis_inverse: inverse,
    };
    Ok(Chosen {
        scheme: Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching,
            form,
        },
        said,
        mass_to,
    })
}

/// A candidate, why it is taken, and the mass over the model's up to which it holds.
type Scanned<T> = (Candidate<T>, Vec<String>, f64);

fn scanned<F: Family>(
    family: &F,
    task: &Task<'_>,
    words: &ScanWords<'_>,
) -> Result<Scanned<F::Tuning>, String> {
    let scan = task.scan_of(family);
    let (best, said) = words.explain(&scan)?;
    Ok((best.clone(), said, scan.mass_to))
}

/// Amplitude of the sines on which schemes are compared, over the travel.
const SHOWN_AMPLITUDE: f64 = 0.3;

/// What one scheme does on one reference.
#[derive(Clone, Debug, Serialize)]
pub struct AtWork {
    /// Name of the scheme.
    pub scheme: String,
    /// Frequency of the sine, Hz.
    pub frequency_hz: f64,
    /// Its amplitude, um.
    pub amplitude_um: f64,
    /// RMS error of the true displacement, um.
    pub true_rms_um: f64,
    /// Largest error of the true displacement, um.
    pub true_max_um: f64,
}

/// Designs on the model that they were made for, on the same sines with the same noise.
#[must_use]
pub fn at_work(
    chain: &Model,
    designs: &[&ServoDesign],
    frequencies_hz: &[f64],
    noise_um: f64,
) -> Vec<AtWork> {
    let jobs: Vec<(&ServoDesign, f64)> = designs
        .iter()
        .flat_map(|design| frequencies_hz.iter().map(move |hz| (*design, *hz)))
        .collect();
    let run = |(design, hz): &(&ServoDesign, f64)| {
        let amplitude_um = SHOWN_AMPLITUDE * design.model.reach_um();
        let reference = PeriodicReference {
            shape: ReferenceShape::Sine,
            frequency_hz: *hz,
            amplitude_um,
            offset_um: 1.12 * amplitude_um,
            phase_deg: -90.0,
        };
        let circumstances = Circumstances {
            noise_um,
            seed: 1,
            disturbance: None,
        };
        let found = track(
            chain,
            design,
            &Reference::Periodic(reference),
            "",
            circumstances,
        );
        let (true_rms_um, true_max_um) = found.map_or((f64::NAN, f64::NAN), |found| {
            (found.truth.rms_um, found.truth.max_um)
        });
        AtWork {
            scheme: design.scheme_name().into(),
            frequency_hz: *hz,
            amplitude_um,
            true_rms_um,
            true_max_um,
        }
    };
    crate::parallel::map(&jobs, run)
}

/// The same in a sentence: each scheme with its errors in the order of the frequencies.
#[must_use]
pub fn at_work_in_words(rows: &[AtWork]) -> String {
    let mut schemes: Vec<&str> = rows.iter().map(|row| row.scheme.as_str()).collect();
    schemes.dedup();
    let of = |scheme: &str| {
        let errors: Vec<String> = rows
            .iter()
            .filter(|row| row.scheme == scheme)
            .map(|row| format!("{:.1}", 1e3 * row.true_rms_um))
            .collect();
        format!("{scheme} {} nm", errors.join(" / "))
    };
    let first = schemes.first().copied().unwrap_or_default();
    let hz: Vec<String> = rows
        .iter()
        .filter(|row| row.scheme == first)
        .map(|row| format!("{:.0}", row.frequency_hz))
        .collect();
    format!(
        "Expected on this model as it follows a sine, RMS error of the true position at {} Hz with an amplitude of {:.2} um: {}.",
        hz.join(" / "),
        rows.first().map_or(0.0, |row| row.amplitude_um),
        schemes.iter().map(|s| of(s)).collect::<Vec<_>>().join("; ")
    )
}
