//! Whether a closed loop has the margin for what changes it on the board: a filter of the sensor, the gain
//! that is adapted, and both together under another block. Not for the tick: in floats, as the telemetry.
//!
//! # How it works
//! A block says in [`LoopBands`] how much of its sensor's noise the loop passes on, `|T|`, largest in each
//! half-octave. With a filter `F` in the reading and a gain `1/c` the open loop `L` becomes `L F / c`, and
//!
//! `1 + L F / c = (1 + L) (1 + T (F / c - 1))`.
//!
//! `F` is stable, so the loop stays stable as long as `|T| |F / c - 1| < 1` at every frequency (small gain:
//! the second factor does not turn around zero). Half of that is asked for ([`MOST_CHANGE`]): the
//! sensitivity is nowhere more than twice the design's, and with `|T|` up to 2 a gain that is another 20 %
//! off does not take the other half (`1.2 * 0.5 + 0.2 * 2 = 1`).
//!
//! Every section has `|F| <= 1`, so the deviations of a chain are at most the sum of its sections'. With
//! `x = tan(w / 2)` that of a low-pass with its corner at `x_c` is, with `v = (x / x_c)^2`,
//! `sqrt((2 v + v^2) / (1 + v^2))`, which rises up to `v` = [`WORST_SQUARE`]. That of a notch at `x_0` of the
//! width `B` is `k / sqrt(1 + k^2)`, `k = tan(B / 2) x (1 + x_0^2) / (x_0^2 - x^2)`, which rises up to the
//! notch and falls behind it. So the edges of a band show the largest deviation within it.

use crate::filter_design::{FilterSetting, SectionTangents};
use crate::gain_adaptation::ONE as ONE_GAIN;
use crate::loop_bands::{BAND_FRACTION_BITS, BANDS, LoopBands};
use crate::loop_telemetry::square_root;
use crate::parameter_block::AmplifierParameters;
use crate::servo_parameters::LawParameters;
use crate::signal_filter::{Place, SECTIONS};

/// Largest `|T| |F / c - 1|`.
const MOST_CHANGE: f32 = 0.5;
/// `tan(w / 2)` at the lower end of each band but the last: `tan(pi / 2 * 2^(-n / 2))`, n from 1.
const EDGES: [f32; BANDS - 1] = [
    2.0179887, 1., 0.6205049, 0.4142136, 0.2850444, 0.1989124, 0.1397391, 0.0984914, 0.0695318,
    0.0491268, 0.034724, 0.0245486, 0.0173568, 0.0122725, 0.0086777, 0.006136, 0.0043388, 0.003068,
    0.0021694,
];
/// `(1 + sqrt(5)) / 2`, where the deviation of a low-pass is largest.
const WORST_SQUARE: f32 = 1.618_034;

/// What a filter of the sensor is refused with.
pub const NO_MARGIN: &str =
    "the loop of this block has no margin left for the filter of the sensor";

/// What a block leaves for filters of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopMargin {
    bands: LoopBands,
    /// The most that the adapted gain changes the loop, `|1/c - 1|`.
    gain: f32,
    sample_rate_hz: u32,
}

impl LoopMargin {
    /// Whether the loop has the margin for a filter of its sensor, beside the gain that it adapts.
    ///
    /// # Errors
    /// [`NO_MARGIN`].
    pub fn bears(&self, sensor: &FilterSetting) -> Result<(), &'static str> {
        let mut sections = [None; SECTIONS];
        for (section, place) in sections.iter_mut().zip(Place::ALL) {
            *section = sensor.tangents(place, self.sample_rate_hz)?;
        }
        let mut bands = self.bands.transmission.iter().enumerate();
        let bears = bands.all(|(band, transmission)| {
            let edge = |nth: usize| EDGES.get(nth).copied();
            let (low, high) = (edge(band), band.checked_sub(1).and_then(edge));
            let filter: f32 = sections
                .iter()
                .flatten()
                .map(|section| deviation(section, low, high))
                .sum();
            // F/c - 1 = (F - 1) / c + (1/c - 1)
            let change = filter * (1.0 + self.gain) + self.gain;
            let passed = f32::from(*transmission) / (1u32 << BAND_FRACTION_BITS) as f32;
            passed * change <= MOST_CHANGE
        });
        if bears { Ok(()) } else { Err(NO_MARGIN) }
    }
}

/// The largest deviation of a section in a band between two tangents (`None`: zero, or half the sampling
/// rate).
#[inline(never)]
fn deviation(section: &SectionTangents, low: Option<f32>, high: Option<f32>) -> f32 {
    // The square is above / (above + below).
    let (above, below) = match *section {
        SectionTangents::LowPass { corner } => {
            let v = high.map_or(WORST_SQUARE, |x| {
                let ratio = x / corner;
                (ratio * ratio).min(WORST_SQUARE)
            });
            (2.0 * v + v * v, 1.0 - 2.0 * v)
        }
        SectionTangents::Notch { centre, width } => {
            let nearest = match (low, high) {
                (Some(low), _) if low > centre => low,
                (_, Some(high)) if high < centre => high,
                _ => return 1.0,
            };
            let above = width * nearest * (1.0 + centre * centre);
            let below = (centre - nearest) * (centre + nearest);
            (above * above, below * below)
        }
    };
    square_root(above / (above + below))
}

impl AmplifierParameters {
    /// Whether a block that closes a loop has its bands: at its lowest frequencies a loop passes something on.
    pub(crate) fn knows_its_loop(&self) -> bool {
        let lowest = self.loop_bands.transmission.last();
        matches!(self.servo.law, LawParameters::Hold) || lowest.is_some_and(|low| *low > 0)
    }

    /// What the loop of this block leaves for filters of the sensor.
    #[must_use]
    pub fn loop_margin(&self) -> LoopMargin {
        // |1/c - 1| with c from 1 - m on: m / (1 - m).
        let gain = self.servo.adaptation.map_or(0.0, |bounds| {
            bounds.most as f32 / (ONE_GAIN - bounds.most).max(1) as f32
        });
        LoopMargin {
            bands: self.loop_bands,
            gain,
            sample_rate_hz: self.physical.sample_rate_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::filter_design::Notch;
    use crate::gain_adaptation::AdaptationParameters;
    use crate::parameter_block::tests::example;
    use crate::signal_filter::SECTION_FRACTION_BITS;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};
    use std::vec::Vec;

    /// `F` of a setting at a frequency, as a share of half the sampling rate: real and imaginary part.
    fn response(setting: &FilterSetting, share: f64) -> (f64, f64) {
        let times = |(a, b): (f64, f64), (c, d): (f64, f64)| (a * c - b * d, a * d + b * c);
        let delayed = |ticks: f64| ((ticks * PI * share).cos(), -(ticks * PI * share).sin());
        Place::ALL.iter().fold((1.0, 0.0), |all, place| {
            let row = setting.row(*place, 20_000).expect("accepted");
            let [b0, b1, b2, a1, a2] = row
                .coefficients
                .map(|c| f64::from(c) / f64::from(1 << SECTION_FRACTION_BITS));
            let (one, two) = (delayed(1.0), delayed(2.0));
            let over = (b0 + b1 * one.0 + b2 * two.0, b1 * one.1 + b2 * two.1);
            let under = (1.0 - a1 * one.0 - a2 * two.0, -a1 * one.1 - a2 * two.1);
            let size = under.0.powi(2) + under.1.powi(2);
            times(all, times(over, (under.0 / size, -under.1 / size)))
        })
    }

    fn setting() -> impl Strategy<Value = FilterSetting> {
        let notch = (10_000u32..9_000_000, 1_000u32..5_000_000).prop_map(
            |(frequency_millihertz, width_millihertz)| Notch {
                frequency_millihertz,
                width_millihertz,
            },
        );
        let notch = prop_oneof![Just(Notch::OFF), notch];
        let low_pass = prop_oneof![Just(0u32), 10_000u32..9_000_000];
        (notch.clone(), notch, low_pass).prop_map(|(one, two, low_pass_millihertz)| FilterSetting {
            notches: [one, two],
            low_pass_millihertz,
        })
    }

    fn with_bands(transmission: [u8; BANDS]) -> AmplifierParameters {
        AmplifierParameters {
            loop_bands: LoopBands { transmission },
            ..example()
        }
    }

    #[test]
    fn edges_are_tangents_of_half_octaves() {
        for (nth, edge) in EDGES.iter().enumerate() {
            let share = 2f64.powf(-0.5 * (nth + 1) as f64);
            let exact = (FRAC_PI_2 * share).tan();
            assert!(
                (f64::from(*edge) / exact - 1.0).abs() < 1e-4,
                "{nth}: {exact}"
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(400) })]

        /// What is accepted changes no loop by more than a half at any frequency, whatever loop has these
        /// bands.
        #[test]
        fn what_is_accepted_keeps_half_the_margin(
            setting in setting(),
            transmission in prop::array::uniform20(0u8..64),
            most in 0i32..=crate::gain_adaptation::MOST,
        ) {
            let mut parameters = with_bands(transmission);
            parameters.servo.adaptation = (most > 0).then_some(AdaptationParameters {
                most,
                ..crate::parameter_block::tests::ADAPTATION_EXAMPLE
            });
            prop_assume!(parameters.loop_margin().bears(&setting).is_ok());
            let belief = f64::from(most) / f64::from(ONE_GAIN);
            let shares: Vec<f64> = (0..2_000).map(|k| 2f64.powf(-f64::from(k) / 200.0)).collect();
            for share in shares {
                let band = ((-2.0 * share.log2()) as usize).min(BANDS - 1);
                let passed = f64::from(transmission[band]) / f64::from(1 << BAND_FRACTION_BITS);
                let (re, im) = response(&setting, share.min(0.999_999));
                for gain in [1.0 / (1.0 - belief), 1.0, 1.0 / (1.0 + belief)] {
                    let change = passed * ((re * gain - 1.0).hypot(im * gain));
                    prop_assert!(change <= 0.5 + 1e-3, "{change} at {share}");
                }
            }
        }
    }

    #[test]
    fn a_filter_far_above_a_loop_is_taken_and_one_within_it_is_not() {
        // A loop that follows up to 600 Hz: |T| of 1.2 there, 0.5 up to 1.2 kHz, 0.03 beyond.
        let parameters = with_bands(core::array::from_fn(|band| match band {
            0..=5 => 1,
            6 | 7 => 16,
            _ => 39,
        }));
        let with = |notch: (u32, u32), low_pass_hz: u32| {
            parameters.loop_margin().bears(&FilterSetting {
                notches: [
                    Notch {
                        frequency_millihertz: notch.0 * 1000,
                        width_millihertz: notch.1 * 1000,
                    },
                    Notch::OFF,
                ],
                low_pass_millihertz: low_pass_hz * 1000,
            })
        };
        assert_eq!(with((0, 0), 200), Err(NO_MARGIN));
        assert_eq!(with((300, 300), 0), Err(NO_MARGIN));
        assert_eq!(with((300, 3), 0), Err(NO_MARGIN));
        assert_eq!(with((4_000, 200), 8_000), Ok(()));
        assert!(with((10_000, 200), 0).is_err(), "no such notch");
        assert_eq!(with((0, 0), 0), Ok(()));
    }

    #[test]
    fn a_gain_that_a_loop_cannot_bear_is_not_adapted() {
        let mut parameters = with_bands([65; BANDS]);
        assert_eq!(parameters.loop_margin().bears(&FilterSetting::OFF), Ok(()));
        parameters.servo.adaptation = Some(AdaptationParameters {
            most: crate::gain_adaptation::MOST,
            ..crate::parameter_block::tests::ADAPTATION_EXAMPLE
        });
        // Just beyond 2, of which a quarter is a half.
        assert_eq!(
            parameters.loop_margin().bears(&FilterSetting::OFF),
            Err(NO_MARGIN)
        );
    }
}
