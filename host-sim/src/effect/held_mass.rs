//! A mode whose moving mass is held by the bristle of a dry contact: inertia and presliding friction
//! together.
//!
//! While the bristle bends it is a spring beside the actuator's own and raises the natural frequency; an
//! interval of the recording is then walked in pieces that resolve the stiffened mode. In each the bristle is
//! held at what it is where the mass is in the mean, and what its force rises by is added: for a bristle of
//! constant stiffness that leaves an error of fourth order in the length of a piece. While it slides it holds
//! back a constant force, the mode is linear, and several pieces are one exact step: most of a recording, and
//! nearly all the time that it costs to run. A force that glides ([`super::arrival`]) glides in every piece,
//! and in a stretch of them.

use super::arrival::Arrival;
use super::friction::Bristle;
use super::mode::{ModeLaw, Motion, Propagator, Within};
use crate::elastoplastic_friction::SLIDES_WITHIN;
use crate::law::{Law, deeper};

/// Largest angle of the stiffened mode in one piece of an interval, rad.
const PIECE_RAD: f64 = 0.7;
/// Largest angle of the mode in one step where the bristle slides, rad: under a held force the motion cannot
/// turn twice in it.
const STRETCH_RAD: f64 = std::f64::consts::PI;
/// Most pieces of an interval; with more the ringing within an interval is not followed and the bristle just
/// balances.
const PIECES_MAX: f64 = 86.0;
/// Imbalance and motion per piece, in um, below which nothing more happens in an interval.
const AT_REST_UM: f64 = 1e-5;

/// A mode with a bristle at its mass.
pub(super) struct HeldMass {
    motion: Motion,
    bristle: Bristle,
    law: ModeLaw,
    arrival: Arrival,
    way: Way,
}

/// How an interval is simulated.
enum Way {
    /// The mode is too fast to be followed in it: the bristle balances and the mode comes behind.
    Balanced(Propagator),
    Pieces(Box<Pieces>),
}

/// The pieces of an interval.
struct Pieces {
    count: usize,
    piece: Propagator,
    within: Within,
    stretch: Stretch,
    enters: Enters,
}

/// How the input comes in.
enum Enters {
    /// At the beginning of the interval.
    AtOnce,
    Late(Switch),
    Gliding(Glide),
}

/// Several pieces at once, for a bristle that slides.
struct Stretch {
    pieces: usize,
    propagator: Propagator,
}

/// An input that glides from one end of an interval to the next.
struct Glide {
    /// What is left of the way to where it would come behind an interval, a piece of it and a stretch.
    left: f64,
    left_of_piece: f64,
    left_of_stretch: f64,
    /// What the end of a piece makes of the mean displacement in it, of what it would make if it came at its
    /// beginning.
    of_mean: f64,
    /// Of an input that runs straight, the part of its way in a piece and in a stretch; of a glide nothing.
    per_piece: f64,
    per_stretch: f64,
    before: f64,
}

/// Where in an interval of several pieces a late input arrives.
struct Switch {
    piece: usize,
    /// The mode over that piece.
    propagator: Propagator,
    /// What the late input makes of the mean displacement in it, of what it would make if it came at its
    /// beginning.
    of_mean: f64,
    before: f64,
}

impl HeldMass {
    /// A mode held by `bristle` over intervals of `dt_s`, in which its input arrives so; until then `at_rest`
    /// acts.
    pub(super) fn new(
        bristle: Bristle,
        law: &ModeLaw,
        dt_s: f64,
        arrival: Arrival,
        at_rest: f64,
    ) -> Self {
        Self {
            motion: Motion::default(),
            bristle,
            law: *law,
            arrival,
            way: Way::from_law(&bristle, law, dt_s, arrival, at_rest),
        }
    }

    /// What makes it, for those who compare.
    pub(super) fn values(&self) -> Vec<f64> {
        let ModeLaw {
            natural_frequency_rad_s,
            damping_ratio,
            sensor_bandwidth_hz,
            ..
        } = self.law;
        let of_mode = [
            natural_frequency_rad_s,
            damping_ratio,
            sensor_bandwidth_hz.unwrap_or(0.0),
        ];
        of_mode
            .into_iter()
            .chain(self.arrival.values())
            .chain(self.bristle.values())
            .collect()
    }

    /// One interval; what is read at its end.
    pub(super) fn step(&mut self, input: f64) -> f64 {
        let mut signal = [input];
        self.run_over(&mut signal);
        signal[0]
    }

    /// Runs over a signal, its value at the end of each interval, and leaves what is read in its place.
    pub(super) fn run_over(&mut self, signal: &mut [f64]) {
        // Copies stay in registers: nothing but the recursion itself then stands between two pieces.
        let mut motion = self.motion;
        match &mut self.way {
            Way::Balanced(propagator) => {
                for value in signal {
                    motion = propagator.after(motion, self.bristle.balance(*value));
                    *value = motion.reading;
                }
            }
            Way::Pieces(pieces) => {
                let at = (motion, self.bristle.bend());
                let lags = self.law.sensor_bandwidth_hz.is_some();
                let (end, bend) = match (&pieces.enters, lags) {
                    (Enters::AtOnce, false) => {
                        pieces.walk_over::<false, false>(&self.bristle, at, signal)
                    }
                    (Enters::AtOnce, true) => {
                        pieces.walk_over::<false, true>(&self.bristle, at, signal)
                    }
                    (Enters::Late(_), false) => {
                        pieces.walk_over::<true, false>(&self.bristle, at, signal)
                    }
                    (Enters::Late(_), true) => {
                        pieces.walk_over::<true, true>(&self.bristle, at, signal)
                    }
                    (Enters::Gliding(_), false) => {
                        pieces.glide_over::<false>(&self.bristle, at, signal)
                    }
                    (Enters::Gliding(_), true) => {
                        pieces.glide_over::<true>(&self.bristle, at, signal)
                    }
                };
                motion = end;
                self.bristle.put(motion.displacement, bend);
            }
        }
        self.motion = motion;
    }

    /// What it does.
    pub(super) fn law(&self) -> Law {
        let (states, begin, step) = match &self.way {
            Way::Balanced(propagator) => (
                "stands",
                "stands = x\n",
                format!(
                    "starts = stands\n{}ends = stands\n{}{GOES_ON}",
                    self.bristle.balance_in_lines(),
                    propagator.in_lines(),
                ),
            ),
            Way::Pieces(pieces) => {
                let lags = self.law.sensor_bandwidth_hz.is_some();
                let step = pieces.in_lines(&self.bristle, lags);
                ("before", "before = x\n", step)
            }
        };
        let law = Law::of(&format!("{step}y = reading\n"));
        ["place", "speed", "reading", "bend", states]
            .into_iter()
            .fold(law, |law, name| law.state(name, None))
            .begins(&format!("place = x\nreading = x\n{begin}"))
    }

    /// At rest under a constant input.
    pub(super) fn settle(&mut self, input: f64) {
        self.motion = Motion::settled(input);
        self.bristle.relax(input);
        if let Way::Pieces(pieces) = &mut self.way {
            match &mut pieces.enters {
                Enters::AtOnce => {}
                Enters::Late(switch) => switch.before = input,
                Enters::Gliding(glide) => glide.before = input,
            }
        }
    }
}

impl Way {
    fn from_law(
        bristle: &Bristle,
        law: &ModeLaw,
        dt_s: f64,
        arrival: Arrival,
        at_rest: f64,
    ) -> Self {
        let angle = law.natural_frequency_rad_s * dt_s;
        // A mode that is damped so much that it creeps back does that the more slowly the more it is damped.
        let stiffening = bristle.stiffening();
        let stiffened = angle * stiffening * (stiffening / (2.0 * law.damping_ratio)).min(1.0);
        if stiffened / PIECE_RAD > PIECES_MAX {
            return Self::Balanced(law.over(dt_s, arrival));
        }
        let stretches = (angle / STRETCH_RAD).ceil().max(1.0);
        let of_a_stretch = (stiffened / PIECE_RAD / stretches).ceil().max(1.0);
        let (count, in_one) = (stretches * of_a_stretch, of_a_stretch as usize);
        let (piece_s, stretch_s) = (dt_s / count, dt_s / stretches);
        let enters = match arrival {
            Arrival::Late(share) if share > 0.0 => {
                Enters::Late(Switch::from_law(law, piece_s, share * count, at_rest))
            }
            Arrival::Late(_) => Enters::AtOnce,
            Arrival::Gliding(_) | Arrival::Straight => Enters::Gliding(Glide {
                left: arrival.left_after(dt_s),
                left_of_piece: arrival.left_after(piece_s),
                left_of_stretch: arrival.left_after(stretch_s),
                of_mean: law.share_in_mean(piece_s, arrival),
                per_piece: if arrival == Arrival::Straight {
                    1.0 / count
                } else {
                    0.0
                },
                per_stretch: if arrival == Arrival::Straight {
                    1.0 / stretches
                } else {
                    0.0
                },
                before: at_rest,
            }),
        };
        // A late input changes in one piece only, one that glides in all.
        let in_each = if matches!(arrival, Arrival::Gliding(_) | Arrival::Straight) {
            arrival
        } else {
            Arrival::Late(0.0)
        };
        let stretch = Stretch {
            pieces: in_one,
            propagator: law.over(stretch_s, in_each),
        };
        let (piece, within) = (law.over(piece_s, in_each), law.within(piece_s));
        Self::Pieces(Box::new(Pieces {
            count: count as usize,
            piece,
            within,
            stretch,
            enters,
        }))
    }
}

/// The end of a way becomes where the mode is.
const GOES_ON: &str = "place = next_place\nspeed = next_speed\nreading = next_reading\n";

impl Switch {
    fn from_law(law: &ModeLaw, piece_s: f64, late_pieces: f64, at_rest: f64) -> Self {
        let arrival = Arrival::Late(late_pieces.fract());
        Self {
            piece: late_pieces as usize,
            propagator: law.over(piece_s, arrival),
            of_mean: law.share_in_mean(piece_s, arrival),
            before: at_rest,
        }
    }
}

impl Pieces {
    /// Carries a mode and the bend of a bristle over a signal, and leaves what is read in its place; whether
    /// the input is late, and whether a sensor lags behind, is known beforehand, so that what they ask for
    /// stands in no other's way.
    fn walk_over<const LATE: bool, const LAGS: bool>(
        &mut self,
        bristle: &Bristle,
        (mut motion, mut bend): (Motion, f64),
        signal: &mut [f64],
    ) -> (Motion, f64) {
        for value in signal {
            (motion, bend) = self.walk::<LATE, LAGS>(bristle, motion, bend, *value);
            *value = motion.reading;
        }
        (motion, bend)
    }

    /// Carries a mode and the bend of a bristle over one interval.
    #[inline]
    fn walk<const LATE: bool, const LAGS: bool>(
        &mut self,
        bristle: &Bristle,
        mut motion: Motion,
        mut bend: f64,
        input: f64,
    ) -> (Motion, f64) {
        let late = if let (Enters::Late(switch), true) = (&self.enters, LATE) {
            Some(switch)
        } else {
            None
        };
        let (arrives_in, before) = late.map_or((0, input), |switch| (switch.piece, switch.before));
        let mut piece = 0;
        while piece < self.count {
            let force = match late {
                Some(_) if piece < arrives_in => before,
                Some(switch) if piece == arrives_in => before + switch.of_mean * (input - before),
                _ => input,
            };
            let nothing_to_come = !LATE || piece > arrives_in || before == input;
            let ahead = self.piece.motion_ahead(motion);
            let held_before = bristle.held_at(bend);
            let stretch = &self.stretch;
            if piece + stretch.pieces
                <= if nothing_to_come {
                    self.count
                } else {
                    arrives_in
                }
                && bristle.slides(bend, ahead)
            {
                let onward = stretch
                    .propagator
                    .after_as::<false, LAGS>(motion, force - held_before);
                // It slides to the end where the motion has not turned.
                if stretch.propagator.motion_ahead(onward) * ahead > 0.0 {
                    bend = bristle.bend_in_sliding(ahead);
                    motion = onward;
                    piece += stretch.pieces;
                    continue;
                }
            }
            // The bristle where the mass is in the mean of the piece, and its rise over the piece.
            let mean = self.within.mean_displacement(motion, force - held_before);
            let held = bristle.held_at(bristle.bend_after(bend, mean - motion.displacement));
            if nothing_to_come
                && ahead.abs() < AT_REST_UM
                && (force - held - motion.displacement).abs() < AT_REST_UM
            {
                motion = self.piece.after_rest(motion, self.count - piece);
                break;
            }
            let onward = match late {
                Some(switch) if piece == arrives_in => switch
                    .propagator
                    .after_as::<true, LAGS>(motion.with_input_before(before - held), input - held),
                _ => self.piece.after_as::<false, LAGS>(motion, force - held),
            };
            let onward = self.within.risen::<LAGS>(onward, held_before - held);
            bend = bristle.bend_after(bend, onward.displacement - motion.displacement);
            motion = onward;
            piece += 1;
        }
        if let (Enters::Late(switch), true) = (&mut self.enters, LATE) {
            switch.before = input;
        }
        (motion, bend)
    }

    /// As [`Self::walk_over`], of an input that glides.
    fn glide_over<const LAGS: bool>(
        &mut self,
        bristle: &Bristle,
        (mut motion, mut bend): (Motion, f64),
        signal: &mut [f64],
    ) -> (Motion, f64) {
        let Enters::Gliding(glide) = &self.enters else {
            return (motion, bend);
        };
        let mut before = glide.before;
        for value in signal {
            (motion, bend) = self.glide::<LAGS>(glide, bristle, (motion, bend), before, *value);
            before = *value;
            *value = motion.reading;
        }
        if let Enters::Gliding(glide) = &mut self.enters {
            glide.before = before;
        }
        (motion, bend)
    }

    /// Carries a mode and the bend of a bristle over one interval in which the input glides from one value to
    /// another.
    #[inline]
    fn glide<const LAGS: bool>(
        &self,
        glide: &Glide,
        bristle: &Bristle,
        (mut motion, mut bend): (Motion, f64),
        before: f64,
        input: f64,
    ) -> (Motion, f64) {
        // Where it would come, or by how much it rises in all, and what it is at the beginning of the next
        // piece.
        let straight = glide.per_piece > 0.0;
        let (aim, rise) = if straight {
            (0.0, input - before)
        } else {
            ((input - glide.left * before) / (1.0 - glide.left), 0.0)
        };
        let mut force = before;
        let mut piece = 0;
        while piece < self.count {
            let ahead = self.piece.motion_ahead(motion);
            let held_before = bristle.held_at(bend);
            let stretch = &self.stretch;
            if piece + stretch.pieces <= self.count && bristle.slides(bend, ahead) {
                let force_after =
                    aim + glide.left_of_stretch * (force - aim) + glide.per_stretch * rise;
                let begun = motion.with_input_before(force - held_before);
                let onward = stretch
                    .propagator
                    .after_as::<true, LAGS>(begun, force_after - held_before);
                // A force that comes may turn a motion back that had turned before, which then shows where
                // the force had not come.
                let uncome = stretch
                    .propagator
                    .after_as::<true, false>(begun, force - held_before);
                let turned = [onward, uncome]
                    .into_iter()
                    .any(|end| stretch.propagator.motion_ahead(end) * ahead <= 0.0);
                if !turned {
                    bend = bristle.bend_in_sliding(ahead);
                    (motion, force) = (onward, force_after);
                    piece += stretch.pieces;
                    continue;
                }
            }
            let force_after = aim + glide.left_of_piece * (force - aim) + glide.per_piece * rise;
            let in_the_mean = force + glide.of_mean * (force_after - force);
            let mean = self
                .within
                .mean_displacement(motion, in_the_mean - held_before);
            let held = bristle.held_at(bristle.bend_after(bend, mean - motion.displacement));
            let nothing_to_come = (input - force).abs() < AT_REST_UM;
            if nothing_to_come
                && ahead.abs() < AT_REST_UM
                && (force - held - motion.displacement).abs() < AT_REST_UM
            {
                motion = self.piece.after_rest(motion, self.count - piece);
                break;
            }
            let onward = self
                .piece
                .after_as::<true, LAGS>(motion.with_input_before(force - held), force_after - held);
            let onward = self.within.risen::<LAGS>(onward, held_before - held);
            bend = bristle.bend_after(bend, onward.displacement - motion.displacement);
            (motion, force) = (onward, force_after);
            piece += 1;
        }
        (motion, bend)
    }
}

impl Pieces {
    /// [`Self::walk`] and [`Self::glide`] as [`crate::law`] writes: a drive that steps glides from where it is to
    /// where it is.
    fn in_lines(&self, bristle: &Bristle, lags: bool) -> String {
        let (count, pieces) = (self.count, self.stretch.pieces);
        let stiffness = bristle.stiffness();
        let slides = bristle.bend_in_sliding(1.0);
        let within = SLIDES_WITHIN * slides;
        let stretch = &self.stretch.propagator;
        let [begins, enters, of_piece, of_stretch] = self.enters.in_lines(count);
        // A force that comes may turn a motion back that had turned before.
        let uncome = match &self.enters {
            Enters::Gliding(_) => format!(
                "ends = starts\n{}turns = min(turns, uncome * ahead)\n",
                stretch.speed_in_lines("uncome")
            ),
            _ => String::new(),
        };
        let mut goes = self.piece.in_lines();
        if let Enters::Late(switch) = &self.enters {
            let late = deeper(&switch.propagator.in_lines(), 1);
            goes += &format!("if piece == {}\n{late}", switch.piece);
        }
        goes += &self.within.risen_in_lines("(held - holds)", lags);
        goes += &bristle.bend_in_lines("bend", "(next_place - place)", "bend");
        let midway = bristle.bend_in_lines("bend", "(mean - place)", "midway");
        let rests = self
            .piece
            .after_rest_in_lines(&format!("({count} - piece)"));
        format!(
            "{begins}piece = 0
while piece < {count}
{enters}  ahead = {angle:e} * speed
  held = {stiffness:e} * bend
  slid = 0
  side = 1
  if ahead < 0
    side = -1
  if piece + {pieces} <= limit && abs({slides:e} - side * bend) <= {within:e}
{of_stretch}    starts = drive - held
    ends = comes - held
{through}    turns = next_speed * ahead
{uncome}    if turns > 0
      bend = side * {slides:e}
{goes_on}      drive = comes
      piece = piece + {pieces}
      slid = 1
  if slid == 0
{of_piece}    mean = {mean}
{midway}    holds = {stiffness:e} * midway
    if settled > 0 && abs(ahead) < {AT_REST_UM:e} && abs(drive - holds - place) < {AT_REST_UM:e}
{rests}      piece = {count}
    else
      starts = drive - holds
      ends = comes - holds
{goes}{goes_on}      drive = comes
      piece = piece + 1
before = x
",
            enters = deeper(&enters, 1),
            angle = self.piece.angle_rad(),
            of_stretch = deeper(&of_stretch, 2),
            through = deeper(&stretch.in_lines(), 2),
            uncome = deeper(&uncome, 2),
            goes_on = deeper(GOES_ON, 3),
            of_piece = deeper(&of_piece, 2),
            mean = self.within.mean_in_lines("in_the_mean - held"),
            midway = deeper(&midway, 2),
            rests = deeper(&rests, 3),
            goes = deeper(&goes, 3),
        )
    }
}

impl Enters {
    /// What [`Pieces::in_lines`] has at the beginning of an interval and of a piece, and where the drive comes to
    /// in a piece and in a stretch of them.
    fn in_lines(&self, count: usize) -> [String; 4] {
        let steps = |place: &str| {
            format!(
                "limit = {count}\nsettled = 1\ndrive = {place}\ncomes = {place}\nin_the_mean = {place}\n"
            )
        };
        match self {
            Self::AtOnce => [steps("x"), String::new(), String::new(), String::new()],
            Self::Late(switch) => {
                let (arrives, of_mean) = (switch.piece, switch.of_mean);
                let late = format!(
                    "{}if before != x && piece <= {arrives}
  settled = 0
  limit = {arrives}
  drive = before
  comes = before
  in_the_mean = before
  if piece == {arrives}
    comes = x
    in_the_mean = before + {of_mean:e} * (x - before)
",
                    steps("x")
                );
                [String::new(), late, String::new(), String::new()]
            }
            Self::Gliding(glide) => {
                let (aim, comes): (_, fn(f64, f64) -> String) = if glide.per_piece > 0.0 {
                    ("rise = x - before\n".to_owned(), |_, way| {
                        format!("comes = drive + {way:e} * rise\n")
                    })
                } else {
                    let left = glide.left;
                    let aim = format!("aim = (x - {left:e} * before) / {:e}\n", 1.0 - left);
                    (aim, |left, _| {
                        format!("comes = aim + {left:e} * (drive - aim)\n")
                    })
                };
                let in_the_mean = format!(
                    "in_the_mean = drive + {:e} * (comes - drive)\n",
                    glide.of_mean
                );
                [
                    format!("drive = before\n{aim}limit = {count}\n"),
                    format!("settled = 0\nif abs(x - drive) < {AT_REST_UM:e}\n  settled = 1\n"),
                    comes(glide.left_of_piece, glide.per_piece) + &in_the_mean,
                    comes(glide.left_of_stretch, glide.per_stretch),
                ]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elastoplastic_friction::ElastoplasticFriction;
    use std::f64::consts::TAU;

    const DT_S: f64 = 1e-4;

    /// Drives of 34 um: a slow sine, a triangle of 50 Hz, a sum of sines with jumps.
    fn drive(kind: usize, t_s: f64) -> f64 {
        match kind {
            0 => 17.0 * (1.0 - (TAU * 20.0 * t_s).cos()),
            1 => 68.0 * (0.5 - ((t_s * 50.0).fract() - 0.5).abs()),
            _ => {
                5.0 * (TAU * 97.0 * t_s).sin()
                    + 6.0 * (TAU * 31.0 * t_s).sin()
                    + if (t_s / 0.03).fract() < 0.5 { 3.0 } else { 0.0 }
            }
        }
    }

    /// Mass and bristle by a Runge-Kutta method of fourth order: mode, and `dz = (1 - z sgn(v) / z_s) dx`
    /// at its mass; where the force follows the drive with a time constant, that as well.
    fn integrated(
        law: &ModeLaw,
        contact: &ElastoplasticFriction,
        gliding_s: Option<f64>,
        kind: usize,
        samples: usize,
    ) -> Vec<f64> {
        let (w, xi) = (law.natural_frequency_rad_s, law.damping_ratio);
        let (k, sliding_bend) = (contact.stiffness_n_um, contact.sliding_bend_um());
        let steps = (w * (1.0 + k).sqrt() * DT_S / 0.02).ceil() as usize;
        let h = DT_S / steps as f64;
        let mut state = [0.0_f64; 4];
        let mut out = Vec::with_capacity(samples);
        for sample in 0..samples {
            let driven = drive(kind, sample as f64 * DT_S);
            if gliding_s.is_none() {
                state[3] = driven;
            }
            let rate = |[x, v, z, force]: [f64; 4]| {
                let follows =
                    gliding_s.map_or(0.0, |time_constant_s| (driven - force) / time_constant_s);
                [
                    v,
                    w * w * (force - x - k * z) - 2.0 * xi * w * v,
                    v - v.abs() * z / sliding_bend,
                    follows,
                ]
            };
            let along = |s: [f64; 4], d: [f64; 4], t: f64| std::array::from_fn(|i| s[i] + t * d[i]);
            for _ in 0..steps {
                // A bristle that is short against the way of a step is simulated in shorter steps.
                let parts = (state[1].abs() * h / (0.2 * sliding_bend))
                    .ceil()
                    .clamp(1.0, 200.0);
                let h = h / parts;
                for _ in 0..parts as usize {
                    let a = rate(state);
                    let b = rate(along(state, a, 0.5 * h));
                    let c = rate(along(state, b, 0.5 * h));
                    let d = rate(along(state, c, h));
                    for i in 0..4 {
                        state[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
                    }
                }
            }
            out.push(state[0]);
        }
        out
    }

    #[test]
    fn follows_a_finer_integration_of_the_same_equations() {
        let samples = 1000;
        for (natural_frequency_hz, damping_ratio) in [
            (735.0, 0.014),
            (735.0, 0.3),
            (2300.0, 0.1),
            (2300.0, 0.7),
            (4900.0, 0.02),
            (4900.0, 2.0),
        ] {
            for (coulomb_force_n, stiffness_n_um) in [
                (0.05, 0.3),
                (0.2, 1.0),
                (0.1, 12.0),
                (0.4, 50.0),
                (0.02, 50.0),
            ] {
                let law = ModeLaw {
                    natural_frequency_rad_s: TAU * natural_frequency_hz,
                    damping_ratio,
                    sensor_bandwidth_hz: None,
                    sensor_filter: None,
                };
                let contact = ElastoplasticFriction {
                    stiffness_n_um,
                    damping_n_s_um: 0.0,
                    coulomb_force_n,
                    breakaway_ratio: None,
                };
                for gliding_s in [None, Some(1.0 / (TAU * 800.0)), Some(1.0 / (TAU * 5000.0))] {
                    let arrival = gliding_s.map_or(Arrival::Late(0.0), Arrival::Gliding);
                    let (mut sum, mut count) = (0.0, 0);
                    for kind in 0..3 {
                        let mut held =
                            HeldMass::new(Bristle::with(contact), &law, DT_S, arrival, 0.0);
                        let mut force = 0.0;
                        for (sample, expected) in
                            integrated(&law, &contact, gliding_s, kind, samples)
                                .iter()
                                .enumerate()
                        {
                            let driven = drive(kind, sample as f64 * DT_S);
                            force = driven + arrival.left_after(DT_S) * (force - driven);
                            sum += (held.step(force) - expected).powi(2);
                            count += 1;
                        }
                    }
                    let rms_nm = 1e3 * (sum / f64::from(count)).sqrt();
                    // A mode that hardly loses anything rings on with the phase that it has got.
                    let most_nm = if damping_ratio < 0.1 { 10.0 } else { 1.5 };
                    assert!(
                        rms_nm < most_nm,
                        "{law:?}, {contact:?}, {gliding_s:?}: {rms_nm:.3} nm"
                    );
                }
            }
        }
    }
}
