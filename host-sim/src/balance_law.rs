//! What a mass does that works against forces, written for exports as [`crate::law`] says: the method of
//! `effect/force_balance.rs`, with the same pieces and trials.

use crate::law::{Law, deeper};

/// A mode whose mass works against forces.
pub(crate) struct BalancedMass {
    /// How many states it has: displacement, velocity, and those of what reads it.
    pub(crate) order: usize,
    /// The state that is read.
    pub(crate) read: usize,
    /// How it goes over half a piece and over a piece, by segment and by how often the pieces are halved; over
    /// the whole interval where it is not followed in pieces.
    pub(crate) over: Vec<Over>,
    /// Its pieces.
    pub(crate) pieces: Option<InPieces>,
}

/// Pieces of an interval.
pub(crate) struct InPieces {
    /// How many pieces each segment has at least.
    pub(crate) fewest: Vec<f64>,
    /// How often the mode without forces fills one of them.
    pub(crate) fills: Vec<f64>,
    /// Lines of [`crate::law`] from `before`, `x`, `segment`, `piece` and `count` to where the drive is at the
    /// beginning of a piece, `here`, in its middle, `midway`, and at its end, `ahead`.
    pub(crate) way: String,
}

/// How states go over a time: by rows, by the drive at its start and end, and by a force's three powers.
pub(crate) struct Over {
    /// Transition.
    pub(crate) phi: Vec<f64>,
    /// What the drive adds by where it begins.
    pub(crate) start: Vec<f64>,
    /// What it adds by where it ends.
    pub(crate) end: Vec<f64>,
    /// What a force takes away, three of each state.
    pub(crate) powers: Vec<f64>,
}

/// What a force does, in lines with its numbers in them.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceLines {
    /// From `place`, `came`, `SPEED` and `memory` to `given`, and to `kept` where it remembers.
    pub held: String,
    /// From `place` to these, of a mass that has come to rest there.
    pub at_rest: String,
    /// From `memory` and `SWING` to what is added to `stiff`.
    pub stiffening: String,
    /// It has a memory.
    pub remembers: bool,
}

/// A place where the forces balance `x`: outward from a straight spring until it lies between two places, then
/// by halves.
const RESTS: &str = "place = x
found = 0
begun = 0
reach = 0
near = x
far = x
for turn < 100
  total = 0
FORCES
  left = place + total - x
  if turn == 0
    begun = left
    reach = abs(left)
  if found == 0
    if turn > 0 && left * begun <= 0
      found = 1
      far = place
    else
      near = place
  else
    if left * begun > 0
      near = place
    else
      far = place
  if turn < 99 && begun != 0
    if found > 0
      place = 0.5 * (near + far)
    else
      place = x - reach
      if begun < 0
        place = x + reach
      reach = 2 * reach
";

/// One interval in pieces: in each the mass is tried half way, half way again, at the end and at the end again.
const PIECES: &str = "stiff = 1
STIFFENING
for segment < segments
  filled = sqrt(max(stiff, 1)) * fills[segment]
  count = fewest[segment]
  level = 0
  while filled > 1 && level < levels - 1
    filled = 0.5 * filled
    count = 2 * count
    level = level + 1
  of_half = 2 * (levels * segment + level) * order
  of_whole = of_half + order
  for piece < count
WAY
    for i < order
      half[i] = by_start[of_half + i] * here + by_end[of_half + i] * midway
      whole[i] = by_start[of_whole + i] * here + by_end[of_whole + i] * ahead
      for j < order
        half[i] = half[i] + phi[(of_half + i) * order + j] * at[j]
        whole[i] = whole[i] + phi[(of_whole + i) * order + j] * at[j]
    came = at[0]
    slope = 0
    square = 0
    for trial < 4
      if trial == 1
        slope = total - held
      if trial == 2
        middle = total
        slope = 2 * (middle - held)
      if trial == 3
        slope = 4 * middle - 3 * held - total
        square = 2 * (held - 2 * middle + total)
      for i < order
        if trial < 2
          goes[i] = half[i] - powers[3 * (of_half + i)] * held - powers[3 * (of_half + i) + 1] * slope
        else
          goes[i] = whole[i] - powers[3 * (of_whole + i)] * held - powers[3 * (of_whole + i) + 1] * slope - powers[3 * (of_whole + i) + 2] * square
      place = goes[0]
      total = 0
FORCES
      if trial == 1
        came = place
    for i < order
      at[i] = goes[i]
    held = total
before = x
y = at[read]
";

/// An interval of a mode that is too fast to be followed in it: the forces balance and it comes behind.
const BEHIND: &str = "for i < order
  goes[i] = by_start[i] * (before - held) + by_end[i] * place
  for j < order
    goes[i] = goes[i] + phi[i * order + j] * at[j]
for i < order
  at[i] = goes[i]
held = x - place
before = x
y = at[read]
";

/// All forces: `kept` goes where `remembers` puts it.
fn all(
    forces: &[ForceLines],
    of: fn(&ForceLines) -> &str,
    [memory, remembers]: [&str; 2],
    speed: &str,
) -> String {
    let one = |(f, force): (usize, &ForceLines)| {
        let lines = of(force).replace("SPEED", speed);
        if !force.remembers {
            return format!("{lines}total = total + given\n");
        }
        let uses_memory = lines.contains("memory");
        let memory = if uses_memory { memory } else { "" }.replace('#', &f.to_string());
        let remembers = remembers.replace('#', &f.to_string());
        format!("{memory}{lines}total = total + given\n{remembers}")
    };
    forces.iter().enumerate().map(one).collect()
}

/// The place of rest from where the mass is, or where nobody knows from where it came.
fn rests(forces: &[ForceLines], from_here: bool) -> String {
    let of: fn(&ForceLines) -> &str = if from_here {
        |f| &f.held
    } else {
        |f| &f.at_rest
    };
    let (memory, keeps) = ("memory = memories[#]\n", "midways[#] = kept\n");
    let lines = RESTS.replace(
        "FORCES\n",
        &deeper(&all(forces, of, [memory, keeps], "0"), 1),
    );
    let take: String = (0..forces.len())
        .map(|f| format!("memories[{f}] = midways[{f}]\n"))
        .collect();
    lines + &take
}

/// What forces do without a mass: they balance at every sample.
pub(crate) fn resting(forces: &[ForceLines]) -> Law {
    let step = format!("{}came = place\ny = place\n", rests(forces, true));
    let settles = rests(forces, false);
    with_memories(&step, forces).begins(&format!("came = 0\n{settles}came = place\n"))
}

fn with_memories(step: &str, forces: &[ForceLines]) -> Law {
    Law::of(step)
        .state("memories", Some(forces.len()))
        .state("midways", Some(forces.len()))
        .state("came", None)
}

impl BalancedMass {
    /// What it does against forces; `speed_factor` is its natural frequency over that without added mass.
    pub(crate) fn law(&self, forces: &[ForceLines], speed_factor: f64) -> Law {
        let n = self.order;
        // Displacement, lag and filter stand where the mass rests; no rate is left.
        let at_rest: String = (0..n)
            .map(|i| match i {
                1 | 4 => format!("at[{i}] = 0\n"),
                _ => format!("at[{i}] = place\n"),
            })
            .collect();
        let step = match &self.pieces {
            Some(pieces) => in_pieces(forces, pieces),
            None => format!("came = at[0]\n{}{BEHIND}", rests(forces, true)),
        };
        let numbers = |value: fn(&Over) -> &Vec<f64>| {
            let each = self.over.iter().flat_map(value);
            each.copied().collect::<Vec<f64>>()
        };
        let settles = rests(forces, false);
        let mut law = with_memories(&step, forces)
            .count("order", n)
            .count("read", self.read)
            .value("speed_factor", speed_factor)
            .list("phi", numbers(|over| &over.phi))
            .list("by_start", numbers(|over| &over.start))
            .list("by_end", numbers(|over| &over.end))
            .list("powers", numbers(|over| &over.powers))
            .state("held", None)
            .state("before", None)
            .begins(&format!(
                "came = 0\n{settles}{at_rest}held = x - place\nbefore = x\n"
            ));
        for name in ["at", "half", "whole", "goes"] {
            law = law.state(name, Some(n));
        }
        let Some(pieces) = &self.pieces else {
            return law;
        };
        law.count("segments", pieces.fewest.len())
            .count("levels", self.over.len() / 2 / pieces.fewest.len())
            .list("fewest", pieces.fewest.clone())
            .list("fills", pieces.fills.clone())
    }
}

fn in_pieces(forces: &[ForceLines], pieces: &InPieces) -> String {
    let memory = "memory = memories[#]\nif trial > 1\n  memory = midways[#]\n";
    let keeps = "if trial == 1\n  midways[#] = kept\nif trial == 3\n  memories[#] = kept\n";
    let stiff = |(f, force): (usize, &ForceLines)| {
        let swing = "sqrt(at[0] * at[0] + at[1] * at[1])";
        let memory = format!("memories[{f}]");
        force
            .stiffening
            .replace("SWING", swing)
            .replace("memory", &memory)
    };
    let stiffening: String = forces.iter().enumerate().map(stiff).collect();
    let lines = all(
        forces,
        |f| &f.held,
        [memory, keeps],
        "(goes[1] * speed_factor)",
    );
    PIECES
        .replace("STIFFENING\n", &stiffening)
        .replace("WAY\n", &deeper(&pieces.way, 2))
        .replace("FORCES\n", &deeper(&lines, 3))
}
