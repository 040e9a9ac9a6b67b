//! The program while it serves a page, and raw requests to it.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

/// The program while it serves; it does not outlive its test.
pub struct Served {
    pub program: Child,
    /// What it says behind its address.
    pub said: BufReader<ChildStdout>,
    pub host: String,
    pub token: String,
}

impl Drop for Served {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

impl Served {
    /// Starts it and reads its address.
    pub fn started(arguments: &[&str], folder: &Path) -> Self {
        Self::started_with(arguments, folder, Stdio::inherit())
    }

    /// The same; what it says of troubles is kept for the test.
    pub fn started_quietly(arguments: &[&str], folder: &Path) -> Self {
        Self::started_with(arguments, folder, Stdio::piped())
    }

    fn started_with(arguments: &[&str], folder: &Path, troubles: Stdio) -> Self {
        let mut program = Command::new(env!("CARGO_BIN_EXE_hysteron"));
        let mut program = program
            .args(arguments)
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(troubles)
            .spawn()
            .unwrap();
        let mut said = BufReader::new(program.stdout.take().unwrap());
        let mut address = String::new();
        said.read_line(&mut address).unwrap();
        let (host, token) = address
            .trim()
            .strip_prefix("http://")
            .and_then(|rest| rest.split_once("/?token="))
            .expect("an address");
        let (host, token) = (host.to_owned(), token.to_owned());
        Self {
            program,
            said,
            host,
            token,
        }
    }

    /// The status of an answer and its text. Without a header of its own a request names the right host.
    pub fn asked(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        let mut head = format!(
            "{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n",
            body.len()
        );
        if !headers.iter().any(|(name, _)| *name == "Host") {
            head.push_str(&format!("Host: {}\r\n", self.host));
        }
        headers
            .iter()
            .for_each(|(name, value)| head.push_str(&format!("{name}: {value}\r\n")));
        stream
            .write_all(&[head.as_bytes(), b"\r\n", body].concat())
            .unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let text = String::from_utf8_lossy(&answer).into_owned();
        (
            text.split(' ')
                .nth(1)
                .and_then(|status| status.parse().ok())
                .expect("a status"),
            text,
        )
    }

    /// A path with the token and the name of a page.
    pub fn path(&self, path: &str) -> String {
        format!("{path}?token={}&page=test", self.token)
    }
}

/// What stands behind the headers of an answer of plain letters; long ones come in pieces, each behind its
/// length (RFC 9112, 7.1).
pub fn body(answer: &str) -> String {
    let (headers, mut rest) = answer.split_once("\r\n\r\n").expect("headers");
    if !headers
        .to_ascii_lowercase()
        .contains("transfer-encoding: chunked")
    {
        return rest.to_owned();
    }
    let mut whole = String::new();
    while let Some((length, behind)) = rest.split_once("\r\n") {
        let length = usize::from_str_radix(length, 16).expect("a length");
        whole.push_str(&behind[..length]);
        rest = behind[length..].trim_start();
        if length == 0 {
            break;
        }
    }
    whole
}
