//! The physical effects of a piezoelectric positioning system, one file each, and their registry.
//!
//! An effect declares its properties ([`Declaration`], [`Parameter`]), gives the values from which it is
//! looked for ([`Effect::starts`]) and builds a [`Stage`] that walks along a signal. Fitting, diagnosis,
//! reports and the command line work from that alone. To add an effect: one file here, one line in
//! [`registry`].
//!
//! A *modifier* ([`Declaration::modifies`]) has no stage of its own where the effect that it modifies is in
//! the model: the initial ascending curve and the rate dependence are properties of the hysteresis stage, a
//! second mode of the vibration stage.

pub mod activated_switching;
pub mod amplifier_bandwidth;
mod arrival;
pub mod backlash;
pub mod bias_dependent_gain;
pub mod bipolar;
pub mod bouc_wen;
pub mod charge_leakage;
pub mod creep;
pub mod creep_operators;
pub mod creep_pole_pair;
pub mod delay;
pub mod duhem;
pub mod expression;
pub mod force_balance;
mod formula;
pub mod friction;
pub mod gain;
mod held_mass;
pub mod hum_harmonics;
pub mod hysteresis;
pub mod hysteretic_stiffness;
pub mod initial_curve;
pub mod inverse_preisach;
pub mod load_force;
pub mod logarithmic_creep;
pub mod mains_hum;
pub mod mass_change;
pub mod maxwell_slip;
mod mode;
pub mod nonlinear_damping;
pub mod nonlinear_stiffness;
pub mod play_operators;
pub mod polynomial_loop;
pub mod prandtl_ishlinskii;
pub mod quantisation;
pub mod rate_dependence;
pub mod rate_dependent_prandtl_ishlinskii;
pub mod rate_dependent_surfaces;
pub mod saturation;
pub mod second_mode;
pub mod sensor_bandwidth;
pub mod sensor_filter;
pub mod sensor_nonlinearity;
pub mod slew_limit;
pub mod thermal_drift;
pub mod two_sided;
pub mod vibration;

pub use crate::physics::*;
use std::sync::Arc;

/// Every built-in effect, in the order of the chain.
#[must_use]
pub fn registry() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(delay::Delay),
        Arc::new(amplifier_bandwidth::AmplifierBandwidth),
        Arc::new(slew_limit::SlewLimit),
        Arc::new(saturation::Saturation),
        Arc::new(charge_leakage::ChargeLeakage),
        Arc::new(gain::Gain),
        Arc::new(hysteresis::Hysteresis::default()),
        Arc::new(initial_curve::InitialCurve::default()),
        Arc::new(play_operators::PlayOperatorsBeside::default()),
        Arc::new(rate_dependence::RateDependence),
        Arc::new(rate_dependent_surfaces::RateDependentSurfaces::default()),
        Arc::new(bipolar::Bipolar),
        Arc::new(two_sided::TwoSided),
        Arc::new(prandtl_ishlinskii::PrandtlIshlinskii {
            one_sided_dead_zones: false,
        }),
        Arc::new(prandtl_ishlinskii::PrandtlIshlinskii {
            one_sided_dead_zones: true,
        }),
        Arc::new(rate_dependent_prandtl_ishlinskii::RateDependentPrandtlIshlinskii),
        Arc::new(maxwell_slip::MaxwellSlip),
        Arc::new(bouc_wen::BoucWen),
        Arc::new(duhem::Duhem),
        Arc::new(polynomial_loop::PolynomialLoop),
        Arc::new(inverse_preisach::InversePreisach),
        Arc::new(activated_switching::ActivatedSwitching),
        Arc::new(bias_dependent_gain::BiasDependentGain),
        Arc::new(load_force::LoadForce),
        Arc::new(backlash::Backlash),
        Arc::new(friction::Friction),
        Arc::new(nonlinear_stiffness::NonlinearStiffness),
        Arc::new(nonlinear_damping::NonlinearDamping),
        Arc::new(hysteretic_stiffness::HystereticStiffness),
        Arc::new(vibration::Vibration),
        Arc::new(second_mode::SecondMode),
        Arc::new(mass_change::MassChange),
        Arc::new(creep::Creep::default()),
        Arc::new(creep_pole_pair::CreepPolePair),
        Arc::new(logarithmic_creep::LogarithmicCreep),
        Arc::new(creep_operators::CreepOperators::default()),
        Arc::new(thermal_drift::ThermalDrift),
        Arc::new(sensor_nonlinearity::SensorNonlinearity),
        Arc::new(sensor_bandwidth::SensorBandwidth),
        Arc::new(sensor_filter::SensorFilter),
        Arc::new(mains_hum::MainsHum),
        Arc::new(hum_harmonics::HumHarmonics),
        Arc::new(quantisation::Quantisation),
    ]
}

/// Finds a built-in effect by its identifier; hyphens and underscores are the same.
#[must_use]
pub fn by_id(id: &str) -> Option<Arc<dyn Effect>> {
    let wanted = id.trim().replace('-', "_");
    registry()
        .into_iter()
        .find(|e| e.declaration().id == wanted)
}

/// A model of built-in effects with these values.
#[cfg(test)]
pub(crate) fn model_of(overview: &Overview, effects: &[(&str, &[f64])]) -> Model {
    let mut model = Model::new(overview.drive_min_v, overview.drive_max_v);
    for (id, values) in effects {
        model.add(EffectInstance::new(by_id(id).unwrap(), overview, values));
    }
    model
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a record that begins virgin needs to have no constant of its own.
    #[test]
    fn loops_read_zero_where_a_virgin_stage_rests() {
        let overview = Overview::without_data(-20.0, 80.0);
        let setting = Setting::of_held_drive(-20.0, 80.0, 1e-3);
        for effect in registry() {
            let declaration = effect.declaration();
            if !declaration.is_main() {
                continue;
            }
            let rests_v = if declaration.virgin_at_zero {
                0.0
            } else {
                -20.0
            };
            for start in effect.starts(&overview) {
                let model = model_of(&overview, &[(&declaration.id, &start)]);
                let mut stage = model.effects[0].stage(&model, &setting).unwrap();
                let [rests_um, driven_um] = [rests_v, 50.0].map(|drive_v| stage.settle(drive_v));
                assert!(rests_um.abs() < 1e-12, "{}: {rests_um}", declaration.id);
                assert!(driven_um.abs() > 0.1, "{}: {driven_um}", declaration.id);
            }
        }
    }
}
