//! Straightens the sensor: what its codes have to be corrected by to be proportional to the position.
//!
//! # How it works
//! The board's safety envelope has the correction at sixteenths of the sensor's codes, found with a better
//! sensor beside it. Between them it goes in straight lines. The first and the last code keep their values, so
//! that a sensor at its end is still seen to be there. The board corrects every reading before anything looks
//! at it: guards, servo and trace see a straight sensor.

use crate::codes::SensorCode;

/// Corrections: at every sixteenth of the codes but the ends.
pub const POINTS: usize = 15;
/// Largest difference of two neighbours, of the 4,096 codes between them: no sensor of a positioning stage
/// bends more than a quarter, and codes stay in their order.
const MOST_DIFFERENCE: u16 = 1_024;
const SEGMENT_BITS: u8 = 4;
/// Fraction bits of a correction in steps of the codes.
const FRACTION_BITS: u8 = 8;

/// Whether no two neighbours differ by more than a quarter of the codes between them.
#[must_use]
pub fn is_moderate(corrections: &[i16; POINTS]) -> bool {
    let mut before = 0;
    corrections.iter().chain(&[0]).all(|correction| {
        let moderate = correction.abs_diff(before) <= MOST_DIFFERENCE;
        before = *correction;
        moderate
    })
}

/// A sensor's correction for codes of some bits.
#[derive(Clone, Debug)]
pub struct SensorLinearisation {
    /// At each sixteenth and the ends, steps of the codes with [`FRACTION_BITS`].
    corrections: [i32; POINTS + 2],
    bits: u8,
}

impl SensorLinearisation {
    /// From corrections in codes of 65,536; nothing where all are zero.
    #[must_use]
    pub fn new(of_65_536: &[i16; POINTS], bits: u8) -> Option<Self> {
        let mut corrections = [0; POINTS + 2];
        for (to, from) in corrections.iter_mut().skip(1).zip(of_65_536) {
            *to = i32::from(*from) << bits.saturating_sub(16 - FRACTION_BITS);
        }
        of_65_536
            .iter()
            .any(|correction| *correction != 0)
            .then_some(Self { corrections, bits })
    }

    /// A code as a straight sensor gives it.
    #[inline]
    #[must_use]
    pub fn straighten(&self, code: SensorCode) -> SensorCode {
        let shift = u32::from(self.bits.saturating_sub(SEGMENT_BITS));
        let steps = code.steps();
        let segment = (steps >> shift) as usize & 15;
        let within = i64::from(steps & ((1 << shift) - 1));
        let (low, high) = (self.corrections[segment], self.corrections[segment + 1]);
        let correction = low + ((i64::from(high - low) * within) >> shift) as i32;
        let rounded = (correction + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS;
        let highest = SensorCode::highest(self.bits).steps() as i32;
        SensorCode::new((steps as i32 + rounded).max(0).min(highest) as u32)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;

    fn corrections() -> impl Strategy<Value = [i16; POINTS]> {
        prop::array::uniform15(-512i16..=512)
    }

    proptest! {
        #[test]
        fn codes_stay_in_their_order_and_the_ends_where_they_are(
            of_65_536 in corrections(), bits in 8u8..=20, at in any::<u32>(),
        ) {
            prop_assert!(is_moderate(&of_65_536));
            let Some(table) = SensorLinearisation::new(&of_65_536, bits) else {
                return Ok(());
            };
            let highest = SensorCode::highest(bits);
            let straight = |steps: u32| table.straighten(SensorCode::new(steps));
            let at = at % highest.steps();
            prop_assert!(straight(at) <= straight(at + 1));
            prop_assert!(straight(0) == SensorCode::new(0));
            prop_assert!(straight(highest.steps()).abs_diff(highest) <= 1);
        }
    }

    #[test]
    fn a_bent_sensor_is_straight_to_a_step() {
        // The position is the share of the codes plus 2 % of a parabola, which a reading lacks.
        let bend = |share: f64| 0.02 * 4.0 * share * (1.0 - share);
        for bits in [12, 16, 18, 20] {
            let codes = f64::from(1u32 << bits);
            let mut of_65_536 = [0; POINTS];
            for (nth, point) in (1..).zip(&mut of_65_536) {
                *point = (bend(f64::from(nth) / 16.0) * 65_536.0).round() as i16;
            }
            let table = SensorLinearisation::new(&of_65_536, bits).expect("bent");
            let worst = (0..1000)
                .map(|nth| {
                    let steps = (f64::from(nth) / 1000.0 * codes) as u32;
                    let wanted = f64::from(steps) + bend(f64::from(steps) / codes) * codes;
                    (f64::from(table.straighten(SensorCode::new(steps))) - wanted).abs()
                })
                .fold(0.0, f64::max);
            // Chords of the parabola are 0.02 / 256 of the codes below it, and a point and a step are rounded.
            let most = (0.02 / 256.0 + 0.5 / 65_536.0) * codes + 0.6;
            assert!(worst < most, "{bits}: {worst} of {most}");
        }
    }

    #[test]
    fn a_sensor_without_a_correction_has_no_table_and_a_steep_one_is_refused() {
        assert!(SensorLinearisation::new(&[0; POINTS], 16).is_none());
        let mut steep = [0; POINTS];
        steep[14] = 1_025;
        assert!(!is_moderate(&steep));
        steep[14] = 1_024;
        assert!(is_moderate(&steep));
    }
}
