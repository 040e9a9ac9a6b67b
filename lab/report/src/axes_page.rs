//! The page of a stage with several drives and sensors: what was found in which channel, and the responses of
//! every sensor to every drive.

use crate::page::{CurveRole, Page, PageBlock, Plot, Section, Series, Table, Tone, Width};
use hysteron::several_axes::model_text::AxesFigures;
use hysteron::several_axes::recordings::AxesData;
use hysteron::several_axes::response_matrix::ResponseMatrix;
use hysteron_sim::several_axes::ModalStage;

fn short(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        v if (0.01..1000.0).contains(&v) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}

/// The page of a search.
#[must_use]
pub fn axes_page(
    figures: &AxesFigures,
    data: &AxesData,
    stage: &ModalStage,
    matrix: &ResponseMatrix,
    command: String,
) -> Page {
    let times = if figures.error_in == "noise" {
        format!("{:.2} times the noise", figures.error)
    } else {
        format!("{:.2} % of the readings", 100.0 * figures.error)
    };
    Page {
        title: format!(
            "{}: {} drives, {} sensors",
            figures.name,
            data.drives.len(),
            data.sensors.len()
        ),
        lead_sentence: format!("{}.", figures.sentence),
        tone: Tone::Neutral,
        facts: vec![
            ("parameters".into(), figures.parameters.to_string()),
            ("held-out error".into(), times),
            ("seconds".into(), format!("{:.0}", figures.seconds)),
        ],
        sections: vec![
            effects(figures),
            responses(data, matrix),
            modes(data, stage),
        ],
        footer: vec![command],
        ..Page::default()
    }
}

fn effects(figures: &AxesFigures) -> Section {
    let found = figures.named.iter().map(|effect| {
        vec![
            effect.effect.replace('_', " "),
            effect.channel.clone(),
            short(effect.error_without),
            effect.or.join(" or "),
        ]
    });
    let not_decided = figures.not_decided.iter().map(|named| {
        vec![
            named.clone(),
            "not decided".into(),
            String::new(),
            String::new(),
        ]
    });
    let found = found.chain(not_decided);
    let steps = figures
        .steps
        .iter()
        .map(|step| vec![step.added.clone(), short(step.before), short(step.after)]);
    let sensors = figures.sensors.iter().map(|s| {
        vec![
            s.sensor.clone(),
            short(s.held_out_rms),
            format!("{:.2}", s.held_out_pct),
        ]
    });
    let table = |title: &str, columns: &[&str], rows: Vec<Vec<String>>, caption: &str| {
        PageBlock::Table(Table {
            title: title.into(),
            columns: columns.iter().map(|c| (*c).to_owned()).collect(),
            rows,
            caption: caption.into(),
            ..Table::default()
        })
    };
    let unit = if figures.error_in == "noise" {
        "times the noise"
    } else {
        "of the RMS of the readings"
    };
    Section {
        heading: "What was found".into(),
        text: format!("Errors are RMS on held-out records, {unit}."),
        blocks: vec![
            table(
                "Effects",
                &["Effect", "Channel or mode", "Error without it", "Or"],
                found.collect(),
                "Without an effect everything else is fitted again. Where the last column names another effect, it does as well in its place.",
            ),
            table(
                "How the model grew",
                &["Effect", "Before", "After"],
                steps.collect(),
                "",
            ),
            table(
                "Sensors",
                &["Sensor", "Held-out RMS", "% of its reading"],
                sensors.collect(),
                "",
            ),
        ],
    }
}

fn responses(data: &AxesData, matrix: &ResponseMatrix) -> Section {
    let unit = format!("{}/{}", data.sensor_unit, data.drive_unit);
    let mut blocks = Vec::new();
    for (i, sensor) in data.sensors.iter().enumerate() {
        for (j, drive) in data.drives.iter().enumerate() {
            let line = |label: &str, role: CurveRole, y: &[f64]| {
                Series::line(label, role, matrix.frequency_hz.clone(), y.to_vec())
            };
            blocks.push(PageBlock::Plot(
                Plot::new(format!("{drive} to {sensor}"))
                    .x_axis("frequency", "Hz")
                    .y_axis("response", &unit)
                    .log(true, true)
                    .link("frequency")
                    .width(if data.drives.len() > 2 {
                        Width::Third
                    } else {
                        Width::Half
                    })
                    .with(line(
                        "measured",
                        CurveRole::Measured,
                        &matrix.measured[i][j],
                    ))
                    .with(line("modelled", CurveRole::Model, &matrix.modelled[i][j])),
            ));
        }
    }
    Section {
        heading: "Responses".into(),
        text: "Measured and modelled readings go through the same estimate. A response that is below the noise of its sensor shows that noise."
            .into(),
        blocks,
    }
}

fn modes(data: &AxesData, stage: &ModalStage) -> Section {
    let mut columns = vec![
        "Natural frequency, Hz".to_owned(),
        "Damping ratio".to_owned(),
    ];
    columns.extend(data.drives.iter().map(|drive| format!("of {drive}")));
    columns.extend(data.sensors.iter().map(|sensor| format!("of {sensor}")));
    let row = |mode: &hysteron_sim::several_axes::StageMode| {
        let shares = mode
            .of_drives
            .iter()
            .chain(&mode.of_sensors)
            .map(|share| short(*share));
        [
            format!("{:.2}", mode.frequency_hz),
            format!("{:.4}", mode.damping_ratio),
        ]
        .into_iter()
        .chain(shares)
        .collect()
    };
    Section {
        heading: "Modes".into(),
        text: "Participations of drives are relative to the drive with which the mode was found."
            .into(),
        blocks: vec![PageBlock::Table(Table {
            columns,
            rows: stage.modes.iter().map(row).collect(),
            ..Table::default()
        })],
    }
}
