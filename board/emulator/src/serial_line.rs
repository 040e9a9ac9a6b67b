//! The far end of the board's serial port: what the other side sent and has not been taken, and what came.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::time::VirtualNanos;

/// The line as both of its ends share it.
#[derive(Debug, Default)]
pub struct SerialLine {
    /// Bytes on their way to the part.
    pub to_part: VecDeque<u8>,
    /// Bytes that the part sent, each with the instant at which its stop bit ended, ns.
    pub from_part: VecDeque<(u64, u8)>,
}

/// A line that is shared.
pub type SharedLine = Arc<Mutex<SerialLine>>;

/// The end that the part sees.
#[derive(Debug)]
pub struct SerialPeer {
    line: SharedLine,
}

rigless::store!(SerialPeer {
    values: [],
    parts: [],
    built: [line]
});

impl SerialPeer {
    /// Of this line.
    #[must_use]
    pub fn new(line: &SharedLine) -> Self {
        Self {
            line: Arc::clone(line),
        }
    }
}

impl Peer for SerialPeer {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        if let (Ok(mut line), [low, _]) = (self.line.lock(), word.to_le_bytes()) {
            line.from_part.push_back((context.now().0, low));
        }
    }

    fn transmit(&mut self, _: VirtualNanos) -> Option<u16> {
        self.line.lock().ok()?.to_part.pop_front().map(u16::from)
    }
}
