//! The bridge between a socket and the board's serial line: one program at a time, the next when it has gone.
//!
//! What the board says goes on in whole lines. A program may rely on that without knowing: PIPython 2.11
//! takes a record for empty when what it has received so far ends in `# END_HEADER`, before the line's own
//! end.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use crate::serial_line::{SerialLine, SharedLine};

/// How long the bridge waits for bytes from the program, then it looks for bytes from the board.
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
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(error) => return Err(error),
        }
        let answer = line
            .lock()
            .map_or_else(|_| Vec::new(), |mut line| whole_lines(&mut line));
        stream.write_all(&answer)?;
    }
}

/// Takes the lines that have come to their end; what has begun stays. Every answer of the board ends in a
/// line feed.
fn whole_lines(line: &mut SerialLine) -> Vec<u8> {
    let ended = line
        .from_part
        .iter()
        .rposition(|(_, byte)| *byte == b'\n')
        .map_or(0, |last| last + 1);
    line.from_part
        .drain(..ended)
        .map(|(_, byte)| byte)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wherever the bridge looks between two bytes, the end of the header comes with its line's end.
    #[test]
    fn a_line_is_passed_on_whole_wherever_the_bridge_comes_between_its_bytes() {
        let said = b"# NDATA = 400 \n# END_HEADER \n3.0 3.0 \n5.0 5.0\n";
        for at in 0..=said.len() {
            let mut line = SerialLine::default();
            let mut passed = Vec::new();
            for piece in [&said[..at], &said[at..]] {
                line.from_part.extend(piece.iter().map(|byte| (0, *byte)));
                let lines = whole_lines(&mut line);
                assert!(
                    lines.is_empty() || lines.ends_with(b"\n"),
                    "{at}: {}",
                    String::from_utf8_lossy(&lines)
                );
                passed.extend(lines);
            }
            assert_eq!(passed, said, "{at}: nothing is lost, and nothing stays");
        }
    }
}
