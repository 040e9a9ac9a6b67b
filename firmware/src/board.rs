//! The board: clocks, and the priorities below the control interrupt.
//!
//! Crystal: the 8 MHz that the NUCLEO's debugger feeds to OSC_IN. PLL1 makes 400 MHz for the core (voltage scale 1), 200 MHz
//! for the buses' timers, and 100 MHz for SPI1 to SPI3.

use cortex_m::peripheral::{DWT, MPU};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::pac::RCC;
use embassy_stm32::peripherals::TIM2;
use embassy_stm32::rcc::{AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk, VoltageScale};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Config, Peripherals, interrupt, rcc};

/// Lets `guard_stack` have the memory protection unit, sets the clock tree up and puts the time driver's interrupt below the control interrupt.
pub fn init(guard_stack: impl FnOnce(&mut MPU)) -> Peripherals {
    let mut config = Config::default();
    let c = &mut config.rcc;
    c.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Bypass });
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
    let peripherals = embassy_stm32::init(config);
    interrupt::TIM5.set_priority(Priority::P8);
    if let Some(mut core) = cortex_m::Peripherals::take() {
        // The cycle counter, with which the control interrupt times its tick.
        core.DCB.enable_trace();
        // Locked until a debugger was there (Armv7-M, C1.8.8: LAR), which a part in the field never sees.
        DWT::unlock();
        core.DWT.enable_cycle_counter();
        guard_stack(&mut core.MPU);
    }
    // A crystal that stops raises the NMI.
    RCC.cr().modify(|w| w.set_hsecsson(true));
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
    Clocks { core_hz: sys.map_or(0, |hertz| hertz.0), timer_hz: rcc::frequency::<TIM2>().0 }
}
