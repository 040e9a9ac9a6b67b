//! The saved model is the model: on tapes by other equations, and on a real one, it does what was
//! reported of it, with nothing specified.

use hysteron::watch::Unwatched;
use hysteron_tests::beside;
use hysteron_tests::saved_model::{AS_REPORTED, SavedModel, saved_model};
use hysteron_tests::saved_tapes::tapes_by_equations;

/// The least share of the samples that judged inside a band of 95 %.
const IN_BAND: f64 = 0.9;
/// Half of a band is at most so many times the error of the simulation.
const BAND_OVER_ERROR: f64 = 3.0;

#[test]
fn a_saved_model_does_what_was_reported() {
    let real = beside("measured/piezo_stage/sine50_1.csv");
    let real = real.map(|file| ("real sine", std::fs::read_to_string(file).unwrap()));
    println!("{}", SavedModel::HEADING);
    let mut wrong = Vec::new();
    for (name, text) in tapes_by_equations().into_iter().chain(real) {
        let file = format!("{name}.csv");
        let row = saved_model(&file, text.as_bytes(), None, "gain", &Unwatched).unwrap();
        println!("{}", row.row(name));
        // One state for a whole real tape leaves more than one for each part of it, as its replay reports, by a
        // drift whose shape no band has.
        let [compared, simulated, whole] = row.over_reported();
        let (simulated, wide) = if name == "real sine" {
            (1.0, false)
        } else {
            (simulated, row.band_over_error > BAND_OVER_ERROR)
        };
        let times = compared.max(simulated).max(whole);
        if times > AS_REPORTED || row.inside < IN_BAND || wide {
            wrong.push(name);
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
