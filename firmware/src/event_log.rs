//! The last faults: a ring in memory that nothing initialises, and behind it records in flash.
//!
//! The control interrupt writes a fault when it is latched; what restarted the program is latched at the next
//! start. The memory keeps it over resets, as long as the part has its supply; a checksum tells what is left
//! of a ring from what a supply that was switched on has made of it. A task copies every event to flash some
//! tenths of a second later (`update.rs`, [`hysteron_core::kept_events`]), and a start without a ring takes
//! the newest from there.

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use hysteron_core::kept_events::Event;

/// Faults that are kept.
pub const ROOM: usize = 64;
const MAGIC: u32 = 0x4859_4c31;

/// Events that stand in flash: the number behind the last one.
static KEPT: AtomicU32 = AtomicU32::new(0);

#[inline(always)]
const fn sum(event: Event) -> u32 {
    event.start.rotate_left(7) ^ event.tick.rotate_left(13) ^ event.fault.rotate_left(24)
}

#[derive(Clone, Copy)]
struct Log {
    magic: u32,
    starts: u32,
    written: u32,
    check: u32,
    events: [Event; ROOM],
}

#[unsafe(link_section = ".uninit.event_log")]
static mut LOG: MaybeUninit<Log> = MaybeUninit::uninit();

fn check(log: &Log) -> u32 {
    log.events
        .iter()
        .fold(log.starts ^ log.written.rotate_left(16), |check, event| {
            check.rotate_left(1) ^ sum(*event)
        })
}

impl Log {
    const EMPTY: Self = Self {
        magic: MAGIC,
        starts: 0,
        written: 0,
        check: 0,
        events: [Event {
            start: 0,
            tick: 0,
            fault: 0,
        }; ROOM],
    };

    /// Takes an event from the flash; they come in their order.
    fn restore(&mut self, number: u32, event: Event) {
        if let Some(place) = self.events.get_mut(number as usize % ROOM) {
            *place = event;
        }
        (self.written, self.starts) = (number.wrapping_add(1), event.start);
    }
}

/// Counts a start; where the memory holds no log it begins with what the flash has, which `kept_events` gives.
#[inline(never)]
pub fn begin(kept_events: impl FnOnce(&mut dyn FnMut(u32, Event))) {
    let mut in_flash = Log::EMPTY;
    kept_events(&mut |number, event| in_flash.restore(number, event));
    KEPT.store(in_flash.written, Ordering::Relaxed);
    // SAFETY: any value may be there, and all of them are numbers; only thread code before the control
    // interrupt's start touches it.
    unsafe {
        let log = (&raw mut LOG).cast::<Log>();
        let mut kept = log.read_volatile();
        if kept.magic != MAGIC || kept.check != check(&kept) || kept.written < in_flash.written {
            kept = in_flash;
        }
        kept.starts = kept.starts.wrapping_add(1);
        kept.check = check(&kept);
        log.write_volatile(kept);
    }
}

/// Writes a fault by its number. For the control interrupt once it runs, for thread code before.
#[inline(never)]
#[unsafe(link_section = ".control_code")]
pub fn write(tick: u32, fault: u8) {
    // SAFETY: `begin` ran first; the interrupt and who writes before its start do not write at the same time,
    // and readers look for the check.
    unsafe {
        let log = &mut *(&raw mut LOG).cast::<Log>();
        let at = log.written as usize % ROOM;
        if let Some(place) = log.events.get_mut(at) {
            // What the check has of this place changes with it.
            let turns = (ROOM - 1 - at) as u32;
            log.check ^= sum(*place).rotate_left(turns);
            *place = Event {
                start: log.starts,
                tick,
                fault: fault.into(),
            };
            log.check ^= sum(*place).rotate_left(turns);
        }
        let turns = ROOM as u32;
        log.check ^= (log.starts ^ log.written.rotate_left(16)).rotate_left(turns);
        log.written = log.written.wrapping_add(1);
        log.check ^= (log.starts ^ log.written.rotate_left(16)).rotate_left(turns);
    }
}

/// The event so many before the last one; `None` beyond the oldest that is kept.
pub fn event(before_last: u32) -> Option<Event> {
    // SAFETY: as above; an event that is written meanwhile is one that the next question shows.
    let log = unsafe { (&raw const LOG).cast::<Log>().read_volatile() };
    let kept = log.written.min(ROOM as u32);
    let nth = log
        .written
        .checked_sub(before_last.checked_add(1)?)
        .filter(|_| before_last < kept)?;
    log.events.get(nth as usize % ROOM).copied()
}

/// Starts since the first one that is logged.
pub fn starts() -> u32 {
    // SAFETY: as above.
    unsafe { (&raw const LOG).cast::<Log>().read_volatile().starts }
}

/// Events so far.
fn written() -> u32 {
    // SAFETY: as above.
    unsafe { (&raw const (*(&raw const LOG).cast::<Log>()).written).read_volatile() }
}

/// The oldest event that does not stand in flash yet, and its number.
pub fn next_to_keep() -> Option<(u32, Event)> {
    let written = written();
    let number = KEPT
        .load(Ordering::Relaxed)
        .max(written.saturating_sub(ROOM as u32));
    let event = event(written.checked_sub(number)?.checked_sub(1)?)?;
    // With another one meanwhile it may be half of that: it is asked for again.
    (self::written() == written).then_some((number, event))
}

/// Events up to and without this number stand in flash.
pub fn are_kept(up_to: u32) {
    KEPT.store(up_to, Ordering::Relaxed);
}
