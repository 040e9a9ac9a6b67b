//! The schemes of the thesis and those they are compared with: from printed gains to the rows of the tick.
//!
//! Estimators are discretised exactly, with the drive held and the reading running straight between samples.
//! The controllers are algebra in the estimates; their integral is a sum and their derivative a difference,
//! as in the tick. [`SlidingModeLaw`] is the law in f64: what is quantised and what the sampled eigenvalues
//! are taken of. [`SlidingModeLaw::new`] gives the printed form, which acts at once; [`super::sliding_mode`]
//! the one that is designed for the period of delay.

use super::creep::{CreepPair, CreepTerm};
use super::model::{NominalModel, SAMPLING_PERIOD_S};
use super::quantise::{QuantisationError, Unit, creep_inverse, number, row, row_um};
use super::window_fit;
use hysteron_core::integer_row::Row;
use hysteron_core::pid_regulator::PidParameters;
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::sliding_mode_controller::{Prediction, Reaching, SlidingModeParameters};
use hysteron_core::state_estimator::EstimatorParameters;
use nalgebra::{Complex, DMatrix};
use serde::{Deserialize, Serialize};

/// Gains of the PIDSMO (thesis Ch. 7, Eq. 14).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObserverGains {
    /// `P_o`, V/um.
    pub p: f64,
    /// `I_o`, V/(um s).
    pub i: f64,
    /// `D_o`, V s/um.
    pub d: f64,
}

impl ObserverGains {
    /// For the observer's sliding behaviour (Ch. 7, Fig. 7).
    pub const THESIS_SLIDING: Self = Self {
        p: 7.0,
        i: 3000.0,
        d: 1e-6,
    };
    /// For state estimation (Ch. 7, Figs. 8-9).
    pub const THESIS_ESTIMATION: Self = Self {
        p: 10.0,
        i: 20_000.0,
        d: 6e-6,
    };
    /// In the PIDSMOC (Ch. 7, V.B).
    pub const THESIS_PIDSMOC: Self = Self {
        p: 12.0,
        i: 50_000.0,
        d: 1e-4,
    };
}

/// Gains of the PIDSMC (thesis Ch. 6, Eq. 14; Ch. 7, Eq. 27).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllerGains {
    /// `m_c`, 1/s.
    pub m: f64,
    /// `P_c`, V s/um.
    pub p: f64,
    /// `I_c`, V/um.
    pub i: f64,
    /// `D_c`, V s^2/um.
    pub d: f64,
}

impl ControllerGains {
    /// For the controller's sliding behaviour (Ch. 6, 4.2.1).
    pub const THESIS_SLIDING: Self = Self {
        m: 2200.0,
        p: 0.004,
        i: 0.06,
        d: 1e-8,
    };
    /// For tracking with the alpha-beta filter (Ch. 6, 4.2.2).
    pub const THESIS_CHAPTER_6: Self = Self {
        m: 22_000.0,
        p: 0.0004,
        i: 1.0,
        d: 1e-8,
    };
    /// With the alpha-beta filter in Ch. 7, V.C.
    pub const THESIS_CHAPTER_7: Self = Self {
        m: 22_000.0,
        p: 0.0004,
        i: 2.0,
        d: 1e-8,
    };
    /// In the PIDSMOC (Ch. 7, V.B).
    pub const THESIS_PIDSMOC: Self = Self {
        m: 22_000.0,
        p: 0.005,
        i: 1.0,
        d: 1e-8,
    };
}

/// The alpha-beta filter by its damping ratio and natural frequency (thesis Ch. 6, Eqs. 35-38).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlphaBeta {
    /// `xi_f`.
    pub damping_ratio: f64,
    /// `w_fn`, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Eqs. (33)-(34) as they stand instead of the continuous form.
    #[serde(default)]
    pub discrete: bool,
}

impl AlphaBeta {
    /// Chapter 6: `1/sqrt 2`, `1000 pi`.
    pub const THESIS_CHAPTER_6: Self = Self {
        damping_ratio: std::f64::consts::FRAC_1_SQRT_2,
        natural_frequency_rad_s: 1000.0 * std::f64::consts::PI,
        discrete: false,
    };
    /// Chapter 7: `1/sqrt 2`, `1200 pi`.
    pub const THESIS_CHAPTER_7: Self = Self {
        damping_ratio: std::f64::consts::FRAC_1_SQRT_2,
        natural_frequency_rad_s: 1200.0 * std::f64::consts::PI,
        discrete: false,
    };
}

/// Which estimator stands before the controller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Estimator {
    /// PID-based sliding-mode observer.
    Pidsmo(ObserverGains),
    /// Alpha-beta filter.
    AlphaBeta(AlphaBeta),
}

/// How the sliding surface is reached.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum ReachingGains {
    /// PID: `P_c`, `I_c`, `D_c` are in the controller's gains.
    Pid,
    /// `eta sign q`.
    Switching {
        /// `eta`, V.
        eta_v: f64,
    },
    /// `eta q / (|q| + delta)`.
    BoundaryLayer {
        /// `eta`, V.
        eta_v: f64,
        /// `delta`, um/s.
        delta_um_s: f64,
    },
}

/// A sliding-mode law in f64, over `[x1, x2 T, integral, y[k-1], y[k], u]`. What it calls a drive is V in the
/// printed form and um of force-equivalent displacement in the other one.
#[derive(Clone, Debug)]
pub struct SlidingModeLaw {
    /// Unit of its output.
    pub output: Unit,
    /// What the reference needs, over the reference window.
    pub reference_drive: Vec<f64>,
    /// Velocity of the reference times the period over the reference window.
    pub reference_velocity: Vec<f64>,
    /// Carries `[x1, x2 T]` over the period of delay, over `[x1, x2 T, integral, what acts in it]`; none in
    /// the printed form.
    pub prediction: Option<[[f64; 4]; 2]>,
    /// New states of the estimator.
    pub estimator: [[f64; 6]; 3],
    /// Unknown input, V.
    pub unknown_input: [f64; 6],
    /// `q T` over `[e1, e2 T]`.
    pub switching_function: [f64; 2],
    /// Equivalent control over `[e1, e2 T]`, V.
    pub equivalent: [f64; 2],
    /// PID over `[q T, change of q T, sum of q T]`, V.
    pub pid: [f64; 3],
    /// How the surface is reached.
    pub reaching: ReachingGains,
}

/// Exact discretisation over `[x1, x2, integral]` of `x' = a x + b_u u + b_y y + b_slope y'`, with the
/// velocity then times the period.
fn discretised(a: [[f64; 3]; 3], b_u: [f64; 3], b_y: [f64; 3], b_slope: [f64; 3]) -> [[f64; 6]; 3] {
    let t = SAMPLING_PERIOD_S;
    let mut m = DMatrix::zeros(6, 6);
    for i in 0..3 {
        for j in 0..3 {
            m[(i, j)] = a[i][j] * t;
        }
        m[(i, 3)] = b_u[i] * t;
        m[(i, 4)] = b_y[i] * t;
        m[(i, 5)] = b_slope[i] * t;
    }
    m[(4, 5)] = t;
    let e = m.exp();
    let mut out = [[0.0; 6]; 3];
    for i in 0..3 {
        let scale = if i == 1 { t } else { 1.0 };
        out[i] = [
            e[(i, 0)] * scale,
            e[(i, 1)] * scale / t,
            e[(i, 2)] * scale,
            (e[(i, 4)] - e[(i, 5)] / t) * scale,
            e[(i, 5)] / t * scale,
            e[(i, 3)] * scale,
        ];
    }
    out
}

/// The rows of an estimator for a nominal model.
#[must_use]
pub fn estimator_rows(nominal: &NominalModel, estimator: &Estimator) -> ([[f64; 6]; 3], [f64; 6]) {
    let t = SAMPLING_PERIOD_S;
    match estimator {
        Estimator::Pidsmo(g) => {
            let (a21, a22, b2) = (nominal.a21(), nominal.a22(), nominal.b2());
            // Eq. (2) with r of Eq. (14): x2' = -B2 P x1 + (A22 - B2 D) x2 - B2 J + B2 u + (A21 + B2 P) y +
            // B2 D y'.
            let rows = discretised(
                [
                    [0.0, 1.0, 0.0],
                    [-b2 * g.p, a22 - b2 * g.d, -b2],
                    [g.i, 0.0, 0.0],
                ],
                [0.0, b2, 0.0],
                [0.0, a21 + b2 * g.p, -g.i],
                [0.0, b2 * g.d, 0.0],
            );
            // Eq. (15).
            let p = a21 / b2 + g.p;
            (rows, [-p, -g.d / t, -1.0, -g.d / t, p + g.d / t, 0.0])
        }
        Estimator::AlphaBeta(f) => {
            let (xi, w) = (f.damping_ratio, f.natural_frequency_rad_s);
            if f.discrete {
                // Eqs. (33)-(34) with (37)-(38) as printed: the residual is that of the updated position, so
                // both equations are solved for it.
                let (alpha, beta) = (w * t * (2.0 * xi - w * t / 2.0), (w * t).powi(2));
                let (kept, of_residual) = (1.0 / (1.0 + alpha), beta / (1.0 + alpha));
                let position = [kept, kept, 0.0, 0.0, alpha * kept, 0.0];
                let velocity = [-of_residual, 1.0 - of_residual, 0.0, 0.0, of_residual, 0.0];
                let rows = [position, velocity, [0.0; 6]];
                return (rows, [0.0; 6]);
            }
            // x2 = p', x1 = p + kappa x2 with p = w^2 / (s^2 + 2 xi w s + w^2) y, kappa = (2 xi - w T) / w.
            let kappa = (2.0 * xi - w * t) / w;
            let acceleration = [-w * w, w * w * kappa - 2.0 * xi * w, 0.0];
            let [position, velocity, _] = discretised(
                [
                    [kappa * acceleration[0], 1.0 + kappa * acceleration[1], 0.0],
                    acceleration,
                    [0.0; 3],
                ],
                [0.0; 3],
                [kappa * w * w, w * w, 0.0],
                [0.0; 3],
            );
            // A filter has no integral: left as it is, that state would stand in the sampled eigenvalues as a
            // one.
            ([position, velocity, [0.0; 6]], [0.0; 6])
        }
    }
}

impl SlidingModeLaw {
    /// From the gains of the thesis.
    #[must_use]
    pub fn new(
        nominal: &NominalModel,
        estimator: &Estimator,
        gains: &ControllerGains,
        reaching: &ReachingGains,
    ) -> Self {
        let t = SAMPLING_PERIOD_S;
        let (rows, unknown_input) = estimator_rows(nominal, estimator);
        let pid = match reaching {
            ReachingGains::Pid => [gains.p / t, gains.d / (t * t), gains.i],
            _ => [0.0; 3],
        };
        let n = nominal;
        Self {
            output: Unit::Volt,
            // Ch. 6, Eq. 6.
            reference_drive: window_fit::fit(t, |w| {
                Complex::new(-w * w - n.a21(), -n.a22() * w) / n.b2()
            }),
            reference_velocity: window_fit::fit(t, |w| Complex::new(0.0, w * t)),
            prediction: None,
            estimator: rows,
            unknown_input,
            switching_function: [gains.m * t, 1.0],
            equivalent: [
                nominal.a21() / nominal.b2(),
                (gains.m + nominal.a22()) / (nominal.b2() * t),
            ],
            pid,
            reaching: *reaching,
        }
    }

    /// Rows of the tick.
    ///
    /// # Errors
    /// If a coefficient does not fit.
    pub fn quantised(&self) -> Result<LawParameters, QuantisationError> {
        let t = SAMPLING_PERIOD_S;
        let output = self.output;
        let bits = output.fraction_bits();
        let inputs = |i: usize| {
            if i == 2 || i == 5 {
                output
            } else {
                Unit::Micrometre
            }
        };
        let reaching = match self.reaching {
            ReachingGains::Pid => Reaching::Pid {
                proportional_derivative: row(
                    "P_c, D_c",
                    &self.pid[..2],
                    |_| Unit::Micrometre,
                    output,
                )?,
                integral: number(
                    "I_c",
                    self.pid[2],
                    26 + bits - Unit::Micrometre.fraction_bits(),
                )?,
            },
            ReachingGains::Switching { eta_v } => Reaching::Switching {
                magnitude: number("eta", eta_v, bits)?,
            },
            ReachingGains::BoundaryLayer { eta_v, delta_um_s } => Reaching::BoundaryLayer {
                magnitude: number("eta", eta_v, bits)?,
                thickness: number("delta", delta_um_s * t, 24)?,
            },
        };
        let carried = |i: usize| if i >= 2 { output } else { Unit::Micrometre };
        let prediction = match &self.prediction {
            None => None,
            Some([position, velocity]) => Some(Prediction {
                rows: [
                    row("predicted x1", position, carried, Unit::Micrometre)?,
                    row("predicted x2", velocity, carried, Unit::Micrometre)?,
                ],
            }),
        };
        let rows = [
            row("estimator x1", &self.estimator[0], inputs, Unit::Micrometre)?,
            row("estimator x2", &self.estimator[1], inputs, Unit::Micrometre)?,
            row("estimator integral", &self.estimator[2], inputs, output)?,
        ];
        Ok(LawParameters::SlidingMode {
            estimator: EstimatorParameters {
                rows,
                unknown_input: row("unknown input", &self.unknown_input, inputs, output)?,
            },
            controller: SlidingModeParameters {
                reference_velocity: row_um("reference velocity", &self.reference_velocity)?,
                reference_drive: row(
                    "reference drive",
                    &self.reference_drive,
                    |_| Unit::Micrometre,
                    output,
                )?,
                switching_function: row_um("switching function", &self.switching_function)?,
                equivalent_control: row(
                    "equivalent control",
                    &self.equivalent,
                    |_| Unit::Micrometre,
                    output,
                )?,
                reaching,
                prediction,
            },
        })
    }

    /// Transition matrix of the sampled closed loop with the nominal model as plant; `delay` periods (0 or 1)
    /// between reading and drive.
    ///
    /// States: plant `[y, y']`, estimator `[x1, x2 T, integral]`, last reading, last `q T`, sum of `q T`,
    /// drive that acts, drive before. Only for a PID that reaches the surface: the others are not linear.
    #[must_use]
    pub fn closed_loop(&self, plant: &NominalModel, delay: usize) -> DMatrix<f64> {
        let (a, b) = plant.sampled(SAMPLING_PERIOD_S);
        let step = |s: &[f64; 9]| -> [f64; 9] {
            // s: y, y', x1, x2T, J, last y, last qT, sum qT, drive computed at the last tick and not yet
            // acting / acting until now
            let [y, v, x1, x2, j, last_y, last_q, sum_q, last_u] = *s;
            // With delay: last_u acts from now on. What acted until now is in the plant's and estimator's
            // state already: the estimator is advanced at the end of the interval, with the reading that the
            // plant then has.
            let e = [x1, x2];
            let q = self.switching_function[0] * e[0] + self.switching_function[1] * e[1];
            let sum = sum_q + q;
            let u = -(self.equivalent[0] * e[0] + self.equivalent[1] * e[1])
                - (self.pid[0] * q + self.pid[1] * (q - last_q))
                - self.pid[2] * sum;
            let acting = if delay == 0 { u } else { last_u };
            let next_y = a[(0, 0)] * y + a[(0, 1)] * v + b[0] * acting;
            let next_v = a[(1, 0)] * y + a[(1, 1)] * v + b[1] * acting;
            let signals = [x1, x2, j, y, next_y, acting];
            let row = |r: &[f64; 6]| -> f64 { r.iter().zip(&signals).map(|(c, x)| c * x).sum() };
            let _ = last_y;
            [
                next_y,
                next_v,
                row(&self.estimator[0]),
                row(&self.estimator[1]),
                row(&self.estimator[2]),
                y,
                q,
                sum,
                u,
            ]
        };
        let n = 9;
        let mut m = DMatrix::zeros(n, n);
        for j in 0..n {
            let mut unit = [0.0; 9];
            unit[j] = 1.0;
            for (i, value) in step(&unit).into_iter().enumerate() {
                m[(i, j)] = value;
            }
        }
        m
    }
}

/// Gains of PID on the tracking error (thesis Ch. 6, 4.3): V/um, V/(um s), V s/um.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PidGains {
    /// `P`, V/um.
    pub p: f64,
    /// `I`, V/(um s).
    pub i: f64,
    /// `D`, V s/um.
    pub d: f64,
}

/// Feedforward of a regulator.
#[derive(Clone, Copy, Debug, Default)]
pub struct Feedforward<'a> {
    /// Coefficients over the reference window; empty for none.
    pub window: &'a [f64],
    /// Creep that it undoes.
    pub creep: &'a [CreepTerm],
    /// Its second-order term.
    pub creep_pair: Option<&'a CreepPair>,
}

/// PID, or PI with feedforward. `output` is what stands behind: volts, or um of force-equivalent
/// displacement, in which the gains then are.
///
/// # Errors
/// If a coefficient does not fit, or creep has no stable inverse.
pub fn regulator(
    gains: &PidGains,
    feedforward: &Feedforward<'_>,
    notch: Option<&Notch>,
    output: Unit,
) -> Result<LawParameters, QuantisationError> {
    let t = SAMPLING_PERIOD_S;
    let unit_bits = if output == Unit::Volt { -2 } else { 0 };
    let biquad = notch.map_or([1.0, 0.0, 0.0, 0.0, 0.0], Notch::coefficients);
    Ok(LawParameters::Regulator(PidParameters {
        proportional_derivative: row(
            "P, D",
            &[gains.p, gains.d / t],
            |_| Unit::Micrometre,
            output,
        )?,
        integral: number("I", gains.i * t, 26 + unit_bits)?,
        feedforward: row(
            "feedforward",
            feedforward.window,
            |_| Unit::Micrometre,
            output,
        )?,
        creep: creep_inverse(feedforward.creep, feedforward.creep_pair, t)?,
        notch: {
            let mut quantised = Row::default();
            for (i, value) in biquad.iter().enumerate() {
                quantised.coefficients[i] = number("notch", *value, 28)?;
            }
            quantised
        },
    }))
}

/// A notch in front of the actuator: zeros at the mode, poles of the given damping at the same frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Notch {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio of the zeros.
    pub zero_damping_ratio: f64,
    /// Damping ratio of the poles.
    pub pole_damping_ratio: f64,
}

impl Notch {
    /// Frequency response at `omega`: what stands behind a feedforward has to be undone by it.
    #[must_use]
    pub fn response(&self, omega_rad_s: f64) -> Complex<f64> {
        let [n0, n1, n2, d1, d2] = self.coefficients();
        let back = Complex::from_polar(1.0, -omega_rad_s * SAMPLING_PERIOD_S);
        (back * (back * n2 + n1) + n0) / (-back * (back * d2 + d1) + 1.0)
    }

    /// Biquad over `[x[k], x[k-1], x[k-2], y[k-1], y[k-2]]`: zeros and poles mapped by `z = exp(s T)`, unit
    /// static gain.
    #[must_use]
    pub fn coefficients(&self) -> [f64; 5] {
        let w = std::f64::consts::TAU * self.frequency_hz;
        let polynomial = |xi: f64| {
            let radius = (-xi * w * SAMPLING_PERIOD_S).exp();
            let angle = w * (1.0 - xi * xi).max(0.0).sqrt() * SAMPLING_PERIOD_S;
            [-2.0 * radius * angle.cos(), radius * radius]
        };
        let (zeros, poles) = (
            polynomial(self.zero_damping_ratio),
            polynomial(self.pole_damping_ratio),
        );
        let gain = (1.0 + poles[0] + poles[1]) / (1.0 + zeros[0] + zeros[1]);
        [gain, gain * zeros[0], gain * zeros[1], -poles[0], -poles[1]]
    }
}
