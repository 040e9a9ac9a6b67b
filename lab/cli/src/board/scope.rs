//! `board scope`: what a board does, on a page of this machine.
//!
//! # How it works
//! One thread has the conversation with the board ([`watcher`]) and leaves what it saw in a [`Scope`];
//! requests of pages read it there ([`page`]). So any number of pages may be open, none of them waits for the
//! board, and a board that goes away is asked for again until it is back. The one command that a page can
//! give is STOP. It has a handle of the port for itself and waits for nothing.

mod block;
mod page;
mod seen;
mod watcher;

use super::connection::LineArguments;
use hysteron::{Error, Result};
use hysteron_browser::local_server::LocalServer;
use seen::Scope;
use std::io::Write;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

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
