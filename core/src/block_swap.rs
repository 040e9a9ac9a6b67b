//! Which parameter block may take the place of another one while the amplifier runs, and which may not.
//!
//! A swap changes the law, the model of the actuator and the limits of what is watched. It does not change
//! what the past was measured with: converters, their range, the drive's limits, the memory of the
//! hysteresis. What differs there needs rest and a restart, and is refused with the reason.

use crate::parameter_block::AmplifierParameters;
use crate::servo_parameters::{ActuatorParameters, ConverterParameters, LawParameters};

/// Whether `new` may take the place of `running`, whose sensor's zero was perhaps found since.
///
/// # Errors
/// Why not.
pub fn may_follow(
    running: &AmplifierParameters,
    new: &AmplifierParameters,
) -> Result<(), &'static str> {
    let (before, after) = (&running.physical, &new.physical);
    if before.name != after.name {
        return Err("made for another stage");
    }
    if before.sample_rate_hz != after.sample_rate_hz || running.servo.delayed != new.servo.delayed {
        return Err("made for another sampling rate");
    }
    if running.stepping != new.stepping {
        return Err("another stick-slip drive, or one instead of another kind");
    }
    let limits = |p: &AmplifierParameters| {
        (
            p.physical.drive_min_mv,
            p.physical.drive_max_mv,
            p.physical.sensor_span_nm,
        )
    };
    if limits(running) != limits(new)
        || !same_scale(&running.servo.converters, &new.servo.converters)
    {
        return Err("other converters, or another range of drive or sensor");
    }
    let rest = |p: &AmplifierParameters| {
        (
            p.guard.adc_code_min,
            p.guard.adc_code_max,
            p.guard.rest_code,
            p.guard.ramp_codes,
        )
    };
    let slew = |p: &AmplifierParameters| (p.physical.slew_limit_v_s, p.servo.converters.slew_codes);
    if rest(running) != rest(new) || slew(running) != slew(new) {
        return Err("another rest, ramp or slew limit");
    }
    if !same_memory(&running.servo.actuator, &new.servo.actuator) {
        return Err("another kind of actuator, or a hysteresis over another range of the drive");
    }
    match (&running.servo.law, &new.servo.law) {
        (LawParameters::Regulator(_), LawParameters::Regulator(_))
        | (LawParameters::Predictor(_), LawParameters::Predictor(_)) => Ok(()),
        // What one of them has learned in motion is no state of the other; a sliding mode's estimate of the
        // velocity would begin at rest.
        _ => Err("only from a regulator to another, or from a predictor to another"),
    }
}

/// Codes mean the same; the sensor's zero is found anew by every conditioning, and stays.
fn same_scale(running: &ConverterParameters, new: &ConverterParameters) -> bool {
    running.adc_step == new.adc_step
        && running.dac_zero == new.dac_zero
        && running.dac_step == new.dac_step
        && running.dac_codes_per_volt == new.dac_codes_per_volt
        && (running.adc_bits, running.dac_bits) == (new.adc_bits, new.dac_bits)
        && (running.dac_code_min, running.dac_code_max) == (new.dac_code_min, new.dac_code_max)
}

/// The drives of the past, as the running block remembers them, are what the new one needs to know.
fn same_memory(running: &ActuatorParameters, new: &ActuatorParameters) -> bool {
    use ActuatorParameters::{Linear, OneSidedHysteresis};
    match (running, new) {
        (Linear { .. }, Linear { .. }) => true,
        (
            OneSidedHysteresis {
                drive_min,
                drive_range,
                share_per_volt,
                ..
            },
            OneSidedHysteresis {
                drive_min: low,
                drive_range: range,
                share_per_volt: share,
                ..
            },
        ) => (drive_min, drive_range, share_per_volt) == (low, range, share),
        // A direct law works in volts: its state is no displacement.
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::amplifier::{Amplifier, Mode};
    use crate::amplifier_command::Command;
    use crate::codes::{DriveCode, SensorCode};
    use crate::guard::Fault;
    use crate::one_sided_hysteresis::SurfaceCoefficients;
    use crate::parameter_block::tests::{example, learning_example};
    use crate::parameter_block::verify;
    use crate::pid_regulator::PidParameters;
    use crate::reference_generator::Waveform;
    use crate::signal::Micrometres;
    use proptest::prelude::*;

    const CODES_PER_VOLT: f64 = 65_536.0 / 140.0;

    /// A massless linear actuator with a gain of 1/7 um/V, read by the ADC of the example with so many codes
    /// of noise.
    fn reading(code: DriveCode, tick: u32, noise_codes: u32) -> SensorCode {
        let volts = f64::from(code) * 140.0 / 65_536.0 - 20.0;
        let noise = (tick.wrapping_mul(2_654_435_761) >> 16) % (noise_codes + 1);
        SensorCode::new(((volts / 7.0 + 1.0) / 15.0 * 65_536.0) as u32 + noise)
    }

    /// Gains of a regulator that is stable around that actuator, a feedforward of nearly one, and an
    /// actuator's gain that is believed, V/um.
    #[derive(Clone, Copy, Debug)]
    struct Family {
        proportional: f64,
        derivative: f64,
        integral: f64,
        feedforward: [f64; 3],
        volts_per_micrometre: f64,
    }

    fn family() -> impl Strategy<Value = Family> {
        (
            0.0f64..0.3,
            0.0f64..0.1,
            0.01f64..0.1,
            prop::array::uniform3(0.0f64..0.3),
            6.0f64..8.0,
        )
            .prop_map(
                |(proportional, derivative, integral, feedforward, volts_per_micrometre)| Family {
                    proportional,
                    derivative,
                    integral,
                    feedforward,
                    volts_per_micrometre,
                },
            )
    }

    /// A notch whose gain at rest is one, with a memory of some ticks.
    const NOTCH: [f64; 5] = [0.9, -1.2, 0.6, 1.2, -0.5];

    fn block(family: &Family) -> AmplifierParameters {
        let mut parameters = example();
        // Without noise the sensor stays at a code.
        parameters.guard.stuck_ticks = 0;
        let fixed = |value: f64, bits: u32| (value * (1u64 << bits) as f64).round() as i32;
        let mut feedforward = [0; 16];
        for (place, value) in feedforward[7..10].iter_mut().zip(family.feedforward) {
            *place = fixed(value, 20);
        }
        parameters.servo.actuator = ActuatorParameters::Linear {
            volts_per_micrometre: fixed(family.volts_per_micrometre, 20),
            micrometres_per_volt: fixed(1.0 / family.volts_per_micrometre, 28),
        };
        if let LawParameters::Regulator(PidParameters {
            proportional_derivative,
            integral,
            feedforward: row,
            notch,
            ..
        }) = &mut parameters.servo.law
        {
            proportional_derivative.coefficients =
                [fixed(family.proportional, 20), fixed(family.derivative, 20)];
            *integral = fixed(family.integral, 26);
            row.coefficients = feedforward;
            notch.coefficients = NOTCH.map(|c| fixed(c, 28));
        }
        assert_eq!(verify(&parameters, 20_000), Ok(()));
        parameters
    }

    /// An amplifier in front of the actuator, and what its law had to do in the last tick, um: error, its
    /// change, feedforward.
    struct Running {
        amplifier: Amplifier,
        code: DriveCode,
        tick: u32,
        noise_codes: u32,
    }

    impl Running {
        fn begin(family: &Family, hz: f64, amplitude_um: f64, noise_codes: u32) -> Self {
            let mut amplifier = Amplifier::new(block(family));
            assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
            assert_eq!(
                amplifier.command(Command::RequireConditioning(false)),
                Ok(())
            );
            let increment = (hz / 20_000.0 * 2f64.powi(32)) as u32;
            let (tone, none) = (
                (increment, Micrometres::from_num(amplitude_um), 0),
                (0, Micrometres::ZERO, 0),
            );
            let waveform = Waveform::Multisine {
                tones: [tone, none, none, none],
            };
            assert_eq!(
                amplifier.command(Command::Reference {
                    waveform,
                    offset: Micrometres::from_num(5)
                }),
                Ok(())
            );
            let code = amplifier.parameters().guard.rest_code;
            let mut this = Self {
                amplifier,
                code,
                tick: 0,
                noise_codes,
            };
            this.run(10);
            assert_eq!(this.amplifier.command(Command::Enable), Ok(()));
            this
        }

        fn reading(&self) -> SensorCode {
            reading(self.code, self.tick, self.noise_codes)
        }

        /// So many ticks; the errors of the last three, um, newest first.
        fn run(&mut self, ticks: u32) -> [f64; 3] {
            let mut errors = [0.0; 3];
            for _ in 0..ticks {
                self.code = self.amplifier.tick(Some(self.reading()), false).dac_code;
                self.tick += 1;
                let servo = self.amplifier.servo();
                errors = [
                    (servo.reference() - servo.reading()).to_num(),
                    errors[0],
                    errors[1],
                ];
            }
            errors
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        /// At the first tick of the new block the drives of both differ by what their gains
        /// make of one tick, and by nothing else: no state is lost. With the increment `inc =
        /// P (e - e1) + D (c - c1) + I e + (f - f1)` of either law (error, its change,
        /// feedforward; 1: a tick ago), through the notch's first coefficient and the
        /// actuator's gain in V/um, that is `|g' inc' - g inc|` in codes. Beside it stand two
        /// codes: both drives are rounded to codes, half a code each, and what the last code
        /// rounded away is carried on with the other gain.
        #[test]
        fn the_first_drive_of_the_new_block_is_the_old_ones_but_for_one_tick_of_its_gains(
            [old, new] in prop::array::uniform2(family()),
            hz in 0.0f64..100.0,
            amplitude_um in 0.0f64..2.0,
            noise_codes in 0u32..20,
            ticks in 2000u32..5000,
        ) {
            let mut running = Running::begin(&old, hz, amplitude_um, noise_codes);
            let [e1, e2, _] = running.run(ticks);
            prop_assert_eq!(running.amplifier.mode(), Mode::Closed);
            let limited = running.amplifier.servo().counters().limited_ticks;
            let positions = |amplifier: &Amplifier| amplifier.servo().feedforward_window().map(|um| f64::from(um) / f64::from(1 << 24));
            let before = positions(&running.amplifier);

            let reading = running.reading();
            let mut stayed = running.amplifier.clone();
            let stayed_code = stayed.tick(Some(reading), false).dac_code;
            let mut swapped = running.amplifier.clone();
            prop_assert_eq!(swapped.swap(&block(&new)), Ok(()));
            let swapped_code = swapped.tick(Some(reading), false).dac_code;

            // Both see the same error: the reference did not jump.
            prop_assert_eq!(swapped.servo().reference(), stayed.servo().reference());
            prop_assert_eq!(swapped.servo().reading(), stayed.servo().reading());
            let e: f64 = (stayed.servo().reference() - stayed.servo().reading()).to_num();
            let after = positions(&stayed);
            let volts = |family: &Family| {
                let fed = |window: &[f64; 16]| -> f64 { window[7..10].iter().zip(family.feedforward).map(|(um, c)| um * c).sum() };
                let changes = family.proportional * (e - e1) + family.derivative * ((e - e1) - (e1 - e2)) + family.integral * e;
                family.volts_per_micrometre * NOTCH[0] * (changes + fed(&after) - fed(&before))
            };
            // What the notch remembers goes on with the gain of each.
            let bound = (volts(&new) - volts(&old)).abs() * CODES_PER_VOLT;
            let memory = notch_memory(&running.amplifier) * (new.volts_per_micrometre - old.volts_per_micrometre).abs() * CODES_PER_VOLT;
            prop_assume!(stayed.servo().counters().limited_ticks == limited && swapped.servo().counters().limited_ticks == limited);
            let step = f64::from(swapped_code.abs_diff(stayed_code));
            prop_assert!(step <= bound + memory + 2.0, "{step} codes, {bound} + {memory}");

            // And the loop goes on.
            running.amplifier = swapped;
            running.code = swapped_code;
            running.tick += 1;
            let [error, ..] = running.run(4000);
            prop_assert_eq!(running.amplifier.mode(), Mode::Closed);
            prop_assert!(error.abs() < 1.5, "{error} um");
        }

        /// The same block is no swap at all: all codes that follow are those of the running one.
        #[test]
        fn a_block_for_itself_changes_no_code(family in family(), hz in 0.0f64..100.0, noise_codes in 0u32..20) {
            let mut running = Running::begin(&family, hz, 1.0, noise_codes);
            running.run(3000);
            let mut stayed = Running { amplifier: running.amplifier.clone(), ..running };
            prop_assert_eq!(running.amplifier.swap(&block(&family)), Ok(()));
            for _ in 0..500 {
                running.run(1);
                stayed.run(1);
                prop_assert_eq!(running.code, stayed.code);
            }
        }
    }

    /// What the notch's memory adds to the next output beyond the last output, um.
    fn notch_memory(amplifier: &Amplifier) -> f64 {
        let [x1, x2, y1, y2] = amplifier
            .servo()
            .notch_memory()
            .map(|um| f64::from(um) / f64::from(1 << 24));
        let next = NOTCH[0] * x1 + NOTCH[1] * x1 + NOTCH[2] * x2 + NOTCH[3] * y1 + NOTCH[4] * y2;
        (next - y1).abs()
    }

    #[test]
    fn what_the_past_was_measured_with_cannot_change() {
        let good = example();
        let refused = |change: &dyn Fn(&mut AmplifierParameters)| {
            let mut new = good;
            change(&mut new);
            may_follow(&good, &new)
        };
        assert_eq!(refused(&|_| {}), Ok(()));
        assert_eq!(
            refused(&|new| new.servo.converters.adc_zero += 1000),
            Ok(()),
            "the zero is the one that was found"
        );
        assert_eq!(refused(&|new| new.guard.tracking_error /= 2), Ok(()));
        assert_eq!(
            refused(&|new| new.physical.name[0] = b'q'),
            Err("made for another stage")
        );
        assert_eq!(
            refused(&|new| new.physical.sample_rate_hz = 10_000),
            Err("made for another sampling rate")
        );
        assert_eq!(
            refused(&|new| new.servo.delayed = false),
            Err("made for another sampling rate")
        );
        const SCALE: Result<(), &str> =
            Err("other converters, or another range of drive or sensor");
        assert_eq!(refused(&|new| new.physical.drive_max_mv = 70_000), SCALE);
        assert_eq!(refused(&|new| new.physical.drive_min_mv = 1), SCALE);
        assert_eq!(refused(&|new| new.physical.sensor_span_nm = 16_000), SCALE);
        assert_eq!(refused(&|new| new.servo.converters.adc_step += 1), SCALE);
        assert_eq!(refused(&|new| new.servo.converters.dac_zero += 1), SCALE);
        assert_eq!(refused(&|new| new.servo.converters.dac_step += 1), SCALE);
        assert_eq!(
            refused(&|new| new.servo.converters.dac_codes_per_volt += 1),
            SCALE
        );
        assert_eq!(
            refused(
                &|new| new.servo.converters.dac_code_min = new.servo.converters.dac_code_min + 1
            ),
            SCALE
        );
        assert_eq!(
            refused(
                &|new| new.servo.converters.dac_code_max = new.servo.converters.dac_code_max - 1
            ),
            SCALE
        );
        const REST: Result<(), &str> = Err("another rest, ramp or slew limit");
        assert_eq!(
            refused(&|new| new.guard.rest_code = new.guard.rest_code + 1),
            REST
        );
        assert_eq!(refused(&|new| new.guard.ramp_codes += 1), REST);
        assert_eq!(
            refused(&|new| new.guard.adc_code_max = new.guard.adc_code_max - 1),
            REST
        );
        assert_eq!(
            refused(&|new| new.guard.adc_code_min = new.guard.adc_code_min + 1),
            REST
        );
        assert_eq!(refused(&|new| new.servo.converters.slew_codes -= 1), REST);
        assert_eq!(refused(&|new| new.physical.slew_limit_v_s -= 1), REST);
        const KIND: Result<(), &str> =
            Err("another kind of actuator, or a hysteresis over another range of the drive");
        let surfaces = SurfaceCoefficients {
            g: [[1; 5]; 5],
            f: [1; 5],
        };
        let over = |range: i32| ActuatorParameters::OneSidedHysteresis {
            surfaces,
            drive_min: 0,
            drive_range: range,
            share_per_volt: 7,
        };
        assert_eq!(
            refused(&|new| new.servo.actuator = ActuatorParameters::Direct),
            KIND
        );
        assert_eq!(refused(&|new| new.servo.actuator = over(80 << 22)), KIND);
        let hysteresis = |range: i32| {
            let mut block = good;
            block.servo.actuator = over(range);
            block
        };
        assert_eq!(
            may_follow(&hysteresis(80 << 22), &hysteresis(81 << 22)),
            KIND
        );
        assert_eq!(
            may_follow(&hysteresis(80 << 22), &hysteresis(80 << 22)),
            Ok(())
        );
        assert!(refused(&|new| new.servo.law = LawParameters::Hold).is_err());
    }

    #[test]
    fn what_is_refused_changes_nothing() {
        let family = Family {
            proportional: 0.1,
            derivative: 0.0,
            integral: 0.05,
            feedforward: [0.0; 3],
            volts_per_micrometre: 7.0,
        };
        let mut running = Running::begin(&family, 10.0, 1.0, 3);
        running.run(3000);
        let mut other = block(&family);
        other.guard.rest_code = other.guard.rest_code + 1;
        let mut stayed = Running {
            amplifier: running.amplifier.clone(),
            ..running
        };
        assert_eq!(
            running.amplifier.swap(&other),
            Err("another rest, ramp or slew limit")
        );
        assert_eq!(
            (running.run(500), running.code),
            (stayed.run(500), stayed.code)
        );
        // Not while a drive is held, not with a fault; at rest it may be.
        let good = block(&family);
        assert_eq!(
            running.amplifier.command(Command::Hold { drive: None }),
            Ok(())
        );
        assert!(running.amplifier.swap(&good).is_err());
        assert_eq!(running.amplifier.command(Command::Disable), Ok(()));
        running.run(4000);
        assert_eq!(running.amplifier.swap(&good), Ok(()));
        assert_eq!(
            (running.amplifier.mode(), running.code),
            (Mode::Rest, good.guard.rest_code)
        );
        running.amplifier.refuse(Fault::HostLost);
        assert_eq!(running.amplifier.swap(&good), Err("a fault is latched"));
    }

    #[test]
    fn what_is_learned_goes_on_or_the_block_is_refused() {
        let mut learning = example();
        learning.servo.learning = Some(learning_example());
        assert_eq!(verify(&learning, 20_000), Ok(()));
        let mut amplifier = Amplifier::new(learning);
        assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        let waveform = Waveform::RoundedTriangle {
            increment: u32::MAX / 400 + 1,
            amplitude: Micrometres::from_num(1),
        };
        assert_eq!(
            amplifier.command(Command::Reference {
                waveform,
                offset: Micrometres::from_num(5)
            }),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        assert_eq!(amplifier.swap(&learning), Ok(()));
        assert!(
            amplifier
                .swap(&example())
                .is_err_and(|reason| reason.contains("learned"))
        );
        assert_eq!(
            amplifier.command(Command::Reference {
                waveform: Waveform::Constant,
                offset: Micrometres::from_num(5)
            }),
            Ok(())
        );
        assert_eq!(amplifier.swap(&example()), Ok(()));
    }
}
