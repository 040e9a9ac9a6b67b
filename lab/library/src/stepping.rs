//! The performance of a stick-slip drive, measured from a recording of its drive and its slider.
//!
//! The slider of such a drive swings while it travels, and its drive must be asymmetric in each period (thesis
//! Ch. 8.2): an error against a reference says little about it. What says much is the travel of a period, how
//! it scatters, how much of it is lost by going backwards, and the swing at the stop.
//!
//! # How it works
//! [`measure`] finds the saw-teeth by their turning points: a slow flank, then a faster one the other way.
//! Equal saw-teeth in a row are a [`SteppingTrain`]. Of each train the first third is left out, while the
//! slider still gathers speed.
//!
//! # Deviations
//! The travel of a period is a sample of its own; the deviation of a mean is the scatter over the root of
//! their number. The noise of the sensor enters each travel twice and is taken out of the scatter. It comes
//! from the steps between readings where the drive rests. The backward step is that of the mean period,
//! at whose two extremes every period is read: so the noise does not enlarge it.

use crate::dataset::{Dataset, Record};
use crate::error::{Error, Result};
use crate::statistics::{extremes, mean};
use serde::Serialize;
use std::ops::Range;

/// Name of the figures in files.
pub const SCHEMA: &str = "hysteron.stepping/1";
/// A turn of the drive is one by this share of its whole range; less is the noise of a measured drive.
const TURN_SHARE: f64 = 0.05;
/// Share of its height with which a flank begins and ends.
const FLANK_SHARE: f64 = 0.02;
/// The slow flank of a saw-tooth takes at least so many times as long as the fast one.
const ASYMMETRY_MIN: f64 = 1.5;
/// Saw-teeth of one train differ by at most this share in height and in period.
const ALIKE_SHARE: f64 = 0.1;
/// Fewest saw-teeth of a train: three of them are counted.
const TEETH_MIN: usize = 4;
/// Shortest rest in which a stop is judged, and from which the noise is estimated, samples.
const REST_SAMPLES: usize = 64;
/// A slider has stopped where its readings stay within so many standard deviations of the noise.
const NOISE_BAND: f64 = 4.0;

/// A figure with its standard deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    /// The figure.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
}

impl Measured {
    fn mean_of(samples: &[f64]) -> Self {
        Self {
            value: mean(samples),
            std: scatter(samples) / (samples.len() as f64).sqrt(),
        }
    }

    /// The figure in another unit.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            value: self.value * factor,
            std: self.std * factor.abs(),
        }
    }
}

/// Standard deviation of samples.
fn scatter(samples: &[f64]) -> f64 {
    let (about, n) = (mean(samples), samples.len() as f64);
    let squares: f64 = samples.iter().map(|v| (v - about).powi(2)).sum();
    (squares / (n - 1.0).max(1.0)).sqrt()
}

/// The stop behind a train.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stop {
    /// For how long the drive rests, s.
    pub rest_s: f64,
    /// Where the slider comes to rest, um: the mean of the last half of the rest.
    pub position_um: Measured,
    /// Largest departure from there once the drive rests, um; its deviation is that of one reading.
    pub swing_um: Measured,
    /// Time from the end of the drive until the slider stays within the noise, s.
    pub settling_s: f64,
}

/// Equal saw-teeth in a row, and what the slider did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SteppingTrain {
    /// The record.
    pub record: String,
    /// Where it begins in the record, s.
    pub from_s: f64,
    /// Saw-teeth.
    pub teeth: usize,
    /// Those of them that are counted.
    pub counted: usize,
    /// Saw-teeth a second, Hz.
    pub frequency_hz: f64,
    /// Height of the saw-teeth, V.
    pub amplitude_v: f64,
    /// Share of the period that the slow flank takes; a flank downwards is counted from its top.
    pub slow_share: f64,
    /// The slow flank rises.
    pub slow_flank_rises: bool,
    /// Average velocity, um/s.
    pub velocity_um_s: Measured,
    /// Travel of a period, um.
    pub step_um: Measured,
    /// Standard deviation of the travel from period to period without the noise of the sensor, um.
    pub scatter_um: Measured,
    /// Travel within a period against the direction of the train, um.
    pub backward_um: Measured,
    /// The stop behind it, if the drive rests there.
    pub stop: Option<Stop>,
    /// Mean travel within a period from its beginning, um, a sample each.
    pub mean_period_um: Vec<f64>,
}

/// What a recording shows of a stick-slip drive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SteppingMeasure {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// The data set.
    pub name: String,
    /// Noise of the sensor where the drive rests, um RMS; none where it never does, and the scatter then
    /// holds the noise.
    pub noise_um: Option<f64>,
    /// The trains, in the order of records and time.
    pub trains: Vec<SteppingTrain>,
}

/// One saw-tooth: sample at which each flank begins, and at which the fast one ends.
#[derive(Clone, Copy, Debug)]
struct Tooth {
    from: usize,
    turn: usize,
    to: usize,
    height_v: f64,
}

/// Measures every train of saw-teeth in a data set.
///
/// # Errors
/// No record has a train of saw-teeth.
pub fn measure(dataset: &Dataset) -> Result<SteppingMeasure> {
    let mut tapes: Vec<&Record> = Vec::new();
    for record in &dataset.records {
        // A single file is two records of one tape; a train may begin in one and end in the other.
        let is_known = |tape: &&Record| {
            tape.drive_v == record.drive_v && tape.displacement_um == record.displacement_um
        };
        if !tapes.iter().any(is_known) {
            tapes.push(record);
        }
    }
    let noise_um = noise(&tapes);
    let trains: Vec<SteppingTrain> = tapes
        .iter()
        .flat_map(|tape| trains(tape, noise_um.unwrap_or(0.0)))
        .collect();
    if trains.is_empty() {
        return Err(Error::new(
            &dataset.source,
            format!(
                "no drive has {TEETH_MIN} equal saw-teeth in a row; expected a flank at least {ASYMMETRY_MIN} times as slow as the one back"
            ),
        ));
    }
    Ok(SteppingMeasure {
        schema: SCHEMA,
        name: dataset.name.clone(),
        noise_um,
        trains,
    })
}

/// Samples of a signal that hold one value for long enough.
pub fn rests(drive_v: &[f64]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut from = 0;
    for k in 1..=drive_v.len() {
        if k == drive_v.len() || drive_v[k] != drive_v[from] {
            if k - from >= REST_SAMPLES {
                found.push(from..k);
            }
            from = k;
        }
    }
    found
}

/// Noise by the steps between readings in the second half of each rest, where the slider has come to rest.
fn noise(tapes: &[&Record]) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0usize);
    for tape in tapes {
        for rest in rests(&tape.drive_v) {
            let late = &tape.displacement_um[rest.start + rest.len() / 2..rest.end];
            squares += late.windows(2).map(|p| (p[1] - p[0]).powi(2)).sum::<f64>();
            count += late.len() - 1;
        }
    }
    (count > 0).then(|| (0.5 * squares / count as f64).sqrt())
}

/// Samples at which a signal turns by at least `least`: its extremes in turn, ends included.
fn turning_points(signal: &[f64], least: f64) -> Vec<usize> {
    let mut turns = vec![0];
    let (mut low, mut high, mut rising) = (0, 0, None);
    for (k, value) in signal.iter().enumerate() {
        if *value < signal[low] {
            low = k;
        }
        if *value > signal[high] {
            high = k;
        }
        if rising != Some(true) && value - signal[low] >= least {
            if rising.is_some() || low > 0 {
                turns.push(low);
            }
            (rising, high) = (Some(true), k);
        } else if rising != Some(false) && signal[high] - value >= least {
            if rising.is_some() || high > 0 {
                turns.push(high);
            }
            (rising, low) = (Some(false), k);
        }
    }
    turns.push(match rising {
        Some(true) => high,
        _ => low,
    });
    turns.dedup();
    turns
}

/// Where the flank between two turning points begins and ends: holds at its ends are none of it.
fn flank(drive_v: &[f64], between: [usize; 2]) -> [usize; 2] {
    let [a, b] = between;
    let near = FLANK_SHARE * (drive_v[b] - drive_v[a]).abs();
    let from = (a..b)
        .rfind(|k| (drive_v[*k] - drive_v[a]).abs() <= near)
        .unwrap_or(a);
    let to = (from + 1..=b)
        .find(|k| (drive_v[*k] - drive_v[b]).abs() <= near)
        .unwrap_or(b);
    [from, to]
}

fn teeth(drive_v: &[f64]) -> Vec<Tooth> {
    let (low, high) = extremes(drive_v);
    let turns = turning_points(drive_v, TURN_SHARE * (high - low));
    let flanks: Vec<([usize; 2], f64)> = turns
        .windows(2)
        .map(|pair| {
            let height_v = drive_v[pair[1]] - drive_v[pair[0]];
            (flank(drive_v, [pair[0], pair[1]]), height_v)
        })
        .collect();
    let length = |flank: [usize; 2]| (flank[1] - flank[0]) as f64;
    let pairs = flanks.windows(2).map(|pair| (pair[0], pair[1].0));
    pairs
        .filter(|((slow, _), fast)| length(*slow) >= ASYMMETRY_MIN * length(*fast))
        .map(|((slow, height_v), fast)| Tooth {
            from: slow[0],
            turn: fast[0],
            to: fast[1],
            height_v,
        })
        .collect()
}

/// Groups of equal saw-teeth that follow one another.
fn equal_in_a_row(teeth: &[Tooth]) -> Vec<&[Tooth]> {
    let alike = |a: f64, b: f64| (a - b).abs() <= ALIKE_SHARE * a.abs();
    let follows = |a: &Tooth, b: &Tooth| {
        let [slow_a, slow_b] = [a, b].map(|t| (t.turn - t.from) as f64);
        alike(a.height_v, b.height_v) && alike(slow_a, slow_b) && b.from - a.to <= a.to - a.from
    };
    teeth
        .chunk_by(follows)
        .filter(|group| group.len() >= TEETH_MIN)
        .collect()
}

/// The trains of one record, whose sensor has this noise.
#[must_use]
pub fn trains(tape: &Record, noise_um: f64) -> Vec<SteppingTrain> {
    let all = teeth(&tape.drive_v);
    let rests = rests(&tape.drive_v);
    equal_in_a_row(&all)
        .into_iter()
        .filter_map(|group| train(tape, group, &rests, noise_um))
        .collect()
}

fn train(
    tape: &Record,
    group: &[Tooth],
    rests: &[Range<usize>],
    noise_um: f64,
) -> Option<SteppingTrain> {
    let y = &tape.displacement_um;
    let (first, last) = (group.first()?, group.last()?);
    let period = (last.from - first.from) as f64 / (group.len() - 1) as f64;
    // The last saw-tooth counts where its period ends inside the record.
    let mut begins: Vec<usize> = group.iter().map(|tooth| tooth.from).collect();
    let end = (last.from as f64 + period).round() as usize;
    if end < y.len() {
        begins.push(end);
    }
    let begins = &begins[group.len() / 3..];
    let steps: Vec<f64> = begins.windows(2).map(|p| y[p[1]] - y[p[0]]).collect();
    let direction = mean(&steps).signum();
    let frequency_hz = tape.sample_rate_hz / period;
    let step_um = Measured::mean_of(&steps);
    let of_noise = 2.0 * noise_um.powi(2);
    let all = scatter(&steps);
    let counted = steps.len();
    let length = begins.windows(2).map(|p| p[1] - p[0]).min()?;
    let mean_period_um: Vec<f64> = (0..=length)
        .map(|k| {
            mean(
                &begins[..counted]
                    .iter()
                    .map(|b| y[b + k] - y[*b])
                    .collect::<Vec<_>>(),
            )
        })
        .collect();
    Some(SteppingTrain {
        record: tape.name.clone(),
        from_s: first.from as f64 / tape.sample_rate_hz,
        teeth: group.len(),
        counted,
        frequency_hz,
        amplitude_v: mean(&group.iter().map(|t| t.height_v.abs()).collect::<Vec<_>>()),
        slow_share: mean(
            &group
                .iter()
                .map(|t| (t.turn - t.from) as f64 / period)
                .collect::<Vec<_>>(),
        ),
        slow_flank_rises: first.height_v > 0.0,
        velocity_um_s: step_um.times(frequency_hz),
        step_um,
        scatter_um: Measured {
            value: (all.powi(2) - of_noise).max(0.0).sqrt(),
            // That of a standard deviation from so many samples.
            std: all / (2.0 * (counted as f64 - 1.0).max(1.0)).sqrt(),
        },
        backward_um: backward(y, &begins[..counted], &mean_period_um, direction),
        stop: rests
            .iter()
            .find(|rest| rest.contains(&last.to) && rest.end - last.to >= REST_SAMPLES)
            .map(|rest| stop(&y[last.to..rest.end], tape.sample_rate_hz, noise_um)),
        mean_period_um,
    })
}

/// The longest way back in the mean period, read in every one.
fn backward(y: &[f64], begins: &[usize], mean_period_um: &[f64], direction: f64) -> Measured {
    let (mut top, mut worst, mut size) = (0, [0, 0], 0.0);
    for (k, travel) in mean_period_um.iter().enumerate() {
        if direction * (travel - mean_period_um[top]) > 0.0 {
            top = k;
        }
        let back = direction * (mean_period_um[top] - travel);
        if back > size {
            (worst, size) = ([top, k], back);
        }
    }
    let each: Vec<f64> = begins
        .iter()
        .map(|b| direction * (y[b + worst[0]] - y[b + worst[1]]))
        .collect();
    Measured::mean_of(&each)
}

fn stop(y: &[f64], sample_rate_hz: f64, noise_um: f64) -> Stop {
    let late = &y[y.len() / 2..];
    let position_um = Measured {
        value: mean(late),
        std: scatter(late) / (late.len() as f64).sqrt(),
    };
    let band_um = NOISE_BAND * noise_um;
    let outside = |y: &f64| (y - position_um.value).abs() > band_um;
    let settled = y.iter().rposition(outside).map_or(0, |k| k + 1);
    let swing = y[..settled]
        .iter()
        .fold(0.0, |most: f64, y| most.max((y - position_um.value).abs()));
    Stop {
        rest_s: y.len() as f64 / sample_rate_hz,
        position_um,
        swing_um: Measured {
            value: swing,
            std: noise_um,
        },
        settling_s: settled as f64 / sample_rate_hz,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    const FS: f64 = 20_000.0;
    const NOISE_UM: f64 = 0.004;

    /// A slider that rides up by 4 um in 180 samples and falls back by 1 um in 20, each step with a scatter of
    /// its own, then rings down with 0.2 um; and the travel of each period.
    fn planted(teeth: usize, seed: u64) -> (Record, Vec<f64>) {
        let (mut noise, mut own) = (
            WhiteNoise::new(NOISE_UM, seed),
            WhiteNoise::new(0.05, seed + 1),
        );
        let (mut drive_v, mut y) = (vec![0.0; 200], vec![0.0; 200]);
        let mut at = 0.0;
        let mut travels = Vec::new();
        for _ in 0..teeth {
            let more = own.next_um();
            for k in 1..=180 {
                drive_v.push(60.0 * f64::from(k) / 180.0);
                y.push(at + (4.0 + more) * f64::from(k) / 180.0);
            }
            for k in 1..=20 {
                drive_v.push(60.0 * (1.0 - f64::from(k) / 20.0));
                y.push(at + 4.0 + more - f64::from(k) / 20.0);
            }
            at += 3.0 + more;
            travels.push(3.0 + more);
        }
        for k in 0..2000 {
            let t = f64::from(k) / FS;
            drive_v.push(0.0);
            y.push(at + 0.2 * (-200.0 * t).exp() * (1000.0 * t).cos());
        }
        let y = y.iter().map(|y| y + noise.next_um()).collect();
        (Record::new("planted", FS, drive_v, y), travels)
    }

    fn within(found: Measured, truth: f64, label: &str) {
        assert!(
            (found.value - truth).abs() < 4.0 * found.std,
            "{label}: {found:?}, planted {truth}"
        );
    }

    #[test]
    fn planted_steps_are_measured_within_their_deviations() {
        for seed in [1, 5, 9, 13] {
            let (record, travels) = planted(60, seed);
            let dataset = Dataset::new("planted", 0.0, 60.0, vec![record]).unwrap();
            let found = measure(&dataset).unwrap();
            let [train] = found.trains.as_slice() else {
                panic!("{} trains", found.trains.len());
            };
            assert_eq!((train.teeth, train.counted), (60, 40));
            let counted = &travels[20..];
            assert!((train.frequency_hz - 100.0).abs() < 1e-9);
            assert!((train.slow_share - 0.9).abs() < 0.03 && train.slow_flank_rises);
            within(train.step_um, mean(counted), "step");
            within(train.velocity_um_s, 100.0 * mean(counted), "velocity");
            within(train.scatter_um, scatter(counted), "scatter");
            within(train.backward_um, 1.0, "backward step");
            let stop = train.stop.as_ref().unwrap();
            within(stop.swing_um, 0.2, "swing");
            within(stop.position_um, travels.iter().sum(), "stop");
            assert!((found.noise_um.unwrap() - NOISE_UM).abs() < 0.1 * NOISE_UM);
        }
    }

    #[test]
    fn the_deviation_of_the_step_is_that_over_seeds() {
        let found: Vec<(f64, f64)> = (0..40)
            .map(|seed| {
                let (record, _) = planted(24, 100 + 2 * seed);
                let dataset = Dataset::new("planted", 0.0, 60.0, vec![record]).unwrap();
                let step = measure(&dataset).unwrap().trains[0].step_um;
                (step.value, step.std)
            })
            .collect();
        let (values, deviations): (Vec<f64>, Vec<f64>) = found.into_iter().unzip();
        let ratio = scatter(&values) / mean(&deviations);
        assert!((0.75..1.3).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_triangle_is_no_train_and_a_falling_slow_flank_is_one() {
        let fold = |rise: f64| -> Vec<f64> {
            let phase = |k: i32| (f64::from(k) / 200.0).fract();
            (0..2000)
                .map(|k| {
                    if phase(k) < rise {
                        phase(k) / rise
                    } else {
                        (1.0 - phase(k)) / (1.0 - rise)
                    }
                })
                .map(|share| 50.0 * share)
                .collect()
        };
        let measured = |drive_v: Vec<f64>| {
            let y = drive_v
                .iter()
                .enumerate()
                .map(|(k, u)| 0.1 * u - 1e-3 * k as f64)
                .collect();
            measure(
                &Dataset::new("fold", 0.0, 50.0, vec![Record::new("fold", FS, drive_v, y)])
                    .unwrap(),
            )
        };
        let refused = measured(fold(0.5)).unwrap_err().to_string();
        assert!(refused.contains("saw-teeth"), "{refused}");
        let train = &measured(fold(0.1)).unwrap().trains[0];
        assert!(!train.slow_flank_rises && train.step_um.value < 0.0);
        assert!(train.stop.is_none());
    }

    #[test]
    fn trains_of_other_heights_and_rates_are_apart() {
        let mut record = planted(12, 3).0;
        let other = planted(8, 4).0;
        let end = *record.displacement_um.last().unwrap();
        record
            .drive_v
            .extend(other.drive_v.iter().step_by(2).map(|u| 0.5 * u));
        record
            .displacement_um
            .extend(other.displacement_um.iter().step_by(2).map(|y| end + y));
        record.window = 0..record.drive_v.len();
        let found = measure(&Dataset::new("two", 0.0, 60.0, vec![record]).unwrap()).unwrap();
        let kinds: Vec<[i32; 3]> = found
            .trains
            .iter()
            .map(|t| {
                [
                    t.teeth as i32,
                    t.frequency_hz.round() as i32,
                    t.amplitude_v.round() as i32,
                ]
            })
            .collect();
        assert_eq!(kinds, [[12, 100, 60], [8, 200, 30]]);
    }
}
