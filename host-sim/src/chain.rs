//! A model: a list of effects with values. It builds the chain of stages for one record and runs it.
//!
//! The order of the list does not matter; effects stand in the chain where they declare
//! ([`crate::effect::Place`]). A model without any effect at the place of the hysteresis follows its drive
//! one to one, which no real model does: `gain` is the least.
//!
//! Effects that follow the drive inside a sampling period (amplifier bandwidth, slew limit) make the chain
//! run on sub-intervals; a held drive keeps its value over all the sub-intervals of a sample, another one
//! runs on ([`crate::intersample`]).

use crate::intersample::Intersample;
use crate::physics::{AuxiliarySignal, Place, Setting, Signals, Stage};
pub use crate::physics::{EffectInstance, Identified, InitialState, Model, ParameterValue};
use std::borrow::Cow;

/// The drive of one record, as the chain sees it.
#[derive(Clone, Copy, Debug)]
pub struct Drive<'a> {
    /// Drive, at every sample.
    pub drive_v: &'a [f64],
    /// External force, if measured.
    pub force_n: Option<&'a [f64]>,
    /// Further signals that were recorded, for effects of the user's own.
    pub auxiliary: &'a [AuxiliarySignal],
    /// Sampling period, s.
    pub dt_s: f64,
    /// State at the first sample.
    pub initial_state: InitialState,
    /// What the drive does between samples.
    pub intersample: Intersample,
}

impl<'a> Drive<'a> {
    /// A drive that a converter holds from each sample to the next, with nothing recorded beside it.
    #[must_use]
    pub fn held(drive_v: &'a [f64], dt_s: f64, initial_state: InitialState) -> Self {
        Self {
            drive_v,
            force_n: None,
            auxiliary: &[],
            dt_s,
            initial_state,
            intersample: Intersample::Hold,
        }
    }

    /// Signals of the record that stages receive.
    #[must_use]
    pub fn signals(&self) -> Signals<'a> {
        Signals {
            drive_v: self.drive_v,
            force_n: self.force_n,
            auxiliary: self.auxiliary,
        }
    }

    /// What the chain takes in over each interval where a period has so many, and whether that is in
    /// sub-intervals: a drive that is held goes in whole periods as far as the stages do.
    pub(crate) fn over_intervals(&self, substeps: usize) -> (Cow<'a, [f64]>, bool) {
        match self.intersample {
            Intersample::Hold => (Cow::Borrowed(self.drive_v), false),
            other => (
                Cow::Owned(other.at_ends(self.drive_v, substeps)),
                substeps > 1,
            ),
        }
    }
}

impl Model {
    /// Sub-intervals per sample.
    #[must_use]
    pub fn substeps(&self, dt_s: f64) -> usize {
        self.effects
            .iter()
            .map(|e| e.effect.substeps(self, dt_s))
            .max()
            .unwrap_or(1)
            .max(1)
    }

    /// Sub-intervals per sample of a drive, which may need some of its own.
    #[must_use]
    pub fn substeps_for(&self, drive: &Drive) -> usize {
        self.substeps(drive.dt_s).max(drive.intersample.substeps())
    }

    /// The effects in the order of the chain, each with whether it goes in sub-intervals of a period. What
    /// holds its value over a period is carried once a period, as far as the first stage that moves inside
    /// it; from there on all go in sub-intervals, but for the last ones where ends of periods tell them all.
    pub(crate) fn order_with_fineness(&self, drive: &Drive) -> Vec<(usize, bool)> {
        let (order, dt_s) = (self.order(), drive.dt_s);
        // A drive that is not held moves inside a period from the first stage on.
        let moves = drive.intersample != Intersample::Hold && self.substeps_for(drive) > 1;
        let fine_from = if moves {
            Some(0)
        } else {
            order
                .iter()
                .position(|&effect| self.goes_in_sub_intervals(effect, dt_s))
        }
        .unwrap_or(order.len());
        let by_ends = |effect: &&usize| {
            self.effects[**effect].effect.goes_by_ends(self)
                && !self.goes_in_sub_intervals(**effect, dt_s)
        };
        let fine_until = order.len() - order.iter().rev().take_while(by_ends).count();
        order
            .into_iter()
            .enumerate()
            .map(|(place, effect)| (effect, (fine_from..fine_until).contains(&place)))
            .collect()
    }

    /// The stages for a drive of this period.
    fn walk<'a>(&self, drive: &Drive<'a>, resolution: Resolution) -> Vec<WalkStage<'a>> {
        let mut out = Vec::new();
        for (effect, fine) in self.order_with_fineness(drive) {
            let (instance, fine) = (&self.effects[effect], fine || resolution.all_fine);
            let setting = self.setting(drive, if fine { resolution.substeps } else { 1 });
            out.extend(
                instance
                    .stage(self, &setting)
                    .map(|stage| WalkStage { fine, stage }),
            );
        }
        out
    }

    /// Whether an effect, by position in the list, has to go in sub-intervals: it moves inside a period, or
    /// it is a mode whose motion inside a period is followed by what stands behind it, or an amplifier whose
    /// voltage is taken in them.
    pub(crate) fn goes_in_sub_intervals(&self, effect: usize, dt_s: f64) -> bool {
        let instance = &self.effects[effect];
        let follows = |e: &EffectInstance| {
            let declaration = e.effect.declaration();
            declaration.follows_motion && declaration.place > Place::Vibration
        };
        instance.effect.substeps(self, dt_s) > 1
            || (instance.effect.declaration().place == Place::AmplifierBandwidth
                && self.substeps(dt_s) > 1)
            || (instance.effect.declaration().place == Place::Vibration
                && self.effects.iter().any(follows))
    }

    /// Settings for the stages of this model.
    pub(crate) fn setting<'a>(&self, drive: &Drive<'a>, substeps: usize) -> Setting<'a> {
        Setting {
            dt_s: drive.dt_s / substeps as f64,
            substeps,
            signals: drive.signals(),
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
            runs_straight: drive.intersample != Intersample::Hold,
        }
    }

    /// What the sensor would read at every sample of a record, in um.
    #[must_use]
    pub fn simulate(&self, drive: &Drive) -> Vec<f64> {
        self.simulate_in(
            drive,
            Resolution {
                substeps: self.substeps_for(drive),
                all_fine: false,
            },
        )
    }

    /// [`Self::simulate`] with every stage stepped in so many intervals per period: a plant that does not share the
    /// discretisation of a model.
    #[must_use]
    pub fn simulate_finely(&self, drive: &Drive, substeps: usize) -> Vec<f64> {
        self.simulate_in(
            drive,
            Resolution {
                substeps: substeps.max(1),
                all_fine: true,
            },
        )
    }

    fn simulate_in(&self, drive: &Drive, resolution: Resolution) -> Vec<f64> {
        let carried = Carried::at_start(self, drive, resolution.substeps);
        carry(
            self.walk(drive, resolution),
            carried,
            resolution.substeps,
            drive.drive_v.len(),
        )
    }
}

/// How finely a walk goes.
#[derive(Clone, Copy, Debug)]
struct Resolution {
    substeps: usize,
    all_fine: bool,
}

struct WalkStage<'a> {
    fine: bool,
    stage: Box<dyn Stage + 'a>,
}

/// A signal somewhere in the chain.
#[derive(Clone, Debug)]
struct Carried {
    signal: Vec<f64>,
    /// In sub-intervals.
    fine: bool,
    at_rest: f64,
}

impl Carried {
    /// The drive, in front of everything.
    fn at_start(model: &Model, drive: &Drive, substeps: usize) -> Self {
        let (signal, fine) = drive.over_intervals(substeps);
        Self {
            signal: signal.into_owned(),
            fine,
            at_rest: model.resting_drive_v(drive),
        }
    }

    /// Goes over to sub-intervals.
    fn refine(&mut self, substeps: usize) {
        if !self.fine {
            self.signal = spread(&self.signal, substeps);
            self.fine = true;
        }
    }

    /// Goes back to whole periods: where it stands at the end of each.
    fn coarsen(&mut self, substeps: usize) {
        if self.fine {
            self.signal = ends(&self.signal, substeps);
            self.fine = false;
        }
    }
}

/// Carries a signal through stages.
fn carry<'a>(
    stages: impl IntoIterator<Item = WalkStage<'a>>,
    mut carried: Carried,
    substeps: usize,
    samples: usize,
) -> Vec<f64> {
    for WalkStage { fine, mut stage } in stages {
        if fine {
            carried.refine(substeps)
        } else {
            carried.coarsen(substeps)
        }
        carried.at_rest = stage.settle(carried.at_rest);
        stage.run(0, &mut carried.signal);
    }
    sample(
        &carried.signal,
        carried.at_rest,
        if carried.fine { substeps } else { 1 },
        samples,
    )
}

impl Model {
    /// The drive at which the actuator rests before the first sample, V.
    #[must_use]
    pub fn resting_drive_v(&self, drive: &Drive) -> f64 {
        match drive.initial_state {
            InitialState::Virgin => self.virgin_drive_v(),
            InitialState::Settled | InitialState::Unknown => {
                drive.drive_v.first().copied().unwrap_or(self.drive_min_v)
            }
        }
    }
}

/// A signal held over the sub-intervals of each sample.
fn spread(signal: &[f64], substeps: usize) -> Vec<f64> {
    if substeps == 1 {
        return signal.to_vec();
    }
    signal
        .iter()
        .flat_map(|value| std::iter::repeat_n(*value, substeps))
        .collect()
}

/// The values at the ends of sampling periods of a signal in sub-intervals.
pub(crate) fn ends(signal: &[f64], substeps: usize) -> Vec<f64> {
    signal
        .iter()
        .skip(substeps - 1)
        .step_by(substeps)
        .copied()
        .collect()
}

/// What is measured at every sample: the value at the end of the interval before it.
#[must_use]
fn sample(signal: &[f64], at_rest: f64, substeps: usize, samples: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(samples);
    out.push(at_rest);
    out.extend(
        signal
            .iter()
            .skip(substeps - 1)
            .step_by(substeps)
            .take(samples.saturating_sub(1)),
    );
    out.truncate(samples);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Overview, model_of};

    /// Behind what moves inside a period creep and a sensor's curve go by the ends of periods; a sensor's lag
    /// without a mode does not, and neither does what stands in front of it. Against every stage in steps of
    /// a fortieth of a period.
    #[test]
    fn last_stages_go_by_the_ends_of_periods() {
        let overview = Overview::without_data(0.0, 70.0);
        let model = |effects: &[(&str, &[f64])]| model_of(&overview, effects);
        let creep: &[f64] = &[0.01, 0.02, 0.01, 0.2, 0.01, 2.0, 0.01, 20.0];
        let amplifier: (&str, &[f64]) = ("amplifier_bandwidth", &[900.0]);
        let behind: &[(&str, &[f64])] = &[("hysteresis", &[10.0, 1.0, -1.0]), ("creep", creep)];
        let front = &[&[amplifier, ("slew_limit", &[60e3])], behind].concat()[..];
        let without_slew_limit = model(
            &[
                &[amplifier],
                behind,
                &[
                    ("vibration", &[2500.0, 0.2]),
                    ("sensor_bandwidth", &[2000.0]),
                ],
            ]
            .concat(),
        );
        let with_mode = model(
            &[
                front,
                &[
                    ("vibration", &[2500.0, 0.2]),
                    ("sensor_nonlinearity", &[0.01]),
                    ("sensor_bandwidth", &[2000.0]),
                ],
            ]
            .concat(),
        );
        let with_lag = model(&[front, &[("sensor_bandwidth", &[2000.0])]].concat());
        let drive_v: Vec<f64> = (0..2000)
            .map(|k| 35.0 + 30.0 * (0.3 * f64::from(k)).sin() * (0.017 * f64::from(k)).cos())
            .collect();
        let drive = Drive::held(&drive_v, 100e-6, InitialState::Settled);
        for (model, fine, more_um) in [
            (&with_mode, 4, 1e-5),
            (&with_lag, 5, 1e-5),
            (&without_slew_limit, 3, 6e-4),
        ] {
            let order = model.order_with_fineness(&drive);
            let ids: Vec<&str> = order
                .iter()
                .filter(|(_, fine)| *fine)
                .map(|(effect, _)| model.effects[*effect].id.as_str())
                .collect();
            assert_eq!(ids.len(), fine, "{ids:?}");
            let finely = model.simulate_finely(&drive, 40);
            let rms_um = |reading: &[f64]| {
                (reading
                    .iter()
                    .zip(&finely)
                    .map(|(a, b)| (a - b).powi(2))
                    .sum::<f64>()
                    / finely.len() as f64)
                    .sqrt()
            };
            // What four steps of every stage leave of this fast drive is the slew limit's; without one, loops
            // are straight over halves of a period.
            let (plain_um, all_in_four_um) = (
                rms_um(&model.simulate(&drive)),
                rms_um(&model.simulate_finely(&drive, 4)),
            );
            assert!(
                plain_um < all_in_four_um + more_um,
                "{ids:?}: {plain_um} {all_in_four_um}"
            );
        }
    }
}
