//! `hysteron lab` as a browser and as a stranger meet it: raw requests, and Ctrl-C.
#![cfg(unix)]

mod common;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

/// The program while it serves; it does not outlive its test.
struct Lab {
    program: Child,
    said: BufReader<ChildStdout>,
    host: String,
    token: String,
}

impl Drop for Lab {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn started(arguments: &[&str], folder: &Path) -> Lab {
    let mut program = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(["lab", "--no-open"])
        .args(arguments)
        .current_dir(folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(program.stdout.take().unwrap());
    let mut address = String::new();
    said.read_line(&mut address).unwrap();
    let (host, token) = address.trim().strip_prefix("http://").and_then(|rest| rest.split_once("/?token=")).expect("an address");
    let (host, token) = (host.to_owned(), token.to_owned());
    Lab { program, said, host, token }
}

impl Lab {
    /// The status of an answer and its text. Without a header of its own a request names the right host.
    fn asked(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        if !headers.iter().any(|(name, _)| *name == "Host") {
            head.push_str(&format!("Host: {}\r\n", self.host));
        }
        headers.iter().for_each(|(name, value)| head.push_str(&format!("{name}: {value}\r\n")));
        stream.write_all(&[head.as_bytes(), b"\r\n", body].concat()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let text = String::from_utf8_lossy(&answer).into_owned();
        (text.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status"), text)
    }

    fn path(&self, path: &str) -> String {
        format!("{path}?token={}&page=test", self.token)
    }

    fn question(&self, json: &str) -> String {
        let body = [&(json.len() as u64).to_le_bytes(), json.as_bytes()].concat();
        let (status, text) = self.asked("POST", &self.path("/ask"), &[("Origin", &format!("http://{}", self.host))], &body);
        assert_eq!(status, 200, "{text}");
        text
    }
}

#[test]
fn strangers_are_refused_and_the_data_set_is_at_hand() {
    let folder = common::folder_to_search();
    let lab = started(&["."], folder.path());
    assert!(lab.host.starts_with("127.0.0.1:"), "{}", lab.host);
    assert_eq!(lab.token.len(), 32);
    let page = lab.path("/");
    let (status, text) = lab.asked("GET", &page, &[], b"");
    assert!(status == 200 && text.contains("<title>Hysteron lab</title>"), "{status}");

    let port = lab.host.rsplit(':').next().unwrap();
    let wrong_token = "/?token=00000000000000000000000000000000";
    for (path, headers, why) in [
        ("/", vec![], "token"),
        (wrong_token, vec![], "token"),
        (page.as_str(), vec![("Host", format!("attacker.example:{port}"))], "host"),
        (page.as_str(), vec![("Origin", "http://attacker.example".to_owned())], "origin"),
        (page.as_str(), vec![("Origin", "null".to_owned())], "origin"),
        (page.as_str(), vec![("Origin", format!("http://localhost:{port}"))], "origin"),
        (page.as_str(), vec![("Sec-Fetch-Site", "cross-site".to_owned())], "site"),
    ] {
        for (method, path) in [("GET", path.to_owned()), ("POST", path.replacen('/', "/ask", 1))] {
            let headers: Vec<(&str, &str)> = headers.iter().map(|(name, value)| (*name, value.as_str())).collect();
            let (status, text) = lab.asked(method, &path, &headers, b"");
            assert!(status == 403 && text.contains("refused: ") && text.contains(why), "{method} {path} {headers:?}: {text}");
        }
    }

    assert!(lab.question(r#"{"ask":"begin"}"#).contains(r#""name":".""#));
    let read = lab.question(r#"{"ask":"served"}"#);
    assert!(read.contains(r#""name":"lag""#) && read.contains(r#""role":"validate""#), "{read}");
    let fitted = lab.question(r#"{"ask":"identify","effects":"gain"}"#);
    assert!(fitted.contains(r#""id":"gain""#), "{fitted}");
    let (_, steps) = lab.asked("GET", &lab.path("/progress"), &[], b"");
    assert!(steps.contains("fitting"), "{steps}");
    assert_eq!(lab.asked("GET", &lab.path("/nothing"), &[], b"").0, 404);
}

#[test]
fn ctrl_c_ends_it_and_what_cannot_be_read_is_said_before() {
    let folder = common::folder_to_search();
    common::says(&["lab", "--no-open", "nowhere.csv"], folder.path(), "nowhere.csv: does not exist");
    let mut lab = started(&[], folder.path());
    assert!(common::interrupted(&lab.program));
    assert_eq!(lab.program.wait().unwrap().code(), Some(0));
    let mut rest = String::new();
    lab.said.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("Ctrl-C"), "{rest}");
}
