//! What the part's own converters read beside the sensor. 16 bits over 0..3.3 V.
//!
//! | converter | channel | pin | what | how often |
//! |---|---|---|---|---|
//! | ADC3 | 10 | PC0 (A1) | the amplifier's voltage monitor, where the envelope has it | every period |
//! | ADC3 | 18 | | the part's temperature | every second |
//! | ADC2 | 5 | PB1 (A3) | the analogue set point, where the envelope has it | every period |
//!
//! A conversion is started when the one before it is read, a few microseconds behind the edge of the sample
//! clock, and has the rest of the period: nobody waits for it. Neither is ADC1, the converter of the on-chip
//! front end, whose trigger and calibration stay its own; ADC2 shares its clock, so that front end has no set
//! point.
//!
//! Clock: the internal oscillator's 64 MHz, which a lost crystal does not take along, divided by 2, and by 2
//! once more on revision V: 16 MHz (RM0433, 25.4.3). 64.5 cycles of sampling, for a divider of some kilohms
//! in front of the pin, and 8.5 of conversion are 4.6 us. The temperature is sampled for 387.5 cycles, 24 us:
//! it asks for 9 (DS12110, table 180). Meanwhile the monitor's last reading counts, for one period. Above 20
//! kHz nothing reads it: a conversion is longer than a period, and the tick of 100 kHz has no instruction left.

use embassy_stm32::pac::adc::Adc;
use embassy_stm32::pac::adc::vals::{Boost, Exten, Ovrmod, Pcsel, Res, SampleTime};
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::adccommon::vals::{Ckmode, Presc};
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC2, ADC3, ADC3_COMMON, ADC12_COMMON, GPIOB, GPIOC, RCC};

use crate::board::platform::SAMPLE_RATE_HZ;
use crate::temperature;

const MONITOR_CHANNEL: u8 = 10;
const MONITOR_PIN: usize = 0;
const TEMPERATURE_CHANNEL: u8 = 18;
const SET_POINT_CHANNEL: u8 = 5;
const SET_POINT_PIN: usize = 1;
/// The slowest step of the start is the linearity calibration: 165010 cycles of 16 MHz.
const MOST_START_US: u32 = 20_000;
const CYCLES_PER_US: u32 = 400;
/// Periods that a conversion of the temperature may take; it takes one.
const MOST_PERIODS: u32 = 8;

/// Waits for a condition; goes on without it after a while, and the input is then silent.
fn wait_for(condition: impl Fn() -> bool) {
    for _ in 0..MOST_START_US {
        if condition() {
            return;
        }
        cortex_m::asm::delay(CYCLES_PER_US);
    }
}

/// Sets a converter up that converts when it is asked to. `linear`: its line is calibrated as well, for 10 ms.
#[inline(never)]
fn start(adc: Adc, common: AdcCommon, linear: bool, sampling: &[(u8, SampleTime)]) {
    common.ccr().modify(|w| {
        w.set_ckmode(Ckmode::ASYNCHRONOUS);
        w.set_presc(Presc::DIV2);
    });
    adc.cr().modify(|w| w.set_deeppwd(false));
    adc.cr().modify(|w| {
        w.set_boost(Boost::LT25);
        w.set_advregen(true);
    });
    wait_for(|| adc.isr().read().ldordy());
    adc.cr().modify(|w| w.set_adcallin(linear));
    adc.cr().modify(|w| w.set_adcal(true));
    wait_for(|| !adc.cr().read().adcal());
    adc.isr().write(|w| w.set_adrdy(true));
    adc.cr().modify(|w| w.set_aden(true));
    wait_for(|| adc.isr().read().adrdy());
    for (channel, time) in sampling {
        let channel = usize::from(*channel);
        adc.pcsel()
            .modify(|w| w.set_pcsel(channel, Pcsel::PRESELECTED));
        adc.smpr(channel / 10)
            .modify(|w| w.set_smp(channel % 10, *time));
    }
    adc.cfgr().modify(|w| {
        w.set_res(Res::BITS16);
        w.set_ovrmod(Ovrmod::OVERWRITE);
        w.set_exten(Exten::DISABLED);
    });
}

#[inline(always)]
fn select(adc: Adc, channel: u8) {
    adc.sqr1().write(|w| {
        w.set_l(0);
        w.set_sq(0, channel);
    });
}

#[inline(always)]
fn convert(adc: Adc) {
    adc.cr().modify(|w| w.set_adstart(true));
}

/// What the conversion gave; reading it clears the flag.
#[inline(always)]
fn take(adc: Adc) -> Option<u16> {
    adc.isr().read().eoc().then(|| adc.dr().read().rdata())
}

/// What a conversion is of.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Converts {
    Nothing,
    Monitor,
    Temperature,
}

/// ADC3: the voltage monitor, and the temperature in between.
pub struct MonitorAndTemperature {
    has_monitor: bool,
    converts: Converts,
    /// Since the temperature was asked for.
    periods: u32,
    monitored: Option<u16>,
}

impl MonitorAndTemperature {
    /// Not started yet.
    pub const fn new(has_monitor: bool) -> Self {
        Self {
            has_monitor,
            converts: Converts::Nothing,
            // The first reading comes with the first periods.
            periods: SAMPLE_RATE_HZ,
            monitored: None,
        }
    }

    /// Sets the converter up and starts the first conversion.
    pub fn start(&mut self) {
        RCC.ahb4enr().modify(|w| {
            w.set_adc3en(true);
            w.set_gpiocen(true);
        });
        let _ = RCC.ahb4enr().read();
        cortex_m::asm::dsb();
        GPIOC
            .moder()
            .modify(|w| w.set_moder(MONITOR_PIN, Moder::ANALOG));
        ADC3_COMMON.ccr().modify(|w| w.set_vsenseen(true));
        let sampling = [
            (MONITOR_CHANNEL, SampleTime::CYCLES64_5),
            (TEMPERATURE_CHANNEL, SampleTime::CYCLES387_5),
        ];
        // A temperature alone does not need the line, and the start does not wait for it.
        start(ADC3, ADC3_COMMON, self.has_monitor, &sampling);
        select(ADC3, MONITOR_CHANNEL);
        self.begin_monitor();
    }

    fn begin_monitor(&mut self) {
        self.converts = Converts::Nothing;
        if self.has_monitor {
            self.converts = Converts::Monitor;
            convert(ADC3);
        }
    }

    /// What the monitor gave last; starts the next conversion.
    #[inline(always)]
    pub fn read(&mut self) -> Option<u16> {
        if temperature::IS_READ {
            self.periods += 1;
            if self.converts == Converts::Temperature || self.periods >= SAMPLE_RATE_HZ {
                return self.read_with_temperature();
            }
        }
        if self.converts != Converts::Monitor {
            return None;
        }
        let code = take(ADC3);
        convert(ADC3);
        if temperature::IS_READ {
            self.monitored = code;
        }
        code
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn read_with_temperature(&mut self) -> Option<u16> {
        if self.converts == Converts::Temperature {
            let code = take(ADC3);
            if code.is_some() || self.periods >= MOST_PERIODS {
                temperature::take(code);
                select(ADC3, MONITOR_CHANNEL);
                self.begin_monitor();
            }
        } else {
            if self.converts == Converts::Monitor {
                self.monitored = take(ADC3);
            }
            self.periods = 0;
            select(ADC3, TEMPERATURE_CHANNEL);
            convert(ADC3);
            self.converts = Converts::Temperature;
        }
        self.monitored
    }
}

/// Sets the set point's converter up and starts the first conversion.
#[cfg(not(feature = "on-chip-converters"))]
pub fn start_set_point() {
    RCC.ahb1enr().modify(|w| w.set_adc12en(true));
    RCC.ahb4enr().modify(|w| w.set_gpioben(true));
    let _ = (RCC.ahb1enr().read(), RCC.ahb4enr().read());
    cortex_m::asm::dsb();
    GPIOB
        .moder()
        .modify(|w| w.set_moder(SET_POINT_PIN, Moder::ANALOG));
    let sampling = [(SET_POINT_CHANNEL, SampleTime::CYCLES64_5)];
    start(ADC2, ADC12_COMMON, true, &sampling);
    select(ADC2, SET_POINT_CHANNEL);
    convert(ADC2);
}

/// What the set point gave last; starts the next conversion.
#[cfg(not(feature = "on-chip-converters"))]
#[inline(always)]
pub fn read_set_point() -> Option<u16> {
    let code = take(ADC2)?;
    convert(ADC2);
    Some(code)
}
