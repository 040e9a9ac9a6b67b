//! The part's option bytes (RM0433, 4.4.5).

use embassy_stm32::pac::FLASH;

use crate::task_clock;

const KEYS: [u32; 2] = [0x0819_2A3B, 0x4C5D_6E7F];
/// BOR_LEV: 2.4 V (DS12110, table 116), below the voltage detector and above what the logic needs.
const LEVEL_2V4: u32 = 2;
/// BOR_LEV and IWDG1_SW in FLASH_OPTSR.
const LEVEL_SHIFT: u32 = 2;
const LEVEL_MASK: u32 = 3 << LEVEL_SHIFT;
const WATCHDOG_BY_SOFTWARE: u32 = 1 << 4;
/// Option bytes change within some tens of milliseconds.
const MOST_WAITS: u32 = 2_000;

/// What is protected: 1 the brown-out level is high enough, 2 the watchdog starts with the supply, 3 both.
pub fn protection() -> u32 {
    let options = FLASH.optsr_cur().read().0;
    let level = (options & LEVEL_MASK) >> LEVEL_SHIFT;
    u32::from(level >= LEVEL_2V4) | u32::from(options & WATCHDOG_BY_SOFTWARE == 0) << 1
}

/// Writes them, everything else as it is.
pub async fn protect() -> Result<(), &'static str> {
    if FLASH.optcr().read().optlock() {
        for key in KEYS {
            FLASH.optkeyr().write_value(key);
        }
    }
    FLASH.optsr_prg().modify(|w| {
        let level = (w.0 & LEVEL_MASK).max(LEVEL_2V4 << LEVEL_SHIFT);
        w.0 = (w.0 & !(LEVEL_MASK | WATCHDOG_BY_SOFTWARE)) | level;
    });
    FLASH.optcr().modify(|w| w.set_optstart(true));
    let mut waits = 0;
    while FLASH.optsr_cur().read().opt_busy() && waits < MOST_WAITS {
        task_clock::next().await;
        waits += 1;
    }
    FLASH.optcr().modify(|w| w.set_optlock(true));
    if protection() == 3 {
        Ok(())
    } else {
        Err("the option bytes were not taken")
    }
}
