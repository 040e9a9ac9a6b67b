//! `simulate`.

use crate::desk::Desk;
use crate::tables::say_notes;
use hysteron::dataset::readers::{self, Hints};
use hysteron::dataset::time_axis::{StampContext, TimeAxis};
use hysteron::dataset::{column_rules::ColumnRules, recognise::time_and_drive};
use hysteron::diagnosis::words::nm;
use hysteron::{Error, Result, prediction};
use hysteron_sim::chain::{Drive, InitialState};
use std::path::Path;

/// Simulates a model.
pub fn simulate(model: &Path, drive: &str, out: &Path, rate_hz: f64, force: bool) -> Result<bool> {
    let desk = Desk::new(force);
    let model = desk.model(model)?;
    let path = Path::new(drive);
    let (t_s, drive_v, dt_s) = if path.is_file() {
        let table = readers::read(drive, &desk.bytes(path, "a drive")?, Hints::default())?;
        let (t_s, u_v) = time_and_drive(&table, &ColumnRules::default())?;
        // A drive is played as it is: uneven stamps are an error.
        let known = StampContext {
            place: drive,
            line_of: &|row| table.line_of(row),
            sample_rate_hz: None,
            resample: Some(false),
        };
        let axis = TimeAxis::from_stamps(&t_s, &known)?;
        (t_s, u_v, 1.0 / axis.sample_rate_hz)
    } else {
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(Error::new("--rate-hz", "expected a positive number"));
        }
        let u_v = waveform(drive, rate_hz, model.drive_min_v)?;
        (
            (0..u_v.len()).map(|k| k as f64 / rate_hz).collect(),
            u_v,
            1.0 / rate_hz,
        )
    };
    desk.target(Some(out))?;
    let driven = Drive::held(&drive_v, dt_s, InitialState::Virgin);
    let y = hysteron::simulate::simulate(&model, &driven, &format!("--drive {drive}"))?;
    let std_um = prediction::std_um(&model, &driven);
    let mut text = format!(
        "t_s,u_v,y_um{}\n",
        if std_um.is_some() {
            ",low_um,high_um"
        } else {
            ""
        }
    );
    for (k, ((t, u), y)) in t_s.iter().zip(&drive_v).zip(&y).enumerate() {
        text.push_str(&format!("{t:.9},{u:.6},{y:.6}"));
        if let Some(std_um) = &std_um {
            let half_um = prediction::BAND_95 * std_um[k];
            text.push_str(&format!(",{:.6},{:.6}", y - half_um, y + half_um));
        }
        text.push('\n');
    }
    desk.write(out, text.as_bytes())?;
    println!("{} samples in {}", y.len(), out.display());
    if let Some(std_um) = &std_um {
        let widest = std_um
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or_default();
        let last = std_um.last().copied().unwrap_or(0.0);
        println!(
            "95 % band: +-{} nm at the end, +-{} nm where it is widest ({:.3} s)",
            nm(prediction::BAND_95 * last),
            nm(prediction::BAND_95 * widest.1),
            t_s[widest.0]
        );
    }
    say_notes(&prediction::beyond(&model, &driven));
    Ok(true)
}

/// Longest waveform.
const SAMPLES_MAX: f64 = 2e7;

fn waveform(text: &str, rate_hz: f64, rest_v: f64) -> Result<Vec<f64>> {
    let unknown = || {
        let expected = "sine:HZ:AMPLITUDE_V:OFFSET_V:SECONDS (HZ above 0), triangle:V_PER_S:PEAK_V:SECONDS (slope and peak above 0) or step:V:SECONDS";
        Error::new(
            "--drive",
            format!("`{text}` is neither a file that exists nor a waveform; expected {expected}"),
        )
    };
    let mut parts = text.split(':');
    let kind = parts.next().unwrap_or_default();
    let numbers: Vec<f64> = parts
        .map(|p| {
            p.parse::<f64>()
                .map_err(|_| Error::new("--drive", format!("`{p}` in `{text}` is not a number")))
        })
        .collect::<Result<_>>()?;
    let seconds = *numbers.last().ok_or_else(unknown)?;
    if !(1.0..=SAMPLES_MAX).contains(&(seconds * rate_hz)) {
        return Err(Error::new(
            "--drive",
            format!(
                "`{text}` is {} samples long; expected 1 to {SAMPLES_MAX}",
                seconds * rate_hz
            ),
        ));
    }
    let samples = |seconds: f64| (seconds * rate_hz) as usize;
    let time = |k: usize| k as f64 / rate_hz;
    match (kind, &numbers[..]) {
        ("sine", [hz, _, _, _]) if *hz >= 0.5 * rate_hz => Err(Error::new(
            "--drive",
            format!("`{text}` has {hz} Hz; expected less than half of --rate-hz {rate_hz}"),
        )),
        ("sine", [hz, amplitude, offset, seconds]) if *hz > 0.0 => Ok((0..samples(*seconds))
            .map(|k| offset + amplitude * (std::f64::consts::TAU * hz * time(k)).sin())
            .collect()),
        ("triangle", [slope, peak, seconds]) if *slope > 0.0 && *peak > 0.0 => {
            let half = peak / slope;
            Ok((0..samples(*seconds))
                .map(|k| rest_v + slope * (half - (time(k).rem_euclid(2.0 * half) - half).abs()))
                .collect())
        }
        ("step", [level, seconds]) => Ok(vec![*level; samples(*seconds)]),
        _ => Err(unknown()),
    }
}
