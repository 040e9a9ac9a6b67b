//! How much of the stack was ever used, and that it never grows into static data.
//!
//! The stack is painted at start and looked at on request. At its end stands a guard, a piece of memory that
//! the memory protection unit lets nobody write: an overflow is a hard fault before it has changed anything.
//! The hard fault's handler runs without the unit (HFNMIENA is clear) and has the guard itself for its frame.
//! The same unit keeps the processor from executing, and from fetching ahead, what stands in the bank of the
//! flash that is written while the program runs.

use cortex_m::peripheral::MPU;

use crate::board::{Board, Platform};

const PAINT: u32 = 0xA5A5_5A5A;

unsafe extern "C" {
    static mut __euninit: u32;
    static mut _stack_start: u32;
}

/// Bytes of the guard.
const GUARD_BYTES: u32 = 512;

/// Where the guard begins: the first multiple of its size behind static data.
fn guard_begin() -> u32 {
    (&raw const __euninit as u32).next_multiple_of(GUARD_BYTES)
}

/// Puts the guard up.
pub fn guard(mpu: &mut MPU) {
    /// Read-only for everybody, never executed.
    const READ_ONLY: u32 = 1 << 28 | 0b110 << 24;
    /// Device memory that everybody reads and writes, never executed.
    const DATA: u32 = 1 << 28 | 0b011 << 24 | 1 << 16;
    /// The map without regions stays what it is, and handlers of hard faults see only that.
    const BACKGROUND: u32 = 1 << 2;
    cortex_m::asm::dmb();
    // SAFETY: only takes the right to write from memory that nothing may ever use, and the right to execute
    // from memory that holds no code.
    unsafe {
        let (data, data_bytes) = Board::DATA_BANK;
        for (region, base, bytes, attributes) in [
            (0, guard_begin(), GUARD_BYTES, READ_ONLY),
            (1, data, data_bytes, DATA),
        ] {
            mpu.rnr.write(region);
            mpu.rbar.write(base);
            mpu.rasr
                .write(attributes | (bytes.trailing_zeros() - 1) << 1 | 1);
        }
        mpu.ctrl.write(BACKGROUND | 1);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Paints what is free of the stack.
#[inline(never)]
pub fn paint() {
    let marker = 0u32;
    let here = &raw const marker as usize;
    // SAFETY: between the end of static data and well below this frame nothing lives.
    unsafe {
        let mut word = &raw mut __euninit;
        while (word as usize) < here - 256 {
            word.write_volatile(PAINT);
            word = word.add(1);
        }
    }
}

/// Bytes of the stack: used at most so far, and in all.
pub fn high_water_bytes() -> (u32, u32) {
    // SAFETY: reads memory that belongs to the stack; nothing is written.
    unsafe {
        let (bottom, top) = (&raw const __euninit, &raw const _stack_start);
        let mut word = bottom;
        while word < top && word.read_volatile() == PAINT {
            word = word.add(1);
        }
        (
            (top as usize - word as usize) as u32,
            (top as usize - bottom as usize) as u32,
        )
    }
}
