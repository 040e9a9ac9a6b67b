//! One recording alone as a data set: which part of it is fitted, which judges, which shows the noise.
//!
//! The drive decides. Where it rests long enough, the end of the rest shows the noise. A first jump from which the drive goes on (somebody
//! switched the amplifier on) drives the model but is not fitted. What is left is cut into sections in which the drive moves alike, and
//! each of them in two: one half is fitted, the other held out, in turns, so that every kind of motion is on both sides. A section whose loops are not
//! those of its other half is cut further: loops that are never fitted cannot be met where they are held out.

use super::holds::holds;
use super::reading::Even;
use super::{Record, Role};
use crate::statistics::peak_to_peak;
use std::ops::Range;

/// Shortest rest that shows noise, in samples and s.
const REST_MIN: usize = 200;
/// Shortest rest that shows noise, s.
const REST_MIN_S: f64 = 0.05;
/// Share of a rest that is left out at its beginning: the stage still rings and creeps.
const REST_LEFT_OUT: f64 = 0.5;
/// A change from one sample to the next by this share of the range of the drive is a jump.
const JUMP: f64 = 0.2;
/// Such jumps at the beginning are the switching on; many are the motion itself.
const JUMPS_MAX: usize = 2;
/// Frames into which the motion is cut to see how it changes.
const FRAMES: usize = 48;
/// Sections differ in speed or in width by this factor.
const ANOTHER_KIND: f64 = 2.5;
/// Most sections.
const SECTIONS_MAX: usize = 4;
/// A section is at least this part of the motion.
const SECTION_MIN: usize = 8;
/// Turns of the drive are the same where they differ by less than this share of its range.
const SAME_TURN: f64 = 0.05;
/// Samples of a part that judges, at least.
const PART_MIN: usize = 64;

/// The parts of one recording, and what is said of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Samples of each part, and what it is for.
    pub windows: Vec<(Role, Range<usize>)>,
    /// What was done, for the reader.
    pub notes: Vec<String>,
}

/// Cuts a recording into parts by its drive; the reading, um, tells a rest in noise from a small motion.
#[must_use]
pub fn parts(drive_v: &[f64], reading_um: &[f64], sample_rate_hz: f64) -> Parts {
    let samples = drive_v.len();
    let seconds = |k: usize| k as f64 / sample_rate_hz;
    let mut parts = Parts { windows: Vec::new(), notes: Vec::new() };
    let holds = holds(drive_v, reading_um, ((REST_MIN_S * sample_rate_hz) as usize).max(REST_MIN));
    // A drive that mostly rests moves in steps: its holds are the response, not rest.
    let held: usize = holds.iter().map(Range::len).sum();
    let mut first = 0;
    if holds.len() <= 2 || 2 * held < samples {
        let longest = holds.iter().max_by_key(|hold| hold.len());
        if let Some(hold) = longest {
            let from = hold.start + (REST_LEFT_OUT * hold.len() as f64) as usize;
            parts.windows.push((Role::Noise, from..hold.end));
            parts.notes.push(format!(
                "the drive rests from {:.3} to {:.3} s: what the second half of it shows is the noise",
                seconds(hold.start),
                seconds(hold.end)
            ));
        }
        if let Some(beginning) = holds.first().filter(|hold| 10 * hold.end < 9 * samples && is_beginning(drive_v, hold)) {
            first = beginning.end;
            parts.notes.push(format!(
                "the beginning up to {:.3} s, where the drive comes to rest, drives the model and is not fitted",
                seconds(first)
            ));
        }
    }
    if let Some(after) = switched_on(&drive_v[first..]).filter(|_| first == 0) {
        first = after;
        parts.notes.push(format!(
            "the drive jumps at {:.3} s, as when an amplifier is switched on: it drives the model, what follows is fitted",
            seconds(first)
        ));
    }
    let last =
        holds.last().filter(|hold| hold.end == samples && hold.start > first && parts.windows.iter().any(|(_, w)| w.end == hold.end));
    let motion = first..last.map_or(samples, |hold| hold.start);
    let sections = sections(drive_v, motion);
    let kinds = sections.len();
    let sections = with_the_loops_of_both_halves(drive_v, sections);
    let mut role = Role::Identify;
    let mut windows: Vec<(Role, Range<usize>)> = Vec::new();
    for section in &sections {
        let middle = section.start + section.len() / 2;
        for half in [section.start..middle, middle..section.end] {
            match windows.last_mut().filter(|(before, _)| *before == role) {
                Some((_, window)) => window.end = half.end,
                None => windows.push((role, half)),
            }
            role = if role == Role::Identify { Role::Validate } else { Role::Identify };
        }
        // The halves in the middle of two sections belong together: fitted, held out, held out, fitted.
        role = if role == Role::Identify { Role::Validate } else { Role::Identify };
    }
    let listed = |role: Role| {
        let of_role = windows.iter().filter(|(other, _)| *other == role);
        of_role.map(|(_, w)| format!("{:.3} to {:.3} s", seconds(w.start), seconds(w.end))).collect::<Vec<_>>().join(", ")
    };
    let kinds = match (kinds, sections.len()) {
        (1, 1) => String::new(),
        (1, _) => " (its loops differ, so that there are some on both sides)".into(),
        (kinds, _) => format!(" ({kinds} kinds of motion, each on both sides)"),
    };
    parts.notes.push(format!(
        "one recording: fitted is {}, held out {}{kinds}; a dataset.toml can name this file several times with other from_s and to_s",
        listed(Role::Identify),
        listed(Role::Validate)
    ));
    parts.windows.extend(windows);
    parts
}

/// Whether a hold is the first thing that the drive does, after at most a few samples of something else.
fn is_beginning(drive_v: &[f64], hold: &Range<usize>) -> bool {
    hold.start <= drive_v.len() / 50
}

/// The sample after the last of a few jumps early in a drive that is smooth otherwise.
fn switched_on(drive_v: &[f64]) -> Option<usize> {
    let limit = JUMP * peak_to_peak(drive_v);
    let jumps: Vec<usize> = (1..drive_v.len()).filter(|&k| (drive_v[k] - drive_v[k - 1]).abs() > limit).collect();
    let last = *jumps.last()?;
    // The transient dies out over some tenth of the record at most.
    (jumps.len() <= JUMPS_MAX && last < drive_v.len() / 3).then_some(last + 1 + drive_v.len() / 20)
}

/// Sections in which the drive moves alike: at like speeds, over like widths.
fn sections(drive_v: &[f64], motion: Range<usize>) -> Vec<Range<usize>> {
    let inside = &drive_v[motion.clone()];
    let frame = (inside.len() / FRAMES).max(2 * time_between_turns(inside)).max(PART_MIN / 2);
    let frames: Vec<&[f64]> = inside.chunks_exact(frame.min(inside.len().max(1))).collect();
    let speed = |f: &[f64]| f.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / f.len() as f64;
    let floor = 1e-3 * peak_to_peak(inside);
    let features: Vec<[f64; 2]> =
        frames.iter().map(|f| [(speed(f) + floor / f.len() as f64).ln(), (peak_to_peak(f) + floor).ln()]).collect();
    let mut bounds = vec![0];
    let mut reference = features.first().copied().unwrap_or_default();
    for (i, feature) in features.iter().enumerate().skip(1) {
        let next = features.get(i + 1).unwrap_or(feature);
        let is_other = |f: &[f64; 2]| f.iter().zip(&reference).any(|(a, b)| (a - b).abs() > ANOTHER_KIND.ln());
        if is_other(feature) && is_other(next) {
            bounds.push(i);
            reference = *feature;
        }
    }
    // Sections too short to be worth two parts join the one before.
    let shortest = (2 * PART_MIN.div_ceil(frame).max(1)).max(features.len() / SECTION_MIN);
    bounds.dedup_by(|later, earlier| *later - *earlier < shortest);
    if bounds.len() > SECTIONS_MAX || bounds.last().is_some_and(|last| features.len() - last < shortest) && bounds.len() > 1 {
        bounds.pop();
    }
    if bounds.len() > SECTIONS_MAX {
        // Many kinds: even sections have all of them on both sides as well as can be.
        bounds = (0..SECTIONS_MAX).map(|i| i * features.len() / SECTIONS_MAX).collect();
    }
    let mut ends: Vec<usize> = bounds[1..].iter().map(|frame_index| motion.start + frame_index * frame).collect();
    ends.push(motion.end);
    let mut start = motion.start;
    ends.into_iter()
        .map(|end| {
            let section = start..end;
            start = end;
            section
        })
        .collect()
}

/// Cuts the longest section whose halves turn at different voltages into as many even pieces as there may be more of.
fn with_the_loops_of_both_halves(drive_v: &[f64], sections: Vec<Range<usize>>) -> Vec<Range<usize>> {
    let uneven = |section: &&Range<usize>| has_other_loops_in_its_halves(&drive_v[(*section).clone()]);
    let Some(longest) = sections.iter().filter(uneven).max_by_key(|section| section.len()).cloned() else { return sections };
    let most = (SECTIONS_MAX + 1 - sections.len()).min(longest.len() / (2 * PART_MIN)).max(1);
    let bound = |of: usize, pieces: usize| longest.start + of * longest.len() / pieces;
    // Half a piece is a part of its own, and has to move.
    let moves =
        |pieces: &usize| (0..2 * pieces).all(|half| peak_to_peak(&drive_v[bound(half, 2 * pieces)..bound(half + 1, 2 * pieces)]) > 0.0);
    let pieces = (1..=most).rev().find(moves).unwrap_or(1);
    let cut = |section: Range<usize>| -> Vec<Range<usize>> {
        if section == longest { (0..pieces).map(|piece| bound(piece, pieces)..bound(piece + 1, pieces)).collect() } else { vec![section] }
    };
    sections.into_iter().flat_map(cut).collect()
}

/// Whether either half of a drive turns at voltages at which the other does not, though it turns.
fn has_other_loops_in_its_halves(drive_v: &[f64]) -> bool {
    let same = SAME_TURN * peak_to_peak(drive_v);
    let turns = turns(drive_v);
    let (early, late): (Vec<_>, Vec<_>) = turns.into_iter().partition(|(k, _)| *k < drive_v.len() / 2);
    let lacks = |of: &[(usize, f64)], one: &[(usize, f64)]| one.iter().any(|(_, v)| of.iter().all(|(_, other)| (v - other).abs() > same));
    (early.len() + late.len() > 1) && (lacks(&early, &late) || lacks(&late, &early))
}

/// Samples and voltages at which the drive turns and goes back by a tenth of its range at least.
fn turns(drive_v: &[f64]) -> Vec<(usize, f64)> {
    let limit = 0.1 * peak_to_peak(drive_v);
    let (mut turns, mut rising, mut extreme) = (Vec::new(), true, (0, drive_v.first().copied().unwrap_or(0.0)));
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

/// Samples between turns of the drive, on average.
fn time_between_turns(drive_v: &[f64]) -> usize {
    drive_v.len() / (turns(drive_v).len() + 1)
}

/// The records of the parts; each begins where the recording begins, so that all of the drive before it acts on the model.
pub(super) fn records(name: &str, place: &str, even: &Even, parts: &Parts) -> Vec<Record> {
    let mut counts = [0_usize; 3];
    let several = |role: Role| parts.windows.iter().filter(|(other, _)| *other == role).count() > 1;
    parts
        .windows
        .iter()
        // A rest in which the reading does not move shows no noise.
        .filter(|(role, window)| *role != Role::Noise || even.y_um[window.clone()].iter().any(|y| *y != even.y_um[window.start]))
        .map(|(role, window)| {
            let (word, count) = match role {
                Role::Identify => ("fitted", &mut counts[0]),
                Role::Noise => ("rest", &mut counts[2]),
                _ => ("held_out", &mut counts[1]),
            };
            *count += 1;
            let number = if several(*role) { format!("_{count}") } else { String::new() };
            // Rest needs no history: what is before it does not show in the noise.
            let from = if *role == Role::Noise { window.start } else { 0 };
            let to = window.end;
            Record {
                source: place.to_owned(),
                role: *role,
                window: window.start - from..to - from,
                force_n: even.force_n.as_ref().map(|f| f[from..to].to_vec()),
                auxiliary: even.auxiliary.iter().map(|signal| signal.with(|values| values[from..to].to_vec())).collect(),
                ..Record::new(
                    format!("{name}_{word}{number}"),
                    even.sample_rate_hz,
                    even.u_v[from..to].to_vec(),
                    even.y_um[from..to].to_vec(),
                )
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 1000.0;

    fn parts_of(drive_v: &[f64]) -> Parts {
        parts(drive_v, drive_v, RATE_HZ)
    }

    fn has_on_both_sides(parts: &Parts, wanted: &Range<usize>) {
        for role in [Role::Identify, Role::Validate] {
            let covered: usize = parts
                .windows
                .iter()
                .filter(|(other, _)| *other == role)
                .map(|(_, w)| w.end.min(wanted.end).saturating_sub(w.start.max(wanted.start)))
                .sum();
            assert!(covered * 4 > wanted.len(), "{role:?} has {covered} of {wanted:?}: {parts:?}");
        }
    }

    #[test]
    fn rest_shows_noise_and_a_step_to_it_is_not_fitted() {
        let mut drive = vec![0.0];
        drive.extend(vec![-90.0; 1499]);
        drive.extend((0..3000).map(|k| -90.0 + 0.03 * f64::from(k) * (1.0 - (f64::from(k) * 0.1).cos())));
        let parts = parts_of(&drive);
        assert_eq!(parts.windows[0].0, Role::Noise);
        assert!(parts.windows[0].1.start > 700 && parts.windows[0].1.end.abs_diff(1500) <= 1, "{parts:?}");
        assert!(parts.windows[1..].iter().all(|(role, w)| *role != Role::Noise && w.start >= 1500), "{parts:?}");
        has_on_both_sides(&parts, &(1500..4500));
    }

    #[test]
    fn each_kind_of_motion_is_on_both_sides() {
        let slow = (0..4000).map(|k| 30.0 - 30.0 * (f64::from(k) * 0.01).cos());
        let fast = (0..4000).map(|k| 5.0 - 5.0 * (f64::from(k) * 0.3).cos());
        let drive: Vec<f64> = slow.chain(fast).collect();
        let parts = parts_of(&drive);
        has_on_both_sides(&parts, &(0..4000));
        has_on_both_sides(&parts, &(4000..8000));
        assert!(parts.notes.last().is_some_and(|note| note.contains("2 kinds of motion")), "{:?}", parts.notes);
    }

    #[test]
    fn one_motion_is_cut_in_two_and_a_switching_on_left_out() {
        let sine = |k: i32| 150.0 * (f64::from(k) * 0.006).sin();
        let parts_of_sine = parts_of(&(0..8000).map(sine).collect::<Vec<_>>());
        assert_eq!(parts_of_sine.windows, [(Role::Identify, 0..4000), (Role::Validate, 4000..8000)]);
        let switched: Vec<f64> = (0..8000).map(|k| if k < 40 { 0.0 } else { sine(k + 220) }).collect();
        let parts = parts_of(&switched);
        assert!(parts.windows[0].1.start > 40 && parts.notes.iter().any(|n| n.contains("switched on")), "{parts:?}");
    }

    #[test]
    fn loops_of_one_half_alone_come_to_both_sides() {
        let corners = [0.0, 80.0, 0.0, 60.0, 20.0, 70.0, 10.0, 40.0, 0.0];
        let drive: Vec<f64> =
            corners.windows(2).flat_map(|w| (0..1000).map(move |k| w[0] + (w[1] - w[0]) * f64::from(k) / 1000.0)).collect();
        let cut = parts_of(&drive);
        // The outer loop, and the inner ones.
        has_on_both_sides(&cut, &(0..2000));
        has_on_both_sides(&cut, &(3000..7000));
        assert!(cut.notes.last().is_some_and(|note| note.contains("its loops differ")), "{:?}", cut.notes);
        // Nothing is cut so finely that a part rests.
        let resting: Vec<f64> = drive[..5000].iter().copied().chain(vec![drive[4999]; 1500]).chain(drive[5000..].iter().copied()).collect();
        let cut = parts_of(&resting);
        assert!(
            cut.windows.iter().filter(|(role, _)| *role != Role::Noise).all(|(_, w)| peak_to_peak(&resting[w.clone()]) > 0.0),
            "{cut:?}"
        );
        // The same loop over and over is cut once.
        let same: Vec<f64> = (0..8).flat_map(|_| drive[..2000].to_vec()).collect();
        assert_eq!(parts_of(&same).windows.len(), 2);
    }

    #[test]
    fn a_staircase_is_no_rest() {
        let stairs: Vec<f64> = (0..8000).map(|k| f64::from((k / 500) % 8)).collect();
        let parts = parts_of(&stairs);
        assert!(parts.windows.iter().all(|(role, _)| *role != Role::Noise), "{parts:?}");
    }

    #[test]
    fn a_record_that_rests_for_most_of_its_time_is_judged_where_it_moves() {
        let mut drive = vec![-5.0; 5001];
        drive.extend((0..3000).map(|k| -5.0 + 20.0 * (f64::from(k) * 0.1).sin()));
        let parts = parts_of(&drive);
        assert!(parts.windows[1..].iter().all(|(_, w)| w.start >= 5001), "{parts:?}");
        has_on_both_sides(&parts, &(5001..8000));
    }

    #[test]
    fn short_and_odd_drives_are_cut_somehow() {
        for drive in
            [vec![1.0; 64], vec![0.0; 65], (0..70).map(f64::from).collect(), (0..300).map(|k| f64::from(k % 2)).collect::<Vec<_>>()]
        {
            let parts = parts_of(&drive);
            assert!(parts.windows.iter().all(|(_, w)| w.end <= drive.len() && w.start <= w.end), "{parts:?}");
        }
    }
}
