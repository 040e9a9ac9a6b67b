//! The native engine behind the lab page: the page itself and a session for every page that is open, on 127.0.0.1.
//!
//! A request is answered only if it comes from the page: it must name this server as its host (so that no other name can be made to point
//! here), must not come from another origin, and must carry the token of the address. Every question has a thread; those of one page wait for
//! each other. A search is watched and taken back by requests beside it.

use crate::Session;
use crate::answers::Answer;
use crate::asker::Asker;
use crate::served::Served;
use hysteron::{Error, Result};
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use tiny_http::{Header, Method, Request, Response};

/// Pages whose data and models are kept; the one that was quiet for longest is forgotten first.
const PAGES_MAX: usize = 4;

/// A lock, whoever broke off while holding it: what it guards is replaced whole.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// One page that is open.
#[derive(Default)]
struct Desk {
    session: Mutex<Session>,
    steps: Mutex<Vec<String>>,
    taken_back: AtomicBool,
}

impl Asker for Desk {
    fn tell(&self, step: &str) {
        locked(&self.steps).push(step.to_owned());
    }

    fn has_left(&self) -> bool {
        self.taken_back.load(Ordering::SeqCst)
    }
}

/// Serves the lab page until it is told to end.
pub struct Server {
    http: tiny_http::Server,
    host: String,
    token: String,
    page: String,
    served: Option<Arc<dyn Served>>,
    desks: Mutex<Vec<(String, Arc<Desk>)>>,
    ended: AtomicBool,
}

impl Server {
    /// Takes a free port of 127.0.0.1.
    ///
    /// # Errors
    /// When there is no port, or the system has no random numbers for the token.
    pub fn bind(served: Option<Arc<dyn Served>>) -> Result<Self> {
        let wrong = |what: String| Error::new("lab", what);
        let http = tiny_http::Server::http("127.0.0.1:0").map_err(|e| wrong(format!("no port of 127.0.0.1 can be taken: {e}")))?;
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|e| wrong(format!("the system gives no random numbers for a token: {e}")))?;
        Ok(Self {
            host: http.server_addr().to_string(),
            http,
            token: random.iter().map(|byte| format!("{byte:02x}")).collect(),
            page: hysteron_page::served().map_err(wrong)?,
            served,
            desks: Mutex::default(),
            ended: AtomicBool::new(false),
        })
    }

    /// The address of the page, with its token.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://{}/?token={}", self.host, self.token)
    }

    /// Answers requests until [`Self::end`].
    pub fn serve(self: &Arc<Self>) {
        while !self.ended.load(Ordering::SeqCst) {
            if let Ok(request) = self.http.recv() {
                let server = Arc::clone(self);
                std::thread::spawn(move || server.answer(request));
            }
        }
    }

    /// Ends [`Self::serve`], and searches that go on at their next step.
    pub fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        locked(&self.desks).iter().for_each(|(_, desk)| desk.taken_back.store(true, Ordering::SeqCst));
        self.http.unblock();
    }

    fn answer(&self, mut request: Request) {
        let (status, kind, bytes) = match self.refusal(&request) {
            Some(why) => (403, "text/plain; charset=utf-8", format!("refused: {why}\n").into_bytes()),
            None => self.route(&mut request),
        };
        let headers = [
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("Content-Security-Policy", "frame-ancestors 'none'"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
        ];
        let headers = headers.iter().filter_map(|(name, value)| Header::from_bytes(name.as_bytes(), value.as_bytes()).ok());
        let response = headers.fold(Response::from_data(bytes).with_status_code(status), Response::with_header);
        // A page that was closed in the meantime needs no answer.
        let _ = request.respond(response);
    }

    /// Why a request is not answered.
    fn refusal(&self, request: &Request) -> Option<&'static str> {
        let header = |name: &'static str| request.headers().iter().find(|h| h.field.equiv(name)).map(|h| h.value.as_str());
        let from_elsewhere = |site: &str| !matches!(site, "same-origin" | "none");
        if header("Host") != Some(self.host.as_str()) {
            Some("it was meant for another host")
        } else if header("Origin").is_some_and(|origin| origin.strip_prefix("http://") != Some(self.host.as_str())) {
            Some("it comes from another origin")
        } else if header("Sec-Fetch-Site").is_some_and(from_elsewhere) {
            Some("it comes from another site; type the address that `hysteron lab` has written")
        } else if parameter(request.url(), "token") != Some(self.token.as_str()) {
            Some("the token is missing or wrong; use the address that `hysteron lab` has written")
        } else {
            None
        }
    }

    fn route(&self, request: &mut Request) -> (u16, &'static str, Vec<u8>) {
        const JSON: &str = "application/json";
        let url = request.url().to_owned();
        let path = url.split('?').next().unwrap_or_default();
        let page = parameter(&url, "page").unwrap_or_default();
        match (&request.method().clone(), path) {
            (Method::Get, "/") => (200, "text/html; charset=utf-8", self.page.clone().into_bytes()),
            (Method::Get, "/example") => {
                let files: serde_json::Map<String, serde_json::Value> =
                    hysteron_page::EXAMPLE.iter().map(|(name, text)| ((*name).into(), json!(text))).collect();
                (200, JSON, json!(files).to_string().into_bytes())
            }
            (Method::Get, "/progress") => {
                let steps = self.desk(page).map(|desk| std::mem::take(&mut *locked(&desk.steps))).unwrap_or_default();
                (200, JSON, format!("[{}]", steps.join(",")).into_bytes())
            }
            (Method::Post, "/cancel") => {
                if let Some(desk) = self.desk(page) {
                    desk.taken_back.store(true, Ordering::SeqCst);
                }
                (200, JSON, b"{}".to_vec())
            }
            (Method::Post, "/ask") => {
                let mut question = Vec::new();
                match request.as_reader().read_to_end(&mut question) {
                    Ok(_) => (200, "application/octet-stream", self.asked(page, &question)),
                    Err(error) => (400, "text/plain; charset=utf-8", format!("the question broke off: {error}\n").into_bytes()),
                }
            }
            _ => (404, "text/plain; charset=utf-8", b"there is nothing here\n".to_vec()),
        }
    }

    fn asked(&self, page: &str, question: &[u8]) -> Vec<u8> {
        let desk = self.desk(page).unwrap_or_else(|| self.new_desk(page));
        let mut session = locked(&desk.session);
        desk.taken_back.store(self.ended.load(Ordering::SeqCst), Ordering::SeqCst);
        locked(&desk.steps).clear();
        // A defect ends one question, not the lab: the page hands data and model to a new session.
        let answered = catch_unwind(AssertUnwindSafe(|| session.answer(question, &*desk)));
        answered.unwrap_or_else(|_| {
            *session = Session::serving(self.served.clone());
            let what = "The computation broke off. Please report this, with what `hysteron lab` has written in its window.";
            Answer::of(json!({ "error": what, "knows_nothing": true })).bytes()
        })
    }

    /// A page that is known; it is now the one that was heard of last.
    fn desk(&self, page: &str) -> Option<Arc<Desk>> {
        let mut desks = locked(&self.desks);
        let at = desks.iter().position(|(name, _)| name == page)?;
        let found = desks.remove(at);
        let desk = Arc::clone(&found.1);
        desks.push(found);
        Some(desk)
    }

    fn new_desk(&self, page: &str) -> Arc<Desk> {
        let desk = Arc::new(Desk { session: Mutex::new(Session::serving(self.served.clone())), ..Desk::default() });
        let mut desks = locked(&self.desks);
        if desks.len() >= PAGES_MAX {
            desks.remove(0);
        }
        desks.push((page.to_owned(), Arc::clone(&desk)));
        desk
    }
}

/// The value of a parameter in an address; none of them needs to be unescaped.
fn parameter<'a>(url: &'a str, name: &str) -> Option<&'a str> {
    url.split_once('?')?.1.split('&').find_map(|pair| pair.strip_prefix(name)?.strip_prefix('='))
}
