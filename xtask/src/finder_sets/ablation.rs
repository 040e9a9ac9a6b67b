//! `cargo xtask ablate`: what each rule of the decision buys.
//!
//! Every rule is a threshold of `Policy`. It is set to the value at which it decides nothing, and the planted
//! cases, the pairs and the altered recordings run again. A rule whose row equals that of the method buys
//! nothing on these sets.

use super::context::Context;
use super::results::Results;
use super::{SETS, program, run_set};
use crate::workspace::root;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Rules with the value at which each decides nothing.
const RULES: [(&str, &str); 19] = [
    ("promises_nothing", "1.0"),
    ("seen_in_the_noise", "1e9"),
    ("gain_per_effect", "0.0"),
    ("least_gain", "0.0"),
    ("matters_at_noise", "0.0"),
    ("matters_of_remainder", "0.0"),
    ("in_contention", "1e9"),
    ("closed_around", "0"),
    ("rivals", "0"),
    ("pairs", "0"),
    ("singles", "20"),
    ("story_max", "0"),
    ("hopeless", "1e9"),
    ("loops_come_near", "0.0"),
    ("beyond_chance", "0.0"),
    ("rounds_without_gain_far_above", "1"),
    ("guesses", "1"),
    ("floor_z", "0.0"),
    ("contradiction", "0.0"),
];
const OF: [&str; 3] = ["planted", "pairs", "altered"];
const TABLE: &str = "benchmarks/results/ablation.csv";

/// What is run.
#[derive(clap::Args)]
pub struct Request {
    /// The program that is asked, by default the release build
    #[arg(long)]
    program: Option<PathBuf>,
    /// Runs so many cases of each set
    #[arg(long)]
    sample: Option<usize>,
    /// Rules that are left out in turn, by default each of all
    #[arg(value_parser = RULES.map(|(rule, _)| rule))]
    rules: Vec<String>,
}

/// Runs the sets, whole or some cases of each, without each of these rules, or without each of all.
pub fn run(request: &Request) -> Result<(), String> {
    let folder = root().join("target/finder_sets");
    let mut context = Context {
        program: program(request.program.as_ref())?,
        label: "ablation".into(),
        folder: folder.clone(),
        policy: None,
    };
    let wanted = RULES.iter().filter(|(rule, _)| {
        request.rules.is_empty() || request.rules.iter().any(|name| name == rule)
    });
    let mut table =
        String::from("without,set,cases,right,in_set,long_or,missed,wrong_or,wrong,processor_s\n");
    for (rule, off) in std::iter::once(&("", "")).chain(wanted) {
        let name = if rule.is_empty() { "nothing" } else { rule };
        let told = |e: std::io::Error| format!("{}: {e}", folder.display());
        std::fs::create_dir_all(folder.join("ablation")).map_err(told)?;
        context.policy = if rule.is_empty() {
            None
        } else {
            let path = folder.join(format!("ablation/{rule}.toml"));
            std::fs::write(&path, format!("{rule} = {off}\n")).map_err(told)?;
            Some(path)
        };
        let mut results = Results::at(name, folder.join(format!("ablation/{name}.csv")))?;
        for set in SETS.iter().filter(|set| OF.contains(&set.name)) {
            let cases = (set.cases)(&context, request.sample)?;
            run_set(&context, set, &cases, &mut results)?;
            let ran: Vec<_> = results
                .rows
                .iter()
                .filter(|r| r.set == set.name && cases.iter().any(|c| c.name == r.case))
                .collect();
            let count = |mark: &str| ran.iter().filter(|row| row.mark == mark).count();
            let processor_s: f64 = ran.iter().map(|row| row.processor_s).sum();
            let counts = ["right", "in set", "long or", "missed", "wrong or", "wrong"]
                .map(|mark| count(mark).to_string())
                .join(",");
            let _ = writeln!(
                table,
                "{name},{},{},{counts},{processor_s:.0}",
                set.name,
                ran.len()
            );
        }
    }
    print!("{table}");
    let path = root().join(TABLE);
    std::fs::write(&path, table).map_err(|e| format!("{}: {e}", path.display()))
}
