//! What the texts of all languages have in common: names, numbers, and the head that describes the model.

use crate::engineering::{four, with_deviation};
use crate::error::Error;
use hysteron_sim::block_chain::{BlockChain, NoBlocks};
use hysteron_sim::chain::{InitialState, Model};
use hysteron_sim::effect::FreeMotion;
use hysteron_sim::intersample::Intersample;
use hysteron_sim::physics::RecordStart;

/// What is written in a language.
pub(super) struct Exported<'e> {
    pub(super) chain: &'e BlockChain,
    pub(super) model: &'e Model,
    /// What the function is called.
    pub(super) name: &'e str,
    /// The drive of a row acts up to its sample.
    pub(super) shifted: bool,
    /// How it begins where its caller says nothing.
    pub(super) start: &'e RecordStart,
    /// The motions of the start are there for drives that begin as near to it, V.
    pub(super) near_v: f64,
}

impl Exported<'_> {
    /// The start has more than a state.
    pub(super) fn adds(&self) -> bool {
        self.start.offset_um != 0.0 || !self.start.motions.is_empty()
    }

    /// Motions as decay, 1/s, angular frequency, rad/s, cosine and sine, um.
    pub(super) fn motions(&self) -> Vec<Vec<f64>> {
        let row = |(motion, [cosine, sine]): &(FreeMotion, [f64; 2])| {
            vec![motion.decay_per_s, motion.frequency_rad_s, *cosine, *sine]
        };
        self.start.motions.iter().map(row).collect()
    }

    pub(super) fn begins_settled(&self) -> bool {
        self.start.state != InitialState::Virgin
    }
}

/// Why an effect is not exported.
pub(super) fn cannot(NoBlocks { effect, why }: &NoBlocks) -> Error {
    Error::new(
        "export",
        format!("{effect} is not exported: {why}; expected a model without it"),
    )
}

/// Words that MATLAB, Python or C keep for themselves, and the names that the exported texts use.
const RESERVED: [&str; 84] = [
    "and",
    "as",
    "assert",
    "async",
    "auto",
    "await",
    "break",
    "case",
    "catch",
    "char",
    "class",
    "classdef",
    "const",
    "continue",
    "def",
    "default",
    "del",
    "do",
    "double",
    "elif",
    "else",
    "elseif",
    "end",
    "endfunction",
    "enum",
    "except",
    "extern",
    "finally",
    "float",
    "for",
    "from",
    "function",
    "global",
    "goto",
    "if",
    "import",
    "in",
    "inline",
    "int",
    "is",
    "lambda",
    "long",
    "main",
    "match",
    "math",
    "nonlocal",
    "not",
    "np",
    "numpy",
    "or",
    "otherwise",
    "parfor",
    "pass",
    "persistent",
    "raise",
    "register",
    "restrict",
    "return",
    "short",
    "signed",
    "sizeof",
    "spmd",
    "static",
    "struct",
    "switch",
    "try",
    "type",
    "typedef",
    "union",
    "unsigned",
    "unwind_protect",
    "until",
    "void",
    "volatile",
    "while",
    "with",
    "yield",
    "exp",
    "sin",
    "cos",
    "min",
    "max",
    "zeros",
    "numel",
];

/// A name that all languages take.
pub(super) fn identifier(name: &str) -> String {
    let plain: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    if plain.starts_with(|c: char| c.is_ascii_alphabetic()) && !RESERVED.contains(&plain.as_str()) {
        plain
    } else {
        format!("model_{plain}")
    }
}

/// A number that reads back as the same one in every language.
pub(super) fn number(value: f64) -> String {
    if value == 0.0 {
        "0.0".into()
    } else {
        format!("{value:e}")
    }
}

/// The effects with their parameters, a line each, for a comment.
pub(super) fn described(model: &Model) -> Vec<String> {
    let mut out = Vec::new();
    for instance in &model.effects {
        let declaration = instance.effect.declaration();
        out.push(format!("{}: {}", instance.id, declaration.physics));
        for p in &instance.parameters {
            let value = match p.std.filter(|std| *std > 0.0) {
                Some(std) => with_deviation(p.value, std),
                None => p.value.to_string(),
            };
            out.push(format!(
                "    {} = {value} {}",
                p.parameter.name, p.parameter.unit
            ));
        }
        let equations = declaration.equations.replace('`', "");
        out.extend(equations.lines().map(|line| format!("    {line}")));
    }
    out
}

/// What every export says of itself at its head.
pub(super) fn head(exported: &Exported) -> Vec<String> {
    let Exported {
        chain,
        model,
        start,
        ..
    } = *exported;
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
        match (chain.intersample, exported.shifted) {
            (Intersample::Hold, false) => {
                "The drive of a row acts from its sample to the next one.".into()
            }
            (Intersample::Hold, true) => {
                "The drive of a row acts up to its sample, from the one before.".into()
            }
            (other, _) => format!("The drive is {} between samples.", other.name()),
        },
        format!(
            "Begins {} where nothing else is asked for. Rounding by the sensor is left out.",
            if exported.begins_settled() {
                "settled at the first drive"
            } else {
                "virgin"
            }
        ),
    ];
    out.extend(fitted(model));
    if start.offset_um != 0.0 {
        out.push(format!(
            "The sensor's constant of {} is {:.6} um.",
            start.file, start.offset_um
        ));
    }
    out.push(String::new());
    out.extend(described(model));
    out
}

/// What a model was fitted to, for a comment.
pub(super) fn fitted(model: &Model) -> Vec<String> {
    let Some(known) = model.identified.as_deref() else {
        return Vec::new();
    };
    let recorded = &known.recorded;
    let on = if recorded.fitted_on.is_empty() {
        String::new()
    } else {
        format!(" on {}", recorded.fitted_on)
    };
    // A check may block a data set, to which nothing is fitted then.
    let how = if known.values.is_empty() {
        "Not fitted to"
    } else {
        "Fitted to"
    };
    vec![
        format!(
            "{how} {}{on}; error {} um RMS on what judged it.",
            recorded.data_set,
            four(known.error_um)
        ),
        format!(
            "Recorded: {} to {} V, up to {:.4} V/s, {:.4} s long, {} samples per second.",
            known.low_v, known.high_v, known.slope_max_v_s, known.seconds, recorded.sample_rate_hz
        ),
    ]
}

/// Rows of numbers, each in these brackets, with this between two of them.
pub(super) fn rows(rows: &[Vec<f64>], [open, close]: [&str; 2], between: &str) -> String {
    let row = |values: &Vec<f64>| {
        let texts: Vec<String> = values.iter().map(|v| number(*v)).collect();
        format!("{open}{}{close}", texts.join(", "))
    };
    rows.iter().map(row).collect::<Vec<_>>().join(between)
}
