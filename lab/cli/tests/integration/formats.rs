//! The program on files that the libraries of their formats wrote, whole and damaged: every one is read, or
//! refused in one line with status 2.

use crate::common;
#[path = "../../../library/tests/formats/written.rs"]
#[allow(dead_code)]
mod written;

use std::path::Path;
use written::{FILES, Written, damaged, folder};

/// Exit status and messages.
fn read(file: &Written, folder: &Path) -> (Option<i32>, String) {
    let units = file.units.map(|[u, y]| format!("u={u},y={y}"));
    let mut arguments = vec!["identify", file.file, "--effects", "gain"];
    arguments.extend(units.iter().flat_map(|units| ["--units", units]));
    let output = common::hysteron(&arguments, folder);
    (
        output.status.code(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

#[test]
fn whole_files_are_read_and_damage_is_told_in_one_line() {
    let place = tempfile::tempdir().unwrap();
    for file in &FILES {
        let whole = std::fs::read(folder().join(file.file)).unwrap();
        std::fs::write(place.path().join(file.file), &whole).unwrap();
        let (status, said) = read(file, place.path());
        assert_eq!(
            status,
            Some(if file.refused { 2 } else { 0 }),
            "{}: {said}",
            file.file
        );
        for (number, (kind, content)) in damaged(&whole).into_iter().enumerate() {
            std::fs::write(place.path().join(file.file), content).unwrap();
            let (status, said) = read(file, place.path());
            // Less than what makes a file of this kind is never taken for one.
            let expected: &[i32] = if number < 3 { &[2] } else { &[0, 2] };
            assert!(
                status.is_some_and(|status| expected.contains(&status)),
                "{}, {kind}: status {status:?}: {said}",
                file.file
            );
            let one_line = said.trim_end().lines().count() == 1 && said.contains(file.file);
            assert!(
                status == Some(0) || one_line,
                "{}, {kind}: {said}",
                file.file
            );
        }
    }
}
