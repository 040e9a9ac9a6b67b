//! The proof that no signal wraps: the amplifier is run over blocks of every kind that [`verify`] accepts, at
//! the ends of what they allow, by code that fails where a value has no room in 32 bits or a sum leaves 64
//! ([`crate::signal::narrow`], [`crate::signal::sum`]).

extern crate std;

use proptest::prelude::*;
use std::vec::Vec;

use crate::amplifier::Amplifier;
use crate::amplifier_command::Command;
use crate::codes::{DriveCode, LEAST_BITS, MOST_BITS, SensorCode};
use crate::creep_inverse::{CREEP_TERMS, CreepInverseParameters};
use crate::gain_adaptation::{AdaptationParameters, LARGEST_STEP, MOST};
use crate::guard::GuardParameters;
use crate::integer_row::Row;
use crate::learned_feedforward::{
    LEAST_PERIOD_TICKS, LearningParameters, ROBUSTNESS_TAPS, SETTLING_TICKS,
};
use crate::one_sided_hysteresis::SurfaceCoefficients;
use crate::parameter_block::tests::example;
use crate::parameter_block::{AmplifierParameters, verify};
use crate::pid_regulator::PidParameters;
use crate::predictor_law::{PredictorParameters, STATES};
use crate::reference_generator::Waveform;
use crate::sensor_lag::SensorLag;
use crate::servo_parameters::{ActuatorParameters, ConverterParameters, LawParameters};
use crate::servo_tick::ServoTick;
use crate::signal::{Micrometres, Quantity, Volts};
use crate::sliding_mode_controller::{Prediction, Reaching, SlidingModeParameters};
use crate::state_estimator::EstimatorParameters;
use crate::wire::BlockError;

/// Numbers of every size.
fn number() -> impl Strategy<Value = i32> {
    (any::<i32>(), 0u32..31).prop_map(|(raw, shift)| raw >> shift)
}

/// A row near and beyond the largest that is accepted.
fn row<const N: usize, const Q: u32>() -> impl Strategy<Value = Row<N, Q>> {
    let shift = 31 - (N as u32).leading_zeros();
    (prop::array::uniform::<_, N>(any::<i32>()), 0..shift + 12).prop_map(|(raw, less)| Row {
        coefficients: raw.map(|coefficient| coefficient >> less),
    })
}

fn law() -> impl Strategy<Value = LawParameters> {
    let numbers = || prop::array::uniform::<_, CREEP_TERMS>(number());
    let thresholds = numbers().prop_map(|raw| raw.map(|number| number.saturating_abs()));
    let pair = (any::<bool>(), row(), prop::array::uniform4(number()));
    let creep = (0..=CREEP_TERMS as u8, row(), numbers(), thresholds, pair);
    let creep = creep.prop_map(
        |(terms, shares, rates, thresholds, (pair, pair_shares, pair_rates))| {
            CreepInverseParameters {
                terms,
                pair,
                shares,
                rates,
                thresholds,
                pair_shares,
                pair_rates,
                at_rest: 1 << 28,
            }
        },
    );
    let regulator = (
        row::<2, 20>(),
        number(),
        row::<16, 20>(),
        row::<5, 28>(),
        creep,
    );
    let regulator = regulator.prop_map(
        |(proportional_derivative, integral, feedforward, notch, creep)| {
            LawParameters::Regulator(PidParameters {
                proportional_derivative,
                integral,
                feedforward,
                creep,
                notch,
            })
        },
    );
    let reaching = prop_oneof![
        (row(), number()).prop_map(|(proportional_derivative, integral)| Reaching::Pid {
            proportional_derivative,
            integral
        }),
        number().prop_map(|magnitude| Reaching::Switching { magnitude }),
        (number(), number()).prop_map(|(magnitude, thickness)| Reaching::BoundaryLayer {
            magnitude,
            thickness
        }),
    ];
    let prediction = prop::option::of([row(), row()].prop_map(|rows| Prediction { rows }));
    let sliding = (
        prop::array::uniform3(row()),
        row(),
        row(),
        row(),
        row(),
        row(),
        reaching,
        prediction,
    )
        .prop_map(
            |(
                rows,
                unknown_input,
                reference_velocity,
                reference_drive,
                switching_function,
                equivalent_control,
                reaching,
                prediction,
            )| {
                LawParameters::SlidingMode {
                    estimator: EstimatorParameters {
                        rows,
                        unknown_input,
                    },
                    controller: SlidingModeParameters {
                        reference_velocity,
                        reference_drive,
                        switching_function,
                        equivalent_control,
                        reaching,
                        prediction,
                    },
                }
            },
        );
    let predictor = (
        prop::array::uniform::<_, STATES>(row()),
        number(),
        number(),
        row(),
        row(),
        row(),
    )
        .prop_map(
            |(state_rows, unknown_gain, slope_gain, reading_row, gain_row, feedforward)| {
                LawParameters::Predictor(PredictorParameters {
                    state_rows,
                    unknown_gain,
                    slope_gain,
                    reading_row,
                    gain_row,
                    feedforward,
                })
            },
        );
    prop_oneof![Just(LawParameters::Hold), regulator, sliding, predictor]
}

/// Filters of a learned correction near and beyond the largest that are accepted.
fn learning() -> impl Strategy<Value = LearningParameters> {
    let limits = (1..=i32::MAX, 1..=i16::MAX, 1u8..4, 0u8..16);
    (row(), row(), limits).prop_map(
        |(
            learning,
            mut robustness,
            (error_limit, point_limit, periods_per_halving, most_halvings),
        )| {
            robustness.coefficients[0] = 0;
            for tap in 1..ROBUSTNESS_TAPS / 2 {
                robustness.coefficients[ROBUSTNESS_TAPS - tap] = robustness.coefficients[tap];
            }
            LearningParameters {
                learning,
                robustness,
                error_limit,
                point_limit,
                periods_per_halving,
                most_halvings,
            }
        },
    )
}

/// Bounds of an adapted gain that learns from anything.
fn adaptation() -> impl Strategy<Value = AdaptationParameters> {
    (1..=MOST, 1..=LARGEST_STEP).prop_map(|(most, most_step)| AdaptationParameters {
        most,
        most_step,
        error_limit: i32::MAX,
        least_motion: 256,
    })
}

/// Lowest drive and range of the actuator, V.
fn actuator(low_v: f64, range_v: f64) -> impl Strategy<Value = ActuatorParameters> {
    let linear = (-9.0f64..9.0).prop_map(|exponent| {
        let gain = exponent.exp2();
        ActuatorParameters::Linear {
            volts_per_micrometre: ((1 << 20) as f64 / gain) as i32,
            micrometres_per_volt: ((1 << 28) as f64 * gain) as i32,
        }
    });
    let surfaces = (
        prop::array::uniform5(prop::array::uniform5(any::<i32>())),
        prop::array::uniform5(any::<i32>()),
        0u32..12,
        0u32..12,
    );
    let hysteresis =
        surfaces.prop_map(
            move |(g, f, less_g, less_f)| ActuatorParameters::OneSidedHysteresis {
                surfaces: SurfaceCoefficients {
                    g: g.map(|row| row.map(|c| c >> less_g)),
                    f: f.map(|c| c >> less_f),
                },
                drive_min: (low_v * f64::from(1 << 22)) as i32,
                drive_range: (range_v * f64::from(1 << 22)) as i32,
                share_per_volt: ((1u64 << 32) as f64 / range_v) as i64,
            },
        );
    prop_oneof![Just(ActuatorParameters::Direct), linear, hysteresis]
}

/// Converters whose spans reach beyond what is accepted.
fn converters() -> impl Strategy<Value = ConverterParameters> {
    let bits = || LEAST_BITS - 1..MOST_BITS + 2;
    let sensor = (0.01f64..140.0, -140.0f64..140.0, bits());
    let drive = (
        1.0f64..1100.0,
        -600.0f64..400.0,
        bits(),
        any::<[u32; 2]>(),
        (1u32..1 << 20, 0u32..20),
        any::<bool>(),
    );
    (sensor, drive).prop_map(
        |(
            (span_um, zero_um, adc_bits),
            (span_v, zero_v, dac_bits, limits, (slew, less), noise_shaping),
        )| {
            let [a, b] =
                limits.map(|code| DriveCode::new(code & DriveCode::highest(dac_bits).steps()));
            let codes = f64::from(dac_bits).exp2();
            ConverterParameters {
                adc_zero: (zero_um * f64::from(1 << 24)) as i32,
                adc_step: (span_um * (1i64 << 40) as f64 / f64::from(adc_bits).exp2()) as i64,
                dac_zero: (zero_v * f64::from(1 << 22)) as i32,
                dac_step: (span_v / codes * (1i64 << 38) as f64) as i64,
                dac_codes_per_volt: (codes / span_v * f64::from(1 << 16)) as i32,
                dac_code_min: a.min(b),
                dac_code_max: a.max(b),
                slew_codes: (slew >> less).max(1),
                adc_bits,
                dac_bits,
                noise_shaping,
            }
        },
    )
}

fn block() -> impl Strategy<Value = AmplifierParameters> {
    let limits = |c: &ConverterParameters| {
        let volts = |code: DriveCode| {
            f64::from(c.dac_zero) / f64::from(1 << 22)
                + f64::from(code) * c.dac_step as f64 / (1i64 << 38) as f64
        };
        (volts(c.dac_code_min), volts(c.dac_code_max))
    };
    let with_actuator = move |c: ConverterParameters| {
        let (low_v, high_v) = limits(&c);
        (
            Just(c),
            Just((low_v, high_v)),
            actuator(low_v, (high_v - low_v).max(1e-3)),
        )
    };
    let guard = (
        any::<u32>(),
        (1u32..1 << 20, 0u32..20),
        any::<u32>(),
        any::<[u16; 2]>(),
    );
    let learned = (prop::option::of(learning()), prop::option::of(adaptation()));
    let late = (-i32::MAX..=i32::MAX, any::<i32>());
    let late = late.prop_map(|(carried, before)| SensorLag {
        carried,
        before: before % (i32::MAX - carried.abs()).max(1),
    });
    let lag = prop_oneof![Just(SensorLag::NONE), late];
    (
        converters().prop_flat_map(with_actuator),
        law(),
        guard,
        (any::<bool>(), lag),
        learned,
    )
        .prop_map(
            |(
                (c, (low_v, high_v), actuator),
                law,
                guard,
                (delayed, sensor_lag),
                (learning, adaptation),
            )| {
                let mut parameters = example();
                let (rest, (ramp, less), jump_codes, [tracking_ticks, healthy_ticks]) = guard;
                parameters.physical.drive_min_mv = (low_v * 1000.0) as i32;
                parameters.physical.drive_max_mv = (high_v * 1000.0) as i32;
                parameters.physical.sensor_span_nm =
                    (c.adc_step as f64 * f64::from(c.adc_bits).exp2() / (1i64 << 40) as f64
                        * 1000.0) as i32;
                parameters.physical.slew_limit_v_s = 20_000_000;
                parameters.servo.converters = c;
                parameters.servo.actuator = actuator;
                parameters.servo.law = law;
                parameters.servo.delayed = delayed;
                parameters.servo.sensor_lag = sensor_lag;
                parameters.servo.learning = learning;
                parameters.servo.adaptation =
                    adaptation.filter(|_| matches!(law, LawParameters::Predictor(_)));
                parameters.guard = GuardParameters {
                    adc_code_min: SensorCode::new(0),
                    adc_code_max: SensorCode::highest(c.adc_bits),
                    stuck_ticks: 0,
                    jump_codes: jump_codes | 0xc_0000,
                    tracking_error: i32::MAX,
                    tracking_ticks: tracking_ticks | 0x100,
                    ramp_codes: (ramp >> less).clamp(1, c.slew_codes),
                    rest_code: DriveCode::new(rest & 0xf_ffff)
                        .clamp(c.dac_code_min, c.dac_code_max),
                    healthy_ticks,
                };
                parameters
            },
        )
}

/// What the sensor reads and what is asked: the ends of the range, and jumps between them.
#[derive(Clone, Debug)]
struct Asked {
    readings: Vec<u32>,
    reference: (i32, i32),
    play: (i32, i32),
    increment: u32,
}

fn asked() -> impl Strategy<Value = Asked> {
    let reading = prop_oneof![Just(0), Just(u32::MAX), any::<u32>()];
    (
        prop::collection::vec(reading, 1..12),
        any::<(i32, i32)>(),
        any::<(i32, i32)>(),
        any::<u32>(),
    )
        .prop_map(|(readings, reference, play, increment)| Asked {
            readings,
            reference,
            play,
            increment,
        })
}

/// The drive of a code without any format, V with 22 fraction bits.
fn exact_drive(c: &ConverterParameters, code: DriveCode) -> i128 {
    i128::from(c.dac_zero) + ((i128::from(code.steps()) * i128::from(c.dac_step)) >> 16)
}

fn position(c: ConverterParameters, code: SensorCode) -> i64 {
    let mut parameters = example().servo;
    parameters.converters = c;
    parameters.law = LawParameters::Hold;
    parameters.actuator = ActuatorParameters::Direct;
    let mut servo = ServoTick::new(parameters);
    servo.tick(code, crate::signal::Micrometres::from_bits(0));
    i64::from(servo.reading().to_bits())
}

/// Runs the amplifier through its modes; no code leaves the limits or changes by more than the slew limit.
fn run(parameters: &AmplifierParameters, asked: &Asked) -> Result<(), TestCaseError> {
    fn sine<Q: Quantity>(increment: u32, amplitude: i32) -> Waveform<Q> {
        Waveform::Multisine {
            tones: [(increment, Q::of_bits(amplitude), 0); 4],
        }
    }
    let phases = [
        (10, Some(Command::RequireConditioning(false))),
        (1, Some(Command::Arm { tested: false })),
        (
            60,
            Some(Command::Play {
                waveform: sine(asked.increment, asked.play.0),
                offset: Volts::from_bits(asked.play.1),
                ticks: 60,
            }),
        ),
        (1, Some(Command::Disable)),
        (
            1,
            Some(Command::Reference {
                waveform: sine(asked.increment, asked.reference.0),
                offset: Micrometres::from_bits(asked.reference.1),
            }),
        ),
        (250, Some(Command::Enable)),
        (
            1,
            Some(Command::Reference {
                waveform: Waveform::Constant,
                offset: Micrometres::MIN,
            }),
        ),
        (80, None),
        (
            1,
            Some(Command::Reference {
                waveform: Waveform::RoundedTriangle {
                    increment: asked.increment,
                    amplitude: Micrometres::MIN,
                },
                offset: Micrometres::from_bits(0),
            }),
        ),
        (80, None),
        // A period that is learned, until points are written and played.
        (
            4 * LEAST_PERIOD_TICKS + SETTLING_TICKS,
            Some(Command::Reference {
                waveform: Waveform::RoundedTriangle {
                    increment: u32::MAX / LEAST_PERIOD_TICKS + 1,
                    amplitude: Micrometres::from_bits(asked.reference.0),
                },
                offset: Micrometres::from_bits(asked.reference.1),
            }),
        ),
        (100, Some(Command::Disable)),
    ];
    // By themselves: readings that nothing moves end both in a fault.
    let tests = [
        (300, Some(Command::Arm { tested: true })),
        (1, Some(Command::Disable)),
        (1, Some(Command::Arm { tested: false })),
        (
            1200,
            Some(Command::Condition {
                cycle_ticks: 60,
                rest_ticks: 1,
            }),
        ),
    ];
    run_phases(parameters, asked, &tests)?;
    run_phases(parameters, asked, &phases)
}

fn run_phases(
    parameters: &AmplifierParameters,
    asked: &Asked,
    phases: &[(u32, Option<Command>)],
) -> Result<(), TestCaseError> {
    let c = parameters.servo.converters;
    let mut amplifier = Amplifier::new(*parameters);
    let mut before = parameters.guard.rest_code;
    // Mostly those of the converter; now and then one that only a wider one has, which is a fault.
    let codes = |raw: u32| {
        if raw % 64 == 63 {
            SensorCode::new(raw >> 12)
        } else {
            SensorCode::new(raw >> (32 - c.adc_bits))
        }
    };
    let mut readings = asked.readings.iter().map(|raw| codes(*raw)).cycle();
    for (ticks, command) in phases {
        if let Some(command) = command {
            // Whatever its limits are: they are looked at before.
            let _ = amplifier.obey(*command);
        }
        for _ in 0..*ticks {
            let sample = amplifier.tick(readings.next(), false);
            prop_assert!((c.dac_code_min..=c.dac_code_max).contains(&sample.dac_code));
            prop_assert!(
                sample.dac_code.abs_diff(before) <= c.slew_codes,
                "{} from {before}",
                sample.dac_code
            );
            prop_assert_eq!(
                i128::from(amplifier.servo().drive().to_bits()),
                exact_drive(&c, sample.dac_code)
            );
            before = sample.dac_code;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { max_global_rejects: 400_000, ..ProptestConfig::with_cases(3000) })]

    #[test]
    fn no_signal_wraps_over_all_accepted_blocks(parameters in block(), asked in asked()) {
        prop_assume!(verify(&parameters, 20_000).is_ok());
        run(&parameters, &asked)?;
    }

    /// Whatever the integers: if they are accepted, a higher code is no lower position.
    #[test]
    fn accepted_converters_keep_the_sign_of_the_feedback(
        wild in (number(), any::<i64>(), 0u32..64),
        codes in any::<[u32; 2]>(),
        bits in LEAST_BITS..=MOST_BITS,
    ) {
        let (adc_zero, adc_step, less) = wild;
        let mut parameters = example();
        let c = &mut parameters.servo.converters;
        (c.adc_zero, c.adc_step, c.adc_bits) = (adc_zero, adc_step >> less, bits);
        prop_assume!(!matches!(verify(&parameters, 20_000), Err(BlockError::Range(_))));
        let c = parameters.servo.converters;
        let [low, high] = codes.map(|code| SensorCode::new(code >> (32 - bits)));
        prop_assert!(position(c, low.max(high)) >= position(c, low.min(high)));
    }
}

#[test]
fn a_stage_of_150_um_is_refused_clearly_and_one_of_120_um_is_not() {
    let stage = |span_um: i64| {
        let mut parameters = example();
        parameters.physical.sensor_span_nm = (span_um * 1000) as i32;
        parameters.servo.converters.adc_step = span_um << 24;
        verify(&parameters, 20_000)
    };
    assert_eq!(
        stage(150).map_err(BlockError::reason),
        Err("the sensor's span must be at most 127 um, within +-128 um")
    );
    assert_eq!(stage(120), Ok(()));
}

#[test]
fn a_drive_of_600_v_is_refused_clearly() {
    let mut parameters = example();
    let c = &mut parameters.servo.converters;
    (c.dac_zero, c.dac_step, c.dac_codes_per_volt) =
        (0, (600i64 << 38) >> 16, ((65_536i64 << 16) / 600) as i32);
    (c.dac_code_min, c.dac_code_max) = (DriveCode::new(0), DriveCode::new(65_535));
    assert_eq!(
        verify(&parameters, 20_000),
        Err(BlockError::Range("the drive must stay within +-512 V"))
    );
}

#[test]
fn a_slew_limit_that_is_none_or_faster_than_it_says_is_refused() {
    let with = |slew_codes: u32, ramp_codes: u32| {
        let mut parameters = example();
        parameters.servo.converters.slew_codes = slew_codes;
        parameters.guard.ramp_codes = ramp_codes;
        verify(&parameters, 20_000)
    };
    assert_eq!(with(2340, 40), Ok(()));
    for (slew_codes, ramp_codes) in [(0, 40), (2345, 40), (30, 40), (2340, 0)] {
        assert!(
            matches!(with(slew_codes, ramp_codes), Err(BlockError::Range(_))),
            "{slew_codes} {ramp_codes}"
        );
    }
}

#[test]
fn a_code_beyond_the_bits_of_its_converter_is_refused() {
    let with = |change: &dyn Fn(&mut AmplifierParameters)| {
        let mut parameters = example();
        change(&mut parameters);
        verify(&parameters, 20_000)
    };
    let bits = Err(BlockError::Range(
        "converters have 8 to 20 bits, and no code beyond them",
    ));
    assert_eq!(with(&|p| p.servo.converters.dac_bits = 21), bits);
    assert_eq!(with(&|p| p.servo.converters.adc_bits = 7), bits);
    // 46 811 of the example has 16 bits.
    assert_eq!(with(&|p| p.servo.converters.dac_bits = 15), bits);
    assert_eq!(
        with(&|p| p.guard.adc_code_max = SensorCode::new(65_536)),
        Err(BlockError::Mismatch)
    );
}

#[test]
fn converters_of_20_bits_are_accepted_and_one_code_is_one_code() {
    let mut parameters = example();
    let c = &mut parameters.servo.converters;
    (c.adc_bits, c.adc_step) = (20, 15i64 << 20);
    (c.dac_bits, c.dac_step) = (20, 140i64 << 18);
    c.dac_codes_per_volt = ((1i64 << 36) / 140) as i32;
    (c.dac_code_min, c.dac_code_max) = (DriveCode::new(149_797), DriveCode::new(748_982));
    c.slew_codes = 37_440;
    parameters.guard.adc_code_max = SensorCode::new(1_048_575 - 256);
    parameters.guard.rest_code = c.dac_code_min;
    assert_eq!(verify(&parameters, 20_000), Ok(()));
    let c = parameters.servo.converters;
    for code in [149_797, 149_798, 400_001, 748_982].map(DriveCode::new) {
        assert_eq!(i64::from(c.steps(c.drive(code))), i64::from(code));
        // 134 uV.
        let step_v = f64::from(c.drive(code + 1) - c.drive(code)) / f64::from(1 << 22);
        assert!(
            (step_v - 140.0 / 1_048_576.0).abs() < 2f64.powi(-22),
            "{step_v}"
        );
    }
}
