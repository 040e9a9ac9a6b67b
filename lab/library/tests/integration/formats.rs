//! Files that the libraries of their formats wrote (`formats/make.py`): read whole, and refused in words when
//! damaged.

#![cfg(all(
    feature = "readers",
    feature = "hdf5",
    feature = "parquet",
    feature = "arrow",
    feature = "spreadsheet"
))]

#[path = "../../../../host-sim/tests/integration/between_marks/mod.rs"]
#[allow(dead_code)]
mod between_marks;
#[path = "../formats/written.rs"]
mod written;

use between_marks::is_current;
use hysteron::dataset::column_rules::ColumnRules;
use hysteron::dataset::column_rules::PerColumn;
use hysteron::dataset::reading::{Instructions, from_file, from_file_as};
use hysteron::{Dataset, Record};
use proptest::prelude::*;
use std::path::PathBuf;
use written::{FILES, Written, damaged, folder};

const SAMPLES: usize = 160;
const RATE_HZ: f64 = 2000.0;

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(folder().join(name)).unwrap()
}

/// Every file with its bytes.
fn all() -> Vec<(&'static Written, Vec<u8>)> {
    FILES.iter().map(|file| (file, bytes(file.file))).collect()
}

/// As a person would have it read.
fn read(file: &Written, content: &[u8]) -> hysteron::Result<Dataset> {
    let [u, y] = file.units.map_or([None, None], |units| {
        units.map(|unit| Some(unit.to_owned()))
    });
    let unit = PerColumn {
        u,
        y,
        ..PerColumn::default()
    };
    from_file_as(
        file.file,
        content,
        &Instructions {
            wanted: ColumnRules {
                unit,
                ..ColumnRules::default()
            },
            ..Instructions::default()
        },
    )
}

/// Drive and displacement as `make.py` computes them.
fn recording() -> (Vec<f64>, Vec<f64>) {
    let drive = |k: f64| 20.0 - 20.0 * (0.1 * k).cos() * (1.0 - 0.002 * k);
    let samples = || (0..SAMPLES).map(|k| k as f64);
    (
        samples().map(drive).collect(),
        samples()
            .map(|k| 0.25 * drive(k - 2.0) + 0.01 * (7.0 * k).sin())
            .collect(),
    )
}

/// The longest of the records.
fn longest(dataset: &Dataset) -> &Record {
    dataset
        .records
        .iter()
        .max_by_key(|r| r.drive_v.len())
        .unwrap()
}

fn refused(name: &str, content: &[u8], words: &[&str]) {
    let said = from_file(name, content).expect_err(name).to_string();
    assert!(said.starts_with(name), "{said}");
    for word in words {
        assert!(said.contains(word), "{name}: expected `{word}` in: {said}");
    }
}

#[test]
fn every_file_is_the_recording() {
    let (u, y) = recording();
    for (file, content) in all() {
        let (name, tolerance) = (file.file, file.tolerance);
        if file.refused {
            refused(name, &content, file.said);
            continue;
        }
        let dataset = read(file, &content).unwrap_or_else(|e| panic!("{e}"));
        let record = longest(&dataset);
        assert!(
            (record.sample_rate_hz / RATE_HZ - 1.0).abs() < 1e-3,
            "{name}: {} Hz",
            record.sample_rate_hz
        );
        assert_eq!(record.drive_v.len(), SAMPLES, "{name}");
        for k in 0..SAMPLES {
            let (u_v, y_um) = (record.drive_v[k], record.displacement_um[k]);
            assert!(
                (u_v - u[k]).abs() < tolerance,
                "{name}, sample {k}: {u_v} V instead of {}",
                u[k]
            );
            assert!(
                (y_um - y[k]).abs() < tolerance,
                "{name}, sample {k}: {y_um} um instead of {}",
                y[k]
            );
        }
        let notes = dataset.notes.join("\n");
        for word in file.said {
            assert!(
                notes.contains(word),
                "{name}: expected `{word}` in\n{notes}"
            );
        }
    }
}

#[test]
fn every_file_that_the_script_writes_is_listed() {
    let mut there: Vec<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|f| f.unwrap().file_name().into_string().unwrap())
        .collect();
    there.retain(|name| !name.ends_with(".py") && !name.ends_with(".rs"));
    there.sort();
    let mut listed = FILES.map(|file| file.file);
    listed.sort_unstable();
    assert_eq!(there, listed);
}

/// What comes of a damaged file, as the table in docs/reference/formats.md writes it; fails where a message
/// is too poor to help.
fn outcome(file: &Written, whole: Option<&Record>, kind: &str, content: &[u8]) -> &'static str {
    let name = file.file;
    let dataset = match read(file, content) {
        Err(error) => {
            let said = error.to_string();
            assert!(
                said.starts_with(name) && said.len() > name.len() + 12,
                "{name}, {kind}: {said}"
            );
            return "x";
        }
        Ok(dataset) => dataset,
    };
    let record = longest(&dataset);
    assert!(
        record
            .drive_v
            .iter()
            .chain(&record.displacement_um)
            .all(|v| v.is_finite()),
        "{name}, {kind}"
    );
    let whole = whole.unwrap_or_else(|| panic!("{name}, {kind} is read, the whole file is not"));
    let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a == b);
    let apart = !same(&record.drive_v, &whole.drive_v)
        || !same(&record.displacement_um, &whole.displacement_um);
    match (apart, record.drive_v.len() < whole.drive_v.len()) {
        (true, _) => "n",
        (false, true) => "<",
        (false, false) => "=",
    }
}

/// The outcomes of the twelve kinds of damage.
fn outcomes(file: &Written, content: &[u8]) -> Vec<&'static str> {
    let whole = read(file, content).ok();
    damaged(content)
        .iter()
        .map(|(kind, damaged)| outcome(file, whole.as_ref().map(longest), kind, damaged))
        .collect()
}

#[test]
fn damage_is_refused_in_words_and_never_a_panic() {
    for (file, content) in all() {
        let found = outcomes(file, &content);
        // Formats without a check sum cannot know that a number is another; that much is missing all can
        // know, but for text, whose rows may end anywhere.
        let text = file.file.ends_with(".csv") || file.file.ends_with(".txt");
        let known = if text { 4 } else { 5 };
        assert!(
            found[..known].iter().all(|outcome| *outcome == "x"),
            "{}: {found:?}",
            file.file
        );
    }
}

const BEGIN: &str = "<!-- formats: written by `cargo xtask readme` from what the tests find -->\n";
const END: &str = "<!-- end of formats -->";

#[test]
fn the_table_of_formats_is_current() {
    if std::env::var_os("HYSTERON_FORMATS").is_some() {
        // Other releases lay their files out otherwise: the table is about those that are kept.
        return;
    }
    let kinds = damaged(&[0; 64]).map(|(kind, _)| kind);
    let list: Vec<String> = kinds
        .iter()
        .enumerate()
        .map(|(i, kind)| format!("{} {kind}", i + 1))
        .collect();
    let numbers: Vec<String> = (1..=kinds.len()).map(|n| n.to_string()).collect();
    let mut table = format!(
        "Damage: {}. `x`: refused, with the place; `=`: the numbers are the same; `<`: the first of them, as many as are there; `n`: other numbers.\n\n\
         | file | written by | holds | read | {} |\n|---|---|---|---|{}\n",
        list.join("; "),
        numbers.join(" | "),
        "---|".repeat(kinds.len())
    );
    for (file, content) in all() {
        let read = match (file.refused, file.units) {
            (true, _) => "refused".to_owned(),
            (false, None) => "yes".to_owned(),
            (false, Some([u, y])) => format!("with `--units u={u},y={y}`"),
        };
        let found = outcomes(file, &content).join(" | ");
        table += &format!(
            "| `{}` | {} | {} | {read} | {found} |\n",
            file.file, file.by, file.holds
        );
    }
    is_current(
        &PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/formats.md"),
        BEGIN,
        END,
        &table,
    );
}

#[test]
fn numbers_that_are_none_are_told_with_their_row() {
    let (u, _) = recording();
    let mut found = 0;
    for (file, whole) in all() {
        let name = file.file;
        let wide = (
            u[80].to_le_bytes().to_vec(),
            f64::NAN.to_le_bytes().to_vec(),
        );
        let single = (
            (u[80] as f32).to_le_bytes().to_vec(),
            f32::NAN.to_le_bytes().to_vec(),
        );
        for (value, nan) in [wide, single] {
            // Plain numbers only: what is compressed has none of these bytes.
            let Some(at) = whole.windows(value.len()).position(|w| w == value) else {
                continue;
            };
            let mut content = whole.clone();
            content[at..at + nan.len()].copy_from_slice(&nan);
            // Parquet's dictionaries and check sums aside, the row is that of the sample.
            let said = from_file(name, &content).expect_err(name).to_string();
            assert!(
                name.ends_with("npz") || (said.contains("finite") && said.contains("row 81")),
                "{name}: {said}"
            );
            found += 1;
        }
    }
    assert!(found >= 8, "{found}");
}

#[test]
fn what_other_files_are_is_said() {
    refused("a.gz", &[0x1f, 0x8b, 8, 0, 0, 0, 0, 0], &["gzip"]);
    refused(
        "a.xls",
        &[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1],
        &["XLSX"],
    );
    refused(
        "a.png",
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\0",
        &["no text", "expected CSV"],
    );
    // Text in a file that is called otherwise.
    refused("a.mat", b"t,u,y\n0,1,2\n", &["MATLAB"]);
    refused("a.npy", b"t,u,y\n0,1,2\n", &["NPY"]);
}

const EXTENSIONS: [&str; 11] = [
    "csv", "feather", "npy", "npz", "mat", "h5", "tdms", "parquet", "xlsx", "wav", "lvm",
];

/// Every place of every binary file as a count of billions, in the three ways in which formats write one. The
/// process may have little memory: a reader that reserves what a header claims is aborted.
#[cfg(target_os = "linux")]
#[test]
fn a_claimed_count_takes_no_memory() {
    const INSIDE: &str = "HYSTERON_LITTLE_MEMORY";
    if std::env::var_os(INSIDE).is_none() {
        let output = std::process::Command::new("sh")
            .args(["-c", "ulimit -v 600000; exec \"$0\" \"$@\""])
            .arg(std::env::current_exe().unwrap())
            .args(["--exact", "formats::a_claimed_count_takes_no_memory"])
            .args(["--nocapture", "--test-threads", "1"])
            .env(INSIDE, "1")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        return;
    }
    const COUNTS: [&[u8]; 3] = [
        &[0xff, 0xff, 0xff, 0x7f],
        &[0x7f, 0xff, 0xff, 0xff],
        &[0xfe, 0xff, 0xff, 0xff, 0x0f],
    ];
    // Heads and directories; what lies between are numbers.
    const NEAR_AN_END: usize = 700;
    for (file, whole) in all() {
        if file.file.ends_with(".csv") || file.file.ends_with(".txt") {
            continue;
        }
        let last = whole.len() - 5;
        let places = (0..=last).filter(|at| *at < NEAR_AN_END || last - at < NEAR_AN_END);
        for at in places {
            for count in COUNTS {
                let mut content = whole.clone();
                content[at..at + count.len()].copy_from_slice(count);
                // Printed before, so that the last line of an abort names its place.
                eprintln!("{}, byte {at}: {count:x?}", file.file);
                let _ = read(file, &content);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any bytes under any name: an error, or numbers.
    #[test]
    fn any_bytes(content in proptest::collection::vec(any::<u8>(), 0..600), extension in 0..EXTENSIONS.len()) {
        let _ = from_file(&format!("a.{}", EXTENSIONS[extension]), &content);
    }

    /// Text-like bytes reach deeper into the reader of text.
    #[test]
    fn any_text(content in "[-0-9eE.,;\t \nNaNinfdD:#\"|]{0,400}") {
        let _ = from_file("a.csv", content.as_bytes());
    }

    /// A real file with a few other bytes: most of it is still what its reader expects.
    #[test]
    fn a_few_other_bytes(file in any::<proptest::sample::Index>(), changes in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..6)) {
        let files = all();
        let (file, mut content) = files[file.index(files.len())].clone();
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        let _ = read(file, &content);
    }

    /// A real file, with a length or a count in its head made large.
    #[test]
    fn large_counts(file in any::<proptest::sample::Index>(), at in 0_usize..400, value in prop_oneof![Just(u32::MAX), Just(0x7fff_ffff), Just(0x0100_0000), any::<u32>()]) {
        let files = all();
        let (file, mut content) = files[file.index(files.len())].clone();
        let at = at.min(content.len() - 4);
        content[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let _ = read(file, &content);
    }
}
