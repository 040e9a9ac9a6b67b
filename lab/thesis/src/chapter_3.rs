//! Chapter 3: the stick-slip actuator, identified in the thesis' three experiments and validated in its
//! figures.
//!
//! The simulated rig is [`StickSlipActuator::thesis`] behind a sensor with 10 nm RMS noise (the inductive
//! sensor's resolution). The identification sees the platform alone (slow triangles, steps) and the
//! end-effector (one saw-tooth record), as in Ch. 3, IV.B.

use super::least_squares::{self, Estimate};
use crate::chapter::{Chapter, ChapterProgress, ChapterRow, errata};
use hysteron::servo::stepping_contact::{IdentifiedContact, identify_contact};
use hysteron::statistics::{difference, largest, mean, rms};
use hysteron::{Record, stepping};
use hysteron_report::{CurveRole, PageBlock, Plot, Section, Series, Style, Table, Width};
use hysteron_sim::elastoplastic_friction::ElastoplasticFriction;
use hysteron_sim::hysteresis_surface::Surfaces;
use hysteron_sim::linear_system::ContinuousSystem;
use hysteron_sim::noise::WhiteNoise;
use hysteron_sim::stick_slip::{Integrator, PLATFORM_STIFFNESS_N_UM, SUBSTEPS, StickSlipActuator};
use hysteron_sim::waveform;
use nalgebra::DMatrix;

/// Sampling rate, Hz (Ch. 3, IV.A).
const SAMPLE_RATE_HZ: f64 = 20_000.0;
/// RMS noise of the inductive sensor, um (its resolution, Ch. 3, IV.A).
const SENSOR_NOISE_UM: f64 = 0.01;
/// Mass of the bare end-effector, kg.
const MASS_KG: f64 = 0.0635;
/// Range of the drive, V.
const DRIVE_RANGE_V: f64 = 100.0;

fn noisy(signal: &[f64], seed: u64) -> Vec<f64> {
    let mut noise = WhiteNoise::new(SENSOR_NOISE_UM, seed);
    signal.iter().map(|v| v + noise.next_um()).collect()
}

/// First experiment: slow rises and falls of growing height, no end-effector. Returns `F(alpha, beta) / K` in
/// the form `(alpha - beta) Q`.
fn identify_hysteresis(rig: &StickSlipActuator) -> Result<(Surfaces, Estimate), String> {
    // Slowly means here: 1000 V/s from one multiple of 5 V to the next, 20 ms of rest on each, the mean of
    // the last 5 ms is the reading.
    let (ramp, rest, mean_over) = (100usize, 400usize, 100usize);
    let mut levels = vec![0.0];
    for k in 1..=20i32 {
        levels.extend((1..=k).chain((0..k).rev()).map(|j| 5.0 * f64::from(j)));
    }
    let mut drive = Vec::with_capacity(levels.len() * (ramp + rest));
    for pair in levels.windows(2) {
        drive.extend((1..=ramp).map(|s| pair[0] + (pair[1] - pair[0]) * s as f64 / ramp as f64));
        drive.extend(std::iter::repeat_n(pair[1], rest));
    }
    let reading = noisy(&without_end_effector(rig).platform(&drive), 301);
    let at_level: Vec<f64> = std::iter::once(0.0)
        .chain(
            reading
                .chunks_exact(ramp + rest)
                .map(|chunk| mean(&chunk[ramp + rest - mean_over..])),
        )
        .collect();
    let (mut points, mut data) = (Vec::new(), Vec::new());
    let mut peak = 0usize;
    for k in 1..=20usize {
        peak += k;
        for down in 1..=k {
            points.push((0.05 * k as f64, 0.05 * (k - down) as f64));
            data.push(at_level[peak] - at_level[peak + down]);
        }
        peak += k;
    }
    // Order by evidence: the degree with the lowest information criterion.
    let mut best: Option<(usize, Estimate)> = None;
    for degree in 2..=6 {
        let terms = terms(degree);
        let rows = DMatrix::from_fn(points.len(), terms.len(), |r, c| {
            let ((x, z), (i, j)) = (points[r], terms[c]);
            (x - z) * x.powi(i) * z.powi(j)
        });
        if let Some(fit) = least_squares::linear(rows, &data, None)
            && best
                .as_ref()
                .is_none_or(|(_, b)| fit.information_criterion() < b.information_criterion())
        {
            best = Some((degree, fit));
        }
    }
    let (degree, fit) =
        best.ok_or("the hysteresis surface of the stick-slip actuator could not be fitted")?;
    let mut g = vec![vec![0.0; degree + 1]; degree + 1];
    for ((i, j), value) in terms(degree).into_iter().zip(&fit.values) {
        g[i as usize + 1][j as usize] += value;
        g[i as usize][j as usize + 1] -= value;
    }
    Ok((Surfaces { g, r: Vec::new() }, fit))
}

fn terms(degree: usize) -> Vec<(i32, i32)> {
    (0..degree as i32)
        .flat_map(|total| (0..=total).map(move |j| (total - j, j)))
        .collect()
}

/// The platform of a rig without its end-effector: exact for a held drive.
struct Platform<'a>(&'a StickSlipActuator);

fn without_end_effector(rig: &StickSlipActuator) -> Platform<'_> {
    Platform(rig)
}

impl Platform<'_> {
    fn platform(&self, drive_v: &[f64]) -> Vec<f64> {
        let force_um = self.0.force_equivalent_um(drive_v);
        second_order_response(
            self.0.natural_frequency_rad_s,
            self.0.damping_ratio,
            &force_um,
        )
    }
}

/// Response of Eq. (17) at the samples to an input held from each sample to the next.
fn second_order_response(
    natural_frequency_rad_s: f64,
    damping_ratio: f64,
    input: &[f64],
) -> Vec<f64> {
    let w = natural_frequency_rad_s;
    let Some(system) =
        ContinuousSystem::from_transfer_function(&[w * w], &[1.0, 2.0 * damping_ratio * w, w * w])
    else {
        return input.to_vec();
    };
    let mut discrete = system.discretise(1.0 / SAMPLE_RATE_HZ);
    let mut output = 0.0;
    input
        .iter()
        .map(|u| {
            let now = output;
            output = discrete.step_held(*u);
            now
        })
        .collect()
}

/// Second experiment: steps to 50 and 100 V without end-effector; natural frequency, damping ratio and both
/// heights.
fn identify_platform(rig: &StickSlipActuator) -> Result<Estimate, String> {
    let readings: Vec<Vec<f64>> = [50.0, 100.0]
        .iter()
        .enumerate()
        .map(|(k, height)| {
            noisy(
                &without_end_effector(rig).platform(&waveform::hold(SAMPLE_RATE_HZ, *height, 0.03)),
                310 + k as u64,
            )
        })
        .collect();
    let residuals = |p: &[f64]| -> Vec<f64> {
        let mut out = Vec::new();
        for (reading, height) in readings.iter().zip(&p[2..]) {
            out.extend(difference(
                &second_order_response(p[0], p[1], &vec![*height; reading.len()]),
                reading,
            ));
        }
        out
    };
    least_squares::nonlinear(
        &residuals,
        &[1000.0, 0.5, 5.0, 10.0],
        &[1000.0, 0.5, 5.0, 10.0],
        None,
    )
    .ok_or_else(|| "the step responses of the platform could not be fitted".into())
}

fn saw_tooth(frequency_hz: f64, height_v: f64, cycles: usize) -> Vec<f64> {
    waveform::saw_tooth(SAMPLE_RATE_HZ, frequency_hz, height_v, 1.0, cycles)
}

/// Average speed over `cycles` saw-teeth, um/s.
fn speed(
    actuator: &StickSlipActuator,
    frequency_hz: f64,
    height_v: f64,
    cycles: usize,
    noise_seed: Option<u64>,
) -> f64 {
    let drive_v = saw_tooth(frequency_hz, height_v, cycles);
    let motion = actuator.simulate(&drive_v, SAMPLE_RATE_HZ).end_effector_um;
    let reading = noise_seed.map_or(motion.clone(), |seed| noisy(&motion, seed));
    let tape = Record::new("saw-teeth", SAMPLE_RATE_HZ, drive_v, reading);
    let train = stepping::trains(&tape, 0.0).into_iter().next();
    train.map_or(0.0, |train| train.velocity_um_s.value)
}

/// Natural cubic spline through points with ascending abscissae.
fn spline(x: &[f64], y: &[f64], at: f64) -> f64 {
    let n = x.len();
    if n < 3 {
        return y.first().copied().unwrap_or(0.0);
    }
    let h: Vec<f64> = x.windows(2).map(|p| p[1] - p[0]).collect();
    let matrix = DMatrix::from_fn(n, n, |i, j| {
        if i == 0 || i == n - 1 {
            f64::from(u8::from(i == j))
        } else if j + 1 == i {
            h[i - 1]
        } else if j == i {
            2.0 * (h[i - 1] + h[i])
        } else if j == i + 1 {
            h[i]
        } else {
            0.0
        }
    });
    let right = nalgebra::DVector::from_fn(n, |i, _| {
        if i == 0 || i == n - 1 {
            0.0
        } else {
            6.0 * ((y[i + 1] - y[i]) / h[i] - (y[i] - y[i - 1]) / h[i - 1])
        }
    });
    let Some(m) = matrix.lu().solve(&right) else {
        return y[0];
    };
    let k = (0..n - 1).rfind(|&k| at >= x[k]).unwrap_or(0);
    let (a, b) = (x[k + 1] - at, at - x[k]);
    (m[k] * a.powi(3) + m[k + 1] * b.powi(3)) / (6.0 * h[k])
        + (y[k] / h[k] - m[k] * h[k] / 6.0) * a
        + (y[k + 1] / h[k] - m[k + 1] * h[k] / 6.0) * b
}

fn times_s(count: usize) -> Vec<f64> {
    (0..count).map(|k| k as f64 / SAMPLE_RATE_HZ).collect()
}

/// Cycles of the saw-teeth from which friction is identified, and on which it is judged.
const CYCLES: usize = 12;

/// Displacement over time at 30, 50 and 60 V (Fig. 4), with the errors of the model.
fn saw_teeth(rig: &StickSlipActuator, model: &StickSlipActuator) -> (Vec<ChapterRow>, Plot) {
    let mut figure_4 = Plot::new("Fig. 4: end-effector at 60 Hz")
        .x_axis("time", "s")
        .y_axis("displacement", "um")
        .width(Width::Full);
    let (mut rows, mut errors, mut noisy_errors) = (Vec::new(), Vec::new(), Vec::new());
    for (k, height) in [30.0, 50.0, 60.0].into_iter().enumerate() {
        let drive = saw_tooth(60.0, height, CYCLES);
        let truth = rig.simulate(&drive, SAMPLE_RATE_HZ).end_effector_um;
        let ours = model.simulate(&drive, SAMPLE_RATE_HZ).end_effector_um;
        let reading = noisy(&truth, 330 + k as u64);
        let error = difference(&truth, &ours);
        rows.push(ChapterRow::new(
            format!("ch3.erms.{height:.0}v"),
            rms(&error),
            "um",
            format!("end-effector at {height} V, 60 Hz, noise removed"),
        ));
        errors.extend(error);
        noisy_errors.extend(difference(&reading, &ours));
        let t = times_s(truth.len());
        figure_4 = figure_4
            .with(Series::line(
                "measured",
                CurveRole::Measured,
                t.clone(),
                reading,
            ))
            .with(Series::line("model", CurveRole::Model, t, ours).style(Style::Dashed));
    }
    rows.insert(
        0,
        ChapterRow::new(
            "ch3.erms",
            rms(&errors),
            "um",
            "Eq. 18 over 30, 50, 60 V saw-teeth of 12 cycles; parameters from noisy records of three experiments",
        ),
    );
    rows.push(ChapterRow::new(
        "ch3.emax",
        largest(&errors),
        "um",
        "largest error of the same",
    ));
    let note = format!(
        "the same against the readings, {:.0} nm of noise",
        1e3 * SENSOR_NOISE_UM
    );
    rows.push(ChapterRow::new(
        "ch3.erms.with_noise",
        rms(&noisy_errors),
        "um",
        note,
    ));
    (rows, figure_4)
}

/// Errors of the integrators against a step a hundred times finer.
fn integrators(rig: &StickSlipActuator) -> Vec<ChapterRow> {
    let mut rows = Vec::new();
    let force_um = rig.force_equivalent_um(&saw_tooth(60.0, 50.0, 3));
    let finest = rig
        .simulate_with(
            &force_um,
            SAMPLE_RATE_HZ,
            Integrator::RungeKutta,
            100 * SUBSTEPS,
        )
        .end_effector_um;
    for (id, integrator, name) in [
        (
            "runge_kutta",
            Integrator::RungeKutta,
            "Runge-Kutta of fourth order, the one in use",
        ),
        (
            "rosenbrock",
            Integrator::Rosenbrock,
            "two-stage L-stable Rosenbrock method of second order",
        ),
    ] {
        let coarse = rig
            .simulate_with(&force_um, SAMPLE_RATE_HZ, integrator, SUBSTEPS)
            .end_effector_um;
        rows.push(ChapterRow::new(
            format!("ch3.integrator.{id}.max"),
            largest(&difference(&coarse, &finest)),
            "um",
            format!("{name}, {SUBSTEPS} steps in 50 us, against a step 100 times finer; 50 V, 60 Hz, three cycles"),
        ));
    }
    rows
}

/// Platform and end-effector with and without hysteresis in the model (Fig. 5).
fn with_and_without_hysteresis(
    rig: &StickSlipActuator,
    model: &StickSlipActuator,
) -> (Vec<ChapterRow>, [Plot; 2]) {
    let mut rows = Vec::new();
    let mut linear = model.clone();
    let gain = model.hysteresis.initial_ascending_curve(0.5) / 0.5;
    linear.hysteresis = Surfaces {
        g: vec![vec![0.0, -gain], vec![gain, 0.0]],
        r: Vec::new(),
    };
    let platform_drive = saw_tooth(10.0, 50.0, 3);
    let platform_truth = without_end_effector(rig).platform(&platform_drive);
    let mut figure_5a = Plot::new("Fig. 5 (A): platform, 50 V, 10 Hz")
        .x_axis("time", "s")
        .y_axis("displacement", "um")
        .with(Series::line(
            "measured",
            CurveRole::Measured,
            times_s(platform_truth.len()),
            noisy(&platform_truth, 340),
        ));
    let effector_drive = saw_tooth(20.0, 50.0, 6);
    let effector_truth = rig
        .simulate(&effector_drive, SAMPLE_RATE_HZ)
        .end_effector_um;
    let mut figure_5b = Plot::new("Fig. 5 (B): end-effector, 50 V, 20 Hz")
        .x_axis("time", "s")
        .y_axis("displacement", "um")
        .with(Series::line(
            "measured",
            CurveRole::Measured,
            times_s(effector_truth.len()),
            noisy(&effector_truth, 341),
        ));
    for (name, role, candidate) in [
        ("with hysteresis", CurveRole::Model, model),
        ("without hysteresis", CurveRole::Other1, &linear),
    ] {
        let platform_model = without_end_effector(candidate).platform(&platform_drive);
        let effector_model = candidate
            .simulate(&effector_drive, SAMPLE_RATE_HZ)
            .end_effector_um;
        let key = name.replace(' ', "_");
        rows.push(ChapterRow::new(
            format!("ch3.fig5a.{key}.rms"),
            rms(&difference(&platform_truth, &platform_model)),
            "um",
            "platform, 50 V, 10 Hz saw-tooth",
        ));
        rows.push(ChapterRow::new(
            format!("ch3.fig5b.{key}.rms"),
            rms(&difference(&effector_truth, &effector_model)),
            "um",
            "end-effector, 50 V, 20 Hz saw-tooth",
        ));
        figure_5a = figure_5a.with(
            Series::line(name, role, times_s(platform_model.len()), platform_model)
                .style(Style::Dashed),
        );
        figure_5b = figure_5b.with(
            Series::line(name, role, times_s(effector_model.len()), effector_model)
                .style(Style::Dashed),
        );
    }
    (rows, [figure_5a, figure_5b])
}

/// Speed over voltage and frequency (Figs. 6 and 7).
fn speeds(rig: &StickSlipActuator, model: &StickSlipActuator) -> (Vec<ChapterRow>, [Plot; 2]) {
    let mut rows = Vec::new();
    let roles = [
        CurveRole::Other1,
        CurveRole::Other2,
        CurveRole::Other3,
        CurveRole::Other4,
    ];
    let mut figure_6 = Plot::new("Fig. 6: speed over magnitude")
        .x_axis("saw-tooth magnitude", "V")
        .y_axis("average speed", "um/s");
    let mut worst_speed_pct: f64 = 0.0;
    let mut monotone = true;
    for (role, frequency) in roles.into_iter().zip([20.0, 40.0, 60.0, 80.0]) {
        let heights: Vec<f64> = (2..=8).map(|k| 10.0 * f64::from(k)).collect();
        let measured: Vec<f64> = heights
            .iter()
            .enumerate()
            .map(|(k, h)| speed(rig, frequency, *h, 15, Some(350 + k as u64)))
            .collect();
        let ours: Vec<f64> = heights
            .iter()
            .map(|h| speed(model, frequency, *h, 15, None))
            .collect();
        monotone &= measured
            .windows(2)
            .chain(ours.windows(2))
            .all(|p| p[1] > p[0]);
        let top = largest(&measured);
        worst_speed_pct = worst_speed_pct.max(100.0 * largest(&difference(&measured, &ours)) / top);
        figure_6 = figure_6
            .with(Series::points(
                format!("{frequency:.0} Hz, measured"),
                role,
                heights.clone(),
                measured,
            ))
            .with(Series::line(
                format!("{frequency:.0} Hz, model"),
                role,
                heights,
                ours,
            ));
    }
    let mut figure_7 = Plot::new("Fig. 7: speed over frequency")
        .x_axis("saw-tooth frequency", "Hz")
        .y_axis("average speed", "um/s");
    for (role, height) in roles.into_iter().zip([30.0, 50.0, 70.0]) {
        let frequencies: Vec<f64> = (1..=9).map(|k| 10.0 * f64::from(k)).collect();
        let measured: Vec<f64> = frequencies
            .iter()
            .enumerate()
            .map(|(k, f)| speed(rig, *f, height, 15, Some(370 + k as u64)))
            .collect();
        let ours: Vec<f64> = frequencies
            .iter()
            .map(|f| speed(model, *f, height, 15, None))
            .collect();
        monotone &= measured
            .windows(2)
            .chain(ours.windows(2))
            .all(|p| p[1] > p[0]);
        worst_speed_pct = worst_speed_pct
            .max(100.0 * largest(&difference(&measured, &ours)) / largest(&measured));
        figure_7 = figure_7
            .with(Series::points(
                format!("{height:.0} V, measured"),
                role,
                frequencies.clone(),
                measured,
            ))
            .with(Series::line(
                format!("{height:.0} V, model"),
                role,
                frequencies,
                ours,
            ));
    }
    rows.push(ChapterRow::new(
        "ch3.speed.worst",
        worst_speed_pct,
        "%",
        "largest speed error over Figs. 6 and 7, of the highest speed of its curve",
    ));
    rows.push(ChapterRow::new(
        "ch3.speed.monotone",
        f64::from(u8::from(monotone)),
        "1",
        "1: speed rises with voltage and with frequency everywhere in Figs. 6 and 7",
    ));
    (rows, [figure_6, figure_7])
}

/// Contact stiffness and speed over mass (Fig. 8).
fn speed_over_mass(model: &StickSlipActuator) -> Result<(Vec<ChapterRow>, [Plot; 2]), String> {
    let mut rows = Vec::new();
    let beta_n_kg = model.friction.coulomb_force_n / MASS_KG;
    let loaded = |base: &StickSlipActuator,
                  mass_kg: f64,
                  stiffness_n_um: f64,
                  coulomb_n_kg: f64|
     -> StickSlipActuator {
        let friction = ElastoplasticFriction {
            stiffness_n_um,
            coulomb_force_n: coulomb_n_kg * mass_kg,
            ..base.friction
        };
        StickSlipActuator {
            friction,
            end_effector_mass_kg: mass_kg,
            ..base.clone()
        }
    };
    let short = saw_tooth(60.0, 50.0, 6);
    let force_um = model.force_equivalent_um(&short);
    let known_masses = [0.0635, 0.1, 0.13, 0.157, 0.19, 0.22, 0.253, 0.3, 0.36, 0.42];
    let mut stiffness = Vec::new();
    for (k, mass) in known_masses.into_iter().enumerate() {
        let reading = noisy(
            &StickSlipActuator::thesis(mass)
                .simulate(&short, SAMPLE_RATE_HZ)
                .end_effector_um,
            380 + k as u64,
        );
        let residuals = |p: &[f64]| -> Vec<f64> {
            let trial = loaded(model, mass, p[0].exp(), beta_n_kg);
            difference(
                &trial
                    .simulate_with(&force_um, SAMPLE_RATE_HZ, Default::default(), 8)
                    .end_effector_um,
                &reading,
            )
        };
        let start = (0..14)
            .map(|i| -2.0 + 0.25 * f64::from(i))
            .min_by(|a, b| rms(&residuals(&[*a])).total_cmp(&rms(&residuals(&[*b]))))
            .unwrap_or(0.0);
        let fit = least_squares::nonlinear(&residuals, &[start], &[1.0], None)
            .ok_or("the contact stiffness over mass could not be identified")?;
        stiffness.push(fit.values[0].exp());
    }
    let masses: Vec<f64> = (0..=35).map(|k| 0.065 + 0.01 * f64::from(k)).collect();
    let (mut measured, mut ours) = (Vec::new(), Vec::new());
    for (k, mass) in masses.iter().enumerate() {
        measured.push(speed(
            &StickSlipActuator::thesis(*mass),
            60.0,
            50.0,
            60,
            Some(400 + k as u64),
        ));
        ours.push(speed(
            &loaded(
                model,
                *mass,
                spline(&known_masses, &stiffness, *mass),
                beta_n_kg,
            ),
            60.0,
            50.0,
            60,
            None,
        ));
    }
    let best = |speeds: &[f64]| {
        masses
            .iter()
            .zip(speeds)
            .max_by(|a, b| a.1.total_cmp(b.1))
            .map_or((0.0, 0.0), |(m, s)| (*m, *s))
    };
    let ((rig_mass, rig_speed), (our_mass, our_speed)) = (best(&measured), best(&ours));
    rows.push(ChapterRow::new(
        "ch3.optimum_mass.measured",
        rig_mass,
        "kg",
        format!("mass of the highest speed measured at 50 V, 60 Hz: {rig_speed:.1} um/s"),
    ));
    rows.push(ChapterRow::new(
        "ch3.optimum_mass.model",
        our_mass,
        "kg",
        format!("mass of the highest speed of the identified model: {our_speed:.1} um/s"),
    ));
    let figure_8 = Plot::new("Fig. 8: speed over mass, 50 V, 60 Hz")
        .x_axis("end-effector mass", "kg")
        .y_axis("average speed", "um/s")
        .caption(format!(
            "The highest speed is at {rig_mass:.3} kg as measured, {our_mass:.3} kg by the model."
        ))
        .with(Series::points(
            "measured",
            CurveRole::Measured,
            masses.clone(),
            measured,
        ))
        .with(Series::line(
            "model",
            CurveRole::Model,
            masses.clone(),
            ours,
        ));
    let figure_stiffness = Plot::new("Contact stiffness over mass (Eqs. 19-21)")
        .x_axis("end-effector mass", "kg")
        .y_axis("contact stiffness", "N/mm")
        .with(Series::points(
            "identified",
            CurveRole::Model,
            known_masses.to_vec(),
            stiffness.iter().map(|s| 1000.0 * s).collect(),
        ))
        .with(Series::line(
            "printed splines",
            CurveRole::Measured,
            masses.clone(),
            masses
                .iter()
                .map(|m| 1000.0 * hysteron_sim::stick_slip::printed_contact_stiffness_n_um(*m))
                .collect(),
        ));
    Ok((rows, [figure_8, figure_stiffness]))
}

/// The identified friction beside the printed one (Table I).
fn friction_table(found: &IdentifiedContact) -> (Vec<ChapterRow>, Table) {
    let mut rows = Vec::new();
    let values = [
        (
            "coulomb_force",
            "F_c",
            "N",
            1.0,
            found.coulomb_force_n,
            0.0362,
        ),
        (
            "contact_stiffness",
            "sigma_0",
            "N/mm",
            1e3,
            found.stiffness_n_um,
            482.0,
        ),
        (
            "contact_damping",
            "sigma_1",
            "N/(mm/s)",
            1e3,
            found.damping_n_s_um,
            0.273,
        ),
        (
            "breakaway_ratio",
            "z_b/z_s",
            "1",
            1.0,
            found.breakaway_ratio.unwrap_or_default(),
            0.801,
        ),
    ];
    let mut table = Table {
        title: "Friction (Ch. 3, Table I)".into(),
        columns: ["parameter", "identified", "std", "thesis", "unit"]
            .map(String::from)
            .to_vec(),
        ..Table::default()
    };
    for (key, symbol, unit, scale, found, printed) in values {
        let (value, std) = (scale * found.value, scale * found.std);
        rows.push(ChapterRow::new(
            format!("ch3.friction.{key}"),
            value,
            unit,
            format!("{symbol} by nonlinear least squares, +- {std:.2e}; printed {printed}"),
        ));
        table.rows.push(vec![
            symbol.into(),
            format!("{value:.4}"),
            format!("{std:.1e}"),
            printed.to_string(),
            unit.into(),
        ]);
    }
    (rows, table)
}

/// Plays, identifies and validates the stick-slip actuator.
pub(super) fn reproduce(progress: ChapterProgress) -> Result<Chapter, String> {
    let rig = StickSlipActuator::thesis(MASS_KG);
    progress("chapter 3: hysteresis and platform from slow triangles and steps");
    let (surfaces, surface_fit) = identify_hysteresis(&rig)?;
    let platform = identify_platform(&rig)?;
    progress("chapter 3: friction from the 50 V, 60 Hz saw-tooth");
    let mut model = StickSlipActuator {
        hysteresis: surfaces,
        plays: Vec::new(),
        drive_range_v: DRIVE_RANGE_V,
        platform_stiffness_n_um: PLATFORM_STIFFNESS_N_UM,
        natural_frequency_rad_s: platform.values[0],
        damping_ratio: platform.values[1],
        friction: rig.friction,
        end_effector_mass_kg: MASS_KG,
        effects: rig.effects,
    };
    let drive_50 = saw_tooth(60.0, 50.0, CYCLES);
    let reading_50 = noisy(
        &rig.simulate(&drive_50, SAMPLE_RATE_HZ).end_effector_um,
        320,
    );
    let contact = identify_contact(&model, &drive_50, &reading_50, SAMPLE_RATE_HZ)?;
    model = contact.on(&model);

    let (mut rows, figure_4) = saw_teeth(&rig, &model);
    progress("chapter 3: error of the integrator");
    rows.extend(integrators(&rig));
    progress("chapter 3: with and without hysteresis (Fig. 5)");
    let (more, figure_5) = with_and_without_hysteresis(&rig, &model);
    rows.extend(more);
    progress("chapter 3: speed over voltage and frequency (Figs. 6 and 7)");
    let (more, figures_6_and_7) = speeds(&rig, &model);
    rows.extend(more);
    progress("chapter 3: contact stiffness and speed over mass (Fig. 8)");
    let (more, figure_8) = speed_over_mass(&model)?;
    rows.extend(more);
    let (more, table) = friction_table(&contact);
    rows.extend(more);
    rows.push(ChapterRow::new(
        "ch3.beta",
        model.friction.coulomb_force_n / MASS_KG,
        "N/kg",
        "identified F_c over the mass of the end-effector",
    ));
    rows.push(ChapterRow::new(
        "ch3.natural_frequency",
        platform.values[0],
        "rad/s",
        "from steps to 50 and 100 V; printed 1526",
    ));
    rows.push(ChapterRow::new(
        "ch3.damping_ratio",
        platform.values[1],
        "1",
        "from steps to 50 and 100 V; printed 0.7696",
    ));
    rows.push(ChapterRow::new(
        "ch3.surface.terms",
        surface_fit.values.len() as f64,
        "1",
        format!(
            "coefficients of F(alpha, beta), order by evidence; residual {:.4} um RMS",
            surface_fit.residual_rms()
        ),
    ));

    let plots = std::iter::once(figure_4)
        .chain(figure_5)
        .chain(figures_6_and_7)
        .chain(figure_8);
    let mut blocks: Vec<PageBlock> = plots.map(PageBlock::Plot).collect();
    blocks.push(PageBlock::Table(table));
    blocks.push(PageBlock::Notes(errata(&[
                "Eqs. (13) and (14) together let friction feed the motion: the relative motion is taken as platform less end-effector.",
                "Eq. (16) does not vanish on alpha = beta (up to 1 N, 20 nm): replaced by the nearest surface that does.",
                "Table I prints sigma_0 = 482 N/mm, Eq. (19) gives 483.2 N/mm at 0.0635 kg: the table is used there.",
                "F_c is proportional to the mass, so the acceleration at which the end-effector slides is the same for all masses: the optimum over mass comes from sigma_0(M_e) alone.",
            ])));
    let sections = vec![Section {
        heading: "Chapter 3: stick-slip actuator".into(),
        text: "Hysteresis from slow triangles and the platform's mode from steps, both without end-effector; friction from one saw-tooth record. \
               The simulated rig has the printed constants and 10 nm RMS of sensor noise."
            .into(),
        blocks,
    }];
    Ok(Chapter {
        number: 3,
        rows,
        sections,
        choices: Vec::new(),
    })
}
