//! The chain of an identified model as a plant under control: it goes from period to period, as a real one
//! does.

use super::model::SAMPLING_PERIOD_S;
use hysteron_sim::chain::{Drive, InitialState, Model};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::effect::{Place, Setting, Stage, sensor_bandwidth};

/// Steps of the plant in a period.
pub const SUBSTEPS: usize = 10;

/// How the hysteresis of a plant differs from that of its chain, whatever effect makes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HysteresisChange {
    /// Its gain over the chain's.
    pub gain: f64,
    /// By which share its loops are wider; the displacement at both ends of the drive stays.
    pub wider: f64,
}

impl HysteresisChange {
    /// As the chain has it.
    pub const NONE: Self = Self {
        gain: 1.0,
        wider: 0.0,
    };
}

/// Samples of a drive over the range and back, from which the mean gain is taken.
const RANGE_SAMPLES: usize = 400;

/// Displacement over drive from end to end of the largest loop, um/V.
fn end_to_end_um_v(chain: &Model) -> f64 {
    let mut hysteresis = chain.clone();
    hysteresis
        .effects
        .retain(|e| e.effect.declaration().place == Place::Hysteresis);
    let (low, range) = (chain.drive_min_v, chain.drive_max_v - chain.drive_min_v);
    let up = || (0..=RANGE_SAMPLES).map(|k| k as f64 / RANGE_SAMPLES as f64);
    // A reading shows the drive before it, so both ends are held for a sample.
    let shares = up()
        .chain([1.0])
        .chain(up().map(|share| 1.0 - share))
        .chain([0.0]);
    let drive_v: Vec<f64> = shares.map(|share| low + range * share).collect();
    let y = hysteresis.simulate(&Drive::held(
        &drive_v,
        SAMPLING_PERIOD_S,
        InitialState::Virgin,
    ));
    (y[RANGE_SAMPLES + 1] - y[y.len() - 1]) / range
}

/// The chain of a model as a plant under control.
pub struct ChainPlant<'a> {
    stages: Vec<(bool, Box<dyn Stage + 'a>)>,
    /// The stages that make the hysteresis, first and behind the last, with what is changed of it: gain,
    /// width, and the straight line between its ends, um/V from the lowest drive.
    hysteresis: Option<(std::ops::Range<usize>, HysteresisChange, f64, f64)>,
    /// The stage before which a force from outside acts.
    force_at: usize,
    interval: usize,
    displacement_um: f64,
    sensor_um: f64,
}

impl<'a> ChainPlant<'a> {
    /// At rest at the lowest drive, never driven beyond it; in steps of this sampling period, s.
    #[must_use]
    pub fn at_rest(chain: &Model, low_v: f64, period_s: f64) -> Self {
        Self::changed(chain, HysteresisChange::NONE, low_v, period_s)
    }

    /// The same with another hysteresis.
    #[must_use]
    pub fn changed(chain: &Model, change: HysteresisChange, low_v: f64, period_s: f64) -> Self {
        let setting = Setting {
            substeps: SUBSTEPS,
            ..Setting::of_held_drive(
                chain.drive_min_v,
                chain.drive_max_v,
                period_s / SUBSTEPS as f64,
            )
        };
        let stages =
            position_and_reading_apart(chain, &setting)
                .into_iter()
                .map(|(place, mut stage)| {
                    stage.settle(if place <= Place::Hysteresis {
                        low_v
                    } else {
                        0.0
                    });
                    (place, (place >= Place::SensorNonlinearity, stage))
                });
        let (places, stages): (Vec<Place>, Vec<_>) = stages.unzip();
        let of_hysteresis = places.partition_point(|p| *p < Place::Hysteresis)
            ..places.partition_point(|p| *p <= Place::Hysteresis);
        let is_changed = change != HysteresisChange::NONE && !of_hysteresis.is_empty();
        let hysteresis = is_changed.then(|| (of_hysteresis, change, end_to_end_um_v(chain), low_v));
        let force_at = places
            .iter()
            .position(|place| *place > Place::LoadForce)
            .unwrap_or(places.len());
        Self {
            stages,
            hysteresis,
            force_at,
            interval: 0,
            displacement_um: 0.0,
            sensor_um: 0.0,
        }
    }
}

/// The stages of a chain in their order, the sensor's lag by itself: a mode takes it in, which is exact over
/// a long interval and leaves nothing of the position that the sensor reads.
fn position_and_reading_apart<'a>(
    chain: &Model,
    setting: &Setting<'a>,
) -> Vec<(Place, Box<dyn Stage + 'a>)> {
    let stages_of = |of_the_lag: bool| {
        let mut part = chain.clone();
        part.effects
            .retain(|e| (e.id == sensor_bandwidth::ID) == of_the_lag);
        let stages = part
            .stages(setting)
            .into_iter()
            .map(|(i, stage)| (part.effects[i].effect.declaration().place, stage));
        stages.collect::<Vec<_>>()
    };
    let mut out = stages_of(false);
    out.extend(stages_of(true));
    out.sort_by_key(|(place, _)| *place);
    out
}

impl Plant for ChainPlant<'_> {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        for _ in 0..SUBSTEPS {
            let mut signal = drive_v;
            let mut into_hysteresis_v = drive_v;
            for (at, (of_sensor, stage)) in self.stages.iter_mut().enumerate() {
                if at == self.force_at {
                    signal += external_um;
                    self.displacement_um = signal;
                }
                if self
                    .hysteresis
                    .as_ref()
                    .is_some_and(|(stages, ..)| stages.start == at)
                {
                    into_hysteresis_v = signal;
                }
                signal = stage.step(self.interval, signal);
                if let Some((_, change, line_um_v, low_v)) = self
                    .hysteresis
                    .as_ref()
                    .filter(|(stages, ..)| stages.end == at + 1)
                {
                    let off_the_line_um = signal - line_um_v * (into_hysteresis_v - low_v);
                    signal = change.gain * (signal + change.wider * off_the_line_um);
                }
                if !*of_sensor {
                    self.displacement_um = signal;
                }
            }
            if self.force_at == self.stages.len() {
                signal += external_um;
                self.displacement_um = signal;
            }
            self.sensor_um = signal;
            self.interval += 1;
        }
    }

    fn displacement_um(&self) -> f64 {
        self.displacement_um
    }

    fn sensor_um(&self) -> f64 {
        self.sensor_um
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};
    use std::f64::consts::TAU;

    /// The ends of the loop stay where its width changes, and the loop opens by as much.
    #[test]
    fn a_changed_hysteresis_has_its_gain_and_its_width() {
        let overview = Overview::without_data(0.0, 100.0);
        let mut chain = Model::new(0.0, 100.0);
        chain.add(EffectInstance::new(
            by_id("hysteresis").unwrap(),
            &overview,
            &[9.0, 1.0, -2.0],
        ));
        // Up, down, and up to the middle: behind the loop over the whole range.
        let drive_v = |k: usize| [0.0, 100.0, 50.0, 0.0, 50.0, 100.0][k];
        let positions = |change: HysteresisChange| {
            let mut plant = ChainPlant::changed(&chain, change, 0.0, SAMPLING_PERIOD_S);
            let mut at = Vec::new();
            for k in 0..5 {
                for share in 1..=200 {
                    let share = f64::from(share) / 200.0;
                    plant.advance(drive_v(k) + share * (drive_v(k + 1) - drive_v(k)), 0.0);
                }
                at.push(plant.displacement_um());
            }
            at
        };
        let of = |at: &[f64]| (at[0] - at[2], at[1] - at[3]);
        let (travel, opening) = of(&positions(HysteresisChange::NONE));
        let (wider_travel, wider_opening) = of(&positions(HysteresisChange {
            gain: 1.0,
            wider: 0.2,
        }));
        assert!(opening > 0.01 * travel, "{opening} {travel}");
        assert!(
            (wider_travel / travel - 1.0).abs() < 1e-6
                && (wider_opening / opening - 1.2).abs() < 1e-6
        );
        let (stronger, _) = of(&positions(HysteresisChange {
            gain: 1.2,
            wider: 0.0,
        }));
        assert!((stronger / travel - 1.2).abs() < 1e-6);
    }

    /// A force moves the stage at rest by what it is given as, whatever stands behind it.
    #[test]
    fn a_force_from_outside_moves_what_the_sensor_reads() {
        let overview = Overview::without_data(0.0, 100.0);
        for ids in [
            vec!["gain"],
            vec!["gain", "sensor_bandwidth"],
            vec!["gain", "vibration", "sensor_bandwidth"],
        ] {
            let mut chain = Model::new(0.0, 100.0);
            ids.iter().for_each(|id| {
                chain.add(EffectInstance::new(by_id(id).unwrap(), &overview, &[]));
            });
            let mut plant = ChainPlant::at_rest(&chain, 0.0, SAMPLING_PERIOD_S);
            (0..20_000).for_each(|_| plant.advance(0.0, 0.3));
            assert!(
                (plant.displacement_um() - 0.3).abs() < 1e-6
                    && (plant.sensor_um() - 0.3).abs() < 1e-6,
                "{ids:?}"
            );
        }
    }

    /// Behind a ramp a mode is late by 2 xi / omega, and its sensor by its own lag more: closed forms.
    #[test]
    fn the_position_is_in_front_of_the_sensors_lag_whether_or_not_a_mode_stands_there() {
        let overview = Overview::without_data(0.0, 100.0);
        let (gain_um_v, frequency_rad_s, damping_ratio, bandwidth_hz) = (0.1, 5000.0, 0.5, 1000.0);
        let effects: [(&str, Vec<f64>); 3] = [
            ("gain", vec![gain_um_v]),
            ("vibration", vec![frequency_rad_s, damping_ratio]),
            ("sensor_bandwidth", vec![bandwidth_hz]),
        ];
        for with_mode in [true, false] {
            let mut chain = Model::new(0.0, 100.0);
            for (id, values) in effects
                .iter()
                .filter(|(id, _)| with_mode || *id != "vibration")
            {
                chain.add(EffectInstance::new(by_id(id).unwrap(), &overview, values));
            }
            let mut plant = ChainPlant::at_rest(&chain, 0.0, SAMPLING_PERIOD_S);
            let (per_period_v, periods) = (0.05, 400);
            for k in 0..periods {
                plant.advance(per_period_v * f64::from(k), 0.0);
            }
            let speed_um_s = gain_um_v * per_period_v / SAMPLING_PERIOD_S;
            let reads_late_um = plant.displacement_um() - plant.sensor_um();
            let lag_um = speed_um_s / (TAU * bandwidth_hz);
            // The staircase of the drive comes to half a step of it.
            assert!(
                (reads_late_um - lag_um).abs() < 0.51 * gain_um_v * per_period_v,
                "{with_mode} {reads_late_um} {lag_um}"
            );
            let mode_s = if with_mode {
                2.0 * damping_ratio / frequency_rad_s
            } else {
                0.0
            };
            let expected_um =
                gain_um_v * per_period_v * f64::from(periods - 1) - speed_um_s * mode_s;
            assert!(
                (plant.displacement_um() - expected_um).abs() < 1.1 * gain_um_v * per_period_v,
                "{with_mode}"
            );
        }
    }
}
