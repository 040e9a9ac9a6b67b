//! The built-in shapes of `WAV`, point by point.
//!
//! | type | shape (amplitude `a` on offset `o`) |
//! |---|---|
//! | `SIN_P` | `o + a/2 (1 - cos)`, up to the curve's centre point and down behind it |
//! | `RAMP` | a line up to the centre point and one down, with parabolic speed-up and slow-down |
//! | `LIN` | one line up, the same way; behind it the curve stays up |
//!
//! A segment may be longer than its curve: in front of the start point, and behind a curve that comes down,
//! the offset stays.

use hysteron_core::reference_generator::sine;

/// The kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// `SIN_P`.
    Sine,
    /// `RAMP`.
    Ramp,
    /// `LIN`.
    Line,
}

/// A segment of a wave table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Its kind.
    pub shape: Shape,
    /// Points in all.
    pub length: u32,
    /// Points in front of the curve.
    pub start: u32,
    /// Points of the curve.
    pub curve_length: u32,
    /// Points of the curve up to its highest.
    pub centre: u32,
    /// Points of a speed-up or slow-down.
    pub speed_up: u32,
    /// Height of the curve, as a point of a wave table.
    pub amplitude: i32,
    /// Where it begins, as a point of a wave table.
    pub offset: i32,
}

/// One with 30 fraction bits.
const ONE: i64 = 1 << 30;
/// More points than any table has: with fewer no product here leaves 64 bits.
pub const MOST_POINTS: u32 = 1 << 15;

impl Segment {
    /// Whether its numbers go together.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        let (rise, fall) = (self.centre, self.curve_length.saturating_sub(self.centre));
        let rounded = |length: u32| length == 0 || self.speed_up.saturating_mul(2) <= length;
        let sides = match self.shape {
            Shape::Sine => true,
            Shape::Ramp => rounded(rise) && rounded(fall),
            Shape::Line => rounded(self.curve_length),
        };
        let fits = self
            .start
            .checked_add(self.curve_length)
            .is_some_and(|end| end <= self.length);
        (1..MOST_POINTS).contains(&self.length)
            && self.curve_length > 0
            && self.centre <= self.curve_length
            && fits
            && sides
    }

    /// A point of the table.
    #[must_use]
    pub fn point(&self, nth: u32) -> i32 {
        let Some(along) = nth.checked_sub(self.start) else {
            return self.offset;
        };
        let share = match self.shape {
            Shape::Line => self.line(along, self.curve_length),
            _ if along >= self.curve_length => 0,
            _ if along < self.centre => self.rise(along, self.centre),
            _ => {
                ONE - self.rise(
                    along - self.centre,
                    self.curve_length.saturating_sub(self.centre),
                )
            }
        };
        let above = (i64::from(self.amplitude) * share) >> 30;
        i32::try_from(i64::from(self.offset) + above).unwrap_or(self.offset)
    }

    /// The share of the height, with 30 fraction bits, `along` points up a side of `length` points.
    fn rise(&self, along: u32, length: u32) -> i64 {
        if self.shape == Shape::Sine {
            // (1 - cos(pi x)) / 2, and cos is the sine a quarter turn later.
            let half_turn = (u64::from(along) << 31)
                .checked_div(u64::from(length))
                .unwrap_or(0) as u32;
            return (ONE - i64::from(sine(half_turn.wrapping_add(1 << 30)))) / 2;
        }
        self.line(along, length)
    }

    /// A line with parabolic ends: the integral of a trapezium.
    fn line(&self, along: u32, length: u32) -> i64 {
        let (x, n, s) = (
            i64::from(along.min(length)),
            i64::from(length),
            i64::from(self.speed_up),
        );
        // Twice the area of the whole trapezium times `s`, so that everything is whole.
        let parabola = |x: i64| (x * x * (ONE >> 1)).checked_div(s * (n - s)).unwrap_or(0);
        if x < s {
            parabola(x)
        } else if x <= n - s {
            ((2 * x - s) * (ONE >> 1)).checked_div(n - s).unwrap_or(0)
        } else {
            ONE - parabola(n - x)
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    const SEGMENT: Segment = Segment {
        shape: Shape::Sine,
        length: 2000,
        start: 0,
        curve_length: 2000,
        centre: 1000,
        speed_up: 0,
        amplitude: 20 << 24,
        offset: 10 << 24,
    };

    fn um(segment: &Segment) -> Vec<f64> {
        (0..segment.length)
            .map(|nth| f64::from(segment.point(nth)) / 16_777_216.0)
            .collect()
    }

    #[test]
    fn a_sine_goes_from_the_offset_to_the_amplitude_above_it_and_back() {
        let points = um(&SEGMENT);
        for (nth, point) in points.iter().enumerate() {
            let exact = 10.0 + 10.0 * (1.0 - (core::f64::consts::TAU * nth as f64 / 2000.0).cos());
            assert!((point - exact).abs() < 1e-6, "{nth}: {point} {exact}");
        }
        let late = um(&Segment {
            length: 300,
            start: 50,
            curve_length: 200,
            centre: 40,
            ..SEGMENT
        });
        assert_eq!(
            (late[0], late[49], late[250], late[299]),
            (10.0, 10.0, 10.0, 10.0)
        );
        assert!((late[90] - 30.0).abs() < 1e-6 && late[89] < late[90] && late[91] < late[90]);
    }

    #[test]
    fn lines_begin_and_end_without_a_jump_of_the_velocity() {
        let line = Segment {
            shape: Shape::Line,
            length: 1000,
            start: 100,
            curve_length: 800,
            speed_up: 200,
            ..SEGMENT
        };
        let points = um(&line);
        assert_eq!(
            (points[0], points[100], points[900], points[999]),
            (10.0, 10.0, 30.0, 30.0)
        );
        let changes: Vec<f64> = points.windows(2).map(|pair| pair[1] - pair[0]).collect();
        // Twenty um over 600 points of full speed.
        let fastest = 20.0 / 600.0;
        assert!(
            changes
                .iter()
                .all(|change| (-1e-6..fastest + 1e-6).contains(change))
        );
        assert!((changes[500] - fastest).abs() < 1e-6);
        assert!(
            changes
                .windows(2)
                .all(|pair| (pair[1] - pair[0]).abs() < 1.01 * fastest / 200.0 + 1e-6)
        );
        let ramp = um(&Segment {
            shape: Shape::Ramp,
            speed_up: 100,
            ..SEGMENT
        });
        assert!((ramp[1000] - 30.0).abs() < 1e-6);
        assert!((ramp[500] - 20.0).abs() < 1e-6 && (ramp[1500] - 20.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn every_consistent_segment_stays_between_its_ends(
            shape in prop_oneof![Just(Shape::Sine), Just(Shape::Ramp), Just(Shape::Line)],
            length in 1u32..6000, start in 0u32..6000, curve_length in 1u32..6000, centre in 0u32..6000, speed_up in 0u32..3000,
            amplitude in -(30i32 << 24)..(30 << 24), offset in -(30i32 << 24)..(30 << 24), nth in 0u32..7000,
        ) {
            let segment = Segment { shape, length, start, curve_length, centre, speed_up, amplitude, offset };
            let point = segment.point(nth);
            if segment.is_consistent() {
                let (a, b) = (offset, offset + amplitude);
                prop_assert!((a.min(b) - 8..=a.max(b) + 8).contains(&point), "{point} {segment:?}");
            }
        }
    }
}
