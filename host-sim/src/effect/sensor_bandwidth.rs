//! Bandwidth of the sensor: its reading follows the displacement as a first-order lag.

use super::{Declaration, Effect, Overview, Parameter, Place, Setting, Stage};
use crate::chain::Model;

/// First-order lag behind everything mechanical.
pub struct SensorBandwidth;

struct SensorLag {
    decay: f64,
    from_start: f64,
    from_end: f64,
    input: f64,
    reading: f64,
}

impl Stage for SensorLag {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.reading = self.decay * self.reading + self.from_start * self.input + self.from_end * input;
        self.input = input;
        self.reading
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.input = input;
        self.reading = input;
        input
    }
}

impl Effect for SensorBandwidth {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "sensor_bandwidth".into(),
            physics: "The sensor's electronics filter what they read: fast motion appears smaller and later.".into(),
            reference: "Fleming, Sensors and Actuators A 190 (2013) 106-126".into(),
            place: Place::SensorBandwidth,
            modifies: None,
            experiment: "multisines up to a third of the sampling rate".into(),
            candidate: true,
            one_sided: true,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        super::lag_parameters(overview)
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        super::lag_starts(overview)
    }
    fn stage<'a>(&self, _model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        let (decay, mean) = super::lag_weights(values[0], setting.dt_s);
        Some(Box::new(SensorLag { decay, from_start: mean - decay, from_end: 1.0 - mean, input: 0.0, reading: 0.0 }))
    }
}
