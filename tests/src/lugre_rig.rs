//! A stick-slip rig by other equations than the simulation's: what a stepping drive that was designed from the
//! model of chapter 3 really meets.
//!
//! Nothing here is shared with `host-sim` but the trait through which a loop is closed ([`Plant`]).
//!
//! * *Friction*: LuGre (Canudas de Wit et al. 1995), whose bristle slides a little at every force, with
//!   Stribeck's fall from the break-away force. The project's law is elastic up to break-away.
//! * *Hysteresis*: [`PLAYS`] play operators behind a curved drive instead of polynomial surfaces.
//! * *Alterations* ([`Alteration`]): wear is exponential, the sensor's target slips as Dahl's friction lets it, and
//!   creep has [`CREEPS`] parts.
//! * *Motion*: semi-implicit Euler in [`SUBSTEPS`] steps; the bristle moves exactly for a constant velocity.

use hysteron_sim::closed_loop::Plant;
use std::collections::VecDeque;

/// Play operators.
pub const PLAYS: usize = 24;
/// Steps in a period.
pub const SUBSTEPS: usize = 64;

/// How far a rig is from the nominal one, as ratios.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigFactors {
    /// Coefficient of friction.
    pub friction: f64,
    /// Mass of the slider.
    pub mass: f64,
    /// Preload: force and stiffness of the contact grow with it.
    pub preload: f64,
    /// Width of the loops.
    pub hysteresis: f64,
}

impl RigFactors {
    /// The nominal rig.
    pub const NOMINAL: Self = Self {
        friction: 1.0,
        mass: 1.0,
        preload: 1.0,
        hysteresis: 1.0,
    };

    /// Five rigs that differ by 30 % in everything. The second and the third have the least friction over
    /// their mass.
    pub const FIVE: [Self; 5] = [
        Self::with([1.3, 0.7, 1.3, 1.3]),
        Self::with([0.7, 1.3, 0.7, 1.3]),
        Self::with([0.7, 1.3, 0.7, 0.7]),
        Self::with([1.3, 1.3, 0.7, 0.7]),
        Self::with([0.7, 0.7, 1.3, 1.3]),
    ];

    const fn with([friction, mass, preload, hysteresis]: [f64; 4]) -> Self {
        Self {
            friction,
            mass,
            preload,
            hysteresis,
        }
    }
}

/// What happened to a rig since it was modelled; all zero is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alteration {
    /// Relative change of the contact's stiffness.
    pub contact_stiffness: f64,
    /// What the break-away force has more, as a share of the sliding force.
    pub breakaway: f64,
    /// The travel points upward, rad.
    pub tilt_rad: f64,
    /// Spring of the guide, N/um.
    pub guide_n_um: f64,
    /// Viscous force of the guide, N s/um.
    pub guide_n_s_um: f64,
    /// Viscous force of the contact beyond the nominal one, N s/um.
    pub contact_n_s_um: f64,
    /// Logarithm of the friction along the travel, 1/um.
    pub wear_per_um: f64,
    /// Relative change of the element's gain.
    pub gain: f64,
    /// Creep of the element in a decade of time.
    pub creep: f64,
    /// Relative change of the sensor's scale.
    pub scale: f64,
    /// Time constant of the sensor, s.
    pub lag_s: f64,
    /// How far the sensor's target lags behind the slider when it slips, um.
    pub slip_um: f64,
    /// Dead time of the drive, s.
    pub delay_s: f64,
}

/// Parts of the creep, from 1 ms on, four in a decade.
pub const CREEPS: usize = 14;

/// The rig with its state.
#[derive(Clone, Debug)]
pub struct LugreRig {
    factors: RigFactors,
    altered: Alteration,
    creeps_um: [f64; CREEPS],
    late_um: VecDeque<f64>,
    target_um: f64,
    reading_um: f64,
    step_s: f64,
    plays_v: [f64; PLAYS],
    platform: [f64; 2],
    slider: [f64; 2],
    bristle_um: f64,
}

/// Drive that the plays are made for, V.
const RANGE_V: f64 = 100.0;
/// Platform displacement over the range, um.
const STROKE_UM: f64 = 13.5;
/// Share of it that goes through plays.
const PLAY_SHARE: f64 = 0.3;
/// Widest play, V.
const WIDEST_V: f64 = 40.0;
/// How much more the drive moves at its upper end.
const CURVATURE: f64 = 0.15;
/// Platform: natural frequency, rad/s, damping ratio and stiffness, N/um.
const PLATFORM: [f64; 3] = [1500.0, 0.75, 45.0];
/// Slider, kg.
const MASS_KG: f64 = 0.0635;
/// Contact: stiffness, N/um, damping, N s/um, viscous part, N s/um.
const CONTACT: [f64; 3] = [0.5, 2.5e-4, 1e-6];
/// Gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.81;
/// Sliding and break-away force, N, and Stribeck's velocity, um/s.
const FORCES: [f64; 3] = [0.036, 0.043, 400.0];

impl LugreRig {
    /// At rest at 0 V, sampled with this period.
    #[must_use]
    pub fn at_rest(factors: RigFactors, period_s: f64) -> Self {
        Self::altered_at_rest(factors, Alteration::default(), period_s)
    }

    /// The same for a rig that was altered.
    #[must_use]
    pub fn altered_at_rest(factors: RigFactors, altered: Alteration, period_s: f64) -> Self {
        let step_s = period_s / SUBSTEPS as f64;
        let weight_n = MASS_KG * factors.mass * GRAVITY_M_S2 * altered.tilt_rad.sin();
        let sigma_0 = CONTACT[0] * factors.preload * (1.0 + altered.contact_stiffness);
        Self {
            factors,
            altered,
            creeps_um: [0.0; CREEPS],
            late_um: VecDeque::from(vec![0.0; (altered.delay_s / step_s).round() as usize]),
            target_um: 0.0,
            reading_um: 0.0,
            step_s,
            plays_v: [0.0; PLAYS],
            platform: [0.0; 2],
            slider: [0.0; 2],
            bristle_um: weight_n / sigma_0,
        }
    }

    /// Where the platform is, um.
    #[must_use]
    pub fn platform_um(&self) -> f64 {
        self.platform[0]
    }

    /// Displacement that the drive would make at rest, with creep, um.
    fn element_um(&mut self, drive_v: f64) -> f64 {
        let loops_um = self.force_equivalent_um(drive_v);
        for (nth, creep) in self.creeps_um.iter_mut().enumerate() {
            let tau_s = 1e-3 * 10f64.powf(nth as f64 / 4.0);
            *creep += (loops_um - *creep) * (SUBSTEPS as f64 * self.step_s / tau_s).min(1.0);
        }
        let crept_um: f64 = self.creeps_um.iter().sum();
        loops_um * (1.0 + self.altered.gain) + 0.25 * self.altered.creep * crept_um
    }

    /// The sensor, one step on.
    fn read(&mut self, moved_um: f64) {
        if self.altered.slip_um > 0.0 {
            // The target lags behind by at most so much.
            let lags = (self.slider[0] - moved_um - self.target_um) / self.altered.slip_um;
            let slips = (lags * moved_um.signum()).clamp(0.0, 1.0);
            self.target_um += moved_um * slips;
        } else {
            self.target_um = self.slider[0];
        }
        let gone = if self.altered.lag_s > 0.0 {
            1.0 - (-self.step_s / self.altered.lag_s).exp()
        } else {
            1.0
        };
        self.reading_um += gone * (self.target_um - self.reading_um);
    }

    /// Displacement that the drive would make at rest, um.
    fn force_equivalent_um(&mut self, drive_v: f64) -> f64 {
        let share = drive_v / RANGE_V;
        let curved_v = drive_v * (1.0 + CURVATURE * (share - 1.0));
        let in_plays = PLAY_SHARE * self.factors.hysteresis;
        let mut through = 0.0;
        for (nth, play) in self.plays_v.iter_mut().enumerate() {
            let half_v = WIDEST_V * (nth as f64 + 0.5) / PLAYS as f64;
            *play = play.max(curved_v - half_v).min(curved_v + half_v);
            // Each play scaled so that it spans the range too.
            through += *play / (RANGE_V - half_v) / PLAYS as f64;
        }
        STROKE_UM * ((1.0 - in_plays) * curved_v / RANGE_V + in_plays * through)
    }
}

impl Plant for LugreRig {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        let force_now_um = self.element_um(drive_v) + external_um;
        let altered = self.altered;
        let [omega, damping_ratio, stiffness_n_um] = PLATFORM;
        let [sigma_0, sigma_1, sigma_2] = CONTACT;
        let sigma_0 = sigma_0 * self.factors.preload * (1.0 + altered.contact_stiffness);
        let sigma_2 = sigma_2 + altered.contact_n_s_um;
        let [sliding_n, breakaway_n, stribeck_um_s] = FORCES;
        let of_force = self.factors.friction * self.factors.preload;
        let mass_kg = MASS_KG * self.factors.mass;
        let breakaway_n = breakaway_n + altered.breakaway * sliding_n;
        let weight_along_n = mass_kg * GRAVITY_M_S2 * altered.tilt_rad.sin();
        let dt = self.step_s;
        for _ in 0..SUBSTEPS {
            self.late_um.push_back(force_now_um);
            let force_um = self.late_um.pop_front().unwrap_or(force_now_um);
            let velocity = self.platform[1] - self.slider[1];
            let weight = (-(velocity / stribeck_um_s).powi(2)).exp();
            let worn = (altered.wear_per_um * self.slider[0]).exp();
            let level_n = worn * of_force * (sliding_n + (breakaway_n - sliding_n) * weight);
            let steady_um = (level_n / sigma_0).copysign(velocity);
            let gone = (-velocity.abs() * dt * sigma_0 / level_n).exp();
            let bent_um = steady_um + (self.bristle_um - steady_um) * gone;
            let friction_n = sigma_0 * 0.5 * (bent_um + self.bristle_um)
                + sigma_1 * (bent_um - self.bristle_um) / dt
                + sigma_2 * velocity;
            self.bristle_um = bent_um;
            let [x, v] = self.platform;
            let pull = omega * omega * (force_um - x - friction_n / stiffness_n_um)
                - 2.0 * damping_ratio * omega * v;
            self.platform[1] += dt * pull;
            self.platform[0] += dt * self.platform[1];
            let guide_n =
                altered.guide_n_um * self.slider[0] + altered.guide_n_s_um * self.slider[1];
            self.slider[1] += dt * (friction_n - guide_n - weight_along_n) * 1e6 / mass_kg;
            let moved_um = dt * self.slider[1];
            self.slider[0] += moved_um;
            self.read(moved_um);
        }
    }

    fn displacement_um(&self) -> f64 {
        self.slider[0]
    }

    fn sensor_um(&self) -> f64 {
        self.reading_um * (1.0 + self.altered.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 5e-5;

    #[test]
    fn a_slow_drive_carries_the_slider_and_a_jump_leaves_it_behind() {
        let mut rig = LugreRig::at_rest(RigFactors::NOMINAL, PERIOD_S);
        (1..=4000).for_each(|k| rig.advance(80.0 * f64::from(k) / 4000.0, 0.0));
        let (up_um, platform_um) = (rig.displacement_um(), rig.platform[0]);
        assert!((up_um - platform_um).abs() < 0.1, "{up_um} {platform_um}");
        (0..400).for_each(|_| rig.advance(0.0, 0.0));
        // The platform falls within 3 ms, in which 0.043 N bring 0.0635 kg by 3 um.
        let back_um = up_um - rig.displacement_um();
        assert!((2.0..4.0).contains(&back_um), "{back_um} of {up_um}");
    }

    #[test]
    fn half_the_step_gives_the_same_motion() {
        let play = |halvings: u32| {
            let mut rig = LugreRig::at_rest(RigFactors::NOMINAL, PERIOD_S / f64::from(halvings));
            for k in 0..2000 {
                let drive_v = 80.0 * f64::from(k % 136) / 136.0;
                (0..halvings).for_each(|_| rig.advance(drive_v, 0.0));
            }
            rig.displacement_um()
        };
        let [coarse, fine] = [1, 2].map(play);
        assert!((coarse - fine).abs() < 0.002 * fine, "{coarse} {fine}");
    }
}
