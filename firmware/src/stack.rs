//! How much of the stack was ever used: painted at start, looked at on request.

const PAINT: u32 = 0xA5A5_5A5A;

unsafe extern "C" {
    static mut __euninit: u32;
    static mut _stack_start: u32;
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
        ((top as usize - word as usize) as u32, (top as usize - bottom as usize) as u32)
    }
}
