//! One mode and the sensor that reads it, as one linear system: exact over an interval however long it is.

use super::arrival::{Arrival, Over};
use crate::block::Linear;
use crate::linear_system::ContinuousSystem;
use crate::physics::*;
use nalgebra::{DMatrix, DVector};

/// How a mode of unit static gain goes over an interval at whose end its input has come to a value: exact
/// however long the interval is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Propagator {
    phi: [f64; 4],
    gamma: [f64; 2],
    angle_rad: f64,
    sensor: Option<SensorPropagator>,
    start: ByStart,
}

/// Of an input that comes to its value inside an interval: what the one before it, with which the interval
/// starts, adds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ByStart {
    gamma: [f64; 2],
    sensor_gamma: f64,
}

/// A sensor that follows the displacement of a mode as a first-order lag: the third state of one linear
/// system.
#[derive(Clone, Copy, Debug)]
struct SensorPropagator {
    phi: [f64; 3],
    gamma: f64,
}

/// How a mode moves inside an interval, beside [`Propagator`], which says where it ends.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Within {
    /// Of the mean displacement: by the displacement, the velocity and the held input.
    mean: [f64; 3],
    /// What an input that rises straight from minus one to one adds at the end to displacement, velocity and
    /// what a sensor with a lag reads.
    rising: [f64; 3],
}

impl Within {
    /// Displacement in the mean of an interval with the input held.
    #[inline]
    pub(super) fn mean_displacement(&self, from: Motion, input: f64) -> f64 {
        self.mean[0] * from.displacement + self.mean[1] * from.velocity + self.mean[2] * input
    }

    /// [`Self::mean_displacement`] as [`crate::law`] writes.
    pub(super) fn mean_in_lines(&self, input: &str) -> String {
        let [place, speed, held] = self.mean;
        format!("{place:e} * place + {speed:e} * speed + {held:e} * ({input})")
    }

    /// [`Self::risen`] as [`crate::law`] writes, of what begins with `next_`.
    pub(super) fn risen_in_lines(&self, by: &str, lags: bool) -> String {
        let [place, speed, reading] = self.rising;
        let reading = if lags {
            format!("next_reading = next_reading + {reading:e} * {by}\n")
        } else {
            "next_reading = next_place\n".to_owned()
        };
        format!(
            "next_place = next_place + {place:e} * {by}\nnext_speed = next_speed + {speed:e} * {by}\n{reading}"
        )
    }

    /// The end of the interval where the input rose by so much on either side of its mean.
    #[inline]
    pub(super) fn risen<const LAGS: bool>(&self, end: Motion, by: f64) -> Motion {
        let displacement = end.displacement + self.rising[0] * by;
        let reading = if LAGS {
            end.reading + self.rising[2] * by
        } else {
            displacement
        };
        Motion {
            displacement,
            velocity: end.velocity + self.rising[1] * by,
            reading,
            before: end.before,
        }
    }
}

/// Where a mode is.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    /// Displacement, um.
    pub(super) displacement: f64,
    /// Velocity over the natural frequency, um, so that both are of one size.
    velocity: f64,
    /// What the sensor reads, um: the displacement where none lags behind it.
    pub(super) reading: f64,
    /// The last input, um.
    before: f64,
}

impl Motion {
    /// At rest under a constant input.
    pub(super) fn settled(input: f64) -> Self {
        Self {
            displacement: input,
            velocity: 0.0,
            reading: input,
            before: input,
        }
    }

    /// This motion behind another input.
    #[inline]
    pub(super) fn with_input_before(self, before: f64) -> Self {
        Self { before, ..self }
    }
}

/// A filter of second order in the sensor's electronics behind what [`Propagator`] reads: the last two states
/// of one linear system.
#[derive(Clone, Copy, Debug)]
struct FilterPropagator {
    /// By displacement, velocity, the lagging reading, the filter's own reading and its rate over the
    /// filter's natural frequency; then by the input with which the interval starts and the one to which it
    /// comes.
    rows: [[f64; 7]; 2],
}

impl FilterPropagator {
    /// Where the filter is at the end of an interval that began with this motion.
    #[inline]
    fn after(&self, from: Motion, [reading, rate]: [f64; 2], input: f64) -> [f64; 2] {
        let Motion {
            displacement,
            velocity,
            reading: unfiltered,
            before,
        } = from;
        let states = [
            displacement,
            velocity,
            unfiltered,
            reading,
            rate,
            before,
            input,
        ];
        self.rows
            .map(|row| row.iter().zip(states).map(|(c, x)| c * x).sum())
    }
}

/// One mode of unit static gain, exact for an input that is held over an interval.
#[derive(Clone, Copy, Debug, Default)]
pub struct VibrationMode {
    propagator: Propagator,
    motion: Motion,
    /// The filter that reads it, with its reading and rate.
    filter: Option<(FilterPropagator, [f64; 2])>,
}

/// What makes a mode, whatever the interval that it is stepped over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ModeLaw {
    pub(super) natural_frequency_rad_s: f64,
    pub(super) damping_ratio: f64,
    /// Bandwidth of the sensor that reads its displacement, if one lags behind it.
    pub(super) sensor_bandwidth_hz: Option<f64>,
    /// Filter behind that in the sensor's electronics, where the mode takes it in: natural frequency, Hz, and
    /// damping ratio.
    pub(super) sensor_filter: Option<[f64; 2]>,
}

impl ModeLaw {
    /// The mode over an interval in which its input arrives so.
    pub(super) fn over(&self, dt_s: f64, arrival: Arrival) -> Propagator {
        let Over { phi, start, end } = arrival.over(&self.system(), dt_s);
        let sensor = |_| SensorPropagator {
            phi: [phi[(2, 0)], phi[(2, 1)], phi[(2, 2)]],
            gamma: end[2],
        };
        Propagator {
            phi: [phi[(0, 0)], phi[(0, 1)], phi[(1, 0)], phi[(1, 1)]],
            gamma: [end[0], end[1]],
            angle_rad: self.natural_frequency_rad_s * dt_s,
            sensor: self.sensor_bandwidth_hz.map(sensor),
            start: ByStart {
                gamma: [start[0], start[1]],
                sensor_gamma: start[2],
            },
        }
    }

    /// The filter over such an interval.
    fn filter_over(&self, dt_s: f64, arrival: Arrival) -> Option<FilterPropagator> {
        let Over { phi, start, end } =
            arrival.over(&self.system_with_filter(self.sensor_filter?), dt_s);
        let row = |i: usize| {
            [
                phi[(i, 0)],
                phi[(i, 1)],
                phi[(i, 2)],
                phi[(i, 3)],
                phi[(i, 4)],
                start[i],
                end[i],
            ]
        };
        // Without a lag what is read is the displacement, which stands in its own place.
        Some(FilterPropagator {
            rows: [row(3), row(4)],
        })
    }

    /// The mode with what reads it, and the state that is read: displacement in um, velocity divided by
    /// omega, and the lag's and the filter's states where there are any.
    pub(super) fn read_system(&self) -> (ContinuousSystem, usize) {
        if let Some(filter) = self.sensor_filter {
            return (self.system_with_filter(filter), 3);
        }
        let system = self.system();
        if self.sensor_bandwidth_hz.is_some() {
            return (system, 2);
        }
        let ContinuousSystem { a, b, c, d } = system;
        (
            ContinuousSystem {
                a: a.remove_row(2).remove_column(2),
                b: b.remove_row(2),
                c: c.remove_row(2),
                d,
            },
            0,
        )
    }

    /// The mode, the lag and a filter of this natural frequency, Hz, and damping ratio behind them.
    fn system_with_filter(&self, [frequency_hz, damping_ratio]: [f64; 2]) -> ContinuousSystem {
        let w = std::f64::consts::TAU * frequency_hz;
        let ContinuousSystem { a, b, .. } = self.system();
        let mut with_filter = DMatrix::zeros(5, 5);
        with_filter.view_mut((0, 0), (3, 3)).copy_from(&a);
        with_filter[(3, 4)] = w;
        with_filter[(
            4,
            if self.sensor_bandwidth_hz.is_some() {
                2
            } else {
                0
            },
        )] = w;
        with_filter[(4, 3)] = -w;
        with_filter[(4, 4)] = -2.0 * damping_ratio * w;
        ContinuousSystem {
            a: with_filter,
            b: b.push(0.0).push(0.0),
            c: DVector::zeros(5),
            d: 0.0,
        }
    }

    /// Displacement in um, velocity divided by omega, and the reading.
    fn system(&self) -> ContinuousSystem {
        let w = self.natural_frequency_rad_s;
        let lag_rad_s = std::f64::consts::TAU * self.sensor_bandwidth_hz.unwrap_or(0.0);
        ContinuousSystem {
            a: DMatrix::from_row_slice(
                3,
                3,
                &[
                    0.0,
                    w,
                    0.0,
                    -w,
                    -2.0 * self.damping_ratio * w,
                    0.0,
                    lag_rad_s,
                    0.0,
                    -lag_rad_s,
                ],
            ),
            b: DVector::from_row_slice(&[0.0, w, 0.0]),
            c: DVector::from_row_slice(&[1.0, 0.0, 0.0]),
            d: 0.0,
        }
    }

    /// What an interval brings beside its end: where the mode is in the mean, and what an input that rises
    /// adds.
    pub(super) fn within(&self, dt_s: f64) -> Within {
        let (phi, held, slope) = self.system_with_mean(dt_s).straight_matrices(dt_s);
        Within {
            mean: [phi[(3, 0)], phi[(3, 1)], held[3]],
            rising: [0, 1, 2].map(|i| 2.0 * slope[i] - held[i]),
        }
    }

    /// What an input that arrives so makes of the mean displacement over an interval, of what it would make
    /// if it came at its beginning.
    pub(super) fn share_in_mean(&self, dt_s: f64, arrival: Arrival) -> f64 {
        let Over { start, end, .. } = arrival.over(&self.system_with_mean(dt_s), dt_s);
        end[3] / (start[3] + end[3])
    }

    /// The mode with the mean of its displacement over an interval as one state more.
    fn system_with_mean(&self, dt_s: f64) -> ContinuousSystem {
        let ContinuousSystem { a, b, .. } = self.system();
        ContinuousSystem {
            a: DMatrix::from_fn(4, 4, |i, j| {
                if i < 3 && j < 3 {
                    a[(i, j)]
                } else if i == 3 && j == 0 {
                    1.0 / dt_s
                } else {
                    0.0
                }
            }),
            b: b.push(0.0),
            c: DVector::zeros(4),
            d: 0.0,
        }
    }
}

impl Propagator {
    /// Where one interval ends at whose end the input is this.
    #[inline]
    pub(super) fn after(&self, from: Motion, input: f64) -> Motion {
        if self.sensor.is_some() {
            self.after_as::<true, true>(from, input)
        } else {
            self.after_as::<true, false>(from, input)
        }
    }

    /// [`Self::after`] for those who know whether the input before counts and whether a sensor lags behind:
    /// recursions that run over millions of intervals.
    #[inline]
    pub(super) fn after_as<const STARTS: bool, const LAGS: bool>(
        &self,
        from: Motion,
        input: f64,
    ) -> Motion {
        let Motion {
            displacement: x,
            velocity: v,
            reading,
            before,
        } = from;
        let forced = |by_input: f64, by_start: f64| {
            if STARTS {
                by_input * input + by_start * before
            } else {
                by_input * input
            }
        };
        let displacement =
            self.phi[0] * x + self.phi[1] * v + forced(self.gamma[0], self.start.gamma[0]);
        let velocity =
            self.phi[2] * x + self.phi[3] * v + forced(self.gamma[1], self.start.gamma[1]);
        let reading = match &self.sensor {
            Some(SensorPropagator { phi, gamma }) if LAGS => {
                phi[0] * x + phi[1] * v + phi[2] * reading + forced(*gamma, self.start.sensor_gamma)
            }
            _ => displacement,
        };
        Motion {
            displacement,
            velocity,
            reading,
            before: input,
        }
    }

    /// Where some intervals end in which the mode stays where it is and only the reading goes on.
    pub(super) fn after_rest(&self, from: Motion, intervals: usize) -> Motion {
        let Motion {
            displacement,
            reading,
            ..
        } = from;
        let left = self
            .sensor
            .map_or(0.0, |sensor| sensor.phi[2].powi(intervals as i32));
        Motion {
            reading: displacement + (reading - displacement) * left,
            ..from
        }
    }

    /// [`Self::after`] as [`crate::law`] writes: from `place`, `speed` and `reading`, and the input where the
    /// interval starts and ends, to the next ones.
    pub(super) fn in_lines(&self) -> String {
        let (phi, start, end) = (self.phi, self.start, self.gamma);
        let place = in_a_line("next_place", &[phi[0], phi[1], start.gamma[0], end[0]]);
        let reading = match self.sensor {
            Some(SensorPropagator { phi, gamma }) => {
                let [place, speed, reading] = phi;
                in_a_line(
                    "next_reading",
                    &[place, speed, start.sensor_gamma, gamma, reading],
                )
            }
            None => "next_reading = next_place\n".to_owned(),
        };
        place + &self.speed_in_lines("next_speed") + &reading
    }

    /// The velocity alone.
    pub(super) fn speed_in_lines(&self, to: &str) -> String {
        let start = self.start.gamma[1];
        in_a_line(to, &[self.phi[2], self.phi[3], start, self.gamma[1]])
    }

    /// The angle of the mode in an interval.
    pub(super) fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// [`Self::after_rest`] as [`crate::law`] writes, of so many intervals.
    pub(super) fn after_rest_in_lines(&self, intervals: &str) -> String {
        match self.sensor {
            Some(sensor) => format!(
                "reading = place + (reading - place) * pow({:e}, {intervals})\n",
                sensor.phi[2]
            ),
            None => "reading = place\n".to_owned(),
        }
    }

    /// How far the mode would move in one interval at its present speed.
    #[inline]
    pub(super) fn motion_ahead(&self, from: Motion) -> f64 {
        from.velocity * self.angle_rad
    }
}

/// A sum of what an interval has, in a line.
fn in_a_line(to: &str, by: &[f64]) -> String {
    let terms = ["place", "speed", "starts", "ends", "reading"];
    let products = by
        .iter()
        .zip(terms)
        .map(|(by, term)| format!("{by:e} * {term}"));
    let terms: Vec<String> = products.collect();
    format!("{to} = {}\n", terms.join(" + "))
}

impl VibrationMode {
    /// `omega^2 / (s^2 + 2 xi omega s + omega^2)`, thesis Ch. 5, Eq. 12.
    #[must_use]
    pub fn new(natural_frequency_rad_s: f64, damping_ratio: f64, dt_s: f64) -> Self {
        Self::from_propagator(
            ModeLaw {
                natural_frequency_rad_s,
                damping_ratio,
                sensor_bandwidth_hz: None,
                sensor_filter: None,
            }
            .over(dt_s, Arrival::Late(0.0)),
        )
    }

    fn from_propagator(propagator: Propagator) -> Self {
        Self {
            propagator,
            motion: Motion::default(),
            filter: None,
        }
    }

    /// A mode with what reads it.
    pub(super) fn read(law: &ModeLaw, dt_s: f64, arrival: Arrival) -> Self {
        Self {
            filter: law
                .filter_over(dt_s, arrival)
                .map(|filter| (filter, [0.0; 2])),
            ..Self::from_propagator(law.over(dt_s, arrival))
        }
    }

    /// One interval; the displacement at its end.
    #[inline]
    pub fn step(&mut self, input: f64) -> f64 {
        if let Some((filter, state)) = &mut self.filter {
            *state = filter.after(self.motion, *state, input);
        }
        self.motion = self.propagator.after(self.motion, input);
        self.motion.displacement
    }

    /// Runs over a signal, its value at the end of each interval, and leaves what is read in its place.
    pub(super) fn run_over(&mut self, signal: &mut [f64]) {
        if self.filter.is_some() {
            for value in signal {
                self.step(*value);
                *value = self.reading();
            }
            return;
        }
        let starts = self.propagator.start != ByStart::default();
        match (starts, self.propagator.sensor.is_some()) {
            (false, false) => self.run_over_as::<false, false>(signal),
            (false, true) => self.run_over_as::<false, true>(signal),
            (true, false) => self.run_over_as::<true, false>(signal),
            (true, true) => self.run_over_as::<true, true>(signal),
        }
    }

    fn run_over_as<const STARTS: bool, const LAGS: bool>(&mut self, signal: &mut [f64]) {
        // A copy stays in registers: nothing but the recursion itself then stands between two intervals.
        let (propagator, mut motion) = (self.propagator, self.motion);
        for value in signal {
            motion = propagator.after_as::<STARTS, LAGS>(motion, *value);
            *value = motion.reading;
        }
        self.motion = motion;
    }

    /// What is read: the displacement where no sensor lags behind it.
    #[must_use]
    pub fn reading(&self) -> f64 {
        self.filter
            .map_or(self.motion.reading, |(_, [reading, _])| reading)
    }

    /// The mode with what reads it, over its interval: displacement, velocity, lagging reading, and what the
    /// filter has.
    pub(super) fn as_linear(&self) -> Linear {
        let Propagator {
            phi,
            gamma,
            sensor,
            start,
            ..
        } = self.propagator;
        let mut rows = vec![vec![phi[0], phi[1], 0.0], vec![phi[2], phi[3], 0.0]];
        let (mut starts, mut ends) = (
            vec![start.gamma[0], start.gamma[1]],
            vec![gamma[0], gamma[1]],
        );
        // Without a lag the reading is the displacement.
        let (row, by_start, by_end) = match sensor {
            Some(SensorPropagator { phi, gamma }) => (phi.to_vec(), start.sensor_gamma, gamma),
            None => (rows[0].clone(), starts[0], ends[0]),
        };
        rows.push(row);
        starts.push(by_start);
        ends.push(by_end);
        let mut rest = vec![1.0, 0.0, 1.0];
        let mut reading = vec![0.0, 0.0, 1.0];
        if let Some((filter, _)) = &self.filter {
            rows.iter_mut().for_each(|row| row.extend([0.0; 2]));
            for row in filter.rows {
                rows.push(row[..5].to_vec());
                starts.push(row[5]);
                ends.push(row[6]);
            }
            rest.extend([1.0, 0.0]);
            reading = vec![0.0, 0.0, 0.0, 1.0, 0.0];
        }
        Linear::reading_states(rows, starts, ends, &reading, 0.0, rest)
    }

    /// Present displacement.
    #[must_use]
    pub fn displacement(&self) -> f64 {
        self.motion.displacement
    }

    /// How far the mode would move in one interval at its present speed.
    #[must_use]
    pub fn motion_ahead(&self) -> f64 {
        self.propagator.motion_ahead(self.motion)
    }

    /// At rest under a constant input.
    pub fn settle(&mut self, input: f64) -> f64 {
        self.motion = Motion::settled(input);
        if let Some((_, state)) = &mut self.filter {
            *state = [input, 0.0];
        }
        input
    }
}

/// Free motions of a mode.
pub(super) fn free_motions_of(natural_frequency_rad_s: f64, damping_ratio: f64) -> Vec<FreeMotion> {
    let (w, xi) = (natural_frequency_rad_s, damping_ratio);
    if xi < 1.0 {
        return vec![FreeMotion {
            decay_per_s: xi * w,
            frequency_rad_s: w * (1.0 - xi * xi).sqrt(),
        }];
    }
    let root = (xi * xi - 1.0).sqrt();
    [xi - root, xi + root]
        .map(|factor| FreeMotion {
            decay_per_s: factor * w,
            frequency_rad_s: 0.0,
        })
        .to_vec()
}

/// A mode with a state for each signal.
pub(super) struct ModeLanes {
    mode: Propagator,
    displacement: Vec<f64>,
    velocity: Vec<f64>,
    reading: Vec<f64>,
    pub(super) before: Vec<f64>,
    filter: Option<(FilterPropagator, Vec<[f64; 2]>)>,
}

impl ModeLanes {
    pub(super) fn new(
        VibrationMode {
            propagator: mode,
            filter,
            ..
        }: VibrationMode,
        lanes: usize,
    ) -> Self {
        let zeros = || vec![0.0; lanes];
        let filter = filter.map(|(filter, _)| (filter, vec![[0.0; 2]; lanes]));
        Self {
            mode,
            displacement: zeros(),
            velocity: zeros(),
            reading: zeros(),
            before: zeros(),
            filter,
        }
    }

    pub(super) fn settle(&mut self, row: &[f64]) {
        self.displacement.copy_from_slice(row);
        self.velocity.fill(0.0);
        self.reading.copy_from_slice(row);
        self.before.copy_from_slice(row);
        if let Some((_, states)) = &mut self.filter {
            states
                .iter_mut()
                .zip(row)
                .for_each(|(state, input)| *state = [*input, 0.0]);
        }
    }

    /// One interval; what is read is left in the place of the input.
    pub(super) fn step(&mut self, row: &mut [f64]) {
        let Propagator {
            phi,
            gamma,
            sensor,
            start,
            ..
        } = self.mode;
        let lanes = row.len();
        let (x, v) = (&mut self.displacement[..lanes], &mut self.velocity[..lanes]);
        let (reading, before) = (&mut self.reading[..lanes], &mut self.before[..lanes]);
        if let Some((filter, states)) = &mut self.filter {
            for (i, state) in states.iter_mut().enumerate() {
                let from = Motion {
                    displacement: x[i],
                    velocity: v[i],
                    reading: reading[i],
                    before: before[i],
                };
                *state = filter.after(from, *state, row[i]);
            }
        }
        if let Some(sensor) = sensor {
            for i in 0..lanes {
                reading[i] = sensor.phi[0] * x[i]
                    + sensor.phi[1] * v[i]
                    + sensor.phi[2] * reading[i]
                    + (sensor.gamma * row[i] + start.sensor_gamma * before[i]);
            }
        }
        for i in 0..lanes {
            let (x0, v0, u, b) = (x[i], v[i], row[i], before[i]);
            x[i] = phi[0] * x0 + phi[1] * v0 + (gamma[0] * u + start.gamma[0] * b);
            v[i] = phi[2] * x0 + phi[3] * v0 + (gamma[1] * u + start.gamma[1] * b);
            before[i] = u;
        }
        match &self.filter {
            Some((_, states)) => row
                .iter_mut()
                .zip(states)
                .for_each(|(value, [filtered, _])| *value = *filtered),
            None => row.copy_from_slice(if sensor.is_some() { reading } else { x }),
        }
    }
}
