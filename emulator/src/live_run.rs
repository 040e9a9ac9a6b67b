//! A run without an end, for programs outside: the serial port on a shared line, the log as it comes, virtual time held to that of the clock.
//!
//! Where the emulated part is faster than its hardware it waits; where it is slower, the programs outside do.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use defmt_decoder::{DecodeError, StreamDecoder, Table};
use rigless::emulator::{Driver, Host, Start, Stop, run as emulate};
use rigless::session::Session;
use rigless::time::VirtualNanos;

use crate::board::NucleoBoard;
use crate::real_time_transfer::ControlBlock;
use crate::run::{MILLISECOND, Watchdog, prepare};
use crate::serial_line::SharedLine;

/// Does the work between two milliseconds of virtual time.
struct Live<L> {
    control_block: ControlBlock,
    decoder: Box<dyn StreamDecoder>,
    watchdog: Watchdog,
    begun: Instant,
    log: L,
}

impl<L: FnMut(&str, &str)> Live<L> {
    fn pass_log_on(&mut self, host: &mut dyn Host) {
        if !self.control_block.ready(host) {
            return;
        }
        let mut raw = Vec::new();
        self.control_block.take_up(host, &mut raw);
        self.decoder.received(&raw);
        loop {
            match self.decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| level.as_str());
                    (self.log)(level, &frame.display_message().to_string());
                }
                Err(DecodeError::Malformed) => {}
                Err(DecodeError::UnexpectedEof) => return,
            }
        }
    }
}

impl<L: FnMut(&str, &str) + 'static> Driver<NucleoBoard> for Live<L> {
    fn on_stop(&mut self, session: &mut Session<NucleoBoard>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
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
/// The image cannot be read or placed, has no RTT control block or defmt table, or the emulated part refused something.
pub fn run_live(
    elf: &Path,
    board: NucleoBoard,
    block: Option<&[u8]>,
    line: &SharedLine,
    log: impl FnMut(&str, &str) + 'static,
) -> Result<()> {
    let bytes = std::fs::read(elf)?;
    let table = Table::parse(&bytes)?.ok_or_else(|| anyhow!("{}: no .defmt section", elf.display()))?;
    // The emulated run owns what it uses; it ends with the process.
    let table: &'static Table = Box::leak(Box::new(table));
    let prepared = prepare(elf, board, block, line, MILLISECOND)?;
    let driver = Live {
        control_block: prepared.control_block,
        decoder: table.new_stream_decoder(),
        watchdog: Watchdog::default(),
        begun: Instant::now(),
        log,
    };
    let mut start = Start::new(&prepared.images);
    start.semihosting = true;
    let mut finished = emulate(prepared.session, &start, driver)?;
    finished.session.take_error().map_or(Ok(()), |error| Err(error.into()))
}
