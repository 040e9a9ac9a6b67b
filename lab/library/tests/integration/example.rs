//! The example for users of the library does what it says.

#[allow(dead_code)]
#[path = "../../../../examples/arrays_to_servo.rs"]
mod arrays_to_servo;

#[test]
fn arrays_lead_to_a_verdict_a_better_model_and_a_servo() {
    let said = arrays_to_servo::arrays_to_servo().unwrap();
    let lines: Vec<&str> = said.lines().collect();
    assert!(
        lines[0].starts_with("Delay is missing: with it the held-out error falls from "),
        "{said}"
    );
    assert!(
        lines[1].starts_with("The model: delay, hysteresis, vibration; held out "),
        "{said}"
    );
    // The noise that was simulated, within what 7500 samples tell of it.
    let error_nm: f64 = lines[1]
        .split("held out ")
        .nth(1)
        .unwrap()
        .trim_end_matches(" nm.")
        .parse()
        .unwrap();
    assert!((error_nm / 4.0 - 1.0).abs() < 0.05, "{said}");
    assert!(
        lines[2].starts_with("The servo (") && lines.len() > 3,
        "{said}"
    );
    // As rustfmt's defaults wrap it.
    let example = include_str!("../../../../examples/arrays_to_servo.rs");
    assert!(example.lines().count() < 100);
}
