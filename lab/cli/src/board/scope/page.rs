//! What a page asks, and what it is answered.

use super::block::{Drawn, ScopeBlock};
use super::seen::{HELD_BLOCKS, Scope, Seen, WINDOWS};
use hysteron_browser::local_server::{JSON, PAGE, Reply, TEXT, parameter};
use hysteron_client::fault::what_to_do;
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use tiny_http::{Method, Request};

/// Everything that a page shows.
#[derive(Serialize)]
struct State<'a> {
    schema: &'static str,
    /// Seconds since the scope began.
    now_s: f64,
    connected: bool,
    trouble: &'a str,
    identification: &'a str,
    board: Option<BoardState<'a>>,
    live: Live,
    windows: Vec<String>,
    window: usize,
    /// Only where there is one that the page has not.
    block: Option<Drawn>,
    /// How long ago its reading had ended, s.
    block_age_s: Option<f64>,
}

/// The board in words.
#[derive(Serialize)]
struct BoardState<'a> {
    stage: &'a str,
    mode: &'a str,
    fault: Option<&'a str>,
    what_to_do: Option<&'a str>,
    without_block: bool,
    zeroed: bool,
    counts: &'a [(String, f64)],
}

/// Values of now, one column for each.
#[derive(Serialize)]
struct Live {
    time_s: Vec<f64>,
    position_um: Vec<f64>,
    drive_v: Vec<f64>,
    target_um: Option<f64>,
}

/// Answers a request of a page.
pub fn route(scope: &Scope, page: &str, request: &mut Request) -> Reply {
    let url = request.url().to_owned();
    let path = url.split('?').next().unwrap_or_default();
    let number = |name: &str| parameter(&url, name).and_then(|word| word.parse::<u64>().ok());
    match (request.method().clone(), path) {
        (Method::Get, "/") => (200, PAGE, page.as_bytes().to_vec()),
        (Method::Get, "/state") => state(scope, number("since").unwrap_or(0)),
        (Method::Get, "/save") => found(scope, number("block"), |seen, block| {
            let stage = seen
                .condition
                .as_ref()
                .map_or("unknown", |condition| condition.stage.as_str());
            (
                200,
                "text/csv; charset=utf-8",
                block.csv(&seen.identification, stage).into_bytes(),
            )
        }),
        (Method::Post, "/hold") => found(scope, number("block"), hold),
        (Method::Post, "/window") => match number("window")
            .map(|nth| nth as usize)
            .filter(|nth| *nth < WINDOWS.len())
        {
            Some(window) => {
                scope.seen().window = window;
                (200, JSON, b"{}".to_vec())
            }
            None => (
                400,
                TEXT,
                format!("expected window=0 to {}\n", WINDOWS.len() - 1).into_bytes(),
            ),
        },
        (Method::Post, "/stop") => stop(scope),
        (_, "/" | "/state" | "/save" | "/hold" | "/window" | "/stop") => {
            (405, TEXT, b"not by this method\n".to_vec())
        }
        _ => (404, TEXT, b"there is nothing here\n".to_vec()),
    }
}

/// The one command: the drive goes to rest. It waits for nothing, not even for who watches.
fn stop(scope: &Scope) -> Reply {
    let mut seen = scope.seen();
    // Counted before it is sent: who reads "stopped" from the board knows why.
    scope.stops.fetch_add(1, Ordering::SeqCst);
    let sent = match seen.stopper.as_mut() {
        Some(stopper) => stopper.stop().map_err(|problem| problem.to_string()),
        None => Err("the board does not answer".to_owned()),
    };
    match sent {
        Ok(()) => (200, JSON, b"{}".to_vec()),
        Err(problem) => (
            503,
            TEXT,
            format!("STOP was not sent: {problem}. Use the emergency stop.\n").into_bytes(),
        ),
    }
}

/// Answers with a block that is still kept.
fn found(
    scope: &Scope,
    number: Option<u64>,
    answer: impl FnOnce(&mut Seen, &Arc<ScopeBlock>) -> Reply,
) -> Reply {
    let mut seen = scope.seen();
    let block = seen
        .newest
        .iter()
        .chain(&seen.held)
        .find(|block| Some(block.number) == number)
        .cloned();
    match block {
        Some(block) => answer(&mut seen, &block),
        None => (404, TEXT, b"this block has left the memory; expected block=NUMBER of one that was shown a moment ago\n".to_vec()),
    }
}

/// Keeps a block for a page that has paused on it.
fn hold(seen: &mut Seen, block: &Arc<ScopeBlock>) -> Reply {
    if !seen.held.iter().any(|held| held.number == block.number) {
        seen.held.push_back(Arc::clone(block));
        while seen.held.len() > HELD_BLOCKS {
            seen.held.pop_front();
        }
    }
    (200, JSON, b"{}".to_vec())
}

fn state(scope: &Scope, since: u64) -> Reply {
    let now_s = scope.seconds();
    // Spectra are made while nobody waits for the lock.
    let newest = scope.seen().newest.back().cloned();
    let block = newest
        .as_ref()
        .filter(|block| block.number > since)
        .map(|block| block.drawn());
    let seen = scope.seen();
    let board = seen.condition.as_ref().map(|condition| BoardState {
        stage: &condition.stage,
        mode: condition.mode,
        fault: condition.fault,
        what_to_do: condition.fault.map(what_to_do),
        without_block: condition.without_block(),
        zeroed: condition.zeroed,
        counts: &condition.counts,
    });
    let live = Live {
        time_s: seen.glances.iter().map(|(at_s, _)| *at_s).collect(),
        position_um: seen
            .glances
            .iter()
            .map(|(_, glance)| glance.position_um)
            .collect(),
        drive_v: seen
            .glances
            .iter()
            .map(|(_, glance)| glance.drive_v)
            .collect(),
        target_um: seen.glances.back().and_then(|(_, glance)| glance.target_um),
    };
    let state = State {
        schema: "hysteron.scope/1",
        now_s,
        connected: seen.connected,
        trouble: &seen.trouble,
        identification: &seen.identification,
        board,
        live,
        windows: WINDOWS
            .iter()
            .map(|window| window_name(window.ticks_per_sample, window.samples, seen.sample_rate_hz))
            .collect(),
        window: seen.window,
        block,
        block_age_s: newest.map(|block| now_s - block.at_s),
    };
    match serde_json::to_vec(&state) {
        Ok(bytes) => (200, JSON, bytes),
        Err(problem) => (500, TEXT, format!("{problem}\n").into_bytes()),
    }
}

fn window_name(ticks_per_sample: u32, samples: usize, tick_rate_hz: Option<f64>) -> String {
    let every = if ticks_per_sample == 1 {
        "every tick".to_owned()
    } else {
        format!("every {ticks_per_sample}th tick")
    };
    match tick_rate_hz {
        Some(rate_hz) => format!(
            "{:.3} s: {samples} samples, {every}",
            samples as f64 * f64::from(ticks_per_sample) / rate_hz
        ),
        None => format!("{samples} samples, {every}"),
    }
}
