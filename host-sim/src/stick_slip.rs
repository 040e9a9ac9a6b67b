//! Piezo-driven stick-slip actuator (thesis Ch. 3): a platform on a piezo, and an end-effector that rides on
//! it by friction.
//!
//! The platform is the classical Preisach hysteresis in the form of Eqs. (8)-(11) followed by a second-order
//! mode (Eq. 17); the end-effector is carried by elastoplastic friction (Eqs. 5-6) and otherwise free (Eq.
//! 13). Displacements are in um, forces in N; the hysteretic force divided by the stiffness of the piezo is
//! the displacement that it would make at rest.
//!
//! # Signs
//! Eq. (14) defines the relative motion as `x_2 - x_1`, and Eq. (13) lets the friction push the end-effector
//! along it: taken together friction would feed the motion. Here the motion that bends the bristle is that of
//! the platform relative to the end-effector, `x_1 - x_2`; the force of Eq. (13) then drags the end-effector
//! along and acts back on the platform as in Eq. (12).
//!
//! # Integrator
//! In the transition to sliding the bend settles over nanometres of travel while the motion itself takes
//! milliseconds: the equations are stiff in presliding, the more the nearer `z_b / z_s` is to one. Two
//! methods were measured against a step a hundred times finer (test
//! `error_against_a_hundred_times_finer_step`): the classical Runge-Kutta method of fourth order and a
//! two-stage L-stable Rosenbrock method of second order. With [`SUBSTEPS`] steps in 50 us the former is a
//! hundred times more accurate for the thesis' contact, and still stable for a contact five times stiffer in
//! the transition; it is the default.

use crate::block::Play;
use crate::closed_loop::Plant;
use crate::effect::play_operators::PlayOperators;
use crate::elastoplastic_friction::ElastoplasticFriction;
use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces};
use crate::rig_effects::{Element, GRAVITY_M_S2, RigEffects, SliderSensor};
use nalgebra::{SMatrix, SVector};

/// Integration steps in one sample of 50 us.
pub const SUBSTEPS: usize = 16;

/// Stiffness of the piezo with the platform, N/um (Ch. 3, IV.B).
pub const PLATFORM_STIFFNESS_N_UM: f64 = 45.0;

/// A stick-slip actuator.
#[derive(Clone, Debug, PartialEq)]
pub struct StickSlipActuator {
    /// Hysteresis surface `F(alpha, beta) / K` in um over the normalised drive, without remnant.
    pub hysteresis: Surfaces,
    /// Play operators beside it: loops with kinks, by the normalised input, in um.
    pub plays: Vec<Play>,
    /// Drive at which the normalised input is one, V.
    pub drive_range_v: f64,
    /// Stiffness of the piezo with the platform, N/um.
    pub platform_stiffness_n_um: f64,
    /// Natural frequency of the platform, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of the platform.
    pub damping_ratio: f64,
    /// Friction between platform and end-effector.
    pub friction: ElastoplasticFriction,
    /// Mass of the end-effector, kg.
    pub end_effector_mass_kg: f64,
    /// What it has beyond the model of chapter 3.
    pub effects: RigEffects,
}

/// How the equations are integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Integrator {
    /// Classical Runge-Kutta method of fourth order.
    #[default]
    RungeKutta,
    /// Two-stage L-stable Rosenbrock method of second order.
    Rosenbrock,
}

/// Motion of platform and end-effector at every sample, um.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct StickSlipMotion {
    /// Displacement of the movable platform, `x_1`.
    pub platform_um: Vec<f64>,
    /// Displacement of the end-effector, `x_2`.
    pub end_effector_um: Vec<f64>,
    /// What the sensor of the end-effector reads.
    pub reading_um: Vec<f64>,
}

type State = SVector<f64, 5>;
type Jacobian = SMatrix<f64, 5, 5>;

/// Contact stiffness over the mass of the end-effector, N/um (Ch. 3, Eqs. 19-21, printed in N/mm).
///
/// The splines were fitted from about 0.06 to 0.55 kg; outside they are continued with the value at the end.
#[must_use]
pub fn printed_contact_stiffness_n_um(mass_kg: f64) -> f64 {
    let m = mass_kg.clamp(0.0, 0.55);
    let n_mm = if m <= 0.157 {
        ((-5.07e5 * m + 1.25e5) * m + 287.0) * m + 90.8
    } else if m <= 0.253 {
        ((4.71e5 * m - 3.35e5) * m + 7.22e4) * m - 3.66e3
    } else {
        ((-2.29e4 * m + 4.06e4) * m - 2.29e4) * m + 4.36e3
    };
    n_mm / 1000.0
}

/// Coefficients of Ch. 3, Eq. (16) in N: `(power of alpha, power of beta, coefficient per
/// V^(sum of powers))`.
pub const PRINTED_SURFACE_N: [(usize, usize, f64); 10] = [
    (0, 0, 0.938),
    (0, 1, -3.89),
    (1, 0, 3.72),
    (0, 2, 0.0418),
    (1, 1, -0.0855),
    (2, 0, 0.0492),
    (0, 3, 0.000163),
    (1, 2, -0.000414),
    (2, 1, 0.000445),
    (3, 0, -0.000240),
];

/// Ch. 3, Eq. (16) as printed: the force that is lost on the way down from `alpha_v` to `beta_v`, N.
#[must_use]
pub fn printed_surface_n(alpha_v: f64, beta_v: f64) -> f64 {
    PRINTED_SURFACE_N
        .iter()
        .map(|(i, j, c)| c * alpha_v.powi(*i as i32) * beta_v.powi(*j as i32))
        .sum()
}

impl StickSlipActuator {
    /// The actuator of the thesis with the given end-effector: all of its printed constants.
    ///
    /// Eq. (16) does not vanish on `alpha = beta` (up to 1 N, 20 nm), which would make the
    /// force jump at every reversal; its surface is replaced by the nearest one of the form
    /// `(alpha - beta) Q_2(alpha, beta)` over 0..100 V.
    #[must_use]
    pub fn thesis(end_effector_mass_kg: f64) -> Self {
        let stiffness_n_um = if (end_effector_mass_kg - 0.0635).abs() < 1e-9 {
            0.482
        } else {
            printed_contact_stiffness_n_um(end_effector_mass_kg)
        };
        Self {
            hysteresis: nearest_surface_um(PLATFORM_STIFFNESS_N_UM),
            plays: Vec::new(),
            drive_range_v: 100.0,
            platform_stiffness_n_um: PLATFORM_STIFFNESS_N_UM,
            natural_frequency_rad_s: 1526.0,
            damping_ratio: 0.7696,
            friction: ElastoplasticFriction {
                stiffness_n_um,
                damping_n_s_um: 0.273e-3,
                coulomb_force_n: 0.0362 / 0.0635 * end_effector_mass_kg,
                breakaway_ratio: Some(0.801),
            },
            end_effector_mass_kg,
            effects: RigEffects::default(),
        }
    }

    /// Force-equivalent displacement of the hysteresis alone for a drive, um.
    #[must_use]
    pub fn force_equivalent_um(&self, drive_v: &[f64]) -> Vec<f64> {
        let mut loops = Loops::virgin(self);
        drive_v.iter().map(|u| loops.step(*u)).collect()
    }

    /// Force-equivalent displacement of the whole element, with its effects, um.
    #[must_use]
    pub fn element_um(&self, drive_v: &[f64], sample_rate_hz: f64) -> Vec<f64> {
        let mut element = Element::at_rest(self.effects, self.drive_range_v, 1.0 / sample_rate_hz);
        let loops_um = self.force_equivalent_um(drive_v);
        let pairs = drive_v.iter().zip(loops_um);
        pairs.map(|(u, um)| element.step(*u, um)).collect()
    }

    /// The rig whose own contact and mass are those that the effects make of them.
    fn with_changed_contact(&self) -> Self {
        let mut rig = self.clone();
        let effects = &mut rig.effects;
        let preload = 1.0 + std::mem::take(&mut effects.preload_share);
        let friction = 1.0 + std::mem::take(&mut effects.friction_share);
        let stiffness = 1.0 + std::mem::take(&mut effects.contact_stiffness_share);
        rig.end_effector_mass_kg *= 1.0 + std::mem::take(&mut effects.slider_mass_share);
        rig.friction.coulomb_force_n *= preload * friction;
        rig.friction.stiffness_n_um *= preload * stiffness;
        rig
    }

    /// Where the rig rests: the bristles carry what the slider weighs along the travel.
    fn at_rest(&self) -> State {
        let sliding_n = self.friction.coulomb_force_n;
        let carried_n = self.weight_along_n().clamp(-sliding_n, sliding_n);
        let bend_um = carried_n / self.friction.stiffness_n_um;
        let platform_um = -carried_n / self.platform_stiffness_n_um;
        State::new(platform_um, 0.0, 0.0, 0.0, bend_um)
    }

    /// Weight of the slider against the direction of travel, N.
    fn weight_along_n(&self) -> f64 {
        self.end_effector_mass_kg * GRAVITY_M_S2 * self.effects.tilt_rad.sin()
    }

    /// Motion for a drive that is held from each sample to the next; at rest before the first.
    #[must_use]
    pub fn simulate(&self, drive_v: &[f64], sample_rate_hz: f64) -> StickSlipMotion {
        self.simulate_with(
            &self.element_um(drive_v, sample_rate_hz),
            sample_rate_hz,
            Integrator::default(),
            SUBSTEPS,
        )
    }

    /// Motion under given force-equivalent displacements, with a chosen integrator and number of steps in a
    /// sample.
    #[must_use]
    pub fn simulate_with(
        &self,
        force_um: &[f64],
        sample_rate_hz: f64,
        integrator: Integrator,
        substeps: usize,
    ) -> StickSlipMotion {
        let dt_s = 1.0 / sample_rate_hz / substeps.max(1) as f64;
        let rig = self.with_changed_contact();
        let mut state = rig.at_rest();
        let mut sensor = SliderSensor::at_rest(self.effects, 1.0 / sample_rate_hz);
        let mut motion = StickSlipMotion::default();
        for force in force_um {
            motion.platform_um.push(state[0]);
            motion.end_effector_um.push(state[2]);
            motion.reading_um.push(sensor.step(state[2]));
            for _ in 0..substeps.max(1) {
                state = rig.step(&state, *force, dt_s, integrator);
            }
        }
        motion
    }

    fn step(&self, state: &State, force_um: f64, dt_s: f64, integrator: Integrator) -> State {
        match integrator {
            Integrator::Rosenbrock => self.rosenbrock_step(state, force_um, dt_s),
            Integrator::RungeKutta => self.runge_kutta_step(state, force_um, dt_s),
        }
    }

    /// Time derivative of (x_1, v_1, x_2, v_2, z).
    fn derivative(&self, state: &State, force_um: f64) -> State {
        let omega = self.natural_frequency_rad_s;
        let (x1, v1, x2, v2, z) = (state[0], state[1], state[2], state[3], state[4]);
        let (effects, mut friction) = (&self.effects, self.friction);
        if effects.has_varying_friction() {
            friction.coulomb_force_n *= effects.friction_factor(x2, v1 - v2);
        }
        let bend_rate = friction.bend_rate(z, v1 - v2);
        let friction_n =
            friction.force_n(z, bend_rate) + effects.contact_viscosity_n_s_um * (v1 - v2);
        let guide_n = effects.guide_stiffness_n_um * x2 + effects.guide_viscosity_n_s_um * v2;
        let slider_n = friction_n - guide_n - self.weight_along_n();
        // The platform's mass is K / omega^2, so its reaction is friction omega^2 / K.
        State::new(
            v1,
            omega * omega * (force_um - x1 - friction_n / self.platform_stiffness_n_um)
                - 2.0 * self.damping_ratio * omega * v1,
            v2,
            slider_n * 1e6 / self.end_effector_mass_kg,
            bend_rate,
        )
    }

    fn jacobian(&self, state: &State) -> Jacobian {
        let omega = self.natural_frequency_rad_s;
        let (velocity, z) = (state[1] - state[3], state[4]);
        let (elastic, elastic_slope) = self.friction.elastic_share(z, velocity);
        // d(bend rate) / d(v_1, v_2, z), and the friction that follows from it.
        let rate = [elastic, -elastic, velocity * elastic_slope];
        let friction = [
            self.friction.damping_n_s_um * rate[0],
            self.friction.damping_n_s_um * rate[1],
            self.friction.damping_n_s_um * rate[2] + self.friction.stiffness_n_um,
        ];
        let (platform, mass) = (
            omega * omega / self.platform_stiffness_n_um,
            1e6 / self.end_effector_mass_kg,
        );
        let mut j = Jacobian::zeros();
        j[(0, 1)] = 1.0;
        j[(1, 0)] = -omega * omega;
        j[(1, 1)] = -2.0 * self.damping_ratio * omega - platform * friction[0];
        j[(1, 3)] = -platform * friction[1];
        j[(1, 4)] = -platform * friction[2];
        j[(2, 3)] = 1.0;
        j[(3, 1)] = mass * friction[0];
        j[(3, 3)] = mass * friction[1];
        j[(3, 4)] = mass * friction[2];
        j[(4, 1)] = rate[0];
        j[(4, 3)] = rate[1];
        j[(4, 4)] = rate[2];
        j
    }

    fn rosenbrock_step(&self, state: &State, force_um: f64, dt_s: f64) -> State {
        // ROS2 (Verwer et al. 1999) with gamma = 1 - 1/sqrt(2): L-stable, second order for any Jacobian.
        let gamma = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
        let matrix = Jacobian::identity() - self.jacobian(state) * (gamma * dt_s);
        let lu = matrix.lu();
        let Some(k1) = lu.solve(&self.derivative(state, force_um)) else {
            return self.runge_kutta_step(state, force_um, dt_s);
        };
        let second = self.derivative(&(state + k1 * dt_s), force_um) - k1 * 2.0;
        let Some(k2) = lu.solve(&second) else {
            return self.runge_kutta_step(state, force_um, dt_s);
        };
        state + (k1 * 1.5 + k2 * 0.5) * dt_s
    }

    fn runge_kutta_step(&self, state: &State, force_um: f64, dt_s: f64) -> State {
        let k1 = self.derivative(state, force_um);
        let k2 = self.derivative(&(state + k1 * (0.5 * dt_s)), force_um);
        let k3 = self.derivative(&(state + k2 * (0.5 * dt_s)), force_um);
        let k4 = self.derivative(&(state + k3 * dt_s), force_um);
        state + (k1 + (k2 + k3) * 2.0 + k4) * (dt_s / 6.0)
    }
}

/// Surfaces and plays along a drive.
#[derive(Clone, Debug)]
struct Loops {
    hysteresis: OneSidedHysteresis,
    plays: PlayOperators,
    range_v: f64,
}

impl Loops {
    fn virgin(actuator: &StickSlipActuator) -> Self {
        let range_v = actuator.drive_range_v;
        let of_play = |play: &Play| (play.threshold, play.weight);
        let plays: Vec<(f64, f64)> = actuator.plays.iter().map(of_play).collect();
        Self {
            hysteresis: OneSidedHysteresis::virgin(actuator.hysteresis.clone(), 0.0, range_v),
            plays: PlayOperators::new(&plays),
            range_v,
        }
    }

    fn step(&mut self, drive_v: f64) -> f64 {
        self.hysteresis.step(drive_v) + self.plays.step(drive_v / self.range_v)
    }
}

/// A stick-slip actuator that moves on sample by sample, for a loop around it.
#[derive(Clone, Debug)]
pub struct StickSlipPlant {
    actuator: StickSlipActuator,
    loops: Loops,
    element: Element,
    sensor: SliderSensor,
    reading_um: f64,
    state: State,
    substep_s: f64,
}

impl StickSlipPlant {
    /// At rest and virgin at 0 V, sampled with this period.
    #[must_use]
    pub fn at_rest(actuator: StickSlipActuator, period_s: f64) -> Self {
        let effects = actuator.effects;
        let actuator = actuator.with_changed_contact();
        Self {
            loops: Loops::virgin(&actuator),
            element: Element::at_rest(effects, actuator.drive_range_v, period_s),
            sensor: SliderSensor::at_rest(effects, period_s),
            reading_um: 0.0,
            state: actuator.at_rest(),
            actuator,
            substep_s: period_s / SUBSTEPS as f64,
        }
    }
}

impl Plant for StickSlipPlant {
    fn advance(&mut self, drive_v: f64, external_um: f64) {
        let loops_um = self.loops.step(drive_v);
        let force_um = self.element.step(drive_v, loops_um) + external_um;
        for _ in 0..SUBSTEPS {
            self.state =
                (self.actuator).step(&self.state, force_um, self.substep_s, Integrator::default());
        }
        self.reading_um = self.sensor.step(self.state[2]);
    }

    fn displacement_um(&self) -> f64 {
        self.state[2]
    }

    fn sensor_um(&self) -> f64 {
        self.reading_um
    }
}

/// The surface of the form `(alpha - beta) Q_2` nearest to Eq. (16) on the triangle 0..100 V, divided by the
/// stiffness.
fn nearest_surface_um(stiffness_n_um: f64) -> Surfaces {
    use nalgebra::{DMatrix, DVector};
    const RANGE_V: f64 = 100.0;
    const TERMS: [(usize, usize); 6] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];
    let points: Vec<(f64, f64)> = (0..=20)
        .flat_map(|a| (0..=a).map(move |b| (f64::from(a) / 20.0, f64::from(b) / 20.0)))
        .collect();
    let matrix = DMatrix::from_fn(points.len(), TERMS.len(), |row, column| {
        let ((x, z), (i, j)) = (points[row], TERMS[column]);
        (x - z) * x.powi(i as i32) * z.powi(j as i32)
    });
    let right = DVector::from_iterator(
        points.len(),
        points
            .iter()
            .map(|(x, z)| printed_surface_n(RANGE_V * x, RANGE_V * z)),
    );
    let solution = matrix
        .svd(true, true)
        .solve(&right, 1e-12)
        .unwrap_or_else(|_| DVector::zeros(TERMS.len()));
    let mut g = vec![vec![0.0; 4]; 4];
    for ((i, j), value) in TERMS.iter().zip(solution.iter()) {
        g[i + 1][*j] += value / stiffness_n_um;
        g[*i][j + 1] -= value / stiffness_n_um;
    }
    Surfaces { g, r: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::waveform;

    const FS: f64 = 20_000.0;

    #[test]
    fn printed_numbers_of_chapter_3() {
        assert!((printed_surface_n(50.0, 0.0) - 279.94).abs() < 0.01);
        assert!((printed_surface_n(100.0, 0.0) - 624.94).abs() < 0.01);
        assert!((printed_contact_stiffness_n_um(0.0635) * 1000.0 - 483.2).abs() < 0.1);
        let actuator = StickSlipActuator::thesis(0.0635);
        let at_50_v = actuator.force_equivalent_um(&[50.0])[0];
        assert!((at_50_v - 6.22).abs() < 0.03, "{at_50_v}");
        assert!(actuator.hysteresis.loop_loss(0.4, 0.4).abs() < 1e-12);
    }

    fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        a.iter()
            .zip(b)
            .fold(0.0, |m: f64, (x, y)| m.max((x - y).abs()))
    }

    /// Errors of both methods, in um, for a contact with this `z_b / z_s`.
    fn errors_um(breakaway_ratio: f64, height_v: f64, frequency_hz: f64) -> [f64; 2] {
        let mut actuator = StickSlipActuator::thesis(0.0635);
        actuator.friction.breakaway_ratio = Some(breakaway_ratio);
        let force =
            actuator.force_equivalent_um(&waveform::saw_tooth(FS, frequency_hz, height_v, 1.0, 3));
        let fine = actuator.simulate_with(&force, FS, Integrator::RungeKutta, 100 * SUBSTEPS);
        [Integrator::RungeKutta, Integrator::Rosenbrock].map(|integrator| {
            largest_difference(
                &actuator
                    .simulate_with(&force, FS, integrator, SUBSTEPS)
                    .end_effector_um,
                &fine.end_effector_um,
            )
        })
    }

    #[test]
    fn error_against_a_hundred_times_finer_step() {
        let [runge_kutta, rosenbrock] = errors_um(0.801, 50.0, 60.0);
        println!(
            "thesis' contact: Runge-Kutta {runge_kutta:.1e} um, Rosenbrock {rosenbrock:.1e} um"
        );
        assert!(runge_kutta < 1e-6 && runge_kutta < rosenbrock);
        let [runge_kutta, rosenbrock] = errors_um(0.96, 70.0, 80.0);
        println!(
            "z_b / z_s = 0.96: Runge-Kutta {runge_kutta:.1e} um, Rosenbrock {rosenbrock:.1e} um"
        );
        assert!(runge_kutta < 1e-3);
    }

    #[test]
    fn the_plant_moves_as_the_simulation_does() {
        let drive_v = waveform::saw_tooth(FS, 60.0, 50.0, 1.0, 4);
        let mut actuator = StickSlipActuator::thesis(0.0635);
        let without_um = actuator.force_equivalent_um(&drive_v);
        actuator.plays = vec![Play {
            threshold: 0.1,
            weight: 2.0,
        }];
        // The play is behind a rise to half the range by its threshold.
        let first = (FS / 60.0) as usize - 1;
        let more_um = actuator.force_equivalent_um(&drive_v)[first] - without_um[first];
        assert!(
            (more_um - 2.0 * (drive_v[first] / 100.0 - 0.1)).abs() < 1e-9,
            "{more_um}"
        );
        let simulated = actuator.simulate(&drive_v, FS).end_effector_um;
        let mut plant = StickSlipPlant::at_rest(actuator, 1.0 / FS);
        for (u, y) in drive_v.iter().zip(&simulated) {
            assert!((plant.sensor_um() - y).abs() < 1e-9);
            plant.advance(*u, 0.0);
        }
    }

    #[test]
    fn the_end_effector_rides_along_slow_motion_and_slips_at_the_jump() {
        let actuator = StickSlipActuator::thesis(0.0635);
        let motion = actuator.simulate(&waveform::saw_tooth(FS, 60.0, 50.0, 1.0, 4), FS);
        let before_jump = (FS / 60.0) as usize - 1;
        assert!(
            (motion.end_effector_um[before_jump] - motion.platform_um[before_jump]).abs() < 1.0
        );
        let travel_um = motion.end_effector_um[motion.end_effector_um.len() - 1];
        assert!(travel_um > 4.0 / 60.0 * 50.0, "{travel_um}");
    }
}
