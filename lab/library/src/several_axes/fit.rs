//! Least squares over all records, drives and sensors; derivatives by simulating only what a number changes.

use super::recordings::{AxesData, AxesRecord};
use super::structure::{Described, Free, Part, Scales};
use crate::dataset::Role;
use crate::identification::budget::Budget;
use crate::least_squares::{self, refined};
use crate::parallel;
use crate::statistics::rms_about_mean;
use crate::watch::Unwatched;
use hysteron_sim::several_axes::{Held, ModalStage};
use nalgebra::{DMatrix, DVector};

/// Records with their weights.
pub(super) struct Problem<'d> {
    pub(super) data: &'d AxesData,
    pub(super) scales: Scales,
    /// How long its fits may go on.
    budget: Budget<'d>,
    /// For each record and sensor: one over its noise, or over its RMS where a record does not show the
    /// noise.
    weights: Vec<Vec<f64>>,
    /// Whether all records show their noise.
    pub(super) noise_known: bool,
}

/// Least noise by which a sensor is weighted, of its RMS: below it the arithmetic of the simulation is seen.
const NOISE_LEAST: f64 = 1e-6;

/// Share of a reading that a model with few numbers leaves beside the noise: what one linear response leaves of
/// one level of the fine steering mirror (`benchmarks/public/mirror_limits.py`).
const MODEL_ERROR: f64 = 0.05;

/// Every signal of a simulation, by record.
#[derive(Clone)]
pub(super) struct Signals {
    drives: Vec<Vec<Vec<Held>>>,
    modes: Vec<Vec<Vec<f64>>>,
    readings: Vec<Vec<Vec<f64>>>,
}

/// Residual and derivatives on the records of one role.
pub(super) struct Rows {
    pub(super) residual: DVector<f64>,
    pub(super) columns: DMatrix<f64>,
}

fn slices<T>(signals: &[Vec<T>]) -> Vec<&[T]> {
    signals.iter().map(Vec::as_slice).collect()
}

impl<'d> Problem<'d> {
    /// Records that are explained down to their noise.
    pub(super) fn new(data: &'d AxesData) -> Self {
        let scales = Scales::from_data(data);
        let noise_known = data.records.iter().all(|record| record.noise.is_some());
        let weight = |record: &AxesRecord, i: usize| match (&record.noise, noise_known) {
            (Some(noise), true) => 1.0 / noise[i].max(NOISE_LEAST * scales.reading_rms[i]),
            _ => 1.0 / scales.reading_rms[i],
        };
        Self::weighted(data, weight)
    }

    /// Records of which a model explains the same share at every level, if their noise is below it.
    pub(super) fn with_model_error(data: &'d AxesData) -> Self {
        let weight = |record: &AxesRecord, i: usize| {
            let rms = rms_about_mean(&record.readings[i][record.counted_from..record.counted_to]);
            let noise = record.noise.as_ref().map_or(0.0, |noise| noise[i]);
            1.0 / (MODEL_ERROR * rms).hypot(noise).max(f64::MIN_POSITIVE)
        };
        Self::weighted(data, weight)
    }

    fn weighted(data: &'d AxesData, weight: impl Fn(&AxesRecord, usize) -> f64) -> Self {
        let of_record = |record| (0..data.sensors.len()).map(|i| weight(record, i)).collect();
        Self {
            data,
            weights: data.records.iter().map(of_record).collect(),
            noise_known: data.records.iter().all(|record| record.noise.is_some()),
            scales: Scales::from_data(data),
            budget: Budget::of_time(&Unwatched),
        }
    }

    /// Fits within a budget.
    pub(super) fn within(self, budget: Budget<'d>) -> Self {
        Self { budget, ..self }
    }

    pub(super) fn simulate(&self, stage: &ModalStage) -> Signals {
        let of_record = |record: &AxesRecord| {
            let dt_s = record.dt_s();
            let drives: Vec<Vec<Held>> = record
                .drives
                .iter()
                .enumerate()
                .map(|(j, u)| stage.drive_signal(j, u, dt_s, record.periodic))
                .collect();
            let modes = stage.all_mode_signals(&slices(&drives), dt_s);
            let readings = (0..stage.sensors.len())
                .map(|i| stage.reading(i, &slices(&modes), &slices(&drives), dt_s))
                .collect();
            (drives, modes, readings)
        };
        let mut out = Signals {
            drives: Vec::new(),
            modes: Vec::new(),
            readings: Vec::new(),
        };
        for (drives, modes, readings) in parallel::map(&self.data.records, of_record) {
            out.drives.push(drives);
            out.modes.push(modes);
            out.readings.push(readings);
        }
        out
    }

    /// The readings of a record after one part of the stage has changed; none where a sensor does not notice.
    fn changed(
        &self,
        stage: &ModalStage,
        part: Part,
        base: &Signals,
        record: usize,
    ) -> Vec<Option<Vec<f64>>> {
        let recorded = &self.data.records[record];
        let dt_s = recorded.dt_s();
        let (mut drives, mut modes) = (slices(&base.drives[record]), slices(&base.modes[record]));
        let new_drive = match part {
            Part::Drive(j) => stage.drive_signal(j, &recorded.drives[j], dt_s, recorded.periodic),
            _ => Vec::new(),
        };
        let coupled = stage.is_coupled();
        let touches = |r: usize| match part {
            Part::Sensor(_) => false,
            Part::Actuators => true,
            _ if coupled => true,
            Part::Drive(j) => stage.modes[r].of_drives[j] != 0.0,
            Part::Mode(changed) => changed == r,
        };
        if let Part::Drive(j) = part {
            drives[j] = &new_drive;
        }
        let new_modes = if matches!(part, Part::Sensor(_)) {
            vec![None; modes.len()]
        } else {
            stage.mode_signals(touches, &drives, dt_s)
        };
        for (mode, new) in modes.iter_mut().zip(&new_modes) {
            *mode = new.as_deref().unwrap_or(mode);
        }
        let notices = |i: usize| match part {
            Part::Sensor(changed) => changed == i,
            Part::Drive(j) if stage.feedthrough[i][j] != 0.0 => true,
            _ => (0..modes.len()).any(|r| touches(r) && stage.modes[r].of_sensors[i] != 0.0),
        };
        (0..stage.sensors.len())
            .map(|i| notices(i).then(|| stage.reading(i, &modes, &drives, dt_s)))
            .collect()
    }

    /// Rows of a role: record by record, in each sensor by sensor, weighted, each about its mean. A
    /// constant of each sensor in each record is thereby estimated with everything else.
    fn rows(&self, role: Role, value: impl Fn(usize, usize, usize) -> f64) -> Vec<f64> {
        let mut out = Vec::new();
        for (n, record) in self.data.of_role(role) {
            for i in 0..record.readings.len() {
                let from = out.len();
                out.extend(
                    (record.counted_from..record.counted_to)
                        .map(|k| self.weights[n][i] * value(n, i, k)),
                );
                let mean = out[from..].iter().sum::<f64>() / (out.len() - from) as f64;
                out[from..].iter_mut().for_each(|x| *x -= mean);
            }
        }
        out
    }

    pub(super) fn residual(&self, signals: &Signals, role: Role) -> DVector<f64> {
        DVector::from_vec(self.rows(role, |n, i, k| {
            self.data.records[n].readings[i][k] - signals.readings[n][i][k]
        }))
    }

    /// What the simulation changes by, for each number and its unit.
    fn column(
        &self,
        model: &Described,
        signals: &Signals,
        free: Free,
        roles: &[Role],
    ) -> Vec<Vec<f64>> {
        let step = self.scales.step(free);
        let mut moved = model.stage.clone();
        free.set(&mut moved, free.get(&model.stage) + step);
        let wanted = |n: usize| roles.contains(&self.data.records[n].role);
        let changed: Vec<Vec<Option<Vec<f64>>>> = (0..self.data.records.len())
            .map(|n| {
                if wanted(n) {
                    self.changed(&moved, free.part(), signals, n)
                } else {
                    Vec::new()
                }
            })
            .collect();
        let per_unit = 1.0 / step;
        let of = |n: usize, i: usize, k: usize| match &changed[n][i] {
            Some(reading) => (reading[k] - signals.readings[n][i][k]) * per_unit,
            None => 0.0,
        };
        roles.iter().map(|role| self.rows(*role, of)).collect()
    }

    /// Derivatives of the readings by some numbers, on the records of each role.
    pub(super) fn columns(
        &self,
        model: &Described,
        signals: &Signals,
        free: &[Free],
        roles: &[Role],
    ) -> Vec<DMatrix<f64>> {
        let by_number = parallel::map(free, |free| self.column(model, signals, *free, roles));
        let of_role = |role: usize| {
            let of_record = |record: &AxesRecord| {
                (record.counted_to - record.counted_from) * record.readings.len()
            };
            let rows = self
                .data
                .of_role(roles[role])
                .map(|(_, record)| of_record(record))
                .sum();
            DMatrix::from_iterator(
                rows,
                free.len(),
                by_number
                    .iter()
                    .flat_map(|columns| columns[role].iter().copied()),
            )
        };
        (0..roles.len()).map(of_role).collect()
    }

    /// Derivatives by the numbers of an effect that does nothing yet, beside the signals without it.
    pub(super) fn columns_beside(
        &self,
        with: &Described,
        without: &Signals,
        free: &[Free],
        roles: &[Role],
    ) -> Vec<DMatrix<f64>> {
        let new_modes = without.modes[0].len()..with.stage.modes.len();
        if new_modes.is_empty() {
            return self.columns(with, without, free, roles);
        }
        let mut signals = without.clone();
        for (n, record) in self.data.records.iter().enumerate() {
            let drives = slices(&signals.drives[n]);
            let is_new = |r: usize| new_modes.contains(&r);
            let moved = with.stage.mode_signals(is_new, &drives, record.dt_s());
            signals.modes[n].extend(moved.into_iter().skip(new_modes.start).flatten());
        }
        self.columns(with, &signals, free, roles)
    }

    /// The greatest extension of an actuator, from where it rests in each record.
    pub(super) fn extension_reach(
        &self,
        stage: &ModalStage,
        signals: &Signals,
        drive: usize,
    ) -> f64 {
        let shares: Vec<f64> = stage
            .modes
            .iter()
            .map(|mode| mode.compliance * mode.of_drives[drive])
            .collect();
        let reach = |modes: &Vec<Vec<f64>>| {
            let extension = |k: usize| -> f64 {
                shares
                    .iter()
                    .zip(modes)
                    .map(|(share, q)| share * q[k])
                    .sum()
            };
            let samples = modes.first().map_or(0, Vec::len);
            (0..samples).fold(0.0_f64, |m, k| m.max((extension(k) - extension(0)).abs()))
        };
        signals.modes.iter().map(reach).fold(0.0, f64::max)
    }

    /// What a drive gives in a record, where it counts.
    pub(super) fn counted_drive(&self, signals: &Signals, record: usize, drive: usize) -> Vec<f64> {
        let recorded = &self.data.records[record];
        signals.drives[record][drive][recorded.counted_from..recorded.counted_to]
            .iter()
            .map(|held| held.late)
            .collect()
    }

    /// The weight of a sensor in a record.
    pub(super) fn weight(&self, record: usize, sensor: usize) -> f64 {
        self.weights[record][sensor]
    }

    pub(super) fn linearised(&self, model: &Described, roles: &[Role]) -> Vec<Rows> {
        let signals = self.simulate(&model.stage);
        let columns = self.columns(model, &signals, &model.free(), roles);
        roles
            .iter()
            .zip(columns)
            .map(|(role, columns)| Rows {
                residual: self.residual(&signals, *role),
                columns,
            })
            .collect()
    }

    /// Mean square of the weighted residual.
    pub(super) fn cost(&self, stage: &ModalStage, role: Role) -> f64 {
        let residual = self.residual(&self.simulate(stage), role);
        residual.norm_squared() / residual.len().max(1) as f64
    }

    /// Mean squares of the weighted residual on stretches of the records that judge.
    pub(super) fn judged(&self, stage: &ModalStage) -> Vec<f64> {
        let residual = self.residual(&self.simulate(stage), Role::Validate);
        let mut out = Vec::new();
        let mut at = 0;
        for (_, record) in self.data.of_role(Role::Validate) {
            let (samples, sensors) = (
                record.counted_to - record.counted_from,
                record.readings.len(),
            );
            for stretch in 0..STRETCHES {
                let (from, to) = (
                    stretch * samples / STRETCHES,
                    (stretch + 1) * samples / STRETCHES,
                );
                let squares: f64 = (0..sensors)
                    .map(|i| {
                        residual
                            .rows(at + i * samples + from, to - from)
                            .norm_squared()
                    })
                    .sum();
                out.push(squares / ((to - from) * sensors) as f64);
            }
            at += samples * sensors;
        }
        out
    }

    /// RMS error of every sensor on the records of a role, in its unit.
    pub(super) fn errors(&self, stage: &ModalStage, role: Role) -> Vec<f64> {
        let signals = self.simulate(stage);
        let sensors = stage.sensors.len();
        let (mut squares, mut counts) = (vec![0.0; sensors], vec![0_usize; sensors]);
        let rows = self.rows(role, |n, i, k| {
            (self.data.records[n].readings[i][k] - signals.readings[n][i][k]) / self.weights[n][i]
        });
        let mut at = 0;
        for (_, record) in self.data.of_role(role) {
            let samples = record.counted_to - record.counted_from;
            for i in 0..sensors {
                squares[i] += rows[at..at + samples].iter().map(|e| e * e).sum::<f64>();
                counts[i] += samples;
                at += samples;
            }
        }
        squares
            .iter()
            .zip(counts)
            .map(|(squares, count)| (squares / count.max(1) as f64).sqrt())
            .collect()
    }

    /// The readings of a record as a stage gives them.
    pub(super) fn modelled(&self, stage: &ModalStage, record: usize) -> Vec<Vec<f64>> {
        let recorded = &self.data.records[record];
        stage.simulate(&recorded.drives, recorded.dt_s(), recorded.periodic)
    }

    /// Refines all numbers of a model on the records that are fitted, until a step lowers the cost by a
    /// smaller share than `fall_enough`, or the time of the stage is over.
    pub(super) fn fit(&self, model: &Described, steps_max: usize, fall_enough: f64) -> Described {
        if model.free().is_empty() {
            return model.clone();
        }
        refined(self, model, steps_max, fall_enough)
    }
}

impl least_squares::Problem for Problem<'_> {
    type Model = Described;

    fn goes_on(&self) -> bool {
        !self.budget.time_is_over() && !self.budget.is_stopped()
    }

    fn cost(&self, model: &Described) -> f64 {
        Self::cost(self, &model.stage, Role::Identify)
    }

    fn linearised(&self, model: &Described) -> (DMatrix<f64>, DVector<f64>) {
        let rows = Self::linearised(self, model, &[Role::Identify]).remove(0);
        (rows.columns, rows.residual)
    }

    fn moved(&self, model: &Described, step: &DVector<f64>) -> Described {
        let mut moved = model.clone();
        for (free, by) in model.free().iter().zip(step.iter()) {
            free.set(&mut moved.stage, free.get(&model.stage) + by);
        }
        moved
    }
}

/// Stretches of a record that judges, over which differences between two models scatter.
pub(super) const STRETCHES: usize = 16;

/// Of what judges, over all stretches.
pub(super) fn rms(judged: &[f64]) -> f64 {
    (judged.iter().sum::<f64>() / judged.len().max(1) as f64).sqrt()
}
