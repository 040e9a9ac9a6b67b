//! Two notches and a low-pass on a signal of the tick: the set point or the sensor's reading.
//!
//! # How it works
//! A [`SignalFilter`] is a chain of [`SECTIONS`] biquads in direct form I. Each section carries the
//! fraction that its shift cuts off into the next sample, and its integers have a gain of exactly one at
//! rest ([`crate::filter_design`]): a signal that rests passes to the last bit, whatever the section. A
//! section that is off costs nothing.
//!
//! # Tuned while it runs
//! [`SignalFilter::set`] changes a section between two ticks. At the next sample the new integers begin at
//! rest at that sample, and what the old ones make of it otherwise becomes an offset behind the section,
//! which decays by a 2^-[`OFFSET_DECAY_SHIFT`] part a tick. So the output of that sample is that of the old
//! integers, to the last bit. The new ones begin with the right value and without the signal's speed: none
//! of the next steps is larger than their step response and the decay make of the signal's own. Going on
//! from the past of the old integers would let the new ones ring with all of the old lag. A section that is
//! switched off is left when its offset has gone.

use crate::integer_row::Row;
use crate::signal::saturate_shifted;

/// Fraction bits of a section's integers.
pub const SECTION_FRACTION_BITS: u32 = 28;
/// Sections of a chain: two notches and a low-pass.
pub const SECTIONS: usize = 3;
/// The offset behind a section that was changed loses this binary fraction of itself at every sample: 13 ms
/// at 20 kHz.
pub const OFFSET_DECAY_SHIFT: u32 = 8;

/// Integers of a section over `[x[k], x[k-1], x[k-2], y[k-1], y[k-2]]`.
pub type SectionRow = Row<5, SECTION_FRACTION_BITS>;

/// A section that passes everything.
pub const PASSES: SectionRow = Row {
    coefficients: [1 << SECTION_FRACTION_BITS, 0, 0, 0, 0],
};

/// Which signal is filtered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum FilteredSignal {
    /// The reference that is asked for, before anything is fed forward for it.
    SetPoint = 0,
    /// The reading that the law, the guard and the learning see.
    Sensor = 1,
}

/// A place in the chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Place {
    /// The first notch.
    Notch1 = 0,
    /// The second one.
    Notch2 = 1,
    /// The low-pass.
    LowPass = 2,
}

impl Place {
    /// Every place, in the order of the chain.
    pub const ALL: [Self; SECTIONS] = [Self::Notch1, Self::Notch2, Self::LowPass];
}

/// A section with its past.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct Section {
    row: SectionRow,
    /// `x[k-1], x[k-2], y[k-1], y[k-2]`.
    past: [i32; 4],
    remainder: u32,
    /// On, the past counts, the integers are those of the last output, and nothing is added to it.
    settled: bool,
    /// The past counts: the section was on at the last sample.
    runs: bool,
    offset: i32,
    /// What made the last output, where the integers have changed since.
    before: Option<SectionRow>,
}

impl Section {
    const OFF: Self = Self {
        row: PASSES,
        past: [0; 4],
        remainder: 0,
        settled: false,
        runs: false,
        offset: 0,
        before: None,
    };

    /// The section's own output, before the offset, and what its shift cuts off.
    #[inline(always)]
    fn own(&self, row: &SectionRow, sample: i32, saturated: &mut u32) -> (i32, u32) {
        let [x1, x2, y1, y2] = self.past;
        let total = row.sum_from(i64::from(self.remainder), &[sample, x1, x2, y1, y2]);
        let cut = (total & ((1i64 << SECTION_FRACTION_BITS) - 1)) as u32;
        (
            saturate_shifted::<SECTION_FRACTION_BITS>(total, saturated),
            cut,
        )
    }

    /// The next output of a section that is settled.
    #[inline(always)]
    fn step(&mut self, sample: i32, saturated: &mut u32) -> i32 {
        let (own, cut) = self.own(&self.row, sample, saturated);
        let [x1, _, y1, _] = self.past;
        self.past = [sample, x1, own, y1];
        self.remainder = cut;
        own
    }

    /// The next output of one that is not. It is over when the offset has gone.
    #[inline(always)]
    fn step_over(&mut self, sample: i32, saturated: &mut u32) -> i32 {
        let own = if self.before.is_some() || !self.runs {
            self.begin(sample, saturated)
        } else {
            self.step(sample, saturated)
        };
        let output = own.saturating_add(self.offset);
        // Towards zero, ending there.
        self.offset -= (self.offset >> OFFSET_DECAY_SHIFT) + i32::from(self.offset > 0);
        self.settled = self.offset == 0;
        output
    }

    /// Begins at rest at the sample, which passes to the last bit; the offset takes up what the old integers
    /// make of it.
    #[inline(always)]
    fn begin(&mut self, sample: i32, saturated: &mut u32) -> i32 {
        if self.runs
            && let Some(before) = self.before
        {
            let (was, _) = self.own(&before, sample, saturated);
            self.offset = self.offset.saturating_add(was.saturating_sub(sample));
        }
        (self.past, self.remainder, self.runs, self.before) = ([sample; 4], 0, true, None);
        sample
    }

    /// Takes other integers at the next sample.
    fn set(&mut self, row: &SectionRow) {
        // Several changes between two ticks: the last output was made by the oldest one.
        self.before.get_or_insert(self.row);
        self.row = *row;
        self.settled = false;
    }

    /// Begins anew at the next sample.
    fn restart(&mut self) {
        (self.before, self.runs, self.offset, self.settled) = (None, false, 0, false);
    }
}

/// Two notches and a low-pass.
#[derive(Clone, Debug)]
pub struct SignalFilter {
    /// A bit for each section that is on.
    on: u8,
    sections: [Section; SECTIONS],
}

impl SignalFilter {
    /// Passes everything.
    pub const OFF: Self = Self {
        on: 0,
        sections: [Section::OFF; SECTIONS],
    };

    /// Whether it passes everything as it is.
    #[inline(always)]
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.on == 0
    }

    /// Begins again at rest, at the next sample.
    #[cold]
    #[inline(never)]
    pub fn restart(&mut self) {
        for (nth, section) in self.sections.iter_mut().enumerate() {
            section.restart();
            if section.row == PASSES {
                self.on &= !(1 << nth);
            }
        }
    }

    /// Gives a section other integers, whose gain at rest is one ([`PASSES`] switches it off). Call it
    /// between ticks.
    pub fn set(&mut self, place: Place, row: &SectionRow) {
        if let Some(section) = self.sections.get_mut(place as usize) {
            section.set(row);
            self.on |= 1 << place as usize;
        }
    }

    /// The next sample.
    #[inline(always)]
    pub fn step(&mut self, sample: i32, saturated: &mut u32) -> i32 {
        let mut signal = sample;
        for nth in 0..SECTIONS {
            match self.sections.get_mut(nth) {
                Some(section) if section.settled => signal = section.step(signal, saturated),
                Some(_) if self.on >> nth & 1 == 1 => {
                    signal = self.step_over(nth, signal, saturated)
                }
                _ => {}
            }
        }
        signal
    }

    /// The next output of a section that is not settled; one that passes everything is then off.
    #[cold]
    #[inline(never)]
    fn step_over(&mut self, nth: usize, sample: i32, saturated: &mut u32) -> i32 {
        let Some(section) = self.sections.get_mut(nth) else {
            return sample;
        };
        let output = section.step_over(sample, saturated);
        if section.settled && section.row == PASSES {
            section.restart();
            self.on &= !(1 << nth);
        }
        output
    }
}

/// The next samples of two signals, each through its filter.
// Not inlined: an instruction reaches the sections from the filters' own addresses only.
#[inline(never)]
pub(crate) fn step_both(
    a: &mut SignalFilter,
    b: &mut SignalFilter,
    of_a: i32,
    of_b: i32,
    saturated: &mut u32,
) -> (i32, i32) {
    (a.step(of_a, saturated), b.step(of_b, saturated))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::amplifier::{Amplifier, Mode};
    use crate::amplifier_command::Command;
    use crate::codes::SensorCode;
    use crate::filter_design::{FilterSetting, Notch};
    use crate::parameter_block::tests::example;
    use crate::reference_generator::Waveform;
    use crate::servo_parameters::{ActuatorParameters, LawParameters};
    use crate::signal::Micrometres;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn row(place: Place, setting: &FilterSetting) -> SectionRow {
        setting.row(place, 20_000).expect("within the limits")
    }

    fn setting() -> impl Strategy<Value = FilterSetting> {
        let notch = prop_oneof![
            1 => Just(Notch::OFF),
            3 => (10_000u32..9_000_000, 1_000u32..2_000_000).prop_map(|(frequency_millihertz, width_millihertz)| Notch {
                frequency_millihertz,
                width_millihertz
            }),
        ];
        let low_pass = prop_oneof![1 => Just(0u32), 3 => 10_000u32..9_000_000];
        (notch.clone(), notch, low_pass).prop_map(|(one, two, low_pass_millihertz)| FilterSetting {
            notches: [one, two],
            low_pass_millihertz,
        })
    }

    fn set_all(filter: &mut SignalFilter, setting: &FilterSetting) {
        for place in Place::ALL {
            filter.set(place, &row(place, setting));
        }
    }

    /// 5 um at so many Hz of 20 kHz.
    fn sine(hz: f64, tick: u32) -> i32 {
        ((f64::from(tick) * hz / 20_000.0 * core::f64::consts::TAU).sin()
            * 5.0
            * f64::from(1 << 24)) as i32
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Whatever the sections are and were, what rests passes to the last bit.
        #[test]
        fn what_rests_passes_to_the_last_bit(settings in prop::collection::vec(setting(), 1..5), sample in -(100i32 << 24)..100 << 24) {
            let (mut filter, mut saturated) = (SignalFilter::OFF, 0);
            for setting in settings {
                set_all(&mut filter, &setting);
                for _ in 0..50 {
                    prop_assert_eq!(filter.step(sample, &mut saturated), sample);
                }
            }
            prop_assert_eq!(saturated, 0);
        }

        /// The sample at which a section changes leaves as without the change; and the steps behind it are
        /// those of the two filters beside each other, and what the offset loses in a tick.
        #[test]
        fn a_change_in_motion_makes_no_step([old, new] in prop::array::uniform2(setting()), hz in 1.0f64..200.0, at in 100u32..4000) {
            let (mut filter, mut saturated) = (SignalFilter::OFF, 0);
            set_all(&mut filter, &old);
            for tick in 0..at {
                filter.step(sine(hz, tick), &mut saturated);
            }
            let mut unchanged = filter.clone();
            let last = filter.clone().step(sine(hz, at - 1), &mut saturated);
            for place in Place::ALL {
                filter.set(place, &row(place, &new));
            }
            prop_assert_eq!(filter.step(sine(hz, at), &mut saturated), unchanged.step(sine(hz, at), &mut saturated), "after {}", last);
        }

        /// Behind the change the signal goes over to the new filter without a jump, and ends on what the
        /// new filter alone gives. Step responses of three sections overshoot by at most a quarter, and the
        /// offset of their lag, some 70 ticks, loses another quarter of a step a tick: no step is twice the
        /// sine's largest.
        #[test]
        fn a_filter_goes_over_to_another_smoothly([old, new] in prop::array::uniform2(gentle()), hz in 1.0f64..50.0, at in 2000u32..6000) {
            let (mut filter, mut alone, mut saturated) = (SignalFilter::OFF, SignalFilter::OFF, 0);
            set_all(&mut filter, &old);
            set_all(&mut alone, &new);
            let mut outputs = Vec::new();
            for tick in 0..at + 8000 {
                if tick == at {
                    set_all(&mut filter, &new);
                }
                let sample = sine(hz, tick);
                outputs.push(filter.step(sample, &mut saturated));
                let reached = alone.step(sample, &mut saturated);
                if tick >= at + 7900 {
                    let differs = (outputs[tick as usize] - reached).abs();
                    prop_assert!(differs < 1 << 10, "{differs} of 2^-24 um at {tick}");
                }
            }
            let most = 2.0 * 5.0 * core::f64::consts::TAU * hz / 20_000.0 * f64::from(1 << 24);
            for pair in outputs[at as usize - 1..].windows(2) {
                prop_assert!(f64::from((pair[1] - pair[0]).abs()) < most, "{} um", f64::from(pair[1] - pair[0]) / f64::from(1 << 24));
            }
        }
    }

    /// Filters as they stand in front of a loop: notches from 300 Hz on, a low-pass from 200 Hz on.
    fn gentle() -> impl Strategy<Value = FilterSetting> {
        let notch = (300_000u32..3_000_000, 20_000u32..300_000).prop_map(
            |(frequency_millihertz, width_millihertz)| Notch {
                frequency_millihertz,
                width_millihertz,
            },
        );
        let notch = prop_oneof![1 => Just(Notch::OFF), 3 => notch];
        let low_pass = prop_oneof![1 => Just(0u32), 3 => 200_000u32..5_000_000];
        (notch.clone(), notch, low_pass).prop_map(|(one, two, low_pass_millihertz)| FilterSetting {
            notches: [one, two],
            low_pass_millihertz,
        })
    }

    /// A massless stage of 1/7 um/V in front of the example's regulator, which follows a sine of 2 um;
    /// filters of both signals change at `at`. Codes of every tick.
    fn closed_loop(
        old: [FilterSetting; 2],
        new: Option<[FilterSetting; 2]>,
        hz: f64,
        at: u32,
        ticks: u32,
    ) -> Vec<i64> {
        let mut parameters = example();
        parameters.guard.stuck_ticks = 0;
        parameters.servo.actuator = ActuatorParameters::Linear {
            volts_per_micrometre: 7 << 20,
            micrometres_per_volt: (1 << 28) / 7,
        };
        if let LawParameters::Regulator(law) = &mut parameters.servo.law {
            law.proportional_derivative.coefficients = [1 << 16, 0];
            law.integral = 1 << 21;
            law.notch.coefficients = PASSES.coefficients;
            law.feedforward.coefficients = [0; 16];
        }
        let mut amplifier = Amplifier::new(parameters);
        let tell = |amplifier: &mut Amplifier, filters: [FilterSetting; 2]| {
            for (signal, setting) in [FilteredSignal::SetPoint, FilteredSignal::Sensor]
                .into_iter()
                .zip(filters)
            {
                for place in Place::ALL {
                    assert_eq!(
                        amplifier.command(Command::Filter {
                            signal,
                            place,
                            row: row(place, &setting)
                        }),
                        Ok(())
                    );
                }
            }
        };
        tell(&mut amplifier, old);
        assert_eq!(amplifier.command(Command::Arm { tested: false }), Ok(()));
        assert_eq!(
            amplifier.command(Command::RequireConditioning(false)),
            Ok(())
        );
        let increment = (hz / 20_000.0 * 2f64.powi(32)) as u32;
        let none = (0, Micrometres::ZERO, 0);
        let waveform = Waveform::Multisine {
            tones: [(increment, Micrometres::from_num(2), 0), none, none, none],
        };
        assert_eq!(
            amplifier.command(Command::Reference {
                waveform,
                offset: Micrometres::from_num(5)
            }),
            Ok(())
        );
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        let (mut code, mut codes) = (amplifier.parameters().guard.rest_code, Vec::new());
        for tick in 0..ticks {
            if let Some(new) = new.filter(|_| tick == at) {
                tell(&mut amplifier, new);
            }
            let volts = f64::from(code) * 140.0 / 65_536.0 - 20.0;
            let reading = SensorCode::new(((volts / 7.0 + 1.0) / 15.0 * 65_536.0) as u32);
            code = amplifier.tick(Some(reading), false).dac_code;
            codes.push(i64::from(code));
        }
        assert_eq!(
            (
                amplifier.mode(),
                amplifier.servo().counters().saturated_values
            ),
            (Mode::Closed, 0),
            "{:?}",
            amplifier.fault()
        );
        codes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// In the closed loop, both filters at once: the code of the tick of the change is the one without
        /// it, and no later step is more than [`MOST_CODES`] larger than the largest one of the sine
        /// before.
        #[test]
        fn filters_change_in_the_closed_loop_without_a_step_of_the_drive(
            old in prop::array::uniform2(gentle()),
            new in prop::array::uniform2(gentle()),
            hz in 1.0f64..30.0,
            later in 0u32..4000,
        ) {
            let (at, ticks) = (24_000 + later, 32_000);
            let codes = closed_loop(old, Some(new), hz, at, ticks);
            let without = closed_loop(old, None, hz, at, at + 1);
            prop_assert_eq!(codes[at as usize], without[at as usize]);
            let largest = |codes: &[i64]| codes.windows(2).map(|pair| (pair[1] - pair[0]).abs()).max().unwrap_or(0);
            let (before, after) = (largest(&codes[4_000..at as usize]), largest(&codes[at as usize - 1..]));
            prop_assert!(after <= before + MOST_CODES, "{before} codes before, {after} behind it");
        }
    }

    /// Of 65,536 codes over 140 V: 68 mV, 10 nm of the stage. Of 4,000 drawn changes one took 29 codes, 99.6
    /// per cent took 16 or less.
    const MOST_CODES: i64 = 32;

    #[test]
    fn a_section_that_is_switched_off_costs_nothing_any_more() {
        let (mut filter, mut saturated) = (SignalFilter::OFF, 0);
        let notch = FilterSetting {
            low_pass_millihertz: 100_000,
            ..FilterSetting::OFF
        };
        filter.set(Place::LowPass, &row(Place::LowPass, &notch));
        for tick in 0..1000 {
            filter.step(sine(40.0, tick), &mut saturated);
        }
        assert_ne!(filter.on, 0);
        filter.set(Place::LowPass, &PASSES);
        for tick in 1000..7000 {
            filter.step(sine(40.0, tick), &mut saturated);
        }
        assert_eq!(
            (
                filter.on,
                filter.step(sine(40.0, 7000), &mut saturated),
                saturated
            ),
            (0, sine(40.0, 7000), 0)
        );
    }

    #[test]
    fn a_notch_takes_its_line_out_and_leaves_the_others() {
        let notch = Notch {
            frequency_millihertz: 735_000,
            width_millihertz: 50_000,
        };
        let setting = FilterSetting {
            notches: [notch, Notch::OFF],
            low_pass_millihertz: 0,
        };
        let amplitude = |hz: f64| {
            let (mut filter, mut saturated) = (SignalFilter::OFF, 0);
            set_all(&mut filter, &setting);
            let tail: Vec<i32> = (0..8000)
                .map(|tick| filter.step(sine(hz, tick), &mut saturated))
                .skip(6000)
                .collect();
            f64::from(tail.iter().map(|y| y.abs()).max().unwrap_or(0)) / f64::from(5 << 24)
        };
        assert!(amplitude(735.0) < 1e-3, "{}", amplitude(735.0));
        // At the edge of the width 3 dB.
        assert!(
            (amplitude(710.4) - std::f64::consts::FRAC_1_SQRT_2).abs() < 0.02,
            "{}",
            amplitude(710.4)
        );
        assert!(amplitude(100.0) > 0.99 && amplitude(3000.0) > 0.98);
    }
}
