//! NUCLEO-G474RE: STM32G474RE at 170 MHz with its own converters. Built and checked as a binary; it is not
//! emulated.
//!
//! Crystal: the 24 MHz of the board (X3). The PLL makes 170 MHz for the core (range 1, boosted), the buses
//! and the timers. Memory: `memory.x` beside this file.

mod flash;
mod on_chip_converters;
mod option_bytes;

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::peripheral::SCB;
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::iwdg::Iwdg;
use embassy_stm32::pac::usart::Lpuart;
use embassy_stm32::pac::{EXTI, FLASH, GPIOA, GPIOC, IWDG, LPUART1 as LPUART1_REGISTERS, PWR, RCC};
use embassy_stm32::rcc::{Hse, HseMode, Pll, PllMul, PllPreDiv, PllRDiv, PllSource, Sysclk};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{Config as SerialConfig, ConfigError, Uart};
use embassy_stm32::{Config, Peripherals, interrupt};
use hysteron_core::guard::Fault;
use hysteron_firmware_shared::flash_read::FlashInterface;

use crate::board::light::Light;
use crate::board::platform::{Lines, Platform, ResetCause};

/// PVDLS: 2.81 V falling, 2.91 V rising, typical (DS12288, embedded reset and power control block
/// characteristics).
const LEVEL_2V81: u8 = 5;
/// The detector's line of the EXTI (RM0440, EXTI lines connections).
const DETECTOR_LINE: usize = 16;

/// Flash is being read that may be damaged, and what the NMI met meanwhile.
static READING: AtomicBool = AtomicBool::new(false);
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// The board.
pub struct NucleoG474re;

impl FlashInterface for NucleoG474re {
    fn begin_reading(_: u32) -> bool {
        let idle = !FLASH.sr().read().bsy();
        DAMAGED.store(false, Ordering::Relaxed);
        READING.store(idle, Ordering::Release);
        idle
    }

    /// The NMI comes before the barrier behind the reading has ended.
    fn end_reading() -> bool {
        READING.store(false, Ordering::Release);
        DAMAGED.load(Ordering::Acquire) || has_ecc_error()
    }
}

impl Platform for NucleoG474re {
    const LOG_BYTES: usize = 4_096;
    /// 25.6 ms.
    const RECORDED_SAMPLES: u32 = 1 << 9;
    const WAVE_POINTS: usize = 512;
    const SWAPS: bool = true;
    const SWAPS_HYSTERESIS: bool = false;
    type Converters = on_chip_converters::OnChipConverters;
    /// Arduino's A5, A4 and D9, and pins 2 and 4 of CN10.
    const LINES: Lines = Lines {
        port: GPIOC,
        emergency_stop: 0,
        interlock: 1,
        amplifier_ready: 7,
        enable: 8,
        trigger: 6,
    };
    /// LD2, the only one: on while the power stage is, slow while the loop is closed, fast for a fault.
    const LIGHTS: &'static [Light] = &[Light {
        port: GPIOA,
        pin: 5,
        safe: 0,
        armed: 0xFF,
        closed: 0x0F,
        fault: 0x55,
    }];
    const WATCHDOG: Iwdg = IWDG;
    const SERIAL_INTERRUPT: Interrupt = Interrupt::LPUART1;
    /// SETTINGS of `memory.x`.
    const BLOCKS: [(&'static str, u32); 2] = [("A", 0x0807_F000), ("B", 0x0807_F800)];
    const DATA_BANK: (u32, u32) = (0x0804_0000, 256 * 1024);
    const KEPT_SETTINGS: u32 = 0x0807_D800;
    const ENVELOPE: u32 = 0x0807_E000;
    const SECTOR_BYTES: u32 = 2 * 1024;
    const SPARE_SECTOR: u32 = 0x0807_E800;
    const BEYOND_FLASH: u32 = 0x0808_0000;
    const BROWN_OUT_LEVEL: &'static str = "2.5 V";

    fn crystal_runs() -> bool {
        RCC.cr().modify(|w| w.set_hseon(true));
        RCC.cr().read().hserdy()
    }

    /// The flash has its own, which are on after a reset.
    fn use_caches(_: &mut SCB) {}

    fn clock_tree() -> Config {
        let mut config = Config::default();
        let c = &mut config.rcc;
        c.hse = Some(Hse {
            freq: Hertz(24_000_000),
            mode: HseMode::Oscillator,
        });
        c.hsi48 = None;
        c.pll = Some(Pll {
            source: PllSource::HSE,
            prediv: PllPreDiv::DIV6,
            mul: PllMul::MUL85,
            divp: None,
            divq: None,
            divr: Some(PllRDiv::DIV2),
        });
        c.sys = Sysclk::PLL1_R;
        c.boost = true;
        config
    }

    fn watch_crystal() {
        RCC.cr().modify(|w| w.set_csson(true));
    }

    /// A double ECC error of the flash (RM0440, error code correction), or the crystal has stopped: the core
    /// runs from the internal oscillator then, and nothing keeps its time any more. Damaged parameters are
    /// only noted; damaged code is not gone on with.
    fn cause_of_nmi() -> Option<Fault> {
        if !has_ecc_error() {
            Some(Fault::ClockLost)
        } else if READING.load(Ordering::Acquire) {
            DAMAGED.store(true, Ordering::Release);
            None
        } else {
            Some(Fault::HardFault)
        }
    }

    fn clock_sample_timer() {
        RCC.apb1enr1().modify(|w| w.set_tim2en(true));
    }

    fn clock_lines() {
        RCC.ahb2enr().modify(|w| w.set_gpiocen(true));
        let _ = RCC.ahb2enr().read();
        cortex_m::asm::dsb();
    }

    fn clock_lights() {
        RCC.ahb2enr().modify(|w| w.set_gpioaen(true));
        let _ = RCC.ahb2enr().read();
        cortex_m::asm::dsb();
    }

    /// The flags of a supply that is switched on and of one that fell and came back are the same here
    /// (RM0440, RCC_CSR).
    fn reset_cause() -> ResetCause {
        let flags = RCC.csr().read();
        RCC.csr().modify(|w| w.set_rmvf(true));
        ResetCause {
            watchdog: flags.iwdgrstf(),
            software: flags.sftrstf(),
            brown_out: false,
        }
    }

    /// LPUART1 on PA2 (transmit) and PA3 (receive).
    fn serial_port(
        peripherals: Peripherals,
        config: SerialConfig,
    ) -> Result<Uart<'static, Blocking>, ConfigError> {
        Uart::new_blocking(
            peripherals.LPUART1,
            peripherals.PA3,
            peripherals.PA2,
            config,
        )
    }

    fn serial_registers() -> Lpuart {
        // SAFETY: the layout of all serial ports of the part is the same as far as it is used here.
        unsafe { Lpuart::from_ptr(LPUART1_REGISTERS.as_ptr()) }
    }

    async fn write_sector(address: u32, bytes: &[u8]) -> Result<(), &'static str> {
        flash::write_page(address, bytes).await
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
        PWR.cr2().modify(|w| {
            w.set_pls(LEVEL_2V81);
            w.set_pvde(true);
        });
    }

    fn supply_is_low() -> bool {
        PWR.sr2().read().pvdo()
    }

    fn watch_supply() {
        EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
        EXTI.pr(0).write(|w| w.set_line(DETECTOR_LINE, true));
        EXTI.imr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
        interrupt::PVD_PVM.set_priority(Priority::P0);
        // SAFETY: the image's handler shares nothing with what it interrupts, and never returns to it.
        unsafe { interrupt::PVD_PVM.enable() };
    }
}

/// Whether the flash interface notes a double ECC error; forgets it.
fn has_ecc_error() -> bool {
    let noted = FLASH.eccr().read();
    let damaged = noted.eccd() || noted.eccd2();
    if damaged {
        // Written ones clear (RM0440, FLASH_ECCR).
        FLASH.eccr().modify(|w| {
            w.set_eccd(true);
            w.set_eccd2(true);
        });
    }
    damaged
}
