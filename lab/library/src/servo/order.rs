//! A servo for an identified chain: what is asked, what the recording knows, and the refusal where a servo
//! cannot be answered for.

use super::amplifier_block::FrontEnd;
use super::assessment::Assessment;
use super::candidate::{Candidate, Scan};
use super::check::gain_ratio;
use super::data_of_stage::require_same_stage;
use super::design::{DesignBasis, Scheme, ServoDesign, undominated};
use super::explanation::{ScanWords, shortcomings, where_the_mode_moves};
use super::feedforward::{feedforward, missed_of_reference};
use super::gain_adaptation::AdaptationDesign;
use super::known::{
    ASSUMED_NOISE_UM, Known, UNCONFIRMED, hertz, known, known_delay_s, require_known_in_a_loop,
};
use super::law::PredictorDesign;
use super::learned_feedforward::{self, LearningDesign};
use super::model::{ActuatorModel, SAMPLING_PERIOD_S, required_model};
use super::moving_mode::FARTHEST;
use super::plant_set::HELD_MASSES;
use super::quantise::QuantisationError;
use super::robust::{Task, within_nyquist};
use super::scheme_choice::SchemeChoice;
use super::schemes::{self, Chosen, LARGEST_OVER_RMS, left_without_inverse_um};
use super::sensor_lag;
use super::tuning::{Demands, PredictorTuning};
use crate::dataset::Dataset;
use hysteron_core::learned_feedforward::{LEAST_PERIOD_TICKS, MOST_POINTS};
use hysteron_sim::chain::Model;
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::effect::{
    amplifier_bandwidth, delay, gain, hysteresis, initial_curve, play_operators, second_mode,
    sensor_bandwidth, vibration,
};

/// What a design is ordered with.
#[derive(Clone, Copy)]
pub struct DesignOrder<'a> {
    /// Highest frequency of references, Hz.
    pub reference_hz: f64,
    /// Noise of the sensor, um RMS; without it that of the recording, or else [`ASSUMED_NOISE_UM`].
    pub sensor_noise_um: Option<f64>,
    /// Bandwidth of the sensor, Hz, whose lag is undone; without it what the model and the data set know
    /// ([`sensor_lag::known`]).
    pub sensor_bandwidth_hz: Option<f64>,
    /// Largest sensitivity that is accepted.
    pub sensitivity_peak: f64,
    /// The usual margins ([`Candidate::keeps_usual_margins`]) are kept where that costs less than a third of
    /// the error.
    pub usual_margins: bool,
    /// The recording that the chain was identified from: it excludes modes, and shows whether the first one
    /// is a fact.
    pub recording: Option<&'a Dataset>,
    /// How the converters are wired; without it they fit the actuator.
    pub front_end: Option<&'a FrontEnd>,
    /// The correction of a periodic reference is to be learned.
    pub learning: bool,
    /// The gain of the model is to be corrected while it runs.
    pub adaptation: bool,
    /// Share of its frequency by which the first mode moves to either side after it was recorded; zero where
    /// it stays.
    pub mode_moves: f64,
    /// The scheme.
    pub scheme: SchemeChoice,
    /// True: the hysteresis is inverted behind the law; false: it is left to the unknown input.
    pub inverse: bool,
}
impl Default for DesignOrder<'_> {
    fn default() -> Self {
        let Demands {
            reference_hz,
            sensitivity_peak,
            usual_margins,
            ..
        } = Demands::default();
        Self {
            reference_hz,
            sensor_noise_um: None,
            sensor_bandwidth_hz: None,
            sensitivity_peak,
            usual_margins,
            recording: None,
            front_end: None,
            learning: false,
            adaptation: false,
            mode_moves: 0.0,
            scheme: SchemeChoice::Predictor,
            inverse: true,
        }
    }
}

/// Gains over the model's at which every design holds ([`super::robust`]).
const GAIN_HELD: [f64; 2] = [0.5, 1.5];

/// Whether references of a loop with this sampling period, s, can have so high a frequency, Hz, whatever the
/// actuator.
///
/// # Errors
/// What was expected.
pub fn reasonable_frequency(reference_hz: f64, period_s: f64) -> Result<(), String> {
    let fastest_hz = 0.5 / period_s;
    let is_reasonable = reference_hz > 0.0 && reference_hz < fastest_hz;
    if is_reasonable {
        Ok(())
    } else {
        Err(format!(
            "{reference_hz}; expected above 0 and below {fastest_hz}"
        ))
    }
}

/// Whether a loop with this sampling period, s, can undo the lag of a sensor with this bandwidth, Hz, whatever
/// the actuator.
///
/// # Errors
/// What was expected.
pub fn reasonable_bandwidth(sensor_bandwidth_hz: Option<f64>, period_s: f64) -> Result<(), String> {
    let least_hz = sensor_lag::least_bandwidth_hz(period_s);
    match sensor_bandwidth_hz {
        Some(hz) if !(hz >= least_hz && hz.is_finite()) => Err(format!(
            "{hz}; expected at least {:.0}, the lag of {:.0} periods",
            least_hz.ceil(),
            sensor_lag::LARGEST_LAG_PERIODS
        )),
        _ => Ok(()),
    }
}

/// Whether the period of the fastest references is one that a correction is learned of.
fn period_that_is_learned(reference_hz: f64, period_s: f64) -> Result<(), String> {
    let rate_hz = 1.0 / period_s;
    let (lowest_hz, highest_hz) = (
        rate_hz / MOST_POINTS as f64,
        rate_hz / f64::from(LEAST_PERIOD_TICKS),
    );
    if (lowest_hz..=highest_hz).contains(&reference_hz) {
        return Ok(());
    }
    Err(format!(
        "--learning with --reference-hz {reference_hz}: corrections are learned of periods of {LEAST_PERIOD_TICKS} to {MOST_POINTS} samples, {:.1} to {:.0} Hz at {rate_hz:.0} Hz; name a frequency of these, or leave --learning out",
        (10.0 * lowest_hz).ceil() / 10.0,
        highest_hz.floor()
    ))
}

/// Only the predictor is computed for another sampling rate than the thesis'.
fn require_usual_rate(scheme: SchemeChoice, period_s: f64) -> Result<(), String> {
    if scheme == SchemeChoice::Predictor || period_s == SAMPLING_PERIOD_S {
        return Ok(());
    }
    Err(format!(
        "a sampling rate of {:.0} Hz is for the predictor; leave it out, or choose --scheme predictor",
        1.0 / period_s
    ))
}

/// Checks what is asked.
fn reasonable(order: &DesignOrder<'_>, model: &ActuatorModel) -> Result<(), String> {
    require_usual_rate(order.scheme, model.linear.period_s)?;
    let period_s = model.linear.period_s;
    reasonable_frequency(order.reference_hz, period_s)
        .map_err(|problem| format!("--reference-hz {problem}"))?;
    if order.learning {
        period_that_is_learned(order.reference_hz, period_s)?;
    }
    let travel_um = model.reach_um();
    if let Some(noise_um) = order.sensor_noise_um
        && !(noise_um > 0.0 && noise_um < 0.05 * travel_um)
    {
        return Err(format!(
            "--sensor-noise-um {noise_um}; expected above 0 and below {:.3}, a twentieth of the travel",
            0.05 * travel_um
        ));
    }
    reasonable_bandwidth(order.sensor_bandwidth_hz, period_s)
        .map_err(|problem| format!("--sensor-bandwidth-hz {problem}"))?;
    if !(order.sensitivity_peak > 1.0 && order.sensitivity_peak < 100.0) {
        return Err(format!(
            "--sensitivity-peak {}; expected above 1 and below 100",
            order.sensitivity_peak
        ));
    }
    if !(0.0..=FARTHEST).contains(&order.mode_moves) {
        return Err(format!(
            "--mode-moves {}; expected a share of the first mode's frequency from 0 to {FARTHEST}",
            order.mode_moves
        ));
    }
    if order.scheme != SchemeChoice::Predictor
        && let Some(option) = [
            (order.learning, "--learning"),
            (order.adaptation, "--adaptation"),
            (order.mode_moves > 0.0, "--mode-moves"),
        ]
        .into_iter()
        .find_map(|(asked, option)| asked.then_some(option))
    {
        return Err(format!(
            "{option} is for the predictor; leave it out, or choose --scheme predictor"
        ));
    }
    let mode = &model.linear.first_mode;
    if !within_nyquist(mode, period_s) {
        return Err(format!(
            "the first mode at {:.0} rad/s is beyond half the servo's sampling rate of {:.0} Hz",
            mode.natural_frequency_rad_s,
            1.0 / period_s
        ));
    }
    Ok(())
}

/// The model in the formats of the tick, and how far that moves its surfaces, um. What an inverse of other
/// slopes makes of the gain must stay within what every design holds.
fn formatted(
    chain: &Model,
    model: &ActuatorModel,
    inverse: bool,
) -> Result<(ActuatorModel, f64), String> {
    let (fitted, error_um) = model.for_the_tick();
    if !inverse {
        return Ok((fitted, error_um));
    }
    let (least, _) = fitted.slope_range();
    if least.is_nan() || least <= 0.0 {
        return Err(format!(
            "the hysteresis cannot be inverted: a section of a loop has a slope of {least:.2} times the mean one; record nested loops over the whole range, or leave the loops to the feedback (--no-inverse)"
        ));
    }
    let [least, _, largest] = gain_ratio(&fitted, chain, true).unwrap_or([f64::NAN; 3]);
    let [low, high] = GAIN_HELD;
    if !(least >= low && largest <= high) {
        return Err(format!(
            "the tick's polynomials of degree 4 do not follow the kinks of these loops: there the gain would be {least:.2} to {largest:.2} times the one that is inverted, and a design holds from {low} to {high}; leave the loops to the feedback (--no-inverse)"
        ));
    }
    Ok((fitted, error_um))
}

/// The servo's converters, if the actuator is within them.
fn converters(order: &DesignOrder<'_>, model: &ActuatorModel) -> Result<ConverterScale, String> {
    let top_um = model
        .surfaces()
        .initial_ascending_curve(1.0)
        .max(model.reach_um());
    let Some(front_end) = order.front_end else {
        return Ok(ConverterScale::around(
            model.drive_min_v,
            model.drive_max_v,
            top_um,
        ));
    };
    // The sensor is zeroed at the lowest drive, wherever it then stands: its span counts, and its zero must
    // be inside it.
    if !(front_end.sensor_min_um <= 0.0 && front_end.sensor_max_um >= top_um) {
        return Err(format!(
            "the stage moves from 0 to {top_um:.2} um, the board's sensor reads {} to {} um. Describe its range with --front-end FILE, or leave out --block: the servo needs no board",
            front_end.sensor_min_um, front_end.sensor_max_um
        ));
    }
    if front_end.drive_at_lowest_code_v > model.drive_min_v
        || front_end.drive_beyond_highest_code_v <= model.drive_max_v
    {
        return Err(format!(
            "the drive goes from {} to {} V, the board gives {} to {} V. Describe its range with --front-end FILE, or leave out --block: the servo needs no board",
            model.drive_min_v,
            model.drive_max_v,
            front_end.drive_at_lowest_code_v,
            front_end.drive_beyond_highest_code_v
        ));
    }
    Ok(front_end.scale(model.drive_min_v, model.drive_max_v))
}

/// A sensor cannot be this many times as late as everything that is late in the model together.
const MORE_THAN_ALL: f64 = 1.5;

/// The lag of the sensor that is undone, s, and in words why, or why not.
fn lag_to_undo(
    chain: &Model,
    order: &DesignOrder<'_>,
    period_s: f64,
    said: &mut Vec<String>,
) -> Option<f64> {
    let least_hz = sensor_lag::least_bandwidth_hz(period_s);
    let (hz, whose, doubt) =
        match sensor_lag::known(chain, order.recording, order.sensor_bandwidth_hz) {
            sensor_lag::Known::Bandwidth(hz, whose) => (hz, whose, None),
            sensor_lag::Known::Doubtful(hz, why) => (hz, "as identified", Some(why)),
            sensor_lag::Known::Ideal => return None,
        };
    if hz < least_hz {
        said.push(format!(
            "CAUTION: the sensor's lag is not undone: a bandwidth of {hz:.0} Hz is below the {:.0} Hz that can be.",
            least_hz.ceil()
        ));
        return None;
    }
    let lag_s = sensor_lag::lag_s(hz);
    let us = |lag_s: f64| format!("{:.1} us", 1e6 * lag_s);
    said.push(format!(
        "The sensor's bandwidth of {hz:.0} Hz ({whose}) is undone: the reference is made {} late before a reading is compared with it, so that the true position is not early.",
        us(lag_s)
    ));
    if let Some(why) = doubt {
        said.push(format!(
            "CAUTION: the lag of {} is the model's word, and {why}. If it is not the sensor's the true position follows so much late; name the data sheet's bandwidth with --sensor-bandwidth-hz.",
            us(lag_s)
        ));
    }
    if let Some(all_s) = sensor_lag::of_chain_s(chain).filter(|all_s| lag_s > MORE_THAN_ALL * all_s)
    {
        said.push(format!(
            "CAUTION: that is more than everything that is late in the model, {}: a recording that shows it has no sensor as slow; look at --sensor-bandwidth-hz.",
            us(all_s)
        ));
    }
    Some(lag_s)
}

/// Whether a servo can be computed for the model of an actuator, with an inverse of its loops.
///
/// # Errors
/// What the chain has that no loop knows beforehand, or lacks, that it moves against its drive, or that its
/// loops have no inverse in the tick.
pub fn designable(chain: &Model) -> Result<(), String> {
    formatted(chain, &known_model(chain)?, true).map(|_| ())
}

/// What a design knows of a chain, whatever is asked of it.
fn known_model(chain: &Model) -> Result<ActuatorModel, String> {
    require_known_in_a_loop(chain)?;
    let model = required_model(chain)?;
    let travel_um = model.reach_um();
    if travel_um > 0.0 {
        Ok(model)
    } else {
        Err(format!(
            "the model moves by {travel_um:.3} um as its drive rises over the whole range; a servo needs a displacement that rises with the drive: record it with the other sign, or read it so (--units y=-um)"
        ))
    }
}

/// What was chosen for a scheme, and the scan of a predictor.
fn chosen_scheme(
    choice: SchemeChoice,
    inverse: bool,
    model: &ActuatorModel,
    task: &Task<'_>,
) -> Result<(Chosen, Option<Scan>), String> {
    let words = ScanWords {
        task,
        recording: task.recording,
        scheme: choice,
        inverse,
    };
    if choice != SchemeChoice::Predictor {
        let chosen = schemes::choose(choice, inverse, model, task, &words)?;
        return Ok((chosen, None));
    }
    let scan = task.scan();
    let (chosen, said) = words.explain(&scan)?;
    let scheme = Scheme::Predictor {
        tuning: chosen.tuning,
        hysteresis_inverse: inverse,
    };
    let chosen = Chosen {
        scheme,
        said,
        mass_to: scan.mass_to,
    };
    Ok((chosen, Some(scan)))
}

/// What a chain has that the observer does not carry, in sentences.
fn not_carried(chain: &Model) -> Vec<String> {
    let carried = [
        gain::ID,
        hysteresis::ID,
        initial_curve::ID,
        play_operators::ID,
        vibration::ID,
        second_mode::ID,
        amplifier_bandwidth::ID,
        sensor_bandwidth::ID,
        delay::ID,
    ];
    let mut out = Vec::new();
    let delay_s = known_delay_s(chain);
    if delay_s > 0.0 {
        out.push(format!(
            "The observer does not carry the delay of {:.0} us; the loop is judged with it.",
            1e6 * delay_s
        ));
    }
    let mut left = chain.effect_ids();
    left.retain(|id| !carried.contains(&id.as_str()));
    if !left.is_empty() {
        out.push(format!("Left to the unknown input: {}.", left.join(", ")));
    }
    out
}

/// How the correction of a periodic reference is learned with a predictor of this tuning.
fn ordered_learning(
    tuning: &PredictorTuning,
    task: &Task<'_>,
    travel_um: f64,
) -> Result<LearningDesign, String> {
    let reference_hz = task.demands.reference_hz;
    let law = PredictorDesign::new(&task.linear, tuning);
    let learning = LearningDesign::new(&law, task, travel_um)?;
    if learning.learns_to_hz() < reference_hz {
        return Err(format!(
            "--learning with --reference-hz {reference_hz}: {} Name a slower reference, or leave --learning out",
            learning.in_words()
        ));
    }
    Ok(learning)
}

/// Designs a servo that holds for everything that is left possible.
///
/// # Errors
/// A message that says what the model or the recording lacks, or which demand cannot be met.
pub fn design(chain: &Model, order: &DesignOrder<'_>) -> Result<ServoDesign, String> {
    let mut model = known_model(chain)?;
    model.linear.period_s = order
        .front_end
        .map_or(SAMPLING_PERIOD_S, FrontEnd::period_s);
    reasonable(order, &model)?;
    if let Some(dataset) = order.recording {
        require_same_stage(chain, dataset)?;
    }
    let mut said = Vec::new();
    let (model, moved_um) = formatted(chain, &model, order.inverse)?;
    if moved_um > 0.0 && order.inverse {
        said.push(format!(
            "The tick's polynomials of degree 4 stand for the model's loops, at most {:.1} nm off; the feedback takes that.",
            1e3 * moved_um
        ));
    }
    let scale = converters(order, &model)?;
    let Known {
        model,
        mut first,
        second,
        left_out,
        recording,
    } = known(chain, model, order.recording, &mut said)?;
    first.frequency = first.frequency.max(order.mode_moves);
    shortcomings(chain, recording.as_ref(), &mut said);
    let rounding_um = scale.adc_lsb_um / 12f64.sqrt();
    let told_noise_um = order
        .sensor_noise_um
        .or(recording.as_ref().and_then(|r| r.noise_um));
    let sensor_noise_um = told_noise_um.unwrap_or(ASSUMED_NOISE_UM).hypot(rounding_um);
    let largest = if order.learning {
        learned_feedforward::SENSITIVITY_PEAK
    } else {
        f64::INFINITY
    };
    let sensitivity_peak = order.sensitivity_peak.min(largest);
    let DesignOrder {
        reference_hz,
        usual_margins,
        ..
    } = *order;
    let mut demands = Demands {
        reference_hz,
        sensor_noise_um,
        sensitivity_peak,
        usual_margins,
        model_error_um: (Demands::default().model_error_um).max(moved_um / LARGEST_OVER_RMS),
    };
    let basis = DesignBasis {
        demands,
        first,
        second,
        delay_s: known_delay_s(chain),
        mass_to: HELD_MASSES[0],
    };
    if !order.inverse {
        demands.model_error_um = demands
            .model_error_um
            .max(left_without_inverse_um(&model).0);
    }
    let task = Task {
        linear: model.linear,
        first,
        second,
        left_out,
        recording: recording.as_ref(),
        mode_moves: order.mode_moves,
        mass_to: basis.mass_to,
        demands,
        delay_s: basis.delay_s,
    };
    // A PID alone feeds nothing forward.
    let feeds_forward = order.scheme != SchemeChoice::Pid || order.inverse;
    let missed = if feeds_forward {
        missed_by_feedforward(&task)?
    } else {
        None
    };
    let (found, scan) = chosen_scheme(order.scheme, order.inverse, &model, &task)?;
    let best = scan.as_ref().and_then(|scan| scan.chosen(usual_margins));
    let mut design = ServoDesign::new(found.scheme, &model, true);
    design.explanation = found.said;
    design.noise_shaping = true;
    design.basis = Some(DesignBasis {
        mass_to: found.mass_to,
        ..basis
    });
    design.sensor_noise_um = told_noise_um;
    design.sensor_lag_s = lag_to_undo(chain, order, model.linear.period_s, &mut said);
    design
        .parameters(scale.parameters())
        .map_err(|e| without_integers(&e))?;
    if let Some(chosen) = best.filter(|_| order.mode_moves > 0.0) {
        design.explanation.push(where_the_mode_moves(&task, chosen));
    }
    design.explanation.extend(missed);
    design.explanation.extend(said);
    design.explanation.extend(not_carried(chain));
    if let Some(chosen) = best.filter(|_| order.learning) {
        let learning = ordered_learning(&chosen.tuning, &task, model.reach_um())?;
        design.explanation.push(learning.in_words());
        design.learning = Some(learning);
    }
    if order.adaptation {
        let adaptation = AdaptationDesign::new(model.reach_um());
        design.explanation.push(adaptation.in_words());
        design.adaptation = Some(adaptation);
    }
    design
        .parameters(scale.parameters())
        .map_err(|e| without_integers(&e))?;
    if let Some(scan) = scan {
        design.trade_off = trade_off(&task, &scan, |_| true);
        design.trade_off_usual = trade_off(&task, &scan, Candidate::keeps_usual_margins);
        design.chosen = scan
            .chosen(usual_margins)
            .map(|chosen| task.assessment(chosen));
    }
    Ok(design)
}

/// What a design was made for, without the recording behind it.
fn without_recording(design: &ServoDesign) -> Task<'static> {
    let linear = design.model.linear;
    let basis = design.basis.unwrap_or_else(|| DesignBasis {
        demands: Demands {
            sensor_noise_um: design.sensor_noise_um.unwrap_or(ASSUMED_NOISE_UM),
            ..Demands::default()
        },
        first: UNCONFIRMED,
        second: linear.second_mode.map(|_| UNCONFIRMED),
        delay_s: 0.0,
        mass_to: HELD_MASSES[0],
    });
    Task {
        linear,
        first: basis.first,
        second: basis.second,
        left_out: None,
        delay_s: basis.delay_s,
        recording: None,
        mode_moves: 0.0,
        mass_to: HELD_MASSES[0],
        demands: basis.demands,
    }
}

/// Another scheme for the model of a design, with nothing known but the model: no recording stands behind it.
///
/// # Errors
/// The refusal.
pub fn scheme_without_recording(
    design: &ServoDesign,
    choice: SchemeChoice,
    inverse: bool,
) -> Result<Scheme, String> {
    let model = &design.model;
    require_usual_rate(choice, design.period_s())?;
    let mut task = without_recording(design);
    if !inverse {
        let left_um = left_without_inverse_um(model).0;
        task.demands.model_error_um = task.demands.model_error_um.max(left_um);
    }
    Ok(chosen_scheme(choice, inverse, model, &task)?.0.scheme)
}

/// Why there is no servo although a tuning holds.
fn without_integers(error: &QuantisationError) -> String {
    format!(
        "the model has no place in the servo's integers: {error}. Displacements are held to +-128 um and drives to +-512 V; record a smaller part of a longer travel, or check the units (--units)"
    )
}

/// A feedforward that leaves more of a reference than this is reported; from all of it on, no servo follows.
const MISSED_TOLD: f64 = 0.01;
const MISSED_MOST: f64 = 1.0;

/// That the feedforward cannot be the model's inverse up to the highest reference, where it cannot.
///
/// # Errors
/// If it would move the stage by another reference than was asked for.
fn missed_by_feedforward(task: &Task<'_>) -> Result<Option<String>, String> {
    let (sampled, reference_hz) = (task.linear.sampled(), task.demands.reference_hz);
    let taps = feedforward(&sampled);
    let missed: Vec<(f64, f64)> = (1..=100)
        .map(|i| 0.01 * f64::from(i) * reference_hz)
        .map(|hz| (hz, missed_of_reference(&sampled, &taps, hz)))
        .collect();
    let followed_to_hz = |most: f64| {
        missed
            .iter()
            .take_while(|(_, missed)| *missed <= most)
            .last()
            .map_or(0.0, |(hz, _)| *hz)
    };
    let most = missed.iter().map(|(_, missed)| *missed).fold(0.0, f64::max);
    if most.is_nan() || most > MISSED_MOST {
        return Err(format!(
            "references up to {reference_hz:.0} Hz cannot be followed: the first mode at {:.0} Hz is too slow, or the stage hardly moves near there, for the {:.1} ms of its reference that the servo sees; {}",
            hertz(&task.linear.first_mode),
            1e3 * task.linear.period_s * hysteron_core::reference_window::WINDOW as f64,
            match followed_to_hz(0.1 * MISSED_MOST) {
                hz if hz > 0.0 => format!("name a --reference-hz of at most {hz:.1}"),
                _ => "it needs a stage with a faster first mode".into(),
            }
        ));
    }
    Ok((most > MISSED_TOLD).then(|| {
        format!(
            "CAUTION: up to {reference_hz:.0} Hz the feedforward alone misses up to {:.0} % of a reference (1 % at {:.0} Hz): the stage is slow, or hardly moves, near there; a lower --reference-hz is followed better.",
            100.0 * most,
            followed_to_hz(MISSED_TOLD)
        )
    }))
}

/// How a predictor learns where no recording stands behind its model: an unknown mode is reckoned with
/// everywhere from the first mode on.
///
/// # Errors
/// If the design is another scheme, or nothing can be learned.
pub fn learning_without_recording(design: &ServoDesign) -> Result<LearningDesign, String> {
    let Scheme::Predictor { tuning, .. } = &design.scheme else {
        return Err("a correction is learned with the predictor scheme only".into());
    };
    let task = without_recording(design);
    LearningDesign::new(
        &PredictorDesign::new(&task.linear, tuning),
        &task,
        design.model.reach_um(),
    )
}

/// The good candidates that no other one beats in both noise and error let through, by rising noise.
fn trade_off(task: &Task<'_>, scan: &Scan, which: impl Fn(&Candidate) -> bool) -> Vec<Assessment> {
    let good: Vec<_> = scan
        .candidates
        .iter()
        .filter(|c| c.broken.is_none() && which(c))
        .collect();
    let good = undominated(good, |c| c.noise_um, |c| c.disturbance_um);
    good.into_iter().map(|c| task.assessment(c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::amplifier_block::amplifier_parameters;
    use crate::servo::model::{LinearModel, ModeModel};
    use crate::servo::robust::ModeSpread;
    use crate::servo::sampled_loop::SampledLoop;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    /// What a servo cannot follow is refused by what the user asked for, and what it follows badly is
    /// reported.
    #[test]
    fn a_reference_beyond_what_the_feedforward_can_do_is_refused_with_one_that_it_can() {
        let missed = |first_hz: f64, second: bool, reference_hz: f64| {
            let mode = |hz: f64| ModeModel {
                natural_frequency_rad_s: std::f64::consts::TAU * hz,
                damping_ratio: 0.02,
            };
            let spread = ModeSpread {
                frequency: 0.02,
                damping: 0.2,
            };
            missed_by_feedforward(&Task {
                linear: LinearModel {
                    first_mode: mode(first_hz),
                    second_mode: second.then(|| (0.1, mode(900.0))),
                    amplifier_bandwidth_hz: None,
                    sensor_bandwidth_hz: None,
                    period_s: 5e-5,
                },
                first: spread,
                second: second.then_some(spread),
                left_out: None,
                delay_s: 0.0,
                recording: None,
                mode_moves: 0.0,
                mass_to: HELD_MASSES[0],
                demands: Demands {
                    reference_hz,
                    ..Demands::default()
                },
            })
        };
        assert_eq!(missed(380.0, false, 150.0), Ok(None));
        assert_eq!(missed(380.0, true, 100.0), Ok(None));
        assert!(
            missed(150.0, false, 150.0)
                .unwrap()
                .is_some_and(|said| said.contains("lower --reference-hz"))
        );
        let refused = missed(60.0, false, 150.0).unwrap_err();
        assert!(
            refused.contains("name a --reference-hz of at most") && !refused.contains("row"),
            "{refused}"
        );
        assert!(
            missed(380.0, true, 900.0)
                .unwrap_err()
                .contains("--reference-hz")
        );
    }

    /// The stage is the same in seconds, the block is one that an image of that rate takes, and a file keeps
    /// the rate.
    #[test]
    fn a_predictor_is_designed_for_every_rate_and_the_others_for_one() {
        let overview = Overview::without_data(0.0, 80.0);
        let mut chain = Model::new(0.0, 80.0);
        for (id, values) in [
            ("hysteresis", &[9.0, 1.0, -2.0][..]),
            ("vibration", &[5_300.0, 0.6]),
        ] {
            chain.add(EffectInstance::new(
                by_id(id).expect("an effect"),
                &overview,
                values,
            ));
        }
        let usual = FrontEnd::default();
        for sample_rate_hz in [50_000, 100_000] {
            let front_end = FrontEnd {
                sample_rate_hz,
                ..FrontEnd::default()
            };
            let order = DesignOrder {
                front_end: Some(&front_end),
                ..DesignOrder::default()
            };
            let servo = design(&chain, &order).expect("a servo");
            let law = servo.law().expect("a law");
            assert!(SampledLoop::new(&law, &servo.model.linear.sampled()).is_stable());
            let parameters = amplifier_parameters(&servo, &front_end).expect("a block");
            assert_eq!(
                (servo.period_s(), parameters.physical.sample_rate_hz),
                (front_end.period_s(), sample_rate_hz)
            );
            let text = toml::to_string(&servo).expect("a file");
            assert_eq!(
                toml::from_str::<ServoDesign>(&text)
                    .expect("a servo")
                    .period_s(),
                servo.period_s()
            );
            assert!(
                amplifier_parameters(&servo, &usual)
                    .unwrap_err()
                    .to_string()
                    .contains("designed for")
            );
            let refused = design(
                &chain,
                &DesignOrder {
                    scheme: SchemeChoice::Pid,
                    ..order
                },
            )
            .unwrap_err();
            assert!(refused.contains("--scheme predictor"), "{refused}");
        }
    }
}
