//! A model as a Python module that needs NumPy alone.

use super::laws::{Dialect, uses};
use super::text::{Exported, head, number, rows};
use hysteron_sim::intersample::Intersample;
use std::fmt::Write;

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
        "SAMPLE_RATE_HZ = {}\nDRIVE_MIN_V = {}\nDRIVE_MAX_V = {}\nVIRGIN_V = {}",
        number(1.0 / chain.dt_s),
        number(chain.drive_min_v),
        number(chain.drive_max_v),
        number(chain.virgin_v)
    );
    if exported.adds() {
        let _ = writeln!(
            out,
            "START_V = {}\nNEAR_V = {}\nOFFSET_UM = {}\nMOTIONS = [{}]",
            number(start.drive_v),
            number(exported.near_v),
            number(start.offset_um),
            rows(&exported.motions(), ["[", "]"], ", ")
        );
        out.push_str(START);
    }
    let runs_on = chain.intersample != Intersample::Hold;
    if runs_on {
        out.push_str(BETWEEN);
    }
    let (force, force_doc) = if chain.takes_force() {
        ("force_n, ", " under a measured force (N)")
    } else {
        ("", "")
    };
    let _ = write!(
        out,
        "\n\ndef {name}(drive_v, {force}settled=None):\n    \"\"\"Reading (um) at every sample of a drive (V){force_doc}.\n\n    A virgin actuator rests at VIRGIN_V before the \
         first sample, a settled one at the first drive; it begins as the records of the model where nothing is said.\n    \"\"\"\n    drive = np.array(drive_v, dtype=float)\n"
    );
    if exported.shifted {
        out.push_str("    drive = np.append(drive[1:], drive[-1:])\n");
    }
    let settled = if exported.begins_settled() {
        "settled is None or settled"
    } else {
        "settled"
    };
    let _ = writeln!(
        out,
        "    samples, first_v = len(drive), float(drive[0])\n    rest = first_v if {settled} else VIRGIN_V"
    );
    if runs_on {
        let between = chain.intersample.between(chain.substeps);
        let _ = writeln!(
            out,
            "    drive = _between(drive, [{}])",
            rows(&between, ["[", "]"], ", ")
        );
    }
    out.push_str("    signal = [rest] + drive.tolist()  # at rest, then interval by interval\n");
    let own = |name: &str| name.to_owned();
    let (mut fine, n) = (runs_on && chain.substeps > 1, chain.substeps);
    for placed in &chain.blocks {
        if placed.fine && !fine {
            let _ = writeln!(
                out,
                "    signal = signal[:1] + [x for x in signal[1:] for _ in range({n})]"
            );
        } else if fine && !placed.fine {
            let _ = writeln!(out, "    signal = signal[:1] + signal[{n}::{n}]");
        }
        fine = placed.fine;
        let law = placed.block.law();
        let _ = writeln!(out, "    # {}", placed.effect);
        for (name, value) in &law.numbers {
            let _ = writeln!(out, "    {name} = {}", Dialect::Python.number(value));
        }
        for state in &law.states {
            let zero = if state.counts { "0" } else { "0.0" };
            let _ = match state.size {
                Some(size) => writeln!(out, "    {} = [{zero}] * {size}", state.name),
                None => writeln!(out, "    {} = {zero}", state.name),
            };
        }
        out.push_str("    x = signal[0]\n");
        out.push_str(&Dialect::Python.lines(&law.begin, 1, &own));
        out.push_str("    for k, x in enumerate(signal):\n");
        if uses(&law.step, "force") {
            let substeps = if fine { n } else { 1 };
            let _ = writeln!(
                out,
                "        force = float(force_n[min(max(k - 1, 0) // {substeps}, len(force_n) - 1)])"
            );
        }
        out.push_str(&Dialect::Python.lines(&law.step, 2, &own));
        out.push_str("        signal[k] = y\n");
    }
    if fine {
        let _ = writeln!(out, "    signal = signal[:1] + signal[{n}::{n}]");
    }
    out.push_str("    reading_um = np.array(signal[:samples])\n");
    out.push_str(if exported.adds() {
        "    return reading_um + _start(first_v, samples) if settled is None else reading_um\n"
    } else {
        "    return reading_um\n"
    });
    out
}
