//! From f64 to the integers of the tick. A number that does not fit is an error that names it, never a
//! clipped number.

use super::creep::{self, CreepPair, CreepTerm};
use super::model::ActuatorModel;
use hysteron_core::creep_inverse::{CREEP_TERMS, CreepInverseParameters};
use hysteron_core::integer_row::Row;
use hysteron_core::one_sided_hysteresis::{
    SURFACE_LIMITS_UM, SURFACE_SIZE, SurfaceCoefficients, surface_fraction_bits,
};
use hysteron_core::predictor_law::{OUTPUT_ROW_FRACTION_BITS, STATE_ROW_FRACTION_BITS};
use hysteron_core::servo_parameters::ActuatorParameters;
use hysteron_core::signal::{MICROMETRE_FRACTION_BITS, VOLT_FRACTION_BITS};
use hysteron_sim::linear_system::ContinuousSystem;
use nalgebra::{DMatrix, DVector};

/// The magnitudes of a row of the predictor's states sum to less.
pub(super) const OF_STATE_ROW_MOST: f64 = (1u64 << (31 - STATE_ROW_FRACTION_BITS)) as f64;
/// Those of its control and of its feedforward.
pub(super) const OF_OUTPUT_ROW_MOST: f64 = (1u64 << (31 - OUTPUT_ROW_FRACTION_BITS)) as f64;

/// A number that has no integer.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantisationError {
    /// What did not fit.
    pub what: String,
    /// Its value.
    pub value: f64,
    /// The largest magnitude that fits.
    pub limit: f64,
}

impl std::fmt::Display for QuantisationError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} = {:.6e} does not fit the servo's fixed-point format (largest magnitude {:.6e})",
            self.what, self.value, self.limit
        )
    }
}

impl std::error::Error for QuantisationError {}

/// Fraction bits of a signal, for rows that mix units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Position or velocity times the period.
    Micrometre,
    /// Drive.
    Volt,
}

impl Unit {
    pub(super) fn fraction_bits(self) -> i32 {
        (match self {
            Self::Micrometre => MICROMETRE_FRACTION_BITS,
            Self::Volt => VOLT_FRACTION_BITS,
        }) as i32
    }
}

/// A number with fraction bits.
///
/// # Errors
/// If it does not fit 32 bits.
pub fn number(what: &str, value: f64, fraction_bits: i32) -> Result<i32, QuantisationError> {
    let scaled = (value * 2.0_f64.powi(fraction_bits)).round();
    if scaled.is_finite() && scaled.abs() <= f64::from(i32::MAX) {
        Ok(scaled as i32)
    } else {
        Err(QuantisationError {
            what: what.into(),
            value,
            limit: f64::from(i32::MAX) / 2.0_f64.powi(fraction_bits),
        })
    }
}

/// A row of coefficients whose inputs and output have units.
///
/// # Errors
/// If the sum of the magnitudes does not fit 31 bits: only then can no sum wrap.
pub fn row<const N: usize, const Q: u32>(
    what: &str,
    coefficients: &[f64],
    inputs: impl Fn(usize) -> Unit,
    output: Unit,
) -> Result<Row<N, Q>, QuantisationError> {
    let mut out = Row::default();
    let mut sum = 0.0;
    for (i, value) in coefficients.iter().enumerate().take(N) {
        let bits = Q as i32 + output.fraction_bits() - inputs(i).fraction_bits();
        let integer = number(&format!("{what}[{i}]"), *value, bits)?;
        out.coefficients[i] = integer;
        sum += f64::from(integer).abs();
    }
    if sum >= f64::from(i32::MAX) {
        let scale = 2.0_f64.powi(Q as i32);
        return Err(QuantisationError {
            what: format!("sum of |{what}|"),
            value: sum / scale,
            limit: f64::from(i32::MAX) / scale,
        });
    }
    Ok(out)
}

/// A row of lengths.
///
/// # Errors
/// As [`row`].
pub fn row_um<const N: usize, const Q: u32>(
    what: &str,
    coefficients: &[f64],
) -> Result<Row<N, Q>, QuantisationError> {
    row(what, coefficients, |_| Unit::Micrometre, Unit::Micrometre)
}

/// Hysteresis surfaces and drive range.
///
/// # Errors
/// If the degree exceeds the servo's or a coefficient does not fit.
pub fn hysteresis(model: &ActuatorModel) -> Result<ActuatorParameters, QuantisationError> {
    let mut surfaces = SurfaceCoefficients {
        g: [[0; SURFACE_SIZE]; SURFACE_SIZE],
        f: [0; SURFACE_SIZE],
    };
    let bits = |i: usize, j: usize| surface_fraction_bits(i, j) as i32;
    let too_high = |what: String, value: f64| QuantisationError {
        what: format!("{what} (degree too high)"),
        value,
        limit: 0.0,
    };
    for (i, row) in model.g_um.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            if i + j < SURFACE_SIZE {
                surfaces.g[i][j] = number(&format!("G[{i}][{j}]"), *value, bits(i, j))?;
            } else if value.abs() > 1e-9 {
                return Err(too_high(format!("G[{i}][{j}]"), *value));
            }
        }
    }
    for i in 0..model.r_um.len().max(model.g_um.len()) {
        let value = model.r_um.get(i).copied().unwrap_or(0.0)
            + model
                .g_um
                .get(i)
                .and_then(|r| r.first())
                .copied()
                .unwrap_or(0.0);
        if i < SURFACE_SIZE {
            surfaces.f[i] = number(&format!("F[{i}]"), value, bits(i, 0))?;
        } else if value.abs() > 1e-9 {
            return Err(too_high(format!("F[{i}]"), value));
        }
    }
    for (degree, limit) in SURFACE_LIMITS_UM.iter().enumerate() {
        let sum: f64 = model
            .g_um
            .iter()
            .enumerate()
            .flat_map(|(i, row)| row.iter().skip(degree.saturating_sub(i)))
            .map(|v| v.abs())
            .sum();
        if sum >= f64::from(*limit) {
            return Err(QuantisationError {
                what: format!("sum of |G| from degree {degree} on"),
                value: sum,
                limit: f64::from(*limit),
            });
        }
    }
    let range_v = model.drive_max_v - model.drive_min_v;
    Ok(ActuatorParameters::OneSidedHysteresis {
        surfaces,
        drive_min: number("drive_min_v", model.drive_min_v, VOLT_FRACTION_BITS as i32)?,
        drive_range: number("drive range", range_v, VOLT_FRACTION_BITS as i32)?,
        share_per_volt: (2.0_f64.powi(32) / range_v).round() as i64,
    })
}

impl ActuatorModel {
    /// The same hysteresis with surfaces of the degree and size that the servo's tick evaluates (thesis Ch.
    /// 4, Eq. 15), and the largest difference of the surfaces that this makes, um. Least squares on a grid; a
    /// model that fits the tick stays as it is. Coefficients that are large only because they cancel are kept
    /// small by a weight on them, as little as makes them fit.
    #[must_use]
    pub fn for_the_tick(&self) -> (Self, f64) {
        if hysteresis(self).is_ok() {
            return (self.clone(), 0.0);
        }
        let mut fitted = (self.clone(), f64::INFINITY);
        for weight in [0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1] {
            fitted = self.with_surfaces_of(SURFACE_SIZE - 1, weight, |_, _| 0.0, |_| 0.0);
            if hysteresis(&fitted.0).is_ok() {
                break;
            }
        }
        fitted
    }
}

/// The error for more terms than the tick has.
fn too_many(terms: usize) -> QuantisationError {
    QuantisationError {
        what: "terms of creep".into(),
        value: terms as f64,
        limit: CREEP_TERMS as f64,
    }
}

/// Inverse of creep in a loop with this period, s; terms whose share is nothing are left out.
///
/// # Errors
/// If there are more terms than the tick has, a coefficient does not fit, or the inverse would not be stable.
pub fn creep_inverse(
    terms: &[CreepTerm],
    pair: Option<&CreepPair>,
    period_s: f64,
) -> Result<CreepInverseParameters, QuantisationError> {
    let used: Vec<&CreepTerm> = terms.iter().filter(|t| t.share.abs() > 1e-9).collect();
    if used.is_empty() && pair.is_none() {
        return Ok(CreepInverseParameters::default());
    }
    if used.len() > CREEP_TERMS {
        return Err(too_many(used.len()));
    }
    let rate = |t: &CreepTerm| -(-period_s / t.time_constant_s.max(1e-6)).exp_m1();
    let (phi, gamma) = pair.map(|pair| pair_over_a_period(pair, period_s)).unzip();
    // Every state goes by `rates (x - z)` beside what the pair's own motion gives, with x = y - sum share z.
    let mut rates: Vec<f64> = used.iter().map(|t| rate(t)).collect();
    let mut shares: Vec<f64> = used.iter().map(|t| t.share).collect();
    let n = used.len();
    rates.extend(gamma.iter().flatten());
    shares.extend(pair.iter().flat_map(|p| [p.share, p.velocity_share]));
    let of_pair = |i: usize, j: usize| phi.map_or(0.0, |phi: [[f64; 2]; 2]| phi[i][j]);
    let recursion = DMatrix::from_fn(rates.len(), rates.len(), |i, j| {
        let own = if i >= n && j >= n {
            of_pair(i - n, j - n)
        } else {
            f64::from(u8::from(i == j)) * (1.0 - rates[i])
        };
        own - rates[i] * shares[j]
    });
    let radius = recursion
        .complex_eigenvalues()
        .iter()
        .map(|z| z.norm())
        .fold(0.0, f64::max);
    // Between states that stand still and states that follow any mixture may move: their shares are bounded
    // beside.
    let of_operators: f64 = if used.iter().any(|t| t.threshold_um > 0.0) {
        shares.iter().map(|s| s.abs()).sum()
    } else {
        0.0
    };
    if radius >= 1.0 || of_operators >= 1.0 {
        return Err(QuantisationError {
            what: "largest eigenvalue of the inverse of creep".into(),
            value: radius.max(of_operators),
            limit: 1.0,
        });
    }
    let mut out = CreepInverseParameters {
        terms: n as u8,
        pair: pair.is_some(),
        ..CreepInverseParameters::default()
    };
    out.shares = row_um("shares of creep", &shares[..n])?;
    for (i, term) in used.iter().enumerate() {
        out.rates[i] = number("rate of creep", rates[i], 32)?;
        out.thresholds[i] = number(
            "threshold of creep",
            term.threshold_um,
            MICROMETRE_FRACTION_BITS as i32,
        )?;
    }
    if let (Some(phi), Some(gamma)) = (phi, gamma) {
        out.pair_shares = row_um("shares of the second-order creep", &shares[n..])?;
        let change = [gamma[0], phi[0][1], gamma[1], phi[1][1] - 1.0];
        for (to, value) in out.pair_rates.iter_mut().zip(change) {
            *to = number("rate of the second-order creep", value, 32)?;
        }
    }
    out.at_rest = number(
        "1 / (1 + creep)",
        1.0 / (1.0 + creep::static_share(terms, pair)),
        28,
    )?;
    Ok(out)
}

/// Transition of displacement and velocity over the natural frequency of a pair over a period, and what a
/// unit that is applied adds.
fn pair_over_a_period(pair: &CreepPair, period_s: f64) -> ([[f64; 2]; 2], [f64; 2]) {
    let (w, xi) = (pair.natural_frequency_rad_s, pair.damping_ratio);
    let system = ContinuousSystem {
        a: DMatrix::from_row_slice(2, 2, &[0.0, w, -w, -2.0 * xi * w]),
        b: DVector::from_row_slice(&[0.0, w]),
        c: DVector::from_row_slice(&[1.0, 0.0]),
        d: 0.0,
    };
    let (phi, gamma) = system.held_matrices(period_s);
    (
        [[phi[(0, 0)], phi[(0, 1)]], [phi[(1, 0)], phi[(1, 1)]]],
        [gamma[0], gamma[1]],
    )
}

/// A linear actuator of given gain.
///
/// # Errors
/// If the gain does not fit.
pub fn linear_actuator(gain_um_v: f64) -> Result<ActuatorParameters, QuantisationError> {
    Ok(ActuatorParameters::Linear {
        volts_per_micrometre: number("1 / gain", 1.0 / gain_um_v, 20)?,
        micrometres_per_volt: number("gain", gain_um_v, 28)?,
    })
}
