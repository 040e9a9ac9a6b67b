//! What reading flash that may be damaged needs of the board; the functions are named as in the firmware's
//! `board`.

use stm32_metapac::FLASH;

/// The part's two banks of flash.
pub struct Board;

/// Reading of damaged words.
pub trait Platform {
    /// Before a word is read.
    fn begin_reading();
    /// Behind it: whether it has a double ECC error.
    fn end_reading() -> bool;
}

/// Clears the flags of double ECC errors.
fn clear() {
    for nth in 0..2 {
        FLASH.bank(nth).ccr().write(|w| w.set_clr_dbeccerr(true));
    }
}

impl Platform for Board {
    fn begin_reading() {
        clear();
    }

    fn end_reading() -> bool {
        let damaged = FLASH.bank(0).sr().read().dbeccerr() || FLASH.bank(1).sr().read().dbeccerr();
        if damaged {
            clear();
        }
        damaged
    }
}
