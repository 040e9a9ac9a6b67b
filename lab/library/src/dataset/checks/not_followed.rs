//! Parts of a record in which the readings no longer follow the drive: a sensor that lost its target, a cable
//! that came off. Creep, drift or a leaking charge would be named for them.
//!
//! The drive is cut into *ways*, from one of its large turns to the next. A way is not followed where the
//! readings stay within a small share of their range, while they follow other ways that are as fast. This says
//! something only of a drive that the readings follow slowly elsewhere: modes and filters stop a stage too.

use crate::dataset::circumstances::{ALIKE, ALIKE_IN_TIME, turns};
use crate::dataset::data_set::{Dataset, FOLLOWS, straight_line};
use crate::dataset::issue::{Issue, IssueKind, Severity};
use crate::dataset::record::{Record, Role};
use crate::statistics::{extremes, peak_to_peak};
use std::ops::Range;

/// A way crosses at least this share of the drive's range. An amplifier that saturates, or play, holds the
/// readings over less.
const CROSSES: f64 = 0.5;
/// Readings that cover this share of their range follow a way, those that stay within [`ALIKE`] do not.
const COVERS: f64 = 0.3;

/// Examines every driven record.
pub(super) fn check(dataset: &Dataset) -> Vec<Issue> {
    let driven = dataset.records.iter().filter(|r| r.role != Role::Noise);
    driven.filter_map(of_record).collect()
}

/// Parts of the whole tape, of which the record may be a window, as far as they lie in it.
fn of_record(record: &Record) -> Option<Issue> {
    let window = &record.window;
    let inside = |part: Range<usize>| part.start.max(window.start)..part.end.min(window.end);
    let parts = lost_parts(&record.drive_v, &record.displacement_um);
    if parts.is_empty() {
        return None;
    }
    let mut elsewhere = record.clone();
    elsewhere.window = 0..record.drive_v.len();
    elsewhere.leave_out(parts.iter().cloned());
    if straight_line(&[&elsewhere]).share < FOLLOWS {
        return None;
    }
    let lost: Vec<Range<usize>> = parts
        .into_iter()
        .map(inside)
        .filter(|part| !part.is_empty())
        .collect();
    let first = lost.first()?;
    let kind = IssueKind::NotFollowed {
        from_s: first.start as f64 * record.dt_s(),
        to_s: first.end as f64 * record.dt_s(),
        parts: lost.len(),
    };
    Some(Issue::of(&record.name, Severity::Corrects, kind).with_samples(lost))
}

fn lost_parts(drive_v: &[f64], reading_um: &[f64]) -> Vec<Range<usize>> {
    let crossed_v = CROSSES * peak_to_peak(drive_v);
    let mut ends: Vec<usize> = vec![0];
    ends.extend(turns(drive_v, crossed_v).iter().map(|(k, _)| k));
    ends.push(drive_v.len());
    let ways: Vec<Range<usize>> = ends
        .windows(2)
        .map(|way| way[0]..way[1])
        .filter(|way| peak_to_peak(&drive_v[way.clone()]) >= crossed_v)
        .collect();
    let range_um = peak_to_peak(reading_um);
    let covers = |way: &Range<usize>| peak_to_peak(&reading_um[way.clone()]) / range_um;
    let followed: Vec<&Range<usize>> = ways.iter().filter(|w| covers(w) > COVERS).collect();
    let would_be_followed = |way: &Range<usize>| {
        let longest = ALIKE_IN_TIME * way.len() as f64;
        followed.iter().any(|other| other.len() as f64 <= longest)
    };
    let mut lost: Vec<Range<usize>> = Vec::new();
    for way in &ways {
        if covers(way) < ALIKE && would_be_followed(way) {
            let part = as_far_as_it_stays(way, reading_um, ALIKE * range_um);
            match lost.last_mut() {
                Some(last) if last.end >= part.start => last.end = last.end.max(part.end),
                _ => lost.push(part),
            }
        }
    }
    lost
}

/// A way, and what is beside it of readings that stay there.
fn as_far_as_it_stays(way: &Range<usize>, reading_um: &[f64], within_um: f64) -> Range<usize> {
    let (low, high) = extremes(&reading_um[way.clone()]);
    let middle = 0.5 * (low + high);
    let stays = |k: &usize| (reading_um[*k] - middle).abs() <= 0.5 * within_um;
    let before = (0..way.start).rev().take_while(stays).count();
    let after = (way.end..reading_um.len()).take_while(stays).count();
    way.start - before..way.end + after
}

#[cfg(test)]
mod tests {
    use super::*;

    fn issues(drive_v: Vec<f64>, reads: impl Fn(usize, f64) -> f64) -> Vec<Issue> {
        let read = |(k, u): (usize, &f64)| reads(k, *u);
        let displacement_um = drive_v.iter().enumerate().map(read).collect();
        let record = Record::new("one", 1000.0, drive_v, displacement_um);
        check(&Dataset::unchecked("d", 0.0, 100.0, vec![record]))
    }

    fn sines(hz: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut phase = 0.0_f64;
        let next = |k: usize| {
            phase += std::f64::consts::TAU * hz(1e-3 * k as f64) / 1000.0;
            50.0 - 40.0 * phase.cos()
        };
        (0..4000).map(next).collect()
    }

    #[test]
    fn a_sensor_that_lost_its_target_is_left_out_from_there_on() {
        let noise = |k: usize| 0.003 * ((k * 7919) % 17) as f64;
        let lost = |k: usize, u: f64| if k < 3300 { 0.1 * u } else { 1.234 } + noise(k);
        let found = issues(sines(|_| 2.0), lost);
        let [issue] = &found[..] else {
            panic!("{found:?}")
        };
        let [part] = &issue.samples[..] else {
            panic!("{:?}", issue.samples)
        };
        assert!(
            (3250..=3300).contains(&part.start) && part.end == 4000,
            "{part:?}"
        );
    }

    /// Lines of equal height up to three times the frequency of a mode with little damping.
    #[test]
    fn a_mode_under_a_multisine_is_followed() {
        let drive_v: Vec<f64> = (0..4000)
            .map(|k| {
                let line = |n: i32| {
                    let n = f64::from(n);
                    (std::f64::consts::TAU * 2.5 * n * 1e-3 * f64::from(k) + 1.7 * n * n).sin()
                };
                50.0 + 4.0 * (1..=60).map(line).sum::<f64>()
            })
            .collect();
        let rad = std::f64::consts::TAU * 50.0 * 1e-3;
        let mut place = vec![50.0; drive_v.len()];
        for k in 1..place.len() - 1 {
            let (now, before) = (place[k], place[k - 1]);
            let pull = rad * rad * (drive_v[k] - now) - 0.04 * rad * (now - before);
            place[k + 1] = 2.0 * now - before + pull;
        }
        assert_eq!(issues(drive_v, |k, _| 0.1 * place[k]), []);
    }

    #[test]
    fn slow_sensors_saturated_amplifiers_and_whole_records_are_followed() {
        // A low-pass of 1 Hz under a sweep to 200 Hz: what is fast no longer moves it.
        let swept = sines(|t| 0.5 * 2.0_f64.powf(2.2 * t));
        let mut filtered = swept.clone();
        for k in 1..filtered.len() {
            filtered[k] = filtered[k - 1] + 6e-3 * (swept[k] - filtered[k - 1]);
        }
        assert_eq!(issues(swept, |k, _| 0.1 * filtered[k]), []);
        assert_eq!(issues(sines(|_| 2.0), |_, u| 0.1 * u.min(55.0)), []);
        assert_eq!(issues(sines(|_| 2.0), |_, u| 0.1 * u), []);
    }
}
