//! PIDSMO and PIDSMC (thesis Ch. 6 and 7) of a stage with couplings: matrices where a single axis has numbers.
//!
//! The observer carries as many modes as axes, and an unknown input for every axis. Errors are taken where the
//! model is when the new drives begin to act, one period after the reading, as in the predictor form of
//! [`crate::servo`]. Of more drives than axes the law takes those that need least drive together.
//!
//! # Stability conditions of the PIDSMOC with matrices
//! With `C` the participations of the sensors in the modes, `W` the natural frequencies and `Z` the damping
//! ratios (diagonal), and `B` the participations of the drives, the nominal stage is `y'' = A21 y + A22 y' + B2
//! (u + e)`, where `A21 = -C W^2 C^-1`, `A22 = -2 C Z W C^-1` and `B2 = C W^2 B`. The steps of Ch. 6, Eqs.
//! 5-15 and Ch. 7, Eqs. 6-26 divide by `B2` alone, so they hold with matrices in this order:
//!
//! ```text
//! sliding   e1' = -M e1                                         eigenvalues of M in the right half plane
//! reaching  (1 + B2 Dc) q'' + B2 Pc q' + B2 Ic q = B2 e'        roots of det(.) in the left half plane
//! observer  e''' + (B2 Do - A22) e'' + B2 Po e' + B2 Io e = B2 e'
//! ```
//!
//! They are conditions on the matrices, not on their entries: positive gains of every axis do not suffice
//! (test `positive_gains_of_every_axis_do_not_suffice`). Where `1 + B2 Dc`, `B2 Pc` and `B2 Ic` are symmetric and
//! positive definite in one basis, the second holds (Kelvin, Tait and Chetaev). The gains here are diagonal in
//! the modes, where every condition is that of a single axis, mode by mode. So the law with as many modes as
//! axes is modal decoupling with a PIDSMOC for each mode. As for one axis, the conditions do not cover delay
//! and sampling: the eigenvalues of the sampled loop decide ([`super::loop_check`]).

use super::decoupling::largest_modes;
use super::loop_check::{Aim, AxesLaw, CheckedStage, Harmonic, LinearSystem, gain_sets};
use crate::error::{Error, Result};
use hysteron_sim::several_axes::{DrivePath, ModalStage, SensorPath, StageMode};
use nalgebra::{Complex, DMatrix, DVector, Schur};
use std::f64::consts::TAU;

/// What is asked of a law.
#[derive(Clone, Copy, Debug)]
pub struct AxesDemands {
    /// Frequency at which the error is to be small, Hz.
    pub reference_hz: f64,
    /// Amplitude of references, in the unit of the sensors.
    pub amplitude: f64,
    /// Noise of a sensor, RMS.
    pub noise: f64,
    /// Largest singular value of the sensitivity at the drives.
    pub sensitivity_peak: f64,
}

/// Gains of the PIDSMOC in the thesis' units, as matrices, and the roots that its conditions ask for.
#[derive(Clone, Debug)]
pub struct PidsmocGains {
    /// `M`, `B2 Pc` and `B2 Ic`; `Dc` is zero, as it would only scale the others.
    pub controller: [DMatrix<f64>; 3],
    /// `B2 Do - A22`, `B2 Po` and `B2 Io`.
    pub observer: [DMatrix<f64>; 3],
}

/// Steps of an eigenvalue iteration: some for each of a few dozen.
const SCHUR_STEPS: usize = 1000;

/// Roots of `det(s^k + A_1 s^(k-1) + ... + A_k)`.
fn roots(coefficients: &[DMatrix<f64>]) -> Option<Vec<Complex<f64>>> {
    let (n, k) = (coefficients[0].nrows(), coefficients.len());
    let powers = || coefficients.iter().zip(1..);
    // Scaled so that the companion matrix is balanced: its eigenvalues are not found otherwise.
    let scale = powers()
        .map(|(a, power)| a.amax().powf(1.0 / f64::from(power)))
        .fold(0.0, f64::max);
    let mut companion = DMatrix::zeros(n * k, n * k);
    for (a, power) in powers() {
        let scaled = a / -scale.powi(power);
        let column = n * (power as usize - 1);
        companion.view_mut((0, column), (n, n)).copy_from(&scaled);
    }
    let below = n * (k - 1);
    companion
        .view_mut((n * k - below, 0), (below, below))
        .fill_with_identity();
    let all = Schur::try_new(companion, 1e-13, SCHUR_STEPS)?.complex_eigenvalues();
    Some(all.iter().map(|root| root * scale).collect())
}

impl PidsmocGains {
    /// Roots of sliding and reaching, and of the observer; none if they are not found.
    #[must_use]
    pub fn roots(&self) -> Option<[Vec<Complex<f64>>; 2]> {
        let [m, p, i] = &self.controller;
        let mut controller = roots(&[p.clone(), i.clone()])?;
        controller.extend(roots(std::slice::from_ref(m))?);
        Some([controller, roots(&self.observer)?])
    }

    /// All roots lie in the left half plane.
    #[must_use]
    pub fn conditions_hold(&self) -> bool {
        let stable = |roots: [Vec<Complex<f64>>; 2]| roots.iter().flatten().all(|z| z.re < 0.0);
        self.roots().is_some_and(stable)
    }
}

/// Poles of a PIDSMOC: damping ratios of the pairs at every mode of controller and observer, the rate `m` of
/// the sliding motion and that of the observer's integral, 1/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidsmocPoles {
    controller_damping: f64,
    observer_damping: f64,
    sliding_per_s: f64,
    unknown_per_s: f64,
}

/// A law of all axes.
#[derive(Clone, Debug)]
pub struct MatrixServo {
    dt_s: f64,
    model: LinearSystem,
    /// Drives by axes: how the drives share what the axes need.
    spread: DMatrix<f64>,
    /// Axes by states.
    feedback: DMatrix<f64>,
    /// Axes by sums, and sums by states: gains of the sums of the error.
    integral: DMatrix<f64>,
    integrates: DMatrix<f64>,
    /// States and unknown inputs by sensors.
    observer: DMatrix<f64>,
    /// Gains of the PIDSMOC with matrices.
    pub gains: PidsmocGains,
    /// Limits that the drives keep.
    pub limits: Option<[f64; 2]>,
}

/// Shares of the drive that are unknown if the model has no hysteresis: piezo actuators have loops of 10 to
/// 20 % of their motion.
const UNKNOWN_LEAST: f64 = 0.1;
/// Damping ratios of the poles at the modes that are tried; that of the mode itself is the least.
const DAMPINGS: [f64; 6] = [0.0, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Rates of sliding that are tried, and of the observer's integral, Hz.
const SLIDING_HZ: [f64; 3] = [20.0, 80.0, 320.0];
const UNKNOWN_HZ: [f64; 6] = [20.0, 40.0, 80.0, 160.0, 320.0, 640.0];
/// Gain `k` for which `a - b k` has these poles (Ackermann 1972).
fn placed(a: &DMatrix<f64>, b: &DVector<f64>, poles: &[Complex<f64>]) -> Option<DVector<f64>> {
    let n = a.nrows();
    let mut reach = DMatrix::zeros(n, n);
    let mut column = b.clone();
    for j in 0..n {
        reach.set_column(j, &column);
        column = a * column;
    }
    let mut wanted = DMatrix::<Complex<f64>>::identity(n, n);
    for pole in poles {
        wanted = &wanted * (a.map(Complex::from) - DMatrix::identity(n, n) * *pole);
    }
    let last = DVector::from_fn(n, |i, _| f64::from(i + 1 == n));
    let row = reach.transpose().lu().solve(&last)?;
    Some(wanted.map(|z| z.re).transpose() * row)
}

/// Sampled poles of a pair and of a rate.
fn sampled_poles(omega: f64, damping: f64, rate_per_s: f64, dt_s: f64) -> [Complex<f64>; 3] {
    let turn = (1.0 - damping * damping).max(0.0).sqrt();
    let pair = Complex::new(-damping, turn) * (omega * dt_s);
    [
        pair.exp(),
        pair.conj().exp(),
        (-rate_per_s * dt_s).exp().into(),
    ]
}

/// Gains of controller and observer of a mode that is a single axis of gain one, over `[x1, x2, sum of x1]` and
/// `[x1, x2, unknown input]`, for these damping ratios of both.
fn single_gains(
    mode: &StageMode,
    poles: &PidsmocPoles,
    [control, observe]: [f64; 2],
    dt_s: f64,
) -> Option<[DVector<f64>; 2]> {
    let omega = TAU * mode.frequency_hz;
    let single = LinearSystem::from_stage(&single(mode), &[1.0], dt_s);
    let (f, g) = (single.f.view((0, 0), (2, 2)), single.g.rows(0, 2));
    // [x1, x2, sum of x1 at the end of the period], with the drive held over it.
    let mut with_sum = DMatrix::identity(3, 3);
    with_sum.view_mut((0, 0), (2, 2)).copy_from(&f);
    with_sum.view_mut((2, 0), (1, 2)).copy_from(&f.row(0));
    let at = sampled_poles(omega, control, poles.sliding_per_s, dt_s);
    let push = DVector::from_column_slice(&[g[0], g[1], g[0]]);
    let k = placed(&with_sum, &push, &at)?;
    // [x1, x2, unknown input], corrected before the period goes on.
    let mut with_unknown = DMatrix::identity(3, 3);
    with_unknown.view_mut((0, 0), (2, 2)).copy_from(&f);
    with_unknown.view_mut((0, 2), (2, 1)).copy_from(&g);
    let at = sampled_poles(omega, observe, poles.unknown_per_s, dt_s);
    let seen = with_unknown.row(0).transpose();
    let l = placed(&with_unknown.transpose(), &seen, &at)?;
    Some([k, l])
}

/// What of a stage a PIDSMOC knows: as many modes as axes, without delays and lags.
fn nominal(stage: &ModalStage) -> ModalStage {
    let modes = largest_modes(stage, stage.sensors.len());
    ModalStage {
        drives: vec![DrivePath::default(); stage.drives.len()],
        modes: modes.into_iter().map(|r| stage.modes[r].clone()).collect(),
        sensors: vec![SensorPath::default(); stage.sensors.len()],
        feedthrough: vec![vec![0.0; stage.drives.len()]; stage.sensors.len()],
    }
}

/// Drives by axes: the identity for as many drives as axes, else an orthonormal basis of the drives that move
/// an axis at rest with the least drive.
fn spread(gain: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (axes, drives) = gain.shape();
    if axes == drives {
        return Some(DMatrix::identity(axes, axes));
    }
    let right = gain.clone().svd(false, true).v_t?;
    (axes < drives).then(|| right.rows(0, axes).transpose())
}

/// The gains at rest, sensors by drives.
#[must_use]
pub fn gain_at_rest(stage: &ModalStage) -> DMatrix<f64> {
    let rows = stage.static_gain();
    DMatrix::from_fn(rows.len(), stage.drives.len(), |i, j| rows[i][j])
}

impl MatrixServo {
    /// A PIDSMOC with these poles.
    ///
    /// Each mode is brought to a single axis of gain one, its gains are found there, and the participations
    /// bring them back.
    fn with_poles(stage: &ModalStage, dt_s: f64, poles: &PidsmocPoles) -> Option<Self> {
        let stage = nominal(stage);
        let axes = stage.sensors.len();
        let spread = spread(&gain_at_rest(&stage))?;
        let model = LinearSystem::from_stage(&stage, &vec![1.0; stage.drives.len()], dt_s);
        let by_drive =
            DMatrix::from_fn(axes, stage.drives.len(), |r, j| stage.modes[r].of_drives[j]);
        let by_sensor = DMatrix::from_fn(axes, axes, |i, r| stage.modes[r].of_sensors[i]);
        let to_drives = (by_drive * &spread).try_inverse()?;
        let from_sensors = by_sensor.clone().try_inverse()?;
        let n = 2 * axes;
        let [mut feedback, mut integrates] = [0, 1].map(|_| DMatrix::zeros(axes, n));
        let mut integral = DMatrix::zeros(axes, axes);
        let mut observer = DMatrix::zeros(n + axes, axes);
        let mut diagonals = [(); 6].map(|()| DVector::zeros(axes));
        for (r, mode) in stage.modes.iter().enumerate() {
            let omega = TAU * mode.frequency_hz;
            let [control, observe] = [poles.controller_damping, poles.observer_damping]
                .map(|damping| damping.max(mode.damping_ratio));
            let [k, l] = single_gains(mode, poles, [control, observe], dt_s)?;
            (feedback[(r, 2 * r)], feedback[(r, 2 * r + 1)]) = (k[0], k[1]);
            (integral[(r, r)], integrates[(r, 2 * r)]) = (k[2], 1.0);
            let place = [2 * r, 2 * r + 1, n + r];
            (0..3).for_each(|row| observer[(place[row], r)] = l[row]);
            let (pair, rate) = (2.0 * observe * omega, poles.unknown_per_s);
            let values = [
                poles.sliding_per_s,
                2.0 * control * omega,
                omega * omega,
                pair + rate,
                omega * omega + pair * rate,
                omega * omega * rate,
            ];
            (diagonals.iter_mut().zip(values)).for_each(|(diagonal, value)| diagonal[r] = value);
        }
        let unknown = &to_drives * observer.rows(n, axes);
        observer.rows_mut(n, axes).copy_from(&unknown);
        let matrices = diagonals.map(|d| &by_sensor * DMatrix::from_diagonal(&d) * &from_sensors);
        let [m, p, i, d_o, p_o, i_o] = matrices;
        Some(Self {
            dt_s,
            feedback: &to_drives * feedback,
            integral: &to_drives * integral,
            integrates,
            observer: observer * from_sensors,
            model,
            spread,
            gains: PidsmocGains {
                controller: [m, p, i],
                observer: [d_o, p_o, i_o],
            },
            limits: None,
        })
    }

    /// All laws that are tried.
    fn tried(stage: &ModalStage, dt_s: f64) -> Vec<Self> {
        let pairs = DAMPINGS.iter().flat_map(|c| DAMPINGS.map(|o| [*c, o]));
        let rates = || (SLIDING_HZ.iter()).flat_map(|m| UNKNOWN_HZ.map(|unknown| [*m, unknown]));
        pairs
            .flat_map(|pair| rates().map(move |rates| (pair, rates)))
            .filter_map(
                |([controller_damping, observer_damping], [sliding, unknown])| {
                    let poles = PidsmocPoles {
                        controller_damping,
                        observer_damping,
                        sliding_per_s: TAU * sliding,
                        unknown_per_s: TAU * unknown,
                    };
                    Self::with_poles(stage, dt_s, &poles)
                },
            )
            .collect()
    }

    /// The law with the least expected error, of unknown input let through and noise passed on together, among
    /// those that fulfil their conditions, are stable and keep the sensitivity on a stage.
    ///
    /// `known` is what the law knows of the stage; a stage without its couplings gives one loop an axis.
    ///
    /// # Errors
    /// A stage that has fewer drives or modes than sensors, or on which no law holds.
    pub fn design(
        known: &ModalStage,
        stage: &ModalStage,
        dt_s: f64,
        demands: &AxesDemands,
    ) -> Result<Self> {
        let axes = known.sensors.len();
        let wrong = |what: String| Err(Error::Servo(format!("pidsmoc: {what}")));
        if known.drives.len() < axes || known.modes.len() < axes {
            return wrong(format!(
                "{} drives and {} modes for {axes} sensors; expected at least as many of both",
                known.drives.len(),
                known.modes.len()
            ));
        }
        let unknown = unknown_rms(known, demands.amplitude);
        let checked = CheckedStage::new(stage, dt_s);
        let cost = |law: &Self| {
            let through = unknown * checked.lets_through(law, demands.reference_hz);
            through.hypot(demands.noise * checked.noise_gain(law))
        };
        let tried = Self::tried(known, dt_s).into_iter();
        let mut ranked: Vec<(f64, Self)> = tried.map(|law| (cost(&law), law)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let holds = |law: &Self| {
            checked.spectral_radius(law) < 1.0
                && law.gains.conditions_hold()
                && checked.keeps(law, demands.sensitivity_peak)
        };
        ranked.into_iter().find(|(_, law)| holds(law)).map_or_else(
            || wrong("no tuning is stable and keeps the sensitivity".into()),
            |(_, law)| Ok(law),
        )
    }

    /// Numbers of the law that are not zero: multiplications of a tick.
    #[must_use]
    pub fn products(&self) -> usize {
        let mut tick = vec![&self.model.f, &self.model.c, &self.feedback, &self.observer];
        let g = &self.model.g * &self.spread;
        tick.extend([&g, &self.integral, &self.integrates]);
        let significant = |matrix: &DMatrix<f64>| {
            let least = 1e-9 * matrix.amax();
            matrix.iter().filter(|x| x.abs() > least).count()
        };
        tick.into_iter().map(significant).sum()
    }
}

/// A mode as a stage of its own, of gain one.
fn single(mode: &StageMode) -> ModalStage {
    let mut stage = ModalStage::at_rest(1, 1);
    stage.modes = vec![StageMode {
        of_drives: vec![1.0],
        of_sensors: vec![1.0],
        ..StageMode::linear(mode.frequency_hz, mode.damping_ratio, 1, 1)
    }];
    stage
}

/// What is unknown of the drives that an amplitude needs, RMS.
fn unknown_rms(stage: &ModalStage, amplitude: f64) -> f64 {
    let [_, large] = gain_sets(stage);
    let share = large
        .iter()
        .fold(UNKNOWN_LEAST, |m, gain| m.max(gain - 1.0));
    let gains = gain_at_rest(stage).singular_values();
    share * amplitude / gains.min().max(f64::MIN_POSITIVE) / std::f64::consts::SQRT_2
}

impl AxesLaw for MatrixServo {
    fn period_s(&self) -> f64 {
        self.dt_s
    }

    fn states(&self) -> usize {
        self.observer.nrows() + self.integral.ncols()
    }

    fn step(&self, state: &mut [f64], acting: &[f64], readings: &[f64], aim: &Aim) -> Vec<f64> {
        let (n, axes) = (self.model.f.nrows(), self.spread.ncols());
        let mut x = DVector::from_column_slice(&state[..n + axes]);
        let innovation = DVector::from_column_slice(readings) - &self.model.c * x.rows(0, n);
        x += &self.observer * innovation;
        let unknown = &self.spread * x.rows(n, axes);
        let acting = DVector::from_column_slice(acting) + &unknown;
        let next = &self.model.f * x.rows(0, n) + &self.model.g * acting;
        let mut errors = next.clone();
        (errors.iter_mut().zip(&aim.states)).for_each(|(error, aim)| *error -= aim);
        let sums = DVector::from_column_slice(&state[n + axes..]) + &self.integrates * &errors;
        let axes_drive = &self.feedback * errors + &self.integral * &sums;
        let mut drives = -(&self.spread * axes_drive);
        (drives.iter_mut().zip(&aim.drives)).for_each(|(drive, aim)| *drive += aim);
        state[..n].copy_from_slice(next.as_slice());
        state[n..n + axes].copy_from_slice(x.rows(n, axes).as_slice());
        state[n + axes..].copy_from_slice(sums.as_slice());
        if let Some([low, high]) = self.limits {
            drives.iter_mut().for_each(|u| *u = u.clamp(low, high));
        }
        drives.as_slice().to_vec()
    }

    fn harmonic(&self, reference: &[f64], hz: f64) -> Option<Harmonic> {
        let spread = self.spread.map(Complex::from);
        let by_drive = LinearSystem {
            c: DMatrix::identity(self.model.f.nrows(), self.model.f.nrows()),
            ..self.model.clone()
        }
        .response(hz, self.dt_s)
            * &spread;
        let wanted =
            DVector::from_iterator(reference.len(), reference.iter().map(|r| Complex::from(*r)));
        let given = (self.model.c.map(Complex::from) * &by_drive)
            .lu()
            .solve(&wanted)?;
        let states = by_drive * &given;
        let drives = spread * given;
        Some((
            states.iter().copied().collect(),
            drives.iter().copied().collect(),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::super::decoupling::with_hidden_coupling;
    use super::super::loop_check::{Sine, track};
    use super::*;

    const DT_S: f64 = 1.0 / 6400.0;
    const POLES: PidsmocPoles = PidsmocPoles {
        controller_damping: 0.4,
        observer_damping: 0.7,
        sliding_per_s: 500.0,
        unknown_per_s: 1000.0,
    };
    const DEMANDS: AxesDemands = AxesDemands {
        reference_hz: 20.0,
        amplitude: 1.0,
        noise: 0.001,
        sensitivity_peak: 2.0,
    };

    /// Three axes; each drive moves the next axis too, and each sensor sees the one before.
    fn stage() -> ModalStage {
        let mut stage = ModalStage::at_rest(3, 3);
        for (axis, hz) in [150.0, 210.0, 320.0].into_iter().enumerate() {
            let mut mode = StageMode::linear(hz, 0.02, 3, 3);
            (mode.of_drives[axis], mode.of_sensors[axis]) = (1.0, 0.1);
            mode.of_drives[(axis + 1) % 3] = 0.3;
            mode.of_sensors[(axis + 2) % 3] = 0.02;
            stage.modes.push(mode);
        }
        stage
    }

    fn nearest(all: &[Complex<f64>], wanted: Complex<f64>) -> f64 {
        let distance = |z: &Complex<f64>| (z - wanted).norm();
        all.iter().map(distance).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn roots_and_eigenvalues_are_the_poles_that_were_placed() {
        let stage = stage();
        let law = MatrixServo::with_poles(&stage, DT_S, &POLES).unwrap();
        let gains = &law.gains;
        assert!(gains.conditions_hold());
        let system = LinearSystem::from_law(&law, 3, 3);
        let plant = LinearSystem::from_stage(&stage, &[1.0; 3], DT_S);
        let closed = plant.closed(&system).map(Complex::from);
        let [controller, observer] = gains.roots().unwrap();
        for mode in &stage.modes {
            let omega = TAU * mode.frequency_hz;
            let control = sampled_poles(omega, 0.4, 500.0, DT_S);
            let observe = sampled_poles(omega, 0.7, 1000.0, DT_S);
            for (poles, roots) in [(control, &controller), (observe, &observer)] {
                for pole in poles {
                    let continuous = pole.ln() / DT_S;
                    assert!(nearest(roots, continuous) < 1e-4 * continuous.norm());
                    let identity = DMatrix::identity(closed.nrows(), closed.nrows());
                    let left = (&closed - identity * pole).singular_values();
                    assert!(left.min() < 1e-9 * left.max(), "{pole}: {}", left.min());
                }
            }
        }
    }

    #[test]
    fn positive_gains_of_every_axis_do_not_suffice() {
        let law = MatrixServo::with_poles(&stage(), DT_S, &POLES).unwrap();
        let mut gains = law.gains;
        // A circulatory part: the diagonal of B2 Ic stays as it was, and positive.
        let i = &mut gains.controller[2];
        let size = i.diagonal().max();
        (i[(0, 1)], i[(1, 0)]) = (i[(0, 1)] + size, i[(1, 0)] - size);
        let diagonals = gains.controller.iter().chain(&gains.observer);
        assert!(
            diagonals
                .flat_map(|m| m.diagonal().as_slice().to_vec())
                .all(|x| x > 0.0)
        );
        assert!(!gains.conditions_hold());
    }

    #[test]
    fn matrices_leave_less_crosstalk_than_one_loop_an_axis() {
        let stage = stage();
        let mut uncoupled = stage.clone();
        for (axis, mode) in uncoupled.modes.iter_mut().enumerate() {
            (0..3).filter(|j| *j != axis).for_each(|j| {
                (mode.of_drives[j], mode.of_sensors[j]) = (0.0, 0.0);
            });
        }
        let sine = Sine {
            axis: 1,
            amplitude: 1.0,
            hz: 20.0,
            turns: 8.0,
        };
        let moved = |known: &ModalStage| {
            let law = MatrixServo::design(known, &stage, DT_S, &DEMANDS).unwrap();
            let check = CheckedStage::new(&stage, DT_S).check(&law);
            assert!(check.spectral_radius < 1.0 && check.sensitivity_peak <= 2.0);
            track(&law, &stage, &sine)
        };
        let [one_each, matrices] = [&uncoupled, &stage].map(moved);
        println!("one loop an axis {one_each:?}, matrices {matrices:?}");
        assert!(matrices.crosstalk < 0.1 * one_each.crosstalk);
        assert!(matrices.own < 0.05, "{matrices:?}");
    }

    #[test]
    fn a_fourth_drive_takes_over_at_a_limit() {
        const LIMIT: f64 = 17.0;
        let mut stage = stage();
        stage.drives.push(DrivePath::default());
        stage.feedthrough.iter_mut().for_each(|row| row.push(0.0));
        for (mode, share) in stage.modes.iter_mut().zip([0.6, -0.4, 0.3]) {
            mode.of_drives.push(share);
        }
        let mut law = MatrixServo::design(&stage, &stage, DT_S, &DEMANDS).unwrap();
        let hidden = CheckedStage::new(&with_hidden_coupling(&stage, 0.1), DT_S);
        assert!(hidden.spectral_radius(&law) < 1.0);
        let sine = Sine {
            axis: 0,
            amplitude: 3.0,
            hz: 5.0,
            turns: 4.0,
        };
        let free = track(&law, &stage, &sine);
        // The drives that need least drive together pass this limit, others do not.
        law.limits = Some([-LIMIT, LIMIT]);
        let held = track(&law, &stage, &sine);
        println!("free {free:?}, held {held:?}");
        assert!(held.own < 0.02 && held.crosstalk < 0.02, "{held:?}");
    }
}
