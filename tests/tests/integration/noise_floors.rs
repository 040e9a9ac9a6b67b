//! The noise that is found without a key in the manifest beside the noise that the keys and the records at
//! rest show.

use hysteron::dataset::{Dataset, Role, folder};
use hysteron::identification::noise_floor::{FloorEvidence, noise_floor};
use hysteron_tests::measured::{record, stage};
use hysteron_tests::{beside, root};
use std::path::PathBuf;

/// The two may differ by this share.
const AGREEMENT: f64 = 0.2;

fn found_um(dataset: &Dataset, evidence: &[FloorEvidence], what: &str) -> f64 {
    let floor = noise_floor(dataset);
    assert!(
        floor
            .estimates
            .first()
            .is_some_and(|e| evidence.contains(&e.evidence)),
        "{what}: {}",
        floor.basis
    );
    floor
        .rms_um
        .unwrap_or_else(|| panic!("{what}: {}", floor.basis))
}

fn agree(what: &str, without_um: f64, with_um: f64) {
    println!(
        "{what:<32} {:8.2} nm found, {:8.2} nm with keys, ratio {:.3}",
        1e3 * without_um,
        1e3 * with_um,
        without_um / with_um
    );
    assert!(
        (without_um / with_um - 1.0).abs() < AGREEMENT,
        "{what}: {without_um} and {with_um} um"
    );
}

/// Nothing but the driven records, and nothing said of them.
fn without_keys(dataset: &Dataset) -> Dataset {
    let mut bare = dataset.clone();
    bare.records.retain(|r| r.role != Role::Noise);
    for record in &mut bare.records {
        (record.periods, record.repeat_of) = (None, None);
    }
    bare
}

/// Simulated sets: periods and holds against the record at rest.
#[test]
fn driven_records_show_the_noise_of_the_record_at_rest() {
    let mut folders = vec![root().join("examples/hidden_effect")];
    if let Some(planted) = beside("planted") {
        let cases: Vec<PathBuf> = std::fs::read_dir(planted)
            .expect("a folder")
            .map(|e| e.expect("an entry").path())
            .collect();
        folders.extend(
            cases
                .into_iter()
                .filter(|p| p.join("dataset.toml").is_file()),
        );
        folders.sort();
    }
    for path in folders {
        let dataset = folder::load(&path).expect("the set can be read");
        let name = path
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        let with_um = found_um(
            &dataset,
            &[FloorEvidence::RestRecord, FloorEvidence::Periods],
            &name,
        );
        let without_um = found_um(
            &without_keys(&dataset),
            &[FloorEvidence::Periods, FloorEvidence::Hold],
            &name,
        );
        agree(&name, without_um, with_um);
    }
}

/// A real stage: records with the same drive, with and without being told so.
#[test]
fn repeats_are_found_in_real_recordings() {
    let Some(data) = beside("measured") else {
        return;
    };
    let sets: [&[&str]; 4] = [
        &["sine50_1", "sine50_3"],
        &["sine50_1", "sine50_2", "sine50_3"],
        &["tri50_1", "tri50_2"],
        &["bigsine_1", "bigsine_2"],
    ];
    for names in sets {
        let records: Vec<_> = names
            .iter()
            .map(|name| record(&data, name, 0.5, Role::Identify))
            .collect();
        let bare = stage(records);
        let mut told = bare.clone();
        for other in told.records.iter_mut().skip(1) {
            other.repeat_of = Some(names[0].to_owned());
        }
        let what = names.join(", ");
        agree(
            &what,
            found_um(&bare, &[FloorEvidence::Repeats], &what),
            found_um(&told, &[FloorEvidence::Repeats], &what),
        );
    }
}
