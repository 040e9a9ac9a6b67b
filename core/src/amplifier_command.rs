//! Commands of the amplifier, and why it refuses one.

use crate::reference_generator::Waveform;
use crate::signal::{Micrometres, Travel, Volts};
use crate::signal_filter::{FilteredSignal, Place, SectionRow};

/// Readings whose mean is the sensor's zero.
pub const ZERO_TICKS: u32 = 1024;

/// Ticks of what is played until another command ends it.
pub const ENDLESS_TICKS: u32 = u32::MAX;

/// Rest that an identification begins with, ticks.
pub const REST_BEFORE_TICKS: u32 = 4096;
/// Commands of the amplifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Closes the loop.
    Enable,
    /// Opens it and goes to rest.
    Disable,
    /// Follows another reference.
    Reference {
        /// Its form.
        waveform: Waveform<Micrometres>,
        /// Its offset.
        offset: Micrometres,
    },
    /// Plays an open-loop drive, then goes to rest.
    Play {
        /// Its form.
        waveform: Waveform<Volts>,
        /// Its offset.
        offset: Volts,
        /// How long, ticks; [`ENDLESS_TICKS`]: until another command.
        ticks: u32,
    },
    /// Plays one cycle over the whole range, rests, and zeroes the sensor.
    Condition {
        /// Length of the cycle, ticks.
        cycle_ticks: u32,
        /// Length of the rest, ticks; at least [`ZERO_TICKS`].
        rest_ticks: u32,
    },
    /// Rests for [`REST_BEFORE_TICKS`], which shows the noise and that the record begins settled, plays tones
    /// that together go over the whole range, from its lower end, with a small sweep to nearly half the
    /// sampling rate on top, then goes to rest: what an identification needs of slow loops, nested loops and
    /// dynamics up to the highest frequency at which a servo acts.
    Identify {
        /// How long the tones last, ticks.
        ticks: u32,
    },
    /// With the loop closed: follows the analogue set point from where the reference stands
    /// ([`crate::set_point`]), until another reference, a stop or a fault.
    FollowInput {
        /// Change of the reference in a tick at most.
        most_step: Micrometres,
    },
    /// With the loop of a stick-slip drive closed: goes to a position and holds it
    /// ([`crate::stepping::Stepper::move_to`]).
    MoveTo {
        /// The position.
        target: Travel,
        /// Velocity of the target, um a tick; 0: as fast as the teeth are.
        velocity: Micrometres,
    },
    /// Goes to an open-loop drive, no faster than to rest, and holds it; the loop can be closed from there.
    Hold {
        /// The drive, held within its limits; `None`: where it is.
        drive: Option<Volts>,
    },
    /// At rest: switches the power stage on. Nothing plays or closes before it.
    Arm {
        /// Behind a step that shows sign, gain, noise and drift of the sensor ([`crate::self_test`]); without
        /// it whoever arms knows them.
        tested: bool,
    },
    /// Goes to rest, and switches the power stage off there.
    Disarm,
    /// Clears the fault, if the sensor has been healthy long enough.
    Clear,
    /// Whether the loop closes only behind a conditioning, as after every start, or whatever the stage's
    /// memory is.
    RequireConditioning(bool),
    /// Changes a section of a filter, in any mode and without a step ([`crate::signal_filter`]).
    Filter {
        /// Of which signal.
        signal: FilteredSignal,
        /// Which section.
        place: Place,
        /// Its integers, whose gain at rest is one.
        row: SectionRow,
    },
}

/// Why a command is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// A fault is latched.
    Faulted,
    /// The sensor has not been healthy long enough.
    NotYetHealthy,
    /// Only at rest, the ramp there ended.
    NotAtRest,
    /// There is no valid parameter block or no safety envelope, and nothing but one and a restart helps.
    NoBlock,
    /// The actuator was not conditioned since the start or the last fault.
    NotConditioned,
    /// The power stage was switched on without a self-test, and no conditioning has shown since that the
    /// sensor follows the drive as the model says.
    NotTested,
    /// A reference or a drive leaves its limits ([`crate::command_limits`]).
    BeyondLimits,
    /// The power stage is off: nobody has armed it since the start or the last fault.
    NotArmed,
    /// The points of a table and the analogue set point are followed only by a loop that is closed already.
    LoopOpen,
    /// The board has no analogue set point, or its envelope does not say how it is wired.
    NoInput,
    /// A stick-slip drive follows positions of its travel and no waveform, another one the reverse.
    OtherDrive,
}
