//! The parameter blocks in flash, two sectors for the one in force and the last good one beside it, and the
//! safety envelope in a third.
//!
//! A block is written by the probe to either address, or brought line by line as a command: then it is
//! verified before anything is touched, gets a generation that counts up, goes where the block in use is not,
//! is read back, and the other one is marked as replaced. Which of two valid blocks is in force says
//! [`block_choice`]; where neither is marked nothing is driven. The log gives the reason why a block was
//! refused; a block that the supply cut off while it was written is only unreadable ([`flash_read`]).
//! So a block that was damaged on its way or in flash leaves the last good one in force.
//!
//! What the operator asks to keep (`WPA`) stands in a sector of its own. Where it is damaged nothing arms
//! before the operator has cleared that fault.
//!
//! The envelope comes by the same lines, and is kept by a command that names its checksum. No block that
//! exceeds it is taken, and without one nothing is.

use core::cell::Cell;
use core::sync::atomic::{AtomicU8, AtomicU16, AtomicU32, Ordering};

use embassy_sync::blocking_mutex::ThreadModeMutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_sync::signal::Signal;
use hysteron_core::amplifier::Amplifier;
use hysteron_core::block_choice::{self, Choice, Kept};
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_text::BlockPiece;
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::kept_settings::{self, KeptSettings, SETTINGS_BYTES};
use hysteron_core::loop_margin::{LoopMargin, NO_MARGIN};
use hysteron_core::parameter_block::{
    AmplifierParameters, BLOCK_BYTES, fingerprint, generation, read, set_generation,
};
use hysteron_core::safety_envelope::{self, ENVELOPE_BYTES, SafetyEnvelope};
use hysteron_core::signal_filter::{FilteredSignal, Place};
use hysteron_core::stepping_parameters::IfStepping;
use hysteron_core::wire::BlockError;
use hysteron_firmware_shared::flash_read;
use hysteron_protocol::device::Brought;

use crate::board::{Board, Converters, Platform, TEMPERATURES_ARE_READ};
use crate::front_end::{CodeBits, FrontEnd};
use crate::{control, update_state};

/// Names and addresses of the blocks A and B.
const BLOCKS: [(&str, u32); 2] = Board::BLOCKS;

/// Bytes of a block with its header and checksum, at most: what a sector has before the mark of a replaced
/// one.
const KEPT_BYTES: usize = {
    let (block, sector) = (
        BLOCK_BYTES + 64,
        (Board::SECTOR_BYTES - MARK_BYTES) as usize,
    );
    if block < sector { block } else { sector }
};
/// Bytes of the mark at the end of a sector: ones as erased, or zeros.
const MARK_BYTES: u32 = 32;

/// Which of [`BLOCKS`] is in use; none: 2. And its generation.
static IN_USE: AtomicU8 = AtomicU8::new(2);
static GENERATION: AtomicU16 = AtomicU16::new(0);
/// What tells the block in use from others; none: 0.
static FINGERPRINT: AtomicU32 = AtomicU32::new(0);
/// The same of a block that was swapped in and stands in no flash; none: 0.
static SWAPPED: AtomicU32 = AtomicU32::new(0);
/// The highest generation of both places.
static NEWEST: AtomicU16 = AtomicU16::new(0);
/// The envelope in force.
static ENVELOPE: ThreadModeMutex<Cell<Option<SafetyEnvelope>>> =
    ThreadModeMutex::new(Cell::new(None));
/// What the operator kept, as it was at the start.
static KEPT: ThreadModeMutex<Cell<Option<KeptSettings>>> = ThreadModeMutex::new(Cell::new(None));
/// What the loop of the running block bears, and the filter of the sensor that it has to; `None` before the
/// start.
static LOOP: ThreadModeMutex<Cell<Option<(LoopMargin, FilterSetting)>>> =
    ThreadModeMutex::new(Cell::new(None));
/// What has become of the block that was brought last.
static BROUGHT: ThreadModeMutex<Cell<Brought>> = ThreadModeMutex::new(Cell::new(Brought::Nothing));

/// Generation of the block in use (0: swapped in, in memory only), and what identifies it; zeros without one.
pub fn in_use() -> (u32, u32) {
    let swapped = SWAPPED.load(Ordering::Relaxed);
    if swapped != 0 {
        return (0, swapped);
    }
    (
        u32::from(GENERATION.load(Ordering::Relaxed)),
        FINGERPRINT.load(Ordering::Relaxed),
    )
}

/// What has become of the block that was brought last.
pub fn brought() -> Brought {
    BROUGHT.lock(Cell::get)
}

/// A copy of what is kept at an address.
fn kept(address: u32) -> Result<[u8; KEPT_BYTES], BlockError> {
    let mut bytes = [0; KEPT_BYTES];
    flash_read::copy::<Board>(address, &mut bytes).map_err(|word| {
        defmt::warn!("the flash word at {=u32:#x} is damaged", word.0);
        BlockError::Unreadable
    })?;
    Ok(bytes)
}

/// Reads a block and asks whether this image's converters have its codes, and whether it stays within the
/// safety envelope.
fn fitting(bytes: &[u8], sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let parameters = read(bytes, sample_rate_hz)?;
    if !Converters::has(CodeBits::of(&parameters)) {
        return Err(BlockError::Mismatch);
    }
    let envelope = envelope().ok_or(BlockError::NoEnvelope)?;
    envelope
        .admits(&parameters)
        .map_err(BlockError::BeyondEnvelope)?;
    Ok(parameters)
}

/// The envelope in force.
pub fn envelope() -> Option<SafetyEnvelope> {
    ENVELOPE.lock(Cell::get)
}

/// Whether this image's converters are those that an envelope is for, and can be watched as it says.
fn fits_converters(envelope: &SafetyEnvelope) -> Result<(), &'static str> {
    if envelope.dac_bits != Converters::BITS.dac {
        return Err("made for a drive's converter of other bits");
    }
    if (envelope.drive_reads_back && !Converters::READS_BACK)
        || (envelope.monitor_span_uv > 0 && !Converters::HAS_MONITOR)
        || (envelope.set_point_span_nm > 0 && !Converters::HAS_SET_POINT)
        || (envelope.amplifier_span_decicelsius != 0
            && !(Converters::HAS_MONITOR && TEMPERATURES_ARE_READ))
    {
        return Err(
            "the drive's converter is to be read back, the output watched, a set point or a temperature read, and this board cannot at this sampling rate",
        );
    }
    Ok(())
}

/// Looks for the envelope.
pub fn load_envelope() -> Option<SafetyEnvelope> {
    let mut bytes = [0; ENVELOPE_BYTES];
    let found = flash_read::copy::<Board>(Board::ENVELOPE, &mut bytes)
        .map_err(|_| BlockError::Unreadable)
        .and_then(|()| safety_envelope::read(&bytes));
    // For the codes of another converter it says nothing.
    let found = found.and_then(|envelope| {
        fits_converters(&envelope)
            .map(|()| envelope)
            .map_err(BlockError::Range)
    });
    match found {
        Ok(envelope) => {
            let millivolts = |code| (envelope.drive_uv(code) / 1000) as i32;
            defmt::info!(
                "safety envelope: {=i32} to {=i32} mV, rest {=i32} mV, checksum {=u32:#010x}",
                millivolts(envelope.drive_min),
                millivolts(envelope.drive_max),
                millivolts(envelope.safe_code),
                safety_envelope::fingerprint(&envelope)
            );
            ENVELOPE.lock(|place| place.set(Some(envelope)));
            Some(envelope)
        }
        Err(error) => {
            defmt::error!(
                "no safety envelope ({=str}): nothing is driven",
                error.reason()
            );
            None
        }
    }
}

/// Looks for what the operator kept; `false` where something is kept that cannot be used. Safety hangs on it.
pub fn load_kept(sample_rate_hz: u32) -> bool {
    let mut bytes = [0; SETTINGS_BYTES];
    let found = flash_read::copy::<Board>(Board::KEPT_SETTINGS, &mut bytes)
        .map_err(|_| BlockError::Unreadable);
    match found.and_then(|()| kept_settings::read(&bytes, sample_rate_hz)) {
        Ok(settings) => KEPT.lock(|place| place.set(Some(settings))),
        Err(BlockError::Absent) if bytes.iter().all(|byte| *byte == 0xFF) => {}
        Err(error) => {
            defmt::error!("kept settings refused: {=str}", error.reason());
            return false;
        }
    }
    true
}

/// What the operator kept, as it was at the start.
pub fn kept_settings() -> Option<KeptSettings> {
    KEPT.lock(Cell::get)
}

/// Gives an amplifier the filters that were kept for its stage; `false` where its loop does not bear them.
pub fn filter(amplifier: &mut Amplifier, sample_rate_hz: u32) -> bool {
    let (stage, margin) = (
        amplifier.parameters().physical.name,
        amplifier.parameters().loop_margin(),
    );
    let kept = kept_settings().filter(|kept| kept.stage == stage);
    let bears = |kept: &KeptSettings| {
        let [_, sensor] = &kept.filters;
        margin.bears(sensor).is_ok()
    };
    let borne = kept.filter(bears);
    let sensor = borne.map_or(FilterSetting::OFF, |kept| kept.filters[1]);
    LOOP.lock(|place| place.set(Some((margin, sensor))));
    if kept.is_some() && borne.is_none() {
        defmt::error!("kept settings refused: {=str}", NO_MARGIN);
        KEPT.lock(|place| place.set(None));
    }
    let Some(kept) = borne else {
        return kept.is_none();
    };
    for (signal, filter) in [FilteredSignal::SetPoint, FilteredSignal::Sensor]
        .into_iter()
        .zip(kept.filters)
    {
        for place in Place::ALL {
            if let Ok(row) = filter.row(place, sample_rate_hz) {
                amplifier.set_filter(signal, place, &row);
            }
        }
    }
    true
}

/// The filter of the sensor is to be this from now on.
pub fn take_sensor_filter(filter: &FilterSetting) -> Result<(), &'static str> {
    if is_keeping() {
        return Err(BUSY);
    }
    let (margin, _) = LOOP.lock(Cell::get).ok_or(NO_MARGIN)?;
    margin.bears(filter)?;
    LOOP.lock(|place| place.set(Some((margin, *filter))));
    Ok(())
}

/// Lets [`keeper`] keep settings from the next start on.
pub fn keep_settings(settings: &KeptSettings) -> Result<(), &'static str> {
    may_write()?;
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Settings(*settings));
    Ok(())
}

/// Writes settings and reads them back.
async fn commit_settings(settings: &KeptSettings, sample_rate_hz: u32) -> Result<(), &'static str> {
    let mut bytes = [0xFF; SETTINGS_BYTES];
    kept_settings::write(settings, &mut bytes).map_err(BlockError::reason)?;
    Board::write_sector(Board::KEPT_SETTINGS, &bytes).await?;
    flash_read::copy::<Board>(Board::KEPT_SETTINGS, &mut bytes)
        .map_err(|_| BlockError::Unreadable.reason())?;
    let same = kept_settings::read(&bytes, sample_rate_hz).is_ok_and(|read| read == *settings);
    if same {
        Ok(())
    } else {
        Err("what was written does not read back")
    }
}

/// Whether the block at an address is marked as replaced.
fn is_replaced(address: u32) -> bool {
    let mut mark = [0xFF; MARK_BYTES as usize];
    let read = flash_read::copy::<Board>(address + Board::SECTOR_BYTES - MARK_BYTES, &mut mark);
    // A mark that the supply cut off was being made.
    read.is_err() || mark.iter().any(|byte| *byte != 0xFF)
}

/// The block of a place, and what the choice between two of them asks for.
fn found(nth: usize, sample_rate_hz: u32) -> Result<(Kept, u16), BlockError> {
    let (name, address) = BLOCKS[nth & 1];
    let bytes = kept(address)?;
    let generation = generation(&bytes);
    if let Err(error) = fitting(&bytes, sample_rate_hz) {
        defmt::warn!(
            "parameter block {=str} refused: {=str}",
            name,
            error.reason()
        );
        return Err(error);
    }
    Ok((
        Kept {
            fingerprint: fingerprint(&bytes).unwrap_or(0),
            replaced: is_replaced(address),
        },
        generation,
    ))
}

/// The block in force.
pub fn load(sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let places = [found(0, sample_rate_hz), found(1, sample_rate_hz)];
    let newest = places
        .iter()
        .filter_map(|place| place.ok())
        .map(|(_, generation)| generation)
        .max();
    NEWEST.store(newest.unwrap_or(0), Ordering::Relaxed);
    let [first, second] = places.map(|place| place.ok().map(|(kept, _)| kept));
    let nth = match block_choice::choose(first, second) {
        Choice::Place(nth) => nth & 1,
        Choice::Ambiguous => {
            defmt::error!("{=str}", BlockError::Ambiguous.reason());
            return Err(BlockError::Ambiguous);
        }
        Choice::Nothing => return Err(places[0].err().unwrap_or(BlockError::Absent)),
    };
    let parameters = fitting(&kept(BLOCKS[nth].1)?, sample_rate_hz)?;
    // The other place holds what somebody meant to be in force: `BLK?` says why it is not.
    if let Err(error) = places[nth ^ 1]
        && error != BlockError::Absent
    {
        BROUGHT.lock(|brought| brought.set(Brought::Refused(error.reason())));
    }
    if let Ok((kept, generation)) = places[nth] {
        IN_USE.store(nth as u8, Ordering::Relaxed);
        GENERATION.store(generation, Ordering::Relaxed);
        FINGERPRINT.store(kept.fingerprint, Ordering::Relaxed);
    }
    defmt::info!("parameter block {=str} taken", BLOCKS[nth].0);
    Ok(parameters)
}

/// A block on its way. [`keeper`] has it while it is being kept.
static UPLOAD: Mutex<ThreadModeRawMutex, Upload> = Mutex::new(Upload {
    bytes: heapless::Vec::new(),
    length: 0,
});
static WANTED: Signal<ThreadModeRawMutex, Wanted> = Signal::new();
const BUSY: &str = "a block is being kept";

/// What is to be done with it.
#[derive(Clone, Copy)]
enum Wanted {
    /// Into the flash.
    Keep,
    /// In the place of the running one.
    Swap,
    /// It is a safety envelope with this checksum; into the flash.
    Envelope(u32),
    /// Not what was brought: settings into the flash.
    Settings(KeptSettings),
}

struct Upload {
    bytes: heapless::Vec<u8, KEPT_BYTES>,
    length: usize,
}

/// Whether a restart would cut off a block that is being kept.
pub fn is_keeping() -> bool {
    brought() == Brought::Busy
}

/// A block of so many bytes follows.
pub fn begin(length: u32) -> Result<(), &'static str> {
    let mut upload = UPLOAD.try_lock().map_err(|_| BUSY)?;
    BROUGHT.lock(|brought| brought.set(Brought::Nothing));
    upload.bytes.clear();
    upload.length = length as usize;
    if upload.length > KEPT_BYTES {
        Err("larger than any block")
    } else {
        Ok(())
    }
}

/// Takes the next piece.
pub fn take(piece: &BlockPiece) -> Result<(), &'static str> {
    let mut upload = UPLOAD.try_lock().map_err(|_| BUSY)?;
    if piece.offset() != upload.bytes.len()
        || upload.bytes.len() + piece.bytes().len() > upload.length
    {
        return Err("a piece is missing or too much");
    }
    upload
        .bytes
        .extend_from_slice(piece.bytes())
        .map_err(|_| "larger than any block")
}

/// Whether something may be written to the flash: at rest, and nothing else is being written.
fn may_write() -> Result<(), &'static str> {
    if !control::drive_rests() {
        Err("only at rest")
    } else if is_keeping() {
        Err(BUSY)
    } else if update_state::is_under_way() {
        Err("an image is coming or on trial")
    } else {
        Ok(())
    }
}

/// Lets [`keeper`] verify what came and keep it.
pub fn keep() -> Result<(), &'static str> {
    may_write()?;
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Keep);
    Ok(())
}

/// Lets [`keeper`] verify what came and put it in the place of the running block, in memory only.
pub fn swap() {
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Swap);
}

/// Lets [`keeper`] verify that what came is a safety envelope with this checksum, and keep it.
pub fn keep_envelope(fingerprint: u32) -> Result<(), &'static str> {
    may_write()?;
    if control::powered() {
        return Err("only with the power stage off");
    }
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Envelope(fingerprint));
    Ok(())
}

/// Keeps blocks, and swaps them: an erase takes a second or two, and no command waits for it.
#[embassy_executor::task]
pub async fn keeper(sample_rate_hz: u32) {
    loop {
        let wanted = WANTED.wait().await;
        let mut upload = UPLOAD.lock().await;
        let done = match wanted {
            Wanted::Keep => upload.commit(sample_rate_hz).await.map(|name| {
                defmt::info!("block kept as {=str}: `restart` takes it", name);
                Brought::Kept
            }),
            Wanted::Envelope(fingerprint) => upload.commit_envelope(fingerprint).await.map(|()| {
                defmt::info!("safety envelope kept: `restart` takes it");
                Brought::Kept
            }),
            Wanted::Settings(settings) => {
                commit_settings(&settings, sample_rate_hz).await.map(|()| {
                    defmt::info!("settings kept");
                    Brought::Kept
                })
            }
            Wanted::Swap => upload.swap(sample_rate_hz).await.map(|()| {
                defmt::info!("block swapped in; the flash keeps the old one");
                Brought::Swapped
            }),
        };
        let brought = match done {
            Ok(brought) => brought,
            Err(reason) => {
                defmt::warn!("refused: block: {=str}", reason);
                Brought::Refused(reason)
            }
        };
        BROUGHT.lock(|place| place.set(brought));
    }
}

impl Upload {
    /// What came, if it is whole and valid.
    fn verified(&self, sample_rate_hz: u32) -> Result<AmplifierParameters, &'static str> {
        if self.bytes.len() != self.length {
            return Err("pieces are missing");
        }
        fitting(&self.bytes, sample_rate_hz).map_err(BlockError::reason)
    }

    /// Verifies what came and offers it for the place of the running block; what its loop bears, and the
    /// filter that it has to.
    #[inline(never)]
    fn offer(&self, sample_rate_hz: u32) -> Result<(LoopMargin, FilterSetting), &'static str> {
        let block = self.verified(sample_rate_hz)?;
        let (_, filter) = LOOP.lock(Cell::get).ok_or(NO_MARGIN)?;
        let margin = block.loop_margin();
        margin.bears(&filter)?;
        control::offer(&block);
        Ok((margin, filter))
    }

    /// Lets what came take the place of the running block.
    async fn swap(&self, sample_rate_hz: u32) -> Result<(), &'static str> {
        let bears = self.offer(sample_rate_hz)?;
        control::swapped().await?;
        LOOP.lock(|place| place.set(Some(bears)));
        SWAPPED.store(fingerprint(&self.bytes).unwrap_or(0), Ordering::Relaxed);
        Ok(())
    }

    /// Verifies what came and keeps it; returns the name of its place.
    async fn commit(&mut self, sample_rate_hz: u32) -> Result<&'static str, &'static str> {
        // The block itself is not held while it is written: what a task holds is static.
        self.verified(sample_rate_hz).map(drop)?;
        let in_use = usize::from(IN_USE.load(Ordering::Relaxed));
        let newest = NEWEST.load(Ordering::Relaxed);
        let ((name, address), (_, other)) = if in_use == 0 {
            (BLOCKS[1], BLOCKS[0])
        } else {
            (BLOCKS[0], BLOCKS[1])
        };
        set_generation(
            &mut self.bytes,
            newest
                .checked_add(1)
                .ok_or("the generations are used up: erase both blocks")?,
        )
        .map_err(BlockError::reason)?;
        Board::write_sector(address, &self.bytes).await?;
        if !kept(address).is_ok_and(|bytes| bytes.starts_with(&self.bytes)) {
            return Err("what was written does not read back");
        }
        // Only now: until here the other one is in force.
        if !is_replaced(other) {
            Board::write_mark(other + Board::SECTOR_BYTES - MARK_BYTES).await?;
        }
        NEWEST.store(newest.saturating_add(1), Ordering::Relaxed);
        Ok(name)
    }

    /// Verifies that what came is the envelope that is meant, and keeps it.
    async fn commit_envelope(&self, fingerprint: u32) -> Result<(), &'static str> {
        if self.bytes.len() != self.length {
            return Err("pieces are missing");
        }
        let envelope = safety_envelope::read(&self.bytes).map_err(BlockError::reason)?;
        if safety_envelope::fingerprint(&envelope) != fingerprint {
            return Err("the checksum that was named is another envelope's");
        }
        fits_converters(&envelope)?;
        Board::write_sector(Board::ENVELOPE, &self.bytes).await?;
        let mut bytes = [0; ENVELOPE_BYTES];
        flash_read::copy::<Board>(Board::ENVELOPE, &mut bytes)
            .map_err(|_| BlockError::Unreadable.reason())?;
        if safety_envelope::read(&bytes) == Ok(envelope) {
            Ok(())
        } else {
            Err("what was written does not read back")
        }
    }
}

/// What runs without a valid block: nothing but rest, at this drive code of so many bits.
pub fn safe_parameters(
    sample_rate_hz: u32,
    rest: DriveCode,
    bits: CodeBits,
) -> AmplifierParameters {
    use hysteron_core::guard::GuardParameters;
    use hysteron_core::loop_bands::LoopBands;
    use hysteron_core::parameter_block::PhysicalDescription;
    use hysteron_core::sensor_lag::SensorLag;
    use hysteron_core::servo_parameters::{
        ActuatorParameters, ConverterParameters, LawParameters, ServoParameters,
    };
    AmplifierParameters {
        physical: PhysicalDescription {
            name: [0; 16],
            sample_rate_hz,
            drive_min_mv: 0,
            drive_max_mv: 0,
            slew_limit_v_s: 0,
            sensor_span_nm: 0,
            spectral_radius_millionths: 0,
        },
        servo: ServoParameters {
            converters: ConverterParameters {
                adc_zero: 0,
                adc_step: 0,
                dac_zero: 0,
                dac_step: 0,
                dac_codes_per_volt: 0,
                dac_code_min: rest,
                dac_code_max: rest,
                slew_codes: 1,
                adc_bits: bits.adc,
                dac_bits: bits.dac,
                noise_shaping: false,
            },
            actuator: ActuatorParameters::Direct,
            law: LawParameters::Hold,
            delayed: true,
            sensor_lag: SensorLag::NONE,
            learning: None,
            adaptation: None,
        },
        guard: GuardParameters {
            adc_code_min: SensorCode::new(0),
            adc_code_max: SensorCode::highest(bits.adc),
            stuck_ticks: 0,
            jump_codes: u32::MAX,
            tracking_error: i32::MAX,
            tracking_ticks: u16::MAX,
            ramp_codes: 1,
            rest_code: rest,
            // 0.1 s, then a fault of the last run can be cleared; that there is no block cannot.
            healthy_ticks: (sample_rate_hz / 10) as u16,
        },
        loop_bands: LoopBands::OPEN,
        stepping: IfStepping::NONE,
    }
}
