//! A second structural mode that takes a share of the motion.

use super::vibration;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::SECOND_MODE;

/// A frequency above this share of the highest that the data can show has run into that limit.
const AT_ITS_LIMIT: f64 = 0.98;
/// Least damping ratio: the material of a monolithic flexure alone has more. What would ring even longer does
/// not ring down.
const LEAST_DAMPING: f64 = 5e-4;

/// A mode beside the first one; the vibration stage takes it in.
pub struct SecondMode;

impl Effect for SecondMode {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Part of the motion goes through another resonance of the structure, usually higher and lightly damped.".into(),
            reference: "Preumont, Vibration Control of Active Structures (2011), modal sum".into(),
            modifies: Some(id::VIBRATION),
            experiment: "a multisine with lines close together up to a third of the sampling rate".into(),
            fitting_rank: 6,
            beside: Some(id::VIBRATION),
            picture: Picture {
                against: Against::Frequency,
                caption: "A dynamic effect: the residual stands where the signature has its power.",
            },
            planted: Planted::InPairs,
            equations: r"`y = (1 - share) y_1 + share y_2`: `y_2` is a second mode as in `vibration`, with its own `natural_frequency_rad_s` and `damping_ratio` and the same input, read by the same sensor; `y_1` is the first mode, or the input
itself where there is no `vibration`.",
            ..Declaration::at(Place::Vibration)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        vec![
            Parameter::linear("share", "1", -0.9, 0.9, 0.01),
            Parameter::logarithmic("natural_frequency_rad_s", "rad/s", 10.0, highest),
            Parameter::logarithmic("damping_ratio", "1", LEAST_DAMPING, 2.0),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let highest = std::f64::consts::PI * overview.sample_rate_max_hz;
        let mut out = Vec::new();
        let count = 36;
        for i in 0..count {
            // Steps of 7 %, a little wider than the width of a mode with the damping ratio that goes with
            // them.
            let frequency = 0.9 * highest * 0.93_f64.powi(i);
            out.push(vec![0.02, frequency, 0.03]);
        }
        out
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        match from.model.effect(id::VIBRATION) {
            Some(_) => None,
            None => Some(Box::new(vibration::VibrationStage::from_model(
                from.model,
                from.setting,
            ))),
        }
    }

    fn free_motions(&self, model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        let factor = super::mass_change::frequency_factor(model);
        super::mode::free_motions_of(values[1] * factor, values[2] * factor)
    }

    fn doubt(&self, model: &Model, values: &[f64]) -> Option<Doubt> {
        let highest_rad_s = model.effect(ID)?.parameters.get(1)?.parameter.upper;
        let (hz, ratio) = (values[1] / std::f64::consts::TAU, values[2]);
        let because = if values[1] > AT_ITS_LIMIT * highest_rad_s {
            format!("its {hz:.0} Hz are half the sampling rate, where nothing shows a resonance")
        } else if ratio > 1.0 {
            super::vibration::two_lags(ratio)
        } else if ratio * AT_ITS_LIMIT < LEAST_DAMPING {
            format!(
                "with a damping ratio of {ratio:.1e} it does not ring down: it is a line that the drive moves"
            )
        } else {
            return None;
        };
        Some(Doubt::RuledOut(because))
    }

    fn resonant_starts(&self, resonances: &[Resonance]) -> Vec<Vec<f64>> {
        resonances
            .iter()
            .map(|r| vec![0.02, r.natural_frequency_rad_s, r.damping_ratio])
            .collect()
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![
            0.05 * case.strength,
            case.about(case.stage.natural_frequency_rad_s * 2.2),
            0.02,
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::EffectInstance;
    use crate::effect::by_id;

    #[test]
    fn a_mode_at_half_the_sampling_rate_or_without_a_ring_is_none() {
        let overview = Overview::without_data(0.0, 100.0);
        let half_rate_rad_s = std::f64::consts::PI * overview.sample_rate_max_hz;
        for (share_of_it, damping_ratio, none) in [
            (0.5, 0.02, false),
            (0.97, 0.02, false),
            (1.0, 0.02, true),
            (0.5, 0.0006, false),
            (0.5, 0.0005, true),
            (0.5, 1.2, true),
        ] {
            let mut model = Model::new(0.0, 100.0);
            for (id, values) in [
                (vibration::ID, vec![4000.0, 0.02]),
                (ID, vec![0.01, share_of_it * half_rate_rad_s, damping_ratio]),
            ] {
                model.add(EffectInstance::new(by_id(id).unwrap(), &overview, &values));
            }
            assert_eq!(model.ruled_out_because(ID).is_some(), none, "{share_of_it}");
        }
    }
}
