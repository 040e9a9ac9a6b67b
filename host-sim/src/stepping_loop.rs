//! A stick-slip drive and its amplifier, closed through encoder and converter.
//!
//! # How it works
//! At every tick the encoder counts the slider's position with its noise, the amplifier computes a code, and
//! the plant goes on for one period under the code of the last tick, as in [`crate::closed_loop`].

use crate::closed_loop::Plant;
use crate::noise::WhiteNoise;
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::{Command, Refusal};
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::guard::Fault;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::signal::{Micrometres, Travel};
use hysteron_core::stepping::{Stepper, SteppingCounters};
use hysteron_core::stepping_parameters::ENCODER_BITS;

/// Rig and amplifier, and what stands between them.
pub struct SteppingLoop<P> {
    /// The rig.
    pub plant: P,
    /// The amplifier.
    pub amplifier: Amplifier,
    noise: WhiteNoise,
    acting: DriveCode,
}

/// The encoder's reading of a position: the lowest bits of the count of steps of so many um.
#[must_use]
pub fn encoder_code(position_um: f64, step_um: f64) -> SensorCode {
    let count = (position_um / step_um).round() as i64;
    SensorCode::new(count.rem_euclid(1 << ENCODER_BITS) as u32)
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
    /// A closed loop whose encoder has white noise, um RMS, around a slider at rest that the amplifier knows.
    /// Position 0 is where the slider begins.
    pub fn new(plant: P, block: &AmplifierParameters, (noise_um, seed): (f64, u64)) -> Self {
        let mut this = Self {
            plant,
            amplifier: Amplifier::new(*block),
            noise: WhiteNoise::new(noise_um, seed),
            acting: block.guard.rest_code,
        };
        // Behind the first reading, which fixes the zero, and here has no noise.
        let begin = encoder_code(this.plant.sensor_um(), this.step_um());
        let _ = this.amplifier.tick(Some(begin), false);
        for command in [
            Command::Arm { tested: false },
            Command::RequireConditioning(false),
            Command::Enable,
        ] {
            let _ = this.amplifier.command(command);
        }
        this
    }

    fn period_s(&self) -> f64 {
        1.0 / f64::from(self.amplifier.parameters().physical.sample_rate_hz)
    }

    fn step_um(&self) -> f64 {
        let c = &self.amplifier.parameters().servo.converters;
        c.adc_step as f64 / 2f64.powi(40)
    }

    fn counters(&self) -> SteppingCounters {
        self.amplifier
            .stepper()
            .map(Stepper::counters)
            .unwrap_or_default()
    }

    /// One period.
    pub fn advance(&mut self) {
        let c = self.amplifier.parameters().servo.converters;
        let reading_um = self.plant.sensor_um() + self.noise.next_um();
        let code = encoder_code(reading_um, self.step_um());
        let next = self.amplifier.tick(Some(code), false).dac_code;
        let drive_v = f64::from(c.drive(self.acting)) / 2f64.powi(22);
        self.plant.advance(drive_v, 0.0);
        self.acting = next;
    }

    /// Moves to a target, and watches what is behind the arrival for a time.
    ///
    /// # Errors
    /// The amplifier refuses the move.
    pub fn move_to(
        &mut self,
        target_um: f64,
        within_s: f64,
        watched_s: f64,
    ) -> Result<MoveFigures, Refusal> {
        let period_s = self.period_s();
        let ticks = |time_s: f64| (time_s / period_s).round() as usize;
        let (within, watched) = (ticks(within_s), ticks(watched_s));
        self.go(target_um, 0.0)?;
        let before = self.counters().teeth;
        let mut figures = MoveFigures::default();
        for k in 0..within {
            self.advance();
            if self.amplifier.stepper().is_some_and(Stepper::has_arrived) {
                figures.arrived_s = Some((k + 1) as f64 * period_s);
                break;
            }
            if self.amplifier.fault().is_some() {
                break;
            }
        }
        let (mut low, mut high, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
        for _ in 0..watched {
            self.advance();
            let error = self.plant.displacement_um() - target_um;
            (low, high, sum) = (low.min(error), high.max(error), sum + error);
        }
        figures.teeth = self.counters().teeth - before;
        figures.error_um = sum / watched.max(1) as f64;
        figures.error_max_um = low.abs().max(high.abs());
        figures.swing_um = high - low;
        figures.fault = self.amplifier.fault().map(Fault::name);
        figures.counters = self.counters();
        Ok(figures)
    }

    fn go(&mut self, target_um: f64, velocity_um_s: f64) -> Result<(), Refusal> {
        self.amplifier.command(Command::MoveTo {
            target: Travel::saturating_from_num(target_um),
            velocity: Micrometres::saturating_from_num(velocity_um_s * self.period_s()),
        })
    }

    /// Goes towards a target at a velocity, and gives the true position at every tick, um.
    ///
    /// # Errors
    /// The amplifier refuses it.
    pub fn follow(
        &mut self,
        target_um: f64,
        velocity_um_s: f64,
        for_s: f64,
    ) -> Result<Vec<f64>, Refusal> {
        self.go(target_um, velocity_um_s)?;
        let count = (for_s / self.period_s()).round() as usize;
        Ok((0..count)
            .map(|_| {
                self.advance();
                self.plant.displacement_um()
            })
            .collect())
    }
}
