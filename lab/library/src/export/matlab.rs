//! A model as a function file for MATLAB and Octave.

use super::{Argument, Carry, arguments, carried, head, needed, number};
use hysteron_sim::block::BlockChain;
use hysteron_sim::chain::Model;
use std::fmt::Write;

const BLOCKS: &str = include_str!("blocks.m");

pub(super) fn text(chain: &BlockChain, model: &Model, name: &str) -> String {
    let force = if chain.takes_force() { ", force_n" } else { "" };
    let mut out = format!("function y_um = {name}(drive_v{force}, settled)\n");
    // Writing to a text cannot fail.
    let _ = writeln!(
        out,
        "  % {name}  Reading (um) at every sample of a drive (V).\n  %   y_um = {name}(drive_v{force}) simulates a virgin actuator, at rest at {} V before the first sample.\n  %   y_um = {name}(drive_v{force}, true) begins at rest at the first drive.\n  %",
        chain.drive_min_v
    );
    for line in head(chain, model) {
        let _ = writeln!(out, "  % {line}");
    }
    let _ = write!(
        out,
        "  if nargin < {}\n    settled = false;\n  end\n  x = drive_v(:);\n  samples = numel(x);\n  rest = {};\n  if settled\n    rest = x(1);\n  end\n",
        if chain.takes_force() { 3 } else { 2 },
        number(chain.drive_min_v)
    );
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
    out.push_str("  y_um = [rest; x];\n  y_um = reshape(y_um(1:samples), size(drive_v));\nend\n");
    out.push_str(&needed(BLOCKS, chain, "%"));
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
