//! The board's lights: whether it is safe, armed, closed or stopped by a fault, without any program.
//!
//! Not in the control interrupt: a light that is a hundredth of a second late is seen as well. What each light
//! does in each state stands in the board's description ([`Platform::LIGHTS`]).

use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::Moder;
use hysteron_core::amplifier::Mode;

use crate::board::{Board, Platform, SAMPLE_RATE_HZ};
use crate::control::State;

/// Parts of a second that a pattern has.
const PARTS: u32 = 8;

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
    fn set(&self, on: bool) {
        let bit = if on { self.pin } else { self.pin + 16 };
        self.port.bsrr().write(|w| w.0 = 1 << bit);
    }

    fn pattern(&self, state: &State) -> u8 {
        match state.status.mode {
            Mode::Fault => self.fault,
            Mode::Closed => self.closed,
            Mode::Rest | Mode::Playing if state.powered => self.armed,
            Mode::Rest | Mode::Playing => self.safe,
        }
    }
}

/// Sets the pins up; everything is dark.
pub fn start() {
    Board::clock_lights();
    for light in Board::LIGHTS {
        light.set(false);
        light
            .port
            .moder()
            .modify(|w| w.set_moder(light.pin, Moder::OUTPUT));
    }
}

/// Shows a state.
pub fn show(state: &State) {
    let part = (state.ticks as u32 / (SAMPLE_RATE_HZ / PARTS)) % PARTS;
    for light in Board::LIGHTS {
        light.set(light.pattern(state) >> part & 1 == 1);
    }
}
