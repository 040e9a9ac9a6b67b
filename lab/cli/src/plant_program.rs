//! A program of the user as the plant of `track`: it reads drives and writes readings, line by line.
//!
//! For every sampling period it gets a line with the drive of that period, V. It answers with a line that has
//! the sensor's reading at the end of the period, um, and behind it, if it knows, the true position. It ends
//! when its input ends.

use hysteron::{Error, Result};
use hysteron_sim::closed_loop::Plant;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::{Duration, Instant};

/// How long an answer may take. A program that loads its libraries first takes some seconds.
const LONGEST_ANSWER: Duration = Duration::from_secs(20);
/// A longer line is no answer, bytes.
const LONGEST_LINE: u64 = 4096;
/// How much of a line is shown, in characters.
const SHOWN: usize = 60;

/// The program while it runs.
pub struct PlantProgram {
    command: String,
    child: Child,
    drives: Option<SyncSender<f64>>,
    answers: Receiver<String>,
    complaints: Option<JoinHandle<String>>,
    longest_answer: Duration,
    answered: u64,
    reading_um: f64,
    position_um: f64,
    knows_position: bool,
    failure: Option<String>,
}

/// A command line in words; quotes hold words together.
fn words(command: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in command.chars() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (None, '"' | '\'') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, c) if c.is_whitespace() => words.extend(word.take()),
            (_, c) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

/// The reading and, behind it, the true position.
fn answer(line: &str) -> Option<(f64, Option<f64>)> {
    let numbers: Option<Vec<f64>> = line
        .split([',', ' ', '\t'])
        .filter(|field| !field.is_empty())
        .map(|field| field.parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect();
    match numbers?.as_slice() {
        [reading] => Some((*reading, None)),
        [reading, position] => Some((*reading, Some(*position))),
        _ => None,
    }
}

/// Lines of a program; one that is too long ends them.
fn lines(from: impl Read) -> impl Iterator<Item = String> {
    let mut from = BufReader::new(from);
    let mut is_whole = true;
    std::iter::from_fn(move || {
        let mut line = Vec::new();
        let read = (&mut from).take(LONGEST_LINE).read_until(b'\n', &mut line);
        if !is_whole || read.ok()? == 0 {
            return None;
        }
        is_whole = line.ends_with(b"\n");
        Some(String::from_utf8_lossy(&line).trim_end().to_owned())
    })
}

impl PlantProgram {
    /// Starts a program. It finds the sampling period, s, in its environment as `HYSTERON_PERIOD_S`.
    pub fn start(command: &str, period_s: f64) -> Result<Self> {
        let words = words(command);
        let Some((program, arguments)) = words.split_first() else {
            return Err(Error::new(
                "--plant",
                "is empty; expected a command, such as \"python3 my_stage.py\"",
            ));
        };
        let mut child = Command::new(program)
            .args(arguments)
            .env("HYSTERON_PERIOD_S", period_s.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| Error::new("--plant", format!("cannot start `{program}`: {e}")))?;
        // One answer to one drive: both channels hold one, and what a program writes or does not read beyond
        // that waits in its pipes.
        let (sender, answers) = sync_channel(1);
        if let Some(out) = child.stdout.take() {
            spawn(move || lines(out).try_for_each(|line| sender.send(line)));
        }
        let (drives, to_send) = sync_channel::<f64>(1);
        if let Some(mut to) = child.stdin.take() {
            // A program that does not read lets this thread wait, not the loop.
            spawn(move || {
                to_send
                    .iter()
                    .try_for_each(|drive_v| to.write_all(format!("{drive_v}\n").as_bytes()))
            });
        }
        let complaints = child.stderr.take().map(|from| {
            spawn(move || {
                lines(from)
                    .filter(|line| !line.trim().is_empty())
                    .last()
                    .unwrap_or_default()
            })
        });
        Ok(Self {
            command: command.to_owned(),
            drives: Some(drives),
            child,
            answers,
            complaints,
            longest_answer: LONGEST_ANSWER,
            answered: 0,
            reading_um: 0.0,
            position_um: 0.0,
            knows_position: true,
            failure: None,
        })
    }

    /// Whether every answer had the true position.
    pub fn knows_position(&self) -> bool {
        self.knows_position
    }

    /// What went wrong, if anything did.
    pub fn finish(mut self) -> Result<()> {
        match self.failure.take() {
            None => Ok(()),
            Some(failure) => Err(Error::new(format!("--plant \"{}\"", self.command), failure)),
        }
    }

    /// How the program ended, and the last line of its complaints.
    fn ended(&mut self) -> String {
        self.drives = None;
        let by = Instant::now() + self.longest_answer;
        while matches!(self.child.try_wait(), Ok(None)) && Instant::now() < by {
            sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let status = match self.child.wait() {
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        let complaint = self.complaints.take().and_then(|t| t.join().ok());
        let complaint = complaint.filter(|line| !line.is_empty());
        format!(
            "ended after {} answers ({status}){}. It must answer every line until its input ends.",
            self.answered,
            complaint.map_or_else(String::new, |line| format!(": {}", shown(&line)))
        )
    }

    /// The numbers of the newest line.
    fn require_answer(&self, line: &str) -> std::result::Result<(f64, Option<f64>), String> {
        answer(line).ok_or_else(|| {
            format!(
                "answers `{}` in line {}. Expected the reading in um, and behind it the true position if it is known.",
                shown(line),
                self.answered
            )
        })
    }

    fn exchange(&mut self, drive_v: f64) -> std::result::Result<(), String> {
        if let Ok(line) = self.answers.try_recv() {
            self.answered += 1;
            self.require_answer(&line)?;
            return Err(format!(
                "answers `{}` before drive {} is sent. It must read a line for each line that it writes.",
                shown(&line),
                self.answered
            ));
        }
        match self.drives.as_ref().map(|drives| drives.try_send(drive_v)) {
            Some(Ok(())) => {}
            Some(Err(TrySendError::Full(_))) => {
                return Err(format!(
                    "has answered {} drives without reading them. It must read a line for each line that it writes.",
                    self.answered
                ));
            }
            Some(Err(TrySendError::Disconnected(_))) | None => return Err(self.ended()),
        }
        let line = match self.answers.recv_timeout(self.longest_answer) {
            Ok(line) => line,
            Err(RecvTimeoutError::Disconnected) => return Err(self.ended()),
            Err(RecvTimeoutError::Timeout) => {
                let _ = self.child.kill();
                return Err(format!(
                    "has not answered drive {} for {:.0} s. It must write and flush a line for each: print(reading, flush=True).",
                    self.answered + 1,
                    self.longest_answer.as_secs_f64()
                ));
            }
        };
        self.answered += 1;
        let (reading_um, position_um) = self.require_answer(&line)?;
        self.knows_position &= position_um.is_some();
        (self.reading_um, self.position_um) = (reading_um, position_um.unwrap_or(reading_um));
        Ok(())
    }
}

fn shown(line: &str) -> String {
    line.chars().take(SHOWN).collect()
}

impl Plant for PlantProgram {
    /// No force acts from outside: what does is the program's own.
    fn advance(&mut self, drive_v: f64, _external_um: f64) {
        if self.failure.is_none() {
            self.failure = self.exchange(drive_v).err();
        }
    }

    fn displacement_um(&self) -> f64 {
        self.position_um
    }

    fn sensor_um(&self) -> f64 {
        self.reading_um
    }
}

impl Drop for PlantProgram {
    fn drop(&mut self) {
        // One that does not read would wait for ever.
        self.drives = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_words_and_quotes_hold_them_together() {
        assert_eq!(
            words("python3 'my stage.py' --gain \"\" 2"),
            ["python3", "my stage.py", "--gain", "", "2"]
        );
    }

    #[test]
    fn an_answer_is_a_reading_and_perhaps_a_position() {
        assert_eq!(answer(" 1.5 "), Some((1.5, None)));
        assert_eq!(answer("1.5,1.25"), Some((1.5, Some(1.25))));
        for nonsense in ["", "ready", "nan", "1 2 3", "1.5 um"] {
            assert_eq!(answer(nonsense), None, "{nonsense}");
        }
    }

    /// A program that reads and says nothing.
    #[test]
    #[cfg(unix)]
    fn one_that_hangs_is_stopped_with_a_message() {
        let mut plant = PlantProgram::start("sleep 1000", 5e-5).expect("starts");
        plant.longest_answer = Duration::from_millis(100);
        plant.advance(1.0, 0.0);
        plant.advance(2.0, 0.0);
        let said = plant.finish().unwrap_err().to_string();
        assert!(said.contains("has not answered drive 1 "), "{said}");
    }

    /// Programs that do not wait for their drives: each ends with a message, however much it writes.
    #[test]
    #[cfg(unix)]
    fn one_that_answers_unasked_is_stopped_with_a_message() {
        for (command, expected) in [
            ("yes 1", "It must read a line for each line that it writes."),
            (
                "sh -c 'while :; do echo 1; sleep 0.0001; done'",
                "It must read a line for each line that it writes.",
            ),
            ("cat /dev/zero", "in line 1. Expected the reading"),
        ] {
            let mut plant = PlantProgram::start(command, 5e-5).expect("starts");
            for _ in 0..100_000 {
                plant.advance(12.345_678_901_234_5, 0.0);
                if plant.failure.is_some() {
                    break;
                }
            }
            let said = plant.finish().unwrap_err().to_string();
            assert!(said.contains(expected), "{command}: {said}");
        }
    }
}
