//! The loop of a model over the whole range of its drive, in figures.

use hysteron_sim::chain::{Drive, InitialState, Model};
use hysteron_sim::effect::Place;
use serde::Serialize;

/// Gain and width of the loop over the whole range of the drive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HysteresisFigures {
    /// Height over range, um/V.
    pub gain_um_v: f64,
    /// Least slope on either branch, um/V.
    pub least_slope_um_v: f64,
    /// Largest slope, um/V.
    pub largest_slope_um_v: f64,
    /// Distance of the branches where they are farthest, in % of the height.
    pub width_pct: f64,
}

/// Samples on each branch.
const BRANCH: usize = 200;
/// So slow that nothing depends on the rate.
const DT_S: f64 = 1.0;

/// The loop of a model over the range of its drive; none without a gain or a hysteresis.
#[must_use]
pub fn loop_figures(model: &Model) -> Option<HysteresisFigures> {
    let mut loops = model.clone();
    loops.effects.retain(|e| {
        e.effect.declaration().place == Place::Hysteresis
            && e.effect.declaration().definition.is_none()
    });
    loops
        .effects
        .iter()
        .find(|e| e.effect.declaration().is_main())?;
    let (from, to) = (model.drive_min_v, model.drive_max_v);
    let at = |k: usize| from + (to - from) * k as f64 / BRANCH as f64;
    let rise = (0..=BRANCH).map(at);
    let fall = (0..BRANCH).rev().map(at);
    let drive_v: Vec<f64> = rise
        .clone()
        .chain(fall)
        .chain(rise.skip(1))
        .chain([to])
        .collect();
    let drive = Drive::held(&drive_v, DT_S, InitialState::Virgin);
    // A reading answers to the drive of the sample before.
    let read = loops.simulate(&drive).split_off(1);
    let falling: Vec<f64> = read[BRANCH..=2 * BRANCH].iter().rev().copied().collect();
    let rising = &read[2 * BRANCH..=3 * BRANCH];
    let height = rising[BRANCH] - rising[0];
    let slopes = [&falling[..], rising]
        .into_iter()
        .flat_map(|branch| branch.windows(2))
        .map(|w| (w[1] - w[0]) * BRANCH as f64 / (to - from));
    let (least, largest) = slopes.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), slope| {
        (a.min(slope), b.max(slope))
    });
    let width = falling
        .iter()
        .zip(rising)
        .map(|(down, up)| (down - up).abs())
        .fold(0.0, f64::max);
    Some(HysteresisFigures {
        gain_um_v: height / (to - from),
        least_slope_um_v: least,
        largest_slope_um_v: largest,
        width_pct: if height == 0.0 {
            0.0
        } else {
            100.0 * width / height.abs()
        },
    })
}
