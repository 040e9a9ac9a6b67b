//! A light of a board.

use embassy_stm32::pac::gpio::Gpio;

/// A light and what it does: a bit for each eighth of a second.
pub struct Light {
    /// Port of its pin, which lights it when it is high.
    pub port: Gpio,
    /// Its pin.
    pub pin: usize,
    /// The power stage is off, and there is no fault.
    pub safe: u8,
    /// The power stage is on, the loop open.
    pub armed: u8,
    /// The loop is closed.
    pub closed: u8,
    /// Stopped by a fault.
    pub fault: u8,
}

impl Light {
    /// Lights it, or puts it out.
    pub fn set(&self, on: bool) {
        let bit = if on { self.pin } else { self.pin + 16 };
        self.port.bsrr().write(|w| w.0 = 1 << bit);
    }
}
