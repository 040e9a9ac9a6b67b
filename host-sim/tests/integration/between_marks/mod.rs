//! A table in a page of documentation that a test writes and keeps current.

use std::path::Path;

/// The text with the table between its marks; `None` without them.
pub fn replaced(text: &str, begin: &str, end: &str, table: &str) -> Option<String> {
    let (before, rest) = text.split_once(begin)?;
    let (_, after) = rest.split_once(end)?;
    Some(format!("{before}{begin}{table}{end}{after}"))
}

/// Fails where the page holds another table; writes it instead where `HYSTERON_WRITE_README` is set, as
/// `cargo xtask readme` does.
pub fn is_current(page: &Path, begin: &str, end: &str, table: &str) {
    let text = std::fs::read_to_string(page).unwrap();
    let fresh = replaced(&text, begin, end, table)
        .unwrap_or_else(|| panic!("{} has the marks around its table", page.display()));
    if std::env::var_os("HYSTERON_WRITE_README").is_some() {
        std::fs::write(page, fresh).unwrap();
    } else {
        assert!(
            fresh == text,
            "{}: its table is stale; run `cargo xtask readme`",
            page.display()
        );
    }
}
