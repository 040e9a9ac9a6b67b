//! The chain of an identified model as a plant under control: it goes from period to period, as a real one does.

use super::model::SAMPLING_PERIOD_S;
use hysteron_sim::chain::Model;
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::effect::{Place, Setting, Signals, Stage};

/// Steps of the plant in a period.
pub const SUBSTEPS: usize = 10;

/// The chain of a model as a plant under control.
pub struct ChainPlant<'a> {
    stages: Vec<(bool, Box<dyn Stage + 'a>)>,
    interval: usize,
    displacement_um: f64,
    sensor_um: f64,
}

impl<'a> ChainPlant<'a> {
    /// At rest at the lowest drive, never driven beyond it.
    #[must_use]
    pub fn at_rest(chain: &Model, low_v: f64) -> Self {
        let setting = Setting {
            dt_s: SAMPLING_PERIOD_S / SUBSTEPS as f64,
            substeps: SUBSTEPS,
            signals: Signals::default(),
            drive_min_v: chain.drive_min_v,
            drive_max_v: chain.drive_max_v,
        };
        let stages = chain.stages(&setting).into_iter().map(|(i, mut stage)| {
            let place = chain.effects[i].effect.declaration().place;
            stage.settle(if place <= Place::Hysteresis { low_v } else { 0.0 });
            (place >= Place::SensorNonlinearity, stage)
        });
        Self { stages: stages.collect(), interval: 0, displacement_um: 0.0, sensor_um: 0.0 }
    }
}

impl Plant for ChainPlant<'_> {
    fn advance(&mut self, drive_v: f64, _external_um: f64) {
        for _ in 0..SUBSTEPS {
            let mut signal = drive_v;
            for (of_sensor, stage) in &mut self.stages {
                signal = stage.step(self.interval, signal);
                if !*of_sensor {
                    self.displacement_um = signal;
                }
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
