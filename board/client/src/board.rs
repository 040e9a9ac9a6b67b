//! The conversation with a board.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use hysteron_core::command_lines::STOP_BYTE;

use hysteron_protocol::LINE_BYTES;
use hysteron_protocol::seal::{MOVING, SEAL_BYTES, checksum};

use crate::error::{Error, Result, meaning};
use crate::fault::{fault_name, what_to_do};
use crate::port::{Address, Port, USUAL_BAUD};

/// A board that sends no byte for so long while an answer is due counts as lost.
pub const PATIENCE: Duration = Duration::from_secs(20);
/// The same where it is not known whether anybody listens.
const SHORT_PATIENCE: Duration = Duration::from_secs(1);
/// How often a board is asked whether it is there.
const GREETINGS: usize = 30;
/// The same of a serial port at the first speed.
const GREETINGS_OF_A_PORT: usize = 3;
/// The same of a socket: under a load of nine, an emulated board on two cores answers nothing for 6 s.
const GREETINGS_OF_A_SOCKET: usize = 15;
/// Bytes of lines that are sent before the board is asked whether it took them: its store holds 2048.
const MOST_BYTES_AT_ONCE: usize = 1500;
/// Bytes of a line, at most: the board's longest has a few hundred.
const MOST_LINE_BYTES: usize = 4096;
/// Bytes of an answer, at most: the whole of the largest recorder as text has less than half of it.
const MOST_ANSWER_BYTES: usize = 4 << 20;
/// Bytes that may stand before the answer to a greeting: what is left of an answer to somebody else.
const MOST_GREETING_BYTES: usize = 1 << 16;
/// A line that has begun ends within so many times the patience with silence.
const LINE_PATIENCES: u32 = 5;
/// Time between two questions whether something has ended.
pub(crate) const BETWEEN_QUESTIONS: Duration = Duration::from_millis(20);

/// A command that moves something with its checksum, so that it comes whole or not at all; others as they are.
fn sealed(command: &str) -> String {
    let is_moving = command
        .split_ascii_whitespace()
        .next()
        .is_some_and(|word| MOVING.contains(&word));
    if is_moving && command.len() + SEAL_BYTES < LINE_BYTES {
        format!("{command} *{:08X}", checksum(command))
    } else {
        command.to_string()
    }
}

/// A board that answers.
pub struct Board {
    port: Port,
    incoming: VecDeque<u8>,
    patience: Duration,
    /// What `*IDN?` answered.
    pub identification: String,
}

/// The one command that need not wait for its turn: the board obeys its byte wherever it stands between
/// others.
pub struct Stopper(Port);

impl Stopper {
    /// Brings the drive to rest, servo off.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn stop(&mut self) -> Result<()> {
        self.0.send(&[STOP_BYTE])
    }
}

impl Board {
    /// Opens the port and greets the board. `baud` is the speed for the rest of the conversation; without one
    /// it stays as it is.
    ///
    /// # Errors
    /// The port cannot be opened, nobody answers, or somebody else does.
    pub fn connect(address: &Address, baud: Option<u32>) -> Result<Self> {
        let mut this = Self {
            port: Port::open(address)?,
            incoming: VecDeque::new(),
            patience: PATIENCE,
            identification: String::new(),
        };
        // A program that ended in the middle may have left the board at another speed.
        let speeds = [USUAL_BAUD, baud.unwrap_or(USUAL_BAUD)];
        let times = if matches!(address, Address::Tcp(_)) {
            GREETINGS_OF_A_SOCKET
        } else {
            GREETINGS_OF_A_PORT
        };
        let mut met = this.meet_at(speeds[0], times);
        if met.is_err() && speeds[1] != speeds[0] {
            met = this.meet_at(speeds[1], times);
        }
        if let Err(problem) = met {
            let hint = "is it powered, and does no other program hold the port?";
            return Err(Error::new(
                address,
                format!(
                    "no board answers `*IDN?`, the other side {}; {hint}",
                    problem.message()
                ),
            ));
        }
        if !this.identification.contains("HYSTERON") {
            return Err(Error::new(
                address,
                format!(
                    "`{}` answers, which is no board of this project",
                    this.identification
                ),
            ));
        }
        if let Some(baud) = baud {
            this.change_baud(baud)?;
        }
        Ok(this)
    }

    fn meet_at(&mut self, speed: u32, times: usize) -> Result<()> {
        self.port.set_baud(speed)?;
        self.greet(times)
    }

    /// From now on the board counts as lost when it has sent nothing for so long while an answer is due.
    pub fn set_patience(&mut self, patience: Duration) {
        self.patience = patience;
    }

    /// A stop that can be sent whatever the conversation is at.
    ///
    /// # Errors
    /// The system gives no second handle of the port.
    pub fn stopper(&self) -> Result<Stopper> {
        self.port.second().map(Stopper)
    }

    /// Forgets what came before and asks who is there.
    fn greet(&mut self, times: usize) -> Result<()> {
        let mut last = Error::new("board", "does not answer");
        for _ in 0..times {
            self.incoming.clear();
            // What stands half in the board's line ends here.
            self.port.send(b"\n*IDN?\n")?;
            match self.answer_within(SHORT_PATIENCE, MOST_GREETING_BYTES) {
                Ok(answer) if answer.matches(',').count() == 3 => {
                    self.identification = answer.trim().to_string();
                    // Answers to greetings before this one.
                    self.forget_what_comes()?;
                    return self
                        .ask_until("ERR?", |answer| answer.trim().parse::<i64>().is_ok())
                        .map(|_| ());
                }
                Ok(other) => last = Error::new("board", format!("answers `{}`", other.trim())),
                Err(problem) => last = problem,
            }
        }
        Err(last)
    }

    /// Forgets what comes until nothing does.
    fn forget_what_comes(&mut self) -> Result<()> {
        self.incoming.clear();
        let mut forgotten = 0;
        loop {
            match self.port.receive()?.len() {
                0 => return Ok(()),
                count if forgotten + count > MOST_GREETING_BYTES => {
                    return Err(Error::new(
                        "board",
                        format!("sends {forgotten} bytes that nobody asked for"),
                    ));
                }
                count => forgotten += count,
            }
        }
    }

    fn change_baud(&mut self, baud: u32) -> Result<()> {
        self.port.send(format!("IFC RSBAUD {baud}\n").as_bytes())?;
        // The board changes when what it was sending has gone.
        std::thread::sleep(BETWEEN_QUESTIONS);
        self.port.set_baud(baud)?;
        self.greet(GREETINGS)
            .map_err(|_| Error::new("board", format!("does not answer at {baud} bit/s")))
    }

    /// After a restart, at the speed of `baud` again.
    ///
    /// # Errors
    /// The board does not come back.
    pub(crate) fn meet_again(&mut self, baud: Option<u32>) -> Result<()> {
        // The operator may have kept the speed of this conversation (WPA).
        let kept = baud.filter(|baud| *baud != USUAL_BAUD);
        for _ in 0..GREETINGS {
            for speed in [Some(USUAL_BAUD), kept].into_iter().flatten() {
                self.port.set_baud(speed)?;
                if self.greet(1).is_ok() {
                    return baud
                        .filter(|baud| *baud != speed)
                        .map_or(Ok(()), |baud| self.change_baud(baud));
                }
            }
        }
        Err(Error::new("board", "does not come back after its restart"))
    }

    /// Sends bytes as they are.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        self.port.send(bytes)
    }

    /// What has come and was not asked for, as it is; for a person at a terminal.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn receive(&mut self) -> Result<Vec<u8>> {
        let mut bytes: Vec<u8> = self.incoming.drain(..).collect();
        bytes.extend(self.port.receive()?);
        Ok(bytes)
    }

    /// The next line, with its end.
    fn line_within(&mut self, patience: Duration) -> Result<Vec<u8>> {
        let begun = Instant::now();
        let mut heard = begun;
        loop {
            if let Some(end) = self.incoming.iter().position(|byte| *byte == b'\n') {
                return Ok(self.incoming.drain(..=end).collect());
            }
            if self.incoming.len() > MOST_LINE_BYTES || begun.elapsed() > LINE_PATIENCES * patience
            {
                let problem = format!(
                    "sends {} bytes without the end of a line: no board does, or its line is garbled",
                    self.incoming.len()
                );
                self.incoming.clear();
                return Err(Error::new("board", problem));
            }
            let bytes = self.port.receive()?;
            if !bytes.is_empty() {
                heard = Instant::now();
                self.incoming.extend(bytes);
            } else if heard.elapsed() > patience {
                return Err(Error::new(
                    "board",
                    format!("has sent nothing for {} s", patience.as_secs()),
                ));
            }
        }
    }

    /// An answer: lines up to one that does not end in a space.
    fn answer_within(&mut self, patience: Duration, most_bytes: usize) -> Result<String> {
        let mut answer = String::new();
        loop {
            let line = self.line_within(patience)?;
            let more = line.ends_with(b" \n");
            answer.push_str(String::from_utf8_lossy(&line).trim_end());
            answer.push('\n');
            if !more {
                return Ok(answer);
            }
            if answer.len() > most_bytes {
                return Err(Error::new(
                    "board",
                    format!("answers more than {most_bytes} bytes: no board does"),
                ));
            }
        }
    }

    /// Asks and returns the answer, its lines without what ends them.
    ///
    /// # Errors
    /// The board does not answer.
    pub fn ask(&mut self, question: &str) -> Result<String> {
        self.port.send(format!("{question}\n").as_bytes())?;
        self.answer_within(self.patience, MOST_ANSWER_BYTES)
            .map_err(|problem| Error::new(question, problem.message()))
    }

    /// Asks, and passes over answers to earlier questions: a board that was restarting answers greetings late,
    /// and answers come in the order of the questions.
    ///
    /// # Errors
    /// The board does not answer, or not so.
    pub(crate) fn ask_until(
        &mut self,
        question: &str,
        is_answer: impl Fn(&str) -> bool,
    ) -> Result<String> {
        let mut answer = self.ask(question)?;
        for _ in 0..2 * GREETINGS {
            if is_answer(&answer) {
                return Ok(answer);
            }
            answer = self
                .answer_within(self.patience, MOST_ANSWER_BYTES)
                .map_err(|problem| Error::new(question, problem.message()))?;
        }
        Err(Error::new(
            question,
            format!("the board answers `{}`", answer.trim()),
        ))
    }

    /// The values behind `=` in the lines of an answer, or the lines themselves where no line has one.
    ///
    /// # Errors
    /// The board does not answer, or with something else.
    pub fn numbers(&mut self, question: &str) -> Result<Vec<f64>> {
        let answer = self.ask(question)?;
        let number = |line: &str| {
            line.rsplit('=')
                .next()
                .and_then(|word| word.trim().parse().ok())
        };
        let numbers: Option<Vec<f64>> = answer.lines().map(number).collect();
        numbers.ok_or_else(|| {
            Error::new(
                question,
                format!("the board answers `{}`; expected numbers", answer.trim()),
            )
        })
    }

    /// The one value of an answer.
    ///
    /// # Errors
    /// As [`Board::numbers`].
    pub fn number(&mut self, question: &str) -> Result<f64> {
        self.numbers(question)?
            .first()
            .copied()
            .ok_or_else(|| Error::new(question, "the board answers nothing"))
    }

    /// Gives a command and sees that the board took it.
    ///
    /// # Errors
    /// It did not; the error says what that means.
    pub fn tell(&mut self, command: &str) -> Result<()> {
        self.tell_all(&[command])
    }

    /// Gives commands, as many at once as the board has room for, and sees that it took them.
    ///
    /// # Errors
    /// One of them was not taken.
    pub fn tell_all<S: AsRef<str>>(&mut self, commands: &[S]) -> Result<()> {
        let mut rest = commands;
        while !rest.is_empty() {
            let mut text = String::new();
            let mut count = 0;
            for command in rest.iter().map(AsRef::as_ref) {
                if count > 0 && text.len() + command.len() + SEAL_BYTES > MOST_BYTES_AT_ONCE {
                    break;
                }
                text.push_str(&sealed(command));
                text.push('\n');
                count += 1;
            }
            let (now, later) = rest.split_at(count);
            let first = now.first().map_or("", AsRef::as_ref);
            text.push_str("ERR?\n");
            self.port.send(text.as_bytes())?;
            let answer = self
                .answer_within(self.patience, MOST_ANSWER_BYTES)
                .map_err(|problem| Error::new(first, problem.message()))?;
            let code: u32 = answer
                .trim()
                .parse()
                .map_err(|_| Error::new(first, format!("the board answers `{}`", answer.trim())))?;
            if code != 0 {
                let place = if now.len() == 1 {
                    first.to_string()
                } else {
                    format!("{first} .. ({} commands)", now.len())
                };
                return Err(Error::new(place, meaning(code)));
            }
            rest = later;
        }
        Ok(())
    }

    /// Asks again and again until the answer is as it should be.
    ///
    /// # Errors
    /// The board does not answer, or `until` refuses an answer for good.
    pub fn wait(
        &mut self,
        question: &str,
        mut until: impl FnMut(&str) -> Result<bool>,
    ) -> Result<()> {
        while !until(self.ask(question)?.trim())? {
            std::thread::sleep(BETWEEN_QUESTIONS);
        }
        Ok(())
    }

    /// Arms the amplifier behind its self-test, unless it is armed already.
    ///
    /// # Errors
    /// The board refuses, or the self-test found something wrong; the error names it and says what to do.
    pub fn arm(&mut self) -> Result<()> {
        if self.number("ARM? 1")? == 1.0 {
            return Ok(());
        }
        self.tell("ARM 1 1")?;
        self.wait("DIA? 1", |mode| Ok(mode == "1=0" || mode == "1=3"))?;
        if self.number("ARM? 1")? == 1.0 {
            return Ok(());
        }
        let found = fault_name(self.number("DIA? 2")?);
        Err(Error::new(
            "ARM",
            format!("the self-test ended with `{found}`. {}", what_to_do(found)),
        ))
    }

    /// Conditions the actuator and zeroes the sensor, behind the self-test where the amplifier is not armed
    /// yet.
    ///
    /// # Errors
    /// The board refuses, or a fault ended it.
    pub fn condition(&mut self) -> Result<()> {
        self.arm()?;
        self.tell("ATZ 1")?;
        self.wait("DIA? 1", |mode| Ok(mode == "1=0" || mode == "1=3"))?;
        if self.number("DIA? 1")? == 3.0 {
            let found = fault_name(self.number("DIA? 2")?);
            return Err(Error::new(
                "ATZ",
                format!(
                    "the conditioning ended with `{found}`. {}",
                    what_to_do(found)
                ),
            ));
        }
        if self.number("ATZ? 1")? == 1.0 {
            Ok(())
        } else {
            Err(Error::new(
                "ATZ",
                "was stopped before the sensor was zeroed",
            ))
        }
    }
}
