//! The table of effects in README.md is that of the registry. `cargo xtask readme` writes it: this test with `HYSTERON_WRITE_README=1`.

use std::path::Path;

const BEGIN: &str = "<!-- effects: written from the registry by `cargo xtask readme` -->\n";
const END: &str = "<!-- end of effects -->";

fn table() -> String {
    let rows = hysteron_sim::effect::registry().into_iter().map(|effect| {
        let declaration = effect.declaration();
        format!("| `{}` | {} |\n", declaration.id, declaration.physics)
    });
    std::iter::once("| effect | physics |\n|---|---|\n".to_owned()).chain(rows).collect()
}

/// The text with the table as the registry has it; `None` without the marks around it.
fn with_table(text: &str) -> Option<String> {
    let (before, rest) = text.split_once(BEGIN)?;
    let (_, after) = rest.split_once(END)?;
    Some(format!("{before}{BEGIN}{}{END}{after}", table()))
}

#[test]
fn the_table_in_the_readme_is_that_of_the_registry() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let fresh = with_table(&text).expect("README.md has the marks around its table of effects");
    if std::env::var_os("HYSTERON_WRITE_README").is_some() {
        std::fs::write(&path, fresh).unwrap();
        return;
    }
    assert!(fresh == text, "README.md: its table of effects is stale; run `cargo xtask readme`");
}

#[test]
fn a_stale_table_is_replaced_and_what_stands_around_it_stays() {
    let stale = format!("before\n{BEGIN}| `flogiston` | It escapes. |\n{END}\nafter");
    let fresh = with_table(&stale).unwrap();
    assert!(fresh.starts_with("before\n") && fresh.ends_with("\nafter") && fresh.contains("| `creep` |") && !fresh.contains("flogiston"));
    assert_eq!(with_table(&fresh).unwrap(), fresh);
    assert!(with_table("no marks").is_none());
}
