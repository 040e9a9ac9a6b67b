//! Whether saved models do what was reported of them, a row for each recording:
//!
//!     cargo run --release -p hysteron-research --example saved_model -- [--rate-hz HZ] [--csv FILE] [FILE...]
//!
//! Without a file it takes tapes by other equations, and the real recordings and benchmarks that lie beside the
//! project. Each is explained from `gain`, and its model saved, read again, and given to `compare` and `simulate`
//! with nothing specified. Errors in nm on the samples that judged: as reported, by `compare` and by `simulate`.
//! Over the whole file: as reported and by `simulate`. Then the share of the samples that judged inside the 95 %
//! band, and half of the band's width over their error.

use hysteron::watch::Unwatched;
use hysteron_tests::measured::value_of;
use hysteron_tests::saved_model::{AS_REPORTED, SavedModel, saved_model};
use hysteron_tests::saved_tapes::{tapes_beside, tapes_by_equations};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let rate_hz = value_of(&mut arguments, "--rate-hz")
        .map(|hz| hz.parse())
        .transpose()?;
    let csv = value_of(&mut arguments, "--csv");
    let mut tapes = Vec::new();
    let mut files: Vec<PathBuf> = arguments.iter().map(PathBuf::from).collect();
    if files.is_empty() {
        let by_equations = tapes_by_equations();
        tapes.extend(by_equations.map(|(name, text)| (format!("{name}.csv"), text.into_bytes())));
        files = tapes_beside();
    }
    for file in files {
        let parts: Vec<_> = file.iter().map(|part| part.to_string_lossy()).collect();
        let name = parts[parts.len().saturating_sub(2)..].join("/");
        tapes.push((name, std::fs::read(&file)?));
    }
    let mut text = format!("{}\n", SavedModel::HEADING);
    print!("{text}");
    let (mut as_reported, all) = (0, tapes.len());
    for (name, bytes) in tapes {
        let found = saved_model(&name, &bytes, rate_hz, "gain", &Unwatched)?;
        let row = format!("{}\n", found.row(&name));
        print!("{row}");
        text += &row;
        let [compared, _, whole] = found.over_reported();
        as_reported += usize::from(compared.max(whole) <= AS_REPORTED);
    }
    println!(
        "{as_reported} of {all}: `compare`, and `simulate` over the file, within {AS_REPORTED} times what was reported"
    );
    if let Some(csv) = csv {
        std::fs::write(csv, text)?;
    }
    Ok(())
}
