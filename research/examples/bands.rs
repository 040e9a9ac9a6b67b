//! Bands of saved models on records that neither fitted nor calibrated them, a row for each:
//!
//!     cargo run --release -p hysteron-research --example bands -- [--csv FILE] [planted|real]
//!
//! **Planted** data sets lose their record `validation`, are explained from their own effects, and the saved model
//! predicts that record. **Real** recordings are explained from `gain`, each by itself, and predict another
//! recording of the same stage. A simulation begins as `simulate` does with nothing specified, and once more as with
//! `--initial` and the recording itself. Errors in nm, the share of the samples inside the 95 % band, and half of
//! the band's width in the median over the error.

use hysteron::Record;
use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::reading::{Instructions, drive_of_file};
use hysteron::dataset::{Dataset, PlayedDrive, folder};
use hysteron::model_file::{effects_named, from_toml, to_toml};
use hysteron::origin::{Initial, Way};
use hysteron::phrases::nm;
use hysteron::prediction::Prediction;
use hysteron::statistics::rms;
use hysteron::watch::Unwatched;
use hysteron_tests::beside;
use hysteron_tests::measured::value_of;
use std::error::Error;

/// What is explained, and what it predicts.
const REAL: [(&str, &[&str]); 3] = [
    ("sine50_1", &["sine50_2", "sine50_3", "bigsine_1"]),
    ("bigsine_1", &["bigsine_2", "sine50_1"]),
    ("tri50_1", &["tri50_2", "sine50_1"]),
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
    let start = Start::Effects(&start);
    let found = analyse(known, start, &Options::default(), &Unwatched)?;
    let model = from_toml(&to_toml(&found.model, name)?, "model.toml")?;
    let figures = found.figures(known, 0.0);
    let known_um = figures.validate_rms_um.unwrap_or(figures.identify_rms_um);
    let way = Way::told(&model, None, None);
    let mut out = String::new();
    for record in unseen {
        let played = PlayedDrive {
            file: record.name.clone(),
            sample_rate_hz: record.sample_rate_hz,
            drive_v: record.drive_v.clone(),
            reading_um: Some(record.displacement_um.clone()),
            force_n: record.force_n.clone(),
            auxiliary: record.auxiliary.clone(),
            ..PlayedDrive::default()
        };
        let by_itself = Initial::like(&model, &played, way)?;
        for (begins, initial) in [
            ("as the model says", Initial::AsRecorded),
            ("as it does", by_itself),
        ] {
            let drive = record.whole_drive();
            let predicted = initial.predict(&model, &record.name, &drive, way, &record.name);
            match predicted {
                Ok((predicted, _)) => {
                    let row = row(record, &predicted);
                    out += &format!("{name},{},{begins},{},{row}\n", record.name, nm(known_um));
                }
                // Free surfaces end where the drive leaves their range.
                Err(refused) => println!("left out: {name}: {refused}"),
            }
        }
    }
    Ok(out)
}

/// What a prediction leaves of a record, and its band.
fn row(record: &Record, predicted: &Prediction) -> String {
    let half_um = predicted.half_band_um.as_deref().unwrap_or_default();
    let off = |k: usize| record.displacement_um[k] - predicted.reading_um[k];
    let counted: Vec<usize> = record.counted().collect();
    let left: Vec<f64> = counted.iter().map(|k| off(*k)).collect();
    let inside = counted.iter().filter(|k| off(**k).abs() <= half_um[**k]);
    let share = inside.count() as f64 / counted.len() as f64;
    let mut widths: Vec<f64> = counted.iter().map(|k| half_um[*k]).collect();
    widths.sort_by(f64::total_cmp);
    let error_um = rms(&left);
    let over = widths[widths.len() / 2] / error_um;
    format!("{},{:.1},{over:.2}", nm(error_um), 100.0 * share)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let csv = value_of(&mut arguments, "--csv");
    let mut text = String::from(
        "explained,predicted,begins,held_out_nm,error_nm,inside_band_pct,half_band_over_error\n",
    );
    print!("{text}");
    let mut add = |rows: String| {
        print!("{rows}");
        text += &rows;
    };
    let wanted = |set: &str| arguments.is_empty() || arguments.iter().any(|a| a == set);
    if let Some(planted) = beside("planted").filter(|_| wanted("planted")) {
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
    if let Some(stage) = beside("measured/piezo_stage").filter(|_| wanted("real")) {
        let read = |name: &str| folder::load(&stage.join(format!("{name}.csv")));
        for (name, others) in REAL {
            let mut unseen = Vec::new();
            for other in others {
                let bytes = std::fs::read(stage.join(format!("{other}.csv")))?;
                let whole = drive_of_file(other, &bytes, &Instructions::default())?;
                let reading_um = whole.reading_um.unwrap_or_default();
                let rate_hz = whole.sample_rate_hz;
                unseen.push(Record::new(*other, rate_hz, whole.drive_v, reading_um));
            }
            add(rows(name, &read(name)?, "gain", &unseen)?);
        }
    }
    if let Some(csv) = csv {
        std::fs::write(csv, text)?;
    }
    Ok(())
}
