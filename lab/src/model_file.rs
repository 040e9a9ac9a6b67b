//! Models as files: a chain of effects that a person can read and edit, with units and standard deviations beside every value.

use crate::problem::{Problem, Result, nearest, write_whole};
use hysteron_sim::chain::{EffectInstance, Model, ParameterValue};
use hysteron_sim::effect::expression::ExpressionEffect;
use hysteron_sim::effect::hysteresis::{Hysteresis, degree_of};
use hysteron_sim::effect::initial_curve::InitialCurve;
use hysteron_sim::effect::{Effect, Overview, Parameter, Scale, by_id, registry};
use serde::{Deserialize, Serialize};
use std::path::Path;
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
    #[serde(default)]
    effect: Vec<EffectEntry>,
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

/// Writes a model with the data that it came from.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, model: &Model, data_set: &str) -> Result<()> {
    let file = ModelFile {
        schema: SCHEMA.into(),
        program_version: env!("CARGO_PKG_VERSION").into(),
        data_set: data_set.into(),
        drive_min_v: model.drive_min_v,
        drive_max_v: model.drive_max_v,
        effect: model
            .effects
            .iter()
            .map(|instance| EffectEntry {
                id: instance.id.clone(),
                definition: instance.effect.definition().map(str::to_string),
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
    let text = toml::to_string_pretty(&file).map_err(|e| Problem::file(path, e))?;
    write_whole(path, text.as_bytes())
}

/// Reads a model.
///
/// # Errors
/// Names the line, the effect or the parameter that is wrong.
pub fn read(path: &Path) -> Result<Model> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Problem::file(path, format!("cannot be read: {e}; expected a model written by `hysteron`")))?;
    let file: ModelFile = toml::from_str(&text).map_err(|e| {
        let line = e.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
        Problem::new(format!("{}: line {line}", path.display()), e.message())
    })?;
    if file.schema != SCHEMA {
        return Err(Problem::file(path, format!("schema = \"{}\"; expected \"{SCHEMA}\"", file.schema)));
    }
    if file.drive_min_v.partial_cmp(&file.drive_max_v) != Some(std::cmp::Ordering::Less) {
        return Err(Problem::file(path, "drive_min_v is not below drive_max_v"));
    }
    if file.effect.is_empty() {
        return Err(Problem::file(path, "has no [[effect]]; expected at least gain or a hysteresis"));
    }
    let mut model = Model::new(file.drive_min_v, file.drive_max_v);
    for entry in file.effect {
        let place = format!("{}: effect {}", path.display(), entry.id);
        let effect: Arc<dyn Effect> = match (&entry.definition, entry.id.as_str()) {
            (Some(definition), _) => Arc::new(ExpressionEffect::from_toml(definition).map_err(|m| Problem::new(&place, m))?),
            (None, "hysteresis") => Arc::new(Hysteresis { degree: degree_of(entry.parameter.len()) }),
            (None, "initial_curve") => Arc::new(InitialCurve { terms: entry.parameter.len() }),
            (None, id) => by_id(id).ok_or_else(|| Problem::new(&place, format!("is not a known effect{}", nearest(id, &known_ids()))))?,
        };
        let mut parameters = Vec::new();
        for p in entry.parameter {
            if !p.value.is_finite() || !(p.lower..=p.upper).contains(&p.value) {
                return Err(Problem::new(&place, format!("parameter {} = {} is outside {}..{}", p.name, p.value, p.lower, p.upper)));
            }
            let scale = p.step.map_or(Scale::Logarithmic, Scale::Linear);
            parameters.push(ParameterValue {
                parameter: Parameter { name: p.name, unit: p.unit, lower: p.lower, upper: p.upper, scale, fixed: p.fixed },
                value: p.value,
                std: p.std,
            });
        }
        let expected = match entry.id.as_str() {
            "hysteresis" => degree_of(parameters.len()) * (degree_of(parameters.len()) + 1) / 2,
            "initial_curve" => parameters.len().max(1),
            "creep" => parameters.len().max(2) / 2 * 2,
            _ => effect.parameters(&Overview::without_data(model.drive_min_v, model.drive_max_v)).len(),
        };
        if parameters.len() != expected {
            return Err(Problem::new(&place, format!("has {} parameters; expected {expected}", parameters.len())));
        }
        let overview = Overview::without_data(model.drive_min_v, model.drive_max_v);
        for (found, declared) in parameters.iter().zip(effect.parameters(&overview)) {
            if found.parameter.name != declared.name {
                return Err(Problem::new(&place, format!("parameter {}; expected {} there", found.parameter.name, declared.name)));
            }
            if matches!(found.parameter.scale, Scale::Linear(step) if !(step > 0.0 && step.is_finite())) {
                return Err(Problem::new(&place, format!("parameter {}: step is not positive", found.parameter.name)));
            }
        }
        model.add(EffectInstance { id: entry.id, effect, parameters });
    }
    Ok(model)
}

/// Identifiers of all built-in effects.
#[must_use]
pub fn known_ids() -> Vec<String> {
    registry().iter().map(|e| e.declaration().id).collect()
}

/// Reads a comma-separated list of effects: built-in identifiers, or files that define one.
///
/// # Errors
/// An unknown identifier, with the nearest known one; a definition that cannot be read.
pub fn parse_effects(list: &str) -> Result<Vec<Arc<dyn Effect>>> {
    list.split([',', '\n', ' '])
        .map(str::trim)
        .filter(|item| !item.is_empty())
        .map(|item| {
            if item.ends_with(".toml") {
                let path = Path::new(item);
                let text = std::fs::read_to_string(path).map_err(|e| Problem::file(path, format!("cannot be read: {e}")))?;
                return ExpressionEffect::from_toml(&text).map(|e| Arc::new(e) as Arc<dyn Effect>).map_err(|m| Problem::file(path, m));
            }
            by_id(item).ok_or_else(|| {
                Problem::new(
                    "effects",
                    format!("unknown effect `{item}`{}; known are {}", nearest(item, &known_ids()), known_ids().join(", ")),
                )
            })
        })
        .collect()
}
