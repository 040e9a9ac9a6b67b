//! `board sweep`: exponential sines that the board plays, as a data set, and what they show: transfer function
//! and distortion.

use super::connection::{LineArguments, WiringArguments, as_ours};
use super::record::{bring_wiring, names, play_all, require_room, write};
use crate::desk::Desk;
use crate::screen::as_argument;
use hysteron::servo::amplifier_block::{block, wiring_parameters};
use hysteron::sweep::{SweepBand, SweepPoint, bands};
use hysteron::synthetic::drives::DriveOfRecord;
use hysteron::{Error, Result};
use hysteron_client::condition::Condition;
use hysteron_client::scale::Scale;
use std::path::Path;

/// Names of the records of each band: of the sine, and of the smaller one that is held out.
const NAMES: [[&str; 2]; 6] = [
    ["sweep_1", "smaller_1"],
    ["sweep_2", "smaller_2"],
    ["sweep_3", "smaller_3"],
    ["sweep_4", "smaller_4"],
    ["sweep_5", "smaller_5"],
    ["sweep_6", "smaller_6"],
];
/// The held-out sine over the other one.
const SMALLER: f64 = 0.7;
/// File of the response, in the folder of the data set.
const RESPONSE: &str = "response.csv";

/// What is swept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepRequest {
    /// Lowest frequency, Hz.
    pub from_hz: f64,
    /// Highest frequency, Hz.
    pub to_hz: f64,
    /// Amplitude, V.
    pub amplitude_v: f64,
    /// Drive about which it swings, V; without it the middle of the range.
    pub offset_v: Option<f64>,
}

/// Conditions, plays, writes, and prints the response.
pub fn sweep(
    out: &Path,
    wanted: &SweepRequest,
    wiring: &WiringArguments,
    line: &LineArguments,
    force: bool,
) -> Result<bool> {
    let desk = Desk::new(force);
    let front_end = wiring.front_end(&desk)?;
    if wiring.drive_max_v.is_some() {
        wiring.limits_v()?;
    }
    let mut board = line.connect()?;
    if Condition::ask(&mut board).map_err(as_ours)?.without_block() {
        let (low_v, high_v) = wiring.limits_v()?;
        bring_wiring(
            &mut board,
            &block(&wiring_parameters(&front_end, low_v, high_v)?)?,
            line,
        )?;
    }
    let scale = Scale::ask(&mut board).map_err(as_ours)?;
    let bands = bands_of(wanted, &scale)?;
    let drives = drives(&bands, wanted, &scale)?;
    require_room(&scale, &drives)?;
    let mut files = names(&drives);
    files.push(RESPONSE.to_string());
    desk.folder_to_be(out, &files)?;
    desk.make_folder(out)?;
    board.condition().map_err(as_ours)?;
    let records = play_all(&mut board, &drives)?;
    write(&desk, out, &scale, &drives, &records)?;
    // From the slowest band to the fastest; of each pair of records the first is the sine that was asked for.
    let mut response: Vec<SweepPoint> = Vec::new();
    for (band, pair) in bands.iter().zip(records.chunks(2)).rev() {
        response.extend(pair.first().map_or_else(Vec::new, |record| {
            band.response(&record.drive_v, &record.position_um)
        }));
    }
    desk.write(&out.join(RESPONSE), table(&response).as_bytes())?;
    tell(&response);
    println!(
        "next: hysteron explain {} --from hysteresis,vibration,creep --out model.toml",
        as_argument(out)
    );
    Ok(true)
}

fn bands_of(wanted: &SweepRequest, scale: &Scale) -> Result<Vec<SweepBand>> {
    let bands = bands(
        wanted.from_hz,
        wanted.to_hz,
        scale.sample_rate_hz,
        scale.most_points,
    );
    let bands = bands.map_err(|problem| Error::new("--from-hz, --to-hz", problem))?;
    if bands.len() > NAMES.len() {
        return Err(Error::new(
            "--from-hz, --to-hz",
            format!("{} decades; expected at most {}", bands.len(), NAMES.len()),
        ));
    }
    Ok(bands)
}

/// The records, two for each band.
fn drives(bands: &[SweepBand], wanted: &SweepRequest, scale: &Scale) -> Result<Vec<DriveOfRecord>> {
    let (low_v, high_v) = (scale.drive_min_v, scale.drive_max_v);
    let offset_v = wanted.offset_v.unwrap_or(0.5 * (low_v + high_v));
    let amplitude_v = wanted.amplitude_v;
    if !(amplitude_v > 0.0 && offset_v - amplitude_v >= low_v && offset_v + amplitude_v <= high_v) {
        let problem = format!(
            "{amplitude_v} V about {offset_v} V; expected an amplitude above 0 within the board's {low_v} to {high_v} V"
        );
        return Err(Error::new("--amplitude-v", problem));
    }
    let of_band = |(band, names): (&SweepBand, &[&'static str; 2])| {
        let drive = |name: &'static str, role: &'static str, share: f64| DriveOfRecord {
            name,
            role,
            rate_hz: band.rate_hz,
            drive_v: band.points(low_v, offset_v, share * amplitude_v),
            period_s: None,
            initial_state: "unknown",
            from_s: None,
        };
        [
            drive(names[0], "identify", 1.0),
            drive(names[1], "validate", SMALLER),
        ]
    };
    Ok(bands.iter().zip(&NAMES).flat_map(of_band).collect())
}

/// A number of the table; empty without one.
fn or_nothing(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.6}"))
}

/// The response as CSV.
fn table(response: &[SweepPoint]) -> String {
    let mut text =
        String::from("frequency_hz,gain_um_v,phase_deg,second_harmonic,third_harmonic\n");
    for point in response {
        let [second, third] = point.distortion.map(or_nothing);
        text.push_str(&format!(
            "{:.4},{:.7},{:.3},{second},{third}\n",
            point.hz, point.gain_um_v, point.phase_deg
        ));
    }
    text
}

fn tell(response: &[SweepPoint]) {
    println!(
        "  {:>9}  {:>9}  {:>7}  {:>8}  {:>8}",
        "Hz", "um/V", "degrees", "2nd, %", "3rd, %"
    );
    for point in response {
        let [second, third] = point
            .distortion
            .map(|share| share.map_or_else(String::new, |share| format!("{:.2}", 100.0 * share)));
        println!(
            "  {:>9.2}  {:>9.5}  {:>7.1}  {second:>8}  {third:>8}",
            point.hz, point.gain_um_v, point.phase_deg
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale() -> Scale {
        Scale {
            sensor_at_code_0_um: -1.0,
            sensor_span_um: 15.0,
            drive_at_code_0_v: -20.0,
            drive_span_v: 140.0,
            sensor_codes: 65_536.0,
            drive_codes: 65_536.0,
            drive_min_v: 0.0,
            drive_max_v: 80.0,
            sample_rate_hz: 20_000.0,
            most_points: 4096,
            most_samples: 16_383,
        }
    }

    #[test]
    fn records_stay_in_the_range_and_what_does_not_is_refused() {
        let wanted = SweepRequest {
            from_hz: 1.0,
            to_hz: 2_000.0,
            amplitude_v: 5.0,
            offset_v: None,
        };
        let bands = bands_of(&wanted, &scale()).unwrap();
        let drives = drives(&bands, &wanted, &scale()).unwrap();
        assert_eq!(
            (drives.len(), drives[1].role, drives[0].drive_v.last()),
            (8, "validate", Some(&0.0))
        );
        assert!(drives.iter().all(|d| d.drive_v.len() <= 4096
            && d.drive_v.iter().all(|u| (0.0..=45.0 + 1e-9).contains(u))));
        require_room(&scale(), &drives).unwrap();
        for (refused, place) in [
            (
                SweepRequest {
                    amplitude_v: 41.0,
                    ..wanted
                },
                "--amplitude-v",
            ),
            (
                SweepRequest {
                    offset_v: Some(78.0),
                    ..wanted
                },
                "--amplitude-v",
            ),
            (
                SweepRequest {
                    amplitude_v: f64::NAN,
                    ..wanted
                },
                "--amplitude-v",
            ),
        ] {
            assert!(
                super::drives(&bands, &refused, &scale())
                    .unwrap_err()
                    .to_string()
                    .contains(place),
                "{refused:?}"
            );
        }
        assert!(
            bands_of(
                &SweepRequest {
                    to_hz: 9_000.0,
                    ..wanted
                },
                &scale()
            )
            .unwrap_err()
            .to_string()
            .contains("5000")
        );
        assert!(
            bands_of(
                &SweepRequest {
                    from_hz: 1e-4,
                    ..wanted
                },
                &scale()
            )
            .unwrap_err()
            .to_string()
            .contains("at most 6")
        );
    }

    #[test]
    fn a_harmonic_that_is_not_seen_leaves_its_field_empty() {
        let point = SweepPoint {
            hz: 100.0,
            gain_um_v: 0.13,
            phase_deg: -12.0,
            distortion: [Some(0.01), None],
        };
        assert_eq!(
            table(&[point]).lines().nth(1),
            Some("100.0000,0.1300000,-12.000,0.010000,")
        );
    }
}
