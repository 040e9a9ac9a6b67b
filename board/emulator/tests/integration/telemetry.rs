//! The unmodified image says how well its closed loop followed, and whether its resonance rings: its figures
//! beside those that the host computes from the same simulation, in double precision and by the plain
//! transform.

use crate::common;

use common::{best_parameters, block, host_run, lines, parameters, run_on, samples, typed_back};
use hysteron_core::amplifier::Mode;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::trace_frame::TraceSample;
use hysteron_emulator::converters::World;
use hysteron_emulator::run::{MILLISECOND, Outcome, Script};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::closed_loop::Plant;
use std::f64::consts::TAU;

/// What is listened to, Hz: the first mode of the bench.
const RESONANCE_HZ: f64 = 852.0;
const ALARM_NM: u32 = 20;
const WINDOW: usize = 20_000;
const SEGMENT: usize = 1000;
const ENABLE_TICK: u32 = 301;

/// What a second of the closed loop comes to: error RMS and peak, nm, drive RMS, V, amplitude at the
/// resonance, nm.
fn figures(parameters: &AmplifierParameters, window: &[TraceSample]) -> [f64; 4] {
    let c = parameters.servo.converters;
    let position_um = |code| {
        f64::from(c.adc_zero) / f64::from(1 << 24)
            + f64::from(code) * c.adc_step as f64 / 2f64.powi(40)
    };
    let drive_v = |code| {
        f64::from(c.dac_zero) / f64::from(1 << 22)
            + f64::from(code) * c.dac_step as f64 / 2f64.powi(38)
    };
    let errors: Vec<f64> = window
        .iter()
        .map(|sample| {
            1000.0
                * (f64::from(sample.reference) / f64::from(1 << 24) - position_um(sample.adc_code))
        })
        .collect();
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / window.len() as f64;
    let power = |segment: &[f64]| {
        let (real, imaginary) =
            segment
                .iter()
                .enumerate()
                .fold((0.0, 0.0), |(real, imaginary), (n, error)| {
                    let weight = (1.0 - (TAU * n as f64 / segment.len() as f64).cos()) / 2.0;
                    let (sine, cosine) = (TAU * RESONANCE_HZ * n as f64 / 20_000.0).sin_cos();
                    let error = weight * (error - segment[0]);
                    (real + error * cosine, imaginary + error * sine)
                });
        (real * real + imaginary * imaginary) * 16.0 / (segment.len() as f64).powi(2)
    };
    [
        mean(&mut errors.iter().map(|error| error * error)).sqrt(),
        errors.iter().fold(0.0, |most, error| most.max(error.abs())),
        mean(&mut window.iter().map(|sample| drive_v(sample.dac_code).powi(2))).sqrt(),
        (errors.chunks(SEGMENT).map(power).sum::<f64>() * SEGMENT as f64 / window.len() as f64)
            .sqrt(),
    ]
}

/// The first whole second of the closed loop.
fn first_second(samples: &[TraceSample]) -> &[TraceSample] {
    let closed = samples
        .iter()
        .position(|sample| sample.flags == Mode::Closed as u16)
        .expect("closes");
    &samples[closed..closed + WINDOW]
}

/// A massless actuator of 1/7 um/V behind a lightly damped mode: the bench's own is damped so well that it
/// does not ring.
struct Light {
    damping_ratio: f64,
    position_um: f64,
    velocity_um_s: f64,
}

impl Plant for Light {
    fn advance(&mut self, drive_v: f64, _force_um: f64) {
        const STEPS: u32 = 40;
        let (w, h) = (TAU * RESONANCE_HZ, 50e-6 / f64::from(STEPS));
        for _ in 0..STEPS {
            let acceleration = w * w * (drive_v / 7.0 - self.position_um)
                - 2.0 * self.damping_ratio * w * self.velocity_um_s;
            self.velocity_um_s += h * acceleration;
            self.position_um += h * self.velocity_um_s;
        }
    }

    fn sensor_um(&self) -> f64 {
        self.position_um
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }
}

/// That stage between the bench's converters.
fn light(damping_ratio: f64) -> World {
    let bench = Bench::reference().expect("the bench");
    let stage = Light {
        damping_ratio,
        position_um: 0.0,
        velocity_um_s: 0.0,
    };
    World::with(
        Box::new(stage),
        bench.converter_scale(),
        bench.converters.sensor_noise_um,
        7,
    )
}

/// Integral control that is slow beside the mode.
fn slow() -> AmplifierParameters {
    let mut slow = parameters();
    if let LawParameters::Regulator(pid) = &mut slow.servo.law {
        pid.proportional_derivative.coefficients = [0, 0];
        pid.integral = (0.005 * f64::from(1 << 26)) as i32;
    }
    slow
}

struct Followed {
    outcome: Outcome,
    /// What the host says of the first second.
    expected: [f64; 4],
    /// What the target says: `SPA?` 0x7F000010 to 13, in nm and V.
    said: [f64; 4],
    /// `DIA? 13 14 15`.
    counts: [f64; 3],
}

/// Follows a sine of 10 Hz and 1 um for a second, on the target and on the host.
fn follow(parameters: &AmplifierParameters, new_world: impl Fn() -> World) -> Followed {
    let commands = [
        (99, "arm untested"),
        (100, "conditioning waived"),
        (300, "reference sine 10000 1000 5600"),
        (ENABLE_TICK, "enable"),
    ];
    let world = new_world().shared();
    let first = format!(
        "trace 31 1\nresonance {} {ALARM_NM}\n",
        (RESONANCE_HZ * 1000.0) as u32
    );
    // A second of the loop, and what the tasks are behind.
    let ticks = ENABLE_TICK + WINDOW as u32 + 400;
    let asked = u64::from(ticks) * 50_000;
    let script = Script {
        block: Some(block(parameters)),
        commands: vec![
            (
                2 * MILLISECOND,
                [first.into_bytes(), lines(&commands)].concat(),
            ),
            (asked, b"status\n".to_vec()),
        ],
        serial: vec![(
            asked,
            b"SPA? 1 0x7F000010 1 0x7F000011 1 0x7F000012 1 0x7F000013\nDIA? 13 14 15\n".to_vec(),
        )],
        ..Script::listening(asked + 40 * MILLISECOND)
    };
    let outcome = run_on(&world, script);
    let (target, lost) = samples(&outcome);
    let mut twin = new_world();
    let host = host_run(parameters, &mut twin, &commands, ticks as usize);
    assert_eq!(lost, 0);
    let second = first_second(&host);
    assert!(first_second(&target) == second, "target and host differ");
    let expected = figures(parameters, second);
    let text: String = typed_back(&outcome);
    let numbers: Vec<f64> = text
        .lines()
        .map(|line| {
            line.rsplit('=')
                .next()
                .unwrap_or("")
                .trim()
                .parse()
                .expect("a number")
        })
        .collect();
    let [a, b, c, d, windows, torn, alarms] = numbers[..] else {
        panic!("{text:?}")
    };
    println!(
        "host: {expected:.3?} nm RMS, nm peak, V RMS, nm at {RESONANCE_HZ} Hz; target: {:?}",
        [a, b, c, d]
    );
    for message in outcome
        .messages
        .iter()
        .filter(|message| !message.text.starts_with("trace ["))
    {
        println!("{:>12} {} {}", message.at_ns, message.level, message.text);
    }
    Followed {
        outcome,
        expected,
        said: [a, b, c, d],
        counts: [windows, torn, alarms],
    }
}

/// The target's figures are the host's within 0.1 %, and within what is cut from the peak: 1 pm.
fn agree(followed: &Followed) {
    for (said, expected) in followed.said.iter().zip(followed.expected) {
        assert!(
            (said - expected).abs() <= 1e-3 * expected + 1e-3,
            "{:?} instead of {:?}",
            followed.said,
            followed.expected
        );
    }
}

#[test]
fn a_quiet_loop_has_the_figures_of_the_host_and_no_alarm() {
    let bench = Bench::reference().expect("the bench");
    let followed = follow(&best_parameters(), || World::new(&bench, Variant::FULL, 7));
    agree(&followed);
    assert_eq!(followed.counts, [1.0, 0.0, 0.0]);
    assert_eq!(followed.outcome.texts_with("above the alarm").count(), 0);
    assert_eq!(
        followed
            .outcome
            .texts_with("last second of the closed loop")
            .count(),
        1
    );
}

#[test]
fn a_damped_mode_is_quiet_and_one_that_has_lost_its_damping_is_told_once() {
    let quiet = follow(&slow(), || light(0.02));
    agree(&quiet);
    assert_eq!(quiet.counts, [1.0, 0.0, 0.0]);
    assert_eq!(quiet.outcome.texts_with("above the alarm").count(), 0);

    let rings = follow(&slow(), || light(0.008));
    agree(&rings);
    assert_eq!(rings.counts, [1.0, 0.0, 1.0]);
    let told: Vec<&str> = rings.outcome.texts_with("above the alarm").collect();
    let expected = format!(
        "amplitude at 852 Hz is {:.0} nm, above the alarm of 20 nm",
        rings.said[3]
    );
    // Once when it began, and once in the status.
    assert_eq!(told, [expected.as_str(), expected.as_str()]);
    // It stops nothing.
    assert_eq!(rings.outcome.texts_with("mode fault").count(), 0);
}
