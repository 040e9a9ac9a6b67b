//! Structural vibration: the mass moves after the force-equivalent displacement as one or two second-order modes.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;
use crate::linear_system::ContinuousSystem;
use nalgebra::{DMatrix, DVector};

/// First mode of the actuator with its load.
pub struct Vibration;

/// One mode of unit static gain, exact for an input that is held over an interval.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mode {
    phi: [f64; 4],
    gamma: [f64; 2],
    state: [f64; 2],
}

impl Mode {
    /// `omega^2 / (s^2 + 2 xi omega s + omega^2)`, thesis Ch. 5, Eq. (5).
    #[must_use]
    pub fn new(natural_frequency_rad_s: f64, damping_ratio: f64, dt_s: f64) -> Self {
        let w = natural_frequency_rad_s;
        // States: displacement in um and velocity divided by omega, so that both are of one size.
        let system = ContinuousSystem {
            a: DMatrix::from_row_slice(2, 2, &[0.0, w, -w, -2.0 * damping_ratio * w]),
            b: DVector::from_row_slice(&[0.0, w]),
            c: DVector::from_row_slice(&[1.0, 0.0]),
            d: 0.0,
        };
        let (phi, gamma) = system.held_matrices(dt_s);
        Self { phi: [phi[(0, 0)], phi[(0, 1)], phi[(1, 0)], phi[(1, 1)]], gamma: [gamma[0], gamma[1]], state: [0.0, 0.0] }
    }

    /// One interval with the input held; the displacement at its end.
    pub fn step(&mut self, input: f64) -> f64 {
        let [x, v] = self.state;
        self.state = [self.phi[0] * x + self.phi[1] * v + self.gamma[0] * input, self.phi[2] * x + self.phi[3] * v + self.gamma[1] * input];
        self.state[0]
    }

    /// At rest under a constant input.
    pub fn settle(&mut self, input: f64) -> f64 {
        self.state = [input, 0.0];
        input
    }
}

/// The modes that share the motion.
pub(super) struct VibrationStage {
    first: Option<Mode>,
    second: Option<(f64, Mode)>,
}

impl VibrationStage {
    /// The modes that `model` has.
    pub(super) fn of(model: &Model, dt_s: f64) -> Self {
        let mass_factor = super::mass_change::frequency_factor(model);
        let first = model.values("vibration").map(|v| Mode::new(v[0] * mass_factor, v[1] * mass_factor, dt_s));
        let second = model.values("second_mode").map(|v| (v[0], Mode::new(v[1] * mass_factor, v[2] * mass_factor, dt_s)));
        Self { first, second }
    }
}

impl Stage for VibrationStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let first = self.first.as_mut().map_or(input, |mode| mode.step(input));
        match &mut self.second {
            None => first,
            Some((share, mode)) => first + *share * (mode.step(input) - first),
        }
    }
    fn settle(&mut self, input: f64) -> f64 {
        if let Some(mode) = &mut self.first {
            mode.settle(input);
        }
        if let Some((_, mode)) = &mut self.second {
            mode.settle(input);
        }
        input
    }
}

impl Effect for Vibration {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "vibration".into(),
            physics: "Mass, stiffness and damping make the displacement follow the piezo force as a second-order mode.".into(),
            reference: "thesis Ch. 5, Eq. 5".into(),
            place: Place::Vibration,
            modifies: None,
            experiment: "a small multisine or sweep beyond the resonance".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        vec![
            Parameter::logarithmic("natural_frequency_rad_s", "rad/s", 1.0, 2.0 * highest),
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
    fn stage<'a>(&self, model: &Model, _values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(VibrationStage::of(model, setting.dt_s)))
    }
}
