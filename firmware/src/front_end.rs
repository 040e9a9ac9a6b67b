//! The analogue front end: what the control interrupt needs of converters, whichever they are.
//!
//! A front end gives the sensor's code of the latest edge of the sample clock, and takes a drive code that
//! acts at the next edge. Codes have the bits that the parameter block says ([`CodeBits`]), or those of the
//! converters themselves. A drive's converter with more is given the rest as zeros.

use hysteron_core::codes::{DriveCode, SensorCode};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::safety_envelope::SafetyEnvelope;

/// Bits of the codes on this side.
#[derive(Clone, Copy)]
pub struct CodeBits {
    /// Of the sensor's.
    pub adc: u8,
    /// Of the drive's.
    pub dac: u8,
}

impl CodeBits {
    /// Those of a block.
    pub fn of(parameters: &AmplifierParameters) -> Self {
        Self {
            adc: parameters.reading_bits(),
            dac: parameters.servo.converters.dac_bits,
        }
    }
}

/// How the converters are wired, as far as their codes do not show it: what the safety envelope says.
#[derive(Clone, Copy, Default)]
pub struct Wiring {
    /// The sensor's converter gives two's complement.
    pub sensor_is_signed: bool,
    /// From the lower reference of the drive's converter to its upper one, mV.
    pub reference_span_mv: u32,
    /// The register of the drive's converter can be read back.
    pub drive_reads_back: bool,
    /// The amplifier's voltage monitor is wired.
    pub has_monitor: bool,
    /// The analogue set point is wired.
    pub has_set_point: bool,
    /// The amplifier's temperature is.
    pub has_amplifier_temperature: bool,
}

impl Wiring {
    /// That of an envelope.
    pub const fn of(envelope: &SafetyEnvelope) -> Self {
        Self {
            sensor_is_signed: envelope.sensor_is_signed,
            reference_span_mv: envelope.reference_span_mv,
            drive_reads_back: envelope.drive_reads_back,
            has_monitor: envelope.monitor_span_uv > 0,
            has_set_point: envelope.set_point_span_nm > 0,
            has_amplifier_temperature: envelope.amplifier_span_decicelsius != 0,
        }
    }
}

/// Converters as the control interrupt sees them. Every call ends after a bounded time, whatever the
/// converters do.
pub trait FrontEnd {
    /// Name, as reported at start.
    const NAME: &'static str;
    /// Bits that the converters have.
    const BITS: CodeBits;
    /// From the edge of the sample clock until the sample can be read, ns.
    const INTERRUPT_AFTER_NS: u32;
    /// The register of the drive's converter can be read back.
    const READS_BACK: bool;
    /// The part can read the amplifier's voltage monitor.
    const HAS_MONITOR: bool;
    /// The part can read an analogue set point.
    const HAS_SET_POINT: bool;
    /// Whether it can give and take codes of so many bits.
    fn has(bits: CodeBits) -> bool;
    /// Not started yet; codes have so many bits, which it has.
    fn new(bits: CodeBits, wiring: Wiring) -> Self;
    /// Sets pins and converters up, with the drive at `rest_code`; called before the beat starts. Without a
    /// code the drive's output stays off: clamped to ground, or floating.
    fn start(&mut self, rest_code: Option<DriveCode>);
    /// The sensor's code sampled at the latest edge; `None` if the converter did not answer.
    fn read(&mut self) -> Option<SensorCode>;
    /// Ends what [`FrontEnd::read`] has begun beside the sensor's code. As late as can be before the tick, so
    /// that nothing waits for it.
    #[inline(always)]
    fn end_read(&mut self) {}
    /// The drive's code for the next edge; `false` if the converter did not take it.
    fn write(&mut self, code: DriveCode) -> bool;
    /// Instead of a code, at rest: sets the drive's converter up as after its power-up; `false` if it did not
    /// take that. The code that it was given last is in its register.
    fn renew(&mut self) -> bool;
    /// What the amplifier's voltage monitor read during the last period, 65,536 codes; starts the next
    /// conversion, now and then of a temperature. `None` if its converter did not answer or is
    /// missing.
    #[inline(always)]
    fn monitor(&mut self) -> Option<u16> {
        None
    }
    /// What the analogue set point read during the last period, 65,536 codes; starts the next conversion.
    /// `None` if its converter did not answer or is missing.
    #[inline(always)]
    fn set_point(&mut self) -> Option<u16> {
        None
    }
    /// Whether the register of the drive's converter held the code that was written last when the one
    /// behind it was written; where it cannot be read back it counts as held.
    #[inline(always)]
    fn holds(&self) -> bool {
        true
    }
    /// The drive at a code at once, without the sample clock, from any state: clocks off, pins not set up, a
    /// frame half sent.
    fn force(&mut self, code: DriveCode);
}
