//! The tasks below the control interrupt: trace and commands.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_time::{Duration, Ticker};
use hysteron_core::command_text::{Line, parse};
use hysteron_core::guard::Fault;
use hysteron_core::trace_frame::{Channels, TraceBlock, TraceSample};
use rtt_target::DownChannel;

use crate::control::{self, COMMAND_QUEUE, Reply, SAMPLE_QUEUE, Scheduled};
use crate::ring::{Consumer, Producer};
use crate::sample_clock::SAMPLE_RATE_HZ;
use crate::stack;

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
        while let Some(sample) = samples.dequeue() {
            block.push(&sample, lost, &mut send);
        }
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
    loop {
        ticker.next().await;
        let mut bytes = [0; 64];
        let read = channel.read(&mut bytes);
        for byte in bytes.iter().take(read) {
            if *byte == b'\n' || *byte == b'\r' {
                if !line.is_empty() {
                    obey(&line, &mut queue);
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

fn obey(line: &[u8], queue: &mut Producer<Scheduled, COMMAND_QUEUE>) {
    let Ok(text) = core::str::from_utf8(line) else {
        defmt::warn!("refused: not text");
        return;
    };
    match parse(text, SAMPLE_RATE_HZ) {
        Ok(Line::Control(at, command)) => {
            if !queue.enqueue(Scheduled { at, command }) {
                defmt::warn!("refused: too many commands wait");
            }
        }
        Ok(Line::Trace(channels, decimation)) => {
            TRACE.store(u32::from(channels.0) | (u32::from(decimation) << 16), Ordering::Relaxed);
            defmt::info!("trace channels {=u8} decimation {=u16}", channels.0, decimation);
        }
        Ok(Line::Status) => {
            let (used, size) = stack::high_water_bytes();
            defmt::info!("status {}", control::report());
            defmt::info!("stack {=u32} of {=u32} bytes", used, size);
        }
        Err(expected) => defmt::warn!("refused: {=str}", expected),
    }
}
