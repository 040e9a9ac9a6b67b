//! The part's option bytes (RM0440, flash option bytes).

use embassy_stm32::pac::FLASH;

use super::flash;
use crate::task_clock;

const KEYS: [u32; 2] = [0x0819_2A3B, 0x4C5D_6E7F];
/// BOR_LEV: some 2.5 V (DS12288), below the voltage detector and above what the logic needs.
const LEVEL_2V5: u8 = 3;
/// Option bytes change within some tens of milliseconds.
const MOST_WAITS: u32 = 2_000;

/// What is protected: 1 the brown-out level is high enough, 2 the watchdog starts with the supply, 3 both.
pub fn protection() -> u32 {
    let options = FLASH.optr().read();
    u32::from(options.bor_lev() >= LEVEL_2V5) | u32::from(!options.idwg_sw()) << 1
}

/// Writes them, everything else as it is. They are taken when the supply comes back.
pub async fn protect() -> Result<(), &'static str> {
    flash::unlock();
    if FLASH.cr().read().optlock() {
        for key in KEYS {
            FLASH.optkeyr().write_value(key);
        }
    }
    flash::forget_errors();
    FLASH.optr().modify(|w| {
        w.set_bor_lev(w.bor_lev().max(LEVEL_2V5));
        w.set_idwg_sw(false);
    });
    FLASH.cr().modify(|w| w.set_optstrt(true));
    let mut waits = 0;
    while FLASH.sr().read().bsy() && waits < MOST_WAITS {
        task_clock::next().await;
        waits += 1;
    }
    let status = FLASH.sr().read();
    FLASH.cr().modify(|w| {
        w.set_optlock(true);
        w.set_lock(true);
    });
    let refused = waits == MOST_WAITS
        || status.wrperr()
        || status.pgserr()
        || status.operr()
        || status.optverr();
    if !refused && protection() == 3 {
        Ok(())
    } else {
        Err("the option bytes were not taken")
    }
}
