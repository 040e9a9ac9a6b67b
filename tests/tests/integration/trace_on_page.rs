//! The log of the emulated amplifier dropped on the lab page, beside the image that wrote it, comes to the
//! same records as `hysteron capture`.
//!
//! Ignored by default: `cargo xtask check` runs it with the page, the image and the log that earlier steps of
//! the check leave.

// The other test of the page uses the rest of it.
#[allow(dead_code)]
use crate::devtools;

use devtools::{Page, browser};
use hysteron::capture::capture;
use hysteron::dataset::reading::{Instructions, from_manifest_as};
use std::path::PathBuf;

fn from_environment(variable: &str) -> PathBuf {
    let path = PathBuf::from(
        std::env::var_os(variable).unwrap_or_else(|| panic!("{variable} is not set")),
    );
    assert!(
        path.is_file(),
        "{variable}: {} is not there",
        path.display()
    );
    path
}

#[test]
#[ignore = "needs a page, an image and its log: `cargo xtask check` leaves them"]
fn the_log_of_an_amplifier_is_decoded_beside_its_image() {
    let [page_file, image, log] =
        ["HYSTERON_PAGE", "HYSTERON_IMAGE", "HYSTERON_LOG"].map(from_environment);
    let (found, files) = capture(
        &std::fs::read(&image).unwrap(),
        &std::fs::read(&log).unwrap(),
    )
    .unwrap();
    let files = files
        .into_iter()
        .collect::<std::collections::BTreeMap<_, _>>();
    let manifest = String::from_utf8(files["dataset.toml"].clone()).unwrap();
    let expected =
        from_manifest_as(&manifest, "dataset.toml", &files, &Instructions::default()).unwrap();
    assert!(!found.records.is_empty());
    let Some(browser) = browser() else {
        assert!(
            std::env::var_os("CI").is_none(),
            "CI needs chromium to look at pages"
        );
        hysteron_tests::skipped("no chromium to look at the page with");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let mut page = Page::open(
        &browser,
        &format!("file://{}", page_file.display()),
        folder.path(),
    );
    page.wait_for("document.documentElement?.dataset.state === 'empty'");
    page.drop_files(&[image]);
    page.wait_for(
        "document.querySelector('#message').textContent.includes('one image and one log')",
    );
    page.drop_files(&[from_environment("HYSTERON_IMAGE"), log]);
    page.wait_for("document.documentElement.dataset.state === 'loaded' && document.documentElement.dataset.busy === 'false'");
    let shown = page.value("lab.data.records.map((record) => `${record.name} ${record.role} ${record.samples}`).join()");
    let expected: Vec<String> = expected
        .records
        .iter()
        .map(|r| format!("{} {} {}", r.name, r.role.name(), r.window.len()))
        .collect();
    assert_eq!(shown, expected.join(","));
    assert!(
        page.failures.is_empty() && page.requests.iter().all(|url| !url.starts_with("http")),
        "{:?} {:?}",
        page.failures,
        page.requests
    );
}
