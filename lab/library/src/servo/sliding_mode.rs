//! The sliding-mode family in predictor form: designed for the period of delay, for any identified model.
//!
//! # How it works
//! The estimator gives position and velocity at the reading; the nominal mode, sampled exactly, carries them
//! to the instant at which the new drive begins to act. There the errors `e` are taken, with the reference of
//! that instant. The equivalent control is that of the sampled mode: `(S G)^-1 S (F - 1) e` keeps the
//! switching function `S e` where it is, with `S = [m T, 1]` over `[e1, e2 T]`. The PID of the switching
//! function (Ch. 6, Eq. 14) brings it to zero. The law works in um of force-equivalent displacement, so that
//! the hysteresis can be inverted behind it; the gains are given in the thesis' units.
//!
//! # Gains
//! They are found as poles. In continuous time the errors obey `(s + m)((1 + B2 D_c) s^2 + B2
//! P_c s + B2 I_c)` (Ch. 7, Eq. 30), and those of the PIDSMO `s^3 + (B2 D_o - A22) s^2 + B2
//! P_o s + B2 I_o` (Ch. 7, Eq. 26); [`SlidingTuning`] names the roots of both. With `m` slow
//! and the others at the mode's own place the law leaves the mode as it is and only
//! integrates; with all of them fast it is the thesis' own kind. The scan of [`super::robust`]
//! weighs noise passed on (the cut-off of `G_3`, Ch. 7, Eq. 26) against the unknown input that
//! is let through (`G_6`, Ch. 7, Eq. 34), of the sampled loop and under the margins of every
//! design.

use super::candidate::Family;
use super::feedforward::feedforward;
use super::law::{PredictorDesign, STATES};
use super::model::{LinearModel, NominalModel, SAMPLING_PERIOD_S};
use super::quantise::Unit;
use super::thesis_schemes::{
    AlphaBeta, ControllerGains, Estimator, ObserverGains, ReachingGains, SlidingModeLaw,
    estimator_rows,
};
use super::tuning::Demands;
use super::window_fit;
use nalgebra::{Complex, DMatrix, DVector};
use std::f64::consts::FRAC_1_SQRT_2;

impl SlidingModeLaw {
    /// In predictor form, for gains in the thesis' units: what closes the loop, without what the reference
    /// needs.
    #[must_use]
    pub fn predicted(
        nominal: &NominalModel,
        estimator: &Estimator,
        gains: &ControllerGains,
        reaching: &ReachingGains,
    ) -> Self {
        let (t, k) = (SAMPLING_PERIOD_S, nominal.gain_um_v);
        // In um of force-equivalent displacement the nominal gain is one.
        let unit = NominalModel {
            gain_um_v: 1.0,
            ..*nominal
        };
        let estimator_um = match estimator {
            Estimator::Pidsmo(o) => Estimator::Pidsmo(ObserverGains {
                p: k * o.p,
                i: k * o.i,
                d: k * o.d,
            }),
            filter @ Estimator::AlphaBeta(_) => *filter,
        };
        let (rows, unknown_input) = estimator_rows(&unit, &estimator_um);
        let (phi, gamma) = unit.sampled(t);
        // Over [y, y' T].
        let (f, g) = (
            [
                [phi[(0, 0)], phi[(0, 1)] / t],
                [phi[(1, 0)] * t, phi[(1, 1)]],
            ],
            [gamma[0], gamma[1] * t],
        );
        let s = [gains.m * t, 1.0];
        let held = s[0] * g[0] + s[1] * g[1];
        let equivalent = [
            (s[0] * (f[0][0] - 1.0) + s[1] * f[1][0]) / held,
            (s[0] * f[0][1] + s[1] * (f[1][1] - 1.0)) / held,
        ];
        let prediction = match estimator {
            // The integral is the unknown input with its sign turned.
            Estimator::Pidsmo(_) => [
                [f[0][0], f[0][1], -g[0], g[0]],
                [f[1][0], f[1][1], -g[1], g[1]],
            ],
            // A filter without a model goes on at the velocity that it has.
            Estimator::AlphaBeta(_) => [[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
        };
        let (pid, reaching) = match *reaching {
            ReachingGains::Pid => (
                [k * gains.p / t, k * gains.d / (t * t), k * gains.i],
                ReachingGains::Pid,
            ),
            ReachingGains::Switching { eta_v } => {
                ([0.0; 3], ReachingGains::Switching { eta_v: k * eta_v })
            }
            ReachingGains::BoundaryLayer { eta_v, delta_um_s } => (
                [0.0; 3],
                ReachingGains::BoundaryLayer {
                    eta_v: k * eta_v,
                    delta_um_s,
                },
            ),
        };
        Self {
            output: Unit::Micrometre,
            reference_drive: Vec::new(),
            reference_velocity: Vec::new(),
            prediction: Some(prediction),
            estimator: rows,
            unknown_input,
            switching_function: s,
            equivalent,
            pid,
            reaching,
        }
    }

    /// With what the reference needs one period after now: the inverse of all linear dynamics that the model
    /// has.
    #[must_use]
    pub fn following(self, linear: &LinearModel) -> Self {
        let t = SAMPLING_PERIOD_S;
        let reference_velocity =
            window_fit::fit(t, |w| Complex::from_polar(w * t, w * t) * Complex::i());
        Self {
            reference_drive: feedforward(&linear.sampled()),
            reference_velocity,
            ..self
        }
    }

    /// The law as it closes the loop, in the form of a predictor: for eigenvalues, margins and responses. Of
    /// a boundary layer the slope at its middle, its largest; none for a law that switches, or that acts at
    /// once.
    ///
    /// States: `x1`, `x2 T`, integral of the estimator; the last reading, the last `q T` and its sum; what
    /// acts from now on, and what acted before.
    #[must_use]
    pub fn as_predictor(&self) -> Option<PredictorDesign> {
        let prediction = self.prediction?;
        let [p, d, i] = match self.reaching {
            ReachingGains::Pid => self.pid,
            ReachingGains::BoundaryLayer { eta_v, delta_um_s } => {
                [eta_v / (delta_um_s * SAMPLING_PERIOD_S), 0.0, 0.0]
            }
            ReachingGains::Switching { .. } => return None,
        };
        const ACTS: usize = 6;
        let step = |z: &[f64; STATES], reading: f64, acting: f64| -> [f64; STATES] {
            let [x1, x2, integral, last_y, last_q, sum, _, acted] = *z;
            let signals = [x1, x2, integral, last_y, reading, acted];
            let [x1, x2, integral] = self
                .estimator
                .map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum::<f64>());
            let signals = [x1, x2, integral, acting];
            let e = prediction.map(|row| row.iter().zip(&signals).map(|(c, s)| c * s).sum::<f64>());
            let q = self.switching_function[0] * e[0] + self.switching_function[1] * e[1];
            // A sum that nothing takes would stand in the eigenvalues as a one.
            let sum = if i == 0.0 { 0.0 } else { sum + q };
            let drive = -(self.equivalent[0] * e[0] + self.equivalent[1] * e[1])
                - p * q
                - d * (q - last_q)
                - i * sum;
            [x1, x2, integral, reading, q, sum, drive, acting]
        };
        let mut a = DMatrix::zeros(STATES, STATES);
        for j in (0..STATES).filter(|j| *j != ACTS) {
            let mut unit = [0.0; STATES];
            unit[j] = 1.0;
            a.set_column(j, &DVector::from_row_slice(&step(&unit, 0.0, 0.0)));
        }
        let zero = [0.0; STATES];
        let mut k = DVector::zeros(STATES);
        k[ACTS] = -1.0;
        Some(PredictorDesign {
            a,
            b: DVector::from_row_slice(&step(&zero, 0.0, 1.0)),
            c: DVector::zeros(STATES),
            l: DVector::from_row_slice(&step(&zero, 1.0, 0.0)),
            k,
            feedforward: Vec::new(),
            period_s: SAMPLING_PERIOD_S,
        })
    }
}

/// Which law of the family.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlidingKind {
    /// PIDSMC on the PIDSMO.
    Pidsmoc,
    /// PIDSMC on the continuous alpha-beta filter.
    PidsmcAlphaBeta,
    /// Sliding mode with a boundary layer on the alpha-beta filter.
    BoundaryLayer,
}

/// What a law of the family is tuned by: the places of its poles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlidingTuning {
    /// `m`, 1/s.
    pub m: f64,
    /// Frequency, rad/s, and damping ratio of the roots that the PID of the switching function has; of a
    /// boundary layer `B2 eta / delta`, 1/s, alone.
    pub reaching: (f64, f64),
    /// Frequency, rad/s, and damping ratio of the estimator.
    pub estimator: (f64, f64),
    /// Rate at which the PIDSMO's integral follows the unknown input, 1/s; a filter has none.
    pub unknown_rate: f64,
}

/// A law of the family for one model.
#[derive(Clone, Copy, Debug)]
pub struct SlidingFamily {
    /// Which.
    pub kind: SlidingKind,
    /// Mode and gain.
    pub nominal: NominalModel,
    /// Bound of the unknown input, V: what a boundary layer has to stand against (Ch. 6, Eq. 13).
    pub unknown_bound_v: f64,
}

impl SlidingFamily {
    /// The gains of a tuning, in the thesis' units.
    #[must_use]
    pub fn gains(&self, tuning: &SlidingTuning) -> (Estimator, ControllerGains, ReachingGains) {
        let b2 = self.nominal.b2();
        let (w, xi) = tuning.estimator;
        let estimator = match self.kind {
            SlidingKind::Pidsmoc => {
                let rate = tuning.unknown_rate;
                // The mode's own damping is there without `D_o`.
                let d = ((rate + 2.0 * xi * w + self.nominal.a22()) / b2).max(0.0);
                Estimator::Pidsmo(ObserverGains {
                    p: (w * w + 2.0 * xi * w * rate) / b2,
                    i: w * w * rate / b2,
                    d,
                })
            }
            SlidingKind::PidsmcAlphaBeta | SlidingKind::BoundaryLayer => {
                Estimator::AlphaBeta(AlphaBeta {
                    damping_ratio: xi,
                    natural_frequency_rad_s: w,
                    discrete: false,
                })
            }
        };
        let (w, xi) = tuning.reaching;
        match self.kind {
            SlidingKind::BoundaryLayer => {
                let eta_v = self.unknown_bound_v;
                let reaching = ReachingGains::BoundaryLayer {
                    eta_v,
                    delta_um_s: eta_v * b2 / w,
                };
                (
                    estimator,
                    ControllerGains {
                        m: tuning.m,
                        p: 0.0,
                        i: 0.0,
                        d: 0.0,
                    },
                    reaching,
                )
            }
            _ => (
                estimator,
                ControllerGains {
                    m: tuning.m,
                    p: 2.0 * xi * w / b2,
                    i: w * w / b2,
                    d: 0.0,
                },
                ReachingGains::Pid,
            ),
        }
    }

    fn sliding(&self, tuning: &SlidingTuning) -> SlidingModeLaw {
        let (estimator, controller, reaching) = self.gains(tuning);
        SlidingModeLaw::predicted(&self.nominal, &estimator, &controller, &reaching)
    }
}

/// Shares of a boundary layer's slope that are judged beside it: what is left of it where the switching
/// function is outside.
const LAYER_SHARES: [f64; 3] = [0.3, 0.1, 0.03];

impl Family for SlidingFamily {
    type Tuning = SlidingTuning;

    fn law(&self, tuning: &SlidingTuning) -> Option<PredictorDesign> {
        self.sliding(tuning).as_predictor()
    }

    fn beside(&self, tuning: &SlidingTuning) -> Vec<PredictorDesign> {
        if self.kind != SlidingKind::BoundaryLayer {
            return Vec::new();
        }
        let (w, xi) = tuning.reaching;
        let shares = LAYER_SHARES.iter().map(|share| SlidingTuning {
            reaching: (share * w, xi),
            ..*tuning
        });
        shares.filter_map(|tuning| self.law(&tuning)).collect()
    }

    fn fits(&self, tuning: &SlidingTuning, _law: &PredictorDesign) -> bool {
        self.sliding(tuning).quantised().is_ok()
    }

    fn grid(&self, _demands: &Demands) -> Vec<SlidingTuning> {
        let (wn, xi) = (
            self.nominal.natural_frequency_rad_s,
            self.nominal.damping_ratio,
        );
        let mut out = Vec::new();
        let damping = |ratio: f64| ratio.max(xi);
        let estimators: Vec<((f64, f64), f64)> = match self.kind {
            SlidingKind::Pidsmoc => [0.01, 0.03, 0.1, 0.3, 1.0]
                .into_iter()
                .flat_map(|rate| {
                    [(1.0, 0.0), (1.0, 0.2), (1.3, 0.7), (2.0, 1.0)]
                        .map(|(w, xi)| ((w * wn, damping(xi)), rate * wn))
                })
                .collect(),
            _ => [0.1, 0.3, 0.7, 1.5, 3.0]
                .into_iter()
                .map(|w| ((w * wn, FRAC_1_SQRT_2), 0.0))
                .collect(),
        };
        let reachings: &[(f64, f64)] = match self.kind {
            SlidingKind::BoundaryLayer => &[
                (0.003, 1.0),
                (0.01, 1.0),
                (0.03, 1.0),
                (0.1, 1.0),
                (0.3, 1.0),
                (1.0, 1.0),
            ],
            _ => &[
                (0.03, 1.0),
                (0.1, 1.0),
                (0.1, 3.0),
                (0.3, 0.7),
                (0.3, 2.0),
                (1.0, 0.0),
                (1.0, 0.2),
                (1.0, 0.7),
                (1.5, 0.7),
            ],
        };
        for m in [0.003, 0.01, 0.03, 0.1, 0.3, 1.0] {
            for (w, ratio) in reachings {
                for (estimator, unknown_rate) in &estimators {
                    out.push(SlidingTuning {
                        m: m * wn,
                        reaching: (
                            w * wn,
                            if *ratio < 1.0 {
                                damping(*ratio)
                            } else {
                                *ratio
                            },
                        ),
                        estimator: *estimator,
                        unknown_rate: *unknown_rate,
                    });
                }
            }
        }
        out
    }

    fn numbers(&self) -> usize {
        if self.kind == SlidingKind::Pidsmoc {
            6
        } else {
            5
        }
    }

    fn stepped(&self, tuning: &SlidingTuning, number: usize, by: f64) -> SlidingTuning {
        let mut out = *tuning;
        match number {
            0 => out.m *= by,
            1 => out.reaching.0 *= by,
            2 => out.reaching.1 *= by,
            3 => out.estimator.0 *= by,
            4 => out.estimator.1 *= by,
            _ => out.unknown_rate *= by,
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::candidate::Scan;
    use super::super::model::ModeModel;
    use super::super::plant_set::PlantVariation;
    use super::super::robust::{ModeSpread, Task};
    use super::super::sampled_loop::SampledLoop;
    use super::*;
    use hysteron_core::reference_window::ReferenceWindow;
    use hysteron_core::sensor_lag::SensorLag;
    use hysteron_core::servo_parameters::LawParameters;
    use hysteron_core::sliding_mode_controller::SlidingModeController;
    use hysteron_core::state_estimator::StateEstimator;
    use std::f64::consts::TAU;

    fn linear(hz: f64, damping_ratio: f64) -> LinearModel {
        LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: TAU * hz,
                damping_ratio,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: 5e-5,
        }
    }

    fn family(kind: SlidingKind, linear: &LinearModel) -> SlidingFamily {
        let mode = linear.first_mode;
        let nominal = NominalModel {
            natural_frequency_rad_s: mode.natural_frequency_rad_s,
            damping_ratio: mode.damping_ratio,
            gain_um_v: 0.13,
        };
        SlidingFamily {
            kind,
            nominal,
            unknown_bound_v: 2.0,
        }
    }

    const TUNING: SlidingTuning = SlidingTuning {
        m: 900.0,
        reaching: (1500.0, 0.9),
        estimator: (6000.0, 0.9),
        unknown_rate: 500.0,
    };

    /// Where the plant is the nominal one the poles of the controller and of the observer do not touch each
    /// other, although a period of delay lies between reading and drive: what the prediction is for.
    #[test]
    fn the_prediction_takes_the_delay_out_of_the_controller() {
        let linear = linear(850.0, 0.5);
        let plant = linear.sampled();
        let sliding = family(SlidingKind::Pidsmoc, &linear).sliding(&TUNING);
        let law = sliding.as_predictor().unwrap();
        assert!(SampledLoop::new(&law, &plant).is_stable());
        // The controller alone, on states that are known: e+ = F e + G u with its own sum and difference.
        let (phi, gamma) = NominalModel {
            gain_um_v: 1.0,
            ..family(SlidingKind::Pidsmoc, &linear).nominal
        }
        .sampled(SAMPLING_PERIOD_S);
        let t = SAMPLING_PERIOD_S;
        let (f, g) = (
            [
                [phi[(0, 0)], phi[(0, 1)] / t],
                [phi[(1, 0)] * t, phi[(1, 1)]],
            ],
            [gamma[0], gamma[1] * t],
        );
        let step = |s: &[f64; 4]| {
            let [e1, e2, last_q, sum] = *s;
            let q = sliding.switching_function[0] * e1 + sliding.switching_function[1] * e2;
            let sum = sum + q;
            let [p, d, i] = sliding.pid;
            let u = -(sliding.equivalent[0] * e1 + sliding.equivalent[1] * e2)
                - p * q
                - d * (q - last_q)
                - i * sum;
            [
                f[0][0] * e1 + f[0][1] * e2 + g[0] * u,
                f[1][0] * e1 + f[1][1] * e2 + g[1] * u,
                q,
                sum,
            ]
        };
        let mut alone = DMatrix::zeros(4, 4);
        for j in 0..4 {
            let mut unit = [0.0; 4];
            unit[j] = 1.0;
            alone.set_column(j, &DVector::from_row_slice(&step(&unit)));
        }
        let whole = SampledLoop::new(&law, &plant)
            .matrix()
            .complex_eigenvalues();
        for pole in alone
            .complex_eigenvalues()
            .iter()
            .filter(|z| z.norm() > 1e-6)
        {
            let nearest = whole
                .iter()
                .map(|z| (z - pole).norm())
                .fold(f64::INFINITY, f64::min);
            // The reading is taken to run straight between samples, which it does not quite.
            assert!(
                nearest < 2e-3,
                "{pole} is {nearest} from the next pole of {whole}"
            );
        }
    }

    /// The integers of the tick are the law whose eigenvalues are taken.
    #[test]
    fn the_integers_are_the_law_that_is_judged() {
        for kind in [SlidingKind::Pidsmoc, SlidingKind::PidsmcAlphaBeta] {
            let linear = linear(850.0, 0.5);
            let sliding = family(kind, &linear).sliding(&TUNING);
            let law = sliding.as_predictor().unwrap();
            let LawParameters::SlidingMode {
                estimator,
                controller,
            } = sliding.following(&linear).quantised().unwrap()
            else {
                panic!("another law")
            };
            let fixed = |um: f64| (um * f64::from(1 << 24)).round() as i32;
            let (mut states, mut integer, mut saturated) = (
                StateEstimator::at_rest(0, 0),
                SlidingModeController::default(),
                0,
            );
            let mut window = ReferenceWindow::at_rest(0);
            let (mut z, mut acting, mut acted, mut largest) =
                (DVector::<f64>::zeros(STATES), 0.0, 0.0, 0.0f64);
            for tick in 0..3000 {
                let reading =
                    0.4 * (f64::from(tick) * 0.02).sin() + 0.1 * (f64::from(tick) * 0.31).cos();
                window.push(&SensorLag::NONE, 0, 0);
                states.update(&estimator, fixed(reading), fixed(acted), &mut saturated);
                let drive = integer.drive(
                    &controller,
                    &states,
                    fixed(acting),
                    &window,
                    0,
                    &mut saturated,
                );
                // The law in f64, fed with the same drive.
                z = &law.a * &z + &law.b * acting + &law.l * reading;
                let expected = -law.k.dot(&z);
                largest = largest.max((f64::from(drive) / f64::from(1 << 24) - expected).abs());
                (acted, acting) = (acting, expected);
            }
            assert!(largest < 2e-4 && largest > 0.0, "{kind:?}: {largest} um");
            assert_eq!(saturated, 0);
        }
    }

    fn scanned(kind: SlidingKind, linear: &LinearModel) -> Scan<SlidingTuning> {
        let spread = ModeSpread {
            frequency: 0.02,
            damping: 0.2,
        };
        let demands = Demands::default();
        let task = Task {
            linear: *linear,
            first: spread,
            second: None,
            left_out: None,
            delay_s: 0.0,
            recording: None,
            mode_moves: 0.0,
            mass_to: 2.0,
            demands,
        };
        task.scan_of(&family(kind, linear))
    }

    /// From a stage as stiff and damped as the thesis' to one with a mode at 302 Hz that hardly is.
    #[test]
    #[cfg_attr(debug_assertions, ignore = "slow: release mode")]
    fn a_pidsmoc_is_found_for_every_kind_of_mode_and_keeps_its_margins() {
        for (hz, damping_ratio) in [
            (852.0, 0.7876),
            (850.0, 0.02),
            (302.0, 0.015),
            (302.0, 0.5),
            (1500.0, 0.05),
        ] {
            let linear = linear(hz, damping_ratio);
            let scan = scanned(SlidingKind::Pidsmoc, &linear);
            let best = scan.best().unwrap_or_else(|| {
                panic!(
                    "{hz} Hz {damping_ratio}: {:?}",
                    scan.candidates
                        .iter()
                        .filter_map(|c| c.broken)
                        .collect::<Vec<_>>()
                )
            });
            println!(
                "{hz} Hz, {damping_ratio}: {:.2} nm, {:?}",
                1e3 * best.expected_um(),
                best.tuning
            );
            let law = family(SlidingKind::Pidsmoc, &linear)
                .law(&best.tuning)
                .unwrap();
            for variation in [
                PlantVariation::NONE,
                PlantVariation::with_gain(0.5),
                PlantVariation::with_gain(1.5),
                PlantVariation::with_delay_s(SAMPLING_PERIOD_S),
            ] {
                let plant = variation.sampled(&linear);
                assert!(
                    SampledLoop::new(&law, &plant).is_stable(),
                    "{hz} Hz {damping_ratio}: {variation:?}"
                );
            }
        }
    }
}
