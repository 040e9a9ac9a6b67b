//! A linear model to start from, in which every drive and sensor takes part in every mode.
//!
//! Poles come from the measured responses by subspaces in the frequency domain (T. McKelvey, H. Akcay and
//! L. Ljung, IEEE Transactions on Automatic Control 41(7), 960-979, 1996): the responses, shifted by powers
//! of `z` and freed of what the drives span, span the observability matrix. Residues follow by linear least
//! squares, of rank one by their largest singular value. Fitting the records themselves refines all of it.

use super::recordings::AxesData;
use super::response_matrix::{LineResponse, estimated_responses};
use super::structure::{AxisEffect, Described};
use crate::dataset::Role;
use crate::error::{Error, Result};
use hysteron_sim::several_axes::StageMode;
use nalgebra::{Complex, DMatrix};
use std::f64::consts::{PI, TAU};

/// Shifts of the responses, by the order of the model: so many that each mode turns several times.
const SHIFTS_BY_MODE: usize = 4;
/// Ridge of what the drives span, of its trace: frequencies that they do not excite.
const RIDGE: f64 = 1e-10;
/// Poles with more damping belong to the delay, not to a mode.
const DAMPING_MAX: f64 = 0.2;
/// Highest frequency of a mode, of the sampling rate.
const HIGHEST: f64 = 0.48;
/// Modes above the highest frequency act together as one there, of the sampling rate.
const BEYOND: f64 = 0.53;
const BEYOND_DAMPING: f64 = 0.02;
/// Least compliance of a mode to start from, of the first one's.
const COMPLIANCE_LEAST: f64 = 0.05;
/// Delays that are tried, in sampling periods: up to the one by which a logger's rows are apart.
const DELAYS: usize = 21;
const DELAY_STEP: f64 = 0.05;

/// A linear model with up to so many modes, from the records that are fitted.
///
/// # Errors
/// Responses in which no mode is found.
pub fn modal_start(data: &AxesData, modes: usize) -> Result<Described> {
    let empty = Described::empty(data);
    let lines = estimated_responses(data, &empty, &[Role::Identify]);
    let dt_s = data.records[0].dt_s();
    let found = poles(&lines, modes, dt_s)
        .filter(|poles| !poles.is_empty())
        .ok_or_else(|| {
            Error::new(
                &data.name,
                "no mode is seen in the responses of its records",
            )
        })?;
    let mut shapes = found;
    shapes.push([BEYOND / dt_s, BEYOND_DAMPING]);
    let tried = (0..DELAYS).filter_map(|n| {
        let delay_s = DELAY_STEP * n as f64 * dt_s;
        let (residues, left) = residues(&lines, &shapes, delay_s, dt_s)?;
        Some((delay_s, residues, left))
    });
    let (delay_s, residues, _) = tried
        .min_by(|a, b| a.2.total_cmp(&b.2))
        .ok_or_else(|| Error::new(&data.name, "its responses do not fix the modes"))?;
    let mut model = empty;
    for (r, [hz, damping]) in shapes.iter().enumerate() {
        let residue = residues[r].zip_map(&residues[shapes.len() + r], Complex::new);
        add_mode(&mut model, *hz, *damping, &residue);
    }
    let at_once = &residues[2 * shapes.len()];
    for drive in 0..data.drives.len() {
        model.stage.drives[drive].delay_s = delay_s;
        model.effects.push(AxisEffect::Delay { drive });
        for sensor in 0..data.sensors.len() {
            model.stage.feedthrough[sensor][drive] = at_once[(sensor, drive)];
            model
                .effects
                .push(AxisEffect::Feedthrough { drive, sensor });
        }
    }
    let slow = |sensor| AxisEffect::SensorBandwidth { sensor };
    model.effects.extend((0..data.sensors.len()).map(slow));
    set_compliances(&mut model, &lines);
    Ok(model)
}

/// How far each mode extends the actuators, by reciprocity: the combination of the sensors for each actuator
/// that makes the responses of all extensions to all drives symmetric.
fn set_compliances(model: &mut Described, lines: &[LineResponse]) {
    let (sensors, drives) = (model.stage.sensors.len(), model.stage.drives.len());
    let mut gram = DMatrix::<f64>::zeros(sensors * drives, sensors * drives);
    for line in lines {
        let weight = 1.0 / line.measured.norm();
        for (a, b) in (0..drives).flat_map(|b| (0..b).map(move |a| (a, b))) {
            let mut row = vec![Complex::new(0.0, 0.0); sensors * drives];
            for sensor in 0..sensors {
                row[a * sensors + sensor] += line.measured[(sensor, b)] * weight;
                row[b * sensors + sensor] -= line.measured[(sensor, a)] * weight;
            }
            gram += DMatrix::from_fn(row.len(), row.len(), |i, k| (row[i] * row[k].conj()).re);
        }
    }
    let eigen = gram.symmetric_eigen();
    let combination = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let compliance = |mode: &StageMode| -> f64 {
        let extension = |drive: usize| -> f64 {
            (0..sensors)
                .map(|i| combination[drive * sensors + i] * mode.of_sensors[i])
                .sum()
        };
        let along: f64 = (0..drives).map(|j| mode.of_drives[j] * extension(j)).sum();
        along
            / mode
                .of_drives
                .iter()
                .map(|share| share * share)
                .sum::<f64>()
    };
    let all: Vec<f64> = model.stage.modes.iter().map(compliance).collect();
    // The first mode gives the extensions their unit; a mode that reciprocity does not see has a small one.
    for (mode, of_mode) in model.stage.modes.iter_mut().zip(&all) {
        mode.compliance = (of_mode / all[0]).max(COMPLIANCE_LEAST);
    }
}

/// Frequencies in Hz and damping ratios of the modes.
fn poles(lines: &[LineResponse], modes: usize, dt_s: f64) -> Option<Vec<[f64; 2]>> {
    let (sensors, drives) = lines.first()?.measured.shape();
    let (order, shifts) = (2 * modes, SHIFTS_BY_MODE * modes);
    // Products of what is shifted by `a` and `b` depend on `a - b` only.
    let mut of_drives = vec![0.0; shifts];
    let mut across = vec![DMatrix::<f64>::zeros(sensors, drives); 2 * shifts];
    let mut of_sensors = vec![DMatrix::<f64>::zeros(sensors, sensors); 2 * shifts];
    for line in lines {
        let square = &line.measured * line.measured.adjoint();
        for by in 0..2 * shifts {
            let turn = TAU * line.frequency_hz * dt_s * (by as f64 - shifts as f64);
            let z = Complex::from_polar(1.0, turn);
            across[by] += line.measured.map(|g| (g * z).re);
            of_sensors[by] += square.map(|g| (g * z).re);
            if by >= shifts {
                of_drives[by - shifts] += z.re;
            }
        }
    }
    let apart = |a: usize, b: usize| shifts + a - b;
    let spans = |a: usize, b: usize| {
        let ridge = if a == b {
            RIDGE * of_drives[0] * shifts as f64
        } else {
            0.0
        };
        of_drives[a.abs_diff(b)] + ridge
    };
    let inverse = DMatrix::from_fn(shifts, shifts, spans)
        .cholesky()?
        .inverse();
    // Each drive apart: what the drives span has no products between them.
    let mut freed = DMatrix::from_fn(shifts * sensors, shifts * sensors, |r, c| {
        of_sensors[apart(r / sensors, c / sensors)][(r % sensors, c % sensors)]
    });
    for drive in 0..drives {
        let shifted = DMatrix::from_fn(shifts * sensors, shifts, |r, b| {
            across[apart(r / sensors, b)][(r % sensors, drive)]
        });
        freed -= &shifted * &inverse * shifted.transpose();
    }
    let eigen = freed.symmetric_eigen();
    let mut by_size: Vec<usize> = (0..shifts * sensors).collect();
    by_size.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let observed = DMatrix::from_fn(shifts * sensors, order, |r, k| {
        eigen.eigenvectors[(r, by_size[k])]
    });
    let (now, next) = (
        observed.rows(0, (shifts - 1) * sensors),
        observed.rows(sensors, (shifts - 1) * sensors),
    );
    let transition = (now.transpose() * now)
        .cholesky()?
        .solve(&(now.transpose() * next));
    let mut out: Vec<[f64; 2]> = transition
        .complex_eigenvalues()
        .iter()
        .map(|z| z.ln() / dt_s)
        .filter(|pole| pole.im > 0.0)
        .map(|pole| [pole.norm() / TAU, -pole.re / pole.norm()])
        .filter(|[hz, damping]| *hz < HIGHEST / dt_s && *damping > 0.0 && *damping < DAMPING_MAX)
        .collect();
    out.sort_by(|a, b| a[0].total_cmp(&b[0]));
    Some(out)
}

/// Residues of modes with known poles, then those of the rates of the drives, then what acts at once; and the
/// squares that they leave.
fn residues(
    lines: &[LineResponse],
    shapes: &[[f64; 2]],
    delay_s: f64,
    dt_s: f64,
) -> Option<(Vec<DMatrix<f64>>, f64)> {
    let (sensors, drives) = lines.first()?.measured.shape();
    let count = 2 * shapes.len() + 1;
    let basis = |line: &LineResponse| -> Vec<Complex<f64>> {
        let turn = TAU * line.frequency_hz;
        let half = PI * line.frequency_hz * dt_s;
        let held = Complex::from_polar(half.sin() / half, -half - turn * delay_s);
        let mode = |[hz, damping]: &[f64; 2]| {
            let ratio = line.frequency_hz / hz;
            held / Complex::new(1.0 - ratio * ratio, 2.0 * damping * ratio)
        };
        let at_once = Complex::from_polar(1.0, -turn * dt_s);
        let rate = |shape: &[f64; 2]| mode(shape) * Complex::new(0.0, line.frequency_hz / shape[0]);
        let of_modes = shapes.iter().map(mode).chain(shapes.iter().map(rate));
        of_modes.chain([at_once]).collect()
    };
    let mut gram = DMatrix::<f64>::zeros(count, count);
    let mut against = DMatrix::<f64>::zeros(count, sensors * drives);
    let mut squares = 0.0;
    for line in lines {
        let basis = basis(line);
        for (a, of_a) in basis.iter().enumerate() {
            for (b, of_b) in basis.iter().enumerate() {
                gram[(a, b)] += (of_a.conj() * of_b).re;
            }
            for (c, g) in line.measured.iter().enumerate() {
                against[(a, c)] += (of_a.conj() * g).re;
            }
        }
        squares += line.measured.iter().map(|g| g.norm_sqr()).sum::<f64>();
    }
    let solved = gram.cholesky()?.solve(&against);
    let left = squares - solved.component_mul(&against).sum();
    let residue = |r: usize| DMatrix::from_iterator(sensors, drives, solved.row(r).iter().copied());
    Some(((0..count).map(residue).collect(), left))
}

/// Adds a mode in which every drive and sensor takes part, by the part of its residue that has rank one.
fn add_mode(model: &mut Described, hz: f64, damping: f64, residue: &DMatrix<Complex<f64>>) {
    let svd = residue.clone().svd(true, true);
    let (Some(u), Some(v)) = (&svd.u, &svd.v_t) else {
        return;
    };
    let largest = svd.singular_values.imax();
    // The phase that the sensors have in common goes to the drives.
    let squares: Complex<f64> = u.column(largest).iter().map(|share| share * share).sum();
    let turned = Complex::from_polar(1.0, -0.5 * squares.arg());
    let of_sensors: Vec<f64> = u.column(largest).iter().map(|x| (x * turned).re).collect();
    let of_drives: Vec<Complex<f64>> = v.row(largest).iter().map(|x| x / turned).collect();
    let place = |shares: &[f64]| {
        let largest = |a: &usize, b: &usize| shares[*a].abs().total_cmp(&shares[*b].abs());
        (0..shares.len()).max_by(largest).unwrap_or(0)
    };
    let real: Vec<f64> = of_drives.iter().map(|share| share.re).collect();
    let (drive, sensor) = (place(&real), place(&of_sensors));
    let scale = real[drive];
    let mode = model.stage.modes.len();
    model.stage.modes.push(StageMode {
        of_drives: real.iter().map(|share| share / scale).collect(),
        of_rates: of_drives.iter().map(|share| share.im / scale).collect(),
        of_sensors: of_sensors
            .iter()
            .map(|share| share * scale * svd.singular_values[largest])
            .collect(),
        ..StageMode::linear(hz, damping, of_drives.len(), of_sensors.len())
    });
    model.effects.push(AxisEffect::ComplexMode { mode });
    model.effects.push(AxisEffect::Vibration {
        mode,
        drive,
        sensor,
    });
    let others = (0..of_drives.len()).filter(|other| *other != drive);
    model
        .effects
        .extend(others.map(|drive| AxisEffect::DriveCoupling { drive, mode }));
    let others = (0..of_sensors.len()).filter(|other| *other != sensor);
    model
        .effects
        .extend(others.map(|sensor| AxisEffect::SensorCoupling { mode, sensor }));
}
