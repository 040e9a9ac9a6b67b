//! Mains hum: a line at the mains frequency in the sensor signal, whatever the drive does.

use super::{
    Against, Declaration, Effect, LinearLanes, Overview, Parameter, PassedOn, Picture, Place, Planted, Setting, SimulatedStage, Stage,
};
use crate::chain::Model;

/// A sine in the reading. Its phase at the start of a record is arbitrary, so sine and cosine are estimated for every record.
pub struct MainsHum;

struct HumStage {
    sine_um: f64,
    cosine_um: f64,
    rotation: (f64, f64),
    phasor: (f64, f64),
}

impl Stage for HumStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let (c, s) = self.phasor;
        let (rc, rs) = self.rotation;
        self.phasor = (c * rc - s * rs, c * rs + s * rc);
        input + self.cosine_um * self.phasor.0 + self.sine_um * self.phasor.1
    }
    fn settle(&mut self, input: f64) -> f64 {
        input + self.cosine_um
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for MainsHum {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "mains_hum".into(),
            physics: "Stray fields of the mains couple into the sensor: a line at the mains frequency, present at rest too.".into(),
            reference: "Ott, Electromagnetic Compatibility Engineering (2009)".into(),
            place: Place::Hum,
            modifies: None,
            experiment: "rest at constant drive for a second".into(),
            candidate: true,
            one_sided: false,
        }
    }
    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        vec![
            Parameter::linear("frequency_hz", "Hz", 45.0, 65.0, 0.01),
            Parameter::linear("sine_um", "um", -range, range, 1e-4 * range).fixed(),
            Parameter::linear("cosine_um", "um", -range, range, 1e-4 * range).fixed(),
        ]
    }
    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let amplitude = 0.001 * overview.range_um;
        let mut out = Vec::new();
        for frequency_hz in [50.0, 60.0] {
            out.push(vec![frequency_hz, amplitude, 0.0]);
            out.push(vec![frequency_hz, 0.0, amplitude]);
        }
        out
    }
    fn planted(&self) -> Planted {
        Planted::InPairs
    }
    fn goes_by_ends(&self, _model: &Model) -> bool {
        true
    }
    fn stage<'a>(&self, _model: &Model, values: &[f64], setting: &Setting<'a>) -> Option<Box<dyn Stage + 'a>> {
        let (rs, rc) = (std::f64::consts::TAU * values[0] * setting.dt_s).sin_cos();
        Some(Box::new(HumStage { sine_um: values[1], cosine_um: values[2], rotation: (rc, rs), phasor: (1.0, 0.0) }))
    }
    fn line_frequencies_hz(&self, values: &[f64]) -> Vec<f64> {
        vec![values[0]]
    }
    fn values_at(&self, strength: f64, _stage: &SimulatedStage, _random: &mut dyn FnMut() -> f64) -> Option<Vec<f64>> {
        Some(vec![50.0, 0.007 * strength, 0.007 * strength])
    }
    fn picture(&self) -> Picture {
        Picture {
            against: Against::Frequency,
            caption: "Hum is a line at the mains frequency and its multiples, whatever the drive does, and present at rest.",
        }
    }
}
