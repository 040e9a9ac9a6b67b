//! Both banks of the flash, one operation at a time (RM0433, 4.3.9 and 4.3.10). The watchdog, which the option
//! bytes may have started with the supply, is fed meanwhile.

use hysteron_core::firmware_update::{UpdateFlash, WORD_BYTES, Word};
use hysteron_firmware_shared::flash_end;
use hysteron_firmware_shared::flash_read::{self, FlashInterface};
use stm32_metapac::flash::Bank;
use stm32_metapac::iwdg::vals::Key;
use stm32_metapac::{FLASH, IWDG1};

const FLASH_BEGIN: u32 = 0x0800_0000;
const BANK_BYTES: u32 = 1 << 20;
const SECTOR_BYTES: u32 = 128 * 1024;
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Doublewords at once (PSIZE x64).
const PARALLELISM: u8 = 3;
/// A sector's erase takes at most 4 s (DS12110); between two looks pass some 0.1 ms.
const MOST_LOOKS: u32 = 100_000;
/// Cycles of the internal oscillator, 64 MHz.
const BETWEEN_LOOKS_CYCLES: u32 = 6_400;

/// The part's flash.
pub struct Flash;

fn feed_watchdog() {
    IWDG1.kr().write(|w| w.set_key(Key::RESET));
}

/// The bank of an address.
fn bank(address: u32) -> Bank {
    FLASH.bank(usize::from(address - FLASH_BEGIN >= BANK_BYTES))
}

/// Waits until a bank is idle; whether what it did succeeded.
fn finished(bank: Bank) -> bool {
    for _ in 0..MOST_LOOKS {
        feed_watchdog();
        if let Some(succeeded) = flash_end::succeeded(bank) {
            return succeeded;
        }
        cortex_m::asm::delay(BETWEEN_LOOKS_CYCLES);
    }
    false
}

fn unlock(bank: Bank) {
    if bank.cr().read().lock() {
        for key in KEYS {
            bank.keyr().write_value(key);
        }
    }
}

fn lock(bank: Bank) {
    bank.cr().modify(|w| {
        w.set_pg(false);
        w.set_ser(false);
        w.set_lock(true);
    });
}

/// What is stored before is there before what follows.
fn barrier() {
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Clears the flags of double ECC errors.
fn forget_damage() {
    for nth in 0..2 {
        FLASH.bank(nth).ccr().write(|w| w.set_clr_dbeccerr(true));
    }
}

impl FlashInterface for Flash {
    fn begin_reading(_: u32) -> bool {
        forget_damage();
        // Every operation was waited for.
        true
    }

    fn end_reading() -> bool {
        let damaged = FLASH.bank(0).sr().read().dbeccerr() || FLASH.bank(1).sr().read().dbeccerr();
        if damaged {
            forget_damage();
        }
        damaged
    }
}

impl UpdateFlash for Flash {
    fn word(&mut self, address: u32) -> Option<Word> {
        feed_watchdog();
        let mut word = [0; WORD_BYTES];
        flash_read::copy::<Self>(address, &mut word).ok()?;
        Some(word)
    }

    fn erase(&mut self, address: u32) -> bool {
        let bank = bank(address);
        unlock(bank);
        let mut done = finished(bank);
        if done {
            let sector = (address - FLASH_BEGIN) % BANK_BYTES / SECTOR_BYTES;
            bank.cr().modify(|w| {
                w.set_psize(PARALLELISM);
                w.set_ser(true);
                w.set_snb(sector as u8);
            });
            bank.cr().modify(|w| w.set_start(true));
            done = finished(bank);
        }
        lock(bank);
        done
    }

    fn program(&mut self, address: u32, word: &Word) -> bool {
        let bank = bank(address);
        unlock(bank);
        let mut done = finished(bank);
        if done {
            bank.cr().modify(|w| {
                w.set_psize(PARALLELISM);
                w.set_pg(true);
            });
            let _ = bank.cr().read();
            barrier();
            for (nth, four) in (0u32..).zip(word.chunks_exact(4)) {
                let value = four
                    .iter()
                    .rev()
                    .fold(0u32, |sum, byte| sum << 8 | u32::from(*byte));
                // SAFETY: the address is one of an image or of the journal, in which nothing of this stage
                // lies; the flash interface takes the store.
                unsafe { ((address + 4 * nth) as *mut u32).write_volatile(value) };
            }
            barrier();
            done = finished(bank);
        }
        lock(bank);
        done
    }
}
