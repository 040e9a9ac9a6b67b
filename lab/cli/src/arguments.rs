//! Arguments that several commands share.

use crate::desk::{Desk, SCREEN};
use crate::screen;
use hysteron::watch::{Deadline, Watch};
use hysteron::{Dataset, Error, Options, Policy, Result, series};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Benches on which chapters 4 to 7 are played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Benches {
    /// Both; the bench of domains decides
    Both,
    /// The thesis' equations
    Reference,
    /// Other equations: switching domains, modes of a structure, nonlinear creep, coloured noise
    Domains,
}

/// Files that a command may write.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Outputs {
    /// Write every figure as JSON; `-` prints it and nothing else
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a page to look at, one HTML file that opens offline
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    pub force: bool,
}

/// How the search for effects goes.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SearchArguments {
    /// Effects of your own that take part, as .toml files
    #[arg(long, value_name = "FILES", default_value = "")]
    own: String,
    /// Other thresholds than those of the method, as TOML: a line `family_wise = 0.01`
    #[arg(long, value_name = "FILE")]
    policy: Option<PathBuf>,
}

/// That no option was given which has no effect for data of a kind.
///
/// # Errors
/// The first of those that were given.
pub fn refuse_without_effect(kind: &str, options: &[(&str, bool)]) -> Result<()> {
    options
        .iter()
        .find(|(_, is_given)| *is_given)
        .map_or(Ok(()), |(option, _)| {
            let message = format!("has no effect for {kind}; leave it out");
            Err(Error::new(option, message))
        })
}

impl SearchArguments {
    /// Whether effects of one's own, and whether thresholds were given.
    pub fn given(&self) -> [(&'static str, bool); 2] {
        [
            ("--own", !self.own.is_empty()),
            ("--policy", self.policy.is_some()),
        ]
    }

    /// What the search is asked.
    pub fn options(&self, desk: &Desk) -> Result<Options> {
        let policy = self.policy.as_ref().map_or_else(
            || Ok(Policy::default()),
            |path| {
                Policy::from_toml(
                    &desk.text(path, "thresholds as TOML")?,
                    &path.display().to_string(),
                )
            },
        )?;
        Ok(Options {
            own: desk.effects(&self.own)?,
            policy,
        })
    }
}

/// How long an answer may take.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct TimeArguments {
    /// Answer within about so many seconds: the search for effects ends early (without it, once nothing more
    /// is found, and of several axes after 600 s at most)
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    within: Option<Duration>,
}

impl TimeArguments {
    /// This time, where none was given.
    pub fn or(self, within: Duration) -> Self {
        Self {
            within: self.within.or(Some(within)),
        }
    }

    /// Does what is watched in that time.
    pub fn beside<T>(self, watch: &dyn Watch, watched: impl FnOnce(&dyn Watch) -> T) -> T {
        match self.within {
            Some(within) => watched(&Deadline::new(watch, within)),
            None => watched(watch),
        }
    }
}

fn seconds(given: &str) -> std::result::Result<Duration, String> {
    let seconds = given.parse().ok().filter(|seconds: &f64| *seconds > 0.0);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "expected a time in seconds above zero".to_owned())
}

/// What the user specifies of the sensor for a servo's design.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct SensorSaid {
    /// Bandwidth of the sensor, whose lag is undone [default: what the model or the data set knows of it]
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    pub sensor_bandwidth_hz: Option<f64>,
}

impl Outputs {
    /// Takes the files as targets.
    pub fn check(&self, desk: &Desk) -> Result<()> {
        match self.json.as_deref() {
            Some(path) if path == Path::new(SCREEN) => screen::hush(),
            json => desk.target(json)?,
        }
        desk.target(self.report.as_deref())
    }

    /// Where the drive that would decide between two explanations is written: beside the other outputs, if
    /// there are any.
    pub fn next_drive(&self) -> Option<PathBuf> {
        self.report
            .as_ref()
            .or(self.json.as_ref().filter(|json| *json != Path::new(SCREEN)))
            .map(|beside| beside.with_extension("next_drive.csv"))
    }
}

/// Files that a command which holds a model against recordings may write.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct RecordingOutputs {
    /// Write what was measured and what the model says, one CSV file for each record
    #[arg(long, value_name = "DIR")]
    pub series: Option<PathBuf>,
    /// The others
    #[command(flatten)]
    pub files: Outputs,
}

impl RecordingOutputs {
    /// Takes the files as targets.
    pub fn check(&self, desk: &Desk, dataset: &Dataset) -> Result<()> {
        let names: Vec<String> = dataset.records.iter().map(series::file_name).collect();
        self.series
            .as_ref()
            .map_or(Ok(()), |folder| desk.folder(folder, &names))?;
        self.files.check(desk)
    }

    /// Writes the signals, if they are wanted, beside those of models by name.
    pub fn write_series(
        &self,
        desk: &Desk,
        dataset: &Dataset,
        models: &[series::Named],
    ) -> Result<()> {
        let Some(folder) = &self.series else {
            return Ok(());
        };
        for record in &dataset.records {
            desk.write(
                &folder.join(series::file_name(record)),
                series::csv(record, models).as_bytes(),
            )?;
        }
        println!(
            "Signals of {} records: {}",
            dataset.records.len(),
            folder.display()
        );
        Ok(())
    }
}

/// Files that a command which makes a model may write.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct StudyOutputs {
    /// Write the model
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// The others
    #[command(flatten)]
    pub recordings: RecordingOutputs,
}

impl StudyOutputs {
    /// Takes the files as targets.
    pub fn check(&self, desk: &Desk, dataset: &Dataset) -> Result<()> {
        desk.target(self.out.as_deref())?;
        self.recordings.check(desk, dataset)
    }
}

/// The command line as it was typed, for pages.
pub fn as_typed() -> String {
    let words = std::env::args().skip(1);
    std::iter::once("hysteron".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}
