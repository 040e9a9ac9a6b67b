//! Actuators that are no piezo, by equations of their own: what the finder must not take for one.
//!
//! Nothing here is shared with `host-sim`. Each is integrated by the classical Runge-Kutta rule in steps of
//! [`STEP_S`], with the drive held between samples, and read by a sensor with white noise. All are drawn from
//! a seed.
//!
//! * *Voice coil* ([`ActuatorKind::VoiceCoil`]): a coil with resistance, inductance and back
//!   electromotive force, on flexures, in a field that is weaker off its middle: `L i' = u - R
//!   i - K(x) v`, `m v' = K(x) i - d v - k x`, `K(x) = K0 (1 - (x / w)^2)`.
//! * *Motor stage* ([`ActuatorKind::MotorStage`]): a current-controlled motor on a screw with Stribeck
//!   friction whose bristles give before they slip (LuGre, Canudas de Wit et al. 1995), inside its own
//!   position loop (PI on velocity, P on position); its drive is the commanded position. An encoder counts.
//! * *Reluctance actuator* ([`ActuatorKind::Reluctance`]): a biased magnet pulls a leaf spring across a gap,
//!   `F = c (I0 + i)^2 / (g - x)^2`, driven by a current amplifier of first order, with eddy currents
//!   as a second lag of the field.

use hysteron::dataset::{Dataset, Record, Role};
use hysteron::outcome::{Diagnosis, Finding};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;

/// Step of the integration, s: a tenth of a sample.
pub const STEP_S: f64 = 2e-5;
/// Sampling rate of the records, Hz.
pub const SAMPLE_RATE_HZ: f64 = 5000.0;
/// Highest drive, V; the lowest is its negative.
pub const DRIVE_MAX_V: f64 = 10.0;

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActuatorKind {
    /// A coil in a magnet's gap, on flexures.
    VoiceCoil,
    /// A motor with a screw, inside its position loop.
    MotorStage,
    /// A magnet that pulls iron.
    Reluctance,
}

/// All kinds.
pub const KINDS: [ActuatorKind; 3] = [
    ActuatorKind::VoiceCoil,
    ActuatorKind::MotorStage,
    ActuatorKind::Reluctance,
];

impl ActuatorKind {
    /// Its name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::VoiceCoil => "voice coil",
            Self::MotorStage => "motor stage",
            Self::Reluctance => "reluctance actuator",
        }
    }
}

/// Effects of the library that only a piezoelectric ceramic has: no diagnosis of these actuators may name one
/// of them.
pub const OF_CERAMICS: [&str; 6] = [
    "creep",
    "initial_curve",
    "charge_leakage",
    "rate_dependence",
    "bipolar",
    "hysteresis",
];

/// Effects of ceramics that a kind truly imitates: friction before the slip is a hysteresis of displacement,
/// and the play operators describe it.
#[must_use]
pub fn imitated(kind: ActuatorKind) -> &'static [&'static str] {
    if kind == ActuatorKind::MotorStage {
        &["hysteresis"]
    } else {
        &[]
    }
}

/// The findings by which a diagnosis of a kind claims an effect of ceramics: all that they leave open are
/// such. An "or" with a structure of loops, or a lag, that other actuators have too claims none.
#[must_use]
pub fn claims_of_ceramics(kind: ActuatorKind, diagnosis: &Diagnosis) -> Vec<&Finding> {
    let is_of_ceramics =
        |id: &String| OF_CERAMICS.contains(&id.as_str()) && !imitated(kind).contains(&id.as_str());
    let claims = |f: &&Finding| !f.effects.is_empty() && f.effects.iter().all(is_of_ceramics);
    diagnosis.findings.iter().filter(claims).collect()
}

type State = [f64; 4];

/// Rates of the state under a drive.
type Derivative = Box<dyn Fn(&State, f64) -> State>;
/// What the sensor sees of the state, um.
type Reading = Box<dyn Fn(&State) -> f64>;

/// The equations of one actuator and its reading.
struct Actuator {
    derivative: Derivative,
    reading_um: Reading,
    state: State,
    noise_um: f64,
    count_um: f64,
}

fn voice_coil(between: &mut dyn FnMut(f64, f64) -> f64) -> Actuator {
    let (resistance, inductance, constant) = (
        between(5.0, 10.0),
        between(0.5e-3, 2e-3),
        between(6.0, 12.0),
    );
    let (mass_kg, damping) = (between(0.1, 0.3), between(2.0, 8.0));
    let stiffness = mass_kg * (TAU * between(40.0, 90.0)).powi(2);
    let width_m = between(4.0, 8.0) * DRIVE_MAX_V * constant / resistance / stiffness;
    Actuator {
        derivative: Box::new(move |s, u| {
            let [current, x, v, _] = *s;
            let k = constant * (1.0 - (x / width_m).powi(2));
            [
                (u - resistance * current - k * v) / inductance,
                v,
                (k * current - damping * v - stiffness * x) / mass_kg,
                0.0,
            ]
        }),
        reading_um: Box::new(|s| 1e6 * s[1]),
        state: [0.0; 4],
        noise_um: 0.05,
        count_um: 0.0,
    }
}

fn motor_stage(between: &mut dyn FnMut(f64, f64) -> f64) -> Actuator {
    let (mass_kg, viscous) = (between(1.0, 3.0), between(20.0, 60.0));
    let (coulomb_n, bristle_n_m) = (between(1.0, 3.0), between(3e6, 8e6));
    let (stiction_n, stribeck_m_s) = (coulomb_n * between(1.1, 1.4), 5e-4);
    let bristle_damping = 0.5 * (bristle_n_m * mass_kg).sqrt() * 0.2;
    // Metres per volt of the command; gains of the two loops.
    let scale_m_v = 20e-6;
    let (position_gain, velocity_rad_s) = (between(60.0, 120.0), TAU * between(60.0, 100.0));
    let (velocity_gain, integral_rad_s) = (velocity_rad_s * mass_kg, between(40.0, 80.0));
    Actuator {
        derivative: Box::new(move |s, u| {
            let [x, v, bristle_m, integral] = *s;
            let error = position_gain * (scale_m_v * u - x) - v;
            let force = velocity_gain * (error + integral);
            let level = (coulomb_n
                + (stiction_n - coulomb_n) * (-(v / stribeck_m_s).powi(2)).exp())
                / bristle_n_m;
            let bristle_rate = v - v.abs() / level * bristle_m;
            let friction = bristle_n_m * bristle_m + bristle_damping * bristle_rate + viscous * v;
            [
                v,
                (force - friction) / mass_kg,
                bristle_rate,
                integral_rad_s * error,
            ]
        }),
        reading_um: Box::new(|s| 1e6 * s[0]),
        state: [0.0; 4],
        noise_um: 0.005,
        count_um: 0.02,
    }
}

fn reluctance(between: &mut dyn FnMut(f64, f64) -> f64) -> Actuator {
    let (gap_m, bias_a) = (between(300e-6, 500e-6), between(1.5, 2.5));
    let amplifier_rad_s = TAU * between(300.0, 800.0);
    let eddy_rad_s = TAU * between(150.0, 400.0);
    let mass_kg = between(0.02, 0.06);
    let stiffness = mass_kg * (TAU * between(150.0, 300.0)).powi(2);
    // The bias bends the spring by a twentieth of the gap.
    let rest_m = 0.05 * gap_m;
    let constant = stiffness * rest_m * (gap_m - rest_m).powi(2) / bias_a.powi(2);
    let (damping, amperes_v) = (
        2.0 * between(0.05, 0.15) * (stiffness * mass_kg).sqrt(),
        0.04 * bias_a,
    );
    Actuator {
        derivative: Box::new(move |s, u| {
            let [current, field, x, v] = *s;
            let force = constant * (bias_a + field).powi(2) / (gap_m - x).powi(2);
            let acceleration = (force - damping * v - stiffness * x) / mass_kg;
            [
                amplifier_rad_s * (amperes_v * u - current),
                eddy_rad_s * (current - field),
                v,
                acceleration,
            ]
        }),
        reading_um: Box::new(move |s| 1e6 * (s[2] - rest_m)),
        state: [0.0, 0.0, rest_m, 0.0],
        noise_um: 0.003,
        count_um: 0.0,
    }
}

impl Actuator {
    fn step(&mut self, drive_v: f64) {
        let moved =
            |s: &State, k: &State, h: f64| -> State { std::array::from_fn(|i| s[i] + h * k[i]) };
        let (f, s) = (&self.derivative, self.state);
        let k1 = f(&s, drive_v);
        let k2 = f(&moved(&s, &k1, 0.5 * STEP_S), drive_v);
        let k3 = f(&moved(&s, &k2, 0.5 * STEP_S), drive_v);
        let k4 = f(&moved(&s, &k3, STEP_S), drive_v);
        self.state = std::array::from_fn(|i| {
            s[i] + STEP_S / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
        });
    }

    /// Readings at the beginning of each held drive.
    fn record(&mut self, drive_v: &[f64], random: &mut Pcg64Mcg) -> Vec<f64> {
        let steps = (1.0 / SAMPLE_RATE_HZ / STEP_S).round() as usize;
        let mut out = Vec::with_capacity(drive_v.len());
        for u in drive_v {
            // The sum of twelve uniform numbers is normal enough to be a sensor's noise.
            let noise: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let reading = (self.reading_um)(&self.state) + self.noise_um * noise;
            out.push(if self.count_um > 0.0 {
                (reading / self.count_um).round() * self.count_um
            } else {
                reading
            });
            (0..steps).for_each(|_| self.step(*u));
        }
        out
    }
}

/// Drives that people record with: triangles with turns inside, sines of growing speed, steps that are held,
/// rest.
fn drives(seed: u64) -> Vec<(&'static str, Role, Vec<f64>)> {
    let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0xd21e);
    let samples = |seconds: f64| (seconds * SAMPLE_RATE_HZ) as usize;
    let mut turns = |count: usize, slope_v_s: f64| {
        let mut out = vec![0.0_f64];
        let mut up = true;
        for i in 0..=count {
            let to = if i == count {
                0.0
            } else {
                (if up { 1.0 } else { -1.0 }) * DRIVE_MAX_V * (0.25 + 0.7 * random.random::<f64>())
            };
            let from = out[out.len() - 1];
            let n = samples((to - from).abs() / slope_v_s).max(1);
            out.extend((1..=n).map(|k| from + (to - from) * k as f64 / n as f64));
            up = !up;
        }
        out
    };
    let sines = |hertz: &[f64]| -> Vec<f64> {
        let burst = |hz: f64| {
            let n = samples((4.0 / hz).ceil().max(4.0 / hz));
            let n = n.min(samples(0.8));
            (0..n).map(move |k| {
                let window = (std::f64::consts::PI * k as f64 / n as f64).sin().powi(2);
                0.8 * DRIVE_MAX_V * window * (TAU * hz * k as f64 / SAMPLE_RATE_HZ).sin()
            })
        };
        hertz.iter().flat_map(|hz| burst(*hz)).collect()
    };
    let held = |levels: &[f64]| -> Vec<f64> {
        levels
            .iter()
            .flat_map(|l| vec![l * DRIVE_MAX_V; samples(1.0)])
            .collect()
    };
    vec![
        ("turns", Role::Identify, turns(14, 40.0)),
        (
            "sines",
            Role::Identify,
            sines(&[5.0, 13.0, 40.0, 90.0, 170.0]),
        ),
        ("held", Role::Identify, held(&[0.5, -0.3, 0.8, 0.0])),
        ("other_turns", Role::Validate, turns(10, 60.0)),
        (
            "other_sines",
            Role::Validate,
            sines(&[8.0, 25.0, 60.0, 120.0]),
        ),
        ("rest", Role::Noise, vec![0.0; samples(0.6)]),
    ]
}

/// Recordings of an actuator of this kind.
///
/// # Panics
/// Where they make no data set.
#[must_use]
pub fn recorded(kind: ActuatorKind, seed: u64) -> Dataset {
    let mut random = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let records = drives(seed).into_iter().map(|(name, role, drive_v)| {
        // The same actuator in every record, from rest.
        let mut values = Pcg64Mcg::seed_from_u64(seed);
        let mut between = |low: f64, high: f64| low + (high - low) * values.random::<f64>();
        let mut actuator = match kind {
            ActuatorKind::VoiceCoil => voice_coil(&mut between),
            ActuatorKind::MotorStage => motor_stage(&mut between),
            ActuatorKind::Reluctance => reluctance(&mut between),
        };
        let readings = actuator.record(&drive_v, &mut random);
        Record::new(name, SAMPLE_RATE_HZ, drive_v, readings).with_role(role)
    });
    let records: Vec<Record> = records.collect();
    Dataset::new(kind.name(), -DRIVE_MAX_V, DRIVE_MAX_V, records)
        .expect("the recordings make a data set")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voice_coil_rests_where_force_and_spring_balance() {
        let mut values = Pcg64Mcg::seed_from_u64(3);
        let mut between = |low: f64, high: f64| low + (high - low) * values.random::<f64>();
        let mut coil = voice_coil(&mut between);
        (0..100_000).for_each(|_| coil.step(1.0));
        let [current, x, v, _] = coil.state;
        assert!(v.abs() < 1e-9 && x > 0.0);
        assert!(
            (coil.derivative)(&[current, x, 0.0, 0.0], 1.0)
                .iter()
                .all(|d| d.abs() < 1e-6)
        );
    }

    #[test]
    fn a_motor_stage_goes_where_it_is_told() {
        let mut values = Pcg64Mcg::seed_from_u64(3);
        let mut between = |low: f64, high: f64| low + (high - low) * values.random::<f64>();
        let mut stage = motor_stage(&mut between);
        (0..100_000).for_each(|_| stage.step(5.0));
        assert!(
            ((stage.reading_um)(&stage.state) - 100.0).abs() < 0.5,
            "{:?}",
            stage.state
        );
    }
}
