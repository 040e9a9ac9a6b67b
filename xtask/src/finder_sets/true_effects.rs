//! Whether a search lost the truth or the data do: the true effects, fitted by `identify`, beside the model at
//! which the search ended.

use super::answer::FinderAnswer;
use super::case::{CaseCheck, CaseStart, SetCase, answered};
use super::context::Context;
use super::mark::{CaseTruth, LOOPS};

/// A merit (a logarithm of the error) that is lower by this is better: 2 % of the error.
const MATTERS: f64 = 0.02;
/// Weight of the held-out error, as the program ranks models.
const HELD_OUT: f64 = 2.0 / 3.0;

/// The true effects of a case that begins at effects; of several that do what was done the first.
fn true_effects(case: &SetCase) -> Option<String> {
    let (CaseStart::Effects(from), CaseCheck::Names(truth)) = (&case.start, &case.check) else {
        return None;
    };
    let add: Vec<&String> = match truth {
        CaseTruth::Missing(missing, _) => missing.iter().collect(),
        CaseTruth::Altered(right, own) => own.iter().chain(right.first()).collect(),
        _ => return None,
    };
    let is_loops = |id: &str| LOOPS.contains(&id);
    let has_loops = add.iter().any(|id| is_loops(id));
    let mut out: Vec<&str> = from.split(',').collect();
    out.retain(|id| !(has_loops && (*id == "gain" || is_loops(id))));
    for id in add {
        if !out.contains(&id.as_str()) {
            out.push(id);
        }
    }
    Some(out.join(","))
}

/// Errors on fitted and on held-out records, nm, each record alike, and the merit.
fn errors_nm(answer: &[(String, String, f64)]) -> Option<([f64; 2], f64)> {
    let of = |role: &str| {
        let each: Vec<f64> = answer
            .iter()
            .filter(|(_, r, _)| r == role)
            .map(|(.., rms_um)| (1e3 * rms_um).ln())
            .collect();
        (!each.is_empty()).then(|| each.iter().sum::<f64>() / each.len() as f64)
    };
    let fitted = of("identify")?;
    let held_out = of("validate").unwrap_or(fitted);
    let merit = HELD_OUT * held_out + (1.0 - HELD_OUT) * fitted;
    Some(([fitted.exp(), held_out.exp()], merit))
}

/// Compares one case that ran; whether the true effects fit better. None where nothing can be compared.
pub fn fit_better(
    case: &SetCase,
    context: &Context,
    set: &'static str,
) -> Result<Option<bool>, String> {
    let json = case.answer(context, set)?;
    let (Some(effects), Ok(text)) = (true_effects(case), std::fs::read_to_string(&json)) else {
        return Ok(None);
    };
    let told = |e: serde_json::Error| format!("{}: {e}", json.display());
    let searched = FinderAnswer::of(&serde_json::from_str(&text).map_err(told)?)?;
    let data = case.data.to_string_lossy();
    let (value, _) = answered(
        &context.program,
        &["identify", &data, "--effects", &effects],
        &json.with_extension("true.json"),
    )?;
    let ends = [super::answer::records_of(&value), searched.records].map(|r| errors_nm(&r));
    let [Some((truth_nm, truth)), Some((search_nm, search))] = ends else {
        return Ok(None);
    };
    let is_better = truth < search - MATTERS;
    println!(
        "{set:<12} {:<34} true effects {:>8.2}/{:<8.2} search {:>8.2}/{:<8.2} nm{}",
        case.name,
        truth_nm[0],
        truth_nm[1],
        search_nm[0],
        search_nm[1],
        if is_better { "  lost" } else { "" }
    );
    Ok(Some(is_better))
}
