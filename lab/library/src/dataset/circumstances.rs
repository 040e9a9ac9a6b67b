//! Under which circumstances a stage is seen: voltage, up or down, height and duration of the way since the
//! last turn, its fastest part, time at a level, and the first way to a voltage. What is held out judges a
//! model where these were fitted; beyond them it shows how the model extrapolates.

use crate::statistics::peak_to_peak;
use std::ops::Range;

/// Voltages and heights of loops that differ by less than this share of the drive's range are alike.
pub(super) const ALIKE: f64 = 0.05;
/// Times that differ by less than this factor are alike.
pub(super) const ALIKE_IN_TIME: f64 = 1.25;
/// The drive turns where it goes back by this share of its range; a smaller motion is a hold.
const TURNS: f64 = 0.02;

/// Of a recording that is longer, a beginning is searched and fitted: half of this, or more until it shows what
/// the rest does. Every set of effects simulates the fitted samples and all before them some thirty times. On
/// one simulated tape half leaves 2.2 nm of the rest and the whole of this 3.5 nm, because the budget ends; on
/// another, whose rest moves otherwise, half leaves 78 nm and the whole 36 nm.
pub const SEARCHED_SAMPLES: usize = 120_000;
/// The rest of a recording shows nothing new where this share of it lies within the limits of the beginning.
/// On the first of these tapes it is more, on the second 0.77.
const NOTHING_NEW: f64 = 0.95;

/// The circumstances of one sample.
#[derive(Clone, Copy, Debug)]
struct Circumstance {
    level_v: f64,
    /// Height of the way from the last turn to the sample, V.
    height_v: f64,
    /// Whether the way to the next turn goes up.
    rises: bool,
    /// Duration of the way from turn to turn, s.
    duration_s: f64,
    /// Samples in which it has gone by [`ALIKE`] where it was fastest, here or on the whole way before: a stage
    /// still answers a jump when the next way begins.
    fastest: usize,
    /// Time for which the drive has stayed at the level, s.
    held_s: f64,
    /// The drive was never as high or as low before.
    is_first: bool,
}

/// The circumstances of every sample of a drive.
pub struct Circumstances(Vec<Circumstance>);

/// Limits of the circumstances that were fitted.
#[derive(Clone, Copy, Debug)]
pub struct Fitted {
    /// Falling and rising.
    levels_v: [(f64, f64); 2],
    range_v: f64,
    first_v: (f64, f64),
    highest_v: f64,
    shortest_s: f64,
    fastest: usize,
    held_s: f64,
}

impl Circumstances {
    /// Of a drive from its first sample on.
    #[must_use]
    pub fn of(drive_v: &[f64], sample_rate_hz: f64) -> Self {
        let still_v = TURNS * peak_to_peak(drive_v);
        let mut out = Vec::with_capacity(drive_v.len());
        let (mut low_v, mut high_v) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut held = (0, drive_v.first().copied().unwrap_or(0.0));
        for (k, &level_v) in drive_v.iter().enumerate() {
            if (level_v - held.1).abs() > still_v {
                held = (k, level_v);
            }
            let is_first = level_v > high_v || level_v < low_v;
            (low_v, high_v) = (low_v.min(level_v), high_v.max(level_v));
            out.push(Circumstance {
                level_v,
                height_v: 0.0,
                rises: true,
                duration_s: f64::INFINITY,
                fastest: usize::MAX,
                held_s: (k - held.0) as f64 / sample_rate_hz,
                is_first,
            });
        }
        let mut ends: Vec<usize> = turns(drive_v, still_v)
            .into_iter()
            .map(|(k, _)| k)
            .collect();
        ends.insert(0, 0);
        ends.push(drive_v.len().saturating_sub(1));
        let mut fastest_before = usize::MAX;
        for way in ends.windows(2) {
            let way = way[0]..way[1] + 1;
            let from_v = drive_v[way.start];
            let rises = drive_v[way.end - 1] > from_v;
            let fastest = fastest(&drive_v[way.clone()], ALIKE * peak_to_peak(drive_v));
            let duration_s = (way.len() - 1) as f64 / sample_rate_hz;
            for (one, fastest) in out[way].iter_mut().zip(&fastest) {
                one.height_v = (one.level_v - from_v).abs();
                one.fastest = fastest_before.min(*fastest);
                (one.rises, one.duration_s) = (rises, duration_s);
            }
            fastest_before = fastest.last().copied().unwrap_or(usize::MAX);
        }
        Self(out)
    }

    /// The beginning of a motion that shows what the rest does, from half of `longest` samples on, and which
    /// share of the rest lies within its limits. A motion of `longest` samples or fewer is its own beginning.
    #[must_use]
    pub fn beginning(&self, motion: &Range<usize>, longest: usize) -> (Range<usize>, f64) {
        if motion.len() <= longest {
            return (motion.clone(), 1.0);
        }
        let alike = |end: usize| {
            let limits = Self::limits([(self, (motion.start..end).collect())]);
            let rest = end..motion.end;
            let within = rest.clone().filter(|k| limits.covers(self, *k)).count();
            within as f64 / rest.len() as f64
        };
        let mut ends = (2..4).map(|quarters| motion.start + quarters * longest / 4);
        let end = ends
            .find(|end| alike(*end) >= NOTHING_NEW)
            .unwrap_or(motion.start + longest);
        (motion.start..end, alike(end))
    }

    /// The limits of some samples, of one drive or of several.
    #[must_use]
    pub fn limits<'c>(parts: impl IntoIterator<Item = (&'c Self, Vec<usize>)>) -> Fitted {
        let nothing = (f64::INFINITY, f64::NEG_INFINITY);
        let mut out = Fitted {
            levels_v: [nothing; 2],
            range_v: 0.0,
            first_v: nothing,
            highest_v: 0.0,
            shortest_s: f64::INFINITY,
            fastest: usize::MAX,
            held_s: 0.0,
        };
        for (all, samples) in parts {
            for one in samples.into_iter().map(|k| &all.0[k]) {
                let wider = |of: (f64, f64)| (of.0.min(one.level_v), of.1.max(one.level_v));
                let levels_v = &mut out.levels_v[usize::from(one.rises)];
                *levels_v = wider(*levels_v);
                if one.is_first {
                    out.first_v = wider(out.first_v);
                }
                out.highest_v = out.highest_v.max(one.height_v);
                out.shortest_s = out.shortest_s.min(one.duration_s);
                out.fastest = out.fastest.min(one.fastest);
                out.held_s = out.held_s.max(one.held_s);
            }
        }
        let [falling, rising] = out.levels_v;
        out.range_v = (falling.1.max(rising.1) - falling.0.min(rising.0)).max(0.0);
        out
    }
}

impl Fitted {
    /// Whether a sample lies within what was fitted.
    #[must_use]
    pub fn covers(&self, all: &Circumstances, sample: usize) -> bool {
        let one = &all.0[sample];
        let alike_v = ALIKE * self.range_v;
        let within =
            |of: (f64, f64)| one.level_v >= of.0 - alike_v && one.level_v <= of.1 + alike_v;
        within(self.levels_v[usize::from(one.rises)])
            && (!one.is_first || within(self.first_v))
            && one.height_v <= self.highest_v + alike_v
            && one.duration_s * ALIKE_IN_TIME >= self.shortest_s
            // They are known to a sample.
            && one.fastest.saturating_add(1) as f64 * ALIKE_IN_TIME >= self.fastest as f64
            && one.held_s <= self.held_s * ALIKE_IN_TIME
    }
}

/// The fewest samples in which a drive between two turns has gone by a voltage so far, sample by sample.
fn fastest(way_v: &[f64], by_v: f64) -> Vec<usize> {
    let mut fewest = usize::MAX;
    let mut start = 0;
    let so_far = way_v.iter().enumerate().map(|(end, to_v)| {
        while start < end && (to_v - way_v[start]).abs() >= by_v {
            fewest = fewest.min(end - start);
            start += 1;
        }
        fewest
    });
    so_far.collect()
}

/// Samples and voltages at which the drive turns and goes back by more than a voltage.
pub(super) fn turns(drive_v: &[f64], limit: f64) -> Vec<(usize, f64)> {
    let (mut turns, mut rising, mut extreme) = (
        Vec::new(),
        true,
        (0, drive_v.first().copied().unwrap_or(0.0)),
    );
    for (k, &u) in drive_v.iter().enumerate() {
        if (rising && u > extreme.1) || (!rising && u < extreme.1) {
            extreme = (k, u);
        } else if (u - extreme.1).abs() > limit {
            turns.push(extreme);
            (rising, extreme) = (!rising, (k, u));
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covered(drive_v: &[f64], fitted: std::ops::Range<usize>, sample: usize) -> bool {
        let all = Circumstances::of(drive_v, 1000.0);
        Circumstances::limits([(&all, fitted.collect())]).covers(&all, sample)
    }

    fn sine(samples: usize, hz: f64, high_v: f64) -> Vec<f64> {
        let at = |k: usize| (std::f64::consts::TAU * hz * k as f64 / 1000.0).cos();
        (0..samples).map(|k| 0.5 * high_v * (1.0 - at(k))).collect()
    }

    #[test]
    fn higher_faster_and_longer_than_fitted_is_outside() {
        let twice = [sine(2000, 2.0, 80.0), sine(2000, 2.0, 80.0)].concat();
        assert!((2000..4000).all(|k| covered(&twice, 0..2000, k)));
        let higher = [sine(2000, 2.0, 80.0), sine(2000, 2.0, 100.0)].concat();
        assert!(!covered(&higher, 0..2000, 2250) && covered(&higher, 2000..4000, 250));
        let faster = [sine(2000, 2.0, 80.0), sine(2000, 4.0, 80.0)].concat();
        assert!(!covered(&faster, 0..2000, 3000) && covered(&faster, 2000..4000, 1000));
        let held = [sine(2000, 2.0, 80.0), vec![0.0; 500], sine(500, 2.0, 80.0)].concat();
        assert!(!covered(&held, 0..2000, 2450) && covered(&held, 0..2450, 2950));
    }

    #[test]
    fn a_cut_way_shows_its_part_only_and_no_way_back() {
        let cut_while_rising = |sample: usize| covered(&sine(2000, 2.0, 80.0), 0..200, sample);
        assert!(cut_while_rising(190) && cut_while_rising(650));
        // Near the top, and on the way down.
        assert!(!cut_while_rising(245) && !cut_while_rising(350));
    }

    /// Steps up and down between holds as long as half a period.
    #[test]
    fn a_step_beside_sines_is_outside() {
        let steps = [vec![0.0; 250], vec![80.0; 250]].concat().repeat(4);
        let both = [sine(2000, 2.0, 80.0), steps.clone()].concat();
        assert!(!covered(&both, 0..2000, 2251));
        assert!(covered(&[steps.clone(), steps].concat(), 0..2000, 2251));
    }

    #[test]
    fn the_first_rise_is_met_where_one_was_fitted() {
        let growing = [
            sine(500, 2.0, 40.0),
            sine(500, 2.0, 80.0),
            sine(500, 2.0, 80.0),
        ]
        .concat();
        assert!(!covered(&growing, 1000..1500, 740));
        assert!(covered(&growing, 500..1000, 1240));
    }
}
