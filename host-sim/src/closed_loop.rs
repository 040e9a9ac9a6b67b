//! The actuator of the bench and the integer servo, closed through the converters.
//!
//! # How it works
//! Each experiment begins as on a real bench: the conditioning cycle is played through [`ServoTick::open_loop`], so that the servo's
//! memory of the hysteresis sees it, the sensor is zeroed, then the servo is enabled. At every tick the ADC samples the plant, the
//! servo computes a code, and the plant goes on for one period under the code of the *last* tick; without computational delay under
//! the new one. The same seed gives the same noise, and with it the same codes.

use crate::bench::{ADC_MARGIN_UM, Bench, Plant, Sensor, Variant};
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_parameters::{ConverterParameters, ServoParameters};
use hysteron_core::servo_tick::{Counters, ServoTick};
use hysteron_core::signal::Micrometres;

/// An experiment: which actuator, which noise, which disturbance.
#[derive(Clone, Debug)]
pub struct Experiment<'a> {
    /// The bench; its converters count (a 12-bit DAC is another bench).
    pub bench: &'a Bench,
    /// Which actuator stands on it.
    pub variant: Variant,
    /// Seed of the sensor noise.
    pub seed: u64,
    /// Steps of the plant in one period.
    pub substeps: usize,
    /// External force at each tick, as the displacement that it makes at rest, um; empty for none.
    pub external_um: &'a [f64],
}

/// What happened, one element for each tick.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Reference, um.
    pub reference_um: Vec<f64>,
    /// What the converter gave, noise included, um.
    pub reading_um: Vec<f64>,
    /// What the sensor would read without noise and quantisation, um.
    pub sensor_um: Vec<f64>,
    /// True displacement, um.
    pub displacement_um: Vec<f64>,
    /// Drive computed at this tick, V.
    pub drive_v: Vec<f64>,
    /// DAC code computed at this tick.
    pub codes: Vec<u16>,
    /// ADC code read at this tick.
    pub adc_codes: Vec<u16>,
    /// Estimated position and velocity times the period, um, of laws that estimate them.
    pub estimate_um: Vec<[f64; 2]>,
    /// `e1`, `e2 T`, `q T`, um, of sliding-mode laws.
    pub sliding_um: Vec<[f64; 3]>,
    /// Unknown input as the law estimates it, in its raw integer.
    pub unknown_input: Vec<i32>,
    /// Ticks at a limit of the drive up to and including this one.
    pub limited_ticks: Vec<u32>,
    /// Counters of the servo at the end.
    pub counters: Counters,
}

/// RMS and largest magnitude of an error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorFigures {
    /// RMS, um.
    pub rms_um: f64,
    /// Largest magnitude, um.
    pub max_um: f64,
}

impl ErrorFigures {
    /// Of the differences between two signals from an element on.
    #[must_use]
    pub fn between(a: &[f64], b: &[f64], from: usize) -> Self {
        let mut sum = 0.0;
        let mut max_um = 0.0f64;
        let mut count = 0usize;
        for (x, y) in a.iter().zip(b).skip(from) {
            sum += (x - y).powi(2);
            max_um = max_um.max((x - y).abs());
            count += 1;
        }
        Self { rms_um: (sum / count.max(1) as f64).sqrt(), max_um }
    }
}

impl Trace {
    /// Error of what the sensor reads, noise removed, from a tick on.
    #[must_use]
    pub fn sensor_error(&self, from: usize) -> ErrorFigures {
        ErrorFigures::between(&self.sensor_um, &self.reference_um, from)
    }

    /// Ticks at a limit of the drive after a tick.
    #[must_use]
    pub fn limited_after(&self, from: usize) -> u32 {
        let before = self.limited_ticks.get(from).copied().unwrap_or(0);
        self.limited_ticks.last().copied().unwrap_or(0).saturating_sub(before)
    }

    /// Error of the true displacement from a tick on.
    #[must_use]
    pub fn true_error(&self, from: usize) -> ErrorFigures {
        ErrorFigures::between(&self.displacement_um, &self.reference_um, from)
    }
}

/// How codes of converters are related to the physical world, and which drives are allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConverterScale {
    /// Position at the sensor's code 0, um.
    pub adc_zero_um: f64,
    /// Position per code of the sensor, um.
    pub adc_lsb_um: f64,
    /// Drive at code 0, V.
    pub dac_zero_v: f64,
    /// Drive per code, V.
    pub dac_lsb_v: f64,
    /// Lowest drive of the actuator, V.
    pub drive_min_v: f64,
    /// Highest drive of the actuator, V.
    pub drive_max_v: f64,
}

impl ConverterScale {
    /// In the integers of the tick.
    #[must_use]
    pub fn parameters(&self) -> ConverterParameters {
        let code = |drive_v: f64| ((drive_v - self.dac_zero_v) / self.dac_lsb_v).round().clamp(0.0, 65_535.0) as u16;
        ConverterParameters {
            adc_zero: (self.adc_zero_um * 2.0_f64.powi(24)).round() as i32,
            adc_step: (self.adc_lsb_um * 2.0_f64.powi(40)).round() as i64,
            dac_zero: (self.dac_zero_v * 2.0_f64.powi(22)).round() as i32,
            dac_step: (self.dac_lsb_v * 2.0_f64.powi(38)).round() as i64,
            dac_codes_per_volt: (2.0_f64.powi(20) / self.dac_lsb_v).round() as i32,
            dac_code_min: code(self.drive_min_v),
            dac_code_max: code(self.drive_max_v),
            noise_shaping: false,
        }
    }
}

/// Converter parameters of a bench whose sensor reads zero at `zero_um`.
#[must_use]
pub fn converter_parameters(bench: &Bench, zero_um: f64) -> ConverterParameters {
    let c = &bench.converters;
    ConverterScale {
        adc_zero_um: -ADC_MARGIN_UM - zero_um,
        adc_lsb_um: bench.adc_lsb_um(),
        dac_zero_v: c.dac_min_v,
        dac_lsb_v: (c.dac_max_v - c.dac_min_v) / 2.0_f64.powi(c.dac_bits as i32),
        drive_min_v: bench.drive_min_v,
        drive_max_v: bench.drive_max_v,
    }
    .parameters()
}

impl<'a> Experiment<'a> {
    /// On a variant of a bench, without disturbance.
    #[must_use]
    pub fn new(bench: &'a Bench, variant: Variant, seed: u64) -> Self {
        Self { bench, variant, seed, substeps: crate::bench::SUBSTEPS, external_um: &[] }
    }

    /// Conditions the actuator and follows a reference. Of `parameters` the ADC's zero is replaced: the sensor is zeroed after
    /// conditioning.
    #[must_use]
    pub fn follow(&self, parameters: &ServoParameters, reference_um: &[f64]) -> Trace {
        let (plant, servo, zero_um) = self.conditioned(parameters);
        self.follow_from(plant, servo, zero_um, reference_um)
    }

    /// The actuator after conditioning, the servo that watched it, and the position at which the sensor was zeroed, um.
    #[must_use]
    pub fn conditioned(&self, parameters: &ServoParameters) -> (Plant, ServoTick, f64) {
        let mut plant = self.bench.plant_with_substeps(self.variant, self.substeps);
        let mut servo = ServoTick::new(*parameters);
        for drive_v in self.bench.conditioning_drive_v() {
            let code = servo.open_loop(self.bench.dac_code(drive_v));
            plant.tick(self.bench.drive_for_code_v(code));
        }
        let zero_um = plant.sensor_um();
        let mut zeroed = *parameters;
        let margin = converter_parameters(self.bench, zero_um);
        zeroed.converters.adc_zero = margin.adc_zero;
        servo.swap(zeroed);
        servo.reset_counters();
        (plant, servo, zero_um)
    }

    /// Goes on from a given state with the servo enabled. The trace ends where the reference can no longer be looked ahead at.
    #[must_use]
    pub fn follow_from(&self, mut plant: Plant, mut servo: ServoTick, zero_um: f64, reference_um: &[f64]) -> Trace {
        // The last samples of the reference are only looked ahead at.
        let n = reference_um.len().saturating_sub(PREVIEW_TICKS);
        let delayed = servo.parameters().delayed;
        let mut sensor = Sensor::new(self.bench, zero_um, self.seed);
        let mut trace = Trace { reference_um: reference_um[..n].to_vec(), ..Trace::default() };
        for column in [&mut trace.reading_um, &mut trace.sensor_um, &mut trace.displacement_um, &mut trace.drive_v] {
            column.reserve(n);
        }
        servo.enable();
        let mut acting_v = servo.drive().to_num::<f64>();
        for k in 0..n {
            trace.sensor_um.push(plant.sensor_um() - zero_um);
            trace.displacement_um.push(plant.displacement_um() - zero_um);
            let ahead = reference_um.get(k + PREVIEW_TICKS).or(reference_um.last()).copied().unwrap_or(0.0);
            let adc_code = sensor.read_code(&plant);
            let code = servo.tick(adc_code, Micrometres::saturating_from_num(ahead));
            let computed_v = self.bench.drive_for_code_v(code);
            trace.adc_codes.push(adc_code);
            trace.codes.push(code);
            trace.reading_um.push(servo.reading().to_num());
            trace.drive_v.push(computed_v);
            if let Some(estimate) = servo.estimate() {
                trace.estimate_um.push(estimate.map(|v| v.to_num()));
            }
            if let Some(sliding) = servo.sliding() {
                trace.sliding_um.push(sliding.map(|v| v.to_num()));
            }
            trace.unknown_input.push(servo.unknown_input());
            trace.limited_ticks.push(servo.counters().limited_ticks);
            if !delayed {
                acting_v = computed_v;
            }
            plant.tick_with_force(acting_v, self.external_um.get(k).copied().unwrap_or(0.0));
            acting_v = computed_v;
        }
        trace.counters = servo.counters();
        trace
    }
}
