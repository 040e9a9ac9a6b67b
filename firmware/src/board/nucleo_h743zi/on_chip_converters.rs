//! The chip's own converters: a bare board works. 16-bit ADC1 and 12-bit DAC1, both triggered by the sample
//! clock.
//!
//! | signal | pin | timing |
//! |---|---|---|
//! | sensor | PA3 (ADC1_INP15), 0..3.3 V | TIM2's update samples it at the edge; ready 1 us later |
//! | drive | PA4 (DAC1_OUT1), 0..3.3 V | the code written before is latched at the edge by the same trigger |
//!
//! The drive's codes are 12 bits wide: the block's front end says `drive_bits = 12`. Without a rest code the
//! output is not enabled, and floats.
//!
//! The ADC runs at the AHB clock of 200 MHz divided by 4, which revision V of the part halves again: 25 MHz,
//! 25 cycles for sampling and conversion (RM0433, 25.4.3 and 25.4.17). Its linearity and offset are
//! calibrated at start.

use embassy_stm32::pac::adc::vals::{Boost, Exten, Ovrmod, Pcsel, Res, SampleTime};
use embassy_stm32::pac::adccommon::vals::Ckmode;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC1, ADC12_COMMON, DAC1, GPIOA, RCC};

use hysteron_core::codes::{DriveCode, SensorCode};

use super::analogue_inputs::MonitorAndTemperatures;
use crate::board::triggered_converters;
use crate::front_end::{CodeBits, FrontEnd, Wiring};

const SENSOR_CHANNEL: u8 = 15;
/// TIM2_TRGO among the regular triggers of ADC1 (RM0433, Table 206).
const ADC_TRIGGER_TIM2: u8 = 11;
/// TIM2_TRGO among the triggers of DAC1 (RM0433, Table 225).
const DAC_TRIGGER_TIM2: u8 = 2;
/// The slowest step of the start is the linearity calibration: 165010 cycles of 25 MHz.
const MOST_START_US: u32 = 20_000;
const CYCLES_PER_US: u32 = 400;

/// The on-chip front end.
pub struct OnChipConverters {
    /// From a drive's code to the converter's own.
    shift: u8,
    inputs: MonitorAndTemperatures,
}

/// Reads each enable back: a clock runs two cycles after its bit is set, and what is written before is lost
/// (RM0433, 8.5.11).
fn enable_clocks() {
    RCC.ahb1enr().modify(|w| w.set_adc12en(true));
    RCC.apb1lenr().modify(|w| w.set_dac12en(true));
    RCC.ahb4enr().modify(|w| w.set_gpioaen(true));
    let _ = (
        RCC.ahb1enr().read(),
        RCC.apb1lenr().read(),
        RCC.ahb4enr().read(),
    );
    cortex_m::asm::dsb();
}

/// Waits for a condition; goes on without it after a while, and the guard then finds the sensor silent.
fn wait_for(mut condition: impl FnMut() -> bool) {
    for _ in 0..MOST_START_US {
        if condition() {
            return;
        }
        cortex_m::asm::delay(CYCLES_PER_US);
    }
}

impl FrontEnd for OnChipConverters {
    const NAME: &'static str = "on-chip ADC1 and DAC1";
    const BITS: CodeBits = CodeBits { adc: 16, dac: 12 };
    const INTERRUPT_AFTER_NS: u32 = 1_500;
    const READS_BACK: bool = false;
    const HAS_MONITOR: bool = true;
    const HAS_SET_POINT: bool = false;

    fn has(bits: CodeBits) -> bool {
        bits.adc == Self::BITS.adc && bits.dac <= Self::BITS.dac
    }

    fn new(bits: CodeBits, wiring: Wiring) -> Self {
        Self {
            shift: Self::BITS.dac.saturating_sub(bits.dac),
            inputs: MonitorAndTemperatures::new(wiring),
        }
    }

    fn start(&mut self, rest_code: Option<DriveCode>) {
        self.inputs.start();
        enable_clocks();
        for pin in [3, 4] {
            GPIOA.moder().modify(|w| w.set_moder(pin, Moder::ANALOG));
        }
        if let Some(rest_code) = rest_code {
            // Without a trigger yet, so that the output is at rest from its first moment on.
            self.write(rest_code);
            DAC1.cr().modify(|w| w.set_en(0, true));
            DAC1.cr().modify(|w| {
                w.set_tsel(0, DAC_TRIGGER_TIM2);
                w.set_ten(0, true);
            });
        }

        ADC12_COMMON
            .ccr()
            .modify(|w| w.set_ckmode(Ckmode::SYNC_DIV4));
        ADC1.cr().modify(|w| w.set_deeppwd(false));
        ADC1.cr().modify(|w| {
            w.set_boost(Boost::LT25);
            w.set_advregen(true);
        });
        wait_for(|| ADC1.isr().read().ldordy());
        ADC1.cr().modify(|w| w.set_adcallin(true));
        ADC1.cr().modify(|w| w.set_adcal(true));
        wait_for(|| !ADC1.cr().read().adcal());
        ADC1.isr().write(|w| w.set_adrdy(true));
        ADC1.cr().modify(|w| w.set_aden(true));
        wait_for(|| ADC1.isr().read().adrdy());
        ADC1.pcsel()
            .modify(|w| w.set_pcsel(usize::from(SENSOR_CHANNEL), Pcsel::PRESELECTED));
        ADC1.smpr(1)
            .modify(|w| w.set_smp(usize::from(SENSOR_CHANNEL) - 10, SampleTime::CYCLES16_5));
        ADC1.sqr1().write(|w| {
            w.set_l(0);
            w.set_sq(0, SENSOR_CHANNEL);
        });
        ADC1.cfgr().modify(|w| {
            w.set_res(Res::BITS16);
            w.set_ovrmod(Ovrmod::OVERWRITE);
            w.set_extsel(ADC_TRIGGER_TIM2);
            w.set_exten(Exten::RISING_EDGE);
        });
        // From here on every edge of the sample clock converts.
        ADC1.cr().modify(|w| w.set_adstart(true));
    }

    #[inline(always)]
    fn read(&mut self) -> Option<SensorCode> {
        triggered_converters::read()
    }

    #[inline(always)]
    fn write(&mut self, code: DriveCode) -> bool {
        triggered_converters::write(code.steps() << self.shift)
    }

    /// It has the part's own supply.
    fn renew(&mut self) -> bool {
        true
    }

    #[inline(always)]
    fn monitor(&mut self) -> Option<u16> {
        self.inputs.read()
    }

    fn force(&mut self, code: DriveCode) {
        enable_clocks();
        triggered_converters::force(code.steps() << self.shift);
    }
}
