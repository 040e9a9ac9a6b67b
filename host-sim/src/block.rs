//! What the stages of a chain compute, as numbers: enough to write a model in another language.
//!
//! A stage says by `Stage::blocks` which blocks it is made of, at the step
//! for which it was built. `block_chain` lines them up, and `block_laws` says what each does.

use crate::hysteresis_surface::{STACK_CAPACITY, Surfaces};
use crate::law::Law;

/// A linear block: `y = out s + before x[k-1] + through x[k]`, then `s = phi s + start x[k-1] + end x[k]`;
/// `x` counts from `offset`, and so does `y`.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    /// Transition of the states, by rows.
    pub phi: Vec<Vec<f64>>,
    /// What the input at the start of an interval adds to the states.
    pub start: Vec<f64>,
    /// What the input at its end adds.
    pub end: Vec<f64>,
    /// Output by the states at the start of an interval.
    pub out: Vec<f64>,
    /// Output by the input at the start.
    pub before: f64,
    /// Output by the input at the end.
    pub through: f64,
    /// States at rest for an input of one.
    pub rest: Vec<f64>,
    /// Where input and output count from.
    pub offset: f64,
}

impl Linear {
    /// A block that reads `reading` of its states at the end of each interval, and `through` of its input
    /// beside.
    #[must_use]
    pub fn reading_states(
        phi: Vec<Vec<f64>>,
        start: Vec<f64>,
        end: Vec<f64>,
        reading: &[f64],
        through: f64,
        rest: Vec<f64>,
    ) -> Self {
        let along =
            |values: &[f64]| -> f64 { reading.iter().zip(values).map(|(c, v)| c * v).sum() };
        let out = (0..reading.len())
            .map(|j| reading.iter().zip(&phi).map(|(c, row)| c * row[j]).sum())
            .collect();
        Self {
            out,
            before: along(&start),
            through: through + along(&end),
            phi,
            start,
            end,
            rest,
            offset: 0.0,
        }
    }

    /// Two blocks with the same input, whose outputs add with these weights, and `through` of the input
    /// beside.
    #[must_use]
    pub fn side_by_side(parts: &[(f64, &Self)], through: f64) -> Self {
        let sizes: Vec<usize> = parts.iter().map(|(_, p)| p.rest.len()).collect();
        let n: usize = sizes.iter().sum();
        let mut phi = vec![vec![0.0; n]; n];
        let mut at = 0;
        for (_, part) in parts {
            for (i, row) in part.phi.iter().enumerate() {
                phi[at + i][at..at + row.len()].copy_from_slice(row);
            }
            at += part.rest.len();
        }
        let all = |of: fn(&Self) -> &Vec<f64>| {
            parts
                .iter()
                .flat_map(|(_, p)| of(p).iter().copied())
                .collect::<Vec<f64>>()
        };
        Self {
            phi,
            start: all(|p| &p.start),
            end: all(|p| &p.end),
            out: parts
                .iter()
                .flat_map(|(weight, p)| p.out.iter().map(move |c| weight * c))
                .collect(),
            before: parts.iter().map(|(weight, p)| weight * p.before).sum(),
            through: through
                + parts
                    .iter()
                    .map(|(weight, p)| weight * p.through)
                    .sum::<f64>(),
            rest: all(|p| &p.rest),
            offset: 0.0,
        }
    }
}

/// How the loops of [`Block::Loops`] depend on the rate of the drive, in units of 10^4 V/s.
#[derive(Clone, Debug, PartialEq)]
pub struct Rate {
    /// Of the loops, linear.
    pub loop_linear: f64,
    /// Of the loops, quadratic.
    pub loop_quadratic: f64,
    /// Of the initial curve, linear.
    pub curve_linear: f64,
    /// Length of an interval, s.
    pub dt_s: f64,
    /// Intervals in a sampling period.
    pub substeps: usize,
    /// Surfaces `G` and `R` beside, which the powers of the rate multiply, from the first on.
    pub orders: Vec<Surfaces>,
    /// The rate at which these powers are one, in the units above.
    pub orders_at: f64,
}

/// How the loops of [`Block::Loops`] begin in the middle, with two first ways.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoFirstWays {
    /// Where virgin operators stand.
    pub virgin_share: f64,
    /// Where 0 V lies in the range.
    pub zero: f64,
    /// What the whole gives there, less what the virgin operators weigh at the ends, um.
    pub zero_um: f64,
    /// What stays of the first way up, and of that down, in powers of their shares, um.
    pub stays_um: [Vec<f64>; 2],
}

/// A play operator in units of the drive range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Play {
    /// Half of the width of its loop.
    pub threshold: f64,
    /// Its weight, um.
    pub weight: f64,
}

/// A play operator without a sharp edge, in units of the drive range.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchingPlay {
    /// Where it stands before the rest in front of a record.
    pub begins: f64,
    /// Width of its edge.
    pub width: f64,
    /// What its position `z` gives, in powers of `2 z - 1`, um.
    pub weights: Vec<f64>,
}

/// A play operator that takes its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CreepingPlay {
    /// Its share in the output.
    pub share: f64,
    /// Half of the width in which it stands still, um.
    pub threshold: f64,
    /// What an interval keeps of its state.
    pub decay: f64,
    /// What the input at the start of an interval adds, and that at its end.
    pub adds: [f64; 2],
}

/// Expressions with states, in lines of [`crate::law`] from the input `now` and its
/// `rate`, the `time`, `force` and states `q0`, `q1`,
/// ...
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// The output `y`.
    pub output: String,
    /// The derivatives `d0`, `d1`, ...
    pub derivatives: String,
    /// Of each state its value at first, and the unit in which rates are compared.
    pub states: Vec<[f64; 2]>,
    /// Length of an interval, s.
    pub dt_s: f64,
    /// In how many parts it is taken.
    pub parts: usize,
}

/// What a stage computes.
#[derive(Clone, Debug, PartialEq)]
pub enum Block {
    /// `y = gain (x - offset)`.
    Proportional {
        /// Gain.
        gain: f64,
        /// Where the input counts from.
        offset: f64,
    },
    /// `y = min(max(x, lower), upper)`.
    Clamp {
        /// Least output.
        lower: f64,
        /// Greatest output.
        upper: f64,
    },
    /// The output moves by at most `most` in an interval; it gives the mean over the interval, or its end.
    Slope {
        /// Largest move.
        most: f64,
        /// Whether it gives means.
        gives_mean: bool,
    },
    /// Linear with states.
    Linear(Linear),
    /// `y = late_share x[k - whole - 1] + (1 - late_share) x[k - whole]`.
    Delay {
        /// Whole intervals.
        whole: usize,
        /// Share of an interval beside.
        late_share: f64,
    },
    /// Preisach surfaces with the initial curve and play operators, of `(x - lower) / span`.
    Loops {
        /// `G` in powers: `g[i][j]` multiplies `x^i z^j`, um.
        g: Vec<Vec<f64>>,
        /// `R` in powers, um.
        r: Vec<f64>,
        /// Play operators beside.
        plays: Vec<Play>,
        /// How it depends on the rate.
        rate: Option<Rate>,
        /// How it begins in the middle.
        first_ways: Option<TwoFirstWays>,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// A sum of play operators of `(x - lower) / span`, then `y = s + sum zone.weight max(s -
    /// zone.threshold, 0)`.
    Plays {
        /// The operators.
        plays: Vec<Play>,
        /// Dead zones of the sum; thresholds in um.
        zones: Vec<Play>,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// Bouc-Wen of `(x - lower) / span`.
    BoucWen {
        /// Gain, um.
        gain: f64,
        /// `alpha`, um.
        alpha: f64,
        /// `beta`.
        beta: f64,
        /// `gamma`.
        gamma: f64,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// Duhem in the form of Coleman and Hodgdon of `(x - lower) / span`.
    Duhem {
        /// Rate of approach.
        approach: f64,
        /// Slope of the line that is approached, um.
        slope: f64,
        /// Elastic slope, um.
        elastic: f64,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// Thermally activated play operators of `X = (x - lower) / span`, beside powers of `2 X - 1`.
    Switching {
        /// The part without memory, in powers of `2 X - 1`, um.
        reversible: Vec<f64>,
        /// The operators.
        plays: Vec<SwitchingPlay>,
        /// Over an interval: share of the distance that is lost where it is small, two less that, and the
        /// distance in widths below which a play stands still.
        interval: [f64; 3],
        /// The same over the rest before a record, less one interval.
        rested: [f64; 3],
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// `X` that takes the loops of `X` to `x - lower`, times `span`.
    LoopsSolved {
        /// As of [`Block::Loops`], V.
        g: Vec<Vec<f64>>,
        /// As there, V.
        r: Vec<f64>,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the displacement, um.
        span: f64,
    },
    /// Play operators of `(x - lower) / span` whose weights are straight lines over the rate.
    RatedPlays {
        /// The operators, with their weights at rest.
        plays: Vec<Play>,
        /// Change of each weight by the rate in units of 10^4 V/s, um.
        by_rate: Vec<f64>,
        /// Time over which a step of the drive is its rate, s.
        period_s: f64,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// With `X = (x - lower) / span`, `X middle(X) - X (1 - X) opening(X)` after a rise, `+` after a fall.
    Branches {
        /// Powers of the middle, um.
        middle: Vec<f64>,
        /// Powers of half the opening, um.
        opening: Vec<f64>,
        /// Lower limit of the drive, V.
        lower: f64,
        /// Range of the drive, V.
        span: f64,
    },
    /// `y = x + sum share z`, each `z` following `x` outside of its threshold.
    CreepingPlays(Vec<CreepingPlay>),
    /// What a user wrote.
    Written(Written),
    /// A mass that works against forces or is held by a bristle, and where such forces rest without one.
    Mass(Law),
    /// `y = x (1 + per_um m)`, where `m` follows `x` by `m = x + decay (m - x)`.
    BiasedGain {
        /// 1/um.
        per_um: f64,
        /// Share of the distance that an interval keeps.
        decay: f64,
    },
    /// A gap: `y` follows `x` within half of it.
    Gap {
        /// Half of the gap, um.
        half: f64,
    },
    /// `y = x + rate (1 - exp(-slowing n)) / slowing` behind `n` intervals.
    Drift {
        /// um in an interval.
        rate: f64,
        /// In an interval.
        slowing: f64,
    },
    /// `y = x + sum cosine cos(angle n) + sine sin(angle n)` behind `n` intervals; at the first sample
    /// `x + sum cosine`.
    Lines(
        /// Angle in an interval, sine and cosine, um.
        Vec<[f64; 3]>,
    ),
    /// `y = x (1 + x (quadratic + x cubic))`.
    Bend {
        /// 1/um.
        quadratic: f64,
        /// 1/um^2.
        cubic: f64,
    },
    /// `y = x + compliance force`.
    Force {
        /// um/N.
        compliance: f64,
    },
}

/// Pairs of extrema that the loops of an export remember.
pub const PAIRS: usize = STACK_CAPACITY;
