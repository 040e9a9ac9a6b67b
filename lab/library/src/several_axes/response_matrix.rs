//! The response of every sensor to every drive, measured and modelled, by the same estimate.

use super::fit::Problem;
use super::recordings::AxesData;
use super::structure::Described;
use crate::dataset::Role;
use crate::spectrum;
use crate::statistics::mean;
use nalgebra::{Complex, DMatrix};
use realfft::RealFftPlanner;

/// Magnitudes of responses.
#[derive(Clone, Debug, Default)]
pub struct ResponseMatrix {
    /// Frequencies, Hz.
    pub frequency_hz: Vec<f64>,
    /// For each sensor and drive, the measured magnitudes.
    pub measured: Vec<Vec<Vec<f64>>>,
    /// For each sensor and drive, the modelled magnitudes.
    pub modelled: Vec<Vec<Vec<f64>>>,
}

/// Stretches of a record without a period for each drive, over which the estimate is averaged.
const STRETCHES_OF_A_DRIVE: usize = 4;
/// Lines on which a drive has less than such a share of its largest amplitude are not excited.
const EXCITED: f64 = 0.02;

type Spectra = Vec<Vec<Complex<f64>>>;

/// The responses of a data set and of a model of it.
#[must_use]
pub fn response_matrix(data: &AxesData, model: &Described) -> ResponseMatrix {
    let (drives, sensors) = (data.drives.len(), data.sensors.len());
    let lines = estimated_responses(data, model, &[Role::Identify, Role::Validate]);
    let magnitudes = |of: &dyn Fn(&LineResponse) -> &DMatrix<Complex<f64>>| -> Vec<Vec<Vec<f64>>> {
        let at = |i: usize, j: usize| lines.iter().map(|l| of(l)[(i, j)].norm()).collect();
        (0..sensors)
            .map(|i| (0..drives).map(|j| at(i, j)).collect())
            .collect()
    };
    ResponseMatrix {
        frequency_hz: lines.iter().map(|line| line.frequency_hz).collect(),
        measured: magnitudes(&|line| &line.measured),
        modelled: magnitudes(&|line| &line.modelled),
    }
}

/// Responses of all sensors to all drives at a frequency.
pub(super) struct LineResponse {
    pub(super) frequency_hz: f64,
    pub(super) measured: DMatrix<Complex<f64>>,
    modelled: DMatrix<Complex<f64>>,
}

/// Estimates from the records of some roles, at the frequencies that the drives excite.
pub(super) fn estimated_responses(
    data: &AxesData,
    model: &Described,
    roles: &[Role],
) -> Vec<LineResponse> {
    let problem = Problem::new(data);
    let (drives, sensors) = (data.drives.len(), data.sensors.len());
    let mut planner = RealFftPlanner::new();
    let rate_hz = data.records[0].sample_rate_hz;
    let records = || {
        let all = data.records.iter().enumerate();
        all.filter(|(_, record)| roles.contains(&record.role))
    };
    // Experiments of one length: periods, or stretches of the records.
    let mut length = records()
        .map(|(_, r)| r.counted_to - r.counted_from)
        .min()
        .unwrap_or(0);
    if records().any(|(_, record)| !record.periodic) {
        length = (length * records().count() / (STRETCHES_OF_A_DRIVE * drives))
            .max(SHORTEST)
            .min(length);
    }
    let mut experiments: Vec<(Spectra, Spectra, Spectra)> = Vec::new();
    for (n, record) in records() {
        let modelled = problem.modelled(&model.stage, n);
        let mut from = record.counted_from;
        while from + length <= record.counted_to {
            let mut lines = |signals: &[Vec<f64>]| -> Spectra {
                signals
                    .iter()
                    .map(|signal| {
                        windowed(&signal[from..from + length], record.periodic, &mut planner)
                    })
                    .collect()
            };
            experiments.push((
                lines(&record.drives),
                lines(&record.readings),
                lines(&modelled),
            ));
            from += length;
        }
    }
    let mut out = Vec::new();
    if experiments.is_empty() {
        return out;
    }
    // With fewer experiments than drives neighbouring lines share a response.
    let shared = drives.div_ceil(experiments.len());
    let largest = experiments
        .iter()
        .flat_map(|e| e.0.iter().flatten())
        .fold(0.0_f64, |m, c| m.max(c.norm()));
    let mut line = 1;
    while line + shared <= length / 2 {
        let group = line..line + shared;
        line += shared;
        let rows: Vec<(usize, usize)> = (0..experiments.len())
            .flat_map(|e| group.clone().map(move |l| (e, l)))
            .collect();
        let u = DMatrix::from_fn(drives, rows.len(), |j, r| {
            experiments[rows[r].0].0[j][rows[r].1]
        });
        if u.iter().fold(0.0_f64, |m, c| m.max(c.norm())) < EXCITED * largest {
            continue;
        }
        let Some(inverse) = (&u * u.adjoint()).try_inverse() else {
            continue;
        };
        let response = |of: &dyn Fn(usize, usize, usize) -> Complex<f64>| {
            let y = DMatrix::from_fn(sensors, rows.len(), |i, r| of(rows[r].0, i, rows[r].1));
            y * u.adjoint() * &inverse
        };
        out.push(LineResponse {
            frequency_hz: (group.start as f64 + 0.5 * (shared - 1) as f64) * rate_hz
                / length as f64,
            measured: response(&|e, i, l| experiments[e].1[i][l]),
            modelled: response(&|e, i, l| experiments[e].2[i][l]),
        });
    }
    out
}

/// Shortest stretch that is transformed.
const SHORTEST: usize = 64;

fn windowed(
    signal: &[f64],
    periodic: bool,
    planner: &mut RealFftPlanner<f64>,
) -> Vec<Complex<f64>> {
    let mean = mean(signal);
    let window = |k: usize| {
        if periodic {
            1.0
        } else {
            0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / signal.len() as f64).cos()
        }
    };
    spectrum::lines(
        signal
            .iter()
            .enumerate()
            .map(|(k, x)| (x - mean) * window(k))
            .collect(),
        planner,
    )
}
