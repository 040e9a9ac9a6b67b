//! Exponential sines over a band, and what they show: the transfer function of the linear part, and the
//! distortion beside it.
//!
//! # How it works
//! The frequency of an exponential sine of duration `T` grows as `f1 exp(t / L)`. The response divided by the
//! drive is an impulse response in which the n-th harmonic of the sine stands `L ln n` before the linear part
//! (Farina 2000; `f1 L` is a whole number, so that their phases agree, Novak 2015). Windows cut them apart.
//!
//! A band is at most a decade. Each has its own rate, [`POINTS_PER_PERIOD`] points in the fastest period, so
//! that every band shows as many periods, whatever its frequencies. The drive is held from point to point; the
//! transfer function is that of the stage behind the hold.

use nalgebra::Complex;
use realfft::RealFftPlanner;
use std::f64::consts::{PI, TAU};

/// Points in the shortest period of a band, where the board is fast enough.
const POINTS_PER_PERIOD: f64 = 8.0;
/// Points in the shortest period of a band, at least.
const LEAST_POINTS_PER_PERIOD: f64 = 4.0;
/// Widest band: the factor of its frequencies.
const WIDEST_BAND: f64 = 10.0;
/// Narrowest band.
const NARROWEST_BAND: f64 = 2.0;
/// Of the points of a table: the smooth way to the offset, and the same back.
const WAY_SHARE: usize = 16;
/// Of the points of a table: the offset is held so long behind the sine, for what still rings.
const TAIL_SHARE: usize = 16;
/// The sine of a band begins at its lowest frequency over this, ...
const BEGINS_BELOW: f64 = 1.25;
/// ... and ends at its highest one times this: what begins or ends is no sine of its frequency.
const ENDS_ABOVE: f64 = 1.06;
/// Points over which the sine ends.
const FADE_POINTS: usize = 64;
/// Frequencies in a decade at which the response is given.
const FREQUENCIES_PER_DECADE: f64 = 12.0;
/// A drive shows a frequency where its power there is this share of its largest.
const DRIVEN: f64 = 1e-6;
/// Widths of a window's line by which a harmonic stays away from the end of the band.
const SMEARED_LINES: f64 = 3.0;
/// Harmonics beside the first whose distortion is given.
pub const HARMONICS: usize = 2;

/// One band.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepBand {
    /// Lowest frequency, Hz.
    pub from_hz: f64,
    /// Highest frequency, Hz.
    pub to_hz: f64,
    /// Ticks of the board for which a point is held.
    pub ticks_per_point: u32,
    /// Points per second, Hz.
    pub rate_hz: f64,
    /// Time in which the frequency grows by the factor e, s.
    growth_s: f64,
    /// Points of the sine.
    sine_points: usize,
    /// Points of the way to the offset, and of the way back.
    way_points: usize,
    /// Points behind the sine.
    tail_points: usize,
}

/// What a band shows at a frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// Frequency of the sine, Hz.
    pub hz: f64,
    /// Magnitude of the linear part, um/V.
    pub gain_um_v: f64,
    /// Its phase, degrees, in -180..180.
    pub phase_deg: f64,
    /// Magnitude of the second and the third harmonic over that of the first, at this frequency of the sine;
    /// none where the harmonic is beyond the band.
    pub distortion: [Option<f64>; HARMONICS],
}

/// The bands of a sweep, from the fastest to the slowest, for a board with this rate of ticks and so many
/// points in a table.
///
/// # Errors
/// What was expected of the frequencies.
pub fn bands(
    from_hz: f64,
    to_hz: f64,
    tick_rate_hz: f64,
    table_points: usize,
) -> Result<Vec<SweepBand>, String> {
    let highest_hz = tick_rate_hz / LEAST_POINTS_PER_PERIOD;
    if !(from_hz > 0.0 && to_hz <= highest_hz && to_hz >= NARROWEST_BAND * from_hz) {
        return Err(format!(
            "{from_hz} to {to_hz} Hz; expected frequencies above 0 and up to {highest_hz:.0} Hz, the highest at least {NARROWEST_BAND} times the lowest"
        ));
    }
    let count = ((to_hz / from_hz).ln() / WIDEST_BAND.ln() - 1e-9)
        .ceil()
        .max(1.0);
    let factor = (to_hz / from_hz).powf(1.0 / count);
    Ok((0..count as i32)
        .map(|nth| {
            band(
                to_hz / factor.powi(nth + 1),
                to_hz / factor.powi(nth),
                tick_rate_hz,
                table_points,
            )
        })
        .collect())
}

fn band(from_hz: f64, to_hz: f64, tick_rate_hz: f64, table_points: usize) -> SweepBand {
    let ticks_per_point = (tick_rate_hz / (POINTS_PER_PERIOD * to_hz))
        .floor()
        .max(1.0);
    let rate_hz = tick_rate_hz / ticks_per_point;
    let (way_points, tail_points) = (table_points / WAY_SHARE, table_points / TAIL_SHARE);
    let room_s = (table_points - 2 * way_points - tail_points) as f64 / rate_hz;
    let begins_hz = from_hz / BEGINS_BELOW;
    let growths = (ENDS_ABOVE * to_hz / begins_hz).ln();
    let growth_s = (begins_hz * room_s / growths).floor().max(1.0) / begins_hz;
    let sine_points =
        ((growth_s * growths * rate_hz) as usize).min(table_points - 2 * way_points - tail_points);
    SweepBand {
        from_hz,
        to_hz,
        ticks_per_point: ticks_per_point as u32,
        rate_hz,
        growth_s,
        sine_points,
        way_points,
        tail_points,
    }
}

impl SweepBand {
    /// The points: from `rest` to the offset, the sine about it, the offset, and back to `rest`.
    #[must_use]
    pub fn points(&self, rest: f64, offset: f64, amplitude: f64) -> Vec<f64> {
        let way = |k: usize| 0.5 - 0.5 * (PI * (k as f64 + 1.0) / self.way_points as f64).cos();
        let up = (0..self.way_points).map(|k| rest + (offset - rest) * way(k));
        let sine = (0..self.sine_points).map(|k| {
            let phase = TAU * self.from_hz / BEGINS_BELOW
                * self.growth_s
                * ((k as f64 / self.rate_hz / self.growth_s).exp() - 1.0);
            let left = (self.sine_points - k) as f64 / FADE_POINTS as f64;
            let fade = if left < 1.0 {
                0.5 - 0.5 * (PI * left).cos()
            } else {
                1.0
            };
            offset + amplitude * fade * phase.sin()
        });
        let down = (0..self.way_points).map(|k| offset + (rest - offset) * way(k));
        up.chain(sine)
            .chain(std::iter::repeat_n(offset, self.tail_points))
            .chain(down)
            .collect()
    }

    /// What a recording of these points shows; empty where it is shorter than they are. Element `k` of the
    /// drive acts from the instant of position `k` on.
    #[must_use]
    pub fn response(&self, drive_v: &[f64], position_um: &[f64]) -> Vec<SweepPoint> {
        let counted = self.way_points..self.way_points + self.sine_points + self.tail_points;
        let (Some(drive_v), Some(position_um)) =
            (drive_v.get(counted.clone()), position_um.get(counted))
        else {
            return Vec::new();
        };
        let length = (2 * drive_v.len()).next_power_of_two();
        let Some(impulse) = impulse_response(&detrended(drive_v), &detrended(position_um), length)
        else {
            return Vec::new();
        };
        let ratio = self.to_hz / self.from_hz;
        let count = (FREQUENCIES_PER_DECADE * ratio.log10()).round().max(1.0);
        let frequencies =
            (0..=count as i32).map(|i| self.from_hz * ratio.powf(f64::from(i) / count));
        frequencies
            .map(|hz| {
                // The hold from point to point, as a sine of this frequency sees it.
                let half = PI * hz / self.rate_hz;
                let held = Complex::from_polar(half.sin() / half, -half);
                let first = self.harmonic(&impulse, 1, hz) / held;
                let distortion = std::array::from_fn(|nth| {
                    let harmonic = nth + 2;
                    let at_hz = harmonic as f64 * hz;
                    let [left, right] = self.window(harmonic, impulse.len());
                    // A window of this length smears what the end of the band does so far.
                    let smeared_hz = SMEARED_LINES * self.rate_hz / (left + right) as f64;
                    (at_hz <= self.to_hz - smeared_hz).then(|| {
                        let half = PI * at_hz / self.rate_hz;
                        self.harmonic(&impulse, harmonic, at_hz).norm()
                            / (half.sin() / half).abs()
                            / first.norm()
                    })
                });
                SweepPoint {
                    hz,
                    gain_um_v: first.norm(),
                    phase_deg: first.arg().to_degrees(),
                    distortion,
                }
            })
            .collect()
    }

    /// Points by which a harmonic stands before the linear part.
    fn points_before(&self, harmonic: usize) -> i64 {
        (self.growth_s * (harmonic as f64).ln() * self.rate_hz).round() as i64
    }

    /// Points to either side of a harmonic that are its own: half the way to the neighbours. Behind the linear
    /// part nothing is but its own ringing.
    fn window(&self, harmonic: usize, length: usize) -> [i64; 2] {
        let at = |n: usize| self.points_before(n);
        let right = if harmonic == 1 {
            length as i64 / 4
        } else {
            (at(harmonic) - at(harmonic - 1)) / 2
        };
        [(at(harmonic + 1) - at(harmonic)) / 2, right]
    }

    /// The part of an impulse response that belongs to a harmonic, at a frequency.
    fn harmonic(&self, impulse: &[f64], harmonic: usize, hz: f64) -> Complex<f64> {
        let at = -self.points_before(harmonic);
        let [left, right] = self.window(harmonic, impulse.len());
        let window = |m: i64| {
            let edge = if m < 0 { left } else { right } as f64;
            let share = m.abs() as f64 / edge;
            if share < 0.8 {
                1.0
            } else {
                0.5 + 0.5 * (PI * (share - 0.8) / 0.2).cos()
            }
        };
        let step = TAU * hz / self.rate_hz;
        (-left..=right)
            .map(|m| {
                let value = impulse[(at + m).rem_euclid(impulse.len() as i64) as usize];
                Complex::from_polar(value * window(m), -step * m as f64)
            })
            .sum()
    }
}

/// A signal without the straight line from its first to its last value.
fn detrended(signal: &[f64]) -> Vec<f64> {
    let (first, last) = (
        signal.first().copied().unwrap_or(0.0),
        signal.last().copied().unwrap_or(0.0),
    );
    let step = (last - first) / (signal.len().max(2) - 1) as f64;
    signal
        .iter()
        .enumerate()
        .map(|(k, value)| value - first - step * k as f64)
        .collect()
}

/// The response divided by the drive, as an impulse response; none where the transform fails.
fn impulse_response(drive: &[f64], response: &[f64], length: usize) -> Option<Vec<f64>> {
    let mut planner = RealFftPlanner::<f64>::new();
    let forward = planner.plan_fft_forward(length);
    let spectrum = |signal: &[f64]| {
        let (mut input, mut output) = (forward.make_input_vec(), forward.make_output_vec());
        input
            .iter_mut()
            .zip(signal)
            .for_each(|(to, from)| *to = *from);
        forward
            .process(&mut input, &mut output)
            .ok()
            .map(|()| output)
    };
    let (x, y) = (spectrum(drive)?, spectrum(response)?);
    let least = DRIVEN * x.iter().map(|bin| bin.norm_sqr()).fold(0.0, f64::max);
    let mut ratio: Vec<Complex<f64>> = x
        .iter()
        .zip(&y)
        .map(|(x, y)| y * x.conj() / (x.norm_sqr() + least))
        .collect();
    // Of these two the imaginary part is rounding.
    for end in [0, length / 2] {
        ratio[end].im = 0.0;
    }
    let back = planner.plan_fft_inverse(length);
    let mut impulse = back.make_output_vec();
    back.process(&mut ratio, &mut impulse).ok()?;
    impulse.iter_mut().for_each(|value| *value /= length as f64);
    Some(impulse)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A power series in front of a first-order low-pass: gain, phase and both harmonics have closed forms.
    #[test]
    fn a_sweep_shows_the_gain_and_the_distortion_of_a_known_stage() {
        const SQUARE: f64 = 0.01;
        const CUBE: f64 = 0.002;
        let (amplitude, offset, gain) = (5.0, 40.0, 0.13);
        for band in bands(5.0, 500.0, 20_000.0, 4096).unwrap() {
            let pole_hz = 0.4 * band.to_hz;
            let drive = band.points(0.0, offset, amplitude);
            assert_eq!(
                (drive.len() <= 4096, drive.last().copied()),
                (true, Some(0.0))
            );
            let carried = (-TAU * pole_hz / band.rate_hz).exp();
            let mut state = 0.0;
            let position: Vec<f64> = drive
                .iter()
                .map(|u| {
                    let (now, x) = (state, u - offset);
                    state = carried * state
                        + (1.0 - carried) * gain * (x + SQUARE * x * x + CUBE * x.powi(3));
                    now
                })
                .collect();
            // Sampled exactly, the low-pass is this.
            let low_pass = |hz: f64| {
                let back = Complex::from_polar(1.0, -TAU * hz / band.rate_hz);
                let half = PI * hz / band.rate_hz;
                back * (1.0 - carried)
                    / (1.0 - back * carried)
                    / Complex::from_polar(half.sin() / half, -half)
            };
            let linear = 1.0 + 0.75 * CUBE * amplitude * amplitude;
            let found = band.response(&drive, &position);
            assert!(found.len() > 10);
            for point in &found {
                let expected = low_pass(point.hz) * gain * linear;
                let of_phase = (point.phase_deg - expected.arg().to_degrees()).abs();
                assert!(
                    (point.gain_um_v / expected.norm() - 1.0).abs() < 0.03 && of_phase < 2.0,
                    "{band:?} {point:?} {expected}"
                );
                let shares = [SQUARE * amplitude / 2.0, CUBE * amplitude * amplitude / 4.0];
                for (nth, (seen, share)) in point.distortion.iter().zip(shares).enumerate() {
                    let Some(seen) = seen else { continue };
                    let harmonic_hz = (nth as f64 + 2.0) * point.hz;
                    let expected =
                        share * low_pass(harmonic_hz).norm() / low_pass(point.hz).norm() / linear;
                    assert!(
                        (seen / expected - 1.0).abs() < 0.1,
                        "{} Hz, harmonic {}: {seen} {expected}",
                        point.hz,
                        nth + 2
                    );
                }
            }
        }
    }

    #[test]
    fn bands_cover_what_was_asked_and_refuse_what_no_board_plays() {
        let found = bands(1.0, 2_000.0, 20_000.0, 4096).unwrap();
        assert_eq!((found.len(), found[0].ticks_per_point), (4, 1));
        assert!((found[0].to_hz - 2_000.0).abs() < 1e-9 && (found[3].from_hz - 1.0).abs() < 1e-9);
        assert!(
            found
                .windows(2)
                .all(|pair| (pair[0].from_hz - pair[1].to_hz).abs() < 1e-9 * pair[1].to_hz)
        );
        assert!(
            bands(10.0, 6_000.0, 20_000.0, 4096)
                .unwrap_err()
                .contains("5000")
        );
        assert!(
            bands(10.0, 12.0, 20_000.0, 4096).is_err()
                && bands(0.0, 100.0, 20_000.0, 4096).is_err()
        );
    }
}
