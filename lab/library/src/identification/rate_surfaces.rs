//! Rate-dependent surfaces by the printed procedure in two steps (thesis Ch. 4, 4.2 and 6.3): surfaces at
//! every nominal rate, then a polynomial in the rate through each coefficient.
//!
//! The joint fit of [`crate::identify`] with the effect `rate_dependent_surfaces` estimates all coefficients
//! from all records at once; this one is kept beside it because the thesis' figures belong to it. Where a
//! record moves at more than one rate, as a rounded triangle does near its turns, the two steps take its
//! nominal rate for the whole of it, and the joint fit does not.

use super::finer_hysteresis::main_effect;
use super::fit::{Effort, fit};
use crate::dataset::Dataset;
use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::rate_dependent_surfaces::{self, CURVE_TERMS, DEGREE, LOOP_TERMS, RateDependentSurfaces, TERMS};
use hysteron_sim::effect::{hysteresis, initial_curve};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Records whose nominal rates differ by less than this share have one rate.
const SAME_RATE: f64 = 0.1;

/// Nominal rate of a record, V/s: the median of those at which its drive moves.
fn nominal_rate_v_s(drive_v: &[f64], sample_rate_hz: f64) -> f64 {
    let mut rates: Vec<f64> = drive_v.windows(2).map(|w| (w[1] - w[0]).abs() * sample_rate_hz).filter(|rate| *rate > 0.0).collect();
    rates.sort_by(f64::total_cmp);
    rates.get(rates.len() / 2).copied().unwrap_or(0.0)
}

/// The model with rate-dependent surfaces of so many orders from the records with these indices; `None` where
/// they move at no more rates than there are orders. What the model has beside the hysteresis stays as it is.
#[must_use]
pub fn two_steps(model: &Model, dataset: &Dataset, records: &[usize], orders: usize) -> Option<Model> {
    main_effect(model).filter(|main| main.id == hysteresis::ID)?;
    let rate_of = |i: &usize| nominal_rate_v_s(&dataset.records[*i].drive_v, dataset.records[*i].sample_rate_hz);
    let mut by_rate: Vec<(f64, Vec<usize>)> = Vec::new();
    for i in records {
        let rate = rate_of(i);
        match by_rate.iter_mut().find(|(known, _)| (rate / *known - 1.0).abs() < SAME_RATE) {
            Some((_, same)) => same.push(*i),
            None if rate > 0.0 => by_rate.push((rate, vec![*i])),
            None => {}
        }
    }
    if by_rate.len() <= orders {
        return None;
    }
    let overview = dataset.overview();
    let reference_v_s = by_rate.iter().map(|(rate, _)| *rate).fold(0.0, f64::max);
    // Surfaces of the degree that every power has, fitted to the records of one rate alone; all else is held.
    let mut held = model.clone();
    held.effects.retain(|e| ![rate_dependent_surfaces::ID, hysteresis::ID, initial_curve::ID].contains(&e.id.as_str()));
    held.effects.iter_mut().flat_map(|e| &mut e.parameters).for_each(|p| p.parameter.fixed = true);
    let plain = |id: &str, count: usize| {
        let effect = hysteron_sim::effect::by_id(id)?.with_parameters(count)?;
        Some(EffectInstance::new(effect, &overview, &[]))
    };
    held.add(plain(hysteresis::ID, LOOP_TERMS)?);
    held.add(plain(initial_curve::ID, CURVE_TERMS)?);
    let coefficients = |records: &[usize]| {
        let fitted = fit(&held, dataset, records, Effort::default()).model;
        Some(fitted.values(hysteresis::ID)?.into_iter().chain(fitted.values(initial_curve::ID)?).collect::<Vec<f64>>())
    };
    let at_rates = by_rate.iter().map(|(_, records)| coefficients(records)).collect::<Option<Vec<_>>>()?;
    // A polynomial of the rate through each coefficient.
    let powers = DMatrix::from_fn(by_rate.len(), orders + 1, |r, c| (by_rate[r].0 / reference_v_s).powi(c as i32));
    let solver = powers.svd(true, true);
    let mut values = vec![reference_v_s];
    values.resize(1 + orders * TERMS, 0.0);
    let mut base = [0.0; TERMS];
    for k in 0..TERMS {
        let polynomial = solver.solve(&DVector::from_iterator(at_rates.len(), at_rates.iter().map(|c| c[k])), 1e-12).ok()?;
        base[k] = polynomial[0];
        (0..orders).for_each(|order| values[1 + order * TERMS + k] = polynomial[order + 1]);
    }
    let mut out = model.clone();
    let set = |effect: &mut EffectInstance, values: &[f64]| effect.parameters.iter_mut().zip(values).for_each(|(p, v)| p.value = *v);
    let mut loops = plain(hysteresis::ID, LOOP_TERMS)?;
    set(&mut loops, &base[..LOOP_TERMS]);
    let mut curve = plain(initial_curve::ID, CURVE_TERMS)?;
    set(&mut curve, &base[LOOP_TERMS..]);
    let mut by_rate = EffectInstance::new(Arc::new(RateDependentSurfaces { orders }), &overview, &[]);
    set(&mut by_rate, &values);
    [loops, curve, by_rate].into_iter().for_each(|effect| out.add(effect));
    debug_assert!(LOOP_TERMS == hysteresis::coefficient_count(DEGREE));
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Record;
    use crate::identification::fit::rms_over;
    use hysteron_sim::effect::{Overview, by_id};
    use hysteron_sim::waveform;

    /// Triangles of several heights at several rates, by a model whose loops widen with the rate.
    #[test]
    fn both_procedures_meet_what_made_the_data() {
        let overview = Overview { range_um: 10.0, gain_um_v: 0.125, ..Overview::without_data(0.0, 80.0) };
        let mut truth = Model::new(0.0, 80.0);
        let base = [10.0, 1.2, -1.2, 0.1, 0.05, -0.1];
        truth.add(EffectInstance::new(by_id("hysteresis").unwrap().with_parameters(6).unwrap(), &overview, &base));
        truth.add(EffectInstance::new(by_id("initial_curve").unwrap().with_parameters(3).unwrap(), &overview, &[0.3, -0.1, 0.02]));
        let orders = 2;
        let mut by_rate = vec![20_000.0];
        by_rate.extend((0..orders * TERMS).map(|k| 0.05 * ((7 * k % 5) as f64 - 2.0)));
        let surfaces = by_id("rate_dependent_surfaces").unwrap().with_parameters(by_rate.len()).unwrap();
        truth.add(EffectInstance::new(surfaces, &overview, &by_rate));
        let records: Vec<Record> = [500.0, 2000.0, 8000.0, 20_000.0]
            .iter()
            .map(|rate_v_s| {
                let drive_v = waveform::triangles(20_000.0, *rate_v_s, &[0.0, 30.0, 0.0, 60.0, 20.0, 50.0, 0.0, 80.0, 10.0, 70.0, 0.0]);
                let empty = Record::new("r", 20_000.0, drive_v.clone(), vec![0.0; drive_v.len()]).from_virgin_state();
                Record::new(format!("{rate_v_s}"), 20_000.0, drive_v, truth.simulate(&empty.drive())).from_virgin_state()
            })
            .collect();
        let dataset = Dataset::new("rates", 0.0, 80.0, records).unwrap();
        let all = [0, 1, 2, 3];
        let mut start = Model::new(0.0, 80.0);
        start.add(EffectInstance::new(by_id("hysteresis").unwrap(), &overview, &[]));
        let stepwise = two_steps(&start, &dataset, &all, orders).unwrap();
        assert!(rms_over(&stepwise, &dataset, &all) < 2e-3, "{}", rms_over(&stepwise, &dataset, &all));
        let joint = fit(&stepwise, &dataset, &all, Effort::default());
        assert!(joint.rms_um < 1e-4, "{}", joint.rms_um);
        // Two rates make no polynomial of second order.
        assert!(two_steps(&start, &dataset, &[0, 1], orders).is_none());
    }
}
