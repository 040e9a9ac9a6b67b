//! Recordings of real stages: where a search from a gain ends, and how long it takes.

use super::case::{CaseCheck, CaseStart, SetCase};
use super::context::{Context, beside, copy, spread, write};
use super::table_of_numbers::NumberTable;
use crate::workspace::root;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

/// `tests/manifests/recorded_sets.toml`.
#[derive(Deserialize)]
struct File {
    stage: BTreeMap<String, Stage>,
    set: Vec<RecordedSet>,
}

#[derive(Deserialize)]
struct Stage {
    span_v: f64,
    record: String,
    #[serde(default)]
    other: BTreeMap<String, String>,
    #[serde(default)]
    copy_of: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct RecordedSet {
    name: String,
    stage: String,
    fitted: Vec<String>,
    held_out: Vec<String>,
}

/// What a line of a manifest's text says in seconds or Hz.
fn number(text: &str, key: &str) -> Option<f64> {
    text.lines().find_map(|line| {
        line.strip_prefix(key)?
            .trim()
            .strip_prefix('=')?
            .trim()
            .parse()
            .ok()
    })
}

/// The twelve sets.
pub fn twelve(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let (data, path) = (
        beside("measured")?,
        root().join("tests/manifests/recorded_sets.toml"),
    );
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let file: File = toml::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let folder = context.folder_of("recorded")?;
    let case = |set: &RecordedSet| -> Result<SetCase, String> {
        let stage = file
            .stage
            .get(&set.stage)
            .ok_or_else(|| format!("{}: no stage {}", path.display(), set.stage))?;
        let into = folder.join(set.name.replace('+', "_"));
        let mut manifest = format!(
            "name = \"{}\"\ndrive_min_v = -{:.1}\ndrive_max_v = {:.1}\n",
            set.name, stage.span_v, stage.span_v
        );
        let mut weights = Vec::new();
        let each = set
            .fitted
            .iter()
            .map(|name| ("identify", name))
            .chain(set.held_out.iter().map(|name| ("validate", name)));
        for (role, name) in each {
            let source = stage.copy_of.get(name).unwrap_or(name);
            copy(
                &data.join(&set.stage).join(format!("{source}.csv")),
                &into.join(format!("{name}.csv")),
            )?;
            let part = stage.other.get(name).unwrap_or(&stage.record);
            let _ = write!(
                manifest,
                "\n[[record]]\nfile = \"{name}.csv\"\nrole = \"{role}\"\ninitial_state = \"unknown\"\n{part}\n"
            );
            let rate_hz = number(part, "sample_rate_hz").unwrap_or(1.0);
            let from = number(part, "from_s").unwrap_or(0.0) * rate_hz;
            let rows = std::fs::read_to_string(into.join(format!("{name}.csv")))
                .map_or(0, |t| t.lines().count()) as f64;
            let to = number(part, "to_s").map_or(rows, |s| s * rate_hz);
            weights.push((name.clone(), to - from));
        }
        write(&into.join("dataset.toml"), &manifest)?;
        Ok(SetCase {
            name: set.name.clone(),
            data: into,
            start: CaseStart::Effects("gain".into()),
            check: CaseCheck::Errors(weights),
            noise_um: None,
        })
    };
    let all: Result<Vec<SetCase>, String> = file.set.iter().map(case).collect();
    Ok(spread(all?, most))
}

/// The shipped example from a gain, and the recording at 20 Hz from 1.5 s on as one file.
pub fn speed(context: &Context, _: Option<usize>) -> Result<Vec<SetCase>, String> {
    let case = |name: &str, data: PathBuf| SetCase {
        name: name.into(),
        data,
        start: CaseStart::Effects("gain".into()),
        check: CaseCheck::Errors(Vec::new()),
        noise_um: None,
    };
    let mut out = vec![case("example", root().join("examples/hidden_effect"))];
    if let Ok(data) = beside("measured/piezo_stage") {
        let mut table = NumberTable::read(&data.join("20_hz_no_lp.csv"))?;
        table.rows.retain(|row| row[0] >= 1.5 - 1e-9);
        let path = context.folder_of("speed")?.join("20_hz_from_1_5_s.csv");
        table.write(&path)?;
        out.push(case("20 Hz as one file", path));
    }
    Ok(out)
}
