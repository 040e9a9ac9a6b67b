//! What every effect does to the reading: its signature on the drives of the simulated data sets, and which
//! other effects look like it there.
//!
//! A signature is the reading with the effect less the reading without it. What a gain and an offset would
//! take up is projected out; of a structure of loops what remains of it beside a straight line. Two effects
//! imitate each other where the cosine between their signatures, with every record counting alike, is large
//! in magnitude: data like these then tell them apart by little more than the shape of what is left.

use super::case::{reference_overview, reference_surfaces, square_force};
use super::drives::{DriveOfRecord, drives};
use crate::error::Result;
use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::hysteresis::Hysteresis;
use hysteron_sim::effect::{
    Declaration, Effect, Parameter, PlantedCase, Scale, SimulatedStage, gain, registry, vibration,
};
use std::sync::Arc;

/// First mode of the actuator that the signatures are simulated on, rad/s and damping ratio.
const MODE: [f64; 2] = [5000.0, 0.5];
/// Height of the drives, V.
const DRIVE_MAX_V: f64 = 70.0;
/// Strength at which effects are simulated, in the units of planted cases: well above noise, small against
/// the motion.
const STRENGTH: f64 = 3.0;
/// Records on which signatures are taken: loops, dynamics, holds, all of them together.
const RECORDS: [&str; 4] = ["stair", "multisine", "hold", "validation"];
/// Signatures with a cosine of this magnitude or more are called alike.
const ALIKE: f64 = 0.7;

/// An effect's signature on one record.
#[derive(Clone, Debug)]
pub struct SignatureOnRecord {
    /// Name of the record.
    pub record: &'static str,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Drive, V.
    pub drive_v: Vec<f64>,
    /// What the effect adds to the reading, um, less what gain and offset take up.
    pub signature_um: Vec<f64>,
}

/// An effect with what it does.
#[derive(Clone, Debug)]
pub struct Signature {
    /// What it says of itself.
    pub declaration: Declaration,
    /// Its parameters, with the values of this simulation.
    pub parameters: Vec<(Parameter, f64)>,
    /// By record.
    pub records: Vec<SignatureOnRecord>,
    /// Other effects that look alike, with the cosine, the likest first.
    pub alike: Vec<(String, f64)>,
}

impl Signature {
    /// The record in which it is largest, of those that an eye can follow.
    #[must_use]
    pub fn clearest(&self) -> Option<&SignatureOnRecord> {
        let followed = self.records.iter().filter(|on| on.record != "multisine");
        followed.max_by(|a, b| {
            mean_product(&a.signature_um, &a.signature_um)
                .total_cmp(&mean_product(&b.signature_um, &b.signature_um))
        })
    }
}

fn mean_product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len().max(1) as f64
}

/// A signal without its mean and without what is proportional to another one.
fn beside(signal: &[f64], line: &[f64]) -> Vec<f64> {
    let centred = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        values.iter().map(|v| v - mean).collect::<Vec<f64>>()
    };
    let (signal, line) = (centred(signal), centred(line));
    let power = mean_product(&line, &line);
    let slope = if power > 0.0 {
        mean_product(&signal, &line) / power
    } else {
        0.0
    };
    signal
        .iter()
        .zip(&line)
        .map(|(s, l)| s - slope * l)
        .collect()
}

/// Signatures of all built-in effects.
///
/// # Errors
/// When the reference actuator cannot be read.
pub fn signatures() -> Result<Vec<Signature>> {
    let overview = reference_overview(DRIVE_MAX_V);
    let (loops_um, remnant_um) = reference_surfaces(DRIVE_MAX_V, 1.0)?;
    let [natural_frequency_rad_s, damping_ratio] = MODE;
    let stage = SimulatedStage {
        overview: overview.clone(),
        natural_frequency_rad_s,
        damping_ratio,
        remnant_um,
    };
    let mut base = Model::new(0.0, DRIVE_MAX_V);
    base.add(EffectInstance::new(
        Arc::new(Hysteresis { degree: 4 }),
        &overview,
        &loops_um,
    ));
    let mode: Arc<dyn Effect> = Arc::new(vibration::Vibration);
    base.add(EffectInstance::new(mode, &overview, &MODE));
    let mut line = Model::new(0.0, DRIVE_MAX_V);
    line.add(EffectInstance::new(
        Arc::new(gain::Gain),
        &overview,
        &[overview.gain_um_v],
    ));
    let driven: Vec<DriveOfRecord> = drives(DRIVE_MAX_V, 1)
        .into_iter()
        .filter(|d| RECORDS.contains(&d.name))
        .collect();
    let mut found: Vec<Signature> = Vec::new();
    for effect in registry() {
        let declaration = effect.declaration();
        // A structure of loops is seen against a straight line, and so is the mode that the others stand
        // beside.
        let alone = declaration.is_main() || declaration.id == vibration::ID;
        let without = if alone { &line } else { &base };
        let values = match declaration.id.as_str() {
            id if id == vibration::ID => MODE.to_vec(),
            hysteron_sim::effect::hysteresis::ID => loops_um.clone(),
            _ => example_values(effect.as_ref(), &stage),
        };
        let effect = if declaration.id == hysteron_sim::effect::hysteresis::ID {
            Arc::new(Hysteresis { degree: 4 })
        } else {
            effect
        };
        let instance = EffectInstance::new(effect, &overview, &values);
        let parameters = instance
            .parameters
            .iter()
            .map(|p| (p.parameter.clone(), p.value))
            .collect();
        let mut with = without.clone();
        with.add(instance);
        let records = driven
            .iter()
            .map(|drive| on_record(&with, without, drive))
            .collect();
        found.push(Signature {
            declaration,
            parameters,
            records,
            alike: Vec::new(),
        });
    }
    let lists: Vec<Vec<(String, f64)>> = found.iter().map(|one| alike(one, &found)).collect();
    found
        .iter_mut()
        .zip(lists)
        .for_each(|(one, list)| one.alike = list);
    Ok(found)
}

/// Values with which an effect is visible: those of planted cases, else its first start, else, beside values
/// that are fixed, two steps of every coefficient that starts at zero.
fn example_values(effect: &dyn Effect, stage: &SimulatedStage) -> Vec<f64> {
    let overview = &stage.overview;
    let values = effect
        .values_at(&mut PlantedCase {
            strength: STRENGTH,
            stage,
            random: &mut || 0.5,
        })
        .or_else(|| effect.starts(overview).into_iter().next())
        .unwrap_or_default();
    let parameters = effect.parameters(overview);
    if values
        .iter()
        .zip(&parameters)
        .any(|(value, p)| *value != 0.0 && !p.fixed)
    {
        return values;
    }
    let begun = |(i, p): (usize, &Parameter)| match (p.fixed, p.scale) {
        (true, _) => values.get(i).copied().unwrap_or(0.0),
        (false, Scale::Linear(step)) => 2.0 * step,
        (false, Scale::Logarithmic) => p.lower,
    };
    parameters.iter().enumerate().map(begun).collect()
}

fn on_record(with: &Model, without: &Model, drive: &DriveOfRecord) -> SignatureOnRecord {
    let force_n = square_force(drive.drive_v.len(), drive.rate_hz);
    let record = Drive {
        force_n: Some(&force_n),
        ..Drive::held(&drive.drive_v, 1.0 / drive.rate_hz, InitialState::Virgin)
    };
    let (read, bare) = (with.simulate(&record), without.simulate(&record));
    let difference: Vec<f64> = read.iter().zip(&bare).map(|(a, b)| a - b).collect();
    SignatureOnRecord {
        record: drive.name,
        rate_hz: drive.rate_hz,
        drive_v: drive.drive_v.clone(),
        signature_um: beside(&difference, &bare),
    }
}

/// The effects whose signatures are like one's, over all records alike.
fn alike(one: &Signature, all: &[Signature]) -> Vec<(String, f64)> {
    let product = |a: &Signature, b: &Signature| -> f64 {
        a.records
            .iter()
            .zip(&b.records)
            .map(|(a, b)| mean_product(&a.signature_um, &b.signature_um))
            .sum()
    };
    let own = product(one, one);
    let mut list: Vec<(String, f64)> = all
        .iter()
        .filter(|other| other.declaration.id != one.declaration.id)
        .map(|other| {
            (
                other.declaration.id.clone(),
                product(one, other) / (own * product(other, other)).sqrt(),
            )
        })
        .filter(|(_, cosine)| cosine.abs() >= ALIKE)
        .collect();
    list.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lags_look_alike_and_hum_looks_like_nothing() {
        let found = signatures().unwrap();
        let of = |id: &str| found.iter().find(|s| s.declaration.id == id).unwrap();
        let likes = |a: &str, b: &str| of(a).alike.iter().any(|(id, _)| id == b);
        assert!(
            likes("sensor_bandwidth", "amplifier_bandwidth")
                && likes("amplifier_bandwidth", "sensor_bandwidth")
        );
        assert!(
            of("mains_hum").alike.is_empty(),
            "{:?}",
            of("mains_hum").alike
        );
        for one in &found {
            // A gain is what is projected out; below zero nothing was driven here.
            if !["gain", "bipolar", "two_sided"].contains(&one.declaration.id.as_str()) {
                let clearest = one.clearest().unwrap();
                let rms_um = mean_product(&clearest.signature_um, &clearest.signature_um).sqrt();
                assert!(
                    rms_um > 1e-4,
                    "{} shows nothing: {rms_um} um",
                    one.declaration.id
                );
            }
        }
    }
}
