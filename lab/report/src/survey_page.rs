//! The page of a survey: remainders and values over all recordings first, then what stands out, then a row for
//! each.

use crate::page::{CurveRole, Notes, Page, PageBlock, Plot, Section, Series, Table, Tone, Width};
use hysteron::survey::{Survey, SurveyRow};

/// Most values that are drawn: those of the first effects of the chain.
const DRAWN: usize = 24;
/// The axis of plots over the recordings.
const BY_NAME: &str = "recording, by name";

fn nm(um: Option<f64>) -> String {
    um.map_or_else(|| "-".into(), |um| format!("{:.3}", 1e3 * um))
}

/// The page of a survey; `made_by` is the command.
#[must_use]
pub fn survey_page(survey: &Survey, made_by: String) -> Page {
    let refused = survey.rows.len() - survey.good().count();
    let mut verdicts: Vec<(&str, usize)> = Vec::new();
    for row in survey.good() {
        match verdicts.iter_mut().find(|(word, _)| *word == row.verdict) {
            Some((_, count)) => *count += 1,
            None => verdicts.push((&row.verdict, 1)),
        }
    }
    let verdicts: Vec<String> = (verdicts.iter())
        .map(|(word, count)| format!("{count} {word}"))
        .collect();
    let seconds: f64 = survey.rows.iter().map(|row| row.seconds).sum();
    let calm = survey.outliers.is_empty() && survey.units.is_empty() && refused == 0;
    Page {
        title: "Survey".into(),
        lead_sentence: format!(
            "{} of {} recordings stand out; units that differ: {}; could not be read: {refused}.",
            survey.outliers.len(),
            survey.rows.len(),
            differing_units(survey).len()
        ),
        tone: if calm { Tone::Good } else { Tone::Attention },
        facts: vec![
            ("explained from".into(), survey.effects.join(", ")),
            ("verdicts".into(), verdicts.join(", ")),
            ("time of all".into(), format!("{seconds:.0} s")),
        ],
        sections: vec![values(survey), standing_out(survey), rows(survey)],
        footer: vec![made_by],
        ..Page::default()
    }
}

fn differing_units(survey: &Survey) -> Vec<&str> {
    let mut units: Vec<&str> = survey.units.iter().map(|unit| &*unit.unit).collect();
    units.sort_unstable();
    units.dedup();
    units
}

fn standing_out(survey: &Survey) -> Section {
    let outliers = survey.outliers.iter();
    let units = survey.units.iter().map(|unit| {
        let numbers = [unit.median, unit.others].map(|v| format!("{v:.4}"));
        let [median, others] = numbers;
        let deviations = format!("{:.0}", unit.deviations);
        vec![
            unit.unit.clone(),
            unit.name.clone(),
            median,
            others,
            deviations,
        ]
    });
    let refused: Vec<String> = survey
        .rows
        .iter()
        .filter_map(|row| row.error.clone())
        .collect();
    let notes = (!refused.is_empty()).then(|| {
        PageBlock::Notes(Notes {
            title: "Could not be read".into(),
            items: refused,
            tone: Tone::Attention,
        })
    });
    let tables = [
        PageBlock::Table(Table {
            title: "Recordings".into(),
            columns: ["Recording", "In what"].map(str::to_owned).to_vec(),
            rows: outliers
                .map(|outlier| vec![outlier.recording.clone(), outlier.in_what.join("; ")])
                .collect(),
            ..Table::default()
        }),
        PageBlock::Table(Table {
            title: "Units".into(),
            columns: [
                "Unit",
                "Value",
                "Its median",
                "Median of the others",
                "Standard deviations",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows: units.collect(),
            ..Table::default()
        }),
    ];
    Section {
        heading: "What stands out".into(),
        text: "A recording stands out by a value more than five standard deviations from the median (its own and those of the spread over all), or by a verdict or effects that fewer than one in ten have. A unit is a folder, or a file's name before its last number; it differs by five standard deviations of all others.".into(),
        blocks: tables.into_iter().chain(notes).collect(),
    }
}

fn values(survey: &Survey) -> Section {
    let number = |row: &SurveyRow| {
        let at = survey
            .rows
            .iter()
            .position(|other| other.recording == row.recording);
        at.unwrap_or(0) as f64 + 1.0
    };
    let far = |row: &SurveyRow| survey.outliers.iter().any(|o| o.recording == row.recording);
    let plot = |name: &str, unit: &str, label: &str, points: Vec<(&SurveyRow, f64, f64)>| {
        let series = |title: &str, role: CurveRole, which: bool| {
            let these = points.iter().filter(|(row, ..)| far(row) == which);
            let (x, y) = these.map(|(_, x, y)| (*x, *y)).unzip();
            Series::points(title, role, x, y)
        };
        Plot::new(name.to_owned())
            .x_axis(label, "")
            .y_axis("value", unit)
            .width(Width::Half)
            .with(series("usual", CurveRole::Measured, false))
            .with(series("stands out", CurveRole::Residual, true))
    };
    let of_value = |name: &String, label: &str, at: &dyn Fn(&SurveyRow) -> Option<f64>| {
        let values = survey.values(name);
        let unit = values.first().and_then(|(row, ..)| {
            let value = row.values.iter().find(|value| value.name == *name)?;
            Some(value.unit.clone())
        });
        let points = (values.iter())
            .filter_map(|(row, value, _)| Some((*row, at(row)?, *value)))
            .collect();
        plot(name, unit.as_deref().unwrap_or_default(), label, points)
    };
    let times_noise = survey
        .good()
        .filter_map(|row| Some((row, number(row), row.times_noise?)));
    let remainder = plot("remainder over noise", "", BY_NAME, times_noise.collect());
    let names = survey.names();
    let drawn = names.iter().take(DRAWN);
    let by_number = drawn
        .clone()
        .map(|name| of_value(name, BY_NAME, &|row| Some(number(row))));
    let mut signals: Vec<&String> = survey.good().flat_map(|row| row.means.keys()).collect();
    signals.sort_unstable();
    signals.dedup();
    let (of_value, drawn) = (&of_value, &drawn);
    let by_signal = signals.into_iter().flat_map(|signal| {
        drawn.clone().map(move |name| {
            let mean = |row: &SurveyRow| row.means.get(signal).copied();
            of_value(name, &format!("mean of {signal}"), &mean)
        })
    });
    Section {
        heading: "Remainders and values".into(),
        text: "Recordings stand in the order of their names: names that begin with the date give values over time.".into(),
        blocks: (std::iter::once(remainder).chain(by_number).chain(by_signal))
            .map(PageBlock::Plot)
            .collect(),
    }
}

fn rows(survey: &Survey) -> Section {
    let names = survey.names();
    let fixed = [
        "Recording",
        "Verdict",
        "Named",
        "Remainder, nm",
        "Times the noise",
    ];
    let cells = |row: &SurveyRow| {
        let value = |name: &String| {
            let value = row.values.iter().find(|value| value.name == *name);
            value.map_or_else(|| "-".to_owned(), |value| value.text())
        };
        let verdict = row.error.as_ref().map_or(&*row.verdict, |_| "not read");
        let times = row
            .times_noise
            .map_or_else(|| "-".into(), |times| format!("{times:.2}"));
        [
            row.recording.clone(),
            verdict.to_owned(),
            row.named.join(", "),
            nm(row.remainder_um),
            times,
        ]
        .into_iter()
        .chain(names.iter().map(value))
        .collect::<Vec<String>>()
    };
    let far = |row: &SurveyRow| survey.outliers.iter().any(|o| o.recording == row.recording);
    let highlighted = survey.rows.iter().enumerate().filter(|(_, row)| far(row));
    Section {
        heading: "Every recording".into(),
        text: String::new(),
        blocks: vec![PageBlock::Table(Table {
            columns: fixed
                .map(str::to_owned)
                .into_iter()
                .chain(names.iter().cloned())
                .collect(),
            rows: survey.rows.iter().map(cells).collect(),
            highlighted_rows: highlighted.map(|(i, _)| i).collect(),
            caption: "Values with their standard deviations; what stands out is set off.".into(),
            ..Table::default()
        })],
    }
}
