//! Bad input of any kind: one clear message, exit status 2, nothing written.

use crate::common;

use common::{MANIFEST, assert_done, folder_with_model, good_rows, hysteron, says, words};
use hysteron_sim::noise::WhiteNoise;
use std::process::Command;

/// Runs explain on a folder with this manifest and file, and returns what it says.
fn refused(manifest: Option<&str>, rows: &str, expected: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    if let Some(manifest) = manifest {
        std::fs::write(folder.path().join("dataset.toml"), manifest).unwrap();
    }
    std::fs::write(folder.path().join("a.csv"), rows).unwrap();
    let output = hysteron(
        &[
            "explain", ".", "--out", "m.toml", "--json", "m.json", "--report", "m.html",
        ],
        folder.path(),
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    for word in expected {
        assert!(said.contains(word), "expected `{word}` in: {said}");
    }
    for file in ["m.toml", "m.json", "m.html"] {
        assert!(!folder.path().join(file).exists());
    }
}

#[test]
fn cells_that_are_no_numbers() {
    refused(
        Some(MANIFEST),
        &good_rows(100)
            .replace("0.050,", "0.050,NaN,x,")
            .replace("NaN,x,", "NaN"),
        &["a.csv"],
    );
    let mut lines: Vec<String> = good_rows(100).lines().map(String::from).collect();
    lines[40] = "0.039,abc,1.0".into();
    refused(
        Some(MANIFEST),
        &lines.join("\n"),
        &["a.csv", "row 41", "column `u [v]`", "abc"],
    );
    lines[40] = "0.039,NaN,1.0".into();
    refused(
        Some(MANIFEST),
        &lines.join("\n"),
        &["row 41", "column `u [v]`", "finite"],
    );
    lines[40] = "0.039,1.0".into();
    refused(
        Some(MANIFEST),
        &lines.join("\n"),
        &["row 41", "2 cells", "3"],
    );
}

#[test]
fn time_that_does_not_run() {
    let mut lines: Vec<String> = good_rows(100).lines().map(String::from).collect();
    lines[40] = "0.030,1.0,1.0".into();
    refused(
        Some(MANIFEST),
        &lines.join("\n"),
        &["row 41", "does not increase"],
    );
    // Single samples that are missing are bridged; half of the record is not.
    let rows = good_rows(100);
    let without: Vec<&str> = rows
        .lines()
        .enumerate()
        .filter(|(row, _)| !(40..60).contains(row))
        .map(|(_, line)| line)
        .collect();
    refused(
        Some(MANIFEST),
        &without.join("\n"),
        &["row 41", "jumps", "resample"],
    );
}

#[test]
fn records_that_say_nothing() {
    refused(Some(MANIFEST), "", &["a.csv", "empty"]);
    refused(Some(MANIFEST), &good_rows(3), &["a.csv", "3 samples"]);
    let constant: String = std::iter::once("t_s,u_v,y_um\n".to_string())
        .chain(
            (0..100).map(|k| format!("{:.3},1.0,{:.4}\n", f64::from(k) * 1e-3, f64::from(k % 7))),
        )
        .collect();
    // From the virgin state at 0 V a constant 1 V is a step; from rest at 1 V nothing moves.
    refused(
        Some(&MANIFEST.replace("virgin", "settled")),
        &constant,
        &["a.csv", "constant"],
    );
    refused(
        Some(MANIFEST),
        &good_rows(100)
            .replace(",10.00", ",99.00")
            .replace(",9.9", ",99.9"),
        &["drive_max_v"],
    );
}

#[test]
fn manifests_that_are_wrong() {
    refused(None, &good_rows(100), &["dataset.toml"]);
    refused(
        Some(&MANIFEST.replace("sample_rate_hz", "sample_rate_hx")),
        &good_rows(100),
        &["line", "sample_rate_hx", "sample_rate_hz"],
    );
    refused(
        Some(&MANIFEST.replace("a.csv", "b.csv")),
        &good_rows(100),
        &["b.csv", "does not exist"],
    );
    refused(
        Some(&MANIFEST.replace("drive_max_v = 10.0", "drive_max_v = -1.0")),
        &good_rows(100),
        &["drive_max_v"],
    );
    for period in ["nan", "0.0", "-1.0", "1e308"] {
        refused(
            Some(&format!("{MANIFEST}\nperiod_s = {period}\n")),
            &good_rows(100),
            &["period_s"],
        );
    }
}

#[test]
fn effects_that_are_not_known_or_not_in_the_data() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("dataset.toml"), MANIFEST).unwrap();
    std::fs::write(folder.path().join("a.csv"), good_rows(400)).unwrap();
    let output = hysteron(&["explain", ".", "--from", "hysterisis"], folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2));
    assert!(
        said.contains("hysterisis") && said.contains("`hysteresis`"),
        "{said}"
    );
    let output = hysteron(
        &words("identify . --effects gain,load_force --out m.toml"),
        folder.path(),
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("load_force"), "{said}");
    assert!(!folder.path().join("m.toml").exists());
    let output = hysteron(&["compare", "missing.toml", "."], folder.path());
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_reader_that_has_seen_enough_misses_nothing_but_words() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("dataset.toml"), MANIFEST).unwrap();
    std::fs::write(folder.path().join("a.csv"), good_rows(2000)).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(["identify", ".", "--effects", "gain", "--out", "m.toml"])
        .current_dir(folder.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !said.contains("panicked") && output.status.success(),
        "{said}"
    );
    assert!(
        folder.path().join("m.toml").is_file(),
        "the model is written all the same"
    );
}

#[test]
#[cfg(target_os = "linux")]
fn a_screen_that_takes_nothing_is_an_error() {
    let folder = folder_with_model();
    let full = std::fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let said = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .arg("effects")
        .current_dir(folder.path())
        .stdout(full)
        .status()
        .unwrap();
    assert_eq!(said.code(), Some(2));
}

#[test]
fn limits_and_data_sheets_that_cannot_be() {
    let folder = folder_with_model();
    for (line, expected) in [
        ("drive_max_v = inf", "a limit of the drive is inf V"),
        (
            "drive_max_v = 10.0\nsensor_lsb_um = -1.0",
            "sensor_lsb_um = -1; expected a positive number",
        ),
        (
            "drive_max_v = 10.0\nsensor_bandwidth_hz = 0.0",
            "sensor_bandwidth_hz = 0; expected a positive number",
        ),
    ] {
        std::fs::write(
            folder.path().join("dataset.toml"),
            MANIFEST.replace("drive_max_v = 10.0", line),
        )
        .unwrap();
        says(
            &["identify", ".", "--effects", "gain"],
            folder.path(),
            expected,
        );
    }
    // A message is as long as a screen, whatever the file holds.
    std::fs::write(
        folder.path().join("long.csv"),
        format!("{}0.400,1,{}\n", good_rows(400), "x".repeat(100_000)),
    )
    .unwrap();
    let said = hysteron(&["explain", "long.csv"], folder.path()).stderr;
    assert!(
        said.len() < 4000 && String::from_utf8_lossy(&said).contains("characters in all"),
        "{} bytes",
        said.len()
    );
}

#[test]
fn one_file_whose_rest_shows_no_noise_is_explained_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let u = |k: u32| {
        if k < 3000 {
            0.0
        } else {
            5.0 - 5.0 * (f64::from(k - 3000) * 0.05).cos()
        }
    };
    let y = |k: u32| (0.1 * u(k.saturating_sub(1)) / 0.01).round() * 0.01;
    let rows: String = (0..9000)
        .map(|k| format!("{:.3},{:.5},{:.5}\n", f64::from(k) * 1e-3, u(k), y(k)))
        .collect();
    std::fs::write(
        folder.path().join("steps.csv"),
        format!("t_s,u_v,y_um\n{rows}"),
    )
    .unwrap();
    let output = hysteron(
        &["identify", "steps.csv", "--effects", "gain"],
        folder.path(),
    );
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        output.status.success() && said.contains("shows no noise, and is left out"),
        "{said}{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn what_is_said_of_columns_is_one_of_them() {
    let folder = folder_with_model();
    let rows = good_rows(400);
    std::fs::write(
        folder.path().join("twice.csv"),
        rows.replace("t_s,u_v,y_um", "t,ch,ch"),
    )
    .unwrap();
    says(
        &["explain", "twice.csv", "--columns", "u=ch"],
        folder.path(),
        "columns 2 and 3 are called so; expected the number",
    );
    std::fs::write(
        folder.path().join("dataset.toml"),
        format!("{MANIFEST}[record.columns]\nu = -3\n"),
    )
    .unwrap();
    says(
        &["explain", "."],
        folder.path(),
        "expected the name of a column, or its number from 1",
    );
    std::fs::create_dir(folder.path().join("own")).unwrap();
    says(
        &["identify", "twice.csv", "--effects", "own"],
        folder.path(),
        "own: is a folder",
    );
}

#[test]
fn drives_out_of_reach_and_waveforms_without_end() {
    let folder = folder_with_model();
    let loops = [
        "identify",
        ".",
        "--effects",
        "hysteresis",
        "--out",
        "h.toml",
    ];
    assert!(hysteron(&loops, folder.path()).status.success());
    let beyond = |model, out| {
        [
            "simulate",
            model,
            "--drive",
            "triangle:200:60:1",
            "--out",
            out,
        ]
    };
    says(
        &beyond("h.toml", "y.csv"),
        folder.path(),
        "the model holds from 0 to 10 V",
    );
    // All but free surfaces go on beyond what was recorded.
    let goes_on = hysteron(&beyond("m.toml", "beyond.csv"), folder.path());
    let said = String::from_utf8_lossy(&goes_on.stdout).into_owned();
    assert!(
        goes_on.status.success() && said.contains("the band is wider"),
        "{said}"
    );
    for waveform in ["step:1:1e9", "triangle:200:5:0", "step:1:-3"] {
        says(
            &["simulate", "m.toml", "--drive", waveform, "--out", "y.csv"],
            folder.path(),
            "samples long",
        );
    }
    says(
        &words("simulate m.toml --drive sine:-5:1:1:1 --out y.csv"),
        folder.path(),
        "(HZ above 0)",
    );
    says(
        &words("simulate m.toml --drive nowhere.csv --out y.csv"),
        folder.path(),
        "neither a file that exists nor a waveform",
    );
    says(
        &words("simulate m.toml --drive step:nan:1 --out y.csv"),
        folder.path(),
        "`nan` in `step:nan:1` is not a number",
    );
    assert!(!folder.path().join("y.csv").exists());
}

#[test]
fn models_that_were_edited_wrongly() {
    let folder = folder_with_model();
    let model = std::fs::read_to_string(folder.path().join("m.toml")).unwrap();
    let name = model.lines().find(|line| line.starts_with("name")).unwrap();
    let (unit, std) = (
        model.lines().find(|line| line.starts_with("unit")).unwrap(),
        model.lines().find(|line| line.starts_with("std")).unwrap(),
    );
    for (edited, expected) in [
        (
            model.replace(unit, "unit = \"nm/V\""),
            "is given in `nm/V`; expected `um/V`",
        ),
        (
            model.replace(std, "std = -1.0"),
            "std = -1; expected no negative number",
        ),
        (
            model.replace(name, "name = \"g_9_9_um\""),
            "parameter g_9_9_um; expected",
        ),
        (
            model.split("[[effect]]").next().unwrap().to_string(),
            "has no [[effect]]",
        ),
        (
            format!(
                "{model}[[effect]]{}",
                model.split("[[effect]]").nth(1).unwrap()
            ),
            "stands there twice",
        ),
    ] {
        std::fs::write(folder.path().join("edited.toml"), edited).unwrap();
        says(&["compare", "edited.toml", "."], folder.path(), expected);
    }
    says(
        &["add", "gain", "m.toml", ".", "--out", "m2.toml"],
        folder.path(),
        "is in the model already",
    );
    says(
        &["explain", ".", "--from", "m.toml"],
        folder.path(),
        "m.toml: is a model; expected effects. For a model of another recording: hysteron diagnose",
    );
    says(
        &["explain", ".", "--from", "nowhere.txt"],
        folder.path(),
        "nowhere.txt: does not exist",
    );
    // For a model in the place of a servo the message names the schema, not a missing field.
    says(
        &["check", "m.toml", "--model", "m.toml"],
        folder.path(),
        "schema = \"hysteron.model/1\"; expected \"hysteron.servo/",
    );
    std::fs::write(
        folder.path().join("servo.toml"),
        "schema = \"hysteron.servo/1\"\ndelayed = true\n",
    )
    .unwrap();
    says(
        &["compare", "servo.toml", "."],
        folder.path(),
        "schema = \"hysteron.servo/1\"; expected \"hysteron.model/",
    );
    std::fs::write(
        folder.path().join("newer.toml"),
        "schema = \"hysteron.model/9\"\n",
    )
    .unwrap();
    says(
        &["compare", "newer.toml", "."],
        folder.path(),
        "expected \"hysteron.model/1\": a model of another version, which is not read",
    );
    says(
        &["identify", ".", "--effects", "gain,hysteresis"],
        folder.path(),
        "stand in the same place",
    );
}

#[test]
fn a_misspelt_key_is_named_where_another_is_missing() {
    refused(
        Some(&MANIFEST.replace("role", "rool")),
        &good_rows(100),
        &["unknown field `rool`", "did you mean `role`?"],
    );
}

#[test]
fn a_rate_beside_a_drive_of_a_file_is_refused() {
    let folder = folder_with_model();
    says(
        &words("simulate m.toml --drive a.csv --rate-hz 5 --out y.csv"),
        folder.path(),
        "--rate-hz: has no effect for a drive that is a file",
    );
}

#[test]
fn loops_without_an_inverse_are_not_exported_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let overview = hysteron::Overview::without_data(0.0, 100.0);
    let mut model = hysteron::Model::new(0.0, 100.0);
    // Behind a turn the loop first moves against its drive.
    let effect = hysteron::effect_named("bouc_wen").unwrap();
    let values = [9.0, 6.5, 2.7, 0.45];
    model.add(hysteron::EffectInstance::new(effect, &overview, &values));
    let text = hysteron::model_file::to_toml(&model, "loops").unwrap();
    std::fs::write(folder.path().join("m.toml"), text).unwrap();
    says(
        &words("export m.toml --as c --inverse"),
        folder.path(),
        "the loops cannot be inverted: a section has a slope of -0.",
    );
}

#[test]
fn periods_that_do_not_fit_are_refused_and_doubtful_timing_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), good_rows(400)).unwrap();
    std::fs::write(
        folder.path().join("dataset.toml"),
        format!("{MANIFEST}period_s = 100.0\n"),
    )
    .unwrap();
    says(&["explain", "."], folder.path(), "only 0.400 s are left");
    // These rows have y at the instant of u.
    std::fs::write(folder.path().join("dataset.toml"), MANIFEST).unwrap();
    let output = hysteron(&["identify", ".", "--effects", "gain"], folder.path());
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        said.contains("follows u[k] much better than u[k-1], so `hold_before_sample` is used"),
        "{said}"
    );
    let as_said = hysteron(
        &words("identify . --effects gain --timing hold_after_sample"),
        folder.path(),
    );
    let said = String::from_utf8_lossy(&as_said.stdout).into_owned();
    assert!(
        said.contains("If y was read after u was written, specify"),
        "{said}"
    );
    for none in ["0", "-1", "soon", "inf"] {
        says(
            &["explain", ".", &format!("--within={none}")],
            folder.path(),
            "expected a time in seconds above zero",
        );
    }
    says(
        &["identify", ".", "--effects", "gain", "--timing", "now"],
        folder.path(),
        "expected hold_after_sample or hold_before_sample",
    );
}

#[test]
fn a_boot_sector_is_never_written_over_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let key = folder.path().join("update.key");
    let digits = "0123456789abcdef0123456789abcdef";
    std::fs::write(&key, digits).unwrap();
    std::fs::write(folder.path().join("stage"), "no ELF file").unwrap();
    for (out, expected) in [
        ("update.key", "is not written over"),
        ("missing/boot.bin", "does not exist"),
        ("boot.bin", "is no 32-bit ELF file"),
    ] {
        let arguments = [
            "board",
            "boot-sector",
            "stage",
            "--key",
            "update.key",
            "--force",
            "--out",
        ];
        says(&[&arguments[..], &[out]].concat(), folder.path(), expected);
    }
    assert_eq!(std::fs::read_to_string(&key).unwrap(), digits);
}

#[test]
fn a_board_that_is_not_there_or_not_told_enough() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), good_rows(10)).unwrap();
    std::fs::create_dir(folder.path().join("taken")).unwrap();
    std::fs::write(folder.path().join("taken/servo.toml"), "").unwrap();
    // Nobody listens on the first port of the machine.
    let nobody = "127.0.0.1:1";
    for (words, expected) in [
        (&["tune", "out", "--drive-max-v", "80"][..], "--port"),
        (&["tune", "out", "--tcp", nobody], "--drive-max-v"),
        (
            &["tune", "out", "--tcp", nobody, "--drive-max-v", "-5"],
            "-5 is not above",
        ),
        (
            &["tune", "out", "--tcp", nobody, "--drive-max-v", "150"],
            "front end",
        ),
        (
            &["tune", "out", "--tcp", nobody, "--drive-max-v", "80"],
            nobody,
        ),
        // All that can be known without the board is reported without it.
        (
            &[
                "tune",
                "out",
                "--tcp",
                nobody,
                "--drive-max-v",
                "80",
                "--reference-hz",
                "15000",
            ],
            "--reference-hz",
        ),
        (
            &[
                "tune",
                "out",
                "--tcp",
                nobody,
                "--drive-max-v",
                "80",
                "--sensor-bandwidth-hz=50",
            ],
            "--sensor-bandwidth-hz: 50; expected at least 160",
        ),
        (
            &["tune", "taken", "--tcp", nobody, "--drive-max-v", "80"],
            "servo.toml",
        ),
        (
            &["tune", "none/out", "--tcp", nobody, "--drive-max-v", "80"],
            "a folder that exists",
        ),
        (
            &["record", "taken/servo.toml", "--tcp", nobody],
            "servo.toml",
        ),
        (
            &["record", "out", "--tcp", nobody, "--drive-max-v", "-5"],
            "-5 is not above",
        ),
        (&["scope", "--no-open", "--tcp", "nowhere"], "HOST:PORT"),
        (&["status", "--baud", "9600"], "--port"),
        (&["wrong"], "wrong"),
        (&["record", "out", "--tcp", "nowhere"], "nowhere"),
        (
            &["record", "out", "--port", "/dev/no_such_port"],
            "/dev/no_such_port",
        ),
        (&["upload", "a.csv", "--tcp", nobody], "no block"),
        (&["upload", "none.block", "--tcp", nobody], "none.block"),
        (&["status", "--tcp", nobody], nobody),
    ] {
        let output = hysteron(&[&["board"], words].concat(), folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(
            said.contains(expected) && !said.contains("panicked"),
            "{words:?}: expected `{expected}` in: {said}"
        );
        assert!(!folder.path().join("out").exists(), "{words:?}");
    }
}

/// Bytes that a flood has: more than any limit, and an end, so that a program without one would say something
/// else.
const FLOOD_BYTES: usize = 32 << 20;

/// Somebody on a socket who sends these bytes again and again.
fn flood(bytes: &'static [u8]) -> u16 {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let piece = bytes.repeat(4096);
        for _ in 0..FLOOD_BYTES / piece.len() {
            if std::io::Write::write_all(&mut stream, &piece).is_err() {
                break;
            }
        }
    });
    port
}

#[test]
fn a_peer_that_never_ends_a_line_or_an_answer_is_given_up() {
    let folder = tempfile::tempdir().unwrap();
    for (bytes, expected) in [
        (&b"xxxx"[..], "without the end of a line"),
        (b"xxxx \n", "no board does"),
    ] {
        let output = hysteron(
            &[
                "board",
                "status",
                "--tcp",
                &format!("127.0.0.1:{}", flood(bytes)),
            ],
            folder.path(),
        );
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "expected `{expected}` in: {said}");
    }
}

#[test]
fn what_another_program_does_is_told_without_it() {
    let folder = tempfile::tempdir().unwrap();
    // Alone, with nothing beside it or on its path.
    let alone = folder.path().join("hysteron");
    std::fs::copy(env!("CARGO_BIN_EXE_hysteron"), &alone).unwrap();
    let run = |words: &[&str]| {
        // A process that another test starts just now may still hold the copy open for writing.
        let attempts = (0..200).find_map(|_| {
            match std::process::Command::new(&alone)
                .arg("board")
                .args(words)
                .env("PATH", folder.path())
                .output()
            {
                Err(e) if e.kind() == std::io::ErrorKind::ExecutableFileBusy => {
                    std::thread::sleep(std::time::Duration::from_millis(10));
                    None
                }
                ended => Some(ended.unwrap()),
            }
        });
        let output = attempts.expect("the copy can be run");
        (
            output.status.code(),
            String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned(),
        )
    };
    for (words, expected) in [
        (&["flash", "--help"][..], "cargo install --path board/probe"),
        (&["attach", "--probe", "--help"], "debug probe"),
        (&["emulate", "--help"], "cargo xtask board"),
        (&["--help"], "emulate"),
    ] {
        let (status, said) = run(words);
        assert!(
            status == Some(0) && said.contains(expected),
            "{words:?}: {status:?}: {said}"
        );
    }
    for (words, expected) in [
        (&["flash", "a.elf"][..], "cargo install --path board/probe"),
        (&["wrong"], "unrecognized subcommand"),
    ] {
        let (status, said) = run(words);
        assert!(
            status == Some(2) && said.contains(expected),
            "{words:?}: {status:?}: {said}"
        );
    }
    let (_, said) = run(&["status", "--help"]);
    assert!(
        said.contains("[OPTIONS] <--port <PORT>|--tcp <HOST:PORT>>"),
        "{said}"
    );
}

/// Nobody said when the drive of a row acts: a delay that is found says from where it counts, and is silent
/// once that was specified.
#[test]
fn a_delay_says_from_which_drive_it_counts() {
    let folder = tempfile::tempdir().unwrap();
    let drive = |k: usize| {
        5.0 + 2.0 * (0.11 * k as f64).sin()
            + 1.5 * (0.047 * k as f64 + 1.0).sin()
            + (0.29 * k as f64).sin()
    };
    let mut noise = WhiteNoise::new(1.2e-3, 9);
    let mut rows = String::from("t_s,u_v,y_um\n");
    for k in 0..3000_usize {
        let at = |back: usize| {
            if k < 400 + back {
                5.0
            } else {
                drive(k - 400 - back)
            }
        };
        // Three whole periods and two fifths of one late.
        let y_um = 0.5 * (0.6 * at(3) + 0.4 * at(4)) + noise.next_um();
        rows += &format!("{:.4},{:.6},{y_um:.6}\n", k as f64 * 1e-3, at(0));
    }
    std::fs::write(folder.path().join("late.csv"), rows).unwrap();
    let run = |timing: &[&str]| {
        let output = hysteron(
            &[
                &["explain", "late.csv", "--json", "found.json", "--force"],
                timing,
            ]
            .concat(),
            folder.path(),
        );
        assert_done(&output);
        String::from_utf8_lossy(&output.stdout).into_owned()
            + &std::fs::read_to_string(folder.path().join("found.json")).unwrap()
    };
    let (assumed, said) = (run(&[]), run(&["--timing", "hold_after_sample"]));
    assert!(said.contains("\"delay\""), "{said}");
    // In the headline on the screen and in that of the file.
    assert_eq!(
        assumed
            .matches("the delay is one period (1.000 ms) longer")
            .count(),
        2,
        "{assumed}"
    );
    assert!(!said.contains("one period (1.000 ms) longer"), "{said}");
}

/// A recording whose header says no units, with time in microseconds or the reading in metres: what is odd
/// about it is reported, and nothing panics.
#[test]
fn units_that_nobody_said_are_doubted() {
    let folder = tempfile::tempdir().unwrap();
    let mut noise = WhiteNoise::new(1e-3, 4);
    let readings: Vec<(f64, f64)> = (0..4000)
        .map(|k| 5.0 + 2.0 * (0.013 * k as f64).sin() + (0.0047 * k as f64).sin())
        .scan(5.0, |y, u| {
            let read = *y;
            *y += 0.4 * (u - *y);
            Some((u, 0.1 * read + noise.next_um()))
        })
        .collect();
    let rows = |time: f64, length: f64| -> String {
        let row = |(k, (u, y)): (usize, &(f64, f64))| {
            format!("{:.6},{u:.5},{:.9e}\n", k as f64 * time, y * length)
        };
        std::iter::once("t,u,y\n".to_owned())
            .chain(readings.iter().enumerate().map(row))
            .collect()
    };
    std::fs::write(folder.path().join("scope.csv"), rows(50.0, 1.0)).unwrap();
    says(
        &["explain", "scope.csv"],
        folder.path(),
        "samples come 50 s apart; expected at least one a second",
    );
    for (time, length, expected) in [
        (0.05, 1.0, "samples come 0.05 s apart"),
        (5e-5, 1e-6, "the displacement spans"),
    ] {
        std::fs::write(folder.path().join("scope.csv"), rows(time, length)).unwrap();
        let output = hysteron(&["explain", "scope.csv"], folder.path());
        let (said, err) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        assert!(
            output.status.success() && !err.contains("panicked"),
            "{err}"
        );
        assert!(
            said.contains(expected) && said.contains("in another unit?"),
            "{said}"
        );
    }
}

#[test]
fn what_would_be_another_question_than_was_asked_is_refused() {
    let folder = folder_with_model();
    let place = folder.path();
    // A rate that does not show the sine; a model in the place of data; thresholds that are none.
    let drive = [
        "--drive",
        "sine:15000:10:20:0.001",
        "--rate-hz",
        "20000",
        "--out",
        "y.csv",
    ];
    says(
        &[&["simulate", "m.toml"], &drive[..]].concat(),
        place,
        "expected less than half of --rate-hz 20000",
    );
    says(
        &["explain", "m.toml"],
        place,
        "is a file of schema hysteron.model/1, not a data set",
    );
    for policy in [
        "family_wise = 7",
        "matters_at_noise = -4",
        "seen_in_the_noise = nan",
    ] {
        std::fs::write(place.join("policy.toml"), policy).unwrap();
        says(
            &["explain", ".", "--policy", "policy.toml"],
            place,
            "expected a number ",
        );
    }
    // Loops that would go although nobody said so.
    let fitted = hysteron(
        &words("identify . --effects prandtl_ishlinskii --out loops.toml"),
        place,
    );
    assert_done(&fitted);
    says(
        &["add", "bouc_wen", "loops.toml", ".", "--out", "m2.toml"],
        place,
        "would take the place of prandtl_ishlinskii",
    );
    assert!(!place.join("m2.toml").exists() && !place.join("y.csv").exists());
}
