//! A page for a browser of this machine, and for nobody else.
//!
//! A request is answered only if it comes from the page: it must name this server as its host (so that no
//! other name can be made to point here), must not come from another origin, and must carry the token of the
//! address.

use hysteron::{Error, Result};
use std::net::{Ipv4Addr, SocketAddr};
use tiny_http::{Header, Request, Response};

/// Any free port of 127.0.0.1.
pub const ANY_PORT: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// A kind of answer, as its header names it.
pub const TEXT: &str = "text/plain; charset=utf-8";
/// As [`TEXT`].
pub const JSON: &str = "application/json";
/// As [`TEXT`].
pub const PAGE: &str = "text/html; charset=utf-8";

/// A question may bring so much; data sets are far smaller.
const MOST_BODY_BYTES: usize = 1 << 30;

/// What a request is answered: status, kind, bytes.
pub type Reply = (u16, &'static str, Vec<u8>);

/// Listens on this machine alone.
pub struct LocalServer {
    http: tiny_http::Server,
    /// The command that serves, as messages name it.
    command: &'static str,
    host: String,
    token: String,
}

impl LocalServer {
    /// Takes a port; `command` is what a person has typed.
    ///
    /// # Errors
    /// The address is not one of this machine alone, there is no port, or the system has no random numbers
    /// for the token.
    pub fn bind(listen: SocketAddr, command: &'static str) -> Result<Self> {
        let wrong = |what: String| Error::new(command, what);
        if !listen.ip().is_loopback() {
            return Err(wrong(format!(
                "{listen} could be reached from other machines; expected an address like 127.0.0.1:8080"
            )));
        }
        let http = tiny_http::Server::http(listen)
            .map_err(|e| wrong(format!("no port can be taken at {listen}: {e}")))?;
        let mut random = [0; 16];
        getrandom::fill(&mut random).map_err(|e| {
            wrong(format!(
                "the system gives no random numbers for a token: {e}"
            ))
        })?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self {
            host: http.server_addr().to_string(),
            http,
            command,
            token,
        })
    }

    /// The address of the page, with its token.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://{}/?token={}", self.host, self.token)
    }

    /// The next request; `None` if none came after all.
    #[must_use]
    pub fn receive(&self) -> Option<Request> {
        self.http.recv().ok()
    }

    /// Wakes who waits in [`Self::receive`].
    pub fn wake(&self) {
        self.http.unblock();
    }

    /// Answers a request from the page by `route`, any other with a refusal.
    pub fn answer(&self, mut request: Request, route: impl FnOnce(&mut Request) -> Reply) {
        if request
            .body_length()
            .is_some_and(|bytes| bytes > MOST_BODY_BYTES)
        {
            // tiny_http 0.12 sets as much memory aside as a request announces when it is dropped, and without
            // that memory the program ends. One connection that is never closed is the lesser evil.
            std::mem::forget(request);
            return;
        }
        let (status, kind, bytes) = match self.refusal(&request) {
            Some(why) => (403, TEXT, format!("refused: {why}\n").into_bytes()),
            None => route(&mut request),
        };
        let headers = [
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("Content-Security-Policy", "frame-ancestors 'none'"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
        ];
        let headers = headers
            .iter()
            .filter_map(|(name, value)| Header::from_bytes(name.as_bytes(), value.as_bytes()).ok());
        let response = headers.fold(
            Response::from_data(bytes).with_status_code(status),
            Response::with_header,
        );
        // A page that was closed in the meantime needs no answer.
        let _ = request.respond(response);
    }

    /// Why a request is not answered.
    fn refusal(&self, request: &Request) -> Option<String> {
        let header = |name: &'static str| {
            request
                .headers()
                .iter()
                .find(|h| h.field.equiv(name))
                .map(|h| h.value.as_str())
        };
        let from_elsewhere = |site: &str| !matches!(site, "same-origin" | "none");
        let command = self.command;
        if header("Host") != Some(self.host.as_str()) {
            Some("it was meant for another host".into())
        } else if header("Origin")
            .is_some_and(|origin| origin.strip_prefix("http://") != Some(self.host.as_str()))
        {
            Some("it comes from another origin".into())
        } else if header("Sec-Fetch-Site").is_some_and(from_elsewhere) {
            Some(format!(
                "it comes from another site; type the address that `{command}` has written"
            ))
        } else if parameter(request.url(), "token") != Some(self.token.as_str()) {
            Some(format!(
                "the token is missing or wrong; use the address that `{command}` has written"
            ))
        } else {
            None
        }
    }
}

/// The value of a parameter in an address; none of them needs to be unescaped.
#[must_use]
pub fn parameter<'a>(url: &'a str, name: &str) -> Option<&'a str> {
    url.split_once('?')?
        .1
        .split('&')
        .find_map(|pair| pair.strip_prefix(name)?.strip_prefix('='))
}
