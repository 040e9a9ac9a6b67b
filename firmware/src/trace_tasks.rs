//! The tasks that log samples: the running trace, and a capture that is read out.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use hysteron_core::trace_frame::{BLOCK_SAMPLES, Channels, PackedSample, TraceBlock};

use crate::control::{self, SAMPLE_QUEUE};
use crate::ring::Consumer;
use crate::{log_channel, recorder, task_clock, telemetry};

/// Channels (low byte) and decimation (upper half) of the trace.
static TRACE: AtomicU32 = AtomicU32::new(Channels::ALL.0 as u32 | (20 << 16));

/// Chooses what is traced, and every how many ticks.
pub fn choose(channels: Channels, decimation: u16) {
    TRACE.store(
        u32::from(channels.0) | (u32::from(decimation) << 16),
        Ordering::Relaxed,
    );
    defmt::info!(
        "trace channels {=u8} decimation {=u16}",
        channels.0,
        decimation
    );
}

/// Begins to read a complete capture out.
pub fn begin_read_out() -> Result<(), &'static str> {
    let full = recorder::state() == recorder::State::Full;
    READING_OUT.store(full, Ordering::Relaxed);
    if full {
        Ok(())
    } else {
        Err("there is no complete capture")
    }
}

/// Forgets the capture, armed or complete.
pub fn forget_capture() {
    READING_OUT.store(false, Ordering::Relaxed);
    recorder::disarm();
}

/// Packs samples into blocks and logs them.
#[embassy_executor::task]
pub async fn trace(mut samples: Consumer<PackedSample, SAMPLE_QUEUE>) {
    let mut choice = TRACE.load(Ordering::Relaxed);
    let mut block = block_for(choice);
    let mut send = |bytes: &[u8]| defmt::info!("trace {=[u8]}", bytes);
    loop {
        task_clock::next().await;
        let wanted = TRACE.load(Ordering::Relaxed);
        if wanted != choice {
            block.finish(&mut send);
            choice = wanted;
            block = block_for(choice);
        }
        let lost = control::lost_samples();
        let reading_out = READING_OUT.load(Ordering::Relaxed);
        while let Some(sample) = samples.dequeue() {
            let sample = sample.unpacked();
            telemetry::observe(&sample);
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

/// Room in the log's channel that a block of the capture and other messages meanwhile need, bytes.
const BLOCK_ROOM_BYTES: u32 = 2048;

/// Whether the log's channel belongs to the capture.
static READING_OUT: AtomicBool = AtomicBool::new(false);

/// Reads a capture out, block by block, as fast as the reader makes room and no faster: nothing of it is ever
/// lost.
#[embassy_executor::task]
pub async fn read_out() {
    let mut send = |bytes: &[u8]| defmt::info!("trace {=[u8]}", bytes);
    loop {
        task_clock::next().await;
        if !READING_OUT.load(Ordering::Relaxed) {
            continue;
        }
        let mut block = TraceBlock::new(Channels::ALL, 1);
        let mut nth = 0;
        while READING_OUT.load(Ordering::Relaxed)
            && let Some(sample) = recorder::sample(nth)
        {
            while (nth as usize).is_multiple_of(BLOCK_SAMPLES)
                && log_channel::free_bytes() < BLOCK_ROOM_BYTES
            {
                task_clock::next().await;
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
