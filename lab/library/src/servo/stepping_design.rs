//! The design of a stepping drive: teeth that a model of the rig bears, and a law for fine motion.
//!
//! # How it works
//! The teeth take the whole range of the drive. A slider that went too far asks for a tooth back, which takes
//! the drive to its other end. The fast flank is as fast as the amplifier allows. Every rate and curvature of
//! the slow flank in [`RATES_S`] and [`CURVATURES`] is simulated on the model; the fastest slider wins.
//!
//! In fine motion the slider sticks, and its contact passes on the platform's motion up to its own frequency.
//! So the law is that of the platform: its hysteresis inverted, its mode in the observer, and all else an
//! unknown input. The contact is known badly, and softens as the bristles begin to slide: a tuning is taken
//! only if its loop keeps its sensitivity on every contact of [`contacts`], which the observer does not carry.

use super::design::{Scheme, ServoDesign};
use super::law::PredictorDesign;
use super::model::{ActuatorModel, LinearModel, ModeModel, SampledModel};
use super::predictor::tune;
use super::sampled_loop::{FrequencyGrid, SampledLoop};
use super::tuning::Demands;
use crate::error::{Error, Result};
use crate::servo::amplifier_block::{FrontEnd, amplifier_parameters};
use hysteron_core::parameter_block::{AmplifierParameters, verify};
use hysteron_core::signal::Travel;
use hysteron_core::stepping_parameters::{FLANK_FRACTION_BITS, IfStepping, SteppingParameters};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::linear_system::ContinuousSystem;
use hysteron_sim::stick_slip::{StickSlipActuator, StickSlipPlant};
use nalgebra::{DMatrix, DVector};

/// Times of a whole slow flank that are tried, s.
pub const RATES_S: [f64; 8] = [0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.016, 0.024];
/// Curvatures of it that are tried.
pub const CURVATURES: [f64; 3] = [0.0, 0.5, 1.0];
/// Teeth of which the last two thirds are counted.
pub(super) const TEETH: usize = 15;
/// Reach of fine motion over the way of the platform between the ends of the drive: the rest is for a platform
/// that goes less far than the model.
const REACH_SHARE: f64 = 0.93;
/// Highest frequency of fine motion, Hz.
const FINE_HZ: f64 = 20.0;
/// A slider without the contact's mode follows the platform to this share, which the law takes as unknown.
const UNKNOWN_SHARE: f64 = 0.02;

/// What is asked of a stepping drive.
#[derive(Clone, Debug, PartialEq)]
pub struct SteppingOrder {
    /// Wiring. The sensor's codes are the window in which the fine law reads the encoder, a count each, about
    /// zero.
    pub front_end: FrontEnd,
    /// Noise of the encoder, um RMS.
    pub noise_um: f64,
    /// Ends of the travel, um.
    pub travel_um: [f64; 2],
    /// Error at which the slider counts as arrived, um.
    pub tolerance_um: f64,
    /// Share by which friction, mass and gain may differ from the model's.
    pub spread: f64,
}

impl Default for SteppingOrder {
    fn default() -> Self {
        Self {
            front_end: FrontEnd {
                // 2^16 counts of a nanometre.
                sensor_min_um: -32.768,
                sensor_max_um: 32.768,
                ..FrontEnd::default()
            },
            noise_um: 0.003,
            travel_um: [-12_000.0, 12_000.0],
            tolerance_um: 0.02,
            spread: 0.3,
        }
    }
}

/// Teeth in physical units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tooth {
    /// Its ends, V.
    pub ends_v: [f64; 2],
    /// Time of a whole slow flank, s.
    pub slow_s: f64,
    /// Time of a whole fast flank, s.
    pub fast_s: f64,
    /// How much the slow flank gathers speed: 0 is straight, 1 begins at rest.
    pub curvature: f64,
    /// Travel of a tooth on the model, um.
    pub step_um: f64,
}

impl Tooth {
    /// Drive of teeth upwards, sample by sample.
    #[must_use]
    pub fn drive_v(&self, period_s: f64, teeth: usize) -> Vec<f64> {
        let [slow, fast] = [self.slow_s, self.fast_s].map(|s| (s / period_s).round().max(1.0));
        let [low, high] = self.ends_v;
        let shaped = |p: f64| p - self.curvature * p * (1.0 - p);
        let up = (1..=slow as usize).map(|k| low + (high - low) * shaped(k as f64 / slow));
        let down = (1..=fast as usize).map(|k| high + (low - high) * k as f64 / fast);
        let one: Vec<f64> = up.chain(down).collect();
        one.iter()
            .copied()
            .cycle()
            .take(teeth * one.len())
            .collect()
    }

    /// With its travel on a model.
    #[must_use]
    pub fn on(self, rig: &StickSlipActuator, period_s: f64) -> Self {
        Self {
            step_um: step_um(rig, &self, period_s),
            ..self
        }
    }

    /// Velocity on the model, um/s.
    #[must_use]
    pub fn velocity_um_s(&self) -> f64 {
        self.step_um / (self.slow_s + self.fast_s)
    }
}

/// A stepping drive: what its integers are made of.
#[derive(Clone, Debug)]
pub struct SteppingDesign {
    /// What was asked.
    pub order: SteppingOrder,
    /// The teeth.
    pub tooth: Tooth,
    /// Distance within which fine motion takes over, um.
    pub reach_um: f64,
    /// The law of fine motion.
    pub fine: ServoDesign,
}

impl SteppingDesign {
    /// For a model of the rig.
    ///
    /// # Errors
    /// The rig does not step, or no law keeps its margins.
    pub fn new(
        rig: &StickSlipActuator,
        order: &SteppingOrder,
    ) -> std::result::Result<Self, String> {
        let period_s = order.front_end.period_s();
        let ends_v = [0.0, rig.drive_range_v];
        // A tick more, since codes are rounded and none goes further in a tick than the slew allows.
        let fast_s = (ends_v[1] - ends_v[0]) / order.front_end.slew_v_s + period_s;
        let tried = RATES_S.iter().flat_map(|slow_s| {
            CURVATURES.iter().map(move |curvature| Tooth {
                ends_v,
                slow_s: *slow_s,
                fast_s,
                curvature: *curvature,
                step_um: 0.0,
            })
        });
        let tooth = tried
            .map(|tooth| tooth.on(rig, period_s))
            .max_by(|a, b| a.velocity_um_s().total_cmp(&b.velocity_um_s()))
            .filter(|tooth| tooth.step_um > 0.0)
            .ok_or("the model of the rig does not step at any rate; check its friction")?;
        let stroke_um = {
            let force_um = rig.force_equivalent_um(&ends_v);
            force_um[1] - force_um[0]
        };
        let demands = Demands {
            reference_hz: FINE_HZ,
            model_error_um: UNKNOWN_SHARE * stroke_um,
            sensor_noise_um: order.noise_um,
            ..Demands::default()
        };
        let fine = fine_law(rig, order, &demands)
            .ok_or("no law of fine motion keeps its margins on all contacts of the rig")?;
        Ok(Self {
            order: order.clone(),
            tooth,
            reach_um: REACH_SHARE * stroke_um,
            fine,
        })
    }

    /// The block for a board.
    ///
    /// # Errors
    /// As [`amplifier_parameters`]; what of the design contradicts the wiring.
    pub fn block(&self) -> Result<AmplifierParameters> {
        let front_end = &self.order.front_end;
        let mut block = amplifier_parameters(&self.fine, front_end)?;
        block.stepping = IfStepping::new(self.stepping(&block));
        // A law that lacks drive for the rest of the way asks for a tooth, and that is no fault.
        block.guard.tracking_error = (0.5 * self.reach_um * 2f64.powi(24)) as i32;
        verify(&block, front_end.sample_rate_hz)
            .map_err(|error| Error::new("stepping", error.reason()))?;
        Ok(block)
    }

    /// The integers of the stepping.
    fn stepping(&self, block: &AmplifierParameters) -> SteppingParameters {
        let order = &self.order;
        let model = &self.fine.model;
        let scale = order.front_end.scale(model.drive_min_v, model.drive_max_v);
        let ticks = |time_s: f64| {
            (time_s / order.front_end.period_s())
                .round()
                .clamp(1.0, f64::from(u16::MAX)) as u16
        };
        let um = Travel::saturating_from_num::<f64>;
        let [low, high] = self.tooth.ends_v.map(|v| scale.dac_code(v));
        SteppingParameters {
            encoder_step: block.servo.converters.adc_step,
            low,
            high,
            slow_ticks: ticks(self.tooth.slow_s),
            fast_ticks: ticks(self.tooth.fast_s),
            curvature: (self.tooth.curvature * f64::from(1u32 << FLANK_FRACTION_BITS)).round()
                as u16,
            settle_ticks: ticks(SETTLE_S),
            fine_ticks: ticks(FINE_S),
            reach: um(self.reach_um),
            lead: um(0.5 * self.tooth.step_um),
            travel_min: um(order.travel_um[0]),
            travel_max: um(order.travel_um[1]),
            end_zone: um(3.0 * self.tooth.step_um),
            least_step: um(LEAST_STEP_SHARE * self.tooth.step_um),
            stall_teeth: STALL_TEETH,
            tolerance: um(order.tolerance_um),
            arrival_ticks: ticks(ARRIVAL_S),
        }
    }
}

/// Rest between coarse and fine motion, s: five time constants of the thesis' contact.
const SETTLE_S: f64 = 0.005;
/// Way to the target in fine motion, s: a quintic over the reach needs 0.02 m/s^2, a twentieth of what the
/// thesis' contact bears.
const FINE_S: f64 = 0.06;
/// So long within the tolerance is an arrival, s.
const ARRIVAL_S: f64 = 0.02;
/// Share of the model's step below which a tooth is no step.
const LEAST_STEP_SHARE: f64 = 0.1;
/// So many teeth without a step are a stall.
const STALL_TEETH: u16 = 10;

/// Travel of a tooth on a model, um.
fn step_um(rig: &StickSlipActuator, tooth: &Tooth, period_s: f64) -> f64 {
    let drive_v = tooth.drive_v(period_s, TEETH);
    let mut plant = StickSlipPlant::at_rest(rig.clone(), period_s);
    let positions: Vec<f64> = drive_v
        .iter()
        .map(|u| {
            plant.advance(*u, 0.0);
            plant.displacement_um()
        })
        .collect();
    let length = drive_v.len() / TEETH;
    let at = |tooth: usize| positions[tooth * length - 1];
    (at(TEETH) - at(TEETH / 3)) / (TEETH - TEETH / 3) as f64
}

/// Factors by which the noise of the sensor is exaggerated to find calmer tunings.
const CALMER: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];
/// Stiffness and damping that bristles have left where they begin to slide, over those at rest.
const SOFTENED: f64 = 0.3;

/// The tuning with the smallest expected error that holds on every contact.
fn fine_law(
    rig: &StickSlipActuator,
    order: &SteppingOrder,
    demands: &Demands,
) -> Option<ServoDesign> {
    let model = fine_model(rig, order.front_end.period_s());
    let contacts = contacts(rig, order);
    let grid = FrequencyGrid::about_modes(&model.linear);
    let gains = [1.0 - order.spread, 1.0, 1.0 + order.spread];
    let holds = |law: &PredictorDesign| {
        contacts.iter().all(|plant| {
            gains.iter().all(|gain| {
                let closed = SampledLoop::new(law, plant).with_gain(*gain);
                closed.is_stable()
                    && closed.response(&grid).sensitivity_peak().0 <= demands.sensitivity_peak
            })
        })
    };
    let tuning = CALMER.iter().find_map(|noise| {
        let calmer = Demands {
            sensor_noise_um: noise * demands.sensor_noise_um,
            ..*demands
        };
        let accepted = tune(&model.linear, &calmer)
            .into_iter()
            .filter(|a| a.accepted);
        let mut tunings = accepted.map(|assessment| assessment.tuning);
        tunings.find(|tuning| holds(&PredictorDesign::new(&model.linear, tuning)))
    })?;
    let scheme = Scheme::Predictor {
        tuning,
        hysteresis_inverse: true,
    };
    Some(ServoDesign {
        noise_shaping: true,
        ..ServoDesign::new(scheme, &model, true)
    })
}

/// Platform and sticking slider: contacts that are softer, stiffer or begin to slide, sliders that are lighter
/// or heavier.
#[must_use]
pub fn contacts(rig: &StickSlipActuator, order: &SteppingOrder) -> Vec<SampledModel> {
    let (less, more) = (1.0 - order.spread, 1.0 + order.spread);
    let springs = [[less, 1.0], [more, 1.0], [SOFTENED * less, SOFTENED]];
    let pairs = springs
        .iter()
        .flat_map(|spring| [less, more].map(|mass| (*spring, mass)));
    pairs
        .map(|([stiffness, damping], mass)| {
            let omega = rig.natural_frequency_rad_s;
            let mass = mass * rig.end_effector_mass_kg * 1e-6;
            let k = stiffness * rig.friction.stiffness_n_um / mass / omega;
            let c = damping * rig.friction.damping_n_s_um / mass;
            // Displacements of platform and slider, each with its velocity over `omega`.
            let a = [
                [0.0, omega, 0.0, 0.0],
                [-omega, -2.0 * rig.damping_ratio * omega, 0.0, 0.0],
                [0.0, 0.0, 0.0, omega],
                [k, c, -k, -c],
            ];
            let (a, b) = ContinuousSystem {
                a: DMatrix::from_fn(4, 4, |row, column| a[row][column]),
                b: DVector::from_row_slice(&[0.0, omega, 0.0, 0.0]),
                c: DVector::zeros(4),
                d: 0.0,
            }
            .held_matrices(order.front_end.period_s());
            SampledModel {
                a,
                b,
                c: DVector::from_row_slice(&[0.0, 0.0, 1.0, 0.0]),
                period_s: order.front_end.period_s(),
            }
        })
        .collect()
}

/// What fine motion is designed for: the platform alone.
fn fine_model(rig: &StickSlipActuator, period_s: f64) -> ActuatorModel {
    let plays = rig.plays.iter().map(|play| (play.threshold, play.weight));
    ActuatorModel {
        drive_min_v: 0.0,
        drive_max_v: rig.drive_range_v,
        g_um: rig.hysteresis.g.clone(),
        r_um: rig.hysteresis.r.clone(),
        linear: LinearModel {
            first_mode: ModeModel {
                natural_frequency_rad_s: rig.natural_frequency_rad_s,
                damping_ratio: rig.damping_ratio,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s,
        },
        creep: Vec::new(),
        creep_pair: None,
    }
    .with_plays(&plays.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::stepping_loop::SteppingLoop;

    #[test]
    fn a_designed_drive_reaches_its_targets_on_its_own_model() {
        let rig = StickSlipActuator::thesis(0.0635);
        let design = SteppingDesign::new(&rig, &SteppingOrder::default()).unwrap();
        println!(
            "{:?}, {:.0} um/s",
            design.tooth,
            design.tooth.velocity_um_s()
        );
        println!("{:?}", design.fine.scheme);
        let plant = StickSlipPlant::at_rest(rig, design.order.front_end.period_s());
        let noise = (design.order.noise_um, 7);
        let mut closed = SteppingLoop::new(plant, &design.block().unwrap(), noise);
        for target_um in [0.1, 40.0, -25.0, -25.1] {
            let figures = closed.move_to(target_um, 3.0, 0.05).unwrap();
            println!("{target_um}: {figures:?}");
            assert!(figures.arrived_s.is_some(), "{target_um}: {figures:?}");
            assert!(figures.error_max_um < 0.05, "{target_um}: {figures:?}");
        }
        for target_um in [60.0, -30.0, 17.0] {
            let position_um = closed.follow(target_um, 200.0, 1.5).unwrap();
            let error_um = position_um[position_um.len() - 1] - target_um;
            assert!(error_um.abs() < 0.05, "{target_um}: {error_um} um");
        }
    }
}
