//! A program of the user as the plant of `track`: it reads drives and writes readings, line by line.
//!
//! For every sampling period it gets a line with the drive of that period, V. It answers with a line that has
//! the sensor's reading at the end of the period, um, and behind it, if it knows, the true position. It ends
//! when its input ends.

use hysteron::{Error, Result};
use hysteron_sim::closed_loop::Plant;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{JoinHandle, spawn};
use std::time::Duration;

/// How long an answer may take. A program that loads its libraries first takes some seconds.
const LONGEST_ANSWER: Duration = Duration::from_secs(20);
/// How much of a line is shown, in characters.
const SHOWN: usize = 60;

/// The program while it runs.
pub struct PlantProgram {
    command: String,
    child: Child,
    drives: Option<BufWriter<ChildStdin>>,
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
        let (sender, answers) = channel();
        if let Some(out) = child.stdout.take() {
            spawn(move || {
                for line in BufReader::new(out).lines().map_while(|line| line.ok()) {
                    if sender.send(line).is_err() {
                        break;
                    }
                }
            });
        }
        let complaints = child.stderr.take().map(|from| {
            spawn(move || {
                let lines = BufReader::new(from).lines().map_while(|line| line.ok());
                lines
                    .filter(|line| !line.trim().is_empty())
                    .last()
                    .unwrap_or_default()
            })
        });
        Ok(Self {
            command: command.to_owned(),
            drives: child.stdin.take().map(BufWriter::new),
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

    fn exchange(&mut self, drive_v: f64) -> std::result::Result<(), String> {
        let sent = self
            .drives
            .as_mut()
            .is_some_and(|to| writeln!(to, "{drive_v}").and_then(|()| to.flush()).is_ok());
        if !sent {
            return Err(self.ended());
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
        let (reading_um, position_um) = answer(&line).ok_or_else(|| {
            format!(
                "answers `{}` in line {}. Expected the reading in um, and behind it the true position if it is known.",
                shown(&line),
                self.answered
            )
        })?;
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
}
