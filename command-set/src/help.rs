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
pub const PARAMETERS: &str = "#Valid parameters: identifier, command level, items, data type, group, description";
/// The first line of `HLP?`.
pub const COMMANDS: &str = "The following commands are valid:";
