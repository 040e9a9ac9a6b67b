//! Following a reference on an identified model: the chain of effects as the plant, the integers of the tick
//! as the controller.
//!
//! The plant is a [`ChainPlant`]. Converters are those of a board that fits the actuator: the DAC spans the
//! drive range with a quarter of it below and half of it above, the ADC the motion with a third to spare (for
//! the P-753 the converters of the bench). The actuator is conditioned and the sensor zeroed before it
//! begins. [`super::members`] puts other plants in the place of the model.

use super::chain_plant::{ChainPlant, HysteresisChange};
use super::design::ServoDesign;
use super::disturbance::Disturbance;
use super::model::actuator_model;
use super::quantise::QuantisationError;
use super::reference::Reference;
use super::sensor_lag;
use crate::statistics::extremes;
use hysteron_core::gain_adaptation::ONE;
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_tick::ServoTick;
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::{
    Controller, ErrorFigures, Plant, RepeatsLater, Surroundings, condition, follow,
};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::effect::sensor_bandwidth;
use hysteron_sim::waveform;
use serde::Serialize;

/// The servo of a design, with its sampling period, s; it receives the period of its reference, in ticks, once
/// that has grown.
#[must_use]
pub fn repeats_when_grown(
    servo: ServoTick,
    period_ticks: Option<u32>,
    period_s: f64,
) -> RepeatsLater {
    RepeatsLater {
        servo,
        period_ticks,
        wait_ticks: waveform::samples_in(1.0 / period_s, waveform::GROWN_WITHIN_S),
    }
}

/// RMS and largest error.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TrackingFigures {
    /// RMS, um.
    pub rms_um: f64,
    /// Largest magnitude, um.
    pub max_um: f64,
}

impl From<ErrorFigures> for TrackingFigures {
    fn from(e: ErrorFigures) -> Self {
        Self {
            rms_um: e.rms_um,
            max_um: e.max_um,
        }
    }
}

/// Another scheme on the same run.
#[derive(Clone, Debug, Serialize)]
pub struct Beside {
    /// Its name.
    pub scheme: String,
    /// Error of the true displacement.
    #[serde(rename = "true")]
    pub truth: TrackingFigures,
}

/// What a step became.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StepFigures {
    /// Size of the step, um.
    pub by_um: f64,
    /// Time from the step on after which the true error stays within [`SETTLED`] of it, s; none where it does
    /// not.
    pub settling_s: Option<f64>,
    /// Time from a tenth to nine tenths of it, s.
    pub rise_s: Option<f64>,
    /// How far the true position goes beyond it, over its size.
    pub overshoot: f64,
}

/// Share of a step within which it is settled.
pub const SETTLED: f64 = 0.02;
/// Share of the time behind a step in which it has to stay settled, so that it counts.
const STAYS: f64 = 0.1;

impl StepFigures {
    /// Of a true position; the step is at a tick.
    fn measured(
        displacement_um: &[f64],
        at: usize,
        [from_um, by_um]: [f64; 2],
        period_s: f64,
    ) -> Self {
        let progress = |k: usize| (displacement_um[k] - from_um) / by_um;
        let seconds = |ticks: usize| ticks as f64 * period_s;
        let behind = displacement_um.len().saturating_sub(at);
        // Nothing is read here that is outside: every k is below the length.
        let outside = (at..displacement_um.len())
            .rev()
            .find(|k| (progress(*k) - 1.0).abs() > SETTLED)
            .map_or(0, |k| k + 1 - at);
        let settled = outside as f64 <= (1.0 - STAYS) * behind as f64;
        // The servo looks ahead, so it may set out before the step.
        let first_beyond = |share: f64| {
            (at.saturating_sub(PREVIEW_TICKS)..displacement_um.len())
                .find(|k| progress(*k) >= share)
        };
        Self {
            by_um,
            settling_s: settled.then(|| seconds(outside)),
            rise_s: first_beyond(0.1)
                .zip(first_beyond(0.9))
                .map(|(low, high)| seconds(high.saturating_sub(low))),
            overshoot: (at..displacement_um.len())
                .map(|k| progress(k) - 1.0)
                .fold(0.0, f64::max),
        }
    }
}

/// What the drive does while the error counts.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct DriveFigures {
    /// Lowest and highest drive, V.
    pub range_v: [f64; 2],
    /// Largest rate from tick to tick, V/s.
    pub rate_max_v_s: f64,
    /// RMS rate from tick to tick, V/s.
    pub rate_rms_v_s: f64,
}

impl DriveFigures {
    fn measured(drive_v: &[f64], from: usize, period_s: f64) -> Self {
        let counted = drive_v.get(from..).unwrap_or_default();
        let rates: Vec<f64> = counted
            .windows(2)
            .map(|w| (w[1] - w[0]) / period_s)
            .collect();
        let (low, high) = extremes(counted);
        Self {
            range_v: [low, high],
            rate_max_v_s: rates.iter().map(|r| r.abs()).fold(0.0, f64::max),
            rate_rms_v_s: (rates.iter().map(|r| r * r).sum::<f64>() / rates.len().max(1) as f64)
                .sqrt(),
        }
    }
}

/// What `hysteron track` found.
#[derive(Clone, Debug, Serialize)]
pub struct TrackResult {
    /// `hysteron.track/1`.
    pub schema: String,
    /// Scheme.
    pub scheme: String,
    /// Reference as given.
    pub reference: String,
    /// What the servo was put to work on, and when its codes act.
    pub plant: String,
    /// The predictor that was designed for the same order, on the same run; none where the scheme is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beside: Option<Beside>,
    /// Error of what the sensor reads, noise removed.
    pub sensor: TrackingFigures,
    /// Error of the readings as hardware shows them: the sensor's noise and the steps of its converter
    /// included.
    pub as_read: TrackingFigures,
    /// Error of the true displacement.
    #[serde(rename = "true")]
    pub truth: TrackingFigures,
    /// Mean error of what the sensor reads, um.
    pub steady_state_um: f64,
    /// Mean error of the true displacement, um: the sensor is zeroed on one reading, and what noise a plant of
    /// one's own adds to it stays in every error.
    pub true_mean_um: f64,
    /// How late the servo takes the sensor to be, s, where it undoes that: what is read is then off what was
    /// asked for by so much of the motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor_lag_s: Option<f64>,
    /// How late the sensor of the model is at rest, s, where the model has such a lag.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_sensor_lag_s: Option<f64>,
    /// What the step became, where the reference is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<StepFigures>,
    /// What the drive did.
    pub drive: DriveFigures,
    /// RMS noise of the sensor, um.
    pub noise_um: f64,
    /// Force from outside, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disturbance: Option<Disturbance>,
    /// Gain over the model's at the end, where it is corrected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapted_gain: Option<f64>,
    /// Ticks in which the drive was at a limit while the error counts, and values that left their format.
    pub saturated_ticks: u32,
    /// Ticks that came too late: none in a simulation.
    pub overruns: u32,
    /// Sampling period, s.
    #[serde(skip)]
    pub period_s: f64,
    /// Time, s, of each sample of the signals for the report.
    #[serde(skip)]
    pub time_s: Vec<f64>,
    /// Reference, um.
    #[serde(skip)]
    pub reference_um: Vec<f64>,
    /// What the sensor reads, noise removed, um.
    #[serde(skip)]
    pub sensor_um: Vec<f64>,
    /// True position, um.
    #[serde(skip)]
    pub displacement_um: Vec<f64>,
    /// What the converter gives, um.
    #[serde(skip)]
    pub reading_um: Vec<f64>,
    /// Drive, V.
    #[serde(skip)]
    pub drive_v: Vec<f64>,
    /// The tick from which the error counts.
    #[serde(skip)]
    pub counts_from: usize,
}

impl TrackResult {
    /// Why this is no tracking, if so: the drive at its limits while the error counts, or an error of the
    /// size of the reference.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        // A step that stays settled shows that the drive came away from its limit.
        let is_settled = self.step.is_some_and(|step| step.settling_s.is_some());
        if self.saturated_ticks > 0 && !is_settled {
            let ticks = if self.saturated_ticks == 1 {
                "tick"
            } else {
                "ticks"
            };
            return Some(format!(
                "the drive was at a limit in {} {ticks} while the error counts: this servo does not hold this actuator on this reference",
                self.saturated_ticks
            ));
        }
        let (low, high) = extremes(&self.reference_um);
        let large_um = LARGE_ERROR * (high - low);
        (high > low && (self.truth.rms_um.is_nan() || self.truth.rms_um > large_um)).then(|| {
            format!(
                "the true error of {:.1} nm RMS is above {:.0} % of the reference: this is no tracking",
                1e3 * self.truth.rms_um,
                100.0 * LARGE_ERROR
            )
        })
    }
}

/// An error of this share of the reference, peak to peak, is no tracking.
const LARGE_ERROR: f64 = 0.1;

/// What surrounds a servo at work.
#[derive(Clone, Copy, Debug)]
pub struct Circumstances {
    /// RMS noise of the sensor, um.
    pub noise_um: f64,
    /// The same seed gives the same noise.
    pub seed: u64,
    /// A force from outside.
    pub disturbance: Option<Disturbance>,
}

/// The converters that a servo is put to work with.
fn fitting_converters(design: &ServoDesign) -> ConverterScale {
    let model = &design.model;
    ConverterScale::around(
        model.drive_min_v,
        model.drive_max_v,
        model.surfaces().initial_ascending_curve(1.0),
    )
}

/// A cycle over the whole range, and a rest of a second at the lowest drive.
fn conditioning_v(design: &ServoDesign) -> Vec<f64> {
    let (fs, model) = (1.0 / design.period_s(), &design.model);
    waveform::concatenate(&[
        waveform::raised_cosine(fs, 10.0, model.drive_min_v, model.drive_max_v, 1),
        waveform::hold(fs, model.drive_min_v, 1.0),
    ])
}

/// A servo that a loop of the caller's asks tick by tick, behind the converters of [`track`].
pub struct RunningServo {
    servo: ServoTick,
    scale: ConverterScale,
}

impl RunningServo {
    /// Closes the loop on a stage that was conditioned and rests at its lowest drive. Readings count from there.
    ///
    /// # Errors
    /// The number that does not fit the servo's formats.
    pub fn new(design: &ServoDesign) -> Result<Self, QuantisationError> {
        let scale = fitting_converters(design);
        let mut servo = ServoTick::new(design.parameters(scale.parameters())?);
        for drive_v in conditioning_v(design) {
            servo.open_loop(scale.dac_code(drive_v));
        }
        let scale = scale.zeroed_at(0.0);
        servo.take_scale(&scale);
        Controller::enable(&mut servo);
        Ok(Self { servo, scale })
    }

    /// A reading, um, and the reference so many ticks ahead as [`PREVIEW_TICKS`], um, give the drive that acts
    /// in the next period, V.
    pub fn tick(&mut self, reading_um: f64, ahead_um: f64) -> f64 {
        let code = self.scale.adc_code(reading_um);
        let code = Controller::tick(&mut self.servo, code, ahead_um);
        self.scale.drive_v(code)
    }
}

/// The timing of a run, behind what the plant is.
fn timing_in_words(design: &ServoDesign) -> String {
    let scale = fitting_converters(design);
    let acts = if design.delayed {
        format!(
            "one period of {:.0} us after its reading, as on the target",
            1e6 * design.period_s()
        )
    } else {
        "at once, which no target does".to_owned()
    };
    format!(
        "codes of {} and {} bits; a code acts {acts}",
        scale.adc_bits, scale.dac_bits
    )
}

/// What a chain is to the design.
fn chain_in_words(chain: &Model, design: &ServoDesign) -> String {
    let servo_knows = actuator_model(chain).map(|model| model.for_the_tick().0.linear.first_mode)
        == Some(design.model.linear.first_mode);
    format!(
        "simulated from the model's effects {}{}",
        chain.effect_ids().join(", "),
        if servo_knows {
            ", of which the servo was designed"
        } else {
            ", which is not the model that the servo was designed for"
        }
    )
}

/// Follows a reference on a model; a correction is learned from the tick on at which the reference has its
/// full amplitude.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn track(
    chain: &Model,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    circumstances: Circumstances,
) -> Result<TrackResult, QuantisationError> {
    track_on(
        chain,
        HysteresisChange::NONE,
        design,
        reference,
        reference_name,
        circumstances,
    )
}

/// The same with another gain and wider loops than the chain has.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn track_on(
    chain: &Model,
    change: HysteresisChange,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    circumstances: Circumstances,
) -> Result<TrackResult, QuantisationError> {
    let mut plant = ChainPlant::changed(chain, change, design.model.drive_min_v, design.period_s());
    let found = track_plant(
        &mut plant,
        &chain_in_words(chain, design),
        design,
        reference,
        reference_name,
        circumstances,
    )?;
    Ok(TrackResult {
        model_sensor_lag_s: chain
            .values(sensor_bandwidth::ID)
            .and_then(|v| v.first().copied())
            .map(sensor_lag::lag_s),
        ..found
    })
}

/// Follows a reference on any plant, from rest at its lowest drive; `called` says what the plant is.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn track_plant(
    plant: &mut impl Plant,
    called: &str,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    circumstances: Circumstances,
) -> Result<TrackResult, QuantisationError> {
    let Circumstances {
        noise_um,
        seed,
        disturbance,
    } = circumstances;
    let period_s = design.period_s();
    let (reference_um, from) = reference.samples_um(design);
    let external_um = disturbance.map_or_else(Vec::new, |d| {
        d.samples_um(reference_um.len(), from, period_s)
    });
    let scale = fitting_converters(design);
    let mut servo = ServoTick::new(design.parameters(scale.parameters())?);
    condition(plant, &mut servo, &scale, &conditioning_v(design));
    let around = Surroundings {
        scale: scale.zeroed_at(plant.sensor_um()),
        noise_um,
        seed,
        external_um: &external_um,
        sensor_zero_um: plant.sensor_um(),
        displacement_zero_um: plant.displacement_um(),
    };
    servo.take_scale(&around.scale);
    let mut repeats = repeats_when_grown(servo, reference.period_ticks(period_s), period_s);
    let trace = follow(plant, &mut repeats, &around, &reference_um);
    let samples = trace.sensor_um.len();
    let step = match reference {
        Reference::Step { from_um, by_um } => Some(StepFigures::measured(
            &trace.displacement_um,
            from,
            [*from_um, *by_um],
            period_s,
        )),
        Reference::Periodic(_) | Reference::Points(_) => None,
    };
    let mean = |signal: Vec<f64>| signal.iter().sum::<f64>() / signal.len().max(1) as f64;
    Ok(TrackResult {
        schema: "hysteron.track/1".into(),
        scheme: design.scheme_name().into(),
        reference: reference_name.into(),
        plant: format!("{called}; {}", timing_in_words(design)),
        beside: None,
        sensor: trace.sensor_error(from).into(),
        truth: trace.true_error(from).into(),
        as_read: ErrorFigures::between(&trace.reading_um, &trace.reference_um, from).into(),
        step,
        drive: DriveFigures::measured(&trace.drive_v, from, period_s),
        sensor_lag_s: design.sensor_lag_s,
        model_sensor_lag_s: None,
        noise_um,
        disturbance,
        adapted_gain: repeats
            .servo
            .adaptation()
            .map(|adaptation| f64::from(adaptation.gain()) / f64::from(ONE)),
        steady_state_um: mean(
            (from..samples)
                .map(|k| trace.sensor_um[k] - trace.reference_um[k])
                .collect(),
        ),
        true_mean_um: mean(
            (from..samples)
                .map(|k| trace.displacement_um[k] - trace.reference_um[k])
                .collect(),
        ),
        saturated_ticks: trace
            .limited_after(from)
            .saturating_add(trace.counters.saturated_values),
        overruns: 0,
        period_s,
        time_s: (0..samples).map(|k| k as f64 * period_s).collect(),
        reference_um: trace.reference_um,
        sensor_um: trace.sensor_um,
        displacement_um: trace.displacement_um,
        reading_um: trace.reading_um,
        drive_v: trace.drive_v,
        counts_from: from,
    })
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
    use super::*;

    #[test]
    fn a_step_is_settled_when_it_stays() {
        let at = 100;
        let position = |k: usize| {
            if k < at {
                1.0
            } else {
                3.0 - 2.0 * (-((k - at) as f64) / 20.0).exp()
            }
        };
        let exponential: Vec<f64> = (0..1000).map(position).collect();
        let found = StepFigures::measured(&exponential, at, [1.0, 2.0], SAMPLING_PERIOD_S);
        // Within 2 % behind 20 ln 50 = 78.2 ticks, from a tenth to nine tenths in 20 ln 9 = 43.9.
        assert_eq!(
            found.settling_s.map(|s| (s / SAMPLING_PERIOD_S).round()),
            Some(79.0)
        );
        assert_eq!(
            found.rise_s.map(|s| (s / SAMPLING_PERIOD_S).round()),
            Some(44.0)
        );
        assert!(found.overshoot < 1e-9, "{}", found.overshoot);
        let late: Vec<f64> = exponential
            .iter()
            .enumerate()
            .map(|(k, y)| if k == 990 { 3.1 } else { *y })
            .collect();
        let late = StepFigures::measured(&late, at, [1.0, 2.0], SAMPLING_PERIOD_S);
        assert!(
            late.settling_s.is_none() && (late.overshoot - 0.05).abs() < 1e-9,
            "{late:?}"
        );
    }

    fn run(step: Option<StepFigures>) -> TrackResult {
        let figures = TrackingFigures {
            rms_um: 0.01,
            max_um: 0.1,
        };
        TrackResult {
            schema: String::new(),
            scheme: String::new(),
            reference: String::new(),
            plant: String::new(),
            beside: None,
            sensor: figures,
            as_read: figures,
            truth: figures,
            steady_state_um: 0.0,
            true_mean_um: 0.0,
            sensor_lag_s: None,
            model_sensor_lag_s: None,
            step,
            drive: DriveFigures::default(),
            noise_um: 0.0,
            disturbance: None,
            adapted_gain: None,
            saturated_ticks: 2,
            overruns: 0,
            period_s: SAMPLING_PERIOD_S,
            time_s: Vec::new(),
            reference_um: vec![0.0, 2.0],
            sensor_um: Vec::new(),
            displacement_um: Vec::new(),
            reading_um: Vec::new(),
            drive_v: Vec::new(),
            counts_from: 0,
        }
    }

    #[test]
    fn a_limit_is_no_trouble_of_a_step_that_settles() {
        let step = |settling_s| StepFigures {
            by_um: 2.0,
            settling_s,
            rise_s: None,
            overshoot: 0.0,
        };
        assert_eq!(run(Some(step(Some(0.01)))).trouble(), None);
        assert!(run(Some(step(None))).trouble().is_some());
        assert!(run(None).trouble().is_some());
    }
}
