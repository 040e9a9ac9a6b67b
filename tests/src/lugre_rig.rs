//! A stick-slip rig by other equations than the simulation's: what a stepping drive that was designed from the
//! model of chapter 3 really meets.
//!
//! Nothing here is shared with `host-sim` but the trait through which a loop is closed ([`Plant`]).
//!
//! * *Friction*: LuGre (Canudas de Wit et al. 1995), whose bristle slides a little at every force, with
//!   Stribeck's fall from the break-away force. The project's law is elastic up to break-away.
//! * *Hysteresis*: [`PLAYS`] play operators behind a curved drive instead of polynomial surfaces.
//! * *Motion*: semi-implicit Euler in [`SUBSTEPS`] steps; the bristle moves exactly for a constant velocity.

use hysteron_sim::closed_loop::Plant;

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

/// The rig with its state.
#[derive(Clone, Debug)]
pub struct LugreRig {
    factors: RigFactors,
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
/// Sliding and break-away force, N, and Stribeck's velocity, um/s.
const FORCES: [f64; 3] = [0.036, 0.043, 400.0];

impl LugreRig {
    /// At rest at 0 V, sampled with this period.
    #[must_use]
    pub fn at_rest(factors: RigFactors, period_s: f64) -> Self {
        Self {
            factors,
            step_s: period_s / SUBSTEPS as f64,
            plays_v: [0.0; PLAYS],
            platform: [0.0; 2],
            slider: [0.0; 2],
            bristle_um: 0.0,
        }
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
        let force_um = self.force_equivalent_um(drive_v) + external_um;
        let [omega, damping_ratio, stiffness_n_um] = PLATFORM;
        let [sigma_0, sigma_1, sigma_2] = CONTACT;
        let sigma_0 = sigma_0 * self.factors.preload;
        let [sliding_n, breakaway_n, stribeck_um_s] = FORCES;
        let of_force = self.factors.friction * self.factors.preload;
        let mass_kg = MASS_KG * self.factors.mass;
        let dt = self.step_s;
        for _ in 0..SUBSTEPS {
            let velocity = self.platform[1] - self.slider[1];
            let weight = (-(velocity / stribeck_um_s).powi(2)).exp();
            let level_n = of_force * (sliding_n + (breakaway_n - sliding_n) * weight);
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
            self.slider[1] += dt * friction_n * 1e6 / mass_kg;
            self.slider[0] += dt * self.slider[1];
        }
    }

    fn displacement_um(&self) -> f64 {
        self.slider[0]
    }

    fn sensor_um(&self) -> f64 {
        self.slider[0]
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
