//! The lab page as a person uses it, by clicks and drops in a real browser: from disk without a network, and
//! with the native engine behind it.
//!
//! The tests of the page from disk are ignored by default: `cargo xtask lab` builds it first,
//! `cargo xtask library` then runs them.

use crate::devtools;

use devtools::{Page, browser};
use hysteron::analyse::{Options, Start, analyse};
use hysteron::dataset::folder;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::servo::reference::Reference;
use hysteron::servo::work::{Work, follow};
use hysteron::watch::Unwatched;
use hysteron::{model_file, series};
use hysteron_browser::served::OnDisk;
use hysteron_browser::server::Server;
use std::path::PathBuf;
use std::sync::Arc;

const LEFT_ALONE: &str = "document.documentElement.dataset.busy === 'false'";
const BASE: &str = "hysteresis,initial_curve,vibration";

fn root() -> PathBuf {
    hysteron_tests::root().canonicalize().expect("the root")
}

/// The page at an address, and a folder that does not outlive its test.
fn opened_at(address: &str) -> Option<(Page, tempfile::TempDir)> {
    let Some(browser) = browser() else {
        assert!(
            std::env::var_os("CI").is_none(),
            "CI needs chromium to look at pages"
        );
        hysteron_tests::skipped("no chromium to look at the page with");
        return None;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut page = Page::open(&browser, address, folder.path());
    page.wait_for("document.documentElement?.dataset.state");
    Some((page, folder))
}

fn opened() -> Option<(Page, tempfile::TempDir)> {
    let file = root().join("target/lab.html");
    assert!(
        file.is_file(),
        "{} is not there: cargo xtask lab",
        file.display()
    );
    let (mut page, folder) = opened_at(&format!("file://{}", file.display()))?;
    state(&mut page, "empty");
    Some((page, folder))
}

fn state(page: &mut Page, wanted: &str) {
    page.wait_for(&format!(
        "document.documentElement.dataset.state === '{wanted}' && {LEFT_ALONE}"
    ));
}

fn number(page: &mut Page, key: &str) -> f64 {
    let text = page.value(&format!("document.documentElement.dataset.{key}"));
    text.as_str()
        .and_then(|t| t.parse().ok())
        .unwrap_or_else(|| panic!("{key}: {text}"))
}

fn nothing_was_asked_for(page: &Page) {
    let outside: Vec<&String> = page
        .requests
        .iter()
        .filter(|url| {
            !["file:", "blob:", "data:"]
                .iter()
                .any(|s| url.starts_with(s))
        })
        .collect();
    assert!(outside.is_empty(), "{outside:?}");
    assert!(page.failures.is_empty(), "{:?}", page.failures);
}

/// Equal but for the last digits: exponentials and sines of a browser's module come from another library than
/// those of the host.
fn require_alike(a: &toml::Value, b: &toml::Value, place: &str) {
    match (a, b) {
        (toml::Value::Float(a), toml::Value::Float(b)) => {
            // Standard deviations follow from differences, which lose some digits.
            let digits = if place.ends_with("std") { 1e-6 } else { 1e-9 };
            assert!(
                (a - b).abs() <= digits * a.abs().max(b.abs()),
                "{place}: {a} and {b}"
            );
        }
        // Rows of the covariance's factor, with seven digits.
        (toml::Value::String(a), toml::Value::String(b)) if place.contains("covariance_factor") => {
            let row = |text: &str| {
                text.split_whitespace()
                    .map(|word| word.parse::<f64>().expect("a number"))
                    .collect::<Vec<_>>()
            };
            let (a, b) = (row(a), row(b));
            assert_eq!(a.len(), b.len(), "{place}");
            let size = a.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            assert!(
                a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= 1e-5 * size),
                "{place}: {a:?} and {b:?}"
            );
        }
        (toml::Value::Array(a), toml::Value::Array(b)) => {
            assert_eq!(a.len(), b.len(), "{place}");
            a.iter()
                .zip(b)
                .enumerate()
                .for_each(|(i, (a, b))| require_alike(a, b, &format!("{place}[{i}]")));
        }
        (toml::Value::Table(a), toml::Value::Table(b)) => {
            assert_eq!(
                a.keys().collect::<Vec<_>>(),
                b.keys().collect::<Vec<_>>(),
                "{place}"
            );
            a.iter()
                .for_each(|(key, value)| require_alike(value, &b[key], &format!("{place}.{key}")));
        }
        _ => assert_eq!(a, b, "{place}"),
    }
}

#[test]
#[ignore = "needs target/lab.html, which `cargo xtask lab` builds"]
fn dropped_files_are_explained_and_the_saved_model_is_that_of_the_command_line() {
    let Some((mut page, out)) = opened() else {
        return;
    };
    let example = root().join("examples/hidden_effect");
    let files: Vec<PathBuf> = std::fs::read_dir(&example)
        .expect("the example")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    page.drop_files(&files);
    state(&mut page, "loaded");
    let before_nm = number(&mut page, "heldOutNm");
    page.click("#find");
    state(&mut page, "named");
    let sentence = page.value("document.querySelector('#finder .sentence').textContent");
    assert!(
        sentence
            .as_str()
            .is_some_and(|s| s.contains("Creep is missing")),
        "{sentence}"
    );
    println!("explain in the page: {} s", number(&mut page, "seconds"));
    page.click("#add");
    page.wait_for(&format!("lab.step === 1 && {LEFT_ALONE}"));
    let (after_nm, floor_nm) = (number(&mut page, "heldOutNm"), number(&mut page, "floorNm"));
    assert!(
        before_nm > 10.0 * floor_nm && after_nm < 1.03 * floor_nm,
        "{before_nm} to {after_nm}, noise {floor_nm}"
    );

    page.click("#save > summary");
    page.click("[data-save=model]");
    let saved = page.saved(&out.path().join("model.toml"));
    let dataset = folder::load(&example).expect("the example is read");
    let effects = model_file::effects_named(BASE).expect("known effects");
    let began = std::time::Instant::now();
    let found = analyse(
        &dataset,
        Start::Effects(&effects),
        &Options::default(),
        &Unwatched,
    )
    .expect("it is explained");
    println!(
        "explain on the host: {:.2} s",
        began.elapsed().as_secs_f64()
    );
    let expected = model_file::to_toml(&found.model, &dataset.name).expect("a model");
    require_alike(
        &toml::from_str(&saved).expect("TOML"),
        &toml::from_str(&expected).expect("TOML"),
        "model",
    );

    page.click("#save > summary");
    page.click("[data-save=report]");
    assert!(
        page.saved(&out.path().join("report.html"))
            .contains(found.diagnosis.sentence.as_str())
    );
    page.click("#save > summary");
    page.click("[data-save=series]");
    let shown = page
        .value("lab.shown")
        .as_u64()
        .and_then(|index| dataset.records.get(index as usize))
        .expect("a record");
    let numbers = |text: &str| -> Vec<f64> {
        text.lines()
            .skip(1)
            .flat_map(|line| line.split(',').map(|cell| cell.parse().expect("a number")))
            .collect()
    };
    let saved = numbers(&page.saved(&out.path().join(series::file_name(shown))));
    let expected = numbers(&series::csv(shown, &[("modelled", &found.model)]));
    assert_eq!(saved.len(), expected.len());
    assert!(
        saved
            .iter()
            .zip(&expected)
            .all(|(a, b)| (a - b).abs() < 2e-6),
        "the signals differ from those of the command line"
    );
    // On to the servo: the same files as on the command line.
    page.click("#design");
    page.wait_for(&format!("servo.designed && {LEFT_ALONE}"));
    let order = DesignOrder {
        recording: Some(&dataset),
        ..DesignOrder::default()
    };
    let designed = order::design(&found.model, &order).expect("a servo");
    page.click("#save-servo");
    let saved: toml::Value =
        toml::from_str(&page.saved(&out.path().join("servo.toml"))).expect("TOML");
    let expected: toml::Value =
        toml::from_str(&toml::to_string_pretty(&designed).expect("TOML")).expect("TOML");
    for key in ["scheme", "model", "delayed"] {
        require_alike(&saved[key], &expected[key], key);
    }
    page.click("#follow");
    page.wait_for(&format!("servo.followed && {LEFT_ALONE}"));
    let nm = |page: &mut Page, key: &str| {
        1e3 * page
            .value(&format!("servo.followed.{key}"))
            .as_f64()
            .expect("a number")
    };
    let amplitude_um = page.value("servo.amplitude_um").as_f64().expect("a number");
    let name = format!("sine:50:{amplitude_um}");
    let reference = Reference::named(&name, 5e-5).expect("a sine");
    let followed = follow(&found.model, &designed, &reference, &name, &Work::default())
        .expect("it is followed");
    assert!((nm(&mut page, "true_rms_um") / (1e3 * followed.truth.rms_um) - 1.0).abs() < 1e-3);
    let band = page.value("document.querySelector('#servo-band').textContent");
    assert!(
        band.as_str()
            .is_some_and(|said| said.contains("over 13 plants") && said.contains("worst: ")),
        "{band}"
    );
    let step = page.value("servo.followed.step");
    assert!(
        step.as_str()
            .is_some_and(|said| said.starts_with("settles to 2 % in ")),
        "{step}"
    );
    assert_eq!(
        page.value("document.querySelectorAll('#follow-plots canvas').length > 2"),
        true
    );
    page.click("#save-block");
    let commands = page.saved(&out.path().join("servo.block.commands"));
    assert!(commands.lines().count() > 10, "{commands}");

    page.click("#undo");
    page.wait_for(&format!("lab.step === 0 && {LEFT_ALONE}"));
    assert!(
        (number(&mut page, "heldOutNm") / before_nm - 1.0).abs() < 1e-9,
        "undo brings the model before back"
    );
    nothing_was_asked_for(&page);
}

#[test]
#[ignore = "needs target/lab.html, which `cargo xtask lab` builds"]
fn the_example_opens_at_a_click_and_follows_a_pulled_parameter() {
    let Some((mut page, _out)) = opened() else {
        return;
    };
    page.click("#example2");
    state(&mut page, "loaded");
    let begun_nm = number(&mut page, "heldOutNm");
    page.click("[data-effect=vibration] summary");
    page.pull("[data-effect=vibration] input[type=range]", 0.3);
    page.wait_for(&format!(
        "document.documentElement.dataset.redrawMs && {LEFT_ALONE}"
    ));
    let samples = page.value("lab.data.records.reduce((sum, record) => sum + record.samples, 0)");
    println!(
        "redraw after a pull, {samples} samples: {} ms",
        number(&mut page, "redrawMs")
    );
    assert!(
        number(&mut page, "heldOutNm") > 1.01 * begun_nm,
        "the error follows"
    );
    page.click("#undo");
    page.wait_for(&format!("Math.abs(Number(document.documentElement.dataset.heldOutNm) / {begun_nm} - 1) < 1e-9 && {LEFT_ALONE}"));
    page.click("#on-vibration");
    page.wait_for(&format!(
        "Number(document.documentElement.dataset.heldOutNm) > 1.01 * {begun_nm}"
    ));
    nothing_was_asked_for(&page);
}

#[test]
#[ignore = "needs target/lab.html, which `cargo xtask lab` builds"]
fn a_search_can_be_cancelled_and_begun_again() {
    let Some((mut page, _out)) = opened() else {
        return;
    };
    page.click("#example2");
    state(&mut page, "loaded");
    page.click("#find");
    page.wait_for("document.documentElement.dataset.state === 'running'");
    page.click("#cancel");
    state(&mut page, "loaded");
    page.click("#find");
    state(&mut page, "named");
    nothing_was_asked_for(&page);
}

#[test]
#[ignore = "needs target/lab.html, which `cargo xtask lab` builds"]
fn one_file_alone_is_cut_and_what_cannot_be_read_is_said() {
    let Some((mut page, out)) = opened() else {
        return;
    };
    let wrong = out.path().join("broken.csv");
    std::fs::write(&wrong, "t,u,y\n0,1,2\n1,x,3\n").expect("the folder can be written");
    page.drop_files(&[wrong]);
    page.wait_for(&format!(
        "!document.querySelector('#message').hidden && {LEFT_ALONE}"
    ));
    let message = page.value("document.querySelector('#message').textContent");
    assert!(
        message.as_str().is_some_and(|m| m.contains("broken.csv")),
        "{message}"
    );
    // 100,000 samples: what the redraw is measured on.
    let rows = (0..100_000).map(|k| {
        let t = f64::from(k) / 10_000.0;
        let u = |t: f64| 30.0 - 30.0 * (31.4 * t).cos() * (0.5 + 0.5 * (0.7 * t).cos());
        format!(
            "{t:.4},{:.5},{:.5}\n",
            u(t),
            0.1 * u(t - 0.002) + 0.002 * (f64::from(k) * 78.233).sin()
        )
    });
    let file = out.path().join("long.csv");
    std::fs::write(
        &file,
        format!("t [s],u [V],y [um]\n{}", rows.collect::<String>()),
    )
    .expect("the folder can be written");
    page.drop_files(&[file]);
    state(&mut page, "loaded");
    assert_eq!(
        page.value("document.querySelector('#message').hidden"),
        true
    );
    let roles = page.value("lab.data.records.map((record) => record.role).join()");
    assert!(
        roles
            .as_str()
            .is_some_and(|r| r.contains("identify") && r.contains("validate")),
        "{roles}"
    );
    page.click("[data-effect=gain] summary");
    page.pull("[data-effect=gain] input[type=range]", 0.2);
    page.wait_for(&format!(
        "document.documentElement.dataset.redrawMs && {LEFT_ALONE}"
    ));
    println!(
        "redraw after a pull, a recording of 100000 samples: {} ms",
        number(&mut page, "redrawMs")
    );
    nothing_was_asked_for(&page);
}

#[test]
fn the_served_page_has_the_native_engine_behind_it() {
    let example = root().join("examples/hidden_effect");
    let served = OnDisk {
        path: example.clone(),
        instructions: hysteron::dataset::reading::Instructions::default(),
    };
    let server = Arc::new(Server::bind(Some(Arc::new(served))).expect("a port"));
    let serving = Arc::clone(&server);
    let thread = std::thread::spawn(move || serving.serve());
    let Some((mut page, out)) = opened_at(&server.address()) else {
        return;
    };
    // The data set that the program was started with is there at once, with the effects that lie beside it.
    state(&mut page, "loaded");
    assert_eq!(page.value("lab.start"), BASE);
    let before_nm = number(&mut page, "heldOutNm");

    page.click("#find");
    page.wait_for("document.querySelector('#finder .live li')");
    page.click("#cancel");
    state(&mut page, "loaded");
    assert!(
        (number(&mut page, "heldOutNm") / before_nm - 1.0).abs() < 1e-12,
        "nothing is kept of what was cancelled"
    );

    page.click("#find");
    state(&mut page, "named");
    // A file that is refused leaves the verdict and the way to the model.
    let wrong = out.path().join("broken.csv");
    std::fs::write(&wrong, "t,u,y\n0,1,2\n1,x,3\n").expect("the folder can be written");
    page.drop_files(&[wrong]);
    page.wait_for(&format!(
        "!document.querySelector('#message').hidden && {LEFT_ALONE}"
    ));
    assert_eq!(
        page.value("document.querySelector('#finder .verdict').textContent"),
        "Named"
    );
    state(&mut page, "named");
    page.click("#add");
    page.wait_for(&format!("lab.step === 1 && {LEFT_ALONE}"));
    page.click("#save > summary");
    page.click("[data-save=model]");
    let saved = page.saved(&out.path().join("model.toml"));
    let dataset = folder::load(&example).expect("the example is read");
    let effects = model_file::effects_named(BASE).expect("known effects");
    let found = analyse(
        &dataset,
        Start::Effects(&effects),
        &Options::default(),
        &Unwatched,
    )
    .expect("it is explained");
    assert_eq!(
        saved,
        model_file::to_toml(&found.model, &dataset.name).expect("a model"),
        "byte for byte that of the command line"
    );

    // What is dropped goes to the same engine, and so does the example.
    page.click("#example");
    page.wait_for(&format!(
        "lab.served === null && lab.files.length > 5 && {LEFT_ALONE}"
    ));
    state(&mut page, "loaded");
    let outside: Vec<&String> = page
        .requests
        .iter()
        .filter(|url| {
            !url.starts_with(&server.address()[..20])
                && !url.starts_with("blob:")
                && !url.starts_with("data:")
        })
        .collect();
    assert!(outside.is_empty(), "{outside:?}");
    assert!(page.failures.is_empty(), "{:?}", page.failures);

    server.end();
    thread.join().expect("the server ends");
}

#[test]
fn what_a_first_file_does_not_say_can_be_said_in_the_page() {
    let server = Arc::new(Server::bind(None).expect("a port"));
    let serving = Arc::clone(&server);
    let thread = std::thread::spawn(move || serving.serve());
    let Some((mut page, out)) = opened_at(&server.address()) else {
        return;
    };
    state(&mut page, "empty");
    // The sensor gives a volt for 5 um, which no file says.
    let drive_v = |k: f64| 30.0 - 30.0 * (0.03 * k).cos() * (0.5 + 0.5 * (0.0013 * k).cos());
    let rows = (0..4000).map(f64::from).map(|k| {
        format!(
            "{:.4},{:.5},{:.5}\n",
            1e-3 * k,
            drive_v(k),
            0.02 * drive_v(k - 2.0)
        )
    });
    let file = out.path().join("volts.csv");
    std::fs::write(
        &file,
        format!("t [s],u [V],Channel B [V]\n{}", rows.collect::<String>()),
    )
    .expect("the folder can be written");
    page.drop_files(&[file]);
    page.wait_for(&format!(
        "document.documentElement.dataset.error.includes('--units y=5um/V') && {LEFT_ALONE}"
    ));
    assert_eq!(
        page.value("document.querySelector('#otherwise').hidden"),
        false
    );
    // An unknown unit: refused again, with the entries still there.
    page.type_into("#otherwise [name=unit-y]", "5furlong/V");
    page.click("#otherwise button");
    page.wait_for(&format!(
        "document.documentElement.dataset.error.includes('furlong') && {LEFT_ALONE}"
    ));
    page.type_into("#otherwise [name=unit-y]", "5um/V");
    page.click("#otherwise button");
    state(&mut page, "loaded");
    assert_eq!(
        page.value("document.querySelector('#otherwise').hidden"),
        true
    );
    let range_um = page.value("Math.max(...lab.data.records.map((record) => record.range_um))");
    assert!(
        range_um.as_f64().is_some_and(|um| (um - 6.0).abs() < 0.1),
        "{range_um}"
    );
    // The entry stays, so that the user can change it.
    assert_eq!(
        page.value("document.querySelector('#columns [name=unit-y]').value"),
        "5um/V"
    );
    assert!(page.failures.is_empty(), "{:?}", page.failures);
    server.end();
    thread.join().expect("the server ends");
}

#[test]
fn no_name_in_a_dropped_file_is_run() {
    let server = Arc::new(Server::bind(None).expect("a port"));
    let serving = Arc::clone(&server);
    let thread = std::thread::spawn(move || serving.serve());
    let Some((mut page, out)) = opened_at(&server.address()) else {
        return;
    };
    state(&mut page, "empty");
    let hostile = "<img src=x onerror=document.documentElement.dataset.ran=1>";
    let drive_v = |k: f64| 30.0 - 30.0 * (0.03 * k).cos() * (0.5 + 0.5 * (0.0013 * k).cos());
    let rows = (0..4000).map(f64::from).map(|k| {
        let (u, y) = (drive_v(k), 0.1 * drive_v(k - 2.0));
        format!("{:.4},{u:.5},{y:.5},{k}\n", 1e-3 * k)
    });
    let rows: String = rows.collect();
    let file = out.path().join(format!("{hostile}.csv"));
    // Refused first, with the name of its file.
    std::fs::write(
        &file,
        format!("t [s],u [V],y{hostile} [V]\n{rows}").replace(",3\n", "\n"),
    )
    .expect("the folder can be written");
    page.drop_files(std::slice::from_ref(&file));
    page.wait_for(&format!(
        "!document.querySelector('#message').hidden && {LEFT_ALONE}"
    ));
    let head = format!("t [s],u [V],y{hostile} [um],note{hostile} [{hostile}]");
    std::fs::write(&file, format!("{head}\n{rows}")).expect("the folder can be written");
    page.drop_files(&[file]);
    state(&mut page, "loaded");
    assert_eq!(
        page.value("document.documentElement.dataset.ran ?? 'text'"),
        "text"
    );
    let shown = page.value("document.body.textContent.includes('onerror=document')");
    assert_eq!(shown, true, "the names are shown as text");
    assert!(page.failures.is_empty(), "{:?}", page.failures);
    server.end();
    thread.join().expect("the server ends");
}
