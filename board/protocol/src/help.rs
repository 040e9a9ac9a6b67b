//! The fixed texts of `HDR?` and `HPA?`, and the frame of every list of help.

/// The last line of every list.
pub const END: &str = "end of help";

/// What `HDR?` answers.
pub const RECORDER: &[&str] = &[
    "#RecordOptions",
    "0=Nothing is recorded",
    "1=Target position of axis (um)",
    "2=Actual position of axis (um)",
    "3=Position error of axis (um)",
    "7=Voltage of output channel (V)",
    "#TriggerOptions",
    "0=Wave generator started (WGO)",
    "1=Any command that changes the target (MOV, MVR, SVA, WGO)",
    "2=Next command",
    "4=Immediately (this command)",
    "#Additional information",
    "all tables are recorded at the same ticks; SPA? 1 0x16000200 says how many points they have together",
    END,
];

/// The first line of `HPA?`.
pub const PARAMETERS: &str =
    "#Valid parameters: identifier, command level, items, data type, group, description";
/// The first line of `HLP?`.
pub const COMMANDS: &str = "The following commands are valid:";

/// The first line of `HDI?`.
pub const DIAGNOSIS_HEAD: &str = "#Diagnosis: identifier and description";
/// What `DIA?` answers under 1, 2, and so on.
pub const DIAGNOSIS: [&str; 20] = [
    "mode: 0 rest, 1 open loop, 2 closed loop, 3 fault",
    "latched fault, 0: none (the numbers are in the manual)",
    "ticks with the sensor at or beyond its limits",
    "ticks of the closed loop with the drive at a limit",
    "values of the law that were cut to their format",
    "ticks that came late",
    "samples that were lost on their way to the recorder's task",
    "generation of the parameter block in use, 0: swapped in only until a restart, or none",
    "checksum of the parameter block in use, 0: none",
    "ticks since the start",
    "conditioned since the start and the last fault",
    "option bytes that protect: 1 brown-out level, 2 watchdog from the supply on",
    "seconds of the closed loop that were measured (0x7F000010 and what follows of SPA? say what the last one came to)",
    "seconds of the closed loop that were abandoned because samples were missing",
    "alarms: 1 the amplitude at the resonance is above its alarm",
    "gain of the actuator over the model's as it was adapted, millionths, 0: it is not adapted",
    "1 the power stage is on, 2 armed, 3 both",
    "temperature of the part, tenths of a degree Celsius, -10000: not read",
    "analogue set point: 0 not followed, 1 followed, 2 held at its limit",
    "temperature of the amplifier, tenths of a degree Celsius, -10000: not read",
];
