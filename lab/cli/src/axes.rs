//! `axes`: stages with several drives and sensors.

use crate::arguments::{Outputs, TimeArguments, as_typed};
use crate::desk::{Desk, wrong};
use crate::progress::Progress;
use crate::tables::say_stopped;
use clap::Subcommand;
use hysteron::several_axes::decoupling::{AxesServo, Decoupling, with_hidden_coupling};
use hysteron::several_axes::finder::{AxesPolicy, find};
use hysteron::several_axes::identification::{RecordError, Structure, identify, record_errors};
use hysteron::several_axes::loop_check::{
    AxesLaw, AxesTrack, CheckedStage, SENSITIVITY_MAX, Sine, WholeCheck, track,
};
use hysteron::several_axes::manifest;
use hysteron::several_axes::matrix_law::{AxesDemands, MatrixServo};
use hysteron::several_axes::model_text::{AxesModel, figures};
use hysteron::several_axes::planted::{AxisPlant, JudgedStage, planted_stage};
use hysteron::several_axes::recordings::{AxesData, AxesRecord};
use hysteron::several_axes::response_matrix::response_matrix;
use hysteron::several_axes::structure::Described;
use hysteron::watch::Watch;
use hysteron::{Error, Result};
use hysteron_report::axes_page;
use hysteron_sim::several_axes::ModalStage;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What to do with a stage of several axes.
#[derive(Subcommand)]
pub enum AxesCommand {
    /// Find which effect is there in which drive, mode or sensor; `hysteron explain` does the same for such a
    /// data set
    Explain {
        /// Folder with dataset.toml, or a manifest, whose columns are lists
        dataset: PathBuf,
        /// Model to start from
        #[arg(long, value_name = "MODEL")]
        from: Option<PathBuf>,
        /// Write the model
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Tell every step of the search
        #[arg(long, short)]
        verbose: bool,
        #[command(flatten)]
        time: TimeArguments,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Identify one model of all records with a given structure, without a search
    Identify {
        /// Folder with dataset.toml, or a manifest, whose columns are lists
        dataset: PathBuf,
        /// Modes, in which every drive and sensor takes part
        #[arg(long, default_value_t = 12)]
        modes: usize,
        /// Model to start from, instead of modes in the responses
        #[arg(long, value_name = "MODEL")]
        from: Option<PathBuf>,
        /// The forces of the actuators remember their extension
        #[arg(long)]
        actuator_hysteresis: bool,
        /// The actuators soften while they move
        #[arg(long)]
        actuator_softening: bool,
        /// Write the model
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Write every figure as JSON; `-` prints it and nothing else
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
        #[command(flatten)]
        time: TimeArguments,
    },
    /// Design servos for the axes of a model, and check each loop as a whole
    Decouple {
        /// Model file
        model: PathBuf,
        /// Share of its own drive by which every drive also moves the modes of the others in the simulated
        /// stage, unknown to the design
        #[arg(long, default_value_t = 0.1)]
        hidden_coupling: f64,
        /// Frequency of the reference
        #[arg(long, default_value_t = 5.0)]
        reference_hz: f64,
        /// Amplitude of the reference, in the unit of the sensors
        #[arg(long, default_value_t = 1.0)]
        amplitude: f64,
        /// Noise of a sensor in its unit, RMS
        #[arg(long, default_value_t = 0.001)]
        noise: f64,
        /// Write every figure as JSON; `-` prints it and nothing else
        #[arg(long, value_name = "FILE")]
        json: Option<PathBuf>,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Simulate the recordings of a stage of three axes with one effect planted in one channel
    Plant {
        /// What to plant: coupling, mode_of_one_drive, friction, delay, creep, nonlinear_stiffness,
        /// sensor_bandwidth, sensor_coupling or actuator_hysteresis
        effect: String,
        /// Folder to write
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Seed of parameters and noise
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Search simulated stages and compare with what was planted in them
    Score {
        /// What to plant, comma-separated
        #[arg(
            long,
            value_delimiter = ',',
            default_value = "coupling,mode_of_one_drive,friction,actuator_hysteresis"
        )]
        effects: Vec<String>,
        /// Stages of each
        #[arg(long, default_value_t = 20)]
        cases: u64,
        /// Write a row for each stage
        #[arg(long, value_name = "CSV")]
        out: Option<PathBuf>,
        /// Replace the file if it exists
        #[arg(long)]
        force: bool,
    },
}

/// Does it.
pub fn axes(command: AxesCommand) -> Result<bool> {
    match command {
        AxesCommand::Explain {
            dataset,
            from,
            out,
            verbose,
            time,
            outputs,
        } => explain(
            &dataset,
            from.as_deref(),
            out.as_deref(),
            &Manner { verbose, time },
            &outputs,
        ),
        AxesCommand::Identify {
            dataset,
            modes,
            from,
            actuator_hysteresis,
            actuator_softening,
            out,
            json,
            force,
            time,
        } => {
            let structure = Structure {
                modes,
                actuator_hysteresis,
                actuator_softening,
            };
            let outputs = Outputs {
                json,
                report: None,
                force,
            };
            identify_structure(
                &dataset,
                structure,
                [from.as_deref(), out.as_deref()],
                &time,
                &outputs,
            )
        }
        AxesCommand::Decouple {
            model,
            hidden_coupling,
            reference_hz,
            amplitude,
            noise,
            json,
            force,
        } => {
            let outputs = Outputs {
                json,
                report: None,
                force,
            };
            let demands = AxesDemands {
                reference_hz,
                amplitude,
                noise,
                sensitivity_peak: SENSITIVITY_MAX,
            };
            decouple(&model, hidden_coupling, &demands, &outputs)
        }
        AxesCommand::Plant {
            effect,
            out,
            seed,
            force,
        } => plant(&effect, &out, seed, force),
        AxesCommand::Score {
            effects,
            cases,
            out,
            force,
        } => score(&effects, cases, out.as_deref(), force),
    }
}

/// The manifest of a data set, if its columns are lists.
fn manifest_of(path: &Path) -> Option<(PathBuf, String)> {
    let file = if path.is_dir() {
        path.join("dataset.toml")
    } else {
        path.to_path_buf()
    };
    if file.extension().is_none_or(|extension| extension != "toml") {
        return None;
    }
    let text = std::fs::read_to_string(&file).ok()?;
    manifest::has_several(&text).then_some((file, text))
}

/// Whether a data set has several drives or sensors.
pub fn is_of_several_axes(path: &Path) -> bool {
    manifest_of(path).is_some()
}

fn load(desk: &Desk, path: &Path) -> Result<AxesData> {
    let Some((file, _)) = manifest_of(path) else {
        return Err(wrong(
            path,
            "is no data set of several axes; expected a folder with dataset.toml, or a manifest, with lists of columns (docs/guides/several_axes.md)",
        ));
    };
    let text = desk.text(&file, "a manifest")?;
    let beside = file
        .parent()
        .unwrap_or_else(|| Path::new("."))
        .to_path_buf();
    manifest::from_manifest(&text, &file.display().to_string(), &|name| {
        desk.bytes(&beside.join(name), "the file of a record")
    })
}

fn read_model(desk: &Desk, path: &Path) -> Result<AxesModel> {
    AxesModel::from_toml(
        &desk.text(path, "a model written by `hysteron axes explain`")?,
        &path.display().to_string(),
    )
}

/// A model to start from, if it has the drives and sensors of a data set.
fn read_start(desk: &Desk, from: &Path, data: &AxesData) -> Result<Described> {
    let model = read_model(desk, from)?;
    let (drives, sensors) = (model.stage.drives.len(), model.stage.sensors.len());
    if (drives, sensors) != (data.drives.len(), data.sensors.len()) {
        return Err(wrong(
            from,
            format!(
                "has {drives} drives and {sensors} sensors; expected {} and {} as in the data set",
                data.drives.len(),
                data.sensors.len()
            ),
        ));
    }
    Ok(Described {
        stage: model.stage,
        effects: model.effects,
    })
}

/// How long a search of several axes takes at most where nobody says.
const SEARCHED_WITHIN: Duration = Duration::from_secs(600);

/// How a search is done.
pub struct Manner {
    /// Every step is printed.
    pub verbose: bool,
    /// How long it may take.
    pub time: TimeArguments,
}

/// Searches a data set.
pub fn explain(
    path: &Path,
    from: Option<&Path>,
    out: Option<&Path>,
    manner: &Manner,
    outputs: &Outputs,
) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.force);
    let data = load(&desk, path)?;
    let start = match from {
        None => Described::empty(&data),
        Some(from) => read_start(&desk, from, &data)?,
    };
    desk.target(out)?;
    outputs.check(&desk)?;
    let progress = Progress::of_search(manner.verbose);
    let time = manner.time.or(SEARCHED_WITHIN);
    let found = time.beside(&progress, |watch| {
        find(&data, &start, &AxesPolicy::default(), watch)
    });
    drop(progress);
    let figures = figures(&found, &data, started.elapsed().as_secs_f64());
    let unit = if figures.error_in == "noise" {
        "x the noise"
    } else {
        "of the reading"
    };
    say_stopped(found.stopped);
    println!("{}: {}", data.name, figures.sentence);
    for effect in &figures.named {
        let or = effect.or.iter().fold(String::new(), |text, other| {
            format!("{text}\n      or {other}")
        });
        println!(
            "  {:<20} {:<48} without it {:.3} {unit}{or}",
            effect.effect, effect.channel, effect.error_without
        );
    }
    for effect in &figures.not_decided {
        println!("  not decided: {effect}");
    }
    for sensor in &figures.sensors {
        println!(
            "  {}: {:.4} {} RMS on held-out records, {:.2} %",
            sensor.sensor, sensor.held_out_rms, data.sensor_unit, sensor.held_out_pct
        );
    }
    println!(
        "  {} parameters, {:.0} s",
        figures.parameters, figures.seconds
    );
    if let Some(out) = out {
        desk.write(
            out,
            AxesModel::new(&found.model, &data).to_toml()?.as_bytes(),
        )?;
    }
    desk.write_json(outputs.json.as_deref(), &figures)?;
    desk.write_page(outputs.report.as_deref(), || {
        axes_page(
            &figures,
            &data,
            &found.model.stage,
            &response_matrix(&data, &found.model),
            as_typed(),
        )
    })?;
    Ok(true)
}

/// Figures of a model of given structure.
#[derive(Serialize)]
struct IdentifiedFigures {
    name: String,
    parameters: usize,
    records: Vec<RecordError>,
    seconds: f64,
}

fn identify_structure(
    path: &Path,
    structure: Structure,
    [from, out]: [Option<&Path>; 2],
    time: &TimeArguments,
    outputs: &Outputs,
) -> Result<bool> {
    let started = Instant::now();
    let desk = Desk::new(outputs.force);
    let data = load(&desk, path)?;
    let from = from
        .map(|from| read_start(&desk, from, &data))
        .transpose()?;
    desk.target(out)?;
    outputs.check(&desk)?;
    let progress = Progress::start();
    let model = time.beside(&progress, |watch| identify(&data, from, structure, watch))?;
    let stopped = progress.stopped();
    drop(progress);
    say_stopped(stopped);
    let figures = IdentifiedFigures {
        name: data.name.clone(),
        parameters: model.parameters(),
        records: record_errors(&data, &model),
        seconds: started.elapsed().as_secs_f64(),
    };
    println!(
        "{}: {} modes, {} parameters, {:.0} s",
        figures.name,
        model.stage.modes.len(),
        figures.parameters,
        figures.seconds
    );
    for record in &figures.records {
        println!(
            "  {:<24} {:<10} error {:.2} % of the readings",
            record.record, record.role, record.error_pct
        );
    }
    if let Some(out) = out {
        desk.write(out, AxesModel::new(&model, &data).to_toml()?.as_bytes())?;
    }
    desk.write_json(outputs.json.as_deref(), &figures)?;
    Ok(true)
}

/// A servo of all axes with its checks.
#[derive(Serialize)]
struct DecoupledFigures {
    scheme: &'static str,
    /// Channels and matrices of a servo with a loop for each channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    servo: Option<AxesServo>,
    on_model: WholeCheck,
    on_hidden: WholeCheck,
    track_model: Vec<AxesTrack>,
    track_hidden: Vec<AxesTrack>,
}

/// Turns of a reference, of which the second half counts.
const TURNS: f64 = 8.0;

/// Lowest and highest frequency of a reference, of the sampling rate: what a move of its turns may take, and
/// what a loop follows.
const REFERENCE_OF_RATE: [f64; 2] = [1e-5, 0.1];

/// Checks and moves of a law on the model, and on the same stage with a hidden coupling.
fn judged(
    scheme: &'static str,
    law: &dyn AxesLaw,
    stages: [&ModalStage; 2],
    demands: &AxesDemands,
) -> DecoupledFigures {
    let checked = |stage| CheckedStage::new(stage, law.period_s()).check(law);
    let tracks = |stage: &ModalStage| {
        let sine = |axis| Sine {
            axis,
            amplitude: demands.amplitude,
            hz: demands.reference_hz,
            turns: TURNS,
        };
        let axes = 0..stage.sensors.len();
        axes.map(|axis| track(law, stage, &sine(axis))).collect()
    };
    let [on_model, on_hidden] = stages.map(checked);
    let [track_model, track_hidden] = stages.map(tracks);
    DecoupledFigures {
        scheme,
        servo: None,
        on_model,
        on_hidden,
        track_model,
        track_hidden,
    }
}

fn print_checks(all: &[DecoupledFigures]) {
    println!(
        "  {:<9} {:<7} {:>15} {:>11} {:>12} {:>10}",
        "", "stage", "spectral radius", "sensitivity", "own error %", "others %"
    );
    for figures in all {
        for (stage, check, track) in [
            ("model", &figures.on_model, &figures.track_model),
            ("hidden", &figures.on_hidden, &figures.track_hidden),
        ] {
            let worst =
                |of: fn(&AxesTrack) -> f64| 100.0 * track.iter().map(of).fold(0.0_f64, f64::max);
            println!(
                "  {:<9} {:<7} {:>15.5} {:>11.2} {:>12.2} {:>10.2}",
                figures.scheme,
                stage,
                check.spectral_radius,
                check.sensitivity_peak,
                worst(|t| t.own),
                worst(|t| t.crosstalk)
            );
        }
    }
}

fn decouple(
    path: &Path,
    hidden_coupling: f64,
    demands: &AxesDemands,
    outputs: &Outputs,
) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let model = read_model(&desk, path)?;
    outputs.check(&desk)?;
    let above_zero = [demands.reference_hz, demands.amplitude, demands.noise];
    if !above_zero.iter().all(|x| x.is_finite() && *x > 0.0) || !hidden_coupling.is_finite() {
        return Err(Error::new(
            "--reference-hz, --amplitude, --noise",
            "expected numbers above zero",
        ));
    }
    let [low_hz, high_hz] = REFERENCE_OF_RATE.map(|share| share * model.sample_rate_hz);
    if !(low_hz..=high_hz).contains(&demands.reference_hz) {
        return Err(Error::new(
            "--reference-hz",
            format!(
                "{}; expected {low_hz:.3} to {high_hz:.0}, for a servo at {:.0} Hz",
                demands.reference_hz, model.sample_rate_hz
            ),
        ));
    }
    let hidden = with_hidden_coupling(&model.stage, hidden_coupling);
    let (stages, dt_s) = ([&model.stage, &hidden], 1.0 / model.sample_rate_hz);
    println!(
        "{}, sampled at {:.0} Hz; reference {} Hz, hidden coupling {hidden_coupling}",
        model.name, model.sample_rate_hz, demands.reference_hz
    );
    let mut all = Vec::new();
    let mut refused = Vec::new();
    for decoupling in [Decoupling::Static, Decoupling::Modal] {
        match AxesServo::design(&model.stage, decoupling, dt_s) {
            Ok(servo) => all.push(DecoupledFigures {
                servo: Some(servo.clone()),
                ..judged(decoupling.name(), &servo, stages, demands)
            }),
            Err(error) => refused.push(error),
        }
    }
    match MatrixServo::design(&model.stage, &model.stage, dt_s, demands) {
        Ok(law) => all.push(judged("pidsmoc", &law, stages, demands)),
        Err(error) => refused.push(error),
    }
    print_checks(&all);
    refused.iter().for_each(|error| println!("  {error}"));
    desk.write_json(outputs.json.as_deref(), &all)?;
    let stable = |figures: &DecoupledFigures| {
        figures.on_model.spectral_radius < 1.0 && figures.on_hidden.spectral_radius < 1.0
    };
    match refused.into_iter().next() {
        Some(error) if all.is_empty() => Err(error),
        _ => Ok(all.iter().all(stable)),
    }
}

fn plant(effect: &str, out: &Path, seed: u64, force: bool) -> Result<bool> {
    let planted = planted_stage(AxisPlant::named(effect)?, seed);
    let desk = Desk::new(force);
    let records = &planted.data.records;
    let file = |n: usize| format!("record_{}.csv", n + 1);
    let mut names: Vec<String> = (0..records.len()).map(file).collect();
    names.extend(["dataset.toml".to_owned(), "truth.toml".to_owned()]);
    desk.folder(out, &names)?;
    let mut text = format!("name = \"simulated stage of three axes, seed {seed}\"\n");
    for (n, record) in planted.periods(seed).iter().enumerate() {
        desk.write(&out.join(file(n)), csv(record).as_bytes())?;
        let list = |what: &str, count: usize| {
            (1..=count)
                .map(|i| format!("\"{what}{i}\""))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let _ = write!(
            text,
            "\n[[record]]\nfile = \"{}\"\nname = \"{}\"\nsample_rate_hz = {:.1}\nrole = \"{}\"\nperiod_s = {}\ncolumns = {{ u = [{}], y = [{}] }}\n",
            file(n),
            record.name,
            record.sample_rate_hz,
            record.role.name(),
            (records[n].counted_to - records[n].counted_from) as f64 / record.sample_rate_hz,
            list("u", record.drives.len()),
            list("y", record.readings.len())
        );
    }
    desk.write(&out.join("dataset.toml"), text.as_bytes())?;
    let truth = toml::to_string(&planted.stage).map_err(|e| Error::new("truth.toml", e))?;
    desk.write(
        &out.join("truth.toml"),
        format!("# {}\n{truth}", planted.truth).as_bytes(),
    )?;
    println!(
        "{} records, {}: {}",
        records.len(),
        planted.truth,
        out.display()
    );
    Ok(true)
}

fn csv(record: &AxesRecord) -> String {
    let heads = (1..=record.drives.len())
        .map(|j| format!("u{j}"))
        .chain((1..=record.readings.len()).map(|i| format!("y{i}")));
    let mut text = heads.collect::<Vec<_>>().join(",") + "\n";
    for k in 0..record.drives[0].len() {
        let row = record
            .drives
            .iter()
            .chain(&record.readings)
            .map(|signal| format!("{:.7e}", signal[k]));
        text += &(row.collect::<Vec<_>>().join(",") + "\n");
    }
    text
}

fn score(effects: &[String], cases: u64, out: Option<&Path>, force: bool) -> Result<bool> {
    let desk = Desk::new(force);
    desk.target(out)?;
    let plants = effects
        .iter()
        .map(|name| AxisPlant::named(name.trim()))
        .collect::<Result<Vec<_>>>()?;
    let progress = Progress::start();
    let mut table = format!("{}\n", JudgedStage::COLUMNS);
    println!(
        "{:<20} {:>6} {:>8} {:>10} {:>22} {:>9}",
        "planted", "stages", "named", "with \"or\"", "with a name too many", "seconds"
    );
    for plant in plants {
        let started = Instant::now();
        let mut judged: Vec<JudgedStage> = Vec::new();
        for seed in 1..=cases {
            progress.say(&format!("{}, stage {seed} of {cases}", plant.name()));
            let began = Instant::now();
            let this =
                planted_stage(plant, seed).search(&AxesPolicy::default(), &progress as &dyn Watch);
            if progress.stopped() {
                break;
            }
            table += &(this.row(plant, seed, began.elapsed().as_secs_f64()) + "\n");
            judged.push(this);
        }
        let count =
            |of: fn(&JudgedStage) -> bool| judged.iter().filter(|judged| of(judged)).count();
        println!(
            "{:<20} {:>6} {:>8} {:>10} {:>22} {:>9.0}",
            plant.name(),
            cases,
            count(|j| j.named),
            count(|j| j.with_or),
            count(|j| !j.wrong.is_empty()),
            started.elapsed().as_secs_f64()
        );
    }
    out.map_or(Ok(()), |out| desk.write(out, table.as_bytes()))?;
    Ok(true)
}
