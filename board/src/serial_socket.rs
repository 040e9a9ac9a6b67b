//! The bridge between a socket and the board's serial line: one program at a time, the next when it has gone.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use hysteron_emulator::serial_line::SharedLine;

/// How long the bridge waits for bytes from the program before it looks for bytes from the board.
const WAIT: Duration = Duration::from_millis(1);

/// Serves programs from now on, beside the run.
pub fn serve(listener: TcpListener, line: &SharedLine) {
    let line = line.clone();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            // A program that goes without a word makes room for the next.
            let _ = bridge(stream, &line);
        }
    });
}

fn bridge(mut stream: TcpStream, line: &SharedLine) -> std::io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(WAIT))?;
    if let Ok(mut line) = line.lock() {
        // What was meant for the one before.
        line.from_part.clear();
        line.to_part.clear();
    }
    let mut bytes = [0; 1024];
    loop {
        match stream.read(&mut bytes) {
            Ok(0) => return Ok(()),
            Ok(count) => {
                if let (Ok(mut line), Some(bytes)) = (line.lock(), bytes.get(..count)) {
                    line.to_part.extend(bytes);
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Err(error),
        }
        let answer: Vec<u8> = line.lock().map_or_else(|_| Vec::new(), |mut line| line.from_part.drain(..).map(|(_, byte)| byte).collect());
        stream.write_all(&answer)?;
    }
}
