//! Closes the output path: what the amplifier's voltage monitor reads is the drive that was written, or the
//! power stage goes off.
//!
//! # How it works
//! Amplifier and monitor follow the drive with a lag that nobody knows exactly. The board's safety envelope
//! names the longest time constant that they may have. Two bounds follow the drive: each goes to a drive
//! beyond it at once, and comes back from it with that time constant. An output with a first-order lag, of
//! any shorter time constant and from anywhere between the bounds, stays between them: where it lies at the
//! bound it moves towards the drive at least as fast as the bound does. A reading further than the
//! tolerance outside of them is a fault: wrong gain, a dead amplifier, a block for another amplifier.
//!
//! While the power stage is off the output decays as slowly as it likes and may only come nearer to rest: what
//! moves away from it by more than the tolerance is a fault. A relay that is welded shows so in the step that
//! arming makes without power ([`crate::self_test`]).
//!
//! A reading within [`MARGIN`] of the converter's ends is a cable that is open or shorted: the wiring keeps
//! honest ones away from them. While the power stage is off it is no fault: the amplifier may have no supply.

use crate::guard::Fault;
use crate::signal::{narrow, volts};

/// Codes of 65,536 at either end that no honest reading has: those of the sensor's guard.
pub const MARGIN: u16 = 16;
/// Fraction bits of [`MonitorParameters::decay`].
const DECAY_BITS: u32 = 31;

/// How the monitor is wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MonitorParameters {
    /// Drive at the monitor's code 0, V with 22 fraction bits.
    pub zero: i32,
    /// Drive per code of 65,536, V with 38 fraction bits.
    pub step: i64,
    /// Drive at rest, V with 22 fraction bits.
    pub rest: i32,
    /// Furthest that a reading may lie outside the bounds, V with 22 fraction bits.
    pub tolerance: i32,
    /// What a bound loses of its distance to the drive in a tick, with 31 fraction bits.
    pub decay: u32,
    /// Ticks behind the switching on of the power stage before the first reading counts: those of the
    /// self-test.
    pub settle_ticks: u32,
}

impl MonitorParameters {
    /// From the scale and the drive at rest in uV, the tolerance in mV and the longest time constant in us.
    #[must_use]
    pub fn new(
        at_code_0_uv: i32,
        span_uv: u32,
        rest_uv: i64,
        tolerance_mv: u16,
        lag_us: u32,
        sample_rate_hz: u32,
    ) -> Self {
        // 1 / (1 + lag in ticks), which is no more than 1 - exp(-1 / lag).
        let period = 1_000_000u64;
        let lag = u64::from(lag_us) * u64::from(sample_rate_hz);
        let decay = ((period << DECAY_BITS) / (period + lag)).min((1 << DECAY_BITS) - 1) as u32;
        Self {
            zero: microvolts(at_code_0_uv.into()),
            // uV over 65,536 codes.
            step: ((i128::from(span_uv) << 22) / 1_000_000) as i64,
            rest: microvolts(rest_uv),
            tolerance: volts(i32::from(tolerance_mv)),
            decay,
            settle_ticks: sample_rate_hz / 10,
        }
    }
}

/// V with 22 fraction bits; beyond 512 V the end of them.
fn microvolts(value: i64) -> i32 {
    ((value << 22) / 1_000_000).clamp(i32::MIN.into(), i32::MAX.into()) as i32
}

/// The monitor's past.
#[derive(Clone, Debug)]
pub struct OutputMonitor {
    parameters: MonitorParameters,
    lowest: i32,
    highest: i32,
    /// Ticks since the power stage was switched on, up to [`MonitorParameters::settle_ticks`].
    powered_ticks: u32,
}

impl OutputMonitor {
    /// With the power stage off.
    #[must_use]
    pub fn new(parameters: MonitorParameters) -> Self {
        Self {
            parameters,
            lowest: i32::MIN,
            highest: i32::MAX,
            powered_ticks: 0,
        }
    }

    /// Takes a tick: what the monitor read during the last period (`None`: its converter did not answer),
    /// and the drive that acts since the edge, V with 22 fraction bits. What is wrong.
    #[inline]
    pub fn inspect(&mut self, code: Option<u16>, drive: i32, powered: bool) -> Option<Fault> {
        if !powered {
            return self.judge_without_power(code);
        }
        if self.powered_ticks == 0 {
            (self.lowest, self.highest) = (drive, drive);
        }
        let fault = if self.powered_ticks < self.parameters.settle_ticks {
            self.powered_ticks += 1;
            None
        } else {
            self.judge(code)
        };
        // Rounded so that a bound comes back a little later.
        let lost = |distance: i64| (distance * i64::from(self.parameters.decay)) >> DECAY_BITS;
        self.highest = drive.max(narrow(
            i64::from(self.highest) - lost(i64::from(self.highest) - i64::from(drive)),
        ));
        self.lowest = drive.min(narrow(
            i64::from(self.lowest) + lost(i64::from(drive) - i64::from(self.lowest)),
        ));
        fault
    }

    /// The output that an honest code stands for.
    #[inline]
    fn read(&self, code: Option<u16>) -> Option<i32> {
        let code = code.filter(|code| (MARGIN..=u16::MAX - MARGIN).contains(code))?;
        let p = &self.parameters;
        Some(narrow(
            i64::from(p.zero) + ((i64::from(code) * p.step) >> 16),
        ))
    }

    /// Whether an output is further outside the bounds than the tolerance.
    #[inline]
    fn is_outside(&self, read: i32) -> bool {
        let tolerance = self.parameters.tolerance;
        read < self.lowest.saturating_sub(tolerance)
            || read > self.highest.saturating_add(tolerance)
    }

    #[inline]
    fn judge(&self, code: Option<u16>) -> Option<Fault> {
        let Some(read) = self.read(code) else {
            return Some(Fault::MonitorOutOfRange);
        };
        self.is_outside(read).then_some(Fault::OutputDiffers)
    }

    /// The output has come as near to rest as it was read, and may not go back.
    #[inline(never)]
    fn judge_without_power(&mut self, code: Option<u16>) -> Option<Fault> {
        // An amplifier without power gives 0 V, whatever rest is.
        let rest = self.parameters.rest;
        let (low, high) = (rest.min(0), rest.max(0));
        if self.powered_ticks > 0 {
            (self.lowest, self.highest) = (self.lowest.min(low), self.highest.max(high));
            self.powered_ticks = 0;
        }
        let read = self.read(code)?;
        let is_outside = self.is_outside(read);
        self.highest = self.highest.min(read.max(high));
        self.lowest = self.lowest.max(read.min(low));
        is_outside.then_some(Fault::OutputWhileOff)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// -30 to 150 V over 65,536 codes, 0.5 V, 2 ms.
    fn parameters() -> MonitorParameters {
        MonitorParameters::new(-30_000_000, 180_000_000, 0, 500, 2_000, 20_000)
    }

    fn code(volts: f64) -> Option<u16> {
        Some(
            ((volts + 30.0) / 180.0 * 65_536.0)
                .round()
                .clamp(0.0, 65_535.0) as u16,
        )
    }

    fn fixed(volts: f64) -> i32 {
        (volts * f64::from(1 << 22)) as i32
    }

    /// An amplifier in front of the monitor: its gain over the right one, its time constant, ms, and the
    /// drive.
    fn run(gain: f64, lag_ms: f64, drive: impl Fn(u32) -> f64, ticks: u32) -> Option<(u32, Fault)> {
        let mut monitor = OutputMonitor::new(parameters());
        let share = 1.0 - (-0.05 / lag_ms).exp();
        // Before the first tick: the drive rests.
        let mut output = gain * drive(0);
        monitor.inspect(None, fixed(drive(0)), false);
        for tick in 0..ticks {
            // Read during the last period, in which the drive of the tick before acted.
            if let Some(fault) = monitor.inspect(code(output), fixed(drive(tick)), true) {
                return Some((tick, fault));
            }
            output += share * (gain * drive(tick) - output);
        }
        None
    }

    fn steps(tick: u32) -> f64 {
        [10.0, 90.0, 40.0, 0.0, 120.0][(tick as usize / 700) % 5]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]

        #[test]
        fn an_amplifier_that_is_fast_enough_is_no_fault(lag_ms in 0.01f64..2.0, hz in 0.5f64..300.0) {
            prop_assert_eq!(run(1.0, lag_ms, steps, 20_000), None);
            let sine = |tick: u32| 50.0 + 45.0 * (f64::from(tick) * hz / 20_000.0 * core::f64::consts::TAU).sin();
            prop_assert_eq!(run(1.0, lag_ms, sine, 20_000), None);
        }
    }

    #[test]
    fn the_wiring_becomes_integers_of_its_units() {
        let expected = MonitorParameters {
            zero: -30 << 22,
            step: 180 << 22,
            rest: 5 << 22,
            tolerance: 1 << 21,
            // One of 41: 2 ms are 40 ticks.
            decay: ((1u64 << 31) / 41) as u32,
            settle_ticks: 2_000,
        };
        let made = MonitorParameters::new(-30_000_000, 180_000_000, 5_000_000, 500, 2_000, 20_000);
        assert_eq!(made, expected);
        // Without a lag a bound comes back at once, within its format.
        assert_eq!(
            MonitorParameters::new(0, 1, 0, 1, 0, 20_000).decay,
            (1 << 31) - 1
        );
        let beyond = MonitorParameters::new(0, 1, 600_000_000, 1, 0, 20_000);
        assert_eq!(beyond.rest, i32::MAX);
    }

    /// At each limit and one step beyond it, with bounds at 50 V and a tolerance of 0.5 V.
    #[test]
    fn limits_of_the_monitor_are_those_of_its_parameters() {
        let settled = |code: u16| {
            let mut monitor = OutputMonitor::new(parameters());
            (monitor.lowest, monitor.highest) = (fixed(50.0), fixed(50.0));
            monitor.powered_ticks = parameters().settle_ticks;
            monitor.inspect(Some(code), fixed(50.0), true)
        };
        let volts = |code: u16| f64::from(code) * 180.0 / 65_536.0 - 30.0;
        let highest = (0..u16::MAX).rfind(|code| volts(*code) <= 50.5).unwrap();
        let lowest = (0..u16::MAX).find(|code| volts(*code) >= 49.5).unwrap();
        for (code, expected) in [
            (lowest - 1, Some(Fault::OutputDiffers)),
            (lowest, None),
            (highest, None),
            (highest + 1, Some(Fault::OutputDiffers)),
            (MARGIN, Some(Fault::OutputDiffers)),
            (MARGIN - 1, Some(Fault::MonitorOutOfRange)),
            (u16::MAX - MARGIN, Some(Fault::OutputDiffers)),
            (u16::MAX - MARGIN + 1, Some(Fault::MonitorOutOfRange)),
        ] {
            assert_eq!(settled(code), expected, "{code}");
        }
        // The first reading that counts is the one behind the time of the self-test.
        let mut monitor = OutputMonitor::new(parameters());
        let first = (0..5_000).find(|_| monitor.inspect(None, 0, true).is_some());
        assert_eq!(first, Some(2_000));
    }

    #[test]
    fn a_bound_comes_back_by_its_share_in_a_tick_and_no_sooner() {
        let mut monitor = OutputMonitor::new(parameters());
        monitor.inspect(None, fixed(40.0), true);
        assert_eq!(
            (monitor.lowest, monitor.highest),
            (fixed(40.0), fixed(40.0))
        );
        // From 40 V down to 0 V: the lower bound at once, the upper one by a 41st of the way.
        monitor.inspect(None, 0, true);
        let left = f64::from(monitor.highest) / f64::from(fixed(40.0));
        assert_eq!(monitor.lowest, 0);
        assert!((left - 40.0 / 41.0).abs() < 1e-6, "{left}");
        // And up to 80 V: the upper one at once.
        monitor.inspect(None, fixed(80.0), true);
        let risen = f64::from(monitor.lowest) / f64::from(fixed(80.0));
        assert_eq!(monitor.highest, fixed(80.0));
        assert!((risen - 1.0 / 41.0).abs() < 1e-6, "{risen}");
    }

    /// Between 0 V and rest nothing is a fault, on either side of 0 V.
    #[test]
    fn an_amplifier_without_power_may_stand_between_rest_and_0_volts() {
        for rest_v in [20.0, -20.0] {
            let rest = MonitorParameters {
                rest: fixed(rest_v),
                ..parameters()
            };
            let read = |volts: &[f64]| {
                let mut monitor = OutputMonitor::new(rest);
                volts
                    .iter()
                    .find_map(|volts| monitor.inspect(code(*volts), fixed(rest_v), false))
            };
            let half = rest_v / 2.0;
            assert_eq!(read(&[half, 0.0, rest_v, half, 0.0, rest_v]), None);
            let away = Some(Fault::OutputWhileOff);
            assert_eq!(read(&[half, 1.05 * rest_v]), away);
            assert_eq!(read(&[half, -0.05 * rest_v]), away);
        }
    }

    #[test]
    fn what_is_wrong_with_the_output_is_named() {
        let ramp = |tick: u32| (f64::from(tick.saturating_sub(2500)) / 200.0).min(60.0);
        // 1.5 % too much is 0.5 V at 33 V; a dead amplifier is 0.5 V away at 0.5 V, and what the bound
        // allows of the ramp, 2 ms of 100 V/s.
        let differs = |gain: f64, lag_ms: f64| run(gain, lag_ms, ramp, 20_000);
        let (at, fault) = differs(1.015, 0.1).expect("wrong gain");
        assert!(
            fault == Fault::OutputDiffers && (32.0..35.5).contains(&ramp(at)),
            "{at} {fault:?}"
        );
        let (at, fault) = differs(0.0, 0.1).expect("dead");
        assert!(
            fault == Fault::OutputDiffers && ramp(at) < 0.8,
            "{at} {fault:?}"
        );
        assert_eq!(
            differs(10.0, 0.1).map(|(_, fault)| fault),
            Some(Fault::OutputDiffers)
        );
        // Ten times too slow: a block for a faster amplifier.
        assert_eq!(
            run(1.0, 20.0, steps, 20_000).map(|(_, fault)| fault),
            Some(Fault::OutputDiffers)
        );
        assert_eq!(differs(1.0, 0.1), None);
        // An open cable, behind the time that the relay has.
        let mut monitor = OutputMonitor::new(parameters());
        let faults = [Some(3), Some(65_530), None].map(|code| {
            monitor.powered_ticks = parameters().settle_ticks;
            monitor.inspect(code, 0, true)
        });
        assert_eq!(faults, [Some(Fault::MonitorOutOfRange); 3]);
        assert_eq!(
            monitor.inspect(None, 0, false),
            None,
            "the amplifier may have no supply"
        );
    }

    #[test]
    fn without_power_the_output_only_comes_nearer_to_rest() {
        // At the start the output of before decays, as slowly as it likes, to 0 V or to rest.
        let first_fault = |output: &dyn Fn(u32) -> f64| {
            let mut monitor = OutputMonitor::new(parameters());
            (0..20_000).find_map(|tick| {
                let fault = monitor.inspect(code(output(tick)), fixed(0.0), false)?;
                Some((tick, fault))
            })
        };
        let decays = |tick: u32| 80.0 * (-f64::from(tick) / 5_000.0).exp() - 0.2;
        assert_eq!(first_fault(&decays), None);
        let welded = |tick: u32| if tick < 300 { 0.1 } else { 1.5 };
        assert_eq!(
            first_fault(&welded),
            Some((300, Fault::OutputWhileOff)),
            "a step of the self-test"
        );
        let downwards = |tick: u32| decays(tick.min(5_000)) - f64::from(tick / 5_001) * 40.0;
        assert!(first_fault(&downwards).is_some(), "beyond rest");
        // Behind a drive of 80 V that is switched off: from the bounds of that drive on.
        let mut monitor = OutputMonitor::new(parameters());
        for _ in 0..3_000 {
            assert_eq!(monitor.inspect(code(80.0), fixed(80.0), true), None);
        }
        assert_eq!(monitor.inspect(code(79.0), fixed(80.0), false), None);
        assert_eq!(monitor.inspect(code(40.0), fixed(0.0), false), None);
        assert_eq!(
            monitor.inspect(code(41.0), fixed(0.0), false),
            Some(Fault::OutputWhileOff)
        );
    }
}
