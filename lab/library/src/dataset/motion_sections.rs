//! Sections of one recording in which the drive moves alike: at like speeds, over like widths, or in steps
//! that are held.
//!
//! A hold amid motion shows little of it and is not counted, so that a cut never leaves one alone. Holds that
//! follow each other are another kind of motion, which is cut between its steps. A section whose loops are
//! not those of its other half is cut further: loops that are never fitted cannot be met where they are held
//! out.

use super::circumstances::turns;
use crate::statistics::peak_to_peak;
use std::ops::Range;

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

/// A section by the samples before which it may be cut, in order; the first is where it begins. It goes on to
/// where the next one begins.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Section {
    /// Samples before which it may be cut: where it moves, or one for each step.
    pub(super) cuts: Vec<usize>,
    /// Of which a part has so many at least.
    part_min: usize,
}

impl Section {
    /// First sample.
    pub(super) fn start(&self) -> usize {
        self.cuts[0]
    }

    /// Where its second half begins.
    pub(super) fn middle(&self) -> usize {
        self.cuts[self.cuts.len() / 2]
    }
}

/// Holds that follow each other, with nothing but steps or short ways between them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Steps {
    holds: Vec<Range<usize>>,
}

impl Steps {
    /// Whether a hold is one of these.
    pub(super) fn contains(&self, hold: &Range<usize>) -> bool {
        self.holds.contains(hold)
    }

    fn span(&self) -> Range<usize> {
        self.holds[0].start..self.holds[self.holds.len() - 1].end
    }
}

/// Runs of two or more holds with but steps between them.
pub(super) fn runs_of_steps(drive_v: &[f64], holds: &[Range<usize>]) -> Vec<Steps> {
    let mut runs: Vec<Steps> = Vec::new();
    for hold in holds {
        let follows = |run: &&mut Steps| {
            let before = &run.holds[run.holds.len() - 1];
            is_step(
                drive_v,
                before.end..hold.start,
                before.len().min(hold.len()),
            )
        };
        match runs.last_mut().filter(follows) {
            Some(run) => run.holds.push(hold.clone()),
            None => runs.push(Steps {
                holds: vec![hold.clone()],
            }),
        }
    }
    runs.retain(|run| run.holds.len() > 1);
    runs
}

/// Whether the drive goes but from one level to the next, in less time than it stays there.
fn is_step(drive_v: &[f64], way: Range<usize>, stays: usize) -> bool {
    way.len() < 2 * PART_MIN || way.len() <= stays && wide_turns(&drive_v[way]).len() < 2
}

/// Sections of the motion, of which `holds` are known, and how many kinds of it there are. None where it
/// rests throughout.
pub(super) fn sections(
    drive_v: &[f64],
    motion: Range<usize>,
    holds: &[Range<usize>],
) -> (usize, Vec<Section>) {
    let holds: Vec<Range<usize>> = holds
        .iter()
        .map(|h| h.start.max(motion.start)..h.end.min(motion.end))
        .filter(|h| !h.is_empty())
        .collect();
    let mut runs = runs_of_steps(drive_v, &holds);
    let moving = |within: Range<usize>| -> Vec<usize> {
        let mut at = within.start;
        let mut samples = Vec::new();
        for hold in holds
            .iter()
            .filter(|hold| hold.start < within.end && hold.end > within.start)
        {
            samples.extend(at..hold.start.max(at));
            at = at.max(hold.end);
        }
        samples.extend(at..within.end.max(at));
        samples
    };
    // One step to where the drive stays is all that it does.
    if runs.is_empty() && moving(motion.clone()).is_empty() {
        runs.extend((!holds.is_empty()).then(|| Steps {
            holds: holds.clone(),
        }));
    }
    // Too many turns from one to the other: what moves tells where to cut, as well as can be.
    if 2 * runs.len() > SECTIONS_MAX {
        runs.clear();
    }
    let is_way = |way: &Range<usize>, stays: usize| is_step(drive_v, way.clone(), stays);
    let begins = runs.iter().map(|run| run.span().end);
    let before: Vec<Range<usize>> = std::iter::once(motion.start)
        .chain(begins)
        .zip(&runs)
        .map(|(at, run)| at..run.span().start)
        .collect();
    let behind = runs.last().map_or(motion.start, |run| run.span().end)..motion.end;
    let behind_moves = runs.is_empty() || !is_way(&behind, behind.len());
    let others = before
        .iter()
        .zip(&runs)
        .filter(|(way, run)| !is_way(way, run.holds[0].len()))
        .count()
        + usize::from(behind_moves);
    let most = ((SECTIONS_MAX - runs.len()) / others.max(1)).max(1);
    let mut found: Vec<Section> = Vec::new();
    for (way, run) in before.iter().zip(&runs) {
        let is_way = is_way(way, run.holds[0].len());
        if !is_way {
            found.extend(alike(drive_v, moving(way.clone()), most));
        }
        // From the last sample before each step on, so that the step is inside.
        let steps = run.holds.iter().enumerate().map(|(i, hold)| match i {
            0 if is_way && !way.is_empty() => way.start,
            0 => hold.start.saturating_sub(1),
            _ => run.holds[i - 1].end - 1,
        });
        found.push(Section {
            cuts: steps.collect(),
            part_min: 1,
        });
    }
    if behind_moves {
        found.extend(alike(drive_v, moving(behind), most));
    }
    let kinds = found.len();
    (
        kinds,
        with_the_loops_of_both_halves(drive_v, found, motion.end),
    )
}

/// Sections of the samples at which a drive moves, in which it does so at like speeds and over like widths.
fn alike(drive_v: &[f64], moving: Vec<usize>, most: usize) -> Vec<Section> {
    let inside: Vec<f64> = moving.iter().map(|k| drive_v[*k]).collect();
    if inside.is_empty() {
        return Vec::new();
    }
    let frame = (inside.len() / FRAMES)
        .max(2 * time_between_turns(&inside))
        .max(PART_MIN / 2);
    let frames: Vec<&[f64]> = inside.chunks_exact(frame.min(inside.len())).collect();
    let speed = |f: &[f64]| f.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / f.len() as f64;
    let floor = 1e-3 * peak_to_peak(&inside);
    let features: Vec<[f64; 2]> = frames
        .iter()
        .map(|f| {
            [
                (speed(f) + floor / f.len() as f64).ln(),
                (peak_to_peak(f) + floor).ln(),
            ]
        })
        .collect();
    let mut bounds = vec![0];
    let mut reference = features.first().copied().unwrap_or_default();
    for (i, feature) in features.iter().enumerate().skip(1) {
        let next = features.get(i + 1).unwrap_or(feature);
        let is_other = |f: &[f64; 2]| {
            f.iter()
                .zip(&reference)
                .any(|(a, b)| (a - b).abs() > ANOTHER_KIND.ln())
        };
        if is_other(feature) && is_other(next) {
            bounds.push(i);
            reference = *feature;
        }
    }
    // Sections too short to be worth two parts join the one before.
    let shortest = (2 * PART_MIN.div_ceil(frame).max(1)).max(features.len() / SECTION_MIN);
    bounds.dedup_by(|later, earlier| *later - *earlier < shortest);
    if bounds.len() > most
        || bounds
            .last()
            .is_some_and(|last| features.len() - last < shortest)
            && bounds.len() > 1
    {
        bounds.pop();
    }
    if bounds.len() > most {
        // Many kinds: even sections have all of them on both sides as well as can be.
        bounds = (0..most).map(|i| i * features.len() / most).collect();
    }
    let ends = bounds[1..]
        .iter()
        .map(|frame_index| frame_index * frame)
        .chain([moving.len()]);
    let mut start = 0;
    ends.map(|end| {
        let section = Section {
            cuts: moving[start..end].to_vec(),
            part_min: PART_MIN,
        };
        start = end;
        section
    })
    .collect()
}

/// Cuts the longest section whose halves turn at different voltages into as many even pieces as there may be
/// more of.
fn with_the_loops_of_both_halves(
    drive_v: &[f64],
    sections: Vec<Section>,
    end: usize,
) -> Vec<Section> {
    let ends: Vec<usize> = sections
        .iter()
        .skip(1)
        .map(Section::start)
        .chain([end])
        .collect();
    let length = |i: &usize| ends[*i] - sections[*i].start();
    let uneven = |i: &usize| has_other_loops_in_its_halves(drive_v, &sections[*i], ends[*i]);
    let Some(longest) = (0..sections.len()).filter(uneven).max_by_key(length) else {
        return sections;
    };
    let (cuts, part_min) = (&sections[longest].cuts, sections[longest].part_min);
    let most = (SECTIONS_MAX + 1)
        .saturating_sub(sections.len())
        .min(cuts.len() / (2 * part_min))
        .max(1);
    let at = |of: usize, pieces: usize| {
        cuts.get(of * cuts.len() / pieces)
            .copied()
            .unwrap_or(ends[longest])
    };
    // Half a piece is a part of its own, and has to move.
    let each_moves = |pieces: &usize| {
        (0..2 * pieces).all(|half| moves(&drive_v[at(half, 2 * pieces)..at(half + 1, 2 * pieces)]))
    };
    let pieces = (1..=most).rev().find(each_moves).unwrap_or(1);
    let piece = |i: usize| Section {
        cuts: cuts[i * cuts.len() / pieces..(i + 1) * cuts.len() / pieces].to_vec(),
        part_min,
    };
    let cut: Vec<Section> = (0..pieces).map(piece).collect();
    [&sections[..longest], &cut, &sections[longest + 1..]].concat()
}

/// Whether either half of a section turns at voltages at which the other does not, though it turns.
fn has_other_loops_in_its_halves(drive_v: &[f64], section: &Section, end: usize) -> bool {
    let inside = &drive_v[section.start()..end];
    let same = SAME_TURN * peak_to_peak(inside);
    let middle = section.middle() - section.start();
    let (early, late): (Vec<_>, Vec<_>) = wide_turns(inside)
        .into_iter()
        .partition(|(k, _)| *k < middle);
    let lacks = |of: &[(usize, f64)], one: &[(usize, f64)]| {
        one.iter()
            .any(|(_, v)| of.iter().all(|(_, other)| (v - other).abs() > same))
    };
    (early.len() + late.len() > 1) && (lacks(&early, &late) || lacks(&late, &early))
}

/// Whether a signal is not the same throughout.
pub(super) fn moves(signal: &[f64]) -> bool {
    peak_to_peak(signal) > 0.0
}

/// Samples and voltages at which the drive turns and goes back by a tenth of its range at least.
fn wide_turns(drive_v: &[f64]) -> Vec<(usize, f64)> {
    turns(drive_v, 0.1 * peak_to_peak(drive_v))
}

/// Samples between turns of the drive, on average.
fn time_between_turns(drive_v: &[f64]) -> usize {
    drive_v.len() / (wide_turns(drive_v).len() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(level_v: f64, samples: usize) -> Vec<f64> {
        vec![level_v; samples]
    }

    #[test]
    fn holds_with_steps_between_them_are_a_run_and_one_amid_motion_is_none() {
        let sine = |samples: usize| {
            (0..samples)
                .map(|k| 20.0 + 20.0 * (k as f64 * 0.05).sin())
                .collect::<Vec<_>>()
        };
        let ramp: Vec<f64> = (0..300).map(|k| 20.0 + 0.1 * f64::from(k)).collect();
        let drive = [
            sine(2000),
            held(20.0, 500),
            sine(2000),
            held(20.0, 500),
            held(40.0, 400),
            held(20.0, 400),
            ramp,
            held(50.0, 400),
        ]
        .concat();
        let holds = [2000..2500, 4500..5000, 5000..5400, 5400..5800, 6100..6500];
        assert_eq!(
            runs_of_steps(&drive, &holds),
            [Steps {
                holds: holds[1..].to_vec()
            }]
        );
        let (kinds, sections) = sections(&drive, 0..drive.len(), &holds);
        assert_eq!(kinds, 2, "{sections:?}");
        assert_eq!(
            sections[0].middle(),
            2500,
            "the hold amid the sines goes with what is before it"
        );
        let steps: Vec<usize> = sections[1..]
            .iter()
            .flat_map(|section| section.cuts.clone())
            .collect();
        assert_eq!(steps, [4499, 4999, 5399, 5799]);
    }

    #[test]
    fn without_holds_every_sample_may_be_cut_at() {
        let sine: Vec<f64> = (0..4000).map(|k| (f64::from(k) * 0.01).sin()).collect();
        let (kinds, sections) = sections(&sine, 100..4000, &[]);
        assert_eq!((kinds, sections.len(), sections[0].middle()), (1, 1, 2050));
    }
}
