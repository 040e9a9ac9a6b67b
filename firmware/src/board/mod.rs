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

use cortex_m::peripheral::{DWT, MPU};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::iwdg::vals::Key;
use embassy_stm32::peripherals::TIM2;
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peripherals, interrupt, rcc};

mod flash_words;
pub mod light;
#[cfg(feature = "nucleo-g474re")]
mod nucleo_g474re;
#[cfg(feature = "nucleo-h743zi")]
mod nucleo_h743zi;
mod platform;
#[cfg(any(feature = "nucleo-g474re", feature = "on-chip-converters"))]
mod triggered_converters;

pub use platform::{Lines, Platform, ResetCause, SAMPLE_RATE_HZ, TEMPERATURES_ARE_READ};

/// The board of this image.
#[cfg(feature = "nucleo-g474re")]
pub type Board = nucleo_g474re::NucleoG474re;
/// The board of this image.
#[cfg(feature = "nucleo-h743zi")]
pub type Board = nucleo_h743zi::NucleoH743zi;

#[cfg(not(any(feature = "nucleo-h743zi", feature = "nucleo-g474re")))]
compile_error!("no board: one of the features nucleo-h743zi and nucleo-g474re");

/// The flash, for an update over the line.
#[cfg(feature = "nucleo-h743zi")]
pub use nucleo_h743zi::flash;

/// The converters of this image.
pub type Converters = <Board as Platform>::Converters;

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
