//! What holds for every effect of the registry, by drives that are drawn at random: no stage knows the
//! future, an effect of no strength changes nothing, the order in which effects are added has no part, and
//! loops that claim a memory of extrema return to the point from which they turned.

use hysteron_sim::chain::{Drive, EffectInstance, InitialState, Model};
use hysteron_sim::effect::{Effect, Overview, Place, Scale, registry};
use proptest::prelude::*;
use std::sync::Arc;

const PERIOD_S: f64 = 1.0 / 20_000.0;
const SAMPLES: usize = 120;
const HIGHEST_V: f64 = 70.0;

fn overview() -> Overview {
    Overview::without_data(0.0, HIGHEST_V)
}

fn model_of(effects: &[(&Arc<dyn Effect>, Vec<f64>)]) -> Model {
    let mut model = Model::new(0.0, HIGHEST_V);
    for (effect, values) in effects {
        model.add(EffectInstance::new((*effect).clone(), &overview(), values));
    }
    model
}

fn simulated(model: &Model, drive_v: &[f64]) -> Vec<f64> {
    model.simulate(&Drive::held(drive_v, PERIOD_S, InitialState::Virgin))
}

/// A gain and a mode, beside which every effect can stand.
fn base(all: &[Arc<dyn Effect>]) -> Vec<(&Arc<dyn Effect>, Vec<f64>)> {
    let of = |id: &str| all.iter().find(|e| e.declaration().id == id).unwrap();
    vec![
        (of("gain"), vec![0.14]),
        (of("vibration"), vec![5000.0, 0.2]),
    ]
}

/// The base with an effect in the place of whatever stands for the same.
fn with<'a>(
    base: &[(&'a Arc<dyn Effect>, Vec<f64>)],
    effect: &'a Arc<dyn Effect>,
    values: Vec<f64>,
) -> Vec<(&'a Arc<dyn Effect>, Vec<f64>)> {
    let declared = effect.declaration();
    let mut effects = base.to_vec();
    effects.retain(|(e, _)| {
        let other = e.declaration();
        other.id != declared.id && !(declared.is_main() && other.is_main())
    });
    effects.push((effect, values));
    effects
}

/// Values of no strength: all that a fit varies in steps at zero. `None` where a value is varied by ratios,
/// or may not be zero.
fn without_strength(effect: &Arc<dyn Effect>) -> Option<Vec<f64>> {
    let parameters = effect.parameters(&overview());
    let none = parameters.iter().all(|p| {
        matches!(p.scale, Scale::Linear(_)) && !p.fixed && (p.lower..=p.upper).contains(&0.0)
    });
    none.then(|| vec![0.0; parameters.len()])
}

/// Structures of loops whose memory is that of extrema.
const REMEMBER_EXTREMA: [&str; 5] = [
    "hysteresis",
    "prandtl_ishlinskii",
    "modified_prandtl_ishlinskii",
    "maxwell_slip",
    "inverse_preisach",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_stage_knows_the_future(
        past in proptest::collection::vec(0.0..HIGHEST_V, SAMPLES),
        future in proptest::collection::vec(0.0..HIGHEST_V, SAMPLES),
        turn in 1..SAMPLES,
    ) {
        let other: Vec<f64> = past[..turn].iter().chain(&future[turn..]).copied().collect();
        let all = registry();
        for effect in &all {
            for values in effect.starts(&overview()) {
                let model = model_of(&with(&base(&all), effect, values));
                let [a, b] = [&past, &other].map(|drive_v| simulated(&model, drive_v));
                prop_assert_eq!(&a[..=turn], &b[..=turn], "{}", effect.declaration().id);
            }
        }
    }

    #[test]
    fn an_effect_of_no_strength_changes_nothing(
        drive_v in proptest::collection::vec(0.0..HIGHEST_V, SAMPLES),
    ) {
        let (all, mut asked) = (registry(), 0);
        let plain = simulated(&model_of(&base(&all)), &drive_v);
        for effect in all.iter().filter(|e| !e.declaration().is_main()) {
            let Some(values) = without_strength(effect) else {
                continue;
            };
            let changed = simulated(&model_of(&with(&base(&all), effect, values)), &drive_v);
            for (a, b) in plain.iter().zip(&changed) {
                prop_assert!((a - b).abs() < 1e-12, "{}: {a} and {b}", effect.declaration().id);
            }
            asked += 1;
        }
        prop_assert!(asked >= 5, "{asked} effects were asked");
    }

    #[test]
    fn the_order_of_adding_has_no_part(
        drive_v in proptest::collection::vec(0.0..HIGHEST_V, SAMPLES),
    ) {
        let all = registry();
        for effect in &all {
            let values = effect.starts(&overview()).swap_remove(0);
            let forwards = with(&base(&all), effect, values);
            let backwards: Vec<_> = forwards.iter().rev().cloned().collect();
            let [a, b] = [forwards, backwards].map(|order| simulated(&model_of(&order), &drive_v));
            prop_assert_eq!(a, b, "{}", effect.declaration().id);
        }
    }

    /// Whatever lies between: a drive that comes back to an extremum finds the output that it left there, and
    /// goes on as without the turns between.
    #[test]
    fn inner_loops_close_and_are_forgotten(
        top in 30.0..HIGHEST_V,
        inner in proptest::collection::vec(0.05f64..0.95, 1..12),
    ) {
        for effect in registry() {
            let declared = effect.declaration();
            if declared.place != Place::Hysteresis || !REMEMBER_EXTREMA.contains(&declared.id.as_str()) {
                continue;
            }
            let values = effect.starts(&overview()).swap_remove(0);
            let model = model_of(&[(&effect, values)]);
            let beyond = 0.5 * (top + HIGHEST_V);
            let within: Vec<f64> = inner.iter().map(|share| share * top).collect();
            let turned = [&[top][..], &within, &[top, beyond, 10.0, 10.0]].concat();
            let straight = [top, beyond, 10.0, 10.0];
            let [a, b] = [&turned[..], &straight].map(|drive_v| simulated(&model, drive_v));
            // Each drive is read one sample later.
            let back = a.len() - 3;
            prop_assert!((a[1] - a[back]).abs() < 1e-9, "{}: {} and {}", declared.id, a[1], a[back]);
            for (x, y) in a[back..].iter().zip(&b[1..]) {
                prop_assert!((x - y).abs() < 1e-9, "{}: {x} and {y}", declared.id);
            }
        }
    }
}
