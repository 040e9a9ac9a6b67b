//! `stepping`.

use crate::arguments::{Outputs, as_typed};
use crate::desk::Desk;
use crate::read_arguments::ReadArguments;
use hysteron::dataset::Role;
use hysteron::servo::amplifier_block::{FrontEnd, block};
use hysteron::servo::stepping_contact::{IdentifiedContact, identify_contact, rig_on_platform};
use hysteron::servo::stepping_design::{SteppingDesign, SteppingOrder};
use hysteron::servo::stepping_load::load_that_stops;
use hysteron::servo::stepping_rig;
use hysteron::stepping::{Measured, SteppingMeasure, SteppingTrain, measure};
use hysteron::{Dataset, Error, Policy, Result};
use hysteron_report::stepping_page;
use serde::Serialize;
use std::path::{Path, PathBuf};

fn figure(figure: Measured, unit: &str) -> String {
    format!("{:.4} ± {:.4} {unit}", figure.value, figure.std)
}

fn print_train(train: &SteppingTrain) {
    println!(
        "  {} from {:.3} s: {} saw-teeth of {:.1} V at {:.2} Hz, {} counted",
        train.record,
        train.from_s,
        train.teeth,
        train.amplitude_v,
        train.frequency_hz,
        train.counted
    );
    println!(
        "    velocity {}, step {}, scatter {}, backward {}",
        figure(train.velocity_um_s, "um/s"),
        figure(train.step_um, "um"),
        figure(train.scatter_um, "um"),
        figure(train.backward_um, "um")
    );
    if let Some(stop) = &train.stop {
        println!(
            "    stop: swing {}, settles in {:.2} ms",
            figure(stop.swing_um, "um"),
            1e3 * stop.settling_s
        );
    }
}

/// What is known of a rig, so that its contact can be identified.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct RigArguments {
    /// Model of the platform, recorded without the slider: identifies the contact beside the measure
    #[arg(long, value_name = "MODEL", requires_all = ["slider_kg", "platform_stiffness_n_um"])]
    platform: Option<PathBuf>,
    /// Mass of the slider
    #[arg(long, value_name = "KG", requires = "platform")]
    slider_kg: Option<f64>,
    /// Stiffness of the piezo with the platform
    #[arg(long, value_name = "N/UM", requires = "platform")]
    platform_stiffness_n_um: Option<f64>,
    /// Writes the rig that was identified: `hysteron board emulate --stick-slip` stands in front of it
    #[arg(long, value_name = "FILE", requires = "platform")]
    rig: Option<PathBuf>,
    /// Writes the parameter block of a board that drives it
    #[arg(long, value_name = "FILE", requires = "platform")]
    block: Option<PathBuf>,
    /// How its converters are wired; the sensor's codes are counts of the encoder about zero [default: 1 nm a
    /// count, -20 to 120 V]
    #[arg(long, value_name = "FILE", requires = "block")]
    front_end: Option<PathBuf>,
    /// Ends of the travel from where the board zeroes it [default: -12000 12000]
    #[arg(
        long,
        value_name = "UM",
        num_args = 2,
        allow_negative_numbers = true,
        requires = "block"
    )]
    travel_um: Option<Vec<f64>>,
}

/// What `stepping --json` carries.
#[derive(Serialize)]
struct SteppingFigures<'a> {
    #[serde(flatten)]
    found: &'a SteppingMeasure,
    #[serde(skip_serializing_if = "Option::is_none")]
    contact: Option<IdentifiedContact>,
    /// Force on the slider that stops the fastest teeth.
    #[serde(skip_serializing_if = "Option::is_none")]
    load_that_stops_n: Option<Measured>,
}

fn above_zero(option: &str, value: Option<f64>) -> Result<f64> {
    let value = value.unwrap_or(0.0);
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(Error::new(option, format!("{value}; expected above 0")))
    }
}

/// The wiring and the travel that were specified.
fn stepping_order(desk: &Desk, rig: &RigArguments) -> Result<SteppingOrder> {
    let mut order = SteppingOrder::default();
    if let Some(path) = &rig.front_end {
        let text = desk.text(path, "the wiring of converters")?;
        order.front_end = FrontEnd::from_toml(&text, &path.display().to_string())?;
    }
    if let Some([low, high]) = rig.travel_um.as_deref() {
        order.travel_um = [*low, *high];
    }
    Ok(order)
}

/// The values of a contact in words.
fn contact_values(found: &IdentifiedContact) -> Vec<String> {
    let value = |name: &str, unit: &str, scale: f64, value: Measured| {
        let figure = figure(value.times(scale), unit);
        format!("{name} {}", figure.trim_end())
    };
    let of_some = [
        ("break-away ratio", "", 1.0, found.breakaway_ratio),
        ("Stribeck share", "", 1.0, found.stribeck_share),
        (
            "Stribeck velocity",
            "um/s",
            1.0,
            found.stribeck_velocity_um_s,
        ),
        ("viscosity", "N s/m", 1e6, found.contact_viscosity_n_s_um),
    ];
    let of_all = [
        ("Coulomb force", "mN", 1e3, Some(found.coulomb_force_n)),
        ("stiffness", "N/um", 1.0, Some(found.stiffness_n_um)),
        ("damping", "N s/mm", 1e3, Some(found.damping_n_s_um)),
    ];
    let values = of_all.into_iter().chain(of_some);
    values
        .filter_map(|(name, unit, scale, figure)| Some(value(name, unit, scale, figure?)))
        .collect()
}

/// Identifies the contact and prints it, with the teeth that suit the rig.
fn contact(
    desk: &Desk,
    dataset: &Dataset,
    rig: &RigArguments,
    noise_um: Option<f64>,
) -> Result<(Option<IdentifiedContact>, Option<Measured>)> {
    let Some(platform) = &rig.platform else {
        return Ok((None, None));
    };
    let stiffness = above_zero("--platform-stiffness-n-um", rig.platform_stiffness_n_um)?;
    let mass_kg = above_zero("--slider-kg", rig.slider_kg)?;
    let mut known = rig_on_platform(&desk.model(platform)?, stiffness, mass_kg)
        .map_err(|m| Error::new(platform.display(), m))?;
    // A single file is two records of one tape, and its rest.
    let mut moving = dataset.records.iter().filter(|r| r.role != Role::Noise);
    let Some(tape) = moving.next() else {
        return Err(Error::new(&dataset.source, "no record moves"));
    };
    let (drive_v, rate_hz) = (&tape.drive_v, tape.sample_rate_hz);
    let found = identify_contact(&known, drive_v, &tape.displacement_um, rate_hz)
        .map_err(|m| Error::new(&tape.source, m))?;
    println!(
        "  contact: {}; it leaves {:.2} nm",
        contact_values(&found).join(", "),
        1e3 * found.residual_um
    );
    if let Some(times) = noise_um.map(|noise| found.residual_um / noise)
        && times > Policy::default().explained
    {
        println!(
            "  note: that is {times:.1} times the noise, so the deviations above are too small. `hysteron explain` with this rig (--rig FILE, then \
             --from FILE) says what it misses; check also that {} is the model of this platform",
            platform.display()
        );
    }
    known = found.on(&known);
    if let Some(path) = &rig.rig {
        desk.write(path, stepping_rig::to_toml(&known)?.as_bytes())?;
    }
    let order = stepping_order(desk, rig)?;
    let mut load = None;
    match SteppingDesign::new(&known, &order) {
        Ok(design) => {
            println!(
                "  fastest saw-teeth of {:.0} to {:.0} V at {:.0} V/ms: slow flank {:.1} ms with curvature {}, {:.2} um a step, {:.0} um/s",
                design.tooth.ends_v[0],
                design.tooth.ends_v[1],
                1e-3 * order.front_end.slew_v_s,
                1e3 * design.tooth.slow_s,
                design.tooth.curvature,
                design.tooth.step_um,
                design.tooth.velocity_um_s()
            );
            load = load_that_stops(&known, &found, &design.tooth, order.front_end.period_s());
            if let Some(load) = load {
                println!("  load that stops them: {}", figure(load.times(1e3), "mN"));
            }
            if let Some(path) = &rig.block {
                desk.write(path, &block(&design.block()?)?)?;
            }
        }
        Err(reason) if rig.block.is_some() => return Err(Error::new("stepping servo", reason)),
        Err(reason) => println!("  no stepping servo: {reason}"),
    }
    Ok((Some(found), load))
}

/// Measures the performance of a stick-slip drive from a recording.
pub fn stepping(
    path: &Path,
    rig: &RigArguments,
    reading: &ReadArguments,
    outputs: &Outputs,
) -> Result<bool> {
    let desk = Desk::new(outputs.force);
    let dataset = desk.dataset(path, reading)?;
    outputs.check(&desk)?;
    desk.target(rig.rig.as_deref())?;
    desk.target(rig.block.as_deref())?;
    let found = measure(&dataset)?;
    let noise = found.noise_um.map_or_else(
        || "no rest shows the sensor's noise, so the scatter holds it".to_owned(),
        |um| format!("noise of the sensor {:.2} nm", 1e3 * um),
    );
    println!(
        "{}: {} trains of saw-teeth; {noise}",
        found.name,
        found.trains.len()
    );
    found.trains.iter().for_each(print_train);
    let (contact, load_that_stops_n) = contact(&desk, &dataset, rig, found.noise_um)?;
    let figures = SteppingFigures {
        found: &found,
        contact,
        load_that_stops_n,
    };
    desk.write_json(outputs.json.as_deref(), &figures)?;
    desk.write_page(outputs.report.as_deref(), || {
        stepping_page(&found, &dataset, as_typed())
    })?;
    Ok(true)
}
