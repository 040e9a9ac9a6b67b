//! The native engine behind the lab page: the page itself and a session for every page that is open, on
//! 127.0.0.1.
//!
//! Every question has a thread; those of one page wait for each other. Requests beside a search watch it and
//! cancel it.

use crate::LabSession;
use crate::answers::Answer;
use crate::asker::Asker;
use crate::local_server::{ANY_PORT, JSON, LocalServer, PAGE, Reply, TEXT, parameter};
use crate::served::Served;
use hysteron::{Error, Result};
use serde_json::json;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use tiny_http::{Method, Request};

/// Pages whose data and models are kept; the one that was quiet for longest is forgotten first.
const PAGES_MAX: usize = 4;

/// A lock, whoever broke off while holding it: what it guards is replaced whole.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// One page that is open.
#[derive(Default)]
struct Desk {
    session: Mutex<LabSession>,
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

/// Serves the lab page until somebody ends it.
pub struct Server {
    local: LocalServer,
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
        Ok(Self {
            local: LocalServer::bind(ANY_PORT, "hysteron lab")?,
            page: hysteron_page::served().map_err(|what| Error::new("lab", what))?,
            served,
            desks: Mutex::default(),
            ended: AtomicBool::new(false),
        })
    }

    /// The address of the page, with its token.
    #[must_use]
    pub fn address(&self) -> String {
        self.local.address()
    }

    /// Answers requests until [`Self::end`].
    pub fn serve(self: &Arc<Self>) {
        while !self.ended.load(Ordering::SeqCst) {
            if let Some(request) = self.local.receive() {
                let server = Arc::clone(self);
                std::thread::spawn(move || {
                    server
                        .local
                        .answer(request, |request| server.route(request))
                });
            }
        }
    }

    /// Ends [`Self::serve`], and searches that go on at their next step.
    pub fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        locked(&self.desks)
            .iter()
            .for_each(|(_, desk)| desk.taken_back.store(true, Ordering::SeqCst));
        self.local.wake();
    }

    fn route(&self, request: &mut Request) -> Reply {
        let url = request.url().to_owned();
        let path = url.split('?').next().unwrap_or_default();
        let page = parameter(&url, "page").unwrap_or_default();
        match (&request.method().clone(), path) {
            (Method::Get, "/") => (200, PAGE, self.page.clone().into_bytes()),
            (Method::Get, "/example") => {
                let files: serde_json::Map<String, serde_json::Value> =
                    hysteron_examples::HIDDEN_EFFECT
                        .iter()
                        .map(|(name, text)| ((*name).into(), json!(text)))
                        .collect();
                (200, JSON, json!(files).to_string().into_bytes())
            }
            (Method::Get, "/progress") => {
                let steps = self
                    .desk(page)
                    .map(|desk| std::mem::take(&mut *locked(&desk.steps)))
                    .unwrap_or_default();
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
                    Err(error) => (
                        400,
                        TEXT,
                        format!("the question broke off: {error}\n").into_bytes(),
                    ),
                }
            }
            _ => (404, TEXT, b"there is nothing here\n".to_vec()),
        }
    }

    fn asked(&self, page: &str, question: &[u8]) -> Vec<u8> {
        let desk = self.desk(page).unwrap_or_else(|| self.new_desk(page));
        let mut session = locked(&desk.session);
        desk.taken_back
            .store(self.ended.load(Ordering::SeqCst), Ordering::SeqCst);
        locked(&desk.steps).clear();
        // A defect ends one question, not the lab: the page hands data and model to a new session.
        let answered = catch_unwind(AssertUnwindSafe(|| session.answer(question, &*desk)));
        answered.unwrap_or_else(|_| {
            *session = LabSession::serving(self.served.clone());
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
        let desk = Arc::new(Desk {
            session: Mutex::new(LabSession::serving(self.served.clone())),
            ..Desk::default()
        });
        let mut desks = locked(&self.desks);
        if desks.len() >= PAGES_MAX {
            desks.remove(0);
        }
        desks.push((page.to_owned(), Arc::clone(&desk)));
        desk
    }
}
