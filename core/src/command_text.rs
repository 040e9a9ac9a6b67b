//! Commands as lines of text, in whole numbers of small units, so that a person with a probe can type them.
//!
//! ```text
//! enable | disable | clear | status
//! condition                                    one 10 Hz cycle over the range, 1 s of rest, zero the sensor
//! reference constant NM
//! reference sine MILLIHERTZ NM OFFSET_NM
//! reference step NM DELAY_TICKS DURATION_TICKS
//! play sine MILLIHERTZ MV OFFSET_MV TICKS      open loop
//! play chirp MILLIHERTZ MILLIHERTZ MV OFFSET_MV TICKS
//! trace CHANNELS DECIMATION                    channels: sum of 1 codes, 2 reference, 4 applied, 8 unknown input, 16 flags
//! ```
//!
//! `@TICK` in front of a command lets it act at that tick exactly; a tick that has passed means now.

use crate::amplifier::Command;
use crate::reference_generator::Waveform;
use crate::trace_frame::Channels;

/// A line, understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// For the control interrupt, at a tick or (`None`) as soon as possible.
    Control(Option<u32>, Command),
    /// What the trace carries.
    Trace(Channels, u16),
    /// Report the state.
    Status,
}

/// `SAMPLE_RATE_HZ / 10`: a conditioning cycle of 10 Hz.
const CONDITIONING_HZ: u32 = 10;

/// Understands a line for a target with this sampling rate.
///
/// # Errors
/// What was expected instead.
pub fn parse(line: &str, sample_rate_hz: u32) -> Result<Line, &'static str> {
    let mut words = line.split_ascii_whitespace().peekable();
    let at = match words.peek().and_then(|word| word.strip_prefix('@')) {
        Some(tick) => {
            words.next();
            Some(tick.parse().map_err(|_| "expected a tick after @")?)
        }
        None => None,
    };
    let mut number = {
        let mut rest = words.clone();
        rest.next();
        move || -> Result<i32, &'static str> {
            loop {
                let word = rest.next().ok_or("a number is missing")?;
                if let Ok(value) = word.parse() {
                    return Ok(value);
                }
                if !word.bytes().all(|byte| byte.is_ascii_lowercase()) {
                    return Err("expected a whole number");
                }
            }
        }
    };
    let increment = |millihertz: i32| -> Result<u32, &'static str> {
        let millihertz = u64::try_from(millihertz).map_err(|_| "a frequency is negative")?;
        u32::try_from((millihertz << 32) / (1000 * u64::from(sample_rate_hz.max(1)))).map_err(|_| "a frequency is above the sampling rate")
    };
    // Thousandths to a format with 24 fraction bits.
    let thousandths = |value: i32| -> Result<i32, &'static str> {
        i32::try_from((i64::from(value) << 24) / 1000).map_err(|_| "an amplitude or offset is too large")
    };
    let ticks = |value: i32| u32::try_from(value).map_err(|_| "a duration is negative");
    let sine = |increment: u32, amplitude: i32| Waveform::Multisine { tones: [(increment, amplitude, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)] };

    let mut verbs = words.clone();
    let command = match (verbs.next(), verbs.next()) {
        (Some("enable"), None) => Command::Enable,
        (Some("disable"), None) => Command::Disable,
        (Some("clear"), None) => Command::Clear,
        (Some("status"), None) => return Ok(Line::Status),
        (Some("condition"), None) => Command::Condition { cycle_ticks: sample_rate_hz / CONDITIONING_HZ, rest_ticks: sample_rate_hz },
        (Some("reference"), Some("constant")) => Command::Reference { waveform: Waveform::Constant, offset: thousandths(number()?)? },
        (Some("reference"), Some("sine")) => {
            let waveform = sine(increment(number()?)?, thousandths(number()?)?);
            Command::Reference { waveform, offset: thousandths(number()?)? }
        }
        (Some("reference"), Some("step")) => {
            let (height, delay_ticks, duration_ticks) = (thousandths(number()?)?, ticks(number()?)?, ticks(number()?)?);
            Command::Reference { waveform: Waveform::QuasiStep { height, delay_ticks, duration_ticks }, offset: 0 }
        }
        (Some("play"), Some("sine")) => {
            let waveform = sine(increment(number()?)?, thousandths(number()?)?);
            Command::Play { waveform, offset: thousandths(number()?)?, ticks: ticks(number()?)? }
        }
        (Some("play"), Some("chirp")) => {
            let (first, last) = (increment(number()?)?, increment(number()?)?);
            let (amplitude, offset, duration_ticks) = (thousandths(number()?)?, thousandths(number()?)?, ticks(number()?)?);
            let change = ((i64::from(last) - i64::from(first)) << 8) / i64::from(duration_ticks.max(1));
            let change = i32::try_from(change).map_err(|_| "the frequency changes too fast")?;
            Command::Play {
                waveform: Waveform::Chirp { increment: first, change, amplitude, duration_ticks },
                offset,
                ticks: duration_ticks,
            }
        }
        (Some("trace"), Some(_)) => {
            let channels = u8::try_from(number()?).map_err(|_| "channels are a sum of 1, 2, 4, 8, 16")?;
            return Ok(Line::Trace(Channels(channels), u16::try_from(number()?).map_err(|_| "expected a decimation of at least 1")?));
        }
        _ => return Err("expected enable, disable, clear, status, condition, reference, play or trace"),
    };
    Ok(Line::Control(at, command))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_is_understood() {
        assert_eq!(parse("enable", 20_000), Ok(Line::Control(None, Command::Enable)));
        assert_eq!(parse(" @500  disable ", 20_000), Ok(Line::Control(Some(500), Command::Disable)));
        assert_eq!(
            parse("reference constant -2500", 20_000),
            Ok(Line::Control(None, Command::Reference { waveform: Waveform::Constant, offset: -(5 << 23) }))
        );
        let Ok(Line::Control(None, Command::Reference { waveform: Waveform::Multisine { tones }, offset })) =
            parse("reference sine 100000 5000 5600", 20_000)
        else {
            panic!()
        };
        assert_eq!((tones[0], offset), ((21_474_836, 5 << 24, 0), 93_952_409));
        assert_eq!(parse("trace 31 1", 20_000), Ok(Line::Trace(Channels::ALL, 1)));
        assert_eq!(parse("condition", 20_000), Ok(Line::Control(None, Command::Condition { cycle_ticks: 2000, rest_ticks: 20_000 })));
    }

    #[test]
    fn what_is_not_understood_is_said() {
        for line in [
            "",
            "enabel",
            "reference",
            "reference sine",
            "reference sine 1 2",
            "reference sine x1 2 3",
            "@x enable",
            "play sine 1 2 3 -4",
            "trace 999 1",
        ] {
            assert!(parse(line, 20_000).is_err(), "{line}");
        }
    }
}
