//! The board's lights: whether it is safe, armed, closed or stopped by a fault, without any program.
//!
//! Not in the control interrupt: a light that is a hundredth of a second late is seen as well. What each light
//! does in each state stands in the board's description ([`Platform::LIGHTS`]).

use embassy_stm32::pac::gpio::vals::Moder;
use hysteron_core::amplifier::Mode;

use crate::board::light::Light;
use crate::board::{Board, Platform, SAMPLE_RATE_HZ};
use crate::control::State;

/// Parts of a second that a pattern has.
const PARTS: u32 = 8;

fn pattern(light: &Light, state: &State) -> u8 {
    match state.status.mode {
        Mode::Fault => light.fault,
        Mode::Closed => light.closed,
        Mode::Rest | Mode::Playing if state.powered => light.armed,
        Mode::Rest | Mode::Playing => light.safe,
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
        light.set(pattern(light, state) >> part & 1 == 1);
    }
}
