//! A model as C99 with fixed memory: one structure with all states, one function for each sample.

use super::{Exported, head, needed, number, pairs};
use hysteron_sim::block::{Block, Linear, PAIRS, Placed};
use hysteron_sim::intersample::Intersample;
use std::fmt::Write;

const BLOCKS: &str = include_str!("blocks.c");

/// What a block is made of in C.
#[derive(Default)]
struct Written {
    /// Constants.
    constants: String,
    /// Fields of the structure.
    fields: String,
    /// What puts it at rest: a statement that carries `x` on.
    rest: String,
    /// One interval: an expression of `x`.
    step: String,
}

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

pub(super) fn text(exported: &Exported) -> String {
    let Exported {
        chain, name, start, ..
    } = *exported;
    let (runs_on, adds) = (chain.intersample != Intersample::Hold, exported.adds());
    let blocks: Vec<Written> = chain
        .blocks
        .iter()
        .enumerate()
        .map(|(i, placed)| written(i, placed))
        .collect();
    let states = chain
        .blocks
        .iter()
        .map(|placed| {
            if let Block::Linear(l) = &placed.block {
                l.rest.len()
            } else {
                0
            }
        })
        .max()
        .unwrap_or(0);
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
    let _ = write!(
        out,
        " *\n * {name}_begin begins as the records of the model, by the first drive, and gives the reading at the first sample; {name}_init puts it at rest at a drive\n \
         * ({name}_DRIVE_MIN_V is the virgin state). {name}_step takes the drive {} and gives the reading at the next sample. No memory is allocated.\n */\n#include <math.h>\n\n",
        if runs_on {
            "at the next sample"
        } else {
            "that acts from a sample on"
        }
    );
    let _ = writeln!(
        out,
        "#define {name}_SAMPLE_RATE_HZ {}\n#define {name}_DRIVE_MIN_V {}\n#define {name}_DRIVE_MAX_V {}",
        number(1.0 / chain.dt_s),
        number(chain.drive_min_v),
        number(chain.drive_max_v)
    );
    let _ = writeln!(
        out,
        "#define H_PAIRS {PAIRS}\n#define H_STATES_MAX {}",
        states.max(1)
    );
    if adds {
        let motions = exported.motions();
        let _ = writeln!(
            out,
            "#define H_OFFSET_UM {}\n#define H_RATE {}\n#define H_MOTIONS {}",
            number(start.offset_um),
            number(1.0 / chain.dt_s),
            motions.len()
        );
        out.push_str(&table("h_motions", 4, &motions));
        out.push_str(START);
    }
    out.push_str(&needed(BLOCKS, chain, "/*"));
    out.push('\n');
    blocks
        .iter()
        .for_each(|block| out.push_str(&block.constants));
    let mut fields: String = blocks.iter().map(|block| block.fields.as_str()).collect();
    if runs_on {
        fields += "    double drive;\n";
    }
    if adds {
        fields += "    double sample;\n    int begins;\n";
    }
    let _ = write!(
        out,
        "\ntypedef struct {{\n{}}} {name}_state;\n",
        if fields.is_empty() {
            "    char none;\n".into()
        } else {
            fields
        }
    );
    let _ = write!(
        out,
        "\ndouble {name}_init({name}_state *m, double drive_v{force})\n{{\n    double x = drive_v;\n    (void)m;\n{}{}",
        if runs_on {
            "    m->drive = drive_v;\n"
        } else {
            ""
        },
        if adds {
            "    m->sample = 0.0;\n    m->begins = 0;\n"
        } else {
            ""
        }
    );
    for (block, placed) in blocks.iter().zip(&chain.blocks) {
        let _ = writeln!(out, "    {} /* {} */", block.rest, placed.effect);
    }
    let _ = write!(
        out,
        "    return x;\n}}\n\ndouble {name}_begin({name}_state *m, double drive_v{force})\n{{\n    double x = {name}_init(m, {}{});\n{}",
        if exported.begins_settled() {
            "drive_v".into()
        } else {
            format!("{name}_DRIVE_MIN_V")
        },
        if force.is_empty() { "" } else { ", force_n" },
        if runs_on {
            "    m->drive = drive_v;\n"
        } else {
            ""
        },
    );
    let _ = if adds {
        writeln!(
            out,
            "    m->begins = fabs(drive_v - {}) <= {} ? 2 : 1;\n    return x + h_start(0.0, m->begins == 2);\n}}\n",
            number(start.drive_v),
            number(exported.near_v)
        )
    } else {
        writeln!(out, "    (void)drive_v;\n    return x;\n}}\n")
    };
    let _ = writeln!(
        out,
        "double {name}_step({name}_state *m, double drive_v{force})\n{{"
    );
    let n = chain.substeps;
    let _ = writeln!(out, "    double x = drive_v;\n    (void)m;");
    let mut fine = false;
    if chain.blocks.iter().any(|placed| placed.fine) {
        let _ = writeln!(out, "    double v[{n}];");
    }
    for (block, placed) in blocks.iter().zip(&chain.blocks) {
        if placed.fine != fine {
            fine = placed.fine;
            let _ = if fine && runs_on {
                writeln!(
                    out,
                    "    for (int k = 0; k < {n}; k++) v[k] = m->drive + (x - m->drive) * (k + 1.0) / {n};\n    m->drive = x;"
                )
            } else if fine {
                writeln!(out, "    for (int k = 0; k < {n}; k++) v[k] = x;")
            } else {
                writeln!(out, "    x = v[{}];", n - 1)
            };
        }
        let _ = if fine {
            writeln!(
                out,
                "    for (int k = 0; k < {n}; k++) {{ /* {} */\n        x = v[k];\n        v[k] = {};\n    }}",
                placed.effect, block.step
            )
        } else {
            writeln!(out, "    x = {}; /* {} */", block.step, placed.effect)
        };
    }
    if fine {
        let _ = writeln!(out, "    x = v[{}];", n - 1);
    }
    if adds {
        out.push_str(
            "    m->sample += 1.0;\n    if (m->begins) x += h_start(m->sample, m->begins == 2);\n",
        );
    }
    out.push_str("    return x;\n}\n");
    out
}

fn row(values: &[f64]) -> String {
    if values.is_empty() {
        "0.0".into()
    } else {
        values
            .iter()
            .map(|v| number(*v))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

fn array(name: &str, values: &[f64]) -> String {
    format!("static const double {name}[] = {{ {} }};\n", row(values))
}

fn table(name: &str, width: usize, rows: &[Vec<f64>]) -> String {
    let rows: Vec<String> = if rows.is_empty() {
        vec![row(&vec![0.0; width])]
    } else {
        rows.iter().map(|r| row(r)).collect()
    };
    format!(
        "static const double {name}[][{width}] = {{ {} }};\n",
        rows.iter()
            .map(|r| format!("{{ {r} }}"))
            .collect::<Vec<_>>()
            .join(", ")
    )
}

fn written(i: usize, placed: &Placed) -> Written {
    let b = format!("b{i}");
    // A block without states does the same at rest.
    let plain = |step: String| Written {
        rest: format!("x = {step};"),
        step,
        ..Written::default()
    };
    match &placed.block {
        Block::Proportional { gain, offset } => {
            plain(format!("{} * (x - {})", number(*gain), number(*offset)))
        }
        Block::Clamp { lower, upper } => plain(format!(
            "fmax(fmin(x, {}), {})",
            number(*upper),
            number(*lower)
        )),
        Block::Bend { quadratic, cubic } => plain(format!(
            "x * (1.0 + x * ({} + x * {}))",
            number(*quadratic),
            number(*cubic)
        )),
        Block::Force { compliance } => plain(format!("x + {} * force_n", number(*compliance))),
        Block::Gap { half } => Written {
            fields: format!("    double {b};\n"),
            rest: format!("m->{b} = x;"),
            step: format!(
                "(m->{b} = fmin(fmax(m->{b}, x - {0}), x + {0}))",
                number(*half)
            ),
            ..Written::default()
        },
        Block::Slope { most, gives_mean } => Written {
            fields: format!("    double {b};\n"),
            rest: format!("m->{b} = x;"),
            step: format!(
                "h_slope({}, {}, &m->{b}, x)",
                number(*most),
                i32::from(*gives_mean)
            ),
            ..Written::default()
        },
        Block::Linear(l) => linear(&b, l),
        Block::Delay { whole, late_share } => Written {
            fields: format!("    double {b}[{}];\n    int {b}_at;\n", whole + 1),
            rest: format!("for (int k = 0; k <= {whole}; k++) m->{b}[k] = x;\n    m->{b}_at = 0;"),
            step: format!(
                "h_delay({whole}, {}, m->{b}, &m->{b}_at, x)",
                number(*late_share)
            ),
            ..Written::default()
        },
        Block::Loops {
            g,
            r,
            plays,
            rate,
            lower,
            span,
        } => {
            let flat: Vec<f64> = g.iter().flatten().copied().collect();
            let law = rate.as_ref().map(|l| {
                vec![
                    l.loop_linear,
                    l.loop_quadratic,
                    l.curve_linear,
                    l.dt_s,
                    l.substeps as f64,
                ]
            });
            let constants = [
                array(&format!("{b}_g"), &flat),
                array(&format!("{b}_r"), r),
                table(&format!("{b}_plays"), 2, &pairs(plays)),
            ]
            .concat();
            let rate = law
                .as_ref()
                .map_or_else(|| "0".to_owned(), |_| format!("{b}_rate"));
            let values = format!(
                "({}, {b}_g, {}, {b}_r, {}, {b}_plays, {rate}, {}, {}, &m->{b}, m->{b}_plays, x)",
                g.len(),
                r.len(),
                plays.len(),
                number(*lower),
                number(*span)
            );
            Written {
                constants: constants
                    + &law.map_or_else(String::new, |law| array(&format!("{b}_rate"), &law)),
                fields: format!(
                    "    h_memory {b};\n    double {b}_plays[{}];\n",
                    plays.len().max(1)
                ),
                rest: format!("x = h_loops_rest{values};"),
                step: format!("h_loops{values}"),
            }
        }
        Block::Plays {
            plays,
            zones,
            lower,
            span,
        } => {
            let step = format!(
                "h_plays({}, {b}_plays, {}, {b}_zones, {}, {}, m->{b}, x)",
                plays.len(),
                zones.len(),
                number(*lower),
                number(*span)
            );
            Written {
                constants: table(&format!("{b}_plays"), 2, &pairs(plays))
                    + &table(&format!("{b}_zones"), 2, &pairs(zones)),
                fields: format!("    double {b}[{}];\n", plays.len().max(1)),
                rest: format!(
                    "for (int k = 0; k < {}; k++) m->{b}[k] = 0.0;\n    x = {step};",
                    plays.len()
                ),
                step,
            }
        }
        Block::Slip {
            gain,
            elements,
            lower,
            span,
        } => {
            let step = format!(
                "h_slip({}, {}, {b}_elements, {}, {}, m->{b}, &m->{b}_last, x)",
                number(*gain),
                elements.len(),
                number(*lower),
                number(*span)
            );
            Written {
                constants: table(&format!("{b}_elements"), 2, &pairs(elements)),
                fields: format!("    double {b}[{}], {b}_last;\n", elements.len().max(1)),
                rest: format!(
                    "for (int k = 0; k < {}; k++) m->{b}[k] = 0.0;\n    m->{b}_last = 0.0;\n    x = {step};",
                    elements.len()
                ),
                step,
            }
        }
        Block::BoucWen {
            gain,
            alpha,
            beta,
            gamma,
            lower,
            span,
        } => two_states(
            &b,
            "h_bouc_wen",
            &[*gain, *alpha, *beta, *gamma, *lower, *span],
        ),
        Block::Duhem {
            approach,
            slope,
            elastic,
            lower,
            span,
        } => two_states(&b, "h_duhem", &[*approach, *slope, *elastic, *lower, *span]),
        Block::Drift { rate, slowing } => Written {
            fields: format!("    double {b};\n"),
            rest: format!("m->{b} = 0.0;"),
            step: format!(
                "h_drift({}, {}, &m->{b}, x)",
                number(*rate),
                number(*slowing)
            ),
            ..Written::default()
        },
        Block::Lines(lines) => Written {
            constants: table(
                &format!("{b}_lines"),
                3,
                &lines.iter().map(|l| l.to_vec()).collect::<Vec<_>>(),
            ),
            fields: format!("    double {b};\n"),
            rest: format!(
                "m->{b} = 0.0;\n    x += {};",
                number(lines.iter().map(|l| l[2]).sum())
            ),
            step: format!("h_lines({}, {b}_lines, &m->{b}, x)", lines.len()),
        },
    }
}

fn two_states(b: &str, function: &str, values: &[f64]) -> Written {
    let step = format!("{function}({}, &m->{b}[0], &m->{b}[1], x)", row(values));
    Written {
        fields: format!("    double {b}[2];\n"),
        rest: format!("m->{b}[0] = m->{b}[1] = 0.0;\n    x = {step};"),
        step,
        ..Written::default()
    }
}

fn linear(b: &str, l: &Linear) -> Written {
    let n = l.rest.len();
    let flat: Vec<f64> = l.phi.iter().flatten().copied().collect();
    let constants = [
        ("phi", &flat),
        ("start", &l.start),
        ("end", &l.end),
        ("out", &l.out),
        ("rest", &l.rest),
    ]
    .map(|(what, values)| array(&format!("{b}_{what}"), values))
    .concat();
    let (before, through, offset) = (number(l.before), number(l.through), number(l.offset));
    Written {
        constants,
        fields: format!("    double {b}[{}], {b}_last;\n", n.max(1)),
        rest: format!(
            "x = h_linear_rest({n}, {b}_out, {before}, {through}, {b}_rest, {offset}, m->{b}, &m->{b}_last, x);"
        ),
        step: format!(
            "h_linear({n}, {b}_phi, {b}_start, {b}_end, {b}_out, {before}, {through}, {offset}, m->{b}, &m->{b}_last, x)"
        ),
    }
}
