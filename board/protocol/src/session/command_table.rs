//! Every command, with its help and its handler.

use super::{Handler, Session};
use crate::device::Device;

impl<D: Device + 'static> Session<D> {
    /// Every command with its help; a query ends in a question mark.
    pub(super) const COMMANDS: &'static [(&'static str, &'static str, Handler<D>)] = &[
        ("*IDN?", "get device identification", Self::identification),
        (
            "ARM",
            "<axis> <0|1|2> switch the amplifier off, on behind a self-test, or on without it",
            Self::arm,
        ),
        (
            "ARM?",
            "[<axis>] get whether the amplifier is off (0), armed (1), or on and not armed (2)",
            Self::armed,
        ),
        (
            "ATZ",
            "[<axis> [<low voltage>]] condition the actuator and zero the sensor",
            Self::auto_zero,
        ),
        (
            "ATZ?",
            "[<axis>] get whether the sensor has been zeroed",
            Self::auto_zeroed,
        ),
        (
            "BLK",
            "<BEGIN <bytes>|DATA <offset> <hexadecimal>|COMMIT|SWAP|ENVELOPE <checksum>> bring a parameter block or a safety envelope",
            Self::bring_block,
        ),
        (
            "BLK?",
            "get what became of the parameter block that was brought",
            Self::brought_block,
        ),
        ("CST?", "[<axis>] get the name of the stage", Self::stage),
        (
            "CSV?",
            "get the version of the syntax",
            Self::syntax_version,
        ),
        (
            "DIA?",
            "[{<identifier>}] get diagnosis information",
            Self::diagnosis,
        ),
        (
            "DRB?",
            "[<start> <number>] get recorded codes of sensor and drive, in base 64 with a checksum",
            Self::recorded_codes,
        ),
        (
            "DRC",
            "{<table> <source> <option>} set what the data recorder records",
            Self::set_recorder,
        ),
        (
            "DRC?",
            "[{<table>}] get what the data recorder records",
            Self::recorder,
        ),
        (
            "DRL?",
            "[{<table>}] get the number of recorded points",
            Self::recorded_points,
        ),
        (
            "DRR?",
            "[<start> <number> [{<table>}]] get recorded data",
            Self::recorded_data,
        ),
        (
            "DRT",
            "{<table> <trigger source> <value>} set what starts the data recorder",
            Self::set_trigger,
        ),
        (
            "DRT?",
            "[{<table>}] get what starts the data recorder",
            Self::trigger,
        ),
        (
            "ENV?",
            "get the safety envelope of the board",
            Self::envelope,
        ),
        ("ERR?", "get and clear the last error", Self::last_error),
        (
            "FRF?",
            "[<axis>] get whether the actuator is conditioned since the start and the last fault",
            Self::conditioned,
        ),
        (
            "GWD?",
            "[<start> <number> [{<table>}]] get the points of wave tables",
            Self::wave_data,
        ),
        (
            "HDI?",
            "get the list of diagnosis information",
            Self::diagnosis_help,
        ),
        (
            "HDR?",
            "get the options of the data recorder",
            Self::recorder_help,
        ),
        ("HLP?", "get this list", Self::command_help),
        ("HLT", "[<axis>] halt the motion, servo on", Self::halt),
        ("HPA?", "get the list of parameters", Self::parameter_help),
        (
            "IFC",
            "RSBAUD <bit/s> set the speed of the line until the restart",
            Self::set_interface,
        ),
        (
            "IFC?",
            "[RSBAUD] get the speed of the line",
            Self::interface,
        ),
        ("INI", "[<axis>] clear the fault", Self::clear_fault),
        (
            "LOG?",
            "get the last faults, kept over restarts, the newest first",
            Self::events,
        ),
        (
            "MOV",
            "<axis> <position> [FAR] set the target, um",
            Self::move_to,
        ),
        ("MOV?", "[<axis>] get the target, um", Self::target),
        (
            "MVR",
            "<axis> <distance> [FAR] move relative to the target, um",
            Self::move_by,
        ),
        (
            "ONT?",
            "[<axis>] get whether the target is reached",
            Self::on_target,
        ),
        (
            "OVF?",
            "[<axis>] get whether the drive is at a limit",
            Self::overflow,
        ),
        ("POS?", "[<axis>] get the position, um", Self::position),
        (
            "RBT",
            "restart with the newest valid parameter block",
            Self::restart,
        ),
        (
            "RON",
            "<axis> <0|1> set whether the servo wants a conditioned actuator",
            Self::require_conditioning,
        ),
        (
            "RON?",
            "[<axis>] get whether the servo wants a conditioned actuator",
            Self::conditioning_required,
        ),
        (
            "RTR",
            "<ticks> set the record table rate",
            Self::set_record_rate,
        ),
        ("RTR?", "get the record table rate", Self::record_rate),
        ("SAI?", "[ALL] get the axis", Self::axes),
        (
            "SPA",
            "{<item> <parameter> <value>} set a parameter",
            Self::set_parameter,
        ),
        (
            "SPA?",
            "[{<item> <parameter>}] get parameters",
            Self::parameter,
        ),
        ("STP", "stop: the drive goes to rest", Self::stopped),
        (
            "SVA",
            "<axis> <drive> [FAR] set the open-loop drive, V",
            Self::set_drive,
        ),
        (
            "SVA?",
            "[<axis>] get the open-loop drive, V",
            Self::open_loop_drive,
        ),
        ("SVO", "<axis> <0|1> switch the servo", Self::set_servo),
        ("SVO?", "[<axis>] get the servo", Self::servo),
        (
            "TAD?",
            "<channel> get a code: 1 of the sensor, 2 of the amplifier's voltage monitor, 3 of the analogue set point (of 65536)",
            Self::code,
        ),
        ("TMN?", "[<axis>] get the lowest position, um", Self::lowest),
        (
            "TMX?",
            "[<axis>] get the highest position, um",
            Self::highest,
        ),
        (
            "TNR?",
            "get the number of record tables",
            Self::record_tables,
        ),
        (
            "TWC",
            "clear the point of the trigger output",
            Self::clear_trigger_point,
        ),
        (
            "TWG?",
            "get the number of wave generators",
            Self::wave_generators,
        ),
        (
            "TWS",
            "<line> <point> <0|1> set the point of the wave with which the trigger output is high",
            Self::set_trigger_point,
        ),
        (
            "TWS?",
            "[<line>] get the point of the trigger output, 0: none",
            Self::trigger_point,
        ),
        (
            "UPD",
            "<BEGIN bytes|DATA offset hex|COMMIT code> bring another image, which the next restart installs",
            Self::bring_image,
        ),
        (
            "UPD?",
            "get the running image and how far an update is",
            Self::update,
        ),
        (
            "VEL",
            "<axis> <velocity> set the fastest velocity of moves, um/s",
            Self::set_velocity,
        ),
        ("VEL?", "[<axis>] get the velocity, um/s", Self::velocity),
        ("VER?", "get versions", Self::version),
        ("VOL?", "[<channel>] get the drive, V", Self::voltage),
        (
            "WAV",
            "<table> <X|&> <PNT|SIN_P|RAMP|LIN> {<parameter>} define a waveform",
            Self::define_wave,
        ),
        (
            "WAV?",
            "[<table> <1>] get the length of a wave table",
            Self::wave_length,
        ),
        ("WCL", "{<table>} clear wave tables", Self::clear_wave),
        (
            "WGC",
            "<generator> <cycles> set the number of cycles, 0: endless",
            Self::set_cycles,
        ),
        (
            "WGC?",
            "[<generator>] get the number of cycles",
            Self::cycles,
        ),
        (
            "WGO",
            "<generator> <0|1> stop or start the wave generator",
            Self::generate,
        ),
        (
            "WGO?",
            "[<generator>] get whether the wave generator runs",
            Self::generates,
        ),
        (
            "WPA",
            "<100> keep the settings from the next start on",
            Self::keep_settings,
        ),
        (
            "WSL",
            "<generator> <table> select a wave table, 0: none",
            Self::select_wave,
        ),
        (
            "WSL?",
            "[<generator>] get the selected wave table",
            Self::selected_wave,
        ),
        (
            "WTR",
            "<generator> <ticks> <interpolation> set the time of a point",
            Self::set_wave_rate,
        ),
        (
            "WTR?",
            "[<generator>] get the time of a point",
            Self::wave_rate,
        ),
    ];

    /// Bytes that are commands, as `HLP?` lists them.
    pub(super) const SINGLE_BYTES: [(&'static str, &'static str); 4] = [
        ("#5", "get whether the axis moves"),
        ("#7", "get whether the controller is ready"),
        ("#9", "get whether the wave generator runs"),
        ("#24", "stop: the drive goes to rest"),
    ];
}
