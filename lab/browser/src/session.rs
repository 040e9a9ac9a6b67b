//! One person at the page: the data, the model, what was found last.

use crate::answers::{self, Answer};
use crate::asker::{Asker, Teller};
use crate::recording::{self, Said, UploadedRecording};
use crate::served::Served;
use crate::servo::{self, ServoQuestion};
use hysteron::analyse::{Options, Outcome, Start, analyse};
use hysteron::diagnosis::judgement::{Split, require_finite};
use hysteron::figures::{fit_figures, step_figures};
use hysteron::identification::fit::{dot, residual, rms};
use hysteron::identification::linearisation::{counted_of, fill_left_out};
use hysteron::identification::noise_floor::{NoiseFloor, noise_floor};
use hysteron::identify::{Identification, add, identify};
use hysteron::origin::read_as_recorded;
use hysteron::servo::design::ServoDesign;
use hysteron::spectrum::amplitude_density;
use hysteron::synthetic::case::{CaseOrder, simulate_case};
use hysteron::{Error, Record, Result, model_file, series};
use hysteron_report::{comparison_report, explain_page, explain_report};
use hysteron_sim::chain::Model;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A file that comes with a question; its bytes stand behind the JSON, in the order of the list.
#[derive(Deserialize)]
struct FileEntry {
    name: String,
    bytes: usize,
}

/// A model that is tried without being kept.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Trial {
    /// Values of all parameters, in the order of effects and parameters; those of the model where there are
    /// none.
    values: Option<Vec<Vec<f64>>>,
    /// Effects that are left out.
    off: Vec<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Question {
    /// Reads a data set.
    Read {
        files: Vec<FileEntry>,
        #[serde(default)]
        said: Box<Said>,
    },
    /// Reads the data set that the program was started with.
    Served {
        #[serde(default)]
        said: Box<Said>,
    },
    /// Simulates a data set with hidden effects.
    Plant {
        hidden: Vec<(String, f64)>,
        base: Vec<String>,
        seed: u64,
    },
    /// Drive and reading of a record.
    Signals { record: usize },
    /// What a trial leaves of one record, and how well it meets all; `quick` leaves out the map of the other
    /// records.
    Compare {
        record: usize,
        #[serde(default)]
        trial: Trial,
        #[serde(default)]
        quick: bool,
    },
    /// Measured and modelled signals of a record as a table, as the command line writes them.
    Series {
        record: usize,
        #[serde(default)]
        trial: Trial,
    },
    /// Takes a trial as the model.
    Keep { trial: Trial },
    /// Fits a list of effects.
    Identify { effects: String },
    /// The main job: from a list of effects, or from the model as it is.
    Explain { from: Option<String> },
    /// Takes the model of a step of the last explanation.
    Take { step: usize },
    /// Adds an effect and fits again.
    Add { effect: String },
    /// From the model to a servo.
    Servo { about: ServoQuestion },
    /// The model as text.
    Save {},
    /// A model from text.
    Load { text: String, name: String },
    /// Every figure of the last explanation, or of the model as it is, as the command line writes them.
    Figures { seconds: f64, of_search: bool },
    /// The page of the last explanation, or of the model as it is.
    Report { of_search: bool },
    /// The first question of a page: all effects, and what the program was started with.
    Begin {},
}

/// The data at hand.
struct Data {
    recording: UploadedRecording,
    floor: NoiseFloor,
    split: Split,
}

/// What one person has at hand.
#[derive(Default)]
pub struct LabSession {
    data: Option<Data>,
    model: Option<Model>,
    found: Option<Outcome>,
    servo: Option<ServoDesign>,
    served: Option<Arc<dyn Served>>,
}

/// Cancelled work changes nothing: data and model stay as they were.
fn unless_taken_back<T>(found: T, asker: &dyn Asker) -> Result<T> {
    if asker.has_left() {
        Err(Error::Stopped)
    } else {
        Ok(found)
    }
}

fn no_data() -> Error {
    Error::new(
        "",
        "there is no recording yet; drop one, or take the example",
    )
}

fn no_model() -> Error {
    Error::new("", "there is no model yet")
}

impl LabSession {
    /// For a program that was started with a data set.
    #[must_use]
    pub fn serving(served: Option<Arc<dyn Served>>) -> Self {
        Self {
            served,
            ..Self::default()
        }
    }

    /// Answers a question: eight bytes with the length of its JSON, the JSON, the bytes of its files. An
    /// error is an answer too, with the key `error`; `knows_nothing` says that no data is at hand.
    pub fn answer(&mut self, question: &[u8], asker: &dyn Asker) -> Vec<u8> {
        let answer =
            parts(question).and_then(|(question, bytes)| self.asked(question, bytes, asker));
        answer
            .unwrap_or_else(|error| {
                Answer::of(
                    json!({ "error": error.to_string(), "knows_nothing": self.data.is_none() }),
                )
            })
            .bytes()
    }

    fn asked(&mut self, question: Question, bytes: &[u8], asker: &dyn Asker) -> Result<Answer> {
        match question {
            Question::Read { files, said } => self.read(&named_files(&files, bytes)?, &said),
            Question::Served { said } => {
                let served = self.served.as_ref().ok_or_else(no_data)?;
                let recording = served.read(&said)?;
                Ok(self.opened(recording))
            }
            Question::Plant { hidden, base, seed } => {
                let case = simulate_case(
                    &CaseOrder {
                        hidden,
                        base,
                        hysteresis: "hysteresis".into(),
                        seed,
                    },
                    "hidden",
                )?;
                self.read(&case.files, &Said::default())
            }
            Question::Signals { record } => Ok(answers::signals(self.record(record)?)),
            Question::Compare {
                record,
                trial,
                quick,
            } => self.compare(record, &trial, quick),
            Question::Series { record, trial } => {
                let (record, model) = (self.record(record)?, self.tried(&trial)?);
                let text = series::csv(record, &[("modelled", &model)]);
                Ok(Answer::of(
                    json!({ "text": text, "name": series::file_name(record) }),
                ))
            }
            Question::Keep { trial } => {
                let model = self.tried(&trial)?;
                Ok(Answer::of(answers::model(self.model.insert(model))))
            }
            Question::Identify { effects } => {
                let effects = model_file::effects_named(&effects)?;
                let found = identify(&self.data()?.recording.dataset, &effects, &Teller(asker))?;
                Ok(self.fitted(unless_taken_back(found, asker)?))
            }
            Question::Add { effect } => {
                let effect = model_file::effect_named(&effect)?;
                let model = self.model.clone().ok_or_else(no_model)?;
                let found = add(
                    &effect,
                    model,
                    &self.data()?.recording.dataset,
                    &Teller(asker),
                )?;
                Ok(self.fitted(unless_taken_back(found, asker)?))
            }
            Question::Explain { from } => self.explain(from.as_deref(), asker),
            Question::Take { step } => {
                let found = self
                    .found
                    .as_ref()
                    .ok_or_else(|| Error::new("", "nothing was looked for yet"))?;
                let last = found.steps.len() - 1;
                let model = if step >= last {
                    found.model.clone()
                } else {
                    found.steps[step].judged.model.clone()
                };
                Ok(Answer::of(answers::model(self.model.insert(model))))
            }
            Question::Servo { about } => {
                let model = self.model.as_ref().ok_or_else(no_model)?;
                let data = self.data.as_ref().ok_or_else(no_data)?;
                unless_taken_back(
                    servo::answer(&about, &mut self.servo, model, &data.recording.dataset)?,
                    asker,
                )
            }
            Question::Save {} => {
                let model = self.model.as_ref().ok_or_else(no_model)?;
                Ok(Answer::of(
                    json!({ "text": model_file::to_toml(model, &self.data()?.recording.dataset.name)? }),
                ))
            }
            Question::Load { text, name } => {
                let model = model_file::from_toml(&text, &name)?;
                if let Some(data) = &mut self.data {
                    if let Some(dataset) = read_as_recorded(&model, &data.recording.dataset) {
                        data.recording.dataset = dataset;
                    }
                    require_finite(&model, &data.recording.dataset, &data.split.both())?;
                }
                Ok(Answer::of(answers::model(self.model.insert(model))))
            }
            Question::Figures { seconds, of_search } => {
                let (data, model) = (self.data()?, self.model.as_ref().ok_or_else(no_model)?);
                let dataset = &data.recording.dataset;
                let figures = match self.found.as_ref().filter(|_| of_search) {
                    Some(found) => found.figures(dataset, seconds),
                    None => fit_figures(model, dataset, &data.floor, Vec::new(), &[], seconds),
                };
                let text =
                    serde_json::to_string_pretty(&figures).map_err(|e| Error::new("figures", e))?;
                Ok(Answer::of(json!({ "text": text + "\n" })))
            }
            Question::Report { of_search } => {
                let (data, model) = (self.data()?, self.model.as_ref().ok_or_else(no_model)?);
                let dataset = &data.recording.dataset;
                let report = match self.found.as_ref().filter(|_| of_search) {
                    Some(found) => explain_report(found, dataset, "the lab page".into()),
                    None => {
                        let figures =
                            fit_figures(model, dataset, &data.floor, Vec::new(), &[], 0.0);
                        comparison_report(model, dataset, &figures, "the lab page".into())
                    }
                };
                Ok(Answer::of(
                    json!({ "text": explain_page(&report).to_html() }),
                ))
            }
            Question::Begin {} => {
                let mut told = answers::effects();
                if let (Value::Object(told), Some(served)) = (&mut told, &self.served) {
                    told.insert(
                        "served".into(),
                        json!({ "name": served.name(), "base_effects": served.base_effects() }),
                    );
                }
                Ok(Answer::of(told))
            }
        }
    }

    fn data(&self) -> Result<&Data> {
        self.data.as_ref().ok_or_else(no_data)
    }

    fn record(&self, index: usize) -> Result<&Record> {
        self.data()?
            .recording
            .dataset
            .records
            .get(index)
            .ok_or_else(|| Error::new("record", "there is no such record"))
    }

    fn read(&mut self, files: &BTreeMap<String, Vec<u8>>, said: &Said) -> Result<Answer> {
        let recording = recording::read(files, said)?;
        Ok(self.opened(recording))
    }

    fn opened(&mut self, recording: UploadedRecording) -> Answer {
        let (floor, split) = (
            noise_floor(&recording.dataset),
            Split::of(&recording.dataset),
        );
        let answer = Answer::of(answers::recording(&recording, &floor));
        self.found = None;
        self.data = Some(Data {
            recording,
            floor,
            split,
        });
        answer
    }

    /// The model with other values and without some effects.
    fn tried(&self, trial: &Trial) -> Result<Model> {
        let mut model = self.model.clone().ok_or_else(no_model)?;
        for (effect, values) in model.effects.iter_mut().zip(trial.values.iter().flatten()) {
            for (parameter, value) in effect.parameters.iter_mut().zip(values) {
                if *value != parameter.value && value.is_finite() {
                    parameter.value =
                        value.clamp(parameter.parameter.lower, parameter.parameter.upper);
                    parameter.std = None;
                }
            }
        }
        model.effects.retain(|e| !trial.off.contains(&e.id));
        Ok(model)
    }

    fn compare(&self, shown: usize, trial: &Trial, quick: bool) -> Result<Answer> {
        let (data, model) = (self.data()?, self.tried(trial)?);
        let (dataset, record) = (&data.recording.dataset, self.record(shown)?);
        let residuals: Vec<Vec<f64>> = dataset
            .records
            .iter()
            .map(|r| residual(&model, r))
            .collect();
        if residuals.iter().flatten().any(|e| !e.is_finite()) {
            require_finite(
                &model,
                dataset,
                &(0..dataset.records.len()).collect::<Vec<_>>(),
            )?;
        }
        let counted: Vec<Vec<f64>> = dataset
            .records
            .iter()
            .zip(&residuals)
            .map(|(r, residual)| counted_of(r, residual))
            .collect();
        let over = |records: &[usize]| {
            let (sum, count) = records.iter().fold((0.0, 0), |(s, n), i| {
                (s + dot(&counted[*i], &counted[*i]), n + counted[*i].len())
            });
            (count > 0).then(|| (sum / count as f64).sqrt())
        };
        let row = |i: usize| {
            if quick && i != shown {
                Value::Null
            } else {
                answers::map_row(dataset, &dataset.records[i], &residuals[i])
            }
        };
        let map: Vec<Value> = (0..dataset.records.len()).map(row).collect();
        let mut drawn = residuals[shown].clone();
        fill_left_out(record, &mut drawn, 0.0);
        let spectrum = amplitude_density(&drawn, record.sample_rate_hz);
        let lines = counted.iter().map(|r| json!({ "rms_um": rms(r), "max_um": r.iter().fold(0.0, |m: f64, e| m.max(e.abs())) }));
        let json = json!({
            "records": lines.collect::<Vec<_>>(),
            "fitted_um": over(&data.split.identify), "held_out_um": over(&data.split.validate),
            "map": map,
        });
        Ok(Answer {
            json,
            columns: vec![drawn, spectrum.frequency_hz, spectrum.density],
        })
    }

    fn fitted(&mut self, found: Identification) -> Answer {
        let mut json = answers::model(&found.model);
        if let Value::Object(object) = &mut json {
            let open = found
                .cannot_identify
                .iter()
                .map(hysteron::diagnosis::words::cannot_identify);
            object.insert("cannot_identify".into(), json!(open.collect::<Vec<_>>()));
            object.insert("steps".into(), json!(step_figures(&found.steps)));
        }
        self.model = Some(found.model);
        Answer::of(json)
    }

    fn explain(&mut self, from: Option<&str>, asker: &dyn Asker) -> Result<Answer> {
        let effects = from.map(model_file::effects_named).transpose()?;
        let start = match &effects {
            Some(effects) => Start::Effects(effects),
            None => Start::Model(self.model.clone().ok_or_else(no_model)?),
        };
        let dataset = &self.data()?.recording.dataset;
        let found = unless_taken_back(
            analyse(dataset, start, &Options::default(), &Teller(asker))?,
            asker,
        )?;
        let answer = answers::explanation(&found, dataset, &found.figures(dataset, 0.0));
        self.model = Some(found.steps[0].judged.model.clone());
        // What was found is of the corrected recording, and so is all that the page shows beside it.
        if let (Some(data), Some(corrected)) = (&mut self.data, &found.corrected) {
            data.recording.dataset.clone_from(corrected);
        }
        self.found = Some(found);
        Ok(answer)
    }
}

/// A question and the bytes behind it.
fn parts(question: &[u8]) -> Result<(Question, &[u8])> {
    let wrong = |what: String| Error::new("question", what);
    let (length, rest) = question
        .split_first_chunk::<8>()
        .ok_or_else(|| wrong("is cut off".into()))?;
    let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
    let (text, bytes) = rest
        .split_at_checked(length)
        .ok_or_else(|| wrong("is cut off".into()))?;
    // `{"ask": "read", ..}` as `{"read": {..}}`: a tag among the fields is not read where another crate asks
    // for numbers of any precision.
    let mut fields: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(text).map_err(|e| wrong(e.to_string()))?;
    let asked = fields
        .remove("ask")
        .and_then(|ask| ask.as_str().map(String::from))
        .unwrap_or_default();
    let question = serde_json::Value::from(serde_json::Map::from_iter([(asked, fields.into())]));
    Ok((
        serde_json::from_value(question).map_err(|e| wrong(e.to_string()))?,
        bytes,
    ))
}

fn named_files(entries: &[FileEntry], bytes: &[u8]) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut rest = bytes;
    let mut files = BTreeMap::new();
    for entry in entries {
        let (file, after) = rest
            .split_at_checked(entry.bytes)
            .ok_or_else(|| Error::new(&entry.name, "is cut off"))?;
        if files.insert(entry.name.clone(), file.to_vec()).is_some() {
            return Err(Error::new(
                &entry.name,
                "is there twice; expected files of different names",
            ));
        }
        rest = after;
    }
    Ok(files)
}
