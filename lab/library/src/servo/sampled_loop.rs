//! The one judge of a sampled loop: a law and a plant in, poles, margins and what the loop lets through out.
//!
//! Every law closes the loop as a [`PredictorDesign`], every plant is a [`SampledModel`] with its delay inside
//! ([`PlantVariation`](super::plant_set::PlantVariation)). Stability is decided by the eigenvalues of the
//! whole loop ([`SampledLoop::spectral_radius`]). Margins, sensitivity and noise come from its frequency
//! response ([`LoopResponse`]).

use super::law::{PredictorDesign, STATES};
use super::model::{LinearModel, SampledModel};
use nalgebra::{Complex, DMatrix, SMatrix, SVector, Schur};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

/// Iterations for eigenvalues; a loop of 60 states takes some hundred.
const MOST_ITERATIONS: usize = 10_000;
/// Squarings of a matrix that may show that it is stable: to its power of 4096.
const SQUARINGS: usize = 13;
/// Poles below this magnitude belong to states that the law does not use.
const UNUSED: f64 = 1e-9;
/// Harmonics of a reference at which the hysteresis model is in error, with their shares of the error.
const ERROR_HARMONICS: [(f64, f64); 4] = [(1.0, 1.0), (2.0, 0.5), (3.0, 0.33), (5.0, 0.2)];

const ONE: Complex<f64> = Complex::new(1.0, 0.0);

/// A law and the plant that it drives.
#[derive(Clone, Copy)]
pub struct SampledLoop<'a> {
    /// The law.
    pub law: &'a PredictorDesign,
    /// The plant, its delay included.
    pub plant: &'a SampledModel,
    /// Gain of the plant over the one that the law inverts.
    pub gain: f64,
}

impl<'a> SampledLoop<'a> {
    /// Of a law on a plant with the gain that the law inverts.
    #[must_use]
    pub fn new(law: &'a PredictorDesign, plant: &'a SampledModel) -> Self {
        Self {
            law,
            plant,
            gain: 1.0,
        }
    }

    /// On a plant with this gain over the one that the law inverts.
    #[must_use]
    pub fn with_gain(self, gain: f64) -> Self {
        Self { gain, ..self }
    }

    /// Transition matrix of the loop: states of the plant, then of the law.
    #[must_use]
    pub fn matrix(&self) -> DMatrix<f64> {
        let Self { law, plant, gain } = *self;
        let n = plant.a.nrows();
        let mut m = DMatrix::zeros(n + STATES, n + STATES);
        m.view_mut((0, 0), (n, n)).copy_from(&plant.a);
        let command = -law.k.transpose();
        m.view_mut((n, n), (STATES, STATES))
            .copy_from(&law.transition());
        m.view_mut((n, 0), (STATES, n))
            .copy_from(&(&law.l * plant.c.transpose()));
        m.view_mut((0, n), (n, STATES))
            .copy_from(&(&plant.b * &command * gain));
        m
    }

    /// The loop's eigenvalues.
    #[must_use]
    pub fn poles(&self) -> Vec<Complex<f64>> {
        used_poles(&self.matrix())
    }

    /// Largest magnitude of the loop's eigenvalues: below one the loop is stable.
    #[must_use]
    pub fn spectral_radius(&self) -> f64 {
        let matrix = self.matrix();
        // The iteration for eigenvalues need not come to an end on a matrix that is nearly defective, as a
        // loop with a small share is.
        let schur = Schur::try_new(matrix.clone(), f64::EPSILON, MOST_ITERATIONS);
        schur.map_or_else(
            || growth(matrix),
            |schur| {
                let poles = schur.complex_eigenvalues();
                poles.iter().map(|z| z.norm()).fold(0.0, f64::max)
            },
        )
    }

    /// Whether every eigenvalue is inside the unit circle.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        contracts(self.matrix()) || self.spectral_radius() < 1.0
    }

    /// The loop over a grid of frequencies.
    #[must_use]
    pub fn response(&self, grid: &FrequencyGrid) -> LoopResponse {
        let law = LawResponse::new(self.law);
        LoopResponse::new(grid, &plant_responses(self.plant, self.gain, grid), &law)
    }

    /// What an input disturbance at a frequency, rad/s, becomes on the true position.
    #[must_use]
    pub fn disturbance_response(&self, omega_rad_s: f64) -> Complex<f64> {
        let p = self.gain * frequency_response(self.plant, omega_rad_s);
        p / (ONE + p * law_response(self.law, omega_rad_s / TAU))
    }
}

/// Eigenvalues of a loop's matrix without those of states that its law does not use; none where the iteration
/// does not come to an end.
#[must_use]
pub fn used_poles(matrix: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let schur = Schur::try_new(matrix.clone(), f64::EPSILON, MOST_ITERATIONS);
    let poles = schur.map(|schur| schur.complex_eigenvalues());
    let poles = poles.iter().flat_map(|poles| poles.iter().copied());
    poles.filter(|z| z.norm() > UNUSED).collect()
}

/// Growth of a system per step by Gelfand's formula, `|M^n|^(1/n)` with `n = 2^40`: the spectral radius
/// without eigenvalues.
fn growth(mut matrix: DMatrix<f64>) -> f64 {
    let (mut logarithm, mut weight) = (0.0, 1.0);
    for _ in 0..40 {
        let norm = matrix.norm();
        if norm == 0.0 || !norm.is_finite() {
            return norm;
        }
        logarithm += weight * norm.ln();
        matrix /= norm;
        matrix = &matrix * &matrix;
        weight *= 0.5;
    }
    logarithm.exp()
}

/// Whether a power of a matrix is below one, which shows that it is stable at a fraction of what eigenvalues
/// take. A false answer shows nothing.
fn contracts(mut power: DMatrix<f64>) -> bool {
    for _ in 0..SQUARINGS {
        let norm = power.norm();
        if norm < 1.0 {
            return true;
        }
        // Beyond that a square has no digits to the right of one.
        if norm.is_nan() || norm > 1e6 {
            return false;
        }
        power = &power * &power;
    }
    false
}

/// Frequencies at which a loop is looked at, each with the width of the band that it stands for.
#[derive(Clone, Debug)]
pub struct FrequencyGrid {
    /// Frequencies, Hz, ascending.
    pub hz: Vec<f64>,
    width_hz: Vec<f64>,
    highest_hz: f64,
}

impl FrequencyGrid {
    /// Even steps up to half the sampling rate, and close together about every mode.
    #[must_use]
    pub fn about_modes(linear: &LinearModel) -> Self {
        Self::ascending(Self::near_modes(linear), linear.period_s)
    }

    /// What [`FrequencyGrid::about_modes`] has, and steps of a sixteenth of an octave, so that every
    /// half-octave down to a thousandth of the sampling rate has some.
    #[must_use]
    pub fn by_octaves(linear: &LinearModel) -> Self {
        let mut hz = Self::near_modes(linear);
        hz.extend((1..170).map(|i| 0.5 / linear.period_s * 2f64.powf(-f64::from(i) / 16.0)));
        Self::ascending(hz, linear.period_s)
    }

    fn near_modes(linear: &LinearModel) -> Vec<f64> {
        let highest_hz = 0.5 / linear.period_s;
        let mut hz: Vec<f64> = (1..400)
            .map(|i| highest_hz * f64::from(i) / 400.0)
            .collect();
        hz.extend((0..24).map(|i| 0.5 * 1.2_f64.powi(i)));
        for mode in std::iter::once(linear.first_mode).chain(linear.second_mode.map(|(_, m)| m)) {
            let natural_hz = mode.natural_frequency_rad_s / TAU;
            let step = 0.5 * mode.damping_ratio.min(0.1);
            hz.extend((-12..=12).map(|i| natural_hz * (1.0 + step * f64::from(i))));
        }
        hz
    }

    fn ascending(mut hz: Vec<f64>, period_s: f64) -> Self {
        let highest_hz = 0.5 / period_s;
        hz.retain(|hz| *hz > 0.0 && *hz < highest_hz);
        hz.sort_by(f64::total_cmp);
        let below = std::iter::once(0.0).chain(hz.iter().copied());
        let width_hz = hz.iter().zip(below).map(|(hz, last)| hz - last).collect();
        Self {
            hz,
            width_hz,
            highest_hz,
        }
    }

    /// The middles of so many equal parts of the band up to half the sampling rate.
    #[must_use]
    pub fn even(parts: u32, period_s: f64) -> Self {
        let highest_hz = 0.5 / period_s;
        let width_hz = highest_hz / f64::from(parts);
        Self {
            hz: (0..parts)
                .map(|i| width_hz * (f64::from(i) + 0.5))
                .collect(),
            width_hz: vec![width_hz; parts as usize],
            highest_hz,
        }
    }
}

/// Frequency response of a sampled model.
#[must_use]
pub fn frequency_response(model: &SampledModel, omega_rad_s: f64) -> Complex<f64> {
    let n = model.a.nrows();
    let z = Complex::from_polar(1.0, omega_rad_s * model.period_s);
    let matrix = DMatrix::from_fn(
        n,
        n,
        |i, j| if i == j { z } else { Complex::new(0.0, 0.0) } - Complex::new(model.a[(i, j)], 0.0),
    );
    let b = model.b.map(|v| Complex::new(v, 0.0));
    match matrix.lu().solve(&b) {
        Some(x) => x.iter().zip(model.c.iter()).map(|(x, c)| x * *c).sum(),
        None => Complex::new(f64::NAN, f64::NAN),
    }
}

/// A plant over a grid, its input multiplied by `gain`.
#[must_use]
pub fn plant_responses(plant: &SampledModel, gain: f64, grid: &FrequencyGrid) -> Vec<Complex<f64>> {
    let responses = grid.hz.iter().map(|hz| frequency_response(plant, TAU * hz));
    responses.map(|p| p * gain).collect()
}

/// What a reference becomes on an actuator: motion over reference, from the responses of the actuator, of the
/// feedforward and of the law's drive to the reading, all at one frequency.
#[must_use]
pub fn reference_response(
    plant: Complex<f64>,
    feedforward: Complex<f64>,
    law: Complex<f64>,
) -> Complex<f64> {
    ONE + (plant * feedforward - ONE) / (ONE + plant * law)
}

/// Answer of a law's drive to the reading at a frequency, sign such that the loop is `1 + P K`.
#[must_use]
pub fn law_response(law: &PredictorDesign, hz: f64) -> Complex<f64> {
    LawResponse::new(law).at(hz)
}

/// A law's answer with the sizes known to the compiler: a scan takes some hundred thousand of them.
pub struct LawResponse {
    transition: SMatrix<f64, STATES, STATES>,
    l: SVector<Complex<f64>, STATES>,
    k: SVector<Complex<f64>, STATES>,
    period_s: f64,
}

impl LawResponse {
    /// Of a law.
    #[must_use]
    pub fn new(law: &PredictorDesign) -> Self {
        let (transition, complex) = (law.transition(), |v: f64| Complex::new(v, 0.0));
        Self {
            transition: SMatrix::from_fn(|i, j| transition[(i, j)]),
            l: SVector::from_fn(|i, _| complex(law.l[i])),
            k: SVector::from_fn(|i, _| complex(law.k[i])),
            period_s: law.period_s,
        }
    }

    /// At a frequency, Hz.
    #[must_use]
    pub fn at(&self, hz: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, TAU * hz * self.period_s);
        let matrix = SMatrix::<Complex<f64>, STATES, STATES>::from_fn(|i, j| {
            if i == j {
                z - self.transition[(i, j)]
            } else {
                Complex::new(-self.transition[(i, j)], 0.0)
            }
        });
        matrix
            .lu()
            .solve(&self.l)
            .map_or(Complex::new(f64::NAN, f64::NAN), |x| {
                self.k.iter().zip(x.iter()).map(|(k, x)| k * x).sum()
            })
    }
}

/// A loop at one frequency.
#[derive(Clone, Copy, Debug)]
pub struct ResponsePoint {
    /// Hz.
    pub hz: f64,
    /// Open loop, `P K`.
    pub open: Complex<f64>,
    /// What is left of a disturbance of the reading, `S = 1 / (1 + P K)`.
    pub sensitivity: Complex<f64>,
    /// Answer of the drive to the reading, `K S`.
    pub answer: Complex<f64>,
    /// What noise of the sensor becomes on the true position, `P K S`.
    pub transmission: Complex<f64>,
    width_hz: f64,
}

/// A loop over a grid of frequencies.
pub struct LoopResponse {
    /// By rising frequency.
    pub points: Vec<ResponsePoint>,
    highest_hz: f64,
}

impl LoopResponse {
    /// From the responses of the plant over the grid, and the law.
    #[must_use]
    pub fn new(grid: &FrequencyGrid, plant: &[Complex<f64>], law: &LawResponse) -> Self {
        let at = |((hz, width_hz), p): ((&f64, &f64), &Complex<f64>)| {
            let k = law.at(*hz);
            let open = p * k;
            let sensitivity = ONE / (ONE + open);
            let answer = k * sensitivity;
            ResponsePoint {
                hz: *hz,
                open,
                sensitivity,
                answer,
                transmission: p * answer,
                width_hz: *width_hz,
            }
        };
        Self {
            points: grid
                .hz
                .iter()
                .zip(&grid.width_hz)
                .zip(plant)
                .map(at)
                .collect(),
            highest_hz: grid.highest_hz,
        }
    }

    /// Sensor noise that becomes motion, RMS over RMS.
    #[must_use]
    pub fn noise_transmission(&self) -> f64 {
        let power = |p: &ResponsePoint| p.transmission.norm_sqr() * p.width_hz / self.highest_hz;
        self.points.iter().map(power).sum::<f64>().sqrt()
    }

    /// Largest magnitude of the sensitivity, and its frequency, Hz.
    #[must_use]
    pub fn sensitivity_peak(&self) -> (f64, f64) {
        let all = self.points.iter().map(|p| (p.sensitivity.norm(), p.hz));
        all.max_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::NAN, f64::NAN))
    }

    /// Frequency from which disturbances of the reading are no longer halved in power, Hz.
    #[must_use]
    pub fn bandwidth_hz(&self) -> Option<f64> {
        let passes = |p: &&ResponsePoint| p.sensitivity.norm() > FRAC_1_SQRT_2;
        self.points.iter().find(passes).map(|p| p.hz)
    }

    fn open_pairs(&self) -> impl Iterator<Item = [Complex<f64>; 2]> {
        self.points
            .windows(2)
            .map(|pair| [pair[0].open, pair[1].open])
    }

    /// The least factor that brings a crossing of the negative real axis to -1; none without one inside it.
    #[must_use]
    pub fn gain_margin(&self) -> Option<f64> {
        let crossings = self.open_pairs().filter_map(|[a, b]| {
            let crosses = (a.im < 0.0) != (b.im < 0.0);
            let at = a.re + (b.re - a.re) * a.im / (a.im - b.im);
            (crosses && at < 0.0 && at > -1.0).then(|| -1.0 / at)
        });
        crossings.min_by(f64::total_cmp)
    }

    /// Phase to -180 degrees at the least favourable crossing of gain 1, degrees; none without a crossing.
    #[must_use]
    pub fn phase_margin_deg(&self) -> Option<f64> {
        let crossings = self.open_pairs().filter_map(|[a, b]| {
            let crosses = (a.norm() - 1.0) * (b.norm() - 1.0) <= 0.0 && a.norm() != b.norm();
            crosses.then(|| {
                // The distance of the phase from -180 degrees, whichever way round.
                let share = (1.0 - a.norm()) / (b.norm() - a.norm());
                let at = a + (b - a) * share;
                (PI - at.arg().abs()).to_degrees()
            })
        });
        crossings.min_by(f64::total_cmp)
    }
}

/// Error of the hysteresis model that a loop lets through while a reference of this frequency is followed, um
/// RMS.
#[must_use]
pub fn let_through_um(
    plant: &SampledModel,
    law: &LawResponse,
    reference_hz: f64,
    model_error_um: f64,
) -> f64 {
    let power = |(harmonic, share): &(f64, f64)| {
        let hz = reference_hz * harmonic;
        let p = frequency_response(plant, TAU * hz);
        ((p / (ONE + p * law.at(hz))).norm() * share * model_error_um).powi(2)
    };
    ERROR_HARMONICS.iter().map(power).sum::<f64>().sqrt()
}

/// A factor in decibels.
#[must_use]
pub fn decibels(factor: f64) -> f64 {
    20.0 * factor.log10()
}

#[cfg(test)]
mod tests {
    use super::super::model::SAMPLING_PERIOD_S;
    use super::*;
    use nalgebra::DVector;

    /// `I = g / (z - 1)`: an integral law with this gain per period.
    fn integral(gain: f64) -> PredictorDesign {
        let mut law = PredictorDesign {
            a: DMatrix::zeros(STATES, STATES),
            b: DVector::zeros(STATES),
            c: DVector::zeros(STATES),
            l: DVector::zeros(STATES),
            k: DVector::zeros(STATES),
            feedforward: Vec::new(),
            period_s: SAMPLING_PERIOD_S,
        };
        law.a[(0, 0)] = 1.0;
        law.l[0] = gain;
        law.k[0] = 1.0;
        law
    }

    /// `1 / z`: a plant that stands where the drive of the period before put it.
    fn late() -> SampledModel {
        SampledModel {
            a: DMatrix::zeros(1, 1),
            b: DVector::from_element(1, 1.0),
            c: DVector::from_element(1, 1.0),
            period_s: SAMPLING_PERIOD_S,
        }
    }

    /// `g / (z (z - 1))` has the poles of `z^2 - z + g`: at `g = 1` they reach the unit circle, at `z =
    /// e^(i pi / 3)`.
    #[test]
    fn an_integral_of_a_late_plant_has_the_margins_of_its_closed_form() {
        let (plant, gain) = (late(), 0.2);
        let law = integral(gain);
        let this = SampledLoop::new(&law, &plant);
        let root = (1.0 - 4.0 * gain).sqrt();
        let mut poles: Vec<f64> = this.poles().iter().map(|z| z.re).collect();
        poles.sort_by(f64::total_cmp);
        for (found, expected) in poles.iter().zip([0.5 - 0.5 * root, 0.5 + 0.5 * root]) {
            assert!((found - expected).abs() < 1e-12, "{poles:?}");
        }
        assert!((this.spectral_radius() - (0.5 + 0.5 * root)).abs() < 1e-12);
        assert!(this.with_gain(0.999 / gain).is_stable());
        assert!(!this.with_gain(1.001 / gain).is_stable());
        let response = this.response(&FrequencyGrid::even(20_000, SAMPLING_PERIOD_S));
        assert!((response.gain_margin().unwrap() * gain - 1.0).abs() < 1e-3);
        // |L| = g / (2 sin(w T / 2)), its phase -90 degrees - 1.5 w T.
        let angle = 2.0 * (0.5 * gain).asin();
        let expected_deg = 90.0 - (1.5 * angle).to_degrees();
        let phase_deg = response.phase_margin_deg().unwrap();
        assert!((phase_deg - expected_deg).abs() < 0.01, "{phase_deg}");
        // The noise of `y+ = y - g (y- + n)`: its stationary variance solves the Lyapunov equation.
        let variance = gain * (1.0 + gain) / ((1.0 - gain) * (2.0 + gain));
        let noise = response.noise_transmission();
        assert!((noise.powi(2) / variance - 1.0).abs() < 1e-3, "{noise}");
    }

    /// A sensitivity by the geometry of the closed form: its peak is the inverse of the least distance of the
    /// open loop from -1.
    #[test]
    fn the_sensitivity_is_the_distance_from_minus_one() {
        let (plant, gain) = (late(), 0.4);
        let law = integral(gain);
        let response =
            SampledLoop::new(&law, &plant).response(&FrequencyGrid::even(5000, SAMPLING_PERIOD_S));
        let distance = |i: u32| {
            let z = Complex::from_polar(1.0, PI * (f64::from(i) + 0.5) / 5000.0);
            (ONE + gain / (z * (z - 1.0))).norm()
        };
        let least = (0..5000).map(distance).fold(f64::INFINITY, f64::min);
        let (peak, hz) = response.sensitivity_peak();
        assert!(
            (peak * least - 1.0).abs() < 1e-9 && hz > 2000.0,
            "{peak} {hz}"
        );
        let last = response
            .points
            .iter()
            .take_while(|p| p.hz < response.bandwidth_hz().unwrap());
        assert!(last.last().unwrap().sensitivity.norm() <= FRAC_1_SQRT_2);
    }

    /// What a loop lets through at a frequency, against the loop simulated tick by tick.
    #[test]
    fn poles_and_responses_are_those_of_the_loop_as_it_runs() {
        let linear = LinearModel {
            first_mode: super::super::model::ModeModel {
                natural_frequency_rad_s: 5000.0,
                damping_ratio: 0.1,
            },
            second_mode: None,
            amplifier_bandwidth_hz: None,
            sensor_bandwidth_hz: None,
            period_s: SAMPLING_PERIOD_S,
        };
        let plant = linear.sampled();
        for (gain, ticks) in [(0.005, 4000), (0.08, 400)] {
            let law = integral(gain);
            let this = SampledLoop::new(&law, &plant);
            let mut x = DVector::from_element(plant.b.len(), 1.0);
            let mut sum = 0.0;
            let mut sizes = Vec::new();
            for _ in 0..ticks {
                let y = plant.c.dot(&x);
                x = &plant.a * &x - &plant.b * sum;
                sum += gain * y;
                sizes.push((x.norm_squared() + sum * sum).ln() * 0.5);
            }
            // The mean over the last half of a swinging that grows or dies.
            let slope = |from: usize, to: usize| {
                let n = (to - from) as f64;
                let (mut sxy, mut sxx) = (0.0, 0.0);
                let mean = sizes[from..to].iter().sum::<f64>() / n;
                for (i, size) in sizes[from..to].iter().enumerate() {
                    let at = i as f64 - 0.5 * (n - 1.0);
                    sxy += at * (size - mean);
                    sxx += at * at;
                }
                (sxy / sxx).exp()
            };
            let (grows, radius) = (slope(ticks / 2, ticks), this.spectral_radius());
            assert!((grows - radius).abs() < 2e-3, "{gain}: {grows} {radius}");
            assert_eq!(this.is_stable(), gain < 0.05, "{radius}");
        }
        // A disturbance of the drive at one frequency, once the beginning has died away.
        let (law, hz, ticks) = (integral(0.005), 200.0, 20_000);
        let (mut x, mut sum, mut largest) = (DVector::zeros(plant.b.len()), 0.0, 0.0f64);
        for k in 0..ticks {
            let y = plant.c.dot(&x);
            let disturbance = (TAU * hz * SAMPLING_PERIOD_S * f64::from(k)).sin();
            x = &plant.a * &x + &plant.b * (disturbance - sum);
            sum += 0.005 * y;
            if k > ticks / 2 {
                largest = largest.max(y.abs());
            }
        }
        let response = SampledLoop::new(&law, &plant)
            .disturbance_response(TAU * hz)
            .norm();
        assert!(
            (largest / response - 1.0).abs() < 1e-3,
            "{largest} {response}"
        );
    }

    #[test]
    fn powers_never_find_an_unstable_matrix_stable() {
        let turning = |radius: f64| {
            let (sin, cos) = 0.7f64.sin_cos();
            let turn = [cos, -sin, 50.0, sin, cos, 0.0, 0.0, 0.0, 0.5];
            DMatrix::from_row_slice(3, 3, &turn.map(|value| radius * value))
        };
        assert!(contracts(turning(0.99)));
        assert!(!contracts(turning(1.0)) && !contracts(turning(1.000_01)));
    }

    /// Closed forms: a Jordan block, where eigenvalues need not be found, and a turn with a radius of its
    /// own.
    #[test]
    fn growth_is_the_largest_eigenvalue_without_eigenvalues() {
        let defective = DMatrix::from_fn(4, 4, |i, j| {
            f64::from(u8::from(j == i + 1)) + if i == j { 0.99 } else { 0.0 }
        });
        assert!((growth(defective) - 0.99).abs() < 1e-8);
        let (sin, cos) = 0.7f64.sin_cos();
        #[rustfmt::skip]
        let turning = DMatrix::from_row_slice(3, 3, &[
            1.01 * cos, -1.01 * sin, 5.0,
            1.01 * sin, 1.01 * cos, 0.0,
            0.0, 0.0, 0.5,
        ]);
        assert!((growth(turning) - 1.01).abs() < 1e-8);
        assert!(growth(DMatrix::zeros(2, 2)) < 1e-300);
    }
}
