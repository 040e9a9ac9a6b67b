//! `board tune`: from an empty board to a running servo, with a report of all that was found on the way.

use super::connection::{LineArguments, WiringArguments, as_ours};
use super::record::{bring_wiring, names, play_all, require_room, write};
use crate::arguments::as_typed;
use crate::desk::Desk;
use crate::progress::Progress;
use crate::read_arguments::ReadArguments;
use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::model_file::effects_named;
use hysteron::servo::amplifier_block::{FrontEnd, amplifier_parameters, block, wiring_parameters};
use hysteron::servo::check;
use hysteron::servo::check::CheckResult;
use hysteron::servo::design::ServoDesign;
use hysteron::servo::order::{self, DesignOrder};
use hysteron::statistics::{extremes, mean};
use hysteron::synthetic::drives::board_drives;
use hysteron::{Dataset, Error, Result};
use hysteron_client::board::Board;
use hysteron_client::playing::{Wave, listen, play};
use hysteron_client::scale::Scale;
use hysteron_core::codes::SensorCode;
use hysteron_core::reference_window::PREVIEW_TICKS;
use hysteron_report::servo_words as words;
use hysteron_report::{
    CurveRole, Page, PageBlock, Plot, Section, Series, Tone, explain_page, explain_report, nyquist,
    sensitivity, trade_off,
};
use serde::Serialize;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

/// Effects that a search begins with: what a servo needs. A first rise is not among them, the conditioning
/// has taken it.
const BEGIN_WITH: &str = "hysteresis,vibration,creep";
/// The error of the position that is accepted, over the noise of the sensor.
const ACCEPTED: f64 = 1.3;
/// Samples at rest on a reference.
const SAMPLES_ON_REFERENCE: usize = 8000;
/// The sine that is followed: ticks of a period, periods, and its height as a share of the travel.
const SINE_TICKS: usize = 2000;
const SINE_PERIODS: u32 = 4;
const SINE_SHARE: f64 = 0.2;
/// A servo that has not settled after so many ticks does not: 5 s.
const MOST_TICKS_OF_A_MOVE: f64 = 100_000.0;
/// Velocity of the way to a reference, as a share of the travel in a second.
const VELOCITY_SHARE: f64 = 4.0;

/// An error of the closed loop, um.
#[derive(Clone, Debug, Serialize)]
struct Followed {
    /// RMS as the sensor reads it, its noise included.
    rms_um: f64,
    /// RMS of the position itself. What the sensor adds to a reading the servo has not seen yet when the
    /// reading is taken, so that it is not in the position there, and the squares add.
    of_position_um: f64,
    /// Mean.
    mean_um: f64,
    /// Largest magnitude.
    max_um: f64,
    /// RMS of the position over the noise of the sensor.
    over_noise: f64,
    #[serde(skip)]
    time_s: Vec<f64>,
    #[serde(skip)]
    reference_um: Vec<f64>,
    #[serde(skip)]
    position_um: Vec<f64>,
    #[serde(skip)]
    sensor_codes: Vec<SensorCode>,
}

impl Followed {
    fn new(
        sample_rate_hz: f64,
        reference_um: Vec<f64>,
        position_um: Vec<f64>,
        sensor_codes: Vec<SensorCode>,
        noise_um: f64,
    ) -> Self {
        let errors: Vec<f64> = position_um
            .iter()
            .zip(&reference_um)
            .map(|(y, r)| y - r)
            .collect();
        let rms_um =
            (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt();
        let of_position_um = (rms_um * rms_um - noise_um * noise_um).max(0.0).sqrt();
        Self {
            rms_um,
            of_position_um,
            mean_um: mean(&errors),
            max_um: errors.iter().map(|e| e.abs()).fold(0.0, f64::max),
            over_noise: of_position_um / noise_um,
            time_s: (0..errors.len())
                .map(|k| k as f64 / sample_rate_hz)
                .collect(),
            reference_um,
            position_um,
            sensor_codes,
        }
    }
}

/// What `tune.json` holds.
#[derive(Serialize)]
struct Tuned<'a> {
    schema: &'static str,
    board: &'a str,
    verdict: &'a str,
    effects: Vec<String>,
    noise_um: f64,
    reference_um: f64,
    on_reference: &'a Followed,
    sine_hz: f64,
    sine_amplitude_um: f64,
    on_sine: &'a Followed,
    accepted_over_noise: f64,
    scale: ScaleFigures,
    check: &'a CheckResult,
    design: &'a ServoDesign,
}

/// Codes in um, after the last conditioning.
#[derive(Serialize)]
struct ScaleFigures {
    sensor_at_code_0_um: f64,
    sensor_span_um: f64,
}

/// What is known once the servo has been designed.
struct Designed {
    found: Outcome,
    dataset: Dataset,
    noise_um: f64,
    travel_um: f64,
    design: ServoDesign,
    check: CheckResult,
    block: Vec<u8>,
}

/// What is asked of the servo.
pub struct TuneRequest {
    /// Highest frequency of references, Hz.
    pub reference_hz: f64,
    /// Bandwidth of the sensor, Hz.
    pub sensor_bandwidth_hz: Option<f64>,
}

/// The whole way.
pub fn tune(
    out: &Path,
    wiring: &WiringArguments,
    wanted: &TuneRequest,
    line: &LineArguments,
    force: bool,
) -> Result<bool> {
    let desk = Desk::new(force);
    let front_end = wiring.front_end(&desk)?;
    let (low_v, high_v) = wiring.limits_v()?;
    let empty = block(&wiring_parameters(&front_end, low_v, high_v)?)?;
    let recording = out.join("record");
    let drives = board_drives(low_v, high_v);
    let files = [
        "model.toml",
        "servo.toml",
        "servo.block",
        "on_reference.csv",
        "report.html",
        "tune.json",
    ];
    desk.folder_to_be(out, &files.map(String::from))?;
    if recording.exists() {
        desk.folder_to_be(&recording, &names(&drives))?;
    }
    order::reasonable_frequency(wanted.reference_hz, front_end.period_s())
        .map_err(|problem| Error::new("--reference-hz", problem))?;
    order::reasonable_bandwidth(wanted.sensor_bandwidth_hz, front_end.period_s())
        .map_err(|problem| Error::new("--sensor-bandwidth-hz", problem))?;
    let mut board = line.connect()?;
    desk.make_folder(out)?;
    desk.make_folder(&recording)?;

    println!("{}", board.identification);
    bring_wiring(&mut board, &empty, line)?;
    require_room(&Scale::ask(&mut board).map_err(as_ours)?, &drives)?;
    println!("conditioning");
    board.condition().map_err(as_ours)?;
    let records = play_all(&mut board, &drives)?;
    let scale = Scale::ask(&mut board).map_err(as_ours)?;
    write(&desk, &recording, &scale, &drives, &records)?;

    let designed = design(&desk, &recording, &front_end, wanted)?;
    desk.write_model(
        Some(&out.join("model.toml")),
        &designed.found.model,
        &designed.dataset.name,
    )?;
    let servo = toml::to_string_pretty(&designed.design)
        .map_err(|problem| Error::new("servo.toml", problem))?;
    desk.write(&out.join("servo.toml"), servo.as_bytes())?;
    desk.write(&out.join("servo.block"), &designed.block)?;
    if !designed.check.stable {
        return Err(Error::new(
            "check",
            "the loop is not stable on the model; the block was not brought",
        ));
    }

    println!("bringing the block");
    hysteron_client::upload::upload(&mut board, &designed.block, line.baud()).map_err(as_ours)?;
    println!("conditioning");
    board.condition().map_err(as_ours)?;
    let scale = Scale::ask(&mut board).map_err(as_ours)?;
    let (reference_um, on_reference, on_sine) = verify(&mut board, &scale, &designed)?;
    let good = on_reference.over_noise <= ACCEPTED;
    let verdict = verdict(&on_reference, &on_sine, &designed, good);
    println!("{verdict}");
    desk.write(
        &out.join("on_reference.csv"),
        csv(&on_reference)?.as_bytes(),
    )?;
    let tuned = Tuned {
        schema: "hysteron.tune/1",
        board: &board.identification,
        verdict: &verdict,
        effects: designed.found.model.effect_ids(),
        noise_um: designed.noise_um,
        reference_um,
        on_reference: &on_reference,
        sine_hz: scale.sample_rate_hz / SINE_TICKS as f64,
        sine_amplitude_um: 0.5 * SINE_SHARE * designed.travel_um,
        on_sine: &on_sine,
        accepted_over_noise: ACCEPTED,
        scale: ScaleFigures {
            sensor_at_code_0_um: scale.sensor_at_code_0_um,
            sensor_span_um: scale.sensor_span_um,
        },
        check: &designed.check,
        design: &designed.design,
    };
    desk.write_json(Some(&out.join("tune.json")), &tuned)?;
    desk.write_page(Some(&out.join("report.html")), || {
        page(&designed, &on_reference, &on_sine, &verdict, good)
    })?;
    println!(
        "the servo is on at {reference_um:.3} um; all of it is in {}",
        out.join("report.html").display()
    );
    Ok(good)
}

/// From the recording to the block.
fn design(
    desk: &Desk,
    recording: &Path,
    front_end: &FrontEnd,
    wanted: &TuneRequest,
) -> Result<Designed> {
    let dataset = desk.dataset(recording, &ReadArguments::default())?;
    let progress = Progress::of_search(false);
    let found = analyse(
        &dataset,
        Start::Effects(&effects_named(BEGIN_WITH)?),
        &Options::default(),
        &progress,
    )?;
    drop(progress);
    let dataset = found.dataset(&dataset).clone();
    println!("{}", found.diagnosis.sentence);
    let noise_um = found
        .floor
        .rms_um
        .ok_or_else(|| Error::new("recording", "shows no noise of the sensor"))?;
    let TuneRequest {
        reference_hz,
        sensor_bandwidth_hz,
    } = *wanted;
    let order = DesignOrder {
        reference_hz,
        sensor_bandwidth_hz,
        recording: Some(&dataset),
        front_end: Some(front_end),
        ..DesignOrder::default()
    };
    let design =
        order::design(&found.model, &order).map_err(|problem| Error::new("design", problem))?;
    for line in &design.explanation {
        println!("  {line}");
    }
    let check = check::check_with(&design, &found.model, Some(&dataset))
        .map_err(|problem| Error::new("check", problem))?;
    let block = block(&amplifier_parameters(&design, front_end)?)?;
    let (lowest_um, highest_um) = dataset
        .records
        .iter()
        .map(|record| extremes(&record.displacement_um))
        .fold((f64::MAX, f64::MIN), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    Ok(Designed {
        found,
        noise_um,
        travel_um: highest_um - lowest_um,
        design,
        check,
        block,
        dataset,
    })
}

/// How a sensor reads a sine.
#[derive(Clone, Copy)]
struct Late {
    /// Of the amplitude.
    share: f64,
    /// Of the phase.
    angle_rad: f64,
}

impl Late {
    /// As it is.
    const NOT: Self = Self {
        share: 1.0,
        angle_rad: 0.0,
    };

    /// The lag that the servo undoes is in the reading and not in the position: what is read is compared with
    /// what the sensor then reads of the reference.
    fn of(lag_s: Option<f64>, frequency_rad_s: f64) -> Self {
        let angle_rad = (frequency_rad_s * lag_s.unwrap_or(0.0)).atan();
        Self {
            share: angle_rad.cos(),
            angle_rad,
        }
    }
}

/// Closes the loop, goes to the middle and looks, follows a sine and looks, and stays in the middle. Returns
/// where that is.
fn verify(
    board: &mut Board,
    scale: &Scale,
    designed: &Designed,
) -> Result<(f64, Followed, Followed)> {
    let Designed {
        noise_um,
        travel_um,
        ..
    } = *designed;
    let middle_um = (500.0 * travel_um).round() / 1000.0;
    println!("closing the loop");
    board
        .tell_all(&[
            "SVO 1 1".to_string(),
            format!("VEL 1 {:.3}", VELOCITY_SHARE * travel_um),
        ])
        .map_err(as_ours)?;
    go(board, middle_um)?;
    let stays = listen(board, scale, 1, SAMPLES_ON_REFERENCE).map_err(as_ours)?;
    let reference = vec![middle_um; stays.position_um.len()];
    let on_reference = Followed::new(
        stays.sample_rate_hz,
        reference,
        stays.position_um,
        stays.sensor_codes,
        noise_um,
    );
    let amplitude_um = 0.5 * SINE_SHARE * travel_um;
    let sine = |late: Late| {
        move |tick: usize| {
            middle_um
                + amplitude_um
                    * late.share
                    * (TAU * tick as f64 / SINE_TICKS as f64 - late.angle_rad).sin()
        }
    };
    let wave = Wave {
        points: (0..SINE_TICKS).map(sine(Late::NOT)).collect(),
        ticks_per_point: 1,
        cycles: SINE_PERIODS,
    };
    let follows = play(board, scale, &wave).map_err(as_ours)?;
    // The record begins two ticks behind the first point, which counts after the window that the servo looks
    // ahead.
    let from = SINE_TICKS;
    let read = sine(Late::of(
        designed.design.sensor_lag_s,
        TAU * stays.sample_rate_hz / SINE_TICKS as f64,
    ));
    let reference = (from..follows.position_um.len())
        .map(|k| read(k + 2 + SINE_TICKS - PREVIEW_TICKS))
        .collect();
    let rest = |values: Vec<f64>| values.into_iter().skip(from).collect::<Vec<f64>>();
    let codes = follows.sensor_codes.into_iter().skip(from).collect();
    let on_sine = Followed::new(
        follows.sample_rate_hz,
        reference,
        rest(follows.position_um),
        codes,
        noise_um,
    );
    go(board, middle_um)?;
    Ok((middle_um, on_reference, on_sine))
}

/// Moves to a position and waits until it is there, or for so many ticks of the board that it never will be.
fn go(board: &mut Board, position_um: f64) -> Result<()> {
    board
        .tell(&format!("MOV 1 {position_um:.6}"))
        .map_err(as_ours)?;
    let mut begin = None;
    loop {
        let state = board.numbers("DIA? 1 10").map_err(as_ours)?;
        let [mode, tick] = state[..] else {
            return Err(Error::new("DIA?", "the board answers something else"));
        };
        if mode != 2.0 {
            return Err(Error::new(
                "MOV",
                "a fault has opened the loop; `hysteron board status` names it",
            ));
        }
        if board.number("ONT? 1").map_err(as_ours)? == 1.0 {
            return Ok(());
        }
        if tick - *begin.get_or_insert(tick) > MOST_TICKS_OF_A_MOVE {
            return Err(Error::new(
                "MOV",
                format!(
                    "the servo does not settle at {position_um:.3} um; it is still on, `hysteron board send STP` ends it"
                ),
            ));
        }
    }
}

fn verdict(on_reference: &Followed, on_sine: &Followed, designed: &Designed, good: bool) -> String {
    let kept = if good { "keeps" } else { "does NOT keep" };
    format!(
        "The servo {kept} its reference: the position is {:.2} nm RMS off, {:.2} times the sensor's noise of {:.2} nm ({ACCEPTED} are accepted), on a sine {:.2} nm. The sensor reads {:.2} and {:.2} nm, its noise included.",
        1e3 * on_reference.of_position_um,
        on_reference.over_noise,
        1e3 * designed.noise_um,
        1e3 * on_sine.of_position_um,
        1e3 * on_reference.rms_um,
        1e3 * on_sine.rms_um
    )
}

fn csv(followed: &Followed) -> Result<String> {
    let mut text = String::from("t_s,reference_um,y_um,sensor_code\n");
    let rows = followed
        .time_s
        .iter()
        .zip(&followed.reference_um)
        .zip(&followed.position_um)
        .zip(&followed.sensor_codes);
    for (((t, r), y), code) in rows {
        writeln!(text, "{t:.6},{r:.7},{y:.7},{code}")
            .map_err(|problem| Error::new("on_reference.csv", problem))?;
    }
    Ok(text)
}

/// The closed loop in two plots.
fn plots(name: &str, followed: &Followed) -> [PageBlock; 2] {
    let error_nm = followed
        .position_um
        .iter()
        .zip(&followed.reference_um)
        .map(|(y, r)| 1e3 * (y - r))
        .collect();
    let time = followed.time_s.clone();
    [
        PageBlock::Plot(
            Plot::new(name)
                .x_axis("time", "s")
                .y_axis("position", "um")
                .with(Series::line(
                    "reference",
                    CurveRole::Reference,
                    time.clone(),
                    followed.reference_um.clone(),
                ))
                .with(Series::line(
                    "sensor",
                    CurveRole::Measured,
                    time.clone(),
                    followed.position_um.clone(),
                )),
        ),
        PageBlock::Plot(
            Plot::new(format!("{name}: error"))
                .x_axis("time", "s")
                .y_axis("error", "nm")
                .with(Series::line(
                    "sensor minus reference",
                    CurveRole::Residual,
                    time,
                    error_nm,
                )),
        ),
    ]
}

/// The one report: the closed loop, the servo, and the model behind it.
fn page(
    designed: &Designed,
    on_reference: &Followed,
    on_sine: &Followed,
    verdict: &str,
    good: bool,
) -> Page {
    let Designed {
        found,
        dataset,
        design,
        check,
        ..
    } = designed;
    let model = explain_page(&explain_report(found, dataset, as_typed()));
    let margins = check.margins.as_ref();
    let of_loop = margins
        .map(|m| vec![PageBlock::Plot(sensitivity(m)), PageBlock::Plot(nyquist(m))])
        .unwrap_or_default();
    let said = margins.map(words::margins).unwrap_or_default();
    let mut sections = vec![
        Section {
            heading: "The servo at work on the board".into(),
            text: "Read by the sensor, its noise included; recorded by the board while the loop was closed.".into(),
            blocks: plots("On a reference", on_reference).into_iter().chain(plots("On a sine", on_sine)).collect(),
        },
        Section {
            heading: "Why this servo".into(),
            text: design.explanation.join("\n\n"),
            blocks: vec![PageBlock::Plot(trade_off(design))],
        },
        Section {
            heading: "The loop, checked on the model".into(),
            text: said.iter().chain(&check.remarks).cloned().collect::<Vec<_>>().join("\n\n"),
            blocks: of_loop,
        },
    ];
    sections.extend(model.sections);
    let sentence = ("The model behind it".to_string(), model.lead_sentence);
    Page {
        title: "From a board to a servo".into(),
        lead_sentence: verdict.into(),
        tone: if good { Tone::Good } else { Tone::Attention },
        facts: std::iter::once(sentence).chain(model.facts).collect(),
        sections,
        ..model
    }
}
