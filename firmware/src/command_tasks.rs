//! The tasks that take lines of text from the probe, obey them, and say what changes.

use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::signal::Signal;
use hysteron_core::amplifier::Status;
use hysteron_core::amplifier_command::{Command, Refusal};
use hysteron_core::command_lines::{CommandLines, LINE_BYTES, WaitingLine};
use hysteron_core::command_schedule::CannotWait;
use hysteron_core::command_text::{Line, parse};
use hysteron_core::guard::Fault;
use hysteron_core::trace_frame::Channels;
use rtt_target::DownChannel;

use crate::board::SAMPLE_RATE_HZ;
use crate::control::{self, COMMAND_QUEUE, Outcome, Reply, Source};
use crate::ring::Consumer;
use crate::{
    command_port, event_log, option_bytes, recorder, serial_port, settings, stack, task_clock,
    telemetry, temperature, trace_tasks, update, update_state,
};

/// Reads lines from the probe. All that has come is looked at for a stop before any other line is obeyed.
#[embassy_executor::task]
pub async fn commands(mut channel: DownChannel) {
    let mut lines = CommandLines::new();
    loop {
        task_clock::next().await;
        let mut bytes = [0; 64];
        loop {
            let read = channel.read(&mut bytes);
            if read == 0 {
                break;
            }
            let before = lines.waiting();
            let received = lines.receive(bytes.get(..read).unwrap_or(&[]));
            if lines.waiting() > before || received.stop || received.no_room > 0 {
                control::hear_host();
            }
            if received.stop {
                command_port::stop();
            }
            if received.too_long > 0 {
                defmt::warn!("refused: a line is longer than {=usize} bytes", LINE_BYTES);
            }
            if received.no_room > 0 {
                defmt::warn!("refused: {=u32} lines, too many wait", received.no_room);
            }
        }
        while command_port::has_room()
            && let Some(line) = lines.next()
        {
            obey(&line);
        }
    }
}

/// Says what became of commands, and what the amplifier does, whenever it changes.
#[embassy_executor::task]
pub async fn reports(mut replies: Consumer<Reply, COMMAND_QUEUE>) {
    let mut status = None;
    let mut captured = false;
    loop {
        task_clock::next().await;
        while let Some(reply) = replies.dequeue() {
            match reply.from {
                Source::Probe => say_outcome(&reply),
                Source::Serial => serial_port::take(reply),
            }
        }
        let full = recorder::state() == recorder::State::Full;
        if full && !captured {
            defmt::info!("capture is complete: `capture send` reads it out");
        }
        captured = full;
        let now = control::status();
        if status.replace(now) != Some(now) {
            say_status(now);
        }
    }
}

fn say_outcome(reply: &Reply) {
    match reply.outcome {
        Outcome::Done => defmt::info!("done at tick {=u32}", reply.tick),
        Outcome::Refused(Refusal::BeyondLimits) => {
            let ((lowest_nm, highest_nm), (lowest_mv, highest_mv)) = telemetry::limits();
            defmt::warn!(
                "refused at tick {=u32}: beyond the limits, {=i32} to {=i32} nm and {=i32} to {=i32} mV",
                reply.tick,
                lowest_nm,
                highest_nm,
                lowest_mv,
                highest_mv
            );
        }
        Outcome::Refused(refusal) => defmt::warn!(
            "refused at tick {=u32}: {=str}",
            reply.tick,
            refusal_text(refusal)
        ),
        Outcome::CannotWait(reason) => defmt::warn!(
            "refused at tick {=u32}: {=str}",
            reply.tick,
            cannot_wait_text(reason)
        ),
        Outcome::Stopped(0) => defmt::info!("stopped at tick {=u32}", reply.tick),
        Outcome::Stopped(forgotten) => defmt::info!(
            "stopped at tick {=u32}, {=u32} waiting commands forgotten",
            reply.tick,
            forgotten
        ),
    }
}

fn refusal_text(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::Faulted => "a fault is latched",
        Refusal::NotYetHealthy => "the sensor has not been healthy long enough",
        Refusal::NotAtRest => "only at rest",
        Refusal::NoBlock => {
            "no valid parameter block or no safety envelope: bring one, then `restart`"
        }
        Refusal::NotTested => "neither a self-test nor a conditioning has tried the stage: `arm`",
        Refusal::NotArmed => "not armed since the start or the last fault: `arm`",
        Refusal::LoopOpen => "only with the loop closed",
        Refusal::NotConditioned => {
            "not conditioned since the start or the last fault: `condition`, or `conditioning waived`"
        }
        Refusal::BeyondLimits => "beyond the limits",
        Refusal::NoInput => "no analogue set point is wired",
        Refusal::OtherDrive => "the block in use is for another kind of drive",
    }
}

fn cannot_wait_text(reason: CannotWait) -> &'static str {
    match reason {
        CannotWait::NoRoom => "too many commands wait for their ticks",
        CannotWait::TooFarAhead => "the tick is hours away",
    }
}

fn say_status(status: Status) {
    let mode = status.mode.name();
    match status.fault {
        None => defmt::info!("mode {=str}", mode),
        Some(fault) => defmt::error!("mode {=str}: {=str}", mode, fault.name()),
    }
}

/// Says the last faults, the newest first.
fn say_events() {
    for event in (0..).map_while(event_log::event) {
        let name = Fault::from_number(event.fault as u8).map_or("", Fault::name);
        defmt::info!(
            "fault in start {=u32} of {=u32} at tick {=u32}: {=str}",
            event.start,
            event_log::starts(),
            event.tick,
            name
        );
    }
}

/// Says whether something was done.
fn answer(what: &'static str, result: Result<(), &'static str>) {
    match result {
        Ok(()) => defmt::info!("{=str}", what),
        Err(reason) => defmt::warn!("refused: {=str}", reason),
    }
}

/// Somebody asked for the option bytes to be written.
static PROTECT: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// Writes the option bytes when it is asked to.
#[embassy_executor::task]
pub async fn protector() {
    loop {
        PROTECT.wait().await;
        answer(
            "option bytes written: take the supply off and on again",
            option_bytes::protect().await,
        );
    }
}

fn drive_rests() -> Result<(), &'static str> {
    if control::drive_rests() {
        Ok(())
    } else {
        Err("only at rest")
    }
}

fn submit(at: Option<u32>, command: Command) {
    if !command_port::submit(Source::Probe, at, command) {
        defmt::warn!("refused: too many commands wait");
    }
}

fn obey(line: &WaitingLine) {
    let Ok(text) = core::str::from_utf8(&line.bytes) else {
        defmt::warn!("refused: not text");
        return;
    };
    match parse(text, SAMPLE_RATE_HZ) {
        Ok(Line::Control(..) | Line::Identify(_)) if line.before_stop => {
            defmt::info!("forgotten: {=str}", text)
        }
        Ok(Line::Control(at, command)) => submit(at, command),
        Ok(Line::Trace(channels, decimation)) => trace_tasks::choose(channels, decimation),
        Ok(Line::Identify(ticks)) => {
            trace_tasks::choose(Channels(Channels::CODES.0 | Channels::FLAGS.0), 1);
            submit(None, Command::Identify { ticks });
        }
        Ok(Line::Status) => {
            let (used, size) = stack::high_water_bytes();
            defmt::info!("status {}", control::report());
            defmt::info!("stack {=u32} of {=u32} bytes", used, size);
            let (railed, limited) = telemetry::railed_and_limited_ticks();
            defmt::info!(
                "sensor railed in {=u32} ticks, drive limited in {=u32}, {=u32} values cut",
                railed,
                limited,
                control::saturated_values()
            );
            let (generation, fingerprint) = settings::in_use();
            defmt::info!(
                "block generation {=u32}, content {=u32:#010x}",
                generation,
                fingerprint
            );
            let (conditioned, required) = control::conditioning();
            defmt::info!(
                "conditioned: {=bool}, required: {=bool}; host timeout {=u32} ticks",
                conditioned,
                required,
                control::host_timeout()
            );
            defmt::info!(
                "powered: {=bool}, armed: {=bool}",
                control::powered(),
                control::state().armed
            );
            if let Some(now) = temperature::decicelsius() {
                defmt::info!("part at {=i32} tenths of a degree Celsius", now);
            }
            say_events();
            telemetry::say_loop();
            option_bytes::say();
        }
        Ok(Line::HostTimeout(ticks)) => {
            control::set_host_timeout(ticks);
            defmt::info!("host timeout {=u32} ticks", ticks);
        }
        Ok(Line::Resonance(watch)) => answer("resonance is listened to", telemetry::listen(watch)),
        Ok(Line::Protect) => match drive_rests() {
            Ok(()) => PROTECT.signal(()),
            Err(reason) => defmt::warn!("refused: {=str}", reason),
        },
        Ok(Line::UpdateOlder) => answer(
            "an image of a lower version may come until the restart",
            update::let_older_come(),
        ),
        Ok(Line::Capture(trigger, before, after)) => {
            answer("capture is armed", recorder::arm(trigger, before, after))
        }
        Ok(Line::CaptureSend) => answer("capture follows", trace_tasks::begin_read_out()),
        Ok(Line::CaptureOff) => {
            trace_tasks::forget_capture();
            defmt::info!("capture is off");
        }
        Ok(Line::BlockBegin(length)) => answer("block begins", settings::begin(length)),
        Ok(Line::BlockData(piece)) => {
            if let Err(reason) = settings::take(&piece) {
                defmt::warn!(
                    "refused: block at byte {=usize}: {=str}",
                    piece.offset(),
                    reason
                );
            }
        }
        Ok(Line::BlockCommit) => {
            if let Err(reason) = settings::keep() {
                defmt::warn!("refused: block: {=str}", reason);
            }
        }
        Ok(Line::BlockEnvelope(fingerprint)) => answer(
            "safety envelope is being kept",
            settings::keep_envelope(fingerprint),
        ),
        Ok(Line::BlockSwap) => settings::swap(),
        Ok(Line::Restart) if settings::is_keeping() || update_state::is_busy() => {
            defmt::warn!("refused: the flash is being written")
        }
        Ok(Line::Restart) => match drive_rests() {
            Ok(()) => cortex_m::peripheral::SCB::sys_reset(),
            Err(reason) => defmt::warn!("refused: {=str}", reason),
        },
        Err(expected) => defmt::warn!("refused: {=str}", expected),
    }
}
