//! A model to take away: a function that simulates it, in MATLAB, NumPy or C, and its linear part as a state
//! space.
//!
//! Every export is written from the blocks of a model at one sampling period ([`hysteron_sim::block`]), so
//! that it reads what the program reads. What blocks do is written once for each language (`blocks.m`,
//! `blocks.py`, `blocks.c`); an export carries those that it needs and stands alone. An effect whose stage
//! has no blocks is refused by name.

mod c;
mod matlab;
mod python;
mod state_space;

use crate::error::{Error, Result};
use hysteron_sim::block::{Block, BlockChain};
use hysteron_sim::chain::Model;
use std::collections::BTreeSet;

/// What a model is exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// A function for MATLAB and Octave.
    Matlab,
    /// A module that needs NumPy alone.
    Python,
    /// C99 with fixed memory.
    C,
    /// The linear part as JSON.
    StateSpace,
}

impl Language {
    /// All by the names that files and command line use, each with the extension of its files.
    pub const ALL: [(&'static str, &'static str, Self); 4] = [
        ("matlab", "m", Self::Matlab),
        ("python", "py", Self::Python),
        ("c", "c", Self::C),
        ("state-space", "json", Self::StateSpace),
    ];

    /// By its name.
    ///
    /// # Errors
    /// With all names.
    pub fn named(place: &str, name: &str) -> Result<Self> {
        let known = || {
            Self::ALL
                .iter()
                .map(|(name, ..)| *name)
                .collect::<Vec<_>>()
                .join(", ")
        };
        Self::ALL
            .iter()
            .find(|(known, ..)| *known == name)
            .map(|(.., language)| *language)
            .ok_or_else(|| Error::new(place, format!("`{name}`; expected one of {}", known())))
    }

    /// The extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(.., language)| *language == self)
            .map_or("txt", |(_, extension, _)| extension)
    }
}

/// The text of a model in a language, at a sampling rate; `name` is what its function is called.
///
/// # Errors
/// A rate that is no positive number; an effect that no block describes.
/// ```
/// use hysteron::{EffectInstance, Language, Model, Overview, effect_named, export};
///
/// let mut model = Model::new(0.0, 100.0);
/// model.add(EffectInstance::new(effect_named("gain")?, &Overview::without_data(0.0, 100.0), &[0.1]));
/// assert!(export(&model, Language::Python, 20_000.0, "stage")?.contains("def "));
/// # Ok::<(), hysteron::Error>(())
/// ```
pub fn export(
    model: &Model,
    language: Language,
    sample_rate_hz: f64,
    name: &str,
) -> Result<String> {
    if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
        return Err(Error::new(
            "--rate-hz",
            format!("{sample_rate_hz}; expected a positive number"),
        ));
    }
    let name = identifier(name);
    if language == Language::StateSpace {
        return state_space::text(model, sample_rate_hz);
    }
    let chain =
        BlockChain::of(model, 1.0 / sample_rate_hz).map_err(|effect| cannot(model, &effect))?;
    Ok(match language {
        Language::Matlab => matlab::text(&chain, model, &name),
        Language::Python => python::text(&chain, model, &name),
        Language::C | Language::StateSpace => c::text(&chain, model, &name),
    })
}

/// Why an effect is not exported.
fn cannot(model: &Model, effect: &str) -> Error {
    let own = model
        .effect(effect)
        .is_some_and(|e| e.effect.declaration().definition.is_some());
    let why = if own {
        "is an effect of your own; write its expression into the exported file where it stands in the chain"
    } else if effect == hysteron_sim::effect::vibration::ID {
        "moves a mass against friction or other forces in its balance, which takes a variable step; expected a model without them"
    } else {
        "has no export; expected a model without it"
    };
    Error::new("export", format!("{effect} {why}"))
}

/// A name that all languages take.
fn identifier(name: &str) -> String {
    let plain: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic()) {
        plain
    } else {
        format!("model_{plain}")
    }
}

/// The blocks that a chain needs of a library of them, each of which begins with a line that says `block` and
/// its name.
fn needed(library: &str, chain: &BlockChain, mark: &str) -> String {
    let names: BTreeSet<&str> = chain
        .blocks
        .iter()
        .map(|placed| placed.block.name())
        .collect();
    let mut out = String::new();
    let mut takes = false;
    for line in library.lines() {
        match line
            .strip_prefix(mark)
            .and_then(|rest| rest.strip_prefix(" block "))
        {
            Some(rest) => {
                takes = rest
                    .split_whitespace()
                    .next()
                    .is_some_and(|name| names.contains(name));
                if takes {
                    out.push('\n');
                }
            }
            None if takes => {
                out.push_str(line);
                out.push('\n');
            }
            None => {}
        }
    }
    out
}

/// A number that reads back as the same one in every language.
fn number(value: f64) -> String {
    if value == 0.0 {
        "0.0".into()
    } else {
        format!("{value:e}")
    }
}

/// The effects with their parameters, a line each, for a comment.
fn described(model: &Model) -> Vec<String> {
    let mut out = Vec::new();
    for instance in &model.effects {
        let declaration = instance.effect.declaration();
        out.push(format!("{}: {}", instance.id, declaration.physics));
        for p in &instance.parameters {
            let std = p
                .std
                .map_or_else(String::new, |std| format!(" +- {std:.3e}"));
            out.push(format!(
                "    {} = {}{std} {}",
                p.parameter.name, p.value, p.parameter.unit
            ));
        }
    }
    out
}

/// What every export says of itself at its head.
fn head(chain: &BlockChain, model: &Model) -> Vec<String> {
    let force = if chain.takes_force() {
        ", force in N"
    } else {
        ""
    };
    let mut out = vec![
        format!(
            "Model of a piezoelectric actuator, exported by Hysteron {}.",
            env!("CARGO_PKG_VERSION")
        ),
        format!(
            "Drive in V from {} to {}{force}, {} samples per second; reading in um.",
            chain.drive_min_v,
            chain.drive_max_v,
            1.0 / chain.dt_s
        ),
        "The drive is held from each sample to the next; the reading is taken at the sample."
            .into(),
        String::new(),
    ];
    out.extend(described(model));
    out
}

/// Play operators and the like as pairs of threshold and weight.
fn pairs(plays: &[hysteron_sim::block::Play]) -> Vec<Vec<f64>> {
    plays
        .iter()
        .map(|play| vec![play.threshold, play.weight])
        .collect()
}

/// The numbers of a block in the order in which libraries take them: each a number, a row, or rows.
enum Argument {
    Number(f64),
    Flag(bool),
    Count(usize),
    Row(Vec<f64>),
    Column(Vec<f64>),
    Rows(Vec<Vec<f64>>),
    Nothing,
    Force,
}

fn arguments(block: &Block, substeps: usize) -> Vec<Argument> {
    use Argument::{Column, Count, Flag, Force, Nothing, Number, Row, Rows};
    match block {
        Block::Proportional { gain, offset } => vec![Number(*gain), Number(*offset)],
        Block::Clamp { lower, upper } => vec![Number(*lower), Number(*upper)],
        Block::Slope { most, gives_mean } => vec![Number(*most), Flag(*gives_mean)],
        Block::Linear(l) => vec![
            Rows(l.phi.clone()),
            Column(l.start.clone()),
            Column(l.end.clone()),
            Row(l.out.clone()),
            Number(l.before),
            Number(l.through),
            Column(l.rest.clone()),
            Number(l.offset),
        ],
        Block::Delay { whole, late_share } => vec![Count(*whole), Number(*late_share)],
        Block::Loops {
            g,
            r,
            plays,
            rate,
            lower,
            span,
        } => {
            let law = |l: &hysteron_sim::block::Rate| {
                Row(vec![
                    l.loop_linear,
                    l.loop_quadratic,
                    l.curve_linear,
                    l.dt_s,
                    l.substeps as f64,
                ])
            };
            vec![
                Rows(g.clone()),
                Row(r.clone()),
                Rows(pairs(plays)),
                rate.as_ref().map_or(Nothing, law),
                Number(*lower),
                Number(*span),
            ]
        }
        Block::Plays {
            plays,
            zones,
            lower,
            span,
        } => vec![
            Rows(pairs(plays)),
            Rows(pairs(zones)),
            Number(*lower),
            Number(*span),
        ],
        Block::Slip {
            gain,
            elements,
            lower,
            span,
        } => vec![
            Number(*gain),
            Rows(pairs(elements)),
            Number(*lower),
            Number(*span),
        ],
        Block::BoucWen {
            gain,
            alpha,
            beta,
            gamma,
            lower,
            span,
        } => [gain, alpha, beta, gamma, lower, span]
            .map(|v| Number(*v))
            .into(),
        Block::Duhem {
            approach,
            slope,
            elastic,
            lower,
            span,
        } => [approach, slope, elastic, lower, span]
            .map(|v| Number(*v))
            .into(),
        Block::Gap { half } => vec![Number(*half)],
        Block::Drift { rate, slowing } => vec![Number(*rate), Number(*slowing)],
        Block::Lines(lines) => vec![Rows(lines.iter().map(|line| line.to_vec()).collect())],
        Block::Bend { quadratic, cubic } => vec![Number(*quadratic), Number(*cubic)],
        Block::Round { step } => vec![Number(*step)],
        Block::Force { compliance } => vec![Force, Count(substeps), Number(*compliance)],
    }
}

/// The steps of a chain for languages that carry whole signals: going over to sub-intervals, back, and the
/// blocks between.
enum Carry<'c> {
    Refine,
    Coarsen,
    Block {
        effect: &'c str,
        block: &'c Block,
        substeps: usize,
    },
}

fn carried(chain: &BlockChain) -> Vec<Carry<'_>> {
    let (mut out, mut fine) = (Vec::new(), false);
    for placed in &chain.blocks {
        match (fine, placed.fine) {
            (false, true) => out.push(Carry::Refine),
            (true, false) => out.push(Carry::Coarsen),
            _ => {}
        }
        fine = placed.fine;
        out.push(Carry::Block {
            effect: &placed.effect,
            block: &placed.block,
            substeps: if fine { chain.substeps } else { 1 },
        });
    }
    if fine {
        out.push(Carry::Coarsen);
    }
    out
}
