//! What a scope has seen of its board, between the thread that watches and the requests of pages.

use super::block::ScopeBlock;
use hysteron_client::board::Stopper;
use hysteron_client::condition::Condition;
use hysteron_client::watching::Glance;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Blocks of which the newest are kept, for pages that are a little behind.
pub const NEWEST_BLOCKS: usize = 4;
/// Blocks that pages hold, the oldest is forgotten first.
pub const HELD_BLOCKS: usize = 16;
/// Values of now that are kept: some minutes.
pub const GLANCES: usize = 1500;

/// What pages may choose: one sample every so many ticks, and how many of them are a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    pub ticks_per_sample: u32,
    pub samples: usize,
}

/// Windows by name, as the page lists them.
pub const WINDOWS: [Window; 5] = [
    Window {
        ticks_per_sample: 1,
        samples: 1024,
    },
    Window {
        ticks_per_sample: 1,
        samples: 4096,
    },
    Window {
        ticks_per_sample: 1,
        samples: 16_000,
    },
    Window {
        ticks_per_sample: 10,
        samples: 4096,
    },
    Window {
        ticks_per_sample: 50,
        samples: 4096,
    },
];
/// The one that a scope begins with.
pub const FIRST_WINDOW: usize = 1;

/// What is known of the board.
#[derive(Default)]
pub struct Seen {
    /// Whether the board answers.
    pub connected: bool,
    /// Why not, or what else there is to say.
    pub trouble: String,
    pub identification: String,
    /// Ticks per second, where the board has a block that says it.
    pub sample_rate_hz: Option<f64>,
    pub condition: Option<Condition>,
    /// Values of now since the board was met last, with their instants, s since the scope began.
    pub glances: VecDeque<(f64, Glance)>,
    pub newest: VecDeque<Arc<ScopeBlock>>,
    pub held: VecDeque<Arc<ScopeBlock>>,
    /// Blocks so far.
    pub blocks: u64,
    pub window: usize,
    pub stopper: Option<Stopper>,
}

/// What the watcher sees and pages show.
pub struct Scope {
    pub began: Instant,
    pub seen: Mutex<Seen>,
    /// Stops that pages have given.
    pub stops: AtomicU32,
    pub ended: AtomicBool,
}

impl Scope {
    pub fn new() -> Self {
        let seen = Mutex::new(Seen {
            window: FIRST_WINDOW,
            ..Seen::default()
        });
        Self {
            began: Instant::now(),
            seen,
            stops: AtomicU32::new(0),
            ended: AtomicBool::new(false),
        }
    }

    /// What is known, whoever broke off while writing it.
    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn seconds(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    pub fn stops(&self) -> u32 {
        self.stops.load(Ordering::SeqCst)
    }

    pub fn has_ended(&self) -> bool {
        self.ended.load(Ordering::SeqCst)
    }
}
