//! A published controller of stick-slip drives, beside ours: stepping by voltage and frequency in proportion to
//! the error, then a linear law in scanning mode.
//!
//! # Sources
//! * Stepping: M. Rakotondrabe, Y. Haddab and P. Lutz, "Voltage/frequency proportional control of stick-slip
//!   micropositioning systems", IEEE Trans. Control Systems Technology 16(6), 1316-1322 (2008): saw-teeth of
//!   amplitude `sat(k_U |e|)` and frequency `sat(k_f |e|)`, in the direction of the error.
//! * Scanning and the change between both: R. Oubellil, A. Voda, M. Boudaoud and S. Regnier, "Mixed
//!   stepping/scanning mode control of stick-slip SEM-integrated nano-robotic systems", Sensors and Actuators
//!   A 285, 258-268 (2019): within the reach of the piezo a linear law takes over at the drive that acts.
//!   Their law is from H-infinity synthesis. Here it is an integral with the largest gain that keeps the
//!   sensitivity on the contacts that our design is judged on.

use crate::stick_slip_study::{Equations, WATCHED_S, WITHIN_S, rig};
use hysteron::servo::stepping_design::{RATES_S, SteppingDesign, Tooth, contacts};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::stepping_loop::MoveFigures;
use hysteron_sim::stick_slip::StickSlipActuator;
use hysteron_tests::lugre_rig::RigFactors;
use nalgebra::{Complex, DMatrix};

/// Largest drive, V.
const RANGE_V: f64 = 100.0;
/// Largest sensitivity of the scanning law, as of ours.
const SENSITIVITY_MAX: f64 = 2.5;
/// Shares of the stroke within which scanning takes over that are tried.
const SCANNING_SHARES: [f64; 3] = [0.1, 0.2, 0.35];
/// Errors at which the voltage and the frequency are full that are tried, in steps of a full tooth.
const FULL_STEPS: [f64; 4] = [1.0, 3.0, 10.0, 30.0];
/// An arrival: so near for so long, as in our design.
const ARRIVAL_S: f64 = 0.02;

/// The controller with its gains.
#[derive(Clone, Copy, Debug)]
pub struct PublishedStepping {
    /// Ends of the largest teeth, V; smaller ones lie around their middle.
    pub ends_v: [f64; 2],
    /// Amplitude by the error, V/um.
    pub volt_per_um: f64,
    /// Frequency by the error, Hz/um.
    pub hz_per_um: f64,
    /// Highest frequency, Hz.
    pub hz_max: f64,
    /// Error within which scanning takes over, um.
    pub scanning_um: f64,
    /// Gain of the scanning law, V/(um s).
    pub integral: f64,
    slew_v_s: f64,
    period_s: f64,
    encoder_um: f64,
    noise_um: f64,
    tolerance_um: f64,
}

/// Where its drive is going.
#[derive(Clone, Copy)]
enum Mode {
    /// Flanks that are still to go: the next level and the time to it.
    Stepping([(f64, f64); 2]),
    Scanning,
}

/// Largest gain of an integral that keeps the sensitivity on every contact of a rig.
fn scanning_gain(model: &StickSlipActuator, design: &SteppingDesign) -> f64 {
    let stroke_um = model.force_equivalent_um(&[RANGE_V])[0];
    let gain_um_v = 1.3 * stroke_um / RANGE_V;
    let responses: Vec<Complex<f64>> = contacts(model, &design.order)
        .iter()
        .flat_map(|plant| {
            (1..400).map(|n| {
                let z = Complex::from_polar(1.0, std::f64::consts::PI * f64::from(n) / 400.0);
                let back = DMatrix::identity(4, 4) * z - plant.a.map(Complex::from);
                let x = back.lu().solve(&plant.b.map(Complex::from));
                let y = x.map_or(Complex::from(0.0), |x| plant.c.map(Complex::from).dot(&x));
                // The integral, and the period of delay.
                y * gain_um_v * plant.period_s / (z - 1.0)
            })
        })
        .collect();
    let holds = |gain: &f64| {
        let peak = |open: &Complex<f64>| 1.0 / (1.0 + open * *gain).norm();
        responses.iter().map(peak).fold(0.0, f64::max) <= SENSITIVITY_MAX
    };
    let gains = (0..200).map(|n| 10.0 * 1.05_f64.powi(n));
    gains.take_while(holds).last().unwrap_or(10.0)
}

impl PublishedStepping {
    /// With the gains that bring the nominal rig of chapter 3 to 100 um soonest, and teeth between these ends.
    #[must_use]
    pub fn tuned(model: &StickSlipActuator, design: &SteppingDesign) -> Self {
        let ends_v = design.tooth.ends_v;
        let height_v = ends_v[1] - ends_v[0];
        let period_s = design.order.front_end.period_s();
        let slew_v_s = design.order.front_end.slew_v_s;
        let step = |slow_s: f64| {
            let tooth = Tooth {
                ends_v,
                slow_s,
                fast_s: height_v / slew_v_s,
                curvature: 0.0,
                step_um: 0.0,
            };
            let tooth = tooth.on(model, period_s);
            (
                tooth.velocity_um_s(),
                1.0 / (slow_s + tooth.fast_s),
                tooth.step_um,
            )
        };
        let (_, hz_max, step_um) = RATES_S
            .map(step)
            .into_iter()
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or_default();
        let stroke_um = model.force_equivalent_um(&[RANGE_V])[0];
        let integral = scanning_gain(model, design);
        let mut tried = Vec::new();
        for share in SCANNING_SHARES {
            for full_v in FULL_STEPS {
                tried.extend(FULL_STEPS.map(|full_hz| Self {
                    ends_v,
                    volt_per_um: height_v / (full_v * step_um),
                    hz_per_um: hz_max / (full_hz * step_um),
                    hz_max,
                    scanning_um: share * stroke_um,
                    integral,
                    slew_v_s,
                    period_s,
                    encoder_um: 0.001,
                    noise_um: design.order.noise_um,
                    tolerance_um: design.order.tolerance_um,
                }));
            }
        }
        let time = |law: &Self| {
            let moved = law.closed_move(Equations::Chapter3, RigFactors::NOMINAL, 100.0, 2.0);
            moved.arrived_s.unwrap_or(f64::INFINITY)
        };
        let first = tried[0];
        let timed = tried.into_iter().map(|law| (time(&law), law));
        timed
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(first, |(_, law)| law)
    }

    /// The flanks of a tooth towards an error, from the drive that acts.
    fn tooth(&self, error_um: f64, drive_v: f64) -> [(f64, f64); 2] {
        let [low_v, high_v] = self.ends_v;
        let half_v = 0.5 * (self.volt_per_um * error_um.abs()).min(high_v - low_v);
        let middle_v = 0.5 * (low_v + high_v);
        let hz = (self.hz_per_um * error_um.abs()).clamp(1.0, self.hz_max);
        let side = half_v.copysign(error_um);
        let (turn_v, end_v) = (middle_v + side, middle_v - side);
        let fast_s = 2.0 * half_v / self.slew_v_s;
        let slow_s = (1.0 / hz - fast_s).max((turn_v - drive_v).abs() / self.slew_v_s);
        [(turn_v, slow_s), (end_v, fast_s)]
    }

    /// A move from rest at zero, watched as ours is.
    #[must_use]
    pub fn closed_move(
        &self,
        equations: Equations,
        factors: RigFactors,
        target_um: f64,
        within_s: f64,
    ) -> MoveFigures {
        let mut plant = rig(equations, factors, self.period_s);
        let mut noise = WhiteNoise::new(self.noise_um, 11);
        let (mut mode, mut drive_v) = (Mode::Scanning, 0.0_f64);
        let (mut near, needed) = (0, (ARRIVAL_S / self.period_s) as usize);
        let mut figures = MoveFigures::default();
        let mut watched = Vec::new();
        let ticks = (within_s.min(WITHIN_S) / self.period_s) as usize;
        for k in 0.. {
            if figures.arrived_s.is_none() && k > ticks
                || watched.len() as f64 * self.period_s >= WATCHED_S
            {
                break;
            }
            let read_um = plant.sensor_um() + noise.next_um();
            let error_um = target_um - (read_um / self.encoder_um).round() * self.encoder_um;
            near = if error_um.abs() <= self.tolerance_um {
                near + 1
            } else {
                0
            };
            if near >= needed && figures.arrived_s.is_none() {
                figures.arrived_s = Some((k + 1) as f64 * self.period_s);
            }
            plant.advance(drive_v, 0.0);
            drive_v = self.next_drive(&mut mode, &mut figures.teeth, drive_v, error_um);
            if figures.arrived_s.is_some() {
                watched.push(plant.displacement_um() - target_um);
            }
        }
        let (low, high) = hysteron::statistics::extremes(&watched);
        figures.error_max_um = low.abs().max(high.abs());
        figures.swing_um = high - low;
        figures
    }

    fn next_drive(&self, mode: &mut Mode, teeth: &mut u32, drive_v: f64, error_um: f64) -> f64 {
        match mode {
            Mode::Stepping([(level_v, left_s), after]) => {
                let steps = (*left_s / self.period_s).round().max(1.0);
                let next_v = drive_v + (*level_v - drive_v) / steps;
                *left_s -= self.period_s;
                if steps <= 1.0 {
                    if after.1 > 0.0 {
                        (*level_v, *left_s) = *after;
                        after.1 = 0.0;
                    } else if error_um.abs() <= self.scanning_um {
                        *mode = Mode::Scanning;
                    } else {
                        *teeth += 1;
                        *mode = Mode::Stepping(self.tooth(error_um, next_v));
                    }
                }
                next_v
            }
            Mode::Scanning => {
                let wanted_v = drive_v + self.integral * self.period_s * error_um;
                let next_v = wanted_v.clamp(0.0, RANGE_V);
                if error_um.abs() > self.scanning_um || next_v != wanted_v {
                    // Out of reach: at the smallest a tooth that brings the drive back to the middle.
                    *teeth += 1;
                    let least_um = 0.5 * RANGE_V / self.volt_per_um;
                    let for_um = error_um.abs().max(least_um).copysign(error_um);
                    *mode = Mode::Stepping(self.tooth(for_um, next_v));
                }
                next_v
            }
        }
    }
}
