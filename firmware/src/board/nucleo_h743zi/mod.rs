//! NUCLEO-H743ZI2: STM32H743ZI at 400 MHz, precision converters on SPI or the part's own.
//!
//! Crystal: the 8 MHz that the NUCLEO's debugger feeds to OSC_IN. PLL1 makes 400 MHz for the core (voltage
//! scale 1), 200 MHz for the buses' timers, and 100 MHz that nobody needs; SPI1 to SPI3 and the voltage
//! monitor have the internal 64 MHz. Memory: `memory.x` of the repository's root.

mod analogue_inputs;
pub mod flash;
#[cfg(feature = "on-chip-converters")]
mod on_chip_converters;
mod option_bytes;
#[cfg(not(feature = "on-chip-converters"))]
mod set_point_input;
#[cfg(not(feature = "on-chip-converters"))]
mod spi_converters;

use cortex_m::peripheral::SCB;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::iwdg::Iwdg;
use embassy_stm32::pac::usart::Lpuart;
use embassy_stm32::pac::{EXTI, FLASH, GPIOB, GPIOE, IWDG1, PWR, RCC, USART3 as USART3_REGISTERS};
use embassy_stm32::rcc::mux::{Adcsel, Saisel};
use embassy_stm32::rcc::{
    AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk,
    VoltageScale,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{Config as SerialConfig, ConfigError, Uart};
use embassy_stm32::{Config, Peripherals, interrupt};
use hysteron_core::guard::Fault;
use hysteron_firmware_shared::flash_read::FlashInterface;

use crate::board::light::Light;
use crate::board::platform::{Lines, Platform, ResetCause, SAMPLE_RATE_HZ};

/// PLS: 2.76 V falling, 2.86 V rising (DS12110, table 116), the highest of the detector's own levels.
const LEVEL_2V76: u8 = 6;
/// The detector's line of the EXTI (RM0433, table 150).
const DETECTOR_LINE: usize = 16;

/// What the temperature's sensor gives at 30 and 110 degrees Celsius, where the maker has written it
/// (DS12110, table 181), and the typical 0.62 V and 2 mV a degree (table 180).
const TEMPERATURE_WORDS: [u32; 2] = [0x1FF1_E820, 0x1FF1_E840];
const TYPICAL_WORDS: [u16; 2] = [12_313, 15_490];

/// A light that shines all the time.
const ON: u8 = 0xFF;

/// The board.
pub struct NucleoH743zi;

impl FlashInterface for NucleoH743zi {
    fn begin_reading(address: u32) -> bool {
        FLASH.bank(1).ccr().write(|w| w.set_clr_dbeccerr(true));
        let status = FLASH.bank(1).sr().read();
        address < Self::DATA_BANK.0 || !(status.qw() || status.bsy())
    }

    /// The read itself ends in a bus error too (RM0433, 4.7.7).
    fn end_reading() -> bool {
        let damaged = FLASH.bank(1).sr().read().dbeccerr();
        if damaged {
            FLASH.bank(1).ccr().write(|w| w.set_clr_dbeccerr(true));
        }
        damaged
    }
}

impl Platform for NucleoH743zi {
    const LOG_BYTES: usize = 32_768;
    /// 0.8 s at 20 kHz.
    const RECORDED_SAMPLES: u32 = 1 << 14;
    const WAVE_POINTS: usize = 4096;
    const SWAPS: bool = SAMPLE_RATE_HZ <= 50_000;
    const SWAPS_HYSTERESIS: bool = SAMPLE_RATE_HZ <= 20_000;
    #[cfg(feature = "on-chip-converters")]
    type Converters = on_chip_converters::OnChipConverters;
    #[cfg(not(feature = "on-chip-converters"))]
    type Converters = spi_converters::SpiConverters;
    const LINES: Lines = Lines {
        port: GPIOE,
        emergency_stop: 0,
        interlock: 12,
        amplifier_ready: 10,
        enable: 14,
        trigger: 15,
    };
    /// LD1, green: nothing can move, or the loop is closed. LD2, yellow: the power stage is on. LD3, red: a
    /// fault.
    const LIGHTS: &'static [Light] = &[
        Light {
            port: GPIOB,
            pin: 0,
            safe: ON,
            armed: 0,
            closed: ON,
            fault: 0,
        },
        Light {
            port: GPIOE,
            pin: 1,
            safe: 0,
            armed: ON,
            closed: ON,
            fault: 0,
        },
        Light {
            port: GPIOB,
            pin: 14,
            safe: 0,
            armed: 0,
            closed: 0,
            fault: ON,
        },
    ];
    const WATCHDOG: Iwdg = IWDG1;
    const SERIAL_INTERRUPT: Interrupt = Interrupt::USART3;
    /// SETTINGS of `memory.x`.
    const BLOCKS: [(&'static str, u32); 2] = [("A", 0x081C_0000), ("B", 0x081E_0000)];
    const DATA_BANK: (u32, u32) = (0x0810_0000, 1024 * 1024);
    const KEPT_SETTINGS: u32 = 0x0816_0000;
    const ENVELOPE: u32 = 0x0818_0000;
    const SECTOR_BYTES: u32 = 128 * 1024;
    /// The last one of an incoming image, which the boot stage takes only with its checksum.
    const SPARE_SECTOR: u32 = 0x0814_0000;
    const BEYOND_FLASH: u32 = 0x0820_0000;
    const BROWN_OUT_LEVEL: &'static str = "2.4 V";

    fn crystal_runs() -> bool {
        RCC.cr().modify(|w| {
            w.set_hsebyp(true);
            w.set_hseon(true);
        });
        RCC.cr().read().hserdy()
    }

    /// Of instructions: tasks run from flash. What the control interrupt runs and reads is in memories that
    /// no cache serves.
    fn use_caches(control: &mut SCB) {
        control.enable_icache();
    }

    fn clock_tree() -> Config {
        let mut config = Config::default();
        let c = &mut config.rcc;
        c.hse = Some(Hse {
            freq: Hertz(8_000_000),
            mode: HseMode::Bypass,
        });
        c.pll1 = Some(Pll {
            source: PllSource::HSE,
            prediv: PllPreDiv::DIV1,
            mul: PllMul::MUL100,
            divp: Some(PllDiv::DIV2),
            divq: Some(PllDiv::DIV8),
            divr: None,
            fracn: None,
        });
        c.sys = Sysclk::PLL1_P;
        c.d1c_pre = AHBPrescaler::DIV1;
        c.ahb_pre = AHBPrescaler::DIV2;
        c.apb1_pre = APBPrescaler::DIV2;
        c.apb2_pre = APBPrescaler::DIV2;
        c.apb3_pre = APBPrescaler::DIV2;
        c.apb4_pre = APBPrescaler::DIV2;
        c.voltage_scale = VoltageScale::Scale1;
        // The converters' clock is the internal oscillator, 64 MHz, from here on: a mux does not leave a
        // clock that has died (RM0433, 8.5.8), and a lost crystal takes the PLL with it. When a sample is
        // taken and a code acts is the timer's business.
        c.mux.spi123sel = Saisel::PER;
        c.mux.adcsel = Adcsel::PER;
        // The cycle counter counts while the core sleeps only with this bit (RM0433, 60.5.8).
        config.enable_debug_during_sleep = true;
        config
    }

    fn watch_crystal() {
        RCC.cr().modify(|w| w.set_hsecsson(true));
    }

    /// The crystal has stopped: the core runs from the internal oscillator, and nothing keeps its time any more.
    fn cause_of_nmi() -> Option<Fault> {
        Some(Fault::ClockLost)
    }

    fn clock_sample_timer() {
        RCC.apb1lenr().modify(|w| w.set_tim2en(true));
    }

    fn clock_lines() {
        RCC.ahb4enr().modify(|w| w.set_gpioeen(true));
        let _ = RCC.ahb4enr().read();
        cortex_m::asm::dsb();
    }

    fn clock_lights() {
        RCC.ahb4enr().modify(|w| {
            w.set_gpioben(true);
            w.set_gpioeen(true);
        });
        let _ = RCC.ahb4enr().read();
        cortex_m::asm::dsb();
    }

    fn reset_cause() -> ResetCause {
        let flags = RCC.rsr().read();
        RCC.rsr().modify(|w| w.set_rmvf(true));
        ResetCause {
            watchdog: flags.iwdg1rstf(),
            software: flags.sftrstf(),
            brown_out: flags.borrstf() && !flags.porrstf(),
        }
    }

    fn part_decicelsius(code: u16) -> Option<i32> {
        // SAFETY: words of the system memory, which nothing writes.
        let words = TEMPERATURE_WORDS.map(|at| unsafe { (at as *const u16).read_volatile() });
        let [cold, hot] = if words[0] < words[1] {
            words
        } else {
            TYPICAL_WORDS
        };
        let (code, cold, hot) = (i32::from(code), i32::from(cold), i32::from(hot));
        Some(300 + (code - cold) * 800 / (hot - cold).max(1))
    }

    /// USART3 on PD8 (transmit) and PD9 (receive).
    fn serial_port(
        peripherals: Peripherals,
        config: SerialConfig,
    ) -> Result<Uart<'static, Blocking>, ConfigError> {
        Uart::new_blocking(peripherals.USART3, peripherals.PD9, peripherals.PD8, config)
    }

    fn serial_registers() -> Lpuart {
        // SAFETY: the layout of all serial ports of the part is the same as far as it is used here.
        unsafe { Lpuart::from_ptr(USART3_REGISTERS.as_ptr()) }
    }

    async fn write_sector(address: u32, bytes: &[u8]) -> Result<(), &'static str> {
        flash::write_sector(address, bytes).await
    }

    async fn write_mark(address: u32) -> Result<(), &'static str> {
        flash::write_mark(address).await
    }

    fn protection() -> u32 {
        option_bytes::protection()
    }

    async fn write_protection() -> Result<(), &'static str> {
        option_bytes::protect().await
    }

    fn start_supply_detector() {
        PWR.cr1().modify(|w| {
            w.set_pls(LEVEL_2V76);
            w.set_pvde(true);
        });
    }

    fn supply_is_low() -> bool {
        PWR.csr1().read().pvdo()
    }

    fn watch_supply() {
        EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
        EXTI.pr(0).write(|w| w.set_line(DETECTOR_LINE, true));
        EXTI.imr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
        interrupt::PVD_AVD.set_priority(Priority::P0);
        // SAFETY: the image's handler shares nothing with what it interrupts, and never returns to it.
        unsafe { interrupt::PVD_AVD.enable() };
    }
}
