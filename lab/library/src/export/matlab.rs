//! A model as a function file for MATLAB and Octave.

use super::{Argument, Carry, Exported, arguments, carried, head, needed, number};
use hysteron_sim::intersample::Intersample;
use std::fmt::Write;

const BLOCKS: &str = include_str!("blocks.m");

/// Where the drive stands at the end of each sub-interval; a row of weights for each of them.
const BETWEEN: &str = "
function x = h_between(x, weights)
  reach = max(size(weights, 2) / 2, 1);
  n = numel(x);
  padded = [x(1) * ones(reach - 1, 1); x; x(n) * ones(reach + 1, 1)];
  parts = zeros(n, size(weights, 1) + 1);
  for i = 1:size(weights, 1)
    along = conv(padded, flipud(weights(i, :)'), 'valid');
    parts(:, i) = along(1:n);
  end
  parts(:, end) = padded(reach + 1:reach + n);
  x = reshape(parts', [], 1);
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
        chain.drive_min_v
    );
    for line in head(exported) {
        let _ = writeln!(out, "  % {line}");
    }
    let _ = write!(
        out,
        "  recorded = nargin < {};\n  if recorded\n    settled = {};\n  end\n  x = drive_v(:);\n{}  samples = numel(x);\n  first = x(1);\n  rest = {};\n  if settled\n    rest = first;\n  end\n",
        if chain.takes_force() { 3 } else { 2 },
        exported.begins_settled(),
        if exported.shifted {
            "  x = [x(2:end); x(end)];\n"
        } else {
            ""
        },
        number(chain.drive_min_v)
    );
    if chain.intersample != Intersample::Hold {
        let between = Argument::Rows(chain.intersample.between(chain.substeps));
        let _ = writeln!(out, "  x = h_between(x, {});", argument(&between));
    }
    for step in carried(chain) {
        let _ = match step {
            Carry::Refine => writeln!(
                out,
                "  x = reshape(repmat(x', {}, 1), [], 1);",
                chain.substeps
            ),
            Carry::Coarsen => writeln!(out, "  x = x({0}:{0}:end);", chain.substeps),
            Carry::Block {
                effect,
                block,
                substeps,
            } => {
                let values: Vec<String> = arguments(block, substeps).iter().map(argument).collect();
                writeln!(
                    out,
                    "  [x, rest] = h_{}(x, rest, {});  % {effect}",
                    block.name(),
                    values.join(", ")
                )
            }
        };
    }
    out.push_str("  y_um = [rest; x];\n  y_um = y_um(1:samples);\n");
    if exported.adds() {
        let _ = write!(
            out,
            "  if recorded\n    t = (0:samples - 1)' / {};\n    y_um = y_um + {};\n    motions = {};\n    for i = 1:size(motions, 1) * (abs(first - {}) <= {})\n      angle = motions(i, 2) * t;\n      \
             y_um = y_um + exp(-motions(i, 1) * t) .* (motions(i, 3) * cos(angle) + motions(i, 4) * sin(angle));\n    end\n  end\n",
            number(1.0 / chain.dt_s),
            number(start.offset_um),
            argument(&Argument::Rows(exported.motions())),
            number(start.drive_v),
            number(exported.near_v)
        );
    }
    out.push_str("  y_um = reshape(y_um, size(drive_v));\nend\n");
    out.push_str(&needed(BLOCKS, chain, "%"));
    if chain.intersample != Intersample::Hold {
        out.push_str(BETWEEN);
    }
    out
}

fn joined(values: &[f64], by: &str) -> String {
    values
        .iter()
        .map(|v| number(*v))
        .collect::<Vec<_>>()
        .join(by)
}

fn argument(argument: &Argument) -> String {
    match argument {
        Argument::Number(value) => number(*value),
        Argument::Flag(value) => value.to_string(),
        Argument::Count(value) => value.to_string(),
        Argument::Row(values) => format!("[{}]", joined(values, ", ")),
        Argument::Column(values) => format!("[{}]", joined(values, "; ")),
        Argument::Rows(rows) => format!(
            "[{}]",
            rows.iter()
                .map(|r| joined(r, ", "))
                .collect::<Vec<_>>()
                .join("; ")
        ),
        Argument::Nothing => "[]".into(),
        Argument::Force => "force_n".into(),
    }
}
