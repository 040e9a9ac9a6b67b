//! The last limit before the drive's converter: range and slew of the safety envelope, whatever block, law
//! and mode say.
//!
//! # How it works
//! [`OutputLimit::pass`] gives the code nearest to the one that is wanted that lies within the range and no
//! further from the one before than the slew limit. What it changes is a fault of the program in front of it:
//! a block within the envelope never asks for that.

use crate::codes::DriveCode;
use crate::parameter_block::AmplifierParameters;
use crate::safety_envelope::SafetyEnvelope;
use crate::servo_parameters::ConverterParameters;

/// The limits, and the code that acts.
#[derive(Clone, Debug)]
pub struct OutputLimit {
    lowest: DriveCode,
    highest: DriveCode,
    slew_codes: u32,
    last: DriveCode,
}

impl OutputLimit {
    /// Those of an envelope in the codes of a block; it begins at the block's rest.
    #[must_use]
    pub fn new(envelope: &SafetyEnvelope, parameters: &AmplifierParameters) -> Self {
        let (lowest, highest) = envelope.limits_of(parameters.servo.converters.dac_bits);
        Self {
            lowest,
            highest,
            slew_codes: envelope.slew_codes(parameters),
            last: parameters.guard.rest_code,
        }
    }

    /// Range and slew of a block's converters, where no envelope is narrower; it begins at `rest`.
    #[must_use]
    pub fn of_converters(converters: &ConverterParameters, rest: DriveCode) -> Self {
        Self {
            lowest: converters.dac_code_min,
            highest: converters.dac_code_max,
            slew_codes: converters.slew_codes,
            last: rest,
        }
    }

    /// The code that may act, and whether it is another one than the one that was wanted.
    #[inline]
    pub fn pass(&mut self, wanted: DriveCode) -> (DriveCode, bool) {
        let within = wanted.max(self.lowest).min(self.highest);
        // The envelope's own rest may lie outside of its range by the rounding of a block's bits: the way
        // back is no faster either.
        let near = within
            .max(self.last - self.slew_codes)
            .min(self.last + self.slew_codes);
        self.last = near;
        (near, near != wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limit([lowest, highest, slew_codes, last]: [u32; 4]) -> OutputLimit {
        OutputLimit {
            lowest: DriveCode::new(lowest),
            highest: DriveCode::new(highest),
            slew_codes,
            last: DriveCode::new(last),
        }
    }

    /// One tick from every code, whatever is asked for: no further than the slew limit, inside the range or
    /// nearer to it, and from inside it untouched where both allow it. What holds for one tick from any code
    /// holds for every sequence of them.
    fn passes(limits: [u32; 4], wanted: u32) {
        let [lowest, highest, slew, last] = limits;
        let mut limit = limit(limits);
        let (code, changed) = limit.pass(DriveCode::new(wanted));
        let code = code.steps();
        let outside = |code: u32| code.max(lowest).min(highest).abs_diff(code);
        let may = outside(wanted) == 0 && wanted.abs_diff(last) <= slew;
        assert!(
            code.abs_diff(last) <= slew
                && outside(code) <= outside(last).saturating_sub(slew)
                && changed == (code != wanted)
                && (outside(last) > 0 || changed != may)
                && limit.last.steps() == code,
            "{limits:?}: {wanted} becomes {code}"
        );
    }

    /// The code that acts is one of five numbers, chosen by their order: codes of 4 bits have every order of
    /// them, and the ends of 20 bits every sum that could leave its format.
    #[test]
    fn no_code_leaves_range_or_slew() {
        let each = |codes: &[u32]| {
            for lowest in codes {
                for highest in codes.iter().filter(|highest| *highest > lowest) {
                    for (slew, last) in codes.iter().flat_map(|s| codes.iter().map(move |l| (s, l)))
                    {
                        for wanted in codes {
                            passes([*lowest, *highest, *slew, *last], *wanted);
                        }
                    }
                }
            }
        };
        each(&core::array::from_fn::<u32, 16, _>(|code| code as u32));
        let most = DriveCode::MOST.steps();
        each(&[0, 1, 2, most / 2, most - 2, most - 1, most]);
    }
}
