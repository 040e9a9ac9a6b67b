//! A parameter block on its way to the board's flash.

use hysteron_core::command_text::PIECE_BYTES;
use hysteron_core::parameter_block::fingerprint;

use crate::board::Board;
use crate::error::{Error, Result};

/// Brings a block, restarts the board with it and sees that it is the one in use. The drive must be at rest;
/// `baud` is the speed of the conversation.
///
/// # Errors
/// The board refuses it, and says why; or another block is in use after the restart.
pub fn upload(board: &mut Board, block: &[u8], baud: Option<u32>) -> Result<()> {
    bring(board, block, "COMMIT", "KEPT")?;
    // A restart is not answered. Where it is refused the old block stays in use, which is found below.
    board.send(b"RBT\n")?;
    board.meet_again(baud)?;
    expect_in_use(board, block, "after the restart")
}

/// Brings a block and lets it take the place of the running one, at rest or with the loop closed, without a
/// step of the drive. The board does not write it to flash: a restart takes the block in flash.
///
/// # Errors
/// The board refuses it, and says why: the running block goes on.
pub fn swap(board: &mut Board, block: &[u8]) -> Result<()> {
    bring(board, block, "SWAP", "SWAPPED")?;
    expect_in_use(board, block, "after the swap")
}

/// Brings a safety envelope and restarts the board with it. `checksum` names it once more: the board keeps no
/// other.
///
/// # Errors
/// The power stage is on or the drive does not rest; the board refuses the envelope, and says why; or another
/// one is in force after the restart.
pub fn keep_envelope(
    board: &mut Board,
    envelope: &[u8],
    checksum: u32,
    baud: Option<u32>,
) -> Result<()> {
    bring(
        board,
        envelope,
        &format!("ENVELOPE {checksum:#010x}"),
        "KEPT",
    )?;
    board.send(b"RBT\n")?;
    board.meet_again(baud)?;
    let used = board.ask("ENV?")?;
    if used.contains(&format!("CHECKSUM={checksum:#010x}")) {
        Ok(())
    } else {
        Err(Error::new(
            "safety envelope",
            format!("after the restart the board says `{}`", used.trim()),
        ))
    }
}

/// Brings a block, says what is to be done with it and waits until it is.
fn bring(board: &mut Board, block: &[u8], what: &str, done: &str) -> Result<()> {
    let mut lines = vec![format!("BLK BEGIN {}", block.len())];
    lines.extend(block.chunks(PIECE_BYTES).enumerate().map(|(nth, piece)| {
        let digits: String = piece.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("BLK DATA {} {digits}", nth * PIECE_BYTES)
    }));
    board.tell_all(&lines)?;
    board.tell(&format!("BLK {what}"))?;
    board.wait("BLK?", |answer| match answer.strip_prefix("REFUSED ") {
        Some(reason) => Err(Error::new(
            "parameter block",
            format!("the board refuses it: {reason}"),
        )),
        None => Ok(answer == done),
    })
}

/// Sees that the block is the one in use.
fn expect_in_use(board: &mut Board, block: &[u8], when: &str) -> Result<()> {
    let expected = fingerprint(block).ok_or_else(|| Error::new("parameter block", "is cut off"))?;
    let used = board.number("DIA? 9")?;
    if used == f64::from(expected) {
        Ok(())
    } else {
        Err(Error::new(
            "parameter block",
            format!("{when} another one is in use (content {used:.0}, not {expected})"),
        ))
    }
}
