//! From the target's own log to the effect that a model misses: nothing in it was recorded on the host.
//!
//! The tests on the emulated target leave the log of the drive that the image played on an actuator with
//! hysteresis, a first rise, one mode and creep. Here it becomes a data set; `explain` begins without creep
//! and must find creep and nothing else. The creep of the thesis has a pair of complex poles (Ch. 5, Eq. 17),
//! which no known effect has: that something is left above the noise is right to be said. A servo is designed
//! from the model that it comes to, down to the parameter block.

use crate::test_programs;
use crate::workspace::{AS_TESTED, built, cargo, command, root};
use crate::{browser, lab_page, skipped_tests, toolchain};

/// What the actuator has and the model is not given.
const HIDDEN: &str = "creep";
const GIVEN: &str = "hysteresis,initial_curve,vibration";

/// Captures, explains, designs.
pub fn run() -> Result<(), String> {
    let log = root().join("target/tmp/record.rtt");
    if !log.is_file() {
        return Err(format!(
            "{} is not there: `cargo xtask emulate` leaves it",
            log.display()
        ));
    }
    let folder = root().join("target/whole_circle");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let image = toolchain::image();
    test_programs::build(AS_TESTED)?;
    let program = built("hysteron");
    let hysteron = |arguments: &[&str]| command(&program, arguments, &root(), &[]);
    hysteron(&[
        "capture",
        &image.to_string_lossy(),
        &log.to_string_lossy(),
        "--out",
        &path("record"),
        "--force",
    ])?;
    let explain = [
        "explain",
        &path("record"),
        "--from",
        GIVEN,
        "--out",
        &path("model.toml"),
        "--json",
        &path("explain.json"),
        "--force",
    ];
    hysteron(&explain)?;
    let text = std::fs::read_to_string(path("explain.json")).map_err(|error| error.to_string())?;
    let found: serde_json::Value =
        serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let texts = |value: &serde_json::Value| -> Vec<String> {
        value
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|name| name.as_str().map(String::from))
            .collect()
    };
    let diagnosis = &found["diagnosis"];
    let findings: Vec<Vec<String>> = diagnosis["findings"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|one| texts(&one["effects"]))
        .collect();
    let named = texts(&diagnosis["named"]);
    let error_nm = |when: &str, role: &str| {
        diagnosis[when][role]
            .as_f64()
            .map_or(f64::INFINITY, |um| 1e3 * um)
    };
    // The image's stage is no model of the library, and what is left is some five times the noise: what
    // lowers that may stand behind what is missed most, and nothing else has a name.
    if findings.first().is_none_or(|first| first != &[HIDDEN])
        || named.iter().any(|id| id != HIDDEN)
    {
        return Err(format!(
            "the diagnosis finds {findings:?} and names {named:?}, not {HIDDEN} first and nothing else"
        ));
    }
    for role in ["identify", "validate"] {
        let (before_nm, after_nm) = (
            error_nm("residual_rms_um", role),
            error_nm("residual_rms_after_um", role),
        );
        println!("   with {HIDDEN}: {role} {before_nm:.2} -> {after_nm:.2} nm");
        if after_nm >= before_nm / 2.0 {
            return Err(format!(
                "with {HIDDEN} the error of `{role}` falls from {before_nm} to {after_nm} nm only"
            ));
        }
    }
    // The page reads the same log.
    browser::ensure()?;
    let seen = [
        ("HYSTERON_PAGE", lab_page::file()),
        ("HYSTERON_IMAGE", image),
        ("HYSTERON_LOG", log),
        ("HYSTERON_SKIPPED", skipped_tests::file()),
    ];
    let seen = seen.map(|(name, path)| (name, path.to_string_lossy().into_owned()));
    let variables: Vec<(&str, &str)> = seen
        .iter()
        .map(|(name, path)| (*name, path.as_str()))
        .collect();
    cargo(
        &[
            &["test"],
            AS_TESTED,
            &[
                "--test",
                "integration",
                "trace_on_page::",
                "--",
                "--ignored",
            ],
        ]
        .concat(),
        &root(),
        &variables,
    )?;
    // And from the same record the next controller, as the block that the target keeps.
    hysteron(&[
        "design",
        &path("model.toml"),
        "--out",
        &path("servo.toml"),
        "--block",
        &path("servo.block"),
        "--force",
    ])
}
