//! The telemetry of the closed loop and another block under a running loop, on stages by other equations than
//! the simulation's, with servos that were designed from recordings of them.

use hysteron::model_file::effects_named;
use hysteron::servo::amplifier_block::amplifier_parameters;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::watch::Unwatched;
use hysteron_core::amplifier::Mode;
use hysteron_core::amplifier_command::Command;
use hysteron_core::integer_row::Row;
use hysteron_core::loop_telemetry::{LoopFigures, LoopTelemetry, ResonanceWatch};
use hysteron_core::parameter_block::{AmplifierParameters, verify};
use hysteron_core::pid_regulator::PidParameters;
use hysteron_core::servo_parameters::{ActuatorParameters, LawParameters};
use hysteron_core::trace_frame::TraceSample;
use hysteron_tests::independent_stage::{StageTruth, TrueMode};
use hysteron_tests::running_amplifier::{RunningAmplifier, front_end, sine};
use hysteron_tests::servo_study::{StudyRecording, record};
use std::f64::consts::TAU;

const SECOND: usize = 20_000;
const SEGMENT: usize = 1000;

fn designed(truth: &StageTruth, recording: StudyRecording) -> ServoDesign {
    let dataset = record(truth, recording);
    let effects = effects_named("hysteresis,initial_curve,vibration,second_mode,creep").unwrap();
    let chain = hysteron::identify::identify(&dataset, &effects, &Unwatched)
        .unwrap()
        .model;
    order::design(
        &chain,
        &DesignOrder {
            recording: Some(&dataset),
            usual_margins: false,
            ..DesignOrder::default()
        },
    )
    .unwrap()
}

fn block(design: &ServoDesign) -> AmplifierParameters {
    amplifier_parameters(design, &front_end()).unwrap()
}

/// What a second comes to, in f64 from the definitions: error RMS and peak, nm, drive RMS, V, root mean
/// square of the segments' amplitudes at a frequency, nm.
fn figures(running: &RunningAmplifier, second: &[(TraceSample, f64)], hz: f64) -> [f64; 4] {
    let um = |sample: &TraceSample| f64::from(sample.reference) / f64::from(1 << 24);
    let errors: Vec<f64> = second
        .iter()
        .map(|(sample, _)| 1e3 * (um(sample) - running.reading_um(sample.adc_code)))
        .collect();
    let power = |segment: &[f64]| {
        let (real, imaginary) =
            segment
                .iter()
                .enumerate()
                .fold((0.0, 0.0), |(real, imaginary), (n, error)| {
                    let weight = (TAU * n as f64 / (2 * SEGMENT) as f64).sin().powi(2);
                    let (sine, cosine) = (TAU * hz * n as f64 / 20_000.0).sin_cos();
                    let error = weight * (error - segment[0]);
                    (real + error * cosine, imaginary + error * sine)
                });
        (4.0 / SEGMENT as f64).powi(2) * (real * real + imaginary * imaginary)
    };
    let mean = |sum: f64, count: usize| sum / count as f64;
    [
        mean(errors.iter().map(|e| e * e).sum(), SECOND).sqrt(),
        errors.iter().fold(0.0, |most, e| most.max(e.abs())),
        mean(
            second
                .iter()
                .map(|(sample, _)| running.drive_v(sample.dac_code).powi(2))
                .sum(),
            SECOND,
        )
        .sqrt(),
        mean(errors.chunks(SEGMENT).map(power).sum(), SECOND / SEGMENT).sqrt(),
    ]
}

/// A second of the loop: what the telemetry says of it, what the definitions say, and the RMS of the true
/// error, nm, without its mean (the sensor is zeroed with its noise).
fn second_of(
    running: &mut RunningAmplifier,
    telemetry: &mut LoopTelemetry,
    hz: f64,
) -> (LoopFigures, [f64; 4], f64) {
    telemetry.begin();
    let mut second = Vec::with_capacity(SECOND);
    for _ in 0..SECOND {
        let sample = running.tick();
        assert_eq!(running.amplifier.mode(), Mode::Closed);
        let servo = running.amplifier.servo();
        let error = (servo.reference() - servo.reading()).to_bits();
        telemetry.take(sample.tick, error, servo.drive().to_bits());
        second.push((sample, running.position_um));
    }
    let expected = figures(running, &second, hz);
    let errors: Vec<f64> = second
        .iter()
        .map(|(sample, position_um)| {
            1e3 * (f64::from(sample.reference) / f64::from(1 << 24) - position_um)
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let true_nm =
        (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt();
    (telemetry.figures(), expected, true_nm)
}

/// The target's integers and single precision against the definitions.
fn agree(said: &LoopFigures, expected: [f64; 4]) {
    let said = [
        f64::from(said.error_rms_pm) / 1e3,
        f64::from(said.error_peak_pm) / 1e3,
        f64::from(said.drive_rms_uv) / 1e6,
        f64::from(said.resonance_pm) / 1e3,
    ];
    for (said, expected) in said.iter().zip(expected) {
        assert!(
            (said - expected).abs() <= 1e-3 * expected + 1e-3,
            "{said:?} instead of {expected:?}"
        );
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_second_of_a_designed_loop_is_told_as_it_was() {
    for seed in [1, 20] {
        let truth = StageTruth::drawn(seed);
        let mut running = RunningAmplifier::conditioned(
            &truth,
            &block(&designed(&truth, StudyRecording::Wideband)),
        );
        running.tell(sine(50.0, 0.2 * truth.travel_um, 0.4 * truth.travel_um));
        running.tell(Command::Enable);
        running.run(SECOND);
        let hz = truth.first_mode.frequency_hz.round();
        let mut telemetry = LoopTelemetry::new(20_000);
        telemetry
            .listen(ResonanceWatch {
                frequency_millihertz: (hz * 1e3) as u32,
                alarm_pm: 20_000,
            })
            .unwrap();
        let (said, expected, true_nm) = second_of(&mut running, &mut telemetry, hz);
        println!(
            "{seed}: {said:?}, {expected:.3?}, true error {true_nm:.3} nm, noise {:.3}",
            1e3 * truth.noise_um
        );
        agree(&said, expected);
        assert!(!said.alarm && said.torn_windows == 0);
        // The reported error is the reading's: the loop follows noise a little, so it is near the root of
        // both squares.
        let both = true_nm.hypot(1e3 * truth.noise_um);
        assert!(
            (f64::from(said.error_rms_pm) / 1e3 / both - 1.0).abs() < 0.25,
            "{both}"
        );
        // The drive is the stage's: the travel goes over the whole range.
        assert!(
            (0.3..0.6).contains(&(f64::from(said.drive_rms_uv) / 1e6 / truth.drive_max_v)),
            "{said:?}"
        );
    }
}

/// Integral control through the mean gain of a stage, a share of what its mode stands: with `k` a tick it
/// rings by itself from `k > 2 xi w T` on.
fn slow_integral(truth: &StageTruth, mode: &TrueMode, share: f64) -> AmplifierParameters {
    // Of the design only converters and guard are used.
    let mut out = block(&designed(truth, StudyRecording::TargetsOwn));
    let gain_um_v = truth.travel_um / truth.drive_max_v;
    let most = 2.0 * mode.damping_ratio * TAU * mode.frequency_hz / 20_000.0;
    out.servo.actuator = ActuatorParameters::Linear {
        volts_per_micrometre: (f64::from(1 << 20) / gain_um_v) as i32,
        micrometres_per_volt: (f64::from(1 << 28) * gain_um_v) as i32,
    };
    out.servo.law = LawParameters::Regulator(PidParameters {
        proportional_derivative: Row {
            coefficients: [0, 0],
        },
        integral: (share * most * f64::from(1 << 26)) as i32,
        feedforward: Row::default(),
        creep: Default::default(),
        notch: Row {
            coefficients: [1 << 28, 0, 0, 0, 0],
        },
    });
    assert_eq!(verify(&out, 20_000), Ok(()));
    out
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn a_mode_that_loses_its_damping_raises_the_alarm_before_the_guard_stops_it() {
    let damped = StageTruth::drawn(1);
    let mode = TrueMode {
        frequency_hz: 740.0,
        damping_ratio: 0.02,
        share: damped.first_mode.share,
    };
    let parameters = slow_integral(&damped, &mode, 0.6);
    let mut told: Vec<(f64, LoopFigures)> = Vec::new();
    // A step of the damping ratio changes the rate at which the loop rings up or down by 2 a second.
    for step in 0..40 {
        let damping_ratio = mode.damping_ratio - 4e-4 * f64::from(step);
        let stage = StageTruth {
            first_mode: TrueMode {
                damping_ratio,
                ..mode
            },
            ..damped.clone()
        };
        let mut running = RunningAmplifier::conditioned(&stage, &parameters);
        running.tell(sine(2.0, 0.05 * stage.travel_um, 0.4 * stage.travel_um));
        running.tell(Command::Enable);
        running.run(SECOND);
        let mut telemetry = LoopTelemetry::new(20_000);
        telemetry
            .listen(ResonanceWatch {
                frequency_millihertz: 740_000,
                alarm_pm: 20_000,
            })
            .unwrap();
        for _ in 0..3 {
            let (said, expected, _) = second_of(&mut running, &mut telemetry, 740.0);
            agree(&said, expected);
            told.push((damping_ratio, said));
            if said.alarm {
                break;
            }
        }
        if told.last().is_some_and(|(_, said)| said.alarm) {
            break;
        }
    }
    let ((_, first), (at, rings)) = (told[0], told[told.len() - 1]);
    println!(
        "{:.3} nm with a damping ratio of 0.02, {:.1} nm with {at:.4}",
        f64::from(first.resonance_pm) / 1e3,
        f64::from(rings.resonance_pm) / 1e3
    );
    assert!(first.resonance_pm < 1_000 && !first.alarm, "{first:?}");
    // The integral's share of what the mode stands, at the slope of a loop this small: some 0.8 of the
    // travel's.
    assert!(
        rings.alarm
            && rings.resonance_pm > 20_000
            && (0.4..0.65).contains(&(at / mode.damping_ratio)),
        "{at} {rings:?}"
    );
}

/// The largest step of the drive from tick to tick, codes, and the RMS of the true error, nm, without its
/// mean.
fn followed(running: &mut RunningAmplifier, ticks: usize) -> (u32, f64) {
    let (mut step, mut before) = (0, None);
    let errors: Vec<f64> = (0..ticks)
        .map(|_| {
            let sample = running.tick();
            step = step.max(before.map_or(0, |code| sample.dac_code.abs_diff(code)));
            before = Some(sample.dac_code);
            1e3 * (f64::from(sample.reference) / f64::from(1 << 24) - running.position_um)
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (
        step,
        (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64).sqrt(),
    )
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn the_block_from_another_recording_takes_over_without_a_step() {
    for seed in [0, 1, 20] {
        let truth = StageTruth::drawn(seed);
        // Other hysteresis, dynamics and gains: what another recording of the same stage shows of them.
        let [usual, wideband] = [StudyRecording::Usual, StudyRecording::Wideband]
            .map(|recording| block(&designed(&truth, recording)));
        assert_ne!(usual.servo.law, wideband.servo.law);
        assert_ne!(usual.servo.actuator, wideband.servo.actuator);
        for (hz, old, new) in [
            (0.0, &usual, &wideband),
            (20.0, &usual, &wideband),
            (20.0, &wideband, &usual),
            (80.0, &usual, &wideband),
        ] {
            let closed = |parameters: &AmplifierParameters| {
                let mut running = RunningAmplifier::conditioned(&truth, parameters);
                running.tell(sine(hz, 0.15 * truth.travel_um, 0.4 * truth.travel_um));
                running.tell(Command::Enable);
                running.run(SECOND + 137);
                running
            };
            let (mut running, mut all_along) = (closed(old), closed(new));
            let (own_step, _) = followed(&mut running, 1000);
            let mut stayed = running.clone();
            assert_eq!(running.amplifier.swap(new), Ok(()));
            let codes = [&mut stayed, &mut running].map(|running| running.tick().dac_code);
            let apart = codes[0].abs_diff(codes[1]);
            let (step, behind_nm) = followed(&mut running, 1000);
            let (_, old_nm) = followed(&mut stayed, 1000);
            followed(&mut all_along, 1000);
            let (new_step, new_nm) = followed(&mut all_along, 1000);
            println!(
                "{seed}, {hz} Hz: first drives {apart} codes apart, largest step {own_step} before, {step} behind ({new_step} of the new block's own); true error behind it {behind_nm:.2} nm, {old_nm:.2} and {new_nm:.2} of the blocks' own"
            );
            assert!(apart <= own_step.max(new_step), "{apart} {own_step}");
            assert!(
                f64::from(step) <= 1.5 * f64::from(own_step.max(new_step)),
                "{step} {own_step} {new_step}"
            );
            assert!(
                behind_nm < 1.5 * old_nm.max(new_nm) + 1e3 * truth.noise_um,
                "{behind_nm} {old_nm} {new_nm}"
            );
            assert_eq!(running.amplifier.mode(), Mode::Closed);
            // And the loop goes on as it does with the block from the start.
            running.run(SECOND);
            let (_, later_nm) = followed(&mut running, 4000);
            let (_, along_nm) = followed(&mut all_along, 4000);
            assert!(
                (later_nm - along_nm).abs() < 0.25 * along_nm + 0.5e3 * truth.noise_um,
                "{later_nm} {along_nm}"
            );
        }
    }
}
