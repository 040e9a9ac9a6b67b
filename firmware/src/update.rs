//! An image that comes over the line into bank 2, and what the boot stage needs to know of it
//! ([`hysteron_core::firmware_update`]).
//!
//! # How it works
//! `UPD BEGIN` erases the room for the image and the journal, `UPD DATA` programs a flash word, `UPD COMMIT`
//! compares the authentication code of what stands in flash with the one that the host names, and only then
//! writes the request, unless the image's version is lower than the running one's. The code is under a key in
//! the boot stage's sector, which no command reads or writes; a board without one takes no image. The next
//! start installs the image. Erase and program are bank 2's, and code runs from bank 1 and ITCM: neither ticks
//! nor tasks wait. All of it is refused unless the power stage is off and the drive rests.
//!
//! An image that runs for the first time marks itself healthy after a second ([`healthy`]); until then every
//! restart puts the previous image back.
//!
//! The sector of the journal also holds the log of faults ([`hysteron_core::kept_events`]), in its second half.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::signal::Signal;
use hysteron_core::command_text::BlockPiece;
use hysteron_core::firmware_update::{
    AuthenticationCode, H743ZI, HEADER_BYTES, HEADER_OFFSET, ImageHeader, MARKED, Mark, Progress,
    Request, UpdateKey, WORD_BYTES, Word, journal,
};
use hysteron_core::kept_events::{self, Event};
use hysteron_firmware_shared::flash_read;
use hysteron_protocol::device::{UpdateRefusal, UpdateState};

use crate::board::{Board, SAMPLE_RATE_HZ, flash};
use crate::update_state::{is_busy, is_on_trial, set, state};
use crate::{control, event_log, settings, task_clock};

/// The board, as an image names it.
const BOARD: &str = "NUCLEO-H743ZI2";
/// Its converters, in the same way.
const FRONT_END: &str = if cfg!(feature = "on-chip-converters") {
    "on-chip"
} else {
    "SPI"
};
/// Words between two turns of other tasks while a code is computed.
const WORDS_AT_ONCE: usize = 32;

/// What an image says of itself.
pub const HEADER: ImageHeader =
    ImageHeader::new(BOARD, FRONT_END, env!("CARGO_PKG_VERSION"), SAMPLE_RATE_HZ);

/// Bytes of the image that is coming, and of what of it stands in flash.
static LENGTH: AtomicU32 = AtomicU32::new(0);
static STORED: AtomicU32 = AtomicU32::new(0);
static WANTED: Signal<ThreadModeRawMutex, Wanted> = Signal::new();
/// Somebody at the probe lets an image of a lower version come, until the next restart.
static OLDER_MAY_COME: AtomicBool = AtomicBool::new(false);

/// The events of the log of faults stand in the second half of the journal's sector.
const EVENTS: u32 = H743ZI.journal + H743ZI.sector_bytes / 2;
const EVENT_PLACES: u32 = H743ZI.sector_bytes / 2 / WORD_BYTES as u32;
/// The next place.
static EVENT_PLACE: AtomicU32 = AtomicU32::new(EVENT_PLACES);
/// Periods of the tasks' clock between two looks at the log, 0.1 s.
const KEEPS_EVERY: u64 = 100;

/// What [`updater`] does next.
#[derive(Clone, Copy)]
enum Wanted {
    /// Makes room.
    Begin,
    /// Programs a word.
    Word { offset: u32, word: Word },
    /// Compares the authentication code and requests the start of the image.
    Commit { code: AuthenticationCode },
    /// Sets a mark in the journal.
    Mark(Mark),
}

/// A word of the flash, if it can be read.
#[inline(never)]
fn word(address: u32) -> Option<Word> {
    let mut word = [0; WORD_BYTES];
    flash_read::copy::<Board>(address, &mut word)
        .ok()
        .map(|()| word)
}

/// What the image at an address says of itself, and its length.
fn header(image: u32) -> Option<(u32, ImageHeader)> {
    let mut bytes = [0; HEADER_BYTES];
    flash_read::copy::<Board>(image + HEADER_OFFSET, &mut bytes).ok()?;
    ImageHeader::read(&bytes)
}

/// What the running image says of itself, from the flash.
pub fn running() -> Option<ImageHeader> {
    header(H743ZI.running).map(|(_, header)| header)
}

/// Reads the journal; whether the previous image was put back and nobody has logged that yet.
pub fn load() -> bool {
    let (progress, _, reported) = journal(H743ZI.journal, word);
    let state = match progress {
        Progress::Nothing => UpdateState::Nothing,
        // The boot stage leaves neither behind where it starts an image.
        Progress::Requested | Progress::Saved => UpdateState::Ready,
        Progress::Trial => UpdateState::Trial,
        Progress::Confirmed => UpdateState::Confirmed,
        Progress::NotInstalled => UpdateState::NotInstalled,
        Progress::RolledBack => UpdateState::RolledBack,
    };
    set(state);
    match state {
        UpdateState::Trial => {
            defmt::info!("update: this image is on trial for its first healthy second")
        }
        UpdateState::NotInstalled => {
            defmt::warn!("update: the image was not installed; this is the one before it")
        }
        UpdateState::RolledBack => {
            defmt::error!("update: the image did not become healthy and was rolled back")
        }
        _ => {}
    }
    if matches!(state, UpdateState::NotInstalled | UpdateState::RolledBack) && !reported {
        WANTED.signal(Wanted::Mark(Mark::Reported));
    }
    state == UpdateState::RolledBack && !reported
}

/// Lets an image of a lower version than the running one's come, until the next restart.
pub fn let_older_come() -> Result<(), &'static str> {
    OLDER_MAY_COME.store(true, Ordering::Relaxed);
    Ok(())
}

/// Gives the events of the log of faults that stand in flash, in their order.
pub fn kept_events(found: impl FnMut(u32, Event)) {
    let free = kept_events::scan(
        EVENT_PLACES,
        |place| word(EVENTS + place * WORD_BYTES as u32),
        found,
    );
    EVENT_PLACE.store(free, Ordering::Relaxed);
}

/// Writes the next event of the log to the flash, if nothing else is under way that needs it; whether another
/// one may follow.
async fn keep_event() -> bool {
    let is_idle = matches!(
        state(),
        UpdateState::Nothing
            | UpdateState::Confirmed
            | UpdateState::NotInstalled
            | UpdateState::RolledBack
            | UpdateState::Refused(_)
    ) && !settings::is_keeping();
    let Some((number, event)) = event_log::next_to_keep().filter(|_| is_idle) else {
        return false;
    };
    let place = EVENT_PLACE.load(Ordering::Relaxed);
    if place < EVENT_PLACES {
        // A place that was tried is not tried again: its word may be half written.
        EVENT_PLACE.store(place + 1, Ordering::Relaxed);
        let address = EVENTS + place * WORD_BYTES as u32;
        if flash::write_word(address, &kept_events::record(number, event))
            .await
            .is_ok()
        {
            event_log::are_kept(number + 1);
        }
        return true;
    }
    if allowed().is_ok() {
        // Nobody uses the amplifier: there is time for an erase.
        set(UpdateState::Erasing);
        set(match forget_journal().await {
            Ok(()) => UpdateState::Nothing,
            Err(reason) => UpdateState::Refused(reason),
        });
    }
    false
}

/// This image has been healthy for a second.
pub fn healthy() {
    WANTED.signal(Wanted::Mark(Mark::Healthy));
}

/// The flash is idle, and nobody uses the amplifier.
fn allowed() -> Result<(), UpdateRefusal> {
    if control::powered() || !control::drive_rests() {
        Err(UpdateRefusal::NotDisarmed)
    } else if is_busy() || settings::is_keeping() || is_on_trial() {
        Err(UpdateRefusal::Busy)
    } else {
        Ok(())
    }
}

/// Makes room for an image of so many bytes.
pub fn begin(bytes: u32) -> Result<(), UpdateRefusal> {
    allowed()?;
    if bytes == 0 || bytes > H743ZI.image_bytes || bytes % WORD_BYTES as u32 != 0 {
        return Err(UpdateRefusal::NoImage);
    }
    LENGTH.store(bytes, Ordering::Relaxed);
    STORED.store(0, Ordering::Relaxed);
    set(UpdateState::Erasing);
    WANTED.signal(Wanted::Begin);
    Ok(())
}

/// Takes the next word of the image; `false`: not yet, the one before it is being programmed.
pub fn take(piece: &BlockPiece) -> Result<bool, UpdateRefusal> {
    if WANTED.signaled() {
        return Ok(false);
    }
    let UpdateState::Receiving { stored } = state() else {
        return if is_busy() {
            Ok(false)
        } else {
            Err(UpdateRefusal::NoImage)
        };
    };
    allowed()?;
    // Pieces come in order; one that came before the last one stands in flash is early, not wrong.
    let taken = STORED.load(Ordering::Relaxed);
    if taken != stored {
        return Ok(false);
    }
    let offset = piece.offset() as u32;
    let Some(word) = piece
        .bytes()
        .first_chunk::<WORD_BYTES>()
        .filter(|_| offset == stored && offset < LENGTH.load(Ordering::Relaxed))
    else {
        return Err(UpdateRefusal::NoImage);
    };
    STORED.store(stored + WORD_BYTES as u32, Ordering::Relaxed);
    WANTED.signal(Wanted::Word {
        offset,
        word: *word,
    });
    Ok(true)
}

/// The image has come; the host names its authentication code.
pub fn commit(code: &AuthenticationCode) -> Result<bool, UpdateRefusal> {
    if WANTED.signaled() || STORED.load(Ordering::Relaxed) != received() {
        return Ok(false);
    }
    allowed()?;
    if !matches!(state(), UpdateState::Receiving { .. }) {
        return Err(UpdateRefusal::NoImage);
    }
    set(UpdateState::Verifying);
    WANTED.signal(Wanted::Commit { code: *code });
    Ok(true)
}

/// Bytes that stand in flash.
fn received() -> u32 {
    match state() {
        UpdateState::Receiving { stored } => stored,
        _ => STORED.load(Ordering::Relaxed),
    }
}

/// Writes what comes.
#[embassy_executor::task]
pub async fn updater() {
    loop {
        let wanted = match select(WANTED.wait(), task_clock::periods(KEEPS_EVERY)).await {
            Either::First(wanted) => wanted,
            Either::Second(()) => {
                while keep_event().await {}
                continue;
            }
        };
        let next = match wanted {
            Wanted::Begin => make_room()
                .await
                .map(|()| UpdateState::Receiving { stored: 0 }),
            Wanted::Word { offset, word } => {
                let stored = offset + WORD_BYTES as u32;
                flash::write_word(H743ZI.incoming + offset, &word)
                    .await
                    .map(|()| UpdateState::Receiving { stored })
            }
            Wanted::Commit { code } => request(code).await.map(|()| {
                defmt::info!("update: an image is ready: `restart` installs it");
                UpdateState::Ready
            }),
            Wanted::Mark(mark) => {
                match flash::write_word(mark.address(H743ZI.journal), &MARKED).await {
                    Ok(()) if mark == Mark::Healthy => {
                        defmt::info!("update: this image has been healthy for a second and stays");
                        Ok(UpdateState::Confirmed)
                    }
                    Ok(()) => continue,
                    // A mark of health that cannot be set: the watch of the trial restarts the part.
                    Err(reason) => {
                        defmt::error!("update: the journal: {=str}", reason);
                        continue;
                    }
                }
            }
        };
        set(next.unwrap_or_else(|reason| {
            defmt::warn!("update refused: {=str}", reason);
            UpdateState::Refused(reason)
        }));
    }
}

/// The key under which images are taken.
fn key() -> Result<UpdateKey, &'static str> {
    UpdateKey::read(word(H743ZI.key))
        .ok_or("the board has no key: it takes images over the debug probe")
}

/// Erases the journal, and with it the events beside it, which are written again from the memory.
async fn forget_journal() -> Result<(), &'static str> {
    // A request that is not one any more cannot come back while the sector is erased half.
    if journal(H743ZI.journal, word).1.is_some() {
        flash::write_word(H743ZI.journal, &MARKED).await?;
    }
    event_log::are_kept(0);
    flash::erase_sector(H743ZI.journal).await?;
    EVENT_PLACE.store(0, Ordering::Relaxed);
    Ok(())
}

/// Forgets what was before and erases the room for the image.
async fn make_room() -> Result<(), &'static str> {
    key()?;
    forget_journal().await?;
    for sector in (0..LENGTH.load(Ordering::Relaxed)).step_by(H743ZI.sector_bytes as usize) {
        flash::erase_sector(H743ZI.incoming + sector).await?;
    }
    Ok(())
}

/// Looks at what stands in flash and requests its start.
async fn request(code: AuthenticationCode) -> Result<(), &'static str> {
    let bytes = LENGTH.load(Ordering::Relaxed);
    if STORED.load(Ordering::Relaxed) != bytes {
        return Err("pieces are missing");
    }
    let mut authentication = key()?.authenticate();
    for (nth, offset) in (0..bytes).step_by(WORD_BYTES).enumerate() {
        authentication
            .update(&word(H743ZI.incoming + offset).ok_or("a word of the flash is damaged")?);
        if nth % WORDS_AT_ONCE == 0 {
            yield_now().await;
        }
    }
    if authentication.code() != code {
        return Err("what came is not signed with the board's key");
    }
    let (length, header) = header(H743ZI.incoming).ok_or("it is no image of this project")?;
    if header.board != HEADER.board || header.front_end != HEADER.front_end || length > bytes {
        return Err("it is an image for another board or other converters");
    }
    let lowest = running().and_then(|running| running.release());
    if header.release() < lowest && !OLDER_MAY_COME.load(Ordering::Relaxed) {
        return Err(
            "its version is lower than the running image's: `update older` at the probe allows it until a restart",
        );
    }
    let request = Request { bytes, code };
    flash::write_word(H743ZI.journal, &request.word()).await?;
    if journal(H743ZI.journal, word).1 == Some(request) {
        Ok(())
    } else {
        Err("the request does not read back")
    }
}
