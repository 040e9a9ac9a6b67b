//! Makes the parameter block that the emulated target's tests run with: identifies a model from a record of the reference bench,
//! designs the servo, and writes the block.
//!
//! `cargo run --release --package hysteron --example reference_block -- emulator/tests/p753.block`

use hysteron::amplifier_block::{amplifier_parameters, block};
use hysteron::problem::write_whole;
use hysteron::servo::design::{Scheme, ServoDesign};
use hysteron::servo::predictor::{Demands, PredictorDesign};
use hysteron_sim::bench::{Bench, Variant};
use hysteron_sim::closed_loop::converter_parameters;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let out = std::env::args().nth(1).ok_or("expected the file to write")?;
    let bench = Bench::reference()?;
    let identified = hysteron::servo::identify::on_bench(&bench, Variant::FULL, 1).ok_or("no model")?;
    let design = ServoDesign::best(&identified.model, &Demands::default()).ok_or("no tuning keeps all margins")?;
    for line in &design.explanation {
        println!("{line}");
    }
    let Scheme::Predictor { tuning, .. } = &design.scheme else { return Err("not a predictor".into()) };
    let predictor = PredictorDesign::new(&identified.model.linear, tuning);
    let radius = predictor.spectral_radius(&identified.model.linear.sampled(1.0 / 20_000.0), 1.0, 0);
    let parameters = amplifier_parameters(&design, converter_parameters(&bench, 0.0), "p753", radius, 2.0e4)?;
    let bytes = block(&parameters)?;
    write_whole(Path::new(&out), &bytes)?;
    println!("{out}: {} bytes, model residual {:.4} um, spectral radius {radius:.6}", bytes.len(), identified.rms_um);
    Ok(())
}
