//! Writes sectors of flash bank 2, without ever holding up the tasks: an erase takes seconds, and the
//! watchdog must be fed meanwhile.
//!
//! The HAL's driver waits in a loop, so the few registers are driven here (RM0433, 4.3.9 and 4.3.10). Code
//! runs from bank 1, and the control interrupt from ITCM, so neither waits for bank 2.

use embassy_futures::yield_now;
use embassy_stm32::pac::FLASH;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use hysteron_core::firmware_update::Word;
use hysteron_firmware_shared::flash_end;

use crate::board::flash_words::{self, FlashError};
use crate::task_clock;

/// Where bank 2 begins, and the length of its sectors.
const BANK_2: u32 = 0x0810_0000;
const SECTOR_BYTES: u32 = 128 * 1024;
/// What is programmed at once.
const WORD_BYTES: usize = 32;
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Doublewords at once (PSIZE x64).
const PARALLELISM: u8 = 3;
/// A sector's erase takes at most 4 s (DS12110).
const MOST_WAITS: u32 = 5_000;
/// A word is programmed within some 0.1 ms (DS12110): so often others have their turn before the task sleeps.
const TURNS: u32 = 200;

/// One task at a time.
static BANK: Mutex<ThreadModeRawMutex, ()> = Mutex::new(());

/// Waits until bank 2 is idle, and says what went wrong in what it did.
async fn finished() -> Result<(), FlashError> {
    let bank = FLASH.bank(1);
    for turn in 0..TURNS + MOST_WAITS {
        if let Some(succeeded) = flash_end::succeeded(bank) {
            return if succeeded {
                Ok(())
            } else {
                Err("the flash refused it")
            };
        }
        if turn < TURNS {
            yield_now().await
        } else {
            task_clock::next().await
        }
    }
    Err("the flash does not answer")
}

/// Erases the sector at `address` and writes `bytes` to its beginning.
pub async fn write_sector(address: u32, bytes: &[u8]) -> Result<(), FlashError> {
    let _bank = BANK.lock().await;
    unlock();
    let result = match erase(address).await {
        Ok(()) => program(address, bytes).await,
        failed => failed,
    };
    lock();
    result
}

/// Programs 32 bytes of zeros at an address that is erased.
pub async fn write_mark(address: u32) -> Result<(), FlashError> {
    write_word(address, &[0; WORD_BYTES]).await
}

/// Programs a word at an address that is erased.
pub async fn write_word(address: u32, word: &Word) -> Result<(), FlashError> {
    let _bank = BANK.lock().await;
    unlock();
    let result = match finished().await {
        Ok(()) => program(address, word).await,
        failed => failed,
    };
    lock();
    result
}

/// Erases the sector at `address`.
pub async fn erase_sector(address: u32) -> Result<(), FlashError> {
    let _bank = BANK.lock().await;
    unlock();
    let result = erase(address).await;
    lock();
    result
}

fn lock() {
    FLASH.bank(1).cr().modify(|w| {
        w.set_pg(false);
        w.set_ser(false);
        w.set_lock(true);
    });
}

fn unlock() {
    let bank = FLASH.bank(1);
    if bank.cr().read().lock() {
        for key in KEYS {
            bank.keyr().write_value(key);
        }
    }
}

async fn erase(address: u32) -> Result<(), FlashError> {
    let bank = FLASH.bank(1);
    finished().await?;
    let sector = ((address - BANK_2) / SECTOR_BYTES) as u8;
    bank.cr().modify(|w| {
        w.set_psize(PARALLELISM);
        w.set_ser(true);
        w.set_snb(sector);
    });
    bank.cr().modify(|w| w.set_start(true));
    finished().await?;
    bank.cr().modify(|w| w.set_ser(false));
    Ok(())
}

async fn program(address: u32, bytes: &[u8]) -> Result<(), FlashError> {
    let bank = FLASH.bank(1);
    bank.cr().modify(|w| {
        w.set_psize(PARALLELISM);
        w.set_pg(true);
    });
    let _ = bank.cr().read();
    flash_words::program::<WORD_BYTES>(address, bytes, finished).await?;
    bank.cr().modify(|w| w.set_pg(false));
    Ok(())
}
