//! What was found, in words: the one place where typed results become sentences.

use super::findings::unlikely;
use super::judgement::Judged;
use super::path::ModelChange;
use super::study::{FAILS_HELD_OUT, Study};
use super::verdict::Reason;
use crate::dataset::drive_variety::DriveVariety;
use crate::dataset::issue::Issue;
use crate::dataset::issue_words;
use crate::dataset::reading_grid::rounding_noise;
use crate::dataset::{Dataset, Role};
use crate::engineering::read_by_name;
use crate::identification::budget::Budget;
use crate::identification::fit::rms_over;
use crate::identification::identifiability::CannotIdentify;
use crate::outcome::{ChangedValue, Diagnosis, Evidence, Finding, Standing, Verdict};
use crate::phrases::{figure, list, nm, spoken};
use hysteron_sim::chain::Model;
use hysteron_sim::effect::{by_id, delay};
use std::f64::consts::TAU;

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| {
        c.to_uppercase().collect::<String>() + letters.as_str()
    })
}

/// Records that no fit has seen and that a model misses by far more than those that judged it.
#[must_use]
pub fn unseen(model: &Model, dataset: &Dataset, judged_um: f64) -> Vec<String> {
    let unseen = dataset.with_role(Role::Test).into_iter();
    let said = |i: usize| {
        let name = &dataset.records[i].name;
        let error_um = rms_over(model, dataset, &[i]);
        let times = error_um / judged_um;
        (times > FAILS_HELD_OUT).then(|| {
            format!(
                "{name}, which no fit has seen, is missed by {} nm, {times:.1} times as much as what judged: look there first. The stage, the sensor or the \
                 drive was another, or what was fitted does not show what happens there",
                nm(error_um)
            )
        })
    };
    unseen.filter_map(said).collect()
}

/// What a step changed, and why.
#[must_use]
pub fn why_step(change: &ModelChange, before: Option<&Judged>, after: &Judged) -> String {
    let fall = before.map_or_else(String::new, |b| {
        match (b.validate_rms_um, after.validate_rms_um) {
            (x, y)
                if nm(b.identify_rms_um) == nm(after.identify_rms_um) && x.map(nm) == y.map(nm) =>
            {
                "; no error falls".to_owned()
            }
            (Some(x), Some(y)) if y > x && after.identify_rms_um < b.identify_rms_um => format!(
                "; fitted error {} to {} nm, held-out error {} to {} nm",
                nm(b.identify_rms_um),
                nm(after.identify_rms_um),
                nm(x),
                nm(y)
            ),
            (Some(x), Some(y)) => format!("; held-out error {} to {} nm", nm(x), nm(y)),
            _ => format!(
                "; error {} to {} nm",
                nm(b.identify_rms_um),
                nm(after.identify_rms_um)
            ),
        }
    });
    match change {
        ModelChange::Start => "the model that was started from".into(),
        ModelChange::Added(id) => {
            let physics = || {
                after
                    .model
                    .effect(id)
                    .map_or_else(String::new, |e| e.effect.declaration().physics)
            };
            let physics = unlikely(&after.model, id).unwrap_or_else(physics);
            format!("{}{fall}", physics.trim_end_matches('.'))
        }
        ModelChange::AddedUnweighed(ids) => format!(
            "{}: added until the search was stopped, and not weighed{fall}",
            list(ids, "and")
        ),
        ModelChange::FinerCreep(how) => {
            format!("creep of {how}: the same effect, described better{fall}")
        }
        ModelChange::FinerHysteresis(how) => {
            format!("hysteresis {how}: the same effect, described better{fall}")
        }
        ModelChange::FittedAgain => format!("all values fitted again, to this recording{fall}"),
        ModelChange::Changed(id) => format!(
            "{} has other values here, all others held{fall}",
            spoken(id)
        ),
    }
}

/// How a candidate stands.
#[must_use]
pub fn why(standing: &Standing) -> &'static str {
    match standing {
        Standing::Named => "every simplest model that the data cannot reject has it",
        Standing::Alternative => "some of the simplest models that the data cannot reject have it",
        Standing::InTheReadings => "the readings show it, whatever the model",
        Standing::LowersErrors => {
            "lowers the errors, and the data do not reject a model without it"
        }
        Standing::Excluded => "lowers the errors, and its own physics excludes the fitted values",
        Standing::Rejected => "fitted, and the data reject the model with it",
        Standing::NotInTheResidual => "a signature like it explains as much by chance",
        Standing::NotFitted => "not fitted in this place: others explain more",
    }
}

/// What has changed, for a reader.
#[must_use]
pub fn changed(values: &[ChangedValue]) -> String {
    let named = |v: &ChangedValue| read_by_name(&v.effect, &v.parameter);
    let from_to = |v: &ChangedValue| {
        let (_, unit, factor) = named(v);
        format!(
            "from {} to {} {unit}",
            figure(factor * v.from),
            figure(factor * v.to)
        )
        .trim_end()
        .to_owned()
    };
    let one = |v: &ChangedValue| {
        let (effect, name) = (spoken(&v.effect), named(v).0);
        match v.parameter.as_str() {
            "scale" => format!("{effect} times {}", figure(v.to)),
            _ if effect == name => format!("{effect} {}", from_to(v)),
            _ => format!("{effect} {name} {}", from_to(v)),
        }
    };
    // Of more than two values of an effect the one that has moved furthest stands for all.
    let of_effect = |group: &[ChangedValue]| match group {
        [_] | [_, _] => group.iter().map(one).collect::<Vec<_>>().join("; "),
        _ => group
            .iter()
            .max_by(|a, b| (a.to - a.from).abs().total_cmp(&(b.to - b.from).abs()))
            .map_or_else(String::new, |furthest| {
                format!(
                    "{} values of {}, {} most, {}",
                    group.len(),
                    spoken(&furthest.effect),
                    named(furthest).0,
                    from_to(furthest)
                )
            }),
    };
    values
        .chunk_by(|a, b| a.effect == b.effect)
        .map(of_effect)
        .collect::<Vec<_>>()
        .join("; ")
}

/// That no drive within the limits of the data distinguishes an effect from another, for a reader.
#[must_use]
pub fn no_drive_decides(other: &str, separation_um: f64) -> String {
    format!(
        "no drive within the limits of this data distinguishes it from {}: on the best the two differ by {:.2} nm",
        spoken(other),
        1e3 * separation_um
    )
}

/// From where a delay counts that was found although nobody specified when the drive of a row acts, for a
/// reader.
fn delay_counts_from(dataset: &Dataset) -> String {
    let period_s = dataset.records.iter().map(|r| r.dt_s()).fold(0.0, f64::max);
    format!(
        " The delay counts from a drive that acts after the reading of its row, which is an assumption. If the drive acts before, the delay is one period \
         ({} ms) longer: specify --timing hold_before_sample or hold_after_sample.",
        figure(1e3 * period_s)
    )
}

/// What a finding says is missing: `delay or sensor bandwidth`.
#[must_use]
pub fn finding(of: &Finding) -> String {
    let others = of
        .or_other_values_of
        .iter()
        .map(|id| format!("other values of {}", spoken(id)));
    let all: Vec<String> = of
        .effects
        .iter()
        .map(|id| spoken(id))
        .chain(others)
        .collect();
    list(&all, "or")
}

/// Several findings: with semicolons where one of them is an "or".
fn joined(names: &[String]) -> String {
    let joint = if names.iter().any(|n| n.contains(" or ")) {
        "; "
    } else {
        ", "
    };
    match names {
        [head @ .., last] if !head.is_empty() => {
            format!(
                "{}{}and {last}",
                head.join(joint),
                if joint == "; " { "; " } else { " " }
            )
        }
        _ => names.concat(),
    }
}

/// The verdict in a sentence or a few.
#[must_use]
pub fn sentence(
    d: &Diagnosis,
    [first, named]: [&Judged; 2],
    dataset: &Dataset,
    study: &Study,
) -> String {
    let mut said = Said::of(d, first, study);
    said.described_by = named.model.effect_ids();
    said.described_by
        .retain(|id| first.model.effect(id).is_none() && !d.named.contains(id));
    let delayed = dataset.timing_is_assumed && d.named.iter().any(|id| id == delay::ID);
    let parts = [
        said.headline(),
        said.other_values(),
        said.not_needed(),
        said.open(),
        said.remainder(),
        said.physics(),
        said.aliases(&named.model, study),
        said.loops(),
        said.one_loop(dataset, study),
        said.issues(dataset),
        if delayed {
            delay_counts_from(dataset)
        } else {
            String::new()
        },
    ];
    parts.concat()
}

/// What all sentences of a verdict speak of.
struct Said<'a> {
    diagnosis: &'a Diagnosis,
    /// The noise in nm, or nothing where it is unknown.
    noise_nm: String,
    /// What the errors are errors of.
    which: &'static str,
    before_um: f64,
    after_um: f64,
    /// What the model of the named effects has to describe its loops more finely than the first.
    described_by: Vec<String>,
    /// Times the noise up to which nothing remains.
    explained: f64,
    reading_step_um: Option<f64>,
    at_least_um: Option<f64>,
    /// What a model from before left when it was made.
    left_then_um: Option<f64>,
    to_go_on: &'static str,
}

/// What lets a search that its budget ended go on.
#[must_use]
pub fn to_go_on(budget: &Budget) -> &'static str {
    if budget.ends_by_steps() {
        "To search on, give a larger most_steps in a file with --policy."
    } else {
        "To search on, give a longer --within."
    }
}

impl<'a> Said<'a> {
    fn of(d: &'a Diagnosis, first: &Judged, study: &Study) -> Self {
        let floor_um = d.noise_floor_um;
        // Each number is of the model that has the named effects, or nothing more than the first, and no others.
        let after = if matches!(d.verdict, Verdict::Unexplained | Verdict::Undecidable) {
            d.residual_rms_after_um
        } else {
            d.residual_rms_named_um
        };
        Self {
            diagnosis: d,
            noise_nm: floor_um.map(nm).unwrap_or_default(),
            which: if first.validate_rms_um.is_some() {
                "held-out error"
            } else {
                "error"
            },
            before_um: first.error_um(),
            after_um: after.validate.unwrap_or(after.identify),
            described_by: Vec::new(),
            explained: study.policy.explained,
            reading_step_um: study.reading_step_um,
            at_least_um: study.at_least_um,
            left_then_um: first.model.identified.as_ref().map(|then| then.error_um),
            to_go_on: to_go_on(&study.budget),
        }
    }

    fn noise(&self) -> String {
        match (&self.noise_nm, self.at_least_um) {
            (known, _) if !known.is_empty() => format!("the noise is {known} nm"),
            (_, Some(least_um)) => format!("the noise is at least {} nm", nm(least_um)),
            _ => "the noise is unknown".into(),
        }
    }

    fn fell(&self) -> bool {
        self.before_um > self.explained * self.after_um
    }

    /// The model from before leaves what it left when it was made.
    fn is_as_then(&self) -> bool {
        self.left_then_um
            .is_some_and(|then_um| self.before_um <= self.explained * then_um)
    }

    fn headline(&self) -> String {
        let (d, which, before, after, noise) = (
            self.diagnosis,
            self.which,
            nm(self.before_um),
            nm(self.after_um),
            self.noise(),
        );
        match d.verdict {
            Verdict::AtFloor if !d.changed.is_empty() => format!(
                "Nothing is missing that this data could show: the {which} falls from {before} to {after} nm with other values; {noise}."
            ),
            Verdict::AtFloor if self.fell() && !self.described_by.is_empty() => format!(
                "Nothing is missing that this data could show, but the loops are others: with {}, fitted again, the {which} falls from \
                 {before} to {after} nm; {noise}.",
                list(&self.described_by, "and")
            ),
            Verdict::AtFloor if self.fell() => format!(
                "Nothing is missing that this data could show, but the values are others: fitted again to it, the same effects bring the \
                 {which} from {before} to {after} nm; {noise}."
            ),
            Verdict::AtFloor => format!(
                "Nothing is missing that this data could show: the {which} is {after} nm, {noise}."
            ),
            Verdict::Named if d.findings.iter().all(|f| f.evidence == Evidence::Readings) => {
                self.coarse_readings()
            }
            Verdict::Named | Verdict::Ambiguous
                if d.findings.iter().all(|f| f.effects.is_empty()) =>
            {
                let names: Vec<String> = d.findings.iter().map(finding).collect();
                format!(
                    "{} explain what changed: with them the {which} falls from {before} to {after} nm; {noise}.",
                    capital(&joined(&names))
                )
            }
            Verdict::Named | Verdict::Ambiguous => {
                let names: Vec<String> = d
                    .findings
                    .iter()
                    .filter(|f| !f.effects.is_empty())
                    .map(finding)
                    .collect();
                let plural = names.len() > 1;
                let ambiguous = if d.verdict == Verdict::Ambiguous {
                    " Where it says \"or\", this data cannot distinguish them: decide by what you know of the apparatus."
                } else {
                    ""
                };
                format!(
                    "{} {} missing: with {} the {which} falls from {before} to {after} nm; {noise}.{ambiguous}",
                    capital(&joined(&names)),
                    if plural { "are" } else { "is" },
                    if plural { "them" } else { "it" }
                )
            }
            Verdict::Unexplained if !self.fell() && self.is_as_then() => format!(
                "Nothing is missing that was not missing then: the {which} is {before} nm, the model left {} nm when it was made, and no \
                 known effect lowers it beyond chance; {noise}.",
                nm(self.left_then_um.unwrap_or_default())
            ),
            Verdict::Unexplained => {
                let best = if self.fell() {
                    format!(
                        "the best model found leaves {after} nm, but the simplest that the data cannot reject share no effect"
                    )
                } else {
                    "no known effect lowers it beyond chance".into()
                };
                format!(
                    "Something is missing that the library does not have: the {which} is {before} nm, {noise}, and {best}."
                )
            }
            Verdict::Undecidable => self.undecidable(),
        }
    }

    fn undecidable(&self) -> String {
        let (d, which, before, after, noise) = (
            self.diagnosis,
            self.which,
            nm(self.before_um),
            nm(self.after_um),
            self.noise(),
        );
        match d.reason {
            Some(Reason::Stopped) => {
                format!(
                    "Stopped before the evidence was weighed: the {which} is {after} nm, at the start {before}; {noise}.{}",
                    self.so_far()
                )
            }
            Some(Reason::OutOfTime) => {
                format!(
                    "Not decided within the budget: the {which} is {after} nm, at the start {before}; {noise}.{} {}",
                    self.so_far(),
                    self.to_go_on
                )
            }
            Some(Reason::ManyAlternatives) => format!(
                "Something is missing that this data cannot name: {} do as well as each other. The {which} is {before} nm, with one of them {after}; \
                 {noise}. Record a drive on which they differ.",
                list(&d.so_far, "and")
            ),
            Some(Reason::OneMotion) => format!(
                "All drives here repeat one motion, on which loops, lags, delays and modes look alike, so nothing can be named: the {which} is {after} nm, at \
                 the start {before}; {noise}.{} Record triangles of several heights and several frequencies: `hysteron drives` writes them.",
                self.so_far()
            ),
            Some(Reason::ValuesOpen) => format!(
                "With {} the {which} falls from {before} to {after} nm ({noise}), but this data fixes none of its values, so it may stand for something else. \
                 Record longer, or other drives: `hysteron drives` writes them.",
                list(&d.so_far, "and")
            ),
            Some(Reason::BelowTheNoise) => format!(
                "The {which} is {after} nm, below the {} nm of noise that the {} shows: one of them is wrong, and nothing can be decided until it is \
                 known which.",
                self.noise_nm, d.floor_basis
            ),
            Some(Reason::NoiseUnknown) | None => {
                let so_far = if self.fell() {
                    format!("a new fit brings the {which} from {before} to {after} nm")
                } else {
                    format!("no effect lowers the {which} by more than chance")
                };
                format!(
                    "Nothing in this data shows the noise, so nobody can say whether more is missing; {so_far}."
                )
            }
            Some(_) => "Nothing can be decided.".into(),
        }
    }

    /// What stands beside names without being one.
    fn open(&self) -> String {
        let d = self.diagnosis;
        if d.so_far.is_empty() || d.verdict == Verdict::Undecidable {
            return String::new();
        }
        let leaves = nm(d.remainder.rms_um);
        let at_the_end = if leaves == nm(self.after_um) || !d.also_in_the_model.is_empty() {
            String::new()
        } else {
            format!(
                " The model at the end has {}: its {} is {leaves} nm.",
                match d.so_far.as_slice() {
                    [_] => "it",
                    _ => "the best of these",
                },
                self.which
            )
        };
        format!(" Not decided: {}.{at_the_end}", list(&d.so_far, "and"))
    }

    fn so_far(&self) -> String {
        if self.diagnosis.so_far.is_empty() {
            return String::new();
        }
        format!(
            " The best model so far has {}.",
            list(&self.diagnosis.so_far, "and")
        )
    }

    fn coarse_readings(&self) -> String {
        let step_um = self.reading_step_um.unwrap_or(0.0);
        format!(
            "{} is missing: the readings are whole steps of {} nm, which make {} of the {} nm of noise. The {} is {} nm.",
            capital(&list(&self.diagnosis.named, "and")),
            nm(step_um),
            nm(rounding_noise(step_um)),
            self.noise_nm,
            self.which,
            nm(self.after_um)
        )
    }

    fn other_values(&self) -> String {
        let values = &self.diagnosis.changed;
        if values.is_empty() {
            String::new()
        } else {
            format!(" Other values in this recording: {}.", changed(values))
        }
    }

    /// What the model at the end has beside the named effects.
    fn not_needed(&self) -> String {
        let d = self.diagnosis;
        if d.also_in_the_model.is_empty()
            || !matches!(d.verdict, Verdict::Named | Verdict::Ambiguous)
        {
            return String::new();
        }
        format!(
            " Also in the model, not named: {}; with {} the {} is {} nm.",
            list(&d.also_in_the_model, "and"),
            if d.also_in_the_model.len() > 1 {
                "them"
            } else {
                "it"
            },
            self.which,
            nm(d.remainder.rms_um)
        )
    }

    /// What stays beside the names, or why nobody knows.
    fn remainder(&self) -> String {
        let d = self.diagnosis;
        if !matches!(d.verdict, Verdict::Named | Verdict::Ambiguous) {
            return String::new();
        }
        match (d.remainder.times_noise, d.reason) {
            (_, Some(Reason::BelowTheNoise)) => {
                format!(
                    " That is below the noise of {} nm that the {} shows: one of them is wrong.",
                    self.noise_nm, d.floor_basis
                )
            }
            (None, Some(Reason::NoiseUnknown)) => {
                " The noise is unknown, so nobody can say whether more is missing.".into()
            }
            (Some(times), _) if times > self.explained => {
                format!(
                    " {} nm stay unexplained, {times:.1} times the noise.",
                    nm(d.remainder.rms_um)
                )
            }
            _ => String::new(),
        }
    }

    /// What the physics says of the findings: which of two readings is likelier, or what the values of an
    /// effect say instead of its name.
    fn physics(&self) -> String {
        let d = self.diagnosis;
        let against = |id: &String| {
            d.candidates
                .iter()
                .find(|c| c.effect == *id)
                .and_then(|c| c.unlikely_because.clone())
        };
        let of = |f: &Finding| -> Option<String> {
            let (first, others) = f.effects.split_first()?;
            if let Some(reason) = against(first) {
                return Some(format!(" {}: {reason}.", capital(&spoken(first))));
            }
            let (other, reason) = others.iter().find_map(|o| Some((o, against(o)?)))?;
            Some(format!(
                " {} is likelier than {}: {reason}.",
                capital(&spoken(first)),
                spoken(other)
            ))
        };
        let excluded = d
            .candidates
            .iter()
            .filter(|c| c.standing == Standing::Excluded && c.unlikely_because.is_some());
        let none = excluded.map(|c| {
            format!(
                " {} lowers the errors but is excluded: {}.",
                capital(&spoken(&c.effect)),
                c.unlikely_because.clone().unwrap_or_default()
            )
        });
        d.findings.iter().filter_map(of).chain(none).collect()
    }

    /// Modes that were named and may be faster ones: no reading shows on which side of half the rate they are.
    fn aliases(&self, model: &Model, study: &Study) -> String {
        let rate_hz = study.overview.sample_rate_max_hz;
        let named = self.diagnosis.findings.iter().flat_map(|f| &f.effects);
        let rings = named.filter_map(|id| {
            let effect = model.effect(id)?;
            let mut motions = effect
                .effect
                .free_motions(model, &effect.values())
                .into_iter();
            let rings = motions.find(|m| m.frequency_rad_s > RINGS * m.decay_per_s)?;
            let hz = rings.frequency_rad_s / TAU;
            (hz > ALIASES_FROM * rate_hz).then_some((id, hz))
        });
        let each = rings.map(|(id, hz)| {
            format!(
                " The {} at {hz:.0} Hz may be an alias of {:.0} Hz: at {rate_hz:.0} samples a second both read alike, unless a filter stands in front of the \
                 converter.",
                spoken(id),
                rate_hz - hz
            )
        });
        each.collect()
    }

    fn loops(&self) -> String {
        let Some((end, others)) = self.diagnosis.loops.split_first() else {
            return String::new();
        };
        let as_well = if others.is_empty() {
            String::new()
        } else {
            format!("; loops {} meet this data as well", list(others, "or"))
        };
        format!(" The loops are {end}{as_well}.")
    }

    /// The named structure of loops is one of several that the same single loop may have.
    fn one_loop(&self, dataset: &Dataset, study: &Study) -> String {
        let is_structure = |id: &String| by_id(id).is_some_and(|e| e.declaration().is_main());
        let named = self.diagnosis.named.iter().find(|id| is_structure(id));
        let one = DriveVariety::of(dataset, &study.split.both()).one_loop();
        named.filter(|_| one).map_or_else(String::new, |id| {
            format!(
                " The drive runs through one loop, which does not distinguish {} from other structures of loops; turns inside the range do.",
                spoken(id)
            )
        })
    }

    /// What the model shows about the recording, each kind once; what the readings show by themselves stands
    /// in the data set's own remarks.
    fn issues(&self, dataset: &Dataset) -> String {
        let issues: Vec<&Issue> = self
            .diagnosis
            .issues
            .iter()
            .filter(|issue| !dataset.issues.contains(issue))
            .collect();
        let kind = |issue: &Issue| std::mem::discriminant(&issue.kind);
        let told = issues.iter().enumerate().filter(|(at, issue)| {
            issues[..*at]
                .iter()
                .all(|before| kind(before) != kind(issue))
        });
        let in_words = |(at, issue): (usize, &&Issue)| {
            let others = issues[at + 1..]
                .iter()
                .filter(|other| kind(other) == kind(issue));
            let records: Vec<String> = others.filter_map(|other| other.record.clone()).collect();
            let same = if records.is_empty() {
                String::new()
            } else {
                format!(" The same in {}.", records.join(", "))
            };
            format!(" {}.{same}", issue_words::sentence(issue))
        };
        told.map(in_words).collect()
    }
}

/// What turns by so many times as much as it decays has a damping ratio below a half and rings.
const RINGS: f64 = 1.7;
/// Share of the rate from which a mode may be an alias. A drive that is held between samples shakes what lies
/// as far below the rate by a ninth of what it does itself, or more.
const ALIASES_FROM: f64 = 0.1;

/// Records whose speeds differ by more than this factor do not move at one speed.
const ANOTHER_SPEED: f64 = 1.2;

/// Parameters of an effect that are listed where the data leave more open.
const NAMED_PARAMETERS: usize = 4;

/// What the data leave open.
#[must_use]
pub fn cannot_identify(what: &CannotIdentify) -> String {
    match what {
        CannotIdentify::AnyOf { effect } => {
            format!("{effect}: this data fixes none of its parameters by itself: other values of them do nearly as well together")
        }
        CannotIdentify::SomeOf { effect, parameters } => {
            // Of a density or a surface nobody reads them all; the values in files say it of each.
            let (first, further) = parameters.split_at(parameters.len().min(NAMED_PARAMETERS));
            let further = match further.len() {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("{effect}: this data does not fix {}{further}", first.join(", "))
        }
        CannotIdentify::MinorLoops => {
            "minor loops: the drive always turns at the same two voltages, so only one loop is known; nested reversals are a guess".into()
        }
        CannotIdentify::RateDependence { speed_v_s, .. } if *speed_v_s < 0.5 => {
            "rate dependence: the drive jumps and holds, at no speed between, so loops at other speeds are a guess".into()
        }
        CannotIdentify::RateDependence {
            speed_v_s,
            slowest_v_s,
        } if *speed_v_s > ANOTHER_SPEED * slowest_v_s => format!(
            "rate dependence: the drive moves at {slowest_v_s:.0} to {speed_v_s:.0} V/s, so loops at other speeds are a guess"
        ),
        CannotIdentify::RateDependence { speed_v_s, .. } => {
            format!("rate dependence: the drive moves at one speed only (about {speed_v_s:.0} V/s), so loops at other speeds are a guess")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Record;
    use hysteron_sim::chain::EffectInstance;

    /// The sensor slips by 0.4 um in the middle of one of two records that no fit has seen.
    #[test]
    fn an_unseen_record_is_reported_where_the_model_misses_it() {
        let record = |name: &str, slip_um: f64| {
            let drive_v: Vec<f64> = (0..2000)
                .map(|k| 50.0 - 50.0 * (0.006 * f64::from(k)).cos())
                .collect();
            let before_v = std::iter::once(0.0).chain(drive_v.iter().copied());
            let slip = |k: usize| if k < 1000 { 0.0 } else { slip_um };
            let read = before_v.take(2000).enumerate();
            let read_um = read.map(|(k, v)| 0.1 * v + slip(k)).collect();
            Record::new(name, 1000.0, drive_v, read_um).with_role(Role::Test)
        };
        let records = vec![record("alike", 0.0), record("slipped", 0.4)];
        let dataset = Dataset::new("d", 0.0, 100.0, records).unwrap();
        let mut model = Model::new(0.0, 100.0);
        let gain = by_id("gain").unwrap();
        model.add(EffectInstance::new(gain, &dataset.overview(), &[0.1]));
        let said = unseen(&model, &dataset, 0.01);
        // Half of the slip is in the constant of the record.
        assert!(said.len() == 1 && said[0].contains("slipped"), "{said:?}");
        assert!(said[0].contains("200 nm, 20.0 times"), "{said:?}");
    }

    #[test]
    fn an_error_far_below_a_nanometre_has_figures() {
        assert_eq!(
            [2e-9, 4.9e-6, 5.7e-4, 0.0123].map(nm),
            ["2.0e-6", "4.9e-3", "0.57", "12.3"]
        );
        assert_eq!(nm(0.0), "0.00");
    }

    #[test]
    fn of_many_values_the_one_that_moved_furthest_is_told() {
        let value = |effect: &str, parameter: &str, from: f64, to: f64| ChangedValue {
            effect: effect.into(),
            parameter: parameter.into(),
            from,
            to,
        };
        let weights = [(1, 0.1, 0.11), (2, -0.85, -2.0), (3, 0.2, 0.1)];
        let mut values: Vec<ChangedValue> = weights
            .iter()
            .map(|(k, from, to)| value("play_operators", &format!("weight_{k}_um"), *from, *to))
            .collect();
        values.push(value("delay", "delay_s", 1e-4, 2e-4));
        let said = changed(&values);
        assert!(
            said.starts_with(
                "3 values of play operators, weight 2 most, from -0.8500 to -2.000 um; delay "
            ),
            "{said}"
        );
    }
}
