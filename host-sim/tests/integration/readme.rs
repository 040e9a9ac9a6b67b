//! The table of effects in docs/reference/list_of_effects.md is that of the registry. `cargo xtask readme`
//! writes it: this test with `HYSTERON_WRITE_README=1`.

use crate::between_marks;

use between_marks::{is_current, replaced};
use std::path::Path;

const BEGIN: &str = "<!-- effects: written from the registry by `cargo xtask readme` -->\n";
const END: &str = "<!-- end of effects -->";

fn table() -> String {
    let rows = hysteron_sim::effect::registry().into_iter().map(|effect| {
        let declaration = effect.declaration();
        format!("| `{}` | {} |\n", declaration.id, declaration.physics)
    });
    std::iter::once("| effect | physics |\n|---|---|\n".to_owned())
        .chain(rows)
        .collect()
}

#[test]
fn the_table_in_the_readme_is_that_of_the_registry() {
    is_current(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/reference/list_of_effects.md"),
        BEGIN,
        END,
        &table(),
    );
}

#[test]
fn a_stale_table_is_replaced_and_what_stands_around_it_stays() {
    let stale = format!("before\n{BEGIN}| `flogiston` | It escapes. |\n{END}\nafter");
    let fresh = replaced(&stale, BEGIN, END, &table()).unwrap();
    assert!(
        fresh.starts_with("before\n")
            && fresh.ends_with("\nafter")
            && fresh.contains("| `creep` |")
            && !fresh.contains("flogiston")
    );
    assert_eq!(replaced(&fresh, BEGIN, END, &table()).unwrap(), fresh);
    assert!(replaced("no marks", BEGIN, END, &table()).is_none());
}
