//! Files that the libraries of their formats wrote (`formats/make.py`): read whole, and refused in words when damaged.

#![cfg(all(feature = "readers", feature = "hdf5", feature = "parquet", feature = "spreadsheet"))]

use hysteron::dataset::manifest::PerColumn;
use hysteron::dataset::reading::{Instructions, from_file, from_file_as};
use hysteron::dataset::recognise::Wanted;
use proptest::prelude::*;
use std::path::PathBuf;

const SAMPLES: usize = 160;
const RATE_HZ: f64 = 2000.0;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/formats")
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(folder().join(name)).unwrap()
}

/// Every file beside the script, with its bytes.
fn all() -> Vec<(String, Vec<u8>)> {
    let mut names: Vec<String> = std::fs::read_dir(folder()).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    names.retain(|name| !name.ends_with(".py"));
    names.sort();
    names.iter().map(|name| (name.clone(), bytes(name))).collect()
}

/// Drive and displacement as `make.py` computes them.
fn recording() -> (Vec<f64>, Vec<f64>) {
    let drive = |k: f64| 20.0 - 20.0 * (0.1 * k).cos() * (1.0 - 0.002 * k);
    let samples = || (0..SAMPLES).map(|k| k as f64);
    (samples().map(drive).collect(), samples().map(|k| 0.25 * drive(k - 2.0) + 0.01 * (7.0 * k).sin()).collect())
}

/// The file is the recording to within `tolerance` V and um, and its notes hold these words.
fn gives(name: &str, tolerance: f64, units: [Option<&str>; 2], words: &[&str]) {
    let unit = PerColumn { u: units[0].map(str::to_owned), y: units[1].map(str::to_owned), ..PerColumn::default() };
    let instructions = Instructions { wanted: Wanted { unit, ..Wanted::default() }, ..Instructions::default() };
    let dataset = from_file_as(name, &bytes(name), &instructions).unwrap_or_else(|e| panic!("{e}"));
    let record = dataset.records.iter().max_by_key(|r| r.drive_v.len()).unwrap();
    assert!((record.sample_rate_hz / RATE_HZ - 1.0).abs() < 1e-3, "{name}: {} Hz", record.sample_rate_hz);
    assert_eq!(record.drive_v.len(), SAMPLES, "{name}");
    let (u, y) = recording();
    for k in 0..SAMPLES {
        assert!((record.drive_v[k] - u[k]).abs() < tolerance, "{name}, sample {k}: {} V instead of {}", record.drive_v[k], u[k]);
        let read = record.displacement_um[k];
        assert!((read - y[k]).abs() < tolerance, "{name}, sample {k}: {read} um instead of {}", y[k]);
    }
    let notes = dataset.notes.join("\n");
    for word in words {
        assert!(notes.contains(word), "{name}: expected `{word}` in\n{notes}");
    }
}

fn refused(name: &str, content: &[u8], words: &[&str]) {
    let said = from_file(name, content).expect_err(name).to_string();
    assert!(said.starts_with(name), "{said}");
    for word in words {
        assert!(said.contains(word), "{name}: expected `{word}` in: {said}");
    }
}

#[test]
fn numpy_arrays() {
    gives("columns.npy", 1e-9, [None; 2], &["column 2 is taken for the drive"]);
    gives("single_rows.npy", 1e-5, [None; 2], &["rows are the columns"]);
    gives("arrays.npz", 1e-9, [None; 2], &[]);
    gives("compressed.npz", 1e-3, [None; 2], &["u = column `u [mv]`"]);
}

#[test]
fn matlab_vectors_structs_and_cells() {
    gives("vectors.mat", 1e-9, [None; 2], &["u = column `u`"]);
    gives("compressed.mat", 1e-9, [None; 2], &["column `record(2)` is taken for the drive"]);
    gives("simulink.mat", 1e-9, [None; 2], &[]);
    gives("controldesk.mat", 1e-4, [None; 2], &["Position [nm]"]);
    gives("cells.mat", 1e-9, [None; 2], &["column `log{2}` is taken for the drive"]);
    gives("matlab73.mat", 1e-9, [None; 2], &[]);
}

#[test]
fn hdf5_groups_and_tables() {
    gives("groups.h5", 1e-3, [None; 2], &["y = column `position [nm]`"]);
    gives("table.h5", 1e-9, [None; 2], &["column `data(2)` is taken for the drive"]);
}

#[test]
fn tdms_with_waveforms_and_with_time() {
    gives("waveforms.tdms", 1e-9, [None; 2], &["2000.000000 samples per second"]);
    gives("with_time.tdms", 1e-5, [None; 2], &["y = column `AI0 [pm]`"]);
}

#[test]
fn parquet_and_spreadsheets() {
    gives("frame.parquet", 1e-5, [None; 2], &["columns that hold no numbers are left aside: `comment`"]);
    gives("stamped.parquet", 1e-3, [None; 2], &["u = column `u [mv]`"]);
    refused("zstd.parquet", &bytes("zstd.parquet"), &["Parquet", "zstd"]);
    gives("book.xlsx", 1e-9, [None; 2], &["sheet `record` is read, of 2", "t = column `t [ms]`"]);
}

#[test]
fn sound_files() {
    gives("floats.wav", 1e-5, [None; 2], &["column 1 is taken for the drive"]);
    gives("codes.wav", 2e-3, [Some("50V"), Some("20um")], &["shares of full scale"]);
}

/// Damage of twelve kinds; where the content is still a whole file, what comes out is checked like any other.
fn damaged(whole: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let n = whole.len();
    let cut = |to: usize| whole[..to].to_vec();
    let changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.to_vec();
        change(&mut bytes);
        bytes
    };
    vec![
        ("nothing", Vec::new()),
        ("one byte", cut(1)),
        ("the first 40 bytes", cut(40)),
        ("a quarter", cut(n / 4)),
        ("half", cut(n / 2)),
        ("all but the last quarter", cut(3 * n / 4)),
        ("all but the last byte", cut(n - 1)),
        ("another first byte", changed(&|b| b[0] ^= 0xff)),
        ("zeros from the middle on", changed(&|b| b[n / 2..].fill(0))),
        ("every 97th bit flipped", changed(&|b| (0..n).step_by(97).for_each(|i| b[i] ^= 1 << (i % 8)))),
        ("upside down", changed(&|b| b.reverse())),
        ("bytes missing in the middle", [&whole[..n / 3], &whole[n / 3 + 17..]].concat()),
    ]
}

#[test]
fn damage_is_refused_in_words_and_never_a_panic() {
    for (name, whole) in all() {
        for (kind, content) in damaged(&whole) {
            match from_file(&name, &content) {
                Err(error) => {
                    let said = error.to_string();
                    assert!(said.starts_with(&name) && said.len() > name.len() + 12, "{name}, {kind}: {said}");
                }
                // Formats without a check sum cannot know that a number is another.
                Ok(dataset) => {
                    assert!(
                        !matches!(kind, "nothing" | "one byte" | "the first 40 bytes" | "a quarter" | "half"),
                        "{name}, {kind} is read"
                    );
                    assert!(dataset.records.iter().all(|r| r.drive_v.iter().chain(&r.displacement_um).all(|v| v.is_finite())));
                }
            }
        }
    }
}

#[test]
fn numbers_that_are_none_are_told_with_their_row() {
    let (u, _) = recording();
    let mut found = 0;
    for (name, whole) in all() {
        let wide = (u[80].to_le_bytes().to_vec(), f64::NAN.to_le_bytes().to_vec());
        let single = ((u[80] as f32).to_le_bytes().to_vec(), f32::NAN.to_le_bytes().to_vec());
        for (value, nan) in [wide, single] {
            // Plain numbers only: what is compressed has none of these bytes.
            let Some(at) = whole.windows(value.len()).position(|w| w == value) else { continue };
            let mut content = whole.clone();
            content[at..at + nan.len()].copy_from_slice(&nan);
            // Parquet's dictionaries and check sums aside, the row is that of the sample.
            let said = from_file(&name, &content).expect_err(&name).to_string();
            assert!(name.ends_with("npz") || (said.contains("finite") && said.contains("row 81")), "{name}: {said}");
            found += 1;
        }
    }
    assert!(found >= 8, "{found}");
}

#[test]
fn what_other_files_are_is_said() {
    refused("a.gz", &[0x1f, 0x8b, 8, 0, 0, 0, 0, 0], &["gzip"]);
    refused("a.xls", &[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1], &["XLSX"]);
    refused("a.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\0", &["no text", "expected CSV"]);
    // Text in a file that is called otherwise.
    refused("a.mat", b"t,u,y\n0,1,2\n", &["MATLAB"]);
    refused("a.npy", b"t,u,y\n0,1,2\n", &["NPY"]);
}

const EXTENSIONS: [&str; 10] = ["csv", "npy", "npz", "mat", "h5", "tdms", "parquet", "xlsx", "wav", "lvm"];

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
        let (name, mut content) = files[file.index(files.len())].clone();
        for (at, byte) in changes {
            let at = at.index(content.len());
            content[at] = byte;
        }
        let _ = from_file(&name, &content);
    }

    /// A real file, with a length or a count in its head made large.
    #[test]
    fn large_counts(file in any::<proptest::sample::Index>(), at in 0_usize..400, value in prop_oneof![Just(u32::MAX), Just(0x7fff_ffff), Just(0x0100_0000), any::<u32>()]) {
        let files = all();
        let (name, mut content) = files[file.index(files.len())].clone();
        let at = at.min(content.len() - 4);
        content[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let _ = from_file(&name, &content);
    }
}
