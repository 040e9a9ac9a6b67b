//! `attach`: the log of a board that runs, and commands to it.

use crate::failure::{Result, whole};
use crate::{chip, image};
use defmt_decoder::{DecodeError, StreamDecoder, Table};
use probe_rs::Core;
use probe_rs::rtt::{self, Rtt};
use std::fs::File;
use std::io::{BufRead, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

/// Bytes that are read at once.
pub const PIECE: usize = 16 * 1024;
/// Wait where there was nothing to read: the board's buffer holds more than comes in that time.
pub const PAUSE: Duration = Duration::from_millis(2);
/// How long a board that was restarted may take until its log is there.
const START: Duration = Duration::from_secs(3);

/// Shows the log until Ctrl-C.
pub fn attach(
    path: &Path,
    restart: bool,
    raw: Option<&Path>,
    selector: Option<&str>,
) -> Result<()> {
    let (image, bytes) = image::read(path)?;
    let table = log_table(path, &bytes)?;
    let ended = Arc::new(AtomicBool::new(false));
    let at_end = Arc::clone(&ended);
    ctrlc::set_handler(move || at_end.store(true, Ordering::SeqCst))
        .map_err(|error| format!("Ctrl-C cannot be listened to: {error}"))?;

    let mut session = chip::connect(selector)?;
    let mut core = session.core(0).map_err(|error| whole(&error))?;
    let mut raw = raw.map(new_file).transpose()?;
    if restart {
        core.reset()
            .map_err(|error| format!("the board does not restart: {}", whole(&error)))?;
    }
    let mut rtt = meet(&mut core, image.log_address, &ended)?;
    println!(
        "attached; what is typed goes to the board (`status`, `stop`, ..), Ctrl-C ends and leaves it as it is"
    );
    let typed = typed_lines();
    let mut decoder = table.new_stream_decoder();
    let mut piece = vec![0; PIECE];
    while !ended.load(Ordering::SeqCst) {
        let up = rtt
            .up_channels()
            .first_mut()
            .ok_or("the board has no log channel")?;
        let count = up
            .read(&mut core, &mut piece)
            .map_err(|error| format!("the board is gone: {}", whole(&error)))?;
        let came = piece.get(..count).unwrap_or_default();
        if let Some((file, name)) = &mut raw {
            file.write_all(came)
                .map_err(|error| format!("{name}: {error}"))?;
        }
        decoder.received(came);
        show(&mut *decoder);
        pass_on(&typed, &mut rtt, &mut core)?;
        if count == 0 {
            std::thread::sleep(PAUSE);
        }
    }
    Ok(())
}

/// The messages that an image can log.
pub fn log_table(path: &Path, bytes: &[u8]) -> Result<Table> {
    let table = Table::parse(bytes).map_err(|error| format!("{}: {error}", path.display()))?;
    table.ok_or_else(|| format!("{}: has no table of log messages", path.display()))
}

/// A file that was not there before, with its name.
fn new_file(path: &Path) -> Result<(File, String)> {
    let name = path.display().to_string();
    File::create_new(path)
        .map(|file| (file, name.clone()))
        .map_err(|error| format!("{name}: {error}; expected the name of a new file"))
}

/// The log's control block, once the board has made it.
pub fn meet(core: &mut Core, address: u64, ended: &AtomicBool) -> Result<Rtt> {
    let begun = Instant::now();
    loop {
        match Rtt::attach_at(core, address) {
            Ok(rtt) => return Ok(rtt),
            Err(rtt::Error::ControlBlockNotFound)
                if begun.elapsed() < START && !ended.load(Ordering::SeqCst) =>
            {
                std::thread::sleep(PAUSE)
            }
            Err(rtt::Error::ControlBlockNotFound) => {
                return Err(format!(
                    "there is no log at {address:#010x}: the board runs another image; `hysteron board flash` brings this one"
                ));
            }
            Err(error) => return Err(format!("the log cannot be read: {}", whole(&error))),
        }
    }
}

/// Lines that somebody types, as they come.
fn typed_lines() -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin()
            .lock()
            .lines()
            .map_while(std::io::Result::ok)
        {
            if sender.send(line).is_err() {
                break;
            }
        }
    });
    receiver
}

/// Gives the board the next line that was typed, all of it.
fn pass_on(typed: &Receiver<String>, rtt: &mut Rtt, core: &mut Core) -> Result<()> {
    match typed.try_recv() {
        Ok(line) => send(&line, rtt, core),
        Err(TryRecvError::Empty | TryRecvError::Disconnected) => Ok(()),
    }
}

/// Gives the board lines, all of them.
pub fn send(lines: &str, rtt: &mut Rtt, core: &mut Core) -> Result<()> {
    let line = format!("{lines}\n");
    let mut rest = line.as_bytes();
    let begun = Instant::now();
    while !rest.is_empty() {
        let down = rtt
            .down_channels()
            .first_mut()
            .ok_or("the board takes no commands over the probe")?;
        let count = down
            .write(core, rest)
            .map_err(|error| format!("the board is gone: {}", whole(&error)))?;
        rest = rest.get(count..).unwrap_or_default();
        if begun.elapsed() > START {
            return Err("the board takes no more commands; press its reset button".into());
        }
    }
    Ok(())
}

/// Prints the messages that are whole; the running trace is for programs that decode it.
fn show(decoder: &mut dyn StreamDecoder) {
    loop {
        match decoder.decode() {
            Ok(frame) => {
                let text = frame.display_message().to_string();
                if !text.starts_with("trace [") {
                    println!(
                        "{:>5} {text}",
                        frame.level().map_or("", |level| level.as_str())
                    );
                }
            }
            Err(DecodeError::Malformed) => {}
            Err(DecodeError::UnexpectedEof) => return,
        }
    }
}
