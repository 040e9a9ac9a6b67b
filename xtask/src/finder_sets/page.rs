//! The page's session over HTTP, as a browser would ask it.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// `hysteron lab` on a data set; it ends with this value.
struct Lab {
    program: Child,
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

impl Lab {
    fn start(program: &Path, data: &Path) -> Result<Self, String> {
        let mut child = Command::new(program)
            .args(["lab", "--no-open", &data.to_string_lossy()])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("{}: {e}", program.display()))?;
        let mut address = String::new();
        let said = child.stdout.take().ok_or("the lab says nothing")?;
        BufReader::new(said)
            .read_line(&mut address)
            .map_err(|e| format!("the lab's address: {e}"))?;
        let parts = address
            .trim()
            .strip_prefix("http://")
            .and_then(|rest| rest.split_once("/?token="));
        let (host, token) = parts.ok_or_else(|| format!("the lab's address: {address}"))?;
        Ok(Self {
            program: child,
            host: host.to_owned(),
            token: token.to_owned(),
        })
    }

    fn ask(&self, question: &Value) -> Result<Value, String> {
        let told = |e: std::io::Error| format!("the lab: {e}");
        let text = question.to_string();
        let body = [&(text.len() as u64).to_le_bytes(), text.as_bytes()].concat();
        let head = format!(
            "POST /ask?token={}&page=test HTTP/1.0\r\nHost: {}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            self.token,
            self.host,
            body.len()
        );
        let mut stream = TcpStream::connect(&self.host).map_err(told)?;
        stream
            .write_all(&[head.as_bytes(), &body].concat())
            .map_err(told)?;
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).map_err(told)?;
        let body = answer
            .windows(4)
            .position(|w| w == b"\r\n\r\n")
            .map(|at| &answer[at + 4..])
            .ok_or("the lab's answer has no end of its head")?;
        let length: [u8; 8] = body
            .get(..8)
            .and_then(|b| b.try_into().ok())
            .ok_or("the lab's answer is cut off")?;
        let json = body
            .get(8..8 + u64::from_le_bytes(length) as usize)
            .ok_or("the lab's answer is cut off")?;
        let value: Value =
            serde_json::from_slice(json).map_err(|e| format!("the lab's answer: {e}"))?;
        match value.get("error") {
            Some(error) => Err(format!("the lab: {error}")),
            None => Ok(value),
        }
    }
}

/// What the page's session answers to `explain` from a list of effects, as the command line would write it.
pub fn explained(program: &Path, data: &Path, from: &str) -> Result<Value, String> {
    let lab = Lab::start(program, data)?;
    lab.ask(&json!({ "ask": "served" }))?;
    lab.ask(&json!({ "ask": "explain", "from": from }))?;
    let figures = lab.ask(&json!({ "ask": "figures", "seconds": 0.0, "of_search": true }))?;
    let text = figures["text"]
        .as_str()
        .ok_or("the lab's figures hold no text")?;
    serde_json::from_str(text).map_err(|e| format!("the lab's figures: {e}"))
}
