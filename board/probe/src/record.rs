//! `record`: conditions the actuator, plays the drive of an identification and keeps the log, from which
//! `hysteron capture` makes a data set.
//!
//! # How it works
//! The board is restarted, so that its log begins with the scale of its converters. [`Conversation`] hears
//! every message and gives the next command for the board; it knows nothing of probes. The log is kept in
//! memory and written when all of it is there: a recording that failed leaves no file.

use crate::failure::{Result, whole};
use crate::log::{PAUSE, PIECE, log_table, meet, send};
use crate::{chip, image};
use defmt_decoder::DecodeError;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Shortest and longest drive, ticks: half a second shows the slowest tone once, an hour at 20 kHz is more
/// than anybody keeps.
pub const TICKS: std::ops::RangeInclusive<i64> = 10_000..=72_000_000;
/// A board that says nothing for so long has stopped: its trace goes on at rest too.
const SILENCE: Duration = Duration::from_secs(3);
/// Messages of the trace behind the end of the drive that make sure of its last block.
const TRACES_BEHIND: u32 = 4;

/// How far a recording has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The scale of the converters has not been said.
    Starting,
    /// The board is to come to rest.
    Resting,
    /// The self-test of arming has been asked for, and perhaps begun.
    Arming(bool),
    /// It received the command to condition the actuator; whether it plays.
    Conditioning(bool),
    /// It received the command to play the drive; whether it does.
    Identifying(bool),
    /// The drive has ended, and so many messages of its trace came since.
    Ending(u32),
}

/// Chooses the commands for the board from what the board reports.
pub struct Conversation {
    stage: Stage,
    ticks: u32,
    /// Messages of the trace while the drive was played.
    traces: u64,
}

/// What follows from a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Next {
    /// Listen on.
    Listen,
    /// Give the board this line.
    Say(String),
    /// All of it is there.
    Done,
}

impl Conversation {
    /// Before the board's first message; the drive lasts so many ticks.
    pub fn new(ticks: u32) -> Self {
        Self {
            stage: Stage::Starting,
            ticks,
            traces: 0,
        }
    }

    /// Hears a message of the log.
    ///
    /// # Errors
    /// The board refused something or stopped with a fault, or nothing of the drive was traced.
    pub fn hear(&mut self, message: &str) -> Result<Next> {
        if let Some(fault) = message.strip_prefix("mode fault: ") {
            return Err(format!(
                "the board has stopped: {fault}; nothing was recorded"
            ));
        }
        if self.stage != Stage::Starting
            && let Some(reason) = message.strip_prefix("refused")
        {
            return Err(format!("the board refuses{reason}; nothing was recorded"));
        }
        let is_trace = message.starts_with("trace [");
        let (stage, next) = match self.stage {
            Stage::Starting if message.starts_with("converters ") => (Stage::Resting, Next::Listen),
            Stage::Resting if message == "mode rest" => {
                (Stage::Arming(false), Next::Say("arm".into()))
            }
            Stage::Arming(_) if message == "mode playing" => (Stage::Arming(true), Next::Listen),
            Stage::Arming(true) if message == "mode rest" => {
                (Stage::Conditioning(false), Next::Say("condition".into()))
            }
            Stage::Conditioning(_) if message == "mode playing" => {
                (Stage::Conditioning(true), Next::Listen)
            }
            Stage::Conditioning(true) if message == "mode rest" => (
                Stage::Identifying(false),
                Next::Say(format!("identify {}", self.ticks)),
            ),
            Stage::Identifying(_) if message == "mode playing" => {
                (Stage::Identifying(true), Next::Listen)
            }
            Stage::Identifying(true) if message == "mode rest" => (Stage::Ending(0), Next::Listen),
            Stage::Identifying(true) if is_trace => {
                self.traces += 1;
                (self.stage, Next::Listen)
            }
            Stage::Ending(TRACES_BEHIND) if self.traces == 0 => {
                return Err(
                    "nothing of the drive came over the probe; nothing was recorded".into(),
                );
            }
            Stage::Ending(TRACES_BEHIND) => (self.stage, Next::Done),
            Stage::Ending(since) if is_trace => (Stage::Ending(since + 1), Next::Listen),
            // A board that restarts by itself begins its log anew.
            stage if stage != Stage::Resting && message.starts_with("converters ") => {
                return Err("the board has restarted; nothing was recorded".into());
            }
            stage => (stage, Next::Listen),
        };
        self.stage = stage;
        Ok(next)
    }
}

/// Records into a new file.
pub fn record(path: &Path, raw: &Path, ticks: u32, selector: Option<&str>) -> Result<()> {
    let (image, bytes) = image::read(path)?;
    let table = log_table(path, &bytes)?;
    require_new(raw)?;
    let ended = Arc::new(AtomicBool::new(false));
    let at_end = Arc::clone(&ended);
    ctrlc::set_handler(move || at_end.store(true, Ordering::SeqCst))
        .map_err(|error| format!("Ctrl-C cannot be listened to: {error}"))?;
    let mut session = chip::connect(selector)?;
    let mut core = session.core(0).map_err(|error| whole(&error))?;
    core.reset()
        .map_err(|error| format!("the board does not restart: {}", whole(&error)))?;
    let mut rtt = meet(&mut core, image.log_address, &ended)?;
    let (mut log, mut piece) = (Vec::new(), vec![0; PIECE]);
    let (mut decoder, mut conversation, mut heard) = (
        table.new_stream_decoder(),
        Conversation::new(ticks),
        Instant::now(),
    );
    let mut listen = || -> Result<bool> {
        if ended.load(Ordering::SeqCst) {
            return Err("ended; nothing was recorded".into());
        }
        let up = rtt
            .up_channels()
            .first_mut()
            .ok_or("the board has no log channel")?;
        let count = up
            .read(&mut core, &mut piece)
            .map_err(|error| format!("the board is gone: {}", whole(&error)))?;
        let came = piece.get(..count).unwrap_or_default();
        log.extend_from_slice(came);
        decoder.received(came);
        if count > 0 {
            heard = Instant::now();
        } else if heard.elapsed() > SILENCE {
            return Err("the board says nothing any more; nothing was recorded".into());
        } else {
            std::thread::sleep(PAUSE);
        }
        loop {
            match decoder.decode() {
                Ok(frame) => match conversation.hear(&frame.display_message().to_string())? {
                    Next::Listen => {}
                    Next::Say(line) => {
                        println!("{line}");
                        send(&line, &mut rtt, &mut core)?;
                    }
                    Next::Done => return Ok(true),
                },
                Err(DecodeError::Malformed) => {}
                Err(DecodeError::UnexpectedEof) => return Ok(false),
            }
        }
    };
    let done = loop {
        match listen() {
            Ok(false) => {}
            Ok(true) => break Ok(()),
            Err(problem) => break Err(problem),
        }
    };
    // The drive goes to rest whatever happened; of two problems the first is reported.
    let stopped = send("stop\ntrace 31 20", &mut rtt, &mut core);
    done.and(stopped)?;
    write_whole(raw, &log)?;
    println!("{}: {} bytes of log", raw.display(), log.len());
    Ok(())
}

/// Nothing stands there yet, and something can.
fn require_new(path: &Path) -> Result<()> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    if path.exists() {
        Err(format!(
            "{}: exists; expected the name of a new file",
            path.display()
        ))
    } else if !folder.is_dir() {
        Err(format!(
            "{}: {} is no folder",
            path.display(),
            folder.display()
        ))
    } else {
        Ok(())
    }
}

/// Writes a new file whole or not at all: under another name first.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    require_new(path)?;
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part = path.with_file_name(name);
    let written = std::fs::File::create_new(&part)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&part, path));
    written.map_err(|error| {
        // What is left of it is of no use to anybody.
        let _ = std::fs::remove_file(&part);
        format!("{}: {error}", path.display())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the image says, as the emulated board's tests show it.
    const LOG: [&str; 21] = [
        "hysteron 0.1.0: core 400000000 Hz, control 20000 Hz, front end SPI, AD4000 and AD5791 families",
        "parameter block B refused: no block",
        "refused: what an earlier host typed",
        "converters -16777216 251658240 -83886080 587202560 9362 46811 20000",
        "mode rest",
        "trace [1, 2]",
        "done at tick 40",
        "mode playing",
        "mode rest",
        "done at tick 60",
        "mode playing",
        "trace [1, 2]",
        "mode rest",
        "trace channels 17 decimation 1",
        "done at tick 24000",
        "mode playing",
        "trace [3]",
        "mode rest",
        "trace [4]",
        "trace [5]",
        "trace [6]",
    ];

    #[test]
    fn the_board_is_told_what_follows_from_what_it_says() {
        let mut conversation = Conversation::new(100_000);
        let mut said = Vec::new();
        for (nth, message) in LOG.iter().enumerate() {
            match conversation.hear(message).expect("no problem") {
                Next::Listen => {}
                Next::Say(line) => said.push((nth, line)),
                Next::Done => panic!("too early, at {message}"),
            }
        }
        assert_eq!(
            said,
            [
                (4, "arm".to_string()),
                (8, "condition".to_string()),
                (12, "identify 100000".to_string())
            ]
        );
        assert_eq!(conversation.hear("trace [7]"), Ok(Next::Listen));
        assert_eq!(conversation.hear("trace [8]"), Ok(Next::Done));
    }

    #[test]
    fn whatever_goes_wrong_ends_it() {
        let after = |count: usize, message: &str| {
            let mut conversation = Conversation::new(100_000);
            LOG.iter()
                .take(count)
                .for_each(|message| assert!(conversation.hear(message).is_ok()));
            conversation.hear(message)
        };
        for count in 4..LOG.len() {
            assert!(
                after(count, "mode fault: sensor out of range")
                    .is_err_and(|problem| problem.contains("sensor out of range"))
            );
            assert!(
                after(count, "refused at tick 7: only at rest")
                    .is_err_and(|problem| problem.contains("only at rest"))
            );
            if count > 4 {
                assert!(
                    after(count, "converters 1 2 3")
                        .is_err_and(|problem| problem.contains("restarted")),
                    "{count}"
                );
            }
        }
        assert!(after(3, "mode fault: parameter block").is_err());
        // A log of which the drive's part was lost is no record.
        let mut conversation = Conversation::new(100_000);
        LOG.iter()
            .filter(|message| **message != "trace [3]")
            .for_each(|message| assert!(conversation.hear(message).is_ok()));
        assert_eq!(conversation.hear("trace [7]"), Ok(Next::Listen));
        assert!(conversation.hear("trace [8]").is_err());
    }

    #[test]
    fn a_file_is_written_whole_and_none_is_replaced() {
        let folder = std::env::temp_dir().join(format!("hysteron-probe-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("log.rtt");
        assert_eq!(require_new(&path), Ok(()));
        assert_eq!(write_whole(&path, b"abc"), Ok(()));
        assert_eq!(std::fs::read(&path).expect("a file"), b"abc");
        assert!(write_whole(&path, b"def").is_err_and(|problem| problem.contains("exists")));
        assert_eq!(std::fs::read(&path).expect("a file"), b"abc");
        assert_eq!(
            std::fs::read_dir(&folder).expect("a folder").count(),
            1,
            "nothing else is left"
        );
        assert!(require_new(&folder.join("none/log.rtt")).is_err());
        std::fs::remove_dir_all(&folder).expect("removed");
    }
}
