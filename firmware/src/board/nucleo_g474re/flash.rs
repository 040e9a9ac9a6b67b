//! Writes pages of flash bank 2, without ever holding up the tasks: an erase takes 25 ms, several ticks of
//! the watchdog's feeding.
//!
//! The HAL's driver waits in a loop, so the few registers are driven here (RM0440, embedded flash memory:
//! erase and program operations). Code runs from bank 1, and the control interrupt from the CCM SRAM, so
//! neither waits for bank 2, as long as the option byte DBANK says that there are two.

use embassy_stm32::pac::FLASH;

use crate::board::flash_words::{self, FlashError};
use crate::task_clock;

/// Where bank 2 begins, and the length of its pages.
const BANK_2: u32 = 0x0804_0000;
const PAGE_BYTES: u32 = 2 * 1024;
/// What is programmed at once.
const WORD_BYTES: usize = 8;
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Far more than an erase takes (DS12288: 24.5 ms).
const MOST_WAITS: u32 = 500;

/// Lets the control register be written.
pub fn unlock() {
    if FLASH.cr().read().lock() {
        for key in KEYS {
            FLASH.keyr().write_value(key);
        }
    }
}

/// Clears what earlier programming left; with an error set the interface refuses all that follows.
pub fn forget_errors() {
    FLASH.sr().write(|w| {
        w.set_eop(true);
        w.set_operr(true);
        w.set_progerr(true);
        w.set_wrperr(true);
        w.set_pgaerr(true);
        w.set_sizerr(true);
        w.set_pgserr(true);
        w.set_miserr(true);
        w.set_fasterr(true);
        w.set_rderr(true);
        w.set_optverr(true);
    });
}

/// Waits until the flash is idle, and says what went wrong in what it did.
async fn finished() -> Result<(), FlashError> {
    for _ in 0..MOST_WAITS {
        let status = FLASH.sr().read();
        if !status.bsy() {
            let failed = status.operr()
                || status.progerr()
                || status.wrperr()
                || status.pgaerr()
                || status.sizerr()
                || status.pgserr();
            forget_errors();
            return if failed {
                Err("the flash refused it")
            } else {
                Ok(())
            };
        }
        task_clock::next().await;
    }
    Err("the flash does not answer")
}

/// Erases the page at `address` and writes `bytes` to its beginning.
pub async fn write_page(address: u32, bytes: &[u8]) -> Result<(), FlashError> {
    if !FLASH.optr().read().dbank() {
        return Err(
            "the option byte DBANK makes one bank of the flash: an erase would hold up the control interrupt",
        );
    }
    begin();
    let result = match erase(address).await {
        Ok(()) => program(address, bytes).await,
        failed => failed,
    };
    end();
    result
}

/// Programs 32 bytes of zeros at an address that is erased.
pub async fn write_mark(address: u32) -> Result<(), FlashError> {
    begin();
    let result = match finished().await {
        Ok(()) => program(address, &[0; 32]).await,
        failed => failed,
    };
    end();
    result
}

fn begin() {
    unlock();
    forget_errors();
}

fn end() {
    FLASH.cr().modify(|w| {
        w.set_pg(false);
        w.set_per(false);
        w.set_lock(true);
    });
    forget_cached_data();
}

/// The data cache keeps what was read before (RM0440, adaptive real-time memory accelerator: it is reset
/// while it is off).
fn forget_cached_data() {
    FLASH.acr().modify(|w| w.set_dcen(false));
    FLASH.acr().modify(|w| w.set_dcrst(true));
    FLASH.acr().modify(|w| w.set_dcrst(false));
    FLASH.acr().modify(|w| w.set_dcen(true));
}

async fn erase(address: u32) -> Result<(), FlashError> {
    finished().await?;
    let page = ((address - BANK_2) / PAGE_BYTES) as u8;
    FLASH.cr().modify(|w| {
        w.set_per(true);
        w.set_bker(true);
        w.set_pnb(page);
    });
    FLASH.cr().modify(|w| w.set_strt(true));
    finished().await?;
    FLASH.cr().modify(|w| w.set_per(false));
    Ok(())
}

async fn program(address: u32, bytes: &[u8]) -> Result<(), FlashError> {
    FLASH.cr().modify(|w| w.set_pg(true));
    let _ = FLASH.cr().read();
    flash_words::program::<WORD_BYTES>(address, bytes, finished).await?;
    FLASH.cr().modify(|w| w.set_pg(false));
    Ok(())
}
