//! `board scope`: what a board does, on a page of this machine.
//!
//! # How it works
//! One thread has the conversation with the board ([`watcher`]) and leaves what it saw in a [`Scope`];
//! requests of pages read it there ([`page`]). So any number of pages may be open, none of them waits for the
//! board, and a board that goes away is asked for again until it is back. The one command that a page can
//! give is STOP. It has a handle of the port for itself and waits for nothing.

mod block;
mod page;
mod watcher;

use super::LineArguments;
use block::ScopeBlock;
use hysteron::{Error, Result};
use hysteron_browser::local_server::LocalServer;
use hysteron_client::board::Stopper;
use hysteron_client::condition::Condition;
use hysteron_client::watching::Glance;
use std::collections::VecDeque;
use std::io::Write;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Blocks of which the newest are kept, for pages that are a little behind.
const NEWEST_BLOCKS: usize = 4;
/// Blocks that pages hold, the oldest is forgotten first.
const HELD_BLOCKS: usize = 16;
/// Values of now that are kept: some minutes.
const GLANCES: usize = 1500;

/// What pages may choose: one sample every so many ticks, and how many of them are a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Window {
    ticks_per_sample: u32,
    samples: usize,
}

/// Windows by name, as the page lists them.
const WINDOWS: [Window; 5] = [
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
const FIRST_WINDOW: usize = 1;

/// What is known of the board.
#[derive(Default)]
struct Seen {
    /// Whether the board answers.
    connected: bool,
    /// Why not, or what else there is to say.
    trouble: String,
    identification: String,
    /// Ticks per second, where the board has a block that says it.
    sample_rate_hz: Option<f64>,
    condition: Option<Condition>,
    /// Values of now since the board was met last, with their instants, s since the scope began.
    glances: VecDeque<(f64, Glance)>,
    newest: VecDeque<Arc<ScopeBlock>>,
    held: VecDeque<Arc<ScopeBlock>>,
    /// Blocks so far.
    blocks: u64,
    window: usize,
    stopper: Option<Stopper>,
}

/// What the watcher sees and pages show.
struct Scope {
    began: Instant,
    seen: Mutex<Seen>,
    /// Stops that pages have given.
    stops: AtomicU32,
    ended: AtomicBool,
}

impl Scope {
    fn new() -> Self {
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
    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn seconds(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn stops(&self) -> u32 {
        self.stops.load(Ordering::SeqCst)
    }

    fn has_ended(&self) -> bool {
        self.ended.load(Ordering::SeqCst)
    }
}

/// Serves the page until Ctrl-C.
pub fn scope(listen: SocketAddr, no_open: bool, line: &LineArguments) -> Result<bool> {
    let (address, baud) = (line.address()?, line.baud());
    let server = Arc::new(LocalServer::bind(listen, "hysteron board scope")?);
    let page = hysteron_page::scope().map_err(|what| Error::new("scope", what))?;
    let scope = Arc::new(Scope::new());
    let (at_end, to_wake) = (Arc::clone(&scope), Arc::clone(&server));
    let listened = ctrlc::set_handler(move || {
        at_end.ended.store(true, Ordering::SeqCst);
        to_wake.wake();
    });
    listened.map_err(|e| Error::new("Ctrl-C", format!("cannot be listened to: {e}")))?;
    let shown = server.address();
    println!("{shown}");
    println!(
        "The scope of {address} is open at this address, on this machine only. Ctrl-C ends it and leaves the board as it is."
    );
    // Whoever reads the address from a pipe waits for it.
    let _ = std::io::stdout().flush();
    if !no_open && let Err(problem) = open::that_detached(&shown) {
        eprintln!("no browser could be opened ({problem}); open the address yourself");
    }
    let watching = Arc::clone(&scope);
    std::thread::spawn(move || watcher::watch(&watching, &address, baud));
    while !scope.has_ended() {
        if let Some(request) = server.receive() {
            let (server, scope, page) = (Arc::clone(&server), Arc::clone(&scope), page.clone());
            std::thread::spawn(move || {
                server.answer(request, |request| page::route(&scope, &page, request))
            });
        }
    }
    Ok(true)
}
