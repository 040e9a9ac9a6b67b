//! The parameter block: everything that the amplifier needs to know, as bytes that can be kept in flash and
//! trusted.
//!
//! # How it works
//! Little-endian: `HYST`, version (2), generation (2, counted up by the target with each block it keeps),
//! length of the content (4), content, CRC-32 of all before it (4). The content is the physical description
//! ([`PhysicalDescription`], whole numbers of small units), then the integers of the servo and of the guard,
//! field by field in the order of [`Wire`]'s implementations, with the lag of the sensor between both, then
//! the bands of the loop ([`crate::loop_margin`]). Only where a periodic reference is learned, the filters for
//! it follow; only where the gain is adapted, its bounds stand behind them; a stick-slip drive, which has
//! neither, ends on the integers of [`crate::stepping`]. [`read`] refuses what is damaged, of
//! another version, made for another sampling rate, whose integers contradict its physical description, with
//! which a signal could wrap ([`verify`]), or whose design is not stable, and says which.

use crate::checksum::crc32;
use crate::codes::{DriveCode, LEAST_BITS, MOST_BITS, SensorCode};
use crate::creep_inverse::{CREEP_TERMS, CreepInverseParameters};
use crate::filter_design::FilterSetting;
use crate::gain_adaptation::AdaptationParameters;
use crate::guard::GuardParameters;
use crate::integer_row::Row;
use crate::learned_feedforward::LearningParameters;
use crate::loop_bands::LoopBands;
use crate::one_sided_hysteresis::{
    SURFACE_FRACTION_BITS, SURFACE_LIMITS_UM, SURFACE_SIZE, SurfaceCoefficients,
};
use crate::pid_regulator::PidParameters;
use crate::predictor_law::PredictorParameters;
use crate::sensor_lag::SensorLag;
use crate::servo_parameters::{
    ActuatorParameters, ConverterParameters, LawParameters, NO_SLEW_LIMIT, ServoParameters,
};
use crate::sliding_mode_controller::{Prediction, Reaching, SlidingModeParameters};
use crate::state_estimator::EstimatorParameters;
use crate::stepping_parameters::{
    self, ENCODER_BITS, IfStepping, STEPPING_BYTES, SteppingParameters,
};
use crate::wire::{BlockError, Reader, Wire, Writer, wire_struct};

/// First bytes of a block.
pub const MAGIC: [u8; 4] = *b"HYST";
/// Version of the layout.
pub const VERSION: u16 = 7;
/// Bytes of the largest block.
pub const BLOCK_BYTES: usize = 2048;
const HEADER_BYTES: usize = 12;
/// Bounds of the adaptation: filters before them are longer.
const ADAPTATION_BYTES: usize = 16;
/// A slew limit beyond this limits nothing, V/s: the whole range of the drive in a tick.
const MOST_SLEW_V_S: u32 = 20_000_000;

/// The physical quantities behind the integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhysicalDescription {
    /// Name of the actuator, padded with zeros.
    pub name: [u8; 16],
    /// Control ticks per second, Hz.
    pub sample_rate_hz: u32,
    /// Lowest drive, mV.
    pub drive_min_mv: i32,
    /// Highest drive, mV.
    pub drive_max_mv: i32,
    /// Fastest change of the drive that the amplifier is asked for in any mode, V/s.
    pub slew_limit_v_s: u32,
    /// Position from the sensor's lowest to its highest code, nm.
    pub sensor_span_nm: i32,
    /// Largest magnitude of the eigenvalues of the sampled closed loop, millionths, as the host found it; at
    /// 1 000 000 the loop is not stable. The target does not compute it again: what it sees of a loop that is
    /// not stable is its tracking error.
    pub spectral_radius_millionths: u32,
}

/// Everything in a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AmplifierParameters {
    /// Physical description.
    pub physical: PhysicalDescription,
    /// Servo.
    pub servo: ServoParameters,
    /// Guard.
    pub guard: GuardParameters,
    /// What filters of the sensor and an adapted gain must leave of the loop.
    pub loop_bands: LoopBands,
    /// What makes it a stick-slip drive.
    pub stepping: IfStepping<SteppingParameters>,
}

impl AmplifierParameters {
    /// Bits of a reading: the sensor's code, or the encoder's count.
    #[must_use]
    pub fn reading_bits(&self) -> u8 {
        match self.stepping.get() {
            None => self.servo.converters.adc_bits,
            Some(_) => ENCODER_BITS,
        }
    }
}

wire_struct!(Row<const N: usize, const Q: u32> { coefficients });
wire_struct!(SurfaceCoefficients { g, f });
wire_struct!(SensorLag { carried, before });
wire_struct!(ConverterParameters {
    adc_zero,
    adc_step,
    dac_zero,
    dac_step,
    dac_codes_per_volt,
    dac_code_min,
    dac_code_max,
    slew_codes,
    adc_bits,
    dac_bits,
    noise_shaping
});
wire_struct!(CreepInverseParameters {
    terms,
    pair,
    shares,
    rates,
    thresholds,
    pair_shares,
    pair_rates,
    at_rest
});
wire_struct!(PidParameters {
    proportional_derivative,
    integral,
    feedforward,
    creep,
    notch
});
wire_struct!(EstimatorParameters {
    rows,
    unknown_input
});
wire_struct!(Prediction { rows });
wire_struct!(PredictorParameters {
    state_rows,
    unknown_gain,
    slope_gain,
    reading_row,
    gain_row,
    feedforward
});
wire_struct!(LearningParameters {
    learning,
    robustness,
    error_limit,
    point_limit,
    periods_per_halving,
    most_halvings
});
wire_struct!(AdaptationParameters {
    most,
    most_step,
    error_limit,
    least_motion
});
wire_struct!(GuardParameters {
    adc_code_min,
    adc_code_max,
    stuck_ticks,
    jump_codes,
    tracking_error,
    tracking_ticks,
    ramp_codes,
    rest_code,
    healthy_ticks,
});
wire_struct!(PhysicalDescription {
    name,
    sample_rate_hz,
    drive_min_mv,
    drive_max_mv,
    slew_limit_v_s,
    sensor_span_nm,
    spectral_radius_millionths
});

impl Wire for AmplifierParameters {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        let Self {
            physical,
            servo:
                ServoParameters {
                    sensor_lag,
                    converters,
                    actuator,
                    law,
                    delayed,
                    learning,
                    adaptation,
                },
            guard,
            loop_bands,
            stepping,
        } = self;
        physical.write(to)?;
        converters.write(to)?;
        actuator.write(to)?;
        law.write(to)?;
        delayed.write(to)?;
        sensor_lag.write(to)?;
        guard.write(to)?;
        loop_bands.write(to)?;
        learning
            .as_ref()
            .map_or(Ok(()), |learning| learning.write(to))?;
        adaptation
            .as_ref()
            .map_or(Ok(()), |adaptation| adaptation.write(to))?;
        stepping.get().map_or(Ok(()), |stepping| stepping.write(to))
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        let physical = Wire::read(from)?;
        let mut servo = ServoParameters {
            converters: Wire::read(from)?,
            actuator: Wire::read(from)?,
            law: Wire::read(from)?,
            delayed: Wire::read(from)?,
            sensor_lag: Wire::read(from)?,
            learning: None,
            adaptation: None,
        };
        let guard = Wire::read(from)?;
        let loop_bands = Wire::read(from)?;
        let mut stepping = IfStepping::NONE;
        if from.rest.len() == STEPPING_BYTES {
            stepping = IfStepping::new(Wire::read(from)?);
            if stepping.get().is_none() {
                return Err(BlockError::Range(
                    "made for a stick-slip drive, which this image has no room for",
                ));
            }
        }
        if from.rest.len() > ADAPTATION_BYTES {
            servo.learning = Some(Wire::read(from)?);
        }
        if !from.rest.is_empty() {
            servo.adaptation = Some(Wire::read(from)?);
        }
        Ok(Self {
            physical,
            servo,
            guard,
            loop_bands,
            stepping,
        })
    }
}

impl Wire for Reaching {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        match self {
            Self::Pid {
                proportional_derivative,
                integral,
            } => {
                0u8.write(to)?;
                proportional_derivative.write(to)?;
                integral.write(to)
            }
            Self::Switching { magnitude } => {
                1u8.write(to)?;
                magnitude.write(to)
            }
            Self::BoundaryLayer {
                magnitude,
                thickness,
            } => {
                2u8.write(to)?;
                magnitude.write(to)?;
                thickness.write(to)
            }
        }
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        Ok(match u8::read(from)? {
            0 => Self::Pid {
                proportional_derivative: Wire::read(from)?,
                integral: Wire::read(from)?,
            },
            1 => Self::Switching {
                magnitude: Wire::read(from)?,
            },
            2 => Self::BoundaryLayer {
                magnitude: Wire::read(from)?,
                thickness: Wire::read(from)?,
            },
            _ => return Err(BlockError::Value),
        })
    }
}

impl Wire for ActuatorParameters {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        match self {
            Self::Direct => 0u8.write(to),
            Self::Linear {
                volts_per_micrometre,
                micrometres_per_volt,
            } => {
                1u8.write(to)?;
                volts_per_micrometre.write(to)?;
                micrometres_per_volt.write(to)
            }
            Self::OneSidedHysteresis {
                surfaces,
                drive_min,
                drive_range,
                share_per_volt,
            } => {
                2u8.write(to)?;
                surfaces.write(to)?;
                drive_min.write(to)?;
                drive_range.write(to)?;
                share_per_volt.write(to)
            }
        }
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        Ok(match u8::read(from)? {
            0 => Self::Direct,
            1 => Self::Linear {
                volts_per_micrometre: Wire::read(from)?,
                micrometres_per_volt: Wire::read(from)?,
            },
            2 => Self::OneSidedHysteresis {
                surfaces: Wire::read(from)?,
                drive_min: Wire::read(from)?,
                drive_range: Wire::read(from)?,
                share_per_volt: Wire::read(from)?,
            },
            _ => return Err(BlockError::Value),
        })
    }
}

impl Wire for LawParameters {
    fn write(&self, to: &mut Writer<'_>) -> Result<(), BlockError> {
        match self {
            Self::Hold => 0u8.write(to),
            Self::Regulator(parameters) => {
                1u8.write(to)?;
                parameters.write(to)
            }
            Self::SlidingMode {
                estimator,
                controller: c,
            } => {
                // With a prediction it is a law of its own, so that blocks without one stay as they are.
                let tag: u8 = if c.prediction.is_some() { 4 } else { 2 };
                tag.write(to)?;
                estimator.write(to)?;
                c.reference_velocity.write(to)?;
                c.reference_drive.write(to)?;
                c.switching_function.write(to)?;
                c.equivalent_control.write(to)?;
                c.reaching.write(to)?;
                c.prediction
                    .as_ref()
                    .map_or(Ok(()), |prediction| prediction.write(to))
            }
            Self::Predictor(parameters) => {
                3u8.write(to)?;
                parameters.write(to)
            }
        }
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, BlockError> {
        Ok(match u8::read(from)? {
            0 => Self::Hold,
            1 => Self::Regulator(Wire::read(from)?),
            tag @ (2 | 4) => Self::SlidingMode {
                estimator: Wire::read(from)?,
                controller: SlidingModeParameters {
                    reference_velocity: Wire::read(from)?,
                    reference_drive: Wire::read(from)?,
                    switching_function: Wire::read(from)?,
                    equivalent_control: Wire::read(from)?,
                    reaching: Wire::read(from)?,
                    prediction: if tag == 4 {
                        Some(Wire::read(from)?)
                    } else {
                        None
                    },
                },
            },
            3 => Self::Predictor(Wire::read(from)?),
            _ => return Err(BlockError::Value),
        })
    }
}

/// Writes a block and returns its length.
///
/// # Errors
/// [`BlockError::NoRoom`]; [`BLOCK_BYTES`] always suffice.
pub fn write(parameters: &AmplifierParameters, bytes: &mut [u8]) -> Result<usize, BlockError> {
    let mut writer = Writer { bytes, at: 0 };
    writer.put(&MAGIC)?;
    VERSION.write(&mut writer)?;
    0u16.write(&mut writer)?;
    0u32.write(&mut writer)?;
    parameters.write(&mut writer)?;
    let end = writer.at;
    let content = (end - HEADER_BYTES) as u32;
    writer
        .bytes
        .get_mut(8..HEADER_BYTES)
        .ok_or(BlockError::NoRoom)?
        .copy_from_slice(&content.to_le_bytes());
    let checksum = crc32(writer.bytes.get(..end).ok_or(BlockError::NoRoom)?);
    checksum.write(&mut writer)?;
    Ok(writer.at)
}

/// Reads a block from the beginning of `bytes` (what follows it does not matter) for a target with this
/// sampling rate.
///
/// # Errors
/// [`BlockError`].
pub fn read(bytes: &[u8], sample_rate_hz: u32) -> Result<AmplifierParameters, BlockError> {
    let mut header = Reader { rest: bytes };
    if header.take::<4>().map_err(|_| BlockError::Absent)? != MAGIC {
        return Err(BlockError::Absent);
    }
    let version = u16::read(&mut header)?;
    if version != VERSION {
        return Err(BlockError::Version(version));
    }
    let _generation = u16::read(&mut header)?;
    let content = u32::read(&mut header)? as usize;
    if content > BLOCK_BYTES {
        return Err(BlockError::Length);
    }
    let checked = bytes
        .get(..HEADER_BYTES + content)
        .ok_or(BlockError::Length)?;
    let mut tail = Reader {
        rest: bytes
            .get(HEADER_BYTES + content..)
            .ok_or(BlockError::Length)?,
    };
    if u32::read(&mut tail)? != crc32(checked) {
        return Err(BlockError::Checksum);
    }
    let mut reader = Reader {
        rest: checked.get(HEADER_BYTES..).ok_or(BlockError::Length)?,
    };
    let parameters = AmplifierParameters::read(&mut reader)?;
    if !reader.rest.is_empty() {
        return Err(BlockError::Length);
    }
    verify(&parameters, sample_rate_hz)?;
    Ok(parameters)
}

/// Which of two kept blocks is the newer one: their generation, 0 for a block that comes from the host.
#[must_use]
pub fn generation(bytes: &[u8]) -> u16 {
    match bytes {
        [_, _, _, _, _, _, low, high, ..] => u16::from_le_bytes([*low, *high]),
        _ => 0,
    }
}

/// What tells one block from another whatever its generation: the CRC-32 of its content; `None` if that is
/// not all there.
#[must_use]
pub fn fingerprint(bytes: &[u8]) -> Option<u32> {
    let content = bytes
        .get(8..HEADER_BYTES)?
        .first_chunk()
        .map(|length| u32::from_le_bytes(*length))?;
    let end = HEADER_BYTES.checked_add(content as usize)?;
    bytes.get(HEADER_BYTES..end).map(crc32)
}

/// Gives a whole block (without anything behind it) another generation, and its checksum with it.
///
/// # Errors
/// [`BlockError::Length`] if it is shorter than any block.
pub fn set_generation(block: &mut [u8], generation: u16) -> Result<(), BlockError> {
    block
        .get_mut(6..8)
        .ok_or(BlockError::Length)?
        .copy_from_slice(&generation.to_le_bytes());
    let (content, checksum) = block
        .split_last_chunk_mut::<4>()
        .ok_or(BlockError::Length)?;
    *checksum = crc32(content).to_le_bytes();
    Ok(())
}

/// Largest share of a reciprocal pair's product by which it may miss its exact value: 2^-10.
const RECIPROCAL_SHIFT: u32 = 10;

/// Whether `a * b` is `2^bits` within a thousandth.
fn reciprocal(a: i64, b: i64, bits: u32) -> bool {
    let exact = 1i64 << bits;
    a.checked_mul(b)
        .is_some_and(|product| product.abs_diff(exact) <= (exact >> RECIPROCAL_SHIFT) as u64)
}

/// Whether no sum of this row can leave 64 bits, whatever the signals.
fn bounded<const N: usize, const Q: u32>(row: &Row<N, Q>) -> bool {
    row.coefficients
        .iter()
        .map(|c| i64::from(c.unsigned_abs()))
        .sum::<i64>()
        < 1 << 31
}

impl PredictorParameters {
    /// Whether all rows stay [`bounded`] when the gain is within [`crate::gain_adaptation::MOST`] of one.
    fn has_room_to_scale(&self) -> bool {
        has_room(&self.feedforward.coefficients)
            && has_room(&self.gain_row.coefficients)
            && has_room(&[self.unknown_gain])
            && has_room(&[self.slope_gain])
            && self
                .state_rows
                .iter()
                .all(|row| has_room(&row.coefficients))
    }
}

/// Whether a row stays [`bounded`] when its coefficients are divided by four fifths, or multiplied by less.
#[inline(never)]
fn has_room(row: &[i32]) -> bool {
    // A unit for the rounding of each.
    row.iter()
        .map(|c| 5 * i64::from(c.unsigned_abs()) + 8)
        .sum::<i64>()
        < 4 << 31
}

/// Whether every intermediate value of a polynomial of the drive share stays within 32 bits
/// ([`SURFACE_LIMITS_UM`]), for coefficients with the degree that each has.
fn bounded_surface(coefficients: impl Iterator<Item = (usize, i32)> + Clone) -> bool {
    SURFACE_LIMITS_UM.iter().enumerate().all(|(degree, limit)| {
        // Rounded up, um with the fraction bits of the constant.
        let magnitude = |(of, c): (usize, i32)| {
            if of < degree {
                0
            } else {
                (i64::from(c.unsigned_abs()) >> of) + 1
            }
        };
        coefficients.clone().map(magnitude).sum::<i64>()
            < i64::from(*limit) << SURFACE_FRACTION_BITS
    })
}

impl LawParameters {
    fn bounded(&self) -> bool {
        match self {
            Self::Hold => true,
            Self::Regulator(p) => {
                bounded(&p.proportional_derivative)
                    && bounded(&p.feedforward)
                    && bounded(&p.notch)
                    && bounded(&p.creep.shares)
                    && bounded(&p.creep.pair_shares)
                    && p.creep.thresholds.iter().all(|threshold| *threshold >= 0)
                    && usize::from(p.creep.terms) <= CREEP_TERMS
            }
            Self::SlidingMode {
                estimator,
                controller: p,
            } => {
                let reaching = match &p.reaching {
                    Reaching::Pid {
                        proportional_derivative,
                        ..
                    } => bounded(proportional_derivative),
                    Reaching::Switching { magnitude } => *magnitude >= 0,
                    Reaching::BoundaryLayer {
                        magnitude,
                        thickness,
                    } => *magnitude >= 0 && *thickness >= 0,
                };
                reaching
                    && estimator.rows.iter().all(bounded)
                    && bounded(&estimator.unknown_input)
                    && bounded(&p.reference_velocity)
                    && bounded(&p.reference_drive)
                    && bounded(&p.switching_function)
                    && bounded(&p.equivalent_control)
                    && p.prediction
                        .iter()
                        .flat_map(|prediction| &prediction.rows)
                        .all(bounded)
            }
            Self::Predictor(p) => {
                p.state_rows.iter().all(bounded)
                    && bounded(&p.reading_row)
                    && bounded(&p.gain_row)
                    && bounded(&p.feedforward)
            }
        }
    }
}

/// Whether the integers of the sensor and of the drive keep every position and drive within its format, with
/// feedback of the right sign.
///
/// Position is within +-128 um and drive within +-512 V ([`crate::signal`]). The sensor is zeroed wherever it
/// stands, so its whole span must fit on one side of zero: 127 um.
fn converters_fit(c: &ConverterParameters) -> Result<(), BlockError> {
    let has_bits = |bits: u8| (LEAST_BITS..=MOST_BITS).contains(&bits);
    if !has_bits(c.adc_bits)
        || !has_bits(c.dac_bits)
        || c.dac_code_max > DriveCode::highest(c.dac_bits)
    {
        return Err(BlockError::Range(
            "converters have 8 to 20 bits, and no code beyond them",
        ));
    }
    let end = |zero: i32, step: i64, code: i64| {
        step.checked_mul(code)
            .map(|all| i64::from(zero) + (all >> 16))
    };
    let within = |end: Option<i64>| end.is_some_and(|end| i32::try_from(end).is_ok());
    if c.adc_step <= 0
        || c.adc_step > (127i64 << 40) >> c.adc_bits
        || !within(end(
            c.adc_zero,
            c.adc_step,
            SensorCode::highest(c.adc_bits).into(),
        ))
    {
        return Err(BlockError::Range(
            "the sensor's span must be at most 127 um, within +-128 um",
        ));
    }
    let whole_drive = within(end(0, c.dac_step, c.dac_code_max.into()))
        && within(end(c.dac_zero, c.dac_step, c.dac_code_max.into()));
    if c.dac_step <= 0 || !whole_drive {
        return Err(BlockError::Range("the drive must stay within +-512 V"));
    }
    // V per code (38) times codes per V (16).
    if c.dac_codes_per_volt <= 0 || !reciprocal(c.dac_step, c.dac_codes_per_volt.into(), 54) {
        return Err(BlockError::Mismatch);
    }
    Ok(())
}

/// Whether the actuator's integers keep every signal within its format and fit the limits of the drive.
fn actuator_fits(
    actuator: &ActuatorParameters,
    physical: &PhysicalDescription,
    step_mv: i64,
) -> Result<(), BlockError> {
    match actuator {
        ActuatorParameters::Direct => Ok(()),
        ActuatorParameters::Linear {
            volts_per_micrometre,
            micrometres_per_volt,
        } => {
            // V/um (20) times um/V (28).
            let fits = reciprocal(
                (*volts_per_micrometre).into(),
                (*micrometres_per_volt).into(),
                48,
            );
            if fits {
                Ok(())
            } else {
                Err(BlockError::Mismatch)
            }
        }
        ActuatorParameters::OneSidedHysteresis {
            surfaces,
            drive_min,
            drive_range,
            share_per_volt,
        } => {
            let within = |(i, j): (usize, usize)| i + j < SURFACE_SIZE;
            let places = (0..SURFACE_SIZE)
                .flat_map(|i| (0..SURFACE_SIZE).map(move |j| (i, j)))
                .filter(|place| within(*place));
            let loops = places.map(|(i, j)| {
                (
                    i + j,
                    surfaces
                        .g
                        .get(i)
                        .and_then(|row| row.get(j))
                        .copied()
                        .unwrap_or(0),
                )
            });
            if !bounded_surface(loops) || !bounded_surface(surfaces.f.iter().copied().enumerate()) {
                return Err(BlockError::Range(
                    "a coefficient of the hysteresis is beyond its format",
                ));
            }
            // Volts with 22 fraction bits, mV.
            let millivolts = |value: i64| (value * 1000) >> 22;
            let near = |value: i64, limit: i64| (millivolts(value) - limit).abs() <= 2 * step_mv;
            let (low, range) = (i64::from(*drive_min), i64::from(*drive_range));
            let limits = near(low, physical.drive_min_mv.into())
                && near(low + range, physical.drive_max_mv.into());
            // V (22) times 1/V (32); a range of less than 1 V would let a share leave 64 bits.
            let fits = limits
                && *share_per_volt <= 1 << 32
                && range > 0
                && reciprocal(range, *share_per_volt, 54);
            if fits && i32::try_from(low + range).is_ok() {
                Ok(())
            } else {
                Err(BlockError::Mismatch)
            }
        }
    }
}

/// Whether parameters are fit to run: made for this sampling rate, stable, with integers that agree with the
/// physical description, with which no signal of the tick can wrap.
///
/// # Errors
/// [`BlockError::SampleRate`], [`BlockError::Unstable`], [`BlockError::Range`], [`BlockError::Mismatch`].
pub fn verify(parameters: &AmplifierParameters, sample_rate_hz: u32) -> Result<(), BlockError> {
    let (physical, c, guard) = (
        &parameters.physical,
        &parameters.servo.converters,
        &parameters.guard,
    );
    if physical.sample_rate_hz != sample_rate_hz || sample_rate_hz == 0 {
        return Err(BlockError::SampleRate(physical.sample_rate_hz));
    }
    if physical.spectral_radius_millionths >= 1_000_000 {
        return Err(BlockError::Unstable);
    }
    converters_fit(c)?;
    let step_mv = ((c.dac_step * 1000) >> 38) + 1;
    actuator_fits(&parameters.servo.actuator, physical, step_mv)?;
    if !parameters.servo.law.bounded() {
        return Err(BlockError::Range(
            "a coefficient of the law is beyond its format",
        ));
    }
    let predicts = matches!(&parameters.servo.law, LawParameters::SlidingMode { controller, .. } if controller.prediction.is_some());
    if predicts && !parameters.servo.delayed {
        return Err(BlockError::Range(
            "an estimate is only carried over the period of delay where there is one",
        ));
    }
    if !parameters.servo.sensor_lag.accepted() {
        return Err(BlockError::Range(
            "the lag of the sensor is beyond its format",
        ));
    }
    if parameters
        .servo
        .learning
        .as_ref()
        .is_some_and(|learning| !learning.accepted())
    {
        return Err(BlockError::Range(
            "the filters of the learned correction are beyond their format",
        ));
    }
    if let Some(adaptation) = &parameters.servo.adaptation {
        let LawParameters::Predictor(law) = &parameters.servo.law else {
            return Err(BlockError::Range("only a predictor adapts its gain"));
        };
        if !adaptation.accepted() || !law.has_room_to_scale() {
            return Err(BlockError::Range(
                "the bounds of the adapted gain are beyond their format",
            ));
        }
    }
    if let Some(stepping) = parameters.stepping.get() {
        stepping_parameters::verify(&parameters.servo, stepping).map_err(BlockError::Range)?;
    }
    if !parameters.knows_its_loop() {
        return Err(BlockError::Range(
            "a law that closes a loop says what the loop passes on",
        ));
    }
    parameters
        .loop_margin()
        .bears(&FilterSetting::OFF)
        .map_err(|_| BlockError::Range("the loop has no margin for the gain that it adapts"))?;
    // V per tick with 38 fraction bits.
    let slew =
        (i64::from(physical.slew_limit_v_s.min(MOST_SLEW_V_S)) << 38) / i64::from(sample_rate_hz);
    if c.slew_codes == 0
        || c.slew_codes > NO_SLEW_LIMIT
        || i64::from(c.slew_codes) * c.dac_step > slew
    {
        return Err(BlockError::Range(
            "the slew limit must allow a code a tick, and no more than it says",
        ));
    }
    if guard.ramp_codes == 0 || guard.ramp_codes > c.slew_codes {
        return Err(BlockError::Range(
            "the ramp to rest must move, and no faster than the slew limit",
        ));
    }
    // Drive at a code, mV: V with 22 fraction bits + codes * V with 38.
    let drive_mv = |code: DriveCode| {
        ((i64::from(c.dac_zero) + ((i64::from(code) * c.dac_step) >> 16)) * 1000) >> 22
    };
    let near = |code: DriveCode, limit_mv: i32| {
        (drive_mv(code) - i64::from(limit_mv)).abs() <= 2 * step_mv
    };
    let span_nm = (((c.adc_step << c.adc_bits) >> 16) * 1000) >> 24;
    let fits = c.dac_code_min < c.dac_code_max
        && near(c.dac_code_min, physical.drive_min_mv)
        && near(c.dac_code_max, physical.drive_max_mv)
        && (span_nm - i64::from(physical.sensor_span_nm)).abs()
            <= i64::from(physical.sensor_span_nm) / 1000 + 1
        && (c.dac_code_min..=c.dac_code_max).contains(&guard.rest_code)
        && guard.adc_code_min < guard.adc_code_max
        && guard.adc_code_max <= SensorCode::highest(c.adc_bits);
    if fits {
        Ok(())
    } else {
        Err(BlockError::Mismatch)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    extern crate std;
    use super::*;
    use crate::loop_bands::BANDS;
    use std::vec::Vec;

    /// Bounds of the adapted gain.
    pub(crate) const ADAPTATION_EXAMPLE: AdaptationParameters = AdaptationParameters {
        most: 1 << 21,
        most_step: 1 << 17,
        error_limit: 1 << 23,
        least_motion: 1 << 18,
    };

    /// Triangular rows that learn slowly.
    pub(crate) fn learning_example() -> LearningParameters {
        let taps = |scale: i32| {
            core::array::from_fn(|k| {
                if k == 0 {
                    0
                } else {
                    (32 - (k as i32 - 32).abs()) * scale
                }
            })
        };
        LearningParameters {
            learning: Row {
                coefficients: taps(-77),
            },
            robustness: Row {
                coefficients: taps(9),
            },
            error_limit: 1 << 22,
            point_limit: 3000,
            periods_per_halving: 2,
            most_halvings: 3,
        }
    }

    /// A plausible block: DAC -20..120 V, ADC 15 um, drive 0..80 V.
    pub(crate) fn example() -> AmplifierParameters {
        let dac_step = ((140i64 << 38) + 32_768) >> 16;
        AmplifierParameters {
            physical: PhysicalDescription {
                name: *b"p753\0\0\0\0\0\0\0\0\0\0\0\0",
                sample_rate_hz: 20_000,
                drive_min_mv: 0,
                drive_max_mv: 80_000,
                slew_limit_v_s: 100_000,
                sensor_span_nm: 15_000,
                spectral_radius_millionths: 990_000,
            },
            servo: ServoParameters {
                sensor_lag: SensorLag::NONE,
                converters: ConverterParameters {
                    adc_zero: -(1 << 24),
                    adc_step: (15i64 << 40) >> 16,
                    dac_zero: -20 << 22,
                    dac_step,
                    dac_codes_per_volt: ((65_536i64 << 16) / 140) as i32,
                    dac_code_min: DriveCode::new(9363),
                    dac_code_max: DriveCode::new(46_811),
                    slew_codes: 2340,
                    adc_bits: 16,
                    dac_bits: 16,
                    noise_shaping: false,
                },
                actuator: ActuatorParameters::Linear {
                    volts_per_micrometre: 7 << 20,
                    micrometres_per_volt: (1 << 28) / 7,
                },
                law: LawParameters::Regulator(PidParameters {
                    proportional_derivative: Row {
                        coefficients: [1 << 17, 0],
                    },
                    integral: 1 << 22,
                    feedforward: Row::default(),
                    creep: CreepInverseParameters::default(),
                    notch: Row {
                        coefficients: [1 << 28, 0, 0, 0, 0],
                    },
                }),
                delayed: true,
                learning: None,
                adaptation: None,
            },
            guard: GuardParameters {
                adc_code_min: SensorCode::new(16),
                adc_code_max: SensorCode::new(65_519),
                stuck_ticks: 50,
                jump_codes: 8000,
                tracking_error: 4 << 24,
                tracking_ticks: 200,
                ramp_codes: 40,
                rest_code: DriveCode::new(9363),
                healthy_ticks: 1000,
            },
            stepping: IfStepping::NONE,
            loop_bands: LoopBands {
                transmission: [32; BANDS],
            },
        }
    }

    #[test]
    fn every_law_and_actuator_comes_back_as_it_went() {
        let mut parameters = example();
        let row = Row {
            coefficients: core::array::from_fn(|k| k as i32 * 1_000_003 - 7),
        };
        let laws = [
            LawParameters::Hold,
            parameters.servo.law,
            LawParameters::SlidingMode {
                estimator: EstimatorParameters {
                    rows: [Row {
                        coefficients: [1, -2, 3, -4, 5, i32::MIN / 2],
                    }; 3],
                    unknown_input: Row::default(),
                },
                controller: SlidingModeParameters {
                    reference_velocity: row,
                    reference_drive: Row {
                        coefficients: row.coefficients,
                    },
                    switching_function: Row {
                        coefficients: [3, 4],
                    },
                    equivalent_control: Row {
                        coefficients: [5, 6],
                    },
                    reaching: Reaching::BoundaryLayer {
                        magnitude: 7,
                        thickness: 8,
                    },
                    prediction: None,
                },
            },
            LawParameters::Predictor(PredictorParameters {
                state_rows: [Row {
                    coefficients: core::array::from_fn(|k| -(k as i32)),
                }; crate::predictor_law::STATES],
                unknown_gain: 11,
                slope_gain: -12,
                reading_row: Row::default(),
                gain_row: Row::default(),
                feedforward: Row {
                    coefficients: row.coefficients,
                },
            }),
            LawParameters::SlidingMode {
                estimator: EstimatorParameters {
                    rows: [Row::default(); 3],
                    unknown_input: Row::default(),
                },
                controller: SlidingModeParameters {
                    reference_velocity: row,
                    reference_drive: Row {
                        coefficients: row.coefficients,
                    },
                    switching_function: Row {
                        coefficients: [3, 4],
                    },
                    equivalent_control: Row {
                        coefficients: [5, 6],
                    },
                    reaching: Reaching::Pid {
                        proportional_derivative: Row {
                            coefficients: [7, 8],
                        },
                        integral: 9,
                    },
                    prediction: Some(Prediction {
                        rows: [Row {
                            coefficients: [1, -2, 3, -4],
                        }; 2],
                    }),
                },
            },
        ];
        let surfaces = SurfaceCoefficients {
            g: [[1, 2, 3, 4, 5]; 5],
            f: [-1, -2, -3, -4, -5],
        };
        let actuators = [
            ActuatorParameters::Direct,
            parameters.servo.actuator,
            ActuatorParameters::OneSidedHysteresis {
                surfaces,
                drive_min: 0,
                drive_range: 80 << 22,
                share_per_volt: (1 << 32) / 80,
            },
        ];
        let learning = learning_example();
        for (nth, law) in laws.into_iter().enumerate() {
            for actuator in actuators {
                parameters.servo.learning = (nth % 2 == 1).then_some(learning);
                parameters.servo.law = law;
                let adapts = matches!(law, LawParameters::Predictor(_))
                    && actuator != ActuatorParameters::Direct;
                parameters.servo.adaptation = adapts.then_some(ADAPTATION_EXAMPLE);
                parameters.servo.learning = parameters
                    .servo
                    .learning
                    .filter(|_| !matches!(actuator, ActuatorParameters::Linear { .. }));
                parameters.servo.actuator = actuator;
                parameters.servo.sensor_lag = SensorLag {
                    carried: 1_000_003 * nth as i32 - 5,
                    before: -7,
                };
                let mut bytes = [0xff; BLOCK_BYTES];
                let length = write(&parameters, &mut bytes).expect("fits");
                assert_eq!(read(&bytes, 20_000), Ok(parameters));
                assert_eq!(read(&bytes[..length], 20_000), Ok(parameters));
                assert_eq!(read(&bytes[..length - 1], 20_000), Err(BlockError::Length));
            }
        }
    }

    #[test]
    fn a_block_gets_its_generation_and_stays_valid() {
        let mut bytes = [0xff; BLOCK_BYTES];
        let length = write(&example(), &mut bytes).expect("fits");
        assert_eq!(generation(&bytes), 0);
        set_generation(&mut bytes[..length], 65_535).expect("a block");
        assert_eq!(
            (generation(&bytes), read(&bytes, 20_000)),
            (65_535, Ok(example()))
        );
        assert_eq!(set_generation(&mut [0; 3], 1), Err(BlockError::Length));
        let print = fingerprint(&bytes);
        set_generation(&mut bytes[..length], 3).expect("a block");
        assert!(
            print.is_some()
                && fingerprint(&bytes) == print
                && fingerprint(&bytes[..length - 5]).is_none()
        );
    }

    #[test]
    fn a_bad_block_is_refused_with_its_reason() {
        let good = example();
        let written = |parameters: &AmplifierParameters| -> Vec<u8> {
            let mut bytes = [0xff; BLOCK_BYTES];
            let length = write(parameters, &mut bytes).expect("fits");
            bytes[..length].to_vec()
        };
        assert_eq!(read(&[0xff; 100], 20_000), Err(BlockError::Absent));
        assert_eq!(read(&[], 20_000), Err(BlockError::Absent));
        assert_eq!(
            read(&written(&good), 10_000),
            Err(BlockError::SampleRate(20_000))
        );
        let mut bytes = written(&good);
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&bytes, 20_000).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        let mut unstable = good;
        unstable.physical.spectral_radius_millionths = 1_000_000;
        assert_eq!(read(&written(&unstable), 20_000), Err(BlockError::Unstable));
        let mut late = good;
        late.servo.sensor_lag.carried = i32::MIN;
        assert!(
            matches!(read(&written(&late), 20_000), Err(BlockError::Range(what)) if what.contains("lag of the sensor"))
        );
        let mut mismatched = good;
        mismatched.servo.converters.dac_code_max = DriveCode::new(65_535);
        assert_eq!(
            read(&written(&mismatched), 20_000),
            Err(BlockError::Mismatch)
        );
        let mut mismatched = good;
        mismatched.physical.sensor_span_nm = 10_000;
        assert_eq!(
            read(&written(&mismatched), 20_000),
            Err(BlockError::Mismatch)
        );
    }
}
