//! `hysteron lab` as a browser and as a stranger meet it: raw requests, and Ctrl-C.
#![cfg(unix)]

use crate::common;

use common::page::Served;
use std::io::Read;
use std::ops::Deref;
use std::path::Path;

/// `hysteron lab` while it serves.
struct Lab(Served);

impl Deref for Lab {
    type Target = Served;

    fn deref(&self) -> &Served {
        &self.0
    }
}

fn started(arguments: &[&str], folder: &Path) -> Lab {
    Lab(Served::started(
        &[&["lab", "--no-open"], arguments].concat(),
        folder,
    ))
}

impl Lab {
    fn question(&self, json: &str) -> String {
        let body = [&(json.len() as u64).to_le_bytes(), json.as_bytes()].concat();
        let (status, text) = self.asked(
            "POST",
            &self.path("/ask"),
            &[("Origin", &format!("http://{}", self.host))],
            &body,
        );
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
    assert!(
        status == 200 && text.contains("<title>Hysteron lab</title>"),
        "{status}"
    );

    let port = lab.host.rsplit(':').next().unwrap();
    let wrong_token = "/?token=00000000000000000000000000000000";
    for (path, headers, why) in [
        ("/", vec![], "token"),
        (wrong_token, vec![], "token"),
        (
            page.as_str(),
            vec![("Host", format!("attacker.example:{port}"))],
            "host",
        ),
        (
            page.as_str(),
            vec![("Origin", "http://attacker.example".to_owned())],
            "origin",
        ),
        (page.as_str(), vec![("Origin", "null".to_owned())], "origin"),
        (
            page.as_str(),
            vec![("Origin", format!("http://localhost:{port}"))],
            "origin",
        ),
        (
            page.as_str(),
            vec![("Sec-Fetch-Site", "cross-site".to_owned())],
            "site",
        ),
    ] {
        for (method, path) in [
            ("GET", path.to_owned()),
            ("POST", path.replacen('/', "/ask", 1)),
        ] {
            let headers: Vec<(&str, &str)> = headers
                .iter()
                .map(|(name, value)| (*name, value.as_str()))
                .collect();
            let (status, text) = lab.asked(method, &path, &headers, b"");
            assert!(
                status == 403 && text.contains("refused: ") && text.contains(why),
                "{method} {path} {headers:?}: {text}"
            );
        }
    }

    assert!(lab.question(r#"{"ask":"begin"}"#).contains(r#""name":".""#));
    let read = lab.question(r#"{"ask":"served"}"#);
    assert!(
        read.contains(r#""name":"lag""#) && read.contains(r#""role":"validate""#),
        "{read}"
    );
    let fitted = lab.question(r#"{"ask":"identify","effects":"gain"}"#);
    assert!(fitted.contains(r#""id":"gain""#), "{fitted}");
    let (_, steps) = lab.asked("GET", &lab.path("/progress"), &[], b"");
    assert!(steps.contains("fitting"), "{steps}");
    assert_eq!(lab.asked("GET", &lab.path("/nothing"), &[], b"").0, 404);
}

#[test]
fn ctrl_c_ends_it_and_what_cannot_be_read_is_said_before() {
    let folder = common::folder_to_search();
    common::says(
        &["lab", "--no-open", "nowhere.csv"],
        folder.path(),
        "nowhere.csv: does not exist",
    );
    let mut lab = started(&[], folder.path());
    assert!(common::interrupted(&lab.program));
    assert_eq!(lab.0.program.wait().unwrap().code(), Some(0));
    let mut rest = String::new();
    lab.0.said.read_to_string(&mut rest).unwrap();
    assert!(rest.contains("Ctrl-C"), "{rest}");
}
