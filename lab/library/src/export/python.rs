//! A model as a Python module that needs NumPy alone.

use super::{Argument, Carry, arguments, carried, head, needed, number};
use hysteron_sim::block::{BlockChain, PAIRS};
use hysteron_sim::chain::Model;
use std::fmt::Write;

const BLOCKS: &str = include_str!("blocks.py");

pub(super) fn text(chain: &BlockChain, model: &Model, name: &str) -> String {
    let mut out = format!(
        "\"\"\"{}\"\"\"\n\nimport math\n\nimport numpy as np\n\n",
        head(chain, model).join("\n").replace('\\', "/")
    );
    // Writing to a text cannot fail.
    let _ = writeln!(
        out,
        "SAMPLE_RATE_HZ = {}\nDRIVE_MIN_V = {}\nDRIVE_MAX_V = {}\nPAIRS = {PAIRS}",
        number(1.0 / chain.dt_s),
        number(chain.drive_min_v),
        number(chain.drive_max_v)
    );
    out.push_str(&needed(BLOCKS, chain, "#"));
    let force = if chain.takes_force() { "force_n, " } else { "" };
    let force_doc = if chain.takes_force() {
        " under a measured force (N)"
    } else {
        ""
    };
    let _ = write!(
        out,
        "\n\ndef {name}(drive_v, {force}settled=False):\n    \"\"\"Reading (um) at every sample of a drive (V){force_doc}.\n\n    A virgin actuator rests at DRIVE_MIN_V before the \
         first sample, a settled one at the first drive.\n    \"\"\"\n    x = np.array(drive_v, dtype=float)\n    samples = len(x)\n    rest = float(x[0]) if settled else DRIVE_MIN_V\n"
    );
    for step in carried(chain) {
        let _ = match step {
            Carry::Refine => writeln!(out, "    x = np.repeat(x, {})", chain.substeps),
            Carry::Coarsen => {
                writeln!(out, "    x = x[{}::{}]", chain.substeps - 1, chain.substeps)
            }
            Carry::Block {
                effect,
                block,
                substeps,
            } => {
                let values: Vec<String> = arguments(block, substeps).iter().map(argument).collect();
                writeln!(
                    out,
                    "    x, rest = _{}(x, rest, {})  # {effect}",
                    block.name(),
                    values.join(", ")
                )
            }
        };
    }
    out.push_str("    return np.concatenate(([rest], x))[:samples]\n");
    out
}

fn row(values: &[f64]) -> String {
    format!(
        "[{}]",
        values
            .iter()
            .map(|v| number(*v))
            .collect::<Vec<_>>()
            .join(", ")
    )
}

fn argument(argument: &Argument) -> String {
    match argument {
        Argument::Number(value) => number(*value),
        Argument::Flag(value) => if *value { "True" } else { "False" }.into(),
        Argument::Count(value) => value.to_string(),
        Argument::Row(values) | Argument::Column(values) => row(values),
        Argument::Rows(rows) => format!(
            "[{}]",
            rows.iter().map(|r| row(r)).collect::<Vec<_>>().join(", ")
        ),
        Argument::Nothing => "None".into(),
        Argument::Force => "np.asarray(force_n, dtype=float)".into(),
    }
}
