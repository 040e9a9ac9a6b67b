//! Effects of the user's own: definitions that cannot be, and what gives no finite number.

use crate::common;

use common::{folder_with_model, hysteron, says, words};

#[test]
fn own_effects_that_cannot_be() {
    let folder = folder_with_model();
    let own = |id: &str, output: &str| {
        format!("id = \"{id}\"\nplace = \"load_force\"\noutput = \"{output}\"\n")
    };
    std::fs::write(folder.path().join("own.toml"), own("creep", "x")).unwrap();
    says(
        &["explain", ".", "--own", "own.toml"],
        folder.path(),
        "is a built-in effect",
    );
    std::fs::write(folder.path().join("own.toml"), own("mine", "x - * 2")).unwrap();
    let output = hysteron(&["explain", ".", "--own", "own.toml"], folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(2) && said.contains("x - * 2") && !said.contains("0x"),
        "{said}"
    );
}

/// Real until 0.2 s, no number from the next sample on. At 1 kHz `t` exceeds 0.2 s first in the interval that
/// begins with sample 202 (0.201 s), and what stands in an interval is read at its end.
const UNTIL_A_FIFTH: &str = "id = \"ends\"\nplace = \"load_force\"\noutput = \"x + share * sqrt(0.2005 - t)\"\n\
    [[parameter]]\nname = \"share\"\nlower = 0.0\nupper = 1.0\nstarts = [0.1]\n";

#[test]
fn an_own_effect_that_gives_no_number_is_an_error_with_effect_and_sample() {
    let folder = folder_with_model();
    std::fs::write(folder.path().join("ends.toml"), UNTIL_A_FIFTH).unwrap();
    let outputs = [
        "--out", "new.toml", "--json", "new.json", "--report", "new.html",
    ];
    for command in [
        &["explain", ".", "--own", "ends.toml"][..],
        &["explain", ".", "--from", "gain,ends.toml"],
        &["identify", ".", "--effects", "gain,ends.toml"],
        &["add", "ends.toml", "m.toml", "."],
    ] {
        let output = hysteron(&[command, &outputs].concat(), folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command:?}: {said}");
        assert!(
            said.contains("ends")
                && said.contains("sample 20")
                && said.contains("no finite number"),
            "{command:?}: {said}"
        );
        for file in ["new.toml", "new.json", "new.html"] {
            assert!(
                !folder.path().join(file).exists(),
                "{command:?} wrote {file}"
            );
        }
    }
}

#[test]
fn a_model_that_gives_no_number_is_neither_compared_nor_simulated() {
    let folder = folder_with_model();
    let divides = "id = \"divides\"\nplace = \"load_force\"\noutput = \"x + share / (x - x)\"\n\
        [[parameter]]\nname = \"share\"\nlower = 0.0\nupper = 1.0\nstarts = [0.1]\n";
    let model = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    let effect = format!(
        "{model}\n[[effect]]\nid = \"divides\"\ndefinition = '''\n{divides}'''\n\n[[effect.parameter]]\nname = \"share\"\nvalue = 0.1\nlower = 0.0\nupper = 1.0\n"
    );
    std::fs::write(folder.path().join("divides.toml"), effect).unwrap();
    says(
        &["compare", "divides.toml", "."],
        folder.path(),
        "divides gives no finite number",
    );
    says(
        &["diagnose", "divides.toml", "."],
        folder.path(),
        "divides gives no finite number",
    );
    says(
        &words("simulate divides.toml --drive step:5:0.1 --out y.csv"),
        folder.path(),
        "divides gives no finite number",
    );
    assert!(!folder.path().join("y.csv").exists());
}
