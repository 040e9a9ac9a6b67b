//! Takes one line of safety out of the firmware at a time, and asks whether an emulated test notices.
//!
//! # How it works
//! `firmware/mutations.toml` lists what is taken out, what is put there instead, and which emulated test must
//! fail then. A mutation is made in a copy of the sources in `target/mutation`, with a build directory of its
//! own; the test that is run is this checkout's, told by [`IMAGES`] where the images are. Each named test is
//! run on the copy without any mutation first: a test that fails anyway says nothing.
//!
//! A run that does not end within [`MOST_TEST_S`] is ended; a part that only goes on restarting does that. It
//! counts as noticed, and the table notes that.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde::Deserialize;

use crate::test_programs::{self, TestProgram};
use crate::toolchain::{self, FIRMWARE, Toolchain};
use crate::workspace::{AS_TESTED, root};

/// Where the emulated tests look for images, when it is not where `cargo xtask firmware` puts them.
const IMAGES: &str = "HYSTERON_IMAGES";
/// A test of the list takes some tens of seconds on an idle machine.
const MOST_TEST_S: u64 = 240;
/// Of the checkout, what an image is made of; `.cargo` is found above the copy.
const SOURCES: [&str; 6] = [
    "Cargo.toml",
    "Cargo.lock",
    "memory.x",
    "core",
    "board/protocol",
    "firmware",
];

/// The list.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    mutation: Vec<Mutation>,
}

/// One line of safety.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Mutation {
    /// Its name on the command line.
    name: String,
    /// What is gone without it, in words.
    without: String,
    /// Where it stands, from the repository's root.
    file: String,
    /// The text that is taken out; it occurs once, white space aside.
    take_out: String,
    /// What stands there instead; nothing where it is not said.
    #[serde(default)]
    put_in: String,
    /// Which image shows it.
    #[serde(default)]
    image: Image,
    /// The test that must fail: a file of `board/emulator/tests`, and a function of it.
    test: String,
}

/// An image of the NUCLEO-H743ZI2.
#[derive(Clone, Copy, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
enum Image {
    /// With the converters on SPI.
    #[default]
    Spi,
    /// With the part's own converters.
    OnChip,
    /// The checks of a first board.
    BoardCheck,
}

/// What became of a test.
enum Ran {
    Passed,
    /// What it said first.
    Failed(String),
    DidNotEnd,
}

impl Mutation {
    fn test(&self) -> Result<(&str, &str), String> {
        self.test.split_once("::").ok_or_else(|| {
            format!(
                "{}: test = \"{}\" is not FILE::FUNCTION",
                self.name, self.test
            )
        })
    }

    /// The file's text with the mutation. White space does not count, so that the list stands in any format.
    fn applied_to(&self, text: &str) -> Result<String, String> {
        let dense: Vec<(usize, char)> = text
            .char_indices()
            .filter(|(_, letter)| !letter.is_whitespace())
            .collect();
        let wanted: Vec<char> = self
            .take_out
            .chars()
            .filter(|letter| !letter.is_whitespace())
            .collect();
        let found: Vec<&[(usize, char)]> = dense
            .windows(wanted.len().max(1))
            .filter(|window| window.iter().map(|(_, letter)| letter).eq(&wanted))
            .collect();
        match found[..] {
            [&[(begin, _), .., (last, letter)]] => Ok([
                &text[..begin],
                &self.put_in,
                &text[last + letter.len_utf8()..],
            ]
            .concat()),
            _ => Err(format!(
                "{}: what is taken out occurs {} times in {}, and must occur once",
                self.name,
                found.len(),
                self.file
            )),
        }
    }
}

fn list() -> Result<Vec<Mutation>, String> {
    let path = root().join("firmware/mutations.toml");
    let text = fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let list: List =
        toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(list.mutation)
}

/// Runs the named mutations, or all of them, and prints the table.
pub fn run(names: &[String]) -> Result<(), String> {
    let all = list()?;
    if let Some(unknown) = names
        .iter()
        .find(|name| all.iter().all(|mutation| mutation.name != **name))
    {
        let known: Vec<&str> = all.iter().map(|mutation| mutation.name.as_str()).collect();
        return Err(format!(
            "there is no mutation `{unknown}`; there are {}",
            known.join(", ")
        ));
    }
    let chosen: Vec<&Mutation> = all
        .iter()
        .filter(|mutation| names.is_empty() || names.contains(&mutation.name))
        .collect();
    let scratch = Scratch::new()?;
    let tests = test_program()?;
    let mut sound = BTreeMap::new();
    let mut survivors = Vec::new();
    scratch.build_all(&chosen)?;
    for mutation in &chosen {
        if !sound.contains_key(&mutation.test) {
            let ran = scratch.test(&tests, mutation)?;
            println!(
                "   without a mutation {}: {}",
                mutation.test,
                if matches!(ran, Ran::Passed) {
                    "passes"
                } else {
                    "FAILS"
                }
            );
            sound.insert(mutation.test.clone(), matches!(ran, Ran::Passed));
        }
    }
    println!("\n| without | fails | says |\n|---|---|---|");
    for mutation in &chosen {
        let verdict = if sound.get(&mutation.test) == Some(&true) {
            scratch.try_out(&tests, mutation)
        } else {
            Err("fails anyway".into())
        };
        let (noticed, says) = match verdict {
            Ok(Ran::Failed(says)) => (true, says),
            Ok(Ran::DidNotEnd) => (true, format!("did not end within {MOST_TEST_S} s")),
            Ok(Ran::Passed) => (false, "**survives**".into()),
            Err(error) => (false, format!("**not tried**: {error}")),
        };
        println!(
            "| {} (`{}`) | `{}` | {} |",
            mutation.without,
            mutation.name,
            mutation.test,
            says.replace('|', "/")
        );
        let _ = std::io::stdout().flush();
        if !noticed {
            survivors.push(mutation.name.as_str());
        }
    }
    println!(
        "\n{} of {} mutations are noticed",
        chosen.len() - survivors.len(),
        chosen.len()
    );
    if survivors.is_empty() {
        Ok(())
    } else {
        Err(format!("not noticed: {}", survivors.join(", ")))
    }
}

/// The emulated tests' program, built.
fn test_program() -> Result<PathBuf, String> {
    let emulated =
        |program: &TestProgram| program.is_of("board/emulator") && program.kind == "test";
    let programs = test_programs::build(AS_TESTED)?;
    programs
        .into_iter()
        .find(emulated)
        .map(|program| program.executable)
        .ok_or_else(|| "the emulated tests have no program".into())
}

/// The copy that is changed.
struct Scratch {
    folder: PathBuf,
    toolchain: Toolchain,
}

impl Scratch {
    fn new() -> Result<Self, String> {
        let folder = root().join("target/mutation");
        fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for source in SOURCES {
            copy(&root().join(source), &folder.join(source))
                .map_err(|error| format!("{source}: {error}"))?;
        }
        Ok(Self {
            folder,
            toolchain: toolchain::for_target(&FIRMWARE)?,
        })
    }

    fn images(&self) -> PathBuf {
        self.folder
            .join("firmware/target/thumbv7em-none-eabihf/release")
    }

    fn build(&self, image: Image) -> Result<(), String> {
        let build = |selection: &[&str]| {
            self.toolchain
                .build(&FIRMWARE, &self.folder.join("firmware"), selection)
        };
        match image {
            Image::Spi => build(&[
                "--workspace",
                "--bin",
                "hysteron-firmware",
                "--bin",
                "hysteron-boot-stage",
            ]),
            Image::BoardCheck => build(&["--bin", "board_check"]),
            Image::OnChip => {
                build(&[
                    "--bin",
                    "hysteron-firmware",
                    "--features",
                    "on-chip-converters",
                ])?;
                let [built, kept] = ["hysteron-firmware", "hysteron-firmware-on-chip"]
                    .map(|name| self.images().join(name));
                fs::copy(&built, &kept)
                    .map(|_| ())
                    .map_err(|error| format!("{}: {error}", kept.display()))
            }
        }
    }

    /// The images that these mutations need, without one.
    fn build_all(&self, mutations: &[&Mutation]) -> Result<(), String> {
        // The default image last: another one that is built leaves its own in its place.
        [Image::BoardCheck, Image::OnChip, Image::Spi]
            .into_iter()
            // The default one brings the boot stage, without which nothing runs.
            .filter(|image| {
                *image == Image::Spi || mutations.iter().any(|mutation| mutation.image == *image)
            })
            .try_for_each(|image| self.build(image))
    }

    /// Makes a mutation, runs its test and takes the mutation back.
    fn try_out(&self, program: &Path, mutation: &Mutation) -> Result<Ran, String> {
        let [honest, changed] =
            [root(), self.folder.clone()].map(|folder| folder.join(&mutation.file));
        let text = fs::read_to_string(&honest)
            .map_err(|error| format!("{}: {error}", honest.display()))?;
        fs::write(&changed, mutation.applied_to(&text)?)
            .map_err(|error| format!("{}: {error}", changed.display()))?;
        let ran = self
            .build(mutation.image)
            .and_then(|()| self.test(program, mutation));
        fs::write(&changed, text).map_err(|error| format!("{}: {error}", changed.display()))?;
        ran
    }

    fn test(&self, program: &Path, mutation: &Mutation) -> Result<Ran, String> {
        let (file, function) = mutation.test()?;
        let log = self.folder.join(format!("{}.log", mutation.name));
        let said = fs::File::create(&log).map_err(|error| format!("{}: {error}", log.display()))?;
        let also = said
            .try_clone()
            .map_err(|error| format!("{}: {error}", log.display()))?;
        let mut child = Command::new(program)
            .args(["--exact", &format!("{file}::{function}")])
            .current_dir(root().join("board/emulator"))
            .env(IMAGES, self.images())
            .env("RUST_BACKTRACE", "0")
            .stdout(said)
            .stderr(also)
            .spawn()
            .map_err(|error| format!("{}: {error}", program.display()))?;
        let start = Instant::now();
        let status = loop {
            match child.try_wait().map_err(|error| error.to_string())? {
                Some(status) => break status,
                None if start.elapsed() > Duration::from_secs(MOST_TEST_S) => {
                    let _ = child.kill();
                    let _ = child.wait();
                    return Ok(Ran::DidNotEnd);
                }
                None => std::thread::sleep(Duration::from_millis(100)),
            }
        };
        let said = fs::read_to_string(&log).unwrap_or_default();
        if !said.contains("running 1 test") {
            return Err(format!("`{}` is no test", mutation.test));
        }
        Ok(if status.success() {
            Ran::Passed
        } else {
            Ran::Failed(first_words(&said))
        })
    }
}

/// What a test that failed says first, shortened.
fn first_words(said: &str) -> String {
    let mut lines = said
        .lines()
        .skip_while(|line| !line.contains("panicked at"));
    let place = lines
        .next()
        .and_then(|line| line.split("panicked at ").nth(1))
        .unwrap_or("")
        .trim_end_matches(':')
        .to_string();
    let words: String = lines
        .take_while(|line| !line.is_empty() && !line.starts_with("note:"))
        .collect::<Vec<_>>()
        .join(" ");
    let short: String = words.chars().take(140).collect();
    format!("{place}: {short}")
}

/// Copies a file or a folder without its build directory, and only what has changed, so that nothing else is
/// built anew.
fn copy(from: &Path, to: &Path) -> std::io::Result<()> {
    if from.is_file() {
        let bytes = fs::read(from)?;
        return if fs::read(to).is_ok_and(|there| there == bytes) {
            Ok(())
        } else {
            fs::write(to, bytes)
        };
    }
    fs::create_dir_all(to)?;
    let names = |folder: &Path| -> std::io::Result<BTreeSet<_>> {
        let names = fs::read_dir(folder)?
            .map(|entry| entry.map(|entry| entry.file_name()))
            .collect::<std::io::Result<BTreeSet<_>>>()?;
        Ok(names.into_iter().filter(|name| name != "target").collect())
    };
    let wanted = names(from)?;
    for gone in names(to)?.difference(&wanted) {
        let gone = to.join(gone);
        if gone.is_dir() {
            fs::remove_dir_all(gone)?
        } else {
            fs::remove_file(gone)?
        }
    }
    wanted
        .iter()
        .try_for_each(|name| copy(&from.join(name), &to.join(name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The list cannot rot unseen: what it takes out is still there, once, and its tests exist.
    #[test]
    fn every_line_of_the_list_stands_once_in_its_file_and_its_test_exists() {
        let list = list().expect("the list");
        assert!(list.len() >= 50, "{} mutations", list.len());
        let names: BTreeSet<&str> = list.iter().map(|mutation| mutation.name.as_str()).collect();
        assert_eq!(names.len(), list.len(), "a name stands twice");
        for mutation in &list {
            let text = fs::read_to_string(root().join(&mutation.file))
                .unwrap_or_else(|error| panic!("{}: {error}", mutation.file));
            let changed = mutation
                .applied_to(&text)
                .unwrap_or_else(|error| panic!("{error}"));
            assert_ne!(changed, text, "{} changes nothing", mutation.name);
            assert!(
                SOURCES
                    .iter()
                    .any(|source| mutation.file.starts_with(&format!("{source}/"))),
                "{} is not copied",
                mutation.file
            );
            let (file, function) = mutation.test().expect("a test");
            let path = root().join(format!("board/emulator/tests/integration/{file}.rs"));
            let tests = fs::read_to_string(&path)
                .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            assert!(
                tests.contains(&format!("#[test]\nfn {function}(")),
                "{}: no test {function} in {}",
                mutation.name,
                path.display()
            );
        }
    }

    #[test]
    fn what_is_taken_out_must_occur_once() {
        let mutation = |take_out: &str| Mutation {
            name: "name".into(),
            without: String::new(),
            file: "file".into(),
            take_out: take_out.into(),
            put_in: "c".into(),
            image: Image::Spi,
            test: String::new(),
        };
        assert_eq!(
            mutation("f(a, b);")
                .applied_to("{\n  f(\n  a, b);\n}")
                .as_deref(),
            Ok("{\n  c\n}")
        );
        assert_eq!(
            mutation("bb").applied_to("bb abb").unwrap_err(),
            "name: what is taken out occurs 2 times in file, and must occur once"
        );
        assert_eq!(
            mutation("xy").applied_to("ab").unwrap_err(),
            "name: what is taken out occurs 0 times in file, and must occur once"
        );
    }
}
