//! The command line: arguments in, short text and files out.
//!
//! Exit status: 0 done, whatever the verdict; 1 a check or goal failed; 2 bad input, told in one message.
//! Output files are written whole at the end, so that a failed run leaves what was there.

use crate::arguments::{
    Benches, Outputs, RecordingOutputs, SearchArguments, SensorSaid, StudyOutputs, TimeArguments,
    refuse_without_effect,
};
#[cfg(feature = "board")]
use crate::board;
#[cfg(feature = "trace")]
use crate::capture;
#[cfg(feature = "lab")]
use crate::lab;
use crate::plant::PlantArguments;
use crate::read_arguments::ReadArguments;
#[cfg(feature = "thesis")]
use crate::reproduce;
use crate::{
    add, axes, check, compare, design, diagnose, drives, effects, explain, export, full_build,
    identify, manual, plant, rig, score, screen, simulate, stepping, survey, track,
};
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use hysteron::servo::named_scheme::SCHEMES;
use hysteron::servo::scheme_choice::SchemeChoice;
use hysteron::{Error, Result};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// From the measurement of a piezoelectric actuator to what its model misses, and to its controller.
#[derive(Parser)]
#[command(
    name = "hysteron",
    version,
    max_term_width = 100,
    arg_required_else_help = true
)]
struct Arguments {
    /// Print nothing but errors
    #[arg(long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Identify, compare, diagnose, add effects until the noise floor: the main job
    #[command(
        after_help = "Examples:\n  hysteron explain recording.mat\n  hysteron explain fitted.csv --held-out judging.csv\n  hysteron explain my_stage --from hysteresis,initial_curve,vibration --out model.toml --report explain.html"
    )]
    Explain {
        /// Folder with dataset.toml, a manifest, or one file of numbers (docs/reference/formats.md)
        dataset: PathBuf,
        /// Another file of numbers, which judges: the first is then fitted as a whole
        #[arg(long, value_name = "FILE")]
        held_out: Option<PathBuf>,
        /// Effects to start from, comma-separated (default: gain), or a file that lists them
        #[arg(long, default_value = "gain")]
        from: String,
        #[command(flatten)]
        search: SearchArguments,
        /// Tell every step of the search, with its error
        #[arg(long, short)]
        verbose: bool,
        #[command(flatten)]
        time: TimeArguments,
        /// Write the error falling, step by step, as an SVG that moves
        #[arg(long, value_name = "FILE")]
        animation: Option<PathBuf>,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: StudyOutputs,
    },
    /// Fit a list of effects to a data set
    #[command(
        after_help = "Example:\n  hysteron identify my_stage --effects hysteresis,initial_curve,vibration,creep --out model.toml"
    )]
    Identify {
        /// Data set
        dataset: PathBuf,
        /// Effects, comma-separated: built-in names or .toml files
        #[arg(long)]
        effects: String,
        /// Hysteresis model in place of `hysteresis`
        #[arg(long, value_name = "KIND")]
        hysteresis: Option<String>,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: StudyOutputs,
    },
    /// Compare a model with a data set as it is
    #[command(
        after_help = "Example:\n  hysteron compare model.toml other_day.csv --report compare.html"
    )]
    Compare {
        /// Model file
        model: PathBuf,
        /// Data set
        dataset: PathBuf,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: RecordingOutputs,
    },
    /// Say which physical effect a model misses on a data set
    #[command(
        after_help = "Example:\n  hysteron diagnose model.toml other_day.csv --json diagnosis.json"
    )]
    Diagnose {
        /// Model file
        model: PathBuf,
        /// Data set
        dataset: PathBuf,
        #[command(flatten)]
        search: SearchArguments,
        #[command(flatten)]
        time: TimeArguments,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: RecordingOutputs,
    },
    /// Add an effect to a model and fit it again
    #[command(after_help = "Example:\n  hysteron add creep model.toml my_stage --out better.toml")]
    Add {
        /// Effect: a built-in name or a .toml file
        effect: String,
        /// Model file
        model: PathBuf,
        /// Data set
        dataset: PathBuf,
        /// Write the model
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: RecordingOutputs,
    },
    /// Measure a stick-slip drive: velocity, step, scatter, backward step and swing at the stop
    #[command(after_help = "Example:\n  hysteron stepping recording.csv --report stepping.html")]
    Stepping {
        /// Data set: drive of the piezo, position of the slider
        dataset: PathBuf,
        #[command(flatten)]
        rig: stepping::RigArguments,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// What a model's sensor would read under a drive
    #[command(
        after_help = "Example:\n  hysteron simulate model.toml --drive triangle:200:60:2 --out simulated.csv"
    )]
    Simulate {
        /// Model file
        model: PathBuf,
        /// CSV file with t and u, or a waveform: sine:HZ:AMPLITUDE_V:OFFSET_V:SECONDS,
        /// triangle:V_PER_S:PEAK_V:SECONDS, step:V:SECONDS
        #[arg(long)]
        drive: String,
        /// CSV file to write
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Where it begins: virgin, settled (at rest at the first drive), or as in a recording
        /// [default: as the model's records did]
        #[arg(long, value_name = "STATE|FILE")]
        initial: Option<String>,
        /// Sampling rate of a waveform [default: that of the model's records]
        #[arg(long)]
        rate_hz: Option<f64>,
        /// Replace the file if it exists
        #[arg(long)]
        force: bool,
        #[command(flatten)]
        reading: ReadArguments,
    },
    /// Write a model as a function that simulates it elsewhere: matlab (Octave too), python (NumPy), c (C99),
    /// or its linear part as a state space
    #[command(
        after_help = "Examples:\n  hysteron export model.toml --as matlab\n  hysteron export model.toml --as c --rate-hz 20000 --out stage_model.c\n  hysteron export model.toml --as matlab --inverse --out stage_inverse.m\nEquations: docs/reference/effects.md"
    )]
    Export {
        /// Model file
        model: PathBuf,
        /// matlab, python, c or state-space
        #[arg(long = "as", value_name = "LANGUAGE")]
        language: String,
        /// Samples per second of the drive that the function takes [default: those of the model's records]
        #[arg(long)]
        rate_hz: Option<f64>,
        /// Where it begins: virgin, settled (at rest at the first drive), or as in a recording
        /// [default: as the model's records did]
        #[arg(long, value_name = "STATE|FILE")]
        initial: Option<String>,
        /// Write the inverse of the loops instead: the drive for a wanted displacement (c and matlab)
        #[arg(long, conflicts_with = "initial")]
        inverse: bool,
        /// File to write; its name without the extension is that of the function [default: the model's name]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Replace the file if it exists
        #[arg(long)]
        force: bool,
        #[command(flatten)]
        reading: ReadArguments,
    },
    /// The lab page in your browser, with this program behind it; nothing leaves this machine
    #[command(after_help = "Examples:\n  hysteron lab\n  hysteron lab recording.mat")]
    Lab {
        /// Data set to begin with: a folder with dataset.toml, a manifest, or one file
        dataset: Option<PathBuf>,
        /// Write the address, and leave it to you to open it
        #[arg(long)]
        no_open: bool,
        #[command(flatten)]
        reading: ReadArguments,
    },
    /// Simulate a data set that has these effects, with its truth; or a set of many
    #[command(
        after_help = "Examples:\n  hysteron plant creep=2,delay --out hidden --seed 7\n  hysteron plant all --strengths 1,2,4 --out cases"
    )]
    Plant(PlantArguments),
    /// Stages with several drives and sensors: find what is where, decouple, simulate
    #[command(
        after_help = "Examples:\n  hysteron axes explain my_stage --out model.toml --report axes.html\n  hysteron axes identify my_stage --modes 16 --actuator-softening --out model.toml\n  hysteron axes decouple model.toml --hidden-coupling 0.1"
    )]
    Axes {
        #[command(subcommand)]
        command: axes::AxesCommand,
    },
    /// Work with the amplifier's board: tune, record, upload, status, send, attach; emulate runs the program
    /// that `cargo xtask board` builds
    #[command(
        disable_help_flag = true,
        after_help = "Example:\n  hysteron board tune tuned --port /dev/ttyACM0 --drive-max-v 80"
    )]
    Board {
        /// What to do: `hysteron board --help` says more
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<std::ffi::OsString>,
    },
    /// Decode the log of a target (its image, the raw bytes of its RTT channel) into a data set
    #[command(after_help = "Example:\n  hysteron capture hysteron-firmware log.rtt --out recorded")]
    Capture {
        /// The image that was flashed
        elf: PathBuf,
        /// Raw bytes of the log channel
        raw: PathBuf,
        /// Folder to write
        #[arg(long, value_name = "DATASET")]
        out: PathBuf,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Design a servo for an identified model, with margins, and write its parameters
    #[command(
        after_help = "Example:\n  hysteron design model.toml --data my_stage --reference-hz 50 --out servo.toml --block servo.block"
    )]
    Design {
        /// Model file
        model: PathBuf,
        /// Servo file to write
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Which scheme (docs/reference/servo_schemes.md says which to take)
        #[arg(long, value_name = "NAME", default_value = "predictor", value_parser = choice_names())]
        scheme: String,
        /// Leave the hysteresis to the unknown input instead of inverting it
        #[arg(long)]
        no_inverse: bool,
        /// Highest frequency of the references
        #[arg(long, default_value_t = 150.0)]
        reference_hz: f64,
        /// RMS noise of the sensor [default: that of the recording, or 0.001]
        #[arg(long, allow_negative_numbers = true)]
        sensor_noise_um: Option<f64>,
        #[command(flatten)]
        sensor: SensorSaid,
        /// Recording that the model was identified from: what it excludes need not be reckoned with
        #[arg(long, value_name = "DATASET")]
        data: Option<PathBuf>,
        #[command(flatten)]
        reading: ReadArguments,
        /// Largest sensitivity that is accepted [default: 1.8 with a gain margin of 8 dB and a phase margin
        /// of 35 degrees where that costs less than a third of the error, at most 2.5]
        #[arg(long)]
        sensitivity_peak: Option<f64>,
        /// Share of its frequency by which the first mode moves after it was recorded, such as 0.2 for a load
        /// that changes
        #[arg(
            long,
            value_name = "SHARE",
            default_value_t = 0.0,
            allow_negative_numbers = true
        )]
        mode_moves: f64,
        /// Let the servo learn the correction of a periodic reference
        #[arg(long)]
        learning: bool,
        /// Let the servo correct the gain of its model slowly, within 20 %
        #[arg(long)]
        adaptation: bool,
        /// Parameter block for the amplifier to write; beside it the commands that bring it to a running
        /// target
        #[arg(long, value_name = "FILE")]
        block: Option<PathBuf>,
        /// Wiring of the amplifier's converters (firmware/README.md)
        #[arg(long, value_name = "FILE")]
        front_end: Option<PathBuf>,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Sampled eigenvalues and margins of a servo; exit status 1 if it is unstable
    #[command(
        after_help = "Examples:\n  hysteron check model.toml servo.toml --data my_stage\n  hysteron check servo.toml --model model.toml --report check.html"
    )]
    Check {
        /// Model file and servo file, in either order
        #[arg(value_name = "MODEL|SERVO", required = true, num_args = 1..=2)]
        files: Vec<PathBuf>,
        /// Model file, where it is not among the others
        #[arg(long)]
        model: Option<PathBuf>,
        /// Recording that the model was identified from: the loop is checked on what it leaves possible, as
        /// `design` does
        #[arg(long, value_name = "DATASET")]
        data: Option<PathBuf>,
        #[command(flatten)]
        reading: ReadArguments,
        /// Another scheme, designed for the servo's model without a recording
        #[arg(long, value_name = "NAME", value_parser = scheme_names())]
        scheme: Option<String>,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Follow a reference with a servo on an identified model
    #[command(
        after_help = "Example:\n  hysteron track model.toml servo.toml --reference sine:50:5:5.6 --report track.html"
    )]
    Track {
        /// Model file and servo file, in either order
        model: PathBuf,
        /// Servo file
        servo: PathBuf,
        /// `sine:HZ:UM[:OFFSET_UM[:PHASE_DEG]]`, `triangle:` with the same numbers, `step:UM[:FROM_UM]`,
        /// `random:HZ:UM[:OFFSET_UM[:SEED]]` (up to a frequency), or a file with a column of time in s and
        /// one of um
        #[arg(long)]
        reference: String,
        /// Another scheme, designed for the servo's model without a recording
        #[arg(long, value_name = "NAME", value_parser = scheme_names())]
        scheme: Option<String>,
        /// RMS noise of the sensor [default: what the servo was designed for, or 0.001]
        #[arg(long, allow_negative_numbers = true)]
        sensor_noise_um: Option<f64>,
        /// Force from outside, as what it moves at rest: `sine:HZ:UM` or `step:UM`
        #[arg(long, value_name = "FORCE")]
        disturbance: Option<String>,
        /// Mass added to the moving part, as a ratio to it
        #[arg(
            long,
            value_name = "RATIO",
            default_value_t = 0.0,
            allow_negative_numbers = true
        )]
        added_mass: f64,
        /// Capacitance of the actuator: prints the current that the drive takes
        #[arg(long, value_name = "UF", allow_negative_numbers = true)]
        capacitance_uf: Option<f64>,
        /// A program in the place of the model: it reads a drive in V from each line and answers with a line
        /// that has the reading in um, and the true position behind it if it knows
        #[arg(long, value_name = "COMMAND", conflicts_with_all = ["disturbance", "added_mass"])]
        plant: Option<String>,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Play the thesis' experiments on simulated benches and stand ours beside its figures
    #[command(after_help = "Example:\n  hysteron reproduce 5 6 --report thesis.html")]
    Reproduce {
        /// Chapters: 3, 4, 5, 6, 7 (default: all)
        chapters: Vec<u32>,
        /// Benches of chapters 4 to 7
        #[arg(long, value_enum, default_value_t = Benches::Both)]
        bench: Benches,
        /// Write a row for each printed result
        #[arg(long, value_name = "FILE")]
        csv: Option<PathBuf>,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Diagnose a folder of planted cases and compare with their truth
    #[command(after_help = "Example:\n  hysteron score cases --json score.json")]
    Score {
        /// Folder with truth.json and one folder per case
        dir: PathBuf,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Explain many recordings from the same effects: a row for each, outliers, units that differ
    #[command(
        after_help = "Example:\n  hysteron survey recordings --from gain,vibration --report survey.html\nIt goes on where it stopped: known rows stand in --results."
    )]
    Survey {
        /// Folder of recordings: files, and folders with dataset.toml
        folder: PathBuf,
        /// Model whose effects all recordings have [default: found from three of them]
        #[arg(long, value_name = "MODEL", conflicts_with = "from")]
        model: Option<PathBuf>,
        /// Effects from which the common ones are found, comma-separated
        #[arg(long, default_value = "gain")]
        from: String,
        /// Processes [default: one for each core]
        #[arg(long, value_name = "N")]
        workers: Option<usize>,
        /// Rows, one a line, written as they come [default: survey.jsonl]
        #[arg(long, value_name = "FILE")]
        results: Option<PathBuf>,
        #[command(flatten)]
        reading: ReadArguments,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// A process of `survey`: reads paths of recordings and writes their rows
    #[command(
        hide = true,
        after_help = "Example:\n  hysteron survey-worker gain,vibration"
    )]
    SurveyWorker {
        /// Effects, comma-separated
        effects: String,
        #[command(flatten)]
        reading: ReadArguments,
    },
    /// Every effect of the library: its physics, what it does to a reading, what looks like it
    #[command(
        after_help = "Examples:\n  hysteron effects --report effects.html\n  hysteron effects --equations effects.md"
    )]
    Effects {
        /// Write the equations, the parameters and the discretisation of every effect as Markdown, and
        /// nothing else
        #[arg(long, value_name = "FILE")]
        equations: Option<PathBuf>,
        #[command(flatten)]
        outputs: Outputs,
    },
    /// Drives that show what there is to see, as files to play, and the manifest for their recordings
    #[command(after_help = "Example:\n  hysteron drives --drive-max-v 100 --out my_stage")]
    Drives {
        /// Least drive of the actuator, V
        #[arg(long, default_value_t = 0.0)]
        drive_min_v: f64,
        /// Greatest drive of the actuator, V
        #[arg(long)]
        drive_max_v: f64,
        /// Folder to write
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
    /// Write a script that lets your shell complete commands, options and files
    #[command(
        after_help = "Examples:\n  hysteron completions bash > ~/.local/share/bash-completion/completions/hysteron\n  hysteron completions zsh > ~/.zfunc/_hysteron\n  hysteron completions fish > ~/.config/fish/completions/hysteron.fish"
    )]
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Write a page of the manual for every command
    #[command(after_help = "Examples:\n  hysteron manual ~/.local/share/man/man1")]
    Manual {
        /// Folder to write
        folder: PathBuf,
        /// Replace files that exist
        #[arg(long)]
        force: bool,
    },
}

/// A value such as `-5` is a number for every command, not an option that does not exist.
fn taking_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .allow_negative_numbers(true)
        .mut_subcommands(taking_negative_numbers)
}

/// The schemes with a sentence each, for the long help and for shells.
fn scheme_names() -> PossibleValuesParser {
    PossibleValuesParser::new(SCHEMES.map(|(name, what)| PossibleValue::new(name).help(what)))
}

/// Those of them that are designed from a recording.
fn choice_names() -> PossibleValuesParser {
    let designed = |name: &str| SchemeChoice::ALL.iter().any(|choice| choice.name() == name);
    let values = SCHEMES.into_iter().filter(|(name, _)| designed(name));
    PossibleValuesParser::new(
        values
            .map(|(name, what)| PossibleValue::new(name).help(what))
            .collect::<Vec<_>>(),
    )
}

/// Most characters of a message: what a file holds may be in it, and a file may hold anything.
const MESSAGE_MAX: usize = 1500;

/// A message that a screen can show.
fn brief(message: &str) -> String {
    match message.char_indices().nth(MESSAGE_MAX) {
        Some((end, _)) => format!(
            "{} ... ({} characters in all)",
            &message[..end],
            message.chars().count()
        ),
        None => message.to_owned(),
    }
}

/// Runs the program.
#[must_use]
pub fn run() -> ExitCode {
    let parsed = taking_negative_numbers(Arguments::command())
        .try_get_matches()
        .and_then(|matches| Arguments::from_arg_matches(&matches));
    let arguments = match parsed {
        Ok(arguments) => arguments,
        Err(error) => {
            let _ = error.print();
            return if error.use_stderr() {
                ExitCode::from(2)
            } else {
                ExitCode::SUCCESS
            };
        }
    };
    if arguments.quiet {
        screen::hush();
    }
    #[cfg(feature = "board")]
    if let Command::Board { words } = &arguments.command {
        return board::run(words);
    }
    match dispatch(arguments.command) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(problem) => {
            eprintln!("error: {}", brief(&problem.to_string()));
            ExitCode::from(2)
        }
    }
}

fn dispatch(command: Command) -> Result<bool> {
    match command {
        Command::Explain { dataset, held_out, from, search, verbose, time, animation, reading, outputs } => {
            if held_out.is_none() && axes::is_of_several_axes(&dataset) {
                let read_as = reading.as_words();
                let [own, policy] = search.given();
                let series = ("--series", outputs.recordings.series.is_some());
                let animation = ("--animation", animation.is_some());
                let reading = (read_as.first().map_or("", String::as_str), !read_as.is_empty());
                refuse_without_effect("a data set of several axes", &[own, policy, animation, series, reading])?;
                let start = (from != "gain").then(|| Path::new(&from));
                return axes::explain(&dataset, start, outputs.out.as_deref(), &axes::Manner { verbose, time }, &outputs.recordings.files);
            }
            let wanted = explain::ExplainRequest { held_out: held_out.as_deref(), from: &from, search: &search, verbose, time, animation: animation.as_deref() };
            if rig::is_rig(&from) {
                return rig::explain(&dataset, &wanted, &reading, &outputs);
            }
            explain::explain(&dataset, &wanted, &reading, &outputs)
        }
        Command::Identify { dataset, effects, hysteresis, reading, outputs } => {
            identify::identify(&dataset, &effects, hysteresis.as_deref(), &reading, &outputs)
        }
        Command::Compare { model, dataset, reading, outputs } => compare::compare(&model, &dataset, &reading, &outputs),
        Command::Diagnose { model, dataset, search, time, reading, outputs } => {
            diagnose::diagnose(&model, &dataset, &search, time, &reading, &outputs)
        }
        Command::Add { effect, model, dataset, out, reading, outputs } => add::add(&effect, &model, &dataset, &out, &reading, &outputs),
        Command::Simulate { model, drive, out, initial, rate_hz, force, reading } => {
            let wanted = simulate::SimulateRequest { model: &model, drive: &drive, initial: initial.as_deref(), rate_hz };
            simulate::simulate(&wanted, &reading, &out, force)
        }
        Command::Stepping { dataset, rig, reading, outputs } => stepping::stepping(&dataset, &rig, &reading, &outputs),
        Command::Export { model, language, rate_hz, initial, inverse, out, force, reading } => {
            let wanted = export::ExportRequest { model: &model, language: &language, rate_hz, initial: initial.as_deref(), inverse };
            export::export(&wanted, &reading, out.as_deref(), force)
        }
        #[cfg(feature = "lab")]
        Command::Lab { dataset, no_open, reading } => lab::lab(dataset, no_open, &reading),
        #[cfg(not(feature = "lab"))]
        Command::Lab { .. } => full_build::needed("lab"),
        Command::Axes { command } => axes::axes(command),
        Command::Plant(wanted) => plant::plant(&wanted),
        Command::Board { .. } => full_build::needed("board"),
        #[cfg(feature = "trace")]
        Command::Capture { elf, raw, out, force } => capture::capture(&elf, &raw, &out, force),
        #[cfg(not(feature = "trace"))]
        Command::Capture { .. } => full_build::needed("capture"),
        Command::Design {
            model,
            out,
            scheme,
            no_inverse,
            reference_hz,
            sensor_noise_um,
            sensor: SensorSaid { sensor_bandwidth_hz },
            data,
            reading,
            sensitivity_peak,
            mode_moves,
            learning,
            adaptation,
            block,
            front_end,
            outputs,
        } => {
            let wanted = design::DesignRequest {
                reference_hz,
                sensor_noise_um,
                sensor_bandwidth_hz,
                sensitivity_peak,
                learning,
                adaptation,
                mode_moves,
                scheme,
                no_inverse,
            };
            let files = design::DesignFiles {
                model: &model,
                data: data.as_deref(),
                out: &out,
                block: block.as_deref(),
                front_end: front_end.as_deref(),
            };
            design::design(&files, &wanted, &reading, &outputs)
        }
        Command::Check { files, model, data, reading, scheme, outputs } => {
            let [servo, model] = match (files.as_slice(), &model) {
                ([servo], Some(model)) => [servo, model].map(PathBuf::as_path),
                ([one, other], None) => check::servo_and_model(one, other),
                _ => return Err(Error::new("check", "expected a model and a servo: check MODEL SERVO, or check SERVO --model MODEL")),
            };
            let wanted = check::CheckRequest { servo, model, data: data.as_deref(), scheme: scheme.as_deref() };
            check::check(&wanted, &reading, &outputs)
        }
        Command::Track { model, servo, reference, scheme, sensor_noise_um, disturbance, added_mass, capacitance_uf, plant, outputs } => {
            let wanted = track::TrackRequest {
                reference: &reference,
                scheme: scheme.as_deref(),
                sensor_noise_um,
                disturbance: disturbance.as_deref(),
                added_mass,
                capacitance_uf,
                plant: plant.as_deref(),
            };
            let [servo, model] = check::servo_and_model(&servo, &model);
            track::track(model, servo, &wanted, &outputs)
        }
        #[cfg(feature = "thesis")]
        Command::Reproduce { chapters, bench, csv, outputs } => reproduce::reproduce(&chapters, bench, csv.as_deref(), &outputs),
        #[cfg(not(feature = "thesis"))]
        Command::Reproduce { .. } => full_build::needed("reproduce"),
        Command::Score { dir, outputs } => score::score(&dir, &outputs),
        Command::Survey { folder, model, from, workers, results, reading, outputs } => {
            let wanted = survey::SurveyRequest { folder: &folder, model: model.as_deref(), from: &from, workers, results: results.as_deref() };
            survey::survey(&wanted, &reading, &outputs)
        }
        Command::SurveyWorker { effects, reading } => survey::work(&effects, &reading),
        Command::Effects { equations, outputs } => effects::effects(equations.as_deref(), &outputs),
        Command::Drives { drive_min_v, drive_max_v, out, force } => drives::drives(drive_min_v, drive_max_v, &out, force),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "hysteron", &mut script);
            println!("{}", String::from_utf8_lossy(&script).trim_end());
            Ok(true)
        }
        Command::Manual { folder, force } => manual::write_manual(Arguments::command(), &folder, force),
    }
    .and_then(|ok| if screen::has_arrived() { Ok(ok) } else { Err(Error::new("output", "cannot be written")) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_shows_an_example_that_is_understood() {
        for command in Arguments::command().get_subcommands() {
            let help = command
                .get_after_help()
                .map(ToString::to_string)
                .unwrap_or_default();
            let examples: Vec<&str> = help
                .lines()
                .filter_map(|line| line.strip_prefix("  "))
                .collect();
            assert!(!examples.is_empty(), "{}", command.get_name());
            for example in examples {
                let words = example
                    .split(" > ")
                    .next()
                    .unwrap_or_default()
                    .split_whitespace();
                let understood = Arguments::try_parse_from(words).map_err(|e| e.to_string());
                assert!(
                    understood.is_ok(),
                    "{example}: {}",
                    understood.err().unwrap_or_default()
                );
            }
        }
    }
}
