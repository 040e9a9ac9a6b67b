//! Maxwell slip hysteresis: elastic-plastic elements in parallel hold back an otherwise linear piezo.

use super::play_operators::PlayOperators;
use super::prandtl_ishlinskii::PlayStage;
use crate::physics::*;

/// Number of elasto-slide elements.
const ELEMENTS: usize = 8;

/// Linear spring less a sum of elasto-slide elements.
///
/// An element stretches by what its play operator stays behind the drive. The structure is therefore that of
/// [`super::prandtl_ishlinskii`] on other thresholds, with the weights of Goldfarb and Celanovic: the play
/// without a threshold has the gain less all stiffnesses, the others a stiffness each.
pub struct MaxwellSlip;

/// Stretch at which element `i` slips, in units of the drive range.
fn limit(i: usize) -> f64 {
    0.5 * (i + 1) as f64 / ELEMENTS as f64
}

impl Effect for MaxwellSlip {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: "maxwell_slip".into(),
            physics: "Elements that stretch and then slip hold part of the charge back: rate-independent loops.".into(),
            reference: "thesis Ch. 2, Eq. 3; Goldfarb and Celanovic, IEEE Control Systems 17 (1997) 69-79".into(),
            experiment: "slow triangles of several heights".into(),
            equations: r"With `X = (x - drive_min_v) / (drive_max_v - drive_min_v)`: `y = gain_um X - sum_i stiffness_i_um e_i`, `i = 0..7`, each `e_i = min(max(e_i + X[k] - X[k-1], -l_i), l_i)` from 0 on, `l_i = (i + 1) / 16`.
At rest the elements follow `X` once from 0.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let mut out = vec![Parameter::linear("gain_um", "um", -1e6, 1e6, step)];
        out.extend(
            (0..ELEMENTS)
                .map(|i| Parameter::linear(format!("stiffness_{i}_um"), "um", -1e6, 1e6, step)),
        );
        out
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let scale = overview.gain_um_v * overview.drive_range_v();
        let mut values = vec![1.1 * scale];
        values.extend([0.02 * scale; ELEMENTS]);
        vec![values]
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        let (gain_um, stiffness_um) = from.values.split_first()?;
        let straight_um = gain_um - stiffness_um.iter().sum::<f64>();
        let elements = (0..).map(limit).zip(stiffness_um.iter().copied());
        let plays: Vec<_> = std::iter::once((0.0, straight_um))
            .chain(elements)
            .collect();
        Some(Box::new(PlayStage::of_plays(
            from.model,
            PlayOperators::new(&plays),
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: the elements of Goldfarb and Celanovic, each stretched by the drive up to where it slips.
    #[test]
    fn plays_are_elasto_slide_elements() {
        let model = Model::new(-10.0, 90.0);
        let stiffness_um = [0.3, -0.1, 0.2, 0.0, 0.4, 0.1, 0.05, 0.6];
        let values = [&[8.0], &stiffness_um[..]].concat();
        let setting = Setting::of_held_drive(-10.0, 90.0, 1e-3);
        let from = Build {
            model: &model,
            values: &values,
            setting: &setting,
        };
        let mut stage = MaxwellSlip.stage(&from).unwrap();
        let (mut stretch, mut last) = ([0.0_f64; ELEMENTS], 0.0);
        for k in 0..400_u32 {
            let t = f64::from(k);
            let drive_v = 40.0 + 50.0 * (0.07 * t).sin() * (0.011 * t).cos();
            let x = (drive_v + 10.0) / 100.0;
            let mut expected_um = 8.0 * x;
            for (i, bent) in stretch.iter_mut().enumerate() {
                *bent = (*bent + x - last).clamp(-limit(i), limit(i));
                expected_um -= stiffness_um[i] * *bent;
            }
            last = x;
            let y_um = stage.step(k as usize, drive_v);
            assert!(
                (y_um - expected_um).abs() < 1e-12,
                "{k}: {y_um} {expected_um}"
            );
        }
    }
}
