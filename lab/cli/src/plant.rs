//! `plant`.

use crate::desk::{Desk, wrong};
use crate::progress::Progress;
use crate::screen::as_argument;
use hysteron::synthetic::case::{CaseOrder, SyntheticCase, simulate_case, truths_json};
use hysteron::synthetic::case_set::{SetOrder, kinds, simulate_set};
use hysteron::{Error, Result, model_file};
use std::path::{Path, PathBuf};

/// Arguments of `plant`.
#[derive(clap::Args)]
pub struct PlantArguments {
    /// Effects, comma-separated, each with an optional strength: creep=2.0,delay; `all`: a case of every
    /// kind; `pairs`, `triples`: of every two, three that are hidden together
    pub effects: String,
    /// Folder to write
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace files that exist
    #[arg(long)]
    pub force: bool,
    /// Seed of noise and parameters
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Effects that the user of a single case already models, comma-separated
    #[arg(long, default_value = "hysteresis,initial_curve,vibration")]
    pub base: String,
    /// Structure of the hysteresis: hysteresis (the thesis' surfaces), prandtl_ishlinskii, bouc_wen, ...
    #[arg(long, default_value = "hysteresis")]
    pub hysteresis: String,
    /// Cases of each kind and strength; more than one makes a folder of cases
    #[arg(long, default_value_t = 1)]
    pub cases: usize,
    /// Strengths of a set, comma-separated [default: 1]; makes a folder of cases
    #[arg(long, value_delimiter = ',')]
    pub strengths: Vec<String>,
}

/// Simulates a data set with known effects, or a set of them.
pub fn plant(wanted: &PlantArguments) -> Result<bool> {
    let (manifest, truth) = (
        wanted.out.join("dataset.toml"),
        wanted.out.join("truth.json"),
    );
    if manifest.exists() && !truth.exists() {
        return Err(wrong(
            &manifest,
            "is a data set that was not planted; expected a new folder, or one that `plant` has written",
        ));
    }
    let holds_other_things =
        || std::fs::read_dir(&wanted.out).is_ok_and(|mut entries| entries.next().is_some());
    if !truth.exists() && !wanted.force && holds_other_things() {
        return Err(wrong(
            &wanted.out,
            "holds other things; expected a new or an empty folder, or --force",
        ));
    }
    if wanted.cases == 0 {
        return Err(Error::new("--cases", "0 cases; expected at least one"));
    }
    let hysteresis = wanted.hysteresis.replace('-', "_");
    let many = kinds(&wanted.effects);
    if many.is_some() || wanted.cases > 1 || !wanted.strengths.is_empty() {
        let hidden = many.map_or_else(|| parse_kind(&wanted.effects).map(|ids| vec![ids]), Ok)?;
        let strengths = match wanted.strengths.as_slice() {
            [] => vec![1.0],
            given => given
                .iter()
                .map(|s| strength(s, "--strengths"))
                .collect::<Result<_>>()?,
        };
        return plant_many(
            &SetOrder {
                hidden,
                strengths,
                cases: wanted.cases,
                hysteresis,
                seed: wanted.seed,
            },
            wanted,
        );
    }
    let base: Vec<String> = model_file::effects_named(&wanted.base)?
        .iter()
        .map(|e| e.declaration().id)
        .collect();
    let order = CaseOrder {
        hidden: parse_hidden(&wanted.effects)?,
        base,
        hysteresis,
        seed: wanted.seed,
    };
    if let Some((id, _)) = order.hidden.iter().find(|(id, _)| order.base.contains(id)) {
        return Err(Error::new(
            "effects",
            format!("{id} is to be hidden, but --base models it"),
        ));
    }
    let name = wanted
        .out
        .file_name()
        .map_or_else(|| "planted".into(), |n| n.to_string_lossy().into_owned());
    let case = simulate_case(&order, &name)?;
    write_case(&case, &wanted.out, wanted.force)?;
    let truth = case.truth;
    println!(
        "{}: hidden {}, noise {:.2} nm",
        wanted.out.display(),
        list_or_nothing(&order.hidden),
        1e3 * truth.noise_um
    );
    println!(
        "Next: hysteron explain {} --from {}",
        as_argument(&wanted.out),
        order.base.join(",")
    );
    Ok(true)
}

/// What every case of a set hides; its strengths are those of the set.
fn parse_kind(effects: &str) -> Result<Vec<String>> {
    if effects.contains('=') {
        return Err(Error::new(
            "effects",
            format!("`{effects}` has a strength of its own; a set takes it from --strengths"),
        ));
    }
    Ok(parse_hidden(effects)?
        .into_iter()
        .map(|(id, _)| id)
        .collect())
}

fn plant_many(order: &SetOrder, wanted: &PlantArguments) -> Result<bool> {
    let desk = Desk::new(wanted.force);
    desk.folder(&wanted.out, &["truth.json".to_owned()])?;
    let bar = Progress::start();
    let truths = simulate_set(order, &|case| {
        write_case(case, &wanted.out.join(&case.truth.name), wanted.force)?;
        bar.say(&format!("simulated {}", case.truth.name));
        Ok(())
    })?;
    drop(bar);
    desk.write(&wanted.out.join("truth.json"), &truths_json(&truths)?)?;
    println!("{}: {} cases", wanted.out.display(), truths.len());
    println!("Next: hysteron score {}", as_argument(&wanted.out));
    Ok(true)
}

fn write_case(case: &SyntheticCase, folder: &Path, force: bool) -> Result<()> {
    let desk = Desk::new(force);
    desk.folder(folder, &case.files.keys().cloned().collect::<Vec<_>>())?;
    case.files
        .iter()
        .try_for_each(|(name, bytes)| desk.write(&folder.join(name), bytes))
}

fn list_or_nothing(hidden: &[(String, f64)]) -> String {
    if hidden.is_empty() {
        "nothing".into()
    } else {
        hidden
            .iter()
            .map(|(id, _)| id.as_str())
            .collect::<Vec<_>>()
            .join(" and ")
    }
}

fn strength(text: &str, of: &str) -> Result<f64> {
    let value: f64 = text.trim().parse().map_err(|_| {
        Error::new(
            "effects",
            format!("strength `{text}` of {of} is not a number"),
        )
    })?;
    if value > 0.0 && value <= 100.0 {
        Ok(value)
    } else {
        Err(Error::new(
            "effects",
            format!("strength {value} of {of}; expected above 0, at most 100"),
        ))
    }
}

fn parse_hidden(effects: &str) -> Result<Vec<(String, f64)>> {
    if effects.trim().is_empty() {
        return Err(Error::new(
            "effects",
            "none are given; expected a list like creep=2,delay, or `none`",
        ));
    }
    let mut hidden: Vec<(String, f64)> = Vec::new();
    for item in effects
        .split(',')
        .map(str::trim)
        .filter(|e| !e.is_empty() && *e != "none")
    {
        let (id, text) = item.split_once('=').unwrap_or((item, "1"));
        let id = id.replace('-', "_");
        if hidden.iter().any(|(earlier, _)| *earlier == id) {
            return Err(Error::new("effects", format!("{id} is given twice")));
        }
        let strength = strength(text, &id)?;
        hidden.push((id, strength));
    }
    Ok(hidden)
}
