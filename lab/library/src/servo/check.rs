//! What `hysteron check` says of a servo on an actuator: poles, margins, and whether it holds for every plant
//! that a design has to hold for.

use super::design::{Form, Scheme, ServoDesign};
use super::from_rest::Beginning;
use super::known::{ASSUMED_NOISE_UM, OnPlants, Reckoned, known_delay_s};
use super::law::PredictorDesign;
use super::loop_margins::{Loop, LoopMargins};
use super::model::{ActuatorModel, NominalModel, first_falls_um, required_model};
use super::plant_set::{HELD_MASSES, PlantVariation};
use super::sampled_loop::{SampledLoop, used_poles};
use super::thesis_conditions::{self, ContinuousConditions, pairs};
use super::thesis_schemes::{ReachingGains, SlidingModeLaw};
use crate::dataset::Dataset;
use hysteron_sim::chain::Model;
use nalgebra::Complex;
use serde::Serialize;

/// What `hysteron check` found.
#[derive(Clone, Debug, Serialize)]
pub struct CheckResult {
    /// `hysteron.check/1`.
    pub schema: String,
    /// Scheme.
    pub scheme: String,
    /// True if nothing is fed back, or all sampled eigenvalues are inside the unit circle wherever the actuator may stand in its
    /// hysteresis, the period of delay included where the design has it.
    pub stable: bool,
    /// Which criterion says that it is not, where it is judged and is not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unstable_because: Option<String>,
    /// Sampled eigenvalues `[re, im]` at the mean gain.
    pub sampled_poles: Vec<[f64; 2]>,
    /// The thesis' continuous conditions; empty where they do not apply.
    pub continuous: ContinuousConditions,
    /// Margins on the actuator that it was checked against.
    pub margins: Option<LoopMargins>,
    /// Whether it holds for the plants that a design for this actuator has to hold for; empty where no linear
    /// law closes the loop.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub on_plants: Option<OnPlants>,
    /// What it means, in sentences.
    pub remarks: Vec<String>,
}

impl CheckResult {
    /// A criterion that is not met; the result reports the first of them.
    fn fails(&mut self, because: String) {
        self.stable = false;
        self.unstable_because.get_or_insert(because);
    }

    /// Takes the eigenvalues of the loop at a gain.
    fn judge_poles(&mut self, poles: &[Complex<f64>], whose: &str) {
        self.sampled_poles = pairs(poles);
        if !all_inside(poles) {
            self.fails(format!(
                "the largest eigenvalue {whose} is {:.4}",
                self.largest_eigenvalue()
            ));
        }
    }

    /// Largest magnitude of the sampled eigenvalues at the mean gain; zero where none are taken.
    #[must_use]
    pub fn largest_eigenvalue(&self) -> f64 {
        self.sampled_poles
            .iter()
            .map(|p| p[0].hypot(p[1]))
            .fold(0.0, f64::max)
    }

    /// The verdict in words, behind the name of the scheme.
    #[must_use]
    pub fn verdict(&self) -> String {
        let largest = self.largest_eigenvalue();
        match (
            &self.unstable_because,
            self.sampled_poles.is_empty(),
            self.stable,
        ) {
            (Some(because), _, _) if largest < 1.0 => {
                format!(
                    "UNSTABLE: {because} (the largest eigenvalue with the mean gain, {largest:.4}, is stable)"
                )
            }
            (Some(because), ..) => format!("UNSTABLE: {because}"),
            (None, false, true) => {
                format!("stable, largest sampled eigenvalue {}", below_one(largest))
            }
            (None, true, true) => "nothing is fed back, so there is no loop to judge".to_owned(),
            (None, ..) => "not judged".to_owned(),
        }
    }
}

/// A stable eigenvalue in words: one that would round to one by its distance from there.
#[must_use]
pub fn below_one(magnitude: f64) -> String {
    let short = format!("{magnitude:.4}");
    if magnitude < 1.0 && short == "1.0000" {
        format!("1 - {:.1e}", 1.0 - magnitude)
    } else {
        short
    }
}

/// Checks a design against an actuator's chain, without a recording of it.
///
/// # Errors
/// A message that says what the model lacks.
pub fn check(design: &ServoDesign, chain: &Model) -> Result<CheckResult, String> {
    check_with(design, chain, None)
}

/// Checks a design against an actuator's chain and, with the recording behind it, for the plants that this
/// leaves possible.
///
/// # Errors
/// A message that says what the model lacks, or that the data are not those of the model.
pub fn check_with(
    design: &ServoDesign,
    chain: &Model,
    recording: Option<&Dataset>,
) -> Result<CheckResult, String> {
    let model = required_model(chain)?;
    let on = Actuator {
        design,
        chain,
        reckoned: Reckoned::with_recording(chain, model.clone(), recording)?,
        delay_s: known_delay_s(chain),
        ratio: gain_ratio(&design.model, chain, design.inverts_hysteresis())
            .ok_or("the loops of this model cannot be stepped by themselves")?,
        model,
    };
    let mut out = CheckResult {
        schema: "hysteron.check/1".into(),
        scheme: design.scheme_name().into(),
        stable: false,
        unstable_because: None,
        sampled_poles: Vec::new(),
        continuous: ContinuousConditions::default(),
        margins: None,
        on_plants: None,
        remarks: Vec::new(),
    };
    if let Some(law) = design.law() {
        if !law.feeds_back() {
            on.judge_open(&mut out);
            return Ok(out);
        }
        on.judge_law(&law, &mut out);
        on.remark_scheme(&law, &mut out);
        return Ok(out);
    }
    match &design.scheme {
        Scheme::SlidingMode {
            nominal,
            estimator,
            controller,
            reaching: ReachingGains::Pid,
            form: Form::Printed,
        } => {
            let law = SlidingModeLaw::new(nominal, estimator, controller, &ReachingGains::Pid);
            out.continuous =
                thesis_conditions::sliding_mode(nominal, estimator, controller, design.delayed)
                    .continuous;
            on.judge_printed_law(&law, &mut out);
        }
        _ => out.remarks.push(
            "No eigenvalues are taken of this one (a law that switches, or a regulator without the period of delay), and nothing is claimed: follow a reference to judge it.".into(),
        ),
    }
    Ok(out)
}

/// What a design is checked on.
struct Actuator<'a> {
    design: &'a ServoDesign,
    chain: &'a Model,
    model: ActuatorModel,
    reckoned: Reckoned,
    delay_s: f64,
    /// Gain over the one that the law inverts: least, mean, largest.
    ratio: [f64; 3],
}

impl Actuator<'_> {
    /// What is known of a scheme without feedback: it moves as the actuator does, and reads as far from its
    /// reference as the gain is from the one that it inverts.
    fn judge_open(&self, out: &mut CheckResult) {
        out.stable = true;
        let [least, _, most] = self.ratio;
        let off = |gain: f64| 100.0 * (gain - 1.0);
        out.remarks.push(format!(
            "The actuator's gain over the one that the scheme inverts is {least:.2} to {most:.2}: by that the position is {:+.1} to {:+.1} % of the way off, and nothing takes it back. `hysteron track` says how far on a reference.",
            off(least),
            off(most)
        ));
    }

    /// Eigenvalues and margins of a law.
    fn judge_law(&self, law: &PredictorDesign, out: &mut CheckResult) {
        let linear = &self.model.linear;
        let plant = PlantVariation::with_delay_s(self.delay_s).sampled(linear);
        let [_, mean, _] = self.ratio;
        let beginning = Beginning {
            design: self.design,
            chain: self.chain,
            // What both reach: a reference is given in um, whatever the servo's own model has as its reach.
            travel_um: self.model.reach_um().min(self.design.model.reach_um()),
            noise_um: self.design.sensor_noise_um.unwrap_or(ASSUMED_NOISE_UM),
        };
        let margins = Loop {
            law,
            linear,
            gain_ratio: self.ratio,
            delay_s: self.delay_s,
            beginning: Some(beginning),
            recording: self.reckoned.recording(),
        }
        .judged();
        let basis = self.design.basis.as_ref();
        let mass_to = basis.map_or(HELD_MASSES[0], |basis| basis.mass_to);
        out.on_plants = Some(self.reckoned.judge(law, mean, mass_to));
        out.stable = true;
        let poles = SampledLoop::new(law, &plant).with_gain(mean).poles();
        out.judge_poles(&poles, "with the mean gain");
        let places = ["smallest", "mean", "largest"]
            .into_iter()
            .zip(self.ratio.into_iter().zip(margins.spectral_radius));
        // The mean is what the eigenvalues are of; where only it fails that is reported already.
        for (place, (gain, radius)) in
            places.filter(|(_, (_, radius))| radius.is_nan() || *radius >= 1.0)
        {
            out.fails(format!(
                "where the actuator's gain is the {place}, {gain:.2} times the one that the law inverts, the largest eigenvalue is {radius:.4}"
            ));
        }
        out.margins = Some(margins);
    }

    /// What is to be said of a scheme beside its margins.
    fn remark_scheme(&self, law: &PredictorDesign, out: &mut CheckResult) {
        let in_sampled_time =
            "The loop is designed and checked in sampled time with the period of delay inside.";
        match &self.design.scheme {
            Scheme::Predictor { .. } => {
                out.remarks.push(in_sampled_time.into());
                self.judge_adaptation(law, out);
                self.judge_learning(law, out);
            }
            Scheme::SlidingMode {
                nominal,
                estimator,
                controller,
                reaching,
                ..
            } => {
                out.remarks.push(in_sampled_time.into());
                if matches!(reaching, ReachingGains::BoundaryLayer { .. }) {
                    out.remarks.push(
                        "Judged with the slope at the middle of the boundary layer, its largest; it has no integral, so a steady error stays."
                            .into(),
                    );
                }
                if *reaching == ReachingGains::Pid {
                    out.continuous =
                        thesis_conditions::sliding_mode(nominal, estimator, controller, true)
                            .continuous;
                }
            }
            Scheme::Feedforward { .. } => out
                .remarks
                .push("What is fed forward does not touch stability.".into()),
            Scheme::Pid { .. } => out.remarks.push(format!(
                "The drive counts with the mean gain of the largest loop, {:.4} um/V.",
                self.design.model.mean_gain_um_v()
            )),
            Scheme::DisturbanceObserver { .. } => {}
        }
    }

    /// The eigenvalues wherever the correction of the gain may stand.
    fn judge_adaptation(&self, law: &PredictorDesign, out: &mut CheckResult) {
        let Some(adaptation) = &self.design.adaptation else {
            return;
        };
        let plant = PlantVariation::with_delay_s(self.delay_s).sampled(&self.model.linear);
        let beliefs = self.ratio.iter();
        let worst = beliefs
            .flat_map(|gain| adaptation.over_beliefs(*gain))
            .map(|gain| {
                SampledLoop::new(law, &plant)
                    .with_gain(gain)
                    .spectral_radius()
            })
            .fold(0.0, f64::max);
        let percent = 100.0 * adaptation.farthest;
        if worst.is_nan() || worst >= 1.0 {
            out.fails(format!(
                "with the correction of the gain at a bound of its +-{percent:.0} % the largest eigenvalue is {worst:.4}"
            ));
        }
        out.remarks.push(format!(
            "Wherever the correction of the gain stands within its +-{percent:.0} % the largest eigenvalue is at most {worst:.3}{}.",
            if worst < 1.0 { "" } else { ": UNSTABLE" }
        ));
    }

    /// Whether learning converges.
    fn judge_learning(&self, law: &PredictorDesign, out: &mut CheckResult) {
        let Some(learning) = &self.design.learning else {
            return;
        };
        let worst_of = |gains: Vec<f64>| {
            let found = gains
                .into_iter()
                .map(|gain| learning.contraction_on(law, &self.model.linear, gain, self.delay_s));
            found
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or((f64::NAN, 0.0))
        };
        let (contraction, hz) = worst_of(self.ratio.to_vec());
        let converges = contraction < 1.0;
        if !converges {
            out.fails(format!(
                "learning diverges, an error becomes {contraction:.2} times itself from period to period at {hz:.0} Hz"
            ));
        }
        out.remarks.push(format!(
            "Learning {} on this actuator: an error becomes at most {contraction:.2} times itself from period to period (at {hz:.0} Hz).",
            if converges { "converges" } else { "DIVERGES" }
        ));
        if let Some(adaptation) = &self.design.adaptation {
            // It decides nothing: a gain that is learned does not stay where it is wrong.
            let beliefs = self.ratio.iter();
            let (farthest, hz) = worst_of(
                beliefs
                    .flat_map(|gain| adaptation.over_beliefs(*gain))
                    .collect(),
            );
            out.remarks.push(format!(
                "While the correction of the gain stands farthest off, to either side, it becomes at most {farthest:.2} times itself (at {hz:.0} Hz)."
            ));
        }
        out.remarks.push(learning.in_words());
    }

    /// The eigenvalues of a law as the thesis prints it, on the first mode and the mean gain.
    fn judge_printed_law(&self, law: &SlidingModeLaw, out: &mut CheckResult) {
        let mode = self.model.linear.first_mode;
        let plant = NominalModel {
            natural_frequency_rad_s: mode.natural_frequency_rad_s,
            damping_ratio: mode.damping_ratio,
            gain_um_v: self.model.mean_gain_um_v(),
        };
        let poles = |delay: usize| used_poles(&law.closed_loop(&plant, delay));
        let delayed = self.design.delayed;
        out.stable = true;
        out.judge_poles(
            &poles(usize::from(delayed)),
            "on the first mode and the mean gain",
        );
        if out.continuous.satisfied && !out.stable {
            out.remarks.push(
                "The thesis' continuous conditions hold, yet the sampled loop is unstable: they know nothing of sampling and delay."
                    .into(),
            );
        }
        if delayed {
            let without = if all_inside(&poles(0)) {
                "stable"
            } else {
                "unstable"
            };
            out.remarks
                .push(format!("Without the period of delay it is {without}."));
        }
        out.remarks.push(format!(
            "Sampled eigenvalues on the given model's first mode and mean gain: wn = {:.0} rad/s, xi = {:.3}, K = {:.4} um/V.",
            plant.natural_frequency_rad_s, plant.damping_ratio, plant.gain_um_v
        ));
    }
}

fn all_inside(poles: &[Complex<f64>]) -> bool {
    poles.iter().all(|z| z.norm() < 1.0)
}

/// Gain of an actuator over the one that a design inverts, wherever the hysteresis may stand: least, that of
/// the whole range, largest; none where the loops of the chain cannot be stepped. Slopes are compared over
/// steps of a sixteenth of the design's range: what a loop of that size feels. Those of the actuator are read
/// from its chain, as polynomials that stand for other loops hold inside the chain's own range alone.
#[must_use]
pub fn gain_ratio(design: &ActuatorModel, chain: &Model, inverted: bool) -> Option<[f64; 3]> {
    const STEPS: usize = 16;
    let falls_um = first_falls_um(chain, [design.drive_min_v, design.drive_max_v], STEPS)?;
    let actual = |turn: usize, down: usize| falls_um[turn][turn] - falls_um[turn][down];
    let surfaces = design.surfaces();
    let share = |i: usize| i as f64 / STEPS as f64;
    let designed = |turn: usize, down: usize| surfaces.loop_loss(share(turn), share(down));
    let mean_step_um = designed(STEPS, 0) / STEPS as f64;
    let mut ratio = [
        f64::INFINITY,
        actual(STEPS, 0) / designed(STEPS, 0),
        f64::NEG_INFINITY,
    ];
    let mut see = |from: (usize, usize), to: (usize, usize)| {
        let actual_um = actual(to.0, to.1) - actual(from.0, from.1);
        let inverted_um = if inverted {
            designed(to.0, to.1) - designed(from.0, from.1)
        } else {
            mean_step_um
        };
        let value = actual_um / inverted_um;
        ratio[0] = ratio[0].min(value);
        ratio[2] = ratio[2].max(value);
    };
    for i in 1..=STEPS {
        for j in 0..i {
            see((i - 1, j), (i, j));
            see((i, j + 1), (i, j));
        }
    }
    Some(ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::model::actuator_model;
    use hysteron_sim::chain::EffectInstance;
    use hysteron_sim::effect::{Overview, by_id};

    /// A stage of 0.1 um/V with two plays of 3 and 12 V, described over a range of drives.
    fn with_kinks(range_v: f64) -> Model {
        let overview = Overview {
            range_um: 8.0,
            ..Overview::without_data(0.0, range_v)
        };
        let plays = by_id("play_operators").unwrap().with_parameters(4).unwrap();
        let mut surfaces = vec![0.0; by_id("hysteresis").unwrap().parameters(&overview).len()];
        surfaces[0] = 0.1 * range_v;
        let mut chain = Model::new(0.0, range_v);
        let mut add = |effect, values: &[f64]| {
            chain.add(EffectInstance::new(effect, &overview, values));
        };
        add(by_id("hysteresis").unwrap(), &surfaces);
        add(by_id("vibration").unwrap(), &[5000.0, 0.5]);
        add(
            plays,
            &[
                0.02 * range_v,
                3.0 / range_v,
                0.01 * range_v,
                12.0 / range_v,
            ],
        );
        chain
    }

    #[test]
    fn gain_of_kinks_is_the_same_over_any_range() {
        let (wide, narrow) = (with_kinks(70.0), with_kinks(50.0));
        let design = actuator_model(&wide).unwrap().for_the_tick().0;
        let same = gain_ratio(&design, &wide, true).unwrap();
        let other = gain_ratio(&design, &narrow, true).unwrap();
        for (a, b) in same.into_iter().zip(other) {
            assert!((a - b).abs() < 1e-9, "{same:?} {other:?}");
        }
        assert!(0.8 < same[0] && same[2] < 1.2, "{same:?}");
    }

    fn found(stable: bool, poles: &[f64], unstable_because: Option<&str>) -> CheckResult {
        CheckResult {
            schema: String::new(),
            scheme: String::new(),
            stable,
            unstable_because: unstable_because.map(Into::into),
            sampled_poles: poles.iter().map(|re| [*re, 0.0]).collect(),
            continuous: ContinuousConditions::default(),
            margins: None,
            on_plants: None,
            remarks: Vec::new(),
        }
    }

    #[test]
    fn no_verdict_of_unstable_stands_beside_a_stable_eigenvalue_alone() {
        let learning = found(false, &[0.9753, -0.3], Some("learning diverges"));
        assert_eq!(
            learning.verdict(),
            "UNSTABLE: learning diverges (the largest eigenvalue with the mean gain, 0.9753, is stable)"
        );
        assert_eq!(
            found(false, &[1.2], Some("it is 1.2000")).verdict(),
            "UNSTABLE: it is 1.2000"
        );
        assert_eq!(
            found(true, &[0.9], None).verdict(),
            "stable, largest sampled eigenvalue 0.9000"
        );
        assert_eq!(found(false, &[], None).verdict(), "not judged");
        let mut both = found(true, &[], None);
        both.judge_poles(&[Complex::new(0.0, 1.01)], "with the mean gain");
        both.fails("another".into());
        assert_eq!(
            both.verdict(),
            "UNSTABLE: the largest eigenvalue with the mean gain is 1.0100"
        );
    }
}
