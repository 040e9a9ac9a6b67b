//! What cargo does for the check: formats, lints, documents and tests the workspace.

use crate::test_programs::{self, TestProgram};
use crate::workspace::{AS_TESTED, PRODUCT, built, cargo, command, root};
use crate::{browser, skipped_tests, toolchain, virtual_environment};

pub fn format() -> Result<(), String> {
    for folder in [root(), root().join("firmware"), root().join("board/probe")] {
        cargo(&["fmt", "--check", "--all"], &folder, &[])?;
    }
    Ok(())
}

/// Clippy on everything.
pub fn lints() -> Result<(), String> {
    lint(AS_TESTED)
}

/// Clippy on the product.
pub fn lints_of_product() -> Result<(), String> {
    lint(PRODUCT)
}

/// In the profile of the tests, so that macros and build scripts are built once.
fn lint(selection: &[&str]) -> Result<(), String> {
    cargo(
        &[
            &["clippy", "--quiet"],
            selection,
            &["--all-targets", "--", "-D", "warnings"],
        ]
        .concat(),
        &root(),
        &[],
    )
}

/// What users read: private items are read in their sources.
pub fn documentation() -> Result<(), String> {
    cargo(
        &[&["doc", "--quiet"], AS_TESTED, &["--no-deps"]].concat(),
        &root(),
        &[(
            "RUSTDOCFLAGS",
            "-D warnings -A rustdoc::private-intra-doc-links",
        )],
    )
}

/// Everything but the emulated part, whose tests need the image.
pub fn host_tests() -> Result<(), String> {
    browser::ensure()?;
    let programs = test_programs::build(AS_TESTED)?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| !program.is_of(EMULATOR))
        .collect();
    let (skipped, python) = (skipped_tests::file(), virtual_environment::with_numpy()?);
    let (skipped, python) = (skipped.to_string_lossy(), python.to_string_lossy());
    let [of_skipped, random_cases] = variables(&skipped);
    test_programs::run(
        &chosen,
        &[],
        &[of_skipped, random_cases, ("HYSTERON_PYTHON", &python)],
    )
}

pub fn documentation_tests() -> Result<(), String> {
    cargo(
        &[&["test", "--quiet", "--doc"], AS_TESTED].concat(),
        &root(),
        &[],
    )
}

/// What the programs of tests are run with.
fn variables(skipped: &str) -> [(&str, &str); 2] {
    [("HYSTERON_SKIPPED", skipped), SAME_RANDOM_CASES]
}

const EMULATOR: &str = "board/emulator";

/// Of the property tests: a check says the same of the same sources every time. `cargo test` alone draws
/// other cases each time, and finds more.
const SAME_RANDOM_CASES: (&str, &str) = ("PROPTEST_RNG_SEED", "20260101");

/// Writes the tables that documentation has from the code: effects in docs/reference/list_of_effects.md,
/// formats in docs/reference/formats.md. The same tests fail in `host_tests` where one is stale.
pub fn write_tables() -> Result<(), String> {
    for [test, name] in [
        ["readme", "the_table_in_the_readme"],
        ["formats", "the_table_of_formats"],
    ] {
        let filter = format!("{test}::{name}");
        let arguments = [
            &["test", "--quiet"],
            AS_TESTED,
            &["--test", "integration", &filter],
        ]
        .concat();
        cargo(&arguments, &root(), &[("HYSTERON_WRITE_README", "1")])?;
    }
    Ok(())
}

/// No probe is at hand: what is tested is what is looked at before and around it. In the profile that is
/// built fastest.
pub fn probe_tests() -> Result<(), String> {
    cargo(
        &["test", "--quiet", "--locked"],
        &root().join("board/probe"),
        &[],
    )
}

pub fn emulator_tests() -> Result<(), String> {
    let image = toolchain::image();
    if !image.is_file() {
        return Err(format!(
            "{} is not there: run `cargo xtask firmware` first",
            image.display()
        ));
    }
    let programs = test_programs::build(AS_TESTED)?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| program.is_of(EMULATOR))
        .collect();
    test_programs::run(&chosen, &[], &[])
}

/// Unit tests of the product alone.
pub fn unit_tests() -> Result<(), String> {
    let programs = test_programs::build(PRODUCT)?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| program.has_unit_tests() && !program.is_of(EMULATOR))
        .collect();
    test_programs::run(
        &chosen,
        &[],
        &variables(&skipped_tests::file().to_string_lossy()),
    )
}

/// README's first command.
pub fn one_explain() -> Result<(), String> {
    let model = "hysteresis,initial_curve,vibration";
    command(
        built("hysteron"),
        &["explain", "examples/hidden_effect", "--from", model],
        &root(),
        &[],
    )
}

/// Tests of modules named `long`, which the check ignores.
pub fn long_tests() -> Result<(), String> {
    let programs = test_programs::build(AS_TESTED)?;
    let chosen: Vec<&TestProgram> = programs.iter().collect();
    test_programs::run(
        &chosen,
        &["--ignored", "long::"],
        &variables(&skipped_tests::file().to_string_lossy()),
    )
}
