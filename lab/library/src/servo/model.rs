//! What a servo design knows of the actuator: hysteresis surfaces, modes, bandwidths. All of it identified,
//! or from a data sheet.

pub use super::creep::CreepTerm;
use super::creep::{self, CreepPair};
use hysteron_sim::chain::Model;
use hysteron_sim::effect::hysteresis::degree_of;
use hysteron_sim::effect::{
    Setting, amplifier_bandwidth, gain, hysteresis, initial_curve, play_operators, second_mode,
    sensor_bandwidth, vibration,
};
use hysteron_sim::hysteresis_surface::Surfaces;
use hysteron_sim::linear_system::ContinuousSystem;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Sampling period of a loop of which nothing else is known, s (thesis Ch. 7, 2.1).
pub const SAMPLING_PERIOD_S: f64 = 5e-5;

pub(super) fn usual_period_s() -> f64 {
    SAMPLING_PERIOD_S
}

pub(super) fn is_usual_period(period_s: &f64) -> bool {
    *period_s == SAMPLING_PERIOD_S
}

/// One second-order mode of unit static gain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModeModel {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// The nominal model of the thesis (Ch. 6, Eq. 3; Ch. 7, Eq. 1): one mode behind a gain, everything else an
/// unknown input.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NominalModel {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Static gain, um/V.
    pub gain_um_v: f64,
}

impl NominalModel {
    /// The values that the thesis identified on the P-753 (Ch. 6, 4.1).
    pub const THESIS: Self = Self {
        natural_frequency_rad_s: 5352.0,
        damping_ratio: 0.7876,
        gain_um_v: 0.1347,
    };

    /// `A21 = -wn^2`, 1/s^2.
    #[must_use]
    pub fn a21(&self) -> f64 {
        -self.natural_frequency_rad_s.powi(2)
    }

    /// `A22 = -2 xi wn`, 1/s.
    #[must_use]
    pub fn a22(&self) -> f64 {
        -2.0 * self.damping_ratio * self.natural_frequency_rad_s
    }

    /// `B2 = K wn^2`, um/(V s^2).
    #[must_use]
    pub fn b2(&self) -> f64 {
        self.gain_um_v * self.natural_frequency_rad_s.powi(2)
    }

    /// Sampled model with the drive held: transition matrix and input vector over `[y (um), y' (um/s)]`.
    #[must_use]
    pub fn sampled(&self, period_s: f64) -> (DMatrix<f64>, DVector<f64>) {
        ContinuousSystem {
            a: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, self.a21(), self.a22()]),
            b: DVector::from_row_slice(&[0.0, self.b2()]),
            c: DVector::from_row_slice(&[1.0, 0.0]),
            d: 0.0,
        }
        .held_matrices(period_s)
    }
}

/// The linear dynamics behind the hysteresis: from force-equivalent displacement to reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinearModel {
    /// First mode.
    pub first_mode: ModeModel,
    /// Share of the motion that goes through the second mode, with that mode.
    pub second_mode: Option<(f64, ModeModel)>,
    /// Bandwidth of the amplifier, Hz. It stands in front of the hysteresis and is taken to commute with it.
    pub amplifier_bandwidth_hz: Option<f64>,
    /// Bandwidth of the sensor, Hz.
    pub sensor_bandwidth_hz: Option<f64>,
    /// Sampling period of the loop that is closed around them, s.
    #[serde(default = "usual_period_s", skip_serializing_if = "is_usual_period")]
    pub period_s: f64,
}

/// The linear dynamics, sampled: `x+ = a x + b v`, `y = c x`.
#[derive(Clone, Debug)]
pub struct SampledModel {
    /// Transition matrix.
    pub a: DMatrix<f64>,
    /// Input vector.
    pub b: DVector<f64>,
    /// Reading, a row.
    pub c: DVector<f64>,
    /// Sampling period, s.
    pub period_s: f64,
}

impl LinearModel {
    /// The same dynamics with more mass on the same spring.
    #[must_use]
    pub fn with_mass_ratio(&self, mass_ratio: f64) -> Self {
        let factor = mass_ratio.powf(-0.5);
        let scale = |m: ModeModel| ModeModel {
            natural_frequency_rad_s: m.natural_frequency_rad_s * factor,
            damping_ratio: m.damping_ratio * factor,
        };
        Self {
            first_mode: scale(self.first_mode),
            second_mode: self.second_mode.map(|(share, m)| (share, scale(m))),
            ..*self
        }
    }

    /// Modes with their shares of the static displacement.
    fn modes(&self, unknown: Option<(f64, ModeModel)>) -> Vec<(f64, ModeModel)> {
        let of_second = self.second_mode.map_or(0.0, |(share, _)| share);
        let of_unknown = unknown.map_or(0.0, |(share, _)| share);
        let mut modes = vec![(1.0 - of_second - of_unknown, self.first_mode)];
        modes.extend(self.second_mode);
        modes.extend(unknown);
        modes
    }

    /// Continuous-time system; states: first mode and its velocity over `wn`, second mode likewise,
    /// amplifier, sensor (those that exist).
    #[must_use]
    pub fn continuous(&self) -> ContinuousSystem {
        self.continuous_with(None)
    }

    /// The same with one more mode, which takes its share of the motion from the first one.
    #[must_use]
    pub fn continuous_with(&self, unknown: Option<(f64, ModeModel)>) -> ContinuousSystem {
        let modes = self.modes(unknown);
        let n = 2 * modes.len()
            + usize::from(self.amplifier_bandwidth_hz.is_some())
            + usize::from(self.sensor_bandwidth_hz.is_some());
        let mut a = DMatrix::zeros(n, n);
        let mut b = DVector::zeros(n);
        let mut c = DVector::zeros(n);
        let amplifier = self
            .amplifier_bandwidth_hz
            .map(|hz| (2 * modes.len(), TAU * hz));
        let sensor = self.sensor_bandwidth_hz.map(|hz| (n - 1, TAU * hz));
        if let Some((i, w)) = amplifier {
            a[(i, i)] = -w;
            b[i] = w;
        }
        for (nth, (share, mode)) in modes.into_iter().enumerate() {
            let i = 2 * nth;
            let w = mode.natural_frequency_rad_s;
            a[(i, i + 1)] = w;
            a[(i + 1, i)] = -w;
            a[(i + 1, i + 1)] = -2.0 * mode.damping_ratio * w;
            match amplifier {
                Some((j, _)) => a[(i + 1, j)] = w,
                None => b[i + 1] = w,
            }
            match sensor {
                Some((j, ws)) => a[(j, i)] = share * ws,
                None => c[i] = share,
            }
        }
        if let Some((j, ws)) = sensor {
            a[(j, j)] = -ws;
            c[j] = 1.0;
        }
        ContinuousSystem { a, b, c, d: 0.0 }
    }

    /// Sampled with the input held.
    #[must_use]
    pub fn sampled(&self) -> SampledModel {
        let system = self.continuous();
        let (a, b) = system.held_matrices(self.period_s);
        SampledModel {
            a,
            b,
            c: system.c,
            period_s: self.period_s,
        }
    }
}

/// All that a design knows of the actuator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorModel {
    /// Lower limit of the drive, V.
    pub drive_min_v: f64,
    /// Upper limit of the drive, V.
    pub drive_max_v: f64,
    /// Loop surface in powers of the drive share: `g[i][j]` multiplies `x^i z^j`, um.
    pub g_um: Vec<Vec<f64>>,
    /// Remnant in powers of the drive share, um.
    pub r_um: Vec<f64>,
    /// Dynamics behind the hysteresis.
    pub linear: LinearModel,
    /// Creep behind them, as first-order terms: for the feedforward; a feedback leaves it to the unknown
    /// input.
    #[serde(default)]
    pub creep: Vec<CreepTerm>,
    /// Its second-order term with complex poles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creep_pair: Option<CreepPair>,
}

impl ActuatorModel {
    /// The hysteresis surfaces.
    #[must_use]
    pub fn surfaces(&self) -> Surfaces {
        Surfaces {
            g: self.g_um.clone(),
            r: self.r_um.clone(),
        }
    }

    /// The same actuator with another gain: every displacement is so many times as large.
    #[must_use]
    pub fn with_gain(&self, gain: f64) -> Self {
        let mut out = self.clone();
        out.g_um
            .iter_mut()
            .flatten()
            .chain(&mut out.r_um)
            .for_each(|c| *c *= gain);
        out
    }

    /// The surfaces with play operators, by threshold over the range and weight, in them.
    pub(super) fn with_plays(self, plays: &[(f64, f64)]) -> Self {
        if plays.is_empty() {
            return self;
        }
        // An element of half-width r moves once the drive has come back by 2 r, on the first rise after r.
        let beyond = |way: f64, widths: f64| -> f64 {
            plays
                .iter()
                .map(|(threshold, weight)| weight * (way - widths * threshold).max(0.0))
                .sum()
        };
        self.with_surfaces_of(
            DEGREE_OF_OTHERS,
            0.0,
            |x, z| beyond(x - z, 2.0),
            |x| beyond(x, 1.0) - beyond(x, 2.0),
        )
        .0
    }

    /// Surfaces of a degree, fitted to these and what is added to them, and the largest difference that
    /// remains, um.
    pub(super) fn with_surfaces_of(
        &self,
        degree: usize,
        weight: f64,
        more_loop: impl Fn(f64, f64) -> f64,
        more_remnant: impl Fn(f64) -> f64,
    ) -> (Self, f64) {
        const GRID: usize = LOOP_GRID;
        let at = |k: usize| k as f64 / GRID as f64;
        let surfaces = self.surfaces();
        let remnant =
            |x: f64| self.r_um.iter().rev().fold(0.0, |sum, c| sum * x + c) + more_remnant(x);
        let terms: Vec<(i32, i32)> = (0..degree as i32)
            .flat_map(|total| (0..=total).map(move |j| (total - j, j)))
            .collect();
        let points: Vec<(f64, f64)> = (1..=GRID)
            .flat_map(|i| (0..i).map(move |j| (at(i), at(j))))
            .collect();
        let of_points = |row: usize, column: usize| {
            let ((x, z), (i, j)) = (points[row], terms[column]);
            (x - z) * x.powi(i) * z.powi(j)
        };
        // Rows below the points hold the coefficients down.
        let held = |row: usize, column: usize| if row == column { weight } else { 0.0 };
        let rows = points.len();
        let a = DMatrix::from_fn(rows + terms.len(), terms.len(), |r, c| {
            if r < rows {
                of_points(r, c)
            } else {
                held(r - rows, c)
            }
        });
        let b = DVector::from_fn(rows + terms.len(), |r, _| {
            points
                .get(r)
                .map_or(0.0, |(x, z)| surfaces.loop_loss(*x, *z) + more_loop(*x, *z))
        });
        let a_r = DMatrix::from_fn(GRID + degree, degree, |r, c| {
            if r < GRID {
                at(r + 1).powi(c as i32 + 1)
            } else {
                held(r - GRID, c)
            }
        });
        let b_r = DVector::from_fn(GRID + degree, |r, _| {
            if r < GRID { remnant(at(r + 1)) } else { 0.0 }
        });
        let (Ok(g_terms), Ok(r_terms)) = (
            a.clone().svd(true, true).solve(&b, 1e-12),
            a_r.clone().svd(true, true).solve(&b_r, 1e-12),
        ) else {
            return (self.clone(), f64::INFINITY);
        };
        let mut g_um = vec![vec![0.0; degree + 1]; degree + 1];
        for ((i, j), value) in terms.iter().zip(g_terms.iter()) {
            g_um[*i as usize + 1][*j as usize] += value;
            g_um[*i as usize][*j as usize + 1] -= value;
        }
        let r_um = std::iter::once(0.0)
            .chain(r_terms.iter().copied())
            .collect();
        let error_um =
            (a * &g_terms - b).rows(0, rows).amax() + (a_r * &r_terms - b_r).rows(0, GRID).amax();
        (
            Self {
                g_um,
                r_um,
                ..self.clone()
            },
            error_um,
        )
    }

    /// Displacements between which the drive can hold the actuator after it was conditioned, um.
    #[must_use]
    pub fn reach_um(&self) -> f64 {
        self.surfaces().loop_loss(1.0, 0.0)
    }

    /// Least and largest slope of a loop's section over the whole triangle of turning points, as shares of
    /// the mean slope. Not positive: the hysteresis cannot be inverted there.
    #[must_use]
    pub fn slope_range(&self) -> (f64, f64) {
        const GRID: usize = 24;
        let surfaces = self.surfaces();
        let step = 1.0 / GRID as f64;
        let mean = self.reach_um();
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        let mut see = |slope: f64| range = (range.0.min(slope / mean), range.1.max(slope / mean));
        for i in 1..=GRID {
            for j in 0..i {
                let (x, z) = (i as f64 * step, j as f64 * step);
                // Rising to x from z, and falling to z from x.
                see((surfaces.loop_loss(x, z) - surfaces.loop_loss(x - step, z)) / step);
                see((surfaces.loop_loss(x, z) - surfaces.loop_loss(x, z + step)) / step);
            }
        }
        range
    }

    /// Mean slope of the largest loop, um/V: the nominal gain of a design without hysteresis model.
    #[must_use]
    pub fn mean_gain_um_v(&self) -> f64 {
        self.surfaces().loop_loss(1.0, 0.0) / (self.drive_max_v - self.drive_min_v)
    }
}
/// Degree of the polynomial surfaces that stand for loops of another structure, until the tick's own degree
/// is fitted.
const DEGREE_OF_OTHERS: usize = 8;
/// Inputs in each direction at which loops of another structure are read: those at which surfaces are fitted.
const LOOP_GRID: usize = 24;

/// What a design or a check needs of a chain.
///
/// # Errors
/// What the chain has not, and how to come to a model that has it.
pub fn required_model(chain: &Model) -> Result<ActuatorModel, String> {
    actuator_model(chain).ok_or_else(|| {
        let linear = chain.effect(gain::ID).is_some();
        let has_loops = chain.effects.iter().any(|e| e.effect.declaration().is_main());
        let lacks = match (has_loops, chain.effect(vibration::ID).is_some()) {
            (true, _) => "no first mode",
            (false, true) => "neither of the first two",
            (false, false) => "none of these",
        };
        format!(
            "a servo is computed with the effects `hysteresis` (or another structure of the loops, or `gain`, for a linear stage) and `vibration`, the first mode; this model has {lacks}: identify one with --effects {},vibration,creep",
            if linear { gain::ID } else { "hysteresis,initial_curve" }
        )
    })
}

/// What a design needs of a chain. A gain is a surface without loops; loops of any other structure are read
/// on their first rises and on the falls from there, and surfaces are fitted to that.
#[must_use]
pub fn actuator_model(chain: &Model) -> Option<ActuatorModel> {
    let main = chain
        .effects
        .iter()
        .find(|e| e.effect.declaration().is_main())?;
    let g = match main.id.as_str() {
        gain::ID => {
            vec![chain.values(gain::ID)?.first()? * (chain.drive_max_v - chain.drive_min_v)]
        }
        hysteresis::ID => main.values(),
        _ => vec![0.0],
    };
    let r = chain.values(initial_curve::ID).unwrap_or_default();
    let surfaces = Surfaces::from_legendre(degree_of(g.len()), &g, &r);
    let (creep, creep_pair) = creep::of_chain(chain);
    let mode = |v: &[f64]| {
        Some(ModeModel {
            natural_frequency_rad_s: *v.first()?,
            damping_ratio: *v.get(1)?,
        })
    };
    let model = ActuatorModel {
        drive_min_v: chain.drive_min_v,
        drive_max_v: chain.drive_max_v,
        g_um: surfaces.g,
        r_um: surfaces.r,
        linear: LinearModel {
            first_mode: mode(&chain.values(vibration::ID)?)?,
            second_mode: chain
                .values(second_mode::ID)
                .and_then(|v| Some((*v.first()?, mode(v.get(1..)?)?))),
            amplifier_bandwidth_hz: chain
                .values(amplifier_bandwidth::ID)
                .and_then(|v| v.first().copied()),
            sensor_bandwidth_hz: chain
                .values(sensor_bandwidth::ID)
                .and_then(|v| v.first().copied()),
            period_s: SAMPLING_PERIOD_S,
        },
        creep,
        creep_pair,
    };
    if ![gain::ID, hysteresis::ID].contains(&main.id.as_str()) {
        let range_v = [chain.drive_min_v, chain.drive_max_v];
        let loops = first_falls_um(chain, range_v, LOOP_GRID)?;
        let at = |x: f64| (x * LOOP_GRID as f64).round() as usize;
        // On a first rise to x and down to z the output is R(x) + G(x, 0) - G(x, z).
        let fallen = |x: f64, z: f64| loops[at(x)][at(x)] - loops[at(x)][at(z)];
        return Some(
            model
                .with_surfaces_of(DEGREE_OF_OTHERS, 0.0, fallen, |x| loops[at(x)][0])
                .0,
        );
    }
    let plays = chain.values(play_operators::ID).unwrap_or_default();
    let plays = plays.chunks_exact(2).map(|pair| (pair[1], pair[0]));
    Some(model.with_plays(&plays.collect::<Vec<_>>()))
}

/// Outputs on the way down from a first rise: by the input where it turned, then by the input on the way
/// down, in so many steps of a range of drives; um above where the rise began. None where the structure cannot
/// be stepped by itself.
pub(super) fn first_falls_um(
    chain: &Model,
    [from_v, to_v]: [f64; 2],
    steps: usize,
) -> Option<Vec<Vec<f64>>> {
    let drive_v = |k: usize| from_v + (to_v - from_v) * k as f64 / steps as f64;
    if let Some(gain) = chain.values(gain::ID) {
        let along = |turn: usize| {
            (0..=turn)
                .map(|k| gain[0] * (drive_v(k) - from_v))
                .collect()
        };
        return Some((0..=steps).map(along).collect());
    }
    let main = (chain.effects.iter()).find(|e| e.effect.declaration().is_main())?;
    // So slow that nothing of the loops depends on the rate.
    let setting = Setting::of_held_drive(chain.drive_min_v, chain.drive_max_v, 1.0);
    (0..=steps)
        .map(|turn| {
            let mut loops = main.loops(chain, &setting)?;
            let zero_um = loops.step(0, from_v);
            let risen_um = (0..=turn).map(|k| loops.step(0, drive_v(k))).last()?;
            let mut fall: Vec<f64> = std::iter::once(risen_um)
                .chain((0..turn).rev().map(|k| loops.step(0, drive_v(k))))
                .map(|out_um| out_um - zero_um)
                .collect();
            fall.reverse();
            Some(fall)
        })
        .collect()
}

/// Least slope of a section of a chain's own loops, as a share of the mean one; none where its loops cannot
/// be stepped by themselves. Where it is not positive one displacement has several drives.
#[must_use]
pub fn least_slope(chain: &Model) -> Option<f64> {
    let main = (chain.effects.iter()).find(|e| e.effect.declaration().is_main())?;
    if main.id == hysteresis::ID
        && let Some(model) = actuator_model(chain)
    {
        return Some(model.slope_range().0);
    }
    let falls = first_falls_um(chain, [chain.drive_min_v, chain.drive_max_v], LOOP_GRID)?;
    let risen = |turn: usize| falls[turn][turn];
    let whole = risen(LOOP_GRID) - falls[LOOP_GRID][0];
    let fallen = (1..=LOOP_GRID).flat_map(|turn| falls[turn].windows(2).map(|w| w[1] - w[0]));
    let rises = (1..=LOOP_GRID).map(|turn| risen(turn) - risen(turn - 1));
    let steps = rises.chain(fallen.collect::<Vec<_>>());
    Some(steps.fold(f64::INFINITY, f64::min) * LOOP_GRID as f64 / whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    fn with_loops(id: &str, values: &[f64]) -> Model {
        let overview = Overview {
            range_um: 10.0,
            gain_um_v: 0.125,
            ..Overview::without_data(0.0, 80.0)
        };
        let mut chain = Model::new(0.0, 80.0);
        chain.add(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        chain.add(EffectInstance::new(
            by_id("vibration").unwrap(),
            &overview,
            &[5000.0, 0.5],
        ));
        chain
    }

    /// Every structure of the loops gives a design its surfaces: first rise and fall of the structure itself,
    /// within a part of the opening of its loops.
    #[test]
    fn any_loop_structure_gives_a_servo_its_surfaces() {
        let plays: Vec<f64> = std::iter::once(7.0).chain([0.25; 9]).collect();
        let slips: Vec<f64> = std::iter::once(11.0).chain([0.3; 8]).collect();
        let structures: [(&str, &[f64], f64); 5] = [
            ("prandtl_ishlinskii", &plays, 0.02),
            ("maxwell_slip", &slips, 0.03),
            ("bouc_wen", &[11.0, 4.0, 2.0, 0.5], 0.05),
            ("duhem", &[3.0, 10.0, 7.0], 0.05),
            ("rate_dependent_prandtl_ishlinskii", &plays, 0.02),
        ];
        for (id, values, tolerance_um) in structures {
            let chain = with_loops(id, values);
            let model = required_model(&chain).unwrap();
            let surfaces = model.surfaces();
            let loops = first_falls_um(&chain, [0.0, 80.0], LOOP_GRID).unwrap();
            for turn in 1..=LOOP_GRID {
                let x = turn as f64 / LOOP_GRID as f64;
                let rise = surfaces.initial_ascending_curve(x);
                assert!(
                    (rise - loops[turn][turn]).abs() < tolerance_um,
                    "{id} rises to {x}: {rise} {}",
                    loops[turn][turn]
                );
                let middle = rise - surfaces.loop_loss(x, (turn / 2) as f64 / LOOP_GRID as f64);
                assert!(
                    (middle - loops[turn][turn / 2]).abs() < 2.0 * tolerance_um,
                    "{id} falls from {x}: {middle} {}",
                    loops[turn][turn / 2]
                );
            }
            let (least, _) = model.for_the_tick().0.slope_range();
            assert!(least > 0.0, "{id}: slope {least}");
        }
    }
}
