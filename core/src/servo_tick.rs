//! The control tick: ADC code in, DAC code out, once every sampling period.
//!
//! # How it works
//! [`ServoTick::tick`] reads the position, advances the reference window, runs the law, inverts the
//! hysteresis, limits, rounds to a DAC code, and then takes note of what this code really does to the
//! actuator: the drive after limits and rounding and, through the hysteresis model, the force-equivalent
//! displacement. The laws see these, never what they wished for.
//!
//! # Taking over
//! [`ServoTick::enable`] and [`ServoTick::swap`] let the next tick begin from the drive that is there: the
//! law's integrating state is set so that its first output is that drive, and a difference between reference
//! and position becomes a decaying offset. [`ServoTick::exchange`] lets another law of a running loop go on
//! from where the last one was, in motion too. Every drive that is applied while the servo is off must pass
//! [`ServoTick::open_loop`], so that the memory of the hysteresis and the creep are kept.
//!
//! # Periodic references
//! With [`ServoParameters::learning`] a reference whose period is known ([`ServoTick::repeat`]) gets a
//! learned correction ([`crate::learned_feedforward`]). What the tick reports as the reference is without it.
//!
//! # A sensor that is late
//! The reference passes through the known lag of the sensor first ([`crate::sensor_lag`]), and everything
//! that a reading is compared with is that reference: what the law and the learning bring to zero, and what
//! the guard and the trace see, is then the error of the stage and not that of its picture.
//!
//! # A gain that is not the model's
//! With [`ServoParameters::adaptation`] the predictor law corrects the gain of its model slowly, within
//! bounds ([`crate::gain_adaptation`]). The gain that was learned stays until the parameters change.
//!
//! # Filters
//! Two notches and a low-pass on the set point and on the reading ([`crate::signal_filter`]) may be changed
//! while the loop runs ([`ServoTick::set_filter`]). They belong to the bench and not to the block: another
//! block leaves them as they are. They begin at rest when the loop is closed.
//!
//! # What is counted
//! [`Counters`]: ticks at a drive limit, ticks at which the wanted output was not reachable, values that left
//! their format.

use crate::codes::{DriveCode, SensorCode};
use crate::creep_inverse::CreepInverse;
use crate::gain_adaptation::GainAdaptation;
use crate::learned_feedforward::LearnedFeedforward;
use crate::one_sided_hysteresis::OneSidedHysteresis;
use crate::pid_regulator::PidRegulator;
use crate::predictor_law::PredictorLaw;
use crate::reference_window::ReferenceWindow;
use crate::servo_parameters::{
    ActuatorParameters, ConverterParameters, LawParameters, ServoParameters,
};
use crate::signal::{Micrometres, SHARE_FRACTION_BITS, Volts, narrow, saturate};
use crate::signal_filter::{FilteredSignal, Place, SectionRow, SignalFilter, step_both};
use crate::sliding_mode_controller::{Reaching, SlidingModeController};
use crate::state_estimator::StateEstimator;

/// What the tick counts. Counters stop at their largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Ticks at which the drive was held at a limit of the actuator or at the slew limit, unreachable ones
    /// included.
    pub limited_ticks: u32,
    /// Ticks at which the wanted displacement was outside what the hysteresis can give.
    pub unreachable_ticks: u32,
    /// Values that left their format and were held at its end. Zero in normal running.
    pub saturated_values: u32,
}

#[derive(Clone, Debug)]
enum LawState {
    Off,
    Fresh,
    Regulator(PidRegulator),
    SlidingMode(StateEstimator, SlidingModeController),
    Predictor(PredictorLaw),
}

/// The servo with all its state.
// In this order: what every tick reads is near the beginning, where an instruction reaches it; what is
// learned takes kilobytes and stands last.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct ServoTick {
    /// The newest code and its drive, V.
    code: DriveCode,
    drive: i32,
    /// Force-equivalent displacement of the newest drive, um (V for a direct actuator), and of the one
    /// before.
    applied: i32,
    applied_before: i32,
    rounding_error: i32,
    /// Sign of the limit at which the drive is held, or beyond which the hysteresis cannot reach.
    limited: i32,
    /// The last code is as far from the one before as the slew limit allows, and the law wanted more.
    slewing: bool,
    /// Something is learned: a correction, or the gain.
    learns: bool,
    /// A section of a filter is on.
    filters: bool,
    /// The reading as the converter gave it, and behind the filter.
    sensed: i32,
    reading: i32,
    counters: Counters,
    window: ReferenceWindow,
    law: LawState,
    parameters: ServoParameters,
    hysteresis: Option<OneSidedHysteresis>,
    /// Creep of everything that was applied, for a law that undoes it.
    creep: CreepInverse,
    adaptation: GainAdaptation,
    /// Of the set point and of the reading.
    set_point: SignalFilter,
    sensor: SignalFilter,
    learner: LearnedFeedforward,
}

impl ServoTick {
    /// A servo that is off, with the actuator virgin at its lower limit.
    #[must_use]
    pub fn new(parameters: ServoParameters) -> Self {
        let hysteresis = match &parameters.actuator {
            ActuatorParameters::OneSidedHysteresis { surfaces, .. } => {
                Some(OneSidedHysteresis::virgin(*surfaces))
            }
            _ => None,
        };
        let mut this = Self {
            parameters,
            law: LawState::Off,
            window: ReferenceWindow::at_rest(0),
            learner: LearnedFeedforward::off(),
            adaptation: GainAdaptation::off(),
            set_point: SignalFilter::OFF,
            sensor: SignalFilter::OFF,
            hysteresis,
            creep: CreepInverse::default(),
            code: parameters.converters.dac_code_min,
            drive: 0,
            applied: 0,
            applied_before: 0,
            rounding_error: 0,
            limited: 0,
            slewing: false,
            learns: false,
            filters: false,
            sensed: 0,
            reading: 0,
            counters: Counters::default(),
        };
        this.begin_adaptation();
        this.note(parameters.converters.dac_code_min);
        this.begin_creep();
        this
    }

    /// Switches the servo off and applies a code: conditioning, identification. Returns the code within the
    /// limits.
    pub fn open_loop(&mut self, code: DriveCode) -> DriveCode {
        self.law = LawState::Off;
        self.note(
            code.max(self.parameters.converters.dac_code_min)
                .min(self.parameters.converters.dac_code_max),
        );
        self.creep_on();
        self.code
    }

    /// Creep at rest under what is applied.
    fn begin_creep(&mut self) {
        if let LawParameters::Regulator(law) = &self.parameters.law {
            self.creep = CreepInverse::applied_for_ever(&law.creep, self.applied);
        }
    }

    /// One period of creep under what is applied: it stands then where the next code begins to act.
    #[inline]
    fn creep_on(&mut self) {
        if let LawParameters::Regulator(law) = &self.parameters.law {
            self.creep.follow(
                &law.creep,
                self.applied,
                &mut self.counters.saturated_values,
            );
        }
    }

    /// Whether a law undoes the creep that the present one follows.
    fn follows_creep_of(&self, law: &LawParameters) -> bool {
        match (&self.parameters.law, law) {
            (LawParameters::Regulator(before), LawParameters::Regulator(after)) => {
                before.creep == after.creep
            }
            (_, LawParameters::Regulator(after)) => after.creep.is_off(),
            _ => true,
        }
    }

    /// Lets the law take over at the next tick, from the drive and the position that it finds.
    pub fn enable(&mut self) {
        if matches!(self.law, LawState::Off) {
            // Of the last tick of another loop.
            (self.rounding_error, self.limited, self.slewing) = (0, 0, false);
        }
        self.law = LawState::Fresh;
        self.learner.restart();
        self.adaptation.wait();
        self.set_point.restart();
        self.sensor.restart();
        self.filters = !self.set_point.is_off() || !self.sensor.is_off();
    }

    /// Changes a section of a filter without a step of the drive. Call it between ticks.
    #[inline(never)]
    pub fn set_filter(&mut self, signal: FilteredSignal, place: Place, row: &SectionRow) {
        match signal {
            FilteredSignal::SetPoint => self.set_point.set(place, row),
            FilteredSignal::Sensor => self.sensor.set(place, row),
        }
        self.filters = true;
    }

    /// The reading and the reference ahead, filtered.
    #[inline(always)]
    fn filter(&mut self, reading: i32, ahead: i32) -> (i32, i32) {
        let filtered = step_both(
            &mut self.sensor,
            &mut self.set_point,
            reading,
            ahead,
            &mut self.counters.saturated_values,
        );
        self.filters = !self.set_point.is_off() || !self.sensor.is_off();
        filtered
    }

    /// Tells the period of the references from the next [`Self::enable`] on, ticks; `None`: they do not
    /// repeat. Without parameters for it nothing is learned.
    pub fn repeat(&mut self, period_ticks: Option<u32>) {
        self.learner
            .begin(period_ticks.filter(|_| self.parameters.learning.is_some()));
        self.note_learning();
    }

    /// Believes the model of the law, if its gain is to be adapted.
    fn begin_adaptation(&mut self) {
        let law = match &self.parameters.law {
            LawParameters::Predictor(law) => self.parameters.adaptation.map(|_| law),
            _ => None,
        };
        self.adaptation.begin(law);
        self.note_learning();
    }

    fn note_learning(&mut self) {
        self.learns = self.adaptation.is_on() || self.learner.period_ticks().is_some();
    }

    /// Whether an alarm forbids to learn the gain.
    #[inline]
    pub fn hold_adaptation(&mut self, held: bool) {
        self.adaptation.hold(held);
    }

    /// Changes all parameters; a running law takes over at the next tick. Evaluates the memory of the
    /// hysteresis again if its surfaces change: call it between ticks.
    pub fn swap(&mut self, parameters: ServoParameters) {
        if parameters.actuator != self.parameters.actuator {
            self.hysteresis = match (&parameters.actuator, &self.hysteresis) {
                (ActuatorParameters::OneSidedHysteresis { surfaces, .. }, Some(memory)) => {
                    Some(memory.with_surfaces(*surfaces))
                }
                (ActuatorParameters::OneSidedHysteresis { surfaces, .. }, None) => {
                    Some(OneSidedHysteresis::virgin(*surfaces))
                }
                _ => None,
            };
        }
        let running = !matches!(self.law, LawState::Off);
        let same_creep = self.follows_creep_of(&parameters.law);
        self.parameters = parameters;
        self.begin_adaptation();
        self.note(self.code);
        if !same_creep {
            self.begin_creep();
        }
        if running {
            self.enable();
        }
    }

    /// Takes another zero of the sensor while the loop is open: what a swap of parameters does that differ in
    /// nothing else, without looking at them. A conditioning ends with it, within a period.
    pub fn zero_sensor(&mut self, adc_zero: i32) {
        self.parameters.converters.adc_zero = adc_zero;
        self.begin_adaptation();
        self.note(self.code);
    }

    /// Changes all parameters of a running loop without a step of the drive or of the reference: the new law
    /// goes on from the last output as from its own, the reference, what was learned of it and the sensor's
    /// zero stay. Only between parameters that [`crate::block_swap`] allows; call it between ticks.
    // In place: the interrupt's stack has no room for a second set of parameters.
    pub fn exchange(&mut self, parameters: &ServoParameters) {
        if parameters.actuator != self.parameters.actuator {
            if let (ActuatorParameters::OneSidedHysteresis { surfaces, .. }, Some(memory)) =
                (&parameters.actuator, &self.hysteresis)
            {
                self.hysteresis = Some(memory.with_surfaces(*surfaces));
            }
            self.parameters.actuator = parameters.actuator;
        }
        self.parameters.converters = ConverterParameters {
            adc_zero: self.parameters.converters.adc_zero,
            ..parameters.converters
        };
        // What the drive of now does by the new model; it is no newer drive.
        let (was, before) = (self.applied, self.applied_before);
        self.note(self.code);
        self.applied_before = before;
        let shift = self.applied.saturating_sub(was);
        let same_creep = self.follows_creep_of(&parameters.law);
        if let (false, LawParameters::Regulator(law)) = (same_creep, &parameters.law) {
            self.creep = CreepInverse::applied_for_ever(&law.creep, self.applied);
        }
        let (saturated, window) = (&mut self.counters.saturated_values, &self.window);
        match (&mut self.law, &mut self.parameters.law, &parameters.law) {
            (LawState::Off, ..) => {}
            (
                LawState::Regulator(law),
                LawParameters::Regulator(before),
                LawParameters::Regulator(after),
            ) => {
                let creep = self.creep.creep(&after.creep, saturated);
                law.go_on(before, after, window, shift, creep, saturated);
            }
            (
                LawState::Predictor(law),
                LawParameters::Predictor(before),
                LawParameters::Predictor(after),
            ) => {
                // Dynamics are compared as the blocks have them.
                if self.adaptation.is_on() {
                    before.set_drive_column(&self.adaptation.base().drive);
                }
                law.go_on(before, after, window, shift, saturated);
            }
            (law, ..) => *law = LawState::Fresh,
        }
        self.parameters.law = parameters.law;
        self.parameters.delayed = parameters.delayed;
        if parameters.sensor_lag != self.parameters.sensor_lag {
            self.window.change_lag(&parameters.sensor_lag);
            self.parameters.sensor_lag = parameters.sensor_lag;
        }
        self.parameters.learning = parameters.learning;
        self.parameters.adaptation = parameters.adaptation;
        self.begin_adaptation();
    }

    /// One period: the reading now and the reference [`crate::reference_window::PREVIEW_TICKS`] samples ahead
    /// (um with 24 fraction bits). Returns the code to apply.
    #[inline]
    pub fn tick(&mut self, adc_code: SensorCode, reference_ahead: Micrometres) -> DriveCode {
        let ahead = reference_ahead.to_bits();
        if self.learns {
            self.tick_and_learn(adc_code, ahead)
        } else {
            self.follow(adc_code, ahead, 0)
        }
    }

    /// [`Self::follow`] with what is learned: apart, so that a tick that learns nothing pays for the question
    /// only.
    #[inline(never)]
    fn tick_and_learn(&mut self, adc_code: SensorCode, ahead: i32) -> DriveCode {
        let entering = self.learner.enter();
        let code = self.follow(adc_code, ahead, entering);
        if let Some(learning) = &self.parameters.learning {
            let asked = self.window.now().saturating_sub(self.learner.present());
            let trusted = self.limited == 0 && !self.slewing;
            self.learner.learn(
                learning,
                asked.saturating_sub(self.reading),
                trusted,
                &mut self.counters.saturated_values,
            );
        }
        if self.adaptation.is_on() {
            self.adapt();
        }
        code
    }

    /// Looks at what the law did in this tick, and takes the gain that was learned.
    #[inline(never)]
    fn adapt(&mut self) {
        if let Some(bounds) = &self.parameters.adaptation
            && let (LawState::Predictor(law), LawParameters::Predictor(parameters)) =
                (&mut self.law, &mut self.parameters.law)
        {
            let error = self.window.now().saturating_sub(self.reading);
            let trusted =
                self.limited == 0 && !self.slewing && error.saturating_abs() <= bounds.error_limit;
            if let Some(coefficients) =
                self.adaptation
                    .observe(bounds, law.unknown_input(), law.feedforward(), trusted)
            {
                law.rescale(
                    parameters,
                    coefficients,
                    &self.window,
                    &mut self.counters.saturated_values,
                );
            }
        }
    }

    /// One period towards a reference and its correction.
    // By itself the compiler keeps products of 32 bits; inlined into an interrupt with a static state it
    // widens them and reloads every address.
    #[inline(never)]
    fn follow(&mut self, adc_code: SensorCode, ahead: i32, correction: i32) -> DriveCode {
        let mut signals = (self.parameters.converters.position(adc_code), ahead);
        self.sensed = signals.0;
        if self.filters {
            signals = self.filter(signals.0, signals.1);
        }
        let (reading, ahead) = signals;
        self.reading = reading;
        if matches!(self.law, LawState::Fresh) {
            self.window.restart(reading, ahead);
        }
        self.window
            .push(&self.parameters.sensor_lag, ahead, correction);
        match self.run_law(reading) {
            None => self.note(self.code),
            Some(command) => {
                let (drive, unreachable) = self.drive_for(command);
                self.convert(drive, unreachable);
            }
        }
        self.creep_on();
        self.code
    }

    /// The law's output, um or V; `None` while it is off.
    #[inline]
    fn run_law(&mut self, reading: i32) -> Option<i32> {
        let saturated = &mut self.counters.saturated_values;
        match (&self.parameters.law, &mut self.law) {
            (LawParameters::Hold, _) | (_, LawState::Off) => None,
            (LawParameters::Regulator(parameters), LawState::Regulator(regulator)) => {
                let creep = self.creep.creep(&parameters.creep, saturated);
                Some(regulator.output(
                    parameters,
                    reading,
                    &self.window,
                    self.limited,
                    creep,
                    saturated,
                ))
            }
            (
                LawParameters::SlidingMode {
                    estimator,
                    controller,
                },
                LawState::SlidingMode(states, law),
            ) => {
                let acted = if self.parameters.delayed {
                    self.applied_before
                } else {
                    self.applied
                };
                states.update(estimator, reading, acted, saturated);
                Some(law.drive(
                    controller,
                    states,
                    self.applied,
                    &self.window,
                    self.limited,
                    saturated,
                ))
            }
            (LawParameters::Predictor(parameters), LawState::Predictor(law)) => {
                Some(law.output(parameters, reading, self.applied, &self.window, saturated))
            }
            (parameters, _) => {
                self.law = begin(
                    parameters,
                    reading,
                    self.applied,
                    &self.creep,
                    &self.window,
                    saturated,
                );
                None
            }
        }
    }

    /// The drive for a law's output, V, and the sign of the direction in which the output is out of reach.
    #[inline]
    fn drive_for(&mut self, command: i32) -> (i32, i32) {
        match &self.parameters.actuator {
            ActuatorParameters::Direct => (command, 0),
            ActuatorParameters::Linear {
                volts_per_micrometre,
                ..
            } => {
                // um (24) * V/um (20) -> V (22)
                let wide = (i64::from(command) * i64::from(*volts_per_micrometre)) >> 22;
                (saturate(wide, &mut self.counters.saturated_values), 0)
            }
            ActuatorParameters::OneSidedHysteresis {
                drive_min,
                drive_range,
                ..
            } => {
                let Some(hysteresis) = &self.hysteresis else {
                    return (*drive_min, 0);
                };
                let inverse = hysteresis.inverse(command);
                let mut unreachable = 0;
                if !inverse.reachable {
                    unreachable = if command > hysteresis.output() { 1 } else { -1 };
                    self.counters.unreachable_ticks =
                        self.counters.unreachable_ticks.saturating_add(1);
                }
                let above =
                    (i64::from(inverse.share) * i64::from(*drive_range)) >> SHARE_FRACTION_BITS;
                (drive_min.saturating_add(narrow(above)), unreachable)
            }
        }
    }

    /// Rounds a drive to a code within the limits, and takes note of what it does.
    #[inline]
    fn convert(&mut self, drive: i32, unreachable: i32) {
        let c = &self.parameters.converters;
        let wanted = if c.noise_shaping {
            drive.saturating_add(self.rounding_error)
        } else {
            drive
        };
        let code = c.steps(wanted);
        let (within, reached) = limit(c, self.code, code);
        self.slewing = reached != within;
        self.limited = i32::from(code > reached) - i32::from(code < reached);
        if self.limited == 0 {
            self.limited = unreachable;
        }
        if self.limited != 0 {
            self.counters.limited_ticks = self.counters.limited_ticks.saturating_add(1);
        }
        self.note(DriveCode::known(reached));
        self.rounding_error = if self.limited == 0 {
            wanted.saturating_sub(self.drive)
        } else {
            0
        };
    }

    /// Takes note of a code that will act.
    #[inline]
    fn note(&mut self, code: DriveCode) {
        let c = &self.parameters.converters;
        let drive = c.drive(code);
        self.code = code;
        self.drive = drive;
        self.applied_before = self.applied;
        self.applied = match &self.parameters.actuator {
            ActuatorParameters::Direct => drive,
            ActuatorParameters::Linear {
                micrometres_per_volt,
                ..
            } => {
                // V (22) * um/V (28) -> um (24)
                saturate(
                    (i64::from(drive) * i64::from(*micrometres_per_volt)) >> 26,
                    &mut self.counters.saturated_values,
                )
            }
            ActuatorParameters::OneSidedHysteresis {
                drive_min,
                share_per_volt,
                ..
            } => {
                // V (22) * 1/V (32) -> share (30)
                let share = (i64::from(drive.saturating_sub(*drive_min)) * *share_per_volt) >> 24;
                let within = if share < 0 {
                    0
                } else {
                    share.min(1 << SHARE_FRACTION_BITS) as i32
                };
                self.hysteresis.as_mut().map_or(0, |h| h.apply(within))
            }
        };
    }

    /// The code that acts, and the lowest and the highest one.
    #[must_use]
    pub fn code_in_range(&self) -> [DriveCode; 3] {
        let c = &self.parameters.converters;
        [self.code, c.dac_code_min, c.dac_code_max]
    }

    /// Position at the last tick as the converter gave it, without the filter of the sensor.
    #[must_use]
    pub fn sensed(&self) -> Micrometres {
        Micrometres::from_bits(self.sensed)
    }

    /// Position at the last tick.
    #[must_use]
    pub fn reading(&self) -> Micrometres {
        Micrometres::from_bits(self.reading)
    }

    /// Reference at the last tick, without what was learned: what the reading is to be, so as late as the
    /// sensor is known to be.
    #[must_use]
    pub fn reference(&self) -> Micrometres {
        Micrometres::from_bits(self.window.now().saturating_sub(self.learner.present()))
    }

    /// The newest reference that was asked for, through the filter of the set point.
    #[must_use]
    pub fn asked(&self) -> Micrometres {
        Micrometres::from_bits(self.window.asked())
    }

    /// What the correction of the reference has learned.
    #[must_use]
    pub fn learner(&self) -> &LearnedFeedforward {
        &self.learner
    }

    /// The gain of the actuator over the model's, as it was learned; `None` where it is not.
    #[must_use]
    pub fn adaptation(&self) -> Option<&GainAdaptation> {
        self.adaptation.is_on().then_some(&self.adaptation)
    }

    /// Drive of the newest code.
    #[must_use]
    pub fn drive(&self) -> Volts {
        Volts::from_bits(self.drive)
    }

    /// Force-equivalent displacement of the newest drive; for a direct actuator the drive's raw number.
    #[must_use]
    pub fn applied(&self) -> Micrometres {
        Micrometres::from_bits(self.applied)
    }

    /// Estimated position and velocity times the period of a sliding-mode law.
    #[must_use]
    pub fn estimate(&self) -> Option<[Micrometres; 2]> {
        match &self.law {
            LawState::SlidingMode(estimator, _) => Some([
                Micrometres::from_bits(estimator.position()),
                Micrometres::from_bits(estimator.velocity_per_tick()),
            ]),
            _ => None,
        }
    }

    /// Errors `e1`, `e2 T` and switching function `q T` of a sliding-mode law.
    #[must_use]
    pub fn sliding(&self) -> Option<[Micrometres; 3]> {
        match &self.law {
            LawState::SlidingMode(_, law) => {
                let [e1, e2] = law.errors();
                Some([e1, e2, law.switching_function()].map(Micrometres::from_bits))
            }
            _ => None,
        }
    }

    /// Estimate of the unknown input, in um of force-equivalent displacement for the predictor (V for the
    /// PIDSMO).
    #[must_use]
    pub fn unknown_input(&self) -> i32 {
        match &self.law {
            LawState::Predictor(law) => law.unknown_input(),
            LawState::SlidingMode(estimator, _) => estimator.unknown_input(),
            _ => 0,
        }
    }

    /// Whether the law wanted a larger step of the drive than the slew limit allows, at the last tick.
    #[must_use]
    pub fn slewing(&self) -> bool {
        self.slewing
    }

    /// What was counted since the start or [`Self::reset_counters`].
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Sets the counters to zero.
    pub fn reset_counters(&mut self) {
        self.counters = Counters::default();
    }

    /// The hysteresis with its memory, where the actuator has one.
    #[must_use]
    pub fn hysteresis(&self) -> Option<&OneSidedHysteresis> {
        self.hysteresis.as_ref()
    }

    /// The reference around the last tick, um with 24 fraction bits.
    #[cfg(test)]
    pub(crate) fn feedforward_window(&self) -> [i32; crate::reference_window::WINDOW] {
        *self.window.positions()
    }

    /// What the notch of a regulator remembers, um with 24 fraction bits.
    #[cfg(test)]
    pub(crate) fn notch_memory(&self) -> [i32; 4] {
        if let LawState::Regulator(law) = &self.law {
            law.notch_memory()
        } else {
            [0; 4]
        }
    }

    /// The parameters in use.
    #[must_use]
    pub fn parameters(&self) -> &ServoParameters {
        &self.parameters
    }
}

/// The steps of a code within the range of the drive, and within the slew limit behind the code before too.
#[inline(always)]
fn limit(c: &ConverterParameters, before: DriveCode, code: i32) -> (i32, i32) {
    // At most 20 bits, and as many again: no sum leaves 32.
    let (before, slew) = (before.steps() as i32, c.slew_codes as i32);
    let within = code
        .max(c.dac_code_min.steps() as i32)
        .min(c.dac_code_max.steps() as i32);
    let reached = within.max(before - slew).min(before + slew);
    (within, reached)
}

/// A law that takes over: at this tick it leaves the drive as it is, at the next it begins.
fn begin(
    parameters: &LawParameters,
    reading: i32,
    applied: i32,
    creep: &CreepInverse,
    window: &ReferenceWindow,
    saturated: &mut u32,
) -> LawState {
    match parameters {
        LawParameters::Hold => LawState::Off,
        LawParameters::Regulator(parameters) => {
            let creep = creep.creep(&parameters.creep, saturated);
            LawState::Regulator(PidRegulator::take_over(
                parameters, reading, window, applied, creep, saturated,
            ))
        }
        LawParameters::SlidingMode { controller, .. } => {
            // At rest the equivalent control of a position is minus the drive that holds it, and what is
            // applied beyond that is held by the unknown input.
            let integral = applied.saturating_add(
                controller
                    .equivalent_control
                    .apply(&[reading, 0], saturated),
            );
            let estimator = StateEstimator::at_rest(reading, integral);
            let mut law = SlidingModeController::default();
            if matches!(controller.reaching, Reaching::Pid { .. }) {
                let first = law.drive(controller, &estimator, applied, window, 0, saturated);
                law.take_over(applied, first);
            }
            LawState::SlidingMode(estimator, law)
        }
        LawParameters::Predictor(parameters) => {
            let feedforward = parameters.feedforward.apply(window.positions(), saturated);
            LawState::Predictor(PredictorLaw::take_over(applied, feedforward))
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::parameter_block::tests::example;
    use crate::servo_parameters::NO_SLEW_LIMIT;
    use std::vec::Vec;

    /// One tick of the closed loop, from every code within the range: the next one is within the range, no
    /// further away than the slew limit, and the wanted one where both allow it.
    ///
    /// [`limit`] picks one of five numbers by their order. Codes of 5 bits have every order of them, and the
    /// ends of 20 bits every sum that could leave its format.
    #[test]
    fn the_closed_loop_keeps_range_and_slew_from_every_code() {
        let mut c = example().servo.converters;
        let mut tick = |[low, before, high]: [u32; 3], slew: u32, code: i32| {
            (c.dac_code_min, c.dac_code_max) = (DriveCode::new(low), DriveCode::new(high));
            c.slew_codes = slew;
            let (within, reached) = limit(&c, DriveCode::new(before), code);
            let range = low as i32..=high as i32;
            let step = reached.abs_diff(before as i32);
            let is_reached = range.contains(&code) && code.abs_diff(before as i32) <= slew;
            assert!(
                range.contains(&within)
                    && range.contains(&reached)
                    && step <= slew
                    && (reached == code) == is_reached,
                "{before} to {reached}: {code} within {range:?}, slew {slew}"
            );
        };
        for before in 0..32 {
            for (low, high) in
                (0..=before).flat_map(|low| (before..32).map(move |high| (low, high)))
            {
                for slew in 1..=32 {
                    (-2..34).for_each(|code| tick([low, before, high], slew, code));
                }
            }
        }
        let most = DriveCode::MOST.steps();
        let ends: Vec<u32> = [0, 1, 2, most / 2, most - 2, most - 1, most].into();
        let codes = [i32::MIN, i32::MIN + 1, -1, i32::MAX - 1, i32::MAX];
        for before in ends.iter().copied() {
            for low in ends.iter().copied().filter(|low| *low <= before) {
                for high in ends.iter().copied().filter(|high| *high >= before) {
                    for slew in ends.iter().copied().chain([NO_SLEW_LIMIT]).skip(1) {
                        let inside = ends.iter().map(|code| *code as i32);
                        inside
                            .chain(codes)
                            .for_each(|code| tick([low, before, high], slew, code));
                    }
                }
            }
        }
    }
}
