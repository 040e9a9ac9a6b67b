//! Expressions of an effect that a user writes: read once, then evaluated for every sample.
//!
//! The grammar stands in `formula.pest`. What was read becomes a list of steps for a stack of numbers, in the
//! order in which they are done (reverse Polish notation), so that evaluation neither allocates nor searches.
//! Comparisons give 1 or 0, and `if(condition, a, b)` takes `a` where the condition is not 0; both are
//! computed.

use pest::Parser as _;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::{Pair, Pairs};
use pest::pratt_parser::{Assoc, Op, PrattParser};
use std::sync::LazyLock;

#[derive(pest_derive::Parser)]
#[grammar = "effect/formula.pest"]
struct Grammar;

/// Longest expression, in characters, and deepest nesting of its brackets: what is read stays far from the
/// end of any stack.
const LONGEST: usize = 2000;
const DEEPEST: usize = 50;

/// Operators, the weakest first.
static OPERATORS: LazyLock<PrattParser<Rule>> = LazyLock::new(|| {
    let left = |rule: Rule| Op::infix(rule, Assoc::Left);
    PrattParser::new()
        .op(left(Rule::at_most)
            | left(Rule::at_least)
            | left(Rule::less)
            | left(Rule::greater)
            | left(Rule::equal)
            | left(Rule::unequal))
        .op(left(Rule::plus) | left(Rule::less_sign))
        .op(left(Rule::times) | left(Rule::divided))
        .op(Op::prefix(Rule::minus))
        .op(Op::infix(Rule::power, Assoc::Right))
});

type OfOne = fn(f64) -> f64;
type OfTwo = fn(f64, f64) -> f64;

/// Functions of one number. Exports call those by their name that have no lines in [`WRITTEN_OUT`].
static OF_ONE: [(&str, OfOne); 28] = [
    ("abs", f64::abs),
    ("signum", |x| if x == 0.0 { 0.0 } else { x.signum() }),
    ("sqrt", f64::sqrt),
    ("cbrt", f64::cbrt),
    ("exp", f64::exp),
    ("ln", f64::ln),
    ("log2", f64::log2),
    ("log10", f64::log10),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("sinh", f64::sinh),
    ("cosh", f64::cosh),
    ("tanh", f64::tanh),
    ("coth", |x| 1.0 / x.tanh()),
    ("langevin", langevin),
    ("asinh", f64::asinh),
    ("acosh", f64::acosh),
    ("atanh", f64::atanh),
    ("floor", f64::floor),
    ("ceil", f64::ceil),
    ("round", f64::round),
    ("trunc", f64::trunc),
    ("fract", f64::fract),
    ("not", |x| f64::from(u8::from(x == 0.0))),
];

/// What no language has under the same name, in [`crate::law`]: `y` from `a` and `b`, as an expression or in
/// lines.
const WRITTEN_OUT: [(&str, &str); 24] = [
    ("ln", "log(a)"),
    ("signum", "y = 0\nif a > 0\n  y = 1\nif a < 0\n  y = -1\n"),
    ("cbrt", "y = pow(abs(a), 1 / 3.0)\nif a < 0\n  y = -y\n"),
    ("coth", "(1 / tanh(a))"),
    (
        "langevin",
        "y = a / 3 - pow(a, 3) / 45 + 2 * pow(a, 5) / 945\nif abs(a) >= 1e-2\n  y = 1 / tanh(a) - 1 / a\n",
    ),
    ("round", "y = floor(abs(a) + 0.5)\nif a < 0\n  y = -y\n"),
    ("trunc", "y = floor(abs(a))\nif a < 0\n  y = -y\n"),
    ("fract", "y = abs(a) - floor(abs(a))\nif a < 0\n  y = -y\n"),
    ("not", "y = 0\nif a == 0\n  y = 1\n"),
    ("rem", "(a - abs(b) * floor(a / abs(b)))"),
    ("and", "y = 0\nif a != 0 && b != 0\n  y = 1\n"),
    ("or", "y = 0\nif a != 0 || b != 0\n  y = 1\n"),
    ("-", "(-a)"),
    ("plus", "(a + b)"),
    ("less_sign", "(a - b)"),
    ("times", "(a * b)"),
    ("divided", "(a / b)"),
    ("power", "pow(a, b)"),
    ("less", "y = 0\nif a < b\n  y = 1\n"),
    ("at_most", "y = 0\nif a <= b\n  y = 1\n"),
    ("greater", "y = 0\nif a > b\n  y = 1\n"),
    ("at_least", "y = 0\nif a >= b\n  y = 1\n"),
    ("equal", "y = 0\nif a == b\n  y = 1\n"),
    ("unequal", "y = 0\nif a != b\n  y = 1\n"),
];

/// Functions of two numbers; `true` where more than two are taken from the left.
static OF_TWO: [(&str, OfTwo, bool); 7] = [
    ("max", f64::max, true),
    ("min", f64::min, true),
    ("atan2", f64::atan2, false),
    ("hypot", f64::hypot, false),
    ("rem", f64::rem_euclid, false),
    (
        "and",
        |a, b| f64::from(u8::from(a != 0.0 && b != 0.0)),
        true,
    ),
    ("or", |a, b| f64::from(u8::from(a != 0.0 || b != 0.0)), true),
];

/// Numbers with a name, where a parameter has not taken it.
const CONSTANTS: [(&str, f64); 4] = [
    ("pi", std::f64::consts::PI),
    ("PI", std::f64::consts::PI),
    ("π", std::f64::consts::PI),
    ("E", std::f64::consts::E),
];

/// coth(x) - 1 / x, the mean alignment of free dipoles (P. Langevin, *Ann. Chim. Phys.* 5 (1905) 70), without
/// its loss of digits around 0.
fn langevin(x: f64) -> f64 {
    if x.abs() < 1e-2 {
        x / 3.0 - x.powi(3) / 45.0 + 2.0 * x.powi(5) / 945.0
    } else {
        1.0 / x.tanh() - 1.0 / x
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Number(f64),
    /// A value by its place in the list that evaluation is given.
    Value(usize),
    OfOne(&'static str, OfOne),
    OfTwo(&'static str, OfTwo),
    /// Of three numbers the second where the first is not 0, else the third.
    Select,
}

/// An expression, ready to be evaluated.
#[derive(Clone, Debug)]
pub(super) struct Formula {
    steps: Vec<Step>,
}

impl Formula {
    /// Reads an expression whose names stand for values by their place in `names`.
    ///
    /// # Errors
    /// Where in the expression what was expected.
    pub(super) fn read(text: &str, names: &[String]) -> Result<Self, String> {
        if text.chars().count() > LONGEST {
            return Err(format!("the expression has more than {LONGEST} characters"));
        }
        let mut depth = 0_usize;
        for (at, c) in text.char_indices() {
            depth = if c == '(' {
                depth + 1
            } else {
                depth.saturating_sub(usize::from(c == ')'))
            };
            if depth > DEEPEST {
                return Err(pointing(text, at, "brackets nested too deeply"));
            }
        }
        let read = Grammar::parse(Rule::formula, text).map_err(|error| {
            let (InputLocation::Pos(at) | InputLocation::Span((at, _))) = error.location;
            pointing(text, at, &expected(&error.variant, text, at))
        })?;
        let whole = read
            .into_iter()
            .find(|pair| pair.as_rule() == Rule::sum_of_terms);
        let steps = whole.map_or(Ok(Vec::new()), |pair| steps_of(pair, text, names))?;
        Ok(Self { steps })
    }

    /// Whether the value at this place takes part.
    pub(super) fn uses(&self, place: usize) -> bool {
        self.steps
            .iter()
            .any(|step| matches!(step, Step::Value(at) if *at == place))
    }

    /// The value for a list of values; `stack` is room to work in. Not a number where a function has no
    /// value.
    pub(super) fn evaluate(&self, values: &[f64], stack: &mut Vec<f64>) -> f64 {
        stack.clear();
        for step in &self.steps {
            let result = match step {
                Step::Number(number) => *number,
                Step::Value(at) => values[*at],
                Step::OfOne(_, function) => function(stack.pop().unwrap_or(f64::NAN)),
                Step::OfTwo(_, function) => {
                    let second = stack.pop().unwrap_or(f64::NAN);
                    function(stack.pop().unwrap_or(f64::NAN), second)
                }
                Step::Select => {
                    let otherwise = stack.pop().unwrap_or(f64::NAN);
                    let then = stack.pop().unwrap_or(f64::NAN);
                    if stack.pop().unwrap_or(f64::NAN) == 0.0 {
                        otherwise
                    } else {
                        then
                    }
                }
            };
            stack.push(result);
        }
        stack.pop().unwrap_or(f64::NAN)
    }

    /// Lines of [`crate::law`] that give `to` of the values by these names; what does not fit into an expression
    /// is a line before it, under a name that begins with `to`.
    pub(super) fn as_law(&self, names: &[String], to: &str) -> String {
        let (mut out, mut stack, mut count) = (String::new(), Vec::<String>::new(), 0);
        for step in &self.steps {
            let mut next = || stack.pop().unwrap_or_default();
            let (pattern, given) = match step {
                Step::Number(number) => (format!("{number:e}"), Vec::new()),
                Step::Value(at) => (names[*at].clone(), Vec::new()),
                Step::OfOne(name, _) => (pattern_of(name, "a"), vec![("a", next())]),
                Step::OfTwo(name, _) => {
                    let second = next();
                    (pattern_of(name, "a, b"), vec![("a", next()), ("b", second)])
                }
                Step::Select => {
                    let (otherwise, then) = (next(), next());
                    let given = vec![("a", next()), ("b", then), ("c", otherwise)];
                    ("y = c\nif a != 0\n  y = b\n".into(), given)
                }
            };
            let is_lines = pattern.contains(" = ");
            let between = format!("{to}_{count}");
            let mut text = String::new();
            for word in words(&pattern).map(|word| match word {
                "y" if is_lines => between.as_str(),
                _ => given
                    .iter()
                    .find(|(name, _)| *name == word)
                    .map_or(word, |(_, value)| value),
            }) {
                text += word;
            }
            if is_lines {
                out += &text;
                count += 1;
            }
            stack.push(if is_lines { between } else { text });
        }
        out + &format!("{to} = {}\n", stack.pop().unwrap_or_default())
    }
}

/// What exports write for a function.
fn pattern_of(name: &str, of: &str) -> String {
    let written = WRITTEN_OUT.iter().find(|(known, _)| *known == name);
    written.map_or_else(|| format!("{name}({of})"), |(_, lines)| (*lines).to_owned())
}

/// Words and what stands between them.
fn words(text: &str) -> impl Iterator<Item = &str> {
    let part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '.';
    let mut rest = text;
    std::iter::from_fn(move || {
        let first = rest.chars().next()?;
        let length = rest
            .find(|c: char| part(c) != part(first))
            .unwrap_or(rest.len());
        let (word, after) = rest.split_at(length);
        rest = after;
        Some(word)
    })
}

/// The steps of terms with operators between them.
fn steps_of_terms(
    pairs: Pairs<'_, Rule>,
    text: &str,
    names: &[String],
) -> Result<Vec<Step>, String> {
    // A comparison says of itself that it is one: `1 < x < 3` would compare a truth with 3.
    let (steps, _) = OPERATORS
        .map_primary(|pair| Ok((steps_of(pair, text, names)?, false)))
        .map_prefix(|_, of: Result<(Vec<Step>, bool), String>| {
            of.map(|(steps, _)| (with(steps, Step::OfOne("-", |x| -x)), false))
        })
        .map_infix(|left, operator, right| {
            let ((mut steps, of_truth), (more, _)) = (left?, right?);
            let compares = is_comparison(operator.as_rule());
            if of_truth && compares {
                let at = operator.as_span().start();
                return Err(pointing(
                    text,
                    at,
                    "comparisons do not follow each other; expected and(1 < x, x < 3)",
                ));
            }
            steps.extend(more);
            Ok((with(steps, function_of(operator.as_rule())), compares))
        })
        .parse(pairs)?;
    Ok(steps)
}

fn with(mut steps: Vec<Step>, last: Step) -> Vec<Step> {
    steps.push(last);
    steps
}

fn is_comparison(operator: Rule) -> bool {
    matches!(
        operator,
        Rule::less | Rule::at_most | Rule::greater | Rule::at_least | Rule::equal | Rule::unequal
    )
}

fn function_of(operator: Rule) -> Step {
    let (name, function): (_, OfTwo) = match operator {
        Rule::plus => ("plus", |a, b| a + b),
        Rule::less_sign => ("less_sign", |a, b| a - b),
        Rule::times => ("times", |a, b| a * b),
        Rule::divided => ("divided", |a, b| a / b),
        Rule::power => ("power", power),
        Rule::less => ("less", |a, b| f64::from(u8::from(a < b))),
        Rule::at_most => ("at_most", |a, b| f64::from(u8::from(a <= b))),
        Rule::greater => ("greater", |a, b| f64::from(u8::from(a > b))),
        Rule::at_least => ("at_least", |a, b| f64::from(u8::from(a >= b))),
        Rule::equal => ("equal", |a, b| f64::from(u8::from(a == b))),
        _ => ("unequal", |a, b| f64::from(u8::from(a != b))),
    };
    Step::OfTwo(name, function)
}

/// Small whole powers by products, which are as exact and much faster.
fn power(base: f64, exponent: f64) -> f64 {
    if exponent == 2.0 {
        base * base
    } else {
        base.powf(exponent)
    }
}

/// The steps of a number, a name, a function, or of what stands in brackets.
fn steps_of(pair: Pair<'_, Rule>, text: &str, names: &[String]) -> Result<Vec<Step>, String> {
    let at = pair.as_span().start();
    match pair.as_rule() {
        Rule::number => {
            let number: f64 = pair
                .as_str()
                .parse()
                .map_err(|e| pointing(text, at, &format!("no number: {e}")))?;
            if number.is_finite() {
                Ok(vec![Step::Number(number)])
            } else {
                Err(pointing(text, at, "the number is too large"))
            }
        }
        Rule::name => {
            let name = pair.as_str();
            let value = names
                .iter()
                .position(|known| known == name)
                .map(Step::Value);
            let constant = || {
                CONSTANTS
                    .iter()
                    .find(|(known, _)| *known == name)
                    .map(|(_, value)| Step::Number(*value))
            };
            let step = value.or_else(constant).ok_or_else(|| {
                let hint = if is_function(name) {
                    format!(": {name} is a function and needs brackets")
                } else {
                    String::new()
                };
                pointing(
                    text,
                    at,
                    &format!(
                        "unknown name \"{name}\"{hint}; known are {}, pi, E",
                        names.join(", ")
                    ),
                )
            })?;
            Ok(vec![step])
        }
        Rule::call => call(pair, text, names),
        _ => steps_of_terms(pair.into_inner(), text, names),
    }
}

fn is_function(name: &str) -> bool {
    name == "if"
        || OF_ONE.iter().any(|(known, _)| *known == name)
        || OF_TWO.iter().any(|(known, ..)| *known == name)
}

fn call(pair: Pair<'_, Rule>, text: &str, names: &[String]) -> Result<Vec<Step>, String> {
    let at = pair.as_span().start();
    let mut inner = pair.into_inner();
    let name = inner.next().map_or("", |name| name.as_str());
    let arguments: Vec<Vec<Step>> = inner
        .map(|argument| steps_of(argument, text, names))
        .collect::<Result<_, _>>()?;
    let takes = |expected: &str| {
        Err(pointing(
            text,
            at,
            &format!("{name} takes {expected}, not {}", arguments.len()),
        ))
    };
    if let Some((name, function)) = OF_ONE.iter().find(|(known, _)| *known == name) {
        return if arguments.len() == 1 {
            Ok(with(arguments.concat(), Step::OfOne(name, *function)))
        } else {
            takes("one number")
        };
    }
    if let Some((name, function, more)) = OF_TWO.iter().find(|(known, ..)| *known == name) {
        if arguments.len() < 2 || (arguments.len() > 2 && !more) {
            return takes(if *more {
                "two numbers or more"
            } else {
                "two numbers"
            });
        }
        let mut steps = arguments[0].clone();
        for argument in &arguments[1..] {
            steps.extend(argument);
            steps.push(Step::OfTwo(name, *function));
        }
        return Ok(steps);
    }
    if name == "if" {
        return if arguments.len() == 3 {
            Ok(with(arguments.concat(), Step::Select))
        } else {
            takes("three numbers (condition, then, else)")
        };
    }
    let functions: Vec<&str> = OF_ONE
        .iter()
        .map(|(name, _)| *name)
        .chain(OF_TWO.iter().map(|(name, ..)| *name))
        .chain(["if"])
        .collect();
    Err(pointing(
        text,
        at,
        &format!(
            "unknown function \"{name}\"; known are {}",
            functions.join(", ")
        ),
    ))
}

/// What the grammar expected, in words.
fn expected(variant: &ErrorVariant<Rule>, text: &str, at: usize) -> String {
    let ErrorVariant::ParsingError { positives, .. } = variant else {
        return variant.message().into_owned();
    };
    let wants_value = positives.iter().any(|rule| {
        matches!(
            rule,
            Rule::number | Rule::name | Rule::call | Rule::sum_of_terms
        )
    });
    let found = match text[at..].chars().next() {
        Some(c) => format!("found \"{c}\""),
        None => "the expression ends".to_owned(),
    };
    let wanted = if wants_value {
        "a number, a name or a bracket"
    } else {
        "an operator, a closing bracket or the end"
    };
    format!("{found}; expected {wanted}")
}

/// A message about one character of an expression.
fn pointing(text: &str, at: usize, message: &str) -> String {
    format!(
        "character {} of \"{}\": {message}",
        text[..at].chars().count() + 1,
        text.replace(['\n', '\r', '\t'], " ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> f64 {
        let names = ["x".to_owned(), "max_um".to_owned()];
        Formula::read(text, &names)
            .unwrap_or_else(|e| panic!("{text}: {e}"))
            .evaluate(&[2.0, 7.0], &mut Vec::new())
    }

    #[test]
    fn values_are_those_of_arithmetic() {
        for (text, expected) in [
            ("1 + 2 * 3", 7.0),
            ("(1 + 2) * 3", 9.0),
            ("-2^2", -4.0),
            ("2^-1", 0.5),
            ("2^3^2", 512.0),
            ("8 / 4 / 2", 1.0),
            ("1 - 2 - 3", -4.0),
            ("2 - abs(-3) - 1", -2.0),
            ("max(1, min(2, 3))", 2.0),
            ("max(max(1, 2), max(3, 4), 0)", 4.0),
            ("max_um * x", 14.0),
            ("1e-3 + 1E3 + .5 + 2.", 1002.501),
            ("if(x > 1, 10, 20) + if(x > 3, 10, 20)", 30.0),
            ("and(x >= 2, x != 3, not(x == 5))", 1.0),
            ("sin(pi / 2) + 0 * E", 1.0),
            ("-x * -x", 4.0),
            ("signum(0) + signum(-x)", -1.0),
            ("(1 < x) == (x < 3)", 1.0),
            ("x\n + 1", 3.0),
        ] {
            assert!(
                (value(text) - expected).abs() < 1e-12,
                "{text}: {}",
                value(text)
            );
        }
        assert!((value("coth(x)") - 2.0_f64.cosh() / 2.0_f64.sinh()).abs() < 1e-15);
        assert!((value("langevin(0.009999)") - value("langevin(0.010001)")).abs() < 1e-6);
        assert!((value("langevin(0.0100001)") - 0.010_000_1 / 3.0).abs() < 1e-7);
        assert!(value("langevin(0)").abs() < 1e-15 && value("ln(-1)").is_nan());
    }

    #[test]
    fn errors_point_at_the_character() {
        let names = ["x".to_owned()];
        for (text, at, said) in [
            ("x + * 2", 5, "found \"*\""),
            ("x + q", 5, "unknown name \"q\""),
            ("2 * (x + 1", 11, "the expression ends"),
            ("x)", 2, "found \")\""),
            ("", 1, "the expression ends"),
            ("x 2", 3, "found \"2\""),
            ("foo(x)", 1, "unknown function \"foo\""),
            ("1 + atan2(x)", 5, "atan2 takes two numbers, not 1"),
            ("2 * sin", 5, "needs brackets"),
            ("1e999", 1, "too large"),
            ("1 < x < 3", 7, "and("),
            ("\u{b5} + \u{3b1} ? x", 7, "found \"?\""),
        ] {
            let message = Formula::read(text, &names).unwrap_err();
            assert!(
                message.contains(&format!("character {at} of")) && message.contains(said),
                "{text}: {message}"
            );
        }
        let deep = "(".repeat(5000) + "x";
        assert!(Formula::read(&deep, &names).is_err());
        assert!(
            Formula::read(&("(".repeat(60) + "x" + &")".repeat(60)), &names)
                .unwrap_err()
                .contains("deeply")
        );
    }

    proptest::proptest! {
        #[test]
        fn no_text_is_a_panic(text in "[x0-9e+*/^<>=!(),. -]{0,60}") {
            if let Ok(formula) = Formula::read(&text, &["x".to_owned()]) {
                let _ = formula.evaluate(&[1.5], &mut Vec::new());
            }
        }
    }
}
