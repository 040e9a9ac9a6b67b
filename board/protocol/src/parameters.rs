//! The parameters of `SPA` and `SPA?`, with the numbers that PI's controllers give them; from 0x7F000000 on
//! they are this target's own: the scale of its codes ([`crate::code_lines`]), and how well its closed loop
//! follows ([`hysteron_core::loop_telemetry`]).

use hysteron_core::signal_filter::FilteredSignal;

/// What of a filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilterItem {
    /// Frequency of a notch, Hz; 0: none.
    NotchFrequency(usize),
    /// Width of a notch between its -3 dB points, Hz; 0: a tenth of its frequency.
    NotchWidth(usize),
    /// Corner of the low-pass, Hz; 0: none.
    LowPass,
}

/// A parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceParameter {
    /// Lowest position, um.
    RangeMinimum,
    /// Highest position, um.
    RangeMaximum,
    /// Fastest move, um/s; as `VEL`.
    Velocity,
    /// Largest tracking error on target, um.
    Tolerance,
    /// For so long it must not be larger, s.
    SettlingTime,
    /// Position at the sensor's code 0, um.
    SensorAtCode0,
    /// Positions of all codes of the sensor, um.
    SensorSpan,
    /// Drive at code 0, V.
    DriveAtCode0,
    /// Drives of all codes, V.
    DriveSpan,
    /// Lowest drive, V.
    DriveMinimum,
    /// Highest drive, V.
    DriveMaximum,
    /// Bits of the sensor's codes.
    SensorBits,
    /// Bits of the drive's codes.
    DriveBits,
    /// For so long no line may come while the drive is live, s; 0: for ever.
    HostTimeout,
    /// Frequency of the resonance that is listened to, Hz; 0: none.
    Resonance,
    /// An amplitude above this is an alarm, nm; 0: none is.
    ResonanceAlarm,
    /// A larger step of `MOV` and `MVR` needs `FAR`, um; 0: none does.
    LargestMove,
    /// The same of `SVA`, V.
    LargestDriveStep,
    /// Tracking error of the last second of the closed loop, RMS, nm.
    ErrorRms,
    /// Its largest magnitude, nm.
    ErrorPeak,
    /// Drive of the same second, RMS, V.
    DriveRms,
    /// Amplitude of the error at the resonance, nm.
    ResonanceAmplitude,
    /// Channel that the closed loop follows; 0: none.
    InputChannel,
    /// Of the filter of a signal.
    Filter(FilteredSignal, FilterItem),
    /// Period of the servo, s.
    ServoPeriod,
    /// Points of a wave table.
    WavePoints,
    /// Wave tables.
    WaveTables,
    /// Points of all tables of the data recorder together.
    RecorderPoints,
    /// Tables of the data recorder.
    RecorderTables,
}

use FilterItem::{LowPass, NotchFrequency, NotchWidth};
use FilteredSignal::{Sensor, SetPoint};

impl DeviceParameter {
    /// Every one with its number, its type, and what it is.
    pub const ALL: [(Self, u32, &'static str, &'static str); 38] = [
        (
            Self::InputChannel,
            0x0600_0500,
            "INT",
            "ADC_Channel_for_Target_0:_none",
        ),
        (
            Self::RangeMinimum,
            0x0700_0000,
            "FLOAT",
            "Range_Limit_Min_(um)",
        ),
        (
            Self::RangeMaximum,
            0x0700_0001,
            "FLOAT",
            "Range_Limit_Max_(um)",
        ),
        (
            Self::Velocity,
            0x0700_0200,
            "FLOAT",
            "Servo_Loop_Slew-Rate_(um/s)",
        ),
        (
            Self::Tolerance,
            0x0700_0900,
            "FLOAT",
            "ON_Target_Tolerance_(um)",
        ),
        (
            Self::SettlingTime,
            0x0700_0901,
            "FLOAT",
            "Settling_Time_(s)",
        ),
        (
            Self::SensorAtCode0,
            0x7F00_0000,
            "FLOAT",
            "Position_at_Sensor_Code_0_(um)",
        ),
        (
            Self::SensorSpan,
            0x7F00_0001,
            "FLOAT",
            "Span_of_Sensor_(um)",
        ),
        (
            Self::DriveAtCode0,
            0x7F00_0002,
            "FLOAT",
            "Drive_at_Code_0_(V)",
        ),
        (Self::DriveSpan, 0x7F00_0003, "FLOAT", "Span_of_Drive_(V)"),
        (Self::DriveMinimum, 0x7F00_0004, "FLOAT", "Lowest_Drive_(V)"),
        (
            Self::DriveMaximum,
            0x7F00_0005,
            "FLOAT",
            "Highest_Drive_(V)",
        ),
        (
            Self::HostTimeout,
            0x7F00_0006,
            "FLOAT",
            "Host_Timeout_(s)_0:_none",
        ),
        (
            Self::Resonance,
            0x7F00_0007,
            "FLOAT",
            "Resonance_Listened_to_(Hz)_0:_none",
        ),
        (
            Self::ResonanceAlarm,
            0x7F00_0008,
            "FLOAT",
            "Alarm_of_Amplitude_at_Resonance_(nm)_0:_none",
        ),
        (Self::SensorBits, 0x7F00_0009, "INT", "Bits_of_Sensor_Codes"),
        (Self::DriveBits, 0x7F00_000A, "INT", "Bits_of_Drive_Codes"),
        (
            Self::LargestMove,
            0x7F00_000B,
            "FLOAT",
            "Largest_Move_without_FAR_(um)_0:_any",
        ),
        (
            Self::LargestDriveStep,
            0x7F00_000C,
            "FLOAT",
            "Largest_Drive_Step_without_FAR_(V)_0:_any",
        ),
        (
            Self::ErrorRms,
            0x7F00_0010,
            "FLOAT",
            "Tracking_Error_of_Last_Second_RMS_(nm)",
        ),
        (
            Self::ErrorPeak,
            0x7F00_0011,
            "FLOAT",
            "Tracking_Error_of_Last_Second_Peak_(nm)",
        ),
        (
            Self::DriveRms,
            0x7F00_0012,
            "FLOAT",
            "Drive_of_Last_Second_RMS_(V)",
        ),
        (
            Self::ResonanceAmplitude,
            0x7F00_0013,
            "FLOAT",
            "Amplitude_at_Resonance_of_Last_Second_(nm)",
        ),
        (
            Self::Filter(SetPoint, NotchFrequency(0)),
            0x7F00_0020,
            "FLOAT",
            "Set_Point_Notch_1_Frequency_(Hz)_0:_none",
        ),
        (
            Self::Filter(SetPoint, NotchWidth(0)),
            0x7F00_0021,
            "FLOAT",
            "Set_Point_Notch_1_Width_(Hz)_0:_a_tenth_of_its_frequency",
        ),
        (
            Self::Filter(SetPoint, NotchFrequency(1)),
            0x7F00_0022,
            "FLOAT",
            "Set_Point_Notch_2_Frequency_(Hz)_0:_none",
        ),
        (
            Self::Filter(SetPoint, NotchWidth(1)),
            0x7F00_0023,
            "FLOAT",
            "Set_Point_Notch_2_Width_(Hz)_0:_a_tenth_of_its_frequency",
        ),
        (
            Self::Filter(SetPoint, LowPass),
            0x7F00_0024,
            "FLOAT",
            "Set_Point_Low_Pass_(Hz)_0:_none",
        ),
        (
            Self::Filter(Sensor, NotchFrequency(0)),
            0x7F00_0030,
            "FLOAT",
            "Sensor_Notch_1_Frequency_(Hz)_0:_none",
        ),
        (
            Self::Filter(Sensor, NotchWidth(0)),
            0x7F00_0031,
            "FLOAT",
            "Sensor_Notch_1_Width_(Hz)_0:_a_tenth_of_its_frequency",
        ),
        (
            Self::Filter(Sensor, NotchFrequency(1)),
            0x7F00_0032,
            "FLOAT",
            "Sensor_Notch_2_Frequency_(Hz)_0:_none",
        ),
        (
            Self::Filter(Sensor, NotchWidth(1)),
            0x7F00_0033,
            "FLOAT",
            "Sensor_Notch_2_Width_(Hz)_0:_a_tenth_of_its_frequency",
        ),
        (
            Self::Filter(Sensor, LowPass),
            0x7F00_0034,
            "FLOAT",
            "Sensor_Low_Pass_(Hz)_0:_none",
        ),
        (
            Self::ServoPeriod,
            0x0E00_0200,
            "FLOAT",
            "Servo_Update_Time_(s)",
        ),
        (Self::WavePoints, 0x1300_0004, "INT", "Max_Wave_Points"),
        (Self::WaveTables, 0x1300_010A, "INT", "Number_of_Waves"),
        (
            Self::RecorderPoints,
            0x1600_0200,
            "INT",
            "Data_Recorder_Max_Points",
        ),
        (
            Self::RecorderTables,
            0x1600_0300,
            "INT",
            "Data_Recorder_Number_of_Tables",
        ),
    ];

    /// The one of a number.
    #[must_use]
    pub fn of_number(number: u32) -> Option<Self> {
        Self::ALL
            .iter()
            .find(|(_, this, _, _)| *this == number)
            .map(|(parameter, _, _, _)| *parameter)
    }
}
