//! Filters of the set point and of the sensor, and the settings that are kept: `SPA`, `WPA`.

use hysteron_core::amplifier_command::Command;
use hysteron_core::filter_design::FilterSetting;
use hysteron_core::host_watch::timeout_ticks;
use hysteron_core::kept_settings::KeptSettings;
use hysteron_core::signal_filter::{FilteredSignal, Place, SECTIONS};

use super::{Pending, Session, Step};
use crate::device::{Device, Moving};
use crate::error_code::ErrorCode;
use crate::parameters::FilterItem;
use crate::words::Words;

/// Every section of both filters, as the bits of [`Pending::Filters`] count them.
const ALL: [(FilteredSignal, Place); 2 * SECTIONS] = [
    (FilteredSignal::SetPoint, Place::Notch1),
    (FilteredSignal::SetPoint, Place::Notch2),
    (FilteredSignal::SetPoint, Place::LowPass),
    (FilteredSignal::Sensor, Place::Notch1),
    (FilteredSignal::Sensor, Place::Notch2),
    (FilteredSignal::Sensor, Place::LowPass),
];

/// What `WPA` wants before it keeps anything, as other controllers do.
const PASSWORD: u32 = 100;

/// Gives an item of a filter another value, mHz.
pub(super) fn change_filter(filter: &mut FilterSetting, item: FilterItem, millihertz: u32) {
    match item {
        FilterItem::NotchFrequency(nth) => {
            filter.notches[nth & 1].frequency_millihertz = millihertz
        }
        FilterItem::NotchWidth(nth) => filter.notches[nth & 1].width_millihertz = millihertz,
        FilterItem::LowPass => filter.low_pass_millihertz = millihertz,
    }
}

/// The value of an item, mHz.
pub(super) fn filter_value(filter: &FilterSetting, item: FilterItem) -> u32 {
    match item {
        FilterItem::NotchFrequency(nth) => filter.notches[nth & 1].frequency_millihertz,
        FilterItem::NotchWidth(nth) => filter.notches[nth & 1].width_millihertz,
        FilterItem::LowPass => filter.low_pass_millihertz,
    }
}

impl<D: Device + 'static> Session<D> {
    fn sample_rate_hz(&self) -> u32 {
        self.parameters.physical.sample_rate_hz
    }

    /// Lets the amplifier have every section that changes. All of them are looked at before the first one.
    pub(super) fn tune_filters(&mut self, new: [FilterSetting; 2]) -> Result<(), ErrorCode> {
        let mut left = 0;
        for (nth, (signal, place)) in ALL.iter().enumerate() {
            let row =
                |of: &[FilterSetting; 2]| of[*signal as usize].row(*place, self.sample_rate_hz());
            let changed = row(&new).map_err(|_| ErrorCode::Range)?;
            if row(&self.filters) != Ok(changed) {
                left |= 1 << nth;
            }
        }
        let sensor = FilteredSignal::Sensor as usize;
        if new[sensor] != self.filters[sensor] {
            self.device
                .take_sensor_filter(&new[sensor])
                .map_err(|_| ErrorCode::NoMargin)?;
        }
        if left == 0 {
            // A width beside a notch that is off.
            self.filters = new;
        } else {
            self.pending = Pending::Filters { left, new };
        }
        Ok(())
    }

    /// The next section's command.
    pub(super) fn next_filter(&mut self, left: u8, new: [FilterSetting; 2]) -> Step {
        let section = ALL.get(left.trailing_zeros() as usize);
        let command = section.and_then(|(signal, place)| {
            let row = new[*signal as usize]
                .row(*place, self.sample_rate_hz())
                .ok()?;
            Some(Command::Filter {
                signal: *signal,
                place: *place,
                row,
            })
        });
        match command {
            Some(command) => {
                self.pending = Pending::Filters { left, new };
                Step::Command(command)
            }
            None => Step::Done,
        }
    }

    /// A section has acted.
    pub(super) fn filter_acted(&mut self, left: u8, new: [FilterSetting; 2]) {
        match left & left.wrapping_sub(1) {
            0 => self.filters = new,
            left => self.pending = Pending::Filters { left, new },
        }
    }

    /// Begins with what was kept for this stage. The amplifier has its filters already.
    pub(super) fn take_kept_settings(&mut self) {
        let Some(kept) = self
            .device
            .kept_settings()
            .filter(|kept| kept.stage == self.parameters.physical.name)
        else {
            return;
        };
        (self.velocity, self.tolerance) = (kept.velocity, kept.tolerance);
        (self.largest_move, self.largest_drive_step) = (kept.largest_move, kept.largest_drive_step);
        self.filters = kept.filters;
        let rate = self.sample_rate_hz();
        self.settling_ticks =
            (u64::from(kept.settling_us) * u64::from(rate)).div_ceil(1_000_000) as u32;
        // It was accepted when it was read.
        if let Some(ticks) = timeout_ticks(kept.host_timeout_ms, rate) {
            self.device.set_host_timeout(ticks);
        }
        // It was listened to before, at this sampling rate.
        let _ = self.device.listen(kept.watch);
    }

    /// `WPA 100`.
    pub(super) fn keep_settings(&mut self, words: &mut Words<'_>) -> Result<(), ErrorCode> {
        if words.whole()? != PASSWORD {
            return Err(ErrorCode::Range);
        }
        words.end()?;
        let rate = u64::from(self.sample_rate_hz().max(1));
        let time = |ticks: u32, per_second: u64| {
            u32::try_from(u64::from(ticks) * per_second / rate).unwrap_or(u32::MAX)
        };
        let settings = KeptSettings {
            stage: self.parameters.physical.name,
            velocity: self.velocity,
            tolerance: self.tolerance,
            largest_move: self.largest_move,
            largest_drive_step: self.largest_drive_step,
            settling_us: time(self.settling_ticks, 1_000_000),
            host_timeout_ms: time(self.device.host_timeout(), 1_000),
            baud: self.device.baud(),
            watch: self.device.resonance_watch(),
            filters: self.filters,
        };
        self.device
            .keep_settings(&settings)
            .map_err(|Moving| ErrorCode::InMotion)
    }
}
