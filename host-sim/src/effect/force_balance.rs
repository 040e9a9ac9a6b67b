//! The force balance of the moving mass: what it works against beside a straight spring and a viscous damper.
//!
//! The mode is `x'' / w^2 + 2 xi x' / w + x + N = f`, with every force as the displacement that it would make
//! at rest. What an effect adds to `N` is a [`RestoringForce`]; the vibration stage takes in all that a model
//! has. The straight part of the mode is exact however long an interval is, and so is what the drive makes of
//! it; `N` is followed in pieces of the interval, as a parabola through its beginning, middle and end, found
//! in three trials (an exponential Runge-Kutta method after Cox and Matthews, J. Comput. Phys. 176 (2002)
//! 430-455, with the nodes of Simpson's rule). A mode of which `N` is nothing is therefore the free mode, to
//! the last digits, and what a small force does is not hidden by the error of the steps.

use super::arrival::{Arrival, Over};
use super::mode::ModeLaw;
use crate::balance_law::{self, ForceLines, InPieces};
use crate::block::Block;
use crate::law::Law;
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use std::cell::Cell;

/// The forces of a model, in the order of its effects, and the friction of its guide among them; empty where
/// friction is the only force.
pub(super) fn forces_of(model: &Model, setting: &Setting) -> Vec<Box<dyn RestoringForce>> {
    let mut forces: Vec<Box<dyn RestoringForce>> = model
        .effects
        .iter()
        .filter_map(|e| e.restoring_force(model, setting))
        .collect();
    if let (false, Some(bristle)) = (
        forces.is_empty(),
        super::friction::Bristle::from_model(model),
    ) {
        forces.push(Box::new(bristle));
    }
    forces
}

/// Largest angle of the stiffened mode in one piece of an interval, rad.
const PIECE_RAD: f64 = 0.5;
/// Angle of the mode in one interval beyond which its ringing is not followed: it is above half the sampling
/// rate, so that no reading shows it. There the forces balance and the mode comes behind.
const RINGING_MAX_RAD: f64 = std::f64::consts::PI;
/// Pieces that take as long as to find where forces balance: 0.65 us, and 78 ns a piece (`perf report` of an
/// `explain` that tries `hysteretic_stiffness`).
const BALANCED_PIECES: u64 = 8;

thread_local! {
    static FOLLOWED: Cell<u64> = const { Cell::new(0) };
}

/// Pieces that a mass was followed in by this thread so far, whichever simulation asked for them: what forces
/// cost is known once they were simulated.
#[must_use]
pub fn pieces_followed() -> u64 {
    FOLLOWED.get()
}

fn followed(pieces: u64) {
    FOLLOWED.set(FOLLOWED.get().wrapping_add(pieces));
}

/// How often the pieces are halved where the mode is stiffer.
const HALVINGS_MAX: usize = 5;

/// What is held back at one place, and what is remembered of it.
struct Balance {
    forces: Vec<Box<dyn RestoringForce>>,
    memories: Vec<f64>,
    /// Memories half way, on trial.
    midway: Vec<f64>,
    /// Velocity over the natural frequency of the mode without added mass, of that over its own.
    speed_factor: f64,
}

impl Balance {
    fn new(forces: Vec<Box<dyn RestoringForce>>, speed_factor: f64) -> Self {
        let memories = vec![0.0; forces.len()];
        Self {
            midway: memories.clone(),
            memories,
            forces,
            speed_factor,
        }
    }

    fn way(&self, from_um: f64, [to_um, velocity]: [f64; 2]) -> Travel {
        Travel {
            from_um,
            to_um,
            speed_um: velocity * self.speed_factor,
        }
    }

    /// The sum of the forces on trial, from where the memories are.
    #[inline]
    fn tried(&self, from_um: f64, to: [f64; 2]) -> f64 {
        let way = self.way(from_um, to);
        self.forces
            .iter()
            .zip(&self.memories)
            .map(|(force, memory)| force.held(*memory, way).0)
            .sum()
    }

    /// The sum of the forces half way: what is remembered there is kept.
    fn tried_midway(&mut self, from_um: f64, to: [f64; 2]) -> f64 {
        let way = self.way(from_um, to);
        let mut sum = 0.0;
        for ((force, memory), midway) in
            self.forces.iter().zip(&self.memories).zip(&mut self.midway)
        {
            let (held, remembered) = force.held(*memory, way);
            sum += held;
            *midway = remembered;
        }
        sum
    }

    /// The sum of the forces from half way on.
    fn tried_from_midway(&self, from_um: f64, to: [f64; 2]) -> f64 {
        let way = self.way(from_um, to);
        self.forces
            .iter()
            .zip(&self.midway)
            .map(|(force, memory)| force.held(*memory, way).0)
            .sum()
    }

    /// The way from half way on is gone.
    fn go_from_midway(&mut self, from_um: f64, to: [f64; 2]) -> f64 {
        let way = self.way(from_um, to);
        let mut sum = 0.0;
        for ((force, memory), midway) in
            self.forces.iter().zip(&mut self.memories).zip(&self.midway)
        {
            let (held, remembered) = force.held(*midway, way);
            sum += held;
            *memory = remembered;
        }
        sum
    }

    fn lines(&self) -> Vec<ForceLines> {
        self.forces.iter().map(|force| force.lines()).collect()
    }

    fn stiffening(&self, swing_um: f64) -> f64 {
        self.forces
            .iter()
            .zip(&self.memories)
            .map(|(force, memory)| force.stiffening(*memory, swing_um))
            .sum()
    }

    /// The place where a constant force and all others balance, from where the memories are, which then are
    /// there.
    fn rest(&mut self, from_um: f64, force_um: f64) -> f64 {
        followed(BALANCED_PIECES);
        let place_um = balanced(force_um, |at_um| self.tried(from_um, [at_um, 0.0]));
        self.tried_midway(from_um, [place_um, 0.0]);
        self.memories.copy_from_slice(&self.midway);
        place_um
    }

    /// The place where a constant force and all others balance where nobody knows from where the mass came.
    fn settle(&mut self, force_um: f64) -> f64 {
        let forces = &self.forces;
        let place_um = balanced(force_um, |at_um| {
            forces.iter().map(|force| force.at_rest(at_um).0).sum()
        });
        for (force, memory) in forces.iter().zip(&mut self.memories) {
            *memory = force.at_rest(place_um).1;
        }
        place_um
    }
}

/// Where a straight spring and what is held back beside it balance a force, um: both rise with the
/// displacement.
fn balanced(force_um: f64, held: impl Fn(f64) -> f64) -> f64 {
    let excess = |at_um: f64| at_um + held(at_um) - force_um;
    // From where a straight spring would be, outward until it is between two places.
    let mut reach_um = excess(force_um).abs().max(f64::MIN_POSITIVE);
    let (mut low, mut high) = (force_um - reach_um, force_um + reach_um);
    for _ in 0..RESTING_STEPS {
        if excess(low) <= 0.0 && excess(high) >= 0.0 {
            break;
        }
        reach_um *= 2.0;
        (low, high) = (force_um - reach_um, force_um + reach_um);
    }
    // By the chord; an end that stays twice counts half from then on (the Illinois form of the false
    // position: Dowell and Jarratt, BIT 11 (1971) 168-174).
    let (mut below, mut above) = (excess(low), excess(high));
    let (mut at_um, mut stayed) = (force_um, None);
    for _ in 0..RESTING_STEPS {
        let share = if above > below {
            (-below / (above - below)).clamp(0.0, 1.0)
        } else {
            0.5
        };
        at_um = low + share * (high - low);
        let left = excess(at_um);
        if left == 0.0
            || high - low <= f64::EPSILON * at_um.abs()
            || left.abs() <= f64::EPSILON * force_um.abs()
        {
            break;
        }
        if left < 0.0 {
            (low, below) = (at_um, left);
            above = if stayed == Some(End::High) {
                0.5 * above
            } else {
                above
            };
            stayed = Some(End::High);
        } else {
            (high, above) = (at_um, left);
            below = if stayed == Some(End::Low) {
                0.5 * below
            } else {
                below
            };
            stayed = Some(End::Low);
        }
    }
    at_um
}

/// The end of a bracket that stayed.
#[derive(PartialEq)]
enum End {
    Low,
    High,
}

/// Steps towards a place of rest, at most: halves alone reach the last digit in as many.
const RESTING_STEPS: usize = 120;

/// Transition of `N` states over a piece and over half of it; what the drive adds, by where it is at the
/// beginning and at the end; and what a force adds that is a parabola over the piece, by its powers.
struct Piece<const N: usize> {
    half: Transition<N>,
    whole: Transition<N>,
}

impl<const N: usize> Piece<N> {
    fn over(system: &ContinuousSystem, piece_s: f64, arrival: Arrival) -> Self {
        let over = |dt_s: f64| Transition::over_interval(system, dt_s, arrival);
        Self {
            half: over(0.5 * piece_s),
            whole: over(piece_s),
        }
    }
}

struct Transition<const N: usize> {
    phi: [[f64; N]; N],
    start: [f64; N],
    end: [f64; N],
    powers: [[f64; N]; 3],
}

impl<const N: usize> Transition<N> {
    fn over_interval(system: &ContinuousSystem, dt_s: f64, arrival: Arrival) -> Self {
        let Over { phi, start, end } = arrival.over(system, dt_s);
        let (_, powers) = system.quadratic_matrices(dt_s);
        Self {
            phi: std::array::from_fn(|i| std::array::from_fn(|j| phi[(i, j)])),
            start: std::array::from_fn(|i| start[i]),
            end: std::array::from_fn(|i| end[i]),
            powers: powers.map(|power| std::array::from_fn(|i| power[i])),
        }
    }

    fn as_numbers(&self) -> balance_law::Over {
        let powers = (0..N).flat_map(|i| [0, 1, 2].map(|p| self.powers[p][i]));
        balance_law::Over {
            phi: self.phi.as_flattened().to_vec(),
            start: self.start.to_vec(),
            end: self.end.to_vec(),
            powers: powers.collect(),
        }
    }

    /// Where a state goes under the drive alone.
    #[inline]
    fn driven(&self, state: &[f64; N], from: f64, to: f64) -> [f64; N] {
        std::array::from_fn(|i| {
            let own: f64 = self.phi[i].iter().zip(state).map(|(p, x)| p * x).sum();
            own + self.start[i] * from + self.end[i] * to
        })
    }

    /// Displacement and velocity of a state that is also held back so.
    #[inline]
    fn held_back(&self, driven: &[f64; N], held: [f64; 3]) -> [f64; 2] {
        std::array::from_fn(|i| driven[i] - self.by(i, held))
    }

    #[inline]
    fn by(&self, i: usize, [constant, slope, square]: [f64; 3]) -> f64 {
        self.powers[0][i] * constant + self.powers[1][i] * slope + self.powers[2][i] * square
    }
}

/// Part of an interval in which the drive goes one way.
struct Segment<const N: usize> {
    length_s: f64,
    arrival: Arrival,
    /// Pieces of the mode without forces, at least one, and how often the mode fills one of them.
    fewest: f64,
    filled: f64,
    /// By how often the pieces were halved; made when they are asked for.
    levels: Vec<Option<(usize, Box<Piece<N>>)>>,
}

/// A mode whose mass works against forces beside its straight spring.
struct Balanced<const N: usize> {
    system: ContinuousSystem,
    /// The state that is read.
    read: usize,
    segments: Vec<Segment<N>>,
    arrival: Arrival,
    dt_s: f64,
    /// The whole interval where the mode is too fast to be followed in it.
    behind: Option<Transition<N>>,
    balance: Balance,
    state: [f64; N],
    held: f64,
    before: f64,
}

impl<const N: usize> Balanced<N> {
    fn new(
        law: &ModeLaw,
        (system, read): (ContinuousSystem, usize),
        dt_s: f64,
        arrival: Arrival,
        balance: Balance,
    ) -> Self {
        let segment = |length_s: f64, arrival: Arrival| {
            let pieces = law.natural_frequency_rad_s * length_s / PIECE_RAD;
            let fewest = pieces.ceil().max(1.0);
            Segment {
                length_s,
                arrival,
                fewest,
                filled: pieces / fewest,
                levels: (0..=HALVINGS_MAX).map(|_| None).collect(),
            }
        };
        let segments = match arrival {
            Arrival::Late(share) if share > 0.0 => {
                vec![
                    segment(share * dt_s, Arrival::Late(0.0)),
                    segment((1.0 - share) * dt_s, Arrival::Late(0.0)),
                ]
            }
            other => vec![segment(dt_s, other)],
        };
        let too_fast = law.natural_frequency_rad_s * dt_s > RINGING_MAX_RAD;
        Self {
            behind: too_fast.then(|| Transition::over_interval(&system, dt_s, arrival)),
            system,
            read,
            segments,
            arrival,
            dt_s,
            balance,
            state: [0.0; N],
            held: 0.0,
            before: 0.0,
        }
    }

    fn step_on(&mut self, input: f64) -> f64 {
        let before = std::mem::replace(&mut self.before, input);
        if let Some(transition) = &self.behind {
            let rest_um = self.balance.rest(self.state[0], input);
            self.state = transition.driven(&self.state, before - self.held, rest_um);
            self.held = input - rest_um;
            return self.state[self.read];
        }
        let swing_um = (self.state[0] * self.state[0] + self.state[1] * self.state[1]).sqrt();
        let stiffened = (1.0 + self.balance.stiffening(swing_um)).max(1.0).sqrt();
        for at in 0..self.segments.len() {
            // A late drive steps between the two segments.
            let late = self.segments.len() > 1;
            let (from, to) = if late && at == 0 {
                (before, before)
            } else if late {
                (input, input)
            } else {
                (before, input)
            };
            self.walk(at, stiffened, from, to);
        }
        self.state[self.read]
    }

    /// Carries the mode over a segment.
    fn walk(&mut self, at: usize, stiffened: f64, from: f64, to: f64) {
        let Self {
            system,
            segments,
            balance,
            state,
            held,
            dt_s,
            arrival,
            ..
        } = self;
        let segment = &mut segments[at];
        let fewest = segment.fewest;
        let filled = stiffened * segment.filled;
        let halvings = if filled <= 1.0 {
            0
        } else {
            (filled.log2().ceil() as usize).min(HALVINGS_MAX)
        };
        let (length_s, way) = (segment.length_s, segment.arrival);
        let (count, piece) = &*segment.levels[halvings].get_or_insert_with(|| {
            let count = fewest * f64::from(1_u32 << halvings);
            let piece = Piece::over(system, length_s / count, way);
            (count as usize, Box::new(piece))
        });
        followed(*count as u64);
        // Where a glide would come to; a straight way goes on by steps.
        let left = match segment.arrival {
            Arrival::Gliding(_) => arrival.left_after(*dt_s),
            _ => 0.0,
        };
        let half_s = 0.5 * segment.length_s / *count as f64;
        let along = |half: usize| match segment.arrival {
            Arrival::Late(_) => to,
            Arrival::Straight => from + (to - from) * half as f64 / (2 * count) as f64,
            Arrival::Gliding(_) => {
                let aim = (to - left * from) / (1.0 - left);
                aim + (from - aim) * segment.arrival.left_after(half as f64 * half_s)
            }
        };
        let mut here = along(0);
        for k in 0..*count {
            let (midway, ahead) = (along(2 * k + 1), along(2 * k + 2));
            let x = state[0];
            let driven_half = piece.half.driven(state, here, midway);
            let driven = piece.whole.driven(state, here, ahead);
            let first = balance.tried(x, piece.half.held_back(&driven_half, [*held, 0.0, 0.0]));
            let at_half = piece
                .half
                .held_back(&driven_half, [*held, first - *held, 0.0]);
            let in_the_middle = balance.tried_midway(x, at_half);
            let onward = piece
                .whole
                .held_back(&driven, [*held, 2.0 * (in_the_middle - *held), 0.0]);
            let last = balance.tried_from_midway(at_half[0], onward);
            let parabola = [
                *held,
                4.0 * in_the_middle - 3.0 * *held - last,
                2.0 * (*held - 2.0 * in_the_middle + last),
            ];
            *state = std::array::from_fn(|i| driven[i] - piece.whole.by(i, parabola));
            *held = balance.go_from_midway(at_half[0], [state[0], state[1]]);
            here = ahead;
        }
    }

    /// Half a piece and a piece of every segment, by how often the pieces are halved.
    fn over_in_numbers(&self) -> Vec<balance_law::Over> {
        let mut out = Vec::new();
        for segment in &self.segments {
            for halvings in 0..=HALVINGS_MAX {
                let count = segment.fewest * f64::from(1_u32 << halvings);
                let piece_s = segment.length_s / count;
                let piece = Piece::<N>::over(&self.system, piece_s, segment.arrival);
                out.extend([piece.half.as_numbers(), piece.whole.as_numbers()]);
            }
        }
        out
    }

    /// Where the drive is in a piece, as [`crate::law`] writes.
    fn way_in_lines(&self) -> String {
        let places = [
            ("here", "piece"),
            ("midway", "(piece + 0.5)"),
            ("ahead", "(piece + 1)"),
        ];
        match self.arrival {
            Arrival::Late(_) => {
                let late = if self.segments.len() > 1 {
                    "if segment == 0\n  here = before\n"
                } else {
                    ""
                };
                format!("here = x\n{late}midway = here\nahead = here\n")
            }
            Arrival::Straight => places
                .map(|(name, at)| format!("{name} = before + (x - before) * {at} / count\n"))
                .concat(),
            Arrival::Gliding(time_constant_s) => {
                let left = self.arrival.left_after(self.dt_s);
                let angle = self.dt_s / time_constant_s;
                let aim = format!("aim = (x - {left:e} * before) / {:e}\n", 1.0 - left);
                let glides = places.map(|(name, at)| {
                    format!("{name} = aim + (before - aim) * exp(-{angle:e} * {at} / count)\n")
                });
                aim + &glides.concat()
            }
        }
    }
}

/// The first mode of a model with forces that its mass works against.
pub(super) struct BalancedMass(Box<dyn Mass>);

/// [`Balanced`] of any number of states.
trait Mass: Send {
    fn run_over(&mut self, signal: &mut [f64]);
    fn settle_at(&mut self, input: f64) -> f64;
    fn law(&self) -> Law;
}

impl<const N: usize> Mass for Balanced<N> {
    fn run_over(&mut self, signal: &mut [f64]) {
        signal
            .iter_mut()
            .for_each(|value| *value = self.step_on(*value));
    }
    fn law(&self) -> Law {
        let pieces = self.behind.is_none().then(|| InPieces {
            fewest: self.segments.iter().map(|s| s.fewest).collect(),
            fills: self.segments.iter().map(|s| s.filled).collect(),
            way: self.way_in_lines(),
        });
        let over = match &self.behind {
            Some(transition) => vec![transition.as_numbers()],
            None => self.over_in_numbers(),
        };
        let mass = balance_law::BalancedMass {
            order: N,
            read: self.read,
            over,
            pieces,
        };
        mass.law(&self.balance.lines(), self.balance.speed_factor)
    }
    fn settle_at(&mut self, input: f64) -> f64 {
        let rest_um = self.balance.settle(input);
        self.held = input - rest_um;
        // Displacement, lag and filter stand where the mass rests; no rate is left.
        self.state = std::array::from_fn(|i| if i == 1 || i == 4 { 0.0 } else { rest_um });
        self.before = input;
        rest_um
    }
}

impl BalancedMass {
    /// A mode with these forces; `speed_factor` is its natural frequency over that without added mass.
    pub(super) fn new(
        law: &ModeLaw,
        forces: Vec<Box<dyn RestoringForce>>,
        speed_factor: f64,
        dt_s: f64,
        arrival: Arrival,
        at_rest: f64,
    ) -> Self {
        let balance = Balance::new(forces, speed_factor);
        let (system, read) = law.read_system();
        let mut mass: Box<dyn Mass> = match system.a.nrows() {
            2 => Box::new(Balanced::<2>::new(
                law,
                (system, read),
                dt_s,
                arrival,
                balance,
            )),
            3 => Box::new(Balanced::<3>::new(
                law,
                (system, read),
                dt_s,
                arrival,
                balance,
            )),
            _ => Box::new(Balanced::<5>::new(
                law,
                (system, read),
                dt_s,
                arrival,
                balance,
            )),
        };
        mass.settle_at(at_rest);
        Self(mass)
    }

    /// One interval; what is read at its end.
    pub(super) fn step(&mut self, input: f64) -> f64 {
        let mut signal = [input];
        self.0.run_over(&mut signal);
        signal[0]
    }

    /// Runs over a signal, its value at the end of each interval, and leaves what is read in its place.
    pub(super) fn run_over(&mut self, signal: &mut [f64]) {
        self.0.run_over(signal);
    }

    /// What it does.
    pub(super) fn law(&self) -> Law {
        self.0.law()
    }

    /// At rest under a constant input; where that is.
    pub(super) fn settle(&mut self, input: f64) -> f64 {
        self.0.settle_at(input)
    }
}

/// Forces without any inertia: the stage rests where they balance.
pub(super) struct RestingPlace {
    balance: Balance,
    displacement_um: f64,
}

impl RestingPlace {
    /// The stage of the force of one effect; none in a model with inertia, where the force holds the moving
    /// mass.
    pub(super) fn without_inertia<'a>(
        effect: &dyn Effect,
        from: &Build,
    ) -> Option<Box<dyn Stage + 'a>> {
        if from.model.effect(id::VIBRATION).is_some() {
            return None;
        }
        Some(Box::new(Self {
            balance: Balance::new(vec![effect.restoring_force(from)?], 1.0),
            displacement_um: 0.0,
        }))
    }
}

impl Stage for RestingPlace {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        self.displacement_um = self.balance.rest(self.displacement_um, input);
        self.displacement_um
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let law = balance_law::resting(&self.balance.lines());
        Ok(vec![Block::Mass(law)])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.displacement_um = self.balance.settle(input);
        self.displacement_um
    }
}

#[cfg(test)]
mod tests {
    use crate::chain::{Drive, EffectInstance, InitialState, Model};
    use crate::effect::{Overview, by_id};
    use crate::intersample::Intersample;
    use std::f64::consts::TAU;

    const DT_S: f64 = 1e-3;

    /// A stage of 10 um and 1 um/V around 5 V with these effects.
    fn model(effects: &[(&str, &[f64])]) -> Model {
        let overview = Overview {
            range_um: 10.0,
            ..Overview::without_data(-5.0, 5.0)
        };
        let mut model = Model::new(-5.0, 5.0);
        for (id, values) in [("gain", &[1.0][..])].iter().chain(effects) {
            model.add(EffectInstance::new(by_id(id).unwrap(), &overview, values));
        }
        model
    }

    fn drive(samples: usize) -> Vec<f64> {
        (0..samples)
            .map(|k| {
                let t_s = k as f64 * DT_S;
                2.0 * (TAU * 31.0 * t_s).sin()
                    + 1.5 * (TAU * 77.0 * t_s).sin()
                    + if (t_s / 0.05).fract() < 0.5 {
                        1.0
                    } else {
                        -0.5
                    }
            })
            .collect()
    }

    const MODE: [f64; 2] = [TAU * 60.0, 0.05];
    const SPRING: [f64; 3] = [0.02, 0.01, 0.0];
    const DAMPER: [f64; 3] = [0.5, 2.0, 5.0];
    const BOUC_WEN: [f64; 4] = [0.4, 0.5, -0.2, 1.0];

    /// The force balance by a Runge-Kutta method of fourth order in steps of a two-hundredth of a period of
    /// sampling.
    fn integrated(
        drive_v: &[f64],
        intersample: Intersample,
        [spring, damper, bouc_wen]: [bool; 3],
    ) -> Vec<f64> {
        let on = |is: bool, value: f64| if is { value } else { 0.0 };
        let [w, xi] = MODE;
        let steps = 200;
        let h = DT_S / f64::from(steps);
        let rate = |[x, v, z]: [f64; 3], f: f64| {
            let from_neutral = x - 5.0;
            let of_spring = on(
                spring,
                SPRING[0] * from_neutral.powi(2) + SPRING[1] * from_neutral.powi(3),
            );
            let of_damper = on(damper, DAMPER[0] * (v / DAMPER[2]).abs() * (v / DAMPER[2]));
            let of_bouc_wen = on(bouc_wen, BOUC_WEN[0] * (z - from_neutral));
            let z_rate = w * (v - BOUC_WEN[1] * v.abs() * z - BOUC_WEN[2] * v * z.abs());
            [
                w * v,
                w * (f - x - of_spring - of_damper - of_bouc_wen) - 2.0 * xi * w * v,
                z_rate,
            ]
        };
        let mut state = [0.0; 3];
        let mut before = drive_v[0] + 5.0;
        // At rest under the first value, by letting it die out; what is remembered follows from one way
        // there.
        let settled = model(&effects([spring, damper, bouc_wen])).simulate(&Drive::held(
            &drive_v[..1],
            DT_S,
            InitialState::Settled,
        ))[0];
        state[0] = settled;
        let ways = 100_000;
        for _ in 0..ways {
            let way = (settled - 5.0) / f64::from(ways);
            state[2] +=
                way - (BOUC_WEN[1] * way.abs() * state[2] + BOUC_WEN[2] * way * state[2].abs());
        }
        let mut out = vec![settled];
        for k in 0..drive_v.len() - 1 {
            let next = drive_v[k + 1] + 5.0;
            for step in 0..steps {
                let force = |t: f64| match intersample {
                    Intersample::Hold => before,
                    _ => before + (next - before) * (f64::from(step) + t) / f64::from(steps),
                };
                let along =
                    |s: [f64; 3], d: [f64; 3], t: f64| std::array::from_fn(|i| s[i] + t * d[i]);
                let a = rate(state, force(0.0));
                let b = rate(along(state, a, 0.5 * h), force(0.5));
                let c = rate(along(state, b, 0.5 * h), force(0.5));
                let d = rate(along(state, c, h), force(1.0));
                state = std::array::from_fn(|i| {
                    state[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i])
                });
            }
            before = next;
            out.push(state[0]);
        }
        out
    }

    fn effects([spring, damper, bouc_wen]: [bool; 3]) -> Vec<(&'static str, &'static [f64])> {
        let all: [(bool, &str, &[f64]); 3] = [
            (spring, "nonlinear_stiffness", &SPRING),
            (damper, "nonlinear_damping", &DAMPER),
            (bouc_wen, "hysteretic_stiffness", &BOUC_WEN),
        ];
        let of_balance = all
            .into_iter()
            .filter(|(is, ..)| *is)
            .map(|(_, id, values)| (id, values));
        std::iter::once(("vibration", &MODE[..]))
            .chain(of_balance)
            .collect()
    }

    fn rms(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    /// In one or two steps of a period in which the mode turns by 0.38 rad, to 1e-4 of what it moves; with
    /// loops, whose corners lie inside a step, to 4e-4.
    #[test]
    fn follows_a_finer_integration_of_the_same_equations() {
        let drive_v = drive(800);
        for which in [
            [true, false, false],
            [false, true, false],
            [false, false, true],
            [true, true, true],
        ] {
            for intersample in [Intersample::Hold, Intersample::Linear] {
                let found = model(&effects(which)).simulate(&Drive {
                    intersample,
                    ..Drive::held(&drive_v, DT_S, InitialState::Settled)
                });
                let error_um = rms(&found, &integrated(&drive_v, intersample, which));
                let most_um = if which[2] { 4e-3 } else { 1e-3 };
                println!("{which:?} {intersample:?}: {error_um:.2e} um");
                assert!(error_um < most_um, "{which:?} {intersample:?}: {error_um}");
            }
        }
    }

    #[test]
    fn pieces_are_counted_as_they_are_followed() {
        let drive_v = drive(100);
        let pieces = |effects: &[(&str, &[f64])]| {
            let before = super::pieces_followed();
            let held = Drive::held(&drive_v, DT_S, InitialState::Settled);
            let _ = model(effects).simulate(&held);
            super::pieces_followed() - before
        };
        let spring = ("nonlinear_stiffness", &SPRING[..]);
        let slow = ("vibration", &MODE[..]);
        let fast = ("vibration", &[TAU * 240.0, 0.05][..]);
        assert_eq!(pieces(&[slow]), 0);
        assert!(pieces(&[slow, spring]) >= 100);
        assert!(pieces(&[fast, spring]) >= 400);
        assert_eq!(pieces(&[spring]), 800);
    }

    /// A force of nothing leaves the free mode, whatever the way of the drive and with what reads it.
    #[test]
    fn a_force_of_nothing_is_the_free_mode() {
        let drive_v = drive(300);
        let behind: [&[(&str, &[f64])]; 4] = [
            &[],
            &[("sensor_bandwidth", &[300.0])],
            &[("sensor_filter", &[200.0, 0.7]), ("delay", &[0.4e-3])],
            &[
                ("amplifier_bandwidth", &[150.0]),
                ("sensor_bandwidth", &[300.0]),
            ],
        ];
        for others in behind {
            for intersample in [
                Intersample::Hold,
                Intersample::Linear,
                Intersample::BandLimited,
            ] {
                let drive = Drive {
                    intersample,
                    ..Drive::held(&drive_v, DT_S, InitialState::Settled)
                };
                let read = |effects: &[(&str, &[f64])]| {
                    model(&[&[("vibration", &MODE[..])], others, effects].concat()).simulate(&drive)
                };
                let (free, balanced) = (
                    read(&[]),
                    read(&[("nonlinear_stiffness", &[0.0, 0.0, 0.0])]),
                );
                assert!(
                    rms(&free, &balanced) < 1e-9,
                    "{others:?} {intersample:?}: {}",
                    rms(&free, &balanced)
                );
            }
        }
    }

    /// Friction beside a damper of nothing is the friction alone, of 0.3 um, by another method.
    #[test]
    fn friction_beside_other_forces_is_friction() {
        let drive_v = drive(500);
        let read = |effects: &[(&str, &[f64])]| {
            let friction: [(&str, &[f64]); 2] =
                [("vibration", &MODE), ("friction", &[0.3, 2.0, 0.0])];
            model(&[&friction[..], effects].concat()).simulate(&Drive::held(
                &drive_v,
                DT_S,
                InitialState::Settled,
            ))
        };
        let (alone, beside) = (read(&[]), read(&[("nonlinear_damping", &[0.0, 2.0, 5.0])]));
        // Both follow a bristle that bends within a tenth of a piece of the way.
        assert!(rms(&alone, &beside) < 0.03, "{}", rms(&alone, &beside));
    }

    /// What is too fast to be followed balances.
    #[test]
    fn a_fast_mode_in_a_slow_record_rests_where_its_forces_balance() {
        let drive_v: Vec<f64> = (0..200)
            .map(|k| 4.0 * (0.05 * f64::from(k)).sin())
            .collect();
        let fast = model(&[
            ("vibration", &[TAU * 40_000.0, 0.3]),
            ("nonlinear_stiffness", &SPRING),
        ]);
        let none = model(&[("nonlinear_stiffness", &SPRING)]);
        let read =
            |model: &Model| model.simulate(&Drive::held(&drive_v, DT_S, InitialState::Settled));
        assert!(
            rms(&read(&fast), &read(&none)) < 1e-6,
            "{}",
            rms(&read(&fast), &read(&none))
        );
    }
}
