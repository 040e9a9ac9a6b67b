//! `board status`.

use super::connection::{LineArguments, as_ours};
use hysteron::Result;
use hysteron_client::condition::Condition;

/// Says how the board is, in words and units.
pub fn status(line: &LineArguments) -> Result<bool> {
    let mut board = line.connect()?;
    let condition = Condition::ask(&mut board).map_err(as_ours)?;
    println!("{}", board.identification);
    match condition.fault {
        Some(fault) => println!("  {}: {fault}", condition.mode),
        None => println!("  {}", condition.mode),
    }
    if !condition.without_block() {
        let zeroed = if condition.zeroed {
            "zeroed"
        } else {
            "not zeroed since the start"
        };
        println!(
            "  stage {}, {:.4} um ({zeroed}), {:.3} V",
            condition.stage, condition.position_um, condition.drive_v
        );
    }
    for words in condition
        .following
        .iter()
        .flat_map(|following| following.words())
    {
        println!("  {words}");
    }
    for (name, count) in &condition.counts {
        println!("  {name}: {count:.0}");
    }
    Ok(condition.fault.is_none())
}
