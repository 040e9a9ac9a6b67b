//! Precision converters on SPI: a SAR converter of 16, 18 or 20 bits of the AD4000 family (3-wire, CNV) and a
//! 20-bit DAC of the AD5791 family.
//!
//! | signal | pin | timing |
//! |---|---|---|
//! | sensor SCK, SDO | PA5, PA6 (SPI1, frames of the block's bits, 32 MHz) | read by the control interrupt |
//! | sensor CNV | PA0 (TIM2_CH1) | rises at the edge: the sample is taken there; low before the read |
//! | drive SCK, SDIN, SYNC | PC10, PC12, PC9 (SPI3, 24-bit frames, 32 MHz) | the interrupt writes it |
//! | drive SDO | PC11 (SPI3) | where the envelope has it wired; frames at 16 MHz (AD5791, table 3) |
//! | drive LDAC | PB10 (TIM2_CH3) | falls at the edge: the code written before acts there |
//!
//! The DAC leaves power-up, and its RESET pin (wired to NRST), with its output clamped to ground and an empty
//! register, which is the negative reference. [`FrontEnd::start`] therefore holds LDAC low by hand, so that
//! the rest code reaches the register when its frame ends, and removes the clamp only then; without a rest
//! code the clamp stays. The sample clock gets LDAC afterwards. SYNC stays high for [`SYNC_HIGH_CYCLES`]
//! between frames.
//!
//! # Read back
//! A frame that asks for the register goes out while the sensor's word and what the tick needs besides come
//! in; the next frame, which writes the new code, brings the register's content. It must be the code that was
//! written before. The tick stands between the two frames, so SYNC is high for long enough.

use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr};
use embassy_stm32::pac::spi::Spi;
use embassy_stm32::pac::spi::vals::{Comm, Cpha, Cpol, Fthlv, Master, Mbr};
use embassy_stm32::pac::{GPIOA, GPIOB, GPIOC, RCC, SPI1, SPI3};

use hysteron_core::codes::{DriveCode, SensorCode};

use super::analogue_inputs::MonitorAndTemperatures;
use super::set_point_input;
use crate::front_end::{CodeBits, FrontEnd, Wiring};

/// Polls of a flag before a converter counts as silent: about ten frames.
const MOST_POLLS: u32 = 400;
/// AD5791: write to the DAC register.
const WRITE_DAC: u32 = 0x1 << 20;
/// AD5791: the next frame brings the DAC register.
const READ_DAC: u32 = 0x9 << 20;
/// The code in a frame.
const CODE_MASK: u32 = 0xF_FFFF;
/// AD5791: write to the control register, offset binary, output on, clamp off, amplifier of the reference
/// off.
const WRITE_CONTROL: u32 = (0x2 << 20) | (1 << 4) | (1 << 1);
/// LINCOMP in that register: the linearity is trimmed for the span of the references, up to each of these, mV
/// (AD5791, table 13).
const LINEARITY: [(u32, u32); 5] = [
    (10_000, 0b0000),
    (12_000, 0b1001),
    (16_000, 0b1010),
    (19_000, 0b1011),
    (20_000, 0b1100),
];
const LINEARITY_SHIFT: u32 = 6;
/// Core cycles between frames, at least 100 ns: the DAC asks for 48 ns of SYNC high, and for 65 ns to LDAC.
const SYNC_HIGH_CYCLES: u32 = 40;
/// Late words of the sensor that are dropped before it is asked again: as many as its FIFO holds.
const MOST_LATE_WORDS: u32 = 8;
/// LDAC is PB10.
const LDAC_LOW: u32 = 1 << 26;
/// SYNC is PC9.
const SYNC_HIGH: u32 = 1 << 9;
const SYNC_LOW: u32 = 1 << 25;

/// The SPI front end.
pub struct SpiConverters {
    /// Bits of the sensor's code: a frame.
    adc_bits: u8,
    /// From a drive's code to the register of the AD5791, which has 20 bits.
    shift: u8,
    /// What the sign of two's complement is turned with; 0 for straight binary.
    sign: u32,
    /// What the control register is set to.
    control: u32,
    /// The drive's SDO is wired.
    reads_back: bool,
    /// A frame that asks for the register has begun, or was the last one.
    asked: bool,
    /// What the register was given last.
    written: Option<u32>,
    /// The register held it.
    holds: bool,
    inputs: MonitorAndTemperatures,
    has_set_point: bool,
}

/// The control register for references that are so far apart.
fn control_word(reference_span_mv: u32) -> u32 {
    let trimmed = LINEARITY
        .iter()
        .find(|(most, _)| reference_span_mv <= *most)
        .map_or(0, |(_, bits)| *bits);
    WRITE_CONTROL | trimmed << LINEARITY_SHIFT
}

fn alternate(port: Gpio, pin: usize, function: u8) {
    port.afr(pin / 8).modify(|w| w.set_afr(pin % 8, function));
    port.ospeedr()
        .modify(|w| w.set_ospeedr(pin, Ospeedr::VERY_HIGH_SPEED));
    port.moder().modify(|w| w.set_moder(pin, Moder::ALTERNATE));
}

fn start_interface(spi: Spi, frame_bits: u8, duplex: Comm, phase: Cpha, divider: Mbr) {
    spi.cr1().write(|w| w.set_ssi(true));
    spi.cfg1().write(|w| {
        w.set_dsize(frame_bits - 1);
        w.set_fthlv(Fthlv::ONE_FRAME);
        w.set_mbr(divider);
        w.set_crcsize(7);
    });
    spi.cfg2().write(|w| {
        w.set_master(Master::MASTER);
        w.set_ssm(true);
        w.set_comm(duplex);
        w.set_cpha(phase);
        w.set_cpol(Cpol::IDLE_LOW);
        w.set_afcntr(true);
    });
    spi.cr2().write(|w| w.set_tsize(0));
    spi.cr1().modify(|w| w.set_spe(true));
    spi.cr1().modify(|w| w.set_cstart(true));
}

/// Reads each enable back: a clock runs two cycles after its bit is set, and what is written before is lost
/// (RM0433, 8.5.11).
fn enable_clocks() {
    RCC.apb2enr().modify(|w| w.set_spi1en(true));
    RCC.apb1lenr().modify(|w| w.set_spi3en(true));
    RCC.ahb4enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_gpiocen(true);
    });
    let _ = (
        RCC.apb2enr().read(),
        RCC.apb1lenr().read(),
        RCC.ahb4enr().read(),
    );
    cortex_m::asm::dsb();
}

/// SYNC high and LDAC low, both by hand: a frame that was cut is dropped, and a frame acts when it ends.
fn hold_lines() {
    GPIOC.bsrr().write(|w| w.0 = SYNC_HIGH);
    GPIOC.moder().modify(|w| w.set_moder(9, Moder::OUTPUT));
    GPIOB.bsrr().write(|w| w.0 = LDAC_LOW);
    GPIOB.moder().modify(|w| w.set_moder(10, Moder::OUTPUT));
    cortex_m::asm::delay(SYNC_HIGH_CYCLES);
}

/// The drive's interface as after a reset, whatever it was doing.
fn begin_drive_interface(reads_back: bool) {
    RCC.apb1lrstr().modify(|w| w.set_spi3rst(true));
    RCC.apb1lrstr().modify(|w| w.set_spi3rst(false));
    let _ = RCC.apb1lrstr().read();
    for pin in [10, 12] {
        alternate(GPIOC, pin, 6);
    }
    if reads_back {
        alternate(GPIOC, 11, 6);
        start_interface(SPI3, 24, Comm::FULL_DUPLEX, Cpha::SECOND_EDGE, Mbr::DIV4);
    } else {
        start_interface(SPI3, 24, Comm::TRANSMITTER, Cpha::SECOND_EDGE, Mbr::DIV2);
    }
}

/// One frame to the DAC, framed by SYNC; whether it has gone.
#[inline(always)]
fn send_to_dac(word: u32) -> bool {
    begin_frame(word);
    end_frame()
}

#[inline(always)]
fn begin_frame(word: u32) {
    GPIOC.bsrr().write(|w| w.0 = SYNC_LOW);
    SPI3.txdr32().write_value(word);
}

#[inline(always)]
fn end_frame() -> bool {
    let mut polls = 0;
    while !SPI3.sr().read().txc() {
        polls += 1;
        if polls == MOST_POLLS {
            break;
        }
    }
    GPIOC.bsrr().write(|w| w.0 = SYNC_HIGH);
    // An interface that is off says at once that all is sent (RM0433, 50.11.6).
    polls < MOST_POLLS && SPI3.cr1().read().spe()
}

impl SpiConverters {
    /// Sends a frame; what comes with it is the register, if the frame before asked for that.
    #[inline(always)]
    fn send(&mut self, word: u32) -> bool {
        let sent = send_to_dac(word);
        if self.reads_back {
            let register = SPI3.rxdr32().read() & CODE_MASK;
            if self.asked {
                self.asked = false;
                self.holds = self.written.is_none_or(|written| written == register);
            }
        }
        sent
    }

    /// The sensor's code.
    #[inline(always)]
    fn sensor(&mut self) -> Option<SensorCode> {
        // A word that came too late for its tick is not this tick's, and would make every later reading a
        // period old.
        let mut late = 0;
        while late < MOST_LATE_WORDS && SPI1.sr().read().rxp() {
            let _ = self.take_word();
            late += 1;
        }
        if self.adc_bits > 16 {
            SPI1.txdr32().write_value(0);
        } else {
            SPI1.txdr16().write_value(0);
        }
        let mut polls = 0;
        while !SPI1.sr().read().rxp() {
            polls += 1;
            if polls == MOST_POLLS {
                return None;
            }
        }
        // A line that floats or is shorted reads all ones or zeros; the guard's limits name that.
        Some(SensorCode::new(self.take_word() ^ self.sign))
    }

    /// The word that has come; the interface gives a longer one by its whole register only.
    #[inline(always)]
    fn take_word(&self) -> u32 {
        if self.adc_bits > 16 {
            SPI1.rxdr32().read()
        } else {
            SPI1.rxdr16().read().into()
        }
    }
}

impl FrontEnd for SpiConverters {
    const NAME: &'static str = "SPI, AD4000 and AD5791 families";
    const BITS: CodeBits = CodeBits { adc: 16, dac: 20 };
    const INTERRUPT_AFTER_NS: u32 = 1_000;
    const READS_BACK: bool = true;
    const HAS_MONITOR: bool = true;
    const HAS_SET_POINT: bool = true;

    fn has(bits: CodeBits) -> bool {
        matches!(bits.adc, 16 | 18 | 20) && bits.dac <= Self::BITS.dac
    }

    fn new(bits: CodeBits, wiring: Wiring) -> Self {
        Self {
            adc_bits: bits.adc,
            shift: Self::BITS.dac.saturating_sub(bits.dac),
            sign: if wiring.sensor_is_signed {
                1 << (bits.adc - 1)
            } else {
                0
            },
            control: control_word(wiring.reference_span_mv),
            reads_back: wiring.drive_reads_back,
            asked: false,
            written: None,
            holds: true,
            inputs: MonitorAndTemperatures::new(wiring),
            has_set_point: wiring.has_set_point,
        }
    }

    fn start(&mut self, rest_code: Option<DriveCode>) {
        self.inputs.start();
        if self.has_set_point {
            set_point_input::start_input();
        }
        enable_clocks();
        hold_lines();
        begin_drive_interface(self.reads_back);
        if let Some(rest_code) = rest_code {
            self.write(rest_code);
            cortex_m::asm::delay(SYNC_HIGH_CYCLES);
            self.send(self.control);
            cortex_m::asm::delay(SYNC_HIGH_CYCLES);
        }
        alternate(GPIOB, 10, 1);
        alternate(GPIOA, 0, 1);
        for pin in [5, 6] {
            alternate(GPIOA, pin, 5);
        }
        start_interface(
            SPI1,
            self.adc_bits,
            Comm::FULL_DUPLEX,
            Cpha::FIRST_EDGE,
            Mbr::DIV2,
        );
    }

    #[inline(always)]
    fn read(&mut self) -> Option<SensorCode> {
        self.asked = self.reads_back && self.written.is_some();
        if self.asked {
            begin_frame(READ_DAC);
        }
        self.sensor()
    }

    #[inline(always)]
    fn end_read(&mut self) {
        if self.asked {
            self.asked = end_frame();
            let _ = SPI3.rxdr32().read();
        }
    }

    #[inline(always)]
    fn write(&mut self, code: DriveCode) -> bool {
        let register = code.steps() << self.shift;
        let sent = self.send(WRITE_DAC | register);
        self.written = Some(register);
        sent
    }

    #[inline(always)]
    fn renew(&mut self) -> bool {
        self.send(self.control)
    }

    #[inline(always)]
    fn monitor(&mut self) -> Option<u16> {
        self.inputs.read()
    }

    #[inline(always)]
    fn set_point(&mut self) -> Option<u16> {
        set_point_input::read()
    }

    #[inline(always)]
    fn holds(&self) -> bool {
        self.holds
    }

    fn force(&mut self, code: DriveCode) {
        enable_clocks();
        hold_lines();
        begin_drive_interface(false);
        self.reads_back = false;
        self.write(code);
        cortex_m::asm::delay(SYNC_HIGH_CYCLES);
    }
}
