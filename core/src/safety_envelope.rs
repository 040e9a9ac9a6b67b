//! The safety envelope: what the board may do to the actuator, whatever the servo's block says.
//!
//! # How it works
//! A block is a design, and changes often. The envelope belongs to the wiring: the scale of the drive's
//! converter, the drives and the slew that amplifier and actuator bear, how long a fault may take to be seen
//! and to come to rest. It is kept apart from the blocks, and a command of its own changes it.
//! [`SafetyEnvelope::admits`] looks at a block before it is taken; the control interrupt holds every code
//! within [`SafetyEnvelope::drive_min`] and [`SafetyEnvelope::drive_max`] once more. A board without an
//! envelope drives nothing.
//!
//! Codes here are those of the drive's converter itself, so that they mean the same whatever bits a block
//! has. As bytes it looks as a block does ([`crate::parameter_block`]) with another magic: a header, the
//! fields in their order, a checksum.

use crate::checksum::crc32;
use crate::codes::{DriveCode, LEAST_BITS, MOST_BITS, SensorCode};
use crate::output_monitor::{MARGIN, MonitorParameters};
use crate::parameter_block::AmplifierParameters;
use crate::self_test::STEP_MILLIVOLTS;
use crate::sensor_linearisation::{POINTS, SensorLinearisation, is_moderate};
use crate::servo_parameters::LawParameters;
use crate::set_point::SetPointParameters;
use crate::wire::{BlockError, KEPT_HEADER_BYTES, read_kept, wire_struct, write_kept};

/// First bytes of an envelope.
pub const MAGIC: [u8; 4] = *b"HYSE";
/// Version of the layout.
pub const VERSION: u16 = 6;
/// Bytes of the largest envelope.
pub const ENVELOPE_BYTES: usize = 192;

/// The tolerance of the monitor goes so often into the range of the drive, or more: a gain that is wrong by
/// 6 % is seen at the highest drive.
const TOLERANCES_IN_RANGE: i64 = 16;

/// What the board may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SafetyEnvelope {
    /// Name of the bench, padded with zeros.
    pub name: [u8; 16],
    /// Serial number of the stage as blocks name it, padded with zeros; all zeros: blocks of every stage.
    pub stage: [u8; 16],
    /// Bits of the drive's converter.
    pub dac_bits: u8,
    /// The sensor's converter is differential and gives two's complement.
    pub sensor_is_signed: bool,
    /// From the lower reference of the drive's converter to its upper one, mV.
    pub reference_span_mv: u32,
    /// Drive at code 0, uV.
    pub drive_at_code_0_uv: i32,
    /// Drive from code 0 to one beyond the highest, uV.
    pub drive_span_uv: u32,
    /// Least code that may act.
    pub drive_min: DriveCode,
    /// Most code that may act.
    pub drive_max: DriveCode,
    /// Code of rest: every block rests there.
    pub safe_code: DriveCode,
    /// Fastest change of the drive, V/s.
    pub slew_limit_v_s: u32,
    /// Longest way from the furthest drive to rest, ms.
    pub rest_within_ms: u16,
    /// Longest time for which a reading may stay the same before it is a fault, ms; a block must have the
    /// guard on.
    pub stuck_within_ms: u16,
    /// Longest time for which the tracking error may be too large, ms.
    pub tracking_within_ms: u16,
    /// Largest tracking error that a block may allow, nm.
    pub tracking_error_nm: u32,
    /// Codes at either end of the sensor, of 65,536, that no block may call honest.
    pub sensor_margin: u16,
    /// Shortest time of a healthy sensor before a fault can be cleared, ms.
    pub healthy_ms: u16,
    /// Capacitance of the actuator, nF.
    pub capacitance_nf: u32,
    /// Largest current into it, RMS over about a second, uA.
    pub current_ua: u32,
    /// The register of the drive's converter can be read back: its SDO is wired.
    pub drive_reads_back: bool,
    /// Drive at code 0 of the amplifier's voltage monitor, uV.
    pub monitor_at_code_0_uv: i32,
    /// Drive over the 65,536 codes of the monitor, uV; 0: no monitor is wired.
    pub monitor_span_uv: u32,
    /// Furthest that the monitor may read from the drive, mV.
    pub monitor_tolerance_mv: u16,
    /// Longest time constant of amplifier and monitor together, us.
    pub monitor_lag_us: u32,
    /// Position at code 0 of the analogue set point, nm.
    pub set_point_at_code_0_nm: i32,
    /// Positions over its 65,536 codes, nm; 0: it is not wired.
    pub set_point_span_nm: u32,
    /// Lowest position that it may lead to, nm.
    pub set_point_min_nm: i32,
    /// Highest one.
    pub set_point_max_nm: i32,
    /// Temperature of the amplifier at code 0 of its sensor, tenths of a degree Celsius.
    pub amplifier_at_code_0_decicelsius: i32,
    /// Degrees over its 65,536 codes, tenths; falls with the code where negative; 0: no sensor is wired.
    pub amplifier_span_decicelsius: i32,
    /// Hottest that the amplifier may be, tenths of a degree Celsius.
    pub amplifier_most_decicelsius: i32,
    /// Positions of all codes of the sensor, nm: a block for another sensor closes no loop here.
    pub sensor_span_nm: u32,
    /// What a code of the sensor is corrected by at every sixteenth of its codes, of 65,536
    /// ([`crate::sensor_linearisation`]).
    pub sensor_corrections: [i16; POINTS],
    /// Largest change of the reading in a tick that a block may call honest, nm.
    pub jump_within_nm: u32,
    /// A loop may be closed behind neither a self-test nor a conditioning: a bench without a stage.
    pub closes_untested: bool,
}

impl SafetyEnvelope {
    /// A bench of -20 to 120 V on 20 bits, of which 0 to 100 V may act, with 1.5 uF and 20 mA: where a test begins.
    pub const EXAMPLE: Self = Self {
        name: *b"bench\0\0\0\0\0\0\0\0\0\0\0",
        stage: *b"p753\0\0\0\0\0\0\0\0\0\0\0\0",
        dac_bits: 20,
        sensor_is_signed: false,
        reference_span_mv: 14_000,
        drive_at_code_0_uv: -20_000_000,
        drive_span_uv: 140_000_000,
        drive_min: DriveCode::new(149_797),
        drive_max: DriveCode::new(898_779),
        safe_code: DriveCode::new(149_797),
        slew_limit_v_s: 100_000,
        rest_within_ms: 100,
        stuck_within_ms: 20,
        tracking_within_ms: 20,
        tracking_error_nm: 4_000,
        sensor_margin: 16,
        healthy_ms: 5,
        capacitance_nf: 1_500,
        current_ua: 20_000,
        drive_reads_back: true,
        monitor_at_code_0_uv: -30_000_000,
        monitor_span_uv: 180_000_000,
        monitor_tolerance_mv: 500,
        monitor_lag_us: 2_000,
        set_point_at_code_0_nm: -1_000,
        set_point_span_nm: 15_000,
        set_point_min_nm: 0,
        set_point_max_nm: 10_000,
        amplifier_at_code_0_decicelsius: -500,
        amplifier_span_decicelsius: 3_300,
        amplifier_most_decicelsius: 700,
        sensor_span_nm: 15_000,
        sensor_corrections: [40; POINTS],
        jump_within_nm: 2_000,
        closes_untested: false,
    };
}

wire_struct!(SafetyEnvelope {
    name,
    stage,
    dac_bits,
    sensor_is_signed,
    reference_span_mv,
    drive_at_code_0_uv,
    drive_span_uv,
    drive_min,
    drive_max,
    safe_code,
    slew_limit_v_s,
    rest_within_ms,
    stuck_within_ms,
    tracking_within_ms,
    tracking_error_nm,
    sensor_margin,
    healthy_ms,
    capacitance_nf,
    current_ua,
    drive_reads_back,
    monitor_at_code_0_uv,
    monitor_span_uv,
    monitor_tolerance_mv,
    monitor_lag_us,
    set_point_at_code_0_nm,
    set_point_span_nm,
    set_point_min_nm,
    set_point_max_nm,
    amplifier_at_code_0_decicelsius,
    amplifier_span_decicelsius,
    amplifier_most_decicelsius,
    sensor_span_nm,
    sensor_corrections,
    jump_within_nm,
    closes_untested,
});

/// Writes an envelope and returns its length.
///
/// # Errors
/// [`BlockError::NoRoom`]; [`ENVELOPE_BYTES`] always suffice.
pub fn write(envelope: &SafetyEnvelope, bytes: &mut [u8]) -> Result<usize, BlockError> {
    write_kept(MAGIC, VERSION, envelope, bytes)
}

/// Reads an envelope from the beginning of `bytes`; what follows it does not matter.
///
/// # Errors
/// [`BlockError`].
pub fn read(bytes: &[u8]) -> Result<SafetyEnvelope, BlockError> {
    let envelope: SafetyEnvelope = read_kept(MAGIC, VERSION, bytes)?;
    envelope.is_consistent()?;
    Ok(envelope)
}

/// What tells one envelope from another: its checksum, which also names it in the command that keeps it.
#[must_use]
pub fn fingerprint(envelope: &SafetyEnvelope) -> u32 {
    let mut bytes = [0; ENVELOPE_BYTES];
    let length = write(envelope, &mut bytes).unwrap_or(0);
    bytes
        .get(KEPT_HEADER_BYTES..length.saturating_sub(4))
        .map_or(0, crc32)
}

/// Ticks of a time, rounded up.
fn ticks(milliseconds: u16, sample_rate_hz: u32) -> u32 {
    (u32::from(milliseconds) * (sample_rate_hz / 100)).div_ceil(10)
}

impl SafetyEnvelope {
    fn is_consistent(&self) -> Result<(), BlockError> {
        let highest = DriveCode::highest(self.dac_bits);
        let codes = (LEAST_BITS..=MOST_BITS).contains(&self.dac_bits)
            && self.drive_min < self.drive_max
            && self.drive_max <= highest
            && (self.drive_min..=self.drive_max).contains(&self.safe_code);
        if !codes {
            return Err(BlockError::Range(
                "the envelope's codes must be in order and within the converter",
            ));
        }
        let limits = self.drive_span_uv > 0
            && self.slew_limit_v_s > 0
            && self.rest_within_ms > 0
            && self.stuck_within_ms > 0
            && self.tracking_within_ms > 0
            && self.tracking_error_nm > 0
            && self.healthy_ms > 0
            && self.capacitance_nf > 0
            && self.current_ua > 0
            && self.sensor_span_nm > 0
            && self.jump_within_nm > 0;
        if !limits {
            return Err(BlockError::Range(
                "every limit of the envelope must be more than none",
            ));
        }
        if self.set_point_span_nm > 0 && self.set_point_min_nm >= self.set_point_max_nm {
            return Err(BlockError::Range(
                "the limits of the analogue set point must be in order",
            ));
        }
        if !is_moderate(&self.sensor_corrections) {
            return Err(BlockError::Range(
                "corrections of the sensor may differ by a quarter of the codes between them",
            ));
        }
        // A limit that no honest code exceeds would never act.
        let hottest = [MARGIN, u16::MAX - MARGIN].map(|code| self.amplifier_decicelsius(code));
        if self.amplifier_span_decicelsius != 0
            && hottest.iter().flatten().max() <= Some(&self.amplifier_most_decicelsius)
        {
            return Err(BlockError::Range(
                "the sensor of the amplifier's temperature must read beyond its limit",
            ));
        }
        if self.monitor_span_uv == 0 {
            return Ok(());
        }
        // The whole range must lie inside the monitor's honest codes, or the ends of it would be faults;
        // and the step of the self-test must be more than the tolerance, or a dead amplifier would pass it.
        let margin = (i64::from(self.monitor_span_uv) * i64::from(MARGIN)) >> 16;
        let (low, high) = (
            i64::from(self.monitor_at_code_0_uv),
            i64::from(self.monitor_at_code_0_uv) + i64::from(self.monitor_span_uv),
        );
        let covers = self.drive_uv(self.drive_min) >= low + margin
            && self.drive_uv(self.drive_max) <= high - margin;
        if !covers {
            return Err(BlockError::Range(
                "the voltage monitor must read beyond both ends of the drive",
            ));
        }
        let range_mv = (self.drive_uv(self.drive_max) - self.drive_uv(self.drive_min)) / 1000;
        let most = STEP_MILLIVOLTS.min(range_mv / TOLERANCES_IN_RANGE + 1);
        if !(1..most).contains(&i64::from(self.monitor_tolerance_mv)) {
            return Err(BlockError::Range(
                "the tolerance of the voltage monitor must be below the step of the self-test, 1.5 V, and at most a sixteenth of the drive's range",
            ));
        }
        Ok(())
    }

    /// How the amplifier's output is watched; `None` where no monitor is wired.
    #[must_use]
    pub fn monitor(&self, sample_rate_hz: u32) -> Option<MonitorParameters> {
        (self.monitor_span_uv > 0).then(|| {
            MonitorParameters::new(
                self.monitor_at_code_0_uv,
                self.monitor_span_uv,
                self.drive_uv(self.safe_code),
                self.monitor_tolerance_mv,
                self.monitor_lag_us,
                sample_rate_hz,
            )
        })
    }

    /// How the analogue set point is wired; `None` where it is not.
    #[must_use]
    pub fn set_point(&self) -> Option<SetPointParameters> {
        (self.set_point_span_nm > 0).then(|| {
            SetPointParameters::new(
                self.set_point_at_code_0_nm,
                self.set_point_span_nm,
                self.set_point_min_nm,
                self.set_point_max_nm,
            )
        })
    }

    /// How codes of so many bits of the sensor are straightened; nothing where it is straight.
    #[must_use]
    pub fn linearisation(&self, bits: u8) -> Option<SensorLinearisation> {
        SensorLinearisation::new(&self.sensor_corrections, bits)
    }

    /// The amplifier's temperature of a code of its sensor, tenths of a degree Celsius; `None` where none is
    /// wired, or at the ends, where an open or shorted sensor reads.
    #[must_use]
    pub fn amplifier_decicelsius(&self, code: u16) -> Option<i32> {
        let is_honest = (MARGIN..=u16::MAX - MARGIN).contains(&code);
        (self.amplifier_span_decicelsius != 0 && is_honest).then(|| {
            let above = (i64::from(code) * i64::from(self.amplifier_span_decicelsius)) >> 16;
            self.amplifier_at_code_0_decicelsius
                .saturating_add(above as i32)
        })
    }

    /// Whether the amplifier is too hot to be driven, by the code of its sensor (`None`: its converter did
    /// not answer).
    #[must_use]
    pub fn amplifier_is_too_hot(&self, code: Option<u16>) -> bool {
        self.amplifier_span_decicelsius != 0
            && code
                .and_then(|code| self.amplifier_decicelsius(code))
                .is_none_or(|now| now > self.amplifier_most_decicelsius)
    }

    /// Drive of a code of the converter, uV.
    #[must_use]
    pub fn drive_uv(&self, code: DriveCode) -> i64 {
        i64::from(self.drive_at_code_0_uv)
            + ((i64::from(code) * i64::from(self.drive_span_uv)) >> self.dac_bits)
    }

    /// A code of a block of so many bits as the converter has it.
    #[must_use]
    pub fn of_block(&self, code: DriveCode, block_bits: u8) -> DriveCode {
        DriveCode::new(code.steps() << self.dac_bits.saturating_sub(block_bits))
    }

    /// The least and the most code that may act, in a block's bits.
    #[must_use]
    pub fn limits_of(&self, block_bits: u8) -> (DriveCode, DriveCode) {
        let shift = self.dac_bits.saturating_sub(block_bits);
        (
            DriveCode::new(self.drive_min.steps().div_ceil(1 << shift)),
            DriveCode::new(self.drive_max.steps() >> shift),
        )
    }

    /// Mean square of the drive's change from tick to tick at which the current is at its limit, square codes
    /// of a block.
    #[must_use]
    pub fn mean_square_codes(&self, parameters: &AmplifierParameters) -> u64 {
        // i = C dV/dt: uA over nF is V/ms, here uV a tick.
        let rate = u64::from(parameters.physical.sample_rate_hz.max(1));
        let microvolts_a_tick = u64::from(self.current_ua) * 1_000_000_000
            / (u64::from(self.capacitance_nf.max(1)) * rate);
        let step_pv = ((parameters.servo.converters.dac_step.unsigned_abs() as u128
            * 1_000_000_000_000)
            >> 38)
            .max(1);
        let codes = (u128::from(microvolts_a_tick) * 1_000_000) << 8;
        let codes = codes / step_pv;
        u64::try_from((codes * codes) >> 16)
            .unwrap_or(u64::MAX)
            .max(1)
    }

    /// Codes of a block by which the drive may change in a tick: a step more than the slew limit, for what
    /// both round.
    #[must_use]
    pub fn slew_codes(&self, parameters: &AmplifierParameters) -> u32 {
        let rate = u128::from(parameters.physical.sample_rate_hz.max(1));
        // V/s over Hz: V a tick, over V with 38 fraction bits a step.
        let step = parameters.servo.converters.dac_step.unsigned_abs();
        let codes = (u128::from(self.slew_limit_v_s) << 38) / (rate * u128::from(step.max(1)));
        u32::try_from(codes).map_or(DriveCode::MOST.steps(), |codes| {
            codes.saturating_add(1).min(DriveCode::MOST.steps())
        })
    }

    /// Whether a block stays within it.
    ///
    /// # Errors
    /// What does not.
    pub fn admits(&self, parameters: &AmplifierParameters) -> Result<(), &'static str> {
        let (c, guard, rate) = (
            &parameters.servo.converters,
            &parameters.guard,
            parameters.physical.sample_rate_hz,
        );
        if self.stage != [0; 16] && parameters.physical.name != self.stage {
            return Err("beyond the safety envelope: made for another stage");
        }
        if c.dac_bits > self.dac_bits {
            return Err(
                "beyond the safety envelope: codes of more bits than the drive's converter has",
            );
        }
        // uV of a code by the block: V with 22 fraction bits.
        let by_block = |code: DriveCode| (i64::from(c.drive(code)) * 1_000_000) >> 22;
        // Two steps of the block's, and what rounding to microvolts makes.
        let step_uv = ((c.dac_step * 1_000_000) >> 38) + 2;
        let agrees = |code: DriveCode| {
            (by_block(code) - self.drive_uv(self.of_block(code, c.dac_bits))).abs() <= 2 * step_uv
        };
        if !agrees(c.dac_code_min) || !agrees(c.dac_code_max) {
            return Err("beyond the safety envelope: made for another scale of the drive");
        }
        let (lowest, highest) = self.limits_of(c.dac_bits);
        if c.dac_code_min < lowest || c.dac_code_max > highest {
            return Err("beyond the safety envelope: the range of the drive");
        }
        if (by_block(guard.rest_code) - self.drive_uv(self.safe_code)).abs() > 2 * step_uv {
            return Err("beyond the safety envelope: another drive at rest");
        }
        if parameters.physical.slew_limit_v_s > self.slew_limit_v_s {
            return Err("beyond the safety envelope: the slew limit");
        }
        let furthest = c
            .dac_code_max
            .abs_diff(guard.rest_code)
            .max(c.dac_code_min.abs_diff(guard.rest_code));
        if furthest.div_ceil(guard.ramp_codes.max(1)) > ticks(self.rest_within_ms, rate) {
            return Err("beyond the safety envelope: too long a way to rest");
        }
        if guard.stuck_ticks == 0
            || u32::from(guard.stuck_ticks) > ticks(self.stuck_within_ms, rate)
        {
            return Err(
                "beyond the safety envelope: the guard of a stuck sensor is off or too slow",
            );
        }
        // A block without a law follows nothing.
        let follows = !matches!(parameters.servo.law, LawParameters::Hold);
        if follows && u32::from(guard.tracking_ticks) > ticks(self.tracking_within_ms, rate) {
            return Err("beyond the safety envelope: the guard of the tracking error is too slow");
        }
        if follows
            && (i64::from(guard.tracking_error) * 1000) >> 24 > i64::from(self.tracking_error_nm)
        {
            return Err("beyond the safety envelope: the guard of the tracking error is too wide");
        }
        // um with 24 fraction bits.
        let jump = (i128::from(guard.jump_codes) * i128::from(c.adc_step)) >> 16;
        if follows && (jump * 1000) >> 24 > i128::from(self.jump_within_nm) {
            return Err("beyond the safety envelope: the guard of a sensor's jump is off");
        }
        // A share of 2^-10 for what both round.
        let span = parameters.physical.sensor_span_nm.unsigned_abs();
        if follows && span.abs_diff(self.sensor_span_nm) > self.sensor_span_nm >> 10 {
            return Err("beyond the safety envelope: made for another scale of the sensor");
        }
        if parameters.stepping.get().is_some() && self.sensor_corrections != [0; POINTS] {
            return Err("beyond the safety envelope: corrections of a sensor that is an encoder");
        }
        let margin = (u32::from(self.sensor_margin) << c.adc_bits) >> 16;
        if guard.adc_code_min.steps() < margin
            || guard.adc_code_max + margin > SensorCode::highest(c.adc_bits)
        {
            return Err("beyond the safety envelope: the guard of the sensor's range is off");
        }
        if u32::from(guard.healthy_ticks) < ticks(self.healthy_ms, rate) {
            return Err("beyond the safety envelope: a fault is cleared too soon");
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::parameter_block::tests::example;

    pub(crate) fn envelope() -> SafetyEnvelope {
        SafetyEnvelope::EXAMPLE
    }

    #[test]
    fn it_comes_back_as_it_went_or_not_at_all() {
        let mut bytes = [0xFF; ENVELOPE_BYTES];
        let length = write(&envelope(), &mut bytes).expect("fits");
        assert_eq!(read(&bytes), Ok(envelope()));
        for bit in 0..length * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        assert_eq!(read(&[0xFF; 200]), Err(BlockError::Absent));
        let mut other = envelope();
        other.drive_max = other.drive_max - 1;
        assert_ne!(fingerprint(&other), fingerprint(&envelope()));
        for change in [
            (|e| e.drive_min = e.drive_max) as fn(&mut SafetyEnvelope),
            |e| e.safe_code = DriveCode::new(0),
            |e| e.stuck_within_ms = 0,
            |e| e.current_ua = 0,
            |e| e.jump_within_nm = 0,
            |e| e.sensor_span_nm = 0,
            |e| e.set_point_max_nm = 0,
            |e| e.amplifier_most_decicelsius = 2_800,
            |e| e.sensor_corrections[7] = 1_065,
            |e| e.monitor_at_code_0_uv = 1_000_000,
            |e| e.monitor_tolerance_mv = 0,
            |e| e.monitor_tolerance_mv = 1_500,
            // 20 V: 1.25 V.
            |e| (e.drive_max, e.monitor_tolerance_mv) = (DriveCode::new(299_595), 1_260),
            |e| e.dac_bits = 21,
        ] {
            let mut wrong = envelope();
            change(&mut wrong);
            let length = write(&wrong, &mut bytes).expect("fits");
            assert!(matches!(read(&bytes[..length]), Err(BlockError::Range(_))));
        }
    }

    #[test]
    fn no_block_exceeds_it() {
        assert_eq!(envelope().admits(&example()), Ok(()));
        let refuses = |change: fn(&mut AmplifierParameters), words: &str| {
            let mut block = example();
            change(&mut block);
            assert!(
                envelope()
                    .admits(&block)
                    .is_err_and(|reason| reason.contains(words)),
                "{words}: {:?}",
                envelope().admits(&block)
            );
        };
        refuses(|p| p.physical.name[3] = b'4', "another stage");
        let mut of_any = example();
        of_any.physical.name[3] = b'4';
        let without = SafetyEnvelope {
            stage: [0; 16],
            ..envelope()
        };
        assert_eq!(without.admits(&of_any), Ok(()));
        refuses(|p| p.guard.stuck_ticks = 0, "stuck");
        refuses(|p| p.guard.stuck_ticks = 401, "stuck");
        refuses(
            |p| p.guard.tracking_error = i32::MAX,
            "tracking error is too wide",
        );
        refuses(
            |p| p.guard.tracking_ticks = 401,
            "tracking error is too slow",
        );
        refuses(|p| p.guard.ramp_codes = 18, "way to rest");
        refuses(
            |p| p.guard.adc_code_min = SensorCode::new(15),
            "range is off",
        );
        refuses(
            |p| p.guard.adc_code_max = SensorCode::new(65_520),
            "range is off",
        );
        refuses(|p| p.guard.healthy_ticks = 99, "too soon");
        refuses(|p| p.guard.rest_code = DriveCode::new(9_400), "rest");
        refuses(|p| p.physical.slew_limit_v_s = 100_001, "slew");
        refuses(
            |p| p.servo.converters.dac_code_max = DriveCode::new(56_174),
            "range of the drive",
        );
        refuses(
            |p| p.servo.converters.dac_code_min = DriveCode::new(9_300),
            "range of the drive",
        );
        // References of another size, a converter of other bits.
        refuses(
            |p| p.servo.converters.dac_step = (150i64 << 38) >> 16,
            "scale",
        );
        refuses(|p| p.servo.converters.dac_bits = 21, "bits");
    }

    #[test]
    fn an_amplifier_is_too_hot_above_its_limit_and_where_its_sensor_is_open() {
        let wired = envelope();
        // 10 mV a degree over 3.3 V: 330 degrees.
        let code = |decicelsius: i32| ((decicelsius + 500) * 65_536 / 3_300) as u16;
        assert_eq!(wired.amplifier_decicelsius(code(250) + 1), Some(250));
        assert_eq!(
            [690, 705].map(|at| wired.amplifier_is_too_hot(Some(code(at)))),
            [false, true]
        );
        for open in [None, Some(MARGIN - 1), Some(u16::MAX - MARGIN + 1)] {
            assert!(wired.amplifier_is_too_hot(open), "{open:?}");
        }
        // A thermistor's divider falls.
        let falling = SafetyEnvelope {
            amplifier_at_code_0_decicelsius: 1_500,
            amplifier_span_decicelsius: -2_000,
            ..wired
        };
        assert_eq!(falling.is_consistent(), Ok(()));
        assert!(falling.amplifier_is_too_hot(Some(20_000)));
        assert!(!falling.amplifier_is_too_hot(Some(40_000)));
        let without = SafetyEnvelope {
            amplifier_span_decicelsius: 0,
            ..wired
        };
        assert_eq!(without.amplifier_decicelsius(30_000), None);
        assert!(!without.amplifier_is_too_hot(None));
    }

    #[test]
    fn a_current_is_a_mean_square_of_codes() {
        // 20 mA into 1.5 uF are 13 333 V/s, 0.667 V a tick, 312 codes of 140 V over 65,536.
        let codes = (envelope().mean_square_codes(&example()) as f64).sqrt();
        assert!((codes - 312.1).abs() < 0.5, "{codes}");
    }
}
