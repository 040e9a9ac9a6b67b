//! Many recordings of one kind of stage: a row for each, and what stands out among them.
//!
//! # How it works
//! Each recording is explained from the same effects. Its row holds the verdict, the values of the model that
//! was found as an engineer reads them, and its remainder, or why it could not be read. Rows are compared with
//! one another: an outlier has a value far from the median in standard deviations, its own and those of the
//! spread over all rows, or a verdict or effects that few have. A *unit* is a specimen with several recordings:
//! a folder, or the part of a file's name before its last number. A unit differs where its median lies far from
//! that of all others, in standard deviations of these.

use crate::analyse::{Options, Outcome, Start, analyse};
use crate::dataset::Dataset;
use crate::engineering::{Figure, four};
use crate::error::Result;
use crate::outcome::Remainder;
use crate::watch::Watch;
use hysteron_sim::effect::Effect;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Schema of files with rows.
pub const SCHEMA: &str = "hysteron.survey/1";
/// Effects, verdicts: fewer than this share of the rows have them where they are rare.
const RARE: f64 = 0.1;
/// Standard deviations from the median at which a value stands out: of 500 recordings with twenty values each
/// a normal spread passes it by chance once in two hundred surveys.
const STANDS_OUT: f64 = 5.0;
/// Least number of rows that have a value for it to be compared.
const COMPARED: usize = 5;
/// Least number of recordings of a unit.
const RECORDINGS_OF_A_UNIT: usize = 3;
/// Standard deviation of a normal spread over its median of absolute deviations.
const OVER_MAD: f64 = 1.4826;

/// A value of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurveyValue {
    /// Effect and name.
    pub name: String,
    /// The value; none where the recording does not determine it.
    pub value: Option<f64>,
    /// Its standard deviation, where it is known.
    pub std: Option<f64>,
    /// Its unit.
    pub unit: String,
}

impl SurveyValue {
    /// The value with its deviation, as it is printed.
    #[must_use]
    pub fn text(&self) -> String {
        let figure = Figure {
            effect: String::new(),
            name: String::new(),
            value: self.value,
            std: self.std,
            unit: self.unit.clone(),
        };
        figure.text()
    }
}

/// What a recording came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurveyRow {
    /// The recording, by its path below the folder of all.
    pub recording: String,
    /// Why it has no verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The word.
    #[serde(default)]
    pub verdict: String,
    /// Effects that it names beside those of all.
    #[serde(default)]
    pub named: Vec<String>,
    /// Effects of the model that was found.
    #[serde(default)]
    pub effects: Vec<String>,
    /// The verdict in a sentence.
    #[serde(default)]
    pub sentence: String,
    /// What the model leaves, um RMS.
    #[serde(default)]
    pub remainder_um: Option<f64>,
    /// The same in times the noise.
    #[serde(default)]
    pub times_noise: Option<f64>,
    /// The noise, um RMS.
    #[serde(default)]
    pub noise_um: Option<f64>,
    /// The values.
    #[serde(default)]
    pub values: Vec<SurveyValue>,
    /// Means of further signals, such as a temperature.
    #[serde(default)]
    pub means: BTreeMap<String, f64>,
    /// Samples.
    #[serde(default)]
    pub samples: usize,
    /// Wall-clock time.
    #[serde(default)]
    pub seconds: f64,
}

impl SurveyRow {
    /// Of a recording that gave no verdict.
    #[must_use]
    pub fn refused(recording: &str, error: String) -> Self {
        Self {
            recording: recording.to_owned(),
            error: Some(error),
            ..Self::default()
        }
    }

    /// What a search came to.
    #[must_use]
    pub fn found(recording: &str, dataset: &Dataset, found: &Outcome, seconds: f64) -> Self {
        let figures = found.figures(dataset, seconds);
        let diagnosis = &found.diagnosis;
        let Remainder {
            rms_um,
            times_noise,
        } = diagnosis.remainder;
        let values = figures.values.into_iter().map(|figure| SurveyValue {
            name: format!("{}: {}", figure.effect, figure.name),
            value: figure.value,
            std: figure.std,
            unit: figure.unit,
        });
        let mut means: BTreeMap<String, (f64, usize)> = BTreeMap::new();
        for signal in dataset.records.iter().flat_map(|r| &r.auxiliary) {
            let (sum, count) = means.entry(signal.name.clone()).or_default();
            *sum += signal.values.iter().sum::<f64>();
            *count += signal.values.len();
        }
        Self {
            recording: recording.to_owned(),
            error: None,
            verdict: diagnosis.verdict.word().to_owned(),
            named: diagnosis.named.clone(),
            effects: found.model.effect_ids(),
            sentence: diagnosis.sentence.clone(),
            remainder_um: Some(rms_um).filter(|rms_um| rms_um.is_finite()),
            times_noise,
            noise_um: diagnosis.noise_floor_um,
            values: values.collect(),
            means: means
                .into_iter()
                .map(|(name, (sum, count))| (name, sum / count.max(1) as f64))
                .collect(),
            samples: dataset.records.iter().map(|r| r.drive_v.len()).sum(),
            seconds,
        }
    }

    /// The unit that it is of.
    #[must_use]
    pub fn unit(&self) -> &str {
        if let Some((folder, _)) = self.recording.rsplit_once('/') {
            return folder;
        }
        let stem = self.recording.split('.').next().unwrap_or_default();
        let without_number = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        without_number.trim_end_matches(['_', '-', ' '])
    }

    fn value(&self, name: &str) -> Option<(f64, f64)> {
        let found = self.values.iter().find(|value| value.name == name)?;
        Some((
            found.value?,
            found.std.filter(|std| std.is_finite()).unwrap_or(0.0),
        ))
    }
}

/// The effects that recordings of a sample have in common: those of the start that their models keep, and those
/// that more than half of them name.
///
/// # Errors
/// None of the sample gives a verdict: with what is wrong with the first.
pub fn common_effects(
    sample: &[Dataset],
    start: &[Arc<dyn Effect>],
    options: &Options,
    watch: &dyn Watch,
) -> Result<Vec<String>> {
    let found = sample
        .iter()
        .map(|dataset| analyse(dataset, Start::Effects(start), options, watch));
    let found = found.collect::<Result<Vec<Outcome>>>()?;
    let begun: Vec<String> = start.iter().map(|e| e.declaration().id.clone()).collect();
    let needed = |outcome: &Outcome| -> Vec<String> {
        let named = &outcome.diagnosis.named;
        let ids = outcome.model.effect_ids().into_iter();
        ids.filter(|id| named.contains(id) || begun.contains(id))
            .collect()
    };
    let needed: Vec<Vec<String>> = found.iter().map(needed).collect();
    let mut common: Vec<String> = Vec::new();
    for id in needed.iter().flatten() {
        let share = needed.iter().filter(|ids| ids.contains(id)).count();
        if 2 * share > needed.len() && !common.contains(id) {
            common.push(id.clone());
        }
    }
    Ok(if common.is_empty() { begun } else { common })
}

/// A row that stands out, and in what.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outlier {
    /// The recording.
    pub recording: String,
    /// In what, a phrase each.
    pub in_what: Vec<String>,
}

/// A unit whose value differs from that of all others.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DifferingUnit {
    /// The unit.
    pub unit: String,
    /// The value.
    pub name: String,
    /// Median of its recordings.
    pub median: f64,
    /// Median of all others.
    pub others: f64,
    /// How far they are apart, in standard deviations of the others.
    pub deviations: f64,
}

/// Rows side by side (`hysteron.survey/1`).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Survey {
    /// `hysteron.survey/1`.
    pub schema: &'static str,
    /// Effects from which each recording was explained.
    pub effects: Vec<String>,
    /// A row for each recording, by its name.
    pub rows: Vec<SurveyRow>,
    /// Those that stand out.
    pub outliers: Vec<Outlier>,
    /// Units that differ.
    pub units: Vec<DifferingUnit>,
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

/// Robust standard deviation about a value.
fn spread(values: &[f64], about: f64) -> f64 {
    OVER_MAD * median(&mut values.iter().map(|v| (v - about).abs()).collect::<Vec<_>>())
}

impl Survey {
    /// Puts rows side by side.
    #[must_use]
    pub fn new(effects: Vec<String>, mut rows: Vec<SurveyRow>) -> Self {
        rows.sort_by(|a, b| a.recording.cmp(&b.recording));
        let mut out = Self {
            schema: SCHEMA,
            effects,
            rows,
            outliers: Vec::new(),
            units: Vec::new(),
        };
        out.outliers = out.outliers_found();
        out.units = out
            .names()
            .iter()
            .flat_map(|name| out.differing_units(name))
            .collect();
        out
    }

    /// Rows that gave a verdict.
    pub fn good(&self) -> impl Iterator<Item = &SurveyRow> {
        self.rows.iter().filter(|row| row.error.is_none())
    }

    /// Names of the values that enough rows have, in the order of the first.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let least = COMPARED.max(self.good().count() / 4);
        let mut counts: Vec<(&str, usize)> = Vec::new();
        for value in self
            .good()
            .flat_map(|row| &row.values)
            .filter(|v| v.value.is_some())
        {
            match counts.iter_mut().find(|(name, _)| *name == value.name) {
                Some((_, count)) => *count += 1,
                None => counts.push((&value.name, 1)),
            }
        }
        let enough = counts.into_iter().filter(|(_, count)| *count >= least);
        enough.map(|(name, _)| name.to_owned()).collect()
    }

    /// The values of a name: its row, value and deviation.
    #[must_use]
    pub fn values(&self, name: &str) -> Vec<(&SurveyRow, f64, f64)> {
        let of = |row| SurveyRow::value(row, name).map(|(value, std)| (row, value, std));
        self.good().filter_map(of).collect()
    }

    fn outliers_found(&self) -> Vec<Outlier> {
        let mut found: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        let good: Vec<&SurveyRow> = self.good().collect();
        let mut rare = |what: &str, of: &dyn Fn(&SurveyRow) -> String| {
            let mut counts: BTreeMap<String, usize> = BTreeMap::new();
            good.iter()
                .for_each(|row| *counts.entry(of(row)).or_default() += 1);
            let Some((usual, _)) = counts.iter().max_by_key(|(_, count)| **count) else {
                return;
            };
            for row in &good {
                let this = of(row);
                if (counts[&this] as f64) < RARE * good.len() as f64 {
                    let phrase = format!("{what} {this}; most have {usual}");
                    found.entry(&row.recording).or_default().push(phrase);
                }
            }
        };
        rare("the verdict", &|row| row.verdict.clone());
        rare("the effects", &|row| row.effects.join(", "));
        for name in self.names() {
            let values = self.values(&name);
            let plain: Vec<f64> = values.iter().map(|(_, value, _)| *value).collect();
            let middle = median(&mut plain.clone());
            let spread = spread(&plain, middle);
            for (row, value, std) in values {
                let by = (value - middle).abs() / spread.hypot(std).max(f64::MIN_POSITIVE);
                if by > STANDS_OUT {
                    found.entry(&row.recording).or_default().push(format!(
                        "{name} {}, the median is {} ({by:.0} standard deviations)",
                        four(value),
                        four(middle)
                    ));
                }
            }
        }
        let outlier = |(recording, in_what): (&str, Vec<String>)| Outlier {
            recording: recording.to_owned(),
            in_what,
        };
        found.into_iter().map(outlier).collect()
    }

    fn differing_units(&self, name: &str) -> Vec<DifferingUnit> {
        let mut by_unit: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        for (row, value, _) in self.values(name) {
            by_unit.entry(row.unit()).or_default().push(value);
        }
        let medians: BTreeMap<&str, f64> = (by_unit.iter_mut())
            .map(|(unit, values)| (*unit, median(values)))
            .collect();
        let enough = by_unit
            .iter()
            .filter(|(_, v)| v.len() >= RECORDINGS_OF_A_UNIT);
        let differing = |(unit, values): (&&str, &Vec<f64>)| {
            let others = by_unit.iter().filter(|(other, _)| *other != unit);
            let mut others: Vec<f64> = others.flat_map(|(_, v)| v.iter().copied()).collect();
            let (here, there) = (medians[unit], median(&mut others));
            // The median of a unit is known better than one of its recordings.
            let own = spread(values, here) / (values.len() as f64).sqrt();
            let both = own.hypot(spread(&others, there)).max(f64::MIN_POSITIVE);
            let deviations = (here - there).abs() / both;
            (others.len() >= COMPARED && deviations > STANDS_OUT).then(|| DifferingUnit {
                unit: (*unit).to_owned(),
                name: name.to_owned(),
                median: here,
                others: there,
                deviations,
            })
        };
        enough.filter_map(differing).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(recording: &str, gain: f64, std: f64) -> SurveyRow {
        SurveyRow {
            recording: recording.into(),
            verdict: "at_floor".into(),
            effects: vec!["gain".into()],
            values: vec![SurveyValue {
                name: "gain: gain".into(),
                value: Some(gain),
                std: Some(std),
                unit: "um/V".into(),
            }],
            ..SurveyRow::default()
        }
    }

    /// Three stages with eight recordings each, spread by 1 %.
    fn rows(gain_of_c: f64) -> Vec<SurveyRow> {
        let of = |unit: &str, gain: f64| -> Vec<SurveyRow> {
            let value = |k: usize| gain * (1.0 + 0.01 * ((k * 37 % 8) as f64 - 3.5) / 3.5);
            (0..8)
                .map(|k| row(&format!("{unit}_{k}.csv"), value(k), 1e-4))
                .collect()
        };
        [of("a", 0.1), of("b", 0.1), of("c", gain_of_c)].concat()
    }

    #[test]
    fn a_value_far_from_all_others_stands_out() {
        let mut rows = rows(0.1);
        assert_eq!(Survey::new(Vec::new(), rows.clone()).outliers, []);
        rows[3].values[0].value = Some(0.13);
        rows[5].verdict = "unexplained".into();
        // A value that is known so badly does not stand out.
        (rows[7].values[0].value, rows[7].values[0].std) = (Some(0.13), Some(0.03));
        rows.push(SurveyRow::refused("d_1.csv", "empty".into()));
        let found = Survey::new(Vec::new(), rows);
        let names: Vec<&str> = found.outliers.iter().map(|o| &*o.recording).collect();
        assert_eq!(names, ["a_3.csv", "a_5.csv"]);
        assert!(found.outliers[0].in_what[0].contains("0.1300, the median is 0.1"));
    }

    #[test]
    fn a_unit_that_differs_is_named() {
        assert_eq!(Survey::new(Vec::new(), rows(0.1)).units, []);
        let found = Survey::new(Vec::new(), rows(0.12)).units;
        let units: Vec<&str> = found.iter().map(|differing| &*differing.unit).collect();
        assert_eq!(units, ["c"]);
    }

    #[test]
    fn a_unit_is_a_folder_or_the_name_before_the_number() {
        let units = ["s/1.csv", "stage_12.csv", "stage-b.2.csv", "007.csv"];
        let units = units.map(|name| row(name, 1.0, 0.0).unit().to_owned());
        assert_eq!(units, ["s", "stage", "stage-b", ""]);
    }
}
