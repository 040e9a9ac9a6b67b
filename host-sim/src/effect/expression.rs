//! An effect that a user writes in a file: states, parameters, and expressions for derivatives and output.
//!
//! ```toml
//! id = "contact"
//! physics = "A one-sided spring presses back beyond a displacement."
//! place = "sensor_nonlinearity"          # a place in the chain
//! output = "x - stiffness * max(x - gap_um, 0)"
//! one_sided = true                       # only the direction of the start values makes sense
//! auxiliary = ["temperature_c"]          # optional: signals recorded beside drive and displacement
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
//! Expressions ([`super::formula`]) know `x` (the input of the stage), `dx` (its rate per second), `t` (s
//! since the start of the record), `u` (the drive, V), `force` (N), the signals that `auxiliary` lists, the
//! parameters and the states. States are advanced by the classical Runge-Kutta method with the input straight
//! over the interval, in as many parts as their fastest one asks for. The starts of all parameters are
//! combined, and each combination is a direction in which the effect may be found.

use super::formula::Formula;
use crate::block::{Block, Written};
use crate::physics::*;
use nalgebra::DMatrix;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
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
    #[serde(default)]
    auxiliary: Vec<String>,
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

/// An effect defined by expressions.
#[derive(Clone, Debug)]
pub struct ExpressionEffect {
    declaration: Declaration,
    parameters: Vec<Parameter>,
    starts: Vec<Vec<f64>>,
    initial: Vec<f64>,
    derivatives: Vec<Formula>,
    output: Formula,
}

/// Values that every expression knows, in front of auxiliary signals, parameters and states.
const GIVEN: [&str; 5] = ["x", "dx", "t", "u", "force"];
/// The rate of the fastest state times the length of a part of an interval is at most this: well inside what
/// the method keeps stable.
const RATE_TIMES_PART_MAX: f64 = 0.25;
/// Beyond this the method is about to become unstable: where a signal makes a state this fast, the interval
/// is taken again in more parts.
const RATE_TIMES_PART_UNSTABLE: f64 = 2.0;
/// Differences below this share of the states are rounding and tell no rate.
const ROUNDING: f64 = 1e-7;
/// Whether every expression knows a name.
#[must_use]
pub fn is_given(name: &str) -> bool {
    GIVEN.contains(&name)
}

/// Most combinations of the starts of all parameters: each is a direction in which the effect is looked for.
const DIRECTIONS_MAX: usize = 256;
/// Most parts of an interval; a faster state becomes NaN.
const PARTS_MAX: f64 = 256.0;

impl ExpressionEffect {
    /// Reads the definition of an effect from the text of its file.
    ///
    /// # Errors
    /// Says which field is wrong and what was expected.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let file: EffectFile = toml::from_str(text).map_err(|e| e.to_string())?;
        let place = place_named(&file.place)?;
        check_id(&file.id)?;
        let names = file.names()?;
        let (parameters, starts) = file.parameters_and_starts()?;
        let read = |text: &str, field: &str| {
            Formula::read(text, &names).map_err(|message| format!("{field}: {message}"))
        };
        let output = read(&file.output, "output")?;
        let derivative =
            |state: &StateEntry| read(&state.derivative, &format!("state {}", state.name));
        let derivatives = file
            .state
            .iter()
            .map(derivative)
            .collect::<Result<Vec<_>, _>>()?;
        let drive = GIVEN.iter().position(|name| *name == "u").unwrap_or(0);
        let takes_drive = |formula: &Formula| formula.uses(drive);
        Ok(Self {
            declaration: Declaration {
                id: file.id,
                physics: file.physics,
                reference: file.reference,
                experiment: file.experiment,
                one_sided: file.one_sided,
                follows_record: !file.auxiliary.is_empty()
                    || derivatives.iter().chain([&output]).any(takes_drive),
                auxiliary: file.auxiliary,
                definition: Some(text.to_string()),
                ..Declaration::at(place)
            },
            parameters,
            starts,
            initial: file.state.iter().map(|s| s.initial).collect(),
            derivatives,
            output,
        })
    }
}

fn place_named(wanted: &str) -> Result<Place, String> {
    let found = Place::NAMES.iter().find(|(name, _)| *name == wanted);
    found.map(|(_, place)| *place).ok_or_else(|| {
        format!(
            "place: \"{wanted}\"; expected one of {}",
            Place::NAMES.map(|(name, _)| name).join(", ")
        )
    })
}

fn check_id(id: &str) -> Result<(), String> {
    let mut characters = id.chars();
    let begins = characters
        .next()
        .is_some_and(|c| c.is_alphabetic() || c == '_');
    if !begins || characters.any(|c| !(c.is_alphanumeric() || c == '_')) {
        return Err(format!(
            "id: \"{id}\"; expected letters, digits and _, as in self_heating"
        ));
    }
    if super::by_id(id).is_some() {
        return Err(format!(
            "id: \"{id}\" is a built-in effect; choose another name"
        ));
    }
    Ok(())
}

impl EffectFile {
    /// The names that its expressions know, in the order of their values.
    fn names(&self) -> Result<Vec<String>, String> {
        let mut names: Vec<String> = GIVEN.iter().map(ToString::to_string).collect();
        let parameters = self.parameter.iter().map(|p| &p.name);
        let own = parameters.chain(self.state.iter().map(|s| &s.name));
        for name in self.auxiliary.iter().chain(own) {
            if names.contains(name) {
                return Err(format!("name: \"{name}\" is defined twice"));
            }
            names.push(name.clone());
        }
        Ok(names)
    }

    /// Its parameters, and every combination of their starts.
    fn parameters_and_starts(&self) -> Result<(Vec<Parameter>, Vec<Vec<f64>>), String> {
        let mut parameters = Vec::new();
        let mut starts = vec![Vec::new()];
        for entry in &self.parameter {
            parameters.push(entry.parameter()?);
            if starts.len().saturating_mul(entry.starts.len()) > DIRECTIONS_MAX {
                return Err(format!(
                    "parameter {}: the starts of all parameters make more than {DIRECTIONS_MAX} combinations; expected fewer starts",
                    entry.name
                ));
            }
            let with_each = |head: &Vec<f64>| {
                let each = entry.starts.iter();
                each.map(|s| [&head[..], &[*s]].concat())
                    .collect::<Vec<_>>()
            };
            starts = starts.iter().flat_map(with_each).collect();
        }
        Ok((parameters, starts))
    }
}

impl ParameterEntry {
    fn parameter(&self) -> Result<Parameter, String> {
        let Self {
            name, lower, upper, ..
        } = self;
        if lower.partial_cmp(upper) != Some(std::cmp::Ordering::Less) || self.starts.is_empty() {
            return Err(format!(
                "parameter {name}: expected lower < upper and at least one start"
            ));
        }
        if let Some(start) = self.starts.iter().find(|s| !(lower..=upper).contains(s)) {
            return Err(format!(
                "parameter {name}: start {start} is outside {lower}..{upper}"
            ));
        }
        let size = self.starts.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
        let step = 0.02 * if size > 0.0 { size } else { upper - lower };
        let parameter = Parameter::linear(name, &self.unit, *lower, *upper, step);
        Ok(if self.fixed {
            parameter.fixed()
        } else {
            parameter
        })
    }
}

struct ExpressionStage<'a> {
    effect: ExpressionEffect,
    /// In the order of the names: given, auxiliary, parameters, states.
    values: Vec<f64>,
    states: std::ops::Range<usize>,
    input: f64,
    setting: Setting<'a>,
    /// In how many parts an interval is taken.
    parts: usize,
    /// Units of the states in which their rates are compared.
    units: Vec<f64>,
    /// Signals by their place among the values.
    signals: Vec<(usize, &'a [f64])>,
    room: Vec<f64>,
}

/// The least power of two of parts, so that few values of a parameter change their number; `None` beyond what
/// is followed.
fn parts_for(rate_times_interval: f64) -> Option<usize> {
    let parts = (rate_times_interval / RATE_TIMES_PART_MAX).max(1.0);
    (parts <= PARTS_MAX).then(|| (parts.ceil() as usize).next_power_of_two())
}

impl ExpressionStage<'_> {
    fn derivatives(&mut self, states: &[f64], x: f64, t_s: f64) -> Vec<f64> {
        self.values[self.states.clone()].copy_from_slice(states);
        self.values[0] = x;
        self.values[2] = t_s;
        let (effect, values, room) = (&self.effect, &self.values, &mut self.room);
        effect
            .derivatives
            .iter()
            .map(|d| d.evaluate(values, room))
            .collect()
    }

    /// One interval, in as many parts as the values ask for; in more where the signal makes a state faster
    /// yet. Fits take differences of what comes out, so that the number of parts must not follow the signal
    /// without need.
    fn advance(&mut self, k: usize, input: f64) {
        let start = self.values[self.states.clone()].to_vec();
        let rate = self.in_parts(k, input, self.parts, &start);
        if rate * self.setting.dt_s / self.parts as f64 > RATE_TIMES_PART_UNSTABLE {
            match parts_for(rate * self.setting.dt_s) {
                Some(parts) => {
                    self.in_parts(k, input, parts, &start);
                }
                None => self.values[self.states.clone()].fill(f64::NAN),
            }
        }
    }

    /// The interval in equal parts; gives the largest rate that was met.
    fn in_parts(&mut self, k: usize, input: f64, parts: usize, start: &[f64]) -> f64 {
        let (mut states, mut fastest) = (start.to_vec(), 0.0_f64);
        for part in 0..parts {
            fastest = fastest.max(self.runge_kutta(k, input, parts, part, &states));
            states.copy_from_slice(&self.values[self.states.clone()]);
        }
        fastest
    }

    /// The rate of the fastest state, 1/s, at the beginning: the largest row sum of the derivatives by the
    /// states, at rest with inputs 0 and 1. States are first scaled to balance that matrix (B. N. Parlett and
    /// C. Reinsch, *Numer. Math.* 13 (1969) 293), so that the rate does not depend on their units.
    fn rate_at_rest(&mut self) -> f64 {
        let start = self.values[self.states.clone()].to_vec();
        let mut sizes = DMatrix::<f64>::zeros(start.len(), start.len());
        for x in [0.0, 1.0] {
            for (j, state) in start.iter().enumerate() {
                let step = 1e-6 * (1.0 + state.abs());
                let mut moved = start.clone();
                moved[j] = state + step;
                let up = self.derivatives(&moved, x, 0.0);
                moved[j] = state - step;
                let down = self.derivatives(&moved, x, 0.0);
                for (size, (up, down)) in sizes.column_mut(j).iter_mut().zip(up.iter().zip(&down)) {
                    let slope = (up - down).abs() / (2.0 * step);
                    // What has no value there says nothing.
                    *size = if slope.is_finite() {
                        size.max(slope)
                    } else {
                        *size
                    };
                }
            }
        }
        self.values[self.states.clone()].copy_from_slice(&start);
        let units = balance_parlett_reinsch(&mut sizes);
        self.units = units.iter().copied().collect();
        sizes.row_iter().map(|row| row.sum()).fold(0.0, f64::max)
    }

    /// One part of an interval; gives the rate of the fastest state, 1/s, as far as the steps of the method
    /// show it (L. F. Shampine, *Math. Comp.* 31 (1977) 66).
    fn runge_kutta(
        &mut self,
        k: usize,
        input: f64,
        parts: usize,
        part: usize,
        start: &[f64],
    ) -> f64 {
        let h = self.setting.dt_s / parts as f64;
        let t_s = k as f64 * self.setting.dt_s + part as f64 * h;
        let along =
            |share: f64| self.input + (input - self.input) * (part as f64 + share) / parts as f64;
        let (first, middle, last) = (along(0.0), along(0.5), along(1.0));
        let moved = |d: &[f64], f: f64| -> Vec<f64> {
            start.iter().zip(d).map(|(s, d)| s + f * h * d).collect()
        };
        let k1 = self.derivatives(start, first, t_s);
        let k2 = self.derivatives(&moved(&k1, 0.5), middle, t_s + 0.5 * h);
        let k3 = self.derivatives(&moved(&k2, 0.5), middle, t_s + 0.5 * h);
        let k4 = self.derivatives(&moved(&k3, 1.0), last, t_s + h);
        for (i, s) in start.iter().enumerate() {
            self.values[self.states.start + i] =
                s + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
        let largest = |each: &mut dyn Iterator<Item = f64>| {
            each.zip(&self.units)
                .fold(0.0_f64, |m, (v, unit)| m.max(v.abs() / unit))
        };
        let farthest = |a: &[f64], b: &[f64]| largest(&mut a.iter().zip(b).map(|(a, b)| a - b));
        let (apart, answers) = (0.5 * h * farthest(&k2, &k1), farthest(&k3, &k2));
        let size = largest(&mut start.iter().zip(&k1).map(|(s, d)| s.abs().max(h * d.abs())));
        if apart > ROUNDING * size {
            answers / apart
        } else {
            0.0
        }
    }

    /// What was recorded, on this interval.
    fn take_signals(&mut self, k: usize) {
        for (at, signal) in &self.signals {
            self.values[*at] = self.setting.held(signal, k);
        }
    }
}

impl Stage for ExpressionStage<'_> {
    fn step(&mut self, k: usize, input: f64) -> f64 {
        self.values[1] = (input - self.input) / self.setting.dt_s;
        self.take_signals(k);
        if !self.states.is_empty() {
            self.advance(k, input);
        }
        self.input = input;
        self.values[0] = input;
        self.values[2] = (k + 1) as f64 * self.setting.dt_s;
        self.effect.output.evaluate(&self.values, &mut self.room)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let Self {
            effect,
            values,
            states,
            ..
        } = self;
        let (drive, first_recorded) = (3, GIVEN.len());
        let own = first_recorded + effect.declaration.auxiliary.len();
        let all = || effect.derivatives.iter().chain([&effect.output]);
        if all().any(|formula| formula.uses(drive)) {
            return Err("it takes the drive beside its input");
        }
        if (first_recorded..own).any(|at| all().any(|formula| formula.uses(at))) {
            return Err("it takes signals that are recorded beside the drive");
        }
        if !states.is_empty() && values[states.clone()].iter().any(|value| value.is_nan()) {
            return Err("its states are too fast for the sampling rate");
        }
        let given = ["now", "rate", "time", "u", "force"].map(str::to_owned);
        let recorded = effect.declaration.auxiliary.iter().cloned();
        let parameters = values[own..states.start]
            .iter()
            .map(|value| format!("({value:e})"));
        let names: Vec<String> = given
            .into_iter()
            .chain(recorded)
            .chain(parameters)
            .chain((0..states.len()).map(|i| format!("q{i}")))
            .collect();
        let derivative = |(i, formula): (usize, &Formula)| formula.as_law(&names, &format!("d{i}"));
        Ok(vec![Block::Written(Written {
            output: effect.output.as_law(&names, "y"),
            derivatives: effect
                .derivatives
                .iter()
                .enumerate()
                .map(derivative)
                .collect(),
            states: effect
                .initial
                .iter()
                .zip(&self.units)
                .map(|(first, unit)| [*first, *unit])
                .collect(),
            dt_s: self.setting.dt_s,
            parts: self.parts,
        })])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.input = input;
        self.values[0] = input;
        self.take_signals(0);
        self.effect.output.evaluate(&self.values, &mut self.room)
    }
}

impl Effect for ExpressionEffect {
    fn declaration(&self) -> Declaration {
        self.declaration.clone()
    }

    fn parameters(&self, _overview: &Overview) -> Vec<Parameter> {
        self.parameters.clone()
    }

    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        self.starts.clone()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let recorded = from.setting.signals;
        let mut signals = vec![(3, recorded.drive_v), (4, recorded.force_n.unwrap_or(&[]))];
        for (i, name) in self.declaration.auxiliary.iter().enumerate() {
            let found = recorded
                .auxiliary
                .iter()
                .find(|signal| signal.name == *name);
            signals.push((GIVEN.len() + i, found.map_or(&[], |signal| &signal.values)));
        }
        let mut all = vec![0.0; GIVEN.len() + self.declaration.auxiliary.len()];
        all.extend_from_slice(from.values);
        let states = all.len()..all.len() + self.initial.len();
        all.extend_from_slice(&self.initial);
        let mut stage = ExpressionStage {
            effect: self.clone(),
            values: all,
            states,
            input: 0.0,
            setting: *from.setting,
            parts: 1,
            units: vec![1.0; self.initial.len()],
            signals,
            room: Vec::new(),
        };
        match parts_for(stage.rate_at_rest() * from.setting.dt_s) {
            Some(parts) => stage.parts = parts,
            // The first step gives NaN, where the caller can name the record.
            None => stage.values[stage.states.clone()].fill(f64::NAN),
        }
        Some(Box::new(stage))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{AuxiliarySignal, Signals};
    use super::*;

    fn setting(dt_s: f64) -> Setting<'static> {
        Setting::of_held_drive(0.0, 1.0, dt_s)
    }

    fn stage_of<'a>(
        effect: &ExpressionEffect,
        values: &[f64],
        setting: &Setting<'a>,
    ) -> Box<dyn Stage + 'a> {
        let model = &Model::new(0.0, 1.0);
        let from = Build {
            model,
            values,
            setting,
        };
        effect.stage(&from).unwrap()
    }

    #[test]
    fn a_written_lag_is_the_built_in_lag() {
        let effect = ExpressionEffect::from_toml(
            "id = \"lag\"\nplace = \"sensor_bandwidth\"\noutput = \"z\"\n[[parameter]]\nname = \"tau_s\"\nlower = 1e-6\nupper = 1.0\nstarts = [1e-3]\n[[state]]\nname = \"z\"\nderivative = \"(x - z) / tau_s\"\n",
        )
        .unwrap();
        // The third is sixty times as fast as the sampling.
        for (tau_s, dt_s) in [(1e-3, 1e-4), (1e-4, 1e-4), (1e-3, 0.06)] {
            let mut stage = stage_of(&effect, &[tau_s], &setting(dt_s));
            for k in 0..50 {
                let t = f64::from(k + 1) * dt_s;
                let y = stage.step(k as usize, t);
                let expected = t - tau_s * (1.0 - (-t / tau_s).exp());
                assert!(
                    (y - expected).abs() < 1e-4 * expected,
                    "{tau_s} s every {dt_s} s: {y} instead of {expected}"
                );
            }
        }
        let mut stage = stage_of(&effect, &[1e-6], &setting(0.1));
        assert!(
            stage.step(0, 1.0).is_nan(),
            "a state that cannot be followed is abandoned, not followed wrongly"
        );
    }

    /// A mode of 1.2 kHz by its displacement and its velocity, the velocity in a unit of `1 / per` um/s.
    fn written_mode(per: f64) -> ExpressionEffect {
        let w = 2.0 * std::f64::consts::PI * 1200.0;
        ExpressionEffect::from_toml(&format!(
            "id = \"mode\"\nplace = \"vibration\"\noutput = \"z\"\n[[parameter]]\nname = \"zeta\"\nlower = 0.0\nupper = 1.0\nstarts = [0.02]\n[[state]]\nname = \"z\"\nderivative = \"v / {per}\"\n[[state]]\nname = \"v\"\nderivative = \"{per} * ({w} * {w} * (x - z)) - 2 * zeta * {w} * v\"\n"
        ))
        .unwrap()
    }

    #[test]
    fn a_written_mode_is_the_same_in_any_unit_of_its_velocity() {
        let (dt_s, zeta) = (5e-5, 0.02);
        let steps = |per: f64| -> Vec<f64> {
            let effect = written_mode(per);
            let mut stage = stage_of(&effect, &[zeta], &setting(dt_s));
            stage.settle(1.0);
            (0..400).map(|k| stage.step(k, 1.0)).collect()
        };
        // Of a step of 1 um; the first in physical units, um and um/s.
        let (w, after) = (2.0 * std::f64::consts::PI * 1200.0, |k: usize| {
            (k + 1) as f64 * dt_s
        });
        for per in [1.0, 1e6, 1e-6] {
            for (k, y) in steps(per).into_iter().enumerate() {
                let (decay, wd) = ((-zeta * w * after(k)).exp(), w * (1.0 - zeta * zeta).sqrt());
                let turned = (wd * after(k)).cos() + zeta * w / wd * (wd * after(k)).sin();
                let expected = 1.0 - decay * turned;
                assert!(
                    (y - expected).abs() < 5e-3,
                    "1 / {per} um/s, sample {k}: {y} instead of {expected}"
                );
            }
        }
    }

    #[test]
    fn recorded_signals_are_known_by_name_on_every_sub_interval() {
        let text = "id = \"warm\"\nplace = \"drift\"\nauxiliary = [\"temperature_c\"]\noutput = \"x + temperature_c + 10 * u + 100 * force\"\n";
        let effect = ExpressionEffect::from_toml(text).unwrap();
        let declaration = effect.declaration();
        assert!(declaration.follows_record && declaration.auxiliary == ["temperature_c"]);
        let auxiliary = [AuxiliarySignal {
            name: "temperature_c".into(),
            values: vec![1.0, 2.0],
        }];
        let signals = Signals {
            drive_v: &[3.0, 4.0],
            force_n: Some(&[5.0, 6.0]),
            auxiliary: &auxiliary,
        };
        let mut stage = stage_of(
            &effect,
            &[],
            &Setting {
                substeps: 2,
                signals,
                ..setting(1e-3)
            },
        );
        let found: Vec<f64> = (0..4).map(|k| stage.step(k, 0.5)).collect();
        assert_eq!(found, [531.5, 531.5, 642.5, 642.5]);
    }

    #[test]
    fn errors_name_the_field() {
        let many: String = ["a", "b", "c"]
            .map(|name| {
                format!("[[parameter]]\nname = \"{name}\"\nlower = 0.0\nupper = 9.0\nstarts = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]\n")
            })
            .concat();
        let message = ExpressionEffect::from_toml(&format!(
            "id = \"m\"\nplace = \"drift\"\noutput = \"x + a * b * c\"\n{many}"
        ))
        .unwrap_err();
        assert!(
            message.contains("parameter c") && message.contains("256"),
            "{message}"
        );
        let message =
            ExpressionEffect::from_toml("id = \"my, effect\"\nplace = \"drift\"\noutput = \"x\"\n")
                .unwrap_err();
        assert!(message.contains("letters"), "{message}");
        let message =
            ExpressionEffect::from_toml("id = \"a\"\nplace = \"nowhere\"\noutput = \"x\"\n")
                .unwrap_err();
        assert!(message.contains("nowhere") && message.contains("vibration"));
        let message =
            ExpressionEffect::from_toml("id = \"a\"\nplace = \"drift\"\noutput = \"x + q\"\n")
                .unwrap_err();
        assert!(message.contains("\"q\""));
    }
}
