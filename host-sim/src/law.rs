//! What each block does, written once: lines of assignments, conditions and loops that exports print in their
//! language.
//!
//! A law has numbers, states, what the states are where it begins at rest with the input `x`, and one step
//! from `x` to `y`. The step gives the output at rest too. Lines are indented by two blanks inside `if`,
//! `else`, `while` and `for i < count`; indices count from zero; `force` is the measured force. All names that
//! are neither numbers nor states hold within a step.

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
    pub(crate) fn of(step: &str) -> Self {
        Self {
            step: step.to_owned(),
            ..Self::default()
        }
    }

    pub(crate) fn value(mut self, name: &'static str, value: f64) -> Self {
        self.numbers.push((name, LawNumber::Value(value)));
        self
    }

    pub(crate) fn count(mut self, name: &'static str, count: usize) -> Self {
        self.numbers.push((name, LawNumber::Count(count)));
        self
    }

    pub(crate) fn list(mut self, name: &'static str, values: Vec<f64>) -> Self {
        self.numbers.push((name, LawNumber::List(values)));
        self
    }

    pub(crate) fn state(mut self, name: &str, size: Option<usize>) -> Self {
        self.states.push(LawState {
            name: name.to_owned(),
            size,
            counts: false,
        });
        self
    }

    pub(crate) fn counter(mut self, name: &str) -> Self {
        self.states.push(LawState {
            name: name.to_owned(),
            size: None,
            counts: true,
        });
        self
    }

    pub(crate) fn begins(self, lines: &str) -> Self {
        Self {
            begin: lines.to_owned(),
            ..self
        }
    }
}

/// Lines one step deeper.
pub(crate) fn deeper(lines: &str, by: usize) -> String {
    let indent = "  ".repeat(by);
    lines
        .lines()
        .map(|line| format!("{indent}{line}\n"))
        .collect()
}
