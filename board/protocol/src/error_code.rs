//! The codes that `ERR?` answers, with the numbers of the public GCS 2.0 documents.

use hysteron_core::amplifier_command::Refusal;
use hysteron_core::guard::Fault;

/// What was wrong with a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum ErrorCode {
    /// A parameter is no number or word of its kind.
    Syntax = 1,
    /// There is no such command, or the drive in use has none of this kind: waveforms of a stick-slip drive.
    UnknownCommand = 2,
    /// The line is too long.
    TooLong = 3,
    /// A move with the servo off, or the servo of an actuator that is not conditioned.
    ServoIsOff = 5,
    /// The position is out of limits.
    Position = 7,
    /// The velocity is out of limits.
    Velocity = 8,
    /// Stopped by command.
    Stopped = 10,
    /// There is no such axis or channel.
    Axis = 15,
    /// A parameter is out of range.
    Range = 17,
    /// Too many parameters.
    ParameterCount = 24,
    /// A parameter is missing.
    Missing = 26,
    /// There is no such parameter of `SPA`.
    UnknownParameter = 54,
    /// There is no such table of the data recorder.
    RecorderTable = 57,
    /// The data recorder cannot record that.
    RecorderOption = 58,
    /// A parameter of `SPA` is read only.
    ReadOnly = 64,
    /// The wave generator runs.
    GeneratorRuns = 73,
    /// No wave table is selected.
    NoWaveSelected = 75,
    /// Too many commands wait.
    Overrun = 76,
    /// Fewer points are recorded than are asked for.
    NotEnoughRecorded = 77,
    /// An open-loop drive with the servo on.
    ServoIsOn = 79,
    /// Not while the axis moves.
    InMotion = 93,
    /// There is no valid parameter block.
    NoParameters = 201,
    /// The answer is longer than there is room for.
    AnswerTooLong = 301,
    /// The drive is out of limits.
    Voltage = 302,
    /// What was brought is no parameter block for this target; `BLK?` says why.
    InvalidBlock = 311,
    /// A fault is latched; `DIA?` says which.
    Fault = 333,
    /// A point of a wave table is out of its range.
    WaveIndex = 400,
    /// The wave table is empty.
    WaveNotDefined = 401,
    /// There is no such waveform.
    WaveType = 402,
    /// A wave table has no room for so many points.
    WaveTooLong = 403,
    /// A waveform has another number of parameters.
    WaveParameters = 404,
    /// A parameter of a waveform is out of limits.
    WaveLimit = 405,
    /// This start mode of the wave generator is not supported.
    GeneratorMode = 406,
    /// The tracking error was too large for too long.
    TrackingError = 504,
    /// The power stage is off until `ARM`. Of this target: the public documents have no such number.
    NotArmed = 4001,
    /// This board has no room for a second image. The number is this target's as well.
    NoUpdate = 4002,
    /// Bytes of a line were lost on their way, or its checksum is another one's. This target's.
    LostBytes = 4003,
    /// A step is larger than the operator allows without `FAR`. This target's.
    StepTooLarge = 4004,
    /// The loop of the block in use has no margin left for the filter. This target's.
    NoMargin = 4005,
    /// Neither a self-test nor a conditioning has shown that the stage is the model's. This target's.
    NotTested = 4006,
}

impl ErrorCode {
    /// Why the amplifier refused a command; `fault` is what is latched.
    #[must_use]
    pub fn of_refusal(refusal: Refusal, fault: Option<Fault>) -> Self {
        match (refusal, fault) {
            (Refusal::Faulted | Refusal::NotYetHealthy, Some(Fault::TrackingError)) => {
                Self::TrackingError
            }
            (Refusal::Faulted | Refusal::NotYetHealthy, Some(Fault::ParameterBlock))
            | (Refusal::NoBlock, _) => Self::NoParameters,
            (Refusal::Faulted | Refusal::NotYetHealthy, _) => Self::Fault,
            (Refusal::NotAtRest, _) => Self::InMotion,
            (Refusal::NotConditioned, _) => Self::ServoIsOff,
            (Refusal::LoopOpen, _) => Self::ServoIsOff,
            (Refusal::NotArmed, _) => Self::NotArmed,
            (Refusal::NotTested, _) => Self::NotTested,
            (Refusal::BeyondLimits, _) => Self::Range,
            (Refusal::NoInput, _) => Self::Axis,
            (Refusal::OtherDrive, _) => Self::UnknownCommand,
        }
    }
}
