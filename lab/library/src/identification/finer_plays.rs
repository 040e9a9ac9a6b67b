//! Better descriptions of the play operators beside the surfaces: more of them, or few with free thresholds.
//!
//! An element whose threshold lies between two of the grid is met by both together up to a step at every
//! turn, which halves with the distance of the grid. Loops that are made of few elements are met by few: on a
//! dense grid whose weights all go with the drive those beside an element share it, and nothing is left for
//! the others. Neighbours that do are one element with the threshold between them, which is then set free.

use hysteron_sim::chain::{EffectInstance, Model};
use hysteron_sim::effect::Overview;
use hysteron_sim::effect::play_operators::{self, PlayOperatorsBeside};
use std::sync::Arc;

/// Most elements of a grid.
const ELEMENTS_MAX: usize = 79;
/// Thresholds are set free where no more elements than these are left.
const FREE_ELEMENTS_MAX: usize = 20;
/// An element with less than this share of all weights does not count.
const WEIGHT_MIN: f64 = 1e-3;
/// How far a free threshold may go, in distances of the grid that it comes from.
const REACH: f64 = 3.0;
/// What free thresholds count for beside one step of a denser grid.
const STEPS_OF_FREE: usize = 2;

/// An element: its weight in um, its threshold in units of the drive range.
type Element = (f64, f64);

/// Where the thresholds of elements are.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Thresholds {
    OnAGrid,
    /// Free, from a grid of this distance.
    Free(f64),
}

/// The model with an element more between each two of its play operators, one before the first and one behind
/// the last; nothing where it has none, enough, free thresholds; all go with the drive then.
#[must_use]
pub fn denser(model: &Model, overview: &Overview) -> Option<Model> {
    let plays = model
        .effect(play_operators::ID)
        .filter(|plays| !is_free(plays))?;
    let elements = elements(plays);
    let halfway = |threshold: f64| (0.0, threshold - 0.5 * elements[0].1);
    let denser: Vec<Element> = elements
        .iter()
        .flat_map(|e| [halfway(e.1), *e])
        .chain(elements.last().map(|e| halfway(e.1 + elements[0].1)))
        .collect();
    (denser.len() <= ELEMENTS_MAX)
        .then(|| with_elements(model, overview, &denser, Thresholds::OnAGrid))
}

/// The model with its play operators as few as their grid shows, at free thresholds; nothing where it has
/// none, where they are too many, or free.
#[must_use]
pub fn freed(model: &Model, overview: &Overview) -> Option<Model> {
    let plays = model
        .effect(play_operators::ID)
        .filter(|plays| !is_free(plays))?;
    let elements = elements(plays);
    let distance = elements.first()?.1;
    let few = together(&elements, distance);
    (!few.is_empty() && few.len() <= FREE_ELEMENTS_MAX)
        .then(|| with_elements(model, overview, &few, Thresholds::Free(distance)))
}

/// Neighbours of a grid that share an element as one.
fn together(elements: &[Element], distance: f64) -> Vec<Element> {
    let all: f64 = elements.iter().map(|(weight, _)| weight.abs()).sum();
    let mut out: Vec<(Element, usize, f64)> = Vec::new();
    for (weight, threshold) in elements
        .iter()
        .copied()
        .filter(|(weight, _)| weight.abs() > WEIGHT_MIN * all)
    {
        match out.last_mut() {
            // No element is shared by more than two.
            Some((one, shared, last))
                if *shared < 2 && threshold - *last < 1.5 * distance && one.0 * weight > 0.0 =>
            {
                let sum = one.0 + weight;
                *one = (sum, (one.0 * one.1 + weight * threshold) / sum);
                (*shared, *last) = (*shared + 1, threshold);
            }
            _ => out.push(((weight, threshold), 1, threshold)),
        }
    }
    out.into_iter().map(|(element, _, _)| element).collect()
}

/// By how many steps the play operators are more than their grid has.
#[must_use]
pub fn steps_finer(model: &Model) -> usize {
    let Some(plays) = model.effect(play_operators::ID) else {
        return 0;
    };
    if is_free(plays) {
        return STEPS_OF_FREE;
    }
    let intervals = |elements: usize| elements + 1;
    (intervals(plays.parameters.len() / 2) / intervals(PlayOperatorsBeside::default().elements))
        .max(1)
        .ilog2() as usize
}

/// How the play operators of a model are described, in words; nothing where it has none.
#[must_use]
pub fn description(model: &Model) -> Option<String> {
    let plays = model.effect(play_operators::ID)?;
    let count = plays.parameters.len() / 2;
    Some(
        match (
            is_free(plays),
            count == PlayOperatorsBeside::default().elements,
        ) {
            (true, _) => format!("{count} play operators with free thresholds"),
            (false, true) => "play operators".into(),
            (false, false) => format!("{count} play operators"),
        },
    )
}

fn is_free(plays: &EffectInstance) -> bool {
    plays
        .parameters
        .chunks_exact(2)
        .any(|pair| !pair[1].parameter.fixed)
}

fn elements(plays: &EffectInstance) -> Vec<Element> {
    plays
        .parameters
        .chunks_exact(2)
        .map(|pair| (pair[0].value, pair[1].value))
        .collect()
}

fn with_elements(
    model: &Model,
    overview: &Overview,
    elements: &[Element],
    thresholds: Thresholds,
) -> Model {
    let rising = overview.gain_um_v >= 0.0;
    let mut plays = EffectInstance::new(
        Arc::new(PlayOperatorsBeside {
            elements: elements.len(),
        }),
        overview,
        &[],
    );
    for (pair, (weight, threshold)) in plays.parameters.chunks_exact_mut(2).zip(elements) {
        let [of_weight, of_threshold] = pair else {
            continue;
        };
        if thresholds == Thresholds::OnAGrid {
            let (lower, upper) = (
                &mut of_weight.parameter.lower,
                &mut of_weight.parameter.upper,
            );
            *(if rising { lower } else { upper }) = 0.0;
        }
        of_weight.value = weight.clamp(of_weight.parameter.lower, of_weight.parameter.upper);
        of_threshold.value =
            threshold.clamp(of_threshold.parameter.lower, of_threshold.parameter.upper);
        if let Thresholds::Free(distance) = thresholds {
            (of_threshold.parameter.lower, of_threshold.parameter.upper) = (
                (threshold - REACH * distance).max(0.0),
                (threshold + REACH * distance).min(1.0),
            );
            of_threshold.parameter.fixed = false;
        }
    }
    let mut out = model.clone();
    out.add(plays);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::effect::hysteresis::Hysteresis;

    fn overview(gain_um_v: f64) -> Overview {
        Overview {
            gain_um_v,
            ..Overview::without_data(0.0, 80.0)
        }
    }

    fn with_plays(weights_and_thresholds: &[f64]) -> Model {
        let mut out = Model::new(0.0, 80.0);
        out.add(EffectInstance::new(
            Arc::new(Hysteresis::default()),
            &overview(1.0),
            &[],
        ));
        let plays = PlayOperatorsBeside {
            elements: weights_and_thresholds.len() / 2,
        };
        out.add(EffectInstance::new(
            Arc::new(plays),
            &overview(1.0),
            weights_and_thresholds,
        ));
        out
    }

    fn evenly() -> Model {
        let thresholds = (1..20).flat_map(|i| [0.1 * f64::from(i % 3 - 1), 0.025 * f64::from(i)]);
        with_plays(&thresholds.collect::<Vec<_>>())
    }

    fn of(model: &Model) -> Vec<Element> {
        elements(model.effect(play_operators::ID).unwrap())
    }

    #[test]
    fn a_denser_grid_holds_the_coarser_one_goes_with_the_drive_and_ends_somewhere() {
        for gain_um_v in [0.4, -0.4] {
            let once = denser(&evenly(), &overview(gain_um_v)).unwrap();
            let (before, now) = (of(&evenly()), of(&once));
            assert_eq!(now.len(), 39);
            for (i, (weight, threshold)) in now.iter().enumerate() {
                assert!(
                    (threshold - 0.0125 * (i + 1) as f64).abs() < 1e-12,
                    "{threshold}"
                );
                let kept = if i % 2 == 1 { before[i / 2].0 } else { 0.0 };
                assert_eq!(*weight, if kept * gain_um_v > 0.0 { kept } else { 0.0 });
            }
            let twice = denser(&once, &overview(gain_um_v)).unwrap();
            assert!(denser(&twice, &overview(gain_um_v)).is_none());
            assert_eq!([&evenly(), &once, &twice].map(steps_finer), [0, 1, 2]);
        }
    }

    #[test]
    fn neighbours_that_share_an_element_are_one_at_a_free_threshold() {
        // Elements at 0.03 and 0.125, and next to nothing; three neighbours are not one.
        let model = with_plays(&[
            2.4, 0.025, 0.6, 0.05, 0.0, 0.075, 1e-5, 0.1, 1.0, 0.125, 0.0, 0.15, 1.0, 0.175, 3.0,
            0.2, 2.0, 0.225,
        ]);
        let few = freed(&model, &overview(1.0)).unwrap();
        let expected = [(3.0, 0.03), (1.0, 0.125), (4.0, 0.193_75), (2.0, 0.225)];
        assert_eq!(of(&few).len(), expected.len());
        for (element, expected) in of(&few).iter().zip(expected) {
            assert!(
                (element.0 - expected.0).abs() < 1e-12 && (element.1 - expected.1).abs() < 1e-12,
                "{element:?} {expected:?}"
            );
        }
        assert!(
            is_free(few.effect(play_operators::ID).unwrap()) && steps_finer(&few) == STEPS_OF_FREE
        );
        assert!(freed(&few, &overview(1.0)).is_none() && denser(&few, &overview(1.0)).is_none());
        assert_ne!(description(&model), description(&few));
    }

    #[test]
    fn thresholds_on_a_grid_of_either_sign_are_too_many_to_be_free() {
        let all: Vec<f64> = (1..=30)
            .flat_map(|i| [if i % 2 == 0 { 1.0 } else { -1.0 }, 0.016 * f64::from(i)])
            .collect();
        assert!(freed(&with_plays(&all), &overview(1.0)).is_none());
    }
}
