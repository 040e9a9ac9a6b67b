//! Multiples of the mains frequency beside its hum: rectifiers ripple at twice the mains, saturated
//! transformers at its odd multiples.
//!
//! # How it works
//! Sine and cosine of every multiple are estimated for every record, as those of the hum are. A periodic
//! drive whose harmonics fall on the same lines would lend them what the loops leave, so they are proposed
//! only where a line is seen while the drive stands still ([`Effect::speaks_for_it`]).

use super::mains_hum::lines_stage;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "hum_harmonics";

/// Multiples of the mains frequency that are in the reading.
pub struct HumHarmonics;

/// The multiples.
const MULTIPLES: [u32; 6] = [2, 3, 4, 5, 6, 7];
/// Mains frequency where no hum says it, Hz.
const USUAL_HZ: f64 = 50.0;
/// A line at rest is a multiple of the hum where it is so near, Hz: a rest of two seconds tells lines apart
/// that are half of that from one another.
const NEAR_HZ: f64 = 1.0;

impl Effect for HumHarmonics {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
            "Rectifiers and transformers bring multiples of the mains frequency into the sensor beside its hum, present at rest too."
            .into(),
            reference: "Ott, Electromagnetic Compatibility Engineering (2009)".into(),
            modifies: Some(id::MAINS_HUM),
            experiment: "rest at constant drive for two seconds".into(),
            beside: Some(id::MAINS_HUM),
            picture: Picture {
                against: Against::Frequency,
                caption: "Lines at multiples of the mains frequency, whatever the drive does, and present at rest.",
            },
            planted: Planted::Never,
            equations: r"`y = x + sum_k cosine_k_um cos(2 pi k f t) + sine_k_um sin(2 pi k f t)`, `k = 2..7`, with `f` the `frequency_hz` of `mains_hum`, or 50 Hz without it; `t` counted from the first sample.",
            goes_by_ends: true,
            ..Declaration::at(Place::Hum)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let range = overview.range_um.max(1e-6);
        let amplitude =
            |name: String| Parameter::linear(name, "um", -range, range, 1e-4 * range).fixed();
        MULTIPLES
            .iter()
            .flat_map(|k| {
                [
                    amplitude(format!("sine_{k}_um")),
                    amplitude(format!("cosine_{k}_um")),
                ]
            })
            .collect()
    }

    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        vec![vec![0.0; 2 * MULTIPLES.len()]]
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        lines_stage(
            &self.line_frequencies_hz(from.model, from.values),
            from.values,
            from.setting.dt_s,
        )
    }

    fn line_frequencies_hz(&self, model: &Model, _values: &[f64]) -> Vec<f64> {
        let mains_hz = model.values(id::MAINS_HUM).map_or(USUAL_HZ, |hum| hum[0]);
        MULTIPLES
            .iter()
            .map(|multiple| f64::from(*multiple) * mains_hz)
            .collect()
    }

    fn speaks_for_it(&self, model: &Model, at_rest: &LinesAtRest) -> bool {
        let multiples = self.line_frequencies_hz(model, &[]);
        at_rest.lines_hz.iter().any(|line| {
            multiples
                .iter()
                .any(|multiple| (line - multiple).abs() < NEAR_HZ)
        })
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(
            [0.002, 0.002, 0.003, 0.003]
                .iter()
                .map(|um| um * case.strength)
                .chain([0.0; 2 * MULTIPLES.len() - 4])
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, InitialState};
    use crate::effect::{LinesAtRest, Overview, by_id, model_of};

    #[test]
    fn it_adds_sines_at_multiples_of_the_hum() {
        let overview = Overview::without_data(0.0, 1.0);
        let mut values = [0.0; 12];
        (values[1], values[2]) = (0.3, 0.2);
        let mains: &[f64] = &[49.9, 0.0, 0.0];
        let model = model_of(
            &overview,
            &[("mains_hum", mains), ("hum_harmonics", &values)],
        );
        let drive = Drive::held(&[0.0; 3000], 1e-3, InitialState::Settled);
        for (k, read_um) in model.simulate(&drive).iter().enumerate() {
            let phase = std::f64::consts::TAU * 49.9 * 1e-3 * k as f64;
            let expected_um = 0.3 * (2.0 * phase).cos() + 0.2 * (3.0 * phase).sin();
            assert!(
                (read_um - expected_um).abs() < 1e-9,
                "{k}: {read_um} {expected_um}"
            );
        }
    }

    #[test]
    fn only_a_multiple_of_the_hum_that_is_there_at_rest_speaks_for_it() {
        let overview = Overview::without_data(0.0, 1.0);
        let model = model_of(&overview, &[("mains_hum", &[59.95, 0.01, 0.0])]);
        let harmonics = by_id("hum_harmonics").unwrap();
        for (lines_hz, speaks) in [
            (&[][..], false),
            (&[59.95, 735.0], false),
            (&[100.0], false),
            (&[59.95, 179.8], true),
        ] {
            let at_rest = LinesAtRest {
                lines_hz: lines_hz.to_vec(),
                samples: 20_000,
            };
            assert_eq!(
                harmonics.speaks_for_it(&model, &at_rest),
                speaks,
                "{lines_hz:?}"
            );
        }
    }
}
