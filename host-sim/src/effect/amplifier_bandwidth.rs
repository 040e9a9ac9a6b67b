//! Bandwidth of the amplifier: the voltage on the piezo follows the drive as a first-order lag.
//!
//! The stage gives the voltage at the end of each interval; stages behind know how it goes there
//! ([`super::arrival`]). In front of a slew limit, which makes another shape of it, it gives means.

use crate::block::{Block, Linear};
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::AMPLIFIER_BANDWIDTH;

/// First-order lag in front of the hysteresis.
pub struct AmplifierBandwidth;

struct LagStage {
    decay: f64,
    /// Of what is away at the beginning of an interval: what its mean has of it, or its end.
    output_weight: f64,
    /// Of a drive that runs straight: what its rise over an interval leaves away at the end.
    left_of_rise: f64,
    voltage_v: f64,
    before_v: f64,
}

impl Stage for LagStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let rise = input - self.before_v;
        self.before_v = input;
        let away = self.voltage_v - input;
        self.voltage_v = input + away * self.decay;
        if self.left_of_rise > 0.0 {
            // It rises with the drive, and comes short of it by what the drive rose since.
            self.voltage_v += rise * (self.decay - self.left_of_rise);
            return self.voltage_v;
        }
        input + away * self.output_weight
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Linear(Linear {
            phi: vec![vec![self.decay]],
            start: vec![0.0],
            end: vec![1.0 - self.decay],
            out: vec![self.output_weight],
            before: 0.0,
            through: 1.0 - self.output_weight,
            rest: vec![1.0],
            offset: 0.0,
        })])
    }
    fn settle(&mut self, input: f64) -> f64 {
        (self.voltage_v, self.before_v) = (input, input);
        input
    }
}

impl Effect for AmplifierBandwidth {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "The output resistance of the amplifier and the capacitance of the piezo make the voltage lag behind the drive."
            .into(),
            reference: "Fleming and Leang, Design, Modeling and Control of Nanopositioning Systems (2014), Ch. 14".into(),
            experiment: "multisines at two amplitudes: a lag before the hysteresis rounds its turning points, one behind does not".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            equations: r"`tau y' + y = x`, `tau = 1 / (2 pi bandwidth_hz)`.

With `a = exp(-T / tau)` and the voltage `v`: `v[k] = x[k] + (v[k-1] - x[k]) a`, and `y[k] = v[k]`. The next stage takes its input as gliding with `tau` (*Arrival*). In front of
`slew_limit`, and with a mode or a sensor's lag in the model, it gives means: `y[k] = x[k] + (v[k-1] - x[k]) (1 - a) tau / T`. With a mode or a sensor's lag and `T` above 25 us the
period is divided into 2. At rest `v = y = x`.",
            ..Declaration::at(Place::AmplifierBandwidth)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        lag_parameters(overview)
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        lag_starts(overview)
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let (decay, mean_weight) = lag_weights(from.values[0], from.setting.dt_s);
        let gives_mean =
            super::arrival::gliding_s(from.model).is_none() && takes_the_mean_in(from.model);
        let output_weight = if gives_mean { mean_weight } else { decay };
        let left_of_rise = if from.setting.runs_straight {
            mean_weight
        } else {
            0.0
        };
        Some(Box::new(LagStage {
            decay,
            output_weight,
            left_of_rise,
            voltage_v: from.model.drive_min_v,
            before_v: from.model.drive_min_v,
        }))
    }

    fn substeps(&self, model: &Model, dt_s: f64) -> usize {
        // Loops bend on the way of a glide: in one interval a period the bench's sensor was found at 9.5 kHz,
        // in two at 9.7, in four at 9.9; it is at 10.
        if takes_the_mean_in(model) && dt_s > 25e-6 {
            2
        } else {
            1
        }
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![3000.0 / case.strength.max(0.01)])
    }
}
