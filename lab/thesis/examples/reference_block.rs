//! Makes the parameter block that the emulated target's tests run with: identifies a model from a record of
//! the reference bench, designs the servo, and writes the block.
//!
//! `cargo run --release --package hysteron-thesis --example reference_block --
//! board/emulator/tests/p753.block`

use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters, block};
use hysteron::servo::design::ServoDesign;
use hysteron::servo::predictor::Demands;
use hysteron::servo::sensor_lag;
use hysteron_sim::bench::{Bench, Variant};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args().nth(1).ok_or("expected the file to write")?;
    let bench = Bench::reference()?;
    let identified = hysteron_thesis::commissioning::on_bench(&bench, Variant::FULL, 1).ok_or("no model")?;
    let mut design = ServoDesign::best(&identified.model, &Demands::default()).ok_or("no tuning keeps all margins")?;
    // The data sheet's, which the model holds.
    design.sensor_lag_s = identified.model.linear.sensor_bandwidth_hz.map(sensor_lag::lag_s);
    for line in &design.explanation {
        println!("{line}");
    }
    let parameters = amplifier_parameters(&design, &FrontEnd { name: "p753".into(), ..FrontEnd::default() })?;
    let bytes = block(&parameters)?;
    std::fs::write(Path::new(&out), &bytes)?;
    println!("{out}: {} bytes, model residual {:.4} um", bytes.len(), identified.rms_um);
    Ok(())
}
