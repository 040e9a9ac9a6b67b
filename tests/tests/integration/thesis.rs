//! The thesis' chapters against the goals, and what else they found: shapes of curves, orders of schemes. Slow: run in release mode.

use hysteron_thesis::{Row, chapter, goals};

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
fn chapter_3() {
    let rows = chapter(3, &|_| ()).unwrap().rows;
    meets_goals(3, &rows);
    assert_eq!(figure(&rows, "ch3.speed.monotone"), 1.0);
    // The masses are on a grid of 10 g.
    let (measured, ours) = (figure(&rows, "ch3.optimum_mass.measured"), figure(&rows, "ch3.optimum_mass.model"));
    assert!((measured - ours).abs() < 0.0101, "{measured} {ours}");
    // An optimum, not an end of the range.
    assert!((0.075..0.405).contains(&measured), "{measured}");
    assert!(figure(&rows, "ch3.integrator.runge_kutta.max") < 1e-5);
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn chapter_4() {
    let rows = chapter(4, &|_| ()).unwrap().rows;
    meets_goals(4, &rows);
    // The classical model misses the first rise; the one-sided one is better on either way of estimating.
    assert!(figure(&rows, "ch4.cp.rms") > 10.0 * figure(&rows, "ch4.ri.rms"));
    assert!(figure(&rows, "ch4.cp.rms") > 10.0 * figure(&rows, "ch4.ri.other.rms"));
    assert!(figure(&rows, "ch4.bipolar.without.rms") > 2.0 * figure(&rows, "ch4.bipolar.with.rms"));
}

#[test]
#[cfg_attr(debug_assertions, ignore = "slow: release mode")]
fn chapter_5() {
    let rows = chapter(5, &|_| ()).unwrap().rows;
    meets_goals(5, &rows);
    for hz in [50, 100, 200, 300, 400, 500] {
        let joint = figure(&rows, &format!("ch5.model.{hz}hz.rms"));
        // Twice the sensor's noise, and far below the chain of single identifications.
        assert!(joint < 0.002, "{hz} Hz: {joint}");
        assert!(figure(&rows, &format!("ch5.joint.{hz}hz.better")) > 5.0, "{hz} Hz");
    }
    assert!(figure(&rows, "ch5.coverage.pct") >= 95.0);
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
    // A reading does not show how late it is: the true error stands beside it, and falls where the lag is undone.
    let truth = |id: &str| rows.iter().find(|r| r.id == id).and_then(|r| r.truth).unwrap_or_else(|| panic!("{id} has no true error"));
    for load in ["none", "load"] {
        for hz in [150, 500] {
            let (usual, undone) = (format!("ch7.best.{hz}hz.{load}.full.rms"), format!("ch7.best_lag_undone.{hz}hz.{load}.full.rms"));
            println!(
                "{hz} Hz, {load}: {:.2} / {:.2} nm, lag undone {:.2} / {:.2} nm, true / read",
                1e3 * truth(&usual),
                1e3 * figure(&rows, &usual),
                1e3 * truth(&undone),
                1e3 * figure(&rows, &undone)
            );
            assert!(truth(&usual) > 2.0 * figure(&rows, &usual) && truth(&undone) < 0.3 * truth(&usual), "{hz} Hz, {load}");
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
