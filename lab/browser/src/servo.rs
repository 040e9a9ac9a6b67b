//! From the model to a servo: design, margins, a reference followed in simulation, the files for the
//! amplifier.

use crate::answers::Answer;
use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters, block, upload_lines};
use hysteron::servo::check;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::reference::Reference;
use hysteron::servo::work::{self, Work};
use hysteron::{Dataset, Error, Result};
use hysteron_report::servo_words as words;
use hysteron_sim::chain::Model;
use serde::Deserialize;
use serde_json::json;

/// Share of the travel that a reference goes over by default.
const SHOWN_SHARE: f64 = 0.35;

/// What is asked about a servo.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServoQuestion {
    /// A servo for the model, by what the recording leaves possible.
    Design {
        /// Highest frequency of references, Hz.
        reference_hz: f64,
    },
    /// A sine followed in simulation.
    Follow {
        /// Frequency, Hz.
        hz: f64,
        /// Amplitude, um.
        amplitude_um: f64,
    },
    /// The servo as a file.
    Save {},
    /// The parameter block of the servo for an amplifier with the usual wiring, and its lines for a running
    /// target.
    Block {
        /// Highest frequency of references, Hz.
        reference_hz: f64,
    },
}

fn refused(message: String) -> Error {
    Error::new("servo", message)
}

fn order(dataset: &Dataset, reference_hz: f64) -> DesignOrder<'_> {
    DesignOrder {
        reference_hz,
        recording: Some(dataset),
        ..DesignOrder::default()
    }
}

/// Answers a question about a servo; `servo` is the one at hand.
///
/// # Errors
/// Why no servo is possible, or that no servo is designed yet.
pub fn answer(
    question: &ServoQuestion,
    servo: &mut Option<ServoDesign>,
    model: &Model,
    dataset: &Dataset,
) -> Result<Answer> {
    let at_hand = |servo: &Option<ServoDesign>| {
        servo
            .clone()
            .ok_or_else(|| refused("no servo yet; design one first".into()))
    };
    match *question {
        ServoQuestion::Design { reference_hz } => {
            *servo = None;
            let design = order::design(model, &order(dataset, reference_hz)).map_err(refused)?;
            let answer = designed(&design, model, dataset)?;
            *servo = Some(design);
            Ok(answer)
        }
        ServoQuestion::Follow { hz, amplitude_um } => {
            follow(&at_hand(servo)?, model, hz, amplitude_um)
        }
        ServoQuestion::Save {} => {
            let text =
                toml::to_string_pretty(&at_hand(servo)?).map_err(|e| refused(e.to_string()))?;
            Ok(Answer::of(json!({ "text": text })))
        }
        ServoQuestion::Block { reference_hz } => {
            let front_end = FrontEnd::default();
            let ordered = DesignOrder {
                front_end: Some(&front_end),
                ..order(dataset, reference_hz)
            };
            let design = order::design(model, &ordered).map_err(refused)?;
            let bytes = block(&amplifier_parameters(&design, &front_end)?)?;
            Ok(Answer::of(
                json!({ "commands": upload_lines(&bytes)?, "bytes": bytes }),
            ))
        }
    }
}

/// A design with its margins on the model.
fn designed(design: &ServoDesign, model: &Model, dataset: &Dataset) -> Result<Answer> {
    let checked = check::check_with(design, model, Some(dataset)).map_err(refused)?;
    let response = checked
        .margins
        .as_ref()
        .map(|m| m.response.as_slice())
        .unwrap_or_default();
    let over = |value: &dyn Fn(&hysteron::servo::loop_margins::LoopPoint) -> f64| {
        response.iter().map(value).collect::<Vec<f64>>()
    };
    Ok(Answer {
        json: json!({
            "explanation": design.explanation,
            "stable": checked.stable,
            "margins": checked.margins.as_ref().map(words::margins).map(|mut said| {
                said.extend(checked.on_plants.as_ref().map(words::on_plants));
                said
            }),
            "amplitude_um": SHOWN_SHARE * design.model.reach_um(),
        }),
        columns: vec![
            over(&|p| p.hz),
            over(&|p| p.sensitivity),
            over(&|p| p.complementary),
            design.trade_off.iter().map(|a| a.noise_um).collect(),
            design.trade_off.iter().map(|a| a.disturbance_um).collect(),
            design
                .chosen
                .map_or_else(Vec::new, |a| vec![a.noise_um, a.disturbance_um]),
        ],
    })
}

/// The integer servo on the simulated model, on the plants that may stand in its place, and a small step.
fn follow(design: &ServoDesign, model: &Model, hz: f64, amplitude_um: f64) -> Result<Answer> {
    let name = format!("sine:{hz}:{amplitude_um}");
    let reference = Reference::named(&name, design.period_s()).map_err(refused)?;
    let work = Work::default();
    let found = work::follow(model, design, &reference, &name, &work).map_err(refused)?;
    let band =
        work::follow_on_members(model, design, &reference, &work, &found).map_err(refused)?;
    let step = work::follow_step(model, design, &work).map_err(refused)?;
    let error_um = found
        .sensor_um
        .iter()
        .zip(&found.reference_um)
        .map(|(y, r)| y - r)
        .collect();
    Ok(Answer {
        json: json!({
            "true_rms_um": found.truth.rms_um, "true_max_um": found.truth.max_um,
            "read_rms_um": found.sensor.rms_um, "trouble": found.trouble(),
            "from_s": found.time_s.first(), "rate_hz": rate_hz(&found.time_s),
            "band": words::band(&band).into_iter().map(|line| line.join(": ")).collect::<Vec<_>>(),
            "step": step.step.as_ref().map(words::step),
            "step_from_s": step.time_s.first(),
        }),
        columns: vec![
            found.reference_um,
            found.sensor_um,
            error_um,
            found.drive_v,
            step.reference_um,
            step.sensor_um,
        ],
    })
}

fn rate_hz(time_s: &[f64]) -> Option<f64> {
    match time_s {
        [first, .., last] if last > first => Some((time_s.len() - 1) as f64 / (last - first)),
        _ => None,
    }
}
