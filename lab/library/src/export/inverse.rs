//! The inverse of a model's loops and creep as C99 or MATLAB: the drive that takes them to a displacement,
//! sample by sample, by bisection on a copy of their memory. Modes, sensor and what depends on the rate are
//! left out: they are the feedback's.

use super::c;
use super::language::Language;
use super::laws::{Dialect, uses};
use super::text::{cannot, described, fitted, identifier, number};
use crate::error::{Error, Result};
use crate::servo::model::least_slope;
use hysteron_sim::block_chain::BlockChain;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{Place, rate_dependence};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::law::Law;
use std::fmt::Write;

/// Halvings of the range: a double has 53 bits.
const HALVINGS: usize = 52;

/// The text of the inverse of a model's loops and creep in a language, at a sampling rate; `name` is what its
/// function is called.
///
/// # Errors
/// The model has no loops, or some that no law describes; a language that has no inverse.
pub fn inverse(
    model: &Model,
    language: Language,
    sample_rate_hz: f64,
    name: &str,
) -> Result<String> {
    let refused = |what: &str| Error::new("export --inverse", what);
    let mut loops = model.clone();
    loops.effects.retain(|e| {
        let place = e.effect.declaration().place;
        e.id != rate_dependence::ID && [Place::Hysteresis, Place::Creep].contains(&place)
    });
    if !loops
        .effects
        .iter()
        .any(|e| e.effect.declaration().is_main())
    {
        return Err(refused(
            "the model has neither loops nor a gain; expected one of them",
        ));
    }
    if let Some(slope) = least_slope(model).filter(|slope| slope.is_nan() || *slope <= 0.0) {
        return Err(refused(&format!(
            "the loops cannot be inverted: a section has a slope of {slope:.2} times the mean one, so a displacement has several drives; record nested loops over the whole range"
        )));
    }
    let chain = BlockChain::of(&loops, 1.0 / sample_rate_hz, Intersample::Hold)
        .map_err(|refused| cannot(&refused))?;
    if chain.blocks.iter().any(|placed| placed.fine) {
        return Err(refused(
            "the loops go in parts of a sample; expected a higher --rate-hz",
        ));
    }
    let laws: Vec<Law> = chain
        .blocks
        .iter()
        .map(|placed| placed.block.law())
        .collect();
    let mut said = vec![
        format!(
            "Inverse of loops and creep of a piezoelectric actuator, exported by Hysteron {}.",
            env!("CARGO_PKG_VERSION")
        ),
        format!(
            "Wanted displacement in um, {sample_rate_hz} samples per second; drive in V from {} to {}, its limit where no drive reaches.",
            chain.drive_min_v, chain.drive_max_v
        ),
        format!(
            "Begins virgin at {} V. Modes and sensor of the model are left out.",
            chain.virgin_v
        ),
    ];
    said.extend(fitted(model));
    said.push(String::new());
    said.extend(described(&loops));
    let name = identifier(name);
    match language {
        Language::C => Ok(in_c(&chain, &laws, &said, &name)),
        Language::Matlab => Ok(in_matlab(&chain, &laws, &said, &name)),
        Language::Python | Language::StateSpace => Err(refused("expected --as c or --as matlab")),
    }
}

fn in_c(chain: &BlockChain, laws: &[Law], said: &[String], name: &str) -> String {
    let mut out = String::from("/*\n");
    // Writing to a text cannot fail.
    for line in said {
        let _ = writeln!(out, " * {}", line.replace("*/", "* /"));
    }
    let _ = write!(
        out,
        " *\n * {name}_init begins; {name}_step takes the wanted displacement and gives the drive. No memory is allocated.\n */\n#include <math.h>\n\n\
         #define {name}_DRIVE_MIN_V {}\n#define {name}_DRIVE_MAX_V {}\n#define {name}_VIRGIN_V {}\n\ntypedef struct {{\n    double drive;\n{}}} {name}_state;\n",
        number(chain.drive_min_v),
        number(chain.drive_max_v),
        number(chain.virgin_v),
        c::fields(laws)
    );
    for (i, law) in laws.iter().enumerate() {
        out.push_str(&c::functions(i, law, name));
    }
    let each = |line: &dyn Fn(usize) -> String| (0..laws.len()).map(line).collect::<String>();
    let steps = each(&|i| format!("    x = b{i}_step(m, x);\n"));
    let begins = each(&|i| format!("    b{i}_begin(m, x);\n    x = b{i}_step(m, x);\n"));
    let _ = write!(
        out,
        "\nstatic double h_loops({name}_state *m, double x)\n{{\n{steps}    return x;\n}}\n\n\
         static double h_tried(const {name}_state *m, double drive_v)\n{{\n    {name}_state trial = *m;\n    return h_loops(&trial, drive_v);\n}}\n\n\
         void {name}_init({name}_state *m)\n{{\n    double x = {name}_VIRGIN_V;\n    m->drive = x;\n{begins}}}\n\n\
         double {name}_step({name}_state *m, double wanted_um)\n{{\n    double low = {name}_DRIVE_MIN_V, high = {name}_DRIVE_MAX_V;\n    \
         int rises = h_tried(m, high) >= h_tried(m, low);\n    for (int i = 0; i < {HALVINGS}; i++) {{\n        double middle = 0.5 * (low + high);\n        \
         if ((h_tried(m, middle) < wanted_um) == rises) low = middle; else high = middle;\n    }}\n    \
         m->drive = 0.5 * (low + high);\n    h_loops(m, m->drive);\n    return m->drive;\n}}\n"
    );
    out
}

fn in_matlab(chain: &BlockChain, laws: &[Law], said: &[String], name: &str) -> String {
    let mut out = format!(
        "function drive_v = {name}(wanted_um)\n  % {name}  Drive (V) for every wanted displacement (um).\n  %\n"
    );
    for line in said {
        let _ = writeln!(out, "  % {line}");
    }
    let (low, high) = (number(chain.drive_min_v), number(chain.drive_max_v));
    let _ = write!(
        out,
        "  s = h_begin();\n  drive_v = zeros(size(wanted_um));\n  for k = 1:numel(wanted_um)\n    low = {low};\n    high = {high};\n    \
         rises = h_loops(s, high) >= h_loops(s, low);\n    for i = 1:{HALVINGS}\n      middle = 0.5 * (low + high);\n      \
         if (h_loops(s, middle) < wanted_um(k)) == rises\n        low = middle;\n      else\n        high = middle;\n      end\n    end\n    \
         drive_v(k) = 0.5 * (low + high);\n    [~, s] = h_loops(s, drive_v(k));\n  end\nend\n"
    );
    let mut begins = String::new();
    let mut steps = String::new();
    let mut functions = String::new();
    for (i, law) in laws.iter().enumerate() {
        let own = |word: &str| {
            if law.states.iter().any(|state| state.name == word) {
                format!("s.b{i}_{word}")
            } else {
                word.to_owned()
            }
        };
        let body = |lines: &str| {
            let used = law.numbers.iter().filter(|(word, _)| uses(lines, word));
            let number = |(word, value)| format!("  {word} = {};\n", Dialect::Matlab.number(value));
            let numbers: String = used.map(|(word, value)| number((word, value))).collect();
            numbers + &Dialect::Matlab.lines(lines, 1, &own)
        };
        for state in &law.states {
            let zero = state
                .size
                .map_or("0".into(), |size| format!("zeros(1, {size})"));
            let _ = writeln!(begins, "  {} = {zero};", own(&state.name));
        }
        begins += &body(&law.begin);
        let _ = writeln!(begins, "  [x, s] = h_b{i}(s, x);");
        let _ = writeln!(steps, "  [x, s] = h_b{i}(s, x);");
        let _ = write!(
            functions,
            "\nfunction [y, s] = h_b{i}(s, x)\n{}end\n",
            body(&law.step)
        );
    }
    let _ = write!(
        out,
        "\nfunction s = h_begin()\n  s = struct();\n  x = {};\n{begins}end\n\nfunction [x, s] = h_loops(s, x)\n{steps}end\n{functions}",
        number(chain.virgin_v)
    );
    out
}
