//! From a recording to a servo at work on the stage that was recorded: the way of a user, on
//! [`IndependentStage`].

use crate::independent_stage::{IndependentStage, PERIOD_S, StageChange, StageTruth, TrueMode};
use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::dataset::{Dataset, Record, Role};
use hysteron::model_file::effects_named;
use hysteron::servo::data_of_stage::RECOMMENDED_MULTISINE_HZ;
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::model::{ModeModel, actuator_model};
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::plant_set::HELD_MASSES;
use hysteron::servo::robust::{ModeSpread, Task};
use hysteron::servo::tuning::{Demands, PredictorTuning};
use hysteron::watch::Unwatched;
use hysteron_core::amplifier::{IDENTIFICATION_SWEEP, IDENTIFICATION_TONES};
use hysteron_core::reference_generator::{LOWEST_POINT, ReferenceGenerator, Waveform, sweep};
use hysteron_core::servo_tick::ServoTick;
use hysteron_core::signal::{VOLT_FRACTION_BITS, Volts};
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::{
    Controller, ErrorFigures, Plant, Surroundings, Trace, condition, follow,
};
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::waveform;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::PathBuf;

/// Sampling rate of the loop and of fast records, Hz.
pub const RATE_HZ: f64 = 1.0 / PERIOD_S;

/// How people record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StudyRecording {
    /// Triangles, sines, a step, and a multisine to 1.5 kHz.
    Usual,
    /// What the target's `identify` plays: three tones over the whole range and a small sweep to nearly half
    /// the sampling rate.
    TargetsOwn,
    /// As the usual one, with the multisine that a design recommends.
    Wideband,
}

impl StudyRecording {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Usual, Self::TargetsOwn, Self::Wideband];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Usual => "usual",
            Self::TargetsOwn => "target's own",
            Self::Wideband => "wideband",
        }
    }
}

/// What the target's `identify` plays over a range that begins at zero, V.
fn identification_drive_v(top_v: f64, samples: usize) -> Vec<f64> {
    let fraction = f64::from(1 << VOLT_FRACTION_BITS);
    let half = 0.5 * top_v * fraction;
    let of_half = |share: i32| (half * f64::from(share) / 1024.0) as i32;
    let tones = IDENTIFICATION_TONES
        .map(|(increment, share)| (increment, Volts::from_bits(of_half(share)), LOWEST_POINT));
    let mut generator =
        ReferenceGenerator::new(Waveform::Multisine { tones }, Volts::from_bits(half as i32));
    let drive = |tick: usize| {
        generator.next_value().to_bits() + sweep(of_half(IDENTIFICATION_SWEEP), tick as u32)
    };
    (0..samples)
        .map(drive)
        .map(|drive| (f64::from(drive) / fraction).clamp(0.0, top_v))
        .collect()
}

/// One record of a virgin stage, sampled every `every` periods of the loop.
fn played(truth: &StageTruth, name: &str, every: usize, drive_v: Vec<f64>) -> Record {
    // Every record has noise of its own.
    let seed = name.bytes().fold(truth.seed, |h, b| {
        h.wrapping_mul(31).wrapping_add(u64::from(b))
    });
    let mut stage = IndependentStage::virgin(truth, StageChange::NONE);
    let readings_um = stage.record(&drive_v, every, &mut WhiteNoise::new(truth.noise_um, seed));
    Record::new(name, RATE_HZ / every as f64, drive_v, readings_um).from_virgin_state()
}

/// The recording of a stage.
///
/// # Panics
/// Never: the drives are within the limits.
#[must_use]
pub fn record(truth: &StageTruth, recording: StudyRecording) -> Dataset {
    let top_v = truth.drive_max_v;
    let rest = played(truth, "rest", 1, vec![0.0; 8000]).with_role(Role::Noise);
    let records = match recording {
        StudyRecording::TargetsOwn => {
            let samples = 100_000;
            let whole = played(truth, "run", 1, identification_drive_v(top_v, samples));
            let half = |name: &str, role, window| Record {
                name: name.into(),
                role,
                window,
                ..whole.clone()
            };
            vec![
                half("run_identify", Role::Identify, 0..samples / 2),
                half("run_validate", Role::Validate, samples / 2..samples),
                rest,
            ]
        }
        StudyRecording::Usual | StudyRecording::Wideband => {
            let stairs = |vertices: &[f64]| {
                let scaled: Vec<f64> = vertices.iter().map(|v| v * top_v / 70.0).collect();
                waveform::triangles(2000.0, 200.0, &scaled)
            };
            let first = [
                0.0, 20.0, 5.0, 35.0, 10.0, 50.0, 20.0, 45.0, 25.0, 60.0, 0.0, 70.0, 0.0, 65.0,
                10.0, 55.0, 20.0, 40.0, 0.0,
            ];
            let second = [
                0.0, 15.0, 3.0, 42.0, 18.0, 55.0, 8.0, 38.0, 14.0, 66.0, 30.0, 58.0, 22.0, 47.0,
                0.0,
            ];
            let mut sines = Vec::new();
            for hz in [5.0_f64, 20.0, 50.0, 100.0, 200.0, 400.0] {
                let amplitude_v = top_v * if hz < 60.0 { 0.42 } else { 0.17 };
                sines.extend(waveform::sine_burst(
                    RATE_HZ,
                    hz,
                    amplitude_v,
                    0.45 * top_v,
                    (3.0 / hz).clamp(0.03, 0.25),
                ));
            }
            let highest_hz = if recording == StudyRecording::Usual {
                1500.0
            } else {
                RECOMMENDED_MULTISINE_HZ
            };
            let period = 4000;
            let line_hz = RATE_HZ / f64::from(period);
            let lines: Vec<usize> = (1..=(highest_hz / line_hz) as usize).step_by(3).collect();
            let multisine = waveform::multisine(
                period as usize,
                &lines,
                0.1 * top_v,
                0.45 * top_v,
                5,
                truth.seed,
            );
            let other = waveform::multisine(
                period as usize,
                &lines,
                0.1 * top_v,
                0.5 * top_v,
                2,
                truth.seed + 1,
            );
            let step = |levels: &[(f64, f64)]| {
                waveform::steps(
                    200.0,
                    &levels
                        .iter()
                        .map(|(share, s)| (share * top_v, *s))
                        .collect::<Vec<_>>(),
                )
            };
            vec![
                played(truth, "stair", 10, stairs(&first)),
                played(truth, "stair2", 10, stairs(&second)).with_role(Role::Validate),
                played(truth, "sines", 1, sines),
                played(truth, "multisine", 1, multisine),
                played(truth, "multisine2", 1, other).with_role(Role::Validate),
                played(
                    truth,
                    "hold",
                    100,
                    step(&[(0.43, 8.0), (0.79, 8.0), (0.21, 8.0)]),
                ),
                rest,
            ]
        }
    };
    Dataset::new(
        format!("stage {} {}", truth.seed, recording.name()),
        0.0,
        top_v,
        records,
    )
    .expect("the drives are within the limits")
}

/// The main job on a recording, from the effects that a servo needs.
///
/// # Panics
/// If the search gives something that is no number.
#[must_use]
pub fn explained(dataset: &Dataset) -> Outcome {
    let effects = effects_named("hysteresis,initial_curve,vibration,creep").expect("known effects");
    analyse(
        dataset,
        Start::Effects(&effects),
        &Options::default(),
        &Unwatched,
    )
    .expect("finite")
}

/// The model that [`explained`] found before, kept in `target/servo_from_data`, or a new one. Delete the
/// folder to identify anew.
///
/// # Panics
/// If the folder cannot be written, or a kept file is no model.
#[must_use]
pub fn kept_model(truth: &StageTruth, recording: StudyRecording, dataset: &Dataset) -> Model {
    let folder = PathBuf::from("target/servo_from_data");
    let kept = folder.join(format!(
        "{}_{}.toml",
        truth.seed,
        recording.name().replace(' ', "_").replace('\'', "")
    ));
    if let Ok(text) = std::fs::read_to_string(&kept) {
        return hysteron::model_file::from_toml(&text, &kept.display().to_string())
            .expect("a kept model");
    }
    let found = explained(dataset).model;
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(
        &kept,
        hysteron::model_file::to_toml(&found, &dataset.name).expect("finite"),
    )
    .expect("written");
    found
}

/// `offset + amplitude sin(2 pi f t - pi/2)` grown from zero in 0.3 s, and the sample from which the error
/// counts.
fn sine_um(frequency_hz: f64, amplitude_um: f64) -> (Vec<f64>, usize) {
    let settle_s = 0.5;
    let duration_s = settle_s + (1.0 / frequency_hz).max(0.4);
    let mut reference = waveform::sine(
        RATE_HZ,
        frequency_hz,
        amplitude_um,
        1.12 * amplitude_um,
        -FRAC_PI_2,
        duration_s,
    );
    waveform::grow_from_zero(&mut reference, RATE_HZ);
    (reference, waveform::samples_in(RATE_HZ, settle_s))
}

/// A design on the stage, conditioned and zeroed, before it follows anything.
///
/// # Panics
/// If the design does not fit the tick's formats, which is what designing has to see to.
#[must_use]
pub fn prepared(
    truth: &StageTruth,
    change: StageChange,
    design: &ServoDesign,
    seed: u64,
) -> (IndependentStage, ServoTick, Surroundings<'static>) {
    let scale = truth.converters();
    let mut stage = IndependentStage::virgin(truth, change);
    let mut servo = ServoTick::new(design.parameters(scale.parameters()).expect("fits"));
    let drive = waveform::concatenate(&[
        waveform::raised_cosine(RATE_HZ, 10.0, 0.0, truth.drive_max_v, 1),
        vec![0.0; 10_000],
    ]);
    condition(&mut stage, &mut servo, &scale, &drive);
    let zero_um = stage.sensor_um();
    let around = Surroundings {
        scale: scale.zeroed_at(zero_um),
        noise_um: truth.noise_um,
        seed: truth.seed ^ seed,
        external_um: &[],
        sensor_zero_um: zero_um,
        displacement_zero_um: zero_um,
    };
    servo.take_scale(&around.scale);
    (stage, servo, around)
}

/// Runs a design on the stage, conditioned and zeroed; errors are counted from the sample on.
///
/// # Panics
/// As [`prepared`].
#[must_use]
pub fn run(
    truth: &StageTruth,
    change: StageChange,
    design: &ServoDesign,
    reference_um: &[f64],
) -> Trace {
    let (mut stage, mut servo, around) = prepared(truth, change, design, 0x5e70);
    follow(&mut stage, &mut servo, &around, reference_um)
}

/// What a servo does on the stage.
#[derive(Clone, Debug)]
pub struct StudyAtWork {
    /// Error of the true position at each frequency of [`FREQUENCIES_HZ`], um.
    pub errors: Vec<ErrorFigures>,
    /// RMS motion at rest, mean removed, um.
    pub rest_um: f64,
    /// True if it oscillates by itself: more motion at rest than its noise could make, or an error that is
    /// not bounded by the reference.
    pub unstable: bool,
}

impl StudyAtWork {
    /// Largest RMS error over the frequencies, um.
    #[must_use]
    pub fn worst_um(&self) -> f64 {
        self.errors.iter().map(|e| e.rms_um).fold(0.0, f64::max)
    }
}

/// Frequencies of the references, Hz.
pub const FREQUENCIES_HZ: [f64; 4] = [1.0, 10.0, 50.0, 150.0];

/// Motion at rest that is an oscillation and not noise passed on: ten times the sensor's noise.
pub const LIMIT_CYCLE: f64 = 10.0;

/// Puts a servo to work: sines of a quarter of the travel's height, and rest in the middle of the range.
#[must_use]
pub fn at_work(truth: &StageTruth, change: StageChange, design: &ServoDesign) -> StudyAtWork {
    let amplitude_um = 0.3 * truth.travel_um;
    let errors: Vec<ErrorFigures> = FREQUENCIES_HZ
        .iter()
        .map(|hz| {
            let (reference, from) = sine_um(*hz, amplitude_um);
            run(truth, change, design, &reference).true_error(from)
        })
        .collect();
    let rest_um = rest_um(truth, change, design);
    let unstable = rest_um > LIMIT_CYCLE * truth.noise_um
        || errors.iter().any(|e| e.rms_um > 0.1 * amplitude_um);
    StudyAtWork {
        errors,
        rest_um,
        unstable,
    }
}

/// A stage whose change comes slowly while it runs.
struct Changing {
    stage: IndependentStage,
    change: StageChange,
    periods: usize,
}

/// When a slow change begins, and how long it takes, s.
const SLOW_CHANGE_S: (f64, f64) = (0.6, 1.0);

impl Plant for Changing {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        let (from_s, lasts_s) = SLOW_CHANGE_S;
        let share = ((self.periods as f64 * PERIOD_S - from_s) / lasts_s).clamp(0.0, 1.0);
        self.periods += 1;
        let StageChange {
            mass_ratio,
            gain_ratio,
            delay_s,
            ..
        } = self.change;
        let change = StageChange {
            mass_ratio: mass_ratio.powf(share),
            gain_ratio: gain_ratio.powf(share),
            delay_s: delay_s * share,
            ..StageChange::NONE
        };
        self.stage.change_to(change);
        self.stage.advance(drive_v, external_um);
    }

    fn displacement_um(&self) -> f64 {
        self.stage.displacement_um()
    }

    fn sensor_um(&self) -> f64 {
        self.stage.sensor_um()
    }
}

/// As [`rest_um`], but the stage is as it was recorded until it rests in the middle of its range, and changes
/// slowly there: the drive is at no limit.
#[must_use]
pub fn rest_after_slow_change_um(
    truth: &StageTruth,
    change: StageChange,
    design: &ServoDesign,
) -> f64 {
    let mut reference = vec![
        0.5 * truth.travel_um;
        waveform::samples_in(RATE_HZ, SLOW_CHANGE_S.0 + SLOW_CHANGE_S.1 + 0.6)
    ];
    waveform::grow_from_zero(&mut reference, RATE_HZ);
    let (stage, mut servo, around) = prepared(truth, StageChange::NONE, design, 0x5e70);
    let trace = follow(
        &mut Changing {
            stage,
            change,
            periods: 0,
        },
        &mut servo,
        &around,
        &reference,
    );
    motion_at_the_end_um(&trace)
}

/// RMS motion at rest in the middle of the range over the last 0.2 s of 1.2 s, mean removed, um.
#[must_use]
pub fn rest_um(truth: &StageTruth, change: StageChange, design: &ServoDesign) -> f64 {
    let mut reference = vec![0.5 * truth.travel_um; waveform::samples_in(RATE_HZ, 1.2)];
    waveform::grow_from_zero(&mut reference, RATE_HZ);
    motion_at_the_end_um(&run(truth, change, design, &reference))
}

/// RMS motion over the last 0.2 s, mean removed, um.
fn motion_at_the_end_um(trace: &Trace) -> f64 {
    let tail = &trace.displacement_um[trace.displacement_um.len() - 4000..];
    let mean = tail.iter().sum::<f64>() / tail.len() as f64;
    (tail.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / tail.len() as f64).sqrt()
}

/// The servo of a designer who knows the stage's modes: the same structure and candidates, hysteresis as
/// identified, nothing unknown to be reckoned with, and of the best tunings on the grid and between its
/// points the one that does better on the stage itself.
#[must_use]
pub fn designed_with_the_truth(truth: &StageTruth, chain: &Model) -> Option<ServoDesign> {
    let (mut model, _) = actuator_model(chain)?.for_the_tick();
    let mode = |m: &TrueMode| ModeModel {
        natural_frequency_rad_s: TAU * m.frequency_hz,
        damping_ratio: m.damping_ratio,
    };
    model.linear.first_mode = mode(&truth.first_mode);
    model.linear.second_mode = truth.second_mode.map(|m| (m.share, mode(&m)));
    let exact = ModeSpread {
        frequency: 0.0,
        damping: 0.0,
    };
    let demands = Demands {
        sensor_noise_um: truth.noise_um,
        ..Demands::default()
    };
    let task = Task {
        linear: model.linear,
        first: exact,
        second: Some(exact),
        left_out: None,
        delay_s: 0.0,
        recording: None,
        mode_moves: 0.0,
        mass_to: HELD_MASSES[0],
        demands,
    };
    let design = |tuning: PredictorTuning| {
        let mut design = ServoDesign::new(
            Scheme::Predictor {
                tuning,
                hysteresis_inverse: true,
            },
            &model,
            true,
        );
        design.noise_shaping = true;
        design
    };
    let designs: Vec<ServoDesign> = [task.coarse_scan(), task.scan()]
        .iter()
        .filter_map(|scan| scan.best_if_recorded())
        .map(|c| design(c.tuning))
        .collect();
    let worst_um = |design: &ServoDesign| at_work(truth, StageChange::NONE, design).worst_um();
    designs
        .into_iter()
        .min_by(|a, b| worst_um(a).total_cmp(&worst_um(b)))
}

/// The design with the least error from a chain and its recording, as `hysteron design --data
/// --sensitivity-peak 2.5` makes it.
///
/// # Errors
/// The refusal.
pub fn designed(chain: &Model, dataset: &Dataset) -> Result<ServoDesign, String> {
    order::design(
        chain,
        &DesignOrder {
            recording: Some(dataset),
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
}
