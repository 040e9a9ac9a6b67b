//! Diagnoses planted cases and compares with their truth (`hysteron.score/1`).

use crate::analyse::{Options, Start, analyse};
use crate::dataset::Dataset;
use crate::diagnosis::judgement::Judged;
use crate::error::Result;
use crate::model_file::effects_named;
use crate::outcome::Verdict;
use crate::synthetic::case::Truth;
use crate::watch::Unwatched;
use hysteron_sim::effect::{by_id, hysteresis};
use serde::Serialize;
use std::collections::BTreeMap;

/// How one case went.
#[derive(Clone, Debug, Serialize)]
pub struct CaseScore {
    /// The case.
    pub case: String,
    /// What was hidden: effects joined by `+`, or `none`.
    pub hidden: String,
    /// The verdict.
    pub verdict: &'static str,
    /// What it names.
    pub named: Vec<String>,
    /// The hidden effects are named and no others, or nothing is named where nothing (known) is missing.
    pub right_first: bool,
    /// Right first, or within an ambiguous set of at most three.
    pub right_in_set: bool,
    /// Something is named that is not missing.
    pub false_discovery: bool,
    /// Held-out error after adding what was found, over the true noise.
    pub validate_over_noise: f64,
    /// The effect still shows after a refit of the base model: the right answer is its name. Otherwise
    /// `at_floor` is right.
    pub survives: bool,
    /// What the refitted base model leaves above the noise in the record where it leaves most, um.
    pub left_by_refit_um: f64,
    /// How much the hidden effect changes the record that it changes most, um RMS.
    pub effect_um: f64,
    /// Smallest p-value of any candidate on the base model, after control of false discoveries.
    pub least_p_value: f64,
    /// Share of the residual above the floor that the first candidate explains.
    pub strongest_share: f64,
    /// Wall-clock time.
    pub seconds: f64,
}

/// All cases.
#[derive(Clone, Debug, Serialize)]
pub struct SetScore {
    /// `hysteron.score/1`.
    pub schema: &'static str,
    /// Share right first.
    pub right_first: f64,
    /// Share right first or in the ambiguous set.
    pub right_in_set: f64,
    /// Share with something named that is not missing.
    pub false_discoveries: f64,
    /// Share of outside-library cases that were called unexplained; `None` without any.
    pub unexplained_recognised: Option<f64>,
    /// Share whose held-out error came within 1.15 times the noise, of those with a known effect.
    pub within_noise: f64,
    /// Share of the cases with nothing missing whose least adjusted p-value is below 0.05; `None` without
    /// any.
    pub null_share_below_5_pct: Option<f64>,
    /// Least size of each effect, in nm of the record that it changes most, from which on 90 % of the cases
    /// are named or in the set.
    pub detected_from_nm: BTreeMap<String, f64>,
    /// Longest case.
    pub seconds_max: f64,
    /// Rows: hidden; columns: what the diagnosis names first.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Every case.
    pub cases: Vec<CaseScore>,
}

/// Diagnoses one case and compares with its truth; `seconds` is left to the caller's clock.
///
/// # Errors
/// As [`analyse`], and a base effect that is not known.
pub fn score_case(dataset: &Dataset, truth: &Truth) -> Result<CaseScore> {
    let base = effects_named(&truth.base.join(","))?;
    let found = analyse(
        dataset,
        Start::Effects(&base),
        &Options::default(),
        &Unwatched,
    )?;
    let named = found.diagnosis.named.clone();
    let mut missing: Vec<String> = truth
        .hidden
        .iter()
        .chain(&truth.second)
        .chain(&truth.third)
        .cloned()
        .collect();
    let verdict = found.diagnosis.verdict;
    let (survives, left_by_refit_um) = left_by_refit(&found.steps[0].judged, truth.noise_um);
    let sets: Vec<Vec<String>> = found
        .diagnosis
        .findings
        .iter()
        .map(|f| f.effects.clone())
        .collect();
    let marks = Said {
        verdict,
        sets: &sets,
        others_changed: !found.diagnosis.changed.is_empty(),
    }
    .against(&missing, &truth.also, survives);
    if missing.is_empty() {
        missing.push("none".into());
    }
    let after = found.last();
    Ok(CaseScore {
        case: truth.name.clone(),
        hidden: missing.join("+"),
        verdict: verdict.word(),
        right_first: marks.right_first,
        right_in_set: marks.right_in_set,
        false_discovery: marks.false_discovery,
        named,
        survives,
        left_by_refit_um,
        effect_um: truth
            .effect_rms_um
            .iter()
            .map(|(_, um)| *um)
            .fold(0.0, f64::max),
        validate_over_noise: after.error_um() / truth.noise_um,
        least_p_value: found
            .diagnosis
            .candidates
            .iter()
            .filter_map(|c| c.p_value)
            .fold(1.0, f64::min),
        strongest_share: found
            .diagnosis
            .candidates
            .first()
            .map_or(0.0, |c| c.explained_share),
        seconds: 0.0,
    })
}

/// A set of more effects than this says too little to be right.
const SET_MAX: usize = 3;

/// What a diagnosis claims.
struct Said<'a> {
    verdict: Verdict,
    /// Effects that the diagnosis reports as missing; more than one where it says "or".
    sets: &'a [Vec<String>],
    /// The diagnosis reports changed values of effects that are there.
    others_changed: bool,
}

/// How a claim compares with the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Marks {
    right_first: bool,
    right_in_set: bool,
    false_discovery: bool,
}

impl Said<'_> {
    /// As a sceptic counts: a name too many is wrong, an "or" among many says nothing, and where nothing is
    /// missing only `at_floor` is right.
    fn against(&self, missing: &[String], also: &[String], survives: bool) -> Marks {
        let is_hysteresis = |id: &String| {
            id == hysteresis::ID || by_id(id).is_some_and(|e| e.declaration().is_main())
        };
        // Loops of whatever structure are what a model without hysteresis misses.
        let same =
            |id: &String, of: &String| id == of || (of == hysteresis::ID && is_hysteresis(id));
        let is_true = |id: &String| missing.iter().chain(also).any(|of| same(id, of));
        let claims = matches!(self.verdict, Verdict::Named | Verdict::Ambiguous);
        let false_discovery = claims && self.sets.iter().any(|set| !set.iter().any(is_true));
        let outside = missing.iter().any(|id| id.starts_with("outside_library"));
        let (right_first, right_in_set) = if outside {
            (
                self.verdict == Verdict::Unexplained,
                self.verdict == Verdict::Unexplained,
            )
        } else if missing.is_empty() || (!survives && self.verdict == Verdict::AtFloor) {
            let quiet = self.verdict == Verdict::AtFloor && !self.others_changed;
            (quiet, quiet)
        } else {
            let all_there = missing.iter().all(|id| {
                self.sets
                    .iter()
                    .any(|set| set.len() <= SET_MAX && set.iter().any(|said| same(said, id)))
            });
            let right = claims && all_there && !false_discovery;
            (right && self.verdict == Verdict::Named, right)
        };
        Marks {
            right_first,
            right_in_set,
            false_discovery,
        }
    }
}

/// Whether the fitted base model leaves more than noise in some record, and how much in the worst.
fn left_by_refit(base: &Judged, noise_um: f64) -> (bool, f64) {
    let (mut survives, mut most_um2) = (false, 0.0_f64);
    for residual in base.residuals.iter().filter(|r| !r.is_empty()) {
        let excess_um2 = crate::identification::fit::dot(residual, residual)
            / residual.len() as f64
            - noise_um * noise_um;
        // Five standard deviations of the mean square of so many samples of noise.
        let chance_um2 = 5.0 * noise_um * noise_um * (2.0 / residual.len() as f64).sqrt();
        survives |= excess_um2 > chance_um2;
        most_um2 = most_um2.max(excess_um2);
    }
    (survives, most_um2.sqrt())
}

/// For each kind, the least size from which on nine of ten cases are found.
fn detected_from(cases: &[CaseScore]) -> BTreeMap<String, f64> {
    let mut by_kind: BTreeMap<&str, Vec<(f64, bool)>> = BTreeMap::new();
    for case in cases.iter().filter(|c| c.effect_um > 0.0) {
        let found = case.right_in_set && case.verdict != "at_floor";
        by_kind
            .entry(&case.hidden)
            .or_default()
            .push((1e3 * case.effect_um, found));
    }
    let mut out = BTreeMap::new();
    for (kind, mut sizes) in by_kind {
        sizes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut found, mut least) = (0, None);
        for (i, (nm, hit)) in sizes.iter().enumerate() {
            found += usize::from(*hit);
            // A size that was missed is not one from which on effects are found, however many larger ones
            // were.
            if *hit && found as f64 >= 0.9 * (i + 1) as f64 {
                least = Some(*nm);
            }
        }
        if let Some(nm) = least {
            out.insert(kind.to_string(), nm);
        }
    }
    out
}

/// All cases in one table.
#[must_use]
pub fn summarise(cases: Vec<CaseScore>) -> SetScore {
    let n = cases.len().max(1) as f64;
    let share =
        |test: &dyn Fn(&CaseScore) -> bool| cases.iter().filter(|c| test(c)).count() as f64 / n;
    let outside: Vec<&CaseScore> = cases
        .iter()
        .filter(|c| c.hidden.starts_with("outside_library"))
        .collect();
    let known: Vec<&CaseScore> = cases
        .iter()
        .filter(|c| !c.hidden.starts_with("outside_library") && c.hidden != "none")
        .collect();
    let nothing: Vec<&CaseScore> = cases.iter().filter(|c| c.hidden == "none").collect();
    let part = |set: &[&CaseScore], test: &dyn Fn(&CaseScore) -> bool| {
        set.iter().filter(|c| test(c)).count() as f64 / set.len().max(1) as f64
    };
    let mut confusion: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for case in &cases {
        let said = if case.verdict == "named" {
            case.named.join("+")
        } else {
            case.verdict.to_string()
        };
        *confusion
            .entry(case.hidden.clone())
            .or_default()
            .entry(said)
            .or_default() += 1;
    }
    SetScore {
        schema: "hysteron.score/1",
        right_first: share(&|c| c.right_first),
        right_in_set: share(&|c| c.right_in_set),
        false_discoveries: share(&|c| c.false_discovery),
        unexplained_recognised: (!outside.is_empty())
            .then(|| part(&outside, &|c| c.verdict == "unexplained")),
        within_noise: part(&known, &|c| c.validate_over_noise <= 1.15),
        null_share_below_5_pct: (!nothing.is_empty())
            .then(|| part(&nothing, &|c| c.least_p_value < 0.05)),
        detected_from_nm: detected_from(&cases),
        seconds_max: cases.iter().map(|c| c.seconds).fold(0.0, f64::max),
        confusion,
        cases,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(names: &[&str]) -> Vec<String> {
        names.iter().map(|n| (*n).to_owned()).collect()
    }

    fn marks(verdict: Verdict, sets: &[&[&str]], missing: &[&str]) -> (bool, bool, bool) {
        let sets: Vec<Vec<String>> = sets.iter().map(|set| ids(set)).collect();
        let m = Said {
            verdict,
            sets: &sets,
            others_changed: false,
        }
        .against(&ids(missing), &[], true);
        (m.right_first, m.right_in_set, m.false_discovery)
    }

    #[test]
    fn a_sceptic_counts() {
        assert_eq!(
            marks(Verdict::Named, &[&["creep"]], &["creep"]),
            (true, true, false)
        );
        assert_eq!(
            marks(Verdict::Named, &[&["creep"], &["delay"]], &["creep"]),
            (false, false, true),
            "a name too many"
        );
        assert_eq!(
            marks(Verdict::Named, &[&["creep"]], &["creep", "delay"]),
            (false, false, false),
            "one of two"
        );
        assert_eq!(
            marks(Verdict::Ambiguous, &[&["delay", "creep"]], &["creep"]),
            (false, true, false)
        );
        assert_eq!(
            marks(Verdict::Ambiguous, &[&["a", "b", "c", "creep"]], &["creep"]),
            (false, false, false),
            "an or among many"
        );
        assert_eq!(
            marks(Verdict::Ambiguous, &[&["a", "b"]], &["creep"]),
            (false, false, true)
        );
        assert_eq!(
            marks(Verdict::Unexplained, &[&["creep"]], &["creep"]),
            (false, false, false)
        );
        assert_eq!(marks(Verdict::AtFloor, &[], &[]), (true, true, false));
        assert_eq!(
            marks(Verdict::Unexplained, &[], &[]),
            (false, false, false),
            "nothing is missing, and it says that something is"
        );
        assert_eq!(
            marks(Verdict::Named, &[&["creep"]], &[]),
            (false, false, true)
        );
        assert_eq!(
            marks(Verdict::Named, &[&["bouc_wen"]], &["hysteresis"]),
            (true, true, false),
            "hysteresis of another structure"
        );
        assert_eq!(
            marks(Verdict::Named, &[&["bouc_wen"]], &["creep"]),
            (false, false, true)
        );
        assert_eq!(
            marks(Verdict::Unexplained, &[], &["outside_library_contact"]),
            (true, true, false)
        );
    }

    #[test]
    fn the_least_size_is_one_that_was_found() {
        let case = |nm: f64, hit: bool| CaseScore {
            case: String::new(),
            hidden: "creep".into(),
            verdict: if hit { "named" } else { "unexplained" },
            named: Vec::new(),
            right_first: hit,
            right_in_set: hit,
            false_discovery: false,
            validate_over_noise: 1.0,
            survives: true,
            left_by_refit_um: 0.0,
            effect_um: 1e-3 * nm,
            least_p_value: 0.0,
            strongest_share: 1.0,
            seconds: 0.0,
        };
        let mut cases: Vec<CaseScore> = (0..18).map(|i| case(100.0 + f64::from(i), true)).collect();
        cases.extend([case(3.0, false), case(2.0, false)]);
        assert_eq!(
            detected_from(&cases).get("creep").map(|nm| nm.round()),
            Some(100.0)
        );
    }
}
