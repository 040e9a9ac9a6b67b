//! The guard: decides at every tick whether the sensor and the loop can be trusted, and names the fault when
//! they cannot.
//!
//! # What is judged of the loop
//! The error is that of the reading as the converter gave it: a filter of the sensor hides nothing. A spell
//! of large errors ends only when the error has stayed within its limit for [`GuardParameters::tracking_ticks`]
//! in a row; a spell that lasts longer than that, with a large error at its end, is a fault. So whatever the
//! form of an error that exceeds its limit at least once in every so many ticks, the fault comes before
//! twice as many ticks have passed. A sinusoidal error of an amplitude of `sqrt(2)` limits does that, or
//! stays too large for that long at once, at every frequency.
//!
//! # How it works
//! [`Guard::inspect`] sees every reading. A fault latches: the amplifier ramps the drive to its rest value
//! and stays there until the fault is cleared, which is allowed only after the sensor was healthy for
//! [`GuardParameters::healthy_ticks`].
//!
//! | fault | when | safe output |
//! |---|---|---|
//! | sensor silent | the converter did not answer | ramp to rest |
//! | sensor out of range | code at or beyond the limits ("railed") | ramp to rest |
//! | sensor stuck | the same code for longer than noise allows | ramp to rest |
//! | sensor jump | two codes further apart than physics allows | ramp to rest |
//! | tracking error | larger than the limit for longer than allowed, or again and again | ramp to rest |
//! | loop swings | the drive turns and the reference does not ([`crate::swing_watch`]) | ramp to rest |
//! | drive slew | in most of so many ticks the law asked for more than the slew limit | ramp to rest |
//! | overrun | a tick was still running when the next was due | ramp to rest |
//! | emergency stop, interlock, amplifier not ready | open line to the board | ramp to rest, while open |
//! | host lost | the drive is live and no command came for longer than the host's timeout | ramp to rest |
//! | drive does not arrive | the drive's converter did not take a code | power off at once |
//! | sensor is noisy, or does not move | [`crate::self_test`], conditioning | ramp to rest |
//! | sensor moves against the drive | self-test, conditioning | ramp to rest |
//! | motion is not the model's | self-test, conditioning | ramp to rest |
//! | sensor drifts | self-test | ramp to rest |
//! | conditioning did not reach the whole range | at its end | rest |
//! | drive current | the drive's RMS slew is above that of [`crate::safety_envelope`] | ramp to rest |
//! | output is not the drive or moves while it is off, voltage monitor out of range | [`crate::output_monitor`] | power off at once |
//! | drive's converter holds another code | its register, read back | power off at once |
//! | part too hot | its temperature exceeds the board's limit | ramp to rest |
//! | analogue set point open | [`crate::set_point`], while it is followed | ramp to rest |
//! | stick-slip drive stalls, end of travel | [`crate::stepping`] | ramp to rest |
//! | parameter block, kept settings | at start | rest |
//! | watchdog, brown-out, hard fault, clock lost, supply low | at start, from the reset's cause | rest |

use crate::codes::{DriveCode, SensorCode};

/// What can be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Fault {
    /// The sensor's converter did not answer.
    SensorSilent = 1,
    /// The code is at or beyond the limits of the sensor.
    SensorOutOfRange = 2,
    /// The code has not changed for longer than noise allows.
    SensorStuck = 3,
    /// Two successive codes are further apart than physics allows.
    SensorJump = 4,
    /// The tracking error was too large for too long.
    TrackingError = 5,
    /// The law went on asking for larger steps of the drive than the amplifier's slew limit.
    DriveSlew = 6,
    /// A tick was late.
    Overrun = 7,
    /// No valid parameter block.
    ParameterBlock = 8,
    /// The watchdog restarted the target.
    Watchdog = 9,
    /// The supply had failed.
    BrownOut = 10,
    /// The processor had stopped on an error.
    HardFault = 11,
    /// The crystal had stopped.
    ClockLost = 12,
    /// The emergency stop is open.
    EmergencyStop = 13,
    /// The interlock is open.
    Interlock = 14,
    /// The amplifier says that it is not ready.
    AmplifierNotReady = 15,
    /// No command came for longer than the host had said.
    HostLost = 16,
    /// The part's supply had fallen below the level of the voltage detector.
    SupplyLow = 17,
    /// The drive's converter did not take a code.
    DriveSilent = 18,
    /// The drive changed and the sensor's reading did not.
    SensorDoesNotMove = 19,
    /// The reading fell when the drive rose.
    SensorReversed = 20,
    /// The stage moved much less, or much more, than its model says.
    GainDiffers = 21,
    /// The reading did not come back with the drive.
    SensorDrifts = 22,
    /// The reading has more noise than the motion that is looked for.
    SensorNoisy = 23,
    /// A conditioning ended before the drive reached both its limits.
    RangeNotReached = 24,
    /// The drive changed so much that the current into the actuator exceeds its limit, RMS.
    DriveCurrent = 25,
    /// A code left the board's safety envelope.
    BeyondEnvelope = 26,
    /// The board has no safety envelope.
    NoEnvelope = 27,
    /// The amplifier's voltage monitor reads another drive than the one that was written.
    OutputDiffers = 28,
    /// The voltage monitor's converter does not answer, or reads what an open or shorted cable gives.
    MonitorOutOfRange = 29,
    /// The register of the drive's converter holds another code than the one that was written.
    DriveNotHeld = 30,
    /// An image that was brought over the line did not become healthy, and the one before it was put back.
    UpdateRolledBack = 31,
    /// The drive of the closed loop swings, and the reference does not.
    LoopSwings = 32,
    /// What the operator kept is damaged, or of another version or sampling rate.
    KeptSettings = 33,
    /// The amplifier's output moves away from rest while its power stage is switched off.
    OutputWhileOff = 34,
    /// The part is hotter than it may be.
    PartTooHot = 35,
    /// The analogue set point that is followed is open or shorted, or its converter does not answer.
    SetPointOpen = 36,
    /// The amplifier is hotter than it may be, or its temperature is not read.
    AmplifierTooHot = 37,
    /// Teeth of a stick-slip drive bring no travel: too much load, too little friction, something jams.
    Stalled = 38,
    /// The slider of a stick-slip drive is at an end of its travel.
    EndOfTravel = 39,
}

impl Fault {
    /// Every fault with its name.
    pub const ALL: [(Self, &'static str); 39] = [
        (Self::SensorSilent, "sensor silent"),
        (Self::SensorOutOfRange, "sensor out of range"),
        (Self::SensorStuck, "sensor stuck"),
        (Self::SensorJump, "sensor jump"),
        (Self::TrackingError, "tracking error"),
        (Self::DriveSlew, "drive slew"),
        (Self::Overrun, "overrun"),
        (Self::ParameterBlock, "parameter block"),
        (Self::Watchdog, "watchdog"),
        (Self::BrownOut, "brown-out"),
        (Self::HardFault, "hard fault"),
        (Self::ClockLost, "clock lost"),
        (Self::EmergencyStop, "emergency stop"),
        (Self::Interlock, "interlock"),
        (Self::AmplifierNotReady, "amplifier not ready"),
        (Self::HostLost, "host lost"),
        (Self::SupplyLow, "supply low"),
        (Self::DriveSilent, "drive does not arrive"),
        (
            Self::SensorDoesNotMove,
            "sensor does not move with the drive",
        ),
        (Self::SensorReversed, "sensor moves against the drive"),
        (Self::GainDiffers, "motion is not the model's"),
        (Self::SensorDrifts, "sensor drifts"),
        (
            Self::SensorNoisy,
            "sensor is noisier than the step of the self-test",
        ),
        (
            Self::RangeNotReached,
            "conditioning did not reach the whole range",
        ),
        (Self::DriveCurrent, "drive current"),
        (Self::BeyondEnvelope, "drive beyond the safety envelope"),
        (Self::NoEnvelope, "no safety envelope"),
        (
            Self::OutputDiffers,
            "output of the amplifier is not the drive",
        ),
        (Self::MonitorOutOfRange, "voltage monitor out of range"),
        (Self::DriveNotHeld, "drive's converter holds another code"),
        (Self::UpdateRolledBack, "update rolled back"),
        (Self::LoopSwings, "loop swings"),
        (
            Self::KeptSettings,
            "kept settings are damaged or of another version",
        ),
        (
            Self::OutputWhileOff,
            "output of the amplifier moves while it is switched off",
        ),
        (Self::PartTooHot, "part too hot"),
        (Self::SetPointOpen, "analogue set point open"),
        (
            Self::AmplifierTooHot,
            "amplifier too hot, or its temperature not read",
        ),
        (Self::Stalled, "stalled"),
        (Self::EndOfTravel, "end of travel"),
    ];

    /// Whether the drive that acts is not the one that was written: a ramp to rest would not arrive, and the
    /// power stage goes off at once.
    #[inline]
    #[must_use]
    pub fn is_of_output(self) -> bool {
        matches!(
            self,
            Self::OutputDiffers
                | Self::OutputWhileOff
                | Self::MonitorOutOfRange
                | Self::DriveNotHeld
                | Self::DriveSilent
        )
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(fault, _)| *fault == self)
            .map_or("", |(_, name)| name)
    }

    /// The fault with a number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL
            .iter()
            .find(|(fault, _)| *fault as u8 == number)
            .map(|(fault, _)| *fault)
    }
}

/// Limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GuardParameters {
    /// Lowest code that the sensor can honestly give.
    pub adc_code_min: SensorCode,
    /// Highest one.
    pub adc_code_max: SensorCode,
    /// Ticks of the same code that mean a stuck sensor; 0 switches the check off (a noiseless sensor).
    pub stuck_ticks: u16,
    /// Largest honest change from tick to tick, codes.
    pub jump_codes: u32,
    /// Largest tracking error, um with 24 fraction bits.
    pub tracking_error: i32,
    /// Ticks for which it may be larger, or for which the law may want more than the slew limit; so long it
    /// must have been smaller before it may be larger again.
    pub tracking_ticks: u16,
    /// Change of the drive in one tick on the way to rest, codes.
    pub ramp_codes: u32,
    /// Drive code of rest.
    pub rest_code: DriveCode,
    /// Ticks of a healthy sensor before a fault can be cleared.
    pub healthy_ticks: u16,
}

/// The guard with its memory.
#[derive(Clone, Debug)]
pub struct Guard {
    parameters: GuardParameters,
    last_code: Option<SensorCode>,
    same: u16,
    /// Ticks since the tracking error exceeded its limit, and for how many it has been within it since.
    late: u32,
    within: u16,
    /// Ticks in which the law wanted more than the slew limit, less those in which it did not.
    slewing: u32,
    healthy: u16,
}

impl Guard {
    /// Has seen nothing yet.
    #[must_use]
    pub fn new(parameters: GuardParameters) -> Self {
        Self {
            parameters,
            last_code: None,
            same: 0,
            late: 0,
            within: 0,
            slewing: 0,
            healthy: 0,
        }
    }

    /// Watches with other limits from now on; what it has seen and counted stays.
    pub fn watch_with(&mut self, parameters: GuardParameters) {
        self.parameters = parameters;
    }

    /// The limits.
    #[must_use]
    pub fn parameters(&self) -> &GuardParameters {
        &self.parameters
    }

    /// Looks at a reading; `None` if the converter did not answer.
    #[inline]
    pub fn inspect(&mut self, reading: Option<SensorCode>) -> Option<Fault> {
        let fault = self.sensor_fault(reading);
        self.last_code = reading;
        self.healthy = if fault.is_some() {
            0
        } else {
            self.healthy.saturating_add(1)
        };
        fault
    }

    #[inline]
    fn sensor_fault(&mut self, reading: Option<SensorCode>) -> Option<Fault> {
        let p = &self.parameters;
        let Some(code) = reading else {
            return Some(Fault::SensorSilent);
        };
        if code < p.adc_code_min || code > p.adc_code_max {
            return Some(Fault::SensorOutOfRange);
        }
        let last = self.last_code?;
        self.same = if code == last {
            self.same.saturating_add(1)
        } else {
            0
        };
        if p.stuck_ticks > 0 && self.same >= p.stuck_ticks {
            return Some(Fault::SensorStuck);
        }
        (code.abs_diff(last) > p.jump_codes).then_some(Fault::SensorJump)
    }

    /// The sensor's codes mean other positions from now on: that of the last reading is this one.
    pub fn move_last_code(&mut self, code: SensorCode) {
        self.last_code = self.last_code.map(|_| code);
    }

    /// The last reading; `None` if the converter did not answer, or before the first.
    #[must_use]
    pub fn last_code(&self) -> Option<SensorCode> {
        self.last_code
    }

    /// The loop is closed anew: what was counted of the last one is forgotten.
    pub fn begin_loop(&mut self) {
        (self.late, self.within, self.slewing) = (0, 0, 0);
    }

    /// Looks at the loop: error (um with 24 fraction bits), and whether the law wanted more than the slew
    /// limit.
    #[inline]
    pub fn inspect_loop(&mut self, error: i32, slewing: bool) -> Option<Fault> {
        let p = &self.parameters;
        self.slewing = if slewing {
            self.slewing.saturating_add(1)
        } else {
            self.slewing.saturating_sub(1)
        };
        if self.slewing > u32::from(p.tracking_ticks) {
            self.slewing = 0;
            return Some(Fault::DriveSlew);
        }
        let large = error.saturating_abs() > p.tracking_error;
        if large {
            self.within = 0;
        } else if self.late == 0 || self.within >= p.tracking_ticks {
            self.late = 0;
            return None;
        } else {
            self.within += 1;
        }
        self.late = self.late.saturating_add(1);
        (large && self.late > u32::from(p.tracking_ticks)).then_some(Fault::TrackingError)
    }

    /// Whether the sensor was healthy long enough to clear a fault.
    #[must_use]
    pub fn healthy(&self) -> bool {
        self.healthy >= self.parameters.healthy_ticks
    }

    /// The next code on the way to rest.
    #[inline]
    #[must_use]
    pub fn towards_rest(&self, code: DriveCode) -> DriveCode {
        self.towards(code, self.parameters.rest_code)
    }

    /// The next code on the way to another, as fast as to rest.
    #[inline]
    #[must_use]
    pub fn towards(&self, code: DriveCode, aim: DriveCode) -> DriveCode {
        let ramp = self.parameters.ramp_codes.max(1);
        if code > aim {
            (code - ramp).max(aim)
        } else {
            (code + ramp).min(aim)
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    const PARAMETERS: GuardParameters = GuardParameters {
        adc_code_min: SensorCode::new(16),
        adc_code_max: SensorCode::new(65_519),
        stuck_ticks: 10,
        jump_codes: 3000,
        tracking_error: 1 << 24,
        tracking_ticks: 5,
        ramp_codes: 100,
        rest_code: DriveCode::new(9362),
        healthy_ticks: 20,
    };

    #[test]
    fn each_sensor_fault_has_its_name() {
        let after = |codes: &[Option<u32>]| {
            let mut guard = Guard::new(PARAMETERS);
            codes
                .iter()
                .find_map(|code| guard.inspect(code.map(SensorCode::new)))
        };
        assert_eq!(after(&[Some(5000), Some(5001), Some(4999)]), None);
        assert_eq!(after(&[Some(5000), None]), Some(Fault::SensorSilent));
        assert_eq!(
            after(&[Some(5000), Some(65_535)]),
            Some(Fault::SensorOutOfRange)
        );
        assert_eq!(after(&[Some(5000), Some(9000)]), Some(Fault::SensorJump));
        assert_eq!(after(&[Some(5000); 11]), Some(Fault::SensorStuck));
        assert_eq!(after(&[Some(5000); 10]), None);
    }

    /// At each limit and one step beyond it.
    #[test]
    fn limits_of_the_sensor_are_those_of_the_parameters() {
        let after = |codes: &[u32]| {
            let mut guard = Guard::new(PARAMETERS);
            codes
                .iter()
                .find_map(|code| guard.inspect(Some(SensorCode::new(*code))))
        };
        for (codes, expected) in [
            (&[16, 17][..], None),
            (&[15], Some(Fault::SensorOutOfRange)),
            (&[14], Some(Fault::SensorOutOfRange)),
            (&[65_519, 65_518], None),
            (&[65_520], Some(Fault::SensorOutOfRange)),
            (&[65_521], Some(Fault::SensorOutOfRange)),
            (&[5000, 8000], None),
            (&[5000, 8001], Some(Fault::SensorJump)),
            (&[8001, 5000], Some(Fault::SensorJump)),
        ] {
            assert_eq!(after(codes), expected, "{codes:?}");
        }
        // A sensor that moves once in a while is not stuck; a check that is off finds nothing.
        let mut guard = Guard::new(PARAMETERS);
        let moves = |tick: u32| Some(SensorCode::new(5000 + tick / 10 % 2));
        assert!((0..100).all(|tick| guard.inspect(moves(tick)).is_none()));
        guard.watch_with(GuardParameters {
            stuck_ticks: 0,
            ..PARAMETERS
        });
        assert_eq!(guard.parameters().stuck_ticks, 0);
        assert!((0..100).all(|_| guard.inspect(moves(0)).is_none()));
        assert_eq!(guard.last_code(), moves(0));
    }

    #[test]
    fn a_sensor_is_healthy_after_its_time_without_a_fault() {
        let mut guard = Guard::new(PARAMETERS);
        let mut read = |tick: u32| {
            guard.inspect((tick != 30).then(|| SensorCode::new(5000 + tick % 2)));
            guard.healthy()
        };
        let healthy: std::vec::Vec<u32> = (0..60).filter(|tick| read(*tick)).collect();
        let expected: std::vec::Vec<u32> = (19..30).chain(50..60).collect();
        assert_eq!(healthy, expected);
    }

    #[test]
    fn a_new_loop_forgets_what_the_last_one_counted() {
        let mut guard = in_state(5, 5, 3, 5);
        guard.begin_loop();
        assert_eq!((guard.late, guard.within, guard.slewing), (0, 0, 0));
    }

    #[test]
    fn faults_of_the_output_are_those_behind_the_converter() {
        let of_output = [
            Fault::DriveSilent,
            Fault::OutputDiffers,
            Fault::MonitorOutOfRange,
            Fault::DriveNotHeld,
            Fault::OutputWhileOff,
        ];
        for (fault, name) in Fault::ALL {
            assert_eq!(fault.is_of_output(), of_output.contains(&fault), "{name}");
        }
    }

    #[test]
    fn the_loop_is_watched() {
        let mut guard = Guard::new(PARAMETERS);
        let first = (1..20).find(|k| guard.inspect_loop(0, k % 3 != 0) == Some(Fault::DriveSlew));
        assert_eq!(first, Some(14), "two ticks of three");
        assert!(
            (0..100).all(|k| guard.inspect_loop(0, k % 2 == 0).is_none()),
            "now and then"
        );
        let first =
            (1..20).find(|_| guard.inspect_loop(-(2 << 24), false) == Some(Fault::TrackingError));
        assert_eq!(first, Some(6));
        assert_eq!(guard.inspect_loop(0, false), None);
    }

    proptest! {
        /// A sinusoidal error of any frequency whose RMS exceeds the limit is a fault.
        #[test]
        fn a_sine_above_the_limit_is_a_fault_at_every_frequency(
            hz in 0.5f64..9_900.0,
            more in 1.02f64..20.0,
            phase in 0.0f64..7.0,
        ) {
            let mut guard = Guard::new(GuardParameters { tracking_ticks: 100, ..PARAMETERS });
            let amplitude = more * 2f64.sqrt() * f64::from(1 << 24);
            let found = (0..60_000u32).any(|k| {
                let angle = std::f64::consts::TAU * hz * f64::from(k) / 20_000.0 + phase;
                guard.inspect_loop((amplitude * angle.sin()) as i32, false).is_some()
            });
            prop_assert!(found);
        }

        /// One spell within `tracking_ticks`, and then as many ticks within the limit, is not a fault.
        #[test]
        fn a_short_spell_is_no_fault(ticks in 1u16..400, spell in prop::collection::vec(any::<bool>(), 400)) {
            let mut guard = Guard::new(GuardParameters { tracking_ticks: ticks, ..PARAMETERS });
            for _ in 0..5 {
                for large in &spell[..usize::from(ticks)] {
                    let error = if *large { 2 << 24 } else { 0 };
                    prop_assert_eq!(guard.inspect_loop(error, false), None);
                }
                for _ in 0..=ticks {
                    prop_assert_eq!(guard.inspect_loop(0, false), None);
                }
            }
        }
    }

    /// The guard of a loop in any state, with any limit of the time.
    fn in_state(tracking_ticks: u16, late: u32, within: u16, slewing: u32) -> Guard {
        let parameters = GuardParameters {
            tracking_ticks,
            ..PARAMETERS
        };
        Guard {
            late,
            within,
            slewing,
            ..Guard::new(parameters)
        }
    }

    /// One tick from every state, for every limit of the time: what it counts, and when it is a fault. The
    /// tick compares its counters with 0 and with that limit, so numbers beside these stand for all others.
    #[test]
    fn a_tick_of_the_guard_counts_and_trips_as_specified() {
        let limit = PARAMETERS.tracking_error;
        let errors = [i32::MIN, -limit - 1, -limit, 0, limit, limit + 1, i32::MAX];
        for ticks in 0..=u16::MAX {
            let beside = |n: u32| [0, 1, n.saturating_sub(1), n, n + 1, u32::MAX];
            for (late, within) in beside(ticks.into()).into_iter().flat_map(|late| {
                [0, 1, ticks.saturating_sub(1), ticks].map(|within| (late, within))
            }) {
                for error in errors {
                    let large = error.saturating_abs() > limit;
                    let mut guard = in_state(ticks, late, within, 0);
                    let fault = guard.inspect_loop(error, false);
                    let ended = !large && (late == 0 || within >= ticks);
                    let counted = if ended { 0 } else { late.saturating_add(1) };
                    let trips = large && counted > u32::from(ticks);
                    assert_eq!(fault, trips.then_some(Fault::TrackingError));
                    assert_eq!(guard.late, counted, "{ticks} {late} {within} {error}");
                    if !ended {
                        assert_eq!(guard.within, if large { 0 } else { within + 1 });
                    }
                }
            }
            for (slewing, wants) in beside(ticks.into())
                .into_iter()
                .flat_map(|n| [(n, true), (n, false)])
            {
                let mut guard = in_state(ticks, 0, 0, slewing);
                let fault = guard.inspect_loop(0, wants);
                let counted = if wants {
                    slewing.saturating_add(1)
                } else {
                    slewing.saturating_sub(1)
                };
                let trips = counted > u32::from(ticks);
                assert_eq!(
                    fault,
                    trips.then_some(Fault::DriveSlew),
                    "{ticks} {slewing}"
                );
                assert_eq!(guard.slewing, if trips { 0 } else { counted });
            }
        }
    }

    /// Every error that exceeds its limit at least once in every `tracking_ticks` ticks, of whatever form and
    /// sign, is a fault before twice as many ticks have passed: all of its sequences are tried at once, as the
    /// set of states in which they leave the guard.
    #[test]
    fn an_error_that_comes_again_and_again_is_a_fault() {
        for ticks in 1u16..=400 {
            let mut states = BTreeSet::from([(0, 0)]);
            for tick in 0.. {
                let mut next = BTreeSet::new();
                for (late, within) in &states {
                    for large in [true, false] {
                        // The first is large, and between two large ones are fewer small ones than that.
                        if !large && (tick == 0 || within + 1 == ticks) {
                            continue;
                        }
                        let mut guard = in_state(ticks, *late, *within, 0);
                        let error = if large { 2 << 24 } else { 0 };
                        if guard.inspect_loop(error, false).is_none() {
                            next.insert((guard.late, guard.within));
                        }
                    }
                }
                states = next;
                if states.is_empty() {
                    assert!(tick < 2 * u32::from(ticks), "{ticks}: {tick}");
                    break;
                }
            }
        }
    }

    /// From every code to every aim, of 6 bits and at the ends of 20.
    #[test]
    fn a_way_to_rest_is_no_faster_than_its_ramp_and_does_not_turn() {
        let step = |code: u32, aim: u32, ramp_codes: u32| {
            let guard = Guard::new(GuardParameters {
                ramp_codes,
                ..PARAMETERS
            });
            let next = guard
                .towards(DriveCode::new(code), DriveCode::new(aim))
                .steps();
            let way = code.abs_diff(aim).saturating_sub(ramp_codes.max(1));
            assert!(
                next.abs_diff(code) <= ramp_codes.max(1) && next.abs_diff(aim) == way,
                "{code} to {aim} by {ramp_codes}: {next}"
            );
        };
        for (code, aim) in (0..64).flat_map(|code| (0..64).map(move |aim| (code, aim))) {
            (0..64).for_each(|ramp| step(code, aim, ramp));
        }
        let most = DriveCode::MOST.steps();
        for (code, aim) in [
            (0, most),
            (most, 0),
            (1, most - 1),
            (most - 1, 1),
            (most, most),
        ] {
            for ramp in [0, 1, most / 2, most - 1, most] {
                step(code, aim, ramp);
            }
        }
    }

    #[test]
    fn rest_is_reached_from_both_sides_and_kept() {
        let guard = Guard::new(PARAMETERS);
        for start in [0u32, 9300, 9362, 20_000, 65_535] {
            let mut code = DriveCode::new(start);
            for _ in 0..600 {
                let next = guard.towards_rest(code);
                assert!(next.abs_diff(code) <= 100);
                code = next;
            }
            assert_eq!(code, DriveCode::new(9362));
        }
    }

    #[test]
    fn numbers_and_faults_correspond() {
        for (fault, name) in Fault::ALL {
            assert_eq!(Fault::from_number(fault as u8), Some(fault));
            assert_eq!(fault.name(), name);
        }
        assert_eq!(Fault::from_number(0), None);
    }
}
