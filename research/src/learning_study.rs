//! A periodic reference on [`IndependentStage`](hysteron_tests::independent_stage::IndependentStage), its correction
//! learned in several ways: what the learned feedforward is judged by.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::identify::identify;
use hysteron::model_file::effects_named;
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::law::PredictorDesign;
use hysteron::servo::learned_feedforward::{LearningDesign, from_correction};
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::sampled_loop::frequency_response;
use hysteron::watch::Unwatched;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_tick::{Counters, ServoTick};
use hysteron_sim::bench::{Bench, Start, Variant};
use hysteron_sim::closed_loop::{
    Controller, ErrorFigures, Experiment, Surroundings, Trace, follow,
};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::waveform;
use hysteron_tests::independent_stage::{StageChange, StageTruth};
use hysteron_tests::servo_study::{RATE_HZ, prepared};
use hysteron_thesis::commissioning;
use std::f64::consts::TAU;

/// Samples in a period: 100 Hz.
pub const PERIOD_TICKS: usize = 200;

/// The stage is 5 % less stiff in gain and all its modes are 5 % slower than the model that was identified
/// before.
pub const FIVE_PERCENT_LESS: StageChange = StageChange {
    gain_ratio: 0.95,
    mass_ratio: 1.0 / (0.95 * 0.95),
    ..StageChange::NONE
};
/// The other way round.
pub const FIVE_PERCENT_MORE: StageChange = StageChange {
    gain_ratio: 1.05,
    mass_ratio: 1.0 / (1.05 * 1.05),
    ..StageChange::NONE
};

/// How a correction is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LearningWay {
    /// Not at all.
    Nothing,
    /// In the tick, point by point, in integers: the scheme.
    EveryTick,
    /// The same filters over a whole period at a time, in f64. The work of a period is spread over the next,
    /// so every second period is learned.
    WholePeriods,
    /// Every harmonic by itself, in f64: `1 / T` of the model at its frequency, and `Q` there.
    Harmonics,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Learned {
    /// Error of the true position in each period from the first one on.
    pub periods: Vec<ErrorFigures>,
    /// Over the last ten of all periods.
    pub at_last: ErrorFigures,
    /// Peak to peak of the reference, um.
    pub stroke_um: f64,
    /// What the tick counted from the first period on.
    pub counters: Counters,
    /// The run, its first sample that of the first period.
    pub trace: Trace,
}

impl Learned {
    /// RMS error of a period, percent of the stroke.
    #[must_use]
    pub fn percent(&self, period: usize) -> f64 {
        self.periods
            .get(period)
            .map_or(f64::NAN, |e| 100.0 * e.rms_um / self.stroke_um)
    }
}

/// Periods of a triangle with sharp corners over six tenths of the travel, about its middle, um.
#[must_use]
pub fn triangle_um(truth: &StageTruth, periods: usize) -> Vec<f64> {
    let half = PERIOD_TICKS / 2;
    let height = |k: usize| 1.0 - (k % PERIOD_TICKS).abs_diff(half) as f64 / half as f64;
    (0..PERIOD_TICKS * periods)
        .map(|k| truth.travel_um * (0.2 + 0.6 * height(k)))
        .collect()
}

/// A tick with another way of learning around it, in f64: it sees what the tick's own sees.
struct Around {
    servo: ServoTick,
    way: LearningWay,
    design: LearningDesign,
    /// `1 / T` of the model at every harmonic.
    inverse: Vec<(f64, f64)>,
    correction_um: Vec<f64>,
    errors_um: Vec<f64>,
    asked_um: Vec<f64>,
    ticks: usize,
}

/// `sum c_i s[k + i - before]` around a period.
fn filtered(taps: &[f64], before: usize, signal: &[f64]) -> Vec<f64> {
    let n = signal.len();
    let at = |k: usize, i: usize| signal[(k + i + n * taps.len() - before) % n];
    (0..n)
        .map(|k| taps.iter().enumerate().map(|(i, c)| c * at(k, i)).sum())
        .collect()
}

impl Around {
    fn share(&self, updates: usize) -> f64 {
        let halvings = (updates / usize::from(self.design.periods_per_halving))
            .min(self.design.most_halvings.into());
        0.5f64.powi(halvings as i32)
    }

    fn update(&mut self, updates: usize) {
        let share = self.share(updates);
        let wanted: Vec<f64> = match self.way {
            LearningWay::WholePeriods => {
                let step = filtered(&self.design.learning, 31, &self.errors_um);
                let stepped: Vec<f64> = self
                    .correction_um
                    .iter()
                    .zip(&step)
                    .map(|(f, s)| f + s)
                    .collect();
                filtered(&self.design.robustness, 32, &stepped)
            }
            _ => self.by_harmonics(),
        };
        for (f, wanted) in self.correction_um.iter_mut().zip(wanted) {
            *f += share * (wanted - *f);
        }
    }

    fn by_harmonics(&self) -> Vec<f64> {
        let n = PERIOD_TICKS;
        let turn = |h: usize, k: usize| (TAU * ((h * k) % n) as f64 / n as f64).sin_cos();
        let mut out = vec![0.0; n];
        for (h, inverse) in self.inverse.iter().enumerate() {
            let spectrum = |signal: &[f64]| {
                signal
                    .iter()
                    .enumerate()
                    .fold((0.0, 0.0), |(re, im), (k, v)| {
                        let (sin, cos) = turn(h, k);
                        (re + v * cos, im - v * sin)
                    })
            };
            let (e, f) = (spectrum(&self.errors_um), spectrum(&self.correction_um));
            let hz = h as f64 * RATE_HZ / n as f64;
            let near = self
                .design
                .convergence
                .iter()
                .min_by(|a, b| (a.hz - hz).abs().total_cmp(&(b.hz - hz).abs()));
            let q = near.map_or(0.0, |p| p.robustness);
            let (re, im) = (
                q * (f.0 + inverse.0 * e.0 - inverse.1 * e.1),
                q * (f.1 + inverse.0 * e.1 + inverse.1 * e.0),
            );
            let scale = if h == 0 || 2 * h == n { 1.0 } else { 2.0 } / n as f64;
            for (k, to) in out.iter_mut().enumerate() {
                let (sin, cos) = turn(h, k);
                *to += scale * (re * cos - im * sin);
            }
        }
        out
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
        (self.ticks, self.asked_um) = (0, Vec::new());
    }

    fn drive_v(&self) -> f64 {
        self.servo.drive_v()
    }

    fn tick(&mut self, adc_code: SensorCode, ahead_um: f64) -> DriveCode {
        let k = self.ticks;
        self.ticks += 1;
        self.asked_um.push(ahead_um);
        let code = Controller::tick(
            &mut self.servo,
            adc_code,
            ahead_um + self.correction_um[k % PERIOD_TICKS],
        );
        if k >= PREVIEW_TICKS {
            let now = k - PREVIEW_TICKS;
            self.errors_um[now % PERIOD_TICKS] =
                self.asked_um[now] - self.servo.reading().to_num::<f64>();
            let (periods, ended) = (
                (now + 1) / PERIOD_TICKS,
                (now + 1).is_multiple_of(PERIOD_TICKS),
            );
            let every = if self.way == LearningWay::WholePeriods {
                2
            } else {
                1
            };
            // As the tick does, the first period is let by.
            if ended && periods >= 2 && (periods - 2).is_multiple_of(every) {
                self.update((periods - 2) / every);
            }
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

/// `1 / T` of the model at the harmonics up to half the sampling rate.
fn inverse_answers(design: &ServoDesign) -> Vec<(f64, f64)> {
    let Scheme::Predictor { tuning, .. } = &design.scheme else {
        return Vec::new();
    };
    let plain = PredictorDesign::new(&design.model.linear, tuning);
    let law = design
        .learning
        .as_ref()
        .map_or(plain.clone(), |learning| learning.fed_forward(&plain));
    let plant = design.model.linear.sampled();
    (0..PERIOD_TICKS / 2)
        .map(|h| {
            let hz = (h as f64 * RATE_HZ / PERIOD_TICKS as f64).max(0.1);
            let t = from_correction(&law, frequency_response(&plant, TAU * hz), hz);
            (t.re / t.norm_sqr(), -t.im / t.norm_sqr())
        })
        .collect()
}

/// Conditions a stage, brings it to the lowest point of a triangle, lets it rest there, and follows the
/// triangle from its first sample on.
///
/// # Panics
/// If the design has no filters to learn with or does not fit the tick's formats.
#[must_use]
pub fn learned(
    truth: &StageTruth,
    change: StageChange,
    design: &ServoDesign,
    way: LearningWay,
    periods: usize,
) -> Learned {
    let filters = design.learning.clone().expect("a design that learns");
    let mut used = design.clone();
    if way != LearningWay::EveryTick {
        used.learning = None;
    }
    let (mut stage, mut servo, around) = prepared(truth, change, &used, 0x1ea1);
    let triangle = triangle_um(truth, periods);
    let mut approach = vec![triangle[0]; 20_000];
    waveform::grow_from_zero(&mut approach, RATE_HZ);
    follow(&mut stage, &mut servo, &around, &approach);
    servo.reset_counters();
    servo.repeat(Some(PERIOD_TICKS as u32));
    // On the target a reference counts some samples after it arrives.
    let mut told = vec![triangle[0]; PREVIEW_TICKS];
    told.extend(&triangle);
    let around = Surroundings {
        seed: around.seed ^ 1,
        ..around
    };
    let mut trace = if matches!(way, LearningWay::Nothing | LearningWay::EveryTick) {
        follow(&mut stage, &mut servo, &around, &told)
    } else {
        let nothing = vec![0.0; PERIOD_TICKS];
        let mut outside = Around {
            servo,
            way,
            inverse: inverse_answers(design),
            design: filters,
            correction_um: nothing.clone(),
            errors_um: nothing,
            asked_um: Vec::new(),
            ticks: 0,
        };
        follow(&mut stage, &mut outside, &around, &told)
    };
    for column in [
        &mut trace.reference_um,
        &mut trace.displacement_um,
        &mut trace.sensor_um,
        &mut trace.drive_v,
    ] {
        column.drain(..PREVIEW_TICKS);
    }
    let ends = trace.reference_um.len() / PERIOD_TICKS;
    let of = |from: usize, to: usize| {
        let range = from * PERIOD_TICKS..to * PERIOD_TICKS;
        ErrorFigures::between(
            &trace.displacement_um[range.clone()],
            &trace.reference_um[range],
            0,
        )
    };
    Learned {
        periods: (0..ends).map(|period| of(period, period + 1)).collect(),
        at_last: of(ends.saturating_sub(10), ends),
        stroke_um: 0.6 * truth.travel_um,
        counters: trace.counters,
        trace,
    }
}

/// Errors on the reference bench, full variant, whose sensor has a bandwidth: RMS, percent of the stroke of a
/// triangle or of the amplitude of a sine.
#[derive(Clone, Copy, Debug)]
pub struct OnBench {
    /// The true position, in the period that was asked for.
    pub true_percent: f64,
    /// What is read there, against what was asked.
    pub read_percent: f64,
    /// What is read, against the reference as late as the sensor's bandwidth makes it read.
    pub read_but_for_the_lag_percent: f64,
}

/// The bench with its gain and its modes `ratio` times as they are, its damper the same.
#[must_use]
pub fn changed_bench(bench: &Bench, ratio: f64) -> Bench {
    let mut out = bench.clone();
    out.hysteresis
        .f
        .iter_mut()
        .chain(&mut out.hysteresis.g)
        .for_each(|coefficient| *coefficient *= ratio);
    out.vibration.natural_frequency_rad_s *= ratio;
    out.vibration.damping_ratio *= ratio;
    out.full.second_mode_hz *= ratio;
    out.full.second_mode_damping_ratio *= ratio;
    out
}

/// The design with learning from the commissioning record of the full bench, as it is.
///
/// # Errors
/// The refusal, or that nothing was identified.
pub fn designed_on_bench(bench: &Bench) -> Result<ServoDesign, String> {
    let drive = commissioning::drive_v(RATE_HZ, bench.drive_min_v, bench.drive_max_v);
    let played = bench.record(Variant::FULL, Start::Virgin, &drive, 11);
    let record = Record::new(
        "commissioning",
        played.sample_rate_hz,
        played.drive_v,
        played.reading_um,
    )
    .from_virgin_state();
    let rest = bench.record(
        Variant::FULL,
        Start::Virgin,
        &vec![bench.drive_min_v; 8000],
        12,
    );
    let rest = Record::new("rest", rest.sample_rate_hz, rest.drive_v, rest.reading_um)
        .with_role(Role::Noise);
    let dataset = Dataset::new(
        &bench.name,
        bench.drive_min_v,
        bench.drive_max_v,
        vec![record, rest],
    )
    .map_err(|e| e.to_string())?;
    let effects = effects_named(
        "hysteresis,initial_curve,vibration,second_mode,creep,amplifier_bandwidth,sensor_bandwidth",
    )
    .map_err(|e| e.to_string())?;
    let dataset = Dataset {
        sensor_bandwidth_hz: Some(bench.data_sheet_sensor_bandwidth_hz()),
        ..dataset
    };
    let chain = identify(&dataset, &effects, &Unwatched)
        .map_err(|e| e.to_string())?
        .model;
    order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            learning: true,
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
}

/// What a sine on the bench misses, % of its amplitude RMS: from the true position on: 2 um about 5.6 um.
///
/// # Panics
/// If the design does not fit the tick's formats.
#[must_use]
pub fn sine_on_bench(bench: &Bench, design: &ServoDesign, frequency_hz: f64) -> OnBench {
    let amplitude_um = 2.0;
    let scale = bench.converter_scale();
    let parameters = design.parameters(scale.parameters()).expect("fits");
    let experiment = Experiment::new(bench, Variant::FULL, 0x51e);
    // After the reference has grown two periods or half a second count.
    let from = 20_000;
    let counted = (2.0 * RATE_HZ / frequency_hz).max(10_000.0) as usize;
    let sine = |k: usize| 5.6 + amplitude_um * (TAU * frequency_hz * k as f64 / RATE_HZ).sin();
    let mut reference_um: Vec<f64> = (0..from + counted + 2 * PREVIEW_TICKS).map(sine).collect();
    waveform::grow_from_zero(&mut reference_um, RATE_HZ);
    let trace = experiment.follow(&parameters, &reference_um);
    let lag_ticks = RATE_HZ / (TAU * bench.full.sensor_bandwidth_hz);
    let percent = |signal: &[f64], later_ticks: f64| {
        let asked: Vec<f64> = (from..from + counted)
            .map(|k| {
                5.6 + amplitude_um * (TAU * frequency_hz * (k as f64 + later_ticks) / RATE_HZ).sin()
            })
            .collect();
        100.0 * ErrorFigures::between(&signal[from..from + counted], &asked, 0).rms_um
            / amplitude_um
    };
    OnBench {
        true_percent: percent(&trace.displacement_um, 0.0),
        read_percent: percent(&trace.sensor_um, 0.0),
        read_but_for_the_lag_percent: percent(&trace.sensor_um, -lag_ticks),
    }
}

/// The triangle on the bench: 6 um high, from 2.6 um on; in the period of this number (from 0), with learning
/// or without.
///
/// # Panics
/// If the design does not fit the tick's formats.
#[must_use]
pub fn learned_on_bench(
    bench: &Bench,
    design: &ServoDesign,
    learning: bool,
    period: usize,
) -> OnBench {
    let stroke_um = 6.0;
    let mut used = design.clone();
    if !learning {
        used.learning = None;
    }
    let experiment = Experiment::new(bench, Variant::FULL, 0x1ea1);
    let scale = bench.converter_scale();
    let servo = ServoTick::new(used.parameters(scale.parameters()).expect("fits"));
    let (mut plant, mut servo, zero_um) = experiment.conditioned(servo);
    let around = Surroundings {
        scale: scale.zeroed_at(zero_um),
        noise_um: bench.converters.sensor_noise_um,
        seed: 0x1ea1,
        external_um: &[],
        sensor_zero_um: zero_um,
        displacement_zero_um: zero_um,
    };
    let half = (PERIOD_TICKS / 2) as f64;
    let triangle =
        |ticks: f64| 2.6 + stroke_um * (1.0 - (ticks.rem_euclid(2.0 * half) - half).abs() / half);
    let mut approach = vec![triangle(0.0); 20_000];
    waveform::grow_from_zero(&mut approach, RATE_HZ);
    follow(&mut plant, &mut servo, &around, &approach);
    servo.repeat(Some(PERIOD_TICKS as u32));
    let mut told = vec![triangle(0.0); PREVIEW_TICKS];
    told.extend((0..PERIOD_TICKS * (period + 2)).map(|k| triangle(k as f64)));
    let around = Surroundings {
        seed: around.seed ^ 1,
        ..around
    };
    let trace = follow(&mut plant, &mut servo, &around, &told);
    let lag_ticks = RATE_HZ / (TAU * bench.full.sensor_bandwidth_hz);
    let percent = |signal: &[f64], later_ticks: f64| {
        let range = period * PERIOD_TICKS..(period + 1) * PERIOD_TICKS;
        let asked: Vec<f64> = range
            .clone()
            .map(|k| triangle(k as f64 + later_ticks))
            .collect();
        let range = range.start + PREVIEW_TICKS..range.end + PREVIEW_TICKS;
        100.0 * ErrorFigures::between(&signal[range], &asked, 0).rms_um / stroke_um
    };
    OnBench {
        true_percent: percent(&trace.displacement_um, 0.0),
        read_percent: percent(&trace.sensor_um, 0.0),
        // What is read now is where the stage was.
        read_but_for_the_lag_percent: percent(&trace.sensor_um, -lag_ticks),
    }
}
