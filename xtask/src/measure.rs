//! `cargo xtask measure`: how large the sources are and how they hang together, now or at a revision.
//!
//! Sources are taken as rustfmt's defaults write them, so that a function ends at the bracket under its first
//! letter. Two files of one crate are in a circle where paths (`crate::`, `super::`, those to a child) lead from each to the
//! other. Unit tests behind `#[cfg(test)]` count as lines and tests, not as paths.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cost;
use crate::workspace::{command, emptied, root};

/// Longer functions and files get an owner's look.
const MOST_FUNCTION_LINES: usize = 60;
const MOST_FILE_LINES: usize = 800;

/// Figures of one crate.
#[derive(Debug, Default, PartialEq)]
struct CrateFigures {
    lines: usize,
    long_functions: Vec<(String, usize)>,
    long_files: Vec<(String, usize)>,
    /// Files of each circle.
    circles: Vec<Vec<String>>,
    constants: usize,
    public_items: usize,
    tests: usize,
    test_programs: usize,
}

/// Prints the tables, of this checkout or of a revision.
pub fn print(revision: Option<&str>, places: bool) -> Result<(), String> {
    let top = match revision {
        None => root(),
        Some(revision) => checked_out(revision)?,
    };
    let crates = crates(&top)?;
    println!(
        "| crate | lines | functions > {MOST_FUNCTION_LINES} | files > {MOST_FILE_LINES} | files in circles | constants | public items | test programs | tests |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|---:|---:|");
    let mut sums = [0; 8];
    for (name, figures) in &crates {
        let row = [
            figures.lines,
            figures.long_functions.len(),
            figures.long_files.len(),
            figures.circles.iter().map(Vec::len).sum(),
            figures.constants,
            figures.public_items,
            figures.test_programs,
            figures.tests,
        ];
        print_row(name, row);
        sums.iter_mut().zip(row).for_each(|(sum, one)| *sum += one);
    }
    print_row("all", sums);
    if places {
        for (name, figures) in &crates {
            for (place, lines) in figures.long_files.iter().chain(&figures.long_functions) {
                println!("{lines:>6} lines  {name}: {place}");
            }
            for circle in &figures.circles {
                println!("circle of {}  {name}: {}", circle.len(), circle.join(" "));
            }
        }
    }
    if revision.is_none() {
        // Before the first chore there are no seconds to print.
        let _ = cost::print();
    }
    Ok(())
}

fn print_row(name: &str, row: [usize; 8]) {
    println!(
        "| {name} | {} |",
        row.map(|one| one.to_string()).join(" | ")
    );
}

/// A revision's files in a folder of their own.
fn checked_out(revision: &str) -> Result<PathBuf, String> {
    let folder = emptied("measured")?;
    let archive = folder.join("archive.tar");
    let (archive, into) = (archive.to_string_lossy(), folder.to_string_lossy());
    command(
        "git",
        &["archive", "--output", &archive, revision],
        &root(),
        &[],
    )?;
    command("tar", &["-xf", &archive, "-C", &into], &root(), &[])?;
    Ok(folder)
}

/// Manifests of three workspaces.
const WORKSPACES: [&str; 3] = ["", "firmware", "board/probe"];

/// Every crate with its figures.
fn crates(top: &Path) -> Result<Vec<(String, CrateFigures)>, String> {
    let mut found = BTreeMap::new();
    for folder in WORKSPACES {
        let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
            .args(["metadata", "--no-deps", "--format-version", "1", "--quiet"])
            .current_dir(top.join(folder))
            .output()
            .map_err(|error| format!("cargo metadata: {error}"))?;
        let metadata: serde_json::Value = serde_json::from_slice(&output.stdout)
            .map_err(|error| format!("cargo metadata in {folder}: {error}"))?;
        for package in metadata["packages"].as_array().into_iter().flatten() {
            let manifest = Path::new(package["manifest_path"].as_str().unwrap_or_default());
            let targets = package["targets"].as_array().into_iter().flatten();
            let tested = targets.filter(|target| target["test"] == true).count();
            let place = manifest.parent().unwrap_or(top).to_path_buf();
            found.insert(place, tested);
        }
    }
    let places: BTreeSet<PathBuf> = found.keys().cloned().collect();
    found
        .into_iter()
        .map(|(place, test_programs)| {
            let name = place.strip_prefix(top).unwrap_or(&place);
            let mut figures = figures_of_crate(&place, &places)?;
            figures.test_programs = test_programs;
            Ok((name.display().to_string(), figures))
        })
        .collect()
}

/// Rust files under a folder; what belongs to another crate below it is not its own.
fn sources(
    folder: &Path,
    crates: &BTreeSet<PathBuf>,
    out: &mut Vec<PathBuf>,
) -> Result<(), String> {
    let entries =
        std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            let name = path.file_name().unwrap_or_default();
            if name != "target" && !crates.contains(&path) {
                sources(&path, crates, out)?;
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            out.push(path);
        }
    }
    Ok(())
}

fn figures_of_crate(place: &Path, crates: &BTreeSet<PathBuf>) -> Result<CrateFigures, String> {
    let mut files = Vec::new();
    sources(place, crates, &mut files)?;
    files.sort();
    let mut figures = CrateFigures::default();
    // Files by their paths as modules, of the library or program in `src`.
    let mut modules: BTreeMap<Vec<String>, String> = BTreeMap::new();
    for file in &files {
        let text = std::fs::read_to_string(file)
            .map_err(|error| format!("{}: {error}", file.display()))?;
        let name = file.strip_prefix(place).unwrap_or(file);
        figures.add(&name.display().to_string(), &text);
        if let Ok(inside) = file.strip_prefix(place.join("src")) {
            modules.insert(module_of(inside), without_unit_tests(&text));
        }
    }
    figures.circles = circles(&modules);
    Ok(figures)
}

impl CrateFigures {
    fn add(&mut self, name: &str, text: &str) {
        let lines: Vec<&str> = text.lines().collect();
        self.lines += lines.len();
        if lines.len() > MOST_FILE_LINES {
            self.long_files.push((name.to_owned(), lines.len()));
        }
        for (at, line) in lines.iter().enumerate() {
            let begin = line.trim_start();
            self.tests += usize::from(begin == "#[test]");
            let item = item_of(begin);
            self.constants += usize::from(is_constant(item));
            self.public_items += usize::from(
                begin.starts_with("pub ")
                    && !item.starts_with("use ")
                    && !item.starts_with("mod ")
                    && is_item(item),
            );
            if let Some(function) = function_of(item) {
                let end = format!("{}}}", &line[..line.len() - begin.len()]);
                let length = lines[at..].iter().position(|line| *line == end);
                // One line alone, or a declaration without a body, has no such end before the next item.
                let length = length.map_or(0, |length| length + 1);
                let ends_at_once = line.ends_with(';') || line.ends_with('}');
                if !ends_at_once && length > MOST_FUNCTION_LINES {
                    self.long_functions
                        .push((format!("{name}: {function}"), length));
                }
            }
        }
    }
}

/// A line without what stands before the word of an item.
fn item_of(line: &str) -> &str {
    let mut item = line;
    if let Some(rest) = item.strip_prefix("pub") {
        item = match rest
            .strip_prefix('(')
            .and_then(|rest| rest.split_once(") "))
        {
            Some((_, rest)) => rest,
            None => rest.trim_start(),
        };
    }
    loop {
        let before = item;
        for word in ["async ", "unsafe ", "extern \"C\" "] {
            item = item.strip_prefix(word).unwrap_or(item);
        }
        if item.starts_with("const fn ") || item.starts_with("const unsafe ") {
            item = &item["const ".len()..];
        }
        if item == before {
            return item;
        }
    }
}

fn is_item(item: &str) -> bool {
    const WORDS: [&str; 8] = [
        "fn ", "struct ", "enum ", "trait ", "type ", "const ", "static ", "union ",
    ];
    WORDS.iter().any(|word| item.starts_with(word))
}

fn is_constant(item: &str) -> bool {
    let name = ["const ", "static "]
        .iter()
        .find_map(|word| item.strip_prefix(word));
    // `const _` is a check; an associated constant is one too.
    name.is_some_and(|name| {
        name.starts_with(|c: char| c.is_ascii_uppercase()) && name.contains(": ")
    })
}

fn function_of(item: &str) -> Option<&str> {
    item.strip_prefix("fn ")?.split(['(', '<']).next()
}

/// `a/b.rs` and `a/b/mod.rs` are the module `a::b`; `lib.rs` and `main.rs` the crate.
fn module_of(file: &Path) -> Vec<String> {
    let file = file.with_extension("");
    let mut parts: Vec<String> = file
        .iter()
        .map(|part| part.to_string_lossy().into_owned())
        .collect();
    let last = parts.last().map(String::as_str).unwrap_or_default();
    if last == "mod" || (parts.len() == 1 && matches!(last, "lib" | "main")) {
        parts.pop();
    }
    parts
}

/// Code outside comments, before the unit tests.
fn without_unit_tests(text: &str) -> String {
    let code = text
        .split("\n#[cfg(test)]\nmod ")
        .next()
        .unwrap_or_default();
    let lines = code
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

/// Groups of files each of which leads to every other.
fn circles(modules: &BTreeMap<Vec<String>, String>) -> Vec<Vec<String>> {
    let names: Vec<&Vec<String>> = modules.keys().collect();
    let place: BTreeMap<&Vec<String>, usize> = names
        .iter()
        .enumerate()
        .map(|(at, name)| (*name, at))
        .collect();
    let leads: Vec<BTreeSet<usize>> = modules
        .iter()
        .map(|(module, text)| {
            let children = names.iter().filter_map(|name| match name.split_last() {
                Some((last, parent)) if parent == module.as_slice() => Some(last.as_str()),
                _ => None,
            });
            let beginnings: Vec<&str> = ["crate", "super"].into_iter().chain(children).collect();
            let used = paths(text, &beginnings).into_iter();
            let used = used.filter_map(|path| file_of(module, &path, &place));
            used.filter(|at| names[*at] != module).collect()
        })
        .collect();
    let reached: Vec<BTreeSet<usize>> = (0..names.len()).map(|at| reach(at, &leads)).collect();
    let mut circles: BTreeSet<Vec<usize>> = BTreeSet::new();
    for (at, there) in reached.iter().enumerate() {
        let circle: Vec<usize> = there
            .iter()
            .copied()
            .filter(|other| reached[*other].contains(&at))
            .collect();
        if circle.len() > 1 {
            circles.insert(circle);
        }
    }
    let name = |at: &usize| match names[*at].join("::") {
        crate_itself if crate_itself.is_empty() => "crate".to_owned(),
        name => name,
    };
    circles
        .iter()
        .map(|circle| circle.iter().map(name).collect())
        .collect()
}

/// What is reached from a file in one or more arrows.
fn reach(from: usize, leads: &[BTreeSet<usize>]) -> BTreeSet<usize> {
    let (mut reached, mut next) = (BTreeSet::new(), vec![from]);
    while let Some(at) = next.pop() {
        for to in &leads[at] {
            if reached.insert(*to) {
                next.push(*to);
            }
        }
    }
    reached
}

/// The file that a path leads to: that of the longest beginning that is a module.
fn file_of(
    module: &[String],
    path: &[String],
    files: &BTreeMap<&Vec<String>, usize>,
) -> Option<usize> {
    let mut absolute = match path.first()?.as_str() {
        "crate" => Vec::new(),
        _ => module.to_vec(),
    };
    for part in path {
        match part.as_str() {
            "crate" | "self" => {}
            "super" => {
                absolute.pop();
            }
            name => absolute.push(name.to_owned()),
        }
    }
    loop {
        if let Some(at) = files.get(&absolute) {
            return Some(*at);
        }
        absolute.pop()?;
    }
}

/// Paths with one of these beginnings in a text, groups in braces taken apart.
fn paths(text: &str, beginnings: &[&str]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for word in beginnings {
        for (at, _) in text.match_indices(&format!("{word}::")) {
            let before = text[..at].chars().next_back();
            if !before.is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | '$' | ':')) {
                take_path(&text[at..], &mut Vec::new(), &mut found);
            }
        }
    }
    found
}

/// Reads a path with its groups from the beginning of a text; what stands behind it.
fn take_path<'a>(text: &'a str, before: &mut Vec<String>, found: &mut Vec<Vec<String>>) -> &'a str {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let depth = before.len();
    let mut rest = text.trim_start();
    loop {
        let end = rest.find(|c| !is_name(c)).unwrap_or(rest.len());
        if end > 0 {
            before.push(rest[..end].to_owned());
            rest = &rest[end..];
        }
        match rest.strip_prefix("::") {
            Some(after) if !after.starts_with(['{', '*', '<']) => rest = after,
            Some(after) if after.starts_with('{') => {
                rest = &after[1..];
                while !rest.trim_start().is_empty() && !rest.trim_start().starts_with('}') {
                    let behind = take_path(rest, before, found).trim_start();
                    let behind = behind.strip_prefix(',').unwrap_or(behind);
                    if behind.len() == rest.len() {
                        break;
                    }
                    rest = behind;
                }
                rest = rest.trim_start().strip_prefix('}').unwrap_or(rest);
                break;
            }
            _ => {
                found.push(before.clone());
                // `use a::b as c`, `*` and what else may stand behind a name in a group.
                let end = rest.find([',', '}', ';', '\n']).unwrap_or(rest.len());
                if depth > 0 {
                    rest = &rest[end..];
                }
                break;
            }
        }
    }
    before.truncate(depth);
    rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modules(files: &[(&str, &str)]) -> BTreeMap<Vec<String>, String> {
        let module = |name: &str| module_of(Path::new(name));
        files
            .iter()
            .map(|(name, text)| (module(name), without_unit_tests(text)))
            .collect()
    }

    #[test]
    fn files_that_use_one_another_are_a_circle() {
        let files = [
            ("lib.rs", "mod a;\nmod b;\nmod c;\nmod e;"),
            ("a.rs", "use crate::{b::{Thing, self}, c::x};"),
            ("b/mod.rs", "mod d;\n// crate::c\nfn f() { crate::a::g(); }"),
            (
                "b/d.rs",
                "use super::Thing;\n#[cfg(test)]\nmod tests { use crate::a; }",
            ),
            ("c.rs", "pub fn x() {}"),
            ("e/mod.rs", "mod f;\npub fn all() { f::g(); }"),
            ("e/f.rs", "pub fn g() { crate::e::all(); }"),
        ];
        assert_eq!(circles(&modules(&files)), [["a", "b"], ["e", "e::f"]]);
    }

    #[test]
    fn paths_are_read_with_their_groups() {
        let found = paths(
            "use crate::a::{b as c, d::{E, F}};\nlet x = super::g::H::new();",
            &["crate", "super"],
        );
        let found: Vec<String> = found.iter().map(|path| path.join("::")).collect();
        assert_eq!(
            found,
            [
                "crate::a::b",
                "crate::a::d::E",
                "crate::a::d::F",
                "super::g::H::new"
            ]
        );
    }

    #[test]
    fn a_function_is_measured_to_its_bracket() {
        let body = "    x();\n".repeat(MOST_FUNCTION_LINES);
        let text = format!(
            "pub const A: u8 = 1;\npub(crate) fn short() {{}}\ntrait T {{\n    fn none();\n}}\nimpl X {{\n    pub const fn long() {{\n{body}    }}\n}}\n"
        );
        let mut figures = CrateFigures::default();
        figures.add("a.rs", &text);
        assert_eq!(
            figures.long_functions,
            [("a.rs: long".to_owned(), MOST_FUNCTION_LINES + 2)]
        );
        assert_eq!((figures.constants, figures.public_items), (1, 2));
    }
}
