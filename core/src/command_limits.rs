//! What a reference or a drive may ask for, when somebody types it: more than the sensor can show or the
//! actuator may have is refused and not cut silently.
//!
//! The limits are those that the serial port's commands have: of a position what the sensor can honestly
//! give, counted from the zero that is in force when the command acts; of a drive those of the parameter
//! block. The points of a wave table are looked at by whoever writes them.

use crate::amplifier_command::{Command, Refusal};
use crate::guard::GuardParameters;
use crate::parameter_block::AmplifierParameters;
use crate::reference_generator::Waveform;
use crate::servo_parameters::ConverterParameters;
use crate::signal::{Micrometres, Quantity, Volts, volts};

/// What rounding an amplitude and an offset to their format can bring a limit beyond itself, in last places.
const ROUNDING: i64 = 2;

/// Positions that the sensor can honestly give, lowest and highest.
#[must_use]
pub fn positions(
    converters: &ConverterParameters,
    guard: &GuardParameters,
) -> (Micrometres, Micrometres) {
    let position = |code| Micrometres::from_bits(converters.position(code));
    (position(guard.adc_code_min), position(guard.adc_code_max))
}

/// Drives that the actuator may have, lowest and highest.
#[must_use]
pub fn drives(parameters: &AmplifierParameters) -> (Volts, Volts) {
    let limit = |millivolts| Volts::from_bits(volts(millivolts));
    (
        limit(parameters.physical.drive_min_mv),
        limit(parameters.physical.drive_max_mv),
    )
}

/// How far a waveform goes below and above its offset, raw; `None` for the points of a table.
fn reach<Q: Quantity>(waveform: &Waveform<Q>) -> Option<(i64, i64)> {
    let size = |amplitude: &Q| i64::from(amplitude.bits()).abs();
    let both = |amplitude: i64| Some((-amplitude, amplitude));
    match waveform {
        Waveform::Constant => both(0),
        Waveform::Multisine { tones } => {
            both(tones.iter().map(|(_, amplitude, _)| size(amplitude)).sum())
        }
        Waveform::RoundedTriangle { amplitude, .. } | Waveform::Chirp { amplitude, .. } => {
            both(size(amplitude))
        }
        Waveform::QuasiStep { height, .. } => Some((
            i64::from(height.bits()).min(0),
            i64::from(height.bits()).max(0),
        )),
        Waveform::Table(_) => None,
    }
}

/// Whether all of a waveform lies within limits of the same quantity. The points of a table are looked at by
/// whoever writes them.
#[must_use]
pub fn is_within<Q: Quantity>(
    waveform: &Waveform<Q>,
    offset: Q,
    (lowest, highest): (Q, Q),
) -> bool {
    let Some((below, above)) = reach(waveform) else {
        return true;
    };
    let offset = i64::from(offset.bits());
    offset + below >= i64::from(lowest.bits()) - ROUNDING
        && offset + above <= i64::from(highest.bits()) + ROUNDING
}

/// Looks at a command before it acts, with the converters as they are zeroed now.
///
/// # Errors
/// [`Refusal::BeyondLimits`] where what it plays leaves its limits.
pub fn check(
    command: &Command,
    parameters: &AmplifierParameters,
    converters: &ConverterParameters,
) -> Result<(), Refusal> {
    let within = match command {
        Command::Reference { waveform, offset } => {
            is_within(waveform, *offset, positions(converters, &parameters.guard))
        }
        Command::Play {
            waveform, offset, ..
        } => is_within(waveform, *offset, drives(parameters)),
        // The input has limits of its own, and a reference that cannot change follows nothing.
        Command::FollowInput { most_step } => *most_step > Micrometres::ZERO,
        _ => true,
    };
    if within {
        Ok(())
    } else {
        Err(Refusal::BeyondLimits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codes::SensorCode;
    use crate::command_text::{Line, parse};
    use crate::parameter_block::tests::example;

    /// Whether a typed command is within the limits of the example: 15 um of sensor from -1 um on, a drive of
    /// 0 to 80 V.
    fn fits(text: &str) -> bool {
        let mut parameters = example();
        parameters.servo.converters.adc_zero = -(1 << 24);
        parameters.servo.converters.adc_step = (15i64 << 40) / 65_536;
        parameters.guard.adc_code_min = SensorCode::new(0);
        parameters.guard.adc_code_max = SensorCode::new(65_535);
        (
            parameters.physical.drive_min_mv,
            parameters.physical.drive_max_mv,
        ) = (0, 80_000);
        let Ok(Line::Control(None, command)) = parse(text, 20_000) else {
            panic!("{text}")
        };
        check(&command, &parameters, &parameters.servo.converters).is_ok()
    }

    #[test]
    fn what_leaves_the_limits_is_refused_and_what_touches_them_is_not() {
        for (text, expected) in [
            ("reference constant 13999", true),
            ("reference constant 14001", false),
            ("reference constant -1000", true),
            ("reference constant -1001", false),
            ("reference sine 1000 7000 6000", true),
            ("reference sine 1000 7000 7000", false),
            ("reference sine 1000 7001 6000", false),
            ("reference sine 1000 -7001 6000", false),
            ("reference step 13999 0 100", true),
            ("reference step 14001 0 100", false),
            ("reference step -1001 0 100", false),
            ("play sine 0 0 80000 400", true),
            ("play sine 0 0 80001 400", false),
            ("play sine 1000 33333 33333 400", true),
            ("play sine 1000 500 499 400", false),
            ("play sine 1000 20001 60000 400", false),
            ("play chirp 1000 9000 40000 40000 400", true),
            ("play chirp 1000 9000 40000 40001 400", false),
            ("play sine 0 511000 511000 4", false),
            ("reference sine 0 127000 127000", false),
            ("enable", true),
        ] {
            assert_eq!(fits(text), expected, "{text}");
        }
    }

    /// To the last place behind what rounding may bring, below and above.
    #[test]
    fn every_waveform_reaches_as_far_as_it_goes() {
        let raw = Micrometres::from_bits;
        let tone = |amplitude: i32| (7, raw(amplitude), 0);
        for (waveform, below, above) in [
            (Waveform::Constant, 0, 0),
            (
                Waveform::Multisine {
                    tones: [tone(100), tone(-30), tone(5), tone(0)],
                },
                135,
                135,
            ),
            (
                Waveform::RoundedTriangle {
                    increment: 7,
                    amplitude: raw(-40),
                },
                40,
                40,
            ),
            (
                Waveform::Chirp {
                    increment: 7,
                    change: 1,
                    amplitude: raw(60),
                    duration_ticks: 9,
                },
                60,
                60,
            ),
            (
                Waveform::QuasiStep {
                    height: raw(80),
                    delay_ticks: 1,
                    duration_ticks: 9,
                },
                0,
                80,
            ),
            (
                Waveform::QuasiStep {
                    height: raw(-80),
                    delay_ticks: 1,
                    duration_ticks: 9,
                },
                80,
                0,
            ),
        ] {
            let fits = |offset: i32| is_within(&waveform, raw(offset), (raw(-1000), raw(2000)));
            let (lowest, highest) = (-1000 + below, 2000 - above);
            for (offset, expected) in [
                (lowest - 3, false),
                (lowest - 2, true),
                (highest + 2, true),
                (highest + 3, false),
            ] {
                assert_eq!(fits(offset), expected, "{waveform:?} at {offset}");
            }
        }
    }

    #[test]
    fn a_zero_that_was_found_moves_the_limits_of_positions() {
        let mut parameters = example();
        parameters.servo.converters.adc_zero = 0;
        let positions = |parameters: &AmplifierParameters| {
            positions(&parameters.servo.converters, &parameters.guard)
        };
        let (lowest, highest) = positions(&parameters);
        parameters.servo.converters.adc_zero = -(3 << 24);
        assert_eq!(
            positions(&parameters),
            (
                lowest - Micrometres::from_num(3),
                highest - Micrometres::from_num(3)
            )
        );
    }
}
