//! Does a reading jump once, and stay there?
//!
//! A target that slips in its clamp, or a counter that loses steps, moves a sensor's zero within one sample. No
//! effect of a stage does so while its drive moves on, but a search takes creep or a drift for it. The jump
//! hides in the motion of the record; it stands out in what a model misses, once the model follows that motion.

use super::subject::{Moment, Subject};
use crate::dataset::checks::{ALONE_SHARE, ALONE_WITHIN, is_alone, near_a_jump, stands_out};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::{Dataset, Record};
use crate::identification::fit::residual;
use crate::parallel;
use crate::statistics::mean;
use hysteron_sim::chain::Model;
use std::collections::BTreeMap;

/// From this sample on the reading stays by so much higher.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Jump {
    sample: usize,
    by_um: f64,
}

/// Looks for one jump of each tape in what a model misses; several are no slip of a sensor.
pub(super) fn check(subject: &Subject) -> Vec<Issue> {
    let judged = match subject.moment {
        Moment::LoopsAndMode(_, best) => best,
        Moment::End(end) => end.last,
        _ => return Vec::new(),
    };
    found(subject.dataset, &judged.model)
}

fn found(dataset: &Dataset, model: &Model) -> Vec<Issue> {
    let jumps = parallel::map(&dataset.records, |record| {
        jumps_of(record, &residual(model, record))
    });
    let mut of_tapes: BTreeMap<&str, BTreeMap<usize, Issue>> = BTreeMap::new();
    for (record, jumps) in dataset.records.iter().zip(jumps) {
        let of_tape = of_tapes.entry(&record.source).or_default();
        for Jump { sample, by_um } in jumps {
            let kind = IssueKind::SensorJump {
                sample,
                at_s: sample as f64 * record.dt_s(),
                by_um,
            };
            let issue = Issue::of(&record.name, Severity::Notes, kind);
            of_tape.entry(sample).or_insert(issue);
        }
    }
    let only_ones = of_tapes.into_values().filter(|issues| issues.len() == 1);
    only_ones.flat_map(BTreeMap::into_values).collect()
}

/// Every jump in what a model misses of a record, from the first sample of the window on.
fn jumps_of(record: &Record, missed_um: &[f64]) -> Vec<Jump> {
    let steps: Vec<f64> = missed_um.windows(2).map(|w| w[1] - w[0]).collect();
    let n = steps.len();
    // A second jump of a tape is not looked for: no third search would begin.
    if n <= 2 * ALONE_WITHIN || !record.steps_at.is_empty() {
        return Vec::new();
    }
    let sizes: Vec<f64> = steps.iter().map(|step| step.abs()).collect();
    let usual_everywhere = mean(&sizes);
    let jump = |k: usize| {
        let before: Vec<f64> = missed_um[k + 1 - ALONE_WITHIN..=k]
            .iter()
            .rev()
            .copied()
            .collect();
        let by_um = come_from(&missed_um[k + 1..k + 1 + ALONE_WITHIN]) - come_from(&before);
        let stays = (by_um - steps[k]).abs() < ALONE_SHARE * sizes[k];
        let sample = record.window.start + k;
        let moved = std::iter::once(&record.drive_v)
            .chain(&record.force_n)
            .chain(record.auxiliary.iter().map(|signal| &signal.values))
            .any(|signal| near_a_jump(signal, sample));
        (is_alone(&sizes, k) && stays && !moved).then_some(Jump {
            sample: sample + 1,
            by_um,
        })
    };
    (ALONE_WITHIN..n - ALONE_WITHIN)
        .filter(|k| stands_out(&sizes, usual_everywhere, *k))
        .filter_map(jump)
        .collect()
}

/// Where a straight line through values comes from, half a sample before the first.
fn come_from(values: &[f64]) -> f64 {
    let middle = 0.5 * (values.len() as f64 - 1.0);
    let (mut moment, mut squares) = (0.0, 0.0);
    for (k, value) in values.iter().enumerate() {
        moment += (k as f64 - middle) * value;
        squares += (k as f64 - middle).powi(2);
    }
    mean(values) - moment / squares * (middle + 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hysteron_sim::noise::WhiteNoise;

    /// A record whose window begins at 1000, and what a model misses of it inside.
    fn missed(of_sample: impl Fn(usize) -> f64) -> Vec<Jump> {
        let mut noise = WhiteNoise::new(0.003, 4);
        let drive_v = (0..4000).map(|k| 40.0 * (0.01 * f64::from(k)).sin());
        let mut record = Record::new("r", 1000.0, drive_v.collect(), vec![0.0; 4000]);
        record.window = 1000..4000;
        let missed_um: Vec<f64> = record
            .window
            .clone()
            .map(|k| of_sample(k) + 0.02 * (0.03 * k as f64).sin() + noise.next_um())
            .collect();
        jumps_of(&record, &missed_um)
    }

    #[test]
    fn what_stays_is_a_jump_and_what_comes_back_is_none() {
        let found = missed(|k| if k > 2500 { -0.2 } else { 0.0 });
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].sample, 2501);
        assert!((found[0].by_um + 0.2).abs() < 0.01, "{found:?}");
        // A reading that stands alone, a motion over several samples, a swing.
        assert_eq!(missed(|k| if k == 2500 { 0.2 } else { 0.0 }), []);
        let slow = |k: usize| 0.05 * (k.clamp(2500, 2504) - 2500) as f64;
        assert_eq!(missed(slow), []);
        let rings = |k: usize| {
            let since = k as f64 - 2500.0;
            if since > 0.0 {
                0.2 * (-0.05 * since).exp() * (2.0 * since).cos()
            } else {
                0.0
            }
        };
        assert_eq!(missed(rings), []);
        assert_eq!(missed(|_| 0.0), []);
    }
}
