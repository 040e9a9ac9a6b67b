//! Many simulated data sets: the cases on which the diagnosis is scored, of every kind, at several strengths.

use crate::error::Result;
use crate::parallel;
use crate::synthetic::case::{
    CaseOrder, OUTSIDE_LIBRARY, SyntheticCase, Truth, belongs_to_surfaces, simulate_case,
};
use hysteron_sim::effect::{
    Place, Planted, by_id, creep, hysteresis, initial_curve, registry, vibration,
};

/// Effects of which one is hidden in a case of `all`, the unknown ones and none beside; in the order of the
/// chain.
fn kinds_of(wanted: impl Fn(Planted) -> bool) -> Vec<String> {
    registry()
        .into_iter()
        .filter(|e| wanted(e.declaration().planted))
        .map(|e| e.declaration().id)
        .collect()
}

/// All combinations of so many of the effects that are hidden together, in the order of the chain.
fn combinations(of: usize) -> Vec<Vec<String>> {
    let combined = kinds_of(|planted| planted == Planted::InPairs);
    let mut out: Vec<(usize, Vec<String>)> = vec![(0, Vec::new())];
    for _ in 0..of {
        let longer = |(next, chosen): &(usize, Vec<String>)| {
            let each = (*next..combined.len()).map(|i| {
                (
                    i + 1,
                    chosen.iter().chain([&combined[i]]).cloned().collect(),
                )
            });
            each.collect::<Vec<_>>()
        };
        out = out.iter().flat_map(longer).collect();
    }
    out.into_iter().map(|(_, chosen)| chosen).collect()
}

/// What is hidden in the cases of a set, without strengths: `all`, `pairs`, `triples`, or one list.
#[must_use]
pub fn kinds(wanted: &str) -> Option<Vec<Vec<String>>> {
    match wanted {
        "all" => {
            let known = kinds_of(|planted| planted != Planted::Never);
            let unknown = OUTSIDE_LIBRARY.map(String::from);
            Some(
                known
                    .into_iter()
                    .chain(unknown)
                    .map(|id| vec![id])
                    .chain(std::iter::once(Vec::new()))
                    .collect(),
            )
        }
        "pairs" => Some(combinations(2)),
        "triples" => Some(combinations(3)),
        _ => None,
    }
}

/// What the user of a synthetic case has modelled, by default.
const USUAL: [&str; 3] = [hysteresis::ID, initial_curve::ID, vibration::ID];

/// What the user of a case already models: the usual three, creep in every second case, never what is hidden.
fn base_of(hidden: &[String], number: usize) -> Vec<String> {
    let mut base = USUAL.to_vec();
    if number % 2 == 1 {
        base.push(creep::ID);
    }
    // What comes with a hidden effect is hidden too.
    let with_hidden: Vec<&str> = hidden
        .iter()
        .filter_map(|id| by_id(id))
        .flat_map(|e| e.declaration().comes_with)
        .copied()
        .collect();
    let place = |id: &str| by_id(id).map(|e| e.declaration().place);
    let hides_loops = hidden
        .iter()
        .any(|id| by_id(id).is_some_and(|e| e.declaration().is_main()));
    let excluded = |id: &str| {
        hidden.iter().any(|h| h == id)
            || with_hidden.contains(&id)
            || hides_loops && place(id) == Some(Place::Hysteresis)
    };
    base.into_iter()
        .filter(|id| !excluded(id))
        .map(String::from)
        .collect()
}

/// A set of cases.
pub struct SetOrder {
    /// What is hidden, case by case.
    pub hidden: Vec<Vec<String>>,
    /// Strengths.
    pub strengths: Vec<f64>,
    /// Cases of each kind and strength.
    pub cases: usize,
    /// Structure of the hysteresis.
    pub hysteresis: String,
    /// Seed of the first case.
    pub seed: u64,
}

impl SetOrder {
    /// The orders of all its cases, each with the name of the case.
    #[must_use]
    pub fn cases(&self) -> Vec<(String, CaseOrder)> {
        let mut orders: Vec<(String, CaseOrder)> = Vec::new();
        let of_surfaces =
            |id: &String| by_id(id).is_some_and(|e| belongs_to_surfaces(&e.declaration()));
        let can_be_hidden = |hidden: &&Vec<String>| {
            self.hysteresis == hysteresis::ID || !hidden.iter().any(of_surfaces)
        };
        for _ in 0..self.cases {
            for hidden in self.hidden.iter().filter(can_be_hidden) {
                // Nothing has no strength.
                let strengths = if hidden.is_empty() {
                    &self.strengths[..1]
                } else {
                    &self.strengths[..]
                };
                for strength in strengths {
                    let number = orders.len();
                    let order = CaseOrder {
                        hidden: hidden.iter().map(|id| (id.clone(), *strength)).collect(),
                        base: base_of(hidden, number),
                        hysteresis: self.hysteresis.clone(),
                        seed: self.seed.wrapping_add(number as u64),
                    };
                    orders.push((format!("case{number:03}"), order));
                }
            }
        }
        orders
    }
}

/// Simulates all cases of a set, on all cores; `done` receives each with its name.
///
/// # Errors
/// As [`simulate_case`], and those of `done`.
pub fn simulate_set(
    order: &SetOrder,
    done: &(dyn Fn(&SyntheticCase) -> Result<()> + Sync),
) -> Result<Vec<Truth>> {
    let simulated = parallel::map(&order.cases(), |(name, one)| {
        let mut case = simulate_case(one, name)?;
        case.truth.name.clone_from(name);
        done(&case)?;
        Ok(case.truth)
    });
    simulated.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_hide_what_the_effects_declare() {
        let all = kinds("all").unwrap();
        for effect in registry()
            .iter()
            .filter(|e| e.declaration().candidate && e.declaration().planted != Planted::Never)
        {
            assert!(
                all.contains(&vec![effect.declaration().id]),
                "{}",
                effect.declaration().id
            );
        }
        assert!(
            all.contains(&Vec::new())
                && OUTSIDE_LIBRARY
                    .iter()
                    .all(|id| all.contains(&vec![(*id).to_owned()]))
        );
        let paired = registry()
            .iter()
            .filter(|e| e.declaration().planted == Planted::InPairs)
            .count();
        assert_eq!(kinds("pairs").unwrap().len(), paired * (paired - 1) / 2);
        let triples = kinds("triples").unwrap();
        assert_eq!(triples.len(), paired * (paired - 1) * (paired - 2) / 6);
        assert!(triples.iter().all(|three| three.len() == 3
            && three[0] != three[1]
            && three[1] != three[2]
            && three[0] != three[2]));
        assert!(kinds("creep").is_none());
    }

    #[test]
    fn what_comes_with_a_hidden_effect_is_not_modelled() {
        assert_eq!(base_of(&[hysteresis::ID.to_owned()], 0), [vibration::ID]);
        assert_eq!(
            base_of(&["delay".to_owned()], 1),
            [hysteresis::ID, initial_curve::ID, vibration::ID, creep::ID]
        );
    }
}
