//! The option bytes that protect the drive when no program can: the brown-out level, and the watchdog that
//! starts with the supply.
//!
//! They are looked at at every start and in every status, and written only when somebody asks for it
//! ([`protect`], at rest): they outlive the program. A part out of its box has neither.

use crate::board::{Board, Platform};

/// What is protected: 1 the brown-out level is high enough, 2 the watchdog starts with the supply, 3 both.
pub fn protection() -> u32 {
    Board::protection()
}

/// Says what is missing.
pub fn say() {
    match protection() {
        3 => defmt::info!("option bytes: brown-out level and watchdog protect"),
        2 => defmt::warn!(
            "option bytes: the brown-out level is below {=str}; `protect` at rest sets it",
            Board::BROWN_OUT_LEVEL
        ),
        1 => defmt::warn!(
            "option bytes: the watchdog waits for the program; `protect` at rest lets it start with the supply"
        ),
        _ => defmt::warn!(
            "option bytes: no brown-out level, and the watchdog waits for the program; `protect` at rest sets both"
        ),
    }
}

/// Writes them, everything else as it is.
pub async fn protect() -> Result<(), &'static str> {
    if protection() == 3 {
        Ok(())
    } else {
        Board::write_protection().await
    }
}
