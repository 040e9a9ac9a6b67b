//! Recordings of a real stage that were altered in a known way: is it named?
//!
//! The reading is altered as a sensor, an electronics or a data acquisition would alter it, in three sizes
//! each. What counts as right lists the effects that do physically what was done to the column; it was
//! written down before anything was run.

use super::case::{CaseCheck, CaseStart, SetCase, model_of, own_effects};
use super::context::{Context, beside, copy, spread, write};
use super::mark::CaseTruth;
use super::table_of_numbers::NumberTable;
use std::f64::consts::{SQRT_2, TAU};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Sampling rate of the recordings.
const RATE_HZ: f64 = 10_000.0;
/// The stage was switched on before.
const FROM_S: f64 = 1.5;
/// Half of the range of the readings, um.
const HALF_RANGE_UM: f64 = 20.0;
/// The recordings, fitted and held out.
const RECORDS: [(&str, &str); 2] = [("20_hz_no_lp", "identify"), ("40_hz_no_lp", "validate")];

/// One way to alter a reading, in three sizes.
struct Alteration {
    name: &'static str,
    sizes: [f64; 3],
    /// Effects that do what was done.
    right: &'static [&'static str],
    alter: fn(&mut [f64], f64),
}

const ALTERATIONS: [Alteration; 10] = [
    Alteration {
        name: "delay_ms",
        sizes: [0.2, 0.5, 1.0],
        right: &["delay"],
        alter: delay,
    },
    Alteration {
        name: "lag_hz",
        sizes: [1000.0, 400.0, 150.0],
        right: &["sensor_bandwidth"],
        alter: first_order,
    },
    // A second-order low-pass is one whatever it is called.
    Alteration {
        name: "filter_hz",
        sizes: [800.0, 400.0, 200.0],
        right: &["sensor_filter", "vibration"],
        alter: butterworth,
    },
    Alteration {
        name: "mode_hz",
        sizes: [800.0, 400.0, 200.0],
        right: &["second_mode", "vibration", "sensor_filter"],
        alter: mode,
    },
    Alteration {
        name: "hum_nm",
        sizes: [20.0, 60.0, 200.0],
        right: &["mains_hum"],
        alter: hum,
    },
    Alteration {
        name: "bent_percent",
        sizes: [0.5, 1.0, 3.0],
        right: &["sensor_nonlinearity"],
        alter: bend,
    },
    Alteration {
        name: "steps_nm",
        sizes: [20.0, 40.0, 100.0],
        right: &["quantisation"],
        alter: round,
    },
    Alteration {
        name: "creep_percent",
        sizes: [1.0, 2.0, 5.0],
        right: &["creep"],
        alter: creep,
    },
    Alteration {
        name: "drift_nm",
        sizes: [100.0, 300.0, 1000.0],
        right: &["thermal_drift"],
        alter: drift,
    },
    Alteration {
        name: "gain_percent",
        sizes: [2.0, 5.0, 10.0],
        right: &["hysteresis", "gain"],
        alter: gain,
    },
];

fn delay(y: &mut [f64], ms: f64) {
    let samples = (ms * 1e-3 * RATE_HZ).round() as usize;
    let before = y.to_vec();
    y.iter_mut()
        .enumerate()
        .for_each(|(k, value)| *value = before[k.saturating_sub(samples)]);
}

/// The reading between two samples is taken as straight.
fn first_order(y: &mut [f64], cutoff_hz: f64) {
    let decay = (-TAU * cutoff_hz / RATE_HZ).exp();
    let per_step = (1.0 - decay) / (TAU * cutoff_hz / RATE_HZ);
    let (mut state, mut before) = (y[0], y[0]);
    for value in y {
        state = decay * state + (1.0 - per_step) * *value + (per_step - decay) * before;
        before = *value;
        *value = state;
    }
}

fn butterworth(y: &mut [f64], cutoff_hz: f64) {
    second_order(y, cutoff_hz, 0.5 * SQRT_2);
}

fn mode(y: &mut [f64], frequency_hz: f64) {
    second_order(y, frequency_hz, 0.05);
}

/// By fine steps of the differential equation.
fn second_order(y: &mut [f64], frequency_hz: f64, damping: f64) {
    const STEPS: usize = 20;
    let (w, dt_s) = (TAU * frequency_hz, 1.0 / RATE_HZ / STEPS as f64);
    let (mut x, mut v, mut before) = (y[0], 0.0, y[0]);
    for value in y {
        for step in 0..STEPS {
            let input = before + (*value - before) * (step as f64 + 0.5) / STEPS as f64;
            v += dt_s * (w * w * (input - x) - 2.0 * damping * w * v);
            x += dt_s * v;
        }
        before = *value;
        *value = x;
    }
}

/// The mains are not quite 50 Hz, and no record begins at a zero of them.
fn hum(y: &mut [f64], nm: f64) {
    let phase = y.len() as f64;
    y.iter_mut().enumerate().for_each(|(k, value)| {
        *value += 1e-3 * nm * (TAU * 50.01 * k as f64 / RATE_HZ + phase).sin()
    });
}

/// A sensor whose gain falls towards both ends by this share of the range.
fn bend(y: &mut [f64], percent: f64) {
    for value in y {
        let x = *value / HALF_RANGE_UM;
        *value += 1e-2 * percent * HALF_RANGE_UM * x * x;
    }
}

fn round(y: &mut [f64], nm: f64) {
    y.iter_mut()
        .for_each(|value| *value = (*value / (1e-3 * nm)).round() * 1e-3 * nm);
}

/// Three more terms of creep, each of this share, on the reading.
fn creep(y: &mut [f64], percent: f64) {
    let clean = y.to_vec();
    for time_s in [0.02, 0.2, 2.0] {
        let decay = (-1.0 / (time_s * RATE_HZ)).exp();
        let mut state = clean[0];
        for (value, clean) in y.iter_mut().zip(&clean) {
            state = decay * state + (1.0 - decay) * clean;
            *value += 1e-2 * percent * state;
        }
    }
}

/// A drift that comes to its end with a time constant of a second from where the record is judged.
fn drift(y: &mut [f64], nm: f64) {
    let from = (FROM_S * RATE_HZ) as usize;
    for (k, value) in y.iter_mut().enumerate().skip(from) {
        *value += 1e-3 * nm * (1.0 - (-((k - from) as f64) / RATE_HZ).exp());
    }
}

fn gain(y: &mut [f64], percent: f64) {
    y.iter_mut()
        .for_each(|value| *value *= 1.0 + 1e-2 * percent);
}

/// A data set of the recordings with other readings, made once; `part` gives from where to where each counts,
/// as shares of what is judged.
fn dataset(
    folder: &Path,
    name: &str,
    alter: &dyn Fn(&mut [f64]),
    part: [f64; 2],
) -> Result<PathBuf, String> {
    let (data, into) = (beside("measured/piezo_stage")?, folder.join(name));
    if into.join("dataset.toml").exists() {
        return Ok(into);
    }
    let mut manifest = format!("name = \"{name}\"\ndrive_min_v = -95.0\ndrive_max_v = 95.0\n");
    for (record, role) in RECORDS {
        let table = NumberTable::read(&data.join(format!("{record}.csv")))?;
        let mut readings_um = table.readings_um();
        alter(&mut readings_um);
        table
            .with_readings(&readings_um)
            .write(&into.join(format!("{record}.csv")))?;
        let whole_s = table.rows.len() as f64 / RATE_HZ - FROM_S;
        let [from_s, to_s] = part.map(|share| FROM_S + share * whole_s);
        let _ = write!(
            manifest,
            "\n[[record]]\nfile = \"{record}.csv\"\nrole = \"{role}\"\ninitial_state = \"unknown\"\nsample_rate_hz = {RATE_HZ:.1}\nfrom_s = {from_s:.4}\nto_s = \
             {to_s:.4}\n"
        );
    }
    write(&into.join("dataset.toml"), &manifest)?;
    Ok(into)
}

/// The recordings as they are.
fn clean(context: &Context) -> Result<PathBuf, String> {
    dataset(&context.folder_of("altered")?, "clean", &|_| {}, [0.0, 1.0])
}

/// Every alteration in every size: name, data set, effects that are right.
fn altered(context: &Context) -> Result<Vec<(String, PathBuf, Vec<String>)>, String> {
    let folder = context.folder_of("altered")?;
    let mut out = Vec::new();
    for alteration in &ALTERATIONS {
        for size in alteration.sizes {
            let name = format!("{}_{size}", alteration.name);
            let data = dataset(&folder, &name, &|y| (alteration.alter)(y, size), [0.0, 1.0])?;
            out.push((
                name,
                data,
                alteration.right.iter().map(|id| (*id).to_owned()).collect(),
            ));
        }
    }
    Ok(out)
}

/// From the model of the clean recordings.
pub fn from_the_model(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let clean = clean(context)?;
    let case = |(name, data, right)| SetCase {
        name,
        data,
        start: CaseStart::ModelOf(clean.clone()),
        check: CaseCheck::Names(CaseTruth::Altered(right, Vec::new())),
        noise_um: None,
    };
    Ok(spread(altered(context)?, most)
        .into_iter()
        .map(case)
        .collect())
}

/// From a bare gain: what the clean recordings themselves need may be named beside.
pub fn from_a_gain(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let own = own_effects(context, &clean(context)?)?;
    let case = |(name, data, right)| {
        SetCase::named(
            name,
            data,
            "gain",
            CaseTruth::Altered(right, own.clone()),
            None,
        )
    };
    Ok(spread(altered(context)?, most)
        .into_iter()
        .map(case)
        .collect())
}

/// The clean recordings from their own model: all of them, and each half.
pub fn unaltered(context: &Context, most: Option<usize>) -> Result<Vec<SetCase>, String> {
    let (folder, model) = (context.folder_of("altered")?, clean(context)?);
    let parts = [
        ("clean", [0.0, 1.0]),
        ("first_half", [0.0, 0.5]),
        ("second_half", [0.5, 1.0]),
    ];
    let case = |(name, part): (&str, [f64; 2])| -> Result<SetCase, String> {
        let data = dataset(&folder, name, &|_| {}, part)?;
        Ok(SetCase {
            name: name.into(),
            data,
            start: CaseStart::ModelOf(model.clone()),
            check: CaseCheck::Names(CaseTruth::Nothing),
            noise_um: None,
        })
    };
    Ok(spread(
        parts.into_iter().map(case).collect::<Result<Vec<_>, _>>()?,
        most,
    ))
}

/// Writes all altered data sets, the model of the clean ones and what counts as right, for other programs.
pub fn write_all(context: &Context, folder: &Path) -> Result<(), String> {
    let mut right = String::new();
    let controls = vec![("nothing_0".to_owned(), clean(context)?, Vec::new())];
    for (name, data, effects) in altered(context)?.into_iter().chain(controls) {
        for file in RECORDS
            .map(|(record, _)| format!("{record}.csv"))
            .iter()
            .map(String::as_str)
            .chain(["dataset.toml"])
        {
            copy(&data.join(file), &folder.join(&name).join(file))?;
        }
        let _ = writeln!(right, "{name} {}", effects.join(","));
    }
    write(&folder.join("right.txt"), &right)?;
    copy(
        &model_of(context, &clean(context)?)?,
        &folder.join("clean_model.toml"),
    )
}
