//! The conversation with the board: block after block, and values of now in between.

use super::block::ScopeBlock;
use super::seen::{FIRST_WINDOW, GLANCES, NEWEST_BLOCKS, Scope, Seen, WINDOWS};
use hysteron_client::board::Board;
use hysteron_client::condition::Condition;
use hysteron_client::port::Address;
use hysteron_client::scale::Scale;
use hysteron_client::watching::{Capture, capture, glance};
use hysteron_client::{Error, Result};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A board that sends nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);
/// Between two attempts to meet it again.
const BETWEEN_ATTEMPTS: Duration = Duration::from_millis(500);
/// Between two looks at the values of now.
const BETWEEN_GLANCES: Duration = Duration::from_millis(150);

/// Watches until the scope ends, through all that happens to the board.
pub fn watch(scope: &Scope, address: &Address, baud: Option<u32>) {
    let mut said = String::new();
    while !scope.has_ended() {
        let Err(problem) = Board::connect(address, baud)
            .and_then(|mut board| follow(scope, &mut board, &mut said))
        else {
            continue;
        };
        say_once(
            &mut said,
            format!("{problem}; it is asked again until it answers"),
        );
        lose(&mut scope.seen(), &problem);
        std::thread::sleep(BETWEEN_ATTEMPTS);
    }
}

/// Says on the terminal what it has not just said: whoever waits for a page may wait for a board.
fn say_once(said: &mut String, text: String) {
    if *said != text {
        eprintln!("{text}");
        *said = text;
    }
}

/// What was seen stays to be looked at; what is true now is unknown.
fn lose(seen: &mut Seen, problem: &Error) {
    (seen.connected, seen.trouble) = (false, problem.to_string());
    (seen.stopper, seen.condition) = (None, None);
}

/// One conversation, until the board goes away or the scope ends.
fn follow(scope: &Scope, board: &mut Board, said: &mut String) -> Result<()> {
    board.set_patience(PATIENCE);
    let stopper = board.stopper()?;
    let condition = Condition::ask(board)?;
    say_once(said, format!("{} answers", board.identification));
    {
        let mut seen = scope.seen();
        (seen.connected, seen.identification) = (true, board.identification.clone());
        (seen.stopper, seen.condition) = (Some(stopper), Some(condition));
        (seen.sample_rate_hz, seen.trouble) = (None, String::new());
        seen.glances.clear();
    }
    let (mut last, mut answered): (Option<Capture>, u32) = (None, scope.stops());
    while !scope.has_ended() {
        // With the lock, so that a stop which is counted is also sent. The board says "stopped" once, to
        // whoever asks for an error next.
        let stops = {
            let _sent = scope.seen();
            scope.stops()
        };
        if stops != answered {
            board.ask("ERR?")?;
            answered = stops;
        }
        let condition = Condition::ask(board)?;
        let without_block = condition.without_block();
        scope.seen().condition = Some(condition);
        if without_block {
            // Nothing says what the codes stand for.
            std::thread::sleep(BETWEEN_GLANCES);
            continue;
        }
        match take_block(scope, board, last.as_ref(), stops) {
            Ok(block) => last = block.or(last),
            // A stop came meanwhile. Where the board is gone as well, the next question shows it.
            Err(_) if scope.stops() != stops => {}
            Err(problem) => return Err(problem),
        }
    }
    Ok(())
}

/// Catches one block and leaves it for the pages. None where a stop came between the `stops` that
/// were answered and the recorder's start: what it holds then is an older block.
fn take_block(
    scope: &Scope,
    board: &mut Board,
    last: Option<&Capture>,
    stops: u32,
) -> Result<Option<Capture>> {
    let mut started_without_stop = None;
    // A conditioning moves the zero.
    let scale = Scale::ask(board)?;
    let window = WINDOWS
        .get(scope.seen().window)
        .copied()
        .unwrap_or(WINDOWS[FIRST_WINDOW]);
    let mut looked = Instant::now();
    let mut between = |board: &mut Board| {
        started_without_stop.get_or_insert(scope.stops() == stops);
        if looked.elapsed() >= BETWEEN_GLANCES {
            look(scope, board)?;
            looked = Instant::now();
        }
        Ok(())
    };
    let samples = window.samples.min(scale.most_samples);
    let capture = capture(
        board,
        &scale,
        window.ticks_per_sample,
        samples,
        &mut between,
    )?;
    if started_without_stop != Some(true) {
        return Ok(None);
    }
    let mut seen = scope.seen();
    seen.sample_rate_hz = Some(scale.sample_rate_hz);
    seen.blocks += 1;
    let block = ScopeBlock {
        number: seen.blocks,
        at_s: scope.seconds(),
        unseen_ticks: last.and_then(|last| unseen_ticks(last, &capture)),
        tick_rate_hz: scale.sample_rate_hz,
        capture: capture.clone(),
    };
    seen.newest.push_back(Arc::new(block));
    while seen.newest.len() > NEWEST_BLOCKS {
        seen.newest.pop_front();
    }
    Ok(Some(capture))
}

/// Ticks between the end of a block and the beginning of the next; none where the board was restarted in
/// between.
fn unseen_ticks(last: &Capture, this: &Capture) -> Option<f64> {
    let end = last.before.tick
        + f64::from(last.ticks_per_sample) * last.recorded.position_um.len() as f64;
    let unseen = this.before.tick - end;
    (unseen >= 0.0).then_some(unseen)
}

fn look(scope: &Scope, board: &mut Board) -> Result<()> {
    let glance = glance(board)?;
    let at_s = scope.seconds();
    let mut seen = scope.seen();
    // What the page says of the state does not wait for the end of a long block.
    if let Some(condition) = seen.condition.as_mut() {
        (condition.mode, condition.fault) = (glance.mode, glance.fault);
        (condition.position_um, condition.drive_v) = (glance.position_um, glance.drive_v);
    }
    seen.glances.push_back((at_s, glance));
    while seen.glances.len() > GLANCES {
        seen.glances.pop_front();
    }
    Ok(())
}
