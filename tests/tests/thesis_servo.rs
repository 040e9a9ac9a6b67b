//! Chapters 6 and 7 against the goals, and the order of schemes that the thesis found. Slow: run in release mode.

use hysteron::reproduce::{Row, chapter, goals};

fn figure(rows: &[Row], id: &str) -> f64 {
    rows.iter().find(|r| r.id == id).unwrap_or_else(|| panic!("{id} is missing")).ours
}

fn meets_goals(number: u32, rows: &[Row]) {
    for goal in goals().unwrap().iter().filter(|g| g.chapter == number) {
        let ours = figure(rows, &goal.id);
        assert!(ours.is_finite(), "{}", goal.id);
        if let Some(limit) = goal.goal {
            assert!(ours <= limit, "{}: {ours} is above {limit}", goal.id);
        }
    }
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn chapter_6() {
    let rows = chapter(6, &|_| ()).unwrap().rows;
    meets_goals(6, &rows);
    for hz in [100, 150] {
        assert!(figure(&rows, &format!("ch6.pidsm_ab.{hz}hz.rms")) < figure(&rows, &format!("ch6.pid.{hz}hz.rms")), "{hz} Hz");
    }
    assert!(figure(&rows, "ch6.sm_ab.step.chatter") > 100.0 * figure(&rows, "ch6.pidsm_ab.step.chatter"));
    assert!(figure(&rows, "ch6.smcbl.steady") > 100.0 * figure(&rows, "ch6.pidsm_ab.steady"));
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn chapter_7() {
    let rows = chapter(7, &|_| ()).unwrap().rows;
    meets_goals(7, &rows);
    for load in ["none", "load"] {
        for hz in [50, 100, 150] {
            let (ours, other) = (format!("ch7.pidsmoc.{hz}hz.{load}.rms"), format!("ch7.pidsmc_ab.{hz}hz.{load}.rms"));
            assert!(figure(&rows, &ours) < figure(&rows, &other), "{hz} Hz {load}");
        }
        // At 10 Hz the integral gain decides, which the thesis chose twice as large for the alpha-beta scheme.
        let (ours, other) = (format!("ch7.pidsmoc_equal_integral.10hz.{load}.rms"), format!("ch7.pidsmc_ab.10hz.{load}.rms"));
        assert!(figure(&rows, &ours) < figure(&rows, &other), "10 Hz {load}");
    }
    // Tuned by one optimiser under one set of margins the order is that of the thesis at 10 Hz and above, whatever the timing.
    for timing in ["no_delay", "delay"] {
        for load in ["none", "load"] {
            for hz in [10, 50, 100, 150] {
                let of = |scheme: &str| figure(&rows, &format!("ch7.fair.{scheme}.{timing}.{hz}hz.{load}.rms"));
                assert!(of("pidsmoc") < of("pidsmc_ab"), "{timing}, {hz} Hz, {load}");
            }
        }
    }
    for row in rows.iter().filter(|r| r.id.ends_with(".dac12.rms")) {
        let sixteen = figure(&rows, &row.id.replace(".dac12", ""));
        assert!(row.ours <= sixteen + 0.001, "{}: {} {sixteen}", row.id, row.ours);
    }
    for row in rows.iter().filter(|r| r.id.starts_with("ch7.integer.")) {
        assert!(row.ours <= 0.0005, "{}: {}", row.id, row.ours);
    }
}
