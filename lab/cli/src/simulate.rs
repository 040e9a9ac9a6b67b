//! `simulate`.

use crate::arguments::refuse_without_effect;
use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use crate::tables::say_notes;
use hysteron::dataset::PlayedDrive;
use hysteron::dataset::reading::drive_of_file;
use hysteron::origin::{Initial, Way, sample_rate_hz};
use hysteron::phrases::nm;
use hysteron::{Error, Model, Result};
use std::path::Path;

/// What is simulated.
pub struct SimulateRequest<'a> {
    /// The model.
    pub model: &'a Path,
    /// A file or a waveform.
    pub drive: &'a str,
    /// Where it begins.
    pub initial: Option<&'a str>,
    /// Sampling rate of a waveform.
    pub rate_hz: Option<f64>,
}

/// Simulates a model.
pub fn simulate(
    wanted: &SimulateRequest,
    reading: &ReadArguments,
    out: &Path,
    force: bool,
) -> Result<bool> {
    let desk = Desk::new(force);
    let model = desk.model(wanted.model)?;
    let drive = wanted.drive;
    let played = if Path::new(drive).is_file() {
        let rate = [("--rate-hz", wanted.rate_hz.is_some())];
        refuse_without_effect("a drive that is a file, which has its own rate", &rate)?;
        played(&desk, &model, Path::new(drive), "a drive", reading)?
    } else {
        let rate_hz = wanted.rate_hz.unwrap_or_else(|| sample_rate_hz(&model));
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(Error::new("--rate-hz", "expected a positive number"));
        }
        PlayedDrive {
            file: drive.to_owned(),
            sample_rate_hz: rate_hz,
            drive_v: waveform(drive, rate_hz, model.drive_min_v)?,
            ..PlayedDrive::default()
        }
    };
    let initial = initial(&desk, &model, wanted.initial, reading)?;
    desk.target(Some(out))?;
    let way = way(&model, reading)?;
    let place = format!("--drive {drive}");
    let (predicted, begins) = initial.predict(&model, &played.file, &played.rows(), way, &place)?;
    let band = &predicted.half_band_um;
    let mut text = format!(
        "t_s,u_v,y_um{}\n",
        if band.is_some() {
            ",low_um,high_um"
        } else {
            ""
        }
    );
    let seconds = |k: usize| played.start_s + k as f64 / played.sample_rate_hz;
    for (k, (u, y)) in played.drive_v.iter().zip(&predicted.reading_um).enumerate() {
        text.push_str(&format!("{:.9},{u:.6},{y:.6}", seconds(k)));
        if let Some(half_um) = band.as_ref().map(|band| band[k]) {
            text.push_str(&format!(",{:.6},{:.6}", y - half_um, y + half_um));
        }
        text.push('\n');
    }
    desk.write(out, text.as_bytes())?;
    println!("{} samples in {}", played.drive_v.len(), out.display());
    println!("{begins}; {}", way.in_words());
    if let Some(band) = band {
        let widest = (0..band.len())
            .max_by(|a, b| band[*a].total_cmp(&band[*b]))
            .unwrap_or(0);
        println!(
            "95 % band: +-{} nm at the end, +-{} nm where it is widest ({:.3} s)",
            nm(band.last().copied().unwrap_or(0.0)),
            nm(band.get(widest).copied().unwrap_or(0.0)),
            seconds(widest)
        );
        if let Some(only) = only_file(&model).filter(|file| *file != played.file) {
            println!(
                "  it is calibrated on parts of {only}: of another recording it may hold less than 95 %. Explain several, and hold one out"
            );
        }
    }
    say_notes(played.notes.iter().chain(&predicted.remarks));
    Ok(true)
}

/// The one file of which all records of a model are parts.
fn only_file(model: &Model) -> Option<&str> {
    let starts = &model.identified.as_ref()?.recorded.starts;
    let first = starts.first()?;
    let is_only = starts.iter().all(|start| start.file == first.file);
    is_only.then_some(first.file.as_str())
}

fn played(
    desk: &Desk,
    model: &Model,
    path: &Path,
    expected: &str,
    reading: &ReadArguments,
) -> Result<PlayedDrive> {
    let instructions = reading.instructions_beside(model)?;
    drive_of_file(
        &path.display().to_string(),
        &desk.bytes(path, expected)?,
        &instructions,
    )
}

/// Where a simulation begins, by what is typed: a state, or a recording that begins so.
pub fn initial(
    desk: &Desk,
    model: &Model,
    said: Option<&str>,
    reading: &ReadArguments,
) -> Result<Initial> {
    let Some(said) = said else {
        return Ok(Initial::AsRecorded);
    };
    if let Some(initial) = Initial::named(said) {
        return Ok(initial);
    }
    let path = Path::new(said);
    if !path.is_file() {
        return Err(Error::new(
            "--initial",
            format!("`{said}`; expected virgin, settled, or a recording that begins so"),
        ));
    }
    let recording = played(desk, model, path, "a recording", reading)?;
    Initial::like(model, &recording, way(model, reading)?)
}

/// When the drive acts: as it is typed, else as in the records of the model.
pub fn way(model: &Model, reading: &ReadArguments) -> Result<Way> {
    let typed = reading.instructions()?;
    Ok(Way::told(model, typed.timing, typed.intersample))
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
            let number = p.parse::<f64>().ok().filter(|number| number.is_finite());
            let wrong = || Error::new("--drive", format!("`{p}` in `{text}` is not a number"));
            number.ok_or_else(wrong)
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
