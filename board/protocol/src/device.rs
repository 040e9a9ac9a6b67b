//! What a session needs of whatever carries the amplifier.

use hysteron_core::amplifier::Mode;
use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::command_text::BlockPiece;
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::firmware_update::{AuthenticationCode, ImageHeader};
use hysteron_core::guard::Fault;
use hysteron_core::kept_settings::KeptSettings;
use hysteron_core::loop_telemetry::{LoopFigures, ResonanceWatch};
use hysteron_core::safety_envelope::SafetyEnvelope;
use hysteron_core::set_point::InputState;
use hysteron_core::trace_frame::TraceSample;

/// The amplifier as of the last tick that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// Ticks since the start. They never wrap: an instant of this morning is not one of tomorrow.
    pub tick: u64,
    /// What it is doing.
    pub mode: Mode,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// The sensor's code.
    pub adc_code: SensorCode,
    /// The drive's code.
    pub dac_code: DriveCode,
    /// What the amplifier's voltage monitor reads, of 65,536; `None` without one, or if it did not answer.
    pub monitor_code: Option<u16>,
    /// What the analogue set point reads, of 65,536; `None` without one, or if it did not answer.
    pub set_point_code: Option<u16>,
    /// What the loop has of it.
    pub input: InputState,
    /// The reference, um with 24 fraction bits; of a stick-slip drive the target, with 16.
    pub reference: i32,
    /// Position of a stick-slip drive along its travel, um with 16 fraction bits.
    pub travel: Option<i32>,
    /// Position at the sensor's code 0 as it was found last, um with 24 fraction bits.
    pub adc_zero: i32,
    /// Whether the sensor has been zeroed since the start.
    pub zeroed: bool,
    /// Whether the actuator has been conditioned since the start and the last fault.
    pub conditioned: bool,
    /// Whether the power stage is on.
    pub powered: bool,
    /// Whether something may be played and closed.
    pub armed: bool,
    /// Whether the servo is switched on only behind a conditioning.
    pub conditioning_required: bool,
    /// Ticks for which the tracking error has been within the tolerance without a break.
    pub on_target_ticks: u32,
}

/// What has become of the parameter block that was brought last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brought {
    /// None was brought since the start, or not all of it yet.
    Nothing,
    /// It is being verified and kept.
    Busy,
    /// It is kept, and a restart takes it.
    Kept,
    /// It has taken the place of the running one, in memory only.
    Swapped,
    /// It was refused for this reason.
    Refused(&'static str),
}

/// How far an update of the image is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateState {
    /// The board cannot be updated over the line.
    Unsupported,
    /// No image was brought.
    Nothing,
    /// Room is being made for one.
    Erasing,
    /// So many bytes of it stand in flash.
    Receiving {
        /// Bytes.
        stored: u32,
    },
    /// It is being looked at.
    Verifying,
    /// The next start installs it.
    Ready,
    /// It was refused for this reason.
    Refused(&'static str),
    /// The running image has not been healthy for a second yet.
    Trial,
    /// The running image was brought over the line and has been healthy.
    Confirmed,
    /// The image that was brought was not installed.
    NotInstalled,
    /// It was installed and did not become healthy: the one before it runs.
    RolledBack,
}

/// Why a step of an update is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateRefusal {
    /// The board cannot be updated over the line.
    Unsupported,
    /// The power stage is on, or the drive does not rest.
    NotDisarmed,
    /// The flash is being written, or the running image is on trial.
    Busy,
    /// A length, a place or an order that no image has.
    NoImage,
}

/// Counts since the start, and the block in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceDiagnosis {
    /// Ticks at which the sensor's code was at or beyond the limits of the sensor.
    pub railed_ticks: u32,
    /// Ticks of the closed loop at which the drive was at a limit.
    pub limited_ticks: u32,
    /// Values of the law that left their format and were cut.
    pub saturated_values: u32,
    /// Ticks that came late.
    pub overruns: u32,
    /// Samples that found no room on their way from the control tick.
    pub lost_samples: u32,
    /// Generation of the block in use; 0: a swapped block, which is only in memory, or no block.
    pub block_generation: u32,
    /// Its checksum; 0 without a block.
    pub block_checksum: u32,
    /// What the part's option bytes protect: 1 the brown-out level, 2 the watchdog that starts with the
    /// supply, 3 both.
    pub protection: u32,
    /// Gain of the actuator over the model's as the servo adapted it, millionths; 0: the block does not let
    /// it.
    pub adapted_gain_millionths: u32,
    /// The part's temperature, tenths of a degree Celsius; `None` where nothing has read it.
    pub part_decicelsius: Option<i32>,
    /// The amplifier's, in the same way.
    pub amplifier_decicelsius: Option<i32>,
}

/// A fault of the past.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceEvent {
    /// The start of the program in which it was, counted since the supply was switched on.
    pub start: u32,
    /// The tick at which it was latched.
    pub tick: u32,
    /// Which one.
    pub fault: Fault,
}

/// What carries the amplifier.
pub trait Device {
    /// The amplifier's state.
    fn view(&self) -> View;

    /// From now on a tracking error up to this is within the tolerance, um with 24 fraction bits, or 16 of a
    /// stick-slip drive.
    fn set_tolerance(&mut self, tolerance: i32);

    /// Samples for which the recorder has room.
    fn recorder_room(&self) -> u32;

    /// Begins to record every so many ticks; what was recorded before is forgotten.
    fn record(&mut self, every_ticks: u32);

    /// Begins to record every so many ticks, at the tick behind the one at which the next command acts; what
    /// was recorded before is forgotten. So a drive that is held for as many ticks does not change between
    /// two samples.
    fn record_from_command(&mut self, every_ticks: u32);

    /// Samples recorded so far.
    fn recorded(&self) -> u32;

    /// Ends the recording where it is, so that it can be read.
    fn end_recording(&mut self);

    /// A recorded sample, oldest first; `None` beyond the last, or before the recording has ended.
    fn sample(&self, nth: u32) -> Option<TraceSample>;

    /// A parameter block of so many bytes follows.
    ///
    /// # Errors
    /// Why not.
    fn begin_block(&mut self, bytes: u32) -> Result<(), &'static str>;

    /// Takes a piece of it; pieces come in order.
    ///
    /// # Errors
    /// Why not.
    fn take_block(&mut self, piece: &BlockPiece) -> Result<(), &'static str>;

    /// Lets the block be verified and kept, which takes seconds.
    ///
    /// # Errors
    /// The drive does not rest.
    fn keep_block(&mut self) -> Result<(), Moving>;

    /// Lets the block be verified and take the place of the running one, at rest or with the loop closed,
    /// within milliseconds.
    fn swap_block(&mut self);

    /// Lets what was brought be verified as the safety envelope with this checksum, and kept.
    ///
    /// # Errors
    /// The drive does not rest, or the power stage is on.
    fn keep_envelope(&mut self, fingerprint: u32) -> Result<(), Moving>;

    /// The safety envelope in force.
    fn envelope(&self) -> Option<SafetyEnvelope>;

    /// The fault so many before the last one that was latched; `None` beyond the oldest that is kept.
    fn event(&self, before_last: u32) -> Option<DeviceEvent>;

    /// What the operator asked to keep, as it was at the start; `None` where nothing is kept.
    fn kept_settings(&self) -> Option<KeptSettings>;

    /// Lets settings be kept from the next start on, which takes seconds; [`Device::brought`] says what has
    /// become of them.
    ///
    /// # Errors
    /// The drive does not rest, or something is being kept.
    fn keep_settings(&mut self, settings: &KeptSettings) -> Result<(), Moving>;

    /// What has become of it.
    fn brought(&self) -> Brought;

    /// Restarts with the newest valid block, once what is being sent has gone.
    ///
    /// # Errors
    /// The drive does not rest, or a block is being kept.
    fn restart(&mut self) -> Result<(), Moving>;

    /// What the running image says of itself; `None` where it has no header.
    fn image(&self) -> Option<ImageHeader> {
        None
    }

    /// How far an update is.
    fn update(&self) -> UpdateState {
        UpdateState::Unsupported
    }

    /// Makes room for an image of so many bytes, which takes seconds.
    ///
    /// # Errors
    /// Why not.
    fn begin_update(&mut self, _bytes: u32) -> Result<(), UpdateRefusal> {
        Err(UpdateRefusal::Unsupported)
    }

    /// Takes the next piece of it; `false`: ask again, the one before it is being written.
    ///
    /// # Errors
    /// Why not.
    fn take_update(&mut self, _piece: &BlockPiece) -> Result<bool, UpdateRefusal> {
        Err(UpdateRefusal::Unsupported)
    }

    /// Lets the image be verified against its authentication code and installed by the next start; `false` as
    /// for a piece.
    ///
    /// # Errors
    /// Why not.
    fn commit_update(&mut self, _code: &AuthenticationCode) -> Result<bool, UpdateRefusal> {
        Err(UpdateRefusal::Unsupported)
    }

    /// The filter of the sensor is to be this from now on. A block that is swapped in must bear it as well.
    ///
    /// # Errors
    /// The loop has no margin for it ([`hysteron_core::loop_margin`]), or another block is being verified.
    fn take_sensor_filter(&mut self, filter: &FilterSetting) -> Result<(), &'static str>;

    /// For how many ticks no line may come while the drive is live; 0: for ever.
    fn host_timeout(&self) -> u32;

    /// Changes it.
    fn set_host_timeout(&mut self, ticks: u32);

    /// The line's speed, bit/s.
    fn baud(&self) -> u32;

    /// Changes it once what is being sent has gone.
    fn set_baud(&mut self, baud: u32);

    /// Counts since the start, and the block in use.
    fn diagnosis(&self) -> DeviceDiagnosis;

    /// How well the closed loop followed over the last whole window of [`hysteron_core::loop_telemetry`].
    fn loop_figures(&self) -> LoopFigures;

    /// Which resonance is listened to.
    fn resonance_watch(&self) -> ResonanceWatch;

    /// Listens to another one from now on; none after a start.
    ///
    /// # Errors
    /// It cannot be listened to; nothing has changed then.
    fn listen(&mut self, watch: ResonanceWatch) -> Result<(), &'static str>;
}

/// The drive does not rest, and that is only done at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Moving;
