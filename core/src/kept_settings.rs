//! What an operator has set and asked to keep: bytes that the board keeps in flash beside the blocks.
//!
//! Safety hangs on it: the host's timeout, the loop's notches, the largest step. So the board does not arm
//! where what stands there is damaged, of another version or for another sampling rate, and names it
//! ([`crate::guard::Fault::KeptSettings`]). Where nothing was kept it begins as a new one does. As bytes it looks as the safety envelope does: a magic, a version,
//! the fields in their order, a checksum.

use crate::filter_design::{FilterSetting, Notch};
use crate::host_watch::timeout_ticks;
use crate::loop_telemetry::ResonanceWatch;
use crate::wire::{BlockError, read_kept, wire_struct, write_kept};

/// First bytes.
pub const MAGIC: [u8; 4] = *b"HYSK";
/// Version of the layout.
pub const VERSION: u16 = 2;
/// Bytes, at most.
pub const SETTINGS_BYTES: usize = 128;

/// The settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptSettings {
    /// Name of the stage in the block that was in use.
    pub stage: [u8; 16],
    /// Fastest velocity of moves, um/s with 24 fraction bits.
    pub velocity: i64,
    /// Largest tracking error on target, um with 24 fraction bits.
    pub tolerance: i32,
    /// For so long it must not be larger, us.
    pub settling_us: u32,
    /// For so long no line may come while the drive is live, ms; 0: for ever.
    pub host_timeout_ms: u32,
    /// A larger move needs a second word, um with 24 fraction bits; 0: none does.
    pub largest_move: i32,
    /// A larger step of an open-loop drive does, V with 22 fraction bits; 0: none does.
    pub largest_drive_step: i32,
    /// Speed of the line, bit/s.
    pub baud: u32,
    /// The resonance that is listened to.
    pub watch: ResonanceWatch,
    /// Filters of the set point and of the sensor, as [`crate::signal_filter::FilteredSignal`] counts them.
    pub filters: [FilterSetting; 2],
}

wire_struct!(Notch {
    frequency_millihertz,
    width_millihertz
});
wire_struct!(FilterSetting {
    notches,
    low_pass_millihertz
});
wire_struct!(ResonanceWatch {
    frequency_millihertz,
    alarm_pm
});
wire_struct!(KeptSettings {
    stage,
    velocity,
    tolerance,
    settling_us,
    host_timeout_ms,
    largest_move,
    largest_drive_step,
    baud,
    watch,
    filters
});

/// Writes them and returns their length.
///
/// # Errors
/// [`BlockError::NoRoom`]; [`SETTINGS_BYTES`] always suffice.
pub fn write(settings: &KeptSettings, bytes: &mut [u8]) -> Result<usize, BlockError> {
    write_kept(MAGIC, VERSION, settings, bytes)
}

/// Reads settings from the beginning of `bytes`; what follows them does not matter.
///
/// # Errors
/// [`BlockError`].
pub fn read(bytes: &[u8], sample_rate_hz: u32) -> Result<KeptSettings, BlockError> {
    let settings: KeptSettings = read_kept(MAGIC, VERSION, bytes)?;
    if settings
        .filters
        .iter()
        .any(|filter| !filter.accepted(sample_rate_hz))
        || !settings.watch.accepted(sample_rate_hz)
        || timeout_ticks(settings.host_timeout_ms, sample_rate_hz).is_none()
        || settings.largest_move < 0
        || settings.largest_drive_step < 0
    {
        return Err(BlockError::SampleRate(sample_rate_hz));
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> KeptSettings {
        let notch = Notch {
            frequency_millihertz: 735_000,
            width_millihertz: 40_000,
        };
        KeptSettings {
            stage: *b"p753\0\0\0\0\0\0\0\0\0\0\0\0",
            velocity: 500 << 24,
            tolerance: 1 << 20,
            settling_us: 5000,
            host_timeout_ms: 250,
            largest_move: 2 << 24,
            largest_drive_step: 10 << 22,
            baud: 921_600,
            watch: ResonanceWatch {
                frequency_millihertz: 735_000,
                alarm_pm: 20_000,
            },
            filters: [
                FilterSetting {
                    notches: [notch, Notch::OFF],
                    low_pass_millihertz: 2_000_000,
                },
                FilterSetting::OFF,
            ],
        }
    }

    #[test]
    fn settings_come_back_as_they_went() {
        let mut bytes = [0xff; SETTINGS_BYTES];
        let length = write(&settings(), &mut bytes).expect("room");
        assert_eq!(read(&bytes, 20_000), Ok(settings()));
        for nth in 0..length {
            let mut damaged = bytes;
            damaged[nth] ^= 1;
            // The reserved bytes count too: they are part of what the checksum is of.
            assert!(read(&damaged, 20_000).is_err(), "byte {nth}");
        }
        assert_eq!(
            read(&[0xff; SETTINGS_BYTES], 20_000),
            Err(BlockError::Absent)
        );
        assert_eq!(
            read(&bytes, 1_000),
            Err(BlockError::SampleRate(1_000)),
            "2 kHz at 1 kHz"
        );
    }
}
