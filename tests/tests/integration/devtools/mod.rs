//! A browser without a window, driven through its tools for developers: real clicks, real drops. The network
//! is off for pages from disk; others reach 127.0.0.1 alone.
//!
//! The protocol (<https://chromedevtools.github.io/devtools-protocol/>) goes over two pipes, one JSON message
//! after another with a zero behind each.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest that anything on the page may take.
const PATIENCE: Duration = Duration::from_secs(180);

/// The browser, where there is one.
pub fn browser() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    ["chromium", "chromium-browser", "google-chrome"]
        .iter()
        .find_map(|name| {
            std::env::split_paths(&folders)
                .map(|folder| folder.join(name))
                .find(|file| file.is_file())
        })
}

/// One page in a browser of its own.
pub struct Page {
    browser: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    last_id: u64,
    session: Option<String>,
    /// Addresses that were asked for.
    pub requests: Vec<String>,
    /// Scripts that failed.
    pub failures: Vec<String>,
}

impl Page {
    /// Opens an address; what the page saves goes into `folder`.
    pub fn open(browser: &Path, address: &str, folder: &Path) -> Self {
        let mut child = Command::new("sh")
            // The browser reads its third file and writes its fourth.
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null"])
            .arg(browser)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--no-first-run",
                "--disable-sync",
            ])
            .args([
                "--disable-background-networking",
                "--disable-component-update",
                "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            ])
            .args(["--remote-debugging-pipe", "--window-size=1400,1000"])
            .arg(format!(
                "--user-data-dir={}",
                folder.join("profile").display()
            ))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the browser starts");
        let (to, from) = (
            child.stdin.take().expect("a pipe"),
            BufReader::new(child.stdout.take().expect("a pipe")),
        );
        let mut page = Self {
            browser: child,
            to,
            from,
            last_id: 0,
            session: None,
            requests: Vec::new(),
            failures: Vec::new(),
        };
        page.send(
            "Browser.setDownloadBehavior",
            &json!({ "behavior": "allow", "downloadPath": folder }),
        );
        let targets = page.send("Target.getTargets", &json!({}));
        let is_page = |target: &&Value| target["type"] == "page";
        let target = targets["targetInfos"]
            .as_array()
            .into_iter()
            .flatten()
            .find(is_page)
            .expect("a page")["targetId"]
            .clone();
        let attached = page.send(
            "Target.attachToTarget",
            &json!({ "targetId": target, "flatten": true }),
        );
        page.session = attached["sessionId"].as_str().map(String::from);
        for domain in ["Page", "Runtime", "Network"] {
            page.send(&format!("{domain}.enable"), &json!({}));
        }
        let off = json!({ "offline": address.starts_with("file:"), "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1 });
        page.send("Network.emulateNetworkConditions", &off);
        page.send("Page.navigate", &json!({ "url": address }));
        page
    }

    /// Sends a command and waits for its result; events on the way are noted.
    pub fn send(&mut self, method: &str, parameters: &Value) -> Value {
        self.last_id += 1;
        let mut message = json!({ "id": self.last_id, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let mut bytes = message.to_string().into_bytes();
        bytes.push(0);
        self.to
            .write_all(&bytes)
            .and_then(|()| self.to.flush())
            .expect("the browser listens");
        loop {
            let mut answer = Vec::new();
            self.from
                .read_until(0, &mut answer)
                .expect("the browser answers");
            assert_eq!(answer.pop(), Some(0), "the browser has ended");
            let mut answer: Value = serde_json::from_slice(&answer).expect("JSON");
            match answer["method"].as_str() {
                Some("Network.requestWillBeSent") => {
                    self.requests.push(
                        answer["params"]["request"]["url"]
                            .as_str()
                            .unwrap_or_default()
                            .to_owned(),
                    );
                }
                Some("Runtime.exceptionThrown") => self
                    .failures
                    .push(answer["params"]["exceptionDetails"].to_string()),
                _ => {}
            }
            if answer["id"] == self.last_id {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].take();
            }
        }
    }

    /// The value of an expression in the page.
    pub fn value(&mut self, expression: &str) -> Value {
        let asked =
            json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut answer = self.send("Runtime.evaluate", &asked);
        assert!(
            answer.get("exceptionDetails").is_none(),
            "{expression}: {answer}"
        );
        answer["result"]["value"].take()
    }

    /// Waits until an expression holds.
    pub fn wait_for(&mut self, expression: &str) {
        let began = Instant::now();
        while self.value(&format!("Boolean({expression})")) != true {
            if began.elapsed() > PATIENCE {
                let state = self.value("JSON.stringify({ ...document.documentElement.dataset })");
                panic!("waited in vain for {expression}; the page says {state}");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn mouse(&mut self, kind: &str, x: f64, y: f64) {
        let buttons = i32::from(kind != "mouseReleased");
        self.send(
            "Input.dispatchMouseEvent",
            &json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1 }),
        );
    }

    /// The box of an element, brought into view: left, top, width, height.
    fn place(&mut self, selector: &str) -> [f64; 4] {
        let script = format!(
            "(() => {{ const e = document.querySelector({selector:?}); if (!e) return null; e.scrollIntoView({{ block: 'center' }}); \
             const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; }})()"
        );
        let found = self.value(&script);
        let number = |i: usize| {
            found[i]
                .as_f64()
                .unwrap_or_else(|| panic!("no element {selector}"))
        };
        [number(0), number(1), number(2), number(3)]
    }

    /// Clicks into the middle of an element.
    pub fn click(&mut self, selector: &str) {
        let [left, top, width, height] = self.place(selector);
        for kind in ["mousePressed", "mouseReleased"] {
            self.mouse(kind, left + width / 2.0, top + height / 2.0);
        }
    }

    /// Takes the handle of a slider in its middle and pulls it by a share of its width, in steps.
    pub fn pull(&mut self, selector: &str, by: f64) {
        let [left, top, width, height] = self.place(selector);
        let (x, y) = (left + width / 2.0, top + height / 2.0);
        self.mouse("mousePressed", x, y);
        for step in 1..=10 {
            self.mouse("mouseMoved", x + by * width * f64::from(step) / 10.0, y);
        }
        self.mouse("mouseReleased", x + by * width, y);
    }

    /// Clicks into a field and types in place of what is there.
    pub fn type_into(&mut self, selector: &str, text: &str) {
        self.click(selector);
        self.value(&format!("document.querySelector({selector:?}).select()"));
        self.send("Input.insertText", &json!({ "text": text }));
    }

    /// Drops files on the page.
    pub fn drop_files(&mut self, files: &[PathBuf]) {
        let data = json!({ "items": [], "files": files, "dragOperationsMask": 1 });
        for kind in ["dragEnter", "dragOver", "drop"] {
            self.send(
                "Input.dispatchDragEvent",
                &json!({ "type": kind, "x": 300, "y": 300, "data": data }),
            );
        }
    }

    /// The text of a file once it has been saved.
    pub fn saved(&mut self, file: &Path) -> String {
        let began = Instant::now();
        while !file.is_file() {
            assert!(
                began.elapsed() < PATIENCE,
                "{} was not saved",
                file.display()
            );
            std::thread::sleep(Duration::from_millis(50));
        }
        std::fs::read_to_string(file).expect("the saved file is text")
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}
