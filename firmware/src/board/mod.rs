//! The board: everything that is one board's and not another's, behind one trait, [`Platform`].
//!
//! A board has a folder here: clocks, pins, converters, flash, option bytes, the supply's detector, how much
//! memory there is for what. A feature of the package chooses one ([`Board`]); the rest
//! of the firmware asks [`Board`] and knows no other.
//!
//! | feature | board | part |
//! |---|---|---|
//! | `nucleo-h743zi` (default) | NUCLEO-H743ZI2 | STM32H743ZI |
//! | `nucleo-g474re` | NUCLEO-G474RE | STM32G474RE |

use cortex_m::peripheral::{DWT, MPU, SCB};
use embassy_stm32::interrupt::{Interrupt, InterruptExt, Priority};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::iwdg::Iwdg;
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::pac::usart::Lpuart;
use embassy_stm32::peripherals::TIM2;
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{Config as SerialConfig, ConfigError, Uart};
use embassy_stm32::{Config, Peripherals, interrupt, rcc};

use crate::front_end::FrontEnd;

mod flash_words;
#[cfg(feature = "nucleo-g474re")]
mod nucleo_g474re;
#[cfg(feature = "nucleo-h743zi")]
mod nucleo_h743zi;
#[cfg(any(feature = "nucleo-g474re", feature = "on-chip-converters"))]
mod triggered_converters;

/// The board of this image.
#[cfg(feature = "nucleo-g474re")]
pub type Board = nucleo_g474re::NucleoG474re;
/// The board of this image.
#[cfg(feature = "nucleo-h743zi")]
pub type Board = nucleo_h743zi::NucleoH743zi;

#[cfg(not(any(feature = "nucleo-h743zi", feature = "nucleo-g474re")))]
compile_error!("no board: one of the features nucleo-h743zi and nucleo-g474re");

/// The flash, for [`crate::update`].
#[cfg(feature = "nucleo-h743zi")]
#[allow(unused_imports)] // only the firmware updates itself
pub use nucleo_h743zi::flash;

/// The converters of this image.
pub type Converters = <Board as Platform>::Converters;

/// Control ticks per second, which build.rs has from the environment.
pub const SAMPLE_RATE_HZ: u32 = match u32::from_str_radix(env!("HYSTERON_SAMPLE_RATE_HZ"), 10) {
    Ok(rate_hz) => rate_hz,
    Err(_) => panic!("build.rs gives a number"),
};

/// What a board is to the firmware. The sample clock is TIM2 and the tasks' clock TIM5 on every board.
pub trait Platform {
    /// Bytes of the log on its way to the probe.
    const LOG_BYTES: usize;
    /// Samples that the recorder keeps; a power of two.
    const RECORDED_SAMPLES: u32;
    /// Points of a wave table.
    const WAVE_POINTS: usize;
    /// Whether a period has time for a swap, some 3,750 instructions before the tick.
    const SWAPS: bool;
    /// Whether a period has time for a swap that evaluates the whole memory of the hysteresis anew: some
    /// 13,000 instructions before the tick.
    const SWAPS_HYSTERESIS: bool;
    /// Sensor and drive.
    type Converters: FrontEnd;
    /// The lines that make a bench safe.
    const LINES: Lines;
    /// The independent watchdog.
    const WATCHDOG: Iwdg;
    /// The serial port's interrupt.
    const SERIAL_INTERRUPT: Interrupt;
    /// Names and addresses of the two places of a parameter block: sectors that no code occupies, in a bank
    /// that no code is in.
    const BLOCKS: [(&'static str, u32); 2];
    /// Address and length of the bank of the flash that is written while the program runs; no code of the
    /// image is in it.
    const DATA_BANK: (u32, u32);
    /// The sector of the settings that the operator keeps.
    const KEPT_SETTINGS: u32;
    /// The sector of the safety envelope.
    const ENVELOPE: u32;
    /// Bytes of a sector; the last 32 of a block's are the mark that another one replaces it.
    const SECTOR_BYTES: u32;
    /// Another such sector, which the board check may write.
    #[allow(dead_code)] // for the board check
    const SPARE_SECTOR: u32;
    /// The first address behind the flash.
    #[allow(dead_code)] // for the board check
    const BEYOND_FLASH: u32;
    /// The brown-out level that [`Platform::write_protection`] sets.
    const BROWN_OUT_LEVEL: &'static str;

    /// Switches the crystal on; whether it runs.
    fn crystal_runs() -> bool;
    /// Switches caches on that the part leaves off.
    fn use_caches(control: &mut SCB);
    /// The clock tree, for the HAL.
    fn clock_tree() -> Config;
    /// Lets a crystal that stops raise the NMI.
    fn watch_crystal();
    /// The clock of TIM2.
    fn clock_sample_timer();
    /// The clocks of the ports of [`Platform::LINES`], read back.
    fn clock_lines();
    /// What the reset flags say; clears them.
    fn reset_cause() -> ResetCause;

    /// The serial port that the debugger on the board makes a virtual COM port of.
    ///
    /// # Errors
    /// The HAL's: a speed that the port cannot have.
    fn serial_port(
        peripherals: Peripherals,
        config: SerialConfig,
    ) -> Result<Uart<'static, Blocking>, ConfigError>;
    /// Its registers.
    fn serial_registers() -> Lpuart;

    /// Erases the sector at `address`, one of [`Platform::BLOCKS`], and writes `bytes` to its beginning,
    /// without ever holding up the tasks.
    ///
    /// # Errors
    /// The flash refused it, or does not answer.
    async fn write_sector(address: u32, bytes: &[u8]) -> Result<(), &'static str>;
    /// Programs 32 bytes of zeros at `address`, which is erased.
    ///
    /// # Errors
    /// The flash refused it, or does not answer.
    async fn write_mark(address: u32) -> Result<(), &'static str>;
    /// Before flash is read that may be damaged.
    fn begin_reading();
    /// Behind it: whether the flash interface has met a double ECC error.
    fn end_reading() -> bool;

    /// What the option bytes protect: 1 the brown-out level is high enough, 2 the watchdog starts with the
    /// supply, 3 both.
    fn protection() -> u32;
    /// Writes them, everything else as it is.
    ///
    /// # Errors
    /// They were not taken.
    async fn write_protection() -> Result<(), &'static str>;

    /// Starts the detector of the supply's voltage; it needs some 50 us.
    fn start_supply_detector();
    /// Whether the supply is too low.
    fn supply_is_low() -> bool;
    /// Lets a supply that falls stop the drive from now on.
    fn watch_supply();
}

/// The lines of [`crate::safety_lines`]: a port and numbers of its pins.
pub struct Lines {
    /// All of them are pins of this port.
    pub port: Gpio,
    /// Input: a contact to ground that opens to stop.
    pub emergency_stop: usize,
    /// Input: the same.
    pub interlock: usize,
    /// Input: the amplifier's output that conducts to ground while it is ready.
    pub amplifier_ready: usize,
    /// Output: lets the amplifier's power stage work.
    pub enable: usize,
    /// Output: high with the marked point of a wave table.
    pub trigger: usize,
}

/// What reset the part, as far as its flags tell.
#[derive(Clone, Copy)]
pub struct ResetCause {
    /// The independent watchdog.
    pub watchdog: bool,
    /// The program itself.
    pub software: bool,
    /// The supply fell and came back, and was not switched on.
    pub brown_out: bool,
}

/// The part leaves its reset with its own oscillator; how long the crystal may take to start is some
/// milliseconds (DS12110, DS12288).
const CRYSTAL_POLLS: u32 = 1_000;
/// Between two of them, cycles of that oscillator: some 0.2 ms.
const BETWEEN_POLLS_CYCLES: u32 = 10_000;

/// Waits for the crystal. Without it the HAL would wait for ever, and nobody would know why; here it is
/// reported, the watchdog is fed, and nothing is driven: the power stage's line has not been set up, and the
/// drive's converter is as it left its reset.
fn wait_for_crystal() {
    let mut polls = 0u32;
    while !Board::crystal_runs() {
        if polls % CRYSTAL_POLLS == CRYSTAL_POLLS - 1 {
            defmt::error!("the crystal does not start: nothing is driven");
        }
        polls = polls.wrapping_add(1);
        feed_watchdog();
        cortex_m::asm::delay(BETWEEN_POLLS_CYCLES);
    }
}

/// Feeds the watchdog, if the option bytes or the program have started it.
pub fn feed_watchdog() {
    Board::WATCHDOG.kr().write(|w| w.set_key(Key::RESET));
}

/// Lets `guard_stack` have the memory protection unit, sets the clock tree up and puts the time driver's
/// interrupt below the control interrupt.
pub fn init(guard_stack: impl FnOnce(&mut MPU)) -> Peripherals {
    wait_for_crystal();
    let peripherals = embassy_stm32::init(Board::clock_tree());
    interrupt::TIM5.set_priority(Priority::P8);
    if let Some(mut core) = cortex_m::Peripherals::take() {
        // The cycle counter, with which the control interrupt times its tick.
        core.DCB.enable_trace();
        // Locked until a debugger was there (Armv7-M, C1.8.8: LAR), which a part in the field never sees.
        DWT::unlock();
        core.DWT.enable_cycle_counter();
        Board::use_caches(&mut core.SCB);
        guard_stack(&mut core.MPU);
    }
    Board::watch_crystal();
    peripherals
}

/// Clocks that the clock tree reports.
#[derive(Clone, Copy, defmt::Format)]
pub struct Clocks {
    /// Core, Hz.
    pub core_hz: u32,
    /// Timers on APB1, Hz.
    pub timer_hz: u32,
}

/// What the clock tree gives.
pub fn clocks(peripherals: &Peripherals) -> Clocks {
    let sys: Option<Hertz> = rcc::clocks(&peripherals.RCC).sys.into();
    Clocks {
        core_hz: sys.map_or(0, |hertz| hertz.0),
        timer_hz: rcc::frequency::<TIM2>().0,
    }
}
