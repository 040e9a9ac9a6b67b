//! A plant and a controller, closed through the converters: one loop for every plant and every law.
//!
//! # How it works
//! Each experiment begins as on a real bench: the conditioning cycle is played through
//! [`Controller::open_loop`], so that the servo's memory of the hysteresis sees it, the sensor is zeroed,
//! then the servo is enabled. At every tick the ADC samples the plant, the servo computes a code, and the
//! plant goes on for one period under the code of the *last* tick; without computational delay under the new
//! one. The same seed gives the same noise, and with it the same codes.

use crate::bench::{self, Bench, Variant};
use crate::converter_scale::ConverterScale;
use crate::noise::WhiteNoise;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_parameters::ServoParameters;
use hysteron_core::servo_tick::{Counters, ServoTick};
use hysteron_core::signal::Micrometres;

/// A controlled system: drive in, displacement out.
pub trait Plant {
    /// One sampling period with the drive held, V, and an external force, given as the displacement that it
    /// makes at rest, um.
    fn advance(&mut self, drive_v: f64, external_um: f64);

    /// True displacement now, um.
    fn displacement_um(&self) -> f64;

    /// What the sensor would read now without noise and converter, um.
    fn sensor_um(&self) -> f64;

    /// What the sensor adds at the next reading beside its white noise, um: 1/f noise, lines.
    fn next_coloured_um(&mut self) -> f64 {
        0.0
    }
}

impl<P: Plant + ?Sized> Plant for Box<P> {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        (**self).advance(drive_v, external_um);
    }

    fn displacement_um(&self) -> f64 {
        (**self).displacement_um()
    }

    fn sensor_um(&self) -> f64 {
        (**self).sensor_um()
    }

    fn next_coloured_um(&mut self) -> f64 {
        (**self).next_coloured_um()
    }
}

impl Plant for bench::Plant {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        self.tick_with_force(drive_v, external_um);
    }

    fn displacement_um(&self) -> f64 {
        bench::Plant::displacement_um(self)
    }

    fn sensor_um(&self) -> f64 {
        bench::Plant::sensor_um(self)
    }

    fn next_coloured_um(&mut self) -> f64 {
        bench::Plant::next_coloured_um(self)
    }
}

/// A law between two converters.
pub trait Controller {
    /// Passes a drive's code on while the loop is open, and follows what it does to the hysteresis.
    fn open_loop(&mut self, dac_code: DriveCode) -> DriveCode;

    /// The sensor has been zeroed: its codes have this scale from now on.
    fn take_scale(&mut self, scale: &ConverterScale);

    /// Closes the loop.
    fn enable(&mut self);

    /// The drive that it gave last, V.
    fn drive_v(&self) -> f64;

    /// One tick: the sensor's code and the reference [`PREVIEW_TICKS`] ahead, um, give the drive's code.
    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode;

    /// True where a code acts one period after the reading it was computed from.
    fn delayed(&self) -> bool;

    /// Adds what the law itself knows after a tick.
    fn observe(&self, _trace: &mut Trace) {}
}

impl Controller for ServoTick {
    fn open_loop(&mut self, dac_code: DriveCode) -> DriveCode {
        ServoTick::open_loop(self, dac_code)
    }

    fn take_scale(&mut self, scale: &ConverterScale) {
        let mut zeroed = *self.parameters();
        zeroed.converters.adc_zero = scale.parameters().adc_zero;
        self.swap(zeroed);
        self.reset_counters();
    }

    fn enable(&mut self) {
        ServoTick::enable(self);
    }

    fn drive_v(&self) -> f64 {
        self.drive().to_num()
    }

    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode {
        ServoTick::tick(self, adc_code, Micrometres::saturating_from_num(ahead_um))
    }

    fn delayed(&self) -> bool {
        self.parameters().delayed
    }

    fn observe(&self, trace: &mut Trace) {
        if let Some(estimate) = self.estimate() {
            trace.estimate_um.push(estimate.map(|v| v.to_num()));
        }
        if let Some(sliding) = self.sliding() {
            trace.sliding_um.push(sliding.map(|v| v.to_num()));
        }
        trace.unknown_input.push(self.unknown_input());
        trace.counters = self.counters();
        trace.limited_ticks.push(trace.counters.limited_ticks);
    }
}

/// A servo that receives the period of its reference only after some ticks: what grows does not repeat yet,
/// and nothing is learned from it.
pub struct RepeatsLater {
    /// The servo.
    pub servo: ServoTick,
    /// The period of the reference, ticks; none where it does not repeat.
    pub period_ticks: Option<u32>,
    /// Ticks until it receives the period.
    pub wait_ticks: usize,
}

impl Controller for RepeatsLater {
    fn open_loop(&mut self, dac_code: DriveCode) -> DriveCode {
        self.servo.open_loop(dac_code)
    }

    fn take_scale(&mut self, scale: &ConverterScale) {
        self.servo.take_scale(scale);
    }

    fn enable(&mut self) {
        self.servo.enable();
    }

    fn drive_v(&self) -> f64 {
        Controller::drive_v(&self.servo)
    }

    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode {
        if self.wait_ticks == 0 {
            // Once.
            if let Some(period_ticks) = self.period_ticks.take() {
                self.servo.repeat(Some(period_ticks));
            }
        }
        self.wait_ticks = self.wait_ticks.saturating_sub(1);
        Controller::tick(&mut self.servo, adc_code, ahead_um)
    }

    fn delayed(&self) -> bool {
        Controller::delayed(&self.servo)
    }

    fn observe(&self, trace: &mut Trace) {
        self.servo.observe(trace);
    }
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
    pub codes: Vec<DriveCode>,
    /// ADC code read at this tick.
    pub adc_codes: Vec<SensorCode>,
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
        Self {
            rms_um: (sum / count.max(1) as f64).sqrt(),
            max_um,
        }
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
        self.limited_ticks
            .last()
            .copied()
            .unwrap_or(0)
            .saturating_sub(before)
    }

    /// Error of the true displacement from a tick on.
    #[must_use]
    pub fn true_error(&self, from: usize) -> ErrorFigures {
        ErrorFigures::between(&self.displacement_um, &self.reference_um, from)
    }
}

/// What surrounds plant and law: converters, noise, disturbance, zeros.
#[derive(Clone, Debug)]
pub struct Surroundings<'a> {
    /// The converters, the sensor's zero where it was left after conditioning.
    pub scale: ConverterScale,
    /// Standard deviation of the sensor's noise, um.
    pub noise_um: f64,
    /// Seed of the sensor's noise.
    pub seed: u64,
    /// External force at each tick, as the displacement that it makes at rest, um; empty for none.
    pub external_um: &'a [f64],
    /// Reading at which the sensor was zeroed, um.
    pub sensor_zero_um: f64,
    /// True displacement there, um.
    pub displacement_zero_um: f64,
}

/// Conditions a plant: plays a drive through the open loop.
pub fn condition(
    plant: &mut impl Plant,
    controller: &mut impl Controller,
    scale: &ConverterScale,
    drive_v: &[f64],
) {
    for wanted_v in drive_v {
        let code = controller.open_loop(scale.dac_code(*wanted_v));
        plant.advance(scale.drive_v(code), 0.0);
    }
}

/// Closes the loop and follows a reference, um. The trace ends where the reference can no longer be looked
/// ahead at.
pub fn follow(
    plant: &mut impl Plant,
    controller: &mut impl Controller,
    around: &Surroundings<'_>,
    reference_um: &[f64],
) -> Trace {
    // The last samples of the reference are only looked ahead at.
    let n = reference_um.len().saturating_sub(PREVIEW_TICKS);
    let mut noise = WhiteNoise::new(around.noise_um, around.seed);
    let mut trace = Trace {
        reference_um: reference_um[..n].to_vec(),
        ..Trace::default()
    };
    for column in [
        &mut trace.reading_um,
        &mut trace.sensor_um,
        &mut trace.displacement_um,
        &mut trace.drive_v,
    ] {
        column.reserve(n);
    }
    controller.enable();
    let mut acting_v = controller.drive_v();
    for k in 0..n {
        trace
            .sensor_um
            .push(plant.sensor_um() - around.sensor_zero_um);
        trace
            .displacement_um
            .push(plant.displacement_um() - around.displacement_zero_um);
        let ahead_um = reference_um
            .get(k + PREVIEW_TICKS)
            .or(reference_um.last())
            .copied()
            .unwrap_or(0.0);
        let noise_um = noise.next_um() + plant.next_coloured_um();
        let adc_code = around
            .scale
            .adc_code(plant.sensor_um() - around.sensor_zero_um + noise_um);
        let code = controller.tick(adc_code, ahead_um);
        let computed_v = around.scale.drive_v(code);
        trace.adc_codes.push(adc_code);
        trace.codes.push(code);
        trace.reading_um.push(around.scale.position_um(adc_code));
        trace.drive_v.push(computed_v);
        controller.observe(&mut trace);
        if !controller.delayed() {
            acting_v = computed_v;
        }
        plant.advance(acting_v, around.external_um.get(k).copied().unwrap_or(0.0));
        acting_v = computed_v;
    }
    trace
}

/// An experiment on the bench: which actuator, which noise, which disturbance.
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

impl<'a> Experiment<'a> {
    /// On a variant of a bench, without disturbance.
    #[must_use]
    pub fn new(bench: &'a Bench, variant: Variant, seed: u64) -> Self {
        Self {
            bench,
            variant,
            seed,
            substeps: bench::SUBSTEPS,
            external_um: &[],
        }
    }

    /// Conditions the actuator and follows a reference. Of `parameters` the ADC's zero is replaced: the
    /// sensor is zeroed after conditioning.
    #[must_use]
    pub fn follow(&self, parameters: &ServoParameters, reference_um: &[f64]) -> Trace {
        self.follow_with(ServoTick::new(*parameters), reference_um)
    }

    /// [`Self::follow`] with any law.
    #[must_use]
    pub fn follow_with(&self, controller: impl Controller, reference_um: &[f64]) -> Trace {
        let (plant, controller, zero_um) = self.conditioned(controller);
        self.follow_from(plant, controller, zero_um, reference_um)
    }

    /// The actuator after conditioning, the law that watched it, and the position at which the sensor was
    /// zeroed, um.
    #[must_use]
    pub fn conditioned<C: Controller>(&self, mut controller: C) -> (bench::Plant, C, f64) {
        let mut plant = self.bench.plant_with_substeps(self.variant, self.substeps);
        let scale = self.bench.converter_scale();
        condition(
            &mut plant,
            &mut controller,
            &scale,
            &self.bench.conditioning_drive_v(),
        );
        let zero_um = plant.sensor_um();
        controller.take_scale(&scale.zeroed_at(zero_um));
        (plant, controller, zero_um)
    }

    /// Goes on from a given state with the loop closed. The trace ends where the reference can no longer be
    /// looked ahead at.
    #[must_use]
    pub fn follow_from(
        &self,
        mut plant: bench::Plant,
        mut controller: impl Controller,
        zero_um: f64,
        reference_um: &[f64],
    ) -> Trace {
        let around = Surroundings {
            scale: self.bench.converter_scale().zeroed_at(zero_um),
            noise_um: self.bench.converters.sensor_noise_um,
            seed: self.seed,
            external_um: self.external_um,
            sensor_zero_um: zero_um,
            displacement_zero_um: zero_um,
        };
        plant.seed_sensor(self.bench, self.seed);
        follow(&mut plant, &mut controller, &around, reference_um)
    }
}
