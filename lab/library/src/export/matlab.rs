//! A model as a function file for MATLAB and Octave.

use super::laws::{Dialect, uses};
use super::text::{Exported, head, number, rows};
use hysteron_sim::intersample::Intersample;
use std::fmt::Write;

/// Where the drive stands at the end of each sub-interval; a row of weights for each of them.
const BETWEEN: &str = "
function x = h_between(x, weights)
  reach = max(size(weights, 2) / 2, 1);
  n = numel(x);
  padded = [x(1) * ones(1, reach - 1), x, x(n) * ones(1, reach + 1)];
  parts = zeros(size(weights, 1) + 1, n);
  for i = 1:size(weights, 1)
    along = conv(padded, fliplr(weights(i, :)), 'valid');
    parts(i, :) = along(1:n);
  end
  parts(end, :) = padded(reach + 1:reach + n);
  x = reshape(parts, 1, []);
end
";

pub(super) fn text(exported: &Exported) -> String {
    let Exported {
        chain, name, start, ..
    } = *exported;
    let force = if chain.takes_force() { ", force_n" } else { "" };
    let mut out = format!("function y_um = {name}(drive_v{force}, settled)\n");
    // Writing to a text cannot fail.
    let _ = writeln!(
        out,
        "  % {name}  Reading (um) at every sample of a drive (V).\n  %   y_um = {name}(drive_v{force}) begins as the records of the model.\n  %   y_um = {name}(drive_v{force}, false) simulates a virgin actuator, at rest at {} V before the first sample.\n  %   y_um = {name}(drive_v{force}, true) begins at rest at the first drive.\n  %",
        chain.virgin_v
    );
    for line in head(exported) {
        let _ = writeln!(out, "  % {line}");
    }
    let _ = write!(
        out,
        "  recorded = nargin < {};\n  if recorded\n    settled = {};\n  end\n  signal = drive_v(:)';\n{}  samples = numel(signal);\n  first_v = signal(1);\n  rest = {};\n  if settled\n    rest = first_v;\n  end\n",
        if chain.takes_force() { 3 } else { 2 },
        exported.begins_settled(),
        if exported.shifted {
            "  signal = [signal(2:end), signal(end)];\n"
        } else {
            ""
        },
        number(chain.virgin_v)
    );
    let runs_on = chain.intersample != Intersample::Hold;
    if runs_on {
        let between = chain.intersample.between(chain.substeps);
        let _ = writeln!(
            out,
            "  signal = h_between(signal, [{}]);",
            rows(&between, ["", ""], "; ")
        );
    }
    // At rest, then interval by interval.
    out.push_str("  signal = [rest, signal];\n");
    let own = |name: &str| name.to_owned();
    let (mut fine, n) = (runs_on && chain.substeps > 1, chain.substeps);
    for placed in &chain.blocks {
        if placed.fine && !fine {
            let _ = writeln!(
                out,
                "  signal = [signal(1), reshape(repmat(signal(2:end), {n}, 1), 1, [])];"
            );
        } else if fine && !placed.fine {
            let _ = writeln!(out, "  signal = [signal(1), signal({}:{n}:end)];", n + 1);
        }
        fine = placed.fine;
        let law = placed.block.law();
        let _ = writeln!(out, "  % {}", placed.effect);
        for (name, value) in &law.numbers {
            let _ = writeln!(out, "  {name} = {};", Dialect::Matlab.number(value));
        }
        for state in &law.states {
            let _ = match state.size {
                Some(size) => writeln!(out, "  {} = zeros(1, {size});", state.name),
                None => writeln!(out, "  {} = 0;", state.name),
            };
        }
        out.push_str("  x = signal(1);\n");
        out.push_str(&Dialect::Matlab.lines(&law.begin, 1, &own));
        out.push_str("  for k = 1:numel(signal)\n    x = signal(k);\n");
        if uses(&law.step, "force") {
            let substeps = if fine { n } else { 1 };
            let _ = writeln!(
                out,
                "    force = force_n(min(floor(max(k - 2, 0) / {substeps}) + 1, numel(force_n)));"
            );
        }
        out.push_str(&Dialect::Matlab.lines(&law.step, 2, &own));
        out.push_str("    signal(k) = y;\n  end\n");
    }
    if fine {
        let _ = writeln!(out, "  signal = [signal(1), signal({}:{n}:end)];", n + 1);
    }
    out.push_str("  y_um = signal(1:samples);\n");
    if exported.adds() {
        let _ = write!(
            out,
            "  if recorded\n    t = (0:samples - 1) / {};\n    y_um = y_um + {};\n    motions = [{}];\n    for i = 1:size(motions, 1) * (abs(first_v - {}) <= {})\n      angle = motions(i, 2) * t;\n      \
             y_um = y_um + exp(-motions(i, 1) * t) .* (motions(i, 3) * cos(angle) + motions(i, 4) * sin(angle));\n    end\n  end\n",
            number(1.0 / chain.dt_s),
            number(start.offset_um),
            rows(&exported.motions(), ["", ""], "; "),
            number(start.drive_v),
            number(exported.near_v)
        );
    }
    out.push_str("  y_um = reshape(y_um, size(drive_v));\nend\n");
    if runs_on {
        out.push_str(BETWEEN);
    }
    out
}
