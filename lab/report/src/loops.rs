//! Loops at several amplitudes and speeds over each other: what of them depends on either is seen at a
//! glance.

use crate::explain_report::ExplainReport;
use crate::page::{CurveRole, PageBlock, Plot, Section, Series, Style};
use crate::text::figure;
use std::ops::Range;

/// A turn of the drive counts where it comes back by this share of the range.
const TURN: f64 = 0.04;
/// Smaller loops, as a share of the range, are not seen beside the largest.
const SEEN: f64 = 0.1;
/// Samples of a loop, so that it is a curve.
const SAMPLES_MIN: usize = 24;
/// Samples of a loop that are drawn.
const SAMPLES_DRAWN: usize = 400;
/// Both ends of a loop are the same to this share of its height.
const CLOSED: f64 = 0.1;
/// Loops that are drawn, each in its colour.
const COLOURS: [CurveRole; 4] = [
    CurveRole::Other1,
    CurveRole::Other2,
    CurveRole::Other3,
    CurveRole::Other4,
];

/// One closed loop of a record.
struct Loop {
    record: usize,
    samples: Range<usize>,
    height_v: f64,
    speed_v_s: f64,
}

/// Samples at which the drive turns, alternately low and high.
fn turns(u_v: &[f64], least_v: f64) -> Vec<usize> {
    let mut out: Vec<usize> = Vec::new();
    let Some(first) = u_v.first() else { return out };
    // The extreme since the last turn, and the way that led to it.
    let (mut extreme, mut at, mut up) = (*first, 0, None);
    for (k, u) in u_v.iter().enumerate() {
        match up {
            None if (u - first).abs() > least_v => (extreme, at, up) = (*u, k, Some(u > first)),
            None => {}
            Some(up_now) => {
                let further = if up_now { *u > extreme } else { *u < extreme };
                if further {
                    (extreme, at) = (*u, k);
                } else if (u - extreme).abs() > least_v {
                    out.push(at);
                    (extreme, at, up) = (*u, k, Some(!up_now));
                }
            }
        }
    }
    out
}

/// Closed loops of all records, from low turn to low turn.
fn loops(report: &ExplainReport, range_v: f64) -> Vec<Loop> {
    let mut out = Vec::new();
    for (record, r) in report.records.iter().enumerate() {
        let turns = turns(&r.u_v, TURN * range_v);
        for w in turns.windows(3) {
            let (low, high) = (r.u_v[w[0]], r.u_v[w[1]]);
            let height_v = high - low;
            let closed = height_v > SEEN * range_v && (r.u_v[w[2]] - low).abs() < CLOSED * height_v;
            let whole = r
                .residual_um
                .last()
                .is_some_and(|left| left[w[0]..w[2]].iter().all(|e| e.is_finite()));
            if closed && whole && w[2] - w[0] >= SAMPLES_MIN {
                let seconds = (w[2] - w[0]) as f64 / r.sample_rate_hz;
                out.push(Loop {
                    record,
                    samples: w[0]..w[2] + 1,
                    height_v,
                    speed_v_s: 2.0 * height_v / seconds,
                });
            }
        }
    }
    out
}

/// Four of them that differ most in height and speed, as ratios; the highest first.
fn different(all: Vec<Loop>) -> Vec<Loop> {
    let distance = |a: &Loop, b: &Loop| {
        (a.height_v / b.height_v)
            .ln()
            .hypot((a.speed_v_s / b.speed_v_s).ln())
    };
    let mut left = all;
    let mut chosen: Vec<Loop> = Vec::new();
    while chosen.len() < COLOURS.len() {
        let worth = |l: &Loop| match chosen.as_slice() {
            [] => l.height_v,
            some => some
                .iter()
                .map(|c| distance(l, c))
                .fold(f64::INFINITY, f64::min),
        };
        let Some((at, worth)) = left
            .iter()
            .map(worth)
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        // Repetitions of one loop show nothing new.
        if !chosen.is_empty() && worth < 0.2 {
            break;
        }
        chosen.push(left.swap_remove(at));
    }
    chosen
}

/// The section; none where the drive makes no closed loop.
pub(crate) fn loops_section(report: &ExplainReport) -> Option<Section> {
    let drives = || {
        report
            .records
            .iter()
            .flat_map(|r| r.u_v.iter().copied())
            .filter(|u| u.is_finite())
    };
    let range_v =
        drives().fold(f64::NEG_INFINITY, f64::max) - drives().fold(f64::INFINITY, f64::min);
    let chosen = different(loops(report, range_v));
    let first = chosen.first()?;
    let record = &report.records[first.record];
    let ends = |values: &[f64]| {
        let u_v = &record.u_v[first.samples.clone()];
        let top = u_v
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map_or(0, |(k, _)| k);
        values[first.samples.start + top] - values[first.samples.start]
    };
    let gain_um_v = ends(&record.y_um) / ends(&record.u_v);
    let mut over_each_other = Plot::new("Loops at several amplitudes and speeds")
        .x_axis("drive", "V")
        .y_axis("displacement from the loop's low end", "um")
        .height_px(340)
        .caption("Lines: measured; dashed: modelled.");
    let mut opened = Plot::new("The same, less the straight line of the largest loop")
        .x_axis("drive", "V")
        .y_axis("displacement off the line", "nm")
        .height_px(340)
        .caption(format!(
            "Off {gain_um_v:.4} um/V. Loops that open with their speed show dynamics or a hysteresis that depends on the rate."
        ));
    for (l, role) in chosen.iter().zip(COLOURS) {
        let r = &report.records[l.record];
        let residual = r.residual_um.last()?;
        let every = (l.samples.len() / SAMPLES_DRAWN).max(1);
        let kept: Vec<usize> = l.samples.clone().step_by(every).collect();
        let low = l.samples.start;
        let u_v: Vec<f64> = kept.iter().map(|k| r.u_v[*k]).collect();
        let measured = |k: usize| r.y_um[k] - r.y_um[low];
        let modelled = |k: usize| r.y_um[k] - residual[k] - (r.y_um[low] - residual[low]);
        let line = |k: usize| gain_um_v * (r.u_v[k] - r.u_v[low]);
        let name = format!(
            "{} V at {} V/s ({})",
            figure(l.height_v),
            figure(l.speed_v_s),
            r.name
        );
        let series = |of: &dyn Fn(usize) -> f64| kept.iter().map(|k| of(*k)).collect::<Vec<f64>>();
        let drawn = |y: Vec<f64>, dashed: bool| {
            let line = Series::line(name.clone(), role, u_v.clone(), y);
            if dashed {
                line.style(Style::Dashed)
            } else {
                line
            }
        };
        over_each_other.series.extend([
            drawn(series(&measured), false),
            drawn(series(&modelled), true),
        ]);
        opened.series.extend([
            drawn(series(&|k| 1e3 * (measured(k) - line(k))), false),
            drawn(series(&|k| 1e3 * (modelled(k) - line(k))), true),
        ]);
    }
    Some(Section {
        heading: "Loops over each other".to_owned(),
        text: "The closed loops of all records that differ most in height and speed, by the last model.".to_owned(),
        blocks: vec![PageBlock::Plot(over_each_other), PageBlock::Plot(opened)],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain_report::RecordReport;
    use std::f64::consts::TAU;

    #[test]
    fn loops_that_differ_in_height_and_speed_are_found_once() {
        let record = |name: &str, hz: f64, height_v: f64| {
            let u_v: Vec<f64> = (0..4000)
                .map(|k| 0.5 * height_v * (1.0 - (TAU * hz * f64::from(k) / 1000.0).cos()))
                .collect();
            RecordReport {
                name: name.into(),
                sample_rate_hz: 1000.0,
                y_um: u_v.iter().map(|u| 0.1 * u).collect(),
                residual_um: vec![vec![0.0; u_v.len()]],
                t_s: (0..4000).map(|k| f64::from(k) / 1000.0).collect(),
                u_v,
                ..RecordReport::default()
            }
        };
        let report = ExplainReport {
            records: vec![
                record("slow", 1.0, 60.0),
                record("fast", 10.0, 60.0),
                record("small", 1.0, 15.0),
            ],
            ..ExplainReport::default()
        };
        let chosen = different(loops(&report, 60.0));
        let mut names: Vec<&str> = chosen
            .iter()
            .map(|l| report.records[l.record].name.as_str())
            .collect();
        names.sort_unstable();
        assert_eq!(names, ["fast", "slow", "small"]);
        let section = loops_section(&report).expect("loops");
        let PageBlock::Plot(plot) = &section.blocks[1] else {
            panic!("a plot")
        };
        assert!(
            plot.series
                .iter()
                .flat_map(|s| &s.y)
                .all(|y| y.abs() < 1e-6),
            "a straight line has no loop"
        );
    }
}
