//! The programs of the tests: built once with all features, run one after the other, with the time of every
//! test.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::cost::{self, Share, Stopwatch};
use crate::workspace::root;

/// How many of the slowest tests are printed.
const SLOWEST: usize = 10;

/// One program of tests.
#[derive(Debug)]
pub struct TestProgram {
    /// Folder of its package, in the repository.
    pub folder: PathBuf,
    /// Name of its target: the crate for unit tests, `integration` for those of `tests/`.
    pub target: String,
    /// `lib`, `bin`, `test` or `example`.
    pub kind: String,
    /// The file to run.
    pub executable: PathBuf,
}

/// Builds programs and tests of a part of the workspace and lists the programs of tests.
pub fn build(selection: &[&str]) -> Result<Vec<TestProgram>, String> {
    let stopwatch = Stopwatch::start();
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["test", "--quiet", "--no-run", "--tests"])
        .args(selection)
        .arg("--message-format=json-render-diagnostics")
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("cargo cannot be started: {error}"))?;
    if !output.status.success() {
        return Err("programs and tests do not build: see above".into());
    }
    cost::keep(Share::Part, "building programs and tests", stopwatch.read());
    let messages = String::from_utf8_lossy(&output.stdout);
    Ok(messages
        .lines()
        .filter_map(|line| of_message(&serde_json::from_str(line).ok()?))
        .collect())
}

/// A line of `cargo --message-format=json`, if it names a program of tests.
fn of_message(message: &serde_json::Value) -> Option<TestProgram> {
    let target = message.get("target")?;
    if message.get("profile")?.get("test")?.as_bool() != Some(true) {
        return None;
    }
    Some(TestProgram {
        folder: Path::new(message.get("manifest_path")?.as_str()?)
            .parent()?
            .to_path_buf(),
        target: target.get("name")?.as_str()?.to_owned(),
        kind: target.get("kind")?.get(0)?.as_str()?.to_owned(),
        executable: message.get("executable")?.as_str()?.into(),
    })
}

impl TestProgram {
    /// Whether it belongs to the package in this folder of the repository.
    pub fn is_of(&self, folder: &str) -> bool {
        self.folder == root().join(folder)
    }

    /// Whether it holds unit tests.
    pub fn has_unit_tests(&self) -> bool {
        self.kind != "test"
    }
}

/// What a run of several programs came to.
#[derive(Debug, Default)]
struct Tally {
    passed: usize,
    ignored: usize,
    times: Vec<(f64, String)>,
    failed: Vec<String>,
}

/// Runs programs, all their tests, and prints the slowest.
pub fn run(
    programs: &[&TestProgram],
    arguments: &[&str],
    variables: &[(&str, &str)],
) -> Result<(), String> {
    let mut tally = Tally::default();
    for program in programs {
        let name = format!(
            "{} ({})",
            program
                .folder
                .strip_prefix(root())
                .unwrap_or(&program.folder)
                .display(),
            program.target
        );
        println!("   {name}");
        let stopwatch = Stopwatch::start();
        // The time of each test is an unstable option of the test harness; no compiler sees this variable.
        let mut child = Command::new(&program.executable)
            .args(["-Zunstable-options", "--report-time"])
            .args(arguments)
            .env("RUSTC_BOOTSTRAP", "1")
            .envs(variables.iter().copied())
            .current_dir(&program.folder)
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{}: {error}", program.executable.display()))?;
        let mut others = String::new();
        if let Some(output) = child.stdout.take() {
            for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
                let line = String::from_utf8_lossy(&line).into_owned();
                if !tally.count(&line, &program.target) {
                    let _ = writeln!(others, "{line}");
                }
            }
        }
        let status = child.wait().map_err(|error| error.to_string())?;
        cost::keep(Share::Part, &name, stopwatch.read());
        if !status.success() {
            print!("{others}");
            tally.failed.push(name);
        }
    }
    tally.print();
    if tally.failed.is_empty() {
        Ok(())
    } else {
        Err(format!("tests fail in {}", tally.failed.join(", ")))
    }
}

impl Tally {
    /// Takes a line of the harness; whether it was one of a test that passed or was left out.
    fn count(&mut self, line: &str, target: &str) -> bool {
        let Some(rest) = line.strip_prefix("test ") else {
            return false;
        };
        let Some((name, outcome)) = rest.split_once(" ... ") else {
            return false;
        };
        if outcome.starts_with("ignored") {
            self.ignored += 1;
            return true;
        }
        let Some(time) = outcome.strip_prefix("ok") else {
            println!("   FAILED {target}: {name}");
            return false;
        };
        self.passed += 1;
        let seconds = time
            .trim()
            .trim_start_matches('<')
            .trim_end_matches('>')
            .trim_end_matches('s')
            .parse();
        self.times
            .push((seconds.unwrap_or(0.0), format!("{target}: {name}")));
        true
    }

    fn print(&mut self) {
        self.times.sort_by(|a, b| b.0.total_cmp(&a.0));
        println!("   the slowest tests, s:");
        for (seconds, name) in self.times.iter().take(SLOWEST) {
            println!("   {seconds:8.2}  {name}");
        }
        println!(
            "test result: {}. {} passed; {} failed; {} ignored; 0 measured; 0 filtered out",
            if self.failed.is_empty() {
                "ok"
            } else {
                "FAILED"
            },
            self.passed,
            self.failed.len(),
            self.ignored
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_harness_are_counted_with_their_times() {
        let mut tally = Tally::default();
        assert!(tally.count("test a::b ... ok <1.250s>", "crate"));
        assert!(tally.count("test a::c ... ignored", "crate"));
        assert!(!tally.count("test a::d ... FAILED <0.1s>", "crate"));
        assert!(!tally.count("running 3 tests", "crate"));
        assert_eq!((tally.passed, tally.ignored), (1, 1));
        assert_eq!(tally.times, [(1.25, "crate: a::b".to_owned())]);
    }

    #[test]
    fn a_message_of_cargo_names_a_program_of_tests() {
        let message = serde_json::json!({"manifest_path": "/x/core/Cargo.toml", "executable": "/t/core-1", "profile": {"test": true},
            "target": {"name": "hysteron_core", "kind": ["lib"]}});
        let program = of_message(&message).expect("a program");
        assert_eq!(
            (program.folder.as_path(), program.kind.as_str()),
            (Path::new("/x/core"), "lib")
        );
        assert!(program.has_unit_tests());
        let mut plain = message;
        plain["profile"]["test"] = false.into();
        assert!(of_message(&plain).is_none());
    }
}
