//! Waves that the board plays, and what its recorder saw of them.
//!
//! # How it works
//! The points go to wave table 1 and the generator starts the recorder, which begins a tick behind it: a
//! drive that is held for as many ticks as lie between two samples does not change between them. What is read
//! are codes, in lines with a checksum (`hysteron_protocol::code_lines`); a line that the cable garbled is
//! asked for again.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hysteron_core::checksum::crc32;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::trace_frame::{self, CODE_BYTES};
use hysteron_protocol::code_lines::SAMPLES_IN_LINE;

use crate::board::{BETWEEN_QUESTIONS, Board};
use crate::error::{Error, Result};
use crate::fault::fault_name;
use crate::scale::Scale;

/// Points in a line: with their signs and decimals they fit into the board's longest.
const POINTS_IN_LINE: usize = 32;
/// Lines of codes that are asked for at once.
const LINES_AT_ONCE: usize = 20;
/// Times that a garbled line is asked for.
const MOST_REPEATS: usize = 5;

/// What has its turn between the questions of a reading.
pub type Between<'a> = &'a mut dyn FnMut(&mut Board) -> Result<()>;

/// A wave: V with the servo off, um with the servo on.
#[derive(Clone, Debug, PartialEq)]
pub struct Wave {
    /// Points of a cycle.
    pub points: Vec<f64>,
    /// Ticks for which each is held.
    pub ticks_per_point: u32,
    /// Cycles.
    pub cycles: u32,
}

/// What the recorder saw: element `k` of the drive acts from the instant of position `k` on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    /// Samples per second, Hz.
    pub sample_rate_hz: f64,
    /// Drive, V.
    pub drive_v: Vec<f64>,
    /// Position as the sensor reads it, um.
    pub position_um: Vec<f64>,
    /// The sensor's codes.
    pub sensor_codes: Vec<SensorCode>,
}

/// Plays a wave and records it, a sample for every point.
///
/// # Errors
/// The board has no room for it or refuses it, a fault ended it, or the recorder was stopped.
pub fn play(board: &mut Board, scale: &Scale, wave: &Wave) -> Result<Recorded> {
    let samples = wave.points.len() * wave.cycles as usize;
    let (most_points, most_samples) = (scale.most_points, scale.most_samples);
    if wave.points.is_empty() || wave.points.len() > most_points || samples > most_samples {
        let problem = format!(
            "{} points, {samples} in all; this board has room for 1 to {most_points}, and records {most_samples} in all",
            wave.points.len()
        );
        return Err(Error::new("wave", problem));
    }
    board.tell_all(&lines_of(&wave.points))?;
    let ticks = wave.ticks_per_point;
    board.tell_all(&[
        "WSL 1 1".to_string(),
        format!("WGC 1 {}", wave.cycles),
        format!("WTR 1 {ticks} 0"),
        format!("RTR {ticks}"),
        "DRT 0 0 0".to_string(),
        "WGO 1 1".to_string(),
    ])?;
    board.wait("WGO? 1", |answer| Ok(answer == "1=0"))?;
    fault_of(board)?;
    let recorded = read(board, scale, ticks, samples, &mut |_| Ok(()))?;
    // With the servo on the points are positions.
    let open = recorded.drive_v.len() == samples && board.number("SVO? 1")? == 0.0;
    let step_v = scale.drive_step_v();
    let points = wave.points.iter().cycle();
    if let Some((drive_v, point)) = recorded
        .drive_v
        .iter()
        .zip(points)
        .find(|(drive_v, point)| open && (**drive_v - **point).abs() > 1.5 * step_v)
    {
        let problem = format!(
            "the drive was {drive_v:.3} V where {point:.3} V were to be held: the slew limit of the block is too low for it"
        );
        return Err(Error::new("wave", problem));
    }
    Ok(recorded)
}

/// Records so many samples, one every so many ticks, of whatever goes on.
///
/// # Errors
/// More than there is room for; or the recorder was stopped.
pub fn listen(
    board: &mut Board,
    scale: &Scale,
    ticks_per_sample: u32,
    samples: usize,
) -> Result<Recorded> {
    listen_with(board, scale, ticks_per_sample, samples, &mut |_| Ok(()))
}

/// As [`listen`]; `between` has its turn between the questions.
///
/// # Errors
/// As [`listen`], or what `between` ends it with.
pub fn listen_with(
    board: &mut Board,
    scale: &Scale,
    ticks_per_sample: u32,
    samples: usize,
    between: Between,
) -> Result<Recorded> {
    if samples == 0 || samples > scale.most_samples {
        return Err(Error::new(
            "recording",
            format!(
                "{samples} samples; this board has room for 1 to {}",
                scale.most_samples
            ),
        ));
    }
    board.tell_all(&[
        format!("RTR {ticks_per_sample}"),
        "DRT 0 4 0".to_string(),
        "DRT 0 0 0".to_string(),
    ])?;
    read(board, scale, ticks_per_sample, samples, between)
}

fn fault_of(board: &mut Board) -> Result<()> {
    if board.number("DIA? 1")? == 3.0 {
        return Err(Error::new(
            "board",
            format!(
                "a fault has ended it: {}",
                fault_name(board.number("DIA? 2")?)
            ),
        ));
    }
    Ok(())
}

fn lines_of(points: &[f64]) -> Vec<String> {
    let bunches = points.chunks(POINTS_IN_LINE).enumerate();
    bunches
        .map(|(nth, bunch)| {
            let values: Vec<String> = bunch.iter().map(|point| format!("{point:.6}")).collect();
            let place = if nth == 0 { "X" } else { "&" };
            format!(
                "WAV 1 {place} PNT {} {} {}",
                nth * POINTS_IN_LINE + 1,
                bunch.len(),
                values.join(" ")
            )
        })
        .collect()
}

/// Waits for the samples and reads them.
fn read(
    board: &mut Board,
    scale: &Scale,
    ticks_per_sample: u32,
    samples: usize,
    between: Between,
) -> Result<Recorded> {
    // An answer that the line garbled is asked for again.
    while board
        .ask("DRL? 1")?
        .trim()
        .strip_prefix("1=")
        .and_then(|count| count.parse().ok())
        .is_none_or(|count: usize| count < samples)
    {
        between(board)?;
        std::thread::sleep(BETWEEN_QUESTIONS);
    }
    let mut codes = Vec::with_capacity(samples);
    let mut repeats = 0;
    while codes.len() < samples {
        let count = (samples - codes.len()).min(LINES_AT_ONCE * SAMPLES_IN_LINE as usize);
        let answer = board.ask(&format!("DRB? {} {count}", codes.len() + 1))?;
        let whole: Vec<(SensorCode, DriveCode)> =
            answer.lines().map_while(codes_of).flatten().collect();
        if whole.len() < count {
            repeats += 1;
            if repeats > MOST_REPEATS {
                return Err(Error::new(
                    "DRB?",
                    "the line garbles what the board sends; try a lower speed",
                ));
            }
        }
        codes.extend(whole);
        between(board)?;
    }
    codes.truncate(samples);
    let sensor_codes: Vec<SensorCode> = codes.iter().map(|(adc, _)| *adc).collect();
    let mut recorded = Recorded {
        sample_rate_hz: scale.sample_rate_hz / f64::from(ticks_per_sample.max(1)),
        drive_v: codes.iter().map(|(_, dac)| scale.drive_v(*dac)).collect(),
        position_um: sensor_codes
            .iter()
            .map(|code| scale.position_um(*code))
            .collect(),
        sensor_codes,
    };
    if ticks_per_sample == 1 {
        // A tick's code acts from the next tick on.
        recorded.drive_v.pop();
        recorded.position_um.remove(0);
        recorded.sensor_codes.remove(0);
    }
    Ok(recorded)
}

/// The samples of a line, if it came as it was sent.
fn codes_of(line: &str) -> Option<Vec<(SensorCode, DriveCode)>> {
    let bytes = STANDARD.decode(line.trim()).ok()?;
    let (samples, checksum) = bytes.split_last_chunk::<4>()?;
    if crc32(samples) != u32::from_le_bytes(*checksum) {
        return None;
    }
    samples
        .chunks(CODE_BYTES)
        .map(|five| five.try_into().ok().map(trace_frame::codes_of))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_core::trace_frame::TraceSample;
    use hysteron_protocol::code_lines::write_line;

    #[test]
    fn a_line_of_codes_comes_back_and_a_garbled_one_is_found() {
        let samples = (0..72).map(|nth| TraceSample {
            adc_code: SensorCode::new(nth * 14_001),
            dac_code: DriveCode::new(1_048_575 - nth),
            ..TraceSample::default()
        });
        for count in [1, 2, 3, 71, 72] {
            let mut piece = hysteron_protocol::session::Piece::new();
            write_line(samples.clone().take(count), &mut piece).expect("room");
            let text = String::from_utf8(piece.to_vec()).expect("text");
            let expected: Vec<(SensorCode, DriveCode)> = samples
                .clone()
                .take(count)
                .map(|s| (s.adc_code, s.dac_code))
                .collect();
            assert_eq!(codes_of(&text), Some(expected));
            for at in 0..text.len() {
                let mut garbled = text.clone().into_bytes();
                garbled[at] = if garbled[at] == b'A' { b'B' } else { b'A' };
                assert_eq!(
                    codes_of(&String::from_utf8(garbled).expect("text")),
                    None,
                    "{at}"
                );
            }
        }
    }

    #[test]
    fn points_go_in_lines_that_the_board_takes() {
        let points: Vec<f64> = (0..100)
            .map(|nth| -511.123_456_7 + f64::from(nth))
            .collect();
        let lines = lines_of(&points);
        assert_eq!(lines.len(), 4);
        assert!(
            lines[0].starts_with("WAV 1 X PNT 1 32 -511.123457 ")
                && lines[3].starts_with("WAV 1 & PNT 97 4 "),
            "{lines:?}"
        );
        assert!(
            lines
                .iter()
                .all(|line| line.len() < hysteron_protocol::LINE_BYTES)
        );
    }
}
