//! A whole page in a real browser: every figure is drawn, no script error, nothing loaded from outside.
//!
//! The arrays are made here, with structure that a reader can recognise (a hysteresis loop, creep after a
//! step, hum); no figure in them is a result.

use hysteron_report::{
    CandidateReport, EvidenceReport, EvidenceTrace, ExperimentReport, ExplainReport,
    NoiseFloorReport, ParameterReport, RecordReport, StepReport, explain_page,
};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The same pseudo-random numbers every time, roughly normal with unit variance.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut sum = 0.0;
        for _ in 0..12 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum - 6.0
    }
}

const NOISE_UM: f64 = 0.005;

/// A drive of the given kind at time `t`, V.
fn drive_v(kind: &str, t: f64) -> f64 {
    match kind {
        "hold" => [0.0, 40.0, 15.0, 60.0, 25.0, 25.0, 25.0][((t / 6.0) as usize).min(6)],
        "rest" => 0.0,
        "sines" => {
            let frequency_hz = [5.0, 20.0, 50.0, 100.0][((t / 0.2) as usize).min(3)];
            30.0 - 30.0 * (TAU * frequency_hz * t).cos()
        }
        _ => {
            let phase = (t / 0.4).fract();
            let peak_v = (70.0 - 8.0 * (t / 0.4).floor()).max(5.0);
            peak_v * (1.0 - (2.0 * phase - 1.0).abs())
        }
    }
}

/// A record, and the creep in it.
fn record(
    name: &str,
    kind: &str,
    role: &str,
    samples: usize,
    rate_hz: f64,
) -> (RecordReport, Vec<f64>) {
    let mut noise = Noise(samples as u64);
    let (mut play, mut slow_um) = (0.0f64, 0.0);
    let mut made = RecordReport {
        name: name.into(),
        role: role.into(),
        sample_rate_hz: rate_hz,
        residual_um: vec![Vec::new(); 3],
        ..RecordReport::default()
    };
    let mut creep_um = Vec::new();
    for k in 0..samples {
        let t_s = k as f64 / rate_hz;
        let u_v = drive_v(kind, t_s);
        play = play.clamp(u_v - 6.0, u_v + 6.0).max(0.0);
        let fast_um = 0.1 * u_v + 0.03 * play + 4e-5 * u_v * play;
        slow_um += (0.02 * fast_um - slow_um) * (1.0 - (-1.0 / (rate_hz * 1.5)).exp());
        let hum_um = 0.004 * (TAU * 50.0 * t_s).sin();
        let y_um = fast_um + slow_um + hum_um + NOISE_UM * noise.next();
        made.t_s.push(t_s);
        made.u_v.push(u_v);
        made.y_um.push(y_um);
        for (step, modelled_um) in [0.133 * u_v, 1.008 * fast_um, fast_um + slow_um]
            .into_iter()
            .enumerate()
        {
            made.residual_um[step].push(y_um - modelled_um);
        }
        creep_um.push(slow_um);
    }
    let last = &made.residual_um[2];
    made.rms_um = (last.iter().map(|e| e * e).sum::<f64>() / samples as f64).sqrt();
    made.max_um = last.iter().fold(0.0, |m, e| e.abs().max(m));
    made.range_um = made.y_um.iter().copied().fold(f64::MIN, f64::max)
        - made.y_um.iter().copied().fold(f64::MAX, f64::min);
    (made, creep_um)
}

fn candidate(effect: &str, share: f64, p: f64, after: Option<f64>, why: &str) -> CandidateReport {
    CandidateReport {
        effect: effect.into(),
        explained_share: share,
        explained_share_interval: Some(((share - 0.05).max(0.0), (share + 0.04).min(1.0))),
        p_value: Some(p),
        validate_rms_before_um: Some(0.021),
        validate_rms_after_um: after,
        confusable_with: Vec::new(),
        next_experiment: "a step held for ten times the longest time constant".into(),
        why: why.into(),
    }
}

fn step(added: Option<&str>, why: &str, identify_um: f64, validate_um: f64) -> StepReport {
    StepReport {
        added: added.map(str::to_owned),
        why: why.into(),
        identify_rms_um: identify_um,
        validate_rms_um: Some(validate_um),
    }
}

fn demonstration() -> ExplainReport {
    let made = [
        ("stair.csv", "stair", "identify", 7300, 2000.0),
        ("sines.csv", "sines", "identify", 16400, 20000.0),
        ("multi.csv", "sines", "identify", 26200, 20000.0),
        ("hold.csv", "hold", "identify", 7600, 200.0),
        ("rest.csv", "rest", "noise", 12000, 20000.0),
        ("stair2.csv", "stair", "validate", 5500, 2000.0),
        ("validation.csv", "sines", "validate", 15000, 20000.0),
        ("hold2.csv", "hold", "validate", 6000, 200.0),
    ]
    .map(|(name, kind, role, samples, rate_hz)| record(name, kind, role, samples, rate_hz));
    let traces = [7, 3, 0].map(|r| {
        let (record, creep_um) = &made[r];
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let residual_um = &record.residual_um[1];
        let predicted_um: Vec<f64> = (0..creep_um.len())
            .map(|k| creep_um[k] - 0.0079 * (record.y_um[k] - creep_um[k]))
            .collect();
        let (offset, centre) = (mean(residual_um), mean(&predicted_um));
        EvidenceTrace {
            record: r,
            samples: Vec::new(),
            residual_um: residual_um.iter().map(|e| e - offset).collect(),
            predicted_um: predicted_um.iter().map(|p| p - centre).collect(),
        }
    });
    ExplainReport {
        data_set: "demonstration".into(),
        verdict: "named".into(),
        sentence: "The model lacks creep: it explains 92 % of what the residual holds above the noise, and with it the error on records that were never \
                   fitted falls from 21 nm to 5.9 nm."
            .into(),
        named: vec!["creep".into()],
        named_rms_um: None,
        records: made.iter().map(|(r, _)| r.clone()).collect(),
        noise_floor: Some(NoiseFloorReport {
            rms_um: NOISE_UM,
            basis: "the record at rest".into(),
            estimates: vec![
                ("record at rest".into(), NOISE_UM),
                ("repeated periods".into(), 0.0052),
            ],
        }),
        steps: vec![
            step(None, "Started from a gain.", 0.31, 0.33),
            step(
                Some("hysteresis"),
                "The residual forms loops over the drive that differ by branch.",
                0.019,
                0.021,
            ),
            step(
                Some("creep"),
                "After each step the residual goes on with log t.",
                0.0057,
                0.0059,
            ),
        ],
        candidates: vec![
            candidate("creep", 0.92, 0.0002, Some(0.0059), "named: stands apart on this data"),
            candidate("thermal_drift", 0.31, 0.004, Some(0.017), "does not turn with the step"),
            candidate("mains_hum", 0.04, 0.012, Some(0.0208), "real, but small: next in line"),
            candidate("delay", 0.001, 0.8, None, "no phase error at 100 Hz"),
        ],
        evidence: vec![EvidenceReport {
            effect: "creep".into(),
            against: hysteron_sim::effect::Against::TimeHeld,
            caption: "Creep goes on after the drive has stopped.".into(),
            reading_step_um: 0.0,
            traces: traces.to_vec(),
        }],
        replays: vec!["replay of hold2.csv from its first sample to its last (from rest): 6.1 nm RMS, largest 22.0 nm at 1.250 s".into()],
        values: vec![["gain".into(), "gain".into(), "0.1333 um/V".into()]],
        parameters: vec![
            ParameterReport {
                effect: "gain".into(),
                name: "gain".into(),
                value: 0.1333,
                std: Some(2e-5),
                unit: "um/V".into(),
                note: String::new(),
            },
            ParameterReport {
                effect: "creep".into(),
                name: "time_constant".into(),
                value: 1.5,
                std: Some(0.04),
                unit: "s".into(),
                note: String::new(),
            },
        ],
        next_experiment: Some(ExperimentReport {
            why: "Hold two levels for 60 s each: it tells creep from drift with a power of 99 %."
                .into(),
            t_s: (0..1200).map(|k| f64::from(k) * 0.1).collect(),
            u_v: (0..1200).map(|k| if k < 600 { 60.0 } else { 20.0 }).collect(),
        }),
        warnings: vec![
            "The data cannot distinguish rate dependence from vibration below 5 Hz.".into(),
        ],
        program_version: "0.1.0".into(),
        command: "hysteron explain demonstration --report page.html".into(),
    }
}

/// The browser; without one a test reports that and passes, but in CI.
fn browser() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found = ["chromium", "chromium-browser", "google-chrome"]
        .iter()
        .find_map(|name| {
            std::env::split_paths(&folders)
                .map(|folder| folder.join(name))
                .find(|file| file.is_file())
        });
    if found.is_none() {
        assert!(
            std::env::var_os("CI").is_none(),
            "CI needs chromium to look at pages"
        );
        hysteron_tests::skipped("no chromium to look at the page with");
    }
    found
}

/// The document as the browser has it after its scripts have run.
fn document(browser: &Path, page: &Path, fragment: &str) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let name = page.file_name().unwrap_or_default().display();
    let profile = folder.join(format!("profile-{name}"));
    let out = folder.join(format!("document-{name}"));
    let mut child = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--disable-dev-shm-usage",
            "--window-size=1400,1200",
            "--dump-dom",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .arg(format!("file://{}{fragment}", page.display()))
        .stdout(std::fs::File::create(&out).expect("the folder for test files can be written"))
        .stderr(Stdio::null())
        .spawn()
        .expect("the browser starts");
    let started = Instant::now();
    while child
        .try_wait()
        .expect("the browser can be waited for")
        .is_none()
    {
        if started.elapsed() > Duration::from_secs(180) {
            let _ = child.kill();
            let _ = child.wait();
            panic!("the browser did not end within three minutes");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let document = std::fs::read_to_string(&out).expect("the browser wrote the document");
    let _ = std::fs::remove_file(out);
    let _ = std::fs::remove_dir_all(profile);
    document
}

#[test]
fn every_figure_of_an_explanation_is_drawn() {
    let page = explain_page(&demonstration());
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("demonstration.html");
    std::fs::write(&file, page.to_html()).expect("the folder for test files can be written");
    let size = std::fs::metadata(&file).expect("the page is there").len();
    assert!(size < 3_000_000, "the page has {size} bytes");
    let Some(browser) = browser() else {
        return;
    };
    let document = document(&browser, &file, "#record=3&step=1");
    assert!(!document.contains("data-script-error="), "a script failed");
    let drawings = document
        .split("id=\"page-data\"")
        .next()
        .unwrap_or_default();
    let figures = drawings.matches("data-figure=").count();
    assert!(figures >= 15, "{figures} figures");
    assert!(document.contains(&format!("data-drawn=\"{figures}\"")));
    // Curves with a path, in every plot of the chosen record: measured and modelled twice, residuals, drive.
    for (label, least) in [
        ("measured", 2),
        ("modelled", 2),
        ("residual", 3),
        ("drive", 2),
    ] {
        let drawn = drawings
            .split(&format!("data-series=\"{label}\""))
            .skip(1)
            .filter(|rest| {
                rest.split('>')
                    .next()
                    .is_some_and(|tag| tag.contains(" d=\"M"))
            })
            .count();
        assert!(drawn >= least, "{label}: {drawn}");
    }
    assert!(
        !drawings.contains("class=\"empty\""),
        "a plot has nothing to show"
    );
    assert_eq!(
        drawings.matches("data-step=").count(),
        3,
        "one column for each step"
    );
    assert!(
        drawings.contains("class=\"chosen\""),
        "the chosen record is marked in the map"
    );
    assert!(!drawings.contains("NaN"), "a coordinate is not a number");
}

/// What a reader would do, written as a script at the end of the page; the outcome is left on the document's
/// element.
const READER: &str = r##"
const told = document.documentElement.dataset;
const plots = [...document.querySelectorAll(".plot")];
const plot = title => plots.find(p => p.querySelector("h3").textContent === title).querySelector(".surface");
const residual = plot("Residual over time"), drive = plot("Drive over time");
const press = key => residual.dispatchEvent(new KeyboardEvent("keydown", { key }));
const whole = residual.querySelector("svg").outerHTML, wholeDrive = drive.querySelector("svg").outerHTML;
press("+");
told.zoomed = residual.querySelector("svg").outerHTML !== whole;
told.linked = drive.querySelector("svg").outerHTML !== wholeDrive;
residual.dispatchEvent(new MouseEvent("dblclick"));
told.reset = residual.querySelector("svg").outerHTML === whole && drive.querySelector("svg").outerHTML === wholeDrive;
const box = residual.getBoundingClientRect();
residual.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + 400, clientY: box.top + 50 }));
told.read = residual.parentNode.querySelector(".legend b").textContent;
residual.dispatchEvent(new PointerEvent("pointerleave"));
[...document.querySelectorAll("#bar button")].find(b => b.textContent === "+ creep").click();
told.stepped = residual.querySelector("svg").outerHTML !== whole;
const later = residual.querySelector("svg").outerHTML;
document.querySelector("tr[data-row='0']").click();
told.followed = residual.querySelector("svg").outerHTML !== later && document.querySelector("#bar select").selectedIndex === 0;
residual.parentNode.querySelector(".legend button").click();
told.hidden = !residual.querySelector("[data-series]");
"##;

#[test]
fn a_reader_can_zoom_read_and_step_through_the_models() {
    let Some(browser) = browser() else {
        return;
    };
    let html = explain_page(&demonstration()).to_html();
    let html = html.replace("</body>", &format!("<script>{READER}</script></body>"));
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("reader.html");
    std::fs::write(&file, html).expect("the folder for test files can be written");
    let document = document(&browser, &file, "#record=7&step=1");
    let root = document
        .split('>')
        .find(|tag| tag.contains("<html"))
        .unwrap_or_default();
    assert!(!root.contains("data-script-error"), "{root}");
    for outcome in ["zoomed", "linked", "reset", "stepped", "followed", "hidden"] {
        assert!(
            root.contains(&format!("data-{outcome}=\"true\"")),
            "{outcome}: {root}"
        );
    }
    assert!(root.contains("nm\""), "the value under the pointer: {root}");
}

/// Runs where a page takes it for more than text.
const HOSTILE: &str = r#""'><img src="x" onerror="document.documentElement.dataset.ran = 1"><script>document.documentElement.dataset.ran = 1</script>"#;

#[test]
fn no_name_or_sentence_of_a_report_is_run() {
    let Some(browser) = browser() else {
        return;
    };
    let mut report = demonstration();
    let named = |text: &mut String| text.push_str(HOSTILE);
    for text in [
        &mut report.data_set,
        &mut report.sentence,
        &mut report.replays[0],
        &mut report.warnings[0],
        &mut report.command,
        &mut report.program_version,
        &mut report.named[0],
    ] {
        named(text);
    }
    report.values[0].iter_mut().for_each(named);
    report.records.iter_mut().for_each(|r| named(&mut r.name));
    for step in &mut report.steps {
        named(&mut step.why);
        step.added.iter_mut().for_each(named);
    }
    for candidate in &mut report.candidates {
        named(&mut candidate.effect);
        named(&mut candidate.why);
        named(&mut candidate.next_experiment);
    }
    for evidence in &mut report.evidence {
        named(&mut evidence.effect);
        named(&mut evidence.caption);
    }
    for parameter in &mut report.parameters {
        for text in [
            &mut parameter.effect,
            &mut parameter.name,
            &mut parameter.unit,
            &mut parameter.note,
        ] {
            named(text);
        }
    }
    if let Some(floor) = &mut report.noise_floor {
        named(&mut floor.basis);
        named(&mut floor.estimates[0].0);
    }
    if let Some(experiment) = &mut report.next_experiment {
        named(&mut experiment.why);
    }
    let html = explain_page(&report).to_html();
    let ran = |html: &str, name: &str| {
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        std::fs::write(&file, html).expect("the folder for test files can be written");
        let document = document(&browser, &file, "#record=7&step=1");
        assert!(!document.contains("data-script-error="), "a script failed");
        document.contains("data-ran=")
    };
    assert!(!ran(&html, "hostile.html"));
    let unescaped = html.replace("</body>", &format!("{HOSTILE}</body>"));
    assert!(ran(&unescaped, "unescaped.html"), "the text would run");
}

#[test]
fn a_report_with_little_or_odd_data_is_still_a_page() {
    assert!(
        explain_page(&ExplainReport::default())
            .to_html()
            .contains("<h1>")
    );
    let mut odd = demonstration();
    odd.noise_floor = None;
    odd.steps.truncate(1);
    odd.records.truncate(1);
    for record in &mut odd.records {
        record.residual_um = vec![vec![f64::NAN; record.t_s.len()]];
        record.u_v.truncate(5);
    }
    odd.evidence[0].traces[2].samples = vec![1_000_000, 3];
    assert!(
        explain_page(&odd)
            .to_html()
            .contains("this data cannot give one")
    );
}
