//! The steps of `cargo xtask check`, and how they are run.
//!
//! `check` runs two lines of steps side by side: those of the host, and those of other targets (WebAssembly,
//! the firmware, the emulated part) as a second process, whose output is a file that is shown at the end.
//! Compilers use all processors and wait for one another at the folder of artifacts, as cargo sees to; many
//! tests use one. What either would install is installed before. Where one line fails the other ends with the
//! step that it is at.

use std::fs::File;
use std::process::Command;

use crate::cost::{self, Share, Stopwatch};
use crate::workspace::root;
use crate::{
    board, board_tune, browser, checks, debian, dependency_licences, figures, house, images,
    lab_page, library_alone, mutate, packages, pipython, prose, public_items, python_package,
    result_tables, skipped_tests, toolchain, virtual_environment, whole_circle,
};

/// One step: its name and what it does.
#[derive(Clone, Copy)]
pub struct CheckStep(&'static str, fn() -> Result<(), String>);

/// What an edit is tried with: minutes where everything is built.
pub const QUICK: &[CheckStep] = &[
    CheckStep("format", checks::format),
    CheckStep("lints", checks::lints_of_product),
    CheckStep("unit tests", checks::unit_tests),
    CheckStep("one explain", checks::one_explain),
    CheckStep("prose", || prose::report(false, &[])),
];

/// What stands beside the sources.
pub const HOUSE: &[CheckStep] = &[
    CheckStep("workflows, citation, licences", house::lint),
    CheckStep("manifests", packages::manifests),
    CheckStep("licences of dependencies", dependency_licences::check),
];

/// The steps that need only the host's toolchain.
pub const HOST: &[CheckStep] = &[
    CheckStep("format", checks::format),
    CheckStep("lints", checks::lints),
    CheckStep("documentation", checks::documentation),
    CheckStep("what the library shows", public_items::check),
    CheckStep("prose", || prose::report(false, &[])),
    CheckStep("tables of results", result_tables::check),
    CheckStep("instructions a sample", figures::check_instructions),
    CheckStep("host tests (release)", checks::host_tests),
    CheckStep("examples in the documentation", checks::documentation_tests),
];

/// The Python package.
pub const PYTHON: &[CheckStep] = &[
    CheckStep(
        "Python package in a fresh environment",
        python_package::test,
    ),
    CheckStep(
        "formats as their own libraries write them today",
        python_package::formats,
    ),
];

/// The library without its default features, and the page that is made with it.
pub const LIBRARY: &[CheckStep] = &[
    CheckStep("library alone: what it depends on", library_alone::check),
    CheckStep(
        "lab page for wasm32-unknown-unknown",
        lab_page::build_for_tests,
    ),
    CheckStep("lab page in a browser", lab_page::test),
];

/// The cross-build.
pub const FIRMWARE: &[CheckStep] = &[
    CheckStep("firmware for thumbv7em-none-eabihf", images::build),
    CheckStep("the servo as a library for C on it", images::servo_for_c),
    CheckStep(
        "control interrupt's code: in its own memory, no float, no panic",
        images::check,
    ),
];

/// The image on the emulated part, and what comes of its log.
const EMULATED: &[CheckStep] = &[
    CheckStep("emulated STM32H743: run the image", checks::emulator_tests),
    CheckStep("the operator's program", board::place),
    CheckStep(
        "the debug probe's program: what an image and a chip must be",
        checks::probe_tests,
    ),
    CheckStep(
        "whole circle: the image's log, identified, names the hidden effect",
        whole_circle::run,
    ),
];

/// Programs in front of the emulated board.
pub const OPERATOR: &[CheckStep] = &[
    CheckStep("PIPython in front of the emulated board", pipython::run),
    CheckStep(
        "PIPython in front of an emulated stick-slip drive",
        pipython::run_stick_slip,
    ),
    CheckStep(
        "from an empty board to a servo: `board tune`, a stage of other equations",
        board_tune::run_independent,
    ),
];

/// What is published.
pub const PACKAGES: &[CheckStep] = &[CheckStep("packages as they are published", packages::check)];

/// What takes long, beside the check.
const LONG: &[CheckStep] = &[
    CheckStep(
        "tests that take long (72 independent stages, 330,000 damaged inputs)",
        checks::long_tests,
    ),
    CheckStep(
        "`board tune`, a stage of the simulation's equations",
        board_tune::run,
    ),
    CheckStep("lab page as it is published", lab_page::build),
    CheckStep("packages as they are published", packages::check),
    CheckStep("mutations of the firmware's safety lines", || {
        mutate::run(&[])
    }),
];

/// The emulated target.
pub fn emulator() -> Vec<CheckStep> {
    [EMULATED, OPERATOR].concat()
}

/// The steps of other targets, second line of the check.
fn of_other_targets() -> Vec<CheckStep> {
    [LIBRARY, FIRMWARE, EMULATED, OPERATOR].concat()
}

/// The command that runs [`of_other_targets`].
const OTHER_TARGETS: &str = "targets";

/// Where the output of the second line goes.
const OUTPUT_OF_OTHER_TARGETS: &str = "target/other_targets.log";

/// While this is there, the second line begins no further step. It is not killed: the programs that its step
/// started, an emulated board among them, would run on.
const NO_FURTHER_STEP: &str = "target/no_further_step";

/// Where [`full`] writes when it was last green, and what it ran.
const OUTPUT_OF_FULL: &str = "target/full.txt";

/// Everything, in two lines side by side.
pub fn check() -> Result<(), String> {
    let stopwatch = Stopwatch::start();
    forget_the_last_run()?;
    CheckStep("what this machine needs", install_what_is_needed).run("")?;
    let path = root().join(OUTPUT_OF_OTHER_TARGETS);
    let problem = |error: std::io::Error| format!("{}: {error}", path.display());
    std::fs::create_dir_all(root().join("target")).map_err(problem)?;
    let output = File::create(&path).map_err(problem)?;
    let program = std::env::current_exe()
        .map_err(|error| format!("this program cannot be found: {error}"))?;
    println!("\n== beside it: cargo xtask {OTHER_TARGETS} > {OUTPUT_OF_OTHER_TARGETS}");
    let mut beside = Command::new(program)
        .arg(OTHER_TARGETS)
        .stdout(output.try_clone().map_err(problem)?)
        .stderr(output)
        .spawn()
        .map_err(problem)?;
    let of_host = run_until(
        &[HOUSE, HOST, PYTHON].concat(),
        || matches!(beside.try_wait(), Ok(Some(status)) if !status.success()),
    );
    let no_further_step = root().join(NO_FURTHER_STEP);
    if of_host.is_err() {
        std::fs::write(&no_further_step, "").map_err(problem)?;
    }
    if let Ok(None) = beside.try_wait() {
        println!(
            "\n== waiting for cargo xtask {OTHER_TARGETS} (tail -f {OUTPUT_OF_OTHER_TARGETS})"
        );
    }
    let ended = beside.wait().map_err(problem)?;
    let _ = std::fs::remove_file(&no_further_step);
    println!("\n== cargo xtask {OTHER_TARGETS}");
    print!(
        "{}",
        String::from_utf8_lossy(&std::fs::read(&path).map_err(problem)?)
    );
    of_host?;
    if !ended.success() {
        return Err(format!(
            "FAILED  cargo xtask {OTHER_TARGETS}: see above, or {OUTPUT_OF_OTHER_TARGETS}"
        ));
    }
    cost::print()?;
    println!("\nok {}  in all", stopwatch.read());
    skipped_tests::print();
    Ok(())
}

/// The second line of the check. What it costs and skips is part of the check's.
pub fn run_other_targets() -> Result<(), String> {
    let no_further_step = root().join(NO_FURTHER_STEP);
    run_until(&of_other_targets(), || no_further_step.exists())
}

/// The check and what takes long.
pub fn full() -> Result<(), String> {
    let output = root().join(OUTPUT_OF_FULL);
    let last = std::fs::read_to_string(&output).unwrap_or_else(|_| "no green run so far".into());
    println!("   {OUTPUT_OF_FULL}: {}", last.trim_end());
    println!("   beside `cargo xtask check`:");
    for CheckStep(name, _) in LONG {
        println!("   - {name}");
    }
    let stopwatch = Stopwatch::start();
    check()?;
    run_until(LONG, || false)?;
    let seconds = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    let names: Vec<&str> = LONG.iter().map(|CheckStep(name, _)| *name).collect();
    let text = format!(
        "green at {seconds} s of Unix time, in {}: the check, {}\n",
        stopwatch.read(),
        names.join(", ")
    );
    std::fs::write(&output, text).map_err(|error| format!("{}: {error}", output.display()))
}

/// Runs the steps in order until one fails, and prints where the time went.
pub fn run(steps: &[CheckStep]) -> Result<(), String> {
    forget_the_last_run()?;
    run_until(steps, || false)?;
    cost::print()?;
    skipped_tests::print();
    Ok(())
}

/// What an earlier run cost and had to skip says nothing of this one.
fn forget_the_last_run() -> Result<(), String> {
    cost::forget();
    skipped_tests::forget()
}

/// Two lines of steps must not install at the same time.
fn install_what_is_needed() -> Result<(), String> {
    toolchain::for_target(&toolchain::FIRMWARE)?;
    toolchain::for_target(&toolchain::WEB_ASSEMBLY)?;
    virtual_environment::see_to_python()?;
    debian::see_to_octave()?;
    debian::see_to_valgrind()?;
    browser::ensure()
}

/// Runs the steps in order until one fails, or what goes on beside them has.
fn run_until(steps: &[CheckStep], mut failed_beside: impl FnMut() -> bool) -> Result<(), String> {
    for (number, step) in steps.iter().enumerate() {
        if failed_beside() {
            return Err("stopped: the other steps have failed\n".into());
        }
        step.run(&format!("{}/{} ", number + 1, steps.len()))?;
    }
    Ok(())
}

impl CheckStep {
    /// Announces the step, runs it and prints what it cost.
    fn run(self, number: &str) -> Result<(), String> {
        let Self(name, action) = self;
        println!("\n== {number}{name}");
        let stopwatch = Stopwatch::start();
        action().map_err(|error| format!("FAILED  {name}: {error}"))?;
        let cost = stopwatch.read();
        cost::keep(Share::Step, name, cost);
        println!("== ok {cost}  {number}{name}");
        Ok(())
    }
}
