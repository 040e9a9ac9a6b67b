//! How far an update over the line is: what excludes it and what it excludes look here.

use core::cell::Cell;

use embassy_sync::blocking_mutex::ThreadModeMutex;
use hysteron_protocol::device::UpdateState;

static STATE: ThreadModeMutex<Cell<UpdateState>> =
    ThreadModeMutex::new(Cell::new(if cfg!(feature = "nucleo-g474re") {
        UpdateState::Unsupported
    } else {
        UpdateState::Nothing
    }));

/// How far an update is.
pub fn state() -> UpdateState {
    STATE.lock(Cell::get)
}

/// It is so far now.
pub fn set(state: UpdateState) {
    STATE.lock(|place| place.set(state));
}

/// Whether this image has not been healthy for a second yet.
pub fn is_on_trial() -> bool {
    state() == UpdateState::Trial
}

/// Whether a restart would cut off what is being written.
pub fn is_busy() -> bool {
    matches!(state(), UpdateState::Erasing | UpdateState::Verifying)
}

/// Whether an image is coming or on trial: nothing else is written meanwhile, so that the one which a start
/// installs and what was kept for it belong together.
pub fn is_under_way() -> bool {
    is_busy() || is_on_trial() || matches!(state(), UpdateState::Receiving { .. })
}
