//! References made on the target, sample by sample, in integers: the same samples on every machine.
//!
//! A phase of 32 bits per turn drives a polynomial sine (error below 2e-8 of the amplitude: far below the
//! sensor, and far better than a fast single-precision sine). Rounded triangles are the sine's own series to
//! its third term, the quasi-step is the thesis' quintic (Ch. 6, Eq. 44). Points that the host sends are a
//! waveform of their own ([`crate::wave_table`]).

use crate::signal::{Quantity, narrow};
use crate::wave_table::{TablePlayer, WaveTable};

/// `sin(2 pi phase / 2^32)` with 30 fraction bits.
#[must_use]
pub fn sine(phase: u32) -> i32 {
    // Quarter-wave: fold to x in -1..1 of a quarter turn, 30 fraction bits.
    let folded = phase.wrapping_add(1 << 30);
    let half = (folded & 0x7fff_ffff) as i32; // 0..2^31 is half a turn
    let x = half.wrapping_sub(1 << 30); // -2^30..2^30 is -1..1 quarter turns
    let x2 = scaled(x, x);
    let mut sum = 0i32;
    for c in SINE_SERIES.iter().rev() {
        // Stays below pi/2 with 30 fraction bits.
        sum = scaled(sum, x2).wrapping_add(*c);
    }
    let value = scaled(sum, x);
    if folded & 0x8000_0000 == 0 {
        value
    } else {
        value.wrapping_neg()
    }
}

/// `(-1)^k (pi/2)^(2k+1) / (2k+1)!` with 30 fraction bits.
const SINE_SERIES: [i32; 8] = [
    1_686_629_713,
    -693_598_668,
    85_569_306,
    -5_026_995,
    172_272,
    -3_864,
    61,
    -1,
];

/// Samples of one sweep.
pub const SWEEP_TICKS: u32 = 4096;
/// Where a sweep ends, in 1024ths of the sampling rate: 9.6 kHz at 20 kHz.
const SWEEP_HIGHEST_SHARE: u32 = 492;
/// What the phase increment of a sweep gains at every sample.
const SWEEP_GAIN: u32 = SWEEP_HIGHEST_SHARE * (u32::MAX / 1024 / SWEEP_TICKS);
/// Phase of a sine at its lowest point.
pub const LOWEST_POINT: u32 = 0xc000_0000;

/// A sample of a sweep over nearly all frequencies, which begins at its lowest point and anew every
/// [`SWEEP_TICKS`].
#[must_use]
pub fn sweep(amplitude: i32, tick: u32) -> i32 {
    // The phase is the sum of the increments: 0, 1, 2 .. times the gain.
    let since = tick % SWEEP_TICKS;
    let phase = SWEEP_GAIN.wrapping_mul(since.wrapping_mul(since.wrapping_sub(1)) / 2);
    scaled(amplitude, sine(phase.wrapping_add(LOWEST_POINT)))
}

/// What is followed or played, in the unit of `Q`: [`crate::signal::Micrometres`] or
/// [`crate::signal::Volts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waveform<Q> {
    /// Stays at the offset.
    Constant,
    /// Sines of given phase increments per sample (2^32 a turn), amplitudes and first phases.
    Multisine {
        /// Up to four tones `(increment, amplitude, first phase)`; unused ones have no amplitude.
        tones: [(u32, Q, u32); 4],
    },
    /// A triangle with rounded corners: three terms of its series with falling weights.
    RoundedTriangle {
        /// Phase increment per sample.
        increment: u32,
        /// Amplitude.
        amplitude: Q,
    },
    /// A sine whose frequency changes evenly.
    Chirp {
        /// Phase increment per sample at the beginning.
        increment: u32,
        /// Change of the increment at every sample, with 8 fraction bits.
        change: i32,
        /// Amplitude.
        amplitude: Q,
        /// Samples until the frequency stays.
        duration_ticks: u32,
    },
    /// The quasi-step of thesis Ch. 6, Eq. (44): a quintic with velocity and acceleration zero at both ends.
    QuasiStep {
        /// Height.
        height: Q,
        /// Samples before it begins.
        delay_ticks: u32,
        /// Samples that it takes.
        duration_ticks: u32,
    },
    /// The points of a table.
    Table(WaveTable<Q>),
}

impl<Q: Quantity> Waveform<Q> {
    /// Samples after which it repeats, but for what a phase increment loses to rounding or cutting off;
    /// `None` where it does not.
    #[must_use]
    pub fn period_ticks(&self) -> Option<u32> {
        match self {
            Self::Multisine { tones } => {
                let sounding = || {
                    tones
                        .iter()
                        .filter(|(_, amplitude, _)| amplitude.bits() != 0)
                        .map(|(increment, ..)| *increment)
                };
                let period = whole_period(sounding().min()?)?;
                sounding()
                    .all(|increment| returns_after(increment, period))
                    .then_some(period)
            }
            Self::RoundedTriangle { increment, .. } => {
                whole_period(*increment).filter(|period| returns_after(*increment, *period))
            }
            Self::Table(table) => table.period_ticks(),
            Self::Constant | Self::Chirp { .. } | Self::QuasiStep { .. } => None,
        }
    }
}

/// Samples in a turn, rounded.
fn whole_period(increment: u32) -> Option<u32> {
    let turn = (1u64 << 32).checked_add(u64::from(increment / 2))?;
    turn.checked_div(u64::from(increment))
        .and_then(|period| u32::try_from(period).ok())
}

/// Whether so many samples are whole turns but for a last place of the increment.
fn returns_after(increment: u32, period_ticks: u32) -> bool {
    let phase = increment.wrapping_mul(period_ticks);
    phase.min(phase.wrapping_neg()) <= period_ticks
}

/// Largest amplitude: a sine is wrong by up to 2e-8 of it, and must not leave the format.
const MOST_AMPLITUDE: i32 = i32::MAX - 1024;

impl<Q: Quantity> Waveform<Q> {
    /// Itself, with amplitudes whose samples stay within their format.
    fn within_format(mut self) -> Self {
        match &mut self {
            Self::Constant | Self::Table(_) => {}
            Self::Multisine { tones } => tones
                .iter_mut()
                .for_each(|(_, amplitude, _)| limit(amplitude)),
            Self::RoundedTriangle { amplitude, .. } | Self::Chirp { amplitude, .. } => {
                limit(amplitude)
            }
            Self::QuasiStep { height, .. } => limit(height),
        }
        self
    }
}

fn limit<Q: Quantity>(amplitude: &mut Q) {
    *amplitude = Q::of_bits(amplitude.bits().clamp(-MOST_AMPLITUDE, MOST_AMPLITUDE));
}

/// A reference or a drive that is generated sample by sample.
#[derive(Clone, Debug)]
pub struct ReferenceGenerator<Q> {
    waveform: Waveform<Q>,
    offset: Q,
    tick: u32,
    phase: u32,
    chirp_increment: i64,
    player: TablePlayer,
}

impl<Q: Quantity> ReferenceGenerator<Q> {
    /// From sample 0.
    #[must_use]
    pub fn new(waveform: Waveform<Q>, offset: Q) -> Self {
        let chirp_increment = match waveform {
            Waveform::Chirp { increment, .. } => i64::from(increment) << 8,
            _ => 0,
        };
        Self {
            waveform: waveform.within_format(),
            offset,
            tick: 0,
            phase: 0,
            chirp_increment,
            player: TablePlayer::default(),
        }
    }

    /// Of a constant: the samples from now on.
    #[inline]
    pub fn stay_at(&mut self, offset: Q) {
        self.offset = offset;
    }

    /// Whether the sample so many (0 to 31) before the last one belongs to the marked point of a table.
    #[inline]
    #[must_use]
    pub fn marked(&self, samples_ago: usize) -> bool {
        self.player.marked(samples_ago)
    }

    /// No sample is used any more.
    #[inline]
    pub fn forget_marks(&mut self) {
        self.player.forget_marks();
    }

    /// The next sample.
    pub fn next_value(&mut self) -> Q {
        let tick = self.tick;
        self.tick = self.tick.saturating_add(1);
        let value = match &self.waveform {
            Waveform::Constant => 0,
            Waveform::Multisine { tones } => {
                let mut sum = 0i32;
                for (increment, amplitude, first) in tones
                    .iter()
                    .filter(|(_, amplitude, _)| amplitude.bits() != 0)
                {
                    sum = sum.saturating_add(scaled(
                        amplitude.bits(),
                        sine(increment.wrapping_mul(tick).wrapping_add(*first)),
                    ));
                }
                sum
            }
            Waveform::RoundedTriangle {
                increment,
                amplitude,
            } => {
                let phase = increment.wrapping_mul(tick);
                // 1, -0.6/9, 0.25/25, divided by the sum's peak 1.076667.
                let series = i64::from(sine(phase)) * 997_283_428
                    + i64::from(sine(phase.wrapping_mul(3))) * -66_485_562
                    + i64::from(sine(phase.wrapping_mul(5))) * 9_972_834;
                narrow(((series >> 30) * i64::from(amplitude.bits())) >> 30)
            }
            Waveform::Chirp {
                change,
                amplitude,
                duration_ticks,
                ..
            } => {
                let value = scaled(amplitude.bits(), sine(self.phase));
                self.phase = self.phase.wrapping_add((self.chirp_increment >> 8) as u32);
                if tick < *duration_ticks {
                    self.chirp_increment = self.chirp_increment.wrapping_add(i64::from(*change));
                }
                value
            }
            Waveform::QuasiStep {
                height,
                delay_ticks,
                duration_ticks,
            } => {
                let elapsed = tick.saturating_sub(*delay_ticks).min(*duration_ticks);
                let share = (i64::from(elapsed) << 30)
                    .checked_div(i64::from(*duration_ticks))
                    .unwrap_or(1 << 30);
                // s^3 (10 - 15 s + 6 s^2)
                let cube = (((share * share) >> 30) * share) >> 30;
                let bracket = (10i64 << 30) - 15 * share + 6 * ((share * share) >> 30);
                scaled(height.bits(), narrow((cube * (bracket >> 4)) >> 26))
            }
            Waveform::Table(table) => self.player.next_point(table),
        };
        Q::of_bits(self.offset.bits().saturating_add(value))
    }
}

#[inline]
fn scaled(amplitude: i32, share: i32) -> i32 {
    narrow((i64::from(amplitude) * i64::from(share)) >> 30)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::signal::Micrometres;
    use std::vec::Vec;

    #[test]
    fn the_sine_is_a_sine() {
        for k in 0..4096u32 {
            let phase = k.wrapping_mul(1_048_583);
            let exact = (f64::from(phase) / 4_294_967_296.0 * core::f64::consts::TAU).sin();
            assert!(
                (f64::from(sine(phase)) / 1_073_741_824.0 - exact).abs() < 2e-8,
                "{phase}"
            );
        }
    }

    #[test]
    fn a_sweep_begins_at_its_lowest_point_and_has_power_at_every_frequency_up_to_its_end() {
        let samples: Vec<f64> = (0..SWEEP_TICKS)
            .map(|tick| f64::from(sweep(1 << 24, tick)) / f64::from(1 << 24))
            .collect();
        assert!((samples[0] + 1.0).abs() < 1e-6);
        assert!(
            (0..SWEEP_TICKS)
                .step_by(97)
                .all(|tick| sweep(77_777, tick) == sweep(77_777, tick + SWEEP_TICKS))
        );
        // By the definition of the transform, beside an even share of the power for each line.
        let line = |k: usize| {
            let turn = |i: usize| {
                core::f64::consts::TAU * ((i * k) % samples.len()) as f64 / samples.len() as f64
            };
            let (re, im) = samples
                .iter()
                .enumerate()
                .fold((0.0, 0.0), |(re, im), (i, v)| {
                    (re + v * turn(i).cos(), im - v * turn(i).sin())
                });
            re.hypot(im) / samples.len() as f64
        };
        let even = (0.25 / (0.48 * f64::from(SWEEP_TICKS))).sqrt();
        for k in (8..1930).step_by(31) {
            assert!(
                (0.6..1.6).contains(&(line(k) / even)),
                "{k}: {}",
                line(k) / even
            );
        }
        assert!((2000..2048).step_by(7).all(|k| line(k) < 0.4 * even));
    }

    #[test]
    fn the_quasi_step_of_chapter_6() {
        let waveform = Waveform::QuasiStep {
            height: Micrometres::from_num(5),
            delay_ticks: 2000,
            duration_ticks: 1000,
        };
        let mut generator = ReferenceGenerator::new(waveform, Micrometres::from_bits(0));
        let samples: Vec<f64> = (0..3200).map(|_| generator.next_value().to_num()).collect();
        // Ch. 6, Eq. (44): 0 at 0.1 s, 2.5 at 0.125 s, 5 at 0.15 s.
        for (k, expected) in [(2000, 0.0), (2500, 2.5), (3000, 5.0), (3199, 5.0)] {
            assert!((samples[k] - expected).abs() < 1e-6, "{k} {}", samples[k]);
        }
        let t = 0.11f64;
        let printed = 9.60e7 * t.powi(5) - 6.00e7 * t.powi(4) + 1.48e7 * t.powi(3) - 1.80e6 * t * t
            + 1.08e5 * t
            - 2.56e3;
        assert!(
            (samples[2200] - printed).abs() < 1e-4,
            "{} {printed}",
            samples[2200]
        );
    }

    #[test]
    fn what_repeats_says_after_how_many_samples() {
        let (um, increment) = (Micrometres::from_bits, |hz: f64| {
            (hz / 20_000.0 * 4_294_967_296.0).round() as u32
        });
        let sines = |hz: [f64; 2]| Waveform::Multisine {
            tones: [
                (increment(hz[0]), um(5), 0),
                (increment(hz[1]), um(5), 7),
                (77, um(0), 0),
                (0, um(0), 0),
            ],
        };
        for (waveform, period) in [
            (sines([100.0, 300.0]), Some(200)),
            (sines([200.0, 100.0]), Some(200)),
            (sines([100.0, 150.0]), None),
            (sines([150.0, 150.0]), None),
            (
                Waveform::RoundedTriangle {
                    increment: increment(12.5),
                    amplitude: um(1),
                },
                Some(1600),
            ),
            (
                Waveform::RoundedTriangle {
                    increment: 0,
                    amplitude: um(1),
                },
                None,
            ),
            (
                Waveform::Multisine {
                    tones: [(0, um(0), 0); 4],
                },
                None,
            ),
            // Cut off, as commands make it.
            (
                Waveform::RoundedTriangle {
                    increment: 26_843_545,
                    amplitude: um(1),
                },
                Some(160),
            ),
            (Waveform::Constant, None),
        ] {
            assert_eq!(waveform.period_ticks(), period, "{waveform:?}");
        }
    }

    #[test]
    fn the_rounded_triangle_reaches_its_amplitude() {
        let waveform = Waveform::RoundedTriangle {
            increment: 1 << 20,
            amplitude: Micrometres::from_num(3),
        };
        let mut generator = ReferenceGenerator::new(waveform, Micrometres::from_bits(0));
        let highest = (0..4096)
            .map(|_| generator.next_value().to_num::<f64>())
            .fold(0.0, f64::max);
        assert!((highest - 3.0).abs() < 1e-4, "{highest}");
    }
}
