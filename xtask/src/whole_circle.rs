//! From the target's own log to the effect that a model misses: nothing in it was recorded on the host.
//!
//! The tests on the emulated target leave the log of a drive that the image played on an actuator with hysteresis, a first rise, one mode and
//! creep. Here it becomes a data set, a model without creep is identified from it, and the diagnosis must name creep first. A servo is designed
//! from the same model, down to the parameter block.

use crate::steps::{cargo, root};
use crate::toolchain;

/// What the actuator has and the model is not given.
const HIDDEN: &str = "creep";
const GIVEN: &str = "hysteresis,initial_curve,vibration";

/// Captures, identifies, diagnoses, designs.
pub fn run() -> Result<(), String> {
    let log = root().join("emulator/target/tmp/record.rtt");
    if !log.is_file() {
        return Err(format!("{} is not there: `cargo xtask emulate` leaves it", log.display()));
    }
    let folder = root().join("target/whole_circle");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let image = toolchain::image();
    let hysteron =
        |arguments: &[&str]| cargo(&[&["run", "--quiet", "--release", "--package", "hysteron", "--"], arguments].concat(), &root(), &[]);
    hysteron(&["capture", &image.to_string_lossy(), &log.to_string_lossy(), "--out", &path("record")])?;
    hysteron(&["identify", &path("record"), "--effects", GIVEN, "--out", &path("model.toml")])?;
    hysteron(&["diagnose", &path("model.toml"), &path("record"), "--json", &path("diagnosis.json")])?;
    let text = std::fs::read_to_string(path("diagnosis.json")).map_err(|error| error.to_string())?;
    let diagnosis: serde_json::Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    match diagnosis["candidates"][0]["effect"].as_str() {
        Some(HIDDEN) => {}
        other => return Err(format!("the diagnosis names {} first, not {HIDDEN}", other.unwrap_or("nothing"))),
    }
    // And from the same record the next controller, as the block that the target keeps.
    hysteron(&["design", &path("model.toml"), "--out", &path("servo.toml"), "--block", &path("servo.block")])
}
