//! The page of a stick-slip drive's performance: figures of every train of saw-teeth, velocity over amplitude
//! and frequency, the mean period, and the recording.

use crate::page::{CurveRole, Page, PageBlock, Plot, Section, Series, Table, Width};
use hysteron::Dataset;
use hysteron::stepping::{Measured, SteppingMeasure, SteppingTrain};

fn figure(figure: Measured) -> String {
    format!("{:.4} ± {:.4}", figure.value, figure.std)
}

/// The page of what was measured; `made_by` is the command.
#[must_use]
pub fn stepping_page(found: &SteppingMeasure, dataset: &Dataset, made_by: String) -> Page {
    let fastest = found
        .trains
        .iter()
        .map(|train| train.velocity_um_s)
        .max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()))
        .unwrap_or_default();
    let noise = found
        .noise_um
        .map_or_else(|| "unknown".into(), |um| format!("{:.2} nm RMS", 1e3 * um));
    Page {
        title: format!("{}: stick-slip drive", found.name),
        lead_sentence: format!("The fastest train travels {} um/s.", figure(fastest)),
        facts: vec![
            ("trains".into(), found.trains.len().to_string()),
            ("noise of the sensor".into(), noise),
        ],
        sections: vec![trains(found), curves(found), recording(dataset)],
        footer: vec![made_by],
        ..Page::default()
    }
}

fn trains(found: &SteppingMeasure) -> Section {
    let row = |train: &SteppingTrain| {
        let stop = train.stop.as_ref();
        vec![
            format!("{}, {:.3} s", train.record, train.from_s),
            format!("{:.2}", train.frequency_hz),
            format!("{:.1}", train.amplitude_v),
            figure(train.velocity_um_s),
            figure(train.step_um),
            figure(train.scatter_um),
            figure(train.backward_um),
            stop.map_or_else(|| "-".into(), |stop| figure(stop.swing_um)),
            stop.map_or_else(
                || "-".into(),
                |stop| format!("{:.2}", 1e3 * stop.settling_s),
            ),
        ]
    };
    Section {
        heading: "Trains of saw-teeth".into(),
        text: "Every figure stands beside its standard deviation. The first third of each train is left out.".into(),
        blocks: vec![PageBlock::Table(Table {
            columns: [
                "Train",
                "Frequency, Hz",
                "Amplitude, V",
                "Velocity, um/s",
                "Step, um",
                "Scatter, um",
                "Backward, um",
                "Swing at the stop, um",
                "Settles in, ms",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows: found.trains.iter().map(row).collect(),
            ..Table::default()
        })],
    }
}

/// Points of one value each over another.
fn over(
    found: &SteppingMeasure,
    title: &str,
    [label, unit]: [&str; 2],
    at: impl Fn(&SteppingTrain) -> f64,
) -> PageBlock {
    let (x, y) = found
        .trains
        .iter()
        .map(|t| (at(t), t.velocity_um_s.value))
        .unzip();
    PageBlock::Plot(
        Plot::new(title)
            .x_axis(label, unit)
            .y_axis("velocity", "um/s")
            .width(Width::Third)
            .with(Series::points("trains", CurveRole::Measured, x, y)),
    )
}

fn curves(found: &SteppingMeasure) -> Section {
    const ROLES: [CurveRole; 4] = [
        CurveRole::Other1,
        CurveRole::Other2,
        CurveRole::Other3,
        CurveRole::Other4,
    ];
    let mut periods = Plot::new("Mean period")
        .x_axis("share of the period", "")
        .y_axis("travel", "um")
        .width(Width::Third);
    for (train, role) in found.trains.iter().zip(ROLES.into_iter().cycle()) {
        let y = train.mean_period_um.clone();
        let x = (0..y.len())
            .map(|k| k as f64 / (y.len() - 1).max(1) as f64)
            .collect();
        let label = format!("{:.0} V, {:.0} Hz", train.amplitude_v, train.frequency_hz);
        periods = periods.with(Series::line(label, role, x, y));
    }
    Section {
        heading: "Velocity and travel".into(),
        text: "The mean period shows how far the slider rides along, and how far the fast flank takes it back.".into(),
        blocks: vec![
            over(found, "Velocity over frequency", ["frequency", "Hz"], |t| t.frequency_hz),
            over(found, "Velocity over amplitude", ["amplitude", "V"], |t| t.amplitude_v),
            PageBlock::Plot(periods),
        ],
    }
}

fn recording(dataset: &Dataset) -> Section {
    let mut blocks = Vec::new();
    for record in &dataset.records {
        let t: Vec<f64> = (record.window.clone())
            .map(|k| k as f64 / record.sample_rate_hz)
            .collect();
        let plots = [
            ("drive", "V", CurveRole::Drive, &record.drive_v),
            (
                "position",
                "um",
                CurveRole::Measured,
                &record.displacement_um,
            ),
        ];
        for (label, unit, role, signal) in plots {
            blocks.push(PageBlock::Plot(
                Plot::new(format!("{}: {label}", record.name))
                    .x_axis("time", "s")
                    .y_axis(label, unit)
                    .link(&record.name)
                    .width(Width::Half)
                    .with(Series::line(
                        label,
                        role,
                        t.clone(),
                        signal[record.window.clone()].to_vec(),
                    )),
            ));
        }
    }
    Section {
        heading: "Recording".into(),
        blocks,
        ..Section::default()
    }
}
