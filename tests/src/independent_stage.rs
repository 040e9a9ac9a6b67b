//! A nanopositioning stage by other equations than the simulation's: what a servo that was designed from a
//! recording really meets.
//!
//! Nothing here is shared with `host-sim` but the trait through which a loop is closed ([`Plant`]).
//!
//! * *Hysteresis*: [`PLAYS`] play operators (Krasnosel'skii and Pokrovskii 1989) with exponentially falling
//!   weights on a curved drive, and a part that only the highest drive so far decides (the first rise). The
//!   thesis' polynomial surfaces can come near it, never reproduce it.
//! * *Modes*: oscillators side by side, integrated by the classical Runge-Kutta rule in [`SUBSTEPS`] steps of
//!   2.5 us (at 9.5 kHz an error of the damping ratio below 1e-5), with the drive held over a period.
//! * *Creep*: four first-order terms behind them, integrated exactly for a motion that runs straight through
//!   a sub-step.
//! * *Ideal here*: amplifier and sensor have no lag, so what the sensor reads is the true position plus white
//!   noise and the steps of its converter. Converters have 16 bits ([`ConverterScale::around`]). A code acts
//!   one period after the reading that it came from.
//!
//! A [`StageTruth`] is drawn from a seed. Every third stage has a lightly damped first mode, and every
//! stage has a second mode between 1.2 times the first one and 9.5 kHz.

use hysteron_sim::closed_loop::Plant;
use hysteron_sim::converter_scale::ConverterScale;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Sampling period of the loop, s.
pub const PERIOD_S: f64 = 5e-5;
/// Steps of the oscillators in a period.
pub const SUBSTEPS: usize = 20;
/// Play operators of the hysteresis.
pub const PLAYS: usize = 200;

/// A mode of the structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueMode {
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Share of the static displacement.
    pub share: f64,
}

/// What a stage is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct StageTruth {
    /// Seed it was drawn from.
    pub seed: u64,
    /// Highest drive, V; the lowest is 0.
    pub drive_max_v: f64,
    /// Displacement over the whole range, about, um.
    pub travel_um: f64,
    /// Share of it that goes through play operators.
    pub hysteresis_share: f64,
    /// Curvature of the drive in front of them.
    pub curvature: f64,
    /// Share of the travel that stays after the first rise.
    pub first_rise_share: f64,
    /// First mode (its share is what the others leave).
    pub first_mode: TrueMode,
    /// Another mode.
    pub second_mode: Option<TrueMode>,
    /// Shares and time constants of creep, 1 and s.
    pub creep: [(f64, f64); 4],
    /// Standard deviation of the sensor's white noise, um.
    pub noise_um: f64,
}

impl StageTruth {
    /// The stage of a seed.
    #[must_use]
    pub fn drawn(seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x15);
        let mut between = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
        let light = seed.is_multiple_of(3);
        let first_hz = between(500.0, 1100.0);
        let damping = if light {
            between(0.01, 0.02)
        } else {
            between(0.2, 0.7)
        };
        // Over the logarithm of frequency.
        let second_hz = (1.2 * first_hz) * (9500.0 / (1.2 * first_hz)).powf(between(0.0, 1.0));
        let second = TrueMode {
            frequency_hz: second_hz,
            damping_ratio: between(0.015, 0.03),
            share: between(0.01, 0.04),
        };
        Self {
            seed,
            drive_max_v: 80.0,
            travel_um: between(8.0, 13.0),
            hysteresis_share: between(0.1, 0.2),
            curvature: between(0.0, 0.15),
            first_rise_share: between(0.0, 0.02),
            first_mode: TrueMode {
                frequency_hz: first_hz,
                damping_ratio: damping,
                share: 1.0 - second.share,
            },
            second_mode: Some(second),
            creep: [0.02, 0.15, 1.1, 8.0]
                .map(|tau_s| (between(0.008, 0.016), tau_s * between(0.8, 1.25))),
            noise_um: between(0.001, 0.003),
        }
    }

    /// The converters of a board that fits it.
    #[must_use]
    pub fn converters(&self) -> ConverterScale {
        ConverterScale::around(0.0, self.drive_max_v, 1.1 * self.travel_um)
    }
}

#[derive(Clone, Debug)]
struct Play {
    width_v: f64,
    weight: f64,
    output_v: f64,
}

#[derive(Clone, Debug)]
struct Oscillator {
    omega_rad_s: f64,
    damping_ratio: f64,
    share: f64,
    position_um: f64,
    velocity_um_s: f64,
}

impl Oscillator {
    /// One step of the classical Runge-Kutta rule under a constant force-equivalent displacement.
    fn step(&mut self, force_um: f64, dt_s: f64) {
        let (w, xi) = (self.omega_rad_s, self.damping_ratio);
        let acceleration = |x: f64, v: f64| w * w * (force_um - x) - 2.0 * xi * w * v;
        let (x, v) = (self.position_um, self.velocity_um_s);
        let (k1x, k1v) = (v, acceleration(x, v));
        let (k2x, k2v) = (
            v + 0.5 * dt_s * k1v,
            acceleration(x + 0.5 * dt_s * k1x, v + 0.5 * dt_s * k1v),
        );
        let (k3x, k3v) = (
            v + 0.5 * dt_s * k2v,
            acceleration(x + 0.5 * dt_s * k2x, v + 0.5 * dt_s * k2v),
        );
        let (k4x, k4v) = (v + dt_s * k3v, acceleration(x + dt_s * k3x, v + dt_s * k3v));
        self.position_um = x + dt_s / 6.0 * (k1x + 2.0 * k2x + 2.0 * k3x + k4x);
        self.velocity_um_s = v + dt_s / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v);
    }
}

/// Changes of a stage after it was recorded: what a loop has to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageChange {
    /// Moving mass over the recorded one.
    pub mass_ratio: f64,
    /// Force over the recorded one.
    pub gain_ratio: f64,
    /// Additional delay of the drive, s; at most a few periods.
    pub delay_s: f64,
    /// A mode that was not there.
    pub mode: Option<TrueMode>,
}

impl StageChange {
    /// As it was recorded.
    pub const NONE: Self = Self {
        mass_ratio: 1.0,
        gain_ratio: 1.0,
        delay_s: 0.0,
        mode: None,
    };
}

/// The stage with its state.
#[derive(Clone, Debug)]
pub struct IndependentStage {
    truth: StageTruth,
    change: StageChange,
    plays: Vec<Play>,
    highest_v: f64,
    oscillators: Vec<Oscillator>,
    creep_um: [f64; 4],
    displacement_um: f64,
    /// Forces of earlier periods, newest first: what a delay still has to come.
    forces_um: [f64; 8],
}

impl IndependentStage {
    /// At rest, never driven.
    #[must_use]
    pub fn virgin(truth: &StageTruth, change: StageChange) -> Self {
        let total: f64 = (0..PLAYS)
            .map(|i| (-3.0 * i as f64 / PLAYS as f64).exp())
            .sum();
        let plays = (0..PLAYS).map(|i| {
            let at = (i as f64 + 0.5) / PLAYS as f64;
            Play {
                width_v: truth.drive_max_v * at,
                weight: truth.hysteresis_share * (-3.0 * i as f64 / PLAYS as f64).exp() / total,
                output_v: 0.0,
            }
        });
        // The spring stays as it is: more mass makes every mode slower, and its damper damps it less.
        let slower = change.mass_ratio.powf(-0.5);
        let oscillator = |mode: &TrueMode, share: f64| Oscillator {
            omega_rad_s: std::f64::consts::TAU * mode.frequency_hz * slower,
            damping_ratio: mode.damping_ratio * slower,
            share,
            position_um: 0.0,
            velocity_um_s: 0.0,
        };
        let others =
            truth.second_mode.map_or(0.0, |m| m.share) + change.mode.map_or(0.0, |m| m.share);
        let mut oscillators = vec![oscillator(&truth.first_mode, 1.0 - others)];
        oscillators.extend(truth.second_mode.iter().map(|m| oscillator(m, m.share)));
        oscillators.extend(change.mode.iter().map(|m| Oscillator {
            omega_rad_s: std::f64::consts::TAU * m.frequency_hz,
            damping_ratio: m.damping_ratio,
            share: m.share,
            position_um: 0.0,
            velocity_um_s: 0.0,
        }));
        Self {
            plays: plays.collect(),
            highest_v: 0.0,
            oscillators,
            creep_um: [0.0; 4],
            displacement_um: 0.0,
            forces_um: [0.0; 8],
            truth: truth.clone(),
            change,
        }
    }

    /// Goes over to another change while it runs. A mode cannot come or go.
    pub fn change_to(&mut self, change: StageChange) {
        let slower = change.mass_ratio.powf(-0.5);
        let recorded = std::iter::once(&self.truth.first_mode).chain(&self.truth.second_mode);
        for (oscillator, mode) in self.oscillators.iter_mut().zip(recorded) {
            oscillator.omega_rad_s = std::f64::consts::TAU * mode.frequency_hz * slower;
            oscillator.damping_ratio = mode.damping_ratio * slower;
        }
        self.change = StageChange {
            mode: self.change.mode,
            ..change
        };
    }

    /// Force-equivalent displacement of a drive, um.
    fn hysteresis_um(&mut self, drive_v: f64) -> f64 {
        let t = &self.truth;
        let top_v = t.drive_max_v;
        let drive_v = drive_v.clamp(0.0, top_v);
        // Curved so that the whole range stays the whole range.
        let curved_v = drive_v * (1.0 + t.curvature * (drive_v / top_v - 1.0));
        let mut sum_v = (1.0 - t.hysteresis_share) * curved_v;
        for play in &mut self.plays {
            play.output_v = play.output_v.max(curved_v - play.width_v).min(curved_v);
            sum_v += play.weight * play.output_v;
        }
        self.highest_v = self.highest_v.max(drive_v);
        let first_rise_um = t.first_rise_share * t.travel_um * (self.highest_v / top_v).powi(2);
        t.travel_um * sum_v / top_v + first_rise_um
    }

    /// Drives it without a loop and samples it every `every` periods: the reading at the beginning of each
    /// held drive, um, noise and converter included.
    pub fn record(
        &mut self,
        drive_v: &[f64],
        every: usize,
        noise: &mut hysteron_sim::noise::WhiteNoise,
    ) -> Vec<f64> {
        let scale = self.truth.converters();
        let mut readings = Vec::with_capacity(drive_v.len());
        for wanted_v in drive_v {
            readings
                .push(scale.position_um(scale.adc_code(self.displacement_um + noise.next_um())));
            for _ in 0..every {
                self.advance(scale.drive_v(scale.dac_code(*wanted_v)), 0.0);
            }
        }
        readings
    }
}

impl Plant for IndependentStage {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        let force_um = self.change.gain_ratio * self.hysteresis_um(drive_v) + external_um;
        self.forces_um.rotate_right(1);
        self.forces_um[0] = force_um;
        let dt_s = PERIOD_S / SUBSTEPS as f64;
        for substep in 0..SUBSTEPS {
            // What was commanded a delay ago.
            let ago = self.change.delay_s / PERIOD_S - (substep as f64 + 0.5) / SUBSTEPS as f64;
            let periods = ago.ceil().max(0.0) as usize;
            let force_um = self.forces_um[periods.min(self.forces_um.len() - 1)];
            let before: f64 = self
                .oscillators
                .iter()
                .map(|o| o.share * o.position_um)
                .sum();
            for oscillator in &mut self.oscillators {
                oscillator.step(force_um, dt_s);
            }
            let after: f64 = self
                .oscillators
                .iter()
                .map(|o| o.share * o.position_um)
                .sum();
            let mut displacement_um = after;
            for (state, (share, tau_s)) in self.creep_um.iter_mut().zip(&self.truth.creep) {
                let decay = (-dt_s / tau_s).exp();
                *state = decay * *state + (1.0 - decay) * 0.5 * (before + after);
                displacement_um += share * *state;
            }
            self.displacement_um = displacement_um;
        }
    }

    fn displacement_um(&self) -> f64 {
        self.displacement_um
    }

    fn sensor_um(&self) -> f64 {
        self.displacement_um
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn damped(frequency_hz: f64, damping_ratio: f64) -> StageTruth {
        let first_mode = TrueMode {
            frequency_hz,
            damping_ratio,
            share: 1.0,
        };
        StageTruth {
            first_mode,
            second_mode: None,
            creep: [(0.0, 1.0); 4],
            first_rise_share: 0.0,
            ..StageTruth::drawn(1)
        }
    }

    #[test]
    fn a_mode_rings_down_as_the_closed_form_says() {
        let (hz, xi) = (6000.0, 0.02);
        let mut stage = IndependentStage::virgin(&damped(hz, xi), StageChange::NONE);
        let (w, drive_v) = (std::f64::consts::TAU * hz, 40.0);
        let rest_um = stage.hysteresis_um(drive_v);
        let root = (1.0 - xi * xi).sqrt();
        for k in 1..60 {
            stage.advance(drive_v, 0.0);
            let t = f64::from(k) * PERIOD_S;
            let free =
                (-xi * w * t).exp() * ((w * root * t).cos() + xi / root * (w * root * t).sin());
            assert!(
                (stage.displacement_um() - rest_um * (1.0 - free)).abs() < 2e-3 * rest_um,
                "{k}"
            );
        }
    }

    #[test]
    fn a_delay_of_a_period_is_a_period() {
        let run = |delay_s: f64| {
            let mut stage = IndependentStage::virgin(
                &damped(900.0, 0.3),
                StageChange {
                    delay_s,
                    ..StageChange::NONE
                },
            );
            let step = |k: i32| if k < 5 { 0.0 } else { 40.0 };
            (0..40)
                .map(|k| (stage.advance(step(k), 0.0), stage.displacement_um()).1)
                .collect::<Vec<f64>>()
        };
        let (at_once, late) = (run(0.0), run(PERIOD_S));
        for k in 1..40 {
            assert!((late[k] - at_once[k - 1]).abs() < 1e-12, "{k}");
        }
    }

    #[test]
    fn the_hysteresis_closes_its_loops_and_keeps_what_it_should() {
        let mut stage = IndependentStage::virgin(&damped(900.0, 0.3), StageChange::NONE);
        let first = stage.hysteresis_um(50.0);
        stage.hysteresis_um(80.0);
        let falling = stage.hysteresis_um(50.0);
        assert!(falling > first + 0.1, "{first} {falling}");
        // A nested loop comes back to where it began (return-point memory).
        stage.hysteresis_um(35.0);
        stage.hysteresis_um(50.0);
        stage.hysteresis_um(35.0);
        let closed = stage.hysteresis_um(50.0);
        stage.hysteresis_um(35.0);
        assert!((stage.hysteresis_um(50.0) - closed).abs() < 1e-12);
    }
}
