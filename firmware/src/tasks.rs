//! The tasks below the control interrupt: trace and commands.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use embassy_time::{Duration, Ticker, Timer};
use hysteron_core::amplifier::{Command, Mode};
use hysteron_core::command_text::{Line, parse};
use hysteron_core::guard::Fault;
use hysteron_core::trace_frame::{BLOCK_SAMPLES, Channels, TraceBlock, TraceSample};
use rtt_target::DownChannel;

use crate::control::{self, COMMAND_QUEUE, Reply, SAMPLE_QUEUE, Scheduled};
use crate::ring::{Consumer, Producer};
use crate::sample_clock::SAMPLE_RATE_HZ;
use crate::settings::Upload;
use crate::{log_channel, recorder, stack};

/// Channels (low byte) and decimation (upper half) of the trace.
static TRACE: AtomicU32 = AtomicU32::new(Channels::ALL.0 as u32 | (20 << 16));

const LINE_BYTES: usize = 96;

/// Packs samples into blocks and logs them.
#[embassy_executor::task]
pub async fn trace(mut samples: Consumer<TraceSample, SAMPLE_QUEUE>) {
    let mut ticker = Ticker::every(Duration::from_millis(1));
    let mut choice = TRACE.load(Ordering::Relaxed);
    let mut block = block_for(choice);
    let mut send = |bytes: &[u8]| defmt::info!("trace {=[u8]}", bytes);
    loop {
        ticker.next().await;
        let wanted = TRACE.load(Ordering::Relaxed);
        if wanted != choice {
            block.finish(&mut send);
            choice = wanted;
            block = block_for(choice);
        }
        let lost = control::lost_samples();
        let reading_out = READING_OUT.load(Ordering::Relaxed);
        while let Some(sample) = samples.dequeue() {
            // The channel is the capture's while it is read out.
            if !reading_out {
                block.push(&sample, lost, &mut send);
            }
        }
        if reading_out {
            block.finish(&mut send);
            block = block_for(choice);
        }
    }
}

/// Room in the log's channel that a block of the capture and what else is said meanwhile need, bytes.
const BLOCK_ROOM_BYTES: u32 = 2048;

/// Whether the log's channel belongs to the capture.
static READING_OUT: AtomicBool = AtomicBool::new(false);

/// Reads a capture out, block by block, as fast as the reader makes room and no faster: nothing of it is ever lost.
#[embassy_executor::task]
pub async fn read_out() {
    let mut send = |bytes: &[u8]| defmt::info!("trace {=[u8]}", bytes);
    loop {
        Timer::after_millis(1).await;
        if !READING_OUT.load(Ordering::Relaxed) {
            continue;
        }
        let mut block = TraceBlock::new(Channels::ALL, 1);
        let mut nth = 0;
        while READING_OUT.load(Ordering::Relaxed)
            && let Some(sample) = recorder::sample(nth)
        {
            while (nth as usize).is_multiple_of(BLOCK_SAMPLES) && log_channel::free_bytes() < BLOCK_ROOM_BYTES {
                Timer::after_millis(1).await;
            }
            block.push(&sample, 0, &mut send);
            nth += 1;
        }
        block.finish(&mut send);
        defmt::info!("capture: {=u32} ticks read out", nth);
        READING_OUT.store(false, Ordering::Relaxed);
    }
}

fn block_for(choice: u32) -> TraceBlock {
    TraceBlock::new(Channels(choice as u8), (choice >> 16) as u16)
}

/// Reads lines from the probe and reports what changes.
#[embassy_executor::task]
pub async fn commands(
    mut channel: DownChannel,
    mut queue: Producer<Scheduled, COMMAND_QUEUE>,
    mut replies: Consumer<Reply, COMMAND_QUEUE>,
) {
    let mut ticker = Ticker::every(Duration::from_millis(1));
    let mut line = heapless::Vec::<u8, LINE_BYTES>::new();
    let mut flags = u32::MAX;
    let mut captured = false;
    let mut upload = Upload::new();
    loop {
        ticker.next().await;
        let mut bytes = [0; 64];
        let read = channel.read(&mut bytes);
        for byte in bytes.iter().take(read) {
            if *byte == b'\n' || *byte == b'\r' {
                if !line.is_empty() {
                    obey(&line, &mut queue, &mut upload).await;
                    line.clear();
                }
            } else if line.push(*byte).is_err() {
                defmt::warn!("refused: a line is longer than {=usize} bytes", LINE_BYTES);
                line.clear();
            }
        }
        while let Some(reply) = replies.dequeue() {
            match reply.refusal {
                None => defmt::info!("done at tick {=u32}", reply.tick),
                Some(refusal) => defmt::warn!("refused at tick {=u32}: {=str}", reply.tick, reason(refusal)),
            }
        }
        let full = recorder::state() == recorder::State::Full;
        if full && !captured {
            defmt::info!("capture is complete: `capture send` reads it out");
        }
        captured = full;
        let now = control::flags();
        if now != flags {
            flags = now;
            say_mode(flags);
        }
    }
}

fn reason(refusal: hysteron_core::amplifier::Refusal) -> &'static str {
    use hysteron_core::amplifier::Refusal;
    match refusal {
        Refusal::Faulted => "a fault is latched",
        Refusal::NotYetHealthy => "the sensor has not been healthy long enough",
        Refusal::NotAtRest => "only at rest",
    }
}

fn say_mode(flags: u32) {
    let mode = match flags as u8 {
        0 => "rest",
        1 => "playing",
        2 => "closed",
        _ => "fault",
    };
    match Fault::from_number((flags >> 8) as u8) {
        None => defmt::info!("mode {=str}", mode),
        Some(fault) => defmt::error!("mode {=str}: {=str}", mode, fault.name()),
    }
}

/// Says whether something was done.
fn answer(what: &'static str, result: Result<(), &'static str>) {
    match result {
        Ok(()) => defmt::info!("{=str}", what),
        Err(reason) => defmt::warn!("refused: {=str}", reason),
    }
}

/// At rest or stopped by a fault: the drive does not move.
fn drive_rests() -> Result<(), &'static str> {
    let mode = control::flags() as u8;
    if mode == Mode::Rest as u8 || mode == Mode::Fault as u8 { Ok(()) } else { Err("only at rest") }
}

fn enqueue(queue: &mut Producer<Scheduled, COMMAND_QUEUE>, at: Option<u32>, command: Command) {
    if !queue.enqueue(Scheduled { at, command }) {
        defmt::warn!("refused: too many commands wait");
    }
}

fn choose_trace(channels: Channels, decimation: u16) {
    TRACE.store(u32::from(channels.0) | (u32::from(decimation) << 16), Ordering::Relaxed);
    defmt::info!("trace channels {=u8} decimation {=u16}", channels.0, decimation);
}

async fn obey(line: &[u8], queue: &mut Producer<Scheduled, COMMAND_QUEUE>, upload: &mut Upload) {
    let Ok(text) = core::str::from_utf8(line) else {
        defmt::warn!("refused: not text");
        return;
    };
    match parse(text, SAMPLE_RATE_HZ) {
        Ok(Line::Control(at, command)) => enqueue(queue, at, command),
        Ok(Line::Trace(channels, decimation)) => choose_trace(channels, decimation),
        Ok(Line::Identify(ticks)) => {
            choose_trace(Channels(Channels::CODES.0 | Channels::FLAGS.0), 1);
            enqueue(queue, None, Command::Identify { ticks });
        }
        Ok(Line::Status) => {
            let (used, size) = stack::high_water_bytes();
            defmt::info!("status {}", control::report());
            defmt::info!("stack {=u32} of {=u32} bytes", used, size);
        }
        Ok(Line::Capture(trigger, before, after)) => answer("capture is armed", recorder::arm(trigger, before, after)),
        Ok(Line::CaptureSend) => {
            let full = recorder::state() == recorder::State::Full;
            READING_OUT.store(full, Ordering::Relaxed);
            answer("capture follows", if full { Ok(()) } else { Err("there is no complete capture") });
        }
        Ok(Line::CaptureOff) => {
            READING_OUT.store(false, Ordering::Relaxed);
            recorder::disarm();
            defmt::info!("capture is off");
        }
        Ok(Line::BlockBegin(length)) => answer("block begins", upload.begin(length)),
        Ok(Line::BlockData(piece)) => {
            if let Err(reason) = upload.take(&piece) {
                defmt::warn!("refused: block at byte {=usize}: {=str}", piece.offset(), reason);
            }
        }
        Ok(Line::BlockCommit) => match keep(upload).await {
            Ok(name) => defmt::info!("block kept as {=str}: `restart` takes it", name),
            Err(reason) => defmt::warn!("refused: block: {=str}", reason),
        },
        Ok(Line::Restart) => match drive_rests() {
            Ok(()) => cortex_m::peripheral::SCB::sys_reset(),
            Err(reason) => defmt::warn!("refused: {=str}", reason),
        },
        Err(expected) => defmt::warn!("refused: {=str}", expected),
    }
}

async fn keep(upload: &mut Upload) -> Result<&'static str, &'static str> {
    drive_rests()?;
    upload.commit(SAMPLE_RATE_HZ).await
}
