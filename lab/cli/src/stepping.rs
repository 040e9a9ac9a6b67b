//! `stepping`.

use crate::arguments::{Outputs, as_typed};
use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use hysteron::Result;
use hysteron::stepping::{Measured, SteppingTrain, measure};
use hysteron_report::stepping_page;
use std::path::Path;

fn figure(figure: Measured, unit: &str) -> String {
    format!("{:.4} ± {:.4} {unit}", figure.value, figure.std)
}

fn print_train(train: &SteppingTrain) {
    println!(
        "  {} from {:.3} s: {} saw-teeth of {:.1} V at {:.2} Hz, {} counted",
        train.record,
        train.from_s,
        train.teeth,
        train.amplitude_v,
        train.frequency_hz,
        train.counted
    );
    println!(
        "    velocity {}, step {}, scatter {}, backward {}",
        figure(train.velocity_um_s, "um/s"),
        figure(train.step_um, "um"),
        figure(train.scatter_um, "um"),
        figure(train.backward_um, "um")
    );
    if let Some(stop) = &train.stop {
        println!(
            "    stop: swing {}, settles in {:.2} ms",
            figure(stop.swing_um, "um"),
            1e3 * stop.settling_s
        );
    }
}

/// Measures the performance of a stick-slip drive from a recording.
pub fn stepping(path: &Path, reading: &ReadArguments, outputs: &Outputs) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let dataset = desk.dataset(path, reading)?;
    outputs.check(&desk)?;
    let found = measure(&dataset)?;
    let noise = found.noise_um.map_or_else(
        || "no rest shows the sensor's noise, so the scatter holds it".to_owned(),
        |um| format!("noise of the sensor {:.2} nm", 1e3 * um),
    );
    println!(
        "{}: {} trains of saw-teeth; {noise}",
        found.name,
        found.trains.len()
    );
    found.trains.iter().for_each(print_train);
    desk.write_json(outputs.json.as_deref(), &found)?;
    desk.write_page(outputs.report.as_deref(), || {
        stepping_page(&found, &dataset, as_typed())
    })?;
    Ok(true)
}
