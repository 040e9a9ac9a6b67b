//! A stage with one mode behind an amplifier with a limit of its current, for tests that close loops.

use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::parameter_block::{AmplifierParameters, read};

/// The block of the emulated tests, with the guard of the manual.
pub fn parameters() -> AmplifierParameters {
    let bytes = include_bytes!("../../../board/emulator/tests/p753.block");
    let mut out = read(bytes, RATE_HZ).expect("a valid block");
    out.guard.tracking_error = (LIMIT_UM * 2f64.powi(24)) as i32;
    out.guard.tracking_ticks = 100;
    out
}

pub const RATE_HZ: u32 = 20_000;
/// The largest tracking error of the manual's envelope, um.
pub const LIMIT_UM: f64 = 2.5;
const CAPACITANCE_F: f64 = 1.5e-6;

/// Numbers that look random, the same in every run.
pub struct Dice(pub u64);

impl Dice {
    pub fn share(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.share()
    }

    /// As likely in every octave.
    pub fn decades(&mut self, low: f64, high: f64) -> f64 {
        (self.within(low.ln(), high.ln())).exp()
    }
}

/// An amplifier that gives so much current, and a stage with one mode.
pub struct Bench {
    pub parameters: AmplifierParameters,
    pub current_a: f64,
    pub gain_um_v: f64,
    pub natural_rad_s: f64,
    pub damping: f64,
    pub drive_v: f64,
    pub position_um: f64,
    pub velocity_um_s: f64,
    pub noise: Dice,
    /// What acts since the last edge.
    acting: DriveCode,
}

impl Bench {
    /// The stage of the block, at rest.
    pub fn new(current_a: f64, seed: u64) -> Self {
        Self {
            parameters: parameters(),
            current_a,
            gain_um_v: 0.125,
            natural_rad_s: std::f64::consts::TAU * 852.0,
            damping: 0.79,
            drive_v: 0.0,
            position_um: 0.0,
            velocity_um_s: 0.0,
            noise: Dice(seed),
            acting: parameters().guard.rest_code,
        }
    }

    /// One period in which a code is written, in steps that are short against every mode; it acts from the
    /// next one on.
    pub fn advance(&mut self, written: DriveCode) {
        const STEPS: u32 = 16;
        let c = &self.parameters.servo.converters;
        let acting = std::mem::replace(&mut self.acting, written);
        let wanted_v = f64::from(c.drive(acting)) / 2f64.powi(22);
        let step_s = 1.0 / f64::from(RATE_HZ * STEPS);
        let most_v = self.current_a / CAPACITANCE_F * step_s;
        for _ in 0..STEPS {
            self.drive_v += (wanted_v - self.drive_v).clamp(-most_v, most_v);
            let force = self.gain_um_v * self.drive_v - self.position_um;
            let acceleration = self.natural_rad_s.powi(2) * force
                - 2.0 * self.damping * self.natural_rad_s * self.velocity_um_s;
            self.velocity_um_s += acceleration * step_s;
            self.position_um += self.velocity_um_s * step_s;
        }
    }

    pub fn reading(&mut self) -> SensorCode {
        let c = &self.parameters.servo.converters;
        let step_um = c.adc_step as f64 / 2f64.powi(40);
        let zero_um = f64::from(c.adc_zero) / 2f64.powi(24);
        let noise = self.noise.within(-1.0, 1.0);
        let code = (self.position_um - zero_um) / step_um + noise;
        SensorCode::new(code.clamp(0.0, 65_535.0) as u32)
    }
}
