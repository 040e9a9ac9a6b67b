//! Commands as lines of text, in whole numbers of small units, so that a person with a probe can type them.
//!
//! ```text
//! enable | disable | clear | status
//! arm                                          at rest: switches the amplifier on, and a step of 1.5 V shows
//!                                              that the sensor follows; nothing moves before
//! arm untested                                 the same without the step, by somebody who knows the stage
//! disarm                                       to rest, and switches the amplifier off there
//! stop                                         as disable; so does the byte 0x18 (Ctrl-X) anywhere. None of
//!                                              these three waits for anything
//! condition                                    one 10 Hz cycle over the range, 1 s of rest, zero the sensor
//! conditioning required|waived                 whether `enable` insists on a conditioning since the start or
//!                                              the last fault, as it does after a start
//! timeout MILLISECONDS                         no line for so long while the drive is live is a fault,
//!                                              "host lost"; 10 to 3600000, 0 for never
//! resonance MILLIHERTZ ALARM_NM                the line that the telemetry of the closed loop listens to,
//!                                              and its alarm; 0 for none of either
//! update older                                 until a restart: an image of a lower version than the running
//!                                              one's may come over the line
//! protect                                      at rest: brown-out level and watchdog into the option bytes;
//!                                              a restart of the supply takes them
//! reference constant NM
//! reference sine MILLIHERTZ NM OFFSET_NM
//! reference step NM DELAY_TICKS DURATION_TICKS
//! travel NM NM_PER_S                           a stick-slip drive goes to a position, at a velocity or, with
//!                                              0, as fast as its teeth are
//! play sine MILLIHERTZ MV OFFSET_MV TICKS      open loop
//! play chirp MILLIHERTZ MILLIHERTZ MV OFFSET_MV TICKS
//! identify TICKS                               open loop: tones over the whole range and a small sweep,
//!                                              traced at the full rate, for an identification
//! trace CHANNELS DECIMATION                    channels: sum of 1 codes, 2 reference, 4 applied,
//!                                              8 unknown input, 16 flags
//! capture now|fault|closed BEFORE AFTER        every tick around an event into RAM, from BEFORE ticks before
//!                                              it to AFTER ticks after it
//! capture send | capture off                   read it out | forget it
//! block begin BYTES                            a new parameter block follows
//! block data OFFSET HEX                        up to 32 bytes of it
//! block commit                                 verify it and keep it in flash, beside the last good one
//! block swap                                   verify it and let it take the place of the running block,
//!                                              without a step of the drive, in memory only
//! block envelope CHECKSUM                      what came is the safety envelope with this checksum
//!                                              (8 digits, hexadecimal): verify and keep it; only disarmed,
//!                                              at rest
//! restart                                      with the newest valid block
//! ```
//!
//! `@TICK` in front of a command lets it act at that tick exactly; a tick that has passed means now. A
//! command that waits holds up no other one ([`crate::command_schedule`]); a stop or a fault forgets it.

use core::fmt::{self, Write};

use crate::amplifier_command::Command;
use crate::loop_telemetry::{EXPECTED_RESONANCE, ResonanceWatch};
use crate::reference_generator::Waveform;
use crate::signal::{
    MICROMETRE_FRACTION_BITS, Micrometres, Quantity, TRAVEL_FRACTION_BITS, Travel,
    VOLT_FRACTION_BITS, Volts,
};
use crate::trace_frame::Channels;

const EXPECTED_TIMEOUT: &str = "expected a timeout of 10 to 3600000 milliseconds, or 0 for none";

/// A line, understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// For the control interrupt, at a tick or (`None`) as soon as possible.
    Control(Option<u32>, Command),
    /// What the trace carries.
    Trace(Channels, u16),
    /// Report the state.
    Status,
    /// So many ticks without a line are a fault; 0: no time is.
    HostTimeout(u32),
    /// Listen to a resonance.
    Resonance(ResonanceWatch),
    /// Write the option bytes that protect.
    Protect,
    /// Let an image of a lower version come.
    UpdateOlder,
    /// Gather every tick around an event.
    Capture(Trigger, u32, u32),
    /// Read the capture out.
    CaptureSend,
    /// Forget the capture.
    CaptureOff,
    /// Plays the drive for an identification, for so many ticks.
    Identify(u32),
    /// A parameter block of so many bytes follows.
    BlockBegin(u32),
    /// Bytes of it.
    BlockData(BlockPiece),
    /// It is complete.
    BlockCommit,
    /// It is complete and takes the place of the running one.
    BlockSwap,
    /// It is a safety envelope with this checksum; keep it.
    BlockEnvelope(u32),
    /// Start again.
    Restart,
}

/// The event around which a capture is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// The command itself.
    Now,
    /// A fault.
    Fault,
    /// The loop is closed.
    Closed,
}

/// Most bytes of a block in one line.
pub const PIECE_BYTES: usize = 32;

/// A piece of a parameter block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockPiece {
    offset: u32,
    bytes: [u8; PIECE_BYTES],
    count: usize,
}

impl BlockPiece {
    /// Where it belongs.
    #[must_use]
    pub fn offset(&self) -> usize {
        self.offset as usize
    }

    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.count).unwrap_or(&[])
    }

    /// Up to [`PIECE_BYTES`] bytes in hexadecimal that belong at an offset.
    ///
    /// # Errors
    /// What was expected instead.
    pub fn parse(offset: u32, text: &str) -> Result<Self, &'static str> {
        const EXPECTED: &str = "expected up to 32 bytes in hexadecimal";
        let mut piece = Self {
            offset,
            bytes: [0; PIECE_BYTES],
            count: text.len() / 2,
        };
        if piece.count == 0 || piece.count > PIECE_BYTES || !text.len().is_multiple_of(2) {
            return Err(EXPECTED);
        }
        for (byte, digits) in piece.bytes.iter_mut().zip(text.as_bytes().chunks_exact(2)) {
            let digits = core::str::from_utf8(digits).map_err(|_| EXPECTED)?;
            *byte = u8::from_str_radix(digits, 16).map_err(|_| EXPECTED)?;
        }
        Ok(piece)
    }
}

/// Writes the lines that bring a parameter block to the target.
///
/// # Errors
/// Those of the writer.
pub fn write_upload(block: &[u8], to: &mut impl Write) -> fmt::Result {
    writeln!(to, "block begin {}", block.len())?;
    for (nth, piece) in block.chunks(PIECE_BYTES).enumerate() {
        write!(to, "block data {} ", nth * PIECE_BYTES)?;
        for byte in piece {
            write!(to, "{byte:02x}")?;
        }
        writeln!(to)?;
    }
    writeln!(to, "block commit")
}

/// `SAMPLE_RATE_HZ / 10`: a conditioning cycle of 10 Hz.
const CONDITIONING_HZ: u32 = 10;

fn sine<Q: Quantity>(increment: u32, amplitude: Q) -> Waveform<Q> {
    let none = (0, Q::of_bits(0), 0);
    Waveform::Multisine {
        tones: [(increment, amplitude, 0), none, none, none],
    }
}

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
        u32::try_from((millihertz << 32) / (1000 * u64::from(sample_rate_hz.max(1))))
            .map_err(|_| "a frequency is above the sampling rate")
    };
    let scaled = |value: i32, fraction_bits: u32| -> Result<i32, &'static str> {
        i32::try_from((i64::from(value) << fraction_bits) / 1000)
            .map_err(|_| "an amplitude or offset is too large")
    };
    let micrometres =
        |nanometres: i32| scaled(nanometres, MICROMETRE_FRACTION_BITS).map(Micrometres::from_bits);
    let volts = |millivolts: i32| scaled(millivolts, VOLT_FRACTION_BITS).map(Volts::from_bits);
    let ticks = |value: i32| u32::try_from(value).map_err(|_| "a duration is negative");

    let mut verbs = words.clone();
    let command = match (verbs.next(), verbs.next()) {
        (Some("enable"), None) => Command::Enable,
        (Some("disable" | "stop"), None) => Command::Disable,
        (Some("clear"), None) => Command::Clear,
        (Some("arm"), None) => Command::Arm { tested: true },
        (Some("arm"), Some("untested")) => Command::Arm { tested: false },
        (Some("disarm"), None) => Command::Disarm,
        (Some("status"), None) => return Ok(Line::Status),
        (Some("conditioning"), Some("required")) => Command::RequireConditioning(true),
        (Some("conditioning"), Some("waived")) => Command::RequireConditioning(false),
        (Some("timeout"), Some(_)) => {
            let milliseconds = u32::try_from(number()?).map_err(|_| EXPECTED_TIMEOUT)?;
            return crate::host_watch::timeout_ticks(milliseconds, sample_rate_hz)
                .map(Line::HostTimeout)
                .ok_or(EXPECTED_TIMEOUT);
        }
        (Some("resonance"), Some(_)) => {
            let frequency_millihertz = u32::try_from(number()?).map_err(|_| EXPECTED_RESONANCE)?;
            let alarm_pm =
                u32::try_from(i64::from(number()?) * 1000).map_err(|_| EXPECTED_RESONANCE)?;
            let watch = ResonanceWatch {
                frequency_millihertz,
                alarm_pm,
            };
            return if watch.accepted(sample_rate_hz) {
                Ok(Line::Resonance(watch))
            } else {
                Err(EXPECTED_RESONANCE)
            };
        }
        (Some("protect"), None) => return Ok(Line::Protect),
        (Some("update"), Some("older")) => return Ok(Line::UpdateOlder),
        (Some("condition"), None) => Command::Condition {
            cycle_ticks: sample_rate_hz / CONDITIONING_HZ,
            rest_ticks: sample_rate_hz,
        },
        (Some("reference"), Some("constant")) => Command::Reference {
            waveform: Waveform::Constant,
            offset: micrometres(number()?)?,
        },
        (Some("reference"), Some("sine")) => {
            let waveform = sine(increment(number()?)?, micrometres(number()?)?);
            Command::Reference {
                waveform,
                offset: micrometres(number()?)?,
            }
        }
        (Some("reference"), Some("step")) => {
            let (height, delay_ticks, duration_ticks) = (
                micrometres(number()?)?,
                ticks(number()?)?,
                ticks(number()?)?,
            );
            Command::Reference {
                waveform: Waveform::QuasiStep {
                    height,
                    delay_ticks,
                    duration_ticks,
                },
                offset: Micrometres::from_bits(0),
            }
        }
        (Some("travel"), Some(_)) => {
            let target = Travel::from_bits(scaled(number()?, TRAVEL_FRACTION_BITS)?);
            let a_tick = i64::from(number()?) << MICROMETRE_FRACTION_BITS;
            let a_tick = a_tick / (1000 * i64::from(sample_rate_hz.max(1)));
            Command::MoveTo {
                target,
                velocity: i32::try_from(a_tick)
                    .map(Micrometres::from_bits)
                    .map_err(|_| "a velocity is too large")?,
            }
        }
        (Some("play"), Some("sine")) => {
            let waveform = sine(increment(number()?)?, volts(number()?)?);
            Command::Play {
                waveform,
                offset: volts(number()?)?,
                ticks: ticks(number()?)?,
            }
        }
        (Some("play"), Some("chirp")) => {
            let (first, last) = (increment(number()?)?, increment(number()?)?);
            let (amplitude, offset, duration_ticks) =
                (volts(number()?)?, volts(number()?)?, ticks(number()?)?);
            let change =
                ((i64::from(last) - i64::from(first)) << 8) / i64::from(duration_ticks.max(1));
            let change = i32::try_from(change).map_err(|_| "the frequency changes too fast")?;
            Command::Play {
                waveform: Waveform::Chirp {
                    increment: first,
                    change,
                    amplitude,
                    duration_ticks,
                },
                offset,
                ticks: duration_ticks,
            }
        }
        (Some("trace"), Some(_)) => {
            let channels =
                u8::try_from(number()?).map_err(|_| "channels are a sum of 1, 2, 4, 8, 16")?;
            return Ok(Line::Trace(
                Channels(channels),
                u16::try_from(number()?).map_err(|_| "expected a decimation of at least 1")?,
            ));
        }
        (Some("identify"), Some(_)) => return Ok(Line::Identify(ticks(number()?)?)),
        (Some("capture"), Some("send")) => return Ok(Line::CaptureSend),
        (Some("capture"), Some("off")) => return Ok(Line::CaptureOff),
        (Some("capture"), Some(trigger)) => {
            let trigger = match trigger {
                "now" => Trigger::Now,
                "fault" => Trigger::Fault,
                "closed" => Trigger::Closed,
                _ => return Err("expected capture now, fault, closed, send or off"),
            };
            return Ok(Line::Capture(trigger, ticks(number()?)?, ticks(number()?)?));
        }
        (Some("block"), Some("begin")) => {
            return Ok(Line::BlockBegin(
                ticks(number()?).map_err(|_| "a length is negative")?,
            ));
        }
        (Some("block"), Some("data")) => {
            let hexadecimal = verbs.nth(1).ok_or("the bytes are missing")?;
            let offset = u32::try_from(number()?).map_err(|_| "an offset is negative")?;
            return Ok(Line::BlockData(BlockPiece::parse(offset, hexadecimal)?));
        }
        (Some("block"), Some("commit")) => return Ok(Line::BlockCommit),
        (Some("block"), Some("envelope")) => {
            const EXPECTED: &str = "expected the envelope's checksum, 8 hexadecimal digits";
            let digits = verbs
                .next()
                .filter(|digits| digits.len() == 8)
                .ok_or(EXPECTED)?;
            return u32::from_str_radix(digits, 16)
                .map(Line::BlockEnvelope)
                .map_err(|_| EXPECTED);
        }
        (Some("block"), Some("swap")) => return Ok(Line::BlockSwap),
        (Some("restart"), None) => return Ok(Line::Restart),
        _ => {
            return Err(
                "expected enable, disable, clear, status, condition, conditioning, timeout, resonance, protect, reference, play, identify, trace, capture, block or restart",
            );
        }
    };
    Ok(Line::Control(at, command))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::String;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn what_is_typed_is_understood() {
        assert_eq!(
            parse("enable", 20_000),
            Ok(Line::Control(None, Command::Enable))
        );
        assert_eq!(
            parse(" @500  disable ", 20_000),
            Ok(Line::Control(Some(500), Command::Disable))
        );
        assert_eq!(
            parse("reference constant -2500", 20_000),
            Ok(Line::Control(
                None,
                Command::Reference {
                    waveform: Waveform::Constant,
                    offset: Micrometres::from_num(-2.5)
                }
            ))
        );
        let Ok(Line::Control(
            None,
            Command::Reference {
                waveform: Waveform::Multisine { tones },
                offset,
            },
        )) = parse("reference sine 100000 5000 5600", 20_000)
        else {
            panic!()
        };
        assert_eq!(
            (tones[0], offset),
            (
                (21_474_836, Micrometres::from_num(5), 0),
                Micrometres::from_bits(93_952_409)
            )
        );
        assert_eq!(
            parse("trace 31 1", 20_000),
            Ok(Line::Trace(Channels::ALL, 1))
        );
        assert_eq!(parse("timeout 250", 20_000), Ok(Line::HostTimeout(5000)));
        assert_eq!(parse("timeout 0", 20_000), Ok(Line::HostTimeout(0)));
        let watch = ResonanceWatch {
            frequency_millihertz: 735_000,
            alarm_pm: 20_000,
        };
        assert_eq!(
            parse("resonance 735000 20", 20_000),
            Ok(Line::Resonance(watch))
        );
        assert_eq!(
            parse("resonance 0 0", 20_000),
            Ok(Line::Resonance(ResonanceWatch::default()))
        );
        assert_eq!(
            parse("conditioning waived", 20_000),
            Ok(Line::Control(None, Command::RequireConditioning(false)))
        );
        assert_eq!(parse("protect", 20_000), Ok(Line::Protect));
        assert_eq!(parse("update older", 20_000), Ok(Line::UpdateOlder));
        assert_eq!(
            parse("condition", 20_000),
            Ok(Line::Control(
                None,
                Command::Condition {
                    cycle_ticks: 2000,
                    rest_ticks: 20_000
                }
            ))
        );
    }

    /// Each command with its numbers, as the manual at the top of this file has them.
    #[test]
    fn every_command_has_its_words_and_numbers() {
        let control = |command| Ok(Line::Control(None, command));
        let increment = |hz: f64| (hz / 20_000.0 * 2f64.powi(32)) as u32;
        let none = (0, Volts::from_bits(0), 0);
        for (line, expected) in [
            ("stop", control(Command::Disable)),
            ("clear", control(Command::Clear)),
            ("arm", control(Command::Arm { tested: true })),
            ("arm untested", control(Command::Arm { tested: false })),
            ("disarm", control(Command::Disarm)),
            ("status", Ok(Line::Status)),
            (
                "conditioning required",
                control(Command::RequireConditioning(true)),
            ),
            (
                "reference step -500 7 9",
                control(Command::Reference {
                    waveform: Waveform::QuasiStep {
                        height: Micrometres::from_num(-0.5),
                        delay_ticks: 7,
                        duration_ticks: 9,
                    },
                    offset: Micrometres::from_bits(0),
                }),
            ),
            (
                "play sine 50000 10000 40000 800",
                control(Command::Play {
                    waveform: Waveform::Multisine {
                        tones: [(increment(50.0), Volts::from_num(10), 0), none, none, none],
                    },
                    offset: Volts::from_num(40),
                    ticks: 800,
                }),
            ),
            (
                "play chirp 0 10000000 2000 40000 1000",
                control(Command::Play {
                    waveform: Waveform::Chirp {
                        increment: 0,
                        // Half of 2^32 in 1000 ticks, with 8 fraction bits.
                        change: ((1i64 << 39) / 1000) as i32,
                        amplitude: Volts::from_num(2),
                        duration_ticks: 1000,
                    },
                    offset: Volts::from_num(40),
                    ticks: 1000,
                }),
            ),
            ("capture now 1 2", Ok(Line::Capture(Trigger::Now, 1, 2))),
            (
                "capture closed 1 2",
                Ok(Line::Capture(Trigger::Closed, 1, 2)),
            ),
            ("capture send", Ok(Line::CaptureSend)),
            ("capture off", Ok(Line::CaptureOff)),
            ("restart", Ok(Line::Restart)),
        ] {
            assert_eq!(parse(line, 20_000), expected, "{line}");
        }
        let whole = "5a".repeat(PIECE_BYTES);
        let piece = BlockPiece::parse(64, &whole).expect("32 bytes");
        assert_eq!((piece.offset(), piece.bytes()), (64, &[0x5a; 32][..]));
        for text in ["", "5", "5a5", &"5a".repeat(PIECE_BYTES + 1)] {
            assert!(BlockPiece::parse(0, text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_block_is_brought_line_by_line() {
        let block: Vec<u8> = (0..100u8).collect();
        let mut text = String::new();
        write_upload(&block, &mut text).expect("written");
        let mut received = vec![0; 100];
        let mut lines = text.lines();
        assert_eq!(
            lines.next().map(|line| parse(line, 20_000)),
            Some(Ok(Line::BlockBegin(100)))
        );
        for line in lines {
            assert!(line.len() < 96);
            match parse(line, 20_000) {
                Ok(Line::BlockData(piece)) => {
                    received[piece.offset()..piece.offset() + piece.bytes().len()]
                        .copy_from_slice(piece.bytes());
                }
                other => assert_eq!(other, Ok(Line::BlockCommit)),
            }
        }
        assert_eq!(received, block);
        assert_eq!(
            parse("capture fault 100 200", 20_000),
            Ok(Line::Capture(Trigger::Fault, 100, 200))
        );
        assert_eq!(parse("block swap", 20_000), Ok(Line::BlockSwap));
        assert_eq!(
            parse("block envelope 0012abcd", 20_000),
            Ok(Line::BlockEnvelope(0x12_abcd))
        );
        assert!(
            parse("block envelope 12", 20_000).is_err() && parse("block envelope", 20_000).is_err()
        );
        assert_eq!(parse("identify 40000", 20_000), Ok(Line::Identify(40_000)));
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
            "block data 0",
            "block data 0 0g",
            "block data 0 012",
            "block data -1 00",
            "capture later 1 2",
            "capture now 1",
            "timeout",
            "timeout 9",
            "timeout -1",
            "timeout 3600001",
            "resonance",
            "resonance 735000",
            "resonance -1 0",
            "resonance 79999 0",
            "resonance 735000 -1",
            "resonance 735000 2147483647",
            "conditioning",
            "conditioning off",
            "play chirp 0 10000000 2000 40000 0",
            "play chirp 0 9000000 2000 40000 1",
            "reference sine 20000000 1 1",
            "reference sine -1 1 1",
            "reference constant 200000",
            "play sine 1 600000 0 4",
            "block begin -1",
            "block envelope 0012abcg",
        ] {
            assert!(parse(line, 20_000).is_err(), "{line}");
        }
    }
}
