//! Models as files: a chain of effects that a person can read and edit, with units and standard deviations
//! beside every value.

use crate::dataset::timing::{Timing, intersample_named};
use crate::error::{Error, Result, nearest};
use crate::origin::timing_of;
use crate::toml_file::with_schema;
use hysteron_sim::chain::{EffectInstance, Identified, InitialState, Model, ParameterValue};
use hysteron_sim::effect::expression::ExpressionEffect;
use hysteron_sim::effect::{Effect, FreeMotion, Overview, Parameter, Scale, by_id, registry};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::physics::{OffsetAtRest, RecordStart, Recorded};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const SCHEMA: &str = "hysteron.model/1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFile {
    schema: String,
    #[serde(default)]
    program_version: String,
    #[serde(default)]
    data_set: String,
    drive_min_v: f64,
    drive_max_v: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    identified: Option<IdentifiedEntry>,
    #[serde(default)]
    effect: Vec<EffectEntry>,
}

/// What the model was identified from; a row of the factor is a text, so that the file stays short.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct IdentifiedEntry {
    error_um: f64,
    seconds: f64,
    low_v: f64,
    high_v: f64,
    slope_max_v_s: f64,
    #[serde(default)]
    band_95: f64,
    #[serde(default)]
    spread_share: f64,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    fitted_on: String,
    #[serde(default)]
    sample_rate_hz: f64,
    #[serde(default = "timing_by_default")]
    timing: String,
    #[serde(default = "intersample_by_default")]
    intersample: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensor_lsb_um: Option<f64>,
    /// Effect and parameter of each value, separated by a dot.
    values: Vec<String>,
    /// Lower triangular factor of the covariance of the values in units of their steps, of their logarithm
    /// where ratios matter.
    covariance_factor: Vec<String>,
    #[serde(default)]
    start: Vec<StartEntry>,
}

/// How a file of the records begins; a motion is a text of decay, 1/s, angular frequency, rad/s, cosine and
/// sine, um.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StartEntry {
    file: String,
    drive_v: f64,
    state: String,
    offset: String,
    offset_um: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    offset_at_rest_um: Option<f64>,
    #[serde(default)]
    offset_at_rest_std_um: f64,
    /// Its change along each column of the factor, um, as one text.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    offset_at_rest_moves_um: String,
    motions: Vec<String>,
}

fn timing_by_default() -> String {
    Timing::default().name().to_owned()
}

fn intersample_by_default() -> String {
    Intersample::default().name().to_owned()
}

/// Numbers as one text, with so many digits behind the point.
fn row(values: &[f64], digits: usize) -> String {
    let texts: Vec<String> = values.iter().map(|v| format!("{v:.digits$e}")).collect();
    texts.join(" ")
}

/// The numbers of a text; none where one is no number.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |text: &str| text.parse::<f64>().ok().filter(|v| v.is_finite());
    text.split_whitespace().map(number).collect()
}

impl StartEntry {
    fn of(start: &RecordStart) -> Self {
        let motion = |(m, [cosine, sine]): &(FreeMotion, [f64; 2])| {
            row(&[m.decay_per_s, m.frequency_rad_s, *cosine, *sine], 12)
        };
        Self {
            file: start.file.clone(),
            drive_v: start.drive_v,
            state: start.state.name().into(),
            offset: if start.offset_is_fitted {
                "fit"
            } else {
                "zero"
            }
            .into(),
            offset_um: start.offset_um,
            offset_at_rest_um: start.at_rest.as_ref().map(|rest| rest.offset_um),
            offset_at_rest_std_um: start.at_rest.as_ref().map_or(0.0, |rest| rest.std_um),
            offset_at_rest_moves_um: (start.at_rest.as_ref())
                .map_or_else(String::new, |rest| row(&rest.moves_um, 6)),
            motions: start.motions.iter().map(motion).collect(),
        }
    }

    fn read(self) -> std::result::Result<RecordStart, String> {
        let motion = |text: &String| match numbers(text).as_deref() {
            Some([decay_per_s, frequency_rad_s, cosine_um, sine_um]) => Ok((
                FreeMotion {
                    decay_per_s: *decay_per_s,
                    frequency_rad_s: *frequency_rad_s,
                },
                [*cosine_um, *sine_um],
            )),
            _ => Err(format!("`{text}` is no motion; expected four numbers")),
        };
        let figures = [
            self.drive_v,
            self.offset_um,
            self.offset_at_rest_um.unwrap_or_default(),
            self.offset_at_rest_std_um,
        ];
        let (true, Some(moves_um)) = (
            figures.iter().all(|figure| figure.is_finite()),
            numbers(&self.offset_at_rest_moves_um),
        ) else {
            return Err("a figure is no number".into());
        };
        Ok(RecordStart {
            drive_v: self.drive_v,
            state: InitialState::named(&self.state)
                .ok_or_else(|| format!("`{}`; expected virgin, settled or unknown", self.state))?,
            offset_is_fitted: match self.offset.as_str() {
                "fit" => true,
                "zero" => false,
                other => return Err(format!("offset = `{other}`; expected fit or zero")),
            },
            offset_um: self.offset_um,
            at_rest: self.offset_at_rest_um.map(|offset_um| OffsetAtRest {
                offset_um,
                std_um: self.offset_at_rest_std_um,
                moves_um,
            }),
            motions: self
                .motions
                .iter()
                .map(motion)
                .collect::<std::result::Result<_, _>>()?,
            file: self.file,
        })
    }
}

impl IdentifiedEntry {
    fn of(known: &Identified) -> Self {
        let recorded = &known.recorded;
        Self {
            band_95: known.band_95,
            spread_share: known.spread_share,
            fitted_on: recorded.fitted_on.clone(),
            sample_rate_hz: recorded.sample_rate_hz,
            timing: timing_of(recorded).name().into(),
            intersample: recorded.intersample.name().into(),
            sensor_lsb_um: recorded.sensor_lsb_um,
            start: recorded.starts.iter().map(StartEntry::of).collect(),
            error_um: known.error_um,
            seconds: known.seconds,
            low_v: known.low_v,
            high_v: known.high_v,
            slope_max_v_s: known.slope_max_v_s,
            values: known
                .values
                .iter()
                .map(|(effect, parameter)| format!("{effect}.{parameter}"))
                .collect(),
            covariance_factor: known.factor.iter().map(|values| row(values, 6)).collect(),
        }
    }

    fn read(self, file_name: &str, data_set: &str) -> Result<Identified> {
        let wrong = |what: &str| Error::new(file_name, format!("[identified] {what}"));
        let split = |value: &String| {
            value
                .split_once('.')
                .map(|(effect, parameter)| (effect.to_owned(), parameter.to_owned()))
        };
        let values: Option<Vec<(String, String)>> = self.values.iter().map(split).collect();
        let values = values.ok_or_else(|| wrong("values: expected effect.parameter each"))?;
        let rows: Option<Vec<Vec<f64>>> = self
            .covariance_factor
            .iter()
            .map(|row| numbers(row))
            .collect();
        let factor = rows.filter(|rows| {
            rows.len() == values.len() && rows.iter().enumerate().all(|(i, row)| row.len() == i + 1)
        });
        let factor =
            factor.ok_or_else(|| wrong("covariance_factor: expected as many rows as values, the first of one number, each of one more"))?;
        let place = format!("{file_name}: [identified]");
        let recorded = Recorded {
            data_set: data_set.to_owned(),
            fitted_on: self.fitted_on,
            sample_rate_hz: self.sample_rate_hz,
            hold_before_sample: Timing::named(&place, &self.timing)? == Timing::HoldBeforeSample,
            intersample: intersample_named(&place, &self.intersample)?,
            sensor_lsb_um: self.sensor_lsb_um,
            starts: (self.start.into_iter().map(StartEntry::read))
                .collect::<std::result::Result<_, _>>()
                .map_err(|what| wrong(&format!("start: {what}")))?,
        };
        let out = Identified {
            values,
            factor,
            error_um: self.error_um,
            band_95: self.band_95,
            spread_share: self.spread_share,
            seconds: self.seconds,
            low_v: self.low_v,
            high_v: self.high_v,
            slope_max_v_s: self.slope_max_v_s,
            recorded,
        };
        let Identified {
            error_um,
            band_95,
            spread_share,
            seconds,
            low_v,
            high_v,
            slope_max_v_s,
            ..
        } = out;
        let rate_hz = out.recorded.sample_rate_hz;
        let figures = [
            error_um,
            band_95,
            spread_share,
            seconds,
            low_v,
            high_v,
            slope_max_v_s,
            rate_hz,
        ];
        if !figures.into_iter().all(f64::is_finite) {
            return Err(wrong("a figure is no number"));
        }
        Ok(out)
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectEntry {
    id: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    definition: Option<String>,
    #[serde(default)]
    parameter: Vec<ParameterEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterEntry {
    name: String,
    value: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    std: Option<f64>,
    #[serde(default)]
    unit: String,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    fixed: bool,
    lower: f64,
    upper: f64,
    /// Size of a change that matters; absent where ratios matter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    step: Option<f64>,
}

/// Whether a text is that of a model, as far as its schema tells.
#[must_use]
pub fn is_model(text: &str) -> bool {
    let schema = |line: &str| line.starts_with("schema") && line.contains(SCHEMA);
    text.lines().any(schema)
}

/// The text of a model with the data that it came from.
///
/// # Errors
/// When a value is no number.
/// ```
/// use hysteron::{EffectInstance, Model, Overview, effect_named, from_toml, to_toml};
///
/// let mut model = Model::new(0.0, 100.0);
/// model.add(EffectInstance::new(effect_named("gain")?, &Overview::without_data(0.0, 100.0), &[0.1]));
/// let text = to_toml(&model, "my stage")?;
/// assert_eq!(from_toml(&text, "model.toml")?.effect_ids(), ["gain"]);
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn to_toml(model: &Model, data_set: &str) -> Result<String> {
    let file = ModelFile {
        schema: SCHEMA.into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        data_set: data_set.into(),
        drive_min_v: model.drive_min_v,
        drive_max_v: model.drive_max_v,
        identified: model.identified.as_deref().map(IdentifiedEntry::of),
        effect: model
            .effects
            .iter()
            .map(|instance| EffectEntry {
                id: instance.id.clone(),
                definition: instance.effect.declaration().definition,
                parameter: instance
                    .parameters
                    .iter()
                    .map(|p| ParameterEntry {
                        name: p.parameter.name.clone(),
                        value: p.value,
                        std: p.std,
                        unit: p.parameter.unit.clone(),
                        fixed: p.parameter.fixed,
                        lower: p.parameter.lower,
                        upper: p.parameter.upper,
                        step: match p.parameter.scale {
                            Scale::Linear(step) => Some(step),
                            Scale::Logarithmic => None,
                        },
                    })
                    .collect(),
            })
            .collect(),
    };
    toml::to_string_pretty(&file).map_err(|e| Error::new("model", e))
}

/// Reads a model from its text; `file_name` is what the file is called in messages.
///
/// # Errors
/// Names the line, the effect or the parameter that is wrong.
pub fn from_toml(text: &str, file_name: &str) -> Result<Model> {
    let file: ModelFile = with_schema(text, file_name, SCHEMA)?;
    if file.drive_min_v.partial_cmp(&file.drive_max_v) != Some(std::cmp::Ordering::Less) {
        return Err(Error::new(
            file_name,
            "drive_min_v is not below drive_max_v",
        ));
    }
    if file.effect.is_empty() {
        return Err(Error::new(
            file_name,
            "has no [[effect]]; expected at least gain or a hysteresis",
        ));
    }
    let mut model = Model::new(file.drive_min_v, file.drive_max_v);
    let identified = file
        .identified
        .map(|entry| entry.read(file_name, &file.data_set))
        .transpose()?;
    for entry in file.effect {
        let place = format!("{file_name}: effect {}", entry.id);
        if model.effect(&entry.id).is_some() {
            return Err(Error::new(
                &place,
                "stands there twice; expected each effect once",
            ));
        }
        let effect: Arc<dyn Effect> = match (&entry.definition, entry.id.as_str()) {
            (Some(definition), _) => Arc::new(
                ExpressionEffect::from_toml(definition).map_err(|m| Error::new(&place, m))?,
            ),
            (None, id) => {
                let known = by_id(id).ok_or_else(|| {
                    Error::new(
                        &place,
                        format!("is not a known effect{}", nearest(id, &known_ids())),
                    )
                })?;
                known
                    .with_parameters(entry.parameter.len())
                    .unwrap_or(known)
            }
        };
        let mut parameters = Vec::new();
        for p in entry.parameter {
            if !p.value.is_finite() || !(p.lower..=p.upper).contains(&p.value) {
                return Err(Error::new(
                    &place,
                    format!(
                        "parameter {} = {} is outside {}..{}",
                        p.name, p.value, p.lower, p.upper
                    ),
                ));
            }
            let scale = p.step.map_or(Scale::Logarithmic, Scale::Linear);
            parameters.push(ParameterValue {
                parameter: Parameter {
                    name: p.name,
                    unit: p.unit,
                    lower: p.lower,
                    upper: p.upper,
                    scale,
                    fixed: p.fixed,
                    expected_steps: None,
                    of_a_grid: false,
                },
                value: p.value,
                std: p.std,
            });
        }
        let overview = Overview::without_data(model.drive_min_v, model.drive_max_v);
        let declared_parameters = effect.parameters(&overview);
        if parameters.len() != declared_parameters.len() {
            let names: Vec<String> = declared_parameters.into_iter().map(|p| p.name).collect();
            return Err(Error::new(
                &place,
                format!(
                    "has {} parameters; expected {}: {}",
                    parameters.len(),
                    names.len(),
                    names.join(", ")
                ),
            ));
        }
        for (found, declared) in parameters.iter_mut().zip(declared_parameters) {
            found.parameter.of_a_grid = declared.of_a_grid && found.parameter.fixed;
            found.parameter.expected_steps = declared.expected_steps;
            if found.parameter.name != declared.name {
                return Err(Error::new(
                    &place,
                    format!(
                        "parameter {}; expected {} there",
                        found.parameter.name, declared.name
                    ),
                ));
            }
            if found.parameter.unit != declared.unit {
                let (name, unit) = (&found.parameter.name, &found.parameter.unit);
                return Err(Error::new(
                    &place,
                    format!(
                        "parameter {name} is given in `{unit}`; expected `{}`",
                        declared.unit
                    ),
                ));
            }
            if let Some(std) = found.std.filter(|std| !(std.is_finite() && *std >= 0.0)) {
                return Err(Error::new(
                    &place,
                    format!(
                        "parameter {}: std = {std}; expected no negative number",
                        found.parameter.name
                    ),
                ));
            }
            if matches!(found.parameter.scale, Scale::Linear(step) if !(step > 0.0 && step.is_finite()))
            {
                return Err(Error::new(
                    &place,
                    format!("parameter {}: step is not positive", found.parameter.name),
                ));
            }
        }
        let before = model.effect_ids();
        model.add(EffectInstance {
            id: entry.id,
            effect,
            parameters,
        });
        if let Some(gone) = before.iter().find(|id| model.effect(id).is_none()) {
            return Err(Error::new(
                &place,
                format!("and {gone} both turn the drive into a displacement; expected one of them"),
            ));
        }
    }
    let known = |(effect, parameter): &(String, String)| {
        model
            .effect(effect)
            .is_some_and(|e| e.parameters.iter().any(|p| p.parameter.name == *parameter))
    };
    if let Some(value) = identified
        .iter()
        .flat_map(|i| &i.values)
        .find(|value| !known(value))
    {
        return Err(Error::new(
            file_name,
            format!(
                "[identified] values: the model has no {}.{}",
                value.0, value.1
            ),
        ));
    }
    model.identified = identified.map(Arc::new);
    Ok(model)
}

/// Identifiers of all built-in effects.
#[must_use]
pub fn known_ids() -> Vec<String> {
    registry().iter().map(|e| e.declaration().id).collect()
}

/// The built-in effect with this identifier.
///
/// # Errors
/// With the nearest known one.
pub fn effect_named(id: &str) -> Result<Arc<dyn Effect>> {
    by_id(id).ok_or_else(|| {
        let known = known_ids();
        Error::new(
            "effects",
            format!(
                "unknown effect `{id}`{}; known are {}",
                nearest(id, &known),
                known.join(", ")
            ),
        )
    })
}

/// The built-in effects of a list of identifiers, separated by commas, blanks or lines.
///
/// # Errors
/// An unknown identifier, with the nearest known one.
/// ```
/// let effects = hysteron::effects_named("hysteresis, creep")?;
/// assert_eq!(effects[1].declaration().id, "creep");
/// let error = hysteron::effects_named("crep").err().expect("no such effect");
/// assert!(error.to_string().contains("creep"), "{error}");
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn effects_named(list: &str) -> Result<Vec<Arc<dyn Effect>>> {
    list.split([',', '\n', ' '])
        .map(str::trim)
        .filter(|item| !item.is_empty())
        .map(effect_named)
        .collect()
}

/// An effect of the user's own from the text that defines it; `file_name` is what the file is called in
/// messages.
///
/// # Errors
/// What is wrong with the definition.
/// ```
/// let text = r#"
/// id = "contact"
/// place = "load_force"
/// output = "x - stiffness * max(x - 5, 0)"
/// [[parameter]]
/// name = "stiffness"
/// lower = 0.0
/// upper = 1.0
/// starts = [0.1]
/// "#;
/// let contact = hysteron::own_effect(text, "contact.toml")?;
/// assert_eq!(contact.declaration().id, "contact");
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn own_effect(text: &str, file_name: &str) -> Result<Arc<dyn Effect>> {
    ExpressionEffect::from_toml(text)
        .map(|e| Arc::new(e) as Arc<dyn Effect>)
        .map_err(|m| Error::new(file_name, m))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is expected of a coefficient goes with the range of the readings, which a file does not tell.
    #[test]
    fn a_model_that_is_read_expects_of_its_values_what_it_did() {
        let overview = Overview {
            range_um: 40.0,
            ..Overview::without_data(-95.0, 95.0)
        };
        let mut model = Model::new(-95.0, 95.0);
        for effect in registry() {
            model.add(EffectInstance::new(effect, &overview, &[]));
        }
        let read = from_toml(&to_toml(&model, "stage").unwrap(), "model.toml").unwrap();
        assert_eq!(read.effect_ids(), model.effect_ids());
        let mut expected = 0;
        for (found, before) in read.effects.iter().zip(&model.effects) {
            for (found, before) in found.parameters.iter().zip(&before.parameters) {
                assert_eq!(
                    found.parameter, before.parameter,
                    "{}",
                    before.parameter.name
                );
                expected += usize::from(before.parameter.expected_steps.is_some());
            }
        }
        assert!(expected > 0);
    }
}
