//! The law of each block.

use crate::block::{
    Block, CreepingPlay, Linear, PAIRS, Play, Rate, SwitchingPlay, TwoFirstWays, Written,
};
use crate::law::{Law, deeper};

impl Law {
    fn plays(self, names: [&'static str; 3], plays: &[Play]) -> Self {
        self.count(names[0], plays.len())
            .list(names[1], plays.iter().map(|play| play.threshold).collect())
            .list(names[2], plays.iter().map(|play| play.weight).collect())
    }

    /// This and a linear part that has a share in the output.
    pub(crate) fn beside(mut self, share: f64, linear: &Linear) -> Self {
        let other = law_of_linear(linear);
        self.step += &format!(
            "first = y\n{}y = first + {share:e} * (y - first)\n",
            other.step
        );
        self.begin += &other.begin;
        self.numbers.extend(other.numbers);
        self.states.extend(other.states);
        self
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
const LOOPS: &str = "if v > newest
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

/// What loops that begin in the middle have beside: virgin operators are three terms more of the surface.
const FIRST_WAYS: &str = "highest = max(highest, min(v, 1))
lowest = min(lowest, max(v, 0))
above[terms] = highest
below[terms] = 0
above[terms + 1] = 1
below[terms + 1] = lowest
above[terms + 2] = highest
below[terms + 2] = lowest
for t < 3
  loss = 0
  for i < degree
    row = 0
    for j < degree
      row = row * below[terms + t] + g[degree * degree - 1 - i * degree - j]
    loss = loss * above[terms + t] + row
  if t < 2
    loss = -loss
  still = still + virgin_share * loss
up = (highest - zero) / max(1 - zero, 1e-12)
down = (zero - lowest) / max(zero, 1e-12)
risen = 0
fallen = 0
for i < stays
  risen = risen * up + rise[stays - 1 - i]
  fallen = fallen * down + fall[stays - 1 - i]
still = still - zero_um + risen - fallen
";

/// The input of the loops.
const SHARE: &str = "v = (x - lower) / span
";

/// Loops solved for their input: by the chord between where it stands and the end of its range, of which an end
/// that stays twice counts half (Dowell and Jarratt, BIT 11 (1971) 168). Each trial goes on from the memory that is
/// kept; what it writes beyond the kept pairs is free.
const SOLVED: &str = "wanted = x - lower
if wanted != given
  near = kept_newest
  lacks = given - wanted
  far = 0
  if lacks < 0
    far = 1
  beyond = 0
  stayed = 0
  v = far
  n = 0
  while n < 60
    newest = kept_newest
    opened = kept_opened
    pairs = kept_pairs
    is_open = kept_is_open
TRIED
    left = still - wanted
    if n == 0 || left * lacks <= 0
      far = v
      beyond = left
      if stayed < 0
        lacks = 0.5 * lacks
      stayed = -1
    else
      near = v
      lacks = left
      if stayed > 0
        beyond = 0.5 * beyond
      stayed = 1
    n = n + 1
    if n == 1
      stayed = 0
    if beyond * lacks >= 0 || abs(left) <= 1e-14 * max(abs(wanted), 1) || abs(far - near) <= 1e-15
      n = 60
    else
      v = near + (far - near) * lacks / (lacks - beyond)
  kept_newest = newest
  kept_opened = opened
  kept_pairs = pairs
  kept_is_open = is_open
  given = still
y = span * kept_newest
";

const RATED_PLAYS: &str = "v = (x - lower) / span
rate = abs(x - last) / period_s / 1e4
last = x
y = 0
for i < plays
  stands[i] = min(max(stands[i], v - thresholds[i]), v + thresholds[i])
  y = y + (weights[i] + by_rate[i] * rate) * stands[i]
";

const BRANCHES: &str = "v = (x - lower) / span
if x > last
  side = 1
if x < last
  side = -1
last = x
between = 0
for i < middles
  between = between * v + middle[middles - 1 - i]
half = 0
for i < openings
  half = half * v + opening[openings - 1 - i]
y = v * between - side * v * (1 - v) * half
";

const CREEPING_PLAYS: &str = "y = x
for i < plays
  away = 0.5 * (last + x) - stands[i]
  if abs(away) > thresholds[i]
    off = thresholds[i]
    if away < 0
      off = -off
    stands[i] = decays[i] * stands[i] + by_start[i] * (last - off) + by_end[i] * (x - off)
  y = y + shares[i] * stands[i]
last = x
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
  power = 1
  for p < orders
    power = power * rate / orders_at
    added = 0
    for i < order_curve
      added = added * top + order_r[(p + 1) * order_curve - 1 - i]
    for t < terms
      loss = 0
      for i < order_degree
        row = 0
        for j < order_degree
          row = row * below[t] + order_g[(p + 1) * order_degree * order_degree - 1 - i * order_degree - j]
        loss = loss * above[t] + row
      added = added + sign[t] * loss
    held = held + power * added
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
                first_ways,
                lower,
                span,
            } => {
                let mut law = law_of_surfaces(g, r, plays, [*lower, *span]);
                law.step = format!("{SHARE}{}", law.step);
                if let Some(ways) = first_ways {
                    law = with_first_ways(law, ways, plays);
                }
                with_rate(law, rate.as_ref())
            }
            Self::LoopsSolved { g, r, lower, span } => law_of_solved(g, r, [*lower, *span]),
            Self::RatedPlays {
                plays,
                by_rate,
                period_s,
                lower,
                span,
            } => Law::of(RATED_PLAYS)
                .value("lower", *lower)
                .value("span", *span)
                .value("period_s", *period_s)
                .plays(["plays", "thresholds", "weights"], plays)
                .list("by_rate", by_rate.clone())
                .state("stands", Some(plays.len()))
                .state("last", None)
                .begins("last = x\n"),
            Self::Branches {
                middle,
                opening,
                lower,
                span,
            } => Law::of(BRANCHES)
                .value("lower", *lower)
                .value("span", *span)
                .count("middles", middle.len())
                .list("middle", middle.clone())
                .count("openings", opening.len())
                .list("opening", opening.clone())
                .state("last", None)
                .state("side", None)
                .begins("last = lower\nside = 1\n"),
            Self::CreepingPlays(plays) => law_of_creeping_plays(plays),
            Self::Written(written) => law_of_written(written),
            Self::Mass(law) => law.clone(),
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

/// The surfaces of `v`, `still` and `first`.
fn law_of_surfaces(g: &[Vec<f64>], r: &[f64], plays: &[Play], [lower, span]: [f64; 2]) -> Law {
    Law::of(LOOPS)
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
        .state("above", Some(2 * PAIRS + 5))
        .state("below", Some(2 * PAIRS + 5))
        .state("sign", Some(2 * PAIRS + 2))
        .state("opened", None)
        .state("newest", None)
        .state("stands", Some(plays.len()))
        .counter("pairs")
        .counter("terms")
        .counter("is_open")
}

/// With two first ways from 0 V, where the memory begins.
fn with_first_ways(law: Law, ways: &TwoFirstWays, plays: &[Play]) -> Law {
    let begin = "newest = zero\nhighest = zero\nlowest = zero\n";
    let of_plays = "for i < plays\n  stands[i] = max(zero - thresholds[i], 0)\n";
    let of_plays = if plays.is_empty() { "" } else { of_plays };
    let step = format!("{}{FIRST_WAYS}", law.step);
    Law { step, ..law }
        .value("virgin_share", ways.virgin_share)
        .value("zero", ways.zero)
        .value("zero_um", ways.zero_um)
        .count("stays", ways.stays_um[0].len())
        .list("rise", ways.stays_um[0].clone())
        .list("fall", ways.stays_um[1].clone())
        .state("highest", None)
        .state("lowest", None)
        .begins(&format!("{begin}{of_plays}"))
}

fn with_rate(law: Law, rate: Option<&Rate>) -> Law {
    let Some(rate) = rate else {
        return Law {
            step: format!("{}y = still\n", law.step),
            ..law
        };
    };
    let order = rate.orders.first();
    let (begin, step) = (&law.begin, &law.step);
    let (begin, step) = (
        format!("{begin}last = x\nunchanged = substeps\n"),
        format!("{step}{RATE}"),
    );
    let flat = rate
        .orders
        .iter()
        .flat_map(|order| order.g.iter().flatten());
    Law { begin, step, ..law }
        .value("loop_linear", rate.loop_linear)
        .value("loop_quadratic", rate.loop_quadratic)
        .value("curve_linear", rate.curve_linear)
        .value("dt_s", rate.dt_s)
        .count("substeps", rate.substeps)
        .count("orders", rate.orders.len())
        .value("orders_at", rate.orders_at)
        .count("order_degree", order.map_or(0, |order| order.g.len()))
        .list("order_g", flat.copied().collect())
        .count("order_curve", order.map_or(0, |order| order.r.len()))
        .list(
            "order_r",
            rate.orders
                .iter()
                .flat_map(|order| order.r.clone())
                .collect(),
        )
        .state("last", None)
        .state("held", None)
        .counter("unchanged")
}

fn law_of_solved(g: &[Vec<f64>], r: &[f64], range: [f64; 2]) -> Law {
    let law = law_of_surfaces(g, r, &[], range);
    let step = SOLVED.replace("TRIED\n", &deeper(&law.step, 2));
    Law { step, ..law }
        .state("kept_newest", None)
        .state("kept_opened", None)
        .counter("kept_pairs")
        .counter("kept_is_open")
        .state("given", None)
}

fn law_of_creeping_plays(plays: &[CreepingPlay]) -> Law {
    let each = |of: fn(&CreepingPlay) -> f64| plays.iter().map(of).collect::<Vec<f64>>();
    let begin = "last = x\nfor i < plays\n  stands[i] = min(max(0, x - thresholds[i]), x + thresholds[i])\n";
    Law::of(CREEPING_PLAYS)
        .count("plays", plays.len())
        .list("shares", each(|play| play.share))
        .list("thresholds", each(|play| play.threshold))
        .list("decays", each(|play| play.decay))
        .list("by_start", each(|play| play.adds[0]))
        .list("by_end", each(|play| play.adds[1]))
        .state("stands", Some(plays.len()))
        .state("last", None)
        .begins(begin)
}

/// One part of an interval by the method of Runge and Kutta: derivatives at four places, of which the largest
/// differences show how fast the states are.
fn runge_kutta(derivatives: &str, states: &[[f64; 2]]) -> String {
    let each = |line: &dyn Fn(usize) -> String| (0..states.len()).map(line).collect::<String>();
    let mut out = String::new();
    for (stage, (share, by)) in [(0.0, 0.0), (0.5, 0.5), (0.5, 0.5), (1.0, 1.0)]
        .iter()
        .enumerate()
    {
        out += &format!("now = last + (x - last) * (part + {share}) / parts\n");
        out += &format!("time = (n - 1) * dt_s + (part + {share}) * h\n");
        out += &each(&|i| match stage {
            0 => format!("q{i} = s{i}\n"),
            _ => format!("q{i} = s{i} + {by} * h * k{}{i}\n", stage - 1),
        });
        out += derivatives;
        out += &each(&|i| format!("k{stage}{i} = d{i}\n"));
    }
    out += "apart = 0\nanswers = 0\nlargest = 0\n";
    out += &each(&|i| {
        let unit = states[i][1];
        format!(
            "apart = max(apart, 0.5 * h * abs(k1{i} - k0{i}) / {unit:e})\nanswers = max(answers, abs(k2{i} - k1{i}) / {unit:e})\n\
             largest = max(largest, max(abs(s{i}), h * abs(k0{i})) / {unit:e})\n"
        )
    });
    out += "if apart > 1e-7 * largest\n  fastest = max(fastest, answers / apart)\n";
    out + &each(&|i| format!("s{i} = s{i} + h / 6 * (k0{i} + 2 * k1{i} + 2 * k2{i} + k3{i})\n"))
}

/// What a user wrote. Its states are taken again in more parts where the signal makes one too fast.
fn law_of_written(written: &Written) -> Law {
    let Written {
        output,
        derivatives,
        states,
        dt_s,
        parts,
    } = written;
    let each = |line: &dyn Fn(usize) -> String| (0..states.len()).map(line).collect::<String>();
    let mut step = String::from("n = n + 1\nrate = (x - last) / dt_s\n");
    if !states.is_empty() {
        step += "parts = usual\nagain = 0\nif n > 0\n  again = 2\n";
        step += &each(&|i| format!("begun{i} = s{i}\n"));
        step += "while again > 0\n  fastest = 0\n  h = dt_s / parts\n";
        step += &deeper(&each(&|i| format!("s{i} = begun{i}\n")), 1);
        step += "  for part < parts\n";
        step += &deeper(&runge_kutta(derivatives, states), 2);
        // The program refuses a state that 256 parts do not follow.
        step += "  again = again - 1\n  if fastest * dt_s / parts <= 2\n    again = 0\n  if again > 0\n    parts = 1\n    \
                 while parts < min(fastest * dt_s / 0.25, 256)\n      parts = 2 * parts\n";
        step += &each(&|i| format!("q{i} = s{i}\n"));
    }
    step += &format!("last = x\nnow = x\ntime = n * dt_s\n{output}");
    let mut begin = String::from("n = -1\nlast = x\n");
    let mut law = Law::of(&step)
        .value("dt_s", *dt_s)
        .count("usual", *parts)
        .state("n", None)
        .state("last", None);
    for (i, [first, _]) in states.iter().enumerate() {
        begin += &format!("s{i} = {first:e}\n");
        law = law.state(&format!("s{i}"), None);
    }
    law.begins(&begin)
}
