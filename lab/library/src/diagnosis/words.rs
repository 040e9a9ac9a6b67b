//! What was found, in words: the one place where typed results become sentences.

use super::decision::Decision;
use super::drive_timing::OwnRow;
use super::elsewhere::{ChangedValue, Hypothesis};
use super::feedback::Feedback;
use super::initial_states::{OffZero, OtherStates};
use super::judgement::Judged;
use super::path::Change;
use super::policy::Policy;
use super::unanswered::Unanswered;
use super::verdict::{CandidateFigures, Diagnosis, Finding, Found, Verdict};
use crate::dataset::Dataset;
use crate::dataset::reading_grid::rounding_noise;
use crate::dataset::reading_limits::ReadingLimit;
use crate::identification::identifiability::CannotIdentify;
use crate::identification::noise_floor::NoiseFloor;
use hysteron_sim::chain::Model;
use hysteron_sim::effect::hysteresis;

/// Nanometres with three figures.
#[must_use]
pub fn nm(um: f64) -> String {
    let value = 1e3 * um;
    if value >= 100.0 {
        format!("{value:.0}")
    } else if value >= 10.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.2}")
    }
}

/// An identifier as it is read.
#[must_use]
pub fn spoken(id: &str) -> String {
    id.replace('_', " ")
}

/// A list of identifiers as it is read.
#[must_use]
pub fn list(ids: &[String], joint: &str) -> String {
    match ids {
        [] => String::new(),
        [one] => spoken(one),
        [head @ .., last] => format!("{} {joint} {}", head.iter().map(|i| spoken(i)).collect::<Vec<_>>().join(", "), spoken(last)),
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |c| c.to_uppercase().collect::<String>() + letters.as_str())
}

/// A value with four figures.
#[must_use]
pub fn figure(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    if value.abs() >= 1e6 || value.abs() < 1e-4 { format!("{value:.3e}") } else { format!("{value:.digits$}") }
}

/// What a step changed, and why.
#[must_use]
pub fn why_step(change: &Change, before: Option<&Judged>, after: &Judged) -> String {
    let fall = before.map_or_else(String::new, |b| match (b.validate_rms_um, after.validate_rms_um) {
        (x, y) if nm(b.identify_rms_um) == nm(after.identify_rms_um) && x.map(nm) == y.map(nm) => "; no error falls".to_owned(),
        (Some(x), Some(y)) if y > x && after.identify_rms_um < b.identify_rms_um => format!(
            "; fitted error {} to {} nm, held-out error {} to {} nm",
            nm(b.identify_rms_um),
            nm(after.identify_rms_um),
            nm(x),
            nm(y)
        ),
        (Some(x), Some(y)) => format!("; held-out error {} to {} nm", nm(x), nm(y)),
        _ => format!("; error {} to {} nm", nm(b.identify_rms_um), nm(after.identify_rms_um)),
    });
    match change {
        Change::Start => "the model that was started from".into(),
        Change::Added(id) => {
            let physics = || after.model.effect(id).map_or_else(String::new, |e| e.effect.declaration().physics);
            let physics = after.model.ruled_out_because(id).unwrap_or_else(physics);
            format!("{}{fall}", physics.trim_end_matches('.'))
        }
        Change::AddedUnweighed(ids) => format!("{}: added until the search was stopped, and not weighed{fall}", list(ids, "and")),
        Change::FinerCreep(how) => format!("creep of {how}: the same effect, described better{fall}"),
        Change::FinerHysteresis(how) => format!("hysteresis {how}: the same effect, described better{fall}"),
        Change::FittedAgain => format!("all values fitted again, to this recording{fall}"),
        Change::Changed(id) => format!("{} has other values here, all others held{fall}", spoken(id)),
    }
}

/// Why a candidate was admitted or refused.
#[must_use]
pub fn why(decision: &Decision) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    match decision {
        Decision::HeldOutErrorFalls { z, relative } => {
            format!("with it the held-out error falls by {} ({z:.1} standard errors)", percent(*relative))
        }
        Decision::SeenBeyondDoubt { share, .. } => {
            format!("takes {} of what is left; the held-out records, which hardly excite it, get no worse", percent(share.min(1.0)))
        }
        Decision::ReachesTheFloor => "with it fitted and held-out error come down to the noise".into(),
        Decision::FittedErrorFalls { relative, .. } => format!("the error falls by {}; no record is held out", percent(*relative)),
        Decision::ReadingsShowIt => "the readings show it, whatever the model".into(),
        Decision::ExplainsAlone { share } => {
            format!("with all other values held it explains {} of what a new fit could remove", percent(share.clamp(0.0, 1.0)))
        }
        Decision::NotInTheResidual { p } => format!("a signature like it explains as much by chance (p = {p:.3})"),
        Decision::HeldOutErrorDoesNotFall { relative, .. } if *relative < 0.0 => "makes the held-out records worse".into(),
        Decision::HeldOutErrorDoesNotFall { .. } => "does not lower the error on held-out records by more than chance".into(),
        Decision::TooSmall { relative } => format!("no record improves by more than {}", percent(relative.max(0.0))),
        Decision::AnotherLeavesLess => "another effect in its place leaves less".into(),
        Decision::NotToldApart => "does as well: this data cannot tell".into(),
        Decision::LowersErrors { by } => {
            format!("lowers the errors by {}, far above the noise; nothing but that speaks for it", percent(1.0 - (-by).exp()))
        }
        Decision::RuledOut => "lowers the errors, and is not what it is called: its own physics rules that out".into(),
        Decision::NotTried => "not fitted: others are more like what is left, or explain more of it".into(),
    }
}

/// What has changed, for a reader.
#[must_use]
pub fn changed(values: &[ChangedValue]) -> String {
    let one = |v: &ChangedValue| {
        if v.parameter == "scale" {
            format!("{} times {}", spoken(&v.effect), figure(v.to))
        } else {
            format!("{} {} from {} to {}", spoken(&v.effect), spoken(&v.parameter), figure(v.from), figure(v.to))
        }
    };
    values.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// The findings of an ambiguous verdict: `creep; and delay or sensor bandwidth`.
fn either(findings: &[Finding]) -> String {
    findings.iter().map(|f| list(&f.effects, "or")).collect::<Vec<_>>().join("; and ")
}

/// What all sentences of a verdict speak of.
struct Said<'a> {
    diagnosis: &'a Diagnosis,
    found: &'a Found<'a>,
    floor: &'a NoiseFloor,
    policy: &'a Policy,
    /// The noise in nm, or nothing where it is unknown.
    floor_nm: String,
    /// What the errors are errors of.
    which: &'static str,
    /// Error of the model that was started from, um.
    before_um: f64,
    /// Error of the last model, um.
    after_um: f64,
    /// What a model from elsewhere came to, or nothing.
    story: String,
}

/// The verdict in a sentence.
#[must_use]
pub fn sentence(d: &Diagnosis, found: &Found, floor: &NoiseFloor, policy: &Policy) -> String {
    let (first, last) = (found.first, found.last);
    // Where the fitted records are met worse than the held-out ones, they are what is spoken of.
    let fitted_is_worse = d.verdict == Verdict::Unexplained && last.validate_rms_um.is_some_and(|v| v < last.identify_rms_um);
    let error = |j: &Judged| if fitted_is_worse { j.identify_rms_um } else { j.error_um() };
    let said = Said {
        diagnosis: d,
        found,
        floor,
        policy,
        floor_nm: floor.rms_um.or(floor.at_least_um).map(nm).unwrap_or_default(),
        which: match (fitted_is_worse, first.validate_rms_um) {
            (true, _) => "error on the fitted records",
            (false, None) => "error",
            (false, Some(_)) => "held-out error",
        },
        before_um: error(first),
        after_um: error(last),
        story: elsewhere_sentence(d, found),
    };
    said.verdict() + &other_structure(d, &first.model, &last.model) + &said.ends_of_the_sensor() + &closed_loop(found)
}

/// Where the readings end, for a reader.
#[must_use]
pub fn reading_limit(limit: &ReadingLimit) -> String {
    format!(
        "{}: {:.1} % of the readings stand at exactly {} um, their {}, while the drive moves: the range of the sensor or of its converter ends \
         there",
        limit.record,
        100.0 * limit.share,
        figure(limit.reading_um),
        if limit.highest { "highest" } else { "lowest" }
    )
}

/// Names of records as they are read.
fn listed(records: &[String]) -> String {
    match records {
        [] => String::new(),
        [one] => one.clone(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

/// That records begin otherwise than was said, for a reader.
#[must_use]
pub fn other_states(found: &OtherStates) -> String {
    let begin = if found.records.len() == 1 { "does not begin" } else { "do not begin" };
    format!(
        "{} {begin} in the state that was said: from there the error is {} nm, with the state unknown the same effects leave {} nm; \
         say `initial_state = \"unknown\"` there",
        listed(&found.records),
        nm(found.as_said_um),
        nm(found.unknown_um)
    )
}

/// That readings stand off by a constant, for a reader.
#[must_use]
pub fn off_zero(found: &OffZero) -> String {
    format!(
        "the readings of {} stand off by a constant: as zero the error is {} nm, with a constant of each record's own the same effects leave {} nm; say \
         `offset = \"fit\"` there",
        listed(&found.records),
        nm(found.as_said_um),
        nm(found.fitted_um)
    )
}

/// That readings follow the drive of their own row, for a reader.
#[must_use]
pub fn own_row(found: &OwnRow) -> String {
    let without = if found.not_needed.is_empty() { String::new() } else { format!(" and without {}", list(&found.not_needed, "and")) };
    format!(
        "the readings follow the drive of their own row: with `timing = \"hold_before_sample\"`{without} the error is {} nm, as it is {} nm; say \
         so in the manifest, or with --timing hold_before_sample",
        nm(found.own_row_um),
        nm(found.as_said_um)
    )
}

/// That readings were taken to follow the drive of their own row, for a reader.
#[must_use]
pub fn taken_in_own_rows(found: &OwnRow) -> String {
    format!(
        "the readings follow the drive of their own row, and are taken so: taken to follow that of the row before, the error is {} nm, with what does as well \
         so {} nm (otherwise: --timing hold_after_sample)",
        nm(found.as_said_um),
        nm(found.own_row_um)
    )
}

/// From where a delay counts that was found although nobody said when the drive of a row acts, for a reader.
#[must_use]
pub fn delay_counts_from(dataset: &Dataset) -> String {
    let period_s = dataset.records.iter().map(|r| r.dt_s()).fold(0.0, f64::max);
    format!(
        "the delay counts from the drive of a row acting after its reading, which was assumed: of a program that writes, then reads, it is one period \
         ({} ms) longer; say which with --timing hold_before_sample or hold_after_sample",
        figure(1e3 * period_s)
    )
}

/// That readings do not answer the drive, for a reader.
#[must_use]
pub fn unanswered(found: &Unanswered) -> String {
    format!(
        "{}: the readings do not answer the drive ({:.1} % of the {} nm that they move go with anything that it does): look at the sensor, the amplifier and which \
         column is which (`columns` in dataset.toml, or --columns)",
        found.record,
        100.0 * found.share.max(0.0),
        nm(found.moves_um)
    )
}

/// That a loop was closed while recording, for a reader.
#[must_use]
pub fn followed_reading(found: &Feedback) -> String {
    let later = match found.later_samples {
        0 => "in the same sample".into(),
        1 => "one sample later".into(),
        n => format!("{n} samples later"),
    };
    format!(
        "{}: the drive answers the noise of the readings {later} (correlation {:.2}, by chance up to {:.2}): a loop was closed while recording, \
         and what is identified leans towards its controller; record with the loop open",
        found.record, found.correlation, found.by_chance
    )
}

/// That the loops are met by another structure than the one that was started from, or by several; or nothing.
fn other_structure(d: &Diagnosis, first: &Model, last: &Model) -> String {
    let Some((of_the_model, others)) = d.loops.split_first() else { return String::new() };
    let from_surfaces = first.effect(hysteresis::ID).is_some() && last.effect(hysteresis::ID).is_none();
    let not_surfaces = if from_surfaces { ", not those of the surfaces" } else { "" };
    let as_well = match others {
        [] => String::new(),
        _ => format!("; loops {} meet this data as well", list(others, "or")),
    };
    format!(" The loops are {of_the_model}{not_surfaces}{as_well}.")
}

/// That a loop was closed while recording; or nothing.
fn closed_loop(found: &Found) -> String {
    let Some((first, others)) = found.feedback.split_first() else { return String::new() };
    let others = match others.len() {
        0 => String::new(),
        1 => " So does that of another record.".into(),
        n => format!(" So do those of {n} other records."),
    };
    format!(" {}.{others}", followed_reading(first))
}

impl Said<'_> {
    fn verdict(&self) -> String {
        let d = self.diagnosis;
        match d.verdict {
            Verdict::AtFloor => self.at_floor(),
            Verdict::Named if d.findings.iter().all(|f| f.decision == Decision::ReadingsShowIt) => self.coarse_readings(),
            Verdict::Named | Verdict::Ambiguous
                if !self.story.is_empty() && d.findings.iter().all(|f| !matches!(f.decision, Decision::ReadingsShowIt)) =>
            {
                self.beside_a_model_from_elsewhere()
            }
            Verdict::Named => self.named(),
            Verdict::Ambiguous => self.ambiguous(),
            Verdict::Unexplained => self.unexplained(),
            Verdict::Undecidable => self.undecidable(),
        }
    }

    /// Whether fitting again lowered the error by what counts as an explanation.
    fn fell(&self) -> bool {
        self.before_um > self.policy.explained * self.after_um
    }

    /// That readings end; or nothing.
    fn ends_of_the_sensor(&self) -> String {
        let Some((first, others)) = self.found.reading_limits.split_first() else { return String::new() };
        let others = match others.len() {
            0 => String::new(),
            1 => "; so do the readings at another end or of another record".into(),
            n => format!("; so do readings at {n} other ends or of other records"),
        };
        let first = reading_limit(first);
        format!(" The readings end: {first}{others}. What they say there is left out of every fit and figure.")
    }

    fn at_floor(&self) -> String {
        let (which, floor_nm, after) = (self.which, &self.floor_nm, nm(self.after_um));
        if !self.diagnosis.changed.is_empty() {
            format!("{} Nothing is missing that this data could show: the {which} is then {after} nm, the noise {floor_nm} nm.", self.story)
        } else if self.fell() {
            format!(
                "Nothing is missing that this data could show, but the values are others: fitted again to it, the same effects bring the \
                 {which} from {} to {after} nm; the noise is {floor_nm} nm.",
                nm(self.before_um)
            )
        } else {
            format!("Nothing is missing that this data could show: the {which} is {after} nm, the noise {floor_nm} nm.")
        }
    }

    fn coarse_readings(&self) -> String {
        let step_um = self.floor.reading_step_um.unwrap_or(0.0);
        format!(
            "{} is missing: the readings are whole steps of {} nm, which make {} of the {} nm of noise. Nothing else is missing that this \
             data could show: the {} is {} nm.",
            capital(&list(&self.diagnosis.named, "and")),
            nm(step_um),
            nm(rounding_noise(step_um)),
            self.floor_nm,
            self.which,
            nm(self.after_um)
        )
    }

    fn beside_a_model_from_elsewhere(&self) -> String {
        let after = nm(self.after_um);
        let rest = match self.floor.rms_um {
            Some(floor_um) if self.after_um > self.policy.explained * floor_um => {
                format!(" Fitted again, {after} nm are left; the noise is {} nm.", self.floor_nm)
            }
            Some(_) => format!(" Fitted again, nothing is left: {after} nm, the noise is {} nm.", self.floor_nm),
            None => " The noise is unknown, so nobody can say whether more is missing.".to_owned(),
        };
        format!("{}{rest}{}", self.story, likelier(self.diagnosis))
    }

    fn named(&self) -> String {
        let d = self.diagnosis;
        let (verb, it) = if d.named.len() == 1 { ("is", "it") } else { ("are", "them") };
        let without_a_name = without_a_name(d);
        let and = if without_a_name.is_empty() { "" } else { " and what has no name" };
        let others = if d.changed.is_empty() { String::new() } else { format!(" Besides, {} has changed.", changed(&d.changed)) };
        format!(
            "{} {verb} missing: adding {it}{and} brings the {} from {} to {} nm; the noise is {} nm.{others}{}{without_a_name}",
            capital(&list(&d.named, "and")),
            self.which,
            nm(self.before_um),
            nm(self.after_um),
            self.floor_nm,
            likelier(d)
        )
    }

    fn ambiguous(&self) -> String {
        let d = self.diagnosis;
        let without_a_name = without_a_name(d);
        let (with, together) =
            if without_a_name.is_empty() { ("", "they bring") } else { (", with what has no name,", "with what has no name they bring") };
        let (joint, said, about) = match d.findings.as_slice() {
            [_] => (": ", format!("this data cannot tell which is missing. Either{with} brings"), "about "),
            _ => (" ", format!("are missing; where it says `or`, this data cannot tell which. Together {together}"), ""),
        };
        format!(
            "{}{joint}{said} the {} from {} to {about}{} nm; the noise is {} nm.{}{without_a_name}",
            capital(&either(&d.findings)),
            self.which,
            nm(self.before_um),
            nm(self.after_um),
            self.floor_nm,
            likelier(d)
        )
    }

    fn unexplained(&self) -> String {
        let after = nm(self.after_um);
        let best: Vec<String> = self.found.supported.iter().map(|s| s.id.clone()).collect();
        let known = if best.is_empty() && self.fell() {
            format!("a better description of the hysteresis, the best it found, leaves {after} nm")
        } else if best.is_empty() {
            "no known effect lowers it beyond chance".to_string()
        } else {
            format!("the best it found ({}) leaves {after} nm", list(&best, "and"))
        };
        let before_all = if self.story.is_empty() { String::new() } else { format!("{} ", self.story) };
        if self.met_only_where_it_was_fitted() {
            return format!(
                "{before_all}The fitted records are met to the noise, the held-out ones are not: {known}, the noise is {} nm. What was fitted does not fix \
                 all values, or something acts only in what was held out: fit records that move as the held-out ones do.",
                self.floor_nm
            );
        }
        format!(
            "{before_all}Something is missing for which the search found nothing in the library: the {} is {} nm, the noise {} nm, and {known}.{}",
            self.which,
            nm(self.before_um),
            self.floor_nm,
            without_a_name(self.diagnosis)
        )
    }

    /// The fitted records are at the noise and the held-out ones are above it.
    fn met_only_where_it_was_fitted(&self) -> bool {
        let (last, at_floor) = (self.found.last, self.policy.explained);
        let fitted = self.floor.rms_um.is_some_and(|floor_um| last.identify_rms_um <= at_floor * floor_um);
        fitted && last.validate_rms_um.is_some_and(|held_out_um| held_out_um > at_floor * last.identify_rms_um)
    }

    fn undecidable(&self) -> String {
        let (d, which, before, after) = (self.diagnosis, self.which, nm(self.before_um), nm(self.after_um));
        if d.below_the_floor {
            return format!(
                "The {which} is {after} nm, below the {} nm of noise that the {} shows: one of them is wrong, and nothing can be decided \
                 until it is known which.",
                self.floor_nm, self.floor.basis
            );
        }
        if let Some((first, others)) = self.found.unanswered.split_first() {
            let others = match others.len() {
                0 => String::new(),
                1 => " So it is with another record.".into(),
                n => format!(" So it is with {n} other records."),
            };
            return format!("Nothing can be decided: {}.{others}", unanswered(first));
        }
        if let Some(otherwise) = of_how_it_began(self.found) {
            return format!("Nothing can be decided yet: {otherwise}, and run again.");
        }
        let noise = if self.floor_nm.is_empty() { "unknown".into() } else { format!("{} nm", self.floor_nm) };
        if self.found.out_of_time {
            let with: Vec<String> = self.found.supported.iter().map(|s| s.id.clone()).collect();
            let with = if with.is_empty() { String::new() } else { format!("with {} added ", list(&with, "and")) };
            return format!(
                "Not decided in the time there was: {with}the {which} is {after} nm, at the start {before}; the noise is {noise}. More time may find more."
            );
        }
        let unweighed = self.found.unweighed();
        if !unweighed.is_empty() {
            return format!(
                "Stopped before the evidence was weighed: with {} added the {which} is {after} nm instead of {before}; the noise is {noise}.",
                list(&unweighed, "and")
            );
        }
        if !self.story.is_empty() {
            return format!("{} The noise is unknown, so nobody can say whether more is missing.", self.story);
        }
        let gained = if d.named.is_empty() && self.fell() {
            format!("fitted again to this data, the same effects bring the {which} from {before} to {after} nm, and no other lowers it")
        } else if d.named.is_empty() {
            format!("no effect lowers the {which} by more than chance")
        } else {
            let verb = if d.findings.len() == 1 { "lowers" } else { "lower" };
            format!("{} {verb} the {which} from {before} to {after} nm", either(&d.findings))
        };
        format!("Nothing in this data shows the noise, so nobody can say whether more is missing; {gained}.{}", likelier(d))
    }
}

/// That a recording began or was timed otherwise than was said; or nothing.
fn of_how_it_began(found: &Found) -> Option<String> {
    found.other_states.map(other_states).or_else(|| found.off_zero.map(off_zero)).or_else(|| found.own_row.map(own_row))
}

/// What lowers the errors beside the findings, and is not what it is called.
fn without_a_name(d: &Diagnosis) -> String {
    let ruled_out = d.candidates.iter().filter(|c| c.decision == Decision::RuledOut);
    let one = |c: &CandidateFigures| {
        let because = c.unlikely_because.clone().unwrap_or_default();
        format!(" {} lowers the errors and is none: {because}.", capital(&spoken(&c.effect)))
    };
    ruled_out.map(one).collect()
}

/// What the physics of a finding says of it: which of two readings is likelier, or that the effect is what its values tell rather than what it is called.
fn likelier(d: &Diagnosis) -> String {
    let against = |id: &String| d.candidates.iter().find(|c| c.effect == *id).and_then(|c| c.unlikely_because.clone());
    let of = |f: &Finding| -> Option<String> {
        let (first, others) = f.effects.split_first()?;
        let Some(reason) = against(first) else {
            let (other, reason) = others.iter().find_map(|o| Some((o, against(o)?)))?;
            return Some(format!(" {} is likelier than {}: {reason}.", capital(&spoken(first)), spoken(other)));
        };
        Some(match others.iter().find(|other| against(other).is_none()) {
            Some(likely) => format!(" {} is likelier than {}: {reason}.", capital(&spoken(likely)), spoken(first)),
            None => format!(" {}: {reason}.", capital(&spoken(first))),
        })
    };
    d.findings.iter().filter_map(of).collect()
}

/// What a comparison with a model from elsewhere came to.
fn elsewhere_sentence(d: &Diagnosis, found: &Found) -> String {
    let Some(elsewhere) = found.elsewhere.filter(|e| !e.at_home) else { return String::new() };
    let Some(last) = elsewhere.story.last() else { return String::new() };
    let (before, after) = (elsewhere.base.identify_rms_um, last.judged.identify_rms_um);
    let missing: Vec<&Finding> = d.findings.iter().filter(|f| matches!(f.decision, Decision::ExplainsAlone { .. })).collect();
    let mut parts = Vec::new();
    if !missing.is_empty() {
        let names: Vec<String> = missing.iter().map(|f| list(&f.effects, "or")).collect();
        let verb = if missing.len() == 1 { "is" } else { "are" };
        parts.push(format!("{} {verb} missing in this recording", capital(&names.join("; and "))));
    }
    if !d.changed.is_empty() {
        let said = changed(&d.changed);
        parts.push(if parts.is_empty() {
            format!("Other values in this recording: {said}")
        } else {
            format!("and there are other values: {said}")
        });
    }
    if parts.is_empty() {
        parts.push(format!("{} is other in this recording", capital(&spoken(&last.hypothesis.effect(&elsewhere.base.model)))));
    }
    let others: Vec<String> = elsewhere
        .story
        .iter()
        .zip(&elsewhere.alternatives)
        .flat_map(|(_, alternatives)| alternatives.iter().map(|t| (t, t.hypothesis.effect(&elsewhere.base.model))))
        .map(
            |(t, id)| if matches!(t.hypothesis, Hypothesis::Missing(_)) { spoken(&id) } else { format!("other values of {}", spoken(&id)) },
        )
        .collect();
    let told = if others.is_empty() {
        "nothing else does as well: this data can tell".to_owned()
    } else {
        format!("this data cannot tell it from {}", others.join(", "))
    };
    format!(
        "{}: with all other values held as they were identified elsewhere, that alone brings the error from {} to {} nm; {told}.",
        parts.join(", "),
        nm(before),
        nm(after)
    )
}

/// What the data leave open.
#[must_use]
pub fn cannot_identify(what: &CannotIdentify) -> String {
    match what {
        CannotIdentify::AnyOf { effect } => {
            format!("{effect}: this data fixes none of its parameters by itself: other values of them do nearly as well together")
        }
        CannotIdentify::SomeOf { effect, parameters } => format!("{effect}: this data does not fix {}", parameters.join(", ")),
        CannotIdentify::MinorLoops => {
            "minor loops: the drive always turns at the same two voltages, so only one loop is known; nested reversals are a guess".into()
        }
        CannotIdentify::RateDependence { speed_v_s } if *speed_v_s < 0.5 => {
            "rate dependence: the drive jumps and holds, at no speed between, so loops at other speeds are a guess".into()
        }
        CannotIdentify::RateDependence { speed_v_s } => {
            format!("rate dependence: the drive moves at one speed only (about {speed_v_s:.0} V/s), so loops at other speeds are a guess")
        }
    }
}
