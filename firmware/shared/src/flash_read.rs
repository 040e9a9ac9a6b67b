//! Reads flash that may be damaged, without ending the program.
//!
//! # How it works
//! A word of flash whose writing was cut off by the supply holds a double ECC error: every read of it is
//! answered with a bus error, which is a hard fault, or raises the NMI, as the part has it, at every start.
//! Here 32 bytes, a word or some of them, are read with FAULTMASK set and CCR.BFHFNMIGN with it, so that the
//! processor ignores a bus error (Armv7-M, B3.2.8) and notes it in CFSR; what the flash interface notes, and
//! what becomes of an NMI, the board knows ([`FlashInterface`]). Both are looked at after each piece.
//! FAULTMASK holds the control interrupt off too, for eight loads: far less than the microsecond by which its
//! entry may vary, and sampling and latching are hardware's. A bank that is written would make it seconds, so
//! nothing is read of it then.

use core::arch::asm;

use cortex_m::peripheral::SCB;

/// What the part's flash interface notes while it is read.
pub trait FlashInterface {
    /// Before flash at `address` is read that may be damaged; `false` while its bank is written, when a read
    /// would hold up the control interrupt until that has ended.
    fn begin_reading(address: u32) -> bool;
    /// Behind it: whether the interface has met a double ECC error.
    fn end_reading() -> bool;
}

/// What is read at once: one or some words with an ECC of their own.
const WORD_BYTES: usize = 32;
/// CCR.BFHFNMIGN: a load's bus error is ignored at the priority of FAULTMASK.
const IGNORE_BUS_ERRORS: u32 = 1 << 8;
/// The bus fault's part of CFSR.
const BUS_FAULTS: u32 = 0xFF00;

/// A word that cannot be read: an address.
#[derive(Clone, Copy)]
pub struct Unreadable(pub u32);

/// Copies flash from `address`, the beginning of a word.
///
/// # Errors
/// A word cannot be read.
pub fn copy<F: FlashInterface>(address: u32, into: &mut [u8]) -> Result<(), Unreadable> {
    for (nth, piece) in (0u32..).zip(into.chunks_mut(WORD_BYTES)) {
        let from = address + nth * WORD_BYTES as u32;
        let word = word_at::<F>(from).ok_or(Unreadable(from))?;
        for (to, byte) in piece
            .iter_mut()
            .zip(word.iter().flat_map(|four| four.to_le_bytes()))
        {
            *to = byte;
        }
    }
    Ok(())
}

fn word_at<F: FlashInterface>(address: u32) -> Option<[u32; WORD_BYTES / 4]> {
    if !F::begin_reading(address) {
        return None;
    }
    let mut word = [0; WORD_BYTES / 4];
    // SAFETY: the system control block's registers are there, and only thread code touches these two.
    let control = unsafe { &*SCB::PTR };
    let before = control.ccr.read();
    // SAFETY: the bit only decides what becomes of bus errors while FAULTMASK is set, which ends below.
    let bus_error = unsafe {
        control.ccr.write(before | IGNORE_BUS_ERRORS);
        control.cfsr.write(BUS_FAULTS);
        asm!("cpsid f", "dsb", "isb");
        for (to, nth) in word.iter_mut().zip(0usize..) {
            // Flash that no code of the image occupies (memory.x).
            *to = (address as *const u32).add(nth).read_volatile();
        }
        asm!("dsb");
        let bus_error = control.cfsr.read() & BUS_FAULTS;
        control.cfsr.write(BUS_FAULTS);
        asm!("cpsie f", "isb");
        control.ccr.write(before);
        bus_error != 0
    };
    let damaged = F::end_reading();
    if bus_error || damaged {
        None
    } else {
        Some(word)
    }
}
