//! The self-test of arming: does the drive move the sensor, in the right direction, as far as the model says,
//! and back again?
//!
//! # How it works
//! The drive goes from rest to a step of [`STEP_MILLIVOLTS`] and back, no faster than the ramp to rest. At
//! each of the three places it waits for a tenth of a second, for relays, creep and ringing, and then takes
//! the mean of [`MEAN_TICKS`] readings. What the model of the actuator makes of the same codes is the motion
//! that is expected; a law that works in volts has no such model, and its gain is not looked at.
//!
//! Where the amplifier's output is read, the same step comes first with the power stage still off. An output
//! that follows it is that of a relay that is welded ([`crate::output_monitor`]).
//!
//! | fault | when |
//! |---|---|
//! | sensor is noisier than a step of the self-test | noise, peak to peak, exceeds the expected motion |
//! | sensor does not move with the drive | the motion is less than the readings at rest have, peak to peak |
//! | sensor moves against the drive | the motion has the other sign |
//! | motion is not the model's | the motion is not within [`GAIN_BAND`] of what is expected |
//! | sensor drifts | more than a quarter of the motion stays behind the step |

use crate::codes::{DriveCode, SensorCode};
use crate::guard::Fault;
use crate::parameter_block::AmplifierParameters;
use crate::servo_parameters::ActuatorParameters;

/// Height of the step.
pub const STEP_MILLIVOLTS: i64 = 1_500;
/// Readings of a mean.
pub const MEAN_TICKS: u32 = 1 << MEAN_SHIFT;
const MEAN_SHIFT: u32 = 10;
/// The least and the most that the motion may be of what the model expects, sixteenths: just more than half
/// of it and just less than twice it, because a range switch of sensor or amplifier that stands wrong changes
/// it by a factor of two or more.
pub const GAIN_BAND: (i64, i64) = (9, 29);

/// What the sensor and the model said at two drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Motion {
    /// Change of the reading, codes times [`MEAN_TICKS`], for a change of the drive upwards.
    pub measured: i64,
    /// Change of the model's displacement, um with 24 fraction bits; `None` without a model.
    pub expected: Option<i32>,
    /// Readings at rest from the lowest to the highest, codes.
    pub noise_codes: u32,
    /// Position per code of the sensor, um with 40 fraction bits.
    pub adc_step: i64,
}

impl Motion {
    /// Whether the sensor moved with the drive, as far as the model says.
    ///
    /// # Errors
    /// What is wrong.
    pub fn judge(&self) -> Result<(), Fault> {
        // um per code (40) times codes (10) -> um (24).
        let micrometres = |codes: i64| codes.saturating_mul(self.adc_step) >> (16 + MEAN_SHIFT);
        let noise = i64::from(self.noise_codes) << MEAN_SHIFT;
        let expected = self.expected.map(i64::from);
        if expected.is_some_and(|expected| micrometres(noise) > expected.abs()) {
            return Err(Fault::SensorNoisy);
        }
        if self.measured.abs() <= noise {
            return Err(Fault::SensorDoesNotMove);
        }
        if self.measured < 0 {
            return Err(Fault::SensorReversed);
        }
        let motion = micrometres(self.measured);
        let (least, most) = GAIN_BAND;
        match expected {
            Some(expected) if 16 * motion < least * expected || 16 * motion > most * expected => {
                Err(Fault::GainDiffers)
            }
            _ => Ok(()),
        }
    }
}

/// The least and the highest of some readings.
#[derive(Clone, Copy, Debug)]
pub struct Extremes {
    lowest: SensorCode,
    highest: SensorCode,
}

impl Extremes {
    /// Of none.
    pub const NONE: Self = Self {
        lowest: SensorCode::MOST,
        highest: SensorCode::new(0),
    };

    /// Takes another one.
    #[inline]
    pub fn take(&mut self, reading: SensorCode) {
        self.lowest = self.lowest.min(reading);
        self.highest = self.highest.max(reading);
    }

    /// From one to the other, codes.
    #[must_use]
    pub fn peak_to_peak(&self) -> u32 {
        self.highest.steps().saturating_sub(self.lowest.steps())
    }
}

/// Whether what the model of an actuator applies is a displacement.
#[must_use]
pub fn has_model(actuator: &ActuatorParameters) -> bool {
    !matches!(actuator, ActuatorParameters::Direct)
}

/// The self-test as far as it has come.
#[derive(Clone, Debug)]
pub struct SelfTest {
    /// Rest and the step; the third place is rest again.
    places: [DriveCode; 2],
    upwards: bool,
    has_model: bool,
    adc_step: i64,
    settle_ticks: u32,
    /// Steps and ways back that are left without power.
    unpowered: u8,
    place: usize,
    ticks: u32,
    sums: [i64; 3],
    applied: [i32; 3],
    noise: Extremes,
}

impl SelfTest {
    /// At its beginning, the drive at rest; behind a step without power, or not.
    #[must_use]
    pub fn new(parameters: &AmplifierParameters, begins_without_power: bool) -> Self {
        let (c, rest) = (&parameters.servo.converters, parameters.guard.rest_code);
        // codes per V (16) times mV
        let step = ((i64::from(c.dac_codes_per_volt) * STEP_MILLIVOLTS / 1000) >> 16).max(1) as u32;
        let upwards = c.dac_code_max.abs_diff(rest) >= c.dac_code_min.abs_diff(rest);
        let stepped = if upwards {
            (rest + step).min(c.dac_code_max)
        } else {
            (rest - step).max(c.dac_code_min)
        };
        Self {
            places: [rest, stepped],
            upwards,
            has_model: has_model(&parameters.servo.actuator),
            adc_step: c.adc_step,
            settle_ticks: parameters.physical.sample_rate_hz / 10,
            unpowered: if begins_without_power { 2 } else { 0 },
            place: 0,
            ticks: 0,
            sums: [0; 3],
            applied: [0; 3],
            noise: Extremes::NONE,
        }
    }

    /// Where the drive goes next.
    #[inline]
    #[must_use]
    pub fn aim(&self) -> DriveCode {
        let is_stepped = self.place == 1 || self.unpowered == 2;
        self.places[usize::from(is_stepped)]
    }

    /// Whether the power stage is to be on.
    #[inline]
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.unpowered == 0
    }

    /// Takes a reading; `arrived`: the drive is where it was sent, which the model takes for the displacement
    /// `applied`. What comes out of it, at the end.
    #[inline]
    pub fn take(
        &mut self,
        reading: SensorCode,
        arrived: bool,
        applied: i32,
    ) -> Option<Result<(), Fault>> {
        if !arrived {
            return None;
        }
        self.ticks += 1;
        if self.ticks <= self.settle_ticks {
            return None;
        }
        if self.unpowered > 0 {
            (self.unpowered, self.ticks) = (self.unpowered - 1, 0);
            return None;
        }
        let place = self.place.min(2);
        self.sums[place] += i64::from(reading);
        self.applied[place] = applied;
        if place == 0 {
            self.noise.take(reading);
        }
        if self.ticks < self.settle_ticks + MEAN_TICKS {
            return None;
        }
        self.ticks = 0;
        self.place = place + 1;
        (place == 2).then(|| self.verdict())
    }

    /// What the step did.
    #[must_use]
    pub fn motion(&self) -> Motion {
        let sign = if self.upwards { 1 } else { -1 };
        let [rest, stepped, _] = self.applied;
        let expected = stepped.saturating_sub(rest);
        Motion {
            measured: sign * (self.sums[1] - self.sums[0]),
            expected: self.has_model.then_some(if self.upwards {
                expected
            } else {
                expected.saturating_neg()
            }),
            noise_codes: self.noise.peak_to_peak(),
            adc_step: self.adc_step,
        }
    }

    fn verdict(&self) -> Result<(), Fault> {
        let motion = self.motion();
        motion.judge()?;
        let stays = self.sums[2] - self.sums[0];
        if 4 * stays.abs() > motion.measured {
            Err(Fault::SensorDrifts)
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter_block::tests::example;

    /// A sensor that is made of the drive's code and of the tick.
    fn run(sensor: impl Fn(i64, u32) -> i64) -> (Result<(), Fault>, Motion) {
        let parameters = example();
        let c = parameters.servo.converters;
        let mut test = SelfTest::new(&parameters, false);
        let mut code = parameters.guard.rest_code;
        for tick in 0.. {
            assert!(tick < 20_000, "it ends");
            let aim = test.aim();
            code = if code < aim {
                (code + 40).min(aim)
            } else {
                (code - 40).max(aim)
            };
            let applied = ((i64::from(c.drive(code)) * i64::from((1 << 28) / 7)) >> 26) as i32;
            let reading = sensor(
                i64::from(code) - i64::from(parameters.guard.rest_code),
                tick,
            )
            .clamp(0, 65_535);
            if let Some(verdict) = test.take(SensorCode::new(reading as u32), code == aim, applied)
            {
                return (verdict, test.motion());
            }
        }
        unreachable!()
    }

    /// 140 V and 15 um over 65,536 codes each, 7 V/um: 4/3 codes of the sensor for a code of the drive.
    fn honest(code: i64) -> i64 {
        5000 + code * 4 / 3
    }

    fn noise(tick: u32, codes: u32) -> i64 {
        (i64::from(tick.wrapping_mul(2_654_435_761) >> 16) * i64::from(codes)) >> 16
    }

    #[test]
    fn an_honest_stage_passes() {
        let (verdict, motion) = run(|code, tick| honest(code) + noise(tick, 40));
        assert_eq!(verdict, Ok(()));
        let micrometres = motion.measured as f64 / 1024.0 * 15.0 / 65_536.0;
        assert!((micrometres - 1.5 / 7.0).abs() < 2e-3, "{micrometres}");
        assert!(
            (f64::from(motion.expected.expect("a model")) / 2f64.powi(24) - micrometres).abs()
                < 2e-3
        );
    }

    #[test]
    fn the_step_without_power_ends_at_rest() {
        let parameters = example();
        let (rest, mut test) = (parameters.guard.rest_code, SelfTest::new(&parameters, true));
        let (mut code, mut highest, mut ticks) = (rest, rest, 0);
        while !test.is_powered() {
            let aim = test.aim();
            code = (code + 40).min(aim).max(code - 40);
            highest = highest.max(code);
            ticks += 1;
            assert_eq!(test.take(SensorCode::new(5_000), code == aim, 0), None);
        }
        assert_eq!(code, rest, "the power stage is switched on at rest");
        let step = i64::from(highest) - i64::from(rest);
        // 140 V over 65,536 codes.
        assert!((700..=703).contains(&step), "{step}");
        assert!(
            (4_000..4_100).contains(&ticks),
            "0.1 s at either place: {ticks}"
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        type Reads<'a> = &'a dyn Fn(i64, u32) -> i64;
        let cases: [(Reads, Fault); 6] = [
            (&|_, tick| 5000 + noise(tick, 40), Fault::SensorDoesNotMove),
            (
                &|code, tick| honest(-code) + noise(tick, 40),
                Fault::SensorReversed,
            ),
            (
                &|code, tick| honest(code / 2) + noise(tick, 40),
                Fault::GainDiffers,
            ),
            (
                &|code, tick| honest(code * 2) + noise(tick, 40),
                Fault::GainDiffers,
            ),
            (
                &|code, tick| honest(code) + noise(tick, 1_200),
                Fault::SensorNoisy,
            ),
            (
                &|code, tick| honest(code) + i64::from(tick) / 12 + noise(tick, 40),
                Fault::SensorDrifts,
            ),
        ];
        for (sensor, fault) in cases {
            assert_eq!(run(sensor).0, Err(fault), "{}", fault.name());
        }
    }
}
