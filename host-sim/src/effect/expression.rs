//! An effect that a user writes in a file: states, parameters, and expressions for derivatives and output.
//!
//! ```toml
//! id = "contact"
//! physics = "A one-sided spring presses back beyond a displacement."
//! place = "sensor_nonlinearity"          # a place in the chain
//! output = "x - stiffness * max(x - gap_um, 0)"
//! one_sided = true                       # only the direction of the start values makes sense
//! [[parameter]]
//! name = "stiffness"
//! unit = "1"
//! lower = 0.0
//! upper = 1.0
//! starts = [0.02]
//! [[parameter]]
//! name = "gap_um"
//! unit = "um"
//! lower = 0.0
//! upper = 20.0
//! starts = [2.0, 4.0, 6.0, 8.0]
//! [[state]]                              # optional
//! name = "z"
//! initial = 0.0
//! derivative = "(x - z) / tau_s"
//! ```
//!
//! Expressions know `x` (the input of the stage), `dx` (its rate per second), `t` (s since the start of the record), `force` (N), the
//! parameters and the states. States are advanced by the classical Runge-Kutta method with the input straight over the interval.
//! The starts of all parameters are combined, and each combination is a direction in which the effect may be found.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;
use exmex::{Express, FlatEx};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectFile {
    id: String,
    #[serde(default)]
    physics: String,
    #[serde(default)]
    reference: String,
    #[serde(default)]
    experiment: String,
    place: String,
    #[serde(default)]
    one_sided: bool,
    output: String,
    #[serde(default)]
    parameter: Vec<ParameterEntry>,
    #[serde(default)]
    state: Vec<StateEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterEntry {
    name: String,
    #[serde(default)]
    unit: String,
    lower: f64,
    upper: f64,
    starts: Vec<f64>,
    #[serde(default)]
    fixed: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StateEntry {
    name: String,
    #[serde(default)]
    initial: f64,
    derivative: String,
}

/// One compiled expression: where each of its variables stands in the common list of values.
#[derive(Clone, Debug)]
struct Compiled {
    expression: FlatEx<f64>,
    places: Vec<usize>,
}

impl Compiled {
    fn new(text: &str, names: &[String], field: &str) -> Result<Self, String> {
        let expression = FlatEx::<f64>::parse(text).map_err(|e| {
            // The parser shows its own data after the sentence.
            let said = e.to_string();
            let sentence = said.split(['{', '\n']).next().unwrap_or_default().trim_end_matches(|c: char| !c.is_alphanumeric());
            format!("{field}: cannot read the expression \"{text}\": {sentence}")
        })?;
        let places = expression
            .var_names()
            .iter()
            .map(|name| {
                names
                    .iter()
                    .position(|n| n == name)
                    .ok_or_else(|| format!("{field}: unknown name \"{name}\" in \"{text}\"; known are {}", names.join(", ")))
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self { expression, places })
    }

    fn evaluate(&self, values: &[f64], scratch: &mut Vec<f64>) -> f64 {
        scratch.clear();
        scratch.extend(self.places.iter().map(|&i| values[i]));
        self.expression.eval(scratch).unwrap_or(f64::NAN)
    }
}

/// An effect defined by expressions.
#[derive(Clone, Debug)]
pub struct ExpressionEffect {
    text: String,
    declaration: Declaration,
    parameters: Vec<Parameter>,
    starts: Vec<Vec<f64>>,
    initial: Vec<f64>,
    derivatives: Vec<Compiled>,
    output: Compiled,
}

/// Values that every expression knows, in front of parameters and states.
const GIVEN: [&str; 4] = ["x", "dx", "t", "force"];

impl ExpressionEffect {
    /// Reads the definition of an effect from the text of its file.
    ///
    /// # Errors
    /// Says which field is wrong and what was expected.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let file: EffectFile = toml::from_str(text).map_err(|e| e.to_string())?;
        let place = Place::NAMES
            .iter()
            .find(|(name, _)| *name == file.place)
            .map(|(_, place)| *place)
            .ok_or_else(|| format!("place: \"{}\" is none of {}", file.place, Place::NAMES.map(|(name, _)| name).join(", ")))?;
        if super::by_id(&file.id).is_some() {
            return Err(format!("id: \"{}\" is a built-in effect; choose another name", file.id));
        }
        let mut names: Vec<String> = GIVEN.iter().map(ToString::to_string).collect();
        for name in file.parameter.iter().map(|p| &p.name).chain(file.state.iter().map(|s| &s.name)) {
            if names.contains(name) {
                return Err(format!("name: \"{name}\" is defined twice"));
            }
            names.push(name.clone());
        }
        let mut parameters = Vec::new();
        let mut starts = vec![Vec::new()];
        for entry in &file.parameter {
            if entry.lower.partial_cmp(&entry.upper) != Some(std::cmp::Ordering::Less) || entry.starts.is_empty() {
                return Err(format!("parameter {}: expected lower < upper and at least one start", entry.name));
            }
            if let Some(start) = entry.starts.iter().find(|s| !(entry.lower..=entry.upper).contains(*s)) {
                return Err(format!("parameter {}: start {start} is outside {}..{}", entry.name, entry.lower, entry.upper));
            }
            let size = entry.starts.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
            let step = 0.02 * if size > 0.0 { size } else { entry.upper - entry.lower };
            let parameter = Parameter::linear(&entry.name, &entry.unit, entry.lower, entry.upper, step);
            parameters.push(if entry.fixed { parameter.fixed() } else { parameter });
            starts = starts
                .iter()
                .flat_map(|head: &Vec<f64>| entry.starts.iter().map(move |s| head.iter().copied().chain([*s]).collect()))
                .collect();
        }
        let output = Compiled::new(&file.output, &names, "output")?;
        let derivatives =
            file.state.iter().map(|s| Compiled::new(&s.derivative, &names, &format!("state {}", s.name))).collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            text: text.to_string(),
            declaration: Declaration {
                id: file.id,
                physics: file.physics,
                reference: file.reference,
                place,
                modifies: None,
                experiment: file.experiment,
                candidate: true,
                one_sided: file.one_sided,
            },
            parameters,
            starts,
            initial: file.state.iter().map(|s| s.initial).collect(),
            derivatives,
            output,
        })
    }
}

struct ExpressionStage<'a> {
    effect: ExpressionEffect,
    values: Vec<f64>,
    states: std::ops::Range<usize>,
    input: f64,
    dt_s: f64,
    force_n: Option<&'a [f64]>,
    scratch: Vec<f64>,
}

impl ExpressionStage<'_> {
    fn derivatives(&mut self, states: &[f64], x: f64, t_s: f64) -> Vec<f64> {
        self.values[self.states.clone()].copy_from_slice(states);
        self.values[0] = x;
        self.values[2] = t_s;
        let (effect, values, scratch) = (&self.effect, &self.values, &mut self.scratch);
        effect.derivatives.iter().map(|d| d.evaluate(values, scratch)).collect()
    }

    fn advance(&mut self, k: usize, input: f64) {
        let (h, start) = (self.dt_s, self.values[self.states.clone()].to_vec());
        let t_s = k as f64 * h;
        let moved = |d: &[f64], f: f64| -> Vec<f64> { start.iter().zip(d).map(|(s, d)| s + f * h * d).collect() };
        let middle = 0.5 * (self.input + input);
        let k1 = self.derivatives(&start.clone(), self.input, t_s);
        let k2 = self.derivatives(&moved(&k1, 0.5), middle, t_s + 0.5 * h);
        let k3 = self.derivatives(&moved(&k2, 0.5), middle, t_s + 0.5 * h);
        let k4 = self.derivatives(&moved(&k3, 1.0), input, t_s + h);
        for (i, s) in start.iter().enumerate() {
            self.values[self.states.start + i] = s + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
}

impl Stage for ExpressionStage<'_> {
    fn step(&mut self, k: usize, input: f64) -> f64 {
        self.values[1] = (input - self.input) / self.dt_s;
        self.values[3] = self.force_n.and_then(|f| f.get(k)).copied().unwrap_or(0.0);
        if !self.states.is_empty() {
            self.advance(k, input);
        }
        self.input = input;
        self.values[0] = input;
        self.values[2] = (k + 1) as f64 * self.dt_s;
        self.effect.output.evaluate(&self.values, &mut self.scratch)
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.input = input;
        self.values[0] = input;
        self.effect.output.evaluate(&self.values, &mut self.scratch)
    }
}

impl Effect for ExpressionEffect {
    fn declaration(&self) -> Declaration {
        self.declaration.clone()
    }
    fn definition(&self) -> Option<&str> {
        Some(&self.text)
    }
    fn parameters(&self, _overview: &Overview) -> Vec<Parameter> {
        self.parameters.clone()
    }
    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        self.starts.clone()
    }
    fn stage<'a>(&self, _model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        let mut all = vec![0.0; GIVEN.len()];
        all.extend_from_slice(values);
        let states = all.len()..all.len() + self.initial.len();
        all.extend_from_slice(&self.initial);
        Some(Box::new(ExpressionStage {
            effect: self.clone(),
            values: all,
            states,
            input: 0.0,
            dt_s: setting.dt_s,
            force_n: setting.force_n,
            scratch: Vec::new(),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_lag_is_the_built_in_lag() {
        let effect = ExpressionEffect::from_toml(
            "id = \"lag\"\nplace = \"sensor_bandwidth\"\noutput = \"z\"\n[[parameter]]\nname = \"tau_s\"\nlower = 1e-6\nupper = 1.0\nstarts = [1e-3]\n[[state]]\nname = \"z\"\nderivative = \"(x - z) / tau_s\"\n",
        )
        .unwrap();
        let setting = Setting { dt_s: 1e-4, substeps: 1, force_n: None, drive_min_v: 0.0, drive_max_v: 1.0 };
        let mut stage = effect.stage(&Model::new(0.0, 1.0), &[1e-3], &setting).unwrap();
        for k in 0..50 {
            let t = f64::from(k + 1) * 1e-4;
            let y = stage.step(k as usize, t);
            assert!((y - (t - 1e-3 * (1.0 - (-t / 1e-3).exp()))).abs() < 1e-8);
        }
    }

    #[test]
    fn errors_name_the_field() {
        let message = ExpressionEffect::from_toml("id = \"a\"\nplace = \"nowhere\"\noutput = \"x\"\n").unwrap_err();
        assert!(message.contains("nowhere") && message.contains("vibration"));
        let message = ExpressionEffect::from_toml("id = \"a\"\nplace = \"drift\"\noutput = \"x + q\"\n").unwrap_err();
        assert!(message.contains("\"q\""));
    }
}
