//! The amplifier (guard, modes, servo) in front of [`IndependentStage`]: what the target's interrupt runs, on
//! a stage that the simulation does not share.

use crate::independent_stage::{IndependentStage, StageChange, StageTruth};
use hysteron::servo::amplifier_block::FrontEnd;
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::Command;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::reference_generator::Waveform;
use hysteron_core::signal::Micrometres;
use hysteron_core::trace_frame::TraceSample;
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::converter_scale::ConverterScale;
use hysteron_sim::noise::WhiteNoise;

/// Wiring that fits every stage that is drawn.
#[must_use]
pub fn front_end() -> FrontEnd {
    FrontEnd {
        name: "independent".into(),
        sensor_max_um: 17.0,
        ..FrontEnd::default()
    }
}

/// A sine about an offset, from its middle on.
#[must_use]
pub fn sine(hz: f64, amplitude_um: f64, offset_um: f64) -> Command {
    let tone = (
        (hz / 20_000.0 * 2f64.powi(32)) as u32,
        Micrometres::from_num(amplitude_um),
        0,
    );
    let none = (0, Micrometres::from_bits(0), 0);
    Command::Reference {
        waveform: Waveform::Multisine {
            tones: [tone, none, none, none],
        },
        offset: Micrometres::from_num(offset_um),
    }
}

/// The two, with what is between them.
#[derive(Clone, Debug)]
pub struct RunningAmplifier {
    stage: IndependentStage,
    scale: ConverterScale,
    noise: WhiteNoise,
    /// What acts, and what acts next.
    codes: [DriveCode; 2],
    /// The amplifier.
    pub amplifier: Amplifier,
    /// True position at the last reading, um.
    pub position_um: f64,
}

impl RunningAmplifier {
    /// In front of a virgin stage, conditioned and at rest.
    ///
    /// # Panics
    /// If it does not come there.
    #[must_use]
    pub fn conditioned(truth: &StageTruth, parameters: &AmplifierParameters) -> Self {
        let rest = parameters.guard.rest_code;
        let mut this = Self {
            stage: IndependentStage::virgin(truth, StageChange::NONE),
            scale: front_end().scale(0.0, truth.drive_max_v),
            noise: WhiteNoise::new(truth.noise_um, truth.seed ^ 0x7e1e),
            codes: [rest; 2],
            amplifier: Amplifier::new(*parameters),
            position_um: 0.0,
        };
        this.run(10);
        this.tell(Command::Arm { tested: true });
        this.run(10_000);
        assert!(this.amplifier.armed(), "{:?}", this.amplifier.fault());
        this.tell(Command::Condition {
            cycle_ticks: 2000,
            rest_ticks: 20_000,
        });
        this.run(22_100);
        assert!(this.amplifier.conditioned(), "{:?}", this.amplifier.fault());
        this
    }

    /// Gives a command.
    ///
    /// # Panics
    /// If it is refused.
    pub fn tell(&mut self, command: Command) {
        assert_eq!(self.amplifier.command(command), Ok(()));
    }

    /// The sensor is sampled, the amplifier answers, and the stage goes on under what was written a period
    /// ago.
    pub fn tick(&mut self) -> TraceSample {
        self.position_um = self.stage.sensor_um();
        let reading = self.scale.adc_code(self.position_um + self.noise.next_um());
        let sample = self.amplifier.tick(Some(reading), false);
        self.codes = [self.codes[1], sample.dac_code];
        self.stage.advance(self.scale.drive_v(self.codes[0]), 0.0);
        sample
    }

    /// So many ticks.
    pub fn run(&mut self, ticks: usize) -> Vec<TraceSample> {
        (0..ticks).map(|_| self.tick()).collect()
    }

    /// What a reading stands for since the sensor was zeroed, um.
    #[must_use]
    pub fn reading_um(&self, adc_code: SensorCode) -> f64 {
        let c = self.amplifier.servo().parameters().converters;
        f64::from(c.adc_zero) / f64::from(1 << 24)
            + f64::from(adc_code) * c.adc_step as f64 / 2f64.powi(40)
    }

    /// What a code of the drive stands for, V.
    #[must_use]
    pub fn drive_v(&self, dac_code: DriveCode) -> f64 {
        self.scale.drive_v(dac_code)
    }
}
