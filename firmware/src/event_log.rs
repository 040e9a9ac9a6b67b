//! The last faults, kept over resets: a ring in memory that nothing initialises.
//!
//! The control interrupt writes a fault when it is latched; what restarted the program is latched at the next
//! start. The memory keeps it as long as the part has its supply; a checksum tells what is left of a ring
//! from what a supply that was switched on has made of it.

use core::mem::MaybeUninit;

/// Faults that are kept.
pub const ROOM: usize = 64;
const MAGIC: u32 = 0x4859_4c31;

/// A fault that was latched.
#[derive(Clone, Copy, Default)]
pub struct Event {
    /// Number of earlier starts since the supply was switched on.
    pub start: u32,
    /// The tick at which it was latched; 0 at a start.
    pub tick: u32,
    /// The number of it.
    pub fault: u32,
}

impl Event {
    const fn sum(self) -> u32 {
        self.start.rotate_left(7) ^ self.tick.rotate_left(13) ^ self.fault.rotate_left(24)
    }
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
        .fold(log.starts ^ log.written.rotate_left(16), |sum, event| {
            sum.rotate_left(1) ^ event.sum()
        })
}

/// Counts a start; begins anew where the memory holds no log.
pub fn begin() {
    // SAFETY: any value may be there, and all of them are numbers; only thread code before the control
    // interrupt's start touches it.
    unsafe {
        let log = (&raw mut LOG).cast::<Log>();
        let mut kept = log.read_volatile();
        if kept.magic != MAGIC || kept.check != check(&kept) {
            kept = Log {
                magic: MAGIC,
                starts: 0,
                written: 0,
                check: 0,
                events: [Event::default(); ROOM],
            };
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
            log.check ^= place.sum().rotate_left(turns);
            *place = Event {
                start: log.starts,
                tick,
                fault: fault.into(),
            };
            log.check ^= place.sum().rotate_left(turns);
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

/// Starts since the supply was switched on.
pub fn starts() -> u32 {
    // SAFETY: as above.
    unsafe { (&raw const LOG).cast::<Log>().read_volatile().starts }
}
