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
//! | settling | the drive rests | after [`SteppingParameters::settle_ticks`] |
//! | fine | the law brings the slider to the target, from where both stand | a law that stays at a limit of the drive asks for one more tooth, which moves the drive to its other end |
//! | holding | the drive rests; with a velocity, teeth follow the moving target | |
//! | fault | the drive goes to rest as [`Guard::towards_rest`] has it | a cleared fault |
//!
//! The fine law reads the position within a window about [`SteppingTick`]'s origin, in the codes of its own
//! converter. In fine motion the origin is the target, and a quintic leads from the position to it
//! ([`Waveform::QuasiStep`]): the law begins at no error and at the drive that acts.
//!
//! # Faults
//! [`SteppingFault::Stalled`]: so many whole teeth brought less than the least travel. Near an end of the
//! travel the same is [`SteppingFault::EndStop`], and so is a position beyond an end. Faults of sensor and loop
//! are those of the [`Guard`].

use crate::codes::{DriveCode, EncoderCount, SensorCode};
use crate::guard::{Fault, Guard, GuardParameters};
use crate::output_limit::OutputLimit;
use crate::reference_generator::{ReferenceGenerator, Waveform};
use crate::servo_parameters::ServoParameters;
use crate::servo_tick::ServoTick;
use crate::signal::{
    MICROMETRE_FRACTION_BITS, Micrometres, TRAVEL_FRACTION_BITS, Travel, saturate,
};
use crate::trace_frame::TraceSample;

/// Fraction bits of shares of a flank.
pub const FLANK_FRACTION_BITS: u32 = 15;
/// Longest flank: its ticks have room above [`FLANK_FRACTION_BITS`].
const MOST_TICKS: u64 = (1 << (32 - FLANK_FRACTION_BITS)) - 1;
/// A flank that a limit of the slew holds back may last so many times its ticks.
const LATE_FLANK: u32 = 8;

/// Integers of the stepping, quantised once on the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SteppingParameters {
    /// Travel per count of the encoder, um with 40 fraction bits.
    pub encoder_step: i64,
    /// Lower end of the teeth.
    pub low: DriveCode,
    /// Upper end of the teeth.
    pub high: DriveCode,
    /// Ticks of a whole slow flank.
    pub slow_ticks: u16,
    /// Ticks of a whole fast flank.
    pub fast_ticks: u16,
    /// How much the slow flank gathers speed, with [`FLANK_FRACTION_BITS`]: 0 is straight, 1 begins at rest.
    pub curvature: u16,
    /// Ticks of rest between coarse and fine motion.
    pub settle_ticks: u16,
    /// Ticks of the way to the target in fine motion.
    pub fine_ticks: u16,
    /// Distance within which fine motion takes over.
    pub reach: Travel,
    /// Distance behind a moving target at which a tooth begins.
    pub lead: Travel,
    /// Lower end of the travel.
    pub travel_min: Travel,
    /// Upper end of the travel.
    pub travel_max: Travel,
    /// Distance from an end within which a stall is an end stop; a position further beyond is one too.
    pub end_zone: Travel,
    /// Least travel of a whole tooth.
    pub least_step: Travel,
    /// Whole teeth in a row with less, or teeth for want of reach on the way to one target, that are a stall.
    pub stall_teeth: u16,
    /// Distance from the target that counts as arrived.
    pub tolerance: Travel,
    /// Ticks in a row within it.
    pub arrival_ticks: u16,
}

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
    /// The drive goes to rest, or is there.
    Fault = 5,
}

/// What stops a stepping drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SteppingFault {
    /// Teeth bring no travel: too much load, too little friction, something jams.
    Stalled,
    /// The slider is at an end of its travel.
    EndStop,
    /// Sensor or loop.
    Guard(Fault),
}

impl SteppingFault {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stalled => "stick-slip drive stalled",
            Self::EndStop => "slider at an end of its travel",
            Self::Guard(fault) => fault.name(),
        }
    }

    /// Its number in a trace: those of the guard's faults are their own.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Stalled => 0xf0,
            Self::EndStop => 0xf1,
            Self::Guard(fault) => fault as u8,
        }
    }
}

/// Why a move does not begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The target is beyond the travel.
    BeyondTravel,
    /// A fault is not cleared.
    Fault,
}

/// What is counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SteppingCounters {
    /// Teeth, those for want of reach included.
    pub teeth: u32,
    /// Values that left their format and were held at its end.
    pub saturated_values: u32,
    /// Ticks at which the output limit changed a code of the law.
    pub limited_codes: u32,
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

/// A stepping drive with all its state.
#[derive(Clone, Debug)]
pub struct SteppingTick {
    servo: ServoTick,
    guard: Guard,
    limit: OutputLimit,
    parameters: SteppingParameters,
    phase: Phase,
    fault: Option<SteppingFault>,
    code: DriveCode,
    position: i32,
    target: i32,
    /// Velocity of the target, um a tick with 24 fraction bits, and what of it is below the target's format.
    velocity: i32,
    below: i32,
    /// Count in the middle of the window of the sensor's codes.
    origin: i32,
    window_code: SensorCode,
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
    tick: u32,
}

impl SteppingTick {
    /// A drive at rest with its slider at `count`.
    ///
    /// # Errors
    /// What of the parameters contradicts the rest.
    pub fn new(
        servo: ServoParameters,
        guard: GuardParameters,
        limit: OutputLimit,
        stepping: SteppingParameters,
        count: EncoderCount,
    ) -> Result<Self, &'static str> {
        verify(&servo, &stepping)?;
        let rest = guard.rest_code;
        let mut this = Self {
            servo: ServoTick::new(servo),
            guard: Guard::new(guard),
            limit,
            parameters: stepping,
            phase: Phase::Holding,
            fault: None,
            code: rest,
            position: 0,
            target: 0,
            velocity: 0,
            below: 0,
            origin: count.0,
            window_code: SensorCode::default(),
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
            tick: 0,
        };
        this.position = this.travel(count);
        this.target = this.position;
        this.apply(rest);
        Ok(this)
    }

    /// Goes to a position and holds it.
    ///
    /// # Errors
    /// The target is beyond the travel, or a fault stands.
    pub fn move_to(&mut self, target: Travel) -> Result<(), Refusal> {
        if self.fault.is_some() {
            return Err(Refusal::Fault);
        }
        if target < self.parameters.travel_min || target > self.parameters.travel_max {
            return Err(Refusal::BeyondTravel);
        }
        self.target = target.to_bits();
        (self.velocity, self.below) = (0, 0);
        (self.short_teeth, self.teeth_for_reach, self.arrived_for) = (0, 0, 0);
        if !matches!(self.phase, Phase::SlowFlank | Phase::FastFlank) {
            self.rest_before_deciding();
        }
        Ok(())
    }

    /// Follows a target that moves from here at a velocity, um a tick, by teeth alone. Ends with
    /// [`Self::move_to`], with a velocity of zero, or at an end of the travel.
    ///
    /// # Errors
    /// A fault stands.
    pub fn follow(&mut self, velocity: Micrometres) -> Result<(), Refusal> {
        if self.fault.is_some() {
            return Err(Refusal::Fault);
        }
        self.target = self.position;
        (self.velocity, self.below) = (velocity.to_bits(), 0);
        self.short_teeth = 0;
        if !matches!(self.phase, Phase::SlowFlank | Phase::FastFlank) {
            self.phase = Phase::Holding;
        }
        Ok(())
    }

    /// Clears a fault once the sensor was healthy for long enough; whether it did.
    pub fn clear_fault(&mut self) -> bool {
        let clears = self.fault.is_some() && self.guard.healthy();
        if clears {
            self.fault = None;
            self.phase = Phase::Holding;
            (self.target, self.velocity) = (self.position, 0);
        }
        clears
    }

    /// One period: the encoder's count, or none if it did not answer, gives the code to apply.
    pub fn tick(&mut self, count: Option<EncoderCount>) -> DriveCode {
        self.tick = self.tick.wrapping_add(1);
        match self.inspect(count) {
            Some(fault) => self.stop(SteppingFault::Guard(fault)),
            None => self.watch_ends(),
        }
        self.move_target();
        match self.phase {
            Phase::Fault => {
                let code = self.guard.towards_rest(self.code);
                self.apply(code);
            }
            Phase::Holding => {
                if self.velocity != 0
                    && self.error().unsigned_abs() >= self.parameters.lead.to_bits().unsigned_abs()
                {
                    self.begin_tooth();
                } else {
                    self.apply(self.code);
                }
            }
            Phase::Settling => {
                self.apply(self.code);
                self.waited = self.waited.saturating_add(1);
                if self.waited >= self.parameters.settle_ticks {
                    self.decide();
                }
            }
            Phase::SlowFlank | Phase::FastFlank => self.step_flank(),
            Phase::Fine => self.step_fine(),
        }
        self.code
    }

    /// Reads the count, moves the window of codes along, and asks the guard.
    fn inspect(&mut self, count: Option<EncoderCount>) -> Option<Fault> {
        let Some(count) = count else {
            return self.guard.inspect(None);
        };
        self.position = self.travel(count);
        self.window_code = self.window(count);
        let fault = self.guard.inspect(Some(self.window_code));
        let quarter = 1u32 << (self.servo.parameters().converters.adc_bits - 2);
        if fault.is_none() && count.0.abs_diff(self.origin) > quarter && self.phase != Phase::Fine {
            self.look_about(count.0, count);
        }
        fault
    }

    /// Moves the window of codes; the guard begins with the present reading.
    fn look_about(&mut self, origin: i32, count: EncoderCount) {
        self.origin = origin;
        self.window_code = self.window(count);
        let limits = *self.guard.parameters();
        self.guard = Guard::new(limits);
        let _ = self.guard.inspect(Some(self.window_code));
    }

    fn window(&self, count: EncoderCount) -> SensorCode {
        let middle = 1i64 << (self.servo.parameters().converters.adc_bits - 1);
        let about = i64::from(count.0) - i64::from(self.origin);
        SensorCode::new((middle + about.clamp(-middle, middle - 1)) as u32)
    }

    fn travel(&mut self, count: EncoderCount) -> i32 {
        // counts * um (40) -> um (16), the step in two parts, of which each product has room.
        let (count, step) = (i64::from(count.0), self.parameters.encoder_step);
        let wide = count * (step >> 16) + ((count * (step & 0xffff)) >> 16);
        saturate(wide >> 8, &mut self.counters.saturated_values)
    }

    /// Count that is nearest to a position.
    fn count_at(&self, position: i32) -> i32 {
        let step = self.parameters.encoder_step.max(1);
        let count = (i64::from(position) << 24).saturating_add(step / 2) / step;
        count.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
    }

    /// From the position to the target, um with 16 fraction bits.
    fn error(&self) -> i32 {
        self.target.saturating_sub(self.position)
    }

    fn apply(&mut self, wanted: DriveCode) {
        let (code, _) = self.limit.pass(wanted);
        self.code = self.servo.open_loop(code);
    }

    fn stop(&mut self, fault: SteppingFault) {
        if self.fault.is_none() {
            self.fault = Some(fault);
        }
        self.velocity = 0;
        self.phase = Phase::Fault;
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

    fn watch_ends(&mut self) {
        let p = &self.parameters;
        let zone = p.end_zone.to_bits();
        let above = self.position > p.travel_max.to_bits().saturating_add(zone);
        let below = self.position < p.travel_min.to_bits().saturating_sub(zone);
        // The way back is free.
        let outwards = (above && self.error() >= 0) || (below && self.error() <= 0);
        if outwards && !matches!(self.phase, Phase::Holding | Phase::Fault) {
            self.stop(SteppingFault::EndStop);
        }
    }

    fn move_target(&mut self) {
        if self.velocity == 0 {
            return;
        }
        let p = &self.parameters;
        // um (24) -> um (16), what is below is carried on.
        const SHIFT: u32 = MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS;
        let moved = self.velocity.saturating_add(self.below);
        self.below = moved & ((1 << SHIFT) - 1);
        let wanted = self.target.saturating_add(moved >> SHIFT);
        let slack = p.reach.to_bits().saturating_mul(2);
        let target = wanted
            .max(self.position.saturating_sub(slack))
            .min(self.position.saturating_add(slack));
        if target != wanted {
            self.counters.held_back_ticks = self.counters.held_back_ticks.saturating_add(1);
        }
        let ends = p.travel_min.to_bits()..=p.travel_max.to_bits();
        if ends.contains(&target) {
            self.target = target;
        } else {
            self.velocity = 0;
        }
    }

    fn rest_before_deciding(&mut self) {
        self.phase = Phase::Settling;
        self.waited = 0;
    }

    /// Coarse or fine, from rest.
    fn decide(&mut self) {
        if self.error().unsigned_abs() > self.parameters.reach.to_bits().unsigned_abs() {
            self.begin_tooth();
        } else {
            self.begin_fine();
        }
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
    fn begin_tooth(&mut self) {
        self.forward = self.error() >= 0;
        let [from, aim] = self.ends();
        let p = &self.parameters;
        self.whole = self.code == from;
        self.tooth_from = self.position;
        self.flank = Flank::new(self.code, aim, self.span(), p.slow_ticks, p.curvature);
        self.counters.teeth = self.counters.teeth.saturating_add(1);
        self.phase = Phase::SlowFlank;
        self.apply(self.code);
    }

    fn step_flank(&mut self) {
        let wanted = self.flank.next_code();
        self.apply(wanted);
        if !self.flank.has_ended(self.code) {
            return;
        }
        if self.phase == Phase::SlowFlank {
            let [aim, _] = self.ends();
            self.flank = Flank::new(self.code, aim, self.span(), self.parameters.fast_ticks, 0);
            self.phase = Phase::FastFlank;
        } else {
            self.end_tooth();
        }
    }

    fn end_tooth(&mut self) {
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
            let at_end = self.is_near_end();
            self.stop(if at_end {
                SteppingFault::EndStop
            } else {
                SteppingFault::Stalled
            });
            return;
        }
        if self.velocity != 0 {
            self.phase = Phase::Holding;
        } else if self.error().saturating_mul(sign) > self.parameters.reach.to_bits() {
            self.begin_tooth();
        } else {
            self.rest_before_deciding();
        }
    }

    /// Lets the law take over from position and drive as they stand.
    fn begin_fine(&mut self) {
        let target_count = self.count_at(self.target);
        let here = EncoderCount(self.count_at(self.position));
        self.look_about(target_count, here);
        self.guard.begin_loop();
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
        self.servo.enable();
        (self.at_limit, self.arrived_for) = (0, 0);
        self.limited_before = self.servo.counters().limited_ticks;
        self.phase = Phase::Fine;
    }

    fn step_fine(&mut self) {
        let ahead = self.reference.next_value();
        let wanted = self.servo.tick(self.window_code, ahead);
        let (code, changed) = self.limit.pass(wanted);
        self.code = code;
        if changed {
            self.counters.limited_codes = self.counters.limited_codes.saturating_add(1);
            self.stop(SteppingFault::Guard(Fault::BeyondEnvelope));
            return;
        }
        let error = self
            .servo
            .reference()
            .saturating_sub(self.servo.sensed())
            .to_bits();
        let slewing = self.servo.slewing();
        let limited = self.servo.counters().limited_ticks;
        let is_limited = limited != self.limited_before;
        self.limited_before = limited;
        self.at_limit = if is_limited {
            self.at_limit.saturating_add(1)
        } else {
            0
        };
        let p = &self.parameters;
        let near = self.error().unsigned_abs() <= p.tolerance.to_bits().unsigned_abs();
        self.arrived_for = if near {
            self.arrived_for.saturating_add(1)
        } else {
            0
        };
        if self.at_limit > p.settle_ticks.saturating_add(p.fine_ticks) && !near {
            self.teeth_for_reach = self.teeth_for_reach.saturating_add(1);
            if self.teeth_for_reach > p.stall_teeth {
                let at_end = self.is_near_end();
                self.stop(if at_end {
                    SteppingFault::EndStop
                } else {
                    SteppingFault::Stalled
                });
            } else {
                self.begin_tooth();
            }
        } else if let Some(fault) = self.guard.inspect_loop(error, slewing) {
            self.stop(SteppingFault::Guard(fault));
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

    /// What the drive does.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// What stopped it.
    #[must_use]
    pub fn fault(&self) -> Option<SteppingFault> {
        self.fault
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

    /// The fine law.
    #[must_use]
    pub fn servo(&self) -> &ServoTick {
        &self.servo
    }

    /// The last tick for a trace: phase and fault are the flags.
    #[must_use]
    pub fn trace_sample(&self) -> TraceSample {
        let fault = self.fault.map_or(0, SteppingFault::number);
        TraceSample {
            tick: self.tick,
            adc_code: self.window_code,
            dac_code: self.code,
            reference: self.servo.reference().to_bits(),
            applied: self.servo.applied().to_bits(),
            unknown_input: self.servo.unknown_input(),
            flags: u16::from(self.phase as u8) | (u16::from(fault) << 8),
        }
    }
}

/// What of the parameters contradicts the servo's, or itself.
fn verify(servo: &ServoParameters, p: &SteppingParameters) -> Result<(), &'static str> {
    let c = &servo.converters;
    if !(c.dac_code_min <= p.low && p.low < p.high && p.high <= c.dac_code_max) {
        return Err(
            "ends of the teeth; expected two codes within the drive's limits, the lower first",
        );
    }
    if !(8..=20).contains(&c.adc_bits) {
        return Err("window of the fine law; expected 8 to 20 bits");
    }
    if !(1..1 << 46).contains(&p.encoder_step) || p.encoder_step != c.adc_step {
        return Err("step of the encoder; expected that of the fine law, above zero");
    }
    // um (40) -> um (24)
    let half_window = p
        .encoder_step
        .checked_mul(1 << (c.adc_bits - 1))
        .map(|wide| wide >> 16);
    let middle = half_window.map(|half| half.saturating_add(i64::from(c.adc_zero)));
    // The rounding of the step, over half the codes.
    if middle.is_none_or(|off| off.unsigned_abs() > 1 << 12) {
        return Err("zero of the fine law; expected the middle of its window");
    }
    let reach = i64::from(p.reach.to_bits()) << (MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS);
    if reach <= 0 || half_window.is_none_or(|half| 2 * reach > half) {
        return Err("reach; expected above zero and at most a quarter of the fine law's window");
    }
    if [p.slow_ticks, p.fast_ticks, p.fine_ticks, p.stall_teeth].contains(&0)
        || u32::from(p.curvature) > 1 << FLANK_FRACTION_BITS
    {
        return Err("flanks; expected ticks and teeth above zero and a curvature of at most 1");
    }
    let positive = [p.lead, p.least_step, p.tolerance];
    if positive.iter().any(|v| *v <= 0) || p.end_zone < 0 || p.travel_min >= p.travel_max {
        return Err(
            "travel; expected its lower end first, and lead, least step and tolerance above zero",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::parameter_block::tests::example;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// 1 nm with 40 fraction bits.
    const STEP: i64 = (1 << 40) / 1000;
    const NM: f64 = 1e-3;

    fn um(um: f64) -> Travel {
        Travel::saturating_from_num(um)
    }

    fn servo() -> ServoParameters {
        let mut servo = example().servo;
        servo.converters.adc_step = STEP;
        servo.converters.adc_zero = -((STEP << 15) >> 16) as i32;
        servo
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

    fn guard() -> GuardParameters {
        GuardParameters {
            stuck_ticks: 0,
            tracking_ticks: 2000,
            tracking_error: 20 << 24,
            ..example().guard
        }
    }

    fn drive_at(count: i32, stepping: SteppingParameters) -> SteppingTick {
        let servo = servo();
        let limit = OutputLimit::of_converters(&servo.converters, guard().rest_code);
        SteppingTick::new(servo, guard(), limit, stepping, EncoderCount(count)).unwrap()
    }

    /// A slider that follows its platform up to a speed, and stands still beyond; ends that it cannot pass.
    struct Rig {
        slider_um: f64,
        code: DriveCode,
        grips: bool,
        ends_um: [f64; 2],
    }

    impl Rig {
        fn at(slider_um: f64, tick: &SteppingTick) -> Self {
            Self {
                slider_um,
                code: tick.code,
                grips: true,
                ends_um: [-1e9, 1e9],
            }
        }

        fn count(&self) -> EncoderCount {
            EncoderCount((self.slider_um / NM).round() as i32)
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

    fn run(tick: &mut SteppingTick, rig: &mut Rig, ticks: usize) -> Vec<DriveCode> {
        (0..ticks)
            .map(|_| {
                let code = tick.tick(Some(rig.count()));
                rig.advance(code);
                code
            })
            .collect()
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
            let mut tick = drive_at((from / NM) as i32, stepping());
            let mut rig = Rig::at(from, &tick);
            tick.move_to(um(to)).unwrap();
            run(&mut tick, &mut rig, 60_000);
            let why = (tick.phase(), tick.fault(), tick.counters(), rig.slider_um);
            assert!(
                tick.has_arrived() && tick.fault().is_none(),
                "{from} to {to}: {why:?}"
            );
            assert!((rig.slider_um - to).abs() < 0.02, "{from} to {to}: {why:?}");
            assert_eq!(tick.counters().saturated_values, 0);
        }
    }

    #[test]
    fn no_change_of_phase_moves_the_drive() {
        let mut tick = drive_at(0, stepping());
        let mut rig = Rig::at(0.0, &tick);
        tick.move_to(um(60.0)).unwrap();
        let (mut phase, mut code) = (tick.phase(), tick.code);
        let mut changes = 0;
        let slowest = 400;
        for _ in 0..20_000 {
            let next = tick.tick(Some(rig.count()));
            rig.advance(next);
            if tick.phase() != phase && tick.phase() == Phase::Fine {
                changes += 1;
            }
            if phase != Phase::FastFlank && tick.phase() != Phase::FastFlank {
                let moved = next.abs_diff(code);
                assert!(
                    moved < slowest,
                    "{phase:?} to {:?}: {moved} codes",
                    tick.phase()
                );
            }
            (phase, code) = (tick.phase(), next);
        }
        assert!(changes > 0 && tick.has_arrived());
    }

    #[test]
    fn a_slider_that_does_not_move_is_a_stall() {
        let mut tick = drive_at(0, stepping());
        let mut rig = Rig::at(0.0, &tick);
        rig.grips = false;
        tick.move_to(um(500.0)).unwrap();
        let codes = run(&mut tick, &mut rig, 20_000);
        assert_eq!(tick.fault(), Some(SteppingFault::Stalled));
        assert_eq!(codes.last(), Some(&guard().rest_code));
        assert_eq!(tick.move_to(um(0.0)), Err(Refusal::Fault));
        assert!(tick.clear_fault() && tick.move_to(um(0.0)).is_ok());
    }

    #[test]
    fn an_end_of_the_travel_has_its_name() {
        let mut tick = drive_at(2_900_000, stepping());
        let mut rig = Rig::at(2900.0, &tick);
        assert_eq!(tick.move_to(um(3000.1)), Err(Refusal::BeyondTravel));
        rig.ends_um[1] = 2985.0;
        tick.move_to(um(3000.0)).unwrap();
        run(&mut tick, &mut rig, 40_000);
        assert_eq!(
            tick.fault(),
            Some(SteppingFault::EndStop),
            "{}",
            rig.slider_um
        );
    }

    #[test]
    fn a_silent_encoder_stops_the_drive() {
        let mut tick = drive_at(0, stepping());
        let mut rig = Rig::at(0.0, &tick);
        tick.move_to(um(500.0)).unwrap();
        run(&mut tick, &mut rig, 500);
        (0..2000).for_each(|_| {
            tick.tick(None);
        });
        assert_eq!(
            tick.fault(),
            Some(SteppingFault::Guard(Fault::SensorSilent))
        );
        assert_eq!(tick.trace_sample().dac_code, guard().rest_code);
        assert!(!tick.clear_fault(), "the sensor is not healthy yet");
    }

    #[test]
    fn a_moving_target_is_followed_at_its_velocity() {
        // 0.02 um a tick, 400 um/s at 20 kHz: below the teeth's 1000 um/s.
        for per_tick in [0.02, -0.011] {
            let mut tick = drive_at(0, stepping());
            let mut rig = Rig::at(0.0, &tick);
            tick.follow(Micrometres::from_num(per_tick)).unwrap();
            run(&mut tick, &mut rig, 10_000);
            let lag = rig.slider_um - 10_000.0 * per_tick;
            assert!(lag.abs() < 9.0, "{lag} um behind");
            assert_eq!(tick.counters().held_back_ticks, 0);
        }
        let mut tick = drive_at(0, stepping());
        let mut rig = Rig::at(0.0, &tick);
        tick.follow(Micrometres::from_num(0.2)).unwrap();
        run(&mut tick, &mut rig, 5_000);
        assert!(tick.counters().held_back_ticks > 1000);
    }

    #[test]
    fn parameters_that_contradict_one_another_are_refused() {
        let refused = |change: &dyn Fn(&mut SteppingParameters)| {
            let mut wrong = stepping();
            change(&mut wrong);
            verify(&servo(), &wrong).unwrap_err()
        };
        assert!(refused(&|p| p.low = p.high).contains("ends of the teeth"));
        assert!(refused(&|p| p.encoder_step += 1).contains("encoder"));
        assert!(refused(&|p| p.reach = um(17.0)).contains("reach"));
        assert!(refused(&|p| p.curvature = 0x8001).contains("curvature"));
        assert!(refused(&|p| p.travel_min = um(3001.0)).contains("travel"));
        let mut aside = servo();
        aside.converters.adc_zero += 1 << 20;
        assert!(verify(&aside, &stepping()).unwrap_err().contains("window"));
    }

    #[test]
    fn it_takes_little_memory_beside_its_servo() {
        let own = size_of::<SteppingTick>() - size_of::<ServoTick>();
        assert!(own < 512, "{own} bytes");
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
            let mut tick = drive_at(0, parameters);
            let c = servo().converters;
            let mut before = tick.code;
            let mut count = 0i32;
            for (value, kind, ticks) in orders {
                match kind {
                    0 => { let _ = tick.move_to(Travel::from_bits(value)); }
                    1 => { let _ = tick.follow(Micrometres::from_bits(value)); }
                    2 => { let _ = tick.move_to(um(f64::from(value % 3000))); }
                    3 => { tick.clear_fault(); }
                    4 => count = value,
                    _ => {}
                }
                for nth in 0..ticks {
                    count = count.wrapping_add(value % 50);
                    let reading = (kind != 5 || nth % 64 != 0).then_some(EncoderCount(count));
                    let code = tick.tick(reading);
                    prop_assert!((c.dac_code_min..=c.dac_code_max).contains(&code));
                    prop_assert!(code.abs_diff(before) <= c.slew_codes);
                    before = code;
                }
            }
        }
    }
}
