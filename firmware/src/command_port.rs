//! The tasks' way to the amplifier: every task that takes commands from somebody gives them here.
//!
//! Commands are queued and act in their order, at most one in a tick. [`stop`] is not queued: it acts at the
//! next tick, past everything that waits, and forgets it. It may come from an interrupt, so what is queued and
//! how far the queue stands change together, in a critical section.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use embassy_sync::blocking_mutex::ThreadModeMutex;
use hysteron_core::amplifier_command::Command;

use crate::control::{self, COMMAND_QUEUE, Scheduled, Source};
use crate::ring::Producer;

static QUEUE: ThreadModeMutex<RefCell<Option<Producer<Scheduled, COMMAND_QUEUE>>>> =
    ThreadModeMutex::new(RefCell::new(None));

/// Stops so far, wrapping.
static STOPS: AtomicU32 = AtomicU32::new(0);
/// Commands ever queued, wrapping.
static POSITION: AtomicUsize = AtomicUsize::new(0);

fn with_queue<T>(
    otherwise: T,
    action: impl FnOnce(&mut Producer<Scheduled, COMMAND_QUEUE>) -> T,
) -> T {
    QUEUE.lock(|queue| match queue.borrow_mut().as_mut() {
        Some(queue) => action(queue),
        None => otherwise,
    })
}

/// Opens the port with the tasks' end of the queue.
pub fn open(queue: Producer<Scheduled, COMMAND_QUEUE>) {
    QUEUE.lock(|place| *place.borrow_mut() = Some(queue));
}

/// Gives a command to the amplifier; `false` if too many wait. What becomes of it comes as a
/// [`control::Reply`] to `from`.
pub fn submit(from: Source, at: Option<u32>, command: Command) -> bool {
    critical_section::with(|_| {
        with_queue(false, |queue| {
            let taken = queue.enqueue(Scheduled { from, at, command });
            POSITION.store(queue.position(), Ordering::Relaxed);
            taken
        })
    })
}

/// Gives a command to the amplifier, unless it was stopped since there were so many stops: `None`.
pub fn submit_unless_stopped(from: Source, command: Command, stops_so_far: u32) -> Option<bool> {
    critical_section::with(|_| (stops() == stops_so_far).then(|| submit(from, None, command)))
}

/// Whether another command finds room.
pub fn has_room() -> bool {
    with_queue(false, |queue| queue.has_room())
}

/// Stops the amplifier at the next tick. Tasks and the serial port's interrupt may call it.
pub fn stop() {
    STOPS.fetch_add(1, Ordering::Relaxed);
    control::stop(POSITION.load(Ordering::Relaxed));
}

/// Stops so far, wrapping: who gives several commands one after the other gives no more of them when this has
/// changed.
pub fn stops() -> u32 {
    STOPS.load(Ordering::Relaxed)
}
