//! The steps of `cargo xtask check`, and how they are run.
//!
//! `check` runs two lines of steps side by side: those of the host, and those of other targets (WebAssembly,
//! the firmware, the emulated part) as a second process, whose output is a file that is shown at the end.
//! Compilers use all processors and wait for one another at the folder of artifacts, as cargo sees to; many
//! tests use one. What either would install is installed before. Where one line fails the other ends with the
//! step that it is at.

use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use crate::test_programs::{self, TestProgram};
use crate::{
    board, board_tune, browser, control_code, debian, house, lab_page, library_alone, mutate,
    packages, pipython, prose, public_items, python_package, result_tables, toolchain,
    virtual_environment, whole_circle,
};

/// One step: its name and what it does.
pub struct CheckStep {
    name: &'static str,
    action: fn() -> Result<(), String>,
}

/// What the host's compiler builds: first of the two lines of the check.
fn of_the_host() -> Vec<CheckStep> {
    let mut steps = house();
    steps.extend(host());
    steps.extend(python());
    steps
}

/// The steps of other targets, second line of the check.
pub fn of_other_targets() -> Vec<CheckStep> {
    let mut steps = library();
    steps.extend(firmware());
    steps.extend(emulator());
    steps
}

/// The command that runs [`of_other_targets`].
pub const OTHER_TARGETS: &str = "targets";

/// Where the output of the second line goes.
const OUTPUT_OF_OTHER_TARGETS: &str = "target/other_targets.log";

/// Everything, in two lines side by side.
pub fn check() -> Result<(), String> {
    let begin = Instant::now();
    run_one("what this machine needs", install_what_is_needed)?;
    forget_skipped_tests()?;
    let path = root().join(OUTPUT_OF_OTHER_TARGETS);
    let told = |error: std::io::Error| format!("{}: {error}", path.display());
    std::fs::create_dir_all(root().join("target")).map_err(told)?;
    let output = File::create(&path).map_err(told)?;
    let program = std::env::current_exe()
        .map_err(|error| format!("this program cannot be found: {error}"))?;
    println!("\n== beside it: cargo xtask {OTHER_TARGETS} > {OUTPUT_OF_OTHER_TARGETS}");
    let mut beside = Command::new(program)
        .arg(OTHER_TARGETS)
        .stdout(output.try_clone().map_err(told)?)
        .stderr(output)
        .spawn()
        .map_err(told)?;
    let mut summary = String::new();
    let of_host = run_until(
        &of_the_host(),
        &mut summary,
        || matches!(beside.try_wait(), Ok(Some(status)) if !status.success()),
    );
    if of_host.is_err() {
        // The step that it is at goes on by itself to its end; none follows.
        let _ = beside.kill();
    }
    if let Ok(None) = beside.try_wait() {
        println!(
            "\n== waiting for cargo xtask {OTHER_TARGETS} (tail -f {OUTPUT_OF_OTHER_TARGETS})"
        );
    }
    let ended = beside.wait().map_err(told)?;
    println!("\n== cargo xtask {OTHER_TARGETS}");
    print!(
        "{}",
        String::from_utf8_lossy(&std::fs::read(&path).map_err(told)?)
    );
    of_host.map_err(|error| format!("{summary}{error}"))?;
    if !ended.success() {
        return Err(format!(
            "FAILED  cargo xtask {OTHER_TARGETS}: see above, or {OUTPUT_OF_OTHER_TARGETS}"
        ));
    }
    println!(
        "\n{summary}ok {:6.1} s  in all",
        begin.elapsed().as_secs_f64()
    );
    tell_skipped_tests();
    Ok(())
}

/// Two lines of steps must not install at the same time.
fn install_what_is_needed() -> Result<(), String> {
    toolchain::for_target(&toolchain::FIRMWARE)?;
    toolchain::for_target(&toolchain::WEB_ASSEMBLY)?;
    virtual_environment::see_to_python()?;
    debian::see_to_octave()?;
    browser::ensure()
}

/// The steps that need only the host's toolchain.
pub fn host() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "format",
            action: format,
        },
        CheckStep {
            name: "lints",
            action: lints,
        },
        CheckStep {
            name: "documentation",
            action: documentation,
        },
        CheckStep {
            name: "what the library shows",
            action: public_items::check,
        },
        CheckStep {
            name: "prose",
            action: || prose::report(&[]),
        },
        CheckStep {
            name: "tables of results",
            action: result_tables::check,
        },
        CheckStep {
            name: "host tests (release)",
            action: host_tests,
        },
        CheckStep {
            name: "examples in the documentation",
            action: documentation_tests,
        },
    ]
}

/// The library without its default features, and the page that is made with it.
pub fn library() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "library alone: what it depends on",
            action: library_alone::dependencies,
        },
        CheckStep {
            name: "library and lab page for wasm32-unknown-unknown",
            action: lab_page::build_for_tests,
        },
        CheckStep {
            name: "lab page in a browser",
            action: lab_page::test,
        },
    ]
}

/// What stands beside the sources.
pub fn house() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "workflows, citation, licences",
            action: house::lint,
        },
        CheckStep {
            name: "manifests",
            action: packages::manifests,
        },
    ]
}

/// What is published.
pub fn packages() -> Vec<CheckStep> {
    vec![CheckStep {
        name: "packages as they are published",
        action: packages::check,
    }]
}

/// The Python package.
pub fn python() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "Python package in a fresh environment",
            action: python_package::test,
        },
        CheckStep {
            name: "formats as their own libraries write them today",
            action: python_package::formats,
        },
    ]
}

/// The cross-build.
pub fn firmware() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "firmware for thumbv7em-none-eabihf",
            action: firmware_images,
        },
        CheckStep {
            name: "control interrupt's code: in its own memory, no float, no panic",
            action: control_code,
        },
    ]
}

/// The emulated target.
pub fn emulator() -> Vec<CheckStep> {
    let mut steps = image_on_the_emulated_part();
    steps.extend(operator());
    steps
}

/// Programs in front of the emulated board.
pub fn operator() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "PIPython in front of the emulated board",
            action: pipython::run,
        },
        CheckStep {
            name: "from an empty board to a servo: `board tune`",
            action: board_tune::run,
        },
        CheckStep {
            name: "the same with a stage of other equations",
            action: board_tune::run_independent,
        },
    ]
}

fn image_on_the_emulated_part() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "emulated STM32H743: run the image",
            action: emulator_tests,
        },
        CheckStep {
            name: "the operator's program",
            action: board::place,
        },
        CheckStep {
            name: "the debug probe's program: what an image and a chip must be",
            action: probe_tests,
        },
        CheckStep {
            name: "whole circle: the image's log, identified, names the hidden effect",
            action: whole_circle::run,
        },
    ]
}

/// Runs the steps in order until one fails, and prints a summary.
pub fn run(steps: &[CheckStep]) -> Result<(), String> {
    let begin = Instant::now();
    let mut summary = String::new();
    run_until(steps, &mut summary, || false).map_err(|error| format!("{summary}{error}"))?;
    println!(
        "\n{summary}ok {:6.1} s  in all",
        begin.elapsed().as_secs_f64()
    );
    tell_skipped_tests();
    Ok(())
}

/// Runs the steps in order until one fails, or what goes on beside them has. A line for each goes to the
/// summary.
fn run_until(
    steps: &[CheckStep],
    summary: &mut String,
    mut failed_beside: impl FnMut() -> bool,
) -> Result<(), String> {
    for (number, step) in steps.iter().enumerate() {
        if failed_beside() {
            return Err("stopped: the other steps have failed\n".into());
        }
        let line = run_one(
            &format!("{}/{} {}", number + 1, steps.len(), step.name),
            step.action,
        )?;
        summary.push_str(&line);
    }
    Ok(())
}

/// Announces a step and runs it; the line that says how long it took.
fn run_one(name: &str, action: fn() -> Result<(), String>) -> Result<String, String> {
    println!("\n== {name}");
    let (start, processor_before) = (Instant::now(), processor_s());
    action().map_err(|error| format!("FAILED  {name}: {error}"))?;
    let mut line = format!("ok {:6.1} s", start.elapsed().as_secs_f64());
    if let (Some(before), Some(now)) = (processor_before, processor_s()) {
        line.push_str(&format!("  {:6.1} s of processor", now - before));
    }
    line.push_str(&format!("  {name}\n"));
    print!("== {line}");
    Ok(line)
}

/// Seconds of processor that programs started by this one have taken and ended, where the system tells
/// (Linux): what a step costs does not depend on what runs beside it.
fn processor_s() -> Option<f64> {
    const TICKS_PER_S: f64 = 100.0;
    let status = std::fs::read_to_string("/proc/self/stat").ok()?;
    // Behind the name of the program in brackets, which may hold blanks: proc(5), fields 16 and 17.
    let mut fields = status.rsplit_once(')')?.1.split_whitespace().skip(13);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_S)
}

/// Says which tests could not run.
fn tell_skipped_tests() {
    let skipped = skipped_tests();
    if !skipped.is_empty() {
        println!(
            "\n!! {} tests were SKIPPED and say nothing about this checkout:\n!!   {}",
            skipped.len(),
            skipped.join("\n!!   ")
        );
    }
}

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(|| PathBuf::from("."), Path::to_path_buf)
}

/// A program of the workspace's release build.
pub fn built(name: &str) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| root().join("target"), Into::into)
        .join("release")
        .join(name)
}

/// Builds the workspace as its tests have it, for a step that needs its programs: a build without them has
/// other features of its dependencies and would begin anew.
pub fn build_as_tested() -> Result<(), String> {
    cargo(
        &[&["test", "--quiet", "--no-run"], &AS_TESTED[..]].concat(),
        &root(),
        &[],
    )
}

/// The workspace with all features, in one profile: tests, lints and programs share what they are built with.
/// The emulated part declares a newer compiler than it needs; Cargo.lock names versions that build on this
/// one.
pub const AS_TESTED: [&str; 5] = [
    "--release",
    "--workspace",
    "--features",
    "hysteron-cli/full",
    "--ignore-rust-version",
];

/// Runs a command in a folder of the repository and fails with its own words.
pub fn command(
    program: impl AsRef<OsStr>,
    arguments: &[&str],
    folder: &Path,
    variables: &[(&str, &str)],
) -> Result<(), String> {
    let program = program.as_ref();
    let words = format!("{} {}", program.to_string_lossy(), arguments.join(" "));
    println!("   {words}");
    let status = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .envs(variables.iter().copied())
        .status()
        .map_err(|error| format!("`{words}` cannot be started: {error}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!(
            "`{words}` in {} ended with {status}",
            folder.display()
        ))
    }
}

/// Runs this cargo.
pub fn cargo(arguments: &[&str], folder: &Path, variables: &[(&str, &str)]) -> Result<(), String> {
    command(
        std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()),
        arguments,
        folder,
        variables,
    )
}

fn format() -> Result<(), String> {
    for folder in [root(), root().join("firmware"), root().join("board/probe")] {
        cargo(&["fmt", "--check", "--all"], &folder, &[])?;
    }
    Ok(())
}

fn lints() -> Result<(), String> {
    // The profile of the tests, so that dependencies are built once.
    cargo(
        &[
            &["clippy", "--quiet"],
            &AS_TESTED[..],
            &["--all-targets", "--", "-D", "warnings"],
        ]
        .concat(),
        &root(),
        &[],
    )
}

fn documentation() -> Result<(), String> {
    cargo(
        &[
            &["doc", "--quiet"],
            &AS_TESTED[..],
            &["--no-deps", "--document-private-items"],
        ]
        .concat(),
        &root(),
        &[(
            "RUSTDOCFLAGS",
            "-D warnings -A rustdoc::private-intra-doc-links",
        )],
    )
}

/// To which tests that cannot run add a line (`tests/src/lib.rs`).
pub fn skipped_file() -> PathBuf {
    root().join("target/skipped_tests.txt")
}

fn skipped_tests() -> Vec<String> {
    let mut lines: Vec<String> = std::fs::read_to_string(skipped_file()).map_or_else(
        |_| Vec::new(),
        |text| text.lines().map(String::from).collect(),
    );
    lines.sort();
    lines
}

/// What an earlier run had to skip says nothing of this one.
pub fn forget_skipped_tests() -> Result<(), String> {
    let file = skipped_file();
    if file.exists() {
        std::fs::remove_file(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    Ok(())
}

/// Everything but the emulated part, whose tests need the image.
fn host_tests() -> Result<(), String> {
    browser::ensure()?;
    let programs = test_programs::build()?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| !program.is_of(EMULATOR))
        .collect();
    let (skipped, python) = (skipped_file(), virtual_environment::with_numpy()?);
    let (skipped, python) = (skipped.to_string_lossy(), python.to_string_lossy());
    let [of_skipped, random_cases] = variables(&skipped);
    test_programs::run(
        &chosen,
        &[],
        &[of_skipped, random_cases, ("HYSTERON_PYTHON", &python)],
    )
}

fn documentation_tests() -> Result<(), String> {
    cargo(
        &[&["test", "--quiet", "--doc"], &AS_TESTED[..]].concat(),
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
            &AS_TESTED[..],
            &["--test", "integration", &filter],
        ]
        .concat();
        cargo(&arguments, &root(), &[("HYSTERON_WRITE_README", "1")])?;
    }
    Ok(())
}

fn firmware_images() -> Result<(), String> {
    let toolchain = toolchain::for_target(&toolchain::FIRMWARE)?;
    let folder = root().join("firmware");
    let image = toolchain::image();
    // With the map that the linker writes beside it.
    let keep = |other: PathBuf| {
        let copy = |from: &Path, to: &Path| {
            std::fs::copy(from, to)
                .map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
        };
        copy(&image.with_extension("map"), &other.with_extension("map"))?;
        copy(&image, &other)
    };
    // All binaries of the other board; the run copies one of them, and only builds the other.
    let small = [
        "--config",
        "profile.release.package.hysteron-core.opt-level=\"s\"",
    ];
    toolchain.build(
        &toolchain::FIRMWARE,
        &folder,
        &[
            &["--no-default-features", "--features", "nucleo-g474re"],
            &small[..],
        ]
        .concat(),
    )?;
    keep(toolchain::g474re_image())?;
    toolchain.build(
        &toolchain::FIRMWARE,
        &folder,
        &[
            "--bin",
            "hysteron-firmware",
            "--features",
            "on-chip-converters",
        ],
    )?;
    keep(toolchain::on_chip_image())?;
    let fast = [("HYSTERON_SAMPLE_RATE_HZ", "100000")];
    toolchain.build_with(
        &toolchain::FIRMWARE,
        &folder,
        &["--bin", "hysteron-firmware"],
        &fast,
    )?;
    keep(toolchain::fast_image())?;
    // With the boot stage: so both are built of the same dependencies.
    toolchain.build(&toolchain::FIRMWARE, &folder, &["--workspace"])
}

/// What the image may take; a change that needs more has to change these numbers. 1 KiB of it looks at what
/// is typed before it acts, 3 KiB let another block take over the running loop, 2 KiB adapt the gain of its
/// model. 5 KiB more are the sliding-mode law, the self-test, the judgement of a conditioning, waveforms of
/// two quantities, and the log of faults. 4 KiB more are the creep of what was applied (1.7), filters (1.1)
/// and the watch of the output.
const MOST_CONTROL_CODE_BYTES: u64 = 36 * 1024;
/// All of the NUCLEO-G474RE's memory for it; there `hysteron-core` is compiled for its size.
const MOST_G474RE_CONTROL_CODE_BYTES: u64 = 32 * 1024;
/// 12 KiB of it are blocks, diagnosis and recorded codes over the serial port, 4 KiB the supply, the option
/// bytes and the host that is missed, 4 KiB the figures of the closed loop and the alarm of its resonance,
/// 5 KiB the block that takes over, 3 KiB the gain that is adapted, 2 KiB codes of up to 20 bits: how many
/// the block says, frames as long as they are, samples that are packed and unpacked. 50 KiB more are the
/// safety envelope, arming, the self-test, the sliding-mode law and the log of faults over both channels.
/// 20 KiB more are filters, their design from frequencies, settings that are kept, and the watch of the
/// output. 10 KiB more are the update over the line. The filters' sections are written out in the tick: 0.4
/// KiB that save 240 instructions. The rest is room, as images of the same sources differ between machines.
/// An image that is updated has 384 KiB.
const MOST_FLASH_BYTES: u64 = 276 * 1024;
/// 10 KiB of it are what a periodic reference learns: 8 of points (4.9 Hz at 20 kHz), 1 of the newest errors,
/// 1 of its filters, twice; 1 KiB is a block that waits to take over. 2 KiB are the log of faults and the
/// sliding-mode law's parameters and state. 1 KiB more is the creep that the tick follows, 88 bytes,
/// filters and the settings that are kept. 1 KiB more is the task that writes an image.
const MOST_RAM_BYTES: u64 = 75 * 1024;
/// Of the 76 KiB of the NUCLEO-G474RE: what is left for the stack is 1.7 KiB more than the same program uses
/// of the other board's. 0.7 KiB of it are the gain that is adapted: the coefficients that depend on it,
/// twice.
/// 1 KiB is filters, and the settings that are kept.
const MOST_G474RE_RAM_BYTES: u64 = 46 * 1024;

fn control_code() -> Result<(), String> {
    let nucleo_h743zi = [MOST_CONTROL_CODE_BYTES, MOST_RAM_BYTES];
    check_image(
        "NUCLEO-H743ZI2, SPI converters",
        &toolchain::image(),
        nucleo_h743zi,
    )?;
    check_image(
        "NUCLEO-H743ZI2, on-chip converters",
        &toolchain::on_chip_image(),
        nucleo_h743zi,
    )?;
    check_image(
        "NUCLEO-H743ZI2, 100 kHz",
        &toolchain::fast_image(),
        nucleo_h743zi,
    )?;
    check_image(
        "NUCLEO-G474RE",
        &toolchain::g474re_image(),
        [MOST_G474RE_CONTROL_CODE_BYTES, MOST_G474RE_RAM_BYTES],
    )
}

fn check_image(
    name: &str,
    image: &Path,
    [most_control_code_bytes, most_ram_bytes]: [u64; 2],
) -> Result<(), String> {
    let figures = control_code::check(image)?;
    println!(
        "   {name}: control interrupt: {} bytes in {} functions, {} jump-table entries for impossible values; image: {} bytes of flash, {} bytes of static RAM",
        figures.control_code_bytes,
        figures.control_functions,
        figures.impossible_cases,
        figures.flash_bytes,
        figures.ram_bytes
    );
    for (what, value, most) in [
        (
            "control code",
            figures.control_code_bytes,
            most_control_code_bytes,
        ),
        ("flash", figures.flash_bytes, MOST_FLASH_BYTES),
        ("static RAM", figures.ram_bytes, most_ram_bytes),
    ] {
        if value > most {
            return Err(format!(
                "{name}: {what}: {value} bytes, more than the {most} of xtask/src/steps.rs"
            ));
        }
    }
    Ok(())
}

/// No probe is at hand: what is tested is what is looked at before and around it. In the profile that is
/// built fastest.
fn probe_tests() -> Result<(), String> {
    cargo(
        &["test", "--quiet", "--locked"],
        &root().join("board/probe"),
        &[],
    )
}

fn emulator_tests() -> Result<(), String> {
    let image = toolchain::image();
    if !image.is_file() {
        return Err(format!(
            "{} is not there: run `cargo xtask firmware` first",
            image.display()
        ));
    }
    let programs = test_programs::build()?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| program.is_of(EMULATOR))
        .collect();
    test_programs::run(&chosen, &[], &[])
}

/// Unit tests alone.
fn unit_tests() -> Result<(), String> {
    let programs = test_programs::build()?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| program.has_unit_tests() && !program.is_of(EMULATOR))
        .collect();
    test_programs::run(&chosen, &[], &variables(&skipped_file().to_string_lossy()))
}

/// README's first command.
fn one_explain() -> Result<(), String> {
    let model = "hysteresis,initial_curve,vibration";
    command(
        built("hysteron"),
        &["explain", "examples/hidden_effect", "--from", model],
        &root(),
        &[],
    )
}

/// What an edit is tried with: minutes where everything is built.
pub fn quick() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "format",
            action: format,
        },
        CheckStep {
            name: "lints",
            action: lints,
        },
        CheckStep {
            name: "unit tests",
            action: unit_tests,
        },
        CheckStep {
            name: "one explain",
            action: one_explain,
        },
        CheckStep {
            name: "prose",
            action: || prose::report(&[]),
        },
    ]
}

/// What takes long, beside the check.
fn long() -> Vec<CheckStep> {
    vec![
        CheckStep {
            name: "tests that take long (72 independent stages)",
            action: long_tests,
        },
        CheckStep {
            name: "lab page as it is published",
            action: lab_page::build,
        },
        CheckStep {
            name: "packages as they are published",
            action: packages::check,
        },
        CheckStep {
            name: "mutations of the firmware's safety lines",
            action: || mutate::run(&[]),
        },
    ]
}

/// Tests marked as long; those that need what another step leaves are run by that step.
fn long_tests() -> Result<(), String> {
    let programs = test_programs::build()?;
    let chosen: Vec<&TestProgram> = programs
        .iter()
        .filter(|program| program.is_of("tests") && program.kind == "test")
        .collect();
    let arguments = [
        "--ignored",
        "--skip",
        "lab_page::",
        "--skip",
        "trace_on_page::",
    ];
    test_programs::run(
        &chosen,
        &arguments,
        &variables(&skipped_file().to_string_lossy()),
    )
}

/// Where [`full`] writes when it was last green, and what it ran.
const OUTPUT_OF_FULL: &str = "target/full.txt";

/// The check and what takes long.
pub fn full() -> Result<(), String> {
    let output = root().join(OUTPUT_OF_FULL);
    let last = std::fs::read_to_string(&output).unwrap_or_else(|_| "no green run so far".into());
    println!("   {OUTPUT_OF_FULL}: {}", last.trim_end());
    println!("   beside `cargo xtask check`:");
    for step in long() {
        println!("   - {}", step.name);
    }
    let begin = Instant::now();
    check()?;
    run(&long())?;
    let seconds = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |since| since.as_secs());
    let names: Vec<&str> = long().iter().map(|step| step.name).collect();
    let text = format!(
        "green at {seconds} s of Unix time, in {:.0} s: the check, {}\n",
        begin.elapsed().as_secs_f64(),
        names.join(", ")
    );
    std::fs::write(&output, text).map_err(|error| format!("{}: {error}", output.display()))
}
