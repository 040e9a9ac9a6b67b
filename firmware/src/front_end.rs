//! The analogue front end: what the control interrupt needs of converters, whichever they are.
//!
//! A front end gives the sensor's code of the latest edge of the sample clock, and takes a drive code that acts at the next edge.
//! Codes are 16 bits wide on this side; a converter with more keeps its lowest bits to itself.

/// Converters as the control interrupt sees them. Both calls end after a bounded time, whatever the converters do.
pub trait FrontEnd {
    /// Name, as reported at start.
    const NAME: &'static str;
    /// The drive's code when no parameter block says what rest is: 0 V at the actuator as the wiring page has it.
    const SAFE_CODE: u16;
    /// The highest drive code that it has.
    const MOST_CODE: u16;
    /// From the edge of the sample clock until the sample can be read, ns.
    const INTERRUPT_AFTER_NS: u32;
    /// Sets pins and converters up, with the drive at `rest_code`; called before the beat starts.
    fn start(&mut self, rest_code: u16);
    /// The sensor's code sampled at the latest edge; `None` if the converter did not answer.
    fn read(&mut self) -> Option<u16>;
    /// The drive's code for the next edge; `false` if the converter did not take it.
    fn write(&mut self, code: u16) -> bool;
    /// Instead of a code, at rest: sets the drive's converter up as after its power-up. The code that it was given last is in its register.
    #[allow(dead_code)] // not every image that has a front end keeps it so long
    fn renew(&mut self);
    /// The drive at a code at once, without the sample clock, from any state: clocks off, pins not set up, a frame half sent.
    fn force(&mut self, code: u16);
}
