//! Four recordings with something wrong about them, asked from the command line, from the page and by
//! `score`: the same answer.

use super::answer::FinderAnswer;
use super::case::{CaseCheck, CaseStart, SetCase, answered};
use super::context::{Context, spread};
use super::page;
use super::results::ResultRow;
use gone_wrong::{CASES, Wrong};
use serde_json::Value;

#[path = "../../../lab/cli/tests/integration/common/gone_wrong.rs"]
mod gone_wrong;

/// The four cases.
pub fn cases(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let folder = context.folder_of("front_ends")?;
    let case = |wrong: Wrong| -> Result<SetCase, String> {
        let data = wrong
            .write(&folder)
            .map_err(|e| format!("{}: {e}", folder.display()))?;
        Ok(SetCase {
            name: wrong.name().into(),
            data,
            start: CaseStart::Effects(wrong.base().into()),
            check: CaseCheck::FrontEnds,
            noise_um: None,
        })
    };
    Ok(spread(
        CASES.into_iter().map(case).collect::<Result<Vec<_>, _>>()?,
        most,
    ))
}

/// Asks all front ends and compares.
pub fn compared(case: &SetCase, context: &Context, set: &str) -> Result<ResultRow, String> {
    let CaseStart::Effects(from) = &case.start else {
        return Err("a front end starts from effects".into());
    };
    let folder = context.folder_of("answers")?.join(&context.label);
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let json = folder.join(format!("{set}_{}.json", case.name));
    let (cli, cost) = answered(
        &context.program,
        &["explain", &case.data.to_string_lossy(), "--from", from],
        &json,
    )?;
    let answer = FinderAnswer::of(&cli)?;
    let mut differs = Vec::new();
    let of_page = page::explained(&context.program, &case.data, from)?;
    differs.extend(
        difference(&without_times(&cli), &without_times(&of_page), "")
            .map(|at| format!("page at {at}")),
    );
    let parent = case.data.parent().ok_or("a case without folder")?;
    let scored = folder.join(format!("{set}_{}.score.json", case.name));
    let (score, ..) = answered(
        &context.program,
        &["score", &parent.to_string_lossy()],
        &scored,
    )?;
    let of_score = &score["cases"][0];
    if of_score["verdict"] != cli["diagnosis"]["verdict"]
        || of_score["named"] != cli["diagnosis"]["named"]
    {
        differs.push(format!(
            "score says {}",
            of_score["verdict"].as_str().unwrap_or_default()
        ));
    }
    let mut row = ResultRow {
        set: set.into(),
        case: case.name.clone(),
        ..ResultRow::default()
    };
    row.fill(&answer, cost);
    row.mark = if differs.is_empty() {
        "equal".into()
    } else {
        differs.join("; ").replace(',', " ")
    };
    Ok(row)
}

fn without_times(value: &Value) -> Value {
    let mut value = value.clone();
    if let Some(object) = value.as_object_mut() {
        object.remove("seconds");
    }
    value
}

/// Where two values differ first.
fn difference(a: &Value, b: &Value, at: &str) -> Option<String> {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) => {
            let keys: std::collections::BTreeSet<&String> = x.keys().chain(y.keys()).collect();
            let each =
                |key: &&String| difference(x.get(*key)?, y.get(*key)?, &format!("{at}.{key}"));
            keys.iter()
                .find(|key| !x.contains_key(**key) || !y.contains_key(**key))
                .map(|key| format!("{at}.{key}"))
                .or_else(|| keys.iter().find_map(each))
        }
        (Value::Array(x), Value::Array(y)) if x.len() == y.len() => x
            .iter()
            .zip(y)
            .enumerate()
            .find_map(|(i, (x, y))| difference(x, y, &format!("{at}[{i}]"))),
        _ => (a != b).then(|| at.to_owned()),
    }
}
