//! Two-sided hysteresis: an actuator that was never driven starts at 0 V, and its first way up and its first
//! way down are both initial curves.
//!
//! Each elementary operator, with an upper threshold above and a lower one below 0 V, has four states:
//! *virgin* until the drive first passes one of its thresholds, then *up* or *down*, and the operators at the
//! ends of the drive's range, which switch once and never back. What is virgin stands between down and up, by
//! `virgin_share` of the way. With the highest drive `M` and the lowest one `m` so far, the virgin operators
//! are those above `M` and below `m`, and what they weigh is a difference of the loop surface, `V(M, m) =
//! G(1, 0) - G(M, 0) - G(1, m) + G(M, m)`. So
//!
//! `f = loops - loops at 0 V + virgin_share (V(M, m) - V at 0 V) + R+(M) - R-(m)`
//!
//! where `R+` and `R-` are what stays of the first way up and of the first way down. The hysteresis stage
//! adds it.

use crate::block::TwoFirstWays;
use crate::hysteresis_surface::{Surfaces, horner, shifted_legendre};
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = id::TWO_SIDED;

/// Terms of what stays, in each direction.
const TERMS: usize = 2;
/// Where virgin operators stand when nothing is known: in the middle, as after demagnetisation.
const MIDDLE: f64 = 0.5;

/// Initial curves in both directions from 0 V.
pub struct TwoSided;

/// The extremes of the drive so far, and what they make.
#[derive(Clone)]
pub(super) struct TwoSidedMemory {
    surfaces: Surfaces,
    virgin_share: f64,
    /// Powers of the share of the way from 0 V to either limit.
    stays_um: [Vec<f64>; 2],
    zero: f64,
    highest: f64,
    lowest: f64,
}

impl TwoSidedMemory {
    /// Of `model`, whose loop surface this is, in units of the drive range above its lower limit.
    pub(super) fn from_model(model: &Model, surfaces: &Surfaces) -> Option<Self> {
        let values = model.values(ID)?;
        let zero = (0.0 - model.drive_min_v) / (model.drive_max_v - model.drive_min_v);
        let stays = |from: usize| {
            let mut powers = vec![0.0; TERMS + 1];
            for k in 0..TERMS {
                for (p, c) in shifted_legendre(k).iter().enumerate() {
                    powers[p + 1] += values.get(from + k).copied().unwrap_or(0.0) * c;
                }
            }
            powers
        };
        let virgin_share = values.first().copied().unwrap_or(MIDDLE);
        Some(Self {
            surfaces: surfaces.clone(),
            virgin_share,
            stays_um: [stays(1), stays(1 + TERMS)],
            zero,
            highest: zero,
            lowest: zero,
        })
    }

    /// What the virgin operators between these extremes weigh, um.
    fn virgin_um(&self, highest: f64, lowest: f64) -> f64 {
        let g = |x: f64, z: f64| self.surfaces.loop_loss(x, z);
        g(1.0, 0.0) - g(highest, 0.0) - g(1.0, lowest) + g(highest, lowest)
    }

    /// The next input; what is added to the loops, um.
    pub(super) fn step(&mut self, x: f64) -> f64 {
        // Beyond the limits nothing is virgin.
        self.highest = self.highest.max(x.min(1.0));
        self.lowest = self.lowest.min(x.max(0.0));
        let virgin_um =
            self.virgin_um(self.highest, self.lowest) - self.virgin_um(self.zero, self.zero);
        let up = (self.highest - self.zero) / (1.0 - self.zero).max(1e-12);
        let down = (self.zero - self.lowest) / self.zero.max(1e-12);
        self.virgin_share * virgin_um + horner(&self.stays_um[0], up)
            - horner(&self.stays_um[1], down)
    }

    /// Beside loops that give `zero_um` at 0 V.
    pub(super) fn as_block(&self, zero_um: f64) -> TwoFirstWays {
        let virgin_um = self.virgin_um(self.zero, self.zero) - self.surfaces.loop_loss(1.0, 0.0);
        TwoFirstWays {
            virgin_share: self.virgin_share,
            zero: self.zero,
            zero_um: zero_um + self.virgin_share * virgin_um,
            stays_um: self.stays_um.clone(),
        }
    }

    /// The highest input so far, or the lowest.
    pub(super) fn extremum(&self, highest: bool) -> f64 {
        if highest { self.highest } else { self.lowest }
    }
}

impl Effect for TwoSided {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Never driven, the ceramic stands between its two polarities: the first way up and the first way down leave 0 V on curves of their own.".into(),
            reference: "thesis Ch. 8, future work 2; Mayergoyz, Mathematical Models of Hysteresis (1991), Ch. 1".into(),
            modifies: Some(id::HYSTERESIS),
            experiment: "triangles to both sides of 0 V of growing height, from the virgin state".into(),
            fitting_rank: 2,
            picture: Picture {
                against: Against::Drive,
                caption: "An error on the first way up and the first way down from 0 V that later loops do not have.",
            },
            equations: r"Beside `hysteresis`, for drives on both sides of 0 V. In units of the drive range, `0` is where 0 V lies, `M` the highest and `m` the lowest input so far, both `0` at first. With `V(M, m) = G(1, 0) - G(M, 0) - G(1, m) + G(M, m)` (here `0` is the lowest input of the range), the output is

loops - loops at 0 V + `virgin_share` (V(M, m) - V at 0 V) + `R+` - `R-`.

`R+ = a sum_k rise_k_um P_k(a)` with the share `a` of the way from 0 V to `drive_max_v` at `M`, `R-` the same from `fall_k_um` with the share of the way to `drive_min_v` at `m`; `P_k` are the polynomials of `hysteresis`.",
            virgin_at_zero: true,
            ..Declaration::on_request(Place::Hysteresis)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = 0.01 * overview.range_um.max(1e-6);
        let stays = |name: &str, k: usize| {
            Parameter::linear(format!("{name}_{k}_um"), "um", -1e6, 1e6, step)
        };
        std::iter::once(Parameter::linear("virgin_share", "1", 0.0, 1.0, 0.02))
            .chain((0..TERMS).map(|k| stays("rise", k)))
            .chain((0..TERMS).map(|k| stays("fall", k)))
            .collect()
    }

    fn starts(&self, _overview: &Overview) -> Vec<Vec<f64>> {
        vec![std::iter::once(MIDDLE).chain([0.0; 2 * TERMS]).collect()]
    }

    fn may_join(&self, model: &Model, overview: &Overview) -> bool {
        let alone = [id::BIPOLAR, id::INITIAL_CURVE]
            .iter()
            .all(|id| model.effect(id).is_none());
        alone
            && model.effect(id::HYSTERESIS).is_some()
            && overview.drive_min_v < 0.0
            && overview.drive_max_v > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::{Drive, EffectInstance, InitialState};
    use crate::effect::{Overview, by_id};
    use proptest::prelude::*;

    const LEVELS: usize = 16;
    const LOOPS: [f64; 6] = [9.0, 1.1, -1.2, 0.2, -0.1, 0.15];
    const STAYS: [f64; 4] = [0.4, -0.1, 0.25, 0.05];

    fn surfaces() -> Surfaces {
        Surfaces::from_legendre(3, &LOOPS, &[])
    }

    fn model(virgin_share: f64) -> Model {
        let overview = Overview {
            range_um: 10.0,
            ..Overview::without_data(-40.0, 40.0)
        };
        let mut model = Model::new(-40.0, 40.0);
        model.add(EffectInstance::new(
            by_id("hysteresis").unwrap().with_parameters(6).unwrap(),
            &overview,
            &LOOPS,
        ));
        let values: Vec<f64> = std::iter::once(virgin_share).chain(STAYS).collect();
        model.add(EffectInstance::new(by_id(ID).unwrap(), &overview, &values));
        model
    }

    #[derive(Clone, Copy, PartialEq)]
    enum State {
        Virgin,
        Up,
        Down,
        /// Switched for good, at an end of the range.
        Stayed,
    }

    /// Oracle: a grid of operators with four states, switched one by one at every level of the drive.
    struct Grid {
        /// Upper and lower threshold as levels from -LEVELS to LEVELS, weight, um, and state.
        loops: Vec<(i32, i32, f64, State)>,
        /// Operators that switch once on the way up (positive level) or down (negative), with what they
        /// leave, um.
        once: Vec<(i32, f64, State)>,
        virgin_share: f64,
    }

    impl Grid {
        fn new(virgin_share: f64) -> Self {
            let n = LEVELS as i32;
            let surfaces = surfaces();
            let at = |level: i32| f64::from(level + n) / f64::from(2 * n);
            let g = |up: i32, down: i32| {
                if up > down {
                    surfaces.loop_loss(at(up), at(down))
                } else {
                    0.0
                }
            };
            let mut loops = Vec::new();
            for up in 1 - n..=n {
                for down in -n..up {
                    // A cell of the triangle: the mixed difference of the surface.
                    let weight = g(up, down) - g(up - 1, down) - g(up, down + 1)
                        + if up - 1 > down + 1 {
                            g(up - 1, down + 1)
                        } else {
                            0.0
                        };
                    let state = match (up > 0, down < 0) {
                        (true, true) => State::Virgin,
                        (true, false) => State::Down,
                        (false, _) => State::Up,
                    };
                    loops.push((up, down, weight, state));
                }
            }
            // Legendre polynomials shifted to 0..1, of order zero and one.
            let stays = |way: f64, c: &[f64]| way * (c[0] + c[1] * (2.0 * way - 1.0));
            let mut once = Vec::new();
            for k in 1..=n {
                let (way, before) = (f64::from(k) / f64::from(n), f64::from(k - 1) / f64::from(n));
                once.push((
                    k,
                    stays(way, &STAYS[..2]) - stays(before, &STAYS[..2]),
                    State::Virgin,
                ));
                once.push((
                    -k,
                    -(stays(way, &STAYS[2..]) - stays(before, &STAYS[2..])),
                    State::Virgin,
                ));
            }
            Self {
                loops,
                once,
                virgin_share,
            }
        }

        fn go_to(&mut self, level: i32) {
            for (up, down, _, state) in &mut self.loops {
                if level >= *up {
                    *state = State::Up;
                } else if level <= *down {
                    *state = State::Down;
                }
            }
            for (threshold, _, state) in &mut self.once {
                if (*threshold > 0 && level >= *threshold)
                    || (*threshold < 0 && level <= *threshold)
                {
                    *state = State::Stayed;
                }
            }
        }

        fn output_um(&self) -> f64 {
            let loops = self.loops.iter().map(|(_, _, weight, state)| match state {
                State::Up => *weight,
                State::Virgin => self.virgin_share * weight,
                _ => 0.0,
            });
            loops.sum::<f64>()
                + self
                    .once
                    .iter()
                    .filter(|(_, _, state)| *state == State::Stayed)
                    .map(|(_, left, _)| left)
                    .sum::<f64>()
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn it_equals_a_grid_of_four_state_operators(
            levels in proptest::collection::vec(-(LEVELS as i32)..=LEVELS as i32, 1..30),
            virgin_share in 0.0f64..1.0,
        ) {
            let mut grid = Grid::new(virgin_share);
            let zero_um = grid.output_um();
            let (mut last, mut expected, mut drive_v) = (0i32, vec![0.0], vec![]);
            for level in levels {
                // A grid of switches needs the path, not only its ends.
                while last != level {
                    last += (level - last).signum();
                    grid.go_to(last);
                }
                expected.push(grid.output_um() - zero_um);
                drive_v.push(f64::from(level) * 40.0 / LEVELS as f64);
            }
            drive_v.push(0.0);
            let drive = Drive::held(&drive_v, 1e-3, InitialState::Virgin);
            for (k, (got, wanted)) in model(virgin_share).simulate(&drive).iter().zip(&expected).enumerate() {
                prop_assert!((got - wanted).abs() < 1e-9, "{k}: {got} {wanted}");
            }
        }
    }

    #[test]
    fn both_first_ways_leave_the_origin() {
        let drive_v = [0.0, 20.0, 0.0, -20.0, 0.0, 0.0];
        let drive = Drive::held(&drive_v, 1e-3, InitialState::Virgin);
        let reading = model(0.5).simulate(&drive);
        assert_eq!(reading[0], 0.0);
        assert!(reading[1].abs() < 1e-12 && reading[2] > 0.5 && reading[4] < 0.0);
        // What the first rise left.
        assert!(reading[3] > 0.05);
    }
}
