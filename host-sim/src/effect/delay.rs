//! Transport delay of the drive.
//!
//! A held drive that acts late moves a step to an instant inside the sampling period. Rate-independent
//! hysteresis passes steps on as steps, so in front of inertia the vibration stage takes the delay in: it is
//! exact there without sub-intervals. Where something between the two moves inside the period or has a clock
//! of its own, the delay stands where it acts and the period is divided.

use crate::block::Block;
use crate::physics::*;
use std::collections::VecDeque;

/// Identifier in files and on the command line.
pub const ID: &str = "delay";

/// The drive acts later than it was commanded.
pub struct Delay;

struct DelayStage {
    line: VecDeque<f64>,
    late_share: f64,
}

impl Stage for DelayStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.line.push_back(input);
        let late = self.line.pop_front().unwrap_or(input);
        let early = self.line.front().copied().unwrap_or(input);
        // The mean over the interval of the held drive that changes inside it.
        self.late_share * late + (1.0 - self.late_share) * early
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        Ok(vec![Block::Delay {
            whole: self.line.len() - 1,
            late_share: self.late_share,
        }])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.line.iter_mut().for_each(|v| *v = input);
        input
    }
}

/// The delay that the vibration stage takes in, s.
pub(super) fn taken_in_s(model: &Model) -> Option<f64> {
    let delay = model.effect(ID)?;
    model.effect(id::VIBRATION)?;
    let passes_steps_on = |e: &EffectInstance| {
        let place = e.effect.declaration().place;
        // Friction acts on the moving mass, in the vibration stage.
        let behind_or_itself =
            place >= Place::Vibration || matches!(place, Place::Friction | Place::Delay);
        let without_clock = matches!(
            place,
            Place::AmplifierSaturation | Place::Charge | Place::Hysteresis
        ) && e.effect.declaration().definition.is_none();
        behind_or_itself || without_clock
    };
    model
        .effects
        .iter()
        .all(passes_steps_on)
        .then(|| delay.parameters[0].value)
}

impl Effect for Delay {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Converters and computation take time: the drive acts a fixed time after it was written.".into(),
            reference: "Franklin, Powell, Workman, Digital Control of Dynamic Systems (1998)".into(),
            modifies: Some(id::VIBRATION),
            experiment: "a multisine: phase that falls in proportion to frequency at flat gain".into(),
            one_sided: true,
            picture: Picture {
                against: Against::Rate,
                caption: "An error that grows with the rate of the drive and changes sign with it.",
            },
            planted: Planted::InPairs,
            equations: r"The drive acts `delay_s` later: `y(t) = x(t - delay_s)`.

Beside `vibration`, and with nothing between the two but saturation, charge leakage, hysteresis and friction, the modes take the delay in. With `d = delay_s / T`, its whole
part delays the input of the modes by as many intervals, and its fraction `f` makes that input arrive late by the share `f` (*Arrival*).

Otherwise the delay stands where it acts, and gives the mean of the held input that changes inside the interval: `y[k] = f x[k-d-1] + (1 - f) x[k-d]` with whole `d`. Then, for
`T` above 60 us and with an amplifier, a slew limit, a mode or a sensor's lag in the model, the period is divided into `max(2, inside(T))` sub-intervals. At rest `y = x`.",
            ..Declaration::at(Place::Delay)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let dt_s = 1.0 / overview.sample_rate_max_hz;
        vec![Parameter::linear(
            "delay_s",
            "s",
            0.0,
            200.0 * dt_s,
            0.05 * dt_s,
        )]
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let dt_s = 1.0 / overview.sample_rate_max_hz;
        vec![vec![0.5 * dt_s], vec![2.0 * dt_s], vec![5.0 * dt_s]]
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        // Where the drive runs straight, what the stage makes of two ends is no mean but the place between
        // them.
        if taken_in_s(from.model).is_some() && !from.setting.runs_straight {
            return None;
        }
        let intervals = (from.values[0] / from.setting.dt_s).max(0.0);
        let whole = intervals.floor();
        let line = std::iter::repeat_n(from.model.drive_min_v, whole as usize + 1).collect();
        Some(Box::new(DelayStage {
            line,
            late_share: intervals - whole,
        }))
    }

    fn substeps(&self, model: &Model, dt_s: f64) -> usize {
        // Without anything that takes time, a step would pass through at once and all delays between two
        // samples would read the same: the mean over the interval stands for the motion that a real stage
        // makes of the steps.
        let takes_time = |e: &EffectInstance| {
            matches!(
                e.effect.declaration().place,
                Place::AmplifierBandwidth
                    | Place::AmplifierSlew
                    | Place::Vibration
                    | Place::SensorBandwidth
            )
        };
        if taken_in_s(model).is_some() || !model.effects.iter().any(takes_time) {
            return 1;
        }
        // The mean over a fast period is as good as the delay itself; in a slow one the motion is over before
        // the period is.
        if dt_s > 60e-6 {
            substeps_inside_period(dt_s).max(2)
        } else {
            1
        }
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(vec![50e-6 * case.strength])
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, EffectInstance, InitialState, Model};
    use crate::effect::{Overview, by_id};

    fn model(delay_s: f64, friction: bool) -> Model {
        let overview = Overview::without_data(0.0, 70.0);
        let mut model = Model::new(0.0, 70.0);
        let mut add = |id: &str, values: &[f64]| {
            model.add(EffectInstance::new(by_id(id).unwrap(), &overview, values))
        };
        add("hysteresis", &[10.0, 1.0, -1.0]);
        add("delay", &[delay_s]);
        add("vibration", &[6000.0, 0.1]);
        add("second_mode", &[0.1, 14_000.0, 0.02]);
        add("sensor_bandwidth", &[3000.0]);
        if friction {
            add("friction", &[0.05, 1.0, 0.0]);
        }
        model
    }

    fn drive_v(samples: usize) -> Vec<f64> {
        (0..samples)
            .map(|k| 35.0 + 30.0 * (0.3 * k as f64).sin() * (0.017 * k as f64).cos())
            .collect()
    }

    fn simulate(model: &Model, drive_v: &[f64], dt_s: f64) -> Vec<f64> {
        model.simulate(&Drive::held(drive_v, dt_s, InitialState::Settled))
    }

    /// Late by so many fifths of a period, against a drive held over fifths and shifted by as many of them
    /// through the punctual chain.
    fn largest_difference_from_shifted_drive(fifths: usize, friction: bool, dt_s: f64) -> f64 {
        let drive_v = drive_v(300);
        let late = simulate(&model(0.2 * fifths as f64 * dt_s, friction), &drive_v, dt_s);
        let shifted: Vec<f64> = (0..5 * drive_v.len())
            .map(|k| drive_v[k.saturating_sub(fifths) / 5])
            .collect();
        let fine = simulate(&model(0.0, friction), &shifted, dt_s / 5.0);
        late.iter()
            .enumerate()
            .map(|(k, late)| (late - fine[5 * k]).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_delay_between_samples_is_a_shift_of_a_finer_held_drive() {
        for fifths in [15, 17, 19] {
            assert!(largest_difference_from_shifted_drive(fifths, false, 50e-6) < 1e-9);
            // At this period the bristle is followed in five pieces of an interval, so that both chains take
            // the same steps. While it slides its bend is taken to be that of steady sliding, to a
            // hundred-thousandth of the 0.05 um that it holds back; how often that is, is not the same.
            assert!(
                largest_difference_from_shifted_drive(fifths, true, 350e-6) < 1e-5 * 0.05,
                "{fifths}"
            );
        }
    }

    /// Derivatives by the delay are taken by moving it: nothing may jump where it becomes a whole number of
    /// periods, or of pieces of one.
    #[test]
    fn the_reading_is_continuous_in_the_delay() {
        let (dt_s, drive_v) = (500e-6, drive_v(200));
        for friction in [false, true] {
            for periods in [1.5, 1.9, 2.0, 2.1, 2.25] {
                let [below, above] = [-1e-6, 1e-6].map(|more| {
                    simulate(&model((periods + more) * dt_s, friction), &drive_v, dt_s)
                });
                let jump_um = below
                    .iter()
                    .zip(&above)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f64::max);
                assert!(jump_um < 3e-4, "{friction} {periods}: {jump_um}");
            }
        }
    }
}
