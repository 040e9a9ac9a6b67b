//! Triggered captures: every tick around an event, in a memory of its own that nothing can make it lose.
//!
//! # How it works
//! The control interrupt owns the memory while a capture is armed: it writes each sample into a ring, and
//! after the event as many more as were asked for. Then it hands the memory over ([`State::Full`]) and never
//! touches it again until the task that reads it out returns it. [`STATE`] says whose the memory is.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use hysteron_core::amplifier::Mode;
use hysteron_core::command_text::Trigger;
use hysteron_core::trace_frame::{PackedSample, TraceSample};

use crate::board::{Board, Platform};

/// Samples that fit.
pub const ROOM: u32 = Board::RECORDED_SAMPLES;

/// The trigger of [`begin_from_command`], beside those of the probe's text.
const ON_COMMAND: u8 = 0xff;

/// Whose the memory is.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// The task's; nothing is in it.
    Empty = 0,
    /// The interrupt's.
    Armed = 1,
    /// The task's, with a capture in it.
    Full = 2,
}

struct Memory(UnsafeCell<[MaybeUninit<PackedSample>; ROOM as usize]>);
// SAFETY: touched by the interrupt while `STATE` is armed and by the one task that reads it out otherwise.
unsafe impl Sync for Memory {}
#[unsafe(link_section = ".bulk.capture")]
static MEMORY: Memory = Memory(UnsafeCell::new(
    [const { MaybeUninit::uninit() }; ROOM as usize],
));

static STATE: AtomicU8 = AtomicU8::new(State::Empty as u8);
static TRIGGER: AtomicU8 = AtomicU8::new(0);
static BEFORE: AtomicU32 = AtomicU32::new(0);
static AFTER: AtomicU32 = AtomicU32::new(0);
/// A sample is kept every so many ticks.
static EVERY: AtomicU32 = AtomicU32::new(1);
/// Counts the captures that were armed: another number is another capture.
static CAPTURE: AtomicU32 = AtomicU32::new(0);
/// Samples written in all, and those of them that count.
static WRITTEN: AtomicU32 = AtomicU32::new(0);
static KEPT: AtomicU32 = AtomicU32::new(0);

/// Whose the memory is now.
pub fn state() -> State {
    match STATE.load(Ordering::Acquire) {
        1 => State::Armed,
        2 => State::Full,
        _ => State::Empty,
    }
}

/// Hands the memory to the interrupt. Not while it has it.
pub fn arm(trigger: Trigger, before: u32, after: u32) -> Result<(), &'static str> {
    if state() == State::Armed {
        return Err("a capture is armed: `capture off` first");
    }
    if before.saturating_add(after) >= ROOM {
        return Err("more ticks than there is room for (`HDR?` of the serial port says how many)");
    }
    arm_every(1, trigger, before, after);
    Ok(())
}

/// Begins to record at once, every so many ticks, until the memory is full; forgets what was there.
pub fn begin(every_ticks: u32) {
    disarm();
    arm_every(every_ticks, Trigger::Now, 0, ROOM - 1);
}

/// Begins to record every so many ticks at the tick behind the one at which the next command acts; forgets
/// what was there.
pub fn begin_from_command(every_ticks: u32) {
    disarm();
    arm_every_on(every_ticks, ON_COMMAND, 0, ROOM - 1);
}

fn arm_every(every_ticks: u32, trigger: Trigger, before: u32, after: u32) {
    arm_every_on(every_ticks, trigger as u8, before, after);
}

fn arm_every_on(every_ticks: u32, trigger: u8, before: u32, after: u32) {
    EVERY.store(every_ticks.max(1), Ordering::Relaxed);
    WRITTEN.store(0, Ordering::Relaxed);
    CAPTURE.store(
        CAPTURE.load(Ordering::Relaxed).wrapping_add(1),
        Ordering::Relaxed,
    );
    TRIGGER.store(trigger, Ordering::Relaxed);
    BEFORE.store(before, Ordering::Relaxed);
    AFTER.store(after, Ordering::Relaxed);
    STATE.store(State::Armed as u8, Ordering::Release);
}

/// Samples that were recorded so far.
pub fn recorded() -> u32 {
    match state() {
        State::Empty => 0,
        State::Armed => WRITTEN.load(Ordering::Relaxed).min(ROOM),
        State::Full => KEPT.load(Ordering::Relaxed),
    }
}

/// Ends a recording where it is. The interrupt cannot be in the middle of a sample while a task runs.
pub fn end() {
    if state() == State::Armed {
        disarm();
        KEPT.store(WRITTEN.load(Ordering::Relaxed).min(ROOM), Ordering::Relaxed);
        STATE.store(State::Full as u8, Ordering::Release);
    }
}

/// Takes the memory back. The interrupt cannot be in the middle of a sample while a task runs.
pub fn disarm() {
    STATE.store(State::Empty as u8, Ordering::Release);
}

/// The capture's sample of this number, oldest first; `None` at its end or without one.
pub fn sample(nth: u32) -> Option<TraceSample> {
    let kept = KEPT.load(Ordering::Relaxed);
    if state() != State::Full || nth >= kept {
        return None;
    }
    let at = WRITTEN
        .load(Ordering::Relaxed)
        .wrapping_sub(kept)
        .wrapping_add(nth)
        % ROOM;
    // SAFETY: the memory is the task's while the state is full, and the last `kept` samples were written.
    let slots = unsafe { &*MEMORY.0.get() };
    slots
        .get(at as usize)
        .map(|slot| unsafe { slot.assume_init() }.unpacked())
}

/// The interrupt's part.
pub struct Recorder {
    capture: u32,
    written: u32,
    /// Ticks until the next sample is kept.
    skip: u32,
    remaining: Option<u32>,
    mode: Mode,
    /// A command acted in this tick.
    command_acts: bool,
    /// The recording that waits for a command has begun.
    begun: bool,
}

impl Recorder {
    /// Nothing is armed.
    pub const fn new() -> Self {
        Self {
            capture: 0,
            written: 0,
            skip: 0,
            remaining: None,
            mode: Mode::Rest,
            command_acts: false,
            begun: false,
        }
    }

    /// A command acts in the tick whose sample comes next.
    #[inline(always)]
    pub fn command_acted(&mut self) {
        self.command_acts = true;
    }

    /// Takes the sample of a tick, and the mode in it.
    #[inline(always)]
    pub fn take(&mut self, sample: &PackedSample, mode: Mode) {
        let before = core::mem::replace(&mut self.mode, mode);
        let command_acts = core::mem::replace(&mut self.command_acts, false);
        if STATE.load(Ordering::Acquire) != State::Armed as u8 {
            return;
        }
        let capture = CAPTURE.load(Ordering::Relaxed);
        if self.capture != capture {
            *self = Self {
                capture,
                mode,
                ..Self::new()
            };
        }
        if TRIGGER.load(Ordering::Relaxed) == ON_COMMAND && !self.begun {
            self.begun = command_acts;
            return;
        }
        if self.skip > 0 {
            self.skip -= 1;
            return;
        }
        self.skip = EVERY.load(Ordering::Relaxed).wrapping_sub(1);
        // SAFETY: the memory is the interrupt's while the state is armed.
        let slots = unsafe { &mut *MEMORY.0.get() };
        if let Some(slot) = slots.get_mut((self.written % ROOM) as usize) {
            slot.write(*sample);
        }
        self.written = self.written.wrapping_add(1);
        WRITTEN.store(self.written, Ordering::Relaxed);
        let changed_to = |wanted: Mode| mode == wanted && before != wanted;
        let remaining = match self.remaining {
            Some(remaining) => remaining - 1,
            None => {
                let trigger = TRIGGER.load(Ordering::Relaxed);
                let happened = trigger == ON_COMMAND
                    || (trigger == Trigger::Now as u8
                        && self.written > BEFORE.load(Ordering::Relaxed))
                    || (trigger == Trigger::Fault as u8 && changed_to(Mode::Fault))
                    || (trigger == Trigger::Closed as u8 && changed_to(Mode::Closed));
                if !happened {
                    return;
                }
                AFTER.load(Ordering::Relaxed)
            }
        };
        self.remaining = Some(remaining);
        if remaining == 0 {
            let wanted = BEFORE
                .load(Ordering::Relaxed)
                .wrapping_add(AFTER.load(Ordering::Relaxed))
                .wrapping_add(1);
            KEPT.store(wanted.min(self.written), Ordering::Relaxed);
            STATE.store(State::Full as u8, Ordering::Release);
        }
    }
}
