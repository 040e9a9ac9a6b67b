//! What the stages of a chain compute, as numbers: enough to write a model in another language.
//!
//! A stage says by [`Stage::blocks`](crate::effect::Stage::blocks) which blocks it is made of, at the step
//! for which it was built. [`BlockChain::of`] lines them up, and refuses an effect that has no blocks.
//! [`BlockChain::simulate`] is the reference for every export: the same readings as
//! [`Model::simulate`](crate::chain::Model::simulate).

use crate::chain::{Drive, InitialState, Model};
use crate::hysteresis_surface::{OneSidedHysteresis, STACK_CAPACITY, Surfaces};

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
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

/// A play operator in units of the drive range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Play {
    /// Half of the width of its loop.
    pub threshold: f64,
    /// Its weight, um.
    pub weight: f64,
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
    /// Maxwell slip of `(x - lower) / span`: `y = gain x - sum weight stretch`, each stretch within its
    /// threshold.
    Slip {
        /// Gain, um.
        gain: f64,
        /// The elements.
        elements: Vec<Play>,
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
    /// The nearest multiple of a step, half a step away from zero.
    Round {
        /// The step, um.
        step: f64,
    },
    /// `y = x + compliance force`.
    Force {
        /// um/N.
        compliance: f64,
    },
}

impl Block {
    /// The name by which exports know it.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Proportional { .. } => "proportional",
            Self::Clamp { .. } => "clamp",
            Self::Slope { .. } => "slope",
            Self::Linear(_) => "linear",
            Self::Delay { .. } => "delay",
            Self::Loops { .. } => "loops",
            Self::Plays { .. } => "plays",
            Self::Slip { .. } => "slip",
            Self::BoucWen { .. } => "bouc_wen",
            Self::Duhem { .. } => "duhem",
            Self::Gap { .. } => "gap",
            Self::Drift { .. } => "drift",
            Self::Lines(_) => "lines",
            Self::Bend { .. } => "bend",
            Self::Round { .. } => "round",
            Self::Force { .. } => "force",
        }
    }
}

/// A block in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The effect whose stage it is part of.
    pub effect: String,
    /// It goes in sub-intervals.
    pub fine: bool,
    /// What it computes.
    pub block: Block,
}

/// A model at one sampling period.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockChain {
    /// Sampling period, s.
    pub dt_s: f64,
    /// Sub-intervals in a period.
    pub substeps: usize,
    /// The drive at which a virgin actuator rests, V.
    pub drive_min_v: f64,
    /// Upper limit of the drive, V.
    pub drive_max_v: f64,
    /// The blocks in the order of the chain.
    pub blocks: Vec<Placed>,
}

impl BlockChain {
    /// The blocks of a model at a sampling period.
    ///
    /// # Errors
    /// The identifier of the first effect that has none.
    pub fn of(model: &Model, dt_s: f64) -> Result<Self, String> {
        let substeps = model.substeps(dt_s);
        let mut blocks = Vec::new();
        let held = Drive::held(&[], dt_s, InitialState::Virgin);
        for (effect, fine) in model.order_with_fineness(&held) {
            let instance = &model.effects[effect];
            let setting = model.setting(&held, if fine { substeps } else { 1 });
            let Some(stage) = instance.stage(model, &setting) else {
                continue;
            };
            let of_stage = stage.blocks().ok_or_else(|| instance.id.clone())?;
            let acts = |block: &Block| !matches!(block, Block::Linear(l) if l.rest.is_empty() && l.before == 0.0 && l.through == 1.0);
            blocks.extend(of_stage.into_iter().filter(acts).map(|block| Placed {
                effect: instance.id.clone(),
                fine,
                block,
            }));
        }
        Ok(Self {
            dt_s,
            substeps,
            drive_min_v: model.drive_min_v,
            drive_max_v: model.drive_max_v,
            blocks,
        })
    }

    /// Whether it takes a measured force.
    #[must_use]
    pub fn takes_force(&self) -> bool {
        self.blocks
            .iter()
            .any(|placed| matches!(placed.block, Block::Force { .. }))
    }

    /// What the sensor reads at every sample, um: the reference that exports are compared with.
    #[must_use]
    pub fn simulate(&self, drive: &Drive, at_rest_v: f64) -> Vec<f64> {
        let (mut signal, mut at_rest, mut fine) = (drive.drive_v.to_vec(), at_rest_v, false);
        for placed in &self.blocks {
            if placed.fine && !fine {
                signal = signal
                    .iter()
                    .flat_map(|value| std::iter::repeat_n(*value, self.substeps))
                    .collect();
            } else if fine && !placed.fine {
                signal = crate::chain::ends(&signal, self.substeps);
            }
            fine = placed.fine;
            let substeps = if fine { self.substeps } else { 1 };
            at_rest = run(&placed.block, at_rest, &mut signal, |interval| {
                drive
                    .force_n
                    .and_then(|f| f.get(interval / substeps))
                    .copied()
                    .unwrap_or(0.0)
            });
        }
        if fine {
            signal = crate::chain::ends(&signal, self.substeps);
        }
        std::iter::once(at_rest)
            .chain(signal)
            .take(drive.drive_v.len())
            .collect()
    }
}

/// Runs a block over a signal in place; gives its output at rest.
fn run(block: &Block, at_rest: f64, signal: &mut [f64], force_n: impl Fn(usize) -> f64) -> f64 {
    match block {
        Block::Proportional { gain, offset } => each(at_rest, signal, |x| gain * (x - offset)),
        Block::Clamp { lower, upper } => each(at_rest, signal, |x| x.min(*upper).max(*lower)),
        Block::Bend { quadratic, cubic } => {
            each(at_rest, signal, |x| x * (1.0 + x * (quadratic + x * cubic)))
        }
        Block::Round { step } => each(at_rest, signal, |x| {
            if *step > 0.0 {
                (x / step).round() * step
            } else {
                x
            }
        }),
        Block::Slope { most, gives_mean } => {
            let mut stands = at_rest;
            signal.iter_mut().for_each(|x| {
                let start = stands;
                let away = *x - start;
                let arrives = away.abs() <= *most;
                stands = if arrives {
                    *x
                } else {
                    start + most.copysign(away)
                };
                *x = match (gives_mean, arrives) {
                    (false, _) => stands,
                    (true, true) => {
                        *x - away * 0.5 * if *most > 0.0 { away.abs() / most } else { 1.0 }
                    }
                    (true, false) => 0.5 * (start + stands),
                };
            });
            at_rest
        }
        Block::Linear(linear) => {
            let rest = at_rest - linear.offset;
            let mut states: Vec<f64> = linear.rest.iter().map(|unit| unit * rest).collect();
            let reads = |states: &[f64], before: f64, x: f64| {
                linear
                    .out
                    .iter()
                    .zip(states)
                    .map(|(c, s)| c * s)
                    .sum::<f64>()
                    + linear.before * before
                    + linear.through * x
            };
            let out = reads(&states, rest, rest) + linear.offset;
            let mut before = rest;
            for value in signal {
                let x = *value - linear.offset;
                *value = reads(&states, before, x) + linear.offset;
                states = (linear.phi.iter().zip(linear.start.iter().zip(&linear.end)))
                    .map(|(row, (start, end))| {
                        row.iter().zip(&states).map(|(p, s)| p * s).sum::<f64>()
                            + start * before
                            + end * x
                    })
                    .collect();
                before = x;
            }
            out
        }
        Block::Delay { whole, late_share } => {
            let inputs = signal.to_vec();
            let ago = |k: usize, by: usize| if k >= by { inputs[k - by] } else { at_rest };
            signal.iter_mut().enumerate().for_each(|(k, x)| {
                *x = late_share * ago(k, whole + 1) + (1.0 - late_share) * ago(k, *whole)
            });
            at_rest
        }
        Block::Loops {
            g,
            r,
            plays,
            rate,
            lower,
            span,
        } => {
            let surfaces = Surfaces {
                g: g.clone(),
                r: r.clone(),
            };
            let mut operator = OneSidedHysteresis::virgin(surfaces, *lower, *span);
            let mut stands = vec![0.0; plays.len()];
            let mut follow = |v: f64| {
                let x = (v - lower) / span;
                let sum = sum_of_plays(plays, &mut stands, x);
                let y = operator.step(v) + sum;
                let top = operator.stack().global_maximum();
                let curve = operator.initial_curve_at_maximum()
                    + plays
                        .iter()
                        .map(|p| p.weight * (top - p.threshold).max(0.0))
                        .sum::<f64>();
                (y, curve)
            };
            let mut y = follow(at_rest).0;
            let out = y;
            let (mut last, mut unchanged) = (at_rest, rate.map_or(1, |rate| rate.substeps));
            for value in signal {
                let moves = *value != last;
                match rate {
                    None if moves => y = follow(*value).0,
                    None => {}
                    Some(rate) => {
                        unchanged += usize::from(!moves);
                        if moves || unchanged >= rate.substeps {
                            let intervals = if unchanged + 1 >= rate.substeps {
                                rate.substeps
                            } else {
                                1
                            };
                            if moves {
                                unchanged = 0;
                            }
                            let v = (*value - last).abs() / (rate.dt_s * intervals as f64) / 1e4;
                            let (still, curve) = follow(*value);
                            y = curve * (1.0 + rate.curve_linear * v)
                                - (curve - still)
                                    * (1.0 + v * (rate.loop_linear + v * rate.loop_quadratic));
                        }
                    }
                }
                last = *value;
                *value = y;
            }
            out
        }
        Block::Plays {
            plays,
            zones,
            lower,
            span,
        } => {
            let mut stands = vec![0.0; plays.len()];
            each(at_rest, signal, |v| {
                let sum = sum_of_plays(plays, &mut stands, (v - lower) / span);
                sum + zones
                    .iter()
                    .map(|zone| zone.weight * (sum - zone.threshold).max(0.0))
                    .sum::<f64>()
            })
        }
        Block::Slip {
            gain,
            elements,
            lower,
            span,
        } => {
            let (mut stretch, mut last) = (vec![0.0; elements.len()], 0.0);
            each(at_rest, signal, |v| {
                let x = (v - lower) / span;
                let mut held = 0.0;
                for (stretch, element) in stretch.iter_mut().zip(elements) {
                    *stretch = (*stretch + x - last).clamp(-element.threshold, element.threshold);
                    held += element.weight * *stretch;
                }
                last = x;
                gain * x - held
            })
        }
        Block::BoucWen {
            gain,
            alpha,
            beta,
            gamma,
            lower,
            span,
        } => {
            let (mut state, mut last) = (0.0_f64, 0.0);
            each(at_rest, signal, |v| {
                let x = (v - lower) / span;
                let change: f64 = x - last;
                let pieces = (change.abs() * 200.0).ceil().clamp(1.0, 400.0);
                let piece = change / pieces;
                for _ in 0..pieces as usize {
                    let rate = beta * piece.abs() + gamma * piece * state.signum();
                    let middle = state + 0.5 * (alpha * piece - rate * state);
                    let rate = beta * piece.abs() + gamma * piece * middle.signum();
                    state += alpha * piece - rate * middle;
                }
                last = x;
                gain * x - state
            })
        }
        Block::Duhem {
            approach,
            slope,
            elastic,
            lower,
            span,
        } => {
            let (mut y, mut last) = (0.0, 0.0);
            each(at_rest, signal, |v| {
                let x = (v - lower) / span;
                let change: f64 = x - last;
                if change != 0.0 && *approach > 1e-9 {
                    let forcing = (elastic - slope) * change.signum() / approach;
                    y = slope * x
                        + forcing
                        + (y - slope * last - forcing) * (-approach * change.abs()).exp();
                } else {
                    y += elastic * change;
                }
                last = x;
                y
            })
        }
        Block::Gap { half } => {
            let mut stands = at_rest;
            signal.iter_mut().for_each(|x| {
                stands = stands.max(*x - half).min(*x + half);
                *x = stands;
            });
            at_rest
        }
        Block::Drift { rate, slowing } => {
            for (k, x) in signal.iter_mut().enumerate() {
                let intervals = k as f64 + 1.0;
                let slowed = slowing * intervals;
                *x += rate
                    * if slowed.abs() < 1e-9 {
                        intervals
                    } else {
                        -(-slowed).exp_m1() / slowing
                    };
            }
            at_rest
        }
        Block::Lines(lines) => {
            for (k, x) in signal.iter_mut().enumerate() {
                let n = k as f64 + 1.0;
                *x += lines
                    .iter()
                    .map(|[angle, sine, cosine]| {
                        cosine * (angle * n).cos() + sine * (angle * n).sin()
                    })
                    .sum::<f64>();
            }
            at_rest + lines.iter().map(|[_, _, cosine]| cosine).sum::<f64>()
        }
        Block::Force { compliance } => {
            signal
                .iter_mut()
                .enumerate()
                .for_each(|(k, x)| *x += compliance * force_n(k));
            at_rest + compliance * force_n(0)
        }
    }
}

fn each(at_rest: f64, signal: &mut [f64], mut of: impl FnMut(f64) -> f64) -> f64 {
    let out = of(at_rest);
    signal.iter_mut().for_each(|x| *x = of(*x));
    out
}

fn sum_of_plays(plays: &[Play], stands: &mut [f64], x: f64) -> f64 {
    let mut sum = 0.0;
    for (play, stands) in plays.iter().zip(stands) {
        *stands = stands.max(x - play.threshold).min(x + play.threshold);
        sum += play.weight * *stands;
    }
    sum
}

/// Pairs of extrema that the loops of an export remember.
pub const PAIRS: usize = STACK_CAPACITY;
