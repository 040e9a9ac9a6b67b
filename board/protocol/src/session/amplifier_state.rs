//! What is known of the amplifier: position, reference, range, and what is under way.

use hysteron_core::amplifier::Mode;
use hysteron_core::servo_parameters::ConverterParameters;

use hysteron_core::signal::VOLT_FRACTION_BITS;

use super::{Generator, Session};
use crate::decimal::to_fixed;
use crate::device::{Device, View};

impl<D: Device + 'static> Session<D> {
    pub(super) fn converters(&self, view: &View) -> ConverterParameters {
        ConverterParameters {
            adc_zero: view.adc_zero,
            ..self.parameters.servo.converters
        }
    }

    pub(super) fn position_now(&self, view: &View) -> i32 {
        view.travel
            .unwrap_or_else(|| self.converters(view).position(view.adc_code))
    }

    /// The reference now. The sample that is known may be from before the last command, hence not beyond the
    /// way to the target.
    pub(super) fn reference_now(&self, view: &View) -> i32 {
        if self.runs() {
            return view.reference;
        }
        if let Some(position) = view.travel {
            return position;
        }
        view.reference
            .max(self.from.min(self.target))
            .min(self.from.max(self.target))
    }

    /// The lowest and highest position that the sensor can honestly give, or those of the travel.
    pub(super) fn range(&self, view: &View) -> (i32, i32) {
        if let Some(stepping) = self.parameters.stepping.get() {
            return (stepping.travel_min.to_bits(), stepping.travel_max.to_bits());
        }
        let (c, guard) = (self.converters(view), &self.parameters.guard);
        (
            c.position(guard.adc_code_min),
            c.position(guard.adc_code_max),
        )
    }

    pub(super) fn is_within_range(&self, position: i32) -> bool {
        let (lowest, highest) = self.range(&self.device.view());
        (lowest..=highest).contains(&position)
    }

    /// Whether a drive, V with 22 fraction bits, is within the limits of the block.
    pub(super) fn is_drive(&self, drive: i32) -> bool {
        let limit = |millivolts: i32| {
            to_fixed(i64::from(millivolts) * 1_000_000, VOLT_FRACTION_BITS).unwrap_or(0)
        };
        let physical = &self.parameters.physical;
        (limit(physical.drive_min_mv)..=limit(physical.drive_max_mv)).contains(&drive)
    }

    pub(super) fn closed(&self) -> bool {
        self.device.view().mode == Mode::Closed
    }

    /// Whether the wave generator runs.
    pub(super) fn runs(&self) -> bool {
        let view = self.device.view();
        matches!(view.mode, Mode::Closed | Mode::Playing)
            && match self.generator {
                Generator::Off => false,
                Generator::Endless => true,
                Generator::Until(tick) => view.tick < tick,
            }
    }

    pub(super) fn moves(&self) -> bool {
        let view = self.device.view();
        let travels = view.mode == Mode::Closed
            && self.parameters.stepping.get().is_some()
            && view.on_target_ticks < self.settling_ticks;
        let under_way = travels || self.moving_until.is_some_and(|until| view.tick < until);
        self.runs()
            || !self.is_ready()
            || (under_way && matches!(view.mode, Mode::Closed | Mode::Playing))
    }

    /// Not while a conditioning or an identification is played.
    pub(super) fn is_ready(&self) -> bool {
        self.device.view().mode != Mode::Playing || self.moving_until.is_some() || self.runs()
    }
}
