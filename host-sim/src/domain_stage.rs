//! The stage of the second bench: an actuator by other equations than those of the model chain.
//!
//! # How it works
//! * *Hysteresis*: thousands of domains, each a switch with two thresholds, `bias + coercive` up and `bias -
//!   coercive` down. The two are spread by a low-discrepancy sequence over their distributions. A domain
//!   whose lower threshold is below the lowest drive stays up once it has switched: that is the first rise.
//!   The displacement is what is switched beside a reversible part. No surface, no polynomial.
//! * *Structure*: base on its support, stack of elements, end-effector on its flexure, and a load on it
//!   through a contact. The stack pushes both of its ends. All modes come from the eigenvalues of that chain;
//!   a damper at the end-effector and a loss in the material damp them.
//! * *Creep*: strains that go towards a share of what the domains have switched, so their equilibrium has
//!   hysteresis; their rate is that of thermal activation, `z' = s / tau sinh((E - z) / s)`, which is not
//!   linear.
//! * *Sensor*: 1/f noise and lines of the mains beside the white noise.
//!
//! [`crate::bench`] plays it through the same converters as the reference bench.

use crate::linear_system::{ContinuousSystem, FixedSystem};
use crate::noise::FlickerNoise;
use nalgebra::{DMatrix, DVector};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::Deserialize;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Modes that are carried: those of the reference structure below 16 kHz.
const MODES: usize = 6;

/// Domains with their structure, creep and sensor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainTruth {
    /// How many.
    pub count: usize,
    /// Displacement when all have switched, um.
    pub switched_um: f64,
    /// Median of the coercive voltage, V.
    pub coercive_median_v: f64,
    /// Spread of its logarithm.
    pub coercive_log_spread: f64,
    /// Mean of the bias, V.
    pub bias_mean_v: f64,
    /// Spread of the bias, V.
    pub bias_spread_v: f64,
    /// Displacement that needs no switching, um/V.
    pub reversible_um_v: f64,
    /// Its curvature, um/V^2.
    pub reversible_um_v2: f64,
    /// What moves.
    pub structure: StructureTruth,
    /// What follows slowly.
    pub creep: DomainCreepTruth,
    /// What the sensor adds.
    pub sensor: SensorTruth,
}

/// Masses and springs.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StructureTruth {
    /// Mass of the base, kg.
    pub base_mass_kg: f64,
    /// Stiffness of its support, N/m.
    pub base_stiffness_n_m: f64,
    /// Mass of the stack, kg.
    pub stack_mass_kg: f64,
    /// Stiffness of the stack, N/m.
    pub stack_stiffness_n_m: f64,
    /// Elements of the stack.
    pub stack_elements: usize,
    /// Mass of the end-effector, kg.
    pub end_mass_kg: f64,
    /// Stiffness of its flexure, N/m.
    pub flexure_stiffness_n_m: f64,
    /// Damper at the end-effector, N s/m.
    pub end_damper_n_s_m: f64,
    /// Damping ratio of every mode by losses in the material.
    pub loss_damping_ratio: f64,
    /// Stiffness through which a load stands on the end-effector, N/m.
    pub load_contact_n_m: f64,
}

/// Creep strains.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainCreepTruth {
    /// What each comes to in the end, as a share of what the domains have switched.
    pub shares: Vec<f64>,
    /// Time constant of each near its equilibrium, s.
    pub time_constants_s: Vec<f64>,
    /// Distance from equilibrium at which the rate departs from linear, um.
    pub activation_um: f64,
}

/// Noise beside the white one.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorTruth {
    /// Density of the 1/f noise at 1 Hz, um per root of a hertz.
    pub flicker_um_per_root_hz: f64,
    /// Frequencies of lines, Hz.
    pub line_hz: Vec<f64>,
    /// Their amplitudes, um.
    pub line_um: Vec<f64>,
}

/// A mode: natural frequency, damping ratio and share of the static displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StructureMode {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Share of the static displacement of the end-effector.
    pub share: f64,
}

impl StructureTruth {
    /// The modes in which the stack moves the end-effector, with a load on it, kg; the slowest first.
    #[must_use]
    pub fn modes(&self, load_kg: f64) -> Vec<StructureMode> {
        let elements = self.stack_elements.max(1);
        let end = elements;
        let loaded = load_kg > 0.0;
        let n = elements + 1 + usize::from(loaded);
        let mut mass = DVector::from_element(n, self.stack_mass_kg / elements as f64);
        mass[0] = self.base_mass_kg + 0.5 * self.stack_mass_kg / elements as f64;
        mass[end] = self.end_mass_kg + 0.5 * self.stack_mass_kg / elements as f64;
        let mut stiffness = DMatrix::<f64>::zeros(n, n);
        stiffness[(0, 0)] += self.base_stiffness_n_m;
        stiffness[(end, end)] += self.flexure_stiffness_n_m;
        let mut spring = |a: usize, b: usize, k: f64| {
            stiffness[(a, a)] += k;
            stiffness[(b, b)] += k;
            stiffness[(a, b)] -= k;
            stiffness[(b, a)] -= k;
        };
        (0..elements).for_each(|i| spring(i, i + 1, self.stack_stiffness_n_m * elements as f64));
        if loaded {
            mass[end + 1] = load_kg;
            spring(end, end + 1, self.load_contact_n_m);
        }
        // Mass-normalised: M^-1/2 K M^-1/2 is symmetric.
        let root = mass.map(f64::sqrt);
        let normalised: DMatrix<f64> =
            DMatrix::from_fn(n, n, |i, j| stiffness[(i, j)] / (root[i] * root[j]));
        let eigen = normalised.symmetric_eigen();
        let shape = |at: usize, mode: usize| eigen.eigenvectors[(at, mode)] / root[at];
        let moved: Vec<f64> = (0..n)
            .map(|m| shape(end, m) * (shape(end, m) - shape(0, m)) / eigen.eigenvalues[m])
            .collect();
        let all: f64 = moved.iter().sum();
        let mode = |m: usize| {
            let w: f64 = eigen.eigenvalues[m].sqrt();
            StructureMode {
                natural_frequency_rad_s: w,
                damping_ratio: self.loss_damping_ratio
                    + self.end_damper_n_s_m * shape(end, m).powi(2) / (2.0 * w),
                share: moved[m] / all,
            }
        };
        let mut modes: Vec<StructureMode> = (0..n).map(mode).collect();
        modes.sort_by(|a, b| {
            a.natural_frequency_rad_s
                .total_cmp(&b.natural_frequency_rad_s)
        });
        modes
    }
}

/// Where domains switch, by threshold: never changed, shared by all plants.
#[derive(Debug)]
struct Thresholds {
    /// Upper thresholds, V, rising, each with its domain.
    up_v: Vec<(f64, u32)>,
    /// Lower thresholds, V, rising, each with its domain.
    down_v: Vec<(f64, u32)>,
}

/// Domains with their state.
#[derive(Clone, Debug)]
pub struct Domains {
    thresholds: Arc<Thresholds>,
    is_up: Vec<bool>,
    /// Domains that are up.
    up: u32,
    /// Upper thresholds at or below the drive, and lower thresholds below it.
    passed: [usize; 2],
    drive_v: f64,
    um_per_domain: f64,
    reversible: [f64; 2],
    zero_v: f64,
}

impl Domains {
    /// Never driven, at the lowest drive: domains whose upper threshold is not above it are no part of the
    /// hysteresis, nor those beyond the highest.
    #[must_use]
    pub fn virgin(truth: &DomainTruth, drive_min_v: f64, drive_max_v: f64) -> Self {
        // The plastic number's powers spread points over a square more evenly than chance (Roberts' R2
        // sequence).
        const STEP: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
        let logit = |p: f64| (p / (1.0 - p)).ln();
        let domain = |n: u64| {
            let at = STEP.map(|step| (0.5 + step * n as f64).fract());
            let coercive_v =
                truth.coercive_median_v * (truth.coercive_log_spread * logit(at[0])).exp();
            let bias_v = truth.bias_mean_v + truth.bias_spread_v * logit(at[1]);
            (bias_v + coercive_v, bias_v - coercive_v)
        };
        // Some draws lie outside the drive's range; a distribution that never meets it ends the search.
        let most = 1000 * truth.count.max(1) as u64;
        let inside = (1..most)
            .map(domain)
            .filter(|(up, _)| *up > drive_min_v && *up <= drive_max_v)
            .take(truth.count);
        let numbered = (0u32..).zip(inside);
        let (mut up_v, mut down_v): (Vec<_>, Vec<_>) =
            numbered.map(|(i, (up, down))| ((up, i), (down, i))).unzip();
        up_v.sort_by(|a, b| a.0.total_cmp(&b.0));
        down_v.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (count, below) = (
            up_v.len(),
            down_v.partition_point(|(v, _)| *v < drive_min_v),
        );
        Self {
            thresholds: Arc::new(Thresholds { up_v, down_v }),
            is_up: vec![false; count],
            up: 0,
            passed: [0, below],
            drive_v: drive_min_v,
            um_per_domain: truth.switched_um / count.max(1) as f64,
            reversible: [truth.reversible_um_v, truth.reversible_um_v2],
            zero_v: drive_min_v,
        }
    }

    /// Takes the next drive and returns the force-equivalent displacement, um.
    pub fn step(&mut self, drive_v: f64) -> f64 {
        let Thresholds { up_v, down_v } = &*self.thresholds;
        let [risen, fallen] = &mut self.passed;
        if drive_v > self.drive_v {
            while let Some((_, domain)) = up_v.get(*risen).filter(|(v, _)| *v <= drive_v) {
                let state = &mut self.is_up[*domain as usize];
                self.up += u32::from(!*state);
                *state = true;
                *risen += 1;
            }
            while down_v.get(*fallen).is_some_and(|(v, _)| *v < drive_v) {
                *fallen += 1;
            }
        } else {
            while let Some((_, domain)) = fallen
                .checked_sub(1)
                .and_then(|i| down_v.get(i))
                .filter(|(v, _)| *v >= drive_v)
            {
                let state = &mut self.is_up[*domain as usize];
                self.up -= u32::from(*state);
                *state = false;
                *fallen -= 1;
            }
            while risen
                .checked_sub(1)
                .and_then(|i| up_v.get(i))
                .is_some_and(|(v, _)| *v > drive_v)
            {
                *risen -= 1;
            }
        }
        self.drive_v = drive_v;
        let above_v = drive_v - self.zero_v;
        self.switched_um() + above_v * (self.reversible[0] + above_v * self.reversible[1])
    }

    /// What the domains that are up give, um.
    #[must_use]
    pub fn switched_um(&self) -> f64 {
        f64::from(self.up) * self.um_per_domain
    }
}

/// Creep strains with their state.
#[derive(Clone, Debug)]
pub(crate) struct DomainCreep {
    /// Share, and the share of a time constant that a step takes, of each.
    strains: Vec<(f64, f64)>,
    activation_um: f64,
    states_um: Vec<f64>,
}

impl DomainCreep {
    pub(crate) fn new(truth: &DomainCreepTruth, dt_s: f64) -> Self {
        let strains: Vec<(f64, f64)> = truth
            .shares
            .iter()
            .zip(&truth.time_constants_s)
            .map(|(share, tau_s)| (*share, dt_s / tau_s.max(dt_s)))
            .collect();
        let states_um = vec![0.0; strains.len()];
        Self {
            strains,
            activation_um: truth.activation_um,
            states_um,
        }
    }

    /// One step under what the domains have switched; what has crept, um.
    ///
    /// Midpoint rule: a step is at most a ten-thousandth of the fastest time constant.
    pub(crate) fn step(&mut self, switched_um: f64) -> f64 {
        let s = self.activation_um;
        for ((share, step), z) in self.strains.iter().zip(&mut self.states_um) {
            let rate = |z: f64| step * s * ((share * switched_um - z) / s).sinh();
            *z += rate(*z + 0.5 * rate(*z));
        }
        self.states_um.iter().sum()
    }
}

/// Noise beside the white one, from a seed.
#[derive(Clone, Debug)]
pub struct ColouredNoise {
    flicker: FlickerNoise,
    /// Amplitude, um, phase now and its step, rad.
    lines: Vec<(f64, f64, f64)>,
}

impl ColouredNoise {
    /// At a sampling rate; the phases of the lines are the seed's.
    #[must_use]
    pub fn new(truth: &SensorTruth, sample_rate_hz: f64, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed ^ 0x11_4e5);
        let lines = truth.line_hz.iter().zip(&truth.line_um);
        Self {
            flicker: FlickerNoise::new(truth.flicker_um_per_root_hz, sample_rate_hz, seed ^ 0xf11c),
            lines: lines
                .map(|(hz, um)| (*um, TAU * random.random::<f64>(), TAU * hz / sample_rate_hz))
                .collect(),
        }
    }

    /// The next value, um.
    pub fn next_um(&mut self) -> f64 {
        let mut sum = self.flicker.next_um();
        for (amplitude_um, phase, step) in &mut self.lines {
            sum += *amplitude_um * phase.sin();
            *phase = (*phase + *step) % TAU;
        }
        sum
    }
}

/// Domains, modes and creep between the voltage on the piezo and the displacement.
#[derive(Clone, Debug)]
pub(crate) struct DomainStage {
    pub(crate) domains: Domains,
    /// Share of each mode, and the mode.
    modes: Vec<(f64, FixedSystem<2>)>,
    creep: DomainCreep,
}

impl DomainStage {
    /// At rest, never driven.
    pub(crate) fn virgin(
        truth: &DomainTruth,
        (drive_min_v, drive_max_v): (f64, f64),
        load_kg: f64,
        dt_s: f64,
    ) -> Self {
        let modes = truth.structure.modes(load_kg);
        let kept = modes.iter().take(MODES);
        let all: f64 = kept.clone().map(|m| m.share).sum();
        let system = |m: &StructureMode| {
            let w = m.natural_frequency_rad_s;
            let mode = ContinuousSystem::from_transfer_function(
                &[w * w],
                &[1.0, 2.0 * m.damping_ratio * w, w * w],
            )?;
            Some((m.share / all, FixedSystem::new(&mode.discretise(dt_s))?))
        };
        Self {
            domains: Domains::virgin(truth, drive_min_v, drive_max_v),
            modes: kept.filter_map(system).collect(),
            creep: DomainCreep::new(&truth.creep, dt_s),
        }
    }

    /// One step under a force-equivalent displacement, um; the displacement of the end-effector at its end,
    /// um.
    pub(crate) fn move_by(&mut self, force_um: f64) -> f64 {
        let crept_um = self.creep.step(self.domains.switched_um());
        self.modes
            .iter_mut()
            .map(|(share, mode)| *share * mode.step_held(force_um + crept_um))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use proptest::prelude::*;

    fn truth() -> DomainTruth {
        Bench::domains().unwrap().domains.unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        /// Oracle: every domain asked by itself at every drive.
        #[test]
        fn it_is_the_sum_of_its_switches(drives in proptest::collection::vec(0.0f64..80.0, 1..40)) {
            let truth = DomainTruth { count: 500, ..truth() };
            let mut domains = Domains::virgin(&truth, 0.0, 80.0);
            let mut thresholds = vec![(0.0, 0.0); domains.is_up.len()];
            domains.thresholds.up_v.iter().for_each(|(v, i)| thresholds[*i as usize].0 = *v);
            domains.thresholds.down_v.iter().for_each(|(v, i)| thresholds[*i as usize].1 = *v);
            let mut is_up = vec![false; thresholds.len()];
            for drive_v in drives {
                let got = domains.step(drive_v);
                for (state, (up, down)) in is_up.iter_mut().zip(&thresholds) {
                    *state = drive_v >= *up || (*state && drive_v > *down);
                }
                let switched = is_up.iter().filter(|s| **s).count() as f64 * truth.switched_um / thresholds.len() as f64;
                let expected = switched + drive_v * (truth.reversible_um_v + drive_v * truth.reversible_um_v2);
                prop_assert!((got - expected).abs() < 1e-9, "{got} {expected}");
            }
        }
    }

    /// Two masses on springs have a closed form: a stiff stack of one element between a heavy base and the
    /// end-effector.
    #[test]
    fn modes_of_two_masses_are_those_of_the_closed_form() {
        let structure = StructureTruth {
            stack_elements: 1,
            stack_mass_kg: 0.0,
            ..truth().structure
        };
        let (m0, m1) = (structure.base_mass_kg, structure.end_mass_kg);
        let (k0, k, k1) = (
            structure.base_stiffness_n_m,
            structure.stack_stiffness_n_m,
            structure.flexure_stiffness_n_m,
        );
        let (a, b) = ((k0 + k) / m0, (k + k1) / m1);
        let root = ((a - b).powi(2) + 4.0 * k * k / (m0 * m1)).sqrt();
        let modes = structure.modes(0.0);
        for (mode, square) in modes
            .iter()
            .zip([0.5 * (a + b - root), 0.5 * (a + b + root)])
        {
            assert!((mode.natural_frequency_rad_s / square.sqrt() - 1.0).abs() < 1e-9);
        }
        assert!((modes.iter().map(|m| m.share).sum::<f64>() - 1.0).abs() < 1e-12);
        // A rigid contact adds the load's mass.
        let stiff = StructureTruth {
            load_contact_n_m: 1e13,
            base_stiffness_n_m: 1e13,
            ..structure.clone()
        };
        let expected = ((k + k1) / (m1 + 0.1421)).sqrt();
        assert!((stiff.modes(0.1421)[0].natural_frequency_rad_s / expected - 1.0).abs() < 1e-4);
    }

    #[test]
    fn creep_ends_where_the_domains_left_it() {
        let truth = DomainCreepTruth {
            shares: vec![0.1],
            time_constants_s: vec![0.02],
            activation_um: 0.06,
        };
        let mut creep = DomainCreep::new(&truth, 1e-4);
        let mut crept = 0.0;
        (0..20_000).for_each(|_| crept = creep.step(3.0));
        assert!((crept - 0.3).abs() < 1e-9);
        // Near its equilibrium it is a first-order lag.
        let mut near = DomainCreep::new(&truth, 1e-4);
        (0..200).for_each(|_| crept = near.step(0.001));
        assert!(
            (crept / 1e-4 - (1.0 - (-1.0f64).exp())).abs() < 1e-3,
            "{crept}"
        );
    }
}
