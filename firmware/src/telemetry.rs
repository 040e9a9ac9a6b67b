//! What the tasks know of the samples that pass by: for how long the tracking error has been small, and how
//! well the closed loop followed over the last second.
//!
//! All of it is made in the trace task, from the samples that the control interrupt gives away: the task runs
//! below every interrupt, and its floats are not the tick's. Where it comes so late that the queue overflows,
//! a second has a gap: the task drops it and counts it.

use core::cell::{Cell, RefCell};

use embassy_sync::blocking_mutex::ThreadModeMutex;
use hysteron_core::amplifier::{Mode, Status};
use hysteron_core::command_limits;
use hysteron_core::guard::GuardParameters;
use hysteron_core::loop_telemetry::{LoopFigures, LoopTelemetry, ResonanceWatch};
use hysteron_core::parameter_block::AmplifierParameters;
use hysteron_core::servo_parameters::ConverterParameters;
use hysteron_core::signal::{
    MICROMETRE_FRACTION_BITS, Micrometres, Quantity, TRAVEL_FRACTION_BITS, Volts,
};
use hysteron_core::stepping_parameters::IfStepping;
use hysteron_core::trace_frame::TraceSample;

use crate::board::SAMPLE_RATE_HZ;
use crate::control;

#[derive(Clone, Copy)]
struct Telemetry {
    converters: Option<ConverterParameters>,
    tolerance: i32,
    /// There, where samples are those of a stick-slip drive.
    travels: IfStepping<()>,
    on_target_ticks: u32,
    guard: Option<GuardParameters>,
    drive_limits: (Volts, Volts),
    railed_ticks: u32,
    limited_ticks: u32,
}

static TELEMETRY: ThreadModeMutex<Cell<Telemetry>> = ThreadModeMutex::new(Cell::new(Telemetry {
    converters: None,
    tolerance: 0,
    travels: IfStepping::NONE,
    on_target_ticks: 0,
    guard: None,
    drive_limits: (Volts::ZERO, Volts::ZERO),
    railed_ticks: 0,
    limited_ticks: 0,
}));

static LOOP: ThreadModeMutex<RefCell<LoopTelemetry>> =
    ThreadModeMutex::new(RefCell::new(LoopTelemetry::new(SAMPLE_RATE_HZ)));

fn change(change: impl FnOnce(&mut Telemetry)) {
    TELEMETRY.lock(|place| {
        let mut telemetry = place.get();
        change(&mut telemetry);
        place.set(telemetry);
    });
}

/// Takes the scale of the converters and the limits of the sensor.
pub fn begin(parameters: &AmplifierParameters) {
    change(|telemetry| {
        telemetry.converters = Some(parameters.servo.converters);
        telemetry.guard = Some(parameters.guard);
        telemetry.drive_limits = command_limits::drives(parameters);
        if parameters.stepping.get().is_some() {
            telemetry.travels = IfStepping::new(());
        }
    });
}

/// The limits of references, nm, and of drives, mV, as they are now: lowest and highest.
pub fn limits() -> ((i32, i32), (i32, i32)) {
    let telemetry = TELEMETRY.lock(Cell::get);
    let positions = match (telemetry.converters, telemetry.guard) {
        (Some(converters), Some(guard)) => command_limits::positions(
            &ConverterParameters {
                adc_zero: control::zero(),
                ..converters
            },
            &guard,
        ),
        _ => (Micrometres::ZERO, Micrometres::ZERO),
    };
    (thousandths(positions), thousandths(telemetry.drive_limits))
}

/// Thousandths of limits, to the nearest: nm or mV.
fn thousandths<Q: Quantity>((lowest, highest): (Q, Q)) -> (i32, i32) {
    let nearest = |value: Q| {
        ((i64::from(value.bits()) * 1000 + (1 << (Q::FRACTION_BITS - 1))) >> Q::FRACTION_BITS)
            as i32
    };
    (nearest(lowest), nearest(highest))
}

/// Ticks since the start at which the sensor's code was at or beyond its limits, and ticks of the closed loop
/// at which the drive was at a limit.
pub fn railed_and_limited_ticks() -> (u32, u32) {
    let telemetry = TELEMETRY.lock(Cell::get);
    (telemetry.railed_ticks, telemetry.limited_ticks)
}

/// From now on a tracking error up to this is small, um with 24 fraction bits, or 16 of a stick-slip drive.
pub fn set_tolerance(tolerance: i32) {
    change(|telemetry| (telemetry.tolerance, telemetry.on_target_ticks) = (tolerance, 0));
}

/// Looks at the next sample.
pub fn observe(sample: &TraceSample) {
    change(|telemetry| {
        let (Some(converters), Some(guard)) = (telemetry.converters, telemetry.guard) else {
            return;
        };
        if sample.adc_code <= guard.adc_code_min || sample.adc_code >= guard.adc_code_max {
            telemetry.railed_ticks = telemetry.railed_ticks.saturating_add(1);
        }
        let mode = Status::from_flags(sample.flags).mode;
        let limited = sample.dac_code <= converters.dac_code_min
            || sample.dac_code >= converters.dac_code_max;
        if limited && mode == Mode::Closed {
            telemetry.limited_ticks = telemetry.limited_ticks.saturating_add(1);
        }
        let converters = ConverterParameters {
            adc_zero: control::zero(),
            ..converters
        };
        let (error, error_24) = match telemetry.travels.get() {
            None => {
                let position = converters.position(sample.adc_code);
                let error = sample.reference.saturating_sub(position);
                (error, error)
            }
            Some(()) => {
                let error = sample.reference.saturating_sub(sample.applied);
                let more = MICROMETRE_FRACTION_BITS - TRAVEL_FRACTION_BITS;
                (error, error.saturating_mul(1 << more))
            }
        };
        let small = mode == Mode::Closed && error.saturating_abs() <= telemetry.tolerance;
        telemetry.on_target_ticks = if small {
            telemetry.on_target_ticks.saturating_add(1)
        } else {
            0
        };
        measure(sample, error_24, converters.drive(sample.dac_code));
    });
}

/// Takes a sample to the figures of the closed loop, and says when its resonance begins to ring.
fn measure(sample: &TraceSample, error: i32, drive: i32) {
    LOOP.lock(|telemetry| {
        let mut telemetry = telemetry.borrow_mut();
        if Status::from_flags(sample.flags).mode != Mode::Closed {
            telemetry.begin();
        } else if telemetry.take(sample.tick, error, drive) == Some(true) {
            say_resonance(telemetry.watch(), telemetry.figures());
        }
        control::hold_adaptation(telemetry.figures().alarm);
    });
}

fn say_resonance(watch: ResonanceWatch, figures: LoopFigures) {
    let nearest = |thousandths: u32| thousandths.saturating_add(500) / 1000;
    let (hz, nm, alarm_nm) = (
        nearest(watch.frequency_millihertz),
        nearest(figures.resonance_pm),
        nearest(watch.alarm_pm),
    );
    if figures.alarm {
        defmt::warn!(
            "amplitude at {=u32} Hz is {=u32} nm, above the alarm of {=u32} nm",
            hz,
            nm,
            alarm_nm
        );
    } else {
        defmt::info!(
            "amplitude at {=u32} Hz is {=u32} nm, alarm {=u32} nm",
            hz,
            nm,
            alarm_nm
        );
    }
}

/// Says what the last second of the closed loop came to.
pub fn say_loop() {
    let (watch, figures) = (resonance_watch(), loop_figures());
    defmt::info!(
        "last second of the closed loop: error {=u32} pm RMS, {=u32} pm peak, drive {=u32} uV RMS, {=u32} pm at {=u32} mHz; {=u32} seconds, {=u32} abandoned",
        figures.error_rms_pm,
        figures.error_peak_pm,
        figures.drive_rms_uv,
        figures.resonance_pm,
        watch.frequency_millihertz,
        figures.windows,
        figures.torn_windows
    );
    if watch.frequency_millihertz > 0 {
        say_resonance(watch, figures);
    }
}

/// What the last second of the closed loop came to.
pub fn loop_figures() -> LoopFigures {
    LOOP.lock(|telemetry| telemetry.borrow().figures())
}

/// Which resonance is listened to.
pub fn resonance_watch() -> ResonanceWatch {
    LOOP.lock(|telemetry| telemetry.borrow().watch())
}

/// Listens to another one.
pub fn listen(watch: ResonanceWatch) -> Result<(), &'static str> {
    LOOP.lock(|telemetry| telemetry.borrow_mut().listen(watch))
}

/// For how many ticks the tracking error has been small.
pub fn on_target_ticks() -> u32 {
    TELEMETRY.lock(Cell::get).on_target_ticks
}
