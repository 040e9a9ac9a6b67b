//! What a scope sees of a board: values of now, and blocks that its recorder caught.
//!
//! # How it works
//! [`glance`] asks for what is known of the last tick. [`capture`] starts the recorder and reads what it
//! caught: every n-th tick, without a gap inside the block and with one between two blocks, as long as the
//! reading takes. Codes come with a checksum; the reference is read as text from the recorder's first table
//! and only while the servo is on, since it has no other source. Apart from what the recorder records,
//! nothing of the board changes.

use hysteron_core::guard::Fault;

use crate::board::Board;
use crate::error::{Error, Result};
use crate::playing::{Between, Recorded, listen_with};
use crate::scale::Scale;

/// References that are asked for at once.
const REFERENCES_AT_ONCE: usize = 400;

/// Values of now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glance {
    /// Ticks since the board's start.
    pub tick: f64,
    /// `rest`, `open loop`, `closed loop` or `fault`.
    pub mode: &'static str,
    /// The latched fault.
    pub fault: Option<&'static str>,
    /// Position as the sensor reads it, um.
    pub position_um: f64,
    /// Drive, V.
    pub drive_v: f64,
    /// Target of the servo, um, where it is on.
    pub target_um: Option<f64>,
}

/// Names of `DIA? 1`.
#[must_use]
pub fn mode_name(number: f64) -> &'static str {
    ["rest", "open loop", "closed loop"]
        .get(number as usize)
        .copied()
        .unwrap_or("fault")
}

/// Asks for the values of now.
///
/// # Errors
/// The board does not answer.
pub fn glance(board: &mut Board) -> Result<Glance> {
    let numbers = board.numbers("DIA? 1 2 10")?;
    let [mode, fault, tick] = numbers[..] else {
        return Err(Error::new("DIA?", "the board answers something else"));
    };
    let mode = mode_name(mode);
    let target_um = if mode == CLOSED {
        Some(board.number("MOV? 1")?)
    } else {
        None
    };
    let fault = (fault > 0.0).then(|| {
        Fault::from_number(fault as u8).map_or("one that this program does not know", Fault::name)
    });
    Ok(Glance {
        tick,
        mode,
        fault,
        position_um: board.number("POS? 1")?,
        drive_v: board.number("VOL? 1")?,
        target_um,
    })
}

const CLOSED: &str = "closed loop";

/// A block that the recorder caught.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Position and drive.
    pub recorded: Recorded,
    /// Reference at the instants of the positions, um; only where the servo was on before and after.
    pub reference_um: Option<Vec<f64>>,
    /// Ticks between two samples.
    pub ticks_per_sample: u32,
    /// The board just before.
    pub before: Glance,
    /// The board just after.
    pub after: Glance,
}

/// Catches so many samples, one every so many ticks; `between` has its turn between the questions.
///
/// # Errors
/// The board does not answer, has no room for so many, or somebody stopped its recorder.
pub fn capture(
    board: &mut Board,
    scale: &Scale,
    ticks_per_sample: u32,
    samples: usize,
    between: Between,
) -> Result<Capture> {
    let before = glance(board)?;
    // The first table is the reference, whatever another program made of it.
    board.tell("DRC 1 1 1")?;
    let recorded = listen_with(board, scale, ticks_per_sample, samples, between)?;
    let after = glance(board)?;
    let closed = before.mode == CLOSED && after.mode == CLOSED;
    let reference_um = if closed {
        Some(references(
            board,
            recorded.position_um.len(),
            samples,
            between,
        )?)
    } else {
        None
    };
    Ok(Capture {
        recorded,
        reference_um,
        ticks_per_sample,
        before,
        after,
    })
}

/// The references that belong to the last `kept` of so many samples.
fn references(
    board: &mut Board,
    kept: usize,
    samples: usize,
    between: Between,
) -> Result<Vec<f64>> {
    let mut references = Vec::with_capacity(kept);
    let mut next = samples - kept;
    while next < samples {
        let count = (samples - next).min(REFERENCES_AT_ONCE);
        let question = format!("DRR? {} {count} 1", next + 1);
        let answer = board.ask(&question)?;
        let values: Vec<f64> = answer
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map_while(|line| line.trim().parse().ok())
            .collect();
        if values.len() != count {
            return Err(Error::new(
                question,
                format!(
                    "the board answers {} values; expected {count}",
                    values.len()
                ),
            ));
        }
        references.extend(values);
        next += count;
        between(board)?;
    }
    Ok(references)
}
