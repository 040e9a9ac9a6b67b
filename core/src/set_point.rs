//! The analogue set point: a voltage at an input of the board that the closed loop follows.
//!
//! # How it works
//! The board's safety envelope says which position a code of the input is, and between which positions it may
//! lead ([`SetPointParameters`]). [`SetPoint::follow`] holds the wanted position within them and within what
//! the sensor can show, and goes there no faster than it was begun with: from the reference that was in force,
//! so nothing steps. What it gives passes the filters of the set point and the limits of every reference.
//!
//! A code within [`MARGIN`] of the converter's ends is an input that is open or shorted: a resistor to ground
//! brings an open one there, and the wiring keeps honest voltages away. That is a fault, as is a converter
//! that does not answer.

use crate::guard::Fault;
use crate::output_monitor::MARGIN;
use crate::signal::{MICROMETRE_FRACTION_BITS, Micrometres};

/// How the input is wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPointParameters {
    /// Position at code 0, um with 24 fraction bits.
    pub zero: i32,
    /// Position per code of 65,536, um with 40 fraction bits.
    pub step: i64,
    /// Lowest position that it may lead to, um with 24 fraction bits.
    pub lowest: i32,
    /// Highest one.
    pub highest: i32,
}

impl SetPointParameters {
    /// From the scale and the limits in nm.
    #[must_use]
    pub fn new(at_code_0_nm: i32, span_nm: u32, lowest_nm: i32, highest_nm: i32) -> Self {
        Self {
            zero: nanometres(at_code_0_nm),
            // nm over 65,536 codes.
            step: (i64::from(span_nm) << 24) / 1000,
            lowest: nanometres(lowest_nm),
            highest: nanometres(highest_nm),
        }
    }
}

/// Held at the ends of its format, +-128 um: an envelope may name more.
#[inline]
fn held(value: i64) -> i32 {
    value.max(i32::MIN.into()).min(i32::MAX.into()) as i32
}

/// um with 24 fraction bits.
fn nanometres(value: i32) -> i32 {
    held((i64::from(value) << MICROMETRE_FRACTION_BITS) / 1000)
}

/// What the loop has of the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum InputState {
    /// It follows something else.
    Off = 0,
    /// It follows the input.
    Following = 1,
    /// The input asks for a position beyond the limits, and the loop goes to the limit.
    Limited = 2,
}

impl InputState {
    /// The one of a number.
    #[must_use]
    pub fn from_number(number: u8) -> Self {
        match number {
            1 => Self::Following,
            2 => Self::Limited,
            _ => Self::Off,
        }
    }
}

/// The input with what is followed of it.
#[derive(Clone, Debug)]
pub struct SetPoint {
    parameters: SetPointParameters,
    /// Limits of the envelope and of the sensor, um with 24 fraction bits.
    limits: (i32, i32),
    most_step: i32,
    value: i32,
    state: InputState,
}

impl SetPoint {
    /// Not followed.
    #[must_use]
    pub fn new(parameters: SetPointParameters) -> Self {
        Self {
            parameters,
            limits: (parameters.lowest, parameters.highest),
            most_step: 0,
            value: 0,
            state: InputState::Off,
        }
    }

    /// Follows it from a position on, by at most this in a tick, and within what the sensor can show.
    pub fn begin(
        &mut self,
        from: Micrometres,
        most_step: Micrometres,
        (lowest, highest): (Micrometres, Micrometres),
    ) {
        let p = &self.parameters;
        self.limits = (
            p.lowest.max(lowest.to_bits()),
            p.highest.min(highest.to_bits()),
        );
        self.most_step = most_step.to_bits().max(1);
        self.value = from.to_bits();
        self.state = InputState::Following;
    }

    /// Follows it no longer.
    pub fn end(&mut self) {
        self.state = InputState::Off;
    }

    /// What the loop has of it.
    #[must_use]
    pub fn state(&self) -> InputState {
        self.state
    }

    /// The reference of this tick, from what the input read during the last period (`None`: its converter did
    /// not answer); nothing while it is not followed.
    ///
    /// # Errors
    /// [`Fault::SetPointOpen`].
    #[inline]
    pub fn follow(&mut self, code: Option<u16>) -> Result<Option<Micrometres>, Fault> {
        if self.state == InputState::Off {
            return Ok(None);
        }
        let code = code
            .filter(|code| (MARGIN..=u16::MAX - MARGIN).contains(code))
            .ok_or(Fault::SetPointOpen)?;
        let p = &self.parameters;
        let wanted = held(i64::from(p.zero) + ((i64::from(code) * p.step) >> 16));
        let (lowest, highest) = self.limits;
        let within = wanted.max(lowest).min(highest);
        self.state = if within == wanted {
            InputState::Following
        } else {
            InputState::Limited
        };
        self.value = within
            .max(self.value.saturating_sub(self.most_step))
            .min(self.value.saturating_add(self.most_step));
        Ok(Some(Micrometres::from_bits(self.value)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// -1 to 14 um over the codes, of which 0 to 10 um may be reached.
    fn parameters() -> SetPointParameters {
        SetPointParameters::new(-1_000, 15_000, 0, 10_000)
    }

    fn um(value: f64) -> Micrometres {
        Micrometres::from_bits((value * f64::from(1 << 24)) as i32)
    }

    fn begun(from: f64, most_step: f64) -> SetPoint {
        let mut input = SetPoint::new(parameters());
        input.begin(um(from), um(most_step), (um(-0.9), um(13.9)));
        input
    }

    #[test]
    fn a_code_is_the_position_that_the_envelope_says() {
        let mut input = begun(5.0, 20.0);
        let middle = input.follow(Some(1 << 15)).expect("honest").expect("on");
        assert!((middle - um(6.5)).abs() <= um(1e-6), "{middle}");
        assert_eq!(input.state(), InputState::Following);
        assert_eq!(input.follow(Some(60_000)), Ok(Some(um(10.0))));
        assert_eq!(input.state(), InputState::Limited);
        assert_eq!(input.follow(Some(100)), Ok(Some(um(0.0))));
    }

    #[test]
    fn an_input_that_is_open_or_silent_is_a_fault_only_while_it_is_followed() {
        for code in [None, Some(0), Some(MARGIN - 1), Some(u16::MAX)] {
            let mut input = begun(5.0, 1.0);
            assert_eq!(input.follow(code), Err(Fault::SetPointOpen));
            input.end();
            assert_eq!(input.follow(code), Ok(None));
        }
    }

    proptest! {
        #[test]
        fn it_never_leaves_its_limits_and_never_steps(
            from in 0.0..10.0f64, most_step in 1e-6..2.0f64, codes in proptest::collection::vec(16..65_520u16, 1..200),
        ) {
            let (mut input, mut before) = (begun(from, most_step), um(from));
            for code in codes {
                let now = input.follow(Some(code)).expect("honest").expect("on");
                prop_assert!((um(0.0)..=um(10.0)).contains(&now));
                prop_assert!((now - before).abs() <= um(most_step).max(Micrometres::from_bits(1)));
                before = now;
            }
        }
    }
}
