//! Laws of blocks in the words of a language: lines as [`hysteron_sim::law`] writes them, with the names of
//! functions, the brackets of indices and the ends of blocks of the language.

use super::text::number;
use hysteron_sim::law::{Law, LawNumber};

/// Functions that all languages have by the same name, C and Python in their libraries of mathematics.
const FUNCTIONS: [&str; 24] = [
    "exp", "expm1", "log", "log2", "log10", "sqrt", "pow", "hypot", "sin", "cos", "tan", "asin",
    "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "ceil", "floor",
    "log1p",
];

/// How a language writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dialect {
    Matlab,
    Python,
    C,
}

impl Dialect {
    /// What the language calls a function or a word; names of the law's own go through `own`.
    fn word(self, name: &str, own: &dyn Fn(&str) -> String) -> String {
        match (self, name) {
            (Self::Python, _) if FUNCTIONS.contains(&name) => format!("math.{name}"),
            (Self::C, "min" | "max" | "abs") => format!("f{name}"),
            (Self::Matlab, "pow") => "power".to_owned(),
            (_, "min" | "max" | "abs") => name.to_owned(),
            _ if FUNCTIONS.contains(&name) => name.to_owned(),
            _ => own(name),
        }
    }

    /// An expression; an index counts from one in MATLAB, and is a whole number in the others.
    fn expression(self, text: &str, own: &dyn Fn(&str) -> String) -> String {
        let (mut out, mut rest) = (String::new(), text);
        while let Some(first) = rest.chars().next() {
            let length = if first.is_ascii_digit() {
                number_length(rest)
            } else if first.is_ascii_alphabetic() {
                rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
                    .unwrap_or(rest.len())
            } else {
                ["&&", "||", "!="]
                    .into_iter()
                    .find(|sign| rest.starts_with(sign))
                    .map_or(first.len_utf8(), str::len)
            };
            let (token, after) = rest.split_at(length);
            rest = after;
            match (self, token) {
                (_, name) if first.is_ascii_alphabetic() => out += &self.word(name, own),
                (Self::Matlab, "[") => out.push('('),
                (Self::Matlab, "]") => out += " + 1)",
                (Self::C, "[") => out += "[(int)(",
                (Self::C, "]") => out += ")]",
                (Self::Python, "&&") => out += "and",
                (Self::Python, "||") => out += "or",
                (Self::Matlab, "!=") => out += "~=",
                _ => out += token,
            }
        }
        out
    }

    /// The lines of a law, so deep in the text around them.
    pub(super) fn lines(self, law: &str, depth: usize, own: &dyn Fn(&str) -> String) -> String {
        let (mut out, mut open) = (String::new(), 0);
        let width = if self == Self::Matlab { 2 } else { 4 };
        let closes = match self {
            Self::Matlab => "end",
            Self::Python => "",
            Self::C => "}",
        };
        for line in law.lines().chain([""]) {
            let text = line.trim_start();
            let at = (line.len() - text.len()) / 2;
            let goes_on = text == "else";
            while open > at {
                open -= 1;
                let shared_end = goes_on && open == at && self == Self::Matlab;
                if !closes.is_empty() && !shared_end {
                    out += &format!("{}{closes}\n", " ".repeat(width * (depth + open)));
                }
            }
            if text.is_empty() {
                continue;
            }
            out += &" ".repeat(width * (depth + at));
            out += &self.line(text, own);
            out.push('\n');
            if goes_on
                || ["if ", "for ", "while "]
                    .iter()
                    .any(|word| text.starts_with(word))
            {
                open = at + 1;
            }
        }
        out
    }

    fn line(self, text: &str, own: &dyn Fn(&str) -> String) -> String {
        if text == "else" {
            return match self {
                Self::Matlab => "else",
                Self::Python => "else:",
                Self::C => "else {",
            }
            .into();
        }
        for word in ["if", "while"] {
            if let Some(condition) = text
                .strip_prefix(word)
                .and_then(|rest| rest.strip_prefix(' '))
            {
                let condition = self.expression(condition, own);
                return match self {
                    Self::Matlab => format!("{word} {condition}"),
                    Self::Python => format!("{word} {condition}:"),
                    Self::C => format!("{word} ({condition}) {{"),
                };
            }
        }
        let counted = text
            .strip_prefix("for ")
            .and_then(|rest| rest.split_once(" < "));
        if let Some((index, count)) = counted {
            let count = self.expression(count, own);
            return match self {
                Self::Matlab => format!("for {index} = 0:{count} - 1"),
                Self::Python => format!("for {index} in range(int({count})):"),
                Self::C => format!("for (int {index} = 0; {index} < {count}; {index}++) {{"),
            };
        }
        let ends = if self == Self::Python { "" } else { ";" };
        format!("{}{ends}", self.expression(text, own))
    }

    /// A number of a law.
    pub(super) fn number(self, value: &LawNumber) -> String {
        let list = |values: &[f64], [before, after]: [&str; 2]| {
            let texts: Vec<String> = values.iter().map(|v| number(*v)).collect();
            format!("{before}{}{after}", texts.join(", "))
        };
        match (value, self) {
            (LawNumber::Value(value), _) => number(*value),
            (LawNumber::Count(count), _) => count.to_string(),
            (LawNumber::List(values), Self::C) if values.is_empty() => "{ 0.0 }".into(),
            (LawNumber::List(values), Self::C) => list(values, ["{ ", " }"]),
            (LawNumber::List(values), _) => list(values, ["[", "]"]),
        }
    }
}

fn number_length(text: &str) -> usize {
    let mut before = ' ';
    let ends = |(_, c): &(usize, char)| {
        let belongs = c.is_ascii_digit()
            || *c == '.'
            || *c == 'e'
            || (before == 'e' && (*c == '-' || *c == '+'));
        before = *c;
        !belongs
    };
    text.char_indices()
        .find(ends)
        .map_or(text.len(), |(at, _)| at)
}

/// Whether lines use a name.
pub(super) fn uses(lines: &str, name: &str) -> bool {
    let part = |c: char| !(c.is_ascii_alphanumeric() || c == '_');
    lines.split(part).any(|word| word == name)
}

/// Names that hold within a step: what is assigned and is no state.
pub(super) fn locals(law: &Law, lines: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for line in lines.lines() {
        let Some((name, _)) = line.trim_start().split_once(" = ") else {
            continue;
        };
        let known = name.contains(['[', ' ']) || law.states.iter().any(|state| state.name == name);
        if !known && !out.iter().any(|other| other == name) {
            out.push(name.to_owned());
        }
    }
    out
}
