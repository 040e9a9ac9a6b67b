//! The checks of a board that need no instrument: `cargo run --release --bin board_check` with the drive's
//! converter wired to the sensor's.
//!
//! # How it works
//! The drive goes no further than the board's safety envelope ([`hysteron_core::safety_envelope`]) and no
//! faster than its slew limit; without an envelope, and while a safety line is open, nothing is driven. The
//! power stage's line stays low: the wire needs no amplifier. The watchdog is fed.
//!
//! The sample clock, the control interrupt's place and the front end are those of the firmware; the interrupt
//! here writes a pattern to the drive (constant, a step of one tick's slew, a ramp over three fifths of the
//! envelope) and stores what the sensor reads. Each check says its figure and whether it passes, and the
//! program ends with the number of checks that failed as its exit status, which `probe-rs run` hands on. The
//! same image runs on the emulated part, where a wire stands between the converters; what it says there is
//! function, not the timing or the noise of hardware.
//!
//! | check | figure | passes |
//! |---|---|---|
//! | period | mean of the interrupt's period, core cycles | the nominal one within 1 |
//! | jitter | largest less smallest period, core cycles | at most 1 us, of software; hardware times edges |
//! | silent | readings and writes that the converters did not answer | none |
//! | delay | ticks from a written step to its first reading | 2: acts at one edge, is sampled at the next |
//! | linearity | largest deviation from a line over a ramp, in thousandths of the span | at most 2 |
//! | noise | RMS of the readings at a constant drive, codes | at most 16 |
//! | flash | a sector that holds nothing is written and reads back | it does |
//! | bus error | a read beyond the flash, as of a damaged block | unreadable, and the program goes on |
#![no_std]
#![no_main]

use core::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use cortex_m::peripheral::DWT;
use embassy_executor::Spawner;
use embassy_stm32::pac::TIM2 as TIMER;
use embassy_time::Timer;
use hysteron_core::codes::DriveCode;
use hysteron_core::safety_envelope::{self, ENVELOPE_BYTES, SafetyEnvelope};
use hysteron_firmware::board::{self, Board, Converters, Platform, SAMPLE_RATE_HZ};
use hysteron_firmware::front_end::{FrontEnd, Wiring};
use hysteron_firmware::{safety_lines, sample_clock};
use hysteron_firmware_shared::flash_read;
use rtt_target::{ChannelMode, rtt_init};

/// Ticks of one experiment.
const TICKS: u32 = 4096;
/// The tick at which a step is written.
const STEP_AT: u32 = 64;
const COMPARE_4: u32 = 1 << 4;

#[derive(Clone, Copy, PartialEq)]
#[repr(u32)]
enum Pattern {
    Constant = 0,
    Step = 1,
    Ramp = 2,
    Rest = 3,
}

/// The pattern stays between the first and the last fifth of the envelope's range; the code of rest, and the
/// largest change in one tick.
static LOW: AtomicU32 = AtomicU32::new(0);
static HIGH: AtomicU32 = AtomicU32::new(0);
static REST: AtomicU32 = AtomicU32::new(0);
static SLEW: AtomicU32 = AtomicU32::new(0);
/// What was written last.
static WRITTEN: AtomicU32 = AtomicU32::new(0);
static PATTERN: AtomicU32 = AtomicU32::new(Pattern::Rest as u32);
/// The tick of the experiment; at [`TICKS`] it is over.
static TICK: AtomicU32 = AtomicU32::new(TICKS);
static READINGS: [AtomicU16; TICKS as usize] = [const { AtomicU16::new(0) }; TICKS as usize];
static LAST_CYCLES: AtomicU32 = AtomicU32::new(0);
static LEAST_PERIOD: AtomicU32 = AtomicU32::new(u32::MAX);
static MOST_PERIOD: AtomicU32 = AtomicU32::new(0);
static FIRST_CYCLES: AtomicU32 = AtomicU32::new(0);
static SILENT: AtomicU32 = AtomicU32::new(0);

fn wanted(pattern: u32, tick: u32) -> u32 {
    let (low, high) = (LOW.load(Ordering::Relaxed), HIGH.load(Ordering::Relaxed));
    match pattern {
        1 if tick >= STEP_AT => low + SLEW.load(Ordering::Relaxed),
        // Less than 2^20 codes times 2^12 ticks: within 32 bits.
        2 => low + (high - low) * tick.min(TICKS) / TICKS,
        3 => REST.load(Ordering::Relaxed),
        _ => low,
    }
}

/// The next code: towards the pattern, or to rest while a safety line is open.
fn next_code(pattern: u32, tick: u32) -> DriveCode {
    let pattern = if safety_lines::fault().is_some() {
        Pattern::Rest as u32
    } else {
        pattern
    };
    let (before, slew) = (
        WRITTEN.load(Ordering::Relaxed),
        SLEW.load(Ordering::Relaxed),
    );
    let next = wanted(pattern, tick)
        .max(before.saturating_sub(slew))
        .min(before + slew);
    WRITTEN.store(next, Ordering::Relaxed);
    DriveCode::new(next)
}

#[unsafe(no_mangle)]
#[unsafe(link_section = ".control_code")]
extern "C" fn TIM2() {
    let now = DWT::cycle_count();
    TIMER.sr().write(|w| w.0 = !COMPARE_4);
    let mut converters = Converters::new(Converters::BITS, Wiring::default());
    let reading = converters.read();
    let tick = TICK.load(Ordering::Relaxed);
    let mut silent = reading.is_none();
    // Before an experiment its first code.
    let at = if tick < TICKS { tick } else { 0 };
    silent |= !converters.write(next_code(PATTERN.load(Ordering::Relaxed), at));
    if tick >= TICKS {
        return;
    }
    if silent {
        SILENT.store(
            SILENT.load(Ordering::Relaxed).saturating_add(1),
            Ordering::Relaxed,
        );
    }
    if tick == 0 {
        FIRST_CYCLES.store(now, Ordering::Relaxed);
    } else {
        let period = now.wrapping_sub(LAST_CYCLES.load(Ordering::Relaxed));
        LEAST_PERIOD.store(
            LEAST_PERIOD.load(Ordering::Relaxed).min(period),
            Ordering::Relaxed,
        );
        MOST_PERIOD.store(
            MOST_PERIOD.load(Ordering::Relaxed).max(period),
            Ordering::Relaxed,
        );
    }
    LAST_CYCLES.store(now, Ordering::Relaxed);
    if let Some(slot) = READINGS.get(tick as usize) {
        slot.store(
            reading.map_or(0, |code| code.steps() as u16),
            Ordering::Relaxed,
        );
    }
    TICK.store(tick + 1, Ordering::Relaxed);
}

/// Runs a pattern and waits for its end, for a while.
async fn experiment(pattern: Pattern) {
    PATTERN.store(pattern as u32, Ordering::Relaxed);
    // The way to the first code of the pattern, however slow, and a while for it to settle.
    while WRITTEN.load(Ordering::Relaxed) != wanted(pattern as u32, 0) {
        if let Some(fault) = safety_lines::fault() {
            refuse(fault.name());
        }
        Timer::after_millis(1).await;
    }
    Timer::after_millis(20).await;
    TICK.store(0, Ordering::Relaxed);
    for _ in 0..1_000 {
        if TICK.load(Ordering::Relaxed) >= TICKS {
            return;
        }
        Timer::after_millis(1).await;
    }
}

fn reading(tick: u32) -> f32 {
    READINGS
        .get(tick as usize)
        .map_or(0.0, |slot| f32::from(slot.load(Ordering::Relaxed)))
}

/// Says a figure and counts what fails.
struct Verdict {
    failed: u32,
}

impl Verdict {
    fn say(&mut self, name: &str, figure: f32, unit: &str, passes: bool) {
        self.failed += u32::from(!passes);
        let verdict = if passes { "pass" } else { "FAIL" };
        defmt::info!(
            "check {=str}: {=f32} {=str}: {=str}",
            name,
            figure,
            unit,
            verdict
        );
    }
}

fn delay_ticks() -> f32 {
    let (before, after) = (reading(STEP_AT - 1), reading(STEP_AT + 40));
    let middle = (before + after) / 2.0;
    let shown = (STEP_AT..TICKS)
        .find(|tick| (reading(*tick) > middle) == (after > before) && after != before);
    shown.map_or(f32::INFINITY, |tick| (tick - STEP_AT) as f32)
}

/// Largest deviation of a ramp's readings from their line of least squares, in thousandths of their span.
fn deviation_thousandths() -> f32 {
    // The reading two ticks later shows the code; the beginning settles.
    let points = || (STEP_AT..TICKS).map(|tick| (tick as f32 / TICKS as f32 - 0.5, reading(tick)));
    let count = (TICKS - STEP_AT) as f32;
    let (mut x, mut y, mut xx, mut xy) = (0.0f32, 0.0f32, 0.0f32, 0.0f32);
    for (a, b) in points() {
        (x, y, xx, xy) = (
            x + a / count,
            y + b / count,
            xx + a * a / count,
            xy + a * b / count,
        );
    }
    let slope = (xy - x * y) / (xx - x * x);
    let largest = points()
        .map(|(a, b)| (b - y - slope * (a - x)).abs())
        .fold(0.0, f32::max);
    if slope == 0.0 {
        f32::INFINITY
    } else {
        1e3 * largest / slope.abs()
    }
}

fn noise_codes() -> f32 {
    let mean = (0..TICKS)
        .map(|tick| reading(tick) / TICKS as f32)
        .sum::<f32>();
    let square = (0..TICKS)
        .map(|tick| (reading(tick) - mean) * (reading(tick) - mean) / TICKS as f32)
        .sum::<f32>();
    // A square root without a library: Newton's, from above.
    (0..24).fold(square.max(1.0), |root, _| (root + square / root) / 2.0)
}

async fn flash_keeps() -> bool {
    let bytes: [u8; 96] = core::array::from_fn(|k| (k as u8).wrapping_mul(37) ^ 0x5A);
    if Board::write_sector(Board::SPARE_SECTOR, &bytes)
        .await
        .is_err()
    {
        return false;
    }
    let mut kept = [0; 96];
    flash_read::copy::<Board>(Board::SPARE_SECTOR, &mut kept).is_ok() && kept == bytes
}

/// Whether a read that ends in a bus error, as that of a word with a double ECC error does, leaves the
/// program running.
fn bus_error_survives() -> bool {
    let mut word = [0; 32];
    flash_read::copy::<Board>(Board::BEYOND_FLASH, &mut word)
        .is_err_and(|unreadable| unreadable.0 == Board::BEYOND_FLASH)
}

/// Says why nothing is driven, and ends.
fn refuse(reason: &str) -> ! {
    defmt::error!("board check: {=str}: nothing is driven", reason);
    Converters::new(Converters::BITS, Wiring::default())
        .force(DriveCode::new(REST.load(Ordering::Relaxed)));
    // The probe reads the log before the end.
    cortex_m::asm::delay(20_000_000);
    end(103)
}

/// The board's safety envelope.
fn envelope() -> Option<SafetyEnvelope> {
    let mut bytes = [0; ENVELOPE_BYTES];
    flash_read::copy::<Board>(Board::ENVELOPE, &mut bytes).ok()?;
    safety_envelope::read(&bytes)
        .ok()
        .filter(|envelope| envelope.dac_bits == Converters::BITS.dac)
}

/// Feeds the watchdog, which the option bytes may have started with the supply.
#[embassy_executor::task]
async fn feeder() {
    loop {
        board::feed_watchdog();
        Timer::after_millis(10).await;
    }
}

/// Ends the program with a status, by semihosting (SYS_EXIT_EXTENDED).
fn end(status: u32) -> ! {
    let arguments = [0x2_0026u32, status];
    loop {
        // SAFETY: the debugger reads two words; without one this is a hard fault, and the program has ended
        // all the same.
        unsafe { core::arch::asm!("bkpt 0xAB", in("r0") 0x20, in("r1") arguments.as_ptr()) };
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    end(101)
}

/// A lost crystal ends the program.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    if Board::cause_of_nmi().is_some() {
        end(102)
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let channels =
        rtt_init! { up: { 0: { size: 4096, mode: ChannelMode::NoBlockSkip, name: "defmt" } } };
    rtt_target::set_defmt_channel(channels.up.0);
    let peripherals = board::init(|_| {});
    let clocks = board::clocks(&peripherals);
    defmt::info!(
        "board check: core {=u32} Hz, front end {=str}",
        clocks.core_hz,
        Converters::NAME
    );
    if let Ok(feeder) = feeder() {
        spawner.spawn(feeder);
    }
    safety_lines::start();
    let Some(envelope) = envelope() else {
        refuse("no safety envelope")
    };
    if let Some(fault) = safety_lines::fault() {
        refuse(fault.name());
    }
    let fifth = envelope.drive_max.abs_diff(envelope.drive_min) / 5;
    let slew = (u64::from(envelope.slew_limit_v_s) * 1_000_000 / u64::from(SAMPLE_RATE_HZ))
        << envelope.dac_bits;
    for (place, code) in [
        (&LOW, (envelope.drive_min + fifth).steps()),
        (&HIGH, (envelope.drive_max - fifth).steps()),
        (&REST, envelope.safe_code.steps()),
        (&WRITTEN, envelope.safe_code.steps()),
        (&SLEW, (slew / u64::from(envelope.drive_span_uv)) as u32),
    ] {
        place.store(code, Ordering::Relaxed);
    }
    Converters::new(Converters::BITS, Wiring::of(&envelope)).start(Some(envelope.safe_code));
    sample_clock::start(clocks.timer_hz, Converters::INTERRUPT_AFTER_NS);

    let mut verdict = Verdict { failed: 0 };
    experiment(Pattern::Constant).await;
    let ticks = TICK.load(Ordering::Relaxed);
    let span = LAST_CYCLES
        .load(Ordering::Relaxed)
        .wrapping_sub(FIRST_CYCLES.load(Ordering::Relaxed));
    let period = span as f32 / ticks.saturating_sub(1).max(1) as f32;
    let nominal = clocks.core_hz as f32 / SAMPLE_RATE_HZ as f32;
    verdict.say("period", period, "cycles", (period - nominal).abs() <= 1.0);
    let jitter = MOST_PERIOD
        .load(Ordering::Relaxed)
        .wrapping_sub(LEAST_PERIOD.load(Ordering::Relaxed)) as f32;
    verdict.say(
        "jitter",
        jitter,
        "cycles",
        jitter <= clocks.core_hz as f32 / 1e6,
    );
    let noise = noise_codes();
    verdict.say("noise", noise, "codes RMS", noise <= 16.0);
    experiment(Pattern::Step).await;
    let delay = delay_ticks();
    verdict.say("delay", delay, "ticks", delay == 2.0);
    experiment(Pattern::Ramp).await;
    let deviation = deviation_thousandths();
    verdict.say(
        "linearity",
        deviation,
        "thousandths of the span",
        deviation <= 2.0,
    );
    PATTERN.store(Pattern::Rest as u32, Ordering::Relaxed);
    let silent = SILENT.load(Ordering::Relaxed);
    verdict.say("silent", silent as f32, "ticks", silent == 0);
    let keeps = flash_keeps().await;
    verdict.say("flash", f32::from(u8::from(keeps)), "of 1 sector", keeps);
    let survives = bus_error_survives();
    verdict.say(
        "bus error",
        f32::from(u8::from(survives)),
        "of 1 survived",
        survives,
    );
    defmt::info!("board check: {=u32} failed", verdict.failed);
    Converters::new(Converters::BITS, Wiring::default()).force(envelope.safe_code);
    // The probe reads the log before the end.
    Timer::after_millis(50).await;
    end(verdict.failed);
}
