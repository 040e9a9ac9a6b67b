//! `board envelope`: what the board may do to the actuator, from a file to the board's flash, by a command
//! that names its checksum.

use super::connection::{LineArguments, as_ours};
use crate::desk::{Desk, wrong};
use hysteron::Result;
use hysteron_core::codes::DriveCode;
use hysteron_core::firmware_update::text;
use hysteron_core::safety_envelope::{ENVELOPE_BYTES, SafetyEnvelope, fingerprint, read, write};
use hysteron_core::sensor_linearisation::POINTS;
use serde::Deserialize;
use std::path::Path;

/// An envelope as a person writes it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvelopeFile {
    name: String,
    /// Serial number of the stage, as `name` of the front end that its blocks are made with; empty: blocks of
    /// every stage.
    stage: String,
    /// Bits of the drive's converter: 20 on SPI, 12 for the part's own.
    drive_bits: u8,
    /// From the lower reference of the drive's converter to its upper one, V.
    reference_span_v: f64,
    #[serde(default)]
    sensor_twos_complement: bool,
    drive_at_lowest_code_v: f64,
    drive_beyond_highest_code_v: f64,
    drive_min_v: f64,
    drive_max_v: f64,
    rest_v: f64,
    slew_v_s: f64,
    rest_within_s: f64,
    stuck_within_s: f64,
    tracking_within_s: f64,
    tracking_error_um: f64,
    /// Codes at either end of the sensor, of 65,536, that no block calls honest.
    sensor_margin_codes: u16,
    healthy_s: f64,
    /// Positions of all codes of the sensor.
    sensor_span_um: f64,
    /// What a reading lacks at every sixteenth of the sensor's span but its ends; empty: the sensor is straight.
    #[serde(default)]
    sensor_corrections_um: Vec<f64>,
    /// Largest change of a reading in a tick that a block calls honest.
    sensor_jump_um: f64,
    /// A bench without a stage: a loop may be closed that no self-test has tried.
    #[serde(default)]
    closes_untested: bool,
    capacitance_uf: f64,
    current_ma: f64,
    /// The drive's SDO is wired.
    #[serde(default)]
    drive_reads_back: bool,
    /// The amplifier's voltage monitor, where it is wired.
    monitor: Option<MonitorFile>,
    /// The analogue set point, where it is wired.
    set_point: Option<SetPointFile>,
    /// The amplifier's temperature, where its sensor is wired.
    amplifier_temperature: Option<TemperatureFile>,
}

/// How the sensor of the amplifier's temperature is wired, and what it may read.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TemperatureFile {
    celsius_at_lowest_code: f64,
    /// Less than at the lowest code where the voltage falls with the temperature.
    celsius_beyond_highest_code: f64,
    most_celsius: f64,
}

/// How the analogue set point is wired, and where it may lead to.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SetPointFile {
    position_at_lowest_code_um: f64,
    position_beyond_highest_code_um: f64,
    lowest_um: f64,
    highest_um: f64,
}

/// How the amplifier's voltage monitor is wired.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MonitorFile {
    drive_at_lowest_code_v: f64,
    drive_beyond_highest_code_v: f64,
    tolerance_v: f64,
    /// Longest time constant of amplifier and monitor together.
    lag_s: f64,
}

impl EnvelopeFile {
    fn envelope(&self) -> SafetyEnvelope {
        let span_v = self.drive_beyond_highest_code_v - self.drive_at_lowest_code_v;
        let codes = 2f64.powi(i32::from(self.drive_bits));
        // Limits round inwards, rest to the nearest.
        let share = |drive_v: f64| (drive_v - self.drive_at_lowest_code_v) / span_v * codes;
        let code = |steps: f64| DriveCode::new(steps.clamp(0.0, codes - 1.0) as u32);
        let lowest = code((share(self.drive_min_v) - 1e-6).ceil());
        let padded = |text: &str| {
            let mut field = [0u8; 16];
            let room = field.iter_mut().zip(text.bytes());
            room.for_each(|(to, from)| *to = from);
            field
        };
        let monitor = |of: fn(&MonitorFile) -> f64| {
            self.monitor
                .as_ref()
                .map_or(0.0, |monitor| of(monitor).round())
        };
        let set_point = |of: fn(&SetPointFile) -> f64| {
            self.set_point
                .as_ref()
                .map_or(0.0, |input| (of(input) * 1e3).round())
        };
        let temperature = |of: fn(&TemperatureFile) -> f64| {
            self.amplifier_temperature
                .as_ref()
                .map_or(0, |sensor| (of(sensor) * 10.0).round() as i32)
        };
        let milliseconds = |seconds: f64| (seconds * 1e3).round() as u16;
        SafetyEnvelope {
            name: padded(&self.name),
            stage: padded(&self.stage),
            dac_bits: self.drive_bits,
            sensor_is_signed: self.sensor_twos_complement,
            reference_span_mv: (self.reference_span_v * 1e3).round() as u32,
            drive_at_code_0_uv: (self.drive_at_lowest_code_v * 1e6).round() as i32,
            drive_span_uv: (span_v * 1e6).round() as u32,
            drive_min: lowest,
            drive_max: code((share(self.drive_max_v) + 1e-6).floor()),
            safe_code: code(share(self.rest_v).round()).max(lowest),
            slew_limit_v_s: self.slew_v_s.floor() as u32,
            rest_within_ms: milliseconds(self.rest_within_s),
            stuck_within_ms: milliseconds(self.stuck_within_s),
            tracking_within_ms: milliseconds(self.tracking_within_s),
            tracking_error_nm: (self.tracking_error_um * 1e3).round() as u32,
            sensor_margin: self.sensor_margin_codes,
            healthy_ms: milliseconds(self.healthy_s),
            capacitance_nf: (self.capacitance_uf * 1e3).round() as u32,
            current_ua: (self.current_ma * 1e3).round() as u32,
            drive_reads_back: self.drive_reads_back,
            monitor_at_code_0_uv: monitor(|m| m.drive_at_lowest_code_v * 1e6) as i32,
            monitor_span_uv: monitor(|m| {
                (m.drive_beyond_highest_code_v - m.drive_at_lowest_code_v) * 1e6
            }) as u32,
            monitor_tolerance_mv: monitor(|m| m.tolerance_v * 1e3) as u16,
            monitor_lag_us: monitor(|m| m.lag_s * 1e6) as u32,
            set_point_at_code_0_nm: set_point(|s| s.position_at_lowest_code_um) as i32,
            set_point_span_nm: set_point(|s| {
                s.position_beyond_highest_code_um - s.position_at_lowest_code_um
            }) as u32,
            set_point_min_nm: set_point(|s| s.lowest_um) as i32,
            set_point_max_nm: set_point(|s| s.highest_um) as i32,
            amplifier_at_code_0_decicelsius: temperature(|t| t.celsius_at_lowest_code),
            amplifier_span_decicelsius: temperature(|t| {
                t.celsius_beyond_highest_code - t.celsius_at_lowest_code
            }),
            amplifier_most_decicelsius: temperature(|t| t.most_celsius),
            sensor_span_nm: (self.sensor_span_um * 1e3).round() as u32,
            sensor_corrections: self.sensor_corrections(),
            jump_within_nm: (self.sensor_jump_um * 1e3).round() as u32,
            closes_untested: self.closes_untested,
        }
    }
}

impl EnvelopeFile {
    /// Codes of 65,536, held at the ends of their format.
    fn sensor_corrections(&self) -> [i16; POINTS] {
        let mut codes = [0; POINTS];
        for (code, um) in codes.iter_mut().zip(&self.sensor_corrections_um) {
            *code = (um / self.sensor_span_um * 65_536.0).round() as i16;
        }
        codes
    }
}

/// The envelope of a file as bytes, which the board would take.
fn bytes_of(content: &str, path: &Path) -> Result<(SafetyEnvelope, Vec<u8>)> {
    let file: EnvelopeFile =
        toml::from_str(content).map_err(|problem| wrong(path, problem.message()))?;
    if file.stage.len() > 16 || !file.stage.bytes().all(|c| c.is_ascii_graphic()) {
        let what = format!(
            "stage = \"{}\": expected at most 16 letters, digits and signs",
            file.stage
        );
        return Err(wrong(path, what));
    }
    let corrections = file.sensor_corrections_um.len();
    if corrections != 0 && corrections != POINTS {
        let what =
            format!("sensor_corrections_um has {corrections} numbers: expected {POINTS}, or none");
        return Err(wrong(path, what));
    }
    let envelope = file.envelope();
    let mut bytes = [0; ENVELOPE_BYTES];
    let length = write(&envelope, &mut bytes).map_err(|problem| wrong(path, problem.reason()))?;
    let bytes = bytes.get(..length).unwrap_or_default().to_vec();
    read(&bytes).map_err(|problem| wrong(path, problem.reason()))?;
    Ok((envelope, bytes))
}

/// Says what the file allows and its checksum; brings it to the board only where that checksum is named.
pub fn envelope(file: &Path, checksum: Option<&str>, line: &LineArguments) -> Result<bool> {
    let bytes = Desk::new(false).bytes(
        file,
        "a safety envelope (firmware/README.md, *Safety envelope*)",
    )?;
    let content = String::from_utf8(bytes).map_err(|_| wrong(file, "is not text"))?;
    let (envelope, bytes) = bytes_of(&content, file)?;
    let volts = |code| envelope.drive_uv(code) as f64 * 1e-6;
    let name = format!("{:08x}", fingerprint(&envelope));
    println!(
        "{}: {:.3} to {:.3} V, rest {:.3} V",
        file.display(),
        volts(envelope.drive_min),
        volts(envelope.drive_max),
        volts(envelope.safe_code)
    );
    match text(&envelope.stage) {
        "" => println!("  of no stage: takes the blocks of every one"),
        stage => println!("  for the stage {stage}"),
    }
    println!(
        "  at most {} V/s, {:.3} mA RMS into {:.3} uF",
        envelope.slew_limit_v_s,
        1e-3 * f64::from(envelope.current_ua),
        1e-3 * f64::from(envelope.capacitance_nf)
    );
    println!(
        "  register of the drive's converter {}, output of the amplifier {}",
        if envelope.drive_reads_back {
            "read back"
        } else {
            "not read back"
        },
        if envelope.monitor_span_uv > 0 {
            format!(
                "watched to {:.3} V",
                1e-3 * f64::from(envelope.monitor_tolerance_mv)
            )
        } else {
            "not watched".into()
        }
    );
    if envelope.set_point_span_nm > 0 {
        println!(
            "  analogue set point from {:.3} to {:.3} um",
            1e-3 * f64::from(envelope.set_point_min_nm),
            1e-3 * f64::from(envelope.set_point_max_nm)
        );
    }
    if envelope.amplifier_span_decicelsius != 0 {
        println!(
            "  amplifier at most {:.1} degrees Celsius",
            0.1 * f64::from(envelope.amplifier_most_decicelsius)
        );
    }
    println!("  checksum {name}");
    match checksum {
        None => {
            println!("nothing was sent; to let the board have it: --checksum {name}");
            Ok(true)
        }
        Some(named) if named.trim_start_matches("0x") == name => {
            let mut board = line.connect()?;
            hysteron_client::upload::keep_envelope(
                &mut board,
                &bytes,
                fingerprint(&envelope),
                line.baud(),
            )
            .map_err(as_ours)?;
            println!("the board has it, and has restarted with it");
            Ok(true)
        }
        Some(named) => Err(wrong(file, format!("its checksum is {name}, not {named}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        name = "first power-up"
        stage = "117042917"
        drive_bits = 20
        reference_span_v = 14.0
        drive_at_lowest_code_v = -20.0
        drive_beyond_highest_code_v = 120.0
        drive_min_v = 0.0
        drive_max_v = 20.0
        rest_v = 0.0
        slew_v_s = 1000.0
        rest_within_s = 0.1
        stuck_within_s = 0.01
        tracking_within_s = 0.005
        tracking_error_um = 1.0
        sensor_margin_codes = 16
        healthy_s = 0.1
        sensor_span_um = 15.0
        sensor_jump_um = 1.5
        capacitance_uf = 1.5
        current_ma = 20.0
    "#;

    #[test]
    fn a_file_becomes_an_envelope_within_its_limits() {
        let (envelope, bytes) = bytes_of(FILE, Path::new("bench.toml")).expect("an envelope");
        assert_eq!(read(&bytes), Ok(envelope));
        assert!(
            envelope.drive_uv(envelope.drive_min) >= -140
                && envelope.drive_uv(envelope.drive_max) <= 20_000_000
        );
        let wrong = |from: &str, to: &str| {
            bytes_of(&FILE.replace(from, to), Path::new("bench.toml")).is_err()
        };
        assert!(
            wrong("drive_bits = 20", "drive_bits = 30")
                && wrong("drive_max_v = 20.0", "drive_max_v = -5.0")
        );
        assert!(wrong("current_ma = 20.0", "current_ma = 0.0") && wrong("rest_v", "rset_v"));
        assert_eq!(text(&envelope.stage), "117042917");
        assert!(wrong("117042917", "a number that is too long") && wrong("stage =", "of ="));
        assert_eq!(
            (envelope.drive_reads_back, envelope.monitor_span_uv),
            (false, 0),
            "nothing is watched unless the file has it"
        );
    }

    #[test]
    fn corrections_of_the_sensor_are_fifteen_and_moderate() {
        let with = |corrections: &[f64]| {
            let field = format!("sensor_corrections_um = {corrections:?}\n{FILE}");
            bytes_of(&field, Path::new("bench.toml")).map(|(envelope, _)| envelope)
        };
        let envelope = with(&[0.15; 15]).expect("an envelope");
        let codes = 0.15 / (f64::from(envelope.sensor_span_nm) * 1e-3) * 65_536.0;
        assert_eq!(envelope.sensor_corrections, [codes.round() as i16; 15]);
        assert!(with(&[0.15; 14]).is_err(), "too few");
        assert!(with(&[1.0; 15]).is_err(), "too steep at the ends");
    }

    #[test]
    fn a_limit_of_the_amplifiers_temperature_lies_within_its_sensor() {
        let with = |most_celsius: f64| {
            let sensor = format!(
                "[amplifier_temperature]\ncelsius_at_lowest_code = -50\ncelsius_beyond_highest_code = 280\nmost_celsius = {most_celsius}\n"
            );
            bytes_of(&format!("{FILE}{sensor}"), Path::new("bench.toml"))
        };
        let (envelope, _) = with(70.0).expect("an envelope");
        assert_eq!(
            (
                envelope.amplifier_at_code_0_decicelsius,
                envelope.amplifier_span_decicelsius,
                envelope.amplifier_most_decicelsius
            ),
            (-500, 3_300, 700)
        );
        assert!(with(280.0).is_err());
    }

    #[test]
    fn an_analogue_set_point_has_a_scale_and_limits_in_order() {
        let with = |lowest_um: f64, highest_um: f64| {
            let input = format!(
                "[set_point]\nposition_at_lowest_code_um = -1.0\nposition_beyond_highest_code_um = 14.0\nlowest_um = {lowest_um}\nhighest_um = {highest_um}\n"
            );
            bytes_of(&format!("{FILE}{input}"), Path::new("bench.toml"))
        };
        let (envelope, _) = with(0.5, 10.0).expect("an envelope");
        assert_eq!(
            (envelope.set_point_at_code_0_nm, envelope.set_point_span_nm),
            (-1_000, 15_000)
        );
        assert_eq!(
            (envelope.set_point_min_nm, envelope.set_point_max_nm),
            (500, 10_000)
        );
        assert!(with(10.0, 0.5).is_err());
    }

    #[test]
    fn a_monitor_must_see_the_whole_drive_and_a_dead_amplifier() {
        let with = |lowest_v: f64, tolerance_v: f64| {
            let monitor = format!(
                "drive_reads_back = true\n[monitor]\ndrive_at_lowest_code_v = {lowest_v}\ndrive_beyond_highest_code_v = 150.0\ntolerance_v = {tolerance_v}\nlag_s = 0.002\n"
            );
            bytes_of(&format!("{FILE}{monitor}"), Path::new("bench.toml"))
        };
        let (envelope, _) = with(-30.0, 0.5).expect("an envelope");
        assert!(envelope.drive_reads_back);
        assert_eq!(
            (envelope.monitor_at_code_0_uv, envelope.monitor_span_uv),
            (-30_000_000, 180_000_000)
        );
        assert_eq!(
            (envelope.monitor_tolerance_mv, envelope.monitor_lag_us),
            (500, 2_000)
        );
        assert!(with(0.0, 0.5).is_err(), "0 V would be an open cable");
        assert!(
            with(-30.0, 1.5).is_err(),
            "the step of the self-test would not show a dead amplifier"
        );
    }
}
