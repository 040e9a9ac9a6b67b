//! `survey`: many recordings, each explained in a process of its own, a row for each.
//!
//! Workers are this program again (`survey-worker`). Each gets the path of a recording in a line and answers
//! with its row as a line of JSON. A recording whose worker ends, killed or out of memory, is given to another
//! one once more. Rows are appended to a file as they come, so that a survey goes on where it stopped.

use crate::arguments::{Outputs, as_typed};
use crate::desk::{Desk, wrong};
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::folder;
use hysteron::dataset::reading::Instructions;
use hysteron::survey::{SCHEMA, Survey, SurveyRow, common_effects};
use hysteron::watch::Unwatched;
use hysteron::{Dataset, Error, Result};
use hysteron_report::survey_page;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Recordings of which the common effects are found.
const SAMPLE: usize = 3;
/// Workers that a recording may end before it is abandoned.
const TRIES: usize = 2;
/// The file of the rows where none is specified.
const RESULTS: &str = "survey.jsonl";

/// What is asked of a survey.
pub struct SurveyRequest<'a> {
    /// The folder of recordings.
    pub folder: &'a Path,
    /// The model whose effects all have.
    pub model: Option<&'a Path>,
    /// Effects from which the common ones are found.
    pub from: &'a str,
    /// Processes.
    pub workers: Option<usize>,
    /// The file of the rows.
    pub results: Option<&'a Path>,
}

/// The first line of the file of rows.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    schema: String,
    effects: Vec<String>,
}

/// The rows that are known, and where the next are written.
struct Rows {
    path: PathBuf,
    file: File,
}

impl Rows {
    /// Reads what is there. A line that was cut off is left out, and done again.
    fn read(path: &Path) -> Result<Option<(Header, Vec<SurveyRow>)>> {
        let Ok(text) = std::fs::read_to_string(path) else {
            return Ok(None);
        };
        let mut lines = text.lines();
        let header: Option<Header> = lines
            .next()
            .and_then(|line| serde_json::from_str(line).ok());
        let Some(header) = header.filter(|header| header.schema == SCHEMA) else {
            let expected = format!("expected the rows of a survey, whose first line has {SCHEMA}");
            return Err(wrong(path, expected));
        };
        let rows = lines.filter_map(|line| serde_json::from_str(line).ok());
        Ok(Some((header, rows.collect())))
    }

    /// Writes what is known whole, and opens the file for more.
    fn open(desk: &Desk, path: &Path, header: &Header, rows: &[SurveyRow]) -> Result<Self> {
        let mut text = line(header)?;
        for row in rows {
            text += &line(row)?;
        }
        desk.write(path, text.as_bytes())?;
        let file = OpenOptions::new().append(true).open(path);
        Ok(Self {
            path: path.to_owned(),
            file: file.map_err(|e| wrong(path, e))?,
        })
    }

    /// Appends a row in one piece.
    fn push(&mut self, row: &SurveyRow) -> Result<()> {
        let text = line(row)?;
        let written = self.file.write_all(text.as_bytes());
        let written = written.and_then(|()| self.file.sync_data());
        written.map_err(|e| wrong(&self.path, format!("cannot be written: {e}")))
    }
}

fn line(value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string(value).map_err(|e| Error::new("survey", e))?;
    Ok(text + "\n")
}

/// Whether a file is a page, or has a schema of this program: rows, models, servos, figures.
fn was_written_here(path: &Path) -> bool {
    let mut bytes = Vec::new();
    // What cannot be read is reported as a recording that cannot be.
    let read = File::open(path).and_then(|file| file.take(200).read_to_end(&mut bytes));
    let beginning = String::from_utf8_lossy(&bytes).to_ascii_lowercase();
    let has_schema = beginning.contains("schema") && beginning.contains("\"hysteron.");
    read.is_ok() && (beginning.starts_with("<!doctype html") || has_schema)
}

/// Whether this run prints into a file: a table of its own lines would be read from there.
fn is_printed_into(path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::fd::{AsFd, BorrowedFd};
        use std::os::unix::fs::MetadataExt;
        let Ok(file) = std::fs::metadata(path) else {
            return false;
        };
        let is_it = |stream: BorrowedFd| {
            let open = stream.try_clone_to_owned().map(File::from);
            let known = open.and_then(|open| open.metadata());
            known.is_ok_and(|known| (known.dev(), known.ino()) == (file.dev(), file.ino()))
        };
        is_it(std::io::stdout().as_fd()) || is_it(std::io::stderr().as_fd())
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        false
    }
}

/// The recordings below a folder, by their paths there: files, and folders with a manifest. What the program
/// wrote there is left out, and what it prints into.
fn recordings_in(folder: &Path) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let mut open = vec![PathBuf::new()];
    while let Some(inside) = open.pop() {
        let here = folder.join(&inside);
        let entries = std::fs::read_dir(&here).map_err(|e| wrong(&here, e))?;
        for entry in entries {
            let entry = entry.map_err(|e| wrong(&here, e))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = inside.join(&name);
            let at = folder.join(&path);
            if name.starts_with('.') {
                continue;
            }
            if at.is_dir() && !at.join("dataset.toml").is_file() {
                open.push(path);
            } else if !at.is_file() || !(was_written_here(&at) || is_printed_into(&at)) {
                let parts = path.iter().map(|part| part.to_string_lossy());
                found.push(parts.collect::<Vec<_>>().join("/"));
            }
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(wrong(
            folder,
            "has no recordings; expected files, or folders with dataset.toml",
        ));
    }
    Ok(found)
}

/// The effects that the recordings have in common: those of a model, or found from a sample of them.
fn effects_of_all(
    desk: &Desk,
    wanted: &SurveyRequest,
    recordings: &[String],
    instructions: &Instructions,
) -> Result<Vec<String>> {
    if let Some(model) = wanted.model {
        return Ok(desk.model(model)?.effect_ids());
    }
    let start = desk.effects(wanted.from)?;
    let read = |name: &String| folder::load_as(&wanted.folder.join(name), instructions);
    // From the first on, as far apart as they can be.
    let apart = (recordings.len() / SAMPLE).max(1);
    let begun = recordings.iter().step_by(apart);
    let mut sample: Vec<Dataset> = begun.filter_map(|name| read(name).ok()).collect();
    if sample.is_empty() {
        sample.extend(recordings.iter().find_map(|name| read(name).ok()));
    }
    if sample.is_empty() {
        read(&recordings[0])?;
    }
    sample.truncate(SAMPLE);
    common_effects(&sample, &start, &Options::default(), &Unwatched)
}

/// A process that explains recordings.
struct Worker {
    child: Child,
    tasks: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Worker {
    fn start(effects: &[String], typed: &[String]) -> std::io::Result<Self> {
        let mut child = Command::new(std::env::current_exe()?)
            .args(["survey-worker", &effects.join(",")])
            .args(typed)
            // The processes have the cores.
            .env("RAYON_NUM_THREADS", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let gone = || std::io::Error::other("a worker has no pipes");
        let tasks = child.stdin.take().ok_or_else(gone)?;
        let answers = BufReader::new(child.stdout.take().ok_or_else(gone)?);
        Ok(Self {
            child,
            tasks,
            answers,
        })
    }

    /// The row of a recording; none where the process has ended.
    fn row(&mut self, path: &Path) -> Option<SurveyRow> {
        writeln!(self.tasks, "{}", path.display()).ok()?;
        let mut answer = String::new();
        self.answers.read_line(&mut answer).ok()?;
        serde_json::from_str(&answer).ok()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The row of a recording by a worker, which is started anew where it ends.
fn asked(
    worker: &mut Option<Worker>,
    start: &dyn Fn() -> std::io::Result<Worker>,
    name: &str,
    path: &Path,
) -> SurveyRow {
    for _ in 0..TRIES {
        let working = match worker.take().map_or_else(start, Ok) {
            Ok(working) => worker.insert(working),
            Err(e) => return SurveyRow::refused(name, format!("{name}: no process: {e}")),
        };
        if let Some(row) = working.row(path) {
            return SurveyRow {
                recording: name.to_owned(),
                ..row
            };
        }
        *worker = None;
    }
    SurveyRow::refused(
        name,
        format!(
            "{name}: the process that explained it ended {TRIES} times; it may need more memory than there is"
        ),
    )
}

/// Explains recordings in processes; rows go to `done` as they come.
fn explain_all(
    folder: &Path,
    names: Vec<String>,
    workers: usize,
    start: &(dyn Fn() -> std::io::Result<Worker> + Sync),
    mut done: impl FnMut(SurveyRow) -> Result<()>,
) -> Result<()> {
    let open = Mutex::new(VecDeque::from(names));
    let (sender, rows) = channel();
    std::thread::scope(|scope| {
        for _ in 0..workers {
            let (sender, open) = (sender.clone(), &open);
            scope.spawn(move || {
                let mut worker = None;
                let next = || {
                    open.lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .pop_front()
                };
                while let Some(name) = next() {
                    let row = asked(&mut worker, start, &name, &folder.join(&name));
                    if sender.send(row).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        rows.into_iter().try_for_each(&mut done)
    })
}

/// `hysteron survey FOLDER [--model MODEL | --from EFFECTS] [--workers N] [--results FILE] [--report FILE]`.
pub fn survey(wanted: &SurveyRequest, reading: &ReadArguments, outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let SurveyRequest {
        folder, results, ..
    } = *wanted;
    let instructions = reading.instructions()?;
    let recordings = recordings_in(folder)?;
    let results = results.unwrap_or_else(|| Path::new(RESULTS));
    outputs.check(&desk)?;
    let (header, mut rows) = match Rows::read(results)? {
        Some(known) => known,
        None => {
            let effects = effects_of_all(&desk, wanted, &recordings, &instructions)?;
            let schema = SCHEMA.into();
            (Header { schema, effects }, Vec::new())
        }
    };
    let model = wanted.model.map(|model| desk.model(model)).transpose()?;
    if model.is_some_and(|model| model.effect_ids() != header.effects) {
        let has = format!("has rows explained from {}", header.effects.join(", "));
        return Err(wrong(
            results,
            format!("{has}; expected another --results for another model"),
        ));
    }
    if let Some(other) = rows.iter().find(|row| !recordings.contains(&row.recording)) {
        let has = format!(
            "has a row of {}, which is not in {}",
            other.recording,
            folder.display()
        );
        return Err(wrong(
            results,
            format!("{has}; expected another --results for other recordings"),
        ));
    }
    let is_known = |name: &&String| rows.iter().any(|row| row.recording == **name);
    let missing: Vec<String> = recordings
        .iter()
        .filter(|name| !is_known(name))
        .cloned()
        .collect();
    println!(
        "{} recordings, {} of them known from {}; explained from {}",
        recordings.len(),
        rows.len(),
        results.display(),
        header.effects.join(", ")
    );
    let mut file = Rows::open(&desk, results, &header, &rows)?;
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let workers = wanted
        .workers
        .unwrap_or(cores)
        .clamp(1, missing.len().max(1));
    let typed = reading.as_words();
    let start = || Worker::start(&header.effects, &typed);
    let progress = Progress::start();
    let (began, of, mut done) = (Instant::now(), missing.len(), 0);
    explain_all(folder, missing, workers, &start, |row| {
        file.push(&row)?;
        done += 1;
        let left_s = began.elapsed().as_secs_f64() / done as f64 * (of - done) as f64;
        let answer = row.error.as_deref().unwrap_or(&row.verdict);
        progress.say(&format!(
            "{done} of {of}, {left_s:.0} s left: {} {answer}",
            row.recording
        ));
        rows.push(row);
        Ok(())
    })?;
    drop(progress);
    let survey = Survey::new(header.effects, rows);
    for outlier in &survey.outliers {
        println!("  {}: {}", outlier.recording, outlier.in_what.join("; "));
    }
    for unit in &survey.units {
        println!(
            "  unit {}: {} {:.4}, all others {:.4} ({:.0} standard deviations)",
            unit.unit, unit.name, unit.median, unit.others, unit.deviations
        );
    }
    for row in survey.rows.iter().filter_map(|row| row.error.as_ref()) {
        println!("  not read: {row}");
    }
    desk.write_json(outputs.json.as_deref(), &survey)?;
    desk.write_page(outputs.report.as_deref(), || {
        survey_page(&survey, as_typed())
    })?;
    let mut verdicts = std::collections::BTreeMap::<&str, usize>::new();
    for row in survey.good() {
        *verdicts.entry(&row.verdict).or_default() += 1;
    }
    let counts: Vec<String> = (verdicts.iter())
        .map(|(verdict, count)| format!("{count} {verdict}"))
        .collect();
    println!("verdicts: {}", counts.join(", "));
    println!(
        "{} stand out, {} values of units differ, {} could not be read; rows: {}",
        survey.outliers.len(),
        survey.units.len(),
        survey.rows.len() - survey.good().count(),
        results.display()
    );
    Ok(true)
}

/// `hysteron survey-worker EFFECTS`: answers each line of the input, a recording, with its row.
pub fn work(effects: &str, reading: &ReadArguments) -> Result<bool> {
    let effects = Desk::new(false).effects(effects)?;
    let instructions = reading.instructions()?;
    for path in std::io::stdin().lock().lines() {
        let path = path.map_err(|e| Error::new("survey-worker", e))?;
        let began = Instant::now();
        let found = folder::load_as(Path::new(&path), &instructions).and_then(|dataset| {
            let found = analyse(
                &dataset,
                Start::Effects(&effects),
                &Options::default(),
                &Unwatched,
            )?;
            let dataset = found.dataset(&dataset);
            Ok(SurveyRow::found(
                &path,
                dataset,
                &found,
                began.elapsed().as_secs_f64(),
            ))
        });
        let row = found.unwrap_or_else(|problem| SurveyRow::refused(&path, problem.to_string()));
        print_whole(&line(&row)?)?;
    }
    Ok(true)
}

/// A line that the other side reads at once.
fn print_whole(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(|e| Error::new("survey-worker", e))
}
