//! Copies the control interrupt's code to ITCM, once, before it runs.

unsafe extern "C" {
    static mut __itcm_start: u64;
    static mut __itcm_end: u64;
    static __itcm_load: u64;
}

/// Copies the section `.itcm` from flash. Nothing in it may be called before.
pub fn load() {
    // SAFETY: the linker script places both areas, 8-byte aligned and of this length; no code in ITCM has run yet.
    unsafe {
        let start = &raw mut __itcm_start;
        let end = &raw mut __itcm_end;
        let words = (end as usize - start as usize) / 8;
        let from = &raw const __itcm_load;
        for word in 0..words {
            start.add(word).write_volatile(from.add(word).read_volatile());
        }
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}
