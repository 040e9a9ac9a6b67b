//! A model as C99 with fixed memory: one structure with all states, one function for each sample.

use super::laws::{Dialect, locals, uses};
use super::text::{Exported, head, number, rows};
use hysteron_sim::intersample::Intersample;
use hysteron_sim::law::{Law, LawNumber};
use std::fmt::Write;

/// What a start adds at sample `n`.
const START: &str = "
static double h_start(double n, int with_motions)
{
    double y = H_OFFSET_UM, t = n / H_RATE;
    for (int i = 0; with_motions && i < H_MOTIONS; i++) {
        const double *m = h_motions[i];
        y += exp(-m[0] * t) * (m[2] * cos(m[1] * t) + m[3] * sin(m[1] * t));
    }
    return y;
}
";

/// One block: what puts it at rest, and one interval of it.
pub(super) fn functions(i: usize, law: &Law, name: &str) -> String {
    let own = |word: &str| {
        if law.states.iter().any(|state| state.name == word) {
            format!("m->b{i}_{word}")
        } else {
            word.to_owned()
        }
    };
    let body = |lines: &str| {
        let mut out = String::new();
        for (word, value) in law.numbers.iter().filter(|(word, _)| uses(lines, word)) {
            let (kind, list) = match value {
                LawNumber::Value(_) => ("const double", ""),
                LawNumber::Count(_) => ("const int", ""),
                LawNumber::List(_) => ("static const double", "[]"),
            };
            out += &format!("    {kind} {word}{list} = {};\n", Dialect::C.number(value));
        }
        let locals = locals(law, lines);
        if !locals.is_empty() {
            out += &format!("    double {};\n", locals.join(", "));
        }
        out + "    (void)m;\n" + &Dialect::C.lines(lines, 1, &own)
    };
    let zero = |state: &hysteron_sim::law::LawState| match state.size {
        Some(size) => format!(
            "    for (int i = 0; i < {size}; i++) m->b{i}_{}[i] = 0;\n",
            state.name
        ),
        None => format!("    m->b{i}_{} = 0;\n", state.name),
    };
    let zeros: String = law.states.iter().map(zero).collect();
    let force = if uses(&law.step, "force") {
        ", double force"
    } else {
        ""
    };
    format!(
        "\nstatic void b{i}_begin({name}_state *m, double x)\n{{\n    (void)x;\n{zeros}{}}}\n\nstatic double b{i}_step({name}_state *m, double x{force})\n{{\n{}    return y;\n}}\n",
        body(&law.begin),
        body(&law.step)
    )
}

/// The fields of a structure that holds the states.
pub(super) fn fields(laws: &[Law]) -> String {
    let mut out = String::new();
    for (i, law) in laws.iter().enumerate() {
        for state in &law.states {
            let kind = if state.counts { "int" } else { "double" };
            let _ = match state.size {
                Some(size) => writeln!(out, "    {kind} b{i}_{}[{}];", state.name, size.max(1)),
                None => writeln!(out, "    {kind} b{i}_{};", state.name),
            };
        }
    }
    out
}

pub(super) fn text(exported: &Exported) -> String {
    let Exported {
        chain, name, start, ..
    } = *exported;
    let (runs_on, adds) = (chain.intersample != Intersample::Hold, exported.adds());
    let laws: Vec<Law> = chain
        .blocks
        .iter()
        .map(|placed| placed.block.law())
        .collect();
    let mut out = String::from("/*\n");
    // Writing to a text cannot fail.
    for line in head(exported) {
        let _ = writeln!(out, " * {}", line.replace("*/", "* /"));
    }
    let force = if chain.takes_force() {
        ", double force_n"
    } else {
        ""
    };
    let takes = if runs_on {
        "at the next sample"
    } else {
        "that acts from a sample on"
    };
    let _ = write!(
        out,
        " *\n * {name}_begin begins as the records of the model, by the first drive, and gives the reading at the first sample; {name}_init puts it at rest at a drive\n \
         * ({name}_VIRGIN_V is the virgin state). {name}_step takes the drive {takes} and gives the reading at the next sample. No memory is allocated.\n */\n#include <math.h>\n\n"
    );
    let _ = writeln!(
        out,
        "#define {name}_SAMPLE_RATE_HZ {}\n#define {name}_DRIVE_MIN_V {}\n#define {name}_DRIVE_MAX_V {}\n#define {name}_VIRGIN_V {}",
        number(1.0 / chain.dt_s),
        number(chain.drive_min_v),
        number(chain.drive_max_v),
        number(chain.virgin_v)
    );
    if adds {
        let motions = exported.motions();
        let table = if motions.is_empty() {
            "{ 0.0 }".into()
        } else {
            rows(&motions, ["{ ", " }"], ", ")
        };
        let _ = writeln!(
            out,
            "#define H_OFFSET_UM {}\n#define H_RATE {}\n#define H_MOTIONS {}\nstatic const double h_motions[][4] = {{ {table} }};",
            number(start.offset_um),
            number(1.0 / chain.dt_s),
            motions.len()
        );
        out.push_str(START);
    }
    out.push_str("\ntypedef struct {\n    double drive, sample;\n    int begins;\n");
    out.push_str(&fields(&laws));
    let _ = writeln!(out, "}} {name}_state;");
    for (i, law) in laws.iter().enumerate() {
        out.push_str(&functions(i, law, name));
    }
    let step = |i: usize| {
        let force = if uses(&laws[i].step, "force") {
            ", force_n"
        } else {
            ""
        };
        format!("b{i}_step(m, x{force})")
    };
    let _ = write!(
        out,
        "\ndouble {name}_init({name}_state *m, double drive_v{force})\n{{\n    double x = drive_v;\n    m->drive = drive_v;\n    m->sample = 0.0;\n    m->begins = 0;\n"
    );
    for (i, placed) in chain.blocks.iter().enumerate() {
        let _ = writeln!(
            out,
            "    b{i}_begin(m, x); /* {} */\n    x = {};",
            placed.effect,
            step(i)
        );
    }
    let rest = if exported.begins_settled() {
        "drive_v".into()
    } else {
        format!("{name}_VIRGIN_V")
    };
    let passed = if force.is_empty() { "" } else { ", force_n" };
    let _ = write!(
        out,
        "    return x;\n}}\n\ndouble {name}_begin({name}_state *m, double drive_v{force})\n{{\n    double x = {name}_init(m, {rest}{passed});\n    m->drive = drive_v;\n"
    );
    if adds {
        let _ = writeln!(
            out,
            "    m->begins = fabs(drive_v - {}) <= {} ? 2 : 1;\n    x += h_start(0.0, m->begins == 2);",
            number(start.drive_v),
            number(exported.near_v)
        );
    }
    let _ = write!(
        out,
        "    return x;\n}}\n\ndouble {name}_step({name}_state *m, double drive_v{force})\n{{\n    double x = drive_v;\n"
    );
    let (mut fine, n) = (false, chain.substeps);
    if chain.blocks.iter().any(|placed| placed.fine) {
        let _ = writeln!(out, "    double v[{n}];");
    }
    for (i, placed) in chain.blocks.iter().enumerate() {
        if placed.fine != fine {
            fine = placed.fine;
            let _ = if !fine {
                writeln!(out, "    x = v[{}];", n - 1)
            } else if runs_on {
                writeln!(
                    out,
                    "    for (int k = 0; k < {n}; k++) v[k] = m->drive + (x - m->drive) * (k + 1.0) / {n};"
                )
            } else {
                writeln!(out, "    for (int k = 0; k < {n}; k++) v[k] = x;")
            };
        }
        let _ = if fine {
            writeln!(
                out,
                "    for (int k = 0; k < {n}; k++) {{ /* {} */\n        x = v[k];\n        v[k] = {};\n    }}",
                placed.effect,
                step(i)
            )
        } else {
            writeln!(out, "    x = {}; /* {} */", step(i), placed.effect)
        };
    }
    if fine {
        let _ = writeln!(out, "    x = v[{}];", n - 1);
    }
    out.push_str("    m->drive = drive_v;\n    m->sample += 1.0;\n");
    if adds {
        out.push_str("    if (m->begins) x += h_start(m->sample, m->begins == 2);\n");
    }
    out.push_str("    return x;\n}\n");
    out
}
