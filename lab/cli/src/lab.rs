//! `lab`.

use crate::read_arguments::ReadArguments;
use hysteron::{Error, Result};
use hysteron_browser::recording::Said;
use hysteron_browser::served::{OnDisk, Served};
use hysteron_browser::server::Server;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

/// Serves the lab page until Ctrl-C.
pub fn lab(dataset: Option<PathBuf>, no_open: bool, reading: &ReadArguments) -> Result<bool> {
    let instructions = reading.instructions()?;
    let served = dataset.map(|path| Arc::new(OnDisk { path, instructions }) as Arc<dyn Served>);
    // What cannot be read is reported here, not in a page that has to be opened first.
    served
        .as_ref()
        .map_or(Ok(()), |served| served.read(&Said::default()).map(drop))?;
    let server = Arc::new(Server::bind(served)?);
    let at_end = Arc::clone(&server);
    ctrlc::set_handler(move || at_end.end())
        .map_err(|e| Error::new("Ctrl-C", format!("cannot be listened to: {e}")))?;
    let address = server.address();
    println!("{address}");
    println!("The lab is open at this address, on this machine only. Ctrl-C ends it.");
    // Whoever reads the address from a pipe waits for it.
    let _ = std::io::stdout().flush();
    if !no_open && let Err(problem) = open::that_detached(&address) {
        eprintln!("no browser could be opened ({problem}); open the address yourself");
    }
    server.serve();
    Ok(true)
}
