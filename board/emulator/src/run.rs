//! One run of the image: the emulated part, a probe that serves RTT every so often of virtual time, and the
//! decoded log.

use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use anyhow::{Context, Result, anyhow, bail};
use defmt_decoder::{DecodeError, Table};
use hysteron_core::codes::DriveCode;
use hysteron_core::safety_envelope::{self, SafetyEnvelope};
use hysteron_sim::converter_scale::ConverterScale;
use object::{Object, ObjectSection, ObjectSymbol};
use rigless::device::Level;
use rigless::emulator::{Driver, Host, InterruptLine, Start, Stop, run as emulate};
use rigless::image::Image;
use rigless::mcu::Mcu;
use rigless::session::Session;
use rigless::soc::stm32h743::generated::{iwdg, rcc, spi1, tim2, usart1 as usart};
use rigless::soc::{Bus, Layout, RegisterSpec, Slot, Width};
use rigless::time::VirtualNanos;

use crate::board::{NucleoBoard, SafetyLine};
use crate::converters::SharedWorld;
use crate::real_time_transfer::ControlBlock;
use crate::serial_line::SharedLine;

/// Nanoseconds in a millisecond.
pub const MILLISECOND: u64 = 1_000_000;

/// Where the parameter blocks stand (`memory.x`, SETTINGS).
const SETTINGS: [u64; 2] = [0x081C_0000, 0x081E_0000];

/// Where the safety envelope stands.
const ENVELOPE: u64 = 0x0818_0000;

/// Where the settings stand that an operator keeps.
const KEPT_SETTINGS: u64 = 0x0816_0000;

/// The boot stage, which stands beside every image.
const BOOT_STAGE: &str = "hysteron-boot-stage";

/// The envelope of the emulated bench: -20..120 V on 20 bits, of which what the reference actuator bears may
/// act. Its guards and its current are those of firmware/README.md, *Safety envelope*.
#[must_use]
pub fn bench_envelope() -> SafetyEnvelope {
    SafetyEnvelope {
        name: *b"emulated bench\0\0",
        // Runs bring blocks of many stages.
        stage: [0; 16],
        dac_bits: 20,
        sensor_is_signed: false,
        reference_span_mv: 14_000,
        drive_at_code_0_uv: -20_000_000,
        drive_span_uv: 140_000_000,
        drive_min: DriveCode::new(149_760),
        drive_max: DriveCode::new(899_000),
        safe_code: DriveCode::new(149_797),
        slew_limit_v_s: 100_000,
        rest_within_ms: 100,
        stuck_within_ms: 10,
        tracking_within_ms: 5,
        tracking_error_nm: 2_500,
        sensor_margin: 16,
        // Shorter than the manual's: a run need not wait a tenth of a second for it.
        healthy_ms: 5,
        capacitance_nf: 1_500,
        current_ua: 60_000,
        drive_reads_back: false,
        monitor_at_code_0_uv: 0,
        monitor_span_uv: 0,
        monitor_tolerance_mv: 0,
        monitor_lag_us: 0,
        set_point_at_code_0_nm: 0,
        set_point_span_nm: 0,
        set_point_min_nm: 0,
        set_point_max_nm: 0,
        amplifier_at_code_0_decicelsius: 0,
        amplifier_span_decicelsius: 0,
        amplifier_most_decicelsius: 0,
        sensor_span_nm: 15_000,
        sensor_corrections: [0; 15],
        jump_within_nm: 1_500,
        // Most runs are about something else than the self-test, which takes half a second.
        closes_untested: true,
    }
}

/// The bench with guards so wide that nothing but the limits of the drive acts.
#[must_use]
pub fn unguarded_envelope() -> SafetyEnvelope {
    SafetyEnvelope {
        tracking_within_ms: 200,
        tracking_error_nm: 127_000,
        current_ua: 200_000,
        jump_within_nm: 8_000,
        ..bench_envelope()
    }
}

/// The bench with the drive's SDO and the amplifier's voltage monitor wired: -30..150 V over the
/// part's 3.3 V. The part's inputs have whole millivolts, 55 mV of the drive, and the bench sets them once
/// a period.
#[must_use]
pub fn watched_envelope() -> SafetyEnvelope {
    SafetyEnvelope {
        drive_reads_back: true,
        monitor_at_code_0_uv: -30_000_000,
        monitor_span_uv: 180_000_000,
        // The bench sets the input up to three periods late: of a step of 20 V that is 0.75 V of this lag.
        monitor_tolerance_mv: 1_000,
        monitor_lag_us: 4_000,
        ..bench_envelope()
    }
}

/// The envelope of a bench with converters of this scale: what its actuator bears.
#[must_use]
pub fn envelope_of(scale: &ConverterScale) -> SafetyEnvelope {
    let bench = bench_envelope();
    let codes = |code: DriveCode| {
        DriveCode::new(code.steps() << bench.dac_bits.saturating_sub(scale.dac_bits))
    };
    let lowest = codes(scale.dac_code(scale.drive_min_v));
    let sensor_span_um = scale.adc_lsb_um * 2f64.powi(i32::from(scale.adc_bits));
    let sensor_span_nm = (sensor_span_um * 1e3).round() as u32;
    SafetyEnvelope {
        drive_at_code_0_uv: (scale.dac_zero_v * 1e6).round() as i32,
        drive_span_uv: (scale.dac_lsb_v * 2f64.powi(i32::from(scale.dac_bits)) * 1e6).round()
            as u32,
        drive_min: lowest,
        drive_max: codes(scale.dac_code(scale.drive_max_v)),
        safe_code: lowest,
        sensor_span_nm,
        // A stage's range is at most what its sensor reads: `design` asks for a fifth of it, and for jumps of
        // less than half.
        tracking_error_nm: sensor_span_nm / 5,
        jump_within_nm: sensor_span_nm / 2,
        ..bench
    }
}

/// The envelope of a bench with a stick-slip drive: a smaller piezo, which saw-teeth of 80 V at 200 Hz
/// charge with 7 mA RMS.
#[must_use]
pub fn stick_slip_envelope(scale: &ConverterScale) -> SafetyEnvelope {
    SafetyEnvelope {
        capacitance_nf: 150,
        ..envelope_of(scale)
    }
}

/// An envelope as it stands in flash.
#[must_use]
pub fn envelope_bytes(envelope: &SafetyEnvelope) -> Vec<u8> {
    let mut bytes = [0; safety_envelope::ENVELOPE_BYTES];
    let length = safety_envelope::write(envelope, &mut bytes).unwrap_or(0);
    bytes[..length].to_vec()
}

/// The first address behind the flash: what reads a word there has a bus error, as at a word that is damaged,
/// and is meant to survive it.
const BEYOND_FLASH: u64 = 0x0820_0000;

/// What the probe does in a run.
#[derive(Clone, Debug)]
pub struct Script {
    /// Virtual time to run, ns.
    pub until_ns: u64,
    /// How often the probe reads RTT, ns; `None`: a probe that is not there.
    pub read_every_ns: Option<u64>,
    /// A parameter block that is in the flash at the start, in the first place.
    pub block: Option<Vec<u8>>,
    /// Another one, in the second place.
    pub second_block: Option<Vec<u8>>,
    /// The safety envelope that the board has: that of the bench, unless the caller specifies another.
    pub envelope: Option<Vec<u8>>,
    /// Settings that an operator has kept.
    pub kept: Option<Vec<u8>>,
    /// What the amplifier's voltage monitor is on: the board sets the part's input once a period.
    pub monitored: Option<SharedWorld>,
    /// The option bytes let the watchdog start with the supply.
    pub hardware_watchdog: bool,
    /// Bytes for the command channel, each with the instant from which it is sent, ns; in order.
    pub commands: Vec<(u64, Vec<u8>)>,
    /// Bytes for the serial port, each with the instant from which they are sent, ns; in order.
    pub serial: Vec<(u64, Vec<u8>)>,
    /// What goes wrong, each with its instant, ns; in order.
    pub injections: Vec<(u64, Injection)>,
    /// What else is in the flash at the start, each with its address.
    pub flash: Vec<(u64, Vec<u8>)>,
    /// Words of memory that are looked at, each with its instant, ns; in order.
    pub peeks: Vec<(u64, u64)>,
    /// The serial port's line, where another thread has its far end.
    pub line: Option<SharedLine>,
    /// The run ends when this is set, before its time.
    pub ended: Option<Arc<AtomicBool>>,
}

/// What can go wrong with the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Injection {
    /// A halfword of the target's memory changes: code in ITCM that has gone bad.
    Halfword {
        /// Address.
        address: u64,
        /// New value.
        value: u16,
    },
    /// The interface of the drive's converter is switched off: SPI3's CR1, RM0433, 50.11.1.
    DriveInterfaceOff,
    /// A line of the board is opened, or closed to ground.
    Line {
        /// Which one.
        line: SafetyLine,
        /// Closed to ground: fine.
        closed: bool,
    },
    /// Of a million bytes to the serial port so many arrive with noise and with a framing error from now on.
    SerialErrors {
        /// With noise.
        noise: u32,
        /// With a framing error.
        framing: u32,
    },
    /// The serial port's receiver asks for no interrupt from now on, or does again: its queue runs over.
    SerialDeaf(bool),
    /// The part's supply changes; what the voltage detector makes of it reaches its line of the EXTI.
    Supply {
        /// To so much, mV.
        millivolts: u32,
    },
    /// The analogue set point changes.
    SetPoint {
        /// To so much, mV.
        millivolts: u32,
    },
    /// What the sensor of the amplifier's temperature gives changes.
    AmplifierTemperature {
        /// To so much, mV.
        millivolts: u32,
    },
    /// The part gets warmer or colder.
    Temperature {
        /// To so much, hundredths of a degree Celsius.
        centi_celsius: i32,
    },
    /// The part loses its supply and has it again: what the image does not initialise holds anything.
    SupplyLost,
    /// The part restarts with these flags in RCC_RSR (RM0433, 8.7.39), those of the reset pin included.
    Restart {
        /// Flags.
        flags: u64,
    },
}

/// RCC_RSR: the independent watchdog bit.
pub const WATCHDOG_FLAG: u64 = 1 << 26;
/// RCC_RSR: brown-out.
pub const BROWN_OUT_FLAG: u64 = 1 << 21;
/// RCC_RSR: the supply was switched on.
const SWITCHED_ON_FLAGS: u64 = 1 << 23 | BROWN_OUT_FLAG;
/// What memory holds behind a loss of the supply.
const ANYTHING: u64 = 0x5EED_F00D;

impl Script {
    /// Runs for so long with a probe that reads every millisecond and sends nothing.
    #[must_use]
    pub fn listening(until_ns: u64) -> Self {
        Self {
            until_ns,
            read_every_ns: Some(MILLISECOND),
            block: None,
            second_block: None,
            envelope: Some(envelope_bytes(&bench_envelope())),
            kept: None,
            monitored: None,
            hardware_watchdog: false,
            commands: Vec::new(),
            serial: Vec::new(),
            injections: Vec::new(),
            flash: Vec::new(),
            peeks: Vec::new(),
            line: None,
            ended: None,
        }
    }
}

/// A log message and the instant at which the probe saw it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Virtual time at which the probe took it, ns.
    pub at_ns: u64,
    /// Level, lower case, empty for `println`.
    pub level: String,
    /// Text.
    pub text: String,
}

/// What a run left.
#[derive(Debug)]
pub struct Outcome {
    /// The board with its converters.
    pub board: Box<NucleoBoard>,
    /// Everything that came up the RTT channel.
    pub raw: Vec<u8>,
    /// The decoded log.
    pub messages: Vec<Message>,
    /// Frames that could not be decoded.
    pub malformed: u32,
    /// Bytes that the serial port sent, each with its instant, ns.
    pub serial: Vec<(u64, u8)>,
    /// Where the run stood at its end: virtual time, ns, and instructions.
    pub end: (u64, u64),
    /// Instants at which the enable output was seen to change, ns, and to what; looked at once a millisecond.
    pub enabled: Vec<(u64, bool)>,
    /// The same of the trigger output, as often as the log is read.
    pub triggered: Vec<(u64, bool)>,
    /// The same of the lights LD1 (green), LD2 (yellow) and LD3 (red).
    pub lights: Vec<(u64, [bool; 3])>,
    /// What the looks of [`Script::peeks`] saw.
    pub peeked: Vec<u64>,
    /// Restarts of the part during the run.
    pub resets: usize,
    /// Registers without a model that the image used, `instance.register`.
    pub without_model: Vec<String>,
}

impl Outcome {
    /// Texts of all messages that contain `part`.
    pub fn texts_with<'a>(&'a self, part: &'a str) -> impl Iterator<Item = &'a str> {
        self.messages
            .iter()
            .map(|message| message.text.as_str())
            .filter(move |text| text.contains(part))
    }
}

#[derive(Debug, Default)]
struct Taken {
    raw: Vec<u8>,
    /// Length of `raw` after each visit of the probe, with its instant.
    visits: Vec<(usize, u64)>,
    enabled: Vec<(u64, bool)>,
    triggered: Vec<(u64, bool)>,
    lights: Vec<(u64, [bool; 3])>,
    peeked: Vec<u64>,
}

/// Notes what is seen at an instant if it is not what was seen last; everything begins low.
fn note_change<T: Copy + PartialEq + Default>(seen: &mut Vec<(u64, T)>, at_ns: u64, now: T) {
    if seen.last().map_or_else(T::default, |(_, last)| *last) != now {
        seen.push((at_ns, now));
    }
}

struct Probe {
    script: Script,
    control_block: ControlBlock,
    next_command: usize,
    next_injection: usize,
    next_serial: usize,
    line: SharedLine,
    watchdog: Watchdog,
    /// Until when the voltage detector's interrupt is asked for.
    detector_until_ns: Option<u64>,
    next_read_ns: u64,
    sent_of_command: usize,
    taken: Arc<Mutex<Taken>>,
    /// Memory that no start of the image initialises.
    uninitialised: Range<u64>,
}

impl Probe {
    fn serve(&mut self, at_ns: u64, host: &mut dyn Host) {
        if !self.control_block.ready(host) {
            return;
        }
        if self.script.read_every_ns.is_some()
            && let Ok(mut taken) = self.taken.lock()
        {
            let taken = &mut *taken;
            self.control_block.take_up(host, &mut taken.raw);
            taken.visits.push((taken.raw.len(), at_ns));
        }
        while let Some((from_ns, bytes)) = self.script.commands.get(self.next_command) {
            if at_ns < *from_ns {
                break;
            }
            let rest = bytes.get(self.sent_of_command..).unwrap_or(&[]);
            self.sent_of_command += self.control_block.put_down(host, rest).unwrap_or(0);
            if self.sent_of_command < bytes.len() {
                break;
            }
            self.next_command += 1;
            self.sent_of_command = 0;
        }
    }
}

/// The part's independent watchdog, which the emulated part keeps the registers of and nothing more: 32 kHz
/// by the prescaler, counted down from the reload value, started by any key of its set-up and fed by the key
/// 0xAAAA. Looked at once a millisecond.
#[derive(Debug, Default)]
pub struct Watchdog {
    running: bool,
    fed_at_ns: u64,
}

impl Watchdog {
    const FEED: u64 = 0xAAAA;

    /// Restarts the part if it bites now.
    pub fn serve(&mut self, session: &mut Session<NucleoBoard>, stop: Stop, host: &mut dyn Host) {
        if self.bites(session, stop.at.0) {
            *self = Self::default();
            restart(session, stop, WATCHDOG_FLAG, host);
        }
    }

    /// Whether it bites now.
    fn bites(&mut self, session: &mut Session<NucleoBoard>, at_ns: u64) -> bool {
        let bus = session.mcu().bus_mut();
        let Some(slot) = bus.slot_of("IWDG") else {
            return false;
        };
        let registers = bus.slot_mut(slot).registers_mut();
        let key = registers.get(iwdg::Register::Kr);
        if key != 0 {
            registers.set(iwdg::Register::Kr, 0);
            // Only the last key since the last look is seen; at the first one the set-up has just been done.
            if key == Self::FEED || !self.running {
                self.fed_at_ns = at_ns;
            }
            // Feeding one that has not been started does nothing.
            self.running |= key != Self::FEED;
        }
        let (prescaler, reload) = (
            registers.get(iwdg::Register::Pr) & 7,
            registers.get(iwdg::Register::Rlr) & 0xFFF,
        );
        let period_ns = (reload + 1) * (4 << prescaler) * 1_000_000 / 32;
        self.running && at_ns.saturating_sub(self.fed_at_ns) > period_ns
    }
}

/// Restarts the part with these flags.
fn restart(session: &mut Session<NucleoBoard>, stop: Stop, flags: u64, host: &mut dyn Host) {
    session.reset_by_pin(stop.at, stop.instruction_count, host);
    let bus = session.mcu().bus_mut();
    if let Some(slot) = bus.slot_of("RCC") {
        let registers = bus.slot_mut(slot).registers_mut();
        let pin = registers.get(rcc::Register::Rsr);
        registers.set(rcc::Register::Rsr, pin | flags);
    }
}

/// The voltage detector's interrupt (RM0433, table 147).
const DETECTOR_INTERRUPT: Option<InterruptLine> = InterruptLine::new(1);
/// For so long the interrupt is asked for: far longer than the processor takes to begin with it, and shorter
/// than a restart.
const DETECTOR_PULSE_NS: u64 = 20_000;

impl Driver<NucleoBoard> for Probe {
    fn on_stop(
        &mut self,
        session: &mut Session<NucleoBoard>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        let at_ns = stop.at.0;
        if at_ns >= self.next_read_ns {
            self.serve(at_ns, host);
            self.next_read_ns =
                at_ns.saturating_add(self.script.read_every_ns.unwrap_or(MILLISECOND));
        }
        if let Ok(mut taken) = self.taken.lock() {
            while let Some((_, address)) = self
                .script
                .peeks
                .get(taken.peeked.len())
                .filter(|(from_ns, _)| *from_ns <= at_ns)
            {
                taken
                    .peeked
                    .push(host.read(*address, Width::W32).unwrap_or_default());
            }
        }
        while let Some((_, injection)) = self
            .script
            .injections
            .get(self.next_injection)
            .filter(|(from_ns, _)| *from_ns <= at_ns)
        {
            match *injection {
                Injection::Halfword { address, value } => {
                    let _ = host.write(address, Width::W16, u64::from(value));
                }
                Injection::DriveInterfaceOff => {
                    let bus = session.mcu().bus_mut();
                    if let Some(slot) = bus.slot_of("SPI3") {
                        bus.slot_mut(slot)
                            .registers_mut()
                            .set(spi1::Register::Cr1, 0);
                    }
                }
                Injection::SerialErrors { noise, framing } => {
                    session.board_mut().garble_serial(noise, framing)
                }
                Injection::SerialDeaf(deaf) => {
                    let bus = session.mcu().bus_mut();
                    if let Some(slot) = bus.slot_of("USART3") {
                        let registers = bus.slot_mut(slot).registers_mut();
                        // RXNEIE of CR1, EIE of CR3 (RM0433, 48.8.1, 48.8.4).
                        for (register, mask) in
                            [(usart::Register::Cr1, 1 << 5), (usart::Register::Cr3, 1)]
                        {
                            let others = registers.get(register) & !mask;
                            registers.set(register, if deaf { others } else { others | mask });
                        }
                    }
                }
                Injection::Line { line, closed } => {
                    session.board_mut().set_line(line, closed, stop.at)
                }
                Injection::Supply { millivolts } => {
                    if session.board_mut().set_supply(millivolts)
                        && let Some(line) = DETECTOR_INTERRUPT
                    {
                        host.set_interrupt(line, Level::High);
                        self.detector_until_ns = Some(at_ns + DETECTOR_PULSE_NS);
                    }
                }
                Injection::SetPoint { millivolts } => session.board_mut().set_set_point(millivolts),
                Injection::AmplifierTemperature { millivolts } => {
                    session.board_mut().set_amplifier_temperature(millivolts)
                }
                Injection::Temperature { centi_celsius } => {
                    session.board_mut().set_temperature(centi_celsius)
                }
                Injection::SupplyLost => {
                    for address in self.uninitialised.clone().step_by(4) {
                        let _ = host.write(address, Width::W32, ANYTHING);
                    }
                    restart(session, stop, SWITCHED_ON_FLAGS, host);
                }
                Injection::Restart { flags } => restart(session, stop, flags, host),
            }
            self.next_injection += 1;
        }
        if self
            .detector_until_ns
            .is_some_and(|until_ns| at_ns >= until_ns)
            && let Some(line) = DETECTOR_INTERRUPT
        {
            self.detector_until_ns = None;
            host.set_interrupt(line, Level::Low);
        }
        self.watchdog.serve(session, stop, host);
        if let Some(world) = &self.script.monitored
            && let Ok(world) = world.lock()
        {
            let is_enabled = session.board_mut().enables();
            session
                .board_mut()
                .set_monitor(world.monitor_mv(is_enabled));
        }
        let board = session.board_mut();
        let (enables, triggers, lights) = (board.enables(), board.triggers(), board.lights());
        if let Ok(mut taken) = self.taken.lock() {
            note_change(&mut taken.enabled, at_ns, enables);
            note_change(&mut taken.triggered, at_ns, triggers);
            note_change(&mut taken.lights, at_ns, lights);
        }
        while let Some((_, bytes)) = self
            .script
            .serial
            .get(self.next_serial)
            .filter(|(from_ns, _)| *from_ns <= at_ns)
        {
            if let Ok(mut line) = self.line.lock() {
                line.to_part.extend(bytes);
            }
            self.next_serial += 1;
        }
        let is_ended = self
            .script
            .ended
            .as_ref()
            .is_some_and(|ended| ended.load(Ordering::Relaxed));
        if at_ns >= self.script.until_ns || is_ended {
            return None;
        }
        let injection = self
            .script
            .injections
            .get(self.next_injection)
            .map_or(u64::MAX, |(from_ns, _)| *from_ns);
        let serial = self
            .script
            .serial
            .get(self.next_serial)
            .map_or(u64::MAX, |(from_ns, _)| *from_ns);
        let monitored = self
            .script
            .monitored
            .as_ref()
            .and_then(|world| world.lock().ok());
        let look_ns = monitored.map_or(MILLISECOND, |world| world.period_ns);
        let next = self
            .next_read_ns
            .min(at_ns.saturating_add(look_ns))
            .min(self.script.until_ns);
        let next = next
            .min(injection.max(at_ns + 1))
            .min(serial.max(at_ns + 1));
        Some(VirtualNanos(
            next.min(self.detector_until_ns.unwrap_or(u64::MAX)),
        ))
    }
}

/// Where a section of the image is; nowhere without it.
fn section(image: &[u8], name: &str) -> Result<Range<u64>> {
    let file = object::File::parse(image)?;
    Ok(file.section_by_name(name).map_or(0..0, |section| {
        section.address()..section.address() + section.size()
    }))
}

/// The address of a function or a datum of the image.
///
/// # Errors
/// The image cannot be read or has no such symbol.
pub fn address_of(elf: &Path, name: &str) -> Result<u64> {
    let bytes = std::fs::read(elf).with_context(|| format!("{}", elf.display()))?;
    let file = object::File::parse(&*bytes)?;
    let symbol = file
        .symbols()
        .find(|symbol| symbol.name() == Ok(name))
        .ok_or_else(|| anyhow!("{}: no symbol {name}", elf.display()))?;
    Ok(symbol.address() & !1)
}

/// The sampling rate of an image, Hz: the value of the symbol that its build gives it.
///
/// # Errors
/// The image cannot be read or does not say.
pub fn sample_rate_hz(elf: &Path) -> Result<u32> {
    let bytes = std::fs::read(elf).with_context(|| format!("{}", elf.display()))?;
    let file = object::File::parse(&*bytes)?;
    let symbol = file
        .symbols()
        .find(|symbol| symbol.name() == Ok("__sample_rate_hz"));
    let rate_hz = symbol
        .and_then(|symbol| u32::try_from(symbol.address()).ok())
        .filter(|rate_hz| *rate_hz > 0);
    rate_hz.ok_or_else(|| anyhow!("{}: does not say its sampling rate", elf.display()))
}

/// The halfword that the image has at an address.
#[must_use]
pub fn halfword_at(image: &[u8], address: u64) -> Option<u16> {
    let file = object::File::parse(image).ok()?;
    let bytes = file
        .sections()
        .find_map(|section| section.data_range(address, 2).ok().flatten())?;
    Some(u16::from_le_bytes(bytes.try_into().ok()?))
}

/// What is meant so, instance and register. The part ignores two writes of the HAL: PLLCKSELR as a whole for
/// the PLLs that stay off, PLL1 running, and RTCSEL once more than it takes. The emulated part lacks the
/// hardware trigger and the synchronous clock of the on-chip front end's ADC. The maker's description lacks a
/// flag of the last reset, which the part sets.
const MEANT: [(&str, &str); 6] = [
    ("RCC", "RSR"),
    ("RCC", "C1_RSR"),
    ("RCC", "PLLCKSELR"),
    ("RCC", "BDCR"),
    ("ADC1", "CR"),
    ("ADC12_Common", "CCR"),
];
/// Interfaces and the CPOL and CPHA that their converters want (SPI_CFG2, bits 25 and 24): the AD4000
/// family gives its bits behind the falling edge, the AD5791 takes them there.
const CLOCK_MODES: [(&str, u64); 2] = [("SPI1", 0b00), ("SPI3", 0b01)];

/// What the image did to the part that its manual forbids, or that its converters would not understand.
fn misuse(session: &mut Session<NucleoBoard>) -> Vec<String> {
    let mut found: Vec<String> = session
        .told()
        .filter(|told| !MEANT.contains(&(told.instance, told.register)))
        .map(|told| format!("{}.{}: {}", told.instance, told.register, told.reason))
        .collect();
    let bus = session.mcu().bus();
    found.extend(misused_converters(bus));
    // What the part's registers hold behind a reset is the emulated part's to know.
    if let Ok(fresh) = NucleoBoard::new() {
        for (slot, fresh) in bus.slots().iter().zip(fresh.mcu.bus().slots()) {
            found.extend(reserved_bits(slot, fresh));
        }
    }
    found
}

/// Clock modes that the converters do not understand, and an LDAC that disturbs a conversion. The emulated
/// timer moves no pins: TIM2's compare values stand for them, CNV high up to that of channel 1, LDAC low up
/// to that of channel 3.
fn misused_converters(bus: &Bus) -> Vec<String> {
    let enabled = |name| {
        bus.registers(name)
            .filter(|registers| registers.get(spi1::Register::Cr1) & 1 == 1)
    };
    let mut found = Vec::new();
    for (name, mode) in CLOCK_MODES {
        let set = enabled(name).map(|registers| registers.get(spi1::Register::Cfg2) >> 24 & 0b11);
        if let Some(set) = set.filter(|set| *set != mode) {
            found.push(format!(
                "{name}: clock mode {set:02b} instead of {mode:02b}"
            ));
        }
    }
    let timer = bus
        .registers("TIM2")
        .filter(|timer| timer.get(tim2::Register::Cr1) & 1 == 1 && enabled("SPI1").is_some());
    if let Some(timer) = timer {
        let [cnv, ldac, read] = [
            tim2::Register::Ccr1,
            tim2::Register::Ccr3,
            tim2::Register::Ccr4,
        ]
        .map(|register| timer.get(register));
        // The converter converts while CNV is high, and is read behind the interrupt's compare.
        if ldac <= cnv || ldac >= read {
            found.push(format!(
                "LDAC rises at count {ldac}, CNV falls at {cnv}, and the sensor is read from {read} on"
            ));
        }
    }
    found
}

/// A register of an instance by its place in the maker's description.
#[derive(Clone, Copy, Debug)]
struct Row(usize);

impl Layout for Row {
    const REGISTERS: &'static [RegisterSpec] = &[];

    fn from_index(index: usize) -> Option<Self> {
        Some(Self(index))
    }

    fn index(self) -> usize {
        self.0
    }
}

/// Bits of an instance's registers that no field of the maker's description (SVD) has, and that are not as
/// they were behind the reset. Addresses, widths and directions of accesses the emulated part refuses itself.
fn reserved_bits(slot: &Slot, fresh: &Slot) -> Vec<String> {
    let (registers, peripheral) = (slot.registers(), slot.peripheral());
    // Two registers at one address have the fields of both.
    let fields_at = |offset: u32| {
        let rows = peripheral.registers.iter().enumerate();
        rows.filter(|(_, spec)| spec.offset == offset)
            .flat_map(|(row, _)| registers.fields(row))
            .fold(0u64, |bits, field| {
                bits | (u64::MAX >> (64 - u32::from(field.width).clamp(1, 64))) << field.bit
            })
    };
    let changed = |(row, spec): (usize, &RegisterSpec)| {
        let before = fresh.registers().get(Row(row));
        let bits = (registers.get(Row(row)) ^ before) & !fields_at(spec.offset);
        let name = (peripheral.name, spec.name);
        (bits != 0 && !MEANT.contains(&name))
            .then(|| format!("{}.{}: reserved bits {bits:#x} are changed", name.0, name.1))
    };
    peripheral
        .registers
        .iter()
        .enumerate()
        .filter_map(changed)
        .collect()
}

/// A run that can begin.
pub(crate) struct Prepared {
    pub(crate) session: Session<NucleoBoard>,
    pub(crate) images: Vec<Image>,
    pub(crate) control_block: ControlBlock,
}

/// Puts boot stage, image, parameter blocks, safety envelope, kept settings and serial line on a board; the run first
/// stops at `first_stop_ns`.
pub(crate) fn prepare(
    elf: &Path,
    mut board: NucleoBoard,
    blocks: [Option<&[u8]>; 2],
    [envelope, kept]: [Option<&[u8]>; 2],
    line: &SharedLine,
    first_stop_ns: u64,
) -> Result<Prepared> {
    let control_block = ControlBlock::at(address_of(elf, "_SEGGER_RTT")?);
    board.attach_serial(line);
    let boot_stage = elf.with_file_name(BOOT_STAGE);
    let mut images = vec![Image::read(&boot_stage, None)?, Image::read(elf, None)?];
    if let Some(envelope) = envelope {
        images.push(Image::new(
            Path::new("safety envelope"),
            envelope.to_vec(),
            Some(ENVELOPE),
        )?);
    }
    if let Some(kept) = kept {
        images.push(Image::new(
            Path::new("kept settings"),
            kept.to_vec(),
            Some(KEPT_SETTINGS),
        )?);
    }
    for (block, place) in blocks.iter().zip(SETTINGS) {
        if let Some(block) = block {
            images.push(Image::new(
                Path::new("parameter block"),
                block.to_vec(),
                Some(place),
            )?);
        }
    }
    let mut session = Session::new(Box::new(board), 0, VirtualNanos(first_stop_ns))?;
    session.fail_next(BEYOND_FLASH, BEYOND_FLASH + 32);
    Ok(Prepared {
        session,
        images,
        control_block,
    })
}

/// Runs the image on the board.
///
/// # Errors
/// The image cannot be read or placed, has no RTT control block or defmt table, or the emulated part refused
/// something.
pub fn run(elf: &Path, board: NucleoBoard, script: Script) -> Result<Outcome> {
    let bytes = std::fs::read(elf).with_context(|| format!("{}", elf.display()))?;
    let table =
        Table::parse(&bytes)?.ok_or_else(|| anyhow!("{}: no .defmt section", elf.display()))?;

    let line = script.line.clone().unwrap_or_default();
    let first = script
        .read_every_ns
        .unwrap_or(MILLISECOND)
        .min(MILLISECOND)
        .min(script.until_ns);
    let blocks = [script.block.as_deref(), script.second_block.as_deref()];
    let others = [script.envelope.as_deref(), script.kept.as_deref()];
    let Prepared {
        session,
        mut images,
        control_block,
    } = prepare(elf, board, blocks, others, &line, first)?;
    for (address, bytes) in &script.flash {
        images.push(Image::new(
            Path::new("flash"),
            bytes.clone(),
            Some(*address),
        )?);
    }
    let taken = Arc::new(Mutex::new(Taken::default()));
    let watchdog = Watchdog {
        running: script.hardware_watchdog,
        ..Watchdog::default()
    };
    let probe = Probe {
        script,
        control_block,
        next_command: 0,
        next_injection: 0,
        next_serial: 0,
        line: Arc::clone(&line),
        watchdog,
        detector_until_ns: None,
        next_read_ns: first,
        sent_of_command: 0,
        taken: Arc::clone(&taken),
        uninitialised: section(&bytes, ".uninit")?,
    };
    let mut start = Start::new(&images);
    start.semihosting = true;
    let mut finished = emulate(session, &start, probe)?;
    if let Some(error) = finished.session.take_error() {
        return Err(error.into());
    }
    let end = finished
        .stop
        .map_or((0, 0), |stop| (stop.at.0, stop.instruction_count));
    let resets = finished.session.resets().len();
    let without_model = finished
        .session
        .unimplemented()
        .values()
        .map(|seen| format!("{}.{}", seen.instance, seen.register))
        .collect();
    let misused = misuse(&mut finished.session);
    if !misused.is_empty() {
        bail!("the image misuses the part: {}", misused.join("; "));
    }
    let beyond_flash = |address: u64| (BEYOND_FLASH..BEYOND_FLASH + 32).contains(&address);
    let unmapped = finished.session.unmapped();
    let unmapped: Vec<String> = unmapped
        .iter()
        .filter(|access| !beyond_flash(access.address))
        .map(ToString::to_string)
        .collect();
    if !unmapped.is_empty() {
        bail!(
            "the image touched addresses that the part does not have: {}",
            unmapped.join("; ")
        );
    }
    let taken = std::mem::take(&mut *taken.lock().map_err(|_| anyhow!("the probe died"))?);
    let (messages, malformed) = decode(&table, &taken)?;
    let board = std::mem::replace(finished.session.board_mut(), NucleoBoard::new()?);
    let serial = std::mem::take(
        &mut line
            .lock()
            .map_err(|_| anyhow!("the serial line died"))?
            .from_part,
    )
    .into();
    Ok(Outcome {
        board: Box::new(board),
        raw: taken.raw,
        messages,
        malformed,
        serial,
        end,
        enabled: taken.enabled,
        triggered: taken.triggered,
        lights: taken.lights,
        peeked: taken.peeked,
        resets,
        without_model,
    })
}

fn decode(table: &Table, taken: &Taken) -> Result<(Vec<Message>, u32)> {
    let mut decoder = table.new_stream_decoder();
    let (mut messages, mut malformed, mut from) = (Vec::new(), 0, 0);
    for &(until, at_ns) in &taken.visits {
        decoder.received(taken.raw.get(from..until).unwrap_or(&[]));
        from = until;
        loop {
            match decoder.decode() {
                Ok(frame) => messages.push(Message {
                    at_ns,
                    level: frame
                        .level()
                        .map_or(String::new(), |level| level.as_str().to_string()),
                    text: frame.display_message().to_string(),
                }),
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) if table.encoding().can_recover() => malformed += 1,
                Err(DecodeError::Malformed) => {
                    bail!("a log frame is malformed and the encoding cannot recover")
                }
            }
        }
    }
    Ok((messages, malformed))
}
