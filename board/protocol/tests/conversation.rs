//! Conversations with a session in front of the real amplifier and the reference bench's actuator, all on the
//! host.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::AtomicI32;

use hysteron_core::amplifier::{Amplifier, Mode};
use hysteron_core::amplifier_command::Command;
use hysteron_core::codes::DriveCode;
use hysteron_core::command_text::BlockPiece;
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::guard::Fault;
use hysteron_core::kept_settings::KeptSettings;
use hysteron_core::loop_telemetry::{LoopFigures, LoopTelemetry, ResonanceWatch};
use hysteron_core::parameter_block::{AmplifierParameters, BLOCK_BYTES, read, write};
use hysteron_core::safety_envelope::{self, SafetyEnvelope};
use hysteron_core::servo_parameters::LawParameters;
use hysteron_core::set_point::{SetPoint, SetPointParameters};
use hysteron_core::trace_frame::TraceSample;
use hysteron_protocol::device::{Brought, Device, DeviceDiagnosis, DeviceEvent, Moving, View};
use hysteron_protocol::session::{Outcome, Piece, Session, Step, WAVE_TABLES};
use hysteron_protocol::{DIALECT, Lines, seal};
use hysteron_sim::bench::{Bench, Plant, Sensor, Variant};
use proptest::prelude::*;

/// Amplifier and actuator; the recorder is a vector.
struct Rig {
    amplifier: Amplifier,
    bench: Bench,
    plant: Plant,
    sensor: Sensor,
    acting: DriveCode,
    tolerance: i32,
    on_target_ticks: u32,
    latest: TraceSample,
    recording: Option<u32>,
    samples: Vec<TraceSample>,
    sensor_is_there: bool,
    block: Vec<u8>,
    brought: Brought,
    monitor_code: Option<u16>,
    set_point_code: Option<u16>,
    restarts: u32,
    baud: u32,
    host_timeout: u32,
    telemetry: LoopTelemetry,
    /// Ticks that have gone by without being simulated.
    skipped: u64,
    envelope: Option<SafetyEnvelope>,
    events: Vec<DeviceEvent>,
    kept: Option<KeptSettings>,
}

const ROOM: u32 = 3000;

impl Rig {
    fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.plant
                .tick(self.bench.converter_scale().drive_v(self.acting));
            self.acting = self.latest.dac_code;
            let code = self.sensor.read_code(&self.plant);
            self.amplifier.inspect_input(self.set_point_code);
            self.latest = self
                .amplifier
                .tick(self.sensor_is_there.then_some(code), false);
            let c = self.amplifier.servo().parameters().converters;
            let error = self.latest.reference - c.position(code);
            if self.amplifier.mode() == Mode::Closed {
                self.telemetry
                    .take(self.latest.tick, error, c.drive(self.latest.dac_code));
            } else {
                self.telemetry.begin();
            }
            let small = self.amplifier.mode() == Mode::Closed && error.abs() <= self.tolerance;
            self.on_target_ticks = if small { self.on_target_ticks + 1 } else { 0 };
            if let Some(every) = self.recording
                && self.latest.tick.is_multiple_of(every)
                && self.samples.len() < ROOM as usize
            {
                self.samples.push(self.latest);
            }
        }
    }
}

#[derive(Clone)]
struct Shared(Rc<RefCell<Rig>>);

impl Device for Shared {
    fn view(&self) -> View {
        let rig = self.0.borrow();
        View {
            tick: u64::from(rig.latest.tick + 1) + rig.skipped,
            mode: rig.amplifier.mode(),
            fault: rig.amplifier.fault(),
            adc_code: rig.latest.adc_code,
            dac_code: rig.latest.dac_code,
            monitor_code: rig.monitor_code,
            set_point_code: rig.set_point_code,
            input: rig.amplifier.input_state(),
            reference: rig.latest.reference,
            travel: rig
                .amplifier
                .stepper()
                .map(|stepper| stepper.position().to_bits()),
            adc_zero: rig.amplifier.servo().parameters().converters.adc_zero,
            zeroed: rig.amplifier.zeroed(),
            conditioned: rig.amplifier.conditioned(),
            powered: rig.amplifier.powered(),
            armed: rig.amplifier.armed(),
            conditioning_required: rig.amplifier.conditioning_required(),
            on_target_ticks: rig.on_target_ticks,
        }
    }
    fn set_tolerance(&mut self, tolerance: i32) {
        self.0.borrow_mut().tolerance = tolerance;
    }
    fn recorder_room(&self) -> u32 {
        ROOM
    }
    fn record(&mut self, every_ticks: u32) {
        let mut rig = self.0.borrow_mut();
        rig.samples.clear();
        rig.recording = Some(every_ticks);
    }
    fn recorded(&self) -> u32 {
        self.0.borrow().samples.len() as u32
    }
    fn end_recording(&mut self) {
        self.0.borrow_mut().recording = None;
    }
    fn sample(&self, nth: u32) -> Option<TraceSample> {
        let rig = self.0.borrow();
        if rig.recording.is_some() {
            None
        } else {
            rig.samples.get(nth as usize).copied()
        }
    }
    fn record_from_command(&mut self, every_ticks: u32) {
        self.record(every_ticks);
    }
    fn take_sensor_filter(&mut self, filter: &FilterSetting) -> Result<(), &'static str> {
        self.0
            .borrow()
            .amplifier
            .parameters()
            .loop_margin()
            .bears(filter)
    }
    fn begin_block(&mut self, bytes: u32) -> Result<(), &'static str> {
        self.0.borrow_mut().block.clear();
        if bytes > 4000 {
            Err("larger than any block")
        } else {
            Ok(())
        }
    }
    fn take_block(&mut self, piece: &BlockPiece) -> Result<(), &'static str> {
        let mut rig = self.0.borrow_mut();
        if piece.offset() != rig.block.len() {
            return Err("a piece is missing or too much");
        }
        rig.block.extend_from_slice(piece.bytes());
        Ok(())
    }
    fn keep_block(&mut self) -> Result<(), Moving> {
        let mut rig = self.0.borrow_mut();
        if !rig.amplifier.drive_rests() {
            return Err(Moving);
        }
        rig.brought = read(&rig.block, 20_000)
            .map_or_else(|error| Brought::Refused(error.reason()), |_| Brought::Kept);
        Ok(())
    }
    fn keep_envelope(&mut self, wanted: u32) -> Result<(), Moving> {
        let mut rig = self.0.borrow_mut();
        if rig.amplifier.powered() {
            return Err(Moving);
        }
        let envelope = safety_envelope::read(&rig.block)
            .ok()
            .filter(|envelope| safety_envelope::fingerprint(envelope) == wanted);
        rig.brought = if envelope.is_some() {
            Brought::Kept
        } else {
            Brought::Refused("another checksum")
        };
        rig.envelope = envelope.or(rig.envelope);
        Ok(())
    }
    fn envelope(&self) -> Option<SafetyEnvelope> {
        self.0.borrow().envelope
    }
    fn event(&self, before_last: u32) -> Option<DeviceEvent> {
        self.0
            .borrow()
            .events
            .iter()
            .rev()
            .nth(before_last as usize)
            .copied()
    }
    fn swap_block(&mut self) {
        let mut rig = self.0.borrow_mut();
        let swapped = read(&rig.block, 20_000)
            .map_err(|error| error.reason())
            .and_then(|block| rig.amplifier.swap(&block));
        rig.brought = swapped.map_or_else(Brought::Refused, |()| Brought::Swapped);
    }
    fn kept_settings(&self) -> Option<KeptSettings> {
        self.0.borrow().kept
    }
    fn keep_settings(&mut self, settings: &KeptSettings) -> Result<(), Moving> {
        let mut rig = self.0.borrow_mut();
        if !rig.amplifier.drive_rests() {
            return Err(Moving);
        }
        rig.kept = Some(*settings);
        Ok(())
    }
    fn brought(&self) -> Brought {
        self.0.borrow().brought
    }
    fn restart(&mut self) -> Result<(), Moving> {
        let mut rig = self.0.borrow_mut();
        rig.restarts += u32::from(rig.amplifier.drive_rests());
        if rig.amplifier.drive_rests() {
            Ok(())
        } else {
            Err(Moving)
        }
    }
    fn host_timeout(&self) -> u32 {
        self.0.borrow().host_timeout
    }
    fn set_host_timeout(&mut self, ticks: u32) {
        self.0.borrow_mut().host_timeout = ticks;
    }
    fn baud(&self) -> u32 {
        self.0.borrow().baud
    }
    fn set_baud(&mut self, baud: u32) {
        self.0.borrow_mut().baud = baud;
    }
    fn diagnosis(&self) -> DeviceDiagnosis {
        DeviceDiagnosis {
            railed_ticks: 7,
            block_checksum: 0xdead_beef,
            adapted_gain_millionths: 1_050_000,
            part_decicelsius: Some(-85),
            amplifier_decicelsius: Some(312),
            ..DeviceDiagnosis::default()
        }
    }
    fn loop_figures(&self) -> LoopFigures {
        self.0.borrow().telemetry.figures()
    }
    fn resonance_watch(&self) -> ResonanceWatch {
        self.0.borrow().telemetry.watch()
    }
    fn listen(&mut self, watch: ResonanceWatch) -> Result<(), &'static str> {
        self.0.borrow_mut().telemetry.listen(watch)
    }
}

/// A session, what is behind it, and what is in front of it.
struct Table {
    session: Session<Shared>,
    rig: Shared,
    lines: Lines,
}

fn parameters() -> AmplifierParameters {
    read(include_bytes!("../../emulator/tests/p753.block"), 20_000).expect("a valid block")
}

impl Table {
    fn new() -> Self {
        let bench = Bench::reference().expect("the bench");
        let amplifier = Amplifier::new(parameters());
        let rest = parameters().guard.rest_code;
        let rig = Shared(Rc::new(RefCell::new(Rig {
            plant: bench.plant(Variant::FULL),
            sensor: Sensor::new(&bench, 0.0, 5),
            bench,
            amplifier,
            acting: rest,
            tolerance: 0,
            on_target_ticks: 0,
            latest: TraceSample {
                dac_code: rest,
                ..TraceSample::default()
            },
            recording: None,
            samples: Vec::new(),
            sensor_is_there: true,
            block: Vec::new(),
            monitor_code: None,
            set_point_code: None,
            brought: Brought::Nothing,
            restarts: 0,
            baud: 115_200,
            host_timeout: 0,
            telemetry: LoopTelemetry::new(20_000),
            skipped: 0,
            envelope: None,
            events: Vec::new(),
            kept: None,
        })));
        rig.0.borrow_mut().run(100);
        let waves: Vec<AtomicI32> = (0..WAVE_TABLES * 4096)
            .map(|_| AtomicI32::new(i32::MIN))
            .collect();
        let session = Session::new(
            rig.clone(),
            parameters(),
            Box::leak(waves.into_boxed_slice()),
        );
        Self {
            session,
            rig,
            lines: Lines::of(DIALECT),
        }
    }

    /// Sends bytes and returns what comes back; the amplifier does a tick for every step.
    fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
        let received = self.lines.receive(bytes);
        if received.stop {
            let _ = self.rig.0.borrow_mut().amplifier.command(Command::Disable);
        }
        if received.too_long > 0 {
            self.session.too_long();
        }
        let (mut piece, mut answer) = (Piece::new(), Vec::new());
        while let Some(line) = self.lines.next() {
            self.session.obey(&line.bytes, line.before_stop);
            for steps in 0.. {
                assert!(steps < 20_000, "an answer that does not end");
                match self.session.next(&mut piece) {
                    Step::Done => break,
                    Step::Send => answer.extend_from_slice(&piece),
                    Step::Command(command) => {
                        let outcome = {
                            let mut rig = self.rig.0.borrow_mut();
                            let tick = (u64::from(rig.latest.tick + 1) + rig.skipped) as u32;
                            rig.amplifier
                                .command(command)
                                .map_or_else(Outcome::Refused, |()| Outcome::Done(tick))
                        };
                        self.session.outcome(outcome);
                    }
                    Step::Work => {}
                }
                self.rig.0.borrow_mut().run(1);
            }
        }
        answer
    }

    fn ask(&mut self, line: &str) -> String {
        String::from_utf8(self.send(format!("{line}\n").as_bytes())).expect("text")
    }

    /// A command that succeeds, or not.
    fn tell(&mut self, line: &str, error: u16) {
        assert_eq!(self.ask(line), "", "{line}");
        assert_eq!(self.ask("ERR?"), format!("{error}\n"), "{line}");
    }

    fn value(&mut self, line: &str) -> f64 {
        let answer = self.ask(line);
        answer
            .trim()
            .rsplit('=')
            .next()
            .and_then(|value| value.parse().ok())
            .unwrap_or_else(|| panic!("{line}: {answer:?}"))
    }

    fn run(&self, ticks: u32) {
        self.rig.0.borrow_mut().run(ticks);
    }

    fn ready() -> Self {
        let mut table = Self::new();
        table.tell("ARM 1 1", 0);
        assert_eq!(
            (table.send(b"\x07").as_slice(), table.ask("ARM?").as_str()),
            (&b"\xB0\n"[..], "1=2\n"),
            "the self-test"
        );
        table.run(10_000);
        assert_eq!(
            (table.send(b"\x07").as_slice(), table.ask("ARM?").as_str()),
            (&b"\xB1\n"[..], "1=1\n")
        );
        table.tell("ATZ 1", 0);
        assert_eq!(table.send(b"\x07"), b"\xB0\n", "busy");
        table.run(22_100);
        assert_eq!(table.send(b"\x07"), b"\xB1\n");
        assert_eq!(table.ask("ATZ?"), "1=1\n");
        table.tell("SVO 1 1", 0);
        table
    }
}

#[test]
fn who_is_there() {
    let mut table = Table::new();
    let name = table.ask("*IDN?");
    assert_eq!(name.split(',').count(), 4);
    assert_eq!(table.ask("CSV?"), "2.0\n");
    assert_eq!(
        (table.ask("SAI?").as_str(), table.ask("sai? all").as_str()),
        ("1\n", "1\n")
    );
    assert_eq!(table.ask("SVO? 1"), "1=0\n");
    assert_eq!(table.ask("CST?").lines().count(), 1);
    assert!(table.value("TMX? 1") > table.value("TMN? 1") + 10.0);
    let help = table.ask("HLP?");
    assert!(help.lines().skip(1).all(|line| line.len() > 5) && help.ends_with("end of help\n"));
    let lines: Vec<&str> = help.split_inclusive('\n').collect();
    assert!(
        lines[..lines.len() - 1]
            .iter()
            .all(|line| line.ends_with(" \n")),
        "only the last line ends without a space"
    );
    assert_eq!(
        lines
            .iter()
            .filter(|line| line.starts_with("MOV? "))
            .count(),
        1
    );
    assert_eq!(table.ask("ERR?"), "0\n");
}

#[test]
fn a_target_without_room_for_an_update_says_so() {
    let mut table = Table::new();
    assert_eq!(table.ask("UPD?"), "STATE=UNSUPPORTED\n");
    for line in [
        "UPD BEGIN 4096",
        "UPD DATA 0 00ff",
        "UPD COMMIT 000102030405060708090a0b0c0d0e0f",
    ] {
        table.tell(line, 4002);
    }
    for line in ["UPD DATA 0 xyz", "UPD COMMIT 0x12345678", "UPD COMMIT 0001"] {
        table.tell(line, 1);
    }
}

#[test]
fn the_axis_moves_as_fast_as_it_may_and_says_when_it_is_there() {
    let mut table = Table::new();
    table.tell("MOV 1 5", 5);
    let mut table = Table::ready();
    assert_eq!(table.ask("SVO?"), "1=1\n");
    table.tell("VEL 1 1000", 0);
    table.tell("MOV 1 5.25", 0);
    assert_eq!(table.send(b"\x05"), b"1\n");
    assert_eq!(table.ask("ONT? 1"), "1=0\n");
    // 5.25 um at a mean of 8/15 of 1000 um/s take 9.8 ms. The velocity is looked at on the way.
    let mut fastest = 0.0f64;
    for _ in 0..220 {
        let before = table.rig.0.borrow().latest.reference;
        table.run(1);
        fastest = fastest.max(
            f64::from(table.rig.0.borrow().latest.reference - before) / 16_777_216.0 * 20_000.0,
        );
    }
    assert!((900.0..1_100.0).contains(&fastest), "{fastest} um/s");
    assert_eq!(table.send(b"\x05"), b"0\n");
    table.run(1000);
    assert_eq!(table.ask("ONT? 1"), "1=1\n");
    assert_eq!(table.ask("MOV?"), "1=5.250000\n");
    assert!((table.value("POS? 1") - 5.25).abs() < 0.02);
    table.tell("MVR 1 -1.25", 0);
    table.run(2000);
    assert_eq!(table.ask("MOV? 1"), "1=4.000000\n");
    assert!((table.value("POS?") - 4.0).abs() < 0.02);
    let drive = table.value("VOL? 1");
    assert!((5.0..60.0).contains(&drive), "{drive} V");
    assert_eq!(table.ask("OVF?"), "1=0\n");
}

#[test]
fn a_servo_that_is_switched_off_holds_its_drive_and_open_loop_drives_follow() {
    let mut table = Table::ready();
    table.tell("MOV 1 4", 0);
    table.tell("SVA 1 10", 79);
    table.run(2000);
    let drive = table.value("VOL?");
    table.tell("SVO 1 0", 0);
    table.run(100);
    assert!((table.value("VOL?") - drive).abs() < 0.1);
    table.tell("SVA 1 500", 302);
    table.tell("SVA 1 60", 0);
    assert_eq!(table.send(b"\x05"), b"1\n");
    table.run(4000);
    assert_eq!(table.send(b"\x05"), b"0\n");
    assert!((table.value("VOL? 1") - 60.0).abs() < 0.01);
    assert_eq!(table.ask("SVA? 1"), "1=60.000000\n");
    table.tell("SVO 1 1", 0);
    table.run(500);
    assert!(
        (table.value("MOV?") - table.value("POS?")).abs() < 0.05,
        "the servo takes over where it is"
    );
    table.tell("ATZ 1", 93);
}

#[test]
fn a_stop_goes_to_rest_and_what_came_before_it_is_forgotten() {
    for stop in [&b"STP\n"[..], b"stp\n", b"\x18"] {
        let mut table = Table::ready();
        table.tell("MOV 1 5", 0);
        assert_eq!(
            table.send(&[b"MOV 1 8\nMOV?\n", stop].concat()),
            b"1=5.000000\n",
            "a query is answered, a move is not made"
        );
        assert_eq!(table.ask("ERR?"), "10\n");
        assert_eq!(table.ask("SVO?"), "1=0\n");
        table.run(3000);
        assert!(table.rig.0.borrow().amplifier.drive_rests());
    }
    let mut table = Table::ready();
    table.tell("VEL 1 100", 0);
    table.tell("MOV 1 8", 0);
    table.run(1200);
    table.tell("HLT 1", 10);
    table.run(1000);
    let here = table.value("POS?");
    assert!((1.0..7.0).contains(&here), "{here}");
    assert_eq!(table.ask("SVO?"), "1=1\n");
    assert!((table.value("MOV?") - here).abs() < 0.02);
}

#[test]
fn the_servo_wants_a_conditioned_actuator_unless_that_is_waived() {
    let mut table = Table::new();
    assert_eq!(
        (
            table.ask("RON?").as_str(),
            table.ask("FRF? 1").as_str(),
            table.ask("DIA? 11").as_str()
        ),
        ("1=1\n", "1=0\n", "11=0\n")
    );
    table.tell("SVO 1 1", 4001);
    table.tell("ARM 1 2", 0);
    table.tell("SVO 1 1", 5);
    assert_eq!(table.ask("SVO?"), "1=0\n");
    table.tell("RON 1 0", 0);
    table.tell("SVO 1 1", 0);
    assert_eq!(
        (table.ask("SVO?").as_str(), table.ask("RON? 1").as_str()),
        ("1=1\n", "1=0\n")
    );
    let mut table = Table::ready();
    assert_eq!(
        (table.ask("FRF?").as_str(), table.ask("SVO?").as_str()),
        ("1=1\n", "1=1\n")
    );
    // A fault, and nobody knows what the stage did while its power stage was off.
    table.rig.0.borrow_mut().sensor_is_there = false;
    table.run(3000);
    table.rig.0.borrow_mut().sensor_is_there = true;
    table.run(3000);
    table.tell("INI 1", 0);
    assert_eq!(
        (
            table.ask("FRF?").as_str(),
            table.ask("ATZ?").as_str(),
            table.ask("ARM?").as_str()
        ),
        ("1=0\n", "1=1\n", "1=0\n")
    );
    table.tell("SVO 1 1", 4001);
    table.tell("ARM 1 2", 0);
    table.tell("SVO 1 1", 5);
    table.tell("RON 1 2", 17);
    table.tell("RON 2 0", 15);
}

#[test]
fn a_host_says_for_how_long_it_may_be_silent() {
    let mut table = Table::new();
    assert_eq!(table.value("SPA? 1 0x7F000006"), 0.0);
    table.tell("SPA 1 0x7F000006 0.25", 0);
    assert_eq!(table.rig.0.borrow().host_timeout, 5000);
    assert_eq!(table.value("SPA? 1 0x7F000006"), 0.25);
    for (seconds, error) in [
        ("0.009", 17),
        ("0.0001", 17),
        ("-1", 17),
        ("3601", 17),
        ("0", 0),
    ] {
        table.tell(&format!("SPA 1 0x7F000006 {seconds}"), error);
    }
    assert_eq!(table.rig.0.borrow().host_timeout, 0);
}

#[test]
fn a_stop_between_two_commands_of_one_line_ends_it() {
    let mut table = Table::new();
    table.session.obey(b"SVO 1 1", false);
    let mut piece = Piece::new();
    assert!(matches!(
        table.session.next(&mut piece),
        Step::Command(Command::Reference { .. })
    ));
    table.session.outcome(Outcome::Done(100));
    assert_eq!(
        table.session.next(&mut piece),
        Step::Command(Command::Enable)
    );
    table.session.outcome(Outcome::Stopped);
    assert_eq!(table.session.next(&mut piece), Step::Done);
    assert_eq!(table.ask("ERR?"), "0\n");
}

#[test]
fn the_wave_generator_plays_and_the_recorder_shows_it() {
    let mut table = Table::ready();
    table.tell("MOV 1 3", 0);
    table.run(1000);
    table.tell("WGO 1 1", 75);
    table.tell("WAV 2 X SIN_P 400 4 3 400 0 200", 0);
    assert_eq!(table.ask("WAV? 2 1"), "2 1=400.0\n");
    table.tell("WSL 1 2", 0);
    table.tell("WGC 1 2", 0);
    table.tell("WTR 1 2 1", 0);
    table.tell("RTR 2", 0);
    table.tell("WGO 1 1", 0);
    assert_eq!(
        (table.ask("WGO?").as_str(), table.send(b"\x09").as_slice()),
        ("1=1\n", &b"1\n"[..])
    );
    table.tell("MOV 1 5", 73);
    table.tell("WAV 2 X SIN_P 400 4 3 400 0 200", 73);
    table.run(1700);
    assert_eq!(
        (table.ask("WGO?").as_str(), table.send(b"\x09").as_slice()),
        ("1=0\n", &b"0\n"[..])
    );
    table.tell("RTR 1", 0);
    table.tell("RTR 2", 0);
    assert!(table.value("DRL? 1") >= 800.0);
    let answer = table.ask("DRR? 1 800 1 2 4");
    let (header, data) = answer.split_once("# END_HEADER \n").expect("a header");
    assert!(
        header.contains("# NDATA = 800 \n")
            && header.contains("# DIM = 3 \n")
            && header.contains("# SAMPLE_TIME = 0.000100000 \n")
    );
    let rows: Vec<Vec<f64>> = data
        .lines()
        .map(|row| {
            row.split_whitespace()
                .map(|word| word.parse().expect("a number"))
                .collect()
        })
        .collect();
    assert_eq!((rows.len(), rows[0].len()), (800, 3));
    assert!(data.ends_with('\n') && !data.ends_with(" \n"));
    let highest = |column: usize| rows.iter().map(|row| row[column]).fold(f64::MIN, f64::max);
    assert!((highest(0) - 7.0).abs() < 0.01, "target: {}", highest(0));
    assert!((highest(1) - 7.0).abs() < 0.1, "position: {}", highest(1));
    // Against the shape itself, some ticks later, where the offset of the take-over has gone.
    let late = (380..420).map(|delay| {
        let square = |nth: usize| {
            (rows[nth][0]
                - (5.0 - 2.0 * (core::f64::consts::TAU * (nth + delay) as f64 / 400.0).cos()))
            .powi(2)
        };
        (500..780).map(square).sum::<f64>()
    });
    let rms = (late.fold(f64::MAX, f64::min) / 280.0).sqrt();
    assert!(rms < 0.02, "{rms} um");
    table.tell("DRR? 2500 900 1", 77);
    let points = table.ask("GWD? 1 3 2");
    assert!(
        points.ends_with("# END_HEADER \n3.000000 \n3.000247 \n3.000987\n"),
        "{points}"
    );
}

#[test]
fn points_are_written_in_bunches() {
    let mut table = Table::ready();
    table.tell("WAV 1 X PNT 1 3 1 2 3", 0);
    table.tell("WAV 1 & PNT 4 2 4 5.5", 0);
    assert_eq!(table.ask("WAV? 1 1"), "1 1=5.0\n");
    assert!(
        table
            .ask("GWD? 1 5 1")
            .ends_with("\n1.000000 \n2.000000 \n3.000000 \n4.000000 \n5.500000\n")
    );
    table.tell("WAV 1 & PNT 6 2 4", 404);
    table.tell("WAV 1 & PNT 6 1 400", 405);
    table.tell("WAV 1 & PNT 6 1 4 5", 404);
    table.tell("WAV 1 X PNT 0 1 4", 400);
    table.tell("WAV 1 X PNT 4096 2 4 4", 403);
    table.tell("WAV 1 X SIN_P 5000 1 0 5000 0 2500", 403);
    table.tell("WAV 1 X SIN_P 500 100 0 500 0 250", 405);
    table.tell("WAV 1 X SIN_P 500 1 0 500 100 250", 405);
    table.tell("WAV 1 X TAN 1", 402);
    table.tell("WAV 5 X PNT 1 1 1", 17);
    assert_eq!(
        table.ask("WAV? 1 1"),
        "1 1=5.0\n",
        "what is refused changes nothing"
    );
    table.tell("WCL 1", 0);
    assert_eq!(table.ask("WAV? 1 1"), "1 1=0.0\n");
    table.tell("WSL 1 1", 0);
    table.tell("WGO 1 1", 401);
    table.tell("WGO 1 2", 406);
}

#[test]
fn parameters_are_named_by_numbers() {
    let mut table = Table::new();
    assert_eq!(table.ask("SPA? 1 0x0E000200"), "1 0xe000200=0.000050000\n");
    assert_eq!(table.ask("SPA? 1 234881536"), "1 0xe000200=0.000050000\n");
    table.tell("SPA 1 0x07000900 0.25", 0);
    assert_eq!(table.ask("SPA? 1 0x07000900"), "1 0x7000900=0.250000\n");
    assert_eq!(table.rig.0.borrow().tolerance, 1 << 22);
    table.tell("SPA 1 0x07000901 0.02", 0);
    assert_eq!(table.ask("SPA? 1 0x07000901"), "1 0x7000901=0.020000000\n");
    table.tell("SPA 1 0x0E000200 1", 64);
    table.tell("SPA 1 0x42 1", 54);
    table.tell("SPA? 1 0x42", 54);
    assert_eq!(table.ask("SPA?").lines().count(), 38);
    assert_eq!(
        table.ask("SPA? 1 0x7F000009 1 0x7F00000A"),
        "1 0x7f000009=16 \n1 0x7f00000a=16\n"
    );
    assert_eq!(table.ask("HPA?").lines().count(), 40);
    assert_eq!(
        table.ask("SPA? 1 0x7F000001"),
        "1 0x7f000001=15.000000000\n"
    );
    assert_eq!(
        table.ask("SPA? 1 0x7F000002"),
        "1 0x7f000002=-20.000000000\n"
    );
    table.tell("VEL 1 0", 8);
    table.tell("VEL 1 1e9", 8);
    table.tell("VEL 1 250.5", 0);
    assert_eq!(table.ask("VEL?"), "1=250.500000\n");
}

#[test]
fn what_is_wrong_is_said_by_its_number() {
    let mut table = Table::ready();
    for (line, error) in [
        ("XYZ", 2),
        ("MOV? 2", 15),
        ("MOV 2 1", 15),
        ("MOV 1", 26),
        ("MOV", 26),
        ("MOV 1 x", 1),
        ("MOV 1 99", 7),
        ("MOV 1 1e9", 7),
        ("MOV 1 1 1 1", 24),
        ("SVO 1 2", 17),
        ("SVO 1 yes", 1),
        ("DRC 9 1 1", 57),
        ("DRC 1 1 55", 58),
        ("DRT 0 9 0", 58),
        ("RTR 0", 17),
        ("WTR 1 0 0", 17),
    ] {
        table.tell(line, error);
    }
    table.send(&[&[b'x'; 600][..], b"\n"].concat());
    assert_eq!(table.ask("ERR?"), "3\n");
    table.rig.0.borrow_mut().sensor_is_there = false;
    table.run(10);
    table.tell("SVO 1 1", 333);
    table.tell("MOV 1 2", 5);
    assert_eq!(table.ask("SVO?"), "1=0\n");
}

#[test]
fn the_recorder_begins_when_it_is_told_to() {
    let mut table = Table::ready();
    assert_eq!(table.ask("DRT? 1"), "1=0 0\n");
    table.tell("MOV 1 1", 0);
    assert_eq!(table.ask("DRL? 1"), "1=0\n");
    table.tell("DRT 0 1 0", 0);
    assert_eq!(table.ask("DRL? 1"), "1=0\n");
    table.tell("MOV 1 2", 0);
    assert!(table.value("DRL? 1") > 0.0);
    table.ask("DRT 0 2 0");
    table.rig.clone().end_recording();
    table.rig.0.borrow_mut().samples.clear();
    table.tell("MOV 1 3", 0);
    assert!(table.value("DRL? 1") > 0.0);
    assert_eq!(table.ask("DRT? 1"), "1=0 0\n", "the next command was one");
    table.tell("DRC 1 1 7 2 1 0", 0);
    assert_eq!(table.ask("DRC? 1 2"), "1=1 7 \n2=1 0\n");
    table.tell("DRT 0 4 0", 0);
    table.run(50);
    assert_eq!(
        table.ask("DRR? 1 5").matches("NAME").count(),
        3,
        "a table that records nothing is not read"
    );
}

#[test]
fn with_the_servo_off_a_wave_is_a_drive_that_begins_and_ends_at_rest() {
    let mut table = Table::new();
    table.tell("ARM 1 2", 0);
    table.tell("WAV 1 X LIN 100 60 0 100 0 0", 0);
    table.tell("WAV 1 & LIN 100 -60 60 100 0 0", 0);
    table.tell("WAV 2 X PNT 1 2 1 79", 0);
    table.tell("WSL 1 1", 0);
    table.tell("WGC 1 1", 0);
    table.tell("WTR 1 10 0", 0);
    table.tell("RTR 10", 0);
    table.tell("WGO 1 1", 0);
    assert_eq!(
        (table.ask("WGO?").as_str(), table.ask("SVO?").as_str()),
        ("1=1\n", "1=0\n")
    );
    assert_eq!(table.send(b"\x07"), b"\xB1\n");
    table.tell("WGO 1 1", 93);
    table.run(3000);
    assert_eq!(table.ask("WGO?"), "1=0\n");
    assert!(table.rig.0.borrow().amplifier.drive_rests());
    let codes = table.ask("DRB? 1 190");
    assert_eq!(codes.lines().count(), 3, "72 samples in a line");
    assert!(
        codes
            .lines()
            .take(2)
            .all(|line| line.ends_with("= ") || line.len() == 489),
        "{codes}"
    );
    table.tell("DRB? 1 5000", 77);
    // The drive that was recorded is the wave.
    let highest = table
        .rig
        .0
        .borrow()
        .samples
        .iter()
        .map(|sample| sample.dac_code)
        .max()
        .expect("samples");
    let highest_v = f64::from(parameters().servo.converters.drive(highest)) / 4_194_304.0;
    assert!((highest_v - 60.0).abs() < 0.01, "{highest_v} V");
    // What is a drive is no position, and the other way round.
    table.tell("WSL 1 2", 0);
    table.tell("RON 1 0", 0);
    table.tell("SVO 1 1", 0);
    table.tell("WGO 1 1", 405);
    table.tell("SVO 1 0", 0);
    table.tell("WGO 1 1", 93);
    // Without an end it is played until it is stopped.
    table.send(b"STP\n");
    table.ask("ERR?");
    table.run(3000);
    table.tell("WGC 1 0", 0);
    table.tell("WGO 1 1", 0);
    table.run(3000);
    assert!(!table.rig.0.borrow().amplifier.drive_rests());
    table.tell("WGO 1 0", 0);
    table.run(3000);
    assert!(table.rig.0.borrow().amplifier.drive_rests());
}

#[test]
fn a_block_is_brought_and_taken_by_a_restart() {
    let mut table = Table::new();
    assert_eq!(table.ask("BLK?"), "NOTHING\n");
    let block = include_bytes!("../../emulator/tests/p753.block");
    table.tell(&format!("BLK BEGIN {}", block.len()), 0);
    for (nth, piece) in block.chunks(32).enumerate() {
        let digits: String = piece.iter().map(|byte| format!("{byte:02x}")).collect();
        table.tell(&format!("BLK DATA {} {digits}", 32 * nth), 0);
    }
    table.tell("BLK DATA 0 00", 311);
    table.tell("BLK DATA 0 0", 1);
    table.tell("BLK BEGIN 5000", 311);
    table.tell("BLK KEEP", 1);
    let upload = |table: &mut Table, bytes: &[u8]| {
        table.tell(&format!("BLK BEGIN {}", bytes.len()), 0);
        table.rig.0.borrow_mut().block = bytes.to_vec();
        table.tell("BLK COMMIT", 0);
    };
    upload(&mut table, &block[..]);
    assert_eq!(table.ask("BLK?"), "KEPT\n");
    upload(&mut table, &block[1..]);
    assert!(table.ask("BLK?").starts_with("REFUSED "), "with its reason");
    table.tell("SVA 1 20", 4001);
    table.tell("ARM 1 2", 0);
    table.tell("SVA 1 20", 0);
    table.run(3000);
    for line in ["BLK COMMIT", "RBT"] {
        table.tell(line, 93);
    }
    assert_eq!(table.rig.0.borrow().restarts, 0);
    table.send(b"STP\n");
    table.run(3000);
    table.ask("ERR?");
    table.tell("RBT", 0);
    assert_eq!(table.rig.0.borrow().restarts, 1);
}

#[test]
fn a_block_takes_over_a_running_loop_or_the_running_one_goes_on() {
    let mut table = Table::ready();
    table.tell("MOV 1 5", 0);
    table.run(4000);
    let bring = |table: &mut Table, parameters: &AmplifierParameters| {
        let mut bytes = [0; BLOCK_BYTES];
        let length = write(parameters, &mut bytes).expect("fits");
        table.tell(&format!("BLK BEGIN {length}"), 0);
        for (nth, piece) in bytes[..length].chunks(32).enumerate() {
            let digits: String = piece.iter().map(|byte| format!("{byte:02x}")).collect();
            table.tell(&format!("BLK DATA {} {digits}", 32 * nth), 0);
        }
        table.tell("BLK SWAP", 0);
    };
    let mut softer = parameters();
    if let LawParameters::Predictor(p) = &mut softer.servo.law {
        p.unknown_gain = p.unknown_gain / 4 * 3;
    }
    bring(&mut table, &softer);
    assert_eq!(table.ask("BLK?"), "SWAPPED\n");
    table.run(2000);
    assert_eq!(table.ask("SVO?"), "1=1\n");
    assert!((table.value("POS? 1") - 5.0).abs() < 0.02);
    let running = table.rig.0.borrow().amplifier.parameters().servo.law;
    assert_eq!(running, softer.servo.law);
    let mut other = parameters();
    other.physical.name[0] = b'q';
    bring(&mut table, &other);
    assert_eq!(table.ask("BLK?"), "REFUSED made for another stage\n");
    assert_eq!(
        (
            table.ask("SVO?").as_str(),
            table.rig.0.borrow().amplifier.parameters().servo.law == running
        ),
        ("1=1\n", true)
    );
    table.tell("BLK SWAP 1", 24);
}

#[test]
fn it_says_how_it_is_and_a_fault_is_cleared() {
    let mut table = Table::ready();
    assert_eq!(table.ask("DIA? 1 3 9"), "1=2 \n3=7 \n9=3735928559\n");
    assert_eq!(
        table.ask("DIA?").lines().count() + 2,
        table.ask("HDI?").lines().count()
    );
    assert_eq!(table.ask("DIA? 16 18 20"), "16=1050000 \n18=-85 \n20=312\n");
    table.tell("DIA? 21", 54);
    table.tell("IFC RSBAUD 921600", 0);
    assert_eq!(table.ask("IFC? RSBAUD"), "RSBAUD=921600\n");
    table.tell("IFC RSBAUD 9000000", 17);
    table.rig.0.borrow_mut().sensor_is_there = false;
    table.run(10);
    assert_eq!(table.ask("DIA? 1 2"), "1=3 \n2=1\n");
    table.tell("INI 1", 333);
    table.rig.0.borrow_mut().sensor_is_there = true;
    table.run(5000);
    table.tell("INI 1", 0);
    assert_eq!(table.ask("DIA? 1 2"), "1=0 \n2=0\n");
}

#[test]
fn it_says_how_well_the_loop_followed_and_whether_its_resonance_rings() {
    let mut table = Table::ready();
    assert_eq!(
        table.ask("SPA? 1 0x7F000007 1 0x7F000008"),
        "1 0x7f000007=0.000 \n1 0x7f000008=0.000\n"
    );
    assert_eq!(table.ask("DIA? 13 14 15"), "13=0 \n14=0 \n15=0\n");
    for (refused, error) in [
        ("07 79.9", 17),
        ("07 9920.1", 17),
        ("07 -735", 17),
        ("08 -1", 17),
        ("08 256001", 17),
        ("10 3", 64),
        ("13 3", 64),
    ] {
        table.tell(&format!("SPA 1 0x7F0000{refused}"), error);
    }
    table.tell("SPA 1 0x7F000007 735 1 0x7F000008 0.001", 0);
    table.tell("MOV 1 5", 0);
    table.run(41_000);
    let figures = table.rig.0.borrow().telemetry.figures();
    let numbers: Vec<f64> = (0x10..0x14)
        .map(|nth| table.value(&format!("SPA? 1 0x7F0000{nth:x}")))
        .collect();
    let [rms_nm, peak_nm, drive_v, resonance_nm] = numbers[..] else {
        panic!()
    };
    assert_eq!((rms_nm * 1000.0).round() as u32, figures.error_rms_pm);
    assert_eq!((peak_nm * 1000.0).round() as u32, figures.error_peak_pm);
    assert_eq!((drive_v * 1e6).round() as u32, figures.drive_rms_uv);
    assert_eq!((resonance_nm * 1000.0).round() as u32, figures.resonance_pm);
    // The second second rests at 5 um: noise of the sensor, and the drive that holds it.
    assert!(
        (0.1..20.0).contains(&rms_nm)
            && peak_nm >= rms_nm
            && resonance_nm < rms_nm
            && resonance_nm > 0.001,
        "{numbers:?}"
    );
    assert!((drive_v - table.value("VOL? 1")).abs() < 0.5, "{drive_v}");
    assert_eq!(table.ask("DIA? 13 14 15"), "13=2 \n14=0 \n15=1\n");
    // Another alarm begins anew.
    table.tell("SPA 1 0x7F000008 250000", 0);
    assert_eq!(table.ask("DIA? 15"), "15=0\n");
    table.run(20_100);
    assert_eq!(table.ask("DIA? 13 15"), "13=3 \n15=0\n");
    table.tell("SVO 1 0", 0);
    table.run(30_000);
    assert_eq!(table.ask("DIA? 13 14"), "13=3 \n14=0\n");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_do_harm(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let mut table = Table::new();
        table.send(&bytes);
        // Whatever came, the line is in step again.
        table.send(b"\n");
        table.send(b"ERR?\n");
        prop_assert_eq!(table.ask("ERR?"), "0\n");
    }

    /// Words of the protocol in any order, which reach further than bytes do.
    #[test]
    fn no_words_do_harm(lines in proptest::collection::vec(
        ("(ARM|MOV|MVR|SVO|RON|FRF\\?|SVA|WAV|WAV\\?|WSL|WGO|WGC|WTR|WCL|DRC|DRT|DRR\\?|DRL\\?|GWD\\?|RTR|SPA|SPA\\?|VEL|HLT|STP|ATZ|POS\\?|ONT\\?|HPA\\?|BLK|INI|RBT|IFC|DIA\\?|DRB\\?)",
         proptest::collection::vec("(1|0|2|4|7|X|&|BEGIN|DATA|COMMIT|00ff|RSBAUD|PNT|SIN_P|RAMP|LIN|100|-3|1e-3|4294967295|9e9|-9e9|0x7000900|0x7000200|[0-9.eE+-]{1,6})", 0..8)), 1..25)) {
        let mut table = Table::new();
        table.tell("ARM 1 2", 0);
        for (mnemonic, words) in lines {
            table.send(format!("{mnemonic} {}\n", words.join(" ")).as_bytes());
            let reference = table.rig.0.borrow().latest.reference;
            let drive = table.rig.0.borrow().latest.dac_code;
            let (c, guard) = (parameters().servo.converters, parameters().guard);
            prop_assert!(reference <= c.position(guard.adc_code_max) && reference >= c.position(guard.adc_code_min));
            prop_assert!((c.dac_code_min..=c.dac_code_max).contains(&drive));
        }
        table.send(b"ERR?\n");
        prop_assert_eq!(table.ask("ERR?"), "0\n");
    }
}

#[test]
fn a_finished_wave_is_not_read_again() {
    let mut table = Table::ready();
    table.tell("WAV 1 X LIN 100 2 3 100 0 0", 0);
    table.tell("WSL 1 1", 0);
    table.tell("WGC 1 1", 0);
    table.tell("WGO 1 1", 0);
    table.run(3000);
    assert_eq!(table.send(b"\x09"), b"0\n", "the wave has ended");
    let before = table.rig.0.borrow().latest.reference;
    // Positions of another place, for the next start: the stage stays where it is.
    table.tell("WAV 1 X LIN 100 0 9 100 0 0", 0);
    table.run(100);
    let (reference, mode) = (
        table.rig.0.borrow().latest.reference,
        table.rig.0.borrow().amplifier.mode(),
    );
    // The offset of the take-over still decays, by less than a nanometre.
    assert!(
        mode == Mode::Closed && (reference - before).abs() < (1 << 24) / 1000,
        "{mode:?}: {before} and {reference}"
    );
}

#[test]
fn a_wave_of_drives_is_no_wave_of_positions() {
    let mut table = Table::ready();
    // 60 V are a drive, and no position of a sensor of 15 um.
    table.tell("WAV 1 X LIN 100 0 60 100 0 0", 405);
    table.tell("WAV 1 X LIN 100 0 5 100 0 0", 0);
    table.tell("WSL 1 1", 0);
    table.tell("SVO 1 0", 0);
    table.tell("STP", 10);
    table.run(3000);
    table.tell("WGO 1 1", 405);
}

#[test]
fn a_held_axis_does_not_begin_to_move_after_a_day() {
    let mut table = Table::ready();
    table.tell("MOV 1 5", 0);
    table.run(3000);
    assert_eq!(
        (table.send(b"\x05"), table.ask("ONT?")),
        (b"0\n".to_vec(), "1=1\n".to_string())
    );
    // 29.8 h, 44.7 h and 59.7 h at 20 kHz.
    for skipped in [1u64 << 31, 3 << 30, u64::from(u32::MAX), 5 << 33] {
        table.rig.0.borrow_mut().skipped = skipped;
        assert_eq!(
            (table.send(b"\x05"), table.ask("ONT?")),
            (b"0\n".to_vec(), "1=1\n".to_string()),
            "{skipped} ticks"
        );
        table.tell("MOV 1 5.5", 0);
        table.run(3000);
        assert_eq!(table.ask("ONT?"), "1=1\n", "{skipped} ticks");
        table.tell("MOV 1 5", 0);
        table.run(3000);
    }
}

#[test]
fn a_safety_envelope_is_kept_only_by_its_checksum_and_with_the_power_stage_off() {
    let mut table = Table::new();
    assert_eq!(
        (table.ask("ENV?").as_str(), table.ask("LOG?").as_str()),
        ("NONE\n", "NONE\n")
    );
    let envelope = SafetyEnvelope {
        name: [0; 16],
        stage: *b"117042917\0\0\0\0\0\0\0",
        drive_max: DriveCode::new(299_593),
        slew_limit_v_s: 1_000,
        tracking_error_nm: 1_000,
        drive_reads_back: false,
        monitor_span_uv: 0,
        set_point_span_nm: 0,
        amplifier_span_decicelsius: 0,
        sensor_corrections: [0; 15],
        ..SafetyEnvelope::EXAMPLE
    };
    let mut bytes = [0; safety_envelope::ENVELOPE_BYTES];
    let length = safety_envelope::write(&envelope, &mut bytes).expect("fits");
    table.rig.0.borrow_mut().block = bytes[..length].to_vec();
    let checksum = safety_envelope::fingerprint(&envelope);
    table.tell(&format!("BLK ENVELOPE {:#x}", checksum ^ 1), 0);
    assert!(table.ask("BLK?").starts_with("REFUSED"));
    table.tell("ARM 1 2", 0);
    table.tell(&format!("BLK ENVELOPE {checksum:#x}"), 93);
    table.tell("ARM 1 0", 0);
    table.run(10);
    table.tell(&format!("BLK ENVELOPE {checksum:#x}"), 0);
    assert_eq!(table.ask("BLK?"), "KEPT\n");
    let said = table.ask("ENV?");
    assert!(
        said.contains(&format!("CHECKSUM={checksum:#010x}"))
            && said.contains("STAGE=117042917")
            && said.contains("DRIVE=0.000 20.000 V"),
        "{said}"
    );
    let event = |tick, fault| DeviceEvent {
        start: 3,
        tick,
        fault,
    };
    table.rig.0.borrow_mut().events = vec![event(7, Fault::Watchdog), event(900, Fault::Interlock)];
    assert_eq!(
        table.ask("LOG?"),
        "START=3 TICK=900 FAULT=14 interlock \nSTART=3 TICK=7 FAULT=9 watchdog\n"
    );
}

#[test]
fn codes_of_both_converters_are_read_by_their_channel() {
    let mut table = Table::new();
    table.run(10);
    let code = table.rig.0.borrow().latest.adc_code.steps();
    assert_eq!(table.ask("TAD? 1"), format!("1={code}\n"));
    table.tell("TAD? 2", 15);
    table.rig.0.borrow_mut().monitor_code = Some(7_281);
    assert_eq!(table.ask("TAD? 2"), "2=7281\n");
    table.tell("TAD? 3", 15);
}

#[test]
fn an_analogue_set_point_is_followed_only_with_the_servo_on() {
    let mut table = Table::ready();
    let (follow, leave) = ("SPA 1 0x06000500 3", "SPA 1 0x06000500 0");
    table.tell(follow, 15);
    let wired = SetPointParameters::new(-1_000, 15_000, 1_000, 8_000);
    let code = |um: f64| Some(((um + 1.0) / 15.0 * 65_536.0) as u16);
    {
        let mut rig = table.rig.0.borrow_mut();
        rig.amplifier.wire_input(SetPoint::new(wired));
        rig.set_point_code = code(4.0);
    }
    table.tell("VEL 1 500", 0);
    for refused in ["SPA 1 0x06000500 2", "SPA 1 0x06000500 3 1 0x7F000020 735"] {
        table.ask(refused);
        assert_ne!(table.ask("ERR?"), "0\n", "{refused}");
    }
    let before = table.value("POS? 1");
    table.tell(follow, 0);
    table.run(20);
    assert!((table.value("POS? 1") - before).abs() < 0.6, "no step");
    table.run(2_000);
    assert!((table.value("POS? 1") - 4.0).abs() < 0.02);
    assert_eq!(table.ask("SPA? 1 0x06000500"), "1 0x6000500=3\n");
    assert_eq!(table.ask("DIA? 19"), "19=1\n");
    table.tell("MOV 1 5", 73);
    table.rig.0.borrow_mut().set_point_code = code(12.0);
    table.run(2_000);
    assert!((table.value("POS? 1") - 8.0).abs() < 0.02);
    assert_eq!(table.ask("DIA? 19"), "19=2\n");
    // Where it has led to the loop stays, and goes on from there.
    table.tell(leave, 0);
    table.rig.0.borrow_mut().set_point_code = code(2.0);
    table.run(500);
    assert!((table.value("POS? 1") - 8.0).abs() < 0.02);
    table.tell("MOV 1 6", 0);
    table.tell(follow, 0);
    table.rig.0.borrow_mut().set_point_code = Some(0);
    table.run(10);
    assert_eq!(table.ask("DIA? 1 2"), "1=3 \n2=36\n");
    table.run(2_000);
    table.tell("INI 1", 0);
    table.tell(follow, 4001);
}

#[test]
fn filters_are_tuned_while_the_axis_moves_without_a_step() {
    let mut table = Table::ready();
    table.tell("VEL 1 100", 0);
    table.tell("MOV 1 8", 0);
    table.run(600);
    let largest_step = |table: &Table, ticks: u32| {
        let mut largest = 0;
        for _ in 0..ticks {
            let before = table.rig.0.borrow().latest.dac_code;
            table.run(1);
            largest = largest.max(table.rig.0.borrow().latest.dac_code.abs_diff(before));
        }
        largest
    };
    let before = largest_step(&table, 100);
    for line in [
        "SPA 1 0x7F000020 735 1 0x7F000021 40 1 0x7F000024 3000",
        "SPA 1 0x7F000030 4000",
        "SPA 1 0x7F000022 900",
        "SPA 1 0x7F000020 0 1 0x7F000030 0",
    ] {
        table.tell(line, 0);
        assert_eq!(table.ask("SVO?"), "1=1\n");
        let behind = largest_step(&table, 100);
        assert!(
            behind <= before + 40,
            "{line}: {behind} codes a tick, {before} before"
        );
    }
    assert_eq!(table.value("SPA? 1 0x7F000021"), 40.0);
    assert_eq!(
        (
            table.value("SPA? 1 0x7F000020"),
            table.value("SPA? 1 0x7F000022"),
            table.value("SPA? 1 0x7F000024")
        ),
        (0.0, 900.0, 3000.0)
    );
    table.run(4000);
    assert_eq!(table.ask("ONT?"), "1=1\n");
    // Beyond the limits nothing of a line acts.
    table.tell("SPA 1 0x7F000022 500 1 0x7F000034 9", 17);
    table.tell("SPA 1 0x7F000034 9500", 17);
    table.tell("SPA 1 0x7F000034 -100", 17);
    // Nor does a line of which the loop has no margin for a part.
    table.tell("SPA 1 0x7F000022 500 1 0x7F000034 200", 4005);
    table.tell("SPA 1 0x7F000030 300 1 0x7F000031 300", 4005);
    assert_eq!(table.value("SPA? 1 0x7F000022"), 900.0);
}

#[test]
fn settings_are_kept_at_rest_and_come_back() {
    let mut table = Table::ready();
    table.tell("WPA 100", 93);
    let mut table = Table::new();
    for line in [
        "VEL 1 250",
        "SPA 1 0x07000900 0.05",
        "SPA 1 0x7F000006 2",
        "SPA 1 0x7F000007 735",
        "SPA 1 0x7F000030 4000 1 0x7F000034 9000",
    ] {
        table.tell(line, 0);
    }
    table.tell("WPA 99", 17);
    table.tell("WPA", 26);
    assert_eq!(table.rig.0.borrow().kept, None);
    table.tell("WPA 100", 0);
    let kept = table.rig.0.borrow().kept;
    let again = |stage: [u8; 16]| {
        let mut table = Table::new();
        table.rig.0.borrow_mut().kept = kept.map(|kept| KeptSettings { stage, ..kept });
        let waves: Vec<AtomicI32> = (0..WAVE_TABLES * 4096).map(|_| AtomicI32::new(0)).collect();
        table.session = Session::new(
            table.rig.clone(),
            parameters(),
            Box::leak(waves.into_boxed_slice()),
        );
        [
            "VEL? 1",
            "SPA? 1 0x07000900",
            "SPA? 1 0x7F000006",
            "SPA? 1 0x7F000007",
            "SPA? 1 0x7F000030",
            "SPA? 1 0x7F000034",
        ]
        .map(|line| table.value(line))
    };
    assert_eq!(
        again(parameters().physical.name),
        [250.0, 0.05, 2.0, 735.0, 4000.0, 9000.0]
    );
    // Another stage begins as a new one: ten times its span in a second, a thousandth of it.
    assert_eq!(again([b'x'; 16]), [150.0, 0.015, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn a_command_that_lost_a_byte_or_goes_too_far_moves_nothing() {
    let mut table = Table::ready();
    table.tell("SVO 1 0", 0);
    let sealed = |line: &str| format!("{line} *{:08X}", seal::checksum(line));
    table.tell(&sealed("SVA 1 10.0"), 0);
    table.run(4_000);
    let whole = sealed("SVA 1 20.5");
    for at in 0..whole.len() {
        let mut less = whole.clone();
        less.remove(at);
        let before = table.rig.0.borrow().latest.dac_code;
        let answer = table.ask(&less);
        let error = table.ask("ERR?");
        assert_ne!((answer.as_str(), error.as_str()), ("", "0\n"), "{less}");
        table.run(3);
        assert_eq!(table.rig.0.borrow().latest.dac_code, before, "{less}");
    }
    table.tell("SPA 1 0x7F00000B 1.5 1 0x7F00000C 15", 0);
    assert_eq!(
        table.ask("SPA? 1 0x7F00000B 1 0x7F00000C"),
        "1 0x7f00000b=1.500000 \n1 0x7f00000c=15.000000\n"
    );
    table.tell("SVA 1 26", 4004);
    table.tell("SVA 1 26 FAR", 0);
    table.tell("SVA 1 26 FURTHER", 24);
    table.run(4_000);
    assert!((table.value("VOL?") - 26.0).abs() < 0.01);
    table.tell("SVO 1 1", 0);
    table.run(2_000);
    let here = table.value("MOV?");
    table.tell(&format!("MOV 1 {}", here + 2.0), 4004);
    table.tell("MVR 1 2", 4004);
    table.tell("MVR 1 1.25", 0);
    table.tell("MVR 1 2 FAR", 0);
    assert!((table.value("MOV?") - here - 3.25).abs() < 1e-5);
    table.session.lost_bytes();
    assert_eq!(table.ask("ERR?"), "4003\n");
}
