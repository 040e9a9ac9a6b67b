//! One recording alone as a data set: which part of it is fitted, which judges, which shows the noise.
//!
//! The drive decides. Where it rests long enough, the end of the rest shows the noise; holds between steps
//! are the response to them and no rest. A rest at the beginning drives the model but is not fitted, and so
//! does a first jump from which the drive goes on (somebody switched the amplifier on). What is left is cut
//! into sections in which the drive moves alike (`motion_sections`), and each of them in two: one half is
//! fitted, the other held out, in turns, so that every kind of motion is on both sides. The drive moves in
//! every part.

use super::circumstances::{Circumstances, SEARCHED_SAMPLES};
use super::data_set::SAMPLES_MIN;
use super::even_signals::Even;
use super::holds::holds;
use super::motion_sections::{Section, moves, runs_of_steps, sections};
use super::record::{Record, Role};
use crate::statistics::{extremes, peak_to_peak};
use hysteron_sim::chain::InitialState;
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
/// A hold begins or ends a recording where so small a part of it is before or behind.
const BEGINNING: usize = 50;

/// The parts of one recording, and the notes on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Samples of each part, and what it is for.
    pub windows: Vec<(Role, Range<usize>)>,
    /// What is behind the beginning that shows as much, and judges nothing.
    pub later: Option<Range<usize>>,
    /// What was done, for the reader.
    pub notes: Vec<String>,
}

/// The motion of a recording beside its rests.
struct Motion {
    /// Rests, and notes on them.
    parts: Parts,
    whole: Range<usize>,
    /// Holds that are no beginning.
    holds: Vec<Range<usize>>,
}

/// A recording of which all motion has one role; the reading, um, tells a rest in noise from a small motion.
#[must_use]
pub fn undivided(drive_v: &[f64], reading_um: &[f64], sample_rate_hz: f64, role: Role) -> Parts {
    let Motion {
        mut parts, whole, ..
    } = motion(drive_v, reading_um, sample_rate_hz);
    parts.windows.push((role, whole));
    parts
}

/// Where a recording moves, by its drive.
fn motion(drive_v: &[f64], reading_um: &[f64], sample_rate_hz: f64) -> Motion {
    let samples = drive_v.len();
    let seconds = |k: usize| k as f64 / sample_rate_hz;
    let mut parts = Parts {
        windows: Vec::new(),
        later: None,
        notes: Vec::new(),
    };
    let holds = holds(
        drive_v,
        reading_um,
        ((REST_MIN_S * sample_rate_hz) as usize).max(REST_MIN),
    );
    let beginning = holds
        .first()
        .filter(|hold| hold.end < samples && hold.start <= samples / BEGINNING);
    let later = &holds[usize::from(beginning.is_some())..];
    // Holds between steps are the response, and the last of them is no rest either.
    let steps = runs_of_steps(drive_v, later);
    let is_response = |hold: &Range<usize>| steps.iter().any(|run| run.contains(hold));
    let end = later
        .last()
        .filter(|hold| samples - hold.end <= samples / BEGINNING && !is_response(hold));
    // Where it moves nowhere else, it jumps to where it stays.
    let end = end.filter(|hold| moves(&drive_v[beginning.map_or(0, |hold| hold.end)..hold.start]));
    let held: usize = holds.iter().map(Range::len).sum();
    let mostly_moves = holds.len() <= 2 && later.len() <= 1 || 2 * held < samples;
    let shows_noise = |hold: &&Range<usize>| {
        let is_last = later.last() == Some(*hold) && samples - hold.end <= samples / BEGINNING;
        !is_response(hold) && (!is_last || end == Some(*hold))
    };
    let rest = holds
        .iter()
        .filter(shows_noise)
        .max_by_key(|hold| hold.len());
    if let Some(hold) = rest.or_else(|| {
        holds
            .iter()
            .max_by_key(|hold| hold.len())
            .filter(|_| mostly_moves)
    }) {
        let from = hold.start + (REST_LEFT_OUT * hold.len() as f64) as usize;
        parts.windows.push((Role::Noise, from..hold.end));
        parts.notes.push(format!(
            "the drive rests from {:.3} to {:.3} s: what the second half of it shows is the noise",
            seconds(hold.start),
            seconds(hold.end)
        ));
    }
    let mut first = 0;
    if let Some(beginning) = beginning {
        first = beginning.end;
        parts.notes.push(format!(
            "the beginning up to {:.3} s, where the drive comes to rest, drives the model and is not fitted",
            seconds(first)
        ));
    } else if let Some(after) =
        switched_on(drive_v).filter(|after| moves(&drive_v[(*after).min(samples)..]))
    {
        first = after;
        parts.notes.push(format!(
            "the drive jumps at {:.3} s, as when an amplifier is switched on: it drives the model, what follows is fitted",
            seconds(first)
        ));
    }
    if let Some(end) = end {
        parts.notes.push(format!(
            "the end from {:.3} s, where the drive rests, is not fitted",
            seconds(end.start)
        ));
    }
    Motion {
        parts,
        whole: first..end.map_or(samples, |hold| hold.start),
        holds: later.to_vec(),
    }
}

/// Cuts a recording into parts by its drive; the reading, um, tells a rest in noise from a small motion.
#[must_use]
pub fn parts(drive_v: &[f64], reading_um: &[f64], sample_rate_hz: f64) -> Parts {
    let Motion {
        mut parts,
        whole,
        holds,
    } = motion(drive_v, reading_um, sample_rate_hz);
    let seconds = |k: usize| k as f64 / sample_rate_hz;
    let circumstances = Circumstances::of(drive_v, sample_rate_hz);
    let (motion, alike) = circumstances.beginning(&whole, SEARCHED_SAMPLES);
    if motion.end < whole.end {
        parts.notes.push(format!(
            "a long recording: searched and fitted up to {:.3} s; {:.0} % of what is later moves within the limits of that (voltage, height of the loop, rate, time at a level), and no fit has seen it",
            seconds(motion.end),
            100.0 * alike
        ));
        parts.later = Some(motion.end..whole.end);
    }
    let (kinds, sections) = sections(drive_v, motion.clone(), &holds);
    let (mut windows, count) = (0..1 << sections.len())
        .map(|pattern| {
            let cut = in_halves(&sections, motion.end, pattern);
            let count = cut.len();
            (that_move(cut, drive_v, reading_um, motion.clone()), count)
        })
        .min_by_key(|(windows, _)| {
            let (outside, held_out) = beyond(&circumstances, windows);
            let samples: usize = outside.iter().map(Range::len).sum();
            // To the hundredth: of two that do the same the one that alternates.
            (held_out == 0, (100 * samples).div_ceil(held_out.max(1)))
        })
        .unwrap_or_default();
    let some_joined = windows.len() < count;
    let outside = beyond(&circumstances, &windows).0;
    let judged = without(&windows, &outside);
    let judges = |(role, w): &(Role, Range<usize>)| {
        *role == Role::Validate && moves(&drive_v[w.clone()]) && moves(&reading_um[w.clone()])
    };
    if !outside.is_empty() && judged.iter().any(judges) {
        let each = |w: &Range<usize>| span(seconds(w.start), seconds(w.end));
        parts.notes.push(format!(
            "{} of what is held out lies beyond what is fitted (voltage, height of the loop, rate, time at a level): how a model extrapolates there decides nothing",
            outside.iter().map(each).collect::<Vec<_>>().join(", ")
        ));
        windows = judged;
        parts
            .windows
            .extend(outside.into_iter().map(|w| (Role::Test, w)));
    }
    let listed = |role: Role| {
        let of_role = windows.iter().filter(|(other, _)| *other == role);
        of_role
            .map(|(_, w)| span(seconds(w.start), seconds(w.end)))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let kinds = match (kinds, sections.len()) {
        _ if some_joined || sections.iter().any(|section| section.cuts.len() < 2) => String::new(),
        (1, 1) => String::new(),
        (1, _) => " (its loops differ, so that there are some on both sides)".into(),
        (kinds, _) => format!(" ({kinds} kinds of motion, each on both sides)"),
    };
    let held_out = match listed(Role::Validate) {
        none if none.is_empty() => {
            "nothing is held out, since there is too little motion for two parts".into()
        }
        some => format!("held out {some}{kinds}"),
    };
    parts.notes.push(format!(
        "one recording: fitted is {}, {held_out}; a dataset.toml can name this file several times with other from_s and to_s",
        listed(Role::Identify)
    ));
    parts.windows.extend(windows);
    parts
}

/// Stretches of held-out windows whose circumstances no fitted one has, and how many samples are held out.
fn beyond(
    circumstances: &Circumstances,
    windows: &[(Role, Range<usize>)],
) -> (Vec<Range<usize>>, usize) {
    let of = |role: Role| {
        let of_role = windows.iter().filter(move |(other, _)| *other == role);
        of_role.map(|(_, window)| window.clone())
    };
    let fitted = Circumstances::limits([(circumstances, of(Role::Identify).flatten().collect())]);
    let mut outside: Vec<Range<usize>> = Vec::new();
    for window in of(Role::Validate) {
        let first = outside.len();
        for k in window.clone() {
            if fitted.covers(circumstances, k) {
                continue;
            }
            // What is left between two stretches, or beside one, is long enough to judge, or goes with it.
            let follows = |last: &&mut Range<usize>| k < last.end + SAMPLES_MIN;
            match outside[first..].last_mut().filter(follows) {
                Some(last) => last.end = k + 1,
                None if k < window.start + SAMPLES_MIN => outside.push(window.start..k + 1),
                None => outside.push(k..k + 1),
            }
        }
        let last = outside[first..].last_mut();
        if let Some(last) = last.filter(|last| window.end < last.end + SAMPLES_MIN) {
            last.end = window.end;
        }
    }
    outside.retain(|range| range.len() >= SAMPLES_MIN);
    (outside, of(Role::Validate).map(|w| w.len()).sum())
}

/// Windows without stretches that do not judge.
fn without(
    windows: &[(Role, Range<usize>)],
    outside: &[Range<usize>],
) -> Vec<(Role, Range<usize>)> {
    let mut out = Vec::new();
    for (role, window) in windows {
        let mut at = window.start;
        let inside = outside
            .iter()
            .filter(|o| o.start >= window.start && o.end <= window.end);
        for gap in inside {
            out.push((*role, at..gap.start));
            at = gap.end;
        }
        out.push((*role, at..window.end));
    }
    out.retain(|(_, window)| !window.is_empty());
    out
}

/// The halves of the sections, one fitted and one held out; neighbours for the same are one window. With
/// pattern 0 both alternate: the halves in the middle of two sections belong together. Each bit of the pattern
/// exchanges those of a section.
fn in_halves(sections: &[Section], end: usize, pattern: usize) -> Vec<(Role, Range<usize>)> {
    let mut role = Role::Identify;
    let mut windows: Vec<(Role, Range<usize>)> = Vec::new();
    for (i, section) in sections.iter().enumerate() {
        let end = sections.get(i + 1).map_or(end, Section::start);
        let middle = section.middle();
        // One step alone cannot be cut, and goes with what is before it.
        let halves: Vec<Range<usize>> = [section.start()..middle, middle..end]
            .into_iter()
            .filter(|half| !half.is_empty())
            .collect();
        if halves.len() == 1 && !windows.is_empty() {
            role = other(role);
        }
        let exchanged = halves.len() == 2 && pattern >> i & 1 == 1;
        if exchanged {
            role = other(role);
        }
        for half in halves {
            match windows.last_mut().filter(|(before, _)| *before == role) {
                Some((_, window)) => window.end = half.end,
                None => windows.push((role, half)),
            }
            role = other(role);
        }
        // The halves in the middle of two sections belong together: fitted, held out, held out, fitted.
        if !exchanged {
            role = other(role);
        }
    }
    windows
}

fn other(role: Role) -> Role {
    if role == Role::Identify {
        Role::Validate
    } else {
        Role::Identify
    }
}

/// Windows in which drive and reading move and that are long enough; any other window belongs to its
/// neighbour.
fn that_move(
    cut: Vec<(Role, Range<usize>)>,
    drive_v: &[f64],
    reading_um: &[f64],
    motion: Range<usize>,
) -> Vec<(Role, Range<usize>)> {
    let is_part = |w: &Range<usize>| {
        w.len() >= SAMPLES_MIN && moves(&drive_v[w.clone()]) && moves(&reading_um[w.clone()])
    };
    let mut windows: Vec<(Role, Range<usize>)> = Vec::new();
    for (role, range) in cut {
        match windows.last_mut() {
            Some((before, window)) if *before == role || !is_part(&range) => window.end = range.end,
            Some((before, window)) if !is_part(window) => (*before, window.end) = (role, range.end),
            _ => windows.push((role, range)),
        }
    }
    match windows.as_mut_slice() {
        [] => windows.push((Role::Identify, motion)),
        [(role, _)] => *role = Role::Identify,
        _ => {}
    }
    // What is left of a recording may be less than a record needs.
    if let [(_, only)] = windows.as_mut_slice()
        && only.len() < SAMPLES_MIN
    {
        only.start = only.end.saturating_sub(SAMPLES_MIN);
    }
    windows
}

/// The sample after the last of a few jumps early in a drive that is smooth otherwise.
fn switched_on(drive_v: &[f64]) -> Option<usize> {
    let limit = JUMP * peak_to_peak(drive_v);
    let jumps: Vec<usize> = (1..drive_v.len())
        .filter(|&k| (drive_v[k] - drive_v[k - 1]).abs() > limit)
        .collect();
    let last = *jumps.last()?;
    // The transient dies out over some tenth of the record at most.
    (jumps.len() <= JUMPS_MAX && last < drive_v.len() / 3).then_some(last + 1 + drive_v.len() / 20)
}

/// The records of the parts: what is fitted, what is held out, and rests. Fitted and held-out parts each make
/// one record of the whole tape, in which the other parts do not count: one initial state and one constant
/// then hold from its first sample to its last, and slow motion has to be in the model.
pub(super) fn records(name: &str, place: &str, even: &Even, parts: &Parts) -> Vec<Record> {
    let whole = |word: &str, role: Role| Record {
        source: place.to_owned(),
        role,
        left_out: even.bridged.clone(),
        force_n: even.force_n.clone(),
        auxiliary: even.auxiliary.clone(),
        ..Record::new(
            format!("{name}_{word}"),
            even.sample_rate_hz,
            even.u_v.clone(),
            even.y_um.clone(),
        )
    };
    let windows = |role: Role| {
        parts
            .windows
            .iter()
            .filter(move |(other, _)| *other == role)
            .map(|(_, window)| window.clone())
    };
    // A rest in which the reading does not move shows no noise.
    let shows_noise = |window: &Range<usize>| {
        even.y_um[window.clone()]
            .iter()
            .any(|y| *y != even.y_um[window.start])
    };
    let rests = windows(Role::Noise).filter(shows_noise).map(|window| {
        // Rest needs no history: what is before it does not show in the noise.
        Record {
            window: 0..window.len(),
            ..cut(whole("rest", Role::Noise), window)
        }
    });
    let made_of = |word: &str, role: Role, windows: Vec<Range<usize>>| {
        let (first, last) = (windows.first()?, windows.last()?);
        let mut record = Record {
            window: first.start..last.end,
            initial_state: if begins_standing_still(&even.u_v) {
                InitialState::Settled
            } else {
                InitialState::Unknown
            },
            state_is_assumed: true,
            ..whole(word, role)
        };
        let gaps: Vec<Range<usize>> = windows
            .windows(2)
            .map(|pair| pair[0].end..pair[1].start)
            .collect();
        record.leave_out(gaps);
        Some(record)
    };
    rests
        .chain(
            [
                ("fitted", Role::Identify),
                ("held_out", Role::Validate),
                ("extrapolated", Role::Test),
            ]
            .into_iter()
            .filter_map(|(word, role)| made_of(word, role, windows(role).collect())),
        )
        .chain(made_of(
            "later",
            Role::Test,
            parts.later.clone().into_iter().collect(),
        ))
        .collect()
}

/// A stretch of time to the millisecond, or to as many digits as its ends differ in.
fn span(from_s: f64, to_s: f64) -> String {
    let ends = |digits: usize| [from_s, to_s].map(|s| format!("{s:.digits$}"));
    let differ = |ends: &[String; 2]| ends[0] != ends[1];
    let [from, to] = (3..9).map(ends).find(differ).unwrap_or_else(|| ends(3));
    format!("{from} to {to} s")
}

/// A record without what is outside a range.
fn cut(mut record: Record, range: Range<usize>) -> Record {
    let inside = |k: usize| k.clamp(range.start, range.end) - range.start;
    let left_out = std::mem::take(&mut record.left_out);
    record.leave_out(
        left_out
            .into_iter()
            .map(|out| inside(out.start)..inside(out.end)),
    );
    record.drive_v = record.drive_v[range.clone()].to_vec();
    record.displacement_um = record.displacement_um[range.clone()].to_vec();
    record.force_n = record
        .force_n
        .map(|force_n| force_n[range.clone()].to_vec());
    record.auxiliary = record
        .auxiliary
        .iter()
        .map(|signal| signal.with(|values| values[range.clone()].to_vec()))
        .collect();
    record
}

/// Samples over which a drive that begins at rest hardly moves.
const STANDS_STILL: usize = 16;
/// By less than this share of its range.
const HARDLY: f64 = 2e-3;
/// A drive is at zero, or at an end of its range, where it is nearer than this share of it.
const AT_ITS_END: f64 = 1e-3;

/// Whether a drive begins standing still at zero or at the lower end of its range, as somebody begins who has
/// just switched on.
fn begins_standing_still(drive_v: &[f64]) -> bool {
    let (low, high) = extremes(drive_v);
    let first = drive_v[0];
    let at_an_end = [0.0, low]
        .into_iter()
        .any(|end| (first - end).abs() <= AT_ITS_END * (high - low));
    at_an_end
        && drive_v
            .iter()
            .take(STANDS_STILL)
            .all(|u| (u - first).abs() <= HARDLY * (high - low))
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
                .map(|(_, w)| {
                    w.end
                        .min(wanted.end)
                        .saturating_sub(w.start.max(wanted.start))
                })
                .sum();
            assert!(
                covered * 4 > wanted.len(),
                "{role:?} has {covered} of {wanted:?}: {parts:?}"
            );
        }
    }

    #[test]
    fn rest_shows_noise_and_a_step_to_it_is_not_fitted() {
        let mut drive = vec![0.0];
        drive.extend(vec![-90.0; 1499]);
        drive.extend(
            (0..3000).map(|k| -90.0 + 0.03 * f64::from(k) * (1.0 - (f64::from(k) * 0.1).cos())),
        );
        let parts = parts_of(&drive);
        assert_eq!(parts.windows[0].0, Role::Noise);
        assert!(
            parts.windows[0].1.start > 700 && parts.windows[0].1.end.abs_diff(1500) <= 1,
            "{parts:?}"
        );
        assert!(
            parts.windows[1..]
                .iter()
                .all(|(role, w)| *role != Role::Noise && w.start >= 1500),
            "{parts:?}"
        );
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
        assert!(
            parts
                .notes
                .last()
                .is_some_and(|note| note.contains("2 kinds of motion")),
            "{:?}",
            parts.notes
        );
    }

    #[test]
    fn of_a_long_recording_the_beginning_is_cut_and_the_rest_stays_unseen() {
        let triangles = triangles(50.0, 2000, 100);
        let parts = parts_of(&triangles);
        let end = SEARCHED_SAMPLES / 2;
        assert_eq!(parts.later, Some(end..triangles.len()), "{:?}", parts.notes);
        assert!(parts.windows.iter().all(|(_, w)| w.end <= end));
        assert!(
            parts
                .notes
                .iter()
                .any(|n| n.contains("100 % of what is later"))
        );
        // What only comes later lengthens the beginning.
        let larger: Vec<f64> = triangles.iter().map(|v| 2.0 * v).collect();
        let parts = parts_of(&[&triangles[..end], &larger].concat());
        assert_eq!(parts.later.unwrap().start, 3 * SEARCHED_SAMPLES / 4);
        assert_eq!(parts_of(&triangles[..SEARCHED_SAMPLES]).later, None);
    }

    #[test]
    fn a_short_stretch_has_two_ends() {
        assert_eq!(span(0.0018, 0.0022), "0.0018 to 0.0022 s");
        assert_eq!(span(1.25, 2.0), "1.250 to 2.000 s");
    }

    #[test]
    fn samples_that_nobody_recorded_are_left_out_of_each_part() {
        let drive_v: Vec<f64> = (0..8000)
            .map(|k| 50.0 - 50.0 * (f64::from(k) * 0.006).cos())
            .collect();
        let even = Even {
            sample_rate_hz: 1000.0,
            start_s: 0.0,
            y_um: drive_v.iter().map(|u| 0.1 * u).collect(),
            u_v: drive_v,
            force_n: None,
            auxiliary: Vec::new(),
            bridged: vec![2000..2002, 6000..6002],
            units: crate::dataset::units::SignalUnits::default(),
            notes: Vec::new(),
        };
        let parts = Parts {
            windows: vec![
                (Role::Noise, 1990..2100),
                (Role::Identify, 1500..4000),
                (Role::Validate, 4000..8000),
            ],
            later: None,
            notes: Vec::new(),
        };
        let records = records("d", "d.csv", &even, &parts);
        assert_eq!(records[0].left_out, vec![10..12]);
        assert!(
            records[1..]
                .iter()
                .all(|r| !r.counts(2001) && !r.counts(6000) && r.counts(6002))
        );
    }

    #[test]
    fn one_motion_is_cut_in_two_and_a_switching_on_left_out() {
        let sine = |k: i32| 150.0 * (f64::from(k) * 0.006).sin();
        let parts_of_sine = parts_of(&(0..8000).map(sine).collect::<Vec<_>>());
        assert_eq!(
            parts_of_sine.windows,
            [(Role::Identify, 0..4000), (Role::Validate, 4000..8000)]
        );
        let switched: Vec<f64> = (0..8000)
            .map(|k| if k < 40 { 0.0 } else { sine(k + 220) })
            .collect();
        let parts = parts_of(&switched);
        assert!(
            parts.windows[0].1.start > 40 && parts.notes.iter().any(|n| n.contains("switched on")),
            "{parts:?}"
        );
    }

    /// The highest loop is in the second of two kinds of motion that would alternate; what only one part shows
    /// and cannot be on both sides judges nothing.
    #[test]
    fn what_is_held_out_lies_within_what_is_fitted() {
        let corners = [0.0, 60.0, 20.0, 80.0, 0.0, 100.0, 40.0, 70.0, 10.0, 50.0];
        let drive: Vec<f64> = corners
            .windows(2)
            .flat_map(|w| (0..1000).map(move |k| w[0] + (w[1] - w[0]) * f64::from(k) / 1000.0))
            .collect();
        let high = |role: Role| {
            let parts = parts_of(&drive);
            let of_role = parts.windows.iter().filter(|(other, _)| *other == role);
            of_role
                .flat_map(|(_, w)| drive[w.clone()].to_vec())
                .fold(0.0, f64::max)
        };
        assert!(high(Role::Identify) > 99.0, "{}", high(Role::Identify));
        let growing: Vec<f64> = (0..8000)
            .map(|k| 0.01 * f64::from(k) * (1.0 - (f64::from(k) * 0.05).cos()))
            .collect();
        let parts = parts_of(&growing);
        let held_out = parts
            .windows
            .iter()
            .filter(|(role, _)| *role == Role::Validate);
        let highest = held_out
            .flat_map(|(_, w)| growing[w.clone()].to_vec())
            .fold(0.0, f64::max);
        assert!(highest < 155.0 && highest > 100.0, "{highest} {parts:?}");
        // A chirp is fitted where it is fastest.
        let chirp: Vec<f64> = (0..8000)
            .map(|k| 50.0 - 50.0 * (2e-6 * f64::from(k) * f64::from(k)).cos())
            .collect();
        let parts = parts_of(&chirp);
        let last = parts.windows.iter().max_by_key(|(_, w)| w.end).unwrap();
        assert_eq!(last.0, Role::Identify, "{parts:?}");
    }

    #[test]
    fn loops_of_one_half_alone_come_to_both_sides() {
        let corners = [0.0, 80.0, 0.0, 60.0, 20.0, 70.0, 10.0, 40.0, 0.0];
        let drive: Vec<f64> = corners
            .windows(2)
            .flat_map(|w| (0..1000).map(move |k| w[0] + (w[1] - w[0]) * f64::from(k) / 1000.0))
            .collect();
        let cut = parts_of(&drive);
        // The outer loop, and the inner ones.
        has_on_both_sides(&cut, &(0..2000));
        has_on_both_sides(&cut, &(3000..7000));
        assert!(
            cut.notes
                .last()
                .is_some_and(|note| note.contains("its loops differ")),
            "{:?}",
            cut.notes
        );
        // Nothing is cut so finely that a part rests.
        let resting: Vec<f64> = drive[..5000]
            .iter()
            .copied()
            .chain(vec![drive[4999]; 1500])
            .chain(drive[5000..].iter().copied())
            .collect();
        let cut = parts_of(&resting);
        assert!(
            cut.windows
                .iter()
                .filter(|(role, _)| *role != Role::Noise)
                .all(|(_, w)| peak_to_peak(&resting[w.clone()]) > 0.0),
            "{cut:?}"
        );
        // The same loop over and over is cut once.
        let same: Vec<f64> = (0..8).flat_map(|_| drive[..2000].to_vec()).collect();
        assert_eq!(parts_of(&same).windows.len(), 2);
    }

    /// The drive moves in every part that is fitted or judges, whichever of both timings it has, and some are
    /// of either role.
    fn every_part_moves(drive: &[f64], parts: &Parts) {
        for (_, w) in parts
            .windows
            .iter()
            .filter(|(role, _)| *role != Role::Noise)
        {
            assert!(
                w.len() >= 32 && peak_to_peak(&drive[w.clone()]) > 0.0,
                "{parts:?}"
            );
        }
    }

    fn held(level_v: f64, samples: usize) -> Vec<f64> {
        vec![level_v; samples]
    }

    fn triangles(high_v: f64, half_period: i32, count: usize) -> Vec<f64> {
        let one = (0..2 * half_period)
            .map(|k| high_v * (1.0 - (f64::from(k) / f64::from(half_period) - 1.0).abs()));
        std::iter::repeat_n(one, count).flatten().collect()
    }

    #[test]
    fn holds_between_steps_are_no_rest() {
        let stairs: Vec<f64> = (0..8000).map(|k| f64::from((k / 500) % 8)).collect();
        let parts = parts_of(&stairs);
        // What is before the first step is rest.
        let noise: Vec<&Range<usize>> = parts
            .windows
            .iter()
            .filter(|(role, _)| *role == Role::Noise)
            .map(|(_, w)| w)
            .collect();
        assert_eq!(noise, [&(250..500)], "{parts:?}");
        every_part_moves(&stairs, &parts);
    }

    #[test]
    fn a_rest_before_motion_and_steps_is_not_fitted() {
        for rest in [500, 1500, 2000, 3000] {
            for (ramp, end) in [(0, 500), (250, 1000), (100, 50)] {
                let up: Vec<f64> = (0..ramp)
                    .map(|k| 20.0 * f64::from(k) / f64::from(ramp))
                    .collect();
                let steps = [held(20.0, 2000), held(60.0, 2000), held(32.0, 2000)].concat();
                let drive = [
                    held(0.0, rest),
                    triangles(80.0, 250, 4),
                    up,
                    steps,
                    held(0.0, end),
                ]
                .concat();
                let parts = parts_of(&drive);
                every_part_moves(&drive, &parts);
                assert_eq!(
                    parts.windows[0],
                    (Role::Noise, rest / 2..rest + 1),
                    "{parts:?}"
                );
                assert!(
                    parts.windows[1..].iter().all(|(_, w)| w.start + 1 >= rest),
                    "{parts:?}"
                );
                has_on_both_sides(&parts, &(rest..rest + 2000));
                has_on_both_sides(&parts, &(drive.len() - end - 6000..drive.len()));
                assert!(
                    parts
                        .notes
                        .last()
                        .is_some_and(|note| note.contains("2 kinds of motion")),
                    "{:?}",
                    parts.notes
                );
            }
        }
    }

    #[test]
    fn a_recording_that_hardly_moves_is_cut_where_it_does() {
        let rests_at_both_ends =
            [held(0.0, 5000), triangles(50.0, 250, 2), held(0.0, 4000)].concat();
        let parts = parts_of(&rests_at_both_ends);
        every_part_moves(&rests_at_both_ends, &parts);
        has_on_both_sides(&parts, &(5000..6000));
        let late = [held(0.0, 9500), triangles(50.0, 125, 2)].concat();
        every_part_moves(&late, &parts_of(&late));
        // Steps that cannot be on both sides are fitted, and a note reports it.
        for drive in [
            [held(0.0, 1000), held(50.0, 9000)].concat(),
            [held(0.0, 100), held(50.0, 9000)].concat(),
        ] {
            let parts = parts_of(&drive);
            every_part_moves(&drive, &parts);
            assert!(
                parts
                    .windows
                    .iter()
                    .all(|(role, _)| *role != Role::Validate),
                "{parts:?}"
            );
            assert!(
                parts
                    .notes
                    .last()
                    .is_some_and(|note| note.contains("nothing is held out")),
                "{parts:?}"
            );
        }
        let three = [
            held(0.0, 1000),
            held(20.0, 3000),
            held(60.0, 3000),
            held(0.0, 2000),
        ]
        .concat();
        let parts = parts_of(&three);
        every_part_moves(&three, &parts);
        has_on_both_sides(&parts, &(1000..9000));
    }

    #[test]
    fn a_record_that_rests_for_most_of_its_time_is_judged_where_it_moves() {
        let mut drive = vec![-5.0; 5001];
        drive.extend((0..3000).map(|k| -5.0 + 20.0 * (f64::from(k) * 0.1).sin()));
        let parts = parts_of(&drive);
        assert!(
            parts.windows[1..].iter().all(|(_, w)| w.start >= 5001),
            "{parts:?}"
        );
        has_on_both_sides(&parts, &(5001..8000));
    }

    #[test]
    fn short_and_odd_drives_are_cut_somehow() {
        for drive in [
            vec![1.0; 64],
            vec![0.0; 65],
            (0..70).map(f64::from).collect(),
            (0..300).map(|k| f64::from(k % 2)).collect::<Vec<_>>(),
        ] {
            let parts = parts_of(&drive);
            assert!(
                parts
                    .windows
                    .iter()
                    .all(|(_, w)| w.end <= drive.len() && w.start <= w.end),
                "{parts:?}"
            );
        }
    }
}
