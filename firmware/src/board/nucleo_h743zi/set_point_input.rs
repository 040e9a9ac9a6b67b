//! The analogue set point on PB1, by ADC2. The part's own sensor converter shares the clock of ADC2, so only
//! the front end on SPI has it.

use embassy_stm32::pac::adc::vals::SampleTime;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC2, ADC12_COMMON, GPIOB, RCC};

use super::analogue_inputs::{convert, select, start, take};

const CHANNEL: u8 = 5;
const PIN: usize = 1;

/// Sets the set point's converter up and starts the first conversion.
pub fn start_input() {
    RCC.ahb1enr().modify(|w| w.set_adc12en(true));
    RCC.ahb4enr().modify(|w| w.set_gpioben(true));
    let _ = (RCC.ahb1enr().read(), RCC.ahb4enr().read());
    cortex_m::asm::dsb();
    GPIOB.moder().modify(|w| w.set_moder(PIN, Moder::ANALOG));
    let sampling = [(CHANNEL, SampleTime::CYCLES64_5)];
    start(ADC2, ADC12_COMMON, true, &sampling);
    select(ADC2, CHANNEL);
    convert(ADC2);
}

/// What the set point gave last; starts the next conversion.
#[inline(always)]
pub fn read() -> Option<u16> {
    let code = take(ADC2)?;
    convert(ADC2);
    Some(code)
}
