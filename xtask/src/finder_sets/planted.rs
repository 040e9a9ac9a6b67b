//! Simulated cases whose truth is known: those beside the project, and those that `hysteron plant` makes.

use super::case::SetCase;
use super::context::{Context, beside, spread};
use super::mark::CaseTruth;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};

/// Seeds that nothing was developed on.
const SEEDS: [u64; 3] = [611_000, 722_000, 833_000];
/// Structures of hysteresis other than the surfaces.
const OTHER_LOOPS: [&str; 4] = [
    "prandtl_ishlinskii",
    "modified_prandtl_ishlinskii",
    "maxwell_slip",
    "bouc_wen",
];

/// The cases of another program.
pub fn shared(_: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    Ok(spread(of_folder(&beside("planted")?, "")?, most))
}

/// One hidden effect, at three strengths.
pub fn all(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let each = of_seeds(context, "all", "hysteresis", "1,2,4", &SEEDS, most)?;
    Ok(each.into_iter().filter(|case| !is_nothing(case)).collect())
}

/// Nothing is hidden.
pub fn nothing(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let folder = planted(context, "nothing", "none", "hysteresis", "1", SEEDS[0], 40)?;
    Ok(spread(of_folder(&folder, "")?, most))
}

fn is_nothing(case: &SetCase) -> bool {
    matches!(
        case.check,
        super::case::CaseCheck::Names(CaseTruth::Nothing)
    )
}

/// Two hidden effects.
pub fn pairs(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    of_seeds(context, "pairs", "hysteresis", "2", &SEEDS[..2], most)
}

/// Three hidden effects.
pub fn triples(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    of_seeds(context, "triples", "hysteresis", "2", &SEEDS[..2], most)
}

/// One hidden effect beside loops of another structure.
pub fn other_loops(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let quota = most.map(|most| most.div_ceil(OTHER_LOOPS.len()));
    let mut out = Vec::new();
    for structure in OTHER_LOOPS {
        out.extend(of_seeds(
            context,
            "all",
            structure,
            "2",
            &SEEDS[..2],
            quota,
        )?);
    }
    Ok(out)
}

/// The cases of several seeds; of few, only of the first ones.
fn of_seeds(
    context: &Context,
    kinds: &str,
    loops: &str,
    strengths: &str,
    seeds: &[u64],
    most: Option<usize>,
) -> Result<Vec<SetCase>, String> {
    let mut out = Vec::new();
    for (i, seed) in seeds.iter().enumerate() {
        let quota = most.map(|most| most / seeds.len() + usize::from(i < most % seeds.len()));
        if quota == Some(0) {
            continue;
        }
        let name = format!("{kinds}_{loops}_{seed}");
        let folder = planted(context, &name, kinds, loops, strengths, *seed, 1)?;
        let prefix = if loops == "hysteresis" {
            format!("{seed}/")
        } else {
            format!("{loops}/{seed}/")
        };
        out.extend(spread(of_folder(&folder, &prefix)?, quota));
    }
    Ok(out)
}

/// A folder of planted cases, made once.
fn planted(
    context: &Context,
    name: &str,
    kinds: &str,
    loops: &str,
    strengths: &str,
    seed: u64,
    cases: usize,
) -> Result<std::path::PathBuf, String> {
    let folder = context.folder_of("planted")?.join(name);
    if folder.join("truth.json").exists() {
        return Ok(folder);
    }
    println!("planting {name}");
    let (out, seed, cases) = (
        folder.to_string_lossy().into_owned(),
        seed.to_string(),
        cases.to_string(),
    );
    let arguments = [
        "plant",
        kinds,
        "--out",
        &out,
        "--hysteresis",
        loops,
        "--strengths",
        strengths,
        "--seed",
        &seed,
        "--cases",
        &cases,
        "--force",
    ];
    let run = Command::new(&context.program)
        .args(arguments)
        .stdin(Stdio::null())
        .output()
        .map_err(|e| format!("{}: {e}", context.program.display()))?;
    if run.status.success() {
        Ok(folder)
    } else {
        Err(format!(
            "hysteron {}: {}",
            arguments.join(" "),
            String::from_utf8_lossy(&run.stderr)
        ))
    }
}

/// The cases that a `truth.json` lists.
pub fn of_folder(folder: &Path, prefix: &str) -> Result<Vec<SetCase>, String> {
    let path = folder.join("truth.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let truths: Vec<Value> =
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    let case = |truth: &Value| -> Option<SetCase> {
        let name = truth["name"].as_str()?;
        let ids = |key: &str| {
            truth[key].as_array().map_or_else(Vec::new, |all| {
                all.iter()
                    .filter_map(|v| v.as_str().map(str::to_owned))
                    .collect()
            })
        };
        let missing: Vec<String> = ["hidden", "second", "third"]
            .into_iter()
            .filter_map(|key| truth[key].as_str().map(str::to_owned))
            .collect();
        let known = if missing.is_empty() {
            CaseTruth::Nothing
        } else if missing.iter().any(|id| id.starts_with("outside_library")) {
            CaseTruth::Outside
        } else {
            CaseTruth::Missing(missing.clone(), ids("also"))
        };
        let what = if missing.is_empty() {
            "none".into()
        } else {
            missing.join("+")
        };
        let base: Vec<String> = ids("base");
        Some(SetCase::named(
            format!("{prefix}{name} {what}"),
            folder.join(name),
            &base.join(","),
            known,
            truth["noise_um"].as_f64(),
        ))
    };
    truths
        .iter()
        .map(|t| case(t).ok_or_else(|| format!("{}: a case without name", path.display())))
        .collect()
}
