//! The parameter blocks in flash: two sectors of the flash, the newest and the last good one beside it.
//!
//! A block is written by the probe to either address, or brought line by line as a command: then it is verified before anything is
//! touched, gets a generation that counts up, goes where the block in use is not, and is read back. At start the valid block of the
//! highest generation is taken, A before B, and the reason why a block was refused is said; a block that the supply cut off while it was
//! written is only unreadable ([`crate::flash_read`]). So a block that was damaged on its way or in
//! flash leaves the last good one in force.

use core::cell::Cell;
use core::sync::atomic::{AtomicU8, AtomicU16, AtomicU32, Ordering};

use embassy_sync::blocking_mutex::ThreadModeMutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_sync::signal::Signal;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_text::BlockPiece;
use hysteron_core::parameter_block::{AmplifierParameters, BLOCK_BYTES, BlockError, fingerprint, generation, read, set_generation};
use hysteron_protocol::device::Brought;

use crate::board::{Board, Converters, Platform};
use crate::front_end::{CodeBits, FrontEnd};
use crate::{control, flash_read};

/// Names and addresses of the blocks A and B.
const BLOCKS: [(&str, u32); 2] = Board::BLOCKS;

/// Bytes of a block with its header and checksum, at most.
const KEPT_BYTES: usize = BLOCK_BYTES + 64;

/// Which of [`BLOCKS`] is in use; none: 2. And its generation.
static IN_USE: AtomicU8 = AtomicU8::new(2);
static GENERATION: AtomicU16 = AtomicU16::new(0);
/// What tells the block in use from others; none: 0.
static FINGERPRINT: AtomicU32 = AtomicU32::new(0);
/// The same of a block that was swapped in and stands in no flash; none: 0.
static SWAPPED: AtomicU32 = AtomicU32::new(0);
/// What has become of the block that was brought last.
static BROUGHT: ThreadModeMutex<Cell<Brought>> = ThreadModeMutex::new(Cell::new(Brought::Nothing));

/// Generation of the block in use (0: it was swapped in, and is not kept), and what tells it from others; zeros without one.
pub fn in_use() -> (u32, u32) {
    let swapped = SWAPPED.load(Ordering::Relaxed);
    if swapped != 0 {
        return (0, swapped);
    }
    (u32::from(GENERATION.load(Ordering::Relaxed)), FINGERPRINT.load(Ordering::Relaxed))
}

/// What has become of the block that was brought last.
pub fn brought() -> Brought {
    BROUGHT.lock(Cell::get)
}

/// A copy of what is kept at an address.
fn kept(address: u32) -> Result<[u8; KEPT_BYTES], BlockError> {
    let mut bytes = [0; KEPT_BYTES];
    flash_read::copy(address, &mut bytes).map_err(|word| {
        defmt::warn!("the flash word at {=u32:#x} is damaged", word.0);
        BlockError::Unreadable
    })?;
    Ok(bytes)
}

/// Reads a block and asks whether this image's converters have its codes.
fn fitting(bytes: &[u8], sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let parameters = read(bytes, sample_rate_hz)?;
    let fits = Converters::has(CodeBits::of(&parameters.servo.converters));
    if fits { Ok(parameters) } else { Err(BlockError::Mismatch) }
}

/// The valid block of the highest generation.
pub fn load(sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let mut first_error = None;
    let mut newest: Option<(u8, u16, u32, AmplifierParameters)> = None;
    for (nth, (name, address)) in (0..).zip(BLOCKS) {
        match kept(address).and_then(|bytes| Ok((generation(&bytes), fingerprint(&bytes), fitting(&bytes, sample_rate_hz)?))) {
            Ok((this, print, parameters)) => {
                if newest.as_ref().is_none_or(|(_, before, ..)| this > *before) {
                    newest = Some((nth, this, print.unwrap_or(0), parameters));
                }
            }
            Err(error) => {
                defmt::warn!("parameter block {=str} refused: {=str}", name, error.reason());
                first_error.get_or_insert(error);
            }
        }
    }
    let Some((nth, this, print, parameters)) = newest else { return Err(first_error.unwrap_or(BlockError::Absent)) };
    IN_USE.store(nth, Ordering::Relaxed);
    GENERATION.store(this, Ordering::Relaxed);
    FINGERPRINT.store(print, Ordering::Relaxed);
    defmt::info!("parameter block {=str} taken", BLOCKS.get(usize::from(nth)).map_or("", |(name, _)| name));
    Ok(parameters)
}

/// A block on its way. [`keeper`] has it while it is being kept.
static UPLOAD: Mutex<ThreadModeRawMutex, Upload> = Mutex::new(Upload { bytes: heapless::Vec::new(), length: 0 });
static WANTED: Signal<ThreadModeRawMutex, Wanted> = Signal::new();
const BUSY: &str = "a block is being kept";

/// What is to be done with it.
#[derive(Clone, Copy)]
enum Wanted {
    /// Into the flash.
    Keep,
    /// In the place of the running one.
    Swap,
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
    if upload.length > KEPT_BYTES { Err("larger than any block") } else { Ok(()) }
}

/// Takes the next piece.
pub fn take(piece: &BlockPiece) -> Result<(), &'static str> {
    let mut upload = UPLOAD.try_lock().map_err(|_| BUSY)?;
    if piece.offset() != upload.bytes.len() || upload.bytes.len() + piece.bytes().len() > upload.length {
        return Err("a piece is missing or too much");
    }
    upload.bytes.extend_from_slice(piece.bytes()).map_err(|_| "larger than any block")
}

/// Lets [`keeper`] verify what came and keep it.
pub fn keep() {
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Keep);
}

/// Lets [`keeper`] verify what came and put it in the place of the running block; it is not kept.
pub fn swap() {
    BROUGHT.lock(|brought| brought.set(Brought::Busy));
    WANTED.signal(Wanted::Swap);
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
            Wanted::Swap => upload.swap(sample_rate_hz).await.map(|()| {
                defmt::info!("block swapped in; it is not kept");
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

    /// Verifies what came and lets it take the place of the running block.
    async fn swap(&self, sample_rate_hz: u32) -> Result<(), &'static str> {
        control::offer(&self.verified(sample_rate_hz)?);
        control::swapped().await?;
        SWAPPED.store(fingerprint(&self.bytes).unwrap_or(0), Ordering::Relaxed);
        Ok(())
    }

    /// Verifies what came and keeps it; returns the name of its place.
    async fn commit(&mut self, sample_rate_hz: u32) -> Result<&'static str, &'static str> {
        let parameters = self.verified(sample_rate_hz)?;
        let in_use = usize::from(IN_USE.load(Ordering::Relaxed));
        let newest = GENERATION.load(Ordering::Relaxed);
        let (name, address) = if in_use == 0 { BLOCKS[1] } else { BLOCKS[0] };
        set_generation(&mut self.bytes, newest.checked_add(1).ok_or("the generations are used up: erase both blocks")?)
            .map_err(BlockError::reason)?;
        Board::write_sector(address, &self.bytes).await?;
        if kept(address).and_then(|bytes| read(&bytes, sample_rate_hz)) == Ok(parameters) {
            Ok(name)
        } else {
            Err("what was written does not read back")
        }
    }
}

/// What runs without a valid block: nothing but rest, at this drive code of so many bits.
pub fn safe_parameters(sample_rate_hz: u32, rest: DriveCode, bits: CodeBits) -> AmplifierParameters {
    use hysteron_core::guard::GuardParameters;
    use hysteron_core::parameter_block::PhysicalDescription;
    use hysteron_core::sensor_lag::SensorLag;
    use hysteron_core::servo_parameters::{ActuatorParameters, ConverterParameters, LawParameters, ServoParameters};
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
    }
}
