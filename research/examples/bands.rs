//! Bands of saved models on records that neither fitted nor calibrated them, a row for each:
//!
//!     cargo run --release -p hysteron-research --example bands -- [--csv FILE]
//!
//! **Planted** data sets lose their record `validation`, are explained from their own effects, and the saved model
//! predicts that record. **Real** recordings are explained from `gain`, each by itself, and predict another
//! recording of the same stage. A simulation begins as `simulate` does with nothing specified. Errors in nm, the
//! share of the samples inside the 95 % band, and half of the band's width in the median over the error.

use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::{Dataset, folder};
use hysteron::model_file::{effects_named, from_toml, to_toml};
use hysteron::origin::{Initial, Way};
use hysteron::phrases::nm;
use hysteron::statistics::rms;
use hysteron::watch::Unwatched;
use hysteron::{Drive, Record};
use hysteron_tests::beside;
use hysteron_tests::measured::value_of;
use std::error::Error;

/// What is explained, and what it predicts.
const REAL: [(&str, &[&str]); 4] = [
    ("sine50_1", &["sine50_2", "sine50_3", "bigsine_1"]),
    ("bigsine_1", &["bigsine_2", "sine50_1"]),
    ("tri50_1", &["tri50_2", "sine50_1"]),
    ("20_hz_no_lp", &["40_hz_no_lp"]),
];
/// The record of a planted data set that is taken out.
const UNSEEN: &str = "validation";

/// The rows of what a data set's model predicts of records that it has not seen.
fn rows(
    name: &str,
    known: &Dataset,
    from: &str,
    unseen: &[Record],
) -> Result<String, Box<dyn Error>> {
    let start = effects_named(from)?;
    let found = analyse(
        known,
        Start::Effects(&start),
        &Options::default(),
        &Unwatched,
    )?;
    let model = from_toml(&to_toml(&found.model, name)?, "model.toml")?;
    let mut out = String::new();
    for record in unseen {
        let drive = Drive {
            initial_state: record.initial_state,
            ..record.whole_drive()
        };
        let way = Way::told(&model, None, None);
        let initial = Initial::AsRecorded;
        let predicted = initial.predict(&model, &record.name, &drive, way, &record.name);
        let (predicted, _) = match predicted {
            Ok(predicted) => predicted,
            // Free surfaces end where the drive leaves their range.
            Err(refused) => {
                println!("left out: {name}: {refused}");
                continue;
            }
        };
        let half_um = predicted.half_band_um.unwrap_or_default();
        let off = |k: usize| record.displacement_um[k] - predicted.reading_um[k];
        let counted: Vec<usize> = record.counted().collect();
        let left: Vec<f64> = counted.iter().map(|k| off(*k)).collect();
        let inside = counted.iter().filter(|k| off(**k).abs() <= half_um[**k]);
        let share = inside.count() as f64 / counted.len() as f64;
        let mut widths: Vec<f64> = counted.iter().map(|k| half_um[*k]).collect();
        widths.sort_by(f64::total_cmp);
        let known_um = found
            .figures(known, 0.0)
            .validate_rms_um
            .unwrap_or(f64::NAN);
        let beyond = if predicted.remarks.is_empty() {
            "no"
        } else {
            "yes"
        };
        out += &format!(
            "{name},{},{beyond},{},{},{:.1},{:.2}\n",
            record.name,
            nm(known_um),
            nm(rms(&left)),
            100.0 * share,
            widths[widths.len() / 2] / rms(&left)
        );
    }
    Ok(out)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = value_of(&mut arguments, "--csv");
    let mut text = String::from(
        "explained,predicted,beyond_the_records,held_out_nm,error_nm,inside_band_pct,half_band_over_error\n",
    );
    print!("{text}");
    let mut add = |rows: String| {
        print!("{rows}");
        text += &rows;
    };
    if let Some(planted) = beside("planted") {
        let mut cases: Vec<_> = std::fs::read_dir(planted)?
            .flatten()
            .map(|e| e.path())
            .collect();
        cases.sort();
        for case in cases.iter().filter(|case| case.is_dir()) {
            let mut known = folder::load(case)?;
            let base = std::fs::read_to_string(case.join("base_effects.txt"))?;
            let from = base.split_whitespace().collect::<Vec<_>>().join(",");
            let unseen = known.records.iter().filter(|record| record.name == UNSEEN);
            let unseen: Vec<Record> = unseen.cloned().collect();
            known.records.retain(|record| record.name != UNSEEN);
            let name = case.file_name().unwrap_or_default().to_string_lossy();
            add(rows(&name, &known, &from, &unseen)?);
        }
    }
    if let Some(stage) = beside("measured/piezo_stage") {
        let read = |name: &str| folder::load(&stage.join(format!("{name}.csv")));
        for (name, others) in REAL {
            let mut unseen = Vec::new();
            for other in others {
                let mut whole = read(other)?.records.swap_remove(0);
                whole.window = 0..whole.drive_v.len();
                whole.left_out = Vec::new();
                (*other).clone_into(&mut whole.name);
                unseen.push(whole);
            }
            add(rows(name, &read(name)?, "gain", &unseen)?);
        }
    }
    if let Some(csv) = csv {
        std::fs::write(csv, text)?;
    }
    Ok(())
}
