//! The page of a servo at work: its last periods, the spectrum of its error, a step, other plants, and what
//! it asks of the amplifier.

use crate::page::{CurveRole, Page, PageBlock, Plot, Section, Series, Table, Tone, Width};
use crate::text::figure;
use hysteron::servo::members::PlantBand;
use hysteron::servo::track::{SETTLED, TrackResult};
use hysteron::spectrum::amplitude_density;
use std::ops::Range;

/// Periods of a reference that are drawn.
const PERIODS: f64 = 2.0;
/// What is drawn of a reference that does not repeat, s.
const SHOWN_S: f64 = 0.1;
/// Before a step, and at least behind it, s.
const AROUND_STEP_S: [f64; 2] = [0.001, 0.006];
/// Settling times behind a step.
const SETTLINGS: f64 = 4.0;
/// Windows of the error over the whole run, s.
const WINDOW_S: f64 = 0.01;

/// What the page shows.
#[derive(Clone, Copy)]
pub struct TrackPage<'a> {
    /// The servo on its reference.
    pub found: &'a TrackResult,
    /// Period of the reference, s, where it has one.
    pub period_s: Option<f64>,
    /// The same on other plants.
    pub band: Option<&'a PlantBand>,
    /// A step on the model; the servo's own where its reference is one.
    pub step: Option<&'a TrackResult>,
    /// Capacitance of the actuator, uF, where it is stated.
    pub capacitance_uf: Option<f64>,
}

fn ticks(seconds: f64, period_s: f64) -> usize {
    (seconds / period_s).round() as usize
}

fn nm(um: f64) -> String {
    format!("{} nm", figure(1e3 * um))
}

/// A stretch of a run: its time from a tick on, in ms, and its signals.
struct Stretch<'a> {
    run: &'a TrackResult,
    ticks: Range<usize>,
    zero: usize,
}

impl Stretch<'_> {
    fn time_ms(&self) -> Vec<f64> {
        self.ticks
            .clone()
            .map(|k| 1e3 * self.run.period_s * (k as f64 - self.zero as f64))
            .collect()
    }

    fn of(&self, values: &[f64]) -> Vec<f64> {
        values[self.ticks.clone()].to_vec()
    }

    fn off_nm(&self, values_um: &[f64]) -> Vec<f64> {
        self.ticks
            .clone()
            .map(|k| 1e3 * (values_um[k] - self.run.reference_um[k]))
            .collect()
    }

    fn plot(&self, title: &str, label: &str, unit: &str) -> Plot {
        Plot::new(title).x_axis("time", "ms").y_axis(label, unit)
    }

    fn motion(&self, title: &str, link: &str) -> [Plot; 2] {
        let (time, run) = (self.time_ms(), self.run);
        let motion = self
            .plot(title, "displacement", "um")
            .link(link)
            .with(Series::line(
                "read",
                CurveRole::Measured,
                time.clone(),
                self.of(&run.reading_um),
            ))
            .with(Series::line(
                "true",
                CurveRole::Model,
                time.clone(),
                self.of(&run.displacement_um),
            ))
            .with(Series::line(
                "reference",
                CurveRole::Reference,
                time.clone(),
                self.of(&run.reference_um),
            ));
        let error = self
            .plot("Error there", "off the reference", "nm")
            .link(link)
            .percentiles()
            .with(Series::line(
                "read",
                CurveRole::Measured,
                time.clone(),
                self.off_nm(&run.reading_um),
            ))
            .with(Series::line(
                "true",
                CurveRole::Model,
                time,
                self.off_nm(&run.displacement_um),
            ));
        [motion, error]
    }
}

impl<'a> TrackPage<'a> {
    /// The whole page.
    #[must_use]
    pub fn page(&self, title: String) -> Page {
        let found = self.found;
        let mut facts = vec![
            ("Scheme".to_owned(), found.scheme.clone()),
            (
                "True error".to_owned(),
                format!(
                    "{} RMS, {} at most",
                    nm(found.truth.rms_um),
                    nm(found.truth.max_um)
                ),
            ),
            (
                "As read".to_owned(),
                format!(
                    "{} RMS, {} at most",
                    nm(found.as_read.rms_um),
                    nm(found.as_read.max_um)
                ),
            ),
            ("Noise of the sensor".to_owned(), nm(found.noise_um)),
        ];
        if let Some(settling_s) = self.step.and_then(|s| s.step).and_then(|s| s.settling_s) {
            facts.push((
                "Settling of a step".to_owned(),
                format!(
                    "{} ms to {:.0} %",
                    figure(1e3 * settling_s),
                    100.0 * SETTLED
                ),
            ));
        }
        let worst = self.band.and_then(PlantBand::worst);
        let over = worst
            .map(|worst| {
                format!(
                    "; up to {} on other plants ({})",
                    nm(worst.truth.rms_um),
                    worst.plant
                )
            })
            .unwrap_or_default();
        let trouble = found.trouble();
        Page {
            title,
            lead_sentence: trouble.clone().unwrap_or_else(|| {
                format!(
                    "The true position is {} RMS off its reference{over}.",
                    nm(found.truth.rms_um)
                )
            }),
            tone: if trouble.is_some() {
                Tone::Attention
            } else {
                Tone::Neutral
            },
            facts,
            sections: [
                Some(self.at_work()),
                step_section(self.step),
                self.other_plants(),
                Some(self.drive()),
            ]
            .into_iter()
            .flatten()
            .collect(),
            ..Page::default()
        }
    }

    /// The last periods, or what there is of a reference that does not repeat.
    fn stretch(&self) -> Stretch<'a> {
        let (run, end) = (self.found, self.found.time_s.len());
        let counted = run.counts_from.min(end);
        if run.step.is_some() {
            return around_step(run);
        }
        let wanted = ticks(
            self.period_s.map_or(SHOWN_S, |period_s| PERIODS * period_s),
            self.found.period_s,
        );
        let from = end.saturating_sub(wanted).max(counted);
        Stretch {
            run,
            ticks: from..end,
            zero: from,
        }
    }

    fn at_work(&self) -> Section {
        let (run, stretch) = (self.found, self.stretch());
        let title = match (run.step, self.period_s) {
            (Some(_), _) => "The step",
            (None, Some(_)) => "The last two periods",
            (None, None) => "The last tenth of a second",
        };
        let [motion, error] = stretch.motion(title, "work");
        let counted = run.counts_from.min(run.time_s.len())..run.time_s.len();
        let whole = Stretch {
            run,
            ticks: counted,
            zero: 0,
        };
        let density = |values_um: &[f64], label: &str, role: CurveRole| {
            let density = amplitude_density(&whole.off_nm(values_um), 1.0 / run.period_s);
            Series::line(label, role, density.frequency_hz, density.density)
        };
        let spectrum = Plot::new("Spectrum of the error")
            .x_axis("frequency", "Hz")
            .y_axis("amplitude density", "nm/rtHz")
            .log(true, true)
            .caption("While the error counts. What stands out at multiples of the reference is hysteresis or creep that is let through; the rest is noise.")
            .with(density(&run.reading_um, "read", CurveRole::Measured))
            .with(density(&run.displacement_um, "true", CurveRole::Model));
        let all = Stretch {
            run,
            ticks: 0..run.time_s.len(),
            zero: 0,
        };
        let rms = |values_um: &[f64], label: &str, role: CurveRole| {
            let off_nm = all.off_nm(values_um);
            let windows = off_nm.chunks(ticks(WINDOW_S, run.period_s)).enumerate();
            let (x, y) = windows
                .map(|(k, w)| {
                    (
                        (k as f64 + 0.5) * WINDOW_S,
                        (w.iter().map(|e| e * e).sum::<f64>() / w.len() as f64).sqrt(),
                    )
                })
                .unzip();
            Series::line(label, role, x, y)
        };
        let course = Plot::new("Error over the run, RMS of every 10 ms")
            .x_axis("time", "s")
            .y_axis("error", "nm")
            .percentiles()
            .caption(format!(
                "The error counts from {:.2} s on.",
                run.counts_from as f64 * run.period_s
            ))
            .with(rms(&run.reading_um, "read", CurveRole::Measured))
            .with(rms(&run.displacement_um, "true", CurveRole::Model));
        Section {
            heading: "At work".into(),
            text: format!(
                "Plant: {}. Read is what the converter gives, the sensor's noise of {} included; true is where the stage is.",
                run.plant,
                nm(run.noise_um)
            ),
            blocks: [motion, error, course, spectrum]
                .into_iter()
                .map(PageBlock::Plot)
                .collect(),
        }
    }

    fn other_plants(&self) -> Option<Section> {
        let band = self.band?;
        let worst = band.worst().map(|worst| worst.plant.as_str());
        let settles = band.members.iter().any(|m| m.settling_s.is_some());
        let mut columns = vec!["Plant", "True RMS, nm", "True max, nm", "As read RMS, nm"];
        if settles {
            columns.push("Settling, ms");
        }
        columns.push("");
        let rows = band.members.iter().map(|m| {
            let mut row = vec![
                m.plant.clone(),
                figure(1e3 * m.truth.rms_um),
                figure(1e3 * m.truth.max_um),
                figure(1e3 * m.as_read.rms_um),
            ];
            if settles {
                row.push(
                    m.settling_s
                        .map_or_else(|| "-".to_owned(), |s| figure(1e3 * s)),
                );
            }
            row.push(m.trouble.clone().unwrap_or_default());
            row
        });
        Some(Section {
            heading: "On other plants".into(),
            text: format!(
                "The same servo, reference and noise on plants that may stand in the place of the model{}.",
                if band.with_covariance {
                    ""
                } else {
                    "; its file has no covariance of its values, so none are drawn"
                }
            ),
            blocks: vec![PageBlock::Table(Table {
                columns: columns.into_iter().map(str::to_owned).collect(),
                rows: rows.collect(),
                highlighted_rows: band
                    .members
                    .iter()
                    .enumerate()
                    .filter(|(_, m)| Some(m.plant.as_str()) == worst)
                    .map(|(i, _)| i)
                    .collect(),
                ..Table::default()
            })],
        })
    }

    fn drive(&self) -> Section {
        let (run, stretch) = (self.found, self.stretch());
        let time = stretch.time_ms();
        let rate_v_ms: Vec<f64> = stretch
            .ticks
            .clone()
            .map(|k| 1e-3 * (run.drive_v[k] - run.drive_v[k.saturating_sub(1)]) / run.period_s)
            .collect();
        let line = |title: &str, label: &str, unit: &str, values: Vec<f64>| {
            let width = if self.capacitance_uf.is_some() {
                Width::Third
            } else {
                Width::Half
            };
            let series = Series::line(label, CurveRole::Drive, time.clone(), values)
                .style(crate::page::Style::Steps);
            PageBlock::Plot(
                stretch
                    .plot(title, label, unit)
                    .link("work")
                    .percentiles()
                    .width(width)
                    .with(series),
            )
        };
        let mut blocks = vec![
            line("Drive", "drive", "V", stretch.of(&run.drive_v)),
            line(
                "Rate of the drive, tick to tick",
                "rate",
                "V/ms",
                rate_v_ms.clone(),
            ),
        ];
        let [low, high] = run.drive.range_v;
        let mut text = format!(
            "{low:.1} to {high:.1} V; the rate from tick to tick is at most {} V/ms, {} V/ms RMS.",
            figure(1e-3 * run.drive.rate_max_v_s),
            figure(1e-3 * run.drive.rate_rms_v_s)
        );
        match self.capacitance_uf {
            // 1 uF at 1 V/ms takes 1 mA.
            Some(uf) => {
                blocks.push(line(
                    "Current into the actuator",
                    "current",
                    "mA",
                    rate_v_ms.iter().map(|r| uf * r).collect(),
                ));
                text.push_str(&format!(
                    " {uf} uF take {} mA at most and {} mA RMS, were the amplifier to follow every tick at once.",
                    figure(1e-3 * uf * run.drive.rate_max_v_s),
                    figure(1e-3 * uf * run.drive.rate_rms_v_s)
                ));
            }
            None => text.push_str(" With --capacitance-uf the current that it takes."),
        }
        Section {
            heading: "What it asks of the amplifier".into(),
            text,
            blocks,
        }
    }
}

/// The neighbourhood of a step.
fn around_step(run: &TrackResult) -> Stretch<'_> {
    let at = run.counts_from;
    let settling_s = run.step.and_then(|s| s.settling_s).unwrap_or(0.0);
    let behind = ticks((SETTLINGS * settling_s).max(AROUND_STEP_S[1]), run.period_s);
    Stretch {
        run,
        ticks: at.saturating_sub(ticks(AROUND_STEP_S[0], run.period_s))
            ..(at + behind).min(run.time_s.len()),
        zero: at,
    }
}

/// A step with the band in which it is settled, and the time that it takes.
#[must_use]
pub fn step_section(run: Option<&TrackResult>) -> Option<Section> {
    let run = run?;
    let step = run.step?;
    let [motion, error] = around_step(run).motion("Step", "step");
    let band_nm = 1e3 * SETTLED * step.by_um.abs();
    let percent = 100.0 * SETTLED;
    let error = error
        .level(&format!("{percent:.0} %"), band_nm)
        .level("", -band_nm);
    let settled = match step.settling_s {
        Some(s) => format!(
            "stays within {percent:.0} % of it from {} ms on",
            figure(1e3 * s)
        ),
        None => format!(
            "does not stay within {percent:.0} % of it, {} nm",
            figure(band_nm)
        ),
    };
    let rises = step
        .rise_s
        .map(|s| {
            format!(
                ", rises from a tenth to nine tenths in {} ms",
                figure(1e3 * s)
            )
        })
        .unwrap_or_default();
    Some(Section {
        heading: "A step".into(),
        text: format!(
            "A step of {:.3} um ({}). The true position {settled}{rises} and overshoots by {:.1} %. The servo knows its reference ahead, so it sets out before the step.",
            step.by_um,
            run.reference,
            100.0 * step.overshoot
        ),
        blocks: vec![PageBlock::Plot(motion), PageBlock::Plot(error)],
    })
}
