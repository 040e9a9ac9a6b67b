//! Stick-slip rigs with a hidden effect, by two sets of equations, and what the search names.
//!
//! Five rigs differ by 30 % in friction, mass, preload and width of the loops. Each is identified from
//! recordings before anything happens to it. Then it is altered, recorded again and diagnosed with the model
//! from before. The loops of a LuGre rig have no exact model: its platform is identified from a recording of its
//! own, with surfaces and play operators.

use crate::stick_slip_study::{Equations, MASS_KG, chapter_3};
use hysteron::dataset::{Dataset, Record};
use hysteron::rig_diagnosis::planted::{
    NOISE_UM, SAMPLE_RATE_HZ, mark, planted_effects, recorded, rig_drives, said,
};
use hysteron::rig_diagnosis::{RigData, diagnose_rig};
use hysteron::servo::stepping_contact::{identify_contact, rig_on_platform};
use hysteron::statistics::rms;
use hysteron::{Policy, Unwatched, WhiteNoise, effects_named, identify};
use hysteron_sim::closed_loop::Plant;
use hysteron_sim::effect::hysteresis::Hysteresis;
use hysteron_sim::effect::initial_curve::InitialCurve;
use hysteron_sim::effect::play_operators::PlayOperatorsBeside;
use hysteron_sim::rig_effects::{RIG_EFFECTS, RigEffects};
use hysteron_sim::stick_slip::StickSlipActuator;
use hysteron_sim::waveform::{concatenate, hold, saw_tooth, triangles};
use hysteron_tests::lugre_rig::{Alteration, LugreRig, RigFactors};
use std::sync::Arc;

/// Degree of the surfaces of its loops. With play operators beside them they miss 0.4 to 1.4 nm under the drives
/// of a diagnosis, without 0.7 to 2.9 nm, and with degree 4 6 to 28 nm.
const LOOP_DEGREE: usize = 8;
/// Heights of the triangles under which the platform is recorded.
const HEIGHTS: u32 = 10;
/// Seed of the drives under which the contact is identified.
const CONTACT_SEED: u64 = 800;

/// Heights of the saw-teeth of chapter 3, Fig. 4, and how many of each.
const FIGURE_4_V: [f64; 3] = [30.0, 50.0, 60.0];
const FIGURE_4_CYCLES: usize = 12;

/// A rig with the model from before it was altered.
pub struct ModelledRig {
    equations: Equations,
    factors: RigFactors,
    /// The model.
    pub start: StickSlipActuator,
}

/// What happens to a LuGre rig.
fn alteration(effects: &RigEffects, mut factors: RigFactors) -> (RigFactors, Alteration) {
    /// Stroke that goes through plays, um.
    const PLAYED_UM: f64 = 0.3 * 13.5;
    factors.preload *= 1.0 + effects.preload_share;
    factors.friction *= 1.0 + effects.friction_share;
    factors.mass *= 1.0 + effects.slider_mass_share;
    factors.hysteresis *= 1.0 + effects.element_loops_um / PLAYED_UM;
    let altered = Alteration {
        contact_stiffness: effects.contact_stiffness_share,
        breakaway: effects.stribeck_share,
        tilt_rad: effects.tilt_rad,
        guide_n_um: effects.guide_stiffness_n_um,
        guide_n_s_um: effects.guide_viscosity_n_s_um,
        contact_n_s_um: effects.contact_viscosity_n_s_um,
        wear_per_um: effects.wear_per_um,
        gain: effects.element_gain_share,
        creep: effects.element_creep_share,
        scale: effects.sensor_scale_share,
        lag_s: effects.sensor_lag_s,
        slip_um: effects.sensor_slip_um,
        delay_s: effects.delay_s,
    };
    (factors, altered)
}

/// Readings of platform and slider of a LuGre rig.
fn lugre_um(factors: RigFactors, effects: &RigEffects, drive_v: &[f64]) -> [Vec<f64>; 2] {
    let (factors, altered) = alteration(effects, factors);
    let mut rig = LugreRig::altered_at_rest(factors, altered, 1.0 / SAMPLE_RATE_HZ);
    let mut out = [Vec::new(), Vec::new()];
    for u in drive_v {
        out[0].push(rig.platform_um());
        out[1].push(rig.sensor_um());
        rig.advance(*u, 0.0);
    }
    out
}

fn noisy(signal: Vec<f64>, seed: u64) -> Vec<f64> {
    let mut noise = WhiteNoise::new(NOISE_UM, seed);
    signal.into_iter().map(|um| um + noise.next_um()).collect()
}

/// The model of a LuGre rig's platform, from a recording without the slider.
fn lugre_platform(factors: RigFactors) -> Result<StickSlipActuator, String> {
    let rest = hold(SAMPLE_RATE_HZ, 0.0, 0.02);
    // Falls from every height, and rises again from every depth.
    let heights = (1..=HEIGHTS).map(|nth| 100.0 * f64::from(nth) / f64::from(HEIGHTS));
    let falls = heights.clone().flat_map(|height_v| [height_v, 0.0]);
    let rises = heights.rev().flat_map(|depth_v| [100.0, depth_v]);
    let vertices: Vec<f64> = [0.0]
        .into_iter()
        .chain(falls)
        .chain(rises)
        .chain([100.0, 0.0])
        .collect();
    let drive_v = concatenate(&[
        rest.clone(),
        triangles(SAMPLE_RATE_HZ, 2000.0, &vertices),
        hold(SAMPLE_RATE_HZ, 40.0, 0.03),
        rest.clone(),
        hold(SAMPLE_RATE_HZ, 90.0, 0.03),
        rest,
    ]);
    // Nothing rides on it.
    let alone = RigFactors {
        friction: 1e-9,
        preload: 1e-9,
        ..factors
    };
    let [platform_um, _] = lugre_um(alone, &RigEffects::default(), &drive_v);
    let record = Record::new("platform", SAMPLE_RATE_HZ, drive_v, noisy(platform_um, 5));
    let message = |error: hysteron::Error| error.to_string();
    let dataset =
        Dataset::new("platform", 0.0, 100.0, vec![record.from_virgin_state()]).map_err(message)?;
    let degree = LOOP_DEGREE;
    let mut effects = effects_named("vibration").map_err(message)?;
    effects.push(Arc::new(Hysteresis { degree }));
    effects.push(Arc::new(InitialCurve { terms: degree }));
    effects.push(Arc::new(PlayOperatorsBeside::default()));
    let platform = identify(&dataset, &effects, &Unwatched).map_err(message)?;
    rig_on_platform(&platform.model, 45.0, MASS_KG * factors.mass)
}

impl ModelledRig {
    /// One of the five rigs, identified.
    ///
    /// # Errors
    /// Its recordings do not determine its model.
    pub fn identified(equations: Equations, nth: usize) -> Result<Self, String> {
        let factors = RigFactors::FIVE[nth % RigFactors::FIVE.len()];
        let start = match equations {
            Equations::Chapter3 => chapter_3(factors),
            Equations::Lugre => lugre_platform(factors)?,
        };
        let mut this = Self {
            equations,
            factors,
            start,
        };
        // Teeth of several heights there and back: those of one height show the friction at one velocity.
        let drives = rig_drives(CONTACT_SEED).into_iter().take(2);
        let drive_v = concatenate(&drives.map(|(_, _, drive_v)| drive_v).collect::<Vec<_>>());
        let reading_um = noisy(this.reading_um(&RigEffects::default(), &drive_v), 11);
        let contact = identify_contact(&this.start, &drive_v, &reading_um, SAMPLE_RATE_HZ)?;
        this.start = contact.on(&this.start);
        Ok(this)
    }

    fn reading_um(&self, effects: &RigEffects, drive_v: &[f64]) -> Vec<f64> {
        match self.equations {
            Equations::Chapter3 => {
                let rig = StickSlipActuator {
                    effects: *effects,
                    ..chapter_3(self.factors)
                };
                rig.simulate(drive_v, SAMPLE_RATE_HZ).reading_um
            }
            Equations::Lugre => lugre_um(self.factors, effects, drive_v)[1].clone(),
        }
    }

    /// RMS of what the model misses of the slider under the saw-teeth of chapter 3, Fig. 4, without noise, and
    /// of the slider's way, um.
    #[must_use]
    pub fn saw_tooth_error_um(&self) -> [f64; 2] {
        let (mut errors_um, mut ways_um) = (Vec::new(), Vec::new());
        for height_v in FIGURE_4_V {
            let drive_v = saw_tooth(SAMPLE_RATE_HZ, 60.0, height_v, 1.0, FIGURE_4_CYCLES);
            let true_um = self.reading_um(&RigEffects::default(), &drive_v);
            let ours_um = self.start.simulate(&drive_v, SAMPLE_RATE_HZ).reading_um;
            errors_um.extend(true_um.iter().zip(ours_um).map(|(a, b)| a - b));
            ways_um.extend(true_um);
        }
        [rms(&errors_um), rms(&ways_um)]
    }

    /// Recordings of it with these effects.
    ///
    /// # Errors
    /// A reading is not finite.
    pub fn dataset(&self, effects: &RigEffects, seed: u64) -> Result<Dataset, String> {
        recorded("rig", seed, &mut |drive_v| {
            self.reading_um(effects, drive_v)
        })
        .map_err(|error| error.to_string())
    }

    /// What the search finds in recordings of it.
    ///
    /// # Errors
    /// The recordings do not suit the model.
    pub fn diagnosed(
        &self,
        dataset: &Dataset,
    ) -> Result<hysteron::rig_diagnosis::RigDiagnosis, String> {
        let policy = Policy::default();
        RigData::new(dataset, self.start.drive_range_v, policy.walked_samples)
            .and_then(|data| diagnose_rig(&data, &self.start, &policy, &Unwatched))
            .map_err(|error| error.to_string())
    }

    /// Head of a table of cases.
    pub const COLUMNS: &'static str =
        "equations,effect,seed,verdict,reported,mark,before_nm,after_nm,times_noise";

    /// A case: its row, its mark and how many times the noise is left. No effect is a rig in which nothing is
    /// missing.
    ///
    /// # Errors
    /// As [`Self::dataset`] and [`Self::diagnosed`].
    pub fn row(
        &self,
        effect: Option<usize>,
        seed: u64,
    ) -> Result<(String, &'static str, f64), String> {
        let planted = effect.map_or_else(RigEffects::default, |nth| {
            planted_effects(&RIG_EFFECTS[nth], seed)
        });
        let found = self.diagnosed(&self.dataset(&planted, seed)?)?;
        let truth = effect.map(|nth| RIG_EFFECTS[nth].id);
        let before = found.residual_rms_um.validate.unwrap_or(f64::NAN);
        let mark = mark(&found, truth);
        let times_noise = found.remainder.times_noise.unwrap_or(f64::NAN);
        let row = format!(
            "{},{},{seed},{},{},{},{:.2},{:.2},{times_noise:.3}",
            self.equations.name(),
            truth.unwrap_or("nothing"),
            found.verdict.word(),
            said(&found),
            mark,
            1e3 * before,
            1e3 * found.remainder.rms_um,
        );
        Ok((row, mark, times_noise))
    }
}
