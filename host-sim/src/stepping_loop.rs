//! A stick-slip drive and its stepping tick, closed through encoder and converter.
//!
//! # How it works
//! At every tick the encoder counts the slider's position with its noise, the tick computes a code, and the
//! plant goes on for one period under the code of the last tick, as in [`crate::closed_loop`].

use crate::closed_loop::Plant;
use crate::converter_scale::ConverterScale;
use crate::noise::WhiteNoise;
use hysteron_core::codes::{DriveCode, EncoderCount};
use hysteron_core::signal::{Micrometres, Travel};
use hysteron_core::stepping::{Refusal, SteppingCounters, SteppingFault, SteppingTick};

/// Rig and tick, and what stands between them.
pub struct SteppingLoop<P> {
    /// The rig.
    pub plant: P,
    /// The tick.
    pub tick: SteppingTick,
    /// Converters; the sensor's step is that of the encoder.
    pub scale: ConverterScale,
    /// Sampling period, s.
    pub period_s: f64,
    noise: WhiteNoise,
    acting: DriveCode,
}

/// A move, and how it ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MoveFigures {
    /// Time until the tick reported the arrival, s; none if it did not.
    pub arrived_s: Option<f64>,
    /// What stopped it.
    pub fault: Option<&'static str>,
    /// Teeth.
    pub teeth: u32,
    /// Mean true error over the time behind the arrival, um.
    pub error_um: f64,
    /// Largest true error over that time, um.
    pub error_max_um: f64,
    /// Swing behind the arrival: true peak to peak, um.
    pub swing_um: f64,
    /// What the tick counted, from its beginning on.
    pub counters: SteppingCounters,
}

impl<P: Plant> SteppingLoop<P> {
    /// A loop whose encoder has white noise, um RMS.
    pub fn new(
        plant: P,
        tick: SteppingTick,
        scale: ConverterScale,
        period_s: f64,
        (noise_um, seed): (f64, u64),
    ) -> Self {
        let acting = tick.trace_sample().dac_code;
        Self {
            plant,
            tick,
            scale,
            period_s,
            noise: WhiteNoise::new(noise_um, seed),
            acting,
        }
    }

    /// What the encoder counts now.
    fn count(&mut self) -> EncoderCount {
        let reading_um = self.plant.sensor_um() + self.noise.next_um();
        EncoderCount((reading_um / self.scale.adc_lsb_um).round() as i32)
    }

    /// One period.
    pub fn advance(&mut self) {
        let count = self.count();
        let next = self.tick.tick(Some(count));
        self.plant.advance(self.scale.drive_v(self.acting), 0.0);
        self.acting = next;
    }

    /// Moves to a target, and watches what is behind the arrival for a time.
    ///
    /// # Errors
    /// The tick refuses the move.
    pub fn move_to(
        &mut self,
        target_um: f64,
        within_s: f64,
        watched_s: f64,
    ) -> Result<MoveFigures, Refusal> {
        let ticks = |time_s: f64| (time_s / self.period_s).round() as usize;
        let (within, watched) = (ticks(within_s), ticks(watched_s));
        self.tick.move_to(Travel::saturating_from_num(target_um))?;
        let before = self.tick.counters().teeth;
        let mut figures = MoveFigures::default();
        for k in 0..within {
            self.advance();
            if self.tick.has_arrived() {
                figures.arrived_s = Some((k + 1) as f64 * self.period_s);
                break;
            }
            if self.tick.fault().is_some() {
                break;
            }
        }
        let (mut low, mut high, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for _ in 0..watched {
            self.advance();
            let error = self.plant.displacement_um() - target_um;
            (low, high, sum) = (low.min(error), high.max(error), sum + error);
        }
        figures.teeth = self.tick.counters().teeth - before;
        figures.error_um = sum / watched.max(1) as f64;
        figures.error_max_um = low.abs().max(high.abs());
        figures.swing_um = high - low;
        figures.fault = self.tick.fault().map(SteppingFault::name);
        figures.counters = self.tick.counters();
        Ok(figures)
    }

    /// Follows a velocity and gives the true position at every tick, um.
    ///
    /// # Errors
    /// The tick refuses it.
    pub fn follow(&mut self, velocity_um_s: f64, for_s: f64) -> Result<Vec<f64>, Refusal> {
        let per_tick = Micrometres::saturating_from_num(velocity_um_s * self.period_s);
        self.tick.follow(per_tick)?;
        let count = (for_s / self.period_s).round() as usize;
        Ok((0..count)
            .map(|_| {
                self.advance();
                self.plant.displacement_um()
            })
            .collect())
    }
}
