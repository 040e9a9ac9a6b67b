//! Mains hum: a line at the mains frequency in the sensor signal, whatever the drive does.

use crate::block::Block;
use crate::physics::*;

/// A sine in the reading. Its phase at the start of a record is arbitrary, so sine and cosine are estimated
/// for every record.
pub struct MainsHum;

/// Identifier in files and on the command line.
pub const ID: &str = id::MAINS_HUM;

/// Frequencies that mains may have, Hz.
const LOWEST_HZ: f64 = 45.0;
const HIGHEST_HZ: f64 = 65.0;

/// One line of a reading, as a phasor that is turned from interval to interval.
struct Line {
    sine_um: f64,
    cosine_um: f64,
    rotation: (f64, f64),
    phasor: (f64, f64),
}

impl Line {
    fn at(frequency_hz: f64, [sine_um, cosine_um]: [f64; 2], dt_s: f64) -> Self {
        let (sine, cosine) = (std::f64::consts::TAU * frequency_hz * dt_s).sin_cos();
        Self {
            sine_um,
            cosine_um,
            rotation: (cosine, sine),
            phasor: (1.0, 0.0),
        }
    }
    fn next_um(&mut self) -> f64 {
        let (c, s) = self.phasor;
        let (rc, rs) = self.rotation;
        self.phasor = (c * rc - s * rs, c * rs + s * rc);
        self.cosine_um * self.phasor.0 + self.sine_um * self.phasor.1
    }
}

/// What lines add to a reading.
struct LinesStage(Vec<Line>);

impl Stage for LinesStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.0
            .iter_mut()
            .fold(input, |sum, line| sum + line.next_um())
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let line = |line: &Line| {
            [
                line.rotation.1.atan2(line.rotation.0),
                line.sine_um,
                line.cosine_um,
            ]
        };
        Ok(vec![Block::Lines(self.0.iter().map(line).collect())])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.0.iter().fold(input, |sum, line| sum + line.cosine_um)
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

/// The stage of lines whose amplitudes stand in pairs of sine and cosine; none where all are zero, as while
/// they are fitted to every record by themselves.
pub(super) fn lines_stage<'a>(
    frequencies_hz: &[f64],
    amplitudes_um: &[f64],
    dt_s: f64,
) -> Option<Box<dyn Stage + 'a>> {
    let lines = frequencies_hz
        .iter()
        .zip(amplitudes_um.as_chunks::<2>().0)
        .filter(|(_, um)| um.iter().any(|um| *um != 0.0));
    let lines: Vec<Line> = lines
        .map(|(frequency_hz, um)| Line::at(*frequency_hz, *um, dt_s))
        .collect();
    (!lines.is_empty()).then(|| Box::new(LinesStage(lines)) as Box<dyn Stage + 'a>)
}

impl Effect for MainsHum {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Stray fields of the mains couple into the sensor: a line at the mains frequency, present at rest too.".into(),
            reference: "Ott, Electromagnetic Compatibility Engineering (2009)".into(),
            experiment: "rest at constant drive for a second".into(),
            picture: Picture {
                against: Against::Frequency,
                caption: "Hum is a line at the mains frequency and its multiples, whatever the drive does, and present at rest.",
            },
            planted: Planted::InPairs,
            equations: r"`y = x + cosine_um cos(2 pi frequency_hz t) + sine_um sin(2 pi frequency_hz t)`, `t` counted from the first sample, where it is `x + cosine_um`.",
            goes_by_ends: true,
            ..Declaration::at(Place::Hum)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        vec![
            Parameter::linear("frequency_hz", "Hz", LOWEST_HZ, HIGHEST_HZ, 0.01),
            Parameter::linear("sine_um", "um", -range, range, 1e-4 * range).fixed(),
            Parameter::linear("cosine_um", "um", -range, range, 1e-4 * range).fixed(),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let amplitude = 0.001 * overview.range_um;
        let mut out = Vec::new();
        // In less than a period a line looks like a trend.
        for frequency_hz in [50.0, 60.0]
            .into_iter()
            .filter(|hz| hz * overview.duration_s >= 1.0)
        {
            out.push(vec![frequency_hz, amplitude, 0.0]);
            out.push(vec![frequency_hz, 0.0, amplitude]);
        }
        out
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        lines_stage(&from.values[..1], &from.values[1..], from.setting.dt_s)
    }

    fn line_frequencies_hz(&self, _model: &Model, values: &[f64]) -> Vec<f64> {
        vec![values[0]]
    }

    fn speaks_for_it(&self, _model: &Model, at_rest: &LinesAtRest) -> bool {
        // Where none is shown, a line at the mains frequency is what a drive of that frequency leaves.
        !at_rest.show_weak_lines()
            || at_rest
                .lines_hz
                .iter()
                .any(|hz| (LOWEST_HZ..HIGHEST_HZ).contains(hz))
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![50.0, 0.007 * case.strength, 0.007 * case.strength])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::Model;
    use crate::effect::{LinesAtRest, by_id};

    /// A stage that is driven at 50 Hz answers there; whether there is hum as well is seen at rest.
    #[test]
    fn a_long_rest_without_a_line_speaks_against_hum() {
        let hum = by_id("mains_hum").unwrap();
        for (lines_hz, samples, speaks) in [
            (&[][..], 0, true),
            (&[], 800, true),
            (&[], 15_000, false),
            (&[735.0], 15_000, false),
            (&[49.98], 15_000, true),
        ] {
            let at_rest = LinesAtRest {
                lines_hz: lines_hz.to_vec(),
                samples,
            };
            assert_eq!(
                hum.speaks_for_it(&Model::new(0.0, 1.0), &at_rest),
                speaks,
                "{at_rest:?}"
            );
        }
    }
}
