//! Charge leakage: with a charge drive the piezo loses what it was given through its own resistance.

use crate::block::{Block, Linear};
use crate::physics::*;

/// High-pass of the drive in front of the hysteresis.
pub struct ChargeLeakage;

struct LeakStage {
    decay: f64,
    share: f64,
    leaked: f64,
    rest_v: f64,
}

impl Stage for LeakStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.leaked = self.decay * self.leaked + (1.0 - self.decay) * (input - self.rest_v);
        input - self.share * self.leaked
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let stays = 1.0 - self.decay;
        let mut leak = Linear::reading_states(
            vec![vec![self.decay]],
            vec![0.0],
            vec![stays],
            &[-self.share],
            1.0,
            vec![1.0],
        );
        leak.offset = self.rest_v;
        Ok(vec![Block::Linear(leak)])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.leaked = input - self.rest_v;
        input - self.share * self.leaked
    }
}

impl Effect for ChargeLeakage {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "charge_leakage".into(),
            physics: "A charge amplifier loses charge through the insulation resistance: what is held sinks back towards rest.".into(),
            reference: "Fleming and Leang (2014), Ch. 15".into(),
            experiment: "steps held for several minutes at different voltages".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Time,
                caption: "An error that goes its own way in time, whatever the drive does.",
            },
            equations: r"`y = x - share q`, `time_constant_s q' + q = x - drive_min_v`.

With `a = exp(-T / time_constant_s)`: `q[k] = a q[k-1] + (1 - a) (x[k] - drive_min_v)`. At rest `q = x - drive_min_v`.",
            ..Declaration::at(Place::Charge)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![
            Parameter::linear("share", "1", 0.0, 1.0, 0.01),
            Parameter::logarithmic("time_constant_s", "s", 0.01, 1e3 * overview.duration_s),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.1, 1.0, 5.0]
            .iter()
            .map(|times| vec![0.02, times * overview.duration_s])
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let decay = (-from.setting.dt_s / from.values[1]).exp();
        Some(Box::new(LeakStage {
            decay,
            share: from.values[0],
            leaked: 0.0,
            rest_v: from.model.drive_min_v,
        }))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![0.02 * case.strength, case.about(30.0)])
    }
}
