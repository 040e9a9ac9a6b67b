//! A periodic reference on [`IndependentStage`](crate::independent_stage::IndependentStage), its correction learned in several ways: what the learned feedforward is judged by.

use crate::independent_stage::{Change, Truth};
use crate::servo_study::{RATE_HZ, prepared};
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::learned_feedforward::{LearningDesign, from_correction};
use hysteron::servo::model::SAMPLING_PERIOD_S;
use hysteron::servo::predictor::{PredictorDesign, frequency_response};
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_core::servo_tick::{Counters, ServoTick};
use hysteron_sim::closed_loop::{Controller, ErrorFigures, Surroundings, Trace, follow};
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::waveform;
use std::f64::consts::TAU;

/// Samples in a period: 100 Hz.
pub const PERIOD_TICKS: usize = 200;

/// The stage is 5 % less stiff in gain and all its modes are 5 % slower than the model that was identified before.
pub const FIVE_PERCENT_LESS: Change = Change { gain_ratio: 0.95, mass_ratio: 1.0 / (0.95 * 0.95), ..Change::NONE };
/// The other way round.
pub const FIVE_PERCENT_MORE: Change = Change { gain_ratio: 1.05, mass_ratio: 1.0 / (1.05 * 1.05), ..Change::NONE };

/// How a correction is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// Not at all.
    Nothing,
    /// In the tick, point by point, in integers: the scheme.
    EveryTick,
    /// The same filters over a whole period at a time, in f64. The work of a period is spread over the next, so every second period is learned.
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
        self.periods.get(period).map_or(f64::NAN, |e| 100.0 * e.rms_um / self.stroke_um)
    }
}

/// Periods of a triangle with sharp corners over six tenths of the travel, about its middle, um.
#[must_use]
pub fn triangle_um(truth: &Truth, periods: usize) -> Vec<f64> {
    let half = PERIOD_TICKS / 2;
    let height = |k: usize| 1.0 - (k % PERIOD_TICKS).abs_diff(half) as f64 / half as f64;
    (0..PERIOD_TICKS * periods).map(|k| truth.travel_um * (0.2 + 0.6 * height(k))).collect()
}

/// A tick with another way of learning around it, in f64: it sees what the tick's own sees.
struct Around {
    servo: ServoTick,
    way: Way,
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
    (0..n).map(|k| taps.iter().enumerate().map(|(i, c)| c * at(k, i)).sum()).collect()
}

impl Around {
    fn share(&self, updates: usize) -> f64 {
        let halvings = (updates / usize::from(self.design.periods_per_halving)).min(self.design.most_halvings.into());
        0.5f64.powi(halvings as i32)
    }

    fn update(&mut self, updates: usize) {
        let share = self.share(updates);
        let wanted: Vec<f64> = match self.way {
            Way::WholePeriods => {
                let step = filtered(&self.design.learning, 31, &self.errors_um);
                let stepped: Vec<f64> = self.correction_um.iter().zip(&step).map(|(f, s)| f + s).collect();
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
                signal.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, v)| {
                    let (sin, cos) = turn(h, k);
                    (re + v * cos, im - v * sin)
                })
            };
            let (e, f) = (spectrum(&self.errors_um), spectrum(&self.correction_um));
            let hz = h as f64 * RATE_HZ / n as f64;
            let near = self.design.convergence.iter().min_by(|a, b| (a.hz - hz).abs().total_cmp(&(b.hz - hz).abs()));
            let q = near.map_or(0.0, |p| p.robustness);
            let (re, im) = (q * (f.0 + inverse.0 * e.0 - inverse.1 * e.1), q * (f.1 + inverse.0 * e.1 + inverse.1 * e.0));
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
    fn open_loop(&mut self, dac_code: u16) -> u16 {
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

    fn tick(&mut self, adc_code: u16, ahead_um: f64) -> u16 {
        let k = self.ticks;
        self.ticks += 1;
        self.asked_um.push(ahead_um);
        let code = Controller::tick(&mut self.servo, adc_code, ahead_um + self.correction_um[k % PERIOD_TICKS]);
        if k >= PREVIEW_TICKS {
            let now = k - PREVIEW_TICKS;
            self.errors_um[now % PERIOD_TICKS] = self.asked_um[now] - self.servo.reading().to_num::<f64>();
            let (periods, ended) = ((now + 1) / PERIOD_TICKS, (now + 1).is_multiple_of(PERIOD_TICKS));
            let every = if self.way == Way::WholePeriods { 2 } else { 1 };
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
    let Scheme::Predictor { tuning, .. } = &design.scheme else { return Vec::new() };
    let law = PredictorDesign::new(&design.model.linear, tuning);
    let plant = design.model.linear.sampled(SAMPLING_PERIOD_S);
    (0..PERIOD_TICKS / 2)
        .map(|h| {
            let hz = (h as f64 * RATE_HZ / PERIOD_TICKS as f64).max(0.1);
            let t = from_correction(&law, frequency_response(&plant, TAU * hz), hz);
            (t.re / t.norm_sqr(), -t.im / t.norm_sqr())
        })
        .collect()
}

/// Conditions a stage, brings it to the lowest point of a triangle, lets it rest there, and follows the triangle from its first sample on.
///
/// # Panics
/// If the design has no filters to learn with or does not fit the tick's formats.
#[must_use]
pub fn learned(truth: &Truth, change: Change, design: &ServoDesign, way: Way, periods: usize) -> Learned {
    let filters = design.learning.clone().expect("a design that learns");
    let mut used = design.clone();
    if way != Way::EveryTick {
        used.learning = None;
    }
    let (mut stage, mut servo, around) = prepared(truth, change, &used, 0x1ea1);
    let triangle = triangle_um(truth, periods);
    let mut approach = vec![triangle[0]; 20_000];
    waveform::grow_from_zero(&mut approach, RATE_HZ);
    follow(&mut stage, &mut servo, &around, &approach);
    servo.reset_counters();
    servo.repeat(Some(PERIOD_TICKS as u32));
    // On the target a reference counts some samples after it is told.
    let mut told = vec![triangle[0]; PREVIEW_TICKS];
    told.extend(&triangle);
    let around = Surroundings { seed: around.seed ^ 1, ..around };
    let mut trace = if matches!(way, Way::Nothing | Way::EveryTick) {
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
    for column in [&mut trace.reference_um, &mut trace.displacement_um, &mut trace.sensor_um, &mut trace.drive_v] {
        column.drain(..PREVIEW_TICKS);
    }
    let ends = trace.reference_um.len() / PERIOD_TICKS;
    let of = |from: usize, to: usize| {
        let range = from * PERIOD_TICKS..to * PERIOD_TICKS;
        ErrorFigures::between(&trace.displacement_um[range.clone()], &trace.reference_um[range], 0)
    };
    Learned {
        periods: (0..ends).map(|period| of(period, period + 1)).collect(),
        at_last: of(ends.saturating_sub(10), ends),
        stroke_um: 0.6 * truth.travel_um,
        counters: trace.counters,
        trace,
    }
}
