//! The amplifier's voltage monitor on PC0 (A1), ADC3 channel 10, 16 bits over 0..3.3 V: read once a period.
//!
//! A conversion is started when the one before it is read, a few microseconds behind the edge of the sample
//! clock, and has the rest of the period: nobody waits for it. ADC3 is not the converter of the on-chip
//! front end, whose trigger and calibration stay its own.
//!
//! Clock: the internal oscillator's 64 MHz, which a lost crystal does not take along, divided by 2, and by 2
//! once more on revision V: 16 MHz (RM0433, 25.4.3). 64.5 cycles of sampling, for a divider of some kilohms
//! in front of the pin, and 8.5 of conversion are 4.6 us.

use embassy_stm32::pac::adc::vals::{Boost, Exten, Ovrmod, Pcsel, Res, SampleTime};
use embassy_stm32::pac::adccommon::vals::{Ckmode, Presc};
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC3, ADC3_COMMON, GPIOC, RCC};

const CHANNEL: u8 = 10;
const PIN: usize = 0;
/// The slowest step of the start is the linearity calibration: 165010 cycles of 16 MHz.
const MOST_START_US: u32 = 20_000;
const CYCLES_PER_US: u32 = 400;

/// Waits for a condition; goes on without it after a while, and the monitor is then silent.
fn wait_for(mut condition: impl FnMut() -> bool) {
    for _ in 0..MOST_START_US {
        if condition() {
            return;
        }
        cortex_m::asm::delay(CYCLES_PER_US);
    }
}

/// Sets the converter up and starts the first conversion.
pub fn start() {
    RCC.ahb4enr().modify(|w| {
        w.set_adc3en(true);
        w.set_gpiocen(true);
    });
    let _ = RCC.ahb4enr().read();
    cortex_m::asm::dsb();
    GPIOC.moder().modify(|w| w.set_moder(PIN, Moder::ANALOG));
    ADC3_COMMON.ccr().modify(|w| {
        w.set_ckmode(Ckmode::ASYNCHRONOUS);
        w.set_presc(Presc::DIV2);
    });
    ADC3.cr().modify(|w| w.set_deeppwd(false));
    ADC3.cr().modify(|w| {
        w.set_boost(Boost::LT25);
        w.set_advregen(true);
    });
    wait_for(|| ADC3.isr().read().ldordy());
    ADC3.cr().modify(|w| w.set_adcallin(true));
    ADC3.cr().modify(|w| w.set_adcal(true));
    wait_for(|| !ADC3.cr().read().adcal());
    ADC3.isr().write(|w| w.set_adrdy(true));
    ADC3.cr().modify(|w| w.set_aden(true));
    wait_for(|| ADC3.isr().read().adrdy());
    ADC3.pcsel()
        .modify(|w| w.set_pcsel(usize::from(CHANNEL), Pcsel::PRESELECTED));
    ADC3.smpr(1)
        .modify(|w| w.set_smp(usize::from(CHANNEL) - 10, SampleTime::CYCLES64_5));
    ADC3.sqr1().write(|w| {
        w.set_l(0);
        w.set_sq(0, CHANNEL);
    });
    ADC3.cfgr().modify(|w| {
        w.set_res(Res::BITS16);
        w.set_ovrmod(Ovrmod::OVERWRITE);
        w.set_exten(Exten::DISABLED);
    });
    ADC3.cr().modify(|w| w.set_adstart(true));
}

/// What the last conversion gave; starts the next one.
#[inline(always)]
pub fn read() -> Option<u16> {
    if !ADC3.isr().read().eoc() {
        return None;
    }
    // Reading the data clears the flag.
    let code = ADC3.dr().read().rdata();
    ADC3.cr().modify(|w| w.set_adstart(true));
    Some(code)
}
