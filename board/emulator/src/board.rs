//! The board around the part: a NUCLEO-H743ZI2 as far as the firmware can see it.

use std::num::{NonZeroU32, NonZeroU64};

use rigless::cpu::armv7m::windows;
use rigless::device::Level;
use rigless::machine::{Board, Crystal, Supply, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Error;
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::{exti, gpioa as gpio, pwr};
use rigless::soc::stm32h743::peripherals::adc::Channel;
use rigless::soc::stm32h743::peripherals::gpio::Pin;
use rigless::soc::stm32h743::peripherals::spi::Select;
use rigless::time::VirtualNanos;

use crate::converters::{DriveConverter, SensorConverter, SharedWorld};
use crate::serial_line::{SerialPeer, SharedLine};

/// Name of the part on the board.
pub const PART: &str = "stm32h743";

/// Instructions that the emulated core retires in a second of virtual time. A Cortex-M7 at 400 MHz retires
/// between half and two of them in a cycle; this is a slow one.
pub const INSTRUCTIONS_PER_SECOND: u64 = 250_000_000;

/// The board.
#[derive(Debug)]
pub struct NucleoBoard {
    /// The part.
    pub mcu: Stm32h743,
    /// Instructions that the core retires in a second of virtual time.
    pub instructions_per_second: u64,
}

/// Position of port E among the part's ports, and the pin of the enable output on it.
const PORT_E: usize = 4;
const ENABLE_PIN: u32 = 14;
/// That of the trigger output.
const TRIGGER_PIN: u32 = 15;

/// The lights LD1 to LD3, by port and pin.
const LIGHTS: [(&str, u32); 3] = [("GPIOB", 0), ("GPIOE", 1), ("GPIOB", 14)];

/// A line to the board that is fine while a contact closes it to ground, by its pin on port E.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum SafetyLine {
    /// Emergency stop.
    EmergencyStop = 0,
    /// Interlock.
    Interlock = 12,
    /// The amplifier is ready.
    AmplifierReady = 10,
}

impl SafetyLine {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::EmergencyStop, Self::Interlock, Self::AmplifierReady];
}

/// With this many every instruction is one count of the part's cycle counter, so that the counter counts
/// instructions.
pub const ONE_INSTRUCTION_PER_CYCLE: u64 = 400_000_000;

/// Position of USART3, the debugger's virtual COM port, among the part's serial ports.
const SERIAL_PORT: usize = 2;
/// Position of SPI1 and SPI3 among the part's interfaces.
const SENSOR_INTERFACE: usize = 0;
const DRIVE_INTERFACE: usize = 2;

rigless::store!(NucleoBoard {
    values: [],
    parts: [mcu],
    built: [instructions_per_second]
});

impl NucleoBoard {
    /// The board out of its box: 8 MHz on the crystal pins and 3.3 V.
    ///
    /// # Errors
    /// The part's description is inconsistent.
    pub fn new() -> Result<Self, Error> {
        let mut mcu = Stm32h743::new()?;
        mcu.rcc
            .attach_crystals(Crystal(8_000_000).0, Crystal::NONE.0);
        mcu.set_supply(Supply(3300).0);
        mcu.set_analog_supply(Supply(3300).0);
        let mut this = Self {
            mcu,
            instructions_per_second: INSTRUCTIONS_PER_SECOND,
        };
        for line in SafetyLine::ALL {
            this.set_line(line, true, VirtualNanos(0));
        }
        Ok(this)
    }

    /// Closes a contact to ground on a line, or opens it.
    pub fn set_line(&mut self, line: SafetyLine, closed: bool, at: VirtualNanos) {
        let Some(pin) = Pin::new(line as u8) else {
            return;
        };
        let level = closed.then_some(Level::Low);
        self.mcu.drive_port(at, PORT_E, |port, registers, context| {
            port.drive(pin, level, registers, context)
        });
    }

    /// Changes the part's supply, mV. Whether the voltage detector asks for its interrupt by that: its output
    /// rises, and the image has chosen a rising edge of its line of the EXTI, 16, and not masked it. The
    /// emulated detector is not connected to the EXTI.
    pub fn set_supply(&mut self, millivolts: u32) -> bool {
        let before = self.detector_says_low();
        self.mcu.set_supply(millivolts);
        let line = |register| {
            self.mcu
                .bus()
                .registers("EXTI")
                .is_some_and(|registers| registers.get(register) >> 16 & 1 == 1)
        };
        self.detector_says_low()
            && !before
            && line(exti::Register::Rtsr1)
            && line(exti::Register::Cpuimr1)
    }

    /// PWR_CSR1.PVDO (RM0433, 6.8.2).
    fn detector_says_low(&self) -> bool {
        self.mcu
            .bus()
            .registers("PWR")
            .is_some_and(|registers| registers.get(pwr::Register::Csr1) >> 4 & 1 == 1)
    }

    /// Sets the input that the amplifier's voltage monitor is on: PC0, channel 10 of ADC3, mV.
    pub fn set_monitor(&mut self, millivolts: u32) {
        self.set_input(2, 10, millivolts);
    }

    /// Sets the input that the analogue set point is on: PB1, channel 5 of ADC2, mV.
    pub fn set_set_point(&mut self, millivolts: u32) {
        self.set_input(1, 5, millivolts);
    }

    /// Sets the input that the amplifier's temperature is on: PF10, channel 6 of ADC3, mV.
    pub fn set_amplifier_temperature(&mut self, millivolts: u32) {
        self.set_input(2, 6, millivolts);
    }

    fn set_input(&mut self, converter: usize, channel: u8, millivolts: u32) {
        if let (Some(converter), Some(channel)) =
            (self.mcu.adc.get_mut(converter), Channel::new(channel))
        {
            converter.set_input(channel, millivolts);
        }
    }

    /// Changes the part's temperature, hundredths of a degree Celsius.
    pub fn set_temperature(&mut self, centi_celsius: i32) {
        for converter in &mut self.mcu.adc {
            converter.set_temperature(centi_celsius);
        }
    }

    /// Whether the board lets the amplifier's power stage work; a pin that floats does not, there is a
    /// resistor to ground on it.
    pub fn enables(&mut self) -> bool {
        self.is_high("GPIOE", ENABLE_PIN)
    }

    /// Whether the trigger output is high.
    pub fn triggers(&mut self) -> bool {
        self.is_high("GPIOE", TRIGGER_PIN)
    }

    /// Which of the lights LD1 (green), LD2 (yellow) and LD3 (red) are on.
    pub fn lights(&mut self) -> [bool; 3] {
        LIGHTS.map(|(port, pin)| self.is_high(port, pin))
    }

    /// Whether a pin of a port is an output that is high.
    fn is_high(&mut self, port: &str, pin: u32) -> bool {
        let bus = self.mcu.bus_mut();
        let Some(slot) = bus.slot_of(port) else {
            return false;
        };
        let registers = bus.slot_mut(slot).registers_mut();
        let (mode, output) = (
            registers.get(gpio::Register::Moder),
            registers.get(gpio::Register::Odr),
        );
        mode >> (2 * pin) & 3 == 1 && output >> pin & 1 == 1
    }

    /// Hangs a line on the serial port.
    pub fn attach_serial(&mut self, line: &SharedLine) {
        if let Some(port) = self.mcu.usart.get_mut(SERIAL_PORT) {
            port.attach(SerialPeer::new(line));
        }
    }

    /// From now on so many of a million bytes to the serial port arrive with noise, and with a framing error.
    pub fn garble_serial(&mut self, noise: u32, framing: u32) {
        if let Some(port) = self.mcu.usart.get_mut(SERIAL_PORT) {
            let errors = port.errors_mut();
            (errors.noise.per_million, errors.framing.per_million) = (noise, framing);
        }
    }

    /// The board with converters on its SPI connectors and a plant behind them.
    ///
    /// # Errors
    /// The part's description is inconsistent.
    pub fn with_plant(world: &SharedWorld) -> Result<Self, Error> {
        let mut board = Self::new()?;
        if let Some(interface) = board.mcu.spi.get_mut(SENSOR_INTERFACE) {
            interface.attach(SensorConverter::new(world));
        }
        if let (Some(interface), Some(pin)) = (board.mcu.spi.get_mut(DRIVE_INTERFACE), Pin::new(9))
        {
            interface.attach_selected(
                DriveConverter::new(world),
                Select {
                    port: "GPIOC",
                    pin,
                    active: Level::Low,
                },
            );
        }
        Ok(board)
    }
}

/// The Cortex-M7 r1p1 of the part: double-precision FPU, 16 MPU regions, 4 priority bits, 16 KiB caches.
fn core(mcu: &Stm32h743, instructions_per_second: u64) -> armv7m::Config {
    let core = armv7m::Core {
        variant: armv7m::Variant::M7,
        clock_hz: NonZeroU64::new(400_000_000).unwrap_or(NonZeroU64::MIN),
        interrupt_lines: NonZeroU32::new(u32::from(mcu.cpu().interrupt_lines))
            .unwrap_or(NonZeroU32::MIN),
        priority_bits: 4,
        refclk_divider: NonZeroU32::new(8).unwrap_or(NonZeroU32::MIN),
        instructions_per_second: NonZeroU64::new(instructions_per_second)
            .unwrap_or(NonZeroU64::MIN),
        boot: "flash",
    };
    let mut config = armv7m::Config::new(core, &windows(mcu.bus()));
    config.fpu = armv7m::Fpu::FpV5Dp;
    config.mpu_regions = armv7m::MpuRegions::Sixteen;
    config.cpuid = 0x411F_C271;
    config.caches = Some(armv7m::Caches {
        clidr: 0x0900_0003,
        ctr: 0x8303_C003,
        ccsidr: &[0xF00F_E019, 0xF01F_E009],
    });
    config.branch_prediction = armv7m::BranchPrediction::Always;
    config.vector_table = Some(0x0800_0000);
    config
}

impl Board for NucleoBoard {
    fn name(&self) -> &'static str {
        "nucleo-h743zi2"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec![PART]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.mcu)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let core = core(&self.mcu, self.instructions_per_second).spec();
        vec![Target::new(PART, &mut self.mcu, core)]
    }
}
