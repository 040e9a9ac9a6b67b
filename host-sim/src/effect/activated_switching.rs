//! Thermally activated switching: loops, their dependence on the rate and creep, from one density.
//!
//! A domain wall whose barrier is `r` moves as soon as heat lifts it over what the drive leaves of the
//! barrier. The play operator of that threshold then has no sharp edge: its position `z` follows the drive
//! `x` with `z' = (2 k r / t_0) exp(-1/k) sinh((x - z) / (k r))`. The threshold at which it moves falls with
//! the logarithm of the time that the drive leaves it, by the share `k`, so that loops widen with the rate
//! and go on after the drive has stopped. What the positions of all thresholds give is a density over
//! threshold and position, the Preisach model of play operators. One number, `k`, stands beside it.

use crate::block::{Block, SwitchingPlay};
use crate::physics::*;

/// Identifier in files and on the command line.
pub const ID: &str = "activated_switching";

/// Play operators that stand for the density: without sharp edges twice as many lower the fitted error of a real
/// stage by 2 %.
const PLAYS: usize = 16;
/// Largest threshold, in units of the drive range: those above half of it never close a loop, and those that
/// the time of a drive lowers lie a tenth above what they act as.
const LARGEST: f64 = 0.55;
/// Functions of the threshold and of the position in which the density is written.
const SIZES: usize = 5;
const LEVELS: usize = 5;
/// Powers of the part that has no memory: as many as those of the positions, which it holds for plays that
/// follow the drive.
const REVERSIBLE: usize = LEVELS;
/// Parameters in front of the coefficients.
const SHAPE: usize = 2;
/// Share of the range of the readings within which a coefficient of order one is expected where the data leave
/// it open; one of order `n`, within a share of that by the square of `n`: a smooth density. With 32
/// plays loops of 5 Hz predict 20 and 40 Hz to 463 and 394 nm without this, to 114 and 94 nm with it.
const EXPECTED_SHARE: f64 = 0.3;
/// Share of the range of the readings by which a coefficient is varied.
const STEP_SHARE: f64 = 0.01;
/// A stage has forgotten nothing of a sweep to its lower limit, or all of it, as a virgin one. Records that begin
/// far from that limit do not show it: left open
/// there, 5 Hz predicts 20 Hz to 319 instead of 155 nm (32 plays).
const EXPECTED_FORGOTTEN: f64 = 0.3;
const FORGOTTEN_STEP: f64 = 0.02;
/// Time between two attempts over a barrier, s. Another one scales all thresholds.
const ATTEMPT_S: f64 = 1e-4;
/// How long a stage at rest has rested, s: another decade moves the positions by a share `k` of 2.3.
const RESTED_S: f64 = 10.0;
/// A play stands still if it would move by less than this share of `k r` in an interval.
const STILL: f64 = 1e-12;

/// Plays without sharp edges, and a density over threshold and position.
pub struct ActivatedSwitching;

/// How far plays go in an interval.
#[derive(Clone, Copy)]
struct Interval {
    /// `1 - exp(-d)` and `1 + exp(-d)`, where `d` is the length in units of the time constant at rest.
    lost: f64,
    kept: f64,
    /// Distance from the input, in units of `k r`, below which a play stands still.
    still: f64,
}

impl Interval {
    fn new(activation: f64, length_s: f64) -> Self {
        let d = 2.0 * length_s / ATTEMPT_S * (-1.0 / activation).exp();
        let lost = -(-d).exp_m1();
        Self {
            lost,
            kept: 2.0 - lost,
            still: (STILL / lost.max(f64::MIN_POSITIVE)).ln(),
        }
    }

    /// What is lost, what is kept and where a play stands still.
    fn shares(&self) -> [f64; 3] {
        [self.lost, self.kept, self.still]
    }

    /// The distance from a constant input that is left of so much, both in units of `k r`: with `q` the
    /// exponential of the distance before, the solution of the equation is a ratio. And how much of a little
    /// more is left.
    fn left(&self, distance: f64) -> [f64; 2] {
        let q = (-distance).exp();
        let (above, below) = (self.kept + q * self.lost, self.lost + q * self.kept);
        let slope = q * (self.kept / below - self.lost / above);
        [(above / below).ln(), slope]
    }

    /// Where a play of the width `k r` goes that stands at `z`.
    fn follow(&self, z: f64, x: f64, width: f64) -> f64 {
        let distance = (x - z).abs() / width;
        if distance < self.still {
            return z;
        }
        let [left, _] = self.left(distance);
        // Rounding takes what is hardly lost past the input.
        x - (left.max(0.0) * width).copysign(x - z)
    }
}

/// How far plays go in an interval, by their distance from the input: one curve in units of their width.
#[derive(Clone)]
struct Curve {
    /// It begins here, at what stands still.
    from: f64,
    /// Cubic polynomials around equidistant distances, in which it is continuous with its slope; where the last
    /// one would be, all but so much is gone.
    pieces: Vec<[f64; 4]>,
    /// From farther away all but so much is gone.
    left: f64,
}

impl Curve {
    /// Pieces a width: the curve is known to `1e-9` of a width, in a fourth of the time that its exponential
    /// and logarithm take.
    const PIECES: f64 = 32.0;
    /// Added to a number, it leaves the nearest whole one in the last bits.
    const WHOLE: f64 = 6_755_399_441_055_744.0;

    fn new(interval: &Interval) -> Self {
        let from = interval.still.max(0.0);
        let left = (interval.kept / interval.lost.max(f64::MIN_POSITIVE)).ln();
        let gone = |at: f64| {
            let distance = from + at / Self::PIECES;
            let [left, slope] = interval.left(distance);
            [distance - left, (1.0 - slope) / Self::PIECES]
        };
        let piece = |i: usize| {
            let ([a, slope_a], [b, slope_b]) = (gone(i as f64 - 0.5), gone(i as f64 + 0.5));
            [
                0.5 * (a + b) + 0.125 * (slope_a - slope_b),
                1.5 * (b - a) - 0.25 * (slope_a + slope_b),
                0.5 * (slope_b - slope_a),
                slope_a + slope_b - 2.0 * (b - a),
            ]
        };
        // As far beyond the bend as `STILL` lies before it.
        let pieces = (left - STILL.ln() - from) * Self::PIECES;
        Self {
            from,
            pieces: (0..=pieces as usize).map(piece).collect(),
            left,
        }
    }

    /// Lets plays of these widths, with one over each, follow an input.
    fn follow<const N: usize>(&self, positions: &mut [f64; N], x: f64, widths: &[[f64; N]; 2]) {
        // One operation for all plays after the other: a processor does two or more at once.
        let [width, per_width] = widths;
        let distance: [f64; N] = std::array::from_fn(|j| ((x - positions[j]) * per_width[j]).abs());
        let at = distance.map(|distance| (distance - self.from) * Self::PIECES);
        // No jump on the way, so that plays are followed side by side.
        let farthest = (self.pieces.len() - 1) as f64;
        let whole = at.map(|at| at.clamp(0.0, farthest) + Self::WHOLE);
        let pieces = whole.map(|whole| self.pieces[whole.to_bits() as u32 as usize]);
        for j in 0..N {
            let [a, b, c, d] = pieces[j];
            let nearest = whole[j] - Self::WHOLE;
            let u = at[j] - nearest;
            let near = a + u * (b + u * (c + u * d));
            let gone = if nearest < farthest {
                near
            } else {
                distance[j] - self.left
            };
            let gone = if at[j] < 0.0 { 0.0 } else { gone };
            positions[j] += (gone * width[j]).copysign(x - positions[j]);
        }
    }
}

/// A value of each play operator.
type OfPlays = [f64; PLAYS];

/// The play operators of a model, in units of the drive range above its lower limit.
#[derive(Clone)]
struct Plays {
    /// Widths of the edges, and one over each.
    widths: [OfPlays; 2],
    positions: OfPlays,
    /// Positions before the rest.
    begins: OfPlays,
    /// Weights of the functions of the threshold.
    sizes: [OfPlays; SIZES],
    curve: Curve,
    interval: Interval,
    rested: Interval,
    /// An export begins with one interval less of rest, and steps once.
    rested_before_a_step: Interval,
    activation: f64,
    forgotten: f64,
    range: DriveRange,
}

impl Plays {
    /// At rest at the lower limit, where the displacement counts from.
    fn new(model: &Model, activation: f64, forgotten: f64, dt_s: f64) -> Self {
        // Closer together where they are small: small loops consist of them.
        let threshold = |at: f64| LARGEST * (at / PLAYS as f64).powf(1.5);
        let thresholds: OfPlays = std::array::from_fn(|j| threshold(j as f64 + 0.5));
        let root = |at: f64| (threshold(at) / LARGEST).sqrt();
        let share = |j: usize| root(j as f64 + 1.0) - root(j as f64);
        let by_size =
            thresholds.map(|middle: f64| legendre::<SIZES>(2.0 * (middle / LARGEST).sqrt() - 1.0));
        let width = |middle: f64| activation * middle;
        let [interval, rested] =
            [dt_s, RESTED_S].map(|length_s| Interval::new(activation, length_s));
        // Whoever comes from farther away than a rest leaves stands there as well.
        let begins =
            |threshold: f64| (1.0 - forgotten) * rested.follow(threshold, 0.0, width(threshold));
        let mut out = Self {
            widths: [
                thresholds.map(width),
                thresholds.map(|middle| 1.0 / width(middle)),
            ],
            positions: [0.0; PLAYS],
            begins: thresholds.map(begins),
            sizes: std::array::from_fn(|size| std::array::from_fn(|j| by_size[j][size] * share(j))),
            curve: Curve::new(&interval),
            interval,
            rested,
            rested_before_a_step: Interval::new(activation, RESTED_S - dt_s),
            activation,
            forgotten,
            range: model.drive_range(),
        };
        out.settle(out.range.lower_v);
        out
    }

    fn step(&mut self, drive_v: f64) {
        let x = self.range.share(drive_v);
        self.curve.follow(&mut self.positions, x, &self.widths);
    }

    /// At rest at a drive that was reached from the lower limit.
    fn settle(&mut self, drive_v: f64) {
        let x = self.range.share(drive_v);
        let plays = self.positions.iter_mut().zip(&self.widths[0]);
        for ((position, width), begins) in plays.zip(&self.begins) {
            *position = self.rested.follow(*begins, x, *width);
        }
    }
}

/// The first Legendre polynomials.
fn legendre<const N: usize>(x: f64) -> [f64; N] {
    let mut out = [1.0; N];
    if N > 1 {
        out[1] = x;
    }
    for n in 1..N.saturating_sub(1) {
        let degree = n as f64;
        out[n + 1] = ((2.0 * degree + 1.0) * x * out[n] - degree * out[n - 1]) / (degree + 1.0);
    }
    out
}

/// Polynomials of a position or of the drive: the constant one moves nothing.
fn by_level(position: f64) -> [f64; LEVELS] {
    let all = legendre::<{ LEVELS + 1 }>(2.0 * position - 1.0);
    std::array::from_fn(|level| all[level + 1])
}

/// A sum of Legendre polynomials from the first on, of `2 x - 1`, in powers of that.
fn powers(weights: &[f64]) -> Vec<f64> {
    // Of each polynomial its powers, by the recursion of `legendre`.
    let (mut previous, mut present) = (vec![1.0], vec![0.0, 1.0]);
    let mut out = vec![0.0; weights.len() + 1];
    for (n, weight) in (1..).zip(weights) {
        out.iter_mut()
            .zip(&present)
            .for_each(|(out, power)| *out += weight * power);
        let degree = f64::from(n);
        let mut next = vec![0.0; present.len() + 1];
        next[1..]
            .iter_mut()
            .zip(&present)
            .for_each(|(next, power)| *next = (2.0 * degree + 1.0) * power);
        next.iter_mut()
            .zip(&previous)
            .for_each(|(next, power)| *next -= degree * power);
        next.iter_mut().for_each(|next| *next /= degree + 1.0);
        (previous, present) = (present, next);
    }
    out
}

/// Sum of the products of two values of all plays.
fn dot(a: &OfPlays, b: &OfPlays) -> f64 {
    // Four sums, which a processor adds at the same time.
    let mut sums = [0.0; 4];
    for (a, b) in a.chunks_exact(4).zip(b.chunks_exact(4)) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

#[derive(Clone)]
struct SwitchingStage {
    plays: Plays,
    reversible: [f64; REVERSIBLE],
    /// What the position of each play gives, by its powers.
    switching: [OfPlays; LEVELS + 1],
    /// What all of it gives at the lower limit.
    at_rest_um: f64,
    /// The drives of the last signal, and behind them where the plays stood, where another stage asks.
    kept: Option<Vec<f64>>,
}

impl SwitchingStage {
    fn new(from: &Build) -> Self {
        let values = from.values;
        let plays = Plays::new(from.model, values[0], values[1], from.setting.dt_s);
        let value = |i: usize| values.get(SHAPE + i).copied().unwrap_or(0.0);
        let mut switching = [[0.0; PLAYS]; LEVELS + 1];
        // Plays count from where the drive is.
        let mut reversible: [f64; REVERSIBLE] = std::array::from_fn(value);
        for j in 0..PLAYS {
            let weights: [f64; LEVELS] = std::array::from_fn(|level| {
                let size = |i: usize| plays.sizes[i][j] * value(REVERSIBLE + i * LEVELS + level);
                (0..SIZES).map(size).sum()
            });
            for (of_drive, weight) in reversible.iter_mut().zip(weights) {
                *of_drive -= weight;
            }
            for (out, power) in switching.iter_mut().zip(powers(&weights)) {
                out[j] = power;
            }
        }
        let mut out = Self {
            kept: None,
            switching,
            at_rest_um: 0.0,
            reversible,
            plays,
        };
        out.at_rest_um = out.output(out.plays.range.lower_v, &out.plays.positions);
        out
    }

    fn output(&self, drive_v: f64, positions: &OfPlays) -> f64 {
        let centred = positions.map(|position| 2.0 * position - 1.0);
        let mut each = self.switching[LEVELS];
        for weights in self.switching[..LEVELS].iter().rev() {
            for ((out, position), weight) in each.iter_mut().zip(&centred).zip(weights) {
                *out = *out * position + weight;
            }
        }
        let of_drive = by_level(self.plays.range.share(drive_v));
        let reversible = self.reversible.iter().zip(&of_drive);
        reversible
            .map(|(weight, value)| weight * value)
            .sum::<f64>()
            + dot(&each, &[1.0; PLAYS])
            - self.at_rest_um
    }
}

impl Stage for SwitchingStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.plays.step(input);
        self.output(input, &self.plays.positions)
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.plays.settle(input);
        self.output(input, &self.plays.positions)
    }
    fn run(&mut self, from: usize, signal: &mut [f64]) {
        let mut kept = self.kept.take();
        if let Some(kept) = &mut kept {
            kept.clear();
        }
        for (k, value) in signal.iter_mut().enumerate() {
            let drive_v = *value;
            *value = self.step(from + k, drive_v);
            if let Some(kept) = &mut kept {
                kept.push(drive_v);
                kept.extend(self.plays.positions);
            }
        }
        self.kept = kept;
    }
    fn shared(&mut self) -> Option<&mut dyn SharedPart> {
        Some(self)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let plays = &self.plays;
        let play = |j: usize| SwitchingPlay {
            begins: plays.begins[j],
            width: plays.widths[0][j],
            weights: self.switching.iter().map(|weights| weights[j]).collect(),
        };
        let mut reversible = powers(&self.reversible);
        reversible[0] -= self.at_rest_um;
        Ok(vec![Block::Switching {
            reversible,
            plays: (0..PLAYS).map(play).collect(),
            interval: plays.interval.shares(),
            rested: plays.rested_before_a_step.shares(),
            lower: plays.range.lower_v,
            span: plays.range.span_v,
        }])
    }
}

impl SharedPart for SwitchingStage {
    fn made_by(&self) -> Vec<f64> {
        // Whatever the density, these make the positions.
        vec![self.plays.activation, self.plays.forgotten]
    }
    fn keep(&mut self) {
        self.kept = Some(Vec::new());
    }
    fn kept(&self) -> &[f64] {
        self.kept.as_deref().unwrap_or_default()
    }
    fn run_with(&mut self, signal: &mut [f64], part: &[f64]) {
        let (rows, _) = part.as_chunks::<{ 1 + PLAYS }>();
        for (value, [drive_v, positions @ ..]) in signal.iter_mut().zip(rows) {
            *value = self.output(*drive_v, positions);
        }
    }
}

impl Loops for SwitchingStage {}

/// Coefficients of the density and of what has no memory.
const COEFFICIENTS: usize = REVERSIBLE + SIZES * LEVELS;

/// The plays, with the contribution of every coefficient apart.
struct SwitchingCoefficients {
    plays: Plays,
    at_rest: [f64; COEFFICIENTS],
}

impl SwitchingCoefficients {
    fn new(plays: Plays) -> Self {
        let mut at_rest = [0.0; COEFFICIENTS];
        contribute(&plays, plays.range.lower_v, &mut at_rest);
        Self { plays, at_rest }
    }

    fn fill(&self, drive_v: f64, row: &mut [f64]) {
        contribute(&self.plays, drive_v, row);
        row.iter_mut()
            .zip(&self.at_rest)
            .for_each(|(out, at_rest)| *out -= at_rest);
    }
}

/// What one unit of each coefficient gives.
fn contribute(plays: &Plays, drive_v: f64, row: &mut [f64]) {
    let (reversible, switching) = row.split_at_mut(REVERSIBLE);
    let of_drive = by_level(plays.range.share(drive_v));
    reversible.copy_from_slice(&of_drive);
    let mut levels = [[0.0; PLAYS]; LEVELS];
    for (j, position) in plays.positions.iter().enumerate() {
        let behind = by_level(*position).into_iter().zip(of_drive);
        for (out, (level, of_drive)) in levels.iter_mut().zip(behind) {
            out[j] = level - of_drive;
        }
    }
    for (out, size) in switching.chunks_exact_mut(LEVELS).zip(&plays.sizes) {
        out.iter_mut()
            .zip(&levels)
            .for_each(|(out, level)| *out = dot(size, level));
    }
}

impl ByCoefficient for SwitchingCoefficients {
    fn coefficients(&self) -> Vec<(&'static str, usize)> {
        (0..COEFFICIENTS).map(|i| (ID, SHAPE + i)).collect()
    }
    fn settle(&mut self, input: f64, row: &mut [f64]) {
        self.plays.settle(input);
        self.fill(input, row);
    }
    fn run(&mut self, inputs: &[f64], block: &mut [f64]) {
        for (drive_v, row) in inputs.iter().zip(block.chunks_exact_mut(COEFFICIENTS)) {
            self.plays.step(*drive_v);
            self.fill(*drive_v, row);
        }
    }
}

impl Effect for ActivatedSwitching {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics: "Heat lifts domain walls over their barriers: loops widen with the logarithm of the rate, and switching goes on after the drive has stopped.".into(),
            reference: "Smith, Seelecke, Dapino and Ounaies, J. Mech. Phys. Solids 54 (2006) 46-85; Mayergoyz, Mathematical Models of Hysteresis (1991)".into(),
            experiment: "the same nested loops at rates two decades apart, each followed by a hold".into(),
            picture: Picture {
                against: Against::Rate,
                caption: "An error that grows with the logarithm of the rate, and goes on after a turn.",
            },
            tried_for_loops: LoopsTried::FarAbove,
            // Counted as 13, a search with it takes 5.4 ns for a step; others take 3.5 to 4.9.
            lasts_steps: Some(20),
            equations: r"`X = (x - drive_min_v) / (drive_max_v - drive_min_v)`. There are 16 play operators, `j = 0..15`, of the thresholds `r_j = 0.55 ((j + 1/2) / 16)^1.5`. Each follows `z_j' = (2 w_j / t_0) exp(-1 / activation) sinh((X - z_j) / w_j)` with `w_j = activation r_j` and `t_0 = 1e-4 s`.

`Y = sum_i reversible_i_um P_i(2 X - 1) + sum_j h_j sum_(i,k) switching_i_k_um P_i(2 sqrt(r_j / 0.55) - 1) (P_k(2 z_j - 1) - P_k(2 X - 1))`. `P` are Legendre polynomials, and `h_j = ((j + 1) / 16)^0.75 - (j / 16)^0.75`.

Over an interval `X` is constant. With `d = (2 T / t_0) exp(-1 / activation)`, `a = 1 - exp(-d)`, `b = 1 + exp(-d)` and `q = exp(-|X - z_j| / w_j)` the new distance is `w_j ln((b + q a) / (a + q b))`. Where `q > 1e12 a` the play stands still. At rest each play has followed `X` for 10 s from `1 - forgotten` times where 10 s at `X = 0` leave one that stood at `r_j`. `y = Y - Y_0`, where `Y_0` is `Y` at rest at `X = 0`.",
            ..Declaration::of_loops()
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        let step = STEP_SHARE * overview.range_um.max(1e-6);
        let coefficient = |name: String| Parameter::linear(name, "um", -1e6, 1e6, step);
        let reversible = (1..=REVERSIBLE).map(|i| format!("reversible_{i}_um"));
        let switching = (0..SIZES)
            .flat_map(|size| (1..=LEVELS).map(move |level| (size, level)))
            .map(|(size, level)| {
                coefficient(format!("switching_{size}_{level}_um"))
                    .expected_within(EXPECTED_SHARE / STEP_SHARE / ((size + level) as f64).powi(2))
            });
        [
            Parameter::logarithmic("activation", "1", 0.003, 0.2),
            Parameter::linear("forgotten", "1", 0.0, 1.0, FORGOTTEN_STEP)
                .expected_within(EXPECTED_FORGOTTEN / FORGOTTEN_STEP),
        ]
        .into_iter()
        .chain(reversible.map(&coefficient))
        .chain(switching)
        .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        // Half of the range to each side of its middle; a fifth of it lags behind.
        let scale = 0.5 * overview.gain_um_v * overview.drive_range_v();
        let start = |activation| {
            let mut values = vec![0.0; SHAPE + COEFFICIENTS];
            values[0] = activation;
            (values[2], values[2 + REVERSIBLE]) = (scale, 0.2 * scale);
            values
        };
        // Twice as much, and half: a fit does not come from one to the other.
        [0.03, 0.06, 0.015].map(start).to_vec()
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        let overview = &case.stage.overview;
        let scale = 0.5 * overview.gain_um_v * overview.drive_range_v();
        let mut values = self.starts(overview).swap_remove(0);
        values[0] = 0.015 * case.strength;
        // Small thresholds carry most of the switching.
        values[SHAPE] = case.about(1.3 * scale);
        values[SHAPE + REVERSIBLE] = case.about(scale);
        values[SHAPE + REVERSIBLE + LEVELS] = -case.about(scale);
        Some(values)
    }

    fn loops(&self, from: &Build) -> Option<Box<dyn Loops>> {
        Some(Box::new(SwitchingStage::new(from)))
    }

    fn by_coefficient(&self, from: &Build) -> Option<Box<dyn ByCoefficient>> {
        let plays = Plays::new(
            from.model,
            from.values[0],
            from.values[1],
            from.setting.dt_s,
        );
        Some(Box::new(SwitchingCoefficients::new(plays)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Oracle: the differential equation of one play in many small steps.
        #[test]
        fn an_interval_solves_the_equation_of_a_play(
            activation in 0.02f64..0.15, threshold in 0.02f64..0.5, beyond in 0.8f64..1.3, length_exponent in -5.0f64..-1.0,
        ) {
            let (width, length_s) = (activation * threshold, 10f64.powf(length_exponent));
            let rate = 2.0 * width / ATTEMPT_S * (-1.0 / activation).exp();
            let x = beyond * threshold;
            let mut z = 0.0;
            let mut t = 0.0;
            // Steps over which the distance changes by a thousandth of the width.
            while t < length_s {
                let speed = rate * ((x - z) / width).sinh();
                let step = (1e-3 * width / speed.max(1e-300)).min(length_s - t);
                let middle = z + 0.5 * step * speed;
                z += step * rate * ((x - middle) / width).sinh();
                t += step;
                if step <= 1e-15 * length_s { break; }
            }
            let exact = Interval::new(activation, length_s).follow(0.0, x, width);
            prop_assert!((exact - z).abs() < 1e-4 * width, "{exact} {z}");
        }

        /// Near the input, around the bend and far beyond, in short and long intervals.
        #[test]
        fn the_curve_goes_where_an_interval_does(
            activation in 0.003f64..0.2, share in 0.0f64..1.0, far in 0.0f64..3.0, length_exponent in -6.0f64..2.0,
        ) {
            let (width, interval) = (0.3 * activation, Interval::new(activation, 10f64.powf(length_exponent)));
            let curve = Curve::new(&interval);
            let most = curve.from + curve.pieces.len() as f64 / Curve::PIECES;
            for distance in [share * most, most + far.exp() - 1.0] {
                let exact = interval.follow(0.5, 0.5 - distance * width, width);
                let mut read = [0.5];
                curve.follow(&mut read, 0.5 - distance * width, &[[width], [1.0 / width]]);
                prop_assert!((read[0] - exact).abs() < 1e-9 * width, "{distance}: {read:?} {exact}");
            }
        }

        #[test]
        fn two_halves_of_an_interval_are_the_whole(
            activation in 0.01f64..0.2, beyond in 0.0f64..3.0, length_exponent in -6.0f64..2.0,
        ) {
            let (width, length_s) = (0.3 * activation, 10f64.powf(length_exponent));
            let half = Interval::new(activation, 0.5 * length_s);
            let x = 0.3 * beyond;
            let twice = half.follow(half.follow(0.0, x, width), x, width);
            let once = Interval::new(activation, length_s).follow(0.0, x, width);
            prop_assert!((twice - once).abs() < 1e-9 * width, "{twice} {once}");
        }
    }

    /// Weighted with the coefficients, the contributions are the output.
    #[test]
    fn the_contributions_add_up_to_the_output() {
        let overview = Overview::without_data(-20.0, 80.0);
        let mut model = Model::new(-20.0, 80.0);
        let mut values = vec![0.05, 0.4];
        values.extend((0..COEFFICIENTS).map(|i| (1.7 * i as f64).sin()));
        let effect = std::sync::Arc::new(ActivatedSwitching);
        model.add(EffectInstance::new(effect, &overview, &values));
        let setting = Setting::of_held_drive(-20.0, 80.0, 1e-3);
        let mut stage = model.effects[0].stage(&model, &setting).unwrap();
        let mut apart = model.effects[0].by_coefficient(&model, &setting).unwrap();
        let mut row = vec![0.0; apart.coefficients().len()];
        let sum = |row: &[f64]| {
            row.iter()
                .zip(&values[SHAPE..])
                .map(|(a, b)| a * b)
                .sum::<f64>()
        };
        apart.settle(30.0, &mut row);
        assert!((sum(&row) - stage.settle(30.0)).abs() < 1e-12);
        for k in 0..200 {
            let drive_v = 30.0 + 45.0 * (0.1 * f64::from(k)).sin();
            apart.run(&[drive_v], &mut row);
            let whole = stage.step(k as usize, drive_v);
            assert!(
                (sum(&row) - whole).abs() < 1e-12,
                "{k}: {} {whole}",
                sum(&row)
            );
        }
    }

    /// Oracle: a play that moves steadily keeps a distance at which its speed is that of the drive.
    #[test]
    fn loops_widen_with_the_logarithm_of_the_rate() {
        let (activation, threshold) = (0.03, 0.2);
        let width = activation * threshold;
        let lag = |rate: f64| {
            let dt_s = 1e-3 * threshold / rate;
            let interval = Interval::new(activation, dt_s);
            let (mut x, mut z) = (0.0, 0.0);
            for _ in 0..3000 {
                x += rate * dt_s;
                z = interval.follow(z, x, width);
            }
            x - z
        };
        let decade = lag(10.0) - lag(1.0);
        assert!(
            (decade - width * 10f64.ln()).abs() < 0.01 * width,
            "{decade}"
        );
    }
}
