//! Creep: after a step the displacement goes on, roughly with the logarithm of time, in the direction of the
//! step.
//!
//! A sum of first-order terms with time constants spread evenly over the logarithm of time; they stay fixed,
//! their shares are estimated, which makes the logarithmic law without a start time as a parameter. Beside it
//! stand [`super::creep_pole_pair`], which makes it the rational form of the thesis (Ch. 5, Eq. 17),
//! [`super::logarithmic_creep`], the same law in two parameters, and [`super::creep_operators`], whose
//! equilibrium has hysteresis.

use crate::block::{Block, Linear};
use crate::physics::*;
use std::sync::Arc;

/// Identifier in files and on the command line.
pub const ID: &str = "creep";

/// Share of a term, of the motion: stacks creep by one to three per cent in a decade of time (Adriaens et
/// al., IEEE/ASME Trans. Mechatronics 5 (2000) 331-341), and terms stand about a decade apart.
pub const EXPECTED_SHARE: f64 = 0.03;
/// Share by which that of a term is varied.
const SHARE_STEP: f64 = 0.01;

/// What speaks against creep whose shares are all zero: it follows no drive, and only lets records begin with
/// a motion from before.
pub fn only_from_before(mut shares: impl Iterator<Item = f64>) -> Option<Doubt> {
    shares.all(|share| share == 0.0).then(|| {
        Doubt::Unlikely(
            "its shares of the motion are zero: what it takes is how the records go on from a drive before them"
                .into(),
        )
    })
}

/// Sum of first-order terms behind the vibration.
pub struct Creep {
    /// Number of terms.
    pub terms: usize,
}

impl Default for Creep {
    fn default() -> Self {
        Self { terms: 4 }
    }
}

#[derive(Clone, Copy, Default)]
struct Term {
    share: f64,
    decay: f64,
    from_start: f64,
    from_end: f64,
    state: f64,
}

struct CreepStage {
    /// Terms that are carried: of a grid few have a share, and only where others take their states those
    /// without one are among them.
    terms: Vec<Term>,
    all: Vec<Term>,
    input: f64,
    /// What others take of the last signal.
    kept: Option<Vec<f64>>,
}

/// Terms that are carried side by side: as many as the recursion of one lets others be reckoned meanwhile.
const SIDE_BY_SIDE: usize = 4;

impl CreepStage {
    fn new(values: &[f64], dt_s: f64) -> Self {
        let all: Vec<Term> = values
            .chunks_exact(2)
            .map(|pair| {
                let (share, tau_s) = (pair[0], pair[1].max(1e-9));
                let decay = (-dt_s / tau_s).exp();
                // Exact for an input that runs straight through the interval.
                let mean = -(-dt_s / tau_s).exp_m1() * tau_s / dt_s;
                Term {
                    share,
                    decay,
                    from_start: mean - decay,
                    from_end: 1.0 - mean,
                    state: 0.0,
                }
            })
            .collect();
        Self {
            terms: all
                .iter()
                .filter(|term| term.share != 0.0)
                .copied()
                .collect(),
            all,
            input: 0.0,
            kept: None,
        }
    }
}

/// Carries a few terms over inputs and adds what they give; `see` is shown their states.
#[inline]
fn run_side_by_side(
    terms: &mut [Term; SIDE_BY_SIDE],
    mut before: f64,
    inputs: &[f64],
    outputs: &mut [f64],
    mut see: impl FnMut(&[f64; SIDE_BY_SIDE]),
) {
    let [share, decay, from_start, from_end] = [
        |t: &Term| t.share,
        |t: &Term| t.decay,
        |t: &Term| t.from_start,
        |t: &Term| t.from_end,
    ]
    .map(|of| terms.each_ref().map(of));
    let mut states = terms.each_ref().map(|t| t.state);
    for (input, output) in inputs.iter().zip(outputs) {
        let mut sum = 0.0;
        for i in 0..SIDE_BY_SIDE {
            states[i] = decay[i] * states[i] + (from_start[i] * before + from_end[i] * input);
            sum += share[i] * states[i];
        }
        see(&states);
        *output += sum;
        before = *input;
    }
    terms
        .iter_mut()
        .zip(states)
        .for_each(|(term, state)| term.state = state);
}

impl Stage for CreepStage {
    fn step(&mut self, _k: usize, input: f64) -> f64 {
        let mut output = input;
        for term in &mut self.terms {
            term.state =
                term.decay * term.state + (term.from_start * self.input + term.from_end * input);
            output += term.share * term.state;
        }
        self.input = input;
        output
    }
    fn run(&mut self, _from: usize, signal: &mut [f64]) {
        let Some(last) = signal.last().copied() else {
            return;
        };
        let inputs = signal.to_vec();
        let mut states: Option<Vec<f64>> = self
            .kept
            .as_ref()
            .map(|_| Vec::with_capacity((self.terms.len() + SIDE_BY_SIDE) * inputs.len()));
        for terms in self.terms.chunks_mut(SIDE_BY_SIDE) {
            let mut padded = [Term::default(); SIDE_BY_SIDE];
            padded[..terms.len()].copy_from_slice(terms);
            match &mut states {
                Some(states) => run_side_by_side(&mut padded, self.input, &inputs, signal, |now| {
                    states.extend_from_slice(now)
                }),
                None => run_side_by_side(&mut padded, self.input, &inputs, signal, |_| ()),
            }
            terms.copy_from_slice(&padded[..terms.len()]);
        }
        if let (Some(kept), Some(states)) = (&mut self.kept, states) {
            kept.clear();
            kept.extend(self.terms.iter().map(|term| term.share));
            kept.extend_from_slice(signal);
            kept.extend(states);
        }
        self.input = last;
    }
    fn shared(&mut self) -> Option<&mut dyn SharedPart> {
        Some(self)
    }
    fn blocks(&self) -> Result<Vec<Block>, &'static str> {
        let of = |value: fn(&Term) -> f64| self.terms.iter().map(value).collect::<Vec<f64>>();
        let diagonal = |i: usize| {
            (0..self.terms.len())
                .map(|j| if i == j { self.terms[i].decay } else { 0.0 })
                .collect()
        };
        let phi = (0..self.terms.len()).map(diagonal).collect();
        let rest = vec![1.0; self.terms.len()];
        Ok(vec![Block::Linear(Linear::reading_states(
            phi,
            of(|t| t.from_start),
            of(|t| t.from_end),
            &of(|t| t.share),
            1.0,
            rest,
        ))])
    }
    fn settle(&mut self, input: f64) -> f64 {
        self.input = input;
        let mut output = input;
        for term in &mut self.terms {
            term.state = input;
            output += term.share * input;
        }
        output
    }
    fn linear_lanes(&self, lanes: usize) -> Option<Box<dyn LinearLanes>> {
        let terms = self
            .all
            .iter()
            .filter(|t| t.share != 0.0)
            .map(|t| (Term { state: 0.0, ..*t }, vec![0.0; lanes]))
            .collect();
        Some(Box::new(CreepLanes {
            terms,
            inputs: vec![0.0; lanes],
        }))
    }
}

impl SharedPart for CreepStage {
    fn made_by(&self) -> Vec<f64> {
        // Whatever their shares, terms with these time constants have the same states.
        self.all.iter().map(|term| term.decay).collect()
    }
    fn keep(&mut self) {
        self.terms.clone_from(&self.all);
        self.kept = Some(Vec::new());
    }
    fn kept(&self) -> &[f64] {
        self.kept.as_deref().unwrap_or_default()
    }
    fn run_with(&mut self, signal: &mut [f64], part: &[f64]) {
        let (shares, rest) = part.split_at(self.all.len());
        let (outputs, states) = rest.split_at(signal.len());
        signal.copy_from_slice(outputs);
        for (k, (term, share)) in self
            .all
            .iter()
            .zip(shares)
            .enumerate()
            .filter(|(_, (term, share))| term.share != **share)
        {
            let more = term.share - share;
            let of_some = &states[k / SIDE_BY_SIDE * SIDE_BY_SIDE * signal.len()..];
            for (value, states) in signal.iter_mut().zip(of_some.chunks_exact(SIDE_BY_SIDE)) {
                *value += more * states[k % SIDE_BY_SIDE];
            }
        }
    }
}

/// The terms with a state for each signal.
struct CreepLanes {
    terms: Vec<(Term, Vec<f64>)>,
    inputs: Vec<f64>,
}

impl LinearLanes for CreepLanes {
    fn settle(&mut self, row: &mut [f64]) {
        self.inputs.copy_from_slice(row);
        for (_, states) in &mut self.terms {
            states.copy_from_slice(&self.inputs);
        }
        let all: f64 = self.terms.iter().map(|(term, _)| term.share).sum();
        row.iter_mut().for_each(|value| *value *= 1.0 + all);
    }
    fn run(&mut self, block: &mut [f64]) {
        let lanes = self.inputs.len();
        let mut row_in = vec![0.0; lanes];
        for row in block.chunks_exact_mut(lanes) {
            row_in.copy_from_slice(row);
            for (term, states) in &mut self.terms {
                let (before, now) = (&self.inputs[..lanes], &row_in[..lanes]);
                for (((out, state), before), now) in
                    row.iter_mut().zip(states.iter_mut()).zip(before).zip(now)
                {
                    *state = term.decay * *state + term.from_start * before + term.from_end * now;
                    *out += term.share * *state;
                }
            }
            std::mem::swap(&mut self.inputs, &mut row_in);
        }
    }
}

impl Creep {
    /// Time constants that a data set can show, evenly spread over their logarithm.
    fn time_constants_s(&self, overview: &Overview) -> Vec<f64> {
        let longest = (overview.duration_s / 2.0).max(1e-3);
        let shortest = (longest / 1000.0).max(0.005).min(longest / 2.0);
        let n = self.terms.max(1);
        (0..n)
            .map(|i| {
                shortest
                    * (longest / shortest).powf(if n == 1 {
                        1.0
                    } else {
                        i as f64 / (n - 1) as f64
                    })
            })
            .collect()
    }
}

/// The stage of terms, each a share and a time constant, s, one after the other.
pub(super) fn stage_of_terms(values: &[f64], dt_s: f64) -> Box<dyn Stage> {
    Box::new(CreepStage::new(values, dt_s))
}

/// Creep with fixed time constants whose shares may have either sign, each starting at 0.01.
///
/// The thesis' own creep has a complex pole pair (Ch. 5, Eq. 17), which no sum of terms that all go with the
/// step can follow: with positive shares alone a few nanometres remain. It serves where creep has to be taken
/// off the other parameters, whatever its form.
#[must_use]
pub fn with_signed_shares(overview: &Overview, time_constants_s: &[f64]) -> EffectInstance {
    let mut creep = EffectInstance::new(
        Arc::new(Creep {
            terms: time_constants_s.len(),
        }),
        overview,
        &[],
    );
    for (pair, tau_s) in creep.parameters.chunks_exact_mut(2).zip(time_constants_s) {
        if let [share, tau] = pair {
            (share.parameter.lower, share.parameter.upper, share.value) = (-2.0, 2.0, 0.01);
            (tau.parameter.lower, tau.parameter.upper, tau.value) =
                (0.5 * tau_s, 2.0 * tau_s, *tau_s);
        }
    }
    creep
}

impl Effect for Creep {
    fn declaration(&self) -> Declaration {
        Declaration {
            id: ID.into(),
            physics:
            "After a change of drive domains go on switching for seconds and minutes: the displacement creeps on after every step."
            .into(),
            reference: "thesis Ch. 2, Eqs. 4-5; Ch. 5, Eqs. 13 and 17".into(),
            experiment: "steps of several heights, each held for ten seconds or more".into(),
            fitting_rank: 4,
            starts_combine: true,
            picture: Picture {
                against: Against::TimeHeld,
                caption: "Creep goes on with the logarithm of time after the drive has stopped, in the direction of the last step; one curve for each hold.",
            },
            planted: Planted::InPairs,
            equations: r"`y = x + sum share_i s_i`, `time_constant_i_s s_i' + s_i = x`.

Exact for an input that runs straight through the interval. With `a = exp(-T / tau)` and `m = (1 - a) tau / T`: `s[k] = a s[k-1] + (m - a) x[k-1] + (1 - m) x[k]`. At rest `s_i = x`.
Behind modes it goes once a period, by the values at the ends of periods.",
            goes_by_ends: true,
            ..Declaration::at(Place::Creep)
        }
    }

    fn parameters(&self, overview: &Overview) -> Vec<Parameter> {
        self.time_constants_s(overview)
            .iter()
            .enumerate()
            .flat_map(|(i, tau)| {
                [
                    Parameter::linear(format!("share_{}", i + 1), "1", 0.0, 0.9, SHARE_STEP)
                        .expected_within(EXPECTED_SHARE / SHARE_STEP),
                    Parameter::logarithmic(
                        format!("time_constant_{}_s", i + 1),
                        "s",
                        tau / 10.0,
                        tau * 10.0,
                    )
                    .on_a_grid(),
                ]
            })
            .collect()
    }

    fn starts(&self, overview: &Overview) -> Vec<Vec<f64>> {
        let taus = self.time_constants_s(overview);
        (0..taus.len())
            .map(|k| {
                taus.iter()
                    .enumerate()
                    .flat_map(|(i, tau)| [if i == k { 0.01 } else { 0.0 }, *tau])
                    .collect()
            })
            .collect()
    }

    fn doubt(&self, _model: &Model, values: &[f64]) -> Option<Doubt> {
        let (terms, _) = values.as_chunks();
        only_from_before(terms.iter().map(|[share, _]| *share))
    }

    fn stage<'a>(&self, from: &Build<'_, 'a>) -> Option<Box<dyn Stage + 'a>> {
        Some(Box::new(CreepStage::new(from.values, from.setting.dt_s)))
    }

    fn free_motions(&self, _model: &Model, values: &[f64]) -> Vec<FreeMotion> {
        // Those without a share too: a spectrum of creep is smooth, and shares that are not negative come out
        // sparse.
        values
            .chunks_exact(2)
            .map(|pair| FreeMotion {
                decay_per_s: 1.0 / pair[1],
                frequency_rad_s: 0.0,
            })
            .collect()
    }

    fn free_share(&self, values: &[f64]) -> f64 {
        let shares = values.chunks_exact(2).map(|pair| pair[0]);
        shares.fold(EXPECTED_SHARE, f64::max)
    }

    fn with_parameters(&self, count: usize) -> Option<Arc<dyn Effect>> {
        (count > 0 && count.is_multiple_of(2))
            .then(|| Arc::new(Self { terms: count / 2 }) as Arc<dyn Effect>)
    }

    fn values_at(&self, case: &mut PlantedCase) -> Option<Vec<f64>> {
        Some(
            [0.02, 0.2, 2.0, 20.0]
                .iter()
                .flat_map(|tau| [case.about(0.006 * case.strength), *tau])
                .collect(),
        )
    }
}
