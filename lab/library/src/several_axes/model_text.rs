//! Models of several axes as text, and the figures of a search.

use super::finder::AxesFound;
use super::recordings::AxesData;
use super::structure::{AxisEffect, Described};
use crate::diagnosis::policy::Policy;
use crate::error::{Error, Result};
use crate::toml_file;
use hysteron_sim::several_axes::{ActuatorSoftening, ModalStage};
use serde::{Deserialize, Serialize};

/// What the first key of a model file says.
pub const SCHEMA: &str = "hysteron.axes/1";

/// A model of several axes as a file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxesModel {
    /// [`SCHEMA`].
    pub schema: String,
    /// The data set that it was identified from.
    pub name: String,
    /// Samples per second of that data set.
    pub sample_rate_hz: f64,
    /// Names of the drives.
    pub drive_names: Vec<String>,
    /// Names of the sensors.
    pub sensor_names: Vec<String>,
    /// Unit of the drives.
    pub drive_unit: String,
    /// Unit of the readings.
    pub sensor_unit: String,
    /// Effects, each in its channel or mode.
    pub effects: Vec<AxisEffect>,
    /// The values.
    pub stage: ModalStage,
}

impl AxesModel {
    /// A model with what its data set is called.
    #[must_use]
    pub fn new(model: &Described, data: &AxesData) -> Self {
        Self {
            schema: SCHEMA.into(),
            name: data.name.clone(),
            sample_rate_hz: data.records[0].sample_rate_hz,
            drive_names: data.drives.clone(),
            sensor_names: data.sensors.clone(),
            drive_unit: data.drive_unit.clone(),
            sensor_unit: data.sensor_unit.clone(),
            effects: model.effects.clone(),
            stage: model.stage.clone(),
        }
    }

    /// As TOML.
    ///
    /// # Errors
    /// A value that TOML cannot hold.
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|e| Error::new("model", e))
    }

    /// From TOML; `place` is what the file is called in messages.
    ///
    /// # Errors
    /// The line that is wrong, or channels that do not fit together.
    pub fn from_toml(text: &str, place: &str) -> Result<Self> {
        let model: Self = toml_file::with_schema(text, place, SCHEMA)?;
        let (drives, sensors) = (model.stage.drives.len(), model.stage.sensors.len());
        let modes_fit = model.stage.modes.iter().all(|mode| {
            let finite = mode
                .of_drives
                .iter()
                .chain(&mode.of_sensors)
                .all(|share| share.is_finite());
            mode.of_drives.len() == drives
                && mode.of_sensors.len() == sensors
                && mode.frequency_hz > 0.0
                && mode.compliance >= 0.0
                && finite
        });
        let feedthrough_fits = model.stage.feedthrough.len() == sensors
            && model
                .stage
                .feedthrough
                .iter()
                .all(|row| row.len() == drives);
        // What is negative in an actuator, or takes more than there is, gives energy without end.
        let actuator_fits = |drive: usize| {
            let path = &model.stage.drives[drive];
            let slip = |[threshold, stiffness]: &[f64; 2]| *threshold > 0.0 && *stiffness >= 0.0;
            let softens = |s: ActuatorSoftening| {
                let most = model.stage.softening_most(drive) * (1.0 + 1e-9);
                s.half_at > 0.0 && (0.0..=most).contains(&s.stiffness)
            };
            path.softening.is_none_or(softens) && path.slips.iter().all(slip)
        };
        let actuators_fit = !modes_fit || (0..drives).all(actuator_fits);
        if drives == 0
            || sensors == 0
            || !modes_fit
            || !actuators_fit
            || !feedthrough_fits
            || model.sample_rate_hz.is_nan()
            || model.sample_rate_hz <= 0.0
        {
            return Err(Error::new(
                place,
                format!(
                    "its modes, actuators and feedthrough do not fit {drives} drives and {sensors} sensors; expected a model written by `hysteron`"
                ),
            ));
        }
        Ok(model)
    }
}

/// An effect that was named.
#[derive(Clone, Debug, Serialize)]
pub struct NamedEffect {
    /// Its identifier.
    pub effect: &'static str,
    /// Its channel or mode.
    pub channel: String,
    /// Error without it, everything else fitted again.
    pub error_without: f64,
    /// What does as well in its place.
    pub or: Vec<String>,
}

/// Error of one sensor.
#[derive(Clone, Debug, Serialize)]
pub struct SensorError {
    /// Its name.
    pub sensor: String,
    /// RMS error on the held-out records, in its unit.
    pub held_out_rms: f64,
    /// That error of the RMS of its reading, per cent.
    pub held_out_pct: f64,
}

/// A step of the search.
#[derive(Clone, Debug, Serialize)]
pub struct StepFigures {
    /// Effect and channel.
    pub added: String,
    /// Error on the held-out records before.
    pub before: f64,
    /// And after.
    pub after: f64,
}

/// Figures of a search, as JSON.
#[derive(Clone, Debug, Serialize)]
pub struct AxesFigures {
    /// `hysteron.axes_diagnosis/1`.
    pub schema: &'static str,
    /// The data set.
    pub name: String,
    /// How far the held-out error fell, and what that leaves.
    pub sentence: String,
    /// Effects, each with its channel.
    pub named: Vec<NamedEffect>,
    /// Effects of the model that the search did not come to test, in words.
    pub not_decided: Vec<String>,
    /// Whether the caller wanted the best so far.
    pub stopped: bool,
    /// How the model grew.
    pub steps: Vec<StepFigures>,
    /// Held-out error of all sensors.
    pub error: f64,
    /// Error on the records that were fitted.
    pub fitted_error: f64,
    /// What errors are counted in: the noise, or the RMS of a reading where the records do not show the
    /// noise.
    pub error_in: &'static str,
    /// By sensor.
    pub sensors: Vec<SensorError>,
    /// How many numbers were estimated.
    pub parameters: usize,
    /// Processing time, s.
    pub seconds: f64,
}

/// How far the held-out error fell, and what that leaves.
fn sentence(found: &AxesFound, data: &AxesData) -> String {
    let unit = if found.in_times_the_noise {
        "times the noise"
    } else {
        "of the reading"
    };
    let (drives, sensors) = (data.drives.len(), data.sensors.len());
    let start = found.steps.first().map_or(found.error, |step| step.before);
    let beside = match found.modes_at_first {
        0 => String::new(),
        modes => format!(", beside all {modes} modes of the measured responses"),
    };
    let mut fall = format!(
        "{} effects in {drives} drives and {sensors} sensors{beside}; the held-out error falls from {start:.3} to {:.3} {unit}",
        found.findings.len() + found.untested.len(),
        found.error
    );
    if !found.untested.is_empty() {
        fall += &format!(
            "; the search ended before it tested {} of them",
            found.untested.len()
        );
    }
    if found.ended_early {
        return format!("{fall}. It did not come to its end: more may be missing");
    }
    if !found.in_times_the_noise {
        return format!("{fall}. Nothing shows the noise: record five periods or more");
    }
    if found.error <= Policy::default().explained {
        format!("{fall}: that is the noise")
    } else {
        format!(
            "{fall}. What is missing there, no effect in any channel takes up: look on the page where the responses differ"
        )
    }
}

/// The figures of what was found.
#[must_use]
pub fn figures(found: &AxesFound, data: &AxesData, seconds: f64) -> AxesFigures {
    let named = |finding: &super::finder::AxisFinding| NamedEffect {
        effect: finding.effect.id(),
        channel: finding.effect.place(&found.model.stage, data),
        error_without: finding.without,
        or: finding.or.iter().map(|(_, named)| named.clone()).collect(),
    };
    let sensor = |(i, name): (usize, &String)| SensorError {
        sensor: name.clone(),
        held_out_rms: found.held_out_rms[i],
        held_out_pct: 100.0 * found.held_out_rms[i] / found.reading_rms[i],
    };
    let step = |step: &super::finder::Joined| StepFigures {
        added: step.named.clone(),
        before: step.before,
        after: step.after,
    };
    AxesFigures {
        schema: "hysteron.axes_diagnosis/1",
        name: data.name.clone(),
        sentence: sentence(found, data),
        named: found.findings.iter().map(named).collect(),
        not_decided: found.untested.clone(),
        stopped: found.stopped,
        steps: found.steps.iter().map(step).collect(),
        error: found.error,
        fitted_error: found.fitted_error,
        error_in: if found.in_times_the_noise {
            "noise"
        } else {
            "reading"
        },
        sensors: data.sensors.iter().enumerate().map(sensor).collect(),
        parameters: found.model.parameters(),
        seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::several_axes::StageMode;

    #[test]
    fn a_model_comes_back_from_its_text() {
        let mut stage = ModalStage::at_rest(2, 2);
        stage.modes.push(StageMode {
            of_drives: vec![1.0, 0.25],
            of_sensors: vec![0.1, 0.0],
            ..StageMode::linear(210.0, 0.02, 2, 2)
        });
        let model = AxesModel {
            schema: SCHEMA.into(),
            name: "two axes".into(),
            sample_rate_hz: 6400.0,
            drive_names: vec!["ux".into(), "uy".into()],
            sensor_names: vec!["x".into(), "y".into()],
            drive_unit: "V".into(),
            sensor_unit: "um".into(),
            effects: vec![
                AxisEffect::Vibration {
                    mode: 0,
                    drive: 0,
                    sensor: 0,
                },
                AxisEffect::DriveCoupling { drive: 1, mode: 0 },
            ],
            stage,
        };
        let back = AxesModel::from_toml(&model.to_toml().unwrap(), "model.toml").unwrap();
        assert_eq!((back.stage, back.effects), (model.stage, model.effects));
    }
}
