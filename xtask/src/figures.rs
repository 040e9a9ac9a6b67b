//! `cargo xtask figures`: how fast it is, measured here, and how many instructions a sample takes, which the
//! check compares.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::workspace::{AS_TESTED, built, cargo, root};
use crate::{debian, result_tables, virtual_environment};

/// Times on a machine that does nothing else.
const SPEED: &str = "benchmarks/results/speed.csv";
/// Instructions, which do not depend on what runs beside.
const INSTRUCTIONS: &str = "benchmarks/results/instructions.csv";
/// Two runs whose difference leaves out what comes before the first sample.
const SAMPLES: [u32; 2] = [10_000, 20_000];
/// A sample may take so many times the stored instructions.
const MOST_GROWTH: f64 = 1.05;

/// What a case takes.
struct Instructions {
    case: String,
    a_sample: f64,
}

/// Measures all and writes tables and page.
pub fn write() -> Result<(), String> {
    build()?;
    let was = stored()?;
    let cases = output(&program(), &["cases"])?;
    let mut text = String::from("case,instructions_a_sample,compiler\n");
    let compiler = compiler()?;
    for case in cases.lines() {
        let a_sample = instructions(case)?;
        text += &format!("{case},{a_sample:.1},{compiler}\n");
        let before = was.iter().find(|one| one.case == case);
        if let Some(before) = before.filter(|before| a_sample > MOST_GROWTH * before.a_sample) {
            println!(
                "   worse: {case} takes {a_sample:.0} instructions a sample, {:.0} before",
                before.a_sample
            );
        }
    }
    write_file(INSTRUCTIONS, &text)?;
    let python = virtual_environment::kept("python/speed", &["numpy", "scipy", "numba", "jax"])?;
    let ours = output(&program(), &[])?;
    let others = output(&python, &["benchmarks/speed/chain.py"])?;
    debian::see_to_octave()?;
    let octave = output(
        Path::new("octave-cli"),
        &["--quiet", "benchmarks/speed/chain.m"],
    )?;
    let machine = machine();
    let mut text = String::from("program,samples,million_samples_a_second,machine\n");
    let rows = ours.lines().skip(1).chain(others.lines().skip(1));
    for row in rows.chain(octave.lines()) {
        let fields: Vec<&str> = row.split(',').collect();
        let [name, samples, seconds] = fields[..] else {
            return Err(format!("`{row}` is no row of three fields"));
        };
        let number = |text: &str| text.parse::<f64>().map_err(|e| format!("`{text}`: {e}"));
        let rate = number(samples)? / number(seconds)? / 1e6;
        text += &format!("{name},{samples},{rate:.3},{machine}\n");
    }
    write_file(SPEED, &text)?;
    result_tables::write()
}

/// Fails where a sample takes more instructions than what is stored. Another compiler has other figures.
pub fn check_instructions() -> Result<(), String> {
    let stored = stored()?;
    if stored.is_empty() {
        println!("   {INSTRUCTIONS} is of another compiler: nothing is compared");
        return Ok(());
    }
    build()?;
    for case in ["chain", "inverse", "servo tick"] {
        let now = instructions(case)?;
        let before = stored
            .iter()
            .find(|one| one.case == case)
            .ok_or_else(|| format!("{INSTRUCTIONS} has no `{case}`"))?
            .a_sample;
        println!("   {case}: {now:.0} instructions a sample, {before:.0} stored");
        if now > MOST_GROWTH * before {
            return Err(format!(
                "{case} takes {now:.0} instructions a sample, stored are {before:.0}; `cargo xtask figures` stores others"
            ));
        }
    }
    Ok(())
}

fn build() -> Result<(), String> {
    cargo(
        &[&["build", "--quiet"], AS_TESTED, &["--example", "speed"]].concat(),
        &root(),
        &[],
    )
}

fn program() -> PathBuf {
    built("examples").join("speed")
}

/// Instructions a sample, counted by Callgrind.
fn instructions(case: &str) -> Result<f64, String> {
    debian::see_to_valgrind()?;
    let count = |samples: u32| {
        let out = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(program())
            .args(["once", case, &samples.to_string()])
            .output()
            .map_err(|e| format!("valgrind: {e}"))?;
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        said.lines()
            .find_map(|line| line.split_once("Collected :"))
            .and_then(|(_, count)| count.trim().parse::<f64>().ok())
            .ok_or_else(|| format!("valgrind counted nothing for `{case}`: {said}"))
    };
    let [few, many] = SAMPLES;
    Ok((count(many)? - count(few)?) / f64::from(many - few))
}

/// What is stored of this compiler.
fn stored() -> Result<Vec<Instructions>, String> {
    let path = root().join(INSTRUCTIONS);
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let compiler = compiler()?;
    Ok(text
        .lines()
        .filter_map(|line| {
            let (rest, of) = line.rsplit_once(',')?;
            let (case, a_sample) = rest.rsplit_once(',')?;
            (of == compiler).then(|| {
                Some(Instructions {
                    case: case.to_owned(),
                    a_sample: a_sample.parse().ok()?,
                })
            })?
        })
        .collect())
}

fn compiler() -> Result<String, String> {
    let version = output(Path::new("rustc"), &["--version"])?;
    Ok(version
        .split_whitespace()
        .take(2)
        .collect::<Vec<_>>()
        .join(" "))
}

fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    text.lines()
        .find_map(|line| line.strip_prefix("model name"))
        .and_then(|rest| rest.split_once(':'))
        .map_or_else(|| "unknown".to_owned(), |(_, name)| name.trim().to_owned())
}

fn output(program: &Path, arguments: &[&str]) -> Result<String, String> {
    let place = || program.to_string_lossy().into_owned();
    let out = Command::new(program)
        .args(arguments)
        .current_dir(root())
        .output()
        .map_err(|e| format!("{}: {e}", place()))?;
    if !out.status.success() {
        return Err(format!(
            "{}: {}",
            place(),
            String::from_utf8_lossy(&out.stderr)
        ));
    }
    Ok(String::from_utf8_lossy(&out.stdout).into_owned())
}

fn write_file(path: &str, text: &str) -> Result<(), String> {
    println!("   {path}");
    std::fs::write(root().join(path), text).map_err(|e| format!("{path}: {e}"))
}
