//! What the part's own converters read beside the sensor. 16 bits over 0..3.3 V.
//!
//! | converter | channel | pin | what | how often |
//! |---|---|---|---|---|
//! | ADC3 | 10 | PC0 (A1) | the amplifier's voltage monitor, where the envelope has it | every period |
//! | ADC3 | 18 | | the part's temperature | every second |
//! | ADC3 | 6 | PF10 (A5) | the amplifier's temperature, where the envelope has it | behind it |
//! | ADC2 | 5 | PB1 (A3) | the analogue set point, where the envelope has it (`set_point_input.rs`) | every period |
//!
//! A conversion is started when the one before it is read, a few microseconds behind the edge of the sample
//! clock, and has the rest of the period: nobody waits for it. Neither is ADC1, the converter of the on-chip
//! front end, whose trigger and calibration stay its own; ADC2 shares its clock, so that front end has no set
//! point.
//!
//! Clock: the internal oscillator's 64 MHz, which a lost crystal does not take along, divided by 2, and by 2
//! once more on revision V: 16 MHz (RM0433, 25.4.3). 64.5 cycles of sampling, for a divider of some kilohms
//! in front of the pin, and 8.5 of conversion are 4.6 us. Temperatures are sampled for 387.5 cycles, 24 us: the
//! part's asks for 9 (DS12110, table 180). Meanwhile the monitor's last reading counts, for two periods. Above
//! 20 kHz nothing reads it: a conversion is longer than a period, and the tick of 100 kHz has no instruction left.

use embassy_stm32::pac::adc::Adc;
use embassy_stm32::pac::adc::vals::{Boost, Exten, Ovrmod, Pcsel, Res, SampleTime};
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::adccommon::vals::{Ckmode, Presc};
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::{ADC3, ADC3_COMMON, GPIOC, GPIOF, RCC};

use crate::board::platform::{SAMPLE_RATE_HZ, TEMPERATURES_ARE_READ};
use crate::front_end::Wiring;
use crate::temperature_codes;

const MONITOR_CHANNEL: u8 = 10;
const MONITOR_PIN: usize = 0;
const PART_CHANNEL: u8 = 18;
const AMPLIFIER_CHANNEL: u8 = 6;
const AMPLIFIER_PIN: usize = 10;
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
pub(super) fn start(adc: Adc, common: AdcCommon, linear: bool, sampling: &[(u8, SampleTime)]) {
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
pub(super) fn select(adc: Adc, channel: u8) {
    adc.sqr1().write(|w| {
        w.set_l(0);
        w.set_sq(0, channel);
    });
}

#[inline(always)]
pub(super) fn convert(adc: Adc) {
    adc.cr().modify(|w| w.set_adstart(true));
}

/// What the conversion gave; reading it clears the flag.
#[inline(always)]
pub(super) fn take(adc: Adc) -> Option<u16> {
    adc.isr().read().eoc().then(|| adc.dr().read().rdata())
}

/// What a conversion is of.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Converts {
    Nothing,
    Monitor,
    PartsTemperature,
    AmplifiersTemperature,
}

/// ADC3: the voltage monitor, and the temperatures in between.
pub struct MonitorAndTemperatures {
    has_monitor: bool,
    has_amplifier: bool,
    converts: Converts,
    /// Since a temperature was asked for.
    periods: u32,
    monitored: Option<u16>,
}

impl MonitorAndTemperatures {
    /// Not started yet.
    pub const fn new(wiring: Wiring) -> Self {
        Self {
            has_monitor: wiring.has_monitor,
            has_amplifier: wiring.has_amplifier_temperature,
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
            w.set_gpiofen(true);
        });
        let _ = RCC.ahb4enr().read();
        cortex_m::asm::dsb();
        GPIOC
            .moder()
            .modify(|w| w.set_moder(MONITOR_PIN, Moder::ANALOG));
        GPIOF
            .moder()
            .modify(|w| w.set_moder(AMPLIFIER_PIN, Moder::ANALOG));
        ADC3_COMMON.ccr().modify(|w| w.set_vsenseen(true));
        let sampling = [
            (MONITOR_CHANNEL, SampleTime::CYCLES64_5),
            (AMPLIFIER_CHANNEL, SampleTime::CYCLES387_5),
            (PART_CHANNEL, SampleTime::CYCLES387_5),
        ];
        // Temperatures alone do not need the line, and the start does not wait for it.
        start(ADC3, ADC3_COMMON, self.has_monitor, &sampling);
        self.begin_monitor();
    }

    fn begin(&mut self, converts: Converts, channel: u8) {
        select(ADC3, channel);
        convert(ADC3);
        self.converts = converts;
    }

    fn begin_temperature(&mut self, converts: Converts, channel: u8) {
        self.periods = 0;
        self.begin(converts, channel);
    }

    fn begin_monitor(&mut self) {
        self.converts = Converts::Nothing;
        if self.has_monitor {
            self.begin(Converts::Monitor, MONITOR_CHANNEL);
        }
    }

    /// What the monitor gave last; starts the next conversion.
    #[inline(always)]
    pub fn read(&mut self) -> Option<u16> {
        if TEMPERATURES_ARE_READ {
            self.periods += 1;
            if !matches!(self.converts, Converts::Nothing | Converts::Monitor)
                || self.periods >= SAMPLE_RATE_HZ
            {
                return self.read_with_temperature();
            }
        }
        if self.converts != Converts::Monitor {
            return None;
        }
        let code = take(ADC3);
        convert(ADC3);
        if TEMPERATURES_ARE_READ {
            self.monitored = code;
        }
        code
    }

    #[inline(never)]
    #[unsafe(link_section = ".control_code")]
    fn read_with_temperature(&mut self) -> Option<u16> {
        let code = take(ADC3);
        let ended = code.is_some() || self.periods >= MOST_PERIODS;
        match self.converts {
            Converts::Nothing => self.begin_temperature(Converts::PartsTemperature, PART_CHANNEL),
            Converts::Monitor => {
                self.monitored = code;
                self.begin_temperature(Converts::PartsTemperature, PART_CHANNEL);
            }
            Converts::PartsTemperature if ended => {
                temperature_codes::take(code);
                if self.has_amplifier {
                    self.begin_temperature(Converts::AmplifiersTemperature, AMPLIFIER_CHANNEL);
                } else {
                    self.begin_monitor();
                }
            }
            Converts::AmplifiersTemperature if ended => {
                temperature_codes::take_amplifiers(code);
                self.begin_monitor();
            }
            Converts::PartsTemperature | Converts::AmplifiersTemperature => {}
        }
        self.monitored
    }
}
