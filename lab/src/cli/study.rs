//! `explain`, `identify`, `compare`, `diagnose`, `add`, `simulate`.

use super::Outputs;
use super::output::{Progress, check_writable, print_notes, print_records, print_steps, write_json};
use crate::dataset::Dataset;
use crate::dataset::table::Table;
use crate::diagnosis::growth::{Workbench, nm};
use crate::diagnosis::refit::{Split, Trial, judge, refit};
use crate::diagnosis::screening::screen;
use crate::diagnosis::verdict::{Diagnosis, Verdict};
use crate::explain::{self, FitFigures, Start, fit_figures, require_identifiable, step_figures, unidentified};
use crate::fit::{Effort, fit};
use crate::floor::noise_floor;
use crate::model_file;
use crate::problem::{Problem, Result, nearest, write_whole};
use crate::report::ExplainReport;
use hysteron_sim::chain::{Drive, InitialState, Model};
use hysteron_sim::effect::Effect;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

fn command_line() -> String {
    let mut words: Vec<String> = std::env::args().collect();
    if let Some(program) = words.first_mut() {
        *program = "hysteron".into();
    }
    words.join(" ")
}

fn write_page(path: Option<&Path>, report: impl FnOnce() -> ExplainReport) -> Result<()> {
    match path {
        Some(path) => crate::report::explain_page(&report()).write_html(path).map_err(|e| Problem::file(path, e)),
        None => Ok(()),
    }
}

fn check_outputs(outputs: &Outputs, out: Option<&Path>) -> Result<()> {
    check_writable(outputs.json.as_deref())?;
    check_writable(outputs.report.as_deref())?;
    check_writable(out)
}

fn effects_from(argument: &str) -> Result<Vec<Arc<dyn Effect>>> {
    let path = Path::new(argument);
    if !argument.ends_with(".toml") && path.is_file() {
        let text = std::fs::read_to_string(path).map_err(|e| Problem::file(path, format!("cannot be read: {e}")))?;
        return model_file::parse_effects(&text);
    }
    model_file::parse_effects(argument)
}

fn say_next(outputs: &Outputs, dataset: &Path) {
    match &outputs.report {
        Some(path) => println!("Open {} to look at it.", path.display()),
        None => println!("To look at it: add --report page.html  (data: {})", dataset.display()),
    }
}

/// The main job.
pub fn explain(path: &Path, from: &str, own: &str, out: Option<&Path>, outputs: &Outputs) -> Result<bool> {
    let started = Instant::now();
    check_outputs(outputs, out)?;
    let effects = effects_from(from)?;
    let own = model_file::parse_effects(own)?;
    let dataset = Dataset::load(path)?;
    let progress = Progress::start();
    let found = explain::explain(&dataset, Start::Effects(&effects), &own, &|m| progress.say(m));
    drop(progress);
    let figures = found.figures(&dataset, started.elapsed().as_secs_f64());
    println!("{}: {}", dataset.name, found.diagnosis.sentence);
    print_steps(&figures.steps, figures.noise_floor_um);
    println!();
    print_records(&figures);
    print_notes(&figures);
    for step in figures.steps.iter().skip(1) {
        if let Some(id) = &step.added {
            println!("  why {id}: {}", step.why);
        }
    }
    say_candidates(&found.diagnosis);
    write_next_experiment(&found, outputs)?;
    if let Some(path) = out {
        model_file::write(path, &found.model, &dataset.name)?;
    }
    if let Some(path) = &outputs.json {
        write_json(path, &figures)?;
    }
    write_page(outputs.report.as_deref(), || found.report(&dataset, command_line()))?;
    println!(
        "{:.1} s. {}",
        figures.seconds,
        out.map_or_else(|| "Keep the model with --out model.toml.".into(), |p| format!("Model: {}", p.display()))
    );
    say_next(outputs, path);
    Ok(true)
}

/// Writes the drive that would decide beside the other outputs.
fn write_next_experiment(found: &explain::Explanation, outputs: &Outputs) -> Result<()> {
    let Some(next) = &found.next_experiment else { return Ok(()) };
    println!("  {}", next.sentence);
    if let Some(beside) = outputs.report.as_ref().or(outputs.json.as_ref()) {
        let path = beside.with_extension("next_drive.csv");
        write_whole(&path, next.proposal.csv().as_bytes())?;
        println!("  that drive, ready to run: {}", path.display());
    }
    Ok(())
}

fn say_candidates(diagnosis: &Diagnosis) {
    match diagnosis.verdict {
        Verdict::Ambiguous => {
            for c in diagnosis.candidates.iter().filter(|c| diagnosis.named.contains(&c.effect)) {
                println!("  to tell {} from the others: {}", c.effect, c.next_experiment);
            }
        }
        Verdict::Unexplained => {
            if let Some(c) = diagnosis.candidates.first() {
                println!(
                    "  the best known effect, {}, explains {:.0} % of it; write your own as a .toml file and pass it with --own",
                    c.effect,
                    100.0 * c.explained_share
                );
            }
        }
        _ => {}
    }
}

fn with_kind(effects: Vec<Arc<dyn Effect>>, kind: Option<&str>) -> Result<Vec<Arc<dyn Effect>>> {
    let Some(kind) = kind else { return Ok(effects) };
    let extra: &[&str] = match kind.replace('_', "-").as_str() {
        "preisach" => &["hysteresis"],
        "one-sided" => &["hysteresis", "initial_curve"],
        "rate-dependent" => &["hysteresis", "initial_curve", "rate_dependence"],
        "prandtl-ishlinskii" => &["prandtl_ishlinskii"],
        "modified-prandtl-ishlinskii" => &["modified_prandtl_ishlinskii"],
        "maxwell-slip" => &["maxwell_slip"],
        "bouc-wen" => &["bouc_wen"],
        "duhem" => &["duhem"],
        other => {
            let known = [
                "preisach",
                "one-sided",
                "rate-dependent",
                "prandtl-ishlinskii",
                "modified-prandtl-ishlinskii",
                "maxwell-slip",
                "bouc-wen",
                "duhem",
            ];
            return Err(Problem::new("--hysteresis", format!("`{other}` is not known{}", nearest(other, &known.map(String::from)))));
        }
    };
    let mut out = model_file::parse_effects(&extra.join(","))?;
    let replaced = ["gain", "hysteresis", "initial_curve", "rate_dependence"];
    out.extend(effects.into_iter().filter(|e| !replaced.contains(&e.declaration().id.as_str())));
    Ok(out)
}

fn finish(
    mut model: Model,
    steps: Vec<explain::StepFigures>,
    requested: &[Arc<dyn Effect>],
    dataset: &Dataset,
    started: Instant,
) -> Result<(Model, FitFigures)> {
    let split = Split::of(dataset);
    let cannot = unidentified(&mut model, dataset, &split);
    require_identifiable(&model, requested, &cannot, dataset)?;
    let floor = noise_floor(dataset);
    let figures = fit_figures(&model, dataset, &floor, steps, cannot, started.elapsed().as_secs_f64());
    Ok((model, figures))
}

fn write_fit(model: &Model, figures: &FitFigures, dataset: &Dataset, out: Option<&Path>, outputs: &Outputs) -> Result<()> {
    if let Some(path) = out {
        model_file::write(path, model, &dataset.name)?;
    }
    if let Some(path) = &outputs.json {
        write_json(path, figures)?;
    }
    write_page(outputs.report.as_deref(), || comparison_report(model, dataset, figures))
}

fn comparison_report(model: &Model, dataset: &Dataset, figures: &FitFigures) -> ExplainReport {
    let split = Split::of(dataset);
    let judged = judge(model.clone(), dataset, &split);
    let floor = noise_floor(dataset);
    let mut warnings = figures.warnings.clone();
    warnings.extend(figures.cannot_identify.iter().map(|c| format!("cannot be identified from this data: {c}")));
    ExplainReport {
        data_set: dataset.name.clone(),
        verdict: "compared".into(),
        sentence: format!(
            "The model ({}) meets the held-out records within {} nm RMS{}.",
            figures.effects.join(", "),
            nm(judged.validate_rms_um.unwrap_or(judged.identify_rms_um)),
            figures.noise_floor_um.map_or_else(String::new, |f| format!("; the noise is {} nm", nm(f)))
        ),
        records: explain::record_reports(&[model], dataset),
        noise_floor: explain::floor_report(&floor),
        steps: vec![crate::report::StepReport {
            added: None,
            removed: Vec::new(),
            why: "the model as it is".into(),
            identify_rms_um: judged.identify_rms_um,
            validate_rms_um: judged.validate_rms_um,
        }],
        parameters: explain::parameter_reports(model),
        warnings,
        program_version: env!("CARGO_PKG_VERSION").into(),
        command: command_line(),
        ..ExplainReport::default()
    }
}

/// Fits a list of effects.
pub fn identify(path: &Path, effects: &str, kind: Option<&str>, out: Option<&Path>, outputs: &Outputs) -> Result<bool> {
    let started = Instant::now();
    check_outputs(outputs, out)?;
    let effects = with_kind(effects_from(effects)?, kind)?;
    let dataset = Dataset::load(path)?;
    let progress = Progress::start();
    let floor = noise_floor(&dataset);
    let workbench = Workbench {
        dataset: &dataset,
        overview: dataset.overview(),
        split: Split::of(&dataset),
        candidates: Vec::new(),
        floor_um: floor.rms_um,
        progress: &|m| progress.say(m),
    };
    let judged = workbench.build(&effects);
    drop(progress);
    let step = step_figures(None, Vec::new(), "as requested".into(), &judged);
    let (model, figures) = finish(judged.model, vec![step], &effects, &dataset, started)?;
    println!("{}: {}", dataset.name, figures.effects.join(", "));
    print_records(&figures);
    print_notes(&figures);
    write_fit(&model, &figures, &dataset, out, outputs)?;
    println!(
        "{:.1} s. {}",
        figures.seconds,
        out.map_or_else(
            || "Keep the model with --out model.toml.".into(),
            |p| format!("Next: hysteron diagnose {} {}", p.display(), path.display())
        )
    );
    Ok(true)
}

/// Compares a model as it is.
pub fn compare(model: &Path, path: &Path, outputs: &Outputs) -> Result<bool> {
    let started = Instant::now();
    check_outputs(outputs, None)?;
    let model = model_file::read(model)?;
    let dataset = Dataset::load(path)?;
    let floor = noise_floor(&dataset);
    let figures = fit_figures(&model, &dataset, &floor, Vec::new(), Vec::new(), started.elapsed().as_secs_f64());
    println!("{}: {}", dataset.name, figures.effects.join(", "));
    print_records(&figures);
    if let Some(floor) = figures.noise_floor_um {
        println!("  noise: {} nm, from {}", nm(floor), figures.floor_basis);
    }
    print_notes(&figures);
    write_fit(&model, &figures, &dataset, None, outputs)?;
    say_next(outputs, path);
    Ok(true)
}

/// Says what a model misses.
pub fn diagnose(model: &Path, path: &Path, own: &str, outputs: &Outputs) -> Result<bool> {
    check_outputs(outputs, None)?;
    let own = model_file::parse_effects(own)?;
    let model = model_file::read(model)?;
    let dataset = Dataset::load(path)?;
    let progress = Progress::start();
    let found = explain::explain(&dataset, Start::Model(model), &own, &|m| progress.say(m));
    drop(progress);
    let d = &found.diagnosis;
    println!("{}: {}", dataset.name, d.sentence);
    println!("  {:24} share   p        held out nm before, after", "candidate");
    for c in d.candidates.iter().take(6) {
        println!(
            "  {:24} {:>4.0} %  {:<7.4}  {} , {}{}",
            c.effect,
            100.0 * c.explained_share,
            c.p_value,
            c.validate_rms_before_um.map_or("-".into(), nm),
            c.validate_rms_after_um.map_or("-".into(), nm),
            if c.confusable_with.is_empty() { String::new() } else { format!("   looks like {}", c.confusable_with.join(", ")) }
        );
    }
    say_candidates(d);
    write_next_experiment(&found, outputs)?;
    if let Some(path) = &outputs.json {
        write_json(path, d)?;
    }
    write_page(outputs.report.as_deref(), || found.report(&dataset, command_line()))?;
    say_next(outputs, path);
    Ok(true)
}

/// Adds one effect and fits again.
pub fn add(effect: &str, model: &Path, path: &Path, out: &Path, outputs: &Outputs) -> Result<bool> {
    let started = Instant::now();
    check_outputs(outputs, Some(out))?;
    let requested = model_file::parse_effects(effect)?;
    let [effect] = &requested[..] else { return Err(Problem::new("effect", format!("expected one effect, got {}", requested.len()))) };
    let model = model_file::read(model)?;
    let dataset = Dataset::load(path)?;
    let progress = Progress::start();
    progress.say("fitting");
    let split = Split::of(&dataset);
    let overview = dataset.overview();
    if model.effect(&effect.declaration().id).is_some() {
        return Err(Problem::new("effect", format!("{} is in the model already", effect.declaration().id)));
    }
    let before = judge(model, &dataset, &split);
    let screening = screen(&before.model, &overview, &dataset, &split.identify, std::slice::from_ref(effect), None, 1);
    let Some(score) = screening.scores.first() else {
        return Err(Problem::new(
            dataset.path.display(),
            format!("cannot identify {}: it changes nothing that the model does not already do on this data", effect.declaration().id),
        ));
    };
    let finalist = refit(&before, score, 0, &overview, &dataset, &split, None, Trial::for_promise(1.0, 1.0));
    let judged = judge(fit(&finalist.judged.model, &dataset, &split.identify, Effort::default()).model, &dataset, &split);
    drop(progress);
    let steps = vec![
        step_figures(None, Vec::new(), "the model as it was".into(), &before),
        step_figures(Some(score.id.clone()), Vec::new(), effect.declaration().physics, &judged),
    ];
    let (model, figures) = finish(judged.model, steps, &requested, &dataset, started)?;
    print_steps(&figures.steps, figures.noise_floor_um);
    print_records(&figures);
    print_notes(&figures);
    write_fit(&model, &figures, &dataset, Some(out), outputs)?;
    println!("{:.1} s. Model: {}", figures.seconds, out.display());
    Ok(true)
}

/// Simulates a model.
pub fn simulate(model: &Path, drive: &str, out: &Path, rate_hz: f64) -> Result<bool> {
    check_writable(Some(out))?;
    let model = model_file::read(model)?;
    let (t_s, drive_v, dt_s) = if Path::new(drive).is_file() {
        let path = Path::new(drive);
        let table = Table::read(path)?;
        let (t_s, u_v) = table.drive_only()?;
        let fs = crate::dataset::table::sample_rate_hz(path, &Some(t_s.clone()))?;
        (t_s, u_v, 1.0 / fs)
    } else {
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(Problem::new("--rate-hz", "expected a positive number"));
        }
        let u_v = waveform(drive, rate_hz, model.drive_min_v)?;
        ((0..u_v.len()).map(|k| k as f64 / rate_hz).collect(), u_v, 1.0 / rate_hz)
    };
    let outside = drive_v.iter().copied().find(|u| *u < model.drive_min_v - 1e-9 || *u > model.drive_max_v + 1e-9);
    if let Some(u) = outside {
        return Err(Problem::new(
            "--drive",
            format!("reaches {u} V; the model holds from {} to {} V", model.drive_min_v, model.drive_max_v),
        ));
    }
    let y = model.simulate(&Drive { drive_v: &drive_v, force_n: None, dt_s, initial_state: InitialState::Virgin });
    let mut text = String::from("t_s,u_v,y_um\n");
    for ((t, u), y) in t_s.iter().zip(&drive_v).zip(&y) {
        text.push_str(&format!("{t:.9},{u:.6},{y:.6}\n"));
    }
    write_whole(out, text.as_bytes())?;
    println!("{} samples in {}", y.len(), out.display());
    Ok(true)
}

/// Longest waveform.
const SAMPLES_MAX: f64 = 2e7;

fn waveform(text: &str, rate_hz: f64, rest_v: f64) -> Result<Vec<f64>> {
    let mut parts = text.split(':');
    let kind = parts.next().unwrap_or_default();
    let numbers: Vec<f64> = parts
        .map(|p| p.parse::<f64>().map_err(|_| Problem::new("--drive", format!("`{p}` in `{text}` is not a number"))))
        .collect::<Result<_>>()?;
    let seconds = numbers.last().copied().unwrap_or(0.0);
    if !(1.0..=SAMPLES_MAX).contains(&(seconds * rate_hz)) {
        return Err(Problem::new("--drive", format!("`{text}` is {} samples long; expected 1 to {SAMPLES_MAX}", seconds * rate_hz)));
    }
    let samples = |seconds: f64| (seconds * rate_hz) as usize;
    let time = |k: usize| k as f64 / rate_hz;
    match (kind, &numbers[..]) {
        ("sine", [hz, amplitude, offset, seconds]) => {
            Ok((0..samples(*seconds)).map(|k| offset + amplitude * (std::f64::consts::TAU * hz * time(k)).sin()).collect())
        }
        ("triangle", [slope, peak, seconds]) if *slope > 0.0 && *peak > 0.0 => {
            let half = peak / slope;
            Ok((0..samples(*seconds)).map(|k| rest_v + slope * (half - (time(k).rem_euclid(2.0 * half) - half).abs())).collect())
        }
        ("step", [level, seconds]) => Ok(vec![*level; samples(*seconds)]),
        _ => Err(Problem::new(
            "--drive",
            format!(
                "`{text}` is neither a file nor a waveform; expected sine:HZ:AMPLITUDE_V:OFFSET_V:SECONDS, triangle:V_PER_S:PEAK_V:SECONDS or step:V:SECONDS"
            ),
        )),
    }
}
