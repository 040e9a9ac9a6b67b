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
    use crate::parameter_block::tests::example;
    use crate::safety_envelope::tests::envelope;
    use proptest::prelude::*;

    proptest! {
        /// Whatever is asked for: the range and the slew limit hold, and what is within both is not touched.
        #[test]
        fn no_code_leaves_range_or_slew(wanted in prop::collection::vec(0u32..1 << 20, 1..200)) {
            let (parameters, envelope) = (example(), envelope());
            let (lowest, highest) = envelope.limits_of(parameters.servo.converters.dac_bits);
            let slew = envelope.slew_codes(&parameters);
            let mut limit = OutputLimit::new(&envelope, &parameters);
            let mut last = parameters.guard.rest_code;
            for wanted in wanted.into_iter().map(|steps| DriveCode::new(steps % 70_000)) {
                let (code, changed) = limit.pass(wanted);
                prop_assert!((lowest..=highest).contains(&code) && code.abs_diff(last) <= slew);
                let allowed = (lowest..=highest).contains(&wanted) && wanted.abs_diff(last) <= slew;
                prop_assert_eq!((code == wanted, changed), (allowed, !allowed));
                last = code;
            }
        }
    }
}
