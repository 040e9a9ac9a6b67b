//! Slew limit of the amplifier: its current charges the piezo no faster than so many volts per second.

use crate::block::Block;
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::SLEW_LIMIT;

/// Limit of the slope of the piezo voltage.
pub struct SlewLimit;

struct SlewStage {
    step_max_v: f64,
    voltage_v: f64,
    gives_mean: bool,
}

impl Stage for SlewStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let away = input - self.voltage_v;
        let size = away.abs();
        let start = self.voltage_v;
        let arrives = size <= self.step_max_v;
        self.voltage_v = if arrives {
            input
        } else {
            start + away.signum() * self.step_max_v
        };
        if !self.gives_mean {
            self.voltage_v
        } else if arrives {
            // Mean over the interval of a ramp that arrives after the fraction size / step_max.
            let ramp = if self.step_max_v > 0.0 {
                size / self.step_max_v
            } else {
                1.0
            };
            input - away * 0.5 * ramp
        } else {
            0.5 * (start + self.voltage_v)
        }
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Slope {
            most: self.step_max_v,
            gives_mean: self.gives_mean,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.voltage_v = input;
        input
    }
}

impl Effect for SlewLimit {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
                "The amplifier's current limit clamps how fast the voltage on the piezo can change."
                    .into(),
            reference: "Fleming and Leang (2014), Ch. 14".into(),
            experiment: "large sines of rising frequency: straight flanks above one slope".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Rate,
                caption: "An error that grows with the rate of the drive and changes sign with it.",
            },
            equations: r"`|y'| <= slew_v_s`. The period is divided into `inside(T)` sub-intervals.

With `D = slew_v_s T` and `e = x[k] - v[k-1]`: the voltage arrives, `v[k] = x[k]`, where `|e| <= D`, otherwise `v[k] = v[k-1] + D sign(e)`. With a mode or a sensor's lag in the
model it gives the mean over the interval: `y[k] = x[k] - e |e| / (2 D)` where it arrives, `(v[k-1] + v[k]) / 2` otherwise; without either `y[k] = v[k]`. At rest `v = y = x`.",
            ..Declaration::at(Place::AmplifierSlew)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        vec![Parameter::logarithmic(
            "slew_v_s",
            "V/s",
            1.0,
            20.0 * overview.slope_max_v_s.max(1.0),
        )]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        [0.9, 0.7, 0.5, 0.35, 0.22, 0.12, 0.06, 0.03]
            .iter()
            .map(|share| vec![share * overview.slope_max_v_s.max(1.0)])
            .collect()
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        let gives_mean = !from.setting.runs_straight && takes_the_mean_in(from.model);
        Some(Box::new(SlewStage {
            step_max_v: from.values[0] * from.setting.dt_s,
            voltage_v: from.model.drive_min_v,
            gives_mean,
        }))
    }

    fn substeps(&self, _model: &Model, dt_s: f64) -> usize {
        substeps_inside_period(dt_s)
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![8500.0 / case.strength.max(0.01)])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, InitialState};
    use crate::effect::{Overview, model_of};

    /// Of a straight stage, 0.1 um/V, behind an amplifier of 6000 V/s and of a lag of 300 Hz, each where it
    /// is asked for.
    fn read(effect: (&str, f64), drive_v: &[f64], dt_s: f64) -> Vec<f64> {
        let overview = Overview::without_data(0.0, 80.0);
        let model = model_of(&overview, &[("gain", &[0.1, 0.0]), (effect.0, &[effect.1])]);
        model.simulate(&Drive::held(drive_v, dt_s, InitialState::Settled))
    }

    fn drive_v(dt_s: f64) -> Vec<f64> {
        (0..2000)
            .map(|k| 40.0 - 35.0 * (std::f64::consts::TAU * 60.0 * f64::from(k) * dt_s).cos())
            .collect()
    }

    #[test]
    fn a_straight_stage_without_inertia_shows_the_voltage_at_the_instant_of_sampling() {
        let dt_s = 1.0 / 7300.0;
        let drive_v = drive_v(dt_s);
        // Written a second time, period by period: the voltage of a held drive moves by the limit at most, or
        // by its lag.
        let (mut limited_v, mut lagging_v) = (drive_v[0], drive_v[0]);
        let slew = read(("slew_limit", 6000.0), &drive_v, dt_s);
        let lag = read(("amplifier_bandwidth", 300.0), &drive_v, dt_s);
        let step_v = 6000.0 * dt_s;
        let remains = (-std::f64::consts::TAU * 300.0 * dt_s).exp();
        let mut at_the_limit = 0;
        for k in 1..drive_v.len() {
            at_the_limit += usize::from((drive_v[k - 1] - limited_v).abs() > step_v);
            limited_v += (drive_v[k - 1] - limited_v).clamp(-step_v, step_v);
            lagging_v = drive_v[k - 1] + (lagging_v - drive_v[k - 1]) * remains;
            assert!(
                (slew[k] - 0.1 * limited_v).abs() < 1e-9,
                "{k}: {} um",
                slew[k] - 0.1 * limited_v
            );
            assert!(
                (lag[k] - 0.1 * lagging_v).abs() < 1e-9,
                "{k}: {} um",
                lag[k] - 0.1 * lagging_v
            );
        }
        assert!(at_the_limit > 500, "{at_the_limit}");
    }
}
