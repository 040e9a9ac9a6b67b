//! A model as a Python module that needs NumPy alone.

use super::{Argument, Carry, Exported, arguments, carried, head, needed, number};
use hysteron_sim::block::PAIRS;
use hysteron_sim::intersample::Intersample;
use std::fmt::Write;

const BLOCKS: &str = include_str!("blocks.py");

/// Where the drive stands at the end of each sub-interval, and what a start adds.
const BETWEEN: &str = "\n\ndef _between(x, weights):
    reach = len(weights[0]) // 2 if weights else 1
    padded = np.concatenate((np.full(reach - 1, x[0]), x, np.full(reach + 1, x[-1])))
    parts = [np.correlate(padded, w, 'valid')[: len(x)] for w in weights]
    return np.column_stack(parts + [padded[reach : reach + len(x)]]).ravel()
";
const START: &str = "\n\ndef _start(first_v, samples):
    t = np.arange(samples) / SAMPLE_RATE_HZ
    y = np.full(samples, OFFSET_UM)
    if abs(first_v - START_V) <= NEAR_V:
        for decay, frequency, cosine, sine in MOTIONS:
            y += np.exp(-decay * t) * (cosine * np.cos(frequency * t) + sine * np.sin(frequency * t))
    return y
";

pub(super) fn text(exported: &Exported) -> String {
    let Exported {
        chain, name, start, ..
    } = *exported;
    let mut out = format!(
        "\"\"\"{}\"\"\"\n\nimport math\n\nimport numpy as np\n\n",
        head(exported).join("\n").replace('\\', "/")
    );
    // Writing to a text cannot fail.
    let _ = writeln!(
        out,
        "SAMPLE_RATE_HZ = {}\nDRIVE_MIN_V = {}\nDRIVE_MAX_V = {}\nPAIRS = {PAIRS}",
        number(1.0 / chain.dt_s),
        number(chain.drive_min_v),
        number(chain.drive_max_v)
    );
    if exported.adds() {
        let _ = writeln!(
            out,
            "START_V = {}\nNEAR_V = {}\nOFFSET_UM = {}\nMOTIONS = {}",
            number(start.drive_v),
            number(exported.near_v),
            number(start.offset_um),
            argument(&Argument::Rows(exported.motions()))
        );
        out.push_str(START);
    }
    out.push_str(&needed(BLOCKS, chain, "#"));
    let between = chain.intersample.between(chain.substeps);
    if chain.intersample != Intersample::Hold {
        out.push_str(BETWEEN);
    }
    let force = if chain.takes_force() { "force_n, " } else { "" };
    let force_doc = if chain.takes_force() {
        " under a measured force (N)"
    } else {
        ""
    };
    let _ = write!(
        out,
        "\n\ndef {name}(drive_v, {force}settled=None):\n    \"\"\"Reading (um) at every sample of a drive (V){force_doc}.\n\n    A virgin actuator rests at DRIVE_MIN_V before the \
         first sample, a settled one at the first drive; it begins as the records of the model where nothing is said.\n    \"\"\"\n    x = np.array(drive_v, dtype=float)\n"
    );
    if exported.shifted {
        out.push_str("    x = np.append(x[1:], x[-1:])\n");
    }
    let _ = writeln!(
        out,
        "    samples, first = len(x), float(x[0])\n    rest = first if {} else DRIVE_MIN_V",
        if exported.begins_settled() {
            "settled is None or settled"
        } else {
            "settled"
        }
    );
    if chain.intersample != Intersample::Hold {
        let _ = writeln!(
            out,
            "    x = _between(x, {})",
            argument(&Argument::Rows(between))
        );
    }
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
    out.push_str("    y = np.concatenate(([rest], x))[:samples]\n");
    out.push_str(if exported.adds() {
        "    return y + _start(first, samples) if settled is None else y\n"
    } else {
        "    return y\n"
    });
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
