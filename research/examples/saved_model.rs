//! Whether saved models do what was reported of them, a line for each file:
//!
//!     cargo run --release -p hysteron-research --example saved_model -- [--rate-hz HZ] FILE...
//!
//! Errors in nm on the samples that judged, as reported, by `compare` and by `simulate`; over the whole file,
//! as reported and by `simulate`; the share inside the 95 % band, and its width over the error.

use hysteron::watch::Unwatched;
use hysteron_tests::measured::value_of;
use hysteron_tests::saved_model::{SavedModel, saved_model};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let rate_hz = value_of(&mut arguments, "--rate-hz")
        .map(|hz| hz.parse())
        .transpose()?;
    println!("{}", SavedModel::HEADING);
    for file in arguments {
        let bytes = std::fs::read(&file)?;
        let row = saved_model(&file, &bytes, rate_hz, "gain", &Unwatched)?;
        println!("{}  ({file})", row.row());
    }
    Ok(())
}
