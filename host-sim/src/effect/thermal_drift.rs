//! Thermal drift: the mechanics warm up after switching on and move without any cause in the drive.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "thermal_drift";

/// A motion from the start of every record whose rate falls, or grows, exponentially.
pub struct ThermalDrift;

struct DriftStage {
    rate_um_per_interval: f64,
    slowing_per_interval: f64,
}

impl Stage for DriftStage {
    fn step(&mut self, k: usize, input: f64) -> f64 {
        let intervals = k as f64 + 1.0;
        let slowed = self.slowing_per_interval * intervals;
        // At a rate that does not change it is a straight line, with which the exponential agrees to rounding
        // here.
        let at_full_rate = if slowed.abs() < 1e-9 {
            intervals
        } else {
            -(-slowed).exp_m1() / self.slowing_per_interval
        };
        input + self.rate_um_per_interval * at_full_rate
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Drift {
            rate: self.rate_um_per_interval,
            slowing: self.slowing_per_interval,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        input
    }
    fn linear_lanes(&self, _lanes: usize) -> Option<Box<dyn LinearLanes>> {
        Some(Box::new(PassedOn))
    }
}

impl Effect for ThermalDrift {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
                "Warming of stage or sensor moves the reading slowly, whatever the drive does."
                    .into(),
            reference: "Fleming and Leang (2014), Ch. 1".into(),
            experiment: "rest at constant drive for as long as the longest measurement".into(),
            picture: Picture {
                against: Against::Time,
                caption: "An error that goes its own way in time, whatever the drive does.",
            },
            planted: Planted::InPairs,
            equations: r"`y = x + rate_um_s (1 - exp(-slowing_per_s t)) / slowing_per_s`, `t` counted from the first sample of the record; `y = x + rate_um_s t` where `|slowing_per_s t|` is below 1e-9. At rest `y = x`.",
            goes_by_ends: true,
            ..Declaration::at(Place::Drift)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let rate_um_s = overview.range_um.max(1e-6) / overview.duration_s;
        vec![
            Parameter::linear(
                "rate_um_s",
                "um/s",
                -500.0 * rate_um_s,
                500.0 * rate_um_s,
                1e-3 * rate_um_s,
            ),
            // Below zero the drift speeds up, as it does while the source of heat still warms up. About zero
            // it is a straight line: amplitude and time constant, both without limit there, would be known
            // badly each.
            Parameter::linear(
                "slowing_per_s",
                "1/s",
                -4.0 / overview.duration_s,
                50.0 / overview.duration_s,
                0.02 / overview.duration_s,
            ),
        ]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.1, 0.4, 1.5]
            .iter()
            .map(|share| {
                let slowing_per_s = 1.0 / (share * overview.duration_s);
                vec![0.002 * overview.range_um * slowing_per_s, slowing_per_s]
            })
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(DriftStage {
            rate_um_per_interval: from.values[0] * from.setting.dt_s,
            slowing_per_interval: from.values[1] * from.setting.dt_s,
        }))
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        // How warm the stage is when a record begins is as little known as its loops: each such record drifts
        // by an amount of its own.
        vec![FreeMotion {
            decay_per_s: values[1],
            frequency_rad_s: 0.0,
        }]
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        let slowing_per_s = 1.0 / case.about(20.0);
        Some(vec![-0.03 * case.strength * slowing_per_s, slowing_per_s])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, InitialState};
    use crate::effect::{Overview, model_of};

    #[test]
    fn it_is_the_integral_of_a_rate_that_falls_stays_or_grows() {
        let overview = Overview::without_data(0.0, 1.0);
        let dt_s = 1e-3;
        for (rate_um_s, slowing_per_s) in [(0.05, 0.5), (-0.02, 0.0), (0.01, -0.3), (0.03, 1e-13)] {
            let values = [rate_um_s, slowing_per_s];
            let model = model_of(&overview, &[("thermal_drift", &values)]);
            let drive = Drive::held(&[0.0; 3000], dt_s, InitialState::Settled);
            let read_um = model.simulate(&drive);
            // Summed in a hundred pieces of an interval.
            let mut sum_um = 0.0;
            for (k, read_um) in read_um.iter().enumerate() {
                assert!(
                    (read_um - sum_um).abs() < 1e-9,
                    "{rate_um_s} {slowing_per_s} {k}: {read_um} {sum_um}"
                );
                for piece in 0..100 {
                    let middle_s = (k as f64 + (f64::from(piece) + 0.5) / 100.0) * dt_s;
                    sum_um += rate_um_s * (-slowing_per_s * middle_s).exp() * dt_s / 100.0;
                }
            }
        }
    }
}
