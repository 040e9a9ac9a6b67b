//! A stage on [`IndependentStage`] whose gain is another one than when it was recorded, and drifts; the
//! servo's model of it corrected in several ways: what the slow adaptation is judged by.

use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::gain_adaptation::AdaptationDesign;
use hysteron::servo::law::PredictorDesign;
use hysteron::servo::model::SAMPLING_PERIOD_S;
use hysteron::servo::sampled_loop::SampledLoop;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::gain_adaptation::{BLOCK_TICKS, ONE, SETTLING_TICKS, WINDOW_BLOCKS};
use hysteron_core::reference_window::WINDOW;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::servo_tick::{Counters, ServoTick};
use hysteron_sim::closed_loop::{Controller, ErrorFigures, Plant, Trace, follow};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::waveform;
use hysteron_tests::independent_stage::{IndependentStage, StageChange, StageTruth};
use hysteron_tests::servo_study::{RATE_HZ, prepared};
use std::f64::consts::{FRAC_PI_2, TAU};

/// How the gain of the model is corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdaptationWay {
    /// Not at all: the unknown input carries all of it.
    Nothing,
    /// In the tick, in integers, from the unknown input that moves with the feedforward: the scheme.
    InTheTick,
    /// In f64 around the tick, from the unknown input that moves with the drive.
    WithTheDrive,
    /// In f64 around the tick, from the tracking error that moves as the feedforward changes: what is late in
    /// the unknown input, seen in the reading.
    FromTheError,
    /// The stage's gain at the end of the run was known from its beginning.
    Known,
}

impl AdaptationWay {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Nothing,
        Self::InTheTick,
        Self::WithTheDrive,
        Self::FromTheError,
        Self::Known,
    ];
}

/// A stage whose gain drifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptationDrift {
    /// Gain over the recorded one at the beginning.
    pub from: f64,
    /// At the end, reached in a straight line.
    pub to: f64,
    /// How long it takes, s.
    pub lasts_s: f64,
}

impl AdaptationDrift {
    /// A gain that stays.
    #[must_use]
    pub fn none(gain: f64) -> Self {
        Self {
            from: gain,
            to: gain,
            lasts_s: 0.0,
        }
    }

    fn at(&self, time_s: f64) -> f64 {
        let share = if time_s >= self.lasts_s {
            1.0
        } else {
            time_s / self.lasts_s
        };
        self.from + (self.to - self.from) * share
    }
}

struct Drifting {
    stage: IndependentStage,
    drift: AdaptationDrift,
    periods: usize,
}

impl Plant for Drifting {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        let gain_ratio = self.drift.at(self.periods as f64 * SAMPLING_PERIOD_S);
        self.stage.change_to(StageChange {
            gain_ratio,
            ..StageChange::NONE
        });
        self.periods += 1;
        self.stage.advance(drive_v, external_um);
    }

    fn displacement_um(&self) -> f64 {
        self.stage.displacement_um()
    }

    fn sensor_um(&self) -> f64 {
        self.stage.sensor_um()
    }
}

/// The design with the gain of its model multiplied.
#[must_use]
pub fn with_gain(design: &ServoDesign, gain: f64) -> ServoDesign {
    ServoDesign {
        model: design.model.with_gain(gain),
        ..design.clone()
    }
}

/// The design with the scheme that is judged.
#[must_use]
pub fn adaptive(design: &ServoDesign) -> ServoDesign {
    ServoDesign {
        adaptation: Some(AdaptationDesign::new(design.model.reach_um())),
        ..design.clone()
    }
}

/// A tick whose block is exchanged for one with another gain, window by window, all in f64.
struct Around {
    servo: ServoTick,
    way: AdaptationWay,
    design: ServoDesign,
    bounds: AdaptationDesign,
    converters: ConverterParameters,
    feedforward: Vec<f64>,
    /// What an unknown input that changes by one from block to block leaves of the reading.
    lateness_blocks: f64,
    gain: f64,
    references_um: Vec<f64>,
    sums: [f64; 2],
    before: Option<[f64; 2]>,
    product: f64,
    square: f64,
    ticks: u32,
}

impl Around {
    fn new(servo: ServoTick, way: AdaptationWay, design: &ServoDesign) -> Self {
        let Scheme::Predictor { tuning, .. } = &design.scheme else {
            unreachable!("a predictor")
        };
        let law = PredictorDesign::new(&design.model.linear, tuning);
        let at_rad_s = TAU * 50.0;
        let plant = design.model.linear.sampled();
        let late = SampledLoop::new(&law, &plant)
            .disturbance_response(at_rad_s)
            .norm();
        Self {
            way,
            design: design.clone(),
            bounds: AdaptationDesign::new(design.model.reach_um()),
            converters: servo.parameters().converters,
            servo,
            feedforward: law.feedforward,
            lateness_blocks: late / (at_rad_s * SAMPLING_PERIOD_S * f64::from(BLOCK_TICKS)),
            gain: 1.0,
            references_um: Vec::new(),
            sums: [0.0; 2],
            before: None,
            product: 0.0,
            square: 0.0,
            ticks: 0,
        }
    }

    fn watch(&mut self) {
        let um = |bits: i32| f64::from(bits) / f64::from(ONE);
        let newest = self.references_um.len().saturating_sub(WINDOW);
        let fed: f64 = self.references_um[newest..]
            .iter()
            .zip(&self.feedforward)
            .map(|(r, c)| r * c)
            .sum();
        let error_um = um(self.servo.reference().to_bits()) - um(self.servo.reading().to_bits());
        let moving = if self.way == AdaptationWay::WithTheDrive {
            um(self.servo.applied().to_bits())
        } else {
            fed
        };
        let carried = if self.way == AdaptationWay::FromTheError {
            error_um
        } else {
            um(self.servo.unknown_input())
        };
        self.ticks += 1;
        if self.ticks <= SETTLING_TICKS {
            return;
        }
        self.sums = [
            self.sums[0] + carried / f64::from(BLOCK_TICKS),
            self.sums[1] + moving / f64::from(BLOCK_TICKS),
        ];
        let within = self.ticks - SETTLING_TICKS;
        if within.is_multiple_of(BLOCK_TICKS) {
            let means = std::mem::take(&mut self.sums);
            if let Some(before) = self.before.replace(means) {
                let change = means[1] - before[1];
                // An error that is late by a time has the size of a change already.
                let carried = if self.way == AdaptationWay::FromTheError {
                    -means[0] / self.lateness_blocks
                } else {
                    means[0] - before[0]
                };
                self.product += carried * change;
                self.square += change * change;
            }
        }
        if within >= BLOCK_TICKS * (WINDOW_BLOCKS + 1) {
            self.end_window();
        }
    }

    fn end_window(&mut self) {
        let (product, square) = (
            std::mem::take(&mut self.product),
            std::mem::take(&mut self.square),
        );
        (self.before, self.sums, self.ticks) = (None, [0.0; 2], 0);
        if square < f64::from(WINDOW_BLOCKS) * self.bounds.least_motion_um.powi(2) {
            return;
        }
        let step = (0.3 * product / square).clamp(-self.bounds.most_step, self.bounds.most_step);
        self.gain = (self.gain * (1.0 + step))
            .clamp(1.0 - self.bounds.farthest, 1.0 + self.bounds.farthest);
        let mut parameters = with_gain(&self.design, self.gain)
            .parameters(self.converters)
            .expect("fits");
        parameters.converters = self.converters;
        self.servo.exchange(&parameters);
    }
}

impl Controller for Around {
    fn open_loop(&mut self, dac_code: DriveCode) -> DriveCode {
        self.servo.open_loop(dac_code)
    }

    fn take_scale(&mut self, scale: &ConverterScale) {
        self.servo.take_scale(scale);
    }

    fn enable(&mut self) {
        Controller::enable(&mut self.servo);
    }

    fn drive_v(&self) -> f64 {
        self.servo.drive_v()
    }

    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode {
        self.references_um.push(ahead_um);
        let code = Controller::tick(&mut self.servo, adc_code, ahead_um);
        if matches!(
            self.way,
            AdaptationWay::WithTheDrive | AdaptationWay::FromTheError
        ) {
            self.watch();
        }
        code
    }

    fn delayed(&self) -> bool {
        Controller::delayed(&self.servo)
    }

    fn observe(&self, trace: &mut Trace) {
        self.servo.observe(trace);
    }
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Adapted {
    /// True error over the last second.
    pub at_last: ErrorFigures,
    /// Gain that was believed at the end, over the model's.
    pub gain: f64,
    /// What the tick counted.
    pub counters: Counters,
    /// The run.
    pub trace: Trace,
}

/// A sine that grows from zero, um: from 15 to 65 % of the travel, where neither a gain a fifth too small nor
/// much creep brings the drive to a limit.
#[must_use]
pub fn sine_um(truth: &StageTruth, hz: f64, duration_s: f64) -> Vec<f64> {
    let amplitude_um = 0.25 * truth.travel_um;
    let mut reference = waveform::sine(
        RATE_HZ,
        hz,
        amplitude_um,
        0.4 * truth.travel_um,
        -FRAC_PI_2,
        duration_s,
    );
    waveform::grow_from_zero(&mut reference, RATE_HZ);
    reference
}

/// Conditions a stage and follows a reference while its gain drifts.
///
/// # Panics
/// If the design is no predictor or does not fit the tick's formats.
#[must_use]
pub fn adapted(
    truth: &StageTruth,
    drift: AdaptationDrift,
    design: &ServoDesign,
    way: AdaptationWay,
    reference_um: &[f64],
) -> Adapted {
    let used = match way {
        AdaptationWay::InTheTick => adaptive(design),
        AdaptationWay::Known => with_gain(design, drift.to),
        _ => design.clone(),
    };
    let change = StageChange {
        gain_ratio: drift.from,
        ..StageChange::NONE
    };
    let (stage, servo, around) = prepared(truth, change, &used, 0xada7);
    let mut drifting = Drifting {
        stage,
        drift,
        periods: 0,
    };
    let mut controller = Around::new(servo, way, &used);
    let trace = follow(&mut drifting, &mut controller, &around, reference_um);
    let from = trace.reference_um.len() - waveform::samples_in(RATE_HZ, 1.0);
    let gain = match (controller.servo.adaptation(), way) {
        (Some(adaptation), _) => f64::from(adaptation.gain()) / f64::from(ONE),
        (None, AdaptationWay::Known) => drift.to,
        _ => controller.gain,
    };
    Adapted {
        at_last: trace.true_error(from),
        gain,
        counters: trace.counters,
        trace,
    }
}
