//! The control interrupt: one tick of the amplifier, between two edges of the sample clock.
//!
//! # How it works
//! The interrupt owns [`Control`]: the front end, the amplifier and its ends of the queues. It was handed
//! over in [`hand_over`] before the interrupt was enabled, and nothing else ever touches it. What the tasks
//! may know comes through lock-free queues of one producer and one consumer, and through atomics. Code and
//! data are in memories that no cache and no flash slows down.

use core::cell::UnsafeCell;
use core::hint::black_box; // so that fields are reached from one address, not each from its own
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicUsize, Ordering};

use cortex_m::peripheral::DWT;
use embassy_stm32::pac::TIM2 as TIMER;
use hysteron_core::amplifier::{Amplifier, Mode, Status};
use hysteron_core::amplifier_command::{Command, Refusal};
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_schedule::{CannotWait, CommandSchedule};
use hysteron_core::gain_adaptation::{GAIN_FRACTION_BITS, GainAdaptation};
use hysteron_core::guard::Fault;
use hysteron_core::host_watch::{HostWatch, Missed};
use hysteron_core::output_limit::OutputLimit;
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::sensor_linearisation::SensorLinearisation;
use hysteron_core::set_point::InputState;
use hysteron_core::stepping_parameters::IfStepping;
use hysteron_core::trace_frame::PackedSample;

use crate::board::{Board, Converters, Platform, SAMPLE_RATE_HZ, TEMPERATURES_ARE_READ};
use crate::front_end::FrontEnd;
use crate::recorder::Recorder;
use crate::ring::{Consumer, Producer};
use crate::{event_log, safety_lines, task_clock};

/// Samples on their way to the trace task: 12.8 ms at 20 kHz, 2.56 ms at 100 kHz. The task looks every
/// 1.024 ms.
pub const SAMPLE_QUEUE: usize = 256;
/// Commands on their way to the interrupt.
pub const COMMAND_QUEUE: usize = 16;

/// Who gave a command.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The probe's text.
    Probe,
    /// The serial port.
    Serial,
}

/// A command and the tick at which it acts.
#[derive(Clone, Copy)]
pub struct Scheduled {
    /// Who gave it.
    pub from: Source,
    /// `None`: at the next tick.
    pub at: Option<u32>,
    /// The command.
    pub command: Command,
}

/// What became of a command.
#[derive(Clone, Copy)]
pub enum Outcome {
    /// It acted.
    Done,
    /// The amplifier refused it.
    Refused(Refusal),
    /// It cannot wait for its tick.
    CannotWait(CannotWait),
    /// The amplifier was stopped, and so many commands that waited are forgotten.
    Stopped(u32),
}

/// An answer to a command, or what a stop did.
#[derive(Clone, Copy)]
pub struct Reply {
    /// Who gave the command.
    pub from: Source,
    /// The tick at which it was so.
    pub tick: u32,
    /// What became of it.
    pub outcome: Outcome,
}

/// Everything that the interrupt owns.
// In this order: the amplifier is long, and what stands behind it is beyond the reach of an instruction.
#[repr(C)]
pub struct Control {
    /// Converters.
    pub front_end: Converters,
    /// To the trace task.
    pub samples: Producer<PackedSample, SAMPLE_QUEUE>,
    /// From the command task.
    pub commands: Consumer<Scheduled, COMMAND_QUEUE>,
    /// To the command task.
    pub replies: Producer<Reply, COMMAND_QUEUE>,
    /// Triggered captures.
    pub recorder: Recorder,
    /// Commands that wait for their ticks.
    pub schedule: CommandSchedule<Source>,
    /// The next tick.
    pub tick: u32,
    /// The last tick ended after the next one was due.
    pub overrun: bool,
    /// Core cycles in a period and a half: ticks further apart have skipped one.
    pub late_cycles: u32,
    /// The cycle counter at the last tick; `None` before the first.
    pub last_cycles: Option<u32>,
    /// The amplifier's voltage monitor is wired.
    pub has_monitor: bool,
    /// The analogue set point is wired.
    pub has_set_point: bool,
    /// Straightens the sensor, where it is bent.
    pub linearisation: Option<SensorLinearisation>,
    /// What may act, whatever block and law say; `None` without an envelope, where nothing is driven.
    pub limit: Option<OutputLimit>,
    /// Times that the tick counter has begun again.
    pub turns: u32,
    /// The fault that was latched last.
    pub latched: Option<Fault>,
    /// Servo, guard and modes.
    pub amplifier: Amplifier,
}

impl Control {
    fn answer(&mut self, from: Source, outcome: Outcome) {
        let _ = self.replies.enqueue(Reply {
            from,
            tick: self.tick,
            outcome,
        });
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn stop(&mut self) {
        let queued = self.commands.skip_to(STOP_UP_TO.load(Ordering::Relaxed)) as u32;
        let forgotten = queued.saturating_add(self.schedule.forget_all());
        let _ = self.amplifier.command(Command::Disable);
        self.answer(Source::Probe, Outcome::Stopped(forgotten));
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn swap(&mut self) {
        // SAFETY: the place is the interrupt's while `SWAP` is set, and a block was written to it before.
        let exchange = unsafe { &mut *EXCHANGE.0.get() };
        let block = unsafe { exchange.block.assume_init_ref() };
        let same_hysteresis = block.servo.actuator == self.amplifier.parameters().servo.actuator;
        exchange.outcome = if !Board::SWAPS {
            Err("a swap: this part has no time for it within a period")
        } else if same_hysteresis || Board::SWAPS_HYSTERESIS {
            self.amplifier.swap(block)
        } else {
            Err("another model of the actuator: this part has no time for it within a period")
        };
    }

    /// Gives the drive's converter its code, or sets it up anew. A code that it does not take is a fault:
    /// what acts is not what the servo remembers.
    #[inline(always)]
    fn drive(&mut self, code: DriveCode, renews: bool) {
        let Some(limit) = &mut self.limit else {
            return;
        };
        let (within, changed) = limit.pass(code);
        let taken = if renews {
            self.front_end.renew()
        } else {
            self.front_end.write(within)
        };
        if !taken {
            self.amplifier.refuse(Fault::DriveSilent);
        }
        if changed {
            self.amplifier.refuse(Fault::BeyondEnvelope);
        }
        if !self.front_end.holds() {
            self.amplifier.refuse(Fault::DriveNotHeld);
        }
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn note(&mut self, tick: u32, fault: Option<Fault>) {
        self.latched = fault;
        if let Some(fault) = fault {
            event_log::write(tick, fault as u8);
        }
    }

    /// Lets at most one command act: one whose tick has come, else the next one that has been given.
    #[inline(always)]
    fn take_command(&mut self) {
        if let Some((command, from)) = self.schedule.due(self.tick) {
            self.act(from, command);
        } else if let Some(Scheduled { from, at, command }) = self.commands.dequeue() {
            match at {
                None => self.act(from, command),
                Some(at) => {
                    if let Err(reason) = self.schedule.add(self.tick, at, command, from) {
                        self.answer(from, Outcome::CannotWait(reason));
                    }
                }
            }
        }
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn act(&mut self, from: Source, command: Command) {
        let outcome = self
            .amplifier
            .command(command)
            .map_or_else(Outcome::Refused, |()| Outcome::Done);
        self.recorder.command_acted();
        self.answer(from, outcome);
    }
}

struct Owned(UnsafeCell<MaybeUninit<Control>>);
// SAFETY: written once before the interrupt is enabled, and from then on touched by the interrupt only.
unsafe impl Sync for Owned {}
static CONTROL: Owned = Owned(UnsafeCell::new(MaybeUninit::uninit()));

/// A stop is wanted; it forgets the commands that were queued before this position.
static STOP: AtomicBool = AtomicBool::new(false);
static STOP_UP_TO: AtomicUsize = AtomicUsize::new(0);

/// A block that takes the place of the running one, and what became of it.
struct Exchange {
    block: MaybeUninit<AmplifierParameters>,
    outcome: Result<(), &'static str>,
}

struct Exchanged(UnsafeCell<Exchange>);
// SAFETY: the interrupt's while `SWAP` is set, which the next tick ends, and otherwise that of the one task
// that calls `offer`.
unsafe impl Sync for Exchanged {}
static EXCHANGE: Exchanged = Exchanged(UnsafeCell::new(Exchange {
    block: MaybeUninit::uninit(),
    outcome: Ok(()),
}));
/// A swap is wanted at the next tick.
static SWAP: AtomicBool = AtomicBool::new(false);

static LOST_SAMPLES: AtomicU32 = AtomicU32::new(0);
static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static SLOWEST_COUNTS: AtomicU32 = AtomicU32::new(0);
static LATEST_ENTRY_COUNTS: AtomicU32 = AtomicU32::new(0);
static MOST_TICK_CYCLES: AtomicU32 = AtomicU32::new(0);
static RECENT_TICK_CYCLES: AtomicU32 = AtomicU32::new(0);
/// Part and amplifier are too hot for anything to be driven.
static TOO_HOT: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];
/// An alarm forbids to adapt the gain.
static ADAPTATION_HELD: AtomicBool = AtomicBool::new(false);

/// The amplifier after a tick: all of one tick.
#[derive(Clone, Copy)]
pub struct State {
    /// Ticks since the start.
    pub ticks: u64,
    /// Mode and fault.
    pub status: Status,
    /// What the sensor's converter gave.
    pub adc_code: SensorCode,
    /// What the drive's converter was given.
    pub dac_code: DriveCode,
    /// um with 24 fraction bits; of a stick-slip drive the target, with 16.
    pub reference: i32,
    /// Position of a stick-slip drive, um with 16 fraction bits.
    pub travel: IfStepping<i32>,
    /// Position at the sensor's code 0, um with 24 fraction bits.
    pub adc_zero: i32,
    /// A conditioning has found it.
    pub zeroed: bool,
    /// The actuator is conditioned.
    pub conditioned: bool,
    /// The loop closes only when it is.
    pub conditioning_required: bool,
    /// The power stage is on.
    pub powered: bool,
    /// Something may be played and closed.
    pub armed: bool,
    /// The drive is at its rest code.
    pub rests: bool,
    /// Values of the law that left their format and were cut.
    pub saturated_values: u32,
    /// Gain that is adapted, with its fraction bits; 0: none is.
    pub adapted_gain: i32,
}

impl State {
    const BEFORE_THE_START: Self = Self {
        ticks: 0,
        status: Status {
            mode: Mode::Rest,
            fault: None,
        },
        adc_code: SensorCode::new(0),
        dac_code: DriveCode::new(0),
        reference: 0,
        travel: IfStepping::NONE,
        adc_zero: 0,
        zeroed: false,
        conditioned: false,
        conditioning_required: true,
        powered: false,
        armed: false,
        rests: true,
        saturated_values: 0,
        adapted_gain: 0,
    };
}

/// Two places: the interrupt writes the one that nobody reads, and then says that it is the newest.
struct Published([UnsafeCell<State>; 2]);
// SAFETY: a reader runs below the interrupt, and reads again where two ticks have gone by meanwhile: only
// then its place has been written.
unsafe impl Sync for Published {}
static PUBLISHED: Published = Published([const { UnsafeCell::new(State::BEFORE_THE_START) }; 2]);
/// How often was published; its lowest bit says which place is the newest.
static PUBLICATION: AtomicU32 = AtomicU32::new(0);

/// The amplifier after the last tick.
// Once, not at each of its sixty callers: a copy of the state takes 130 to 400 bytes.
#[inline(never)]
pub fn state() -> State {
    loop {
        let before = PUBLICATION.load(Ordering::Acquire);
        let [even, odd] = &PUBLISHED.0;
        let place = if before & 1 == 0 { even } else { odd };
        // SAFETY: the interrupt writes this place at the second tick from now at the earliest, and then it is
        // read again.
        let state = unsafe { place.get().read_volatile() };
        if PUBLICATION.load(Ordering::Acquire).wrapping_sub(before) < 2 {
            return state;
        }
    }
}

#[inline(always)]
fn publish(state: State) {
    let next = PUBLICATION.load(Ordering::Relaxed).wrapping_add(1);
    let [even, odd] = &PUBLISHED.0;
    let place = if next & 1 == 0 { even } else { odd };
    // SAFETY: readers read the other place until the store below.
    unsafe { place.get().write(state) };
    PUBLICATION.store(next, Ordering::Release);
}

/// What the amplifier's voltage monitor read, or [`NO_CODE`]. Beside [`State`], which every tick copies.
static MONITOR_CODE: AtomicU32 = AtomicU32::new(NO_CODE);
/// What the analogue set point read, or [`NO_CODE`].
static SET_POINT_CODE: AtomicU32 = AtomicU32::new(NO_CODE);
/// The converter gave nothing.
const NO_CODE: u32 = u32::MAX;

/// What the amplifier's voltage monitor read last.
pub fn monitor_code() -> Option<u16> {
    u16::try_from(MONITOR_CODE.load(Ordering::Relaxed)).ok()
}

/// What the loop has of the analogue set point. Beside [`State`] as well.
static INPUT_STATE: AtomicU8 = AtomicU8::new(InputState::Off as u8);

/// What the loop has of the analogue set point.
pub fn input_state() -> InputState {
    InputState::from_number(INPUT_STATE.load(Ordering::Relaxed))
}

/// What the analogue set point read last.
pub fn set_point_code() -> Option<u16> {
    u16::try_from(SET_POINT_CODE.load(Ordering::Relaxed)).ok()
}

/// Whether whoever gives commands, on whatever channel, is still there.
static HOST: HostWatch = HostWatch::new(SAMPLE_RATE_HZ);

/// What the tasks may know of the interrupt.
#[derive(Clone, Copy, defmt::Format)]
pub struct Report {
    /// Ticks since the start.
    pub ticks: u32,
    /// Ticks that found the sample queue full.
    pub lost_samples: u32,
    /// Ticks that ended late.
    pub overruns: u32,
    /// Latest end of a tick after its edge since the last report, timer counts.
    pub slowest_counts: u32,
    /// Latest beginning of a tick after its edge since the last report, timer counts.
    pub latest_entry_counts: u32,
    /// Most cycles from the sensor's code to the drive's code since the last report.
    pub most_tick_cycles: u32,
    /// The same, mean over about the last 256 ticks.
    pub recent_tick_cycles: u32,
    /// Mode (low byte) and fault (next byte).
    pub flags: u16,
}

/// The interrupt's state as of the last tick. Largest values begin again.
pub fn report() -> Report {
    Report {
        ticks: ticks(),
        lost_samples: LOST_SAMPLES.load(Ordering::Relaxed),
        overruns: OVERRUNS.load(Ordering::Relaxed),
        slowest_counts: SLOWEST_COUNTS.swap(0, Ordering::Relaxed),
        latest_entry_counts: LATEST_ENTRY_COUNTS.swap(0, Ordering::Relaxed),
        most_tick_cycles: MOST_TICK_CYCLES.swap(0, Ordering::Relaxed),
        recent_tick_cycles: RECENT_TICK_CYCLES.load(Ordering::Relaxed) >> RECENT_SHIFT,
        flags: status().flags(),
    }
}

/// Ticks since the start.
pub fn ticks() -> u32 {
    state().ticks as u32
}

/// Mode and fault of the last tick.
pub fn status() -> Status {
    state().status
}

/// Whether the drive does not move: at rest or stopped by a fault, the ramp to rest ended.
pub fn drive_rests() -> bool {
    let state = state();
    matches!(state.status.mode, Mode::Rest | Mode::Fault) && state.rests
}

/// Whether the power stage is on.
pub fn powered() -> bool {
    state().powered
}

/// Values of the law that left their format and were cut.
pub fn saturated_values() -> u32 {
    state().saturated_values
}

/// Ticks that ended late.
pub fn overruns() -> u32 {
    OVERRUNS.load(Ordering::Relaxed)
}

/// Position at the sensor's code 0 as it is now, um with 24 fraction bits.
pub fn zero() -> i32 {
    state().adc_zero
}

/// Whether the actuator is conditioned, and whether the loop closes only when it is.
pub fn conditioning() -> (bool, bool) {
    let state = state();
    (state.conditioned, state.conditioning_required)
}

/// Gain of the actuator over the model's as the servo adapted it, millionths; 0: it does not.
pub fn adapted_gain_millionths() -> u32 {
    ((i64::from(state().adapted_gain) * 1_000_000) >> GAIN_FRACTION_BITS) as u32
}

/// Whether an alarm forbids to adapt it.
pub fn hold_adaptation(held: bool) {
    ADAPTATION_HELD.store(held, Ordering::Relaxed);
}

/// Whether the part and the amplifier are too hot for anything to be driven.
pub fn set_too_hot(part: bool, amplifier: bool) {
    for (place, is_too_hot) in TOO_HOT.iter().zip([part, amplifier]) {
        place.store(is_too_hot, Ordering::Relaxed);
    }
}

/// A line came: the host is there.
pub fn hear_host() {
    HOST.hear(ticks());
}

/// Ticks for which no line may come while the drive is live; 0: for ever.
pub fn host_timeout() -> u32 {
    HOST.timeout()
}

/// Changes them.
pub fn set_host_timeout(timeout_ticks: u32) {
    HOST.set_timeout(ticks(), timeout_ticks);
}

/// Ticks that found the sample queue full.
pub fn lost_samples() -> u32 {
    LOST_SAMPLES.load(Ordering::Relaxed)
}

/// Stops the amplifier at the next tick, whatever waits; commands that stand in the queue before `position`
/// are forgotten.
pub fn stop(position: usize) {
    STOP_UP_TO.store(position, Ordering::Relaxed);
    STOP.store(true, Ordering::Release);
}

/// Offers a block that is to take the place of the running one at the next tick; [`swapped`] says what became
/// of it. For one task only, which does not hold a block of its own meanwhile: what a task holds is static.
pub fn offer(block: &AmplifierParameters) {
    // SAFETY: the place is this task's while `SWAP` is not set.
    unsafe { (*EXCHANGE.0.get()).block.write(*block) };
    SWAP.store(true, Ordering::Release);
}

/// Whether the block that was offered runs now, or why not.
pub async fn swapped() -> Result<(), &'static str> {
    while SWAP.load(Ordering::Acquire) {
        task_clock::next().await;
    }
    // SAFETY: the interrupt has given the place back.
    unsafe { (*EXCHANGE.0.get()).outcome }
}

/// Hands everything to the interrupt, which is not enabled yet.
pub fn hand_over(control: Control) {
    // SAFETY: the interrupt is not enabled, so nobody else looks at it.
    unsafe { (*CONTROL.0.get()).write(control) };
}

#[inline(always)]
fn count(counter: &AtomicU32) {
    counter.store(
        counter.load(Ordering::Relaxed).saturating_add(1),
        Ordering::Relaxed,
    );
}

#[inline(always)]
fn keep_largest(largest: &AtomicU32, value: u32) {
    if value > largest.load(Ordering::Relaxed) {
        largest.store(value, Ordering::Relaxed);
    }
}

/// What [`TOO_HOT`] stops for.
const HEAT: [Fault; 2] = [Fault::PartTooHot, Fault::AmplifierTooHot];
/// At rest the drive's converter is set up anew every so many ticks less one, 0.1 to 0.2 s: its own supply
/// may have failed without anybody seeing it.
const RENEW_MASK: u32 = (SAMPLE_RATE_HZ / 10).next_power_of_two() - 1;
const COMPARE_4: u32 = 1 << 4;
/// The mean of the tick's cycles forgets a 2^-n part at every tick.
const RECENT_SHIFT: u32 = 8;

/// Runs once a period, a microsecond or two after the edge of the sample clock. The image's handler of TIM2
/// calls it, and nobody else does.
#[inline(always)]
pub fn on_interrupt() {
    let entry = TIMER.cnt().read();
    let cycles_now = DWT::cycle_count();
    TIMER.sr().write(|w| w.0 = !COMPARE_4);
    // SAFETY: `hand_over` ran before the interrupt was enabled, and the interrupt does not nest.
    let control = unsafe { (*black_box(CONTROL.0.get())).assume_init_mut() };

    // What the last tick prepared acts since the edge of this one.
    safety_lines::set_trigger(control.amplifier.marks());
    // Held up for so long that edges went by without a tick.
    let skipped = control
        .last_cycles
        .is_some_and(|last| cycles_now.wrapping_sub(last) > control.late_cycles);
    control.last_cycles = Some(cycles_now);
    if skipped && !control.overrun {
        count(&OVERRUNS);
    }
    let overrun = control.overrun || skipped;

    let reading = control.front_end.read();
    let reading = match &control.linearisation {
        None => reading,
        Some(linearisation) => reading.map(|code| linearisation.straighten(code)),
    };
    // A stop has a path of its own, past everything that waits. The tasks that ask for it cannot interrupt
    // this.
    if STOP.load(Ordering::Acquire) {
        STOP.store(false, Ordering::Relaxed);
        control.stop();
    }
    if SWAP.load(Ordering::Acquire) {
        control.swap();
        SWAP.store(false, Ordering::Release);
    }
    control.take_command();
    // After the command: nothing that it clears or closes comes to act while a line is open.
    if let Some(fault) = safety_lines::fault() {
        control.amplifier.refuse(fault);
    }
    match HOST.missed(
        control.tick,
        control.amplifier.mode(),
        control.amplifier.powered(),
    ) {
        None => {}
        Some(Missed::Stop) => control.amplifier.refuse(Fault::HostLost),
        Some(Missed::SwitchOff) => _ = control.amplifier.command(Command::Disarm),
    }
    if TEMPERATURES_ARE_READ {
        for (is_too_hot, fault) in TOO_HOT.iter().zip(HEAT) {
            if is_too_hot.load(Ordering::Relaxed) {
                control.amplifier.refuse(fault);
            }
        }
    }
    if Converters::HAS_MONITOR {
        let monitored = control.front_end.monitor();
        if control.has_monitor {
            MONITOR_CODE.store(monitored.map_or(NO_CODE, u32::from), Ordering::Relaxed);
            control.amplifier.inspect_output(monitored);
        }
    }
    if Converters::HAS_SET_POINT && control.has_set_point {
        let code = control.front_end.set_point();
        SET_POINT_CODE.store(code.map_or(NO_CODE, u32::from), Ordering::Relaxed);
        control.amplifier.inspect_input(code);
        INPUT_STATE.store(control.amplifier.input_state() as u8, Ordering::Relaxed);
    }
    control
        .amplifier
        .hold_adaptation(ADAPTATION_HELD.load(Ordering::Relaxed));
    control.front_end.end_read();
    let begin = DWT::cycle_count();
    let mut sample = control.amplifier.tick(reading, overrun);
    let cycles = DWT::cycle_count().wrapping_sub(begin);
    let rests = control.amplifier.drive_rests()
        && matches!(control.amplifier.mode(), Mode::Rest | Mode::Fault);
    control.drive(sample.dac_code, rests && sample.tick & RENEW_MASK == 0);
    // Only now everything has looked at the tick.
    let status = control.amplifier.status();
    sample.flags = status.flags();
    safety_lines::set_enable(control.amplifier.powered());

    if status.mode == Mode::Fault {
        // What was planned before a fault must not act after it.
        control.schedule.forget_all();
    }
    let packed = sample.packed();
    control.recorder.take(&packed, status.mode);
    if !control.samples.enqueue(packed) {
        count(&LOST_SAMPLES);
    }
    control.tick = control.tick.wrapping_add(1);
    control.turns = control.turns.wrapping_add(u32::from(control.tick == 0));
    if status.fault != control.latched {
        control.note(sample.tick, status.fault);
    }
    let amplifier = &control.amplifier;
    publish(State {
        ticks: u64::from(control.turns) << 32 | u64::from(control.tick),
        status,
        adc_code: sample.adc_code,
        dac_code: sample.dac_code,
        reference: sample.reference,
        travel: match amplifier.stepper() {
            None => IfStepping::NONE,
            Some(stepper) => IfStepping::new(stepper.position().to_bits()),
        },
        adc_zero: amplifier.servo().parameters().converters.adc_zero,
        zeroed: amplifier.zeroed(),
        conditioned: amplifier.conditioned(),
        conditioning_required: amplifier.conditioning_required(),
        powered: amplifier.powered(),
        armed: amplifier.armed(),
        rests: amplifier.drive_rests(),
        saturated_values: amplifier.servo().counters().saturated_values,
        adapted_gain: amplifier
            .servo()
            .adaptation()
            .map_or(0, GainAdaptation::gain),
    });
    keep_largest(&LATEST_ENTRY_COUNTS, entry);
    keep_largest(&MOST_TICK_CYCLES, cycles);
    let recent = RECENT_TICK_CYCLES.load(Ordering::Relaxed);
    RECENT_TICK_CYCLES.store(
        recent
            .wrapping_sub(recent >> RECENT_SHIFT)
            .wrapping_add(cycles),
        Ordering::Relaxed,
    );
    // The next compare is already flagged: the tick took longer than a period.
    control.overrun = TIMER.sr().read().0 & COMPARE_4 != 0;
    if control.overrun {
        count(&OVERRUNS);
    }
    keep_largest(&SLOWEST_COUNTS, TIMER.cnt().read());
}
