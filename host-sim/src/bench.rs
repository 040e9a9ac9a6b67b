//! The reference bench: a simulated P-753 with its amplifier, sensor and converters, on which every
//! experiment of Hysteron is played.
//!
//! # How it works
//! [`Bench::reference`] reads `bench.toml`, the one place of its constants. [`Bench::plant`] builds the
//! actuator, virgin: amplifier lag, one-sided hysteresis, one or two modes, creep, sensor lag.
//! [`Plant::tick`] carries it over one sampling period with the drive held, in [`SUBSTEPS`] steps; the linear
//! stages are exact in each step and the hysteresis sees the voltage on the piezo at the end of each.
//! [`Bench::record`] plays a whole drive through the converters, noise added, and hands out what an
//! experimenter would see beside the truth.
//!
//! A *plain* bench has only what the thesis' nominal model has; the *full* one also the second mode and the
//! bandwidths that the nominal model leaves out (the bench of domains has all its modes in both). A *loaded*
//! bench carries the additional mass, which lowers both modes.
//!
//! [`Bench::domains`] is a second bench of the same size and interface whose actuator follows other equations
//! ([`crate::domain_stage`]): what was developed on the reference bench is judged there on a plant that is
//! not its model.
//!
//! Identification and design work from records. They never read the constants of the bench.

use crate::converter_scale::ConverterScale;
use crate::domain_stage::{ColouredNoise, DomainStage, DomainTruth};
use crate::effect::vibration::VibrationMode;
use crate::hysteresis_surface::{OneSidedHysteresis, Surfaces};
use crate::linear_system::{ContinuousSystem, FixedSystem};
use crate::noise::WhiteNoise;
use crate::waveform;
use hysteron_core::codes::SensorCode;
use serde::Deserialize;
use std::f64::consts::TAU;

/// Steps of the plant in one sampling period.
pub const SUBSTEPS: usize = 20;

/// Poles of the bench's creep.
const CREEP_POLES: usize = 4;

/// What the sensor's converter can read below the mechanical zero, um: the sensor is mounted so that noise at
/// rest does not clip.
pub const ADC_MARGIN_UM: f64 = 1.0;

/// Mass of the bare end-effector that moves, kg (thesis Ch. 7, 5.1).
pub const END_EFFECTOR_MASS_KG: f64 = 0.150;

/// The reference bench, as read from its file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bench {
    /// Name of the actuator.
    pub name: String,
    /// Lower limit of the drive, V.
    pub drive_min_v: f64,
    /// Upper limit of the drive, V.
    pub drive_max_v: f64,
    /// How the actuator is conditioned before an experiment that does not begin virgin.
    pub conditioning: String,
    /// Offset of references, um.
    pub reference_offset_um: f64,
    /// Hysteresis surfaces; empty on a bench of domains.
    #[serde(default)]
    pub hysteresis: HysteresisTruth,
    /// First mode; zero on a bench of domains.
    #[serde(default)]
    pub vibration: VibrationTruth,
    /// Creep transfer function; empty on a bench of domains.
    #[serde(default)]
    pub creep: CreepTruth,
    /// An actuator of domains, in the place of hysteresis, vibration and creep.
    #[serde(default)]
    pub domains: Option<DomainTruth>,
    /// Converters.
    pub converters: Converters,
    /// What the nominal model leaves out.
    pub full: FullTruth,
}

/// Hysteresis of the bench (thesis Ch. 5 Table 1, repaired).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HysteresisTruth {
    /// `b_0..b_4` of `F`, um/V^k.
    pub f: Vec<f64>,
    /// `p_1..p_15` of `G` in the order of Ch. 4 Eq. (15).
    pub g: Vec<f64>,
}

/// First mode of the bench.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VibrationTruth {
    /// Natural frequency, rad/s.
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// Creep of the bench: displacement = x1 + G2 x1 (thesis Ch. 5 Eq. 17).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CreepTruth {
    /// Numerator of `G2`, descending powers of s.
    pub numerator: Vec<f64>,
    /// Denominator of `G2`, descending powers of s.
    pub denominator: Vec<f64>,
}

/// Converters and sensor noise of the bench.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Converters {
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Bits of the sensor's converter.
    pub adc_bits: u32,
    /// Span of the sensor's converter, um.
    pub adc_span_um: f64,
    /// Bits of the drive's converter.
    pub dac_bits: u32,
    /// Drive at the lowest code, V.
    pub dac_min_v: f64,
    /// Drive one step beyond the highest code, V.
    pub dac_max_v: f64,
    /// RMS noise of the sensor, um.
    pub sensor_noise_um: f64,
}

/// What the full bench has besides.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FullTruth {
    /// Share of the motion in the second mode.
    pub second_mode_share: f64,
    /// Frequency of the second mode, Hz.
    pub second_mode_hz: f64,
    /// Damping ratio of the second mode.
    pub second_mode_damping_ratio: f64,
    /// Bandwidth of the amplifier, Hz.
    pub amplifier_bandwidth_hz: f64,
    /// Bandwidth of the sensor, Hz.
    pub sensor_bandwidth_hz: f64,
    /// Additional mass in the loaded case, kg.
    pub load_mass_kg: f64,
}

/// How complete the simulated actuator is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Completeness {
    /// Only what the nominal model of the thesis has.
    #[default]
    Plain,
    /// Also the second mode and the bandwidths of amplifier and sensor.
    Full,
}

/// One variant of the bench.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Variant {
    /// Plain or full.
    pub completeness: Completeness,
    /// Carries the additional mass.
    pub loaded: bool,
}

impl Variant {
    /// The plain bench without load.
    pub const PLAIN: Self = Self {
        completeness: Completeness::Plain,
        loaded: false,
    };
    /// The full bench without load.
    pub const FULL: Self = Self {
        completeness: Completeness::Full,
        loaded: false,
    };
}

/// From where an experiment begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Never driven, everything at rest at the lower limit; the sensor reads zero.
    Virgin,
    /// Conditioned as the bench prescribes, then the sensor is zeroed.
    Conditioned,
}

/// A played experiment: what was commanded and read, and the truth beside it. Element `k` belongs to the
/// instant `t[k]`; `drive_v[k]` acts from `t[k]` to `t[k+1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchRecord {
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Drive after the converter, V.
    pub drive_v: Vec<f64>,
    /// Reading of the sensor: noise and quantisation included, um.
    pub reading_um: Vec<f64>,
    /// What the sensor would read without noise and quantisation, um.
    pub noise_free_um: Vec<f64>,
    /// True displacement, from the same zero, um.
    pub displacement_um: Vec<f64>,
}

impl Bench {
    /// The reference bench.
    ///
    /// # Errors
    /// If the file that is built in cannot be read, which a test excludes.
    pub fn reference() -> Result<Self, toml::de::Error> {
        Self::from_toml(include_str!("../bench.toml"))
    }

    /// The second bench, of domains.
    ///
    /// # Errors
    /// As [`Self::reference`].
    pub fn domains() -> Result<Self, toml::de::Error> {
        Self::from_toml(include_str!("../bench_domains.toml"))
    }

    /// A bench from the text of a file like `bench.toml`.
    ///
    /// # Errors
    /// If keys are missing, unknown, or of the wrong type, there is no actuator, or creep has more poles than
    /// the bench simulates.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        let bench: Self = toml::from_str(text)?;
        if bench.creep.denominator.len() > CREEP_POLES + 1 {
            return Err(serde::de::Error::custom(format!(
                "creep.denominator: at most {CREEP_POLES} poles"
            )));
        }
        if bench.domains.is_none()
            && (bench.hysteresis.f.is_empty() || bench.vibration.natural_frequency_rad_s <= 0.0)
        {
            return Err(serde::de::Error::custom(
                "a bench needs [hysteresis] and [vibration], or [domains]",
            ));
        }
        Ok(bench)
    }

    /// Sampling period, s.
    #[must_use]
    pub fn sampling_period_s(&self) -> f64 {
        1.0 / self.converters.sample_rate_hz
    }

    /// Bandwidth of the sensor as its data sheet gives it, Hz: the one constant that a design may use (within
    /// 5 %).
    #[must_use]
    pub fn data_sheet_sensor_bandwidth_hz(&self) -> f64 {
        self.full.sensor_bandwidth_hz
    }

    /// The drive after the converter: within the limits of the actuator, on a code of the converter.
    #[must_use]
    pub fn drive_after_converter_v(&self, drive_v: f64) -> f64 {
        let scale = self.converter_scale();
        scale.drive_v(scale.dac_code(drive_v))
    }

    /// Resolution of the sensor's converter, um.
    #[must_use]
    pub fn adc_lsb_um(&self) -> f64 {
        self.converters.adc_span_um / 2.0_f64.powi(self.converters.adc_bits as i32)
    }

    /// The converters, the sensor's zero where the actuator is virgin.
    #[must_use]
    pub fn converter_scale(&self) -> ConverterScale {
        let c = &self.converters;
        ConverterScale {
            adc_zero_um: -ADC_MARGIN_UM,
            adc_lsb_um: self.adc_lsb_um(),
            adc_bits: c.adc_bits as u8,
            dac_zero_v: c.dac_min_v,
            dac_lsb_v: (c.dac_max_v - c.dac_min_v) / 2.0_f64.powi(c.dac_bits as i32),
            dac_bits: c.dac_bits as u8,
            drive_min_v: self.drive_min_v,
            drive_max_v: self.drive_max_v,
        }
    }

    /// The actuator, virgin and at rest at the lower limit of the drive.
    #[must_use]
    pub fn plant(&self, variant: Variant) -> Plant {
        self.plant_with_substeps(variant, SUBSTEPS)
    }

    /// The actuator with its sampling period divided into `substeps`.
    #[must_use]
    pub fn plant_with_substeps(&self, variant: Variant, substeps: usize) -> Plant {
        let substeps = substeps.max(1);
        let dt_s = self.sampling_period_s() / substeps as f64;
        let full = variant.completeness == Completeness::Full;
        let mass_factor = if variant.loaded {
            self.loaded_mode_factor()
        } else {
            1.0
        };
        let lag = |bandwidth_hz: f64| {
            ContinuousSystem::from_transfer_function(&[1.0], &[1.0 / (TAU * bandwidth_hz), 1.0])
                .and_then(|system| FixedSystem::new(&system.discretise(dt_s)))
        };
        let surfaces = || {
            let range_v = self.drive_max_v - self.drive_min_v;
            let surfaces =
                Surfaces::from_thesis_powers(&self.hysteresis.f, &self.hysteresis.g, range_v);
            SurfaceStage {
                hysteresis: OneSidedHysteresis::virgin(surfaces, self.drive_min_v, range_v),
                first_mode: VibrationMode::new(
                    self.vibration.natural_frequency_rad_s * mass_factor,
                    self.vibration.damping_ratio * mass_factor,
                    dt_s,
                ),
                second_mode: full.then(|| {
                    let frequency_rad_s = TAU * self.full.second_mode_hz * mass_factor;
                    (
                        self.full.second_mode_share,
                        VibrationMode::new(
                            frequency_rad_s,
                            self.full.second_mode_damping_ratio * mass_factor,
                            dt_s,
                        ),
                    )
                }),
                creep: ContinuousSystem::from_transfer_function(
                    &self.creep.numerator,
                    &self.creep.denominator,
                )
                .and_then(|g2| FixedSystem::new(&g2.discretise(dt_s))),
            }
        };
        let load_kg = if variant.loaded {
            self.full.load_mass_kg
        } else {
            0.0
        };
        let limits_v = (self.drive_min_v, self.drive_max_v);
        Plant {
            substeps,
            amplifier: if full {
                lag(self.full.amplifier_bandwidth_hz)
            } else {
                None
            },
            stage: match &self.domains {
                Some(truth) => {
                    Actuator::Domains(DomainStage::virgin(truth, limits_v, load_kg, dt_s))
                }
                None => Actuator::Surfaces(Box::new(surfaces())),
            },
            coloured: self.coloured_noise(0),
            sensor: if full {
                lag(self.full.sensor_bandwidth_hz)
            } else {
                None
            },
            mean_weight: {
                let step = TAU * self.full.amplifier_bandwidth_hz * dt_s;
                1.0 / -(-step).exp_m1() - 1.0 / step
            },
            piezo_v: self.drive_min_v,
            force_equivalent_um: 0.0,
            displacement_um: 0.0,
            sensor_um: 0.0,
        }
    }

    /// The drive of the conditioning cycle: one raised cosine over the whole range at 10 Hz, then a second at
    /// rest.
    #[must_use]
    pub fn conditioning_drive_v(&self) -> Vec<f64> {
        let fs = self.converters.sample_rate_hz;
        waveform::concatenate(&[
            waveform::raised_cosine(fs, 10.0, self.drive_min_v, self.drive_max_v, 1),
            waveform::hold(fs, self.drive_min_v, 1.0),
        ])
    }

    /// Conditions a plant and returns the position at which the sensor is then zeroed, um.
    pub fn condition(&self, plant: &mut Plant) -> f64 {
        for drive_v in self.conditioning_drive_v() {
            plant.tick(self.drive_after_converter_v(drive_v));
        }
        plant.sensor_um()
    }

    /// What the load's mass on the end-effector makes of natural frequency and damping ratio of a mode: more
    /// mass on the same spring (thesis Ch. 5, Eq. 12).
    #[must_use]
    pub fn loaded_mode_factor(&self) -> f64 {
        (END_EFFECTOR_MASS_KG / (END_EFFECTOR_MASS_KG + self.full.load_mass_kg)).sqrt()
    }

    /// What the sensor adds beside its white noise; none on a bench that has only that.
    #[must_use]
    pub fn coloured_noise(&self, seed: u64) -> Option<ColouredNoise> {
        Some(ColouredNoise::new(
            &self.domains.as_ref()?.sensor,
            self.converters.sample_rate_hz,
            seed,
        ))
    }

    /// Plays a drive and returns what is seen and what is true. The same seed gives the same noise.
    #[must_use]
    pub fn record(
        &self,
        variant: Variant,
        start: Start,
        drive_v: &[f64],
        seed: u64,
    ) -> BenchRecord {
        let mut plant = self.plant(variant);
        let zero_um = match start {
            Start::Virgin => 0.0,
            Start::Conditioned => self.condition(&mut plant),
        };
        let mut sensor = Sensor::new(self, zero_um, seed);
        let mut record = BenchRecord {
            sample_rate_hz: self.converters.sample_rate_hz,
            drive_v: Vec::with_capacity(drive_v.len()),
            reading_um: Vec::with_capacity(drive_v.len()),
            noise_free_um: Vec::with_capacity(drive_v.len()),
            displacement_um: Vec::with_capacity(drive_v.len()),
        };
        for command_v in drive_v {
            let applied_v = self.drive_after_converter_v(*command_v);
            record.reading_um.push(sensor.read(&plant));
            record.noise_free_um.push(plant.sensor_um() - zero_um);
            record
                .displacement_um
                .push(plant.displacement_um() - zero_um);
            record.drive_v.push(applied_v);
            plant.tick(applied_v);
        }
        record
    }
}

/// The sensor's noise and converter, with its zero.
#[derive(Clone, Debug)]
pub struct Sensor {
    scale: ConverterScale,
    zero_um: f64,
    noise: WhiteNoise,
    coloured: Option<ColouredNoise>,
}

impl Sensor {
    /// A sensor that reads zero at the position `zero_um`.
    #[must_use]
    pub fn new(bench: &Bench, zero_um: f64, seed: u64) -> Self {
        let noise = WhiteNoise::new(bench.converters.sensor_noise_um, seed);
        Self {
            scale: bench.converter_scale(),
            zero_um,
            noise,
            coloured: bench.coloured_noise(seed),
        }
    }

    /// Reads the plant now, um.
    pub fn read(&mut self, plant: &Plant) -> f64 {
        let code = self.read_code(plant);
        self.scale.position_um(code) - self.zero_um
    }

    /// Reads the plant now, as the converter's code (which knows no zero).
    pub fn read_code(&mut self, plant: &Plant) -> SensorCode {
        let coloured_um = self.coloured.as_mut().map_or(0.0, ColouredNoise::next_um);
        self.scale
            .adc_code(plant.sensor_um() + self.noise.next_um() + coloured_um)
    }
}

/// The actuator of the reference bench between the voltage on the piezo and the displacement.
#[derive(Clone, Debug)]
struct SurfaceStage {
    hysteresis: OneSidedHysteresis,
    first_mode: VibrationMode,
    second_mode: Option<(f64, VibrationMode)>,
    creep: Option<FixedSystem<CREEP_POLES>>,
}

impl SurfaceStage {
    fn move_by(&mut self, force_um: f64) -> f64 {
        let first_um = self.first_mode.step(force_um);
        let moved_um = match &mut self.second_mode {
            Some((share, mode)) => first_um + *share * (mode.step(force_um) - first_um),
            None => first_um,
        };
        moved_um
            + self
                .creep
                .as_mut()
                .map_or(0.0, |g2| g2.step_straight(moved_um))
    }
}

/// One actuator or the other.
#[derive(Clone, Debug)]
enum Actuator {
    Surfaces(Box<SurfaceStage>),
    Domains(DomainStage),
}

impl Actuator {
    /// The force of the piezo at a voltage, as the displacement that it makes at rest, um.
    fn force_um(&mut self, piezo_v: f64) -> f64 {
        match self {
            Self::Surfaces(stage) => stage.hysteresis.step(piezo_v),
            Self::Domains(stage) => stage.domains.step(piezo_v),
        }
    }

    /// One step under a force; the displacement at its end, um.
    fn move_by(&mut self, force_um: f64) -> f64 {
        match self {
            Self::Surfaces(stage) => stage.move_by(force_um),
            Self::Domains(stage) => stage.move_by(force_um),
        }
    }
}

/// The actuator of the bench with its state.
#[derive(Clone, Debug)]
pub struct Plant {
    substeps: usize,
    amplifier: Option<FixedSystem<1>>,
    stage: Actuator,
    /// What a sensor adds in a closed loop beside white noise.
    coloured: Option<ColouredNoise>,
    sensor: Option<FixedSystem<1>>,
    /// Where the mean of the voltage over a step lies between its two ends.
    mean_weight: f64,
    piezo_v: f64,
    force_equivalent_um: f64,
    displacement_um: f64,
    sensor_um: f64,
}

impl Plant {
    /// One sampling period with the drive held at `drive_v`.
    pub fn tick(&mut self, drive_v: f64) {
        self.tick_with_force(drive_v, 0.0);
    }

    /// One sampling period with the drive and an external force held; the force is given as the displacement
    /// that it makes at rest, um. It acts where the piezo's own force acts, in front of the modes.
    pub fn tick_with_force(&mut self, drive_v: f64, external_um: f64) {
        if self.amplifier.is_none() {
            // The piezo has the drive's voltage at once and for the whole period.
            self.piezo_v = drive_v;
            self.force_equivalent_um = self.stage.force_um(drive_v);
        }
        for _ in 0..self.substeps {
            let piezo_um = match &mut self.amplifier {
                // The voltage moves within the step as an exponential: so does, to first order, its force.
                Some(amplifier) => {
                    self.piezo_v = amplifier.step_held(drive_v);
                    let end_um = self.stage.force_um(self.piezo_v);
                    let mean_um = self.force_equivalent_um
                        + self.mean_weight * (end_um - self.force_equivalent_um);
                    self.force_equivalent_um = end_um;
                    mean_um
                }
                None => self.force_equivalent_um,
            };
            self.displacement_um = self.stage.move_by(piezo_um + external_um);
            self.sensor_um = self.sensor.as_mut().map_or(self.displacement_um, |lag| {
                lag.step_straight(self.displacement_um)
            });
        }
    }

    /// True displacement now, from the virgin position, um.
    #[must_use]
    pub fn displacement_um(&self) -> f64 {
        self.displacement_um
    }

    /// What an ideal converter without noise would read now, from the virgin position, um.
    #[must_use]
    pub fn sensor_um(&self) -> f64 {
        self.sensor_um
    }

    /// Gives what the sensor adds beside its white noise another seed.
    pub fn seed_sensor(&mut self, bench: &Bench, seed: u64) {
        self.coloured = bench.coloured_noise(seed);
    }

    /// The next value of what the sensor adds beside its white noise, um.
    pub fn next_coloured_um(&mut self) -> f64 {
        self.coloured.as_mut().map_or(0.0, ColouredNoise::next_um)
    }

    /// Voltage on the piezo now, V.
    #[must_use]
    pub fn piezo_v(&self) -> f64 {
        self.piezo_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rms_difference(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    #[test]
    fn the_built_in_bench_is_readable_and_strict() {
        let bench = Bench::reference().unwrap();
        assert_eq!(bench.name, "p753");
        assert!(
            Bench::from_toml(&(include_str!("../bench.toml").to_string() + "\nfoo = 1\n")).is_err()
        );
    }

    #[test]
    fn at_rest_it_follows_the_initial_curve_and_creeps_to_its_static_gain() {
        let bench = Bench::reference().unwrap();
        let mut plant = bench.plant(Variant::PLAIN);
        for _ in 0..400 {
            plant.tick(70.0);
        }
        // 20 ms after a step to 70 V: 10.74 um (thesis Ch. 5 Table 1) and a little creep.
        assert!(
            (plant.displacement_um() - 10.74).abs() < 0.08,
            "{}",
            plant.displacement_um()
        );
        let g2_static = 9.404 / 125.0;
        let mut slow = bench.plant_with_substeps(Variant::PLAIN, 1);
        for _ in 0..2_000_000 {
            slow.tick(70.0);
        }
        assert!((slow.displacement_um() / (10.74 * (1.0 + g2_static)) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn twenty_substeps_are_enough() {
        let bench = Bench::reference().unwrap();
        let drive = waveform::raised_cosine(20_000.0, 300.0, 0.0, 70.0, 6);
        for variant in [
            Variant::PLAIN,
            Variant::FULL,
            Variant {
                loaded: true,
                ..Variant::FULL
            },
        ] {
            let play = |substeps: usize| -> Vec<f64> {
                let mut plant = bench.plant_with_substeps(variant, substeps);
                drive
                    .iter()
                    .map(|u| {
                        plant.tick(*u);
                        plant.sensor_um()
                    })
                    .collect()
            };
            let error = rms_difference(&play(SUBSTEPS), &play(10 * SUBSTEPS));
            assert!(error < 1e-4, "{variant:?}: {error} um");
        }
    }

    #[test]
    fn records_are_repeatable_noisy_and_within_the_converters() {
        let bench = Bench::reference().unwrap();
        let drive = waveform::sine(20_000.0, 50.0, 45.0, 40.0, 0.0, 0.1);
        let a = bench.record(Variant::FULL, Start::Conditioned, &drive, 1);
        assert_eq!(
            a,
            bench.record(Variant::FULL, Start::Conditioned, &drive, 1)
        );
        let b = bench.record(Variant::FULL, Start::Conditioned, &drive, 2);
        assert_eq!(a.noise_free_um, b.noise_free_um);
        let noise = rms_difference(&a.reading_um, &a.noise_free_um);
        assert!((noise - 0.001).abs() < 1e-4, "{noise}");
        assert!(a.drive_v.iter().all(|u| (-0.002..=80.002).contains(u)));
        assert!(a.noise_free_um[0].abs() < 1e-12);
    }

    /// The second bench is an actuator of the same size: first rise, remnant and loops of the reference bench
    /// within a twentieth of the range.
    #[test]
    fn the_second_bench_is_of_the_same_size() {
        let (reference, domains) = (Bench::reference().unwrap(), Bench::domains().unwrap());
        let fs = reference.converters.sample_rate_hz;
        let drive = waveform::half_cosines(fs, 0.02, &[0.0, 80.0, 0.0, 60.0, 20.0, 70.0, 0.0]);
        let [a, b] = [&reference, &domains]
            .map(|bench| bench.record(Variant::FULL, Start::Virgin, &drive, 3));
        assert!(
            rms_difference(&a.noise_free_um, &b.noise_free_um) < 0.5,
            "{}",
            rms_difference(&a.noise_free_um, &b.noise_free_um)
        );
        assert!(rms_difference(&a.noise_free_um, &b.noise_free_um) > 0.05);
        // Its noise is not white: slow parts and lines stand above the sum of what the reference has.
        let added: Vec<f64> = b
            .reading_um
            .iter()
            .zip(&b.noise_free_um)
            .map(|(read, free)| read - free)
            .collect();
        let rms_um = (added.iter().map(|n| n * n).sum::<f64>() / added.len() as f64).sqrt();
        assert!((0.001..0.003).contains(&rms_um), "{rms_um}");
    }

    #[test]
    fn load_lowers_the_modes() {
        let bench = Bench::reference().unwrap();
        let drive = waveform::hold(20_000.0, 30.0, 0.01);
        let bare = bench.record(Variant::PLAIN, Start::Virgin, &drive, 1);
        let loaded = bench.record(
            Variant {
                loaded: true,
                ..Variant::PLAIN
            },
            Start::Virgin,
            &drive,
            1,
        );
        let rise = |r: &BenchRecord| r.noise_free_um.iter().position(|y| *y > 2.0).unwrap();
        assert!(rise(&loaded) > rise(&bare));
        assert!((loaded.noise_free_um[199] - bare.noise_free_um[199]).abs() < 0.02);
    }
}
