//! Structural vibration: the mass moves after the force-equivalent displacement as one or two second-order
//! modes.

use super::arrival::Arrival;
use super::force_balance::{BalancedMass, forces_of};
use super::friction::Bristle;
use super::held_mass::HeldMass;
pub use super::mode::VibrationMode;
use super::mode::{ModeLanes, ModeLaw, free_motions_of};
use crate::block::{Block, Linear};
use crate::physics::*;
use std::collections::VecDeque;

/// Identifier in files and on the command line.
pub const ID: &str = id::VIBRATION;

/// First mode of the actuator with its load.
pub struct Vibration;

/// The first mode: its mass free, held by a bristle, or against other forces.
enum First {
    Free(Box<VibrationMode>),
    Held(Box<HeldMass>),
    Balanced(BalancedMass),
}

/// The modes that share the motion.
pub(super) struct VibrationStage {
    first: Option<First>,
    second: Option<(f64, VibrationMode)>,
    /// Inputs of the whole intervals by which the input is late.
    late: VecDeque<f64>,
    /// The first mode over a whole interval, without a bristle: what passes small changes on.
    whole_interval: Option<VibrationMode>,
    /// What a first mode whose mass is held read over the last signal, where others take it: it takes most of
    /// the time, and a second mode does not change it.
    by_held: Option<Vec<f64>>,
}

impl VibrationStage {
    /// The modes that `model` has.
    pub(super) fn from_model(model: &Model, setting: &Setting) -> Self {
        let dt_s = setting.dt_s;
        let mass_factor = super::mass_change::frequency_factor(model);
        // A lag commutes with what stands between it and the modes: linear parts, and a sensor's small
        // nonlinearity.
        let sensor_bandwidth_hz = model
            .effect(ID)
            .and_then(|_| model.values(id::SENSOR_BANDWIDTH))
            .map(|v| v[0]);
        let sensor_filter = super::sensor_filter::taken_in_by_modes(model);
        let arrival = Arrival::from_model(model, setting);
        let taken_in_s = super::delay::taken_in_s(model).filter(|_| !setting.runs_straight);
        let late_intervals = taken_in_s.map_or(0.0, |delay_s| delay_s / dt_s);
        let law = |natural_frequency_rad_s: f64, damping_ratio: f64| ModeLaw {
            natural_frequency_rad_s: natural_frequency_rad_s * mass_factor,
            damping_ratio: damping_ratio * mass_factor,
            sensor_bandwidth_hz,
            sensor_filter,
        };
        let first_law = model.values(ID).map(|v| law(v[0], v[1]));
        let forces = forces_of(model, setting);
        let balanced = !forces.is_empty();
        let first = first_law.map(|first| match Bristle::from_model(model) {
            _ if balanced => First::Balanced(BalancedMass::new(
                &first,
                forces,
                mass_factor,
                dt_s,
                arrival,
                model.drive_min_v,
            )),
            Some(bristle) => First::Held(Box::new(HeldMass::new(
                bristle,
                &first,
                dt_s,
                arrival,
                model.drive_min_v,
            ))),
            None => First::Free(Box::new(VibrationMode::read(&first, dt_s, arrival))),
        });
        let second = model
            .values(id::SECOND_MODE)
            .map(|v| (v[0], VibrationMode::read(&law(v[1], v[2]), dt_s, arrival)));
        let whole_interval = first_law.map(|first| VibrationMode::read(&first, dt_s, arrival));
        let late = std::iter::repeat_n(model.drive_min_v, late_intervals as usize).collect();
        Self {
            first,
            second,
            late,
            whole_interval,
            by_held: None,
        }
    }

    /// Carries the second mode over its forces and lets it share what the first one reads.
    fn second_beside(&mut self, mut forces: Vec<f64>, by_first: &mut [f64]) {
        if let Some((share, second)) = &mut self.second {
            second.run_over(&mut forces);
            by_first
                .iter_mut()
                .zip(forces)
                .for_each(|(value, by_second)| *value += *share * (by_second - *value));
        }
    }

    /// The input of as many whole intervals ago as it is late.
    fn arrived(&mut self, input: f64) -> f64 {
        if self.late.is_empty() {
            return input;
        }
        self.late.push_back(input);
        self.late.pop_front().unwrap_or(input)
    }
}

impl Stage for VibrationStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let input = self.arrived(input);
        let first = match &mut self.first {
            Some(First::Free(mode)) => {
                mode.step(input);
                mode.reading()
            }
            Some(First::Held(held)) => held.step(input),
            Some(First::Balanced(balanced)) => balanced.step(input),
            None => input,
        };
        match &mut self.second {
            None => first,
            Some((share, mode)) => {
                mode.step(input);
                first + *share * (mode.reading() - first)
            }
        }
    }
    fn run(&mut self, _from: usize, signal: &mut [f64]) {
        if !self.late.is_empty() {
            signal
                .iter_mut()
                .for_each(|value| *value = self.arrived(*value));
        }
        let forces = self.second.map(|_| signal.to_vec());
        match &mut self.first {
            Some(First::Free(first)) => first.run_over(signal),
            Some(First::Held(held)) => {
                held.run_over(signal);
                if let Some(kept) = &mut self.by_held {
                    kept.clear();
                    kept.extend_from_slice(signal);
                }
            }
            Some(First::Balanced(balanced)) => balanced.run_over(signal),
            None => {}
        }
        if let Some(forces) = forces {
            self.second_beside(forces, signal);
        }
    }
    fn shared(&mut self) -> Option<&mut dyn SharedPart> {
        let held = matches!(self.first, Some(First::Held(_)));
        (held && self.late.is_empty()).then_some(self)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let late = (!self.late.is_empty()).then_some(Block::Delay {
            whole: self.late.len(),
            late_share: 0.0,
        });
        let second = self.second.as_ref();
        let second = second.map(|(share, mode)| (*share, mode.as_linear()));
        let share = second.as_ref().map_or(0.0, |(share, _)| *share);
        let law = match &self.first {
            Some(First::Held(held)) => Some(held.law()),
            Some(First::Balanced(balanced)) => Some(balanced.law()),
            Some(First::Free(_)) | None => None,
        };
        if let Some(law) = law {
            let law = match &second {
                Some((share, second)) => law.beside(*share, second),
                None => law,
            };
            return Ok(late.into_iter().chain([Block::Mass(law)]).collect());
        }
        let first = match &self.first {
            Some(First::Free(mode)) => Some(mode.as_linear()),
            _ => None,
        };
        let mut parts: Vec<(f64, &Linear)> =
            first.iter().map(|first| (1.0 - share, first)).collect();
        parts.extend(second.iter().map(|(share, second)| (*share, second)));
        let modes = Linear::side_by_side(&parts, if first.is_none() { 1.0 - share } else { 0.0 });
        Ok(late.into_iter().chain([Block::Linear(modes)]).collect())
    }
    fn settle(&mut self, input: f64) -> f64 {
        let mut rest = input;
        match &mut self.first {
            Some(First::Free(mode)) => {
                mode.settle(input);
            }
            Some(First::Held(held)) => held.settle(input),
            Some(First::Balanced(balanced)) => rest = balanced.settle(input),
            None => {}
        }
        self.late.iter_mut().for_each(|value| *value = input);
        if let Some((share, mode)) = &mut self.second {
            mode.settle(input);
            rest += *share * (input - rest);
        }
        rest
    }
    fn linear_lanes(&self, lanes: usize) -> Option<Box<dyn LinearLanes>> {
        // Against other forces the mass passes small changes on as the free mode does, but for the bend of
        // those forces.
        Some(Box::new(VibrationLanes {
            first: self.whole_interval.map(|mode| ModeLanes::new(mode, lanes)),
            second: self
                .second
                .map(|(share, mode)| (share, ModeLanes::new(mode, lanes))),
            late: self.late.iter().map(|_| vec![0.0; lanes]).collect(),
        }))
    }
}

impl SharedPart for VibrationStage {
    fn made_by(&self) -> Vec<f64> {
        match &self.first {
            Some(First::Held(held)) => held.values(),
            _ => Vec::new(),
        }
    }
    fn keep(&mut self) {
        self.by_held = Some(Vec::new());
    }
    fn kept(&self) -> &[f64] {
        self.by_held.as_deref().unwrap_or_default()
    }
    fn run_with(&mut self, signal: &mut [f64], part: &[f64]) {
        let forces = signal.to_vec();
        signal.copy_from_slice(part);
        self.second_beside(forces, signal);
    }
}

/// The modes that share the motion, with a state for each signal.
struct VibrationLanes {
    first: Option<ModeLanes>,
    second: Option<(f64, ModeLanes)>,
    late: VecDeque<Vec<f64>>,
}

impl LinearLanes for VibrationLanes {
    fn settle(&mut self, row: &mut [f64]) {
        self.late
            .iter_mut()
            .for_each(|values| values.copy_from_slice(row));
        for mode in self
            .first
            .iter_mut()
            .chain(self.second.iter_mut().map(|(_, mode)| mode))
        {
            mode.settle(row);
        }
    }
    fn run(&mut self, block: &mut [f64]) {
        let Some(lanes) = self
            .first
            .iter()
            .chain(self.second.iter().map(|(_, mode)| mode))
            .map(|m| m.before.len())
            .next()
        else {
            return;
        };
        let mut forces = vec![0.0; lanes];
        for row in block.chunks_exact_mut(lanes) {
            if let Some(mut oldest) = self.late.pop_front() {
                oldest.swap_with_slice(row);
                self.late.push_back(oldest);
            }
            if self.second.is_some() {
                forces.copy_from_slice(row);
            }
            if let Some(first) = &mut self.first {
                first.step(row);
            }
            if let Some((share, second)) = &mut self.second {
                second.step(&mut forces);
                row.iter_mut()
                    .zip(&forces)
                    .for_each(|(value, by_second)| *value += *share * (by_second - *value));
            }
        }
    }
}

/// Why a mode beyond the critical damping is not one.
pub(super) fn two_lags(damping_ratio: f64) -> String {
    format!("with a damping ratio of {damping_ratio:.2} it does not ring: it is two lags")
}

impl Effect for Vibration {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Mass, stiffness and damping make the displacement follow the piezo force as a second-order mode.".into(),
            reference: "thesis Ch. 5, Eq. 12".into(),
            experiment: "a small multisine or sweep beyond the resonance".into(),
            fitting_rank: 3,
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            equations: r"`y'' + 2 damping_ratio w y' + w^2 y = w^2 x`, `w = natural_frequency_rad_s`. `mass_change` multiplies `w` and `damping_ratio` by `1 / sqrt(1 + mass_ratio)`.

States: displacement `y` and velocity over frequency `v = y' / w`: `A = [[0, w], [-w, -2 damping_ratio w]]`, `B = [0, w]`. Exact over an interval for an input that arrives as *Arrival* says. `sensor_bandwidth` and
`sensor_filter` behind are further states of the same linear system: `r' = 2 pi bandwidth_hz (y - r)`. At rest `y = r = x`, `v = 0`.",
            ..Declaration::at(Place::Vibration)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        vec![
            // A faster mode would look like one below the Nyquist frequency.
            Parameter::logarithmic("natural_frequency_rad_s", "rad/s", 1.0, highest),
            Parameter::logarithmic("damping_ratio", "1", 1e-4, 20.0),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        let mut out = Vec::new();
        for fraction in [0.05, 0.08, 0.13, 0.2, 0.33] {
            for damping_ratio in [0.6, 0.05] {
                out.push(vec![fraction * highest, damping_ratio]);
            }
        }
        out
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(VibrationStage::from_model(
            from.model,
            from.setting,
        )))
    }

    fn free_motions(&self, model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        let factor = super::mass_change::frequency_factor(model);
        free_motions_of(values[0] * factor, values[1] * factor)
    }

    fn resonant_starts(&self, resonances: &[Resonance]) -> Vec<Vec<f64>> {
        resonances
            .iter()
            .map(|r| vec![r.natural_frequency_rad_s, r.damping_ratio])
            .collect()
    }

    fn doubt(&self, _model: &Model, values: &[f64]) -> Option<Doubt> {
        let (rad_s, ratio) = (values[0], values[1]);
        // Beyond the critical damping nothing rings: the equation is then that of two lags, which have names
        // of their own.
        if ratio > 1.0 {
            return Some(Doubt::RuledOut(two_lags(ratio)));
        }
        let hz = rad_s / std::f64::consts::TAU;
        (ratio > 0.5).then(|| {
            Doubt::Unlikely(format!(
                "a mechanical resonance with a damping ratio of {ratio:.2} is rare; its damping is that of a second-order low-pass of {hz:.0} Hz in \
                 the electronics"
            ))
        })
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![
            case.stage.natural_frequency_rad_s,
            case.stage.damping_ratio,
        ])
    }
}
