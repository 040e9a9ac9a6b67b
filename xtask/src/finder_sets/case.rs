//! One case: a data set, where the search starts, what is true; and one run of the program on it.

use super::answer::FinderAnswer;
use super::context::Context;
use super::mark::{CaseTruth, Mark, mark};
use super::results::{ResultRow, Results};
use crate::cost::{Cost, Stopwatch};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Where a search starts.
#[derive(Clone, Debug)]
pub enum CaseStart {
    /// From these effects.
    Effects(String),
    /// From the model that the program itself found on another data set.
    ModelOf(PathBuf),
}

/// What is compared with what.
#[derive(Clone, Debug)]
pub enum CaseCheck {
    /// The names with the truth.
    Names(CaseTruth),
    /// Errors and seconds stand for themselves; samples by record weigh the errors.
    Errors(Vec<(String, f64)>),
    /// The names with those of another case of the same set, which stands before it.
    SameAs(String),
    /// The answers of all front ends with one another.
    FrontEnds,
}

/// One case of a set.
#[derive(Clone, Debug)]
pub struct SetCase {
    /// Its name within the set.
    pub name: String,
    /// The data set.
    pub data: PathBuf,
    /// Where the search starts.
    pub start: CaseStart,
    /// What is compared.
    pub check: CaseCheck,
    /// Noise of a simulated case, um.
    pub noise_um: Option<f64>,
}

/// One set of cases.
pub struct Set {
    /// Its name on the command line and in the results.
    pub name: &'static str,
    /// What is asked of it.
    pub asked: &'static str,
    /// All its cases, or some of them.
    pub cases: fn(&Context, Option<usize>) -> Result<Vec<SetCase>, String>,
}

/// Runs the program; its JSON and what it cost.
pub fn answered(program: &Path, arguments: &[&str], json: &Path) -> Result<(Value, Cost), String> {
    let stopwatch = Stopwatch::start();
    let path = json.to_string_lossy();
    let run = Command::new(program)
        .args(arguments)
        .args(["--json", &path, "--force"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .output()
        .map_err(|e| format!("{}: {e}", program.display()))?;
    let cost = stopwatch.read();
    // `score` ends with 1 where a case is wrong, and has answered.
    if !matches!(run.status.code(), Some(0 | 1)) {
        let said = String::from_utf8_lossy(&run.stderr).trim().to_owned();
        return Err(format!(
            "hysteron {}: {}: {said}",
            arguments.join(" "),
            run.status
        ));
    }
    let text = std::fs::read_to_string(json).map_err(|e| format!("{path}: {e}"))?;
    Ok((
        serde_json::from_str(&text).map_err(|e| format!("{path}: {e}"))?,
        cost,
    ))
}

impl SetCase {
    /// A case whose names are compared with the truth.
    pub fn named(
        name: String,
        data: PathBuf,
        from: &str,
        truth: CaseTruth,
        noise_um: Option<f64>,
    ) -> Self {
        Self {
            name,
            data,
            start: CaseStart::Effects(from.to_owned()),
            check: CaseCheck::Names(truth),
            noise_um,
        }
    }

    /// Where its answer is.
    pub fn answer(&self, context: &Context, set: &str) -> Result<PathBuf, String> {
        let answers = context.folder_of("answers")?.join(&context.label);
        std::fs::create_dir_all(&answers).map_err(|e| format!("{}: {e}", answers.display()))?;
        Ok(answers.join(format!("{set}_{}.json", self.name.replace(['/', ' '], "_"))))
    }

    /// Runs it once.
    pub fn run(
        &self,
        context: &Context,
        set: &'static str,
        results: &Results,
    ) -> Result<ResultRow, String> {
        let json = self.answer(context, set)?;
        let data = self.data.to_string_lossy();
        let policy = context.policy.as_ref().map(|path| path.to_string_lossy());
        let policy: Vec<&str> = policy.iter().flat_map(|path| ["--policy", path]).collect();
        let asked = match &self.start {
            CaseStart::Effects(from) => answered(
                &context.program,
                &[&["explain", &data, "--from", from], &policy[..]].concat(),
                &json,
            ),
            CaseStart::ModelOf(clean) => {
                let model = model_of(context, clean)?;
                answered(
                    &context.program,
                    &[&["diagnose", &model.to_string_lossy(), &data], &policy[..]].concat(),
                    &json,
                )
            }
        };
        let mut row = ResultRow {
            set: set.into(),
            case: self.name.clone(),
            truth: self.truth(),
            ..ResultRow::default()
        };
        // A data set that the program refuses is an answer too, and no name.
        let (answer, cost) = match asked {
            Ok((value, cost)) => (FinderAnswer::of(&value)?, cost),
            Err(problem) => {
                row.verdict = "refused".into();
                row.mark = Mark::Missed.word().into();
                eprintln!("{set} {}: {problem}", self.name);
                return Ok(row);
            }
        };
        row.fill(&answer, cost);
        row.mark = match &self.check {
            CaseCheck::Names(truth) => {
                mark(&answer, truth, || self.is_at_the_noise(context, &json))?
                    .word()
                    .into()
            }
            CaseCheck::SameAs(reference) => {
                let names = results
                    .names_of(set, reference)
                    .ok_or_else(|| format!("{reference} stands before {}", self.name))?;
                if names == answer.names() {
                    "same".into()
                } else {
                    format!("other than {names}")
                }
            }
            CaseCheck::Errors(weights) => {
                row.ends_um = ends_um(&answer, weights);
                "-".into()
            }
            CaseCheck::FrontEnds => return Err("`front_ends` compares these".into()),
        };
        if let CaseCheck::SameAs(_) = self.check {
        } else {
            row.names = answer.names();
        }
        Ok(row)
    }

    /// What is true, as the results hold it.
    fn truth(&self) -> String {
        match &self.check {
            CaseCheck::Names(CaseTruth::Missing(missing, _)) => missing.join("+"),
            CaseCheck::Names(CaseTruth::Altered(right, _)) => right.join("|"),
            CaseCheck::Names(CaseTruth::Outside) => "outside".into(),
            CaseCheck::Names(CaseTruth::Nothing) => "nothing".into(),
            CaseCheck::SameAs(reference) => format!("as {reference}"),
            _ => String::new(),
        }
    }

    /// Whether the effects that were started from, fitted, leave no more than the noise in any record: five
    /// standard deviations of the mean square of as many samples of noise.
    fn is_at_the_noise(&self, context: &Context, beside: &Path) -> Result<bool, String> {
        let (CaseStart::Effects(from), Some(noise_um)) = (&self.start, self.noise_um) else {
            return Ok(true);
        };
        let json = beside.with_extension("base.json");
        let (value, ..) = answered(
            &context.program,
            &["identify", &self.data.to_string_lossy(), "--effects", from],
            &json,
        )?;
        let records = value["records"].as_array().cloned().unwrap_or_default();
        for record in records
            .iter()
            .filter(|r| r["role"] == "identify" || r["role"] == "validate")
        {
            let (Some(file), Some(rms_um)) = (record["file"].as_str(), record["rms_um"].as_f64())
            else {
                continue;
            };
            let samples = samples_of(&self.data.join(format!("{file}.csv")))?;
            let excess_um2 = rms_um * rms_um - noise_um * noise_um;
            if excess_um2 > 5.0 * noise_um * noise_um * (2.0 / samples).sqrt() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Rows of a table below its header.
fn samples_of(path: &Path) -> Result<f64, String> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(text.lines().count().saturating_sub(1) as f64)
}

/// The model that the program finds on a data set from a gain; found once for each label.
pub fn model_of(context: &Context, data: &Path) -> Result<PathBuf, String> {
    let folder = context.folder_of("models")?.join(&context.label);
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let name = data
        .file_name()
        .map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let model = folder.join(format!("{name}.toml"));
    if !model.exists() {
        let out = model.to_string_lossy();
        answered(
            &context.program,
            &[
                "explain",
                &data.to_string_lossy(),
                "--from",
                "gain",
                "--out",
                &out,
            ],
            &folder.join(format!("{name}.json")),
        )?;
    }
    Ok(model)
}

/// The names that the program finds on a data set from a gain.
pub fn own_effects(context: &Context, data: &Path) -> Result<Vec<String>, String> {
    let json = model_of(context, data)?.with_extension("json");
    let text = std::fs::read_to_string(&json).map_err(|e| format!("{}: {e}", json.display()))?;
    let value: Value =
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", json.display()))?;
    let effects = value["effects"].as_array().cloned().unwrap_or_default();
    Ok(effects
        .iter()
        .filter_map(|v| v.as_str().map(str::to_owned))
        .collect())
}

/// Geometric mean of the errors on fitted and held-out records, um, each the root of the mean square over the
/// samples.
fn ends_um(answer: &FinderAnswer, samples: &[(String, f64)]) -> Option<f64> {
    let of = |role: &str| {
        let each = answer.records.iter().filter(|(_, r, _)| r == role);
        let (sum, count) = each.fold((0.0, 0.0), |(sum, count), (file, _, rms_um)| {
            let weight = samples
                .iter()
                .find(|(name, _)| name == file)
                .map_or(1.0, |(_, n)| *n);
            (sum + weight * rms_um * rms_um, count + weight)
        });
        (count > 0.0).then(|| (sum / count).sqrt())
    };
    let fitted_um = of("identify")?;
    Some(of("validate").map_or(fitted_um, |held_out_um| (fitted_um * held_out_um).sqrt()))
}
