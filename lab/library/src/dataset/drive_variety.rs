//! What the drives of some records can show at all, whatever the model: several loops, several speeds.

use super::data_set::Dataset;

/// Turning points closer than this share of the range count as one.
const ONE_TURNING_POINT: f64 = 0.05;
/// Speeds within this factor count as one.
const ONE_SPEED: f64 = 3.0;
/// Speeds within this factor are those of one motion. The halves of 44 files of one sine differ by 1.2 % at most,
/// sines of 37 and 50 Hz, which tell a slew limit from other effects, by 35 %.
const ONE_MOTION: f64 = 1.1;

/// A drive moves at several speeds where the fastest tenth of its way is so many times as fast as the slowest
/// quarter. Of a sine it is 1.5 times as fast, of many frequencies at once 2.8 times.
const VARIED_SPEED: f64 = 2.0;

/// Turning points and speeds of the drives of some records.
#[derive(Clone, Debug)]
pub struct DriveVariety {
    turning_points: usize,
    /// Speed that a tenth of the samples exceed, in the slowest record that moves, V/s.
    pub speed_min_v_s: f64,
    /// The same in the fastest record, V/s.
    pub speed_max_v_s: f64,
    varied_within_a_record: bool,
    /// A record stands still most of the time: its steps have every frequency.
    has_steps: bool,
}

/// The speed below which a share of the way is made, of sorted speeds at equal times. What moves fast takes
/// few samples of a recording.
fn below_on_its_way(speeds: &[f64], share: f64) -> f64 {
    let mut left = share * speeds.iter().sum::<f64>();
    let is_behind = |speed: &&f64| {
        left -= **speed;
        left <= 0.0
    };
    speeds.iter().find(is_behind).copied().unwrap_or(0.0)
}

impl DriveVariety {
    /// Of the records with these indices.
    #[must_use]
    pub fn of(dataset: &Dataset, records: &[usize]) -> Self {
        let range_v = dataset.drive_max_v - dataset.drive_min_v;
        let mut turns_v: Vec<f64> = Vec::new();
        let (mut speed_min_v_s, mut speed_max_v_s) = (f64::INFINITY, 0.0_f64);
        let (mut varied_within_a_record, mut has_steps) = (false, false);
        for record in records.iter().filter_map(|&i| dataset.records.get(i)) {
            let drive_v = &record.drive_v[record.window.clone()];
            let mut last_turn = drive_v.first().copied().unwrap_or(0.0);
            for w in drive_v.windows(3) {
                if (w[1] - w[0]) * (w[2] - w[1]) < 0.0 && (w[1] - last_turn).abs() > 0.02 * range_v
                {
                    last_turn = w[1];
                    if turns_v
                        .iter()
                        .all(|turn| (turn - last_turn).abs() > ONE_TURNING_POINT * range_v)
                    {
                        turns_v.push(last_turn);
                    }
                }
            }
            let mut speeds: Vec<f64> = drive_v
                .windows(2)
                .map(|w| (w[1] - w[0]).abs() * record.sample_rate_hz)
                .collect();
            speeds.sort_by(f64::total_cmp);
            let fast = speeds.get(speeds.len() * 9 / 10).copied().unwrap_or(0.0);
            varied_within_a_record |= fast > 0.0
                && below_on_its_way(&speeds, 0.9) > VARIED_SPEED * below_on_its_way(&speeds, 0.25);
            has_steps |= fast == 0.0 && speeds.last() > Some(&0.0);
            if fast > 0.0 {
                (speed_min_v_s, speed_max_v_s) = (speed_min_v_s.min(fast), speed_max_v_s.max(fast));
            }
        }
        Self {
            turning_points: turns_v.len(),
            speed_min_v_s,
            speed_max_v_s,
            varied_within_a_record,
            has_steps,
        }
    }

    /// The drive turns, and always at the same two voltages.
    #[must_use]
    pub fn one_loop(&self) -> bool {
        (1..=2).contains(&self.turning_points)
    }

    /// A record moves at several speeds: triangles and sines, many frequencies at once.
    #[must_use]
    pub fn varied_within_a_record(&self) -> bool {
        self.varied_within_a_record
    }

    /// One motion is repeated: between the same two voltages, at one speed, as one sine does. What depends on
    /// the voltage and what depends on the speed then look alike.
    #[must_use]
    pub fn one_motion(&self) -> bool {
        self.one_loop()
            && self.speed_max_v_s < ONE_MOTION * self.speed_min_v_s
            && !self.varied_within_a_record
            && !self.has_steps
    }

    /// All records move at the same speed.
    #[must_use]
    pub fn one_speed(&self) -> bool {
        self.speed_max_v_s < ONE_SPEED * self.speed_min_v_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::record::Record;
    use hysteron_sim::waveform;

    fn seen(drives: &[Vec<f64>]) -> DriveVariety {
        let record = |(nth, drive_v): (usize, &Vec<f64>)| {
            Record::new(format!("{nth}"), 1000.0, drive_v.clone(), drive_v.clone())
        };
        let records: Vec<Record> = drives.iter().enumerate().map(record).collect();
        let all: Vec<usize> = (0..records.len()).collect();
        DriveVariety::of(&Dataset::unchecked("stage", 0.0, 100.0, records), &all)
    }

    fn sine(frequency_hz: f64, amplitude_v: f64) -> Vec<f64> {
        let angle = |k: u32| std::f64::consts::TAU * frequency_hz * f64::from(k) / 1000.0;
        (0..2000)
            .map(|k| 50.0 - amplitude_v * angle(k).cos())
            .collect()
    }

    #[test]
    fn one_sine_or_one_triangle_is_one_motion() {
        let triangle = waveform::triangles(1000.0, 400.0, &[0.0, 80.0, 0.0, 80.0, 0.0]);
        for drives in [
            vec![sine(5.0, 40.0)],
            vec![triangle],
            vec![sine(5.0, 40.0), sine(5.1, 40.0)],
        ] {
            assert!(seen(&drives).one_motion(), "{:?}", seen(&drives));
        }
    }

    #[test]
    fn heights_frequencies_and_steps_are_more_than_one_motion() {
        let heights = waveform::triangles(1000.0, 400.0, &[0.0, 80.0, 20.0, 60.0, 0.0]);
        let lines: Vec<usize> = (1..=60).step_by(3).collect();
        let multisine = waveform::multisine(1000, &lines, 20.0, 50.0, 2, 1);
        let steps: Vec<f64> = (0..2000)
            .map(|k| if k / 500 % 2 == 0 { 10.0 } else { 70.0 })
            .collect();
        for drives in [
            vec![heights],
            vec![multisine],
            vec![steps.clone()],
            vec![sine(5.0, 40.0), steps],
            vec![sine(5.0, 40.0), sine(7.0, 40.0)],
            vec![sine(5.0, 40.0), sine(5.0, 20.0)],
        ] {
            assert!(!seen(&drives).one_motion(), "{:?}", seen(&drives));
        }
    }
}
