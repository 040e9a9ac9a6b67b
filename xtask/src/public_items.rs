//! What the library shows to its users: the items on its pages of documentation, held against a list.

use crate::workspace::root;
use std::collections::BTreeSet;

/// The list, one item a line.
const LIST: &str = "lab/library/public_items.txt";
/// A front door is looked through before it is gone through.
const MOST: usize = 250;

/// Items of `all.html`, as `struct Dataset` or `fn servo::design`.
fn items(page: &str) -> BTreeSet<String> {
    let links = page
        .split("href=\"")
        .skip(1)
        .filter_map(|rest| rest.split_once('"').map(|(link, _)| link));
    let item = |link: &str| {
        let path = link.strip_suffix(".html")?;
        let (folder, file) = path
            .rsplit_once('/')
            .map_or(("", path), |(folder, file)| (folder, file));
        let (kind, name) = file.split_once('.')?;
        let place = if folder.is_empty() {
            String::new()
        } else {
            format!("{}::", folder.replace('/', "::"))
        };
        [
            "struct", "enum", "trait", "fn", "type", "constant", "static", "macro",
        ]
        .contains(&kind)
        .then(|| format!("{kind} {place}{name}"))
    };
    links.filter_map(item).collect()
}

/// Compares the documented items with the list; `write` makes the list anew.
fn compare(write: bool) -> Result<(), String> {
    let page = root().join("target/doc/hysteron/all.html");
    let text = std::fs::read_to_string(&page)
        .map_err(|e| format!("{}: {e}; expected the pages of `cargo doc`", page.display()))?;
    let found = items(&text);
    if found.len() > MOST {
        return Err(format!(
            "the library shows {} items; expected at most {MOST}",
            found.len()
        ));
    }
    let list = root().join(LIST);
    if write {
        let text: String = found.iter().map(|item| format!("{item}\n")).collect();
        return std::fs::write(&list, text).map_err(|e| format!("{LIST}: {e}"));
    }
    let known = std::fs::read_to_string(&list).map_err(|e| format!("{LIST}: {e}"))?;
    let known: BTreeSet<String> = known.lines().map(String::from).collect();
    let names = |items: Vec<&String>| {
        items
            .iter()
            .map(|item| item.as_str())
            .collect::<Vec<_>>()
            .join(", ")
    };
    let (new, gone) = (
        names(found.difference(&known).collect()),
        names(known.difference(&found).collect()),
    );
    if new.is_empty() && gone.is_empty() {
        println!("{} public items, as listed", found.len());
        return Ok(());
    }
    Err(format!(
        "{LIST}: new: {new}; gone: {gone}. If that is meant: cargo xtask public-items"
    ))
}

/// The step of the check, after the documentation.
pub fn check() -> Result<(), String> {
    compare(false)
}

/// Makes the list anew from the pages of the last documentation step.
pub fn write() -> Result<(), String> {
    compare(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_read_from_links() {
        let page = "<a href=\"struct.Dataset.html\">Dataset</a><a href=\"servo/fn.design.html\">x</a><a href=\"index.html\">y</a>";
        assert_eq!(
            items(page).into_iter().collect::<Vec<_>>(),
            ["fn servo::design", "struct Dataset"]
        );
    }
}
