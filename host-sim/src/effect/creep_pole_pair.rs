//! A second-order term of creep with complex poles: creep that does not go straight to its end.
//!
//! `y = x + share z + velocity_share v`, where `z` follows `x` as a damped second-order system of unit static
//! gain and `v` is its velocity over the natural frequency. Behind the first-order terms of [`super::creep`]
//! it makes any rational creep with real poles and one complex pair: the creep that the thesis identified on
//! its actuator (Ch. 5, Eq. 17: poles at -0.134, -1.64 and -6.19 +- 23.5i 1/s) is the product of two terms
//! and this one.

use crate::block::{Block, Linear};
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Identifier in files and on the command line.
pub const ID: &str = "creep_pole_pair";

/// Fastest oscillation that is creep, Hz: what is faster is a mode of the structure.
const FASTEST_HZ: f64 = 20.0;
/// Damping at which the pair is looked for.
const FIRST_DAMPING: f64 = 0.3;

/// Second-order term behind the first-order ones.
pub struct CreepPolePair;

/// What carries the two states over an interval in which the input runs straight.
#[derive(Clone, Copy)]
struct Carried {
    phi: [[f64; 2]; 2],
    from_start: [f64; 2],
    from_end: [f64; 2],
    shares: [f64; 2],
}

impl Carried {
    fn new(values: &[f64], dt_s: f64) -> Self {
        let (w, xi) = (values[2], values[3]);
        let system = ContinuousSystem {
            a: DMatrix::from_row_slice(2, 2, &[0.0, w, -w, -2.0 * xi * w]),
            b: DVector::from_row_slice(&[0.0, w]),
            c: DVector::from_row_slice(&[1.0, 0.0]),
            d: 0.0,
        };
        let (phi, held, slope) = system.straight_matrices(dt_s);
        Self {
            phi: [[phi[(0, 0)], phi[(0, 1)]], [phi[(1, 0)], phi[(1, 1)]]],
            from_start: [held[0] - slope[0], held[1] - slope[1]],
            from_end: [slope[0], slope[1]],
            shares: [values[0], values[1]],
        }
    }

    #[inline]
    fn next(&self, [z, v]: [f64; 2], start: f64, end: f64) -> [f64; 2] {
        std::array::from_fn(|i| {
            self.phi[i][0] * z
                + self.phi[i][1] * v
                + self.from_start[i] * start
                + self.from_end[i] * end
        })
    }

    #[inline]
    fn adds(&self, [z, v]: [f64; 2]) -> f64 {
        self.shares[0] * z + self.shares[1] * v
    }
}

struct PairStage {
    carried: Carried,
    state: [f64; 2],
    input: f64,
}

impl Stage for PairStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.state = self.carried.next(self.state, self.input, input);
        self.input = input;
        input + self.carried.adds(self.state)
    }
    fn settle(&mut self, input: f64) -> f64 {
        (self.state, self.input) = ([input, 0.0], input);
        input + self.carried.adds(self.state)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let c = &self.carried;
        let phi = c.phi.iter().map(|row| row.to_vec()).collect();
        let block = Linear::reading_states(
            phi,
            c.from_start.to_vec(),
            c.from_end.to_vec(),
            &c.shares,
            1.0,
            vec![1.0, 0.0],
        );
        Ok(vec![Block::Linear(block)])
    }
    fn linear_lanes(&self, lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PairLanes {
            carried: self.carried,
            states: vec![[0.0; 2]; lanes],
            inputs: vec![0.0; lanes],
        }))
    }
}

/// The pair with states for each perturbation of a batch.
struct PairLanes {
    carried: Carried,
    states: Vec<[f64; 2]>,
    inputs: Vec<f64>,
}

impl LinearLanes for PairLanes {
    fn settle(&mut self, row: &mut [f64]) {
        for ((value, state), input) in row.iter_mut().zip(&mut self.states).zip(&mut self.inputs) {
            (*state, *input) = ([*value, 0.0], *value);
            *value += self.carried.adds(*state);
        }
    }
    fn run(&mut self, block: &mut [f64]) {
        for row in block.chunks_exact_mut(self.inputs.len()) {
            for ((value, state), input) in
                row.iter_mut().zip(&mut self.states).zip(&mut self.inputs)
            {
                *state = self.carried.next(*state, *input, *value);
                *input = *value;
                *value += self.carried.adds(*state);
            }
        }
    }
}

impl Effect for CreepPolePair {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Creep that overshoots on its way: a slow pair of complex poles beside the first-order terms.".into(),
            reference: "thesis Ch. 5, Eqs. 13 and 17".into(),
            experiment: "steps of several heights, each held for ten seconds or more".into(),
            fitting_rank: 5,
            equations: r"`y = x + share z + velocity_share v`, with `w = natural_frequency_rad_s`: `z' = w v`, `v' = w (x - z - 2 damping_ratio v)`.

Exact for an input that runs straight through the interval. At rest `z = x`, `v = 0`. Behind modes it goes once a period, by the values at the ends of periods.",
            goes_by_ends: true,
            ..Declaration::on_request(Place::Creep)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear("share", "1", -0.9, 0.9, 0.01),
            Parameter::linear("velocity_share", "1", -0.9, 0.9, 0.01),
            Parameter::logarithmic(
                "natural_frequency_rad_s",
                "rad/s",
                slowest_rad_s(overview),
                TAU * FASTEST_HZ,
            ),
            Parameter::logarithmic("damping_ratio", "1", 0.01, 0.99),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let (slowest, fastest) = (4.0 * slowest_rad_s(overview), 0.7 * TAU * FASTEST_HZ);
        let count = ((fastest / slowest).log2().ceil() as usize).clamp(1, 6);
        (0..count)
            .map(|k| slowest * (fastest / slowest).powf((k as f64 + 0.5) / count as f64))
            .map(|w| vec![0.005, 0.0, w, FIRST_DAMPING])
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(PairStage {
            carried: Carried::new(from.values, from.setting.dt_s),
            state: [0.0; 2],
            input: 0.0,
        }))
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        let (w, xi) = (values[2], values[3].min(1.0));
        vec![FreeMotion {
            decay_per_s: xi * w,
            frequency_rad_s: w * (1.0 - xi * xi).sqrt(),
        }]
    }
}

/// Slowest natural frequency that a data set shows: a quarter of a turn in its longest record.
fn slowest_rad_s(overview: &Overview) -> f64 {
    (0.25 * TAU / overview.duration_s.max(1e-3)).min(0.1 * TAU * FASTEST_HZ)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::{Drive, EffectInstance, InitialState};
    use crate::effect::by_id;

    /// Oracle: the printed transfer function of the thesis in its own realisation, behind a gain of one.
    #[test]
    fn behind_two_terms_it_is_the_creep_of_the_thesis() {
        let overview = Overview {
            duration_s: 30.0,
            ..Overview::without_data(0.0, 80.0)
        };
        let mut model = Model::new(0.0, 80.0);
        // Poles and zeros of 1 + G_2, by numpy.roots.
        let poles = [-0.133426538220834, -1.59181716335929];
        let zeros = [-0.136863082123545, -1.65989370234604];
        let pair = [
            0.00524284154439037,
            0.00448836736645482,
            24.2598050071301,
            0.255046491403844,
        ];
        let share = |k: usize| {
            let p: f64 = poles[k];
            -(p - zeros[0]) * (p - zeros[1]) / (p - poles[1 - k]) / p
        };
        let two = by_id("creep").unwrap().with_parameters(4).unwrap();
        let mut creep = EffectInstance::new(two, &overview, &[]);
        let values = [share(0), -1.0 / poles[0], share(1), -1.0 / poles[1]];
        creep
            .parameters
            .iter_mut()
            .zip(values)
            .for_each(|(parameter, value)| parameter.value = value);
        model.add(EffectInstance::new(
            by_id("gain").unwrap(),
            &overview,
            &[1.0],
        ));
        model.add(creep);
        model.add(EffectInstance::new(by_id(ID).unwrap(), &overview, &pair));
        let drive_v: Vec<f64> = (0..6000)
            .map(|k| {
                if k < 10 {
                    0.0
                } else {
                    30.0 + 10.0 * (0.002 * f64::from(k)).sin()
                }
            })
            .collect();
        let drive = Drive::held(&drive_v, 0.001, InitialState::Virgin);
        let reading = model.simulate(&drive);
        let mut g2 = ContinuousSystem::from_transfer_function(
            &[0.1804, 4.181, 47.84, 9.404],
            &[1.0, 14.10, 610.1, 1018.0, 125.0],
        )
        .unwrap()
        .discretise(0.001);
        let expected: Vec<f64> = std::iter::once(0.0)
            .chain(drive_v.iter().map(|u| u + g2.step_straight(*u)))
            .collect();
        for (k, (a, b)) in reading.iter().zip(&expected).enumerate() {
            // Between the two stages the motion is taken to run straight over a sample: of a step of 30 that
            // leaves some 1e-8 of it.
            assert!((a - b).abs() < 1e-6, "{k}: {a} {b}");
        }
    }
}
