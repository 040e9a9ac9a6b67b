//! `track`.

use crate::arguments::Outputs;
use crate::check::read_design;
use crate::desk::{Desk, wrong};
use crate::plant_program::PlantProgram;
use hysteron::dataset::readers::{self, Hints};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::disturbance::Disturbance;
use hysteron::servo::members::PlantBand;
use hysteron::servo::reference::Reference;
use hysteron::servo::track::{DriveFigures, TrackResult};
use hysteron::servo::work::{self, Work};
use hysteron::{Error, Result};
use hysteron_report::TrackPage;
use hysteron_report::servo_words as words;
use serde::Serialize;
use std::path::{Path, PathBuf};

fn nm(um: f64) -> String {
    format!("{:.2} nm", 1e3 * um)
}

/// What is followed, and with what.
pub struct TrackRequest<'a> {
    /// The reference.
    pub reference: &'a str,
    /// Another scheme than that of the file.
    pub scheme: Option<&'a str>,
    /// Noise of the sensor, um.
    pub sensor_noise_um: Option<f64>,
    /// Force from outside.
    pub disturbance: Option<&'a str>,
    /// Mass added, as a ratio.
    pub added_mass: f64,
    /// Capacitance of the actuator, uF.
    pub capacitance_uf: Option<f64>,
    /// A program in the place of the model.
    pub plant: Option<&'a str>,
}

/// The reference that was named, a shape or a file of points, for a loop with this sampling period, s.
fn reference_of(desk: &Desk, text: &str, period_s: f64) -> Result<Reference> {
    let path = Path::new(text);
    let file_is_meant = path.is_file()
        || path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    if !file_is_meant {
        return Reference::named(text, period_s).map_err(|m| Error::new("", m));
    }
    let table = readers::read(text, &desk.bytes(path, "a reference")?, Hints::default())?;
    let [time_s, reference_um] = table.columns.as_slice() else {
        return Err(wrong(
            path,
            format!(
                "{} columns; expected two, time in s and the reference in um",
                table.columns.len()
            ),
        ));
    };
    for (column, expected) in [(time_s, "s"), (reference_um, "um")] {
        if let Some(unit) = column.unit.as_ref().filter(|unit| *unit != expected) {
            return Err(wrong(
                path,
                format!(
                    "column {} is in {unit}; expected {expected}",
                    column.called()
                ),
            ));
        }
    }
    Reference::through(&time_s.values, &reference_um.values, period_s).map_err(|m| wrong(path, m))
}

/// Follows a reference on a program of the user.
fn follow_program(
    command: &str,
    design: &ServoDesign,
    reference: &Reference,
    reference_name: &str,
    work: &Work,
) -> Result<TrackResult> {
    let mut plant = PlantProgram::start(command, design.period_s())?;
    let called = format!("the program `{command}`");
    let found = work::follow_plant(&mut plant, &called, design, reference, reference_name, work);
    let knows_position = plant.knows_position();
    plant.finish()?;
    let mut found = found.map_err(|m| Error::new("", m))?;
    if !knows_position {
        found.plant += "; it gives no true position, so that `true` is what it reads";
    }
    Ok(found)
}

/// What `track --json` carries.
#[derive(Serialize)]
struct TrackFigures<'a> {
    #[serde(flatten)]
    found: &'a TrackResult,
    /// The plants that may stand in the place of the model; none beside a plant of one's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    band: Option<&'a PlantBand>,
}

/// `hysteron track MODEL SERVO --reference R [--scheme NAME] [--sensor-noise-um N] [--disturbance D]
/// [--added-mass RATIO] [--capacitance-uf C] [--plant COMMAND]`.
pub fn track(model: &Path, servo: &Path, wanted: &TrackRequest, outputs: &Outputs) -> Result<bool> {
    let TrackRequest {
        reference,
        scheme,
        sensor_noise_um,
        disturbance,
        added_mass,
        capacitance_uf,
        plant,
    } = *wanted;
    let desk = Desk::new(outputs.force);
    let design = read_design(&desk, servo)?;
    let chain = desk.model(model)?;
    outputs.check(&desk)?;
    if let Some(uf) = capacitance_uf.filter(|uf| !(*uf > 0.0 && uf.is_finite())) {
        return Err(Error::new(
            "--capacitance-uf",
            format!("{uf}; expected above 0"),
        ));
    }
    let period_s = design.period_s();
    let followed = reference_of(&desk, reference, period_s)?;
    let disturbance_said = disturbance
        .map(|text| Disturbance::parse(text, period_s))
        .transpose()
        .map_err(|m| Error::new("", m))?;
    let work = Work {
        scheme,
        sensor_noise_um,
        disturbance: disturbance_said,
        added_mass,
    };
    let refused = |m: String| Error::new("", m);
    let (result, band) = match plant {
        Some(command) => {
            let found = follow_program(command, &design, &followed, reference, &work)?;
            (found, None)
        }
        None => {
            let found = work::follow(&chain, &design, &followed, reference, &work);
            let found = found.map_err(refused)?;
            let band = work::follow_on_members(&chain, &design, &followed, &work, &found);
            (found, Some(band.map_err(refused)?))
        }
    };
    let pushed = disturbance.map_or_else(String::new, |d| format!(", disturbed by {d}"));
    let loaded = if added_mass > 0.0 {
        format!(", {} times the moving mass", 1.0 + added_mass)
    } else {
        String::new()
    };
    let at_work = format!("{} on {reference}{pushed}{loaded}", result.scheme);
    println!("{at_work}");
    println!("  plant: {}", result.plant);
    println!(
        "  true    RMS {}, max {}",
        nm(result.truth.rms_um),
        nm(result.truth.max_um)
    );
    println!(
        "  read    RMS {}, max {}, as hardware shows it: {} of noise {} ({} without)",
        nm(result.as_read.rms_um),
        nm(result.as_read.max_um),
        nm(result.noise_um),
        match plant {
            Some(_) => "beside what the program has of its own",
            None => "included",
        },
        nm(result.sensor.rms_um)
    );
    if let Some(step) = &result.step {
        println!("  step    {}", words::step(step));
    }
    for [word, said] in band.as_ref().map(words::band).unwrap_or_default() {
        println!("  {word:7} {said}");
    }
    if let Some(beside) = &result.beside {
        println!(
            "  {} on the same run, true RMS {}, max {}",
            beside.scheme,
            nm(beside.truth.rms_um),
            nm(beside.truth.max_um)
        );
    }
    println!(
        "  mean error {} as read, {} true, {} saturated ticks",
        nm(result.steady_state_um),
        nm(result.true_mean_um),
        result.saturated_ticks
    );
    let DriveFigures {
        range_v: [low_v, high_v],
        rate_max_v_s,
        rate_rms_v_s,
    } = result.drive;
    println!(
        "  drive   {low_v:.1} to {high_v:.1} V, at most {:.1} V/ms from tick to tick, {:.1} V/ms RMS",
        1e-3 * rate_max_v_s,
        1e-3 * rate_rms_v_s
    );
    if let Some(uf) = capacitance_uf {
        println!(
            "  current {:.1} mA at most, {:.1} mA RMS, into {uf} uF",
            1e-3 * uf * rate_max_v_s,
            1e-3 * uf * rate_rms_v_s
        );
    }
    if let Some(sentence) = words::sensor_lag(result.sensor_lag_s, result.model_sensor_lag_s) {
        println!("  {sentence}");
    }
    if let Some(gain) = result.adapted_gain {
        println!("  the gain was corrected to {gain:.3} times the model's");
    }
    desk.write_json(
        outputs.json.as_deref(),
        &TrackFigures {
            found: &result,
            band: band.as_ref(),
        },
    )?;
    let period_s = match &followed {
        Reference::Periodic(periodic) => Some(1.0 / periodic.frequency_hz),
        Reference::Step { .. } | Reference::Points(_) => None,
    };
    // A step of its own is on the page already.
    let of_model = |_: &&PathBuf| result.step.is_none() && plant.is_none();
    let small_step = match outputs.report.as_ref().filter(of_model) {
        Some(_) => Some(
            work::follow_step(
                &chain,
                &design,
                &Work {
                    disturbance: None,
                    ..work
                },
            )
            .map_err(refused)?,
        ),
        None => None,
    };
    let step = small_step.as_ref();
    desk.write_page(outputs.report.as_deref(), || {
        TrackPage {
            found: &result,
            period_s,
            band: band.as_ref(),
            step,
            capacitance_uf,
        }
        .page(at_work)
    })?;
    let trouble = result.trouble();
    if let Some(trouble) = &trouble {
        eprintln!("WARNING: {trouble}");
    }
    Ok(trouble.is_none())
}
