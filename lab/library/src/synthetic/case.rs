//! A simulated data set with known effects: the example that the project ships, and each of the cases that
//! the diagnosis is scored on.
//!
//! The plant is the chain of the reference actuator with random frequency, damping, gain and noise. It is
//! stepped in 12.5 us, four times as finely as the fastest record, so that a model identified from the
//! records does not share the discretisation of its truth. Its hysteresis may have another structure than the
//! surfaces that are fitted, and it may have effects that no library knows ([`outside_library`]).

use super::drives::{DriveOfRecord, drives, manifest};
use crate::dataset::reading_grid::rounding_noise;
use crate::error::{Error, Result};
use crate::model_file::effect_named;
use hysteron_sim::bench::Bench;
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::hysteresis::{self, Hysteresis};
use hysteron_sim::effect::{
    Declaration, Effect, Overview, Place, PlantedCase, SimulatedStage, by_id, gain,
};
use hysteron_sim::hysteresis_surface::{Surfaces, loop_terms, shifted_legendre};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Truth of one case, in the form in which `score` reads it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Truth {
    /// Folder of the case, relative to the truth file.
    pub name: String,
    /// The hidden effect; none if nothing is missing.
    pub hidden: Option<String>,
    /// Effects that are missing with it.
    #[serde(default)]
    pub also: Vec<String>,
    /// Second hidden effect.
    #[serde(default)]
    pub second: Option<String>,
    /// Third hidden effect.
    #[serde(default)]
    pub third: Option<String>,
    /// What the user already models.
    pub base: Vec<String>,
    /// Standard deviation of the noise.
    pub noise_um: f64,
    /// Strength of the hidden effect.
    #[serde(default)]
    pub strength: f64,
    /// How much the hidden effect changes each record.
    #[serde(default)]
    pub effect_rms_um: Vec<(String, f64)>,
}

/// Step of the plant, s.
const PLANT_STEP_S: f64 = 12.5e-6;

/// What is planted.
#[derive(Clone, Debug)]
pub struct CaseOrder {
    /// Hidden effects with their strengths.
    pub hidden: Vec<(String, f64)>,
    /// Effects that the user already models.
    pub base: Vec<String>,
    /// Structure of the hysteresis: `hysteresis` for the thesis' surfaces, or another effect of that place.
    pub hysteresis: String,
    /// Seed of noise and parameters.
    pub seed: u64,
}

/// Kinds that no library knows: a spring that presses back beyond a displacement, and a gain that flutters
/// with time.
pub const OUTSIDE_LIBRARY: [&str; 2] = ["outside_library_contact", "outside_library_gain_flutter"];

/// An effect that no library knows, by its expressions, and its values at a strength.
fn outside_library(
    id: &str,
    strength: f64,
    random: &mut Pcg64Mcg,
) -> Option<(Arc<dyn Effect>, Vec<f64>)> {
    let number = |name: &str| {
        format!("[[parameter]]\nname = \"{name}\"\nlower = 0.0\nupper = 1000.0\nstarts = [1.0]\n")
    };
    let (place, output, names, values) = match id {
        "outside_library_contact" => {
            let gap_um = 5.0 + 2.0 * random.random::<f64>();
            (
                "load_force",
                "x - stiffness * max(x - gap_um, 0)",
                ["stiffness", "gap_um"],
                vec![0.1 * strength, gap_um],
            )
        }
        "outside_library_gain_flutter" => {
            let frequency_hz = 30.0 + 30.0 * random.random::<f64>();
            (
                "sensor_nonlinearity",
                "x * (1 + depth * sin(2 * PI * hertz * t))",
                ["depth", "hertz"],
                vec![0.006 * strength, frequency_hz],
            )
        }
        _ => return None,
    };
    let text = format!(
        "id = \"{id}\"\nplace = \"{place}\"\noutput = \"{output}\"\n{}",
        names.iter().map(|n| number(n)).collect::<String>()
    );
    let effect = hysteron_sim::effect::expression::ExpressionEffect::from_toml(&text).ok()?;
    Some((Arc::new(effect), values))
}

/// A hysteresis of another structure than the fitted surfaces, with random values.
fn other_hysteresis(
    id: &str,
    overview: &Overview,
    random: &mut Pcg64Mcg,
) -> Option<(Arc<dyn Effect>, Vec<f64>)> {
    let effect = by_id(id).filter(|e| e.declaration().is_main())?;
    let values = effect
        .starts(overview)
        .first()?
        .iter()
        .map(|v| v * (0.7 + 0.6 * random.random::<f64>()))
        .collect();
    Some((effect, values))
}

/// The reference actuator with random values, with these effects.
struct Plant {
    model: Model,
    noise_um: f64,
}

/// What is known of the data that are simulated.
pub(super) fn reference_overview(drive_max_v: f64) -> Overview {
    Overview {
        drive_min_v: 0.0,
        drive_max_v,
        drive_peak_v: drive_max_v,
        sample_rate_max_hz: 20_000.0,
        sample_rate_min_hz: 200.0,
        duration_s: 40.0,
        range_um: 11.0,
        slope_max_v_s: 3e4,
        has_force: true,
        gain_um_v: 0.15,
        sensor_bandwidth_hz: None,
        several_speeds: true,
    }
}

/// Legendre coefficients of the bench's surfaces, times a factor.
pub(super) fn reference_surfaces(drive_max_v: f64, factor: f64) -> Result<(Vec<f64>, Vec<f64>)> {
    let bench = Bench::reference().map_err(|e| Error::new("bench.toml", e))?;
    let surfaces =
        Surfaces::from_thesis_powers(&bench.hysteresis.f, &bench.hysteresis.g, drive_max_v);
    // The surfaces are polynomials of the same space: solve for the coefficients at as many points as there
    // are.
    let terms: Vec<(usize, usize)> = loop_terms(4).collect();
    let legendre: Vec<Vec<f64>> = (0..4).map(shifted_legendre).collect();
    let p = |k: usize, v: f64| hysteron_sim::hysteresis_surface::horner(&legendre[k], v);
    let points: Vec<(f64, f64)> = (1..=12)
        .flat_map(|i| (0..i).map(move |j| (f64::from(i) / 12.0, f64::from(j) / 12.0)))
        .collect();
    let a = nalgebra::DMatrix::from_fn(points.len(), terms.len(), |r, c| {
        let ((x, z), (i, j)) = (points[r], terms[c]);
        (x - z) * p(i, x) * p(j, z)
    });
    let b = nalgebra::DVector::from_fn(points.len(), |r, _| {
        factor * surfaces.loop_loss(points[r].0, points[r].1)
    });
    let g = a
        .svd(true, true)
        .solve(&b, 1e-12)
        .map_err(|e| Error::new("bench.toml", e))?;
    let a = nalgebra::DMatrix::from_fn(12, 4, |r, c| {
        (r + 1) as f64 / 12.0 * p(c, (r + 1) as f64 / 12.0)
    });
    let b = nalgebra::DVector::from_fn(12, |r, _| {
        let x = (r + 1) as f64 / 12.0;
        factor * (surfaces.initial_ascending_curve(x) - surfaces.loop_loss(x, 0.0))
    });
    let r = a
        .svd(true, true)
        .solve(&b, 1e-12)
        .map_err(|e| Error::new("bench.toml", e))?;
    Ok((g.as_slice().to_vec(), r.as_slice().to_vec()))
}

/// A simulated case: its truth, and its files by name (records, `dataset.toml`, `base_effects.txt`,
/// `truth.json`).
#[derive(Clone, Debug)]
pub struct SyntheticCase {
    /// What was hidden, and what an honest answer may reach.
    pub truth: Truth,
    /// The files of its folder.
    pub files: BTreeMap<String, Vec<u8>>,
}

/// What belongs to the thesis' surfaces has no place beside another structure of loops, which has a first
/// rise of its own.
pub(super) fn belongs_to_surfaces(declaration: &Declaration) -> bool {
    declaration.place == Place::Hysteresis && declaration.modifies == Some(hysteresis::ID)
}

/// Simulates a data set that is called `name`.
///
/// # Errors
/// An effect that is not known.
/// ```
/// use hysteron::{CaseOrder, simulate_case};
///
/// let order = CaseOrder {
///     hidden: vec![("creep".into(), 2.0)],
///     base: vec!["hysteresis".into(), "vibration".into()],
///     hysteresis: "hysteresis".into(),
///     seed: 1,
/// };
/// let case = simulate_case(&order, "stage")?;
/// assert!(case.files.len() > 1);
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn simulate_case(order: &CaseOrder, name: &str) -> Result<SyntheticCase> {
    let CaseOrder {
        hidden,
        base,
        hysteresis,
        seed,
    } = order;
    let seed = *seed;
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let drive_max_v = 70.0;
    let overview = reference_overview(drive_max_v);
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let natural_frequency_rad_s = uniform(3000.0, 7000.0);
    let damping_ratio = uniform(0.25, 0.8);
    let noise_um = uniform(0.003, 0.006);
    let (loops_um, remnant_um) = reference_surfaces(drive_max_v, uniform(0.8, 1.2))?;
    let stage = SimulatedStage {
        overview: overview.clone(),
        natural_frequency_rad_s,
        damping_ratio,
        remnant_um,
    };
    let mut plant = Plant {
        model: Model::new(0.0, drive_max_v),
        noise_um,
    };
    if hysteresis == hysteresis::ID {
        plant.model.add(EffectInstance::new(
            Arc::new(Hysteresis { degree: 4 }),
            &overview,
            &loops_um,
        ));
    } else {
        let (effect, values) =
            other_hysteresis(hysteresis, &overview, &mut random).ok_or_else(|| {
                Error::new(
                    "hysteresis",
                    format!("`{hysteresis}` is no structure of hysteresis"),
                )
            })?;
        // Thresholds of elements must not lie where a model would look for them.
        plant.model.drive_max_v *= 1.15 + 0.1 * random.random::<f64>();
        plant
            .model
            .add(EffectInstance::new(effect, &overview, &values));
    }
    let also: Vec<String> = hidden
        .iter()
        .filter_map(|(id, _)| by_id(id))
        .flat_map(|e| e.declaration().comes_with)
        .map(|id| (*id).to_owned())
        .collect();
    let mut wanted: Vec<(String, f64)> = base.iter().map(|id| (id.clone(), 1.5)).collect();
    wanted.extend(hidden.iter().cloned());
    wanted.extend(also.iter().map(|id| (id.clone(), 1.0)));
    for (id, strength) in &wanted {
        if let Some((effect, values)) = outside_library(id, *strength, &mut random) {
            plant
                .model
                .add(EffectInstance::new(effect, &overview, &values));
            continue;
        }
        let effect = effect_named(id)?;
        let declaration = effect.declaration();
        let without_surfaces =
            plant.model.effect(hysteresis::ID).is_none() && belongs_to_surfaces(&declaration);
        if [hysteresis::ID, gain::ID].contains(&declaration.id.as_str()) || without_surfaces {
            continue;
        }
        let values = effect
            .values_at(&mut PlantedCase {
                strength: *strength,
                stage: &stage,
                random: &mut || random.random::<f64>(),
            })
            .unwrap_or_default();
        plant
            .model
            .add(EffectInstance::new(effect, &overview, &values));
    }
    // The converter reads what the noise has been added to.
    let converter = plant
        .model
        .effects
        .iter()
        .find(|e| e.effect.declaration().place == Place::Quantisation);
    let lsb_um = converter.map_or(0.0, |e| e.values()[0]);
    plant.model = plant.model.before_rounding().into_owned();
    let noise_um = plant.noise_um.hypot(rounding_noise(lsb_um));
    let with_force = plant
        .model
        .effects
        .iter()
        .any(|e| e.effect.declaration().needs_force);
    let mut without = plant.model.clone();
    without
        .effects
        .retain(|e| e.effect.declaration().is_main() || !hidden.iter().any(|(id, _)| *id == e.id));
    let mut truth = Truth {
        name: ".".into(),
        hidden: hidden.first().map(|(id, _)| id.clone()),
        also,
        second: hidden.get(1).map(|(id, _)| id.clone()),
        third: hidden.get(2).map(|(id, _)| id.clone()),
        base: base.to_vec(),
        noise_um,
        strength: hidden.first().map_or(0.0, |(_, s)| *s),
        effect_rms_um: Vec::new(),
    };
    let mut files = BTreeMap::new();
    let planned_drives = drives(drive_max_v, seed);
    for planned in &planned_drives {
        let force = with_force.then(|| square_force(planned.drive_v.len(), planned.rate_hz));
        let clean = finely(&plant.model, planned, force.as_deref());
        let bare = finely(&without, planned, force.as_deref());
        let rounded = |y: &f64| {
            Converter {
                noise_um: 0.0,
                lsb_um,
            }
            .read(*y)
        };
        let difference: Vec<f64> = clean
            .iter()
            .zip(&bare)
            .map(|(a, b)| rounded(a) - b)
            .collect();
        truth.effect_rms_um.push((
            planned.name.into(),
            crate::identification::fit::rms(&difference),
        ));
        let converter = Converter {
            noise_um: plant.noise_um,
            lsb_um,
        };
        let record = record_csv(planned, &clean, force.as_deref(), &converter, &mut random);
        files.insert(format!("{}.csv", planned.name), record.into_bytes());
    }
    files.insert(
        "dataset.toml".into(),
        manifest(name, 0.0, drive_max_v, &planned_drives).into_bytes(),
    );
    files.insert(
        "base_effects.txt".into(),
        (base.join("\n") + "\n").into_bytes(),
    );
    files.insert(
        "truth.json".into(),
        truths_json(std::slice::from_ref(&truth))?,
    );
    Ok(SyntheticCase { truth, files })
}

/// The text of a truth file.
///
/// # Errors
/// When a figure is no number.
pub fn truths_json(truths: &[Truth]) -> Result<Vec<u8>> {
    let json = serde_json::to_string_pretty(truths).map_err(|e| Error::new("truth.json", e))?;
    Ok((json + "\n").into_bytes())
}

pub(super) fn square_force(samples: usize, rate_hz: f64) -> Vec<f64> {
    (0..samples)
        .map(|k| {
            if (k as f64 / rate_hz).rem_euclid(0.77) > 0.36 {
                10.0
            } else {
                0.0
            }
        })
        .collect()
}

fn finely(model: &Model, planned: &DriveOfRecord, force_n: Option<&[f64]>) -> Vec<f64> {
    let dt_s = 1.0 / planned.rate_hz;
    let drive = Drive {
        force_n,
        ..Drive::held(&planned.drive_v, dt_s, InitialState::Virgin)
    };
    model.simulate_finely(&drive, (dt_s / PLANT_STEP_S).round() as usize)
}

/// What stands between the displacement and its record.
struct Converter {
    noise_um: f64,
    lsb_um: f64,
}

impl Converter {
    fn read(&self, noisy_um: f64) -> f64 {
        if self.lsb_um > 0.0 {
            (noisy_um / self.lsb_um).round() * self.lsb_um
        } else {
            noisy_um
        }
    }
}

fn record_csv(
    planned: &DriveOfRecord,
    clean: &[f64],
    force_n: Option<&[f64]>,
    converter: &Converter,
    random: &mut Pcg64Mcg,
) -> String {
    use rand_distr::{Distribution, StandardNormal};
    let mut text = String::from(if force_n.is_some() {
        "t_s,u_v,y_um,force_n\n"
    } else {
        "t_s,u_v,y_um\n"
    });
    for (k, (u, y)) in planned.drive_v.iter().zip(clean).enumerate() {
        let noise: f64 = StandardNormal.sample(random);
        let t = k as f64 / planned.rate_hz;
        text.push_str(&format!(
            "{t:.5},{u:.5},{:.5}",
            converter.read(y + converter.noise_um * noise)
        ));
        if let Some(force) = force_n {
            text.push_str(&format!(",{}", force[k]));
        }
        text.push('\n');
    }
    text
}
