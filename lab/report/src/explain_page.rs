//! The page of an explanation: a sentence, where the model fails, the evidence for the named effect, the
//! falling error, and everything beside it.
//!
//! The record and the step of the model's growth are chosen in the bar at the top; each plot holds its curves
//! for all choices and shows the matching ones. All curves of a record share one set of kept samples, so that
//! equal columns (time, drive, a residual seen in several plots) are stored once.

use super::decimate::extreme_indices;
use super::evidence::evidence_plots;
use super::explain_report::{CandidateReport, ExplainReport, StepReport};
use super::page::{
    CurveRole, HeatMap, HeatMapLayer, Level, Notes, Page, PageBlock, Plot, Section, Selector,
    Series, Style, Table, Tone, Waterfall, WaterfallStep, When, Width,
};
use super::text::{Significant, effect_words, figure, nanometres, percent, role_words};
use hysteron::diagnosis::residual_map::{
    Branch, DriveFeature, branches, drive_features, residual_by_feature,
};
use hysteron::engineering::rounded;
use hysteron::spectrum::amplitude_density;

const RECORD: &str = "record";
const STEP: &str = "step";
/// Numbers that all sample-by-sample columns of a page may hold together; keeps a page below 3 MB.
const NUMBERS_PER_PAGE: usize = 650_000;

/// An excess over the noise below this share is not worth a word.
const MATTERS: f64 = 0.1;
/// Deviations that the largest of a hundred cells stays below by chance.
const CHANCE_DEVIATIONS: f64 = 4.0;

/// Builds the page.
pub fn explain_page(report: &ExplainReport) -> Page {
    let kept = KeptSamples::of(report);
    let mut sections = vec![where_it_fails(report)];
    sections.extend(evidence(report));
    sections.push(falling_error(report));
    sections.push(one_record(report, &kept));
    sections.extend(crate::loops::loops_section(report));
    sections.extend(crate::dynamics::dynamics(report));
    sections.extend(alternatives(report));
    sections.push(what_the_residual_follows(report, &kept));
    sections.extend(parameters(report));
    sections.extend(next_experiment(report));
    sections.extend(noise_floor(report));
    sections.extend(remarks(report));
    Page {
        title: format!("{}: what the model explains", report.data_set),
        lead_sentence: report.sentence.clone(),
        tone: match report.verdict.as_str() {
            "at_floor" => Tone::Good,
            "named" => Tone::Neutral,
            _ => Tone::Attention,
        },
        facts: facts(report),
        selectors: selectors(report),
        sections,
        footer: [
            format!("hysteron {}", report.program_version),
            report.command.clone(),
        ]
        .into_iter()
        .filter(|line| !line.trim().is_empty())
        .collect(),
    }
}

/// Samples that are drawn, by record.
struct KeptSamples(Vec<Vec<usize>>);

impl KeptSamples {
    fn of(report: &ExplainReport) -> Self {
        let steps = report.steps.len().max(1);
        let records = report.records.len().max(1);
        let target = (NUMBERS_PER_PAGE / (records * (2 * steps + 8))).clamp(500, 12_000);
        Self(
            report
                .records
                .iter()
                .map(|record| {
                    let length = record.t_s.len();
                    let mut traces: Vec<&[f64]> = vec![&record.u_v, &record.y_um];
                    traces.extend(record.residual_um.last().map(Vec::as_slice));
                    traces.retain(|trace| trace.len() == length);
                    extreme_indices(&traces, target)
                })
                .collect(),
        )
    }

    /// The kept samples of `values` of a record; a missing sample is a gap.
    fn pick(&self, record: usize, values: &[f64], scale: f64) -> Vec<f64> {
        self.0[record]
            .iter()
            .map(|&i| values.get(i).map_or(f64::NAN, |v| v * scale))
            .collect()
    }
}

fn step_names(report: &ExplainReport) -> Vec<String> {
    report
        .steps
        .iter()
        .enumerate()
        .map(|(number, step)| match &step.added {
            Some(effect) => format!("+ {effect}"),
            None if number == 0 => "start".to_owned(),
            None => "finer".to_owned(),
        })
        .collect()
}

fn selectors(report: &ExplainReport) -> Vec<Selector> {
    let mut selectors = Vec::new();
    if !report.records.is_empty() {
        // A held-out record with motion says most about a model, so it is shown first.
        let shown = |role: &str| report.records.iter().rposition(|r| r.role == role);
        selectors.push(Selector {
            id: RECORD.to_owned(),
            label: "Record".to_owned(),
            options: report
                .records
                .iter()
                .map(|r| format!("{} ({})", r.name, role_words(&r.role)))
                .collect(),
            selected: shown("validate").or(shown("identify")).unwrap_or(0),
            steps: false,
        });
    }
    if report.steps.len() > 1 {
        selectors.push(Selector {
            id: STEP.to_owned(),
            label: "Model".to_owned(),
            options: step_names(report),
            selected: report.steps.len() - 1,
            steps: true,
        });
    }
    selectors
}

fn facts(report: &ExplainReport) -> Vec<(String, String)> {
    let mut facts = vec![("Data".to_owned(), report.data_set.clone())];
    if let Some(last) = report.steps.last() {
        let (name, rms_um) = match last.validate_rms_um {
            Some(rms_um) => ("Held-out error", rms_um),
            None => ("Error on the fitted records", last.identify_rms_um),
        };
        let floor = report.noise_floor.as_ref().filter(|f| f.rms_um > 0.0);
        let text = |rms_um: f64| {
            let times = floor.map(|f| format!(", {:.2} x the noise", rms_um / f.rms_um));
            format!("{} RMS{}", nanometres(rms_um), times.unwrap_or_default())
        };
        if let Some(named_um) = report.named_rms_um {
            facts.push((format!("{name}, named effects alone"), text(named_um)));
            facts.push((format!("{name}, model at the end"), text(rms_um)));
        } else {
            facts.push((name.to_owned(), text(rms_um)));
        }
    }
    facts.push((
        "Noise floor".to_owned(),
        match &report.noise_floor {
            Some(floor) => format!("{} RMS, from {}", nanometres(floor.rms_um), floor.basis),
            None => "this data cannot give one".to_owned(),
        },
    ));
    let added: Vec<String> = report
        .steps
        .iter()
        .filter_map(|step| step.added.as_deref())
        .map(effect_words)
        .collect();
    if !added.is_empty() {
        facts.push(("Added".to_owned(), added.join(", ")));
    }
    facts
}

fn drive_range_v(report: &ExplainReport) -> (f64, f64) {
    let drives = || {
        report
            .records
            .iter()
            .flat_map(|r| r.u_v.iter().copied())
            .filter(|u| u.is_finite())
    };
    let low_v = drives().fold(f64::INFINITY, f64::min);
    let high_v = drives().fold(f64::NEG_INFINITY, f64::max);
    if low_v < high_v {
        (low_v, high_v)
    } else {
        (0.0, 1.0)
    }
}

/// Samples without which a cell of the map says nothing.
const CELL_SAMPLES_MIN: usize = 16;

fn where_it_fails(report: &ExplainReport) -> Section {
    let range_v = drive_range_v(report);
    let features = drive_features(range_v.0, range_v.1);
    let floor_um = report
        .noise_floor
        .as_ref()
        .map(|f| f.rms_um)
        .filter(|f| *f > 0.0);
    let scale = floor_um.map_or(1e3, |f| 1.0 / f);
    let mut layers: Vec<HeatMapLayer> = (0..report.steps.len().max(1))
        .map(|step| HeatMapLayer {
            values: report
                .records
                .iter()
                .map(|record| match record.residual_um.get(step) {
                    Some(residual_um) => residual_by_feature(
                        &record.u_v,
                        residual_um,
                        record.sample_rate_hz,
                        0..record.t_s.len(),
                        range_v,
                    )
                    .into_iter()
                    .map(|cell| {
                        cell.filter(|c| c.samples >= CELL_SAMPLES_MIN)
                            .map(|c| c.rms * scale)
                    })
                    .collect(),
                    None => vec![None; features.len()],
                })
                .collect(),
            when: vec![When(STEP.to_owned(), step)],
        })
        .collect();
    let hottest = hottest_cells(report, &features, range_v, floor_um);
    let used: Vec<bool> = (0..features.len())
        .map(|column| {
            let mut rows = layers.iter().flat_map(|layer| &layer.values);
            rows.any(|row| row[column].is_some())
        })
        .collect();
    for row in layers.iter_mut().flat_map(|layer| &mut layer.values) {
        let mut column = 0..;
        row.retain(|_| column.next().is_some_and(|c: usize| used[c]));
    }
    let mut column_groups: Vec<(String, Vec<String>)> = Vec::new();
    let features = features.into_iter().zip(&used);
    for (feature, _) in features.filter(|(_, used)| **used) {
        match column_groups.last_mut() {
            Some((group, columns)) if *group == feature.group => columns.push(feature.label),
            _ => column_groups.push((feature.group, vec![feature.label])),
        }
    }
    let unit = if floor_um.is_some() { "x noise" } else { "nm" };
    Section {
        heading: "Where the model fails".to_owned(),
        text: format!(
            "RMS of measured minus modelled in each record, by what the drive was doing at that moment{}. A column that glows in every record is a \
             property of the actuator; a single cell points at one circumstance. Step through the models above to see which cells each effect empties; click \
             a record to look into it.",
            if floor_um.is_some() {
                ", as a multiple of the noise floor: 1 is noise alone"
            } else {
                ", in nm"
            }
        ),
        blocks: vec![
            hottest,
            PageBlock::HeatMap(HeatMap {
                title: "Residual over records and drive features".to_owned(),
                caption: format!(
                    "The frequency columns split the residual's own spectrum{}. Empty cells have fewer than {CELL_SAMPLES_MIN} samples, and those of few scatter by \
                     chance: what stands out by more than that is named above.",
                    if floor_um.is_some() {
                        ", so white noise spreads over them and stays below 1 there"
                    } else {
                        ""
                    }
                ),
                rows: report.records.iter().map(|r| r.name.clone()).collect(),
                column_groups,
                layers,
                neutral: floor_um.map(|_| 1.0),
                unit: unit.to_owned(),
                selector: Some(RECORD.to_owned()),
            }),
        ],
    }
}

/// The largest cells of the last model in words. Frequencies are left out: a band holds a share of the noise
/// only.
fn hottest_cells(
    report: &ExplainReport,
    features: &[DriveFeature],
    range_v: (f64, f64),
    floor_um: Option<f64>,
) -> PageBlock {
    let mut cells: Vec<(f64, String)> = Vec::new();
    for record in &report.records {
        let Some(residual_um) = record.residual_um.last() else {
            continue;
        };
        let row = residual_by_feature(
            &record.u_v,
            residual_um,
            record.sample_rate_hz,
            0..record.t_s.len(),
            range_v,
        );
        let largest = features
            .iter()
            .zip(row)
            .filter(|(feature, _)| !feature.group.starts_with("frequency"))
            .filter_map(|(feature, cell)| cell.map(|c| (feature, c)))
            .filter(|(_, cell)| {
                floor_um.is_none_or(|floor_um| stands_out(cell.rms / floor_um, cell.samples))
            })
            .max_by(|a, b| a.1.rms.total_cmp(&b.1.rms));
        // One cell for each record: neighbours add nothing.
        if let Some((feature, cell)) = largest {
            cells.push((
                cell.rms,
                format!("{}, {} ({})", record.name, feature.label, feature.group),
            ));
        }
    }
    cells.sort_by(|a, b| b.0.total_cmp(&a.0));
    let items = cells
        .iter()
        .take(3)
        .map(|(rms_um, place)| match floor_um {
            Some(floor_um) => format!(
                "{place}: {} RMS, {:.2} x the noise",
                nanometres(*rms_um),
                rms_um / floor_um
            ),
            None => format!("{place}: {} RMS", nanometres(*rms_um)),
        })
        .collect();
    if cells.is_empty() {
        let title = "With the last model nothing stands out of the noise, under any circumstance of the drive.".to_owned();
        return PageBlock::Notes(Notes {
            title,
            items,
            tone: Tone::Good,
        });
    }
    PageBlock::Notes(Notes {
        title: "With the last model most remains in:".to_owned(),
        items,
        tone: Tone::Neutral,
    })
}

/// Whether a cell is so many times the noise by more than chance and by enough to matter: the RMS of n
/// samples of white noise scatters by 1 / sqrt(2 n).
fn stands_out(times_noise: f64, samples: usize) -> bool {
    times_noise > 1.0 + MATTERS.max(CHANCE_DEVIATIONS / (2.0 * samples as f64).sqrt())
}

fn evidence(report: &ExplainReport) -> Option<Section> {
    let mut blocks = Vec::new();
    for evidence in &report.evidence {
        blocks.extend(evidence_plots(evidence, &report.records));
    }
    if blocks.is_empty() {
        return None;
    }
    let names: Vec<_> = report
        .evidence
        .iter()
        .map(|e| effect_words(&e.effect))
        .collect();
    Some(Section {
        heading: format!("The evidence: {}", names.join(", ")),
        text: "Dots: what the residual does, averaged over the samples that share an abscissa. Line: what the effect's signature predicts. From both, everything that the \
               parameters of the model before could have absorbed has been taken out, so a wrong parameter cannot pose as this effect. Records are ordered by how much \
               the signature moves in them."
            .to_owned(),
        blocks,
    })
}

/// What a step added.
fn added_words(step: &StepReport, name: &str) -> String {
    step.added.clone().unwrap_or_else(|| name.to_owned())
}

fn falling_error(report: &ExplainReport) -> Section {
    let names = step_names(report);
    let held_out = report.steps.iter().all(|s| s.validate_rms_um.is_some());
    let mut blocks = Vec::new();
    if !report.steps.is_empty() {
        blocks.push(PageBlock::Waterfall(Waterfall {
            title: "Error after each effect".to_owned(),
            caption: "Logarithmic. The outline shows what the step took away; a click on a step shows it in every plot.".to_owned(),
            steps: report
                .steps
                .iter()
                .zip(&names)
                .map(|(step, name)| WaterfallStep {
                    label: name.clone(),
                    value: 1e3 * step.validate_rms_um.unwrap_or(step.identify_rms_um),
                    beside: held_out.then_some(1e3 * step.identify_rms_um),
                })
                .collect(),
            value_labels: if held_out {
                ("held-out records".to_owned(), "fitted records".to_owned())
            } else {
                ("fitted records".to_owned(), String::new())
            },
            floor: report.noise_floor.as_ref().map(|f| ("noise floor".to_owned(), 1e3 * f.rms_um)),
            unit: "nm RMS".to_owned(),
            selector: Some(STEP.to_owned()),
        }));
    }
    blocks.push(PageBlock::Table(Table {
        title: "Step by step".to_owned(),
        columns: ["", "Added", "Fitted, nm RMS", "Held out, nm RMS", "Why"]
            .map(str::to_owned)
            .to_vec(),
        rows: report
            .steps
            .iter()
            .enumerate()
            .map(|(number, step)| {
                vec![
                    (number + 1).to_string(),
                    added_words(step, &names[number]),
                    figure(1e3 * step.identify_rms_um),
                    step.validate_rms_um
                        .map(|v| figure(1e3 * v))
                        .unwrap_or_default(),
                    step.why.clone(),
                ]
            })
            .collect(),
        ..Table::default()
    }));
    blocks.push(PageBlock::Table(Table {
        title: "Last model, record by record".to_owned(),
        caption: report
            .replays
            .iter()
            .map(|line| capital(line))
            .collect::<Vec<_>>()
            .join(" "),
        columns: [
            "Record",
            "Role",
            "RMS, nm",
            "Max, nm",
            "RMS, % of range",
            "Range, \u{b5}m",
            "Replay of the file, nm",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows: report
            .records
            .iter()
            .map(|r| {
                vec![
                    r.name.clone(),
                    role_words(&r.role).to_owned(),
                    figure(1e3 * r.rms_um),
                    figure(1e3 * r.max_um),
                    if r.role != "noise" && r.range_um > 0.0 {
                        figure(100.0 * r.rms_um / r.range_um)
                    } else {
                        String::new()
                    },
                    figure(r.range_um),
                    if r.replay_rms_um > 0.0 {
                        figure(1e3 * r.replay_rms_um)
                    } else {
                        String::new()
                    },
                ]
            })
            .collect(),
        ..Table::default()
    }));
    Section {
        heading: "The falling error".to_owned(),
        text: if held_out {
            "Held-out records were never fitted: what falls there has been understood, not memorised.".to_owned()
        } else {
            "This data set has no held-out record, so the figures are those of the fit itself and say less.".to_owned()
        },
        blocks,
    }
}

/// A sentence that begins with a capital letter and ends with a full stop.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let begun = letters.next().map_or_else(String::new, |c| {
        c.to_uppercase().collect::<String>() + letters.as_str()
    });
    if begun.ends_with('.') {
        begun
    } else {
        begun + "."
    }
}

fn one_record(report: &ExplainReport, kept: &KeptSamples) -> Section {
    let mut over_time = Plot::new("Measured and modelled over time")
        .x_axis("time", "s")
        .y_axis("displacement", "um")
        .link("time")
        .width(Width::Full)
        .height_px(260);
    let mut drive = Plot::new("Drive over time")
        .x_axis("time", "s")
        .y_axis("drive", "V")
        .link("time")
        .width(Width::Full)
        .height_px(140);
    let mut residual = Plot::new("Residual over time")
        .x_axis("time", "s")
        .y_axis("measured - modelled", "nm")
        .link("time")
        .percentiles()
        .width(Width::Full)
        .height_px(240);
    let mut loops = Plot::new("Measured and modelled over the drive")
        .x_axis("drive", "V")
        .y_axis("displacement", "um")
        .height_px(340);
    let mut residual_over_drive = Plot::new("Residual over the drive")
        .x_axis("drive", "V")
        .y_axis("measured - modelled", "nm")
        .percentiles()
        .height_px(340)
        .caption("Loops here mean that the branch matters; a single curve means that only the voltage does.");
    let mut spectrum = Plot::new("Spectrum of the residual")
        .x_axis("frequency", "Hz")
        .y_axis("amplitude density", "nm/rtHz")
        .log(true, true)
        .width(Width::Full)
        .height_px(280)
        .caption("Lines stand still while the drive changes; a resonance or a delay leaves a hump; creep and drift rise to the left.");
    for (r, record) in report.records.iter().enumerate() {
        let t_s = kept.pick(r, &record.t_s, 1.0);
        let u_v = kept.pick(r, &record.u_v, 1.0);
        let y_um = kept.pick(r, &record.y_um, 1.0);
        let measured = |x: &Vec<f64>| {
            Series::line("measured", CurveRole::Measured, x.clone(), y_um.clone()).when(RECORD, r)
        };
        over_time.series.push(measured(&t_s));
        loops.series.push(measured(&u_v));
        drive.series.push(
            Series::line("drive", CurveRole::Drive, t_s.clone(), u_v.clone())
                .style(Style::Steps)
                .when(RECORD, r),
        );
        for (step, residual_um) in record.residual_um.iter().enumerate() {
            let chosen = |series: Series| series.when(RECORD, r).when(STEP, step);
            let modelled_um: Vec<f64> = record
                .y_um
                .iter()
                .zip(residual_um)
                .map(|(y, e)| y - e)
                .collect();
            let modelled_um = kept.pick(r, &modelled_um, 1.0);
            let residual_nm = kept.pick(r, residual_um, 1e3);
            let model = |x: &Vec<f64>| {
                chosen(Series::line(
                    "modelled",
                    CurveRole::Model,
                    x.clone(),
                    modelled_um.clone(),
                ))
            };
            over_time.series.push(model(&t_s));
            loops.series.push(model(&u_v));
            let error = |x: &Vec<f64>| {
                chosen(Series::line(
                    "residual",
                    CurveRole::Residual,
                    x.clone(),
                    residual_nm.clone(),
                ))
            };
            residual.series.push(error(&t_s));
            residual_over_drive.series.push(error(&u_v));
            let counted_um: Vec<f64> = residual_um
                .iter()
                .map(|e| if e.is_finite() { *e } else { 0.0 })
                .collect();
            let density = amplitude_density(&counted_um, record.sample_rate_hz);
            spectrum.series.push(chosen(Series::line(
                "residual",
                CurveRole::Residual,
                density.frequency_hz,
                density.density.iter().map(|d| d * 1e3).collect(),
            )));
        }
        if let Some(floor) = &report.noise_floor
            && record.sample_rate_hz > 0.0
        {
            // The floor as white noise up to half the sample rate.
            spectrum.levels.push(Level {
                label: "noise floor, were it white".to_owned(),
                value: 1e3 * floor.rms_um / (record.sample_rate_hz / 2.0).sqrt(),
                when: vec![When(RECORD.to_owned(), r)],
            });
        }
    }
    if let Some(floor) = &report.noise_floor {
        residual.caption =
            "Between the dashed lines: plus and minus one standard deviation of the noise."
                .to_owned();
        for plot in [&mut residual, &mut residual_over_drive] {
            plot.levels.push(Level {
                label: "noise".to_owned(),
                value: 1e3 * floor.rms_um,
                when: Vec::new(),
            });
            plot.levels.push(Level {
                label: String::new(),
                value: -1e3 * floor.rms_um,
                when: Vec::new(),
            });
        }
    }
    Section {
        heading: "Look into a record".to_owned(),
        text: "Choose the record and the model in the bar above. Drag over a stretch to zoom, double-click for the whole; the three plots over time move together. \
               Click a plot (or reach it with the Tab key) to zoom with the wheel or + and -, move with the arrow keys, and 0 for the whole."
            .to_owned(),
        blocks: [over_time, drive, residual, loops, residual_over_drive, spectrum]
            .into_iter()
            .map(PageBlock::Plot)
            .collect(),
    }
}

fn alternatives(report: &ExplainReport) -> Option<Section> {
    if report.candidates.is_empty() {
        return None;
    }
    let interval = |c: &CandidateReport| match c.explained_share_interval {
        Some((low, high)) => format!(
            "{} ({:.0} to {:.0})",
            percent(c.explained_share),
            100.0 * low,
            100.0 * high
        ),
        None => percent(c.explained_share),
    };
    let change = |c: &CandidateReport| match (c.validate_rms_before_um, c.validate_rms_after_um) {
        (Some(before), Some(after)) => {
            format!("{} to {}", figure(1e3 * before), figure(1e3 * after))
        }
        (None, Some(after)) => format!("to {}", figure(1e3 * after)),
        _ => "not refitted".to_owned(),
    };
    let p_value = |p: Option<f64>| match p {
        None => "-".to_owned(),
        Some(p) if p < 1e-3 => "< 0.001".to_owned(),
        Some(p) => figure(p),
    };
    Some(Section {
        heading: "The alternatives, and why not".to_owned(),
        text: "Each effect of this table was tried on the residual of the model that was started from, after \
               taking out of its signature whatever that model can already do. The share is that of the \
               residual's power above the noise, with its 90 % interval over resampled blocks; the p-value is corrected for all of them; the best are refitted and \
               judged on records that were not fitted."
            .to_owned(),
        blocks: vec![PageBlock::Table(Table {
            columns: [
                "Effect",
                "Explains",
                "p",
                "Held out, nm RMS",
                "Hard to tell from",
                "Verdict",
                "Shown best by",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows: report
                .candidates
                .iter()
                .map(|c| {
                    vec![
                        c.effect.clone(),
                        interval(c),
                        p_value(c.p_value),
                        change(c),
                        c.confusable_with.join(", "),
                        c.why.clone(),
                        c.next_experiment.clone(),
                    ]
                })
                .collect(),
            highlighted_rows: report
                .candidates
                .iter()
                .enumerate()
                .filter(|(_, c)| report.named.contains(&c.effect))
                .map(|(i, _)| i)
                .collect(),
            ..Table::default()
        })],
    })
}

/// Bins of a mean curve.
const BINS: usize = 48;

/// Mean of `values` over equal bins of `x`, with the bins' centres; bins with fewer than 4 samples are left
/// out.
fn mean_curve(x: &[f64], values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let finite = || {
        x.iter()
            .zip(values)
            .filter(|(a, b)| a.is_finite() && b.is_finite())
    };
    let low = finite().map(|p| *p.0).fold(f64::INFINITY, f64::min);
    let high = finite().map(|p| *p.0).fold(f64::NEG_INFINITY, f64::max);
    if low >= high {
        return (Vec::new(), Vec::new());
    }
    let width = (high - low) / BINS as f64;
    let mut sums = vec![(0usize, 0.0); BINS];
    for (a, b) in finite() {
        let bin = (((a - low) / width) as usize).min(BINS - 1);
        sums[bin] = (sums[bin].0 + 1, sums[bin].1 + b);
    }
    sums.iter()
        .enumerate()
        .filter(|(_, (samples, _))| *samples >= 4)
        .map(|(bin, (samples, sum))| (low + width * (bin as f64 + 0.5), sum / *samples as f64))
        .unzip()
}

fn what_the_residual_follows(report: &ExplainReport, kept: &KeptSamples) -> Section {
    let latent = report.records.iter().any(|r| !r.latent_force.is_empty());
    let (name, unit) = match report.records.iter().find(|r| !r.latent_force.is_empty()) {
        Some(record) => ("latent force", record.latent_unit.clone()),
        None => ("measured - modelled", "nm".to_owned()),
    };
    let views = [
        ("Against the drive", "drive", "V"),
        ("Against the drive's rate", "rate of the drive", "V/s"),
        ("Against the displacement", "displacement", "um"),
        ("Against the history", "largest drive so far", "V"),
        ("Against time", "time", "s"),
        (
            "Against the time since the last turn",
            "time since turn",
            "s",
        ),
    ];
    let mut plots: Vec<Plot> = views
        .iter()
        .map(|(title, label, x_unit)| {
            Plot::new(*title)
                .x_axis(label, x_unit)
                .y_axis(name, &unit)
                .percentiles()
                .width(Width::Third)
                .height_px(230)
        })
        .collect();
    plots[5].x.log = true;
    let range_v = drive_range_v(report);
    for (r, record) in report.records.iter().enumerate() {
        let rate_v_per_s: Vec<f64> = (0..record.u_v.len())
            .map(|k| (record.u_v[k] - record.u_v[k.saturating_sub(1)]) * record.sample_rate_hz)
            .collect();
        let mut highest_v = f64::NEG_INFINITY;
        let highest_v: Vec<f64> = record
            .u_v
            .iter()
            .map(|u| {
                highest_v = highest_v.max(*u);
                highest_v
            })
            .collect();
        let branch = branches(&record.u_v, record.sample_rate_hz, range_v.1 - range_v.0);
        let age_s: Vec<f64> = branch.iter().map(|(_, age_s)| *age_s).collect();
        let abscissae: [&[f64]; 6] = [
            &record.u_v,
            &rate_v_per_s,
            &record.y_um,
            &highest_v,
            &record.t_s,
            &age_s,
        ];
        let layers: Vec<(Option<usize>, &[f64], f64)> = if record.latent_force.is_empty() {
            let steps = record.residual_um.iter().enumerate();
            steps.map(|(s, e)| (Some(s), e.as_slice(), 1e3)).collect()
        } else {
            vec![(None, record.latent_force.as_slice(), 1.0)]
        };
        for (step, values, scale) in layers {
            let chosen = |series: Series| match step {
                Some(step) => series.when(RECORD, r).when(STEP, step),
                None => series.when(RECORD, r),
            };
            let drawn = kept.pick(r, values, scale);
            for (plot, x) in plots.iter_mut().zip(abscissae) {
                plot.series.push(chosen(Series::points(
                    name,
                    CurveRole::Residual,
                    kept.pick(r, x, 1.0),
                    drawn.clone(),
                )));
            }
            for (plot, x) in plots.iter_mut().zip(abscissae).take(3) {
                for (label, role, wanted) in [
                    (
                        "mean, rising",
                        CurveRole::Other1,
                        [Branch::Rising, Branch::FirstRise],
                    ),
                    (
                        "mean, falling",
                        CurveRole::Other2,
                        [Branch::Falling, Branch::Falling],
                    ),
                ] {
                    let masked: Vec<f64> = values
                        .iter()
                        .zip(&branch)
                        .map(|(e, (b, _))| {
                            if wanted.contains(b) {
                                e * scale
                            } else {
                                f64::NAN
                            }
                        })
                        .collect();
                    let (x, mean) = mean_curve(x, &masked);
                    plot.series.push(chosen(Series::line(label, role, x, mean)));
                }
            }
        }
    }
    Section {
        heading: if latent {
            "The latent force".to_owned()
        } else {
            "What the residual follows".to_owned()
        },
        text: format!(
            "{} against everything it could depend on, without a name for it. A clean curve in one of these pictures is a law that waits for its effect; a cloud \
             everywhere is noise.",
            if latent {
                "The disturbance that would have to act on the modelled actuator to make its output the measured one,"
            } else {
                "The residual of the chosen record and model,"
            }
        ),
        blocks: plots.into_iter().map(PageBlock::Plot).collect(),
    }
}

fn parameters(report: &ExplainReport) -> Option<Section> {
    if report.parameters.is_empty() {
        return None;
    }
    Some(Section {
        heading: "Parameters".to_owned(),
        text: String::new(),
        blocks: vec![PageBlock::Table(Table {
            title: "As an engineer reads them".to_owned(),
            columns: ["Effect", "", "Value"].map(str::to_owned).to_vec(),
            rows: report.values.iter().map(|value| value.to_vec()).collect(),
            ..Table::default()
        }), PageBlock::Table(Table {
            title: "As the model file has them".to_owned(),
            columns: ["Effect", "Parameter", "Value", "Standard deviation", "Unit", ""]
                .map(str::to_owned)
                .to_vec(),
            rows: report
                .parameters
                .iter()
                .map(|p| {
                    let [value, std] = match p.std.filter(|std| *std > 0.0) {
                        Some(std) => rounded(p.value, std),
                        None => [format!("{:.6}", Significant(p.value)), "unknown".to_owned()],
                    };
                    vec![
                        p.effect.clone(),
                        p.name.clone(),
                        value,
                        std,
                        p.unit.clone(),
                        p.note.clone(),
                    ]
                })
                .collect(),
            caption: "Standard deviations are those of the least-squares fit with the residual's own variance; they do not cover effects that the model lacks.".to_owned(),
            ..Table::default()
        })],
    })
}

fn next_experiment(report: &ExplainReport) -> Option<Section> {
    let experiment = report.next_experiment.as_ref()?;
    let text = experiment.why.clone();
    let mut blocks = Vec::new();
    if !experiment.t_s.is_empty() {
        blocks.push(PageBlock::Plot(
            Plot::new("Proposed drive")
                .x_axis("time", "s")
                .y_axis("drive", "V")
                .width(Width::Full)
                .height_px(200)
                .with(
                    Series::line(
                        "drive",
                        CurveRole::Drive,
                        experiment.t_s.clone(),
                        experiment.u_v.clone(),
                    )
                    .style(Style::Steps),
                ),
        ));
    }
    Some(Section {
        heading: "The next experiment".to_owned(),
        text,
        blocks,
    })
}

fn noise_floor(report: &ExplainReport) -> Option<Section> {
    let floor = report.noise_floor.as_ref()?;
    if floor.estimates.is_empty() {
        return None;
    }
    Some(Section {
        heading: "The noise floor".to_owned(),
        text: format!(
            "What remains random after lines, drift and whatever follows the drive or the force have been removed. In use: {}, from {}.",
            nanometres(floor.rms_um),
            floor.basis
        ),
        blocks: vec![PageBlock::Table(Table {
            columns: ["Estimate", "nm RMS"].map(str::to_owned).to_vec(),
            rows: floor
                .estimates
                .iter()
                .map(|(basis, rms_um)| vec![basis.clone(), figure(1e3 * rms_um)])
                .collect(),
            ..Table::default()
        })],
    })
}

fn remarks(report: &ExplainReport) -> Option<Section> {
    if report.warnings.is_empty() {
        return None;
    }
    Some(Section {
        heading: "Remarks".to_owned(),
        text: String::new(),
        blocks: vec![PageBlock::Notes(Notes {
            title: String::new(),
            items: report.warnings.clone(),
            tone: Tone::Attention,
        })],
    })
}
