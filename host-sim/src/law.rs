//! What each block does, written once: lines of assignments, conditions and loops that exports print in their
//! language.
//!
//! A law has numbers, states, what the states are where it begins at rest with the input `x`, and one step
//! from `x` to `y`. The step gives the output at rest too. Lines are indented by two blanks inside `if`,
//! `else`, `while` and `for i < count`; indices count from zero; `force` is the measured force. All names that
//! are neither numbers nor states hold within a step.

use crate::block::{Block, Linear, PAIRS, Play, Rate, SwitchingPlay};

/// A number that a law knows by name.
#[derive(Clone, Debug, PartialEq)]
pub enum LawNumber {
    /// A value.
    Value(f64),
    /// A whole number.
    Count(usize),
    /// A list.
    List(Vec<f64>),
}

/// A state that a law keeps from step to step; it begins at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct LawState {
    /// Its name.
    pub name: String,
    /// How many there are; none for a single one.
    pub size: Option<usize>,
    /// It counts.
    pub counts: bool,
}

/// What a block does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Law {
    /// Numbers by name.
    pub numbers: Vec<(&'static str, LawNumber)>,
    /// States.
    pub states: Vec<LawState>,
    /// What the states are at rest with the input `x`, beside zero.
    pub begin: String,
    /// From `x` to `y`.
    pub step: String,
}

impl Law {
    fn of(step: &str) -> Self {
        Self {
            step: step.to_owned(),
            ..Self::default()
        }
    }

    fn value(mut self, name: &'static str, value: f64) -> Self {
        self.numbers.push((name, LawNumber::Value(value)));
        self
    }

    fn count(mut self, name: &'static str, count: usize) -> Self {
        self.numbers.push((name, LawNumber::Count(count)));
        self
    }

    fn list(mut self, name: &'static str, values: Vec<f64>) -> Self {
        self.numbers.push((name, LawNumber::List(values)));
        self
    }

    fn plays(self, names: [&'static str; 3], plays: &[Play]) -> Self {
        self.count(names[0], plays.len())
            .list(names[1], plays.iter().map(|play| play.threshold).collect())
            .list(names[2], plays.iter().map(|play| play.weight).collect())
    }

    fn state(mut self, name: &str, size: Option<usize>) -> Self {
        self.states.push(LawState {
            name: name.to_owned(),
            size,
            counts: false,
        });
        self
    }

    fn counter(mut self, name: &str) -> Self {
        self.states.push(LawState {
            name: name.to_owned(),
            size: None,
            counts: true,
        });
        self
    }

    fn begins(self, lines: &str) -> Self {
        Self {
            begin: lines.to_owned(),
            ..self
        }
    }
}

const SLOPE: &str = "away = x - stands
if abs(away) <= most
  share = 1
  if most > 0
    share = abs(away) / most
  stands = x
  y = x - gives_mean * away * 0.5 * share
else
  by = most
  if away < 0
    by = -most
  stands = stands + by
  y = stands - gives_mean * 0.5 * by
";

const DELAY: &str = "late = ring[at]
ring[at] = x
at = at + 1
if at > whole
  at = 0
y = late_share * late + (1 - late_share) * ring[at]
";

const PLAYS: &str = "v = (x - lower) / span
total = 0
for i < plays
  stands[i] = min(max(stands[i], v - thresholds[i]), v + thresholds[i])
  total = total + weights[i] * stands[i]
y = total
for i < zones
  y = y + zone_weights[i] * max(total - zone_thresholds[i], 0)
";

const SLIP: &str = "v = (x - lower) / span
held = 0
for i < elements
  stretch[i] = min(max(stretch[i] + v - last, -thresholds[i]), thresholds[i])
  held = held + weights[i] * stretch[i]
last = v
y = gain * v - held
";

const BOUC_WEN: &str = "v = (x - lower) / span
pieces = min(max(ceil(abs(v - last) * 200), 1), 400)
piece = (v - last) / pieces
for i < pieces
  turn = gamma_
  if h < 0
    turn = -gamma_
  middle = h + 0.5 * (alpha * piece - (beta_ * abs(piece) + turn * piece) * h)
  turn = gamma_
  if middle < 0
    turn = -gamma_
  h = h + alpha * piece - (beta_ * abs(piece) + turn * piece) * middle
last = v
y = gain * v - h
";

const DUHEM: &str = "v = (x - lower) / span
change = v - last
if change != 0 && approach > 1e-9
  forcing = (elastic - slope) / approach
  if change < 0
    forcing = -forcing
  held = slope * v + forcing + (held - slope * last - forcing) * exp(-approach * abs(change))
else
  held = held + elastic * change
last = v
y = held
";

const SWITCHING: &str = "v = (x - lower) / span
t = 2 * v - 1
y = 0
for i < reversible
  y = y * t + powers[reversible - 1 - i]
for i < plays
  away = v - stands[i]
  if abs(away) >= still * widths[i]
    q = exp(-abs(away) / widths[i])
    keeps = max(log((kept + q * lost) / (lost + q * kept)), 0) * widths[i]
    if away < 0
      keeps = -keeps
    stands[i] = v - keeps
  t = 2 * stands[i] - 1
  given = 0
  for j < levels
    given = given * t + weights[i * levels + levels - 1 - j]
  y = y + given
";

const SWITCHING_BEGINS: &str = "v = (x - lower) / span
for i < plays
  stands[i] = begins[i]
  away = v - stands[i]
  if abs(away) >= rested_still * widths[i]
    q = exp(-abs(away) / widths[i])
    keeps = max(log((rested_kept + q * rested_lost) / (rested_lost + q * rested_kept)), 0) * widths[i]
    if away < 0
      keeps = -keeps
    stands[i] = v - keeps
";

const DRIFT: &str = "n = n + 1
slowed = slowing * n
if abs(slowed) < 1e-9
  y = x + rate * n
else
  y = x - rate * expm1(-slowed) / slowing
";

const LINES: &str = "n = n + 1
y = x
for i < lines
  y = y + cosines[i] * cos(angles[i] * n) + sines[i] * sin(angles[i] * n)
";

/// One-sided Preisach hysteresis. Pairs of extrema that nest are remembered, and the loss surface G is summed
/// over `terms` of them; `first` is the initial curve at the global maximum.
const LOOPS: &str = "v = (x - lower) / span
if v > newest
  if is_open > 0
    if pairs < capacity
      high[pairs] = opened
      low[pairs] = newest
      pairs = pairs + 1
    is_open = 0
  while pairs > 0 && v >= high[max(pairs - 1, 0)]
    pairs = pairs - 1
if v < newest
  if is_open == 0
    opened = newest
    is_open = 1
  while pairs > 0 && v <= low[max(pairs - 1, 0)]
    pairs = pairs - 1
    opened = high[pairs]
newest = v
top = v
innermost = v
if is_open > 0
  top = opened
  innermost = opened
if pairs > 0
  top = high[0]
above[0] = top
below[0] = 0
sign[0] = 1
terms = 1
for i < pairs
  above[terms] = high[i]
  below[terms] = low[i]
  sign[terms] = -1
  inner = innermost
  if i + 1 < pairs
    inner = high[i + 1]
  above[terms + 1] = inner
  below[terms + 1] = low[i]
  sign[terms + 1] = 1
  terms = terms + 2
if is_open > 0
  above[terms] = opened
  below[terms] = v
  sign[terms] = -1
  terms = terms + 1
first = 0
for i < curve
  first = first * top + r[curve - 1 - i]
still = first
for t < terms
  loss = 0
  for i < degree
    row = 0
    for j < degree
      row = row * below[t] + g[degree * degree - 1 - i * degree - j]
    loss = loss * above[t] + row
  still = still + sign[t] * loss
  if t == 0
    first = first + loss
for i < plays
  stands[i] = min(max(stands[i], v - thresholds[i]), v + thresholds[i])
  still = still + weights[i] * stands[i]
  first = first + weights[i] * max(top - thresholds[i], 0)
";

/// How loops depend on the rate of a drive that moves once a period, in steps inside it or for good.
const RATE: &str = "moves = 0
if x != last
  moves = 1
else
  unchanged = unchanged + 1
if moves > 0 || unchanged >= substeps
  seconds = dt_s
  if unchanged + 1 >= substeps
    seconds = dt_s * substeps
  if moves > 0
    unchanged = 0
  rate = abs(x - last) / seconds / 1e4
  held = first * (1 + curve_linear * rate) - (first - still) * (1 + rate * (loop_linear + rate * loop_quadratic))
last = x
y = held
";

impl Block {
    /// What the block does.
    #[must_use]
    pub fn law(&self) -> Law {
        match self {
            Self::Proportional { gain, offset } => Law::of("y = gain * (x - offset)\n")
                .value("gain", *gain)
                .value("offset", *offset),
            Self::Clamp { lower, upper } => Law::of("y = max(min(x, upper), lower)\n")
                .value("lower", *lower)
                .value("upper", *upper),
            Self::Slope { most, gives_mean } => Law::of(SLOPE)
                .value("most", *most)
                .value("gives_mean", f64::from(*gives_mean))
                .state("stands", None)
                .begins("stands = x\n"),
            Self::Linear(linear) => law_of_linear(linear),
            Self::Delay { whole, late_share } => Law::of(DELAY)
                .count("whole", *whole)
                .value("late_share", *late_share)
                .state("ring", Some(whole + 1))
                .counter("at")
                .begins("for i < whole + 1\n  ring[i] = x\n"),
            Self::Loops {
                g,
                r,
                plays,
                rate,
                lower,
                span,
            } => law_of_loops(g, r, plays, rate.as_ref(), [*lower, *span]),
            Self::Plays {
                plays,
                zones,
                lower,
                span,
            } => Law::of(PLAYS)
                .value("lower", *lower)
                .value("span", *span)
                .plays(["plays", "thresholds", "weights"], plays)
                .plays(["zones", "zone_thresholds", "zone_weights"], zones)
                .state("stands", Some(plays.len())),
            Self::Slip {
                gain,
                elements,
                lower,
                span,
            } => Law::of(SLIP)
                .value("gain", *gain)
                .value("lower", *lower)
                .value("span", *span)
                .plays(["elements", "thresholds", "weights"], elements)
                .state("stretch", Some(elements.len()))
                .state("last", None),
            Self::BoucWen {
                gain,
                alpha,
                beta,
                gamma,
                lower,
                span,
            } => Law::of(BOUC_WEN)
                .value("gain", *gain)
                .value("alpha", *alpha)
                .value("beta_", *beta)
                .value("gamma_", *gamma)
                .value("lower", *lower)
                .value("span", *span)
                .state("h", None)
                .state("last", None),
            Self::Duhem {
                approach,
                slope,
                elastic,
                lower,
                span,
            } => Law::of(DUHEM)
                .value("approach", *approach)
                .value("slope", *slope)
                .value("elastic", *elastic)
                .value("lower", *lower)
                .value("span", *span)
                .state("held", None)
                .state("last", None),
            Self::Switching {
                reversible,
                plays,
                interval,
                rested,
                lower,
                span,
            } => law_of_switching(reversible, plays, [*interval, *rested], [*lower, *span]),
            Self::BiasedGain { per_um, decay } => {
                Law::of("mean = x + decay * (mean - x)\ny = x * (1 + per_um * mean)\n")
                    .value("per_um", *per_um)
                    .value("decay", *decay)
                    .state("mean", None)
                    .begins("mean = x\n")
            }
            Self::Gap { half } => {
                Law::of("stands = min(max(stands, x - half), x + half)\ny = stands\n")
                    .value("half", *half)
                    .state("stands", None)
                    .begins("stands = x\n")
            }
            Self::Drift { rate, slowing } => Law::of(DRIFT)
                .value("rate", *rate)
                .value("slowing", *slowing)
                .state("n", None)
                .begins("n = -1\n"),
            Self::Lines(lines) => Law::of(LINES)
                .count("lines", lines.len())
                .list("angles", lines.iter().map(|line| line[0]).collect())
                .list("sines", lines.iter().map(|line| line[1]).collect())
                .list("cosines", lines.iter().map(|line| line[2]).collect())
                .state("n", None)
                .begins("n = -1\n"),
            Self::Bend { quadratic, cubic } => {
                Law::of("y = x * (1 + x * (quadratic + x * cubic))\n")
                    .value("quadratic", *quadratic)
                    .value("cubic", *cubic)
            }
            Self::Force { compliance } => {
                Law::of("y = x + compliance * force\n").value("compliance", *compliance)
            }
        }
    }
}

/// Its matrices written out, without what is zero.
fn law_of_linear(linear: &Linear) -> Law {
    let states = || (0..linear.rest.len()).map(|i| format!("s{i}"));
    let sum = |terms: &mut dyn Iterator<Item = (f64, String)>| {
        let terms: Vec<String> = terms
            .filter(|(factor, _)| *factor != 0.0)
            .map(|(factor, name)| format!("{factor:e} * {name}"))
            .collect();
        if terms.is_empty() {
            "0".to_owned()
        } else {
            terms.join(" + ")
        }
    };
    let input =
        |before: f64, now: f64| [(before, "last".to_owned()), (now, "now".to_owned())].into_iter();
    let along = |row: &[f64]| row.iter().copied().zip(states()).collect::<Vec<_>>();
    let mut step = format!(
        "now = x - offset\ny = offset + {}\n",
        sum(&mut along(&linear.out)
            .into_iter()
            .chain(input(linear.before, linear.through)))
    );
    for (i, row) in linear.phi.iter().enumerate() {
        let mut terms = along(row)
            .into_iter()
            .chain(input(linear.start[i], linear.end[i]));
        step += &format!("next{i} = {}\n", sum(&mut terms));
    }
    let mut begin = String::from("last = x - offset\n");
    let mut law = Law::default()
        .value("offset", linear.offset)
        .state("last", None);
    for (i, unit) in linear.rest.iter().enumerate() {
        step += &format!("s{i} = next{i}\n");
        begin += &format!("s{i} = {unit:e} * last\n");
        law = law.state(&format!("s{i}"), None);
    }
    step += "last = now\n";
    Law { begin, step, ..law }
}

fn law_of_switching(
    reversible: &[f64],
    plays: &[SwitchingPlay],
    [interval, rested]: [[f64; 3]; 2],
    [lower, span]: [f64; 2],
) -> Law {
    let each = |of: fn(&SwitchingPlay) -> f64| plays.iter().map(of).collect::<Vec<f64>>();
    Law::of(SWITCHING)
        .value("lower", lower)
        .value("span", span)
        .count("reversible", reversible.len())
        .list("powers", reversible.to_vec())
        .count("plays", plays.len())
        .count("levels", plays.first().map_or(0, |play| play.weights.len()))
        .list("begins", each(|play| play.begins))
        .list("widths", each(|play| play.width))
        .list(
            "weights",
            plays.iter().flat_map(|play| play.weights.clone()).collect(),
        )
        .value("lost", interval[0])
        .value("kept", interval[1])
        .value("still", interval[2])
        .value("rested_lost", rested[0])
        .value("rested_kept", rested[1])
        .value("rested_still", rested[2])
        .state("stands", Some(plays.len()))
        .begins(SWITCHING_BEGINS)
}

fn law_of_loops(
    g: &[Vec<f64>],
    r: &[f64],
    plays: &[Play],
    rate: Option<&Rate>,
    [lower, span]: [f64; 2],
) -> Law {
    let law = Law::of(LOOPS)
        .value("lower", lower)
        .value("span", span)
        .count("degree", g.len())
        .list("g", g.iter().flatten().copied().collect())
        .count("curve", r.len())
        .list("r", r.to_vec())
        .count("capacity", PAIRS)
        .plays(["plays", "thresholds", "weights"], plays)
        .state("high", Some(PAIRS))
        .state("low", Some(PAIRS))
        .state("above", Some(2 * PAIRS + 2))
        .state("below", Some(2 * PAIRS + 2))
        .state("sign", Some(2 * PAIRS + 2))
        .state("opened", None)
        .state("newest", None)
        .state("stands", Some(plays.len()))
        .counter("pairs")
        .counter("terms")
        .counter("is_open");
    let Some(rate) = rate else {
        return Law {
            step: format!("{}y = still\n", law.step),
            ..law
        };
    };
    let law = law
        .value("loop_linear", rate.loop_linear)
        .value("loop_quadratic", rate.loop_quadratic)
        .value("curve_linear", rate.curve_linear)
        .value("dt_s", rate.dt_s)
        .count("substeps", rate.substeps)
        .state("last", None)
        .state("held", None)
        .counter("unchanged")
        .begins("last = x\nunchanged = substeps\n");
    Law {
        step: format!("{}{RATE}", law.step),
        ..law
    }
}
