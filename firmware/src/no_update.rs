//! No update over the line: the part's 512 KiB have no room for a second image beside the blocks, and it has
//! no boot stage. Flash it over the debug probe.

use hysteron_core::command_text::BlockPiece;
use hysteron_core::firmware_update::{AuthenticationCode, ImageHeader};
use hysteron_core::kept_events::Event;
use hysteron_protocol::device::UpdateRefusal;

/// An image of this board has no header that anybody reads.
pub fn running() -> Option<ImageHeader> {
    None
}

/// Nothing was rolled back.
pub fn load() -> bool {
    false
}

/// Refuses.
pub fn let_older_come() -> Result<(), &'static str> {
    Err("this board has no room for a second image")
}

/// The log of faults has no place in this flash.
pub fn kept_events(_: impl FnMut(u32, Event)) {}

/// Nothing is kept of it.
pub fn healthy() {}

/// Refuses.
pub fn begin(_: u32) -> Result<(), UpdateRefusal> {
    Err(UpdateRefusal::Unsupported)
}

/// Refuses.
pub fn take(_: &BlockPiece) -> Result<bool, UpdateRefusal> {
    Err(UpdateRefusal::Unsupported)
}

/// Refuses.
pub fn commit(_: &AuthenticationCode) -> Result<bool, UpdateRefusal> {
    Err(UpdateRefusal::Unsupported)
}

/// Ends at once.
#[embassy_executor::task]
pub async fn updater() {}
