//! `hysteron board scope` in front of a simulated board: what its page receives, what strangers receive, and
//! what the board receives.
#![cfg(unix)]

use crate::common::{self, assert_done, words};

use common::page::{Served, body};
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::guard::Fault;
use hysteron_core::trace_frame::TraceSample;
use hysteron_protocol::code_lines::{SAMPLES_IN_LINE, write_line};
use serde_json::Value;
use std::f64::consts::TAU;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// The sine of the simulated board.
const SINE_HZ: f64 = 750.0;
const RATE_HZ: f64 = 20_000.0;
/// Its sensor: 15 um over 65,536 codes from -1 um; its drive: 140 V from -20 V.
const SPANS: [f64; 4] = [-1.0, 15.0, -20.0, 140.0];

/// What the board is like, and what it received.
#[derive(Default)]
struct Like {
    mode: u8,
    fault: u8,
    told: Vec<String>,
    /// Samples of its recorder; none: as many as the larger board has.
    room: Option<usize>,
    /// The error that the next `ERR?` tells: a stop leaves 10.
    error: u8,
    line: Option<TcpStream>,
}

type Shared = Arc<Mutex<Like>>;

/// Sample `k` of what the recorder caught.
fn caught(k: usize) -> TraceSample {
    let phase = TAU * SINE_HZ * k as f64 / RATE_HZ;
    let position_um = 5.0 + 0.4 * phase.sin();
    let drive_v = 40.0 + 3.0 * phase.cos();
    TraceSample {
        adc_code: SensorCode::new(((position_um - SPANS[0]) / SPANS[1] * 65_536.0).round() as u32),
        dac_code: DriveCode::new(((drive_v - SPANS[2]) / SPANS[3] * 65_536.0).round() as u32),
        ..TraceSample::default()
    }
}

/// The last two words of a question as numbers.
fn first_and_count(line: &str) -> (usize, usize) {
    let numbers: Vec<usize> = line
        .split(' ')
        .skip(1)
        .map(|word| word.parse().unwrap())
        .collect();
    (numbers[0] - 1, numbers[1])
}

/// What it answers a line, as the board's manual has it.
fn answer(like: &Like, line: &str) -> Vec<u8> {
    let (mode, fault, room) = (like.mode, like.fault, like.room.unwrap_or(16_384));
    let text = match line.split(' ').next().unwrap_or_default() {
        "*IDN?" => "(c)2026 Hysteron, HYSTERON, 0, 0.1.0\n".into(),
        "ERR?" => format!("{}\n", like.error),
        "DIA?" if line == "DIA? 1 2 10" => format!("1={mode} \n2={fault} \n10=4000\n"),
        "DIA?" => format!("1={mode} \n2={fault} \n3=17 \n4=0\n"),
        "HDI?" => "#Diagnosis \n1=mode \n2=fault \n3=ticks at the sensor's limits \n4=ticks that came late \nend of help\n".into(),
        "CST?" => "1=P753\n".into(),
        "POS?" => "1=5.125000\n".into(),
        "VOL?" => "1=41.500000\n".into(),
        "MOV?" => "1=5.000000\n".into(),
        "ATZ?" => "1=1\n".into(),
        "SVO?" => format!("1={}\n", u8::from(mode == 2)),
        "SPA?" => format!(
            "1 0=-1 \n1 1=15 \n1 2=-20 \n1 3=140 \n1 4=0 \n1 5=100 \n1 6={:.9} \n1 7=4096 \n1 8={} \n1 9=4 \n1 10=16 \n1 11=16\n",
            1.0 / RATE_HZ,
            4 * room
        ),
        "DRL?" => format!("1={}\n", room.min(16_000)),
        "DRR?" => {
            let (_, count) = first_and_count(line);
            let values = vec!["5.000000"; count].join(" \n");
            format!("# REM Hysteron \n# END_HEADER \n{values}\n")
        }
        "DRB?" => {
            let (first, count) = first_and_count(line);
            let starts: Vec<usize> = (first..first + count).step_by(SAMPLES_IN_LINE as usize).collect();
            let mut bytes = Vec::new();
            for (nth, start) in starts.iter().enumerate() {
                let mut piece = hysteron_protocol::session::Piece::new();
                let end = (start + SAMPLES_IN_LINE as usize).min(first + count);
                write_line((*start..end).map(caught), &mut piece).unwrap();
                bytes.extend_from_slice(&piece);
                bytes.extend_from_slice(if nth + 1 < starts.len() { b" \n" } else { b"\n" });
            }
            return bytes;
        }
        _ => String::new(),
    };
    text.into_bytes()
}

/// Answers programs one after the other, on a free port, which it returns.
fn board(like: &Shared) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let like = Arc::clone(like);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            like.lock().unwrap().line = stream.try_clone().ok();
            let _ = converse(&like, stream);
        }
    });
    port
}

fn converse(like: &Shared, mut stream: TcpStream) -> std::io::Result<()> {
    let bytes = BufReader::new(stream.try_clone()?).bytes();
    let mut line = String::new();
    for byte in bytes {
        match byte? {
            0x18 => {
                let mut like = like.lock().unwrap();
                like.told.push("STOP".into());
                (like.mode, like.error) = (0, 10);
            }
            b'\n' => {
                let mut like = like.lock().unwrap();
                if !line.is_empty() && !line.split(' ').next().unwrap_or_default().ends_with('?') {
                    like.told.push(line.clone());
                }
                stream.write_all(&answer(&like, &line))?;
                if line == "ERR?" {
                    like.error = 0;
                }
                line.clear();
            }
            other => line.push(char::from(other)),
        }
    }
    Ok(())
}

fn started(port: u16, folder: &Path) -> Served {
    Served::started(
        &[
            "board",
            "scope",
            "--no-open",
            "--tcp",
            &format!("127.0.0.1:{port}"),
        ],
        folder,
    )
}

/// Asks for the state until it is as wanted.
fn state_when(scope: &Served, wanted: impl Fn(&Value) -> bool) -> Value {
    loop {
        let (status, text) = scope.asked("GET", &scope.path("/state"), &[], b"");
        assert_eq!(status, 200, "{text}");
        let state: Value = serde_json::from_str(&body(&text)).unwrap();
        if wanted(&state) {
            return state;
        }
        std::thread::yield_now();
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect()
}

#[test]
fn a_board_with_a_short_recorder_is_watched_as_far_as_it_goes() {
    let like = Shared::new(Mutex::new(Like {
        room: Some(512),
        ..Like::default()
    }));
    let folder = tempfile::tempdir().unwrap();
    let scope = started(board(&like), folder.path());
    let state = state_when(&scope, |state| state["block"].is_object());
    assert_eq!(
        numbers(&state["block"]["position_um"]).len(),
        511,
        "the window has 4096"
    );
}

#[test]
fn a_sine_is_where_it_is_in_time_and_frequency_and_the_file_is_a_recording() {
    let like = Shared::new(Mutex::new(Like {
        mode: 2,
        ..Like::default()
    }));
    let folder = tempfile::tempdir().unwrap();
    let scope = started(board(&like), folder.path());
    let state = state_when(&scope, |state| state["block"].is_object());
    assert_eq!(
        (
            state["board"]["mode"].as_str(),
            state["board"]["stage"].as_str()
        ),
        (Some("closed loop"), Some("P753"))
    );
    assert_eq!(
        state["board"]["counts"][0],
        serde_json::json!(["ticks at the sensor's limits", 17.0])
    );

    let block = &state["block"];
    let (position, error) = (numbers(&block["position_um"]), numbers(&block["error_um"]));
    assert_eq!(
        (position.len(), block["sample_rate_hz"].as_f64()),
        (4095, Some(RATE_HZ))
    );
    // What the recorder read at a tick belongs to the drive of the tick before; half a step of the
    // converters.
    for (k, (y, e)) in position.iter().zip(&error).enumerate() {
        let true_um = 5.0 + 0.4 * (TAU * SINE_HZ * (k + 1) as f64 / RATE_HZ).sin();
        assert!(
            (y - true_um).abs() < 2e-4 && (e - (5.0 - true_um)).abs() < 2e-4,
            "{k}: {y} {e}"
        );
    }
    for spectrum in ["position_spectrum", "error_spectrum"] {
        let (hz, density) = (
            numbers(&block[spectrum]["frequency_hz"]),
            numbers(&block[spectrum]["density_nm"]),
        );
        let top = (0..density.len())
            .max_by(|a, b| density[*a].total_cmp(&density[*b]))
            .unwrap();
        assert!(
            (hz[top] / SINE_HZ - 1.0).abs() < 0.03,
            "{spectrum}: {} Hz",
            hz[top]
        );
    }

    // Blocks may come and go faster than they are looked at: hold one that is still there.
    let number = loop {
        let state = state_when(&scope, |state| state["block"].is_object());
        let newest = state["block"]["number"].as_u64().unwrap();
        let (status, _) = scope.asked(
            "POST",
            &format!("{}&block={newest}", scope.path("/hold")),
            &[],
            b"",
        );
        if status == 200 {
            break newest;
        }
        assert_eq!(status, 404);
    };
    let save = format!("{}&block={number}", scope.path("/save"));
    // Held, it is there however many blocks come after it.
    state_when(&scope, |state| {
        state["block"]["number"].as_u64() > Some(number + 6)
    });
    let (status, text) = scope.asked("GET", &save, &[], b"");
    assert_eq!(status, 200, "{text}");
    let file = body(&text);
    assert!(
        file.contains("# (c)2026 Hysteron") && file.contains("t_s,u_v,y_um,reference_um"),
        "{}",
        &file[..200]
    );
    std::fs::write(folder.path().join("block.csv"), file).unwrap();
    let output = common::hysteron(
        &words("identify block.csv --effects gain --json fit.json --out m.toml"),
        folder.path(),
    );
    assert_done(&output);
    let missing = format!("{}&block=999999", scope.path("/save"));
    assert_eq!(scope.asked("GET", &missing, &[], b"").0, 404);

    // Nothing but what a recording needs.
    let allowed = ["DRC 1 1 1", "RTR 1", "DRT 0 4 0", "DRT 0 0 0"];
    assert!(
        like.lock()
            .unwrap()
            .told
            .iter()
            .all(|line| allowed.contains(&line.as_str())),
        "{:?}",
        like.lock().unwrap().told
    );
}

#[test]
fn a_fault_is_told_in_words_a_board_that_goes_comes_back_and_stop_is_sent() {
    let like = Shared::new(Mutex::new(Like {
        mode: 3,
        fault: Fault::TrackingError as u8,
        ..Like::default()
    }));
    let folder = tempfile::tempdir().unwrap();
    let scope = started(board(&like), folder.path());
    let state = state_when(&scope, |state| state["board"].is_object());
    assert_eq!(state["board"]["fault"], "tracking error");
    assert!(
        state["board"]["what_to_do"]
            .as_str()
            .unwrap()
            .contains("did not follow"),
        "{state}"
    );
    let state = state_when(&scope, |state| state["block"].is_object());
    assert!(
        state["block"]["error_um"].is_null(),
        "without a servo there is no error"
    );

    // It goes away in the middle of whatever is being said, and is met again.
    let line = like.lock().unwrap().line.take().unwrap();
    line.shutdown(Shutdown::Both).unwrap();
    let gone = state_when(&scope, |state| state["connected"] == false);
    assert!(
        gone["trouble"].as_str().unwrap().contains("connection"),
        "{gone}"
    );
    let last = gone["block"]["number"].as_u64().unwrap();
    state_when(&scope, |state| {
        state["connected"] == true && state["block"]["number"].as_u64() > Some(last)
    });

    // STOP needs the token, the method and this origin.
    for (method, path, headers, status) in [
        ("POST", "/stop".to_owned(), vec![], 403),
        (
            "POST",
            scope.path("/stop"),
            vec![("Origin", "http://attacker.example")],
            403,
        ),
        (
            "POST",
            scope.path("/stop"),
            vec![("Host", "attacker.example")],
            403,
        ),
        ("GET", scope.path("/stop"), vec![], 405),
        (
            "POST",
            format!("{}&window=99", scope.path("/window")),
            vec![],
            400,
        ),
        (
            "POST",
            format!("{}&block=-1", scope.path("/hold")),
            vec![],
            404,
        ),
        ("GET", scope.path("/nothing"), vec![], 404),
    ] {
        assert_eq!(
            scope.asked(method, &path, &headers, b"").0,
            status,
            "{method} {path}"
        );
    }
    assert!(!like.lock().unwrap().told.iter().any(|line| line == "STOP"));
    let stops = |like: &Shared| {
        like.lock()
            .unwrap()
            .told
            .iter()
            .filter(|line| *line == "STOP")
            .count()
    };
    for nth in 1..=20 {
        assert_eq!(scope.asked("POST", &scope.path("/stop"), &[], b"").0, 200);
        while stops(&like) < nth {
            std::thread::yield_now();
        }
    }
    // The board is not taken for lost because it says that it was stopped.
    let mut last =
        state_when(&scope, |state| state["board"]["mode"] == "rest")["block"]["number"].as_u64();
    for _ in 0..20 {
        let state = state_when(&scope, |state| {
            state["connected"] == false || state["block"]["number"].as_u64() > last
        });
        assert_eq!(state["connected"], true, "{state}");
        last = state["block"]["number"].as_u64();
    }
}

#[test]
fn only_this_machine_is_served_and_ctrl_c_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    common::says(
        &words("board scope --no-open --tcp 127.0.0.1:1 --listen 0.0.0.0:0"),
        folder.path(),
        "other machines",
    );
    common::says(
        &words("board scope --no-open --tcp 127.0.0.1:1 --listen here"),
        folder.path(),
        "--listen",
    );
    // No board is there at all: the page reports it, and STOP that it was not sent.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let free = listener.local_addr().unwrap().port();
    drop(listener);
    let mut scope = started(free, folder.path());
    let state = state_when(&scope, |state| state["trouble"] != "");
    assert!(
        state["connected"] == false && state["board"].is_null(),
        "{state}"
    );
    // What is no request, or half of one, keeps nobody else waiting.
    let strangers: Vec<TcpStream> = [
        &b"\xff\x00 nonsense\r\n\r\n"[..],
        b"GET / HT",
        b"POST /stop HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n",
    ]
    .iter()
    .map(|bytes| {
        let mut stream = TcpStream::connect(&scope.host).unwrap();
        stream.write_all(bytes).unwrap();
        stream
    })
    .collect();
    for _ in 0..50 {
        state_when(&scope, |_| true);
    }
    let (status, text) = scope.asked("POST", &scope.path("/stop"), &[], b"");
    drop(strangers);
    assert!(status == 503 && text.contains("emergency stop"), "{text}");
    assert!(common::interrupted(&scope.program));
    assert_eq!(scope.program.wait().unwrap().code(), Some(0));
    let mut rest = String::new();
    scope.said.read_line(&mut rest).unwrap();
    assert!(rest.contains("Ctrl-C"), "{rest}");
}

#[test]
fn a_board_that_does_not_answer_is_said_on_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    // Nobody listens on the first port of the machine.
    let mut scope = Served::started_quietly(
        &["board", "scope", "--no-open", "--tcp", "127.0.0.1:1"],
        folder.path(),
    );
    state_when(&scope, |state| {
        state["trouble"]
            .as_str()
            .is_some_and(|text| !text.is_empty())
    });
    assert!(common::interrupted(&scope.program));
    let mut said = String::new();
    scope
        .program
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut said)
        .unwrap();
    assert!(
        said.starts_with("127.0.0.1:1: nobody answers there") && said.contains("asked again"),
        "{said}"
    );
}
