//! One run of the image: the emulated part, a probe that serves RTT every so often of virtual time, and the decoded log.

use std::path::Path;
use std::sync::{Arc, Mutex};

use anyhow::{Context, Result, anyhow, bail};
use defmt_decoder::{DecodeError, Table};
use object::{Object, ObjectSymbol};
use rigless::emulator::{Driver, Host, Start, Stop, run as emulate};
use rigless::image::Image;
use rigless::session::Session;
use rigless::time::VirtualNanos;

use crate::board::NucleoBoard;
use crate::real_time_transfer::ControlBlock;

/// Nanoseconds in a millisecond.
pub const MILLISECOND: u64 = 1_000_000;

/// Where the first parameter block stands (`memory.x`, SETTINGS).
const SETTINGS: u64 = 0x081C_0000;

/// What the probe does in a run.
#[derive(Clone, Debug)]
pub struct Script {
    /// Virtual time to run, ns.
    pub until_ns: u64,
    /// How often the probe reads RTT, ns; `None`: a probe that is not there.
    pub read_every_ns: Option<u64>,
    /// A parameter block that is in the flash at the start.
    pub block: Option<Vec<u8>>,
    /// Bytes for the command channel, each with the instant from which it is sent, ns; in order.
    pub commands: Vec<(u64, Vec<u8>)>,
}

impl Script {
    /// Runs for so long with a probe that reads every millisecond and sends nothing.
    #[must_use]
    pub fn listening(until_ns: u64) -> Self {
        Self { until_ns, read_every_ns: Some(MILLISECOND), block: None, commands: Vec::new() }
    }
}

/// A log message and the instant at which the probe saw it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Virtual time at which the probe took it, ns.
    pub at_ns: u64,
    /// Level, lower case, empty for `println`.
    pub level: String,
    /// Text.
    pub text: String,
}

/// What a run left.
#[derive(Debug)]
pub struct Outcome {
    /// The board with its converters.
    pub board: Box<NucleoBoard>,
    /// Everything that came up the RTT channel.
    pub raw: Vec<u8>,
    /// The decoded log.
    pub messages: Vec<Message>,
    /// Frames that could not be decoded.
    pub malformed: u32,
    /// Where the run stood at its end: virtual time, ns, and instructions.
    pub end: (u64, u64),
    /// Restarts of the part during the run.
    pub resets: usize,
    /// Registers without a model that the image used, `instance.register`.
    pub without_model: Vec<String>,
}

impl Outcome {
    /// Texts of all messages that contain `part`.
    pub fn texts_with<'a>(&'a self, part: &'a str) -> impl Iterator<Item = &'a str> {
        self.messages.iter().map(|message| message.text.as_str()).filter(move |text| text.contains(part))
    }
}

#[derive(Debug, Default)]
struct Taken {
    raw: Vec<u8>,
    /// Length of `raw` after each visit of the probe, with its instant.
    visits: Vec<(usize, u64)>,
}

struct Probe {
    script: Script,
    control_block: ControlBlock,
    next_command: usize,
    sent_of_command: usize,
    taken: Arc<Mutex<Taken>>,
}

impl Probe {
    fn serve(&mut self, at_ns: u64, host: &mut dyn Host) {
        if !self.control_block.ready(host) {
            return;
        }
        if self.script.read_every_ns.is_some()
            && let Ok(mut taken) = self.taken.lock()
        {
            let taken = &mut *taken;
            self.control_block.take_up(host, &mut taken.raw);
            taken.visits.push((taken.raw.len(), at_ns));
        }
        while let Some((from_ns, bytes)) = self.script.commands.get(self.next_command) {
            if at_ns < *from_ns {
                break;
            }
            let rest = bytes.get(self.sent_of_command..).unwrap_or(&[]);
            self.sent_of_command += self.control_block.put_down(host, rest).unwrap_or(0);
            if self.sent_of_command < bytes.len() {
                break;
            }
            self.next_command += 1;
            self.sent_of_command = 0;
        }
    }
}

impl Driver<NucleoBoard> for Probe {
    fn on_stop(&mut self, _: &mut Session<NucleoBoard>, stop: Stop, host: &mut dyn Host) -> Option<VirtualNanos> {
        self.serve(stop.at.0, host);
        if stop.at.0 >= self.script.until_ns {
            return None;
        }
        let period = self.script.read_every_ns.unwrap_or(MILLISECOND);
        Some(VirtualNanos(stop.at.0.saturating_add(period).min(self.script.until_ns)))
    }
}

/// Runs the image on the board.
///
/// # Errors
/// The image cannot be read or placed, has no RTT control block or defmt table, or the emulated part refused something.
pub fn run(elf: &Path, board: NucleoBoard, script: Script) -> Result<Outcome> {
    let bytes = std::fs::read(elf).with_context(|| format!("{}", elf.display()))?;
    let file = object::File::parse(&*bytes)?;
    let control_block = file
        .symbols()
        .find(|symbol| symbol.name() == Ok("_SEGGER_RTT"))
        .map(|symbol| ControlBlock::at(symbol.address()))
        .ok_or_else(|| anyhow!("{}: no symbol _SEGGER_RTT", elf.display()))?;
    let table = Table::parse(&bytes)?.ok_or_else(|| anyhow!("{}: no .defmt section", elf.display()))?;

    let mut images = vec![Image::read(elf, None)?];
    if let Some(block) = &script.block {
        images.push(Image::new(Path::new("parameter block"), block.clone(), Some(SETTINGS))?);
    }
    let first = script.read_every_ns.unwrap_or(MILLISECOND).min(script.until_ns);
    let session = Session::new(Box::new(board), 0, VirtualNanos(first))?;
    let taken = Arc::new(Mutex::new(Taken::default()));
    let probe = Probe { script, control_block, next_command: 0, sent_of_command: 0, taken: Arc::clone(&taken) };
    let mut finished = emulate(session, &Start::new(&images), probe)?;
    if let Some(error) = finished.session.take_error() {
        return Err(error.into());
    }
    let end = finished.stop.map_or((0, 0), |stop| (stop.at.0, stop.instruction_count));
    let resets = finished.session.resets().len();
    let without_model = finished.session.unimplemented().values().map(|seen| format!("{}.{}", seen.instance, seen.register)).collect();
    let unmapped: Vec<String> = finished.session.unmapped().iter().map(ToString::to_string).collect();
    if !unmapped.is_empty() {
        bail!("the image touched addresses that the part does not have: {}", unmapped.join("; "));
    }
    let taken = std::mem::take(&mut *taken.lock().map_err(|_| anyhow!("the probe died"))?);
    let (messages, malformed) = decode(&table, &taken)?;
    let board = std::mem::replace(finished.session.board_mut(), NucleoBoard::new()?);
    Ok(Outcome { board: Box::new(board), raw: taken.raw, messages, malformed, end, resets, without_model })
}

fn decode(table: &Table, taken: &Taken) -> Result<(Vec<Message>, u32)> {
    let mut decoder = table.new_stream_decoder();
    let (mut messages, mut malformed, mut from) = (Vec::new(), 0, 0);
    for &(until, at_ns) in &taken.visits {
        decoder.received(taken.raw.get(from..until).unwrap_or(&[]));
        from = until;
        loop {
            match decoder.decode() {
                Ok(frame) => messages.push(Message {
                    at_ns,
                    level: frame.level().map_or(String::new(), |level| level.as_str().to_string()),
                    text: frame.display_message().to_string(),
                }),
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) if table.encoding().can_recover() => malformed += 1,
                Err(DecodeError::Malformed) => bail!("a log frame is malformed and the encoding cannot recover"),
            }
        }
    }
    Ok((messages, malformed))
}
