//! Following a reference on an identified model: the chain of effects as the plant, the integers of the tick as the controller.
//!
//! The plant runs in [`SUBSTEPS`] steps a period. Converters are those of a board that fits the actuator: the DAC spans the drive range with a
//! quarter of it below and half of it above, the ADC the motion with a third to spare (for the P-753 the converters of the bench). The
//! actuator is conditioned and the sensor zeroed before it begins.

use super::design::ServoDesign;
use super::model::SAMPLING_PERIOD_S;
use super::quantise::QuantisationError;
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::Micrometres;
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::ErrorFigures;
use hysteron_sim::effect::{Place, Setting, Stage};
use hysteron_sim::waveform;
use rand::SeedableRng;
use serde::Serialize;
use std::f64::consts::TAU;

/// Steps of the plant in a period.
pub const SUBSTEPS: usize = 10;

/// A reference: `offset + amplitude sin(2 pi f t + phase)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SineReference {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude, um.
    pub amplitude_um: f64,
    /// Offset, um.
    pub offset_um: f64,
    /// Phase, degrees.
    pub phase_deg: f64,
}

impl SineReference {
    /// Reads `sine:HZ:AMPLITUDE_UM[:OFFSET_UM[:PHASE_DEG]]`. Without an offset the sine stands on 1.12 times its amplitude, which leaves
    /// room for the remnant and for creep; without a phase it begins at its lowest point.
    ///
    /// # Errors
    /// A message that names the field.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = "expected sine:HZ:AMPLITUDE_UM[:OFFSET_UM[:PHASE_DEG]]";
        let mut fields = text.split(':');
        if fields.next() != Some("sine") {
            return Err(format!("reference `{text}`: {expected}"));
        }
        let numbers: Vec<f64> = fields
            .map(|f| {
                f.parse::<f64>()
                    .ok()
                    .filter(|v| v.is_finite())
                    .ok_or_else(|| format!("reference `{text}`: `{f}` is not a number; {expected}"))
            })
            .collect::<Result<_, _>>()?;
        let (frequency_hz, amplitude_um) = match numbers.as_slice() {
            [f, a] | [f, a, _] | [f, a, _, _] => (*f, *a),
            _ => return Err(format!("reference `{text}`: {expected}")),
        };
        if frequency_hz <= 0.0 || frequency_hz > 0.25 / SAMPLING_PERIOD_S {
            return Err(format!("reference `{text}`: the frequency must be above 0 and at most {} Hz", 0.25 / SAMPLING_PERIOD_S));
        }
        if amplitude_um < 0.0 {
            return Err(format!("reference `{text}`: the amplitude must not be negative"));
        }
        Ok(Self {
            frequency_hz,
            amplitude_um,
            offset_um: numbers.get(2).copied().unwrap_or(1.12 * amplitude_um),
            phase_deg: numbers.get(3).copied().unwrap_or(-90.0),
        })
    }

    /// Samples, grown from zero, for half a second and then two periods or a second; and the sample from which the error counts.
    #[must_use]
    pub fn samples_um(&self) -> (Vec<f64>, usize) {
        let fs = 1.0 / SAMPLING_PERIOD_S;
        let duration_s = 0.5 + (2.0 / self.frequency_hz).max(1.0);
        let phase_rad = self.phase_deg.to_radians();
        let mut samples = waveform::sine(fs, self.frequency_hz, self.amplitude_um, self.offset_um, phase_rad, duration_s);
        super::reproduce::grow(&mut samples, fs);
        (samples, waveform::samples_in(fs, 0.5))
    }
}

/// RMS and largest error.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Figures {
    /// RMS, um.
    pub rms_um: f64,
    /// Largest magnitude, um.
    pub max_um: f64,
}

impl From<ErrorFigures> for Figures {
    fn from(e: ErrorFigures) -> Self {
        Self { rms_um: e.rms_um, max_um: e.max_um }
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
    /// Error of what the sensor reads, noise removed.
    pub sensor: Figures,
    /// Error of the true displacement.
    #[serde(rename = "true")]
    pub truth: Figures,
    /// Mean error of what the sensor reads, um.
    pub steady_state_um: f64,
    /// Ticks in which the drive was at a limit while the error counts, and values that left their format.
    pub saturated_ticks: u32,
    /// Ticks that came too late: none in a simulation.
    pub overruns: u32,
    /// Time, s, of each sample of the signals for the report.
    #[serde(skip)]
    pub time_s: Vec<f64>,
    /// Reference, um.
    #[serde(skip)]
    pub reference_um: Vec<f64>,
    /// What the sensor reads, noise removed, um.
    #[serde(skip)]
    pub sensor_um: Vec<f64>,
    /// Drive, V.
    #[serde(skip)]
    pub drive_v: Vec<f64>,
}

/// The chain as a plant.
struct ChainPlant<'a> {
    stages: Vec<(bool, Box<dyn Stage + 'a>)>,
    interval: usize,
    displacement_um: f64,
    sensor_um: f64,
}

impl ChainPlant<'_> {
    fn tick(&mut self, drive_v: f64) {
        for _ in 0..SUBSTEPS {
            let mut signal = drive_v;
            for (of_sensor, stage) in &mut self.stages {
                signal = stage.step(self.interval, signal);
                if !*of_sensor {
                    self.displacement_um = signal;
                }
            }
            self.sensor_um = signal;
            self.interval += 1;
        }
    }
}

/// A board that fits an actuator.
struct Board {
    adc_zero_um: f64,
    adc_step_um: f64,
    dac_zero_v: f64,
    dac_step_v: f64,
    code_min: u16,
    code_max: u16,
}

impl Board {
    fn code(&self, drive_v: f64) -> u16 {
        let code = ((drive_v - self.dac_zero_v) / self.dac_step_v).round();
        code.clamp(f64::from(self.code_min), f64::from(self.code_max)) as u16
    }

    fn drive_v(&self, code: u16) -> f64 {
        self.dac_zero_v + f64::from(code) * self.dac_step_v
    }

    fn parameters(&self, zero_um: f64) -> ConverterParameters {
        ConverterParameters {
            adc_zero: ((self.adc_zero_um - zero_um) * 2.0_f64.powi(24)).round() as i32,
            adc_step: (self.adc_step_um * 2.0_f64.powi(40)).round() as i64,
            dac_zero: (self.dac_zero_v * 2.0_f64.powi(22)).round() as i32,
            dac_step: (self.dac_step_v * 2.0_f64.powi(38)).round() as i64,
            dac_codes_per_volt: (2.0_f64.powi(20) / self.dac_step_v).round() as i32,
            dac_code_min: self.code_min,
            dac_code_max: self.code_max,
            noise_shaping: false,
        }
    }
}

/// Follows a reference on a model. `noise_um` is the RMS noise of the sensor; the same seed gives the same noise.
///
/// # Errors
/// If the design does not fit the tick's formats.
pub fn track(
    chain: &Model,
    design: &ServoDesign,
    reference: &SineReference,
    reference_name: &str,
    noise_um: f64,
    seed: u64,
) -> Result<TrackResult, QuantisationError> {
    let (low_v, high_v) = (design.model.drive_min_v, design.model.drive_max_v);
    let range_v = high_v - low_v;
    let travel_um = design.model.surfaces().initial_ascending_curve(1.0);
    let (dac_zero_v, dac_step_v) = (low_v - 0.25 * range_v, 1.75 * range_v / 65_536.0);
    let to_code = |u: f64| ((u - dac_zero_v) / dac_step_v).round() as u16;
    let board = Board {
        adc_zero_um: -0.1 * travel_um,
        adc_step_um: 1.35 * travel_um / 65_536.0,
        dac_zero_v,
        dac_step_v,
        code_min: to_code(low_v),
        code_max: to_code(high_v),
    };
    let setting = Setting {
        dt_s: SAMPLING_PERIOD_S / SUBSTEPS as f64,
        substeps: SUBSTEPS,
        force_n: None,
        drive_min_v: chain.drive_min_v,
        drive_max_v: chain.drive_max_v,
    };
    let stages = chain
        .stages(&setting)
        .into_iter()
        .filter_map(|(i, mut stage)| {
            let place = chain.effects.get(i)?.effect.declaration().place;
            stage.settle(if place <= Place::Hysteresis { low_v } else { 0.0 });
            Some((place >= Place::SensorNonlinearity, stage))
        })
        .collect();
    let mut plant = ChainPlant { stages, interval: 0, displacement_um: 0.0, sensor_um: 0.0 };
    let mut servo = ServoTick::new(design.parameters(board.parameters(0.0))?);
    let fs = 1.0 / SAMPLING_PERIOD_S;
    let conditioning = waveform::concatenate(&[waveform::raised_cosine(fs, 10.0, low_v, high_v, 1), waveform::hold(fs, low_v, 1.0)]);
    for u in conditioning {
        let code = servo.open_loop(board.code(u));
        plant.tick(board.drive_v(code));
    }
    let (zero_um, true_zero_um) = (plant.sensor_um, plant.displacement_um);
    servo.swap(design.parameters(board.parameters(zero_um))?);
    servo.reset_counters();
    servo.enable();
    let (ahead_of_all, from) = reference.samples_um();
    // The last samples are only looked ahead at.
    let wanted = ahead_of_all[..ahead_of_all.len().saturating_sub(PREVIEW_TICKS)].to_vec();
    let mut generator = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let mut acting = board.code(low_v);
    let mut result = TrackResult {
        schema: "hysteron.track/1".into(),
        scheme: design.scheme_name().into(),
        reference: reference_name.into(),
        sensor: Figures { rms_um: 0.0, max_um: 0.0 },
        truth: Figures { rms_um: 0.0, max_um: 0.0 },
        steady_state_um: 0.0,
        saturated_ticks: 0,
        overruns: 0,
        time_s: Vec::new(),
        reference_um: wanted.clone(),
        sensor_um: Vec::new(),
        drive_v: Vec::new(),
    };
    let mut truth = Vec::with_capacity(wanted.len());
    let mut limited_before = 0;
    for k in 0..wanted.len() {
        result.time_s.push(k as f64 * SAMPLING_PERIOD_S);
        result.sensor_um.push(plant.sensor_um - zero_um);
        truth.push(plant.displacement_um - true_zero_um);
        let noisy = plant.sensor_um + noise_um * gaussian(&mut generator);
        let adc = ((noisy - board.adc_zero_um) / board.adc_step_um).round().clamp(0.0, 65_535.0) as u16;
        let ahead = ahead_of_all.get(k + PREVIEW_TICKS).copied().unwrap_or(0.0);
        let code = servo.tick(adc, Micrometres::saturating_from_num(ahead));
        if k == from {
            limited_before = servo.counters().limited_ticks;
        }
        result.drive_v.push(board.drive_v(code));
        if !design.delayed {
            acting = code;
        }
        plant.tick(board.drive_v(acting));
        acting = code;
    }
    result.sensor = ErrorFigures::between(&result.sensor_um, &wanted, from).into();
    result.truth = ErrorFigures::between(&truth, &wanted, from).into();
    let count = (wanted.len() - from).max(1) as f64;
    result.steady_state_um = result.sensor_um.iter().zip(&wanted).skip(from).map(|(y, r)| y - r).sum::<f64>() / count;
    let counters = servo.counters();
    result.saturated_ticks = counters.limited_ticks.saturating_sub(limited_before).saturating_add(counters.saturated_values);
    Ok(result)
}

/// Normal noise by Box and Muller.
fn gaussian(generator: &mut rand_pcg::Pcg64Mcg) -> f64 {
    use rand::Rng;
    let (a, b): (f64, f64) = (generator.random(), generator.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}
