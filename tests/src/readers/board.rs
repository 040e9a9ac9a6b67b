//! What a board reads: blocks, settings, envelopes and lines. A trace is what it writes.

use super::shared::{Target, loops_and_mode, target, text};
use hysteron::servo::amplifier_block::{
    FrontEnd, amplifier_parameters, block, read_block, upload_lines,
};
use hysteron::servo::order::{DesignOrder, design};
use hysteron_core::amplifier::Amplifier;
use hysteron_core::amplifier_command::Command;
use hysteron_core::checksum::crc32;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_lines::CommandLines;
use hysteron_core::command_text::{self, Line};
use hysteron_core::filter_design::{FilterSetting, Notch};
use hysteron_core::kept_settings::{self, KeptSettings};
use hysteron_core::loop_telemetry::ResonanceWatch;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::safety_envelope::{self, SafetyEnvelope};
use hysteron_core::signal_filter::{FilteredSignal, Place};
use hysteron_core::trace_frame::{Channels, ReadBlock, TraceBlock, TraceSample};
use std::sync::LazyLock;

const SAMPLE_RATE_HZ: u32 = 20_000;

pub(super) fn targets() -> Vec<Target> {
    let one = |bytes: Vec<u8>| vec![("bytes".to_owned(), bytes)];
    let parameters = block(&PARAMETERS).expect("bytes");
    let envelope = written(|bytes| safety_envelope::write(&SafetyEnvelope::EXAMPLE, bytes));
    vec![
        target("parameter blocks", one(parameters), read_parameters),
        target("traces", one(trace()), read_trace),
        target("lines of the serial port", text("lines", LINES), read_lines),
        target("kept settings", one(settings()), read_settings),
        target("safety envelopes", one(envelope), read_envelope),
    ]
}

fn trace() -> Vec<u8> {
    let mut block = TraceBlock::new(Channels::ALL, 1);
    let mut bytes = Vec::new();
    for tick in 0..16 {
        let sample = TraceSample {
            tick,
            ..TraceSample::default()
        };
        block.push(&sample, 0, |sent| bytes.extend_from_slice(sent));
    }
    block.finish(&mut |sent: &[u8]| bytes.extend_from_slice(sent));
    bytes
}

fn settings() -> Vec<u8> {
    let notch = Notch {
        frequency_millihertz: 850_000,
        width_millihertz: 0,
    };
    let filter = FilterSetting {
        notches: [notch, Notch::OFF],
        low_pass_millihertz: 2_000_000,
    };
    let settings = KeptSettings {
        stage: *b"p753\0\0\0\0\0\0\0\0\0\0\0\0",
        velocity: 100 << 24,
        tolerance: 1 << 20,
        settling_us: 2_000,
        host_timeout_ms: 500,
        largest_move: 0,
        largest_drive_step: 0,
        baud: 115_200,
        watch: ResonanceWatch::default(),
        filters: [filter, FilterSetting::OFF],
    };
    written(|bytes| kept_settings::write(&settings, bytes))
}

fn written<E: std::fmt::Debug>(write: impl Fn(&mut [u8]) -> Result<usize, E>) -> Vec<u8> {
    let mut bytes = vec![0; 256];
    let length = write(&mut bytes).expect("room");
    bytes.truncate(length);
    bytes
}

const LINES: &str = "arm untested
conditioning waived
enable
reference sine 5000 2000 5000
@40 reference step 500 10 100
status
stop
play chirp 1000 100000 20000 40000 200
trace 17 4
capture fault 100 100
resonance 850000 200
block data 32 00ff17
timeout 500
disarm
";

/// With a right checksum at the end: without it no damage would reach what is behind the check.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    let mut sealed = bytes.to_vec();
    if let Some(end) = sealed.len().checked_sub(4) {
        let sum = crc32(&sealed[..end]).to_le_bytes();
        sealed[end..].copy_from_slice(&sum);
    }
    sealed
}

/// A block that is accepted runs.
fn read_parameters(_: &str, bytes: &[u8]) -> bool {
    let sealed = sealed(bytes);
    let _ = (read_block(bytes), upload_lines(bytes));
    let Ok(parameters) = read_block(&sealed) else {
        return false;
    };
    run(Amplifier::new(parameters));
    true
}

/// Some ticks with readings from end to end.
pub(super) fn run(mut amplifier: Amplifier) {
    for command in [Command::Arm { tested: true }, Command::Enable] {
        let _ = amplifier.command(command);
    }
    tick(&mut amplifier, 400);
}

fn tick(amplifier: &mut Amplifier, ticks: u32) {
    for tick in 0..ticks {
        let reading = SensorCode::new(tick.wrapping_mul(40_503) & 0xffff);
        let _ = amplifier.tick((tick % 50 != 49).then_some(reading), false);
    }
}

/// The parameters of a stage that nothing is known of but loops and a mode.
fn parameters() -> AmplifierParameters {
    let servo = design(&loops_and_mode(0.6), &DesignOrder::default()).expect("a servo");
    amplifier_parameters(&servo, &FrontEnd::default()).expect("a block")
}

/// One amplifier for all inputs: its design takes longer than what reads.
static PARAMETERS: LazyLock<AmplifierParameters> = LazyLock::new(parameters);

/// Lines go through the store of lines that have come; an amplifier takes the commands, and runs.
fn read_lines(_: &str, bytes: &[u8]) -> bool {
    let (mut lines, mut amplifier) = (CommandLines::new(), Amplifier::new(*PARAMETERS));
    let (mut found, mut understood) = (0, 0);
    for piece in bytes.chunks(64) {
        if lines.receive(piece).stop {
            let _ = amplifier.command(Command::Disable);
        }
        while let Some(line) = lines.next() {
            let text = std::str::from_utf8(&line.bytes);
            let meant = text.map(|line| command_text::parse(line, SAMPLE_RATE_HZ));
            if let Ok(Ok(Line::Control(_, command))) = meant {
                let _ = amplifier.command(command);
            }
            found += 1;
            understood += u32::from(matches!(meant, Ok(Ok(_))));
            tick(&mut amplifier, 20);
        }
    }
    found > 0 && found == understood
}

/// Settings that are accepted: the amplifier runs with their filters.
fn read_settings(_: &str, bytes: &[u8]) -> bool {
    let Ok(settings) = kept_settings::read(&sealed(bytes), SAMPLE_RATE_HZ) else {
        return false;
    };
    let mut amplifier = Amplifier::new(*PARAMETERS);
    for (signal, filter) in [FilteredSignal::SetPoint, FilteredSignal::Sensor]
        .into_iter()
        .zip(settings.filters)
    {
        for place in Place::ALL {
            let row = filter
                .row(place, SAMPLE_RATE_HZ)
                .expect("a filter that was accepted");
            amplifier
                .command(Command::Filter { signal, place, row })
                .expect("filters change in any mode");
        }
    }
    run(amplifier);
    true
}

/// An envelope that is accepted answers whatever it is asked.
fn read_envelope(_: &str, bytes: &[u8]) -> bool {
    let Ok(envelope) = safety_envelope::read(&sealed(bytes)) else {
        return false;
    };
    let _ = (envelope.monitor(SAMPLE_RATE_HZ), envelope.set_point());
    let _ = envelope.admits(&PARAMETERS);
    for code in [0, 1, 1 << 15, u16::MAX] {
        let _ = (
            envelope.amplifier_decicelsius(code),
            envelope.amplifier_is_too_hot(Some(code)),
            envelope.of_block(DriveCode::new(code.into()), 16),
        );
    }
    let _ = (
        envelope.linearisation(16),
        envelope.mean_square_codes(&PARAMETERS),
        envelope.slew_codes(&PARAMETERS),
    );
    true
}

fn read_trace(_: &str, bytes: &[u8]) -> bool {
    let sealed = sealed(bytes);
    let _ = hysteron::capture::capture(bytes, bytes);
    ReadBlock::read(&sealed).is_ok_and(|block| block.samples().count() > 0)
}
