//! `cargo xtask soak [TICKS]`: the adversary of `core/tests/adversary.rs` for so many ticks, in a build in which
//! every sum and every conversion is looked at.

use std::process::{Command, Stdio};

use crate::result_tables;
use crate::workspace::root;

const RESULTS: &str = "benchmarks/results/soak.csv";
const TEST: &str = "long::an_adversary_of_many_ticks_neither_moves_nor_swings_the_stage";

/// Runs it on every core and stores what was seen.
pub fn run(ticks: u64) -> Result<(), String> {
    let out = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["test", "--profile", "soak", "--ignore-rust-version"])
        .args(["-p", "hysteron-core", "--test", "adversary", "--"])
        .args(["--ignored", "--exact", TEST, "--nocapture"])
        .env("HYSTERON_SOAK_TICKS", ticks.to_string())
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo cannot be started: {error}"))?;
    let said = String::from_utf8_lossy(&out.stdout);
    if !out.status.success() {
        return Err(format!("{said}\nthe soak of {ticks} ticks failed"));
    }
    let mut table = String::from("what,count\n");
    for row in said.lines().filter_map(|line| line.strip_prefix("soak;")) {
        table += &format!("{row}\n");
    }
    std::fs::write(root().join(RESULTS), table).map_err(|e| format!("{RESULTS}: {e}"))?;
    result_tables::write()
}
