//! How much room the log's RTT channel has, so that what must not be lost waits for it.

use core::ptr::addr_of;

/// The head of RTT's control block and its first up channel (SEGGER's layout, in words): identifier, counts,
/// then name, buffer, size, write and read offsets, flags.
#[repr(C)]
struct Head {
    identifier: [u32; 4],
    counts: [u32; 2],
    name: u32,
    buffer: u32,
    size: u32,
    write: u32,
    read: u32,
}

unsafe extern "C" {
    #[link_name = "_SEGGER_RTT"]
    static CONTROL_BLOCK: Head;
}

/// Bytes that can be logged now without losing any.
pub fn free_bytes() -> u32 {
    // SAFETY: rtt-target defines the control block with this layout; the probe changes `read` at any time,
    // hence volatile.
    let (size, write, read) = unsafe {
        let head = addr_of!(CONTROL_BLOCK);
        (
            addr_of!((*head).size).read_volatile(),
            addr_of!((*head).write).read_volatile(),
            addr_of!((*head).read).read_volatile(),
        )
    };
    if write >= read {
        size - 1 - (write - read)
    } else {
        read - write - 1
    }
}
