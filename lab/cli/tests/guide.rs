//! docs/five_minutes.md as somebody with a recording would follow it: its commands in their order, and what it says that they say.

mod common;

const GUIDE: &str = include_str!("../../../docs/five_minutes.md");
const RECORDING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/hidden_effect/validation.csv");

#[test]
fn the_five_minutes_are_as_they_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(RECORDING, folder.path().join("recording.csv")).unwrap();
    let before_matlab = GUIDE.split("## From MATLAB").next().unwrap();
    let shown: Vec<&str> = before_matlab.lines().filter_map(|line| line.strip_prefix("    ")).collect();
    let mut said = String::new();
    let (mut commands, mut compared) = (0, 0);
    for line in shown {
        if let Some(arguments) = line.strip_prefix("hysteron ") {
            let output = common::hysteron(&arguments.split_whitespace().collect::<Vec<_>>(), folder.path());
            assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
            said = String::from_utf8_lossy(&output.stdout).into_owned();
            commands += 1;
        } else {
            assert!(said.contains(line.trim_end()), "docs/five_minutes.md shows\n{line}\nand the program said\n{said}");
            compared += 1;
        }
    }
    assert!(commands >= 4 && compared >= 9, "{commands} commands, {compared} lines compared");
    for file in ["model.toml", "report.html", "explain.json", "simulated.csv", "better.toml"] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
}
