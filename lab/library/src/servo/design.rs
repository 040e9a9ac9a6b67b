//! A servo design as it is written to `servo.toml`: the model it was made from, the scheme with its gains,
//! and why.

use super::assessment::Assessment;
use super::disturbance_observer::{self, DisturbanceObserverGains};
use super::gain_adaptation::AdaptationDesign;
use super::law::PredictorDesign;
use super::learned_feedforward::LearningDesign;
use super::model::{ActuatorModel, NominalModel};
use super::plant_set::HELD_MASSES;
use super::predictor::tune;
use super::quantise::{self, QuantisationError, Unit};
use super::regulator_loop;
use super::robust::ModeSpread;
use super::sampled_loop::frequency_response;
use super::sensor_lag;
use super::thesis_schemes::{
    AlphaBeta, ControllerGains, Estimator, Feedforward, Notch, ObserverGains, PidGains,
    ReachingGains, SlidingModeLaw, regulator,
};
use super::tuning::{Demands, PredictorTuning};
use super::window_fit;
use crate::error::{self, Error};
use crate::toml_file::with_schema;
use hysteron_core::sensor_lag::SensorLag;
use hysteron_core::servo_parameters::{
    ActuatorParameters, ConverterParameters, LawParameters, ServoParameters,
};
use nalgebra::Complex;
use serde::{Deserialize, Serialize};

/// A control scheme with its gains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Scheme {
    /// Observer-controller for the one-period delay, hysteresis inverted inside the loop.
    Predictor {
        /// What it is tuned by.
        tuning: PredictorTuning,
        /// False: the actuator is taken to be linear, and all its hysteresis is left to the unknown input.
        #[serde(default = "yes")]
        hysteresis_inverse: bool,
    },
    /// A sliding-mode scheme.
    SlidingMode {
        /// Nominal model.
        nominal: NominalModel,
        /// Estimator.
        estimator: Estimator,
        /// Controller.
        controller: ControllerGains,
        /// How the surface is reached.
        reaching: ReachingGains,
        /// As printed, or designed for the period of delay.
        #[serde(default)]
        form: Form,
    },
    /// PID on the drive, V.
    Pid {
        /// Gains, V/um.
        gains: PidGains,
        /// Notch behind it.
        notch: Option<Notch>,
    },
    /// Feedforward through the inverse of hysteresis, linear dynamics and creep, with PI in um of
    /// force-equivalent displacement (no gains: feedforward alone).
    Feedforward {
        /// Gains, 1 and 1/s.
        gains: PidGains,
        /// Notch behind it.
        notch: Option<Notch>,
        /// False: creep is not undone.
        #[serde(default = "yes")]
        creep_inverse: bool,
    },
    /// Disturbance observer on a nominal second-order model.
    DisturbanceObserver {
        /// Gains.
        gains: DisturbanceObserverGains,
        /// False: the actuator is taken to be linear, and all its hysteresis is a disturbance.
        #[serde(default = "yes")]
        hysteresis_inverse: bool,
    },
}

fn yes() -> bool {
    true
}

/// In which form a sliding-mode scheme runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Form {
    /// As the thesis prints it: the controller of continuous time, on the drive in V.
    #[default]
    Printed,
    /// For the period of delay ([`super::sliding_mode`]), in um of force-equivalent displacement.
    Predictor {
        /// False: the actuator is taken to be linear, and all its hysteresis is left to the unknown input.
        hysteresis_inverse: bool,
    },
}

/// What every scheme for one order is designed for, but for the recording.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DesignBasis {
    /// What is asked.
    pub demands: Demands,
    /// Spread of the first mode.
    pub first: ModeSpread,
    /// Spread of the second one, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub second: Option<ModeSpread>,
    /// Delay of the drive that the observer does not carry, s.
    pub delay_s: f64,
    /// Mass over the model's up to which it holds.
    #[serde(default = "most_mass")]
    pub mass_to: f64,
}

fn most_mass() -> f64 {
    HELD_MASSES[0]
}

/// A design: everything that is needed to make the integers of the tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ServoDesign {
    /// `hysteron.servo/1`.
    pub schema: String,
    /// Why it is as it is, for a reader.
    pub explanation: Vec<String>,
    /// True if a code acts one period after the reading it was computed from.
    pub delayed: bool,
    /// Carries the DAC's rounding error on.
    pub noise_shaping: bool,
    /// What was asked of it and how well its modes are known, so that another scheme can be designed for the
    /// same; none in a file that is older or made by hand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub basis: Option<DesignBasis>,
    /// Noise of the sensor that it was designed for, um RMS, without the converter's rounding; none where
    /// nobody said it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor_noise_um: Option<f64>,
    /// How late the sensor is known to read at rest, s: the reference is made as late before a reading is
    /// compared with it, so that the true position follows what was asked for; none where the sensor is ideal
    /// or nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor_lag_s: Option<f64>,
    /// The scheme.
    pub scheme: Scheme,
    /// The model that it was made from.
    pub model: ActuatorModel,
    /// What the scan weighed: for the trade-off curve (of a predictor).
    #[serde(default)]
    pub trade_off: Vec<Assessment>,
    /// The same among those with the usual margins.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trade_off_usual: Vec<Assessment>,
    /// The one of them that was taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chosen: Option<Assessment>,
    /// How the correction of a periodic reference is learned; none: it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learning: Option<LearningDesign>,
    /// Bounds within which the gain of the model is corrected; none: it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adaptation: Option<AdaptationDesign>,
    /// The predictor that was designed for the same order, to stand beside another scheme; none: the scheme
    /// is a predictor, or none holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<PredictorTuning>,
}

/// Name of the file format.
pub const SCHEMA: &str = "hysteron.servo/1";

impl ServoDesign {
    /// Reads the text of a servo file, which is called `place` in messages.
    ///
    /// # Errors
    /// Another schema; the line that is wrong; a value that no servo has.
    pub fn from_toml(text: &str, place: &str) -> error::Result<Self> {
        let design: Self = with_schema(text, place, SCHEMA)?;
        match design.impossible_value() {
            Some(impossible) => Err(Error::new(place, impossible)),
            None => Ok(design),
        }
    }

    /// A scheme for a model.
    #[must_use]
    pub fn new(scheme: Scheme, model: &ActuatorModel, delayed: bool) -> Self {
        Self {
            schema: SCHEMA.into(),
            explanation: Vec::new(),
            delayed,
            noise_shaping: false,
            basis: None,
            sensor_noise_um: None,
            sensor_lag_s: None,
            scheme,
            model: model.clone(),
            trade_off: Vec::new(),
            trade_off_usual: Vec::new(),
            chosen: None,
            learning: None,
            adaptation: None,
            beside: None,
        }
    }

    /// The best predictor for a model: scans the tunings and explains the choice.
    ///
    /// Where no tuning keeps all margins the one with the smallest expected error is *not* taken silently:
    /// `None`.
    #[must_use]
    pub fn best(model: &ActuatorModel, demands: &Demands) -> Option<Self> {
        let scan = tune(&model.linear, demands);
        let chosen = scan.first().filter(|a| a.accepted)?;
        let accepted = scan.iter().filter(|a| a.accepted).count();
        let mut out = Self::new(
            Scheme::Predictor {
                tuning: chosen.tuning,
                hysteresis_inverse: true,
            },
            model,
            true,
        );
        out.noise_shaping = true;
        let m = &chosen.margins;
        out.explanation = vec![
            format!(
                "Of {} tunings {accepted} keep every margin; this one has the smallest expected error.",
                scan.len()
            ),
            format!(
                "Expected at {} Hz: {:.2} nm of sensor noise passed on and {:.2} nm of a {:.0} nm hysteresis model error let through.",
                demands.reference_hz,
                1e3 * chosen.noise_um,
                1e3 * chosen.disturbance_um,
                1e3 * demands.model_error_um
            ),
            format!(
                "Largest sampled eigenvalue: nominal {:.3}; gain -50 % {:.3}, +50 % {:.3}; one more period of delay {:.3}; up to twice the mass {:.3}; {} {:.3}. Peak sensitivity {:.2}.",
                m.nominal,
                m.gain_half,
                m.gain_plus_half,
                m.delay,
                m.mass_double,
                if model.linear.second_mode.is_some() {
                    "second mode 10 % lower"
                } else {
                    "an unknown second mode"
                },
                m.second_mode,
                m.sensitivity_peak
            ),
            if model.linear.second_mode.is_some() {
                "The observer carries the second mode, so the loop need not be slow enough to leave it alone.".into()
            } else {
                "The model has no second mode: the margin against an unknown one limits the bandwidth.".into()
            },
        ];
        out.chosen = Some(*chosen);
        let accepted = scan.iter().filter(|a| a.accepted).copied().collect();
        out.trade_off = undominated(accepted, |a: &Assessment| a.noise_um, |a| a.disturbance_um);
        Some(out)
    }

    /// Sampling period of its loop, s.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.model.linear.period_s
    }

    /// Name of the scheme.
    #[must_use]
    pub fn scheme_name(&self) -> &'static str {
        match &self.scheme {
            Scheme::Predictor { .. } if self.learning.is_some() && self.adaptation.is_some() => {
                "predictor-learning-adaptive"
            }
            Scheme::Predictor { .. } if self.learning.is_some() => "predictor-learning",
            Scheme::Predictor { .. } if self.adaptation.is_some() => "predictor-adaptive",
            Scheme::Predictor {
                hysteresis_inverse: true,
                ..
            } => "predictor",
            Scheme::Predictor { .. } => "predictor-linear",
            Scheme::SlidingMode {
                estimator,
                reaching,
                form: Form::Predictor { hysteresis_inverse },
                ..
            } => match (estimator, reaching, hysteresis_inverse) {
                (Estimator::Pidsmo(_), ReachingGains::Pid, true) => "pidsmoc",
                (Estimator::Pidsmo(_), ReachingGains::Pid, false) => "pidsmoc-linear",
                (Estimator::AlphaBeta(_), ReachingGains::Pid, true) => "pidsmc-alpha-beta",
                (Estimator::AlphaBeta(_), ReachingGains::Pid, false) => "pidsmc-alpha-beta-linear",
                (_, ReachingGains::BoundaryLayer { .. }, true) => "smcbl",
                (_, ReachingGains::BoundaryLayer { .. }, false) => "smcbl-linear",
                (_, ReachingGains::Switching { .. }, _) => "sliding-mode",
            },
            Scheme::SlidingMode {
                estimator,
                reaching,
                ..
            } => match (estimator, reaching) {
                (Estimator::Pidsmo(_), ReachingGains::Pid) => "pidsmoc",
                (Estimator::AlphaBeta(f), ReachingGains::Pid) if f.discrete => {
                    "pidsmc-alpha-beta-discrete"
                }
                (Estimator::AlphaBeta(_), ReachingGains::Pid) => "pidsmc-alpha-beta",
                (_, ReachingGains::Switching { .. }) => "sliding-mode",
                (_, ReachingGains::BoundaryLayer { .. }) => "boundary-layer",
            },
            Scheme::Pid { .. } => "pid-linear",
            Scheme::Feedforward {
                gains,
                creep_inverse,
                ..
            } if gains.p == 0.0 && gains.i == 0.0 && gains.d == 0.0 => {
                if *creep_inverse {
                    "feedforward"
                } else {
                    "feedforward-without-creep"
                }
            }
            Scheme::Feedforward { notch: None, .. } => "pid",
            Scheme::Feedforward { .. } => "feedforward-pi-notch",
            Scheme::DisturbanceObserver {
                hysteresis_inverse: false,
                ..
            } => "disturbance-observer",
            Scheme::DisturbanceObserver { .. } => "disturbance-observer-inverse",
        }
    }

    /// The law as it closes the loop one period after a reading, for eigenvalues and margins; none where it
    /// acts at once, or switches.
    #[must_use]
    pub fn law(&self) -> Option<PredictorDesign> {
        if !self.delayed {
            return None;
        }
        match &self.scheme {
            Scheme::Predictor { tuning, .. } => {
                Some(PredictorDesign::new(&self.model.linear, tuning))
            }
            Scheme::SlidingMode {
                form: Form::Printed,
                ..
            } => None,
            Scheme::SlidingMode {
                nominal,
                estimator,
                controller,
                reaching,
                ..
            } => SlidingModeLaw::predicted(nominal, estimator, controller, reaching).as_predictor(),
            Scheme::Pid { gains, notch } => {
                let gain = self.model.mean_gain_um_v();
                let in_um = PidGains {
                    p: gain * gains.p,
                    i: gain * gains.i,
                    d: gain * gains.d,
                };
                Some(regulator_loop::law(&in_um, notch.as_ref()))
            }
            Scheme::Feedforward { gains, notch, .. } => {
                Some(regulator_loop::law(gains, notch.as_ref()))
            }
            Scheme::DisturbanceObserver { gains, .. } => {
                Some(disturbance_observer::law(&self.model.linear, gains))
            }
        }
    }

    /// Whether the hysteresis is inverted behind the law.
    #[must_use]
    pub fn inverts_hysteresis(&self) -> bool {
        match &self.scheme {
            Scheme::Predictor {
                hysteresis_inverse, ..
            }
            | Scheme::DisturbanceObserver {
                hysteresis_inverse, ..
            }
            | Scheme::SlidingMode {
                form: Form::Predictor { hysteresis_inverse },
                ..
            } => *hysteresis_inverse,
            Scheme::Feedforward { .. } => true,
            Scheme::SlidingMode {
                form: Form::Printed,
                ..
            }
            | Scheme::Pid { .. } => false,
        }
    }

    /// The integers of the tick.
    ///
    /// # Errors
    /// If a coefficient does not fit its format.
    pub fn parameters(
        &self,
        converters: ConverterParameters,
    ) -> Result<ServoParameters, QuantisationError> {
        let mut converters = converters;
        converters.noise_shaping = self.noise_shaping;
        let gain = self.model.mean_gain_um_v();
        let inverse_or_gain = |inverse: bool| {
            if inverse {
                quantise::hysteresis(&self.model)
            } else {
                quantise::linear_actuator(gain)
            }
        };
        let (actuator, law) = match &self.scheme {
            Scheme::Predictor {
                tuning,
                hysteresis_inverse,
            } => {
                let plain = PredictorDesign::new(&self.model.linear, tuning);
                let law = LawParameters::Predictor(
                    self.learning
                        .as_ref()
                        .map_or(plain.clone(), |l| l.fed_forward(&plain))
                        .quantised()?,
                );
                (inverse_or_gain(*hysteresis_inverse)?, law)
            }
            Scheme::DisturbanceObserver {
                gains,
                hysteresis_inverse,
            } => {
                let law = LawParameters::Predictor(
                    disturbance_observer::law(&self.model.linear, gains).quantised()?,
                );
                (inverse_or_gain(*hysteresis_inverse)?, law)
            }
            Scheme::SlidingMode {
                nominal,
                estimator,
                controller,
                reaching,
                form: Form::Printed,
            } => (
                ActuatorParameters::Direct,
                SlidingModeLaw::new(nominal, estimator, controller, reaching).quantised()?,
            ),
            Scheme::SlidingMode {
                nominal,
                estimator,
                controller,
                reaching,
                form: Form::Predictor { hysteresis_inverse },
            } => {
                let law = SlidingModeLaw::predicted(nominal, estimator, controller, reaching)
                    .following(&self.model.linear);
                (inverse_or_gain(*hysteresis_inverse)?, law.quantised()?)
            }
            Scheme::Pid { gains, notch } => (
                ActuatorParameters::Direct,
                regulator(gains, &Feedforward::default(), notch.as_ref(), Unit::Volt)?,
            ),
            Scheme::Feedforward {
                gains,
                notch,
                creep_inverse,
            } => {
                let ahead = if self.delayed { 1.0 } else { 0.0 };
                let sampled = self.model.linear.sampled();
                let feedforward = window_fit::fit(self.period_s(), |w| {
                    let notched = notch.map_or(Complex::new(1.0, 0.0), |n| n.response(w));
                    Complex::from_polar(1.0, ahead * w * self.period_s())
                        / (frequency_response(&sampled, w) * notched)
                });
                let (creep, creep_pair) = if *creep_inverse {
                    (self.model.creep.as_slice(), self.model.creep_pair.as_ref())
                } else {
                    (&[][..], None)
                };
                let feedforward = Feedforward {
                    window: &feedforward,
                    creep,
                    creep_pair,
                };
                (
                    quantise::hysteresis(&self.model)?,
                    regulator(gains, &feedforward, notch.as_ref(), Unit::Micrometre)?,
                )
            }
        };
        let learning = self
            .learning
            .as_ref()
            .map(LearningDesign::quantised)
            .transpose()?;
        let adaptation = self
            .adaptation
            .as_ref()
            .map(AdaptationDesign::quantised)
            .transpose()?;
        let sensor_lag = self.sensor_lag_s.map_or(Ok(SensorLag::NONE), |lag_s| {
            sensor_lag::quantised(lag_s, self.period_s())
        })?;
        Ok(ServoParameters {
            sensor_lag,
            converters,
            actuator,
            law,
            delayed: self.delayed,
            learning,
            adaptation,
        })
    }
}

/// Those that no other one beats in both noise passed on and error let through, by rising noise.
pub(super) fn undominated<T>(
    mut all: Vec<T>,
    noise_um: impl Fn(&T) -> f64,
    disturbance_um: impl Fn(&T) -> f64,
) -> Vec<T> {
    all.sort_by(|a, b| noise_um(a).total_cmp(&noise_um(b)));
    let mut best = f64::INFINITY;
    all.retain(|one| {
        let better = disturbance_um(one) < best;
        best = best.min(disturbance_um(one));
        better
    });
    all
}

/// The schemes of the thesis with its own gains, by name, as the thesis ran them: without delay.
#[must_use]
pub fn thesis_scheme(name: &str) -> Option<Scheme> {
    let nominal = NominalModel::THESIS;
    let filter_6 = Estimator::AlphaBeta(AlphaBeta::THESIS_CHAPTER_6);
    let sliding = |estimator, controller, reaching| Scheme::SlidingMode {
        nominal,
        estimator,
        controller,
        reaching,
        form: Form::Printed,
    };
    Some(match name {
        "pidsmoc" => sliding(
            Estimator::Pidsmo(ObserverGains::THESIS_PIDSMOC),
            ControllerGains::THESIS_PIDSMOC,
            ReachingGains::Pid,
        ),
        "pidsmc-alpha-beta" => sliding(
            Estimator::AlphaBeta(AlphaBeta::THESIS_CHAPTER_7),
            ControllerGains::THESIS_CHAPTER_7,
            ReachingGains::Pid,
        ),
        "pidsmc-alpha-beta-discrete" => {
            let filter = AlphaBeta {
                discrete: true,
                ..AlphaBeta::THESIS_CHAPTER_7
            };
            sliding(
                Estimator::AlphaBeta(filter),
                ControllerGains::THESIS_CHAPTER_7,
                ReachingGains::Pid,
            )
        }
        "pidsm-chapter-6" => sliding(
            filter_6,
            ControllerGains::THESIS_CHAPTER_6,
            ReachingGains::Pid,
        ),
        "sliding-mode" => sliding(
            filter_6,
            ControllerGains::THESIS_CHAPTER_6,
            ReachingGains::Switching { eta_v: 7.0 },
        ),
        "boundary-layer" => sliding(
            filter_6,
            ControllerGains::THESIS_CHAPTER_6,
            ReachingGains::BoundaryLayer {
                eta_v: 122.0,
                delta_um_s: 60_000.0,
            },
        ),
        "pid" => Scheme::Pid {
            gains: PidGains {
                p: 4.0,
                i: 55_100.0,
                d: 1e-8,
            },
            notch: None,
        },
        _ => return None,
    })
}
