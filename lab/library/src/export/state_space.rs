//! The linear part of a model as a state space, with what its parameters' deviations make of it.
//!
//! The sampled matrices come from the blocks of the model, probed state by state, with the hysteresis
//! replaced by one gain: they give the readings of the program for a linear model. The continuous matrices
//! are those of the physical equations, the dead time beside them.

use super::text::cannot;
use crate::error::{Error, Result};
use crate::loop_figures::loop_figures;
use hysteron_sim::block::Block;
use hysteron_sim::block_chain::BlockChain;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::{
    Place, amplifier_bandwidth, by_id, creep, delay, gain, mass_change, second_mode,
    sensor_bandwidth, sensor_filter, vibration,
};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::linear_system::ContinuousSystem;
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};
use std::f64::consts::TAU;

/// Effects whose equations are linear and know no signal but the drive.
fn is_linear(id: &str) -> bool {
    let others = [
        gain::ID,
        delay::ID,
        amplifier_bandwidth::ID,
        vibration::ID,
        second_mode::ID,
        mass_change::ID,
        creep::ID,
    ];
    others.contains(&id)
        || [sensor_bandwidth::ID, sensor_filter::ID, "charge_leakage"].contains(&id)
}

/// The model with one gain in the place of its loops, and the effects that are left out.
fn linear_part(model: &Model, gain_um_v: f64) -> (Model, Vec<String>) {
    let mut out = Model::new(model.drive_min_v, model.drive_max_v);
    let overview =
        hysteron_sim::effect::Overview::without_data(model.drive_min_v, model.drive_max_v);
    out.effects = model
        .effects
        .iter()
        .filter(|e| is_linear(&e.id) && e.id != gain::ID)
        .cloned()
        .collect();
    if let Some(effect) = by_id(gain::ID) {
        out.add(EffectInstance::new(effect, &overview, &[gain_um_v]));
    }
    let in_its_place = |e: &&EffectInstance| {
        e.effect.declaration().place != Place::Hysteresis && !is_linear(&e.id)
    };
    (
        out,
        model
            .effects
            .iter()
            .filter(in_its_place)
            .map(|e| e.id.clone())
            .collect(),
    )
}

pub(super) fn text(model: &Model, sample_rate_hz: f64) -> Result<String> {
    let value = matrices(model, sample_rate_hz)?;
    serde_json::to_string_pretty(&value)
        .map(|text| text + "\n")
        .map_err(|e| Error::new("export", e))
}

fn matrices(model: &Model, sample_rate_hz: f64) -> Result<Value> {
    let loops = loop_figures(model).ok_or_else(|| {
        Error::new(
            "export",
            "the model has neither a gain nor a hysteresis; expected one of them",
        )
    })?;
    let (linear, left_out) = linear_part(model, loops.gain_um_v);
    let of = |linear: &Model| -> Result<(Value, Value)> {
        let chain = BlockChain::of(linear, 1.0 / sample_rate_hz, Intersample::Hold)
            .map_err(|refused| cannot(&refused))?;
        Ok((sampled(&chain), written(&continuous(linear))))
    };
    let (discrete, in_time) = of(&linear)?;
    let mut uncertainty = Vec::new();
    for (e, instance) in linear.effects.iter().enumerate() {
        for (p, value) in instance.parameters.iter().enumerate() {
            let std = if instance.id == gain::ID {
                model.effect(gain::ID).and_then(|g| g.parameters[0].std)
            } else {
                value.std
            };
            let Some(std) = std.filter(|std| *std > 0.0) else {
                continue;
            };
            let moved = |by: f64| {
                let mut moved = linear.clone();
                let changed = &mut moved.effects[e].parameters[p];
                changed.value =
                    (changed.value + by).clamp(changed.parameter.lower, changed.parameter.upper);
                moved
            };
            let (plus, minus) = (of(&moved(std))?, of(&moved(-std))?);
            uncertainty.push(json!({
                "effect": instance.id, "parameter": value.parameter.name, "value": value.value, "std": std, "unit": value.parameter.unit,
                "plus_one_std": { "sampled": plus.0, "continuous": plus.1 },
                "minus_one_std": { "sampled": minus.0, "continuous": minus.1 },
            }));
        }
    }
    Ok(json!({
        "schema": "hysteron.state_space/1",
        "input": "drive above drive_min_v, V",
        "output": "reading less that at rest, um",
        "drive_min_v": model.drive_min_v,
        "drive_max_v": model.drive_max_v,
        "sample_rate_hz": sample_rate_hz,
        "delay_s": linear.values(delay::ID).map_or(0.0, |v| v[0]),
        "gain_um_v": { "mean": loops.gain_um_v, "least": loops.least_slope_um_v, "largest": loops.largest_slope_um_v },
        "sampled": discrete,
        "continuous": in_time,
        "uncertainty": uncertainty,
        "left_out": left_out,
    }))
}

/// The states of the blocks side by side, and what one period makes of them.
struct Period<'c> {
    chain: &'c BlockChain,
}

impl Period<'_> {
    /// States of one block.
    fn states(block: &Block) -> usize {
        match block {
            Block::Linear(l) => l.rest.len() + 1,
            Block::Delay { whole, .. } => whole + 1,
            _ => 0,
        }
    }

    /// All states, the last reading among them.
    fn count(&self) -> usize {
        self.chain
            .blocks
            .iter()
            .map(|placed| Self::states(&placed.block))
            .sum::<usize>()
            + 1
    }

    /// One period with the input held: the states after it, the last of which is the reading.
    fn after(&self, mut states: Vec<f64>, input: f64) -> Vec<f64> {
        let (mut at, mut values) = (0, vec![input]);
        for placed in &self.chain.blocks {
            if placed.fine && values.len() == 1 {
                values = vec![values[0]; self.chain.substeps];
            } else if !placed.fine {
                values = vec![values[values.len() - 1]];
            }
            let n = Self::states(&placed.block);
            let own = &mut states[at..at + n];
            values
                .iter_mut()
                .for_each(|x| *x = Self::step(&placed.block, own, *x));
            at += n;
        }
        states[at] = values[values.len() - 1];
        states
    }

    fn step(block: &Block, states: &mut [f64], x: f64) -> f64 {
        match block {
            Block::Proportional { gain, .. } => gain * x,
            Block::Linear(l) => {
                let n = l.rest.len();
                let last = states[n];
                let y = l.out.iter().zip(&*states).map(|(c, s)| c * s).sum::<f64>()
                    + l.before * last
                    + l.through * x;
                let next: Vec<f64> = (0..n)
                    .map(|i| {
                        l.phi[i]
                            .iter()
                            .zip(&*states)
                            .map(|(p, s)| p * s)
                            .sum::<f64>()
                            + l.start[i] * last
                            + l.end[i] * x
                    })
                    .collect();
                states[..n].copy_from_slice(&next);
                states[n] = x;
                y
            }
            Block::Delay { late_share, .. } => {
                // The oldest input comes first.
                let late = states[0];
                states.rotate_left(1);
                let last = states.len() - 1;
                states[last] = x;
                late_share * late + (1.0 - late_share) * states[0]
            }
            _ => x,
        }
    }
}

fn sampled(chain: &BlockChain) -> Value {
    let period = Period { chain };
    let n = period.count();
    let unit = |i: usize| -> Vec<f64> { (0..n).map(|j| f64::from(i == j)).collect() };
    let columns: Vec<Vec<f64>> = (0..n).map(|i| period.after(unit(i), 0.0)).collect();
    let a: Vec<Vec<f64>> = (0..n)
        .map(|i| columns.iter().map(|column| column[i]).collect())
        .collect();
    let b: Vec<Vec<f64>> = period
        .after(vec![0.0; n], 1.0)
        .into_iter()
        .map(|value| vec![value])
        .collect();
    json!({ "A": a, "B": b, "C": [unit(n - 1)], "D": [[0.0]] })
}

/// The continuous equations, without the dead time.
fn continuous(model: &Model) -> ContinuousSystem {
    let lag = |hz: f64| first_order(TAU * hz);
    let factor = mass_change::frequency_factor(model);
    let value = |id: &str| model.values(id);
    let mut out = constant(value(gain::ID).map_or(1.0, |v| v[0]));
    if let Some(v) = value(amplifier_bandwidth::ID) {
        out = series(&out, &lag(v[0]));
    }
    if let Some(v) = value("charge_leakage") {
        out = series(&out, &beside(&[(-v[0], first_order(1.0 / v[1]))], 1.0));
    }
    let share = value(second_mode::ID).map_or(0.0, |v| v[0]);
    let first =
        value(vibration::ID).map(|v| (1.0 - share, second_order(v[0] * factor, v[1] * factor)));
    let second =
        value(second_mode::ID).map(|v| (share, second_order(v[1] * factor, v[2] * factor)));
    let through = if first.is_none() { 1.0 - share } else { 0.0 };
    let modes: Vec<(f64, ContinuousSystem)> = first.into_iter().chain(second).collect();
    if !modes.is_empty() {
        out = series(&out, &beside(&modes, through));
    }
    if let Some(v) = value(creep::ID) {
        let terms: Vec<(f64, ContinuousSystem)> = v
            .chunks_exact(2)
            .filter(|pair| pair[0] != 0.0)
            .map(|pair| (pair[0], first_order(1.0 / pair[1])))
            .collect();
        out = series(&out, &beside(&terms, 1.0));
    }
    if let Some(v) = value(sensor_bandwidth::ID) {
        out = series(&out, &lag(v[0]));
    }
    if let Some(v) = value(sensor_filter::ID) {
        out = series(&out, &second_order(TAU * v[0], v[1]));
    }
    out
}

fn constant(d: f64) -> ContinuousSystem {
    ContinuousSystem {
        a: DMatrix::zeros(0, 0),
        b: DVector::zeros(0),
        c: DVector::zeros(0),
        d,
    }
}

fn first_order(rate: f64) -> ContinuousSystem {
    let one = |value: f64| DVector::from_element(1, value);
    ContinuousSystem {
        a: DMatrix::from_element(1, 1, -rate),
        b: one(rate),
        c: one(1.0),
        d: 0.0,
    }
}

/// Displacement, and velocity over the natural frequency.
fn second_order(w: f64, damping_ratio: f64) -> ContinuousSystem {
    ContinuousSystem {
        a: DMatrix::from_row_slice(2, 2, &[0.0, w, -w, -2.0 * damping_ratio * w]),
        b: DVector::from_row_slice(&[0.0, w]),
        c: DVector::from_row_slice(&[1.0, 0.0]),
        d: 0.0,
    }
}

/// One system behind another.
fn series(first: &ContinuousSystem, then: &ContinuousSystem) -> ContinuousSystem {
    let (n, m) = (first.b.len(), then.b.len());
    let mut a = DMatrix::zeros(n + m, n + m);
    a.view_mut((0, 0), (n, n)).copy_from(&first.a);
    a.view_mut((n, n), (m, m)).copy_from(&then.a);
    a.view_mut((n, 0), (m, n))
        .copy_from(&(&then.b * first.c.transpose()));
    let stacked = |top: &DVector<f64>, bottom: DVector<f64>| {
        DVector::from_iterator(n + m, top.iter().chain(bottom.iter()).copied())
    };
    ContinuousSystem {
        a,
        b: stacked(&first.b, &then.b * first.d),
        c: stacked(&(&first.c * then.d), then.c.clone()),
        d: first.d * then.d,
    }
}

/// Systems with one input whose outputs add with these weights, and `through` of the input beside.
fn beside(parts: &[(f64, ContinuousSystem)], through: f64) -> ContinuousSystem {
    parts.iter().fold(constant(through), |sum, (weight, part)| {
        let (n, m) = (sum.b.len(), part.b.len());
        let mut a = DMatrix::zeros(n + m, n + m);
        a.view_mut((0, 0), (n, n)).copy_from(&sum.a);
        a.view_mut((n, n), (m, m)).copy_from(&part.a);
        let stacked = |top: &DVector<f64>, bottom: DVector<f64>| {
            DVector::from_iterator(n + m, top.iter().chain(bottom.iter()).copied())
        };
        ContinuousSystem {
            a,
            b: stacked(&sum.b, part.b.clone()),
            c: stacked(&sum.c, &part.c * *weight),
            d: sum.d + weight * part.d,
        }
    })
}

fn written(system: &ContinuousSystem) -> Value {
    let n = system.b.len();
    let a: Vec<Vec<f64>> = (0..n)
        .map(|i| system.a.row(i).iter().copied().collect())
        .collect();
    let b: Vec<Vec<f64>> = system.b.iter().map(|v| vec![*v]).collect();
    json!({ "A": a, "B": b, "C": [system.c.as_slice()], "D": [[system.d]] })
}
