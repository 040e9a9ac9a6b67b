//! The program where the system gives it little: files that claim to be large, a disk that is full, a kill
//! while it writes.

use crate::common::{assert_done, folder_with_model, hysteron};
use std::io::{Cursor, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use zip::write::SimpleFileOptions;

/// Runs the program behind a limit of the shell's.
fn limited(limit: &str, arguments: &[&str], folder: &Path) -> Output {
    Command::new("sh")
        .args(["-c", &format!("{limit}; exec \"$0\" \"$@\"")])
        .arg(env!("CARGO_BIN_EXE_hysteron"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn archive(members: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in members {
        out.start_file(*name, SimpleFileOptions::default()).unwrap();
        out.write_all(content).unwrap();
    }
    out.finish().unwrap().into_inner()
}

/// Less than the file asks for, kB: beyond it the program is aborted.
const MEMORY: &str = "ulimit -v 1000000";

fn refused(name: &str, bytes: &[u8], expected: &str) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    let output = limited(MEMORY, &["explain", name], folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(name) && said.contains(expected), "{said}");
}

#[test]
fn arrays_that_unpack_to_more_than_the_file_can_hold_are_refused() {
    let samples = 150_000_000;
    let head = format!("{{'descr': '|i1', 'fortran_order': False, 'shape': ({samples},), }}");
    let mut array = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    array.extend(format!("{head:117}\n").bytes());
    array.resize(array.len() + samples, 0);
    let bytes = archive(&[("t.npy", &array), ("u.npy", &array), ("y.npy", &array)]);
    assert!(bytes.len() < 1_000_000);
    refused("a.npz", &bytes, "unpacks to more than");
}

#[cfg(feature = "formats")]
#[test]
fn workbooks_that_claim_a_large_sheet_or_long_texts_are_refused() {
    let sheet = |cells: &str| {
        format!(
            "<worksheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"><sheetData>{cells}</sheetData></worksheet>"
        )
    };
    let book = |sheet: &str, texts: &[u8]| {
        let kind = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
        let package = "http://schemas.openxmlformats.org/package/2006/relationships";
        archive(&[
            (
                "_rels/.rels",
                format!("<Relationships xmlns=\"{package}\"><Relationship Id=\"r1\" Type=\"{kind}/officeDocument\" Target=\"xl/workbook.xml\"/></Relationships>").as_bytes(),
            ),
            (
                "xl/workbook.xml",
                format!("<workbook xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\" xmlns:r=\"{kind}\"><sheets><sheet name=\"a\" sheetId=\"1\" r:id=\"r1\"/></sheets></workbook>").as_bytes(),
            ),
            (
                "xl/_rels/workbook.xml.rels",
                format!("<Relationships xmlns=\"{package}\"><Relationship Id=\"r1\" Type=\"{kind}/worksheet\" Target=\"worksheets/sheet1.xml\"/></Relationships>").as_bytes(),
            ),
            ("xl/worksheets/sheet1.xml", sheet.as_bytes()),
            ("xl/sharedStrings.xml", texts),
        ])
    };
    let cell = |at: &str, row: u32| format!("<row r=\"{row}\"><c r=\"{at}\"><v>1</v></c></row>");
    let far = sheet(&(cell("A1", 1) + &cell("XFD1048576", 1_048_576)));
    refused(
        "far.xlsx",
        &book(&far, b"<sst/>"),
        "spans 1048576 rows of 16384 cells",
    );
    let texts = [
        &b"<sst><si><t>"[..],
        &vec![b'a'; 300_000_000],
        b"</t></si></sst>",
    ]
    .concat();
    refused(
        "long.xlsx",
        &book(&sheet(&cell("A1", 1)), &texts),
        "unpacks to more than",
    );
}

#[test]
fn nesting_without_end_is_refused() {
    for name in ["dataset.toml", "m.toml"] {
        let folder = folder_with_model();
        let deep = format!("a = {}", "[".repeat(1_000_000));
        std::fs::write(folder.path().join(name), deep).unwrap();
        let output = limited(MEMORY, &["compare", "m.toml", "."], folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(name) && said.len() < 1000, "{said}");
    }
}

const TARGETS: [&str; 3] = ["new.toml", "new.json", "new.html"];
const EXPLAIN: [&str; 9] = [
    "explain", ".", "--force", "--out", TARGETS[0], "--json", TARGETS[1], "--report", TARGETS[2],
];

/// A folder in which the targets have been written once, and what they hold.
fn folder_with_targets() -> (tempfile::TempDir, [Vec<u8>; 3]) {
    let folder = folder_with_model();
    assert_done(&hysteron(&EXPLAIN, folder.path()));
    let whole = TARGETS.map(|name| std::fs::read(folder.path().join(name)).unwrap());
    (folder, whole)
}

fn put_back(folder: &Path) {
    for name in TARGETS {
        std::fs::write(folder.join(name), "before").unwrap();
    }
}

/// How many targets are new. Each is the one of before, or whole: it ends as the whole one does. Figures and
/// page hold the seconds that a run took, so that not every byte is the same.
#[track_caller]
fn new_ones(folder: &Path, whole: &[Vec<u8>; 3], case: &str) -> usize {
    let is_new = |(name, whole): (&&str, &Vec<u8>)| {
        let now = std::fs::read(folder.join(name)).unwrap();
        let end = &whole[whole.len() - 200..];
        let is_whole = now.ends_with(end) && now.len().abs_diff(whole.len()) < 32;
        assert!(now == b"before" || is_whole, "{name}: {case}");
        is_whole
    };
    TARGETS
        .iter()
        .zip(whole)
        .filter(|pair| is_new(*pair))
        .count()
}

fn parts_left(folder: &Path) -> usize {
    let names = std::fs::read_dir(folder).unwrap().flatten();
    names
        .filter(|e| e.file_name().to_string_lossy().ends_with(".part"))
        .count()
}

/// A limit of the size of files stands for a disk that fills up in the middle of a file. Without the trap the
/// system kills the program there.
#[test]
fn a_disk_that_fills_up_anywhere_leaves_the_file_of_before() {
    let (folder, whole) = folder_with_targets();
    // Blocks of 512 bytes.
    let most = whole.iter().map(Vec::len).max().unwrap() / 512;
    let (mut failed, mut killed) = (0, 0);
    for blocks in [0, 1, 2, 8, most / 2, most - 1] {
        for trap in ["trap '' XFSZ", ":"] {
            put_back(folder.path());
            let limit = format!("{trap}; ulimit -f {blocks}");
            let output = limited(&limit, &EXPLAIN, folder.path());
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            new_ones(folder.path(), &whole, &format!("{blocks} blocks"));
            match output.status.code() {
                Some(code) => {
                    assert_eq!((code, parts_left(folder.path())), (2, 0), "{said}");
                    let errors = said.lines().filter(|line| line.starts_with("error"));
                    assert!(
                        errors.count() == 1 && said.contains("cannot be written"),
                        "{said}"
                    );
                    failed += 1;
                }
                None => killed += 1,
            }
        }
    }
    assert_eq!((failed, killed), (6, 6));
    // What a kill left goes with the next run.
    assert_done(&hysteron(&EXPLAIN, folder.path()));
    assert_eq!(parts_left(folder.path()), 0);
    assert_eq!(new_ones(folder.path(), &whole, "the next run"), 3);
}

/// Kills at moments over the whole run, close together where it writes.
#[test]
fn a_kill_at_any_moment_leaves_the_file_of_before() {
    let (folder, whole) = folder_with_targets();
    let mut seen = [0; 4];
    let mut took = {
        let begun = Instant::now();
        assert_done(&hysteron(&EXPLAIN, folder.path()));
        begun.elapsed()
    };
    for trial in 0..60 {
        put_back(folder.path());
        let mut child = Command::new(env!("CARGO_BIN_EXE_hysteron"))
            .args(EXPLAIN)
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let begun = Instant::now();
        let until = took.mul_f64(if trial < 10 {
            f64::from(trial) / 10.0
        } else {
            1.0
        });
        // From then on until the first target is new: the kill comes while the others are written.
        while begun.elapsed() < until && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_micros(200));
        }
        // The system's own kill, which no program can catch.
        child.kill().unwrap();
        let ended = child.wait().unwrap();
        let new = new_ones(folder.path(), &whole, &format!("killed after {until:?}"));
        seen[new] += 1;
        // Towards the moment at which the middle of the targets is written, wherever the machine has it.
        took = took.mul_f64(if ended.success() || new > 1 {
            0.97
        } else {
            1.02
        });
    }
    assert!(seen[0] > 0 && seen[1] + seen[2] + seen[3] > 0, "{seen:?}");
    assert_done(&hysteron(&EXPLAIN, folder.path()));
    assert_eq!(parts_left(folder.path()), 0);
}
