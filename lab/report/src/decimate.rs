//! Fewer points, the same picture: of each stretch of samples the smallest and the largest of every trace are
//! kept, so that no spike is lost.

/// Ascending indices of about `target` samples out of `traces[..]` (all of the same length): the first and
/// last sample, and the extremes of every trace in each of equally long stretches. All indices if there are
/// no more than `target`.
pub fn extreme_indices(traces: &[&[f64]], target: usize) -> Vec<usize> {
    let length = traces.iter().map(|t| t.len()).min().unwrap_or(0);
    if length <= target.max(2) {
        return (0..length).collect();
    }
    let stretches = (target / (2 * traces.len().max(1))).max(1);
    let mut kept = vec![0, length - 1];
    for stretch in 0..stretches {
        let (from, to) = (
            stretch * length / stretches,
            (stretch + 1) * length / stretches,
        );
        for trace in traces {
            let finite = || (from..to).filter(|&i| trace[i].is_finite());
            kept.extend(finite().min_by(|&a, &b| trace[a].total_cmp(&trace[b])));
            kept.extend(finite().max_by(|&a, &b| trace[a].total_cmp(&trace[b])));
        }
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spikes_survive() {
        let mut quiet = vec![0.0; 100_000];
        quiet[77_123] = 5.0;
        quiet[12_345] = -3.0;
        quiet[50_000] = f64::NAN;
        let ramp: Vec<f64> = (0..100_000).map(f64::from).collect();
        let kept = extreme_indices(&[&quiet, &ramp], 1000);
        assert!(kept.len() <= 1002, "{}", kept.len());
        assert!(kept.contains(&77_123) && kept.contains(&12_345));
        assert!(kept.contains(&0) && kept.contains(&99_999));
        assert!(kept.windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn short_and_empty_traces_are_kept_whole() {
        assert_eq!(extreme_indices(&[&[1.0, 2.0, 3.0]], 10), vec![0, 1, 2]);
        assert!(extreme_indices(&[], 10).is_empty());
        assert!(extreme_indices(&[&[]], 0).is_empty());
    }
}
