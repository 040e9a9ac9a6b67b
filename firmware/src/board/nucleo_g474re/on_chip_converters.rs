//! The part's own converters: 12-bit ADC1 and 12-bit DAC1, both triggered by the sample clock.
//!
//! | signal | pin | timing |
//! |---|---|---|
//! | sensor | PA0 (ADC1_IN1, Arduino's A0), 0..3.3 V | TIM2 samples at the edge; ready 0.6 us later |
//! | drive | PA4 (DAC1_OUT1, Arduino's A2), 0..3.3 V | TIM2 latches the earlier code at the edge |
//!
//! The sensor's twelve bits are the upper ones of its code, which so goes in steps of 16 over the whole of
//! its range. The drive's codes are 12 bits wide: the block's front end says `drive_bits = 12`. From a reset
//! until the program has started the output floats.
//!
//! The ADC runs at the core's clock divided by 4, 42.5 MHz: 12.5 cycles for the sample, 12.5 for the
//! conversion (RM0440, channel-wise programmable sampling time). It is calibrated at start. Its oversampler
//! is not used: it would take the mean over some microseconds behind the edge and not the sample at it.

use embassy_stm32::pac::adc::vals::{Exten, Ovrmod, Res, SampleTime};
use embassy_stm32::pac::adccommon::vals::Ckmode;
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC1, ADC12_COMMON, DAC1, GPIOA, RCC};

use hysteron_core::codes::{DriveCode, SensorCode};

use crate::board::triggered_converters;
use crate::front_end::{CodeBits, FrontEnd, Wiring};

const SENSOR_CHANNEL: u8 = 1;
/// TIM2_TRGO among the regular triggers of ADC1 (RM0440, external triggers for regular channels of ADC1 and
/// ADC2).
const ADC_TRIGGER_TIM2: u8 = 11;
/// TIM2_TRGO among the triggers of DAC1 (RM0440, DAC1 interconnection).
const DAC_TRIGGER_TIM2: u8 = 4;
/// HFSEL: a bus clock above 160 MHz (RM0440, DAC_MCR).
const DAC_ABOVE_160_MHZ: u8 = 2;
/// The slowest step of the start is the calibration.
const MOST_START_US: u32 = 1_000;
const CYCLES_PER_US: u32 = 170;
/// For the ADC's regulator to start (DS12288).
const REGULATOR_US: u32 = 20;

/// The on-chip front end.
pub struct OnChipConverters {
    /// From a drive's code to the converter's own.
    shift: u8,
}

/// Reads the enables back: a clock runs two cycles after its bit is set, and what is written before is lost
/// (RM0440, RCC: peripheral clock enable).
fn enable_clocks() {
    RCC.ahb2enr().modify(|w| {
        w.set_adc12en(true);
        w.set_dac1en(true);
        w.set_gpioaen(true);
    });
    let _ = RCC.ahb2enr().read();
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

fn set_analog_pins() {
    for pin in [0, 4] {
        GPIOA.moder().modify(|w| w.set_moder(pin, Moder::ANALOG));
    }
}

/// The output buffered, on its pin only.
fn begin_drive() {
    DAC1.mcr().modify(|w| {
        w.set_hfsel(DAC_ABOVE_160_MHZ);
        w.set_mode(0, Mode::NORMAL_EXT_BUFEN);
    });
}

impl FrontEnd for OnChipConverters {
    const NAME: &'static str = "on-chip ADC1 and DAC1, 12 bits";
    const BITS: CodeBits = CodeBits { adc: 16, dac: 12 };
    const INTERRUPT_AFTER_NS: u32 = 1_000;
    const READS_BACK: bool = false;
    const HAS_MONITOR: bool = false;
    const HAS_SET_POINT: bool = false;

    fn has(bits: CodeBits) -> bool {
        bits.adc == Self::BITS.adc && bits.dac <= Self::BITS.dac
    }

    fn new(bits: CodeBits, _: Wiring) -> Self {
        Self {
            shift: Self::BITS.dac.saturating_sub(bits.dac),
        }
    }

    fn start(&mut self, rest_code: Option<DriveCode>) {
        enable_clocks();
        set_analog_pins();
        begin_drive();
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
        ADC1.cr().modify(|w| w.set_advregen(true));
        cortex_m::asm::delay(REGULATOR_US * CYCLES_PER_US);
        ADC1.cr().modify(|w| w.set_adcal(true));
        wait_for(|| !ADC1.cr().read().adcal());
        // Four cycles of the ADC at least.
        cortex_m::asm::delay(CYCLES_PER_US);
        ADC1.isr().write(|w| w.set_adrdy(true));
        ADC1.cr().modify(|w| w.set_aden(true));
        wait_for(|| ADC1.isr().read().adrdy());
        ADC1.smpr()
            .modify(|w| w.set_smp(usize::from(SENSOR_CHANNEL), SampleTime::CYCLES12_5));
        ADC1.sqr1().write(|w| {
            w.set_l(0);
            w.set_sq(0, SENSOR_CHANNEL);
        });
        ADC1.cfgr().modify(|w| {
            w.set_res(Res::BITS12);
            w.set_align(true);
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

    fn force(&mut self, code: DriveCode) {
        enable_clocks();
        set_analog_pins();
        begin_drive();
        triggered_converters::force(code.steps() << self.shift);
    }
}
