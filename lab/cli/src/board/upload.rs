//! `board upload`.

use super::connection::{LineArguments, as_ours};
use crate::desk::{Desk, wrong};
use hysteron::Result;
use hysteron::servo::amplifier_block::read_block;
use std::path::Path;

/// Brings a block and restarts with it, or swaps it in under the running loop. What the board would refuse
/// whatever it does is refused before anything is sent.
pub fn upload(block: &Path, swap: bool, line: &LineArguments) -> Result<bool> {
    let bytes = Desk::new(false).bytes(
        block,
        "a parameter block written by `hysteron design --block`",
    )?;
    read_block(&bytes).map_err(|problem| wrong(block, problem.reason()))?;
    let mut board = line.connect()?;
    if swap {
        hysteron_client::upload::swap(&mut board, &bytes).map_err(as_ours)?;
        println!(
            "{} runs until the next restart, which takes the block in the flash",
            block.display()
        );
        return Ok(true);
    }
    hysteron_client::upload::upload(&mut board, &bytes, line.baud()).map_err(as_ours)?;
    println!(
        "{} is in use; next: condition (ATZ 1), then close the loop at rest (SVO 1 1)",
        block.display()
    );
    Ok(true)
}
