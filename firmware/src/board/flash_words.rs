//! The stores that program a flash, in the order and with the barriers that every board's asks for. Erase,
//! registers and waiting are the board's.

/// Why something was not written.
pub type FlashError = &'static str;

/// What is stored before is there before what follows, and is fetched anew.
fn barrier() {
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

/// Stores bytes from `address` on, a flash word at a time, the last one filled with ones; `finished` waits
/// for the interface after each. PG has been set, and its register read back. The address is in a part of the
/// flash that no code and no data of the image occupies (memory.x).
pub async fn program<const WORD_BYTES: usize>(
    address: u32,
    bytes: &[u8],
    finished: impl AsyncFn() -> Result<(), FlashError>,
) -> Result<(), FlashError> {
    // The register and the array are different places of the memory map: without a barrier the first store
    // may come before PG is set.
    barrier();
    for (nth, piece) in bytes.chunks(WORD_BYTES).enumerate() {
        let mut word = [0xFF; WORD_BYTES];
        word.iter_mut()
            .zip(piece)
            .for_each(|(to, from)| *to = *from);
        let to = address as usize + nth * WORD_BYTES;
        for (part, four) in word.chunks_exact(4).enumerate() {
            let value = four
                .iter()
                .rev()
                .fold(0u32, |sum, byte| sum << 8 | u32::from(*byte));
            // SAFETY: the caller's address is within a part of the flash that nothing of the image occupies;
            // the flash interface takes the store.
            unsafe { ((to + 4 * part) as *mut u32).write_volatile(value) };
        }
        // All of the word has left the processor before the interface is asked whether it is done.
        barrier();
        finished().await?;
    }
    Ok(())
}
