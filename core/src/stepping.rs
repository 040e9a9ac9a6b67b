//! A stick-slip drive under control: coarse steps by shaped saw-teeth, fine motion inside a step by a law of
//! [`crate::servo_tick`].
//!
//! # How it works
//! A tooth is a slow flank, which the slider follows, and a fast one back, which it does not. Both begin at
//! the code that acts, so no change of phase moves the drive. The slow flank may gather speed
//! ([`SteppingParameters::curvature`]).
//!
//! | phase | what happens | ends |
//! |---|---|---|
//! | slow flank, fast flank | one tooth towards the target | another tooth while the target is beyond [`SteppingParameters::reach`] |
//! | settling | the drive rests | after [`SteppingParameters::settle_ticks`]; what is left of the drive towards the target decides between the law and a tooth, which moves the drive to its other end |
//! | fine | the law brings the slider to the target, from where both stand | a law that stays at a limit of the drive asks for one more tooth |
//! | holding | the drive rests; with a velocity, teeth follow the moving target | where the target stands still |
//!
//! The amplifier closes and opens it as any loop: the servo, the guard and the limits are those of
//! every block.
//!
//! # The encoder
//! A reading is the lowest [`ENCODER_BITS`] bits of the encoder's count, and the count goes on with the
//! shorter way from one to the next. The guard and the fine law read the position within a window about an
//! origin, in the codes of the block's converter. The window moves with the slider; it stands while something
//! is played and in fine motion. There the origin is the target, and a quintic leads from the position to it
//! ([`Waveform::QuasiStep`]): the law begins at no error and at the drive that acts.
//!
//! # Faults
//! [`Fault::Stalled`]: so many whole teeth brought less than the least travel. Near an end of the travel the
//! same is [`Fault::EndOfTravel`], and so are a tracking error and a position beyond an end.

use crate::amplifier_command::Refusal;
use crate::codes::{DriveCode, SensorCode};
use crate::guard::{Fault, Guard};
use crate::reference_generator::{ReferenceGenerator, Waveform};
use crate::servo_parameters::ServoParameters;
use crate::servo_tick::ServoTick;
use crate::signal::{
    MICROMETRE_FRACTION_BITS, Micrometres, TRAVEL_FRACTION_BITS, Travel, saturate,
};
use crate::stepping_parameters::{
    ENCODER_BITS, FLANK_FRACTION_BITS, MOST_TICKS, SteppingParameters,
};
use crate::swing_watch::SwingWatch;

/// A flank that a limit of the slew holds back may last so many times its ticks.
const LATE_FLANK: u32 = 8;

/// What the drive does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// The drive rests.
    Holding = 0,
    /// The flank that the slider follows.
    SlowFlank = 1,
    /// The flank that it does not follow.
    FastFlank = 2,
    /// The drive rests between coarse and fine motion.
    Settling = 3,
    /// The law holds the slider at the target.
    Fine = 4,
}

/// What is counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SteppingCounters {
    /// Teeth, those for want of reach included.
    pub teeth: u32,
    /// Positions that left their format and were held at its end.
    pub saturated_values: u32,
    /// Ticks at which a moving target was held back because the slider fell too far behind.
    pub held_back_ticks: u32,
}

/// A flank on its way.
#[derive(Clone, Copy, Debug)]
struct Flank {
    from: DriveCode,
    aim: DriveCode,
    ticks: u32,
    tick: u32,
    curvature: u32,
}

impl Flank {
    /// From a code to an end of the teeth, as fast as a whole flank over `span` steps in `ticks`.
    // Once in memory that is short: a flank begins rarely.
    #[inline(never)]
    fn new(from: DriveCode, aim: DriveCode, span: u32, ticks: u16, curvature: u16) -> Self {
        // At most 20 and 16 bits.
        let share = u64::from(from.abs_diff(aim)) * u64::from(ticks) / u64::from(span.max(1));
        Self {
            from,
            aim,
            ticks: share.clamp(1, MOST_TICKS) as u32,
            tick: 0,
            curvature: u32::from(curvature).min(1 << FLANK_FRACTION_BITS),
        }
    }

    /// The next code that is wanted.
    fn next_code(&mut self) -> DriveCode {
        self.tick = self.tick.saturating_add(1);
        if self.tick >= self.ticks {
            return self.aim;
        }
        // By at least one, which the compiler does not know; the result is below one.
        let p = (self.tick << FLANK_FRACTION_BITS)
            .checked_div(self.ticks)
            .unwrap_or(0);
        let bow = (p * ((1 << FLANK_FRACTION_BITS) - p)) >> FLANK_FRACTION_BITS;
        let share = p - ((self.curvature * bow) >> FLANK_FRACTION_BITS);
        let gone =
            (u64::from(self.from.abs_diff(self.aim)) * u64::from(share)) >> FLANK_FRACTION_BITS;
        if self.aim > self.from {
            self.from + gone as u32
        } else {
            self.from - gone as u32
        }
    }

    fn has_ended(&self, code: DriveCode) -> bool {
        self.tick >= self.ticks
            && (code == self.aim || self.tick >= self.ticks.saturating_mul(LATE_FLANK))
    }
}

/// The servo of the amplifier and what watches it, for a tick.
pub struct Loop<'a> {
    /// The servo.
    pub servo: &'a mut ServoTick,
    /// The guard.
    pub guard: &'a mut Guard,
    /// The watch of the fine law's drive.
    pub swing: &'a mut SwingWatch,
    /// The code that acts.
    pub code: DriveCode,
}

/// What makes a servo a stepping drive, with all its state.
#[derive(Clone, Debug)]
pub struct Stepper {
    parameters: SteppingParameters,
    adc_bits: u8,
    phase: Phase,
    position: i32,
    target: i32,
    /// Where a moving target stops.
    goal: i32,
    /// Velocity of the target, um a tick with 24 fraction bits, and what of it is below the target's format.
    velocity: i32,
    below: i32,
    /// The last reading; its count, the count at position 0, and the one in the middle of the window.
    last: Option<SensorCode>,
    count: i32,
    zero: i32,
    origin: i32,
    /// Something is played: the window stands.
    plays: bool,
    forward: bool,
    flank: Flank,
    whole: bool,
    tooth_from: i32,
    short_teeth: u16,
    teeth_for_reach: u16,
    waited: u16,
    at_limit: u16,
    limited_before: u32,
    arrived_for: u16,
    reference: ReferenceGenerator<Micrometres>,
    counters: SteppingCounters,
}

impl Stepper {
    /// With its slider at position 0, wherever the encoder begins.
    #[must_use]
    pub fn new(servo: &ServoParameters, parameters: SteppingParameters) -> Self {
        let rest = servo.converters.dac_code_min;
        Self {
            parameters,
            adc_bits: servo.converters.adc_bits,
            phase: Phase::Holding,
            position: 0,
            target: 0,
            goal: 0,
            velocity: 0,
            below: 0,
            last: None,
            count: 0,
            zero: 0,
            origin: 0,
            plays: false,
            forward: true,
            flank: Flank::new(rest, rest, 1, 1, 0),
            whole: false,
            tooth_from: 0,
            short_teeth: 0,
            teeth_for_reach: 0,
            waited: 0,
            at_limit: 0,
            limited_before: 0,
            arrived_for: 0,
            reference: ReferenceGenerator::new(Waveform::Constant, Micrometres::ZERO),
            counters: SteppingCounters::default(),
        }
    }

    /// The loop closes: the slider stays where it is.
    pub fn begin(&mut self) {
        (self.target, self.goal) = (self.position, self.position);
        self.forget_way();
        self.rest_before_deciding();
    }

    /// Goes to a position and holds it, behind a target that moves there at a velocity, um a tick; at a
    /// velocity of 0 as fast as the teeth are.
    ///
    /// # Errors
    /// The target is beyond the travel.
    pub fn move_to(&mut self, target: Travel, velocity: Micrometres) -> Result<(), Refusal> {
        if target < self.parameters.travel_min || target > self.parameters.travel_max {
            return Err(Refusal::BeyondLimits);
        }
        self.goal = target.to_bits();
        self.forget_way();
        let way = self.goal.saturating_sub(self.position);
        let is_near = way.unsigned_abs() <= self.parameters.reach.to_bits().unsigned_abs();
        let speed = velocity.to_bits().saturating_abs();
        let follows = speed > 0 && !is_near;
        if follows {
            self.target = self.position;
            self.velocity = if way < 0 { -speed } else { speed };
        } else {
            self.target = self.goal;
        }
        if matches!(self.phase, Phase::SlowFlank | Phase::FastFlank) {
        } else if follows {
            self.phase = Phase::Holding;
        } else {
            self.rest_before_deciding();
        }
        Ok(())
    }

    fn forget_way(&mut self) {
        (self.velocity, self.below) = (0, 0);
        (self.short_teeth, self.teeth_for_reach, self.arrived_for) = (0, 0, 0);
    }

    /// Position 0 is where so many readings were on the mean, by the sum of their codes in the window, which
    /// stood.
    pub fn zero_at_mean(&mut self, sum: i64, readings: u32) {
        let readings = i64::from(readings.max(1));
        let middle = 1i64 << (self.adc_bits - 1);
        let about = (sum + readings / 2).div_euclid(readings) - middle;
        self.zero = self.origin.wrapping_add(about as i32);
        self.position = self.travel();
    }

    /// Takes a reading of the encoder: its code in the window. `closed`: this loop is; `plays`: something is
    /// played.
    #[inline]
    pub fn read(
        &mut self,
        reading: Option<SensorCode>,
        guard: &mut Guard,
        closed: bool,
        plays: bool,
    ) -> Option<SensorCode> {
        let code = reading?;
        let before = self.count;
        let last = self.last.replace(code);
        // The lowest bits, with their sign.
        const ABOVE: u32 = i32::BITS - ENCODER_BITS as u32;
        let from = last.map_or(0, SensorCode::steps);
        let moved = (code.steps().wrapping_sub(from) << ABOVE) as i32 >> ABOVE;
        self.count = self.count.wrapping_add(moved);
        if last.is_none() {
            (self.zero, self.origin) = (self.count, self.count);
        }
        self.position = self.travel();
        let quarter = 1u32 << (self.adc_bits - 2);
        let stands = plays || (closed && self.phase == Phase::Fine);
        let begins = plays && !self.plays;
        if begins || (!stands && self.count.abs_diff(self.origin) > quarter) {
            self.look_about(self.count, before, guard);
        }
        self.plays = plays;
        Some(self.window(self.count))
    }

    /// Moves the window; what the guard saw last, at `count`, moves with it.
    fn look_about(&mut self, origin: i32, count: i32, guard: &mut Guard) {
        self.origin = origin;
        guard.move_last_code(self.window(count));
    }

    fn window(&self, count: i32) -> SensorCode {
        let middle = 1i64 << (self.adc_bits - 1);
        let about = i64::from(count) - i64::from(self.origin);
        SensorCode::new((middle + about.clamp(-middle, middle - 1)) as u32)
    }

    fn travel(&mut self) -> i32 {
        // counts * um (40) -> um (16), the step in two parts, of which each product has room.
        let count = i64::from(self.count.saturating_sub(self.zero));
        let step = self.parameters.encoder_step;
        let wide = count * (step >> 16) + ((count * (step & 0xffff)) >> 16);
        saturate(wide >> 8, &mut self.counters.saturated_values)
    }

    /// Count that is nearest to a position.
    fn count_at(&self, position: i32) -> i32 {
        let step = self.parameters.encoder_step.max(1);
        let count = (i64::from(position) << 24).saturating_add(step / 2) / step;
        let count = count.saturating_add(self.zero.into());
        count.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
    }

    /// From the position to the target, um with 16 fraction bits.
    fn error(&self) -> i32 {
        self.target.saturating_sub(self.position)
    }

    /// One period of the closed loop, behind [`Self::read`]: the code that is wanted, or what stops it.
    #[inline(never)]
    pub fn tick(&mut self, reading: SensorCode, parts: Loop<'_>) -> Result<DriveCode, Fault> {
        if self.is_beyond_end() {
            return Err(Fault::EndOfTravel);
        }
        self.move_target();
        match self.phase {
            Phase::Holding => {
                let lead = self.parameters.lead.to_bits().unsigned_abs();
                if self.velocity != 0 && self.error().unsigned_abs() >= lead {
                    Ok(self.begin_tooth(parts.code, parts.servo))
                } else {
                    Ok(parts.servo.open_loop(parts.code))
                }
            }
            Phase::Settling => {
                let code = parts.servo.open_loop(parts.code);
                self.waited = self.waited.saturating_add(1);
                if self.waited < self.parameters.settle_ticks {
                    Ok(code)
                } else if self.reaches(parts.servo.code_in_range()) {
                    self.begin_fine(parts);
                    Ok(code)
                } else {
                    Ok(self.begin_tooth(code, parts.servo))
                }
            }
            Phase::SlowFlank | Phase::FastFlank => self.step_flank(parts.servo),
            Phase::Fine => self.step_fine(reading, parts),
        }
    }

    /// Whether the slider is there, or the law can go there with what is left of the drive in that direction:
    /// from an end of the teeth to the far end of the drive it goes as far as the reach.
    fn reaches(&self, [code, lowest, highest]: [DriveCode; 3]) -> bool {
        let error = self.error();
        if self.is_there() {
            return true;
        }
        let left = if error >= 0 {
            highest.abs_diff(code)
        } else {
            code.abs_diff(lowest)
        };
        let whole = highest.abs_diff(self.parameters.low);
        let reach = self.parameters.reach.to_bits().unsigned_abs();
        u64::from(error.unsigned_abs()) * u64::from(whole) <= u64::from(reach) * u64::from(left)
    }

    fn is_there(&self) -> bool {
        self.error().unsigned_abs() <= self.parameters.tolerance.to_bits().unsigned_abs()
    }

    fn is_near_end(&self) -> bool {
        let p = &self.parameters;
        let zone = p.end_zone.to_bits();
        if self.forward {
            self.position >= p.travel_max.to_bits().saturating_sub(zone)
        } else {
            self.position <= p.travel_min.to_bits().saturating_add(zone)
        }
    }

    /// Beyond an end and on its way out; the way back is free.
    fn is_beyond_end(&self) -> bool {
        let p = &self.parameters;
        let zone = p.end_zone.to_bits();
        let above = self.position > p.travel_max.to_bits().saturating_add(zone);
        let below = self.position < p.travel_min.to_bits().saturating_sub(zone);
        let outwards = (above && self.error() >= 0) || (below && self.error() <= 0);
        outwards && self.phase != Phase::Holding
    }

    fn stall(&self) -> Fault {
        if self.is_near_end() {
            Fault::EndOfTravel
        } else {
            Fault::Stalled
        }
    }

    fn move_target(&mut self) {
        if self.velocity == 0 {
            return;
        }
        // um (24) -> um (16), what is below is carried on.
        const SHIFT: u32 = MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS;
        let moved = self.velocity.saturating_add(self.below);
        self.below = moved & ((1 << SHIFT) - 1);
        let wanted = self.target.saturating_add(moved >> SHIFT);
        let slack = self.parameters.reach.to_bits().saturating_mul(2);
        self.target = wanted
            .max(self.position.saturating_sub(slack))
            .min(self.position.saturating_add(slack));
        if self.target != wanted {
            self.counters.held_back_ticks = self.counters.held_back_ticks.saturating_add(1);
        }
        let is_there = if self.velocity > 0 {
            self.target >= self.goal
        } else {
            self.target <= self.goal
        };
        if is_there {
            (self.target, self.velocity) = (self.goal, 0);
            if self.phase == Phase::Holding {
                self.rest_before_deciding();
            }
        }
    }

    fn rest_before_deciding(&mut self) {
        self.phase = Phase::Settling;
        self.waited = 0;
    }

    fn ends(&self) -> [DriveCode; 2] {
        let p = &self.parameters;
        if self.forward {
            [p.low, p.high]
        } else {
            [p.high, p.low]
        }
    }

    fn span(&self) -> u32 {
        self.parameters.high.abs_diff(self.parameters.low)
    }

    /// A tooth towards the target: its first code comes with the next tick.
    #[inline(never)]
    fn begin_tooth(&mut self, code: DriveCode, servo: &mut ServoTick) -> DriveCode {
        self.forward = self.error() >= 0;
        let [from, aim] = self.ends();
        let p = &self.parameters;
        self.whole = code == from;
        self.tooth_from = self.position;
        self.flank = Flank::new(code, aim, self.span(), p.slow_ticks, p.curvature);
        self.counters.teeth = self.counters.teeth.saturating_add(1);
        self.phase = Phase::SlowFlank;
        servo.open_loop(code)
    }

    fn step_flank(&mut self, servo: &mut ServoTick) -> Result<DriveCode, Fault> {
        let code = servo.open_loop(self.flank.next_code());
        if !self.flank.has_ended(code) {
            return Ok(code);
        }
        if self.phase == Phase::SlowFlank {
            let [aim, _] = self.ends();
            self.flank = Flank::new(code, aim, self.span(), self.parameters.fast_ticks, 0);
            self.phase = Phase::FastFlank;
            Ok(code)
        } else {
            self.end_tooth(code, servo)
        }
    }

    fn end_tooth(&mut self, code: DriveCode, servo: &mut ServoTick) -> Result<DriveCode, Fault> {
        let sign = if self.forward { 1 } else { -1 };
        let gone = self
            .position
            .saturating_sub(self.tooth_from)
            .saturating_mul(sign);
        if self.whole && gone < self.parameters.least_step.to_bits() {
            self.short_teeth = self.short_teeth.saturating_add(1);
        } else if self.whole {
            self.short_teeth = 0;
        }
        if self.short_teeth >= self.parameters.stall_teeth {
            return Err(self.stall());
        }
        if self.velocity != 0 {
            self.phase = Phase::Holding;
        } else if self.error().saturating_mul(sign) > self.parameters.reach.to_bits() {
            return Ok(self.begin_tooth(code, servo));
        } else {
            self.rest_before_deciding();
        }
        Ok(code)
    }

    /// Lets the law take over from position and drive as they stand.
    fn begin_fine(&mut self, parts: Loop<'_>) {
        self.look_about(self.count_at(self.target), self.count, parts.guard);
        parts.guard.begin_loop();
        parts.swing.begin(parts.code);
        let from = Micrometres::from_bits(
            self.error()
                .saturating_neg()
                .saturating_mul(1 << (MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS)),
        );
        self.reference = ReferenceGenerator::new(
            Waveform::QuasiStep {
                height: from.saturating_neg(),
                delay_ticks: 0,
                duration_ticks: u32::from(self.parameters.fine_ticks),
            },
            from,
        );
        parts.servo.enable();
        (self.at_limit, self.arrived_for) = (0, 0);
        self.limited_before = parts.servo.counters().limited_ticks;
        self.phase = Phase::Fine;
    }

    fn step_fine(&mut self, reading: SensorCode, parts: Loop<'_>) -> Result<DriveCode, Fault> {
        let Loop {
            servo,
            guard,
            swing,
            ..
        } = parts;
        let code = servo.tick(reading, self.reference.next_value());
        let reference = servo.reference();
        let error = reference.saturating_sub(servo.sensed()).to_bits();
        let slewing = servo.slewing();
        let limited = servo.counters().limited_ticks;
        let is_limited = limited != self.limited_before;
        self.limited_before = limited;
        self.at_limit = if is_limited {
            self.at_limit.saturating_add(1)
        } else {
            0
        };
        let p = &self.parameters;
        let near = self.is_there();
        self.arrived_for = if near {
            self.arrived_for.saturating_add(1)
        } else {
            0
        };
        if self.at_limit > p.settle_ticks.saturating_add(p.fine_ticks) && !near {
            self.teeth_for_reach = self.teeth_for_reach.saturating_add(1);
            return if self.teeth_for_reach > p.stall_teeth {
                Err(self.stall())
            } else {
                Ok(self.begin_tooth(code, servo))
            };
        }
        let fault = guard
            .inspect_loop(error, slewing)
            .or_else(|| swing.inspect(code, reference.to_bits()));
        match fault {
            None => Ok(code),
            // What does not follow here stands at the end.
            Some(Fault::TrackingError) if self.is_near_end() => Err(Fault::EndOfTravel),
            Some(fault) => Err(fault),
        }
    }

    /// Position at the last tick.
    #[must_use]
    pub fn position(&self) -> Travel {
        Travel::from_bits(self.position)
    }

    /// Where it goes.
    #[must_use]
    pub fn target(&self) -> Travel {
        Travel::from_bits(self.target)
    }

    /// What the drive does while the loop is closed.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether the slider stands at its target.
    #[must_use]
    pub fn has_arrived(&self) -> bool {
        self.phase == Phase::Fine && self.arrived_for >= self.parameters.arrival_ticks
    }

    /// What was counted.
    #[must_use]
    pub fn counters(&self) -> SteppingCounters {
        self.counters
    }
}

#[cfg(all(test, feature = "stepping"))]
mod tests {
    extern crate std;
    use super::*;
    use crate::amplifier::{Amplifier, Mode};
    use crate::amplifier_command::Command;
    use crate::guard::GuardParameters;
    use crate::parameter_block::tests::example;
    use crate::parameter_block::{AmplifierParameters, BLOCK_BYTES, read, write};
    use crate::stepping_parameters::{IfStepping, STEPPING_BYTES, verify};
    use crate::wire::{Wire, Writer};
    use proptest::prelude::*;
    use std::vec::Vec;

    /// 1 nm with 40 fraction bits.
    const STEP: i64 = (1 << 40) / 1000;
    const NM: f64 = 1e-3;

    fn um(um: f64) -> Travel {
        Travel::saturating_from_num(um)
    }

    /// Teeth of 40 V, 5.7 um of the actuator's 1/7 um per V.
    fn stepping() -> SteppingParameters {
        SteppingParameters {
            encoder_step: STEP,
            low: DriveCode::new(18_000),
            high: DriveCode::new(36_720),
            slow_ticks: 100,
            fast_ticks: 8,
            curvature: 1 << 14,
            settle_ticks: 40,
            fine_ticks: 400,
            reach: um(6.5),
            lead: um(3.0),
            travel_min: um(-3000.0),
            travel_max: um(3000.0),
            end_zone: um(20.0),
            least_step: um(1.0),
            stall_teeth: 5,
            tolerance: um(0.02),
            arrival_ticks: 100,
        }
    }

    fn block(stepping: SteppingParameters) -> AmplifierParameters {
        let mut block = example();
        let c = &mut block.servo.converters;
        (c.adc_step, c.adc_zero) = (STEP, -((STEP << 15) >> 16) as i32);
        block.physical.sensor_span_nm = 65_536;
        block.guard = GuardParameters {
            stuck_ticks: 0,
            jump_codes: 7000,
            tracking_ticks: 2000,
            tracking_error: 20 << 24,
            healthy_ticks: 20,
            ..block.guard
        };
        block.stepping = IfStepping::new(stepping);
        block
    }

    /// A slider that follows its platform up to a speed, and stands still beyond; ends that it cannot pass.
    struct Rig {
        slider_um: f64,
        code: DriveCode,
        grips: bool,
        ends_um: [f64; 2],
    }

    impl Rig {
        /// The count at the beginning is far from zero, and the reading near its end.
        fn reading(&self) -> SensorCode {
            let count = (self.slider_um / NM).round() as i64 - 40_000_003;
            SensorCode::new(count.rem_euclid(1 << ENCODER_BITS) as u32)
        }

        fn advance(&mut self, code: DriveCode) {
            let moved = f64::from(code) - f64::from(self.code);
            // A whole flank of 18 720 steps within 100 ticks gathers speed up to 1.5 times its mean.
            if self.grips && moved.abs() < 300.0 {
                self.slider_um += moved * 140.0 / 65_536.0 / 7.0;
            }
            self.slider_um = self.slider_um.clamp(self.ends_um[0], self.ends_um[1]);
            self.code = code;
        }
    }

    /// A drive whose loop is closed, at position 0.
    fn drive(stepping: SteppingParameters) -> (Amplifier, Rig) {
        drive_of(block(stepping))
    }

    fn drive_of(block: AmplifierParameters) -> (Amplifier, Rig) {
        let mut amplifier = Amplifier::new(block);
        let mut rig = Rig {
            slider_um: 0.0,
            code: block.guard.rest_code,
            grips: true,
            ends_um: [-1e9, 1e9],
        };
        run(&mut amplifier, &mut rig, 1);
        closes(&mut amplifier);
        (amplifier, rig)
    }

    fn closes(amplifier: &mut Amplifier) {
        for command in [
            Command::Arm { tested: false },
            Command::RequireConditioning(false),
            Command::Enable,
        ] {
            assert_eq!(amplifier.command(command), Ok(()));
        }
    }

    fn go(amplifier: &mut Amplifier, target_um: f64, um_a_tick: f64) -> Result<(), Refusal> {
        amplifier.command(Command::MoveTo {
            target: um(target_um),
            velocity: Micrometres::from_num(um_a_tick),
        })
    }

    fn run(amplifier: &mut Amplifier, rig: &mut Rig, ticks: usize) -> Vec<DriveCode> {
        (0..ticks)
            .map(|_| {
                let code = amplifier.tick(Some(rig.reading()), false).dac_code;
                rig.advance(code);
                code
            })
            .collect()
    }

    fn stepper(amplifier: &Amplifier) -> &Stepper {
        amplifier.stepper().unwrap()
    }

    #[test]
    fn targets_near_and_far_are_reached_from_both_sides() {
        for (from, to) in [
            (0.0, 0.1),
            (0.0, 12.0),
            (50.0, -150.0),
            (-400.0, 777.7),
            (1.0, 0.0),
        ] {
            let (mut amplifier, mut rig) = drive(stepping());
            for target in [from, to] {
                go(&mut amplifier, target, 0.0).unwrap();
                run(&mut amplifier, &mut rig, 60_000);
                let stepper = stepper(&amplifier);
                let why = (stepper.phase(), amplifier.fault(), stepper.counters());
                assert!(
                    stepper.has_arrived() && amplifier.fault().is_none(),
                    "{from} to {to}: {why:?}"
                );
                let error = rig.slider_um - target;
                assert!(error.abs() < 0.02, "{from} to {to}: {error} {why:?}");
                assert_eq!(stepper.counters().saturated_values, 0);
            }
        }
    }

    /// From the lower end of the drive, down: the law is not left to wait at its limit.
    #[test]
    fn a_tooth_comes_first_where_no_drive_is_left_towards_the_target() {
        let lowest = block(stepping()).servo.converters.dac_code_min;
        let (mut amplifier, mut rig) = drive(SteppingParameters {
            low: lowest,
            ..stepping()
        });
        // Nor does a slider that stands by less than the tolerance beyond its target need one.
        go(&mut amplifier, -0.01, 0.0).unwrap();
        run(&mut amplifier, &mut rig, 200);
        assert_eq!(
            (rig.code, stepper(&amplifier).counters().teeth),
            (lowest, 0)
        );
        go(&mut amplifier, -3.0, 0.0).unwrap();
        let mut fine_from = None;
        for tick in 0..2000 {
            let code = run(&mut amplifier, &mut rig, 1)[0];
            let stepper = stepper(&amplifier);
            if stepper.phase() == Phase::Fine {
                fine_from = fine_from.or(Some((tick, stepper.counters().teeth)));
                assert_ne!(code, lowest, "{tick}");
            }
        }
        let (tick, teeth) = fine_from.unwrap();
        assert!(tick < 300 && teeth == 1, "{tick} {teeth}");
        assert!(stepper(&amplifier).has_arrived(), "{}", rig.slider_um);
    }

    #[test]
    fn no_change_of_phase_moves_the_drive() {
        let (mut amplifier, mut rig) = drive(stepping());
        go(&mut amplifier, 60.0, 0.0).unwrap();
        let (mut phase, mut code) = (stepper(&amplifier).phase(), rig.code);
        let mut changes = 0;
        let slowest = 400;
        for _ in 0..20_000 {
            let next = run(&mut amplifier, &mut rig, 1)[0];
            let now = stepper(&amplifier).phase();
            changes += usize::from(now != phase && now == Phase::Fine);
            if phase != Phase::FastFlank && now != Phase::FastFlank {
                let moved = next.abs_diff(code);
                assert!(moved < slowest, "{phase:?} to {now:?}: {moved} codes");
            }
            (phase, code) = (now, next);
        }
        assert!(changes > 0 && stepper(&amplifier).has_arrived());
    }

    #[test]
    fn a_slider_that_does_not_move_is_a_stall() {
        let (mut amplifier, mut rig) = drive(stepping());
        rig.grips = false;
        go(&mut amplifier, 500.0, 0.0).unwrap();
        let codes = run(&mut amplifier, &mut rig, 20_000);
        assert_eq!(amplifier.fault(), Some(Fault::Stalled));
        assert_eq!(codes.last(), Some(&block(stepping()).guard.rest_code));
        assert_eq!(go(&mut amplifier, 0.0, 0.0), Err(Refusal::Faulted));
        assert_eq!(amplifier.command(Command::Clear), Ok(()));
        closes(&mut amplifier);
        assert_eq!(go(&mut amplifier, 0.0, 0.0), Ok(()));
    }

    #[test]
    fn an_end_of_the_travel_has_its_name() {
        // Beyond the reach of fine motion, and within it.
        for (stop_um, tracking_error) in [(85.0, 20 << 24), (97.0, 20 << 24), (97.0, 1 << 24)] {
            let mut block = block(SteppingParameters {
                travel_max: um(100.0),
                ..stepping()
            });
            block.guard.tracking_error = tracking_error;
            let (mut amplifier, mut rig) = drive_of(block);
            let beyond = go(&mut amplifier, 100.1, 0.0);
            assert_eq!(beyond, Err(Refusal::BeyondLimits));
            rig.ends_um[1] = stop_um;
            go(&mut amplifier, 100.0, 0.0).unwrap();
            run(&mut amplifier, &mut rig, 40_000);
            assert_eq!(amplifier.fault(), Some(Fault::EndOfTravel), "{stop_um}");
        }
    }

    #[test]
    fn a_silent_encoder_stops_the_drive() {
        let (mut amplifier, mut rig) = drive(stepping());
        go(&mut amplifier, 500.0, 0.0).unwrap();
        run(&mut amplifier, &mut rig, 500);
        let rest = block(stepping()).guard.rest_code;
        let last = (0..2000).map(|_| amplifier.tick(None, false).dac_code);
        assert_eq!(last.last(), Some(rest));
        assert_eq!(amplifier.fault(), Some(Fault::SensorSilent));
        let cleared = amplifier.command(Command::Clear);
        assert_eq!(cleared, Err(Refusal::NotYetHealthy));
    }

    #[test]
    fn a_moving_target_is_followed_at_its_velocity_and_to_its_end() {
        // 0.02 um a tick, 400 um/s at 20 kHz: below the teeth's 1000 um/s.
        for (target, a_tick) in [(220.0, 0.02), (-121.0, 0.011)] {
            let (mut amplifier, mut rig) = drive(stepping());
            go(&mut amplifier, target, a_tick).unwrap();
            run(&mut amplifier, &mut rig, 10_000);
            let lag = rig.slider_um - 10_000.0 * a_tick * target.signum();
            assert!(lag.abs() < 9.0, "{lag} um behind");
            run(&mut amplifier, &mut rig, 3_000);
            assert!(stepper(&amplifier).has_arrived(), "{}", rig.slider_um);
            assert!((rig.slider_um - target).abs() < 0.02, "{}", rig.slider_um);
            assert_eq!(stepper(&amplifier).counters().held_back_ticks, 0);
        }
        let (mut amplifier, mut rig) = drive(stepping());
        go(&mut amplifier, 3000.0, 0.2).unwrap();
        run(&mut amplifier, &mut rig, 5_000);
        assert!(stepper(&amplifier).counters().held_back_ticks > 1000);
    }

    #[test]
    fn a_conditioning_lets_the_slider_ride_and_makes_its_place_zero() {
        let (mut amplifier, mut rig) = drive(stepping());
        go(&mut amplifier, 300.0, 0.0).unwrap();
        run(&mut amplifier, &mut rig, 20_000);
        assert_eq!(amplifier.command(Command::Disable), Ok(()));
        run(&mut amplifier, &mut rig, 2_000);
        let cycle = Command::Condition {
            cycle_ticks: 2_000,
            rest_ticks: 2_000,
        };
        assert_eq!(amplifier.command(cycle), Ok(()));
        run(&mut amplifier, &mut rig, 4_100);
        let found = (amplifier.mode(), amplifier.fault(), amplifier.conditioned());
        assert_eq!(found, (Mode::Rest, None, true));
        let zero_um = rig.slider_um;
        assert!(stepper(&amplifier).position().abs() < 0.002);
        assert_eq!(amplifier.command(Command::Enable), Ok(()));
        go(&mut amplifier, -50.0, 0.0).unwrap();
        run(&mut amplifier, &mut rig, 20_000);
        assert!((rig.slider_um - zero_um + 50.0).abs() < 0.02);
    }

    #[test]
    fn a_waveform_is_refused_and_so_is_a_travel_without_a_stepping_drive() {
        let waveform = Command::Reference {
            waveform: Waveform::Constant,
            offset: Micrometres::ZERO,
        };
        let (mut amplifier, _) = drive(stepping());
        assert_eq!(amplifier.command(waveform), Err(Refusal::OtherDrive));
        let mut other = Amplifier::new(example());
        assert_eq!(go(&mut other, 1.0, 0.0), Err(Refusal::OtherDrive));
        assert_eq!(other.command(waveform), Ok(()));
    }

    #[test]
    fn a_block_comes_back_as_it_went() {
        let mut bytes = [0; BLOCK_BYTES];
        let block = block(stepping());
        write(&block, &mut bytes).unwrap();
        assert_eq!(read(&bytes, 20_000), Ok(block));
        assert_eq!(block.reading_bits(), ENCODER_BITS);
        let mut own = [0; STEPPING_BYTES];
        let mut writer = Writer::new(&mut own);
        stepping().write(&mut writer).unwrap();
        assert_eq!(writer.at(), STEPPING_BYTES);
    }

    #[test]
    fn parameters_that_contradict_one_another_are_refused() {
        let servo = block(stepping()).servo;
        let refused = |change: &dyn Fn(&mut SteppingParameters)| {
            let mut wrong = stepping();
            change(&mut wrong);
            verify(&servo, &wrong).unwrap_err()
        };
        assert!(refused(&|p| p.low = p.high).contains("ends of the teeth"));
        assert!(refused(&|p| p.encoder_step += 1).contains("encoder"));
        assert!(refused(&|p| p.reach = um(17.0)).contains("reach"));
        assert!(refused(&|p| p.curvature = 0x8001).contains("curvature"));
        assert!(refused(&|p| p.travel_min = um(3001.0)).contains("travel"));
        let mut aside = servo;
        aside.converters.adc_zero += 1 << 20;
        assert!(verify(&aside, &stepping()).unwrap_err().contains("window"));
    }

    #[test]
    fn it_takes_little_memory_beside_its_servo() {
        assert!(size_of::<Stepper>() < 320, "{} bytes", size_of::<Stepper>());
    }

    proptest! {
        /// Whatever an encoder gives and whatever is asked for: every code is within range and slew.
        #[test]
        fn no_reading_and_no_order_leaves_range_or_slew(
            orders in prop::collection::vec((any::<i32>(), 0u8..8, 1u16..300), 1..40),
            (slow, fast) in (1u16.., 1u16..),
        ) {
            let mut parameters = stepping();
            (parameters.slow_ticks, parameters.fast_ticks) = (slow, fast);
            let (mut amplifier, rig) = drive(parameters);
            let c = amplifier.parameters().servo.converters;
            let mut before = rig.code;
            let mut count = 0i32;
            for (value, kind, ticks) in orders {
                let travel = |target: Travel, velocity| Command::MoveTo { target, velocity };
                match kind {
                    0 => { let _ = amplifier.command(travel(Travel::from_bits(value), Micrometres::ZERO)); }
                    1 => { let _ = amplifier.command(travel(um(f64::from(value.signum()) * 3000.0), Micrometres::from_bits(value))); }
                    2 => { let _ = amplifier.command(travel(um(f64::from(value % 3000)), Micrometres::ZERO)); }
                    3 => {
                        for command in [Command::Clear, Command::Arm { tested: false }, Command::Enable] {
                            let _ = amplifier.command(command);
                        }
                    }
                    4 => count = value,
                    _ => {}
                }
                for nth in 0..ticks {
                    count = count.wrapping_add(value % 50);
                    let reading = (kind != 5 || nth % 64 != 0)
                        .then_some(SensorCode::new(count as u32 & ((1 << ENCODER_BITS) - 1)));
                    let code = amplifier.tick(reading, false).dac_code;
                    prop_assert!((c.dac_code_min..=c.dac_code_max).contains(&code));
                    prop_assert!(code.abs_diff(before) <= c.slew_codes);
                    before = code;
                }
            }
        }
    }
}
