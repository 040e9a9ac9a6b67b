//! What a session needs of whatever carries the amplifier.

use hysteron_core::amplifier::Mode;
use hysteron_core::guard::Fault;
use hysteron_core::trace_frame::TraceSample;

/// The amplifier as of the last tick that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// The tick.
    pub tick: u32,
    /// What it is doing.
    pub mode: Mode,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// The sensor's code.
    pub adc_code: u16,
    /// The drive's code.
    pub dac_code: u16,
    /// The reference, um with 24 fraction bits.
    pub reference: i32,
    /// Position at the sensor's code 0 as it was found last, um with 24 fraction bits.
    pub adc_zero: i32,
    /// Whether the sensor has been zeroed since the start.
    pub zeroed: bool,
    /// Ticks for which the tracking error has been within the tolerance without a break.
    pub on_target_ticks: u32,
}

/// What carries the amplifier.
pub trait Device {
    /// The amplifier's state.
    fn view(&self) -> View;

    /// From now on a tracking error up to this is within the tolerance, um with 24 fraction bits.
    fn set_tolerance(&mut self, tolerance: i32);

    /// Samples for which the recorder has room.
    fn recorder_room(&self) -> u32;

    /// Begins to record every so many ticks; what was recorded before is forgotten.
    fn record(&mut self, every_ticks: u32);

    /// Samples recorded so far.
    fn recorded(&self) -> u32;

    /// Ends the recording where it is, so that it can be read.
    fn end_recording(&mut self);

    /// A recorded sample, oldest first; `None` beyond the last, or before the recording has ended.
    fn sample(&self, nth: u32) -> Option<TraceSample>;
}
