//! A run without an end, for programs outside: the serial port on a shared line, the log as it comes, virtual
//! time held to that of the clock.
//!
//! Where the emulated part is faster than its hardware it waits; where it is slower, the programs outside do.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use defmt_decoder::{DecodeError, Table};
use rigless::emulator::{Driver, Host, Start, Stop, run as emulate};
use rigless::session::Session;
use rigless::time::VirtualNanos;

use crate::board::NucleoBoard;
use crate::real_time_transfer::ControlBlock;
use crate::run::{MILLISECOND, Watchdog, prepare};
use crate::serial_line::SharedLine;

/// Does the work between two milliseconds of virtual time.
struct Live {
    control_block: ControlBlock,
    /// To the thread that decodes: a decoder stays on its thread.
    raw_log: Sender<Vec<u8>>,
    watchdog: Watchdog,
    begun: Instant,
}

impl Live {
    fn pass_log_on(&mut self, host: &mut dyn Host) {
        if !self.control_block.ready(host) {
            return;
        }
        let mut raw = Vec::new();
        self.control_block.take_up(host, &mut raw);
        if !raw.is_empty() {
            // Where nobody decodes any more the log is lost; the run is not.
            let _ = self.raw_log.send(raw);
        }
    }
}

/// Decodes what comes until nothing more can.
fn decode(table: &Table, raw_log: &Receiver<Vec<u8>>, mut log: impl FnMut(&str, &str)) {
    let mut decoder = table.new_stream_decoder();
    for raw in raw_log {
        decoder.received(&raw);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    log(level, &frame.display_message().to_string());
                }
                Err(DecodeError::Malformed) => {}
                Err(DecodeError::UnexpectedEof) => break,
            }
        }
    }
}

impl Driver<NucleoBoard> for Live {
    fn on_stop(
        &mut self,
        session: &mut Session<NucleoBoard>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        self.pass_log_on(host);
        self.watchdog.serve(session, stop, host);
        let ahead = Duration::from_nanos(stop.at.0).saturating_sub(self.begun.elapsed());
        if !ahead.is_zero() {
            std::thread::sleep(ahead);
        }
        Some(VirtualNanos(stop.at.0 + MILLISECOND))
    }
}

/// Runs the image on the board until the process ends; `log` gets every message with its level.
///
/// # Errors
/// The image cannot be read or placed, has no RTT control block or defmt table, or the emulated part refused
/// something.
pub fn run_live(
    elf: &Path,
    board: NucleoBoard,
    block: Option<&[u8]>,
    envelope: Option<&[u8]>,
    line: &SharedLine,
    log: impl FnMut(&str, &str) + Send + 'static,
) -> Result<()> {
    let bytes = std::fs::read(elf)?;
    let table =
        Table::parse(&bytes)?.ok_or_else(|| anyhow!("{}: no .defmt section", elf.display()))?;
    let prepared = prepare(
        elf,
        board,
        [block, None],
        [envelope, None],
        line,
        MILLISECOND,
    )?;
    let (raw_log, to_decode) = channel();
    std::thread::spawn(move || decode(&table, &to_decode, log));
    let driver = Live {
        control_block: prepared.control_block,
        raw_log,
        watchdog: Watchdog::default(),
        begun: Instant::now(),
    };
    let mut start = Start::new(&prepared.images);
    start.semihosting = true;
    let mut finished = emulate(prepared.session, &start, driver)?;
    finished
        .session
        .take_error()
        .map_or(Ok(()), |error| Err(error.into()))
}
