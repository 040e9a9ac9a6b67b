//! Makes the parameter block that the emulated target's tests run with: identifies a model from a record of
//! the reference bench, designs the servo, and writes the block.
//!
//! `cargo run --release --package hysteron-thesis --example reference_block --
//! board/emulator/tests/p753.block`, and with `board/emulator/tests/p753_100khz.block 100000` or
//! `board/emulator/tests/p753_50khz.block 50000` the one for an image of that rate.

use hysteron::servo::amplifier_block::{
    FrontEnd, USUAL_SAMPLE_RATE_HZ, amplifier_parameters, block,
};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::sensor_lag;
use hysteron::servo::tuning::Demands;
use hysteron_sim::bench::{Bench, Variant};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args()
        .nth(1)
        .ok_or("expected the file to write")?;
    let sample_rate_hz = std::env::args()
        .nth(2)
        .map_or(Ok(USUAL_SAMPLE_RATE_HZ), |rate| rate.parse())?;
    let front_end = FrontEnd {
        name: "p753".into(),
        sample_rate_hz,
        ..FrontEnd::default()
    };
    let bench = Bench::reference()?;
    let mut identified =
        hysteron_thesis::commissioning::on_bench(&bench, Variant::FULL, 1).ok_or("no model")?;
    identified.model.linear.period_s = front_end.period_s();
    let mut design = ServoDesign::best(&identified.model, &Demands::default())
        .ok_or("no tuning keeps all margins")?;
    // The data sheet's, which the model holds.
    design.sensor_lag_s = identified
        .model
        .linear
        .sensor_bandwidth_hz
        .map(sensor_lag::lag_s);
    for line in &design.explanation {
        println!("{line}");
    }
    let parameters = amplifier_parameters(&design, &front_end)?;
    let bytes = block(&parameters)?;
    std::fs::write(Path::new(&out), &bytes)?;
    println!(
        "{out}: {} bytes, model residual {:.4} um",
        bytes.len(),
        identified.rms_um
    );
    Ok(())
}
